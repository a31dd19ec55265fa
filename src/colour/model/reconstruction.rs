//! Reconstruction of full spectra from a model's coefficients.

use nalgebra::DMatrix;

use super::target::Target;
use super::{ColourModel, ErrorSummary, matrix_of};
use crate::spectrum::{BANDS, Spectrum};
use relume_base::number::count;

/// The 81 × k matrix from coefficients to spectra, fitted by least squares over a model's cloud; the identity for the
/// model of all 81 bands.
#[derive(Clone, Debug)]
pub struct Reconstruction {
    /// Column i: spectrum per unit of component i.
    pub spectra: Vec<Spectrum>,
    /// Root mean square difference of the cloud's samples: reflected light per wavelength, as a fraction of the light
    /// from a white surface.
    pub rms: f64,
    /// ΔE00 of the cloud's reconstructed spectra under each of the model's lights, by name.
    pub errors: Vec<(String, ErrorSummary)>,
}

impl Reconstruction {
    pub(super) fn new(model: &ColourModel) -> Self {
        if model.dimension() == BANDS {
            return Self { spectra: model.projection().to_vec(), rms: 0.0, errors: Vec::new() };
        }
        let (cloud, vectors) = (model.cloud(), model.cloud_vectors());
        let known = matrix_of(cloud);
        let dimension = model.dimension();
        let svd = DMatrix::from_fn(vectors.len(), dimension, |row, column| vectors[row][column]).svd(true, true);
        let smallest = 1e-10 * svd.singular_values.iter().copied().fold(0.0, f64::max);
        let solution = svd.solve(&known, smallest).unwrap_or_else(|_| DMatrix::zeros(dimension, BANDS));
        let row = |row| Spectrum::from_samples(std::array::from_fn(|band| solution[(row, band)]));
        let mut made = Self { spectra: (0..dimension).map(row).collect(), rms: 0.0, errors: Vec::new() };
        let spectra: Vec<Spectrum> = vectors.iter().map(|vector| made.spectrum(vector)).collect();
        let squares = cloud.iter().zip(&spectra).map(|(known, found)| {
            let pairs = known.samples().iter().zip(found.samples());
            pairs.map(|(known, found)| (known - found).powi(2)).sum::<f64>()
        });
        made.rms = (squares.sum::<f64>() / count(cloud.len() * BANDS)).sqrt();
        let lights = model.lights().iter().map(|(name, light, _)| {
            let colours = |spectra| Target::new(spectra, light, model.observer());
            let (target, found) = (colours(cloud), colours(&spectra));
            let errors: Vec<f64> = (found.xyz.iter().enumerate()).map(|(at, &xyz)| target.error(at, xyz)).collect();
            (name.clone(), ErrorSummary::of(&errors))
        });
        made.errors = lights.collect();
        made
    }

    /// Reconstructs the spectrum of the model's k coefficients.
    pub fn spectrum(&self, coefficients: &[f64]) -> Spectrum {
        let parts = self.spectra.iter().zip(coefficients).map(|(spectrum, &part)| spectrum.scaled(part));
        parts.fold(Spectrum::constant(0.0), |sum, part| &sum + &part)
    }
}
