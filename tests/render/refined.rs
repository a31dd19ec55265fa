//! Steps that are refined: closed forms, parts of pictures, error beside that of plain samples, and what refines nothing.

use glam::DVec3;
use relume::plan::{Integrate, plan};
use relume::progress::Quiet;
use relume::reference::{RaySample, march_ray};
use relume::scene::{Blending, Integration, Scene};

use crate::matrix::differences;
use crate::segments::check_slabs;
use crate::support::rungs::Rungs;
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
