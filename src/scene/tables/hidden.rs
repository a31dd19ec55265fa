//! Voxels of which nothing is seen, and what is in their place.

use std::ops::Range;

use glam::DVec3;

use super::{NumberStorage, PlacedField, TransferTable};
use crate::plan::{Integrate, Planned, ScenePlan};
use crate::{Interpolation, Scene};
use relume_base::number::{count, whole};
use relume_base::parallel;

/// Distance in voxels from what is visible within which voxels stay as they are: differences at visible voxels read the next ones.
const MARGIN: usize = 2;
/// The same for cubic splines, which read two voxels more.
const MARGIN_OF_SPLINES: usize = 4;

/// Voxels of a field on a grid of its own that a march of `scene` may read.
pub fn read_of_placed(scene: &Scene, placed: &PlacedField) -> impl Fn([usize; 3]) -> bool {
    let [low, high] = scene.crop.unwrap_or_else(|| scene.frame.whole_box());
    // An axis of one voxel is one voxel thick.
    let thick = DVec3::select(scene.frame.thin_axes().into(), DVec3::splat(0.5), DVec3::ZERO);
    placed.near([low - thick, high + thick], count(MARGIN_OF_SPLINES))
}

/// Voxels of the volume that a march in the crop box of `scene` reads at most: a range along each axis.
#[must_use]
pub fn read_in_crop(scene: &Scene) -> [Range<usize>; 3] {
    let dims = scene.frame.geometry.dims;
    let Some([low, high]) = scene.crop else { return dims.map(|n| 0..n) };
    let margin = count(MARGIN_OF_SPLINES);
    std::array::from_fn(|axis| {
        let first = whole((low[axis].floor() - margin).max(0.0)).min(dims[axis] - 1);
        first..whole(high[axis].ceil() + margin + 1.0).clamp(first + 1, dims[axis])
    })
}

impl NumberStorage {
    /// True if [`Self::blank`] leaves out values of a scene with this plan.
    #[must_use]
    pub fn blanks(plan: &ScenePlan) -> bool {
        !(plan.labels
            || plan.groups.further > 0
            || plan.blending.is_extreme()
            || plan.integration == Integrate::Segments)
    }

    /// Gives voxels that no picture shows one value for all of their neighbourhood; returns how many. They are farther than two voxels from anything
    /// visible, with splines four, so that no value, difference or spline that a march reads changes. Two numbers between which nothing is visible have
    /// the same value then, so nothing appears between what is left and what is not.
    #[must_use]
    pub fn blank(&self, scene: &Scene, planned: &Planned, numbers: &mut [u16]) -> usize {
        let plan = &planned.plan;
        if !Self::blanks(plan) {
            return 0;
        }
        let table = TransferTable::new(scene, planned, &[self.storage.domain]);
        let mut before = vec![0_u32];
        for active in table.active_entries() {
            before.push(before[before.len() - 1] + u32::from(active));
        }
        let [scale, offset] = table.coordinate_from_texel(&self.storage);
        let last = before.len() - 2;
        let entry = |number: u16| (f64::from(number) - f64::from(self.shift)).mul_add(scale, offset);
        let is_visible = |low: u16, high: u16| {
            let first = whole(entry(low).floor().max(0.0)).min(last);
            before[whole(entry(high).ceil().max(0.0)).min(last) + 1] > before[first]
        };
        // The number in place of each where nothing is seen: the first of its gap.
        let largest = u16::try_from(self.largest).unwrap_or(u16::MAX);
        let mut becomes: Vec<u16> = vec![0];
        for number in 1..=largest {
            let same = !is_visible(number - 1, number);
            becomes.push(if same { becomes[usize::from(number) - 1] } else { number });
        }
        let [width, height, depth] = scene.frame.geometry.dims;
        let at = |x: usize, y: usize, z: usize| x + width * (y + height * z);
        let shown = parallel::map(depth, &|z| {
            let mut shown = vec![false; width * height];
            for y in 0..height {
                for x in 0..width {
                    let ends = [[x, (x + 1).min(width - 1)], [y, (y + 1).min(height - 1)], [z, (z + 1).min(depth - 1)]];
                    let (mut low, mut high) = (u16::MAX, 0);
                    for z in ends[2] {
                        for y in ends[1] {
                            for x in ends[0] {
                                let number = numbers[at(x, y, z)];
                                (low, high) = (low.min(number), high.max(number));
                            }
                        }
                    }
                    if is_visible(low, high) {
                        for y in ends[1] {
                            ends[0].iter().for_each(|x| shown[x + width * y] = true);
                        }
                    }
                }
            }
            shown
        })
        .concat();
        // Voxels behind a visible cell along z were not marked; a margin more marks them.
        let linear =
            matches!(plan.interpolation, Interpolation::Nearest | Interpolation::Linear | Interpolation::ExactLinear);
        let margin = if linear { MARGIN } else { MARGIN_OF_SPLINES };
        let kept = near(&shown, [width, height, depth], [margin, margin, margin + 1]);
        let mut blanked = 0;
        for (number, kept) in numbers.iter_mut().zip(kept) {
            if !kept && *number != becomes[usize::from(*number)] {
                *number = becomes[usize::from(*number)];
                blanked += 1;
            }
        }
        blanked
    }
}

/// True for voxels that are at most so far from a marked one along each axis.
fn near(marked: &[bool], [width, height, depth]: [usize; 3], margin: [usize; 3]) -> Vec<bool> {
    let mut all = marked.to_vec();
    for (axis, (stride, length)) in [(1, width), (width, height), (width * height, depth)].into_iter().enumerate() {
        let from = all.clone();
        let slice = |z: usize| -> Vec<bool> {
            let of_voxel = |i: usize| {
                let place = i / stride % length;
                let back = margin[axis].min(place);
                let ahead = margin[axis].min(length - 1 - place);
                (0..=back + ahead).any(|step| from[i + step * stride - back * stride])
            };
            (z * width * height..(z + 1) * width * height).map(of_voxel).collect()
        };
        all = parallel::map(depth, &slice).concat();
    }
    all
}
