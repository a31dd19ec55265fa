//! `NumPy` arrays: `.npy`, and archives of them, `.npz`.
//!
//! The header is described in "NEP 1 — A simple file format for `NumPy` arrays". Nothing in it is executed: arrays of
//! objects are refused.

use std::io::Read as _;
use std::path::Path;

use zip::{CompressionMethod, ZipArchive};

use super::type_string::{self, Kind};
use crate::axes::{self, Arranged, Axis};
use crate::data::{self, Data, DataFile};
use crate::stream::{self, Encoding, Skip, Start, count};
use crate::streamed::Streamed;
use crate::voxels::{float_of_half, floats_of_halves, with_type};
use crate::{ByteOrder, Geometry, Selection, Volume, VolumeError, Voxel, VoxelType, Voxels, allocate, with_voxels};
use relume_base::progress::Progress;

/// Longest header in bytes.
const LONGEST: usize = 1 << 16;

/// Bytes between two progress reports of a checksum.
const CHUNK: usize = 1 << 20;

/// Bytes before the header's text: the magic word, the version, and its length in 2 or 4 bytes.
const BEGINNING: usize = 12;

/// Whether the first bytes of a file identify an array.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    beginning.starts_with(b"\x93NUMPY")
}

/// Whether the first bytes of a file identify an archive whose first member is an array.
pub(crate) fn recognises_archive(beginning: &[u8]) -> bool {
    let name = beginning.get(26..28).map_or(0, |length| usize::from(u16::from_le_bytes([length[0], length[1]])));
    beginning.starts_with(b"PK\x03\x04") && beginning.get(30..30 + name).is_some_and(|name| name.ends_with(b".npy"))
}

/// Reads an array.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    Place::of_file(path, selection)?.volume(selection, progress)
}

/// Reads the header of an array.
pub(crate) fn streamed(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    Ok(Place::of_file(path, selection)?.streamed(selection)?.0)
}

/// Reads an array of an archive.
pub(crate) fn read_archive(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let source_name = path.display().to_string();
    let wrong =
        |member: &str, problem: String| VolumeError::Field { path: path.to_owned(), place: member.to_owned(), problem };
    let broken =
        |error: zip::result::ZipError| wrong("archive", format!("not a ZIP archive that Relume can read: {error}"));
    let mut archive = ZipArchive::new(stream::at(path, 0)?).map_err(broken)?;
    let file_names: Vec<String> = archive.file_names().filter_map(|name| Some(name.ok()?.into())).collect();
    let nameless = archive.len().saturating_sub(file_names.len());
    let names: Vec<String> = file_names.iter().filter_map(|name| Some(name.strip_suffix(".npy")?.to_owned())).collect();
    if names.is_empty() {
        return Err(wrong("archive", format!("none of its {} files is an array (.npy)", archive.len())));
    }
    let index = selection.array(&source_name, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
    let name = &names[index];
    let index = archive.index_for_name(&format!("{name}.npy"));
    let index = index.ok_or_else(|| wrong(name, "the archive does not find its own array".to_owned()))?;
    let member = archive.by_index_raw(index).map_err(broken)?;
    if member.encrypted() {
        return Err(wrong(name, "the array is encrypted".to_owned()));
    }
    let encoding = match member.compression() {
        CompressionMethod::Stored => Encoding::Raw,
        CompressionMethod::DEFLATE => Encoding::Deflate { crc: member.crc32() },
        other => {
            return Err(wrong(
                name,
                format!("Relume does not read the compression {other:?}; it reads stored and deflated arrays"),
            ));
        }
    };
    let Some(at) = member.data_start() else {
        return Err(wrong(name, "the archive does not say where the array begins".to_owned()));
    };
    let (bytes, stated) = (member.size(), member.crc32());
    let place = Place { path, member: name, at, bytes, encoding, alone: false };
    let mut volume = place.volume(selection, progress)?;
    // The decoder compares the checksum of a compressed array.
    if encoding == Encoding::Raw {
        let found = checksum(path, at, bytes, progress)?;
        if found != stated {
            let problem = format!("the array is damaged: its checksum is {found:08x}, but should be {stated:08x}");
            return Err(wrong(name, problem));
        }
    }
    if nameless > 0 {
        volume.notes.push(format!("{source_name}: the names of {nameless} files of the archive cannot be read"));
    }
    volume.selection.array = (names.len() > 1).then(|| name.clone());
    Ok(volume)
}

/// The CRC-32 of `bytes` bytes of a file from offset `at`.
fn checksum(path: &Path, at: u64, bytes: u64, progress: &dyn Progress) -> Result<u32, VolumeError> {
    let mut stream = stream::at(path, at)?.take(bytes);
    let (mut checksum, mut done, mut buffer) = (flate2::Crc::new(), 0, vec![0; CHUNK]);
    loop {
        data::report(path, done, bytes, progress)?;
        let read = stream::read_fully(&mut stream, &mut buffer).map_err(|source| stream::failed(path, source))?;
        if read == 0 {
            return Ok(checksum.sum());
        }
        checksum.update(&buffer[..read]);
        done += count(read);
    }
}

/// Where an array is stored.
struct Place<'a> {
    path: &'a Path,
    /// Name in an archive, or nothing.
    member: &'a str,
    at: u64,
    /// Length of header and values, decompressed.
    bytes: u64,
    encoding: Encoding,
    /// Whether the file ends with the array.
    alone: bool,
}

impl<'a> Place<'a> {
    /// The array of the file `path`.
    fn of_file(path: &'a Path, selection: &Selection) -> Result<Self, VolumeError> {
        selection.no_array(&path.display().to_string())?;
        let length = stream::after_lines(path, Start::at(0))?.1;
        Ok(Self { path, member: "", at: 0, bytes: length, encoding: Encoding::Raw, alone: true })
    }

    fn wrong(&self, problem: String) -> VolumeError {
        let place = if self.member.is_empty() { "header".to_owned() } else { format!("header of {}", self.member) };
        VolumeError::Field { path: self.path.to_owned(), place, problem }
    }

    /// The array before its numbers are read, and their order.
    fn streamed(&self, selection: &Selection) -> Result<(Streamed, Arranged), VolumeError> {
        let source_name = self.path.display().to_string();
        let header = self.header()?;
        let arranged = self.arranged(&header.shape, selection)?;
        let components = arranged.length(Axis::Channel);
        let component = selection.component(&source_name, components, "")?;
        let time = selection.time(&source_name, arranged.length(Axis::Time))?;
        data::check_size(&source_name, &header.shape)?;
        let geometry = Geometry::unit(&source_name, arranged.dims())?;
        let stored = if header.is_fortran { arranged.reversed() } else { arranged };
        let numbers = header.shape.iter().product();
        let expected = count(numbers).saturating_mul(count(header.voxel_type.bytes()));
        let found = self.bytes.saturating_sub(header.length);
        if found < expected {
            return Err(VolumeError::Short { path: self.path.to_owned(), found, expected });
        }
        let (at, skip) = match self.encoding {
            Encoding::Raw => (self.at + header.length, 0),
            _ => (self.at, header.length),
        };
        let data = Data {
            files: vec![DataFile { path: self.path.to_owned(), numbers }],
            start: Start { at, lines: 0, skip: Skip::Bytes(skip) },
            encoding: self.encoding,
            voxel_type: header.voxel_type,
            byte_order: header.byte_order,
            picks: stored.picks(component, time),
            alone: self.alone,
        };
        let is_in_order = "its numbers are not in the order of slices, as in Fortran order";
        let dims = if stored.is_straight() { Ok(geometry.dims) } else { Err(is_in_order) };
        let (files, halves, has_labels) = (data.paths(), header.is_half, header.is_boolean);
        let finish = move |voxels, mut notes: Vec<String>| {
            let mut volume = Volume::of_voxels(&source_name, voxels, geometry)?;
            (volume.components, volume.has_labels, volume.files) = (components, has_labels, files);
            notes.push(format!("{source_name}: NumPy files have no spacing; Relume uses 1 1 1"));
            volume.assumed_spacing = notes.last().cloned();
            volume.notes = notes;
            Ok(volume)
        };
        Ok((Streamed { data, halves, dims, notes: Vec::new(), finish: Box::new(finish) }, stored))
    }

    fn volume(&self, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
        let source_name = self.path.display().to_string();
        let (streamed, stored) = self.streamed(selection)?;
        if stored.is_straight() {
            return streamed.read(&source_name, selection, progress);
        }
        let Streamed { data, halves, mut notes, finish, .. } = streamed;
        let voxels = if self.encoding != Encoding::Raw {
            // The file may have fewer numbers than it states, so that memory grows as they come.
            let voxels = data.read(progress, &mut notes)?;
            let voxels = with_voxels!(voxels, numbers => stored.straightened(&source_name, numbers)?);
            if halves { floats_of_halves(voxels, &source_name)? } else { voxels }
        } else if halves {
            Voxels::F32(self.laid::<u16, f32>(&data, &stored, progress, &mut notes, float_of_half)?)
        } else {
            with_type!(data.voxel_type, T => T::into_voxels(self.laid(&data, &stored, progress, &mut notes, |it: T| it)?))
        };
        finish(voxels, notes)
    }

    /// Reads numbers in another order than that of voxels, each slab straight into its place.
    fn laid<T: Voxel, V: Voxel>(
        &self,
        data: &Data,
        stored: &Arranged,
        progress: &dyn Progress,
        notes: &mut Vec<String>,
        convert: impl Fn(T) -> V + Sync,
    ) -> Result<Vec<V>, VolumeError> {
        let mut voxels: Vec<V> = Vec::new();
        data.read_into::<T>(progress, notes, &mut |first, part| {
            if voxels.is_empty() {
                voxels = allocate::zeroed(self.path, stored.dims().iter().product())?;
            }
            stored.lay(first, part, &mut voxels, &convert);
            Ok(())
        })?;
        Ok(voxels)
    }

    /// Reads the header: at most [`LONGEST`] bytes.
    fn header(&self) -> Result<Header, VolumeError> {
        let mut stream = stream::decoded(self.path, self.at, self.encoding)?;
        let mut read = |bytes: &mut [u8]| {
            stream::read_fully(&mut stream, bytes).map_err(|source| match self.encoding.name() {
                Some(encoding) => VolumeError::Inflate { path: self.path.to_owned(), encoding, decoded: 0, source },
                None => stream::failed(self.path, source),
            })
        };
        let mut beginning = [0; BEGINNING];
        let there = read(&mut beginning)?;
        if there < BEGINNING || !recognises(&beginning) {
            return Err(self.wrong(format!(
                "the first {there} bytes do not contain the magic word NUMPY, a version and a length"
            )));
        }
        // Version 1 has a length of two bytes, so that two bytes of text are read already.
        let [_, _, _, _, _, _, version, _, a, b, c, d] = beginning;
        let (length, before) = match version {
            1 => (usize::from(u16::from_le_bytes([a, b])), 10),
            2 | 3 => (usize::try_from(u32::from_le_bytes([a, b, c, d])).unwrap_or(usize::MAX), BEGINNING),
            _ => return Err(self.wrong(format!("version {version} is not one of 1, 2, 3"))),
        };
        if length > LONGEST {
            return Err(self.wrong(format!("the header has {length} bytes; Relume reads at most {LONGEST}")));
        }
        let mut text = beginning[before..].to_vec();
        let already = text.len();
        text.resize(length.max(already), 0);
        let there = already + read(&mut text[already..])?;
        if there < length {
            return Err(self.wrong(format!("the file has {there} bytes of text in its header, but states {length}")));
        }
        text.truncate(length);
        self.parse(&String::from_utf8_lossy(&text), count(before + length))
    }

    fn parse(&self, text: &str, length: u64) -> Result<Header, VolumeError> {
        let fields = fields(text).ok_or_else(|| {
            let start: String = text.trim().chars().take(60).collect();
            self.wrong(format!("{start:?} is not a dictionary of descr, fortran_order and shape"))
        })?;
        let find = |key: &str| {
            let found = fields.iter().rev().find(|(name, _)| *name == key).map(|(_, value)| *value);
            found.ok_or_else(|| self.wrong(format!("the key {key} is missing")))
        };
        let descr = find("descr")?;
        let is_fortran = match find("fortran_order")? {
            "True" => true,
            "False" => false,
            other => return Err(self.wrong(format!("fortran_order is {other}, not True or False"))),
        };
        let shape = find("shape")?;
        let inside = shape.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
        let sides: Option<Result<Vec<usize>, _>> = inside.map(|inside| {
            let words = inside.split(',').map(str::trim).filter(|word| !word.is_empty());
            words.map(|word| word.trim_end_matches('L').parse()).collect()
        });
        let Some(Ok(shape)) = sides else {
            return Err(self.wrong(format!("shape is {shape}, not a tuple of whole numbers")));
        };
        let (voxel_type, byte_order, kind) = self.stored(descr)?;
        let (is_half, is_boolean) = (kind == Kind::Half, kind == Kind::Boolean);
        Ok(Header { voxel_type, byte_order, is_half, is_boolean, is_fortran, shape, length })
    }

    /// Type of the stored numbers.
    fn stored(&self, descr: &str) -> Result<(VoxelType, ByteOrder, Kind), VolumeError> {
        let name = descr.trim_matches(['\'', '"']);
        if let Some(stored) = type_string::of(name) {
            return Ok(stored);
        }
        let code = name.trim_start_matches(['<', '>', '|', '=']);
        let what = match code.chars().next() {
            Some('O') => "objects, which cannot be read without running their code",
            Some('S' | 'U' | 'a') => "strings",
            Some('V' | '[') => "structures",
            Some('c') => "complex numbers",
            Some('M' | 'm') => "times",
            Some('f') => "floats of another size than 2, 4 or 8 bytes",
            _ => "not a number type",
        };
        let what = if descr.starts_with(['[', '(']) { "structures" } else { what };
        let start: String = descr.chars().take(40).collect();
        Err(self.wrong(format!("descr is {start}: {what}; Relume reads booleans, whole numbers and floats")))
    }

    /// The axes of an array of this shape.
    fn arranged(&self, shape: &[usize], selection: &Selection) -> Result<Arranged, VolumeError> {
        if shape.contains(&0) || shape.is_empty() {
            let text = shape.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
            return Err(self.wrong(format!("shape is ({text}); every axis needs at least one voxel")));
        }
        let axes = match &selection.axes {
            Some(letters) => axes::stated(letters, shape).map_err(|problem| self.wrong(problem))?,
            None => axes::unnamed(shape)
                .ok_or_else(|| VolumeError::AxesUnknown { path: self.path.to_owned(), shape: axes::by(shape) })?,
        };
        Arranged::new(shape, axes).map_err(|problem| self.wrong(problem))
    }
}

/// Fields of a header.
struct Header {
    voxel_type: VoxelType,
    byte_order: ByteOrder,
    is_half: bool,
    is_boolean: bool,
    /// Whether the first axis varies fastest.
    is_fortran: bool,
    /// Lengths of the axes in the order of their indices.
    shape: Vec<usize>,
    /// Bytes before the values.
    length: u64,
}

/// Keys and values of the dictionary that a header is; values are as written. `None` if it is none.
fn fields(text: &str) -> Option<Vec<(&str, &str)>> {
    let mut rest = text.trim().strip_prefix('{')?.strip_suffix('}')?.trim();
    let mut fields = Vec::new();
    while !rest.is_empty() {
        let quote = rest.chars().next().filter(|letter| matches!(letter, '\'' | '"'))?;
        let (key, after) = rest[1..].split_once(quote)?;
        let after = after.trim_start().strip_prefix(':')?.trim_start();
        // A value ends at a comma outside brackets and quotes.
        let (mut depth, mut quoted, mut end) = (0_usize, None, after.len());
        for (at, letter) in after.char_indices() {
            match (quoted, letter) {
                (Some(quote), letter) if letter == quote => quoted = None,
                (Some(_), _) => {}
                (None, '\'' | '"') => quoted = Some(letter),
                (None, '(' | '[' | '{') => depth += 1,
                (None, ')' | ']' | '}') => depth = depth.checked_sub(1)?,
                (None, ',') if depth == 0 => {
                    end = at;
                    break;
                }
                _ => {}
            }
        }
        fields.push((key, after[..end].trim_end()));
        rest = after[end..].trim_start_matches(',').trim_start();
    }
    Some(fields)
}
