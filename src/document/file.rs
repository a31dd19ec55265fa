//! Reads scene files, and reports each mistake with its line and column.

mod clip;
mod keys;
mod media;
mod transform;
mod view;
mod volumes;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::num::NonZeroUsize;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize as _;
use toml::de::{DeTable, Deserializer};
use toml::{Spanned, Table};

use keys::*;
use media::Declared;
use volumes::LabelMap;

use super::Wish;
use super::look::first_look::ChosenParts;
pub use clip::clip_plane;
use clip::fields_named;
pub(crate) use volumes::is_segmentation;

use super::define::{Definition, EACH, alike_among, byte_of, define, path_at, responsible};
use super::error::chain;
use super::light_request::warn_below_zero;
use super::{Dial, DialPreset, LightState, Quality, SceneError, SceneFile};
use relume_base::input;
use relume_base::number::{brief, count, readable};
use relume_base::progress::Progress;
use relume_colour::palette::{self, Member, Misplaced};
use relume_colour::spectrum::{
    INDICES, Layers, Reflectance, Spectrum, SpectrumError, SpectrumSource, THICKNESSES, ThinFilm,
};
use relume_colour::written::{place, with_suggestion};
use relume_scene::key::{self, Key, KeyError};
use relume_scene::{
    Aim, CLIP_PLANES, Camera, Clip, ClipPlane, FACTORS, FIELDS, FIRST_FIELD, Field, FieldFactor, Fill, Form,
    GRADIENT_POINTS, GradientFactor, INTENSITY, LabelEntry, Labels, LightKind, MOST_CORNERS, Material, MaterialCurve,
    OPAQUE_DEPTH, Painting, Placement, Projection, SOFT, Scene, SceneLight, Second, Shape, Term, different_factors,
    unit,
};
use relume_volume::{
    self, Geometry, MOST_LABELS, Phantom, RawLayout, Selection, Statistics, Unit, Volume, VolumeError, is_background,
};

/// The scene for a program start without a file.
const DEFAULT: &str = include_str!("../../data/scenes/default.toml");
/// The scene for comparisons with other renderers.
const PEER: &str = include_str!("../../data/scenes/peer.toml");

/// Changes of a scene by the command line.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneOptions {
    /// Volume in place of the scene's.
    pub volume: Option<PathBuf>,
    /// Voxel layout if the volume's file does not state it.
    pub raw: Option<RawLayout>,
    /// Choice of a volume from a file of several; takes precedence over the scene's.
    pub selection: Selection,
    /// Labels in place of the scene's.
    pub labels: Option<PathBuf>,
    /// Table of names and colours of labels, or the name of a built-in one, in place of the scene's.
    pub label_names: Option<PathBuf>,
    /// Spacing of the voxels of the file, in place of that of the file and the scene, and its unit, if it is stated.
    pub spacing: Option<([f64; 3], Option<Unit>)>,
    /// Block size in place of the scene's `downsample`.
    pub downsample: Option<[usize; 3]>,
    /// Changed values, in the order in which they apply.
    pub definitions: Vec<Definition>,
    /// Step, rays, samples, shadows and sky in one word; `definitions` may change them again.
    pub quality: Option<Quality>,
    /// The picture of a volume without a scene.
    pub wish: Wish,
    /// Preset of another program that makes this picture.
    pub preset: Option<PathBuf>,
    /// Names or numbers of the channels that a volume without a scene shows together; all of them by default.
    pub channels: Option<Vec<String>>,
    /// Volumes beside a volume without a scene, each on its own grid.
    pub beside: Vec<PathBuf>,
}

/// Reads the scene file `path`.
///
/// # Errors
///
/// [`SceneError`]: an unreadable file, or an invalid value with its place in the file.
pub fn load(path: &Path, options: &SceneOptions, progress: &dyn Progress) -> Result<SceneFile, SceneError> {
    let read = |source| SceneError::Read { path: path.to_owned(), source };
    let volume = || SceneError::IsVolume { path: path.to_owned() };
    if relume_volume::is_volume(path, &[]) {
        return Err(volume());
    }
    if let Some(refusal) = relume_volume::refusal(path) {
        return Err(SceneError::NoScene(refusal));
    }
    let file = input::open(path).map_err(read)?;
    let length = file.metadata().map_err(read)?.len();
    if length > LONGEST_SCENE {
        return Err(SceneError::TooLong { path: path.to_owned(), length, limit: LONGEST_SCENE });
    }
    let mut bytes = Vec::new();
    file.take(LONGEST_SCENE).read_to_end(&mut bytes).map_err(read)?;
    if relume_volume::is_volume(path, &bytes) {
        return Err(volume());
    }
    let text = String::from_utf8(bytes).map_err(|error| {
        let byte = error.utf8_error().valid_up_to();
        SceneError::NoText { path: path.to_owned(), byte }
    })?;
    let base = path.parent().unwrap_or(Path::new(""));
    parse(&path.display().to_string(), &text, base, options, progress)
}

/// Reads the default scene, which is embedded in the program.
///
/// # Errors
///
/// As [`load`], for invalid `options`.
pub fn load_embedded(options: &SceneOptions, progress: &dyn Progress) -> Result<SceneFile, SceneError> {
    parse("the default scene", DEFAULT, Path::new(""), options, progress)
}

/// Reads the scene for comparisons with other renderers, which is embedded in the program.
///
/// # Errors
///
/// As [`load`], for invalid `options`.
pub fn load_peer(options: &SceneOptions, progress: &dyn Progress) -> Result<SceneFile, SceneError> {
    parse("the peer scene", PEER, Path::new(""), options, progress)
}

/// Size limit of a scene file, in bytes: above any scene that a person writes, below a volume given as a scene. The
/// parser takes a hundred times as much.
const LONGEST_SCENE: u64 = 3 << 17;

/// Reads the scene in `text`. `name` heads messages; relative paths start at `base`.
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
) -> Result<SceneFile, SceneError> {
    parse_around(None, (name, text), base, options, progress)
}

/// As [`parse`], for volumes in memory, in place of those that the scene and the `options` name. Keys of the scene that
/// change a volume (`spacing`, `origin`, `direction`, `unit`, `downsample`, `largest_part_above`, `without_specks`) change a copy; without
/// them, the scene holds the same volume.
///
/// # Errors
///
/// As [`load`].
pub fn parse_on(
    volumes: InMemory,
    name: &str,
    text: &str,
    base: &Path,
    options: &SceneOptions,
    progress: &dyn Progress,
) -> Result<SceneFile, SceneError> {
    let given = Given { volumes, is_ready: false, has_ready_labels: false };
    parse_around(Some(given), (name, text), base, options, progress)
}

/// As [`parse_on`], for volumes that are as the scene wants them already, apart from their grid: those of a scene with this
/// text.
///
/// # Errors
///
/// As [`load`].
pub fn parse_ready(
    volumes: InMemory,
    (name, text): (&str, &str),
    base: &Path,
    definitions: &[Definition],
    progress: &dyn Progress,
) -> Result<SceneFile, SceneError> {
    let options = SceneOptions { definitions: definitions.to_vec(), ..SceneOptions::default() };
    let given = Given { volumes, is_ready: true, has_ready_labels: true };
    parse_around(Some(given), (name, text), base, &options, progress)
}

/// The scene of `file` with a quality and further `definitions`, on its own volume, which is neither read nor copied.
///
/// # Errors
///
/// [`SceneError::Define`] for a definition of the volume other than its grid; and as [`load`].
pub fn redefined(
    file: &SceneFile,
    (quality, definitions): (Option<Quality>, &[Definition]),
    progress: &dyn Progress,
) -> Result<SceneFile, SceneError> {
    const OF_GRID: [&str; 4] = ["spacing", "origin", "direction", "unit"];
    let is_fixed = |definition: &&Definition| {
        let parts: Vec<&str> = definition.text.split(['.', '=', '[']).map(str::trim).collect();
        match parts[0] {
            "volume" => parts.get(1).is_none_or(|key| !OF_GRID.contains(key)),
            "volumes" => parts.get(2).is_none_or(|key| *key != "transfer"),
            _ => false,
        }
    };
    if let Some(definition) = definitions.iter().find(is_fixed) {
        let message =
            "this key chooses voxels, and the scene has its volume in memory; read the scene with it".to_owned();
        return Err(SceneError::Define { given: definition.given.clone(), message });
    }
    let scene = &file.scene;
    let labels = scene.labels.as_ref().map(|labels| Arc::clone(&labels.volume));
    let further = scene.fields.further().iter().map(|field| (field.name.clone(), Arc::clone(&field.volume)));
    let volumes = InMemory { volume: Arc::clone(&scene.fields.first().volume), labels, further: further.collect() };
    let options = SceneOptions { quality, definitions: definitions.to_vec(), ..SceneOptions::default() };
    let given = Given { volumes, is_ready: true, has_ready_labels: true };
    let made = parse_around(Some(given), (&file.name, &file.text), &file.base, &options, progress)?;
    Ok(SceneFile { inputs: file.inputs.clone(), guess: file.guess.clone(), ..made })
}

/// Volumes of a scene that are in memory.
#[derive(Clone, Debug)]
pub struct InMemory {
    /// The volume.
    pub volume: Arc<Volume>,
    /// Its label map, if it has one.
    pub labels: Option<Arc<Volume>>,
    /// Further fields by their names, placed in the world of the volume.
    pub further: Vec<(String, Arc<Volume>)>,
}

/// Volumes in place of those that a scene names.
pub(super) struct Given {
    pub(super) volumes: InMemory,
    /// True if the volume is as the scene and the options want it, apart from its grid.
    pub(super) is_ready: bool,
    /// True if the labels are on its grid, with their names.
    pub(super) has_ready_labels: bool,
}

/// As [`parse`], for volumes that are `given`.
pub(super) fn parse_around(
    given: Option<Given>,
    text: (&str, &str),
    base: &Path,
    options: &SceneOptions,
    progress: &dyn Progress,
) -> Result<SceneFile, SceneError> {
    let changes = (options.quality, &*options.definitions);
    with_definitions(text, changes, |text, file| text.resolve(file, given, base, options, progress))
}

/// Reads the volume of `options`, unless it is in memory. It stands for a scene of this `name`, and has the changes of its
/// definitions. Also returns its grid before these changes, and which parts they choose.
pub(super) fn volume_alone(
    name: &str,
    in_memory: Option<InMemory>,
    options: &SceneOptions,
    progress: &dyn Progress,
) -> Result<((Arc<Volume>, Geometry), ChosenParts), SceneError> {
    let of_volume = |definition: &&Definition| {
        definition.text.split(['.', '=']).next().is_some_and(|table| table.trim() == "volume")
    };
    let definitions: Vec<Definition> = options.definitions.iter().filter(of_volume).cloned().collect();
    let read = |text: &Text<'_>, file: Root| {
        let given = in_memory.map(|volumes| Given { volumes, is_ready: false, has_ready_labels: false });
        let (volume, stored) = text.volume(&file.volume, given, Path::new(""), options, progress)?;
        let largest = file.volume.largest_part_above.is_some();
        Ok(((volume, stored), ChosenParts { largest, specks: largest || file.volume.without_specks.is_some() }))
    };
    with_definitions((name, "version = 1\n"), (None, &definitions), read)
}

/// Reads the scene `text` of this `name`, changed by a quality and by `definitions`.
fn with_definitions<T>(
    (name, text): (&str, &str),
    (quality, definitions): (Option<Quality>, &[Definition]),
    read: impl FnOnce(&Text<'_>, Root) -> Result<T, SceneError>,
) -> Result<T, SceneError> {
    let stated = Text { name: name.to_owned(), text, changed: None };
    let file = stated.root()?;
    if definitions.is_empty() && quality.is_none() {
        return read(&stated, file);
    }
    let before: Table = text.parse().map_err(|error| stated.unreadable(&error))?;
    let mut table = before.clone();
    let of_quality = quality.map_or_else(Vec::new, |quality| quality.definitions(&mut table));
    let definitions = &[&of_quality, definitions].concat();
    let resolve = |definition: &Definition| {
        let failed = |message| SceneError::Define { given: definition.given.clone(), message };
        let text = define(&mut table, &definition.text).map_err(failed)?;
        Ok(Definition { given: definition.given.clone(), text })
    };
    let definitions: &[Definition] = &definitions.iter().map(resolve).collect::<Result<Vec<_>, SceneError>>()?;
    // Flags may name a field in several ways.
    let key = |definition: &Definition| definition.text.split('=').next().unwrap_or_default().to_owned();
    let is_of_field = |key: &str| key.ends_with("transfer.range") || key.ends_with("transfer.by");
    for (index, first) in definitions.iter().enumerate().filter(|(_, definition)| is_of_field(&key(definition))) {
        if let Some(later) = definitions[index + 1..].iter().find(|later| key(later) == key(first)) {
            let message = format!("has no effect: {} follows, of the same field", later.given);
            return Err(SceneError::Define { given: first.given.clone(), message });
        }
    }
    if let Some(error) = definitions.iter().find_map(|definition| unused_material(&before, &table, definition)) {
        return Err(error);
    }
    let changed = toml::to_string(&table)
        .map_err(|error| SceneError::Define { given: all_given(definitions), message: error.to_string() })?;
    let changed_by = Some((text, definitions));
    let defined = Text { name: name.to_owned(), text: &changed, changed: changed_by };
    let file = defined.root()?;
    read(&defined, file)
}

/// Warns of stated ranges that no voxel has.
fn warn_of_ranges(file: &Root, scene: &Scene) {
    let of_field = |field: &Field| {
        let of_further = file.volumes.get(&field.name).and_then(|stated| stated.get_ref().transfer.as_ref());
        let transfer =
            if field.name == scene.fields.first().name { Some(&file.transfer) } else { of_further.map(At::get_ref) };
        transfer.and_then(|transfer| transfer.range.as_ref()).map(|range| *range.get_ref())
    };
    for (field, [low, high]) in scene.fields.iter().filter_map(|field| Some((field, of_field(field)?))) {
        let Statistics { min, max, .. } = field.statistics();
        if high < *min || low > *max {
            let [low, high, min, max] = [low, high, *min, *max].map(readable);
            tracing::warn!(
                "no voxel of {} is in its range from {low} to {high}: its values are {min} to {max}",
                field.name
            );
        }
    }
}

/// The error for a definition of a material that `before` does not have, if nothing in `table` uses it: most likely it is
/// misnamed.
fn unused_material(before: &Table, table: &Table, definition: &Definition) -> Option<SceneError> {
    let name = definition.text.strip_prefix("materials.")?.split(['.', '=']).next().filter(|name| *name != EACH)?;
    let materials = before.get("materials").and_then(toml::Value::as_table);
    if materials.is_some_and(|materials| materials.contains_key(name)) {
        return None;
    }
    if table.iter().any(|(key, value)| key != "materials" && has_text(value, name)) {
        return None;
    }
    let names: Vec<&str> = materials.into_iter().flatten().map(|(name, _)| name.as_str()).collect();
    let message = format!("there is no materials.{name} (there are: {}), and nothing uses a new one", names.join(", "));
    Some(SceneError::Define { given: definition.given.clone(), message })
}

/// Whether `value` or a part of it is this text.
fn has_text(value: &toml::Value, text: &str) -> bool {
    match value {
        toml::Value::String(string) => string == text,
        toml::Value::Array(values) => values.iter().any(|value| has_text(value, text)),
        toml::Value::Table(table) => table.iter().any(|(key, value)| key == text || has_text(value, text)),
        _ => false,
    }
}

/// The definitions that changed the scene, as given.
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
    /// The file's own text and the definitions, if definitions have changed the text.
    changed: Option<(&'a str, &'a [Definition])>,
}

/// Allowed optical depths per opacity length.
const DEPTH: RangeInclusive<f64> = 0.0..=OPAQUE_DEPTH;

fn descends(last: f64, next: f64) -> String {
    format!("the value {} follows {}; the values of a curve must ascend", readable(next), readable(last))
}

/// Message for an absorption of a material without an absorption spectrum.
fn without_absorption(key: &str, material: &str) -> String {
    format!(
        "{key}: the material {material} has no absorption spectrum; write `absorption = …` into [materials.{material}]"
    )
}

/// Name of the entry of `[labels]` for all labels of the map without an entry of their own.
const OTHERS: &str = "others";

const UNIT: RangeInclusive<f64> = 0.0..=1.0;

/// Reflectances above this value are assumed to be in percent; solved spectra of palettes reach 4.
const PERCENT: f64 = 10.0;

/// Warns of a reflectance above 1.
fn warn_above_one(key: &str, reflectance: &Reflectance) {
    let most = reflectance.spectrum().samples().iter().copied().fold(0.0, f64::max);
    // A reflectance of 1 that is computed from a colour may exceed 1 by rounding.
    if most > 1.0 + 1e-6 {
        let percent = if most > PERCENT { "; if it is in percent, divide by 100" } else { "" };
        tracing::warn!(
            "{key} reaches {}; a real surface reflects at most 1{percent}. It is used unchanged",
            brief(most)
        );
    }
}

/// Adds the cause to the error of a spectrum.
fn because(error: SceneError, source: SpectrumError) -> SceneError {
    match error {
        SceneError::Invalid { at, key, message } => SceneError::Spectrum { at, key, what: message, source },
        SceneError::Define { given, .. } => SceneError::Define { given, message: chain(&source) },
        other => other,
    }
}

/// Message for a missing field of a table that `definition` created; lists the tables in the text.
fn with_names(original: &str, definition: &str, message: String) -> String {
    let mut keys = definition.split(['=', '.']).map(str::trim);
    let (Some(first), Some(name)) = (keys.next(), keys.next()) else { return message };
    match original.parse::<Table>().ok().as_ref().and_then(|table| table.get(first)?.as_table()) {
        Some(there) if message.starts_with("missing field") && !there.contains_key(name) => {
            let names: Vec<&str> = there.keys().map(String::as_str).collect();
            format!(
                "there is no {first}.{name} (there are: {}), and a new one is incomplete: {message}",
                names.join(", ")
            )
        }
        _ => message,
    }
}

impl Text<'_> {
    /// The keys of the text.
    fn root(&self) -> Result<Root, SceneError> {
        let read = || {
            let mut table = DeTable::parse(self.text)?;
            let mut scalars = Scalars::new();
            take_scalars(table.get_mut(), &[], &mut scalars)?;
            let mut root = Root::deserialize(Deserializer::from(table))?;
            root.scalars = scalars;
            Ok(root)
        };
        read().map_err(|error| self.unreadable(&error))
    }

    /// The error `error` of the parser.
    fn unreadable(&self, error: &toml::de::Error) -> SceneError {
        let byte = error.span().map_or(0, |span| span.start);
        let path = path_at(self.text, byte);
        let parts: Vec<&str> = path.iter().map(String::as_str).collect();
        let mut message = error.message().to_owned();
        let scalars = scalars_of(parts.split_last().map_or(&[], |(_, table)| table));
        if message.starts_with("unknown field") && !scalars.is_empty() {
            let mut words = message.split('`').skip(1).step_by(2);
            let unknown = words.next().unwrap_or_default();
            let names: Vec<&str> = scalars.into_iter().chain(words).collect();
            message = format!("unknown field `{unknown}`, expected one of `{}`", names.join("`, `"));
        }
        message = with_suggestion(&message);
        if message == "missing field `version`" {
            message += "; write version = 1";
        }
        if toml::from_str(self.text).is_ok_and(|table: Table| table.contains_key("cells")) {
            message += "; this is a palette: relume design solves it, and a scene uses it by [palette] use = \"FILE\"";
        }
        if Path::new(&self.name).extension().is_some_and(|ending| ending != "toml") {
            message += "; scenes are TOML files";
        }
        self.refuse(byte, message)
    }

    /// The value that `scalars` state for the `key` of the part whose paths begin with `beginning`.
    fn scalar<'s, T>(
        &self,
        key: &Key<T>,
        beginning: &str,
        scalars: &'s Scalars,
    ) -> Result<Option<key::Value<'s>>, SceneError> {
        let path = format!("{beginning}{}", key.path);
        let Some(stated) = scalars.get(&path) else { return Ok(None) };
        let refused = |value, allowed| self.invalid(stated, KeyError { key: path.clone(), value, allowed }.to_string());
        let value = match stated.get_ref() {
            toml::Value::String(name) => key::Value::Name(name),
            toml::Value::Boolean(on) => key::Value::Switch(*on),
            other => match f64::deserialize(other.clone()) {
                Ok(number) => key::Value::Number(number),
                Err(_) => return Err(refused(other.to_string(), key.kind.allowed())),
            },
        };
        key.check(value).map_err(|error| refused(error.value, error.allowed))?;
        Ok(Some(value))
    }

    /// Sets the `keys` of `part` that `scalars` state. Their paths begin with `beginning`.
    fn set<T>(&self, part: &mut T, keys: &[Key<T>], beginning: &str, scalars: &Scalars) -> Result<(), SceneError> {
        for key in keys {
            if let Some(value) = self.scalar(key, beginning, scalars)? {
                key.set(part, Some(value)).map_err(|error| self.refuse(0, error.to_string()))?;
            }
        }
        Ok(())
    }

    /// Error at the byte `byte` of the text: names the definition that set the value, otherwise the place in the file.
    fn refuse(&self, byte: usize, message: String) -> SceneError {
        let path = path_at(self.text, byte);
        let key = path.join(".");
        match self.changed {
            None => SceneError::Invalid { at: place(&self.name, self.text, byte), key, message },
            Some((original, definitions)) => match (responsible(definitions, &path), byte_of(original, &path)) {
                (Some(definition), _) => {
                    let message = with_names(original, &definition.text, message);
                    SceneError::Define { given: definition.given.clone(), message }
                }
                (None, byte) => {
                    SceneError::Invalid { at: place(&self.name, original, byte.unwrap_or(0)), key, message }
                }
            },
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
        let allowed = key::numbers([*range.start(), *range.end()]);
        Err(self.invalid(value, format!("{key} = {}; it must be {allowed}", readable(number))))
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
        unit(self.vector(key, value)?).ok_or_else(|| self.invalid(value, format!("{key} = [0, 0, 0] has no direction")))
    }

    fn spectrum<T>(
        &self,
        key: String,
        value: &At<SpectrumSource>,
        resolve: impl FnOnce(&SpectrumSource) -> Result<T, SpectrumError>,
    ) -> Result<T, SceneError> {
        resolve(value.get_ref()).map_err(|source| because(self.invalid(value, key), source))
    }

    /// Returns the spectrum of a material or light, or an error if neither the entry nor a palette states it.
    fn stated<'a, T, V>(&self, key: &str, at: &At<T>, value: Option<&'a At<V>>) -> Result<&'a At<V>, SceneError> {
        value.ok_or_else(|| self.invalid(at, format!("missing field `{key}`")))
    }

    /// Adds the palette's spectra where the scene leaves them out. Returns the files that were read for the palette.
    fn use_palette(&self, file: &mut Root, base: &Path, progress: &dyn Progress) -> Result<Vec<PathBuf>, SceneError> {
        let Some(stated) = &file.palette else { return Ok(Vec::new()) };
        let failed = |source| SceneError::Palette { scene: self.name.clone(), source };
        let mut inputs = Vec::new();
        let mut palette = match &stated.get_ref().r#use {
            Some(other) if stated.get_ref().says_more_than_use() => {
                return Err(self.invalid(other, "a [palette] with `use` has no other keys"));
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
        let says_row = |row: &&Member| match row.name.as_str() {
            "background" => file.background.is_some(),
            name => file.materials.get(name).is_some_and(|material| material.get_ref().reflectance.is_some()),
        };
        let says_column =
            |it: &&Member| file.lights.get(&it.name).is_some_and(|light| light.get_ref().spectrum.is_some());
        let open_rows = palette.materials.iter().filter(|row| row.spectrum.is_none());
        let open_columns = palette.lights.iter().filter(|column| column.spectrum.is_none());
        let is_found = open_rows.clone().all(|row| says_row(&row)) && open_columns.clone().all(|it| says_column(&it));
        if is_found && open_rows.chain(open_columns).next().is_some() {
            // All open spectra are already solved, as in a session.
            palette.check().map_err(failed)?;
            palette.materials.iter_mut().chain(&mut palette.lights).for_each(|it| {
                it.spectrum.get_or_insert_with(|| Spectrum::constant(1.0));
            });
        }
        let solution = palette::solve(&palette, progress).map_err(failed)?;
        for conflict in solution.conflicts.iter().filter(|_| !is_found) {
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
        mut file: Root,
        mut given: Option<Given>,
        base: &Path,
        options: &SceneOptions,
        progress: &dyn Progress,
    ) -> Result<SceneFile, SceneError> {
        if *file.version.get_ref() != 1 {
            let message = format!("version = {}; this version of Relume reads scene version 1", file.version.get_ref());
            return Err(self.invalid(&file.version, message));
        }
        let base = &file.base.as_ref().map_or_else(|| base.to_owned(), |stated| base.join(stated));
        let mut inputs = self.use_palette(&mut file, base, progress)?;
        let scalars = &std::mem::take(&mut file.scalars);
        let materials = self.materials(&file.materials, scalars, base)?;
        let background = match &file.background {
            None => None,
            Some(source) => {
                let surface = self.spectrum("background".into(), source, |source| source.reflectance(base))?;
                warn_above_one("background", &surface);
                Some(surface)
            }
        };
        let background = background.filter(|surface| surface.spectrum().samples().iter().any(|&sample| sample != 0.0));
        let (lights, dark) = self.lights(&file.lights, scalars, base)?;
        let mut dial = self.dial(&file.dial, &lights)?;
        let light = self.mix(&file.mix, (&lights, &mut dial), &dark)?;
        let camera = self.camera(file.camera.as_ref().map_or(&CameraFile::default(), At::get_ref), scalars)?;
        let declared = self.label_entries(&file.labels, &materials)?;
        let (terms, gradient_opacity) =
            self.transfer(&file.transfer, &materials, (&file.fields_beside(file.first_field()), base))?;
        // Refused before the volume is read, which may take long.
        for key in key::SCENE {
            self.scalar(key, "", scalars)?;
        }

        let are_ready = given.as_ref().is_some_and(|given| given.has_ready_labels);
        let labels = given.as_ref().and_then(|given| given.volumes.labels.clone());
        let further = given.as_mut().map_or_else(Vec::new, |given| std::mem::take(&mut given.volumes.further));
        let (volume, stored) = self.volume(&file.volume, given, base, options, progress)?;
        let map = LabelMap { given: labels, are_ready, grid: &stored, declared };
        let (volume, labels) = self.label_volume(&file.volume, volume, map, base, options, progress)?;
        let crop = file.crop.as_ref().map(|crop| self.crop(crop, &volume)).transpose()?;
        let reflectances =
            file.materials.values().flat_map(|material| &material.get_ref().reflectance).chain(&file.background);
        let spectra = reflectances.chain(file.lights.values().flat_map(|light| &light.get_ref().spectrum));
        inputs.extend(spectra.filter_map(|source| source.get_ref().file(base)));
        let of_further = file.volumes.values().filter_map(|field| field.get_ref().transfer.as_ref());
        let transfers = std::iter::once(&file.transfer).chain(of_further.map(At::get_ref));
        let shapes = transfers.flat_map(|transfer| &transfer.intervals).filter_map(|interval| interval.shape.as_ref());
        inputs.extend(shapes.filter_map(|shape| Some(base.join(shape.get_ref().image.as_ref()?))));
        inputs.extend(volume.files.iter().chain(labels.iter().flat_map(|labels| &labels.volume.files)).cloned());
        let name = match self.changed {
            Some((_, definitions)) => format!("{} with {}", self.name, all_given(definitions)),
            None => self.name.clone(),
        };
        let grid = (&*volume, &stored, further.as_slice());
        let further = self.further(&file, grid, &materials, base, options, progress)?;
        inputs.extend(further.iter().flat_map(|field| field.volume.files.iter().cloned()));
        let transforms = file.volumes.values().filter_map(|field| field.get_ref().transform.as_ref());
        inputs.extend(transforms.filter_map(|transform| transform.get_ref().file(base)));
        let mut scene = Scene { labels, materials, lights, background, camera, crop, ..Scene::new(&name, volume) };
        scene.fields = scene.fields.called(file.first_field()).with(further);
        scene.clip = self.clip(&file.clip, &scene.fields)?;
        (scene.transfer.terms, scene.transfer.gradient_opacity) = (terms, gradient_opacity);
        self.check_fields(&file, &scene)?;
        warn_of_ranges(&file, &scene);
        if let Some(hidden) = &file.hidden {
            if scene.fields.further().is_empty() {
                let message = format!(
                    "hidden: the scene has one field, {}, and nothing without it; add others in [volumes], or leave `hidden` out",
                    file.first_field()
                );
                return Err(self.invalid(hidden, message));
            }
            scene.hidden = fields_named(hidden.get_ref(), "`hidden`", &scene.fields)
                .map_err(|message| self.invalid(hidden, message))?;
        }
        self.set(&mut scene, key::SCENE, "", scalars)?;
        if scene.camera.view(&scene.frame.geometry, 1.0).is_none() {
            let message = "the camera has no line of sight: its target is its position, or its up direction is parallel to the line of sight";
            return Err(self.refuse(file.camera.map_or(0, |camera| camera.span().start), message.into()));
        }
        let name = self.name.clone();
        Ok(SceneFile { name, scene, dial, light, text: self.text.into(), base: base.clone(), inputs, guess: None })
    }
}
