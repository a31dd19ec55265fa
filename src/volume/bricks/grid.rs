//! Places of the bricks of a cache.

use std::ops::Range;

/// Voxels along an edge of a brick: whole macrocells.
pub const BRICK: u32 = 64;

const EDGE: usize = BRICK as usize;

/// The bricks of a grid, numbered with x fastest. Those at the end of an axis may be thinner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct BrickGrid {
    /// Voxels along each axis.
    pub(super) dims: [usize; 3],
    /// Bricks along each axis.
    pub(super) counts: [usize; 3],
}

impl BrickGrid {
    pub(super) fn new(dims: [usize; 3]) -> Self {
        Self { dims, counts: dims.map(|n| n.div_ceil(EDGE)) }
    }

    /// The levels of resolution over `dims` voxels, the finest first: each has half the voxels of the one before along each
    /// axis, rounded up, and the last one is a single brick.
    pub(super) fn levels(dims: [usize; 3]) -> Vec<Self> {
        let coarser = |grid: &Self| (grid.bricks() > 1).then(|| Self::new(grid.dims.map(|n| n.div_ceil(2))));
        std::iter::successors(Some(Self::new(dims)), coarser).collect()
    }

    /// Number of bricks.
    pub(super) fn bricks(&self) -> usize {
        self.counts.iter().product()
    }

    /// Number of voxels of the grid.
    pub(super) fn all_voxels(&self) -> usize {
        self.dims.iter().product()
    }

    /// First voxel of `brick`, and the voxel behind its last.
    pub(super) fn span(&self, brick: usize) -> [[usize; 3]; 2] {
        let [width, height, _] = self.counts;
        let first = [brick % width, brick / width % height, brick / (width * height)].map(|at| EDGE * at);
        [first, std::array::from_fn(|axis| (first[axis] + EDGE).min(self.dims[axis]))]
    }

    /// Voxels of `brick` along each axis.
    pub(super) fn dims_of(&self, brick: usize) -> [usize; 3] {
        let [first, end] = self.span(brick);
        std::array::from_fn(|axis| end[axis] - first[axis])
    }

    /// Number of voxels of `brick`.
    pub(super) fn voxels(&self, brick: usize) -> usize {
        self.dims_of(brick).iter().product()
    }

    /// Whether a slab of the next coarser level is complete with `slab`.
    pub(super) fn ends_coarser(&self, slab: usize) -> bool {
        slab % 2 == 1 || slab + 1 == self.counts[2]
    }

    /// The bricks of `slab`.
    pub(super) fn of_slab(&self, slab: usize) -> Range<usize> {
        let [width, height, _] = self.counts;
        slab * width * height..(slab + 1) * width * height
    }

    /// Number of voxels of the largest brick.
    pub(super) fn largest(&self) -> usize {
        self.dims.iter().map(|&n| n.min(EDGE)).product()
    }

    /// The bricks with voxels from `first` to before `end`.
    pub(super) fn within(&self, first: [usize; 3], end: [usize; 3]) -> Vec<usize> {
        let along = |axis: usize| first[axis] / EDGE..end[axis].div_ceil(EDGE);
        let [width, height, _] = self.counts;
        along(2).flat_map(|z| along(1).flat_map(move |y| along(0).map(move |x| x + width * (y + height * z)))).collect()
    }
}

/// The slabs of bricks of all `levels` in the order of a file: level and number along z. A slab follows the one or two slabs
/// of the finer level that it is the mean of.
pub(super) fn slabs(levels: &[BrickGrid]) -> Vec<[usize; 2]> {
    let mut slabs = Vec::new();
    for finest in 0..levels[0].counts[2] {
        let (mut level, mut slab) = (0, finest);
        slabs.push([level, slab]);
        while level + 1 < levels.len() && levels[level].ends_coarser(slab) {
            (level, slab) = (level + 1, slab / 2);
            slabs.push([level, slab]);
        }
    }
    slabs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bricks_at_the_ends_are_thinner_and_a_box_meets_those_of_its_voxels() {
        let grid = BrickGrid::new([130, 64, 65]);
        assert_eq!(grid.counts, [3, 1, 2]);
        assert_eq!(grid.span(5), [[128, 0, 64], [130, 64, 65]]);
        assert_eq!((grid.voxels(5), grid.voxels(0), grid.largest()), (128, 1 << 18, 1 << 18));
        assert_eq!((0..6).map(|brick| grid.voxels(brick)).sum::<usize>(), grid.all_voxels());
        assert_eq!(grid.within([63, 0, 0], [65, 1, 64]), [0, 1]);
        assert_eq!(grid.within([64, 0, 64], [129, 64, 65]), [4, 5]);
    }

    #[test]
    fn levels_end_with_a_single_brick_and_their_slabs_follow_those_that_they_are_the_mean_of() {
        let dims = |all: [usize; 3]| BrickGrid::levels(all).iter().map(|grid| grid.dims).collect::<Vec<_>>();
        assert_eq!(dims([64, 1, 3]), [[64, 1, 3]]);
        assert_eq!(dims([257, 1, 70]), [[257, 1, 70], [129, 1, 35], [65, 1, 18], [33, 1, 9]]);
        // Slabs of 5, 3, 2 and 1 along z.
        let expected = [[0, 0], [0, 1], [1, 0], [0, 2], [0, 3], [1, 1], [2, 0], [0, 4], [1, 2], [2, 1], [3, 0]];
        assert_eq!(slabs(&BrickGrid::levels([1, 1, 300])), expected);
    }
}
