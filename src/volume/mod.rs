//! What the data is.

mod data;
mod error;
mod fields;
mod foreign;
mod geometry;
mod metaimage;
mod nrrd;
mod open;
mod pattern;
pub mod phantom;

mod raw;
mod resample;
mod select;
mod statistics;
mod stream;
mod voxels;
mod vti;

pub use error::VolumeError;
pub use geometry::Geometry;
pub use open::{extensions, open, open_by, open_raw, packed_blocks};
pub(crate) use open::{has_header, is_volume, refusal};
pub use phantom::Phantom;

pub use raw::{ByteOrder, RawLayout};
pub use select::{Selection, Several};
pub use statistics::{BINS, Statistics};
pub(crate) use voxels::with_voxels;
pub use voxels::{Voxel, VoxelType, Voxels};
pub use vti::PackedBlocks;

use std::path::PathBuf;

/// A scalar volume: voxels, where they lie, and what they mean.
#[derive(Clone, Debug)]
pub struct Volume {
    /// The voxels as stored, x fastest.
    pub voxels: Voxels,
    /// Where they lie; it has as many voxels as `voxels`.
    pub geometry: Geometry,
    /// Whether the file says that its axes are anatomical. The world is left-posterior-superior then, as in DICOM: x to a
    /// patient's left, y to the back, z to the head.
    pub anatomical: bool,
    /// A voxel means `slope · stored + intercept`.
    pub slope: f64,
    /// See `slope`.
    pub intercept: f64,
    /// Numbers per voxel in the file, of which one was read.
    pub components: usize,
    /// Which of several volumes in the file it is.
    pub selection: Selection,
    /// Voxels of the file that each voxel is the mean of, along each axis.
    pub blocks: [usize; 3],
    /// The file as it was asked for, or the name of the phantom.
    pub source: String,
    /// The files that it was read from: header, sidecar and data; none for a phantom.
    pub files: Vec<PathBuf>,
    /// What else the file says: keys and values that are kept but not interpreted.
    pub metadata: Vec<(String, String)>,
    /// Sentences about what was odd, or was given up; the caller passes them on as warnings.
    pub notes: Vec<String>,
}

impl Volume {
    /// A volume of `voxels` that mean what is stored, with nothing else to say.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] where `geometry` has another number of voxels.
    pub fn new(source: &str, voxels: Voxels, geometry: Geometry) -> Result<Self, VolumeError> {
        if voxels.len() != geometry.voxels() {
            let problem = format!("{} voxels in a grid of {}", voxels.len(), geometry.voxels());
            return Err(VolumeError::Layout { source_name: source.to_owned(), problem });
        }
        Ok(Self {
            voxels,
            geometry,
            anatomical: false,
            slope: 1.0,
            intercept: 0.0,
            components: 1,
            selection: Selection::default(),
            blocks: [1; 3],
            source: source.to_owned(),
            files: Vec::new(),
            metadata: Vec::new(),
            notes: Vec::new(),
        })
    }

    /// What voxel `[x, y, z]` means: `slope · stored + intercept`; `None` outside the grid.
    #[must_use]
    pub fn value(&self, index: [usize; 3]) -> Option<f64> {
        let stored = self.voxels.value(self.geometry.linear_index(index)?)?;
        Some(stored.mul_add(self.slope, self.intercept))
    }

    /// The same voxels on a grid of another spacing.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Spacing`] where a spacing is not a positive number.
    pub fn with_spacing(mut self, spacing: glam::DVec3) -> Result<Self, VolumeError> {
        let Geometry { dims, origin, direction, .. } = self.geometry;
        self.geometry = Geometry::new(&self.source, dims, spacing, origin, direction)?;
        Ok(self)
    }
}
