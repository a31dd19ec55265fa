//! Film files: the film of a march with all that relighting needs.
//!
//! # The file
//!
//! A film file is an OpenEXR file of flat parts, in scan lines or tiles (of several resolutions, only the full one
//! counts), with any lossless compression and no subsampling. Each side of the picture has 1 to 65,536 pixels. Any
//! program may have written it. Its pixels hold material weights or the coefficients of a colour model.
//!
//! The attribute `relume` of the picture's part is a string (OpenEXR type `string`, UTF-8) of TOML text; other
//! attributes but `relumeFrame` (below) are ignored. Spectra in it are at 380, 385, … 780 nm. Names are not empty, contain no control characters,
//! and are unique in their list. Keys not listed here are refused. Any list may be empty or absent.
//!
//! | key | value |
//! | --- | --- |
//! | `version` | 1 with material weights, 2 with a colour model, 3 with a colour model and spectra outside its fit; in a part 4, 5 and 6 |
//! | `part` | in a part only: see below |
//! | `exposure` | factor on the linear picture, in a part also `"auto"`; default 1 |
//! | `tone` | `"linear"` or `"soft"`: curve of the displayed picture (docs/theory/tone.md of Relume); default `"linear"` |
//! | `backdrop` | `"none"` or `"dark"`: colours of the screen behind the displayed picture; default `"none"` |
//! | `adapt` | whether the white of the mix is adapted to D65 (Bradford); default false |
//! | `observer` | `"1931"` or `"1964"`: the CIE 2-degree or 10-degree standard observer; default 1931. Displays assume the 1931 observer: for 1964, XYZ are scaled so that D65 has Y = 1, and adapted from the 1964 to the 1931 white of D65 (Bradford). All XYZ here are these |
//! | `background` | 81 numbers: the reflectance behind the volume, lit by every light; black if absent |
//! | `[[components]]` | with material weights: `name`; `spectrum`: 81 numbers, a reflectance (all 1 for `white`, the specular component) |
//! | `[model]` | with a colour model: see below |
//! | `[[positions]]` | `name`; `kind`: `"ambient"`, `"headlight"`, `"directional"`, `"point"` or `"three_point"`; `vector`, for directional and point lights only: three numbers in world space, the direction towards the light (or its opposite if no material is specular: surfaces are lit from both sides, so the two are one position), or the point; `shadows`: whether the accumulators contain the shadows of the volume in light from here, default false, written only if true |
//! | `[[lights]]` | `name`; `position`: name of a position; `weight`: weight in the scene; `shown`: weight in the picture, if different, 0 for a light that is off; `spectrum`: 81 numbers, normalised so that the perfect reflector has Y = 1; with a colour model also the keys below |
//! | `[dial]` | light dial; if absent, the regular polygon of the lights with a luminance of 1. `hand`, only where the dial mixed the lights of the picture (otherwise sliders did): two numbers; `normalise`: whether white keeps its luminance; `master`: that luminance, or else a factor on the weights; `nodes`, in order, each with `light`: name of a light, `place`: two numbers, and `on`: whether the node is on; `presets` (formerly `situations`): dial presets, each with `name`, `caption`, `hand`: two numbers, and `off` and `on`: names of lights whose nodes are off in addition to those of the dial, or on although the dial has them off |
//!
//! Channels are 32-bit or 16-bit float in any order, with finite values only. There are no other channels.
//!
//! The attribute `relumeFrame` of the same part, a string of TOML text too, may state scale and orientation, for
//! annotations:
//!
//! | key | value |
//! | --- | --- |
//! | `pixel` | length of a pixel in world units at the target of the camera, above 0 |
//! | `parallel` | whether it is the same at every depth; default false |
//! | `unit` | unit of the world: `"cm"`, `"mm"`, `"µm"`, `"nm"` or `"Å"` |
//! | `edges` | four texts of at most three of the letters L, R, A, P, S and I: the patient's sides at the left, the right, the top and the bottom of the picture |
//!
//! # Material weights
//!
//! The file has one part of any name, with the channels
//!
//! - `transmittance`: the transmittance T, the fraction of light from behind the volume that reaches the camera;
//! - one channel for every position p and component c, named by the position, a full stop and the component
//!   (`key.bone`, `key.white`): the weight m of the component under this position, the sum over the ray's samples of
//!   T · opacity · share of the component · shading; with `shadows`, light is weakened on its way to the sample.
//!
//! **The picture** has at each pixel and wavelength
//! Σ_p (Σ_c m(p, c) · reflectance(c)) · light(p) + T · background · Σ_p light(p), where light(p) is the sum of
//! weight · spectrum over the lights at position p; a light's `shown`, if present, replaces its weight.
//!
//! # Coefficients of a colour model
//!
//! A model has k coefficients, 1 to 31, numbered from 0. Coefficient i of a spectrum is the dot product of the spectrum
//! with row i of the projection P. The part with the attribute `relume` has the channels
//!
//! - `transmittance` for grey transmittance, or `transmittance_0`, `transmittance_1`, … for coloured transmittance:
//!   T(i) of every coefficient;
//! - one channel for every position p and coefficient i, named by the position, a full stop and i (`key.0`, `key.1`,
//!   …): the accumulator component c(p, i).
//!
//! Two more parts hold the spectra of the fit, n spectra (1 to 16,384) that pixels can have under light of equal power,
//! so that the model can be fitted to further lights:
//!
//! - `cloud`, 81 × n pixels with the channel `spectrum`: row j is spectrum j;
//! - `coefficients`, k × n pixels with the channel `coefficient`: row j has the k coefficients of spectrum j, as
//!   computed by arithmetic on k numbers. The model `nodes` has no such part: its coefficients are P times the
//!   spectrum.
//!
//! A file of version 3 holds spectra outside the fit in the same form, in the parts `unseen` and `unseen_coefficients`.
//! The error of a further light is its error on both sets; with `mixed`, also on sums of a spectrum under it and
//! another spectrum under each light of the file. A file of version 2 has no such spectra: the error is that on the
//! cloud, and colours outside the fit may differ more.
//!
//! | key of `[model]` | value |
//! | --- | --- |
//! | `kind` | `"nodes"`, `"sharpened"`, `"sharpened-semigroup"`, `"bands"` or `"rgb"`: how the model is fitted to further lights |
//! | `transmittance` | `"grey"` or `"coloured"`: one channel or k |
//! | `projection` | P: k lists of 81 numbers from −10⁹ to 10⁹; for `nodes`, each is 1 at its wavelength and 0 elsewhere |
//! | `mixed` | in version 3: whether lights shine from several positions, so that pixels add different spectra under them; default false |
//! | `tolerance` | largest ΔE00 at which a further light is used without a warning; default 1 |
//! | `description`, `nodes_nm` | optional information for people: the model in words, and the wavelengths of `nodes` |
//!
//! | key of `[[lights]]` | value |
//! | --- | --- |
//! | `matrix` | W: k lists of three numbers, the XYZ per unit of each coefficient under this light of weight 1; fitted if absent |
//! | `error` | with `matrix`: `mean`, `p95` and `max` of the ΔE00 of W over the cloud |
//! | `unseen` | the same over the spectra outside the fit, if measured |
//!
//! **The picture** has at each pixel the XYZ `Σ_p Σ_i c(p, i) · W(p, i)`, where W(p) is the sum of weight · W over the
//! lights at position p. The background adds `Σ_p Σ_i T(i) · (P background)(i) · W(p, i)`, or, for a single T, T times
//! its exact XYZ under all lights.
//!
//! # Parts
//!
//! A part is the film of some blocks of the volume (docs/SCALE.md). Its text has the table `[part]`, and its version is
//! larger by 3, so that older programs refuse it. Parts of all blocks composite to a film file of version 1, 2 or 3.
//!
//! | key of `[part]` | value |
//! | --- | --- |
//! | `blocks` | number of blocks of the volume, 2 to 4096: leaves of a tree whose first ⌊n/2⌋ of n leaves are on the low side |
//! | `first`, `last` | numbers of the blocks in this film, from 1: all leaves of a node of the tree |
//! | `order` | a letter for each cut of the tree in preorder: `l` if its low side is in front, `h` otherwise |
//! | `program`, `scene`, `camera` | version of the program, digests of the scene and of its camera; equal in all parts |

mod composite;
mod march;
mod read;
mod relit;
mod rules;
mod text;

pub(super) use composite::blocks_are;
pub use composite::{Composited, FilmPart, composite};

use std::path::Path;

use super::channels::{self, Part, Target};
use super::picture::check_size;
use super::{BANDS, OutputError};
use serde::{Deserialize, Serialize};

use relume_colour::model::{ColourModel, ModelKind};
use relume_colour::spectrum::observer::Observer;
use relume_scene::film::Film;
use relume_scene::{Backdrop, Placement, Tone};

/// Name of the attribute with the TOML text.
const ATTRIBUTE: &str = "relume";

/// Name of the attribute with scale and orientation.
const FRAME: &str = "relumeFrame";

/// Name, or beginning of the names, of the transmittance channels.
const TRANSMITTANCE: &str = "transmittance";

/// Name of the picture's part in files of several parts.
const PICTURE: &str = "accumulators";

/// Part with the spectra to which a model was fitted, and its channel.
const CLOUD: (&str, &str) = ("cloud", "spectrum");

/// Part with the coefficients of those spectra, and its channel.
const COEFFICIENTS: (&str, &str) = ("coefficients", "coefficient");

/// Part with the spectra outside the fit, and its channel.
const UNSEEN: (&str, &str) = ("unseen", "spectrum");

/// Part with the coefficients of those spectra, and its channel.
const UNSEEN_COEFFICIENTS: (&str, &str) = ("unseen_coefficients", "coefficient");

/// Largest number of spectra of a cloud: many times that of any fit, and small enough to fit to interactively.
const LARGEST_CLOUD: usize = 16_384;

/// A film with all that relighting needs.
#[derive(Clone, Debug, PartialEq)]
pub struct FilmFile {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Components of an accumulator.
    pub components: Components,
    /// Light positions, with one accumulator each.
    pub positions: Vec<Position>,
    /// Lights of the picture.
    pub lights: Vec<Light>,
    /// Reflectance behind the volume, lit by every light; `None` is black.
    pub background: Option<[f64; BANDS]>,
    /// Factor on the linear picture; `None`, in parts, is that of [`relume_scene::film::automatic_exposure`] for the whole film.
    pub exposure: Option<f64>,
    /// Curve of the displayed picture.
    pub tone: Tone,
    /// Colours of the screen behind the displayed picture.
    pub backdrop: Backdrop,
    /// Whether to adapt the white of the mix to D65.
    pub adapt: bool,
    /// Standard observer of all colours.
    pub observer: Observer,
    /// Light dial; `None` is the regular polygon of the lights.
    pub dial: Option<Dial>,
    /// Scale and orientation of the picture, if they are known.
    pub frame: Option<Frame>,
    /// The blocks of the volume in this film, if not all.
    pub part: Option<FilmPart>,
    /// Accumulators, rows from the top: position p, component c of a pixel at `(p * components.len() + c) * width *
    /// height + pixel`.
    pub accumulators: Vec<f32>,
    /// Transmittance, 0–1: one number per pixel, or one per component c at `c * width * height + pixel`.
    pub transmittance: Vec<f32>,
}

impl FilmFile {
    /// A film of `size` (width, height) without positions, lights, background and numbers, shown as it is.
    #[must_use]
    pub fn empty([width, height]: [usize; 2], components: Components) -> Self {
        Self {
            width,
            height,
            components,
            positions: Vec::new(),
            lights: Vec::new(),
            background: None,
            exposure: Some(1.0),
            tone: Tone::Linear,
            backdrop: Backdrop::None,
            adapt: false,
            observer: Observer::default(),
            dial: None,
            frame: None,
            part: None,
            accumulators: Vec::new(),
            transmittance: Vec::new(),
        }
    }
}

/// Scale and orientation of a picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Length of a pixel in world units at the target of the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel: Option<f64>,
    /// Whether it is the same at every depth.
    #[serde(default)]
    pub parallel: bool,
    /// Unit of the world, as [`Unit`](relume_volume::Unit) writes it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// Letters of the patient's sides at the left, the right, the top and the bottom.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edges: Option<[String; 4]>,
}

/// Components of an accumulator.
#[derive(Clone, Debug, PartialEq)]
pub enum Components {
    /// Material weights: one component per material, and white for specular highlights.
    Surfaces(Vec<Component>),
    /// The coefficients of a colour model.
    Model(Stored),
}

/// A colour model as stored in a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Stored {
    /// Model with the spectra of its fit and the matrices of the file's lights.
    pub model: ColourModel,
    /// Whether the transmittance has one number per coefficient.
    pub coloured: bool,
    /// Largest ΔE00 at which a further light is used without a warning.
    pub tolerance: f64,
}

impl Components {
    /// Number of components.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Surfaces(surfaces) => surfaces.len(),
            Self::Model(stored) => stored.model.dimension(),
        }
    }

    /// Names of the components in channel names.
    fn names(&self) -> Vec<String> {
        match self {
            Self::Surfaces(surfaces) => surfaces.iter().map(|surface| surface.name.clone()).collect(),
            Self::Model(stored) => coefficient_names(stored.model.dimension()),
        }
    }

    /// Whether there are no components.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Scattering component: a material, or white for specular highlights.
#[derive(Clone, Debug, PartialEq)]
pub struct Component {
    /// Unique among the components.
    pub name: String,
    /// Reflectance, 380–780 nm.
    pub spectrum: [f64; BANDS],
}

/// Light position.
#[derive(Clone, Debug, PartialEq)]
pub struct Position {
    /// Unique among the positions.
    pub name: String,
    /// The origin of the light; determines its shading. If no material is specular, a direction may be the opposite one.
    pub placement: Placement,
    /// Whether the medium between a sample and the light dims it.
    pub shadows: bool,
}

/// Light of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Unique among the lights.
    pub name: String,
    /// Index of its position in [`FilmFile::positions`].
    pub position: usize,
    /// Weight in the scene.
    pub weight: f64,
    /// Weight in the mix that the picture opens with, if different; 0 is off.
    pub shown: Option<f64>,
    /// Relative power, 380–780 nm; the perfect reflector has Y = 1 under weight 1.
    pub spectrum: [f64; BANDS],
}

/// Light dial as stored in a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dial {
    /// Position of the hand, if the dial mixed the lights of the picture; otherwise sliders did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hand: Option<[f64; 2]>,
    /// Whether mixes keep the luminance of white.
    pub normalise: bool,
    /// That luminance, or else a factor on the weights.
    pub master: f64,
    /// Nodes, in the order of the dial.
    pub nodes: Vec<Node>,
    /// Dial presets; their former name was `situations`.
    #[serde(default, alias = "situations")]
    pub presets: Vec<DialPreset>,
}

/// Dial preset: a named position of the hand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DialPreset {
    /// Unique among the presets.
    pub name: String,
    /// Description; may be empty.
    #[serde(default)]
    pub caption: String,
    /// Position of the hand.
    pub hand: [f64; 2],
    /// Lights whose nodes are off, in addition to those that the dial has off.
    #[serde(default)]
    pub off: Vec<String>,
    /// Lights whose nodes are on, although the dial has them off.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub on: Vec<String>,
}

/// Node of the light dial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// Name of its light.
    pub light: String,
    /// Position on the dial.
    pub place: [f64; 2],
    /// Whether the node is on.
    pub on: bool,
}

impl FilmFile {
    /// Writes the film file described in [this module](self) to `path`. Rounds a model's spectra and their coefficients
    /// to f32, which holds those of a fit exactly.
    ///
    /// # Errors
    ///
    /// [`OutputError::Size`]; [`OutputError::Inconsistent`] if a name, a number or a length breaks the rules of the
    /// file; and those of [`super::write_atomically`].
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        self.write_to(Target::File(path), self.numbers())
    }

    /// [`Self::write`] with the numbers of a `film` of the same size in place of its own.
    ///
    /// # Errors
    ///
    /// Those of [`Self::write`].
    pub fn write_with(&self, film: &Film<f32>, path: &Path) -> Result<(), OutputError> {
        self.write_to(Target::File(path), [&film.accumulators, &film.transmittance])
    }

    /// The bytes of the film file that [`Self::write`] writes.
    ///
    /// # Errors
    ///
    /// [`OutputError::Size`], [`OutputError::Inconsistent`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, OutputError> {
        let mut bytes = Vec::new();
        self.write_to(Target::Memory(&mut bytes), self.numbers())?;
        Ok(bytes)
    }

    /// [`Self::to_bytes`] with the numbers of a `film` of the same size in place of its own.
    ///
    /// # Errors
    ///
    /// Those of [`Self::to_bytes`].
    pub fn to_bytes_with(&self, film: &Film<f32>) -> Result<Vec<u8>, OutputError> {
        let mut bytes = Vec::new();
        self.write_to(Target::Memory(&mut bytes), [&film.accumulators, &film.transmittance])?;
        Ok(bytes)
    }

    /// The accumulators and the transmittance.
    fn numbers(&self) -> [&[f32]; 2] {
        [&self.accumulators, &self.transmittance]
    }

    fn write_to(&self, target: Target<'_>, numbers: [&[f32]; 2]) -> Result<(), OutputError> {
        let inconsistent = |detail| OutputError::Inconsistent { detail };
        check_size(self.width, self.height)?;
        self.check(numbers).map_err(inconsistent)?;
        let text = text::written(self).map_err(inconsistent)?;
        let (size, pixels) = ((self.width, self.height), self.width * self.height);
        let frame = self.frame.as_ref().map(text::written_frame).transpose().map_err(inconsistent)?;
        let names = self.channel_names();
        let attributes: Vec<(&str, &str)> =
            std::iter::once((ATTRIBUTE, &*text)).chain(frame.as_deref().map(|frame| (FRAME, frame))).collect();
        let planes: Vec<&[f32]> = numbers.into_iter().flat_map(|planes| planes.chunks_exact(pixels)).collect();
        let picture = |first: usize, data: &mut [f32]| {
            for (y, line) in (first..).zip(data.chunks_exact_mut(size.0 * names.len())) {
                for (values, plane) in line.chunks_exact_mut(size.0).zip(&planes) {
                    values.copy_from_slice(&plane[y * size.0..][..size.0]);
                }
            }
        };
        let Components::Model(Stored { model, .. }) = &self.components else {
            let part = Part { name: None, size, channels: &names, attributes: &attributes };
            return channels::write(target, &[part], |_, first, data| picture(first, data));
        };
        let tables = tables(model);
        let mut parts = vec![Part { name: Some(PICTURE), size, channels: &names, attributes: &attributes }];
        parts.extend(tables.iter().map(|table| Part {
            name: Some(table.name),
            size: (table.width, table.rows.len()),
            channels: std::slice::from_ref(&table.channel),
            attributes: &[],
        }));
        channels::write(target, &parts, |part, first, data| match part {
            0 => picture(first, data),
            _ => fill(data, tables[part - 1].rows[first..].iter().copied().flatten()),
        })
    }

    /// Checks that a file can hold the names and numbers, before the pixels are computed.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] as in [`Self::write`].
    pub fn check_header(&self) -> Result<(), OutputError> {
        self.check_lists(&self.channel_names()).map_err(|detail| OutputError::Inconsistent { detail })
    }

    /// Whether the transmittance has one number per component.
    #[must_use]
    pub fn is_coloured(&self) -> bool {
        matches!(&self.components, Components::Model(Stored { coloured: true, .. }))
    }

    /// Names of the components.
    #[must_use]
    pub fn component_names(&self) -> Vec<String> {
        self.components.names()
    }

    /// Channel names of the picture: those of [`Self::accumulators`] in their order, then those of the transmittance.
    fn channel_names(&self) -> Vec<String> {
        channel_names(&self.positions, &self.components.names(), self.is_coloured())
    }
}

/// Channel names for these positions and components. Those of the transmittance come last; if `coloured`, there is one
/// per component.
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

/// Names of coefficients in channel names.
fn coefficient_names(dimension: usize) -> Vec<String> {
    (0..dimension).map(|index| index.to_string()).collect()
}

/// Numbers stored in a part besides the picture.
struct Table<'a> {
    name: &'static str,
    channel: String,
    width: usize,
    rows: Vec<&'a [f64]>,
}

/// Spectra in and outside the fit of `model`, with the coefficients that a file holds.
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

/// Whether a file holds the coefficients of the cloud, because the projection alone does not determine them.
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
