//! The extremes: everything stays finite, and is what it should be.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::sync::Arc;

use glam::DVec3;
use relume::plan::plan;
use relume::progress::Quiet;
use relume::reference::{Samples, Step, relight};
use relume::scene::{Aim, Projection, Scene, Shading};
use relume::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::spectrum::{Reflectance, Spectrum};
use relume::tables::{Accumulation, Storage};
use relume::volume::{Geometry, Volume, Voxels};
use support::bounds::{of_places, places};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE, float};
use support::tolerance::{EQUAL_STEPS, ROUNDINGS_PER_STEP_OF_TWO, TERMINATION_DELTA_E, TERMINATION_XYZ};

/// A volume of `dims` voxels of one value, straight on along z, in parallel rays that cover its middle.
fn straight_on(dims: [usize; 3], opacity: f64, step: f64) -> Rungs {
    let [x, y] = [dims[0], dims[1]].map(|n| 0.5 * (float(n) - 1.0));
    let text = format!(
        r#"
        shading = "none"
        [materials.only]
        reflectance = "orange"
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "only"
        range = [100, 200]
        opacity = {opacity}
        [lights.day]
        spectrum = "D65"
        [camera]
        projection = "orthographic"
        height = 0.5
        position = [{x}, {y}, -10]
        target = [{x}, {y}, 0]
        [accuracy]
        step = {step}
        termination = 0
    "#
    );
    Rungs::new(scenes::of(&text, scenes::slab(dims, 150)), [1, 1])
}

/// The rungs in f32: the reference, and the device where there is one.
fn marched(rungs: &Rungs) -> Vec<(&'static str, Accumulation<f32>)> {
    let mut all = vec![("reference f32", rungs.march::<f32>(&rungs.stored::<f32>()))];
    with_renderer(|renderer| all.push(("GPU", rungs.gpu(renderer))));
    for (rung, sums) in &all {
        assert!(sums.weights.iter().chain(&sums.transmittance).all(|number| number.is_finite()), "{rung}: {sums:?}");
        assert!(sums.transmittance.iter().all(|passed| (0.0..=1.0).contains(passed)), "{rung}: light comes and goes");
    }
    all
}

/// Each rung in f32 within its bound of the f64 reference on the same tables: so every pixel was written.
fn agree(scene: Scene, size: [usize; 2]) -> Vec<(&'static str, Accumulation<f32>)> {
    let rungs = Rungs::new(scene, size);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let places = places(&rungs);
    let bound = of_places(&rungs, &expected, [places.error; 3], ROUNDINGS_PER_STEP_OF_TWO);
    let all = marched(&rungs);
    let pixels = size[0] * size[1];
    for (rung, sums) in &all {
        assert_eq!((sums.weights.len(), sums.transmittance.len()), (expected.weights.len(), pixels), "{rung}");
        let numbers = sums.weights.iter().chain(&sums.transmittance);
        let expected = expected.weights.iter().chain(&expected.transmittance);
        let bounds = bound.weights.iter().chain(&bound.transmittance);
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
fn opacity_one_lets_nothing_pass_and_zero_everything() {
    for (rung, sums) in marched(&straight_on([5, 5, 9], 1.0, 1.0)) {
        assert_eq!((sums.transmittance[0], sums.weights[0]), (0.0, 1.0), "{rung}");
    }
    let rungs = straight_on([5, 5, 9], 0.0, 1.0);
    assert_eq!(rungs.planned.plan.components(), 0, "what is invisible has no weight");
    for (rung, sums) in marched(&rungs) {
        assert_eq!(sums.transmittance, [1.0], "{rung}");
    }
}

#[test]
fn a_step_longer_than_the_volume_is_taken_while_its_middle_is_inside() {
    // 8 units: the first sample lies half a step in, so of one step of 15 it is inside, and of one of 17 not.
    for (rung, sums) in marched(&straight_on([5, 5, 9], 0.1, 15.0)) {
        near(rung, sums.transmittance[0], 0.9_f64.powi(15), 1e-6);
    }
    for (rung, sums) in marched(&straight_on([5, 5, 9], 0.1, 17.0)) {
        assert_eq!((sums.transmittance[0], sums.weights[0]), (1.0, 0.0), "{rung}");
    }
}

#[test]
fn a_million_steps_so_thin_that_one_minus_opacity_is_one_still_shine() {
    // A step's opacity is 1e-8, below 2⁻²⁵: 1 − α rounds to 1, and so does T − T·α. What a step adds is not lost.
    let step = 1e-6;
    let opacity = 1e-2;
    let rungs = straight_on([1, 1, 2], opacity, step);
    let alpha = -(step * (-opacity).ln_1p()).exp_m1();
    assert!(1.0 - narrow(alpha) >= 1.0, "{alpha}");
    let steps = 1e6;
    for (rung, sums) in marched(&rungs) {
        // All light stays: an error of the whole depth, 0.01, and of 2⁻²⁵ per step at most.
        let depth = steps * alpha;
        assert!((1.0 - f64::from(sums.transmittance[0])).abs() <= depth, "{rung}: {sums:?}");
        // Each sum below 2⁻⁶ rounds by 2⁻³¹ at most: 4.7 % of a term, were they all to round one way.
        near(rung, sums.weights[0], depth, 0.047);
    }
}

#[test]
fn transmittance_below_the_smallest_normal_is_harmless() {
    // 0.5^200 = 6e-61.
    for (rung, sums) in marched(&straight_on([5, 5, 201], 0.5, 1.0)) {
        assert!(sums.transmittance[0] <= f32::MIN_POSITIVE, "{rung}: {sums:?}");
        near(rung, sums.weights[0], 1.0, 1e-6);
    }
}

#[test]
fn a_hundred_thousand_equal_steps_are_their_closed_form() {
    // Optical depth 1 and 5 in N = 1e5 steps (COLOUR.md C15).
    for depth in [1.0_f64, 5.0] {
        let opacity = -(-depth / 100.0).exp_m1();
        let rungs = straight_on([3, 3, 101], opacity, 1e-3);
        for (rung, sums) in marched(&rungs) {
            let [passed, weight] = [sums.transmittance[0], sums.weights[0]].map(f64::from);
            assert!((weight + passed - 1.0).abs() <= EQUAL_STEPS, "{rung}, depth {depth}: C + T = {}", weight + passed);
            near(rung, sums.weights[0], -(-depth).exp_m1(), EQUAL_STEPS);
        }
    }
}

#[test]
fn one_voxel_is_a_cube_of_its_spacing() {
    for (rung, sums) in marched(&straight_on([1, 1, 1], 0.3, 1.0)) {
        near(rung, sums.transmittance[0], 0.7, 1e-6);
        near(rung, sums.weights[0], 0.3, 1e-6);
    }
}

#[test]
fn a_line_of_voxels_is_seen_along_and_across() {
    for (rung, sums) in marched(&straight_on([1, 1, 2048], 1e-3, 1.0)) {
        near(rung, sums.transmittance[0], 0.999_f64.powi(2047), 1e-4);
    }
    for (rung, sums) in marched(&straight_on([2048, 1, 1], 0.25, 1.0)) {
        near(rung, sums.transmittance[0], 0.75, 1e-6);
    }
}

#[test]
fn rays_along_a_face_hit_once() {
    // In the plane of the outermost voxels, from which the volume begins; and just outside of it.
    for (x, expected) in [(0.0, 0.9_f64.powi(24)), (-1e-3, 1.0), (16.0, 0.9_f64.powi(24)), (16.001, 1.0)] {
        let mut rungs = straight_on([17, 17, 25], 0.1, 1.0);
        rungs.scene.camera.aim = Aim::LookAt { position: DVec3::new(x, 8.0, -10.0), target: DVec3::new(x, 8.0, 0.0) };
        for (rung, sums) in marched(&rungs) {
            near(&format!("{rung}, x = {x}"), sums.transmittance[0], expected, 1e-5);
        }
    }
}

#[test]
fn a_ray_along_an_edge_between_cells_is_not_lost() {
    let mut rungs = straight_on([17, 17, 25], 0.1, 1.0);
    // Voxel 8 is where cells meet, in x and in y: the ray runs along their common edge.
    rungs.scene.camera.aim = Aim::LookAt { position: DVec3::new(8.0, 8.0, 40.0), target: DVec3::new(8.0, 8.0, 0.0) };
    for (rung, sums) in marched(&rungs) {
        near(rung, sums.transmittance[0], 0.9_f64.powi(24), 1e-5);
    }
}

#[test]
fn a_camera_in_a_corner_of_the_volume_sees_it() {
    let mut scene = scenes::named("inside");
    scene.camera.aim = Aim::LookAt { position: DVec3::ZERO, target: DVec3::new(16.0, 14.0, 13.0) };
    agree(scene, SIZE);
}

#[test]
fn a_camera_a_million_lengths_away_is_as_sharp_as_parallel_rays() {
    // The whole volume under an angle so small that rays are parallel to 1e-6.
    let mut near = scenes::named("orthographic");
    let volume = near.volume.clone();
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
    // Besides rounding, rays lean by up to 1e-6 of the volume's depth.
    let judged = places(&near);
    let reach = judged.error + 1e-6;
    let bound = of_places(&near, &expected, [reach; 3], ROUNDINGS_PER_STEP_OF_TWO);
    let pixels = SIZE[0] * SIZE[1];
    // A headlight turns with each ray, by 1e-6 too; the plan of both is the same.
    assert_eq!(near.planned.plan.components(), far.planned.plan.components());
    for (rung, sums) in marched(&far) {
        for (i, (&found, (&expected, &bound))) in
            sums.weights.iter().zip(expected.weights.iter().zip(&bound.weights)).enumerate()
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
        assert_eq!(sums.weights, dark.iter().find(|(other, _)| *other == rung).unwrap().1.weights, "{rung}");
        let picture = relight(&sums, &rungs.matrices());
        assert!(picture.iter().all(|colour| colour.is_finite()), "{rung}");
        assert!(picture.iter().any(|colour| colour.max_element() > 1e4), "{rung}");
    }
}

#[test]
fn negative_coefficients_cancel_to_black() {
    // Two halves of one material, of opposite reflectance, everywhere mixed in equal parts.
    let mut rungs = straight_on([5, 5, 33], 0.1, 1.0);
    let mut other = rungs.scene.materials[0].clone();
    other.name = "other".into();
    let negated = rungs.scene.materials[0].reflectance.spectrum().scaled(-1.0);
    other.reflectance = Reflectance::new(negated).unwrap();
    rungs.scene.materials.push(other);
    let mut term = rungs.scene.transfer.terms[0].clone();
    term.material.0[0].1 = 1;
    rungs.scene.transfer.terms.push(term);
    let rungs = Rungs::new(rungs.scene, [1, 1]);
    for (rung, sums) in marched(&rungs) {
        assert_eq!(sums.weights[0].to_bits(), sums.weights[1].to_bits(), "{rung}");
        assert!(sums.weights[0] > 0.4, "{rung}");
        assert!(relight(&sums, &rungs.matrices())[0].length() <= 1e-15, "{rung}");
    }
}

#[test]
fn what_is_not_a_number_in_the_data_counts_as_the_smallest() {
    let dims = [16, 16, 16];
    let smooth = |i: usize| f32::from(u16::try_from(i * 37 % 991).unwrap()) * 40.0;
    let values: Vec<f32> = (0..4096).map(smooth).collect();
    let volume =
        |voxels: Vec<f32>| Volume::new("floats", Voxels::F32(voxels), Geometry::unit("floats", dims).unwrap()).unwrap();
    let [mut broken, mut mended] = [values.clone(), values];
    for i in (5..4096).step_by(97) {
        (broken[i], mended[i]) = (f32::NAN, 0.0);
    }
    (broken[1000], mended[1000]) = (f32::INFINITY, 990.0 * 40.0);
    (broken[2000], mended[2000]) = (f32::NEG_INFINITY, 0.0);
    for name in ["unshaded_one", "diffuse_one"] {
        let with = |voxels: &Vec<f32>| {
            let mut scene = scenes::named(name);
            scene.volume = Arc::new(volume(voxels.clone()));
            scene
        };
        for ((rung, broken), (_, mended)) in agree(with(&broken), SIZE).iter().zip(&agree(with(&mended), SIZE)) {
            assert!(broken == mended, "{name}, {rung}");
        }
    }
}

#[test]
fn the_loss_that_is_stated_covers_what_64_bits_lose() {
    let volume = |voxels| Volume::new("whole", voxels, Geometry::unit("whole", [64, 1, 1]).unwrap()).unwrap();
    let loss = |voxels| {
        let mut scene = scenes::named("unshaded_one");
        scene.volume = Arc::new(volume(voxels));
        let statistics = scene.volume.statistics().unwrap();
        Storage::new(&plan(&scene, &Quiet).unwrap().plan, &scene.volume, &statistics).loss
    };
    // From 2^62 on f64 are 1024 apart: all 64 values become the first, and the last moves by 63.
    let offset = 1_i64 << 62;
    assert_eq!(loss(Voxels::I64((offset..offset + 64).collect())).to_bits(), 63.0_f64.to_bits());
    // Those that an f64 can say lose nothing, and neither does one value, however large.
    assert_eq!(loss(Voxels::I64((0..64).map(|i| offset + 1024 * i).collect())).to_bits(), 0.0_f64.to_bits());
    assert_eq!(loss(Voxels::U32(vec![4_000_000_000; 64])).to_bits(), 0.0_f64.to_bits());
    // u64: 2048 apart, and the largest is 2^64 − 1.
    assert_eq!(loss(Voxels::U64(vec![u64::MAX; 64])).to_bits(), 1.0_f64.to_bits());
}

#[test]
fn a_volume_of_one_value_has_no_gradient_and_no_shading_but_ambient() {
    let mut scene = scenes::named("specular_one");
    scene.volume = Arc::new(scenes::slab([20, 20, 20], 25000));
    scene.materials.iter_mut().for_each(|material| material.ambient = 0.25);
    let rungs = Rungs::new(scene.clone(), SIZE);
    let pixels = SIZE[0] * SIZE[1];
    let materials = rungs.planned.materials.len();
    for (rung, sums) in agree(scene, SIZE) {
        assert!(sums.weights[materials * pixels..].iter().all(|&white| white <= 0.0), "{rung}: no highlight");
        let middle = SIZE[0] / 2 + SIZE[0] * (SIZE[1] / 2);
        near(rung, sums.weights[pixels + middle], 0.25 * (1.0 - f64::from(sums.transmittance[middle])), 1e-5);
    }
}

#[test]
fn without_lights_there_is_the_light_that_passes() {
    let mut scene = scenes::named("unshaded_one");
    let lit = agree(scene.clone(), SIZE);
    scene.lights.clear();
    for ((rung, dark), (_, lit)) in agree(scene, SIZE).iter().zip(&lit) {
        assert_eq!(dark.weights, [0.0_f32; 0], "{rung}");
        assert!(dark.transmittance == lit.transmittance, "{rung}");
    }
}

#[test]
fn without_materials_all_light_passes() {
    let mut scene = scenes::named("background");
    scene.materials.clear();
    scene.transfer.terms.clear();
    let rungs = Rungs::new(scene.clone(), SIZE);
    let background = rungs.matrices().background[0];
    for (rung, sums) in agree(scene, SIZE) {
        assert!(sums.transmittance.iter().all(|&passed| (passed - 1.0).abs() <= 0.0), "{rung}");
        assert!(
            relight(&sums, &rungs.matrices()).iter().all(|&colour| colour == background),
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

/// Pictures (XYZ) of a dense scene that follow each ray to its end, and that end rays at 1e-3.
fn full_and_early(background: Option<Reflectance>) -> Vec<(&'static str, Vec<DVec3>, Vec<DVec3>)> {
    let mut scene = scenes::named("diffuse_three");
    for term in &mut scene.transfer.terms {
        term.opacity.iter_mut().for_each(|point| point.1 = 1.0 - (1.0 - point.1).powi(4));
    }
    scene.background = background;
    // All lights together are a white of Y = 1.
    scene.lights.iter_mut().for_each(|light| light.intensity = 1.0 / 3.0);
    let whole = Rungs::new(scene.clone(), SIZE);
    scene.accuracy.termination = 1e-3;
    let ended = Rungs::new(scene, SIZE);
    let both = marched(&whole).into_iter().zip(marched(&ended));
    both.map(|((rung, full), (_, early))| {
        assert!(full != early, "{rung}: some rays end early");
        (rung, relight(&full, &whole.xyz_matrices()), relight(&early, &ended.xyz_matrices()))
    })
    .collect()
}

#[test]
fn ending_rays_early_moves_a_pixel_by_at_most_the_light_that_was_left() {
    // In front of a perfect reflector, which is the brightest thing that a ray can miss or keep.
    for (rung, full, early) in full_and_early(Some(Reflectance::new(Spectrum::constant(1.0)).unwrap())) {
        for (full, early) in full.iter().zip(&early) {
            let apart = (*full - *early).abs().max_element();
            assert!(apart <= TERMINATION_XYZ, "{rung}: {early} for {full}");
        }
    }
}

#[test]
fn ending_rays_early_cannot_be_seen() {
    for (rung, full, early) in full_and_early(None) {
        let lab = |xyz: &DVec3| lab_from_xyz(Xyz(xyz.to_array()), d65_white());
        for (full, early) in full.iter().zip(&early) {
            let difference = ciede2000(lab(full), lab(early));
            assert!(difference <= TERMINATION_DELTA_E, "{rung}: {early} for {full}: ΔE {difference}");
        }
    }
}

#[expect(clippy::cast_possible_truncation, reason = "rounded once")]
fn narrow(value: f64) -> f32 {
    value as f32
}

/// Some devices stop an invocation, silently, after 65,535 iterations of all its loops; lanes and positions count too.
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
            let sum =
                |accumulation: &Accumulation<f32>| accumulation.weights.iter().map(|&w| f64::from(w)).sum::<f64>();
            let (ours, expected) = (sum(&ours), sum(&expected));
            assert!((ours - expected).abs() <= 1e-3 * expected, "{ours} for {expected}");
        });
    }
}

/// Lengths count in the volume's own unit: a volume of any size is the same picture.
#[test]
fn a_volume_of_any_size_is_the_same_picture() {
    let picture = |spacing: f64| {
        let mut scene = scenes::named("unshaded_one");
        let mut volume = (*scene.volume).clone();
        volume.geometry.spacing *= spacing;
        scene.volume = Arc::new(volume);
        scene.accuracy.step_length *= spacing;
        scene.transfer.opacity_length *= spacing;
        Rungs::new(scene, [12, 9])
    };
    with_renderer(|renderer| {
        let expected = picture(1.0).gpu(renderer);
        for spacing in [1e-40, 1e-20, 1e20, 1e35] {
            let error =
                picture(spacing).gpu(renderer).weights.iter().zip(&expected.weights).fold(0.0_f32, |worst, (a, b)| {
                    let error = (a - b).abs();
                    if error <= worst { worst } else { error }
                });
            assert!(error <= 1e-4, "spacing {spacing:e}: {error}");
        }
    });
}

#[test]
fn normals_of_a_sphere_in_flat_voxels_point_out_of_it() {
    // A ball about the middle of 61 × 61 × 21 voxels of 1 × 1 × 3, whose value falls with the distance from it.
    let (dims, spacing) = ([61, 61, 21], DVec3::new(1.0, 1.0, 3.0));
    let half = DVec3::from_array(dims.map(|n| 0.5 * (float(n) - 1.0))) * spacing;
    let mut scene = scenes::named("diffuse_one");
    let mut volume = scenes::sampled(dims, |p| 60000.0 - 1200.0 * (p * half).length());
    volume.geometry = Geometry::new("ball", dims, spacing, DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
    scene.volume = Arc::new(volume);
    let rungs = Rungs::new(scene, SIZE);
    let mut off = 0.0_f64;
    for i in 0..1000 {
        // A spiral around the sphere of radius 19.
        let z = (float(i) + 0.5) / 500.0 - 1.0;
        let (sin, cos) = (float(i) * 2.399_963).sin_cos();
        let out = DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z);
        let voxel = (19.0 * out + half) / spacing;
        let place = (voxel + 0.5) / DVec3::from_array(dims.map(float));
        let [mut exact, mut stored] = [Step::<f64>::default(), Step::<f64>::default()];
        rungs.exact().sample(place.to_array(), &mut exact);
        rungs.stored::<f64>().sample(place.to_array(), &mut stored);
        for step in [exact, stored] {
            off = off.max(DVec3::from_array(step.normal).angle_between(-out).to_degrees());
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
