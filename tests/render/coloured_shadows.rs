//! Shadows through coloured absorption: closed forms at each wavelength, the device against the reference and 81 bands, and
//! the light grid.

use crate::matrix::bits;
use crate::shadows::{SINGLE, block, largest_difference, slabs, towards};
use crate::support;

use glam::DVec3;
use relume::plan::{plan, plan_full_spectrum};
use relume::progress::Quiet;
use relume::render::SceneRenderer;
use relume::scene::{Placement, Scene, Shading, ShadowMethod};
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

/// An occluder with two coloured absorbers.
fn stained_by_two() -> Scene {
    Scene { shading: Shading::None, ..scenes::named("stained_two") }
}

#[test]
fn the_grid_of_coloured_shadows_approaches_rays() {
    let scene = stained_by_two();
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
        let first = SceneRenderer::new(renderer, stained_by_two(), &Quiet).unwrap();
        let fills = |change: fn(&mut Scene)| {
            let mut scene = first.scene().clone();
            change(&mut scene);
            let before = renderer.light_fills();
            let planned = plan(&scene, &Quiet).unwrap();
            let film = first.with_scene(scene, planned, &Quiet).unwrap().march(SIZE, &Quiet).unwrap();
            (renderer.light_fills() - before, bits(&renderer.read(&film).unwrap()))
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
