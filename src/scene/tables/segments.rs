//! Prefix integrals of the transfer function over the range of the data, for segments between two values.

use super::transfer::opacity_numbers;
use super::{Step, Steps, Storage};
use crate::plan::{LANE, Planned};
use crate::{Lookup, Scene};
use relume_base::number::count;

/// Numbers of a table in a uniform buffer of 64 KiB, in vectors: the least size of a table, since it costs nothing.
const VECTORS: usize = 4096;
/// Largest number of cells.
const MOST: usize = 1 << 16;
/// Least number of cells across the narrowest feature of a transfer function.
const PER_FEATURE: f64 = 8.0;
/// Nodes of Gauss quadrature on −1 to 1 with two points, exact for cubics.
const TWO_POINTS: [(f64, f64); 2] = [(-0.577_350_269_189_625_8, 1.0), (0.577_350_269_189_625_8, 1.0)];
/// The same with eight points, exact for polynomials of degree 15 (Abramowitz and Stegun 1964, table 25.4).
const EIGHT_POINTS: [(f64, f64); 8] = [
    (-0.960_289_856_497_536_2, 0.101_228_536_290_376_3),
    (-0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (-0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (-0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
    (0.960_289_856_497_536_2, 0.101_228_536_290_376_3),
];

/// Prefix integrals of the densities of a scene over its values (docs/theory/segments.md): `n` cells of equal width,
/// and at each of their `n + 1` bounds the integral from the lowest value, in cells, divided by [`Self::unit`]. The
/// difference of two integrals is exact in 32 bits, so the mean between two values has the same error everywhere.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentTable {
    /// Integrals of the scattered light per step length: `(cells + 1) × groups × lanes` vectors.
    pub source: Vec<[i32; LANE]>,
    /// Integrals of the optical depth per step length: [`Self::opacity_numbers`] per bound and group.
    pub depth: Vec<i32>,
    /// Vectors per bound and group of [`Self::source`].
    pub lanes: usize,
    /// Numbers per bound and group of [`Self::depth`].
    pub opacity_numbers: usize,
    /// Groups of terms, whose densities have factors of their own.
    pub groups: usize,
    /// Unit of the integrals.
    pub unit: f64,
    /// Whether a cell surrounds the value of an entry, rather than lying between two.
    centred: bool,
}

impl SegmentTable {
    /// Builds the table of `scene` over `domain` (lowest and highest value). With [`Lookup::Nearest`], a cell has the
    /// density of its entry; otherwise the mean density between its bounds.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, domain @ [low, high]: [f64; 2]) -> Self {
        let (lanes, opacity_numbers) = (planned.plan.parts().lanes, opacity_numbers(planned));
        let groups = planned.plan.groups.in_tables();
        let centred = planned.plan.lookup == Lookup::Nearest;
        let cells = cells(scene, domain, groups * lanes, centred);
        let steps = Steps::new(scene, planned);
        let bends = scene.transfer.bends();
        let mut sums = vec![vec![0.0; groups * (lanes * LANE + opacity_numbers)]];
        let (mut density, mut part) = (Step::default(), Step::default());
        for cell in 0..cells {
            let at = |place: f64| (high - low).mul_add(place, low);
            let into = [&mut density.source, &mut density.opacity];
            if centred {
                steps.write_densities(|_| at(count(cell) / count(cells - 1)), into);
            } else {
                let ends = [count(cell), count(cell + 1)].map(|bound| at(bound / count(cells)));
                mean(&steps, &bends, ends, &TWO_POINTS, into, &mut part);
            }
            let before = &sums[cell];
            sums.push(before.iter().zip(density.source.iter().chain(&density.opacity)).map(|(a, b)| a + b).collect());
        }
        // The difference of any two integrals fits; negative reflectances lower an integral that others raise.
        let range = |number: usize| {
            let of_number = sums.iter().map(|sum| sum[number]);
            of_number.clone().fold(0.0_f64, f64::max) - of_number.fold(0.0_f64, f64::min)
        };
        let largest = (0..sums[0].len()).map(range).fold(0.0_f64, f64::max);
        let unit = if largest > 0.0 { largest / f64::from(i32::MAX - 1) } else { 1.0 };
        let whole = |sum: f64| to_i32((sum / unit).round());
        let (mut source, mut depth) = (Vec::new(), Vec::new());
        for sum in sums {
            let (lit, deep) = sum.split_at(groups * lanes * LANE);
            source.extend(lit.chunks_exact(LANE).map(|lane| std::array::from_fn(|part| whole(lane[part]))));
            depth.extend(deep.iter().map(|&sum| whole(sum)));
        }
        Self { source, depth, lanes, opacity_numbers, groups, unit, centred }
    }

    /// Number of cells.
    #[must_use]
    pub fn cells(&self) -> usize {
        self.depth.len() / (self.groups * self.opacity_numbers) - 1
    }

    /// Scale and offset from a texel's value to a table coordinate, 0 to [`Self::cells`].
    #[must_use]
    pub fn coordinate_from_texel(&self, storage: &Storage) -> [f64; 2] {
        let [scale, offset] = storage.normalised_from_texel();
        if self.centred {
            let last = count(self.cells() - 1);
            [scale * last, offset.mul_add(last, 0.5)]
        } else {
            [scale, offset].map(|term| term * count(self.cells()))
        }
    }

    /// Closed interval of table coordinates outside which every density is 0: an end still reads the cell beside it.
    #[must_use]
    pub fn active(&self) -> [f64; 2] {
        let first = (0..self.cells()).find(|&cell| self.is_active(cell));
        let last = (0..self.cells()).rfind(|&cell| self.is_active(cell));
        [first.map_or(f64::INFINITY, count), last.map_or(f64::NEG_INFINITY, |cell| count(cell + 1))]
    }

    /// Whether the values at each entry are visible, from the lowest value to the highest: the centres of cells, or
    /// their bounds.
    #[must_use]
    pub fn active_entries(&self) -> Vec<bool> {
        let cells = self.cells();
        let is_active = |cell: usize| cell < cells && self.is_active(cell);
        if self.centred {
            (0..cells).map(is_active).collect()
        } else {
            (0..=cells).map(|bound| is_active(bound) || bound > 0 && is_active(bound - 1)).collect()
        }
    }

    /// Whether a density of cell `i` is not 0.
    fn is_active(&self, i: usize) -> bool {
        self.bound(i) != self.bound(i + 1)
    }

    /// The integrals of scattered light and optical depth at bound `i`, of all groups.
    pub(crate) fn bound(&self, i: usize) -> [&[i32]; 2] {
        let (lanes, numbers) = (self.groups * self.lanes, self.groups * self.opacity_numbers);
        [self.source[i * lanes..][..lanes].as_flattened(), &self.depth[i * numbers..][..numbers]]
    }
}

/// Number of cells: as the scene states its entries, else as many as are needed for the narrowest feature.
fn cells(scene: &Scene, [low, high]: [f64; 2], lanes: usize, centred: bool) -> usize {
    if centred {
        return scene.transfer.entries.unwrap_or(256).max(2);
    }
    if let Some(entries) = scene.transfer.entries {
        return (entries - 1).max(1);
    }
    let bends: Vec<f64> = scene.transfer.bends().into_iter().filter(|bend| (low..=high).contains(bend)).collect();
    let narrowest = bends.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let mut cells = (VECTORS / lanes.max(1)).saturating_sub(1).max(1);
    while cells < MOST && narrowest / (high - low) * count(cells) < PER_FEATURE {
        cells = (2 * cells).min(MOST);
    }
    cells
}

/// Sets `density` to the mean densities of the groups of terms over the values between `ends`, in either order, in f64: Gauss quadrature between
/// `bends`, the values at which the density has a corner or a jump. `part` is memory for the densities of single values.
pub(crate) fn mean_density(
    steps: &Steps<'_>,
    bends: &[f64],
    ends: [f64; 2],
    density: [&mut Vec<f64>; 2],
    part: &mut Step,
) {
    mean(steps, bends, ends, &EIGHT_POINTS, density, part);
}

/// Mean densities between two values: the light scattered and the optical depth per step length.
pub(super) fn cell_mean(steps: &Steps<'_>, bends: &[f64], ends: [f64; 2]) -> [Vec<f64>; 2] {
    let (mut density, mut part) = (Step::default(), Step::default());
    mean(steps, bends, ends, &TWO_POINTS, [&mut density.source, &mut density.opacity], &mut part);
    [density.source, density.opacity]
}

fn mean(
    steps: &Steps<'_>,
    bends: &[f64],
    [a, b]: [f64; 2],
    points: &[(f64, f64)],
    [source, opacity]: [&mut Vec<f64>; 2],
    part: &mut Step,
) {
    let (low, high) = (a.min(b), a.max(b));
    if high - low <= 1e-12 * (low.abs() + high.abs()) {
        return steps.write_densities(|_| f64::midpoint(low, high), [source, opacity]);
    }
    let within = bends.partition_point(|&bend| bend <= low)..bends.partition_point(|&bend| bend < high);
    let mut from = low;
    let mut first = true;
    for &to in bends.get(within).unwrap_or_default().iter().chain([&high]) {
        for &(node, weight) in points {
            let value = f64::midpoint(from, to) + node * (to - from) / 2.0;
            let share = weight / 2.0 * ((to - from) / (high - low));
            if std::mem::take(&mut first) {
                steps.write_densities(|_| value, [source, opacity]);
                source.iter_mut().chain(&mut *opacity).for_each(|number| *number *= share);
                continue;
            }
            steps.write_densities(|_| value, [&mut part.source, &mut part.opacity]);
            let parts = part.source.iter().chain(&part.opacity);
            for (sum, part) in source.iter_mut().chain(&mut *opacity).zip(parts) {
                *sum = part.mul_add(share, *sum);
            }
        }
        from = to;
    }
}

/// Converts a whole number within the range of i32.
#[expect(clippy::cast_possible_truncation, reason = "at most i32::MAX, by its unit")]
fn to_i32(number: f64) -> i32 {
    number as i32
}
