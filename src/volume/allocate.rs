//! Memory for voxels.

use std::path::Path;

use super::VolumeError;
use super::stream::count;

/// Returns a vector of zeros; the system provides its memory at the first write.
pub(super) fn zeroed<T: bytemuck::Zeroable>(path: &Path, length: usize) -> Result<Vec<T>, VolumeError> {
    bytemuck::try_zeroed_vec(length).map_err(|()| VolumeError::Memory {
        source_name: path.display().to_string(),
        bytes: count(length).saturating_mul(count(size_of::<T>())),
    })
}
