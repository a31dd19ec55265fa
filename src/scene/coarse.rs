//! Levels of resolution: a coarse volume in place of the volume of a scene.

use std::fmt;
use std::sync::Arc;

use glam::DVec3;

use super::{Aim, Camera, Labels, Scene};
use relume_base::number::count;
use relume_base::progress::Progress;
use relume_volume::{LabelCounts, Volume, VolumeError, coarse_index};

/// A coarse level of the volume of a scene, and of its labels.
#[derive(Clone, Debug)]
pub struct Coarse {
    volume: Arc<Volume>,
    labels: Option<Arc<Volume>>,
    /// Voxels of the volume whose mean is one of the level, along each axis.
    block: [usize; 3],
}

/// Voxels of a label in a volume, and in a coarse level of it.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct LabelLeft {
    /// The label.
    pub label: i64,
    /// Display name.
    pub name: String,
    /// Its voxels in the volume.
    pub voxels: u64,
    /// Its voxels in the level.
    pub left: u64,
    /// Voxels of the volume that they stand for: each takes a block.
    pub stands_for: u64,
}

impl LabelLeft {
    /// Whether the majority of blocks left less than half of its volume.
    #[must_use]
    pub fn is_mostly_lost(&self) -> bool {
        2 * self.stands_for < self.voxels
    }
}

impl fmt::Display for LabelLeft {
    /// `3 (nerve), 1 voxel of the level (for 8) of its 41 voxels`.
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { label, name, voxels, left, stands_for } = self;
        let plural = |number: u64| if number == 1 { "" } else { "s" };
        let (of_level, of_volume) = (plural(*left), plural(*voxels));
        write!(
            out,
            "{label} ({name}), {left} voxel{of_level} of the level (for {stands_for}) of its {voxels} voxel{of_volume}"
        )
    }
}

impl Coarse {
    /// The level of blocks of `block` voxels, which are the voxels of `volume` and of `labels`.
    pub fn new(volume: Arc<Volume>, labels: Option<Arc<Volume>>, block: [usize; 3]) -> Self {
        Self { volume, labels, block }
    }

    /// The level `level`, above 0, of the volume of `scene` and of its labels ([`Volume::coarser_by`]).
    ///
    /// # Errors
    ///
    /// [`VolumeError`].
    pub fn of_level(scene: &Scene, level: u32, progress: &dyn Progress) -> Result<Self, VolumeError> {
        let of = scene.volume();
        let volume = of.coarser_by(level, of.has_labels, progress)?;
        let labels = scene.labels.as_ref().map(|labels| labels.volume.coarser_by(level, true, progress)).transpose()?;
        let block = of.block_of(&volume);
        Ok(Self::new(Arc::new(volume), labels.map(Arc::new), block))
    }

    /// `scene` with this level in place of its volume: the same picture but for the voxels. It states no
    /// [`voxel_pixels`](super::Accuracy::voxel_pixels).
    #[must_use]
    pub fn scene(&self, scene: &Scene) -> Scene {
        let mut coarse = scene.clone();
        coarse.set_volume(Arc::clone(&self.volume));
        coarse.labels = scene
            .labels
            .as_ref()
            .zip(self.labels.as_ref())
            .map(|(labels, volume)| Labels { volume: Arc::clone(volume), declared: labels.declared.clone() });
        coarse.crop = scene.crop.map(|corners| corners.map(|index| coarse_index(index, self.block)));
        // Steps as long in voxels.
        let longer = self.volume.geometry.spacing.min_element() / scene.frame.geometry.spacing.min_element();
        coarse.accuracy.step_length *= longer;
        coarse.accuracy.voxel_pixels = 0.0;
        // So are the spaces of a light grid, and one lies within the reach of shadows.
        coarse.shadows.reach = coarse.shadows.reach.map(|reach| reach.max(coarse.least_reach()));
        coarse.camera = around_finest(scene, &scene.camera);
        coarse
    }

    /// [`Self::scene`] for a picture of `size`, also by the same camera if the axes of the volume are not those of the world.
    #[must_use]
    pub fn scene_in(&self, scene: &Scene, [width, height]: [usize; 2]) -> Scene {
        let mut coarse = self.scene(scene);
        coarse.camera = Self::camera_in(scene, &scene.camera, [width, height]);
        coarse
    }

    /// The camera for a level of the volume of `scene` that shows in a picture of `size` what `camera` shows of the volume itself.
    #[must_use]
    pub fn camera_in(scene: &Scene, camera: &Camera, [width, height]: [usize; 2]) -> Camera {
        let around = around_finest(scene, camera);
        match around.aim {
            Aim::Orbit { around: None, .. } => {
                camera.placed(&scene.frame.geometry, count(width) / count(height)).unwrap_or(around)
            }
            _ => around,
        }
    }

    /// Voxels of the visible labels of `scene`, whose level this is, the label with the fewest ones first.
    ///
    /// # Errors
    ///
    /// [`VolumeError`], of labels that stay in a file.
    pub fn labels_left(&self, scene: &Scene) -> Result<Vec<LabelLeft>, VolumeError> {
        let Some((labels, coarse)) = scene.labels.as_ref().zip(self.labels.as_ref()) else { return Ok(Vec::new()) };
        let voxels = labels.volume.counts_of_labels()?;
        let left = coarse.counts_of_labels()?;
        let counted = |counts: &LabelCounts, label: i64| counts.get(&label).copied().unwrap_or(0);
        let block: usize = self.block.iter().product();
        let visible = labels.declared.iter().filter(|entry| entry.is_visible());
        let of_label = visible.map(|entry| {
            let (label, left) = (entry.label, counted(&left, entry.label));
            let stands_for = left.saturating_mul(block as u64);
            LabelLeft { label, name: entry.name.clone(), voxels: counted(&voxels, label), left, stands_for }
        });
        let mut found: Vec<LabelLeft> = of_label.filter(|label| label.voxels > 0).collect();
        found.sort_by_key(|label| label.voxels);
        Ok(found)
    }

    /// The voxels of the level.
    #[must_use]
    pub fn volume(&self) -> &Volume {
        &self.volume
    }

    /// Voxels of the volume whose mean is one of the level, along each axis.
    #[must_use]
    pub fn block(&self) -> [usize; 3] {
        self.block
    }

    /// Number of the level; 0 are the voxels themselves.
    #[must_use]
    pub fn level(&self) -> u32 {
        self.block.iter().max().map_or(0, |side| side.ilog2())
    }
}

/// The level of resolution of a picture, and the size of its voxels there ([`Scene::level`]).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Level {
    /// Number of the level; 0 are the voxels themselves.
    pub level: u32,
    /// Number of the coarsest level that the volume has.
    pub coarsest: u32,
    /// Voxels of the volume whose mean is one of the level, along each axis.
    pub block: [usize; 3],
    /// Longest edge of a voxel of the level at the nearest place in the picture, in pixels: infinite if the eye is in the
    /// volume, and 0 if the volume is not in the picture.
    pub pixels: f64,
    /// The same of the next coarser level.
    pub next_pixels: f64,
    /// [`Accuracy::voxel_pixels`](super::Accuracy::voxel_pixels).
    pub allowed: f64,
}

impl Level {
    /// The level and its reason, in words.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self { level, coarsest, block: [x, y, z], pixels, next_pixels, allowed } = *self;
        let short = |pixels: f64| format!("{pixels:.2}");
        let blocks = if level == 0 { String::new() } else { format!(", means of {x}×{y}×{z} voxels") };
        let why = if pixels <= 0.0 {
            "the volume is not in the picture".to_owned()
        } else if pixels.is_infinite() {
            "the eye is in the volume, where voxels have any size in pixels".to_owned()
        } else {
            let next = if level == coarsest {
                "the volume has no coarser level".to_owned()
            } else {
                format!("level {} {}", level + 1, short(next_pixels))
            };
            let within = if pixels <= allowed { "of" } else { "with only" };
            format!("its voxels take up to {} {within} {} allowed pixels, and {next}", short(pixels), short(allowed))
        };
        format!("level {level} of the volume{blocks}: {why}")
    }
}

impl Scene {
    /// The level that [`Accuracy::voxel_pixels`](super::Accuracy::voxel_pixels) allows in a picture of `size`: the coarsest
    /// one whose voxels take at most so many pixels at the nearest place of the crop box in the picture, or else 0
    /// (docs/theory/bricks.md).
    #[must_use]
    pub fn level(&self, size: [usize; 2]) -> Level {
        self.level_of(std::slice::from_ref(&self.camera), size)
    }

    /// [`Self::level`] of pictures by several `cameras`: the finest one of them.
    #[must_use]
    pub fn level_of(&self, cameras: &[Camera], size: [usize; 2]) -> Level {
        let geometry = &self.frame.geometry;
        // Along an axis of one voxel there is nothing to average.
        let single = geometry.dims.map(|n| n == 1);
        let spacing = DVec3::select(single.into(), DVec3::ZERO, geometry.spacing);
        let unit = cameras.iter().map(|camera| self.pixels_of_unit(camera, size)).fold(0.0, f64::max);
        let block = |level: u32| geometry.dims.map(|n| n.next_power_of_two().min(1 << level));
        let pixels = |level: u32| {
            let edges = spacing * DVec3::from_array(block(level).map(count));
            if unit > 0.0 && unit.is_finite() { unit * edges.max_element() } else { unit }
        };
        let allowed = self.accuracy.voxel_pixels;
        // Levels are of one volume.
        let coarsest = if self.fields.further().is_empty() { self.volume().coarser_levels() } else { 0 };
        let is_allowed = |level: &u32| unit > 0.0 && pixels(*level) <= allowed;
        let level = (1..=coarsest).take_while(is_allowed).last().unwrap_or(0);
        let [pixels, next_pixels] = [level, (level + 1).min(coarsest)].map(pixels);
        Level { level, coarsest, block: block(level), pixels, next_pixels, allowed }
    }

    /// Pixels of a world unit across the line of sight, at the nearest place of the crop box in the picture.
    fn pixels_of_unit(&self, camera: &Camera, size: [usize; 2]) -> f64 {
        let geometry = &self.frame.geometry;
        let [width, height] = size.map(count);
        let Some(view) = camera.view(geometry, width / height) else { return 0.0 };
        let at_unit_depth = height / (2.0 * view.half[1]);
        if view.parallel {
            return at_unit_depth;
        }
        let [low, high] = self.crop.unwrap_or_else(|| self.frame.whole_box());
        // An axis of one voxel is a voxel thick.
        let thick = DVec3::select(self.frame.thin_axes().into(), DVec3::splat(0.5), DVec3::ZERO);
        let [low, high] = [low - thick, high + thick];
        let eye = geometry.direction.transpose() * (view.eye - geometry.origin) / geometry.spacing;
        if eye.cmpge(low).all() && eye.cmple(high).all() {
            return f64::INFINITY;
        }
        let corner = |corner: usize| {
            let is_high = [0, 1, 2].map(|axis| corner >> axis & 1 == 1);
            DVec3::select(is_high.into(), high, low)
        };
        let depth = faces().map(|face| face.map(|at| view.seen(geometry.world_from_index(corner(at)))));
        let depth = depth.iter().filter_map(nearest).fold(f64::INFINITY, f64::min);
        if depth.is_finite() { at_unit_depth / depth } else { 0.0 }
    }
}

/// `camera`, around the box of the finest voxels if it fits the whole volume: incomplete blocks exceed this box.
fn around_finest(scene: &Scene, camera: &Camera) -> Camera {
    let mut camera = camera.clone();
    if let Aim::Orbit { around: around @ None, .. } = &mut camera.aim {
        *around = scene.frame.geometry.world_box();
    }
    camera
}

/// Corners of the six faces of a box, each around its face; bit `axis` of a corner is 1 at the high end of that axis.
fn faces() -> [[usize; 4]; 6] {
    std::array::from_fn(|face| {
        let [axis, one, other] = [0, 1, 2].map(|further| 1 << ((face / 2 + further) % 3));
        let side = face % 2 * axis;
        [side, side + one, side + one + other, side + other]
    })
}

/// Least depth of the part of `face` in a perspective picture: of its corners after the four sides of the picture have
/// clipped it. `None` if no part is in it.
fn nearest(face: &[DVec3; 4]) -> Option<f64> {
    let sides: [fn(&DVec3) -> f64; 4] =
        [|seen| seen.z - seen.x, |seen| seen.z + seen.x, |seen| seen.z - seen.y, |seen| seen.z + seen.y];
    let mut shape = face.to_vec();
    for inside in sides {
        let mut clipped = Vec::new();
        for (index, &from) in shape.iter().enumerate() {
            let to = shape[(index + 1) % shape.len()];
            let [here, there] = [inside(&from), inside(&to)];
            if here >= 0.0 {
                clipped.push(from);
            }
            if (here < 0.0) != (there < 0.0) {
                clipped.push(from.lerp(to, here / (here - there)));
            }
        }
        shape = clipped;
    }
    shape.iter().map(|seen| seen.z).reduce(f64::min)
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use crate::Projection;
    use relume_volume::{Geometry, Voxels};

    /// 64×64×64 voxels of spacing 1 in a picture of 100×100 pixels by a perspective camera.
    fn scene(fov_degrees: f64, position: DVec3, target: DVec3) -> Scene {
        let geometry = Geometry::unit("test", [64; 3]).unwrap();
        let mut scene =
            Scene::new("test", Arc::new(Volume::new("test", Voxels::U8(vec![0; 1 << 18]), geometry).unwrap()));
        scene.camera.aim = Aim::LookAt { position, target };
        scene.camera.projection = Projection::Perspective { fov_degrees };
        scene
    }

    fn level(scene: &mut Scene, allowed: f64) -> Level {
        scene.accuracy.voxel_pixels = allowed;
        scene.level([100, 100])
    }

    #[test]
    fn the_level_is_the_coarsest_whose_voxels_are_small_enough_where_they_are_nearest() {
        let centre = DVec3::splat(31.5);
        // The first voxels are at z = 0, 100 before the eye: one takes 100 / (2·100·tan 15°) = 1.866 pixels.
        let mut ahead = scene(30.0, DVec3::new(31.5, 31.5, -100.0), centre);
        let voxel = 0.5 / 15_f64.to_radians().tan();
        for (allowed, expected) in [(0.0, 0), (1.0, 0), (3.73, 0), (3.74, 1), (7.4, 1), (7.5, 2), (64.0, 5)] {
            let found = level(&mut ahead, allowed);
            assert_eq!((found.level, found.block, found.coarsest), (expected, [1 << expected; 3], 6), "{allowed}");
            assert!((found.pixels - voxel * f64::from(1 << expected)).abs() < 1e-9, "{found:?}");
        }
        // A crop box that begins 20 voxels behind: 120 from the eye.
        ahead.crop = Some([DVec3::new(0.0, 0.0, 20.0), DVec3::splat(63.0)]);
        assert!((level(&mut ahead, 1.0).pixels - voxel / 1.2).abs() < 1e-9);
        // The eye in the volume, and a volume behind the eye.
        let inside = level(&mut scene(30.0, centre, DVec3::ZERO), 64.0);
        assert!(inside.level == 0 && inside.pixels.is_infinite() && inside.sentence().contains("eye"), "{inside:?}");
        let behind = level(&mut scene(30.0, DVec3::splat(-100.0), DVec3::splat(-200.0)), 64.0);
        assert!(behind.level == 0 && behind.pixels <= 0.0, "{behind:?}");
    }

    #[test]
    fn parts_of_the_volume_outside_the_picture_do_not_count() {
        // Half of the angle of view is 5°, and the line of sight is turned from z by atan 0.32 = 17.74°: at the left edge of
        // the picture, rays meet the face 100 before the eye under 12.74°. Nearer parts lie to the left.
        let mut aside = scene(10.0, DVec3::new(31.5, 31.5, -100.0), DVec3::new(63.5, 31.5, 0.0));
        let five = 5_f64.to_radians();
        let depth = 100.0 / (0.32_f64.atan() - five).cos() * five.cos();
        let found = level(&mut aside, 1.0);
        // Rays above and below the middle row meet the face at the same depth.
        assert!((found.pixels - 50.0 / (depth * five.tan())).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn parallel_rays_see_voxels_at_one_size_and_the_longest_edge_counts() {
        let mut scene = scene(30.0, DVec3::new(0.0, 0.0, -9.0), DVec3::ZERO);
        scene.camera.projection = Projection::Orthographic { height: Some(50.0) };
        assert!((level(&mut scene, 4.0).pixels - 4.0).abs() < 1e-12, "two pixels for a voxel, four at level 1");
        let mut volume = (**scene.volume()).clone();
        volume.geometry.spacing.z = 3.0;
        scene.set_volume(Arc::new(volume));
        assert_eq!([5.9, 12.0].map(|allowed| level(&mut scene, allowed).level), [0, 1]);
        // A single slice has no edge along z to average.
        let slice = Volume {
            geometry: Geometry { dims: [64, 64, 1], ..scene.frame.geometry },
            voxels: Voxels::U8(vec![0; 1 << 12]),
            ..(**scene.volume()).clone()
        };
        scene.set_volume(Arc::new(slice));
        assert_eq!(level(&mut scene, 4.0).level, 1);
    }

    #[test]
    fn a_scene_at_a_level_keeps_its_camera_on_any_grid() {
        // Incomplete blocks exceed the volume, which is turned against the world.
        let direction = glam::DMat3::from_rotation_z(0.3);
        let geometry = Geometry::new("test", [9, 5, 3], DVec3::new(1.0, 2.0, 1.5), DVec3::ONE, direction).unwrap();
        let volume = Volume::new("test", Voxels::U8(vec![7; 135]), geometry).unwrap();
        for projection in [Projection::Perspective { fov_degrees: 30.0 }, Projection::Orthographic { height: None }] {
            let mut scene = Scene::new("test", Arc::new(volume.clone()));
            scene.camera.projection = projection;
            let coarse = Coarse::of_level(&scene, 1, &relume_base::progress::Quiet).unwrap().scene_in(&scene, [30, 20]);
            let [view, of_level] = [&scene, &coarse].map(|it| it.camera.view(&it.frame.geometry, 1.5).unwrap());
            let apart = [view.eye - of_level.eye, view.forward - of_level.forward].map(DVec3::length);
            assert!(apart[0].max(apart[1]) < 1e-9 && (view.half[1] - of_level.half[1]).abs() < 1e-9, "{apart:?}");
        }
    }
}
