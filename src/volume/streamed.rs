//! Volumes whose files are read slab by slab.

use super::data::Data;
use super::stream::count;
use crate::{Volume, VolumeError, VoxelType, Voxels};
use relume_base::progress::Progress;

/// Makes the volume of its voxels and the notes of reading them. Without voxels, it makes a volume whose voxels lie
/// elsewhere.
type Finish = Box<dyn FnOnce(Voxels, Vec<String>) -> Result<Volume, VolumeError>>;

/// A volume whose header has been read, and whose voxels are read slab by slab.
pub(crate) struct Streamed {
    /// The voxels.
    pub(crate) data: Data,
    /// Whether the numbers, which have the type `uint16` here, are floats of 16 bits; the voxels are those of 32.
    pub(crate) halves: bool,
    /// Voxels along each axis, or the reason why they are not those of the file.
    pub(crate) dims: Result<[usize; 3], &'static str>,
    /// Notes of the header.
    pub(crate) notes: Vec<String>,
    /// Makes the volume.
    pub(crate) finish: Finish,
}

impl Streamed {
    /// Type of the voxels.
    pub(crate) fn voxel_type(&self) -> VoxelType {
        if self.halves { VoxelType::F32 } else { self.data.voxel_type }
    }

    /// Reads all voxels into memory, of which they may take what `selection` allows.
    pub(crate) fn read(
        mut self,
        source: &str,
        selection: &crate::Selection,
        progress: &dyn Progress,
    ) -> Result<Volume, VolumeError> {
        // A header that promises more than its files hold is wrong, whatever the memory.
        self.data.check_lengths()?;
        let bytes = count(self.data.voxels()).saturating_mul(count(self.voxel_type().bytes()));
        selection.memory.check(source, bytes)?;
        let notes = &mut self.notes;
        let voxels =
            if self.halves { self.data.read_halves(progress, notes)? } else { self.data.read(progress, notes)? };
        (self.finish)(voxels, self.notes)
    }
}
