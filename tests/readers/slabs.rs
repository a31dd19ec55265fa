//! Bricks of every format that is read slice by slice: their voxels, places and scales are those of the volume read whole.

use std::path::{Path, PathBuf};

use relume::output::write_bricks;
use relume::progress::Quiet;
use relume::volume::{self, Selection, Several, Volume, VolumeError};

use crate::support::dicom::{EXPLICIT, file, segmentation, slice};
use crate::support::volumes;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// The files of a folder of test data.
fn all(name: &str) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(data(name)).unwrap().map(|it| it.unwrap().path()).collect();
    files.sort_unstable();
    files
}

/// The last of each choice that the file leaves open, and its volume.
fn chosen(path: &Path) -> (Selection, Volume) {
    let mut selection = Selection { level: Some(0), ..Selection::default() };
    loop {
        match volume::open(path, &selection, &Quiet) {
            Ok(volume) => return (selection, volume),
            Err(VolumeError::Choose { there, .. }) => match there {
                Several::Components { count, .. } => selection.component = Some(count - 1),
                Several::Times(count) => selection.time = Some(count - 1),
                Several::Steps { values, .. } => selection.time = Some(values.len() - 1),
                Several::Arrays(names) => selection.array = names.last().cloned(),
                Several::Series(all) => selection.series = all.last().map(|series| series.key.clone()),
                there => panic!("{}: {there}", path.display()),
            },
            Err(VolumeError::AxesUnknown { .. }) => selection.axes = Some("czyx".to_owned()),
            Err(error) => panic!("{}: {error}", path.display()),
        }
    }
}

/// The error of making bricks with this memory, or the volume in them.
fn bricks(path: &Path, selection: &Selection, budget: u64) -> Result<Volume, String> {
    let folder = tempfile::tempdir().unwrap();
    let made = folder.path().join("v.bricks");
    write_bricks(&made, (path, None), selection, budget, &Quiet).map_err(|error| error.to_string())?;
    Ok(volume::open(&made, &Selection::default(), &Quiet).unwrap())
}

/// Compares bricks that are made slice by slice and at once with the volume read whole.
fn assert_same(path: &Path) -> Selection {
    let (selection, whole) = chosen(path);
    for budget in [1, u64::MAX] {
        let read = bricks(path, &selection, budget).unwrap_or_else(|error| panic!("{error}"));
        let name = format!("{} with {budget} bytes", path.display());
        assert!(read.voxels.voxel_type() == whole.voxels.voxel_type(), "{name}: {:?}", read.voxels);
        assert!(read.voxels.bytes() == whole.voxels.bytes(), "{name}");
        assert_eq!(
            (read.geometry, read.unit, read.anatomical),
            (whole.geometry, whole.unit, whole.anatomical),
            "{name}"
        );
        assert_eq!((read.slope, read.intercept), (whole.slope, whole.intercept), "{name}");
        assert_eq!((&read.presets, read.has_labels), (&whole.presets, whole.has_labels), "{name}");
        assert_eq!((read.components, &read.component_names), (whole.components, &whole.component_names), "{name}");
        assert_eq!(read.assumed_spacing, whole.assumed_spacing, "{name}");
        let mut metadata = read.metadata.clone();
        metadata.retain(|(key, _)| key != "bricks of");
        let expected = whole.metadata.iter().filter(|(key, _)| key != "pyramid" && key != "level");
        assert!(metadata.iter().eq(expected), "{name}: {metadata:?}, {:?}", whole.metadata);
    }
    selection
}

#[test]
fn bricks_of_zarr_stores_are_those_of_the_volume() {
    for bundle in all("zarr") {
        assert_same(volumes::bundle(&bundle).path());
    }
    // A picture: no axis z.
    let flat = tempfile::tempdir().unwrap();
    let array = r#"{"zarr_format": 2, "shape": [2, 3], "chunks": [2, 3], "dtype": "|u1", "compressor": null,
        "fill_value": 0, "order": "C", "filters": null}"#;
    std::fs::write(flat.path().join(".zarray"), array).unwrap();
    std::fs::write(flat.path().join("0.0"), [1, 2, 3, 4, 5, 6]).unwrap();
    assert_same(flat.path());
    let store = volumes::bundle(&data("zarr/image.bundle"));
    // A coarser level, which has slices of its own.
    let selection = Selection { component: Some(0), time: Some(0), level: Some(1), ..Selection::default() };
    let whole = volume::open(store.path(), &selection, &Quiet).unwrap();
    let read = bricks(store.path(), &selection, 1).unwrap();
    assert!(read.voxels == whole.voxels && read.geometry == whole.geometry);
    assert!(
        read.metadata.iter().any(|(_, text)| text.ends_with(", component 0, time 0, level 1")),
        "{:?}",
        read.metadata
    );
}

#[test]
fn bricks_of_hdf5_are_those_of_the_volume_unless_slices_have_scales() {
    for path in all("hdf5") {
        if path.ends_with("minc_slices.mnc") {
            let error = bricks(&path, &Selection::default(), 1 << 20).unwrap_err();
            assert!(
                error.contains("minc_slices.mnc: ") && error.contains("its slices have scales of their own"),
                "{error}"
            );
        } else {
            assert_same(&path);
        }
    }
}

#[test]
fn bricks_of_tiff_are_those_of_the_volume() {
    for path in all("tiff") {
        assert_same(&path);
    }
}

#[test]
fn bricks_of_nifti_mrc_and_numpy_are_those_of_the_volume_unless_it_is_in_another_order() {
    let folder = tempfile::tempdir().unwrap();
    for (from, extension) in [("nifti", "nii"), ("mrc", "mrc"), ("numpy", "npy")] {
        for seed in all(&format!("hostile/{from}")) {
            let name = seed.file_name().unwrap().to_str().unwrap();
            let ending = if name == "gzip" { format!("{extension}.gz") } else { extension.to_owned() };
            let path = folder.path().join(format!("{name}.{ending}"));
            std::fs::copy(&seed, &path).unwrap();
            if name == "fortran" {
                let error = bricks(&path, &Selection::default(), 1 << 20).unwrap_err();
                assert!(error.contains("not in the order of slices, as in Fortran order"), "{error}");
            } else {
                assert_same(&path);
            }
        }
    }
}

#[test]
fn bricks_of_folders_of_slices_are_those_of_the_volume_if_their_slices_are_alike() {
    let slices: Vec<_> =
        (0..7_u16).map(|z| (format!("{}", 9 - z), file(&slice(f64::from(z) * 2.0, z * 12), EXPLICIT))).collect();
    let slices: Vec<(&str, Vec<u8>)> = slices.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
    let folder = volumes::folder(&slices);
    assert_same(folder.path());
    // One slope differs, far behind: all voxels are values.
    let scaled = slice(14.0, 90).text(0x0028_1053, "DS", "2").text(0x0028_1052, "DS", "5");
    std::fs::write(folder.path().join("1"), file(&scaled, EXPLICIT)).unwrap();
    assert_same(folder.path());
    // A missing slice leaves steps uneven.
    std::fs::remove_file(folder.path().join("5")).unwrap();
    let error = bricks(folder.path(), &Selection::default(), 1).unwrap_err();
    assert!(error.contains("missing"), "{error}");
    let resampled = Selection { resample: true, ..Selection::default() };
    let error = bricks(folder.path(), &resampled, 1).unwrap_err();
    assert!(error.contains("its slices are resampled together"), "{error}");

    // Slices that lie askew: one alone would not show it.
    let askew = |z: u16| slice(f64::from(z), z).text(0x0020_0032, "DS", &format!("1\\{}\\{z}", f64::from(z) * 0.5));
    let askew: Vec<_> = (0..4_u16).map(|z| (format!("{z}"), file(&askew(z), EXPLICIT))).collect();
    let askew: Vec<(&str, Vec<u8>)> = askew.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
    let error = bricks(volumes::folder(&askew).path(), &Selection::default(), 1).unwrap_err();
    assert!(error.contains("sheared"), "{error}");

    let pictures = tempfile::tempdir().unwrap();
    for number in 0..5_u8 {
        let picture = [b"P5\n3 2\n255\n".as_slice(), &[number, 1, 2, 3, 4, 5 * number]].concat();
        std::fs::write(pictures.path().join(format!("s{number}.pgm")), picture).unwrap();
    }
    assert_same(pictures.path());
    let labels = file(&segmentation("LABELMAP", &[(1, 0.0, [1; 9]), (1, 1.0, [0; 9])]), EXPLICIT);
    let folder = volumes::folder(&[("s.dcm", labels)]);
    let error = bricks(&folder.path().join("s.dcm"), &Selection::default(), 1).unwrap_err();
    assert!(error.contains("because it is a segmentation"), "{error}");
}

#[test]
fn a_store_that_states_more_than_any_memory_is_refused_before_it_is_taken() {
    let store = tempfile::tempdir().unwrap();
    let array = r#"{"zarr_format": 2, "shape": [200000, 200000, 200000], "chunks": [64, 64, 64], "dtype": "|u1",
        "compressor": null, "fill_value": 0, "order": "C", "filters": null}"#;
    std::fs::write(store.path().join(".zarray"), array).unwrap();
    let error = bricks(store.path(), &Selection::default(), 1 << 24).unwrap_err();
    assert!(error.contains("memory") && error.contains("bytes"), "{error}");
}
