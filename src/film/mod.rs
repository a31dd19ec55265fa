//! The film: accumulators and transmittance of each pixel, independent of the light's spectrum, and its relighting.

mod matrices;
mod relight;
mod rows;
mod tree;

pub use matrices::{Components, RelightMatrices, display_from_xyz};
pub(crate) use relight::relit_pixel;
pub use rows::Rectangle;
pub use tree::composited;

use crate::number::Real;

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
    pub fn over(&self, back: &Self) -> Option<Self> {
        let shape = |film: &Self| (film.size, film.components, film.accumulators.len(), film.transmittance.len());
        if shape(self) != shape(back) {
            return None;
        }
        let (pixels, components) = (self.pixels(), self.components);
        let kinds = self.transmittance.len().checked_div(pixels).unwrap_or(0);
        let mut film = self.clone();
        for pixel in 0..pixels {
            let front = |n: usize| self.transmittance[n * pixels + pixel];
            // Row `c` of the front's transmittance times a vector that starts at `first` in `numbers`.
            let through = |numbers: &[R], first: usize, stride: usize, c: usize, sum: R| -> R {
                let at = |n: usize| numbers[(first + n * stride) * pixels + pixel];
                match kinds {
                    1 => front(0).mul_add(at(c), sum),
                    _ if kinds == components => front(c).mul_add(at(c), sum),
                    _ => (0..components).fold(sum, |sum, n| front(c * components + n).mul_add(at(n), sum)),
                }
            };
            for position in 0..self.accumulators.len().checked_div(pixels * components).unwrap_or(0) {
                for c in 0..components {
                    let at = (position * components + c) * pixels + pixel;
                    film.accumulators[at] =
                        through(&back.accumulators, position * components, 1, c, self.accumulators[at]);
                }
            }
            for n in 0..kinds {
                let is_matrix = kinds > components.max(1);
                let (c, column) = if is_matrix { (n / components, n % components) } else { (n, 0) };
                let stride = if is_matrix { components } else { 1 };
                film.transmittance[n * pixels + pixel] = through(&back.transmittance, column, stride, c, R::default());
            }
        }
        Some(film)
    }
}
