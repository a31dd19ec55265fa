//! A march that goes from process to process: each marches its block of a tile of the picture, and sends the film so far
//! to the process with the next block along the rays.

use std::ops::Range;

use super::Ranks;
use crate::film::Film;

/// Tiles of whole rows of a picture with `height` rows, for `count` processes: at least four for each, so that most of them
/// march at the same time, of a multiple of `group` rows.
#[must_use]
pub fn tiles(height: usize, group: usize, count: usize) -> Vec<Range<usize>> {
    let group = group.max(1);
    let rows = height.div_ceil(4 * count).next_multiple_of(group);
    (0..height).step_by(rows).map(|first| first..(first + rows).min(height)).collect()
}

/// The order of the blocks along the rays, and where they are.
#[derive(Clone, Debug)]
pub struct Relay {
    /// Ranks from front to back, each with one block.
    pub order: Vec<usize>,
    /// Rows of the picture that the block of each rank may cover.
    pub rows: Vec<Range<usize>>,
    /// Width of the picture.
    pub width: usize,
    /// Components of an accumulator.
    pub components: usize,
    /// Numbers of all accumulators of a pixel, and of its transmittance.
    pub numbers: [usize; 2],
}

impl Relay {
    /// The ranks that march `tile`, from front to back: at least one.
    #[must_use]
    pub fn chain(&self, tile: &Range<usize>) -> Vec<usize> {
        let covers =
            |&&rank: &&usize| self.rows.get(rank).is_some_and(|rows| rows.start < tile.end && tile.start < rows.end);
        let chain: Vec<usize> = self.order.iter().filter(covers).copied().collect();
        if chain.is_empty() { self.order.iter().take(1).copied().collect() } else { chain }
    }

    /// Marches `tiles` in their order. `march` goes on with the rows of a tile from the film of the blocks in front, or
    /// begins them, and returns the film after this block. Returns the tiles that end here, and the bytes that were sent.
    ///
    /// No process waits for itself: all take the tiles in one order, and each tile goes along the order of the blocks.
    ///
    /// # Errors
    ///
    /// Those of `march`.
    pub fn run<M, E>(
        &self,
        ranks: &dyn Ranks,
        tiles: &[Range<usize>],
        mut march: M,
    ) -> Result<(Vec<Range<usize>>, usize), E>
    where
        M: FnMut(&Range<usize>, Option<&Film<f32>>) -> Result<Film<f32>, E>,
    {
        let (mut ended, mut sent_bytes) = (Vec::new(), 0);
        for tile in tiles {
            let chain = self.chain(tile);
            let Some(place) = chain.iter().position(|&rank| rank == ranks.rank()) else { continue };
            let before = match place.checked_sub(1) {
                Some(before) => ranks.exchange(&[], &chain[before..=before]),
                None => Vec::new(),
            };
            let before = before.first().map(|bytes| self.film(bytes, tile.len()));
            let film = march(tile, before.as_ref())?;
            match chain.get(place + 1) {
                None => ended.push(tile.clone()),
                Some(&next) => {
                    let numbers = [&*film.accumulators, &*film.transmittance].concat();
                    sent_bytes += 4 * numbers.len();
                    ranks.exchange(&[(next, bytemuck::cast_slice(&numbers))], &[]);
                }
            }
        }
        Ok((ended, sent_bytes))
    }

    /// The film of `rows` rows that a process has sent.
    fn film(&self, bytes: &[u8], rows: usize) -> Film<f32> {
        let size = [self.width, rows];
        let mut accumulators: Vec<f32> = bytemuck::pod_collect_to_vec(bytes);
        let transmittance = accumulators.split_off(accumulators.len().min(self.numbers[0] * size[0] * size[1]));
        Film { size, components: self.components, accumulators, transmittance }
    }
}
