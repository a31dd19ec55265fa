//! A film in memory, ready to be relit and written again.

use std::path::Path;

use super::Dial;
use crate::annotate::Frame;
use crate::output::OutputError;
use crate::output::film::{Components, FilmFile, Stored};
use relume_colour::spectrum::Spectrum;
use relume_scene::Mix;
use relume_scene::film::{Film, RelightMatrices, Relightable};

/// A film with all that relighting needs: of a march, or of a file.
#[derive(Clone, Debug)]
pub struct KeptFilm {
    /// The film file without the numbers of the pixels.
    pub header: FilmFile,
    /// The numbers of the pixels.
    pub film: Film<f32>,
    /// Their meaning.
    pub means: Relightable,
    /// Names of the light positions.
    pub positions: Vec<String>,
    /// All lights with their intensities in the scene.
    pub mix: Mix,
    /// Lights of the saved picture, with their weights in it.
    pub shown: Mix,
    /// The light dial.
    pub dial: Dial,
    /// Scale and orientation, if the film states them.
    pub frame: Option<Frame>,
    /// Names and reflectances of the materials; empty with a colour model.
    pub materials: Vec<(String, Spectrum)>,
    /// Largest ΔE00 allowed for a light that is not in the film; infinite where any light is exact.
    pub tolerance: f64,
}

impl KeptFilm {
    /// The film of `file`, whose numbers are moved, not copied.
    ///
    /// # Errors
    ///
    /// [`OutputError::Inconsistent`] if a spectrum is not finite.
    pub fn new(mut file: FilmFile) -> Result<Self, OutputError> {
        let film = file.take_film();
        if file.part.is_none() {
            file.expose(&film)?;
        }
        let tolerance = match &file.components {
            Components::Surfaces(_) => f64::INFINITY,
            Components::Model(Stored { tolerance, .. }) => *tolerance,
        };
        Ok(Self {
            film,
            means: file.relightable()?,
            positions: file.positions.iter().map(|position| position.name.clone()).collect(),
            mix: file.stated()?,
            shown: file.opening()?,
            dial: Dial::of_film(&file),
            frame: file.scale(),
            materials: file.materials(),
            tolerance,
            header: file,
        })
    }

    /// The relight matrices under `mix`.
    #[must_use]
    pub fn matrices(&self, mix: &Mix) -> RelightMatrices {
        self.means.under(mix)
    }

    /// The linear picture under `mix`: RGB and opacity.
    #[must_use]
    pub fn relight(&self, mix: &Mix) -> Vec<f32> {
        self.film.rgba(&self.matrices(mix))
    }

    /// The film of some evenly spread pixels that show the volume.
    #[must_use]
    pub fn visible(&self) -> Film<f32> {
        const MOST: usize = 1024;
        let opacity = self.film.opacity(&self.matrices(&self.mix));
        let shown: Vec<usize> = (0..opacity.len()).filter(|&pixel| opacity[pixel] > 0.01).collect();
        let step = shown.len().div_ceil(MOST).max(1);
        self.film.of_pixels(&shown.into_iter().step_by(step).collect::<Vec<_>>())
    }

    /// Writes the film file.
    ///
    /// # Errors
    ///
    /// Those of [`FilmFile::write`].
    pub fn write(&self, path: &Path) -> Result<(), OutputError> {
        self.header.write_with(&self.film, path)
    }

    /// The bytes of the film file.
    ///
    /// # Errors
    ///
    /// Those of [`FilmFile::to_bytes`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, OutputError> {
        self.header.to_bytes_with(&self.film)
    }
}
