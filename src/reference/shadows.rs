//! Light that reaches a sample. Twin of `shaders/light_grid.wgsl` and `shaders/shadowed.wgsl`.

use rayon::prelude::*;

use super::{ReferenceError, Samples};
use crate::memory;
use crate::number::{Real, count};
use crate::plan::Planned;
use crate::progress::Progress;
use crate::scene::{Scene, ShadowMethod};
use crate::tables::{LARGEST_RISE, LightGrid, PositionTable, Sweep};

/// Longest step of a ray to a light, in units of length.
const LONGEST_STEP: f64 = 0.25;

/// Ways of the light along [`PositionTable::shadow_directions`], in their order.
#[derive(Debug)]
pub(super) enum Ways<R> {
    /// Optical depths at the nodes of a grid, a list for each direction.
    Grid(LightGrid, Vec<Vec<R>>),
    /// Rays in texture coordinates per unit of length.
    Rays {
        directions: Vec<[R; 3]>,
        /// Corners of the crop box.
        crop: [[R; 3]; 2],
        start: R,
        step_length: R,
    },
}

impl<R: Real> Ways<R> {
    /// Prepares the lights of `planned`; fills the grid, if it has one.
    ///
    /// # Errors
    ///
    /// [`ReferenceError::Cancelled`], [`ReferenceError::LightGrid`].
    pub(super) fn new(
        scene: &Scene,
        planned: &Planned,
        samples: &impl Samples<R>,
        local_scale: glam::DVec3,
        progress: &dyn Progress,
    ) -> Result<Self, ReferenceError> {
        let directions = PositionTable::new(scene, planned).shadow_directions(&planned.plan).into_iter();
        let from = |vector: glam::DVec3| vector.to_array().map(R::from_f64);
        let grid = LightGrid::new(scene, scene.shadows.spacing);
        match scene.shadows.method {
            ShadowMethod::Rays => Ok(Self::Rays {
                directions: directions.map(|direction| from(direction / local_scale)).collect(),
                crop: grid.crop.map(from),
                start: R::from_f64(scene.shadow_start()),
                step_length: R::from_f64(
                    (scene.accuracy.step_length / scene.volume.geometry.spacing.min_element()).min(LONGEST_STEP),
                ),
            }),
            ShadowMethod::Grid => {
                check_memory(
                    scene.shadows.spacing,
                    grid.dims,
                    directions.len() * size_of::<R>(),
                    memory::available_bytes(),
                )?;
                let sweeps = directions.map(|direction| grid.sweep(direction, scene.shadow_start()));
                let depths = sweeps.map(|sweep| fill(&grid, &sweep, samples, progress)).collect::<Result<_, _>>()?;
                Ok(Self::Grid(grid, depths))
            }
        }
    }

    /// Fraction of the light from direction `index` that reaches `place`.
    pub(super) fn light(&self, index: usize, place: [R; 3], samples: &impl Samples<R>) -> R {
        let depth = match self {
            Self::Grid(grid, depths) => depths.get(index).map_or(R::default(), |depths| read(grid, depths, place)),
            Self::Rays { directions, crop, start, step_length } => {
                let along = directions[index];
                let end = (0..3).fold(R::from_f64(f64::from(f32::MAX)), |end, axis| {
                    let face = if along[axis] > R::default() { crop[1][axis] } else { crop[0][axis] };
                    let reach = (face - place[axis]) / along[axis];
                    if along[axis].abs() < R::from_f64(1e-30) { end } else { end.min(reach) }
                });
                let way = (end - *start).max(R::default());
                let steps = (way / *step_length).ceil();
                let length = way / steps.max(R::from_f64(1.0));
                (0..steps.index()).fold(R::default(), |depth, step| {
                    let reached = (R::from_f64(count(step)) + R::from_f64(0.5)).mul_add(length, *start);
                    let at = std::array::from_fn(|axis| reached.mul_add(along[axis], place[axis]));
                    samples.extinction(at).mul_add(length, depth)
                })
            }
        };
        (-depth).exp_m1() + R::from_f64(1.0)
    }
}

/// Refuses a grid of `nodes` along its axes with so many bytes per node that it exceeds the `free` bytes.
fn check_memory(spacing: f64, nodes: [usize; 3], per_node: usize, free: Option<u64>) -> Result<(), ReferenceError> {
    let needed = nodes.iter().fold(per_node as u64, |bytes, &n| bytes.saturating_mul(n as u64));
    match free {
        Some(free) if needed > free => {
            Err(ReferenceError::LightGrid { spacing, needed_mb: needed.div_ceil(1 << 20), free_mb: free >> 20 })
        }
        _ => Ok(()),
    }
}

/// Optical depth at `place`, linear between the nodes of `grid`, x first.
fn read<R: Real>(grid: &LightGrid, depths: &[R], place: [R; 3]) -> R {
    let [scale, offset] = [grid.scale, grid.offset].map(|vector| vector.to_array().map(R::from_f64));
    let mut base = [0; 3];
    let mut fraction = [R::default(); 3];
    for axis in 0..3 {
        let last = R::from_f64(count(grid.dims[axis] - 1));
        let node = place[axis].mul_add(scale[axis], offset[axis]).max(R::default()).min(last);
        base[axis] = node.floor().index().min(grid.dims[axis] - 2);
        fraction[axis] = node - R::from_f64(count(base[axis]));
    }
    let at = |[x, y, z]: [usize; 3]| depths[base[0] + x + grid.dims[0] * (base[1] + y + grid.dims[1] * (base[2] + z))];
    let between = |a: R, b: R, part: R| part.mul_add(b - a, a);
    let line = |y, z| between(at([0, y, z]), at([1, y, z]), fraction[0]);
    let plane = |z| between(line(0, z), line(1, z), fraction[1]);
    between(plane(0), plane(1), fraction[2])
}

/// Optical depths at the nodes of `grid` towards the light of `sweep`.
fn fill<R: Real>(
    grid: &LightGrid,
    sweep: &Sweep,
    samples: &impl Samples<R>,
    progress: &dyn Progress,
) -> Result<Vec<R>, ReferenceError> {
    let mut depths = vec![R::default(); grid.dims.iter().product()];
    let mut columns = vec![R::default(); sweep.columns[0] * sweep.columns[1]];
    let strides = [1, grid.dims[0], grid.dims[0] * grid.dims[1]];
    for slice in 0..sweep.slices {
        if progress.cancelled() {
            return Err(ReferenceError::Cancelled);
        }
        for j in 0..sweep.nodes[1] {
            for i in 0..sweep.nodes[0] {
                let node = sweep.index(slice) * strides[sweep.axes[0]]
                    + i * strides[sweep.axes[1]]
                    + j * strides[sweep.axes[2]];
                depths[node] = samples.stored_depth(passed(sweep, &columns, slice, [i, j]));
            }
        }
        let [across, down] = sweep.window(slice);
        columns.par_chunks_mut(sweep.columns[0]).enumerate().filter(|(j, _)| down.contains(j)).for_each(|(j, row)| {
            for i in across.clone() {
                row[i] = row[i] + rise(grid, sweep, samples, slice, [i, j]);
            }
        });
    }
    Ok(depths)
}

/// Depth of the columns at a node of a slice, linear between four of them.
fn passed<R: Real>(sweep: &Sweep, columns: &[R], slice: usize, node: [usize; 2]) -> R {
    let mut base = [0; 2];
    let mut fraction = [R::default(); 2];
    for axis in 0..2 {
        let (shear, first) = (R::from_f64(sweep.shear[axis]), R::from_f64(sweep.first[axis]));
        let column = R::from_f64(count(slice)).mul_add(shear, R::from_f64(count(node[axis])) - first);
        base[axis] = column.floor().index();
        fraction[axis] = column - R::from_f64(count(base[axis]));
    }
    let at = |i: usize, j: usize| {
        let [i, j] = [(base[0] + i).min(sweep.columns[0] - 1), (base[1] + j).min(sweep.columns[1] - 1)];
        columns[i + sweep.columns[0] * j]
    };
    let between = |a: R, b: R, part: R| part.mul_add(b - a, a);
    let line = |j| between(at(0, j), at(1, j), fraction[0]);
    between(line(0), line(1), fraction[1])
}

/// Optical depth that a column gains over a slice.
fn rise<R: Real>(grid: &LightGrid, sweep: &Sweep, samples: &impl Samples<R>, slice: usize, column: [usize; 2]) -> R {
    let from = |vector: glam::DVec3| vector.to_array().map(R::from_f64);
    let [corner, per_slice, across, down] = sweep.line.map(from);
    let [low, high] = grid.room().map(from);
    let [i, j] = column.map(|column| R::from_f64(count(column)));
    let step = R::from_f64(1.0 / count(sweep.samples));
    let first = R::from_f64(count(slice)) - R::from_f64(sweep.behind);
    let sum = (0..sweep.samples).fold(R::default(), |sum, sample| {
        let slices = (R::from_f64(count(sample)) + R::from_f64(0.5)).mul_add(step, first);
        let place: [R; 3] = std::array::from_fn(|axis| {
            slices.mul_add(per_slice[axis], i.mul_add(across[axis], j.mul_add(down[axis], corner[axis])))
        });
        let inside = (0..3).all(|axis| low[axis] <= place[axis] && place[axis] <= high[axis]);
        if inside { sum + samples.extinction(place) } else { sum }
    });
    (sum * R::from_f64(sweep.path / count(sweep.samples))).min(R::from_f64(LARGEST_RISE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_grid_beyond_the_free_memory_is_refused_with_its_size() {
        // Two lights in f64.
        let checked = |free| check_memory(0.5, [512; 3], 16, free).map_err(|error| error.to_string());
        assert_eq!(checked(Some(16 << 27)), Ok(()));
        assert_eq!(checked(None), Ok(()), "a system that does not report it");
        assert_eq!(
            checked(Some((16 << 27) - 1)),
            Err("a light grid with a node every 0.5 voxels needs 2048 MB of memory, and 2047 are free; set a larger shadows.spacing, or shadows.method = \"rays\"".to_owned())
        );
    }
}
