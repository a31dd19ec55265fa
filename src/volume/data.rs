//! Bytes of data files become voxels, slab by slab.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use flate2::bufread::ZlibDecoder;

use super::raw::ByteOrder;
use super::{VolumeError, Voxel, VoxelType, Voxels};
use crate::progress::Progress;

/// Bytes decoded between two looks at the listener.
const SLAB_BYTES: usize = 1 << 22;

/// Deflate packs at most 1032 bytes into one (258 bytes into a match of two bits).
const DEFLATE_LIMIT: u64 = 1032;

/// Where the voxels of a file begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Start {
    /// So many bytes after the beginning.
    At(u64),
    /// Where just the voxels are left.
    Tail,
}

/// How voxels are written down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// As they lie in memory, in some byte order.
    Raw,
    /// The same, as one zlib stream; `said` is the number of compressed bytes the header claims.
    Zlib { said: Option<u64> },
    /// As numbers between white space or commas.
    Text,
}

/// A file and how many voxels it holds.
#[derive(Clone, Debug)]
pub(super) struct DataFile {
    pub(super) path: PathBuf,
    pub(super) voxels: usize,
}

impl DataFile {
    /// A file that is there: long lists of files that are not must end at the first.
    pub(super) fn found(path: PathBuf, voxels: usize) -> Result<Self, VolumeError> {
        match std::fs::metadata(&path) {
            Ok(_) => Ok(Self { path, voxels }),
            Err(source) => Err(VolumeError::Open { path, source }),
        }
    }
}

/// All that it takes to read voxels; the files follow one another.
#[derive(Clone, Debug)]
pub(super) struct Data {
    pub(super) files: Vec<DataFile>,
    pub(super) start: Start,
    pub(super) encoding: Encoding,
    pub(super) voxel_type: VoxelType,
    pub(super) byte_order: ByteOrder,
}

impl Data {
    /// The files, in order.
    pub(super) fn paths(&self) -> Vec<PathBuf> {
        self.files.iter().map(|file| file.path.clone()).collect()
    }

    /// The voxels of all files. What was odd but harmless goes to `notes`.
    ///
    /// No more memory is taken than the lengths of the files justify, and none before all of them have been looked at.
    pub(super) fn read(&self, progress: &dyn Progress, notes: &mut Vec<String>) -> Result<Voxels, VolumeError> {
        match self.voxel_type {
            VoxelType::U8 => self.read_as::<u8>(progress, notes),
            VoxelType::I8 => self.read_as::<i8>(progress, notes),
            VoxelType::U16 => self.read_as::<u16>(progress, notes),
            VoxelType::I16 => self.read_as::<i16>(progress, notes),
            VoxelType::U32 => self.read_as::<u32>(progress, notes),
            VoxelType::I32 => self.read_as::<i32>(progress, notes),
            VoxelType::U64 => self.read_as::<u64>(progress, notes),
            VoxelType::I64 => self.read_as::<i64>(progress, notes),
            VoxelType::F32 => self.read_as::<f32>(progress, notes),
            VoxelType::F64 => self.read_as::<f64>(progress, notes),
        }
    }

    fn read_as<T: Voxel>(&self, progress: &dyn Progress, notes: &mut Vec<String>) -> Result<Voxels, VolumeError> {
        let starts = self.files.iter().map(|file| self.start_of(file, notes)).collect::<Result<Vec<_>, _>>()?;
        let mut slabs = Slabs::<T> {
            voxels: Vec::new(),
            all: self.files.iter().map(|file| file.voxels).sum(),
            swap: self.byte_order != ByteOrder::NATIVE,
            progress,
        };
        for (file, start) in self.files.iter().zip(starts) {
            let path = &file.path;
            let mut stream = BufReader::with_capacity(1 << 16, open(path)?);
            stream.seek(SeekFrom::Start(start)).map_err(|source| VolumeError::Read { path: path.clone(), source })?;
            match self.encoding {
                Encoding::Raw => {
                    slabs.fill(file, &mut stream, |source, _| VolumeError::Read { path: path.clone(), source })?;
                }
                Encoding::Zlib { said } => inflate(&mut slabs, file, stream, said, notes)?,
                Encoding::Text => slabs.parse(file, stream, notes)?,
            }
        }
        Ok(T::into_voxels(slabs.voxels))
    }

    /// The first byte of the voxels of `file`, which is long enough to hold them.
    fn start_of(&self, file: &DataFile, notes: &mut Vec<String>) -> Result<u64, VolumeError> {
        let path = &file.path;
        let metadata = open(path)?.metadata().map_err(|source| VolumeError::Read { path: path.clone(), source })?;
        if !metadata.is_file() {
            return Err(VolumeError::Open { path: path.clone(), source: io::Error::other("this is not a file") });
        }
        let length = metadata.len();
        let expected = count(file.voxels) * count(self.voxel_type.bytes());
        let start = match self.start {
            Start::At(start) => start.min(length),
            Start::Tail => length.saturating_sub(expected),
        };
        let found = length - start;
        match self.encoding {
            Encoding::Raw if found < expected => Err(VolumeError::Short { path: path.clone(), found, expected }),
            Encoding::Raw if found > expected => {
                notes.push(format!(
                    "{}: {found} bytes of voxels, of which the header needs the first {expected}",
                    path.display()
                ));
                Ok(start)
            }
            Encoding::Zlib { .. } if found.saturating_mul(DEFLATE_LIMIT) < expected => {
                Err(VolumeError::Incredible { path: path.clone(), compressed: found, expected })
            }
            // A number and what parts it from the next take two bytes; the last needs no parting.
            Encoding::Text if found.div_ceil(2) < count(file.voxels) => Err(VolumeError::ShortText {
                path: path.clone(),
                found: usize::try_from(found.div_ceil(2)).unwrap_or(usize::MAX),
                expected: file.voxels,
            }),
            _ => Ok(start),
        }
    }
}

/// Opens a file of voxels.
pub(super) fn open(path: &Path) -> Result<File, VolumeError> {
    File::open(path).map_err(|source| VolumeError::Open { path: path.to_owned(), source })
}

/// A number of things in memory as a number of bytes of a file; memory is never larger than 2⁶⁴.
fn count(number: usize) -> u64 {
    u64::try_from(number).unwrap_or(u64::MAX)
}

fn inflate<T: Voxel>(
    slabs: &mut Slabs<'_, T>,
    file: &DataFile,
    stream: BufReader<File>,
    said: Option<u64>,
    notes: &mut Vec<String>,
) -> Result<(), VolumeError> {
    let path = &file.path;
    let damaged = |source, decoded| VolumeError::Inflate { path: path.clone(), decoded, source };
    let mut decoder = ZlibDecoder::new(stream);
    slabs.fill(file, &mut decoder, damaged)?;
    // One byte more: there should be none, and getting there checks the checksum.
    let decoded = count(file.voxels) * count(size_of::<T>());
    if read_fully(&mut decoder, &mut [0]).map_err(|source| damaged(source, decoded))? > 0 {
        notes.push(format!(
            "{}: inflates to more than the {decoded} bytes the header makes it; the rest is left",
            path.display()
        ));
    } else if let Some(said) = said.filter(|&said| said != decoder.total_in()) {
        notes.push(format!(
            "{}: the header says {said} compressed bytes, there are {}; all of them were read",
            path.display(),
            decoder.total_in()
        ));
    }
    Ok(())
}

/// The voxels so far, and how to come by more.
struct Slabs<'a, T> {
    voxels: Vec<T>,
    /// How many there will be.
    all: usize,
    swap: bool,
    progress: &'a dyn Progress,
}

impl<T: Voxel> Slabs<'_, T> {
    /// Appends the voxels of `file` from `stream`; `failed` makes the error, given the bytes decoded until then.
    fn fill(
        &mut self,
        file: &DataFile,
        stream: &mut dyn Read,
        failed: impl Fn(io::Error, u64) -> VolumeError,
    ) -> Result<(), VolumeError> {
        let first = self.voxels.len();
        let end = first + file.voxels;
        while self.voxels.len() < end {
            let start = self.voxels.len();
            let length = (end - start).min(SLAB_BYTES / size_of::<T>());
            self.make_room(file, length)?;
            self.voxels.resize(start + length, T::zeroed());
            let slab = &mut self.voxels[start..];
            let decoded = |bytes: usize| count((start - first) * size_of::<T>() + bytes);
            let got =
                read_fully(stream, bytemuck::cast_slice_mut(slab)).map_err(|source| failed(source, decoded(0)))?;
            if got < length * size_of::<T>() {
                let expected = count(file.voxels) * count(size_of::<T>());
                return Err(VolumeError::Short { path: file.path.clone(), found: decoded(got), expected });
            }
            if self.swap {
                slab.iter_mut().for_each(|voxel| *voxel = voxel.with_bytes_swapped());
            }
            self.report(file)?;
        }
        Ok(())
    }

    /// Appends the voxels of `file`, written as text.
    fn parse(
        &mut self,
        file: &DataFile,
        mut stream: BufReader<File>,
        notes: &mut Vec<String>,
    ) -> Result<(), VolumeError> {
        let failed = |source| VolumeError::Read { path: file.path.clone(), source };
        for index in 0..file.voxels {
            let Some(text) = next_word(&mut stream).map_err(failed)? else {
                return Err(VolumeError::ShortText { path: file.path.clone(), found: index, expected: file.voxels });
            };
            let voxel = T::parse(&text).ok_or_else(|| VolumeError::Text {
                path: file.path.clone(),
                index,
                text: text.clone(),
                voxel_type: T::TYPE.name(),
            })?;
            if index % SLAB_BYTES == 0 {
                self.make_room(file, (file.voxels - index).min(SLAB_BYTES))?;
                self.report(file)?;
            }
            self.voxels.push(voxel);
        }
        if next_word(&mut stream).map_err(failed)?.is_some() {
            notes.push(format!("{}: more than the {} numbers the header makes it", file.path.display(), file.voxels));
        }
        self.report(file)
    }

    /// Makes room for `more` voxels; the room doubles as voxels arrive, and is never more than all of them need.
    fn make_room(&mut self, file: &DataFile, more: usize) -> Result<(), VolumeError> {
        let there = self.voxels.len();
        if self.voxels.capacity() - there < more {
            let room = more.max(there).min(self.all - there);
            self.voxels.try_reserve_exact(room).map_err(|_| VolumeError::Memory {
                source_name: file.path.display().to_string(),
                bytes: count(there + room) * count(size_of::<T>()),
            })?;
        }
        Ok(())
    }

    fn report(&self, file: &DataFile) -> Result<(), VolumeError> {
        let name = file.path.file_name().unwrap_or(file.path.as_os_str()).to_string_lossy();
        let bytes = |voxels: usize| count(voxels) * count(size_of::<T>());
        self.progress.report(&format!("reading {name}"), bytes(self.voxels.len()), bytes(self.all));
        if self.progress.cancelled() {
            return Err(VolumeError::Cancelled { source_name: file.path.display().to_string() });
        }
        Ok(())
    }
}

/// Fills `bytes` as far as `stream` goes, and says how far that was.
fn read_fully(stream: &mut dyn Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < bytes.len() {
        match stream.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            // A zlib stream that stops in the middle.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

/// The longest word that can be a number; longer ones are cut, and then are none.
const LONGEST_WORD: usize = 400;

/// The next run of bytes between white space or commas; `None` at the end.
fn next_word(stream: &mut BufReader<File>) -> io::Result<Option<String>> {
    let mut word = Vec::new();
    loop {
        let buffer = stream.fill_buf()?;
        if buffer.is_empty() {
            break;
        }
        let (mut used, mut ended) = (0, false);
        for &byte in buffer {
            used += 1;
            if !(byte.is_ascii_whitespace() || byte == b',') {
                word.push(byte);
            }
            ended = !word.is_empty() && (byte.is_ascii_whitespace() || byte == b',') || word.len() == LONGEST_WORD;
            if ended {
                break;
            }
        }
        stream.consume(used);
        if ended {
            break;
        }
    }
    Ok((!word.is_empty()).then(|| String::from_utf8_lossy(&word).into_owned()))
}
