//! Histogram of values and gradient magnitudes.

use super::Volume;
use relume_base::number::{count, whole};

/// Bins of a [`JointHistogram`]: of values, and of magnitudes.
pub const JOINT_BINS: [usize; 2] = [128, 64];

/// Voxels that are counted at most.
const MOST_VOXELS: usize = 1 << 19;
/// Part of the counted voxels whose magnitudes lie on the axis.
const ON_AXIS: f64 = 0.999;

/// Counts of voxels by value and gradient magnitude.
#[derive(Clone, Debug, PartialEq)]
pub struct JointHistogram {
    /// Magnitude at the end of the axis, in data units per world unit. The last bin has the larger ones too.
    pub steepest: f64,
    /// Counts by value, in bins from the smallest to the largest finite value, for each bin of magnitudes from 0 to [`Self::steepest`].
    pub counts: Vec<u32>,
}

impl JointHistogram {
    /// Magnitude below which this `part` of the voxels lies, to the end of its bin.
    #[must_use]
    pub fn magnitude(&self, part: f64) -> f64 {
        let rows = self.counts.chunks(JOINT_BINS[0]);
        let rows: Vec<f64> = rows.map(|row| row.iter().copied().map(f64::from).sum()).collect();
        let wanted = part * rows.iter().sum::<f64>();
        let mut below = 0.0;
        let row = rows.iter().position(|voxels| {
            below += voxels;
            below >= wanted
        });
        self.steepest * count(row.map_or(rows.len(), |row| row + 1)) / count(rows.len().max(1))
    }
}

impl Volume {
    /// Counts the voxels by value, from `low` to `high`, and gradient magnitude: the length of the differences between neighbours, central,
    /// one-sided at faces, per world unit. Of many voxels it counts every n-th, up to half a million. `None` if no voxel of finite value
    /// and magnitude is in memory.
    #[must_use]
    pub fn joint_histogram(&self, [low, high]: [f64; 2]) -> Option<JointHistogram> {
        let dims = self.geometry.dims;
        let voxels = dims.iter().product::<usize>();
        // An odd step meets every column of a grid of even width.
        let step = voxels.div_ceil(MOST_VOXELS) | 1;
        let value = |place: usize| self.voxels.value(place).map(|stored| stored.mul_add(self.slope, self.intercept));
        let strides = [1, dims[0], dims[0] * dims[1]];
        let of_voxel = |place: usize| {
            let mut square = 0.0;
            for axis in 0..3 {
                let at = place / strides[axis] % dims[axis];
                let before = if at > 0 { place - strides[axis] } else { place };
                let after = if at + 1 < dims[axis] { place + strides[axis] } else { place };
                if after > before {
                    let length = count((after - before) / strides[axis]) * self.geometry.spacing[axis];
                    square += ((value(after)? - value(before)?) / length).powi(2);
                }
            }
            let found = [value(place)?, square.sqrt()];
            found.iter().all(|number| number.is_finite()).then_some(found)
        };
        let found: Vec<[f64; 2]> = (0..voxels).step_by(step).filter_map(of_voxel).collect();
        let mut magnitudes: Vec<f64> = found.iter().map(|found| found[1]).collect();
        let last = whole(ON_AXIS * count(magnitudes.len().checked_sub(1)?));
        let (_, &mut steepest, _) = magnitudes.select_nth_unstable_by(last, f64::total_cmp);
        let steepest = if steepest > 0.0 { steepest } else { 1.0 };
        let mut counts = vec![0; JOINT_BINS[0] * JOINT_BINS[1]];
        let bin = |part: f64, bins: usize| whole((part * count(bins)).max(0.0)).min(bins - 1);
        for [value, magnitude] in found {
            let part = if high > low { (value - low) / (high - low) } else { 0.0 };
            counts[bin(part, JOINT_BINS[0]) + JOINT_BINS[0] * bin(magnitude / steepest, JOINT_BINS[1])] += 1;
        }
        Some(JointHistogram { steepest, counts })
    }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use crate::{Geometry, Voxels};
    use glam::{DMat3, DVec3};

    fn volume(dims: [usize; 3], voxels: Vec<f32>) -> Volume {
        let geometry = Geometry::new("test", dims, DVec3::new(2.0, 1.0, 1.0), DVec3::ZERO, DMat3::IDENTITY).unwrap();
        Volume::new("test", Voxels::F32(voxels), geometry).unwrap()
    }

    #[test]
    fn a_ramp_has_one_magnitude_and_all_values() {
        // Rises by 3 from voxel to voxel along x, at a spacing of 2.
        let joint = volume([16, 4, 4], (0..=255_u8).map(|place| f32::from(place % 16) * 3.0).collect());
        let joint = joint.joint_histogram([0.0, 45.0]).unwrap();
        assert!((joint.steepest - 1.5).abs() < 1e-12, "{}", joint.steepest);
        let [values, magnitudes] = JOINT_BINS;
        let last = &joint.counts[values * (magnitudes - 1)..];
        assert_eq!(last.iter().sum::<u32>(), 256, "all in the row of the largest magnitude");
        assert_eq!(last.iter().filter(|&&count| count == 16).count(), 16, "sixteen values");
        assert!((joint.magnitude(0.5) - 1.5).abs() < 1e-12, "{}", joint.magnitude(0.5));
    }

    #[test]
    fn what_is_no_number_is_left_out_and_nothing_is_none() {
        let mut voxels = vec![5.0; 27];
        voxels[13] = f32::NAN;
        let joint = volume([3, 3, 3], voxels).joint_histogram([5.0, 5.0]).unwrap();
        // The six voxels beside the one in the middle have no gradient either.
        assert_eq!((joint.counts[0], joint.counts.iter().sum::<u32>()), (20, 20));
        assert_eq!(volume([1, 1, 1], vec![f32::NAN]).joint_histogram([0.0, 1.0]), None);
    }
}
