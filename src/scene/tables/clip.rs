//! Clip planes in texture coordinates.

use glam::{DVec3, DVec4};

use super::{Storage, unit_length};
use crate::{CLIP_PLANES, FIELDS, Keep, Scene};
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
            outward: scene.clip.in_order().map(|plane| to_local * plane.outward()).collect(),
            fall: storage.fall_from_texel(unit_length(&scene.frame.geometry)),
        }
    }
}

/// The clip planes of a scene that are on, those that all fields end at first. The first three numbers of a plane times texture coordinates, plus the fourth, are the
/// distance from it, in units of length; positive beyond it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ClipTable {
    planes: [DVec4; CLIP_PLANES],
    fields: [[bool; FIELDS]; CLIP_PLANES],
    number: usize,
    shortening: usize,
    /// True if fields keep what any of their planes keeps.
    pub keeps_any: bool,
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
        let keeps_any = scene.clip.is_by_field() && scene.clip.keep == Keep::Any;
        let mut table = Self { keeps_any, ..Self::default() };
        for plane in scene.clip.in_order() {
            let outward = plane.outward();
            let across = geometry.direction.transpose() * outward * geometry.spacing * dims / unit;
            table.planes[table.number] = across.extend(outward.dot(corner - plane.point) / unit);
            table.fields[table.number] = plane.fields;
            table.number += 1;
            table.shortening += usize::from(scene.clip.shortens(plane));
        }
        table
    }

    /// Number of planes that shorten rays, which come first.
    #[must_use]
    pub fn shortening(&self) -> usize {
        self.shortening
    }

    /// True for each field that a plane cuts.
    #[must_use]
    pub fn fields(&self) -> &[[bool; FIELDS]] {
        &self.fields[..self.number]
    }

    /// The planes.
    #[must_use]
    pub fn planes(&self) -> &[DVec4] {
        &self.planes[..self.number]
    }
}
