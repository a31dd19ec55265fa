//! Cameras that show the visible voxels as large as fits.

use glam::DVec3;
use rayon::prelude::*;

use crate::number::{count, nearest, whole};
use crate::scene::{Aim, Camera, Projection, Scene, View};
use crate::volume::{Geometry, Volume, coarse_index};

/// Fraction of the picture that the visible voxels span in their larger direction.
pub(super) const FILL: f64 = 0.9;
/// Rounds of the fit, each of which corrects the centre, and of that of the box.
const ROUNDS: usize = 16;
/// Aspect ratios beside 1 at which the box of a fit is compared with its points, each with the weight of the difference there. A
/// box fits wide pictures nearly exactly, and not all upright ones as well.
const ASPECTS: [(f64, f64); 5] = [(0.5, 0.3), (0.67, 0.3), (0.75, 0.3), (1.33, 1.0), (1.78, 1.0)];
/// Steps of the logarithms of the sides of a box.
const COARSEST: f64 = 0.25;
const FINEST: f64 = 1e-3;
/// Misfit of a box whose sides differ from those of the points by a factor of e.
const SHAPE: f64 = 2e-3;
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

/// The camera of the directions and the projection of `camera` that shows `points` in the middle of the picture; `camera`
/// itself if there are none. Its box is such that [`FILL`] of it is [`FILL`] of the points in width and in height, so that
/// they fit pictures of every aspect ratio.
pub(super) fn fitted(camera: &Camera, points: &[DVec3], geometry: &Geometry) -> Camera {
    let (Aim::Orbit { azimuth, elevation, front, .. }, Some(view)) = (camera.aim, camera.view(geometry, 1.0)) else {
        return camera.clone();
    };
    let (Some(low), Some(high)) =
        (points.iter().copied().reduce(DVec3::min), points.iter().copied().reduce(DVec3::max))
    else {
        return camera.clone();
    };
    let half = (high - low) / 2.0;
    let [size, near] = scales(camera.projection);
    let sides = [view.right, view.up];
    let farthest = |centre: DVec3| {
        let [width, height] = distance_for(points, centre, &view, [size * FILL; 2], near);
        width.max(height)
    };
    let mut centre = (low + high) / 2.0;
    // Steps along the upright axis keep it in the middle of the points when the camera turns about it.
    let upright = camera.up.normalize_or_zero();
    let rise = upright.dot(view.up);
    let lift = if rise > STEEP { upright / rise } else { view.up };
    for _ in 0..ROUNDS {
        let distance = farthest(centre);
        // The ends of the picture as place and depth, and the step after which they are equally far from the middle.
        let step = sides.map(|side| {
            let end = |point: &DVec3| {
                let from_centre = *point - centre;
                let depth = (distance + near * from_centre.dot(view.forward)).max(1e-3 * distance);
                (from_centre.dot(side) / depth, depth)
            };
            let of_point = |point: &DVec3| [end(point); 2];
            // Equal places are told apart by their depths, so that the order of the threads does not matter.
            let outer = |[low, high]: [(f64, f64); 2], [left, right]: [(f64, f64); 2]| {
                [if left < low { left } else { low }, if right > high { right } else { high }]
            };
            let none = || [(f64::INFINITY, 1.0), (f64::NEG_INFINITY, 1.0)];
            let [low, high] = points.par_iter().map(of_point).reduce(none, outer);
            (low.0 + high.0) / (low.1.recip() + high.1.recip())
        });
        centre += step[0] * view.right + step[1] * lift;
    }
    // The distance at which the points, or a box around the centre, fill a picture of this aspect ratio.
    let of_points = |aspect: f64| distance_for(points, centre, &view, [size * aspect * FILL, size * FILL], near);
    let of_box = |half: DVec3, aspect: f64| {
        let corners: Vec<DVec3> = (0..8).map(|corner| centre + half * sign_of(corner)).collect();
        distance_for(&corners, centre, &view, [size * aspect * FILL, size * FILL], near)
    };
    let distance = farthest(centre);
    let wanted = ASPECTS.map(|(aspect, weight)| (aspect, weight, larger(of_points(aspect))));
    // Largest difference between the distances of box and points in other pictures, where both are equal in a square one; a
    // little more for a box of another shape.
    let misfit = |box_half: DVec3| {
        let square = larger(of_box(box_half, 1.0)) / distance;
        let of_aspect = |&(aspect, weight, wanted): &(f64, f64, f64)| {
            weight * (larger(of_box(box_half, aspect)) / (wanted * square)).ln().abs()
        };
        let shape = (box_half / half).map(f64::ln);
        let shape = (shape - DVec3::splat(shape.element_sum() / 3.0)).length_squared();
        SHAPE.mul_add(shape, wanted.iter().map(of_aspect).fold(0.0, f64::max))
    };
    // Steps to the best neighbour in a grid of ratios, which becomes finer where there is none.
    let mut fitting = (half, misfit(half));
    let mut step = COARSEST;
    while step > FINEST {
        let neighbour = |place: usize| {
            let exponents = [place % 3, place / 3 % 3, place / 9].map(|it| count(it) - 1.0);
            let one = fitting.0 * DVec3::from_array(exponents.map(|it| (step * it).exp()));
            (one, misfit(one))
        };
        let best = (0..27).map(neighbour).min_by(|one, other| one.1.total_cmp(&other.1));
        match best.filter(|best| best.1 < fitting.1) {
            Some(best) => fitting = best,
            None => step /= 2.0,
        }
    }
    let fitting = fitting.0 * (distance / larger(of_box(fitting.0, 1.0)));
    let fitting = if fitting.is_finite() && fitting.max_element() > 0.0 { fitting } else { half };
    Camera {
        projection: camera.projection,
        aim: Aim::Orbit { azimuth, elevation, fill: FILL, front, around: Some([centre - fitting, centre + fitting]) },
        up: camera.up,
    }
}

/// Signs of the coordinates of a corner, from 0 to 7.
fn sign_of(corner: u32) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|axis| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 }))
}

fn larger([one, other]: [f64; 2]) -> f64 {
    one.max(other)
}

/// Distances from `centre` along the line of sight of `view` at which `points` reach `limits` of the width and the height at
/// distance 1; nearer points reach farther by `near`.
fn distance_for(points: &[DVec3], centre: DVec3, view: &View, limits: [f64; 2], near: f64) -> [f64; 2] {
    let of_point = |point: &DVec3| {
        let from_centre = *point - centre;
        let depth = near * from_centre.dot(view.forward);
        [from_centre.dot(view.right).abs() / limits[0] - depth, from_centre.dot(view.up).abs() / limits[1] - depth]
    };
    let farther = |one: [f64; 2], other: [f64; 2]| [one[0].max(other[0]), one[1].max(other[1])];
    points.par_iter().map(of_point).reduce(|| [0.0; 2], farther)
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
