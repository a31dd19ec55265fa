//! The film: accumulators and transmittance of each pixel, independent of the light's spectrum, and its relighting.

mod exposure;
mod matrices;
mod relight;
mod rows;
mod tree;

pub use exposure::automatic_exposure;
pub use matrices::{Components, RelightMatrices, Relightable, display_from_xyz};
pub(crate) use relight::relit_pixel;
pub use rows::Rectangle;
pub use tree::composited;

use relume_base::number::Real;

/// Accumulators and transmittance of each pixel, on the host.
///
/// Planes of one number per pixel, rows from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct Film<R> {
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Components per accumulator.
    pub components: usize,
    /// Sum of transmittance × source along the ray: component `c` of position `p` in pixel `i` is number
    /// `(p·components + c)·pixels + i`.
    pub accumulators: Vec<R>,
    /// Transmittance of the whole ray: number `n` of pixel `i` at `n·pixels + i`. A pixel has one number (grey), one per
    /// component (coloured), or a matrix of components × components, row by row.
    pub transmittance: Vec<R>,
}

impl<R: Real> Film<R> {
    /// Number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// The film of some pixels, by their numbers, as one row.
    #[must_use]
    pub fn of_pixels(&self, numbers: &[usize]) -> Self {
        let all = self.pixels().max(1);
        let picked = |plane: &[R]| numbers.iter().filter_map(|&i| plane.get(i).copied()).collect::<Vec<R>>();
        let planes = |from: &[R]| from.chunks_exact(all).flat_map(picked).collect();
        Self {
            size: [numbers.len(), 1],
            components: self.components,
            accumulators: planes(&self.accumulators),
            transmittance: planes(&self.transmittance),
        }
    }

    /// Converts every number of the film.
    #[must_use]
    pub fn map<S>(&self, number: impl Fn(R) -> S) -> Film<S> {
        let all = |numbers: &[R]| numbers.iter().map(|&one| number(one)).collect();
        Film {
            size: self.size,
            components: self.components,
            accumulators: all(&self.accumulators),
            transmittance: all(&self.transmittance),
        }
    }

    /// This film over `back`: rays pass through the medium of this film first, then through that of `back`. `A = A₁ +
    /// T₁·A₂`, `T = T₁·T₂` (Porter and Duff 1984), where `T` is a number, a number per component or a matrix. `None` if
    /// sizes, components or kinds of transmittance differ.
    #[must_use]
    pub fn over(mut self, back: &Self) -> Option<Self> {
        let shape = |film: &Self| (film.size, film.components, film.accumulators.len(), film.transmittance.len());
        if shape(&self) != shape(back) {
            return None;
        }
        let pixels = self.pixels();
        if pixels == 0 {
            return Some(self);
        }
        let (components, kinds) = (self.components.max(1), self.transmittance.len() / pixels);
        if kinds > components {
            return Some(self.over_by_matrices(back));
        }
        // Plane by plane, whose numbers lie side by side.
        let fronts = self.accumulators.chunks_exact_mut(pixels).zip(back.accumulators.chunks_exact(pixels));
        for (plane, (front, back)) in fronts.enumerate() {
            let through = if kinds == 1 { 0 } else { plane % components };
            let through = &self.transmittance[through * pixels..][..pixels];
            for ((front, &back), &through) in front.iter_mut().zip(back).zip(through) {
                *front = *front + through * back;
            }
        }
        for (front, &back) in self.transmittance.iter_mut().zip(&back.transmittance) {
            *front = *front * back;
        }
        Some(self)
    }

    /// [`Self::over`] for transmittances that are matrices.
    fn over_by_matrices(&self, back: &Self) -> Self {
        let (pixels, components) = (self.pixels(), self.components);
        let mut film = self.clone();
        for pixel in 0..pixels {
            // Row `c` of the front's transmittance times a vector of `back` that starts at `first`.
            let through = |numbers: &[R], first: usize, stride: usize, c: usize, sum: R| -> R {
                (0..components).fold(sum, |sum, n| {
                    let front = self.transmittance[(c * components + n) * pixels + pixel];
                    front.mul_add(numbers[(first + n * stride) * pixels + pixel], sum)
                })
            };
            for n in 0..self.accumulators.len() / pixels {
                let (first, at) = (n - n % components, n * pixels + pixel);
                film.accumulators[at] = through(&back.accumulators, first, 1, n % components, self.accumulators[at]);
            }
            for n in 0..components * components {
                let [c, column] = [n / components, n % components];
                film.transmittance[n * pixels + pixel] =
                    through(&back.transmittance, column, components, c, R::default());
            }
        }
        film
    }
}
