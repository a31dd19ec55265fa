//! Spectra in k numbers: coloured transmittance and colour models, on every rung.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::path::Path;

use glam::DVec3;
use relume::plan::{Accumulate, PlanError, Shares, Transmittance, plan};
use relume::progress::Quiet;
use relume::reference::{Real, relight};
use relume::scene::{AccumulateAs, Scene, SceneOptions, parse};
use relume::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::tables::Accumulation;

use support::rungs::{Rungs, with_renderer};
use support::scenes::GLASS;

fn scene(text: &str) -> Scene {
    parse("test", text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap()
}

/// A slab of one value, seen straight on by parallel rays, that scatters and absorbs.
fn slab(step: f64) -> Rungs {
    let text = format!(
        r#"
        version = 1
        shading = "none"
        background = 1
        [volume]
        phantom = "slab"
        dims = [3, 3, 65]
        [materials.glass]
        reflectance = "orange"
        absorption = {{ gaussian = [{{ centre = 560, sigma = 50, height = 1.0 }}], base = 0.05 }}
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "glass"
        range = [-1e9, 1e9]
        opacity = 0.02
        absorption = 0.04
        [lights.day]
        spectrum = "D65"
        kind = "ambient"
        [camera]
        projection = "orthographic"
        height = 1
        azimuth = 0
        elevation = 0
        [accuracy]
        step = {step}
        termination = 0
        k = 8
        "#
    );
    Rungs::new(scene(&text), [1, 1])
}

/// What a homogeneous slab of depth L leaves in each number: σ r (1 − e^(−τL))/τ, and e^(−τL).
fn closed_form(rungs: &Rungs, length: f64) -> (Vec<f64>, Vec<f64>) {
    let model = rungs.planned.model.as_ref().unwrap();
    let material = &rungs.scene.materials[0];
    let scattering = -(-0.02_f64).ln_1p();
    let reflected = model.coefficients(material.reflectance.spectrum());
    let absorbed = model.coefficients(material.absorption.as_ref().unwrap().spectrum());
    let of = |(reflected, absorbed): (&f64, &f64)| {
        let extinction = 0.04f64.mul_add(*absorbed, scattering);
        (scattering * reflected * -(-extinction * length).exp_m1() / extinction, (-extinction * length).exp())
    };
    reflected.iter().zip(&absorbed).map(of).unzip()
}

fn every_rung(rungs: &Rungs, mut check: impl FnMut(&str, Vec<f64>, Vec<f64>)) {
    fn wide<R: Real>(sums: &Accumulation<R>) -> (Vec<f64>, Vec<f64>) {
        let wide = |numbers: &[R]| numbers.iter().map(|number| number.to_f64()).collect();
        (wide(&sums.weights), wide(&sums.transmittance))
    }
    let exact = wide(&rungs.march::<f64>(&rungs.exact()));
    check("reference f64", exact.0, exact.1);
    let single = wide(&rungs.march::<f32>(&rungs.stored()));
    check("reference f32", single.0, single.1);
    with_renderer(|renderer| {
        let gpu = wide(&rungs.gpu(renderer));
        check("GPU", gpu.0, gpu.1);
    });
}

#[test]
fn a_coloured_slab_is_its_closed_form_at_every_step() {
    for step in [2.0, 1.0, 0.5, 0.25] {
        let rungs = slab(step);
        let (sums, passed) = closed_form(&rungs, 64.0);
        every_rung(&rungs, |rung, found, through| {
            let pairs = found.iter().zip(&sums).chain(through.iter().zip(&passed));
            for (found, expected) in pairs {
                let error = ((found - expected) / expected).abs();
                assert!(error <= 2e-5, "{rung}, step {step}: {found} for {expected}: {error:e}");
            }
            assert_eq!((found.len(), through.len()), (8, 8), "{rung}: k numbers of each");
        });
    }
}

#[test]
fn all_bands_are_the_closed_form_too() {
    let full = slab(0.5).full_spectrum();
    let (sums, passed) = closed_form(&full, 64.0);
    let marched = full.march::<f64>(&full.exact());
    let pairs = marched.weights.iter().zip(&sums).chain(marched.transmittance.iter().zip(&passed));
    for (found, expected) in pairs {
        assert!((found - expected).abs() <= 1e-12, "{found} for {expected}");
    }
}

#[test]
fn the_device_renders_coloured_glass_as_the_reference() {
    for change in ["k = 3", "k = 8", "tolerance = 0.5", "k = 6\nmodel = \"sharpened\"", "model = \"rgb\"\nk = 3"] {
        let rungs = Rungs::new(scene(&GLASS.replace("[accuracy]", &format!("[accuracy]\n{change}"))), [40, 40]);
        assert_eq!(rungs.planned.plan.transmittance, Transmittance::Coloured);
        let single = rungs.march::<f32>(&rungs.stored());
        let expected = relight(&single, &rungs.xyz_matrices());
        with_renderer(|renderer| {
            let gpu = rungs.gpu(renderer);
            let shown = relight(&gpu, &rungs.xyz_matrices());
            let largest = shown.iter().zip(&expected).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max);
            let mean = shown.iter().zip(&expected).map(|(a, b)| (*a - *b).abs().element_sum() / 3.0).sum::<f64>()
                / f64::from(40 * 40);
            // A filter's 8 bits of fraction move a place by half of 1/256 voxel: 2e-3 of the steepest ramp.
            assert!(largest <= 2e-3 && mean <= 1e-4, "{change}: largest {largest:e}, mean {mean:e}");
        });
    }
}

/// ΔE00 of every pixel that shows something.
fn differences(one: &[DVec3], other: &[DVec3]) -> Vec<f64> {
    let lab = |colour: &DVec3| lab_from_xyz(Xyz(colour.to_array()), d65_white());
    one.iter().zip(other).map(|(a, b)| ciede2000(lab(a), lab(b))).collect()
}

#[test]
fn an_automatic_k_keeps_its_tolerance_in_the_picture() {
    for tolerance in [2.0, 1.0, 0.5] {
        let text = GLASS.replace("[accuracy]", &format!("[accuracy]\ntolerance = {tolerance}"));
        let rungs = Rungs::new(scene(&text), [40, 40]);
        let model = rungs.planned.model.as_ref().unwrap();
        let planned: Vec<DVec3> = rungs.lit(&rungs.exact()).into_iter().map(|(colour, _)| colour).collect();
        let worst = differences(&planned, &rungs.truth()).into_iter().fold(0.0, f64::max);
        assert!(worst <= tolerance, "k = {} for {tolerance}: {worst}", model.dimension());
    }
}

#[test]
fn a_grey_scene_is_the_same_by_weights_and_by_k_numbers() {
    let grey = GLASS.lines().filter(|line| !line.starts_with("absorption")).collect::<Vec<_>>().join("\n");
    let by = |accumulate: AccumulateAs| {
        let mut scene = scene(&grey);
        scene.accuracy.accumulate = accumulate;
        // Materials and white: exact (COLOUR.md C7).
        scene.accuracy.dimension = Some(4);
        Rungs::new(scene, [40, 40])
    };
    let (weights, spectral) = (by(AccumulateAs::Weights), by(AccumulateAs::Spectral));
    assert_eq!(weights.planned.plan.accumulate, Accumulate::Weights { materials: 3 });
    let expected = Accumulate::Spectral { dimension: 4, shares: Shares::Own, exponents: 2 };
    assert_eq!(spectral.planned.plan.accumulate, expected);
    assert_eq!(spectral.planned.plan.transmittance, Transmittance::Grey);
    let lit = |rungs: &Rungs| rungs.lit(&rungs.exact()).into_iter().map(|(colour, _)| colour).collect::<Vec<_>>();
    let worst = differences(&lit(&weights), &lit(&spectral)).into_iter().fold(0.0, f64::max);
    assert!(worst <= 1e-3, "f64: ΔE00 {worst}");
    with_renderer(|renderer| {
        let shown = |rungs: &Rungs| relight(&rungs.gpu(renderer), &rungs.xyz_matrices());
        let worst = differences(&shown(&weights), &shown(&spectral)).into_iter().fold(0.0, f64::max);
        assert!(worst <= 0.01, "GPU: ΔE00 {worst}");
    });
}

#[test]
fn transmittance_is_grey_as_long_as_the_sum_of_all_absorption_is() {
    let of = |text: &str| plan(&scene(text), &Quiet).unwrap().plan.transmittance;
    assert_eq!(of(GLASS), Transmittance::Coloured);
    assert_eq!(of(&GLASS.replace("absorption = 0.15", "").replace("absorption = 0.2", "")), Transmittance::Grey);
    // What one takes of the red the other takes of the blue, wherever they are.
    let pair = "\nversion = 1\n[volume]\nphantom = \"gaussian\"\ndims = [8, 8, 8]\n\
        [materials.one]\nreflectance = 0.5\nabsorption = { points = [[380, 0.0], [780, 1.0]] }\n\
        [materials.two]\nreflectance = 0.5\nabsorption = { points = [[380, 1.0], [780, 0.0]] }\n\
        [[transfer.intervals]]\nmaterial = \"one\"\nrange = [0, 1]\nopacity = 0.1\nabsorption = 0.3\n\
        [[transfer.intervals]]\nmaterial = \"two\"\nrange = [0, 1]\nopacity = 0.1\nabsorption = 0.3\n\
        [lights.day]\nspectrum = \"D65\"\n";
    let pair = pair.replace("{ points = [[380, 0.0], [780, 1.0]] }", "{ 380 = 0.0, 780 = 1.0 }");
    let pair = pair.replace("{ points = [[380, 1.0], [780, 0.0]] }", "{ 380 = 1.0, 780 = 0.0 }");
    assert_eq!(of(&pair), Transmittance::Grey);
    assert_eq!(of(&pair.replacen("absorption = 0.3", "absorption = 0.2", 1)), Transmittance::Coloured);
}

#[test]
fn what_cannot_be_planned_is_refused_with_the_reason() {
    let mut weights = scene(GLASS);
    weights.accuracy.accumulate = AccumulateAs::Weights;
    let refused = plan(&weights, &Quiet).unwrap_err();
    assert!(matches!(&refused, PlanError::NotGrey { materials } if materials == "green, red"), "{refused}");
    let mut exact = scene(GLASS);
    exact.accuracy.tolerance = 1e-3;
    let refused = plan(&exact, &Quiet).unwrap_err();
    assert!(std::error::Error::source(&refused).unwrap().to_string().contains("no k up to 16"), "{refused:?}");
    let text = GLASS.replace("material = \"red\"", "material = \"shiny\"");
    let refused = parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap_err().to_string();
    assert!(refused.contains("the material shiny absorbs nothing"), "{refused}");
}
