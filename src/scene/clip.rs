//! Clip planes: what lies beyond them is not there, neither for the eye nor for shadows.

use glam::{DMat3, DVec3};

use crate::{FIELDS, Frame};

/// Most clip planes of a scene.
pub const CLIP_PLANES: usize = 8;

/// The clip planes of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Planes, of which those that are on act.
    pub planes: Vec<ClipPlane>,
    /// The part that several planes leave.
    pub keep: Keep,
    /// True if shading sees cut faces: within a unit of length (the smallest spacing) of a plane, as though the lowest value lay
    /// beyond it.
    pub cap: bool,
}

/// The part of a field that several planes leave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Keep {
    /// The part that each of them keeps.
    #[default]
    All,
    /// All that at least one of them keeps: a corner is cut out.
    Any,
}

/// A plane in the world of the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClipPlane {
    /// A point on it.
    pub point: DVec3,
    /// The direction of the side that goes, of any length but 0.
    pub normal: DVec3,
    /// False for a plane that is kept without an effect.
    pub on: bool,
    /// True for each field, by its index, that it cuts. Labels belong to the first.
    pub fields: [bool; FIELDS],
}

impl Default for Clip {
    fn default() -> Self {
        Self { planes: Vec::new(), keep: Keep::default(), cap: true }
    }
}

impl Clip {
    /// The planes that a scene may have: the first [`CLIP_PLANES`], without those of numbers that are not finite or of no direction.
    #[must_use]
    pub fn allowed(&self) -> Self {
        let planes = self.planes.iter().filter(|plane| ClipPlane::new(plane.point, plane.normal).is_some());
        Self { planes: planes.take(CLIP_PLANES).copied().collect(), ..*self }
    }

    /// The planes that are on.
    pub fn in_force(&self) -> impl Iterator<Item = &ClipPlane> {
        self.planes.iter().filter(|plane| plane.on)
    }

    /// True if the planes leave other parts of some fields than of others, or a part that is not convex.
    #[must_use]
    pub fn is_by_field(&self) -> bool {
        let several = self.in_force().nth(1).is_some();
        self.in_force().any(|plane| !plane.cuts_all()) || (self.keep == Keep::Any && several)
    }

    /// True if rays end at a plane: all fields end there.
    #[must_use]
    pub fn shortens(&self, plane: &ClipPlane) -> bool {
        !self.is_by_field() || (self.keep == Keep::All && plane.cuts_all())
    }

    /// The planes that are on, those at which rays end first.
    pub fn in_order(&self) -> impl Iterator<Item = &ClipPlane> {
        let ends = self.in_force().filter(|plane| self.shortens(plane));
        ends.chain(self.in_force().filter(|plane| !self.shortens(plane))).take(CLIP_PLANES)
    }

    /// The planes that cut the field with this index.
    fn of_field(&self, field: usize) -> impl Iterator<Item = &ClipPlane> {
        self.in_force().filter(move |plane| plane.fields[field])
    }

    /// True if the planes take a place of the world from the field with this index.
    #[must_use]
    pub fn hides(&self, field: usize, place: DVec3) -> bool {
        let is_beyond = |plane: &ClipPlane| plane.beyond(place) > 0.0;
        match self.keep {
            Keep::All => self.of_field(field).any(is_beyond),
            Keep::Any => self.of_field(field).next().is_some() && self.of_field(field).all(is_beyond),
        }
    }

    /// True if the planes that cut all fields leave nothing of the box of `frame` between these `corners`, in voxel indices.
    #[must_use]
    pub fn leaves_nothing(&self, frame: &Frame, [low, high]: [DVec3; 2]) -> bool {
        let geometry = &frame.geometry;
        if self.is_by_field() && self.keep == Keep::Any {
            // The removed part is convex: all of the box goes, if all of its corners do.
            let corner = |bits: usize| {
                DVec3::from_array(std::array::from_fn(
                    |axis| if bits >> axis & 1 == 0 { low[axis] } else { high[axis] },
                ))
            };
            return (0..8)
                .all(|bits| (0..FIELDS).all(|field| self.hides(field, geometry.world_from_index(corner(bits)))));
        }
        // The part that faces and planes leave is convex: it has a corner where three of them meet. All are moved inwards a little, since a slice
        // without thickness is nothing.
        let inwards = 1e-6 * geometry.extent().length();
        let half = DVec3::select(frame.thin_axes().into(), DVec3::splat(0.5), DVec3::ZERO);
        let (low, high) = (low - half, high + half);
        let faces = (0..3).flat_map(|axis| {
            let outward = geometry.direction.col(axis);
            [(low, -outward), (high, outward)].map(|(corner, outward)| (geometry.world_from_index(corner), outward))
        });
        let all: Vec<(DVec3, DVec3)> = faces
            .chain(self.in_force().filter(|plane| plane.cuts_all()).map(|plane| (plane.point, plane.outward())))
            .map(|(point, outward)| (point - outward * inwards, outward))
            .collect();
        let slack = 1e-3 * inwards;
        let is_left = |place: DVec3| all.iter().all(|&(point, outward)| outward.dot(place - point) <= slack);
        let meets = |a: usize, b: usize, c: usize| {
            let normals = DMat3::from_cols(all[a].1, all[b].1, all[c].1).transpose();
            let at = DVec3::new(all[a].1.dot(all[a].0), all[b].1.dot(all[b].0), all[c].1.dot(all[c].0));
            (normals.determinant().abs() > 1e-9).then(|| normals.inverse() * at)
        };
        let numbers = || 0..all.len();
        !numbers().any(|a| (a + 1..all.len()).any(|b| (b + 1..all.len()).any(|c| meets(a, b, c).is_some_and(is_left))))
    }

    /// True if both leave the same part, and shade it alike.
    pub(crate) fn acts_as(&self, other: &Self) -> bool {
        let keeps_alike = self.keep == other.keep || !(self.is_by_field() || other.is_by_field());
        let acts_alike = self.cap == other.cap && keeps_alike;
        self.in_force().eq(other.in_force()) && (acts_alike || self.in_force().next().is_none())
    }
}

impl ClipPlane {
    /// A plane that is on. `None` unless all numbers are finite and the normal has a length.
    #[must_use]
    pub fn new(point: DVec3, normal: DVec3) -> Option<Self> {
        let has_length = normal.try_normalize().is_some();
        (has_length && point.is_finite()).then_some(Self { point, normal, on: true, fields: [true; FIELDS] })
    }

    /// True if it cuts all fields.
    #[must_use]
    pub fn cuts_all(&self) -> bool {
        self.fields.iter().all(|&cuts| cuts)
    }

    /// Unit vector towards the side that goes.
    #[must_use]
    pub fn outward(&self) -> DVec3 {
        self.normal.normalize_or_zero()
    }

    /// The part of the box of `frame` that stays, along the normal: 1 if none goes.
    #[must_use]
    pub fn part(&self, frame: &Frame) -> f64 {
        let [least, most] = frame.extent_along(self.outward());
        let at = self.outward().dot(self.point);
        if most > least { (at - least) / (most - least) } else { 1.0 }
    }

    /// The plane, moved along its normal so that this `part` of the box stays.
    #[must_use]
    pub fn with_part(self, frame: &Frame, part: f64) -> Self {
        let (outward, middle) = (self.outward(), frame.middle());
        let [least, most] = frame.extent_along(outward);
        let at = (most - least).mul_add(part, least);
        Self { point: middle + outward * (at - outward.dot(middle)), ..self }
    }

    /// Distance of a place of the world from the plane; negative on the side that stays.
    #[must_use]
    pub fn beyond(&self, place: DVec3) -> f64 {
        self.outward().dot(place - self.point)
    }
}
