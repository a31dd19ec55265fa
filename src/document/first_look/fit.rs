//! The camera that shows the visible voxels upright, and as large as fits.

use glam::DVec3;
use rayon::prelude::*;

use super::sample::Thinned;
use crate::number::count;
use crate::scene::{Aim, Camera, Projection};
use crate::volume::{Geometry, Volume};

/// Fraction of a square picture that the visible voxels span in their larger direction.
pub(super) const FILL: f64 = 0.9;
/// Vertical field of view, in degrees.
const FOV_DEGREES: f64 = 30.0;
/// Rounds of the fit, each of which corrects centre and distance.
const ROUNDS: usize = 16;

/// World positions around the first and the last visible voxel of every n-th row: their hull is that of all visible
/// voxels, up to n − 1 voxels. A single visible voxel in a row is a speck.
pub(super) fn outline(
    volume: &Volume,
    stride: [usize; 3],
    crop: Option<[[usize; 3]; 2]>,
    shows: impl Fn(f64) -> bool + Sync,
) -> Vec<DVec3> {
    let [nx, ny, nz] = volume.geometry.dims;
    let [low, high] = crop.unwrap_or([[0; 3], [nx - 1, ny - 1, nz - 1]]);
    let lines = |axis: usize| (low[axis]..=high[axis]).step_by(stride[axis]);
    let rows: Vec<[usize; 2]> = lines(2).flat_map(|z| lines(1).map(move |y| [y, z])).collect();
    let least = if nx < 8 { 1 } else { 2 };
    let ends = |&[y, z]: &[usize; 2]| {
        let first = nx * (y + ny * z);
        let seen = |x: usize| {
            volume.voxels.value(first + x).is_some_and(|it| shows(it.mul_add(volume.slope, volume.intercept)))
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

/// The camera of the directions of `camera` that shows `points` in the middle of the picture; `camera` itself if there
/// are none.
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
    let tangent = (FOV_DEGREES / 2.0).to_radians().tan();
    let (mut centre, mut distance) = ((low + high) / 2.0, 2.0 * half.length() / tangent);
    for _ in 0..ROUNDS {
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for point in points {
            let from_centre = *point - centre;
            let depth = (distance + from_centre.dot(view.forward)).max(1e-3 * distance);
            for (bounds, along) in bounds.iter_mut().zip([view.right, view.up]) {
                let place = from_centre.dot(along) / depth;
                *bounds = [bounds[0].min(place), bounds[1].max(place)];
            }
        }
        let middle = bounds.map(|[low, high]| f64::midpoint(low, high));
        let span = bounds.map(|[low, high]| high - low);
        centre += distance * (middle[0] * view.right + middle[1] * view.up);
        let wanted = 2.0 * tangent * FILL;
        distance = (distance * span[0].max(span[1]) / wanted).max(1.1 * half.length());
    }
    let around = Some([centre - half, centre + half]);
    let of_fill = |fill: f64| Camera {
        projection: Projection::Perspective { fov_degrees: FOV_DEGREES },
        aim: Aim::Orbit { azimuth, elevation, fill, front, around },
        up: camera.up,
    };
    let reached = |fill: f64| of_fill(fill).view(geometry, 1.0).map_or(0.0, |view| view.eye.distance(centre));
    // A larger fill is a smaller distance.
    let (mut low, mut high) = (0.05, 20.0);
    for _ in 0..60 {
        let fill = f64::midpoint(low, high);
        if reached(fill) > distance { low = fill } else { high = fill }
    }
    let fill = format!("{:.4}", f64::midpoint(low, high)).parse().unwrap_or(1.0);
    of_fill(fill)
}

/// Smallest and largest index of the voxels of the volume around the largest connected part of `body`, if other parts
/// are left out by this box.
pub(super) fn largest_part(thinned: &Thinned, body: &[bool], dims: [usize; 3]) -> Option<[[usize; 3]; 2]> {
    /// Fraction of the voxels of the body above which parts outside the box are worth a crop.
    const WORTH: f64 = 0.002;
    /// Fraction of the largest part above which the others are no table: both feet, for instance.
    const BODY: f64 = 0.25;
    let mut part = vec![0_u32; body.len()];
    let (mut number, mut best, mut all) = (0, (0, 0), 0);
    let mut open = Vec::new();
    for place in 0..body.len() {
        if !body[place] || part[place] > 0 {
            continue;
        }
        number += 1;
        part[place] = number;
        open.push(place);
        let mut size = 0;
        while let Some(place) = open.pop() {
            size += 1;
            for next in thinned.neighbours(place) {
                if body[next] && part[next] == 0 {
                    part[next] = number;
                    open.push(next);
                }
            }
        }
        all += size;
        best = best.max((size, number));
    }
    let [mut low, mut high] = [[usize::MAX; 3], [0; 3]];
    for place in (0..part.len()).filter(|&place| best.0 > 0 && part[place] == best.1) {
        for (axis, index) in thinned.position(place).into_iter().enumerate() {
            low[axis] = low[axis].min(index);
            high[axis] = high[axis].max(index);
        }
    }
    let is_outside = |place: &usize| {
        let position = thinned.position(*place);
        body[*place] && (0..3).any(|axis| position[axis] < low[axis] || position[axis] > high[axis])
    };
    let outside = (0..body.len()).filter(is_outside).count();
    if best.0 == 0 || count(outside) < WORTH * count(all) || count(outside) > BODY * count(best.0) {
        return None;
    }
    let low = std::array::from_fn(|axis| (low[axis] * thinned.stride[axis]).saturating_sub(thinned.stride[axis]));
    let high = std::array::from_fn(|axis| ((high[axis] + 1) * thinned.stride[axis]).min(dims[axis] - 1));
    (0..3).all(|axis| dims[axis] == 1 || low[axis] < high[axis]).then_some([low, high])
}
