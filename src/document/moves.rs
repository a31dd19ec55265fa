//! Camera movements around the volume.

use glam::{DQuat, DVec3};

use crate::scene::{Aim, Camera, Projection};
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
