//! Light that scatters more than once: reference values of slabs and boxes, conservation and reciprocity, paths against rows.
#![expect(clippy::print_stdout, reason = "the errors of each case")]

use crate::shadows::{block, towards};
use crate::support;

use glam::DVec3;
use relume::measure::scattered_error;
use relume::plan::plan;
use relume::progress::Quiet;
use relume::reference::{GatheredLight, TransferRows};
use relume::render::SceneRenderer;
use relume::scene::{Aim, Mix, Orders, Placement, Projection, ScatteringMethod, Scene, ShadowMethod};
use relume::spectrum::{Absorption, Reflectance, Spectrum, standard};
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

/// Half spaces: the albedo, and H(0.2), H(0.5) and H(1) of Chandrasekhar (1950, chapter V).
const HALF_SPACES: [(f64, [f64; 3]); 2] =
    [(0.5, [1.113_461, 1.187_735, 1.251_260]), (0.9, [1.291_434, 1.556_034, 1.850_099])];

#[test]
fn paths_in_a_deep_slab_meet_the_closed_form_of_a_half_space() {
    for (albedo, of_cosines) in HALF_SPACES {
        for (cosine, h) in [0.2, 0.5, 1.0].into_iter().zip(of_cosines) {
            let mut scene = scattering(slab(20.0, cosine, false), albedo, Paths);
            scene.accuracy.step_length = 1.0 / 512.0;
            scene.scattering.paths = 4_000;
            let expected = albedo * cosine / (cosine + 1.0) * h * of_cosines[2];
            check(
                &format!("half space, cosine {cosine}, albedo {albedo}"),
                Paths,
                &light(scene, [4, 3]),
                expected,
                0.0,
            );
        }
    }
}

/// Each component has an albedo and a depth of its own.
#[test]
fn paths_and_rows_agree_in_a_slab_that_absorbs_in_colour() {
    let (depth, cosine) = (1.0, 0.8);
    let [white, _] = mean(&light(scattering(slab(depth, cosine, false), 1.0, Rows), [4, 3]));
    let found = [Paths, Rows].map(|method| {
        let mut scene = scattering(slab(depth, cosine, false), 1.0, method);
        let absorption = Spectrum::interpolate(&[(380.0, 0.0), (500.0, 0.2), (600.0, 0.7), (780.0, 1.0)]).unwrap();
        scene.materials[0].absorption = Some(Absorption::new(absorption).unwrap());
        scene.transfer.terms[0].absorption = vec![(0.0, depth)];
        // An eighth of the extinction of both.
        scene.scattering.spacing = Some(0.0625);
        let rungs = Rungs::new(scene, [4, 3]);
        let film = rungs.march(&rungs.exact());
        film.accumulators.chunks(12).map(|layer| mean(layer)[0]).collect::<Vec<f64>>()
    });
    println!("{found:?}; without absorption {white}");
    let [first, last] = [found[1][0], found[1][found[1].len() - 1]];
    assert!(first > 0.8 * white && last < 0.5 * white, "{first}, {last}, {white}");
    for (component, (paths, rows)) in found[0].iter().zip(&found[1]).enumerate() {
        assert!((paths / rows - 1.0).abs() <= 0.01, "component {component}: {paths} by paths, {rows} by rows");
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

/// Nodes and weights of Gauss and Legendre over 0 to 1.
const GAUSS: [[f64; 2]; 4] = [
    [0.069_431_844_202_973_71, 0.173_927_422_568_726_93],
    [0.330_009_478_207_571_87, 0.326_072_577_431_273_07],
    [0.669_990_521_792_428_1, 0.326_072_577_431_273_07],
    [0.930_568_155_797_026_3, 0.173_927_422_568_726_93],
];

#[test]
fn a_white_slab_loses_no_light() {
    let (depth, cosine) = (1.0, 0.8);
    for method in [Paths, Rows] {
        let through = f64::exp(-depth / cosine);
        // The mean of what leaves both faces over all directions, by the cosine, of a light of the mean intensity 1.
        let mut sum = through;
        for is_behind in [false, true] {
            for [seen, weight] in GAUSS {
                let mut scene = scattering(slab(depth, cosine, is_behind), 1.0, method);
                let eye = 40.0 * DVec3::new(0.0, (1.0 - seen * seen).sqrt(), -seen);
                scene.camera.aim = Aim::LookAt { position: eye, target: DVec3::ZERO };
                scene.camera.up = DVec3::X;
                scene.scattering.paths = 3_000;
                let [light, _] = mean(&light(scene, [4, 3]));
                sum += weight * seen * light / (2.0 * cosine);
            }
        }
        println!("{method:?}: {sum:.5} of the light leaves");
        assert!((sum - 1.0).abs() <= if method == Paths { 0.005 } else { 0.01 }, "{method:?}: {sum}");
    }
}

#[test]
fn eye_and_light_may_be_exchanged() {
    let [one, other] = [DVec3::new(0.3, -0.5, -0.8).normalize(), DVec3::new(-0.9, 0.2, 0.4).normalize()];
    for method in [Paths, Rows] {
        let picture = |eye: DVec3, light_from: DVec3| {
            let mut scene = scenes::changed("diffuse_one", "shading = \"none\"");
            let [low, high] = scene.frame.geometry.world_box().unwrap();
            let target = 0.5 * (low + high);
            scene.camera.projection = Projection::Orthographic { height: Some(60.0) };
            scene.camera.aim = Aim::LookAt { position: target + 100.0 * eye, target };
            scene.lights[0].placement = Placement::Directional(light_from);
            scene.lights[0].shadows = true;
            scene.shadows.method = ShadowMethod::Rays;
            scene.accuracy.termination = 0.0;
            let mut scene = scattering(scene, 0.9, method);
            (scene.scattering.spacing, scene.scattering.directions) = (Some(1.0), Some(16));
            scene.scattering.paths = 60;
            mean(&light(scene, [80, 80]))[0]
        };
        let [there, back] = [picture(one, other), picture(other, one)];
        println!("{method:?}: {there:.6} and {back:.6}, apart by {:+.3} %", 100.0 * (there / back - 1.0));
        assert!(
            (there / back - 1.0).abs() <= if method == Paths { 0.005 } else { 0.01 },
            "{method:?}: {there}, {back}"
        );
    }
}

#[test]
fn the_stated_error_is_that_of_nodes_and_of_directions() {
    let stated = |spacing: f64, directions: usize| {
        let mut scene = scenes::named("scattered");
        (scene.scattering.spacing, scene.scattering.directions) = (Some(spacing), Some(directions));
        scattered_error(&scene, &Mix::of_scene(&scene), [24, 20], &Quiet).unwrap().unwrap()
    };
    let [usual, finer, more] = [stated(2.0, 8), stated(1.0, 8), stated(2.0, 32)];
    println!("{usual:?}, with half the spacing {finer:?}, with four times the directions {more:?}");
    assert!(finer.nodes < 0.5 * usual.nodes, "{finer:?}, {usual:?}");
    assert!(more.directions < 0.7 * usual.directions && more.directions > 0.0, "{more:?}, {usual:?}");
    for stated in [usual, finer, more] {
        let of_both = 1.25 * (stated.nodes + stated.directions) + 0.1;
        assert!(stated.p95 >= stated.nodes.max(stated.directions) && stated.p95 <= of_both, "{stated:?}");
    }
    let once = scenes::named("unshaded_one");
    assert_eq!(scattered_error(&once, &Mix::of_scene(&once), [24, 20], &Quiet).unwrap(), None);
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
fn scattered_light_is_none_then_rough_and_then_full_and_may_be_given_up_before() {
    use relume::render::LightQuality::{self, Full, Last, Rough};
    with_renderer(|renderer| {
        let size = [24, 20];
        let mut scene = scenes::named("scattered");
        (scene.scattering.spacing, scene.scattering.directions) = (Some(1.0), Some(8));
        // Pictures on the way have a coarser light grid, too.
        scene.shadows.spacing = 0.5;
        let on_device = SceneRenderer::new(renderer, scene.clone(), &Quiet).unwrap();
        let begun = |on_device: &SceneRenderer, quality: LightQuality| {
            let march = on_device.begin_march_of_one_ray(size, renderer.speed(), quality).unwrap();
            (march.scattered_light().unwrap(), march)
        };
        let picture = |on_device: &SceneRenderer, quality: LightQuality| {
            let (found, mut march) = begun(on_device, quality);
            while !march.is_done() {
                march.step(renderer, on_device.uploaded()).unwrap();
            }
            let film = renderer.read(&march.finish(renderer).unwrap()).unwrap();
            (found, film.accumulators)
        };
        let sum = |film: &[f32]| film.iter().copied().map(f64::from).sum::<f64>();
        let (quality, none) = picture(&on_device, Last);
        assert_eq!(quality, Last);
        // A turn of the view cancels what is not done.
        for quality in [Rough, Full] {
            let (found, mut march) = begun(&on_device, quality);
            assert!(found == quality && march.gathering().is_some());
            march.step(renderer, on_device.uploaded()).unwrap();
        }
        let (quality, rough) = picture(&on_device, Rough);
        assert_eq!(quality, Rough);
        assert_eq!(picture(&on_device, Last), (Rough, rough.clone()), "the last light");
        let (quality, full) = picture(&on_device, Full);
        assert_eq!(quality, Full);
        assert_eq!(picture(&on_device, Rough), (Full, full.clone()), "better light is there");
        let [none, rough, full] = [none, rough, full].map(|film| sum(&film));
        println!("light of the picture: once {none:.1}, rough {rough:.1}, full {full:.1}");
        assert!(none < 0.9 * full && (rough / full - 1.0).abs() < 0.05, "{none}, {rough}, {full}");
        // From the rows that are there, new reflectances are full light at once.
        scene.materials[0].reflectance = Reflectance::new(Spectrum::constant(0.3)).unwrap();
        let planned = plan(&scene, &Quiet).unwrap();
        let other = on_device.with_scene(scene, planned, &Quiet).unwrap();
        assert_eq!(picture(&other, Rough).0, Full);
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
