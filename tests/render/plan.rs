//! Plans contain exactly the features a scene needs; unneeded features change no picture.

use crate::matrix::features;
use crate::support;

use glam::DVec3;
use relume::plan::{Accumulate, plan};
use relume::progress::Quiet;
use relume::scene::{AccumulateAs, Backdrop, Interpolation, Lookup, Placement, Scene, Shading};
use relume::spectrum::{Reflectance, Spectrum};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE, float};

/// Plans of changed scenes: each has the features that the scene needs, and no other. `tests/scenes.toml` has more.
const PLANS: [(&str, &str, &str); 37] = [
    // Shading that is switched off costs nothing.
    ("specular_one", "shading = 'none'", LEAST),
    ("unshaded_one", "accuracy.storage = 'f16'", "3 weights; light ambient; Half"),
    // Two-sided diffuse shading is equal for opposite directions, highlights and one-sided shading are not.
    ("diffuse_one", SAME, "3 weights; light direction; diffuse"),
    ("diffuse_one", OPPOSITE, "3 weights; light direction; diffuse"),
    ("shiny", OPPOSITE, "3 weights; light direction, direction; diffuse; exponent 20"),
    ("one-sided", OPPOSITE, "3 weights; light direction, direction; diffuse; one-sided"),
    ("diffuse_one", "lighting = 'one_sided'", "3 weights; light direction; diffuse; one-sided"),
    // Materials without a diffuse part need no gradient, and white ones no direction.
    ("flat", "", "3 weights; light eye; flat"),
    ("flat", "materials.core.ambient = 1\nmaterials.middle.ambient = 1\nmaterials.shell.ambient = 1", LEAST),
    // Nor does ambient light.
    ("specular_one", "lights.lamp = { spectrum = 'A', kind = 'ambient' }", LEAST),
    // A single exponent is compiled in: a pipeline for 20 does not serve 21.
    ("shiny", "materials.core.exponent = 21", "3 weights; light direction; diffuse; exponent 21"),
    // Labels that are not declared are as if they were not there.
    ("labels", "labels = {}", "1 weights; light direction; diffuse"),
    ("unshaded_one", "accuracy.volume = 'f32'", "3 weights; light ambient; Single"),
    ("unshaded_one", "accuracy.skipping = false", "3 weights; light ambient; unskipped"),
    ("unshaded_one", "accuracy.interpolation = 'nearest'", "3 weights; light ambient; Nearest"),
    ("unshaded_one", "transfer.lookup = 'nearest'", "3 weights; light ambient; nearest entry"),
    // Gradients are taken from samples only where there are any.
    ("unshaded_one", "accuracy.gradients = 'central'", LEAST),
    ("diffuse_one", "accuracy.gradients = 'central'", "3 weights; light direction; diffuse; Central"),
    ("unshaded_one", "transfer.gradient_opacity = [[0, 0], [100, 1]]", "3 weights; light ambient; thinned at 2"),
    ("unshaded_one", THIN_CENTRAL, "3 weights; light ambient; thinned at 1; Central"),
    // What nothing shows is left out, and splits no position.
    ("two", "", "2 weights; light ambient"),
    (
        "two",
        "shading = 'gradient'\nmaterials.core.diffuse = 0\nmaterials.shell.diffuse = 0",
        "2 weights; light eye; flat",
    ),
    ("diffuse_one", "lights = {}", "3 weights; light "),
    // All three-point lights share one position with three vectors.
    ("diffuse_one", THREE_POINT, "3 weights; light direction+direction+direction; diffuse"),
    ("unshaded_one", THREE_POINT, LEAST),
    ("diffuse_three", "shading = 'none'", LEAST),
    // Phase functions keep directions apart, of opposite lights too, but not ambient light; shading by gradients ignores them.
    ("phases_one", OPPOSITE, "3 weights; light direction, direction; 3 phases"),
    ("phases_one", "lights.key = { spectrum = 'D65', kind = 'ambient' }", LEAST),
    ("diffuse_three", "materials.core.phase = 0.6", "3 weights; light eye, direction, point; diffuse"),
    // Shadows keep positions apart that share a shade without them; a light without shadows folds.
    ("shadows_unshaded", BEHIND, "1 weights; light direction behind 0, direction behind 1"),
    ("one of two", BEHIND, "1 weights; light ambient, direction behind 0"),
    ("one of two", STUDIO, "1 weights; light ambient, direction behind 0+direction behind 1+direction behind 2"),
    // Ambient shares alone have no shadows, unless they are occluded and there are any.
    ("dark", STUDIO, "1 weights; light eye; flat"),
    ("occluded", STUDIO, "1 weights; light eye; occluded; flat"),
    ("occluded", "materials.large.ambient = 0", "1 weights; light eye; flat"),
    ("one of two", SKIES, "1 weights; light ambient, ambient behind 0"),
    ("shadows_unshaded", POINT, "1 weights; light ambient behind 1, point behind 0"),
];

/// Smallest plan for three materials: unshaded, one position, nothing else.
const LEAST: &str = "3 weights; light ambient";
const SAME: &str = "lights.second = { spectrum = 'A', kind = 'directional', direction = [-0.5, -0.8, -0.4] }";
const OPPOSITE: &str = "lights.second = { spectrum = 'A', kind = 'directional', direction = [0.5, 0.8, 0.4] }";
const THIN_CENTRAL: &str = "transfer.gradient_opacity = [[50, 0.5]]\naccuracy.gradients = 'central'";
const THREE_POINT: &str =
    "lights.key = { spectrum = 'D65', kind = 'three_point' }\nlights.b = { spectrum = 'A', kind = 'three_point' }";

const BEHIND: &str = "lights.lamp.direction = [-0.1, 0.4, -1]";
const STUDIO: &str = "lights.lamp = { spectrum = 'A', shadows = true, kind = 'three_point' }";
const SKIES: &str = "lights.day = { spectrum = 'D65', kind = 'ambient' }\n\
                     lights.lamp = { spectrum = 'A', shadows = true, kind = 'ambient' }";
const POINT: &str = "lights.day = { spectrum = 'D65', shadows = true, kind = 'point', position = [1, 1, 1] }\n\
                     lights.lamp = { spectrum = 'A', shadows = true, kind = 'ambient' }";

#[test]
fn plans_have_the_features_that_their_scenes_need() {
    for (name, changes, expected) in PLANS {
        let (name, more) = match name {
            "shiny" => ("diffuse_one", "materials.core.specular = 0.5"),
            "one-sided" => ("diffuse_one", "lighting = 'one_sided'"),
            "flat" => (
                "diffuse_three",
                "materials.core.diffuse = 0\nmaterials.middle.diffuse = 0\nmaterials.shell.diffuse = 0",
            ),
            "two" => (
                "unshaded_three",
                "materials.middle.specular = 1\ntransfer.intervals = [{ material = 'core', range = [44000, 70000], opacity = 0.6 }, \
                 { material = 'shell', range = [9000, 13000], opacity = 0.06 }]",
            ),
            "one of two" => ("shadows_unshaded", "lights.day.shadows = false"),
            "dark" => ("shadows_gradient", "materials.large.diffuse = 0\nlights.day.shadows = false"),
            "occluded" => ("shadows_ambient", "materials.large.diffuse = 0\nlights.day.shadows = false"),
            _ => (name, ""),
        };
        let scene = scenes::changed(name, [more, changes].join("\n").trim_matches('\n'));
        assert_eq!(features(&plan(&scene, &Quiet).unwrap().plan), expected, "{name}: {more} {changes}");
    }
}

#[test]
fn components_and_parts_of_entries_are_whole_lanes() {
    let plan = plan(&scenes::named("specular_three"), &Quiet).unwrap().plan;
    assert_eq!((plan.components(), plan.lanes(), plan.parts().lanes, plan.layers()), (5, 2, 1, 8));
}

/// The scene of three materials with `more` mixtures of the first `spectra` of them.
fn with_mixtures(more: usize, spectra: usize) -> Scene {
    let mut scene = scenes::named("unshaded_one");
    let own: Vec<Spectrum> = scene.materials.iter().map(|it| it.reflectance.spectrum().clone()).collect();
    for index in 0..more {
        let share = float(index + 1) / float(more + 1);
        let mixed = &own[index % spectra].scaled(share) + &own[(index + 1) % spectra].scaled(1.0 - share);
        let mut material = scene.materials[0].clone();
        (material.name, material.reflectance) = (format!("more {index}"), Reflectance::new(mixed).unwrap());
        let mut term = scene.transfer.terms[0].clone();
        term.material.0.iter_mut().for_each(|point| point.1 = scene.materials.len());
        scene.materials.push(material);
        scene.transfer.terms.push(term);
    }
    scene
}

#[test]
fn weights_are_kept_where_they_are_no_wider() {
    let accumulate = |scene: &Scene| plan(scene, &Quiet).unwrap().plan.accumulate;
    assert_eq!(accumulate(&with_mixtures(1, 3)), Accumulate::Weights { materials: 4 });
    // Three spectra need three coefficients, however many mixtures of them there are.
    for more in [2, 7] {
        let planned = plan(&with_mixtures(more, 3), &Quiet).unwrap();
        let Accumulate::Spectral { dimension, .. } = planned.plan.accumulate else { panic!("{:?}", planned.plan) };
        assert!(dimension <= 4 && planned.plan.lanes() == 1, "{:?}", planned.plan);
        let model = planned.model.as_ref().unwrap();
        assert!(model.worst().max <= 1.0, "{:?}", model.worst());
        let said = planned.explain(&with_mixtures(more, 3)).join(" ");
        assert!(said.contains("would be exact") && said.contains("need 10 numbers") == (more == 7), "{said}");
    }
    // Explicitly requested weights are used.
    let mut scene = with_mixtures(7, 3);
    scene.accuracy.accumulate = AccumulateAs::Weights;
    assert_eq!(accumulate(&scene), Accumulate::Weights { materials: 10 });
    // A given k is used only if it needs fewer components.
    scene.accuracy.accumulate = AccumulateAs::Auto;
    for (k, weights) in [(3, false), (8, false), (9, true), (12, true)] {
        scene.accuracy.dimension = Some(k);
        let found = accumulate(&scene);
        assert_eq!(matches!(found, Accumulate::Weights { .. }), weights, "k = {k}: {found:?}");
    }
}

#[test]
fn weights_are_kept_where_narrower_numbers_miss_the_tolerance() {
    // Separate narrow bands: as many degrees of freedom as materials.
    let mut scene = with_mixtures(3, 3);
    for (index, material) in scene.materials.iter_mut().enumerate() {
        let band = Spectrum::gaussian(430.0 + 45.0 * float(index), 12.0, 0.9).unwrap();
        material.reflectance = Reflectance::new(band).unwrap();
    }
    scene.accuracy.tolerance = 0.1;
    let planned = plan(&scene, &Quiet).unwrap();
    assert_eq!(planned.plan.accumulate, Accumulate::Weights { materials: 6 });
    let said = planned.explain(&scene).join(" ");
    assert!(said.contains("half of the tolerance of 0.1"), "{said}");
}

#[test]
fn a_plan_says_how_the_volume_and_its_table_are_read() {
    let explained = |change: fn(&mut Scene)| {
        let mut scene = scenes::named("unshaded_one");
        change(&mut scene);
        plan(&scene, &Quiet).unwrap().explain(&scene).join(" ")
    };
    let usual = explained(|_| {});
    assert_eq!(usual.matches("interpolated linearly").count(), 2, "values and transfer function: {usual}");
    let nearest = explained(|scene| scene.accuracy.interpolation = Interpolation::Nearest);
    assert!(nearest.contains("nearest voxel"), "{nearest}");
    let shown = explained(|scene| scene.display.backdrop = Backdrop::Dark);
    assert!(shown.contains("dark backdrop") && !shown.contains("is black"), "{shown}");
    let hidden = explained(|scene| {
        scene.display.backdrop = Backdrop::Dark;
        scene.background = Some(Reflectance::new(Spectrum::constant(0.5)).unwrap());
    });
    assert!(hidden.contains("hides the backdrop"), "{hidden}");
    for (name, expected) in [("slices_placed", true), ("slices_fields", false), ("placed_two", false)] {
        let scene = scenes::named(name);
        let said = plan(&scene, &Quiet).unwrap().explain(&scene).join(" ");
        assert_eq!(said.contains("own are interpolated linearly"), expected, "{name}: {said}");
    }
    let entry = explained(|scene| scene.transfer.lookup = Lookup::Nearest);
    assert!(entry.contains("in small steps"), "{entry}");
    let thin = explained(|scene| scene.accuracy.step_length = 1e-9);
    assert!(thin.contains("in steps of 1e-9 ("), "{thin}");
}

#[test]
fn a_scene_that_shows_nothing_has_no_components() {
    let mut scene = scenes::named("diffuse_one");
    scene.transfer.terms.clear();
    let plan = plan(&scene, &Quiet).unwrap().plan;
    assert_eq!((plan.components(), plan.shading), (0, None));
}

/// The smallest plan of a scene and the largest, with every feature enabled but without effect, give one picture.
#[test]
fn the_least_plan_and_the_fullest_show_the_same() {
    let least = Rungs::new(scenes::named("unshaded_one"), SIZE);
    let mut scene = scenes::named("unshaded_one");
    // Shading that does not depend on directions; a material with negligible highlights, a light of intensity 0, labels
    // that
    // are all 0, a background that is black in f32, and no empty-space skipping.
    scene.shading = Shading::Gradient;
    scene.accuracy.skipping = false;
    scene.lights[0].placement = Placement::Ambient;
    let mut lamp = scene.lights[0].clone();
    (lamp.name, lamp.intensity) = ("unlit".into(), 0.0);
    for placement in
        [Placement::Headlight, Placement::Directional(DVec3::X), Placement::Point(DVec3::new(-50.0, 0.0, 0.0))]
    {
        lamp.placement = placement;
        lamp.name.push('x');
        scene.lights.push(lamp.clone());
    }
    for (material, exponent) in scene.materials.iter_mut().zip([3, 5, 70]) {
        (material.specular, material.exponent) = (0.5, exponent);
    }
    scene.background = Some(Reflectance::new(Spectrum::constant(1e-30)).unwrap());
    let dims = scene.frame.geometry.dims;
    let zeros = relume::volume::phantom::slab(dims, 0).unwrap();
    let entry = relume::scene::LabelEntry {
        label: 9,
        name: "nowhere".into(),
        material: 0,
        opacity: 0.5,
        absorption: 0.0,
        terms: Vec::new(),
    };
    scene.labels = Some(relume::scene::Labels { volume: std::sync::Arc::new(zeros), declared: vec![entry] });
    let fullest = Rungs::new(scene, SIZE);
    let expected =
        "3 weights; light ambient, eye, direction, point; diffuse; exponents of 7 bits; labels; background; unskipped";
    assert_eq!(features(&fullest.planned.plan), expected);

    with_renderer(|renderer| {
        let picture = |rungs: &Rungs| -> Vec<[f32; 4]> {
            let marched = rungs.gpu_accumulators(renderer);
            let relight = renderer.relight_linear(&marched).unwrap();
            relight.run(&rungs.matrices()).unwrap();
            relight.read().unwrap()
        };
        // Next to gradients, values have 15 bits and lose one half-space: an error of half a step of 2⁻¹⁵, which the
        // steepest ramp
        // (opacity 0.6 in 8000 of 65535) turns into 1.3e-4 per step; some ten steps see a ramp.
        let limit = 0.6 / 8000.0 * fullest.storage.loss * 10.0 + 1e-5;
        let mut error = 0.0_f64;
        for (least, fullest) in picture(&least).iter().zip(picture(&fullest)) {
            for (one, other) in least.iter().zip(fullest) {
                error = error.max(f64::from(one - other).abs());
            }
        }
        assert!(error <= limit, "{error} > {limit}, {} pixels", float(SIZE[0] * SIZE[1]));
    });
}

#[test]
fn a_factor_by_the_gradient_has_the_gradient_beside_the_values() {
    let scene = scenes::named("thinned_unshaded_one");
    assert!(plan(&scene, &Quiet).unwrap().plan.stores_gradient());
}

#[test]
fn a_factor_by_the_gradient_is_refused_with_a_matrix_of_transmittance() {
    let mut scene = scenes::named("coloured_one");
    scene.accuracy.model = relume::model::ModelKind::Peercy;
    scene.accuracy.dimension = Some(3);
    assert!(plan(&scene, &Quiet).is_ok(), "the matrix alone");
    scene.transfer.gradient_opacity = vec![(0.0, 0.0), (100.0, 1.0)];
    let error = plan(&scene, &Quiet).unwrap_err();
    assert_eq!(error.code(), "gradient-opacity-matrix");
    assert!(error.to_string().contains("peercy") && error.to_string().contains("gradient_opacity"), "{error}");
}
