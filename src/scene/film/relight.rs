//! Post-illumination on the host: converts a film to colours, without a march.

use glam::DVec3;

use super::{Film, RelightMatrices};
use relume_base::number::Real;

impl<R: Real> Film<R> {
    /// Linear sRGB of every pixel: Σ accumulator · colour over positions and components, plus transmittance times the
    /// colour of the background.
    #[must_use]
    pub fn relight(&self, matrices: &RelightMatrices) -> Vec<DVec3> {
        let pixels = self.pixels();
        let mut picture = vec![DVec3::ZERO; pixels];
        if pixels > 0 {
            let background = self.transmittance.chunks_exact(pixels).zip(&matrices.background);
            let planes = background.chain(self.accumulators.chunks_exact(pixels).zip(&matrices.colours));
            for (numbers, &colour) in planes {
                for (sum, number) in picture.iter_mut().zip(numbers) {
                    *sum += number.to_f64() * colour;
                }
            }
        }
        picture
    }

    /// Opacity of every pixel: 1 − transmittance, weighted by the lights.
    #[must_use]
    pub fn opacity(&self, matrices: &RelightMatrices) -> Vec<f64> {
        let pixels = self.pixels();
        let mut opacity = vec![1.0; pixels];
        if pixels > 0 {
            let planes = self.transmittance.chunks_exact(pixels).zip(&matrices.transmittance_weights);
            for (numbers, &weight) in planes {
                for (opacity, number) in opacity.iter_mut().zip(numbers) {
                    *opacity -= number.to_f64() * weight;
                }
            }
        }
        opacity
    }
}

/// Linear sRGB and opacity of one pixel.
pub(crate) fn relit_pixel<R: Real>(
    accumulators: &[R],
    transmittance: &[R],
    matrices: &RelightMatrices,
) -> (DVec3, f64) {
    let sum = |numbers: &[R], colours: &[DVec3]| -> DVec3 {
        numbers.iter().zip(colours).map(|(number, &colour)| number.to_f64() * colour).sum()
    };
    let weights = &matrices.transmittance_weights;
    let through: f64 = transmittance.iter().zip(weights).map(|(number, weight)| number.to_f64() * weight).sum();
    (sum(accumulators, &matrices.colours) + sum(transmittance, &matrices.background), 1.0 - through)
}
