//! Extreme values: all results are finite and correct.

use crate::support;

use std::sync::Arc;

use glam::DVec3;
use relume::film::Film;
use relume::measure::extremes::{Extreme, Group, Row, Rung};
use relume::model::random::Random;
use relume::plan::plan;
use relume::progress::Quiet;
use relume::reference::{Samples, attenuate, composite};
use relume::render::Renderer;
use relume::scene::{Aim, Projection, Scene, Shading};
use relume::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::spectrum::{Reflectance, Spectrum};
use relume::tables::Storage;
use relume::volume::{Geometry, Volume, Voxels};
use support::bounds::{of_places, places};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE, float};
use support::tolerance::{EQUAL_STEPS, ROUNDINGS_PER_STEP_OF_TWO, TERMINATION_DELTA_E, TERMINATION_XYZ};

/// Asserts every row of a group; `relume measure --extremes` prints the same rows.
#[track_caller]
fn holds(group: Group) {
    let rows = |renderer: Option<&Renderer>| -> Vec<Row> {
        group.extremes().iter().flat_map(|extreme| extreme.rows(renderer, &Quiet)).collect()
    };
    let rows = with_renderer(|renderer| rows(Some(renderer))).unwrap_or_else(|| rows(None));
    assert!(!rows.is_empty(), "nothing was asked");
    let missed: Vec<String> = rows.iter().filter(|row| !row.holds).map(Row::to_string).collect();
    assert!(missed.is_empty(), "{}", missed.join("\n"));
}

/// docs/theory/acceptance.md C14, C16 and C17.
#[test]
fn opacities_and_depths_are_their_closed_forms() {
    holds(Group::Opacity);
}

/// docs/theory/acceptance.md C15.
#[test]
fn steps_of_every_length_are_their_closed_forms() {
    holds(Group::Steps);
}

#[test]
fn lights_of_nothing_a_million_and_one_line_are_their_closed_forms() {
    holds(Group::Lights);
}

/// docs/theory/acceptance.md C18.
#[test]
fn spectra_that_cancel_are_black() {
    holds(Group::Spectra);
}

#[test]
fn models_of_one_number_and_of_many_are_their_closed_forms() {
    holds(Group::Models);
}

#[test]
fn twins_blacks_and_many_materials_are_their_closed_forms() {
    holds(Group::Materials);
}

#[test]
fn volumes_of_every_shape_and_value_are_their_closed_forms() {
    holds(Group::Volumes);
}

#[test]
fn rays_along_faces_and_cameras_anywhere_are_their_closed_forms() {
    holds(Group::Rays);
}

#[test]
fn spacings_pictures_and_crops_are_their_closed_forms() {
    holds(Group::Sizes);
}

#[test]
fn what_sixteen_bits_cannot_hold_is_found_by_the_plan() {
    holds(Group::Half);
}

#[test]
fn every_extreme_is_held_once_and_says_why() {
    let all: Vec<_> = Group::ALL.into_iter().flat_map(Group::extremes).collect();
    let names: std::collections::BTreeSet<&str> = all.iter().map(Extreme::name).collect();
    assert_eq!(names.len(), all.len());
    for extreme in &all {
        let bound = extreme.bound();
        assert!(bound.why.len() > 20 && !bound.name.is_empty(), "{extreme:?}");
        assert!(bound.limit(Rung::Double) <= bound.limit(Rung::Gpu) && bound.limit(Rung::Gpu) <= 1.0, "{extreme:?}");
    }
}

/// Films of the f32 rungs: the reference and, if available, the device.
fn marched(rungs: &Rungs) -> Vec<(&'static str, Film<f32>)> {
    let mut all = vec![("reference f32", rungs.march::<f32>(&rungs.stored::<f32>()))];
    with_renderer(|renderer| all.push(("GPU", rungs.gpu(renderer))));
    for (rung, sums) in &all {
        assert!(
            sums.accumulators.iter().chain(&sums.transmittance).all(|number| number.is_finite()),
            "{rung}: {sums:?}"
        );
        assert!(
            sums.transmittance.iter().all(|transmitted| (0.0..=1.0).contains(transmitted)),
            "{rung}: light comes and goes"
        );
    }
    all
}

/// Asserts that each f32 rung is within its bound of the f64 reference on the same tables, and hence wrote every pixel.
fn agree(scene: Scene, size: [usize; 2]) -> Vec<(&'static str, Film<f32>)> {
    let rungs = Rungs::new(scene, size);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let places = places(&rungs);
    let bound = of_places(&rungs, &expected, [places.error; 3], ROUNDINGS_PER_STEP_OF_TWO);
    let all = marched(&rungs);
    let pixels = size[0] * size[1];
    for (rung, sums) in &all {
        assert_eq!(
            (sums.accumulators.len(), sums.transmittance.len()),
            (expected.accumulators.len(), pixels),
            "{rung}"
        );
        let numbers = sums.accumulators.iter().chain(&sums.transmittance);
        let expected = expected.accumulators.iter().chain(&expected.transmittance);
        let bounds = bound.accumulators.iter().chain(&bound.transmittance);
        for (i, ((&found, &expected), &bound)) in numbers.zip(expected).zip(bounds).enumerate() {
            let error = (f64::from(found) - expected).abs();
            assert!(places.undecided[i % pixels] || error <= bound, "{rung}: {found} for {expected} at {i}: {error:e}");
        }
    }
    all
}

#[track_caller]
fn near(rung: &str, found: f32, expected: f64, relative: f64) {
    let error = (f64::from(found) - expected).abs();
    assert!(error <= relative * expected.abs(), "{rung}: {found} for {expected}");
}

#[test]
fn a_camera_in_a_corner_of_the_volume_sees_it() {
    let mut scene = scenes::named("inside");
    scene.camera.aim = Aim::LookAt { position: DVec3::ZERO, target: DVec3::new(16.0, 14.0, 13.0) };
    agree(scene, SIZE);
}

#[test]
fn a_camera_a_million_lengths_away_is_as_sharp_as_parallel_rays() {
    // The whole volume at an angle so small that rays are parallel to 1e-6.
    let mut near = scenes::named("orthographic");
    let volume = near.volume().clone();
    let view = near.camera.view(&volume.geometry, 1.0).unwrap();
    let centre = volume.geometry.world_from_index(0.5 * (DVec3::from_array(volume.geometry.dims.map(float)) - 1.0));
    let (height, distance) = (24.0, 3e7);
    near.camera.aim = Aim::LookAt { position: centre - 100.0 * view.forward, target: centre };
    near.camera.projection = Projection::Orthographic { height: Some(height) };
    let mut far = near.clone();
    far.camera.aim = Aim::LookAt { position: centre - distance * view.forward, target: centre };
    let fov_degrees = 2.0 * (0.5 * height / distance).atan().to_degrees();
    far.camera.projection = Projection::Perspective { fov_degrees };
    let (near, far) = (Rungs::new(near, SIZE), Rungs::new(far, SIZE));
    let expected = near.march::<f64>(&near.stored::<f64>());
    // Besides rounding, rays are tilted by up to 1e-6 of the volume's depth.
    let judged = places(&near);
    let reach = judged.error + 1e-6;
    let bound = of_places(&near, &expected, [reach; 3], ROUNDINGS_PER_STEP_OF_TWO);
    let pixels = SIZE[0] * SIZE[1];
    // A headlight follows each ray, within 1e-6 as well; both plans are equal.
    assert_eq!(near.planned.plan.components(), far.planned.plan.components());
    for (rung, sums) in marched(&far) {
        for (i, (&found, (&expected, &bound))) in
            sums.accumulators.iter().zip(expected.accumulators.iter().zip(&bound.accumulators)).enumerate()
        {
            let error = (f64::from(found) - expected).abs();
            assert!(judged.undecided[i % pixels] || error <= bound + 1e-6, "{rung}: {found} for {expected} at {i}");
        }
    }
}

#[test]
fn lights_of_nothing_and_of_a_million() {
    let mut scene = scenes::named("diffuse_three");
    let dark = agree(scene.clone(), SIZE);
    for (light, intensity) in scene.lights.iter_mut().zip([0.0, 1e6, 1.0]) {
        light.intensity = intensity;
    }
    let rungs = Rungs::new(scene.clone(), SIZE);
    for (rung, sums) in agree(scene, SIZE) {
        assert_eq!(sums.accumulators, dark.iter().find(|(other, _)| *other == rung).unwrap().1.accumulators, "{rung}");
        let picture = sums.relight(&rungs.matrices());
        assert!(picture.iter().all(|colour| colour.is_finite()), "{rung}");
        assert!(picture.iter().any(|colour| colour.max_element() > 1e4), "{rung}");
    }
}

#[test]
fn the_loss_that_is_stated_covers_what_64_bits_lose() {
    let volume = |voxels| Volume::new("whole", voxels, Geometry::unit("whole", [64, 1, 1]).unwrap()).unwrap();
    let loss = |voxels| {
        let mut scene = scenes::named("unshaded_one");
        scene.set_volume(Arc::new(volume(voxels)));
        let statistics = scene.volume().statistics().unwrap();
        Storage::new(&plan(&scene, &Quiet).unwrap().plan, scene.volume(), &statistics).loss
    };
    // From 2^62 on, f64 values are 1024 apart: all 64 values become the first, and the last moves by 63.
    let offset = 1_i64 << 62;
    assert_eq!(loss(Voxels::I64((offset..offset + 64).collect())).to_bits(), 63.0_f64.to_bits());
    // Values representable in f64 lose nothing, and neither does a single value, however large.
    assert_eq!(loss(Voxels::I64((0..64).map(|i| offset + 1024 * i).collect())).to_bits(), 0.0_f64.to_bits());
    assert_eq!(loss(Voxels::U32(vec![4_000_000_000; 64])).to_bits(), 0.0_f64.to_bits());
    // u64: 2048 apart, and the largest is 2^64 − 1.
    assert_eq!(loss(Voxels::U64(vec![u64::MAX; 64])).to_bits(), 1.0_f64.to_bits());
}

#[test]
fn without_materials_all_light_passes() {
    let mut scene = scenes::named("background");
    scene.materials.clear();
    scene.transfer.terms.clear();
    let rungs = Rungs::new(scene.clone(), SIZE);
    let background = rungs.matrices().background[0];
    for (rung, sums) in agree(scene, SIZE) {
        assert!(sums.transmittance.iter().all(|&transmitted| (transmitted - 1.0).abs() <= 0.0), "{rung}");
        assert!(
            sums.relight(&rungs.matrices()).iter().all(|&colour| colour == background),
            "{rung}: empty = background"
        );
    }
    with_renderer(|renderer| {
        let marched = rungs.gpu_accumulators(renderer);
        let shown = renderer.relight_linear(&marched).unwrap();
        shown.run(&rungs.matrices()).unwrap();
        let expected = background.to_array().map(narrow);
        let expected = [expected[0], expected[1], expected[2], 0.0].map(f32::to_bits);
        assert!(shown.read::<[f32; 4]>().unwrap().iter().all(|pixel| pixel.map(f32::to_bits) == expected));
    });
}

/// Pictures (XYZ) of a dense scene without early ray termination, and with the default threshold.
fn full_and_early(name: &str, background: Option<&Reflectance>) -> Vec<(&'static str, Vec<DVec3>, Vec<DVec3>)> {
    let mut scene = scenes::named(name);
    for term in &mut scene.transfer.terms {
        term.opacity.iter_mut().for_each(|point| point.1 = 1.0 - (1.0 - point.1).powi(4));
        term.absorption.iter_mut().for_each(|point| point.1 *= 10.0);
    }
    scene.background = background.cloned();
    // All lights together are a white of Y = 1.
    let lights = float(scene.lights.len());
    scene.lights.iter_mut().for_each(|light| light.intensity = 1.0 / lights);
    let whole = Rungs::new(scene.clone(), SIZE);
    scene.accuracy.termination = usual_termination();
    let ended = Rungs::planned(scene, whole.planned.clone(), SIZE);
    let both = marched(&whole).into_iter().zip(marched(&ended));
    both.map(|((rung, full), (_, early))| {
        assert!(full != early, "{rung}: some rays end early");
        (rung, full.relight(&whole.xyz_matrices()), early.relight(&ended.xyz_matrices()))
    })
    .collect()
}

/// Default termination threshold.
fn usual_termination() -> f64 {
    scenes::of("", scenes::slab([2, 2, 2], 0)).accuracy.termination
}

fn difference(one: DVec3, other: DVec3) -> f64 {
    let lab = |xyz: DVec3| lab_from_xyz(Xyz(xyz.to_array()), d65_white());
    ciede2000(lab(one), lab(other))
}

/// docs/theory/acceptance.md C17, without a background and in front of a perfect reflector, the brightest possible
/// background.
#[test]
fn ending_rays_early_cannot_be_seen() {
    let white = Reflectance::new(Spectrum::constant(1.0)).unwrap();
    for name in ["diffuse_three", "coloured_three"] {
        for background in [None, Some(&white)] {
            for (rung, full, early) in full_and_early(name, background) {
                for (&full, &early) in full.iter().zip(&early) {
                    let apart = (full - early).abs().max_element();
                    assert!(apart <= TERMINATION_XYZ, "{name}, {rung}: {early} for {full}");
                    let apart = difference(full, early);
                    assert!(apart <= TERMINATION_DELTA_E, "{name}, {rung}: {early} for {full}: ΔE {apart}");
                }
            }
        }
    }
}

/// docs/theory/acceptance.md C15, over opacities of every size.
#[test]
fn random_samples_add_up_as_exactly_as_they_should() {
    let (mut random, mut colours) = (Random::new(15), Random::new(16));
    for samples in [10_u16, 100, 1000, 10_000] {
        let n = f64::from(samples);
        let limit = (1e-6 + 4e-9 * n).min(EQUAL_STEPS);
        for _ in 0..50 {
            for kind in 0..4 {
                let mut opacity = || match kind {
                    0 => random.between(1e-6, 1e-4),
                    1 => random.between(0.0, 6.0 / n),
                    2 => random.between(0.3, 0.7),
                    _ if random.unit() < 0.02 => 1.0 - 1e-6,
                    _ => random.between(0.0, 3.0 / n),
                };
                // Σ T·s and T = Π (1 − α) in f64.
                let (mut single, mut exact) = (([0.0_f32], 1.0_f32), (0.0_f64, 1.0_f64));
                for _ in 0..samples {
                    let alpha = narrow(opacity());
                    let source = alpha * narrow(colours.unit());
                    composite(&mut single.0, &[source], &[single.1]);
                    single.1 = attenuate(single.1, alpha);
                    exact.0 += exact.1 * f64::from(source);
                    exact.1 *= 1.0 - f64::from(alpha);
                }
                near(&format!("{samples} samples"), single.0[0], exact.0, limit);
            }
        }
    }
}

/// Change of a scene.
type Change<'a> = &'a dyn Fn(&mut Scene);

/// docs/theory/acceptance.md C16, with coefficients.
#[test]
fn coloured_extremes_are_finite() {
    let glass = scenes::named("coloured_three");
    let with = |change: Change<'_>| {
        let mut scene = glass.clone();
        change(&mut scene);
        Rungs::new(scene, SIZE)
    };
    let absorption = |scene: &mut Scene, depth: f64| {
        scene.transfer.terms.iter_mut().flat_map(|term| &mut term.absorption).for_each(|point| point.1 *= depth);
    };
    let opacity = |scene: &mut Scene, height: f64| {
        let points = scene.transfer.terms.iter_mut().flat_map(|term| &mut term.opacity);
        points.filter(|point| point.1 > 0.0).for_each(|point| point.1 = height);
    };
    let extremes: [(&str, Change<'_>); 6] = [
        ("optical depth 1e6", &|scene| absorption(scene, 1e7)),
        ("optical depth 1e-9", &|scene| absorption(scene, 1e-8)),
        ("opacity 1", &|scene| opacity(scene, 1.0)),
        ("opacity 0", &|scene| opacity(scene, 0.0)),
        ("no light", &|scene| scene.lights.clear()),
        ("a light of nothing", &|scene| scene.lights.iter_mut().for_each(|light| light.intensity = 0.0)),
    ];
    for (what, change) in extremes {
        let rungs = with(change);
        let matrices = rungs.matrices();
        let behind: DVec3 = matrices.background.iter().sum();
        for (rung, sums) in marched(&rungs) {
            let picture = sums.relight(&matrices);
            assert!(picture.iter().all(|colour| colour.is_finite()), "{what}, {rung}");
            // The first pixel's ray misses the volume: its transmittance is 1 in every component, and the background is
            // unchanged.
            let pixels = SIZE[0] * SIZE[1];
            assert!(
                sums.transmittance.iter().step_by(pixels).all(|&transmitted| (1.0 - transmitted).abs() <= 0.0),
                "{what}, {rung}"
            );
            assert!((picture[0] - behind).abs().max_element() <= 1e-12 * behind.length(), "{what}, {rung}");
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounded once")]
fn narrow(value: f64) -> f32 {
    value as f32
}

/// Some devices silently stop an invocation after 65,535 iterations of all its loops, including those over lanes and
/// positions.
#[test]
fn many_positions_and_many_materials_take_every_sample() {
    let lights: String = (0..33)
        .map(|i| {
            format!(
                "[lights.l{i}]\nspectrum = \"E\"\nkind = \"directional\"\ndirection = [{i}, 7, -30]\nintensity = 0.1\n"
            )
        })
        .collect();
    let materials: String = (0..129)
        .map(|i| {
            format!(
                "[materials.m{i:03}]\nreflectance = 0.5\n[[transfer.intervals]]\nmaterial = \"m{i:03}\"\nrange = [{}, {}]\nopacity = 0.02\n",
                500 * i,
                500 * i + 600
            )
        })
        .collect();
    let one = "[materials.m]\nreflectance = 0.5\n[[transfer.intervals]]\nmaterial = \"m\"\nrange = [100, 60000]\nopacity = 0.02\n";
    let key = "[lights.key]\nspectrum = \"E\"\n";
    for (text, step) in [(format!("{one}{lights}"), 0.004), (format!("{materials}{key}"), 0.004)] {
        let text = format!("[accuracy]\nstep = {step}\ntermination = 0\n{text}");
        let rungs = Rungs::new(scenes::of(&text, scenes::balls()), [1, 1]);
        with_renderer(|renderer| {
            let (ours, expected) = (rungs.gpu(renderer), rungs.march(&rungs.stored::<f32>()));
            let sum = |accumulation: &Film<f32>| accumulation.accumulators.iter().map(|&w| f64::from(w)).sum::<f64>();
            let (ours, expected) = (sum(&ours), sum(&expected));
            assert!((ours - expected).abs() <= 1e-3 * expected, "{ours} for {expected}");
        });
    }
}

/// Lengths are relative to the volume's size: scaling a volume leaves the picture unchanged.
#[test]
fn a_volume_of_any_size_is_the_same_picture() {
    let picture = |spacing: f64| {
        let mut scene = scenes::named("unshaded_one");
        let mut volume = (**scene.volume()).clone();
        volume.geometry.spacing *= spacing;
        scene.set_volume(Arc::new(volume));
        scene.accuracy.step_length *= spacing;
        scene.transfer.opacity_length *= spacing;
        Rungs::new(scene, [12, 9])
    };
    with_renderer(|renderer| {
        let expected = picture(1.0).gpu(renderer);
        for spacing in [1e-40, 1e-20, 1e20, 1e35] {
            let error = picture(spacing).gpu(renderer).accumulators.iter().zip(&expected.accumulators).fold(
                0.0_f32,
                |worst, (a, b)| {
                    let error = (a - b).abs();
                    if error <= worst { worst } else { error }
                },
            );
            assert!(error <= 1e-4, "spacing {spacing:e}: {error}");
        }
    });
}

#[test]
fn normals_of_a_sphere_in_flat_voxels_point_out_of_it() {
    // A ball in the middle of 61 × 61 × 21 voxels of 1 × 1 × 3, with values that fall with the distance from the
    // centre.
    let (dims, spacing) = ([61, 61, 21], DVec3::new(1.0, 1.0, 3.0));
    let half = DVec3::from_array(dims.map(|n| 0.5 * (float(n) - 1.0))) * spacing;
    let mut scene = scenes::named("diffuse_one");
    let mut volume = scenes::sampled(dims, |p| 60000.0 - 1200.0 * (p * half).length());
    volume.geometry = Geometry::new("ball", dims, spacing, DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
    scene.set_volume(Arc::new(volume));
    let rungs = Rungs::new(scene, SIZE);
    let mut off = 0.0_f64;
    for i in 0..1000 {
        // A spiral around the sphere of radius 19.
        let z = (float(i) + 0.5) / 500.0 - 1.0;
        let (sin, cos) = (float(i) * 2.399_963).sin_cos();
        let out = DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
        let voxel = (19.0 * out + half) / spacing;
        let place = (voxel + 0.5) / DVec3::from_array(dims.map(float));
        let normals = [rungs.exact().normal(place.to_array()), rungs.stored::<f64>().normal(place.to_array())];
        for normal in normals {
            off = off.max(DVec3::from_array(normal).angle_between(-out).to_degrees());
        }
    }
    assert!(off <= 1.0, "{off}°");
}

#[test]
fn whole_numbers_of_all_16_bits_lose_nothing_beside_gradients() {
    let full =
        Volume::new("full", Voxels::U16(vec![0, 31000, 31001, 65535]), Geometry::unit("full", [4, 1, 1]).unwrap());
    let full = full.unwrap();
    let mut scene = scenes::named("diffuse_one");
    for shading in [Shading::Gradient, Shading::None] {
        scene.shading = shading;
        let storage = Storage::new(&plan(&scene, &Quiet).unwrap().plan, &full, &full.statistics().unwrap());
        // Less than the half that would round one whole number to another.
        assert!(storage.loss < 0.01, "{:?} moves values by {}", storage.format, storage.loss);
    }
}
