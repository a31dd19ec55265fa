//! The settings that a choice tries: step lengths, dimensions of the colour model and fractions of the pixels.

use super::setting::{Setting, Value};
use relume_base::number::count;

/// Dimensions to choose from where weights are not exact. They fill whole vectors, because unused components would
/// cost as much.
pub const DIMENSIONS: [usize; 4] = [4, 8, 12, 16];
/// Fractions of the pixels across that are marched; each halves the number of pixels.
pub const SCALES: [f64; 7] = [1.0, 0.71, 0.5, 0.35, 0.25, 0.18, 0.125];

/// 2^`octaves`, a step length in voxels, rounded to three digits.
#[must_use]
pub fn voxels(octaves: f64) -> f64 {
    let exact = octaves.exp2();
    let digit = 10_f64.powf(exact.log10().floor() - 2.0);
    let rounded = (exact / digit).round() * digit;
    // Removes the rounding error of the product.
    format!("{rounded:.6}").parse().unwrap_or(exact)
}

/// The setting with this step in voxels, dimension of a colour model (if any), and fraction of the pixels across.
#[must_use]
pub fn setting(step: f64, dimension: Option<usize>, scale: f64) -> Setting {
    let mut setting = Setting::default().with("step", Value::Number(step));
    if let Some(k) = dimension {
        setting = setting.with("k", Value::Number(count(k)));
    }
    if scale < 1.0 { setting.with("scale", Value::Number(scale)) } else { setting }
}
