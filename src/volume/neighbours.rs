//! Values of neighbouring voxels spread over a volume.

use std::borrow::Cow;

use super::{BRICK, Volume};
use relume_base::number::{count, whole};
use relume_base::progress::{Progress, Quiet};

/// Pairs of neighbouring voxels that are looked at.
const PAIRS: usize = 1024;

impl Volume {
    /// Values of voxels spread over the volume, each with that of the next one along axis 0, 1, 2, 0, …; `None` where there is
    /// none. Those of a file of bricks are read once and kept.
    pub fn neighbours(&self) -> Cow<'_, [Option<[f64; 2]>]> {
        match &self.bricks {
            Some(cache) => Cow::Borrowed(cache.neighbours(|| self.read_neighbours(&Quiet).unwrap_or_default())),
            None => Cow::Owned(self.read_neighbours(&Quiet).unwrap_or_default()),
        }
    }

    /// Reads the [`Self::neighbours`] of a file of bricks, and keeps them unless `progress` cancels the reading.
    pub fn read_neighbours_ahead(&self, progress: &dyn Progress) {
        if let Some(cache) = self.bricks.as_ref().filter(|cache| !cache.has_neighbours())
            && let Some(values) = self.read_neighbours(progress)
        {
            cache.neighbours(|| values);
        }
    }

    /// The [`Self::neighbours`]; `None` if `progress` cancels the reading.
    fn read_neighbours(&self, progress: &dyn Progress) -> Option<Vec<Option<[f64; 2]>>> {
        let dims = self.geometry.dims;
        let spread = (0..PAIRS).map(|i| {
            // Additive recurrence with the powers of the inverse of the root of x⁴ = x + 1 (Roberts 2018).
            let place = |power: i32| (count(i) * 0.819_172_513_396_164_4_f64.powi(power)).fract();
            let places = [place(1), place(2), place(3)];
            std::array::from_fn(|axis| whole(places[axis] * count(dims[axis])))
        });
        let read = |axis: usize, voxel: [usize; 3]| {
            let mut next = voxel;
            next[axis] += 1;
            // A damaged brick is an error of the march.
            Some([self.read_value(voxel).ok()??, self.read_value(next).ok()??])
        };
        // In the order of the bricks of a file, so that each is read once.
        let mut voxels: Vec<(usize, [usize; 3])> = spread.enumerate().collect();
        if self.bricks.is_some() {
            voxels.sort_by_key(|(_, voxel)| [2, 1, 0].map(|axis| voxel[axis] / BRICK as usize));
        }
        let mut values = vec![None; PAIRS];
        for (i, voxel) in voxels {
            if progress.cancelled() {
                return None;
            }
            values[i] = read(i % 3, voxel);
        }
        Some(values)
    }
}
