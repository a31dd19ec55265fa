//! Counts as numbers and numbers as counts, where a plain cast is right.

/// A count of pixels, voxels, entries or samples; exact below 2⁵³.
#[expect(clippy::cast_precision_loss, reason = "counts are far below 2⁵³")]
#[must_use]
pub(crate) fn count(n: usize) -> f64 {
    n as f64
}

/// The whole part of a number as a count; negative ones and NaN are 0.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "casts of floats saturate")]
#[must_use]
pub(crate) fn whole(number: f64) -> usize {
    number as usize
}

/// A count as a shader has it; one that does not fit is the largest, which every limit refuses.
#[must_use]
pub(crate) fn unsigned(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
