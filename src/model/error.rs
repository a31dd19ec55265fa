//! What keeps a colour model from being fitted.

use super::ModelKind;

/// Why there is no colour model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// A dimension that no model has.
    #[error("a colour model has 1 to {largest} coefficients, not {dimension}")]
    Dimension {
        /// The dimension asked for.
        dimension: usize,
        /// The largest there is.
        largest: usize,
    },
    /// A dimension that RGB does not have.
    #[error("RGB has 3 coefficients, not {dimension}; the other models have as many as you like")]
    NotThree {
        /// The dimension asked for.
        dimension: usize,
    },
    /// A tolerance that nothing can keep.
    #[error("a tolerance is a ΔE00 above 0, not {tolerance}")]
    NotATolerance {
        /// The tolerance asked for.
        tolerance: f64,
    },
    /// No dimension keeps the tolerance.
    #[error(
        "no k up to {largest} is sure to keep ΔE00 {tolerance} with the model {kind}: k = {dimension} comes nearest and \
         differs by {reached:.3} at worst; to go on with it, add --k {dimension} or --tolerance {kept:.3}{way_out}"
    )]
    Tolerance {
        /// The kind of model asked for.
        kind: ModelKind,
        /// The tolerance asked for.
        tolerance: f64,
        /// The largest dimension there is.
        largest: usize,
        /// The dimension that comes nearest.
        dimension: usize,
        /// The worst ΔE00 of that.
        reached: f64,
        /// A tolerance that it keeps.
        kept: f64,
        /// What else could be done, as the end of the sentence.
        way_out: String,
    },
    /// A spectrum that cannot be computed with.
    #[error("{what} is {value} at {nm} nm; {expected}")]
    Sample {
        /// Which spectrum it is.
        what: String,
        /// Where.
        nm: f64,
        /// The sample.
        value: f64,
        /// What would be right.
        expected: &'static str,
    },
    /// Spectra so large or so small that the fit overflows.
    #[error("the spectra of this scene are too large or too small to be computed with: a fitted colour is not finite")]
    NotFinite,
    /// Stored parts of a model that do not fit one another.
    #[error("these are not the parts of one colour model: {problem}")]
    Parts {
        /// What does not fit.
        problem: String,
    },
    /// Whoever listened wished to stop.
    #[error("fitting the colour model was stopped")]
    Cancelled,
}
