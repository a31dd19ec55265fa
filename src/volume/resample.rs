//! Downsampling.

use glam::DVec3;
use rayon::prelude::*;

use super::{Geometry, Volume, VolumeError, Voxel, Voxels, with_voxels};

impl Volume {
    /// Averages blocks of `block` voxels; the mean is rounded to the stored type (integers half up: ⌊x + ½⌋).
    ///
    /// Incomplete blocks at the end of an axis are dropped, with a note. A new voxel lies at the centre of its block;
    /// the new spacing is the size of a block. NaN is excluded from a mean unless the whole block is NaN.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Block`] if a side of the block is 0 or longer than the volume.
    pub fn downsample(&self, block: [usize; 3]) -> Result<Self, VolumeError> {
        let geometry = self.coarser(block)?;
        let voxels = with_voxels!(&self.voxels, stored => {
            reduce(stored, self.geometry.dims, &geometry, block, |values| Voxel::mean(values.iter().copied()))
        });
        Ok(self.resampled(voxels, geometry, block))
    }

    /// Reduces every block to its most frequent voxel, the smallest one among ties, because labels have no mean.
    /// Otherwise as [`Self::downsample`].
    ///
    /// # Errors
    ///
    /// [`VolumeError::Block`] if a side of the block is 0 or longer than the volume.
    pub fn downsample_labels(&self, block: [usize; 3]) -> Result<Self, VolumeError> {
        let geometry = self.coarser(block)?;
        let voxels = with_voxels!(&self.voxels, stored => {
            reduce(stored, self.geometry.dims, &geometry, block, most_frequent)
        });
        Ok(self.resampled(voxels, geometry, block))
    }

    fn coarser(&self, block: [usize; 3]) -> Result<Geometry, VolumeError> {
        let Geometry { dims, spacing, direction, .. } = self.geometry;
        if (0..3).any(|axis| block[axis] == 0 || block[axis] > dims[axis]) {
            return Err(VolumeError::Block { source_name: self.source.clone(), block, dims });
        }
        #[expect(clippy::cast_precision_loss, reason = "no block is 2⁵³ voxels long")]
        let sides = DVec3::from_array(block.map(|n| n as f64));
        let origin = self.geometry.world_from_index((sides - 1.0) / 2.0);
        let dims = std::array::from_fn(|axis| dims[axis] / block[axis]);
        Geometry::new(&self.source, dims, spacing * sides, origin, direction)
    }

    fn resampled(&self, voxels: Voxels, geometry: Geometry, block: [usize; 3]) -> Self {
        let mut notes = self.notes.clone();
        let dims = self.geometry.dims;
        let dropped: [usize; 3] = std::array::from_fn(|axis| dims[axis] % block[axis]);
        if dropped != [0; 3] {
            let [x, y, z] = dropped;
            notes.push(format!(
                "{}: {x}, {y}, {z} voxels at the ends of x, y, z do not fill a block and are dropped",
                self.source
            ));
        }
        let Self { source, files, metadata, .. } = self;
        let (source, files, metadata) = (source.clone(), files.clone(), metadata.clone());
        let blocks = std::array::from_fn(|axis| self.blocks[axis] * block[axis]);
        Self { voxels, geometry, selection: self.selection.clone(), blocks, source, files, metadata, notes, ..*self }
    }
}

/// Reduces each block to one voxel; `choose` may reorder the voxels of the block.
fn reduce<T: Voxel>(
    stored: &[T],
    [nx, ny, _]: [usize; 3],
    coarse: &Geometry,
    [bx, by, bz]: [usize; 3],
    choose: impl Fn(&mut [T]) -> Option<T> + Sync,
) -> Voxels {
    let [width, height, _] = coarse.dims;
    // Offsets from the first voxel of a block to each of its voxels.
    let offsets: Vec<usize> =
        (0..bx * by * bz).map(|i| i % bx + nx * (i / bx % by) + nx * ny * (i / (bx * by))).collect();
    let mut voxels = vec![T::zeroed(); coarse.voxels()];
    voxels.par_chunks_mut(width).enumerate().for_each_init(
        || vec![T::zeroed(); offsets.len()],
        |values, (row, out)| {
            let start = nx * (row % height * by + ny * (row / height * bz));
            for (block, voxel) in out.iter_mut().enumerate() {
                let block = &stored[start + bx * block..];
                values.iter_mut().zip(&offsets).for_each(|(value, &offset)| *value = block[offset]);
                // A block has at least one voxel.
                *voxel = choose(values).unwrap_or(T::zeroed());
            }
        },
    );
    T::into_voxels(voxels)
}

/// The most frequent value, the smallest one among ties.
fn most_frequent<T: Voxel>(values: &mut [T]) -> Option<T> {
    // Labels are numbers; NaN is not a valid label, so its order does not matter.
    values.sort_unstable_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
    let runs = values.chunk_by(|a, b| a == b);
    // `max_by_key` returns the last of equal maxima; in reverse order, this is the smallest value.
    runs.rev().max_by_key(|run| run.len()).map(|run| run[0])
}
