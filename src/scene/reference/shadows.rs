//! Light that reaches a sample. Twin of `shaders/light_grid.wgsl`, its parts `light_medium.wgsl`, `columns.wgsl` and
//! `columns_within.wgsl`, and of the reading of a grid in `light.wgsl`.

use std::collections::VecDeque;
use std::sync::Arc;

use super::clip::{FAR, Planes};
use super::kept::{DepthKey, Keeping};
use super::{ReferenceError, Samples};
use crate::plan::Planned;
use crate::tables::{
    GridLight, LARGEST_RISE, LARGEST_SKY_DEPTH, LightGrid, PointRays, PositionTable, SECOND_DIFFERENCE, SKY_SPACING,
    Steps, Sweep, Within, sky_direction, sky_spacing,
};
use crate::{Scene, ShadowMethod, Shadows};
use relume_base::memory;
use relume_base::number::{Real, count, whole};
use relume_base::parallel;
use relume_base::progress::Progress;

/// Longest step of a ray to a light, in units of length.
const LONGEST_STEP: f64 = 0.25;
/// Spacing of the grid of the sky beside rays to the other lights, as a multiple of that of the device's.
const FINER_SKY: f64 = 0.5;
/// Directions of the sky beside rays to the other lights, as a multiple of the stated ones.
const MORE_DIRECTIONS: usize = 4;

/// Light that reaches a sample from the lights of [`PositionTable::grid_lights`], in their order.
#[derive(Debug)]
pub(super) struct Reaching<R> {
    lights: Vec<Dimming<R>>,
    /// Coefficients of each coloured absorber.
    absorbers: Vec<Vec<R>>,
    /// Corners of the crop box.
    crop: [[R; 3]; 2],
    clip: Planes<R>,
    start: R,
    step_length: R,
}

/// How the dimming of one light is found.
#[derive(Debug)]
enum Dimming<R> {
    /// Optical depths at the nodes of a grid: of all that is grey, and of each coloured absorber.
    Grid(Box<LightGrid>, Vec<Arc<Vec<R>>>),
    /// A ray in this direction, in texture coordinates per unit of length.
    Ray([R; 3]),
    /// A ray to this point.
    RayTo(PointRays),
    /// The mean over rays in these directions, for this distance.
    Rays(Vec<[R; 3]>, R),
}

impl<R: Real> Reaching<R> {
    /// Prepares the lights of `planned` for so many `pixels`; fills the grids that they need.
    ///
    /// # Errors
    ///
    /// [`ReferenceError::Cancelled`], [`ReferenceError::LightGrid`].
    pub(super) fn new(
        scene: &Scene,
        planned: &Planned,
        samples: &dyn Samples<R>,
        local_scale: glam::DVec3,
        pixels: usize,
        progress: &dyn Progress,
    ) -> Result<Self, ReferenceError> {
        let lights = PositionTable::new(scene, planned).grid_lights(scene, planned);
        let from = |vector: glam::DVec3| vector.to_array().map(R::from_f64);
        let (Shadows { method, spacing, .. }, start) = (scene.shadows, scene.shadow_start());
        let grid = LightGrid::new(scene, spacing);
        let free = memory::available_bytes();
        if method == ShadowMethod::Grid {
            let sky = LightGrid::new(scene, sky_spacing(&planned.plan.light) * spacing);
            let columns = lights.iter().map(|light| kept_columns(&sky, *light)).fold(0.0, f64::max);
            let depths = planned.plan.light.grid_depths();
            check_memory(spacing, count(grid.dims.iter().product()) * count(depths) + columns, size_of::<R>(), free)?;
        }
        let kept = |(light, grid, number): (GridLight, LightGrid, usize),
                    filled: &dyn Fn() -> Result<Vec<R>, ReferenceError>| {
            let Some(Keeping { depths, interpolation, smooth_labels }) = samples.keeping() else {
                return filled().map(Arc::new);
            };
            depths.of(DepthKey { interpolation, smooth_labels, grid, method, light, number, start }, filled)
        };
        let filled = |light: GridLight, sweep: &Sweep| -> Result<_, ReferenceError> {
            let depths = |number| {
                kept((light, grid, number), &|| {
                    let depths = fill(&grid, sweep, samples, number, progress)?;
                    Ok(depths.into_iter().map(|depth| samples.stored_depth(depth)).collect())
                })
            };
            Ok(Dimming::Grid(Box::new(grid), (0..=planned.plan.light.absorbers).map(depths).collect::<Result<_, _>>()?))
        };
        let dimming = |light| match (light, method) {
            (GridLight::From(direction), ShadowMethod::Rays) => Ok(Dimming::Ray(from(direction / local_scale))),
            (GridLight::From(direction), ShadowMethod::Grid) => filled(light, &grid.sweep(direction, start)),
            (GridLight::At(point), ShadowMethod::Rays) => Ok(Dimming::RayTo(PointRays { point, start, local_scale })),
            (GridLight::At(point), ShadowMethod::Grid) => filled(light, &grid.rays(point, start)),
            (GridLight::Sky { directions, reach }, ShadowMethod::Rays) if pixels == 1 => {
                // One ray reads few of the nodes of a grid.
                let along = (0..directions).map(|i| from(sky_direction(i, directions) / local_scale));
                Ok(Dimming::Rays(along.collect(), R::from_f64(reach.unwrap_or(FAR))))
            }
            (GridLight::Sky { directions, reach }, ShadowMethod::Rays) => {
                let spacing = FINER_SKY * SKY_SPACING * spacing;
                let sky = LightGrid::new(scene, spacing);
                let depths = 2.0 * count(sky.dims.iter().product()) + kept_columns(&sky, light);
                check_memory(spacing, depths, size_of::<R>(), free)?;
                let directions = MORE_DIRECTIONS * directions;
                let depths = kept((GridLight::Sky { directions, reach }, sky, 0), &|| {
                    sky_depths(&sky, directions, [start, reach.unwrap_or(FAR)], samples, progress)
                })?;
                Ok(Dimming::Grid(Box::new(sky), vec![depths]))
            }
            (GridLight::Sky { directions, reach }, ShadowMethod::Grid) => {
                let sky = LightGrid::new(scene, sky_spacing(&planned.plan.light) * spacing);
                let depths = kept((light, grid, 0), &|| {
                    let depths = sky_depths(&sky, directions, [start, reach.unwrap_or(FAR)], samples, progress)?;
                    Ok(resampled(&sky, &depths, &grid, samples))
                })?;
                Ok(Dimming::Grid(Box::new(grid), vec![depths]))
            }
        };
        Ok(Self {
            lights: lights.into_iter().map(dimming).collect::<Result<_, _>>()?,
            absorbers: (Steps::new(scene, planned).absorber_coefficients().into_iter())
                .map(|coefficients| coefficients.into_iter().map(R::from_f64).collect())
                .collect(),
            crop: grid.crop.map(from),
            clip: Planes::new(&grid.clip),
            start: R::from_f64(start),
            step_length: R::from_f64(
                (scene.accuracy.step_length / scene.frame.geometry.spacing.min_element()).min(LONGEST_STEP),
            ),
        })
    }

    /// Sets `reached` to the fractions of the light number `index` that reach `place`: one per component with coloured
    /// absorbers, otherwise one for all.
    pub(super) fn light(&self, index: usize, place: [R; 3], samples: &dyn Samples<R>, reached: &mut [R]) {
        if let Some(Dimming::Rays(directions, reach)) = self.lights.get(index) {
            let light = |&along| reaching(self.along(along, *reach, place, R::from_f64(1.0), samples, 0));
            let sum = directions.iter().map(light).fold(R::default(), |sum, light| sum + light);
            reached.fill(sum * R::from_f64(1.0 / count(directions.len())));
            return;
        }
        reached.fill(self.depth(index, 0, place, samples));
        for (absorber, coefficients) in self.absorbers.iter().enumerate() {
            let depth = self.depth(index, absorber + 1, place, samples);
            for (sum, &coefficient) in reached.iter_mut().zip(coefficients) {
                *sum = depth.mul_add(coefficient, *sum);
            }
        }
        reached.iter_mut().for_each(|depth| *depth = reaching(*depth));
    }

    /// Optical depth `number` from `place` to the light number `index`.
    fn depth(&self, index: usize, number: usize, place: [R; 3], samples: &dyn Samples<R>) -> R {
        let (step, far) = (self.step_length, R::from_f64(FAR));
        match self.lights.get(index) {
            Some(Dimming::Grid(grid, depths)) => {
                depths.get(number).map_or(R::default(), |depths| read(grid, depths, place))
            }
            Some(Dimming::Ray(along)) => self.along(*along, far, place, step, samples, number),
            Some(Dimming::RayTo(to)) => {
                let (along, distance) = to_point(to, place);
                self.along(along, distance, place, step, samples, number)
            }
            Some(Dimming::Rays(..)) | None => R::default(),
        }
    }

    /// Optical depth from `place` in a direction, for this `distance` or to the face of the crop box, of what the clip planes leave,
    /// in steps of at most `step`.
    fn along(&self, along: [R; 3], distance: R, place: [R; 3], step: R, samples: &dyn Samples<R>, number: usize) -> R {
        let end = distance.min(to_face(along, place, &self.crop));
        let [start, end] = self.clip.left(place, along, [self.start, end]);
        let way = (end - start).max(R::default());
        let steps = (way / step).ceil();
        let length = way / steps.max(R::from_f64(1.0));
        (0..steps.index()).fold(R::default(), |depth, step| {
            let reached = (R::from_f64(count(step)) + R::from_f64(0.5)).mul_add(length, start);
            let at = std::array::from_fn(|axis| reached.mul_add(along[axis], place[axis]));
            samples.extinction(at, number).mul_add(length, depth)
        })
    }
}

/// Fraction of light that is left after an optical depth.
fn reaching<R: Real>(depth: R) -> R {
    (-depth).exp_m1() + R::from_f64(1.0)
}

/// Direction from `place` to a point, in texture coordinates per unit of length, and its distance.
fn to_point<R: Real>(to: &PointRays, place: [R; 3]) -> ([R; 3], R) {
    let [point, scale] = [to.point, to.local_scale].map(|vector| vector.to_array().map(R::from_f64));
    let way: [R; 3] = std::array::from_fn(|axis| point[axis] - place[axis] * scale[axis]);
    let distance = way.iter().fold(R::default(), |sum, &x| x.mul_add(x, sum)).sqrt().max(R::from_f64(1e-6));
    (std::array::from_fn(|axis| way[axis] / (distance * scale[axis])), distance)
}

/// Distance from `place` to the face of the box between these corners.
pub(super) fn to_face<R: Real>(along: [R; 3], place: [R; 3], corners: &[[R; 3]; 2]) -> R {
    (0..3).fold(R::from_f64(FAR), |end, axis| {
        let face = if along[axis] > R::default() { corners[1][axis] } else { corners[0][axis] };
        let reach = (face - place[axis]) / along[axis];
        if along[axis].abs() < R::from_f64(1e-30) { end } else { end.min(reach) }
    })
}

/// Depths of columns that a fill of `light` on `sky` keeps for its reach.
fn kept_columns(sky: &LightGrid, light: GridLight) -> f64 {
    match light {
        GridLight::Sky { reach: Some(reach), .. } => sky.kept_columns(reach),
        _ => 0.0,
    }
}

/// Refuses a grid whose `depths` exceed the `free` bytes.
fn check_memory(spacing: f64, depths: f64, depth_bytes: usize, free: Option<u64>) -> Result<(), ReferenceError> {
    let needed = (whole(depths) as u64).saturating_mul(depth_bytes as u64);
    match free {
        Some(free) if needed > free => {
            Err(ReferenceError::LightGrid { spacing, needed_mb: needed.div_ceil(1 << 20), free_mb: free >> 20 })
        }
        _ => Ok(()),
    }
}

/// Optical depth at `place`, linear between the nodes of `grid`, x first.
pub(super) fn read<R: Real>(grid: &LightGrid, depths: &[R], place: [R; 3]) -> R {
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

/// Optical depths `number` at the nodes of `grid` towards the light of `sweep`.
fn fill<R: Real>(
    grid: &LightGrid,
    sweep: &Sweep,
    samples: &dyn Samples<R>,
    number: usize,
    progress: &dyn Progress,
) -> Result<Vec<R>, ReferenceError> {
    let clip = Planes::new(&grid.clip);
    let mut depths = vec![R::default(); grid.dims.iter().product()];
    let mut columns = vec![R::default(); sweep.columns[0] * sweep.columns[1]];
    let strides = [1, grid.dims[0], grid.dims[0] * grid.dims[1]];
    // Columns at the slices before, the nearest first.
    let mut before = VecDeque::new();
    for slice in 0..sweep.slices {
        if progress.cancelled() {
            return Err(ReferenceError::Cancelled);
        }
        let node = |i: usize, j: usize| {
            sweep.index(slice) * strides[sweep.axes[0]] + i * strides[sweep.axes[1]] + j * strides[sweep.axes[2]]
        };
        if let Some(to) = &sweep.to {
            let row = |j: usize| -> Vec<R> {
                (0..sweep.nodes[0])
                    .map(|i| depth_to(to, (grid, &clip), sweep, (samples, number), [i, j, slice]))
                    .collect()
            };
            let rows = parallel::map(sweep.nodes[1], &row);
            for (j, row) in rows.into_iter().enumerate() {
                row.into_iter().enumerate().for_each(|(i, depth)| depths[node(i, j)] = depth);
            }
            continue;
        }
        let within = sweep.within.map(|within| columns_within(within, &columns, &before));
        for j in 0..sweep.nodes[1] {
            for i in 0..sweep.nodes[0] {
                let columns = within.as_ref().unwrap_or(&columns);
                let passed = if sweep.cubic { passed_cubic } else { passed };
                depths[node(i, j)] = passed(sweep, columns, slice, [i, j]);
            }
        }
        if sweep.within.is_some() {
            // The next slice reads one more than it subtracts whole.
            before.truncate(sweep.within.map_or(0, |within| within.slices));
            before.push_front(columns.clone());
        }
        let [across, down] = sweep.window(slice);
        parallel::rows_mut(&mut columns, sweep.columns[0], &|j, row| {
            if down.contains(&j) {
                for i in across.clone() {
                    row[i] = row[i] + rise((grid, &clip), sweep, (samples, number), slice, [i, j]);
                }
            }
        });
    }
    Ok(depths)
}

/// Depths of `columns` up to a distance, from those at the slices `before`, the nearest first.
fn columns_within<R: Real>(within: Within, columns: &[R], before: &VecDeque<Vec<R>>) -> Vec<R> {
    // Slices ago.
    let depth = |column: usize, slices: usize| match slices.checked_sub(1) {
        None => columns[column],
        Some(i) => before.get(i).map_or(R::default(), |columns| columns[column]),
    };
    let rest = R::from_f64(within.rest);
    let depth_within = |column: usize| {
        let nearer = depth(column, within.slices);
        let beyond = rest.mul_add(depth(column, within.slices + 1) - nearer, nearer);
        (columns[column] - beyond).max(R::default())
    };
    (0..columns.len()).map(depth_within).collect()
}

/// Optical depth between a node and a point light; each part of the ray adds at most as much as a slice does.
fn depth_to<R: Real>(
    to: &PointRays,
    (grid, clip): (&LightGrid, &Planes<R>),
    sweep: &Sweep,
    (samples, number): (&dyn Samples<R>, usize),
    [i, j, slice]: [usize; 3],
) -> R {
    let from = |vector: glam::DVec3| vector.to_array().map(R::from_f64);
    let [corner, per_slice, across, down] = sweep.line.map(from);
    let [i, j, slice] = [i, j, slice].map(|n| R::from_f64(count(n)));
    let place: [R; 3] = std::array::from_fn(|axis| {
        i.mul_add(across[axis], j.mul_add(down[axis], slice.mul_add(per_slice[axis], corner[axis])))
    });
    let (along, distance) = to_point(to, place);
    let one = R::from_f64(1.0);
    let end = distance.min(to_face(along, place, &grid.room().map(from)));
    let [start, end] = clip.left(place, along, [R::from_f64(to.start), end]);
    let open = (end - start).max(R::default());
    // Rounding does not add a part.
    let parts = (open * R::from_f64(1.0 / sweep.path) - R::from_f64(1e-3)).ceil().max(R::default());
    let length = open / (parts.max(one) * R::from_f64(count(sweep.samples)));
    (0..parts.index()).fold(R::default(), |depth, part| {
        let sum = (0..sweep.samples).fold(R::default(), |sum, sample| {
            let n = R::from_f64(count(part * sweep.samples + sample)) + R::from_f64(0.5);
            let reached = n.mul_add(length, start);
            sum + samples.extinction(std::array::from_fn(|axis| reached.mul_add(along[axis], place[axis])), number)
        });
        depth + (sum * length).min(R::from_f64(LARGEST_RISE))
    })
}

/// Depths that stand for the mean light of so many `directions` of the sky, at the nodes of `grid`, dimmed from `start` to
/// `reach`.
fn sky_depths<R: Real>(
    grid: &LightGrid,
    directions: usize,
    [start, reach]: [f64; 2],
    samples: &dyn Samples<R>,
    progress: &dyn Progress,
) -> Result<Vec<R>, ReferenceError> {
    let mut sums = vec![R::default(); grid.dims.iter().product()];
    for i in 0..directions {
        let sweep = grid.sweep(sky_direction(i, directions), start).of_sky(Some(reach));
        let depths = fill(grid, &sweep, samples, 0, progress)?;
        for (sum, depth) in sums.iter_mut().zip(depths) {
            *sum = *sum + reaching(depth);
        }
    }
    let depth = |sum: R| (-(sum.to_f64() / count(directions)).ln()).clamp(0.0, LARGEST_SKY_DEPTH);
    Ok(sums.into_iter().map(|sum| R::from_f64(depth(sum))).collect())
}

/// The `depths` of `from` at the nodes of `to`, which divides the same box: a cubic between 64 nodes.
fn resampled<R: Real>(from: &LightGrid, depths: &[R], to: &LightGrid, samples: &dyn Samples<R>) -> Vec<R> {
    // Along each axis, the four nodes around each node of `to`, and their weights.
    let along = |axis: usize| -> Vec<([usize; 4], [R; 4])> {
        let last = from.dims[axis] - 1;
        let spaces = [last, to.dims[axis] - 1].map(count);
        let part = spaces[0] / spaces[1];
        let of_node = |i: usize| {
            let at = R::from_f64(count(i) * part).min(R::from_f64(spaces[0]));
            let base = at.floor().index().min(last - 1);
            let weights = depth_weights(at - R::from_f64(count(base)), SECOND_DIFFERENCE * part * part);
            (std::array::from_fn(|i| (base + i).saturating_sub(1).min(last)), weights)
        };
        (0..to.dims[axis]).map(of_node).collect()
    };
    let [x, y, z] = [along(0), along(1), along(2)];
    let [width, height, _] = from.dims;
    let plane = |z: &([usize; 4], [R; 4])| -> Vec<R> {
        let at = |[i, j, k]: [usize; 3]| depths[i + width * (j + height * k)];
        let row = |y: &([usize; 4], [R; 4])| {
            let node = |x: &([usize; 4], [R; 4])| {
                let line = |j, k| weighted(x.1, x.0.map(|i| at([i, j, k])));
                let square = |k| weighted(y.1, y.0.map(|j| line(j, k)));
                samples.stored_depth(weighted(z.1, z.0.map(square)).max(R::default()))
            };
            x.iter().map(node).collect::<Vec<R>>()
        };
        y.iter().flat_map(row).collect()
    };
    parallel::map(z.len(), &|k| plane(&z[k])).concat()
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

/// Weights of four depths, of a place a part `t` of a space behind the second: those of a cubic, less `part` of the second
/// difference, so that depths that are linear between nodes have the least error (docs/theory/shadows.md).
fn depth_weights<R: Real>(t: R, part: f64) -> [R; 4] {
    let [half, number] = [R::from_f64(0.5), R::from_f64(part)];
    let (square, cube) = (t * t, t * t * t);
    let of = |factor: f64, x: R, rest: R| R::from_f64(factor).mul_add(x, rest);
    let cubic = [
        square - half * (t + cube),
        of(1.5, cube, of(-2.5, square, R::from_f64(1.0))),
        of(-1.5, cube, of(2.0, square, half * t)),
        half * (cube - square),
    ];
    let one = R::from_f64(1.0);
    let second = [one - t, of(3.0, t, R::from_f64(-2.0)), of(-3.0, t, one), t];
    std::array::from_fn(|i| (-number).mul_add(second[i], cubic[i]))
}

/// Depth of the columns at a node of a slice, cubic between sixteen of them.
fn passed_cubic<R: Real>(sweep: &Sweep, columns: &[R], slice: usize, node: [usize; 2]) -> R {
    let mut base = [0; 2];
    let mut weights = [[R::default(); 4]; 2];
    for axis in 0..2 {
        let (shear, first) = (R::from_f64(sweep.shear[axis]), R::from_f64(sweep.first[axis]));
        let column = R::from_f64(count(slice)).mul_add(shear, R::from_f64(count(node[axis])) - first).max(R::default());
        base[axis] = column.floor().index();
        weights[axis] = depth_weights(column - R::from_f64(count(base[axis])), SECOND_DIFFERENCE);
    }
    let on = |axis: usize, i: usize| (base[axis] + i).saturating_sub(1).min(sweep.columns[axis] - 1);
    let row = |j: usize| weighted(weights[0], std::array::from_fn(|i| columns[on(0, i) + sweep.columns[0] * on(1, j)]));
    weighted(weights[1], std::array::from_fn(row)).max(R::default())
}

/// Sum of four values by their weights.
fn weighted<R: Real>([a, b, c, d]: [R; 4], [first, second, third, fourth]: [R; 4]) -> R {
    b.mul_add(second, c.mul_add(third, a * first + d * fourth))
}

/// Optical depth that a column gains over a slice.
fn rise<R: Real>(
    (grid, clip): (&LightGrid, &Planes<R>),
    sweep: &Sweep,
    (samples, number): (&dyn Samples<R>, usize),
    slice: usize,
    column: [usize; 2],
) -> R {
    let from = |vector: glam::DVec3| vector.to_array().map(R::from_f64);
    let [corner, per_slice, across, down] = sweep.line.map(from);
    let [low, high] = grid.room().map(from);
    let [i, j] = column.map(|column| R::from_f64(count(column)));
    let step = R::from_f64(1.0 / count(sweep.samples));
    let first = R::from_f64(count(slice)) - R::from_f64(sweep.behind);
    // Of the line of the column, in slices.
    let base = std::array::from_fn(|axis| i.mul_add(across[axis], j.mul_add(down[axis], corner[axis])));
    let far = R::from_f64(FAR);
    let [enter, leave] = clip.left(base, per_slice, [-far, far]);
    let (zero, one, half) = (R::default(), R::from_f64(1.0), R::from_f64(0.5) * step);
    let sum = (0..sweep.samples).fold(R::default(), |sum, sample| {
        let slices = (R::from_f64(count(sample)) + R::from_f64(0.5)).mul_add(step, first);
        let place: [R; 3] = std::array::from_fn(|axis| {
            slices.mul_add(per_slice[axis], i.mul_add(across[axis], j.mul_add(down[axis], corner[axis])))
        });
        // Of a sample that a plane cuts, the part that is left.
        let part = (((slices + half).min(leave) - (slices - half).max(enter)) / step).max(zero).min(one);
        let inside = (0..3).all(|axis| low[axis] <= place[axis] && place[axis] <= high[axis]);
        if inside && part > zero { sum + samples.extinction(place, number) * part } else { sum }
    });
    (sum * R::from_f64(sweep.path / count(sweep.samples))).min(R::from_f64(LARGEST_RISE))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_grid_beyond_the_free_memory_is_refused_with_its_size() {
        // Two lights in f64.
        let checked = |free| check_memory(0.5, 512_f64.powi(3), 16, free).map_err(|error| error.to_string());
        assert_eq!(checked(Some(16 << 27)), Ok(()));
        assert_eq!(checked(None), Ok(()), "a system that does not report it");
        assert_eq!(
            checked(Some((16 << 27) - 1)),
            Err("a light grid with a node every 0.5 voxels needs 2048 MB of memory, and 2047 are free; set a larger shadows.spacing, or shadows.method = \"rays\"".to_owned())
        );
    }
}
