//! The pixels of slices as voxels, frame by frame in parallel.

use std::collections::HashMap;
use std::fs::File;
use std::io::{Read as _, Seek as _, SeekFrom};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use dicom_dictionary_std::tags;

use super::codec::{self, Failure, Numbers};
use super::dataset::{self, Range};
use super::frame::Layout;
use super::image::{Image, Lut};
use super::syntax::Coding;
use crate::data;
use crate::stream::{self, count, failed, read_fully};
use crate::voxels::with_type;
use crate::{ByteOrder, VolumeError, Voxel, Voxels, allocate};
use relume_base::number::whole;
use relume_base::parallel;
use relume_base::progress::Progress;

/// A frame of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Slice {
    pub(super) image: usize,
    pub(super) frame: usize,
}

/// Conversion of stored numbers to voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Values {
    /// The stored numbers themselves.
    Stored,
    /// Values, because slopes or intercepts differ.
    Scaled,
    /// Values of a table.
    Looked,
}

/// Pixels of `slices`, one slice after another.
pub(super) struct Pixels<'a> {
    pub(super) images: &'a [Image],
    pub(super) slices: &'a [Slice],
    /// Component of a pixel.
    pub(super) component: usize,
    pub(super) values: Values,
    /// Name in messages.
    pub(super) source: &'a Path,
}

/// Data that the frames of a file share, read once.
#[derive(Default)]
pub(super) struct Shared {
    /// Fragments of each frame, of compressed images.
    fragments: HashMap<usize, Vec<Vec<Range>>>,
    /// Streams of deflated images, which can only be read from their beginning.
    streams: HashMap<usize, Mutex<Frames>>,
    /// Pixels of deflated segmentations, whose frames are read in the order of their segments.
    inflated: HashMap<usize, Buffer>,
    /// Tables of values of images with several frames.
    luts: HashMap<usize, Lut>,
}

/// Bytes of a fragment of compressed data, or of a frame.
type Buffer = Vec<u8>;

/// Frames of a deflated image.
struct Frames {
    stream: dataset::Stream,
    /// Byte of the pixel data that comes next.
    at: u64,
    /// The byte before it: two frames of bits may share one.
    last: u8,
}

impl Frames {
    /// Reads `length` bytes from byte `first` on, which is not before the last one that was read.
    fn read(&mut self, path: &Path, (first, length): (u64, u64), buffer: &mut Buffer) -> Result<(), VolumeError> {
        buffer.clear();
        let again = self.at.saturating_sub(first).min(1);
        if again == 1 {
            buffer.push(self.last);
        }
        self.stream.skip(first.saturating_sub(self.at)).map_err(|source| failed(path, source))?;
        let wanted = length - again;
        let there = (&mut self.stream).take(wanted).read_to_end(buffer).map_err(|source| failed(path, source))?;
        if count(there) < wanted {
            let (found, expected) = (first + again + count(there), first + length);
            return Err(VolumeError::Short { path: path.to_owned(), found, expected });
        }
        (self.at, self.last) = (first + length, buffer.last().copied().unwrap_or(0));
        Ok(())
    }
}

/// A stored number of a voxel type.
trait Stored: Voxel {
    /// The number whose lowest bits are `bits`.
    fn of(bits: u64) -> Self;
}

macro_rules! stored {
    ($($type:ident)*) => {$(
        impl Stored for $type {
            #[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, trivial_numeric_casts, reason = "takes the lowest bits")]
            fn of(bits: u64) -> Self {
                bits as Self
            }
        }
    )*};
}

stored!(u8 i8 u16 i16 u32 i32 u64 i64);

impl Stored for f32 {
    #[expect(clippy::cast_possible_truncation, reason = "takes the lowest bits")]
    fn of(bits: u64) -> Self {
        Self::from_bits(bits as u32)
    }
}

impl Stored for f64 {
    fn of(bits: u64) -> Self {
        Self::from_bits(bits)
    }
}

impl Pixels<'_> {
    /// Reads the voxels.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Field`] with the number of a frame that is damaged or whose coding has no decoder,
    /// [`VolumeError::Incredible`], [`VolumeError::Memory`], [`VolumeError::Cancelled`].
    pub(super) fn read(&self, progress: &dyn Progress) -> Result<Voxels, VolumeError> {
        self.read_with(&self.shared()?, progress)
    }

    /// [`Self::read`] with what the frames of a file share.
    pub(super) fn read_with(&self, shared: &Shared, progress: &dyn Progress) -> Result<Voxels, VolumeError> {
        let Some(first) = self.slices.first() else {
            return Err(VolumeError::Dims { source_name: self.name(), dims: "0".to_owned() });
        };
        let layout = &self.images[first.image].layout;
        with_type!(layout.voxel_type, T => match self.values {
            Values::Stored => self.all(shared, progress, |index, buffer, out: &mut [T]| self.slice(index, shared, buffer, out)),
            Values::Scaled => self.all(shared, progress, |index, buffer, out: &mut [f32]| {
                let mut stored = vec![T::of(0); out.len()];
                self.slice(index, shared, buffer, &mut stored)?;
                let Slice { image, frame } = self.slices[index];
                let frame = self.images[image].frame(frame);
                for (value, number) in out.iter_mut().zip(stored) {
                    *value = f32::nearest(number.to_f64().mul_add(frame.slope, frame.intercept));
                }
                Ok(())
            }),
            Values::Looked => self.all(shared, progress, |index, buffer, out: &mut [u16]| {
                let mut stored = vec![T::of(0); out.len()];
                self.slice(index, shared, buffer, &mut stored)?;
                let number = self.slices[index].image;
                let own;
                let lut = match shared.luts.get(&number) {
                    Some(lut) => lut,
                    None => {
                        own = Lut::read(&self.images[number].path, &self.images[number].layout)?;
                        &own
                    }
                };
                for (value, number) in out.iter_mut().zip(stored) {
                    let number = number.to_whole().and_then(|number| i64::try_from(number).ok()).unwrap_or(0);
                    *value = lut.value(number);
                }
                Ok(())
            }),
        })
    }

    fn name(&self) -> String {
        self.source.display().to_string()
    }

    /// The data that the frames of each file share.
    pub(super) fn shared(&self) -> Result<Shared, VolumeError> {
        let mut shared = Shared::default();
        for &Slice { image: number, .. } in self.slices {
            let image = &self.images[number];
            let is_deflated = image.syntax.coding == Coding::Deflated;
            if self.values == Values::Looked && image.count > 1 && !shared.luts.contains_key(&number) {
                shared.luts.insert(number, Lut::read(&image.path, &image.layout)?);
            }
            let is_known = shared.fragments.contains_key(&number)
                || shared.streams.contains_key(&number)
                || shared.inflated.contains_key(&number);
            if image.count == 1 || is_known {
                continue;
            }
            if image.pixels.length.is_none() {
                shared.fragments.insert(number, frames_of(image)?);
            } else if is_deflated && image.segmentation.is_empty() {
                let stream = dataset::stream_from(&image.path, &image.syntax, image.pixels.at)?;
                shared.streams.insert(number, Mutex::new(Frames { stream, at: 0, last: 0 }));
            } else if is_deflated {
                let length = image.layout.bits().saturating_mul(count(image.count)).div_ceil(8);
                let mut bytes = Buffer::new();
                plain(image, 0, length, &mut bytes)?;
                shared.inflated.insert(number, bytes);
            }
        }
        Ok(shared)
    }

    /// Fills all voxels; `fill` gets the index of a slice.
    fn all<T: Stored>(
        &self,
        shared: &Shared,
        progress: &dyn Progress,
        fill: impl Fn(usize, &mut Buffer, &mut [T]) -> Result<(), VolumeError> + Sync,
    ) -> Result<Voxels, VolumeError> {
        let first = &self.images[self.slices[0].image];
        let pixels = first.layout.pixels();
        let wanted = pixels.saturating_mul(self.slices.len());
        if self.slices.iter().any(|slice| shared.streams.contains_key(&slice.image)) {
            return self.one_by_one(pixels, progress, fill);
        }
        // The file has all bytes of plain pixels. Otherwise memory grows as frames come out.
        let is_there = |slice: &Slice| matches!(self.images[slice.image].syntax.coding, Coding::Plain);
        let is_bounded = self.slices.iter().all(is_there);
        let batch = if is_bounded { self.slices.len() } else { 4 * rayon::current_num_threads() };
        let mut voxels: Vec<T> = if is_bounded { allocate::zeroed(self.source, wanted)? } else { Vec::new() };
        let done = AtomicU64::new(0);
        let bytes = |numbers: usize| count(numbers).saturating_mul(count(size_of::<T>()));
        let mut start = 0;
        while start < self.slices.len() {
            // Memory is taken for further frames once the first one has been decoded.
            let now = if start == 0 && !is_bounded { 1 } else { batch };
            let end = (start + now).min(self.slices.len());
            if !is_bounded {
                allocate::reserve(&mut voxels, (end - start) * pixels, wanted, self.source)?;
                voxels.resize(end * pixels, T::zeroed());
            }
            let frames: Vec<Mutex<&mut [T]>> = voxels[start * pixels..].chunks_mut(pixels).map(Mutex::new).collect();
            let results = parallel::map_with(frames.len(), &Buffer::new, &|buffer, index| {
                let before = done.load(Ordering::Relaxed);
                data::report(self.source, before, bytes(wanted), progress)?;
                fill(start + index, buffer, &mut frames[index].lock().unwrap_or_else(PoisonError::into_inner))?;
                done.fetch_add(bytes(pixels), Ordering::Relaxed);
                Ok(())
            });
            results.into_iter().collect::<Result<(), VolumeError>>()?;
            start = end;
        }
        Ok(T::into_voxels(voxels))
    }

    /// Fills all voxels in the order of the file, for frames that can only be read in this order. Memory grows as they come;
    /// if they are not slices in this order, they are all read once before it is taken.
    fn one_by_one<T: Stored>(
        &self,
        pixels: usize,
        progress: &dyn Progress,
        fill: impl Fn(usize, &mut Buffer, &mut [T]) -> Result<(), VolumeError>,
    ) -> Result<Voxels, VolumeError> {
        let wanted = pixels.saturating_mul(self.slices.len());
        let mut order: Vec<usize> = (0..self.slices.len()).collect();
        order.sort_by_key(|&index| (self.slices[index].image, self.slices[index].frame));
        let mut voxels: Vec<T> = Vec::new();
        let grows = order.is_sorted();
        if !grows {
            for last in order.chunk_by(|&one, &next| self.slices[one].image == self.slices[next].image) {
                let Some(&Slice { image, frame }) = last.last().map(|&index| &self.slices[index]) else { continue };
                self.prove(&self.images[image], frame + 1, progress)?;
            }
            voxels = allocate::zeroed(self.source, wanted)?;
        }
        let (mut buffer, bytes) =
            (Buffer::new(), |numbers: usize| count(numbers).saturating_mul(count(size_of::<T>())));
        for (done, &index) in order.iter().enumerate() {
            data::report(self.source, bytes(done * pixels), bytes(wanted), progress)?;
            if grows {
                allocate::reserve(&mut voxels, pixels, wanted, self.source)?;
                voxels.resize((index + 1) * pixels, T::zeroed());
            }
            fill(index, &mut buffer, &mut voxels[index * pixels..(index + 1) * pixels])?;
        }
        Ok(T::into_voxels(voxels))
    }

    /// Inflates the first `frames` frames of an image without keeping them.
    fn prove(&self, image: &Image, frames: usize, progress: &dyn Progress) -> Result<(), VolumeError> {
        let expected = image.layout.bits().saturating_mul(count(frames)).div_ceil(8);
        let mut stream = dataset::stream_from(&image.path, &image.syntax, image.pixels.at)?;
        let (mut found, mut part) = (0, vec![0; data::SLAB_BYTES]);
        while found < expected {
            data::check_cancelled(self.source, progress)?;
            let length = usize::try_from(expected - found).unwrap_or(part.len()).min(part.len());
            let there = read_fully(&mut stream, &mut part[..length]).map_err(|source| failed(&image.path, source))?;
            found += count(there);
            if there < length {
                return Err(VolumeError::Short { path: image.path.clone(), found, expected });
            }
        }
        Ok(())
    }

    /// Decodes the slice `index` into `out`.
    fn slice<T: Stored>(
        &self,
        index: usize,
        shared: &Shared,
        buffer: &mut Buffer,
        out: &mut [T],
    ) -> Result<(), VolumeError> {
        let slice = self.slices[index];
        let image = &self.images[slice.image];
        let Some(sheet) = &image.sheet else { return self.frame(slice, &image.layout, shared, buffer, out) };
        let mut whole: Vec<T> = allocate::zeroed(self.source, sheet.layout.pixels())?;
        self.frame(Slice { frame: 0, ..slice }, &sheet.layout, shared, buffer, &mut whole)?;
        let [width, height] = [image.layout.columns, image.layout.rows];
        let (first, above) = (slice.frame % sheet.across * width, slice.frame / sheet.across * height);
        for (row, out) in out.chunks_exact_mut(width).enumerate() {
            let start = (above + row) * sheet.layout.columns + first;
            out.copy_from_slice(&whole[start..start + width]);
        }
        Ok(())
    }

    /// Decodes a frame of `layout` into `out`.
    fn frame<T: Stored>(
        &self,
        Slice { image: number, frame }: Slice,
        layout: &Layout,
        shared: &Shared,
        buffer: &mut Buffer,
        out: &mut [T],
    ) -> Result<(), VolumeError> {
        let image = &self.images[number];
        let at_frame = |problem: String| VolumeError::Field {
            path: image.path.clone(),
            place: format!("frame {}", frame + 1),
            problem,
        };
        if let Coding::Foreign(name) = image.syntax.coding {
            let uid = &image.syntax.uid;
            let problem = format!("the pixels are coded as {name} ({uid}), which Relume does not decode");
            return Err(image.wrong(tags::TRANSFER_SYNTAX_UID, problem));
        }
        if layout.photometric == "PALETTE COLOR" && image.segmentation.is_empty() {
            let problem = "Relume does not read colours of a palette".to_owned();
            return Err(image.wrong(tags::PHOTOMETRIC_INTERPRETATION, problem));
        }
        if layout.photometric.ends_with("422") && matches!(image.syntax.coding, Coding::Plain | Coding::Deflated) {
            let problem = format!("Relume does not read {} without compression", layout.photometric);
            return Err(image.wrong(tags::PHOTOMETRIC_INTERPRETATION, problem));
        }
        if image.pixels.length.is_some() {
            let bits = layout.bits().saturating_mul(count(frame));
            let (first, within) = (bits / 8, bits % 8);
            let length = (within + layout.bits()).div_ceil(8);
            if image.syntax.coding == Coding::Plain && is_as_it_is::<T>(layout, image.syntax.byte_order) {
                return straight(image, first, bytemuck::cast_slice_mut(out));
            }
            let (inflated, stream) = (shared.inflated.get(&number), shared.streams.get(&number));
            let bytes = match (inflated, stream) {
                (None, Some(frames)) => {
                    let mut frames = frames.lock().unwrap_or_else(PoisonError::into_inner);
                    frames.read(&image.path, (first, length), buffer)?;
                    &buffer[..]
                }
                (Some(all), _) => {
                    let [first, length] = [first, length].map(|it| usize::try_from(it).unwrap_or(usize::MAX));
                    &all[first..first + length]
                }
                (None, None) => {
                    plain(image, first, length, buffer)?;
                    &buffer[..]
                }
            };
            let place = Place { byte_order: image.syntax.byte_order, is_aligned: false, first_bit: within };
            lay(bytes, layout, layout.allocated, layout.is_planar, &place, self.component, out);
            return Ok(());
        }
        let own;
        let ranges = match shared.fragments.get(&number).and_then(|frames| frames.get(frame)) {
            Some(ranges) => ranges,
            None => {
                own = frames_of(image)?;
                own.first().ok_or_else(|| at_frame("the frame has no fragments".to_owned()))?
            }
        };
        fragments(&image.path, ranges, buffer)?;
        if image.syntax.coding == Coding::Plain {
            let (found, expected) = (count(buffer.len()), layout.bytes());
            if found < expected {
                return Err(VolumeError::Short { path: image.path.clone(), found, expected });
            }
            let place = Place { byte_order: image.syntax.byte_order, is_aligned: false, first_bit: 0 };
            lay(buffer, layout, layout.allocated, layout.is_planar, &place, self.component, out);
            return Ok(());
        }
        let encoding = image.syntax.coding.name();
        let Numbers { bytes, allocated, is_planar, is_aligned } = codec::decode(image.syntax.coding, buffer, layout)
            .map_err(|failure| match failure {
                Failure::Damaged(problem) => at_frame(format!("damaged {encoding} data: {problem}")),
                Failure::Unknown(kind) => at_frame(format!(
                    "the pixels are {kind}; convert the file to explicit little endian, as with gdcmconv or dcmdjpeg"
                )),
                Failure::Incredible(limit) => VolumeError::Incredible {
                    path: image.path.clone(),
                    compressed: count(buffer.len()),
                    expected: layout.bytes(),
                    encoding,
                    limit,
                },
            })?;
        let place = Place { byte_order: ByteOrder::Little, is_aligned, first_bit: 0 };
        lay(&bytes, layout, allocated, is_planar, &place, self.component, out);
        Ok(())
    }
}

/// Whether the bytes of a frame are those of its voxels.
fn is_as_it_is<T: Stored>(layout: &Layout, byte_order: ByteOrder) -> bool {
    layout.samples == 1
        && whole_bits(layout.allocated.into()) == 8 * size_of::<T>()
        && (layout.stored, layout.high + 1) == (layout.allocated, layout.allocated)
        && (byte_order == ByteOrder::NATIVE || layout.allocated == 8)
}

/// Reads uncompressed pixels, from byte `first` of the pixel data on, into their place.
fn straight(image: &Image, first: u64, out: &mut [u8]) -> Result<(), VolumeError> {
    let path = &image.path;
    let fail = |source| failed(path, source);
    let mut file = stream::open(path)?;
    file.seek(SeekFrom::Start(image.pixels.at.saturating_add(first))).map_err(fail)?;
    let there = read_fully(&mut file, out).map_err(fail)?;
    if there < out.len() {
        return Err(VolumeError::Short { path: path.clone(), found: count(there), expected: count(out.len()) });
    }
    Ok(())
}

/// Reads `length` bytes of pixels, from byte `first` of the pixel data on.
fn plain(image: &Image, first: u64, length: u64, buffer: &mut Buffer) -> Result<(), VolumeError> {
    let path = &image.path;
    let at = image.pixels.at.saturating_add(first);
    buffer.clear();
    // Memory grows with the bytes that come.
    let there = if image.syntax.coding == Coding::Deflated {
        dataset::stream_from(path, &image.syntax, at)?.take(length).read_to_end(buffer)
    } else {
        let mut file = stream::open(path)?;
        file.seek(SeekFrom::Start(at)).and_then(|_| file.take(length).read_to_end(buffer))
    };
    let there = there.map_err(|source| failed(path, source))?;
    if count(there) < length {
        return Err(VolumeError::Short { path: path.clone(), found: count(there), expected: length });
    }
    Ok(())
}

/// Reads fragments one after another.
fn fragments(path: &Path, ranges: &[Range], buffer: &mut Buffer) -> Result<(), VolumeError> {
    let fail = |source| failed(path, source);
    let mut file: File = stream::open(path)?;
    buffer.clear();
    for &Range { at, length } in ranges {
        file.seek(SeekFrom::Start(at)).map_err(fail)?;
        let there = (&mut file).take(length).read_to_end(buffer).map_err(fail)?;
        if count(there) < length {
            return Err(VolumeError::Short { path: path.to_owned(), found: count(there), expected: length });
        }
    }
    Ok(())
}

/// The fragments of each frame: by the table of offsets at the first fragment or in the header, else one each, else by
/// the marks that begin a codestream.
fn frames_of(image: &Image) -> Result<Vec<Vec<Range>>, VolumeError> {
    let path = &image.path;
    let all = dataset::fragments(path, image.pixels.at)?;
    let Some((&table, rest)) = all.split_first() else { return Ok(Vec::new()) };
    if image.count == 1 {
        return Ok(vec![rest.to_vec()]);
    }
    let mut offsets = Vec::new();
    if table.length == 4 * count(image.count) {
        let mut bytes = Buffer::new();
        fragments(path, &[table], &mut bytes)?;
        offsets = bytes.as_chunks::<4>().0.iter().map(|&offset| u32::from_le_bytes(offset).into()).collect();
    } else if image.offsets.len() == image.count {
        offsets = image.offsets.iter().map(|&offset| count(whole(offset))).collect::<Vec<u64>>();
    }
    if let Some(frames) = by_offsets(&offsets, rest) {
        return Ok(frames);
    }
    if rest.len() == image.count {
        return Ok(rest.iter().map(|&range| vec![range]).collect());
    }
    let mut frames: Vec<Vec<Range>> = Vec::new();
    let mut file = stream::open(path)?;
    for &range in rest {
        let mut mark = [0; 2];
        let read = file.seek(SeekFrom::Start(range.at)).and_then(|_| read_fully(&mut file, &mut mark));
        read.map_err(|source| failed(path, source))?;
        match frames.last_mut() {
            Some(frame) if ![[0xff, 0xd8], [0xff, 0x4f]].contains(&mark) => frame.push(range),
            _ => frames.push(vec![range]),
        }
    }
    if frames.len() == image.count {
        return Ok(frames);
    }
    let (there, wanted) = (rest.len(), image.count);
    let problem =
        format!("{there} fragments for {wanted} frames, and neither offsets nor marks tell which belong together");
    Err(image.wrong(image.pixels.tag, problem))
}

/// The fragments that begin at each of `offsets` from the first one; `None` unless each offset is that of a fragment.
fn by_offsets(offsets: &[u64], fragments: &[Range]) -> Option<Vec<Vec<Range>>> {
    let first = fragments.first()?.at;
    let starts: Vec<usize> = offsets
        .iter()
        .map(|&offset| fragments.binary_search_by_key(&first.saturating_add(offset), |range| range.at).ok())
        .collect::<Option<_>>()?;
    if starts.first() != Some(&0) || !starts.is_sorted_by(|one, next| one < next) {
        return None;
    }
    let ends = starts[1..].iter().copied().chain([fragments.len()]);
    Some(starts.iter().zip(ends).map(|(&start, end)| fragments[start..end].to_vec()).collect())
}

/// Layout of numbers in bytes.
struct Place {
    byte_order: ByteOrder,
    /// Whether the lowest bit of a number is bit 0, whatever the header says of the highest one.
    is_aligned: bool,
    /// First bit of numbers of one bit.
    first_bit: u64,
}

/// Writes one component of the numbers in `bytes` to `out`, without the bits that are not used, and with their sign.
fn lay<T: Stored>(
    bytes: &[u8],
    layout: &Layout,
    allocated: u32,
    is_planar: bool,
    place: &Place,
    component: usize,
    out: &mut [T],
) {
    let (first, step) = if is_planar { (component * out.len(), 1) } else { (component, layout.samples) };
    if allocated == 1 {
        let first_bit = whole_bits(place.first_bit);
        for (index, voxel) in out.iter_mut().enumerate() {
            // The first pixel is in the lowest bit.
            let bit = first_bit + first + step * index;
            *voxel = T::of(u64::from(bytes[bit / 8] >> (bit % 8) & 1));
        }
        return;
    }
    let top = if place.is_aligned { layout.stored - 1 } else { layout.high };
    let (up, down) = (63 - top, 64 - layout.stored);
    #[expect(clippy::cast_possible_wrap, clippy::cast_sign_loss, reason = "shifts in a sign")]
    let used = move |bits: u64| {
        if layout.is_signed { ((bits << up) as i64 >> down) as u64 } else { bits << up >> down }
    };
    let is_big = place.byte_order == ByteOrder::Big;
    match allocated {
        8 => fill(bytes, [first, step], out, |[byte]: [u8; 1]| used(byte.into())),
        16 if is_big => fill(bytes, [first, step], out, |word| used(u16::from_be_bytes(word).into())),
        16 => fill(bytes, [first, step], out, |word| used(u16::from_le_bytes(word).into())),
        32 if is_big => fill(bytes, [first, step], out, |word| used(u32::from_be_bytes(word).into())),
        32 => fill(bytes, [first, step], out, |word| used(u32::from_le_bytes(word).into())),
        _ if is_big => fill(bytes, [first, step], out, u64::from_be_bytes),
        _ => fill(bytes, [first, step], out, u64::from_le_bytes),
    }
}

fn whole_bits(bits: u64) -> usize {
    usize::try_from(bits).unwrap_or(0)
}

/// Writes every `step`-th number of `N` bytes, from number `first` on.
fn fill<T: Stored, const N: usize>(
    bytes: &[u8],
    [first, step]: [usize; 2],
    out: &mut [T],
    number: impl Fn([u8; N]) -> u64,
) {
    let (words, _) = bytes.as_chunks::<N>();
    if step == 1 {
        out.iter_mut().zip(&words[first..]).for_each(|(voxel, &word)| *voxel = T::of(number(word)));
    } else {
        out.iter_mut().zip(words[first..].iter().step_by(step)).for_each(|(voxel, &word)| *voxel = T::of(number(word)));
    }
}
