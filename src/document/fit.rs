//! Cameras that show the visible voxels as large as fits.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::number::{count, nearest, unsigned, whole};
use crate::scene::{Aim, Camera, Fill, Projection, Scene, Term, View};
use crate::volume::{Geometry, Volume, Voxel, coarse_index, with_voxels};

/// Fraction of the picture that its visible pixels span in their larger direction.
pub(super) const FILL: f64 = 0.9;
/// Fraction of the way to the edge of the picture that an end reaches at most, where the other reaches less.
const MOST: f64 = 0.94;
/// Aspect ratios for which a fit states its fill.
const ASPECTS: [f64; Fill::MOST] = [0.5, 0.625, 0.75, 0.875, 1.0, 1.15, 1.3333, 1.5, 1.7778, 2.4];
/// Rounds of a fit: steps of Newton's method for the distance, with one of the centre.
const ROUNDS: usize = 10;
/// Fits to silhouettes. The second is for objects that extend beyond the frame of the first.
const PASSES: usize = 2;
/// Optical depth from which a pixel is visible: it is brighter than about 12 of 255 in a first look.
const VISIBLE: f64 = 0.016;
/// Cosine of the elevation below which the upright axis is nearly the line of sight.
const STEEP: f64 = 0.3;
/// Most rows of voxels that are searched for visible ones.
const ROWS: usize = 1 << 16;

/// World points around the first and the last visible voxel of every n-th row, n by `stride`: their hull is that of all
/// visible voxels, up to n − 1 voxels. A single visible voxel in a row is a speck. `shows` is called with the index and the
/// value of a voxel.
pub(super) fn outline(
    volume: &Volume,
    stride: [usize; 3],
    crop: Option<[[usize; 3]; 2]>,
    shows: impl Fn(usize, f64) -> bool + Sync,
) -> Vec<DVec3> {
    let [nx, ny, nz] = volume.geometry.dims;
    let [low, high] = crop.unwrap_or([[0; 3], [nx - 1, ny - 1, nz - 1]]);
    let lines = |axis: usize| (low[axis]..=high[axis]).step_by(stride[axis]);
    let rows: Vec<[usize; 2]> = lines(2).flat_map(|z| lines(1).map(move |y| [y, z])).collect();
    let least = if nx < 8 { 1 } else { 2 };
    let ends = |&[y, z]: &[usize; 2]| {
        let first = nx * (y + ny * z);
        let seen = |x: usize| {
            let value = volume.voxels.value(first + x);
            value.is_some_and(|it| shows(first + x, it.mul_add(volume.slope, volume.intercept)))
        };
        let is_body = |x: &usize| (*x..x + least).all(|x| x <= high[0] && seen(x));
        let left = (low[0]..=high[0]).find(is_body)?;
        let is_end = |x: &usize| (x + 1 - least..=*x).all(|x| x >= low[0] && seen(x));
        let right = (left + least - 1..=high[0]).rev().find(is_end)?;
        Some([(left, y, z), (right, y, z)])
    };
    let found: Vec<[(usize, usize, usize); 2]> = rows.par_iter().filter_map(ends).collect();
    let corners = |(x, y, z): (usize, usize, usize)| {
        let index = DVec3::new(count(x), count(y), count(z));
        [[-0.5, -0.5], [-0.5, 0.5], [0.5, -0.5], [0.5, 0.5]].map(|[y, z]| index + DVec3::new(0.0, y, z))
    };
    let around = |[left, right]: [(usize, usize, usize); 2]| {
        let left = corners(left).map(|index| index - DVec3::X / 2.0);
        left.into_iter().chain(corners(right).map(|index| index + DVec3::X / 2.0))
    };
    found.into_iter().flat_map(around).map(|index| volume.geometry.world_from_index(index)).collect()
}

/// World points whose hull is that of the voxels of `scene` that its crop box, transfer function and labels show.
pub(super) fn visible(scene: &Scene) -> Vec<DVec3> {
    // Of voxels that stay in a file, those of a coarse level.
    let volume = scene.volume.at_hand();
    let block = scene.volume.block_of(volume);
    let [nx, ny, nz] = volume.geometry.dims;
    // Voxels around a crop box between them.
    let crop = scene.crop.map(|[low, high]| {
        let [low, high] = [low, high].map(|index| coarse_index(index, block));
        let ends = |axis: usize, last: usize| {
            let [low, high] = [low[axis].floor(), high[axis].ceil()].map(|at| whole(at.max(0.0)).min(last));
            [low, high.max(low)]
        };
        let [x, y, z] = [ends(0, nx - 1), ends(1, ny - 1), ends(2, nz - 1)];
        [[x[0], y[0], z[0]], [x[1], y[1], z[1]]]
    });
    let lines = |axis: usize| crop.map_or(volume.geometry.dims[axis], |[low, high]| high[axis] - low[axis] + 1);
    let step = whole((count(lines(1) * lines(2)) / count(ROWS)).sqrt().ceil()).max(1);
    let ranges = ranges(scene);
    let by_value = |value: f64| ranges.iter().any(|&[low, high]| (low..=high).contains(&value));
    let label = |index: usize| {
        let labels = scene.labels.as_ref()?;
        // That of the voxel in the middle of a block.
        let [x, y, z] = [index % nx, index / nx % ny, index / (nx * ny)];
        let dims = labels.volume.geometry.dims;
        let [x, y, z] =
            [(x, 0), (y, 1), (z, 2)].map(|(at, axis)| (at * block[axis] + block[axis] / 2).min(dims[axis] - 1));
        let label = nearest(labels.volume.voxels.value(x + dims[0] * (y + dims[1] * z))?);
        labels.declared.iter().find(|entry| i64::from(entry.label) == i64::from(label))
    };
    let shows = |index: usize, value: f64| match label(index) {
        Some(entry) => entry.opacity > 0.0 || entry.absorption > 0.0,
        None => by_value(value),
    };
    outline(volume, [1, step.min(lines(1).div_ceil(8)), step.min(lines(2).div_ceil(8))], crop, shows)
}

/// Optical depths per world unit by the value.
pub(super) struct Depths {
    range: [f64; 2],
    per_value: f64,
    depths: Vec<f64>,
    /// The terms and their length of opacity, if the entries cannot show every bend.
    exact: Option<(Vec<Term>, f64)>,
}

impl Depths {
    /// Those of a transfer function with these terms.
    pub(super) fn of(terms: &[Term], opacity_length: f64) -> Self {
        /// Entries: enough for every bend of almost every transfer function, and at most.
        const ENTRIES: [f64; 2] = [2048.0, 65536.0];
        let curves = || terms.iter().flat_map(|term| [&term.opacity, &term.absorption]);
        let mut bends: Vec<f64> = curves().flatten().map(|point| point.0).collect();
        bends.sort_unstable_by(f64::total_cmp);
        let (first, last) = bends.first().copied().zip(bends.last().copied()).unwrap_or_default();
        let gaps = bends.windows(2).map(|pair| pair[1] - pair[0]).filter(|&gap| gap > 0.0);
        let wanted = 2.0 * (last - first) / gaps.fold(f64::MAX, f64::min);
        let exact = (wanted > ENTRIES[1]).then(|| (terms.to_vec(), opacity_length));
        let entries = wanted.clamp(ENTRIES[0], ENTRIES[1]).ceil();
        let value = |entry: usize| (last - first).mul_add(count(entry) / entries, first);
        let depth = |value: f64| -> f64 { terms.iter().map(|term| term.depth(value)).sum::<f64>() / opacity_length };
        // Ends for the values beyond.
        let beyond = [f64::NEG_INFINITY, f64::INFINITY].map(depth);
        let mut depths = vec![beyond[0]];
        depths.extend((0..=whole(entries)).map(|entry| depth(value(entry))));
        depths.push(beyond[1]);
        let per_value = if last > first { entries / (last - first) } else { 0.0 };
        Self { range: [first, last], per_value, depths, exact }
    }

    /// Optical depth at `value`; none where it is no number.
    pub(super) fn at(&self, value: f64) -> f64 {
        if value.is_nan() {
            return 0.0;
        }
        if let Some((terms, opacity_length)) = &self.exact {
            return terms.iter().map(|term| term.depth(value)).sum::<f64>() / opacity_length;
        }
        let [first, last] = self.range;
        let beyond = self.depths.len() - 1;
        let entry = if value < first {
            0
        } else if value > last {
            beyond
        } else {
            whole((value - first).mul_add(self.per_value, 1.5)).min(beyond - 1)
        };
        self.depths[entry]
    }
}

/// Ranges of values that a scene shows: where a term has at least 0.3 of its largest opacity or absorption. A term whose
/// optical depth across the whole volume is hardly visible shows nothing.
fn ranges(scene: &Scene) -> Vec<[f64; 2]> {
    const PART: f64 = 0.3;
    const HARDLY: f64 = 0.05;
    let lengths = scene.volume.geometry.extent().length() / scene.transfer.opacity_length;
    let mut ranges = Vec::new();
    for curve in scene.transfer.terms.iter().flat_map(|term| [&term.opacity, &term.absorption]) {
        let most = curve.iter().map(|point| point.1).fold(0.0, f64::max);
        if most * lengths < HARDLY {
            continue;
        }
        let shown = PART * most;
        let ends = [(f64::NEG_INFINITY, curve.first()), (f64::INFINITY, curve.last())];
        for (beyond, end) in ends {
            if let Some(&(value, _)) = end.filter(|end| end.1 >= shown) {
                ranges.push([value.min(beyond), value.max(beyond)]);
            }
        }
        for pair in curve.windows(2) {
            let [(from, one), (to, other)] = [pair[0], pair[1]];
            let crossing = from + (to - from) * ((shown - one) / (other - one));
            match (one >= shown, other >= shown) {
                (true, true) => ranges.push([from, to]),
                (true, false) => ranges.push([from, crossing]),
                (false, true) => ranges.push([crossing, to]),
                (false, false) => {}
            }
        }
    }
    ranges
}

/// Scales of a projection: half the size of the picture at distance 1, and 1 if nearer points are larger.
fn scales(projection: Projection) -> [f64; 2] {
    match projection {
        Projection::Perspective { fov_degrees } => [(fov_degrees / 2.0).to_radians().tan(), 1.0],
        Projection::Orthographic { .. } => [1.0, 0.0],
    }
}

/// The camera of the directions and the projection of `camera` that shows `points` in the middle of a square picture, and
/// span [`FILL`] of pictures of all aspect ratios; `camera` itself if there are none. Its box is that of the points of `solid`.
pub(super) fn fitted(camera: &Camera, points: &[DVec3], solid: &[DVec3], geometry: &Geometry) -> Camera {
    let (Aim::Orbit { azimuth, elevation, front, .. }, Some(view)) = (camera.aim, camera.view(geometry, 1.0)) else {
        return camera.clone();
    };
    let (Some(low), Some(high)) = (solid.iter().copied().reduce(DVec3::min), solid.iter().copied().reduce(DVec3::max))
    else {
        return camera.clone();
    };
    let View { forward, right, up, .. } = view;
    // A box has no side of length 0.
    let half = ((high - low) / 2.0).max(DVec3::splat(1e-3 * (high - low).max_element()));
    let [size, near] = scales(camera.projection);
    // The ends of the picture from `distance`, as place and depth, along its width and its height.
    let ends = |centre: DVec3, distance: f64| {
        [right, up].map(|side| {
            let end = |point: &DVec3| {
                let from_centre = *point - centre;
                let depth = (distance + near * from_centre.dot(forward)).max(1e-3 * distance);
                [(from_centre.dot(side) / depth, depth); 2]
            };
            // Equal places are told apart by their depths, so that the order of the threads does not matter.
            let outer = |[low, high]: [(f64, f64); 2], [left, right]: [(f64, f64); 2]| {
                [if left < low { left } else { low }, if right > high { right } else { high }]
            };
            points.par_iter().map(end).reduce(|| [(f64::INFINITY, 1.0), (f64::NEG_INFINITY, 1.0)], outer)
        })
    };
    // The step away after which the larger of width and height spans what it shall, if its nearer end decides.
    let away = |ends: [[(f64, f64); 2]; 2], aspect: f64| {
        let of_side = |([low, high], limit): ([(f64, f64); 2], f64)| {
            ((high.0 - low.0) / (2.0 * size * limit * FILL), low.1.min(high.1))
        };
        let [width, height] = [(ends[0], aspect), (ends[1], 1.0)].map(of_side);
        let (ratio, depth) = if width.0 > height.0 { width } else { height };
        (ratio - 1.0) * depth
    };
    // The distance from which both ends lie within a fraction of the picture; for that of the span, at least its distance.
    let enough = |centre: DVec3, aspect: f64, fraction: f64| {
        let needs = |point: &DVec3| {
            let from_centre = *point - centre;
            let across = (from_centre.dot(right).abs() / aspect).max(from_centre.dot(up).abs());
            across / (size * fraction) - near * from_centre.dot(forward)
        };
        points.par_iter().map(needs).reduce(|| 0.0, f64::max)
    };
    // Steps along the upright axis keep it in the middle of the points when the camera turns about it.
    let upright = camera.up.normalize_or_zero();
    let rise = upright.dot(up);
    let lift = if rise > STEEP { upright / rise } else { up };
    let mut centre = (low + high) / 2.0;
    for _ in 0..ROUNDS {
        let found = ends(centre, enough(centre, 1.0, FILL));
        // The step after which opposite ends are equally far from the middle.
        let step = found.map(|[low, high]| (low.0 + high.0) / (low.1.recip() + high.1.recip()));
        centre += step[0] * right + step[1] * lift;
    }
    let fill = ASPECTS.map(|aspect| {
        let mut there = enough(centre, aspect, FILL);
        for _ in 0..ROUNDS {
            there += away(ends(centre, there), aspect);
        }
        let there = there.max(enough(centre, aspect, MOST));
        // The fraction that the box spans from this distance.
        let of_corner = |corner: u32| {
            let corner = half * DVec3::from_array([0, 1, 2].map(|axis| f64::from(corner >> axis & 1) * 2.0 - 1.0));
            let across = (corner.dot(right).abs() / aspect).max(corner.dot(up).abs());
            across / (size * (there + near * corner.dot(forward)))
        };
        let fill = (0..8).map(of_corner).fold(0.0, f64::max);
        // Four digits are enough, and readable.
        [aspect, (fill * 1e4).round() / 1e4]
    });
    let valid: Vec<[f64; 2]> = fill.into_iter().filter(|pair| (0.01..=100.0).contains(&pair[1])).collect();
    let Some(fill) = Fill::by_aspect(&valid) else { return camera.clone() };
    let around = Some([centre - half, centre + half]);
    Camera { aim: Aim::Orbit { azimuth, elevation, fill, front, around }, ..*camera }
}

/// The voxels that a camera fits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen<'a> {
    pub(super) volume: &'a Volume,
    /// The first and the last of them along each axis, if not all are seen.
    pub(super) crop: Option<[[usize; 3]; 2]>,
    /// Values between them are interpolated.
    pub(super) is_interpolated: bool,
}

impl Seen<'_> {
    /// Optical depth of the voxel at `index`, of this `value`, in its neighbourhood, and how far it extends towards its
    /// neighbours, as a fraction of their distance. `depth` is that by value.
    fn extent(&self, index: usize, value: f64, depth: impl Fn(f64) -> f64) -> (f64, f64) {
        /// Halvings of the distance to a neighbour.
        const HALVINGS: u32 = 5;
        let here = depth(value);
        if here <= 0.0 || !self.is_interpolated {
            return (here, 0.5);
        }
        let [nx, ny, nz] = self.volume.geometry.dims;
        let axes = [(index % nx, nx, 1), (index / nx % ny, ny, nx), (index / (nx * ny), nz, nx * ny)];
        let at = |index: usize| {
            let stored = self.volume.voxels.value(index).unwrap_or(f64::NAN);
            stored.mul_add(self.volume.slope, self.volume.intercept)
        };
        let (mut sum, mut extent) = (0.0, None);
        for (place, side, step) in axes {
            // Beyond the volume lies the value of its face; no number counts as one.
            let before = if place > 0 { at(index - step) } else { value };
            let after = if place + 1 < side { at(index + step) } else { value };
            for other in [before, after] {
                let other = if other.is_finite() { other } else { value };
                sum += other;
                if depth(other) <= 0.0 {
                    // The last place towards it that is visible.
                    let (mut near, mut far) = (0.0, 1.0);
                    for _ in 0..HALVINGS {
                        let place = f64::midpoint(near, far);
                        let is_visible = depth((other - value).mul_add(place, value)) > 0.0;
                        (near, far) = if is_visible { (place, far) } else { (near, place) };
                    }
                    let found = f64::midpoint(near, far);
                    extent = Some(extent.map_or(found, |extent: f64| extent.max(found)));
                }
            }
        }
        // Specks of noise fade where values are interpolated.
        (here.min(depth(f64::midpoint(value, sum / 6.0))), extent.unwrap_or(0.5))
    }
}

/// The camera of the directions and the projection of `camera` that fits the visible pixels of its own picture of a volume.
/// `depth` is the optical depth per world unit by the value. `outline` are points around most of these voxels.
pub(super) fn framed(camera: &Camera, outline: &[DVec3], seen: Seen<'_>, depth: impl Fn(f64) -> f64 + Sync) -> Camera {
    let volume = seen.volume;
    let mut found = fitted(camera, outline, outline, &volume.geometry);
    for _ in 0..PASSES {
        let Some(view) = found.view(&volume.geometry, 1.0) else { break };
        let target = found.aim.target(&volume.geometry);
        let silhouette = Silhouette::of(&view, target, seen, outline, &depth);
        if silhouette.points.is_empty() {
            break;
        }
        found = fitted(camera, &silhouette.points, outline, &volume.geometry);
        if silhouette.is_whole {
            break;
        }
    }
    found
}

/// The visible pixels of a square picture.
struct Silhouette {
    /// World points at the corners of the first and the last visible pixel of each row and column, at the depth of their nearest voxel.
    points: Vec<DVec3>,
    /// Nothing extends beyond the frame.
    is_whole: bool,
}

impl Silhouette {
    /// The silhouette of a volume that `view` shows with `target` in the middle. `outline` are points around most of its
    /// visible voxels.
    fn of(view: &View, target: DVec3, of: Seen<'_>, outline: &[DVec3], depth: &(impl Fn(f64) -> f64 + Sync)) -> Self {
        /// Fraction of the outline within which its ends hardly lie.
        const INNER: f64 = 0.75;
        let reach = |side: fn(DVec3) -> f64| {
            let of_point = |point: &DVec3| {
                let seen = view.seen(*point);
                (side(seen) / if view.parallel { 1.0 } else { seen.z.max(f64::MIN_POSITIVE) }).abs()
            };
            outline.iter().map(of_point).fold(0.0, f64::max)
        };
        let inner = [INNER * reach(|seen| seen.x), INNER * reach(|seen| seen.y)];
        // Voxels in the middle of the picture cannot be its ends, unless the outline is far too large.
        let middle = DVec3::from_array([inner[0], inner[1], 0.0]);
        let found = Sums::of(view, target, of, middle, depth).silhouette(view, inner);
        found.unwrap_or_else(|| {
            let all = Sums::of(view, target, of, DVec3::ZERO, depth).silhouette(view, [0.0; 2]);
            all.unwrap_or(Self { points: Vec::new(), is_whole: true })
        })
    }
}

/// Optical depths of the pixels of a square picture.
struct Sums {
    side: usize,
    /// In units of 1 / [`UNITS`]: sums of whole numbers do not depend on the order of the threads.
    depths: Vec<AtomicU64>,
    /// Distance of the nearest voxel from the eye, in units of `far` / [`UNITS`].
    nearest: Vec<AtomicU64>,
    far: f64,
}

/// Units of an optical depth of 1.
const UNITS: f64 = 1048576.0;
/// Half the width of the picture of [`Sums`], in half widths of that of its view.
const FRAME: f64 = 1.25;

impl Sums {
    /// Adds the voxels outside the `inner` part of the picture, a fraction of its half width and half height.
    fn of(view: &View, target: DVec3, of: Seen<'_>, inner: DVec3, depth: &(impl Fn(f64) -> f64 + Sync)) -> Self {
        /// Most voxels that are added.
        const VOXELS: f64 = 2_097_152.0;
        /// Least and most pixels of a side.
        const SIDES: [f64; 2] = [256.0, 512.0];
        let Seen { volume, crop, .. } = of;
        let geometry = &volume.geometry;
        let [nx, ny, nz] = geometry.dims;
        let [low, high] = crop.unwrap_or([[0; 3], [nx - 1, ny - 1, nz - 1]]);
        let lines: [usize; 3] = std::array::from_fn(|axis| high[axis] - low[axis] + 1);
        let stride = whole((lines.map(count).iter().product::<f64>() / VOXELS).cbrt().ceil()).max(1);
        let stride = lines.map(|lines| stride.min(lines.div_ceil(32)));
        let step = geometry.spacing * DVec3::from_array(stride.map(count));
        // Axes of a sampled voxel and the first of them, in coordinates of the picture.
        let place = |index: [usize; 3]| view.seen(geometry.world_from_index(DVec3::from_array(index.map(count))));
        let axes = [0, 1, 2].map(|axis| {
            let along = geometry.direction.col(axis) * step[axis];
            DVec3::new(along.dot(view.right) / view.half[0], along.dot(view.up) / view.half[1], along.dot(view.forward))
        });
        let origin = place(low);
        let middle = if view.parallel { 1.0 } else { view.seen(target).z };
        // A pixel is about as large as a voxel.
        let pitch = step.element_product().cbrt() / (middle * view.half[1]);
        let side = (2.0 * FRAME / pitch).clamp(SIDES[0], SIDES[1]).ceil();
        let pixels = side / (2.0 * FRAME);
        // Between that of a face and that of a corner.
        let sizes = axes.map(DVec3::abs);
        let (most, sum) = (sizes[0].max(sizes[1]).max(sizes[2]), sizes[0] + sizes[1] + sizes[2]);
        let footprint = most.midpoint(sum) * pixels;
        // Optical depth of a pixel by a voxel at distance 1 with a depth of 1 per world unit.
        let area = view.half[0] * view.half[1] / (pixels * pixels);
        let unit = UNITS * step.element_product() / area;
        let far = (0..8_usize)
            .map(|corner| {
                let ends: [usize; 3] =
                    std::array::from_fn(|axis| if corner >> axis & 1 == 0 { low[axis] } else { high[axis] });
                place(ends).z
            })
            .fold(f64::MIN_POSITIVE, f64::max);
        let all = |content: u64| (0..whole(side * side)).map(|_| AtomicU64::new(content)).collect::<Vec<_>>();
        let found = Self { side: whole(side), depths: all(0), nearest: all(u64::MAX), far };
        let samples: [usize; 3] = std::array::from_fn(|axis| lines[axis].div_ceil(stride[axis]));
        // The march ends at the centres of the outermost voxels, so that half of them lies within.
        let within = |axis: usize, at: usize| {
            let end = count(lines[axis] - 1) / count(stride[axis]);
            if end < 1.0 { end / 2.0 } else { count(at).clamp(0.5, end - 0.5) }
        };
        let of_row = |[y, z]: [usize; 2], row: &mut Vec<f64>| {
            let first = low[0] + nx * (low[1] + y * stride[1] + ny * (low[2] + z * stride[2]));
            let start = origin + axes[1] * within(1, y) + axes[2] * within(2, z);
            let skipped = crossing(start, axes[0], inner, view.parallel);
            let [before, after] = skipped.map_or([samples[0]; 2], |[from, to]| {
                if to < 0.0 {
                    return [samples[0]; 2];
                }
                let from = whole(from.max(0.0).ceil()).min(samples[0]);
                [from, whole(to).saturating_add(1).clamp(from, samples[0])]
            });
            for range in [0..before, after..samples[0]] {
                values(volume, first + range.start * stride[0], stride[0], range.len(), row);
                for (x, &value) in range.zip(&*row) {
                    let index = first + x * stride[0];
                    let (here, extent) = of.extent(index, value, depth);
                    if here > 0.0 {
                        // A smaller or larger voxel.
                        let (size, place) = (2.0 * extent, start + axes[0] * within(0, x));
                        found.add(place, view.parallel, here * unit * size.powi(3), footprint * size, pixels);
                    }
                }
            }
        };
        (0..samples[2]).into_par_iter().for_each(|z| {
            let mut row = Vec::new();
            (0..samples[1]).for_each(|y| of_row([y, z], &mut row));
        });
        found
    }

    /// Adds a voxel to the pixels that its `footprint` at distance 1 covers.
    fn add(&self, seen: DVec3, parallel: bool, units: f64, footprint: DVec3, pixels: f64) {
        /// Optical depth that hides all behind it.
        const OPAQUE: f64 = 16.0;
        let by = if parallel { 1.0 } else { seen.z };
        if by <= 0.0 {
            return;
        }
        let last = count(self.side) - 1.0;
        let ends = |at: f64, width: f64| {
            let at = (at / by + FRAME) * pixels;
            // Pixels whose centre lies in the footprint, or the nearest one.
            let [first, end] = [(at - width / by / 2.0 - 0.5).ceil(), (at + width / by / 2.0 - 0.5).floor()];
            let covered = if first <= end { [first, end] } else { [at.floor(); 2] };
            // Beyond the frame, the pixels at its edge.
            covered.map(|pixel| whole(pixel.clamp(0.0, last)))
        };
        let ([left, right], [below, above]) = (ends(seen.x, footprint.x), ends(seen.y, footprint.y));
        let covered = count((right - left + 1) * (above - below + 1));
        let units = (units / (by * by * covered)).min(OPAQUE * UNITS);
        let nearest = ((seen.z - footprint.z / pixels / 2.0) / self.far).clamp(0.0, 1.0) * UNITS;
        let [units, nearest] = [units, nearest].map(|it| u64::from(unsigned(whole(it))));
        for y in below..=above {
            for pixel in y * self.side + left..=y * self.side + right {
                self.depths[pixel].fetch_add(units, Ordering::Relaxed);
                self.nearest[pixel].fetch_min(nearest, Ordering::Relaxed);
            }
        }
    }

    /// The visible pixels; `None` if there are none, or if an end of the picture lies in its `inner` part.
    fn silhouette(&self, view: &View, inner: [f64; 2]) -> Option<Silhouette> {
        let side = self.side;
        let number = |pixel: &AtomicU64| count(usize::try_from(pixel.load(Ordering::Relaxed)).unwrap_or(usize::MAX));
        let is_visible = |pixel: &usize| number(&self.depths[*pixel]) >= VISIBLE * UNITS;
        // The first and the last visible pixel of a line of pixels.
        let line_ends = |first: usize, step: usize| {
            let pixels = || (0..side).map(|at| first + at * step);
            Some([pixels().find(is_visible)?, pixels().rev().find(is_visible)?])
        };
        let rows = (0..side).filter_map(|y| line_ends(y * side, 1));
        let columns = (0..side).filter_map(|x| line_ends(x, side));
        let ends: Vec<usize> = rows.chain(columns).flatten().collect();
        let place = |pixel: usize| count(pixel) * 2.0 * FRAME / count(side) - FRAME;
        let mut is_whole = true;
        for (axis, inner) in inner.into_iter().enumerate() {
            let at = |pixel: &usize| [pixel % side, pixel / side][axis];
            let (first, last) = (ends.iter().map(at).min()?, ends.iter().map(at).max()?);
            is_whole &= first > 0 && last + 1 < side;
            if place(first) > -inner || place(last + 1) < inner {
                return None;
            }
        }
        let corners = |&pixel: &usize| {
            let depth = self.far * number(&self.nearest[pixel]) / UNITS;
            let there = view.eye + depth * view.forward;
            let corner = move |[x, y]: [usize; 2]| {
                let [x, y] = [place(pixel % side + x), place(pixel / side + y)];
                view.point_at(DVec2::new(1.0 + x, 1.0 - y) / 2.0, there)
            };
            [[0, 0], [1, 0], [0, 1], [1, 1]].map(corner)
        };
        Some(Silhouette { points: ends.iter().flat_map(corners).collect(), is_whole })
    }
}

/// Steps along `axis` from `start` between which a row lies in the `inner` part of the picture, in coordinates of
/// [`View::seen`].
fn crossing(start: DVec3, axis: DVec3, inner: DVec3, parallel: bool) -> Option<[f64; 2]> {
    let (by, by_step) = if parallel { (1.0, 0.0) } else { (start.z, axis.z) };
    let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
    for (at, step, limit) in [(start.x, axis.x, inner.x), (start.y, axis.y, inner.y)] {
        for sign in [-1.0, 1.0] {
            // Inside where room + step·room_step is above 0.
            let (room, room_step) = (limit * by + sign * at, limit * by_step + sign * step);
            if room_step > 0.0 {
                from = from.max(-room / room_step);
            } else if room_step < 0.0 {
                to = to.min(-room / room_step);
            } else if room <= 0.0 {
                return None;
            }
        }
    }
    (from < to).then_some([from, to])
}

/// Puts `number` values of `volume` from the voxel at `first`, every n-th by `step`, into `row`.
fn values(volume: &Volume, first: usize, step: usize, number: usize, row: &mut Vec<f64>) {
    row.clear();
    with_voxels!(&volume.voxels, stored => {
        let from = stored.get(first..).unwrap_or_default();
        row.extend(from.iter().step_by(step).take(number).map(|&it| Voxel::to_f64(it).mul_add(volume.slope, volume.intercept)));
    });
}

/// Distance from `target`, or with parallel rays half the height of the picture, at which `points` reach at most the
/// fraction `limit` of the way from the middle of the picture of `view` to its edges.
pub(super) fn reached_at(view: &View, target: DVec3, aspect: f64, points: &[DVec3], limit: f64) -> f64 {
    let of_point = |point: &DVec3| {
        let from_target = *point - target;
        let across = (from_target.dot(view.right).abs() / aspect).max(from_target.dot(view.up).abs()) / limit;
        if view.parallel { across } else { across / view.half[1] - from_target.dot(view.forward) }
    };
    points.par_iter().map(of_point).reduce(|| 0.0, f64::max)
}

/// Largest fraction of the way from the middle of the picture of `view` to its edges that `points` reach; infinite if one
/// lies behind the eye.
pub(super) fn reach(view: &View, points: &[DVec3]) -> f64 {
    let of_point = |point: &DVec3| {
        let seen = view.seen(*point);
        let by = if view.parallel { 1.0 } else { seen.z };
        if seen.z > 0.0 { seen.x.abs().max(seen.y.abs()) / by } else { f64::INFINITY }
    };
    points.par_iter().map(of_point).reduce(|| 0.0, f64::max)
}
