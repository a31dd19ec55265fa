//! Errors of fitting a colour model.

use super::ModelKind;

/// Error of fitting or assembling a colour model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A dimension that no model has.
    #[error("a colour model has 1 to {largest} coefficients, not {dimension}")]
    Dimension {
        /// Requested dimension.
        dimension: usize,
        /// Largest dimension.
        largest: usize,
    },
    /// A dimension other than 3 for RGB.
    #[error("RGB has 3 coefficients, not {dimension}; choose another model for a different number")]
    NotThree {
        /// Requested dimension.
        dimension: usize,
    },
    /// A tolerance that is not above 0.
    #[error("a tolerance must be a ΔE00 above 0, not {tolerance}")]
    NotATolerance {
        /// Requested tolerance.
        tolerance: f64,
    },
    /// No dimension keeps the tolerance.
    #[error(
        "the model {kind} does not keep ΔE00 {tolerance} for any k up to {largest}: the best is k = {dimension} with a \
         largest error of {reached:.3}"
    )]
    Tolerance {
        /// Requested kind of model.
        kind: ModelKind,
        /// Requested tolerance.
        tolerance: f64,
        /// Largest dimension.
        largest: usize,
        /// Dimension with the smallest error.
        dimension: usize,
        /// Worst ΔE00 of that dimension.
        reached: f64,
        /// Tolerance that this dimension keeps.
        kept: f64,
    },
    /// An unusable spectrum.
    #[error("{what} is {value} at {nm} nm; {expected}")]
    Sample {
        /// Name of the spectrum.
        what: String,
        /// Wavelength of the sample in nm.
        nm: f64,
        /// Value of the sample.
        value: f64,
        /// Requirement for the sample.
        expected: &'static str,
    },
    /// Spectra too large or too small: the fit overflows.
    #[error("the spectra of this scene are too large or too small: a fitted colour is not finite")]
    NotFinite,
    /// Inconsistent stored parts of a model.
    #[error("inconsistent parts of a colour model: {problem}")]
    Parts {
        /// Description of the inconsistency.
        problem: String,
    },
    /// The fit was cancelled.
    #[error("fitting the colour model was stopped")]
    Cancelled,
}

impl ModelError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Dimension { .. } => "dimension-invalid",
            Self::NotThree { .. } => "rgb-dimension-invalid",
            Self::NotATolerance { .. } => "tolerance-invalid",
            Self::Tolerance { .. } => "tolerance-exceeded",
            Self::Sample { .. } => "model-sample-invalid",
            Self::NotFinite => "model-not-finite",
            Self::Parts { .. } => "model-parts-inconsistent",
            Self::Cancelled => "cancelled",
        }
    }
}
