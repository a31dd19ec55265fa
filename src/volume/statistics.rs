//! Range, mean and histogram of a volume.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Volume, VolumeError, Voxel, with_voxels};
use relume_base::parallel;

/// Number of histogram bins.
pub const BINS: usize = 64;

/// Voxels per parallel task.
const CHUNK: usize = 1 << 20;

/// Floats added without compensation; the rounding error of a run is below 1024 · 2⁻⁵³ = 1.2e-13 of Σ|x|.
const RUN: usize = 1024;

/// Statistics of the values `slope · stored + intercept` of a volume.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// Smallest finite value.
    pub min: f64,
    /// Largest finite value.
    pub max: f64,
    /// Mean of the finite values. For integers it is exact up to one rounding; for floats it is within 1e-12 of the
    /// mean |value|.
    pub mean: f64,
    /// Number of finite values in each of 64 equal bins over `[min, max]`. A bin includes its lower edge, the last bin
    /// both edges. If `min` equals `max`, the first bin holds all values.
    pub histogram: [u64; BINS],
    /// Number of NaN voxels.
    pub not_a_number: u64,
    /// Number of ±∞ voxels.
    pub infinite: u64,
}

impl Statistics {
    /// Those of a volume of zeros, of which none is counted.
    #[must_use]
    pub const fn of_nothing() -> Self {
        Self { min: 0.0, max: 0.0, mean: 0.0, histogram: [0; BINS], not_a_number: 0, infinite: 0 }
    }
}

impl Volume {
    /// Computes the statistics of all voxels in parallel; the result does not depend on the number of threads.
    ///
    /// # Errors
    ///
    /// [`VolumeError::NothingFinite`] if every voxel is NaN or infinite.
    pub fn statistics(&self) -> Result<Statistics, VolumeError> {
        let Measured { extent, mean, histogram } = match &self.bricks {
            Some(cache) => cache.measured().clone(),
            None => with_voxels!(&self.voxels, stored => Measured::of(measure(stored))),
        };
        let Extent { min, max, finite, not_a_number, infinite } = extent;
        if finite == 0 {
            return Err(VolumeError::NothingFinite { source_name: self.source.clone(), not_a_number, infinite });
        }
        let value = |stored: f64| stored.mul_add(self.slope, self.intercept);
        let (mut ends, mut histogram) = ([value(min), value(max)], histogram);
        if self.slope < 0.0 {
            ends.reverse();
            histogram.reverse();
        }
        if self.slope == 0.0 {
            histogram = std::array::from_fn(|bin| if bin == 0 { finite } else { 0 });
        }
        let mean = value(mean);
        Ok(Statistics { min: ends[0], max: ends[1], mean, histogram, not_a_number, infinite })
    }
}

/// Runs two passes: over the voxels, or, for types of one or two bytes, over the counts of their few values.
fn measure<T: Voxel>(stored: &[T]) -> (Extent, Sums) {
    match occurrences(stored) {
        Some(values) => measure_counted(&values),
        None => {
            let chunks = stored.len().div_ceil(CHUNK);
            let chunk = |number: usize| {
                let first = number * CHUNK;
                stored[first..stored.len().min(first + CHUNK)].iter().map(|&voxel| (voxel, 1))
            };
            let extents = parallel::map(chunks, &|number| Extent::of(chunk(number)));
            let extent = extents.iter().fold(Extent::EMPTY, Extent::join);
            let sums = parallel::map(chunks, &|number| Sums::of(chunk(number), &extent));
            let sums = sums.iter().fold(Sums::EMPTY, Sums::join);
            (extent, sums)
        }
    }
}

pub(super) fn measure_counted<T: Voxel>(values: &[(T, u64)]) -> (Extent, Sums) {
    let extent = Extent::of(values.iter().copied());
    (extent, Sums::of(values.iter().copied(), &extent))
}

/// The occurrences of each value of a type of one or two bytes; `None` for other types.
pub(super) fn occurrences<T: Voxel>(stored: &[T]) -> Option<Vec<(T, u64)>> {
    match size_of::<T>() {
        1 => Some(counted::<T, u8>(stored)),
        2 => Some(counted::<T, u16>(stored)),
        _ => None,
    }
}

/// Counts the occurrences of each value; `Bits` is the unsigned integer of the size of `T`.
fn counted<T: Voxel, Bits: Voxel + Into<usize> + TryFrom<usize>>(stored: &[T]) -> Vec<(T, u64)> {
    let counts = counts::<Bits>(bytemuck::cast_slice(stored));
    let occurring = counts.into_iter().enumerate().filter(|&(_, count)| count > 0);
    occurring.filter_map(|(bits, count)| Some((bytemuck::cast::<Bits, T>(Bits::try_from(bits).ok()?), count))).collect()
}

/// Number of occurrences of each value.
fn counts<Bits: Voxel + Into<usize>>(bits: &[Bits]) -> Vec<u64> {
    let values = 1 << (8 * size_of::<Bits>());
    let tally = |chunk: &[Bits]| {
        // Equal neighbours would wait for each other's increment; four tables avoid this.
        let mut tables = vec![[0_u32; 4]; values];
        for (index, &bits) in chunk.iter().enumerate() {
            tables[bits.into()][index % 4] += 1;
        }
        tables.iter().map(|table| table.iter().copied().map(u64::from).sum()).collect::<Vec<u64>>()
    };
    let add = |mut sum: Vec<u64>, other: Vec<u64>| {
        sum.iter_mut().zip(other).for_each(|(sum, count)| *sum += count);
        sum
    };
    // Large chunks, because each task allocates its own tables; the counts still fit `u32`.
    bits.par_chunks(4 * CHUNK).map(tally).reduce(|| vec![0; values], add)
}

/// Statistics of the stored values, before slope and intercept.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measured {
    pub(super) extent: Extent,
    pub(super) mean: f64,
    pub(super) histogram: [u64; BINS],
}

impl Measured {
    pub(super) fn of((extent, sums): (Extent, Sums)) -> Self {
        Self { extent, mean: sums.mean(&extent), histogram: sums.histogram }
    }
}

/// Result of the first pass over the stored values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Extent {
    pub(super) min: f64,
    pub(super) max: f64,
    pub(super) finite: u64,
    pub(super) not_a_number: u64,
    pub(super) infinite: u64,
}

impl Extent {
    pub(super) const EMPTY: Self =
        Self { min: f64::INFINITY, max: f64::NEG_INFINITY, finite: 0, not_a_number: 0, infinite: 0 };

    pub(super) fn of<T: Voxel>(values: impl Iterator<Item = (T, u64)>) -> Self {
        let mut extent = Self::EMPTY;
        for (voxel, times) in values {
            let value = voxel.to_f64();
            if value.is_finite() {
                extent.finite += times;
                extent.min = extent.min.min(value);
                extent.max = extent.max.max(value);
            } else if value.is_nan() {
                extent.not_a_number += times;
            } else {
                extent.infinite += times;
            }
        }
        extent
    }

    pub(super) fn join(self, other: &Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            finite: self.finite + other.finite,
            not_a_number: self.not_a_number + other.not_a_number,
            infinite: self.infinite + other.infinite,
        }
    }

    /// Scale that keeps sums and differences of the largest floats finite: a power of two for large extents, otherwise
    /// 1.
    fn unit(&self) -> f64 {
        const LARGE: f64 = 1e280;
        const SMALL: f64 = f64::EPSILON;
        if self.min < -LARGE || self.max > LARGE { SMALL } else { 1.0 }
    }
}

/// Result of the second pass over the finite stored values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sums {
    /// Sum of integer values.
    whole: i128,
    /// Sum of float values in the extent's unit; `lost` is its accumulated rounding error (Neumaier 1974).
    sum: f64,
    lost: f64,
    histogram: [u64; BINS],
}

impl Sums {
    pub(super) const EMPTY: Self = Self { whole: 0, sum: 0.0, lost: 0.0, histogram: [0; BINS] };

    pub(super) fn of<T: Voxel>(values: impl Iterator<Item = (T, u64)>, extent: &Extent) -> Self {
        let mut sums = Self::EMPTY;
        let bins = Bins::over(extent);
        let (mut run, mut in_run) = (0.0, 0);
        for (voxel, times) in values {
            let value = voxel.to_f64();
            if !value.is_finite() {
                continue;
            }
            sums.histogram[bins.find(value)] += times;
            if let Some(whole) = voxel.to_whole() {
                sums.whole += whole * i128::from(times);
            } else {
                run += value * bins.unit;
                in_run += 1;
                if in_run == RUN {
                    sums.add(run);
                    (run, in_run) = (0.0, 0);
                }
            }
        }
        sums.add(run);
        sums
    }

    fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        self.lost += if self.sum.abs() >= term.abs() { (self.sum - sum) + term } else { (term - sum) + self.sum };
        self.sum = sum;
    }

    pub(super) fn join(mut self, other: &Self) -> Self {
        self.whole += other.whole;
        self.add(other.sum);
        self.lost += other.lost;
        self.histogram.iter_mut().zip(other.histogram).for_each(|(sum, count)| *sum += count);
        self
    }

    #[expect(clippy::cast_precision_loss, reason = "the quotient is rounded anyway")]
    fn mean(&self, extent: &Extent) -> f64 {
        let number = extent.finite as f64;
        if self.whole == 0 { (self.sum + self.lost) / number / extent.unit() } else { self.whole as f64 / number }
    }
}

/// Equal bins over an extent, with the edges of numpy's `linspace`.
struct Bins {
    unit: f64,
    edges: [f64; BINS + 1],
    per_unit: f64,
}

impl Bins {
    #[expect(clippy::cast_precision_loss, reason = "small numbers")]
    fn over(extent: &Extent) -> Self {
        let unit = extent.unit();
        let (min, max) = (extent.min * unit, extent.max * unit);
        let width = (max - min) / BINS as f64;
        let edges = std::array::from_fn(|edge| if edge == BINS { max } else { (edge as f64).mul_add(width, min) });
        Self { unit, edges, per_unit: if width > 0.0 { 1.0 / width } else { 0.0 } }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, and cut to the bins")]
    fn find(&self, value: f64) -> usize {
        let value = value * self.unit;
        let bin = (((value - self.edges[0]) * self.per_unit) as usize).min(BINS - 1);
        if value < self.edges[bin] {
            bin.saturating_sub(1)
        } else if bin + 1 < BINS && value >= self.edges[bin + 1] && self.per_unit > 0.0 {
            bin + 1
        } else {
            bin
        }
    }
}
