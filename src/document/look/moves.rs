//! Camera movements around the volume.

use glam::{DQuat, DVec3};

use super::fit;
use relume_scene::{Aim, Camera, Fill, Projection, Scene, View};
use relume_volume::Geometry;

/// A movement of the camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Move {
    /// Rotation about the target, in degrees to the right and up.
    Orbit {
        /// To the right.
        right: f64,
        /// Up; stops short of the poles.
        up: f64,
    },
    /// Translation, in picture heights to the right and up.
    Pan {
        /// To the right.
        right: f64,
        /// Up.
        up: f64,
    },
    /// Approach: the target appears this many times as large.
    Dolly(f64),
    /// Rotation in degrees clockwise about the line of sight.
    Roll(f64),
    /// View from this side of the volume, with all of it in view, or for a first look all visible voxels.
    Axis(Side),
    /// Changes between perspective and parallel rays; the target keeps its size.
    Projection,
    /// The camera as opened.
    Reset,
}

/// A side of the volume, along the axes of the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "named for the axis it lies on")]
pub enum Side {
    Left,
    Right,
    Front,
    Back,
    Bottom,
    Top,
}

impl Side {
    /// All sides.
    pub const ALL: [Self; 6] = [Self::Left, Self::Right, Self::Front, Self::Back, Self::Bottom, Self::Top];

    /// Unit vector from the volume towards this side.
    #[must_use]
    pub fn outward(self) -> DVec3 {
        match self {
            Self::Left => DVec3::NEG_X,
            Self::Right => DVec3::X,
            Self::Front => DVec3::NEG_Y,
            Self::Back => DVec3::Y,
            Self::Bottom => DVec3::NEG_Z,
            Self::Top => DVec3::Z,
        }
    }
}

/// Field of view of a camera that had none, in degrees.
const USUAL_DEGREES: f64 = 30.0;
/// Fraction of the picture from which a camera is nearer than one that fits.
const NEARER: f64 = 0.95;
/// Largest elevation of an orbiting camera, in degrees.
const STEEPEST: f64 = 89.5;

/// A camera in world coordinates.
struct Placed {
    eye: DVec3,
    target: DVec3,
    up: DVec3,
    /// Half the height of the picture at the target.
    half: f64,
}

/// Returns the camera of `scene` after `step`, for a picture of `width / height = aspect`. `opened` is the initial camera,
/// and replaces a result that has no line of sight.
#[must_use]
pub fn moved(scene: &Scene, opened: &Camera, aspect: f64, step: Move) -> Camera {
    let (camera, geometry) = (&scene.camera, &scene.frame.geometry);
    let stated = match step {
        Move::Reset => None,
        Move::Axis(side) => {
            let stated = from_side(camera, opened, side);
            // The camera of a first look fits the visible voxels, others the whole volume.
            let is_fitted = matches!(stated.aim, Aim::Orbit { around: Some(_), .. });
            Some(if is_fitted {
                let visible = fit::visible(scene);
                fit::fitted(&stated, &visible, &visible, geometry)
            } else {
                stated
            })
        }
        step => go(camera, geometry, aspect, step),
    };
    stated.filter(|camera| camera.view(geometry, aspect).is_some()).unwrap_or_else(|| opened.clone())
}

/// Cameras of `frames` pictures of a full turn of `scene` about the up direction, from `camera` on. All have the same
/// distance or, with parallel rays, the same height, so that nothing grows: at least that of `camera`, and so large that the
/// visible voxels, if `camera` shows all of them, never leave the picture or come nearer to its edges than `camera` shows them
/// or a first look does. A stated height of parallel rays is kept. `None` if `camera` has no line of sight.
#[must_use]
pub fn turntable(scene: &Scene, camera: &Camera, aspect: f64, frames: u16) -> Option<Vec<Camera>> {
    let geometry = &scene.frame.geometry;
    let target = camera.aim.target(geometry);
    let axis = camera.up.try_normalize()?;
    let turned = |frame: u16| {
        let degrees = 360.0 * f64::from(frame) / f64::from(frames);
        let aim = match camera.aim {
            Aim::Orbit { azimuth, elevation, fill, front, around } => {
                Aim::Orbit { azimuth: azimuth + degrees, elevation, fill, front, around }
            }
            Aim::LookAt { position, target } => {
                let turn = DQuat::from_axis_angle(axis, degrees.to_radians());
                Aim::LookAt { position: target + turn * (position - target), target }
            }
        };
        Camera { aim, ..camera.clone() }.view(geometry, aspect)
    };
    let views: Vec<_> = (0..frames).map(turned).collect::<Option<_>>()?;
    let first = camera.view(geometry, aspect)?;
    let visible = fit::visible(scene);
    let reach = fit::reach(&first, &visible);
    let is_stated = matches!(camera.projection, Projection::Orthographic { height: Some(_) });
    // A camera that shows a part of the visible voxels keeps its distance.
    let needed = if reach > 1.0 || is_stated {
        0.0
    } else {
        // A fitted view may lie a little to one side.
        let limit = if reach > NEARER { reach } else { fit::FILL };
        views.iter().map(|view| fit::reached_at(view, target, aspect, &visible, limit)).fold(0.0, f64::max)
    };
    let (stated, half) = ((target - first.eye).dot(first.forward), first.half[1]);
    let distance = if first.parallel { stated } else { stated.max(needed) };
    let projection = match camera.projection {
        Projection::Orthographic { .. } => Projection::Orthographic { height: Some(2.0 * half.max(needed)) },
        perspective @ Projection::Perspective { .. } => perspective,
    };
    let placed = |view: &View| Camera {
        projection,
        aim: Aim::LookAt { position: target - distance * view.forward, target },
        up: camera.up,
    };
    Some(views.iter().map(placed).collect())
}

/// Degrees between the rows of [`around`].
const ROW_DEGREES: f64 = 25.0;

/// Cameras of `columns` by `rows` views about `scene`, row by row from the top, for pictures of `width / height = aspect`. All see the
/// volume at one size. `None` if the camera has no line of sight.
#[must_use]
pub fn around(scene: &Scene, aspect: f64, [columns, rows]: [u16; 2]) -> Option<Vec<Camera>> {
    let row = |row: u16| {
        let up = ROW_DEGREES * (f64::from(rows / 2) - f64::from(row));
        let raised = match row == rows / 2 {
            true => scene.camera.clone(),
            false => moved(scene, &scene.camera, aspect, Move::Orbit { right: 0.0, up }),
        };
        turntable(scene, &raised, aspect, columns)
    };
    let mut all: Vec<Camera> = (0..rows).map(row).collect::<Option<Vec<_>>>()?.concat();
    let distance = |camera: &Camera| match camera.aim {
        Aim::LookAt { position, target } => position.distance(target),
        Aim::Orbit { .. } => 0.0,
    };
    let far = all.iter().map(distance).fold(0.0, f64::max);
    let tall = all.iter().filter_map(|camera| match camera.projection {
        Projection::Orthographic { height } => height,
        Projection::Perspective { .. } => None,
    });
    let tall = tall.fold(0.0, f64::max);
    for camera in &mut all {
        if let Aim::LookAt { position, target } = &mut camera.aim {
            *position = *target + (*position - *target).normalize_or_zero() * far;
        }
        if let Projection::Orthographic { height } = &mut camera.projection {
            *height = height.map(|_| tall);
        }
    }
    Some(all)
}

fn from_side(camera: &Camera, opened: &Camera, side: Side) -> Camera {
    let front = side.outward();
    let level = opened.up.try_normalize().is_some_and(|up| up.dot(front).abs() < 0.9);
    let up = if level {
        opened.up
    } else if front.z == 0.0 {
        DVec3::Z
    } else {
        DVec3::NEG_Y
    };
    let around = if let Aim::Orbit { around, .. } = opened.aim { around } else { None };
    let projection = match camera.projection {
        Projection::Orthographic { .. } => Projection::Orthographic { height: None },
        perspective @ Projection::Perspective { .. } => perspective,
    };
    Camera { projection, aim: Aim::Orbit { azimuth: 0.0, elevation: 0.0, fill: Fill::of(1.0), front, around }, up }
}

fn go(camera: &Camera, geometry: &Geometry, aspect: f64, step: Move) -> Option<Camera> {
    let view = camera.view(geometry, aspect)?;
    let target = camera.aim.target(geometry);
    let distance = (target - view.eye).dot(view.forward);
    let half = if view.parallel { view.half[1] } else { view.half[1] * distance };
    let (right, axis) = (view.right, camera.up.try_normalize()?);
    let placed = Placed { eye: view.eye, target, up: axis, half };
    let around = |turn: DQuat, up: DVec3| Placed { eye: target + turn * (view.eye - target), up, ..placed };
    let projection = match (step, camera.projection) {
        (Move::Projection, Projection::Perspective { .. }) => Projection::Orthographic { height: None },
        (Move::Projection, Projection::Orthographic { .. }) => Projection::Perspective { fov_degrees: USUAL_DEGREES },
        (_, projection) => projection,
    };
    let placed = match step {
        Move::Orbit { right: degrees, up } => {
            let elevation = view.forward.dot(-axis).clamp(-1.0, 1.0).asin().to_degrees();
            let raised = (elevation + up).clamp(-STEEPEST, STEEPEST) - elevation;
            let turn = DQuat::from_axis_angle(axis, degrees.to_radians())
                * DQuat::from_axis_angle(right, -raised.to_radians());
            around(turn, axis)
        }
        Move::Pan { right: across, up: along } => {
            let by = 2.0 * half * (across * view.right + along * view.up);
            Placed { eye: view.eye - by, target: target - by, ..placed }
        }
        Move::Dolly(closer) => {
            let closer = closer.clamp(0.01, 100.0);
            Placed { eye: target + (view.eye - target) / closer, half: half / closer, ..placed }
        }
        Move::Roll(degrees) => {
            Placed { up: DQuat::from_axis_angle(view.forward, -degrees.to_radians()) * axis, ..placed }
        }
        Move::Projection if view.parallel => {
            let tangent = (USUAL_DEGREES / 2.0).to_radians().tan();
            Placed { eye: target - half / tangent * view.forward, ..placed }
        }
        _ => placed,
    };
    let projection = match projection {
        Projection::Orthographic { .. } => Projection::Orthographic { height: Some(2.0 * placed.half) },
        perspective @ Projection::Perspective { .. } => perspective,
    };
    let aim = Aim::LookAt { position: placed.eye, target: placed.target };
    let finite = placed.eye.is_finite() && placed.target.is_finite() && placed.up.is_finite();
    finite.then_some(Camera { projection, aim, up: placed.up })
}

#[cfg(test)]
mod tests {
    #![expect(clippy::expect_used, reason = "a test fails by panicking")]
    use std::sync::Arc;

    use super::*;
    use relume_scene::Term;
    use relume_volume::{Volume, Voxels};

    /// A block of 8 by 30 by 4 voxels towards a corner of a dark volume.
    fn block() -> Scene {
        let dims = [40, 44, 20];
        let inside = |index: usize| {
            let [x, y, z] = [index % 40, index / 40 % 44, index / 1760];
            (30..38).contains(&x) && (10..40).contains(&y) && (2..6).contains(&z)
        };
        let voxels = Voxels::U8((0..dims.iter().product()).map(|index| u8::from(inside(index)) * 200).collect());
        let geometry = Geometry::new("block", dims, DVec3::ONE, DVec3::ZERO, glam::DMat3::IDENTITY);
        let volume =
            Volume::new("block", voxels, geometry.expect("a box is a grid")).expect("as many voxels as the grid has");
        let mut scene = Scene::new("block", Arc::new(volume));
        scene.transfer.terms.push(Term::interval(0, [100.0, 255.0], 0.0, 0.5, 0.0));
        scene
    }

    /// Ends of the picture of the block in width and height, in half pictures from the middle.
    fn ends(view: &View) -> [[f64; 2]; 2] {
        let corner = |index: usize| {
            let at = |axis: usize, ends: [f64; 2]| ends[index >> axis & 1];
            let point = DVec3::new(at(0, [29.5, 37.5]), at(1, [9.5, 39.5]), at(2, [1.5, 5.5]));
            2.0 * view.place_of(point).expect("the block lies before the eye") - 1.0
        };
        let corners: Vec<glam::DVec2> = (0..8).map(corner).collect();
        [0, 1].map(|axis| {
            let places = corners.iter().map(|place| place[axis]);
            [places.clone().fold(f64::INFINITY, f64::min), places.fold(f64::NEG_INFINITY, f64::max)]
        })
    }

    const PROJECTIONS: [Projection; 2] =
        [Projection::Perspective { fov_degrees: 30.0 }, Projection::Orthographic { height: None }];

    #[test]
    fn a_side_view_shows_the_visible_voxels_at_nine_tenths_of_pictures_of_any_shape() {
        let mut scene = block();
        for (projection, aspect) in
            PROJECTIONS.into_iter().flat_map(|projection| [0.5, 1.0, 1.5, 2.5].map(|aspect| (projection, aspect)))
        {
            for side in Side::ALL {
                let around = Some([DVec3::ZERO, DVec3::splat(20.0)]);
                let aim =
                    Aim::Orbit { azimuth: 0.0, elevation: 15.0, fill: Fill::of(0.9), front: DVec3::NEG_Y, around };
                scene.camera = Camera { projection, aim, up: DVec3::Z };
                let camera = moved(&scene, &scene.camera, aspect, Move::Axis(side));
                let view = camera.view(&scene.frame.geometry, aspect).expect("it has a line of sight");
                let spans = ends(&view).map(|[low, high]| (high - low) / 2.0);
                let (span, wanted) = (spans[0].max(spans[1]), 0.9);
                assert!((span / wanted - 1.0).abs() <= 0.02, "{side:?}, {projection:?}, {aspect}: {spans:?}");
                let reach = ends(&view).concat().into_iter().map(f64::abs).fold(0.0, f64::max);
                assert!(reach < 0.95, "{side:?}, {projection:?}, {aspect}: {:?}", ends(&view));
            }
        }
    }

    #[test]
    fn a_turntable_keeps_its_distance_and_its_widest_view_fits() {
        let scene = block();
        let geometry = &scene.frame.geometry;
        for (projection, aspect) in
            PROJECTIONS.into_iter().flat_map(|projection| [0.7, 1.0, 1.5].map(|aspect| (projection, aspect)))
        {
            // The first view is the narrow side of the block.
            let narrow = Camera {
                projection,
                aim: Aim::Orbit {
                    azimuth: 0.0,
                    elevation: 15.0,
                    fill: Fill::of(1.0),
                    front: DVec3::NEG_Y,
                    around: None,
                },
                up: DVec3::Z,
            };
            let visible = fit::visible(&scene);
            let narrow = fit::fitted(&narrow, &visible, &visible, geometry);
            let cameras = turntable(&scene, &narrow, aspect, 24).expect("it has a line of sight");
            let views: Vec<View> = cameras.iter().filter_map(|camera| camera.view(geometry, aspect)).collect();
            let first = narrow.view(geometry, aspect).expect("it has a line of sight");
            assert!(views[0].forward.distance(first.forward) <= 1e-12, "the turn starts at the camera");
            let target = narrow.aim.target(geometry);
            let reach = |view: &View| ends(view).concat().into_iter().map(f64::abs).fold(0.0, f64::max);
            for (index, view) in views.iter().enumerate() {
                assert!((view.eye.distance(target) - views[0].eye.distance(target)).abs() <= 1e-9, "{index}");
                assert!((view.half[1] - views[0].half[1]).abs() <= 1e-12, "{index}");
                let level = |view: &View| (view.forward - view.forward.dot(DVec3::Z) * DVec3::Z).normalize();
                let degrees = level(&views[0]).dot(level(view)).clamp(-1.0, 1.0).acos().to_degrees();
                let expected = 15.0 * f64::from(u32::try_from(index.min(24 - index)).unwrap_or(0));
                assert!((degrees - expected).abs() <= 1e-4, "{index}: {degrees}");
            }
            let widest = views.iter().map(reach).fold(0.0, f64::max);
            assert!((widest / 0.9 - 1.0).abs() <= 0.02, "{projection:?}, {aspect}: {widest}");
        }
    }

    #[test]
    fn objects_that_are_deep_along_the_line_of_sight_fill_pictures_of_every_shape() {
        let scene = block();
        let geometry = &scene.frame.geometry;
        for (projection, half) in PROJECTIONS.into_iter().flat_map(|projection| {
            [[1.0, 1.0, 10.0], [10.0, 2.0, 1.0], [3.0, 18.0, 5.0]].map(|half| (projection, half))
        }) {
            // The wide end is far from the eye, or near it.
            for (taper, front) in
                [(1.0, DVec3::Z), (0.3, DVec3::X), (0.3, DVec3::NEG_X), (0.3, DVec3::Y), (0.3, DVec3::NEG_Y)]
            {
                let corner = |corner: u32| {
                    let sign = |axis: u32| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
                    let narrow = |axis: usize| front[axis] == 0.0 && corner >> 3 & 1 == 1;
                    let along = if corner >> 3 & 1 == 1 { 1.0 } else { -1.0 };
                    DVec3::from_array([0_u32, 1, 2].map(|axis| {
                        let at = axis as usize;
                        if front[at] == 0.0 {
                            sign(axis) * half[at] * if narrow(at) { taper } else { 1.0 }
                        } else {
                            along * half[at]
                        }
                    }))
                };
                let points: Vec<DVec3> = (0..16).map(corner).collect();
                let up = if front == DVec3::Z { DVec3::Y } else { DVec3::Z };
                let aim = Aim::Orbit { azimuth: 0.0, elevation: 0.0, fill: Fill::of(1.0), front, around: None };
                let camera = fit::fitted(&Camera { projection, aim, up }, &points, &points, geometry);
                for aspect in [0.5, 0.75, 1.0, 1.3333, 1.7778, 2.4] {
                    let view = camera.view(geometry, aspect).expect("it has a line of sight");
                    let reach = fit::reach(&view, &points);
                    assert!((reach / 0.9 - 1.0).abs() <= 0.02, "{projection:?}, {half:?}, {front}, {aspect}: {reach}");
                }
            }
        }
    }

    #[test]
    fn a_turntable_of_a_detail_keeps_its_camera() {
        let scene = block();
        let geometry = &scene.frame.geometry;
        let camera = Camera {
            projection: PROJECTIONS[0],
            aim: Aim::LookAt { position: DVec3::new(33.0, -2.0, 4.0), target: DVec3::new(33.0, 15.0, 4.0) },
            up: DVec3::Z,
        };
        let cameras = turntable(&scene, &camera, 1.0, 6).expect("it has a line of sight");
        for turned in &cameras {
            let view = turned.view(geometry, 1.0).expect("it has a line of sight");
            assert!((view.eye.distance(DVec3::new(33.0, 15.0, 4.0)) - 17.0).abs() < 1e-9, "{turned:?}");
        }
    }
}
