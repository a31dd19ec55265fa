//! Storage of voxels and gradients: every format gives the correct picture and uses the stated memory.

use crate::support;

use std::sync::Arc;

use glam::DVec3;
use relume::plan::plan;
use relume::progress::Quiet;
use relume::scene::{Gradients, Interpolation, Scene, Shading, VolumeAs};
use relume::tables::{Storage, VolumeFormat};
use relume::volume::{Geometry, Volume, Voxels};
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

/// In 16 bits, a stored whole number has a whole number of codes, and so has a difference: of the number ahead less that behind,
/// or twice that to the nearest one at a face.
#[test]
fn texels_of_whole_numbers_are_whole_numbers_of_codes() {
    let mut scene = scenes::named("diffuse_one");
    scene.accuracy.gradients = Gradients::Packed;
    let dims: [usize; 3] = [9, 5, 4];
    // Scattered numbers from 0 to 180.
    let numbers: Vec<u8> = (0..180).map(|index| u8::try_from(index * 7919 % 181).unwrap()).collect();
    let wide: Vec<u16> = numbers.iter().map(|&number| 30_000 + 80 * u16::from(number)).collect();
    let signed: Vec<i16> = numbers.iter().map(|&number| 5 * i16::from(number) - 400).collect();
    for voxels in [Voxels::U8(numbers), Voxels::U16(wide), Voxels::I16(signed)] {
        let stored: Vec<f64> = (0..180).map(|index| voxels.value(index).unwrap()).collect();
        let (least, most) = match voxels {
            Voxels::U8(_) => (0.0, 255.0),
            _ => (stored.iter().copied().fold(f64::MAX, f64::min), stored.iter().copied().fold(f64::MIN, f64::max)),
        };
        let mut volume = Volume::new("whole", voxels, Geometry::unit("whole", dims).unwrap()).unwrap();
        for (slope, intercept) in [(1.0, 0.0), (-0.3, 1024.0), (1e-4, -1.0)] {
            (volume.slope, volume.intercept) = (slope, intercept);
            let lowest = if slope > 0.0 { least } else { most };
            let per_number = |codes: f64| (codes / (most - least)).floor() * slope.signum();
            let [of_value, of_value_alone, of_difference] = [65534.0, 65535.0, 32767.0 / 2.0].map(per_number);
            let at = |place: [usize; 3]| stored[place[0] + dims[0] * (place[1] + dims[1] * place[2])];
            let mut texels: [Vec<[f64; 4]>; 2] = [Vec::new(), Vec::new()];
            for (index, &number) in stored.iter().enumerate() {
                let place = [index % dims[0], index / dims[0] % dims[1], index / (dims[0] * dims[1])];
                let difference = |axis: usize| {
                    let (mut behind, mut ahead) = (place, place);
                    behind[axis] = place[axis].saturating_sub(1);
                    ahead[axis] = (place[axis] + 1).min(dims[axis] - 1);
                    let factor = if ahead[axis] - behind[axis] == 1 { 2.0 } else { 1.0 };
                    factor * of_difference * (at(ahead) - at(behind))
                };
                let [x, y, z] = [0, 1, 2].map(difference);
                texels[0].push([x, y, z, of_value.mul_add(number - lowest, -32767.0)]);
                texels[1].push([of_value_alone * (number - lowest), 0.0, 0.0, 0.0]);
            }
            for (shading, texels) in [Shading::Gradient, Shading::None].into_iter().zip(texels) {
                scene.shading = shading;
                let storage = Storage::new(&plan(&scene, &Quiet).unwrap().plan, &volume, &volume.statistics().unwrap());
                let bytes = storage.slab(&volume, 0..dims[2]);
                let found: Vec<[f64; 4]> = match storage.format {
                    VolumeFormat::Rgba16Snorm => {
                        let code = |bytes: &[u8]| f64::from(i16::from_ne_bytes(bytes.try_into().unwrap()));
                        bytes.chunks(8).map(|texel| [0, 2, 4, 6].map(|at| code(&texel[at..at + 2]))).collect()
                    }
                    VolumeFormat::R16Unorm => {
                        let code = |bytes: &[u8]| f64::from(u16::from_ne_bytes(bytes.try_into().unwrap()));
                        bytes.chunks(2).map(|texel| [code(texel), 0.0, 0.0, 0.0]).collect()
                    }
                    other => panic!("whole numbers have 16 bits, not {other:?}"),
                };
                assert_eq!(found, texels, "{:?} · {slope} + {intercept}", volume.voxels.voxel_type());
            }
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
    let geometry = scene.frame.geometry;
    let voxels = geometry.dims.iter().product::<usize>();
    let values: Vec<f32> = (0..voxels).map(|i| f32::from(u16::try_from(i % 977).unwrap()) * 61.7).collect();
    let largest = 976.0 * 61.7;
    scene.set_volume(Arc::new(Volume::new("fractions", Voxels::F32(values.clone()), geometry).unwrap()));
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
    for (texel, value) in short.volume.values.iter().zip(&values) {
        let found = (f64::from(*texel) * scale + offset) * largest;
        assert!((found - f64::from(*value)).abs() <= 1.01 * bound, "{value}: {found}");
    }
}
