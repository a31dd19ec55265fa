//! Pictures as linear OpenEXR files with opacity.

use std::path::Path;

use super::channels::{self, Part, Target};
use super::inputs::INPUTS;
use super::{OutputError, Picture};

/// Writes `picture` to `path` unchanged: 32-bit float channels R, G, B and, with four samples per pixel, A (the
/// opacity, by which the colours are premultiplied, as in OpenEXR), with the primaries of sRGB as attribute.
///
/// # Errors
///
/// Same as [`super::write_atomically`].
pub fn write_exr(path: &Path, picture: &Picture<'_>) -> Result<(), OutputError> {
    let (width, channels) = (picture.width(), picture.channels());
    let names: Vec<String> = ["R", "G", "B", "A"].iter().take(channels).map(|&name| name.to_owned()).collect();
    let inputs = picture.inputs();
    let attributes: Vec<(&str, &str)> = inputs.iter().map(|digest| (INPUTS, digest.as_str())).collect();
    let part = Part { name: None, size: (width, picture.height()), channels: &names, attributes: &attributes };
    channels::write(Target::File(path), &[part], |_, first, data| {
        let samples = &picture.samples()[first * width * channels..][..data.len()];
        for (line, pixels) in data.chunks_exact_mut(width * channels).zip(samples.chunks_exact(width * channels)) {
            for (channel, values) in line.chunks_exact_mut(width).enumerate() {
                for (value, pixel) in values.iter_mut().zip(pixels.chunks_exact(channels)) {
                    *value = pixel[channel];
                }
            }
        }
    })
}
