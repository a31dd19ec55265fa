//! Blocks of a volume, which are marched apart and composited: the leaves of a kd-tree.

use std::ops::Range;

use glam::DVec3;

use super::View;
use relume_base::number::{count, whole};
use relume_volume::Geometry;

/// Largest number of blocks.
pub const MOST_BLOCKS: usize = 4096;

/// Smallest number of blocks by default: that of a cube cut once along each axis.
const LEAST_BLOCKS: usize = 8;

/// Largest number of voxels of a block by default.
const VOXELS_OF_A_BLOCK: usize = 1 << 24;

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

/// A node of the tree of blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Node {
    /// Its first and last leaf, from 1.
    pub leaves: [usize; 2],
    /// Number of its cut in preorder, if it has one.
    pub cut: usize,
}

impl Node {
    /// The top of the tree of `blocks` leaves.
    #[must_use]
    pub const fn top(blocks: usize) -> Self {
        Self { leaves: [1, blocks], cut: 0 }
    }

    /// The low and the high side; `None` of a leaf.
    #[must_use]
    pub const fn sides(self) -> Option<[Self; 2]> {
        let [first, last] = self.leaves;
        if first >= last {
            return None;
        }
        let low = low_leaves(last + 1 - first);
        Some([
            Self { leaves: [first, first + low - 1], cut: self.cut + 1 },
            Self { leaves: [first + low, last], cut: self.cut + low },
        ])
    }

    /// True if it has the leaves from `first` to `last`.
    #[must_use]
    pub const fn holds(self, [first, last]: [usize; 2]) -> bool {
        self.leaves[0] <= first && last <= self.leaves[1]
    }

    /// The smallest node of the tree of `blocks` leaves that holds these.
    #[must_use]
    pub fn smallest(blocks: usize, leaves: [usize; 2]) -> Self {
        let mut node = Self::top(blocks);
        while let Some(side) = node.sides().and_then(|sides| sides.into_iter().find(|side| side.holds(leaves))) {
            node = side;
        }
        node
    }

    /// The largest nodes below it, itself included, whose leaves are all from `first` to `last`, in the order of the leaves.
    #[must_use]
    pub fn largest_within(self, leaves: [usize; 2]) -> Vec<Self> {
        let is_within = leaves[0] <= self.leaves[0] && self.leaves[1] <= leaves[1];
        match self.sides() {
            _ if is_within => vec![self],
            Some(sides) => sides.into_iter().flat_map(|side| side.largest_within(leaves)).collect(),
            None => Vec::new(),
        }
    }

    /// The leaves from front to back, from 0; `low_first` has the side in front of each cut.
    #[must_use]
    pub fn front_to_back(self, low_first: &[bool]) -> Vec<usize> {
        match self.sides() {
            None => vec![self.leaves[0] - 1],
            Some([low, high]) => {
                let is_low_first = low_first.get(self.cut).copied().unwrap_or(true);
                let sides = if is_low_first { [low, high] } else { [high, low] };
                sides.into_iter().flat_map(|side| side.front_to_back(low_first)).collect()
            }
        }
    }
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

    /// The number of blocks that a volume has if nobody states one: a power of two from 8 on, with at most 256³ voxels in a
    /// block as long as there are at most [`MOST_BLOCKS`]. Fewer, if its axes have too few voxels to cut.
    #[must_use]
    pub fn usual(geometry: &Geometry) -> usize {
        let voxels = geometry.dims.iter().fold(1_usize, |product, &n| product.saturating_mul(n));
        let least = voxels.div_ceil(VOXELS_OF_A_BLOCK).min(MOST_BLOCKS).next_power_of_two().max(LEAST_BLOCKS);
        let halves = std::iter::successors(Some(least), |&blocks| (blocks > 1).then_some(blocks / 2));
        halves.into_iter().find(|&blocks| Self::new(geometry, blocks).is_some()).unwrap_or(1)
    }

    /// Rows of a picture with `height` rows that block `index` may cover: its projection and a row on both sides, or all
    /// rows if it reaches behind the eye.
    #[must_use]
    pub fn rows(&self, index: usize, geometry: &Geometry, view: &View, height: usize) -> Range<usize> {
        let Some([low, high]) = self.voxels(index) else { return 0..0 };
        let mut bounds = [f64::INFINITY, f64::NEG_INFINITY];
        for corner in 0..8_usize {
            let voxel = std::array::from_fn(|axis| count(if corner >> axis & 1 == 1 { high[axis] } else { low[axis] }));
            let place = geometry.spacing * (DVec3::from_array(voxel) - 0.5);
            let seen = view.seen(geometry.origin + geometry.direction * place);
            if !view.parallel && seen.z <= 1e-6 * geometry.spacing.min_element() {
                return 0..height;
            }
            let up = if view.parallel { seen.y } else { seen.y / seen.z };
            let row = (1.0 - up) / 2.0 * count(height);
            bounds = [bounds[0].min(row), bounds[1].max(row)];
        }
        let first = whole((bounds[0] - 1.0).floor()).min(height);
        first..whole((bounds[1] + 1.0).ceil()).clamp(first, height)
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
    use super::{Blocks, Node};
    use relume_volume::Geometry;

    #[test]
    fn nodes_number_their_cuts_in_preorder() {
        let mut next = 0;
        fn walk(node: Node, next: &mut usize) {
            if let Some(sides) = node.sides() {
                assert_eq!(node.cut, *next);
                *next += 1;
                sides.into_iter().for_each(|side| walk(side, next));
            }
        }
        walk(Node::top(11), &mut next);
        assert_eq!(next, 10);
        assert_eq!(Node::smallest(8, [3, 4]).leaves, [3, 4]);
        assert_eq!(Node::smallest(8, [2, 3]).leaves, [1, 4]);
        assert_eq!(Node::smallest(8, [4, 5]).leaves, [1, 8]);
        let leaves = |first, last| -> Vec<[usize; 2]> {
            Node::top(8).largest_within([first, last]).into_iter().map(|node| node.leaves).collect()
        };
        assert_eq!(leaves(1, 8), [[1, 8]]);
        assert_eq!(leaves(2, 7), [[2, 2], [3, 4], [5, 6], [7, 7]]);
        let low_first = [false, true, true, false, true, true, true];
        assert_eq!(Node::top(8).front_to_back(&low_first), [4, 5, 6, 7, 0, 1, 3, 2]);
    }

    #[test]
    fn the_usual_number_of_blocks_follows_from_the_voxels() {
        let one = glam::DVec3::ONE;
        for (dims, blocks) in [
            ([1, 1, 1], 1),
            ([3, 1, 1], 2),
            ([3, 3, 1], 4),
            ([7, 5, 3], 8),
            ([512, 512, 512], 8),
            ([1024, 1024, 1025], 128),
        ] {
            let geometry = Geometry::new("", dims, one, glam::DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
            assert_eq!(Blocks::usual(&geometry), blocks, "{dims:?}");
            assert!(Blocks::new(&geometry, blocks).is_some(), "{dims:?}");
        }
    }

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
