//! Interpolation between voxels: every method against its closed form, and on the device.

use crate::support;

use std::f64::consts::TAU;

use glam::DVec3;
use relume::reference::{Samples, Step};
use relume::scene::{Integration, Interpolation, Scene};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, float, of, sampled};
use support::tolerance::DEVICE_MEAN;

const ALL: [Interpolation; 4] =
    [Interpolation::Nearest, Interpolation::Linear, Interpolation::ExactLinear, Interpolation::Cubic];
const SIZE: [usize; 2] = [24, 20];

/// Data values per unit of opacity, and the rounding error of a value: half a 16-bit code.
const UNIT: f64 = 40000.0;
const ROUNDED: f64 = 0.5 / UNIT + 1e-9;

/// Scene whose opacity is half its value, with 12³ voxels of `value(voxel)` from 0 to 1.
fn waves(value: impl Fn(DVec3) -> f64) -> Scene {
    let text = r#"
        [materials.m]
        reflectance = 0.5
        [transfer]
        opacity_length = 1
        intervals = [{ material = "m", range = [40000, 50000], ramp = 40000, opacity = 0.5 }]
        [lights.l]
        spectrum = "D65"
        kind = "ambient"
        [accuracy]
        step = 1
    "#;
    of(text, sampled([12, 12, 12], |place| UNIT * value((place + 1.0) * 5.5)))
}

/// Interpolated value of `scene` at voxel coordinates.
fn value_at(scene: &Scene, interpolation: Interpolation, voxel: DVec3) -> f64 {
    let mut scene = scene.clone();
    scene.accuracy.interpolation = interpolation;
    let rungs = Rungs::new(scene, SIZE);
    let mut step = Step::default();
    rungs.exact().sample(((voxel + 0.5) / 12.0).to_array(), &mut step);
    2.0 * step.opacity[0]
}

/// A B-spline attenuates a wave of ω per voxel by (2 + cos ω)/3 along its axis, where linear interpolation reproduces
/// the
/// voxels (Unser 1999, equation 7).
#[test]
fn a_cubic_spline_weakens_waves_by_its_own_formula() {
    for waves_per_voxel in [1.0 / 12.0, 0.25] {
        let omega = TAU * waves_per_voxel;
        let scene = waves(|voxel| 0.25_f64.mul_add((omega * voxel.x).cos(), 0.5));
        for x in [4.0, 5.0, 6.0] {
            let voxel = DVec3::new(x, 5.0, 6.0);
            let wave = (omega * x).cos();
            let cubic = value_at(&scene, Interpolation::Cubic, voxel);
            let expected = 0.5 + 0.25 * wave * (2.0 + omega.cos()) / 3.0;
            assert!((cubic - expected).abs() <= ROUNDED, "at {x}: {cubic}, {expected}");
            for interpolation in [Interpolation::Linear, Interpolation::ExactLinear, Interpolation::Nearest] {
                let found = value_at(&scene, interpolation, voxel);
                assert!((found - 0.25f64.mul_add(wave, 0.5)).abs() <= ROUNDED, "{interpolation:?} at {x}: {found}");
            }
        }
    }
}

#[test]
fn what_is_linear_stays_so_between_voxels() {
    let ramp = |voxel: DVec3| 0.1 + (voxel.x + 2.0 * voxel.y + 3.0 * voxel.z) / 90.0;
    let scene = waves(ramp);
    for place in [DVec3::new(4.3, 5.7, 6.1), DVec3::new(5.0, 4.5, 6.999), DVec3::new(3.25, 6.0, 5.5)] {
        for interpolation in [Interpolation::Linear, Interpolation::ExactLinear, Interpolation::Cubic] {
            let found = value_at(&scene, interpolation, place);
            assert!((found - ramp(place)).abs() <= ROUNDED, "{interpolation:?} at {place}: {found}, {}", ramp(place));
        }
    }
}

#[test]
fn every_interpolation_is_the_same_on_the_device() {
    for name in ["diffuse_three", "unshaded_one", "labels", "coloured_three"] {
        let mut pictures = Vec::new();
        for interpolation in ALL {
            let mut scene = scenes::named(name);
            scene.accuracy.interpolation = interpolation;
            let rungs = Rungs::new(scene, SIZE);
            with_renderer(|renderer| {
                let expected = rungs.march::<f32>(&rungs.stored::<f32>()).relight(&rungs.xyz_matrices());
                let found = rungs.gpu(renderer).relight(&rungs.xyz_matrices());
                let apart: Vec<f64> = found.iter().zip(&expected).map(|(a, b)| (*a - *b).abs().max_element()).collect();
                let mean = apart.iter().sum::<f64>() / float(apart.len());
                let limit = match interpolation {
                    // At voxel borders, and with hardware filters of few bits, places round to either side.
                    Interpolation::Nearest | Interpolation::Linear => 1e-3,
                    Interpolation::ExactLinear | Interpolation::Cubic => DEVICE_MEAN,
                };
                assert!(mean <= limit, "{name}, {interpolation:?}: {mean}");
                assert!(expected.iter().any(|colour| colour.y > 0.02), "{name} shows something");
                pictures.push(found);
            });
        }
        if let [nearest, linear, exact, cubic] = &pictures[..] {
            let apart = |one: &[DVec3], two: &[DVec3]| {
                one.iter().zip(two).map(|(a, b)| (*a - *b).abs().max_element()).fold(0.0, f64::max)
            };
            assert!(apart(linear, exact) <= 0.02, "{name}: linear is linear");
            assert!(apart(cubic, linear) > 1e-4 && apart(nearest, linear) > 1e-4, "{name}: the others differ");
        }
    }
}

#[test]
fn empty_space_skipping_omits_nothing_of_any_interpolation() {
    let ways = ALL
        .map(|interpolation| (interpolation, Integration::Samples))
        .into_iter()
        .chain(ALL.into_iter().skip(1).map(|interpolation| (interpolation, Integration::Segments)));
    for (interpolation, integration) in ways {
        let march = |skipping: bool| {
            let mut scene = scenes::named("unshaded_three");
            scene.accuracy.integration = integration;
            scene.accuracy.interpolation = interpolation;
            scene.accuracy.skipping = skipping;
            let rungs = Rungs::new(scene, SIZE);
            let mut found = None;
            with_renderer(|renderer| found = Some(rungs.gpu(renderer)));
            found
        };
        assert_eq!(march(true), march(false), "{interpolation:?}, {integration:?}");
    }
}
