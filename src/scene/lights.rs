//! Light positions, and the mixes of spectra that shine from them.

use std::convert::Infallible;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::DVec3;

use super::{Camera, Projection, Scene, SceneError, Shading};
use crate::spectrum::{Light, Spectrum, SpectrumSource};

/// What the spectrum of a light can be multiplied by.
pub(super) const INTENSITY: RangeInclusive<f64> = 0.0..=1e9;

/// Where a light shines from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Placement {
    /// From everywhere: its shade is 1.
    Ambient,
    /// From the eye, along each ray.
    Headlight,
    /// From infinity; the unit vector points towards the light, in world space.
    Directional(DVec3),
    /// From a point of the world, without falling off.
    Point(DVec3),
}

/// A light position that shading can tell from the others: it gets an accumulator of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Position {
    /// Named for the first of its lights.
    pub name: String,
    /// Where.
    pub placement: Placement,
    /// Indices into [`Scene::lights`].
    pub lights: Vec<usize>,
}

/// The positions of a scene: ambient first, then the headlight, directional ones and points, each kind in the order of
/// the scene. Lights whose shading no material can tell apart share one, and an unshaded scene has at most one.
#[must_use]
pub fn positions(scene: &Scene) -> Vec<Position> {
    let mut positions: Vec<Position> = Vec::new();
    for (index, light) in scene.lights.iter().enumerate() {
        let placement = canonical(scene, light.placement);
        match positions.iter_mut().find(|position| position.placement == placement) {
            Some(position) => position.lights.push(index),
            None => positions.push(Position { name: light.name.clone(), placement, lights: vec![index] }),
        }
    }
    positions.sort_by_key(|position| match position.placement {
        Placement::Ambient => 0,
        Placement::Headlight => 1,
        Placement::Directional(_) => 2,
        Placement::Point(_) => 3,
    });
    positions
}

/// One placement for all those that give every material of the scene the same shade.
fn canonical(scene: &Scene, placement: Placement) -> Placement {
    let flat = |material: &super::Material| material.diffuse == 0.0 && material.specular == 0.0;
    let white = |material: &super::Material| flat(material) && material.ambient >= 1.0;
    let mut shown = scene.materials.iter().enumerate().filter(|&(i, _)| scene.shows(i)).map(|(_, material)| material);
    if scene.shading == Shading::None || shown.clone().all(white) {
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
    let opposite_is_equal = shown.all(|material| material.specular == 0.0);
    match placement {
        Placement::Directional(direction) if opposite_is_equal && first_sign(direction) < 0.0 => {
            Placement::Directional(-direction)
        }
        placement => placement,
    }
}

/// Where a camera of parallel rays, stated by eye and target, looks: its headlight is a directional light.
fn parallel_forward(camera: &Camera) -> Option<DVec3> {
    match (camera.projection, camera.aim) {
        (Projection::Orthographic { .. }, super::Aim::LookAt { position, target }) => {
            (target - position).try_normalize()
        }
        _ => None,
    }
}

/// The first component that is not zero.
fn first_sign(direction: DVec3) -> f64 {
    direction.to_array().into_iter().find(|&component| component != 0.0).unwrap_or(0.0)
}

/// Which spectra shine with what weight from which positions. Post-illumination is a mix applied to accumulators.
#[derive(Clone, Debug, PartialEq)]
pub struct Mix(pub Vec<MixLight>);

/// One light of a mix.
#[derive(Clone, Debug, PartialEq)]
pub struct MixLight {
    /// For people.
    pub name: String,
    /// Its spectrum.
    pub spectrum: Light,
    /// What the spectrum is multiplied by.
    pub weight: f64,
    /// Index of its position.
    pub position: usize,
}

impl Mix {
    /// The sum of weight · spectrum at each of `positions` positions, and over all of them.
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

    /// The mix that the scene states.
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

    /// The mix that `requests` ask for in place of `stated`. A name is a light of `stated`, then a standard, then a
    /// spectrum file below `base`; of the ways to read a request the one with the fewest parts counts whose name and
    /// position are there. A stated light keeps its position and multiplies its weight, another goes to every
    /// position, unless one is named.
    ///
    /// # Errors
    ///
    /// [`SceneError::LightRequest`] for a name or position that is not there.
    pub fn requested(
        stated: &Self,
        positions: &[String],
        requests: &[LightRequest],
        base: &Path,
    ) -> Result<Self, SceneError> {
        let place = |name: &str| {
            let of_light = || stated.0.iter().find(|light| light.name == name).map(|light| light.position);
            positions.iter().position(|position| position == name).or_else(of_light)
        };
        let is_there = |reading: &Reading<'_>| {
            let is_spectrum = |name| source_of(name).file(base).is_none_or(|path| path.is_file());
            let named = stated.0.iter().any(|light| light.name == reading.name) || is_spectrum(reading.name);
            named && reading.position.is_none_or(|name| place(name).is_some())
        };
        let mut mix = Vec::new();
        for asked in requests {
            let fail = |message: String| SceneError::LightRequest { request: asked.0.clone(), message };
            let request = asked.read(is_there).map_err(fail)?;
            let named = match request.position {
                None => None,
                Some(name) => Some(place(name).ok_or_else(|| {
                    fail(format!("there is no position {name:?}; there are: {}", positions.join(", ")))
                })?),
            };
            let known: Vec<&MixLight> = stated.0.iter().filter(|light| light.name == request.name).collect();
            if known.is_empty() {
                let spectrum = source_of(request.name).light(base).map_err(|error| {
                    let lights: Vec<_> = stated.0.iter().map(|light| light.name.as_str()).collect();
                    fail(format!("{}; lights of the scene: {}", chain(&error), lights.join(", ")))
                })?;
                warn_below_zero(&format!("--light {}", request.name), &spectrum);
                if positions.is_empty() {
                    return Err(fail("there is no light position to put it at; the scene has no lights".into()));
                }
                for position in named.map_or(0..positions.len(), |position| position..position + 1) {
                    let name = request.name.to_owned();
                    mix.push(MixLight { name, spectrum: spectrum.clone(), weight: request.weight, position });
                }
            }
            for light in known {
                let position = named.unwrap_or(light.position);
                mix.push(MixLight { weight: light.weight * request.weight, position, ..light.clone() });
            }
        }
        Ok(Self(mix))
    }
}

/// Says which light takes light away.
pub(super) fn warn_below_zero(key: &str, light: &Light) {
    if light.spectrum().samples().iter().any(|&sample| sample < 0.0) {
        tracing::warn!("{key} is negative at some wavelengths, and no light is");
    }
}

/// An error and its causes in one line.
pub(super) fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}

/// A spectrum as the command line names it.
fn source_of(name: &str) -> SpectrumSource {
    let Ok(source) = name.parse();
    source
}

/// `NAME[@POSITION][=WEIGHT]`, as it is written. Names may hold both signs, so that what it means depends on what there
/// is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightRequest(pub String);

/// A way to read a [`LightRequest`].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reading<'a> {
    /// A light of the scene, a standard, or a spectrum file.
    name: &'a str,
    /// A light position, where one is named.
    position: Option<&'a str>,
    /// 1 where none is given.
    weight: f64,
}

impl FromStr for LightRequest {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.to_owned()))
    }
}

impl LightRequest {
    /// The files below `base` that it may mean, if no light of the scene has their name. They need not exist.
    #[must_use]
    pub fn files(&self, base: &Path) -> Vec<PathBuf> {
        self.readings().iter().filter_map(|reading| source_of(reading.name).file(base)).collect()
    }

    /// The first reading that `is_there`, else the plain one, for its message.
    fn read(&self, is_there: impl Fn(&Reading<'_>) -> bool) -> Result<Reading<'_>, String> {
        match self.readings().into_iter().find(is_there) {
            Some(reading) => Ok(reading),
            None => self.plain(),
        }
    }

    /// Every way to read it, the whole text as a name first.
    fn readings(&self) -> Vec<Reading<'_>> {
        let weighted = self.0.rsplit_once('=').and_then(|(rest, text)| Some((rest, weight(text).ok()?)));
        let mut readings = Vec::new();
        for (text, weight) in std::iter::once((&*self.0, 1.0)).chain(weighted) {
            readings.push(Reading { name: text.trim(), position: None, weight });
            let parts = text.match_indices('@').map(|(at, sign)| (&text[..at], &text[at + sign.len()..]));
            readings.extend(parts.map(|(name, position)| Reading {
                name: name.trim(),
                position: Some(position.trim()),
                weight,
            }));
        }
        readings
    }

    /// What it means where no name holds `@` or `=`.
    fn plain(&self) -> Result<Reading<'_>, String> {
        let (rest, weight) = match self.0.rsplit_once('=') {
            None => (&*self.0, 1.0),
            Some((rest, text)) => (rest, weight(text)?),
        };
        let (name, position) = match rest.rsplit_once('@') {
            None => (rest, None),
            Some((name, position)) => (name, Some(position.trim())),
        };
        if name.trim().is_empty() {
            return Err("a light needs a name: NAME[@POSITION][=WEIGHT]".into());
        }
        Ok(Reading { name: name.trim(), position, weight })
    }
}

fn weight(text: &str) -> Result<f64, String> {
    let number: f64 = text.trim().parse().map_err(|_| format!("the weight {text:?} is not a number"))?;
    if INTENSITY.contains(&number) {
        return Ok(number);
    }
    let [least, most] = [INTENSITY.start(), INTENSITY.end()];
    Err(format!("the weight {text} is not a number from {least} to {most}"))
}
