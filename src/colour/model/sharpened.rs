//! Sharpened factor model: a basis of all the light of a scene, transformed so that products are nearly componentwise.
//!
//! A reconstruction of Drew and Finlayson 2003 by sensor sharpening (Finlayson, Drew and Funt 1994): the authors'
//! scaling is not known.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use super::matrix_of;
use crate::spectrum::colour::{OBSERVER, Xyz};
use crate::spectrum::observer::Observer;
use crate::spectrum::{BANDS, Light, Spectrum};

/// Visual weight of each wavelength: (x̄ + ȳ + z̄) / max + 0.02.
fn visual_weights() -> [f64; BANDS] {
    let sums: [f64; BANDS] = std::array::from_fn(|band| OBSERVER.iter().map(|matching| matching.samples()[band]).sum());
    let largest = sums.iter().copied().fold(0.0, f64::max);
    sums.map(|sum| sum / largest + 0.02)
}

/// Square roots of the visual weights, by which spectra are multiplied before comparison.
pub(super) fn visual_roots() -> [f64; BANDS] {
    visual_weights().map(f64::sqrt)
}

/// Rows of the projection for the spectra of `cloud` under `lights`; the coefficients of white are ones.
pub(super) fn projection(cloud: &[Spectrum], lights: &[&Light], dimension: usize) -> Vec<Spectrum> {
    let roots = visual_roots();
    let lights: Vec<&Spectrum> = lights.iter().map(|light| light.spectrum()).collect();
    let basis = basis(cloud, &lights, dimension, &roots);
    let sharpening = sharpening(&basis);
    let inverse = pseudo_inverse(sharpening);
    let rows = inverse * basis.transpose();
    let row = |index: usize| {
        let row = Spectrum::from_samples(std::array::from_fn(|band| rows[(index, band)] * roots[band]));
        let white = row.sum();
        row.scaled(1.0 / if white.abs() < 1e-6 { 1e-6_f64.copysign(white) } else { white })
    };
    (0..dimension).map(row).collect()
}

/// First right singular vectors (81 × k) of all light, with each spectrum scaled to unit norm and visually weighted.
pub(super) fn basis(cloud: &[Spectrum], lights: &[&Spectrum], dimension: usize, roots: &[f64; BANDS]) -> DMatrix<f64> {
    let mut gram = DMatrix::zeros(BANDS, BANDS);
    for light in lights {
        let lit = cloud.iter().map(|spectrum| *light * spectrum);
        let signals: Vec<Spectrum> = lit.chain([(*light).clone()]).collect();
        let mut signals = matrix_of(&signals);
        for mut row in signals.row_iter_mut() {
            let norm = row.norm();
            if norm > 0.0 && norm.is_finite() {
                row /= norm;
            }
        }
        for (band, mut column) in signals.column_iter_mut().enumerate() {
            column *= roots[band];
        }
        gram += signals.transpose() * signals;
    }
    let eigen = SymmetricEigen::new(gram);
    let mut order: Vec<usize> = (0..BANDS).collect();
    order.sort_by(|&one, &two| eigen.eigenvalues[two].total_cmp(&eigen.eigenvalues[one]));
    DMatrix::from_fn(BANDS, dimension, |band, index| eigen.eigenvectors[(band, order[index])])
}

/// One column per wavelength interval of equal leverage: the direction in which the basis is largest there.
fn sharpening(basis: &DMatrix<f64>) -> DMatrix<f64> {
    let dimension = basis.ncols();
    let mut leverage = 0.0;
    let mut grams = vec![DMatrix::<f64>::zeros(dimension, dimension); dimension];
    for row in basis.row_iter() {
        let own = row.norm_squared();
        let interval = relume_base::number::whole(leverage + own / 2.0).min(dimension - 1);
        grams[interval] += row.transpose() * row;
        leverage += own;
    }
    let columns: Vec<DVector<f64>> = grams
        .into_iter()
        .map(|gram| {
            let eigen = SymmetricEigen::new(gram);
            eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned()
        })
        .collect();
    DMatrix::from_columns(&columns)
}

/// XYZ per unit of each component under a light: the colours of the dual basis, each times the light's own coefficient.
pub(super) fn matrix(projection: &[Spectrum], light: &Light, observer: Observer) -> Vec<[f64; 3]> {
    let dual = dual(projection);
    let column = |index: usize| {
        let Xyz(xyz) = observer.xyz_of(&Spectrum::from_samples(std::array::from_fn(|band| dual[(band, index)])));
        xyz.map(|part| part * projection[index].dot(light.spectrum()))
    };
    (0..projection.len()).map(column).collect()
}

/// Dual basis of a projection (81 × k): the projection's coefficients are those of the spectrum in this basis.
pub(super) fn dual(projection: &[Spectrum]) -> DMatrix<f64> {
    let weights = visual_weights();
    let rows = matrix_of(projection);
    let weighted = DMatrix::from_fn(BANDS, projection.len(), |band, row| rows[(row, band)] / weights[band]);
    &weighted * pseudo_inverse(&rows * &weighted)
}

fn pseudo_inverse(matrix: DMatrix<f64>) -> DMatrix<f64> {
    let (rows, columns) = matrix.shape();
    let svd = matrix.svd(true, true);
    let smallest = 1e-13 * svd.singular_values.iter().copied().fold(0.0, f64::max);
    svd.pseudo_inverse(smallest).unwrap_or_else(|_| DMatrix::zeros(columns, rows))
}
