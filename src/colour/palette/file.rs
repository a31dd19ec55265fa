//! The palette file: parsing of TOML with error positions, and writing of solved palettes.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::IgnoredAny;
use toml::Spanned;

use super::{
    Cell, LAMP, Member, ModelTerm, NATURAL, Palette, PaletteError, SMOOTHNESS, Solution, Target, WEIGHTS, range,
};
use crate::model::LARGEST_DIMENSION;
use crate::spectrum::colour::{Lab, Xyz};
use crate::spectrum::{Kind, Spectrum, SpectrumError, SpectrumSource, nearest, srgb_code};
use crate::written::{numbers, place, with_suggestion};
use relume_base::input;
use relume_base::number::readable;

/// A value with its position in the file.
type At<T> = Spanned<T>;

/// Largest size of a palette file in bytes; larger than any that a person writes.
const LONGEST: u64 = 1 << 19;
/// Keyword of an open spectrum; an absent key means the same.
const OPEN: &str = "open";

/// Palette as written: a file, or a table of a scene.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaletteFile {
    version: Option<At<i64>>,
    /// In a scene: file with the whole palette.
    pub r#use: Option<At<PathBuf>>,
    #[serde(default)]
    materials: BTreeMap<String, At<RowFile>>,
    #[serde(default)]
    lights: BTreeMap<String, At<ColumnFile>>,
    #[serde(default)]
    cells: BTreeMap<String, At<BTreeMap<String, At<CellFile>>>>,
    model: Option<At<ModelFile>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct RowFile {
    reflectance: Option<At<SpectrumSource>>,
    #[serde(default, deserialize_with = "numbers")]
    bounds: Option<At<[f64; 2]>>,
    smoothness: Option<At<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ColumnFile {
    spectrum: Option<At<SpectrumSource>>,
    #[serde(default, deserialize_with = "numbers")]
    bounds: Option<At<[f64; 2]>>,
    smoothness: Option<At<f64>>,
}

#[derive(Debug, Deserialize)]
#[serde(
    untagged,
    expecting = "a cell is a string (\"#rrggbb\", \"black\", \"free\", \"as ROW\", \"as under COLUMN\") or a table \
                                with one of `target` (one of these strings), `xyz` and `lab`, and an optional `weight`"
)]
enum CellFile {
    Text(String),
    /// Parsed later, so that errors name the wrong key or value of the table.
    Table(toml::Table),
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct CellTable {
    target: Option<String>,
    xyz: Option<[f64; 3]>,
    lab: Option<[f64; 3]>,
    weight: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelFile {
    k: usize,
    weight: Option<f64>,
}

/// Error with its byte offset in the text.
#[derive(Debug)]
pub struct Misplaced {
    /// Offset in the text.
    pub byte: usize,
    /// Message without the position.
    pub message: String,
    /// Error of a file that it names.
    pub cause: Option<SpectrumError>,
}

impl Misplaced {
    fn new<T>(at: &At<T>, message: impl Into<String>) -> Self {
        Self { byte: at.span().start, message: message.into(), cause: None }
    }
}

/// Part of a scene file that concerns palettes.
#[derive(Deserialize)]
struct SceneFile {
    palette: Option<At<PaletteFile>>,
    /// Tells a scene from a palette file, which has no volume.
    volume: Option<IgnoredAny>,
}

/// Reads the palette file `path`, or the `[palette]` of the scene `path`.
///
/// # Errors
///
/// [`PaletteError::Read`] for an unreadable file; [`PaletteError::Invalid`] and [`PaletteError::Spectrum`], with their
/// position, for invalid content.
pub fn load(path: &Path) -> Result<Palette, PaletteError> {
    let read = |source| PaletteError::Read { path: path.to_owned(), source };
    let name = path.display().to_string();
    let file = input::open(path).map_err(read)?;
    let length = file.metadata().map_err(read)?.len();
    if length > LONGEST {
        let message = format!("a palette file has at most {LONGEST} bytes, but this one has {length}");
        return Err(PaletteError::Invalid { at: name, message });
    }
    let mut bytes = Vec::new();
    file.take(LONGEST).read_to_end(&mut bytes).map_err(read)?;
    let text = String::from_utf8(bytes).map_err(|error| PaletteError::Invalid {
        at: name.clone(),
        message: format!("not UTF-8 text from byte {} on", error.utf8_error().valid_up_to()),
    })?;
    parse(&name, &text, path.parent().unwrap_or(Path::new("")))
}

/// Parses the `[palette]` of the scene `text`, like [`parse`]; `None` if it has none.
///
/// # Errors
///
/// Same as [`load`].
pub fn of_scene(name: &str, text: &str, base: &Path) -> Result<Option<Palette>, PaletteError> {
    // Text that is not a scene is not a palette either; `parse` reports its error.
    let has_none = toml::from_str(text).is_ok_and(|scene: SceneFile| scene.palette.is_none());
    if has_none { Ok(None) } else { parse(name, text, base).map(Some) }
}

/// Parses a palette from `text`, a palette file or a scene. `name` starts messages; relative paths start at `base`.
///
/// # Errors
///
/// Same as [`load`].
pub fn parse(name: &str, text: &str, base: &Path) -> Result<Palette, PaletteError> {
    let invalid = |byte, message| PaletteError::Invalid { at: place(name, text, byte), message };
    let misread =
        |error: toml::de::Error| invalid(error.span().map_or(0, |span| span.start), with_suggestion(error.message()));
    let misplaced = |Misplaced { byte, message, cause }| match cause {
        None => invalid(byte, message),
        Some(source) => PaletteError::Spectrum { at: place(name, text, byte), what: message, source },
    };
    let scene: SceneFile = toml::from_str(text).map_err(misread)?;
    if let Some(table) = scene.palette.map(At::into_inner) {
        let Some(other) = &table.r#use else { return table.resolve(name, base).map_err(misplaced) };
        if table.says_more_than_use() {
            return Err(invalid(other.span().start, "`use` excludes all other keys of [palette]".to_owned()));
        }
        let path = base.join(other.get_ref());
        let mut palette = load(&path)?;
        palette.inputs.push(path);
        return Ok(palette);
    }
    if scene.volume.is_some() {
        return Err(invalid(0, "the scene has no [palette]; docs/PALETTE.md lists its keys".to_owned()));
    }
    let file: PaletteFile = toml::from_str(text).map_err(misread)?;
    match file.version.as_ref().map(|version| (version, *version.get_ref())) {
        Some((_, 1)) => {}
        Some((at, version)) => {
            return Err(invalid(at.span().start, format!("version = {version}; this program reads version 1")));
        }
        None => return Err(invalid(0, "missing field `version`; write version = 1".to_owned())),
    }
    if let Some(other) = &file.r#use {
        return Err(invalid(other.span().start, "`use` is only allowed in the [palette] of a scene".to_owned()));
    }
    file.resolve(name, base).map_err(misplaced)
}

impl PaletteFile {
    /// Whether there is any key besides `use`.
    pub fn says_more_than_use(&self) -> bool {
        !(self.materials.is_empty() && self.lights.is_empty() && self.cells.is_empty())
            || self.version.is_some()
            || self.model.is_some()
    }

    /// Builds the palette, with relative paths from `base`. Rows and columns keep the order of the file.
    ///
    /// # Errors
    ///
    /// [`Misplaced`] for a value that no palette has, with its place in the text.
    pub fn resolve(&self, source: &str, base: &Path) -> Result<Palette, Misplaced> {
        let mut inputs = Vec::new();
        let mut materials = Vec::new();
        for (name, at) in in_order(&self.materials) {
            let file = at.get_ref();
            let key = format!("materials.{name}");
            let of = |source: &SpectrumSource| Ok(source.reflectance(base)?.spectrum().clone());
            let spectrum = spectrum(&format!("{key}.reflectance"), file.reflectance.as_ref(), base, &mut inputs, of)?;
            materials.push(member(
                &key,
                name,
                spectrum,
                file.bounds.as_ref(),
                file.smoothness.as_ref(),
                Kind::Reflectance,
            )?);
        }
        let mut lights = Vec::new();
        for (name, at) in in_order(&self.lights) {
            let file = at.get_ref();
            let key = format!("lights.{name}");
            let of = |source: &SpectrumSource| Ok(source.light(base)?.spectrum().clone());
            let spectrum = spectrum(&format!("{key}.spectrum"), file.spectrum.as_ref(), base, &mut inputs, of)?;
            lights.push(member(&key, name, spectrum, file.bounds.as_ref(), file.smoothness.as_ref(), Kind::Light)?);
        }
        let mut cells = Vec::new();
        for (row, at) in in_order(&self.cells) {
            let material = index(row, &materials, "material").map_err(|message| Misplaced::new(at, message))?;
            for (column, cell) in in_order(at.get_ref()) {
                let light = index(column, &lights, "light").map_err(|message| Misplaced::new(cell, message))?;
                let made = target(cell.get_ref(), (material, light), &materials, &lights);
                let made = made.map_err(|message| Misplaced::new(cell, format!("cells.{row}.{column}: {message}")))?;
                cells.extend(made.map(|(target, weight)| Cell { material, light, target, weight }));
            }
        }
        let model = self.model.as_ref().map(|at| {
            let ModelFile { k, weight } = at.get_ref();
            let weight = weight.unwrap_or(1.0);
            if !(1..=LARGEST_DIMENSION).contains(k) {
                return Err(Misplaced::new(
                    at,
                    format!("model.k = {k}; it must be a whole number from 1 to {LARGEST_DIMENSION}"),
                ));
            }
            if !WEIGHTS.contains(&weight) {
                return Err(Misplaced::new(
                    at,
                    format!("model.weight = {}; it must be {}", readable(weight), range(&WEIGHTS)),
                ));
            }
            Ok(ModelTerm { dimension: *k, weight })
        });
        Ok(Palette { source: source.to_owned(), inputs, materials, lights, cells, model: model.transpose()? })
    }
}

/// Entries of a table in the order of the file, not sorted by name.
fn in_order<T>(table: &BTreeMap<String, At<T>>) -> Vec<(&String, &At<T>)> {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(_, value)| value.span().start);
    entries
}

/// Loads a given spectrum, and adds its file to `inputs`; `None` if it is open.
fn spectrum(
    key: &str,
    stated: Option<&At<SpectrumSource>>,
    base: &Path,
    inputs: &mut Vec<PathBuf>,
    of: impl Fn(&SpectrumSource) -> Result<Spectrum, SpectrumError>,
) -> Result<Option<Spectrum>, Misplaced> {
    let open = SpectrumSource::Named(OPEN.to_owned());
    let Some(stated) = stated.filter(|stated| *stated.get_ref() != open) else { return Ok(None) };
    inputs.extend(stated.get_ref().file(base));
    let spectrum = of(stated.get_ref());
    spectrum.map(Some).map_err(|cause| Misplaced { cause: Some(cause), ..Misplaced::new(stated, key) })
}

fn member(
    key: &str,
    name: &str,
    spectrum: Option<Spectrum>,
    bounds: Option<&At<[f64; 2]>>,
    smoothness: Option<&At<f64>>,
    kind: Kind,
) -> Result<Member, Misplaced> {
    let otherwise = if kind == Kind::Light { LAMP } else { NATURAL };
    let made = Member {
        name: name.to_owned(),
        spectrum,
        bounds: bounds.map_or(otherwise, |bounds| *bounds.get_ref()),
        smoothness: smoothness.map_or(SMOOTHNESS, |smoothness| *smoothness.get_ref()),
    };
    if let (Some(at), Some(problem)) = (bounds, made.bounds_problem(kind)) {
        return Err(Misplaced::new(at, format!("{key}.bounds: {problem}")));
    }
    if let (Some(at), Some(problem)) = (smoothness, made.smoothness_problem()) {
        return Err(Misplaced::new(at, format!("{key}.smoothness: {problem}")));
    }
    Ok(made)
}

fn index(name: &str, members: &[Member], what: &str) -> Result<usize, String> {
    let names = || members.iter().map(|member| member.name.as_str());
    members.iter().position(|member| member.name == name).ok_or_else(|| match nearest(name, names()) {
        Some(nearest) => format!("there is no {what} {name:?}; did you mean {nearest:?}?"),
        None => format!("there is no {what} {name:?}; the {what}s are {}", names().collect::<Vec<_>>().join(", ")),
    })
}

/// Target and weight of a cell; `None` for a free cell.
fn target(
    file: &CellFile,
    (material, light): (usize, usize),
    materials: &[Member],
    lights: &[Member],
) -> Result<Option<(Target, f64)>, String> {
    let table = match file {
        CellFile::Text(text) => CellTable { target: Some(text.clone()), ..CellTable::default() },
        CellFile::Table(table) => {
            table.clone().try_into().map_err(|error: toml::de::Error| with_suggestion(error.message()))?
        }
    };
    let finite = |numbers: [f64; 3]| match numbers.iter().all(|number| number.is_finite()) {
        true => Ok(numbers),
        false => Err(format!("{numbers:?} is not a colour; a colour has three finite numbers")),
    };
    let target = match (&table.target, table.xyz, table.lab) {
        (Some(text), None, None) => match text.trim() {
            "free" => return Ok(None),
            "black" => Target::Black,
            text if text.starts_with('#') => Target::Srgb(srgb_code(text).map_err(|error| error.to_string())?),
            text => match text.strip_prefix("as ").map(str::trim) {
                None => {
                    return Err(format!(
                        "{text:?} is not a target; write \"#rrggbb\", \"black\", \"free\", \"as ROW\", \"as under COLUMN\", or a table of xyz or lab"
                    ));
                }
                Some(like) => {
                    let (row, column) = match like.strip_prefix("under ") {
                        Some(column) => (None, Some(column.trim())),
                        None if materials.iter().any(|row| row.name == like) => (Some(like), None),
                        None => match like.split_once(" under ") {
                            Some((row, column)) => (Some(row.trim()), Some(column.trim())),
                            None => (Some(like), None),
                        },
                    };
                    Target::Like {
                        material: row.map_or(Ok(material), |row| index(row, materials, "material"))?,
                        light: column.map_or(Ok(light), |column| index(column, lights, "light"))?,
                    }
                }
            },
        },
        (None, Some(xyz), None) => Target::Xyz(Xyz(finite(xyz)?)),
        (None, None, Some(lab)) => Target::Lab(Lab(finite(lab)?)),
        _ => return Err("give exactly one of `target`, `xyz` and `lab`".to_owned()),
    };
    let weight = table.weight.unwrap_or(1.0);
    if !WEIGHTS.contains(&weight) {
        return Err(format!(
            "weight = {}; it must be {} (use \"free\" for a cell without a target)",
            readable(weight),
            range(&WEIGHTS)
        ));
    }
    Ok(Some((target, weight)))
}

/// Quotes a text as a one-line TOML string, also valid as a key.
fn quoted(text: &str) -> String {
    let letter = |letter: char| match letter {
        '"' | '\\' => format!("\\{letter}"),
        letter if letter.is_control() => format!("\\u{:04x}", u32::from(letter)),
        letter => letter.to_string(),
    };
    format!("\"{}\"", text.chars().map(letter).collect::<String>())
}

impl Solution {
    /// Writes the palette as a file with all spectra given. Loaded, it has exactly the colours of this solution.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let head = format!(
            "# Designed by relume {} from {}.\n# The largest ΔE00 from the targets in [cells] is {:.4}.\n",
            env!("CARGO_PKG_VERSION"),
            self.palette.source.replace(['\n', '\r'], " "),
            self.worst()
        );
        let materials: Vec<_> = self.materials.iter().map(|row| Some(row.spectrum())).collect();
        let lights: Vec<_> = self.lights.iter().map(|column| Some(column.spectrum())).collect();
        head + &self.palette.to_toml(&materials, &lights)
    }
}

impl Palette {
    /// Writes the palette as a file with these spectra of its rows and columns; `None` is open.
    #[must_use]
    pub fn to_toml(&self, materials: &[Option<&Spectrum>], lights: &[Option<&Spectrum>]) -> String {
        let palette = self;
        let mut text = "version = 1\n".to_owned();
        let mut members = |table: &str, key: &str, members: &[Member], spectra: &[Option<&Spectrum>]| {
            for (member, spectrum) in members.iter().zip(spectra) {
                let [low, high] = member.bounds;
                let spectrum = spectrum
                    .map_or_else(|| quoted(OPEN), |spectrum| format!("{{ samples = {:?} }}", spectrum.samples()));
                // Writing to a String cannot fail.
                write!(
                    text,
                    "\n[{table}.{}]\n{key} = {spectrum}\nbounds = [{low:?}, {high:?}]\nsmoothness = {:?}\n",
                    quoted(&member.name),
                    member.smoothness
                )
                .ok();
            }
        };
        members("materials", "reflectance", &palette.materials, materials);
        members("lights", "spectrum", &palette.lights, lights);
        for (index, row) in palette.materials.iter().enumerate() {
            let mut cells = palette.cells.iter().filter(|cell| cell.material == index).peekable();
            if cells.peek().is_some() {
                write!(text, "\n[cells.{}]\n", quoted(&row.name)).ok();
            }
            for cell in cells {
                let target = match cell.target {
                    Target::Xyz(xyz) => format!("xyz = {:?}", xyz.0),
                    Target::Lab(lab) => format!("lab = {:?}", lab.0),
                    _ => format!("target = {}", quoted(&palette.target_text(cell.material, cell.light))),
                };
                let light = palette.lights.get(cell.light).map_or_else(String::new, |column| quoted(&column.name));
                writeln!(text, "{light} = {{ {target}, weight = {:?} }}", cell.weight).ok();
            }
        }
        if let Some(ModelTerm { dimension, weight }) = palette.model {
            write!(text, "\n[model]\nk = {dimension}\nweight = {weight:?}\n").ok();
        }
        text
    }
}
