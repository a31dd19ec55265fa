//! A picture on its way to a file.

use super::OutputError;

/// A picture in linear sRGB (Rec. 709 primaries, D65 white at 1), rows from the top, borrowed.
///
/// With four samples per pixel the last is the opacity, 0–1, and the colours are premultiplied by it: they are what the
/// picture shows over black.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    width: usize,
    height: usize,
    samples: &'a [f32],
}

impl<'a> Picture<'a> {
    /// The longest side of a picture, in pixels.
    pub const LARGEST_SIDE: usize = 65_536;

    /// A picture of `width`×`height` pixels with three (R, G, B) or four (R, G, B, opacity) samples each.
    ///
    /// # Errors
    ///
    /// [`OutputError::Size`] and [`OutputError::Shape`].
    pub fn new(width: usize, height: usize, samples: &'a [f32]) -> Result<Self, OutputError> {
        check_samples("a picture", width, height, samples.len())?;
        Ok(Self { width, height, samples })
    }

    /// Pixels across.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels down.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Samples per pixel: 3 or 4.
    pub fn channels(&self) -> usize {
        self.samples.len() / (self.width * self.height)
    }

    /// All samples, pixel by pixel.
    pub fn samples(&self) -> &'a [f32] {
        self.samples
    }
}

/// Refuses sizes that no picture has, and samples of `what` that are neither three nor four per pixel.
pub(super) fn check_samples(what: &'static str, width: usize, height: usize, found: usize) -> Result<(), OutputError> {
    check_size(width, height)?;
    let pixels = width * height;
    if found == 3 * pixels || found == 4 * pixels {
        return Ok(());
    }
    let expected = format!("{} (RGB) or {} (RGBA)", 3 * pixels, 4 * pixels);
    Err(OutputError::Shape { what, width, height, expected, found })
}

/// Refuses pictures without pixels and those too large for a file.
pub(super) fn check_size(width: usize, height: usize) -> Result<(), OutputError> {
    let largest = Picture::LARGEST_SIDE;
    if (1..=largest).contains(&width) && (1..=largest).contains(&height) {
        Ok(())
    } else {
        Err(OutputError::Size { width, height, largest })
    }
}
