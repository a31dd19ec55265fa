//! Tolerances between rungs, with their derivations.
//!
//! Errors are relative to Σ|terms| of each sample if the picture has it ([`super::golden::Image::scale`]), since
//! spectral
//! terms may cancel, and absolute otherwise.

/// Limits of a comparison.
#[derive(Clone, Copy, Debug)]
pub struct Tolerance {
    /// Name in the failure's message and folder.
    pub name: &'static str,
    /// Largest error of any sample.
    pub largest: f64,
    /// Largest mean error over all samples.
    pub mean: f64,
    /// Largest error of all but a share [`Self::exceptions`] of the samples.
    pub usual: f64,
    /// Share of samples with an error between `usual` and `largest`, 0–1.
    pub exceptions: f64,
    /// Whether `BLESS` lets this rung write golden images; true for one rung.
    pub may_bless: bool,
}

#[allow(unused_imports, reason = "each test program uses a part of it")]
pub use relume::measure::extremes::{EQUAL_STEPS, LINEARITY, OPACITY, ROUNDING_UNIT, TERMINATION_DELTA_E};

/// The f64 reference against its golden image, stored as f32: one rounding, doubled for the last bits of `exp` and
/// `pow` on
/// other machines.
pub const STORED: Tolerance = Tolerance {
    name: "stored",
    largest: 2.0 * ROUNDING_UNIT,
    mean: ROUNDING_UNIT,
    usual: 2.0 * ROUNDING_UNIT,
    exceptions: 0.0,
    may_bless: true,
};

/// Arithmetic in f32 against f64 over rays of at most `samples` samples: 2n roundings in T, two in the term and n in
/// the sum
/// give (3n + 2)·2⁻²⁴, 9.2e-5 for n = 512. With random signs, errors would be about √(3n + 2)·2⁻²⁴. The mean may be
/// four
/// times that, because the roundings of T are biased while α stays the same.
pub fn rounding(samples: u16) -> Tolerance {
    let roundings = 3.0 * f64::from(samples) + 2.0;
    let largest = roundings * ROUNDING_UNIT;
    let mean = (4.0 * roundings.sqrt() * ROUNDING_UNIT).min(largest);
    Tolerance { name: "rounding", largest, mean, usual: largest, exceptions: 0.0, may_bless: false }
}

/// The planned model against all 81 bands, both in f64 over the same samples: exact (docs/theory/march.md) except for
/// the
/// order of sums. 81 bands, a few components and some hundred steps, each rounded by 2⁻⁵³, give at most 1e-13 if all
/// have
/// one sign.
pub const BASIS: f64 = 1e-12;

/// ΔE00 of the sharpened model with six coefficients against 81 bands, with coloured absorbers behind one another: a
/// known
/// limitation (docs/theory/colour-models.md, smooth lights: the largest is 29.14).
pub const SHARPENED: f64 = 29.14;

/// Samples whose scale is the bound derived for each of them (`support/bounds.rs`), which none may exceed.
pub const BOUND: Tolerance =
    Tolerance { name: "bound", largest: 1.0, mean: 1.0, usual: 1.0, exceptions: 0.0, may_bless: false };

/// Roundings per step in f32: `(3n + 2)·2⁻²⁴` along the ray, plus twelve within a step (table interpolation, shading,
/// the
/// table's own entries), which do not accumulate over the ray. Four per step cover both for n ≥ 12.
pub const ROUNDINGS_PER_STEP: f64 = 4.0;

/// The same between two devices, which may or may not fuse products with sums: two more roundings per step on each
/// side.
pub const ROUNDINGS_PER_STEP_OF_TWO: f64 = 2.0 * (ROUNDINGS_PER_STEP + 2.0);

/// Mean XYZ error over a picture of the device against the f32 reference, if the device filters in f32.
pub const DEVICE_MEAN: f64 = 1e-6;

/// ΔE00 of the f32 reference against 81 bands in f64 over the same tables, in every pixel.
pub const WEIGHTS_REFERENCE: f64 = 0.01;
/// ΔE00 of the device against 81 bands in f64 over the same tables, in 99 % of the pixels.
pub const WEIGHTS_DEVICE_P99: f64 = 0.01;
/// The same in every pixel.
pub const WEIGHTS_DEVICE: f64 = 0.1;

/// ΔE00 of the f64 reference against 81 bands over the same tables and light grid, if weights are exact: rounding.
pub const SAME_WEIGHTS: f64 = 1e-3;

/// ΔE00 between the rungs of stored tables on the same light grid: f16 depths of a device's sums differ by one unit in the
/// last place at some nodes.
pub const SAME_GRID: f64 = 0.01;

/// ΔE00 in 99 % of the pixels and in all of a device against the reference in segments with labels: of two places that round
/// differently, one may lie in the next voxel, with another label. A tenth of what is just visible in nearly every pixel.
pub const LABEL_IN_SEGMENTS: [f64; 2] = [0.1, 2.0];

/// ΔE00 by the rounding of two pictures to f32.
pub const HALF_OF_TWO: f64 = 1e-3;

/// A slab in half steps against one in whole steps (docs/theory/acceptance.md C13): (3n + 2)·2⁻²⁴ for 48 and for 24
/// steps
/// add up to 1.3e-5.
pub const STEP_INVARIANCE: f64 = 2e-5;

/// Relit accumulators against a fresh render under that light (docs/theory/acceptance.md C11), relative to the
/// brightest
/// XYZ.
pub const RELIT_RELATIVE: f64 = 1e-5;
/// Additional absolute tolerance in XYZ.
pub const RELIT_ABSOLUTE: f64 = 1e-6;

/// Error of XYZ by early ray termination (docs/theory/acceptance.md C17).
pub const TERMINATION_XYZ: f64 = 1e-3;
