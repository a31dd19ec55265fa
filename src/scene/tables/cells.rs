//! Macrocells of the volume: value ranges and occupancy.

use std::ops::RangeInclusive;

use glam::DVec3;

use super::{LabelMap, PlacedField, Storage, TransferTable};
use crate::Scene;
use relume_base::number::{count, rounded, whole};
use relume_base::parallel;
use relume_volume::{BrickCache, Volume, VolumeError, cell_ranges, macrocells};

pub use relume_volume::CELL;

/// Lowest and highest stored value of each macrocell, x fastest.
///
/// Macrocell c spans [8c, 8c + 8] in voxel indices. Its range covers every voxel that interpolation in it can touch,
/// and one more on each side for filters that round.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Number of macrocells along each axis.
    pub dims: [usize; 3],
    /// Ranges, normalised to 0–1 like the index of the transfer table.
    ranges: Vec<[f32; 2]>,
    /// Whether a macrocell has a voxel with a declared and visible label.
    labelled: Vec<bool>,
}

/// Occupancy: one bit per macrocell, set if any sample in it can be visible; bit `i % 32` of word `i / 32`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Occupancy {
    /// Number of macrocells along each axis.
    pub dims: [usize; 3],
    /// Bits.
    pub words: Vec<u32>,
    /// Number of set bits.
    pub occupied: usize,
}

impl Cells {
    /// Builds the macrocells of `volume` as normalised by `storage`; `labels` adds the positions of visible labels.
    #[must_use]
    pub fn new(volume: &Volume, storage: &Storage, labels: Option<&LabelMap>) -> Self {
        let grid = volume.geometry.dims;
        let ranges = cell_ranges(volume).into_iter().map(|(ends, has_nan)| normalised(ends, has_nan, storage));
        Self { dims: macrocells(grid), ranges: ranges.collect(), labelled: labelled(grid, labels) }
    }

    /// The macrocells of the volume in `cache`, as of its voxels: their ranges are in the file.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`], [`VolumeError::Bricks`].
    pub fn of_cache(
        grid: [usize; 3],
        cache: &BrickCache,
        storage: &Storage,
        labels: Option<&LabelMap>,
    ) -> Result<Self, VolumeError> {
        let dims = macrocells(grid);
        let mut ranges = Vec::with_capacity(dims.iter().product());
        cache.each_cell(|ends, has_nan| ranges.push(normalised(ends, has_nan, storage)))?;
        Ok(Self { dims, ranges, labelled: labelled(grid, labels) })
    }

    /// Returns the occupancy under a table whose entries, from the lowest value to the highest, are `active`.
    #[must_use]
    pub fn occupancy(&self, active: &[bool]) -> Occupancy {
        let mut active_before = Vec::with_capacity(active.len() + 1);
        active_before.push(0_u32);
        for (entry, &active) in active.iter().enumerate() {
            active_before.push(active_before[entry] + u32::from(active));
        }
        let last = active.len() - 1;
        let mut words = vec![0_u32; self.ranges.len().div_ceil(32)];
        let mut occupied = 0;
        for (cell, range) in self.ranges.iter().enumerate() {
            let [first, end] = Self::entries(*range, last);
            let by_value = active_before[end + 1] > active_before[first];
            if by_value || self.labelled.get(cell).is_some_and(|&labelled| labelled) {
                words[cell / 32] |= 1 << (cell % 32);
                occupied += 1;
            }
        }
        Occupancy { dims: self.dims, words, occupied }
    }

    /// The largest of `numbers`, those of the entries of a table from the lowest value to the highest, in each macrocell, and at least
    /// `of_labels` where it has a visible label.
    #[must_use]
    pub fn largest(&self, numbers: &[f64], of_labels: f64) -> Vec<f64> {
        // Level i has the largest of 2^i numbers from each on.
        let mut levels = vec![numbers.to_vec()];
        while let Some(last) = levels.last().filter(|last| last.len() > 1) {
            let half = 1 << (levels.len() - 1);
            let wider = last.len().saturating_sub(half);
            let level = (0..wider).map(|i| last[i].max(last[i + half])).collect::<Vec<f64>>();
            if level.is_empty() {
                break;
            }
            levels.push(level);
        }
        let last = numbers.len() - 1;
        let of_cell = |(cell, range): (usize, &[f32; 2])| {
            let [first, end] = Self::entries(*range, last);
            let level = (end + 1 - first).ilog2() as usize;
            let most = levels[level][first].max(levels[level][end + 1 - (1 << level)]);
            if self.labelled.get(cell).is_some_and(|&labelled| labelled) { most.max(of_labels) } else { most }
        };
        self.ranges.iter().enumerate().map(of_cell).collect()
    }

    /// First and last entry that values in a `range` read, of a table whose last entry is `last`.
    fn entries(range: [f32; 2], last: usize) -> [usize; 2] {
        // The entries on both sides of a value, and one more for coordinates that round.
        let [low, high] = range.map(|normalised| f64::from(normalised) * count(last));
        let end = whole(high.ceil() + 1.0).min(last);
        [whole(low.floor() - 1.0).min(end), end]
    }

    /// The occupancy of the steps of `scene` under a table as in [`Self::occupancy`], where these depend on places as far from their
    /// middles as this `distance` in voxels ([`reach_in_voxels`](super::reach_in_voxels)). A step belongs to the macrocell of its middle.
    #[must_use]
    pub fn occupancy_within(&self, scene: &Scene, distance: f64, active: &[bool]) -> Occupancy {
        let occupancy = self.occupancy(active);
        // The range of a macrocell includes one voxel more on each side, of which the cubic filter reads one.
        let spare = if scene.accuracy.interpolation.is_cubic() { 0.0 } else { 1.0 };
        let reach = whole(((distance - spare).max(0.0) / count(CELL)).ceil());
        if reach > 0 { occupancy.within(reach) } else { occupancy }
    }
}

/// The occupancy of the samples of fields with these `cells` under `table`, in the macrocells of the first: one of any of them.
/// `placed` are the places of further fields on grids of their own.
#[must_use]
pub fn occupancy_of_fields(cells: &[&Cells], placed: &[Option<PlacedField>], table: &TransferTable) -> Occupancy {
    let mut found: Option<Occupancy> = None;
    let placed = std::iter::once(&None).chain(placed);
    for ((field, own), placed) in cells.iter().enumerate().zip(placed) {
        let mut of_field = own.occupancy(&table.active_entries_of(field));
        if let (Some(placed), Some(first)) = (placed, cells.first()) {
            of_field = of_field.seen_in(first, placed);
        }
        found = Some(match found {
            None => of_field,
            Some(found) => found.or(&of_field),
        });
    }
    found.unwrap_or(Occupancy { dims: [0; 3], words: Vec::new(), occupied: 0 })
}

impl Occupancy {
    /// The macrocells of `frame` in which a field of this occupancy, `placed` there, may be visible.
    fn seen_in(&self, frame: &Cells, placed: &PlacedField) -> Self {
        let dims = frame.dims;
        let cell = count(CELL);
        // Half the box that a macrocell, grown by half a voxel, has on the other grid.
        let half = placed.extent_of_voxels(DVec3::splat(0.5 * cell + 0.5));
        let is_seen = |index: usize| {
            let at = [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
            // Samples on an axis of one voxel lie half a voxel around it.
            let middle = placed.index_of_voxel(DVec3::from_array(at.map(|at| (count(at) + 0.5) * cell)));
            let (low, high) = (middle - half, middle + half);
            // A voxel more for rounding, and the samples at the faces of the volume, which belong to the last macrocell.
            let range = |axis: usize| {
                let [first, last] = [low[axis] - 1.0, high[axis] + 1.0].map(|index| index / cell);
                let end = count(self.dims[axis] - 1);
                let beside = last < 0.0 || first > end + 1.0;
                (!beside).then(|| whole(first.clamp(0.0, end))..=whole(last.clamp(0.0, end)))
            };
            let (Some(xs), Some(ys), Some(zs)) = (range(0), range(1), range(2)) else { return false };
            zs.into_iter().any(|z| ys.clone().any(|y| xs.clone().any(|x| self.is_set([x, y, z]))))
        };
        let mut seen = Self { dims, words: vec![0; dims.iter().product::<usize>().div_ceil(32)], occupied: 0 };
        for index in (0..dims.iter().product()).filter(|&index| is_seen(index)) {
            seen.words[index / 32] |= 1 << (index % 32);
            seen.occupied += 1;
        }
        seen
    }

    /// The macrocells that either has.
    #[must_use]
    pub fn or(mut self, other: &Self) -> Self {
        self.words.iter_mut().zip(&other.words).for_each(|(word, other)| *word |= other);
        self.occupied = self.words.iter().map(|word| word.count_ones() as usize).sum();
        self
    }

    /// True if any sample in a macrocell can be visible.
    #[must_use]
    pub fn is_set(&self, cell: [usize; 3]) -> bool {
        self.holds(cell[0] + self.dims[0] * (cell[1] + self.dims[1] * cell[2]))
    }

    /// [`Self::is_set`] of the macrocell of this index.
    fn holds(&self, index: usize) -> bool {
        self.words.get(index / 32).is_some_and(|word| word >> (index % 32) & 1 == 1)
    }

    /// The occupancy grown by `reach` macrocells along every axis.
    #[must_use]
    pub fn within(&self, reach: usize) -> Self {
        let [width, height, depth] = self.dims;
        let mut near: Vec<bool> = (0..width * height * depth).map(|index| self.holds(index)).collect();
        // Axis by axis: a search of the whole box would take minutes for steps of hundreds of voxels.
        for (stride, n) in [(1, width), (width, height), (width * height, depth)] {
            let is_near = |i: usize| {
                let at = i / stride % n;
                let mut places = at.saturating_sub(reach)..(at + reach + 1).min(n);
                places.any(|place| near[i - at * stride + place * stride])
            };
            near = (0..near.len()).map(is_near).collect();
        }
        let mut grown = Self { dims: self.dims, words: vec![0; self.words.len()], occupied: 0 };
        for (i, _) in near.iter().enumerate().filter(|(_, near)| **near) {
            grown.words[i / 32] |= 1 << (i % 32);
            grown.occupied += 1;
        }
        grown
    }
}

/// The range of stored numbers of a macrocell as normalised by `storage`.
fn normalised(ends: [f64; 2], has_nan: bool, storage: &Storage) -> [f32; 2] {
    // Without a finite number all voxels are NaN, which `storage` normalises to 0.
    let ends = if ends[0] > ends[1] { [0.0; 2] } else { ends.map(|end| storage.normalised(end)) };
    let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
    // NaN becomes the low end, since `storage` normalises it like the smallest value.
    [rounded(if has_nan { 0.0 } else { low }), rounded(high)]
}

/// Whether each macrocell of a volume of `grid` voxels has one with a visible label; none of them without `labels`.
fn labelled(grid: [usize; 3], labels: Option<&LabelMap>) -> Vec<bool> {
    let dims = macrocells(grid);
    let Some(map) = labels else { return Vec::new() };
    parallel::map(dims.iter().product(), &|cell| {
        let [xs, ys, zs] = touched(cell, dims, grid);
        zs.into_iter().any(|z| ys.clone().any(|y| xs.clone().any(|x| map.is_visible(x + grid[0] * (y + grid[1] * z)))))
    })
}

/// Voxels that samples in a macrocell can touch, and one more on each side.
fn touched(cell: usize, dims: [usize; 3], grid: [usize; 3]) -> [RangeInclusive<usize>; 3] {
    let index = [cell % dims[0], cell / dims[0] % dims[1], cell / (dims[0] * dims[1])];
    std::array::from_fn(|axis| {
        let first = index[axis] * CELL;
        first.saturating_sub(1)..=(first + CELL + 1).min(grid[axis] - 1)
    })
}
