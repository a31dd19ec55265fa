//! Prefix integral of the density over the values, for intervals between the values of two samples.

use super::segments::cell_mean;
use super::{Steps, Storage};
use crate::Scene;
use crate::plan::Planned;
use relume_base::number::count;

/// Cells of the table: vectors of the smallest uniform buffer that a device may have, 16 KiB.
pub const CROSSING_CELLS: usize = 1024;
/// Part of the range of visible values by which the table is longer at each end.
const MARGIN: f64 = 1.0 / 256.0;

/// The part of the light that a step would lose or scatter at each value, summed up over the range of visible values in cells of equal width
/// (docs/theory/refinement.md). The largest number of a density counts, before labels and factors.
#[derive(Clone, Debug, PartialEq)]
pub struct CrossingTable {
    /// Of each cell the sum over those below, its own number, and the numbers at its bounds: the means of the cells on both sides, so that
    /// they change continuously.
    pub cells: Vec<[f64; 4]>,
    /// Lowest and highest value of the table, in values from 0 to 1 of the domain.
    range: [f64; 2],
}

impl CrossingTable {
    /// Builds the table of `scene` over `domain` (lowest and highest value).
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, domain: [f64; 2]) -> Self {
        let steps = Steps::new(scene, planned);
        let bends = scene.transfer.bends();
        let [low, high] = visible(scene, &bends, domain);
        let groups = planned.plan.groups.in_tables();
        let of_cell = |cell: usize| {
            let ends = [cell, cell + 1].map(|bound| (high - low).mul_add(count(bound) / count(CROSSING_CELLS), low));
            let [source, opacity] = cell_mean(&steps, &bends, ends);
            // Of each number, the sum over the groups.
            let most = |numbers: &[f64]| {
                let each = (numbers.len() / groups.max(1)).max(1);
                let of = |number: usize| numbers.iter().skip(number).step_by(each).map(|it| it.abs()).sum::<f64>();
                (0..each).map(of).fold(0.0, f64::max)
            };
            -(-most(&source).max(most(&opacity))).exp_m1()
        };
        let own: Vec<f64> = (0..CROSSING_CELLS).map(of_cell).collect();
        let at = |bound: usize| f64::midpoint(own[bound.saturating_sub(1)], own[bound.min(CROSSING_CELLS - 1)]);
        let mut below = 0.0;
        let cells = own.iter().enumerate().map(|(cell, &own)| {
            let before = below;
            below += own;
            [before, own, at(cell), at(cell + 1)]
        });
        let width = domain[1] - domain[0];
        Self { cells: cells.collect(), range: [low, high].map(|end| (end - domain[0]) / width) }
    }

    /// Scale and offset from a value, 0 to 1 of the domain, to a place in the table: 0 to [`CROSSING_CELLS`] within its range.
    #[must_use]
    pub fn place_from_normalised(&self) -> [f64; 2] {
        let [low, high] = self.range;
        let scale = count(CROSSING_CELLS) / (high - low);
        [scale, -low * scale]
    }

    /// The same from a texel's value.
    #[must_use]
    pub fn place_from_texel(&self, storage: &Storage) -> [f64; 2] {
        let [scale, offset] = self.place_from_normalised();
        let [of_texel, from] = storage.normalised_from_texel();
        [scale * of_texel, from.mul_add(scale, offset)]
    }
}

/// The range of values outside which nothing is visible, and a little more, within the `domain`.
fn visible(scene: &Scene, bends: &[f64], [low, high]: [f64; 2]) -> [f64; 2] {
    let curves = || scene.transfer.terms.iter().flat_map(|term| [&term.opacity, &term.absorption]);
    // Curves keep the numbers of their ends.
    let is_open = |end: Option<&(f64, f64)>| end.is_some_and(|point| point.1 > 0.0);
    let inside = || bends.iter().copied().filter(|bend| bend.is_finite());
    let [first, last] = [inside().fold(f64::INFINITY, f64::min), inside().fold(f64::NEG_INFINITY, f64::max)];
    let margin = MARGIN * (last - first);
    let from = if curves().any(|curve| is_open(curve.first())) { low } else { (first - margin).max(low) };
    let to = if curves().any(|curve| is_open(curve.last())) { high } else { (last + margin).min(high) };
    if from < to { [from, to] } else { [low, high] }
}
