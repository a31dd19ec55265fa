//! Syntax of spectra in scenes and on the command line.

use std::convert::Infallible;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::Deserialize;
use serde::de::{self, MapAccess, Visitor};

use super::colour::{LinearSrgb, decode_srgb};
use super::kind::planck;
use super::standard::{self, Standard};
use super::{
    Absorption, BANDS, Column, Kind, Light, Reflectance, STEP_NM, Spectrum, SpectrumError, smooth_reflectance, table,
};

/// Description of a spectrum, parsed from a scene by `Deserialize` and from the command line by `FromStr`.
#[derive(Clone, Debug, PartialEq)]
pub enum SpectrumSource {
    /// A number: the same value at every wavelength.
    Constant(f64),
    /// A string: the name of a standard (see [`standard::find`]), else the path of a text file of two columns.
    Named(String),
    /// `{ 400 = 0.1, "532.5" = 0.3 }`: values at wavelengths in nm.
    Points(Vec<(f64, f64)>),
    /// `{ file = "x.csv", column = "flesh" }`: a column of a text file.
    File {
        /// File, relative to the base folder of the resolver.
        path: PathBuf,
        /// Column of the values; optional in a file of two columns.
        column: Option<Column>,
    },
    /// `{ gaussian = [{ centre = 550, sigma = 20, height = 0.8 }], base = 0.05 }`: sum of Gaussians and a constant.
    Gaussians {
        /// Gaussians to add.
        bands: Vec<Gaussian>,
        /// Constant, 0 by default.
        base: f64,
    },
    /// `{ srgb = "#rrggbb" }` or `{ linear_srgb = [r, g, b] }`: the smooth reflectance of a colour
    /// ([`smooth_reflectance`]).
    Colour(LinearSrgb),
    /// `{ samples = [81 numbers] }`: the samples on the grid.
    Samples(Box<Spectrum>),
    /// `{ blackbody = 2856 }`: light of a black body of this temperature in kelvin.
    Blackbody(f64),
}

/// A Gaussian; see [`Spectrum::gaussian`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gaussian {
    /// Wavelength of the peak in nm.
    pub centre: f64,
    /// Standard deviation in nm.
    pub sigma: f64,
    /// Height of the peak.
    pub height: f64,
}

impl SpectrumSource {
    /// Resolves the source to a reflectance; file names are relative to `base`.
    ///
    /// Tables are sampled by [`Spectrum::interpolate`].
    ///
    /// # Errors
    ///
    /// A [`SpectrumError`] when the source is not a reflectance, or a file cannot be read.
    pub fn reflectance(&self, base: &Path) -> Result<Reflectance, SpectrumError> {
        Reflectance::new(self.spectrum(base, Kind::Reflectance)?)
    }

    /// Resolves the source to a light; file names are relative to `base`.
    ///
    /// Tables with any spacing finer than the grid are sampled by [`Spectrum::box_average`], others by
    /// [`Spectrum::interpolate`].
    ///
    /// # Errors
    ///
    /// A [`SpectrumError`] when the source is not a light, or a file cannot be read.
    pub fn light(&self, base: &Path) -> Result<Light, SpectrumError> {
        Light::new(self.spectrum(base, Kind::Light)?)
    }

    /// Resolves the source to an absorption; file names are relative to `base`.
    ///
    /// Tables are sampled by [`Spectrum::interpolate`].
    ///
    /// # Errors
    ///
    /// A [`SpectrumError`] when the source is not an absorption, or a file cannot be read.
    pub fn absorption(&self, base: &Path) -> Result<Absorption, SpectrumError> {
        Absorption::new(self.spectrum(base, Kind::Absorption)?)
    }

    /// Path of the source's file, relative to `base`; `None` if the source is not a file. The file need not exist.
    #[must_use]
    pub fn file(&self, base: &Path) -> Option<PathBuf> {
        match self {
            Self::Named(name) if standard::find(name).is_none() => Some(base.join(name)),
            Self::File { path, .. } => Some(base.join(path)),
            _ => None,
        }
    }

    fn spectrum(&self, base: &Path, kind: Kind) -> Result<Spectrum, SpectrumError> {
        let of_kind = |is: Kind, name: &str| match is == kind {
            true => Ok(()),
            false => Err(SpectrumError::WrongKind { name: name.to_owned(), is, wanted: kind }),
        };
        match self {
            Self::Constant(value) => Ok(Spectrum::constant(*value)),
            Self::Named(name) => match standard::find(name) {
                Some(found) => {
                    of_kind(found.kind(), name)?;
                    match found {
                        Standard::Light(samples) | Standard::Reflectance(samples) => Ok(samples),
                        Standard::Blackbody(kelvin) => planck(kelvin),
                    }
                }
                None => from_file(&base.join(name), None, kind).map_err(|error| match error {
                    SpectrumError::Read { path, source } if source.kind() == io::ErrorKind::NotFound => {
                        SpectrumError::Unknown { name: name.clone(), path, hint: standard::hint(name, kind) }
                    }
                    other => other,
                }),
            },
            Self::Points(points) => sampled(points, kind),
            Self::File { path, column } => from_file(&base.join(path), column.as_ref(), kind),
            Self::Gaussians { bands, base } => sum_of_gaussians(bands, *base),
            Self::Colour(colour) => {
                of_kind(Kind::Reflectance, "an sRGB colour")?;
                Ok(smooth_reflectance(*colour)?.spectrum().clone())
            }
            Self::Samples(samples) => Ok(Spectrum::clone(samples)),
            Self::Blackbody(kelvin) => {
                of_kind(Kind::Light, "a black body")?;
                planck(*kelvin)
            }
        }
    }
}

impl FromStr for SpectrumSource {
    type Err = Infallible;

    /// Parses a finite number as [`Self::Constant`], any other text as [`Self::Named`].
    fn from_str(text: &str) -> Result<Self, Infallible> {
        match text.trim().parse::<f64>() {
            Ok(value) if value.is_finite() => Ok(Self::Constant(value)),
            _ => Ok(Self::Named(text.to_owned())),
        }
    }
}

fn from_file(path: &Path, column: Option<&Column>, kind: Kind) -> Result<Spectrum, SpectrumError> {
    let points = table::read(path, column)?;
    sampled(&points, kind).map_err(|source| SpectrumError::File { path: path.into(), source: Box::new(source) })
}

fn sampled(points: &[(f64, f64)], kind: Kind) -> Result<Spectrum, SpectrumError> {
    let mut wavelengths: Vec<f64> = points.iter().map(|point| point.0).collect();
    wavelengths.sort_by(f64::total_cmp);
    // Tolerates rounding of 1e-6 nm in wavelengths such as 380.1, 385.1, ….
    let is_finer = wavelengths.windows(2).any(|pair| pair[1] - pair[0] < STEP_NM - 1e-6);
    if kind == Kind::Light && is_finer { Spectrum::box_average(points) } else { Spectrum::interpolate(points) }
}

fn sum_of_gaussians(bands: &[Gaussian], base: f64) -> Result<Spectrum, SpectrumError> {
    bands.iter().try_fold(Spectrum::constant(base), |sum, band| {
        Ok(&sum + &Spectrum::gaussian(band.centre, band.sigma, band.height)?)
    })
}

/// Parses `#rrggbb` into red, green and blue.
///
/// # Errors
///
/// [`SpectrumError::ColourCode`] for any other text.
pub fn srgb_code(text: &str) -> Result<[u8; 3], SpectrumError> {
    let wrong = || SpectrumError::ColourCode { text: text.to_owned() };
    let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii()).ok_or_else(wrong)?;
    if !digits.bytes().all(|digit| digit.is_ascii_hexdigit()) {
        return Err(wrong());
    }
    let code = u32::from_str_radix(digits, 16).map_err(|_| wrong())?;
    let [_, rgb @ ..] = code.to_be_bytes();
    Ok(rgb)
}

/// Accepted forms, for error messages.
const FORMS: &str = "a spectrum: a number, a name such as \"D65\" or \"dark skin\", a file, or one of the tables \
                     { 400 = 0.1, 500 = 0.3 }, { file, column }, { gaussian, base }, { srgb }, { linear_srgb }, \
                     { samples }, { blackbody }";

impl<'de> Deserialize<'de> for SpectrumSource {
    fn deserialize<D: de::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SourceVisitor)
    }
}

struct SourceVisitor;

impl<'de> Visitor<'de> for SourceVisitor {
    type Value = SpectrumSource;

    fn expecting(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(FORMS)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<SpectrumSource, E> {
        if !value.is_finite() {
            return Err(E::custom(format!("a spectrum must be finite, not {value}")));
        }
        Ok(SpectrumSource::Constant(value))
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<SpectrumSource, E> {
        #[expect(clippy::cast_precision_loss, reason = "an integer past 2^53 is meant as the nearest number")]
        self.visit_f64(value as f64)
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<SpectrumSource, E> {
        Ok(SpectrumSource::Named(text.to_owned()))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<SpectrumSource, A::Error> {
        let mut form: Option<(String, SpectrumSource)> = None;
        let (mut column, mut base) = (None, None);
        while let Some(key) = map.next_key::<String>()? {
            let written = match key.as_str() {
                "column" => {
                    column = Some(map.next_value()?);
                    continue;
                }
                "base" => {
                    base = Some(map.next_value()?);
                    continue;
                }
                "file" => SpectrumSource::File { path: map.next_value()?, column: None },
                "gaussian" => SpectrumSource::Gaussians { bands: map.next_value()?, base: 0.0 },
                "srgb" => {
                    let code: String = map.next_value()?;
                    let code = srgb_code(&code).map_err(de::Error::custom)?;
                    SpectrumSource::Colour(LinearSrgb(code.map(|part| decode_srgb(f64::from(part) / 255.0))))
                }
                "linear_srgb" => SpectrumSource::Colour(LinearSrgb(map.next_value()?)),
                "samples" => {
                    let samples: Vec<f64> = map.next_value()?;
                    let samples: [f64; BANDS] = samples.try_into().map_err(|samples: Vec<f64>| {
                        de::Error::custom(SpectrumError::SampleCount { found: samples.len() })
                    })?;
                    SpectrumSource::Samples(Box::new(Spectrum::from_samples(samples)))
                }
                "blackbody" => SpectrumSource::Blackbody(map.next_value()?),
                key => {
                    let Ok(nm) = key.parse() else {
                        return Err(de::Error::custom(format!("unknown key `{key}` in {FORMS}")));
                    };
                    let Value::Number(value) = map.next_value()?;
                    if let Some((_, SpectrumSource::Points(points))) = &mut form {
                        points.push((nm, value));
                        continue;
                    }
                    SpectrumSource::Points(vec![(nm, value)])
                }
            };
            if let Some((other, _)) = &form {
                return Err(de::Error::custom(format!("`{other}` and `{key}` exclude each other in {FORMS}")));
            }
            form = Some((key, written));
        }
        let Some((_, mut source)) = form else {
            return Err(de::Error::custom(format!("the table defines no spectrum; expected {FORMS}")));
        };
        match (&mut source, column, base) {
            (_, None, None) => {}
            (SpectrumSource::File { column, .. }, Some(written), None) => *column = Some(written),
            (SpectrumSource::Gaussians { base, .. }, None, Some(written)) => *base = written,
            (_, Some(_), _) => return Err(de::Error::custom("`column` is only allowed with `file`")),
            (_, None, Some(_)) => return Err(de::Error::custom("`base` is only allowed with `gaussian`")),
        }
        check(&source).map_err(de::Error::custom)?;
        Ok(source)
    }
}

/// Checks a source for errors that are independent of its use, while the position in the text is still known.
fn check(source: &SpectrumSource) -> Result<(), SpectrumError> {
    match source {
        SpectrumSource::Points(points) => Spectrum::interpolate(points).map(drop),
        SpectrumSource::Gaussians { bands, base } => sum_of_gaussians(bands, *base).map(drop),
        SpectrumSource::Colour(colour) => smooth_reflectance(*colour).map(drop),
        SpectrumSource::Blackbody(kelvin) => planck(*kelvin).map(drop),
        SpectrumSource::Constant(_)
        | SpectrumSource::Named(_)
        | SpectrumSource::File { .. }
        | SpectrumSource::Samples(_) => Ok(()),
    }
}

/// Value at a wavelength.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "the value at a wavelength is a number (quote a wavelength with a decimal point: \"546.1\" = 0.5)"
)]
enum Value {
    Number(f64),
}
