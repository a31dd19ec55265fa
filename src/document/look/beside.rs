//! Volumes beside that of a first look, each on its own grid: a material that glows (docs/theory/fields.md).

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::str::FromStr as _;
use std::sync::Arc;

use toml_edit::{DocumentMut, InlineTable, Item, Table, Value, value};

use super::channels::{brighten, number, number_in, rename};
use super::first_look::{Look, LookError, SURFACE, Subject, Values, Wish, first_look};
use relume_base::number::brief_in;
use relume_base::progress::Progress;
use relume_volume::Volume;

/// Reflectances of such materials in their order, where the first look has no designed spectra: patches of the ColorChecker.
const COLOURS: [&str; 3] = ["magenta", "cyan", "orange"];

/// Part of the optical depth that the surface of a ragged object keeps, so that what glows inside is seen.
const GLASS: f64 = 0.05;

/// Number in the design of what glows beside a first look, in their order: the last are nearest to its own colours.
const GLOWS: [usize; 3] = [3, 2, 1];

/// Part of the voxels of a volume beside the first that shows nothing: its surroundings and what is everywhere, as the blood in a PET.
const DARK: f64 = 0.95;

/// Designed spectra of the materials of a first look and of what glows beside them, each with a light of its own.
const DESIGN: &str = include_str!("../../../data/scenes/volume_beside.toml");

/// A volume beside the first, with its file.
pub(crate) struct BesideVolume {
    pub(crate) path: PathBuf,
    /// The time step that was chosen among several.
    pub(crate) time: Option<usize>,
    pub(crate) volume: Arc<Volume>,
}

/// A first look with volumes beside it.
pub(crate) struct BesideLook {
    pub(crate) text: String,
    pub(crate) guess: String,
}

/// The first look `text` of the volume in the file `first` with this smallest `spacing`, and `others` beside it: their high values add light and hide nothing.
///
/// # Errors
///
/// [`LookError`].
pub(crate) fn beside(
    (text, first): (&str, &Path),
    spacing: f64,
    others: &mut [BesideVolume],
    progress: &dyn Progress,
) -> Result<BesideLook, LookError> {
    let mut document: DocumentMut = text.parse().unwrap_or_default();
    let mut taken: BTreeSet<String> = document["materials"]
        .as_table_like()
        .into_iter()
        .flat_map(|table| table.iter().map(|(name, _)| name.to_owned()))
        .collect();
    let length = |transfer: &Item, spacing: f64| {
        transfer.get("opacity_length").and_then(Item::as_value).and_then(number_in).unwrap_or(spacing)
    };
    let ours = length(&document["transfer"], spacing);
    make_glass(&mut document["transfer"]);
    // Of the largest values an opacity length of each is seen.
    let is_largest = document.get("blending").is_some();
    let (mut told, mut names) = (Vec::new(), Vec::new());
    let mut volumes = Table::new();
    volumes.set_implicit(true);
    document["volume"]["name"] = value(free_name(first, &mut taken));
    for (index, BesideVolume { path, time, volume }) in others.iter_mut().enumerate() {
        let name = free_name(path, &mut taken);
        let statistics = volume.statistics()?;
        let wish = (Wish { look: Some(Look::Fluorescence), ..Wish::default() }, Subject::default());
        let look = first_look(&name, volume, &statistics, wish, progress)?;
        let looked: DocumentMut = look.text.parse().unwrap_or_default();
        let theirs = length(&looked["transfer"], volume.geometry.spacing.min_element());
        let mut transfer = looked["transfer"].as_table().cloned().unwrap_or_default();
        transfer.remove("opacity_length");
        rename(&mut transfer, &name);
        let values = Values::of(volume, &statistics);
        raise(&mut transfer, [values.percentile(DARK), values.percentile(0.9995)]);
        if is_largest {
            brighten(&mut transfer);
        }
        if let Some(points) = transfer.get_mut("opacity").and_then(Item::as_array_mut) {
            // An opacity of one length is one of another.
            for point in points.iter_mut().filter_map(Value::as_array_mut) {
                if let Some(opacity) = point.get(1).and_then(number_in).filter(|_| !is_largest) {
                    let scaled = -((-opacity).ln_1p() * ours / theirs).exp_m1();
                    point.replace(1, number((scaled * 1e6).round() / 1e6));
                }
            }
            let ends = [points.get(0), points.get(points.len().saturating_sub(1))];
            if let [Some(low), Some(high)] = ends.map(|point| number_in(point?.as_array()?.get(0)?)) {
                let [low, high] = [low, high].map(|end| brief_in(end, statistics.max - statistics.min));
                told.push(format!("{name} from {low} to {high}"));
            }
        }
        let mut material = Table::new();
        material.insert("reflectance", value(COLOURS[index % COLOURS.len()]));
        material.insert("ambient", value(1));
        material.insert("diffuse", value(0));
        material.insert("xray", value(true));
        document["materials"][&name] = Item::Table(material);
        let mut own = Table::new();
        // Wherever the scene is saved.
        let path = std::path::absolute(&*path).unwrap_or_else(|_| path.clone());
        own.insert("file", value(path.display().to_string()));
        if let Some(time) = *time {
            own.insert("time", value(i64::try_from(time).unwrap_or(i64::MAX)));
        }
        own.insert("transfer", Item::Table(transfer));
        volumes.insert(&name, Item::Table(own));
        names.push(name);
    }
    document.insert("volumes", Item::Table(volumes));
    // A sample has several fields.
    document.get_mut("accuracy").and_then(Item::as_table_mut).and_then(|accuracy| accuracy.remove("integration"));
    let lights = give_lights(&mut document, &names);
    let what = if is_largest { "the largest values, as light that adds up" } else { "what glows and hides nothing" };
    let alone = if lights.is_empty() {
        String::new()
    } else {
        format!(" Alone it is seen under the light {}.", lights.join(", "))
    };
    let guess = format!(" Beside it, where each is in the world, {what}: {}.{alone}", told.join(", "));
    Ok(BesideLook { text: document.to_string(), guess })
}

/// Makes glass of the surface in a `transfer`, if there is one.
fn make_glass(transfer: &mut Item) {
    let intervals = transfer.get_mut("intervals").and_then(Item::as_array_mut);
    let tables =
        intervals.into_iter().flat_map(|intervals| intervals.iter_mut()).filter_map(Value::as_inline_table_mut);
    for interval in tables.filter(|it| it.get("material").and_then(Value::as_str) == Some(SURFACE)) {
        if let Some(opacity) = interval.get_mut("opacity")
            && let Some(solid) = number_in(opacity)
        {
            *opacity = number((-(GLASS * (-solid).ln_1p()).exp_m1() * 1e6).round() / 1e6);
        }
    }
}

/// Gives the designed materials of a first look and those of the volumes beside it spectra by which each light shows one of them; returns
/// the names of the new lights. None, if the look has other spectra.
fn give_lights(document: &mut DocumentMut, names: &[String]) -> Vec<String> {
    let design: DocumentMut = DESIGN.parse().unwrap_or_default();
    let code = |cells: &Item, name: &str| Some(cells.get(name)?.get("day")?.as_str()?.to_owned());
    let theirs = &design["palette"]["cells"];
    let first = [super::first_look::DESIGN, super::first_look::TISSUE];
    let first = first.map(|design| DocumentMut::from_str(design).unwrap_or_default());
    // The part in the design of each material of the look, by its colour in that of looks without others.
    let part = |document: &DocumentMut, name: &str| {
        let colour = code(document.get("palette")?.get("cells")?, name)?;
        let is_of = |part: &str| first.iter().any(|it| code(&it["palette"]["cells"], part).as_ref() == Some(&colour));
        super::first_look::DESIGNED.into_iter().find(|part| is_of(part)).map(str::to_owned)
    };
    let materials = document.get("palette").and_then(|palette| palette.get("materials")?.as_table_like());
    let ours: Vec<String> =
        materials.map_or_else(Vec::new, |table| table.iter().map(|(name, _)| name.to_owned()).collect());
    let parts: Option<Vec<String>> = ours.iter().map(|name| part(document, name)).collect();
    let Some(parts) = parts.filter(|parts| !parts.is_empty()) else { return Vec::new() };
    let glows = GLOWS.into_iter().map(|number| format!("glow{number}"));
    let all: Vec<(String, String)> = ours.iter().chain(names).cloned().zip(parts.into_iter().chain(glows)).collect();
    let light = |name: &str| format!("for_{name}");
    for (name, part) in &all {
        let mut cells = InlineTable::new();
        cells.insert("day", code(theirs, part).unwrap_or_default().into());
        for (other, _) in &all {
            cells.insert(light(other), if other == name { "as under day" } else { "black" }.into());
        }
        document["palette"]["cells"][name] = value(cells);
        for side in ["materials", "lights"] {
            let key = if side == "lights" { light(name) } else { name.clone() };
            if document["palette"][side].get(&key).is_none() {
                document["palette"][side][&key] = Item::Table(Table::new());
            }
        }
        document["materials"][name]["reflectance"] = design["materials"][part]["reflectance"].clone();
        document["lights"][&light(name)] = design["lights"][&light(part)].clone();
    }
    // All lights alike: others would have accumulators of their own.
    let casts = document["lights"].get("day").and_then(|day| day.get("shadows")).cloned();
    if let Some(casts) = casts {
        names.iter().for_each(|name| document["lights"][&light(name)]["shadows"] = casts.clone());
    }
    names.iter().map(|name| light(name)).collect()
}

/// Lets the curves of `transfer` begin at `low` and end at `high`, if they begin and end below.
fn raise(transfer: &mut Table, [low, high]: [f64; 2]) {
    let value_of = |point: &Value| number_in(point.as_array()?.get(0)?);
    let curve = |transfer: &Table| -> Option<[f64; 2]> {
        let points = transfer.get("opacity")?.as_array()?;
        Some([value_of(points.get(0)?)?, value_of(points.get(points.len().checked_sub(1)?)?)?])
    };
    let Some([from, to]) = curve(transfer) else { return };
    let [low, high] = [low.max(from), high.max(to)];
    if !(from < to && low < high) {
        return;
    }
    for name in ["opacity", "material"] {
        let points = transfer.get_mut(name).and_then(Item::as_array_mut);
        for point in points.into_iter().flat_map(|points| points.iter_mut()).filter_map(Value::as_array_mut) {
            if let Some(value) = point.get(0).and_then(number_in) {
                point.replace(0, number((value - from) / (to - from) * (high - low) + low));
            }
        }
    }
}

/// A name for keys from that of a file.
fn free_name(path: &Path, taken: &mut BTreeSet<String>) -> String {
    let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let stem = file.split('.').next().unwrap_or_default().trim();
    let stem = if stem.is_empty() { "volume" } else { stem }.to_owned();
    let different = (2..).map(|number| format!("{stem} {number}"));
    std::iter::once(stem.clone()).chain(different).find(|name| taken.insert(name.clone())).unwrap_or(stem)
}
