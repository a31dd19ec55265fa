//! Devices, buffers, images and dispatches on any Vulkan device, with the validation layer.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stderr, reason = "a test that ran on nothing says so")]
#![expect(clippy::print_stdout, reason = "a child process answers its parent")]

mod support;

use std::{env, fs, path::Path, process::Command, sync::Arc, thread, time::Duration};

use ash::vk;
use relume::{
    document::{SceneOptions, parse},
    progress::Quiet,
    render::{Renderer, SceneRenderer},
    shader::{Constants, compile},
    vulkan::{
        Buffer, ComputePipeline, Device, DeviceChoice, DeviceKind, Filter, Format, HostUse, Image3d, LentDevice,
        Recorder, Resource, ResourceSet, Sampler, StorageImage, Validation, VulkanError, devices,
    },
};
use support::device::{open, with_device};

fn pipeline(device: &Device, source: &str) -> ComputePipeline {
    let spirv = compile(&[("test.wgsl", source)], &Constants::new()).unwrap_or_else(|error| panic!("{error}"));
    ComputePipeline::new(device, "test", &spirv).unwrap()
}

fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn read_f32(buffer: &Buffer) -> Vec<f32> {
    let mut bytes = vec![0; usize::try_from(buffer.bytes()).unwrap()];
    buffer.read(0, &mut bytes).unwrap();
    bytes.chunks_exact(4).map(|word| f32::from_le_bytes(word.try_into().unwrap())).collect()
}

fn host_storage(device: &Device, name: &str, values: &[f32]) -> Buffer {
    let buffer = Buffer::host(device, name, values.len() as u64 * 4, HostUse::Storage).unwrap();
    buffer.write(0, &bytes_of(values)).unwrap();
    buffer
}

/// All layers of `image`, one after the other.
fn read_image(device: &Device, image: &StorageImage) -> Vec<f32> {
    let bytes = image.layer_bytes() * u64::from(image.layers());
    let buffer = Buffer::host(device, "read back", bytes, HostUse::ReadBack).unwrap();
    let copy = |recorder: &mut Recorder| {
        recorder.compute_to_transfer();
        recorder.transfer_to_transfer();
        for layer in 0..image.layers() {
            recorder.read_back(image, layer, &buffer, u64::from(layer) * image.layer_bytes())?;
        }
        recorder.transfer_to_host();
        Ok(())
    };
    device.run("read back", copy).unwrap();
    read_f32(&buffer)
}

#[test]
fn devices_are_listed_with_what_they_are() {
    if open().is_none() {
        return;
    }
    let found = devices().unwrap();
    for (place, info) in found.iter().enumerate() {
        assert_eq!(info.index, place);
        assert!(!info.name.is_empty() && !info.driver.is_empty(), "{info:?}");
    }
    assert!(found.iter().any(|info| info.missing.is_empty()), "{found:?}");
}

#[test]
fn auto_prefers_the_best_kind() {
    with_device(|device| {
        let usable = devices().unwrap().into_iter().filter(|info| info.missing.is_empty());
        assert_eq!(Some(device.info().kind), usable.map(|info| info.kind).min());
    });
    let order = [DeviceKind::Discrete, DeviceKind::Integrated, DeviceKind::Virtual, DeviceKind::Software];
    assert!(order.is_sorted());
}

#[test]
fn a_device_is_chosen_by_index_or_by_part_of_its_name() {
    with_device(|device| {
        let name = device.info().name.to_uppercase();
        let by_name = Device::open(&DeviceChoice::Name(name), Validation::Off).unwrap();
        let by_index = Device::open(&DeviceChoice::Index(device.info().index), Validation::Off).unwrap();
        assert_eq!(by_name.info().name, device.info().name);
        assert_eq!(by_index.info().index, device.info().index);
    });
}

#[test]
fn choices_are_read_from_text() {
    assert_eq!("auto".parse(), Ok(DeviceChoice::Auto));
    assert_eq!("1".parse(), Ok(DeviceChoice::Index(1)));
    assert_eq!("GeForce".parse(), Ok(DeviceChoice::Name("GeForce".to_owned())));
}

#[test]
fn a_device_that_is_not_there_is_answered_with_those_that_are() {
    let Some(device) = open() else { return };
    for choice in [DeviceChoice::Name("no such device".to_owned()), DeviceChoice::Index(1000)] {
        let error = Device::open(&choice, Validation::Off).unwrap_err();
        assert!(matches!(error, VulkanError::NoMatch { .. }), "{error:?}");
        assert!(error.to_string().contains(&device.info().name), "{error}");
    }
}

/// Not a test: opens a device in the environment set by the tests below, and prints the result.
#[test]
#[ignore = "run by the tests of broken environments"]
fn child_opens_a_device() {
    match Device::open(&DeviceChoice::Auto, Validation::On) {
        Ok(device) => println!("opened {}", device.info().name),
        Err(error) => println!("{error:?}\n{error}"),
    }
}

/// Output of [`child_opens_a_device`] with the variable `name` set to `value`.
fn child_with(name: &str, value: &Path) -> String {
    let output = Command::new(env::current_exe().unwrap())
        .args(["--exact", "child_opens_a_device", "--ignored", "--nocapture"])
        .env(name, value)
        .output()
        .unwrap();
    assert!(output.status.success(), "{output:?}");
    String::from_utf8_lossy(&output.stdout).into_owned()
}

#[test]
fn a_machine_without_a_driver_is_told_how_to_get_one() {
    if open().is_none() {
        return;
    }
    let said = child_with("VK_DRIVER_FILES", Path::new("/dev/null"));
    assert!(said.contains("NoDriver"), "{said}");
    assert!(said.contains("apt-get install libvulkan1 mesa-vulkan-drivers"), "{said}");
}

#[test]
fn a_machine_without_a_loader_is_told_how_to_get_one() {
    // An empty library comes first in the search path and cannot be loaded.
    let directory = tempfile::tempdir().unwrap();
    fs::write(directory.path().join("libvulkan.so.1"), "").unwrap();
    let said = child_with("LD_LIBRARY_PATH", directory.path());
    assert!(said.contains("NoLoader"), "{said}");
    assert!(said.contains("apt-get install libvulkan1 mesa-vulkan-drivers"), "{said}");
}

#[test]
fn a_machine_without_the_validation_layer_is_told_how_to_get_it() {
    if open().is_none() {
        return;
    }
    let directory = tempfile::tempdir().unwrap();
    let said = child_with("VK_LAYER_PATH", directory.path());
    assert!(said.contains("NoValidation"), "{said}");
    assert!(said.contains("apt-get install vulkan-validationlayers"), "{said}");
}

const ADD: &str = "
struct Push { first: u32, addend: f32 }
var<immediate> push: Push;
@group(0) @binding(0) var<storage, read_write> values: array<f32>;
@compute @workgroup_size(8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    values[push.first + id.x] += push.addend;
}";

fn add_push(first: u32, addend: f32) -> Vec<u8> {
    [first.to_le_bytes(), addend.to_le_bytes()].concat()
}

#[test]
fn a_dispatch_changes_just_what_its_push_constants_say() {
    with_device(|device| {
        let buffer = host_storage(device, "values", &[1.0; 24]);
        let add = pipeline(device, ADD);
        let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&buffer)]).unwrap();
        let twice = |recorder: &mut Recorder| {
            recorder.dispatch(&add, &set, &add_push(8, 1.0), [1, 1, 1])?;
            recorder.compute_to_compute();
            recorder.dispatch(&add, &set, &add_push(8, 2.0), [2, 1, 1])?;
            recorder.compute_to_host();
            Ok(())
        };
        device.run("add", twice).unwrap();
        let expected = [[1.0; 8], [4.0; 8], [3.0; 8]].concat();
        assert_eq!(read_f32(&buffer), expected);
    });
}

#[test]
fn a_shader_that_writes_past_the_end_leaves_the_rest_alone() {
    with_device(|device| {
        let buffer = host_storage(device, "values", &[1.0; 4]);
        let add = pipeline(device, ADD);
        let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&buffer)]).unwrap();
        let past = |recorder: &mut Recorder| {
            recorder.dispatch(&add, &set, &add_push(1_000_000, 1.0), [4, 1, 1])?;
            recorder.compute_to_host();
            Ok(())
        };
        device.run("add", past).unwrap();
        assert_eq!(read_f32(&buffer), [1.0; 4]);
    });
}

#[test]
fn a_buffer_of_the_device_is_filled_and_read_by_copies() {
    with_device(|device| {
        let values: Vec<f32> = (0_u8..16).map(f32::from).collect();
        let upload = Buffer::host(device, "upload", 64, HostUse::Upload).unwrap();
        upload.write(0, &bytes_of(&values)).unwrap();
        let inside = Buffer::device(device, "inside", 64).unwrap();
        let back = Buffer::host(device, "back", 32, HostUse::ReadBack).unwrap();
        let add = pipeline(device, ADD);
        let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&inside)]).unwrap();
        let there_and_back = |recorder: &mut Recorder| {
            recorder.copy(&upload, 0, &inside, 0, 64)?;
            recorder.transfer_to_compute();
            recorder.dispatch(&add, &set, &add_push(0, 0.5), [2, 1, 1])?;
            recorder.compute_to_transfer();
            recorder.copy(&inside, 32, &back, 0, 32)?;
            recorder.transfer_to_host();
            Ok(())
        };
        device.run("there and back", there_and_back).unwrap();
        let expected: Vec<f32> = values[8..].iter().map(|value| value + 0.5).collect();
        assert_eq!(read_f32(&back), expected);
    });
}

const SAMPLE: &str = "
@group(0) @binding(0) var volume: texture_3d<f32>;
@group(0) @binding(1) var between: sampler;
@group(0) @binding(2) var<storage, read> places: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> answers: array<vec4<f32>>;
@compute @workgroup_size(8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    if (id.x < arrayLength(&places)) {
        answers[id.x] = textureSampleLevel(volume, between, places[id.x].xyz, 0.0);
    }
}";

/// Uploads `texels` (encoded, x fastest) in slabs of one, then two slices, each in its own submission.
fn upload_in_slabs(device: &Device, image: &Image3d, texels: &[u8]) {
    let [.., depth] = image.extent();
    let slice = texels.len() / depth as usize;
    let staging = Buffer::host(device, "slab", 2 * slice as u64, HostUse::Upload).unwrap();
    let mut z = 0;
    for slices in [1, 2].into_iter().cycle() {
        if z == depth {
            return;
        }
        let end = depth.min(z + slices);
        staging.write(0, &texels[z as usize * slice..end as usize * slice]).unwrap();
        device.run("upload", |recorder| recorder.upload(image, z..end, &staging, 0)).unwrap();
        z = end;
    }
}

/// Samples `image` with `filter` at `places` (voxel coordinates; voxel centres are integers).
fn sample(device: &Device, image: &Image3d, filter: Filter, places: &[[f32; 3]]) -> Vec<[f32; 4]> {
    let extent = image.extent().map(|texels| f32::from(u16::try_from(texels).unwrap()));
    let normalised: Vec<f32> = places
        .iter()
        .flat_map(|[x, y, z]| [(x + 0.5) / extent[0], (y + 0.5) / extent[1], (z + 0.5) / extent[2], 0.0])
        .collect();
    let places = host_storage(device, "places", &normalised);
    let answers = host_storage(device, "answers", &vec![f32::NAN; normalised.len()]);
    let shader = pipeline(device, SAMPLE);
    let sampler = Sampler::new(device, "between", filter).unwrap();
    let resources = [
        Resource::Texture(image),
        Resource::Sampler(&sampler),
        Resource::Storage(&places),
        Resource::Storage(&answers),
    ];
    let set = ResourceSet::new(device, "sample", &shader, &resources).unwrap();
    let groups = u32::try_from(normalised.len() / 4).unwrap().div_ceil(8);
    let run = |recorder: &mut Recorder| {
        recorder.dispatch(&shader, &set, &[], [groups, 1, 1])?;
        recorder.compute_to_host();
        Ok(())
    };
    device.run("sample", run).unwrap();
    read_f32(&answers).chunks_exact(4).map(|four| four.try_into().unwrap()).collect()
}

/// Eight, four and four voxels: powers of two, so that the coordinates below are exact in f32.
const EXTENT: [u32; 3] = [8, 4, 4];

/// Deterministic pseudorandom words.
fn random_words(count: usize) -> Vec<u32> {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        u32::try_from(state >> 32).unwrap()
    };
    (0..count).map(|_| next()).collect()
}

/// Trilinear interpolation of `value(x, y, z)` in f64, clamped at the edges.
fn trilinear(value: impl Fn([usize; 3]) -> f64, place: [f32; 3]) -> f64 {
    let axis = |coordinate: f32, texels: u32| {
        let last = f64::from(texels - 1);
        let low = f64::from(coordinate).floor();
        let at = |voxel: f64| [0, 1, 2, 3, 4, 5, 6, 7].into_iter().rfind(|&v| f64::from(v) <= voxel.clamp(0.0, last));
        let index = |voxel: f64| usize::try_from(at(voxel).unwrap()).unwrap();
        let weight = f64::from(coordinate) - low;
        [(index(low), 1.0 - weight), (index(low + 1.0), weight)]
    };
    let [x, y, z] = [0, 1, 2].map(|a| axis(place[a], EXTENT[a]));
    let mut sum = 0.0;
    for (x, x_weight) in x {
        for (y, y_weight) in y {
            for (z, z_weight) in z {
                sum += x_weight * y_weight * z_weight * value([x, y, z]);
            }
        }
    }
    sum
}

/// Places a quarter of a voxel apart, from outside one edge to outside the opposite one. Their weights need two bits;
/// every
/// device has at least four.
fn quarter_places() -> Vec<[f32; 3]> {
    let along = |texels: u32| (0..=4 * texels).map(|quarter| f32::from(u16::try_from(quarter).unwrap()) * 0.25 - 0.5);
    let mut places = Vec::new();
    for z in along(EXTENT[2]) {
        for y in along(EXTENT[1]) {
            places.extend(along(EXTENT[0]).map(|x| [x, y, z]));
        }
    }
    places
}

/// Errors of a linear fetch, relative to the largest value: one rounding in decoding, and three nested interpolations
/// with
/// three roundings each, on differences up to twice the largest value: (1 + 3·3·2)·2⁻²⁴ = 1.1e-6.
const FETCH: f64 = 19.0 / 16_777_216.0;

/// The same of a filter in hardware: a quarter of the smallest step of 16 bits and a sign. An NVIDIA H200 is off by an eighth.
const HARDWARE_FETCH: f64 = 0.25 / 32767.0;

/// Uploads random texels of `format`, and compares samples with their decoded values.
fn check_linear_fetch(format: Format, channels: usize, encode: impl Fn(u32) -> (Vec<u8>, f64)) {
    with_device(|device| {
        if !device.limits().linear_filter(format) {
            eprintln!("skipped: {} does not filter {format:?}", device.info().name);
            return;
        }
        let [width, height, depth] = EXTENT.map(|texels| texels as usize);
        let encoded: Vec<_> = random_words(width * height * depth * channels).into_iter().map(encode).collect();
        let texels: Vec<u8> = encoded.iter().flat_map(|(bytes, _)| bytes.clone()).collect();
        let image = Image3d::new(device, "random", format, EXTENT).unwrap();
        upload_in_slabs(device, &image, &texels);
        let places = quarter_places();
        let answers = sample(device, &image, Filter::Linear, &places);
        let largest = encoded.iter().map(|(_, value)| value.abs()).fold(0.0, f64::max);
        let fetch = if device.info().kind == DeviceKind::Software { FETCH } else { HARDWARE_FETCH };
        for (place, answer) in places.iter().zip(&answers) {
            for channel in 0..channels {
                let value = |[x, y, z]: [usize; 3]| encoded[((z * height + y) * width + x) * channels + channel].1;
                let expected = trilinear(value, *place);
                let error = (f64::from(answer[channel]) - expected).abs();
                assert!(error <= fetch * largest, "{format:?} at {place:?}: {} is not {expected}", answer[channel]);
            }
        }
    });
}

#[test]
fn r16_unorm_is_interpolated() {
    check_linear_fetch(Format::R16Unorm, 1, |word| {
        let code = u16::try_from(word >> 16).unwrap();
        (code.to_le_bytes().to_vec(), f64::from(code) / 65535.0)
    });
}

#[test]
fn r32_float_is_interpolated() {
    check_linear_fetch(Format::R32Float, 1, |word| {
        let value = f32::from(u16::try_from(word >> 16).unwrap()) - 30000.0;
        (value.to_le_bytes().to_vec(), f64::from(value))
    });
}

#[test]
fn rgba16_snorm_is_interpolated() {
    check_linear_fetch(Format::Rgba16Snorm, 4, |word| {
        let code = u16::try_from(word >> 16).unwrap().cast_signed();
        (code.to_le_bytes().to_vec(), (f64::from(code) / 32767.0).max(-1.0))
    });
}

#[test]
fn rgba32_float_is_interpolated() {
    check_linear_fetch(Format::Rgba32Float, 4, |word| {
        let value = f32::from(u16::try_from(word >> 16).unwrap()) / 65536.0;
        (value.to_le_bytes().to_vec(), f64::from(value))
    });
}

#[test]
fn code_zero_of_snorm_is_zero_at_every_place() {
    with_device(|device| {
        let image = Image3d::new(device, "zero", Format::Rgba16Snorm, EXTENT).unwrap();
        upload_in_slabs(device, &image, &[0; 8 * 4 * 4 * 8]);
        let places: Vec<_> = quarter_places().into_iter().map(|place| place.map(|x| x * 1.013)).collect();
        for answer in sample(device, &image, Filter::Linear, &places) {
            assert_eq!(answer.map(f32::to_bits).map(|bits| bits & 0x7fff_ffff), [0; 4]);
        }
    });
}

#[test]
fn a_nearest_sampler_gives_voxels_as_they_are() {
    with_device(|device| {
        let codes = random_words(8 * 4 * 4);
        let values: Vec<f32> = codes.iter().map(|word| f32::from(u16::try_from(word >> 16).unwrap())).collect();
        let image = Image3d::new(device, "voxels", Format::R32Float, EXTENT).unwrap();
        upload_in_slabs(device, &image, &bytes_of(&values));
        let answers = sample(device, &image, Filter::Nearest, &[[3.25, 1.75, 0.0], [-5.0, 3.4, 9.0]]);
        // Voxel (3, 2, 0), and the corner (0, 3, 3).
        assert_eq!(answers[0][..1], values[2 * 8 + 3..][..1]);
        assert_eq!(answers[1][..1], values[3 * 32 + 3 * 8..][..1]);
    });
}

#[test]
fn labels_are_read_as_integers() {
    let source = "
        @group(0) @binding(0) var labels: texture_3d<u32>;
        @group(0) @binding(1) var<storage, read_write> answers: array<f32>;
        @compute @workgroup_size(8)
        fn main(@builtin(local_invocation_index) i: u32) {
            answers[i] = f32(textureLoad(labels, vec3(i, 3u, 2u), 0).x);
        }";
    with_device(|device| {
        for format in [Format::R8Uint, Format::R16Uint, Format::R32Uint] {
            let bytes = format.texel_bytes() as usize;
            let texels: Vec<u8> =
                (0_u8..128).flat_map(|label| label.to_le_bytes().into_iter().chain([0; 3]).take(bytes)).collect();
            let image = Image3d::new(device, "labels", format, EXTENT).unwrap();
            upload_in_slabs(device, &image, &texels);
            let answers = host_storage(device, "answers", &[f32::NAN; 8]);
            let shader = pipeline(device, source);
            let resources = [Resource::Texture(&image), Resource::Storage(&answers)];
            let set = ResourceSet::new(device, "labels", &shader, &resources).unwrap();
            let run = |recorder: &mut Recorder| {
                recorder.dispatch(&shader, &set, &[], [1, 1, 1])?;
                recorder.compute_to_host();
                Ok(())
            };
            device.run("labels", run).unwrap();
            assert_eq!(read_f32(&answers), [88.0, 89.0, 90.0, 91.0, 92.0, 93.0, 94.0, 95.0], "{format:?}");
        }
    });
}

const ACCUMULATE: &str = "
struct Band { first_row: u32, layers: u32, share: f32, unused: f32 }
@group(0) @binding(0) var<uniform> band: Band;
@group(0) @binding(1) var accumulator: texture_storage_2d_array<rgba32float, read_write>;
@group(0) @binding(2) var transmittance: texture_storage_2d_array<r32float, read_write>;
@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2(id.x, id.y + band.first_row);
    for (var layer = 0u; layer < band.layers; layer += 1u) {
        let before = textureLoad(accumulator, pixel, layer);
        let place = vec4(f32(pixel.x), f32(pixel.y), f32(layer), 1.0);
        textureStore(accumulator, pixel, layer, before + band.share * place);
    }
    let left = textureLoad(transmittance, pixel, 0u).x;
    textureStore(transmittance, pixel, 0u, vec4(0.5 * left));
}";

#[test]
fn a_second_dispatch_adds_to_what_the_first_left() {
    with_device(|device| {
        let accumulator = StorageImage::new(device, "accumulator", Format::Rgba32Float, [16, 16], 3).unwrap();
        let transmittance = StorageImage::new(device, "transmittance", Format::R32Float, [16, 16], 1).unwrap();
        let band = Buffer::host(device, "band", 16, HostUse::Uniform).unwrap();
        band.write(0, &[8_u32.to_le_bytes(), 2_u32.to_le_bytes(), 2_f32.to_le_bytes(), [0; 4]].concat()).unwrap();
        let shader = pipeline(device, ACCUMULATE);
        let resources =
            [Resource::Uniform(&band), Resource::StorageImage(&accumulator), Resource::StorageImage(&transmittance)];
        let set = ResourceSet::new(device, "accumulate", &shader, &resources).unwrap();
        // Half of the rows, two of the three layers; each slice of the ray is its own submission.
        let clear = |recorder: &mut Recorder| {
            recorder.clear(&accumulator, [0.0; 4])?;
            recorder.clear(&transmittance, [1.0; 4])?;
            Ok(())
        };
        device.run("clear", clear).unwrap();
        let slices = [(); 3].map(|()| {
            let mut recorder = Recorder::begin(device, "slice").unwrap();
            recorder.transfer_to_compute();
            recorder.compute_to_compute();
            recorder.dispatch(&shader, &set, &[], [2, 1, 1]).unwrap();
            recorder.submit().unwrap()
        });
        for slice in slices {
            slice.finish().unwrap();
        }
        let sums = read_image(device, &accumulator);
        let left = read_image(device, &transmittance);
        for (pixel, sum) in sums.chunks_exact(4).enumerate() {
            let (x, y, layer) = (pixel % 16, pixel / 16 % 16, pixel / 256);
            let place = [x, y, layer, 1].map(|part| f32::from(u8::try_from(part).unwrap()));
            let times = if y >= 8 && layer < 2 { 6.0 } else { 0.0 };
            assert_eq!(sum, place.map(|part| times * part), "pixel {x}, {y} of layer {layer}");
        }
        assert_eq!(left, [[1.0; 128], [0.125; 128]].concat());
    });
}

#[test]
fn what_no_dispatch_writes_stays_as_it_was_cleared() {
    with_device(|device| {
        let source = "
            @group(0) @binding(0) var picture: texture_storage_2d_array<rgba32float, write>;
            @compute @workgroup_size(8, 8)
            fn main(@builtin(global_invocation_id) id: vec3<u32>) { textureStore(picture, id.xy, 0u, vec4(1.0)); }";
        let picture = StorageImage::new(device, "picture", Format::Rgba32Float, [9, 8], 1).unwrap();
        let shader = pipeline(device, source);
        let set = ResourceSet::new(device, "picture", &shader, &[Resource::StorageImage(&picture)]).unwrap();
        let run = |recorder: &mut Recorder| {
            recorder.clear(&picture, [f32::NAN; 4])?;
            recorder.transfer_to_compute();
            recorder.dispatch(&shader, &set, &[], [1, 1, 1])
        };
        device.run("picture", run).unwrap();
        let texels = read_image(device, &picture);
        for row in texels.chunks_exact(9 * 4) {
            let (written, left) = row.split_at(8 * 4);
            assert_eq!(written, [1.0; 8 * 4]);
            assert!(left.iter().all(|part| part.is_nan()), "{left:?}");
        }
    });
}

#[test]
fn an_rgba8_picture_is_rounded_to_bytes() {
    with_device(|device| {
        let source = "
            @group(0) @binding(0) var picture: texture_storage_2d_array<rgba8unorm, write>;
            @compute @workgroup_size(8)
            fn main(@builtin(global_invocation_id) id: vec3<u32>) {
                textureStore(picture, id.xy, 0u, vec4(f32(id.x) / 255.0, -1.0, 2.0, 0.5));
            }";
        let picture = StorageImage::new(device, "picture", Format::Rgba8Unorm, [8, 1], 1).unwrap();
        let shader = pipeline(device, source);
        let set = ResourceSet::new(device, "picture", &shader, &[Resource::StorageImage(&picture)]).unwrap();
        let back = Buffer::host(device, "back", picture.layer_bytes(), HostUse::ReadBack).unwrap();
        let run = |recorder: &mut Recorder| {
            recorder.dispatch(&shader, &set, &[], [1, 1, 1])?;
            recorder.compute_to_transfer();
            recorder.read_back(&picture, 0, &back, 0)?;
            recorder.transfer_to_host();
            Ok(())
        };
        device.run("picture", run).unwrap();
        let mut bytes = [0; 32];
        back.read(0, &mut bytes).unwrap();
        for (x, pixel) in (0_u8..).zip(bytes.chunks_exact(4)) {
            assert_eq!(pixel[..3], [x, 0, 255]);
            assert!(matches!(pixel[3], 127 | 128), "a half is {}", pixel[3]);
        }
    });
}

#[test]
fn timestamps_do_not_run_backwards() {
    with_device(|device| {
        let mut recorder = Recorder::begin(device, "times").unwrap();
        for _ in 0..3 {
            recorder.timestamp().unwrap();
        }
        let mut submission = recorder.submit().unwrap();
        while !submission.wait(Duration::from_secs(1)).unwrap() {}
        let times = submission.timestamps().unwrap();
        if device.limits().timestamp_valid_bits == 0 {
            eprintln!("skipped: {} has no timestamps", device.info().name);
            return;
        }
        assert_eq!(times.len(), 3);
        assert!(times[0].is_zero() && times.is_sorted() && times[2] < Duration::from_secs(1), "{times:?}");
    });
}

#[test]
fn what_a_submission_uses_outlives_its_owners() {
    with_device(|device| {
        let submission = {
            let buffer = host_storage(device, "values", &[1.0; 8]);
            let add = pipeline(device, ADD);
            let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&buffer)]).unwrap();
            let mut recorder = Recorder::begin(device, "add").unwrap();
            recorder.dispatch(&add, &set, &add_push(0, 1.0), [1, 1, 1]).unwrap();
            recorder.submit().unwrap()
        };
        submission.finish().unwrap();
    });
}

#[test]
fn recordings_and_submissions_that_are_dropped_leave_nothing_behind() {
    with_device(|device| {
        let buffer = host_storage(device, "values", &[0.0; 8]);
        let add = pipeline(device, ADD);
        let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&buffer)]).unwrap();
        for submitted in [true, false, true] {
            let mut recorder = Recorder::begin(device, "add").unwrap();
            recorder.compute_to_compute();
            recorder.dispatch(&add, &set, &add_push(0, 1.0), [1, 1, 1]).unwrap();
            recorder.compute_to_host();
            if submitted {
                drop(recorder.submit().unwrap());
            }
        }
        assert_eq!(read_f32(&buffer), [2.0; 8]);
    });
}

#[test]
fn a_buffer_in_use_is_neither_read_nor_written() {
    with_device(|device| {
        let buffer = host_storage(device, "values", &[0.0; 8]);
        let add = pipeline(device, ADD);
        let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&buffer)]).unwrap();
        let mut recorder = Recorder::begin(device, "add").unwrap();
        recorder.dispatch(&add, &set, &add_push(0, 1.0), [1, 1, 1]).unwrap();
        let submission = recorder.submit().unwrap();
        // In use even if the device has finished, because nothing has waited for it.
        assert!(matches!(buffer.write(0, &[0; 4]), Err(VulkanError::InUse { .. })), "written while in use");
        assert!(matches!(buffer.read(0, &mut [0; 4]), Err(VulkanError::InUse { .. })), "read while in use");
        submission.finish().unwrap();
        buffer.write(0, &[0; 4]).unwrap();
    });
}

#[test]
fn threads_share_a_device() {
    with_device(|device| {
        let add = pipeline(device, ADD);
        thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    let buffer = host_storage(device, "values", &[0.0; 8]);
                    let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&buffer)]).unwrap();
                    for _ in 0..50 {
                        let run = |recorder: &mut Recorder| {
                            recorder.compute_to_compute();
                            recorder.dispatch(&add, &set, &add_push(0, 1.0), [1, 1, 1])?;
                            recorder.compute_to_host();
                            Ok(())
                        };
                        device.run("add", run).unwrap();
                    }
                    assert_eq!(read_f32(&buffer), [50.0; 8]);
                });
            }
        });
    });
}

#[test]
fn images_over_the_limits_are_refused_with_both_numbers() {
    with_device(|device| {
        let limits = device.limits();
        let limit = limits.max_extent_3d(Format::R16Unorm)[2];
        let error = Image3d::new(device, "tower", Format::R16Unorm, [1, 1, limit + 1]).unwrap_err();
        let said = error.to_string();
        assert!(matches!(error, VulkanError::TooLarge { .. }), "{error:?}");
        assert!(said.contains("tower") && said.contains(&limit.to_string()), "{said}");
        assert!(said.contains(&(limit + 1).to_string()), "{said}");

        let limit = limits.max_layers(Format::Rgba32Float);
        let layers = StorageImage::new(device, "layers", Format::Rgba32Float, [1, 1], limit + 1);
        assert!(matches!(layers, Err(VulkanError::TooLarge { .. })), "{layers:?}");

        let cube = Image3d::new(device, "cube", Format::Rgba32Float, limits.max_extent_3d(Format::Rgba32Float));
        assert!(matches!(cube, Err(VulkanError::TooLarge { .. })), "{cube:?}");
    });
}

#[test]
fn buffers_over_the_limits_are_refused() {
    with_device(|device| {
        let limits = device.limits();
        let storage = Buffer::device(device, "table", limits.max_storage_buffer_bytes + 1);
        assert!(matches!(storage, Err(VulkanError::TooLarge { .. })), "{storage:?}");
        let uniform = Buffer::host(device, "uniform", limits.max_uniform_buffer_bytes + 1, HostUse::Uniform);
        assert!(matches!(uniform, Err(VulkanError::TooLarge { .. })), "{uniform:?}");
        let upload = Buffer::host(device, "upload", u64::MAX, HostUse::Upload);
        assert!(matches!(upload, Err(VulkanError::TooLarge { .. })), "{upload:?}");
    });
}

/// Creates unused images until the device runs out of memory, and returns the error.
fn fill(device: &Device) -> VulkanError {
    let limits = device.limits();
    // Half of it: devices add bytes to those of the texels.
    let slices = u32::try_from(limits.max_allocation_bytes / 2 / (1024 * 1024 * 4)).unwrap_or(u32::MAX);
    let extent = [1024, 1024, slices.min(limits.max_extent_3d(Format::R32Float)[2])];
    let mut held = Vec::new();
    loop {
        match Image3d::new(device, "heap filler", Format::R32Float, extent) {
            Ok(image) => held.push(image),
            Err(error) => return error,
        }
        assert!(held.len() < 1000, "the device lends more memory than there is");
    }
}

/// Not a test: see below.
#[test]
#[ignore = "run by the test of a full device"]
fn child_fills_the_device() {
    println!("{:?}", fill(&Device::open(&DeviceChoice::Auto, Validation::Off).unwrap()));
}

#[test]
fn a_device_without_enough_memory_says_who_wanted_how_much() {
    let Some(device) = open() else { return };
    let heap_bytes = device.limits().device_heap_bytes;
    let said = if device.info().kind == DeviceKind::Software {
        // A software device allocates address space, which is unlimited without `ulimit`.
        let limited = "ulimit -v 8000000 && exec \"$0\" --exact child_fills_the_device --ignored --nocapture";
        let output = Command::new("sh").arg("-c").arg(limited).arg(env::current_exe().unwrap()).output().unwrap();
        assert!(output.status.success(), "{output:?}");
        String::from_utf8_lossy(&output.stdout).into_owned()
    } else {
        format!("{:?}", fill(&device))
    };
    assert!(said.contains("OutOfMemory { object: \"heap filler\", bytes: "), "{said}");
    assert!(said.contains(&format!("heap_bytes: {heap_bytes} }}")), "{said}");
}

#[test]
fn misuse_is_an_error_and_reaches_no_driver() {
    with_device(|device| {
        let misuse = |result: Result<(), VulkanError>, what: &str| {
            assert!(matches!(result, Err(VulkanError::Misuse { .. })), "{what}: {result:?}");
        };
        let values = host_storage(device, "values", &[0.0; 8]);
        let upload = Buffer::host(device, "upload", 64, HostUse::Upload).unwrap();
        let inside = Buffer::device(device, "inside", 64).unwrap();
        let image = Image3d::new(device, "image", Format::R16Unorm, [4, 4, 4]).unwrap();
        let picture = StorageImage::new(device, "picture", Format::R32Float, [4, 4], 2).unwrap();
        let add = pipeline(device, ADD);
        let set = ResourceSet::new(device, "add", &add, &[Resource::Storage(&values)]).unwrap();

        misuse(Buffer::device(device, "nothing", 0).map(drop), "a buffer of nothing");
        misuse(Image3d::new(device, "flat", Format::R16Unorm, [4, 0, 4]).map(drop), "an image of nothing");
        misuse(values.write(30, &[0; 4]), "writing past the end");
        misuse(values.read(u64::MAX, &mut [0; 4]), "reading past the end of numbers");
        misuse(inside.write(0, &[0; 4]), "writing what the host does not see");
        misuse(ResourceSet::new(device, "set", &add, &[]).map(drop), "too few resources");
        misuse(ResourceSet::new(device, "set", &add, &[Resource::Uniform(&values)]).map(drop), "another kind");
        misuse(ResourceSet::new(device, "set", &add, &[Resource::Storage(&upload)]).map(drop), "another use");

        let mut recorder = Recorder::begin(device, "misuse").unwrap();
        misuse(recorder.dispatch(&add, &set, &[0; 4], [1, 1, 1]), "too few push constants");
        misuse(recorder.upload(&image, 3..5, &upload, 0), "slices that are not there");
        misuse(recorder.upload(&image, 0..2, &upload, 4), "bytes that are not there");
        misuse(recorder.upload(&image, 0..1, &upload, 2), "an odd offset");
        misuse(
            recorder.upload(&image, 0..1, &Buffer::host(device, "b", 64, HostUse::ReadBack).unwrap(), 0),
            "a target",
        );
        misuse(recorder.read_back(&picture, 2, &inside, 0), "a layer that is not there");
        misuse(recorder.read_back(&picture, 0, &inside, 4), "a buffer too short");
        let outside = [picture.extent()[0], 0];
        misuse(recorder.read_back_texel(&picture, 0, outside, &inside, 0), "a texel that is not there");
        misuse(recorder.copy(&inside, 0, &inside, 32, 16), "a copy into itself");
        let groups = recorder.dispatch(&add, &set, &add_push(0, 0.0), [u32::MAX, 1, 1]);
        let most = device.limits().max_groups[0];
        assert!(most == u32::MAX || matches!(groups, Err(VulkanError::TooLarge { .. })), "{groups:?}");

        let other = Device::open(&DeviceChoice::Auto, Validation::Off).unwrap();
        misuse(ResourceSet::new(&other, "set", &add, &[Resource::Storage(&values)]).map(drop), "another device");
        let mut elsewhere = Recorder::begin(&other, "misuse").unwrap();
        misuse(elsewhere.clear(&picture, [0.0; 4]), "another device's image");
        misuse(elsewhere.dispatch(&add, &set, &add_push(0, 0.0), [1, 1, 1]), "another device's pipeline");
    });
}

/// Reads a picture back without the barrier that this needs.
fn read_without_barrier(device: &Device) {
    let picture = StorageImage::new(device, "picture", Format::R32Float, [4, 4], 1).unwrap();
    let back = Buffer::host(device, "back", 64, HostUse::ReadBack).unwrap();
    let hasty = |recorder: &mut Recorder| {
        recorder.clear(&picture, [1.0; 4])?;
        recorder.read_back(&picture, 0, &back, 0)
    };
    device.run("hasty", hasty).unwrap();
}

#[test]
fn the_validation_layer_reports_a_missing_barrier() {
    let Some(device) = open() else { return };
    read_without_barrier(&device);
    let messages = device.validation_messages();
    assert!(messages.iter().any(|message| message.contains("SYNC-HAZARD-READ-AFTER-WRITE")), "{messages:?}");
    assert!(messages.iter().any(|message| message.contains("picture")), "{messages:?}");
    assert!(device.validation_messages().is_empty(), "messages are handed out once");
}

/// Log messages of this thread during `work`.
fn logged(work: impl FnOnce()) -> String {
    let log = tempfile::NamedTempFile::new().unwrap();
    let writer = Arc::new(log.reopen().unwrap());
    let subscriber = tracing_subscriber::fmt().with_ansi(false).with_writer(writer).finish();
    tracing::subscriber::with_default(subscriber, work);
    fs::read_to_string(log.path()).unwrap()
}

#[test]
fn a_device_goes_with_everything_made_from_it() {
    let Some(device) = open() else { return };
    let log = logged(|| {
        let values = host_storage(&device, "values", &[0.0; 8]);
        let image = Image3d::new(&device, "image", Format::R16Unorm, [4, 4, 4]).unwrap();
        let sampler = Sampler::new(&device, "sampler", Filter::Linear).unwrap();
        let picture = StorageImage::new(&device, "picture", Format::R32Float, [4, 4], 2).unwrap();
        let add = pipeline(&device, ADD);
        let set = ResourceSet::new(&device, "add", &add, &[Resource::Storage(&values)]).unwrap();
        let run = |recorder: &mut Recorder| {
            recorder.timestamp()?;
            recorder.dispatch(&add, &set, &add_push(0, 1.0), [1, 1, 1])
        };
        device.run("add", run).unwrap();
        drop((values, image, sampler, picture, add, set));
        assert!(device.validation_messages().is_empty(), "before the device goes");
        drop(device);
    });
    assert!(log.is_empty(), "{log}");
}

#[test]
fn what_the_validation_layer_says_last_is_logged() {
    let Some(device) = open() else { return };
    let log = logged(|| {
        read_without_barrier(&device);
        drop(device);
    });
    assert!(log.contains("SYNC-HAZARD"), "{log}");
}

#[test]
fn objects_keep_their_device_open() {
    let Some(device) = open() else { return };
    let buffer = host_storage(&device, "values", &[1.0; 4]);
    drop(device);
    assert_eq!(read_f32(&buffer), [1.0; 4]);
}

/// A device of this test, opened without the library, with a queue and its family.
#[expect(unsafe_code, reason = "a device of somebody else is opened by raw calls")]
fn own_device() -> (LentDevice, impl FnOnce()) {
    // SAFETY: the loader is that of the system.
    let entry = unsafe { ash::Entry::load() }.unwrap();
    let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_3);
    let info = vk::InstanceCreateInfo::default().application_info(&application);
    // SAFETY: `info` outlives the call.
    let instance = unsafe { entry.create_instance(&info, None) }.unwrap();
    // SAFETY: the instance is alive.
    let physical = unsafe { instance.enumerate_physical_devices() }.unwrap()[0];
    // SAFETY: the device comes from the instance.
    let families = unsafe { instance.get_physical_device_queue_family_properties(physical) };
    let computes = |family: &vk::QueueFamilyProperties| family.queue_flags.contains(vk::QueueFlags::COMPUTE);
    let queue_family = u32::try_from(families.iter().position(computes).unwrap()).unwrap();
    let priorities = [1.0];
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(queue_family).queue_priorities(&priorities)];
    let features = vk::PhysicalDeviceFeatures::default().robust_buffer_access(true);
    let mut synchronization2 = vk::PhysicalDeviceSynchronization2Features::default().synchronization2(true);
    let info = vk::DeviceCreateInfo::default()
        .queue_create_infos(&queues)
        .enabled_features(&features)
        .push_next(&mut synchronization2);
    // SAFETY: `info` outlives the call.
    let device = unsafe { instance.create_device(physical, &info, None) }.unwrap();
    // SAFETY: the device was created with one queue of this family.
    let queue = unsafe { device.get_device_queue(queue_family, 0) };
    let (of_device, of_instance) = (device.clone(), instance.clone());
    let close = move || {
        // SAFETY: nothing of the device is in use any more.
        unsafe { of_device.destroy_device(None) };
        // SAFETY: nor is anything of the instance.
        unsafe { of_instance.destroy_instance(None) };
    };
    (LentDevice { entry, instance, physical, device, queue, queue_family }, close)
}

#[test]
#[expect(unsafe_code, reason = "a lent device takes promises that no type holds")]
fn a_lent_device_gives_the_same_film_and_stays_open() {
    let Some(opened) = open() else { return };
    let text = "version = 1\n[volume]\nphantom = \"gaussian\"\ndims = [16, 16, 16]\n\
                [materials.blue]\nreflectance = \"blue sky\"\n[lights.key]\nspectrum = \"D65\"\n\
                [[transfer.intervals]]\nmaterial = \"blue\"\nrange = [0.4, 1]\nramp = 0.2\nopacity = 0.2\n";
    let file = parse("lent", text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let film = |device: &Device| {
        let renderer = Renderer::new(device.clone());
        let on_device = SceneRenderer::new(&renderer, file.scene.clone(), &Quiet).unwrap();
        renderer.read(&on_device.march([24, 20], &Quiet).unwrap()).unwrap()
    };
    let (own, close) = own_device();
    for _ in 0..2 {
        // SAFETY: the handles belong together, the features are on, and no other thread uses the queue.
        let lent = unsafe { Device::from_lent(own.clone()) }.unwrap();
        assert_eq!(lent.info().name, opened.info().name);
        assert_eq!(film(&lent), film(&opened));
    }
    // SAFETY: the device is refused before it is used.
    let refused = unsafe { Device::from_lent(LentDevice { queue_family: 99, ..own.clone() }) };
    let error = refused.unwrap_err().to_string();
    assert!(error.contains("queue family 99 does not compute"), "{error}");
    // All films are read, so the device is idle.
    close();
}
