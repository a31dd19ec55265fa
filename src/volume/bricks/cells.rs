//! Ranges of the stored values of macrocells, gathered from boxes of voxels.

use std::ops::Range;

use crate::{Volume, Voxel, VoxelType, with_voxels};
use relume_base::parallel;

/// Voxels along an edge of a macrocell.
pub const CELL: usize = 8;

/// Lowest and highest stored number of each macrocell, x fastest, of the voxels that `tables::Cells` assigns to it: one
/// before the first that interpolation touches, and one behind the last.
#[derive(Clone, Debug)]
pub(super) struct CellRanges<T> {
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

/// Lowest and highest stored number of each macrocell of a volume in memory, x fastest, and whether a number is NaN: of the
/// voxels that interpolation in it can touch, and one more on each side. The numbers are in the wrong order if all are NaN.
#[must_use]
pub fn cell_ranges(volume: &Volume) -> Vec<([f64; 2], bool)> {
    let grid = volume.geometry.dims;
    with_voxels!(&volume.voxels, stored => {
        let CellRanges { ranges, has_nan, .. } = CellRanges::of(grid, stored);
        let range = |[low, high]: [_; 2]| [Voxel::to_f64(low), Voxel::to_f64(high)];
        ranges.into_iter().map(range).zip(has_nan).collect()
    })
}

/// Largest value of each macrocell of a volume in memory, x fastest, of the voxels of [`cell_ranges`]: in half of its time. It is
/// minus infinity if all are NaN, unless the slope is 0.
#[must_use]
pub fn cell_maxima(volume: &Volume) -> Vec<f64> {
    let (grid, slope) = (volume.geometry.dims, volume.slope);
    // Without a slope, infinite numbers are the intercept too.
    let value = |stored: f64| if slope == 0.0 { volume.intercept } else { stored * slope + volume.intercept };
    with_voxels!(&volume.voxels, stored => {
        let [lowest, highest] = CellRanges::nothing();
        let largest = if slope < 0.0 { of_grid(grid, stored, lowest, lower) } else { of_grid(grid, stored, highest, higher) };
        largest.into_iter().map(|stored| value(Voxel::to_f64(stored))).collect()
    })
}

/// The `voxels` of each macrocell of a grid of `grid` voxels, joined.
fn of_grid<T: Voxel>(grid: [usize; 3], voxels: &[T], nothing: T, join: impl Fn(T, T) -> T + Copy + Sync) -> Vec<T> {
    let [width, height, depth] = macrocells(grid);
    let slabs = slabs(grid, voxels);
    let of_slab = |slab: usize| {
        let (first, dims, voxels) = slabs[slab];
        let ([_, _, zs], parts) = places(grid, first, dims);
        (zs.start, joined(voxels, dims, &parts, nothing, join))
    };
    let mut all = vec![nothing; width * height * depth];
    for (z, of_slab) in parallel::map(slabs.len(), &of_slab) {
        let cells = &mut all[width * height * z..];
        cells.iter_mut().zip(of_slab).for_each(|(cell, value)| *cell = join(*cell, value));
    }
    all
}

/// Boxes of a few slices, which have room in the caches of processors: the first voxel, the sides, and the voxels.
fn slabs<T>(grid: [usize; 3], voxels: &[T]) -> Vec<([usize; 3], [usize; 3], &[T])> {
    let slice = grid[0] * grid[1];
    let boxes = voxels.chunks(CELL * slice).enumerate();
    boxes.map(|(slab, voxels)| ([0, 0, CELL * slab], [grid[0], grid[1], voxels.len() / slice], voxels)).collect()
}

/// The macrocells along each axis that a box of `dims` from `first` on touches, and the voxels of the box that belong to each.
fn places(grid: [usize; 3], first: [usize; 3], dims: [usize; 3]) -> ([Range<usize>; 3], [Vec<Range<usize>>; 3]) {
    let all = macrocells(grid);
    let cells: [Range<usize>; 3] = std::array::from_fn(|axis| {
        let last = first[axis] + dims[axis] - 1;
        *touching(first[axis], all[axis]).start()..touching(last, all[axis]).end() + 1
    });
    let parts = [0, 1, 2].map(|axis| -> Vec<Range<usize>> {
        let end = first[axis] + dims[axis];
        let of_cell = |cell: usize| {
            let from = (CELL * cell).saturating_sub(1).max(first[axis]);
            from - first[axis]..(CELL * cell + CELL + 2).min(end) - first[axis]
        };
        cells[axis].clone().map(of_cell).collect()
    });
    (cells, parts)
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
    /// The macrocells of a grid of `grid` voxels, before any voxel.
    pub(super) fn new(grid: [usize; 3]) -> Self {
        let dims = macrocells(grid);
        let all = dims.iter().product();
        Self { dims, ranges: vec![Self::nothing(); all], has_nan: vec![false; all] }
    }

    /// The macrocells of a grid of `grid` voxels.
    fn of(grid: [usize; 3], voxels: &[T]) -> Self {
        let mut ranges = Self::new(grid);
        let slabs = slabs(grid, voxels);
        let of_slab = |slab: usize| {
            let (first, dims, voxels) = slabs[slab];
            BoxRanges::of(grid, first, dims, voxels)
        };
        parallel::map(slabs.len(), &of_slab).iter().for_each(|slab| ranges.join(slab));
        ranges
    }

    /// The range of no number.
    fn nothing() -> [T; 2] {
        [T::nearest(f64::INFINITY), T::nearest(f64::NEG_INFINITY)]
    }

    /// Joins the ranges of the voxels of a box to those of other boxes.
    pub(super) fn join(&mut self, of_box: &BoxRanges<T>) {
        let BoxRanges { cells: [xs, ys, zs], ranges, has_nan } = of_box;
        let [width, height, _] = self.dims;
        let rows = zs.clone().flat_map(|z| ys.clone().map(move |y| xs.start + width * (y + height * z)));
        let of_rows = ranges.chunks_exact(xs.len()).zip(has_nan.chunks_exact(xs.len()));
        for (at, (ranges, has_nan)) in rows.zip(of_rows) {
            for ((cell, &range), &nan) in (at..).zip(ranges).zip(has_nan) {
                self.ranges[cell] = [lower(self.ranges[cell][0], range[0]), higher(self.ranges[cell][1], range[1])];
                self.has_nan[cell] |= nan;
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

/// The ranges of the macrocells that a box of voxels touches.
#[derive(Clone, Debug)]
pub(super) struct BoxRanges<T> {
    /// The macrocells along each axis.
    cells: [Range<usize>; 3],
    /// As in [`CellRanges`].
    ranges: Vec<[T; 2]>,
    has_nan: Vec<bool>,
}

impl<T: Voxel> BoxRanges<T> {
    /// Those of the `voxels` of the box of `dims` from `first` on, in a grid of `grid` voxels.
    pub(super) fn of(grid: [usize; 3], first: [usize; 3], dims: [usize; 3], voxels: &[T]) -> Self {
        let (cells, parts) = places(grid, first, dims);
        let [lowest, highest] = CellRanges::nothing();
        let lows = joined(voxels, dims, &parts, lowest, lower);
        let highs = joined(voxels, dims, &parts, highest, higher);
        let has_nan = if T::nearest(0.0).to_whole().is_none() {
            let is_nan: Vec<bool> = voxels.iter().map(|&number| is_nan(number)).collect();
            joined(&is_nan, dims, &parts, false, |one, other| one | other)
        } else {
            vec![false; lows.len()]
        };
        Self { cells, ranges: lows.into_iter().zip(highs).map(Into::into).collect(), has_nan }
    }
}

/// The `values` of a box of `dims`, joined within `parts` of each axis. Axis by axis: along y first, where neighbours in memory
/// are joined to neighbours, and the least is left for x.
fn joined<V: Copy>(
    values: &[V],
    [width, height, depth]: [usize; 3],
    parts: &[Vec<Range<usize>>; 3],
    nothing: V,
    join: impl Fn(V, V) -> V + Copy,
) -> Vec<V> {
    let along = |values: &[V], stride: usize, n: usize, parts: &[Range<usize>]| {
        let mut all = Vec::with_capacity(values.len() / n * parts.len());
        for lines in values.chunks_exact(stride * n) {
            for part in parts {
                let at = all.len();
                all.resize(at + stride, nothing);
                for line in lines[part.start * stride..part.end * stride].chunks_exact(stride) {
                    all[at..].iter_mut().zip(line).for_each(|(sum, &value)| *sum = join(*sum, value));
                }
            }
        }
        all
    };
    let [xs, ys, zs] = parts;
    let values = along(values, width, height, ys);
    let values = along(&values, width * ys.len(), depth, zs);
    along(&values, 1, width, xs)
}

fn lower<T: Voxel>(one: T, other: T) -> T {
    if other < one { other } else { one }
}

fn higher<T: Voxel>(one: T, other: T) -> T {
    if other > one { other } else { one }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use crate::{Geometry, Voxels};

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
        ranges.join(&BoxRanges::of(grid, [0; 3], grid, &voxels));
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
        // The same voxels in several boxes.
        let mut boxed = CellRanges::<f32>::new(grid);
        for (first, end) in
            [([0; 3], [7, 9, 17]), ([7, 0, 0], [16, 5, 17]), ([7, 5, 0], [16, 9, 17]), ([16, 0, 0], grid)]
        {
            let dims: [usize; 3] = std::array::from_fn(|axis| end[axis] - first[axis]);
            let mut part = Vec::new();
            for row in (first[2]..end[2]).flat_map(|z| (first[1]..end[1]).map(move |y| y + 9 * z)) {
                part.extend_from_slice(&voxels[20 * row + first[0]..20 * row + end[0]]);
            }
            boxed.join(&BoxRanges::of(grid, first, dims, &part));
        }
        assert!(boxed.to_bytes() == bytes);
        // And in slabs.
        assert!(CellRanges::of(grid, &voxels).to_bytes() == bytes);
        let geometry = Geometry::unit("test", grid).unwrap();
        let mut volume = Volume::new("test", Voxels::F32(voxels), geometry).unwrap();
        let values = |part: fn([f64; 2]) -> f64| found.iter().map(|&(ends, _)| part(ends)).collect::<Vec<_>>();
        assert_eq!(cell_maxima(&volume), values(|[_, high]| high));
        (volume.slope, volume.intercept) = (-2.0, 3.0);
        assert_eq!(cell_maxima(&volume), values(|[low, _]| 3.0 - 2.0 * low));
    }
}
