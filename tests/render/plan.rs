//! Plans contain exactly the features a scene needs; unneeded features change no picture.

use crate::support;

use glam::DVec3;
use relume::plan::{
    Accumulate, Arrival, FilmCounts, Integrate, LightPlan, ScenePlan, ShadingTerms, Share, Specular, Transmittance,
    plan,
};
use relume::progress::Quiet;
use relume::scene::{
    AccumulateAs, Direction, Gradients, Interpolation, LabelInterpolation, Lighting, Lookup, Placement, Scene, Shading,
    StoreAs, VolumeAs,
};
use relume::spectrum::{Reflectance, Spectrum};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE, float};

/// Smallest plan for three materials: unshaded, one position, nothing else.
fn least() -> ScenePlan {
    ScenePlan {
        accumulate: Accumulate::Weights { materials: 3 },
        transmittance: Transmittance::Grey,
        light: LightPlan::open(&[Direction::Everywhere]),
        shading: None,
        phases: 0,
        thin_films: FilmCounts::default(),
        gradient_opacity: 0,
        labels: false,
        smooth_labels: false,
        background: false,
        lookup: Lookup::Linear,
        integration: Integrate::Samples,
        interpolation: Interpolation::Linear,
        volume: VolumeAs::Auto,
        gradients: Gradients::Packed,
        skipping: true,
        rays: 1,
        compensated: false,
        storage: StoreAs::Single,
    }
}

/// Directional light on materials with ambient coefficients only.
const FLAT: Option<ShadingTerms> = Some(ShadingTerms { diffuse: false, specular: None, one_sided: false });
const DIFFUSE: Option<ShadingTerms> = Some(ShadingTerms { diffuse: true, specular: None, one_sided: false });

fn directional() -> LightPlan {
    LightPlan::open(&[Direction::Infinity])
}

fn headlight() -> LightPlan {
    LightPlan::open(&[Direction::Eye])
}

/// Plan of the scene `name` after `change`.
fn changed(name: &str, change: impl FnOnce(&mut Scene)) -> ScenePlan {
    let mut scene = scenes::named(name);
    change(&mut scene);
    plan(&scene, &Quiet).unwrap().plan
}

#[test]
fn an_unshaded_scene_has_one_position_however_many_lights() {
    assert_eq!(changed("unshaded_one", |_| {}), least());
    assert_eq!(changed("unshaded_three", |_| {}), least());
}

#[test]
fn shading_that_is_switched_off_costs_nothing() {
    assert_eq!(changed("diffuse_three", |scene| scene.shading = Shading::None), least());
    assert_eq!(changed("specular_one", |scene| scene.shading = Shading::None), least());
}

#[test]
fn sixteen_bits_are_stored_where_they_are_asked_for() {
    let half = ScenePlan { storage: StoreAs::Half, ..least() };
    assert_eq!(changed("unshaded_one", |scene| scene.accuracy.storage = StoreAs::Half), half);
}

#[test]
fn a_directional_light_has_a_position_and_a_gradient() {
    assert_eq!(changed("diffuse_one", |_| {}), ScenePlan { light: directional(), shading: DIFFUSE, ..least() });
}

#[test]
fn three_lights_have_three_positions() {
    let light = LightPlan::open(&[Direction::Eye, Direction::Infinity, Direction::Place]);
    assert_eq!(changed("diffuse_three", |_| {}), ScenePlan { light, shading: DIFFUSE, ..least() });
}

#[test]
fn lights_that_shading_cannot_tell_apart_share_a_position() {
    let expected = ScenePlan { light: directional(), shading: DIFFUSE, ..least() };
    let second = |scene: &mut Scene, placement: Placement| {
        let mut light = scene.lights[0].clone();
        light.name = "second".into();
        light.placement = placement;
        scene.lights.push(light);
    };
    let key = scenes::named("diffuse_one").lights[0].placement;
    assert_eq!(changed("diffuse_one", |scene| second(scene, key)), expected);
    // Two-sided diffuse shading is equal for opposite lights.
    let Placement::Directional(direction) = key else { panic!("{key:?}") };
    assert_eq!(changed("diffuse_one", |scene| second(scene, Placement::Directional(-direction))), expected);
    // Highlights are not.
    let two = changed("diffuse_one", |scene| {
        second(scene, Placement::Directional(-direction));
        scene.materials[0].specular = 0.5;
    });
    assert_eq!(two.light, LightPlan::open(&[Direction::Infinity, Direction::Infinity]));
}

#[test]
fn materials_without_a_diffuse_part_need_no_gradient() {
    let flat = changed("diffuse_three", |scene| {
        scene.materials.iter_mut().for_each(|material| material.diffuse = 0.0);
    });
    assert_eq!(flat, ScenePlan { light: headlight(), shading: FLAT, ..least() });
    assert!(!flat.gradient());
    let white = changed("diffuse_three", |scene| {
        scene.materials.iter_mut().for_each(|material| (material.ambient, material.diffuse) = (1.0, 0.0));
    });
    assert_eq!(white, least());
}

#[test]
fn ambient_light_alone_needs_no_gradient() {
    let ambient = changed("specular_one", |scene| scene.lights[0].placement = Placement::Ambient);
    assert_eq!(ambient, least());
}

#[test]
fn highlights_of_one_exponent_and_of_several() {
    let light = LightPlan::open(&[Direction::Place]);
    let specular = Some(Specular { one_exponent: Some(20), exponent_bits: 5 });
    let shading = Some(ShadingTerms { diffuse: true, specular, one_sided: false });
    assert_eq!(changed("specular_one", |_| {}), ScenePlan { light: light.clone(), shading, ..least() });
    // A single exponent is compiled in: a pipeline for 20 does not serve 21.
    let other = changed("specular_one", |scene| scene.materials.iter_mut().for_each(|material| material.exponent = 21));
    let specular = Some(Specular { one_exponent: Some(21), exponent_bits: 5 });
    assert_eq!(
        other,
        ScenePlan { light, shading: Some(ShadingTerms { diffuse: true, specular, one_sided: false }), ..least() }
    );

    let specular = Some(Specular { one_exponent: None, exponent_bits: 6 });
    let expected = ScenePlan {
        accumulate: Accumulate::Weights { materials: 4 },
        light: LightPlan::open(&[Direction::Everywhere, Direction::Eye, Direction::Infinity, Direction::Place]),
        shading: Some(ShadingTerms { diffuse: true, specular, one_sided: false }),
        ..least()
    };
    assert_eq!(changed("specular_three", |_| {}), expected);
    assert_eq!((expected.components(), expected.lanes(), expected.parts().lanes, expected.layers()), (5, 2, 1, 8));
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
fn labels_and_a_background_are_planned_where_they_are() {
    let labels = ScenePlan { light: directional(), shading: DIFFUSE, labels: true, smooth_labels: true, ..least() };
    assert_eq!(changed("labels", |_| {}), labels);
    let nearest = changed("labels", |scene| scene.accuracy.labels = LabelInterpolation::Nearest);
    assert_eq!(nearest, ScenePlan { smooth_labels: false, ..labels.clone() });
    let undeclared = changed("labels", |scene| scene.labels.as_mut().unwrap().declared.clear());
    let only_skin = Accumulate::Weights { materials: 1 };
    assert_eq!(undeclared, ScenePlan { accumulate: only_skin, labels: false, smooth_labels: false, ..labels });
    assert_eq!(changed("background", |_| {}), ScenePlan { background: true, ..least() });
}

#[test]
fn the_camera_and_the_box_plan_nothing() {
    let shaded = ScenePlan { light: directional(), shading: DIFFUSE, ..least() };
    for name in ["inside", "cropped", "negative"] {
        assert_eq!(changed(name, |_| {}), shaded, "{name}");
    }
    assert_eq!(changed("orthographic", |_| {}), ScenePlan { light: headlight(), shading: DIFFUSE, ..least() });
    assert_eq!(changed("xray", |_| {}), least());
}

#[test]
fn knobs_are_planned_as_they_are_set() {
    assert_eq!(
        changed("unshaded_one", |scene| {
            scene.accuracy.skipping = false;
            scene.accuracy.interpolation = Interpolation::Nearest;
            scene.transfer.lookup = Lookup::Nearest;
        }),
        ScenePlan { skipping: false, interpolation: Interpolation::Nearest, lookup: Lookup::Nearest, ..least() }
    );
    let single = changed("unshaded_one", |scene| scene.accuracy.volume = VolumeAs::Single);
    assert_eq!(single, ScenePlan { volume: VolumeAs::Single, ..least() });
}

#[test]
fn gradients_are_taken_from_samples_only_where_there_are_any() {
    let central = |scene: &mut Scene| scene.accuracy.gradients = Gradients::Central;
    assert_eq!(changed("unshaded_one", central), least());
    let shaded = ScenePlan { light: directional(), shading: DIFFUSE, ..least() };
    assert_eq!(changed("diffuse_one", central), ScenePlan { gradients: Gradients::Central, ..shaded });
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
    let entry = explained(|scene| scene.transfer.lookup = Lookup::Nearest);
    assert!(entry.contains("in small steps"), "{entry}");
    let thin = explained(|scene| scene.accuracy.step_length = 1e-9);
    assert!(thin.contains("in steps of 1e-9 ("), "{thin}");
}

#[test]
fn what_nothing_shows_is_left_out() {
    let unused = changed("unshaded_one", |scene| {
        scene.materials[1].specular = 1.0;
        scene.transfer.terms.remove(1);
    });
    assert_eq!(unused, ScenePlan { accumulate: Accumulate::Weights { materials: 2 }, ..least() });
    let nothing = changed("diffuse_one", |scene| scene.transfer.terms.clear());
    assert_eq!(nothing.components(), 0);
    assert_eq!(nothing.shading, None);
    let dark = changed("diffuse_one", |scene| scene.lights.clear());
    assert_eq!(dark, ScenePlan { light: LightPlan::default(), ..least() });
}

#[test]
fn a_material_that_nothing_shows_splits_no_position() {
    let shaded = |material: &mut relume::scene::Material| (material.diffuse, material.specular) = (0.8, 0.5);
    let flat = changed("diffuse_three", |scene| {
        scene.materials.iter_mut().for_each(|material| material.diffuse = 0.0);
        shaded(&mut scene.materials[1]);
        scene.transfer.terms.remove(1);
    });
    let two = Accumulate::Weights { materials: 2 };
    assert_eq!(flat, ScenePlan { accumulate: two, light: headlight(), shading: FLAT, ..least() });
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
    let entry =
        relume::scene::LabelEntry { label: 9, name: "nowhere".into(), material: 0, opacity: 0.5, absorption: 0.0 };
    scene.labels = Some(relume::scene::Labels { volume: std::sync::Arc::new(zeros), declared: vec![entry] });
    let fullest = Rungs::new(scene, SIZE);
    let expected = ScenePlan {
        accumulate: Accumulate::Weights { materials: 3 },
        transmittance: Transmittance::Grey,
        light: LightPlan::open(&[Direction::Everywhere, Direction::Eye, Direction::Infinity, Direction::Place]),
        shading: Some(ShadingTerms {
            diffuse: true,
            specular: Some(Specular { one_exponent: None, exponent_bits: 7 }),
            one_sided: false,
        }),
        phases: 0,
        thin_films: FilmCounts::default(),
        gradient_opacity: 0,
        labels: true,
        smooth_labels: true,
        background: true,
        lookup: Lookup::Linear,
        integration: Integrate::Samples,
        interpolation: Interpolation::Linear,
        volume: VolumeAs::Auto,
        gradients: Gradients::Packed,
        skipping: false,
        rays: 1,
        compensated: false,
        storage: StoreAs::Single,
    };
    assert_eq!(fullest.planned.plan, expected);

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
fn a_factor_by_the_gradient_needs_the_gradient_and_a_factor_of_one_needs_nothing() {
    let factors = |points: &[(f64, f64)]| {
        let points = points.to_vec();
        changed("unshaded_one", |scene| scene.transfer.gradient_opacity = points)
    };
    assert_eq!(factors(&[(0.0, 0.0), (100.0, 1.0)]), ScenePlan { gradient_opacity: 2, ..least() });
    assert!(factors(&[(0.0, 0.0), (100.0, 1.0)]).stores_gradient(), "stored with the values");
    assert_eq!(factors(&[(0.0, 1.0), (100.0, 1.0)]), least(), "a factor of 1 has no effect");
    let central = changed("unshaded_one", |scene| {
        scene.transfer.gradient_opacity = vec![(50.0, 0.5)];
        scene.accuracy.gradients = Gradients::Central;
    });
    assert_eq!(central, ScenePlan { gradient_opacity: 1, gradients: Gradients::Central, ..least() });
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

#[test]
fn one_sided_lighting_is_planned_where_a_material_shades() {
    let one_sided = |scene: &mut Scene| scene.lighting = Lighting::OneSided;
    let shading = Some(ShadingTerms { diffuse: true, specular: None, one_sided: true });
    assert_eq!(changed("diffuse_one", one_sided), ScenePlan { light: directional(), shading, ..least() });
    assert_eq!(changed("unshaded_one", one_sided), least());
    // Opposite directions shade alike on two sides only.
    let opposite = |lighting| {
        changed("diffuse_one", |scene| {
            scene.lighting = lighting;
            let mut other = scene.lights[0].clone();
            if let Placement::Directional(direction) = &mut other.placement {
                *direction = -*direction;
            }
            scene.lights.push(other);
        })
    };
    assert_eq!(opposite(Lighting::TwoSided).light.accumulators(), 1);
    assert_eq!(opposite(Lighting::OneSided).light.accumulators(), 2);
}

#[test]
fn all_three_point_lights_share_one_position_with_three_vectors() {
    let counts = changed("diffuse_one", |scene| {
        scene.lights[0].placement = Placement::ThreePoint;
        let other = scene.lights[0].clone();
        scene.lights.push(other);
    });
    let light = LightPlan {
        arrivals: vec![Arrival { accumulator: 0, direction: Direction::Infinity, share: Share::Open }; 3],
        ..LightPlan::default()
    };
    assert_eq!(counts, ScenePlan { light, shading: DIFFUSE, ..least() });
    assert_eq!(counts.light.accumulators(), 1);
    let flat = changed("unshaded_one", |scene| scene.lights[0].placement = Placement::ThreePoint);
    assert_eq!(flat, least(), "unshaded");
}
