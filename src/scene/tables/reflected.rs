//! Reflectance and radiance spectra that the numbers of a pixel represent.

use crate::Mix;
use crate::film::{Components, Film};
use crate::plan::Transmittance;
use relume_base::parallel;
use relume_colour::model::Reconstruction;
use relume_colour::spectrum::{BANDS, Reflectance, Spectrum};

/// Reflectance spectra per unit of a pixel's accumulators and transmittance.
#[derive(Clone, Debug)]
pub struct Reflected {
    /// Spectrum of each component.
    pub components: Vec<Spectrum>,
    /// Spectrum of the background for each number of the transmittance.
    pub behind: Vec<Spectrum>,
    /// Reconstruction of the spectra, if they are not exact.
    pub reconstruction: Option<Reconstruction>,
}

impl Reflected {
    /// Builds the spectra of `components` in front of `background`. A colour model's spectra are reconstructed by least
    /// squares, which takes a noticeable time.
    #[must_use]
    pub fn new(components: &Components, background: Option<&Reflectance>) -> Self {
        let exact = || background.map(|surface| surface.spectrum().clone()).into_iter().collect();
        match components {
            Components::Surfaces(surfaces) => {
                Self { components: surfaces.clone(), behind: exact(), reconstruction: None }
            }
            Components::Model(model, transmittance) => {
                let made = model.reconstruction();
                let behind = match (transmittance, background) {
                    (Transmittance::Coloured, Some(surface)) => {
                        let parts = model.coefficients(surface.spectrum());
                        made.spectra.iter().zip(parts).map(|(spectrum, part)| spectrum.scaled(part)).collect()
                    }
                    (Transmittance::Mixed, Some(surface)) => {
                        let parts = model.coefficients(surface.spectrum());
                        let row =
                            |spectrum: &Spectrum| parts.iter().map(|&part| spectrum.scaled(part)).collect::<Vec<_>>();
                        made.spectra.iter().flat_map(row).collect()
                    }
                    _ => exact(),
                };
                let components = made.spectra.clone();
                Self { components, behind, reconstruction: Some(made).filter(|_| model.dimension() < BANDS) }
            }
        }
    }

    /// Writes the radiance spectra of the pixels of `film` from `first` on into `spectra`, [`BANDS`] samples a pixel; `under` is what
    /// [`Self::under`] returns.
    #[expect(clippy::cast_possible_truncation, reason = "spectra are stored in f32")]
    pub fn write(under: &[Vec<Spectrum>; 2], film: &Film<f32>, first: usize, spectra: &mut [f32]) {
        let [parts, behind] = under;
        parallel::rows_mut(spectra, BANDS, &|index, radiance: &mut [f32]| {
            let pixel = first + index;
            let mut sum = [0.0; BANDS];
            for (spectra, numbers) in [(parts, &film.accumulators), (behind, &film.transmittance)] {
                for (spectrum, &number) in spectra.iter().zip(numbers.iter().skip(pixel).step_by(film.pixels())) {
                    for (sum, sample) in sum.iter_mut().zip(spectrum.samples()) {
                        *sum += f64::from(number) * sample;
                    }
                }
            }
            radiance.iter_mut().zip(sum).for_each(|(radiance, sum)| *radiance = sum as f32);
        });
    }

    /// Returns the radiance spectra under `mix`: per unit of each accumulator component, position by position, and per
    /// unit of each number of the transmittance.
    #[must_use]
    pub fn under(&self, mix: &Mix, positions: usize) -> [Vec<Spectrum>; 2] {
        let (light_at, all) = mix.light_at(positions);
        let parts = light_at.iter().flat_map(|light| self.components.iter().map(move |component| light * component));
        [parts.collect(), self.behind.iter().map(|surface| &all * surface).collect()]
    }
}
