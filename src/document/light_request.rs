//! Light requests, `NAME[@POSITION][=WEIGHT]`: a mix in place of the scene's.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::SceneError;
use super::error::chain;
use crate::scene::{INTENSITY, Mix, MixLight};
use crate::spectrum::standard::names;
use crate::spectrum::{Kind, Light, SpectrumSource, nearest};

/// The mix of `requests` in place of `stated`. A name is a light of `stated`, then a standard, then a spectrum file
/// below `base`. Of several readings of a request, the one with the fewest parts counts whose name and position exist.
/// A light of `stated` keeps its position and multiplies its weight; any other light goes to every position. A request
/// with a position overrides both.
///
/// # Errors
///
/// [`SceneError::LightRequest`] for a missing name or position.
pub fn requested(
    stated: &Mix,
    positions: &[String],
    requests: &[LightRequest],
    base: &Path,
) -> Result<Mix, SceneError> {
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
        let named =
            match request.position {
                None => None,
                Some(name) => Some(place(name).ok_or_else(|| {
                    fail(format!("there is no position {name:?}; there are: {}", positions.join(", ")))
                })?),
            };
        let known: Vec<&MixLight> = stated.0.iter().filter(|light| light.name == request.name).collect();
        if known.is_empty() {
            let spectrum = source_of(request.name).light(base).map_err(|error| {
                let lights: Vec<_> = stated.0.iter().map(|light| light.name.as_str()).collect();
                let known = || lights.iter().copied();
                let near = nearest(request.name, known().chain(names(Kind::Light).iter().copied()));
                match near.filter(|near| lights.contains(near)) {
                    Some(near) => fail(format!(
                        "there is no light {:?}; did you mean {near:?} of the scene? Its lights are {}; otherwise: {}",
                        request.name,
                        lights.join(", "),
                        chain(&error)
                    )),
                    None => fail(format!(
                        "there is no light {:?} in the scene; its lights are {}; otherwise: {}",
                        request.name,
                        lights.join(", "),
                        chain(&error)
                    )),
                }
            })?;
            warn_below_zero(&format!("the light {}", request.name), &spectrum);
            if positions.is_empty() {
                return Err(fail(
                    "the scene has no lights, so there is no light position from which this light could shine".into(),
                ));
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
    Ok(Mix(mix))
}

/// Warns of a light with negative samples.
pub(super) fn warn_below_zero(key: &str, light: &Light) {
    if light.spectrum().samples().iter().any(|&sample| sample < 0.0) {
        tracing::warn!("{key} is negative at some wavelengths; no real light is. It is used unchanged");
    }
}

/// The spectrum of a request.
fn source_of(name: &str) -> SpectrumSource {
    let Ok(source) = name.parse();
    source
}

/// `NAME[@POSITION][=WEIGHT]` as given. Names may contain `@` and `=`, so the meaning depends on the existing names.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LightRequest(pub String);

/// A reading of a [`LightRequest`].
#[derive(Clone, Copy, Debug, PartialEq)]
struct Reading<'a> {
    /// A light of the scene, a standard, or a spectrum file.
    name: &'a str,
    /// A light position, if named.
    position: Option<&'a str>,
    /// Weight; 1 if none is given.
    weight: f64,
}

impl FromStr for LightRequest {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        Ok(Self(text.to_owned()))
    }
}

impl LightRequest {
    /// Candidate files below `base` if no light of the scene has the name; they need not exist.
    #[must_use]
    pub fn files(&self, base: &Path) -> Vec<PathBuf> {
        self.readings().iter().filter_map(|reading| source_of(reading.name).file(base)).collect()
    }

    /// The first reading that satisfies `is_there`, otherwise the plain one, for its message.
    fn read(&self, is_there: impl Fn(&Reading<'_>) -> bool) -> Result<Reading<'_>, String> {
        match self.readings().into_iter().find(is_there) {
            Some(reading) => Ok(reading),
            None => self.plain(),
        }
    }

    /// All readings, starting with the whole text as a name.
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

    /// The reading in which names contain neither `@` nor `=`.
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
