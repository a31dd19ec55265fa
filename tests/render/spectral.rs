//! Films of k coefficients: coloured transmittance and colour models, on every rung.

use crate::matrix::differences;
use crate::support;

use glam::DVec3;
use relume::document::{SceneOptions, parse};
use relume::film::Film;
use relume::number::Real;
use relume::plan::{Accumulate, PlanError, Planned, Shares, Transmittance, plan};
use relume::progress::Quiet;
use relume::scene::{AccumulateAs, SceneLight};
use relume::spectrum::colour::xyz_of;
use relume::spectrum::{Spectrum, standard};
use relume::volume::{Geometry, Volume, Voxels};

use support::rungs::{Rungs, in_xyz, with_renderer};
use support::scenes::{self, GLASS, glass_straight_on, parsed};
use support::tolerance::{RELIT_ABSOLUTE, RELIT_RELATIVE};

fn slab(step: f64) -> Rungs {
    Rungs::new(glass_straight_on("1", &format!("step = {step}\nk = 8")), [1, 1])
}

/// Closed form of a homogeneous slab of depth L per coefficient: σ r (1 − e^(−τL))/τ, and e^(−τL).
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
    fn wide<R: Real>(sums: &Film<R>) -> (Vec<f64>, Vec<f64>) {
        let wide = |numbers: &[R]| numbers.iter().map(|number| number.to_f64()).collect();
        (wide(&sums.accumulators), wide(&sums.transmittance))
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

/// docs/theory/acceptance.md C13, which implies that halving the step changes the slab no more than this.
#[test]
fn a_coloured_slab_is_its_closed_form_at_every_step() {
    for step in [2.0, 1.0, 0.5, 0.25] {
        let rungs = slab(step);
        let (sums, transmitted) = closed_form(&rungs, 64.0);
        every_rung(&rungs, |rung, found, through| {
            let pairs = found.iter().zip(&sums).chain(through.iter().zip(&transmitted));
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
    let (sums, transmitted) = closed_form(&full, 64.0);
    let marched = full.march::<f64>(&full.exact());
    let pairs = marched.accumulators.iter().zip(&sums).chain(marched.transmittance.iter().zip(&transmitted));
    for (found, expected) in pairs {
        assert!((found - expected).abs() <= 1e-12, "{found} for {expected}");
    }
}

/// Layers of three media and of empty space, one value per slice, seen along the normal.
fn layers(values: &[u16]) -> Rungs {
    let text = r#"
        shading = "none"
        background = "yellow green"
        [materials.a]
        reflectance = "orange"
        absorption = { gaussian = [{ centre = 470, sigma = 30, height = 1.0 }] }
        [materials.b]
        reflectance = "cyan"
        absorption = { gaussian = [{ centre = 600, sigma = 50, height = 1.0 }], base = 0.2 }
        [materials.c]
        reflectance = "purple"
        [transfer]
        opacity_length = 1
        intervals = [
            { material = "a", range = [80, 120], opacity = 0.05, absorption = 0.6 },
            { material = "b", range = [180, 220], opacity = 0.3, absorption = 0.2 },
            { material = "c", range = [280, 320], opacity = 0.01 },
        ]
        [lights.tube]
        spectrum = "FL11"
        [camera]
        projection = "orthographic"
        height = 0.5
        azimuth = 0
        elevation = 0
        [accuracy]
        interpolation = "nearest"
        step = 0.5
        termination = 0
    "#;
    let dims = [1, 1, values.len()];
    let volume = Volume::new("layers", Voxels::U16(values.to_vec()), Geometry::unit("layers", dims).unwrap());
    Rungs::new(scenes::of(text, volume.unwrap()), [1, 1])
}

/// docs/theory/acceptance.md C3, against values computed without this crate.
#[test]
fn layers_are_the_chain_that_is_computed_without_this_crate() {
    let values: Vec<u16> = (0..40).map(|i: u16| [100, 300, 200, 0, 100, 100, 300][usize::from(i * i % 7)]).collect();
    let rungs = layers(&values);
    let spectrum = |material: usize| *rungs.scene.materials[material].reflectance.spectrum().samples();
    let shape =
        |material: usize| rungs.scene.materials[material].absorption.as_ref().map(|it| *it.spectrum().samples());
    let media =
        [(0.05_f64, 0.6, spectrum(0), shape(0)), (0.3, 0.2, spectrum(1), shape(1)), (0.01, 0.0, spectrum(2), None)];
    let behind = rungs.scene.background.as_ref().unwrap().spectrum().samples();
    let light = rungs.mix.0[0].spectrum.spectrum();
    // Samples at ¼, ¾, 1¼ …: the first and last slice once, those in between twice.
    let samples: Vec<u16> = values.windows(2).flat_map(|pair| [pair[0], pair[1]]).collect();
    let reflected = |band: usize| {
        let (mut sum, mut transmitted) = (0.0, 1.0);
        for &value in &samples {
            let Some((opacity, peak, reflectance, shape)) = media.get(usize::from(value / 100).wrapping_sub(1)) else {
                continue;
            };
            let scattering = -(1.0 - opacity).ln();
            let extinction = scattering + shape.map_or(0.0, |shape| peak * shape[band]);
            let through = (-0.5 * extinction).exp();
            sum += transmitted * scattering * reflectance[band] * (1.0 - through) / extinction;
            transmitted *= through;
        }
        light.samples()[band] * (sum + transmitted * behind[band])
    };
    let expected = DVec3::from(xyz_of(&Spectrum::from_samples(std::array::from_fn(reflected))).0);
    let found = rungs.truth()[0];
    assert!((found - expected).abs().max_element() <= 1e-9, "f64: {found} for {expected}");
    let full = rungs.full_spectrum();
    let single = full.march::<f32>(&full.stored()).relight(&full.xyz_matrices())[0];
    let error = ((single - expected) / expected).abs().max_element();
    assert!(error <= 2e-6, "f32: {single} for {expected}");
}

/// docs/theory/acceptance.md C11.
#[test]
fn stored_numbers_relight_to_a_fresh_render_with_their_model() {
    let text = GLASS.replace("[accuracy]", "[accuracy]\nk = 8");
    let rungs = Rungs::new(parsed(&text), [40, 40]);
    let model = rungs.planned.model.clone().unwrap();
    let light = standard::light("LED-RGB1").unwrap();
    let mut mix = rungs.mix.clone();
    mix.0.truncate(1);
    (mix.0[0].spectrum, mix.0[0].weight) = (light.clone(), 1.0);
    let mut changed = rungs.scene.clone();
    let placement = rungs.planned.positions[mix.0[0].position].placement;
    changed.lights =
        vec![SceneLight { name: "new".into(), spectrum: light.clone(), intensity: 1.0, placement, shadows: false }];
    let replanned = Rungs::new(changed.clone(), [40, 40]);
    let same = Planned { model: Some(model.clone()), ..replanned.planned.clone() };
    let fresh = Rungs::planned(changed, same, [40, 40]);
    let reported = model.matrix(&light).error.max + replanned.planned.model.as_ref().unwrap().worst().max;
    with_renderer(|renderer| {
        let stored = rungs.gpu(renderer);
        let relit: Vec<DVec3> = stored.relight(&in_xyz(&rungs.matrices_under(&mix)));
        let render = |rungs: &Rungs| rungs.gpu(renderer).relight(&rungs.xyz_matrices());
        for (relit, fresh) in relit.iter().zip(render(&fresh)) {
            let limit = RELIT_RELATIVE * fresh.abs().max_element() + RELIT_ABSOLUTE;
            assert!((*relit - fresh).abs().max_element() <= limit, "{relit} for {fresh}");
        }
        let worst = differences(&relit, &render(&replanned)).into_iter().fold(0.0, f64::max);
        assert!(worst <= reported, "ΔE00 {worst} from another model, {reported} reported");
    });
}

#[test]
fn an_automatic_k_keeps_its_tolerance_in_the_picture() {
    for tolerance in [2.0, 1.0, 0.5] {
        let text = GLASS.replace("[accuracy]", &format!("[accuracy]\ntolerance = {tolerance}"));
        let rungs = Rungs::new(parsed(&text), [40, 40]);
        let model = rungs.planned.model.as_ref().unwrap();
        let planned: Vec<DVec3> = rungs.lit(&rungs.exact()).into_iter().map(|(colour, _)| colour).collect();
        let worst = differences(&planned, &rungs.truth()).into_iter().fold(0.0, f64::max);
        assert!(worst <= tolerance, "k = {} for {tolerance}: {worst}", model.dimension());
    }
}

/// Four dyes at the same values, each with a depth of at most 5: 20 in all.
#[test]
fn an_automatic_k_keeps_its_tolerance_where_dyes_overlap() {
    let mut text = "version = 1\nshading = \"none\"\nbackground = 1\n\
        [volume]\nphantom = \"gaussian\"\ndims = [1, 257, 1]\nspacing = [181.02, 1, 181.02]\n\
        [lights.day]\nspectrum = \"D65\"\n\
        [camera]\nprojection = \"orthographic\"\nheight = 128\n\
        position = [-257.4, 64, -166.9]\ntarget = [-45.25, 64, 45.25]\n\
        [accuracy]\nstep = 0.5\n[transfer]\nopacity_length = 256\n"
        .to_owned();
    let dyes = [("a", 440, 15), ("b", 500, 12), ("c", 560, 12), ("d", 600, 12)];
    for (name, _, _) in dyes {
        text.push_str(&format!(
            "[[transfer.intervals]]\nmaterial = \"{name}\"\nrange = [0.05, 0.98]\nopacity = 0\nabsorption = 5\n"
        ));
    }
    for (name, centre, sigma) in dyes {
        text.push_str(&format!(
            "[materials.{name}]\nreflectance = 0\nabsorption = {{ gaussian = [{{ centre = {centre}, sigma = {sigma}, \
             height = 1.0 }}], base = 0.01 }}\n"
        ));
    }
    let rungs = Rungs::new(parsed(&text), [32, 32]);
    let planned: Vec<DVec3> = rungs.lit(&rungs.exact()).into_iter().map(|(colour, _)| colour).collect();
    let worst = differences(&planned, &rungs.truth()).into_iter().fold(0.0, f64::max);
    assert!(worst <= 1.0, "k = {}: {worst}", rungs.planned.plan.components());
}

/// docs/theory/acceptance.md C7.
#[test]
fn a_grey_scene_is_the_same_by_weights_and_by_k_numbers() {
    let grey = GLASS.lines().filter(|line| !line.starts_with("absorption")).collect::<Vec<_>>().join("\n");
    let by = |accumulate: AccumulateAs| {
        let mut scene = parsed(&grey);
        scene.accuracy.accumulate = accumulate;
        // Materials and white: exact (docs/theory/acceptance.md C7).
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
        let shown = |rungs: &Rungs| rungs.gpu(renderer).relight(&rungs.xyz_matrices());
        let worst = differences(&shown(&weights), &shown(&spectral)).into_iter().fold(0.0, f64::max);
        assert!(worst <= 0.01, "GPU: ΔE00 {worst}");
    });
}

#[test]
fn transmittance_is_grey_as_long_as_the_sum_of_all_absorption_is() {
    let of = |text: &str| plan(&parsed(text), &Quiet).unwrap().plan.transmittance;
    assert_eq!(of(GLASS), Transmittance::Coloured);
    assert_eq!(of(&GLASS.replace("absorption = 0.15", "").replace("absorption = 0.2", "")), Transmittance::Grey);
    // Complementary dyes, equally strong at every value: the sum of their absorption is grey.
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
    let mut weights = parsed(GLASS);
    weights.accuracy.accumulate = AccumulateAs::Weights;
    let refused = plan(&weights, &Quiet).unwrap_err();
    assert!(matches!(&refused, PlanError::NotGrey { materials } if materials == "green, red"), "{refused}");
    let mut exact = parsed(GLASS);
    exact.accuracy.tolerance = 1e-3;
    let refused = plan(&exact, &Quiet).unwrap_err();
    assert!(std::error::Error::source(&refused).unwrap().to_string().contains("any k up to 16"), "{refused:?}");
    let text = GLASS.replace("material = \"red\"", "material = \"shiny\"");
    let refused =
        parse("test", &text, std::path::Path::new(""), &SceneOptions::default(), &Quiet).unwrap_err().to_string();
    assert!(refused.contains("material shiny has no absorption spectrum"), "{refused}");
}

#[test]
fn a_plan_is_told_in_words_of_light_and_pixels() {
    let told = |text: &str| {
        let scene = parsed(text);
        plan(&scene, &Quiet).unwrap().explain(&scene).join("\n")
    };
    let coloured = told(&GLASS.replace("[accuracy]", "[accuracy]\nk = 8"));
    for part in ["stained glass", "in green, red.", "at 8 wavelengths (", "key", "fill", "24 in all", "ΔE00"] {
        assert!(coloured.contains(part), "{part:?} is not in\n{coloured}");
    }
    for jargon in ["accumulator", "march", "node", "lane", "component", "dimension"] {
        assert!(!coloured.contains(jargon), "{jargon:?} is in\n{coloured}");
    }
    let sharpened = told(&GLASS.replace("[accuracy]", "[accuracy]\nk = 8\nmodel = \"sharpened-semigroup\""));
    assert!(sharpened.contains("would amplify light; they are held at 0"), "{sharpened}");
}
