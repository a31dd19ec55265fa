//! Empty-space skipping. What is skipped contributes nothing, so the numbers stay the same and take less time.

use super::{Crossing, End, Keeping, Normals, Samples, Step, Values};
use crate::Scene;
use crate::plan::{Integrate, Planned};
use crate::tables::{CELL, LabelMap, Occupancy, Storage};
use relume_base::number::{Real, count, whole};

/// Samples of `inner`, of which marches leave out those in empty macrocells.
#[derive(Debug)]
pub struct Skipping<'a, S> {
    inner: S,
    occupancy: &'a Occupancy,
    /// Macrocells along the texture.
    cells_from_texture: [f64; 3],
    /// True if marches leave out empty steps.
    leaves_out: bool,
    /// True if shadows are empty where steps are.
    skips_shadows: bool,
}

impl<'a, S> Skipping<'a, S> {
    /// Wraps `inner` to skip macrocells whose bit in `occupancy` is 0.
    #[must_use]
    pub fn new(inner: S, occupancy: &'a Occupancy, scene: &Scene, planned: &Planned) -> Self {
        Self {
            inner,
            occupancy,
            cells_from_texture: scene.frame.geometry.dims.map(|voxels| count(voxels) / count(CELL)),
            leaves_out: planned.plan.integration == Integrate::Samples,
            skips_shadows: true,
        }
    }

    /// The same for the occupancy of tables, and for segments [`occupancy_within`](crate::tables::Cells::occupancy_within),
    /// without which a segment that crosses from cell to cell may not be empty. A table of shadows has entries of its own.
    #[must_use]
    pub fn of_tables(self) -> Self {
        Self { leaves_out: true, skips_shadows: false, ..self }
    }

    /// Coordinate in macrocells along `axis`, as in [`RayTable`](crate::tables::RayTable): from voxel 0, half a voxel into the texture.
    fn along<R: Real>(&self, axis: usize, place: R) -> f64 {
        place.to_f64() * self.cells_from_texture[axis] - 0.5 / count(CELL)
    }

    fn cell<R: Real>(&self, place: [R; 3]) -> [usize; 3] {
        std::array::from_fn(|axis| whole(self.along(axis, place[axis])).min(self.occupancy.dims[axis] - 1))
    }

    fn is_empty<R: Real>(&self, place: [R; 3]) -> bool {
        !self.occupancy.is_set(self.cell(place))
    }
}

impl<R: Real, S: Samples<R>> Samples<R> for Skipping<'_, S> {
    fn sample(&self, place: [R; 3], step: &mut Step<R>) {
        self.inner.sample(place, step);
    }

    fn values(&self, place: [R; 3]) -> Values<R> {
        self.inner.values(place)
    }

    fn density_of(&self, values: &[Option<R>], density: &mut Step<R>) {
        self.inner.density_of(values, density);
    }

    fn normal(&self, place: [R; 3]) -> [R; 3] {
        self.inner.normal(place)
    }

    fn normals_of_others(&self, place: [R; 3]) -> Normals<R> {
        self.inner.normals_of_others(place)
    }

    fn normal_between(&self, ends: [&End<R>; 2], middle: [R; 3]) -> [R; 3] {
        self.inner.normal_between(ends, middle)
    }

    fn end(&self, place: [R; 3]) -> End<R> {
        self.inner.end(place)
    }

    fn crossing(&self, place: [R; 3]) -> Crossing<R> {
        self.inner.crossing(place)
    }

    fn mean(&self, ends: [&End<R>; 2], middle: [R; 3], density: &mut Step<R>) -> R {
        self.inner.mean(ends, middle, density)
    }

    fn extinction(&self, place: [R; 3], number: usize) -> R {
        if self.skips_shadows && self.is_empty(place) { R::default() } else { self.inner.extinction(place, number) }
    }

    // Twin of `march_whole` in `shaders/slices.wgsl`.
    fn ahead(&self, place: [R; 3], step: [R; 3]) -> (bool, usize) {
        if !self.leaves_out {
            return (true, usize::MAX);
        }
        let cell = self.cell(place);
        let mut steps = f64::from(u16::MAX);
        for axis in 0..3 {
            let step = step[axis].to_f64() * self.cells_from_texture[axis];
            let face = count(cell[axis]) + if step > 0.0 { 1.0 } else { 0.0 };
            steps = steps.min((face - self.along(axis, place[axis])).abs() / step.abs().max(1e-30));
        }
        // A sample in the face between two macrocells has a value of both.
        (self.occupancy.is_set(cell), whole(steps) + 1)
    }

    fn stored_depth(&self, depth: R) -> R {
        self.inner.stored_depth(depth)
    }

    fn volume(&self) -> Option<(&Storage, Option<&LabelMap>)> {
        self.inner.volume()
    }

    fn keeping(&self) -> Option<Keeping<'_, R>> {
        self.inner.keeping()
    }
}
