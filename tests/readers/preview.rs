//! Middle slices of volumes: those that readers find at once, and small pictures of them.

use std::path::{Path, PathBuf};

use relume::progress::Quiet;
use relume::volume::{self, Preview, Selection, Volume};

use crate::support::dicom::{EXPLICIT, file, slice};
use crate::support::volumes;

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// The middle slice of the volume that `selection` chooses is that of the whole volume, in its place.
fn assert_middle(path: &Path, selection: &Selection) {
    let open = |middle: bool| {
        let selection = Selection { middle, ..selection.clone() };
        volume::open(path, &selection, &Quiet).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    };
    let (whole, middle) = (open(false), open(true));
    let [nx, ny, nz] = whole.geometry.dims;
    assert!(nz > 1 && middle.geometry.dims == [nx, ny, 1], "{}: {:?}", path.display(), middle.geometry.dims);
    let origin = whole.geometry.world_from_index(glam::DVec3::new(0.0, 0.0, f64::from(u32::try_from(nz / 2).unwrap())));
    assert!(middle.geometry.origin.abs_diff_eq(origin, 1e-9), "{}: {}", path.display(), middle.geometry.origin);
    let size = whole.voxels.bytes().len() / whole.voxels.len();
    let expected = &whole.voxels.bytes()[nx * ny * (nz / 2) * size..][..nx * ny * size];
    assert_eq!(middle.voxels.bytes(), expected, "{}", path.display());
}

#[test]
fn a_middle_slice_is_that_of_the_volume() {
    let component = |index| Selection { component: Some(index), ..Selection::default() };
    let slices: Vec<_> =
        (0..5_u16).map(|z| (format!("{}", 9 - z), file(&slice(f64::from(z) * 2.0, z * 12), EXPLICIT))).collect();
    let slices: Vec<(&str, Vec<u8>)> = slices.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
    assert_middle(volumes::folder(&slices).path(), &Selection::default());
    assert_middle(&data("tiff/channels.ome.tif"), &component(1));
    assert_middle(&data("tiff/imagej_big.tif"), &Selection { time: Some(1), ..component(1) });
    let pyramid = Selection { level: Some(1), ..component(1) };
    assert_middle(&data("tiff/pyramid.ome.tif"), &pyramid);
    assert_middle(&data("hdf5/four.h5"), &Selection { axes: Some("czyx".to_owned()), ..component(1) });
    assert_middle(&data("hdf5/imaris.ims"), &Selection { time: Some(1), level: Some(0), ..component(1) });
    assert_middle(&data("hdf5/single.h5"), &Selection::default());
    let store = volumes::bundle(&data("zarr/image.bundle"));
    for level in [0, 1] {
        let selection = Selection { time: Some(1), level: Some(level), ..component(1) };
        assert_middle(store.path(), &selection);
    }
    let store = volumes::bundle(&data("zarr/v3_sharded.bundle"));
    assert_middle(store.path(), &Selection::default());
    let Some(folder) = volumes::shared() else { return };
    assert_middle(&folder.join("nifti/functional.nii"), &Selection { time: Some(3), ..Selection::default() });
    assert_middle(&folder.join("slices/png8"), &Selection::default());
    assert_middle(&folder.join("dicom/enhanced_ct.dcm"), &Selection::default());
}

#[test]
fn a_slice_that_leans_or_lies_unevenly_has_a_picture_all_the_same() {
    let Some(folder) = volumes::shared() else { return };
    for name in ["dicom/tilt", "dicom/missing_slice"] {
        let picture = Preview::open(&folder.join(name), None, &Selection::default(), 32, &Quiet).unwrap();
        assert_eq!(picture.width.max(picture.height), 32, "{name}");
        assert!(picture.grey.iter().any(|&grey| grey > 100), "{name}");
    }
}

#[test]
fn a_picture_has_the_shape_of_its_slice_and_the_window_of_the_file() {
    // 4 × 3 voxels of 0.25 mm × 0.5 mm, with values from 300 on.
    let windowed = slice(0.0, 300).text(0x0028_1050, "DS", "305").text(0x0028_1051, "DS", "10");
    let folder = volumes::folder(&[("a", file(&windowed, EXPLICIT))]);
    let picture = Preview::open(folder.path(), None, &Selection::default(), 6, &Quiet).unwrap();
    assert_eq!((picture.width, picture.height), (4, 6));
    // From 300, black, to 310, white; the last two voxels are above.
    let row = |row: usize| &picture.grey[4 * row..][..4];
    assert_eq!((row(0), row(1)), (&[0, 26, 51, 77][..], &[0, 26, 51, 77][..]));
    assert_eq!(row(5), [204, 230, 255, 255]);
}

/// A slice of 2 × 2 voxels whose axes point to the right and to the front of a patient, unless they are `turned`.
fn nifti(turned: [bool; 2]) -> Volume {
    // Rows of the sform, right-anterior-superior: 2 × 2 voxels with the values 1 to 4.
    let mut bytes = vec![0_u8; 352];
    bytes[..4].copy_from_slice(&348_i32.to_le_bytes());
    for (at, value) in
        [(40, 3_i16), (42, 2), (44, 2), (46, 1), (48, 1), (50, 1), (52, 1), (54, 1), (70, 2), (72, 8), (254, 1)]
    {
        bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
    }
    bytes[108..112].copy_from_slice(&352.0_f32.to_le_bytes());
    let [x, y] = turned.map(|turned| if turned { -1.0_f32 } else { 1.0 });
    for (at, value) in [(280, x), (300, y), (320, 1.0)] {
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    bytes[344..348].copy_from_slice(b"n+1\0");
    let [first, second] = if turned[0] { [1_u8, 2] } else { [2, 1] };
    let rows = [[first, second], [first + 2, second + 2]];
    let rows = if turned[1] { [rows[1], rows[0]] } else { rows };
    bytes.extend(rows.concat());
    volumes::opened("v.nii", &bytes, &Selection::default()).unwrap()
}

#[test]
fn a_picture_of_a_patient_is_upright_whatever_the_order_in_the_file() {
    // Value 1 is right and posterior, 2 left and posterior, 3 right and anterior, 4 left and anterior: right is shown on the
    // left, and anterior above.
    for turned in [[false, false], [true, false], [false, true], [true, true]] {
        let volume = nifti(turned);
        assert_eq!(volume.geometry.dims, [2, 2, 1]);
        let picture = Preview::of(&volume, 2);
        let order: Vec<u8> = picture.grey;
        assert_eq!(order, [170, 255, 0, 85], "{turned:?}");
    }
}
