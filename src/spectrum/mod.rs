//! What a spectrum is: samples over one grid of wavelengths.

pub mod colour;
mod data;
pub mod deficiency;
mod error;
mod kind;
pub mod metric;
pub mod observer;
mod smooth;
mod source;
pub mod standard;
mod table;

use std::ops::{Add, Mul};

pub use error::{Kind, SpectrumError};
pub use kind::{Absorption, Light, Reflectance};
pub use smooth::smooth_reflectance;
pub(crate) use source::srgb_code;
pub use source::{Column, Gaussian, SpectrumSource};
pub(crate) use standard::nearest;

/// Wavelengths of the grid.
pub const BANDS: usize = 81;
/// The shortest wavelength, in nm.
pub const FIRST_NM: f64 = 380.0;
/// The longest wavelength, in nm.
pub const LAST_NM: f64 = 780.0;
/// The distance of neighbouring wavelengths, in nm.
pub const STEP_NM: f64 = 5.0;

/// The wavelength of a band, in nm: 380 for band 0, 780 for band 80.
#[expect(clippy::cast_precision_loss, reason = "a band is a small number")]
pub const fn wavelength_nm(band: usize) -> f64 {
    FIRST_NM + STEP_NM * band as f64
}

/// One sample per wavelength of the grid. What the samples mean is said by [`Reflectance`], [`Light`] and [`Absorption`].
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    samples: [f64; BANDS],
}

impl Spectrum {
    /// The same value at every wavelength.
    pub const fn constant(value: f64) -> Self {
        Self { samples: [value; BANDS] }
    }

    /// The given samples, the one of 380 nm first.
    pub const fn from_samples(samples: [f64; BANDS]) -> Self {
        Self { samples }
    }

    /// The values of a function of the wavelength in nm.
    pub fn from_fn(value: impl Fn(f64) -> f64) -> Self {
        Self { samples: std::array::from_fn(|band| value(wavelength_nm(band))) }
    }

    /// The piecewise linear curve through `points` (wavelength in nm, value; in any order), constant beyond its ends.
    ///
    /// # Errors
    ///
    /// [`SpectrumError::Points`] when there are none, when one is not finite or has no positive wavelength, when a
    /// wavelength occurs twice, or when all lie outside 380–780 nm.
    pub fn interpolate(points: &[(f64, f64)]) -> Result<Self, SpectrumError> {
        let curve = table::Curve::new(points)?;
        Ok(Self::from_fn(|nm| curve.at(nm)))
    }

    /// The average, over the 5 nm around every wavelength, of the curve that [`Self::interpolate`] samples.
    ///
    /// For tables finer than the grid, whose lines samples would miss. A bin that the table covers in part is the
    /// average of that part; one that it does not cover takes the value at the table's end.
    ///
    /// # Errors
    ///
    /// Those of [`Self::interpolate`].
    pub fn box_average(points: &[(f64, f64)]) -> Result<Self, SpectrumError> {
        let curve = table::Curve::new(points)?;
        Ok(Self::from_fn(|nm| curve.mean(nm - STEP_NM / 2.0, nm + STEP_NM / 2.0)))
    }

    /// The bell curve `height · exp(−((nm − centre_nm) / sigma_nm)² / 2)`.
    ///
    /// # Errors
    ///
    /// [`SpectrumError::Gaussian`] when a number is not finite, or when `sigma_nm` is below half a step of the grid:
    /// a narrower curve falls between the samples (at half a step their sum is within 1.5 % of the integral).
    pub fn gaussian(centre_nm: f64, sigma_nm: f64, height: f64) -> Result<Self, SpectrumError> {
        if !(centre_nm.is_finite() && height.is_finite() && sigma_nm.is_finite() && sigma_nm >= STEP_NM / 2.0) {
            return Err(SpectrumError::Gaussian { centre_nm, sigma_nm, height });
        }
        Ok(Self::from_fn(|nm| height * (-0.5 * ((nm - centre_nm) / sigma_nm).powi(2)).exp()))
    }

    /// The samples, the one of 380 nm first.
    pub const fn samples(&self) -> &[f64; BANDS] {
        &self.samples
    }

    /// Every sample times `factor`.
    #[must_use]
    pub fn scaled(&self, factor: f64) -> Self {
        Self { samples: self.samples.map(|sample| sample * factor) }
    }

    /// The plain sum of the samples. Integrals are plain sums throughout the crate.
    pub fn sum(&self) -> f64 {
        self.samples.iter().sum()
    }

    /// The plain sum of the products with another spectrum's samples.
    pub fn dot(&self, other: &Self) -> f64 {
        self.samples.iter().zip(&other.samples).map(|(a, b)| a * b).sum()
    }

    /// Whether no sample is infinite or NaN.
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
