//! Films in 16 bits: as close to 32 bits as rounding permits on every rung, or refused.

use crate::support;

use relume::measure::extremes::metameric_black;
use relume::model::random::Random;
use relume::plan::{PlanError, Planned, ScenePlan, plan};
use relume::progress::Quiet;
use relume::scene::{AccumulateAs, Scene, StoreAs};
use relume::spectrum::colour::{XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::spectrum::{Reflectance, Spectrum};

use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE};

/// The scene `name` in 32 and in 16 bits with the same model, under lights that add up to a white of Y = 1.
fn both(name: &str) -> [Rungs; 2] {
    let mut scene = scenes::named(name);
    let total: f64 = scene.lights.iter().map(|light| light.intensity).sum();
    scene.lights.iter_mut().for_each(|light| light.intensity /= total);
    let full = Rungs::new(scene.clone(), SIZE);
    let plan = ScenePlan { storage: StoreAs::Half, ..full.planned.plan.clone() };
    let half = Rungs::planned(scene, Planned { plan, ..full.planned.clone() }, SIZE);
    [full, half]
}

/// Scenes, and their limits in docs/theory/acceptance.md C11; the last one has partly negative reflectances.
const SCENES: [(&str, f64); 7] = [
    ("diffuse_three", 0.1),
    ("specular_three", 0.1),
    ("background", 0.1),
    ("coloured_three", 0.1),
    ("coloured_background", 0.1),
    ("coloured_labels", 0.1),
    ("negative", 0.15),
];

#[test]
fn sixteen_bits_move_colours_by_no_more_than_is_said() {
    with_renderer(|renderer| {
        for (name, allowed) in SCENES {
            let rungs = both(name);
            let [full, half] = rungs.each_ref().map(|rungs| {
                let stored = rungs.gpu_accumulators(renderer);
                let shown = renderer.relight_linear(&stored).unwrap();
                shown.run(&rungs.matrices()).unwrap();
                let picture: Vec<[f32; 4]> = shown.read().unwrap();
                let lab = |&[r, g, b, _]: &[f32; 4]| {
                    let xyz = *XYZ_FROM_LINEAR_SRGB * glam::DVec3::from([r, g, b].map(f64::from));
                    lab_from_xyz(Xyz(xyz.to_array()), d65_white())
                };
                picture.iter().map(lab).collect::<Vec<_>>()
            });
            let worst = full.iter().zip(&half).map(|(&one, &other)| ciede2000(one, other)).fold(0.0, f64::max);
            let said = rungs[1].planned.half_precision_error(&rungs[1].scene).unwrap();
            // The two pictures are f32 themselves.
            assert!(worst <= said + 1e-3 && worst <= allowed, "{name}: ΔE00 {worst}, {said} is said");
            assert!(worst > 0.0, "{name}: something was rounded");
        }
    });
}

#[test]
fn a_pixel_takes_half_the_bytes() {
    let bytes = |name: &str| both(name).map(|rungs| rungs.planned.plan.pixel_bytes());
    // Three positions of k coefficients and the transmittance's k components: whole vectors of four.
    let [full, half] = bytes("coloured_three");
    assert_eq!(half * 2, full);
    // Three positions of one vector, and a transmittance that keeps its 4 bytes.
    assert_eq!(bytes("diffuse_three"), [3 * 16 + 4, 3 * 8 + 4]);
    let [full, half] = both("coloured_three").map(|rungs| rungs.planned.plan.marched_bytes());
    assert_eq!(2 * half, 3 * full, "both are there while one becomes the other");
}

#[test]
fn weights_of_materials_without_negative_colours_keep_their_bound() {
    let [_, half] = both("diffuse_three");
    let said = half.planned.half_precision_error(&half.scene).unwrap();
    assert!((0.1..0.5).contains(&said), "{said}");
    let mut random = Random::new(11);
    for _ in 0..20_000 {
        // A colour no brighter than white, with every coordinate off by at most 2⁻¹¹ of itself.
        let white = d65_white().0;
        let brightness = random.unit();
        let xyz = [0, 1, 2].map(|axis| white[axis] * brightness * random.unit());
        let off = xyz.map(|part| part * (1.0 + random.between(-1.0, 1.0) / 2048.0));
        let lab = |xyz| lab_from_xyz(Xyz(xyz), d65_white());
        let moved = ciede2000(lab(xyz), lab(off));
        assert!(moved <= said, "{xyz:?}: {moved}");
    }
}

/// Asserts that the plan of `scene` in 16 bits is refused.
fn refused(scene: &Scene) -> PlanError {
    let mut scene = scene.clone();
    scene.accuracy.storage = StoreAs::Half;
    plan(&scene, &Quiet).unwrap_err()
}

#[test]
fn what_would_show_is_refused_with_the_way_out() {
    let with = |name: &str, spectrum: Spectrum| {
        let mut scene = scenes::named(name);
        scene.materials[0].reflectance = Reflectance::new(spectrum).unwrap();
        scene.accuracy.dimension = Some(6);
        scene
    };
    // With weights, materials darker than black cancel others; with coefficients, a black of large amplitude does by
    // itself.
    let darker = with("unshaded_one", Spectrum::constant(-0.5));
    let mut black = with("unshaded_one", metameric_black(270.0));
    black.accuracy.accumulate = AccumulateAs::Spectral;
    for scene in [&darker, &black] {
        let error = refused(scene);
        let PlanError::HalfPrecision { error: most, tolerance, kept } = error else { panic!("{error}") };
        assert!(most > 1.0 && tolerance >= 1.0 && kept >= most, "{error}");
        let text = error.to_string();
        assert!(text.contains(&format!("{most:.2}")) && text.contains("storage = \"f32\""), "{text}");
        // The suggested tolerance is met.
        let mut scene = scene.clone();
        (scene.accuracy.storage, scene.accuracy.tolerance) = (StoreAs::Half, kept);
        let planned = plan(&scene, &Quiet).unwrap();
        assert!(planned.explain(&scene).iter().any(|sentence| sentence.contains("16 bits")), "{error}");
    }
    // With weights the same metameric black has no visible weight.
    black.accuracy.accumulate = AccumulateAs::Weights;
    black.accuracy.storage = StoreAs::Half;
    black.lights.iter_mut().for_each(|light| light.spectrum = relume::spectrum::standard::d65().clone());
    let error = plan(&black, &Quiet).unwrap().half_precision_error(&black).unwrap();
    assert!(error <= 1.0, "{error}");
}

/// Dense where it occludes little: its light adds up to 1/occludes of its reflectance.
#[test]
fn what_occludes_a_part_stays_below_its_bound() {
    let largest = |occludes: f64, opacity: f64| {
        let mut scene = scenes::named("unshaded_one");
        scene.accuracy.storage = StoreAs::Half;
        scene.materials.iter_mut().for_each(|material| material.occludes = occludes);
        scene.transfer.terms = vec![relume::scene::Term::interval(0, [f64::from(i16::MIN), 1e6], 0.0, opacity, 0.0)];
        let error = plan(&scene, &Quiet).map(|planned| planned.half_precision_error(&scene));
        let mut single = scene.clone();
        single.accuracy.storage = StoreAs::Single;
        let rungs = Rungs::new(single, [9, 9]);
        (rungs.march::<f64>(&rungs.exact()).accumulators.into_iter().fold(0.0, f64::max), error)
    };
    for (occludes, opacity) in [(0.5, 1.0), (0.01, 1.0), (0.01, 0.01), (0.0, 0.01)] {
        let (found, error) = largest(occludes, opacity);
        assert!(found > 0.1 && found <= (1.0 / occludes) * (1.0 + 1e-9), "{occludes}, {opacity}: {found}");
        assert!(error.is_ok(), "{occludes}, {opacity}: {error:?}");
    }
    let (found, error) = largest(1e-5, 1.0);
    assert!(found > 65504.0 && matches!(error, Err(PlanError::HalfRange)), "{found}: {error:?}");
}

#[test]
fn what_is_too_large_for_sixteen_bits_is_refused() {
    let mut huge = scenes::named("coloured_one");
    huge.materials[0].reflectance = Reflectance::new(metameric_black(1e6)).unwrap();
    huge.accuracy.dimension = Some(6);
    let mut bright = scenes::named("xray");
    bright.transfer.opacity_length = 1e-5;
    for scene in [huge, bright] {
        let error = refused(&scene);
        assert!(matches!(error, PlanError::HalfRange) && error.to_string().contains("65504"), "{error}");
    }
}

#[test]
fn a_scene_file_chooses() {
    let text = |storage: &str| format!("[accuracy]\nstorage = \"{storage}\"\n");
    let of = |storage: &str| scenes::of(&text(storage), scenes::slab([2, 2, 2], 0)).accuracy.storage;
    assert_eq!([of("f32"), of("f16")], [StoreAs::Single, StoreAs::Half]);
    assert_eq!(scenes::named("labels").accuracy.storage, StoreAs::Single);
}
