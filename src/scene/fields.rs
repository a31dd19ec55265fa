//! The fields of a scene: values at each place of its frame.

use std::sync::Arc;

use relume_volume::{BrickCache, CacheCounts, Volume};

/// A field: the values of a volume, wherever its voxels reside.
#[derive(Clone, Debug)]
pub struct Field {
    /// Voxel values and their grid.
    pub volume: Arc<Volume>,
}

impl Field {
    /// The file of bricks with the voxels, unless these are in memory.
    #[must_use]
    pub fn bricks(&self) -> Option<&BrickCache> {
        self.volume.bricks.as_deref()
    }

    /// Bricks that were read of the file so far, if the voxels stay in one.
    #[must_use]
    pub fn reads(&self) -> Option<CacheCounts> {
        self.bricks().map(BrickCache::counts)
    }

    /// The voxels in memory, and how many of the field's each stands for along each axis: all voxels, or the coarse level of
    /// those that stay in a file. These have none before [`Volume::prepare_coarse`].
    #[must_use]
    pub fn at_hand(&self) -> (&Volume, [usize; 3]) {
        let at_hand = self.volume.at_hand();
        (at_hand, self.volume.block_of(at_hand))
    }

    /// True if both have the same voxels, so that results from one serve the other.
    #[must_use]
    pub fn is(&self, other: &Self) -> bool {
        // Complete on purpose: a new part does not compile until somebody decides.
        let Self { volume } = self;
        Arc::ptr_eq(volume, &other.volume)
    }
}

/// All fields of a scene. A march takes one.
#[derive(Clone, Debug)]
pub struct Fields([Field; 1]);

impl Fields {
    /// The field of `volume` alone.
    #[must_use]
    pub const fn of(volume: Arc<Volume>) -> Self {
        Self([Field { volume }])
    }

    /// The field whose volume gives the scene its frame.
    #[must_use]
    pub const fn first(&self) -> &Field {
        let [first] = &self.0;
        first
    }

    /// All of them in their order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Field> {
        self.0.iter()
    }

    /// True if both have the same voxels in the same order.
    #[must_use]
    pub fn are(&self, other: &Self) -> bool {
        self.0.len() == other.0.len() && self.iter().zip(other.iter()).all(|(ours, theirs)| ours.is(theirs))
    }
}
