//! Volumes from all sources: shared real files, raw voxels, statistics and downsampling.
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]
#![expect(clippy::float_cmp, reason = "exact in binary")]

use crate::support::volumes;

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DMat3, DVec3};
use relume::progress::{Progress, Quiet};
use relume::volume::{
    self, ByteOrder, Geometry, RawLayout, Selection, Statistics, Volume, VolumeError, VoxelType, Voxels,
};
use volumes::{hex, shared, whole_message};

fn unit(dims: [usize; 3], voxels: Voxels) -> Volume {
    Volume::new("test", voxels, Geometry::unit("test", dims).unwrap()).unwrap()
}

/// Opens a shared file, with the options of those that need more than a name.
fn open_shared(folder: &Path, name: &str, selection: &Selection) -> Result<Volume, VolumeError> {
    let raw = |file: &str, layout: RawLayout| {
        let layout = RawLayout { file: Some(file.into()), ..layout };
        volume::open_raw(&layout, &folder.join(name), selection, &Quiet)
    };
    match name {
        "ct/cranium" => raw(
            "matrix.dat",
            RawLayout { spacing: [0.957_031_2, 0.957_031_2, 1.5], ..RawLayout::new([256, 256, 108], VoxelType::I16) },
        ),
        "ct/cthead" => raw(
            "CThead.%d",
            RawLayout {
                slices: Some(vec![1, 113]),
                byte_order: ByteOrder::Big,
                spacing: [1.0, 1.0, 2.0],
                ..RawLayout::new([256, 256, 113], VoxelType::U16)
            },
        ),
        _ => volume::open(&folder.join(name), selection, &Quiet),
    }
}

#[test]
fn every_shared_metaimage_and_raw_volume_reads_as_an_independent_reader_found_it() {
    let Some(folder) = shared() else { return };
    let ours =
        |name: &str| name.ends_with(".mhd") || name.ends_with(".mha") || name == "ct/cranium" || name == "ct/cthead";
    let checked = volumes::check_all(&folder, ours, |name, selection| open_shared(&folder, name, selection));
    assert!(checked >= 13, "the shared folder has at least 13 such files, {checked} were checked");
}

#[test]
fn the_frog_tissue_has_every_voxel_and_a_note_about_its_header() {
    let Some(folder) = shared() else { return };
    let tissue = volume::open(&folder.join("frog/frogtissue.mhd"), &Selection::default(), &Quiet).unwrap();
    let Voxels::U8(labels) = &tissue.voxels else { panic!("labels are bytes") };
    assert_eq!(labels.iter().filter(|&&label| label == 13).count(), 440_722, "skeleton");
    assert!(
        matches!(&tissue.notes[..], [note] if note.contains("260020") && note.contains("262087")),
        "{:?}",
        tissue.notes
    );
}

#[test]
fn the_frog_averages_as_numpy_averages_it() {
    let Some(folder) = shared() else { return };
    let frog = volume::open(&folder.join("frog/frog.mhd"), &Selection::default(), &Quiet).unwrap();
    let half = frog.downsample([2, 2, 1]).unwrap();
    assert_eq!(half.geometry.dims, [250, 235, 136]);
    assert_eq!(half.geometry.spacing, DVec3::new(2.0, 2.0, 1.5));
    assert_eq!(half.geometry.origin, DVec3::new(0.5, 0.5, 0.0));
    // numpy: (a.reshape(136, 235, 2, 250, 2).astype(float32).mean((2, 4)) + 0.5).astype(uint8)
    assert_eq!(hex(half.voxels.bytes()), "1b19f4c167080414f177d341856730d9dccf81cf547b3d6db4aaf48aab3d82bb");
}

/// Folder with one file.
fn folder_with(name: &str, bytes: &[u8]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), bytes).unwrap();
    folder
}

#[test]
fn a_raw_file_is_read_by_the_sidecar_beside_it() {
    for sidecar in ["a.raw.toml", "a.toml"] {
        let folder = folder_with("a.raw", &[9, 9, 0, 1, 0, 2, 0, 3, 1, 4, 0, 5, 0, 6]);
        let text = "dims = [3, 2, 1]\ntype = 'ushort'\nbyte_order = 'big'\nheader_bytes = 2\nspacing = [1, 2, 3]\n\
                    origin = [4, 5, 6]\ndirection = [0, 1, 0, 1, 0, 0, 0, 0, 1]";
        std::fs::write(folder.path().join(sidecar), text).unwrap();
        let volume = volume::open(&folder.path().join("a.raw"), &Selection::default(), &Quiet).unwrap();
        assert_eq!(volume.voxels, Voxels::U16(vec![1, 2, 3, 260, 5, 6]));
        assert_eq!(volume.geometry.spacing, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(volume.geometry.world_from_index(DVec3::X), DVec3::new(4.0, 6.0, 6.0), "x runs along the world's y");
    }
}

#[test]
fn a_sidecar_opens_the_file_or_the_slices_it_names() {
    let folder = folder_with("s08", &[1, 2]);
    std::fs::write(folder.path().join("s10"), [3, 4]).unwrap();
    let sidecar = folder.path().join("v.toml");
    std::fs::write(&sidecar, "[volume]\nfile = 's%02d'\nslices = [8, 10, 2]\ndims = [2, 1, 2]\ntype = 'int8'").unwrap();
    assert_eq!(volume::open(&sidecar, &Selection::default(), &Quiet).unwrap().voxels, Voxels::I8(vec![1, 2, 3, 4]));
    std::fs::write(&sidecar, "file = 's%02d'\nslices = [10, 8, -2]\ndims = [2, 1, 2]\ntype = 'int8'").unwrap();
    assert_eq!(volume::open(&sidecar, &Selection::default(), &Quiet).unwrap().voxels, Voxels::I8(vec![3, 4, 1, 2]));
    std::fs::write(folder.path().join("s10.toml"), "dims = [2, 1, 1]\ntype = 'uint8'").unwrap();
    assert_eq!(
        volume::open(&folder.path().join("s10.toml"), &Selection::default(), &Quiet).unwrap().voxels,
        Voxels::U8(vec![3, 4])
    );
}

#[test]
fn a_sidecar_says_what_to_read_as_a_scene_does() {
    let folder = folder_with("a.raw", &[1, 3, 5, 9]);
    let path = folder.path().join("a.raw");
    let open = |more: &str, selection: &Selection| {
        let text = format!("dims = [4, 1, 1]\ntype = 'uint8'\n{more}");
        std::fs::write(folder.path().join("a.toml"), text).unwrap();
        volume::open(&path, selection, &Quiet)
    };
    let halved = open("downsample = [2, 1, 1]\ncomponent = 0\ntime = 0", &Selection::default()).unwrap();
    assert_eq!((halved.voxels, halved.blocks), (Voxels::U8(vec![2, 7]), [2, 1, 1]));
    assert_eq!(halved.geometry.spacing, DVec3::new(2.0, 1.0, 1.0));
    let refused = |more: &str, words: &str| {
        let message = whole_message(&open(more, &Selection::default()).unwrap_err());
        assert!(message.contains(words), "{more}: {message}");
    };
    refused("component = 1", "component 1");
    refused("time = 2", "time step 2");
    refused("downsample = [0, 1, 1]", "a whole number from 1");
    refused("downsample = [5, 1, 1]", "blocks of 5×1×1 in 4×1×1 voxels");
    refused("labels = 'b.raw'", "unknown field `labels`");
    // The user may choose another component.
    let chosen = Selection { component: Some(0), ..Selection::default() };
    assert!(open("component = 1", &chosen).is_ok(), "component 0 is there");
}

#[test]
fn a_sidecar_names_no_file_outside_its_folder() {
    let folder = folder_with("a.raw", &[1, 2]);
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    let sidecar = folder.path().join("sub/v.toml");
    for file in ["../a.raw", "../s%d", &folder.path().join("a.raw").display().to_string()] {
        std::fs::write(&sidecar, format!("file = '{file}'\ndims = [2, 1, 1]\ntype = 'uint8'")).unwrap();
        let error = volume::open(&sidecar, &Selection::default(), &Quiet).unwrap_err();
        assert!(matches!(error, VolumeError::Outside { .. }), "{error}");
    }
    // A file given on the command line may be anywhere.
    let layout = RawLayout { file: Some("../a.raw".into()), ..RawLayout::new([2, 1, 1], VoxelType::U8) };
    assert!(volume::open_raw(&layout, &folder.path().join("sub"), &Selection::default(), &Quiet).is_ok(), "named");
}

#[test]
fn bad_raw_files_are_refused_with_the_numbers() {
    let folder = folder_with("a.raw", &[0; 5]);
    let path = folder.path().join("a.raw");
    let refused = |toml: &str| {
        std::fs::write(folder.path().join("a.toml"), toml).unwrap();
        volume::open(&path, &Selection::default(), &Quiet).unwrap_err()
    };
    let error = volume::open(&path, &Selection::default(), &Quiet).unwrap_err();
    let message = whole_message(&error);
    assert!(matches!(error, VolumeError::NoLayout { .. }), "{message}");
    assert!(["dims", "type", "header_bytes", "a.raw.toml"].iter().all(|word| message.contains(word)), "{message}");

    let error = refused("dims = [3, 1, 1]\ntype = 'uint16'");
    assert!(matches!(error, VolumeError::Short { found: 5, expected: 6, .. }), "{error}");
    assert!(whole_message(&error).contains("5 bytes of voxels, but the stated dims and type require 6"), "{error}");

    let error = refused("dims = [5, 1, 1]\ntype = 'uint8'\nheader_bytes = 7");
    assert!(matches!(error, VolumeError::Short { found: 0, expected: 5, .. }), "{error}");

    let error = refused("dims = [5, 1, 1]\ntype = 'uint8'\ncolour = 'red'");
    let message = whole_message(&error);
    assert!(matches!(error, VolumeError::Sidecar { .. }), "{message}");
    assert!(message.contains("line 3") && message.contains("colour"), "{message}");

    let error = refused("dims = [5, 1, 1]\ntype = 'uint7'");
    assert!(whole_message(&error).contains("uint7"), "{}", whole_message(&error));

    let error = refused("dims = [5, 1, 0]\ntype = 'uint8'");
    let message = whole_message(&error);
    assert!(matches!(error, VolumeError::Sidecar { .. }), "{message}");
    assert!(message.contains("line 1, column 15") && message.contains("a whole number from 1"), "{message}");
    let layout = RawLayout { file: Some("a.raw".into()), ..RawLayout::new([5, 1, 0], VoxelType::U8) };
    let error = volume::open_raw(&layout, folder.path(), &Selection::default(), &Quiet).unwrap_err();
    assert!(matches!(error, VolumeError::Dims { .. }) && error.to_string().contains("5×1×0"), "{error}");
    let error = refused("dims = [4294967296, 4294967296, 4294967296]\ntype = 'uint8'");
    assert!(matches!(error, VolumeError::Dims { .. }), "{error}");
    let error = refused("dims = [4294967296, 4294967296, 1]\ntype = 'uint8'");
    assert!(matches!(error, VolumeError::Dims { .. }), "{error}");
    let error = refused("dims = [4294967296, 65536, 1]\ntype = 'uint8'");
    assert!(matches!(error, VolumeError::Short { found: 5, expected: 0x1_0000_0000_0000, .. }), "{error}");

    let error = refused("dims = [5, 1, 1]\ntype = 'uint8'\nspacing = [1, -1, 1]");
    assert!(matches!(error, VolumeError::Spacing { .. }) && error.to_string().contains("1 -1 1"), "{error}");
    let error = refused("dims = [5, 1, 1]\ntype = 'uint8'\norigin = [1, nan, 1]");
    assert!(matches!(error, VolumeError::Origin { .. }), "{error}");
    let error = refused("dims = [5, 1, 1]\ntype = 'uint8'\ndirection = [1, 0, 0, 1, 0, 0, 0, 0, 1]");
    assert!(matches!(error, VolumeError::Direction { deviation: 1.0, .. }), "{error}");

    let error = refused("dims = [5, 1, 1]\ntype = 'uint8'\nfile = 'b.raw'");
    assert!(matches!(error, VolumeError::Layout { .. }) && error.to_string().contains("b.raw"), "{error}");

    let sidecar = folder.path().join("b.toml");
    std::fs::write(&sidecar, "dims = [5, 1, 3]\ntype = 'uint8'\nfile = 'slice%d'\nslices = [1, 2]").unwrap();
    let error = volume::open(&sidecar, &Selection::default(), &Quiet).unwrap_err();
    assert!(error.to_string().contains("2 slices") && error.to_string().contains('3'), "{error}");
    std::fs::write(&sidecar, "dims = [5, 1, 4000000000]\ntype = 'uint8'\nfile = 'slice%d'").unwrap();
    let error = volume::open(&sidecar, &Selection::default(), &Quiet).unwrap_err();
    assert!(matches!(&error, VolumeError::Open { path, .. } if path.ends_with("slice1")), "{error}");
}

#[test]
fn more_bytes_than_needed_are_noted() {
    let folder = folder_with("a.raw", &[0; 5]);
    std::fs::write(folder.path().join("a.toml"), "dims = [3, 1, 1]\ntype = 'uint8'").unwrap();
    let notes = volume::open(&folder.path().join("a.raw"), &Selection::default(), &Quiet).unwrap().notes;
    assert!(matches!(&notes[..], [note] if note.contains('5') && note.contains('3')), "{notes:?}");
}

#[test]
fn a_file_called_raw_may_have_a_header() {
    let text = b"NRRD0001\ntype: uint8\ndimension: 3\nsizes: 2 1 1\nencoding: raw\n\n78";
    let folder = folder_with("a.raw", text);
    let open = || volume::open(&folder.path().join("a.raw"), &Selection::default(), &Quiet).unwrap();
    assert_eq!(open().geometry.dims, [2, 1, 1]);
    std::fs::write(folder.path().join("a.toml"), "dims = [3, 1, 1]\ntype = 'uint8'").unwrap();
    assert_eq!(open().geometry.dims, [3, 1, 1], "what the sidecar says");
}

#[test]
fn unknown_and_missing_files_are_named() {
    let folder = folder_with("a.xyz", b"hello");
    let error = volume::open(&folder.path().join("a.xyz"), &Selection::default(), &Quiet).unwrap_err();
    assert!(matches!(error, VolumeError::UnknownFormat { .. }), "{error}");
    assert!(error.to_string().contains("a.xyz") && error.to_string().contains("MetaImage (.mhd, .mha)"), "{error}");
    for missing in ["none.mhd", "none.raw", "none.toml", "none"] {
        let error = volume::open(&folder.path().join(missing), &Selection::default(), &Quiet).unwrap_err();
        assert!(matches!(error, VolumeError::Open { .. }) && error.to_string().contains(missing), "{error}");
    }
}

/// Counts bytes, and cancels after some.
struct Listener {
    stop_after: u64,
    done: AtomicU64,
    total: AtomicU64,
}

impl Progress for Listener {
    fn report(&self, stage: &str, done: u64, total: u64) {
        assert_eq!(stage, "reading a.raw", "the stage names the file");
        self.done.store(done, Ordering::Relaxed);
        self.total.store(total, Ordering::Relaxed);
    }
    fn cancelled(&self) -> bool {
        self.done.load(Ordering::Relaxed) >= self.stop_after
    }
}

#[test]
fn reading_reports_bytes_and_can_be_cancelled() {
    let folder = folder_with("a.raw", &vec![7; 10 << 20]);
    std::fs::write(folder.path().join("a.toml"), "dims = [1024, 1024, 5]\ntype = 'uint16'").unwrap();
    let read = |stop_after| {
        let listener = Listener { stop_after, done: AtomicU64::new(0), total: AtomicU64::new(0) };
        (volume::open(&folder.path().join("a.raw"), &Selection::default(), &listener), listener)
    };
    let (volume, listener) = read(u64::MAX);
    assert_eq!(volume.unwrap().voxels, Voxels::U16(vec![0x0707; 5 << 20]));
    assert_eq!([listener.done.into_inner(), listener.total.into_inner()], [10 << 20; 2]);
    let (volume, listener) = read(1);
    assert!(matches!(volume, Err(VolumeError::Cancelled { .. })), "asked to stop");
    assert!(listener.done.into_inner() < 10 << 20, "stopped before the end");
}

#[test]
fn statistics_leave_out_what_is_not_finite() {
    let voxels = vec![f32::NAN, 3.0, f32::INFINITY, -1.0, f32::NEG_INFINITY, 1.0];
    let statistics = unit([6, 1, 1], Voxels::F32(voxels)).statistics().unwrap();
    let mut histogram = [0; 64];
    (histogram[0], histogram[32], histogram[63]) = (1, 1, 1);
    let expected = Statistics { min: -1.0, max: 3.0, mean: 1.0, histogram, not_a_number: 1, infinite: 2 };
    assert_eq!(statistics, expected);
}

#[test]
fn a_volume_with_nothing_finite_has_no_statistics() {
    let error = unit([3, 1, 1], Voxels::F64(vec![f64::NAN, f64::INFINITY, f64::NAN])).statistics().unwrap_err();
    assert!(matches!(error, VolumeError::NothingFinite { not_a_number: 2, infinite: 1, .. }), "{error}");
    assert!(error.to_string().contains("2 NaN, 1 infinite"), "{error}");
}

#[test]
fn a_constant_volume_is_all_in_the_first_bin() {
    for voxels in [Voxels::U8(vec![7; 9]), Voxels::I64(vec![7; 9]), Voxels::F64(vec![7.0; 9])] {
        let statistics = unit([9, 1, 1], voxels).statistics().unwrap();
        assert_eq!([statistics.min, statistics.max, statistics.mean], [7.0; 3]);
        assert_eq!((statistics.histogram[0], statistics.histogram.iter().sum::<u64>()), (9, 9));
    }
}

#[test]
fn slope_and_intercept_are_applied_and_may_mirror() {
    let mut volume = unit([4, 1, 1], Voxels::I16(vec![0, 1, 1, 64]));
    (volume.slope, volume.intercept) = (-2.0, 10.0);
    let statistics = volume.statistics().unwrap();
    assert_eq!([statistics.min, statistics.max, statistics.mean], [-118.0, 10.0, -23.0]);
    assert_eq!((statistics.histogram[0], statistics.histogram[62], statistics.histogram[63]), (1, 2, 1));
    assert_eq!((volume.value([3, 0, 0]), volume.value([4, 0, 0])), (Some(-118.0), None));
    volume.slope = 0.0;
    assert_eq!(volume.statistics().unwrap().histogram[0], 4);
}

#[test]
fn means_are_exact_where_sums_are_large() {
    // The sum of the u64 values overflows u64; that of the f64 values overflows f64.
    let large = vec![u64::MAX; 5];
    assert!((unit([5, 1, 1], Voxels::U64(large)).statistics().unwrap().mean / 2_f64.powi(64) - 1.0).abs() < 1e-15);
    let statistics = unit([4, 1, 1], Voxels::F64(vec![f64::MAX, f64::MAX, -f64::MAX, f64::MAX])).statistics().unwrap();
    assert!((statistics.mean / (f64::MAX / 2.0) - 1.0).abs() < 1e-12, "{}", statistics.mean);
    assert_eq!((statistics.histogram[0], statistics.histogram[63]), (1, 3));
    // Σ i / n = (n − 1) / 2, with a large number added and subtracted.
    let n = 3_000_000_u32;
    let ramp: Vec<f64> = (0..n).map(f64::from).collect();
    let mean = unit([ramp.len(), 1, 1], Voxels::F64(ramp)).statistics().unwrap().mean;
    assert!((mean / (f64::from(n - 1) / 2.0) - 1.0).abs() < 1e-12, "{mean}");
    // The same exactly, in integers: (n − 1) n / 2 / n.
    let ramp: Vec<i32> = (0..3_000_001).collect();
    assert_eq!(unit([ramp.len(), 1, 1], Voxels::I32(ramp)).statistics().unwrap().mean, 1_500_000.0);
}

#[test]
fn statistics_see_every_voxel_of_every_task() {
    // 16 million voxels are several tasks; each byte value occurs 65536 times.
    let voxels: Vec<u8> = (0..1_u32 << 24).map(|i| u8::try_from(i % 256).unwrap()).collect();
    let statistics = unit([1 << 12, 1 << 12, 1], Voxels::U8(voxels)).statistics().unwrap();
    assert_eq!([statistics.min, statistics.max, statistics.mean], [0.0, 255.0, 127.5]);
    assert_eq!(statistics.histogram, [4 << 16; 64]);
}

#[test]
fn blocks_are_averaged_half_up_and_stay_where_they_were() {
    let geometry = Geometry::new(
        "test",
        [5, 2, 1],
        DVec3::new(1.0, 2.0, 3.0),
        DVec3::new(10.0, 0.0, 0.0),
        DMat3::from_cols(DVec3::Y, DVec3::X, DVec3::Z),
    )
    .unwrap();
    let voxels = Voxels::I16(vec![-1, -2, 1, 2, 99, 0, 0, 2, 1, 99]);
    let coarse = Volume::new("test", voxels, geometry).unwrap().downsample([2, 2, 1]).unwrap();
    // −3/4 + ½ = −¼ → −1; 6/4 + ½ = 2.
    assert_eq!(coarse.voxels, Voxels::I16(vec![-1, 2]));
    assert_eq!(coarse.geometry.dims, [2, 1, 1]);
    assert_eq!(coarse.geometry.spacing, DVec3::new(2.0, 4.0, 3.0));
    assert_eq!(coarse.geometry.origin, geometry.world_from_index(DVec3::new(0.5, 0.5, 0.0)));
    assert!(matches!(&coarse.notes[..], [note] if note.contains("1, 0, 0 voxels")), "{:?}", coarse.notes);
}

#[test]
fn means_of_the_largest_integers_are_exact() {
    let unsigned = unit([2, 2, 1], Voxels::U64(vec![u64::MAX, u64::MAX - 1, u64::MAX, u64::MAX]));
    // Three quarters above MAX − 1.
    assert_eq!(unsigned.downsample([2, 2, 1]).unwrap().voxels, Voxels::U64(vec![u64::MAX]));
    let signed = unit([2, 1, 1], Voxels::I64(vec![i64::MIN, i64::MIN + 1]));
    assert_eq!(signed.downsample([2, 1, 1]).unwrap().voxels, Voxels::I64(vec![i64::MIN + 1]));
}

#[test]
fn a_block_ignores_nan_unless_it_has_nothing_else() {
    let voxels = Voxels::F32(vec![1.0, f32::NAN, f32::NAN, f32::NAN, 1.0, 1.5]);
    let Voxels::F32(coarse) = unit([6, 1, 1], voxels).downsample([2, 1, 1]).unwrap().voxels else {
        panic!("the type is kept")
    };
    assert!(coarse[0] == 1.0 && coarse[1].is_nan() && coarse[2] == 1.25, "{coarse:?}");
}

#[test]
fn labels_keep_the_most_frequent_and_the_smallest_of_equals() {
    let voxels = Voxels::U8(vec![9, 9, 1, 3, 2, 3, 0, 9, 1, 2, 3, 2]);
    let coarse = unit([6, 2, 1], voxels).downsample_labels([3, 2, 1]).unwrap();
    assert_eq!(coarse.voxels, Voxels::U8(vec![9, 2]));
    let tied = unit([4, 1, 1], Voxels::U8(vec![7, 5, 7, 5])).downsample_labels([4, 1, 1]).unwrap();
    assert_eq!(tied.voxels, Voxels::U8(vec![5]));
}

#[test]
fn blocks_larger_than_the_volume_are_refused() {
    for block in [[0, 1, 1], [1, 1, 3]] {
        let error = unit([2, 2, 2], Voxels::U8(vec![0; 8])).downsample(block).unwrap_err();
        assert!(matches!(error, VolumeError::Block { .. }) && error.to_string().contains("2×2×2"), "{error}");
    }
}

#[test]
fn a_spacing_is_replaced_or_refused() {
    let volume = unit([2, 1, 1], Voxels::U8(vec![0; 2]));
    assert_eq!(volume.clone().with_spacing(DVec3::splat(2.0)).unwrap().geometry.spacing, DVec3::splat(2.0));
    assert!(matches!(volume.with_spacing(DVec3::ZERO), Err(VolumeError::Spacing { .. })), "no length");
}

#[test]
fn names_of_types_are_numpys_and_c_s() {
    for (name, expected) in
        [("uint8", VoxelType::U8), ("UCHAR", VoxelType::U8), ("short", VoxelType::I16), ("double", VoxelType::F64)]
    {
        assert_eq!(name.parse::<VoxelType>().unwrap(), expected);
    }
    for one in [
        VoxelType::U8,
        VoxelType::I8,
        VoxelType::U16,
        VoxelType::I16,
        VoxelType::U32,
        VoxelType::I32,
        VoxelType::U64,
        VoxelType::I64,
        VoxelType::F32,
        VoxelType::F64,
    ] {
        assert_eq!(one.name().parse::<VoxelType>().expect("its own name"), one);
    }
    assert!(matches!("long".parse::<VoxelType>(), Err(VolumeError::UnknownType { .. })), "4 or 8 bytes");
}

#[test]
fn values_beyond_floats_of_32_bits_have_the_first_look_of_the_same_values_in_range() {
    use relume::document::first_look::{Values, Wish, scene_text};
    // A ball in a box, and noise around it.
    let sides = [20_usize, 18, 16];
    let value = |index: usize| {
        let [x, y, z] = [index % sides[0], index / sides[0] % sides[1], index / (sides[0] * sides[1])];
        let radius =
            [(x, 9.5), (y, 8.5), (z, 7.5)].map(|(at, middle)| (f64::from(u8::try_from(at).unwrap()) - middle).powi(2));
        let noise = f64::from(u8::try_from((7 * x + 3 * y + 5 * z) % 9).unwrap());
        if radius.iter().sum::<f64>() < 30.0 { 410.0 + noise } else { 20.0 + noise }
    };
    let look = |factor: f64| {
        let voxels = (0..sides.iter().product()).map(|index| value(index) * factor).collect();
        let mut volume = std::sync::Arc::new(unit(sides, Voxels::F64(voxels)));
        let statistics = volume.statistics().unwrap();
        let values = Values::of(&volume, &statistics);
        let percentiles = [0.01, 0.5, 0.99].map(|part| values.percentile(part) / factor);
        let text = scene_text("v", &mut volume, &statistics, Wish::default(), &Quiet).unwrap();
        let scene: toml::Table = text.parse().expect("a scene");
        let intervals = scene["transfer"]["intervals"].as_array().unwrap().clone();
        let number = |value: &toml::Value| value.as_float().unwrap();
        let ranges: Vec<f64> = intervals
            .iter()
            .flat_map(|it| [&it["range"][0], &it["range"][1], &it["ramp"]].map(|value| number(value) / factor))
            .collect();
        let opacities: Vec<f64> = intervals.iter().map(|it| number(&it["opacity"])).collect();
        (percentiles, ranges, opacities, scene["camera"].clone())
    };
    let usual = look(1.0);
    assert!(usual.1.len() >= 3);
    // A power of two scales exactly, and powers of ten as nearly as they are numbers.
    for factor in [2.0_f64.powi(700), 2.0_f64.powi(-300), 1e60, 3e-75, 1e300] {
        let far = look(factor);
        let near = |one: &[f64], other: &[f64]| {
            one.len() == other.len()
                && one.iter().zip(other).all(|(one, other)| (one - other).abs() <= 1e-9 * one.abs())
        };
        assert!(near(&usual.0, &far.0), "{factor:e}: {:?}, not {:?}", far.0, usual.0);
        assert!(near(&usual.1, &far.1), "{factor:e}: {:?}, not {:?}", far.1, usual.1);
        assert_eq!((&usual.2, &usual.3), (&far.2, &far.3), "{factor:e}");
    }
}

#[test]
fn a_first_look_does_not_use_a_window_beside_its_values() {
    use relume::document::first_look::{Values, guess};
    use relume::volume::Window;
    let sides = [12_usize, 12, 12];
    // Surroundings of 0, and a body from 3000 on.
    let body = |index: u16| if index % 12 < 4 { 0.0 } else { f32::from(3000 + index % 1000) };
    let voxels: Vec<f32> = (0..1728_u16).map(body).collect();
    let look = |window: Option<[f64; 2]>| {
        let mut volume = unit(sides, Voxels::F32(voxels.clone()));
        volume.presets.windows.extend(window.and_then(|[low, high]| Window::new("w", low, high)));
        let statistics = volume.statistics().unwrap();
        guess(&volume, &Values::of(&volume, &statistics), &statistics)
    };
    for beside in [[0.0, 255.0], [5000.0, 9000.0], [10.0, 2998.0]] {
        let told = look(Some(beside));
        let layers = told.strip_suffix(", is not used, because the values lie beside it").unwrap();
        let of_window = format!("; the window of the file, {} to {}", beside[0], beside[1]);
        assert_eq!(layers.strip_suffix(&of_window), Some(look(None).as_str()));
    }
    for within in [[0.0, 3500.0], [3100.0, 4200.0], [0.0, 65535.0]] {
        let told = look(Some(within));
        assert!(told != look(None) && !told.contains("is not used"), "{told}");
    }
}
