//! Ranges of the stored values of macrocells, gathered from rows of voxels.

use crate::parallel;
use crate::volume::{Voxel, VoxelType};

/// Voxels along an edge of a macrocell.
pub const CELL: usize = 8;

/// Lowest and highest stored number of each macrocell, x fastest, of the voxels that `tables::Cells` assigns to it: one
/// before the first that interpolation touches, and one behind the last.
#[derive(Clone, Debug)]
pub(super) struct CellRanges<T> {
    /// Voxels along each axis.
    grid: [usize; 3],
    /// Macrocells along each axis.
    dims: [usize; 3],
    /// Lowest and highest number; in the wrong order if all are NaN.
    ranges: Vec<[T; 2]>,
    /// Whether a number is NaN.
    has_nan: Vec<bool>,
}

/// Number of macrocells along each axis of a `grid` of so many voxels.
#[must_use]
pub fn macrocells(grid: [usize; 3]) -> [usize; 3] {
    grid.map(|n| n.saturating_sub(1).div_ceil(CELL).max(1))
}

/// Macrocells along an axis of `n` whose range includes voxel `at`.
fn touching(at: usize, n: usize) -> std::ops::RangeInclusive<usize> {
    at.saturating_sub(CELL + 1).div_ceil(CELL)..=((at + 1) / CELL).min(n - 1)
}

fn is_nan<T: Voxel>(value: T) -> bool {
    value.partial_cmp(&value).is_none()
}

impl CellRanges<()> {
    /// Bytes of [`CellRanges::to_bytes`].
    pub(super) fn bytes(dims: [usize; 3], voxel_type: VoxelType) -> usize {
        let all: usize = dims.iter().product();
        let bits = if matches!(voxel_type, VoxelType::F32 | VoxelType::F64) { all.div_ceil(8) } else { 0 };
        2 * all * voxel_type.bytes() + bits
    }
}

impl<T: Voxel> CellRanges<T> {
    /// The macrocells of a grid of `grid` voxels, before any row.
    pub(super) fn new(grid: [usize; 3]) -> Self {
        let dims = macrocells(grid);
        let all = dims.iter().product();
        Self { grid, dims, ranges: vec![Self::nothing(); all], has_nan: vec![false; all] }
    }

    /// The range of no number.
    fn nothing() -> [T; 2] {
        [T::nearest(f64::INFINITY), T::nearest(f64::NEG_INFINITY)]
    }

    /// Adds whole `rows` of voxels; the first is row `first`, counted through all slices.
    pub(super) fn add(&mut self, first: usize, rows: &[T]) {
        let [nx, ny, _] = self.grid;
        self.add_runs(0, nx, rows, |row| [(first + row) % ny, (first + row) / ny]);
    }

    /// Adds the voxels of a box of `dims` from `first` on.
    pub(super) fn add_box(&mut self, first: [usize; 3], dims: [usize; 3], voxels: &[T]) {
        let [width, height, _] = dims;
        self.add_runs(first[0], width, voxels, |row| [first[1] + row % height, first[2] + row / height]);
    }

    /// Adds runs of `length` voxels along x from `start` on; `place` is the y and z of one.
    fn add_runs(&mut self, start: usize, length: usize, runs: &[T], place: impl Fn(usize) -> [usize; 2]) {
        let [width, height, depth] = self.dims;
        let end = start + length;
        let first = *touching(start, width).start();
        let last = *touching(end - 1, width).end();
        let of_run = |run: usize| -> Vec<([T; 2], bool)> {
            let run = &runs[run * length..(run + 1) * length];
            let of_cell = |cell: usize| {
                let from = (CELL * cell).saturating_sub(1).max(start);
                let numbers = &run[from - start..(CELL * cell + CELL + 2).min(end) - start];
                numbers.iter().fold((Self::nothing(), false), |(range, nan), &number| {
                    if is_nan(number) { (range, true) } else { (joined(range, [number; 2]), nan) }
                })
            };
            (first..=last).map(of_cell).collect()
        };
        let of_runs = parallel::map(runs.len() / length, &of_run);
        for (run, of_run) in of_runs.iter().enumerate() {
            let [y, z] = place(run);
            for z in touching(z, depth) {
                for y in touching(y, height) {
                    let at = first + width * (y + height * z);
                    for (cell, &(range, nan)) in (at..).zip(of_run) {
                        self.ranges[cell] = joined(self.ranges[cell], range);
                        self.has_nan[cell] |= nan;
                    }
                }
            }
        }
    }

    /// The lowest number of each macrocell and its highest one, little-endian; of floats also a bit if one is NaN.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        let little = |number: T| if cfg!(target_endian = "big") { number.with_bytes_swapped() } else { number };
        let numbers: Vec<[T; 2]> = self.ranges.iter().map(|range| range.map(little)).collect();
        let mut bytes = bytemuck::cast_slice(&numbers).to_vec();
        if T::nearest(0.0).to_whole().is_none() {
            let of_eight = |eight: &[bool]| eight.iter().rev().fold(0_u8, |bits, &nan| bits << 1 | u8::from(nan));
            bytes.extend(self.has_nan.chunks(8).map(of_eight));
        }
        bytes
    }

    /// The ranges of `cells` macrocells in the bytes of [`Self::to_bytes`], each with whether a number is NaN.
    pub(super) fn each(cells: usize, bytes: &[u8], mut with: impl FnMut([f64; 2], bool)) {
        let (numbers, bits) = bytes.split_at(bytes.len().min(2 * cells * size_of::<T>()));
        let mut number = [T::zeroed(); 2];
        for (cell, chunk) in numbers.chunks_exact(2 * size_of::<T>()).enumerate() {
            bytemuck::cast_slice_mut(&mut number).copy_from_slice(chunk);
            if cfg!(target_endian = "big") {
                number = number.map(T::with_bytes_swapped);
            }
            with(number.map(T::to_f64), bits.get(cell / 8).is_some_and(|byte| byte >> (cell % 8) & 1 == 1));
        }
    }
}

fn joined<T: Voxel>([low, high]: [T; 2], [other_low, other_high]: [T; 2]) -> [T; 2] {
    [if other_low < low { other_low } else { low }, if other_high > high { other_high } else { high }]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn macrocells_have_the_range_of_the_voxels_around_them_and_know_of_nan() {
        // Values are 100·z + 10·y + x / 10, distinct in each voxel.
        let grid = [20, 9, 17];
        let value = |x: usize, y: usize, z: usize| {
            let [x, y, z] = [x, y, z].map(|at| f32::from(u8::try_from(at).unwrap_or(u8::MAX)));
            100.0 * z + 10.0 * y + x / 10.0
        };
        let mut voxels = Vec::new();
        for z in 0..grid[2] {
            for y in 0..grid[1] {
                voxels.extend((0..grid[0]).map(|x| if [x, y, z] == [10, 3, 4] { f32::NAN } else { value(x, y, z) }));
            }
        }
        let mut ranges = CellRanges::<f32>::new(grid);
        let (one, other) = voxels.split_at(20 * 31);
        ranges.add(0, one);
        ranges.add(31, other);
        assert_eq!(ranges.dims, [3, 1, 2]);
        let bytes = ranges.to_bytes();
        assert_eq!(bytes.len(), CellRanges::bytes(ranges.dims, VoxelType::F32));
        let mut found = Vec::new();
        CellRanges::<f32>::each(6, &bytes, |range, nan| found.push((range, nan)));
        let between =
            |[x, z]: [usize; 2], [x_end, z_end]: [usize; 2]| [value(x, 0, z), value(x_end, 8, z_end)].map(f64::from);
        // From one voxel before a macrocell to two behind its eight, within the grid.
        let expected = [
            (between([0, 0], [9, 9]), false),
            (between([7, 0], [17, 9]), true),
            (between([15, 0], [19, 9]), false),
            (between([0, 7], [9, 16]), false),
            (between([7, 7], [17, 16]), false),
            (between([15, 7], [19, 16]), false),
        ];
        assert_eq!(found, expected);
        // The same voxels as boxes.
        let mut boxed = CellRanges::<f32>::new(grid);
        for (first, end) in
            [([0; 3], [7, 9, 17]), ([7, 0, 0], [16, 5, 17]), ([7, 5, 0], [16, 9, 17]), ([16, 0, 0], grid)]
        {
            let dims: [usize; 3] = std::array::from_fn(|axis| end[axis] - first[axis]);
            let mut part = Vec::new();
            for row in (first[2]..end[2]).flat_map(|z| (first[1]..end[1]).map(move |y| y + 9 * z)) {
                part.extend_from_slice(&voxels[20 * row + first[0]..20 * row + end[0]]);
            }
            boxed.add_box(first, dims, &part);
        }
        assert!(boxed.to_bytes() == bytes);
    }
}
