//! Accumulator files: what a march leaves per pixel, with all that relighting it takes.
//!
//! # The file
//!
//! An OpenEXR file of flat parts with scan lines or tiles (of several resolutions only the full one counts), any
//! lossless compression, no subsampling. Each side of the picture has 1 to 65,536 pixels. It may have been written by
//! any program. What its pixels keep are weights of materials or the numbers of a colour model.
//!
//! The attribute `relume` of the picture's part is a string (OpenEXR type `string`, UTF-8) of TOML text; other
//! attributes are ignored. Spectra in it are at 380, 385, … 780 nm. Names are not empty, hold no control characters,
//! and are unique in their list; other keys than those listed here are refused. Any of the lists may be empty or absent.
//!
//! | key | value |
//! | --- | --- |
//! | `version` | 1 with weights, 2 with a colour model, 3 with one and what it was checked on |
//! | `exposure` | factor on the linear picture; 1 where absent |
//! | `adapt` | whether the white of the mixed light is adapted to D65 (Bradford); false where absent |
//! | `observer` | `"1931"` or `"1964"`: whose eyes make colours of spectra, the CIE's 2-degree or 10-degree standard observer; 1931 where absent. A display is made for that of 1931: for that of 1964, X, Y and Z are scaled so that D65 has Y = 1, and adapted from the white of D65 to its white to that of 1931 (Bradford). All XYZ here are those |
//! | `background` | 81 numbers: the reflectance behind the volume, lit by every light; black where absent |
//! | `[[components]]` | with weights: `name`; `spectrum`: 81 numbers, a reflectance (all 1 for `white`, the specular component) |
//! | `[model]` | with a colour model: see below |
//! | `[[positions]]` | `name`; `kind`: `"ambient"`, `"headlight"`, `"directional"` or `"point"`; `vector`: three numbers, for the last two only, the direction towards the light (or the opposite one, where no material is specular: both sides of a surface shine, so the two are one position) or its place, in world units |
//! | `[[lights]]` | `name`; `position`: the name of one; `weight`: its intensity; `shown`: the intensity that the picture shows it with, where that is another, 0 for a light that is off; `spectrum`: 81 numbers, normalised so that the perfect reflector has Y = 1; with a colour model also what is said below |
//! | `[dial]` | the light dial; where absent, the regular polygon of the lights, which keeps the luminance 1: `normalise`, whether a white surface keeps its luminance, `master`, that luminance, else a factor, and in order the `nodes`, each with `light`, the name of one, `place`, two numbers, and `on`, whether it takes part; `situations`, mixes to come back to, each with `name`, `caption`, `hand`, two numbers, and `off` and `on`, names of lights whose nodes are off beside those of the dial, and on though the dial has them off |
//!
//! Channels are 32-bit or 16-bit float, all values finite; their order does not matter, and there are no others.
//!
//! # Weights of materials
//!
//! One part, of any name, with the channels
//!
//! - `transmittance`: the share of light from behind the volume that reaches the camera, T;
//! - for every position p and every component c one channel with the name of the position, a full stop and the name of
//!   the component (`key.bone`, `key.white`): the weight m of this component under this position, which is
//!   the sum over the ray's samples of T · opacity · share of the component · shading.
//!
//! **The picture** of such a file has at each pixel and wavelength
//! Σ_p (Σ_c m(p, c) · reflectance(c)) · light(p) + T · background · Σ_p light(p), where
//! light(p) is the sum of weight · spectrum over the lights at position p; its `shown` is taken for the weight of a light that
//! has one.
//!
//! # The numbers of a colour model
//!
//! A model has k coefficients, 1 to 31, counted from 0: coefficient i of a spectrum is the sum of its products with
//! row i of the projection P. The part with the attribute `relume` has the channels
//!
//! - `transmittance`, or, where what passes changes its colour on the way, `transmittance_0`, `transmittance_1`, …,
//!   T(i) for every coefficient;
//! - for every position p and every coefficient i one channel with the name of the position, a full stop and i
//!   (`key.0`, `key.1`, …): the number c(p, i).
//!
//! Two more parts hold what the model was fitted on, n spectra (1 to 16,384) that pixels can have under light of
//! equal power, so that the model can be fitted to further lights:
//!
//! - `cloud`, 81 × n pixels with the channel `spectrum`: row j is spectrum j;
//! - `coefficients`, k × n pixels with the channel `coefficient`: row j has the k coefficients that arithmetic on k
//!   numbers makes of spectrum j. The model `nodes` has no such part: its coefficients are P times the spectrum.
//!
//! A file of version 3 holds in the same way, in the parts `unseen` and `unseen_coefficients`, spectra that were not used
//! in the fit. The error of a further light is its error on both, where `mixed` also on sums of a spectrum under it and
//! another under each light of the file. Of a file of version 2, which has no such spectra, it is
//! that on the cloud, and colours that were not fitted may differ more.
//!
//! | key of `[model]` | value |
//! | --- | --- |
//! | `kind` | `"nodes"`, `"sharpened"`, `"sharpened-semigroup"`, `"bands"` or `"rgb"`: how it is fitted to further lights |
//! | `transmittance` | `"grey"` or `"coloured"`: one channel or k |
//! | `projection` | P: k lists of 81 numbers from −10⁹ to 10⁹; of `nodes`, each with a one at its wavelength and else zeros |
//! | `mixed` | in version 3, whether lights shine from several places, so that pixels add up different spectra under them; false where absent |
//! | `tolerance` | the largest ΔE00 that a further light is used with without a warning; 1 where absent |
//! | `description`, `nodes_nm` | for people, need not be there: the model in words, and of `nodes` their wavelengths |
//!
//! | key of `[[lights]]` | value |
//! | --- | --- |
//! | `matrix` | W: k lists of three numbers, the XYZ per unit of each coefficient under this light of weight 1; where absent it is fitted |
//! | `error` | beside `matrix`: `mean`, `p95` and `max` of the ΔE00 of W over the cloud |
//! | `unseen` | the same over spectra that were not used in the fit, where that was measured |
//!
//! **The picture** of such a file has at each pixel the XYZ that is the sum over p and i of c(p, i) · W(p, i), where W(p)
//! is the sum of weight · W over the lights at position p; and of the background the sum over p and i of
//! T(i) · (P background)(i) · W(p, i), or, where T is one number, T times its exact XYZ under all lights.

mod march;
mod read;
mod rules;
mod text;

use std::path::Path;

use super::channels::{self, Part};
use super::picture::check_size;
use super::{BANDS, OutputError};
use serde::{Deserialize, Serialize};

use crate::model::{ColourModel, ModelKind};
use crate::spectrum::observer::Observer;

/// The name of the attribute that holds the text.
const ATTRIBUTE: &str = "relume";

/// The name of the channel, or of the channels, of what passes.
const TRANSMITTANCE: &str = "transmittance";

/// The name of the picture's part in files of several parts.
const PICTURE: &str = "accumulators";

/// The part that holds the spectra a model was fitted on, and its channel.
const CLOUD: (&str, &str) = ("cloud", "spectrum");

/// The part that holds the coefficients of those spectra, and its channel.
const COEFFICIENTS: (&str, &str) = ("coefficients", "coefficient");

/// The part that holds spectra that were not used in the fit, and its channel.
const UNSEEN: (&str, &str) = ("unseen", "spectrum");

/// The part that holds the coefficients of those, and its channel.
const UNSEEN_COEFFICIENTS: (&str, &str) = ("unseen_coefficients", "coefficient");

/// The most spectra a cloud has: many times those of any fit, and few enough to be fitted to while one waits.
const LARGEST_CLOUD: usize = 16_384;

/// What a march leaves per pixel, and what it takes to make a picture of it.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmFile {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// What the numbers of a pixel stand for.
    pub components: Components,
    /// Where light comes from: one set of numbers each.
    pub positions: Vec<Position>,
    /// The lights that the picture was rendered with.
    pub lights: Vec<Light>,
    /// The reflectance behind the volume, lit by every light; `None` is black.
    pub background: Option<[f64; BANDS]>,
    /// Factor on the linear picture.
    pub exposure: f64,
    /// Whether the white of the mixed light is adapted to D65.
    pub adapt: bool,
    /// Whose eyes make colours of spectra.
    pub observer: Observer,
    /// The light dial; `None` is the regular polygon of the lights.
    pub dial: Option<Dial>,
    /// The numbers, rows from the top: of position p, component c and a pixel at
    /// `(p * components.len() + c) * width * height + pixel`.
    pub accumulators: Vec<f32>,
    /// What passes each pixel, 0–1: one number, or one per component c at `c * width * height + pixel`.
    pub transmittance: Vec<f32>,
}

/// What the numbers of a pixel stand for.
#[derive(Clone, Debug, PartialEq)]
pub enum Components {
    /// Weights of what scatters light: materials, and the white of their specular part.
    Surfaces(Vec<Component>),
    /// The coefficients of a colour model.
    Model(Stored),
}

/// A colour model as a file keeps it.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// The model, with the spectra it was fitted on and the matrices of the file's lights.
    pub model: ColourModel,
    /// Whether what passes has one number per coefficient.
    pub coloured: bool,
    /// The largest ΔE00 that a further light is used with without a warning.
    pub tolerance: f64,
}

impl Components {
    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Surfaces(surfaces) => surfaces.len(),
            Self::Model(stored) => stored.model.dimension(),
        }
    }

    /// What channels call them.
    fn names(&self) -> Vec<String> {
        match self {
            Self::Surfaces(surfaces) => surfaces.iter().map(|surface| surface.name.clone()).collect(),
            Self::Model(stored) => coefficient_names(stored.model.dimension()),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What scatters light: a material, or the white of the specular part.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Unique among the components.
    pub name: String,
    /// Reflectance, 380–780 nm.
    pub spectrum: [f64; BANDS],
}

/// Where lights shine from, as far as shading can tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Position {
    /// Unique among the positions.
    pub name: String,
    /// How it shades.
    pub kind: PositionKind,
}

/// How a position shades.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PositionKind {
    /// From everywhere: shading 1.
    Ambient,
    /// From the camera.
    Headlight,
    /// From infinitely far, in this direction from the volume, or the opposite one where no material is specular, in
    /// world space.
    Directional([f64; 3]),
    /// From this point in world space.
    Point([f64; 3]),
}

/// A light in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Unique among the lights.
    pub name: String,
    /// Index of its position in [`FilmFile::positions`].
    pub position: usize,
    /// Its intensity.
    pub weight: f64,
    /// The intensity that the picture shows it with, where that is another; 0 is off.
    pub shown: Option<f64>,
    /// Relative power, 380–780 nm, such that the perfect reflector has Y = 1 under weight 1.
    pub spectrum: [f64; BANDS],
}

/// The light dial, as a file keeps it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dial {
    /// Whether its mixes keep the luminance of white.
    pub normalise: bool,
    /// That luminance, or what weights are multiplied by.
    pub master: f64,
    /// In the order of the dial.
    pub nodes: Vec<Node>,
    /// Mixes to come back to.
    #[serde(default)]
    pub situations: Vec<Situation>,
}

/// A named place of the hand of the dial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Situation {
    /// Unique among the situations.
    pub name: String,
    /// What it shows; may be empty.
    #[serde(default)]
    pub caption: String,
    /// Where the hand is.
    pub hand: [f64; 2],
    /// The lights whose nodes are off, beside those that are always.
    #[serde(default)]
    pub off: Vec<String>,
    /// The lights whose nodes are on, though the dial has them off.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub on: Vec<String>,
}

/// A node of the light dial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// The name of one of the lights.
    pub light: String,
    /// Where it lies.
    pub place: [f64; 2],
    /// Whether it takes part.
    pub on: bool,
}

impl FilmFile {
    /// Writes the file described at [the top of this module](self) to `path`. A model's spectra and their coefficients
    /// are rounded to f32, which holds those of a fit exactly.
    ///
    /// # Errors
    ///
    /// [`OutputError::Size`]; [`OutputError::Inconsistent`] when a name, a number or a length breaks the rules of the
    /// file; and those of [`super::write_atomically`].
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        let inconsistent = |detail| OutputError::Inconsistent { detail };
        check_size(self.width, self.height)?;
        self.check().map_err(inconsistent)?;
        let text = text::written(self).map_err(inconsistent)?;
        let (size, pixels) = ((self.width, self.height), self.width * self.height);
        let (names, attributes) = (self.channel_names(), [(ATTRIBUTE, &*text)]);
        let planes: Vec<&[f32]> =
            self.accumulators.chunks_exact(pixels).chain(self.transmittance.chunks_exact(pixels)).collect();
        let picture = |first: usize, data: &mut [f32]| {
            for (y, line) in (first..).zip(data.chunks_exact_mut(size.0 * names.len())) {
                for (values, plane) in line.chunks_exact_mut(size.0).zip(&planes) {
                    values.copy_from_slice(&plane[y * size.0..][..size.0]);
                }
            }
        };
        let Components::Model(Stored { model, .. }) = &self.components else {
            let part = Part { name: None, size, channels: &names, attributes: &attributes };
            return channels::write(path, &[part], |_, first, data| picture(first, data));
        };
        let tables = tables(model);
        let mut parts = vec![Part { name: Some(PICTURE), size, channels: &names, attributes: &attributes }];
        parts.extend(tables.iter().map(|table| Part {
            name: Some(table.name),
            size: (table.width, table.rows.len()),
            channels: std::slice::from_ref(&table.channel),
            attributes: &[],
        }));
        channels::write(path, &parts, |part, first, data| match part {
            0 => picture(first, data),
            _ => fill(data, tables[part - 1].rows[first..].iter().copied().flatten()),
        })
    }

    /// Whether a file can hold these names and numbers, whatever its pixels are: to be asked before those are computed.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] as of [`Self::write`].
    pub fn check_header(&self) -> Result<(), OutputError> {
        self.check_lists(&self.channel_names()).map_err(|detail| OutputError::Inconsistent { detail })
    }

    /// Whether what passes has one number per component.
    #[must_use]
    pub fn is_coloured(&self) -> bool {
        matches!(&self.components, Components::Model(Stored { coloured: true, .. }))
    }

    /// The names of the channels of the picture: those of [`Self::weights`] in their order, then those of what passes.
    fn channel_names(&self) -> Vec<String> {
        channel_names(&self.positions, &self.components.names(), self.is_coloured())
    }
}

/// The names of the channels that pixels have at these positions with components of these names; what passes comes last,
/// `coloured` with a number per component.
fn channel_names(positions: &[Position], components: &[String], coloured: bool) -> Vec<String> {
    let of = |position: &Position| {
        let names = components.iter().map(|component| format!("{}.{component}", position.name));
        names.collect::<Vec<_>>()
    };
    let mut names: Vec<String> = positions.iter().flat_map(of).collect();
    if coloured {
        names.extend(components.iter().map(|component| format!("{TRANSMITTANCE}_{component}")));
    } else {
        names.push(TRANSMITTANCE.to_owned());
    }
    names
}

/// What coefficients are called in channels.
fn coefficient_names(dimension: usize) -> Vec<String> {
    (0..dimension).map(|index| index.to_string()).collect()
}

/// Numbers that lie beside the picture.
struct Table<'a> {
    name: &'static str,
    channel: String,
    width: usize,
    rows: Vec<&'a [f64]>,
}

/// What `model` was fitted on and checked on, with the coefficients of both where a file holds them.
fn tables(model: &ColourModel) -> Vec<Table<'_>> {
    let sets = [
        (CLOUD, COEFFICIENTS, model.cloud(), model.cloud_vectors()),
        (UNSEEN, UNSEEN_COEFFICIENTS, &model.unseen().spectra, &model.unseen().vectors),
    ];
    let mut tables = Vec::new();
    for (of_spectra, of_vectors, spectra, vectors) in sets.into_iter().filter(|(_, _, spectra, _)| !spectra.is_empty())
    {
        let table = |(name, channel): (&'static str, &str), width, rows| Table {
            name,
            channel: channel.to_owned(),
            width,
            rows,
        };
        tables.push(table(of_spectra, BANDS, spectra.iter().map(|spectrum| &spectrum.samples()[..]).collect()));
        if has_coefficients(model.kind()) {
            tables.push(table(of_vectors, model.dimension(), vectors.iter().map(Vec::as_slice).collect()));
        }
    }
    tables
}

/// Whether a file holds the coefficients of the cloud, since the projection alone does not make them.
fn has_coefficients(kind: ModelKind) -> bool {
    kind != ModelKind::Nodes
}

/// Stores numbers as f32.
#[expect(clippy::cast_possible_truncation, reason = "files hold f32")]
fn fill<'a>(data: &mut [f32], numbers: impl Iterator<Item = &'a f64>) {
    for (value, &number) in data.iter_mut().zip(numbers) {
        *value = number as f32;
    }
}
