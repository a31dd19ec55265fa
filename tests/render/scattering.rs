//! Light that scatters more than once: reference values of slabs and boxes, conservation and reciprocity, paths against rows.
#![expect(clippy::print_stdout, reason = "the errors of each case")]

use crate::shadows::{block, towards};
use crate::support;

use glam::DVec3;
use relume::plan::plan;
use relume::progress::Quiet;
use relume::reference::{GatheredLight, TransferRows};
use relume::render::SceneRenderer;
use relume::scene::{Orders, Placement, ScatteringMethod, Scene, ShadowMethod};
use relume::spectrum::{Reflectance, Spectrum, standard};
use relume::tables::Storage;
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, float};

use ScatteringMethod::{Paths, Rows};

/// `scene` with materials of this albedo, in which light scatters often.
fn scattering(mut scene: Scene, albedo: f64, method: ScatteringMethod) -> Scene {
    for material in &mut scene.materials {
        material.reflectance = Reflectance::new(Spectrum::constant(albedo)).unwrap();
    }
    scene.scattering.orders = Orders::Multiple;
    scene.scattering.method = method;
    scene
}

/// The first component of the pixels of a picture.
fn light(scene: Scene, size: [usize; 2]) -> Vec<f64> {
    let rungs = Rungs::new(scene, size);
    rungs.march(&rungs.exact()).accumulators[..size[0] * size[1]].to_vec()
}

/// Mean of `numbers`, and its standard error.
fn mean(numbers: &[f64]) -> [f64; 2] {
    let count = float(numbers.len());
    let mean = numbers.iter().sum::<f64>() / count;
    let variance = numbers.iter().map(|number| (number - mean).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    [mean, (variance / count).sqrt()]
}

/// Asserts that paths differ from `expected` by at most half a percent or four standard errors, and rows by at most `of_rows`.
fn check(what: &str, method: ScatteringMethod, found: &[f64], expected: f64, of_rows: f64) {
    let [found, error] = mean(found);
    let apart = found / expected - 1.0;
    let limit = match method {
        Paths => (4.0 * error / expected).max(0.005),
        Rows => of_rows,
    };
    println!("{what}, {method:?}: {:+.3} %, standard error {:.3} %", 100.0 * apart, 100.0 * error / expected);
    assert!(apart.abs() <= limit, "{what}, {method:?}: {found}, not {expected}");
    // Of a slab, all pixels are alike.
    assert!(method == Rows || error < 0.005 * expected, "{what}: the paths are too few to tell");
}

/// Slabs: depth, cosine of the light, whether it is behind, and the light of all orders at albedos of 0.5, 0.9 and 1
/// (docs/theory/scattering.md).
const SLABS: [(f64, f64, bool, [f64; 3]); 6] = [
    (0.5, 1.0, false, [0.202_420, 0.471_079, 0.565_012]),
    (0.5, 1.0, true, [0.195_447, 0.457_547, 0.549_676]),
    (2.0, 1.0, false, [0.375_611, 1.261_797, 1.839_014]),
    (2.0, 1.0, true, [0.231_659, 0.915_072, 1.417_447]),
    (2.0, 0.5, false, [0.244_756, 0.775_097, 1.103_142]),
    (2.0, 0.5, true, [0.104_697, 0.439_808, 0.696_213]),
];

fn slab(depth: f64, cosine: f64, is_behind: bool) -> Scene {
    let sine = (1.0_f64 - cosine * cosine).sqrt();
    let side = if is_behind { cosine } else { -cosine };
    let mut scene = block(DVec3::new(60.0, 60.0, 1.0), depth, &towards([sine, 0.0, side]), 1.0 / 64.0, 1.0);
    scene.scattering.spacing = Some(0.25 / depth);
    scene.scattering.directions = Some(64);
    scene.scattering.paths = 8_000;
    scene
}

#[test]
fn a_slab_scatters_all_orders_as_its_reference_says() {
    for (depth, cosine, is_behind, expected) in SLABS {
        for (albedo, expected) in [0.5, 0.9, 1.0].into_iter().zip(expected) {
            for method in [Paths, Rows] {
                let scene = scattering(slab(depth, cosine, is_behind), albedo, method);
                let what = format!("depth {depth}, cosine {cosine}, behind {is_behind}, albedo {albedo}");
                check(&what, method, &light(scene, [4, 3]), expected, 0.01);
            }
        }
    }
}

/// Boxes of the depth 2 along each edge: direction of the light, and the mean of the face at albedos of 0.5, 0.9 and 0.99, by
/// Mitsuba 3.9's path tracer; standard errors below 0.05 %.
const BOXES: [([f64; 3], [f64; 3]); 2] =
    [([0.0, 0.0, -1.0], [0.321_83, 0.786_27, 0.944_39]), ([0.6, 0.0, -0.8], [0.325_95, 0.796_28, 0.956_54])];

/// The box [-1, 1]³ of an extinction of 1, whose face fills the picture.
fn cube(direction: [f64; 3]) -> Scene {
    let mut scene = block(DVec3::splat(2.0), 1.0, &towards(direction), 1.0 / 64.0, 2.0);
    // Voxels are 2 units apart.
    scene.scattering.spacing = Some(0.125);
    scene.scattering.directions = Some(32);
    scene.scattering.paths = 1_000;
    scene
}

#[test]
fn a_box_scatters_all_orders_as_an_independent_path_tracer_says() {
    for (direction, expected) in BOXES {
        for (albedo, expected) in [0.5, 0.9, 0.99].into_iter().zip(expected) {
            for method in [Paths, Rows] {
                let scene = scattering(cube(direction), albedo, method);
                let what = format!("light {direction:?}, albedo {albedo}");
                let [found, _] = mean(&light(scene, [16, 16]));
                let apart = found / expected - 1.0;
                println!("{what}, {method:?}: {:+.3} %", 100.0 * apart);
                assert!(apart.abs() <= if method == Paths { 0.005 } else { 0.01 }, "{what}, {method:?}: {found}");
            }
        }
    }
}

#[test]
fn everything_is_white_in_a_white_furnace() {
    let sky = "kind = \"ambient\"";
    let [mut even, mut balls] = [
        block(DVec3::splat(2.0), 1.0, sky, 1.0 / 64.0, 3.0),
        scenes::changed("unshaded_one", "transfer.opacity_length = 4"),
    ];
    balls.lights[0].placement = Placement::Ambient;
    even.scattering.spacing = Some(0.0625);
    balls.scattering.spacing = Some(1.5);
    // No ray runs along a face, where light falls steeply from one half of a cell to the next.
    even.camera = balls.camera.clone();
    for (name, mut scene) in [("box", even), ("balls", balls)] {
        scene.background = Some(Reflectance::new(Spectrum::constant(1.0)).unwrap());
        scene.shadows.method = ShadowMethod::Grid;
        scene.shadows.spacing = if name == "box" { 0.0625 } else { 1.0 };
        scene.scattering.directions = Some(64);
        let size = [16, 14];
        let rungs = Rungs::new(scattering(scene, 1.0, Rows), size);
        let film = rungs.march(&rungs.exact());
        let pixels = size[0] * size[1];
        let seen: Vec<f64> =
            film.accumulators[..pixels].iter().zip(&film.transmittance).map(|(light, left)| light + left).collect();
        let [mean, _] = mean(&seen);
        let (low, high) = seen.iter().fold((f64::MAX, f64::MIN), |(low, high), &it| (low.min(it), high.max(it)));
        println!("{name}: mean {mean:.4}, from {low:.4} to {high:.4}");
        assert!((mean - 1.0).abs() <= 0.005, "{name}: mean {mean}");
        assert!(low >= 0.98 && high <= 1.02, "{name}: from {low} to {high}");
    }
}

/// Rows of a scene, and the light that they gather.
fn gathered(scene: &Scene) -> (TransferRows, GatheredLight) {
    let rungs = Rungs::new(scene.clone(), [4, 4]);
    let storage = Storage::new(&rungs.planned.plan, scene.volume(), &scene.volume().statistics().unwrap());
    let rows = TransferRows::new(scene, &rungs.planned, &storage, None, &Quiet).unwrap();
    let light = rows.light(scene, &rungs.planned, &Quiet).unwrap();
    (rows, light)
}

#[test]
fn scattered_light_depends_on_no_light_spectrum_and_its_rows_on_no_reflectance() {
    let scene = scenes::named("scattered");
    let (rows, light) = gathered(&scene);
    let same = |change: &dyn Fn(&mut Scene)| {
        let mut changed = scene.clone();
        change(&mut changed);
        let planned = plan(&changed, &Quiet).unwrap();
        rows.are_of(&changed, &planned)
    };
    assert!(same(&|_| {}));
    assert!(same(&|scene| scene.lights[0].spectrum = standard::light("A").unwrap()));
    assert!(same(&|scene| scene.lights[0].intensity = 7.0));
    assert!(same(&|scene| scene.materials[0].reflectance = Reflectance::new(Spectrum::constant(0.3)).unwrap()));
    assert!(same(&|scene| scene.accuracy.step_length = 0.5));
    assert!(same(&|scene| scene.camera.aim = scenes::named("unshaded_one").camera.aim));
    let other = |change: &dyn Fn(&mut Scene)| !same(change);
    assert!(other(&|scene| scene.lights[0].placement = Placement::Directional(DVec3::X)));
    assert!(other(&|scene| scene.transfer.terms[0].opacity[1].1 *= 0.5));
    assert!(other(&|scene| scene.crop = Some([DVec3::splat(2.0), DVec3::splat(20.0)])));
    assert!(other(&|scene| scene.materials[0].occludes = 0.5));
    assert!(other(&|scene| scene.scattering.directions = Some(6)));
    // To the bit, under another light and on one thread.
    let mut lamp = scene.clone();
    lamp.lights[0].intensity = 1e-6;
    assert_eq!(gathered(&lamp).1, light);
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(single.install(|| gathered(&scene)).1, light);
}

#[test]
fn scattering_that_cannot_be_told_is_refused_with_its_reason_and_what_else_to_do() {
    let refused = |name: &str, changes: &str, words: &[&str]| {
        let scene = scenes::changed(name, &format!("scattering.orders = \"multiple\"\n{changes}"));
        let error = plan(&scene, &Quiet).unwrap_err().to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{name}, {changes}: {error}");
    };
    let orders = "scattering.orders = \"multiple\"";
    refused("unshaded_one", "materials.core.reflectance = 1.25", &[orders, "core", "1.25 times", "at most 1"]);
    refused("unshaded_one", "materials.shell.phase = -0.5", &[orders, "materials.shell.phase = -0.5", "-0.3 to 0.3"]);
    refused("unshaded_one", "accuracy.accumulate = \"weights\"", &[orders, "accumulate = \"auto\""]);
    refused("unshaded_one", "accuracy.model = \"peercy\"", &[orders, "peercy", "another model"]);
    // Every light casts shadows, and a sky does not through coloured media.
    refused("coloured_three", "", &[orders, "light of a sky"]);
    let many: Vec<String> = (0..64)
        .map(|i| format!("lights.more{i} = {{ spectrum = \"A\", kind = \"directional\", direction = [1, {i}, 3] }}"))
        .collect();
    refused("unshaded_one", &many.join("\n"), &[orders, "65 directions", "at most 16"]);
}

#[test]
fn scattered_light_beyond_the_free_memory_is_refused_with_its_size() {
    let mut scene = scenes::named("scattered");
    scene.scattering.spacing = Some(1e-4);
    let planned = plan(&scene, &Quiet).unwrap();
    let storage = Storage::new(&planned.plan, scene.volume(), &scene.volume().statistics().unwrap());
    let error = TransferRows::new(&scene, &planned, &storage, None, &Quiet).unwrap_err().to_string();
    assert!(error.contains("0.0001 voxels apart") && error.contains("set a larger scattering.spacing"), "{error}");
}

#[test]
fn a_device_without_room_for_scattered_light_says_what_to_change() {
    with_renderer(|renderer| {
        let mut scene = scenes::named("scattered");
        scene.scattering.spacing = Some(0.01);
        let error = SceneRenderer::new(renderer, scene, &Quiet).unwrap().march([4, 4], &Quiet).unwrap_err().to_string();
        assert!(error.contains("0.01 voxels apart") && error.contains("set a larger scattering.spacing"), "{error}");
    });
}

#[test]
fn a_single_ray_has_the_paths_of_a_picture() {
    let mut scene = scenes::named("scattered");
    scene.scattering.method = Paths;
    let size = [5, 5];
    let rungs = Rungs::new(scene.clone(), size);
    let film = rungs.march(&rungs.exact());
    let middle = [2, 2];
    let ray =
        relume::reference::march_ray(&scene, &rungs.planned, &rungs.exact(), [size, middle], &Quiet, |_| {}).unwrap();
    for (layer, light) in ray.accumulators.iter().enumerate() {
        assert_eq!(light.to_bits(), film.accumulators[layer * 25 + 12].to_bits(), "number {layer}");
    }
    assert!(ray.accumulators.iter().any(|light| *light > 0.0));
}

#[test]
fn a_plan_says_that_light_scatters_often_and_what_that_costs() {
    let told = |name: &str| {
        let scene = scenes::named(name);
        plan(&scene, &Quiet).unwrap().explain(&scene).join("\n")
    };
    let lit = told("scattered_lit");
    for words in
        ["any number of times", "4 voxels apart", "from 4 directions", "turns with the camera", "no exact weights"]
    {
        assert!(lit.contains(words), "{words}: {lit}");
    }
    assert!(!lit.contains("would be exact"), "{lit}");
    assert!(!told("scattered").contains("turns with the camera"));
    assert!(!told("unshaded_one").contains("any number of times"));
    let maximum = scenes::changed("scattered", "blending = \"maximum\"");
    let warnings: Vec<String> = plan(&maximum, &Quiet).unwrap().warnings.iter().map(ToString::to_string).collect();
    assert!(
        warnings.iter().any(|it| it.contains("scattering.orders has no effect") || it.contains(", scattering.orders")),
        "{warnings:?}"
    );
}
