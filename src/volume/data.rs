//! Decoding of data files to voxels, slab by slab.

use std::fmt;
use std::io::{self, Read};
use std::path::{Component, Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use super::stream::{self, Encoding, Skip, Start, count, read_fully};
use crate::layout::ByteOrder;
use crate::select::{Pick, next_run};
use crate::voxels::{float_of_half, with_type};
use crate::{VolumeError, Voxel, VoxelType, Voxels, allocate};
use relume_base::progress::Progress;

/// Unwanted bytes before the numbers that are inflated at most.
pub(crate) const MOST_SKIPPED: u64 = 64 << 20;

/// Bytes decoded between two progress reports.
pub(crate) const SLAB_BYTES: usize = 1 << 22;

/// A file and the count of numbers in it.
#[derive(Clone, Debug)]
pub(crate) struct DataFile {
    pub(crate) path: PathBuf,
    pub(crate) numbers: usize,
}

impl DataFile {
    /// Returns an existing file; a long list of missing files must fail at the first.
    pub(crate) fn found(path: PathBuf, numbers: usize) -> Result<Self, VolumeError> {
        match std::fs::metadata(&path) {
            Ok(_) => Ok(Self { path, numbers }),
            Err(source) => Err(VolumeError::Open { path, source }),
        }
    }
}

/// Returns the path of the data file `name` of `header`. It must lie in the header's folder or below: a header may come
/// from anywhere, and must not choose which files of this machine are read.
pub(crate) fn beside(header: &Path, name: &str) -> Result<PathBuf, VolumeError> {
    let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if Path::new(name).components().all(inside) {
        Ok(header.parent().unwrap_or(Path::new("")).join(name))
    } else {
        Err(VolumeError::Outside { header: header.to_owned(), name: name.to_owned() })
    }
}

/// The existing file `name` of `header`, if it is one: a per cent sign in the name of a file is no pattern.
pub(crate) fn existing(header: &Path, name: &str) -> Option<PathBuf> {
    beside(header, name).ok().filter(|path| path.is_file())
}

/// Refuses axes with more numbers in total than can be addressed.
pub(crate) fn check_size(source: impl fmt::Display, axes: &[usize]) -> Result<(), VolumeError> {
    // Eight bytes per number must be addressable, whatever the type.
    let bytes = axes.iter().try_fold(8_usize, |product, &n| product.checked_mul(n));
    if !axes.contains(&0) && bytes.is_some_and(|bytes| isize::try_from(bytes).is_ok()) {
        return Ok(());
    }
    let dims: Vec<String> = axes.iter().map(ToString::to_string).collect();
    Err(VolumeError::Dims { source_name: source.to_string(), dims: dims.join("×") })
}

/// Description of the stored voxels; the files are concatenated.
#[derive(Clone, Debug)]
pub(crate) struct Data {
    pub(crate) files: Vec<DataFile>,
    pub(crate) start: Start,
    pub(crate) encoding: Encoding,
    pub(crate) voxel_type: VoxelType,
    pub(crate) byte_order: ByteOrder,
    /// Positions on disjoint axes that select the voxels among the numbers; if empty, all numbers are voxels.
    pub(crate) picks: Vec<Pick>,
    /// Whether a file ends with the numbers; otherwise more bytes behind them are not an oddity.
    pub(crate) alone: bool,
}

impl Data {
    /// Paths of the files, in order.
    pub(crate) fn paths(&self) -> Vec<PathBuf> {
        self.files.iter().map(|file| file.path.clone()).collect()
    }

    /// Reads the voxels of all files. Harmless oddities are appended to `notes`.
    ///
    /// Memory is bounded by what the lengths of the files justify, and is allocated only after all files have been
    /// examined.
    pub(crate) fn read(&self, progress: &dyn Progress, notes: &mut Vec<String>) -> Result<Voxels, VolumeError> {
        with_type!(self.voxel_type, T => self.read_as::<T>(progress, notes))
    }

    /// Reads floats of 16 bits, which have the type `uint16` here, as those of 32.
    pub(crate) fn read_halves(&self, progress: &dyn Progress, notes: &mut Vec<String>) -> Result<Voxels, VolumeError> {
        let mut voxels: Vec<f32> = Vec::new();
        let all = self.voxels();
        self.read_into::<u16>(progress, notes, &mut |_, part| {
            let path = self.files.first().map_or(Path::new(""), |file| &file.path);
            allocate::reserve(&mut voxels, part.len(), all, path)?;
            voxels.extend(part.iter().map(|&bits| float_of_half(bits)));
            Ok(())
        })?;
        Ok(Voxels::F32(voxels))
    }

    /// Number of voxels.
    pub(crate) fn voxels(&self) -> usize {
        let numbers: usize = self.files.iter().map(|file| file.numbers).sum();
        self.picks.iter().fold(numbers, |numbers, pick| numbers / pick.length)
    }

    fn read_as<T: Voxel>(&self, progress: &dyn Progress, notes: &mut Vec<String>) -> Result<Voxels, VolumeError> {
        Ok(T::into_voxels(self.slabs::<T>(progress, notes, None)?))
    }

    /// Reads the voxels slab by slab: `take` receives the index of the first one and the voxels. Nothing is handed on before
    /// the lengths of the files have been compared with the header.
    pub(crate) fn read_into<T: Voxel>(
        &self,
        progress: &dyn Progress,
        notes: &mut Vec<String>,
        take: Take<'_, T>,
    ) -> Result<(), VolumeError> {
        self.slabs::<T>(progress, notes, Some(take)).map(drop)
    }

    /// Reads the voxels; they are handed to `take`, or else returned.
    fn slabs<T: Voxel>(
        &self,
        progress: &dyn Progress,
        notes: &mut Vec<String>,
        take: Option<Take<'_, T>>,
    ) -> Result<Vec<T>, VolumeError> {
        let starts = self.files.iter().map(|file| self.start_of(file, notes)).collect::<Result<Vec<_>, _>>()?;
        let picks: Vec<Pick> = self.picks.iter().copied().filter(|pick| pick.length > 1).collect();
        let numbers: usize = self.files.iter().map(|file| file.numbers).sum();
        let all = self.voxels();
        // Uncompressed numbers are in the files. Memory that the system zeroes is not written twice.
        let is_whole = self.encoding == Encoding::Raw && picks.is_empty() && take.is_none();
        let mut slabs = Slabs::<'_, '_, T> {
            voxels: match self.files.first() {
                Some(file) if is_whole => allocate::zeroed(&file.path, all)?,
                _ => Vec::new(),
            },
            filled: 0,
            all,
            picks,
            at: 0,
            numbers,
            buffer: Vec::new(),
            take,
            swap: self.byte_order != ByteOrder::NATIVE,
            progress,
        };
        for (file, start) in self.files.iter().zip(starts) {
            if slabs.wants(file) {
                self.read_file(&mut slabs, file, start, notes)?;
            } else {
                slabs.at += file.numbers;
            }
        }
        Ok(slabs.voxels)
    }

    fn read_file<T: Voxel>(
        &self,
        slabs: &mut Slabs<'_, '_, T>,
        file: &DataFile,
        start: u64,
        notes: &mut Vec<String>,
    ) -> Result<(), VolumeError> {
        let path = &file.path;
        let expected = count(file.numbers).saturating_mul(count(size_of::<T>()));
        if self.encoding == Encoding::Text {
            let mut stream = stream::at(path, start)?;
            let whole = slabs.parse(file, &mut stream)?;
            let mut more = || stream::next_word(&mut stream, &mut Vec::new()).map(|word| word.is_some());
            if whole && self.alone && more().map_err(|source| stream::failed(path, source))? {
                notes.push(format!(
                    "{}: more than the {} numbers that the header requires; the rest is ignored",
                    path.display(),
                    file.numbers
                ));
            }
            return Ok(());
        }
        let damaged = |source, decoded| match self.encoding.name() {
            Some(encoding) => VolumeError::Inflate { path: path.clone(), encoding, decoded, source },
            None => stream::failed(path, source),
        };
        let skipped = match (self.start.skip, self.encoding.packing()) {
            (_, None) => 0,
            (Skip::Bytes(bytes), Some(_)) => bytes,
            (Skip::Tail, Some(_)) => {
                // Only decoding finds the end of the data; the second pass then knows the offset.
                let mut all = stream::decoded(path, start, self.encoding)?;
                let length = slabs.pass_over(file, &mut all, u64::MAX, damaged)?;
                length.checked_sub(expected).ok_or_else(|| VolumeError::Short {
                    path: path.clone(),
                    found: length,
                    expected,
                })?
            }
        };
        let mut stream = stream::decoded(path, start, self.encoding)?;
        slabs.pass_over(file, &mut stream, skipped, damaged)?;
        let whole = slabs.fill(file, &mut stream, damaged)?;
        if !whole || self.encoding.packing().is_none() {
            return Ok(());
        }
        // Tries to read one byte more. There should be none, and reaching the end verifies the checksum.
        if read_fully(&mut stream, &mut [0]).map_err(|source| damaged(source, expected))? > 0 {
            // What follows the numbers of a gzip file may be more of its own.
            if self.alone || self.encoding != Encoding::Gzip {
                notes.push(format!(
                    "{}: decompresses to more than the {expected} bytes that the header requires; the rest is ignored",
                    path.display()
                ));
            }
        } else if let (Encoding::Deflate { crc }, Some(found)) = (self.encoding, stream.checksum())
            && crc != found
        {
            let source = io::Error::other(format!("the checksum is {found:08x}, but should be {crc:08x}"));
            return Err(damaged(source, expected));
        } else if let (Encoding::Zlib { said: Some(said) }, Some(read)) = (self.encoding, stream.read_in())
            && said != read
        {
            notes.push(format!(
                "{}: the header states {said} compressed bytes, but {read} were found; all of them were read",
                path.display(),
            ));
        }
        Ok(())
    }

    /// Compares the lengths of the files with the numbers that they should hold.
    pub(crate) fn check_lengths(&self) -> Result<(), VolumeError> {
        self.files.iter().try_for_each(|file| self.start_of(file, &mut Vec::new()).map(drop))
    }

    /// Returns the offset of the first encoded byte in `file`, after a check that the file is long enough for its
    /// numbers.
    fn start_of(&self, file: &DataFile, notes: &mut Vec<String>) -> Result<u64, VolumeError> {
        let path = &file.path;
        let (begin, length) = stream::after_lines(path, self.start)?;
        let expected = count(file.numbers).saturating_mul(count(self.voxel_type.bytes()));
        let (skipped, start) = match (self.start.skip, self.encoding.packing()) {
            (Skip::Bytes(bytes), None) => (0, begin.saturating_add(bytes).min(length)),
            (Skip::Tail, None) => (0, length.saturating_sub(expected)),
            (Skip::Bytes(bytes), Some(_)) => (bytes, begin),
            (Skip::Tail, Some(_)) => (0, begin),
        };
        let found = length - start;
        match (self.encoding, self.encoding.packing()) {
            (Encoding::Raw, _) if found < expected => Err(VolumeError::Short { path: path.clone(), found, expected }),
            (Encoding::Raw, _) if found > expected && self.alone => {
                notes.push(format!(
                    "{}: {found} bytes of voxels, but the stated dims and type require only {expected}; the rest is ignored",
                    path.display()
                ));
                Ok(start)
            }
            (Encoding::Hex, _) if found / 2 < expected => {
                Err(VolumeError::Short { path: path.clone(), found: found / 2, expected })
            }
            // A number and its separator take two bytes; the last number needs no separator.
            (Encoding::Text, _) if found.div_ceil(2) < count(file.numbers) => Err(VolumeError::ShortText {
                path: path.clone(),
                found: usize::try_from(found.div_ceil(2)).unwrap_or(usize::MAX),
                expected: file.numbers,
            }),
            (_, Some(limit)) if found.saturating_mul(limit) < expected.saturating_add(skipped) => {
                let expected = expected.saturating_add(skipped);
                let encoding = self.encoding.name().unwrap_or_default();
                Err(VolumeError::Incredible { path: path.clone(), compressed: found, expected, encoding, limit })
            }
            _ => Ok(start),
        }
    }
}

/// Receives the index of a voxel, and voxels from there on.
pub(crate) type Take<'a, T> = &'a mut dyn FnMut(usize, &[T]) -> Result<(), VolumeError>;

/// The voxels decoded so far, and the state of decoding.
struct Slabs<'a, 'b, T> {
    voxels: Vec<T>,
    /// Number of decoded voxels; more may be allocated.
    filled: usize,
    /// Number of voxels at the end.
    all: usize,
    /// Positions that select the voxels among the numbers.
    picks: Vec<Pick>,
    /// Numbers decoded from all files so far; `numbers` is the total.
    at: usize,
    numbers: usize,
    /// Slab of decoded numbers from which voxels are picked.
    buffer: Vec<T>,
    /// Receives the voxels in place of `voxels`.
    take: Option<Take<'b, T>>,
    swap: bool,
    progress: &'a dyn Progress,
}

impl<T: Voxel> Slabs<'_, '_, T> {
    /// Whether `file`, the next one, holds a voxel.
    fn wants(&self, file: &DataFile) -> bool {
        next_run(&self.picks, self.at).0 < self.at + file.numbers
    }

    /// Appends the voxels of `file`; `decode` fills a slab with the numbers from the given index on. Returns whether
    /// the numbers were decoded to the end of the file.
    fn take(
        &mut self,
        file: &DataFile,
        mut decode: impl FnMut(&mut [T], usize) -> Result<(), VolumeError>,
    ) -> Result<bool, VolumeError> {
        let (first, end) = (self.at, self.at + file.numbers);
        while self.at < end && self.filled < self.all {
            let length = (end - self.at).min(SLAB_BYTES / size_of::<T>());
            let there = self.filled;
            if self.voxels.len() == there && self.take.is_none() {
                allocate::reserve(&mut self.voxels, length.min(self.all - there), self.all, &file.path)?;
            }
            if self.picks.is_empty() && self.take.is_none() {
                self.voxels.resize(self.voxels.len().max(there + length), T::zeroed());
                decode(&mut self.voxels[there..there + length], self.at - first)?;
                self.filled += length;
            } else {
                self.buffer.resize(length, T::zeroed());
                decode(&mut self.buffer, self.at - first)?;
                let (mut start, mut run) = next_run(&self.picks, self.at);
                while start < self.at + length {
                    let stop = start.saturating_add(run).min(self.at + length);
                    let part = &self.buffer[start - self.at..stop - self.at];
                    match &mut self.take {
                        Some(take) => take(self.filled, part)?,
                        None => self.voxels.extend_from_slice(part),
                    }
                    self.filled += part.len();
                    (start, run) = next_run(&self.picks, stop);
                }
            }
            self.at += length;
            self.report(file)?;
        }
        let whole = self.at == end;
        self.at = end;
        Ok(whole)
    }

    /// Appends the voxels of `file` from `stream`; `failed` makes the error from the count of bytes decoded before it.
    fn fill(
        &mut self,
        file: &DataFile,
        stream: &mut dyn Read,
        failed: impl Fn(io::Error, u64) -> VolumeError,
    ) -> Result<bool, VolumeError> {
        let swap = self.swap;
        self.take(file, |slab, first| Next::of(file, first).decode(slab, stream, swap, &failed))
    }

    /// Appends the voxels of `file` from text.
    fn parse(&mut self, file: &DataFile, stream: &mut dyn io::BufRead) -> Result<bool, VolumeError> {
        self.take(file, |slab, first| Next::of(file, first).parse(slab, stream))
    }

    /// Discards up to `bytes` of `stream`; returns the number of discarded bytes.
    fn pass_over(
        &self,
        file: &DataFile,
        stream: &mut dyn Read,
        bytes: u64,
        failed: impl Fn(io::Error, u64) -> VolumeError,
    ) -> Result<u64, VolumeError> {
        let mut scratch = vec![0; SLAB_BYTES.min(usize::try_from(bytes).unwrap_or(SLAB_BYTES))];
        let mut bytes_read = 0;
        while bytes_read < bytes {
            let wanted = usize::try_from(bytes - bytes_read).unwrap_or(SLAB_BYTES).min(SLAB_BYTES);
            let got = read_fully(stream, &mut scratch[..wanted]).map_err(|source| failed(source, 0))?;
            bytes_read += count(got);
            self.report(file)?;
            if got < wanted {
                break;
            }
        }
        Ok(bytes_read)
    }

    fn report(&self, file: &DataFile) -> Result<(), VolumeError> {
        let bytes = |numbers: usize| count(numbers) * count(size_of::<T>());
        report(&file.path, bytes(self.at), bytes(self.numbers), self.progress)
    }
}

/// The numbers of a file from index `first` on; the file should hold `expected` numbers.
pub(crate) struct Next<'a> {
    pub(crate) path: &'a Path,
    pub(crate) first: usize,
    pub(crate) expected: usize,
}

impl<'a> Next<'a> {
    fn of(file: &'a DataFile, first: usize) -> Self {
        Self { path: &file.path, first, expected: file.numbers }
    }

    /// Fills `slab` from bytes, with an optional swap of the byte order; `failed` makes the error from the count of
    /// bytes decoded before it.
    pub(crate) fn decode<T: Voxel>(
        &self,
        slab: &mut [T],
        stream: &mut dyn Read,
        swap: bool,
        failed: impl Fn(io::Error, u64) -> VolumeError,
    ) -> Result<(), VolumeError> {
        let bytes = |numbers: usize| count(numbers) * count(size_of::<T>());
        let (wanted, before) = (size_of_val(slab), bytes(self.first));
        let got = read_fully(stream, bytemuck::cast_slice_mut(slab)).map_err(|source| failed(source, before))?;
        if got < wanted {
            let (found, expected) = (before + count(got), bytes(self.expected));
            return Err(VolumeError::Short { path: self.path.to_owned(), found, expected });
        }
        if swap {
            slab.iter_mut().for_each(|voxel| *voxel = voxel.with_bytes_swapped());
        }
        Ok(())
    }

    /// Fills `slab` from text.
    pub(crate) fn parse<T: Voxel>(&self, slab: &mut [T], stream: &mut dyn io::BufRead) -> Result<(), VolumeError> {
        let path = || self.path.to_owned();
        let mut word = Vec::new();
        for (voxel, index) in slab.iter_mut().zip(self.first..) {
            let text = stream::next_word(stream, &mut word).map_err(|source| stream::failed(self.path, source))?;
            let Some(text) = text else {
                return Err(VolumeError::ShortText { path: path(), found: index, expected: self.expected });
            };
            *voxel = T::parse(&text).ok_or_else(|| VolumeError::Text {
                path: path(),
                index,
                text: text.to_string(),
                voxel_type: T::TYPE.name(),
            })?;
        }
        Ok(())
    }
}

/// Reports that `done` of `all` bytes of `path` have been read; returns an error if `progress` cancels.
pub(crate) fn report(path: &Path, done: u64, all: u64, progress: &dyn Progress) -> Result<(), VolumeError> {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    progress.report(&format!("reading {name}"), done, all);
    check_cancelled(path, progress)
}

/// Progress of listing the files of a folder before their voxels are read.
pub(crate) struct Listing<'a> {
    folder: &'a Path,
    files: u64,
    done: AtomicU64,
    progress: &'a dyn Progress,
}

impl<'a> Listing<'a> {
    pub(crate) fn of(folder: &'a Path, files: usize, progress: &'a dyn Progress) -> Self {
        Self { folder, files: count(files), done: AtomicU64::new(0), progress }
    }

    /// Reports one file more; returns an error if the progress cancels.
    pub(crate) fn next(&self) -> Result<(), VolumeError> {
        let done = self.done.fetch_add(1, Ordering::Relaxed);
        let name = self.folder.file_name().unwrap_or(self.folder.as_os_str()).to_string_lossy();
        self.progress.report(&format!("listing {name}"), done, self.files);
        check_cancelled(self.folder, self.progress)
    }
}

/// Error if `progress` cancels the reading of `path`.
pub(crate) fn check_cancelled(path: &Path, progress: &dyn Progress) -> Result<(), VolumeError> {
    if progress.cancelled() {
        return Err(VolumeError::Cancelled { source_name: path.display().to_string() });
    }
    Ok(())
}
