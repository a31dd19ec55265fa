//! Fit of the matrix from coefficients to colours that keeps the largest error small.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::target::{ErrorSummary, Target, applied, colour};
use relume_base::number::count;

const ITERATIONS: usize = 15;
/// Added to the diagonal of normal equations that are scaled to a diagonal of ones.
const RIDGE: f64 = 1e-9;

/// A fitted matrix with its errors.
pub(super) struct Fitted {
    /// Column i: XYZ per unit of component i.
    pub(super) matrix: Vec<[f64; 3]>,
    /// Errors of the matrix over the cloud of the fit.
    pub(super) error: ErrorSummary,
    /// Weights of the cloud's spectra after the last iteration, with a mean of 1; large where the fit is hard.
    pub(super) weights: Vec<f64>,
}

/// Fits `W` to `target` on `vectors` (one k-vector per colour) by least squares in ΔE00, reweighted in each iteration
/// towards large errors (Lawson 1961). Keeps the best iteration.
///
/// `forms` are [`Target::forms`]. Each iteration corrects the previous matrix, so that the ridge leaves no bias: the
/// errors vanish for colours that k coefficients represent exactly.
pub(super) fn fit(vectors: &[Vec<f64>], dimension: usize, target: &Target, forms: &[[f64; 6]]) -> Fitted {
    let mut weights = vec![1.0; vectors.len()];
    let mut matrix = vec![[0.0; 3]; dimension];
    let mut best: Option<(f64, Vec<[f64; 3]>, ErrorSummary)> = None;
    for _ in 0..ITERATIONS {
        let Some(change) = correction(vectors, &matrix, &weights, target, forms) else { break };
        for (column, change) in matrix.iter_mut().zip(change) {
            for axis in 0..3 {
                column[axis] += change[axis];
            }
        }
        let errors = target.errors(vectors, &matrix);
        let error = ErrorSummary::of(&errors);
        if best.as_ref().is_none_or(|(score, ..)| error.score() < *score) {
            best = Some((error.score(), matrix.clone(), error));
        }
        // No errors to reweight by.
        if !error.mean.is_finite() || error.max <= 1e-9 {
            break;
        }
        for (weight, error_here) in weights.iter_mut().zip(&errors) {
            *weight *= 0.5 + 0.5 * error_here / error.mean;
        }
        let mean = weights.iter().sum::<f64>() / count(weights.len());
        for weight in &mut weights {
            *weight = (*weight / mean).clamp(1e-3, 50.0);
        }
    }
    match best {
        Some((_, matrix, error)) => Fitted { matrix, error, weights },
        None => {
            let matrix = vec![[0.0; 3]; dimension];
            let error = ErrorSummary::of(&target.errors(vectors, &matrix));
            Fitted { matrix, error, weights }
        }
    }
}

/// Change of `matrix` for the least weighted sum of squared differences; `None` if it is not finite.
fn correction(
    vectors: &[Vec<f64>],
    matrix: &[[f64; 3]],
    weights: &[f64],
    target: &Target,
    forms: &[[f64; 6]],
) -> Option<Vec<[f64; 3]>> {
    let dimension = matrix.len();
    // Blocks (p, q), q ≤ p, each the six entries of a symmetric 3×3 matrix.
    let mut blocks = vec![[0.0; 6]; dimension * (dimension + 1) / 2];
    let mut right = vec![[0.0; 3]; dimension];
    for (index, vector) in vectors.iter().enumerate() {
        let form = forms[index].map(|part| part * weights[index]);
        let model = colour(matrix, vector);
        let missing = std::array::from_fn(|axis| target.xyz[index][axis] - model[axis]);
        let pull = applied(&form, missing);
        let mut block = blocks.iter_mut();
        for (p, &component) in vector.iter().enumerate() {
            for axis in 0..3 {
                right[p][axis] += component * pull[axis];
            }
            let scaled = form.map(|part| part * component);
            for (&other, block) in vector[..=p].iter().zip(&mut block) {
                for (sum, part) in block.iter_mut().zip(&scaled) {
                    *sum += part * other;
                }
            }
        }
    }
    const PLACES: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
    let at = |row: usize, column: usize| {
        let (p, q) = (row / 3, column / 3);
        let (p, q) = (p.max(q), p.min(q));
        blocks[p * (p + 1) / 2 + q][PLACES[row % 3][column % 3]]
    };
    let size = 3 * dimension;
    let scale: Vec<f64> = (0..size).map(|row| inverse_root(at(row, row))).collect();
    let system = DMatrix::from_fn(size, size, |row, column| {
        let ridge = if row == column { RIDGE } else { 0.0 };
        scale[row].mul_add(at(row, column) * scale[column], ridge)
    });
    let right = DVector::from_fn(size, |row, _| scale[row] * right[row / 3][row % 3]);
    let change = Cholesky::new(system)?.solve(&right);
    let change: Vec<[f64; 3]> = (0..dimension)
        .map(|component| std::array::from_fn(|axis| change[3 * component + axis] * scale[3 * component + axis]))
        .collect();
    change.iter().flatten().all(|part| part.is_finite()).then_some(change)
}

/// 1/√`square`, or 1 if `square` is not positive and finite.
pub(super) fn inverse_root(square: f64) -> f64 {
    if square > 0.0 && square.is_finite() { 1.0 / square.sqrt() } else { 1.0 }
}
