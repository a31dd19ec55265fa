//! Extents: which part of a grid of points or cells a piece covers.

use std::str::FromStr;

use glam::{DMat3, DVec3};

use super::header::Section;
use crate::volume::{Geometry, VolumeError};

/// The first and last index of points along each axis; where the last is before the first there are none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Extent {
    first: [i64; 3],
    last: [i64; 3],
}

impl FromStr for Extent {
    type Err = ();

    /// `x0 x1 y0 y1 z0 z1`, of 32 bits as VTK has them, so that no difference overflows.
    fn from_str(text: &str) -> Result<Self, ()> {
        let numbers = text.split_whitespace().map(|word| word.parse::<i32>().map(i64::from));
        let [x0, x1, y0, y1, z0, z1] = numbers.collect::<Result<Vec<_>, _>>().map_err(drop)?[..] else {
            return Err(());
        };
        Ok(Self { first: [x0, y0, z0], last: [x1, y1, z1] })
    }
}

/// Where the points of the whole image lie.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) extent: Extent,
    pub(super) origin: DVec3,
    pub(super) spacing: DVec3,
    pub(super) direction: DMat3,
}

impl Frame {
    /// Which points, or cells, `extent` has.
    pub(super) fn block(&self, section: Section, extent: &Extent) -> Block {
        let dims = [0, 1, 2].map(|axis| {
            // An image that is flat along an axis has one layer of cells there, not none.
            let flat = self.extent.first[axis] == self.extent.last[axis];
            let between = i64::from(section == Section::Cells && !flat);
            usize::try_from(extent.last[axis] - extent.first[axis] + 1 - between).unwrap_or(0)
        });
        Block { first: extent.first, dims }
    }

    /// Where the points, or the centres of the cells, of the whole image lie.
    pub(super) fn geometry(&self, source: &str, section: Section) -> Result<Geometry, VolumeError> {
        let Self { extent, origin, spacing, direction } = *self;
        let first = [0, 1, 2].map(|axis| {
            let centred = section == Section::Cells && extent.first[axis] != extent.last[axis];
            #[expect(clippy::cast_precision_loss, reason = "of 32 bits")]
            let first = extent.first[axis] as f64;
            first + if centred { 0.5 } else { 0.0 }
        });
        let origin = origin + direction * (spacing * DVec3::from_array(first));
        Geometry::new(source, self.block(section, &extent).dims, spacing, origin, direction)
    }
}

/// A box of points or cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Block {
    pub(super) first: [i64; 3],
    pub(super) dims: [usize; 3],
}

impl Block {
    /// A row of `length`.
    pub(super) fn row(length: usize) -> Self {
        Self { first: [0; 3], dims: [length, 1, 1] }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.dims.contains(&0)
    }

    /// How many it has; `None` where they cannot be counted.
    pub(super) fn voxels(&self) -> Option<usize> {
        self.dims.iter().try_fold(1_usize, |product, &n| product.checked_mul(n))
    }

    /// Where it begins in `whole`, if all of it lies there.
    fn start_in(&self, whole: &Self) -> Option<[usize; 3]> {
        let start = [0, 1, 2].map(|axis| usize::try_from(self.first[axis] - whole.first[axis]).unwrap_or(usize::MAX));
        let inside = |axis: usize| start[axis].checked_add(self.dims[axis]).is_some_and(|end| end <= whole.dims[axis]);
        [0, 1, 2].into_iter().all(inside).then_some(start)
    }

    /// The first voxel and the number of each run that is in one piece in `whole`, in order; `None` where the block
    /// does not lie in `whole`, whose voxels can be counted.
    pub(super) fn runs(&self, whole: &Self) -> Option<impl Iterator<Item = (usize, usize)> + use<>> {
        let [x, y, z] = self.start_in(whole)?;
        let [nx, ny, nz] = self.dims;
        let [wx, wy, _] = whole.dims;
        // Rows as long as the whole's follow on one another, and so do layers as large.
        let (length, rows, layers) = match (nx == wx, ny == wy) {
            (true, true) => (nx * ny * nz, 1, 1),
            (true, false) => (nx * ny, 1, nz),
            (false, _) => (nx, ny, nz),
        };
        let runs = (0..layers).flat_map(move |k| (0..rows).map(move |j| (x + wx * (y + j + wy * (z + k)), length)));
        Some(runs)
    }
}
