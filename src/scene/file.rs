//! The scene file: TOML as people write it, checked where it stands.

use std::collections::BTreeMap;
use std::io::Read;
use std::num::NonZeroUsize;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;
use toml::{Spanned, Table, Value};

use super::define::{Definition, byte_of, define, path_at, responsible};
use super::lights::{INTENSITY, chain, warn_below_zero};
use super::{
    AccumulateAs, Accuracy, Aim, Camera, Dial, Display, Gradients, Interpolation, LabelEntry, Labels, Lookup, Material,
    MaterialCurve, OPAQUE_DEPTH, Placement, Projection, Scene, SceneError, SceneLight, Shading, Situation, StoreAs,
    Term, Transfer, VolumeAs,
};
use crate::input;
use crate::model::{LARGEST_DIMENSION, ModelKind};
use crate::number::{count, readable, unsigned};
use crate::palette::{self, Misplaced, PaletteFile};
use crate::progress::Progress;
use crate::spectrum::{Reflectance, Spectrum, SpectrumError, SpectrumSource};
use crate::volume::{self, ByteOrder, Geometry, Phantom, RawLayout, Selection, Volume, VolumeError};
use crate::written::{place, with_suggestion};

/// The scene shown when none is named.
const DEFAULT: &str = include_str!("../../data/scenes/default.toml");
/// The scene that other renderers are set beside.
const PEER: &str = include_str!("../../data/scenes/peer.toml");

/// What the command line changes about a scene.
#[derive(Clone, Debug, Default)]
pub struct SceneOptions {
    /// In place of the scene's volume.
    pub volume: Option<PathBuf>,
    /// How to read it where its file does not say.
    pub raw: Option<RawLayout>,
    /// What to read of it where its file holds several, before what the scene says.
    pub selection: Selection,
    /// In place of the scene's labels.
    pub labels: Option<PathBuf>,
    /// In place of the scene's `downsample`.
    pub downsample: Option<[usize; 3]>,
    /// Changed values, applied in order.
    pub definitions: Vec<Definition>,
}

/// Reads the scene file `path`.
///
/// # Errors
///
/// [`SceneError`]: what cannot be read, or where in the file something is not as it may be.
pub fn load(path: &Path, options: &SceneOptions, progress: &dyn Progress) -> Result<Scene, SceneError> {
    let read = |source| SceneError::Read { path: path.to_owned(), source };
    let volume = || SceneError::Invalid {
        at: path.display().to_string(),
        message: format!("this is a volume, not a scene: use --volume {}", path.display()),
    };
    if volume::is_volume(path, &[]) {
        return Err(volume());
    }
    let file = input::open(path).map_err(read)?;
    let length = file.metadata().map_err(read)?.len();
    if length > LONGEST_SCENE {
        let message = format!(
            "a scene file has at most {LONGEST_SCENE} bytes, this one has {length}; is it a volume? then use --volume"
        );
        return Err(SceneError::Invalid { at: path.display().to_string(), message });
    }
    let mut bytes = Vec::new();
    file.take(LONGEST_SCENE).read_to_end(&mut bytes).map_err(read)?;
    if volume::is_volume(path, &bytes) {
        return Err(volume());
    }
    let text = String::from_utf8(bytes).map_err(|error| SceneError::Invalid {
        at: path.display().to_string(),
        message: format!(
            "not UTF-8 text from byte {} on; is it a volume? then use --volume",
            error.utf8_error().valid_up_to()
        ),
    })?;
    let base = path.parent().unwrap_or(Path::new(""));
    parse(&path.display().to_string(), &text, base, options, progress)
}

/// The default scene, which is part of the program.
///
/// # Errors
///
/// As [`load`]: `options` can ask for what is not there.
pub fn load_embedded(options: &SceneOptions, progress: &dyn Progress) -> Result<Scene, SceneError> {
    parse("the default scene", DEFAULT, Path::new(""), options, progress)
}

/// The scene that other renderers are set beside, which is part of the program.
///
/// # Errors
///
/// As [`load`]: `options` can ask for what is not there.
pub fn load_peer(options: &SceneOptions, progress: &dyn Progress) -> Result<Scene, SceneError> {
    parse("the peer scene", PEER, Path::new(""), options, progress)
}

/// More than any scene a person writes; a volume given as a scene is larger. The parser takes a hundred times as much.
const LONGEST_SCENE: u64 = 1 << 19;

/// The scene that `text` describes; `name` heads messages, relative paths start at `base`.
///
/// # Errors
///
/// As [`load`].
pub fn parse(
    name: &str,
    text: &str,
    base: &Path,
    options: &SceneOptions,
    progress: &dyn Progress,
) -> Result<Scene, SceneError> {
    let stated = Text { name: name.to_owned(), text, changed: None };
    let file: SceneFile = stated.deserialize()?;
    if options.definitions.is_empty() {
        return stated.resolve(file, base, options, progress);
    }
    let mut table: Table = stated.deserialize()?;
    for definition in &options.definitions {
        define(&mut table, &definition.text)
            .map_err(|message| SceneError::Define { given: definition.given.clone(), message })?;
    }
    let changed = toml::to_string(&table)
        .map_err(|error| SceneError::Define { given: all_given(&options.definitions), message: error.to_string() })?;
    let changed_by = Some((text, options.definitions.as_slice()));
    let defined = Text { name: name.to_owned(), text: &changed, changed: changed_by };
    let file = defined.deserialize()?;
    defined.resolve(file, base, options, progress)
}

/// The flags that changed a scene, as given.
fn all_given(definitions: &[Definition]) -> String {
    let mut given: Vec<&str> = definitions.iter().map(|definition| &*definition.given).collect();
    // One flag can stand for several definitions.
    given.dedup();
    given.join(" ")
}

/// A scene's text and its name.
struct Text<'a> {
    name: String,
    text: &'a str,
    /// Where `text` is not what the file says: the file's own text, and what changed it.
    changed: Option<(&'a str, &'a [Definition])>,
}

/// Anything the file says, with where it says it.
type At<T> = Spanned<T>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SceneFile {
    version: At<i64>,
    #[serde(default)]
    shading: Shading,
    background: Option<At<SpectrumSource>>,
    #[serde(default)]
    volume: VolumeFile,
    palette: Option<At<PaletteFile>>,
    #[serde(default)]
    materials: BTreeMap<String, At<MaterialFile>>,
    #[serde(default)]
    transfer: TransferFile,
    #[serde(default)]
    labels: BTreeMap<String, At<LabelFile>>,
    #[serde(default)]
    lights: BTreeMap<String, At<LightFile>>,
    #[serde(default)]
    dial: DialFile,
    camera: Option<At<CameraFile>>,
    crop: Option<At<CropFile>>,
    #[serde(default)]
    accuracy: AccuracyFile,
    #[serde(default)]
    display: DisplayFile,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct VolumeFile {
    file: Option<PathBuf>,
    phantom: Option<At<String>>,
    labels: Option<PathBuf>,
    phantom_labels: Option<At<bool>>,
    downsample: Option<[NonZeroUsize; 3]>,
    dims: Option<[NonZeroUsize; 3]>,
    spacing: Option<At<[f64; 3]>>,
    origin: Option<At<[f64; 3]>>,
    direction: Option<At<[f64; 9]>>,
    r#type: Option<At<String>>,
    #[serde(default)]
    byte_order: ByteOrder,
    #[serde(default)]
    header_bytes: u64,
    slices: Option<Vec<i64>>,
    component: Option<usize>,
    time: Option<usize>,
    array: Option<String>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct MaterialFile {
    reflectance: Option<At<SpectrumSource>>,
    absorption: Option<At<SpectrumSource>>,
    ambient: Option<At<f64>>,
    diffuse: Option<At<f64>>,
    specular: Option<At<f64>>,
    exponent: Option<At<i64>>,
    #[serde(default)]
    xray: bool,
    emission: Option<At<Value>>,
    fluorescence: Option<At<Value>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct TransferFile {
    opacity_length: Option<At<f64>>,
    #[serde(default)]
    lookup: Lookup,
    entries: Option<At<i64>>,
    #[serde(default)]
    intervals: Vec<IntervalFile>,
    opacity: Option<At<Vec<[f64; 2]>>>,
    absorption: Option<At<Vec<[f64; 2]>>>,
    material: Option<At<Vec<(f64, String)>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct IntervalFile {
    material: At<String>,
    range: At<[f64; 2]>,
    ramp: Option<At<f64>>,
    opacity: At<f64>,
    absorption: Option<At<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct LabelFile {
    name: Option<String>,
    material: At<String>,
    opacity: At<f64>,
    absorption: Option<At<f64>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct LightFile {
    spectrum: Option<At<SpectrumSource>>,
    intensity: Option<At<f64>>,
    #[serde(default)]
    kind: LightKind,
    direction: Option<At<[f64; 3]>>,
    position: Option<At<[f64; 3]>>,
}

#[derive(Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum LightKind {
    Ambient,
    #[default]
    Headlight,
    Directional,
    Point,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct DialFile {
    normalise: Option<bool>,
    master: Option<At<f64>>,
    #[serde(default)]
    off: Vec<At<String>>,
    #[serde(default)]
    nodes: BTreeMap<String, At<[f64; 2]>>,
    #[serde(default)]
    situations: Vec<SituationFile>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SituationFile {
    name: String,
    #[serde(default)]
    caption: String,
    hand: At<HandFile>,
    #[serde(default)]
    off: Vec<At<String>>,
}

/// A node by the name of its light, or a place.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a hand is the name of a light, or [x, y]")]
enum HandFile {
    Node(String),
    Place([f64; 2]),
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    #[serde(default)]
    projection: ProjectionFile,
    fov: Option<At<f64>>,
    height: Option<At<f64>>,
    position: Option<At<[f64; 3]>>,
    target: Option<At<[f64; 3]>>,
    up: Option<At<[f64; 3]>>,
    front: Option<At<[f64; 3]>>,
    azimuth: Option<At<f64>>,
    elevation: Option<At<f64>>,
    fill: Option<At<f64>>,
}

#[derive(Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ProjectionFile {
    #[default]
    Perspective,
    Orthographic,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CropFile {
    min: [f64; 3],
    max: [f64; 3],
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct AccuracyFile {
    step: Option<At<f64>>,
    termination: Option<At<f64>>,
    skipping: Option<bool>,
    #[serde(default)]
    interpolation: Interpolation,
    #[serde(default)]
    volume: VolumeAs,
    #[serde(default)]
    gradients: Gradients,
    #[serde(default)]
    accumulate: AccumulateAs,
    #[serde(default)]
    model: ModelKind,
    tolerance: Option<At<f64>>,
    k: Option<At<DimensionFile>>,
    #[serde(default)]
    storage: StoreAs,
}

#[derive(Deserialize)]
#[serde(untagged, expecting = "k is a whole number from 1 to 16, or \"auto\"")]
enum DimensionFile {
    Stated(i64),
    Planned(Auto),
}

#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Auto {
    Auto,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct DisplayFile {
    exposure: Option<At<f64>>,
    #[serde(default)]
    adapt: bool,
}

/// Optical depths per opacity length.
const DEPTH: RangeInclusive<f64> = 0.0..=OPAQUE_DEPTH;

fn descends(last: f64, next: f64) -> String {
    format!("the value {} comes after {}; values ascend", readable(next), readable(last))
}

/// Why a material cannot absorb.
fn without_absorption(key: &str, material: &str) -> String {
    format!(
        "{key}: the material {material} absorbs nothing; write `absorption = …`, a spectrum, into [materials.{material}]"
    )
}

/// Rows of the label table beside row 0; a voxel's row is a byte.
const MOST_LABELS: usize = 255;

const UNIT: RangeInclusive<f64> = 0.0..=1.0;
const POSITIVE: RangeInclusive<f64> = f64::MIN_POSITIVE..=f64::MAX;
const FINITE: RangeInclusive<f64> = f64::MIN..=f64::MAX;

/// Says which reflectance gives back more light than it gets.
fn warn_above_one(key: &str, reflectance: &Reflectance) {
    let most = reflectance.spectrum().samples().iter().copied().fold(0.0, f64::max);
    // Colours of reflectance 1 are computed, and round.
    if most > 1.0 + 1e-6 {
        let most = readable(most);
        tracing::warn!(
            "{key} is up to {most}, and no surface reflects more than 1; is it in percent? then divide by 100"
        );
    }
}

/// The error about a spectrum, with its cause.
fn because(error: SceneError, source: SpectrumError) -> SceneError {
    match error {
        SceneError::Invalid { at, message } => SceneError::Spectrum { at, what: message, source },
        SceneError::Define { given, .. } => SceneError::Define { given, message: chain(&source) },
        other => other,
    }
}

/// The message about a field that is missing in what `definition` began, with the names that the text does have.
fn with_names(original: &str, definition: &str, message: String) -> String {
    let mut keys = definition.split(['=', '.']).map(str::trim);
    let (Some(first), Some(name)) = (keys.next(), keys.next()) else { return message };
    match original.parse::<Table>().ok().as_ref().and_then(|table| table.get(first)?.as_table()) {
        Some(there) if message.starts_with("missing field") && !there.contains_key(name) => {
            let names: Vec<&str> = there.keys().map(String::as_str).collect();
            format!("there is no {first}.{name}, only {}; a new one: {message}", names.join(", "))
        }
        _ => message,
    }
}

impl Text<'_> {
    fn deserialize<T: serde::de::DeserializeOwned>(&self) -> Result<T, SceneError> {
        toml::from_str(self.text).map_err(|error| {
            let mut message = with_suggestion(error.message());
            if Path::new(&self.name).extension().is_some_and(|ending| ending != "toml") {
                message += "; this is no scene: scenes are TOML files";
            }
            self.refuse(error.span().map_or(0, |span| span.start), message)
        })
    }

    /// The error of the byte `byte` of the text: of the definition that put it there, else of its place in the file.
    fn refuse(&self, byte: usize, message: String) -> SceneError {
        match self.changed {
            None => SceneError::Invalid { at: place(&self.name, self.text, byte), message },
            Some((original, definitions)) => {
                let path = path_at(self.text, byte);
                match (responsible(definitions, &path), byte_of(original, &path)) {
                    (Some(definition), _) => {
                        let message = with_names(original, &definition.text, message);
                        SceneError::Define { given: definition.given.clone(), message }
                    }
                    (None, byte) => SceneError::Invalid { at: place(&self.name, original, byte.unwrap_or(0)), message },
                }
            }
        }
    }

    fn invalid<T>(&self, value: &At<T>, message: impl Into<String>) -> SceneError {
        self.refuse(value.span().start, message.into())
    }

    fn number(&self, key: &str, value: &At<f64>, range: &RangeInclusive<f64>) -> Result<f64, SceneError> {
        let number = *value.get_ref();
        if range.contains(&number) {
            return Ok(number);
        }
        let allowed = if *range == POSITIVE {
            "a finite number above 0".to_owned()
        } else if *range == FINITE {
            "a finite number".to_owned()
        } else if *range.end() >= f64::MAX {
            format!("a finite number from {}", readable(*range.start()))
        } else {
            format!("a number from {} to {}", readable(*range.start()), readable(*range.end()))
        };
        Err(self.invalid(value, format!("{key} = {}; it is {allowed}", readable(number))))
    }

    fn whole(&self, key: &str, value: &At<i64>, range: RangeInclusive<usize>) -> Result<usize, SceneError> {
        let number = *value.get_ref();
        usize::try_from(number).ok().filter(|number| range.contains(number)).ok_or_else(|| {
            let [least, most] = [range.start(), range.end()];
            self.invalid(value, format!("{key} = {number}; it is a whole number from {least} to {most}"))
        })
    }

    fn optional(
        &self,
        key: &str,
        value: Option<&At<f64>>,
        range: &RangeInclusive<f64>,
        otherwise: f64,
    ) -> Result<f64, SceneError> {
        value.map_or(Ok(otherwise), |value| self.number(key, value, range))
    }

    fn vector(&self, key: &str, value: &At<[f64; 3]>) -> Result<DVec3, SceneError> {
        let vector = DVec3::from_array(*value.get_ref());
        if vector.is_finite() {
            Ok(vector)
        } else {
            Err(self.invalid(value, format!("{key} has a component that is not finite")))
        }
    }

    fn direction(&self, key: &str, value: &At<[f64; 3]>) -> Result<DVec3, SceneError> {
        self.vector(key, value)?
            .try_normalize()
            .ok_or_else(|| self.invalid(value, format!("{key} = [0, 0, 0] points nowhere")))
    }

    fn spectrum<T>(
        &self,
        key: String,
        value: &At<SpectrumSource>,
        resolve: impl FnOnce(&SpectrumSource) -> Result<T, SpectrumError>,
    ) -> Result<T, SceneError> {
        resolve(value.get_ref()).map_err(|source| because(self.invalid(value, key), source))
    }

    /// The spectrum of a material or a light, which only a palette could have said in its place.
    fn stated<'a, T>(
        &self,
        key: &str,
        at: &At<T>,
        spectrum: Option<&'a At<SpectrumSource>>,
    ) -> Result<&'a At<SpectrumSource>, SceneError> {
        spectrum.ok_or_else(|| self.invalid(at, format!("missing field `{key}`")))
    }

    /// Takes what the scene's palette designs for what the scene leaves out; the files that it was read from.
    fn use_palette(
        &self,
        file: &mut SceneFile,
        base: &Path,
        progress: &dyn Progress,
    ) -> Result<Vec<PathBuf>, SceneError> {
        let Some(stated) = &file.palette else { return Ok(Vec::new()) };
        let failed = |source| SceneError::Palette { scene: self.name.clone(), source };
        let mut inputs = Vec::new();
        let palette = match &stated.get_ref().r#use {
            Some(other) if stated.get_ref().says_more_than_use() => {
                return Err(self.invalid(other, "a [palette] has `use`, or says all by itself"));
            }
            Some(path) => {
                let path = base.join(path.get_ref());
                inputs.push(path.clone());
                palette::load(&path).map_err(failed)?
            }
            None => stated.get_ref().resolve(&self.name, base).map_err(
                |Misplaced { byte, message, cause }| match cause {
                    None => self.refuse(byte, message),
                    Some(source) => because(self.refuse(byte, message), source),
                },
            )?,
        };
        inputs.extend(palette.inputs.iter().cloned());
        let span = stated.span();
        let solution = palette::solve(&palette, progress).map_err(failed)?;
        for conflict in &solution.conflicts {
            tracing::warn!("{}: {}", palette.source, conflict.reason);
        }
        let of = |spectrum: &Spectrum| Spanned::new(span.clone(), SpectrumSource::Samples(Box::new(spectrum.clone())));
        for (row, reflectance) in palette.materials.iter().zip(&solution.materials) {
            let place = match row.name.as_str() {
                "background" => &mut file.background,
                name => {
                    let new = || Spanned::new(span.clone(), MaterialFile::default());
                    &mut file.materials.entry(name.to_owned()).or_insert_with(new).get_mut().reflectance
                }
            };
            place.get_or_insert_with(|| of(reflectance.spectrum()));
        }
        for (column, light) in palette.lights.iter().zip(&solution.lights) {
            let new = || Spanned::new(span.clone(), LightFile::default());
            let place = &mut file.lights.entry(column.name.clone()).or_insert_with(new).get_mut().spectrum;
            place.get_or_insert_with(|| of(light.spectrum()));
        }
        Ok(inputs)
    }

    fn resolve(
        &self,
        mut file: SceneFile,
        base: &Path,
        options: &SceneOptions,
        progress: &dyn Progress,
    ) -> Result<Scene, SceneError> {
        if *file.version.get_ref() != 1 {
            let message = format!("version = {}; this program reads version 1", file.version.get_ref());
            return Err(self.invalid(&file.version, message));
        }
        let mut inputs = self.use_palette(&mut file, base, progress)?;
        let materials = self.materials(&file.materials, base)?;
        let background = match &file.background {
            None => None,
            Some(source) => {
                let surface = self.spectrum("background".into(), source, |source| source.reflectance(base))?;
                warn_above_one("background", &surface);
                Some(surface)
            }
        };
        let background = background.filter(|surface| surface.spectrum().samples().iter().any(|&sample| sample != 0.0));
        let lights = self.lights(&file.lights, base)?;
        let dial = self.dial(&file.dial, &lights)?;
        let camera = self.camera(file.camera.as_ref().map_or(&CameraFile::default(), At::get_ref))?;
        let declared = self.label_entries(&file.labels, &materials)?;
        let step = file.accuracy.step.as_ref().map(|step| self.number("step", step, &POSITIVE)).transpose()?;
        let termination = self.optional("termination", file.accuracy.termination.as_ref(), &(0.0..=0.5), 1e-4)?;
        let tolerance = self.optional("tolerance", file.accuracy.tolerance.as_ref(), &(1e-3..=100.0), 1.0)?;
        let dimension = match file.accuracy.k.as_ref().map(|k| (k, k.get_ref())) {
            None | Some((_, DimensionFile::Planned(Auto::Auto))) => None,
            Some((at, DimensionFile::Stated(k))) => {
                let dimension = usize::try_from(*k).ok().filter(|k| (1..=LARGEST_DIMENSION).contains(k));
                let message = format!("k = {k}; it is a whole number from 1 to {LARGEST_DIMENSION}, or \"auto\"");
                Some(dimension.ok_or_else(|| self.invalid(at, message))?)
            }
        };
        let exposure = self.optional("exposure", file.display.exposure.as_ref(), &(0.0..=1e9), 1.0)?;
        let opacity_length = file
            .transfer
            .opacity_length
            .as_ref()
            .map(|length| self.number("opacity_length", length, &POSITIVE))
            .transpose()?;
        let mut transfer = self.transfer(&file.transfer, &materials)?;

        let (volume, stored) = self.volume(&file.volume, base, options, progress)?;
        let labels = self.label_volume(&file.volume, (&volume.source, &stored), declared, base, options, progress)?;
        let smallest = volume.geometry.spacing.min_element();
        transfer.opacity_length = opacity_length.unwrap_or(smallest);
        let accuracy = Accuracy {
            step_length: step.unwrap_or(smallest),
            termination,
            skipping: file.accuracy.skipping.unwrap_or(true),
            interpolation: file.accuracy.interpolation,
            volume: file.accuracy.volume,
            gradients: file.accuracy.gradients,
            accumulate: file.accuracy.accumulate,
            model: file.accuracy.model,
            tolerance,
            dimension,
            storage: file.accuracy.storage,
        };
        let crop = file.crop.as_ref().map(|crop| self.crop(crop, &volume)).transpose()?;
        if camera.view(&volume.geometry, 1.0).is_none() {
            let message =
                "the camera looks nowhere: its target is its position, or its up direction is the one it looks in";
            return Err(self.refuse(file.camera.map_or(0, |camera| camera.span().start), message.into()));
        }
        let reflectances =
            file.materials.values().flat_map(|material| &material.get_ref().reflectance).chain(&file.background);
        let spectra = reflectances.chain(file.lights.values().flat_map(|light| &light.get_ref().spectrum));
        inputs.extend(spectra.filter_map(|source| source.get_ref().file(base)));
        inputs.extend(volume.files.iter().chain(labels.iter().flat_map(|labels| &labels.volume.files)).cloned());
        Ok(Scene {
            inputs,
            source: match self.changed {
                Some((_, definitions)) => format!("{} with {}", self.name, all_given(definitions)),
                None => self.name.clone(),
            },
            volume: Arc::new(volume),
            labels,
            materials,
            transfer,
            lights,
            dial,
            shading: file.shading,
            background,
            camera,
            crop,
            accuracy,
            display: Display { exposure, adapt: file.display.adapt },
        })
    }

    fn materials(&self, files: &BTreeMap<String, At<MaterialFile>>, base: &Path) -> Result<Vec<Material>, SceneError> {
        files
            .iter()
            .map(|(name, stated)| {
                let file = stated.get_ref();
                for (key, value) in [("emission", &file.emission), ("fluorescence", &file.fluorescence)] {
                    if let Some(value) = value {
                        let message = format!(
                            "materials.{name}.{key}: a material that shines by itself, or in other wavelengths than it is lit with, does not factor by the light, so a picture could not be relit; only reflectances can"
                        );
                        return Err(self.invalid(value, message));
                    }
                }
                let share = |key: &str, value: Option<&At<f64>>, otherwise| {
                    self.optional(&format!("materials.{name}.{key}"), value, &UNIT, otherwise)
                };
                let exponent = match &file.exponent {
                    None => 20,
                    Some(value) => unsigned(self.whole(&format!("materials.{name}.exponent"), value, 1..=1024)?),
                };
                let key = format!("materials.{name}.reflectance");
                let source = self.stated("reflectance", stated, file.reflectance.as_ref())?;
                let reflectance = self.spectrum(key.clone(), source, |source| source.reflectance(base))?;
                warn_above_one(&key, &reflectance);
                Ok(Material {
                    name: name.clone(),
                    reflectance,
                    absorption: file
                        .absorption
                        .as_ref()
                        .map(|stated| {
                            let key = format!("materials.{name}.absorption");
                            self.spectrum(key, stated, |source| source.absorption(base))
                        })
                        .transpose()?,
                    ambient: share("ambient", file.ambient.as_ref(), 0.2)?,
                    diffuse: share("diffuse", file.diffuse.as_ref(), 0.8)?,
                    specular: share("specular", file.specular.as_ref(), 0.0)?,
                    exponent,
                    xray: file.xray,
                })
            })
            .collect()
    }

    fn material(&self, name: &At<String>, materials: &[Material]) -> Result<usize, SceneError> {
        self.material_named(name.get_ref(), materials).map_err(|message| self.invalid(name, message))
    }

    #[expect(clippy::unused_self, reason = "reads beside `material`")]
    fn material_named(&self, name: &str, materials: &[Material]) -> Result<usize, String> {
        materials.iter().position(|material| material.name == name).ok_or_else(|| {
            let names: Vec<_> = materials.iter().map(|material| material.name.as_str()).collect();
            format!("there is no material {name:?}; there are: {}", names.join(", "))
        })
    }

    /// Optical depth per opacity length where `material` absorbs most.
    fn absorption(&self, key: &str, value: Option<&At<f64>>, material: &Material) -> Result<f64, SceneError> {
        let Some(value) = value else { return Ok(0.0) };
        let depth = self.number(key, value, &DEPTH)?;
        if depth > 0.0 && material.absorption.is_none() {
            return Err(self.invalid(value, without_absorption(key, &material.name)));
        }
        Ok(depth)
    }

    fn opacity(&self, key: &str, value: &At<f64>, material: &Material) -> Result<f64, SceneError> {
        let opacity = self.number(key, value, &UNIT)?;
        if material.xray && opacity >= 1.0 {
            let message = format!(
                "{key} = 1 for the X-ray material {}; it adds light and hides nothing, so 1 would be light without end: it is a number from 0 to less than 1",
                material.name
            );
            return Err(self.invalid(value, message));
        }
        Ok(opacity)
    }

    fn transfer(&self, file: &TransferFile, materials: &[Material]) -> Result<Transfer, SceneError> {
        let mut terms = Vec::new();
        for interval in &file.intervals {
            let material = self.material(&interval.material, materials)?;
            let [low, high] = *interval.range.get_ref();
            if !(low.is_finite() && high.is_finite() && low <= high) {
                return Err(self.invalid(
                    &interval.range,
                    format!(
                        "range = [{}, {}]; it is two finite numbers, the lower one first",
                        readable(low),
                        readable(high)
                    ),
                ));
            }
            let ramp = self.optional("ramp", interval.ramp.as_ref(), &(0.0..=f64::MAX), 0.0)?;
            let opacity = self.opacity("opacity", &interval.opacity, &materials[material])?;
            let absorption = self.absorption("absorption", interval.absorption.as_ref(), &materials[material])?;
            terms.push(Term::interval(material, [low, high], [ramp, ramp], opacity, absorption));
        }
        match (&file.opacity, &file.material) {
            (None, None) => {}
            (Some(opacity), Some(material)) => {
                terms.push(self.curves(opacity, file.absorption.as_ref(), material, materials)?);
            }
            (Some(alone), None) => {
                return Err(self.invalid(alone, "an opacity curve needs a `material` curve beside it"));
            }
            (None, Some(alone)) => {
                return Err(self.invalid(alone, "a material curve needs an `opacity` curve beside it"));
            }
        }
        let entries = file.entries.as_ref().map(|value| self.whole("entries", value, 2..=1 << 20)).transpose()?;
        Ok(Transfer { opacity_length: 1.0, lookup: file.lookup, entries, terms })
    }

    /// The points of a curve of the transfer function, whose heights are in `range`.
    fn curve(
        &self,
        what: &str,
        stated: &At<Vec<[f64; 2]>>,
        range: &RangeInclusive<f64>,
    ) -> Result<Vec<(f64, f64)>, SceneError> {
        let points: Vec<(f64, f64)> = stated.get_ref().iter().map(|&[value, height]| (value, height)).collect();
        if points.is_empty() {
            return Err(self.invalid(stated, "a curve has at least one point"));
        }
        if let Some(point) = points.iter().find(|point| !(point.0.is_finite() && range.contains(&point.1))) {
            let [value, height, most] = [point.0, point.1, *range.end()].map(readable);
            let message = format!("the point [{value}, {height}] is not a value and {what} from 0 to {most}");
            return Err(self.invalid(stated, message));
        }
        match points.windows(2).find(|pair| pair[1].0 < pair[0].0) {
            Some(pair) => Err(self.invalid(stated, descends(pair[0].0, pair[1].0))),
            None => Ok(points),
        }
    }

    fn curves(
        &self,
        opacity: &At<Vec<[f64; 2]>>,
        absorption: Option<&At<Vec<[f64; 2]>>>,
        material: &At<Vec<(f64, String)>>,
        materials: &[Material],
    ) -> Result<Term, SceneError> {
        let points = self.curve("an opacity", opacity, &UNIT)?;
        let depths = absorption.map(|stated| self.curve("an optical depth", stated, &DEPTH)).transpose()?;
        let depths = depths.unwrap_or_default();
        if material.get_ref().is_empty() {
            return Err(self.invalid(material, "a curve has at least one point"));
        }
        let mut curve = Vec::new();
        for (value, name) in material.get_ref() {
            let index = self.material_named(name, materials).map_err(|message| self.invalid(material, message))?;
            if materials[index].xray && points.iter().any(|point| point.1 >= 1.0) {
                return Err(
                    self.invalid(opacity, format!("opacity 1 for the X-ray material {name}; it is less than 1"))
                );
            }
            curve.push((*value, index));
        }
        if let Some(stated) = absorption.filter(|_| depths.iter().any(|point| point.1 > 0.0))
            && curve.iter().all(|&(_, index)| materials[index].absorption.is_none())
        {
            let names: Vec<&str> = material.get_ref().iter().map(|(_, name)| name.as_str()).collect();
            return Err(self.invalid(stated, without_absorption("absorption", &names.join(", "))));
        }
        if let Some(point) = curve.iter().find(|point| !point.0.is_finite()) {
            return Err(self.invalid(material, format!("the value {}; a material curve has finite values", point.0)));
        }
        if let Some(pair) = curve.windows(2).find(|pair| pair[0].0 >= pair[1].0) {
            return Err(self.invalid(material, descends(pair[0].0, pair[1].0)));
        }
        Ok(Term { opacity: points, absorption: depths, material: MaterialCurve(curve) })
    }

    fn label_entries(
        &self,
        files: &BTreeMap<String, At<LabelFile>>,
        materials: &[Material],
    ) -> Result<Vec<LabelEntry>, SceneError> {
        let mut entries: Vec<LabelEntry> = Vec::new();
        for (key, value) in files {
            if entries.len() == MOST_LABELS {
                let message = format!("{} labels are declared; {MOST_LABELS} can be", files.len());
                return Err(self.invalid(value, message));
            }
            let label = key.parse::<u16>().ok().filter(|&label| label > 0).ok_or_else(|| {
                self.invalid(
                    value,
                    format!(
                        "labels.{key}: a label is a whole number from 1 to 65535; label 0 follows the transfer function"
                    ),
                )
            })?;
            if entries.iter().any(|entry| entry.label == u32::from(label)) {
                return Err(self.invalid(value, format!("labels.{key}: label {label} is declared twice")));
            }
            let file = value.get_ref();
            let material = self.material(&file.material, materials)?;
            let opacity = self.opacity(&format!("labels.{key}.opacity"), &file.opacity, &materials[material])?;
            let absorption = format!("labels.{key}.absorption");
            let absorption = self.absorption(&absorption, file.absorption.as_ref(), &materials[material])?;
            let name = file.name.clone().unwrap_or_else(|| key.clone());
            entries.push(LabelEntry { label: u32::from(label), name, material, opacity, absorption });
        }
        entries.sort_by_key(|entry| entry.label);
        Ok(entries)
    }

    fn lights(&self, files: &BTreeMap<String, At<LightFile>>, base: &Path) -> Result<Vec<SceneLight>, SceneError> {
        files
            .iter()
            .map(|(name, stated)| {
                let file = stated.get_ref();
                let source = self.stated("spectrum", stated, file.spectrum.as_ref())?;
                let spectrum = self.spectrum(format!("lights.{name}.spectrum"), source, |source| source.light(base))?;
                warn_below_zero(&format!("lights.{name}.spectrum"), &spectrum);
                let intensity = self.optional(&format!("lights.{name}.intensity"), file.intensity.as_ref(), &INTENSITY, 1.0)?;
                let placement = match (file.kind, &file.direction, &file.position) {
                    (LightKind::Ambient, None, None) => Placement::Ambient,
                    (LightKind::Headlight, None, None) => Placement::Headlight,
                    (LightKind::Directional, Some(direction), None) => {
                        Placement::Directional(self.direction(&format!("lights.{name}.direction"), direction)?)
                    }
                    (LightKind::Point, None, Some(position)) => {
                        Placement::Point(self.vector(&format!("lights.{name}.position"), position)?)
                    }
                    _ => {
                        let message = format!("lights.{name}: a directional light has a `direction` (towards the light), a point light a `position`, ambient lights and headlights neither");
                        return Err(self.invalid(stated, message));
                    }
                };
                Ok(SceneLight { name: name.clone(), spectrum, intensity, placement })
            })
            .collect()
    }

    /// The regular polygon of `lights`, changed by what the file says.
    fn dial(&self, file: &DialFile, lights: &[SceneLight]) -> Result<Dial, SceneError> {
        let mut dial = Dial::regular(lights.iter().map(|light| light.name.as_str()));
        dial.normalise = file.normalise.unwrap_or(dial.normalise);
        dial.master = self.optional("dial.master", file.master.as_ref(), &INTENSITY, dial.master)?;
        for (name, stated) in &file.nodes {
            let place = DVec2::from_array(*stated.get_ref());
            let node = dial.node_mut(name).map_err(|message| self.invalid(stated, format!("dial.nodes.{message}")))?;
            if !place.is_finite() {
                return Err(self.invalid(stated, format!("dial.nodes.{name} has a component that is not finite")));
            }
            node.place = place;
        }
        for name in &file.off {
            dial.node_mut(name.get_ref()).map_err(|message| self.invalid(name, format!("dial.off: {message}")))?.on =
                false;
        }
        for stated in &file.situations {
            let key = format!("dial.situations, {}", stated.name);
            let hand = match stated.hand.get_ref() {
                HandFile::Node(name) => {
                    dial.node_mut(name)
                        .map_err(|message| self.invalid(&stated.hand, format!("{key}: {message}")))?
                        .place
                }
                HandFile::Place(place) if !place.iter().all(|part| part.is_finite()) => {
                    return Err(self.invalid(&stated.hand, format!("{key}: the hand's place is not finite")));
                }
                HandFile::Place(place) => DVec2::from_array(*place),
            };
            for name in &stated.off {
                dial.node_mut(name.get_ref()).map_err(|message| self.invalid(name, format!("{key}: {message}")))?;
            }
            let off = stated.off.iter().map(|name| name.get_ref().clone()).collect();
            let (name, caption) = (stated.name.clone(), stated.caption.clone());
            dial.situations.push(Situation { name, caption, hand, off });
        }
        Ok(dial)
    }

    fn camera(&self, file: &CameraFile) -> Result<Camera, SceneError> {
        let projection = match (file.projection, &file.fov, &file.height) {
            (ProjectionFile::Perspective, fov, None) => Projection::Perspective {
                fov_degrees: self.optional("camera.fov", fov.as_ref(), &(0.001..=179.0), 30.0)?,
            },
            (ProjectionFile::Orthographic, None, height) => Projection::Orthographic {
                height: height.as_ref().map(|height| self.number("camera.height", height, &POSITIVE)).transpose()?,
            },
            (ProjectionFile::Perspective, _, Some(key)) | (ProjectionFile::Orthographic, Some(key), _) => {
                return Err(self.invalid(key, "a perspective camera has a `fov` (vertical, in degrees), an orthographic one a `height` (in world units)"));
            }
        };
        let up = file.up.as_ref().map_or(Ok(DVec3::NEG_Y), |up| self.direction("camera.up", up))?;
        let aim = match (&file.position, &file.target) {
            (Some(position), Some(target)) => {
                let orbit = [&file.azimuth, &file.elevation, &file.fill];
                if let Some(key) = orbit.into_iter().flatten().next() {
                    return Err(self.invalid(
                        key,
                        "a camera with a `position` and a `target` has no `azimuth`, `elevation` or `fill`",
                    ));
                }
                Aim::LookAt {
                    position: self.vector("camera.position", position)?,
                    target: self.vector("camera.target", target)?,
                }
            }
            (None, None) => Aim::Orbit {
                azimuth: self.optional("camera.azimuth", file.azimuth.as_ref(), &FINITE, -20.0)?,
                elevation: self.optional("camera.elevation", file.elevation.as_ref(), &(-89.9..=89.9), 15.0)?,
                fill: self.optional("camera.fill", file.fill.as_ref(), &(0.01..=100.0), 0.95)?,
                front: file.front.as_ref().map_or(Ok(DVec3::NEG_Z), |front| self.direction("camera.front", front))?,
            },
            (Some(key), None) | (None, Some(key)) => {
                return Err(self.invalid(key, "`position` and `target` of a camera come together"));
            }
        };
        Ok(Camera { projection, aim, up })
    }

    fn crop(&self, crop: &At<CropFile>, volume: &Volume) -> Result<[DVec3; 2], SceneError> {
        let CropFile { min, max } = crop.get_ref();
        let last = volume.geometry.dims.map(|n| count(n) - 1.0);
        for axis in 0..3 {
            // Only an axis of one voxel has no more than one index to show.
            let apart = min[axis] < max[axis] || last[axis] <= 0.0;
            if !(0.0 <= min[axis] && apart && min[axis] <= max[axis] && max[axis] <= last[axis]) {
                let message = format!(
                    "crop from {min:?} to {max:?}; on axis {} it is two different voxel indices from 0 to {}, the lower one first",
                    ["x", "y", "z"][axis],
                    last[axis]
                );
                return Err(self.invalid(crop, message));
            }
        }
        Ok([DVec3::from_array(*min), DVec3::from_array(*max)])
    }

    /// The volume, and the grid it lies on before the scene moves it.
    fn volume(
        &self,
        file: &VolumeFile,
        base: &Path,
        options: &SceneOptions,
        progress: &dyn Progress,
    ) -> Result<(Volume, Geometry), SceneError> {
        let fail = |source| SceneError::Volume { scene: self.name.clone(), source };
        let path = options.volume.clone().or_else(|| file.file.as_ref().map(|path| base.join(path)));
        let stated = if options.volume.is_some() { None } else { file.raw_layout(self)? };
        let layout = options.raw.clone().or(stated);
        let selection = file.selection(options);
        let mut volume = match (path, &file.phantom) {
            (Some(path), _) => volume::open_by(&path, layout.as_ref(), &selection, progress).map_err(fail)?,
            (None, Some(phantom)) => {
                let kind: Phantom =
                    phantom.get_ref().parse().map_err(|error| self.invalid(phantom, format!("{error}")))?;
                selection.only(phantom.get_ref()).map_err(fail)?;
                Volume::phantom(kind, file.dims.map(|dims| dims.map(NonZeroUsize::get))).map_err(fail)?
            }
            (None, None) => return Err(SceneError::NoVolume { scene: self.name.clone() }),
        };
        if let Some(blocks) = file.blocks(options) {
            volume = volume.downsample(blocks).map_err(fail)?;
        }
        let stored = volume.geometry;
        if let Some(spacing) = &file.spacing {
            let changed = volume.with_spacing(DVec3::from_array(*spacing.get_ref()));
            volume = changed.map_err(|error| self.invalid(spacing, error.to_string()))?;
        }
        let Geometry { dims, spacing, origin, direction } = volume.geometry;
        let grid = |origin, direction| Geometry::new(&volume.source, dims, spacing, origin, direction);
        let geometry = match (&file.origin, &file.direction) {
            (None, None) => volume.geometry,
            (moved, turned) => {
                let origin = match moved {
                    Some(moved) => self.vector("volume.origin", moved)?,
                    None => origin,
                };
                let turned_to = turned.as_ref().map_or(direction, |axes| DMat3::from_cols_array(axes.get_ref()));
                grid(origin, turned_to).map_err(|error| match turned {
                    Some(turned) => self.invalid(turned, error.to_string()),
                    None => fail(error),
                })?
            }
        };
        volume.geometry = geometry;
        Ok((volume, stored))
    }

    fn label_volume(
        &self,
        file: &VolumeFile,
        (volume, stored): (&str, &Geometry),
        declared: Vec<LabelEntry>,
        base: &Path,
        options: &SceneOptions,
        progress: &dyn Progress,
    ) -> Result<Option<Labels>, SceneError> {
        let stated = file.labels.as_ref().map(|path| base.join(path)).filter(|_| options.volume.is_none());
        let is_frog = file.phantom.as_ref().is_some_and(|phantom| phantom.get_ref() == Phantom::Frog.name());
        let of_phantom = file.phantom_labels.as_ref().filter(|wanted| *wanted.get_ref());
        if let Some(wanted) = of_phantom.filter(|_| !is_frog) {
            return Err(self.invalid(wanted, "volume.phantom_labels: only the phantom \"frog\" has labels"));
        }
        let fail = |source| SceneError::Volume { scene: self.name.clone(), source };
        let mut labels = match options.labels.clone().or(stated) {
            Some(path) => volume::open(&path, &Selection::default(), progress).map_err(fail)?,
            None if of_phantom.is_some() && options.volume.is_none() => {
                Volume::frog_labels(file.dims.map(|dims| dims.map(NonZeroUsize::get))).map_err(fail)?
            }
            None => return Ok(None),
        };
        if labels.blocks != [1; 3] {
            let problem = "labels have no mean: write downsample into the scene's [volume], where it takes the most \
                           frequent label of a block, not beside the labels";
            return Err(fail(VolumeError::Layout { source_name: labels.source, problem: problem.to_owned() }));
        }
        if let Some(blocks) = file.blocks(options) {
            labels = labels.downsample_labels(blocks).map_err(fail)?;
        }
        if labels.geometry.dims != stored.dims {
            return Err(SceneError::LabelGrid {
                labels: labels.source,
                theirs: labels.geometry.dims,
                volume: volume.to_owned(),
                ours: stored.dims,
            });
        }
        if !labels.geometry.lies_on(stored) {
            labels.notes.push(format!(
                "{}: the labels have another spacing, origin or direction than the volume {volume}; they are shown voxel by voxel on its grid",
                labels.source
            ));
        }
        Ok(Some(Labels { volume: Arc::new(labels), declared }))
    }
}

impl VolumeFile {
    /// How to read a headerless file, where the scene says so by naming a type.
    fn raw_layout(&self, text: &Text<'_>) -> Result<Option<RawLayout>, SceneError> {
        let Some(name) = &self.r#type else {
            return Ok(None);
        };
        let voxel_type = name.get_ref().parse().map_err(|error: VolumeError| text.invalid(name, error.to_string()))?;
        let Some(dims) = self.dims else {
            return Err(text.invalid(name, "headerless voxels need `dims` beside their `type`"));
        };
        let plain = RawLayout::new(dims.map(NonZeroUsize::get), voxel_type);
        Ok(Some(RawLayout {
            slices: self.slices.clone(),
            byte_order: self.byte_order,
            header_bytes: self.header_bytes,
            spacing: self.spacing.as_ref().map_or(plain.spacing, |spacing| *spacing.get_ref()),
            origin: self.origin.as_ref().map_or(plain.origin, |origin| *origin.get_ref()),
            direction: self.direction.as_ref().map_or(plain.direction, |direction| *direction.get_ref()),
            ..plain
        }))
    }

    /// What to read of a file that holds several volumes.
    fn selection(&self, options: &SceneOptions) -> Selection {
        let stated = Selection { component: self.component, time: self.time, array: self.array.clone() };
        if options.volume.is_some() { options.selection.clone() } else { options.selection.or(&stated) }
    }

    /// The blocks that voxels of files are averaged over; those of a phantom only where the command line says so.
    fn blocks(&self, options: &SceneOptions) -> Option<[usize; 3]> {
        let is_file = options.volume.is_some() || self.phantom.is_none();
        let stated = self.downsample.map(|blocks| blocks.map(NonZeroUsize::get)).filter(|_| is_file);
        options.downsample.or(stated)
    }
}
