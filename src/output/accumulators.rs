//! Accumulator files: what a march leaves per pixel, with all that relighting it takes.
//!
//! # The file
//!
//! An OpenEXR file of one flat part with scan lines or tiles (of several resolutions only the full one counts), any
//! lossless compression, no subsampling. Each side has 1 to 65,536 pixels. It may have been written by any program.
//!
//! **Channels**, 32-bit or 16-bit float, all values finite:
//!
//! - `transmittance`: the share of light from behind the volume that reaches the camera, T;
//! - for every position p and every component c one channel with the name of the position, a full stop and the name of
//!   the component (`key.bone`, `key.white`): the weight m of this component under this position, which is
//!   the sum over the ray's samples of T · opacity · share of the component · shading.
//!
//! There are no others, and their order does not matter.
//!
//! **Attributes**: `relume`, a string (OpenEXR type `string`, UTF-8) of TOML text; others are ignored. In the text:
//!
//! | key | value |
//! | --- | --- |
//! | `version` | 1 |
//! | `exposure` | factor on the linear picture; 1 where absent |
//! | `adapt` | whether the white of the mixed light is adapted to D65 (Bradford); false where absent |
//! | `background` | 81 numbers: the reflectance behind the volume, lit by every light; black where absent |
//! | `[[components]]` | `name`; `spectrum`: 81 numbers, a reflectance (all 1 for `white`, the specular component) |
//! | `[[positions]]` | `name`; `kind`: `"ambient"`, `"headlight"`, `"directional"` or `"point"`; `vector`: three numbers, for the last two only, the direction towards the light (or the opposite one, where no material is specular: both sides of a surface shine, so the two are one position) or its place, in world units |
//! | `[[lights]]` | `name`; `position`: the name of one; `weight`: its intensity; `spectrum`: 81 numbers, normalised so that the perfect reflector has Y = 1 |
//!
//! Spectra are at 380, 385, … 780 nm. Names are not empty, hold no control characters, and are unique in their list;
//! other keys are refused. Any of the lists may be empty or absent.
//!
//! **The picture** of such a file has at each pixel and wavelength
//! Σ_p (Σ_c m(p, c) · reflectance(c)) · light(p) + T · background · Σ_p light(p), where
//! light(p) is the sum of weight · spectrum over the lights at position p.

use std::collections::{HashMap, HashSet};
use std::io::BufReader;
use std::path::Path;

use ::exr::block::reader::ChunksReader;
use ::exr::block::{self, UncompressedBlock};
use ::exr::error::Error as ExrError;
use ::exr::math::Vec2;
use ::exr::meta::attribute::{AttributeValue, SampleType};
use ::exr::meta::header::Header;
use ::exr::prelude::f16;
use serde::{Deserialize, Serialize};

use super::picture::check_size;
use super::{BANDS, OutputError, channels};
use crate::input;

/// The version of the file that is written and read here.
const VERSION: u32 = 1;

/// The name of the attribute that holds the text.
const ATTRIBUTE: &str = "relume";

/// The longest text that is looked at, in bytes: hundreds of spectra. The parser takes a hundred times as much.
const LONGEST_TEXT: usize = 1 << 19;

/// The name of the channel that every file has.
const TRANSMITTANCE: &str = "transmittance";

/// No compression of OpenEXR makes more of a byte than this (zlib's limit is 1032).
const LARGEST_EXPANSION: u64 = 1100;

/// What a march leaves per pixel, and the materials and lights to make a picture of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Accumulators {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// What light is scattered by: materials, and the white of their specular part.
    pub components: Vec<Component>,
    /// Where light comes from: one set of weights each.
    pub positions: Vec<Position>,
    /// The lights that the picture was rendered with.
    pub lights: Vec<Light>,
    /// The reflectance behind the volume, lit by every light; `None` is black.
    pub background: Option<[f64; BANDS]>,
    /// Factor on the linear picture.
    pub exposure: f64,
    /// Whether the white of the mixed light is adapted to D65.
    pub adapt: bool,
    /// The weights, rows from the top: of position p, component c and a pixel at
    /// `(p * components.len() + c) * width * height + pixel`.
    pub weights: Vec<f32>,
    /// The transmittance of each pixel, 0–1.
    pub transmittance: Vec<f32>,
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
    /// Index of its position in [`Accumulators::positions`].
    pub position: usize,
    /// Its intensity.
    pub weight: f64,
    /// Relative power, 380–780 nm, such that the perfect reflector has Y = 1 under weight 1.
    pub spectrum: [f64; BANDS],
}

impl Accumulators {
    /// Writes the file described at [the top of this module](self) to `path`.
    ///
    /// # Errors
    ///
    /// [`OutputError::Size`]; [`OutputError::Inconsistent`] when a name, a number or a length breaks the rules of the
    /// file; and those of [`super::write_atomically`].
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        check_size(self.width, self.height)?;
        self.check().map_err(|detail| OutputError::Inconsistent { detail })?;
        let text = toml::to_string(&Document::from(self))
            .map_err(|error| OutputError::Inconsistent { detail: error.to_string() })?;
        let mut names = self.channel_names();
        names.push(TRANSMITTANCE.to_owned());
        let (width, pixels) = (self.width, self.width * self.height);
        let planes: Vec<&[f32]> =
            self.weights.chunks_exact(pixels).chain(std::iter::once(self.transmittance.as_slice())).collect();
        channels::write(path, (width, self.height), &names, &[(ATTRIBUTE, &text)], |first, _, data| {
            for (y, line) in (first..).zip(data.chunks_exact_mut(width * names.len())) {
                for (values, plane) in line.chunks_exact_mut(width).zip(&planes) {
                    values.copy_from_slice(&plane[y * width..][..width]);
                }
            }
        })
    }

    /// Reads the file described at [the top of this module](self).
    ///
    /// Nothing is allocated for pixels before the file is known to be long enough to hold them.
    ///
    /// # Errors
    ///
    /// [`OutputError::Read`] when the file cannot be opened or read, [`OutputError::Damaged`] when it is no whole
    /// OpenEXR file, [`OutputError::NotAccumulators`] when its channels are not those of accumulators,
    /// [`OutputError::Attribute`] when the text is wrong.
    pub fn read(path: &Path) -> Result<Self, OutputError> {
        let unreadable = |source| OutputError::Read { path: path.to_owned(), source };
        let damaged = |error| match error {
            ExrError::Io(source) => OutputError::Read { path: path.to_owned(), source },
            ExrError::Invalid(detail) | ExrError::NotSupported(detail) => {
                OutputError::Damaged { path: path.to_owned(), detail: detail.into_owned() }
            }
            ExrError::Aborted => OutputError::Damaged { path: path.to_owned(), detail: "stopped".to_owned() },
        };
        let foreign = |detail| OutputError::NotAccumulators { path: path.to_owned(), detail };
        let wrong_text = |detail| OutputError::Attribute { path: path.to_owned(), detail };

        let file = input::open(path).map_err(unreadable)?;
        let file_bytes = file.metadata().map_err(unreadable)?.len();
        let reader = block::read(BufReader::new(file), false).map_err(damaged)?;
        let header = one_flat_part(reader.headers()).map_err(foreign)?;
        let text = attribute_text(header).map_err(foreign)?;
        let mut this = parse(&text).map_err(wrong_text)?;
        Vec2(this.width, this.height) = header.layer_size;
        check_size(this.width, this.height)?;
        this.check_lists().map_err(wrong_text)?;
        let planes = this.planes_of_channels(header).map_err(foreign)?;

        let values = planes.len().saturating_mul(this.width * this.height);
        let promised = (header.channels.bytes_per_pixel as u64).saturating_mul((this.width * this.height) as u64);
        if promised > file_bytes.saturating_mul(LARGEST_EXPANSION) {
            let detail = format!("it is {file_bytes} bytes long, and its header promises {promised} bytes of pixels");
            return Err(OutputError::Damaged { path: path.to_owned(), detail });
        }
        let mut data = Vec::new();
        if data.try_reserve_exact(values).is_err() {
            let detail = format!("its {values} values do not fit into memory");
            return Err(OutputError::Damaged { path: path.to_owned(), detail });
        }
        // What no block of the file holds stays NaN and is found below.
        data.resize(values, f32::NAN);
        let size = header.layer_size;
        reader
            .filter_chunks(false, |_, tile, _| tile.is_largest_resolution_level())
            .map_err(damaged)?
            .decompress_sequential(false, |meta, block| copy_block(&meta.headers[0], size, &block, &planes, &mut data))
            .map_err(damaged)?;
        this.transmittance = data.split_off(values - this.width * this.height);
        this.weights = data;
        this.check_values().map_err(foreign)?;
        Ok(this)
    }

    /// The names of the weights' channels, in the order of [`Self::weights`].
    fn channel_names(&self) -> Vec<String> {
        let positions = self.positions.iter();
        let of = |position: &Position| {
            let names = self.components.iter().map(|component| format!("{}.{}", position.name, component.name));
            names.collect::<Vec<_>>()
        };
        positions.flat_map(of).collect()
    }

    /// For each channel of the file, which plane it fills: the weights in their order, then the transmittance.
    fn planes_of_channels(&self, header: &Header) -> Result<Vec<usize>, String> {
        let mut expected = self.channel_names();
        expected.push(TRANSMITTANCE.to_owned());
        let mut missing: HashMap<&str, usize> =
            expected.iter().enumerate().map(|(plane, name)| (&**name, plane)).collect();
        let mut planes = Vec::new();
        for channel in &header.channels.list {
            let name = String::from_utf8_lossy(channel.name.as_slice());
            let Some(plane) = missing.remove(&*name) else {
                return Err(format!("its channel {name:?} belongs to no position and component, or is there twice"));
            };
            if channel.sampling != Vec2(1, 1) {
                return Err(format!("its channel {name:?} is subsampled"));
            }
            if channel.sample_type == SampleType::U32 {
                return Err(format!("its channel {name:?} holds integers, not floating-point numbers"));
            }
            planes.push(plane);
        }
        match missing.into_iter().min_by_key(|&(_, plane)| plane) {
            Some((name, _)) => Err(format!("the channel {name:?} is missing")),
            None => Ok(planes),
        }
    }

    /// Whether all of it keeps the rules of the file.
    fn check(&self) -> Result<(), String> {
        self.check_lists()?;
        self.check_values()
    }

    /// Whether names and numbers of the lists keep the rules of the file.
    fn check_lists(&self) -> Result<(), String> {
        check_names("component", self.components.iter().map(|component| &*component.name))?;
        check_names("position", self.positions.iter().map(|position| &*position.name))?;
        check_names("light", self.lights.iter().map(|light| &*light.name))?;
        let mut seen = HashSet::new();
        for name in self.channel_names() {
            if name.len() > 255 {
                return Err(format!("the channel name {name:?} has {} bytes, and OpenEXR allows 255", name.len()));
            }
            if let Some(name) = seen.replace(name) {
                return Err(format!("two pairs of a position and a component make the channel {name:?}"));
            }
        }
        let finite = |what: &str, name: &str, numbers: &[f64]| match numbers.iter().find(|number| !number.is_finite()) {
            Some(number) => Err(format!("{what}{name:?} holds {number}, which is not a finite number")),
            None => Ok(()),
        };
        for component in &self.components {
            finite("the component ", &component.name, &component.spectrum)?;
        }
        for position in &self.positions {
            if let PositionKind::Directional(vector) | PositionKind::Point(vector) = position.kind {
                finite("the position ", &position.name, &vector)?;
            }
        }
        for light in &self.lights {
            finite("the light ", &light.name, &light.spectrum)?;
            finite("the light ", &light.name, &[light.weight])?;
            if light.position >= self.positions.len() {
                let (name, positions) = (&light.name, self.positions.len());
                return Err(format!("the light {name:?} is at position {}, and there are {positions}", light.position));
            }
        }
        finite("", "background", self.background.as_ref().map_or(&[], |background| background))?;
        finite("", "exposure", &[self.exposure])
    }

    /// Whether there is a finite value for every pixel.
    fn check_values(&self) -> Result<(), String> {
        let (width, pixels) = (self.width, self.width * self.height);
        let mut names = self.channel_names();
        let expected = names.len() * pixels;
        if self.weights.len() != expected {
            return Err(format!("{expected} weights are needed, and there are {}", self.weights.len()));
        }
        if self.transmittance.len() != pixels {
            return Err(format!("{pixels} transmittances are needed, and there are {}", self.transmittance.len()));
        }
        names.push(TRANSMITTANCE.to_owned());
        let mut planes = self.weights.chunks_exact(pixels).chain(std::iter::once(self.transmittance.as_slice()));
        let bad = |plane: &[f32]| plane.iter().position(|value| !value.is_finite());
        match names.iter().find_map(|name| planes.next().and_then(bad).map(|pixel| (name, pixel))) {
            Some((name, pixel)) => {
                let (x, y) = (pixel % width, pixel / width);
                Err(format!("the channel {name:?} has no finite value at pixel ({x}, {y})"))
            }
            None => Ok(()),
        }
    }
}

/// The header of a file with one flat part.
fn one_flat_part(headers: &[Header]) -> Result<&Header, String> {
    match headers {
        [header] if header.deep => Err("it is a deep picture".to_owned()),
        [header] => Ok(header),
        _ => Err(format!("it has {} parts, not one", headers.len())),
    }
}

/// The text of the attribute.
fn attribute_text(header: &Header) -> Result<String, String> {
    match header.own_attributes.other.get(&channels::text(ATTRIBUTE)) {
        Some(AttributeValue::Text(text)) if text.as_slice().len() > LONGEST_TEXT => {
            let length = text.as_slice().len();
            Err(format!("the attribute `{ATTRIBUTE}` has {length} bytes, and at most {LONGEST_TEXT} are read"))
        }
        Some(AttributeValue::Text(text)) => String::from_utf8(text.as_slice().to_vec())
            .map_err(|error| format!("the attribute `{ATTRIBUTE}` is not UTF-8: {error}")),
        Some(_) => Err(format!("the attribute `{ATTRIBUTE}` is not a string")),
        None => Err(format!("it has no attribute `{ATTRIBUTE}`")),
    }
}

/// Copies a decoded block into the planes that its channels fill.
fn copy_block(
    header: &Header,
    Vec2(width, height): Vec2<usize>,
    block: &UncompressedBlock,
    planes: &[usize],
    data: &mut [f32],
) -> Result<(), ExrError> {
    for line in block.lines(&header.channels) {
        let (Vec2(x, y), channel) = (line.location.position, line.location.channel);
        let begin = (planes[channel] * height + y) * width + x;
        let Some(row) = data.get_mut(begin..begin + line.location.sample_count) else {
            return Err(ExrError::Invalid("a block lies outside the picture".into()));
        };
        match header.channels.list[channel].sample_type {
            SampleType::F32 => line.read_samples_into_slice(row)?,
            SampleType::F16 => {
                for (value, sample) in row.iter_mut().zip(line.read_samples::<f16>()) {
                    *value = sample?.to_f32();
                }
            }
            SampleType::U32 => return Err(ExrError::Invalid("a channel of integers".into())),
        }
    }
    Ok(())
}

/// Refuses names that are empty, hold control characters, or occur twice.
fn check_names<'a>(what: &str, names: impl Iterator<Item = &'a str>) -> Result<(), String> {
    let mut seen = HashSet::new();
    for name in names {
        if name.is_empty() {
            return Err(format!("a {what} has an empty name"));
        }
        if name.chars().any(char::is_control) {
            return Err(format!("the name of the {what} {name:?} holds a control character"));
        }
        if !seen.insert(name) {
            return Err(format!("two of the {what}s are called {name:?}"));
        }
    }
    Ok(())
}

/// The text of the attribute, as TOML has it.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    version: u32,
    #[serde(default = "one")]
    exposure: f64,
    #[serde(default)]
    adapt: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    background: Option<Vec<f64>>,
    #[serde(default)]
    components: Vec<ComponentEntry>,
    #[serde(default)]
    positions: Vec<PositionEntry>,
    #[serde(default)]
    lights: Vec<LightEntry>,
}

/// All that is read of a text of another version.
#[derive(Deserialize)]
struct VersionOnly {
    version: i64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ComponentEntry {
    name: String,
    spectrum: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PositionEntry {
    name: String,
    kind: Kind,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    vector: Option<[f64; 3]>,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
enum Kind {
    Ambient,
    Headlight,
    Directional,
    Point,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightEntry {
    name: String,
    position: String,
    weight: f64,
    spectrum: Vec<f64>,
}

/// The exposure of a file that says nothing about it.
fn one() -> f64 {
    1.0
}

impl From<&Accumulators> for Document {
    fn from(accumulators: &Accumulators) -> Self {
        let component = |component: &Component| ComponentEntry {
            name: component.name.clone(),
            spectrum: component.spectrum.to_vec(),
        };
        let position = |position: &Position| {
            let (kind, vector) = match position.kind {
                PositionKind::Ambient => (Kind::Ambient, None),
                PositionKind::Headlight => (Kind::Headlight, None),
                PositionKind::Directional(vector) => (Kind::Directional, Some(vector)),
                PositionKind::Point(vector) => (Kind::Point, Some(vector)),
            };
            PositionEntry { name: position.name.clone(), kind, vector }
        };
        let light = |light: &Light| LightEntry {
            name: light.name.clone(),
            position: accumulators.positions[light.position].name.clone(),
            weight: light.weight,
            spectrum: light.spectrum.to_vec(),
        };
        Self {
            version: VERSION,
            exposure: accumulators.exposure,
            adapt: accumulators.adapt,
            background: accumulators.background.map(|background| background.to_vec()),
            components: accumulators.components.iter().map(component).collect(),
            positions: accumulators.positions.iter().map(position).collect(),
            lights: accumulators.lights.iter().map(light).collect(),
        }
    }
}

/// The lists in `text`, without pixels.
fn parse(text: &str) -> Result<Accumulators, String> {
    let located = |error: toml::de::Error| match error.span().and_then(|span| text.get(..span.start)) {
        Some(before) => format!("line {}: {}", before.matches('\n').count() + 1, error.message()),
        None => error.message().to_owned(),
    };
    let VersionOnly { version } = toml::from_str(text).map_err(located)?;
    if version != i64::from(VERSION) {
        return Err(format!("version {version} is not known here; this program knows version {VERSION}"));
    }
    let document: Document = toml::from_str(text).map_err(located)?;
    let bands = |owner: String, spectrum: Vec<f64>| {
        <[f64; BANDS]>::try_from(spectrum)
            .map_err(|spectrum| format!("{owner} has {} numbers, and a spectrum has {BANDS}", spectrum.len()))
    };
    let component = |entry: ComponentEntry| {
        let spectrum = bands(format!("the component {:?}", entry.name), entry.spectrum)?;
        Ok(Component { name: entry.name, spectrum })
    };
    let position = |entry: PositionEntry| {
        let kind = match (entry.kind, entry.vector) {
            (Kind::Ambient, None) => PositionKind::Ambient,
            (Kind::Headlight, None) => PositionKind::Headlight,
            (Kind::Directional, Some(vector)) => PositionKind::Directional(vector),
            (Kind::Point, Some(vector)) => PositionKind::Point(vector),
            (Kind::Ambient | Kind::Headlight, Some(_)) => {
                return Err(format!("the position {:?} needs no `vector`: its kind has none", entry.name));
            }
            (Kind::Directional | Kind::Point, None) => {
                return Err(format!("the position {:?} needs a `vector` of three numbers", entry.name));
            }
        };
        Ok(Position { name: entry.name, kind })
    };
    let components = document.components.into_iter().map(component).collect::<Result<_, String>>()?;
    let positions = document.positions.into_iter().map(position).collect::<Result<Vec<_>, String>>()?;
    let light = |entry: LightEntry| {
        let spectrum = bands(format!("the light {:?}", entry.name), entry.spectrum)?;
        let Some(position) = positions.iter().position(|position| position.name == entry.position) else {
            return Err(format!(
                "the light {:?} is at the position {:?}, which is not listed",
                entry.name, entry.position
            ));
        };
        Ok(Light { name: entry.name, position, weight: entry.weight, spectrum })
    };
    let lights = document.lights.into_iter().map(light).collect::<Result<_, String>>()?;
    let background = document.background.map(|spectrum| bands("`background`".to_owned(), spectrum)).transpose()?;
    let Document { exposure, adapt, .. } = document;
    let (weights, transmittance) = (Vec::new(), Vec::new());
    Ok(Accumulators {
        width: 0,
        height: 0,
        components,
        positions,
        lights,
        background,
        exposure,
        adapt,
        weights,
        transmittance,
    })
}
