//! Empty-space skipping for the reference. Skipped samples contribute nothing, so the truth stays the same and takes
//! less time.

use glam::DVec3;

use relume_base::number::{count, whole};
use relume_scene::Scene;
use relume_scene::plan::{LANE, Planned};
use relume_scene::reference::{End, Keeping, Samples, Step};
use relume_scene::tables::{CELL, Cells, LabelMap, Occupancy, Storage};

/// Number of values across the data range at which the transfer function is evaluated, besides its bends.
const PLACES: usize = 1 << 16;

/// Samples of `inner` in occupied macrocells, and empty steps elsewhere.
#[derive(Debug)]
pub struct Skipping<'a, S> {
    inner: S,
    occupancy: &'a Occupancy,
    cells_from_texture: DVec3,
    /// Length of a step's source, padded to whole lanes.
    source: usize,
    opacity_numbers: usize,
}

impl<'a, S> Skipping<'a, S> {
    /// Wraps `inner` to skip macrocells whose bit in `occupancy` is 0.
    #[must_use]
    pub fn new(inner: S, occupancy: &'a Occupancy, scene: &Scene, planned: &Planned) -> Self {
        Self {
            inner,
            occupancy,
            cells_from_texture: DVec3::from_array(scene.frame.geometry.dims.map(count)) / count(CELL),
            source: planned.plan.parts().lanes * LANE,
            opacity_numbers: planned.plan.transmittance_numbers(),
        }
    }

    fn is_empty(&self, place: [f64; 3]) -> bool {
        // Macrocell coordinates as in `tables::RayTable`: from voxel 0, half a voxel into the texture.
        let cells = DVec3::from_array(place) * self.cells_from_texture - 0.5 / count(CELL);
        let dims = self.occupancy.dims;
        let cell: [usize; 3] = std::array::from_fn(|axis| whole(cells[axis]).min(dims[axis] - 1));
        let index = cell[0] + dims[0] * (cell[1] + dims[1] * cell[2]);
        self.occupancy.words.get(index / 32).is_none_or(|word| word >> (index % 32) & 1 == 0)
    }
}

impl<S: Samples<f64>> Samples<f64> for Skipping<'_, S> {
    fn sample(&self, place: [f64; 3], step: &mut Step<f64>) {
        if self.is_empty(place) {
            step.source.clear();
            step.source.resize(self.source, 0.0);
            step.opacity.clear();
            step.opacity.resize(self.opacity_numbers, 0.0);
        } else {
            self.inner.sample(place, step);
        }
    }

    fn normal(&self, place: [f64; 3]) -> [f64; 3] {
        self.inner.normal(place)
    }

    // A segment crosses from cell to cell, so its ends are read everywhere.
    fn end(&self, place: [f64; 3]) -> End<f64> {
        self.inner.end(place)
    }

    fn mean(&self, ends: [&End<f64>; 2], middle: [f64; 3], density: &mut Step<f64>) -> f64 {
        self.inner.mean(ends, middle, density)
    }

    fn extinction(&self, place: [f64; 3], number: usize) -> f64 {
        if self.is_empty(place) { 0.0 } else { self.inner.extinction(place, number) }
    }

    fn stored_depth(&self, depth: f64) -> f64 {
        self.inner.stored_depth(depth)
    }

    fn keeping(&self) -> Option<Keeping<'_, f64>> {
        self.inner.keeping()
    }
}

/// Occupancy of the macrocells of `scene`: whether its transfer function or a label scatters or absorbs there.
#[must_use]
pub fn occupancy(scene: &Scene, storage: &Storage, labels: Option<&LabelMap>) -> Occupancy {
    Cells::new(scene.volume(), storage, labels).occupancy(&visible(scene, storage.domain))
}

/// Whether `scene` scatters or absorbs, at values from the lowest to the highest; also at both values around a bend, if
/// it does so at the bend or right beside it.
fn visible(scene: &Scene, [low, high]: [f64; 2]) -> Vec<bool> {
    let last = count(PLACES - 1);
    let shows = |value: f64| {
        let medium = scene.transfer.medium(value, scene.materials.len());
        medium.scattering.iter().chain(&medium.absorption).any(|&depth| depth > 0.0)
    };
    let mut active: Vec<bool> = (0..PLACES).map(|i| shows((high - low).mul_add(count(i) / last, low))).collect();
    for bend in scene.transfer.bends().into_iter().filter(|bend| (low..=high).contains(bend)) {
        if [bend.next_down(), bend, bend.next_up()].into_iter().any(shows) {
            let place = whole((bend - low) / (high - low) * last);
            active[place] = true;
            active[(place + 1).min(PLACES - 1)] = true;
        }
    }
    active
}
