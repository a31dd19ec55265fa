//! Post-illumination: accumulators to colours, with no march.

use glam::DVec3;

use super::Real;
use crate::tables::{Accumulation, RelightMatrices};

/// Linear sRGB of every pixel: Σ weight · colour over components and positions, and the background through the light
/// that passes.
#[must_use]
pub fn relight<R: Real>(accumulation: &Accumulation<R>, matrices: &RelightMatrices) -> Vec<DVec3> {
    let pixels = accumulation.size[0] * accumulation.size[1];
    let mut picture = vec![DVec3::ZERO; pixels];
    if pixels > 0 {
        let behind = accumulation.transmittance.chunks_exact(pixels).zip(&matrices.background);
        let planes = behind.chain(accumulation.weights.chunks_exact(pixels).zip(&matrices.colours));
        for (numbers, &colour) in planes {
            for (sum, number) in picture.iter_mut().zip(numbers) {
                *sum += number.to_f64() * colour;
            }
        }
    }
    picture
}

/// The opacity of every pixel: what of the lights does not pass.
#[must_use]
pub fn opacity<R: Real>(accumulation: &Accumulation<R>, matrices: &RelightMatrices) -> Vec<f64> {
    let pixels = accumulation.size[0] * accumulation.size[1];
    let mut opacity = vec![1.0; pixels];
    if pixels > 0 {
        for (numbers, &share) in accumulation.transmittance.chunks_exact(pixels).zip(&matrices.passing) {
            for (opacity, number) in opacity.iter_mut().zip(numbers) {
                *opacity -= number.to_f64() * share;
            }
        }
    }
    opacity
}

/// Linear sRGB and opacity of one pixel.
pub(super) fn light<R: Real>(sums: &[R], passed: &[R], matrices: &RelightMatrices) -> (DVec3, f64) {
    let sum = |numbers: &[R], colours: &[DVec3]| -> DVec3 {
        numbers.iter().zip(colours).map(|(number, &colour)| number.to_f64() * colour).sum()
    };
    let through: f64 = passed.iter().zip(&matrices.passing).map(|(passed, share)| passed.to_f64() * share).sum();
    (sum(sums, &matrices.colours) + sum(passed, &matrices.background), 1.0 - through)
}
