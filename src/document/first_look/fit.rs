//! The camera that shows the visible voxels upright, and as large as fits.

use glam::DVec3;

use super::sample::Thinned;
use crate::number::count;
use crate::scene::{Aim, Camera, Projection};
use crate::volume::Geometry;

/// Fraction of a square picture that the visible voxels span in their larger direction.
pub(super) const FILL: f64 = 0.9;
/// Vertical field of view, in degrees.
const FOV_DEGREES: f64 = 30.0;
/// Rounds of the fit, each of which corrects centre and distance.
const ROUNDS: usize = 30;

/// Marks the visible voxels of `thinned`, without specks.
pub(super) fn visible(thinned: &Thinned, shows: impl Fn(f32) -> bool) -> Vec<bool> {
    /// Visible neighbours of a voxel that is no speck.
    const ENOUGH: usize = 3;
    let all: Vec<bool> = thinned.values.iter().map(|&value| shows(value)).collect();
    let enough = if thinned.dims.iter().any(|&side| side < 8) { 0 } else { ENOUGH };
    let is_kept = |place: usize| all[place] && thinned.neighbours(place).filter(|&it| all[it]).count() >= enough;
    let kept: Vec<bool> = (0..all.len()).map(is_kept).collect();
    if kept.contains(&true) { kept } else { all }
}

/// World positions of the first and the last visible voxel of each row: their hull is that of all visible voxels.
fn outline(thinned: &Thinned, visible: &[bool], geometry: &Geometry) -> Vec<DVec3> {
    let nx = thinned.dims[0];
    let world = |place: usize, end: f64| {
        let index = DVec3::from_array(std::array::from_fn(|axis| {
            count(thinned.position(place)[axis] * thinned.stride[axis])
        }));
        geometry.world_from_index(index + DVec3::X * end)
    };
    let ends = |(row, voxels): (usize, &[bool])| {
        let first = voxels.iter().position(|&seen| seen)?;
        let last = voxels.iter().rposition(|&seen| seen)?;
        Some([world(row * nx + first, -0.5), world(row * nx + last, 0.5)])
    };
    visible.chunks(nx).enumerate().filter_map(ends).flatten().collect()
}

/// The camera of the directions of `camera` that shows `visible` in the middle of the picture; `camera` itself if
/// nothing is visible.
pub(super) fn fitted(camera: &Camera, thinned: &Thinned, visible: &[bool], geometry: &Geometry) -> Camera {
    let points = outline(thinned, visible, geometry);
    let (Aim::Orbit { azimuth, elevation, front, .. }, Some(view)) = (camera.aim, camera.view(geometry, 1.0)) else {
        return camera.clone();
    };
    let (Some(low), Some(high)) = (points.iter().copied().reduce(DVec3::min), points.iter().copied().reduce(DVec3::max))
    else {
        return camera.clone();
    };
    // A single row of voxels has a thickness too.
    let half = ((high - low) / 2.0).max(DVec3::splat(geometry.spacing.min_element() / 2.0));
    let tangent = (FOV_DEGREES / 2.0).to_radians().tan();
    let (mut centre, mut distance) = ((low + high) / 2.0, 2.0 * half.length() / tangent);
    for _ in 0..ROUNDS {
        let mut bounds = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for point in &points {
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
    if best.0 == 0 || count(outside) < WORTH * count(all) {
        return None;
    }
    let low = std::array::from_fn(|axis| (low[axis] * thinned.stride[axis]).saturating_sub(thinned.stride[axis]));
    let high = std::array::from_fn(|axis| ((high[axis] + 1) * thinned.stride[axis]).min(dims[axis] - 1));
    (0..3).all(|axis| dims[axis] == 1 || low[axis] < high[axis]).then_some([low, high])
}
