//! Position of a volume's voxels in the world.

use std::ops::Range;

use glam::{DMat3, DVec3};

use super::VolumeError;
use relume_base::number::count;

/// Largest deviation of an entry of `DᵀD` from the identity, for a direction matrix D: headers have few digits.
const ORTHONORMALITY: f64 = 1e-3;

/// Grid of a volume. Voxels are points: voxel (0, 0, 0) lies on `origin`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Voxels along x, y and z; x varies fastest.
    pub dims: [usize; 3],
    /// World units between neighbouring voxels along each axis, positive.
    pub spacing: DVec3,
    /// World position of voxel (0, 0, 0).
    pub origin: DVec3,
    /// Column `i` is the unit vector of axis `i` in the world, as in ITK and VTK.
    pub direction: DMat3,
}

impl Geometry {
    /// Texture coordinates, 0 to 1 along each axis, of a vector in the world.
    #[must_use]
    pub fn texture_from_world(&self) -> DMat3 {
        let dims = DVec3::from_array(self.dims.map(count));
        DMat3::from_diagonal((self.spacing * dims).recip()) * self.direction.inverse()
    }

    /// A validated grid; `source` is the file named in errors.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed, [`VolumeError::Spacing`] if a
    /// spacing is not a positive number, [`VolumeError::Origin`] if the origin is not finite,
    /// [`VolumeError::Direction`] if the axes are not orthonormal within 1e-3.
    pub fn new(
        source: &str,
        dims: [usize; 3],
        spacing: DVec3,
        origin: DVec3,
        direction: DMat3,
    ) -> Result<Self, VolumeError> {
        let source = || source.to_owned();
        // Eight bytes per voxel must be addressable, whatever the type.
        let bytes = dims.iter().try_fold(8_usize, |product, &n| product.checked_mul(n));
        if dims.contains(&0) || bytes.is_none_or(|bytes| isize::try_from(bytes).is_err()) {
            return Err(VolumeError::Dims {
                source_name: source(),
                dims: format!("{}×{}×{}", dims[0], dims[1], dims[2]),
            });
        }
        if !spacing.to_array().iter().all(|&step| step > 0.0 && step.is_finite()) {
            return Err(VolumeError::Spacing { source_name: source(), spacing: spacing.to_array() });
        }
        if !origin.is_finite() {
            return Err(VolumeError::Origin { source_name: source(), origin: origin.to_array() });
        }
        let gram = direction.transpose() * direction;
        let deviation = (gram - DMat3::IDENTITY).to_cols_array().iter().fold(0.0_f64, |worst, entry| {
            // `max` would drop a NaN.
            if entry.abs() <= worst { worst } else { entry.abs() }
        });
        if deviation <= ORTHONORMALITY {
            Ok(Self { dims, spacing, origin, direction })
        } else {
            Err(VolumeError::Direction {
                source_name: source(),
                axes: direction.to_cols_array_2d(),
                deviation,
                limit: ORTHONORMALITY,
            })
        }
    }

    /// A grid of spacing 1 along the world's axes, with its origin at 0.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Dims`] if an axis has no voxels or the voxels cannot be addressed.
    pub fn unit(source: &str, dims: [usize; 3]) -> Result<Self, VolumeError> {
        Self::new(source, dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY)
    }

    /// The grid of some of its slices along z.
    pub(super) fn of_slices(self, slices: &Range<usize>) -> Self {
        let origin = self.world_from_index(DVec3::new(0.0, 0.0, count(slices.start)));
        Self { dims: [self.dims[0], self.dims[1], slices.len()], origin, ..self }
    }

    /// The grid of `dims` blocks of so many voxels along each axis: each lies at the centre of its voxels.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Spacing`] if a block is larger than a number can say.
    pub(super) fn of_blocks(&self, source: &str, block: [usize; 3], dims: [usize; 3]) -> Result<Self, VolumeError> {
        let sides = DVec3::from_array(block.map(count));
        Self::new(source, dims, self.spacing * sides, self.world_from_index((sides - 1.0) / 2.0), self.direction)
    }

    /// The grid of the next coarser level of resolution. An axis of one voxel stays as it is.
    ///
    /// # Errors
    ///
    /// Those of [`Self::of_blocks`].
    pub(super) fn halved(&self, source: &str) -> Result<Self, VolumeError> {
        self.of_blocks(source, self.dims.map(|n| n.min(2)), self.dims.map(|n| n.div_ceil(2)))
    }

    /// Whether the voxels coincide with those of `other`, up to the rounding of headers: spacings within a thousandth
    /// of each other, directions within 1e-3, origins within a thousandth of a voxel plus a millionth of their distance
    /// from 0.
    #[must_use]
    pub fn lies_on(&self, other: &Self) -> bool {
        let spacing = self.spacing.max(other.spacing);
        let origin = 1e-3 * spacing.max_element() + 1e-6 * self.origin.length();
        self.dims == other.dims
            && (self.spacing - other.spacing).abs().cmple(1e-3 * spacing).all()
            && self.origin.distance(other.origin) <= origin
            && self.direction.abs_diff_eq(other.direction, 1e-3)
    }

    /// Whether the axes and the boxes of both grids coincide, the boxes within half a voxel of the coarser one.
    #[must_use]
    pub fn fills_box_of(&self, other: &Self) -> bool {
        let corners = |grid: &Self| {
            let last = DVec3::from_array(grid.dims.map(count)) - 0.5;
            [DVec3::splat(-0.5), last].map(|index| grid.direction.transpose() * grid.world_from_index(index))
        };
        // Some files have the centre of the first voxel at 0, whatever its size.
        let slack = 0.5 * self.spacing.max(other.spacing) + 1e-6;
        let is_near = |(one, another): (DVec3, DVec3)| (one - another).abs().cmple(slack).all();
        self.direction.abs_diff_eq(other.direction, 1e-3) && corners(self).into_iter().zip(corners(other)).all(is_near)
    }

    /// The grid of `dims` voxels that fills the box of `other`.
    #[must_use]
    pub fn filling(dims: [usize; 3], other: &Self) -> Self {
        let spacing = other.extent() / DVec3::from_array(dims.map(count));
        let corner = other.world_from_index(DVec3::splat(-0.5));
        Self { dims, spacing, origin: corner + other.direction * (spacing / 2.0), direction: other.direction }
    }

    /// Size along each axis in world units, `spacing · dims`.
    #[must_use]
    pub fn extent(&self) -> DVec3 {
        self.spacing * DVec3::from_array(self.dims.map(count))
    }

    /// Opposite corners of the box of whole voxels; `None` if its sides are not along the axes of the world.
    #[must_use]
    pub fn world_box(&self) -> Option<[DVec3; 2]> {
        let is_along = |axis: usize| self.direction.col(axis).abs().max_element() > 1.0 - 1e-12;
        let last = DVec3::from_array(self.dims.map(count)) - 0.5;
        let corners = [DVec3::splat(-0.5), last].map(|index| self.world_from_index(index));
        (0..3).all(is_along).then_some(corners)
    }

    /// Number of voxels.
    #[must_use]
    pub fn voxels(&self) -> usize {
        self.dims.iter().product()
    }

    /// Linear index of voxel `[x, y, z]`; `None` outside the grid.
    #[must_use]
    pub fn linear_index(&self, [x, y, z]: [usize; 3]) -> Option<usize> {
        let [nx, ny, nz] = self.dims;
        (x < nx && y < ny && z < nz).then(|| x + nx * (y + ny * z))
    }

    /// World position of a (fractional) voxel index: `origin + direction · (spacing ∘ index)`.
    #[must_use]
    pub fn world_from_index(&self, index: DVec3) -> DVec3 {
        self.origin + self.direction * (self.spacing * index)
    }
}

/// Grid whose axes may lean: voxel `i` lies at `origin + steps · i`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lattice {
    pub(super) dims: [usize; 3],
    pub(super) origin: DVec3,
    /// Column `i` is the step from voxel to voxel on axis `i`.
    pub(super) steps: DMat3,
}

/// Smallest sine of an angle between axes that can be resampled: about 6°.
const FLATTEST: f64 = 0.1;

/// Largest number of voxels of a straight grid per voxel of the leaning one.
const MOST_GROWTH: usize = 16;

impl Lattice {
    /// The grid, if its axes are orthogonal.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Lean`] if the axes are not orthogonal, otherwise as [`Geometry::new`].
    pub(super) fn geometry(&self, source: &str) -> Result<Geometry, VolumeError> {
        let spacing = self.lengths();
        let steps = self.steps;
        let direction = DMat3::from_cols(steps.x_axis / spacing.x, steps.y_axis / spacing.y, steps.z_axis / spacing.z);
        match Geometry::new(source, self.dims, spacing, self.origin, direction) {
            Err(VolumeError::Direction { .. }) => {
                Err(VolumeError::Lean { source_name: source.to_owned(), angles: self.angles() })
            }
            made => made,
        }
    }

    /// The lattice of some of its slices along z. A single one does not lean.
    pub(super) fn of_slices(self, slices: &Range<usize>) -> Self {
        let mut steps = self.steps;
        if slices.len() == 1 {
            steps.z_axis = steps.x_axis.cross(steps.y_axis).normalize() * steps.z_axis.length();
        }
        let origin = self.world_from_index(DVec3::new(0.0, 0.0, count(slices.start)));
        Self { dims: [self.dims[0], self.dims[1], slices.len()], origin, steps }
    }

    fn lengths(&self) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|axis| self.steps.col(axis).length()))
    }

    /// Angles in degrees between the axes x and y, x and z, y and z.
    fn angles(&self) -> [f64; 3] {
        [(0, 1), (0, 2), (1, 2)].map(|(a, b)| self.steps.col(a).angle_between(self.steps.col(b)).to_degrees())
    }

    /// World position of a (fractional) voxel index.
    pub(super) fn world_from_index(&self, index: DVec3) -> DVec3 {
        self.origin + self.steps * index
    }

    /// The smallest straight grid around all voxels. Its x axis is that of the lattice, its y axis lies in the plane
    /// of the lattice's x and y, and its spacings are the distances between the lattice's neighbouring voxels along the
    /// new axes: a leaning stack of slices keeps the voxels of each slice.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Lean`] if the axes are within 6° of a plane or a line, or if the grid would have more than 16
    /// times as many voxels.
    pub(super) fn straightened(&self, source: &str) -> Result<Geometry, VolumeError> {
        let lean = || VolumeError::Lean { source_name: source.to_owned(), angles: self.angles() };
        let [x, y, z] = [0, 1, 2].map(|axis| self.steps.col(axis));
        let lengths = self.lengths();
        let first = x / lengths.x;
        let second = (y - first * first.dot(y)).normalize_or_zero();
        let third = first.cross(second) * first.cross(second).dot(z).signum();
        let spacing = DVec3::new(lengths.x, second.dot(y), third.dot(z));
        if !spacing.cmpge(lengths * FLATTEST).all() {
            return Err(lean());
        }
        let axes = DMat3::from_cols(first, second, third);
        let mut ends = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for corner in 0..8 {
            let index = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { count(self.dims[axis] - 1) } else { 0.0 });
            let place = axes.transpose() * (self.steps * DVec3::from_array(index)) / spacing;
            ends = [ends[0].min(place), ends[1].max(place)];
        }
        // Rounding must not add a voxel.
        let sides = (ends[1] - ends[0] - 1e-6).ceil().max(DVec3::ZERO) + 1.0;
        let most = count(self.dims.iter().product::<usize>()) * count(MOST_GROWTH);
        if sides.element_product() > most {
            return Err(lean());
        }
        let origin = self.origin + axes * (ends[0] * spacing);
        Geometry::new(source, sides.to_array().map(relume_base::number::whole), spacing, origin, axes)
    }
}
