//! Volumes in bricks: the film is that of the whole volume, whatever the pool holds.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use relume::document::moves::turntable;
use relume::film::Film;
use relume::output::write_bricks;
use relume::plan::{Integrate, plan};
use relume::progress::Quiet;
use relume::render::{BrickCounts, Dispatching, Renderer, Residence, SceneRenderer};
use relume::scene::{Aim, Gradients, Integration, Interpolation, Orders, Scene, Shading};
use relume::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::tables::{apron, slot_edge};
use relume::volume::{self, Geometry, HostMemory, RawLayout, Selection, Volume, Voxels};

use crate::support::device::open;
use crate::support::rungs::{Rungs, with_renderer};
use crate::support::scenes;

pub(super) const SIZE: [usize; 2] = [40, 34];
/// Voxels of a large volume along one of the small one's.
const FACTOR: usize = 5;

fn bits(film: &Film<f32>) -> Vec<u32> {
    film.accumulators.iter().chain(&film.transmittance).map(|number| number.to_bits()).collect()
}

/// `volume` with [`FACTOR`] times the voxels along each axis of the same body, changed by `value(stored, x, y, z)`.
fn enlarged(volume: &Volume, value: impl Fn(f64, [usize; 3]) -> u16) -> Volume {
    let small = volume.geometry.dims;
    let dims = small.map(|n| n * FACTOR);
    let stored = |[x, y, z]: [usize; 3]| volume.voxels.value(x + small[0] * (y + small[1] * z)).unwrap();
    let mut voxels = Vec::with_capacity(dims.iter().product());
    for z in 0..dims[2] {
        for y in 0..dims[1] {
            for x in 0..dims[0] {
                voxels.push(value(stored([x, y, z].map(|at| at / FACTOR)), [x, y, z]));
            }
        }
    }
    let Geometry { spacing, origin, direction, .. } = volume.geometry;
    let geometry = Geometry::new("enlarged", dims, spacing / scenes::float(FACTOR), origin, direction).unwrap();
    Volume::new("enlarged", Voxels::U16(voxels), geometry).unwrap()
}

/// `scene` with a volume of several bricks along each axis, whose values differ from voxel to voxel.
pub(super) fn large(mut scene: Scene) -> Scene {
    let factor = scenes::float(FACTOR);
    let rippled = |stored: f64, [x, y, z]: [usize; 3]| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within 16 bits")]
        let stored = stored.clamp(0.0, 65000.0) as u16;
        let ripple = u16::try_from((7 * x + 13 * y + 29 * z) % 17).unwrap();
        if stored > 300 { stored + 10 * ripple } else { stored }
    };
    scene.set_volume(Arc::new(enlarged(scene.volume(), rippled)));
    if let Some(labels) = &mut scene.labels {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "labels are small whole numbers")]
        let as_stored = |stored: f64, _: [usize; 3]| stored as u16;
        labels.volume = Arc::new(enlarged(&labels.volume, as_stored));
    }
    scene.crop = scene.crop.map(|corners| corners.map(|corner| corner * factor));
    scene.accuracy.step_length /= factor;
    scene.accuracy.interpolation = match scene.accuracy.interpolation {
        Interpolation::Linear => Interpolation::ExactLinear,
        other => other,
    };
    scene
}

/// Bytes of `slots` slots for the plan of `rungs`, and a little more.
fn memory_of(rungs: &Rungs, slots: u64) -> u64 {
    let plan = &rungs.planned.plan;
    let texel = if plan.stores_gradient() { 8 } else { 2 } + if plan.labels { 1 } else { 0 };
    let edge = u64::from(slot_edge(apron(&rungs.scene, plan)));
    slots * edge.pow(3) * texel + 1000
}

/// The film of `rungs` in a pool of `slots` slots, and its bricks.
fn in_bricks(rungs: &Rungs, renderer: &Renderer, slots: u64) -> (Film<f32>, BrickCounts) {
    let renderer = renderer.clone().always_in_bricks().with_memory(memory_of(rungs, slots));
    let film = rungs.filtered_accumulators(&renderer);
    let counts = film.bricks.unwrap();
    assert!(counts.held as u64 <= slots, "{counts:?} in {slots}");
    (renderer.read(&film).unwrap(), counts)
}

pub(super) fn assert_same(name: &str, rungs: &Rungs, renderer: &Renderer, pools: &[u64]) -> Vec<BrickCounts> {
    let film = rungs.filtered_accumulators(renderer);
    assert!(film.bricks.is_none(), "{name}: it fits");
    let whole = bits(&renderer.read(&film).unwrap());
    let counted = pools.iter().map(|&slots| {
        let (film, counts) = in_bricks(rungs, renderer, slots);
        let bricked = bits(&film);
        let differ = whole.iter().zip(&bricked).filter(|(one, other)| one != other).count();
        assert!(differ == 0, "{name}: {differ} of {} numbers differ: {counts:?}", whole.len());
        counts
    });
    counted.collect()
}

#[test]
fn every_interpolation_and_gradient_reads_the_voxels_around_a_brick() {
    with_renderer(|renderer| {
        for interpolation in [Interpolation::Nearest, Interpolation::ExactLinear, Interpolation::Cubic] {
            for gradients in [Gradients::Packed, Gradients::Central] {
                // Nearest voxels have no segments.
                let integrated: &[bool] =
                    if interpolation == Interpolation::Nearest { &[false] } else { &[false, true] };
                for &segments in integrated {
                    let mut scene = large(scenes::named("diffuse_one"));
                    if segments {
                        scene = scenes::in_segments(scene);
                        // Segments that reach beyond a macrocell by more than a voxel.
                        scene.accuracy.step_length *= 5.0;
                    }
                    (scene.accuracy.interpolation, scene.accuracy.gradients) = (interpolation, gradients);
                    let name = format!("{interpolation:?}, {gradients:?}, segments: {segments}");
                    assert_same(&name, &Rungs::new(scene, SIZE), renderer, &[3, 1000]);
                }
            }
        }
    });
}

/// Central differences of nearest voxels and all marched macrocells, and rays that are cut into slices.
#[test]
fn slices_rays_of_a_pixel_and_unskipped_macrocells_change_no_bit() {
    let Some(device) = open() else { return };
    let renderer = Renderer::new(device);
    let mut scene = large(scenes::named("specular_three"));
    scene.accuracy.rays = 3;
    scene.accuracy.termination = 1e-3;
    let rungs = Rungs::new(scene.clone(), SIZE);
    let cut =
        renderer.clone().with_dispatching(Dispatching { samples: Some(20_000), slice: 50, ..Dispatching::default() });
    assert_same("cut into slices", &rungs, &cut, &[4, 1000]);
    scene.accuracy.rays = 1;
    scene.accuracy.skipping = false;
    let rungs = Rungs::new(scene, SIZE);
    let counts = assert_same("not skipped", &rungs, &renderer, &[9, 1000]);
    assert_eq!(counts[1].visible, 27, "all are marched");
    let messages = renderer.device().validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}

/// A wrong order would leave rays without their bricks, round after round.
#[test]
fn rays_of_all_directions_end_wherever_the_eye_is() {
    with_renderer(|renderer| {
        for parallel in [false, true] {
            for octant in 0..8_u32 {
                let signs: [f64; 3] = std::array::from_fn(|axis| if octant >> axis & 1 == 0 { 1.0 } else { -1.0 });
                let mut scene = large(scenes::named(if parallel { "orthographic" } else { "inside" }));
                let centre = DVec3::new(15.0, 13.0, 12.0);
                let signs = DVec3::from_array(signs);
                // Inside the volume, or outside.
                let (position, target) = if parallel {
                    (centre + DVec3::new(50.0, 40.0, 30.0) * signs, centre)
                } else {
                    (centre + DVec3::new(1.1, -0.8, 0.6) * signs, centre + DVec3::new(5.0, 4.0, 3.0) * signs)
                };
                scene.camera.aim = Aim::LookAt { position, target };
                let name = format!("{signs:?}, parallel: {parallel}");
                let counts = assert_same(&name, &Rungs::new(scene, SIZE), renderer, &[1, 9]);
                assert!(counts[1].rounds <= 12, "{name}: a ray passes at most seven bricks: {counts:?}");
                assert!(counts.iter().all(|counts| counts.again == 0), "{name}: {counts:?}");
            }
        }
    });
}

/// The filter of the device gets other texture coordinates, and may round otherwise.
#[test]
#[expect(clippy::print_stdout, reason = "the measured differences")]
fn the_filter_of_the_device_moves_colours_by_little() {
    with_renderer(|renderer| {
        for name in ["diffuse_one", "specular_three", "orthographic"] {
            for gradients in [Gradients::Packed, Gradients::Central] {
                let mut scene = large(scenes::named(name));
                (scene.accuracy.interpolation, scene.accuracy.gradients) = (Interpolation::Linear, gradients);
                let rungs = Rungs::new(scene, SIZE);
                let matrices = rungs.xyz_matrices();
                let whole = rungs.gpu(renderer).relight(&matrices);
                let (film, _) = in_bricks(&rungs, renderer, 5);
                let lab = |colour: DVec3| lab_from_xyz(Xyz(colour.to_array()), d65_white());
                let bricked = film.relight(&matrices);
                let mut found: Vec<f64> =
                    whole.iter().zip(&bricked).map(|(one, other)| ciede2000(lab(*one), lab(*other))).collect();
                found.sort_by(f64::total_cmp);
                let (p95, worst) = (found[found.len() * 95 / 100], found[found.len() - 1]);
                println!("{name}, {gradients:?}: ΔE00 p95 {p95:.6}, largest {worst:.6}");
                assert!(p95 <= 0.02 && worst <= 0.2, "{name}, {gradients:?}: p95 {p95}, largest {worst}");
            }
        }
    });
}

#[test]
fn bricks_behind_an_opaque_skin_are_not_loaded() {
    with_renderer(|renderer| {
        let mut scene = scenes::named("orthographic");
        scene.set_volume(Arc::new(scenes::slab([200, 190, 180], 40_000)));
        scene.accuracy.interpolation = Interpolation::ExactLinear;
        scene.accuracy.termination = 1e-3;
        for term in &mut scene.transfer.terms {
            term.opacity = vec![(0.0, 1.0)];
        }
        let target = DVec3::new(100.0, 95.0, 90.0);
        scene.camera.aim = Aim::LookAt { position: target - DVec3::new(300.0, 0.0, 0.0), target };
        let rungs = Rungs::new(scene, SIZE);
        let counts = assert_same("opaque", &rungs, renderer, &[5, 20]);
        assert!(counts.iter().all(|counts| 2 * counts.loaded <= counts.visible), "{counts:?}");
        assert!(counts.iter().all(|counts| counts.again == 0), "{counts:?}");
    });
}

#[test]
fn an_axis_longer_than_the_textures_of_the_device_is_rendered() {
    with_renderer(|renderer| {
        let dims = [2000, 12, 14];
        let mut scene = scenes::named("diffuse_one");
        scene.set_volume(Arc::new(scenes::sampled(dims, |p| {
            60000.0 * (-(p.y * p.y + p.z * p.z)).exp() * (0.5 + 0.5 * (40.0 * p.x).sin())
        })));
        scene.accuracy.interpolation = Interpolation::ExactLinear;
        let rungs = Rungs::new(scene, SIZE);
        let whole = bits(&rungs.gpu(renderer));
        let limited = renderer.clone().with_longest_axis(140);
        let film = rungs.filtered_accumulators(&limited);
        assert!(bits(&limited.read(&film).unwrap()) == whole, "{:?}", film.bricks);
        let counts = film.bricks.unwrap();
        assert!(counts.held == 8 && counts.visible == 32 && counts.again == 0, "{counts:?}");
    });
}

/// The volume that no texture of 2048 texels holds, in two pools.
#[test]
fn twenty_thousand_slices_are_rendered_on_a_device_with_two_thousand_texels_an_axis() {
    with_renderer(|renderer| {
        let dims = [20_000, 64, 64];
        let voxels = (0..dims.iter().product::<usize>()).map(|i| {
            let (x, y) = (i % dims[0], i / dims[0] % dims[1]);
            u8::try_from(x / 40 % 200 + y % 50).unwrap()
        });
        let geometry = Geometry::unit("long", dims).unwrap();
        let mut scene = scenes::named("unshaded_one");
        scene.set_volume(Arc::new(Volume::new("long", Voxels::U8(voxels.collect()), geometry).unwrap()));
        for term in &mut scene.transfer.terms {
            term.opacity = vec![(0.0, 0.0), (255.0, 0.01)];
        }
        scene.accuracy.interpolation = Interpolation::ExactLinear;
        let rungs = Rungs::new(scene, SIZE);
        let [one, other] = [(2048, 60_000_000), (1000, 30_000_000)].map(|(longest, memory)| {
            let limited = renderer.clone().with_longest_axis(longest).with_memory(memory);
            let film = rungs.filtered_accumulators(&limited);
            let counts = film.bricks.unwrap();
            assert!(counts.visible == 313 && counts.again == 0, "{counts:?}");
            assert!(counts.held >= usize::try_from(memory).unwrap() / 700_000, "{counts:?}");
            limited.read(&film).unwrap()
        });
        assert!(bits(&one) == bits(&other), "the pool changes no bit");
        assert!(one.transmittance.iter().any(|&passed| passed < 0.9), "the rays meet the volume");
    });
}

/// The means of the blocks of a ramp are those of a ramp, so that it casts the same shadows from its coarse level, where no
/// block is incomplete and none is cut off: in the crop box.
fn ramp(light: &str) -> Scene {
    let dims = [81, 35, 33];
    let text = format!(
        r#"
        shading = "none"
        [materials.only]
        reflectance = "orange"
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "only"
        range = [0, 2400]
        opacity = 0.1
        [lights.day]
        spectrum = "D65"
        shadows = true
        {light}
        [shadows]
        spacing = 2
        start = 0
        [accuracy]
        interpolation = "exact_linear"
    "#
    );
    let values = (0..81 * 35 * 33).map(|i| u16::try_from(16 * (i % 81 + i / 81 % 35 + i / (81 * 35))).unwrap());
    let geometry = Geometry::unit("ramp", dims).unwrap();
    let mut scene = scenes::of(&text, Volume::new("ramp", Voxels::U16(values.collect()), geometry).unwrap());
    scene.transfer.terms[0].opacity = vec![(0.0, 0.0), (2400.0, 0.1)];
    scene.crop = Some([DVec3::splat(1.0), DVec3::new(78.0, 32.0, 30.0)]);
    scene
}

/// A half of the light grid rounds a depth of at most 4 by 2⁻¹⁰, and the tables of both have other domains.
const OF_A_RAMP: f32 = 2e-3;

#[test]
fn shadows_from_means_of_a_ramp_are_those_of_the_ramp() {
    with_renderer(|renderer| {
        let (day, bricks) = ("kind = \"directional\"\ndirection = ", renderer.clone().always_in_bricks());
        for (light, reach) in [
            (format!("{day}[0.3, 0.5, 0.8]"), None),
            (format!("{day}[-0.9, 0.2, -0.4]"), None),
            ("kind = \"point\"\nposition = [90, 10, -20]".to_owned(), None),
            ("kind = \"three_point\"".to_owned(), None),
            ("kind = \"ambient\"".to_owned(), None),
            ("kind = \"ambient\"".to_owned(), Some(9.0)),
        ] {
            let mut scene = ramp(&light);
            scene.shadows.reach = reach;
            let rungs = Rungs::new(scene.clone(), SIZE);
            let film = rungs.filtered_accumulators(renderer);
            assert!(film.light_block.is_none() && film.light_spacing == Some(2.0), "{light}: it fits");
            let whole = renderer.read(&film).unwrap();
            // Room for one brick of two, and for both.
            let [one, both] = [700_000, 2_000_000].map(|memory| {
                let film = rungs.filtered_accumulators(&bricks.clone().with_memory(memory));
                assert_eq!((film.light_block, film.light_spacing), (Some([2; 3]), Some(2.0)), "{light}");
                (film.bricks.unwrap(), renderer.read(&film).unwrap())
            });
            assert!(one.0.held == 1 && both.0.held == 2, "{:?} {:?}", one.0, both.0);
            assert!(bits(&one.1) == bits(&both.1), "{light}: the pool decides nothing");
            let largest = whole.accumulators.iter().fold(0.0, |most: f32, &number| most.max(number));
            let pairs = whole.accumulators.iter().zip(&one.1.accumulators);
            let apart = pairs.map(|(one, other)| (one - other).abs()).fold(0.0, f32::max);
            assert!(apart <= OF_A_RAMP * largest, "{light}: {apart:e} of {largest}");
            scene.lights[0].shadows = false;
            let bright = Rungs::new(scene, SIZE).gpu(renderer);
            let pairs = whole.accumulators.iter().zip(&bright.accumulators);
            let dimmed = pairs.map(|(dim, bright)| bright - dim).fold(0.0, f32::max);
            assert!(dimmed > 50.0 * OF_A_RAMP * largest, "{light}: shadows take {dimmed} of {largest}");
        }
    });
}

#[test]
fn light_scattered_by_means_of_a_ramp_is_that_of_the_ramp() {
    with_renderer(|renderer| {
        let mut scene = ramp("kind = \"directional\"\ndirection = [0.3, 0.5, 0.8]");
        scene.shading = Shading::None;
        let lit = |scene: &Scene, renderer: &Renderer| {
            let rungs = Rungs::new(scene.clone(), SIZE);
            let film = renderer.read(&rungs.filtered_accumulators(renderer)).unwrap();
            film.accumulators.iter().copied().map(f64::from).sum::<f64>()
        };
        scene.scattering.orders = Orders::Multiple;
        scene.scattering.spacing = Some(4.0);
        let bricks = renderer.clone().always_in_bricks();
        let [whole, one, both] = [renderer.clone(), bricks.clone().with_memory(700_000), bricks.with_memory(2_000_000)]
            .map(|renderer| lit(&scene, &renderer));
        assert_eq!(one.to_bits(), both.to_bits(), "the pool decides nothing");
        scene.scattering.orders = Orders::Single;
        let once = lit(&scene, renderer);
        assert!((one / whole - 1.0).abs() <= 0.005 && once < 0.95 * whole, "{one}, {whole}, {once}");
    });
}

#[test]
fn shadows_that_are_switched_on_later_make_a_level_and_no_march_goes_without() {
    with_renderer(|renderer| {
        let mut scene = large(scenes::named("labels"));
        let renderer = renderer.clone().always_in_bricks();
        let before = SceneRenderer::new(&renderer, scene.clone(), &Quiet).unwrap();
        scene.lights[0].shadows = true;
        let shadowed = Rungs::new(scene, SIZE);
        assert!(!before.holds(&shadowed.scene, &shadowed.planned));
        let march = renderer.march(&shadowed.scene, &shadowed.planned, before.uploaded(), SIZE, &Quiet);
        assert_eq!(march.unwrap_err().code(), "bricks-unsupported");
        let later = before.with_scene(shadowed.scene.clone(), shadowed.planned.clone(), &Quiet).unwrap();
        let film = later.march(SIZE, &Quiet).unwrap();
        assert_eq!(film.light_block, Some([2; 3]));
        assert!(later.uploaded().bytes() > before.uploaded().bytes(), "the level is on the device");
        // Off again: nothing is uploaded.
        assert!(later.holds(before.scene(), before.planned()));
    });
}

#[test]
fn a_device_without_room_for_a_brick_says_how_much_one_needs() {
    with_renderer(|renderer| {
        let rungs = Rungs::new(large(scenes::named("unshaded_one")), SIZE);
        let new =
            |renderer: Renderer| SceneRenderer::new(&renderer, rungs.scene.clone(), &Quiet).unwrap_err().to_string();
        let small = new(renderer.clone().with_memory(500_000));
        assert!(small.contains("needs 67 texels along each axis and 602 kB"), "{small}");
        let short = new(renderer.clone().with_longest_axis(64));
        assert!(short.contains("at most [64, 64, 64]"), "{short}");
        let enough = renderer.clone().with_memory(700_000);
        assert!(SceneRenderer::new(&enough, rungs.scene.clone(), &Quiet).is_ok(), "one slot is enough");
    });
}

/// `volume` in a file of bricks in `folder`, where its voxels stay.
fn in_file(volume: &Volume, folder: &Path) -> Volume {
    let [raw, bricks] = ["v.raw", "v.bricks"].map(|name| folder.join(name));
    std::fs::write(&raw, volume.voxels.bytes()).unwrap();
    let Geometry { dims, spacing, origin, direction } = volume.geometry;
    let layout = RawLayout {
        spacing: spacing.to_array(),
        origin: origin.to_array(),
        direction: direction.to_cols_array(),
        ..RawLayout::new(dims, volume.voxels.voxel_type())
    };
    write_bricks(&bricks, (&raw, Some(&layout)), &Selection::default(), u64::MAX, &Quiet).unwrap();
    let selection = Selection { memory: HostMemory::InFile, ..Selection::default() };
    let read = volume::open(&bricks, &selection, &Quiet).unwrap();
    Volume { slope: volume.slope, intercept: volume.intercept, ..read }
}

#[test]
fn films_of_bricks_in_a_file_are_films_of_voxels_in_memory_to_the_bit() {
    with_renderer(|renderer| {
        let folder = tempfile::tempdir().unwrap();
        // 16 bits whose differences are scaled by the largest of all, a falling slope, and floats.
        for (name, slope, interpolation, gradients) in [
            ("diffuse_one", 1.0, Interpolation::ExactLinear, Gradients::Packed),
            ("specular_three", -0.5, Interpolation::Cubic, Gradients::Central),
            ("floats", 1.0, Interpolation::ExactLinear, Gradients::Packed),
            ("narrow", 1.0, Interpolation::ExactLinear, Gradients::Packed),
            // The label map is in memory.
            ("labels", 1.0, Interpolation::ExactLinear, Gradients::Packed),
            ("nearest_labels", 1.0, Interpolation::Cubic, Gradients::Packed),
        ] {
            let mut scene =
                large(scenes::named(if matches!(name, "floats" | "narrow") { "diffuse_one" } else { name }));
            if name == "narrow" {
                // Steps jump over it, so that the plan takes segments.
                scene.accuracy.integration = Integration::Auto;
                for term in &mut scene.transfer.terms {
                    term.opacity = vec![(900.0, 0.0), (901.0, 0.9), (920.0, 0.9), (921.0, 0.0)];
                }
            }
            (scene.accuracy.interpolation, scene.accuracy.gradients) = (interpolation, gradients);
            let mut volume = (**scene.volume()).clone();
            (volume.slope, volume.intercept) = (slope, if slope < 0.0 { 33_000.0 } else { 0.0 });
            if let (Voxels::U16(stored), "floats") = (&volume.voxels, name) {
                // A part without numbers is as empty as in memory.
                let is_missing = |index: usize| index.is_multiple_of(3) || index < stored.len() / 4;
                let value = |(index, &value): (usize, &u16)| {
                    if is_missing(index) && value < 300 { f32::NAN } else { f32::from(value) + 0.25 }
                };
                volume.voxels = Voxels::F32(stored.iter().enumerate().map(value).collect());
            }
            scene.set_volume(Arc::new(volume));
            let stored = Arc::new(in_file(scene.volume(), folder.path()));
            let [one, other] = [Arc::clone(scene.volume()), Arc::clone(&stored)].map(|volume| {
                let scene = scene.clone().with_volume(volume);
                let planned = plan(&scene, &Quiet).unwrap().plan;
                assert!(name != "narrow" || planned.integration == Integrate::Segments, "{planned:?}");
                let renderer = renderer.clone().always_in_bricks().with_memory(12_000_000);
                let on_device = SceneRenderer::new(&renderer, scene, &Quiet).unwrap();
                let film = on_device.march(SIZE, &Quiet).unwrap();
                (on_device.uploaded().storage.clone(), film.occupied, film.bricks, renderer.read(&film).unwrap())
            });
            assert_eq!((&one.0, one.1, one.2), (&other.0, other.1, other.2), "{name}");
            assert!(bits(&one.3) == bits(&other.3), "{name}");
            assert!(one.3.transmittance.iter().any(|&passed| passed < 0.9), "{name}: the rays meet the volume");
            let counts = stored.bricks.as_ref().unwrap().counts();
            assert!(counts.loaded > 0 && counts.again == 0, "{name}: {counts:?}");
        }
    });
}

#[test]
fn bricks_stay_between_the_cameras_of_a_turntable_and_films_are_those_of_single_renders() {
    with_renderer(|renderer| {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = large(scenes::named("diffuse_one"));
        scene.set_volume(Arc::new(in_file(scene.volume(), folder.path())));
        scene.volume().prepare_coarse(&Quiet).unwrap();
        let cameras = turntable(&scene, &scene.camera, 1.2, 3).unwrap();
        for memory in [4_000_000, 100_000_000] {
            let renderer = renderer.clone().with_memory(memory);
            let turning = SceneRenderer::new(&renderer, scene.clone(), &Quiet).unwrap();
            let mut all = None::<BrickCounts>;
            for camera in &cameras {
                let mut turned = turning.clone();
                turned.camera_mut().clone_from(camera);
                let film = turned.march(SIZE, &Quiet).unwrap();
                all = all.into_iter().chain(film.bricks).reduce(BrickCounts::then);
                let single = Scene { camera: camera.clone(), ..scene.clone() };
                let single = SceneRenderer::new(&renderer, single, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
                assert!(bits(&renderer.read(&film).unwrap()) == bits(&renderer.read(&single).unwrap()), "{camera:?}");
            }
            let BrickCounts { visible, held, loaded, again, .. } = all.unwrap();
            assert!(loaded - again <= visible, "each is loaded once for the first time: {all:?}");
            assert_eq!((again == 0, loaded == visible), (held >= visible, held >= visible), "{all:?}");
        }
    });
}

#[test]
fn room_on_the_device_is_that_of_the_textures_and_of_other_volumes_beside_them() {
    with_renderer(|renderer| {
        let scene = scenes::named("labels");
        let whole = SceneRenderer::new(renderer, scene.clone(), &Quiet).unwrap();
        assert!(whole.planned().plan.labels && whole.uploaded().residence() == Residence::Whole);
        let bytes = whole.uploaded().bytes();
        let holds =
            |bytes: u64| renderer.clone().with_memory(bytes).holds_whole(&scene, whole.planned(), whole.statistics());
        assert!(holds(bytes) && !holds(bytes - 1));

        let heap = renderer.device().limits().device_heap_bytes;
        let (planned, statistics) = (whole.planned().clone(), whole.statistics().clone());
        let beside = SceneRenderer::with_plan(&renderer.beside(heap), scene, planned, statistics, &Quiet).unwrap();
        assert_eq!(beside.march(SIZE, &Quiet).unwrap_err().code(), "picture-memory-exceeded");
    });
}
