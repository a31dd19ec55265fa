//! Every scene on every rung, with one kind of error between neighbouring rungs:
//! closed form —*step*— full spectrum f64 —*basis*— reference f64 —*tables and storage*— reference f64 on the stored
//! tables and volume —*rounding*— reference f32 —*device*— GPU.
#![expect(clippy::print_stdout, reason = "the measured errors, for whoever asks with --nocapture")]

use crate::support;

use glam::DVec3;
use relume::film::{Components, Film, RelightMatrices};
use relume::number::Real;
use relume::output::{Alpha, Depth, Picture, display_codes};
use relume::plan::{FilmCounts, Integrate, ScenePlan};
use relume::reference::{End, Samples, Step, Stored};
use relume::render::Renderer;
use relume::scene::{Backdrop, Gradients, Integration, Interpolation, Lookup, Tone};
use relume::spectrum::Spectrum;
use relume::spectrum::colour::{Lab, Xyz, ciede2000, lab_from_xyz, xyz_of};
use relume::volume::{Geometry, Volume, Voxels};
use relume::vulkan::DeviceKind;
use support::bounds::{longest, of_places, of_tables, places};
use support::golden::{self, Image};
use support::rungs::{Rungs, magnitudes, with_renderer};
use support::scenes::{self, SIZE, float};
use support::tolerance::{
    BASIS, BOUND, DEVICE_MEAN, ROUNDING_UNIT, ROUNDINGS_PER_STEP, ROUNDINGS_PER_STEP_OF_TWO, SHARPENED, STORED,
    WEIGHTS_DEVICE, WEIGHTS_DEVICE_P99, WEIGHTS_REFERENCE,
};

/// Largest error, and largest ratio of an error to its bound.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    error: f64,
    share: f64,
    sum: f64,
    count: f64,
}

impl Worst {
    fn add(&mut self, error: f64, bound: f64) {
        // NaN counts as infinite.
        let (error, share) = if error.is_nan() { (f64::INFINITY, f64::INFINITY) } else { (error, error / bound) };
        self.error = self.error.max(error);
        self.share = self.share.max(share);
        self.sum += error;
        self.count += 1.0;
    }

    fn mean(&self) -> f64 {
        self.sum / self.count.max(1.0)
    }
}

/// Compares `actual` with `expected` number by number against `bound`, except in pixels that are `undecided`.
fn accumulators<A: Real, E: Real>(
    actual: &Film<A>,
    expected: &Film<E>,
    bound: &Film<f64>,
    undecided: &[bool],
) -> Worst {
    let pixels = expected.size[0] * expected.size[1];
    assert_eq!(actual.accumulators.len(), expected.accumulators.len(), "the same accumulators");
    assert_eq!(actual.transmittance.len(), expected.transmittance.len(), "the same numbers of the transmittance");
    let mut worst = Worst::default();
    let pairs = actual.accumulators.iter().zip(&expected.accumulators).zip(&bound.accumulators);
    for (i, ((actual, expected), &bound)) in pairs.enumerate() {
        if !undecided[i % pixels] {
            worst.add((actual.to_f64() - expected.to_f64()).abs(), bound);
        }
    }
    let pairs = actual.transmittance.iter().zip(&expected.transmittance).zip(&bound.transmittance);
    for (i, ((actual, expected), &bound)) in pairs.enumerate() {
        if !undecided[i % pixels] {
            worst.add((actual.to_f64() - expected.to_f64()).abs(), bound);
        }
    }
    worst
}

/// The same for colours.
fn colours(actual: &[DVec3], expected: &[DVec3], bound: &[DVec3], undecided: &[bool]) -> Worst {
    let mut worst = Worst::default();
    for (i, ((actual, expected), bound)) in actual.iter().zip(expected).zip(bound).enumerate() {
        if !undecided[i] {
            for channel in 0..3 {
                let bound = bound[channel] + f64::MIN_POSITIVE;
                worst.add((actual[channel] - expected[channel]).abs(), bound);
            }
        }
    }
    worst
}

/// Linear RGB picture with a bound for each sample.
#[expect(clippy::cast_possible_truncation, reason = "golden images are f32")]
fn image(source: &str, colours: &[DVec3], bound: impl Fn(usize, usize) -> f64) -> Image {
    let samples = colours.iter().flat_map(|colour| colour.to_array().map(|channel| channel as f32)).collect();
    let scale = (0..3 * colours.len()).map(|i| bound(i / 3, i % 3) + f64::from(f32::MIN_POSITIVE)).collect();
    Image { scale: Some(scale), ..Image::rgb(source, SIZE[0], SIZE[1], samples) }
}

/// ΔE00 of every pixel under the white of all lights together, sorted.
fn differences(rungs: &Rungs, actual: &[DVec3], expected: &[DVec3]) -> Vec<f64> {
    let light = |sum: Spectrum, weighted: Spectrum| &sum + &weighted;
    let lights = rungs.mix.0.iter().map(|light| light.spectrum.spectrum().scaled(light.weight));
    let white = xyz_of(&lights.fold(Spectrum::constant(0.0), light));
    let lab = |colour: &DVec3| -> Lab { lab_from_xyz(Xyz(colour.to_array()), white) };
    let mut found: Vec<f64> = actual.iter().zip(expected).map(|(a, e)| ciede2000(lab(a), lab(e))).collect();
    found.sort_by(f64::total_cmp);
    found
}

/// Largest distance between the samples of two devices, in texture coordinates: both round, and hardware filters with
/// few
/// bits.
fn reach_of_device(rungs: &Rungs, renderer: &Renderer) -> [f64; 3] {
    let error = 2.0 * places(rungs).error;
    // A software device filters in f32, with the roundings of the place.
    let texel = if renderer.device().info().kind == DeviceKind::Software {
        0.0
    } else {
        0.5_f64.powi(i32::try_from(renderer.device().limits().sub_texel_precision_bits).unwrap())
    };
    rungs.scene.frame.geometry.dims.map(|n| error + texel / float(n))
}

/// True if differences between the rungs of a plan have derived bounds.
pub(super) fn has_bounds(plan: &ScenePlan) -> bool {
    let ScenePlan {
        light,
        integration,
        blending,
        labels_by_value,
        groups,
        interpolation,
        gradients,
        phases,
        thin_films,
        rays,
        lookup,
        ..
    } = plan;
    let is_lit = groups.lit_fields().next().is_some();
    let is_sampled = *integration == Integrate::Samples && !blending.is_extreme() && !labels_by_value && !is_lit;
    let is_plain = is_sampled && *gradients == Gradients::Packed && *rays == 1;
    // Both nearest, or both linear.
    let fetched = match lookup {
        Lookup::Linear => Interpolation::Linear,
        Lookup::Nearest => Interpolation::Nearest,
    };
    is_plain && *interpolation == fetched && !light.is_dimmed() && *phases == 0 && *thin_films == FilmCounts::default()
}

/// Compares all rungs of a scene.
pub(super) fn climb(name: &str, rungs: &Rungs, renderer: Option<&Renderer>) {
    let all = vec![false; SIZE[0] * SIZE[1]];
    let places = places(rungs);
    let undecided = places.undecided.iter().filter(|&&undecided| undecided).count();
    // 18 more roundings within a step that is closed (`shaders/densities.wgsl`), and a product and a sum for each group in it.
    let groups = rungs.planned.plan.groups;
    let more = if groups.any() { 18.0 / longest(rungs) + 2.0 * float(groups.number - 1) } else { 0.0 };
    let lit = |accumulation: &Film<f64>| accumulation.relight(&rungs.xyz_matrices());

    // Basis: weights are exact up to the order of sums; a colour model may be off by its tolerance.
    let exact = rungs.march::<f64>(&rungs.exact());
    let truth = rungs.truth();
    let basis = match &rungs.planned.model {
        None => {
            let bound: Vec<DVec3> = magnitudes(&exact, &xyz_of_bands(rungs)).iter().map(|&sum| BASIS * sum).collect();
            let basis = colours(&lit(&exact), &truth, &bound, &all);
            assert!(basis.share <= 1.0, "{name}: basis: {basis:?}");
            basis.share * BASIS
        }
        Some(model) => {
            let worst = differences(rungs, &lit(&exact), &truth).last().copied().unwrap();
            let scene = &rungs.scene.accuracy;
            let limit = if scene.dimension.is_none() { scene.tolerance } else { SHARPENED };
            assert!(worst <= limit, "{name}: basis: ΔE00 {worst} of {}", model.description());
            worst
        }
    };
    assert!(truth.iter().any(|colour| colour.y > 0.05), "{name} shows something");

    // Tables and storage. Nearest lookup is part of the scene, not an approximation of it.
    let stored = rungs.march::<f64>(&rungs.stored::<f64>());
    let (mut tables, mut tables_xyz) = (Worst::default(), Worst::default());
    if rungs.planned.plan.lookup == Lookup::Linear && more == 0.0 {
        let bound = of_tables(rungs, &exact);
        tables = accumulators(&stored, &exact, &bound, &all);
        assert!(tables.share <= 1.0, "{name}: tables and storage: {tables:?}");
        let bound = magnitudes(&bound, &rungs.xyz_matrices());
        tables_xyz = colours(&lit(&stored), &lit(&exact), &bound, &all);
        assert!(tables_xyz.share <= 1.0, "{name}: tables and storage, XYZ: {tables_xyz:?}");
    }

    // This rung alone may write the golden image.
    let picture = stored.relight(&rungs.matrices());
    let scale = magnitudes(&stored, &rungs.matrices());
    let is_golden = scenes::NAMES.contains(&name);
    if is_golden {
        golden::check(name, &image("reference f64", &picture, |pixel, channel| scale[pixel][channel]), &STORED);
    }

    // Rounding.
    let single = rungs.march::<f32>(&rungs.stored::<f32>());
    let bound = of_places(rungs, &stored, [places.error; 3], ROUNDINGS_PER_STEP + more);
    let rounding = accumulators(&single, &stored, &bound, &places.undecided);
    assert!(rounding.share <= 1.0, "{name}: rounding: {rounding:?}");
    assert!(undecided * 50 <= all.len(), "{name}: {undecided} of {} pixels cannot be judged", all.len());
    let bound = magnitudes(&bound, &rungs.matrices());
    let golden_bound = |pixel: usize, channel: usize| {
        let undecided = if places.undecided[pixel] { f64::from(f32::MAX) } else { 0.0 };
        bound[pixel][channel] + 2.0 * ROUNDING_UNIT * scale[pixel][channel] + undecided
    };
    if is_golden {
        golden::check(name, &image("reference f32", &single.relight(&rungs.matrices()), golden_bound), &BOUND);
    }

    // Material weights against 81 bands over the same tables; coefficients against themselves in f64.
    let same_tables = if rungs.planned.model.is_none() { rungs.stored_truth() } else { lit(&stored) };
    let weights = differences(rungs, &single.relight(&rungs.xyz_matrices()), &same_tables);
    let weights = weights.last().copied().unwrap();
    assert!(weights <= WEIGHTS_REFERENCE, "{name}: ΔE00 of the f32 reference: {weights}");

    // The device rung.
    let Some(renderer) = renderer else { return };
    let accumulated = rungs.filtered_accumulators(renderer);
    let gpu = renderer.read(&accumulated).unwrap();
    let bound = of_places(rungs, &single, reach_of_device(rungs, renderer), ROUNDINGS_PER_STEP_OF_TWO + 2.0 * more);
    let device = accumulators(&gpu, &single, &bound, &places.undecided);
    assert!(device.share <= 1.0, "{name}: device: {device:?}");
    let gpu_xyz = gpu.relight(&rungs.xyz_matrices());
    let bound = magnitudes(&bound, &rungs.xyz_matrices());
    let device_xyz = colours(&gpu_xyz, &single.relight(&rungs.xyz_matrices()), &bound, &places.undecided);
    assert!(device_xyz.share <= 1.0, "{name}: device, XYZ: {device_xyz:?}");
    let filters_exactly = renderer.device().info().kind == DeviceKind::Software;
    if filters_exactly {
        assert!(device_xyz.mean() <= DEVICE_MEAN, "{name}: device, XYZ, mean: {}", device_xyz.mean());
    }
    let exact_xyz = if filters_exactly { gpu_xyz } else { rungs.gpu(renderer).relight(&rungs.xyz_matrices()) };
    let differences = differences(rungs, &exact_xyz, &same_tables);
    let p99 = differences[differences.len() * 99 / 100];
    let largest = differences.last().copied().unwrap();
    assert!(p99 <= WEIGHTS_DEVICE_P99, "{name}: ΔE00 of the device, 99 %: {p99}");
    assert!(largest <= WEIGHTS_DEVICE, "{name}: ΔE00 of the device: {largest}");

    // Relight on the device from its own accumulators: a product and a sum per component, each rounded.
    let shown = renderer.relight_linear(&accumulated).unwrap();
    shown.run(&rungs.matrices()).unwrap();
    let shown: Vec<[f32; 4]> = shown.read().unwrap();
    let terms = float(rungs.matrices().colours.len() + rungs.matrices().background.len()) + 1.0;
    let bound: Vec<DVec3> =
        magnitudes(&gpu, &rungs.matrices()).iter().map(|&sum| 3.0 * terms * ROUNDING_UNIT * sum).collect();
    let linear: Vec<DVec3> = shown.iter().map(|&[r, g, b, _]| [r, g, b].map(f64::from).into()).collect();
    let relit = colours(&linear, &gpu.relight(&rungs.matrices()), &bound, &all);
    assert!(relit.share <= 1.0, "{name}: relight: {relit:?}");
    let summed = f64::from(f32::EPSILON) * float(rungs.planned.plan.transmittance_numbers());
    for (pixel, expected) in shown.iter().zip(gpu.opacity(&rungs.matrices())) {
        assert!((f64::from(pixel[3]) - expected).abs() <= summed, "{name}: opacity {} for {expected}", pixel[3]);
    }

    println!(
        "| {name} | {:.0} | {:.1e} | {:.1e} ({:.2}) | {:.1e} ({:.3}) | {:.1e} ({:.4}) | {:.1e} | {weights:.1e} | {p99:.1e} | {largest:.1e} | {undecided} |",
        longest(rungs),
        basis,
        tables_xyz.error,
        tables.share,
        rounding.error,
        rounding.share,
        device_xyz.error,
        device.share,
        device_xyz.mean(),
    );
}

/// Relight matrices with entries Σ over bands |light · surface · observer|, the scale of rounding errors of sums over
/// bands.
fn xyz_of_bands(rungs: &Rungs) -> RelightMatrices {
    let absolute = |spectrum: &Spectrum| Spectrum::from_samples(spectrum.samples().map(f64::abs));
    let light_at = |position: Option<usize>| {
        let lights = rungs.mix.0.iter().filter(|light| position.is_none_or(|position| position == light.position));
        lights.fold(Spectrum::constant(0.0), |sum, light| {
            &sum + &absolute(&light.spectrum.spectrum().scaled(light.weight))
        })
    };
    let lit = |light: &Spectrum, surface: &Spectrum| DVec3::from_array(xyz_of(&(light * &absolute(surface))).0);
    let Components::Surfaces(components) = Components::new(&rungs.scene, &rungs.planned) else {
        panic!("the scenes of the ladder are planned by weights");
    };
    let black = Spectrum::constant(0.0);
    RelightMatrices {
        colours: (0..rungs.planned.positions.len())
            .flat_map(|position| {
                let light = light_at(Some(position));
                components.iter().map(move |surface| lit(&light, surface)).collect::<Vec<_>>()
            })
            .collect(),
        background: vec![lit(
            &light_at(None),
            rungs.scene.background.as_ref().map_or(&black, |surface| surface.spectrum()),
        )],
        transmittance_weights: vec![1.0],
        tone: Tone::Linear,
        backdrop: Backdrop::None,
    }
}

fn slab_straight_on(step: f64, opacity: f64) -> Rungs {
    Rungs::new(scenes::slab_straight_on(step, opacity, ""), [8, 8])
}

/// Closed form of a slab 24 units thick: transmittance, and the weight of the material.
fn closed_form(opacity: f64) -> (f64, f64) {
    let depth = -(-opacity).ln_1p() * 24.0;
    ((-depth).exp(), -(-depth).exp_m1())
}

#[test]
fn a_slab_is_its_closed_form_on_every_rung() {
    for (step, opacity) in [(0.7, 0.05), (0.7, 0.4), (1.0, 1e-6), (0.013, 0.05)] {
        let rungs = slab_straight_on(step, opacity);
        let (left, weight) = closed_form(opacity);
        let near = |what: &str, found: f64, expected: f64, limit: f64| {
            let error = (found - expected).abs() / expected;
            assert!(
                error <= limit,
                "{what}, Δs = {step}, o = {opacity}: {found} for {expected}: {error:e} > {limit:e}"
            );
        };
        let steps = longest(&rungs);
        // n roundings of 2⁻⁵³ in T, n in the sum, and some in the exponential.
        let double = 4.0 * steps * f64::EPSILON;
        let truth = rungs.truth();
        let material = rungs.scene.materials[0].reflectance.clone();
        let surface = relume::spectrum::colour::xyz(&rungs.mix.0[0].spectrum, &material);
        near("81 bands", truth[27].y, weight * surface.0[1], BASIS + double);
        let check = |what: &str, weights: &[f64], transmittance: &[f64], limit: f64| {
            weights.iter().for_each(|&found| near(what, found, weight, limit));
            transmittance.iter().for_each(|&found| near(what, found, left, limit));
        };
        let wide = |sums: &[f32]| -> Vec<f64> { sums.iter().copied().map(f64::from).collect() };
        let exact = rungs.march::<f64>(&rungs.exact());
        check("reference f64", &exact.accumulators, &exact.transmittance, double);
        let single = rungs.march::<f32>(&rungs.stored::<f32>());
        let rounded = ROUNDINGS_PER_STEP * steps * ROUNDING_UNIT;
        check("reference f32", &wide(&single.accumulators), &wide(&single.transmittance), rounded);
        with_renderer(|renderer| {
            let gpu = rungs.gpu(renderer);
            check("GPU", &wide(&gpu.accumulators), &wide(&gpu.transmittance), 2.0 * rounded);
        });
    }
}

#[test]
fn a_displayed_picture_has_the_codes_of_the_curve_of_srgb() {
    let curve = |linear: f64| match linear.clamp(0.0, 1.0) {
        dark if dark <= 0.003_130_8 => 12.92 * dark,
        bright => 1.055_f64.mul_add(bright.powf(1.0 / 2.4), -0.055),
    };
    let rungs = slab_straight_on(1.0, 0.05);
    with_renderer(|renderer| {
        let accumulators = rungs.gpu_accumulators(renderer);
        let display = renderer.relight_display(&accumulators).unwrap();
        let linear = renderer.relight_linear(&accumulators).unwrap();
        let mut seen = std::collections::BTreeSet::new();
        for level in 0..1000 {
            let mut matrices = rungs.matrices();
            matrices.colours.iter_mut().for_each(|colour| *colour *= (f64::from(level) / 500.0).powi(2));
            display.run(&matrices).unwrap();
            linear.run(&matrices).unwrap();
            let (codes, lit) = (display.read::<[u8; 4]>().unwrap(), linear.read::<[f32; 4]>().unwrap());
            for (&code, &lit) in codes[0][..3].iter().zip(&lit[0]) {
                let exact = 255.0 * curve(f64::from(lit));
                assert!((f64::from(code) - exact).abs() <= 0.5 + 1e-3, "{code} for {exact}");
                seen.insert(code);
            }
        }
        assert_eq!(seen.len(), 256, "{seen:?}");
    });
}

#[test]
fn a_soft_tone_and_a_backdrop_have_the_codes_of_the_host() {
    let rungs = Rungs::new(scenes::named("diffuse_one"), [32, 24]);
    with_renderer(|renderer| {
        let accumulators = rungs.gpu_accumulators(renderer);
        let linear = renderer.relight_linear(&accumulators).unwrap();
        let display = renderer.relight_display_over(&accumulators, Backdrop::Dark).unwrap();
        let window = renderer.relight_window(&accumulators, Backdrop::Dark).unwrap();
        for bright in [0.5, 8.0, 80.0] {
            let mut matrices = RelightMatrices { tone: Tone::Soft, backdrop: Backdrop::Dark, ..rungs.matrices() };
            matrices.colours.iter_mut().for_each(|colour| *colour *= bright);
            for relight in [&linear, &display, &window] {
                relight.run(&matrices).unwrap();
            }
            let mut shown: Vec<f32> = linear.read().unwrap();
            assert!(shown.iter().any(|&part| bright < 1.0 || part > 0.75), "{bright}: something is compressed");
            Tone::Soft.show(&mut shown);
            Backdrop::behind(Backdrop::Dark.colours().unwrap(), &mut shown, 32);
            let picture = Picture::new(32, 24, &shown).unwrap();
            let codes = display_codes(&picture, Depth::Eight, Alpha::OverBlack);
            let (found, swapped) = (display.read::<[u8; 4]>().unwrap(), window.read::<[u8; 4]>().unwrap());
            for ((code, found), swapped) in codes.chunks_exact(3).zip(&found).zip(&swapped) {
                let apart = (0..3).map(|channel| code[channel].abs_diff(found[channel])).max();
                assert!(apart <= Some(1), "{bright}: {code:?}, and {found:?} on the device");
                assert_eq!([swapped[2], swapped[1], swapped[0]], found[..3], "{bright}: blue first");
            }
            assert_eq!(found[0][..3], [0x2a, 0x2f, 0x38], "the corner is the backdrop");
        }
    });
}

#[test]
fn the_ladder_catches_two_materials_swapped() {
    let mut rungs = Rungs::new(scenes::named("diffuse_one"), SIZE);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let bound = of_places(&rungs, &expected, [places(&rungs).error; 3], ROUNDINGS_PER_STEP_OF_TWO);
    rungs.table.source.iter_mut().for_each(|weights| weights.swap(0, 1));
    let swapped = rungs.march::<f32>(&rungs.stored::<f32>());
    assert!(accumulators(&swapped, &expected, &bound, &vec![false; SIZE[0] * SIZE[1]]).share > 10.0);
}

/// Ratio of error to bound for the rounding rung of `coloured_one` after a change of its table.
fn glass_changed(change: impl FnOnce(&mut Rungs)) -> f64 {
    let mut rungs = Rungs::new(scenes::named("coloured_one"), SIZE);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let bound = of_places(&rungs, &expected, [places(&rungs).error; 3], ROUNDINGS_PER_STEP_OF_TWO);
    change(&mut rungs);
    let changed = rungs.march::<f32>(&rungs.stored::<f32>());
    accumulators(&changed, &expected, &bound, &places(&rungs).undecided).share
}

#[test]
fn the_ladder_catches_what_goes_wrong_in_one_number_of_a_spectrum() {
    assert!(glass_changed(|_| {}) <= 1.0, "the same picture");
    let swapped = glass_changed(|rungs| rungs.table.source.iter_mut().for_each(|vector| vector.swap(0, 1)));
    let dimension = |rungs: &Rungs| rungs.table.opacity_numbers;
    let faded = glass_changed(|rungs| {
        let numbers = dimension(rungs);
        rungs.table.opacity.chunks_exact_mut(numbers).for_each(|numbers| numbers[1] *= 1.001);
    });
    // Grey transmittance in place of coefficients.
    let grey = glass_changed(|rungs| {
        let numbers = dimension(rungs);
        rungs.table.opacity.chunks_exact_mut(numbers).for_each(|numbers| numbers.fill(numbers[0]));
    });
    assert!(swapped > 10.0 && faded > 1.0 && grey > 10.0, "{swapped}, {faded}, {grey}");
}

#[test]
fn the_ladder_catches_a_hundredth_of_a_step_in_every_scene() {
    for name in scenes::NAMES {
        let mut rungs = Rungs::new(scenes::named(name), SIZE);
        let expected = rungs.march::<f64>(&rungs.stored::<f64>());
        let places = places(&rungs);
        let bound = of_places(&rungs, &expected, [places.error; 3], ROUNDINGS_PER_STEP_OF_TWO);
        let still = accumulators(&rungs.march::<f32>(&rungs.stored::<f32>()), &expected, &bound, &places.undecided);
        assert!(still.share <= 1.0, "{name}: the same picture: {still:?}");
        rungs.scene.accuracy.step_length *= 1.01;
        let moved = accumulators(&rungs.march::<f32>(&rungs.stored::<f32>()), &expected, &bound, &places.undecided);
        assert!(moved.share > 10.0, "{name}: {moved:?}");
    }
}

#[test]
fn the_ladder_catches_a_hundredth_of_a_voxel_of_a_plane() {
    for name in ["clipped_unshaded", "clipped_diffuse_three", "clipped_coloured_three"] {
        let mut rungs = Rungs::new(scenes::named(name), SIZE);
        let expected = rungs.march::<f64>(&rungs.stored::<f64>());
        let places = places(&rungs);
        let bound = of_places(&rungs, &expected, [places.error; 3], ROUNDINGS_PER_STEP_OF_TWO);
        let still = accumulators(&rungs.march::<f32>(&rungs.stored::<f32>()), &expected, &bound, &places.undecided);
        assert!(still.share <= 1.0, "{name}: the same picture: {still:?}");
        for plane in &mut rungs.scene.clip.planes {
            plane.point -= 0.01 * plane.outward();
        }
        let moved = accumulators(&rungs.march::<f32>(&rungs.stored::<f32>()), &expected, &bound, &places.undecided);
        assert!(moved.share > 1.0, "{name}: {moved:?}");
    }
}

#[test]
fn the_ladder_catches_half_a_pixel_of_shift() {
    let still = shifted(0.0);
    assert!(still.share <= 1.0, "the same picture: {still:?}");
    let moved = shifted(0.5);
    assert!(moved.share > 10.0, "half a pixel: {moved:?}");
}

#[test]
fn the_ladder_catches_a_thousandth_of_a_step() {
    let mut rungs = Rungs::new(scenes::named("inside"), SIZE);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let bound = of_places(&rungs, &expected, [places(&rungs).error; 3], ROUNDINGS_PER_STEP_OF_TWO);
    rungs.scene.accuracy.step_length *= 1.001;
    let moved = rungs.march::<f32>(&rungs.stored::<f32>());
    assert!(accumulators(&moved, &expected, &bound, &places(&rungs).undecided).share > 1.0);
}

#[test]
fn the_ladder_catches_one_wrong_entry_of_the_table() {
    let mut rungs = Rungs::new(scenes::named("unshaded_one"), SIZE);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let bound = of_tables(&rungs, &expected);
    let entry = rungs.table.entries() * 2 / 5;
    rungs.table.source[entry][1] *= 1.1;
    let wrong = rungs.march::<f64>(&rungs.stored::<f64>());
    assert!(accumulators(&wrong, &expected, &bound, &vec![false; SIZE[0] * SIZE[1]]).share > 1.0);
}

/// Filter with 256 positions between two texels, as in hardware.
struct EightBits<'a>(Stored<'a, f32>, [usize; 3]);

impl EightBits<'_> {
    /// The position of the filter next to `place`.
    fn position(&self, place: [f32; 3]) -> [f32; 3] {
        let places = self.1.map(|n| 256.0 * f32::from(u16::try_from(n).unwrap()));
        std::array::from_fn(|axis| (place[axis] * places[axis]).round() / places[axis])
    }
}

impl Samples<f32> for EightBits<'_> {
    fn sample(&self, place: [f32; 3], step: &mut Step<f32>) {
        self.0.sample(self.position(place), step);
    }

    fn normal(&self, place: [f32; 3]) -> [f32; 3] {
        self.0.normal(self.position(place))
    }

    fn end(&self, place: [f32; 3]) -> End<f32> {
        self.0.end(place)
    }

    fn mean(&self, ends: [&End<f32>; 2], middle: [f32; 3], density: &mut Step<f32>) -> f32 {
        self.0.mean(ends, middle, density)
    }

    fn extinction(&self, place: [f32; 3], number: usize) -> f32 {
        self.0.extinction(place, number)
    }
}

#[test]
fn the_mean_over_a_picture_catches_a_filter_of_eight_bits() {
    for name in ["unshaded_one", "diffuse_one"] {
        let rungs = Rungs::new(scenes::named(name), SIZE);
        let none = vec![DVec3::ONE; SIZE[0] * SIZE[1]];
        let [expected, coarse] = [
            rungs.march::<f32>(&rungs.stored::<f32>()),
            rungs.march::<f32>(&EightBits(rungs.stored::<f32>(), rungs.volume.dims)),
        ]
        .map(|sums| sums.relight(&rungs.xyz_matrices()));
        let mean = colours(&coarse, &expected, &none, &vec![false; none.len()]).mean();
        assert!(mean > DEVICE_MEAN, "{name}: {mean}");
    }
}

#[test]
fn the_ladder_catches_a_number_that_is_none() {
    let rungs = Rungs::new(scenes::named("unshaded_one"), SIZE);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let bound = of_tables(&rungs, &expected);
    let mut wrong = expected.clone();
    wrong.accumulators[700] = f64::NAN;
    assert!(accumulators(&wrong, &expected, &bound, &vec![false; SIZE[0] * SIZE[1]]).share > 1.0);
}

/// Compares the picture of a volume shifted by `pixels` with the original picture.
fn shifted(pixels: f64) -> Worst {
    let mut rungs = Rungs::new(scenes::named("orthographic"), SIZE);
    let expected = rungs.march::<f64>(&rungs.stored::<f64>());
    let places = places(&rungs);
    let bound = of_places(&rungs, &expected, [places.error; 3], ROUNDINGS_PER_STEP_OF_TWO);
    let aspect = float(SIZE[0]) / float(SIZE[1]);
    let view = rungs.scene.camera.view(&rungs.scene.frame.geometry, aspect).unwrap();
    let mut volume = (**rungs.scene.volume()).clone();
    volume.geometry.origin += view.right * (pixels * 2.0 * view.half[0] / float(SIZE[0]));
    rungs.scene.camera = relume::scene::Camera {
        aim: relume::scene::Aim::LookAt { position: view.eye, target: view.eye + view.forward },
        projection: relume::scene::Projection::Orthographic { height: Some(2.0 * view.half[1]) },
        ..rungs.scene.camera
    };
    rungs.scene.set_volume(std::sync::Arc::new(volume));
    let moved = rungs.march::<f32>(&rungs.stored::<f32>());
    accumulators(&moved, &expected, &bound, &places.undecided)
}

/// Values that rise by 1000 per voxel along x, 500 per world unit, seen along z by parallel rays: 24 units in steps of
/// 0.7.
fn ramp(materials: &str, absorption: &str, head: &str) -> Rungs {
    let text = format!(
        r#"
        {head}
        [materials.only]
        reflectance = "orange"
        {materials}
        [transfer]
        opacity_length = 1
        gradient_opacity = [[300, 0.1], [700, 0.9]]
        [[transfer.intervals]]
        material = "only"
        range = [-1e6, 1e6]
        opacity = 0.2
        {absorption}
        [camera]
        projection = "orthographic"
        height = 4
        position = [16, 4, -10]
        target = [16, 4, 0]
        [accuracy]
        step = 0.7
        termination = 0
        "#
    );
    let voxels = (0..17 * 9 * 25).map(|voxel| u16::try_from(1000 * (voxel % 17)).unwrap()).collect();
    let dims = [17, 9, 25];
    let spacing = DVec3::new(2.0, 1.0, 1.0);
    let geometry = Geometry::new("ramp", dims, spacing, DVec3::ZERO, glam::DMat3::IDENTITY).unwrap();
    Rungs::new(scenes::of(&text, Volume::new("ramp", Voxels::U16(voxels), geometry).unwrap()), [8, 8])
}

/// Compares every number of every rung of a [`ramp`] with its closed form: accumulators, and transmittances, one number
/// each.
fn check_ramp(what: &str, rungs: &Rungs, accumulators: &[f64], transmittances: &[f64]) {
    let check = |rung: &str, film: &Film<f64>, limit: f64| {
        let pixels = 64;
        for (found, expected) in [(&film.accumulators, accumulators), (&film.transmittance, transmittances)] {
            assert_eq!(found.len(), pixels * expected.len(), "{what}: numbers of a pixel");
            for (i, found) in found.iter().enumerate() {
                let expected = expected[i / pixels];
                let error = (found - expected).abs() / expected.abs().max(f64::from(f32::MIN_POSITIVE));
                assert!(error <= limit, "{what}, {rung}: {found} for {expected}: {error:e} > {limit:e}");
            }
        }
    };
    let steps = longest(rungs);
    check("reference f64", &rungs.march::<f64>(&rungs.exact()), 1e-12);
    // The entry, the three numbers of a piece of the factor, and twelve within a step, of a factor of 0.5.
    let mut tables = 2.0 * 16.0 * ROUNDING_UNIT;
    if rungs.planned.plan.integration == Integrate::Segments {
        // A cell's part of an integral is rounded to one of 2³¹ parts of the whole.
        let depth = transmittances.iter().map(|left| -left.ln()).fold(0.0, f64::max);
        tables += depth * 4096.0 * 0.5_f64.powi(31);
    }
    check("stored f64", &rungs.march::<f64>(&rungs.stored::<f64>()), tables);
    // 18 more within a step (`reference::factors`).
    let rounded = ROUNDINGS_PER_STEP * steps * ROUNDING_UNIT + 18.0 * ROUNDING_UNIT + tables;
    check("stored f32", &rungs.march::<f32>(&rungs.stored::<f32>()).map(f64::from), rounded);
    with_renderer(|renderer| check("device", &rungs.gpu(renderer).map(f64::from), 2.0 * rounded));
}

/// Length of the rays in a [`ramp`].
const RAMP_LENGTH: f64 = 24.0;

const DAY: &str = "[lights.day]\nspectrum = \"D65\"\nkind = \"ambient\"\n";

#[test]
fn a_ramp_is_thinned_by_its_gradient_as_in_its_closed_form_on_every_rung() {
    // A gradient of 500 lies in the middle of 300 and 700: a factor of 0.5.
    let scattering = -(-0.2_f64).ln_1p();
    let left = (-0.5 * scattering * RAMP_LENGTH).exp();
    for gradients in [Gradients::Packed, Gradients::Central] {
        let mut rungs = ramp("", DAY, "").scene.clone();
        rungs.accuracy.gradients = gradients;
        check_ramp("grey", &Rungs::new(rungs, [8, 8]), &[1.0 - left], &[left]);
    }
    // An X-ray material adds σ·f per unit length and takes nothing.
    check_ramp("X-ray", &ramp("xray = true", DAY, ""), &[0.5 * scattering * RAMP_LENGTH], &[1.0]);

    let absorption = "absorption = { gaussian = [{ centre = 560, sigma = 50, height = 1.0 }], base = 0.05 }";
    let rungs = ramp(absorption, &["absorption = 0.3\n", DAY].concat(), "");
    let model = rungs.planned.model.as_ref().unwrap();
    let material = &rungs.scene.materials[0];
    let reflected = model.coefficients(material.reflectance.spectrum());
    let absorbed = model.absorption_coefficients(material.absorption.as_ref().unwrap().spectrum());
    let extinctions = absorbed.iter().map(|part| scattering + 0.3 * part);
    let left: Vec<f64> = extinctions.clone().map(|extinction| (-0.5 * extinction * RAMP_LENGTH).exp()).collect();
    let weights = extinctions.zip(&reflected).zip(&left);
    let weights: Vec<f64> =
        weights.map(|((extinction, part), left)| part * scattering / extinction * (1.0 - left)).collect();
    check_ramp("coloured", &rungs, &weights, &left);
}

#[test]
fn terms_with_factors_of_their_own_are_their_closed_form_on_every_rung() {
    // A quarter of one term by its own factor, a half of another one by that of all.
    let terms = "gradient = [[100, 0], [900, 0.5]]\n[[transfer.intervals]]\nmaterial = \"only\"\nrange = [-1e6, 1e6]\nopacity = 0.3\n";
    let depths = [0.2_f64, 0.3].map(|opacity| -(-opacity).ln_1p());
    let left = (-(0.25 * depths[0] + 0.5 * depths[1]) * RAMP_LENGTH).exp();
    for integration in ["samples", "segments"] {
        for gradients in [Gradients::Packed, Gradients::Central] {
            let mut scene = ramp("", &[terms, DAY].concat(), "").scene.clone();
            scene.accuracy.integration =
                if integration == "samples" { Integration::Samples } else { Integration::Segments };
            scene.accuracy.gradients = gradients;
            let rungs = Rungs::new(scene, [8, 8]);
            assert_eq!(rungs.planned.plan.groups.number, 2);
            check_ramp(integration, &rungs, &[1.0 - left], &[left]);
        }
    }
}

#[test]
fn one_sided_lighting_leaves_the_back_of_a_ramp_in_its_ambient_light() {
    // Values rise along x, so the normal is -x.
    let light = |name: &str, x: f64| {
        format!("[lights.{name}]\nspectrum = \"D65\"\nkind = \"directional\"\ndirection = [{x}, 0, -0.8]\n")
    };
    let lights = [light("back", 0.6), light("front", -0.6)].concat();
    let material = "ambient = 0.2\ndiffuse = 0.5\nspecular = 0.25\nexponent = 3";
    let weight = 1.0 - (0.5 * (-0.2_f64).ln_1p() * RAMP_LENGTH).exp();
    let left = 1.0 - weight;
    // The eye is at -z: the half-vector of (-0.6, 0, -0.8) and (0, 0, -1), and its part along -x.
    let shine = 0.25 * (0.6 / (0.36_f64 + 1.8 * 1.8).sqrt()).powi(3);
    let [dark, lit] = [0.2, 0.2 + 0.5 * 0.6];
    let two = [weight * lit, weight * shine, weight * lit, weight * shine];
    check_ramp("two-sided", &ramp(material, &lights, ""), &two, &[left]);
    let one = [weight * dark, 0.0, weight * lit, weight * shine];
    check_ramp("one-sided", &ramp(material, &lights, "lighting = \"one_sided\""), &one, &[left]);
}

#[test]
fn the_ladder_catches_a_hundredth_of_the_factor_by_the_gradient() {
    for name in scenes::all().keys().filter(|name| name.starts_with("thinned_")) {
        let rungs = Rungs::new(scenes::named(name), SIZE);
        let double = rungs.march::<f64>(&rungs.stored::<f64>());
        let places = places(&rungs);
        let bound = of_places(&rungs, &double, [places.error; 3], ROUNDINGS_PER_STEP + 18.0 / longest(&rungs));
        let share = |change: fn(&mut Vec<(f64, f64)>)| {
            let mut scene = rungs.scene.clone();
            change(&mut scene.transfer.gradient_opacity);
            let other = Rungs::new(scene, SIZE);
            accumulators(&other.march::<f32>(&other.stored::<f32>()), &double, &bound, &places.undecided).share
        };
        let [unthinned, moved] = [share(Vec::clear), share(|points| points[1].1 = 0.51)];
        assert!(unthinned > 100.0 && moved > 1.0, "{name}: without a factor {unthinned}, by a hundredth {moved}");
    }
}

#[test]
fn a_three_point_light_shades_a_ramp_by_its_three_directions() {
    let light = "[lights.studio]\nspectrum = \"D65\"\nkind = \"three_point\"\n";
    let material = "ambient = 0.2\ndiffuse = 0.5\nspecular = 0.25\nexponent = 3";
    let two_sided = ramp(material, light, "");
    let view = two_sided.scene.camera.view(&two_sided.scene.frame.geometry, 1.0).unwrap();
    // Parts towards the right, the top and the eye, and weights (docs/theory/first-look.md).
    let lights = [([-0.5, 0.6, 1.0], 0.9), ([0.8, 0.1, 0.5], 0.1), ([0.4, 0.8, -0.3], 0.15)];
    let shade = |part: &dyn Fn(f64) -> f64| {
        let [mut facing, mut shine] = [0.0; 2];
        for ([right, up, back], weight) in lights {
            let light = (right * view.right + up * view.up - back * view.forward).normalize();
            // Values rise along x, so the normal is -x.
            facing += weight * part(-light.x);
            let halfway = (light - view.forward).normalize();
            shine += weight * if part(-light.x) > 0.0 { part(-halfway.x).powi(3) } else { 0.0 };
        }
        [0.2 + 0.5 * facing, 0.25 * shine]
    };
    let weight = 1.0 - (0.5 * (-0.2_f64).ln_1p() * RAMP_LENGTH).exp();
    let expected = |shade: [f64; 2]| shade.map(|part| weight * part);
    check_ramp("three-point", &two_sided, &expected(shade(&f64::abs)), &[1.0 - weight]);
    let one_sided = ramp(material, light, "lighting = \"one_sided\"");
    let expected_one = expected(shade(&|part| part.max(0.0)));
    check_ramp("three-point, one-sided", &one_sided, &expected_one, &[1.0 - weight]);
    assert!(expected_one[0] < expected(shade(&f64::abs))[0], "some of the three lie behind");
}
