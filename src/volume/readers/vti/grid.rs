//! The points and cells of an image, and the ranges of them that pieces cover.

use std::str::FromStr;

use glam::{DMat3, DVec3};

use crate::{Geometry, VolumeError};

/// Owner of an array's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Section {
    /// The corners of the grid.
    Points,
    /// The cells between the corners.
    Cells,
    /// The data set as a whole.
    Fields,
}

impl Section {
    pub(super) const ALL: [Self; 3] = [Self::Points, Self::Cells, Self::Fields];

    /// VTK's name of the section.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Points => "PointData",
            Self::Cells => "CellData",
            Self::Fields => "FieldData",
        }
    }
}

/// First and last index of the points along each axis; empty if the last is before the first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Extent {
    first: [i64; 3],
    last: [i64; 3],
}

impl FromStr for Extent {
    type Err = ();

    /// Parses `x0 x1 y0 y1 z0 z1`. The numbers have 32 bits, as in VTK, so that differences do not overflow.
    fn from_str(text: &str) -> Result<Self, ()> {
        let numbers = text.split_whitespace().map(|word| word.parse::<i32>().map(i64::from));
        let [x0, x1, y0, y1, z0, z1] = numbers.collect::<Result<Vec<_>, _>>().map_err(drop)?[..] else {
            return Err(());
        };
        Ok(Self { first: [x0, y0, z0], last: [x1, y1, z1] })
    }
}

/// Grid of the points of the whole image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) extent: Extent,
    pub(super) origin: DVec3,
    pub(super) spacing: DVec3,
    pub(super) direction: DMat3,
}

impl Frame {
    /// Returns the points or cells of `extent`.
    pub(super) fn block(&self, section: Section, extent: &Extent) -> Block {
        let dims = [0, 1, 2].map(|axis| {
            // An image that is flat along an axis has one layer of cells along it, not none.
            let flat = self.extent.first[axis] == self.extent.last[axis];
            let between = i64::from(section == Section::Cells && !flat);
            usize::try_from(extent.last[axis] - extent.first[axis] + 1 - between).unwrap_or(0)
        });
        Block { first: extent.first, dims }
    }

    /// Geometry of the points, or of the cell centres, of the whole image.
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
    /// A row of `length` points.
    pub(super) fn row(length: usize) -> Self {
        Self { first: [0; 3], dims: [length, 1, 1] }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.dims.contains(&0)
    }

    /// Number of points or cells; `None` on overflow.
    pub(super) fn voxels(&self) -> Option<usize> {
        self.dims.iter().try_fold(1_usize, |product, &n| product.checked_mul(n))
    }

    /// Position of the first element in `whole`; `None` if the block is not contained in it.
    fn start_in(&self, whole: &Self) -> Option<[usize; 3]> {
        let start = [0, 1, 2].map(|axis| usize::try_from(self.first[axis] - whole.first[axis]).unwrap_or(usize::MAX));
        let inside = |axis: usize| start[axis].checked_add(self.dims[axis]).is_some_and(|end| end <= whole.dims[axis]);
        [0, 1, 2].into_iter().all(inside).then_some(start)
    }

    /// Returns the first voxel and the length of each contiguous run of the block in `whole`, in order; `None` if the
    /// block is not contained in `whole`. The voxels of `whole` must be countable.
    pub(super) fn runs(&self, whole: &Self) -> Option<impl Iterator<Item = (usize, usize)> + use<>> {
        let [x, y, z] = self.start_in(whole)?;
        let [nx, ny, nz] = self.dims;
        let [wx, wy, _] = whole.dims;
        // Rows that span the whole are contiguous, and so are layers that span it.
        let (length, rows, layers) = match (nx == wx, ny == wy) {
            (true, true) => (nx * ny * nz, 1, 1),
            (true, false) => (nx * ny, 1, nz),
            (false, _) => (nx, ny, nz),
        };
        let runs = (0..layers).flat_map(move |k| (0..rows).map(move |j| (x + wx * (y + j + wy * (z + k)), length)));
        Some(runs)
    }
}
