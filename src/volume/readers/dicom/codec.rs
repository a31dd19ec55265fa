//! Decoding of compressed frames: RLE, JPEG, JPEG-LS, JPEG 2000 (DICOM PS3.5, §8.2 and annexes A and G).

use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image as Jpeg2000};
use jpeg_decoder::{CodingProcess, ColorTransform, Decoder, PixelFormat};
use jpegls::CodecError;

use super::frame::Layout;
use super::syntax::{Coding, MOST_BYTES};
use crate::readers::guard::guarded;
use crate::stream::{PackBits, count};

/// Numbers of a decoded frame.
#[derive(Debug)]
pub(super) struct Numbers {
    /// Little-endian numbers of `allocated` bits.
    pub(super) bytes: Vec<u8>,
    pub(super) allocated: u32,
    /// Whether the samples of a pixel lie in planes.
    pub(super) is_planar: bool,
    /// Whether the lowest bit is bit 0; otherwise the used bits lie as the header states.
    pub(super) is_aligned: bool,
}

/// Failure to decode a frame.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Failure {
    /// The data are damaged, or contradict the header.
    Damaged(String),
    /// The data are of a kind that Relume does not decode.
    Unknown(String),
    /// The bytes cannot hold the frame: one byte holds at most so many bytes of pixels.
    Incredible(u64),
}

impl From<String> for Failure {
    fn from(problem: String) -> Self {
        Self::Damaged(problem)
    }
}

/// Decodes a frame of `layout`.
///
/// # Errors
///
/// [`Failure`], also where a decoder panics.
pub(super) fn decode(coding: Coding, bytes: &[u8], layout: &Layout) -> Result<Numbers, Failure> {
    let wanted = layout.bytes();
    if wanted > MOST_BYTES {
        return Err(format!("a frame of {wanted} bytes; Relume decodes at most {MOST_BYTES}").into());
    }
    let limit = coding.packing(layout.allocated).unwrap_or(1);
    if count(bytes.len()).saturating_mul(limit) < wanted {
        return Err(Failure::Incredible(limit));
    }
    if let Some(found) = kind_of(bytes).filter(|&found| found != coding) {
        let (found, stated) = (found.name(), coding.name());
        return Err(Failure::Unknown(format!("{found}, but the stated transfer syntax is one of {stated}")));
    }
    match coding {
        Coding::Rle => rle(bytes, layout).map_err(Failure::from),
        Coding::Jpeg => decoded(|| jpeg(bytes, layout)),
        Coding::JpegLs => decoded(|| jpeg_ls(bytes, layout)),
        Coding::Jpeg2000 => decoded(|| Ok(jpeg_2000(bytes, layout)?)),
        Coding::Plain | Coding::Deflated | Coding::Foreign(_) => Err("the frame is not compressed".to_owned().into()),
    }
}

/// The coding of a codestream, by its first marks; `None` for RLE, which has none, and for others.
fn kind_of(bytes: &[u8]) -> Option<Coding> {
    match bytes {
        [0xff, 0x4f, 0xff, 0x51, ..] | [0, 0, 0, 0x0c, b'j', b'P', b' ', b' ', ..] => Some(Coding::Jpeg2000),
        [0xff, 0xd8, 0xff, ..] => match FrameHeader::of(bytes)?.marker {
            0xf7 => Some(Coding::JpegLs),
            _ => Some(Coding::Jpeg),
        },
        _ => None,
    }
}

/// Runs a decoder of another crate, whose panics become errors.
fn decoded(decode: impl FnOnce() -> Result<Numbers, Failure>) -> Result<Numbers, Failure> {
    guarded(|| Ok(decode())).map_err(|error| Failure::Damaged(error.to_string()))?
}

/// Decodes RLE: a segment for each byte of each sample, the most significant byte first.
fn rle(bytes: &[u8], layout: &Layout) -> Result<Numbers, String> {
    let width = match layout.allocated {
        8 => 1,
        16 => 2,
        32 => 4,
        other => return Err(format!("RLE with numbers of {other} bits; it has 8, 16 or 32")),
    };
    let word = |at: usize| {
        let word = bytes.get(4 * at..)?.first_chunk()?;
        usize::try_from(u32::from_le_bytes(*word)).ok()
    };
    let (segments, wanted) = (word(0).unwrap_or(0), width * layout.samples);
    if segments != wanted {
        return Err(format!("{segments} RLE segments; {wanted} are needed"));
    }
    let pixels = layout.pixels();
    let mut decoded = vec![0; pixels * wanted];
    let mut buffer = [0_u8; 4096];
    for segment in 0..segments {
        let start = word(1 + segment).unwrap_or(usize::MAX);
        let end = if segment + 1 < segments { word(2 + segment).unwrap_or(usize::MAX) } else { bytes.len() };
        let Some(packed) = bytes.get(start..end).filter(|_| start >= 64) else {
            let length = bytes.len();
            return Err(format!("RLE segment {segment} lies from byte {start} to {end} of a frame of {length} bytes"));
        };
        let (sample, byte) = (segment / width, segment % width);
        let first = sample * pixels * width + (width - 1 - byte);
        let mut runs = PackBits::new(packed);
        let mut found = 0;
        while found < pixels {
            let part = (pixels - found).min(buffer.len());
            let there = runs.fill(&mut buffer[..part]);
            if there == 0 {
                break;
            }
            let places = decoded[first + found * width..].iter_mut().step_by(width);
            places.zip(&buffer[..there]).for_each(|(place, &byte)| *place = byte);
            found += there;
        }
        if found < pixels {
            return Err(format!("RLE segment {segment} has {found} bytes; {pixels} are needed"));
        }
    }
    Ok(Numbers { bytes: decoded, allocated: layout.allocated, is_planar: true, is_aligned: false })
}

/// Frame header of a JPEG or JPEG-LS codestream.
struct FrameHeader {
    /// Marker: 0xc0 and following, or 0xf7 for JPEG-LS.
    marker: u8,
    precision: u8,
    height: usize,
    width: usize,
    components: usize,
}

impl FrameHeader {
    /// Finds the frame header among the markers before the first scan.
    fn of(bytes: &[u8]) -> Option<Self> {
        let mut rest = bytes.strip_prefix(&[0xff, 0xd8])?;
        loop {
            // Bytes 0xff may fill the space before a marker.
            while let [0xff, 0xff, ..] = rest {
                rest = &rest[1..];
            }
            let &[0xff, marker, a, b, ..] = rest else { return None };
            let length = usize::from(u16::from_be_bytes([a, b]));
            let is_frame = matches!(marker, 0xc0..=0xcf if ![0xc4, 0xc8, 0xcc].contains(&marker)) || marker == 0xf7;
            if is_frame {
                let &[precision, h0, h1, w0, w1, components, ..] = rest.get(4..)? else { return None };
                let side = |bytes| usize::from(u16::from_be_bytes(bytes));
                let (height, width) = (side([h0, h1]), side([w0, w1]));
                return Some(Self { marker, precision, height, width, components: components.into() });
            }
            // A scan without a frame header.
            if marker == 0xda {
                return None;
            }
            rest = rest.get(2 + length..)?;
        }
    }

    /// Checks size, number of components and precision against `layout`.
    fn check(&self, layout: &Layout) -> Result<(), String> {
        same_size([self.width, self.height], self.components, layout)?;
        if u32::from(self.precision) > layout.allocated {
            let (found, most) = (self.precision, layout.allocated);
            return Err(format!("the codestream has {found} bits per number, but the header allocates {most}"));
        }
        Ok(())
    }
}

/// Checks the size in a codestream against that of the header.
fn same_size([width, height]: [usize; 2], components: usize, layout: &Layout) -> Result<(), String> {
    if [width, height] != [layout.columns, layout.rows] {
        let (columns, rows) = (layout.columns, layout.rows);
        return Err(format!("the codestream has {width}×{height} pixels, but the header states {columns}×{rows}"));
    }
    if components != layout.samples {
        let samples = layout.samples;
        return Err(format!("the codestream has {components} components, but the header states {samples}"));
    }
    Ok(())
}

fn jpeg(bytes: &[u8], layout: &Layout) -> Result<Numbers, Failure> {
    let header = FrameHeader::of(bytes).ok_or_else(|| "the frame has no JPEG frame header".to_owned())?;
    header.check(layout)?;
    match (header.marker, header.precision) {
        (0xc3, _) | (0xc0..=0xc2, 8) => {}
        (0xc0..=0xc2, bits) => {
            let kind = format!("JPEG with {bits} bits by DCT; Relume decodes 8 by DCT, and up to 16 without loss");
            return Err(Failure::Unknown(kind));
        }
        (marker, _) => {
            let kind = format!("JPEG of the kind ff{marker:02x}; Relume decodes lossless and baseline");
            return Err(Failure::Unknown(kind));
        }
    }
    let mut decoder = Decoder::new(bytes);
    decoder.set_max_decoding_buffer_size(usize::try_from(MOST_BYTES).unwrap_or(usize::MAX));
    if layout.samples > 1 {
        // A colour transform belongs to lossy coding; the numbers of other colours are those of the file.
        let is_ybr = layout.photometric.starts_with("YBR") && header.marker != 0xc3;
        decoder.set_color_transform(if is_ybr { ColorTransform::YCbCr } else { ColorTransform::RGB });
    }
    let mut decoded = decoder.decode().map_err(|error| error.to_string())?;
    let info = decoder.info().ok_or_else(|| "the frame has no size".to_owned())?;
    let allocated = if info.pixel_format == PixelFormat::L16 { 16 } else { 8 };
    debug_assert!(info.coding_process != CodingProcess::Lossless || header.marker == 0xc3, "one process");
    if allocated == 16 && cfg!(target_endian = "big") {
        decoded.chunks_exact_mut(2).for_each(<[u8]>::reverse);
    }
    Ok(whole(decoded, allocated, layout)?)
}

fn jpeg_ls(bytes: &[u8], layout: &Layout) -> Result<Numbers, Failure> {
    let header = FrameHeader::of(bytes).ok_or_else(|| "the frame has no JPEG-LS frame header".to_owned())?;
    if header.marker != 0xf7 {
        return Err(format!("the frame is no JPEG-LS: its frame header is ff{:02x}", header.marker).into());
    }
    if layout.samples > 1 {
        return Err(Failure::Unknown(format!("JPEG-LS with {} components; Relume decodes one", layout.samples)));
    }
    header.check(layout)?;
    let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
    let decoded = jpegls::decode(bytes, side(layout.columns), side(layout.rows));
    let (numbers, ..) = decoded.map_err(|error: CodecError| error.to_string())?;
    let mut bytes = bytemuck::cast_slice::<u16, u8>(&numbers).to_vec();
    if cfg!(target_endian = "big") {
        bytes.chunks_exact_mut(2).for_each(<[u8]>::reverse);
    }
    Ok(whole(bytes, 16, layout)?)
}

/// The size marker of a JPEG 2000 codestream.
struct Size {
    sides: [usize; 2],
    tiles: u64,
    /// Precision of the components, and whether they are signed.
    components: Vec<(u32, bool)>,
}

impl Size {
    /// Reads the marker SIZ, the first one of a codestream, which may be in a JP2 file.
    fn of(bytes: &[u8]) -> Option<Self> {
        let start = memchr::memmem::find(bytes, &[0xff, 0x4f, 0xff, 0x51])?;
        let bytes = &bytes[start..];
        let long = |at: usize| Some(u32::from_be_bytes(*bytes.get(at..)?.first_chunk()?));
        let [x, y, x0, y0, tile_x, tile_y, tile_x0, tile_y0] = [8, 12, 16, 20, 24, 28, 32, 36].map(long);
        let side = |end: Option<u32>, start: Option<u32>| usize::try_from(end?.checked_sub(start?)?).ok();
        let tiles = |end: Option<u32>, start: Option<u32>, tile: Option<u32>| {
            Some(u64::from(end?.checked_sub(start?)?.div_ceil(tile.filter(|&tile| tile > 0)?)))
        };
        let count = usize::from(u16::from_be_bytes(*bytes.get(40..)?.first_chunk()?));
        let component = |index: usize| {
            let byte = *bytes.get(42 + 3 * index)?;
            Some((u32::from(byte & 0x7f) + 1, byte & 0x80 != 0))
        };
        Some(Self {
            sides: [side(x, x0)?, side(y, y0)?],
            tiles: tiles(x, tile_x0, tile_x)?.saturating_mul(tiles(y, tile_y0, tile_y)?),
            components: (0..count.min(4)).map(component).collect::<Option<_>>()?,
        })
    }
}

fn jpeg_2000(bytes: &[u8], layout: &Layout) -> Result<Numbers, String> {
    let size = Size::of(bytes).ok_or("the frame has no JPEG 2000 codestream")?;
    same_size(size.sides, size.components.len(), layout)?;
    if size.tiles > 65535 {
        return Err(format!("the codestream has {} tiles; it may have 65535", size.tiles));
    }
    if let Some((bits, _)) = size.components.iter().find(|(bits, _)| *bits > layout.allocated.min(24)) {
        let most = layout.allocated.min(24);
        return Err(format!("the codestream has {bits} bits per number; {most} are possible here"));
    }
    let settings = DecodeSettings { resolve_palette_indices: false, strict: true, target_resolution: None };
    let image = Jpeg2000::new(bytes, &settings).map_err(|error| error.to_string())?;
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(|error| error.to_string())?;
    let width = if layout.allocated <= 8 { 1 } else { layout.allocated.div_ceil(16) * 2 };
    let mut numbers = Vec::new();
    for (component, &(bits, is_signed)) in decoded.components().iter().zip(&size.components) {
        // Samples of signed streams come shifted by half their range, like unsigned ones.
        let shift = if is_signed { 1_i64 << (bits - 1) } else { 0 };
        let last = (1_i64 << bits) - 1;
        for &sample in component.samples() {
            #[expect(clippy::cast_possible_truncation, reason = "clamped to the range of the stream")]
            let number = (sample.round() as i64).clamp(0, last) - shift;
            let bytes = number.to_le_bytes();
            numbers.extend_from_slice(&bytes[..usize::try_from(width).unwrap_or(4)]);
        }
    }
    let mut numbers = whole(numbers, 8 * width, layout)?;
    numbers.is_planar = true;
    Ok(numbers)
}

/// The numbers of a whole frame.
fn whole(bytes: Vec<u8>, allocated: u32, layout: &Layout) -> Result<Numbers, String> {
    let wanted = layout.pixels() * layout.samples * usize::try_from(allocated / 8).unwrap_or(1);
    if bytes.len() == wanted {
        Ok(Numbers { bytes, allocated, is_planar: false, is_aligned: true })
    } else {
        Err(format!("{} bytes of pixels came out; {wanted} are needed", bytes.len()))
    }
}
