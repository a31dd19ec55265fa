//! Kinds of spectra, with the meaning and normalisation of their samples.

use super::matching::OBSERVER;
use super::{BANDS, Kind, Spectrum, SpectrumError, wavelength_nm};

/// Fraction of light that a surface reflects per wavelength: unitless, not normalised.
///
/// Negative samples are allowed for artificial reflectances, such as a metameric black.
#[derive(Clone, Debug, PartialEq)]
pub struct Reflectance(Spectrum);

impl Reflectance {
    /// Reflectance of these samples.
    ///
    /// # Errors
    ///
    /// [`SpectrumError::NotFinite`] when a sample is infinite or NaN.
    pub fn new(spectrum: Spectrum) -> Result<Self, SpectrumError> {
        finite(Kind::Reflectance, &spectrum)?;
        Ok(Self(spectrum))
    }

    /// Samples.
    pub const fn spectrum(&self) -> &Spectrum {
        &self.0
    }

    /// Reflectance of samples known to be finite.
    pub(crate) const fn of_finite(spectrum: Spectrum) -> Self {
        Self(spectrum)
    }

    /// Whether a real surface can have it: every sample is between 0 and 1.
    pub fn is_physical(&self) -> bool {
        self.0.samples().iter().all(|sample| (0.0..=1.0).contains(sample))
    }
}

/// Largest deviation of a normalised luminance from 1, which is rounding of its sum.
const NORMALISED: f64 = 1e-13;

/// Relative power of a light per wavelength; the perfect reflector under it has Y = 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Light(Spectrum);

impl Light {
    /// Divides the relative powers by their luminance, the plain sum of their products with the 2-degree observer's ȳ.
    ///
    /// If the luminance is not positive (a light of zeros, or an artificial one), the powers stay unscaled, with a
    /// warning. Normalised powers are returned unchanged to the bit.
    ///
    /// # Errors
    ///
    /// [`SpectrumError::NotFinite`] when a sample is infinite or NaN.
    pub fn new(spectrum: Spectrum) -> Result<Self, SpectrumError> {
        finite(Kind::Light, &spectrum)?;
        Ok(Self::normalised(spectrum))
    }

    /// Light of finite samples that are already normalised, as far as possible.
    pub(crate) const fn of_normalised(spectrum: Spectrum) -> Self {
        Self(spectrum)
    }

    /// [`Self::new`] for samples known to be finite.
    pub(crate) fn normalised(spectrum: Spectrum) -> Self {
        if (OBSERVER[1].dot(&spectrum) - 1.0).abs() <= NORMALISED {
            return Self(spectrum);
        }
        // Divided by the peak first, because a luminance of huge samples would overflow.
        let peak = spectrum.samples().iter().fold(0.0, |peak: f64, sample| peak.max(sample.abs()));
        let relative = Spectrum::from_samples(spectrum.samples().map(|sample| sample / peak));
        let luminance = OBSERVER[1].dot(&relative);
        let unit = Spectrum::from_samples(relative.samples().map(|sample| sample / luminance));
        if luminance > 0.0 && unit.is_finite() {
            return Self(unit);
        }
        let luminance = OBSERVER[1].dot(&spectrum);
        tracing::warn!(
            "a light spectrum has luminance {luminance}, which is not positive, so it is not scaled to luminance 1"
        );
        Self(spectrum)
    }

    /// Light of a black body of this temperature in kelvin (Planck's law, c₂ = 1.438776877e-2 m K).
    ///
    /// # Errors
    ///
    /// [`SpectrumError::Temperature`] when `kelvin` is below 100 or not finite.
    pub fn blackbody(kelvin: f64) -> Result<Self, SpectrumError> {
        Ok(Self::normalised(planck(kelvin)?))
    }

    /// Y of the perfect reflector under the light, to twelve decimals: exactly 1 unless the light could not be
    /// normalised.
    #[must_use]
    pub fn luminance(&self) -> f64 {
        (OBSERVER[1].dot(&self.0) * 1e12).round() / 1e12
    }

    /// Normalised powers.
    pub const fn spectrum(&self) -> &Spectrum {
        &self.0
    }
}

/// Absorption spectrum: shape of an absorption per wavelength, without negative samples and with a peak of 1. Its
/// strength is defined at its use.
#[derive(Clone, Debug, PartialEq)]
pub struct Absorption(Spectrum);

impl Absorption {
    /// Divides the samples by the largest one.
    ///
    /// # Errors
    ///
    /// [`SpectrumError::NotFinite`] when a sample is infinite or NaN, [`SpectrumError::NegativeAbsorption`] when a
    /// sample is negative (it would amplify light), [`SpectrumError::NoAbsorption`] when all samples are zero.
    pub fn new(spectrum: Spectrum) -> Result<Self, SpectrumError> {
        finite(Kind::Absorption, &spectrum)?;
        if let Some((nm, value)) = find(&spectrum, |sample| sample < 0.0) {
            return Err(SpectrumError::NegativeAbsorption { nm, value });
        }
        let peak = spectrum.samples().iter().copied().fold(0.0, f64::max);
        if peak <= 0.0 {
            return Err(SpectrumError::NoAbsorption);
        }
        Ok(Self(Spectrum::from_samples(spectrum.samples().map(|sample| sample / peak))))
    }

    /// Normalised samples.
    pub const fn spectrum(&self) -> &Spectrum {
        &self.0
    }
}

/// Planck's law, relative to its value at 560 nm.
pub(super) fn planck(kelvin: f64) -> Result<Spectrum, SpectrumError> {
    /// Second radiation constant in nm K (CODATA 2018, exact to the digits given).
    const C2: f64 = 1.438_776_877e7;
    if !(kelvin.is_finite() && kelvin >= 100.0) {
        return Err(SpectrumError::Temperature { kelvin });
    }
    // The quotient of the exponentials is written so that neither overflows at the lowest temperatures.
    let exponent = |nm: f64| C2 / (nm * kelvin);
    let emitted = |nm: f64| (-exponent(nm)).exp_m1();
    Ok(Spectrum::from_fn(|nm| {
        (560.0 / nm).powi(5) * (exponent(560.0) - exponent(nm)).exp() * emitted(560.0) / emitted(nm)
    }))
}

fn finite(kind: Kind, spectrum: &Spectrum) -> Result<(), SpectrumError> {
    match find(spectrum, |sample| !sample.is_finite()) {
        Some((nm, value)) => Err(SpectrumError::NotFinite { kind, nm, value }),
        None => Ok(()),
    }
}

/// Wavelength and value of the first sample that satisfies `is_wanted`.
fn find(spectrum: &Spectrum, is_wanted: impl Fn(f64) -> bool) -> Option<(f64, f64)> {
    (0..BANDS).map(|band| (wavelength_nm(band), spectrum.samples()[band])).find(|&(_, sample)| is_wanted(sample))
}
