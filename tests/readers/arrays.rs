//! Arrays in chunks: Zarr, OME-Zarr, HDF5, `NetCDF`. Files of the shared folder, and files written by independent libraries
//! (`tests/tools/make_zarr.py`, `tests/tools/make_hdf5.py`); invalid files.
#![expect(clippy::cast_possible_truncation, reason = "numbers are made to fit their types")]
#![expect(clippy::cast_precision_loss, reason = "numbers are small")]
#![expect(clippy::cast_possible_wrap, trivial_numeric_casts, reason = "one macro for all types")]

use crate::support::volumes;

use std::path::{Path, PathBuf};

use glam::DVec3;
use relume::progress::Quiet;
use relume::volume::{self, LabelPreset, Selection, Unit, Volume, VolumeError, Voxels, Window};
use serde_json::Value;
use volumes::{refused, unbundled};

/// Voxels along x, y and z of the files of `make_zarr.py`.
const DIMS: [usize; 3] = [9, 10, 7];

/// n of every voxel, x fastest, of every `step`-th voxel along each axis.
fn numbers([nx, ny, nz]: [usize; 3], step: usize, channel: usize, time: usize) -> Vec<u64> {
    let n = |index: usize| {
        let [x, y, z] = [index % nx, index / nx % ny, index / (nx * ny)].map(|index| index * step);
        (x * x + 7 * y + 40 * z + 300 * channel + 1000 * time) as u64
    };
    (0..nx * ny * nz).map(n).collect()
}

/// The voxels of these numbers in a type; see `numbers` of `tests/tools/arrays.py`.
fn voxels(dtype: &str, numbers: &[u64]) -> Voxels {
    macro_rules! of {
        ($variant:ident $type:ident, $map:expr) => {
            Voxels::$variant(numbers.iter().map(|&n| $map(n) as $type).collect())
        };
    }
    match dtype {
        "bool" => of!(U8 u8, |n| u64::from(n % 3 == 0)),
        "uint8" => of!(U8 u8, |n| n % 251),
        "int8" => of!(I8 i8, |n| n % 251),
        "uint16" => of!(U16 u16, |n| n),
        "int16" => of!(I16 i16, |n| n),
        "uint32" => of!(U32 u32, |n| n),
        "int32" => of!(I32 i32, |n| n),
        "uint64" => of!(U64 u64, |n| n),
        "int64" => of!(I64 i64, |n| n),
        // Read as floats of 32 bits.
        "float16" | "float32" => of!(F32 f32, |n| n as f32 / 8.0),
        "float64" => of!(F64 f64, |n| n as f64 / 8.0),
        other => panic!("{other} is no type"),
    }
}

/// A Zarr store.
struct Store(tempfile::TempDir);

impl Store {
    /// The store of a bundle in `tests/data/zarr`.
    fn written(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/zarr/{name}.bundle"));
        let files = unbundled(&std::fs::read(path).unwrap());
        let files: Vec<(&str, Vec<u8>)> = files.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
        Self(volumes::folder(&files))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn with(self, name: &str, bytes: &[u8]) -> Self {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
        self
    }

    /// Replaces a part of a file of metadata.
    fn changed(self, name: &str, from: &str, to: &str) -> Self {
        let text = std::fs::read_to_string(self.path(name)).unwrap();
        assert!(text.contains(from), "{from} is not in {text}");
        self.with(name, text.replacen(from, to, 1).as_bytes())
    }

    fn select(&self, selection: &Selection) -> Result<Volume, VolumeError> {
        volume::open(self.0.path(), selection, &Quiet)
    }

    fn open(&self) -> Result<Volume, VolumeError> {
        self.select(&Selection::default())
    }
}

fn component(index: usize) -> Selection {
    Selection { component: Some(index), ..Selection::default() }
}

// Zarr.

#[test]
fn every_shared_zarr_store_reads_as_an_independent_reader_found_it() {
    let Some(folder) = volumes::shared() else { return };
    let open = |name: &str, selection: &Selection| volume::open(&folder.join(name), selection, &Quiet);
    let is_ours = |name: &str| name.starts_with("zarr/") && name != "zarr/czyx_v2.zarr";
    assert!(volumes::check_all(&folder, is_ours, open) >= 3);
    // Channels are components here.
    let json: Value = serde_json::from_str(&std::fs::read_to_string(folder.join("expected.json")).unwrap()).unwrap();
    let expected = &json["files"]["zarr/czyx_v2.zarr"];
    let channels = [0, 1].map(|channel| open("zarr/czyx_v2.zarr", &component(channel)).unwrap());
    let [nuclei, membrane] = &channels;
    let bytes = [nuclei.voxels.bytes(), membrane.voxels.bytes()].concat();
    assert_eq!(volumes::hex(&bytes), expected["decoded_sha256"].as_str().unwrap());
    assert_eq!((nuclei.geometry.spacing, nuclei.unit), (DVec3::new(0.2, 0.2, 0.6), Some(Unit::Micrometre)));
    assert_eq!(nuclei.component_names, ["nuclei", "membrane"]);
    let window = |name: &str| vec![Window::new(name, 0.0, 4000.0).unwrap()];
    assert_eq!(nuclei.presets.windows, window("nuclei"));
    assert_eq!(membrane.presets.windows, window("membrane"));
    let error = open("zarr/czyx_v2.zarr", &Selection::default());
    refused(error, &["2 components per voxel (nuclei, membrane)", "choose a component"]);
    // A level of the pyramid, by its number and by its path.
    for (number, dims) in [(1, [22, 23, 13]), (2, [11, 12, 7])] {
        let selection = Selection { level: Some(number), ..Selection::default() };
        let level = open("zarr/pyramid_v3_sharded.zarr", &selection).unwrap();
        let by_path = open(&format!("zarr/pyramid_v3_sharded.zarr/{number}"), &Selection::default()).unwrap();
        assert_eq!((level.geometry.dims, level.geometry), (dims, by_path.geometry));
        let step = f64::from(1 << number);
        assert_eq!(level.geometry.spacing, DVec3::new(0.25, 0.25, 0.8) * step);
        assert!(level.voxels == by_path.voxels, "level {number}");
    }
}

#[test]
fn a_zarr_store_that_states_more_than_memory_is_refused_at_once() {
    let Some(folder) = volumes::shared() else { return };
    let begun = std::time::Instant::now();
    let read = volume::open(&folder.join("zarr/bad_chunk_size.zarr"), &Selection::default(), &Quiet);
    refused(read, &["bad_chunk_size.zarr", "2000000000000000000 bytes a chunk", "1073741824"]);
    assert!(begun.elapsed().as_secs_f64() < 1.0);
}

#[test]
fn every_type_of_both_versions_of_zarr_is_read() {
    for name in [
        "bool", "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float16", "float32",
        "float64",
    ] {
        for version in ["v2", "v3"] {
            let volume = Store::written(&format!("{version}_{name}")).open().unwrap();
            assert!(volume.voxels == voxels(name, &numbers(DIMS, 1, 0, 0)), "{version} {name}");
            assert_eq!((volume.geometry.dims, volume.has_labels), (DIMS, name == "bool"));
            let notes = volume.notes.join(" ");
            assert!(notes.contains("no spacing") && !notes.contains("chunk"), "{notes}");
        }
    }
}

#[test]
fn every_coding_of_zarr_is_read() {
    let of = |name: &str| Store::written(name).open().unwrap_or_else(|error| panic!("{name}: {error:?}")).voxels;
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/zarr");
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let names: Vec<String> = names.filter_map(|name| Some(name.strip_suffix(".bundle")?.to_owned())).collect();
    let blosc: Vec<&String> = names.iter().filter(|name| name.starts_with("v2_blosc_")).collect();
    assert!(blosc.len() >= 15, "five compressions with three shuffles: {blosc:?}");
    let others = ["v2_big", "v2_fortran", "v3_gzip", "v3_zstd_checked", "v3_blosc", "v3_transposed", "v3_sharded"];
    for name in blosc.into_iter().map(String::as_str).chain(others) {
        assert!(of(name) == voxels("uint16", &numbers(DIMS, 1, 0, 0)), "{name}");
    }
    for (name, dtype) in
        [("v2_big_float", "float32"), ("v2_zstd", "float64"), ("v3_auto", "float32"), ("v3_big", "int32")]
    {
        assert!(of(name) == voxels(dtype, &numbers(DIMS, 1, 0, 0)), "{name}");
    }
}

#[test]
fn chunks_that_are_not_there_have_the_fill_value_and_a_note() {
    let mut expected = numbers(DIMS, 1, 0, 0);
    expected[..3 * 9 * 10].fill(77);
    // 2 × 3 chunks of the first layer; 2 × 3 inner chunks of the first shard.
    for (name, missing) in [("v3_missing", "6 chunks are not there"), ("v3_missing_in_shard", "6 chunks are not there")]
    {
        let volume = Store::written(name).open().unwrap();
        assert!(volume.voxels == voxels("uint16", &expected), "{name}");
        let notes = volume.notes.join(" ");
        assert!(notes.contains(missing), "{name}: {notes}");
    }
}

#[test]
fn an_image_has_levels_channels_times_units_and_labels() {
    let store = Store::written("image");
    let one = |component, time, level| {
        let selection = Selection { component: Some(component), time: Some(time), level, ..Selection::default() };
        store.select(&selection).unwrap()
    };
    for (channel, time) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let volume = one(channel, time, None);
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, channel, time)), "channel {channel}, time {time}");
        // z is in nm in the file; y and x are scaled by the image, too.
        assert_eq!((volume.geometry.spacing, volume.unit), (DVec3::new(0.5, 0.5, 0.5), Some(Unit::Micrometre)));
        assert_eq!(volume.component_names, ["DAPI", "GFP"]);
        let window = [("DAPI", 10.0, 300.0), ("GFP", 20.0, 800.0)][channel];
        assert_eq!(volume.presets.windows, [Window::new(window.0, window.1, window.2).unwrap()]);
        let metadata =
            |key: &str| volume.metadata.iter().find(|(name, _)| name == key).map(|(_, value)| value.as_str());
        assert_eq!(metadata("colour of channel 0"), Some("#0000ff"));
        assert_eq!(volume.presets.colour, Some([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]][channel]));
        assert_eq!(metadata("label image"), Some("labels/nuclei"));
        assert_eq!(metadata("pyramid"), Some("2 levels: 0 9×10×7, 1 5×5×4"));
        let coarse = one(channel, time, Some(1));
        assert!(coarse.voxels == voxels("uint16", &numbers([5, 5, 4], 2, channel, time)));
        // The translation of the level is scaled by the image: 0.125 · 2 in y, 100 nm in z.
        assert_eq!(coarse.geometry.spacing, DVec3::new(1.0, 1.0, 1.0));
        assert!(coarse.geometry.origin.abs_diff_eq(DVec3::new(0.0, 0.25, 0.1), 1e-12), "{}", coarse.geometry.origin);
    }
    refused(store.open(), &["2 components per voxel (DAPI, GFP)", "choose a component"]);
    refused(store.select(&component(0)), &["2 time steps", "choose a time step"]);
    let level = Selection { level: Some(2), component: Some(0), time: Some(0), ..Selection::default() };
    refused(store.select(&level), &["level 2 does not exist", "2 levels"]);
    let axes = Selection { axes: Some("tczyx".to_owned()), ..component(0) };
    refused(store.select(&axes), &["an array of axes tczyx does not exist"]);

    let nuclei = volume::open(&store.path("labels"), &Selection::default(), &Quiet).unwrap();
    let expected = numbers(DIMS, 1, 0, 0).iter().map(|n| (n % 3) as u8).collect();
    assert!(nuclei.voxels == Voxels::U8(expected));
    assert!(nuclei.has_labels);
    assert!(nuclei.geometry.lies_on(&one(0, 0, None).geometry), "{:?}", nuclei.geometry);
    let label = |value, name: &str, colour| LabelPreset { value, name: name.to_owned(), colour: Some(colour) };
    let expected = [label(1, "round", [1.0, 0.0, 0.2]), label(2, "label 2", [0.0, 1.0, 0.0])];
    assert_eq!(nuclei.presets.labels, expected);
}

#[test]
fn an_unknown_unit_of_an_axis_is_noted() {
    let store = Store::written("image");
    let text = std::fs::read_to_string(store.path(".zattrs")).unwrap();
    assert!(text.contains("\"nanometer\""), "{text}");
    let store = store.changed(".zattrs", "\"nanometer\"", "\"parsec\"");
    let chosen = Selection { component: Some(0), time: Some(0), ..Selection::default() };
    let notes = store.select(&chosen).unwrap().notes.join(" ");
    assert!(notes.contains("the unit parsec is no unit of length"), "{notes}");
}

#[test]
fn a_file_inside_a_store_opens_the_store() {
    let store = Store::written("image");
    let chosen = Selection { component: Some(1), time: Some(1), ..Selection::default() };
    let open = |name: &str| volume::open(&store.path(name), &chosen, &Quiet).unwrap().geometry.dims;
    assert_eq!(["", ".zattrs", ".zgroup"].map(open), [DIMS; 3]);
    // A level, its description, and a chunk of it.
    assert_eq!(["level1", "level1/.zarray", "level1/0/0/0/0/0"].map(open), [[5, 5, 4]; 3]);
    let store = Store::written("v3_auto");
    assert_eq!(volume::open(&store.path("c/0/0/0"), &Selection::default(), &Quiet).unwrap().geometry.dims, DIMS);
    // Other files of a store are none of its chunks.
    let store = store.with("notes.txt", b"words");
    let error = volume::open(&store.path("notes.txt"), &Selection::default(), &Quiet).unwrap_err();
    assert!(matches!(error, VolumeError::UnknownFormat { .. }), "{error}");
}

#[test]
fn series_of_a_converted_file_are_chosen_by_number() {
    let store = Store::written("series");
    let error = store.open().map(|volume| volume.voxels).unwrap_err();
    assert!(error.to_string().contains("2 series: 0 series 0 5×4×3, 1 series 1 5×4×4"), "{error}");
    let selection = Selection { series: Some("1".to_owned()), ..Selection::default() };
    let volume = store.select(&selection).unwrap();
    assert!(volume.voxels == voxels("uint8", &numbers([5, 4, 4], 1, 0, 0)));
    assert_eq!(volume.selection.series.as_deref(), Some("1"));
    let selection = Selection { series: Some("2".to_owned()), ..Selection::default() };
    refused(store.select(&selection), &["series 2 does not exist"]);
}

#[test]
fn arrays_of_a_group_and_unnamed_axes_are_chosen() {
    let array = |name: &str| unbundled(&bundle(name));
    let mut files = vec![(".zgroup".to_owned(), b"{\"zarr_format\": 2}".to_vec())];
    for (folder, name) in [("a", "v2_uint16"), ("b", "v2_float64")] {
        files.extend(array(name).into_iter().map(|(file, bytes)| (format!("{folder}/{file}"), bytes)));
    }
    let store =
        Store(volumes::folder(&files.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect::<Vec<_>>()));
    refused(store.open(), &["the arrays a, b", "choose one of them"]);
    let selection = Selection { array: Some("b".to_owned()), ..Selection::default() };
    let volume = store.select(&selection).unwrap();
    assert_eq!((volume.voxels.type_name(), volume.selection.array.as_deref()), ("float64", Some("b")));

    // Axes c, z, y, x of 1 + 1, 7, 10, 9 entries; one chunk each.
    let four = Store::written("v2_uint16").changed(".zarray", "7,\n    10", "2,\n    7,\n    10").changed(
        ".zarray",
        "3,\n    4",
        "1,\n    3,\n    4",
    );
    refused(four.open(), &["2×7×10×9", "state the axes"]);
    let axes =
        |letters: &str, component| Selection { axes: Some(letters.to_owned()), component, ..Selection::default() };
    let volume = four.select(&axes("czyx", Some(1))).unwrap();
    assert_eq!((volume.geometry.dims, volume.components), (DIMS, 2));
    refused(four.select(&axes("zyx", None)), &["the axes zyx are 3, but the array has 4"]);
    refused(four.select(&axes("czyx", None)), &["2 components"]);
}

fn bundle(name: &str) -> Vec<u8> {
    std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/data/zarr/{name}.bundle"))).unwrap()
}

#[test]
fn what_zarr_does_not_mean_or_relume_does_not_read_is_refused_in_a_sentence() {
    let plain = || Store::written("v2_uint16");
    let of = |from: &str, to: &str, words: &[&str]| drop(refused(plain().changed(".zarray", from, to).open(), words));
    of("\"<u2\"", "\"<c8\"", &["<c8", "booleans, whole numbers"]);
    of("\"<u2\"", "[[\"a\", \"<u2\"]]", &["structure"]);
    of("\"filters\": null", "\"filters\": [{\"id\": \"delta\"}]", &["delta", "without filters"]);
    of("\"compressor\": null", "\"compressor\": {\"id\": \"lzma\"}", &["lzma", "blosc, gzip, zlib, zstd"]);
    of("\"order\": \"C\"", "\"order\": \"K\"", &["\"K\""]);
    of("\"fill_value\": 0", "\"fill_value\": -1", &["-1 is no value of type <u2"]);
    of("\"zarr_format\": 2", "\"zarr_format\": 7", &["zarr_format is 7"]);
    of("\"shape\": [\n    7", "\"shape\": [\n    0", &["every axis needs at least one"]);
    of("\"chunks\": [\n    3", "\"chunks\": [\n    0", &["every axis needs a length"]);
    of("\"chunks\": [\n    3,", "\"chunks\": [\n    3, 3,", &["[3, 3, 4, 5]", "[7, 10, 9]"]);
    of("\"chunks\": [\n    3", "\"chunks\": [\n    3000000000", &["120000000000 bytes a chunk", "1073741824"]);
    of("\"shape\": [\n    7", "\"shape\": [\n    70000000", &["chunks; the store is incomplete"]);
    of("\"shape\"", "\"shap\"", &["invalid JSON", "shape"]);
    refused(plain().with("0.0.0", &[1; 119]).open(), &["0.0.0", "119 bytes of numbers instead of 120"]);
    refused(plain().with("0.0.0", &vec![1; 1 << 20]).open(), &["0.0.0", "1048576 coded bytes"]);

    let three = |name: &str, from: &str, to: &str, words: &[&str]| {
        drop(refused(Store::written(name).changed("zarr.json", from, to).open(), words));
    };
    three("v3_uint16", "\"uint16\"", "\"complex64\"", &["complex64", "float16 to float64"]);
    three("v3_uint16", "\"regular\"", "\"rectangular\"", &["rectangular"]);
    three("v3_gzip", "\"gzip\"", "\"pcodec\"", &["pcodec", "blosc, gzip"]);
    three("v3_gzip", "\"bytes\"", "\"bits\"", &["bits"]);
    three("v3_transposed", "\"order\": [\n          1", "\"order\": [\n          0", &["transpose", "no permutation"]);
    three("v3_sharded", "\"chunk_shape\": [\n          2", "\"chunk_shape\": [\n          3", &["they do not fill it"]);
    three("v3_uint16", "\"array\"", "\"file\"", &["node_type"]);
    let group = Store(tempfile::tempdir().unwrap()).with(".zgroup", b"{\"zarr_format\": 2}");
    refused(group.open(), &["no image and no array"]);
    let plate = group.with(".zattrs", b"{\"plate\": {\"wells\": [{\"path\": \"B/03\"}]}}");
    refused(plate.open(), &["plate", "B/03/0"]);

    let image = |from: &str, to: &str, words: &[&str]| {
        drop(refused(Store::written("image").changed(".zattrs", from, to).select(&component(0)), words));
    };
    image("\"level0\"", "\"../level0\"", &["../level0", "outside"]);
    image("\"level0\"", "\"/etc\"", &["/etc", "outside"]);
    image("\"level0\"", "\"level7\"", &["level7", "no metadata of Zarr"]);
    image("\"type\": \"scale\"", "\"type\": \"affine\"", &["affine", "identity, scale and translation"]);
    image("\"name\": \"t\",", "\"name\": \"q\",", &["choose a time step"]);
    image("\"type\": \"time\",", "\"type\": \"space\",", &["choose a time step"]);
    image("\"type\": \"channel\"", "\"type\": \"time\"", &["same meaning"]);
    let store = Store::written("image");
    std::fs::rename(store.path("level0"), store.path("level2")).unwrap();
    #[cfg(unix)]
    {
        let elsewhere = Store::written("v2_uint16");
        std::os::unix::fs::symlink(elsewhere.0.path(), store.path("level0")).unwrap();
        refused(store.select(&component(0)), &["level0", "outside"]);
    }
}

#[test]
fn chunks_of_zstd_need_not_state_their_size() {
    use std::io::Write as _;
    // As a stream writes them: small windows, a block every few bytes, no size in the frame.
    let streamed = |bytes: &[u8]| {
        let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), 3).unwrap();
        encoder.window_log(10).unwrap();
        for part in bytes.chunks(8) {
            encoder.write_all(part).unwrap();
            encoder.flush().unwrap();
        }
        encoder.finish().unwrap()
    };
    let chunk = |store: &Store| zstd::stream::decode_all(&std::fs::read(store.path("0.0.1")).unwrap()[..]).unwrap();
    let store = Store::written("v2_zstd");
    let bytes = chunk(&store);
    assert_eq!(bytes.len(), 3 * 4 * 5 * 8);
    let coded = streamed(&bytes);
    let volume = store.with("0.0.1", &coded).open().unwrap();
    assert!(volume.voxels == voxels("float64", &numbers(DIMS, 1, 0, 0)));
    // Two frames are one chunk, and more than a chunk is refused.
    let halves = [streamed(&bytes[..200]), streamed(&bytes[200..])].concat();
    let store = Store::written("v2_zstd").with("0.0.1", &halves);
    assert!(store.open().unwrap().voxels == voxels("float64", &numbers(DIMS, 1, 0, 0)));
    let longer = streamed(&[&bytes[..], &[0; 8]].concat());
    refused(Store::written("v2_zstd").with("0.0.1", &longer).open(), &["0.0.1", "damaged zstd"]);
    let stated = zstd::bulk::compress(&[&bytes[..], &[0; 8]].concat(), 3).unwrap();
    refused(Store::written("v2_zstd").with("0.0.1", &stated).open(), &["0.0.1", "488 bytes, but a chunk has 480"]);
}

#[test]
fn spacings_that_old_images_do_not_state_are_noted_at_every_level() {
    // Versions 0.1 and 0.2 have no transformations: coarse voxels are as many times larger as there are fewer of them.
    let old =
        "{\"multiscales\": [{\"version\": \"0.1\", \"datasets\": [{\"path\": \"level0\"}, {\"path\": \"level1\"}]}]}";
    let store = Store::written("image").with(".zattrs", old.as_bytes());
    for (level, spacing, words) in [
        (0, DVec3::ONE, "states no spacing; Relume uses 1 1 1"),
        (1, DVec3::new(1.8, 2.0, 1.75), "states no spacing; Relume uses 1.8 2 1.75"),
    ] {
        let selection = Selection { component: Some(0), time: Some(0), level: Some(level), ..Selection::default() };
        let volume = store.select(&selection).unwrap();
        assert_eq!(volume.geometry.spacing, spacing, "level {level}");
        assert!(volume.notes.iter().any(|note| note.contains(words)), "{:?}", volume.notes);
        let fixed = volume.with_spacing(DVec3::splat(2.0)).unwrap();
        assert!(!fixed.notes.iter().any(|note| note.contains("no spacing")), "{:?}", fixed.notes);
    }
}

#[test]
fn damaged_chunks_are_refused_with_their_names() {
    let flipped = |name: &str, file: &str, at: usize| {
        let store = Store::written(name);
        let mut bytes = std::fs::read(store.path(file)).unwrap();
        bytes[at] ^= 0x55;
        store.with(file, &bytes)
    };
    let cut = |name: &str, file: &str| {
        let store = Store::written(name);
        let bytes = std::fs::read(store.path(file)).unwrap();
        store.with(file, &bytes[..bytes.len() / 2])
    };
    refused(flipped("v3_zstd_checked", "c/1/1/1", 20).open(), &["c/1/1/1", "[3, 4, 5]", "damaged crc32c"]);
    refused(cut("v3_zstd_checked", "c/1/1/1").open(), &["c/1/1/1", "damaged"]);
    refused(cut("v3_gzip", "c.1.1.1").open(), &["c.1.1.1", "damaged gzip"]);
    refused(cut("v2_fortran", "0/0/1").open(), &["0/0/1", "damaged zlib"]);
    refused(cut("v2_zstd", "0.0.1").open(), &["0.0.1", "damaged zstd"]);
    refused(cut("v2_blosc_lz4_1", "0.0.1").open(), &["0.0.1", "damaged blosc"]);
    // A length in its header, by which a decoder would allocate.
    refused(flipped("v2_blosc_lz4_1", "0.0.1", 7).open(), &["0.0.1", "but a chunk has 120"]);
    refused(cut("v3_sharded", "c/0/0/0").open(), &["c/0/0/0", "index of the shard"]);
    let store = Store::written("v3_sharded");
    let bytes = std::fs::read(store.path("c/1/1/1")).unwrap();
    refused(store.with("c/1/1/1", &bytes[bytes.len() - 5..]).open(), &["5 bytes, but its index has 132"]);
}

// HDF5 and NetCDF.

fn hdf5(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf5").join(name)
}

fn array(name: &str) -> Selection {
    Selection { array: Some(name.to_owned()), ..Selection::default() }
}

fn open_hdf5(name: &str, selection: &Selection) -> Result<Volume, VolumeError> {
    volume::open(&hdf5(name), selection, &Quiet)
}

#[test]
fn every_shared_hdf5_file_reads_as_an_independent_reader_found_it() {
    volumes::check_below("hdf5/", 1);
    let Some(folder) = volumes::shared() else { return };
    let volume = volume::open(&folder.join("hdf5/chunked.h5"), &Selection::default(), &Quiet).unwrap();
    assert_eq!(volume.unit, Some(Unit::Micrometre));
}

#[test]
fn every_type_of_hdf5_is_read_in_both_byte_orders() {
    for name in [
        "bool", "uint8", "int8", "uint16", "int16", "uint32", "int32", "uint64", "int64", "float16", "float32",
        "float64",
    ] {
        for order in ["little", "big"] {
            if (name, order) == ("bool", "big") {
                continue;
            }
            let volume = open_hdf5("types.h5", &array(&format!("/{order}/{name}"))).unwrap();
            assert!(volume.voxels == voxels(name, &numbers(DIMS, 1, 0, 0)), "{order} {name}");
            assert_eq!((volume.geometry.dims, volume.has_labels), (DIMS, name == "bool"));
        }
    }
    // The slash at the beginning may be left out; arrays of one axis and texts are no volumes.
    assert!(open_hdf5("types.h5", &array("little/uint8")).is_ok());
    let error =
        refused(open_hdf5("types.h5", &Selection::default()), &["the arrays /big/float16, ", "choose one of them"]);
    assert!(!error.to_string().contains("line") && !error.to_string().contains("words"), "{error}");
    refused(open_hdf5("types.h5", &array("/line")), &["the array /line does not exist"]);
}

#[test]
fn every_coding_of_hdf5_is_read() {
    for file in ["codings.h5", "codings_latest.h5"] {
        for name in ["gzip", "lzf", "lzf_shuffle", "scaleoffset", "chunked", "unlimited"] {
            let volume = open_hdf5(file, &array(name)).unwrap_or_else(|error| panic!("{file} {name}: {error:?}"));
            assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, 0, 0)), "{file} {name}");
        }
        let mut expected = numbers(DIMS, 1, 0, 0);
        expected[..3 * 9 * 10].fill(77);
        assert!(open_hdf5(file, &array("sparse")).unwrap().voxels == voxels("uint16", &expected), "{file}");
    }
}

#[test]
fn an_array_of_four_axes_is_read_once_they_are_stated() {
    refused(open_hdf5("four.h5", &Selection::default()), &["four.h5", "2×7×10×9", "state the axes"]);
    for channel in [0, 1] {
        let selection = Selection { axes: Some("czyx".to_owned()), ..component(channel) };
        let volume = open_hdf5("four.h5", &selection).unwrap();
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, channel, 0)));
        assert_eq!(volume.components, 2);
    }
    // Another order of the same axes: x and z are exchanged.
    let turned = Selection { axes: Some("cxyz".to_owned()), ..component(1) };
    let volume = open_hdf5("four.h5", &turned).unwrap();
    assert_eq!(volume.geometry.dims, [7, 10, 9]);
    assert_eq!(volume.value([2, 3, 4]), Some(f64::from(4 * 4 + 7 * 3 + 40 * 2 + 300)));
}

#[test]
fn axes_that_ilastik_states_are_used() {
    for channel in [0, 1] {
        let volume = open_hdf5("ilastik.h5", &component(channel)).unwrap();
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, channel, 0)), "{channel}");
        assert_eq!((volume.components, volume.geometry.dims), (2, DIMS));
    }
}

#[test]
fn sizes_of_elements_and_coordinates_are_spacings() {
    let volume = open_hdf5("single.h5", &Selection::default()).unwrap();
    assert!(volume.voxels == voxels("uint8", &numbers(DIMS, 1, 0, 0)));
    assert_eq!((volume.geometry.spacing, volume.unit), (DVec3::new(0.25, 0.5, 2.0), Some(Unit::Micrometre)));
    assert!(volume.metadata.contains(&("long_name".to_owned(), "nuclei".to_owned())));
    for file in ["netcdf4.nc", "netcdf3.nc", "netcdf3_offset64.nc", "netcdf3_data64.nc"] {
        refused(open_hdf5(file, &Selection::default()), &["the arrays /kelvin, /wind"]);
        refused(open_hdf5(file, &array("kelvin")), &["2 time steps"]);
        let selection = Selection { time: Some(1), ..array("kelvin") };
        let kelvin = open_hdf5(file, &selection).unwrap();
        assert!(kelvin.voxels == voxels("int16", &numbers(DIMS, 1, 0, 1)), "{file}");
        assert_eq!((kelvin.slope, kelvin.intercept), (0.25, 200.0));
        // depth falls by 2000 µm from 40 µm; all axes take the unit of x.
        let grid = kelvin.geometry;
        assert!(grid.spacing.abs_diff_eq(DVec3::new(0.5, 1.5, 2.0), 1e-9), "{file}: {}", grid.spacing);
        assert!(grid.origin.abs_diff_eq(DVec3::new(-3.0, 5.0, 0.04), 1e-9), "{file}: {}", grid.origin);
        assert_eq!((grid.direction.z_axis, kelvin.unit), (DVec3::NEG_Z, Some(Unit::Millimetre)), "{file}");
        let wind = open_hdf5(file, &array("wind")).unwrap();
        assert!(wind.value([0, 0, 0]).unwrap().is_nan(), "{file}");
        assert_eq!(wind.value([1, 0, 0]), Some(0.125));
        assert!(wind.notes.join(" ").contains("1 voxels have the fill value -999"), "{file}: {:?}", wind.notes);
    }
}

#[test]
fn the_world_of_minc_is_turned_to_that_of_dicom() {
    let volume = open_hdf5("minc.mnc", &Selection::default()).unwrap();
    assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, 0, 0)));
    let grid = volume.geometry;
    assert!(volume.anatomical && volume.unit == Some(Unit::Millimetre));
    assert!(grid.spacing.abs_diff_eq(DVec3::new(1.5, 2.0, 3.0), 1e-12), "{}", grid.spacing);
    // World RAS = Σ cosines · (start + step · index); x and y are negated for LPS.
    let world = |index: DVec3| {
        let along = [
            DVec3::new(0.8, 0.6, 0.0) * (-10.0 + 1.5 * index.x),
            DVec3::new(-0.6, 0.8, 0.0) * (20.0 - 2.0 * index.y),
            DVec3::Z * (30.0 + 3.0 * index.z),
        ];
        (along[0] + along[1] + along[2]) * DVec3::new(-1.0, -1.0, 1.0)
    };
    for index in [DVec3::ZERO, DVec3::new(8.0, 2.0, 5.0)] {
        assert!(grid.world_from_index(index).abs_diff_eq(world(index), 1e-9), "{index}");
    }
}

#[test]
fn slices_of_minc_have_scales_of_their_own() {
    // Slice z turns 0 to 4000 into −10 + z to 90 + 11 z.
    let slices = open_hdf5("minc_slices.mnc", &Selection::default()).unwrap();
    let one = open_hdf5("minc_scale.mnc", &Selection::default()).unwrap();
    for (index, n) in numbers(DIMS, 1, 0, 0).into_iter().enumerate() {
        let [x, y, z] = [index % DIMS[0], index / DIMS[0] % DIMS[1], index / (DIMS[0] * DIMS[1])];
        let (n, slice) = (n as f64, z as f64);
        let value = n * (100.0 + 10.0 * slice) / 4000.0 - 10.0 + slice;
        assert!((slices.value([x, y, z]).unwrap() - value).abs() <= 1e-5, "{x} {y} {z}");
        assert!((one.value([x, y, z]).unwrap() - (n / 40.0 - 10.0)).abs() <= 1e-12, "{x} {y} {z}");
    }
    assert!(slices.notes.iter().any(|note| note.contains("different scales")), "{:?}", slices.notes);
    assert_eq!((one.voxels.type_name(), one.slope, one.intercept), ("uint16", 1.0 / 40.0, -10.0));
    // Scales that do not fit are told, and not applied.
    let bytes = std::fs::read(hdf5("minc_slices.mnc")).unwrap();
    let mut damaged = bytes.clone();
    let end = |z: f64| (90.0 + 11.0 * z).to_le_bytes();
    let at = bytes.windows(16).position(|bytes| bytes == [end(0.0), end(1.0)].concat()).unwrap();
    damaged[at + 8..at + 16].copy_from_slice(&1e308_f64.to_le_bytes());
    let fine = volumes::opened("v.h5", &damaged, &Selection::default()).unwrap();
    assert!(fine.value([0, 0, 1]).unwrap() > 1e30, "a large scale is one");
    damaged[at + 8..at + 16].copy_from_slice(&f64::NAN.to_le_bytes());
    let stored = volumes::opened("v.h5", &damaged, &Selection::default()).unwrap();
    assert!(stored.voxels == voxels("uint16", &numbers(DIMS, 1, 0, 0)));
    assert!(stored.notes.iter().any(|note| note.contains("image-max has no numbers")), "{:?}", stored.notes);
}

#[test]
fn an_imaris_file_has_channels_times_and_levels() {
    let one = |channel, time, level| {
        let selection = Selection { time: Some(time), level: Some(level), ..component(channel) };
        open_hdf5("imaris.ims", &selection).unwrap()
    };
    for (channel, time) in [(0, 0), (1, 0), (1, 1)] {
        let volume = one(channel, time, 0);
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, channel, time)), "channel {channel}, time {time}");
        assert!(one(channel, time, 1).voxels == voxels("uint16", &numbers([5, 5, 4], 2, channel, time)));
        assert_eq!(volume.component_names, ["DAPI", "GFP"]);
        let title = ["DAPI", "GFP"][channel];
        assert_eq!(volume.presets.windows, [Window::new(title, 10.0, 250.0).unwrap()]);
        // The box of the image is that of the outer faces of its voxels.
        let grid = volume.geometry;
        assert!(grid.spacing.abs_diff_eq(DVec3::new(0.5, 0.5, 1.0), 1e-12), "{}", grid.spacing);
        assert!(grid.origin.abs_diff_eq(DVec3::new(-0.75, 0.25, 4.5), 1e-12), "{}", grid.origin);
        assert_eq!(volume.unit, Some(Unit::Micrometre));
        assert!(
            volume.metadata.contains(&("colour of channel 0".to_owned(), "#0000ff".to_owned())),
            "{:?}",
            volume.metadata
        );
    }
    refused(open_hdf5("imaris.ims", &Selection::default()), &["2 components per voxel (DAPI, GFP)"]);
    refused(open_hdf5("imaris.ims", &component(0)), &["2 time steps"]);
}

#[test]
fn damaged_hdf5_and_netcdf_files_are_refused_with_a_place() {
    let bytes = |name: &str| std::fs::read(hdf5(name)).unwrap();
    let single = bytes("single.h5");
    refused(volumes::opened("v.h5", &single[..single.len() / 2], &Selection::default()), &["v.h5"]);
    refused(volumes::opened("v.h5", b"words", &Selection::default()), &["v.h5"]);
    let netcdf = bytes("netcdf3.nc");
    refused(volumes::opened("v.nc", &netcdf[..netcdf.len() - 100], &array("wind")), &["v.nc"]);
    // A gzip chunk: any byte of it counts, and Adler-32 notices.
    let mut damaged = bytes("codings.h5");
    let at = damaged.windows(2).position(|pair| pair == [0x78, 0x5e]).unwrap();
    damaged[at + 20] ^= 0x55;
    let error = [("gzip"), ("unlimited")].iter().find_map(|name| volumes::opened("v.h5", &damaged, &array(name)).err());
    let message = volumes::whole_message(&error.unwrap());
    assert!(message.contains("v.h5, array /") && message.contains("block from ["), "{message}");
}

#[test]
fn chunks_under_the_other_separator_are_read_and_a_store_without_chunks_is_refused() {
    // "v2_uint16" has names with dots, as it states.
    let names = |store: &Store| -> Vec<String> {
        let entries =
            std::fs::read_dir(store.0.path()).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        entries.filter(|name| !name.starts_with('.')).collect()
    };
    let store = Store::written("v2_uint16");
    for name in names(&store) {
        let path = store.path(&name.replace('.', "/"));
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::rename(store.path(&name), path).unwrap();
    }
    let volume = store.open().unwrap();
    assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, 0, 0)));
    assert!(
        volume.notes.iter().any(|note| note.contains("dimension_separator") && note.contains("'/'")),
        "{:?}",
        volume.notes
    );
    // The other way round, and one chunk that is missing.
    let store = Store::written("v2_uint16").changed(
        ".zarray",
        "\"dimension_separator\": \".\"",
        "\"dimension_separator\": \"/\"",
    );
    std::fs::remove_file(store.path("0.0.0")).unwrap();
    let volume = store.open().unwrap();
    assert!(volume.notes.iter().any(|note| note.contains("1 chunk is not there")), "{:?}", volume.notes);
    assert_eq!(volume.value([8, 9, 6]), Some(f64::from(64 + 7 * 9 + 40 * 6)));
    // None at all.
    for name in names(&store) {
        std::fs::remove_file(store.path(&name)).unwrap();
    }
    refused(store.open(), &["none of its chunks is there", "0/0/0", "incomplete"]);
}

#[test]
fn links_are_further_names_of_arrays_and_may_lead_to_files_beside() {
    for name in ["/detector/frames", "/entry/data", "entry/alias/frames"] {
        let volume = open_hdf5("links.h5", &array(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, 0, 0)), "{name}");
    }
    // The array of another file, and one in a group of it.
    for (name, channel) in [("/outside/one", 1), ("/outside/all/deep/two", 2)] {
        let volume = open_hdf5("links.h5", &array(name)).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, channel, 0)), "{name}");
    }
    let all = refused(open_hdf5("links.h5", &Selection::default()), &["/outside/one", "/outside/all/deep/two"]);
    assert!(all.to_string().contains("the arrays "), "{all}");
    refused(open_hdf5("links.h5", &array("/outside/gone")), &["/outside/gone", "no_such.h5", "missing"]);
    refused(open_hdf5("links.h5", &array("/outside/away")), &["../single.h5", "outside the folder"]);
    refused(open_hdf5("links.h5", &array("/nothing")), &["the array /nothing does not exist"]);
    // Without the other file, its arrays are not there.
    let folder = tempfile::tempdir().unwrap();
    std::fs::copy(hdf5("links.h5"), folder.path().join("links.h5")).unwrap();
    let open = |selection: &Selection| volume::open(&folder.path().join("links.h5"), selection, &Quiet);
    assert!(open(&Selection::default()).unwrap().voxels == voxels("uint16", &numbers(DIMS, 1, 0, 0)));
    refused(open(&array("/outside/one")), &["links_target.h5", "missing"]);
}

#[test]
fn coordinates_of_emd_are_spacings() {
    let volume = open_hdf5("emd.emd", &Selection::default()).unwrap();
    assert!(volume.voxels == voxels("uint16", &numbers(DIMS, 1, 0, 0)));
    // dim1 is z, of two entries, in 0.1 nm; the others are in nm.
    assert!(volume.geometry.spacing.abs_diff_eq(DVec3::new(0.25, 0.5, 0.3), 1e-12), "{}", volume.geometry.spacing);
    assert!(volume.geometry.origin.abs_diff_eq(DVec3::new(4.0, 0.0, 1.0), 1e-12), "{}", volume.geometry.origin);
    assert_eq!((volume.unit, volume.notes.len()), (Some(Unit::Nanometre), 0), "{:?}", volume.notes);
}

#[test]
fn netcdf_4_has_unsigned_numbers_and_dimensions_without_coordinates() {
    let volume = open_hdf5("netcdf4_bare.nc", &Selection::default()).unwrap();
    assert!(volume.voxels == voxels("uint8", &numbers(DIMS, 1, 0, 0)));
    assert_eq!((volume.slope, volume.intercept), (0.5, -3.0));
    assert!(!volume.notes.iter().any(|note| note.contains("even")), "{:?}", volume.notes);
}
