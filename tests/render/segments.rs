//! Integration in segments: closed forms, the device against the reference, and empty-space skipping.

use crate::matrix::differences;
use crate::support;

use glam::DVec3;
use relume::plan::{Integrate, PlanError, plan};
use relume::progress::Quiet;
use relume::scene::{Gradients, Integration, Term};
use relume::tables::CELL;
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE, float, in_segments, of, sampled, slab_straight_on};

#[test]
fn a_homogeneous_slab_is_exact_for_any_step_and_any_division() {
    check_slabs(Integration::Segments, Integrate::Segments);
}

/// A slab of 24 units of opacity 0.08 per unit on every rung, in steps of several lengths that are divided by several variations.
pub(super) fn check_slabs(integration: Integration, planned: Integrate) {
    let expected = 0.92_f64.powi(24);
    for (step, variation) in [(1.0, 1.0), (0.5, 1e-3), (0.25, 1e-6), (3.0, 1.0), (8.0, 1e-3)] {
        let mut scene = slab_straight_on(step, 0.08, "");
        (scene.accuracy.integration, scene.accuracy.variation) = (integration, variation);
        let rungs = Rungs::new(scene, [3, 3]);
        assert_eq!(rungs.planned.plan.integration, planned, "step {step}");
        let near = |rung: &str, found: &[f64], tolerance: f64| {
            for &number in found {
                let error = (number - expected).abs() / expected;
                assert!(error <= tolerance, "{rung}, step {step}, variation {variation}: {number} for {expected}");
            }
        };
        let in_f64 =
            |film: relume::film::Film<f32>| film.transmittance.iter().map(|&t| f64::from(t)).collect::<Vec<_>>();
        near("exact", &rungs.march::<f64>(&rungs.exact()).transmittance, 1e-12);
        // 24 to 96 attenuations of f32, and the rounding of the depth.
        near("f32", &in_f64(rungs.march::<f32>(&rungs.stored::<f32>())), 1e-5);
        with_renderer(|renderer| near("device", &in_f64(rungs.gpu(renderer)), 1e-5));
    }
}

/// On a ramp the value is linear along a ray through the middle of a row, so every segment is exact: the optical depth is
/// the integral of a trapezoid over the values, however narrow it is and however long the steps.
#[test]
fn the_optical_depth_of_a_ramp_is_the_integral_of_the_transfer_function() {
    let text = |step: f64| {
        format!(
            r#"
            shading = "none"
            [materials.only]
            reflectance = "orange"
            absorption = 1
            [transfer]
            opacity_length = 1
            intervals = [{{ material = "only", range = [30100, 30900], ramp = 400, opacity = 0, absorption = 0.7 }}]
            [lights.day]
            spectrum = "D65"
            [camera]
            projection = "orthographic"
            height = 4
            position = [2, 2, -10]
            target = [2, 2, 0]
            [accuracy]
            step = {step}
            variation = 1
            termination = 0
            "#
        )
    };
    // 24 steps from 0 to 60000: 2500 per unit. The trapezoid is 1200 wide at half its height.
    let ramp = || sampled([5, 5, 25], |place| 30000.0 * (place.z + 1.0));
    let expected = (-0.7 * 1200.0 / 2500.0_f64).exp();
    for step in [1.0, 2.0, 3.0, 0.7] {
        let rungs = Rungs::new(in_segments(of(&text(step), ramp())), [3, 3]);
        let exact = rungs.march::<f64>(&rungs.exact()).transmittance;
        let stored = rungs.march::<f64>(&rungs.stored::<f64>()).transmittance;
        for (rung, found, tolerance) in [("exact", exact, 1e-9), ("stored", stored, 1e-5)] {
            for number in found {
                assert!((number - expected).abs() <= tolerance, "{rung}, step {step}: {number} for {expected}");
            }
        }
    }
    // A sample hits or misses it.
    let mut samples = of(&text(1.0), ramp());
    samples.accuracy.integration = Integration::Samples;
    let rungs = Rungs::new(samples, [3, 3]);
    let found = rungs.march::<f64>(&rungs.exact()).transmittance[4];
    assert!((found - expected).abs() > 0.05, "samples: {found} for {expected}");
}

/// 99 % of the differences, and the largest.
fn spread(actual: &[DVec3], expected: &[DVec3]) -> [f64; 2] {
    let errors = differences(actual, expected);
    [errors[errors.len() * 99 / 100], errors[errors.len() - 1]]
}

/// A tenth of what is just visible in nearly every pixel, a fifth in all.
#[test]
fn the_table_of_segments_is_the_transfer_function() {
    let other = ["segments_nearest_lookup", "segments_long_steps"];
    for name in scenes::all().keys().filter(|name| name.starts_with("segments_") && !other.contains(&name.as_str())) {
        let rungs = Rungs::new(scenes::named(name), SIZE);
        let exact = rungs.march::<f64>(&rungs.exact()).relight(&rungs.xyz_matrices());
        let stored = rungs.march::<f64>(&rungs.stored::<f64>()).relight(&rungs.xyz_matrices());
        let [p99, largest] = spread(&stored, &exact);
        assert!(p99 <= 0.1 && largest <= 0.2, "{name}: {p99}, {largest}");
    }
}

/// A ball behind a macrocell's face: the segment of the sample in front of the face reaches it.
#[test]
fn skipping_keeps_what_a_segment_reaches_beyond_its_macrocell() {
    with_renderer(|renderer| {
        for step in [1.0, 3.0, 9.0, 20.0] {
            let mut scene = in_segments(scenes::named("unshaded_one"));
            let n = 4 * CELL + 1;
            let ball = sampled([n, n, n], |place| {
                // Voxels 9 to 15, inside the second macrocell.
                let at = (place + 1.0) * float(n - 1) / 2.0;
                if (at - 12.0).length() < 3.5 { 40000.0 } else { 0.0 }
            });
            scene.set_volume(std::sync::Arc::new(ball));
            scene.accuracy.step_length = step;
            scene.accuracy.variation = 1.0;
            let mut everywhere = scene.clone();
            everywhere.accuracy.skipping = false;
            let [skipping, everywhere] = [scene, everywhere].map(|scene| Rungs::new(scene, SIZE).gpu(renderer));
            assert!(everywhere.transmittance.iter().any(|&transmitted| transmitted < 1.0), "step {step}: it is seen");
            assert!(skipping == everywhere, "step {step}");
        }
    });
}

/// The largest and the smallest value lie on the bounds of the table.
#[test]
fn regions_of_the_largest_and_the_smallest_value_are_not_taken_for_invisible() {
    with_renderer(|renderer| {
        for [low, high] in [[60_000.0, 70_000.0], [-70_000.0, 5000.0]] {
            let mut scene = in_segments(scenes::named("diffuse_one"));
            scene.set_volume(std::sync::Arc::new(sampled(
                [17, 17, 17],
                |place| if place.x > 0.0 { 65_535.0 } else { 0.0 },
            )));
            scene.transfer.terms = vec![Term::interval(0, [low, high], 1000.0, 0.3, 0.0)];
            // Seven fetches of a sample: the plan looks for the next visible one first.
            scene.accuracy.gradients = Gradients::Central;
            let mut everywhere = scene.clone();
            everywhere.accuracy.skipping = false;
            let [skipping, everywhere] = [scene, everywhere].map(|scene| Rungs::new(scene, SIZE));
            assert!(skipping.planned.plan.skips_invisible() && !everywhere.planned.plan.skips_invisible());
            let [skipping, everywhere] = [skipping, everywhere].map(|rungs| rungs.gpu(renderer));
            assert!(everywhere.transmittance.iter().any(|&left| left < 0.1), "{low} to {high}: it is seen");
            assert!(skipping == everywhere, "{low} to {high}");
        }
    });
}

#[test]
fn segments_without_a_closed_form_are_refused_by_name() {
    for (key, why) in [("interpolation = \"nearest\"", "nearest"), ("model = \"peercy\"\nk = 4", "peercy")] {
        let scene = in_segments(scenes::glass_straight_on("0.5", key));
        match plan(&scene, &Quiet) {
            Err(PlanError::NoSegments { why: said }) => assert!(said.contains(why), "{said}"),
            other => panic!("{key}: {:?}", other.map(|planned| planned.plan.integration)),
        }
    }
}
