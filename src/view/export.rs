//! Pictures and accumulators on their way to files, beside the window.

use std::path::Path;

use crate::document::State;
use crate::film::RelightMatrices;
use crate::output::{self, OutputError, Picture, PictureKind, write_exr, write_ready_png};
use crate::render::{DeviceFilm, RenderError, Renderer};

/// Why a picture, or what it is made of, could not be saved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// The device.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The file.
    #[error(transparent)]
    Output(#[from] OutputError),
}

/// What a picture is made of. What the window goes on with changes nothing of it.
#[derive(Debug)]
pub struct Snapshot {
    pub(super) renderer: Renderer,
    pub(super) accumulators: DeviceFilm,
    pub(super) matrices: RelightMatrices,
}

impl Snapshot {
    /// Pixels across and down.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        self.accumulators.size
    }

    /// Writes the picture to `path`: the PNG that is shown, or linear OpenEXR, by its extension.
    ///
    /// # Errors
    ///
    /// [`ExportError`]; then `path` is what it was.
    pub fn write_picture(&self, path: &Path) -> Result<(), ExportError> {
        let [width, height] = self.accumulators.size;
        match PictureKind::of(path)? {
            PictureKind::Exr => {
                let relight = self.renderer.relight_linear(&self.accumulators)?;
                relight.run(&self.matrices)?;
                Ok(write_exr(path, &Picture::new(width, height, &relight.read::<f32>()?)?)?)
            }
            PictureKind::Png => {
                let relight = self.renderer.relight_display(&self.accumulators)?;
                relight.run(&self.matrices)?;
                let pixels: Vec<[u8; 4]> = relight.read()?;
                Ok(write_rgba(path, [width, height], pixels.as_flattened())?)
            }
        }
    }

    /// Writes what the march of `scene`, mixed as it opens, has left: the accumulator file of
    /// [`output::film`].
    ///
    /// # Errors
    ///
    /// [`ExportError`]; then `path` is what it was.
    pub fn write_accumulators(&self, state: &State, path: &Path) -> Result<(), ExportError> {
        PictureKind::require_exr(path)?;
        let accumulation = self.renderer.read(&self.accumulators)?;
        let planned = &self.accumulators.planned;
        Ok(output::FilmFile::of_march(&state.scene, planned, &state.mix(), (&state.dial).into(), accumulation)?
            .write(path)?)
    }
}

/// Writes a PNG of RGBA pixels, without their opacity.
///
/// # Errors
///
/// [`OutputError`].
pub fn write_rgba(path: &Path, size: [usize; 2], pixels: &[u8]) -> Result<(), OutputError> {
    let rgb: Vec<u8> = pixels.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    write_ready_png(path, size[0], size[1], &rgb)
}
