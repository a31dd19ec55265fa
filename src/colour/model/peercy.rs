//! Peercy's model: products of spectra as k × k matrices in an orthonormal basis (Peercy 1993, "Linear color
//! representations for full spectral rendering").
//!
//! A vector represents the light. Each interaction with a spectrum `s` is a matrix `Mᵢⱼ = Σ eᵢ·s·eⱼ`, the spectrum in
//! the basis. As in every model of this program, the light's own spectrum is applied last, so that vectors represent
//! reflected spectra.

use nalgebra::{DMatrix, DVector};

use super::sharpened::{basis, dual, visual_roots};
use super::{ColourModel, matrix_of};
use crate::spectrum::colour::Xyz;
use crate::spectrum::observer::Observer;
use crate::spectrum::{BANDS, Light, Spectrum};

/// Basis of the first singular vectors of `cloud`, rotated and scaled so that all coefficients of white are 1. A
/// rotation does not change products of matrices.
pub(super) fn projection(cloud: &[Spectrum], dimension: usize) -> Vec<Spectrum> {
    let roots = visual_roots();
    let basis = basis(cloud, &[&Spectrum::constant(1.0)], dimension, &roots);
    let white = basis.transpose() * DVector::from_column_slice(&roots);
    let (length, side) = (white.norm(), relume_base::number::count(dimension).sqrt());
    // Householder reflection of the direction of white onto that of (1, 1, …).
    let mirror = &white / length - DVector::from_element(dimension, side.recip());
    let square = mirror.norm_squared();
    let mut turned = basis;
    if square > 1e-24 {
        let along = &turned * &mirror;
        turned -= along * mirror.transpose() * (2.0 / square);
    }
    let scale = side / length;
    let row =
        |index: usize| Spectrum::from_samples(std::array::from_fn(|band| scale * turned[(band, index)] * roots[band]));
    (0..dimension).map(row).collect()
}

/// XYZ per unit of each component under a light: the colours of the dual basis under that light.
pub(super) fn matrix(projection: &[Spectrum], light: &Light, observer: Observer) -> Vec<[f64; 3]> {
    let dual = dual(projection);
    let of = |index: usize| Spectrum::from_samples(std::array::from_fn(|band| dual[(band, index)]));
    let lit = |index: usize| {
        let Xyz(xyz) = observer.xyz_of(&(light.spectrum() * &of(index)));
        xyz
    };
    (0..projection.len()).map(lit).collect()
}

/// Conversion of spectra to vectors, and to matrices that act on vectors.
#[derive(Clone, Debug, PartialEq)]
pub struct Matrices {
    /// k × 81.
    projection: DMatrix<f64>,
    /// 81 × k.
    dual: DMatrix<f64>,
}

impl Matrices {
    /// Matrices of `model`'s basis.
    #[must_use]
    pub fn new(model: &ColourModel) -> Self {
        Self { projection: matrix_of(model.projection()), dual: dual(model.projection()) }
    }

    /// The k coefficients of a spectrum.
    #[must_use]
    pub fn vector(&self, spectrum: &[f64; BANDS]) -> Vec<f64> {
        (&self.projection * DVector::from_column_slice(spectrum)).as_slice().to_vec()
    }

    /// The k × k matrix, row by row, of the multiplication by `spectrum`.
    #[must_use]
    pub fn matrix(&self, spectrum: &[f64; BANDS]) -> Vec<f64> {
        let mut weighted = self.dual.clone();
        for (mut row, &factor) in weighted.row_iter_mut().zip(spectrum) {
            row *= factor;
        }
        // The transpose column by column is the matrix row by row.
        (&self.projection * weighted).transpose().as_slice().to_vec()
    }
}
