//! Volumes written as NRRD, `MetaImage` and `NIfTI` read back with the same voxels, geometry and values.

use crate::support;

use glam::{DMat3, DQuat, DVec3};
use relume::output::{OutputError, VolumeKind, write_volume};
use relume::progress::{Progress, Quiet};
use relume::volume::{self, Geometry, LabelPreset, Selection, Unit, Volume, VoxelType, Voxels, Window};
use support::program::Folder;

const FORMATS: [&str; 4] = ["v.nrrd", "v.mha", "v.nii", "v.nii.gz"];

/// 3×2×2 voxels on an oblique grid of a left-handed world.
fn oblique(voxels: Voxels) -> Volume {
    let turn = DMat3::from_quat(DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 3.0).normalize(), 0.7));
    let direction = turn * DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0));
    let (spacing, origin) = (DVec3::new(0.7, 1.1, 2.5), DVec3::new(-12.25, 30.5, 100.125));
    let geometry = Geometry::new("made", [3, 2, 2], spacing, origin, direction).unwrap();
    let mut volume = Volume::new("made", voxels, geometry).unwrap();
    (volume.anatomical, volume.unit) = (true, Some(Unit::Millimetre));
    volume
}

/// Writes and reads.
fn again(name: &str, volume: &Volume) -> Volume {
    let read = again_with_notes(name, volume);
    assert!(read.notes.is_empty(), "{name}: {:?}", read.notes);
    read
}

fn again_with_notes(name: &str, volume: &Volume) -> Volume {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write_volume(&path, volume, &Quiet).unwrap();
    volume::open(&path, &Selection::default(), &Quiet).unwrap()
}

/// NIfTI-1 has geometry of 32 bits.
fn limit(name: &str) -> f64 {
    if name.contains("nii") { 1e-6 } else { 1e-14 }
}

fn assert_same_place(name: &str, ours: &Geometry, theirs: &Geometry) {
    let limit = limit(name);
    assert_eq!(ours.dims, theirs.dims, "{name}");
    assert!(ours.spacing.abs_diff_eq(theirs.spacing, limit), "{name}: {}", ours.spacing);
    assert!(ours.origin.abs_diff_eq(theirs.origin, 100.0 * limit), "{name}: {}", ours.origin);
    assert!(ours.direction.abs_diff_eq(theirs.direction, limit), "{name}: {}", ours.direction);
}

#[test]
fn every_type_reads_back_in_its_place() {
    macro_rules! check {
        ($($type:ident $variant:ident),*) => {$({
            let mut values: Vec<$type> = vec![<$type>::default(); 12];
            (values[1], values[2], values[3]) = ($type::MIN, $type::MAX, "7".parse().unwrap());
            let volume = oblique(Voxels::$variant(values));
            for name in FORMATS {
                let read = again(name, &volume);
                assert!(read.voxels == volume.voxels, "{name} of {}", volume.voxels.type_name());
                assert_same_place(name, &read.geometry, &volume.geometry);
                assert_eq!((read.anatomical, read.unit), (true, Some(Unit::Millimetre)), "{name}");
            }
        })*};
    }
    check!(u8 U8, i8 I8, u16 U16, i16 I16, u32 U32, i32 I32, u64 U64, i64 I64, f32 F32, f64 F64);
}

#[test]
fn slope_and_intercept_keep_the_values() {
    // The second pair needs more than 32 bits.
    for (slope, intercept) in [(-0.5, 1024.0), (0.1, 1e-9)] {
        let mut volume = oblique(Voxels::I16((-6..6).collect()));
        (volume.slope, volume.intercept) = (slope, intercept);
        for name in FORMATS {
            let read = again(name, &volume);
            for index in (0..3).flat_map(|x| (0..2).flat_map(move |y| (0..2).map(move |z| [x, y, z]))) {
                assert_eq!(read.value(index), volume.value(index), "{name} at {index:?}");
            }
            let kept = if name.contains("nii") { "int16" } else { "float64" };
            assert_eq!(read.voxels.type_name(), kept, "{name}");
        }
    }
}

#[test]
fn a_slope_of_0_keeps_its_one_value() {
    let mut volume = oblique(Voxels::I16((-6..6).collect()));
    (volume.slope, volume.intercept) = (0.0, 7.0);
    for name in FORMATS {
        let read = again(name, &volume);
        assert_eq!((read.value([0, 0, 0]), read.value([2, 1, 1])), (Some(7.0), Some(7.0)), "{name}");
    }
}

#[test]
fn names_and_colours_of_labels_go_into_nrrd() {
    let mut volume = oblique(Voxels::U8((0..12).collect()));
    let label = |value, name: &str, colour| LabelPreset { value, name: name.to_owned(), colour };
    volume.presets.labels =
        vec![label(1, "left kidney", Some([0.1, 1.0, 0.25])), label(3, "C:\\new\nline", None), label(-2, "", None)];
    volume.has_labels = true;
    let read = again("v.nrrd", &volume);
    assert_eq!((read.presets.labels, read.has_labels), (volume.presets.labels.clone(), true));
    let folder = tempfile::tempdir().unwrap();
    let notes = |name: &str| write_volume(&folder.path().join(name), &volume, &Quiet).unwrap().notes.join("; ");
    assert_eq!(notes("v.nrrd"), "");
    assert!(notes("v.nii").contains("names and colours"), "{}", notes("v.nii"));
    assert!(notes("v.mha").contains("does not say that its voxels are labels"), "{}", notes("v.mha"));
}

#[test]
fn what_is_written_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let mut volume = oblique(Voxels::I16((-6..6).collect()));
    volume.slope = 0.5;
    let written = |volume: &Volume, name: &str| write_volume(&folder.path().join(name), volume, &Quiet).unwrap();
    let nrrd = written(&volume, "v.nrrd");
    assert_eq!(nrrd.voxel_type, VoxelType::F64);
    assert!(nrrd.notes[0].contains("float64, 4 times as large as int16"), "{:?}", nrrd.notes);
    assert_eq!(written(&volume, "v.nii").voxel_type, VoxelType::I16);
    assert!(written(&volume, "v.nii").notes.is_empty());
    (volume.anatomical, volume.unit) = (false, Some(Unit::Angstrom));
    assert!(written(&volume, "v.nii").notes[0].contains("anatomical"));
    assert!(written(&volume, "v.mha").notes[1].contains("unit Å"));
}

#[test]
fn a_grid_of_spacings_alone_does_not_become_anatomical() {
    let spacing = DVec3::new(0.5, 2.0, 3.0);
    let geometry = Geometry::new("made", [3, 2, 2], spacing, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    let volume = Volume::new("made", Voxels::U8((0..12).collect()), geometry).unwrap();
    for name in FORMATS {
        let read = again_with_notes(name, &volume);
        assert!(!read.anatomical, "{name}");
        assert_same_place(name, &read.geometry, &volume.geometry);
        let expected = usize::from(name.contains("nii"));
        assert_eq!(read.notes.len(), expected, "{name}: {:?}", read.notes);
    }
}

#[test]
fn units_windows_and_labels_go_where_the_format_has_them() {
    let mut volume = oblique(Voxels::U8((0..12).collect()));
    (volume.has_labels, volume.anatomical) = (true, false);
    volume.presets.windows.extend(Window::new("bone", 2.0, 9.0));
    for (unit, factor) in [
        (None, 1.0),
        (Some(Unit::Centimetre), 10.0),
        (Some(Unit::Millimetre), 1.0),
        (Some(Unit::Micrometre), 1e-3),
        (Some(Unit::Nanometre), 1e-6),
        (Some(Unit::Angstrom), 1e-7),
    ] {
        volume.unit = unit;
        for name in ["v.nrrd", "v.mha"] {
            let read = again(name, &volume);
            // MetaIO has no names for the smallest units.
            let has_name = name == "v.nrrd" || !matches!(unit, Some(Unit::Nanometre | Unit::Angstrom));
            assert_eq!((read.unit, read.anatomical), (unit.filter(|_| has_name), false), "{name}");
            assert_same_place(name, &read.geometry, &volume.geometry);
        }
        let read = again("v.nii", &volume);
        let [found, expected] = [read.geometry.spacing / factor, volume.geometry.spacing];
        assert!(found.abs_diff_eq(expected, 1e-6), "{unit:?}: {found}, not {expected}");
        assert!(read.has_labels);
        let window = &read.presets.windows[0];
        assert_eq!((window.low, window.high), (2.0, 9.0));
    }
}

#[test]
fn an_axis_too_long_for_the_first_version_of_nifti_is_written_in_the_second() {
    let geometry = Geometry::unit("long", [40_000, 1, 1]).unwrap();
    let volume = Volume::new("long", Voxels::U8(vec![3; 40_000]), geometry).unwrap();
    let read = again_with_notes("v.nii.gz", &volume);
    assert!(read.notes.iter().all(|note| note.contains("no orientation")), "{:?}", read.notes);
    assert_eq!((read.geometry.dims, read.voxels), ([40_000, 1, 1], volume.voxels));
}

#[test]
fn an_unknown_extension_and_a_cancelled_write_leave_nothing() {
    struct Never;
    impl Progress for Never {
        fn report(&self, _stage: &str, _done: u64, _total: u64) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let volume = oblique(Voxels::U8(vec![0; 12]));
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let error = write_volume(&path("v.tif"), &volume, &Quiet).unwrap_err();
    assert!(matches!(error, OutputError::VolumeKind { .. }) && error.to_string().contains(".nii.gz"), "{error}");
    assert_eq!(VolumeKind::of(&path("V.NII.GZ")).unwrap(), VolumeKind::NiftiGzip);
    let error = write_volume(&path("v.nrrd"), &volume, &Never).unwrap_err();
    assert!(matches!(error, OutputError::Cancelled { .. }), "{error}");
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no file is left behind");
}

#[test]
fn the_command_writes_the_chosen_volume_and_refuses_before_it_reads() {
    let folder = Folder::new().with("v.raw", [1, 2, 3, 4, 5, 6, 7, 8]);
    let raw = ["--dims", "2x2x2", "--type", "uint8", "--spacing", "1x2x3"];
    let outcome = folder.done(&[&["convert", "v.raw", "v.nii.gz", "--json"][..], &raw].concat());
    assert_eq!(outcome.json()["dims"], serde_json::json!([2, 2, 2]));
    folder.done(&["convert", "v.nii.gz", "w.mha"]);
    folder.done(&["convert", "w.mha", "x.nrrd"]);
    let read = volume::open(&folder.path("x.nrrd"), &Selection::default(), &Quiet).unwrap();
    assert_eq!(
        (read.voxels.bytes(), read.geometry.spacing),
        (&[1, 2, 3, 4, 5, 6, 7, 8][..], DVec3::new(1.0, 2.0, 3.0))
    );
    folder.done(&["convert", "x.nrrd", "y.nrrd", "--downsample", "2x1x1"]);
    folder.refused(2, &["convert", "x.nrrd", "x.nrrd", "--downsample", "2x1x1"], &["x.nrrd is an input"]);
    folder.refused(2, &["convert", "x.nrrd", "x.png"], &["x.png", ".nrrd, .mha, .nii or .nii.gz"]);
    folder.refused(1, &["convert", "missing.nrrd", "out.nrrd"], &["missing.nrrd"]);
}

#[test]
fn info_shows_the_unit_and_the_windows_of_a_file() {
    let folder = Folder::new();
    let mut volume = oblique(Voxels::U8((0..12).collect()));
    volume.presets.windows.extend(Window::new("bone", 2.0, 9.0));
    volume.has_labels = true;
    write_volume(&folder.path("v.nii"), &volume, &Quiet).unwrap();
    let said = folder.done(&["info", "v.nii"]).out;
    for words in ["2.5 mm", "2 to 9", "labels", "scanner (1)"] {
        assert!(said.contains(words), "{words}: {said}");
    }
    let json = folder.done(&["info", "v.nii", "--json"]).json();
    assert_eq!((&json["unit"], &json["has_labels"]), (&"mm".into(), &true.into()));
    assert_eq!((&json["windows"][0]["low"], &json["windows"][0]["high"]), (&2.0.into(), &9.0.into()));
}
