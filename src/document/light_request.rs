//! Light requests, `NAME[@POSITION][=WEIGHT]`: a mix in place of the scene's.

use std::convert::Infallible;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::SceneError;
use super::error::chain;
use relume_colour::spectrum::standard::names;
use relume_colour::spectrum::{Kind, Light, SpectrumSource, nearest};
use relume_scene::{INTENSITY, Mix, MixLight};

/// A mix by requests.
#[derive(Clone, Debug, PartialEq)]
pub struct Requested {
    /// The mix.
    pub mix: Mix,
    /// Requested lights that the scene does not have and that no position was named for, in the order of the requests.
    pub placed: Vec<Placed>,
}

/// A light in place of a mix.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// Name of the light.
    pub name: String,
    /// The mix whose positions and shares it has.
    pub shares: Shares,
    /// Names of its positions, each with its weight there.
    pub weights: Vec<(String, f64)>,
}

/// The mix whose positions and shares a light has that the scene does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shares {
    /// The mix of the picture.
    Shown,
    /// The lights of the scene at their intensities: in the mix of the picture no light is on.
    Stated,
    /// Every position alike: no light of the scene has an intensity above 0.
    Everywhere,
}

/// The mix of `requests` in place of `shown`, the mix of the picture so far; `stated` is that of the scene. A name is a
/// light of `stated`, then a standard, then a spectrum file below `base`. Of several readings of a request, the one with
/// the fewest parts counts whose name and position exist. A light of `stated` keeps its position and multiplies its
/// weight. Any other light has the positions of `shown`, and at each the sum of its weights: a picture keeps its
/// brightness and shadows. A request with a position overrides both.
///
/// # Errors
///
/// [`SceneError::LightRequest`] for a missing name or position.
pub fn requested(
    stated: &Mix,
    shown: &Mix,
    positions: &[String],
    requests: &[LightRequest],
    base: &Path,
) -> Result<Requested, SceneError> {
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
    let mut placed = Vec::new();
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
                        "there is no light {:?} in the scene; its lights are {}, and one in another colour is NAME:#RRGGBB; otherwise: {}",
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
            let light = MixLight {
                name: request.name.to_owned(),
                spectrum,
                weight: request.weight,
                position: named.unwrap_or(0),
            };
            match named {
                Some(_) => mix.push(light),
                None => {
                    let (lights, how) = spread(light, stated, shown, positions);
                    placed.push(how);
                    mix.extend(lights);
                }
            }
        }
        for light in known {
            let position = named.unwrap_or(light.position);
            mix.push(MixLight { weight: light.weight * request.weight, position, ..light.clone() });
        }
    }
    Ok(Requested { mix: Mix(mix), placed })
}

/// A `light` that the scene does not have, at the positions of the lights that are on, and how: at each position with its
/// weight times the sum of theirs.
#[must_use]
pub fn spread(light: MixLight, stated: &Mix, shown: &Mix, positions: &[String]) -> (Vec<MixLight>, Placed) {
    let (shares, weights) = shares(shown, stated, positions.len());
    let lights = weights.into_iter().map(|(position, share)| MixLight {
        weight: share * light.weight,
        position,
        ..light.clone()
    });
    let lights: Vec<MixLight> = lights.collect();
    let at = |light: &MixLight| Some((positions.get(light.position)?.clone(), light.weight));
    let weights = lights.iter().filter_map(at).collect();
    (lights, Placed { name: light.name, shares, weights })
}

/// Positions of the lights that are on, each with the sum of their weights: those of `shown`, or else of `stated`, or
/// else all of the `count` positions.
fn shares(shown: &Mix, stated: &Mix, count: usize) -> (Shares, Vec<(usize, f64)>) {
    let at = |mix: &Mix, position: usize| -> f64 {
        mix.0.iter().filter(|light| light.position == position).map(|light| light.weight).sum()
    };
    let of = |mix: &Mix| -> Vec<(usize, f64)> {
        (0..count).map(|position| (position, at(mix, position))).filter(|&(_, weight)| weight > 0.0).collect()
    };
    for (shares, mix) in [(Shares::Shown, shown), (Shares::Stated, stated)] {
        let weights = of(mix);
        if !weights.is_empty() {
            return (shares, weights);
        }
    }
    (Shares::Everywhere, (0..count).map(|position| (position, 1.0)).collect())
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

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use relume_colour::spectrum::standard;

    fn mix(lights: &[(&str, f64, usize)]) -> Mix {
        let light = |&(name, weight, position): &(&str, f64, usize)| MixLight {
            name: name.to_owned(),
            spectrum: standard::light("A").unwrap(),
            weight,
            position,
        };
        Mix(lights.iter().map(light).collect())
    }

    fn asked(shown: &[(&str, f64, usize)], request: &str) -> (Vec<(String, f64, usize)>, Vec<Placed>) {
        let stated = mix(&[("sun", 2.0, 0), ("glow", 0.5, 1), ("moon", 0.25, 1), ("off", 0.0, 2)]);
        let positions = ["sun", "sky", "lamp"].map(str::to_owned);
        let requests: Vec<LightRequest> = request.split(' ').map(|text| LightRequest(text.to_owned())).collect();
        let Requested { mix, placed } = requested(&stated, &mix(shown), &positions, &requests, Path::new("")).unwrap();
        (mix.0.into_iter().map(|light| (light.name, light.weight, light.position)).collect(), placed)
    }

    #[test]
    fn a_foreign_light_has_the_positions_and_weights_of_the_picture() {
        let is = |light: &str, weight: f64, position: usize| (light.to_owned(), weight, position);
        // One light is on: brightness and shadows are those of this one.
        let (found, placed) = asked(&[("sun", 1.5, 0)], "D65");
        assert_eq!(found, [is("D65", 1.5, 0)]);
        let weights = vec![("sun".to_owned(), 1.5)];
        assert_eq!(placed, [Placed { name: "D65".to_owned(), shares: Shares::Shown, weights }]);
        // Lights of one position add up, and a weight multiplies them.
        let shown = [("sun", 0.0, 0), ("glow", 0.75, 1), ("moon", 0.5, 1)];
        assert_eq!(asked(&shown, "D50=2").0, [is("D50", 2.5, 1)]);
        assert_eq!(asked(&shown, "D50=0.5 A=0.5").0, [is("D50", 0.625, 1), is("A", 0.625, 1)]);
        // Lights of the scene keep their own position and intensity, and a stated position has the plain weight.
        let (found, placed) = asked(&shown, "sun=0.5 D65@lamp=3");
        assert_eq!(found, [is("sun", 1.0, 0), is("D65", 3.0, 2)]);
        assert_eq!(placed, [], "nothing to tell");
        // Without any light on, those of the scene count.
        let (found, placed) = asked(&[("sun", 0.0, 0)], "E");
        assert_eq!(found, [is("E", 2.0, 0), is("E", 0.75, 1)]);
        assert_eq!(placed[0].shares, Shares::Stated);
    }

    #[test]
    fn a_foreign_light_shines_from_everywhere_where_no_light_has_an_intensity() {
        let positions = ["sun", "sky"].map(str::to_owned);
        let none = mix(&[("sun", 0.0, 0), ("sky", 0.0, 1)]);
        let found = requested(&none, &none, &positions, &[LightRequest("D65=3".to_owned())], Path::new("")).unwrap();
        let weights = vec![("sun".to_owned(), 3.0), ("sky".to_owned(), 3.0)];
        assert_eq!(found.placed, [Placed { name: "D65".to_owned(), shares: Shares::Everywhere, weights }]);
    }
}
