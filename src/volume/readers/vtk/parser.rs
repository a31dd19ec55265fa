//! Words, lines and arrays of a legacy VTK file.

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _, Seek as _, SeekFrom};
use std::path::Path;
use std::str::FromStr;

use glam::DVec3;

use super::{Array, Parsed, Section, Stored};
use crate::data::{self, Data, DataFile};
use crate::stream::{self, Encoding, Start, count};
use crate::{ByteOrder, VolumeError, VoxelType};
use relume_base::progress::Quiet;

/// Largest deviation of a coordinate from an even axis, in steps.
const EVEN: f64 = 1e-2;

/// Largest rounding of a coordinate, relative to the largest one: floats of 32 bits, or six digits of text.
const ROUNDING: f64 = 1e-6;

/// Largest number of arrays.
const MOST_ARRAYS: usize = 1 << 12;

/// Longest line and longest word in bytes.
const LONGEST: usize = 1 << 16;

/// Largest number of components of an array.
const MOST_COMPONENTS: usize = 1 << 16;

/// Reader of words and lines that knows where it is.
pub(super) struct Parser<'a> {
    path: &'a Path,
    stream: BufReader<File>,
    length: u64,
    at: u64,
    /// Line of the word read last, from 1.
    line: usize,
    /// Line of the next byte.
    next_line: usize,
    is_binary: bool,
}

impl<'a> Parser<'a> {
    pub(super) fn open(path: &'a Path) -> Result<Self, VolumeError> {
        let stream = stream::at(path, 0)?;
        let length = stream.get_ref().metadata().map_err(|source| stream::failed(path, source))?.len();
        Ok(Self { path, stream, length, at: 0, line: 1, next_line: 1, is_binary: false })
    }

    fn wrong(&self, problem: impl Into<String>) -> VolumeError {
        VolumeError::Header { path: self.path.to_owned(), line: self.line, problem: problem.into() }
    }

    /// Reads the rest of the line, without its end; `None` at the end of the file.
    fn rest_of_line(&mut self) -> Result<Option<String>, VolumeError> {
        let mut bytes = Vec::new();
        let is_there = self.take_line(&mut bytes)?;
        Ok(is_there.then(|| String::from_utf8_lossy(&bytes).trim().to_owned()))
    }

    /// Reads the rest of the line into `bytes`, with its end; false at the end of the file.
    fn take_line(&mut self, bytes: &mut Vec<u8>) -> Result<bool, VolumeError> {
        bytes.clear();
        let limit = count(LONGEST);
        let read = (&mut self.stream).take(limit).read_until(b'\n', bytes);
        let read = count(read.map_err(|source| stream::failed(self.path, source))?);
        self.line = self.next_line;
        self.at += read;
        if read == limit && !bytes.ends_with(b"\n") {
            return Err(self.wrong(format!("the line has more than {LONGEST} bytes")));
        }
        self.next_line += usize::from(bytes.ends_with(b"\n"));
        Ok(read > 0)
    }

    /// Reads the next word between white space; `None` at the end of the file. The byte behind it is not read.
    fn word(&mut self) -> Result<Option<String>, VolumeError> {
        // Most words lie in the buffer whole, and so do the blanks before them.
        let buffer = self.stream.buffer();
        let blank = first(buffer, false);
        let end = blank + first(&buffer[blank..], true);
        if blank < end && end < buffer.len() && end - blank <= LONGEST {
            let word = text(buffer[blank..end].to_vec());
            self.next_line += lines(&buffer[..blank]);
            self.line = self.next_line;
            self.stream.consume(end);
            self.at += count(end);
            return Ok(Some(word));
        }
        let mut word = Vec::new();
        loop {
            let buffer = self.stream.fill_buf().map_err(|source| stream::failed(self.path, source))?;
            let blank = if word.is_empty() { first(buffer, false) } else { 0 };
            self.next_line += lines(&buffer[..blank]);
            let rest = &buffer[blank..];
            let length = first(rest, true);
            if length > 0 {
                self.line = self.next_line;
            }
            if word.len() + length > LONGEST {
                return Err(self.wrong(format!("a word has more than {LONGEST} bytes")));
            }
            word.extend_from_slice(&rest[..length]);
            let ended = buffer.is_empty() || length < rest.len() && !word.is_empty();
            self.stream.consume(blank + length);
            self.at += count(blank + length);
            if ended {
                return Ok((!word.is_empty()).then(|| text(word)));
            }
        }
    }

    /// The next word as a number, of `what`.
    fn number<T: FromStr>(&mut self, what: &str) -> Result<T, VolumeError> {
        let word = self.word()?.unwrap_or_default();
        word.parse().map_err(|_| self.wrong(format!("{word:?} is not a number: {what}")))
    }

    fn three(&mut self, what: &str) -> Result<DVec3, VolumeError> {
        Ok(DVec3::new(self.number(what)?, self.number(what)?, self.number(what)?))
    }

    fn dimensions(&mut self) -> Result<[usize; 3], VolumeError> {
        let mut dims = [0; 3];
        for side in &mut dims {
            *side = self.number("DIMENSIONS needs three whole numbers")?;
        }
        data::check_size(self.path.display(), &dims)?;
        Ok(dims)
    }

    pub(super) fn parse(mut self) -> Result<Parsed<'a>, VolumeError> {
        let first = self.rest_of_line()?.unwrap_or_default();
        if !super::recognises(first.as_bytes()) {
            let start: String = first.trim().chars().take(40).collect();
            return Err(
                self.wrong(format!("{start:?} is not # vtk DataFile Version, with which legacy VTK files begin"))
            );
        }
        let title = self.rest_of_line()?.unwrap_or_default();
        let format = self.word()?.unwrap_or_default().to_ascii_uppercase();
        self.is_binary = match format.as_str() {
            "BINARY" => true,
            "ASCII" => false,
            _ => return Err(self.wrong(format!("the format is {format:?}; it must be ASCII or BINARY"))),
        };
        let mut parsed = Parsed {
            path: self.path,
            title,
            is_binary: self.is_binary,
            dims: [0; 3],
            origin: DVec3::ZERO,
            spacing: DVec3::ONE,
            arrays: Vec::new(),
        };
        self.data_set(&mut parsed)?;
        Ok(parsed)
    }

    /// Reads the data set, and the places of its arrays.
    fn data_set(&mut self, parsed: &mut Parsed<'a>) -> Result<(), VolumeError> {
        let mut section = (Section::Field, 0);
        let mut is_rectilinear = false;
        while let Some(word) = self.word()? {
            let mut keyword = word;
            keyword.make_ascii_uppercase();
            match keyword.as_str() {
                "DATASET" => {
                    let kind = self.word()?.unwrap_or_default().to_ascii_uppercase();
                    is_rectilinear = kind == "RECTILINEAR_GRID";
                    if !is_rectilinear && kind != "STRUCTURED_POINTS" {
                        return Err(self.wrong(format!(
                            "DATASET {kind} has no regular grid of voxels; Relume reads STRUCTURED_POINTS and RECTILINEAR_GRID"
                        )));
                    }
                }
                "DIMENSIONS" => parsed.dims = self.dimensions()?,
                "ORIGIN" => parsed.origin = self.three("ORIGIN needs three numbers")?,
                "SPACING" | "ASPECT_RATIO" => parsed.spacing = self.three("SPACING needs three numbers")?,
                "X_COORDINATES" | "Y_COORDINATES" | "Z_COORDINATES" if is_rectilinear => {
                    let index = usize::from(keyword.as_bytes()[0] - b'X');
                    let axis = self.coordinates(&keyword, parsed.dims[index])?;
                    (parsed.origin[index], parsed.spacing[index]) = axis;
                }
                "POINT_DATA" | "CELL_DATA" => {
                    let values = self.number(&format!("{keyword} needs the number of values of an array"))?;
                    section = (if keyword == "POINT_DATA" { Section::Points } else { Section::Cells }, values);
                }
                "METADATA" => self.metadata()?,
                "LOOKUP_TABLE" => {
                    self.word()?;
                    let colours: usize = self.number("LOOKUP_TABLE needs the number of colours")?;
                    self.values_begin()?;
                    self.skip("a lookup table", Some(Stored::Colours), colours.saturating_mul(4))?;
                }
                "FIELD" => self.field(section.0, parsed)?,
                _ => self.attribute(&keyword, section, parsed)?,
            }
            if parsed.arrays.len() > MOST_ARRAYS {
                return Err(self.wrong(format!("the file has more than {MOST_ARRAYS} arrays")));
            }
        }
        if parsed.dims == [0; 3] {
            return Err(self.wrong("DIMENSIONS is missing"));
        }
        Ok(())
    }

    /// Skips the lines after `METADATA`, up to a blank one.
    fn metadata(&mut self) -> Result<(), VolumeError> {
        // The keyword's own line is not blank.
        let mut is_blank = false;
        loop {
            let buffer = self.stream.fill_buf().map_err(|source| stream::failed(self.path, source))?;
            let (mut at, mut has_ended) = (0, buffer.is_empty());
            while at < buffer.len() && !has_ended {
                let byte = buffer[at];
                at += 1;
                if byte == b'\n' {
                    self.next_line += 1;
                    has_ended = is_blank;
                }
                is_blank = byte == b'\n' || is_blank && is_space(byte);
            }
            self.stream.consume(at);
            self.at += count(at);
            if has_ended {
                self.line = self.next_line;
                return Ok(());
            }
        }
    }

    /// First coordinate and step of the points along one axis. There must be `stated` points, evenly spaced.
    fn coordinates(&mut self, keyword: &str, stated: usize) -> Result<(f64, f64), VolumeError> {
        let points: usize = self.number(&format!("{keyword} needs the number of points"))?;
        if points != stated {
            return Err(self.wrong(format!("the file has {points} {keyword}, but DIMENSIONS states {stated}")));
        }
        let type_name = self.word()?.unwrap_or_default();
        let Some(Stored::Numbers(voxel_type)) = stored(&type_name) else {
            return Err(self.wrong(format!("{keyword} have the type {type_name:?}, which is not a number type")));
        };
        let at = self.values_begin()?;
        let data = Data {
            files: vec![DataFile { path: self.path.to_owned(), numbers: points }],
            start: Start::at(at),
            encoding: if self.is_binary { Encoding::Raw } else { Encoding::Text },
            voxel_type,
            byte_order: ByteOrder::Big,
            picks: Vec::new(),
            alone: false,
        };
        let values = data.read(&Quiet, &mut Vec::new())?;
        self.skip(keyword, Some(Stored::Numbers(voxel_type)), points)?;
        let value = |index: usize| values.value(index).unwrap_or(0.0);
        let last = points.saturating_sub(1);
        let step = if last == 0 { 1.0 } else { (value(last) - value(0)) / relume_base::number::count(last) };
        let limit = EVEN.mul_add(step.abs(), ROUNDING * value(0).abs().max(value(last).abs()));
        for index in 0..points {
            let even = relume_base::number::count(index).mul_add(step, value(0));
            let far = (value(index) - even).abs();
            if far.is_nan() || far > limit {
                return Err(self.wrong(format!(
                    "{keyword} are not evenly spaced: point {index} is at {}, but even spacing puts it at {even} (limit: {limit:.1e})",
                    value(index)
                )));
            }
        }
        Ok((value(0), step))
    }

    /// An attribute of points or cells.
    fn attribute(
        &mut self,
        keyword: &str,
        (section, tuples): (Section, usize),
        parsed: &mut Parsed<'a>,
    ) -> Result<(), VolumeError> {
        let fixed = match keyword {
            "SCALARS" | "COLOR_SCALARS" | "TEXTURE_COORDINATES" => None,
            "VECTORS" | "NORMALS" => Some(3),
            "TENSORS" => Some(9),
            "TENSORS6" => Some(6),
            "GLOBAL_IDS" | "PEDIGREE_IDS" => Some(1),
            _ => {
                let start: String = keyword.chars().take(40).collect();
                return Err(self.wrong(format!("Relume does not know the keyword {start:?}")));
            }
        };
        if section == Section::Field {
            return Err(
                self.wrong(format!("{keyword} comes before POINT_DATA and CELL_DATA; it must follow one of them"))
            );
        }
        let name = decoded(&self.word()?.unwrap_or_default());
        let line = self.line;
        let (type_name, components) = match keyword {
            "COLOR_SCALARS" => ("colours".to_owned(), self.number("COLOR_SCALARS has a number of components")?),
            "TEXTURE_COORDINATES" => {
                let components = self.number("TEXTURE_COORDINATES has a number of components")?;
                (self.word()?.unwrap_or_default(), components)
            }
            _ => {
                let type_name = self.word()?.unwrap_or_default();
                let components = match fixed {
                    Some(components) => components,
                    None => self.components()?,
                };
                (type_name, components)
            }
        };
        self.check_components(&format!("{keyword} {name}"), components)?;
        if keyword == "SCALARS" {
            self.lookup_table()?;
        }
        let stored = if keyword == "COLOR_SCALARS" { Some(Stored::Colours) } else { stored(&type_name) };
        let at = self.values_begin()?;
        let is_active = keyword == "SCALARS" && !parsed.arrays.iter().any(|it| it.is_active && it.section == section);
        self.line = line;
        self.skip(&name, stored, tuples.saturating_mul(components))?;
        parsed.arrays.push(Array { name, section, type_name, stored, components, tuples, at, line, is_active });
        Ok(())
    }

    /// Refuses an array `name` of no components, or of too many.
    fn check_components(&self, name: &str, components: usize) -> Result<(), VolumeError> {
        if (1..=MOST_COMPONENTS).contains(&components) {
            return Ok(());
        }
        Err(self.wrong(format!("{name} has {components} components; Relume reads 1 to {MOST_COMPONENTS}")))
    }

    /// The number of components at the end of a line of `SCALARS`; 1 if there is none.
    fn components(&mut self) -> Result<usize, VolumeError> {
        let line = self.rest_of_line()?.unwrap_or_default();
        match line.as_str() {
            "" => Ok(1),
            number => number.parse().map_err(|_| self.wrong(format!("{number:?} is not a number of components"))),
        }
    }

    /// The line `LOOKUP_TABLE name` before the values of scalars; without one, the values begin here.
    fn lookup_table(&mut self) -> Result<(), VolumeError> {
        let (at, lines) = (self.at, (self.line, self.next_line));
        let word = self.word()?.unwrap_or_default();
        if word.eq_ignore_ascii_case("LOOKUP_TABLE") {
            self.word()?;
            return Ok(());
        }
        if self.is_binary {
            return Err(self.wrong("LOOKUP_TABLE is missing before the values"));
        }
        (self.line, self.next_line) = lines;
        self.go_to(at)
    }

    /// Arrays of a field: name, components, tuples, type and values of each.
    fn field(&mut self, section: Section, parsed: &mut Parsed<'a>) -> Result<(), VolumeError> {
        self.word()?;
        let arrays: usize = self.number("FIELD needs the number of its arrays")?;
        if arrays > MOST_ARRAYS {
            return Err(self.wrong(format!("the FIELD has {arrays} arrays; Relume reads at most {MOST_ARRAYS}")));
        }
        for _ in 0..arrays {
            let mut word = self.word()?.unwrap_or_default();
            while word.eq_ignore_ascii_case("METADATA") {
                self.metadata()?;
                word = self.word()?.unwrap_or_default();
            }
            let (name, line) = (decoded(&word), self.line);
            let components = self.number(&format!("the components of the array {name:?}"))?;
            self.check_components(&format!("the array {name:?}"), components)?;
            let tuples: usize = self.number(&format!("the values of the array {name:?}"))?;
            let type_name = self.word()?.unwrap_or_default();
            let stored = stored(&type_name);
            let at = self.values_begin()?;
            self.line = line;
            self.skip(&name, stored, tuples.saturating_mul(components))?;
            let is_active = false;
            parsed.arrays.push(Array { name, section, type_name, stored, components, tuples, at, line, is_active });
        }
        Ok(())
    }

    /// Goes to the first value, and returns its offset: in binary files it is the byte after the end of the line.
    fn values_begin(&mut self) -> Result<u64, VolumeError> {
        if self.is_binary {
            self.rest_of_line()?;
        }
        Ok(self.at)
    }

    /// Skips `numbers` values of the array `name`.
    fn skip(&mut self, name: &str, stored: Option<Stored>, numbers: usize) -> Result<(), VolumeError> {
        let Some(stored) = stored else {
            return Err(self.wrong(format!("the array {name:?} is not of numbers, so Relume cannot skip it")));
        };
        if self.is_binary {
            let bytes = match stored {
                Stored::Numbers(voxel_type) => count(numbers).saturating_mul(count(voxel_type.bytes())),
                Stored::Colours => count(numbers),
                Stored::Bits => count(numbers).div_ceil(8),
            };
            let left = self.length.saturating_sub(self.at);
            if bytes > left {
                return Err(
                    self.wrong(format!("the array {name:?} needs {bytes} bytes, but the file has only {left} more"))
                );
            }
            return self.go_to(self.at + bytes);
        }
        for index in 0..numbers {
            if self.word()?.is_none() {
                return Err(self.wrong(format!("the array {name:?} ends after {index} of {numbers} numbers")));
            }
        }
        Ok(())
    }

    fn go_to(&mut self, at: u64) -> Result<(), VolumeError> {
        self.stream.seek(SeekFrom::Start(at)).map_err(|source| stream::failed(self.path, source))?;
        self.at = at;
        Ok(())
    }
}

/// The word as text.
fn text(word: Vec<u8>) -> String {
    String::from_utf8(word).unwrap_or_else(|wrong| String::from_utf8_lossy(wrong.as_bytes()).into_owned())
}

/// True for white space.
const fn is_space(byte: u8) -> bool {
    matches!(byte, b' ' | b'\t' | b'\n' | b'\x0c' | b'\r')
}

/// Number of ends of lines in `blanks`, which are few.
fn lines(blanks: &[u8]) -> usize {
    if blanks.len() < 16 {
        let mut lines = 0;
        for &byte in blanks {
            lines += usize::from(byte == b'\n');
        }
        return lines;
    }
    memchr::memchr_iter(b'\n', blanks).count()
}

/// Number of bytes before the first one that is white space, or is none. Words are short, so the loop is a plain one.
fn first(bytes: &[u8], blank: bool) -> usize {
    let mut at = 0;
    while at < bytes.len() && is_space(bytes[at]) != blank {
        at += 1;
    }
    at
}

/// The type of values of this name, whose sizes are VTK's: `long` has eight bytes.
fn stored(name: &str) -> Option<Stored> {
    Some(Stored::Numbers(match name.to_ascii_lowercase().as_str() {
        "bit" => return Some(Stored::Bits),
        "unsigned_char" | "vtktypeuint8" => VoxelType::U8,
        "char" | "signed_char" | "vtktypeint8" => VoxelType::I8,
        "unsigned_short" | "vtktypeuint16" => VoxelType::U16,
        "short" | "vtktypeint16" => VoxelType::I16,
        "unsigned_int" | "vtktypeuint32" => VoxelType::U32,
        "int" | "vtktypeint32" => VoxelType::I32,
        "unsigned_long" | "unsigned_long_long" | "vtktypeuint64" => VoxelType::U64,
        "long" | "long_long" | "vtktypeint64" | "vtkidtype" => VoxelType::I64,
        "float" | "vtktypefloat32" => VoxelType::F32,
        "double" | "vtktypefloat64" => VoxelType::F64,
        _ => return None,
    }))
}

/// The name with its `%20` and other codes decoded.
fn decoded(name: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = name.as_bytes();
    while let [first, after @ ..] = rest {
        let code = after.get(..2).and_then(|code| u8::from_str_radix(std::str::from_utf8(code).ok()?, 16).ok());
        match code.filter(|_| *first == b'%') {
            Some(code) => {
                bytes.push(code);
                rest = &after[2..];
            }
            None => {
                bytes.push(*first);
                rest = after;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}
