//! Post-illumination on the host: converts a film to colours, without a march.

use glam::DVec3;

use super::{Film, RelightMatrices};
use relume_base::number::{Real, rounded};
use relume_base::parallel::rows_mut;

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

    /// [`Self::relight`] and [`Self::opacity`] as linear RGBA of every pixel, rounded once to f32, on all cores.
    ///
    /// # Panics
    ///
    /// If `rgba` has not four numbers for each pixel.
    pub fn relight_into(&self, matrices: &RelightMatrices, rgba: &mut [f32]) {
        /// Pixels of a part, whose sums stay in the cache.
        const PART: usize = 512;
        let pixels = self.pixels();
        assert_eq!(rgba.len(), 4 * pixels, "RGBA of {pixels} pixels");
        rows_mut(rgba, 4 * PART, &|part, rgba| {
            let (from, length) = (part * PART, rgba.len() / 4);
            let mut sums = [(DVec3::ZERO, 1.0); PART];
            let sums = &mut sums[..length];
            // In the order of `relight` and `opacity`, so that the bits are theirs.
            let through = self.transmittance.chunks_exact(pixels);
            for (numbers, &colour) in through.clone().zip(&matrices.background) {
                for ((sum, _), number) in sums.iter_mut().zip(&numbers[from..]) {
                    *sum += number.to_f64() * colour;
                }
            }
            for (numbers, &colour) in self.accumulators.chunks_exact(pixels).zip(&matrices.colours) {
                for ((sum, _), number) in sums.iter_mut().zip(&numbers[from..]) {
                    *sum += number.to_f64() * colour;
                }
            }
            for (numbers, &weight) in through.zip(&matrices.transmittance_weights) {
                for ((_, opacity), number) in sums.iter_mut().zip(&numbers[from..]) {
                    *opacity -= number.to_f64() * weight;
                }
            }
            for (pixel, (colour, opacity)) in rgba.as_chunks_mut::<4>().0.iter_mut().zip(&*sums) {
                *pixel = [colour.x, colour.y, colour.z, *opacity].map(rounded);
            }
        });
    }

    /// [`Self::relight_into`] in memory of its own.
    #[must_use]
    pub fn rgba(&self, matrices: &RelightMatrices) -> Vec<f32> {
        let mut rgba = vec![0.0; 4 * self.pixels()];
        self.relight_into(matrices, &mut rgba);
        rgba
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rgba_has_the_bits_of_colours_and_opacity() {
        for (size, components, through) in [([61, 53], 3, 1), ([1, 1], 2, 2), ([0, 4], 1, 1)] {
            let pixels = size[0] * size[1];
            let number = |i: usize| rounded(relume_base::number::count(i * i % 977) / 977.0);
            let film = Film {
                size,
                components,
                accumulators: (0..2 * components * pixels).map(number).collect(),
                transmittance: (0..through * pixels).map(number).collect(),
            };
            let colour = |i: usize| DVec3::new(0.1, 0.7, 0.3) * relume_base::number::count(i + 1);
            let matrices = RelightMatrices {
                tone: crate::Tone::Linear,
                backdrop: crate::Backdrop::None,
                colours: (0..2 * components).map(colour).collect(),
                background: (0..through).map(colour).collect(),
                transmittance_weights: vec![1.0 / relume_base::number::count(through); through],
            };
            let pairs = film.relight(&matrices).into_iter().zip(film.opacity(&matrices));
            let expected: Vec<f32> = pairs.flat_map(|(c, opacity)| [c.x, c.y, c.z, opacity].map(rounded)).collect();
            assert!(film.rgba(&matrices) == expected, "{size:?}");
        }
    }
}
