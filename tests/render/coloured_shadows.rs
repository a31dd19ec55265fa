//! Shadows through coloured absorption: closed forms at each wavelength, the device against the reference and 81 bands, and
//! the light grid.

use crate::shadows::{
    POINTS, SAME_GRID, SINGLE, beside_three_point, block, largest_difference, numbers, occluded, slabs, towards,
};
use crate::support;

use glam::DVec3;
use relume::model::{ModelKind, Order};
use relume::plan::{Integrate, Planned, Transmittance, plan, plan_full_spectrum};
use relume::progress::Quiet;
use relume::render::SceneRenderer;
use relume::scene::{Integration, Interpolation, Lighting, Placement, Scene, SceneLight, Shading, ShadowMethod};
use relume::spectrum::{Absorption, BANDS, Spectrum};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE};

/// Absorption with a peak at `centre` nm.
fn absorbing(centre: f64) -> Option<Absorption> {
    let band = &Spectrum::gaussian(centre, 40.0, 1.0).unwrap() + &Spectrum::constant(0.05);
    Some(Absorption::new(band).unwrap())
}

/// Accumulators of the only pixel of `scene` and of its only position, at all wavelengths.
fn bands(scene: Scene) -> Vec<f64> {
    let planned = plan_full_spectrum(&scene);
    let rungs = Rungs::planned(scene, planned, [1, 1]);
    rungs.march(&rungs.exact()).accumulators
}

/// The block of depth `scattering` that also absorbs.
fn stained(scattering: f64, light: &str, step: f64) -> (Scene, Vec<f64>) {
    let mut scene = block(DVec3::new(40.0, 40.0, 1.0), scattering, light, step, 1.0);
    scene.materials[0].absorption = absorbing(540.0);
    let height = 1.5;
    scene.transfer.terms[0].absorption = vec![(0.0, height), (255.0, height)];
    let shape = scene.materials[0].absorption.as_ref().unwrap().spectrum().samples().map(|part| part * height);
    (scene, shape.to_vec())
}

#[test]
fn a_stained_slab_scatters_once_as_its_closed_form_says_at_every_wavelength() {
    let scattering = 0.8;
    for light in [[0.0, 0.0, -1.0], [0.75_f64.sqrt(), 0.0, -0.5], [0.75_f64.sqrt(), 0.0, 0.5], [0.0, 0.0, 1.0]] {
        let (scene, absorbed) = stained(scattering, &towards(light), 1.0 / 200.0);
        let reflectance = scene.materials[0].reflectance.spectrum().clone();
        let found = bands(scene);
        assert_eq!(found.len(), BANDS);
        let cosine: f64 = light[2].abs();
        for band in 0..BANDS {
            let depth = scattering + absorbed[band];
            let form = if light[2] < 0.0 {
                cosine / (cosine + 1.0) * -(-depth * (1.0 + 1.0 / cosine)).exp_m1()
            } else if cosine < 1.0 {
                cosine / (cosine - 1.0) * ((-depth / cosine).exp() - (-depth).exp())
            } else {
                depth * (-depth).exp()
            };
            let expected = reflectance.samples()[band] * scattering / depth * form;
            assert!(
                (found[band] - expected).abs() <= SINGLE,
                "{light:?}, band {band}: {}, not {expected}",
                found[band]
            );
        }
    }
    // The grey slab is another one.
    let (_, light, grey) = slabs().next().unwrap();
    let (scene, _) = stained(0.5, &towards(light), 1.0 / 200.0);
    let reflectance = scene.materials[0].reflectance.spectrum().clone();
    let found = bands(scene);
    assert!((found[32] / reflectance.samples()[32] - grey).abs() > 0.1, "absorption leaves less light");
}

#[test]
fn a_headlight_in_a_stained_slab_is_exact_at_every_step() {
    for step in [1.0, 0.25] {
        let (scene, absorbed) = stained(0.8, "", step);
        let reflectance = scene.materials[0].reflectance.spectrum().clone();
        for (band, found) in bands(scene).into_iter().enumerate() {
            let depth = 0.8 + absorbed[band];
            let expected = reflectance.samples()[band] * 0.8 / depth * -(-2.0 * depth).exp_m1() / 2.0;
            assert!((found - expected).abs() <= 2e-5, "step {step}, band {band}: {found}, not {expected}");
        }
    }
}

/// `scene` with a stained material, or two.
fn glass(mut scene: Scene, absorbers: usize) -> Scene {
    for (index, centre) in [470.0, 620.0].into_iter().enumerate().take(absorbers) {
        scene.materials[index].absorption = absorbing(centre);
        let mut term = scene.transfer.terms[0].clone();
        term.material.0 = vec![(0.0, index)];
        term.opacity = vec![(2000.0, 0.0)];
        term.absorption = vec![(3000.0, 0.0), (30000.0, 0.15)];
        scene.transfer.terms.push(term);
    }
    scene
}

/// A named scene whose lights, but the ambient one, cast shadows.
fn shadowed(name: &str) -> Scene {
    let mut scene = scenes::named(name);
    for light in &mut scene.lights {
        light.shadows = light.placement != Placement::Ambient;
    }
    scene
}

/// Scenes of every kind of light, shading and medium that coloured shadows meet.
fn of_every_kind() -> Vec<(&'static str, Scene)> {
    let changed = |scene: Scene, change: fn(&mut Scene)| {
        let mut scene = scene;
        change(&mut scene);
        scene
    };
    let mut every = glass(beside_three_point("gradient", 1), 1);
    let more = [("head", Placement::Headlight, true), ("point", Placement::Point(POINTS[0]), true)];
    let open = [("sky", Placement::Ambient, false), ("lamp", Placement::Point(POINTS[1]), false)];
    for (name, placement, shadows) in more.into_iter().chain(open) {
        let light = every.lights[0].clone();
        every.lights.push(SceneLight { name: name.to_owned(), placement, shadows, ..light });
    }
    let mut unshaded = every.clone();
    unshaded.shading = Shading::None;
    let phases = changed(unshaded.clone(), |scene| {
        (scene.materials[0].phase, scene.materials[1].phase) = (0.5, -0.2);
    });
    vec![
        ("one absorber", glass(occluded("none"), 1)),
        ("two absorbers by gradients", glass(occluded("gradient"), 2)),
        (
            "highlights of a three-point light",
            changed(glass(beside_three_point("gradient", 1), 1), |scene| {
                scene.lighting = Lighting::OneSided;
                scene.materials[0].specular = 0.4;
            }),
        ),
        ("every light", every),
        ("every light, unshaded", unshaded),
        ("phase functions", phases),
        ("highlights and own shares", shadowed("coloured_three")),
        ("labels", shadowed("coloured_labels")),
        ("X-ray", shadowed("coloured_xray")),
        ("background", shadowed("coloured_background")),
        ("one of two", changed(glass(occluded("gradient"), 1), |scene| scene.lights[0].shadows = false)),
        (
            "exact filter",
            changed(glass(occluded("none"), 2), |scene| {
                scene.accuracy.interpolation = Interpolation::ExactLinear;
            }),
        ),
        (
            "one-sided",
            changed(glass(occluded("gradient"), 1), |scene| {
                scene.lighting = Lighting::OneSided;
                scene.materials[0].specular = 0.4;
            }),
        ),
        (
            "gradient opacity",
            changed(glass(occluded("gradient"), 1), |scene| {
                scene.transfer.gradient_opacity = vec![(0.0, 0.2), (5000.0, 1.0)];
            }),
        ),
        (
            "cropped",
            changed(glass(occluded("none"), 1), |scene| {
                scene.crop = Some([DVec3::new(2.0, 3.5, 0.0), DVec3::new(20.0, 24.0, 35.2)]);
            }),
        ),
        (
            "segments",
            changed(glass(occluded("gradient"), 1), |scene| {
                scene.accuracy.integration = Integration::Segments;
            }),
        ),
        (
            "semigroup",
            changed(glass(occluded("none"), 1), |scene| {
                scene.accuracy.model = ModelKind::Sharpened(Order::Semigroup);
                scene.accuracy.dimension = Some(6);
            }),
        ),
        (
            "bands",
            changed(glass(occluded("none"), 1), |scene| {
                (scene.accuracy.model, scene.accuracy.dimension) = (ModelKind::Bands, Some(8));
            }),
        ),
    ]
}

#[test]
fn coloured_shadows_on_the_device_equal_the_reference_and_81_bands_within_the_tolerance() {
    with_renderer(|renderer| {
        for (name, scene) in of_every_kind() {
            let tolerance = scene.accuracy.tolerance;
            let rungs = Rungs::new(scene, SIZE);
            let plan = &rungs.planned.plan;
            assert!(
                plan.light.absorbers > 0 && plan.transmittance == Transmittance::Coloured,
                "{name} has coloured shadows"
            );
            let matrices = rungs.xyz_matrices();
            let expected = rungs.march::<f64>(&rungs.stored()).relight(&matrices);
            assert!(expected.iter().any(|xyz| xyz.y > 0.05), "{name} is dark");
            let error = largest_difference(&rungs.gpu(renderer).relight(&matrices), &expected);
            assert!(error <= SAME_GRID, "{name}: ΔE00 {error}");
            let single = rungs.march::<f32>(&rungs.stored()).relight(&matrices);
            let error = largest_difference(&single, &expected);
            assert!(error <= SAME_GRID, "{name} in f32: ΔE00 {error}");
            // 81 bands divide segments otherwise; a stated dimension has no tolerance.
            if plan.integration == Integrate::Samples && rungs.scene.accuracy.dimension.is_none() {
                let error = largest_difference(&expected, &rungs.stored_truth());
                assert!(error <= tolerance, "{name} against 81 bands: ΔE00 {error}");
            }
        }
    });
}

#[test]
fn the_grid_of_coloured_shadows_approaches_rays() {
    let scene = glass(occluded("none"), 2);
    let lit = |method: ShadowMethod, spacing: f64| {
        let mut scene = scene.clone();
        (scene.shadows.method, scene.shadows.spacing) = (method, spacing);
        let rungs = Rungs::new(scene, SIZE);
        rungs.march(&rungs.exact()).relight(&rungs.xyz_matrices())
    };
    let rays = lit(ShadowMethod::Rays, 2.0);
    let [coarse, fine] = [2.0, 0.5].map(|spacing| largest_difference(&lit(ShadowMethod::Grid, spacing), &rays));
    assert!(fine <= 0.5 * coarse && fine <= 3.0, "{coarse} at 2 voxels, {fine} at half a voxel");
}

#[test]
fn another_absorption_spectrum_fills_no_light_grid() {
    with_renderer(|renderer| {
        let first = SceneRenderer::new(renderer, glass(occluded("none"), 2), &Quiet).unwrap();
        let fills = |change: fn(&mut Scene)| {
            let mut scene = first.scene().clone();
            change(&mut scene);
            let before = renderer.light_fills();
            let planned = plan(&scene, &Quiet).unwrap();
            let film = first.with_scene(scene, planned, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
            (renderer.light_fills() - before, numbers(&renderer.read(&film).unwrap()))
        };
        let (count, film) = fills(|_| {});
        assert_eq!(count, 6, "two lights, each through two absorbers and all else");
        let (count, other) = fills(|scene| scene.materials[0].absorption = absorbing(600.0));
        assert_eq!(count, 0, "another absorption spectrum");
        assert!(other != film, "it changes the picture");
        assert_eq!(fills(|scene| scene.lights[1].placement = Placement::Directional(DVec3::X)).0, 3, "one light moves");
        let (count, back) = fills(|_| {});
        assert_eq!(count, 3, "it moves back");
        assert!(back == film, "the same grid again");
        assert_eq!(fills(|scene| scene.transfer.terms[1].absorption[1].1 = 0.3).0, 6, "another absorption");
    });
}

#[test]
fn films_with_coloured_shadows_relight_as_they_render() {
    with_renderer(|renderer| {
        let scene = glass(occluded("gradient"), 2);
        let planned: Planned = plan(&scene, &Quiet).unwrap();
        let marched = |scene: Scene| numbers(&Rungs::planned(scene, planned.clone(), SIZE).gpu(renderer));
        let film = marched(scene.clone());
        let mut other = scene;
        for light in &mut other.lights {
            light.spectrum = relume::spectrum::standard::light("FL11").unwrap();
            light.intensity *= 3.0;
        }
        assert!(marched(other) == film);
    });
}
