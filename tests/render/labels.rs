//! Labels between voxels: shares of those around (docs/theory/march.md).

use crate::support;

use std::sync::Arc;

use glam::DVec3;
use relume::film::Film;
use relume::number::Real;
use relume::scene::{Aim, LabelEntry, LabelInterpolation, Labels, Scene, Term};
use relume::volume::{Geometry, Volume, Voxels};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE};

const DIMS: [usize; 3] = [20, 18, 16];

/// Volume with `of(x, y, z)` in each voxel.
fn volume(of: impl Fn([usize; 3]) -> u16) -> Volume {
    let voxels = (0..DIMS.iter().product()).map(|i| of([i % DIMS[0], i / DIMS[0] % DIMS[1], i / (DIMS[0] * DIMS[1])]));
    Volume::new("labels", Voxels::U16(voxels.collect()), Geometry::unit("labels", DIMS).unwrap()).unwrap()
}

/// Whether a voxel belongs to a tilted ball, apart from the faces of the volume on three sides.
fn in_ball([x, y, z]: [usize; 3]) -> bool {
    let [x, y, z] = [x, y, z].map(scenes::float);
    (x - 8.3).powi(2) + 1.4 * (y + 0.3 * x - 9.6).powi(2) + (z - 6.2).powi(2) < 36.0
}

/// Steps as long as the length of opacities, without shading.
fn scene(transfer: &str, volume: Volume) -> Scene {
    let text = format!(
        r#"
        shading = "none"
        [materials.organ]
        reflectance = "moderate red"
        [transfer]
        opacity_length = 1
        {transfer}
        [lights.day]
        spectrum = "D65"
        [camera]
        azimuth = 35
        elevation = 28
        fill = 1.4
        [accuracy]
        step = 1
        termination = 0
        "#
    );
    scenes::of(&text, volume)
}

fn entry(label: i64, opacity: f64) -> LabelEntry {
    LabelEntry { label, name: label.to_string(), material: 0, opacity, absorption: 0.0, terms: Vec::new() }
}

fn labelled(labels: Volume, declared: Vec<LabelEntry>) -> Scene {
    let mut scene = scene("", volume(|_| 0));
    scene.labels = Some(Labels { volume: Arc::new(labels), declared });
    scene
}

fn largest_difference<R: Real>(one: &Film<R>, other: &Film<R>) -> f64 {
    let numbers = |film: &Film<R>| film.accumulators.iter().chain(&film.transmittance).copied().collect::<Vec<_>>();
    let pairs = numbers(one).into_iter().zip(numbers(other));
    pairs.map(|(one, other)| (one - other).abs().to_f64()).fold(0.0, f64::max)
}

/// The share of a label is the linear interpolation of its mask, so a label of opacity o looks like a mask of 0 and 1000
/// whose opacity rises linearly to o.
#[test]
fn a_label_has_the_share_that_its_mask_has_between_voxels() {
    let label = labelled(volume(|at| u16::from(in_ball(at))), vec![entry(1, 0.4)]);
    let ramp = "[[transfer.intervals]]\nmaterial = \"organ\"\nrange = [1000, 1100]\nramp = 1000\nopacity = 0.4\n";
    let mask = scene(ramp, volume(|at| if in_ball(at) { 1000 } else { 0 }));
    let (label, mask) = (Rungs::new(label, SIZE), Rungs::new(mask, SIZE));
    // A step as long as the length of opacities has the opacity of the transfer function: the share of 0.4.
    let [exact, other] = [&label, &mask].map(|rungs| rungs.march::<f64>(&rungs.exact()));
    let difference = largest_difference(&exact, &other);
    assert!(difference <= 1e-12, "{difference}");
    // Labels of the nearest voxels are far from it.
    let mut nearest = label.scene.clone();
    nearest.accuracy.labels = LabelInterpolation::Nearest;
    let nearest = Rungs::new(nearest, SIZE);
    let far = largest_difference(&nearest.march::<f64>(&nearest.exact()), &other);
    assert!(far > 0.05, "{far} with nearest labels");
}

/// In segments, densities are mixed: short of tables, a label and its mask are the same.
#[test]
fn in_segments_a_label_is_its_mask_where_densities_are_mixed() {
    let planes = |[_, _, z]: [usize; 3]| (4..9).contains(&z);
    let label = labelled(volume(|at| u16::from(planes(at))), vec![entry(1, 0.4)]);
    let mut scene = scenes::in_segments(label);
    scene.accuracy.step_length = 0.05;
    scene.camera.aim = Aim::LookAt { position: DVec3::new(9.5, 8.5, -40.0), target: DVec3::new(9.5, 8.5, 0.0) };
    let rungs = Rungs::new(scene, [9, 9]);
    let film = rungs.march::<f64>(&rungs.exact());
    // Shares rise and fall over a voxel at both ends: five voxels in all.
    let middle = film.transmittance[4 + 9 * 4];
    let expected = (1.0_f64 - 0.4).powi(5);
    assert!((middle - expected).abs() < 1e-3 * expected, "{middle} for {expected}");
}

/// A label with a transfer function of its own shows at each value what that function states there, also where the scene's shows other
/// things, and equal ones share a row.
#[test]
fn a_label_by_value_is_its_closed_form_on_every_rung() {
    let values = volume(|[_, _, z]| if z < 8 { 100 } else { 200 });
    // Labels 1 and 2 with equal functions; label 3 does nothing; what has no label follows the scene.
    let labels = volume(|[x, _, _]| u16::try_from(x / 5).unwrap());
    let mut scene = scene(
        "lookup = \"linear\"\n[[transfer.intervals]]\nmaterial = \"organ\"\nrange = [50, 250]\nopacity = 0.05\n",
        values,
    );
    let terms =
        vec![Term::interval(0, [90.0, 110.0], 20.0, 0.02, 0.0), Term::interval(0, [190.0, 210.0], 20.0, 0.1, 0.0)];
    let by_value = |label: i64| LabelEntry { terms: terms.clone(), ..entry(label, 0.1) };
    let nothing = LabelEntry { terms: vec![Term::interval(0, [400.0, 500.0], 0.0, 0.9, 0.0)], ..entry(3, 0.0) };
    scene.labels = Some(Labels { volume: Arc::new(labels), declared: vec![by_value(1), by_value(2), nothing] });
    scene.accuracy.labels = LabelInterpolation::Nearest;
    scene.accuracy.interpolation = relume::scene::Interpolation::Nearest;
    // Along z: 7.5 units in front of the jump between voxels 7 and 8, as many behind.
    scene.accuracy.step_length = 0.5;
    scene.camera.projection = relume::scene::Projection::Orthographic { height: Some(4.0) };
    scene.camera.aim = Aim::LookAt { position: DVec3::new(9.5, 8.5, -40.0), target: DVec3::new(9.5, 8.5, 0.0) };
    let both = (0.98_f64 * 0.9).powf(7.5);
    let rungs = Rungs::new(scene.clone(), [1, 1]);
    assert!(rungs.planned.plan.labels_by_value);
    let check = |what: &str, left: f64, expected: f64, within: f64| {
        assert!((left - expected).abs() <= within, "{what}: {left} for {expected}");
    };
    // Pixels over the labels: none, 1, 2 and 3.
    for (x, expected) in [(2.0, 0.95_f64.powi(15)), (7.0, both), (12.0, both), (17.0, 1.0)] {
        let mut seen = scene.clone();
        seen.camera.aim = Aim::LookAt { position: DVec3::new(x, 8.5, -40.0), target: DVec3::new(x, 8.5, 0.0) };
        let rungs = Rungs::new(seen, [1, 1]);
        check("f64", rungs.march::<f64>(&rungs.exact()).transmittance[0], expected, 1e-12);
        check("tables", rungs.march::<f64>(&rungs.stored::<f64>()).transmittance[0], expected, 2e-6);
        with_renderer(|renderer| check("device", rungs.gpu(renderer).transmittance[0].into(), expected, 5e-6));
    }
}

#[test]
fn within_a_label_nothing_changes() {
    let filled = |smooth: bool| {
        let mut scene = labelled(volume(|_| 1), vec![entry(1, 0.05)]);
        scene.accuracy.labels = if smooth { LabelInterpolation::Smooth } else { LabelInterpolation::Nearest };
        let rungs = Rungs::new(scene, SIZE);
        rungs.march::<f64>(&rungs.exact())
    };
    assert!(largest_difference(&filled(true), &filled(false)) <= 0.0);
}

/// More than 127 labels take two bytes a voxel, and more than 32767 four.
#[test]
fn the_device_mixes_any_number_of_labels_as_the_reference_does() {
    with_renderer(|renderer| {
        for labels in [3_u16, 127, 300, 40_000] {
            // The last of them, whose texels are the largest.
            let of = |[x, y, z]: [usize; 3]| {
                let back = u16::try_from((x + 7 * y + 31 * z) % 256).unwrap() % (labels + 1);
                if in_ball([x, y, z]) { labels - back } else { 0 }
            };
            let opacity = |label: u16| 0.02 + 0.9 * f64::from((labels - label).min(255)) / 256.0;
            let declared = (1..=labels).map(|label| entry(label.into(), opacity(label)));
            for segments in [false, true] {
                // Voxels without a label are seen too.
                let haze = "intervals = [{ material = \"organ\", range = [1, 9], opacity = 0.1 }]";
                let among = Labels { volume: Arc::new(volume(of)), declared: declared.clone().collect() };
                let values = volume(|[x, y, z]| u16::try_from((x + 2 * y + z) % 3).unwrap());
                let mut scene = Scene { labels: Some(among), ..scene(haze, values) };
                if segments {
                    scene = scenes::in_segments(scene);
                }
                let rungs = Rungs::new(scene, SIZE);
                let expected = rungs.march::<f32>(&rungs.stored::<f32>());
                let difference = largest_difference(&rungs.gpu(renderer), &expected);
                assert!(difference <= 1e-4, "{labels} labels, segments {segments}: {difference}");
            }
        }
    });
}
