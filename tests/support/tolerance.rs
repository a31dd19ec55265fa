//! How far apart two rungs may be, and why.
//!
//! Errors are relative to Σ|terms| of each sample where the picture brings that along ([`super::golden::Image::scale`]),
//! so spectra that cancel are judged fairly, and absolute where it does not.

/// What a comparison allows.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// What the failure's message and folder call it.
    pub name: &'static str,
    /// No sample may be further off.
    pub largest: f64,
    /// The mean over all samples may not be further off.
    pub mean: f64,
    /// All but a share of [`Self::exceptions`] of the samples must be within this.
    pub usual: f64,
    /// The share of samples that may be between `usual` and `largest`, 0–1.
    pub exceptions: f64,
    /// Whether `BLESS` lets this rung write golden images. True of one rung.
    pub may_bless: bool,
}

#[allow(unused_imports, reason = "each test program uses a part of it")]
pub use relume::measure::extremes::{EQUAL_STEPS, LINEARITY, OPACITY, ROUNDING_UNIT, TERMINATION_DELTA_E};

/// The f64 reference against its own picture, stored as f32: one rounding. Twice that, for the last bits of another
/// machine's `exp` and `pow`.
pub const STORED: Tolerance = Tolerance {
    name: "stored",
    largest: 2.0 * ROUNDING_UNIT,
    mean: ROUNDING_UNIT,
    usual: 2.0 * ROUNDING_UNIT,
    exceptions: 0.0,
    may_bless: true,
};

/// Arithmetic in f32 against f64, over rays of at most `samples` samples: 2n roundings in T, two in the term, n in the
/// sum: (3n + 2)·2⁻²⁴, 9.2e-5 for n = 512. Were their signs random, errors would be about √(3n + 2)·2⁻²⁴, and
/// the mean may be four times that: roundings of T lean one way while α stays the same.
pub fn rounding(samples: u16) -> Tolerance {
    let roundings = 3.0 * f64::from(samples) + 2.0;
    let largest = roundings * ROUNDING_UNIT;
    let mean = (4.0 * roundings.sqrt() * ROUNDING_UNIT).min(largest);
    Tolerance { name: "rounding", largest, mean, usual: largest, exceptions: 0.0, may_bless: false }
}

/// The planned model against all 81 bands, both in f64 over the same samples: exact (docs/theory/march.md) but for the order of
/// sums. 81 bands, a few components and some hundred steps, each rounding by 2⁻⁵³: 1e-13 at most, were all of one sign.
pub const BASIS: f64 = 1e-12;

/// ΔE00 of the sharpened model with six factors, where coloured absorbers lie behind one another, against 81 bands:
/// reported, not hidden (docs/theory/colour-models.md, smooth lights: the largest is 29.14).
pub const SHARPENED: f64 = 29.14;

/// Samples of a picture whose scale is the bound derived for each of them (`support/bounds.rs`): none may be beyond it.
pub const BOUND: Tolerance =
    Tolerance { name: "bound", largest: 1.0, mean: 1.0, usual: 1.0, exceptions: 0.0, may_bless: false };

/// Roundings per step in f32, `(3n + 2)·2⁻²⁴`, and twelve for what a step itself takes (a table's interpolation, shading,
/// a table's own entries), which do not add up over the ray: 12 more in all, but four per step are allowed for n ≥ 12.
pub const ROUNDINGS_PER_STEP: f64 = 4.0;

/// The same on two devices, neither of which need fuse a product with a sum: two more roundings per step on each side.
pub const ROUNDINGS_PER_STEP_OF_TWO: f64 = 2.0 * (ROUNDINGS_PER_STEP + 2.0);

/// XYZ on the device against the f32 reference, the mean over a picture, where filtering is done in f32.
pub const DEVICE_MEAN: f64 = 1e-6;

/// ΔE00 of the f32 reference against 81 bands in f64 over the same tables, in every pixel.
pub const WEIGHTS_REFERENCE: f64 = 0.01;
/// ΔE00 of the device against 81 bands in f64 over the same tables: 99 of 100 pixels.
pub const WEIGHTS_DEVICE_P99: f64 = 0.01;
/// The same: every pixel.
pub const WEIGHTS_DEVICE: f64 = 0.1;

/// A slab in half steps against one in whole ones (docs/theory/acceptance.md C13): (3n + 2)·2⁻²⁴ for 48 and for 24 steps are 1.3e-5.
pub const STEP_INVARIANCE: f64 = 2e-5;

/// Stored accumulators, relit, against a fresh render under that light (docs/theory/acceptance.md C11), relative to the brightest of XYZ.
pub const RELIT_RELATIVE: f64 = 1e-5;
/// And this much XYZ besides.
pub const RELIT_ABSOLUTE: f64 = 1e-6;

/// What ending rays early may do to XYZ (docs/theory/acceptance.md C17).
pub const TERMINATION_XYZ: f64 = 1e-3;
