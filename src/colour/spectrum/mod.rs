//! Spectra, sampled on one grid of wavelengths.

pub mod colour;
mod data;
pub mod deficiency;
mod error;
mod kind;
mod matching;
pub mod metric;
pub mod observer;
mod smooth;
mod source;
pub mod standard;
mod table;
mod thin_film;

use std::ops::{Add, Mul};

pub use error::{Kind, SpectrumError};
pub use kind::{Absorption, Light, Reflectance};
pub use smooth::smooth_reflectance;
pub use source::srgb_code;
pub use source::{Gaussian, SpectrumSource};
pub use standard::nearest;
pub use table::Column;
pub use thin_film::{
    FINE_ANGLES, INDICES, Layers, THICKNESSES, THIN_FILM_ANGLES, ThinFilm, ThinFilmAngle, ThinFilmError, ThinFilmTerms,
};

/// Number of wavelengths of the grid.
pub const BANDS: usize = 81;
/// Shortest wavelength of the grid, in nm.
pub const FIRST_NM: f64 = 380.0;
/// Longest wavelength of the grid, in nm.
pub const LAST_NM: f64 = 780.0;
/// Spacing of the grid, in nm.
pub const STEP_NM: f64 = 5.0;

/// Wavelength of a band in nm: 380 for band 0, 780 for band 80.
#[expect(clippy::cast_precision_loss, reason = "a band is a small number")]
pub const fn wavelength_nm(band: usize) -> f64 {
    FIRST_NM + STEP_NM * band as f64
}

/// One sample per wavelength of the grid. [`Reflectance`], [`Light`] and [`Absorption`] define the meaning of the
/// samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    samples: [f64; BANDS],
}

impl Spectrum {
    /// Spectrum with the same value at every wavelength.
    pub const fn constant(value: f64) -> Self {
        Self { samples: [value; BANDS] }
    }

    /// Spectrum of the given samples, from 380 nm upwards.
    pub const fn from_samples(samples: [f64; BANDS]) -> Self {
        Self { samples }
    }

    /// Samples a function of the wavelength in nm.
    pub fn from_fn(value: impl Fn(f64) -> f64) -> Self {
        Self { samples: std::array::from_fn(|band| value(wavelength_nm(band))) }
    }

    /// Samples the piecewise linear curve through `points` (wavelength in nm, value; in any order), constant beyond its
    /// ends.
    ///
    /// # Errors
    ///
    /// [`SpectrumError::Points`] when `points` is empty, when a point is not finite or has no positive wavelength, when
    /// a wavelength occurs twice, or when all wavelengths lie outside 380–780 nm.
    pub fn interpolate(points: &[(f64, f64)]) -> Result<Self, SpectrumError> {
        let curve = table::Curve::new(points)?;
        Ok(Self::from_fn(|nm| curve.at(nm)))
    }

    /// Averages the curve of [`Self::interpolate`] over the 5 nm around every wavelength.
    ///
    /// For tables finer than the grid, whose spectral lines could fall between samples. A bin partly covered by the
    /// table takes the average of the covered part; an uncovered bin takes the value at the table's end.
    ///
    /// # Errors
    ///
    /// Those of [`Self::interpolate`].
    pub fn box_average(points: &[(f64, f64)]) -> Result<Self, SpectrumError> {
        let curve = table::Curve::new(points)?;
        Ok(Self::from_fn(|nm| curve.mean(nm - STEP_NM / 2.0, nm + STEP_NM / 2.0)))
    }

    /// Gaussian `height · exp(−((nm − centre_nm) / sigma_nm)² / 2)`.
    ///
    /// # Errors
    ///
    /// [`SpectrumError::Gaussian`] when a number is not finite, or when `sigma_nm` is below half a grid step: a
    /// narrower curve falls between the samples (at half a step their sum is within 1.5 % of the integral).
    pub fn gaussian(centre_nm: f64, sigma_nm: f64, height: f64) -> Result<Self, SpectrumError> {
        if !(centre_nm.is_finite() && height.is_finite() && sigma_nm.is_finite() && sigma_nm >= STEP_NM / 2.0) {
            return Err(SpectrumError::Gaussian { centre_nm, sigma_nm, height });
        }
        Ok(Self::from_fn(|nm| height * (-0.5 * ((nm - centre_nm) / sigma_nm).powi(2)).exp()))
    }

    /// Samples, from 380 nm upwards.
    pub const fn samples(&self) -> &[f64; BANDS] {
        &self.samples
    }

    /// Multiplies every sample by `factor`.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { samples: self.samples.map(|sample| sample * factor) }
    }

    /// Plain sum of the samples. Integrals are plain sums throughout the crate.
    pub fn sum(&self) -> f64 {
        self.samples.iter().sum()
    }

    /// Plain sum of the products with another spectrum's samples.
    pub fn dot(&self, other: &Self) -> f64 {
        self.samples.iter().zip(&other.samples).map(|(a, b)| a * b).sum()
    }

    /// Whether every sample is finite.
    pub fn is_finite(&self) -> bool {
        self.samples.iter().all(|sample| sample.is_finite())
    }
}

impl Mul for &Spectrum {
    type Output = Spectrum;

    fn mul(self, other: Self) -> Spectrum {
        Spectrum { samples: std::array::from_fn(|band| self.samples[band] * other.samples[band]) }
    }
}

impl Add for &Spectrum {
    type Output = Spectrum;

    fn add(self, other: Self) -> Spectrum {
        Spectrum { samples: std::array::from_fn(|band| self.samples[band] + other.samples[band]) }
    }
}
