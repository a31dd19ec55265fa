//! Coarse levels: means of blocks of voxels, which stand for a volume that exceeds the memory or the device.

use std::sync::Arc;

use glam::DVec3;

use super::resample::of_blocks;
use super::{Geometry, Volume, VolumeError, Voxel, Voxels, with_voxels};
use crate::number::count;
use crate::progress::Progress;

impl Volume {
    /// The volume of the means of blocks of `block` voxels; of labels, the most frequent ones. Blocks at the ends of the axes
    /// may be incomplete, so that it covers all voxels.
    ///
    /// # Errors
    ///
    /// [`VolumeError::InFile`] if the voxels are not in memory.
    pub fn coarse_level(&self, block: [usize; 3]) -> Result<Self, VolumeError> {
        self.of_blocks(block, self.has_labels)
    }

    /// As [`Self::coarse_level`], of a label map.
    ///
    /// # Errors
    ///
    /// [`VolumeError::InFile`] if the voxels are not in memory.
    pub fn coarse_level_of_labels(&self, block: [usize; 3]) -> Result<Self, VolumeError> {
        self.of_blocks(block, true)
    }

    fn of_blocks(&self, block: [usize; 3], labels: bool) -> Result<Self, VolumeError> {
        self.require_voxels("averaging blocks")?;
        let dims = self.geometry.dims;
        let voxels = with_voxels!(&self.voxels, stored => Voxel::into_voxels(of_blocks(stored, dims, block, labels)));
        self.of_coarse_voxels(voxels, block)
    }

    /// The coarse level of this volume with these `voxels`.
    pub(super) fn of_coarse_voxels(&self, voxels: Voxels, block: [usize; 3]) -> Result<Self, VolumeError> {
        let dims = std::array::from_fn(|axis| self.geometry.dims[axis].div_ceil(block[axis]));
        Ok(self.reduced(voxels, self.geometry.of_blocks(&self.source, block, dims)?, block))
    }

    /// Makes the coarse level of a volume whose voxels stay in a file, unless it is made: [`Self::at_hand`] returns it then.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Cancelled`], [`VolumeError::Read`], [`VolumeError::Bricks`]; [`VolumeError::BrickMemory`] if there is no
    /// memory for it beside the bricks of a march.
    pub fn prepare_coarse(&self, progress: &dyn Progress) -> Result<(), VolumeError> {
        self.bricks.as_ref().map_or(Ok(()), |cache| cache.make_coarse(self, progress))
    }

    /// The volume with its voxels in memory: itself, or its coarse level, on the grid of the file, if its voxels stay in a file.
    /// These have none before [`Self::prepare_coarse`].
    #[must_use]
    pub fn at_hand(&self) -> &Self {
        self.coarse_in_file().map_or(self, |coarse| coarse)
    }

    /// The coarse level of a volume whose voxels stay in a file, once it is made.
    pub(crate) fn coarse_in_file(&self) -> Option<&Arc<Self>> {
        self.bricks.as_ref()?.coarse()
    }

    /// Voxels along each axis whose mean is a voxel of `coarse`, a coarse level of this volume or itself.
    #[must_use]
    pub fn block_of(&self, coarse: &Self) -> [usize; 3] {
        std::array::from_fn(|axis| coarse.blocks[axis] / self.blocks[axis].max(1))
    }

    /// The grid of this coarse level, whose voxels are blocks of `block` voxels of `of`.
    ///
    /// # Errors
    ///
    /// As [`Geometry::new`].
    pub(crate) fn grid_over(&self, of: &Self, block: [usize; 3]) -> Result<Geometry, VolumeError> {
        of.geometry.of_blocks(&self.source, block, self.geometry.dims)
    }
}

/// The index in a coarse level of blocks of `block` voxels that is at `index` of the volume.
#[must_use]
pub fn coarse_index(index: DVec3, block: [usize; 3]) -> DVec3 {
    (index + 0.5) / DVec3::from_array(block.map(count)) - 0.5
}

/// The inverse of [`coarse_index`].
#[must_use]
pub fn index_of_coarse(coarse: DVec3, block: [usize; 3]) -> DVec3 {
    (coarse + 0.5) * DVec3::from_array(block.map(count)) - 0.5
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    #[test]
    fn a_coarse_level_covers_all_voxels_and_its_last_blocks_may_be_incomplete() {
        // Voxel x holds 10·x; the axes have 5, 2 and 1 voxels.
        let voxels = Voxels::U16((0..10).map(|i| 10 * (i % 5)).collect());
        let volume = Volume::new("test", voxels, Geometry::unit("test", [5, 2, 1]).unwrap()).unwrap();
        let coarse = volume.coarse_level([2, 2, 1]).unwrap();
        assert_eq!(coarse.geometry.dims, [3, 1, 1]);
        assert_eq!([0, 1, 2].map(|at| coarse.voxels.value(at)), [Some(5.0), Some(25.0), Some(40.0)]);
        assert_eq!((coarse.blocks, volume.block_of(&coarse)), ([2, 2, 1], [2, 2, 1]));
        let there = volume.geometry.world_from_index(DVec3::new(3.0, 1.0, 0.0));
        let same = coarse.geometry.world_from_index(coarse_index(DVec3::new(3.0, 1.0, 0.0), [2, 2, 1]));
        assert!(there.distance(same) < 1e-12, "{there} {same}");
        let back = index_of_coarse(coarse_index(DVec3::new(3.0, 1.0, 0.0), [2, 2, 1]), [2, 2, 1]);
        assert!(back.distance(DVec3::new(3.0, 1.0, 0.0)) < 1e-12, "{back}");
    }
}
