//! Steps that are refined: closed forms, parts of pictures, error beside that of plain samples, and what refines nothing.

use glam::DVec3;
use relume::plan::{Integrate, plan};
use relume::progress::Quiet;
use relume::reference::{RaySample, march_ray};
use relume::scene::{Blending, Integration, Scene};

use crate::matrix::differences;
use crate::segments::check_slabs;
use crate::support::rungs::{Rungs, with_renderer};
use crate::support::scenes::{self, SIZE};

fn adaptive(mut scene: Scene) -> Scene {
    scene.accuracy.integration = Integration::Adaptive;
    scene
}

#[test]
fn a_homogeneous_slab_is_exact_for_any_step_and_any_bound() {
    check_slabs(Integration::Adaptive, Integrate::Refined);
}

/// Colours of a scene with exact tables, where the brightest of `truth` is white.
fn colours(scene: &Scene) -> Vec<DVec3> {
    let rungs = Rungs::new(scene.clone(), SIZE);
    rungs.march::<f64>(&rungs.exact()).relight(&rungs.xyz_matrices())
}

/// 95th percentile of ΔE00 of `found`, where the brightest of `truth` is white.
fn p95(found: &[DVec3], truth: &[DVec3]) -> f64 {
    let brightest = truth.iter().map(|xyz| xyz.y).fold(0.0, f64::max);
    let shown = |all: &[DVec3]| all.iter().map(|&xyz| xyz / brightest).collect::<Vec<_>>();
    let all = differences(&shown(found), &shown(truth));
    all[all.len() * 95 / 100]
}

#[test]
fn refined_steps_are_nearer_to_the_truth_than_plain_ones() {
    for (name, part) in [("unshaded_three", 0.65), ("diffuse_three", 0.65), ("labels", 0.65), ("coloured_three", 1.0)] {
        let mut scene = scenes::named(name);
        scene.accuracy.integration = Integration::Samples;
        scene.accuracy.step_length *= 2.0;
        let plain = colours(&scene);
        let refined = colours(&adaptive(scene.clone()));
        scene.accuracy.step_length /= 32.0;
        let truth = colours(&scene);
        let [plain, refined] = [plain, refined].map(|found| p95(&found, &truth));
        assert!(refined <= part * plain, "{name}: p95 {refined} of refined steps, {plain} of plain ones");
    }
}

/// A bound beyond all differences leaves plain samples of densities, and one of nearly 0 refines each visible step: three samples a step.
#[test]
fn a_bound_leads_from_plain_samples_to_three_a_step() {
    let mut scene = adaptive(scenes::named("diffuse_three"));
    scene.accuracy.interpolation = relume::scene::Interpolation::ExactLinear;
    scene.accuracy.variation = 1.0;
    let none = colours(&scene);
    scene.accuracy.integration = Integration::Samples;
    let plain = colours(&scene);
    // A difference is at most 1.5, and the bound of a variation of 1 is 0.63.
    assert!(p95(&none, &plain) < 0.35, "{}", p95(&none, &plain));
    let mut seen = [0_usize; 2];
    for (i, variation) in [1e-6, 1.0].into_iter().enumerate() {
        let mut scene = adaptive(scenes::named("unshaded_one"));
        scene.accuracy.variation = variation;
        scene.accuracy.termination = 0.0;
        let rungs = Rungs::new(scene, SIZE);
        let middle = SIZE.map(|side| side / 2);
        let count = |_: &RaySample<'_, f64>| seen[i] += 1;
        march_ray(&rungs.scene, &rungs.planned, &rungs.exact(), [SIZE, middle], &Quiet, count).unwrap();
    }
    assert!(seen[0] > seen[1] && seen[0] <= 3 * seen[1], "{seen:?}");
}

/// Media that no sample sees are found between two: of a face that is a voxel wide, a thin shell has the depth of its integral on average,
/// and in each pixel nearly so.
#[test]
fn an_interval_between_the_values_of_two_samples_is_seen() {
    let text = r#"
        shading = "none"
        [materials.only]
        reflectance = "orange"
        [transfer]
        opacity_length = 1
        intervals = [{ material = "only", range = [20000, 36000], ramp = 2000, opacity = 0.2 }]
        [lights.day]
        spectrum = "D65"
        [camera]
        projection = "orthographic"
        height = 10
        position = [8, 8, -20]
        target = [9, 8.5, 8]
        [accuracy]
        termination = 0
        jitter = true
        "#;
    // Values jump from 0 to 60000 between two slices: the trapezoid has the area of 18000 of them.
    let scene = scenes::of(text, scenes::sampled([16, 16, 16], |place| if place.z < 0.0 { 0.0 } else { 60_000.0 }));
    let transmittance = |integration: Integration| {
        let mut scene = scene.clone();
        scene.accuracy.integration = integration;
        let rungs = Rungs::new(scene, [12, 12]);
        assert_eq!(rungs.planned.plan.crossings, integration == Integration::Adaptive);
        rungs.march::<f64>(&rungs.exact()).transmittance
    };
    let along = DVec3::new(1.0, 0.5, 28.0).normalize().z;
    let expected = 0.8_f64.powf(0.3 / along);
    let errors = |integration| {
        let all = transmittance(integration);
        all.iter().map(|found| (found - expected).abs() / (1.0 - expected)).sum::<f64>() / scenes::float(all.len())
    };
    let [plain, refined] = [Integration::Samples, Integration::Adaptive].map(errors);
    assert!(plain > 0.8 && refined < 0.4, "{plain} of plain samples, {refined} of refined steps");
    // No sample on either side can be visible, and the device skips none of these.
    let shaded =
        text.replace("shading = \"none\"", "").replace("jitter = true", "jitter = true\ngradients = \"central\"");
    let rungs = Rungs::new(adaptive(scenes::of(&shaded, (**scene.volume()).clone())), [12, 12]);
    assert!(rungs.planned.plan.skips_invisible() && rungs.planned.plan.crossings);
    let expected = rungs.march::<f32>(&rungs.stored::<f32>()).transmittance;
    with_renderer(|renderer| {
        for (found, expected) in rungs.gpu(renderer).transmittance.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-4, "{found} on the device, {expected} in f32");
        }
    });
}

#[test]
fn a_plan_counts_crossed_intervals_where_steps_cross_a_range() {
    let counts = |change: &dyn Fn(&mut Scene)| {
        let mut scene = adaptive(scenes::named("crossed_three"));
        change(&mut scene);
        let planned = plan(&scene, &Quiet).unwrap();
        let says = planned.explain(&scene).iter().any(|sentence| sentence.starts_with("Intervals between the values"));
        assert_eq!(says, planned.plan.crossings);
        planned.plan.crossings
    };
    assert!(counts(&|_| {}));
    assert!(!counts(&|scene| scene.accuracy.integration = Integration::Samples));
    // Steps that are short enough do not.
    assert!(!counts(&|scene| scene.accuracy.step_length /= 16.0));
    assert!(!counts(&|scene| scene.transfer = scenes::named("refined_three").transfer));
}

#[test]
fn what_cannot_be_refined_says_why() {
    let not = |change: &dyn Fn(&mut Scene)| {
        let mut scene = adaptive(scenes::named("unshaded_one"));
        change(&mut scene);
        let planned = plan(&scene, &Quiet).unwrap();
        assert_eq!(planned.plan.integration, Integrate::Samples);
        let why = planned.not_refined().unwrap();
        let explained = planned.explain(&scene).join(" ");
        assert!(explained.contains(why), "{why}: {explained}");
    };
    not(&|scene| scene.blending = Blending::Maximum);
    not(&|scene| {
        *scene = adaptive(scenes::named("fields_two"));
    });
    not(&|scene| {
        *scene = adaptive(scenes::named("corner_unshaded"));
    });
    not(&|scene| {
        *scene = adaptive(scenes::named("sharpened"));
    });
}
