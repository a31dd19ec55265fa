//! Storage of voxels and gradients: every format gives the correct picture and uses the stated memory.

use crate::support;

use std::sync::Arc;

use glam::DVec3;
use relume::scene::{Gradients, Interpolation, Scene, VolumeAs};
use relume::tables::VolumeFormat;
use relume::volume::{Volume, Voxels};
use support::rungs::{Rungs, with_renderer};
use support::scenes::{self, SIZE, float};
use support::tolerance::DEVICE_MEAN;

/// The scene `name` with changed accuracy.
fn changed(name: &str, change: impl Fn(&mut Scene)) -> Rungs {
    let mut scene = scenes::named(name);
    change(&mut scene);
    Rungs::new(scene, SIZE)
}

fn apart(one: &[DVec3], two: &[DVec3]) -> (f64, f64) {
    let apart: Vec<f64> = one.iter().zip(two).map(|(a, b)| (*a - *b).abs().max_element()).collect();
    (apart.iter().sum::<f64>() / float(apart.len()), apart.iter().copied().fold(0.0, f64::max))
}

#[test]
fn gradients_of_samples_around_are_those_of_the_device_and_of_the_reference() {
    for name in ["diffuse_three", "specular_three", "rotated", "coloured_one"] {
        for interpolation in [Interpolation::ExactLinear, Interpolation::Cubic] {
            let with = |gradients| {
                changed(name, |scene| {
                    scene.accuracy.gradients = gradients;
                    scene.accuracy.interpolation = interpolation;
                })
            };
            let (central, packed) = (with(Gradients::Central), with(Gradients::Packed));
            let formats = [central.storage.format, packed.storage.format];
            // The other volumes store values only; these are four times as large.
            assert_eq!(4 * formats[0].bytes(), formats[1].bytes(), "{name}: {formats:?}");
            let lit = |rungs: &Rungs| rungs.march::<f64>(&rungs.stored::<f64>()).relight(&rungs.xyz_matrices());
            let (mean, _) = apart(&lit(&central), &lit(&packed));
            // They differ by rounding to 16 bits, and at the faces of the volume.
            assert!(mean <= 2e-3, "{name}: {mean}");
            with_renderer(|renderer| {
                let found = central.gpu(renderer).relight(&central.xyz_matrices());
                let expected = central.march::<f32>(&central.stored::<f32>()).relight(&central.xyz_matrices());
                let (mean, _) = apart(&found, &expected);
                // Differences of neighbours cancel and lose their common digits.
                assert!(mean <= 100.0 * DEVICE_MEAN, "{name}, {interpolation:?}: {mean}");
            });
        }
    }
}

#[test]
fn volumes_in_32_bits_show_what_those_in_16_do() {
    for (name, formats) in [
        ("unshaded_one", [VolumeFormat::R16Unorm, VolumeFormat::R32Float]),
        ("diffuse_one", [VolumeFormat::Rgba16Snorm, VolumeFormat::Rgba32Float]),
    ] {
        let narrow = changed(name, |scene| scene.accuracy.volume = VolumeAs::Short);
        let wide = changed(name, |scene| scene.accuracy.volume = VolumeAs::Single);
        assert_eq!([narrow.storage.format, wide.storage.format], formats);
        let lit = |rungs: &Rungs| rungs.march::<f64>(&rungs.stored::<f64>()).relight(&rungs.xyz_matrices());
        let (mean, most) = apart(&lit(&narrow), &lit(&wide));
        assert!(mean <= 1e-3 && most <= 0.05, "{name}: {mean}, {most}");
        with_renderer(|renderer| {
            let found = wide.gpu(renderer).relight(&wide.xyz_matrices());
            let expected = wide.march::<f32>(&wide.stored::<f32>()).relight(&wide.xyz_matrices());
            let (mean, _) = apart(&found, &expected);
            assert!(mean <= 1e-4, "{name}: {mean}");
        });
    }
}

/// The nearest of 65536 codes over the range is off by at most half a code.
#[test]
fn fractions_in_16_bits_lose_half_a_code_at_most_and_say_so() {
    let mut scene = scenes::named("unshaded_one");
    let geometry = scene.volume.geometry;
    let voxels = geometry.dims.iter().product::<usize>();
    let values: Vec<f32> = (0..voxels).map(|i| f32::from(u16::try_from(i % 977).unwrap()) * 61.7).collect();
    let largest = 976.0 * 61.7;
    scene.volume = Arc::new(Volume::new("fractions", Voxels::F32(values.clone()), geometry).unwrap());
    let with = |volume: VolumeAs| {
        let mut scene = scene.clone();
        scene.accuracy.volume = volume;
        Rungs::new(scene, SIZE)
    };
    assert_eq!(with(VolumeAs::Auto).storage.format, VolumeFormat::R32Float);
    let short = with(VolumeAs::Short);
    let bound = 0.5 * largest / 65535.0;
    assert!((short.storage.loss - bound).abs() <= 1e-3 * bound, "{}", short.storage.loss);
    let [scale, offset] = short.storage.normalised_from_texel();
    for (texel, value) in short.volume.texels.iter().zip(&values) {
        let found = (f64::from(*texel) * scale + offset) * largest;
        assert!((found - f64::from(*value)).abs() <= 1.01 * bound, "{value}: {found}");
    }
}
