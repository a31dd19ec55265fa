//! Bricks of a volume: which voxels a slot holds, which can be visible, and in which order rays meet them
//! (docs/theory/bricks.md).

use glam::DVec3;

use super::{CELL, Occupancy, RayTable};
use crate::plan::{Integrate, ScenePlan};
use crate::{Gradients, Scene};
use relume_base::number::{count, unsigned, whole};

pub use relume_volume::BRICK;

/// Levels of an octree of bricks whose places have 63 bits in all.
const LEVELS: usize = 21;

/// Texels along an edge of a slot: a brick and its apron. Brick b owns the macrocells from 8b on, so the voxel indices
/// [64b, 64b + 64], and linear interpolation at the upper end and a rounding beyond it reads two voxels behind the last.
#[must_use]
pub fn slot_edge(apron: u32) -> u32 {
    BRICK + 2 * apron + 1
}

/// Largest distance in voxels between the middle of a step and what the step depends on: its ends if it is a segment, the samples beside it
/// if it is refined.
#[must_use]
pub fn reach_in_voxels(scene: &Scene, plan: &ScenePlan) -> f64 {
    let steps = match plan.integration {
        Integrate::Samples => 0.0,
        Integrate::Segments => 0.5,
        Integrate::Refined => 1.0,
    };
    steps * scene.step_length() / scene.frame.geometry.spacing.min_element()
}

/// Voxels in front of a brick that its samples read under `plan`; behind it there is one more.
#[must_use]
pub fn apron(scene: &Scene, plan: &ScenePlan) -> u32 {
    let cubic = u32::from(plan.interpolation.is_cubic());
    let differences = u32::from(plan.gradient() && plan.gradients == Gradients::Central);
    let reach = match plan.integration {
        Integrate::Samples => 1,
        // A little more for rounding.
        Integrate::Segments | Integrate::Refined => {
            unsigned(whole((reach_in_voxels(scene, plan) + 0.01).ceil())).max(1)
        }
    };
    reach + cubic + differences
}

/// The bricks of a volume, numbered with x fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickGrid {
    /// Bricks along each axis.
    pub counts: [usize; 3],
}

impl BrickGrid {
    /// The bricks of a volume with `cells` macrocells along each axis.
    #[must_use]
    pub fn new(cells: [usize; 3]) -> Self {
        Self { counts: cells.map(|cells| cells.div_ceil(BRICK as usize / CELL).max(1)) }
    }

    /// Number of bricks.
    #[must_use]
    pub fn bricks(&self) -> usize {
        self.counts.iter().product()
    }

    /// Place of `brick` among the bricks along each axis.
    #[must_use]
    pub fn place(&self, brick: usize) -> [usize; 3] {
        let [width, height, _] = self.counts;
        [brick % width, brick / width % height, brick / (width * height)]
    }

    /// The bricks with an occupied macrocell, in the order of their numbers.
    #[must_use]
    pub fn occupied(&self, occupancy: &Occupancy) -> Vec<usize> {
        let mut occupied = vec![false; self.bricks()];
        let [width, height, _] = occupancy.dims;
        let edge = BRICK as usize / CELL;
        for (i, &word) in occupancy.words.iter().enumerate() {
            let mut bits = word;
            while bits != 0 {
                let cell = 32 * i + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let [x, y, z] = [cell % width, cell / width % height, cell / (width * height)].map(|at| at / edge);
                occupied[x + self.counts[0] * (y + self.counts[1] * z)] = true;
            }
        }
        occupied.iter().enumerate().filter(|(_, occupied)| **occupied).map(|(brick, _)| brick).collect()
    }

    /// True if `brick` lies at least partly in the block of `rays`, or they have none.
    #[must_use]
    pub fn is_of_block(&self, brick: usize, rays: &RayTable) -> bool {
        let Some(block) = rays.block else { return true };
        let edge = count(BRICK as usize / CELL);
        let [low, high] = [block.low, block.high].map(|face| (face * rays.cell_scale + rays.cell_offset) / edge);
        let place = DVec3::from_array(self.place(brick).map(count));
        // Rounding may put a sample in a face into the next brick, which rays then ask for.
        low.cmplt(place + 1.0).all() && high.cmpgt(place).all()
    }

    /// For each brick a number that only grows along any of `rays`: its place in an octree that is traversed from the brick of
    /// the eye, or from the nearest one to it; for parallel rays, from the corner that they come from.
    #[must_use]
    pub fn ranks(&self, rays: &RayTable) -> Vec<i64> {
        let parallel = rays.direction_u == DVec3::ZERO && rays.direction_v == DVec3::ZERO;
        let eye = rays.base - rays.eye_distance * rays.direction;
        let cells = (eye * rays.cell_scale + rays.cell_offset).to_array();
        let first = |axis: usize| -> usize {
            let last = self.counts[axis] - 1;
            match (parallel, rays.direction[axis] < 0.0) {
                (false, _) => {
                    let brick = cells[axis] / count(BRICK as usize / CELL);
                    whole(brick.floor().max(0.0)).min(last)
                }
                (true, true) => last,
                (true, false) => 0,
            }
        };
        // Of the two halves of a block along an axis, the one of `first`, or next to it, comes first.
        let of_place = |axis: usize, at: usize| -> i64 {
            let far = |level: usize| {
                let [half, first] = [at, first(axis)].map(|place| place >> level);
                (half % 2 == 1) != (first >= (half | 1))
            };
            (0..LEVELS).map(|level| i64::from(far(level)) << (3 * level + axis)).sum()
        };
        let of_axes = [0, 1, 2].map(|axis| (0..self.counts[axis]).map(|at| of_place(axis, at)).collect::<Vec<_>>());
        (0..self.bricks())
            .map(|brick| self.place(brick).into_iter().zip(&of_axes).map(|(at, of_axis)| of_axis[at]).sum())
            .collect()
    }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use crate::{Aim, Projection};
    use relume_volume::{Geometry, Volume, Voxels};
    use std::sync::Arc;

    #[test]
    fn a_brick_is_occupied_if_one_of_its_macrocells_is() {
        let grid = BrickGrid::new([17, 8, 9]);
        assert_eq!(grid.counts, [3, 1, 2]);
        let occupied = |cells: &[[usize; 3]]| {
            let mut words = vec![0; (17 * 8 * 9_usize).div_ceil(32)];
            for [x, y, z] in cells {
                let cell = x + 17 * (y + 8 * z);
                words[cell / 32] |= 1 << (cell % 32);
            }
            grid.occupied(&Occupancy { dims: [17, 8, 9], words, occupied: cells.len() })
        };
        assert_eq!(occupied(&[]), [0_usize; 0]);
        assert_eq!(occupied(&[[16, 7, 8], [7, 0, 0], [8, 7, 7], [0, 0, 0]]), [0, 1, 5]);
    }

    /// Rays through a volume of `counts` bricks.
    fn rays(counts: [usize; 3], position: DVec3, target: DVec3, projection: Projection) -> RayTable {
        let dims = counts.map(|n| n * BRICK as usize);
        let geometry = Geometry::unit("test", dims).unwrap();
        let voxels = Voxels::U8(vec![0; dims.iter().product()]);
        let mut scene = Scene::new("test", Arc::new(Volume::new("test", voxels, geometry).unwrap()));
        (scene.camera.aim, scene.camera.projection) = (Aim::LookAt { position, target }, projection);
        RayTable::new(&scene, &scene.camera.view(&geometry, 1.0).unwrap()).unwrap()
    }

    #[test]
    fn ranks_grow_along_rays_and_bricks_of_a_block_follow_each_other() {
        let counts = [5, 4, 3];
        let grid = BrickGrid { counts };
        let centre = DVec3::new(160.0, 128.0, 96.0);
        let perspective = Projection::Perspective { fov_degrees: 30.0 };
        let parallel = Projection::Orthographic { height: Some(300.0) };
        let outside = DVec3::new(-200.0, 500.0, 90.0);
        let number = |[x, y, z]: [usize; 3]| x + 5 * (y + 4 * z);
        for (eye, projection, first) in [
            (outside, perspective, [0, 3, 1]),
            (DVec3::new(200.0, 70.0, 150.0), perspective, [3, 1, 2]),
            (outside, parallel, [0, 3, 0]),
        ] {
            let ranks = grid.ranks(&rays(counts, eye, centre, projection));
            let sorted: std::collections::BTreeSet<i64> = ranks.iter().copied().collect();
            assert_eq!(sorted.len(), 60, "each brick has a rank of its own");
            assert_eq!(sorted.first(), Some(&ranks[number(first)]), "{first:?}");
            for brick in 0..60 {
                let place = grid.place(brick);
                for axis in 0..3 {
                    let away = if place[axis] >= first[axis] { [1, 0] } else { [0, 1] };
                    let next = (place[axis] + away[0]).checked_sub(away[1]).filter(|&at| at < counts[axis]);
                    let Some(next) = next else { continue };
                    let mut farther = place;
                    farther[axis] = next;
                    assert!(ranks[brick] < ranks[number(farther)], "{place:?} {farther:?} from {first:?}");
                }
            }
            // The eight bricks of a block differ in the last three bits.
            let block = |place: [usize; 3]| ranks[number(place)] >> 3;
            assert_eq!(block([0, 0, 0]), block([1, 1, 1]));
            assert_eq!(block([2, 2, 0]), block([3, 3, 1]));
        }
    }
}
