//! `MetaImage`, `.mhd` and `.mha`: a header of `key = value` lines, with voxels behind it or in other files.
//!
//! Keys and meanings follow `MetaIO` (Kitware), the library of ITK's and VTK's readers.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::fields::{Field, Fields, Lines};
use super::pattern::{self, Pattern};
use super::slices;
use crate::data::{self, Data, DataFile};
use crate::layout::ByteOrder;
use crate::resample::Grid;
use crate::select::Pick;
use crate::stream::{Encoding, Start};
use crate::streamed::Streamed;
use crate::{Geometry, Selection, Unit, Volume, VolumeError, VoxelType};
use relume_base::progress::Progress;

/// Whether the first bytes of a file identify a `MetaImage`.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    let text = String::from_utf8_lossy(beginning);
    let first = text.lines().find(|line| !line.trim().is_empty()).and_then(|line| line.split_once('='));
    first.is_some_and(|(key, value)| {
        let is = |text: &str, wanted: &str| text.trim().eq_ignore_ascii_case(wanted);
        is(key, "NDims") || is(key, "ObjectType") && is(value, "Image")
    })
}

/// Reads a `MetaImage`.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let source_name = path.display().to_string();
    let (header, streamed) = header_and_voxels(path, selection)?;
    let paths = streamed.data.paths();
    if slices::are_pictures(&paths) {
        let (axes, components) = (header.axes()?, header.components()?);
        let component = selection.component(&source_name, components, "")?;
        let of_header = (components, streamed.data.voxel_type);
        let voxels = slices::of_header(path, &paths, &axes, of_header, component, progress)?;
        return (streamed.finish)(voxels, streamed.notes);
    }
    streamed.read(&source_name, selection, progress)
}

/// Reads the header of a `MetaImage`.
pub(crate) fn streamed(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let (_, mut streamed) = header_and_voxels(path, selection)?;
    if slices::are_pictures(&streamed.data.paths()) {
        streamed.dims = Err("its slices are pictures");
    }
    Ok(streamed)
}

fn header_and_voxels<'a>(path: &'a Path, selection: &Selection) -> Result<(Header<'a>, Streamed), VolumeError> {
    let header = Header::read(path)?;
    let source_name = path.display().to_string();
    let mut notes = Vec::new();
    let axes = header.axes()?;
    let grid = header.grid(&axes, selection.resample, &mut notes)?;
    let components = header.components()?;
    let data = header.data(&axes, components, selection)?;
    let (slope, intercept) = header.scale()?;
    let mut files = data.paths();
    files.push(path.to_owned());
    let metadata = header.fields.uninterpreted(&key::ALL);
    let repeated: Vec<String> = header.fields.repeated().collect();
    let dims = grid.dims();
    let finish = move |voxels, mut notes: Vec<String>| {
        let mut volume = grid.volume(&source_name, voxels, false, slope)?;
        (volume.slope, volume.intercept) = (slope, intercept);
        (volume.files, volume.metadata, volume.components) = (files, metadata, components);
        let orientation = volume.metadata.iter().find(|(key, _)| key.eq_ignore_ascii_case("AnatomicalOrientation"));
        let unit = volume.metadata.iter().find(|(key, _)| key.eq_ignore_ascii_case("DistanceUnits"));
        volume.unit = unit.and_then(|(_, name)| Unit::named(name));
        volume.anatomical = orientation.is_some_and(|(_, letters)| is_anatomical(letters, &volume.geometry));
        notes.extend(repeated);
        notes.append(&mut volume.notes);
        volume.notes = notes;
        Ok(volume)
    };
    Ok((header, Streamed { data, halves: false, dims, notes, finish: Box::new(finish) }))
}

/// Whether `letters` agree with the axes of `geometry` in a left-posterior-superior world. Each letter names the side
/// of a patient from which an axis starts. This is ITK's convention; ITK writes the letters for everything with three
/// axes.
fn is_anatomical(letters: &str, geometry: &Geometry) -> bool {
    let letters = letters.trim().to_ascii_uppercase();
    let from = letters.chars().map(|letter| "RLAPIS".find(letter));
    let axes = [0, 1, 2].map(|axis| {
        let direction = geometry.direction.col(axis);
        let world = direction.abs().max_position();
        Some(2 * world + usize::from(direction[world] < 0.0))
    });
    from.eq(axes)
}

/// The interpreted keys, each with its aliases; the first alias has priority.
mod key {
    pub(crate) const OBJECT: [&str; 1] = ["ObjectType"];
    pub(crate) const AXES: [&str; 1] = ["NDims"];
    pub(crate) const DIMS: [&str; 1] = ["DimSize"];
    pub(crate) const TYPE: [&str; 1] = ["ElementType"];
    pub(crate) const FILE: [&str; 1] = ["ElementDataFile"];
    pub(crate) const CHANNELS: [&str; 1] = ["ElementNumberOfChannels"];
    pub(crate) const BINARY: [&str; 1] = ["BinaryData"];
    pub(crate) const BIG_ENDIAN: [&str; 2] = ["ElementByteOrderMSB", "BinaryDataByteOrderMSB"];
    pub(crate) const COMPRESSED: [&str; 1] = ["CompressedData"];
    pub(crate) const COMPRESSED_BYTES: [&str; 1] = ["CompressedDataSize"];
    pub(crate) const HEADER_BYTES: [&str; 1] = ["HeaderSize"];
    pub(crate) const SPACING: [&str; 2] = ["ElementSpacing", "ElementSize"];
    pub(crate) const ORIGIN: [&str; 4] = ["Offset", "Origin", "Position", "ImagePosition"];
    pub(crate) const DIRECTION: [&str; 3] = ["TransformMatrix", "Orientation", "Rotation"];
    pub(crate) const SLOPE: [&str; 1] = ["ElementToIntensityFunctionSlope"];
    pub(crate) const INTERCEPT: [&str; 1] = ["ElementToIntensityFunctionOffset"];

    pub(crate) const ALL: [&[&str]; 16] = [
        &OBJECT,
        &AXES,
        &DIMS,
        &TYPE,
        &FILE,
        &CHANNELS,
        &BINARY,
        &BIG_ENDIAN,
        &COMPRESSED,
        &COMPRESSED_BYTES,
        &HEADER_BYTES,
        &SPACING,
        &ORIGIN,
        &DIRECTION,
        &SLOPE,
        &INTERCEPT,
    ];
}

struct Header<'a> {
    fields: Fields<'a>,
    /// Lines after `ElementDataFile = LIST`.
    list: Vec<String>,
    /// Bytes up to the end of the line `ElementDataFile`.
    bytes: u64,
}

impl<'a> Header<'a> {
    /// Reads up to `ElementDataFile`, which is always last, and the list of files after it, if any.
    fn read(path: &'a Path) -> Result<Self, VolumeError> {
        let mut lines = Lines::of(path)?;
        let mut fields = Fields { path, sign: " = ", all: Vec::new() };
        while let Some(text) = lines.next()? {
            if text.trim().is_empty() {
                continue;
            }
            let (key, value) =
                text.split_once('=').ok_or_else(|| lines.wrong(&text, "key = value, a line of a MetaImage header"))?;
            let field = Field { line: lines.number, key: key.trim().to_owned(), value: value.trim().to_owned() };
            let last = field.key.eq_ignore_ascii_case(key::FILE[0]);
            let list = last && field.value.split_whitespace().next() == Some("LIST");
            fields.all.push(field);
            if last {
                let bytes = lines.bytes();
                return Ok(Self { fields, list: if list { lines.list()? } else { Vec::new() }, bytes });
            }
        }
        Err(VolumeError::MissingKey { path: path.to_owned(), key: key::FILE[0] })
    }

    fn flag(&self, names: &[&str], default: bool) -> Result<bool, VolumeError> {
        let Some(field) = self.fields.find(names) else { return Ok(default) };
        // MetaIO examines only the first letter.
        match field.value.chars().next().map(|letter| letter.to_ascii_lowercase()) {
            Some('t' | 'y' | '1') => Ok(true),
            Some('f' | 'n' | '0') => Ok(false),
            _ => Err(self.fields.should_be(field, "True or False")),
        }
    }

    /// Lengths of the `NDims` axes of the file.
    fn axes(&self) -> Result<Vec<usize>, VolumeError> {
        if let Some(object) = self.fields.find(&key::OBJECT).filter(|field| !field.value.eq_ignore_ascii_case("Image"))
        {
            return Err(self.fields.wrong(object, format!("ObjectType = {} is not an image", object.value)));
        }
        let axes = self.fields.axes(&key::AXES, &key::DIMS)?;
        if axes.iter().skip(4).any(|&n| n > 1) {
            let dims: Vec<String> = axes.iter().map(ToString::to_string).collect();
            let source_name = self.fields.path.display().to_string();
            return Err(VolumeError::TooManyAxes { source_name, dims: dims.join("×") });
        }
        Ok(axes)
    }

    /// Returns `wanted` numbers of an optional field. Excess numbers are ignored with a note; too few are an error.
    fn vector(&self, names: &[&str], wanted: usize, notes: &mut Vec<String>) -> Result<Option<Vec<f64>>, VolumeError> {
        let Some(field) = self.fields.find(names) else { return Ok(None) };
        let mut numbers: Vec<f64> = self.fields.numbers(field, "numbers")?;
        let there = numbers.len();
        if there < wanted {
            let problem = format!("{} has {there} numbers, but NDims requires {wanted}", field.key);
            return Err(self.fields.wrong(field, problem));
        }
        if there > wanted {
            let path = self.fields.path.display();
            notes.push(format!(
                "{path}: {} has {there} numbers, but NDims requires only {wanted}; the rest is ignored",
                field.key
            ));
            numbers.truncate(wanted);
        }
        Ok(Some(numbers))
    }

    fn grid(&self, axes: &[usize], resample: bool, notes: &mut Vec<String>) -> Result<Grid, VolumeError> {
        let n = axes.len();
        // Missing axes have one voxel, spacing 1, and the direction of the world's axis.
        let vector = |numbers: Option<Vec<f64>>, default: f64| {
            let numbers = numbers.unwrap_or_default();
            DVec3::from_array([0, 1, 2].map(|i| numbers.get(i).copied().unwrap_or(default)))
        };
        let dims = [0, 1, 2].map(|i| axes.get(i).copied().unwrap_or(1));
        let spacing = vector(self.vector(&key::SPACING, n, notes)?, 1.0);
        let origin = vector(self.vector(&key::ORIGIN, n, notes)?, 0.0);
        let mut direction = DMat3::IDENTITY;
        if let Some(rows) = self.vector(&key::DIRECTION, n * n, notes)? {
            // Each row in the file is an axis.
            for (axis, row) in rows.chunks(n).take(3).enumerate() {
                for (i, &entry) in row.iter().take(3).enumerate() {
                    direction.col_mut(axis)[i] = entry;
                }
            }
        }
        Grid::placed(&self.fields.path.display().to_string(), (dims, spacing), (origin, direction), resample)
    }

    fn scale(&self) -> Result<(f64, f64), VolumeError> {
        let finite = |names: &[&str], default: f64| match self.fields.number::<f64>(names, "a number")? {
            Some(number) if !number.is_finite() => Err(VolumeError::Layout {
                source_name: self.fields.path.display().to_string(),
                problem: format!("{} = {number} is not finite", names[0]),
            }),
            number => Ok(number.unwrap_or(default)),
        };
        Ok((finite(&key::SLOPE, 1.0)?, finite(&key::INTERCEPT, 0.0)?))
    }

    /// Types have the sizes of `MetaIO`: `MET_LONG` has four bytes on every platform.
    fn voxel_type(&self) -> Result<VoxelType, VolumeError> {
        let field = self.fields.require(&key::TYPE)?;
        Ok(match field.value.to_ascii_uppercase().as_str() {
            "MET_UCHAR" => VoxelType::U8,
            "MET_CHAR" | "MET_ASCII_CHAR" => VoxelType::I8,
            "MET_USHORT" => VoxelType::U16,
            "MET_SHORT" => VoxelType::I16,
            "MET_UINT" | "MET_ULONG" => VoxelType::U32,
            "MET_INT" | "MET_LONG" => VoxelType::I32,
            "MET_ULONG_LONG" => VoxelType::U64,
            "MET_LONG_LONG" => VoxelType::I64,
            "MET_FLOAT" => VoxelType::F32,
            "MET_DOUBLE" => VoxelType::F64,
            _ => {
                let known = "MET_UCHAR, MET_CHAR, MET_USHORT, MET_SHORT, MET_UINT, MET_INT, MET_ULONG, MET_LONG, \
                             MET_ULONG_LONG, MET_LONG_LONG, MET_FLOAT, MET_DOUBLE";
                return Err(self.fields.wrong(field, format!("ElementType = {} is not one of {known}", field.value)));
            }
        })
    }

    /// Components per voxel, stored interleaved.
    fn components(&self) -> Result<usize, VolumeError> {
        let channels = self.fields.number::<usize>(&key::CHANNELS, "a whole number")?.unwrap_or(1);
        match self.fields.find(&key::CHANNELS) {
            Some(field) if channels == 0 => {
                Err(self.fields.wrong(field, "ElementNumberOfChannels = 0; a voxel has at least 1 channel".to_owned()))
            }
            _ => Ok(channels),
        }
    }

    fn data(&self, axes: &[usize], components: usize, selection: &Selection) -> Result<Data, VolumeError> {
        let source_name = self.fields.path.display().to_string();
        // The fourth axis is time.
        let times = axes.get(3).copied().unwrap_or(1);
        selection.no_array(&source_name)?;
        let component = selection.component(&source_name, components, "")?;
        let time = selection.time(&source_name, times)?;
        // The components are the first axis of the numbers.
        let all: Vec<usize> = std::iter::once(components).chain(axes.iter().copied()).collect();
        data::check_size(&source_name, &all)?;
        let picks = vec![
            Pick { stride: 1, length: components, index: component },
            Pick { stride: all.iter().take(4).product(), length: times, index: time },
        ];
        let voxel_type = self.voxel_type()?;
        let big = self.flag(&key::BIG_ENDIAN, false)?;
        let encoding = match (self.flag(&key::BINARY, true)?, self.flag(&key::COMPRESSED, false)?) {
            (true, false) => Encoding::Raw,
            (true, true) => {
                Encoding::Zlib { said: self.fields.number::<u64>(&key::COMPRESSED_BYTES, "a whole number")? }
            }
            (false, false) => Encoding::Text,
            (false, true) => {
                let field = self.fields.require(&key::COMPRESSED)?;
                return Err(self.fields.wrong(
                    field,
                    "compressed text is not defined; CompressedData requires BinaryData = True".to_owned(),
                ));
            }
        };
        let file = self.fields.require(&key::FILE)?;
        let local = file.value.eq_ignore_ascii_case("LOCAL");
        let start = match self.fields.number::<i64>(&key::HEADER_BYTES, "a whole number")? {
            None | Some(0) => Start::at(if local { self.bytes } else { 0 }),
            Some(-1) if encoding == Encoding::Raw => Start::TAIL,
            Some(bytes) => {
                let problem =
                    "HeaderSize should be a number of bytes, or -1 if uncompressed voxels are the end of the file";
                Start::at(u64::try_from(bytes).map_err(|_| {
                    self.fields
                        .wrong(self.fields.find(&key::HEADER_BYTES).unwrap_or(file), format!("{problem}, not {bytes}"))
                })?)
            }
        };
        let byte_order = if big { ByteOrder::Big } else { ByteOrder::Little };
        Ok(Data { files: self.files(file, local, &all)?, start, encoding, voxel_type, byte_order, picks, alone: true })
    }

    /// Returns the files of voxels that `ElementDataFile` names. The first of `all_axes` is the components.
    fn files(&self, field: &Field, local: bool, all_axes: &[usize]) -> Result<Vec<DataFile>, VolumeError> {
        let (components, axes) = (all_axes[0], &all_axes[1..]);
        let all: usize = all_axes.iter().product();
        let words: Vec<&str> = field.value.split_whitespace().collect();
        if local {
            return Ok(vec![DataFile { path: self.fields.path.to_owned(), numbers: all }]);
        }
        if words.first() == Some(&"LIST") {
            // Each file holds `in_file` axes: one fewer than the volume, unless the second word states their number.
            // MetaIO reads only the number at the beginning of that word: "2" and "2D" are equal.
            let number = |word: &&str| word.split(|letter: char| !letter.is_ascii_digit()).next()?.parse().ok();
            let given = words.get(1).and_then(number).filter(|n| (1..=axes.len()).contains(n));
            let in_file = given.unwrap_or(axes.len() - 1);
            if words.len() > 1 && given.is_none() {
                return Err(self
                    .fields
                    .wrong(field, format!("LIST should state 1 to {} axes per file, not {}", axes.len(), words[1])));
            }
            let numbers = components * axes[..in_file].iter().product::<usize>();
            let wanted = axes[in_file..].iter().product::<usize>();
            if self.list.len() != wanted {
                return Err(self
                    .fields
                    .wrong(field, format!("LIST has {} files, but DimSize requires {wanted}", self.list.len())));
            }
            let file = |name: &String| Ok(DataFile { path: data::beside(self.fields.path, name)?, numbers });
            return self.list.iter().map(file).collect();
        }
        let numbers = words.iter().rev().take_while(|word| word.parse::<i64>().is_ok()).count().min(3);
        let name = words[..words.len() - numbers].join(" ");
        if !name.contains('%') || data::existing(self.fields.path, &field.value).is_some() {
            return Ok(vec![DataFile { path: data::beside(self.fields.path, &field.value)?, numbers: all }]);
        }
        // One file per position on the last axis.
        let slices = axes.last().copied().unwrap_or(1);
        let range: Vec<i64> = words[words.len() - numbers..].iter().filter_map(|word| word.parse().ok()).collect();
        let first = range.first().copied().unwrap_or(1);
        let behind = i64::try_from(slices).unwrap_or(i64::MAX) - 1;
        let last = range.get(1).copied().unwrap_or_else(|| first.saturating_add(behind));
        let step = range.get(2).copied().unwrap_or(1);
        let pattern = Pattern::parse(&name).map_err(|problem| self.fields.wrong(field, pattern::no_file(&problem)))?;
        let numbers =
            pattern::numbers([first, last, step], slices).map_err(|problem| self.fields.wrong(field, problem))?;
        numbers
            .map(|number| DataFile::found(data::beside(self.fields.path, &pattern.name(number))?, all / slices))
            .collect()
    }
}
