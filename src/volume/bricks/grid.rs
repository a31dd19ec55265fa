//! Places of the bricks of a cache.

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

    /// Number of voxels of `brick`.
    pub(super) fn voxels(&self, brick: usize) -> usize {
        let [first, end] = self.span(brick);
        (0..3).map(|axis| end[axis] - first[axis]).product()
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
}
