//! Interpolation between voxels: every method against its closed form, and on the device.

use crate::support;

use std::f64::consts::TAU;

use glam::DVec3;
use relume::reference::{Samples, Step};
use relume::scene::{Interpolation, Scene};
use support::rungs::Rungs;
use support::scenes::{of, sampled};

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
