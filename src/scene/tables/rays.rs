//! Ray setup in f64 near the volume, so that distant cameras are as precise as near ones.

use glam::DVec3;

use super::{CELL, ClipTable, unit_length};
use crate::{Blocks, Frame, Scene, View};
use relume_base::number::{count, unsigned, whole};

/// Parameters of all pixels' rays, in texture coordinates of the volume (0 to 1 along each axis).
///
/// With u and v a place in a pixel, the centre if it has one ray, from −1 to 1 (right and up), the ray through it is
/// `base + u·base_u + v·base_v + s·(direction + u·direction_u + v·direction_v)/√(1 + u²·spread_u + v²·spread_v)`,
/// with s in units of the smallest spacing, so that volumes of every size stay within the range of f32. Steps begin at
/// s₀ + nΔs; the ray enters the volume at s₀, or starts there if the eye is inside. The crop box and the clip planes select some of these
/// steps, and parts of the first and the last; a sample lies in the middle of its step, or of the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayTable {
    /// `base` of the ray formula: a point in or near the volume.
    pub base: DVec3,
    /// `base_u` of the ray formula.
    pub base_u: DVec3,
    /// `base_v` of the ray formula.
    pub base_v: DVec3,
    /// `direction` of the ray formula: texture units per unit of length along the middle ray.
    pub direction: DVec3,
    /// `direction_u` of the ray formula.
    pub direction_u: DVec3,
    /// `direction_v` of the ray formula.
    pub direction_v: DVec3,
    /// Distance along the middle ray from the eye to `base`, in units of length.
    pub eye_distance: f64,
    /// tan² of half the horizontal field of view; 0 for parallel rays.
    pub spread_u: f64,
    /// tan² of half the vertical field of view; 0 for parallel rays.
    pub spread_v: f64,
    /// Lower corner of the volume.
    pub low: DVec3,
    /// Upper corner of the volume.
    pub high: DVec3,
    /// Lower corner of the crop box.
    pub crop_low: DVec3,
    /// Upper corner of the crop box.
    pub crop_high: DVec3,
    /// The clip planes.
    pub clip: ClipTable,
    /// The marched block, if it is not the whole volume.
    pub block: Option<BlockBox>,
    /// Macrocells along the texture: scales texture coordinates to macrocells, before `cell_offset` is added.
    pub cell_scale: DVec3,
    /// Position of the texture's edge relative to voxel 0, in macrocells; negative.
    pub cell_offset: DVec3,
    /// Scale from texture coordinates to units of length along the volume's own axes, in which shading is computed.
    pub local_scale: DVec3,
    /// Step length Δs in units of length.
    pub step_length: f64,
    /// Largest number of steps of a ray in the crop box, those of which it has a part included.
    pub samples: u32,
}

/// Box of a block in texture coordinates. A block selects some of the samples and moves none.
///
/// A face between two blocks is the same number for both. A ray therefore passes it at the same sample for both, and
/// every sample belongs to one block, whatever the rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BlockBox {
    /// Lower corner; far away where the block ends with the volume.
    pub low: DVec3,
    /// Upper corner; far away where the block ends with the volume.
    pub high: DVec3,
    /// Axes along which the upper face belongs to the next block. A ray in this face has its samples there.
    pub open: [bool; 3],
}

/// Places of `count` rays within a pixel, from 0 to 1 across and down: the first points of the Sobol' sequence in two
/// dimensions (Sobol' 1967), moved so that their mean is the pixel's centre. A power of two has one ray in each of as many
/// columns, and one in each of as many rows; other numbers may have rays up to 0.005 of a pixel beyond it.
#[must_use]
pub fn ray_places(count: usize) -> Vec<[f64; 2]> {
    let point = |i: usize| {
        let (mut x, mut y, mut rest) = (0_u32, 0_u32, i);
        // Direction numbers of the two dimensions: of the van der Corput sequence, and of the polynomial x + 1.
        let (mut across, mut down) = (1_u32 << 31, 1_u32 << 31);
        while rest > 0 {
            if rest % 2 == 1 {
                x ^= across;
                y ^= down;
            }
            across >>= 1;
            down ^= down >> 1;
            rest /= 2;
        }
        [x, y].map(|bits| f64::from(bits) / 4_294_967_296.0)
    };
    let points: Vec<[f64; 2]> = (0..count).map(point).collect();
    let mean =
        [0, 1].map(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / relume_base::number::count(count));
    points.iter().map(|point| std::array::from_fn(|axis| point[axis] - mean[axis] + 0.5)).collect()
}

/// Part of a step, in 2⁻³² of it, at which the steps of ray `index` of a pixel begin, of those of its first ray: the van der Corput sequence, so
/// that the rays lie between each other's samples.
#[must_use]
pub fn phase_of_ray(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(u32::MAX).reverse_bits()
}

/// Part of a step at which the steps of a ray begin that has the phase `of_ray` in its pixel: interleaved gradient noise (Jimenez 2014), in whole
/// numbers, so that it is the same on any device. Twin of `ray_phase` in `shaders/rays.wgsl`.
#[must_use]
pub fn ray_phase([x, y]: [usize; 2], of_ray: u32) -> f64 {
    let [x, y] = [x, y].map(|at| u32::try_from(at).unwrap_or(u32::MAX));
    // 0.06711056 and 0.00583715 of 2³², then 52.9829189 of that.
    let line = x.wrapping_mul(288_237_661).wrapping_add(y.wrapping_mul(25_070_368));
    let noise = line.wrapping_mul(52).wrapping_add((line >> 16).wrapping_mul(64_417));
    f64::from(noise.wrapping_add(of_ray) >> 8) / 16_777_216.0
}

/// Texture coordinates of opposite corners in voxel indices.
fn texture_box(frame: &Frame, [first, last]: [DVec3; 2]) -> [DVec3; 2] {
    let dims = DVec3::from_array(frame.geometry.dims.map(count));
    // An axis with a single voxel is one voxel thick.
    let thin = frame.thin_axes().into();
    [(first, DVec3::ZERO), (last, DVec3::ONE)].map(|(at, of_thin)| DVec3::select(thin, of_thin, (at + 0.5) / dims))
}

/// Opposite corners of the crop box of `scene` in texture coordinates.
pub(super) fn crop_box(scene: &Scene) -> [DVec3; 2] {
    texture_box(&scene.frame, scene.crop.unwrap_or_else(|| scene.frame.whole_box()))
}

impl BlockBox {
    /// Texture coordinate of a face that is far away.
    const FAR: f64 = 1e6;

    /// The box of the block of `scene`. `None` without a block, or if the volume has no such block.
    fn of_scene(scene: &Scene) -> Option<Self> {
        let (block, geometry) = (scene.block?, &scene.frame.geometry);
        let [first, end] = Blocks::new(geometry, block.count)?.voxels(block.index)?;
        let mut it = Self { low: DVec3::splat(-Self::FAR), high: DVec3::splat(Self::FAR), open: [false; 3] };
        for (axis, &voxels) in geometry.dims.iter().enumerate() {
            if first[axis] > 0 {
                it.low[axis] = count(first[axis]) / count(voxels);
            }
            if end[axis] < voxels {
                it.high[axis] = count(end[axis]) / count(voxels);
                it.open[axis] = true;
            }
        }
        Some(it)
    }
}

/// Largest number of samples that a ray can count in f32 without skipping one.
pub const MOST_SAMPLES: f64 = 8_388_608.0;

impl RayTable {
    /// Builds the rays of `view` through the volume of `scene`. `None` if a ray has more than [`MOST_SAMPLES`].
    #[must_use]
    pub fn new(scene: &Scene, view: &View) -> Option<Self> {
        let geometry = &scene.frame.geometry;
        let dims = DVec3::from_array(geometry.dims.map(count));
        let linear = geometry.texture_from_world();
        // Texture coordinate of a world point: (index + ½)/n, index = direction⁻¹(point − origin)/spacing.
        let point = |world: DVec3| linear * (world - geometry.origin) + 0.5 / dims;

        let centre = crate::centre(geometry);
        let diagonal = (geometry.spacing * dims).length();
        let distance = (centre - view.eye).dot(view.forward);
        let eye_distance = if distance > diagonal { distance } else { 0.0 };
        let (half_u, half_v) = (view.half[0] * view.right, view.half[1] * view.up);
        let (spread_u, spread_v) =
            if view.parallel { (0.0, 0.0) } else { (view.half[0] * view.half[0], view.half[1] * view.half[1]) };
        let (base_u, base_v, direction_u, direction_v) = if view.parallel {
            (half_u, half_v, DVec3::ZERO, DVec3::ZERO)
        } else {
            (eye_distance * half_u, eye_distance * half_v, half_u, half_v)
        };

        let ([low, high], [crop_low, crop_high]) =
            (texture_box(&scene.frame, scene.frame.whole_box()), crop_box(scene));
        let block = BlockBox::of_scene(scene);
        if scene.block.is_some() && block.is_none() {
            return None;
        }
        if scene.most_steps() > MOST_SAMPLES {
            return None;
        }
        let samples = scene.steps_across(scene.crop.unwrap_or_else(|| scene.frame.whole_box()));
        let unit = unit_length(geometry);
        let cell = count(CELL);
        Some(Self {
            base: point(view.eye + eye_distance * view.forward),
            base_u: linear * base_u,
            base_v: linear * base_v,
            direction: linear * view.forward * unit,
            direction_u: linear * direction_u * unit,
            direction_v: linear * direction_v * unit,
            eye_distance: eye_distance / unit,
            spread_u,
            spread_v,
            low,
            high,
            crop_low,
            crop_high,
            clip: ClipTable::new(scene),
            block,
            cell_scale: dims / cell,
            cell_offset: DVec3::splat(-0.5 / cell),
            local_scale: geometry.spacing / unit * dims,
            step_length: scene.step_length() / unit,
            samples: unsigned(whole(samples)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::ray_places;
    use relume_base::number::count;

    #[test]
    fn rays_lie_around_the_centre_of_the_pixel_one_in_each_row_and_column() {
        assert_eq!(ray_places(1), [[0.5, 0.5]]);
        assert_eq!(ray_places(4), [[0.125, 0.125], [0.625, 0.625], [0.375, 0.875], [0.875, 0.375]]);
        for number in 1..=256_usize {
            let places = ray_places(number);
            assert!(places.iter().flatten().all(|place| (-0.005..1.005).contains(place)), "{number}: {places:?}");
            for axis in 0..2 {
                let mean = places.iter().map(|place| place[axis]).sum::<f64>() / count(number);
                assert!((mean - 0.5).abs() < 1e-12, "{number}: the mean is {mean}");
                if number.is_power_of_two() {
                    let mut across: Vec<f64> = places.iter().map(|place| place[axis] * count(number)).collect();
                    across.sort_by(f64::total_cmp);
                    let centres = (0..number).map(|i| count(i) + 0.5);
                    assert!(across.iter().zip(centres).all(|(one, other)| (one - other).abs() < 1e-9), "{across:?}");
                }
            }
        }
    }
}
