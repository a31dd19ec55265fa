//! Cameras that show the visible voxels as large as fits.

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::silhouette::{Ends, Seen};
use relume_base::number::{count, whole};
use relume_base::parallel;
use relume_scene::{Aim, Camera, Fill, LabelEntry, Projection, Scene, View};
use relume_volume::{Geometry, Volume, Voxel, coarse_index, with_voxels};

/// Fraction of the picture that its visible pixels span in their larger direction.
pub(super) const FILL: f64 = 0.9;
/// Fraction of the way to the edge of the picture that an end reaches at most, where the other reaches less.
const MOST: f64 = 0.94;
/// Aspect ratios for which a fit states its fill.
const ASPECTS: [f64; Fill::MOST] = [0.5, 0.625, 0.75, 0.875, 1.0, 1.15, 1.3333, 1.5, 1.7778, 2.4];
/// Rounds of a fit: steps of Newton's method for the distance, with one of the centre.
const ROUNDS: usize = 10;
/// Fits to the ends of a picture: more than one for objects that extend beyond its frame, each 1.4 times as wide.
const PASSES: usize = 8;
/// Cosine of the elevation below which the upright axis is nearly the line of sight.
const STEEP: f64 = 0.3;
/// Most rows of voxels that are searched for visible ones.
const ROWS: usize = 1 << 16;

/// World points around the first and the last visible voxel of every n-th row, n by `stride`, as far as these are corners of the
/// hull of their slice: the hull of all is that of all visible voxels, up to n − 1 voxels. A single visible voxel in a row is a
/// speck. `shows` is called with the index and the value of a voxel.
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
    let least = if high[0] - low[0] < 7 { 1 } else { 2 };
    let bodies = low[0]..(high[0] + 2).saturating_sub(least);
    let found: Vec<[(usize, usize, usize); 2]> = with_voxels!(&volume.voxels, stored => {
        let ends = |&[y, z]: &[usize; 2]| {
            let first = nx * (y + ny * z);
            let row = stored.get(first..first + nx)?;
            let seen = |x: usize| shows(first + x, Voxel::to_f64(row[x]) * volume.slope + volume.intercept);
            let body = |x: &usize| (*x..x + least).all(seen);
            let (left, right) = (bodies.clone().find(body)?, bodies.clone().rev().find(body)? + least - 1);
            Some([(left, y, z), (right, y, z)])
        };
        rows.par_iter().filter_map(ends).collect()
    });
    let of_slice = |rows: &[[(usize, usize, usize); 2]]| {
        let corners = [(0, -1.0), (1, 1.0)].map(|(end, outward)| {
            let corner = |row: &[(usize, usize, usize); 2]| {
                let (x, y, _) = row[end];
                [-0.5, 0.5].map(|half| DVec2::new(count(x) + outward / 2.0, count(y) + half))
            };
            outermost(rows.iter().flat_map(corner), outward)
        });
        let z = rows.first().map_or(0.0, |row| count(row[0].2));
        corners.concat().into_iter().flat_map(move |corner| [-0.5, 0.5].map(|half| corner.extend(z + half)))
    };
    let slices = found.chunk_by(|one, other| one[0].2 == other[0].2);
    slices.flat_map(of_slice).map(|index| volume.geometry.world_from_index(index)).collect()
}

/// Those of `points`, which ascend along y, that are corners of their convex hull towards `outward` along x: all others lie
/// between them, and can be no ends of a picture.
fn outermost(points: impl Iterator<Item = DVec2>, outward: f64) -> Vec<DVec2> {
    // Monotone chain (Andrew 1979).
    let mut corners: Vec<DVec2> = Vec::new();
    for point in points {
        while let [.., before, last] = corners[..]
            && outward * (point - before).perp_dot(last - before) >= 0.0
        {
            corners.pop();
        }
        corners.push(point);
    }
    corners
}

/// World points whose hull is that of the voxels of `scene` that its crop box, clip planes, transfer function and labels
/// show.
pub(super) fn visible(scene: &Scene) -> Vec<DVec3> {
    // Of voxels that stay in a file, those of a coarse level.
    let (volume, block) = scene.fields.first().at_hand();
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
    let declared: BTreeMap<i64, &LabelEntry> =
        scene.labels.iter().flat_map(|labels| &labels.declared).map(|entry| (entry.label, entry)).collect();
    let label = |index: usize| {
        let labels = scene.labels.as_ref()?;
        // That of the voxel in the middle of a block.
        let [x, y, z] = [index % nx, index / nx % ny, index / (nx * ny)];
        let dims = labels.volume.geometry.dims;
        let [x, y, z] =
            [(x, 0), (y, 1), (z, 2)].map(|(at, axis)| (at * block[axis] + block[axis] / 2).min(dims[axis] - 1));
        let label = labels.volume.label(x + dims[0] * (y + dims[1] * z))?;
        declared.get(&label).copied()
    };
    let is_clipped = scene.clip.in_force().next().is_some();
    let is_left = |index: usize| {
        let index = DVec3::from_array([index % nx, index / nx % ny, index / (nx * ny)].map(count));
        !is_clipped || !scene.clip.hides(0, volume.geometry.world_from_index(index))
    };
    let shows = |index: usize, value: f64| {
        let is_visible = match label(index) {
            Some(entry) if entry.terms.is_empty() => entry.is_visible(),
            Some(entry) => entry.terms.iter().any(|term| term.depth(value) > 0.0),
            None => by_value(value),
        };
        is_visible && is_left(index)
    };
    outline(volume, [1, step.min(lines(1).div_ceil(8)), step.min(lines(2).div_ceil(8))], crop, shows)
}

/// Ranges of values that a scene shows: where a term has at least 0.3 of its largest opacity or absorption. A term whose
/// optical depth across the whole volume is hardly visible shows nothing.
fn ranges(scene: &Scene) -> Vec<[f64; 2]> {
    const PART: f64 = 0.3;
    const HARDLY: f64 = 0.05;
    let lengths = scene.frame.geometry.extent().length() / scene.transfer.opacity_length;
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
            // Equal places are told apart by their depths.
            let outer = |[low, high]: [(f64, f64); 2], [left, right]: [(f64, f64); 2]| {
                [if left < low { left } else { low }, if right > high { right } else { high }]
            };
            points.iter().map(end).fold([(f64::INFINITY, 1.0), (f64::NEG_INFINITY, 1.0)], outer)
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
        points.iter().map(needs).fold(0.0, f64::max)
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
    let fill = parallel::map(ASPECTS.len(), &|aspect| {
        let aspect = ASPECTS[aspect];
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
    let Some(fill) = fewest(&valid) else { return camera.clone() };
    let around = Some([centre - half, centre + half]);
    Camera { aim: Aim::Orbit { azimuth, elevation, fill, front, around }, ..*camera }
}

/// The fill of the fewest of `pairs` that is that of all of them to a thousandth.
fn fewest(pairs: &[[f64; 2]]) -> Option<Fill> {
    const TOLERANCE: f64 = 1e-3;
    let kept = |kept: u32| {
        let kept: Vec<[f64; 2]> = (0..pairs.len()).filter(|at| kept >> at & 1 == 1).map(|at| pairs[at]).collect();
        let fill = Fill::by_aspect(&kept)?;
        let is_near = pairs.iter().all(|&[aspect, it]| (fill.at(aspect) - it).abs() <= TOLERANCE * it);
        is_near.then_some(fill)
    };
    (1_u32..1 << pairs.len()).filter_map(kept).min_by_key(|fill| fill.pairs().len())
}

/// The camera of the directions and the projection of `camera` that fits the visible pixels of its own picture of a volume.
/// `outline` are points around most of these voxels.
pub(super) fn framed(camera: &Camera, outline: &[DVec3], seen: &Seen<'_>) -> Camera {
    let geometry = seen.geometry();
    let mut found = fitted(camera, outline, outline, geometry);
    for _ in 0..PASSES {
        let Some(view) = found.view(geometry, 1.0) else { break };
        let Some(ends) = Ends::of(&view, found.aim.target(geometry), seen, outline) else { break };
        found = fitted(camera, &ends.points, outline, geometry);
        if ends.is_whole {
            break;
        }
    }
    found
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

#[cfg(test)]
#[expect(clippy::expect_used, reason = "a failed step fails the test")]
mod tests {
    use super::super::silhouette::Depths;
    use super::*;
    use relume_scene::Term;
    use relume_volume::Voxels;

    fn volume(dims: [usize; 3], value: impl Fn(DVec3) -> f32) -> Volume {
        let geometry = Geometry::new("test", dims, DVec3::ONE, DVec3::ZERO, glam::DMat3::IDENTITY);
        let [nx, ny, _] = dims;
        let place = |index: usize| DVec3::from_array([index % nx, index / nx % ny, index / (nx * ny)].map(count));
        let voxels = Voxels::F32((0..dims.iter().product()).map(|index| value(place(index))).collect());
        Volume::new("test", voxels, geometry.expect("a box is a grid")).expect("as many voxels as the grid has")
    }

    /// Frame of the camera that fits the values from 1 on, which has a field of view of 30°.
    fn framed(volume: &Volume) -> View {
        let front = DVec3::NEG_Y;
        let aim = Aim::Orbit { azimuth: 0.0, elevation: 0.0, fill: Fill::of(1.0), front, around: None };
        let camera = Camera { projection: Projection::Perspective { fov_degrees: 30.0 }, aim, up: DVec3::Z };
        let depths = Depths::of(&[Term::interval(0, [1.0, 9.0], 0.0, 0.5, 0.0)], 1.0);
        let points = outline(volume, [2; 3], None, |_, value| value >= 1.0);
        let found = super::framed(&camera, &points, &Seen::new(volume, None, true, depths));
        found.view(&volume.geometry, 1.0).expect("it has a line of sight")
    }

    /// Of the fit, beside pixels of 0.005 of a half picture and the curvature of values between voxels.
    const TOLERANCE: f64 = 0.01;

    #[test]
    fn an_outline_reaches_as_far_as_all_visible_voxels_with_few_points() {
        let dims = [40, 31, 9];
        // Rows of two voxels and more.
        let ends = |y: usize, z: usize| [(7 * y + 11 * z) % 19, 21 + (5 * y + 3 * z) % 18];
        let is_visible = |[x, y, z]: [usize; 3]| (y + z) % 4 > 0 && (ends(y, z)[0]..=ends(y, z)[1]).contains(&x);
        let scan = volume(dims, |place| f32::from(u8::from(is_visible(place.to_array().map(whole)))));
        let outline = outline(&scan, [1; 3], None, |_, value| value > 0.5);
        let mut corners = Vec::new();
        for index in 0..scan.geometry.voxels() {
            let at = [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
            let corner = |corner: usize| [0, 1, 2].map(|axis| count(at[axis]) + [-0.5, 0.5][corner >> axis & 1]);
            corners.extend(if is_visible(at) { 0..8 } else { 0..0 }.map(|it| DVec3::from_array(corner(it))));
        }
        assert!(20 * outline.len() < corners.len(), "{} of {} corners", outline.len(), corners.len());
        for turn in 0..500 {
            let (about, height) = (0.377 * f64::from(turn), f64::from(turn % 21) / 10.0 - 1.0);
            let direction = DVec3::new(about.cos(), about.sin(), height);
            let reach = |points: &[DVec3]| points.iter().map(|it| it.dot(direction)).fold(f64::MIN, f64::max);
            let [found, expected] = [&outline, &corners].map(|points| reach(points));
            assert!((found - expected).abs() < 1e-9, "{direction}: {found}, expected {expected}");
        }
    }

    #[test]
    fn a_ball_ends_where_its_interpolated_values_do() {
        // Values fall by 1 in 3 voxels: the ball ends at the radius 10.3.
        let radius = 10.3;
        let middle = DVec3::splat(23.5);
        let ball = volume([48; 3], |place| relume_base::number::rounded(1.0 + (radius - place.distance(middle)) / 3.0));
        // The tangent from the eye to the ball reaches 0.9 of the way to the edge.
        let tangent = 0.9 * 15_f64.to_radians().tan();
        let distance = radius / tangent.atan().sin();
        let found = framed(&ball).eye.distance(middle);
        assert!((found / distance - 1.0).abs() <= TOLERANCE, "{found}, expected {distance}");
    }

    #[test]
    fn a_vessel_that_a_thinned_volume_lacks_is_in_the_picture() {
        let middle = DVec3::new(60.0, 60.0, 60.0);
        let tip = 151.0;
        let scan = volume([160, 120, 120], |place| {
            let is_vessel = (place.y - 61.0).abs().max((place.z - 61.0).abs()) < 0.5 && (60.0..=tip).contains(&place.x);
            if is_vessel || place.distance(middle) < 15.0 { 2.0 } else { 0.0 }
        });
        // Values of at least 1 reach half a voxel further.
        let reach = reach(&framed(&scan), &[DVec3::new(tip + 0.5, 61.0, 61.0)]);
        assert!((reach / 0.9 - 1.0).abs() <= TOLERANCE, "{reach}");
    }

    #[test]
    fn a_fill_has_no_more_pairs_than_it_needs() {
        let pairs = |pairs: &[[f64; 2]]| fewest(pairs).map(|fill| fill.pairs().to_vec()).unwrap_or_default();
        assert_eq!(pairs(&[[0.5, 1.2], [1.0, 1.2007], [2.0, 1.2]]), [[0.5, 1.2]]);
        assert_eq!(pairs(&[[0.5, 1.0], [1.0, 1.5], [1.5, 2.0], [2.0, 2.0]]), [[0.5, 1.0], [1.5, 2.0]]);
        assert_eq!(pairs(&[[0.5, 1.0], [1.0, 1.01], [1.5, 1.0]]), [[0.5, 1.0], [1.0, 1.01], [1.5, 1.0]]);
    }
}
