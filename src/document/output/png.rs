//! PNG files in sRGB with 8 or 16 bits per sample.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use rayon::prelude::*;

use super::inputs::INPUTS;
use super::picture::{Picture, check_samples};
use super::{OutputError, SOFTWARE, write_atomically};

/// Bits per sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// 8 bits: 256 levels.
    Eight,
    /// 16 bits: 65,536 levels.
    Sixteen,
}

/// Treatment of a picture's opacity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Alpha {
    /// Shows the picture over black; the file has no alpha.
    OverBlack,
    /// Stores the opacity as alpha, and colours divided by it, as PNG requires. A picture without opacity has opacity
    /// 1. Exact for programs that mix linear light.
    Kept,
    /// The same for programs that mix codes of sRGB, as most do: over black, these show the codes of the picture over
    /// black. Bright pixels are more opaque than in the picture.
    KeptForCodes,
}

impl Alpha {
    /// Whether the file has alpha.
    fn is_kept(self) -> bool {
        self != Self::OverBlack
    }
}

/// The samples of `picture` as the PNG file of [`write_png`] has them: for each pixel three or, with opacity, four codes of sRGB, in
/// one byte or two, the higher first.
#[must_use]
pub fn display_codes(picture: &Picture<'_>, depth: Depth, alpha: Alpha) -> Vec<u8> {
    match depth {
        Depth::Eight => {
            encode(picture, alpha, |colour| [code_8(colour)], |opacity| [level(opacity, 255).to_be_bytes()[1]])
        }
        Depth::Sixteen => encode(
            picture,
            alpha,
            |colour| level(srgb_from_linear(colour), u16::MAX).to_be_bytes(),
            |opacity| level(opacity, u16::MAX).to_be_bytes(),
        ),
    }
}

/// The bytes of the PNG file that [`write_png`] writes.
///
/// # Errors
///
/// [`OutputError::Size`].
pub fn png_bytes(picture: &Picture<'_>, depth: Depth, alpha: Alpha) -> Result<Vec<u8>, OutputError> {
    let sides = sides(picture.width(), picture.height())?;
    let mut bytes = Vec::new();
    write_into(&mut bytes, picture, sides, depth, alpha)
        .map_err(|source| OutputError::Write { path: PathBuf::from("memory"), source })?;
    Ok(bytes)
}

/// Writes `picture` to `path`, encoded as sRGB (IEC 61966-2-1); see [`write_atomically`].
///
/// Clamps values to 0–1, rounds to the nearest code, and turns NaN into black.
///
/// # Errors
///
/// Same as [`write_atomically`].
pub fn write_png(path: &Path, picture: &Picture<'_>, depth: Depth, alpha: Alpha) -> Result<(), OutputError> {
    let sides = sides(picture.width(), picture.height())?;
    write_atomically(path, |sink| write_into(sink, picture, sides, depth, alpha))
}

fn write_into(
    sink: impl io::Write,
    picture: &Picture<'_>,
    sides: [u32; 2],
    depth: Depth,
    alpha: Alpha,
) -> io::Result<()> {
    let mut encoder = encoder(sink, sides, depth, alpha.is_kept())?;
    if let Some(digest) = picture.inputs() {
        encoder.add_text_chunk(INPUTS.to_owned(), digest).map_err(described)?;
    }
    write_pixels(encoder, &display_codes(picture, depth, alpha))
}

/// Writes 8-bit sRGB samples: three (R, G, B) or four (with straight alpha) per pixel.
///
/// # Errors
///
/// [`OutputError::Size`], [`OutputError::Shape`], and those of [`write_atomically`].
pub fn write_ready_png(path: &Path, width: usize, height: usize, samples: &[u8]) -> Result<(), OutputError> {
    check_samples("a PNG", width, height, samples.len())?;
    write_data(path, width, height, Depth::Eight, samples.len() == 4 * width * height, samples)
}

/// Length and speed of an animation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Animation {
    /// Number of pictures.
    pub frames: u32,
    /// Pictures per second.
    pub per_second: u16,
}

/// Writes an animated PNG that repeats without end. `frame` makes the linear RGBA of picture 0, 1, … of `size` (width,
/// height); only one picture is in memory.
///
/// # Errors
///
/// [`OutputError::Size`], [`OutputError::Shape`], those of [`write_atomically`], and those of `frame`; `path` is then
/// unchanged.
pub fn write_apng<E: From<OutputError>>(
    path: &Path,
    size: [usize; 2],
    animation: Animation,
    depth: Depth,
    alpha: Alpha,
    mut frame: impl FnMut(usize) -> Result<Vec<f32>, E>,
) -> Result<(), E> {
    let sides = sides(size[0], size[1])?;
    let mut failed = None;
    let written = write_atomically(path, |sink| {
        let mut encoder = encoder(sink, sides, depth, alpha.is_kept())?;
        encoder.set_animated(animation.frames, 0).map_err(described)?;
        encoder.set_frame_delay(1, animation.per_second).map_err(described)?;
        let mut writer = encoder.write_header().map_err(described)?;
        for index in 0..animation.frames {
            let index = usize::try_from(index).map_err(io::Error::other)?;
            let mut data = || {
                let samples = frame(index)?;
                Ok(display_codes(&Picture::new(size[0], size[1], &samples)?, depth, alpha))
            };
            match data() {
                Ok(data) => writer.write_image_data(&data).map_err(described)?,
                Err(error) => {
                    failed = Some(error);
                    return Err(io::Error::other("a frame failed"));
                }
            }
        }
        writer.finish().map_err(described)
    });
    match failed {
        Some(error) => Err(error),
        None => Ok(written?),
    }
}

/// Encodes the samples of a picture as PNG data, `N` bytes each.
fn encode<const N: usize>(
    picture: &Picture<'_>,
    alpha: Alpha,
    colour: impl Fn(f32) -> [u8; N] + Sync,
    opacity: impl Fn(f32) -> [u8; N] + Sync,
) -> Vec<u8> {
    let channels = picture.channels();
    let kept = alpha.is_kept();
    let pixel_bytes = N * if kept { 4 } else { 3 };
    let mut data = vec![0; picture.width() * picture.height() * pixel_bytes];
    let rows = data.par_chunks_mut(picture.width() * pixel_bytes);
    rows.zip(picture.samples().par_chunks(picture.width() * channels)).for_each(|(bytes, samples)| {
        for (bytes, pixel) in bytes.chunks_exact_mut(pixel_bytes).zip(samples.chunks_exact(channels)) {
            let covered = pixel.get(3).copied().filter(|_| kept).unwrap_or(1.0);
            let scale = if covered > 0.0 { covered.recip() } else { 1.0 };
            let (colours, rest) = bytes.split_at_mut(3 * N);
            if alpha == Alpha::KeptForCodes {
                let code = |&sample: &f32| srgb_from_linear(sample.clamp(0.0, 1.0));
                let codes = pixel.iter().take(3).map(code);
                let covered = codes.clone().fold(covered.clamp(0.0, 1.0), f32::max);
                let scale = if covered > 0.0 { covered.recip() } else { 1.0 };
                for (bytes, code) in colours.chunks_exact_mut(N).zip(codes) {
                    bytes.copy_from_slice(&opacity(code * scale));
                }
                rest.copy_from_slice(&opacity(covered));
                continue;
            }
            for (bytes, &sample) in colours.chunks_exact_mut(N).zip(pixel) {
                bytes.copy_from_slice(&colour(sample * scale));
            }
            if kept {
                rest.copy_from_slice(&opacity(covered));
            }
        }
    });
    data
}

/// Encodes samples, as for [`write_ready_png`], as a PNG in memory, for pages that embed their pictures.
///
/// # Errors
///
/// [`OutputError::Size`] and [`OutputError::Shape`].
pub fn ready_png(width: usize, height: usize, samples: &[u8]) -> Result<Vec<u8>, OutputError> {
    check_samples("a PNG", width, height, samples.len())?;
    let mut bytes = Vec::new();
    let alpha = samples.len() == 4 * width * height;
    let refused = |_| OutputError::Size { width, height, largest: Picture::LARGEST_SIDE };
    let encoder = encoder(&mut bytes, sides(width, height)?, Depth::Eight, alpha).map_err(refused)?;
    write_pixels(encoder, samples).map_err(refused)?;
    Ok(bytes)
}

/// Encodes linear RGB as an 8-bit PNG in memory, as small as the encoder can make it.
///
/// # Errors
///
/// [`OutputError::Size`] and [`OutputError::Shape`].
pub(super) fn small_png(width: usize, height: usize, samples: &[f32]) -> Result<Vec<u8>, OutputError> {
    let data = display_codes(&Picture::new(width, height, samples)?, Depth::Eight, Alpha::OverBlack);
    let mut bytes = Vec::new();
    let refused = |_| OutputError::Size { width, height, largest: Picture::LARGEST_SIDE };
    let mut encoder = encoder(&mut bytes, sides(width, height)?, Depth::Eight, false).map_err(refused)?;
    encoder.set_compression(png::Compression::High);
    encoder.set_filter(png::Filter::Adaptive);
    write_pixels(encoder, &data).map_err(refused)?;
    Ok(bytes)
}

/// Writes encoded pixel data as a PNG file.
fn write_data(
    path: &Path,
    width: usize,
    height: usize,
    depth: Depth,
    alpha: bool,
    data: &[u8],
) -> Result<(), OutputError> {
    let sides = sides(width, height)?;
    write_atomically(path, |sink| write_pixels(encoder(sink, sides, depth, alpha)?, data))
}

fn sides(width: usize, height: usize) -> Result<[u32; 2], OutputError> {
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(columns), Ok(rows)) => Ok([columns, rows]),
        _ => Err(OutputError::Size { width, height, largest: Picture::LARGEST_SIDE }),
    }
}

fn write_pixels(encoder: png::Encoder<'_, impl io::Write>, data: &[u8]) -> io::Result<()> {
    let mut writer = encoder.write_header().map_err(described)?;
    writer.write_image_data(data).map_err(described)?;
    writer.finish().map_err(described)
}

/// An encoder of sRGB pictures.
fn encoder<'a, W: io::Write>(
    sink: W,
    [columns, rows]: [u32; 2],
    depth: Depth,
    alpha: bool,
) -> io::Result<png::Encoder<'a, W>> {
    let mut encoder = png::Encoder::new(sink, columns, rows);
    encoder.set_color(if alpha { png::ColorType::Rgba } else { png::ColorType::Rgb });
    encoder.set_depth(match depth {
        Depth::Eight => png::BitDepth::Eight,
        Depth::Sixteen => png::BitDepth::Sixteen,
    });
    encoder.set_compression(png::Compression::Fast);
    // Also writes the gAMA and cHRM chunks that the PNG standard recommends for decoders without sRGB support.
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    encoder.add_text_chunk("Software".to_owned(), SOFTWARE.to_owned()).map_err(described)?;
    Ok(encoder)
}

fn described(error: png::EncodingError) -> io::Error {
    match error {
        png::EncodingError::IoError(error) => error,
        other => io::Error::other(other),
    }
}

/// Quantises `value`, 0–1, to the nearest level from 0 to `largest`; NaN becomes 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to `largest` after the clamp, NaN to 0")]
fn level(value: f32, largest: u16) -> u16 {
    value.clamp(0.0, 1.0).mul_add(f32::from(largest), 0.5) as u16
}

/// sRGB encoding of a linear value, 0–1 (IEC 61966-2-1).
fn srgb_from_linear(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055_f32.mul_add(linear.powf(1.0 / 2.4), -0.055) }
}

/// Returns the nearest 8-bit sRGB code of a linear value, without computing a power: searches the thresholds between
/// codes from a tabulated start.
fn code_8(linear: f32) -> u8 {
    let codes = &*CODES;
    let value = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
    let mut code = codes.start[usize::from(level(value, START_STEPS))];
    while code < 255 && value >= codes.threshold[usize::from(code) + 1] {
        code += 1;
    }
    code
}

/// Steps of the start table.
const START_STEPS: u16 = 4096;

/// Tables of [`code_8`].
struct Codes {
    /// Smallest linear value of each code.
    threshold: [f32; 256],
    /// For each step, a code not above that of any value that rounds to the step.
    start: Vec<u8>,
}

static CODES: LazyLock<Codes> = LazyLock::new(|| {
    let mut threshold = [0.0; 256];
    for (value, code) in threshold.iter_mut().skip(1).zip(0_u8..) {
        let encoded = (f64::from(code) + 0.5) / 255.0;
        let linear = if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
        *value = f32_from(linear);
    }
    let first_at = |step: u16| (f64::from(step) - 0.5) / f64::from(START_STEPS);
    let code_at =
        |linear: f64| (1..=255_u8).take_while(|&code| f64::from(threshold[usize::from(code)]) <= linear).last();
    let start = (0..=START_STEPS).map(|step| code_at(first_at(step)).unwrap_or(0)).collect();
    Codes { threshold, start }
});

/// Rounds to single precision.
#[expect(clippy::cast_possible_truncation, reason = "rounding is what is asked for")]
fn f32_from(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_those_of_the_formula() {
        for step in 0..=1_000_000_u32 {
            let linear = f32_from(f64::from(step) / 1e6);
            let exact = f64::from(linear);
            let encoded = if exact <= 0.003_130_8 { exact * 12.92 } else { 1.055 * exact.powf(1.0 / 2.4) - 0.055 };
            let distance = (encoded * 255.0 - f64::from(code_8(linear))).abs();
            assert!(distance <= 0.500_01, "{linear}: {distance} codes away");
        }
    }

    #[test]
    fn values_outside_the_range_clip_and_nan_is_black() {
        let codes = [f32::NAN, f32::NEG_INFINITY, -0.0, 1.0, 2.0, f32::INFINITY].map(code_8);
        assert_eq!(codes, [0, 0, 0, 255, 255, 255]);
        assert_eq!([f32::NAN, -1.0, 0.5, 7.0].map(|value| level(value, u16::MAX)), [0, 0, 32_768, 65_535]);
    }
}
