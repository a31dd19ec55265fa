//! TIFF: files of the shared folder, files written by tifffile (`tests/tools/make_tiff.py`), and generated ones of every
//! trap; invalid files.
#![expect(clippy::cast_possible_truncation, reason = "numbers are made to fit their types")]
#![expect(clippy::cast_precision_loss, reason = "numbers are small")]
#![expect(clippy::cast_possible_wrap, trivial_numeric_casts, reason = "one macro for all types")]

use crate::support::volumes;

use std::path::{Path, PathBuf};

use glam::DVec3;
use relume::progress::{Progress, Quiet};
use relume::volume::{self, Selection, Unit, Volume, VolumeError, Voxels, Window};
use serde_json::Value;

/// Files of the shared folder that the common check does not understand: channels, and floats of 16 bits.
const OTHERWISE: [&str; 3] = ["tiff/ome_2c.ome.tif", "tiff/imagej_zc.tif", "tiff/input4_float16.tiff"];

#[test]
fn every_shared_file_reads_as_an_independent_reader_found_it() {
    let Some(folder) = volumes::shared() else { return };
    let open = |name: &str, selection: &Selection| volume::open(&folder.join(name), selection, &Quiet);
    let is_ours = |name: &str| name.starts_with("tiff/") || name.starts_with("slices/");
    let checked = volumes::check_all(&folder, |name| is_ours(name) && !OTHERWISE.contains(&name), open);
    assert!(checked >= 9, "the shared folder has at least 9 such files, {checked} were checked");
}

#[test]
fn shared_files_of_channels_and_halves_read_as_an_independent_reader_found_them() {
    let Some(folder) = volumes::shared() else { return };
    let json: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    let expected = |name: &str| json["files"][name]["decoded_sha256"].as_str().unwrap().to_owned();
    let open = |name: &str, component| {
        volume::open(&folder.join(name), &Selection { component, ..Selection::default() }, &Quiet).unwrap()
    };
    let [ome, imagej, halves] = OTHERWISE;
    let [nuclei, membrane] = [0, 1].map(|channel| open(ome, Some(channel)));
    assert_eq!(volumes::hex(&[nuclei.voxels.bytes(), membrane.voxels.bytes()].concat()), expected(ome));
    assert_eq!((nuclei.geometry.spacing, nuclei.unit), (DVec3::new(0.5, 0.5, 1.5), Some(Unit::Micrometre)));
    assert_eq!(nuclei.component_names, ["nuclei", "membrane"]);
    // Slices of all channels follow each other.
    let channels = [0, 1].map(|channel| open(imagej, Some(channel)));
    let slice = 2 * channels[0].geometry.dims[0] * channels[0].geometry.dims[1];
    let slices = channels.each_ref().map(|volume| volume.voxels.bytes().chunks(slice));
    let [first, second] = slices;
    let all: Vec<u8> = first.zip(second).flat_map(|(first, second)| [first, second].concat()).collect();
    assert_eq!(volumes::hex(&all), expected(imagej));
    assert_eq!(
        (channels[0].geometry.spacing, channels[0].unit),
        (DVec3::new(0.25, 0.25, 0.75), Some(Unit::Micrometre))
    );
    let volume = open(halves, None);
    let Voxels::F32(values) = &volume.voxels else { panic!("{:?}", volume.voxels) };
    let bytes: Vec<u8> = values.iter().flat_map(|&value| half::f16::from_f32(value).to_le_bytes()).collect();
    assert_eq!((volumes::hex(&bytes), volume.geometry.dims), (expected(halves), [18, 15, 10]));
}

#[test]
fn the_spacing_of_scifio_is_read() {
    let Some(folder) = volumes::shared() else { return };
    let volume = volume::open(&folder.join("tiff/sample_ovule.tiff"), &Selection::default(), &Quiet).unwrap();
    // Written as numbers of 32 bits: scales=0.15000000596046448,0.15000000596046448,0.23499999940395355.
    assert!(volume.geometry.spacing.abs_diff_eq(DVec3::new(0.15, 0.15, 0.235), 1e-8), "{}", volume.geometry.spacing);
    assert_eq!(volume.unit, Some(Unit::Micrometre));
}

// Files of tifffile.

const DIMS: [usize; 3] = [21, 17, 3];

fn written(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tiff").join(name)
}

fn open(name: &str, selection: &Selection) -> Result<Volume, VolumeError> {
    volume::open(&written(name), selection, &Quiet)
}

fn component(index: usize) -> Selection {
    Selection { component: Some(index), ..Selection::default() }
}

/// n of every voxel of a component, x fastest.
fn numbers([nx, ny, nz]: [usize; 3], component: usize) -> Vec<u64> {
    let n = |index: usize| {
        let [x, y, z] = [index % nx, index / nx % ny, index / (nx * ny)];
        (x * x + 7 * y + 40 * z + 300 * component) as u64
    };
    (0..nx * ny * nz).map(n).collect()
}

/// The voxels of these numbers in a type; see `number` of `make_tiff.py`.
fn voxels(dtype: &str, numbers: &[u64]) -> Voxels {
    macro_rules! of {
        ($variant:ident $type:ident, $map:expr) => {
            Voxels::$variant(numbers.iter().map(|&n| $map(n) as $type).collect())
        };
    }
    match dtype {
        "uint8" => of!(U8 u8, |n| n % 251),
        "int8" => of!(I8 i8, |n| (n % 251) as i64 - 125),
        "uint16" => of!(U16 u16, |n| n * 37 % 65521),
        "int16" => of!(I16 i16, |n| (n * 37 % 65521) as i64 - 30000),
        "uint32" => of!(U32 u32, |n| n * 1_000_003 % 4_294_967_291),
        "int32" => of!(I32 i32, |n| (n * 1_000_003 % 4_294_967_291) as i64 - 2_000_000_000),
        "uint64" => of!(U64 u64, |n| n * 1_000_000_000_000_000),
        "int64" => of!(I64 i64, |n| n as i64 * 1_000_000_000_000_000 - 100_000_000_000_000_000),
        // Read as floats of 32 bits.
        "float16" => of!(F32 f32, |n| n as f32 / 8.0),
        "float32" => of!(F32 f32, |n| n as f32 / 8.0 - 20.0),
        "float64" => of!(F64 f64, |n| n as f64 / 1024.0 + 1e6),
        other => panic!("{other} is no type"),
    }
}

#[test]
fn every_type_compression_and_predictor_is_read_in_strips_and_tiles() {
    let mut checked = 0;
    for entry in std::fs::read_dir(written("")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let words: Vec<&str> = name.split('_').collect();
        let is_grey =
            ["none", "lzw", "deflate", "zstd", "packbits", "bigtiff", "inverted", "palette"].contains(&words[0]);
        if !is_grey {
            continue;
        }
        let volume = volume::open(&path, &Selection::default(), &Quiet).unwrap();
        assert_eq!(volume.geometry.dims, DIMS, "{name}");
        assert!(volume.voxels == voxels(words[1], &numbers(DIMS, 0)), "{name}");
        assert_eq!((volume.components, volume.unit, volume.geometry.spacing), (1, None, DVec3::ONE), "{name}");
        assert!(volume.notes[0].contains("no spacing"), "{name}: {:?}", volume.notes);
        let has_map = volume.notes.iter().any(|note| note.contains("colour map"));
        assert_eq!(has_map, words[0] == "palette", "{name}");
        checked += 1;
    }
    assert!(checked >= 40, "{checked} files");
}

#[test]
fn colours_are_components_however_they_are_stored() {
    for (name, dtype, count) in [
        ("rgb_uint8.tif", "uint8", 3),
        ("rgb_uint16_tiles.tif", "uint16", 3),
        ("rgb_float32_predictor.tif", "float32", 3),
        ("rgba_uint8.tif", "uint8", 4),
        ("planar_uint16.tif", "uint16", 3),
        ("planar_uint16_tiles.tif", "uint16", 3),
        ("rgb.ome.tif", "uint8", 3),
    ] {
        let error = volumes::refused(open(name, &Selection::default()), &[&format!("{count} components"), "RGB"]);
        assert!(matches!(error, VolumeError::Choose { .. }), "{error}");
        for index in 0..count {
            let volume = open(name, &component(index)).unwrap();
            assert!(volume.voxels == voxels(dtype, &numbers(DIMS, index)), "{name}, component {index}");
            assert_eq!((volume.geometry.dims, volume.components), (DIMS, count), "{name}");
        }
        assert!(matches!(open(name, &component(count)), Err(VolumeError::NoSuch { .. })), "{name}");
    }
}

#[test]
fn bits_are_labels_and_small_copies_are_no_slices() {
    let volume = open("bits.tif", &Selection::default()).unwrap();
    let expected: Vec<u8> = numbers(DIMS, 0).iter().map(|n| u8::from(n % 3 == 0)).collect();
    assert!(volume.has_labels && volume.voxels == Voxels::U8(expected), "one bit per voxel");
    let volume = open("thumbnails.tif", &Selection::default()).unwrap();
    assert_eq!(volume.geometry.dims, DIMS);
    assert!(volume.voxels == voxels("uint8", &numbers(DIMS, 0)), "only whole pages");
}

#[test]
fn jpeg_differs_by_its_rounding_only() {
    let grey: Vec<i32> = numbers(DIMS, 0).iter().map(|n| i32::from((n / 4) as u8)).collect();
    let check = |name: &str, volume: Volume, expected: &[i32], limit: i32| {
        let Voxels::U8(found) = volume.voxels else { panic!("{name}") };
        let worst = found.iter().zip(expected).map(|(&found, expected)| (i32::from(found) - expected).abs()).max();
        // Quality 100 divides by 1: half a step of rounding in each of 64 coefficients, and the inverse transform.
        assert!(worst.unwrap() <= limit, "{name}: {worst:?}");
    };
    for name in ["jpeg_uint8.tif", "jpeg_uint8_tiles.tif"] {
        check(name, open(name, &Selection::default()).unwrap(), &grey, 2);
    }
    // Samples without a transform: n / 4, 255 − n / 4, n / 8 and, in four samples, 100 + n / 8.
    for (name, samples) in [("jpeg_plain_rgb.tif", 3), ("jpeg_plain_cmyk.tif", 4)] {
        for index in 0..samples {
            let of = |&grey: &i32| [grey, 255 - grey, grey / 2, 100 + grey / 2][index];
            let expected: Vec<i32> = grey.iter().map(of).collect();
            check(name, open(name, &component(index)).unwrap(), &expected, 2);
        }
    }
    // Luminance n / 4, and the differences 255 − n / 4 and n / 8, as the colours of JFIF (ITU-T T.871).
    let colours = |y: f64| {
        let [blue, red] = [255.0 - y - 128.0, (y / 2.0).floor() - 128.0];
        [y + 1.402 * red, y - 0.344_136 * blue - 0.714_136 * red, y + 1.772 * blue]
    };
    for index in 0..3 {
        let expected: Vec<i32> =
            grey.iter().map(|&grey| colours(grey.into())[index].round().clamp(0.0, 255.0) as i32).collect();
        // The errors of the luminance and of a difference times 1.772 add up.
        check("jpeg_rgb.tif", open("jpeg_rgb.tif", &component(index)).unwrap(), &expected, 6);
    }
}

#[test]
fn a_hyperstack_of_imagej_has_channels_and_times() {
    for name in ["imagej_little.tif", "imagej_big.tif", "imagej_one_directory.tif"] {
        let error = open(name, &Selection::default()).map(drop).unwrap_err();
        assert!(matches!(error, VolumeError::Choose { .. }) && error.to_string().contains("2 components"), "{error}");
        let error = open(name, &component(1)).map(drop).unwrap_err();
        assert!(error.to_string().contains("2 time steps"), "{name}: {error}");
        for (channel, time) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let selection = Selection { time: Some(time), ..component(channel) };
            let volume = open(name, &selection).unwrap();
            let shifted: Vec<u64> = numbers(DIMS, channel).iter().map(|n| n + 11 * time as u64).collect();
            assert!(volume.voxels == voxels("uint16", &shifted), "{name}, channel {channel}, time {time}");
            assert_eq!((volume.geometry.dims, volume.components), (DIMS, 2));
            let windows: Vec<[f64; 2]> =
                volume.presets.windows.iter().map(|Window { low, high, .. }| [*low, *high]).collect();
            if name == "imagej_one_directory.tif" {
                assert_eq!(windows, [[3.0, 70.0]]);
                assert!(volume.notes[0].contains("no spacing"), "{:?}", volume.notes);
            } else {
                assert_eq!(windows, [[[10.0, 200.0], [30.0, 4000.0]][channel]], "{name}");
                assert_eq!(volume.geometry.spacing, DVec3::new(0.25, 0.5, 2.5), "{name}");
                assert_eq!(volume.unit, Some(Unit::Micrometre), "{name}");
                assert_eq!(volume.notes.len(), 0, "{:?}", volume.notes);
            }
        }
    }
}

#[test]
fn an_ome_file_has_channels_with_names_and_one_unit() {
    let error = open("channels.ome.tif", &Selection::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("2 components per voxel (DAPI, GFP)"), "{error}");
    for channel in 0..2 {
        let volume = open("channels.ome.tif", &component(channel)).unwrap();
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, channel)), "channel {channel}");
        assert_eq!(volume.component_names, ["DAPI", "GFP"]);
        // 500 nm, 0.5 µm and 0.002 mm.
        assert!(
            volume.geometry.spacing.abs_diff_eq(DVec3::new(500.0, 500.0, 2000.0), 1e-9),
            "{}",
            volume.geometry.spacing
        );
        assert_eq!(volume.unit, Some(Unit::Nanometre));
        assert_eq!(volume.notes.len(), 0, "{:?}", volume.notes);
    }
}

#[test]
fn images_of_an_ome_file_are_series() {
    let error = open("series.ome.tif", &Selection::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("2 series: 0 left 21×17×3, 1 right 12×10×2"), "{error}");
    for (key, dtype, dims) in [("0", "uint8", DIMS), ("1", "uint16", [12, 10, 2]), ("right", "uint16", [12, 10, 2])] {
        let selection = Selection { series: Some(key.to_owned()), ..Selection::default() };
        let volume = open("series.ome.tif", &selection).unwrap();
        assert_eq!(volume.geometry.dims, dims, "{key}");
        assert!(volume.voxels == voxels(dtype, &numbers(dims, 0)), "{key}");
    }
    let selection = Selection { series: Some("1".to_owned()), ..Selection::default() };
    assert!(matches!(open("bits.tif", &selection), Err(VolumeError::NoSuch { .. })), "a file without series");
}

#[test]
fn levels_of_a_pyramid_are_coarser_grids_in_the_same_place() {
    let dims = [32, 24, 3];
    for (level, step) in [(None, 1), (Some(0), 1), (Some(1), 2), (Some(2), 4)] {
        let volume = open("pyramid.ome.tif", &Selection { level, ..component(1) }).unwrap();
        let side = [dims[0] / step, dims[1] / step, dims[2]];
        assert_eq!(volume.geometry.dims, side, "{level:?}");
        let all = numbers(dims, 1);
        let picked: Vec<u64> = (0..side.iter().product())
            .map(|index: usize| {
                let [x, y, z] = [index % side[0], index / side[0] % side[1], index / (side[0] * side[1])];
                all[x * step + dims[0] * (y * step + dims[1] * z)]
            })
            .collect();
        assert!(volume.voxels == voxels("uint8", &picked), "{level:?}");
        // The corners of the voxels agree: half a voxel before the first one.
        let spacing = 0.5 * step as f64;
        assert_eq!(volume.geometry.spacing, DVec3::new(spacing, spacing, 1.0), "{level:?}");
        assert_eq!(volume.geometry.origin, DVec3::new((spacing - 0.5) / 2.0, (spacing - 0.5) / 2.0, 0.0), "{level:?}");
    }
    let error = open("pyramid.ome.tif", &Selection { level: Some(3), ..component(1) }).map(drop).unwrap_err();
    assert!(error.to_string().contains("3 levels: 0 32×24×3, 1 16×12×3, 2 8×6×3"), "{error}");
    let error = open("channels.ome.tif", &Selection { level: Some(1), ..component(1) }).map(drop).unwrap_err();
    assert!(matches!(error, VolumeError::NoSuch { .. }), "{error}");
}

#[test]
fn planes_of_an_ome_file_may_be_in_other_files_of_its_folder() {
    for (name, channel) in [("two_files_1.ome.tif", 0), ("two_files_1.ome.tif", 1), ("two_files_2.ome.tif", 0)] {
        let volume = open(name, &component(channel)).unwrap();
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, channel)), "{name}, channel {channel}");
        assert_eq!(volume.component_names, ["one", "two"]);
        assert!(volume.files.contains(&written(&format!("two_files_{}.ome.tif", channel + 1))), "{:?}", volume.files);
    }
    // The other file is missing, or its name leads out of the folder.
    let bytes = std::fs::read(written("two_files_1.ome.tif")).unwrap();
    let error = volumes::opened("a.ome.tif", &bytes, &component(1)).map(drop).unwrap_err();
    assert!(matches!(error, VolumeError::Open { .. }) && error.to_string().contains("two_files_2"), "{error}");
    assert!(volumes::opened("a.ome.tif", &bytes, &component(0)).is_ok(), "renamed, but its identifier is its own");
    let name = b"two_files_2.ome.tif";
    let at = bytes.windows(name.len()).position(|word| word == name).unwrap();
    let mut bytes = bytes;
    bytes[at..at + name.len()].copy_from_slice(b"../wo_files_2.o.tif");
    let error = volumes::opened("a.ome.tif", &bytes, &component(1)).map(drop).unwrap_err();
    assert!(matches!(error, VolumeError::Outside { .. }), "{error}");
}

// Generated files.

/// Type codes of tags.
const SHORT: u16 = 3;
const LONG: u16 = 4;

/// A little-endian TIFF file that grows at its end.
struct Writer {
    bytes: Vec<u8>,
    /// Position of the offset of the next directory.
    link: usize,
}

/// Tags of a page: code, type, values.
type Tags = Vec<(u16, u16, Vec<u32>)>;

impl Writer {
    fn new() -> Self {
        Self { bytes: b"II*\0\0\0\0\0".to_vec(), link: 4 }
    }

    /// Appends data; returns their offset.
    fn data(&mut self, data: &[u8]) -> u32 {
        let at = self.bytes.len() as u32;
        self.bytes.extend(data);
        at
    }

    fn page(&mut self, mut tags: Tags) -> &mut Self {
        tags.sort_by_key(|(code, ..)| *code);
        let outside: Vec<u32> = tags.iter().map(|(_, kind, values)| self.values(*kind, values)).collect();
        let at = self.bytes.len() as u32;
        self.bytes[self.link..self.link + 4].copy_from_slice(&at.to_le_bytes());
        self.bytes.extend((tags.len() as u16).to_le_bytes());
        for ((code, kind, values), outside) in tags.iter().zip(outside) {
            self.bytes.extend(code.to_le_bytes());
            self.bytes.extend(kind.to_le_bytes());
            self.bytes.extend((values.len() as u32).to_le_bytes());
            self.bytes.extend(outside.to_le_bytes());
        }
        self.link = self.bytes.len();
        self.bytes.extend([0; 4]);
        self
    }

    /// Entry of a directory for these values: the values, or their offset.
    fn values(&mut self, kind: u16, values: &[u32]) -> u32 {
        let size = match kind {
            SHORT => 2,
            LONG => 4,
            _ => 1,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()[..size].to_vec()).collect();
        if bytes.len() > 4 {
            return self.data(&bytes);
        }
        let mut inside = [0; 4];
        inside[..bytes.len()].copy_from_slice(&bytes);
        u32::from_le_bytes(inside)
    }
}

/// Tags of a page of 4 × 3 bytes, which lie at `at`.
fn tags(at: u32) -> Tags {
    vec![
        (256, SHORT, vec![4]),
        (257, SHORT, vec![3]),
        (258, SHORT, vec![8]),
        (259, SHORT, vec![1]),
        (262, SHORT, vec![1]),
        (273, LONG, vec![at]),
        (277, SHORT, vec![1]),
        (278, SHORT, vec![3]),
        (279, LONG, vec![12]),
    ]
}

fn with(mut tags: Tags, changes: &[(u16, u16, &[u32])]) -> Tags {
    for (code, kind, values) in changes {
        tags.retain(|(there, ..)| there != code);
        if !values.is_empty() {
            tags.push((*code, *kind, values.to_vec()));
        }
    }
    tags
}

const TWELVE: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

/// A file with one page of these changed tags.
fn one(changes: &[(u16, u16, &[u32])]) -> Vec<u8> {
    let mut writer = Writer::new();
    let at = writer.data(&TWELVE);
    writer.page(with(tags(at), changes));
    writer.bytes
}

fn read(bytes: &[u8]) -> Result<Volume, VolumeError> {
    volumes::opened("v.tif", bytes, &Selection::default())
}

fn refused(bytes: &[u8], words: &[&str]) {
    volumes::refused(read(bytes), &[&["v.tif"], words].concat());
}

/// A description as the values of its tag.
fn text(text: &str) -> Vec<u32> {
    text.bytes().chain([0]).map(u32::from).collect()
}

#[test]
fn a_generated_file_is_read_by_its_name_and_its_content() {
    for name in ["v.tif", "v.TIFF", "v.btf", "v"] {
        let volume = volumes::opened(name, &one(&[]), &Selection::default()).unwrap();
        assert_eq!((volume.voxels.bytes(), volume.geometry.dims), (&TWELVE[..], [4, 3, 1]), "{name}");
    }
    // Without the number of bytes, and with more strips than the page needs.
    assert_eq!(read(&one(&[(279, LONG, &[])])).unwrap().voxels.bytes(), TWELVE);
    assert_eq!(read(&one(&[(278, LONG, &[u32::MAX])])).unwrap().voxels.bytes(), TWELVE);
}

#[test]
fn small_numbers_of_whole_bits_are_unpacked_row_by_row() {
    for (bits, row, expected) in [
        (4, vec![0x1f, 0x2e], [1, 15, 2, 14]),
        (2, vec![0b11_01_10_00], [3, 1, 2, 0]),
        (1, vec![0b1011_0000], [1, 0, 1, 1]),
    ] {
        let mut writer = Writer::new();
        let at = writer.data(&row.repeat(3));
        let length = 3 * row.len() as u32;
        writer.page(with(tags(at), &[(258, SHORT, &[bits]), (279, LONG, &[length])]));
        let volume = read(&writer.bytes).unwrap();
        assert_eq!(volume.voxels, Voxels::U8(expected.repeat(3)), "{bits} bits");
        assert_eq!(volume.has_labels, bits == 1);
    }
}

#[test]
fn every_refusal_names_the_page_the_tag_and_the_number() {
    for (changes, words) in [
        (&[(258, SHORT, &[12_u32][..])][..], &["page 1, BitsPerSample", "12 bits"][..]),
        (&[(258, SHORT, &[24])], &["24 bits"]),
        (&[(258, SHORT, &[32]), (339, SHORT, &[5])], &["SampleFormat", "complex"]),
        (&[(258, SHORT, &[8]), (339, SHORT, &[3])], &["floats of 8 bits"]),
        (&[(258, SHORT, &[8, 16, 8]), (277, SHORT, &[3])], &["sample 0 has 8", "sample 1 16"]),
        (&[(259, SHORT, &[34712])], &["Compression", "34712 (JPEG 2000)"]),
        (&[(259, SHORT, &[34887])], &["34887 (LERC)"]),
        (&[(259, SHORT, &[50001])], &["50001 (WebP)"]),
        (&[(259, SHORT, &[34933])], &["34933 (PNG)"]),
        (&[(259, SHORT, &[34934])], &["34934 (JPEG XR)"]),
        (&[(259, SHORT, &[4])], &["4 (fax)"]),
        (&[(259, SHORT, &[6])], &["6 (JPEG of TIFF 6.0)"]),
        (&[(259, SHORT, &[99])], &["99 (an unknown one)"]),
        (&[(259, SHORT, &[5]), (317, SHORT, &[7])], &["Predictor", "predictor 7"]),
        (&[(259, SHORT, &[5]), (317, SHORT, &[3])], &["predictor 3", "uint8"]),
        (&[(284, SHORT, &[3])], &["PlanarConfiguration", "3 is not 1 or 2"]),
        (&[(266, SHORT, &[2])], &["FillOrder", "2"]),
        (&[(262, SHORT, &[6]), (277, SHORT, &[3])], &["YCbCr"]),
        (&[(259, SHORT, &[7]), (258, SHORT, &[16])], &["uint16 in JPEG"]),
        (&[(256, SHORT, &[])], &["ImageWidth", "missing"]),
        (&[(257, SHORT, &[0])], &["ImageLength", "the length is 0"]),
        (&[(277, SHORT, &[0])], &["SamplesPerPixel", "0 samples"]),
        (&[(278, SHORT, &[0])], &["RowsPerStrip", "0 rows"]),
        (&[(273, LONG, &[])], &["StripOffsets", "missing"]),
        (&[(279, LONG, &[]), (259, SHORT, &[5])], &["StripByteCounts", "missing"]),
        (&[(278, SHORT, &[1])], &["StripOffsets", "1 values", "3 strips"]),
        (&[(273, LONG, &[100_000])], &["strip 0", "100012", "bytes"]),
        (&[(279, LONG, &[11])], &["strip 0", "11 bytes", "12 bytes"]),
        (&[(256, LONG, &[60_000]), (257, LONG, &[60_000]), (278, LONG, &[60_000])], &["3600000000"]),
        (
            &[(256, LONG, &[60_000]), (257, LONG, &[60_000]), (278, LONG, &[60_000]), (259, SHORT, &[5])],
            &["3600000000", "LZW", "4096"],
        ),
        (
            &[(256, LONG, &[u32::MAX]), (257, LONG, &[u32::MAX]), (277, SHORT, &[65535])],
            &["4294967295×4294967295×65535"],
        ),
        (&[(322, SHORT, &[16]), (323, SHORT, &[0])], &["TileLength", "0"]),
        (&[(254, SHORT, &[1])], &["all 1 pages", "smaller copies"]),
        (&[(259, SHORT, &[8])], &["page 1, strip 0", "damaged deflate"]),
        (&[(259, SHORT, &[50000])], &["page 1, strip 0", "damaged zstd"]),
        (&[(259, SHORT, &[7])], &["page 1, strip 0", "damaged JPEG"]),
        (&[(259, SHORT, &[32773])], &["page 1, strip 0", "bytes of voxels", "12"]),
    ] {
        let bytes = one(changes);
        let error = read(&bytes).map(|volume| volume.voxels).unwrap_err();
        let message = volumes::whole_message(&error);
        assert!(words.iter().all(|word| message.contains(word)), "{changes:?}: {message} should have {words:?}");
        refused(&bytes, words);
    }
}

#[test]
fn pages_of_two_sizes_or_types_are_refused_and_a_circle_ends() {
    for (change, words) in [
        ((257, SHORT, &[2_u32][..]), ["page 3", "4×2 voxels of uint8", "page 1 has 4×3"]),
        ((258, SHORT, &[4][..]), ["page 3", "4 bits", "uint8"]),
        ((339, SHORT, &[2][..]), ["page 3", "int8", "uint8"]),
    ] {
        let mut writer = Writer::new();
        let at = writer.data(&TWELVE);
        writer.page(tags(at)).page(tags(at)).page(with(tags(at), &[change]));
        refused(&writer.bytes, &words);
    }
    let mut writer = Writer::new();
    let at = writer.data(&TWELVE);
    writer.page(tags(at)).page(tags(at));
    let first = u32::from_le_bytes(writer.bytes[4..8].try_into().unwrap());
    writer.bytes[writer.link..writer.link + 4].copy_from_slice(&first.to_le_bytes());
    refused(&writer.bytes, &["page 3", &format!("byte {first}"), "earlier page"]);
    let end = writer.bytes.len() as u32;
    writer.bytes[writer.link..writer.link + 4].copy_from_slice(&(end - 1).to_le_bytes());
    refused(&writer.bytes, &["page 3", &format!("only {end} bytes")]);
    refused(b"II*\0\0\0\0\0", &["no page"]);
    refused(b"II*\0", &["4 bytes are no TIFF header"]);
    refused(b"II+\0\x04\0\0\0\x10\0\0\0\0\0\0\0", &["offsets of 4 bytes"]);
}

#[test]
fn voxels_that_many_pages_share_are_no_reason_for_memory() {
    // 1000 pages of the same strip.
    let mut writer = Writer::new();
    let at = writer.data(&vec![7; 3 << 14]);
    for _ in 0..1000 {
        writer.page(with(tags(at), &[(256, SHORT, &[1 << 14]), (279, LONG, &[3 << 14])]));
    }
    refused(&writer.bytes, &["49152000", &writer.bytes.len().to_string()]);
}

#[test]
fn imagej_scales_values_and_states_its_window_in_stored_numbers() {
    let description =
        "ImageJ=1.54f\nimages=1\nunit=mm\ncf=0\nc0=-32768.0\nc1=2.0\nvunit=HU\nmin=100.0\nmax=300.0\nInfo=a \t b\n";
    let volume = read(&one(&[(270, 2, &text(description))])).unwrap();
    assert_eq!(volume.value([0, 0, 0]), Some(1.0 * 2.0 - 32768.0));
    let window = Window::new("window of the file", 100.0 * 2.0 - 32768.0, 300.0 * 2.0 - 32768.0);
    assert_eq!(volume.presets.windows, window.into_iter().collect::<Vec<_>>());
    assert_eq!(volume.metadata, [("Info".to_owned(), "a   b".to_owned())]);
    let optical = read(&one(&[(270, 2, &text("ImageJ=1.54f\ncf=21\n"))])).unwrap();
    assert!(optical.notes.iter().any(|note| note.contains("calibration function 21")), "{:?}", optical.notes);
    let latin: Vec<u32> = b"ImageJ=1.54f\nunit=\xb5m\nspacing=-3\n".iter().map(|&byte| u32::from(byte)).collect();
    let volume = read(&one(&[(270, 2, &latin)])).unwrap();
    assert_eq!((volume.unit, volume.geometry.spacing.z), (Some(Unit::Micrometre), 3.0));
}

#[test]
fn colour_maps_of_imagej_are_colours_of_channels() {
    // Two channels, green and grey: all reds, all greens, all blues.
    let map = |[red, green, blue]: [u8; 3]| {
        [red, green, blue].iter().flat_map(|&most| (0..=255_u8).map(move |it| u32::from(it.min(most)))).collect()
    };
    let (green, grey): (Vec<u32>, Vec<u32>) = (map([0, 255, 16]), map([255, 255, 255]));
    let mut own = text("IJIJstul");
    own.pop();
    own.extend([2, 0, 0, 0]);
    own.extend(green);
    own.extend(grey);
    let mut writer = Writer::new();
    let at = writer.data(&TWELVE);
    let description = text("ImageJ=1.54f\nimages=2\nchannels=2\nmode=composite\n");
    let lengths: [u32; 3] = [12, 768, 768];
    writer.page(with(tags(at), &[(270, 2, &description), (50838, LONG, &lengths), (50839, 1, &own)])).page(tags(at));
    let open = |channel| volumes::opened("v.tif", &writer.bytes, &component(channel)).unwrap();
    let colours = [0, 1].map(|channel| open(channel).presets.colour);
    assert_eq!(colours, [Some([0.0, 1.0, 16.0 / 255.0]), None], "grey is no colour");
    let stated = ("colour of channel 0".to_owned(), "#00ff10".to_owned());
    assert!(open(0).metadata.contains(&stated), "{:?}", open(0).metadata);
}

#[test]
fn imagej_images_that_are_not_in_the_file_are_refused() {
    let of = |description: &str, more: &[u8]| {
        let mut writer = Writer::new();
        let at = writer.data(&[&TWELVE[..], more].concat());
        writer.page(with(tags(at), &[(270, 2, &text(description))]));
        read(&writer.bytes)
    };
    let volume = of("ImageJ=1\nimages=2\nslices=2\n", &TWELVE).unwrap();
    assert_eq!((volume.geometry.dims, volume.voxels.bytes()), ([4, 3, 2], &TWELVE.repeat(2)[..]));
    volumes::refused(of("ImageJ=1\nimages=2000\n", &TWELVE), &["24000"]);
    volumes::refused(of("ImageJ=1\nimages=2000000000\n", &TWELVE), &["2000000000 images", "1000000"]);
    volumes::refused(of("ImageJ=1\nimages=18446744073709551615\n", &TWELVE), &["18446744073709551615 images"]);
}

#[test]
fn descriptions_of_ome_that_contradict_the_pages_are_refused() {
    let pixels = |attributes: &str, inside: &str| {
        format!(
            "<OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\"><Image><Pixels {attributes}>{inside}</Pixels></Image></OME>"
        )
    };
    for (attributes, inside, words) in [
        ("SizeX=\"4\" SizeY=\"3\" SizeZ=\"2\" SizeC=\"1\" SizeT=\"1\"", "", &["page 2", "1 pages"][..]),
        ("SizeX=\"5\" SizeY=\"3\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"1\"", "", &["5×3", "4×3"]),
        ("SizeX=\"4\" SizeY=\"3\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"1\" DimensionOrder=\"ZXY\"", "", &["\"ZXY\""]),
        ("SizeX=\"4\" SizeY=\"3\" SizeC=\"1\" SizeT=\"1\"", "", &["SizeZ is missing"]),
        ("SizeX=\"4\" SizeY=\"3\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"1\"", "<TiffData IFD=\"8\"/>", &["page 9"]),
        (
            "SizeX=\"4\" SizeY=\"3\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"1\"",
            "<TiffData><UUID>urn:uuid:7</UUID></TiffData>",
            &["urn:uuid:7", "name is not stated"],
        ),
    ] {
        let description = text(&pixels(attributes, inside));
        refused(&one(&[(270, 2, &description)]), &[&["OME-XML"], words].concat());
    }
    let sound = pixels("SizeX=\"4\" SizeY=\"3\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"1\"", "<TiffData/>");
    assert_eq!(read(&one(&[(270, 2, &text(&sound))])).unwrap().voxels.bytes(), TWELVE);
}

#[test]
fn only_the_chosen_channel_is_decoded() {
    // The strips of the second channel are damaged; they are the last ones.
    let mut bytes = std::fs::read(written("channels.ome.tif")).unwrap();
    let sound = open("channels.ome.tif", &component(0)).unwrap();
    let zlib: Vec<usize> = (0..bytes.len() - 1).filter(|&at| bytes[at] == 0x78 && bytes[at + 1] == 0x9c).collect();
    assert_eq!(zlib.len(), 6, "three slices of two channels: {zlib:?}");
    for &at in &zlib[3..] {
        bytes[at + 8..at + 40].fill(0xff);
    }
    let first = volumes::opened("v.ome.tif", &bytes, &component(0)).unwrap();
    assert!(first.voxels == sound.voxels, "the first channel is whole");
    let error = volumes::opened("v.ome.tif", &bytes, &component(1)).map(drop).unwrap_err();
    assert!(matches!(error, VolumeError::DamagedPart { .. }), "{error}");
}

/// Counts the reports, and cancels after a number of them.
#[derive(Default)]
struct Watch {
    reports: std::sync::Mutex<Vec<(u64, u64)>>,
    patience: Option<usize>,
}

impl Progress for Watch {
    fn report(&self, stage: &str, done: u64, total: u64) {
        assert!(stage.starts_with("reading "), "{stage}");
        self.reports.lock().unwrap().push((done, total));
    }

    fn cancelled(&self) -> bool {
        self.patience.is_some_and(|patience| self.reports.lock().unwrap().len() >= patience)
    }
}

/// A stack of `ImageJ` of more than 4 GiB: one directory, and 4200 frames of 1024 × 1024 bytes, of which frame 4150 has the
/// number 7 in its first voxel. The rest is a hole in the file.
fn large_stack(folder: &Path) -> PathBuf {
    use std::io::{Seek as _, SeekFrom, Write as _};
    let path = folder.join("large.tif");
    let description = text("ImageJ=1.54f\nimages=4200\nframes=4200\n");
    let mut writer = Writer::new();
    let sides: [(u16, u16, &[u32]); 5] = [
        (256, LONG, &[1024]),
        (257, LONG, &[1024]),
        (278, LONG, &[1024]),
        (279, LONG, &[1 << 20]),
        (270, 2, &description),
    ];
    writer.page(with(tags(1000), &sides));
    let mut file = std::fs::File::create(&path).unwrap();
    file.write_all(&writer.bytes).unwrap();
    file.set_len(1000 + (4200 << 20)).unwrap();
    file.seek(SeekFrom::Start(1000 + (4150 << 20))).unwrap();
    file.write_all(&[7]).unwrap();
    path
}

#[test]
fn frames_of_imagej_beyond_four_gibibytes_follow_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let path = large_stack(folder.path());
    for (time, first) in [(4149, 0.0), (4150, 7.0), (4151, 0.0)] {
        let selection = Selection { time: Some(time), ..Selection::default() };
        let volume = volume::open(&path, &selection, &Quiet).unwrap();
        assert_eq!((volume.geometry.dims, volume.value([0, 0, 0])), ([1024, 1024, 1], Some(first)), "frame {time}");
    }
    let error =
        volume::open(&path, &Selection { time: Some(4200), ..Selection::default() }, &Quiet).map(drop).unwrap_err();
    assert!(error.to_string().contains("4200 time steps"), "{error}");
}

#[test]
fn progress_counts_bytes_and_a_cancelled_reading_ends() {
    // 40 pages of 1 MiB that share their strip would be more than the file has, so that each has its own.
    let mut writer = Writer::new();
    for page in 0..40 {
        let at = writer.data(&vec![page; 1 << 20]);
        writer.page(with(
            tags(at),
            &[
                (256, LONG, &[1024]),
                (257, LONG, &[1024]),
                (278, LONG, &[16]),
                (273, LONG, &strips(at)),
                (279, LONG, &[1 << 14; 64]),
            ],
        ));
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.tif");
    std::fs::write(&path, &writer.bytes).unwrap();
    let watch = Watch::default();
    let volume = volume::open(&path, &Selection::default(), &watch).unwrap();
    assert!(
        volume.voxels.bytes().chunks(1 << 20).zip(0..).all(|(page, number)| page.iter().all(|&byte| byte == number))
    );
    let reports = watch.reports.into_inner().unwrap();
    assert!(
        reports.len() >= 10 && reports.iter().all(|&(done, total)| done <= total && total == 40 << 20),
        "{reports:?}"
    );
    assert!(reports.contains(&(40 << 20, 40 << 20)), "the end is reported");
    for patience in [0, 2] {
        let watch = Watch { patience: Some(patience), ..Watch::default() };
        let error = volume::open(&path, &Selection::default(), &watch).map(drop).unwrap_err();
        assert!(matches!(error, VolumeError::Cancelled { .. }), "{error}");
        // Each thread finishes its strip.
        assert!(watch.reports.into_inner().unwrap().len() <= patience + rayon::current_num_threads());
    }
}

/// Offsets of the 64 strips of a page.
fn strips(at: u32) -> Vec<u32> {
    (0..64).map(|strip| at + (strip << 14)).collect()
}

// Folders of slices.

fn open_folder(files: &[(&str, Vec<u8>)], selection: &Selection) -> Result<Volume, VolumeError> {
    volume::open(volumes::folder(files).path(), selection, &Quiet)
}

/// A PNG of 4 × 3 pixels with these rows.
fn png(colour: png::ColorType, depth: png::BitDepth, rows: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 4, 3);
    encoder.set_color(colour);
    encoder.set_depth(depth);
    if colour == png::ColorType::Indexed {
        encoder.set_palette([9, 8, 7].repeat(16));
    }
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(rows).unwrap();
    writer.finish().unwrap();
    bytes
}

fn grey_png(first: u8) -> Vec<u8> {
    png(png::ColorType::Grayscale, png::BitDepth::Eight, &TWELVE.map(|byte| byte + first))
}

/// A PGM of 4 × 3 pixels.
fn pgm(first: u8) -> Vec<u8> {
    [&b"P5\n# slice\n4 3\n255\n"[..], &TWELVE.map(|byte| byte + first)].concat()
}

/// Slices of `TWELVE` and multiples of 20 more.
fn stack(slices: u8) -> Vec<u8> {
    (0..slices).flat_map(|slice| TWELVE.map(|byte| byte + 20 * slice)).collect()
}

#[test]
fn slices_are_in_the_order_of_the_numbers_in_their_names() {
    let tiff = |first: u8| {
        let mut writer = Writer::new();
        let at = writer.data(&TWELVE.map(|byte| byte + first));
        writer.page(tags(at));
        writer.bytes
    };
    for make in [grey_png, pgm, tiff] {
        let extension = ["png", "pgm", "tif"]
            [[grey_png as fn(u8) -> Vec<u8>, pgm, tiff].iter().position(|it| it(0) == make(0)).unwrap()];
        let names = ["s9", "s10", "s100", "s011"].map(|name| format!("{name}.{extension}"));
        let [a, b, c, d] = names.each_ref().map(String::as_str);
        let volume =
            open_folder(&[(c, make(60)), (a, make(0)), (b, make(20)), (d, make(40))], &Selection::default()).unwrap();
        assert_eq!((volume.geometry.dims, volume.voxels.bytes()), ([4, 3, 4], &stack(4)[..]), "{extension}");
        assert_eq!((volume.geometry.spacing, volume.unit), (DVec3::ONE, None));
        assert!(volume.notes[0].contains("no spacing"), "{:?}", volume.notes);
        let gap = "88 slices may be missing between s011";
        assert!(volume.notes[1].contains(gap) && volume.notes[1].contains("s100"), "{:?}", volume.notes);
    }
}

#[test]
fn a_folder_of_several_runs_asks_which_and_says_what_it_leaves_out() {
    let files = [
        ("a1.png", grey_png(0)),
        ("a2.png", grey_png(20)),
        ("b/c0_z1.pgm", pgm(0)),
        ("b/c0_z2.pgm", pgm(20)),
        ("b/c1_z1.pgm", pgm(40)),
        ("b/c1_z2.pgm", pgm(60)),
        ("projection.png", grey_png(0)),
        ("notes.txt", b"words".to_vec()),
    ];
    let error = open_folder(&files, &Selection::default()).map(drop).unwrap_err();
    let there = "3 series: 0 a#.png 4×3×2, 1 b/c0_z#.pgm 4×3×2, 2 b/c1_z#.pgm 4×3×2";
    assert!(error.to_string().contains(there), "{error}");
    for (series, first) in [("0", 0), ("2", 40), ("b/c1_z#.pgm", 40)] {
        let selection = Selection { series: Some(series.to_owned()), ..Selection::default() };
        let volume = open_folder(&files, &selection).unwrap();
        let expected: Vec<u8> = stack(2).iter().map(|byte| byte + first).collect();
        assert_eq!(volume.voxels.bytes(), expected, "{series}");
    }
    let alone = [
        ("a1.png", grey_png(0)),
        ("a3.png", grey_png(20)),
        ("a5.png", grey_png(40)),
        ("projection.png", grey_png(0)),
        ("notes.txt", Vec::new()),
    ];
    let volume = open_folder(&alone, &Selection::default()).unwrap();
    assert_eq!(volume.voxels.bytes(), stack(3), "even steps are no gaps");
    assert_eq!(volume.notes.len(), 2, "{:?}", volume.notes);
    assert!(volume.notes[1].contains("2 files are of another format"), "{:?}", volume.notes);
    let volume = open_folder(&[("only.png", grey_png(0))], &Selection::default()).unwrap();
    assert_eq!(volume.geometry.dims, [4, 3, 1]);
    let error = open_folder(&[("preview.png", grey_png(0)), ("data.bin", vec![0])], &Selection::default()).map(drop);
    assert!(matches!(error, Err(VolumeError::UnknownFormat { .. })), "a picture beside other files is no volume");
}

#[test]
fn numbers_of_slices_stay_as_stored() {
    use png::{BitDepth, ColorType};
    let first = |bytes: Vec<u8>, name: &str| open_folder(&[(name, bytes)], &Selection::default()).unwrap();
    let indices = first(png(ColorType::Indexed, BitDepth::Four, &[0x1f, 0x2e, 0x30, 0x4c, 0x56, 0x78]), "a.png");
    assert_eq!(indices.voxels, Voxels::U8(vec![1, 15, 2, 14, 3, 0, 4, 12, 5, 6, 7, 8]));
    assert!(indices.notes.iter().any(|note| note.contains("colour map")), "{:?}", indices.notes);
    let bits = first(png(ColorType::Grayscale, BitDepth::One, &[0b1011_0000, 0b0100_0000, 0b1111_0000]), "a.png");
    assert_eq!(bits.voxels, Voxels::U8(vec![1, 0, 1, 1, 0, 1, 0, 0, 1, 1, 1, 1]));
    assert!(bits.has_labels, "one bit");
    let wide: Vec<u8> = (0..12_u16).flat_map(|n| (n * 5000).to_be_bytes()).collect();
    let expected = Voxels::U16((0..12).map(|n| n * 5000).collect());
    assert_eq!(first(png(ColorType::Grayscale, BitDepth::Sixteen, &wide), "a.png").voxels, expected);
    // PNM with another maximum than that of its type, and bits of which 1 is black.
    for most in [60000, 65535] {
        let bytes = [format!("P5 4 3 {most}\n").as_bytes(), &wide].concat();
        assert_eq!(first(bytes, "a.pgm").voxels, expected, "{most}");
    }
    let text = first(b"P2\n4 3\n15\n1 2 3 4\n5 6 7 8\n9 10 11 12\n".to_vec(), "a.pgm");
    assert_eq!(text.voxels.bytes(), TWELVE);
    let bits = first(b"P1\n4 3\n1 0 1 1\n0 1 0 0\n1 1 1 1\n".to_vec(), "a.pbm");
    assert_eq!((bits.voxels.bytes(), bits.has_labels), (&[1, 0, 1, 1, 0, 1, 0, 0, 1, 1, 1, 1][..], true));
}

/// A BMP of 4 × 3 pixels of 8 bits, whose map has `colours`; rows from the bottom up.
fn bmp(colours: impl Iterator<Item = [u8; 3]>) -> Vec<u8> {
    let map: Vec<u8> = colours.flat_map(|[red, green, blue]| [blue, green, red, 0]).collect();
    let at = 54 + map.len() as u32;
    let mut bytes = b"BM".to_vec();
    bytes.extend((at + 12).to_le_bytes());
    bytes.extend([0; 4]);
    bytes.extend(at.to_le_bytes());
    for number in [40_u32, 4, 3, 1 | 8 << 16, 0, 12, 0, 0, map.len() as u32 / 4, 0] {
        bytes.extend(number.to_le_bytes());
    }
    bytes.extend(map);
    bytes.extend(TWELVE.chunks(4).rev().flatten());
    bytes
}

#[test]
fn grey_and_coloured_maps_of_bmp_give_the_same_numbers() {
    let open = |bytes| open_folder(&[("a.bmp", bytes)], &Selection::default()).unwrap();
    let grey = open(bmp((0..=255).map(|grey| [grey; 3])));
    assert_eq!((grey.voxels.bytes(), grey.components), (&TWELVE[..], 1));
    assert_eq!(grey.notes.len(), 1, "{:?}", grey.notes);
    let coloured = open(bmp((0..=255).map(|red| [red, 0, 9])));
    assert_eq!((coloured.voxels.bytes(), coloured.components), (&TWELVE[..], 1));
    assert!(coloured.notes[1].contains("colour map"), "{:?}", coloured.notes);
}

#[test]
fn colours_of_slices_are_components() {
    let rgb: Vec<u8> = TWELVE.iter().flat_map(|&byte| [byte, 100 + byte, 200 - byte]).collect();
    let files = [("a1.png", png(png::ColorType::Rgb, png::BitDepth::Eight, &rgb))];
    let error = open_folder(&files, &Selection::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("3 components per voxel (RGB)"), "{error}");
    for (index, expected) in [TWELVE, TWELVE.map(|byte| 100 + byte), TWELVE.map(|byte| 200 - byte)].iter().enumerate() {
        let volume = open_folder(&files, &component(index)).unwrap();
        assert_eq!((volume.voxels.bytes(), volume.components), (&expected[..], 3));
    }
    // A grey JPEG of one colour, whose numbers are exact.
    let mut jpeg = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut jpeg, 100)
        .encode(&[128; 12], 4, 3, image::ExtendedColorType::L8)
        .unwrap();
    let volume = open_folder(&[("s1.jpg", jpeg.clone()), ("s2.jpg", jpeg)], &Selection::default()).unwrap();
    assert_eq!((volume.voxels.bytes(), volume.geometry.dims), (&[128; 24][..], [4, 3, 2]));
}

#[test]
fn slices_that_differ_or_are_damaged_are_refused_by_name() {
    let refuse =
        |files: &[(&str, Vec<u8>)], words: &[&str]| volumes::refused(open_folder(files, &Selection::default()), words);
    let wide = png(png::ColorType::Grayscale, png::BitDepth::Sixteen, &[0; 24]);
    refuse(
        &[("s1.png", grey_png(0)), ("s2.png", grey_png(0)), ("s3.png", wide)],
        &["s3.png", "uint16", "s1.png has 4×3 voxels of uint8"],
    );
    let small = [&b"P5\n4 2\n255\n"[..], &[0; 8]].concat();
    refuse(&[("s1.pgm", pgm(0)), ("s2.pgm", small)], &["s2.pgm", "4×2", "4×3"]);
    refuse(&[("s1.png", grey_png(0)), ("s2.png", grey_png(0)[..50].to_vec())], &["s2.png", "damaged PNG"]);
    refuse(&[("s1.pgm", pgm(0)[..20].to_vec())], &["s1.pgm", "damaged PNM"]);
    refuse(&[("s1.png", b"words".to_vec())], &["s1.png", "not PNG, JPEG, BMP or PNM"]);
    refuse(&[("s1.pgm", b"P5 60000 60000 255\n\0".to_vec())], &["s1.pgm", "3600000000", "PNM"]);
    let mut pages = Writer::new();
    let at = pages.data(&TWELVE);
    pages.page(tags(at)).page(tags(at));
    refuse(&[("s1.tif", pages.bytes)], &["s1.tif", "has 2", "open the file by itself"]);
    let many: Vec<(String, Vec<u8>)> = (0..70)
        .flat_map(|run| {
            let letters = format!("{}{}", char::from(b'a' + run / 26), char::from(b'a' + run % 26));
            [1, 2].map(|number| (format!("{letters}{number}.pgm"), pgm(0)))
        })
        .collect();
    let many: Vec<(&str, Vec<u8>)> = many.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
    refuse(&many, &["70 runs of slices"]);
    let twice = open_folder(&[("s1.pgm", pgm(0)), ("s01.pgm", pgm(20))], &Selection::default()).unwrap();
    assert!(twice.notes.iter().any(|note| note.contains("same number")), "{:?}", twice.notes);
}

#[test]
fn a_metaimage_header_places_slices_of_pictures() {
    let header = |dims: &str, kind: &str| {
        format!("NDims = 3\nDimSize = {dims}\nElementSpacing = 1 2 3\nElementType = {kind}\nElementDataFile = s%d.png 9 10 1\n").into_bytes()
    };
    let open = |dims: &str, kind: &str| {
        let files =
            volumes::folder(&[("s9.png", grey_png(0)), ("s10.png", grey_png(20)), ("v.mhd", header(dims, kind))]);
        volume::open(&files.path().join("v.mhd"), &Selection::default(), &Quiet)
    };
    let volume = open("4 3 2", "MET_UCHAR").unwrap();
    assert_eq!((volume.voxels.bytes(), volume.geometry.spacing), (&stack(2)[..], DVec3::new(1.0, 2.0, 3.0)));
    volumes::refused(open("5 3 2", "MET_UCHAR"), &["v.mhd", "5×3×2", "4×3 voxels of uint8"]);
    volumes::refused(open("4 3 2", "MET_SHORT"), &["v.mhd", "int16", "uint8"]);
}

/// A page of 4 × 3 bytes, `TWELVE` and `first` more, with this description.
fn described(first: u8, description: &str) -> Vec<u8> {
    let mut writer = Writer::new();
    let at = writer.data(&TWELVE.map(|byte| byte + first));
    writer.page(with(tags(at), &[(270, 2, &text(description))]));
    writer.bytes
}

#[test]
fn planes_in_files_are_in_the_order_of_their_companion_file() {
    // Slices of two channels: file `names[i]` has plane i, z fastest, and the names are in another order.
    let names = ["q.ome.tif", "b.ome.tif", "x.ome.tif", "a.ome.tif", "m.ome.tif", "c.ome.tif"];
    let runs: String = (0..6)
        .map(|plane| {
            format!(
                "<TiffData FirstZ=\"{}\" FirstC=\"{}\" IFD=\"0\" PlaneCount=\"1\"><UUID FileName=\"{}\">urn:uuid:{plane}</UUID></TiffData>",
                plane % 3,
                plane / 3,
                names[plane]
            )
        })
        .collect();
    let xml = |inside: &str| {
        format!(
            "<?xml version=\"1.0\"?><OME UUID=\"urn:uuid:all\"><Image><Pixels DimensionOrder=\"XYZCT\" SizeX=\"4\" SizeY=\"3\" \
             SizeZ=\"3\" SizeC=\"2\" SizeT=\"1\" Type=\"uint8\" PhysicalSizeX=\"0.5\" PhysicalSizeY=\"0.5\" \
             PhysicalSizeZ=\"1.25\">{inside}</Pixels></Image></OME>"
        )
    };
    let only = "<OME UUID=\"urn:uuid:0\"><BinaryOnly MetadataFile=\"all.companion.ome\" UUID=\"urn:uuid:all\"/></OME>";
    let plane = |index: usize, description: &str| (names[index], described(20 * index as u8, description));
    let mut files: Vec<(&str, Vec<u8>)> = (0..6).map(|index| plane(index, only)).collect();
    files.push(("all.companion.ome", xml(&runs).into_bytes()));
    files.push(("words.txt", b"words".to_vec()));
    let folder = volumes::folder(&files);
    for name in ["all.companion.ome", "a.ome.tif", "x.ome.tif", ""] {
        for channel in [0, 1] {
            let volume = volume::open(&folder.path().join(name), &component(channel), &Quiet).unwrap();
            let first = 60 * channel as u8;
            let expected: Vec<u8> = stack(3).iter().map(|byte| byte + first).collect();
            assert_eq!((volume.geometry.dims, volume.voxels.bytes()), ([4, 3, 3], &expected[..]), "{name:?} {channel}");
            assert_eq!(volume.geometry.spacing, DVec3::new(0.5, 0.5, 1.25), "{name:?}");
            assert_eq!((volume.unit, volume.components), (Some(Unit::Micrometre), 2), "{name:?}");
            let skipped = volume.notes.iter().any(|note| note.contains("words.txt is of another format"));
            assert_eq!(skipped, name.is_empty(), "{:?}", volume.notes);
        }
    }
    // Every file has the whole description, and no companion file.
    let whole: Vec<(&str, Vec<u8>)> = (0..6).map(|index| plane(index, &xml(&runs))).collect();
    let folder = volumes::folder(&whole);
    let volume = volume::open(folder.path(), &component(0), &Quiet).unwrap();
    assert_eq!(volume.voxels.bytes(), stack(3), "a folder");
    // The companion file is missing, a plane is, or the description names no file.
    let lonely = volumes::folder(&files[..1]);
    volumes::refused(
        volume::open(&lonely.path().join(names[0]), &component(0), &Quiet),
        &[names[0], "all.companion.ome", "is missing"],
    );
    let cut = volumes::folder(&[files[0].clone(), files[6].clone()]);
    let error = volume::open(&cut.path().join("all.companion.ome"), &component(0), &Quiet).map(drop).unwrap_err();
    assert!(matches!(&error, VolumeError::Open { path, .. } if path.ends_with(names[1])), "{error}");
    let bare = volumes::opened("bare.companion.ome", xml("<TiffData/>").as_bytes(), &component(0));
    volumes::refused(bare, &["bare.companion.ome", "names no file that has the planes"]);
}

#[test]
fn pictures_without_numbers_in_their_names_are_slices_in_the_order_of_the_names() {
    let names = ["c.png", "B.png", "aa.png", "d-2x.png"];
    let files: Vec<(&str, Vec<u8>)> =
        [40, 20, 0, 60].iter().zip(names).map(|(&first, name)| (name, grey_png(first))).collect();
    let volume = open_folder(&files, &Selection::default()).unwrap();
    assert_eq!((volume.geometry.dims, volume.voxels.bytes()), ([4, 3, 4], &stack(4)[..]));
    let note = volume.notes.iter().find(|note| note.contains("have no numbers")).unwrap();
    assert!(note.contains("aa.png to d-2x.png"), "{note}");
    // Of two sizes, beside a volume, or alone, they are no slices.
    let wide = png(png::ColorType::Rgb, png::BitDepth::Eight, &[0; 36]);
    let error = open_folder(&[files[0].clone(), ("e.png", wide)], &Selection::default()).map(drop).unwrap_err();
    assert!(
        error.to_string().contains("2 pictures") && error.to_string().contains("numbers in their names"),
        "{error}"
    );
    let beside = [files[0].clone(), files[1].clone(), ("v.nrrd", b"NRRD0005\n".to_vec())];
    let error = open_folder(&beside, &Selection::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("folder with volumes") && error.to_string().contains("v.nrrd"), "{error}");
}
