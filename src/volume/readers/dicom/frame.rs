//! A frame: layout of its pixels, place and scaling.

use glam::DVec3;

use super::keys::Mark;
use crate::VoxelType;
use crate::stream::count;

/// Layout of the stored numbers of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Numbers per pixel.
    pub(super) samples: usize,
    /// Whether the samples lie in planes, and not side by side.
    pub(super) is_planar: bool,
    pub(super) photometric: String,
    /// Bits between neighbouring numbers, used bits of each, and the highest used bit.
    pub(super) allocated: u32,
    pub(super) stored: u32,
    pub(super) high: u32,
    pub(super) is_signed: bool,
    pub(super) voxel_type: VoxelType,
}

impl Layout {
    /// Pixels of a frame.
    pub(super) fn pixels(&self) -> usize {
        self.rows * self.columns
    }

    /// Bits of a frame.
    pub(super) fn bits(&self) -> u64 {
        count(self.pixels()).saturating_mul(count(self.samples)).saturating_mul(self.allocated.into())
    }

    /// Bytes of a frame of whole bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.bits().div_ceil(8)
    }
}

/// Place and scaling of a frame.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// World position of the centre of the first pixel, in mm.
    pub(super) position: Option<DVec3>,
    /// Directions of growing column and row index.
    pub(super) orientation: Option<[DVec3; 2]>,
    /// Whether these are those of the patient.
    pub(super) is_anatomical: bool,
    /// Distances between rows and between columns, in mm.
    pub(super) spacing: Option<[f64; 2]>,
    pub(super) thickness: Option<f64>,
    /// `SpacingBetweenSlices`.
    pub(super) between: Option<f64>,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    /// Attributes of this frame alone that may tell it apart.
    pub(super) marks: Vec<Mark>,
    /// Stack of the frame, if the file has several.
    pub(super) stack: String,
    /// Segment of a frame of a segmentation.
    pub(super) segment: Option<usize>,
}
