//! Decoding of the strips and tiles of pages into voxels, in parallel.

use std::io::{self, Cursor, Read};
use std::marker::PhantomData;
use std::path::PathBuf;

use flate2::bufread::ZlibDecoder;
use jpeg_decoder::{ColorTransform, PixelFormat};
use ruzstd::decoding::StreamingDecoder;
use weezl::BitOrder;

use super::directory::{Entry, Tiff};
use super::page::{Chunks, Coding, Compression, Page, Predictor, Sample};
use crate::progress::Progress;
use crate::volume::batches::{self, Decode, Part};
use crate::volume::data::SLAB_BYTES;
use crate::volume::guard::guarded;
use crate::volume::stream::{PackBits, count, read_fully};
use crate::volume::voxels::{floats_of_halves, with_type};
use crate::volume::{ByteOrder, VolumeError, Voxel, Voxels};

/// Compressed bytes of a strip beyond twice its voxels that are read at most; more are a mistake.
const SLACK: usize = 1 << 20;

/// Pages that are the slices of a volume, in order of z, and the sample of each voxel that is read.
#[derive(Debug)]
pub(in crate::volume) struct Stack {
    pub(in crate::volume) paths: Vec<PathBuf>,
    pub(in crate::volume) pages: Vec<Page>,
    pub(in crate::volume) sample: usize,
}

/// A row of strips or tiles of a page: adjacent rows of voxels.
#[derive(Clone, Copy)]
struct Band {
    /// Index of the page in the stack.
    page: usize,
    /// Index of the row of strips or tiles.
    row: usize,
}

impl Stack {
    /// Decodes the voxels of the file or folder `source_name`. Floats of 16 bits become those of 32.
    ///
    /// Memory is bounded by what the lengths of the files justify: it grows as strips are decoded.
    pub(in crate::volume) fn read(&self, source_name: &str, progress: &dyn Progress) -> Result<Voxels, VolumeError> {
        let Some(first) = self.pages.first() else { return Ok(Voxels::U8(Vec::new())) };
        let sample = first.picture().sample;
        let voxels = with_type!(sample.voxel_type(), T => T::into_voxels(self.read_as::<T>(progress)?));
        if sample == Sample::Half { floats_of_halves(voxels, source_name) } else { Ok(voxels) }
    }

    /// Refuses pages of more bytes than their files can hold.
    fn check_lengths(&self) -> Result<(), VolumeError> {
        let mut pages = self.pages.iter().peekable();
        while let Some(first) = pages.next() {
            let path = &self.paths[first.file];
            let length =
                std::fs::metadata(path).map_err(|source| VolumeError::Open { path: path.clone(), source })?.len();
            let mut expected = first.coding.bytes();
            let mut compression = first.coding.compression;
            while let Some(page) = pages.next_if(|page| page.file == first.file) {
                expected = expected.saturating_add(page.coding.bytes());
                if page.coding.compression.packing() > compression.packing() {
                    compression = page.coding.compression;
                }
            }
            let (path, limit) = (path.clone(), compression.packing());
            if compression == Compression::None && expected > length {
                return Err(VolumeError::Short { path, found: length, expected });
            }
            if expected > length.saturating_mul(limit) {
                let encoding = compression.name();
                return Err(VolumeError::Incredible { path, compressed: length, expected, encoding, limit });
            }
        }
        Ok(())
    }

    fn bands(&self) -> impl Iterator<Item = Part<'_, Band>> {
        self.pages.iter().enumerate().flat_map(|(page, it)| {
            let (coding, path) = (&*it.coding, self.paths[it.file].as_path());
            let [_, down] = coding.chunks();
            (0..down).map(move |row| {
                let voxels = coding.rows(row) * coding.picture.width;
                Part { part: Band { page, row }, voxels, path }
            })
        })
    }

    fn read_as<T: Voxel>(&self, progress: &dyn Progress) -> Result<Vec<T>, VolumeError> {
        self.check_lengths()?;
        let all = self.pages.iter().map(|page| page.picture().width * page.picture().height).sum();
        let is_plain = self.pages.iter().all(|page| page.coding.compression == Compression::None);
        batches::read(&Bands::<T>(self, PhantomData), self.bands(), all, is_plain, progress)
    }
}

/// The rows of strips and tiles, decoded as voxels of type `T`.
struct Bands<'a, T>(&'a Stack, PhantomData<fn() -> T>);

impl<'a, T: Voxel> Decode<Band> for Bands<'a, T> {
    type Voxel = T;
    type Scratch = Worker<'a, T>;

    fn scratch(&self) -> Worker<'a, T> {
        Worker::new(self.0)
    }

    fn decode(&self, worker: &mut Worker<'a, T>, band: &Band, out: &mut [T]) -> Result<(), VolumeError> {
        worker.band(*band, out)
    }

    fn prove(&self, band: &Band) -> Result<(), VolumeError> {
        self.scratch().prove(*band)
    }
}

/// A strip or a tile.
struct Chunk {
    /// Name for messages.
    place: String,
    at: u64,
    /// Compressed bytes, if the file states them.
    bytes: Option<u64>,
    /// Size in voxels as stored.
    size: [usize; 2],
    /// Stored bytes that are needed.
    wanted: usize,
}

/// Decoder of one thread.
struct Worker<'a, T> {
    stack: &'a Stack,
    /// The file that was read last, with its index.
    open: Option<(usize, Tiff)>,
    /// The JPEG tables that were read last, with the index of their file and their place in it.
    tables: Option<(usize, Entry, Vec<u8>)>,
    packed: Vec<u8>,
    numbers: Vec<T>,
    row: Vec<u8>,
}

impl<'a, T: Voxel> Worker<'a, T> {
    fn new(stack: &'a Stack) -> Self {
        Self { stack, open: None, tables: None, packed: Vec::new(), numbers: Vec::new(), row: Vec::new() }
    }

    fn file(&mut self, file: usize) -> Result<&mut Tiff, VolumeError> {
        if self.open.as_ref().is_none_or(|(index, _)| *index != file) {
            self.open = None;
        }
        match &mut self.open {
            Some((_, tiff)) => Ok(tiff),
            none => Ok(&mut none.insert((file, Tiff::open(&self.stack.paths[file])?)).1),
        }
    }

    /// Decodes the first strip or tile of `band` without keeping it, so that a header alone allocates nothing.
    fn prove(&mut self, band: Band) -> Result<(), VolumeError> {
        let chunk = self.chunk(band, 0)?;
        let page = &self.stack.pages[band.page];
        let mut sink = vec![0; SLAB_BYTES.min(chunk.wanted)];
        self.unpack(page, &chunk, |stream| {
            let mut left = chunk.wanted;
            while left > 0 {
                let part = left.min(sink.len());
                let got = read_fully(stream, &mut sink[..part])?;
                left -= got;
                if got < part {
                    break;
                }
            }
            Ok(chunk.wanted - left)
        })
    }

    /// Decodes the voxels of `band`.
    fn band(&mut self, band: Band, out: &mut [T]) -> Result<(), VolumeError> {
        let page = &self.stack.pages[band.page];
        let coding = &*page.coding;
        let swaps = self.file(page.file)?.byte_order != ByteOrder::NATIVE && coding.compression != Compression::Jpeg;
        let [across, _] = coding.chunks();
        for column in 0..across {
            let chunk = self.chunk(band, column)?;
            if is_direct(coding) {
                let wanted = chunk.wanted;
                self.unpack(page, &chunk, |stream| read_fully(stream, &mut bytemuck::cast_slice_mut(out)[..wanted]))?;
                for row in out.chunks_mut(coding.picture.width) {
                    restore(row, coding, swaps, &mut Vec::new());
                }
            } else {
                let mut numbers = std::mem::take(&mut self.numbers);
                self.unpack(page, &chunk, |stream| grow(stream, &mut numbers, chunk.wanted))?;
                self.place(coding, column, swaps, &mut numbers, out);
                self.numbers = numbers;
            }
        }
        Ok(())
    }

    /// The strip or tile `column` of `band`.
    fn chunk(&mut self, band: Band, column: usize) -> Result<Chunk, VolumeError> {
        let page = &self.stack.pages[band.page];
        let coding = &*page.coding;
        let [across, down] = coding.chunks();
        let plane = if coding.is_planar { self.stack.sample } else { 0 };
        let index = (plane * down + band.row) * across + column;
        let what = if coding.is_tiled { "tile" } else { "strip" };
        let place = format!("page {}, {what} {index}", page.number);
        let size = [coding.chunk[0], coding.stored_rows(band.row)];
        let wanted = coding.row_bytes() * coding.rows(band.row);
        let tiff = self.file(page.file)?;
        let (at, bytes) = match page.chunks {
            Chunks::Whole(at) => (at, None),
            Chunks::Listed { offsets, bytes } => {
                let index = count(index);
                let at = tiff.next_whole(0, offsets, index, &place)?;
                let bytes = bytes.map(|bytes| tiff.next_whole(1, bytes, index, &place)).transpose()?.flatten();
                (at.ok_or_else(|| tiff.wrong(&place, "its offset is no whole number".to_owned()))?, bytes)
            }
        };
        let plain = coding.compression == Compression::None;
        let needed = if plain { count(wanted) } else { bytes.unwrap_or(0) };
        let end = at.saturating_add(needed);
        if end > tiff.length {
            let problem = format!("it ends at byte {end}, but the file has only {} bytes", tiff.length);
            return Err(tiff.wrong(&place, problem));
        }
        let stated = bytes.unwrap_or(needed);
        if stated.saturating_mul(coding.compression.packing()) < count(wanted) {
            let problem =
                format!("{stated} bytes ({}) cannot hold the {wanted} bytes of its voxels", coding.compression.name());
            return Err(tiff.wrong(&place, problem));
        }
        Ok(Chunk { place, at, bytes, size, wanted })
    }

    /// Decompresses `chunk`; `take` consumes the bytes and returns their number, which should be that wanted.
    fn unpack(
        &mut self,
        page: &Page,
        chunk: &Chunk,
        take: impl FnOnce(&mut dyn Read) -> io::Result<usize>,
    ) -> Result<(), VolumeError> {
        let coding = &*page.coding;
        let mut packed = std::mem::take(&mut self.packed);
        let stack = self.stack;
        let failed = |source| VolumeError::Read { path: stack.paths[page.file].clone(), source };
        let tiff = self.file(page.file)?;
        if coding.compression == Compression::None {
            let mut from = At { at: chunk.at, tiff };
            let got = take(&mut from).map_err(failed)?;
            self.packed = packed;
            return self.is_whole(page, chunk, got);
        }
        let stated = usize::try_from(chunk.bytes.unwrap_or(0)).unwrap_or(usize::MAX);
        packed.resize(stated.min(chunk.wanted.saturating_mul(2).saturating_add(SLACK)), 0);
        tiff.fill(chunk.at, &mut packed).map_err(failed)?;
        let wanted = page.tables.filter(|_| coding.compression == Compression::Jpeg);
        let is_read =
            |entry: Entry| matches!(&self.tables, Some((file, known, _)) if (*file, *known) == (page.file, entry));
        if let Some(entry) = wanted.filter(|&entry| !is_read(entry)) {
            let bytes = self.file(page.file)?.bytes(entry, &format!("page {}, JPEGTables", page.number))?;
            self.tables = Some((page.file, entry, bytes));
        }
        let tables: &[u8] = match &self.tables {
            Some((.., tables)) if wanted.is_some() => tables,
            _ => &[],
        };
        let decoded = guarded(|| {
            let mut stream = decoder(coding, chunk, &packed, tables)?;
            let got = take(&mut *stream)?;
            // The end of a stream has its checksum.
            match stream.read(&mut [0]) {
                Err(error) if coding.compression == Compression::Deflate && !is_end(&error) => Err(error),
                _ => Ok(got),
            }
        });
        self.packed = packed;
        match decoded {
            Ok(got) => self.is_whole(page, chunk, got),
            Err(source) => Err(VolumeError::DamagedPart {
                path: stack.paths[page.file].clone(),
                place: chunk.place.clone(),
                encoding: coding.compression.name(),
                source,
            }),
        }
    }

    /// Refuses a strip or tile that has fewer than the wanted bytes.
    fn is_whole(&self, page: &Page, chunk: &Chunk, got: usize) -> Result<(), VolumeError> {
        if got == chunk.wanted {
            return Ok(());
        }
        let problem = format!("{got} bytes of voxels, but its size and type require {}", chunk.wanted);
        let path = self.stack.paths[page.file].clone();
        Err(VolumeError::Field { path, place: chunk.place.clone(), problem })
    }

    /// Copies the chosen sample of the rows in `numbers` to column `column` of strips or tiles in `out`.
    fn place(&mut self, coding: &Coding, column: usize, swaps: bool, numbers: &mut [T], out: &mut [T]) {
        let (interleaved, width) = (coding.interleaved(), coding.picture.width);
        let sample = if coding.is_planar { 0 } else { self.stack.sample };
        let left = column * coding.chunk[0];
        let across = coding.chunk[0].min(width - left);
        let row_numbers = coding.row_bytes() / size_of::<T>();
        let rows = numbers.chunks_exact_mut(row_numbers.max(1));
        for (stored, line) in rows.zip(out.chunks_mut(width)) {
            let line = &mut line[left..left + across];
            if let Sample::Bits(bits) = coding.picture.sample {
                unpack_bits(bytemuck::cast_slice(stored), bits, (sample, interleaved), bytemuck::cast_slice_mut(line));
                continue;
            }
            restore(stored, coding, swaps, &mut self.row);
            if interleaved == 1 {
                line.copy_from_slice(&stored[..across]);
            } else {
                let picked = stored.iter().skip(sample).step_by(interleaved);
                line.iter_mut().zip(picked).for_each(|(voxel, &number)| *voxel = number);
            }
        }
    }
}

/// Whether the decoded bytes of a strip or tile are voxels in their place, apart from byte order and predictor.
fn is_direct(coding: &Coding) -> bool {
    coding.interleaved() == 1
        && coding.chunk[0] == coding.picture.width
        && coding.predictor != Predictor::Float
        && !matches!(coding.picture.sample, Sample::Bits(_))
}

/// Bytes of a file from an offset on.
struct At<'a> {
    at: u64,
    tiff: &'a mut Tiff,
}

impl Read for At<'_> {
    /// Reads all of `bytes`, or nothing past the end.
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self.tiff.fill(self.at, bytes) {
            Ok(()) => {
                self.at += count(bytes.len());
                Ok(bytes.len())
            }
            Err(error) if is_end(&error) => Ok(0),
            Err(error) => Err(error),
        }
    }
}

fn is_end(error: &io::Error) -> bool {
    error.kind() == io::ErrorKind::UnexpectedEof
}

/// Reads `wanted` bytes into `numbers`, which grows as they come. Returns the number of bytes read.
fn grow<T: Voxel>(stream: &mut dyn Read, numbers: &mut Vec<T>, wanted: usize) -> io::Result<usize> {
    let all = wanted / size_of::<T>();
    let mut there = 0;
    while there < all {
        let next = all.min((2 * there).max(SLAB_BYTES / size_of::<T>()));
        numbers.resize(next.max(numbers.len().min(all)), T::zeroed());
        let part = bytemuck::cast_slice_mut(&mut numbers[there..next]);
        let got = read_fully(stream, part)?;
        if got < part.len() {
            return Ok(there * size_of::<T>() + got);
        }
        there = next;
    }
    numbers.truncate(all);
    Ok(wanted)
}

/// Stream of the decompressed bytes of a strip or tile.
fn decoder<'a>(coding: &Coding, chunk: &Chunk, packed: &'a [u8], tables: &[u8]) -> io::Result<Box<dyn Read + 'a>> {
    Ok(match coding.compression {
        Compression::None => Box::new(packed),
        Compression::Deflate => Box::new(ZlibDecoder::new(packed)),
        Compression::Lzw => {
            let decoder = weezl::decode::Configuration::with_tiff_size_switch(BitOrder::Msb, 8)
                .with_yield_on_full_buffer(true)
                .build();
            Box::new(Lzw { decoder, packed })
        }
        Compression::PackBits => Box::new(PackBits::new(packed)),
        Compression::Zstd => Box::new(StreamingDecoder::new(packed).map_err(io::Error::other)?),
        Compression::Jpeg => Box::new(Cursor::new(jpeg(coding, chunk, packed, tables)?)),
    })
}

/// Voxels of a JPEG stream, whose `tables` may be separate.
fn jpeg(coding: &Coding, chunk: &Chunk, packed: &[u8], tables: &[u8]) -> io::Result<Vec<u8>> {
    // The tables are a stream without a picture: its end mark and the begin mark of the picture are omitted.
    let (tables, picture) = if tables.len() > 4 && packed.len() > 2 {
        (&tables[..tables.len() - 2], &packed[2..])
    } else {
        (&tables[..0], packed)
    };
    let mut decoder = jpeg_decoder::Decoder::new(Read::chain(tables, picture));
    let samples = coding.interleaved();
    // Without a transform, the crate puts the samples of a row one behind the other.
    decoder.set_color_transform(match (coding.picture.photometric, samples) {
        (_, 1) => ColorTransform::None,
        (6, 3) => ColorTransform::YCbCr,
        (_, 3) => ColorTransform::RGB,
        _ => ColorTransform::CMYK,
    });
    decoder.read_info().map_err(io::Error::other)?;
    let info = decoder.info().ok_or_else(|| io::Error::other("it has no picture"))?;
    let found = [usize::from(info.width), usize::from(info.height)];
    let found_samples = match info.pixel_format {
        PixelFormat::L8 => 1,
        PixelFormat::RGB24 => 3,
        PixelFormat::CMYK32 => 4,
        PixelFormat::L16 => return Err(io::Error::other("it has more than 8 bits per sample")),
    };
    let [width, height] = chunk.size;
    let least = chunk.wanted / coding.row_bytes();
    if found[0] != width || !(least..=height.max(coding.chunk[1])).contains(&found[1]) || found_samples != samples {
        let [x, y] = found;
        return Err(io::Error::other(format!(
            "its picture has {x}×{y} pixels of {found_samples} samples instead of {width}×{height} of {samples}"
        )));
    }
    decoder.set_max_decoding_buffer_size(found[0] * found[1] * samples);
    let mut numbers = decoder.decode().map_err(io::Error::other)?;
    if samples == 4 {
        // The crate's transform inverts.
        numbers.iter_mut().for_each(|number| *number = u8::MAX - *number);
    }
    Ok(numbers)
}

/// LZW with codes from the highest bit on.
struct Lzw<'a> {
    decoder: weezl::decode::Decoder,
    packed: &'a [u8],
}

impl Read for Lzw<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        loop {
            let step = self.decoder.decode_bytes(self.packed, bytes);
            self.packed = &self.packed[step.consumed_in..];
            let status = step.status.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.to_string()))?;
            let is_over = matches!(status, weezl::LzwStatus::Done | weezl::LzwStatus::NoProgress);
            if step.consumed_out > 0 || is_over || step.consumed_in == 0 {
                return Ok(step.consumed_out);
            }
        }
    }
}

/// Turns a row as stored into numbers of this machine; `scratch` is memory for it.
fn restore<T: Voxel>(row: &mut [T], coding: &Coding, swaps: bool, scratch: &mut Vec<u8>) {
    let step = coding.interleaved();
    if coding.predictor == Predictor::Float {
        let size = size_of::<T>();
        let numbers = row.len();
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(row);
        accumulate(bytes, step, u8::wrapping_add);
        scratch.clear();
        scratch.extend_from_slice(bytes);
        for (index, number) in bytes.chunks_exact_mut(size).enumerate() {
            // The most significant bytes come first.
            for (significance, byte) in number.iter_mut().enumerate() {
                let plane = if ByteOrder::NATIVE == ByteOrder::Big { significance } else { size - 1 - significance };
                *byte = scratch[plane * numbers + index];
            }
        }
        return;
    }
    if swaps && size_of::<T>() > 1 {
        row.iter_mut().for_each(|number| *number = number.with_bytes_swapped());
    }
    if coding.predictor == Predictor::Horizontal {
        // Also floats are added as whole numbers.
        match size_of::<T>() {
            1 => accumulate::<u8>(bytemuck::cast_slice_mut(row), step, u8::wrapping_add),
            2 => accumulate::<u16>(bytemuck::cast_slice_mut(row), step, u16::wrapping_add),
            4 => accumulate::<u32>(bytemuck::cast_slice_mut(row), step, u32::wrapping_add),
            _ => accumulate::<u64>(bytemuck::cast_slice_mut(row), step, u64::wrapping_add),
        }
    }
}

/// Adds to each number the one `step` before it.
fn accumulate<U: Copy>(row: &mut [U], step: usize, add: impl Fn(U, U) -> U) {
    if step == 1 {
        let Some((&mut first, rest)) = row.split_first_mut() else { return };
        let mut before = first;
        for number in rest {
            before = add(*number, before);
            *number = before;
        }
        return;
    }
    for index in step..row.len() {
        row[index] = add(row[index], row[index - step]);
    }
}

/// Unpacks one sample of every voxel from numbers of `bits` bits, the first one in the highest bits.
pub(in crate::volume) fn unpack_bits(packed: &[u8], bits: u8, (sample, interleaved): (usize, usize), line: &mut [u8]) {
    let per_byte = usize::from(8 / bits);
    for (voxel, place) in line.iter_mut().zip((sample..).step_by(interleaved)) {
        let shift = 8 - usize::from(bits) * (place % per_byte + 1);
        *voxel = packed[place / per_byte] >> shift & (u8::MAX >> (8 - bits));
    }
}
