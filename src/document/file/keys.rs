//! The keys of a scene file.

use std::collections::BTreeMap;
use std::fmt;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer};
use toml::de::{DeTable, DeValue, ValueDeserializer};
use toml::{Spanned, Value};

use crate::Mixing;
use relume_colour::palette::PaletteFile;
use relume_colour::spectrum::{SpectrumSource, ThinFilmAngle};
use relume_colour::written::{List, Stated, at, numbers, stated_numbers};
use relume_scene::{FIRST_FIELD, LightKind, key};
use relume_volume::ByteOrder;

/// A value with its place in the file.
pub(super) type At<T> = Spanned<T>;

fn counts<'de, D: Deserializer<'de>>(stated: D) -> Result<Option<[NonZeroUsize; 3]>, D::Error> {
    List::deserialize(stated).map(|list| Some(list.0))
}

/// Lists of `N` numbers each.
fn lists<'de, D: Deserializer<'de>, const N: usize>(stated: D) -> Stated<Vec<[f64; N]>, D::Error> {
    let stated = At::<Vec<List<f64, N>>>::deserialize(stated)?;
    Ok(Some(at(stated, |lists| lists.into_iter().map(|list| list.0).collect())))
}

fn corners<'de, D: Deserializer<'de>>(stated: D) -> Stated<[[f64; 3]; 2], D::Error> {
    let stated = At::<List<List<f64, 3>, 2>>::deserialize(stated)?;
    Ok(Some(at(stated, |corners| corners.0.map(|corner| corner.0))))
}

/// A value, and the material from there on.
struct MaterialFrom(f64, String);

impl<'de> Deserialize<'de> for MaterialFrom {
    fn deserialize<D: Deserializer<'de>>(stated: D) -> Result<Self, D::Error> {
        let wrong = |error: toml::de::Error| D::Error::custom(error.message());
        let List([value, name]) = List::<Value, 2>::deserialize(stated)?;
        Ok(Self(value.try_into().map_err(wrong)?, name.try_into().map_err(wrong)?))
    }
}

fn materials_from<'de, D: Deserializer<'de>>(stated: D) -> Stated<Vec<(f64, String)>, D::Error> {
    let stated = At::<Vec<MaterialFrom>>::deserialize(stated)?;
    Ok(Some(at(stated, |pairs| pairs.into_iter().map(|pair| (pair.0, pair.1)).collect())))
}

fn places<'de, D: Deserializer<'de>>(stated: D) -> Result<BTreeMap<String, At<[f64; 2]>>, D::Error> {
    let stated = BTreeMap::<String, At<List<f64, 2>>>::deserialize(stated)?;
    Ok(stated.into_iter().map(|(name, place)| (name, at(place, |list| list.0))).collect())
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Root {
    pub(super) version: At<i64>,
    pub(super) base: Option<PathBuf>,
    pub(super) background: Option<At<SpectrumSource>>,
    /// Names of fields that show nothing.
    pub(super) hidden: Option<At<Vec<String>>>,
    #[serde(default)]
    pub(super) volume: VolumeFile,
    #[serde(default)]
    pub(super) volumes: BTreeMap<String, At<FurtherFile>>,
    pub(super) palette: Option<At<PaletteFile>>,
    #[serde(default)]
    pub(super) materials: BTreeMap<String, At<MaterialFile>>,
    #[serde(default)]
    pub(super) transfer: TransferFile,
    #[serde(default)]
    pub(super) labels: BTreeMap<String, At<LabelFile>>,
    #[serde(default)]
    pub(super) lights: BTreeMap<String, At<LightFile>>,
    #[serde(default)]
    pub(super) dial: DialFile,
    #[serde(default)]
    pub(super) mix: MixFile,
    pub(super) camera: Option<At<CameraFile>>,
    pub(super) crop: Option<At<CropFile>>,
    #[serde(default)]
    pub(super) clip: ClipFile,
    #[serde(default, rename = "shadows")]
    _shadows: ScalarsAlone,
    #[serde(default, rename = "scattering")]
    _scattering: ScalarsAlone,
    #[serde(default, rename = "accuracy")]
    _accuracy: ScalarsAlone,
    #[serde(default, rename = "display")]
    _display: ScalarsAlone,
    /// The scalar keys, which [`take_scalars`] took.
    #[serde(skip)]
    pub(super) scalars: Scalars,
}

/// A table without other keys than scalar ones.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table")]
struct ScalarsAlone {}

/// Stated scalar keys of [`relume_scene::key`] by their paths, such as `accuracy.step` and `materials.flesh.ambient`.
pub(super) type Scalars = BTreeMap<String, At<Value>>;

/// Takes the scalar keys out of `table` and those in it; `path` leads to it. Fails for an integer of more than 64 bits.
pub(super) fn take_scalars(
    table: &mut DeTable<'_>,
    path: &[&str],
    scalars: &mut Scalars,
) -> Result<(), toml::de::Error> {
    for name in scalars_of(path) {
        if let Some(stated) = table.remove(name) {
            let span = stated.span();
            let value = Value::deserialize(ValueDeserializer::from(stated))?;
            scalars.insert([path, &[name]].concat().join("."), Spanned::new(span, value));
        }
    }
    for (name, inner) in table.iter_mut() {
        if let DeValue::Table(inner) = inner.get_mut() {
            take_scalars(inner, &[path, &[&**name.get_ref()]].concat(), scalars)?;
        }
    }
    Ok(())
}

/// Names of the scalar keys in the table of this path.
pub(super) fn scalars_of(table: &[&str]) -> Vec<&'static str> {
    match table {
        ["materials", _] => key::MATERIAL.iter().map(|key| key.path).collect(),
        ["lights", _] => key::LIGHT.iter().map(|key| key.path).collect(),
        _ => {
            let beginning: String = table.iter().map(|part| format!("{part}.")).collect();
            let names = key::SCENE.iter().filter_map(|key| key.path.strip_prefix(&beginning));
            names.filter(|name| !name.contains('.')).collect()
        }
    }
}

/// The text of a whole number, or a text.
fn number_or_text<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<String>, D::Error> {
    struct Either;
    impl Visitor<'_> for Either {
        type Value = String;

        fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
            formatter.write_str("a whole number or a string")
        }

        fn visit_i64<E: Error>(self, number: i64) -> Result<String, E> {
            Ok(number.to_string())
        }

        fn visit_str<E: Error>(self, text: &str) -> Result<String, E> {
            Ok(text.to_owned())
        }
    }
    deserializer.deserialize_any(Either).map(Some)
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct VolumeFile {
    /// Name of the first field.
    pub(super) name: Option<At<String>>,
    pub(super) file: Option<PathBuf>,
    pub(super) phantom: Option<At<String>>,
    pub(super) labels: Option<PathBuf>,
    pub(super) phantom_labels: Option<At<bool>>,
    #[serde(default)]
    pub(super) are_labels: bool,
    pub(super) label_names: Option<PathBuf>,
    #[serde(default, deserialize_with = "counts")]
    pub(super) downsample: Option<[NonZeroUsize; 3]>,
    pub(super) largest_part_above: Option<At<f64>>,
    pub(super) without_specks: Option<At<SpecksFile>>,
    #[serde(default, deserialize_with = "counts")]
    pub(super) dims: Option<[NonZeroUsize; 3]>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) spacing: Option<At<[f64; 3]>>,
    pub(super) unit: Option<At<String>>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) origin: Option<At<[f64; 3]>>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) direction: Option<At<[f64; 9]>>,
    pub(super) r#type: Option<At<String>>,
    #[serde(default)]
    pub(super) byte_order: ByteOrder,
    #[serde(default)]
    pub(super) header_bytes: u64,
    pub(super) slices: Option<Vec<i64>>,
    pub(super) component: Option<usize>,
    pub(super) time: Option<usize>,
    pub(super) array: Option<String>,
    #[serde(default, deserialize_with = "number_or_text")]
    pub(super) series: Option<String>,
    pub(super) level: Option<usize>,
    pub(super) axes: Option<String>,
    #[serde(default)]
    pub(super) resample: bool,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MaterialFile {
    pub(super) reflectance: Option<At<SpectrumSource>>,
    pub(super) absorption: Option<At<SpectrumSource>>,
    pub(super) film: Option<At<ThinFilmFile>>,
    /// Short for `occludes = 0`, unless that is stated.
    pub(super) xray: Option<bool>,
    pub(super) emission: Option<At<Value>>,
    pub(super) fluorescence: Option<At<Value>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ThinFilmFile {
    pub(super) index: Option<At<f64>>,
    pub(super) thickness: Option<At<f64>>,
    pub(super) above: Option<At<f64>>,
    pub(super) below: Option<At<f64>>,
    #[serde(default)]
    pub(super) angle: ThinFilmAngle,
}

impl Root {
    /// Name of the first field.
    pub(super) fn first_field(&self) -> &str {
        self.volume.name.as_ref().map_or(FIRST_FIELD, |name| name.get_ref())
    }

    /// Names of the fields besides the one with this name.
    pub(super) fn fields_beside(&self, name: &str) -> Vec<&str> {
        let all = std::iter::once(self.first_field()).chain(self.volumes.keys().map(String::as_str));
        all.filter(|other| *other != name).collect()
    }
}

/// A further field.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FurtherFile {
    pub(super) file: Option<PathBuf>,
    pub(super) phantom: Option<At<String>>,
    pub(super) component: Option<usize>,
    pub(super) time: Option<usize>,
    pub(super) array: Option<String>,
    #[serde(default, deserialize_with = "number_or_text")]
    pub(super) series: Option<String>,
    /// Values that become 1; all others become 0.
    pub(super) only: Option<At<Vec<f64>>>,
    pub(super) transform: Option<At<TransformFile>>,
    /// None of a field that shows nothing itself, such as a mask.
    pub(super) transfer: Option<At<TransferFile>>,
}

/// A transform by its numbers, or in a file.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "a transform is 12 numbers by rows, [1, 0, 0, x, 0, 1, 0, y, 0, 0, 1, z], or a file of ITK (.tfm)"
)]
pub(super) enum TransformFile {
    Numbers([f64; 12]),
    File(PathBuf),
}

impl TransformFile {
    /// Its file, if it has one.
    pub(super) fn file(&self, base: &Path) -> Option<PathBuf> {
        match self {
            Self::Numbers(_) => None,
            Self::File(path) => Some(base.join(path)),
        }
    }
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TransferFile {
    /// Lowest and highest value to which the terms are stretched.
    #[serde(default, deserialize_with = "numbers")]
    pub(super) range: Option<At<[f64; 2]>>,
    #[serde(default)]
    pub(super) intervals: Vec<IntervalFile>,
    #[serde(default, deserialize_with = "lists")]
    pub(super) opacity: Option<At<Vec<[f64; 2]>>>,
    #[serde(default, deserialize_with = "lists")]
    pub(super) absorption: Option<At<Vec<[f64; 2]>>>,
    #[serde(default, deserialize_with = "materials_from")]
    pub(super) material: Option<At<Vec<(f64, String)>>>,
    #[serde(default, deserialize_with = "lists")]
    pub(super) gradient_opacity: Option<At<Vec<[f64; 2]>>>,
    /// Factors by the values of other fields on all terms without such factors of their own.
    pub(super) by: Option<ByFile>,
}

/// Points of a factor by the value of each named field.
pub(super) type ByFile = BTreeMap<String, At<ListsFile>>;

/// A list of pairs of numbers.
#[derive(Deserialize)]
pub(super) struct ListsFile(Vec<List<f64, 2>>);

impl ListsFile {
    pub(super) fn pairs(&self) -> Vec<[f64; 2]> {
        self.0.iter().map(|pair| pair.0).collect()
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct IntervalFile {
    pub(super) material: At<String>,
    #[serde(deserialize_with = "stated_numbers")]
    pub(super) range: At<[f64; 2]>,
    pub(super) ramp: Option<At<f64>>,
    pub(super) opacity: At<f64>,
    pub(super) absorption: Option<At<f64>>,
    #[serde(default, deserialize_with = "lists")]
    pub(super) gradient: Option<At<Vec<[f64; 2]>>>,
    pub(super) by: Option<ByFile>,
    pub(super) shape: Option<At<ShapeFile>>,
}

/// A factor over a plane.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ShapeFile {
    /// The gradient, or the name of another field.
    pub(super) by: String,
    #[serde(default, deserialize_with = "lists")]
    pub(super) polygon: Option<At<Vec<[f64; 2]>>>,
    pub(super) soft: Option<At<f64>>,
    #[serde(default, deserialize_with = "lists")]
    pub(super) ratio: Option<At<Vec<[f64; 2]>>>,
    pub(super) image: Option<String>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) values: Option<At<[f64; 2]>>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) second: Option<At<[f64; 2]>>,
}

/// Parts of fewer than `voxels` voxels above a value.
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a table of `above` and `voxels`")]
pub(super) struct SpecksFile {
    pub(super) above: f64,
    pub(super) voxels: usize,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LabelFile {
    pub(super) name: Option<String>,
    pub(super) material: Option<At<String>>,
    /// Of the entry `others` alone.
    pub(super) materials: Option<At<Vec<String>>>,
    pub(super) opacity: Option<At<f64>>,
    pub(super) absorption: Option<At<f64>>,
    /// In place of material, opacity and absorption.
    pub(super) transfer: Option<At<TransferFile>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LightFile {
    pub(super) spectrum: Option<At<SpectrumSource>>,
    #[serde(default)]
    pub(super) kind: LightKind,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) direction: Option<At<[f64; 3]>>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) position: Option<At<[f64; 3]>>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DialFile {
    pub(super) normalise: Option<bool>,
    pub(super) master: Option<At<f64>>,
    #[serde(default)]
    pub(super) off: Vec<At<String>>,
    #[serde(default, deserialize_with = "places")]
    pub(super) nodes: BTreeMap<String, At<[f64; 2]>>,
    #[serde(default)]
    pub(super) presets: Vec<PresetFile>,
    /// Former name of `presets`.
    #[serde(default)]
    pub(super) situations: Vec<PresetFile>,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MixFile {
    #[serde(default)]
    pub(super) by: Mixing,
    pub(super) hand: Option<At<HandFile>>,
    #[serde(default)]
    pub(super) weights: BTreeMap<String, At<f64>>,
    #[serde(default)]
    pub(super) off: Vec<At<String>>,
    #[serde(default)]
    pub(super) on: Vec<At<String>>,
    pub(super) solo: Option<At<String>>,
    #[serde(default)]
    pub(super) normalise: bool,
    pub(super) master: Option<At<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PresetFile {
    pub(super) name: String,
    #[serde(default)]
    pub(super) caption: String,
    pub(super) hand: At<HandFile>,
    #[serde(default)]
    pub(super) off: Vec<At<String>>,
    #[serde(default)]
    pub(super) on: Vec<At<String>>,
}

/// A node, by the name of its light, or a position.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a hand is the name of a light, or [x, y]")]
pub(super) enum HandFile {
    Node(String),
    Place([f64; 2]),
}

/// One fraction, or pairs of an aspect ratio and a fraction.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a fill is a number, or pairs of an aspect ratio and a number, [[0.75, 0.9], [1.5, 1]]")]
pub(super) enum FillFile {
    One(f64),
    ByAspect(Vec<[f64; 2]>),
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraFile {
    #[serde(default)]
    pub(super) projection: ProjectionFile,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) position: Option<At<[f64; 3]>>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) target: Option<At<[f64; 3]>>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) up: Option<At<[f64; 3]>>,
    #[serde(default, deserialize_with = "numbers")]
    pub(super) front: Option<At<[f64; 3]>>,
    pub(super) fill: Option<At<FillFile>>,
    #[serde(default, deserialize_with = "corners")]
    pub(super) around: Option<At<[[f64; 3]; 2]>>,
}

#[derive(Clone, Copy, Default, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum ProjectionFile {
    #[default]
    Perspective,
    Orthographic,
}

/// Clip planes.
#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClipFile {
    #[serde(default)]
    pub(super) planes: Vec<At<ClipPlaneFile>>,
    #[serde(default)]
    pub(super) keep: KeepFile,
    pub(super) cap: Option<bool>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum KeepFile {
    #[default]
    All,
    Any,
}

/// A clip plane by its numbers, or in short.
#[derive(Deserialize)]
#[serde(
    untagged,
    expecting = "a clip plane is { point = [x, y, z], normal = [x, y, z] } or { plane = \"z:50%\" }, also with on = false and volumes = [\"pet\"], or a text such as \"z:50%\""
)]
pub(super) enum ClipPlaneFile {
    Short(String),
    Text(ClipText),
    Numbers(ClipNumbers),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClipText {
    pub(super) plane: String,
    pub(super) on: Option<bool>,
    pub(super) volumes: Option<Vec<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClipNumbers {
    pub(super) point: [f64; 3],
    pub(super) normal: [f64; 3],
    pub(super) on: Option<bool>,
    pub(super) volumes: Option<Vec<String>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CropFile {
    #[serde(deserialize_with = "three_places")]
    pub(super) min: [PlaceFile; 3],
    #[serde(deserialize_with = "three_places")]
    pub(super) max: [PlaceFile; 3],
}

/// A place along an axis of the volume.
#[derive(Deserialize)]
#[serde(untagged, expecting = "a place along an axis is a voxel index, or a text such as \"25%\"")]
pub(super) enum PlaceFile {
    Voxel(f64),
    Part(String),
}

fn three_places<'de, D: Deserializer<'de>>(stated: D) -> Result<[PlaceFile; 3], D::Error> {
    List::deserialize(stated).map(|list| list.0)
}
