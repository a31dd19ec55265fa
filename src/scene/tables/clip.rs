//! Clip planes in texture coordinates.

use glam::{DVec3, DVec4};

use super::{Storage, unit_length};
use crate::{CLIP_PLANES, Scene};
use relume_base::number::count;

/// Numbers of the shading of cut faces.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CapTable {
    /// The planes.
    pub planes: ClipTable,
    /// Unit vectors towards the side of each plane that goes, along the volume's own axes.
    pub outward: Vec<DVec3>,
    /// Scale and offset from the value of a texel to the gradient of a fall to the lowest value within two units of length.
    pub fall: [f64; 2],
}

impl CapTable {
    /// Builds the numbers of `scene`, whose first field is decoded by `storage`.
    #[must_use]
    pub fn new(scene: &Scene, storage: &Storage) -> Self {
        let to_local = scene.frame.geometry.direction.transpose();
        Self {
            planes: ClipTable::new(scene),
            outward: scene.clip.in_force().take(CLIP_PLANES).map(|plane| to_local * plane.outward()).collect(),
            fall: storage.fall_from_texel(unit_length(&scene.frame.geometry)),
        }
    }
}

/// The clip planes of a scene that are on. The first three numbers of a plane times texture coordinates, plus the fourth, are the
/// distance from it, in units of length; positive beyond it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClipTable {
    planes: [DVec4; CLIP_PLANES],
    number: usize,
}

impl ClipTable {
    /// Builds the planes of `scene`.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let geometry = &scene.frame.geometry;
        let unit = unit_length(geometry);
        let dims = DVec3::from_array(geometry.dims.map(count));
        // World point of texture coordinates t: origin + direction·(spacing·(t·dims − ½)).
        let corner = geometry.origin - geometry.direction * (geometry.spacing / 2.0);
        let mut table = Self::default();
        for plane in scene.clip.in_force().take(CLIP_PLANES) {
            let outward = plane.outward();
            let across = geometry.direction.transpose() * outward * geometry.spacing * dims / unit;
            table.planes[table.number] = across.extend(outward.dot(corner - plane.point) / unit);
            table.number += 1;
        }
        table
    }

    /// The planes.
    #[must_use]
    pub fn planes(&self) -> &[DVec4] {
        &self.planes[..self.number]
    }
}
