//! Rays in numbers: set up in f64 where the volume is, so that a camera far away is as sharp as a near one.

use glam::{DMat3, DVec3};

use super::CELL;
use crate::number::{count, unsigned, whole};
use crate::scene::{Scene, View};
use crate::volume::Geometry;

/// Everything a pixel needs to make its ray, in the axes of the volume's texture (0 to 1 along each).
///
/// With u and v the pixel's centre from −1 to 1 (right and up), its ray is
/// `base + u·base_u + v·base_v + s·(direction + u·direction_u + v·direction_v)/√(1 + u²·spread_u + v²·spread_v)`,
/// s in units of the smallest spacing, so that volumes of every size are within f32. Samples lie at s₀ + (n + ½)Δs, where
/// s₀ is where the ray enters the box or leaves the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayTable {
    /// See above: a point in or near the volume.
    pub base: DVec3,
    /// See above.
    pub base_u: DVec3,
    /// See above.
    pub base_v: DVec3,
    /// Texture units per unit of length along the middle ray.
    pub direction: DVec3,
    /// See above.
    pub direction_u: DVec3,
    /// See above.
    pub direction_v: DVec3,
    /// Distance along the middle ray from the eye to `base`, in units of length.
    pub eye_distance: f64,
    /// tan² of half the horizontal field of view; 0 for parallel rays.
    pub spread_u: f64,
    /// The same, vertical.
    pub spread_v: f64,
    /// The box of the volume, cropped.
    pub low: DVec3,
    /// Its other corner.
    pub high: DVec3,
    /// Cells along an edge of the texture: multiply a texture coordinate to count cells (after the offset).
    pub cell_scale: DVec3,
    /// Cells from the texture's edge to voxel 0, negative.
    pub cell_offset: DVec3,
    /// From texture axes to units of length along the volume's own axes: shading happens there.
    pub local_scale: DVec3,
    /// Δs in units of length.
    pub step_length: f64,
    /// Samples on the longest ray.
    pub samples: u32,
}

/// What lengths are counted in, in world units: the smallest spacing.
#[must_use]
pub(super) fn unit_length(geometry: &Geometry) -> f64 {
    geometry.spacing.min_element()
}

/// Most samples a ray can count in f32 without skipping one.
pub const MOST_SAMPLES: f64 = 8_388_608.0;

impl RayTable {
    /// The rays of `view` through the volume of `scene`. `None` where a ray would have more than [`MOST_SAMPLES`].
    #[must_use]
    pub fn new(scene: &Scene, view: &View) -> Option<Self> {
        let geometry = &scene.volume.geometry;
        let dims = DVec3::from_array(geometry.dims.map(count));
        // Texture coordinate of a world point: (index + ½)/n, index = direction⁻¹(point − origin)/spacing.
        let local_from_world = geometry.direction.inverse();
        let texture_from_local = DMat3::from_diagonal((geometry.spacing * dims).recip());
        let linear = texture_from_local * local_from_world;
        let point = |world: DVec3| linear * (world - geometry.origin) + 0.5 / dims;

        let centre = crate::scene::centre(geometry);
        let diagonal = (geometry.spacing * dims).length();
        let distance = (centre - view.eye).dot(view.forward);
        let eye_distance = if distance > diagonal { distance } else { 0.0 };
        let (half_u, half_v) = (view.half[0] * view.right, view.half[1] * view.up);
        let (spread_u, spread_v) =
            if view.parallel { (0.0, 0.0) } else { (view.half[0] * view.half[0], view.half[1] * view.half[1]) };
        let (base_u, base_v, direction_u, direction_v) = if view.parallel {
            (half_u, half_v, DVec3::ZERO, DVec3::ZERO)
        } else {
            (eye_distance * half_u, eye_distance * half_v, half_u, half_v)
        };

        let [first, last] = scene.crop.unwrap_or([DVec3::ZERO, dims - 1.0]);
        // An axis of one voxel is one voxel thick.
        let thin = dims.cmpeq(DVec3::ONE);
        let low = DVec3::select(thin, DVec3::ZERO, (first + 0.5) / dims);
        let high = DVec3::select(thin, DVec3::ONE, (last + 0.5) / dims);
        let longest = ((high - low) * dims * geometry.spacing).length();
        let samples = (longest / scene.accuracy.step_length).ceil() + 1.0;
        if samples > MOST_SAMPLES {
            return None;
        }
        let unit = unit_length(geometry);
        let cell = count(CELL);
        Some(Self {
            base: point(view.eye + eye_distance * view.forward),
            base_u: linear * base_u,
            base_v: linear * base_v,
            direction: linear * view.forward * unit,
            direction_u: linear * direction_u * unit,
            direction_v: linear * direction_v * unit,
            eye_distance: eye_distance / unit,
            spread_u,
            spread_v,
            low,
            high,
            cell_scale: dims / cell,
            cell_offset: DVec3::splat(-0.5 / cell),
            local_scale: geometry.spacing / unit * dims,
            step_length: scene.accuracy.step_length / unit,
            samples: unsigned(whole(samples)),
        })
    }
}
