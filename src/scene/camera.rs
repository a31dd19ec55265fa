//! The camera: projection, position and direction.

use std::ops::RangeInclusive;

use glam::{DVec2, DVec3};

use relume_base::number::count;
use relume_volume::Geometry;

/// A camera as a scene states it; [`Camera::view`] resolves it for a volume and a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Projection of the rays.
    pub projection: Projection,
    /// Position and line of sight.
    pub aim: Aim,
    /// World direction that is up in the picture.
    pub up: DVec3,
}

/// Projection of the rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Rays from one point.
    Perspective {
        /// Vertical field of view in degrees.
        fov_degrees: f64,
    },
    /// Parallel rays. Without a `height`, the picture spans the `fill` of [`Aim::Orbit`], or the distance from eye to
    /// target of [`Aim::LookAt`].
    Orthographic {
        /// World units from the bottom of the picture to the top.
        height: Option<f64>,
    },
}

/// Position and line of sight of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a scene has one camera, which is copied")]
pub enum Aim {
    /// At `position`, towards `target`, both in world units.
    LookAt {
        /// Position of the eye.
        position: DVec3,
        /// Point in the middle of the picture.
        target: DVec3,
    },
    /// On an orbit about the volume's centre, at the distance where the volume's box spans `fill` of the picture in its
    /// larger direction.
    Orbit {
        /// Degrees about the up direction; 0 is at `front`.
        azimuth: f64,
        /// Degrees above the horizon.
        elevation: f64,
        /// Fraction of the picture that the volume's box spans.
        fill: Fill,
        /// World direction from the centre to the camera at azimuth 0.
        front: DVec3,
        /// Opposite corners of a box in the world, in place of the volume's.
        around: Option<[DVec3; 2]>,
    },
}

impl Default for Camera {
    /// A perspective camera with a field of view of 30°, slightly from the side and from above.
    fn default() -> Self {
        Self {
            projection: Projection::Perspective { fov_degrees: 30.0 },
            aim: Aim::Orbit {
                azimuth: -20.0,
                elevation: 15.0,
                fill: Fill::of(0.95),
                front: DVec3::NEG_Z,
                around: None,
            },
            up: DVec3::NEG_Y,
        }
    }
}

/// Fraction of the picture that a box spans: one, or one for each of several aspect ratios.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    /// Aspect ratio and fraction, of which the first `number` count.
    nodes: [[f64; 2]; Self::MOST],
    number: usize,
}

impl Fill {
    /// Most aspect ratios.
    pub const MOST: usize = 10;
    /// Range of a fraction.
    pub const RANGE: RangeInclusive<f64> = 0.01..=100.0;

    /// The same fraction for every picture.
    #[must_use]
    pub const fn of(fraction: f64) -> Self {
        Self { nodes: [[1.0, fraction]; Self::MOST], number: 1 }
    }

    /// Pairs of an aspect ratio (width / height) and its fraction. `None` unless there are 1 to [`Self::MOST`] pairs with
    /// ascending aspect ratios above 0.
    #[must_use]
    pub fn by_aspect(pairs: &[[f64; 2]]) -> Option<Self> {
        let is_ascending = pairs.windows(2).all(|pair| pair[0][0] < pair[1][0]);
        let mut fill = Self { number: pairs.len(), ..Self::of(1.0) };
        fill.nodes.get_mut(..pairs.len())?.copy_from_slice(pairs);
        (is_ascending && pairs.first()?[0] > 0.0).then_some(fill)
    }

    /// Pairs of an aspect ratio and its fraction; a single pair holds for every picture.
    #[must_use]
    pub fn pairs(&self) -> &[[f64; 2]] {
        self.nodes.get(..self.number).unwrap_or_default()
    }

    /// Fraction for a picture of `width / height = aspect`: linear between the pairs, constant beyond them.
    #[must_use]
    pub fn at(&self, aspect: f64) -> f64 {
        let pairs = self.pairs();
        let after = pairs.partition_point(|pair| pair[0] < aspect);
        match (after.checked_sub(1).and_then(|before| pairs.get(before)), pairs.get(after)) {
            (Some(&[a0, f0]), Some(&[a1, f1])) => (f1 - f0).mul_add((aspect - a0) / (a1 - a0), f0),
            (Some(&[_, end]), None) | (None, Some(&[_, end])) => end,
            (None, None) => 1.0,
        }
    }
}

/// A camera resolved for one volume and one picture: an orthonormal frame in the world, in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The eye (perspective), or the origin in the plane from which rays start (orthographic).
    pub eye: DVec3,
    /// Unit vector along the line of sight.
    pub forward: DVec3,
    /// Unit vector to the right of the picture.
    pub right: DVec3,
    /// Unit vector up in the picture.
    pub up: DVec3,
    /// Half the picture's width and height: at distance 1 (perspective), or in world units (orthographic).
    pub half: [f64; 2],
    /// Whether rays are parallel.
    pub parallel: bool,
}

impl View {
    /// Coordinates of a world point relative to the eye: right, up and forward. Right and up are in half pictures, for
    /// perspective at distance 1 from the eye.
    #[must_use]
    pub fn seen(&self, point: DVec3) -> DVec3 {
        let from_eye = point - self.eye;
        let [right, up] = self.half;
        DVec3::new(from_eye.dot(self.right) / right, from_eye.dot(self.up) / up, from_eye.dot(self.forward))
    }

    /// Position of a world point in the picture, in fractions from the top left; `None` behind the eye.
    #[must_use]
    pub fn place_of(&self, point: DVec3) -> Option<DVec2> {
        let seen = self.seen(point);
        let by = if self.parallel { 1.0 } else { seen.z };
        let there = DVec2::new(seen.x, -seen.y) / by;
        (seen.z > 0.0 && there.is_finite()).then_some((there + 1.0) / 2.0)
    }

    /// World point at the picture position `place`, at the depth of `point`.
    #[must_use]
    pub fn point_at(&self, place: DVec2, point: DVec3) -> DVec3 {
        let depth = (point - self.eye).dot(self.forward);
        let by = if self.parallel { 1.0 } else { depth };
        let [right, up] = self.half;
        let there = (2.0 * place - 1.0) * DVec2::new(right, -up) * by;
        self.eye + depth * self.forward + there.x * self.right + there.y * self.up
    }
}

impl Camera {
    /// The camera that stands where this one does for the volume of `geometry` in a picture of `width / height = aspect`,
    /// whatever the volume. `None` if it has no line of sight.
    #[must_use]
    pub(crate) fn placed(&self, geometry: &Geometry, aspect: f64) -> Option<Self> {
        let view = self.view(geometry, aspect)?;
        let projection = match self.projection {
            Projection::Orthographic { .. } => Projection::Orthographic { height: Some(2.0 * view.half[1]) },
            perspective @ Projection::Perspective { .. } => perspective,
        };
        let aim = Aim::LookAt { position: view.eye, target: self.aim.target(geometry) };
        Some(Self { projection, aim, up: self.up })
    }

    /// Frame of this camera for the volume of `geometry` and a picture of `width / height = aspect`. `None` if the
    /// camera has no line of sight: its target is its eye, or its up direction is parallel to its line of sight.
    #[must_use]
    pub fn view(&self, geometry: &Geometry, aspect: f64) -> Option<View> {
        let up = unit(self.up)?;
        let (forward, target) = match self.aim {
            Aim::LookAt { position, target } => ((target - position).try_normalize()?, target),
            Aim::Orbit { azimuth, elevation, front, .. } => {
                let front = (front - front.dot(up) * up).try_normalize()?;
                let (sin_a, cos_a) = azimuth.to_radians().sin_cos();
                let (sin_e, cos_e) = elevation.to_radians().sin_cos();
                let outward = cos_e * (cos_a * front + sin_a * up.cross(front)) + sin_e * up;
                (-outward, self.aim.target(geometry))
            }
        };
        let right = forward.cross(up).try_normalize()?;
        let up = right.cross(forward);
        let corners = self.aim.corners_from_centre(geometry);
        let (eye, half_height, parallel) = match (self.projection, self.aim) {
            (Projection::Perspective { fov_degrees }, aim) => {
                let tangent = (fov_degrees / 2.0).to_radians().tan();
                let eye = match aim {
                    Aim::LookAt { position, .. } => position,
                    Aim::Orbit { fill, .. } => {
                        let radius = corners[0].length();
                        let distance = corners.iter().fold(radius, |distance, corner| {
                            let reach = (corner.dot(right).abs() / aspect).max(corner.dot(up).abs());
                            distance.max(reach / (tangent * fill.at(aspect)) - corner.dot(forward))
                        });
                        target - distance * forward
                    }
                };
                (eye, tangent, false)
            }
            (Projection::Orthographic { height }, aim) => {
                let fitted = |fill: Fill| {
                    corners.iter().fold(0.0_f64, |half, corner| {
                        half.max((corner.dot(right).abs() / aspect).max(corner.dot(up).abs()) / fill.at(aspect))
                    })
                };
                match aim {
                    Aim::LookAt { position, target } => {
                        (position, height.map_or_else(|| position.distance(target) / 2.0, |height| height / 2.0), true)
                    }
                    Aim::Orbit { fill, .. } => {
                        let eye = target - 2.0 * corners[0].length() * forward;
                        (eye, height.map_or_else(|| fitted(fill), |height| height / 2.0), true)
                    }
                }
            }
        };
        Some(View { eye, forward, right, up, half: [half_height * aspect, half_height], parallel })
    }
}

impl Aim {
    /// Point in the middle of the picture.
    #[must_use]
    pub fn target(&self, geometry: &Geometry) -> DVec3 {
        match *self {
            Self::LookAt { target, .. } => target,
            Self::Orbit { around: Some([one, other]), .. } => one.midpoint(other),
            Self::Orbit { around: None, .. } => centre(geometry),
        }
    }

    /// Corners of the box that fits into the picture, relative to its centre in the world.
    #[must_use]
    pub fn corners_from_centre(&self, geometry: &Geometry) -> [DVec3; 8] {
        match *self {
            Self::Orbit { around: Some([one, other]), .. } => corners((other - one) / 2.0),
            _ => corners_from_centre(geometry),
        }
    }
}

/// Unit vector along `vector`; `None` if it has no direction. A unit vector is returned unchanged, so that a number
/// written to a file is read back exactly.
#[must_use]
pub fn unit(vector: DVec3) -> Option<DVec3> {
    let is_unit = (vector.length_squared() - 1.0).abs() <= 8.0 * f64::EPSILON;
    if is_unit { Some(vector) } else { vector.try_normalize() }
}

/// Centre of the volume in the world.
#[must_use]
pub fn centre(geometry: &Geometry) -> DVec3 {
    let last = DVec3::from_array(geometry.dims.map(|n| count(n) - 1.0));
    geometry.origin + geometry.direction * (geometry.spacing * last / 2.0)
}

/// Corners of the volume's box, which encloses whole voxels, relative to its centre in the world.
fn corners_from_centre(geometry: &Geometry) -> [DVec3; 8] {
    corners(geometry.extent() / 2.0).map(|corner| geometry.direction * corner)
}

/// Corners of a box of half the extent `half`, relative to its centre.
fn corners(half: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|corner| {
        let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
        half * DVec3::new(sign(0), sign(1), sign(2))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_seen_at_a_place_is_where_that_is() {
        for (parallel, point) in [(false, DVec3::new(1.0, 5.0, -2.0)), (true, DVec3::new(-1.0, 9.0, 3.0))] {
            let (forward, right, up) = (DVec3::Y, DVec3::X, DVec3::Z);
            let view = View { eye: DVec3::new(0.5, -1.0, 0.25), forward, right, up, half: [1.5, 0.75], parallel };
            let place = view.place_of(point).unwrap_or_default();
            assert!(view.point_at(place, point).distance(point) < 1e-12, "{place}");
            // Points right of the eye are right of the centre, and points below it are farther down.
            let from_eye = point - view.eye;
            assert!((place.x > 0.5) == (from_eye.x > 0.0) && (place.y > 0.5) == (from_eye.z < 0.0), "{place}");
            assert_eq!(view.place_of(view.eye - 2.0 * forward), None, "behind the eye");
        }
    }
    #[test]
    fn a_fill_by_aspect_ratio_is_linear_between_its_pairs_and_constant_beyond() {
        let fill = Fill::by_aspect(&[[0.5, 1.0], [1.0, 2.0], [2.0, 1.5]]).unwrap_or(Fill::of(0.0));
        for (aspect, expected) in [(0.1, 1.0), (0.5, 1.0), (0.75, 1.5), (1.0, 2.0), (1.5, 1.75), (2.0, 1.5), (9.0, 1.5)]
        {
            assert!((fill.at(aspect) - expected).abs() < 1e-15, "{aspect}: {}", fill.at(aspect));
            assert!((Fill::of(0.9).at(aspect) - 0.9).abs() < 1e-15, "{aspect}");
        }
        for refused in [&[][..], &[[1.0, 1.0], [1.0, 2.0]], &[[0.0, 1.0]], &[[f64::NAN, 1.0]], &[[1.0, 1.0]; 11]] {
            assert_eq!(Fill::by_aspect(refused), None, "{refused:?}");
        }
    }
}
