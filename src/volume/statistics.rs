//! Range, mean and histogram of a volume.

use rayon::prelude::*;

use super::{Volume, VolumeError, Voxel, with_voxels};

/// Bins of a histogram.
pub const BINS: usize = 64;

/// Voxels one task looks at.
const CHUNK: usize = 1 << 20;

/// Floats added without compensation; so few round by less than 1024 · 2⁻⁵³ = 1.2e-13 of Σ|x|.
const RUN: usize = 1024;

/// What the values of a volume are like: `slope · stored + intercept`.
#[derive(Clone, Debug, PartialEq)]
pub struct Statistics {
    /// The smallest finite value.
    pub min: f64,
    /// The largest finite value.
    pub max: f64,
    /// The mean of the finite values: of integers the exact one, rounded; of floats within 1e-12 of the mean |value|.
    pub mean: f64,
    /// How many finite values lie in each of 64 equal bins over `[min, max]`; a bin holds its lower edge, the last one
    /// both. All are in the first where `min` is `max`.
    pub histogram: [u64; BINS],
    /// How many voxels are NaN.
    pub not_a_number: u64,
    /// How many voxels are ±∞.
    pub infinite: u64,
}

impl Volume {
    /// The statistics of all voxels, computed in parallel; the answer does not depend on the number of threads.
    ///
    /// # Errors
    ///
    /// [`VolumeError::NothingFinite`] where every voxel is NaN or infinite.
    pub fn statistics(&self) -> Result<Statistics, VolumeError> {
        let (extent, sums) = with_voxels!(&self.voxels, stored => measure(stored));
        let Extent { min, max, finite, not_a_number, infinite } = extent;
        if finite == 0 {
            return Err(VolumeError::NothingFinite { source_name: self.source.clone(), not_a_number, infinite });
        }
        let value = |stored: f64| stored.mul_add(self.slope, self.intercept);
        let (mut ends, mut histogram) = ([value(min), value(max)], sums.histogram);
        if self.slope < 0.0 {
            ends.reverse();
            histogram.reverse();
        }
        if self.slope == 0.0 {
            histogram = std::array::from_fn(|bin| if bin == 0 { finite } else { 0 });
        }
        let mean = value(sums.mean(&extent));
        Ok(Statistics { min: ends[0], max: ends[1], mean, histogram, not_a_number, infinite })
    }
}

/// Two passes: over the voxels, or over the few values that voxels of one or two bytes can have.
fn measure<T: Voxel>(stored: &[T]) -> (Extent, Sums) {
    match size_of::<T>() {
        1 => measure_counted(&counted::<T, u8>(stored)),
        2 => measure_counted(&counted::<T, u16>(stored)),
        _ => {
            let chunks = || stored.par_chunks(CHUNK).map(|chunk| chunk.iter().map(|&voxel| (voxel, 1)));
            let extents: Vec<Extent> = chunks().map(Extent::of).collect();
            let extent = extents.iter().fold(Extent::EMPTY, Extent::join);
            let sums: Vec<Sums> = chunks().map(|chunk| Sums::of(chunk, &extent)).collect();
            let sums = sums.iter().fold(Sums::EMPTY, Sums::join);
            (extent, sums)
        }
    }
}

fn measure_counted<T: Voxel>(values: &[(T, u64)]) -> (Extent, Sums) {
    let extent = Extent::of(values.iter().copied());
    (extent, Sums::of(values.iter().copied(), &extent))
}

/// How often each value occurs; `Bits` is the unsigned integer of the size of `T`.
fn counted<T: Voxel, Bits: Voxel + Into<usize> + TryFrom<usize>>(stored: &[T]) -> Vec<(T, u64)> {
    let values = 1 << (8 * size_of::<Bits>());
    let bits: &[Bits] = bytemuck::cast_slice(stored);
    let tally = |chunk: &[Bits]| {
        // Equal neighbours would wait for one another's sum; four tables do not.
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
    // Many voxels a task: each pays for tables of its own. `u32` holds as many.
    let counts = bits.par_chunks(4 * CHUNK).map(tally).reduce(|| vec![0; values], add);
    let occurring = counts.into_iter().enumerate().filter(|&(_, count)| count > 0);
    occurring.filter_map(|(bits, count)| Some((bytemuck::cast::<Bits, T>(Bits::try_from(bits).ok()?), count))).collect()
}

/// What the first pass finds out, of stored values.
#[derive(Clone, Copy)]
struct Extent {
    min: f64,
    max: f64,
    finite: u64,
    not_a_number: u64,
    infinite: u64,
}

impl Extent {
    const EMPTY: Self = Self { min: f64::INFINITY, max: f64::NEG_INFINITY, finite: 0, not_a_number: 0, infinite: 0 };

    fn of<T: Voxel>(values: impl Iterator<Item = (T, u64)>) -> Self {
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

    fn join(self, other: &Self) -> Self {
        Self {
            min: self.min.min(other.min),
            max: self.max.max(other.max),
            finite: self.finite + other.finite,
            not_a_number: self.not_a_number + other.not_a_number,
            infinite: self.infinite + other.infinite,
        }
    }

    /// A power of two that keeps sums and differences of the largest floats finite; 1 for all others.
    fn unit(&self) -> f64 {
        const LARGE: f64 = 1e280;
        const SMALL: f64 = f64::EPSILON;
        if self.min < -LARGE || self.max > LARGE { SMALL } else { 1.0 }
    }
}

/// What the second pass finds out, of finite stored values.
#[derive(Clone, Copy)]
struct Sums {
    /// Of integers.
    whole: i128,
    /// Of floats, in the unit of the extent, and what was rounded off (Neumaier 1974).
    sum: f64,
    lost: f64,
    histogram: [u64; BINS],
}

impl Sums {
    const EMPTY: Self = Self { whole: 0, sum: 0.0, lost: 0.0, histogram: [0; BINS] };

    fn of<T: Voxel>(values: impl Iterator<Item = (T, u64)>, extent: &Extent) -> Self {
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

    fn join(mut self, other: &Self) -> Self {
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

/// Equal bins over an extent, with the edges numpy's `linspace` has.
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
