//! Several rays of a pixel: their mean (docs/theory/march.md).

use crate::matrix::differences;
use crate::support;

use glam::DVec3;
use relume::scene::{Projection, Scene};
use relume::tables::{phase_of_ray, ray_phase};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE};

fn p95(actual: &[DVec3], expected: &[DVec3]) -> f64 {
    let all = differences(actual, expected);
    all[all.len() * 95 / 100]
}

fn of_rays(name: &str, rays: usize, size: [usize; 2]) -> Rungs {
    let mut scene = scenes::named(name);
    scene.accuracy.rays = rays;
    Rungs::new(scene, size)
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

/// The rays of a pixel lie between each other's samples: their mean has less of the error along a ray than that of rays on one lattice. Seen from
/// near, where the rays of a pixel meet almost the same values.
#[test]
fn rays_between_each_others_samples_have_less_than_half_of_the_error_along_a_ray() {
    for name in ["diffuse_three", "unshaded_three"] {
        let mut scene = scenes::named(name);
        scene.camera.projection = Projection::Orthographic { height: Some(4.0) };
        scene.accuracy.step_length *= 2.0;
        scene.accuracy.rays = 4;
        let colours = |scene: &Scene| {
            let rungs = Rungs::new(scene.clone(), SIZE);
            rungs.march::<f64>(&rungs.exact()).relight(&rungs.xyz_matrices())
        };
        let aligned = colours(&scene);
        scene.accuracy.jitter = true;
        let between = colours(&scene);
        scene.accuracy.step_length /= 32.0;
        let truth = colours(&scene);
        let brightest = truth.iter().map(|xyz| xyz.y).fold(0.0, f64::max);
        let shown = |all: &[DVec3]| all.iter().map(|&xyz| xyz / brightest).collect::<Vec<_>>();
        let [aligned, between] = [aligned, between].map(|found| p95(&shown(&found), &shown(&truth)));
        assert!(between <= 0.5 * aligned, "{name}: p95 {between} between, {aligned} on one lattice");
    }
}

/// All phases are about as frequent, and neighbours differ.
#[test]
fn phases_are_spread_evenly_over_a_step_and_over_neighbours() {
    let mut counts = [0_u32; 8];
    for place in 0..64 * 64 {
        let pixel = [place % 64, place / 64];
        let phase = ray_phase(pixel, 0);
        assert!((0.0..1.0).contains(&phase));
        counts[relume::number::whole(phase * 8.0)] += 1;
        let around =
            [[pixel[0] + 1, pixel[1]], [pixel[0], pixel[1] + 1]].map(|next| (ray_phase(next, 0) - phase).abs());
        assert!(around.iter().all(|apart| *apart > 0.1 && *apart < 0.9), "{pixel:?}: {around:?}");
    }
    assert!(counts.iter().all(|&found| found.abs_diff(512) < 40), "{counts:?}");
    let of_rays: Vec<u32> = (0..4).map(phase_of_ray).collect();
    assert_eq!(of_rays, [0, 1 << 31, 1 << 30, 3 << 30]);
}
