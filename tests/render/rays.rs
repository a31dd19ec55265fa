//! Several rays of a pixel: their mean (docs/theory/march.md).

use crate::support;

use glam::DVec3;
use relume::film::Film;
use relume::render::{Dispatching, Renderer};
use relume::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use support::device::open;
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE};
use support::tolerance::WEIGHTS_DEVICE_P99;

/// Differences of the pixels' colours, sorted.
fn differences(actual: &[DVec3], expected: &[DVec3]) -> Vec<f64> {
    let lab = |xyz: &DVec3| lab_from_xyz(Xyz(xyz.to_array()), d65_white());
    let mut all: Vec<f64> = actual.iter().zip(expected).map(|(a, b)| ciede2000(lab(a), lab(b))).collect();
    all.sort_by(f64::total_cmp);
    all
}

fn p95(actual: &[DVec3], expected: &[DVec3]) -> f64 {
    let all = differences(actual, expected);
    all[all.len() * 95 / 100]
}

fn of_rays(name: &str, rays: usize, size: [usize; 2]) -> Rungs {
    let mut scene = scenes::named(name);
    scene.accuracy.rays = rays;
    Rungs::new(scene, size)
}

#[test]
fn the_device_has_the_mean_of_the_reference() {
    with_renderer(|renderer| {
        for (name, mut scene) in scenes::both_ways(&["diffuse_three", "background", "coloured_three", "inside"]) {
            scene.accuracy.rays = 5;
            let rungs = Rungs::new(scene, SIZE);
            let expected = rungs.march::<f64>(&rungs.stored::<f64>()).relight(&rungs.xyz_matrices());
            let device = rungs.gpu(renderer).relight(&rungs.xyz_matrices());
            let all = differences(&device, &expected);
            let p99 = all[all.len() * 99 / 100];
            assert!(p99 <= WEIGHTS_DEVICE_P99, "{name}: {p99}");
        }
    });
}

/// The truth of a pixel's area is a picture of eight times as many pixels across and down, averaged.
#[test]
fn more_rays_come_closer_to_the_mean_over_the_pixel() {
    const FINER: usize = 8;
    with_renderer(|renderer| {
        for name in ["diffuse_three", "orthographic", "coloured_background"] {
            let lit = |rungs: &Rungs| rungs.gpu(renderer).relight(&rungs.xyz_matrices());
            let fine_size = SIZE.map(|side| side * FINER);
            let fine = lit(&of_rays(name, 1, fine_size));
            let mean = |i: usize| {
                let [x, y] = [i % SIZE[0] * FINER, i / SIZE[0] * FINER];
                let parts = (0..FINER * FINER).map(|j| fine[x + j % FINER + fine_size[0] * (y + j / FINER)]);
                parts.sum::<DVec3>() / scenes::float(FINER * FINER)
            };
            let truth: Vec<DVec3> = (0..SIZE[0] * SIZE[1]).map(mean).collect();
            let errors = [1, 4, 16].map(|rays| p95(&lit(&of_rays(name, rays, SIZE)), &truth));
            assert!(errors[1] < errors[0] / 2.0 && errors[2] < errors[1] / 1.5, "{name}: {errors:?}");
        }
    });
}

#[test]
fn several_rays_are_the_same_to_the_byte_however_their_march_is_cut() {
    let bits = |film: &Film<f32>| -> Vec<u32> {
        film.accumulators.iter().chain(&film.transmittance).map(|number| number.to_bits()).collect()
    };
    let rungs = of_rays("specular_three", 4, SIZE);
    let Some(device) = open() else { return };
    let renderer = Renderer::new(device);
    let [whole, again] = [(), ()].map(|()| rungs.gpu_accumulators(&renderer));
    assert_eq!(whole.dispatches, 4, "small enough for one dispatch a ray");
    let whole = bits(&renderer.read(&whole).unwrap());
    assert!(bits(&renderer.read(&again).unwrap()) == whole, "from run to run");
    let cut = Dispatching { samples: Some(3000), slice: 31, ..Dispatching::default() };
    let renderer = renderer.with_dispatching(cut);
    let film = rungs.gpu_accumulators(&renderer);
    assert!(film.dispatches > 8 && bits(&renderer.read(&film).unwrap()) == whole, "{} dispatches", film.dispatches);
    let messages = renderer.device().validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}

/// The mean is stored in 16 bits, not the rays.
#[test]
fn a_mean_is_rounded_once_where_pixels_have_16_bits() {
    with_renderer(|renderer| {
        let mut rungs = of_rays("diffuse_three", 4, SIZE);
        let full = rungs.gpu(renderer);
        rungs.planned.plan.storage = relume::scene::StoreAs::Half;
        let stored = rungs.gpu(renderer);
        for (full, stored) in full.accumulators.iter().zip(&stored.accumulators) {
            let once = half::f16::from_f32(*full).to_f32();
            assert!((once - stored).abs() <= 0.0, "{full} is stored as {stored}");
        }
    });
}
