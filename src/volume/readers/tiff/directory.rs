//! Directories of a TIFF file: their tags, and where the values of tags lie. TIFF and `BigTIFF`, in both byte orders.

use std::collections::HashSet;
use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use crate::stream;
use crate::{ByteOrder, VolumeError};

/// Largest number of directories; more are a mistake.
pub(super) const MOST_PAGES: usize = 1_000_000;

/// Longest value of a tag in bytes.
const LONGEST: u64 = 64 << 20;

/// The tags that Relume reads.
pub(super) mod tag {
    pub(in super::super) const SUBFILE_TYPE: u16 = 254;
    pub(in super::super) const WIDTH: u16 = 256;
    pub(in super::super) const HEIGHT: u16 = 257;
    pub(in super::super) const BITS: u16 = 258;
    pub(in super::super) const COMPRESSION: u16 = 259;
    pub(in super::super) const PHOTOMETRIC: u16 = 262;
    pub(in super::super) const FILL_ORDER: u16 = 266;
    pub(in super::super) const DESCRIPTION: u16 = 270;
    pub(in super::super) const STRIP_OFFSETS: u16 = 273;
    pub(in super::super) const SAMPLES: u16 = 277;
    pub(in super::super) const ROWS_PER_STRIP: u16 = 278;
    pub(in super::super) const STRIP_BYTES: u16 = 279;
    pub(in super::super) const X_RESOLUTION: u16 = 282;
    pub(in super::super) const Y_RESOLUTION: u16 = 283;
    pub(in super::super) const PLANAR: u16 = 284;
    pub(in super::super) const RESOLUTION_UNIT: u16 = 296;
    pub(in super::super) const PREDICTOR: u16 = 317;
    pub(in super::super) const TILE_WIDTH: u16 = 322;
    pub(in super::super) const TILE_HEIGHT: u16 = 323;
    pub(in super::super) const TILE_OFFSETS: u16 = 324;
    pub(in super::super) const TILE_BYTES: u16 = 325;
    pub(in super::super) const SUB_DIRECTORIES: u16 = 330;
    pub(in super::super) const SAMPLE_FORMAT: u16 = 339;
    pub(in super::super) const JPEG_TABLES: u16 = 347;
    pub(in super::super) const IMAGEJ_BYTES: u16 = 50838;
    pub(in super::super) const IMAGEJ: u16 = 50839;
}

/// Values of a tag in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Entry {
    /// Offset of the first value in the file.
    pub(super) at: u64,
    /// Number of values.
    pub(super) count: u64,
    /// Code of their type.
    kind: u16,
}

impl Entry {
    /// Bytes per value; 1 for an unknown type.
    fn size(self) -> u64 {
        match self.kind {
            3 | 8 => 2,
            4 | 9 | 11 | 13 => 4,
            5 | 10 | 12 | 16..=18 => 8,
            _ => 1,
        }
    }

    /// Value `index` alone; `None` past the end, and unless the values are whole numbers.
    fn one(self, index: u64) -> Option<Self> {
        let is_whole = index < self.count && matches!(self.kind, 1 | 3 | 4 | 7 | 13 | 16 | 18);
        is_whole.then(|| Self { at: self.at.saturating_add(index.saturating_mul(self.size())), count: 1, ..self })
    }
}

/// Values of a tag that were read together.
#[derive(Debug, Default)]
pub(super) struct Window {
    /// Offset of the first of them in the file.
    at: u64,
    bytes: Vec<u8>,
}

/// Longest window in bytes.
const WINDOW: usize = 4096;

/// Tags of one page.
#[derive(Debug)]
pub(super) struct Directory {
    /// Number of the page in the file, from 1, for messages.
    pub(super) page: usize,
    entries: Vec<(u16, Entry)>,
    /// Offset of the next directory; 0 after the last one.
    next: u64,
}

impl Directory {
    /// The values of `tag`, if the directory has it.
    pub(super) fn find(&self, tag: u16) -> Option<Entry> {
        self.entries.iter().find(|(name, _)| *name == tag).map(|(_, entry)| *entry)
    }
}

/// An open TIFF file.
#[derive(Debug)]
pub(super) struct Tiff {
    pub(super) path: PathBuf,
    /// Size of the file in bytes.
    pub(super) length: u64,
    pub(super) byte_order: ByteOrder,
    is_big: bool,
    first: u64,
    stream: BufReader<File>,
    /// Position of `stream`; `None` after an error.
    here: Option<u64>,
    /// Bytes of all directories read so far.
    spent: u64,
    /// Bytes of values that were read one by one.
    values: u64,
    windows: [Window; 2],
}

/// Buffer of a file in bytes: a directory with some of its values.
const BUFFER: usize = 8192;

impl Tiff {
    /// Opens a file and reads its header.
    pub(super) fn open(path: &Path) -> Result<Self, VolumeError> {
        let file = stream::open(path)?;
        let length = file.metadata().map_err(|source| stream::failed(path, source))?.len();
        let mut tiff = Self {
            path: path.to_owned(),
            length,
            byte_order: ByteOrder::Little,
            is_big: false,
            first: 0,
            stream: BufReader::with_capacity(BUFFER, file),
            here: Some(0),
            spent: 0,
            values: 0,
            windows: Default::default(),
        };
        let mut header = [0; 16];
        let there = usize::try_from(length).unwrap_or(16).min(16);
        tiff.read(0, &mut header[..there])?;
        if !recognises(&header) || there < 8 {
            let problem = format!("the first {there} bytes are no TIFF header");
            return Err(tiff.wrong("header", problem));
        }
        if header[0] == b'M' {
            tiff.byte_order = ByteOrder::Big;
        }
        tiff.is_big = tiff.number(&header[2..4]) == 43;
        let offset_bytes = tiff.number(&header[4..6]);
        if tiff.is_big && offset_bytes != 8 {
            let problem = format!("offsets of {offset_bytes} bytes; a BigTIFF file has offsets of 8 bytes");
            return Err(tiff.wrong("header", problem));
        }
        tiff.first = if tiff.is_big { tiff.number(&header[8..16]) } else { tiff.number(&header[4..8]) };
        Ok(tiff)
    }

    pub(super) fn wrong(&self, place: impl fmt::Display, problem: String) -> VolumeError {
        VolumeError::Field { path: self.path.clone(), place: place.to_string(), problem }
    }

    /// The whole number in `bytes`, at most 8.
    pub(super) fn number(&self, bytes: &[u8]) -> u64 {
        let add = |number: u64, byte: &u8| number << 8 | u64::from(*byte);
        match self.byte_order {
            ByteOrder::Big => bytes.iter().fold(0, add),
            ByteOrder::Little => bytes.iter().rev().fold(0, add),
        }
    }

    /// Fills `bytes` from offset `at` on; fewer bytes are an error of kind `UnexpectedEof`.
    pub(super) fn fill(&mut self, at: u64, bytes: &mut [u8]) -> io::Result<()> {
        // A step within the buffer keeps it.
        let step = self.here.take().and_then(|here| i64::try_from(i128::from(at) - i128::from(here)).ok());
        match step {
            Some(step) => self.stream.seek_relative(step)?,
            None => drop(self.stream.seek(SeekFrom::Start(at))?),
        }
        self.stream.read_exact(bytes)?;
        self.here = at.checked_add(stream::count(bytes.len()));
        Ok(())
    }

    /// Fills `bytes` from offset `at` on, which the caller has compared with the length of the file.
    fn read(&mut self, at: u64, bytes: &mut [u8]) -> Result<(), VolumeError> {
        self.fill(at, bytes).map_err(|source| stream::failed(&self.path, source))
    }

    /// The directories of the file, in order. `each` receives one after another.
    pub(super) fn directories(
        &mut self,
        mut each: impl FnMut(&mut Self, Directory) -> Result<(), VolumeError>,
    ) -> Result<(), VolumeError> {
        let (mut next, mut seen) = (self.first, HashSet::new());
        while next != 0 {
            let page = seen.len() + 1;
            if !seen.insert(next) {
                return Err(self.wrong(
                    format!("page {page}"),
                    format!("its directory at byte {next} is that of an earlier page"),
                ));
            }
            if page > MOST_PAGES {
                return Err(self.wrong(format!("page {page}"), format!("more than {MOST_PAGES} pages")));
            }
            let directory = self.directory(next, page)?;
            next = directory.next;
            each(self, directory)?;
        }
        if seen.is_empty() { Err(self.wrong("header", "the file has no page".to_owned())) } else { Ok(()) }
    }

    /// The directory at byte `at`, which belongs to `page`.
    pub(super) fn directory(&mut self, at: u64, page: usize) -> Result<Directory, VolumeError> {
        let (count_bytes, entry_bytes) = if self.is_big { (8, 20) } else { (2, 12) };
        let length = self.length;
        let cut = |this: &Self, end: u64| {
            let problem =
                format!("its directory at byte {at} ends at byte {end}, but the file has only {length} bytes");
            this.wrong(format!("page {page}"), problem)
        };
        let begin = at.saturating_add(count_bytes);
        if begin > length {
            return Err(cut(self, begin));
        }
        let mut word = [0; 8];
        let word = &mut word[..if self.is_big { 8 } else { 2 }];
        self.read(at, word)?;
        let count = self.number(word);
        let offset_bytes = if self.is_big { 8 } else { 4 };
        // Some writers omit the offset behind the last directory.
        let end = count.saturating_mul(entry_bytes).saturating_add(begin);
        if end > length || count > u64::from(u16::MAX) {
            return Err(cut(self, end));
        }
        // Directories that overlap would take more time than the file is long.
        self.spent = self.spent.saturating_add(end - at);
        if self.spent > length {
            let problem = format!("the directories up to here have {} bytes, but the file only {length}", self.spent);
            return Err(self.wrong(format!("page {page}"), problem));
        }
        let mut directory = Directory { page, entries: Vec::new(), next: 0 };
        let mut fields = vec![0; usize::try_from(end - begin).unwrap_or(0)];
        self.read(begin, &mut fields)?;
        let size = usize::try_from(entry_bytes).unwrap_or(12);
        for (field, place) in fields.chunks_exact(size).zip((begin..).step_by(size)) {
            let (tag, kind) = (self.number(&field[..2]), self.number(&field[2..4]));
            let (count, value) = field[4..].split_at(offset_bytes);
            let (tag, kind) = (u16::try_from(tag).unwrap_or(0), u16::try_from(kind).unwrap_or(0));
            let mut entry = Entry { at: 0, count: self.number(count), kind };
            let is_inside = entry.count.saturating_mul(entry.size()) <= stream::count(value.len());
            entry.at = if is_inside { place + 4 + stream::count(offset_bytes) } else { self.number(value) };
            directory.entries.push((tag, entry));
        }
        if end.saturating_add(stream::count(offset_bytes)) <= length {
            let mut word = [0; 8];
            self.read(end, &mut word[..offset_bytes])?;
            directory.next = self.number(&word[..offset_bytes]);
        }
        Ok(directory)
    }

    /// Bytes of the values of `entry`, at most 64 MiB; `place` is for errors.
    pub(super) fn bytes(&mut self, entry: Entry, place: &str) -> Result<Vec<u8>, VolumeError> {
        let size = self.inside(entry, place)?;
        let mut bytes = vec![
            0;
            usize::try_from(size).ok().filter(|_| size <= LONGEST).ok_or_else(|| {
                self.wrong(place, format!("{size} bytes of values; Relume reads at most {LONGEST}"))
            })?
        ];
        self.read(entry.at, &mut bytes)?;
        Ok(bytes)
    }

    /// Counts values that are read one by one, because many pages may share them.
    pub(super) fn spend(&mut self, entry: Entry, place: impl fmt::Display + Copy) -> Result<(), VolumeError> {
        self.values = self.values.saturating_add(self.inside(entry, place)?);
        // A page may have one array for two of its tags.
        if self.values <= self.length.saturating_mul(2) {
            return Ok(());
        }
        let problem = format!("the values up to here have {} bytes, but the file only {}", self.values, self.length);
        Err(self.wrong(place, problem))
    }

    /// Refuses values that are not in the file; returns their size in bytes.
    pub(super) fn inside(&self, entry: Entry, place: impl fmt::Display) -> Result<u64, VolumeError> {
        let size = entry.count.saturating_mul(entry.size());
        let end = entry.at.saturating_add(size);
        if end <= self.length {
            return Ok(size);
        }
        let problem = format!("{} values end at byte {end}, but the file has only {} bytes", entry.count, self.length);
        Err(self.wrong(place, problem))
    }

    /// Value `index` of `entry` as a whole number; `None` past the end and for numbers of another type.
    pub(super) fn whole(
        &mut self,
        entry: Entry,
        index: u64,
        place: impl fmt::Display,
    ) -> Result<Option<u64>, VolumeError> {
        let Some(one) = entry.one(index) else { return Ok(None) };
        let size = self.inside(one, place)?;
        let mut bytes = [0; 8];
        let bytes = &mut bytes[..usize::try_from(size).unwrap_or(8)];
        self.read(one.at, bytes)?;
        Ok(Some(self.number(bytes)))
    }

    /// Whether [`Self::next_whole`] has the values of `entry` in `window`, or so near to what was read last that they cost no
    /// further access of the file.
    pub(super) fn is_near(&self, window: usize, entry: Entry) -> bool {
        let Window { at, bytes } = &self.windows[window];
        let size = entry.count.saturating_mul(entry.size());
        let end = entry.at.checked_sub(*at).map(|first| first.saturating_add(size));
        end.is_some_and(|end| end <= stream::count(bytes.len()))
            || self.here.is_some_and(|here| entry.at.abs_diff(here) < stream::count(BUFFER) / 2)
    }

    /// [`Self::whole`] for the values of two tags that are asked for in turn: window 0 or 1 keeps those that follow, so that
    /// the file is not read at two places for each.
    pub(super) fn next_whole(
        &mut self,
        window: usize,
        entry: Entry,
        index: u64,
        place: impl fmt::Display,
    ) -> Result<Option<u64>, VolumeError> {
        let Some(one) = entry.one(index) else { return Ok(None) };
        let size = usize::try_from(self.inside(one, place)?).unwrap_or(8);
        let Window { at, bytes } = &self.windows[window];
        let first = one.at.checked_sub(*at).and_then(|first| usize::try_from(first).ok());
        if let Some(bytes) = first.and_then(|first| bytes.get(first..first.checked_add(size)?)) {
            return Ok(Some(self.number(bytes)));
        }
        let end = entry.at.saturating_add(entry.count.saturating_mul(entry.size())).min(self.length);
        let mut bytes = std::mem::take(&mut self.windows[window].bytes);
        bytes.resize(usize::try_from(end - one.at).unwrap_or(WINDOW).min(WINDOW), 0);
        self.read(one.at, &mut bytes)?;
        let number = self.number(&bytes[..size]);
        self.windows[window] = Window { at: one.at, bytes };
        Ok(Some(number))
    }

    /// The first value of a fraction; `None` if it is none, or is divided by 0.
    pub(super) fn fraction(&mut self, entry: Entry, place: &str) -> Result<Option<f64>, VolumeError> {
        if entry.kind != 5 || entry.count == 0 {
            return Ok(None);
        }
        let bytes = self.bytes(Entry { count: 1, ..entry }, place)?;
        let [above, below] = [&bytes[..4], &bytes[4..8]].map(|word| u32::try_from(self.number(word)).unwrap_or(0));
        Ok((below > 0).then(|| f64::from(above) / f64::from(below)))
    }
}

/// Whether the first bytes of a file identify TIFF or `BigTIFF`. A DICOM file may have a TIFF header before its mark, for
/// readers of either format.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    beginning.get(128..132) != Some(b"DICM")
        && matches!(beginning, [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..])
}
