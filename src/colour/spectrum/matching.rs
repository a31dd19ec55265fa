//! Colour-matching functions of the CIE standard observers.

use super::{Spectrum, data};

/// CIE 1931 2-degree colour-matching functions x̄, ȳ, z̄ on the grid, as published (CIE 15:2004).
pub static OBSERVER: [Spectrum; 3] = {
    let [x, y, z] = data::columns(include_str!("../../../data/spectra/cie1931_2deg_cmf_5nm.csv"));
    [Spectrum::from_samples(x), Spectrum::from_samples(y), Spectrum::from_samples(z)]
};

/// CIE 1964 10-degree colour-matching functions x̄₁₀, ȳ₁₀, z̄₁₀ on the grid, as published (CIE 15:2004).
pub static OBSERVER_1964: [Spectrum; 3] = {
    let [x, y, z] = data::columns(include_str!("../../../data/spectra/cie1964_10deg_cmf_5nm.csv"));
    [Spectrum::from_samples(x), Spectrum::from_samples(y), Spectrum::from_samples(z)]
};
