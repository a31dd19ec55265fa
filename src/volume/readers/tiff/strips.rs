//! Decoding of the strips and tiles of pages into voxels, in parallel.

use std::fmt;
use std::io::{self, Cursor, Read};
use std::marker::PhantomData;
use std::path::PathBuf;

use flate2::{Decompress, FlushDecompress};
use jpeg_decoder::{ColorTransform, PixelFormat};
use ruzstd::decoding::StreamingDecoder;
use weezl::BitOrder;

use super::directory::{Entry, Tiff};
use super::page::{Chunks, Coding, Compression, GROUP, Page, Predictor, Sample};
use crate::data::SLAB_BYTES;
use crate::readers::batches::{self, Decode, Kept, Part};
use crate::readers::guard::guarded;
use crate::stream::{PackBits, count, read_fully};
use crate::voxels::{float_of_half, with_type};
use crate::{ByteOrder, VolumeError, Voxel, Voxels};
use relume_base::progress::Progress;

/// Compressed bytes of a strip beyond twice its voxels that are read at most; more are a mistake.
const SLACK: usize = 1 << 20;

/// Pages that are the slices of a volume, in order of z, and the sample of each voxel that is read.
#[derive(Debug)]
pub(crate) struct Stack {
    pub(crate) paths: Vec<PathBuf>,
    pub(crate) pages: Vec<Page>,
    pub(crate) sample: usize,
}

/// Adjacent rows of strips or tiles of a page: adjacent rows of voxels.
#[derive(Clone, Copy)]
struct Band {
    /// Index of the page in the stack.
    page: usize,
    /// Index of the first row of strips or tiles.
    row: usize,
    /// Number of rows of strips or tiles: one, unless the strips are voxels as they are.
    rows: usize,
}

/// Name of a strip or tile for messages.
#[derive(Clone, Copy)]
struct Place {
    page: usize,
    is_tile: bool,
    index: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { page, is_tile, index } = self;
        write!(formatter, "page {page}, {} {index}", if *is_tile { "tile" } else { "strip" })
    }
}

impl Stack {
    /// Decodes the voxels. Floats of 16 bits become those of 32.
    ///
    /// Memory is bounded by what the lengths of the files justify: it grows as strips are decoded.
    pub(crate) fn read(&self, progress: &dyn Progress) -> Result<Voxels, VolumeError> {
        let Some(first) = self.pages.first() else { return Ok(Voxels::U8(Vec::new())) };
        match first.picture().sample {
            Sample::Half => {
                let halves = Halves(Bands(self, PhantomData));
                Ok(Voxels::F32(self.read_by(&halves, progress)?))
            }
            sample => with_type!(sample.voxel_type(), T => {
                Ok(T::into_voxels(self.read_by(&Bands::<T>(self, PhantomData), progress)?))
            }),
        }
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
            // Many small strips would take more time for their seeks than for their bytes.
            let strip = coding.row_bytes().saturating_mul(coding.chunk[1]).max(1);
            let group = if coding.is_as_it_is() { (GROUP / strip).max(1) } else { 1 };
            (0..down).step_by(group).map(move |row| {
                let rows = group.min(down - row);
                let voxels = (row..row + rows).map(|row| coding.rows(row)).sum::<usize>() * coding.picture.width;
                Part { part: Band { page, row, rows }, voxels, path }
            })
        })
    }

    fn read_by<D: Decode<Band>>(&self, decode: &D, progress: &dyn Progress) -> Result<Vec<D::Voxel>, VolumeError> {
        self.check_lengths()?;
        let all = self.pages.iter().map(|page| page.picture().width * page.picture().height).sum();
        let every = |is: fn(&Coding) -> bool| self.pages.iter().all(|page| is(&page.coding));
        let kept = match self.paths.len() {
            1 if every(Coding::is_as_it_is) => Kept::AsTheyAre,
            _ if every(|coding| coding.compression == Compression::None) => Kept::Plain,
            _ => Kept::Packed,
        };
        batches::read(decode, self.bands(), all, kept, progress)
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

/// The rows of strips and tiles with floats of 16 bits, decoded as those of 32.
struct Halves<'a>(Bands<'a, u16>);

impl<'a> Decode<Band> for Halves<'a> {
    type Voxel = f32;
    type Scratch = (Worker<'a, u16>, Vec<u16>);

    fn scratch(&self) -> Self::Scratch {
        (self.0.scratch(), Vec::new())
    }

    fn decode(&self, (worker, halves): &mut Self::Scratch, band: &Band, out: &mut [f32]) -> Result<(), VolumeError> {
        halves.resize(out.len(), 0);
        worker.band(*band, halves)?;
        out.iter_mut().zip(&*halves).for_each(|(voxel, &bits)| *voxel = float_of_half(bits));
        Ok(())
    }

    fn prove(&self, band: &Band) -> Result<(), VolumeError> {
        self.0.prove(band)
    }
}

/// A strip or a tile.
struct Chunk {
    place: Place,
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
    /// State of inflating, which takes longer to make than a small strip to inflate.
    inflate: Decompress,
}

impl<'a, T: Voxel> Worker<'a, T> {
    fn new(stack: &'a Stack) -> Self {
        Self {
            stack,
            open: None,
            tables: None,
            packed: Vec::new(),
            numbers: Vec::new(),
            row: Vec::new(),
            inflate: Decompress::new(true),
        }
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
        let chunk = self.chunk(band.page, band.row, 0)?;
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
        if coding.is_as_it_is() {
            self.read(band, bytemuck::cast_slice_mut(out))?;
            if swaps && size_of::<T>() > 1 {
                out.iter_mut().for_each(|number| *number = number.with_bytes_swapped());
            }
            return Ok(());
        }
        let [across, _] = coding.chunks();
        for column in 0..across {
            let chunk = self.chunk(band.page, band.row, column)?;
            if coding.is_direct() {
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

    /// Reads the strips of `band`, which are voxels as they are: those that follow each other in the file, together.
    fn read(&mut self, band: Band, mut out: &mut [u8]) -> Result<(), VolumeError> {
        let page = &self.stack.pages[band.page];
        let mut strips = (band.row..band.row + band.rows).peekable();
        while let Some(row) = strips.next() {
            let first = self.chunk(band.page, row, 0)?;
            let mut length = first.wanted;
            while let Some(&row) = strips.peek() {
                let next = self.chunk(band.page, row, 0)?;
                if next.at != first.at.saturating_add(count(length)) {
                    break;
                }
                length += next.wanted;
                strips.next();
            }
            let part;
            (part, out) = out.split_at_mut(length);
            let stack = self.stack;
            match self.file(page.file)?.fill(first.at, part) {
                Ok(()) => {}
                Err(error) if is_end(&error) => self.is_whole(page, &first, 0)?,
                Err(source) => return Err(VolumeError::Read { path: stack.paths[page.file].clone(), source }),
            }
        }
        Ok(())
    }

    /// The strip or tile `column` of the row `row` of strips or tiles of a page.
    fn chunk(&mut self, page: usize, row: usize, column: usize) -> Result<Chunk, VolumeError> {
        let page = &self.stack.pages[page];
        let coding = &*page.coding;
        let [across, down] = coding.chunks();
        let plane = if coding.is_planar { self.stack.sample } else { 0 };
        let index = (plane * down + row) * across + column;
        let place = Place { page: page.number, is_tile: coding.is_tiled, index };
        let size = [coding.chunk[0], coding.stored_rows(row)];
        let wanted = coding.row_bytes() * coding.rows(row);
        let tiff = self.file(page.file)?;
        let (at, bytes) = match page.chunks {
            Chunks::Whole(at) => (at, None),
            Chunks::Listed { offsets, bytes } => {
                let index = count(index);
                let at = tiff.next_whole(0, offsets, index, place)?;
                let bytes = bytes.map(|bytes| tiff.next_whole(1, bytes, index, place)).transpose()?.flatten();
                (at.ok_or_else(|| tiff.wrong(place, "its offset is no whole number".to_owned()))?, bytes)
            }
        };
        let plain = coding.compression == Compression::None;
        let needed = if plain { count(wanted) } else { bytes.unwrap_or(0) };
        let end = at.saturating_add(needed);
        if end > tiff.length {
            let problem = format!("it ends at byte {end}, but the file has only {} bytes", tiff.length);
            return Err(tiff.wrong(place, problem));
        }
        let stated = bytes.unwrap_or(needed);
        if stated.saturating_mul(coding.compression.packing()) < count(wanted) {
            let problem =
                format!("{stated} bytes ({}) cannot hold the {wanted} bytes of its voxels", coding.compression.name());
            return Err(tiff.wrong(place, problem));
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
        let inflate = &mut self.inflate;
        let decoded = guarded(|| {
            let mut stream = decoder(coding, chunk, &packed, tables, inflate)?;
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
                place: chunk.place.to_string(),
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
        Err(VolumeError::Field { path, place: chunk.place.to_string(), problem })
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
fn decoder<'a>(
    coding: &Coding,
    chunk: &Chunk,
    packed: &'a [u8],
    tables: &[u8],
    inflate: &'a mut Decompress,
) -> io::Result<Box<dyn Read + 'a>> {
    Ok(match coding.compression {
        Compression::None => Box::new(packed),
        Compression::Deflate => {
            inflate.reset(true);
            Box::new(Inflate { inflate, packed })
        }
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

/// A zlib stream.
struct Inflate<'a> {
    inflate: &'a mut Decompress,
    packed: &'a [u8],
}

impl Read for Inflate<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let before = [self.inflate.total_in(), self.inflate.total_out()];
        let status = self.inflate.decompress(self.packed, bytes, FlushDecompress::Finish);
        let passed = |now: u64, before: u64| usize::try_from(now - before).unwrap_or(usize::MAX);
        self.packed = &self.packed[passed(self.inflate.total_in(), before[0])..];
        // Without an end, the stream is short, which its length tells.
        status.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error.to_string()))?;
        Ok(passed(self.inflate.total_out(), before[1]))
    }
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
pub(crate) fn unpack_bits(packed: &[u8], bits: u8, (sample, interleaved): (usize, usize), line: &mut [u8]) {
    let per_byte = usize::from(8 / bits);
    for (voxel, place) in line.iter_mut().zip((sample..).step_by(interleaved)) {
        let shift = 8 - usize::from(bits) * (place % per_byte + 1);
        *voxel = packed[place / per_byte] >> shift & (u8::MAX >> (8 - bits));
    }
}
