//! Enlargement of pictures marched at a lower resolution.

use rayon::prelude::*;

use relume_base::number::rounded;
use relume_base::number::{count, whole};
use relume_scene::film::Film;

/// Bilinear enlargement from marched to displayed pixels, between pixel centres. The outermost pixels extend to the
/// edge.
///
/// Like relighting, it is linear in the pixel values: enlarging accumulators before relighting gives the same picture
/// as relighting first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Enlargement {
    marched: [usize; 2],
    shown: [usize; 2],
}

/// Position of a displayed pixel along one axis, between two marched pixels: `share` is its fraction of the distance
/// from the first to the second.
#[derive(Clone, Copy)]
struct Place {
    before: usize,
    after: usize,
    share: f32,
}

impl Enlargement {
    /// Creates the enlargement from `marched` pixels across and down to `shown`.
    #[must_use]
    pub const fn new(marched: [usize; 2], shown: [usize; 2]) -> Self {
        Self { marched, shown }
    }

    /// Whether the sizes are equal, so that pixels are copied unchanged.
    #[must_use]
    pub fn is_none(&self) -> bool {
        self.marched == self.shown
    }

    /// Returns the displayed pixels, row by row. They have as many components as the `marched` pixels; missing pixels
    /// are NaN.
    #[must_use]
    pub fn pixels<const N: usize>(&self, marched: &[[f32; N]]) -> Vec<[f32; N]> {
        if self.is_none() {
            return marched.to_vec();
        }
        let [columns, rows] = [self.places(0), self.places(1)];
        let row = |y: usize| marched.get(self.marched[0] * y..).unwrap_or_default();
        let shown = |place: &Place| {
            let rows = [row(place.before), row(place.after)];
            let mixed = |x: usize| {
                let [before, after] = rows.map(|row| row.get(x).copied().unwrap_or([f32::NAN; N]));
                between(before, after, place.share)
            };
            let mixed: Vec<[f32; N]> = (0..self.marched[0]).map(mixed).collect();
            let of = |x: usize| mixed.get(x).copied().unwrap_or([f32::NAN; N]);
            columns.iter().map(|at| between(of(at.before), of(at.after), at.share)).collect::<Vec<_>>()
        };
        rows.par_iter().flat_map_iter(shown).collect()
    }

    /// Enlarges every plane of a film.
    #[must_use]
    pub fn accumulation(&self, marched: &Film<f32>) -> Film<f32> {
        let pixels = (self.marched[0] * self.marched[1]).max(1);
        let planes = |planes: &[f32]| {
            let of_plane = |plane: &[f32]| self.pixels(plane.as_chunks::<1>().0);
            planes.chunks(pixels).flat_map(of_plane).flatten().collect()
        };
        let (accumulators, transmittance) = (planes(&marched.accumulators), planes(&marched.transmittance));
        Film { size: self.shown, components: marched.components, accumulators, transmittance }
    }

    /// Positions of the displayed pixels along `axis`.
    fn places(&self, axis: usize) -> Vec<Place> {
        let (marched, shown) = (self.marched[axis], self.shown[axis]);
        let place = |pixel: usize| {
            let at = ((count(pixel) + 0.5) * count(marched) / count(shown) - 0.5).max(0.0);
            let before = whole(at).min(marched.saturating_sub(1));
            Place { before, after: (before + 1).min(marched.saturating_sub(1)), share: rounded(at.fract()) }
        };
        (0..shown).map(place).collect()
    }
}

fn between<const N: usize>(before: [f32; N], after: [f32; N], share: f32) -> [f32; N] {
    std::array::from_fn(|part| share.mul_add(after[part] - before[part], before[part]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_of_half_the_pixels_is_enlarged_between_their_centres() {
        let shown = Enlargement::new([2, 1], [4, 2]).pixels(&[[0.0], [1.0]]);
        assert_eq!(shown.concat(), [0.0, 0.25, 0.75, 1.0, 0.0, 0.25, 0.75, 1.0]);
    }

    #[test]
    fn as_many_pixels_stay_as_they_are() {
        let pixels = [[f32::INFINITY, 2.0], [3.0, f32::MIN_POSITIVE]];
        assert_eq!(Enlargement::new([1, 2], [1, 2]).pixels(&pixels), pixels);
    }

    #[test]
    fn every_plane_of_what_a_march_leaves_is_enlarged_by_itself() {
        let marched =
            Film { size: [2, 1], components: 1, accumulators: vec![0.0, 4.0, 8.0, 8.0], transmittance: vec![1.0, 0.0] };
        let shown = Enlargement::new([2, 1], [4, 1]).accumulation(&marched);
        assert_eq!(shown.size, [4, 1]);
        assert_eq!(shown.accumulators, [0.0, 1.0, 3.0, 4.0, 8.0, 8.0, 8.0, 8.0]);
        assert_eq!(shown.transmittance, [1.0, 0.75, 0.25, 0.0]);
    }

    #[test]
    fn pixels_that_are_missing_are_no_numbers() {
        let shown = Enlargement::new([2, 2], [4, 4]).pixels(&[[1.0]]);
        assert_eq!((shown.len(), shown[15][0].is_nan()), (16, true));
        assert!(Enlargement::new([0, 0], [0, 0]).pixels::<1>(&[]).is_empty());
    }
}
