//! The camera of a reader who turns the volume of a live page.

use glam::DVec3;

use super::{Aim, Camera, Projection};
use crate::camera::unit;
use relume_volume::Geometry;

/// A camera as it was turned: about its target, then nearer as a lens zooms, then to a side. `live.js` computes the same rays of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turned {
    /// Degrees about the up direction; 0 is at the front of a camera on an orbit, and at any other camera itself.
    pub azimuth: f64,
    /// Degrees above the horizon.
    pub elevation: f64,
    /// Times that the target appears as large; the eye stays where it is.
    pub zoom: f64,
    /// Translation of the camera in heights of the zoomed picture, to the right and up.
    pub pan: [f64; 2],
}

impl Turned {
    /// `camera` as it opens.
    #[must_use]
    pub fn of(camera: &Camera) -> Self {
        let (azimuth, elevation) = match &camera.aim {
            Aim::Orbit { azimuth, elevation, .. } => (*azimuth, *elevation),
            Aim::LookAt { position, target } => {
                let outward = *position - *target;
                let above = outward.dot(camera.up.normalize_or_zero());
                (0.0, (above / outward.length()).asin().to_degrees())
            }
        };
        Self { azimuth, elevation, zoom: 1.0, pan: [0.0; 2] }
    }

    /// The turned camera, which was `opened` like that, for pictures of `width / height = aspect`; `None` without a line of sight.
    #[must_use]
    pub fn camera(&self, opened: &Camera, geometry: &Geometry, aspect: f64) -> Option<Camera> {
        let mut camera = opened.clone();
        match &mut camera.aim {
            Aim::Orbit { azimuth, elevation, .. } => (*azimuth, *elevation) = (self.azimuth, self.elevation),
            Aim::LookAt { position, target } => {
                let (up, outward) = (unit(opened.up)?, *position - *target);
                let front = unit(outward - outward.dot(up) * up)?;
                let [azimuth, elevation] = [self.azimuth, self.elevation].map(f64::to_radians);
                let around = azimuth.cos() * front + azimuth.sin() * up.cross(front);
                *position = *target + outward.length() * (elevation.cos() * around + elevation.sin() * up);
            }
        }
        if self.zoom.to_bits() == 1.0_f64.to_bits() && self.pan.iter().all(|&part| part == 0.0) {
            return Some(camera);
        }
        let view = camera.view(geometry, aspect)?;
        let target = camera.aim.target(geometry);
        let half = view.half[1] / self.zoom;
        let distance = (target - view.eye).dot(view.forward);
        let span = 2.0 * if view.parallel { half } else { half * distance };
        let by: DVec3 = span * (self.pan[0] * view.right + self.pan[1] * view.up);
        let projection = if view.parallel {
            Projection::Orthographic { height: Some(2.0 * half) }
        } else {
            Projection::Perspective { fov_degrees: 2.0 * half.atan().to_degrees() }
        };
        Some(Camera { projection, aim: Aim::LookAt { position: view.eye + by, target: target + by }, up: opened.up })
    }
}
