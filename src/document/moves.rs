//! Camera movements around the volume.

use glam::{DQuat, DVec3};

use crate::scene::{Aim, Camera, Projection, View};
use crate::volume::Geometry;

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
    /// View from this side of the volume, with all of it in view.
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

/// Returns `camera` after `step`, for the volume of `geometry` and a picture of `width / height = aspect`. `opened` is
/// the initial camera, and replaces a result that has no line of sight.
#[must_use]
pub fn moved(camera: &Camera, opened: &Camera, geometry: &Geometry, aspect: f64, step: Move) -> Camera {
    let stated = match step {
        Move::Reset => None,
        Move::Axis(side) => Some(from_side(camera, opened, side)),
        step => go(camera, geometry, aspect, step),
    };
    stated.filter(|camera| camera.view(geometry, aspect).is_some()).unwrap_or_else(|| opened.clone())
}

/// Cameras of `frames` pictures of a full turn about the up direction, from `camera` on. All have the same distance or,
/// with parallel rays, the same height: the largest that any of them needs, so that nothing grows or leaves the picture.
/// `None` if `camera` has no line of sight.
#[must_use]
pub fn turntable(camera: &Camera, geometry: &Geometry, aspect: f64, frames: u16) -> Option<Vec<Camera>> {
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
    let distance = views.iter().map(|view| (target - view.eye).dot(view.forward)).fold(0.0, f64::max);
    let half = views.iter().map(|view| view.half[1]).fold(0.0, f64::max);
    let projection = match camera.projection {
        Projection::Orthographic { .. } => Projection::Orthographic { height: Some(2.0 * half) },
        perspective @ Projection::Perspective { .. } => perspective,
    };
    let placed = |view: &View| Camera {
        projection,
        aim: Aim::LookAt { position: target - distance * view.forward, target },
        up: camera.up,
    };
    Some(views.iter().map(placed).collect())
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
    Camera { projection, aim: Aim::Orbit { azimuth: 0.0, elevation: 0.0, fill: 1.0, front, around }, up }
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
    use super::*;

    #[test]
    fn a_turntable_keeps_its_distance_and_shows_every_side_whole() {
        let direction = glam::DMat3::IDENTITY;
        let geometry = Geometry::new("box", [40, 10, 20], DVec3::ONE, DVec3::ZERO, direction).ok();
        let geometry = geometry.expect("a box is a grid");
        for projection in [Projection::Perspective { fov_degrees: 30.0 }, Projection::Orthographic { height: None }] {
            let camera = Camera { projection, ..Camera::default() };
            let cameras = turntable(&camera, &geometry, 1.5, 12).expect("it has a line of sight");
            let views: Vec<View> = cameras.iter().filter_map(|camera| camera.view(&geometry, 1.5)).collect();
            let first = camera.view(&geometry, 1.5).expect("it has a line of sight");
            assert!(views[0].forward.distance(first.forward) <= 1e-12, "the turn starts at the camera");
            let target = camera.aim.target(&geometry);
            for (index, view) in views.iter().enumerate() {
                assert!((view.eye.distance(target) - views[0].eye.distance(target)).abs() <= 1e-9, "{index}");
                assert!((view.half[1] - views[0].half[1]).abs() <= 1e-12, "{index}");
                let turned = (view.forward - view.forward.dot(DVec3::Y) * DVec3::Y).normalize();
                let start = (views[0].forward - views[0].forward.dot(DVec3::Y) * DVec3::Y).normalize();
                let degrees = start.dot(turned).clamp(-1.0, 1.0).acos().to_degrees();
                let expected = 30.0 * f64::from(u32::try_from(index.min(12 - index)).unwrap_or(0));
                assert!((degrees - expected).abs() <= 1e-4, "{index}: {degrees}");
                for corner in 0..8 {
                    let at = |axis: usize, side: f64| if corner >> axis & 1 == 0 { -0.5 } else { side - 0.5 };
                    let place = view.place_of(DVec3::new(at(0, 40.0), at(1, 10.0), at(2, 20.0)));
                    let inside = place.is_some_and(|place| place.min_element() >= 0.0 && place.max_element() <= 1.0);
                    assert!(inside, "{index}, corner {corner}: {place:?}");
                }
            }
        }
    }
}
