//! Exact colours of a cloud of spectra under a light, and the errors of a model's colours.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::spectrum::colour::{Lab, Xyz, ciede2000, d65_white, lab_from_xyz};
use crate::spectrum::metric::quadratic_form;
use crate::spectrum::observer::Observer;
use crate::spectrum::{Light, Spectrum};
use relume_base::number::{count, whole};

/// Summary of colour errors in ΔE00.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ErrorSummary {
    /// Mean.
    pub mean: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Maximum.
    pub max: f64,
}

impl ErrorSummary {
    /// Summary of `errors`; zeros if there are none. NaN counts as infinite.
    pub fn of(errors: &[f64]) -> Self {
        let mut sorted: Vec<f64> = errors.iter().map(|&e| if e.is_nan() { f64::INFINITY } else { e }).collect();
        sorted.sort_unstable_by(f64::total_cmp);
        let Some(&max) = sorted.last() else { return Self::default() };
        let rank = whole((0.95 * count(sorted.len())).ceil()).max(1);
        Self { mean: sorted.iter().sum::<f64>() / count(sorted.len()), p95: sorted[rank - 1], max }
    }

    /// Maximum of each component of two summaries.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        Self { mean: self.mean.max(other.mean), p95: self.p95.max(other.p95), max: self.max.max(other.max) }
    }

    /// Objective of a fit: the largest error plus five times the mean.
    pub(super) fn score(&self) -> f64 {
        5.0f64.mul_add(self.mean, self.max)
    }
}

/// A light that a model was planned without, under which colours may be off by more than a tolerance.
#[derive(Clone, Debug, PartialEq)]
pub struct UnplannedLight {
    /// Its name.
    pub name: String,
    /// Its error.
    pub error: ErrorSummary,
    /// Largest ΔE00 allowed.
    pub tolerance: f64,
}

impl fmt::Display for UnplannedLight {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, error: ErrorSummary { mean, max, .. }, tolerance } = self;
        write!(
            f,
            "the colour model was planned without the light {name}: colours under it may be off by ΔE00 {max:.2} \
             ({mean:.2} on average), above the tolerance of {tolerance}"
        )
    }
}

/// Exact colours of a cloud under one light for one observer.
pub(super) struct Target {
    pub(super) xyz: Vec<[f64; 3]>,
    lab: Vec<Lab>,
}

impl Target {
    pub(super) fn new(spectra: &[Spectrum], light: &Light, observer: Observer) -> Self {
        let colour = |spectrum: &Spectrum| observer.xyz_of(&(light.spectrum() * spectrum)).0;
        let xyz: Vec<[f64; 3]> = spectra.iter().map(colour).collect();
        let lab = xyz.iter().map(|&xyz| lab(xyz)).collect();
        Self { xyz, lab }
    }

    /// Quadratic form of ΔE00² at each colour: its entries 00, 01, 02, 11, 12, 22.
    pub(super) fn forms(&self) -> Vec<[f64; 6]> {
        let form = |&xyz: &[f64; 3]| {
            let form = quadratic_form(Xyz(xyz)).to_cols_array();
            [form[0], form[1], form[2], form[4], form[5], form[8]]
        };
        self.xyz.iter().map(form).collect()
    }

    /// ΔE00 between the colour `model` and the exact colour at `index`.
    pub(super) fn error(&self, index: usize, model: [f64; 3]) -> f64 {
        ciede2000(lab(model), self.lab[index])
    }

    /// ΔE00 of the colours that `matrix` gives for `vectors`.
    pub(super) fn errors(&self, vectors: &[Vec<f64>], matrix: &[[f64; 3]]) -> Vec<f64> {
        vectors.iter().enumerate().map(|(index, vector)| self.error(index, colour(matrix, vector))).collect()
    }
}

fn lab(xyz: [f64; 3]) -> Lab {
    lab_from_xyz(Xyz(xyz), d65_white())
}

/// ΔE00 between two colours.
pub(super) fn difference(one: [f64; 3], two: [f64; 3]) -> f64 {
    ciede2000(lab(one), lab(two))
}

/// Colour of a vector: the sum of the matrix's columns, each times its component.
pub(super) fn colour(matrix: &[[f64; 3]], vector: &[f64]) -> [f64; 3] {
    let mut xyz = [0.0; 3];
    for (column, &component) in matrix.iter().zip(vector) {
        for axis in 0..3 {
            xyz[axis] += column[axis] * component;
        }
    }
    xyz
}

/// Product of the symmetric matrix `form` and `vector`.
pub(super) fn applied(form: &[f64; 6], vector: [f64; 3]) -> [f64; 3] {
    let [f00, f01, f02, f11, f12, f22] = *form;
    let [x, y, z] = vector;
    [f00 * x + f01 * y + f02 * z, f01 * x + f11 * y + f12 * z, f02 * x + f12 * y + f22 * z]
}
