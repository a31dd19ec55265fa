//! Volumes: voxels and their geometry, file readers, statistics, resampling and phantoms.
#![forbid(unsafe_code)]

mod allocate;
mod axes;
mod bricks;
mod coarse;
mod connected;
mod data;
mod error;
mod geometry;
mod joint;
mod label_names;
mod labels;
mod layout;
mod modality;
mod neighbours;
pub mod phantom;

mod presets;
mod readers;
mod resample;
mod select;
mod several;
mod slabs;
mod statistics;
mod stream;
mod streamed;
mod unit;
mod voxel_type;
mod voxels;

pub use bricks::{
    BRICK, BrickCache, BrickLevel, BricksMade, CELL, CacheCounts, MakeError, brick_levels, cell_maxima, cell_ranges,
    macrocells,
};
pub use coarse::{Finest, coarse_index, index_of_coarse};
pub use connected::{PartBox, Parts};
pub use error::VolumeError;
pub use geometry::Geometry;
pub use phantom::Phantom;
pub use readers::open::{extensions, make_bricks, open, open_by, open_raw, packed_blocks};
pub use readers::open::{has_header, is_volume, refusal};

pub use joint::{JOINT_BINS, JointHistogram};
pub use label_names::{BUILT_IN_NAMES, is_built_in, label_names};
pub use labels::{LabelCounts, MOST_LABELS, NoLabels, is_background};
pub use layout::{ByteOrder, RawLayout};
pub use modality::Modality;
pub use presets::{LabelPreset, Presets, Window};
pub use readers::offered::Offered;
pub use readers::preview::Preview;
pub use readers::slices::grey_picture;
pub use readers::vti::PackedBlocks;
pub use select::{HostMemory, Part, Selection};
pub use several::{Asked, Series, Several};
pub use statistics::{BINS, Statistics};
pub use unit::Unit;
pub use voxel_type::VoxelType;
pub use voxels::{Voxel, Voxels};

use std::path::PathBuf;
use std::sync::Arc;

/// A scalar volume: voxels, their geometry, and their scaling to values.
#[derive(Clone, Debug)]
pub struct Volume {
    /// Voxels as stored, x fastest; none if they stay in the file of `bricks`.
    pub voxels: Voxels,
    /// The file of bricks with the voxels, if these are not in memory.
    pub bricks: Option<Arc<BrickCache>>,
    /// Position of the voxels; has as many voxels as `voxels`.
    pub geometry: Geometry,
    /// Whether the file declares its axes as anatomical. The world is then left-posterior-superior, as in DICOM: x
    /// points to a patient's left, y to the back, z to the head.
    pub anatomical: bool,
    /// Unit of the spacing and the origin, if the file states it.
    pub unit: Option<Unit>,
    /// Slope of the voxel value `slope · stored + intercept`.
    pub slope: f64,
    /// Intercept of the voxel value; see `slope`.
    pub intercept: f64,
    /// Components per voxel in the file; one of them was read.
    pub components: usize,
    /// Names of the components, or nothing if the file states none.
    pub component_names: Vec<String>,
    /// Whether the file declares its voxels as labels: numbers of classes, which have no mean.
    pub has_labels: bool,
    /// Display presets of the file.
    pub presets: Presets,
    /// Choice among the volumes of the file.
    pub selection: Selection,
    /// The volume of which the voxels are a part, if some slices were read.
    pub part: Option<Part>,
    /// Size of the block of file voxels whose mean is one voxel, along each axis.
    pub blocks: [usize; 3],
    /// The grid of which the voxels are a coarse level, if they are: a picture shows its box.
    pub finest: Option<Finest>,
    /// Path of the file as requested, or name of the phantom.
    pub source: String,
    /// Files that were read: header, sidecar and data; empty for a phantom.
    pub files: Vec<PathBuf>,
    /// Further keys and values of the file, kept but not interpreted.
    pub metadata: Vec<(String, String)>,
    /// The sentence of `notes` about a spacing that the file does not state; [`Self::with_spacing`] removes it.
    pub assumed_spacing: Option<String>,
    /// Sentences about oddities and losses in reading; the caller reports them as warnings.
    pub notes: Vec<String>,
}

impl Volume {
    /// A volume of `voxels` with slope 1, intercept 0 and no metadata.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] if `geometry` has a different number of voxels.
    pub fn new(source: &str, voxels: Voxels, geometry: Geometry) -> Result<Self, VolumeError> {
        if voxels.len() != geometry.voxels() {
            let problem = format!("there are {} voxels, but the grid has {}", voxels.len(), geometry.voxels());
            return Err(VolumeError::Layout { source_name: source.to_owned(), problem });
        }
        Ok(Self::described(source, voxels, geometry))
    }

    /// Raises each voxel to its value in `other`, where that is larger.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Layout`] if `other` has other dimensions, or if voxels of either stay in a file.
    pub fn raise_to(&mut self, other: &Self) -> Result<(), VolumeError> {
        let refused = |problem: String| Err(VolumeError::Layout { source_name: other.source.clone(), problem });
        if self.geometry.dims != other.geometry.dims {
            let [ours, theirs] = [self, other].map(|it| it.geometry.dims.map(|side| side.to_string()).join(" × "));
            return refused(format!("the volumes have different sizes: {ours} and {theirs} voxels"));
        }
        if self.voxels.len() != other.voxels.len() {
            return refused("the voxels of one of the volumes stay in its file".to_owned());
        }
        let [ours, theirs] = [&*self, other].map(|it| [it.slope.to_bits(), it.intercept.to_bits()]);
        if ours != theirs || self.slope < 0.0 || !self.voxels.raise_to(&other.voxels) {
            let value = |index: usize| {
                let [ours, theirs] = [&*self, other].map(|it| {
                    let stored = it.voxels.value(index).unwrap_or(f64::NAN);
                    stored.mul_add(it.slope, it.intercept)
                });
                ours.max(theirs)
            };
            self.voxels = Voxels::F64((0..self.voxels.len()).map(value).collect());
            (self.slope, self.intercept) = (1.0, 0.0);
        }
        Ok(())
    }

    /// A volume of `voxels`; if there are none, they lie elsewhere.
    pub(crate) fn of_voxels(source: &str, voxels: Voxels, geometry: Geometry) -> Result<Self, VolumeError> {
        if voxels.is_empty() {
            Ok(Self::described(source, voxels, geometry))
        } else {
            Self::new(source, voxels, geometry)
        }
    }

    fn described(source: &str, voxels: Voxels, geometry: Geometry) -> Self {
        Self {
            voxels,
            bricks: None,
            geometry,
            anatomical: false,
            unit: None,
            slope: 1.0,
            intercept: 0.0,
            components: 1,
            component_names: Vec::new(),
            has_labels: false,
            presets: Presets::default(),
            selection: Selection::default(),
            part: None,
            blocks: [1; 3],
            finest: None,
            source: source.to_owned(),
            files: Vec::new(),
            metadata: Vec::new(),
            assumed_spacing: None,
            notes: Vec::new(),
        }
    }

    /// Refuses a volume whose voxels are not in memory; `what` needs them.
    ///
    /// # Errors
    ///
    /// [`VolumeError::InFile`].
    pub fn require_voxels(&self, what: &'static str) -> Result<(), VolumeError> {
        match self.bricks {
            Some(_) => Err(VolumeError::InFile { source_name: self.source.clone(), what }),
            None => Ok(()),
        }
    }

    /// Value of voxel `[x, y, z]`, `slope · stored + intercept`; `None` outside the grid, and if the voxels are not in memory.
    #[must_use]
    pub fn value(&self, index: [usize; 3]) -> Option<f64> {
        let stored = self.voxels.value(self.geometry.linear_index(index)?)?;
        Some(stored.mul_add(self.slope, self.intercept))
    }

    /// [`Self::value`], also of a voxel that stays in a file of bricks.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`], [`VolumeError::Bricks`].
    pub fn read_value(&self, index: [usize; 3]) -> Result<Option<f64>, VolumeError> {
        match &self.bricks {
            Some(cache) if self.geometry.linear_index(index).is_some() => {
                let stored = cache.part(index, index.map(|at| at + 1))?.value([0; 3]);
                Ok(stored.map(|stored| stored.mul_add(self.slope, self.intercept)))
            }
            _ => Ok(self.value(index)),
        }
    }

    /// Replaces the spacing of the grid.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Spacing`] if a spacing is not a positive number.
    pub fn with_spacing(mut self, spacing: glam::DVec3) -> Result<Self, VolumeError> {
        let Geometry { dims, origin, direction, .. } = self.geometry;
        self.geometry = Geometry::new(&self.source, dims, spacing, origin, direction)?;
        if let Some(assumed) = self.assumed_spacing.take() {
            self.notes.retain(|note| *note != assumed);
        }
        Ok(self)
    }
}
