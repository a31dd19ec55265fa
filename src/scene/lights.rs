//! Light positions, and mixes of spectra at them.

use std::ops::RangeInclusive;

use glam::DVec3;

use super::{Camera, Lighting, Projection, Scene, Shading, View};
use relume_colour::spectrum::{Light, Spectrum};

/// Range of factors of a light's spectrum.
pub const INTENSITY: RangeInclusive<f64> = 0.0..=1e9;

/// Largest factor that the window offers: of a light, of the mix, of the exposure. Products of them stay finite.
pub const BRIGHTEST: f64 = 1e6;

/// Origin of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// From all directions; its shade is 1.
    Ambient,
    /// From the eye, along each ray.
    Headlight,
    /// From infinity; the unit vector points towards the light, in world space.
    Directional(DVec3),
    /// From a world point, without attenuation by distance.
    Point(DVec3),
    /// From the three directions of [`three_point`], which move with the camera; they share an accumulator.
    ThreePoint,
}

/// Directions of a three-point light, as parts towards the right and the top of the picture and towards the eye, and
/// their weights: key, fill and rim (docs/decisions/rendering.md).
const THREE_POINT: [([f64; 3], f64); 3] = [([-0.5, 0.6, 1.0], 0.9), ([0.8, 0.1, 0.5], 0.1), ([0.4, 0.8, -0.3], 0.15)];

/// Unit vectors in world space towards the key, the fill and the rim of a three-point light seen in `view`, and their
/// weights.
#[must_use]
pub fn three_point(view: &View) -> [(DVec3, f64); 3] {
    THREE_POINT.map(|([right, up, back], weight)| {
        ((right * view.right + up * view.up - back * view.forward).normalize_or_zero(), weight)
    })
}

/// Name of a kind of light in files: `"ambient"`, `"headlight"`, `"directional"`, `"point"` or `"three_point"`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(transparent)]
pub struct LightKind(&'static str);

impl LightKind {
    /// The names of all kinds, the key of the vector that a kind has, and its origin in words, which the vector follows.
    const ALL: &'static [(&'static str, Option<&'static str>, &'static str)] = &[
        ("ambient", None, "from everywhere"),
        ("headlight", None, "from the eye"),
        ("directional", Some("direction"), "from the direction"),
        ("point", Some("position"), "from"),
        ("three_point", None, "from three points around the eye"),
    ];

    /// Its name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        self.0
    }

    /// Key of its vector in a scene file: `direction`, a unit vector towards the light, or `position`. `None` if it has none.
    #[must_use]
    pub fn vector(self) -> Option<&'static str> {
        Self::ALL.iter().find(|(name, ..)| *name == self.0).and_then(|(_, vector, _)| *vector)
    }

    /// Its origin in words; the direction or the place, if it has one, follows them.
    #[must_use]
    pub fn origin(self) -> &'static str {
        Self::ALL.iter().find(|(name, ..)| *name == self.0).map_or("", |(.., origin)| *origin)
    }

    /// Name of the first kind with a vector of this key.
    #[must_use]
    pub fn with_vector(key: &str) -> Option<&'static str> {
        Self::ALL.iter().find(|(_, vector, _)| *vector == Some(key)).map(|(name, ..)| *name)
    }
}

impl Default for LightKind {
    fn default() -> Self {
        Placement::Headlight.kind()
    }
}

impl<'de> serde::Deserialize<'de> for LightKind {
    fn deserialize<D: serde::Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        const NAMES: [&str; LightKind::ALL.len()] = {
            let mut names = [""; LightKind::ALL.len()];
            let mut i = 0;
            while i < names.len() {
                names[i] = LightKind::ALL[i].0;
                i += 1;
            }
            names
        };
        let stated = <std::borrow::Cow<'de, str>>::deserialize(from)?;
        let known = NAMES.iter().find(|name| **name == stated);
        known.map(|name| Self(name)).ok_or_else(|| serde::de::Error::unknown_variant(&stated, &NAMES))
    }
}

/// Origin of light that arrives at a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// All directions evenly.
    Everywhere,
    /// The eye.
    Eye,
    /// Infinity: one direction everywhere.
    Infinity,
    /// A place.
    Place,
}

impl Placement {
    /// Its kind.
    #[must_use]
    pub const fn kind(self) -> LightKind {
        LightKind(match self {
            Self::Ambient => "ambient",
            Self::Headlight => "headlight",
            Self::Directional(_) => "directional",
            Self::Point(_) => "point",
            Self::ThreePoint => "three_point",
        })
    }

    /// Its direction or point.
    #[must_use]
    pub const fn vector(self) -> Option<DVec3> {
        match self {
            Self::Directional(vector) | Self::Point(vector) => Some(vector),
            Self::Ambient | Self::Headlight | Self::ThreePoint => None,
        }
    }

    /// The placement of a `kind` with this direction or point; `None` if the kind has another number of vectors.
    #[must_use]
    pub fn of(kind: LightKind, vector: Option<DVec3>) -> Option<Self> {
        let at = vector.unwrap_or_default();
        let all = [Self::Ambient, Self::Headlight, Self::Directional(at), Self::Point(at), Self::ThreePoint];
        let of_kind = |placement: &Self| placement.kind() == kind && placement.vector().is_some() == vector.is_some();
        all.into_iter().find(of_kind)
    }

    /// The directions of light from here: one accumulator has them all.
    #[must_use]
    pub const fn directions(self) -> &'static [Direction] {
        match self {
            Self::Ambient => &[Direction::Everywhere],
            Self::Headlight => &[Direction::Eye],
            Self::Directional(_) => &[Direction::Infinity],
            Self::Point(_) => &[Direction::Place],
            Self::ThreePoint => &[Direction::Infinity; THREE_POINT.len()],
        }
    }

    /// World vectors of [`Self::directions`], unit vectors towards infinity or places, and their weights, as seen in `view`.
    /// Without a view, three-point light comes from nowhere.
    #[must_use]
    pub fn vectors(self, view: Option<&View>) -> Vec<(DVec3, f64)> {
        match self {
            Self::Ambient | Self::Headlight => vec![(DVec3::ZERO, 1.0)],
            Self::Directional(vector) | Self::Point(vector) => vec![(vector, 1.0)],
            Self::ThreePoint => view.map_or([(DVec3::ZERO, 0.0); THREE_POINT.len()], three_point).to_vec(),
        }
    }

    /// True if its directions, several of them, turn with the camera.
    #[must_use]
    pub const fn turns(self) -> bool {
        matches!(self, Self::ThreePoint)
    }

    /// True if it moves with the camera: its directions turn, or it is at the eye.
    #[must_use]
    pub fn follows_camera(self) -> bool {
        self.turns() || self.directions().contains(&Direction::Eye)
    }

    /// The same light as the medium sees it: a light at the eye has a place, or a direction, of its own.
    #[must_use]
    pub fn seen_from_medium(self, view: Option<&View>) -> Self {
        match (self, view) {
            (Self::Headlight, Some(view)) if view.parallel => Self::Directional(-view.forward),
            (Self::Headlight, Some(view)) => Self::Point(view.eye),
            (placement, _) => placement,
        }
    }

    /// Sum of the weights: the largest diffuse and specular shade. Where nothing shades, a light has the shade 1, and each
    /// of its directions its part of this sum.
    #[must_use]
    pub fn largest_shade(self) -> f64 {
        match self {
            Self::ThreePoint => THREE_POINT.iter().map(|(_, weight)| weight).sum(),
            Self::Ambient | Self::Headlight | Self::Directional(_) | Self::Point(_) => 1.0,
        }
    }
}

/// A light position that shading can distinguish from the others; it has an accumulator of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Position {
    /// Name of its first light.
    pub name: String,
    /// Origin of the light.
    pub placement: Placement,
    /// Whether it casts shadows.
    pub shadows: bool,
    /// Indices into [`Scene::lights`].
    pub lights: Vec<usize>,
}

/// The positions of a scene: ambient first, then headlight, directional, point and three-point. Of each kind, those
/// without shadows come first, in the order of the scene.
/// Lights whose shading no material can distinguish share a position, and an unshaded scene without shadows and phase
/// functions has at most one.
#[must_use]
pub fn positions(scene: &Scene) -> Vec<Position> {
    let mut positions: Vec<Position> = Vec::new();
    for (index, light) in scene.lights.iter().enumerate() {
        let shadows = scene.casts_shadows(index);
        // Shadows distinguish all directions: from either side of a surface, and without shading.
        let placement = if shadows { light.placement } else { canonical(scene, light.placement) };
        match positions.iter_mut().find(|position| position.placement == placement && position.shadows == shadows) {
            Some(position) => position.lights.push(index),
            None => positions.push(Position { name: light.name.clone(), placement, shadows, lights: vec![index] }),
        }
    }
    positions.sort_by_key(|position| {
        let kind = match position.placement {
            Placement::Ambient => 0,
            Placement::Headlight => 1,
            Placement::Directional(_) => 2,
            Placement::Point(_) => 3,
            Placement::ThreePoint => 4,
        };
        (kind, position.shadows)
    });
    positions
}

/// A common placement for all placements that shade every material of the scene equally.
fn canonical(scene: &Scene, placement: Placement) -> Placement {
    let flat = |material: &super::Material| material.diffuse == 0.0 && material.specular == 0.0;
    let white = |material: &super::Material| flat(material) && material.ambient >= 1.0;
    let mut shown = scene.materials.iter().enumerate().filter(|&(i, _)| scene.shows(i)).map(|(_, material)| material);
    if scene.has_phases() {
        return placement;
    }
    if scene.shading == Shading::None || scene.blending.is_extreme() || shown.clone().all(white) {
        return Placement::Ambient;
    }
    if placement == Placement::Ambient {
        return placement;
    }
    if shown.clone().all(flat) {
        return Placement::Headlight;
    }
    let placement = match (placement, parallel_forward(&scene.camera)) {
        (Placement::Headlight, Some(forward)) => Placement::Directional(-forward),
        (placement, _) => placement,
    };
    let opposite_is_equal = scene.lighting == Lighting::TwoSided && shown.all(|material| material.specular == 0.0);
    match placement {
        Placement::Directional(direction) if opposite_is_equal && first_sign(direction) < 0.0 => {
            Placement::Directional(-direction)
        }
        placement => placement,
    }
}

/// Line of sight of an orthographic camera with an eye and a target; its headlight is a directional light.
fn parallel_forward(camera: &Camera) -> Option<DVec3> {
    match (camera.projection, camera.aim) {
        (Projection::Orthographic { .. }, super::Aim::LookAt { position, target }) => {
            (target - position).try_normalize()
        }
        _ => None,
    }
}

/// The first non-zero component; 0 if there is none.
fn first_sign(direction: DVec3) -> f64 {
    direction.to_array().into_iter().find(|&component| component != 0.0).unwrap_or(0.0)
}

/// Spectra with weights and positions. Post-illumination applies a mix to accumulators.
#[derive(Clone, Debug, PartialEq)]
pub struct Mix(pub Vec<MixLight>);

/// One light of a mix.
#[derive(Clone, Debug, PartialEq)]
pub struct MixLight {
    /// Display name.
    pub name: String,
    /// Its spectrum.
    pub spectrum: Light,
    /// Factor of the spectrum.
    pub weight: f64,
    /// Index of its light position.
    pub position: usize,
}

impl MixLight {
    /// Whether `other` is the same light of a scene, with any weight.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        (&self.name, self.position) == (&other.name, other.position)
    }
}

impl Mix {
    /// The same lights scaled by `master`; with `normalise`, so that a white surface has the luminance `master`.
    #[must_use]
    pub fn mastered(mut self, normalise: bool, master: f64) -> Self {
        let luminance: f64 = self.0.iter().map(|light| light.weight * light.spectrum.luminance()).sum();
        let whole = if normalise && luminance > 0.0 { luminance } else { 1.0 };
        for light in &mut self.0 {
            light.weight = light.weight * master / whole;
        }
        self
    }

    /// The sum of weight · spectrum at each of `positions` positions, and the sum over all of them.
    #[must_use]
    pub fn light_at(&self, positions: usize) -> (Vec<Spectrum>, Spectrum) {
        let nothing = Spectrum::constant(0.0);
        let (mut at, mut all) = (vec![nothing.clone(); positions], nothing);
        for light in &self.0 {
            let weighted = light.spectrum.spectrum().scaled(light.weight);
            if let Some(sum) = at.get_mut(light.position) {
                *sum = &*sum + &weighted;
            }
            all = &all + &weighted;
        }
        (at, all)
    }

    /// Whether each of its lights is one of `stated`, at the position that it has there.
    #[must_use]
    pub fn is_of(&self, stated: &Self) -> bool {
        let is_stated = |light: &MixLight| stated.0.iter().any(|one| one.is_same(light));
        self.0.iter().all(is_stated)
    }

    /// The mix stated by the scene.
    #[must_use]
    pub fn of_scene(scene: &Scene) -> Self {
        let mut mix = Vec::new();
        for (position, place) in positions(scene).iter().enumerate() {
            for light in place.lights.iter().filter_map(|&light| scene.lights.get(light)) {
                let (name, spectrum) = (light.name.clone(), light.spectrum.clone());
                mix.push(MixLight { name, spectrum, weight: light.intensity, position });
            }
        }
        Self(mix)
    }
}
