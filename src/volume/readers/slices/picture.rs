//! Slices in PNG, JPEG, BMP and PNM.

use std::fs::File;
use std::io::{self, BufReader, Seek as _};
use std::path::Path;

use image::codecs::{bmp::BmpDecoder, jpeg::JpegDecoder, pnm::PnmDecoder};
use image::{ColorType, ImageDecoder};

use crate::readers::guard::guarded;
use crate::readers::tiff::{Picture, Sample, unpack_bits};
use crate::stream::{self, DEFLATE_LIMIT, JPEG_LIMIT, count};
use crate::{VolumeError, VoxelType};

/// Code of colours of red, green and blue, as in TIFF.
const RGB: u64 = 2;

/// Code of indices into a colour map.
const INDICES: u64 = 3;

/// Format of a slice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Format {
    Png,
    Jpeg,
    Bmp,
    Pnm,
}

impl Format {
    /// The format that begins with these bytes.
    fn of(beginning: &[u8]) -> Option<Self> {
        match beginning {
            [0x89, b'P', b'N', b'G', ..] => Some(Self::Png),
            [0xff, 0xd8, 0xff, ..] => Some(Self::Jpeg),
            [b'B', b'M', ..] => Some(Self::Bmp),
            [b'P', b'1'..=b'7', ..] => Some(Self::Pnm),
            _ => None,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Png => "PNG",
            Self::Jpeg => "JPEG",
            Self::Bmp => "BMP",
            Self::Pnm => "PNM",
        }
    }

    /// Largest number of bytes of numbers per byte of the file.
    fn packing(self) -> u64 {
        match self {
            // Eight numbers in a byte, deflated.
            Self::Png => 8 * DEFLATE_LIMIT,
            Self::Jpeg => JPEG_LIMIT,
            // Two bytes yield a run of at most 255.
            Self::Bmp => 128,
            Self::Pnm => 8,
        }
    }
}

/// Size and type of the slice in the file `path`.
pub(super) fn picture(path: &Path) -> Result<Picture, VolumeError> {
    let (format, file) = opened(path)?;
    let length = file.get_ref().metadata().map_err(|source| stream::failed(path, source))?.len();
    let read = guarded(|| match format {
        Format::Png => {
            let reader = png_reader(file)?;
            Ok(png_picture(reader.info()))
        }
        Format::Jpeg => of_decoder(&JpegDecoder::new(file).map_err(io::Error::other)?, 1),
        Format::Bmp => {
            let (decoder, photometric) = bmp(file)?;
            of_decoder(&decoder, photometric)
        }
        Format::Pnm => {
            let decoder = PnmDecoder::new(file).map_err(io::Error::other)?;
            let picture = of_decoder(&decoder, 1)?;
            Ok(if is_bits(&decoder) { Picture { sample: Sample::Bits(1), ..picture } } else { picture })
        }
    });
    let picture = read.map_err(|source| damaged(path, format, source))?;
    let Picture { width, height, samples, sample, .. } = picture;
    crate::data::check_size(path.display(), &[width, height, samples])?;
    let expected = count(width * height * samples * sample.voxel_type().bytes());
    let limit = format.packing();
    if expected > length.saturating_mul(limit) {
        let path = path.to_owned();
        return Err(VolumeError::Incredible { path, compressed: length, expected, encoding: format.name(), limit });
    }
    Ok(picture)
}

/// The numbers of the slice in the file `path`, all samples of a voxel together, in the order of bytes of this machine.
pub(super) fn numbers(path: &Path) -> Result<Vec<u8>, VolumeError> {
    let (format, file) = opened(path)?;
    let read = guarded(|| match format {
        Format::Png => png_numbers(file),
        Format::Jpeg => of_image(JpegDecoder::new(file).map_err(io::Error::other)?),
        Format::Bmp => of_image(bmp(file)?.0),
        Format::Pnm => {
            let decoder = PnmDecoder::new(file).map_err(io::Error::other)?;
            let (bits, wide) =
                (is_bits(&decoder), decoder.color_type().bytes_per_pixel() > decoder.color_type().channel_count());
            let most = decoder.header().maximal_sample();
            let mut numbers = of_image(decoder)?;
            // The crate scales to the whole range of the type, and paints the ones of a bitmap black.
            if bits {
                numbers.iter_mut().for_each(|number| *number = u8::from(*number == 0));
            } else if wide {
                for number in numbers.as_chunks_mut::<2>().0 {
                    *number = unscaled(u16::from_ne_bytes(*number), u16::MAX, most).to_ne_bytes();
                }
            } else {
                for number in &mut numbers {
                    let own = unscaled(u16::from(*number), u16::from(u8::MAX), most);
                    *number = u8::try_from(own).unwrap_or(u8::MAX);
                }
            }
            Ok(numbers)
        }
    });
    read.map_err(|source| damaged(path, format, source))
}

/// The number of which `scaled` is `most` parts of `whole`, rounded.
fn unscaled(scaled: u16, whole: u16, most: u32) -> u16 {
    if most == 0 || most >= u32::from(whole) {
        return scaled;
    }
    let rounded = (u32::from(scaled) * most + u32::from(whole) / 2) / u32::from(whole);
    u16::try_from(rounded).unwrap_or(u16::MAX)
}

fn damaged(path: &Path, format: Format, source: io::Error) -> VolumeError {
    VolumeError::DamagedPart { path: path.to_owned(), place: "slice".to_owned(), encoding: format.name(), source }
}

fn opened(path: &Path) -> Result<(Format, BufReader<File>), VolumeError> {
    let failed = |source| stream::failed(path, source);
    let mut file = stream::at(path, 0)?;
    let mut beginning = [0; 4];
    let there = stream::read_fully(&mut file, &mut beginning).map_err(failed)?;
    file.rewind().map_err(failed)?;
    let format = Format::of(&beginning[..there]);
    let format = format.ok_or_else(|| VolumeError::Field {
        path: path.to_owned(),
        place: "header".to_owned(),
        problem: "the slice is not PNG, JPEG, BMP or PNM, as its extension says".to_owned(),
    })?;
    Ok((format, file))
}

fn png_reader(file: BufReader<File>) -> io::Result<png::Reader<BufReader<File>>> {
    let mut decoder = png::Decoder::new(file);
    // Numbers as stored: indices stay indices.
    decoder.set_transformations(png::Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder.read_info().map_err(io::Error::other)
}

fn png_picture(info: &png::Info<'_>) -> Picture {
    let side = |side: u32| usize::try_from(side).unwrap_or(usize::MAX);
    let (samples, photometric) = match info.color_type {
        png::ColorType::Grayscale => (1, 1),
        png::ColorType::GrayscaleAlpha => (2, 1),
        png::ColorType::Rgb => (3, RGB),
        png::ColorType::Rgba => (4, RGB),
        png::ColorType::Indexed => (1, INDICES),
    };
    let sample = match info.bit_depth {
        png::BitDepth::One => Sample::Bits(1),
        png::BitDepth::Two => Sample::Bits(2),
        png::BitDepth::Four => Sample::Bits(4),
        png::BitDepth::Eight => Sample::Number(VoxelType::U8),
        png::BitDepth::Sixteen => Sample::Number(VoxelType::U16),
    };
    Picture { width: side(info.width), height: side(info.height), samples, sample, photometric }
}

/// Zeros for a picture; an error if there is no memory.
fn zeros(bytes: usize) -> io::Result<Vec<u8>> {
    let short = |()| io::Error::new(io::ErrorKind::OutOfMemory, format!("there is no memory for {bytes} bytes"));
    bytemuck::try_zeroed_vec(bytes).map_err(short)
}

fn png_numbers(file: BufReader<File>) -> io::Result<Vec<u8>> {
    let mut reader = png_reader(file)?;
    let picture = png_picture(reader.info());
    let too_large = || io::Error::other("it is too large");
    let mut numbers = zeros(reader.output_buffer_size().ok_or_else(too_large)?)?;
    let frame = reader.next_frame(&mut numbers).map_err(io::Error::other)?;
    numbers.truncate(frame.buffer_size());
    match picture.sample {
        Sample::Bits(bits) => {
            let mut all = zeros(picture.width * picture.height)?;
            for (line, packed) in all.chunks_mut(picture.width.max(1)).zip(numbers.chunks(frame.line_size.max(1))) {
                unpack_bits(packed, bits, (0, 1), line);
            }
            Ok(all)
        }
        Sample::Number(VoxelType::U16) => {
            for number in numbers.as_chunks_mut::<2>().0 {
                *number = u16::from_be_bytes(*number).to_ne_bytes();
            }
            Ok(numbers)
        }
        _ => Ok(numbers),
    }
}

/// The decoder of a BMP, which keeps indices, and the code of what its numbers are.
fn bmp(file: BufReader<File>) -> io::Result<(BmpDecoder<BufReader<File>>, u64)> {
    let mut decoder = BmpDecoder::new(file).map_err(io::Error::other)?;
    let Some(map) = decoder.get_palette() else { return Ok((decoder, RGB)) };
    // Most grey pictures have a map from each number to itself.
    let is_grey = map.iter().zip(0..=u8::MAX).all(|(colour, grey)| *colour == [grey; 3]);
    decoder.set_indexed_color(true);
    Ok((decoder, if is_grey { 1 } else { INDICES }))
}

fn is_bits<R: io::Read>(decoder: &PnmDecoder<R>) -> bool {
    decoder.header().as_bitmap().is_some()
}

fn of_decoder(decoder: &impl ImageDecoder, photometric: u64) -> io::Result<Picture> {
    let (width, height) = decoder.dimensions();
    let side = |side: u32| usize::try_from(side).unwrap_or(usize::MAX);
    let (samples, voxel_type) = match decoder.color_type() {
        ColorType::L8 => (1, VoxelType::U8),
        ColorType::La8 => (2, VoxelType::U8),
        ColorType::Rgb8 => (3, VoxelType::U8),
        ColorType::Rgba8 => (4, VoxelType::U8),
        ColorType::L16 => (1, VoxelType::U16),
        ColorType::La16 => (2, VoxelType::U16),
        ColorType::Rgb16 => (3, VoxelType::U16),
        ColorType::Rgba16 => (4, VoxelType::U16),
        other => return Err(io::Error::other(format!("it has colours of the type {other:?}"))),
    };
    let photometric = if samples >= 3 { RGB } else { photometric };
    Ok(Picture { width: side(width), height: side(height), samples, sample: Sample::Number(voxel_type), photometric })
}

fn of_image(decoder: impl ImageDecoder) -> io::Result<Vec<u8>> {
    let bytes = usize::try_from(decoder.total_bytes()).map_err(io::Error::other)?;
    let mut numbers = zeros(bytes)?;
    decoder.read_image(&mut numbers).map_err(io::Error::other)?;
    Ok(numbers)
}
