//! DICOM: series and single files of the shared folder, and generated ones of every encoding, kind and defect.
#![expect(clippy::print_stderr, reason = "a test that cannot run says so")]
#![expect(clippy::float_cmp, reason = "whole numbers, and fractions of two")]

use crate::support;

use std::path::{Path, PathBuf};

use relume::progress::Quiet;
use relume::volume::{self, Geometry, Selection, Several, Unit, Volume, VolumeError};
use serde_json::Value;
use support::dicom::{
    BIG, DEFLATED, EXPLICIT, Elements, IMPLICIT, RLE, Value as Written, file, place, rle, segmentation, slice,
};
use support::volumes::{self, refused, shared};

fn open(path: &Path, selection: &Selection) -> Result<Volume, VolumeError> {
    volume::open(path, selection, &Quiet)
}

fn series(key: &str) -> Selection {
    Selection { series: Some(key.to_owned()), ..Selection::default() }
}

fn resampled() -> Selection {
    Selection { resample: true, ..Selection::default() }
}

/// Findings of independent readers about a shared file.
fn expected(folder: &Path, name: &str) -> Value {
    let text = std::fs::read_to_string(folder.join("expected.json")).unwrap();
    let json: Value = serde_json::from_str(&text).unwrap();
    json["files"][name].clone()
}

#[test]
fn every_shared_file_reads_as_pydicom_reads_it() {
    let Some(folder) = shared() else { return };
    // These have tests of their own.
    let apart =
        ["two_series", "missing_slice", "tilt", "duplicates", "modality_lut", "ts_jpeg_baseline", "JPEG2000.dcm"];
    let ours = |name: &str| name.strip_prefix("dicom/").is_some_and(|name| !apart.contains(&name));
    let checked = volumes::check_all(&folder, ours, |name, selection| open(&folder.join(name), selection));
    assert!(checked >= 22, "the shared folder has at least 22 such files, {checked} were checked");
}

#[test]
fn lossy_voxels_are_within_the_differences_of_decoders() {
    let Some(folder) = shared() else { return };
    for name in ["dicom/ts_jpeg_baseline", "dicom/JPEG2000.dcm"] {
        let (expected, volume) = (expected(&folder, name), open(&folder.join(name), &Selection::default()).unwrap());
        assert_eq!(serde_json::json!(volume.geometry.dims), expected["dims"], "{name}");
        assert_eq!(volume.voxels.type_name(), expected["dtype"].as_str().unwrap(), "{name}");
        let (about, tolerance) = (&expected["about"], expected["tolerance"].as_f64().unwrap());
        let statistics = volume.statistics().unwrap();
        for (ours, key) in [(statistics.min, "min"), (statistics.max, "max"), (statistics.mean, "mean")] {
            let theirs = about["stored"][key].as_f64().unwrap();
            assert!((ours - theirs).abs() <= tolerance, "{name}: {key} is {ours}, not {theirs}");
        }
        for sample in about["samples"].as_array().into_iter().flatten() {
            let index: Vec<usize> = serde_json::from_value(sample["ijk"].clone()).unwrap();
            let (ours, theirs) =
                (volume.value([index[0], index[1], index[2]]).unwrap(), sample["stored"].as_f64().unwrap());
            assert!((ours - theirs).abs() <= tolerance, "{name} at {index:?}: {ours}, not {theirs}");
        }
    }
}

#[test]
fn one_of_two_series_is_chosen_by_its_number_or_identifier() {
    let Some(folder) = shared() else { return };
    let (name, path) = ("dicom/two_series", folder.join("dicom/two_series"));
    let error =
        refused(open(&path, &Selection::default()), &["2 series: 3 «axial» CT 48×44×14, 7 «coronal» MR 40×36×12"]);
    let VolumeError::Choose { there: Several::Series(all), .. } = error else { panic!("{error}") };
    assert_eq!(all.iter().map(|one| one.dims).collect::<Vec<_>>(), [[48, 44, 14], [40, 36, 12]]);
    for one in expected(&folder, name)["series"].as_array().unwrap() {
        let key = one["number"].to_string();
        volumes::check(name, one, |selection| {
            open(&path, &Selection { series: Some(key.clone()), ..selection.clone() })
        });
        let volume = open(&path, &series(&key)).unwrap();
        assert_eq!(volume.selection.series, Some(key), "it says which of several it is");
        let skipped = volume.notes.iter().any(|note| note.contains("2 files are of another format"));
        assert!(skipped, "two files are no DICOM: {:?}", volume.notes);
    }
    refused(open(&path, &series("4")), &["series 4 does not exist", "3 «axial»"]);
}

#[test]
fn a_table_of_values_takes_the_place_of_a_slope() {
    let Some(folder) = shared() else { return };
    let name = "dicom/modality_lut";
    let (expected, volume) = (expected(&folder, name), open(&folder.join(name), &Selection::default()).unwrap());
    let statistics = volume.statistics().unwrap();
    let of = |key: &str| expected["value"][key].as_f64().unwrap();
    assert_eq!((statistics.min, statistics.max), (of("min"), of("max")));
    assert!((statistics.mean - of("mean")).abs() <= 1e-9 * of("mean"), "{}", statistics.mean);
    for sample in expected["samples"].as_array().unwrap() {
        let index: Vec<usize> = serde_json::from_value(sample["ijk"].clone()).unwrap();
        assert_eq!(volume.value([index[0], index[1], index[2]]), sample["value"].as_f64(), "{index:?}");
    }
}

#[test]
fn a_missing_slice_and_a_tilted_gantry_are_refused_with_the_numbers_or_resampled() {
    let Some(folder) = shared() else { return };
    let path = folder.join("dicom/missing_slice");
    let words = ["1 slice is missing", "6.2000 mm between", "median is 3.1000 mm"];
    assert_eq!(refused(open(&path, &Selection::default()), &words).code(), "volume-slices-uneven");
    let (filled, whole) =
        (open(&path, &resampled()).unwrap(), open(&folder.join("dicom/oblique_ct"), &resampled()).unwrap());
    assert_eq!(filled.geometry.dims, [48, 44, 18]);
    assert!(filled.notes.iter().any(|note| note.contains("1 slice is missing")), "{:?}", filled.notes);
    assert!(filled.geometry.lies_on(&whole.geometry), "{:?}", filled.geometry);

    let path = folder.join("dicom/tilt");
    let error = refused(open(&path, &Selection::default()), &["sheared", "102.000° between y and z"]);
    assert_eq!(error.code(), "volume-axes-lean");
    let straight = open(&path, &resampled()).unwrap();
    let spacing = straight.geometry.spacing;
    assert!(spacing.abs_diff_eq(glam::DVec3::new(1.2, 0.8, 3.0 * 12_f64.to_radians().cos()), 1e-5), "{spacing}");
}

#[test]
fn two_slices_at_one_place_that_nothing_tells_apart_are_refused_with_their_names() {
    let Some(folder) = shared() else { return };
    let path = folder.join("dicom/duplicates");
    refused(
        open(&path, &Selection::default()),
        &["9 slices at 8 positions", ".dcm", "temporal position", "is at the position"],
    );
}

#[test]
fn a_series_knows_its_unit_windows_and_metadata() {
    let Some(folder) = shared() else { return };
    let volume = open(&folder.join("dicom/oblique_ct"), &Selection::default()).unwrap();
    assert_eq!((volume.unit, volume.anatomical, volume.files.len()), (Some(Unit::Millimetre), true, 18));
    let windows: Vec<[f64; 2]> = volume.presets.windows.iter().map(|window| [window.low, window.high]).collect();
    assert_eq!(windows, [[0.0, 80.0], [-600.0, 1400.0]], "centre 40, width 80, and centre 400, width 2000");
    assert!(volume.metadata.iter().any(|(key, value)| key == "modality" && value == "CT"), "{:?}", volume.metadata);
    let volume = open(&folder.join("dicom/ts_rle"), &Selection::default()).unwrap();
    assert!(!volume.presets.windows.is_empty(), "a CT without windows has those of CT");
}

#[test]
fn labels_of_a_part_are_laid_into_the_grid_of_the_volume() {
    let Some(folder) = shared() else { return };
    let volume = open(&folder.join("dicom/oblique_ct"), &Selection::default()).unwrap();
    let labels = open(&folder.join("dicom/seg_binary.dcm"), &Selection::default()).unwrap();
    let laid = labels.labels_laid_into(&volume.geometry).unwrap().unwrap();
    let expected = &expected(&folder, "dicom/seg_binary.dcm")["on_reference_grid"];
    assert_eq!(volumes::hex(laid.voxels.bytes()), expected["decoded_sha256"].as_str().unwrap());
    assert!(laid.geometry.lies_on(&volume.geometry) && laid.has_labels && laid.presets == labels.presets);
    assert!(
        laid.notes.iter().any(|note| note.contains("48×44×11 voxels are laid into the 48×44×18")),
        "{:?}",
        laid.notes
    );
    // Half a voxel aside.
    let mut aside = volume.geometry;
    aside.origin += aside.direction.x_axis * 0.5 * aside.spacing.x;
    assert!(labels.labels_laid_into(&aside).unwrap().is_none());
    // A part of the part: labelled voxels are lost, and said to be.
    let part = Geometry { dims: [48, 44, 2], ..labels.geometry };
    let cut = labels.labels_laid_into(&part).unwrap().unwrap();
    assert_eq!(cut.voxels.bytes(), &labels.voxels.bytes()[..48 * 44 * 2]);
    assert!(cut.notes.iter().any(|note| note.contains("labelled voxels lie outside")), "{:?}", cut.notes);
}

/// Files of a shared folder.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    all.sort();
    all
}

#[test]
fn one_file_of_a_series_is_one_slice() {
    let Some(folder) = shared() else { return };
    let path = &files(&folder.join("dicom/oblique_ct"))[0];
    let volume = open(path, &Selection::default()).unwrap();
    assert_eq!(volume.geometry.dims, [48, 44, 1]);
    assert!((volume.geometry.spacing.z - 5.0).abs() < 1e-9, "SliceThickness: {}", volume.geometry.spacing.z);
    assert!(volume.notes.iter().any(|note| note.contains("SliceThickness, 5 mm")), "{:?}", volume.notes);
}

fn opened(name: &str, bytes: &[u8]) -> Result<Volume, VolumeError> {
    volumes::opened(name, bytes, &Selection::default())
}

fn series_of(files: &[(&str, Elements)], selection: &Selection) -> Result<Volume, VolumeError> {
    let files: Vec<_> = files.iter().map(|(name, elements)| (*name, file(elements, EXPLICIT))).collect();
    open(volumes::folder(&files).path(), selection)
}

/// Stored numbers of a volume.
fn stored(volume: &Volume) -> Vec<f64> {
    (0..volume.voxels.len()).map(|index| volume.voxels.value(index).unwrap()).collect()
}

fn from(first: u32, count: u32) -> Vec<f64> {
    (first..first + count).map(f64::from).collect()
}

#[test]
fn every_encoding_of_elements_gives_the_same_slice() {
    let elements = slice(7.0, 300);
    let explicit = elements.bytes(false, false);
    let files = [
        ("explicit.dcm", file(&elements, EXPLICIT)),
        ("implicit.dcm", file(&elements, IMPLICIT)),
        ("big.dcm", file(&elements, BIG)),
        ("deflated.dcm", file(&elements, DEFLATED)),
        ("without_preamble_and_meta", explicit.clone()),
        ("implicit_without_meta.dcm", elements.bytes(true, false)),
        ("no_syntax", [vec![0; 128], b"DICM".to_vec(), explicit].concat()),
        // As the data of a preamble of another format.
        ("implicit_no_syntax", [vec![1; 128], b"DICM".to_vec(), elements.bytes(true, false)].concat()),
    ];
    for (name, bytes) in files {
        let volume = opened(name, &bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
        let geometry = &volume.geometry;
        assert_eq!((geometry.dims, volume.voxels.type_name()), ([4, 3, 1], "uint16"), "{name}");
        assert_eq!(geometry.spacing.to_array(), [0.25, 0.5, 2.0], "{name}: the first number is between rows");
        assert_eq!(geometry.origin.to_array(), [1.0, 2.0, 7.0], "{name}");
        assert_eq!(stored(&volume), from(300, 12), "{name}");
    }
}

#[test]
fn positions_order_the_slices_whatever_their_names_and_numbers() {
    let numbered = |z, first, number: &str| slice(z, first).text(0x0020_0013, "IS", number);
    let files = [("a", numbered(9.0, 24, "1")), ("b", numbered(3.0, 0, "3")), ("c", numbered(6.0, 12, "2"))];
    let volume = series_of(&files, &Selection::default()).unwrap();
    assert_eq!(stored(&volume), from(0, 36));
    assert_eq!((volume.geometry.spacing.z, volume.geometry.origin.z), (3.0, 3.0), "SliceThickness is 2");
}

#[test]
fn rounded_positions_are_even_and_noted_and_uneven_ones_are_refused() {
    let at = |places: &[f64]| -> Vec<(&'static str, Elements)> {
        ["a", "b", "c", "d", "e"].into_iter().zip(places).map(|(name, &z)| (name, slice(z, 0))).collect()
    };
    let volume = series_of(&at(&[0.0, 3.0, 6.1, 9.0, 12.0]), &Selection::default()).unwrap();
    assert!(volume.notes.iter().any(|note| note.contains("from 2.9000 to 3.1000 mm")), "{:?}", volume.notes);
    let uneven = at(&[0.0, 3.0, 7.5, 10.5, 13.5]);
    refused(series_of(&uneven, &Selection::default()), &["unevenly spaced: 4.5000 mm between b and c", "3.0000 mm"]);
    let gaps = at(&[0.0, 3.0, 12.0, 15.0, 21.0]);
    refused(series_of(&gaps, &Selection::default()), &["3 slices are missing", "9.0000 mm between b and c"]);
}

#[test]
fn resampling_interpolates_the_missing_slice_between_its_neighbours() {
    let files = [("a", slice(0.0, 0)), ("b", slice(1.0, 10)), ("c", slice(3.0, 30)), ("d", slice(4.0, 40))];
    let volume = series_of(&files, &resampled()).unwrap();
    assert_eq!(volume.geometry.dims, [4, 3, 5]);
    let expected: Vec<f64> = [0, 10, 20, 30, 40].into_iter().flat_map(|first| from(first, 12)).collect();
    assert_eq!(stored(&volume), expected);
}

#[test]
fn slices_at_one_place_are_times_told_apart_by_what_the_files_state() {
    for (tag, vr, name) in [
        (0x0020_0100, "IS", "temporal position"),
        (0x0020_0012, "IS", "acquisition"),
        (0x0018_0086, "IS", "echo"),
        (0x0018_1060, "DS", "trigger time"),
    ] {
        let one = |z, first, value: &str| slice(z, first).text(tag, vr, value);
        let files =
            [("a", one(0.0, 0, "7")), ("b", one(2.0, 12, "7")), ("c", one(0.0, 100, "10")), ("d", one(2.0, 112, "10"))];
        refused(series_of(&files, &Selection::default()), &["2 time steps; choose a time step from 0 to 1"]);
        for (time, first) in [(0, 0), (1, 100)] {
            let volume = series_of(&files, &Selection { time: Some(time), ..Selection::default() }).unwrap();
            assert_eq!(stored(&volume), from(first, 24), "{name}");
            let axis = ("time axis".to_owned(), format!("{name} 7, 10"));
            assert!(volume.metadata.contains(&axis), "{:?}", volume.metadata);
        }
    }
    let b_value = |z, value| slice(z, 0).with(0x0018_9087, "FD", Written::Double(vec![value]));
    let files = [("a", b_value(0.0, 0.0)), ("b", b_value(0.0, 1000.0))];
    let volume = series_of(&files, &Selection { time: Some(1), ..Selection::default() }).unwrap();
    assert!(volume.metadata.contains(&("time axis".to_owned(), "b-value 0, 1000".to_owned())), "{:?}", volume.metadata);
    // One slice too many.
    let files = [("a", slice(0.0, 0)), ("b", slice(2.0, 0)), ("c", slice(2.0, 5))];
    refused(
        series_of(&files, &Selection::default()),
        &["b, ImagePositionPatient", "3 slices at 2 positions", "c is at"],
    );
}

#[test]
fn slopes_that_differ_make_values_of_floats() {
    let sloped = |z, slope: &str| slice(z, 10).text(0x0028_1052, "DS", "-5").text(0x0028_1053, "DS", slope);
    let equal = series_of(&[("a", sloped(0.0, "0.5")), ("b", sloped(2.0, "0.5"))], &Selection::default()).unwrap();
    assert_eq!((equal.voxels.type_name(), equal.slope, equal.intercept), ("uint16", 0.5, -5.0));
    let differ = series_of(&[("a", sloped(0.0, "0.5")), ("b", sloped(2.0, "2"))], &Selection::default()).unwrap();
    assert_eq!((differ.voxels.type_name(), differ.slope, differ.intercept), ("float32", 1.0, 0.0));
    assert_eq!((differ.value([0, 0, 0]), differ.value([1, 0, 1])), (Some(0.0), Some(17.0)));
    assert!(differ.notes.iter().any(|note| note.contains("differ between slices")), "{:?}", differ.notes);
}

#[test]
fn groups_of_one_number_are_told_apart_and_one_copied_file_counts_once() {
    let coronal = |z| slice(z, 0).text(0x0020_0037, "DS", "1\\0\\0\\0\\0\\-1");
    let files = [("a", slice(0.0, 0)), ("b", slice(2.0, 12)), ("scout", coronal(0.0))];
    refused(series_of(&files, &Selection::default()), &["2 series: 5.1 «made» MR 4×3×2, 5.2 «made» MR 4×3×1"]);
    refused(series_of(&files, &series("1.2.3")), &["5.1 «made»", "choose one of them"]);
    assert_eq!(stored(&series_of(&files, &series("5.1")).unwrap()), from(0, 24));

    let named = |z, first, uid: &str| slice(z, first).text(0x0008_0018, "UI", uid);
    let files = [("a", named(0.0, 0, "1.1")), ("b", named(2.0, 12, "1.2")), ("copy of b", named(2.0, 12, "1.2"))];
    let volume = series_of(&files, &Selection::default()).unwrap();
    assert_eq!(volume.geometry.dims, [4, 3, 2]);
    assert!(volume.notes.iter().any(|note| note.contains("1 file is a copy of another")), "{:?}", volume.notes);
}

#[test]
fn a_folder_is_read_eight_levels_deep_and_says_what_it_skips() {
    let without_pixels = slice(0.0, 0).without(0x7fe0_0010).without(0x0028_0010);
    let files = [
        ("one/a", file(&slice(0.0, 0), EXPLICIT)),
        ("two/3/4/5/6/7/8/b", file(&slice(2.0, 12), EXPLICIT)),
        ("DICOMDIR", file(&without_pixels, EXPLICIT)),
        ("notes.txt", b"words".to_vec()),
        ("two/3/4/5/6/7/8/deeper/c", file(&slice(4.0, 24), EXPLICIT)),
    ];
    let volume = open(volumes::folder(&files).path(), &Selection::default()).unwrap();
    assert_eq!((volume.geometry.dims, volume.files.len()), ([4, 3, 2], 2));
    for words in ["file DICOMDIR has no pixels", "the file notes.txt is of another format", "1 folders are deeper"] {
        assert!(volume.notes.iter().any(|note| note.contains(words)), "{words}: {:?}", volume.notes);
    }
    // A damaged slice must not be missing without a word.
    let cut = file(&slice(4.0, 24), EXPLICIT)[..300].to_vec();
    let files = [("a", file(&slice(0.0, 0), EXPLICIT)), ("b", cut)];
    refused(open(volumes::folder(&files).path(), &Selection::default()), &["b, byte"]);
}

/// What a reading reports: stage, done, total.
#[derive(Default)]
struct Watch(std::sync::Mutex<Vec<(String, u64, u64)>>);

impl relume::progress::Progress for Watch {
    fn report(&self, stage: &str, done: u64, total: u64) {
        self.0.lock().unwrap().push((stage.to_owned(), done, total));
    }

    fn cancelled(&self) -> bool {
        false
    }
}

#[test]
fn a_folder_of_2000_slices_tells_how_far_it_is_from_its_first_file_on() {
    let folder = tempfile::tempdir().unwrap();
    for number in 0..2000_u16 {
        // Names in no order of the positions.
        let name = format!("{:04}", u32::from(number) * 7 % 2000);
        let bytes = file(&slice(f64::from(number) * 0.5, number), EXPLICIT);
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    let (watch, begun) = (Watch::default(), std::time::Instant::now());
    let volume = volume::open(folder.path(), &Selection::default(), &watch).unwrap();
    eprintln!("2000 slices of 4×3 pixels are read in {:.3} s", begun.elapsed().as_secs_f64());
    assert_eq!((volume.geometry.dims, volume.geometry.spacing.z), ([4, 3, 2000], 0.5));
    assert_eq!(stored(&volume)[12 * 1999..], from(1999, 12));
    let reports = watch.0.into_inner().unwrap();
    let is_listing = |(stage, ..): &&(String, u64, u64)| stage.starts_with("listing ");
    let listing: Vec<u64> = reports.iter().filter(is_listing).map(|&(_, done, _)| done).collect();
    assert_eq!((reports[0].1, listing.len()), (0, 2000), "one for each file, the first one at once");
    assert!(reports.iter().filter(is_listing).all(|&(_, done, total)| done < 2000 && total == 2000));
    let reading = reports.iter().filter(|(stage, ..)| stage.starts_with("reading ")).count();
    assert!(reading >= 2000, "and again as the pixels are read: {reading}");
}

#[test]
fn frames_of_a_deflated_file_are_read_in_the_order_of_the_file() {
    // Slices in another order than the frames, and frames of bits that share bytes.
    let heights = [4.0, 0.0, 2.0];
    let enhanced = slice(0.0, 0)
        .without(0x0020_0032)
        .text(0x0028_0008, "IS", "3")
        .items(0x5200_9230, heights.map(place).to_vec())
        .with(0x7fe0_0010, "OW", Written::Short((0..36).collect()));
    let volume = opened("v.dcm", &file(&enhanced, DEFLATED)).unwrap();
    assert_eq!(stored(&volume), [from(12, 12), from(24, 12), from(0, 12)].concat());
    let short = enhanced.with(0x7fe0_0010, "OW", Written::Short((0..30).collect()));
    refused(opened("v.dcm", &file(&short, DEFLATED)), &["60 bytes of voxels", "require 72"]);
    let bits = slice(0.0, 0)
        .text(0x0028_0008, "IS", "3")
        .without(0x0020_0032)
        .short(0x0028_0100, &[1])
        .short(0x0028_0101, &[1])
        .short(0x0028_0102, &[0])
        .with(0x7fe0_0010, "OB", Written::Bytes(vec![0x0f, 0xf0, 0xff, 0x01, 0x08]));
    for time in 0..3 {
        let selection = Selection { time: Some(time), ..Selection::default() };
        let read = |syntax| stored(&volumes::opened("v.dcm", &file(&bits, syntax), &selection).unwrap());
        assert_eq!(read(DEFLATED), read(EXPLICIT), "frame {time}");
    }
}

#[test]
fn a_damaged_file_of_another_series_is_skipped_with_a_warning() {
    let of = |series: &str, number: &str, place: f64, from: u16| {
        slice(place, from).text(0x0020_000e, "UI", series).text(0x0020_0011, "IS", number)
    };
    let whole = |series: &str, number: &str, place: f64, from: u16| file(&of(series, number, place, from), EXPLICIT);
    let cut = |bytes: Vec<u8>| bytes[..bytes.len() - 8].to_vec();
    let files = [
        ("a1", whole("1.2.3", "3", 0.0, 0)),
        ("a2", whole("1.2.3", "3", 2.0, 12)),
        ("b1", whole("1.2.34", "4", 0.0, 0)),
        ("b2", cut(whole("1.2.34", "4", 2.0, 12))),
    ];
    let folder = volumes::folder(&files);
    let series = |key: &str| Selection { series: Some(key.to_owned()), ..Selection::default() };
    let volume = open(folder.path(), &series("3")).unwrap();
    assert_eq!(volume.geometry.dims, [4, 3, 2]);
    let notes = volume.notes.join(" ");
    assert!(notes.contains("1 damaged DICOM file is not of this series, and skipped; it is b2 ("), "{notes}");
    // A damaged slice must not be missing without a word.
    refused(open(folder.path(), &series("4")), &["b2"]);
    // All series are listed.
    refused(open(folder.path(), &Selection::default()), &["2 series", "choose one of them"]);
}

#[cfg(unix)]
#[test]
fn a_folder_that_cannot_be_listed_is_skipped_with_a_warning() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = volumes::folder(&[("a", file(&slice(0.0, 0), EXPLICIT)), ("private/b", b"words".to_vec())]);
    let private = folder.path().join("private");
    std::fs::set_permissions(&private, std::fs::Permissions::from_mode(0o000)).unwrap();
    if std::fs::read_dir(&private).is_ok() {
        eprintln!("this user lists every folder, this test ran on nothing");
        return;
    }
    let volume = open(folder.path(), &Selection::default()).unwrap();
    std::fs::set_permissions(&private, std::fs::Permissions::from_mode(0o700)).unwrap();
    let notes = volume.notes.join(" ");
    assert!(notes.contains("the folder private (") && notes.contains("cannot be listed, and is skipped"), "{notes}");
}

#[test]
fn frames_without_positions_are_times_and_colours_are_components() {
    let frames = slice(0.0, 0).text(0x0028_0008, "IS", "3").without(0x0020_0032).with(
        0x7fe0_0010,
        "OW",
        Written::Short((0..36).collect()),
    );
    for syntax in [EXPLICIT, DEFLATED] {
        let bytes = file(&frames, syntax);
        refused(opened("v.dcm", &bytes), &["3 time steps"]);
        let second = volumes::opened("v.dcm", &bytes, &Selection { time: Some(1), ..Selection::default() }).unwrap();
        assert_eq!((stored(&second), second.anatomical), (from(12, 12), false));
    }
    let colours = |planar: u16, pixels: Vec<u8>| {
        slice(0.0, 0)
            .short(0x0028_0002, &[3])
            .text(0x0028_0004, "CS", "RGB")
            .short(0x0028_0006, &[planar])
            .short(0x0028_0100, &[8])
            .short(0x0028_0101, &[8])
            .short(0x0028_0102, &[7])
            .with(0x7fe0_0010, "OB", Written::Bytes(pixels))
    };
    let planes: Vec<u8> = (0..36).collect();
    let side_by_side = (0..36).map(|index| index / 3 + 12 * (index % 3)).collect();
    for bytes in [file(&colours(1, planes), EXPLICIT), file(&colours(0, side_by_side), EXPLICIT)] {
        refused(opened("v.dcm", &bytes), &["3 components per voxel (RGB)"]);
        let green =
            volumes::opened("v.dcm", &bytes, &Selection { component: Some(1), ..Selection::default() }).unwrap();
        assert_eq!((stored(&green), green.components), (from(12, 12), 3));
    }
}

#[test]
fn doses_have_the_places_and_the_scaling_of_their_own_elements() {
    let dose = slice(10.0, 0)
        .text(0x0028_0008, "IS", "2")
        .short(0x0028_0100, &[32])
        .short(0x0028_0101, &[32])
        .short(0x0028_0102, &[31])
        .text(0x3004_000c, "DS", "0\\2.5")
        .text(0x3004_000e, "DS", "0.001")
        .with(0x7fe0_0010, "OW", Written::Long((0..24).map(|index| 100_000 * index).collect()));
    let volume = opened("v.dcm", &file(&dose, EXPLICIT)).unwrap();
    assert_eq!((volume.geometry.dims, volume.geometry.spacing.z), ([4, 3, 2], 2.5));
    assert_eq!((volume.voxels.type_name(), volume.slope), ("uint32", 0.001));
    assert_eq!(volume.value([3, 2, 1]), Some(2300.0));
    // The same in RLE, whose planes begin with the most significant byte.
    let plane = |frame: u32, byte: u32| -> Vec<u8> {
        (0..12).map(|index| (100_000_u32 * (12 * frame + index)).to_be_bytes()[byte as usize]).collect()
    };
    let frame = |frame: u32| rle(&[0, 1, 2, 3].map(|byte| plane(frame, byte)));
    let dose = dose.with(0x7fe0_0010, "OB", Written::Fragments(vec![Vec::new(), frame(0), frame(1)]));
    assert_eq!(opened("v.dcm", &file(&dose, RLE)).unwrap().voxels, volume.voxels);
}

#[test]
fn frames_of_an_enhanced_file_lie_where_their_groups_place_them() {
    let heights = [4.0, 0.0, 2.0];
    let enhanced = slice(0.0, 0)
        .without(0x0020_0032)
        .text(0x0028_0008, "IS", "3")
        .items(0x5200_9230, heights.map(place).to_vec())
        .with(0x7fe0_0010, "OW", Written::Short((0..36).collect()));
    let volume = opened("v.dcm", &file(&enhanced, EXPLICIT)).unwrap();
    assert_eq!(stored(&volume), [from(12, 12), from(24, 12), from(0, 12)].concat());
    // PS3.5, §6.2.2, note 2: an archive that does not know the sequence keeps it as implicit bytes.
    let item = |z: f64| {
        let item = place(z).bytes(true, false);
        [&[0xfe, 0xff, 0x00, 0xe0][..], &u32::try_from(item.len()).unwrap().to_le_bytes(), &item].concat()
    };
    let unknown = enhanced.clone().with(0x5200_9230, "UN", Written::Bytes(heights.map(item).concat()));
    assert_eq!(stored(&opened("v.dcm", &file(&unknown, EXPLICIT)).unwrap()), stored(&volume));
    let items = heights[..2].iter().map(|&z| place(z)).collect();
    let few = enhanced.items(0x5200_9230, items);
    refused(opened("v.dcm", &file(&few, EXPLICIT)), &["PerFrameFunctionalGroupsSequence", "2 items for 3 frames"]);
}

#[test]
fn segments_are_labels_whose_bits_run_across_frames() {
    let one = |set: &[usize]| std::array::from_fn(|index| u8::from(set.contains(&index)));
    // From the far end, and without the slice in the middle.
    let frames = [(1, 6.0, one(&[0, 8])), (1, 2.0, one(&[4])), (1, 0.0, one(&[1])), (2, 6.0, one(&[8, 3]))];
    let volume = opened("v.dcm", &file(&segmentation("BINARY", &frames), EXPLICIT)).unwrap();
    assert!(volume.has_labels && volume.geometry.dims == [3, 3, 4], "{:?}", volume.geometry);
    let labelled: Vec<(usize, f64)> =
        stored(&volume).into_iter().enumerate().filter(|(_, label)| *label > 0.0).collect();
    assert_eq!(labelled, [(1, 1.0), (9 + 4, 1.0), (27, 1.0), (27 + 3, 2.0), (27 + 8, 2.0)]);
    assert!(volume.notes.iter().any(|note| note.contains("overlap in 1 voxels")), "{:?}", volume.notes);
    let names: Vec<&str> = volume.presets.labels.iter().map(|label| label.name.as_str()).collect();
    assert_eq!(names, ["liver", "spleen"]);
    // L* 100, a* and b* 0.
    let colour = volume.presets.labels[0].colour.unwrap();
    assert!(colour.iter().all(|part| (part - 1.0).abs() < 0.005), "{colour:?}");

    let fractions = [(1, 0.0, [100; 9]), (2, 0.0, [200; 9]), (2, 2.0, [50; 9])];
    let bytes = file(&segmentation("FRACTIONAL", &fractions), EXPLICIT);
    refused(opened("v.dcm", &bytes), &["the arrays liver, spleen"]);
    let selection = Selection { array: Some("spleen".to_owned()), ..Selection::default() };
    let volume = volumes::opened("v.dcm", &bytes, &selection).unwrap();
    assert_eq!((volume.geometry.dims, volume.has_labels), ([3, 3, 2], false));
    assert_eq!((volume.value([0, 0, 0]), volume.value([2, 2, 1])), (Some(1.0), Some(0.25)));

    let map = [(1, 0.0, [0, 1, 2, 3, 4, 5, 6, 7, 8]), (1, 2.0, [9; 9])];
    let volume = opened("v.dcm", &file(&segmentation("LABELMAP", &map), EXPLICIT)).unwrap();
    assert_eq!((stored(&volume), volume.has_labels), ([from(0, 9), vec![9.0; 9]].concat(), true));
    let placeless = segmentation("LABELMAP", &map).without(0x5200_9230);
    refused(opened("v.dcm", &file(&placeless, EXPLICIT)), &["the 2 frames state no places"]);
    refused(opened("v.dcm", &file(&segmentation("SURFACE", &map), EXPLICIT)), &["SegmentationType", "SURFACE"]);
}

#[test]
fn a_sequence_of_unknown_type_and_length_is_implicit_inside() {
    // PS3.5, §6.2.2, note 2: an archive that does not know a private sequence keeps it like this.
    let mut bytes = vec![0x09, 0, 1, 0x10, b'U', b'N', 0, 0, 0xff, 0xff, 0xff, 0xff];
    bytes.extend([0xfe, 0xff, 0x00, 0xe0, 0xff, 0xff, 0xff, 0xff]);
    bytes.extend([0x08, 0, 0x60, 0, 2, 0, 0, 0, b'C', b'T']);
    bytes.extend([0xfe, 0xff, 0x0d, 0xe0, 0, 0, 0, 0, 0xfe, 0xff, 0xdd, 0xe0, 0, 0, 0, 0]);
    let whole = file(&slice(0.0, 5).without(0x0008_0060).without(0x0008_103e), EXPLICIT);
    let meta = file(&Elements::default(), EXPLICIT).len();
    let volume = opened("v.dcm", &[&whole[..meta], &bytes, &whole[meta..]].concat()).unwrap();
    assert_eq!(stored(&volume), from(5, 12));
    assert!(!volume.metadata.iter().any(|(_, value)| value == "CT"), "that of the sequence is not that of the file");
}

#[test]
fn damaged_structure_is_refused_with_the_place_and_both_numbers() {
    let meta = file(&Elements::default(), EXPLICIT);
    let with = |bytes: &[u8]| [&meta, bytes].concat();
    let sequence = |length: u32| [&[0x62, 0, 0x02, 0, b'S', b'Q', 0, 0][..], &length.to_le_bytes()].concat();
    let item = |length: u32| [&[0xfe, 0xff, 0x00, 0xe0][..], &length.to_le_bytes()].concat();
    let mut nested = Vec::new();
    for _ in 0..60_000 {
        nested.extend(sequence(u32::MAX));
        nested.extend(item(u32::MAX));
    }
    refused(opened("v.dcm", &with(&nested)), &["more than 32 nested sequences"]);
    let long = [sequence(28), item(20), vec![0x08, 0, 0x60, 0, b'L', b'O', 100, 0], vec![b' '; 212]].concat();
    refused(opened("v.dcm", &with(&long)), &["Modality (0008,0060) states 100 bytes, but only 12 bytes are left"]);
    let beyond = [sequence(28), item(40), vec![0; 100]].concat();
    refused(opened("v.dcm", &with(&beyond)), &["an item of", "ends at byte", "but its sequence ends at byte"]);
    let stray = [sequence(u32::MAX), vec![0xfe, 0xff, 0x0d, 0xe0, 0, 0, 0, 0], item(0)].concat();
    refused(opened("v.dcm", &with(&stray)), &["stands where an item of"]);
    let huge = [0x28, 0, 0x30, 0, b'O', b'B', 0, 0, 0, 0, 0, 0xad];
    refused(opened("v.dcm", &with(&huge)), &["PixelSpacing (0028,0030) states 2902458368 bytes, but only"]);
    let value = [&[0x08, 0, 0x3e, 0x10, b'U', b'T', 0, 0, 0, 0, 0x20, 0][..], &vec![b' '; 1 << 21]].concat();
    refused(opened("v.dcm", &with(&value)), &["SeriesDescription", "2097152 bytes; Relume reads at most 1048576"]);
    for length in [0, 100, 131, 132, meta.len(), meta.len() + 5, meta.len() + 40] {
        let whole = file(&slice(0.0, 0), EXPLICIT);
        let error = opened("v.dcm", &whole[..length]).map(|volume| volume.voxels).unwrap_err();
        assert!(!error.to_string().contains('\n'), "{length} bytes: {error}");
    }
}

#[test]
fn what_cannot_be_read_is_refused_by_name_with_the_numbers() {
    let read = |elements: &Elements| opened("v.dcm", &file(elements, EXPLICIT));
    let base = || slice(0.0, 0);
    let cases: [(Elements, &[&str]); 19] = [
        (base().without(0x0028_0010), &["Rows (0028,0010)", "missing"]),
        (base().short(0x0028_0011, &[0]), &["Columns (0028,0011)", "the number is 0; it must be from 1 to 65535"]),
        (base().short(0x0028_0100, &[12]).short(0x0028_0101, &[12]).short(0x0028_0102, &[11]), &["pixels of 12 bits"]),
        (base().short(0x0028_0101, &[17]), &["BitsStored", "17", "from 1 to 16"]),
        (base().short(0x0028_0102, &[16]), &["HighBit", "16"]),
        (base().short(0x0028_0103, &[2]), &["PixelRepresentation", "2"]),
        (base().text(0x0028_0004, "CS", "PALETTE COLOR"), &["palette"]),
        (base().short(0x0028_0010, &[4]), &["24 bytes of voxels", "require 32"]),
        (base().text(0x0028_0008, "IS", "2000000000"), &["24 bytes of voxels", "48000000000"]),
        (base().text(0x0028_0008, "IS", "0"), &["NumberOfFrames", "0 frames"]),
        (base().text(0x0028_0008, "IS", "many"), &["NumberOfFrames", "NaN frames"]),
        (base().text(0x0028_1053, "DS", "0"), &["RescaleSlope", "slope is 0"]),
        (base().text(0x0020_0032, "DS", "1\\2"), &["ImagePositionPatient", "[1.0, 2.0]", "3 finite"]),
        (base().text(0x0020_0032, "DS", "1\\2\\1e999"), &["ImagePositionPatient", "inf"]),
        (base().text(0x0020_0037, "DS", "1\\0\\0\\1\\0\\0"), &["ImageOrientationPatient", "orthogonal"]),
        (base().text(0x0020_0037, "DS", "2\\0\\0\\0\\1\\0"), &["ImageOrientationPatient", "unit"]),
        (base().text(0x0028_0030, "DS", "-1\\1"), &["PixelSpacing", "-1 1"]),
        (base().without(0x7fe0_0010), &["PixelData", "states 3 rows, but has no pixels"]),
        (base().short(0x0028_0002, &[5]), &["SamplesPerPixel", "from 1 to 4"]),
    ];
    for (elements, words) in cases {
        refused(read(&elements), words);
    }
    let pixels = |fragments: Vec<Vec<u8>>| base().with(0x7fe0_0010, "OB", Written::Fragments(fragments));
    let one = |bytes: &[u8]| pixels(vec![Vec::new(), bytes.to_vec()]);
    for (syntax, name) in [
        ("1.2.840.10008.1.2.4.201", "High-Throughput JPEG 2000"),
        ("1.2.840.10008.1.2.4.110", "JPEG XL"),
        ("1.2.840.10008.1.2.4.102", "video"),
        ("1.2.840.10008.1.2.4.55", "a retired or unknown kind of JPEG"),
        ("1.2.3.4", "an unknown coding"),
    ] {
        refused(opened("v.dcm", &file(&one(&[0; 100]), syntax)), &["TransferSyntaxUID", name, syntax]);
    }
    let coded =
        |syntax: &str, bytes: &[u8], words: &[&str]| drop(refused(opened("v.dcm", &file(&one(bytes), syntax)), words));
    let (jpeg, jpeg_ls, jpeg_2000) = ("1.2.840.10008.1.2.4.51", "1.2.840.10008.1.2.4.80", "1.2.840.10008.1.2.4.90");
    let frame =
        |marker: u8, bits: u8, rows: u8| vec![0xff, 0xd8, 0xff, marker, 0, 11, bits, 0, rows, 0, 4, 1, 1, 0x11, 0];
    coded(jpeg, &frame(0xc1, 12, 3), &["frame 1", "12 bits by DCT; Relume decodes 8"]);
    coded(jpeg, &frame(0xc9, 8, 3), &["JPEG of the kind ffc9"]);
    coded(jpeg, &frame(0xc0, 8, 9), &["4×9 pixels, but the header states 4×3"]);
    coded(jpeg, &[0; 20], &["no JPEG frame header"]);
    coded(jpeg_ls, &frame(0xf7, 12, 7), &["4×7 pixels, but the header states 4×3"]);
    coded(jpeg_ls, &frame(0xf7, 17, 3), &["17 bits per number, but the header allocates 16"]);
    coded(jpeg_2000, &[0; 20], &["no JPEG 2000 codestream"]);
    coded(RLE, &rle(&[vec![1; 12]]), &["1 RLE segments; 2 are needed"]);
    coded(RLE, &rle(&[vec![1; 12], vec![1; 11]]), &["RLE segment 1 has 11 bytes; 12 are needed"]);
    let mut outside = rle(&[vec![1; 12], vec![1; 12]]);
    outside[8] = 250;
    coded(RLE, &outside, &["RLE segment 0 lies from byte 64 to 250 of a frame of"]);
    // Three fragments of two frames.
    let frames = pixels(vec![Vec::new(), vec![0; 4], vec![0; 4], vec![0; 4]]).text(0x0028_0008, "IS", "2");
    let first = Selection { time: Some(0), ..Selection::default() };
    refused(volumes::opened("v.dcm", &file(&frames, RLE), &first), &["3 fragments for 2 frames"]);
    let piece = base().with(0x7fe0_0010, "OB", Written::Bytes(vec![0; 64]));
    refused(opened("v.dcm", &file(&piece, RLE)), &["64 bytes of compressed pixels are in one piece"]);
    // A large frame in a few bytes.
    let large = one(&[0; 8]).short(0x0028_0010, &[9000]).short(0x0028_0011, &[9000]);
    refused(opened("v.dcm", &file(&large, RLE)), &["162000000 bytes", "at most 64"]);
    // As many frames as a coding without a decoder may state.
    let many = piece.text(0x0028_0008, "IS", "9000000");
    refused(opened("v.dcm", &file(&many, "1.2.3")), &["9000000 frames", "1 to 1000000"]);
    let part = base().text(0x0028_0008, "IS", "1.5");
    refused(opened("v.dcm", &file(&part, EXPLICIT)), &["1.5 frames"]);
    // A capture in colours of a palette, in a folder with a series.
    let capture =
        base().text(0x0028_0004, "CS", "PALETTE COLOR").text(0x0020_000e, "UI", "7.8").text(0x0020_0011, "IS", "9");
    let all = [("a", slice(0.0, 0)), ("b", slice(2.0, 12)), ("c", capture)];
    assert_eq!(series_of(&all, &series("5")).unwrap().geometry.dims, [4, 3, 2]);
    refused(series_of(&all, &series("9")), &["palette"]);
    // Slices without a position.
    let lost = || slice(0.0, 0).without(0x0020_0032);
    refused(series_of(&[("a", lost()), ("b", lost())], &Selection::default()), &["2 of 2 slices state no position"]);
}

#[test]
fn codestreams_of_jpeg_ls_have_the_numbers_of_charls() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/jpegls.bundle");
    let files = volumes::unbundled(&std::fs::read(path).unwrap());
    assert_eq!(files.len(), 3 * 4 * 2 * 2, "codestreams and numbers");
    let elements = |bits: u16, code: &[u8]| {
        let allocated = if bits == 8 { 8 } else { 16 };
        slice(0.0, 0)
            .short(0x0028_0010, &[23])
            .short(0x0028_0011, &[31])
            .short(0x0028_0100, &[allocated])
            .short(0x0028_0101, &[allocated])
            .short(0x0028_0102, &[allocated - 1])
            .with(0x7fe0_0010, "OB", Written::Fragments(vec![Vec::new(), code.to_vec()]))
    };
    let lossy = "1.2.840.10008.1.2.4.81";
    for pair in files.chunks(2) {
        let [(name, code), (_, numbers)] = pair else { panic!("a codestream and its numbers") };
        let bits = name.split('-').next().unwrap().parse().unwrap();
        let volume =
            opened("v.dcm", &file(&elements(bits, code), lossy)).unwrap_or_else(|error| panic!("{name}: {error}"));
        let expected: Vec<f64> =
            numbers.as_chunks::<2>().0.iter().map(|&word| u16::from_le_bytes(word).into()).collect();
        assert!(stored(&volume) == expected, "{name}");
        // Cut anywhere, it ends early or has no end.
        for length in [code.len() / 3, code.len() / 2, code.len() * 3 / 4] {
            let cut = opened("v.dcm", &file(&elements(bits, &code[..length / 2 * 2]), lossy));
            assert!(cut.is_err(), "{name} of {length} bytes");
        }
    }
}

#[test]
fn fragments_are_those_of_a_frame_by_offsets_or_marks() {
    let frame = |first: u8| rle(&[vec![0; 12], (first..first + 12).collect()]);
    let (one, two) = (frame(0), frame(50));
    let half = one.len() / 2 / 2 * 2;
    let table =
        [0_u32, u32::try_from(one.len() + 16).unwrap()].iter().flat_map(|offset| offset.to_le_bytes()).collect();
    let parts = vec![table, one[..half].to_vec(), one[half..].to_vec(), two.clone()];
    let frames =
        |fragments| slice(0.0, 0).text(0x0028_0008, "IS", "2").with(0x7fe0_0010, "OB", Written::Fragments(fragments));
    let read = |elements: &Elements, time| {
        let selection = Selection { time: Some(time), ..Selection::default() };
        stored(&volumes::opened("v.dcm", &file(elements, RLE), &selection).unwrap())
    };
    let by_table = frames(parts.clone());
    assert_eq!((read(&by_table, 0), read(&by_table, 1)), (from(0, 12), from(50, 12)));
    let one_each = frames(vec![Vec::new(), one, two]);
    assert_eq!((read(&one_each, 0), read(&one_each, 1)), (from(0, 12), from(50, 12)));
    // The extended table holds offsets of eight bytes.
    let offsets: Vec<u32> =
        parts[0].as_chunks::<4>().0.iter().flat_map(|&word| [u32::from_le_bytes(word), 0]).collect();
    let extended =
        frames([vec![Vec::new()], parts[1..].to_vec()].concat()).with(0x7fe0_0001, "OV", Written::Long(offsets));
    assert_eq!((read(&extended, 0), read(&extended, 1)), (from(0, 12), from(50, 12)));
}
