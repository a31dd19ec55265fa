//! Models independent of the scene: uniform bands and RGB.

use glam::DVec3;

use crate::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, OBSERVER, XYZ_FROM_LINEAR_SRGB};
use crate::spectrum::observer::Observer;
use crate::spectrum::{Light, STEP_NM, Spectrum, standard};

/// Means over `dimension` equal intervals from 400 to 700 nm; each sample represents the 5 nm around it.
pub(super) fn bands(dimension: usize) -> Vec<Spectrum> {
    let edge =
        |band: usize| 300.0f64.mul_add(relume_base::number::count(band) / relume_base::number::count(dimension), 400.0);
    let row = |band: usize| {
        let (low, high) = (edge(band), edge(band + 1));
        let covered = |nm: f64| ((nm + STEP_NM / 2.0).min(high) - (nm - STEP_NM / 2.0).max(low)).max(0.0);
        normalised(&Spectrum::from_fn(covered))
    };
    (0..dimension).map(row).collect()
}

/// Linear sRGB under the equal-energy light; white is (1, 1, 1).
pub(super) fn rgb() -> Vec<Spectrum> {
    rgb_under(&Spectrum::constant(1.0))
}

/// Linear sRGB under D65; white is (1, 1, 1).
pub(super) fn rgb_prefiltered() -> Vec<Spectrum> {
    rgb_under(standard::d65().spectrum())
}

fn rgb_under(light: &Spectrum) -> Vec<Spectrum> {
    let row = |axis: usize| {
        let parts = LINEAR_SRGB_FROM_XYZ.row(axis).to_array();
        let mixed = (0..3).map(|part| OBSERVER[part].scaled(parts[part]));
        let mixed = mixed.fold(Spectrum::constant(0.0), |sum, part| &sum + &part);
        normalised(&(light * &mixed))
    };
    (0..3).map(row).collect()
}

fn normalised(row: &Spectrum) -> Spectrum {
    row.scaled(1.0 / row.sum())
}

/// XYZ per unit of red, green and blue under a light: the primaries, scaled by the light's own components for
/// `observer`.
pub(super) fn rgb_matrix(light: &Light, observer: Observer) -> Vec<[f64; 3]> {
    let white = *LINEAR_SRGB_FROM_XYZ * DVec3::from(observer.xyz_of(light.spectrum()).0);
    (0..3).map(|axis| (XYZ_FROM_LINEAR_SRGB.col(axis) * white[axis]).to_array()).collect()
}
