//! Validated pictures for output.

use super::OutputError;

/// Borrowed picture in linear sRGB (Rec. 709 primaries, D65 white at 1), rows from the top.
///
/// With four samples per pixel, the last is the opacity, 0–1. The colours are premultiplied by it: they show the
/// picture over black.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    width: usize,
    height: usize,
    samples: &'a [f32],
    inputs: Option<u64>,
}

impl<'a> Picture<'a> {
    /// Longest side of a picture, in pixels.
    pub const LARGEST_SIDE: usize = 65_536;

    /// Wraps `width`×`height` pixels with three (R, G, B) or four (R, G, B, opacity) samples each.
    ///
    /// # Errors
    ///
    /// [`OutputError::Size`] and [`OutputError::Shape`].
    pub fn new(width: usize, height: usize, samples: &'a [f32]) -> Result<Self, OutputError> {
        check_samples("a picture", width, height, samples.len())?;
        Ok(Self { width, height, samples, inputs: None })
    }

    /// Stores `digest`, that of everything the picture was made of, in the file; [`super::inputs_of`] reads it.
    #[must_use]
    pub fn made_of(self, digest: u64) -> Self {
        Self { inputs: Some(digest), ..self }
    }

    /// The digest of [`Self::made_of`], as files store it.
    pub(super) fn inputs(&self) -> Option<String> {
        self.inputs.map(|digest| format!("{digest:016x}"))
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
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

/// Refuses invalid sizes, and samples of `what` that are neither three nor four per pixel.
pub(super) fn check_samples(what: &'static str, width: usize, height: usize, found: usize) -> Result<(), OutputError> {
    check_size(width, height)?;
    let pixels = width * height;
    if found == 3 * pixels || found == 4 * pixels {
        return Ok(());
    }
    let expected = format!("{} (RGB) or {} (RGBA)", 3 * pixels, 4 * pixels);
    Err(OutputError::Shape { what, width, height, expected, found })
}

/// Refuses empty pictures, and pictures too large for a file.
pub(super) fn check_size(width: usize, height: usize) -> Result<(), OutputError> {
    let largest = Picture::LARGEST_SIDE;
    if (1..=largest).contains(&width) && (1..=largest).contains(&height) {
        Ok(())
    } else {
        Err(OutputError::Size { width, height, largest })
    }
}
