//! Rectangles of films: cut out, put back, and found where something was met.

use super::Film;

/// First column and row of a rectangle, and the column and row after its last.
pub type Rectangle = [[usize; 2]; 2];

impl Film<f32> {
    /// The film of `size` of rays that meet no medium, with the components and positions of this one. `None` if its
    /// transmittance is a matrix.
    #[must_use]
    pub fn of_no_medium(&self, size: [usize; 2]) -> Option<Self> {
        let (old, new) = (self.pixels().max(1), size[0] * size[1]);
        let numbers = self.transmittance.len() / old;
        let is_matrix = numbers > self.components.max(1);
        (!is_matrix).then(|| Self {
            size,
            components: self.components,
            accumulators: vec![0.0; self.accumulators.len() / old * new],
            transmittance: vec![1.0; numbers * new],
        })
    }

    /// The smallest rectangle outside of which all pixels are those of no medium, to the bit. Empty if all are.
    #[must_use]
    pub fn met(&self) -> Rectangle {
        let [width, height] = self.size;
        let (mut low, mut high) = ([width, height], [0, 0]);
        let sums = self.accumulators.chunks_exact(self.pixels().max(1)).map(|plane| (plane, 0.0_f32));
        let through = self.transmittance.chunks_exact(self.pixels().max(1)).map(|plane| (plane, 1.0_f32));
        for (plane, nothing) in sums.chain(through) {
            for (y, line) in plane.chunks_exact(width.max(1)).enumerate() {
                let is_met = |number: &f32| number.to_bits() != nothing.to_bits();
                let Some(first) = line.iter().position(is_met) else { continue };
                let last = line.iter().rposition(is_met).unwrap_or(first);
                low = [low[0].min(first), low[1].min(y)];
                high = [high[0].max(last + 1), high[1].max(y + 1)];
            }
        }
        if high == [0, 0] { [[0; 2]; 2] } else { [low, high] }
    }

    /// The pixels of a rectangle, which must lie in the film.
    #[must_use]
    pub fn cut_out(&self, [low, high]: Rectangle) -> Self {
        let size = [high[0] - low[0], high[1] - low[1]];
        let room = |numbers: &[f32]| Vec::with_capacity(numbers.len() / self.pixels().max(1) * size[0] * size[1]);
        let mut film = Self {
            size,
            components: self.components,
            accumulators: room(&self.accumulators),
            transmittance: room(&self.transmittance),
        };
        self.each_line(&self.accumulators, [low, high], |line| film.accumulators.extend_from_slice(line));
        self.each_line(&self.transmittance, [low, high], |line| film.transmittance.extend_from_slice(line));
        film
    }

    /// The numbers of the pixels of a rectangle, which must lie in the film, as bytes: those of [`Self::cut_out`].
    pub fn bytes_of(&self, rectangle: Rectangle, bytes: &mut Vec<u8>) {
        let [low, high] = rectangle;
        let numbers = (self.accumulators.len() + self.transmittance.len()) / self.pixels().max(1);
        bytes.reserve(4 * numbers * (high[0] - low[0]) * (high[1] - low[1]));
        for numbers in [&self.accumulators, &self.transmittance] {
            self.each_line(numbers, rectangle, |line| bytes.extend_from_slice(bytemuck::cast_slice(line)));
        }
    }

    /// Calls `with` for each line of a rectangle of the planes of `numbers`.
    fn each_line(&self, numbers: &[f32], [low, high]: Rectangle, mut with: impl FnMut(&[f32])) {
        let width = self.size[0];
        for plane in numbers.chunks_exact(self.pixels().max(1)) {
            let lines = plane[low[1] * width..high[1] * width].chunks_exact(width.max(1));
            lines.for_each(|line| with(&line[low[0]..high[0]]));
        }
    }

    /// Replaces the rectangle that begins at column and row `at` by `film`, which must lie in this film.
    pub fn put(&mut self, at: [usize; 2], film: &Self) {
        let ([width, height], [of_width, of_height]) = (self.size, film.size);
        let put = |numbers: &mut [f32], from: &[f32]| {
            let planes = numbers.chunks_exact_mut((width * height).max(1));
            for (plane, from) in planes.zip(from.chunks_exact((of_width * of_height).max(1))) {
                for (y, line) in (at[1]..).zip(from.chunks_exact(of_width.max(1))) {
                    plane[y * width + at[0]..][..of_width].copy_from_slice(line);
                }
            }
        };
        put(&mut self.accumulators, &film.accumulators);
        put(&mut self.transmittance, &film.transmittance);
    }
}
