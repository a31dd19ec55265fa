//! Blocks of a volume, which are marched apart and composited: the leaves of a kd-tree.

use super::View;
use crate::number::count;
use crate::volume::Geometry;

/// Largest number of blocks.
pub const MOST_BLOCKS: usize = 4096;

/// One of the blocks into which a volume is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Block {
    /// Its number, from 0.
    pub index: usize,
    /// Number of blocks.
    pub count: usize,
}

/// Leaves below the low side of the topmost cut of a tree of `leaves` leaves. The shape of the tree follows from this.
#[must_use]
pub const fn low_leaves(leaves: usize) -> usize {
    leaves / 2
}

/// Plane between two sides of a tree.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Cut {
    axis: usize,
    /// Voxels on the low side, counted from the face of the volume.
    at: usize,
}

/// The kd-tree of a volume, which the geometry and the number of blocks determine.
///
/// A box is cut across its longest edge, in proportion to the leaves on both sides, between two voxels. Cuts are in
/// preorder: that of a box, those of its low side, those of its high side.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Blocks {
    cuts: Vec<Cut>,
    /// First voxel, and the voxel after the last, of each leaf.
    boxes: Vec<[[usize; 3]; 2]>,
}

impl Blocks {
    /// Cuts a volume into `leaves` blocks. `None` if there are none, more than [`MOST_BLOCKS`], or too few voxels.
    #[must_use]
    pub fn new(geometry: &Geometry, leaves: usize) -> Option<Self> {
        let mut blocks = Self { cuts: Vec::new(), boxes: Vec::new() };
        let is_possible = (1..=MOST_BLOCKS).contains(&leaves);
        (is_possible && blocks.divide(geometry, [[0; 3], geometry.dims], leaves)).then_some(blocks)
    }

    fn divide(&mut self, geometry: &Geometry, [low, high]: [[usize; 3]; 2], leaves: usize) -> bool {
        if leaves == 1 {
            self.boxes.push([low, high]);
            return true;
        }
        let length = |axis: usize| count(high[axis] - low[axis]) * geometry.spacing[axis];
        let mut axis = None;
        for other in (0..3).filter(|&other| high[other] - low[other] > 1) {
            axis = Some(axis.filter(|&best| length(best) >= length(other)).unwrap_or(other));
        }
        let Some(axis) = axis else { return false };
        let (voxels, before) = (high[axis] - low[axis], low_leaves(leaves));
        let at = low[axis] + (voxels * before / leaves).clamp(1, voxels - 1);
        self.cuts.push(Cut { axis, at });
        let (mut middle_high, mut middle_low) = (high, low);
        (middle_high[axis], middle_low[axis]) = (at, at);
        self.divide(geometry, [low, middle_high], before) && self.divide(geometry, [middle_low, high], leaves - before)
    }

    /// First voxel of block `index`, and the voxel after its last.
    #[must_use]
    pub fn voxels(&self, index: usize) -> Option<[[usize; 3]; 2]> {
        self.boxes.get(index).copied()
    }

    /// Side in front of each cut, true for the low side: along every ray of `view`, all its samples precede those of the
    /// other side. The eye lies on the side in front; parallel rays come from it.
    #[must_use]
    pub fn low_first(&self, geometry: &Geometry, view: &View) -> Vec<bool> {
        let local_from_world = geometry.direction.inverse();
        let forward = local_from_world * view.forward;
        let eye = local_from_world * (view.eye - geometry.origin) / geometry.spacing + 0.5;
        let is_low = |cut: &Cut| if view.parallel { forward[cut.axis] >= 0.0 } else { eye[cut.axis] < count(cut.at) };
        self.cuts.iter().map(is_low).collect()
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::Blocks;
    use crate::volume::Geometry;

    #[test]
    fn blocks_own_every_voxel_once() {
        let one = glam::DVec3::ONE;
        let geometry = Geometry::new("", [7, 5, 3], one, glam::DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
        for leaves in 1..=105 {
            let blocks = Blocks::new(&geometry, leaves);
            let Some(blocks) = blocks else {
                assert!(leaves > 8, "{leaves} blocks of 105 voxels");
                continue;
            };
            let mut owners = vec![0; 105];
            for index in 0..leaves {
                let [low, high] = blocks.voxels(index).unwrap();
                for (z, y, x) in (low[2]..high[2])
                    .flat_map(|z| (low[1]..high[1]).flat_map(move |y| (low[0]..high[0]).map(move |x| (z, y, x))))
                {
                    owners[(z * 5 + y) * 7 + x] += 1;
                }
            }
            assert!(owners.iter().all(|&n| n == 1), "{leaves}: {owners:?}");
            assert_eq!(blocks.cuts.len(), leaves - 1);
        }
        assert_eq!(Blocks::new(&geometry, 106), None, "more blocks than voxels");
        assert_eq!(Blocks::new(&geometry, 0), None);
    }
}
