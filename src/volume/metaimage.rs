//! `MetaImage`, `.mhd` and `.mha`: a header of `key = value` lines, and voxels behind it or in other files.
//!
//! Keys and meanings as in `MetaIO` (Kitware), the library behind ITK's and VTK's readers.

use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::str::FromStr;

use glam::{DMat3, DVec3};

use super::data::{self, Data, DataFile, Encoding, Start};
use super::pattern::{self, Pattern};
use super::raw::ByteOrder;
use super::{Geometry, Volume, VolumeError, VoxelType};
use crate::progress::Progress;

/// Headers are short; a file without `ElementDataFile` in so many bytes is not a `MetaImage`.
const LONGEST_HEADER: u64 = 1 << 20;

/// A list of more files than this is a mistake.
const MOST_FILES: usize = 1 << 20;

/// Whether a file that begins with these bytes is a `MetaImage`.
pub(super) fn recognises(beginning: &[u8]) -> bool {
    let text = String::from_utf8_lossy(beginning);
    let first = text.lines().find(|line| !line.trim().is_empty()).and_then(|line| line.split_once('='));
    first.is_some_and(|(key, value)| {
        let is = |text: &str, wanted: &str| text.trim().eq_ignore_ascii_case(wanted);
        is(key, "NDims") || is(key, "ObjectType") && is(value, "Image")
    })
}

/// Reads a `MetaImage`.
pub(super) fn read(path: &Path, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let header = Header::read(path)?;
    let mut notes = Vec::new();
    let axes = header.axes()?;
    let geometry = header.geometry(&axes, &mut notes)?;
    let data = header.data(&axes)?;
    let (slope, intercept) = header.scale()?;
    let voxels = data.read(progress, &mut notes)?;
    let mut volume = Volume::new(&path.display().to_string(), voxels, geometry)?;
    (volume.slope, volume.intercept) = (slope, intercept);
    volume.files = data.paths();
    volume.files.push(path.to_owned());
    volume.metadata = header.uninterpreted();
    notes.extend(header.repeated());
    volume.notes = notes;
    Ok(volume)
}

/// The keys that are interpreted, each with the names it goes by, the one that counts first.
mod key {
    pub(super) const OBJECT: [&str; 1] = ["ObjectType"];
    pub(super) const AXES: [&str; 1] = ["NDims"];
    pub(super) const DIMS: [&str; 1] = ["DimSize"];
    pub(super) const TYPE: [&str; 1] = ["ElementType"];
    pub(super) const FILE: [&str; 1] = ["ElementDataFile"];
    pub(super) const CHANNELS: [&str; 1] = ["ElementNumberOfChannels"];
    pub(super) const BINARY: [&str; 1] = ["BinaryData"];
    pub(super) const BIG_ENDIAN: [&str; 2] = ["ElementByteOrderMSB", "BinaryDataByteOrderMSB"];
    pub(super) const COMPRESSED: [&str; 1] = ["CompressedData"];
    pub(super) const COMPRESSED_BYTES: [&str; 1] = ["CompressedDataSize"];
    pub(super) const HEADER_BYTES: [&str; 1] = ["HeaderSize"];
    pub(super) const SPACING: [&str; 2] = ["ElementSpacing", "ElementSize"];
    pub(super) const ORIGIN: [&str; 4] = ["Offset", "Origin", "Position", "ImagePosition"];
    pub(super) const DIRECTION: [&str; 3] = ["TransformMatrix", "Orientation", "Rotation"];
    pub(super) const SLOPE: [&str; 1] = ["ElementToIntensityFunctionSlope"];
    pub(super) const INTERCEPT: [&str; 1] = ["ElementToIntensityFunctionOffset"];

    pub(super) const ALL: [&[&str]; 16] = [
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

/// One `key = value`.
struct Field {
    line: usize,
    key: String,
    value: String,
}

struct Header<'a> {
    path: &'a Path,
    fields: Vec<Field>,
    /// Lines behind `ElementDataFile = LIST`.
    list: Vec<String>,
    /// Bytes up to the end of the line of `ElementDataFile`.
    bytes: u64,
}

impl<'a> Header<'a> {
    /// Reads as far as `ElementDataFile`, which is always last, and the list of files behind it if there is one.
    fn read(path: &'a Path) -> Result<Self, VolumeError> {
        let failed = |source| VolumeError::Read { path: path.to_owned(), source };
        let mut stream = BufReader::new(data::open(path)?).take(LONGEST_HEADER);
        let mut header = Self { path, fields: Vec::new(), list: Vec::new(), bytes: 0 };
        let mut line = Vec::new();
        for number in 1.. {
            line.clear();
            if stream.read_until(b'\n', &mut line).map_err(failed)? == 0 {
                break;
            }
            let text = String::from_utf8_lossy(&line);
            if text.trim().is_empty() {
                continue;
            }
            let Some((key, value)) = text.split_once('=') else {
                let start: String = text.trim().chars().take(40).collect();
                let problem = format!("{start:?} is not key = value");
                return Err(VolumeError::Header { path: path.to_owned(), line: number, problem });
            };
            let field = Field { line: number, key: key.trim().to_owned(), value: value.trim().to_owned() };
            let last = field.key.eq_ignore_ascii_case(key::FILE[0]);
            let list = last && field.value.split_whitespace().next() == Some("LIST");
            header.fields.push(field);
            if last {
                header.bytes = LONGEST_HEADER - stream.limit();
                if list {
                    let rest = stream.into_inner();
                    header.list = rest.lines().take(MOST_FILES).collect::<Result<_, _>>().map_err(failed)?;
                    header.list.retain(|line| !line.trim().is_empty());
                }
                return Ok(header);
            }
        }
        Err(VolumeError::MissingKey { path: path.to_owned(), key: key::FILE[0] })
    }

    /// The field that counts: of the first name that occurs, the last line.
    fn find(&self, names: &[&str]) -> Option<&Field> {
        names.iter().find_map(|name| self.fields.iter().rev().find(|field| field.key.eq_ignore_ascii_case(name)))
    }

    fn require(&self, names: &[&'static str; 1]) -> Result<&Field, VolumeError> {
        self.find(names).ok_or_else(|| VolumeError::MissingKey { path: self.path.to_owned(), key: names[0] })
    }

    fn wrong(&self, field: &Field, problem: String) -> VolumeError {
        VolumeError::Header { path: self.path.to_owned(), line: field.line, problem }
    }

    /// The numbers of a field.
    fn numbers<T: FromStr>(&self, field: &Field, what: &str) -> Result<Vec<T>, VolumeError> {
        let parsed = field.value.split_whitespace().map(str::parse).collect::<Result<Vec<T>, _>>();
        parsed.map_err(|_| self.wrong(field, format!("{} = {} should be {what}", field.key, field.value)))
    }

    /// The one number of a field that may be missing.
    fn number<T: FromStr + Copy>(&self, names: &[&str], what: &str) -> Result<Option<T>, VolumeError> {
        let Some(field) = self.find(names) else { return Ok(None) };
        match self.numbers(field, what)?[..] {
            [number] => Ok(Some(number)),
            _ => Err(self.wrong(field, format!("{} = {} should be {what}", field.key, field.value))),
        }
    }

    fn flag(&self, names: &[&str], default: bool) -> Result<bool, VolumeError> {
        let Some(field) = self.find(names) else { return Ok(default) };
        // MetaIO looks at the first letter only.
        match field.value.chars().next().map(|letter| letter.to_ascii_lowercase()) {
            Some('t' | 'y' | '1') => Ok(true),
            Some('f' | 'n' | '0') => Ok(false),
            _ => Err(self.wrong(field, format!("{} = {} should be True or False", field.key, field.value))),
        }
    }

    /// The lengths of all axes of the file: `NDims` numbers.
    fn axes(&self) -> Result<Vec<usize>, VolumeError> {
        if let Some(object) = self.find(&key::OBJECT).filter(|field| !field.value.eq_ignore_ascii_case("Image")) {
            return Err(self.wrong(object, format!("ObjectType = {} is not an image", object.value)));
        }
        let source_name = || self.path.display().to_string();
        let field = self.require(&key::DIMS)?;
        let lengths: Vec<i128> = self.numbers(field, "whole numbers")?;
        let number = self.require(&key::AXES)?;
        if self.number::<usize>(&key::AXES, "a whole number")? != Some(lengths.len()) || lengths.is_empty() {
            return Err(self.wrong(
                field,
                format!("DimSize = {} has {} numbers, but NDims = {}", field.value, lengths.len(), number.value),
            ));
        }
        let dims = || field.value.split_whitespace().collect::<Vec<_>>().join("×");
        let axes: Vec<usize> = lengths.iter().filter_map(|&n| usize::try_from(n).ok().filter(|&n| n > 0)).collect();
        if axes.len() < lengths.len() {
            return Err(VolumeError::Dims { source_name: source_name(), dims: dims() });
        }
        if axes.iter().skip(3).any(|&n| n > 1) {
            return Err(VolumeError::TooManyAxes { source_name: source_name(), dims: dims() });
        }
        Ok(axes)
    }

    /// `wanted` numbers of a field that may be missing; more are noted and left, fewer are an error.
    fn vector(&self, names: &[&str], wanted: usize, notes: &mut Vec<String>) -> Result<Option<Vec<f64>>, VolumeError> {
        let Some(field) = self.find(names) else { return Ok(None) };
        let mut numbers: Vec<f64> = self.numbers(field, "numbers")?;
        let there = numbers.len();
        if there < wanted {
            let problem = format!("{} has {there} numbers, but NDims makes it {wanted}", field.key);
            return Err(self.wrong(field, problem));
        }
        if there > wanted {
            let path = self.path.display();
            notes.push(format!(
                "{path}: {} has {there} numbers, of which NDims makes the first {wanted} count",
                field.key
            ));
            numbers.truncate(wanted);
        }
        Ok(Some(numbers))
    }

    fn geometry(&self, axes: &[usize], notes: &mut Vec<String>) -> Result<Geometry, VolumeError> {
        let n = axes.len();
        // Axes that the file does not have are one voxel long, of spacing 1, along the world's.
        let vector = |numbers: Option<Vec<f64>>, default: f64| {
            let numbers = numbers.unwrap_or_default();
            DVec3::from_array([0, 1, 2].map(|i| numbers.get(i).copied().unwrap_or(default)))
        };
        let dims = [0, 1, 2].map(|i| axes.get(i).copied().unwrap_or(1));
        let spacing = vector(self.vector(&key::SPACING, n, notes)?, 1.0);
        let origin = vector(self.vector(&key::ORIGIN, n, notes)?, 0.0);
        let mut direction = DMat3::IDENTITY;
        if let Some(rows) = self.vector(&key::DIRECTION, n * n, notes)? {
            // A row of the file is an axis.
            for (axis, row) in rows.chunks(n).take(3).enumerate() {
                for (i, &entry) in row.iter().take(3).enumerate() {
                    direction.col_mut(axis)[i] = entry;
                }
            }
        }
        Geometry::new(&self.path.display().to_string(), dims, spacing, origin, direction)
    }

    fn scale(&self) -> Result<(f64, f64), VolumeError> {
        let finite = |names: &[&str], default: f64| match self.number::<f64>(names, "a number")? {
            Some(number) if !number.is_finite() => Err(VolumeError::Layout {
                source_name: self.path.display().to_string(),
                problem: format!("{} = {number} is not finite", names[0]),
            }),
            number => Ok(number.unwrap_or(default)),
        };
        Ok((finite(&key::SLOPE, 1.0)?, finite(&key::INTERCEPT, 0.0)?))
    }

    /// `MetaIO`'s sizes: `MET_LONG` has four bytes wherever the file was written.
    fn voxel_type(&self) -> Result<VoxelType, VolumeError> {
        let field = self.require(&key::TYPE)?;
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
                return Err(self.wrong(field, format!("ElementType = {} is not one of {known}", field.value)));
            }
        })
    }

    fn data(&self, axes: &[usize]) -> Result<Data, VolumeError> {
        let channels = self.number::<u64>(&key::CHANNELS, "a whole number")?.unwrap_or(1);
        if channels != 1 {
            let source_name = self.path.display().to_string();
            return Err(VolumeError::Components { source_name, components: channels });
        }
        let voxel_type = self.voxel_type()?;
        let big = self.flag(&key::BIG_ENDIAN, false)?;
        let encoding = match (self.flag(&key::BINARY, true)?, self.flag(&key::COMPRESSED, false)?) {
            (true, false) => Encoding::Raw,
            (true, true) => Encoding::Zlib { said: self.number::<u64>(&key::COMPRESSED_BYTES, "a whole number")? },
            (false, false) => Encoding::Text,
            (false, true) => {
                let field = self.require(&key::COMPRESSED)?;
                return Err(self.wrong(field, "compressed text is not defined; BinaryData should be True".to_owned()));
            }
        };
        let file = self.require(&key::FILE)?;
        let local = file.value.eq_ignore_ascii_case("LOCAL");
        let start = match self.number::<i64>(&key::HEADER_BYTES, "a whole number")? {
            None | Some(0) => Start::At(if local { self.bytes } else { 0 }),
            Some(-1) if encoding == Encoding::Raw => Start::Tail,
            Some(bytes) => {
                let problem = "HeaderSize should be a number of bytes, or -1 where uncompressed voxels end the file";
                Start::At(u64::try_from(bytes).map_err(|_| {
                    self.wrong(self.find(&key::HEADER_BYTES).unwrap_or(file), format!("{problem}, not {bytes}"))
                })?)
            }
        };
        let byte_order = if big { ByteOrder::Big } else { ByteOrder::Little };
        Ok(Data { files: self.files(file, local, axes)?, start, encoding, voxel_type, byte_order })
    }

    /// The files of voxels that `ElementDataFile` means.
    fn files(&self, field: &Field, local: bool, axes: &[usize]) -> Result<Vec<DataFile>, VolumeError> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let all: usize = axes.iter().product();
        let words: Vec<&str> = field.value.split_whitespace().collect();
        if local {
            return Ok(vec![DataFile { path: self.path.to_owned(), voxels: all }]);
        }
        if words.first() == Some(&"LIST") {
            // Each file has so many axes: one fewer than the volume, unless the second word says otherwise.
            let given = words.get(1).and_then(|word| word.parse().ok()).filter(|n| (1..=axes.len()).contains(n));
            let in_file = given.unwrap_or(axes.len() - 1);
            if words.len() > 1 && given.is_none() {
                return Err(self.wrong(field, format!("LIST should name 1 to {} axes, not {}", axes.len(), words[1])));
            }
            let (voxels, wanted) = (axes[..in_file].iter().product(), axes[in_file..].iter().product::<usize>());
            if self.list.len() != wanted {
                return Err(
                    self.wrong(field, format!("LIST has {} files, but DimSize makes it {wanted}", self.list.len()))
                );
            }
            return Ok(self.list.iter().map(|name| DataFile { path: folder.join(name.trim()), voxels }).collect());
        }
        let numbers = words.iter().rev().take_while(|word| word.parse::<i64>().is_ok()).count().min(3);
        let name = words[..words.len() - numbers].join(" ");
        if !name.contains('%') {
            return Ok(vec![DataFile { path: folder.join(&field.value), voxels: all }]);
        }
        // One file for each step along the last axis.
        let slices = axes.last().copied().unwrap_or(1);
        let range: Vec<i64> = words[words.len() - numbers..].iter().filter_map(|word| word.parse().ok()).collect();
        let first = range.first().copied().unwrap_or(1);
        let behind = i64::try_from(slices).unwrap_or(i64::MAX) - 1;
        let last = range.get(1).copied().unwrap_or_else(|| first.saturating_add(behind));
        let step = range.get(2).copied().unwrap_or(1);
        let pattern = Pattern::parse(&name).map_err(|problem| self.wrong(field, problem))?;
        let numbers = pattern::numbers([first, last, step], slices).map_err(|problem| self.wrong(field, problem))?;
        numbers.map(|number| DataFile::found(folder.join(pattern.name(number)), all / slices)).collect()
    }

    /// The pairs that nothing here understands.
    fn uninterpreted(&self) -> Vec<(String, String)> {
        let known =
            |name: &str| key::ALL.iter().any(|names| names.iter().any(|known| known.eq_ignore_ascii_case(name)));
        let unknown = self.fields.iter().filter(|field| !known(&field.key));
        unknown.map(|field| (field.key.clone(), field.value.clone())).collect()
    }

    /// A sentence for each key that is given twice.
    fn repeated(&self) -> Vec<String> {
        let again = self.fields.iter().enumerate().filter(|(index, field)| {
            self.fields[..*index].iter().any(|earlier| earlier.key.eq_ignore_ascii_case(&field.key))
        });
        again
            .map(|(_, field)| {
                format!("{}, line {}: {} is given again; the last counts", self.path.display(), field.line, field.key)
            })
            .collect()
    }
}
