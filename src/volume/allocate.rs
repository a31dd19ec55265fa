//! Memory for voxels.

use std::path::Path;

use super::VolumeError;
use crate::stream::count;
use relume_base::memory::prefer_large_pages;

/// Returns a vector of zeros; the system provides its memory at the first write.
pub(super) fn zeroed<T: bytemuck::Zeroable>(path: &Path, length: usize) -> Result<Vec<T>, VolumeError> {
    let mut zeros = bytemuck::try_zeroed_vec(length).map_err(|()| short::<T>(path, length))?;
    prefer_large_pages(&mut zeros);
    Ok(zeros)
}

/// Reserves room for `more` behind the `voxels`. The capacity doubles as voxels arrive, up to that of `all` voxels.
pub(super) fn reserve<T>(voxels: &mut Vec<T>, more: usize, all: usize, path: &Path) -> Result<(), VolumeError> {
    let there = voxels.len();
    if voxels.capacity() - there < more {
        let room = more.max(there).min(all - there);
        voxels.try_reserve_exact(room).map_err(|_| short::<T>(path, there + room))?;
    }
    Ok(())
}

/// The error for `length` voxels that have no room.
fn short<T>(path: &Path, length: usize) -> VolumeError {
    VolumeError::Memory {
        source_name: path.display().to_string(),
        bytes: count(length).saturating_mul(count(size_of::<T>())),
    }
}
