//! Named spectra: standard illuminants, typical lamps, black bodies and the `ColorChecker`.

use std::sync::LazyLock;

use relume_base::number::edit_distance;

use super::{BANDS, Kind, Light, Reflectance, Spectrum, SpectrumError, data};

/// Columns of `illuminants_5nm.csv`, then those of `led_5nm.csv`.
const ILLUMINANTS: [&str; 16] = [
    "A", "D65", "D50", "E", "FL2", "FL7", "FL11", "LED-B1", "LED-B3", "LED-B5", "LED-BH1", "LED-RGB1", "LED-V1",
    "LED-B2", "LED-B4", "LED-V2",
];
const PATCHES: [&str; 24] = [
    "dark skin",
    "light skin",
    "blue sky",
    "foliage",
    "blue flower",
    "bluish green",
    "orange",
    "purplish blue",
    "moderate red",
    "purple",
    "yellow green",
    "orange yellow",
    "blue",
    "green",
    "red",
    "yellow",
    "magenta",
    "cyan",
    "white 9.5",
    "neutral 8",
    "neutral 6.5",
    "neutral 5",
    "neutral 3.5",
    "black 2",
];

static ILLUMINANT_POWERS: [[f64; BANDS]; 13] = data::columns(include_str!("../../../data/spectra/illuminants_5nm.csv"));
static LED_POWERS: [[f64; BANDS]; 3] = data::columns(include_str!("../../../data/spectra/led_5nm.csv"));
static PATCH_REFLECTANCES: [[f64; BANDS]; 24] =
    data::columns(include_str!("../../../data/spectra/colorchecker_ohta1997_5nm.csv"));

/// A named standard spectrum.
#[derive(Clone, Debug, PartialEq)]
pub enum Standard {
    /// Published relative powers of an illuminant or a lamp.
    Light(Spectrum),
    /// Reflectance of a `ColorChecker` patch.
    Reflectance(Spectrum),
    /// Black body of this temperature in kelvin; the range is not checked.
    Blackbody(f64),
}

impl Standard {
    /// Kind of the spectrum.
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Light(_) | Self::Blackbody(_) => Kind::Light,
            Self::Reflectance(_) => Kind::Reflectance,
        }
    }
}

/// Returns the standard called `name`, if it exists.
///
/// Lights are [`names`]`(Kind::Light)` and `blackbody T`, with T in kelvin (`blackbody 2856` or `blackbody 2856K`);
/// reflectances are the 24 patches of the `ColorChecker`. Case, blanks, `_` and `-` (except the sign of T) are ignored,
/// as is text in brackets after a name (`white 9.5 (.05 D)`).
pub fn find(name: &str) -> Option<Standard> {
    let wanted = key(name);
    let position = |names: &[&str]| names.iter().position(|name| key(name) == wanted);
    let powers = |index| ILLUMINANT_POWERS.iter().chain(&LED_POWERS).nth(index);
    if let Some(&powers) = position(&ILLUMINANTS).and_then(powers) {
        return Some(Standard::Light(Spectrum::from_samples(powers)));
    }
    if let Some(index) = position(&PATCHES) {
        return Some(Standard::Reflectance(Spectrum::from_samples(PATCH_REFLECTANCES[index])));
    }
    let (_, temperature) = without_brackets(name).split_once(['y', 'Y']).filter(|_| wanted.starts_with("blackbody"))?;
    let temperature = temperature.trim_matches(BLANKS);
    let kelvin = temperature.strip_suffix(['k', 'K']).unwrap_or(temperature).trim_end_matches(BLANKS);
    kelvin.parse().ok().map(Standard::Blackbody)
}

/// Returns the light called `name`; see [`find`].
///
/// # Errors
///
/// [`SpectrumError::NoStandard`] when no light has this name, [`SpectrumError::Temperature`] for a black body colder
/// than 100 K.
pub fn light(name: &str) -> Result<Light, SpectrumError> {
    match find(name) {
        Some(Standard::Light(powers)) => Light::new(powers),
        Some(Standard::Blackbody(kelvin)) => Light::blackbody(kelvin),
        Some(Standard::Reflectance(_)) | None => Err(no_standard(name, Kind::Light)),
    }
}

/// Returns the reflectance called `name`; see [`find`].
///
/// # Errors
///
/// [`SpectrumError::NoStandard`] when no reflectance has this name.
pub fn reflectance(name: &str) -> Result<Reflectance, SpectrumError> {
    match find(name) {
        Some(Standard::Reflectance(samples)) => Reflectance::new(samples),
        Some(Standard::Light(_) | Standard::Blackbody(_)) | None => Err(no_standard(name, Kind::Reflectance)),
    }
}

/// CIE standard illuminant D65.
pub fn d65() -> &'static Light {
    static D65: LazyLock<Light> = LazyLock::new(|| Light::normalised(Spectrum::from_samples(ILLUMINANT_POWERS[1])));
    &D65
}

/// Names of all standards of one kind, in the order of the published tables; empty for absorptions.
pub const fn names(kind: Kind) -> &'static [&'static str] {
    match kind {
        Kind::Light => &ILLUMINANTS,
        Kind::Reflectance => &PATCHES,
        Kind::Absorption => &[],
    }
}

/// Returns the name of the standard of this kind with exactly this spectrum, if it exists.
pub fn name_of(spectrum: &Spectrum, kind: Kind) -> Option<&'static str> {
    type Named = Vec<(&'static str, Spectrum)>;
    static LIGHTS: LazyLock<Named> = LazyLock::new(|| {
        ILLUMINANTS.iter().filter_map(|name| Some((*name, light(name).ok()?.spectrum().clone()))).collect()
    });
    static REFLECTANCES: LazyLock<Named> = LazyLock::new(|| {
        PATCHES.iter().filter_map(|name| Some((*name, reflectance(name).ok()?.spectrum().clone()))).collect()
    });
    let named: &[(&str, Spectrum)] = match kind {
        Kind::Light => &LIGHTS,
        Kind::Reflectance => &REFLECTANCES,
        Kind::Absorption => &[],
    };
    named.iter().find(|(_, known)| known == spectrum).map(|(name, _)| *name)
}

/// Part of a sentence for error messages: the standard of this kind with a similar name, else all names.
pub fn hint(name: &str, kind: Kind) -> String {
    let names = names(kind);
    if name.starts_with('#') && kind == Kind::Reflectance {
        return format!("write the colour as {{ srgb = {name:?} }}");
    }
    match nearest(name, names.iter().copied()) {
        Some(nearest) => format!("did you mean {nearest:?}?"),
        _ if kind == Kind::Light => format!("the standards are {}, and \"blackbody 2856\"", names.join(", ")),
        _ if names.is_empty() => format!("no standard spectrum is {kind}; give a file, a table or a number"),
        _ => format!("the standards are {}", names.join(", ")),
    }
}

/// Returns the entry of `names` most similar to `name`, if it is similar enough.
pub fn nearest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let wanted = key(name);
    let (distance, nearest) = names.map(|name| (edit_distance(&wanted, &key(name)), name)).min()?;
    (distance <= (wanted.len() / 2).max(2)).then_some(nearest)
}

fn no_standard(name: &str, kind: Kind) -> SpectrumError {
    SpectrumError::NoStandard { name: name.to_owned(), kind, hint: hint(name, kind) }
}

/// Normalised spelling of a name: lower case, without brackets, blanks, `_` and `-`.
fn key(name: &str) -> String {
    let bare = without_brackets(name).chars().filter(|letter| *letter != '-' && !BLANKS.contains(letter));
    bare.flat_map(char::to_lowercase).collect()
}

/// Word separators.
const BLANKS: [char; 2] = [' ', '_'];

fn without_brackets(name: &str) -> &str {
    name.split('(').next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_standard_is_known_by_its_spectrum() {
        for name in ILLUMINANTS {
            assert_eq!(light(name).ok().and_then(|found| name_of(found.spectrum(), Kind::Light)), Some(name));
        }
        for name in PATCHES {
            assert_eq!(
                reflectance(name).ok().and_then(|found| name_of(found.spectrum(), Kind::Reflectance)),
                Some(name)
            );
        }
        assert_eq!(name_of(&Spectrum::constant(0.123), Kind::Reflectance), None);
    }

    #[test]
    fn the_names_are_the_columns_of_the_tables() {
        for (names, csv) in [
            (&ILLUMINANTS[..13], include_str!("../../../data/spectra/illuminants_5nm.csv")),
            (&ILLUMINANTS[13..], include_str!("../../../data/spectra/led_5nm.csv")),
            (&PATCHES[..], include_str!("../../../data/spectra/colorchecker_ohta1997_5nm.csv")),
        ] {
            let header = csv.lines().find(|line| !line.starts_with('#')).unwrap_or_default();
            let columns: Vec<String> = header.split(',').skip(1).map(key).collect();
            let names: Vec<String> = names.iter().map(|name| key(name)).collect();
            assert_eq!(columns, names);
        }
    }
}
