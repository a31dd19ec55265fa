//! Selection of the nodes of a colour model: products, exponentials and powers are exact at each node.

use nalgebra::DMatrix;
use rayon::prelude::*;

use super::ModelError;
use super::lawson::{self, inverse_root};
use super::target::{Target, applied};
use crate::spectrum::{BANDS, Spectrum};
use relume_base::progress::Progress;

const ROUNDS: u64 = 3;
const SWEEPS: usize = 12;
/// Added to the diagonal of normal equations that are scaled to a diagonal of ones.
const RIDGE: f64 = 1e-9;
/// Rows and columns of the normal equations over all candidates: X, Y and Z of each band.
const SIZE: usize = 3 * BANDS;

/// Selects the bands, ascending, whose samples best determine the colours of `targets`.
///
/// Each round selects bands by weighted least squares, first greedily and then by exchanges, and reweights the spectra
/// by their errors in the fit with these bands. The best round is kept. The search ends when the largest error after a
/// round exceeds `hopeless`.
pub(super) fn select(
    spectra: &[Spectrum],
    targets: &[Target],
    dimension: usize,
    hopeless: f64,
    progress: &dyn Progress,
) -> Result<Vec<usize>, ModelError> {
    let mut weights = vec![vec![1.0; spectra.len()]; targets.len()];
    let mut chosen: Vec<usize> = Vec::new();
    let mut best: Option<(f64, Vec<usize>)> = None;
    let samples = DMatrix::from_fn(BANDS, spectra.len(), |band, index| spectra[index].samples()[band]);
    let transposed = samples.transpose();
    let forms: Vec<Vec<[f64; 6]>> = targets.par_iter().map(Target::forms).collect();
    for round in 0..ROUNDS {
        progress.report("fitting the colour model", round, ROUNDS);
        if progress.cancelled() {
            return Err(ModelError::Cancelled);
        }
        let candidates: Vec<Candidates> = (targets.par_iter().zip(&forms).zip(&weights))
            .map(|((target, forms), weights)| Candidates::new(&samples, &transposed, target, forms, weights))
            .collect();
        if chosen.is_empty() {
            chosen = greedy(&candidates, dimension);
        }
        exchange(&candidates, &mut chosen);
        let mut bands = chosen.clone();
        bands.sort_unstable();
        let vectors = sampled(spectra, &bands);
        let fits: Vec<lawson::Fitted> = (targets.par_iter().zip(&forms))
            .map(|(target, forms)| lawson::fit(&vectors, dimension, target, forms))
            .collect();
        let score = fits.iter().map(|fit| fit.error.score()).sum();
        if best.as_ref().is_none_or(|(least, _)| score < *least) {
            best = Some((score, bands));
        }
        let worst = fits.iter().map(|fit| fit.error.max).fold(0.0, f64::max);
        if worst > hopeless || worst <= 1e-6 {
            break;
        }
        weights = fits.into_iter().map(|fit| fit.weights).collect();
    }
    progress.report("fitting the colour model", ROUNDS, ROUNDS);
    Ok(best.map_or(chosen, |(_, bands)| bands))
}

/// Samples of each spectrum at `bands`.
pub(super) fn sampled(spectra: &[Spectrum], bands: &[usize]) -> Vec<Vec<f64>> {
    spectra.iter().map(|spectrum| bands.iter().map(|&band| spectrum.samples()[band]).collect()).collect()
}

/// Weighted normal equations of one light over all bands, scaled to a diagonal of ones, with the ridge.
struct Candidates {
    /// `SIZE` × `SIZE`, symmetric; X, Y and Z of band `p` are 3p, 3p + 1 and 3p + 2.
    system: Vec<f64>,
    right: Vec<f64>,
    /// Weighted sum of squares to explain.
    total: f64,
}

impl Candidates {
    /// `samples` has one column per spectrum.
    fn new(
        samples: &DMatrix<f64>,
        transposed: &DMatrix<f64>,
        target: &Target,
        forms: &[[f64; 6]],
        weights: &[f64],
    ) -> Self {
        const PLACES: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];
        let mut system = vec![0.0; SIZE * SIZE];
        for (part, (a, b)) in PLACES.into_iter().enumerate() {
            let mut weighted = samples.clone();
            for (index, mut column) in weighted.column_iter_mut().enumerate() {
                column *= weights[index] * forms[index][part];
            }
            let product = weighted * transposed;
            for p in 0..BANDS {
                for q in 0..BANDS {
                    system[(3 * p + a) * SIZE + 3 * q + b] = product[(p, q)];
                    system[(3 * p + b) * SIZE + 3 * q + a] = product[(p, q)];
                }
            }
        }
        let mut right = vec![0.0; SIZE];
        let mut total = 0.0;
        for (index, column) in samples.column_iter().enumerate() {
            let pull = applied(&forms[index], target.xyz[index]).map(|part| part * weights[index]);
            total += (0..3).map(|axis| pull[axis] * target.xyz[index][axis]).sum::<f64>();
            for (right, sample) in right.as_chunks_mut::<3>().0.iter_mut().zip(column.iter()) {
                for axis in 0..3 {
                    right[axis] += pull[axis] * sample;
                }
            }
        }
        let scale: Vec<f64> = (0..SIZE).map(|row| inverse_root(system[row * SIZE + row])).collect();
        for (row, values) in system.chunks_exact_mut(SIZE).enumerate() {
            for (value, column_scale) in values.iter_mut().zip(&scale) {
                *value *= scale[row] * column_scale;
            }
            values[row] += RIDGE;
            right[row] *= scale[row];
        }
        Self { system, right, total }
    }
}

/// Cholesky elimination of bands from the normal equations of one light, with the remainder for the other bands.
struct Elimination<'a> {
    of: &'a Candidates,
    /// One row of the factor per eliminated equation, over all columns.
    rows: Vec<Vec<f64>>,
    /// Remainder of the right-hand side.
    right: Vec<f64>,
    /// Remainder of each band's diagonal block: 00, 10, 11, 20, 21, 22.
    blocks: Vec<[f64; 6]>,
    /// Part of the total explained by the eliminated bands.
    explained: f64,
}

impl<'a> Elimination<'a> {
    fn new(of: &'a Candidates) -> Self {
        let block = |band: usize| {
            let at = |row: usize, column: usize| of.system[(3 * band + row) * SIZE + 3 * band + column];
            [at(0, 0), at(1, 0), at(1, 1), at(2, 0), at(2, 1), at(2, 2)]
        };
        let blocks = (0..BANDS).map(block).collect();
        Self { of, rows: Vec::new(), right: of.right.clone(), blocks, explained: 0.0 }
    }

    fn eliminate(&mut self, band: usize) {
        for pivot in 3 * band..3 * band + 3 {
            let mut row = self.of.system[pivot * SIZE..(pivot + 1) * SIZE].to_vec();
            for earlier in &self.rows {
                let factor = earlier[pivot];
                for (value, earlier) in row.iter_mut().zip(earlier) {
                    *value -= factor * earlier;
                }
            }
            let square = row[pivot];
            if !is_pivot(square) {
                continue;
            }
            let inverse = 1.0 / square.sqrt();
            let value = self.right[pivot] * inverse;
            self.explained += value * value;
            for (entry, right) in row.iter_mut().zip(&mut self.right) {
                *entry *= inverse;
                *right -= *entry * value;
            }
            for (block, entry) in self.blocks.iter_mut().zip(row.as_chunks::<3>().0) {
                let [x, y, z] = *entry;
                for (part, product) in block.iter_mut().zip([x * x, y * x, y * y, z * x, z * y, z * z]) {
                    *part -= product;
                }
            }
            self.rows.push(row);
        }
    }

    /// Part of the remainder that `band` would explain.
    fn gain(&self, band: usize) -> f64 {
        let [b00, b10, b11, b20, b21, b22] = self.blocks[band];
        let right = &self.right[3 * band..3 * band + 3];
        let root = |square: f64| if is_pivot(square) { 1.0 / square.sqrt() } else { 0.0 };
        let i0 = root(b00);
        let (l10, l20) = (b10 * i0, b20 * i0);
        let i1 = root(b11 - l10 * l10);
        let l21 = (b21 - l20 * l10) * i1;
        let i2 = root(b22 - l20 * l20 - l21 * l21);
        let v0 = right[0] * i0;
        let v1 = (right[1] - l10 * v0) * i1;
        let v2 = (right[2] - l20 * v0 - l21 * v1) * i2;
        v0 * v0 + v1 * v1 + v2 * v2
    }
}

/// Whether a diagonal entry is large enough to divide by; thanks to the ridge, only rounding errors are not.
fn is_pivot(square: f64) -> bool {
    square > RIDGE / 100.0
}

/// Band outside `taken` with the largest gain over all lights, and the gain.
fn best_gain(eliminations: &[Elimination<'_>], taken: &[usize]) -> Option<(usize, f64)> {
    let free = (0..BANDS).filter(|band| !taken.contains(band));
    let gains = free.map(|band| (band, total_gain(eliminations, band)));
    gains.reduce(|best, next| if next.1 > best.1 { next } else { best })
}

fn total_gain(eliminations: &[Elimination<'_>], band: usize) -> f64 {
    eliminations.iter().map(|elimination| elimination.gain(band)).sum()
}

fn greedy(candidates: &[Candidates], dimension: usize) -> Vec<usize> {
    let mut eliminations: Vec<Elimination<'_>> = candidates.iter().map(Elimination::new).collect();
    let mut chosen = Vec::with_capacity(dimension);
    while chosen.len() < dimension {
        let Some((band, _)) = best_gain(&eliminations, &chosen) else { break };
        eliminations.par_iter_mut().for_each(|elimination| elimination.eliminate(band));
        chosen.push(band);
    }
    chosen
}

/// Replaces single bands by better ones until none is found, for at most [`SWEEPS`] sweeps.
fn exchange(candidates: &[Candidates], chosen: &mut [usize]) {
    let total: f64 = candidates.iter().map(|candidates| candidates.total).sum();
    for _ in 0..SWEEPS {
        let mut changed = false;
        for place in 0..chosen.len() {
            let others: Vec<usize> =
                (chosen.iter().enumerate()).filter(|&(at, _)| at != place).map(|(_, &b)| b).collect();
            let eliminated = |candidates| {
                let mut elimination = Elimination::new(candidates);
                others.iter().for_each(|&band| elimination.eliminate(band));
                elimination
            };
            let eliminations: Vec<Elimination<'_>> = candidates.par_iter().map(eliminated).collect();
            let kept = total_gain(&eliminations, chosen[place]);
            let cost = total - kept - eliminations.iter().map(|elimination| elimination.explained).sum::<f64>();
            // Gains below the second bound are rounding errors.
            let worthwhile = (1e-6 * cost).max(1e-13 * total);
            if let Some((band, gain)) = best_gain(&eliminations, &others)
                && gain - kept > worthwhile
            {
                chosen[place] = band;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
}
