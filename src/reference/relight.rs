//! Post-illumination: accumulators to colours, with no march.

use glam::DVec3;

use super::Real;
use crate::tables::{Accumulation, RelightMatrices};

/// Linear sRGB of every pixel: Σ weight · colour over components and positions, and the background through the light
/// that passes.
#[must_use]
pub fn relight<R: Real>(accumulation: &Accumulation<R>, matrices: &RelightMatrices) -> Vec<DVec3> {
    let pixels = accumulation.transmittance.len();
    let mut picture: Vec<DVec3> =
        accumulation.transmittance.iter().map(|passed| passed.to_f64() * matrices.background).collect();
    if pixels > 0 {
        for (weights, &colour) in accumulation.weights.chunks_exact(pixels).zip(&matrices.colours) {
            for (sum, weight) in picture.iter_mut().zip(weights) {
                *sum += weight.to_f64() * colour;
            }
        }
    }
    picture
}
