//! Smoothest reflectance of a given colour.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use nalgebra::{DMatrix, DVector, Vector3};

use super::colour::{LinearSrgb, OBSERVER, xyz_from_linear_srgb};
use super::{BANDS, Reflectance, Spectrum, SpectrumError, standard};

/// Returns the smoothest reflectance between 0 and 1 with this colour under D65, to 1e-9 in XYZ.
///
/// The reflectance is (tanh z + 1) / 2, where z has the least sum of squared slopes (the "least hyperbolic tangent
/// slope squared" of Burns 2020, Color Research and Application 45, 8); it is strictly inside 0 and 1 up to rounding.
/// Two colours without a curve of this form have exact constants instead: (0, 0, 0), all zeros; and (1, 1, 1), all
/// ones, whose colour is D65's white on the grid, within 1.2e-4 of (1, 1, 1).
///
/// # Errors
///
/// [`SpectrumError::Unattainable`] when no reflectance between 0 and 1 has the colour, or only one that is nearly
/// everywhere 0 or 1.
pub fn smooth_reflectance(colour: LinearSrgb) -> Result<Reflectance, SpectrumError> {
    let key = colour.0.map(f64::to_bits);
    // A lock that a panic has left holds whole entries.
    let solved = || SOLVED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(known) = solved().get(&key) {
        return Ok(known.clone());
    }
    let found = solve(colour)?;
    let mut solved = solved();
    if solved.len() >= MOST_SOLVED {
        solved.clear();
    }
    solved.insert(key, found.clone());
    Ok(found)
}

/// Reflectances that were solved, by colour: labels share colours, and a scene states each of them several times.
static SOLVED: Mutex<BTreeMap<[u64; 3], Reflectance>> = Mutex::new(BTreeMap::new());
/// Most of them.
const MOST_SOLVED: usize = 4096;

/// As [`smooth_reflectance`], anew.
fn solve(colour: LinearSrgb) -> Result<Reflectance, SpectrumError> {
    for constant in [0.0, 1.0] {
        if colour.0.iter().all(|&part| (part - constant).abs() <= 1e-12) {
            return Reflectance::new(Spectrum::constant(constant));
        }
    }
    let unattainable = || SpectrumError::Unattainable { linear_srgb: colour.0 };
    let target = Vector3::from(xyz_from_linear_srgb(colour).0);
    let luminance = target.y;
    if !(target.iter().all(|part| part.is_finite()) && luminance > 0.0 && luminance < 1.0) {
        return Err(unattainable());
    }
    // Continuation: starts at the constant curve, the grey of the same luminance, and approaches the colour in steps
    // small enough for Newton's method.
    let colours = colours_of_bands();
    let grey = &colours * DVector::from_element(BANDS, luminance);
    let mut curve = Iterate::grey(luminance);
    let (mut done, mut step) = (0.0_f64, 1.0_f64);
    while done < 1.0 {
        let next = (done + step).min(1.0);
        let between = Vector3::from_fn(|axis, _| grey[axis] + next * (target[axis] - grey[axis]));
        if let Some(found) = curve.bent_to(&colours, &between) {
            (curve, done, step) = (found, next, 2.0 * step);
        } else {
            step /= 2.0;
            if step < 1e-3 {
                return Err(unattainable());
            }
        }
    }
    let reflectance = curve.reflectance();
    Reflectance::new(Spectrum::from_samples(std::array::from_fn(|band| reflectance[band])))
}

/// XYZ under D65 of a reflectance of 1 in one band; one column per band.
fn colours_of_bands() -> DMatrix<f64> {
    let light = standard::d65().spectrum().samples();
    DMatrix::from_fn(3, BANDS, |axis, band| OBSERVER[axis].samples()[band] * light[band])
}

/// State of Newton's method on the Lagrangian `|D z|² / 2 + λ · (colour(z) − target)`.
#[derive(Clone)]
struct Iterate {
    z: DVector<f64>,
    multipliers: Vector3<f64>,
}

impl Iterate {
    fn grey(value: f64) -> Self {
        Self { z: DVector::from_element(BANDS, (2.0 * value - 1.0).atanh()), multipliers: Vector3::zeros() }
    }

    fn reflectance(&self) -> DVector<f64> {
        // (tanh z + 1) / 2, without cancellation for dark colours.
        self.z.map(|z| 1.0 / (1.0 + (-2.0 * z).exp()))
    }

    /// Runs Newton's method from this curve to the smoothest curve of colour `target`; `None` if it does not converge.
    fn bent_to(&self, colours: &DMatrix<f64>, target: &Vector3<f64>) -> Option<Self> {
        let mut curve = self.clone();
        for _ in 0..25 {
            let reflectance = curve.reflectance();
            let slope = reflectance.map(|r| 2.0 * r * (1.0 - r));
            let bend = reflectance.zip_map(&slope, |r, slope| 2.0 * slope * (1.0 - 2.0 * r));
            let pull = colours.tr_mul(&curve.multipliers);
            let missing = target - colours * &reflectance;

            let mut system = DMatrix::zeros(BANDS + 3, BANDS + 3);
            let mut right = DVector::zeros(BANDS + 3);
            for band in 0..BANDS {
                system[(band, band)] += bend[band] * pull[band];
                right[band] -= slope[band] * pull[band];
                if band > 0 {
                    let difference = curve.z[band] - curve.z[band - 1];
                    right[band] -= difference;
                    right[band - 1] += difference;
                    system[(band, band)] += 1.0;
                    system[(band - 1, band - 1)] += 1.0;
                    system[(band, band - 1)] -= 1.0;
                    system[(band - 1, band)] -= 1.0;
                }
                for axis in 0..3 {
                    system[(band, BANDS + axis)] = colours[(axis, band)] * slope[band];
                    system[(BANDS + axis, band)] = system[(band, BANDS + axis)];
                }
            }
            for axis in 0..3 {
                right[BANDS + axis] = missing[axis];
            }
            let change = system.lu().solve(&right)?;
            curve.z += change.rows(0, BANDS);
            curve.multipliers += change.rows(BANDS, 3);
            // `all`, because `amax` ignores NaN.
            let moved_at_most = |limit: f64| change.rows(0, BANDS).iter().all(|part| part.abs() <= limit);
            if !moved_at_most(10.0) {
                return None;
            }
            if moved_at_most(1e-9) && missing.iter().all(|part| part.abs() <= 1e-12) {
                return Some(curve);
            }
        }
        None
    }
}
