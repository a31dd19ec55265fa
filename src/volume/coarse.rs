//! Coarse levels: means of blocks of voxels, which stand for a volume that exceeds the memory or the device.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;

use super::resample::of_blocks;
use super::{Geometry, Volume, VolumeError, Voxel, Voxels, with_voxels};
use crate::data::{check_cancelled, report};
use relume_base::number::count;
use relume_base::progress::Progress;

/// A grid of which a volume is a coarse level.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Finest {
    /// Its voxels along each axis.
    pub dims: [usize; 3],
    /// Those whose mean is a voxel of the level, along each axis.
    pub block: [usize; 3],
}

impl Volume {
    /// The volume of the means of blocks of `block` voxels; of labels, the most frequent ones. Blocks at the ends of the axes
    /// may be incomplete, so that it covers all voxels.
    ///
    /// # Errors
    ///
    /// [`VolumeError::InFile`] if the voxels are not in memory; [`VolumeError::Cancelled`] if `progress` asks for the end.
    pub fn coarse_level(&self, block: [usize; 3], progress: &dyn Progress) -> Result<Self, VolumeError> {
        self.of_blocks(block, self.has_labels, progress)
    }

    /// As [`Self::coarse_level`], of a label map.
    ///
    /// # Errors
    ///
    /// [`VolumeError::InFile`] if the voxels are not in memory; [`VolumeError::Cancelled`] if `progress` asks for the end.
    pub fn coarse_level_of_labels(&self, block: [usize; 3], progress: &dyn Progress) -> Result<Self, VolumeError> {
        self.of_blocks(block, true, progress)
    }

    fn of_blocks(&self, block: [usize; 3], labels: bool, progress: &dyn Progress) -> Result<Self, VolumeError> {
        self.require_voxels("averaging blocks")?;
        let dims = self.geometry.dims;
        let voxels = with_voxels!(&self.voxels, stored => {
            Voxel::into_voxels(of_blocks(stored, dims, block, labels, progress))
        });
        check_cancelled(Path::new(&self.source), progress)?;
        self.of_coarse_voxels(voxels, block)
    }

    /// The volume at half the resolution, so many times: a level of its file of bricks as long as there is one, if its voxels
    /// stay there; then means of 2×2×2 voxels of the level before, or the most frequent ones if these are `labels`. Both are
    /// the same voxels. They stay in the file if they exceed the memory.
    ///
    /// # Errors
    ///
    /// [`VolumeError::InFile`] for labels in a file that does not mark them as labels, whose levels are means;
    /// [`VolumeError::Cancelled`], [`VolumeError::Read`], [`VolumeError::Bricks`], [`VolumeError::BrickMemory`].
    pub fn coarser_by(&self, halvings: u32, labels: bool, progress: &dyn Progress) -> Result<Self, VolumeError> {
        if labels && !self.has_labels {
            self.require_voxels("a level of labels that are not marked as labels")?;
        }
        let mut made = None;
        let mut done = 0;
        if let Some(cache) = &self.bricks {
            done = cache.further_levels().min(halvings as usize);
            made = Some(cache.coarser(self, done, progress)?);
        }
        for halving in done..halvings as usize {
            report(Path::new(&self.source), halving as u64, halvings.into(), progress)?;
            let finer = made.as_ref().unwrap_or(self);
            made = Some(finer.of_blocks(finer.geometry.dims.map(|n| n.min(2)), labels, progress)?);
        }
        Ok(made.unwrap_or_else(|| self.clone()))
    }

    /// Number of levels coarser than the volume, down to a single voxel; none if its voxels stay in a file without levels.
    #[must_use]
    pub fn coarser_levels(&self) -> u32 {
        if self.bricks.as_ref().is_some_and(|cache| cache.further_levels() == 0) {
            return 0;
        }
        self.geometry.dims.map(|n| n.next_power_of_two().ilog2()).into_iter().max().unwrap_or(0)
    }

    /// The coarse level of this volume with these `voxels`.
    pub(super) fn of_coarse_voxels(&self, voxels: Voxels, block: [usize; 3]) -> Result<Self, VolumeError> {
        let dims = std::array::from_fn(|axis| self.geometry.dims[axis].div_ceil(block[axis]));
        let coarse = self.reduced(voxels, self.geometry.of_blocks(&self.source, block, dims)?, block);
        let Finest { dims, block: sides } = self.finest.unwrap_or(Finest { dims: self.geometry.dims, block: [1; 3] });
        let block = std::array::from_fn(|axis| sides[axis] * block[axis]);
        Ok(Self { finest: Some(Finest { dims, block }), ..coarse })
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
    pub fn coarse_in_file(&self) -> Option<&Arc<Self>> {
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
    pub fn grid_over(&self, of: &Self, block: [usize; 3]) -> Result<Geometry, VolumeError> {
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
    use relume_base::progress::Quiet;
    use std::sync::atomic::{AtomicU64, Ordering};

    #[test]
    fn a_coarse_level_covers_all_voxels_and_its_last_blocks_may_be_incomplete() {
        // Voxel x holds 10·x; the axes have 5, 2 and 1 voxels.
        let voxels = Voxels::U16((0..10).map(|i| 10 * (i % 5)).collect());
        let volume = Volume::new("test", voxels, Geometry::unit("test", [5, 2, 1]).unwrap()).unwrap();
        let coarse = volume.coarse_level([2, 2, 1], &Quiet).unwrap();
        assert_eq!(coarse.geometry.dims, [3, 1, 1]);
        assert_eq!([0, 1, 2].map(|at| coarse.voxels.value(at)), [Some(5.0), Some(25.0), Some(40.0)]);
        assert_eq!((coarse.blocks, volume.block_of(&coarse)), ([2, 2, 1], [2, 2, 1]));
        let there = volume.geometry.world_from_index(DVec3::new(3.0, 1.0, 0.0));
        let same = coarse.geometry.world_from_index(coarse_index(DVec3::new(3.0, 1.0, 0.0), [2, 2, 1]));
        assert!(there.distance(same) < 1e-12, "{there} {same}");
        let back = index_of_coarse(coarse_index(DVec3::new(3.0, 1.0, 0.0), [2, 2, 1]), [2, 2, 1]);
        assert!(back.distance(DVec3::new(3.0, 1.0, 0.0)) < 1e-12, "{back}");
    }

    /// Progress that cancels at its fourth question.
    #[derive(Default)]
    struct Impatient(AtomicU64);

    impl Progress for Impatient {
        fn report(&self, _: &str, _: u64, _: u64) {}

        fn cancelled(&self) -> bool {
            self.0.fetch_add(1, Ordering::Relaxed) >= 3
        }
    }

    #[test]
    fn averaging_is_cancelled_within_a_halving() {
        let geometry = Geometry::unit("test", [2, 40, 2]).unwrap();
        let volume = Volume::new("test", Voxels::U8(vec![0; 160]), geometry).unwrap();
        let failed = volume.coarser_by(1, false, &Impatient::default());
        assert!(matches!(failed, Err(VolumeError::Cancelled { .. })), "{failed:?}");
    }
}
