//! Position of a volume's voxels in the world.

use glam::{DMat3, DVec3};

use super::VolumeError;
use crate::number::count;

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

    /// Size along each axis in world units, `spacing · dims`.
    #[must_use]
    pub fn extent(&self) -> DVec3 {
        self.spacing * DVec3::from_array(self.dims.map(count))
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
