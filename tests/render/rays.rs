//! Several rays of a pixel: their mean (docs/theory/march.md).

use crate::matrix::differences;
use crate::support;

use glam::DVec3;
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
