//! Export of pictures, film files and pages in the background.

use std::path::Path;

use crate::document::State;
use crate::film::RelightMatrices;
use crate::output::page::{self, Page, PageError, Summary};
use crate::output::{FilmFile, OutputError, Picture, PictureKind, write_exr, write_ready_png};
use crate::progress::Progress;
use crate::render::{DeviceFilm, RenderError, Renderer};

/// Reason why a picture, film file or page could not be saved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ExportError {
    /// Error of the device.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Error of the file.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Error of the page.
    #[error(transparent)]
    Page(#[from] PageError),
}

impl ExportError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Render(error) => error.code(),
            Self::Output(error) => error.code(),
            Self::Page(error) => error.code(),
        }
    }
}

/// Film and relight matrices of one picture. Later work of the window does not change them.
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

    /// Writes the picture to `path`, by its extension: PNG as shown, or linear OpenEXR.
    ///
    /// # Errors
    ///
    /// [`ExportError`]; `path` is then unchanged.
    pub fn write_picture(&self, path: &Path) -> Result<(), ExportError> {
        let [width, height] = self.accumulators.size;
        match PictureKind::of(path)? {
            PictureKind::Exr => {
                let relight = self.renderer.relight_linear(&self.accumulators)?;
                relight.run(&self.matrices)?;
                Ok(write_exr(path, &Picture::new(width, height, &relight.read::<f32>()?)?)?)
            }
            PictureKind::Png => {
                let relight = self.renderer.relight_display_over(&self.accumulators, self.matrices.backdrop)?;
                relight.run(&self.matrices)?;
                let pixels: Vec<[u8; 4]> = relight.read()?;
                Ok(write_rgba(path, [width, height], pixels.as_flattened())?)
            }
        }
    }

    /// Writes the film, with the scene, mix and dial of `state`, as a film file of [`crate::output::film`].
    ///
    /// # Errors
    ///
    /// [`ExportError`]; `path` is then unchanged.
    pub fn write_accumulators(&self, state: &State, path: &Path) -> Result<(), ExportError> {
        PictureKind::require_exr(path)?;
        Ok(self.film(state)?.write(path)?)
    }

    /// Writes the film, with the scene, mix and dial of `state`, as a page that relights in a browser.
    ///
    /// # Errors
    ///
    /// [`ExportError`]; `path` is then unchanged.
    pub fn write_page(&self, state: &State, path: &Path, progress: &dyn Progress) -> Result<Summary, ExportError> {
        page::check_name(path)?;
        let mut film = self.film(state)?;
        let views = [film.take_film()];
        let (title, tolerance) = (page::TITLE, page::TOLERANCE);
        let packed = Page { film: &film, views: &views, columns: 1, title, tolerance }.packed(progress)?;
        packed.write(path)?;
        Ok(packed.summary)
    }

    /// The film with the scene, mix and dial of `state`.
    fn film(&self, state: &State) -> Result<FilmFile, ExportError> {
        let accumulation = self.renderer.read(&self.accumulators)?;
        let planned = &self.accumulators.planned;
        let dial = state.light.dial_of_film(&state.dial);
        Ok(FilmFile::of_march(&state.scene, planned, &state.mix(), dial, accumulation)?)
    }
}

/// Writes RGBA pixels as a PNG without alpha.
///
/// # Errors
///
/// [`OutputError`].
pub fn write_rgba(path: &Path, size: [usize; 2], pixels: &[u8]) -> Result<(), OutputError> {
    let rgb: Vec<u8> = pixels.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
    write_ready_png(path, size[0], size[1], &rgb)
}
