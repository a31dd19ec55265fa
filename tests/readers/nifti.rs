//! `NIfTI` and Analyze files: real ones from the shared folder, and generated ones of every version, type, placement and
//! compression; invalid files.
#![expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "numbers of headers are small")]
#![expect(clippy::cast_sign_loss, clippy::float_cmp, reason = "they are not negative, and exact")]
#![expect(trivial_numeric_casts, clippy::cast_lossless, reason = "one macro for all types")]

use crate::support::volumes;

use std::io::Write as _;
use std::path::PathBuf;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::{DMat3, DVec3};
use relume::document::{self, Definition, SceneOptions, Source};
use relume::progress::Quiet;
use relume::volume::{self, Selection, Unit, Volume, VolumeError, Voxels, Window};
use tempfile::TempDir;

#[test]
fn every_shared_file_reads_as_an_independent_reader_found_it() {
    let Some(folder) = volumes::shared() else { return };
    let ours = |name: &str| name.starts_with("nifti/") || name.ends_with(".nii.gz");
    let checked =
        volumes::check_all(&folder, ours, |name, selection| volume::open(&folder.join(name), selection, &Quiet));
    assert!(checked >= 23, "the shared folder has at least 23 such files, {checked} were checked");
}

/// Format of a header to write.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Version {
    Analyze,
    One,
    Two,
}

use Version::{Analyze, One, Two};

/// A header of 3×2×2 bytes with spacing 1, and no placement; every field can be changed.
#[derive(Clone, Debug)]
struct Header {
    version: Version,
    big: bool,
    magic: Vec<u8>,
    dim: [i64; 8],
    datatype: i16,
    bitpix: i16,
    pixdim: [f64; 8],
    vox_offset: f64,
    slope: [f64; 2],
    window: [f64; 2],
    units: u8,
    intent: i16,
    codes: [i16; 2],
    quaternion: [f64; 6],
    rows: [f64; 12],
}

const TWELVE: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

impl Header {
    fn new(version: Version) -> Self {
        Self {
            version,
            big: false,
            magic: match version {
                Analyze => vec![0; 4],
                One => b"n+1\0".to_vec(),
                Two => b"n+2\0\r\n\x1a\n".to_vec(),
            },
            dim: [3, 3, 2, 2, 1, 1, 1, 1],
            datatype: 2,
            bitpix: 8,
            pixdim: [1.0; 8],
            vox_offset: match version {
                Analyze => 0.0,
                One => 352.0,
                Two => 544.0,
            },
            slope: [0.0; 2],
            window: [0.0; 2],
            units: 2,
            intent: 0,
            codes: [0; 2],
            quaternion: [0.0; 6],
            rows: [0.0; 12],
        }
    }

    fn with(version: Version, change: impl FnOnce(&mut Self)) -> Self {
        let mut header = Self::new(version);
        change(&mut header);
        header
    }

    /// The bytes, up to the first voxel where that is behind the header.
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0_u8; if self.version == Two { 540 } else { 348 }];
        let big = self.big;
        let mut put = |at: usize, mut number: Vec<u8>| {
            if big {
                number.reverse();
            }
            bytes[at..at + number.len()].copy_from_slice(&number);
        };
        let f32s = |number: f64| (number as f32).to_le_bytes().to_vec();
        let f64s = |number: f64| number.to_le_bytes().to_vec();
        let i16s = |number: i16| number.to_le_bytes().to_vec();
        if self.version == Two {
            put(0, 540_i32.to_le_bytes().to_vec());
            put(12, i16s(self.datatype));
            put(14, i16s(self.bitpix));
            (0..8).for_each(|i| put(16 + 8 * i, self.dim[i].to_le_bytes().to_vec()));
            (0..8).for_each(|i| put(104 + 8 * i, f64s(self.pixdim[i])));
            put(168, (self.vox_offset as i64).to_le_bytes().to_vec());
            (0..2).for_each(|i| put(176 + 8 * i, f64s(self.slope[i])));
            (0..2).for_each(|i| put(192 + 8 * i, f64s(self.window[1 - i])));
            (0..2).for_each(|i| put(344 + 4 * i, i32::from(self.codes[i]).to_le_bytes().to_vec()));
            (0..6).for_each(|i| put(352 + 8 * i, f64s(self.quaternion[i])));
            (0..12).for_each(|i| put(400 + 8 * i, f64s(self.rows[i])));
            put(500, i32::from(self.units).to_le_bytes().to_vec());
            put(504, i32::from(self.intent).to_le_bytes().to_vec());
            bytes[4..4 + self.magic.len()].copy_from_slice(&self.magic);
            bytes[240..245].copy_from_slice(b"words");
        } else {
            put(0, 348_i32.to_le_bytes().to_vec());
            (0..8).for_each(|i| put(40 + 2 * i, i16s(self.dim[i] as i16)));
            put(68, i16s(self.intent));
            put(70, i16s(self.datatype));
            put(72, i16s(self.bitpix));
            (0..8).for_each(|i| put(76 + 4 * i, f32s(self.pixdim[i])));
            put(108, f32s(self.vox_offset));
            (0..2).for_each(|i| put(112 + 4 * i, f32s(self.slope[i])));
            put(123, vec![self.units]);
            (0..2).for_each(|i| put(124 + 4 * i, f32s(self.window[1 - i])));
            (0..2).for_each(|i| put(252 + 2 * i, i16s(self.codes[i])));
            (0..6).for_each(|i| put(256 + 4 * i, f32s(self.quaternion[i])));
            (0..12).for_each(|i| put(280 + 4 * i, f32s(self.rows[i])));
            bytes[344..348].copy_from_slice(&self.magic[..4]);
            bytes[148..153].copy_from_slice(b"words");
        }
        if self.vox_offset > bytes.len() as f64 && self.vox_offset < 1e6 {
            bytes.resize(self.vox_offset as usize, 0);
        }
        bytes
    }
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

struct Files(TempDir);

impl Files {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn with(&self, name: &str, bytes: &[u8]) -> &Self {
        std::fs::write(self.path(name), bytes).unwrap();
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn open(&self, name: &str, selection: &Selection) -> Result<Volume, VolumeError> {
        volume::open(&self.path(name), selection, &Quiet)
    }
}

/// Reads the header with `data` behind it, as one file, or as a pair where the magic word requires it.
fn select(header: &Header, data: &[u8], selection: &Selection) -> Result<Volume, VolumeError> {
    let files = Files::new();
    if header.version == Analyze || header.magic.starts_with(b"ni") {
        let image = [&vec![7; header.vox_offset as usize][..], data].concat();
        let length = if header.version == Two { 540 } else { 348 };
        files.with("v.hdr", &header.bytes()[..length]).with("v.img", &image).open("v.hdr", selection)
    } else {
        files.with("v.nii", &[&header.bytes()[..], data].concat()).open("v.nii", selection)
    }
}

fn open(header: &Header, data: &[u8]) -> Result<Volume, VolumeError> {
    select(header, data, &Selection::default())
}

fn refused(header: &Header, data: &[u8], words: &[&str]) {
    volumes::refused(open(header, data), &[&["v."], words].concat());
}

#[test]
fn every_type_is_read_in_every_version_and_byte_order() {
    macro_rules! check {
        ($($type:ident $variant:ident $code:literal;)*) => {$({
            let mut values: Vec<$type> = (1..13_u8).map(|i| i as $type).collect();
            (values[1], values[2]) = ($type::MIN, $type::MAX);
            values[3] = $type::from_le_bytes(std::array::from_fn(|i| 64 - 3 * i as u8));
            for version in [Analyze, One, Two] {
                for big in [false, true] {
                    let bytes: Vec<u8> = values
                        .iter()
                        .flat_map(|value| if big { value.to_be_bytes() } else { value.to_le_bytes() })
                        .collect();
                    let header = Header::with(version, |header| {
                        header.big = big;
                        header.datatype = $code;
                        header.bitpix = 8 * size_of::<$type>() as i16;
                    });
                    let volume = open(&header, &bytes).unwrap();
                    assert!(volume.voxels == Voxels::$variant(values.clone()), "{version:?} {}", stringify!($type));
                }
            }
        })*};
    }
    check! {
        u8 U8 2; i16 I16 4; i32 I32 8; f32 F32 16; f64 F64 64; i8 I8 256; u16 U16 512; u32 U32 768; i64 I64 1024;
        u64 U64 1280;
    }
}

#[test]
fn files_are_found_by_either_name_with_and_without_gzip() {
    let single = |version| [Header::new(version).bytes(), TWELVE.to_vec()].concat();
    let pair = Header::with(One, |header| {
        header.magic = b"ni1\0".to_vec();
        header.vox_offset = 0.0;
    });
    for version in [One, Two] {
        let files = Files::new();
        files.with("a.nii", &single(version)).with("b.nii.gz", &gzip(&single(version)));
        // A name that promises nothing: the content decides.
        files.with("c", &single(version)).with("d.data", &gzip(&single(version))).with("E.NII", &single(version));
        for name in ["a.nii", "b.nii.gz", "c", "d.data", "E.NII"] {
            let volume = files.open(name, &Selection::default()).unwrap();
            assert_eq!((volume.voxels.bytes(), volume.files), (&TWELVE[..], vec![files.path(name)]), "{name}");
        }
    }
    for header in [pair, Header::new(Analyze)] {
        let (bytes, packed) = (header.bytes(), gzip(&header.bytes()));
        let files = Files::new();
        files.with("a.hdr", &bytes).with("a.img", &TWELVE);
        files.with("b.hdr.gz", &packed).with("b.img.gz", &gzip(&TWELVE));
        files.with("c.hdr", &bytes).with("c.img.gz", &gzip(&TWELVE));
        files.with("D.HDR", &bytes).with("D.IMG", &TWELVE);
        for name in ["a.hdr", "a.img", "b.hdr.gz", "b.img.gz", "c.hdr", "c.img.gz", "D.HDR", "D.IMG"] {
            let volume = files.open(name, &Selection::default()).unwrap_or_else(|error| panic!("{name}: {error}"));
            assert_eq!(volume.voxels.bytes(), TWELVE, "{name}");
            assert_eq!(volume.files.len(), 2, "{name}");
        }
        // Of two images, the one that was asked for is read.
        files.with("a.img.gz", &gzip(&TWELVE.map(|byte| byte + 50)));
        let first = |name| files.open(name, &Selection::default()).unwrap().voxels.bytes()[0];
        assert_eq!(["a.hdr", "a.img", "a.img.gz"].map(first), [1, 1, 51]);
        let alone = Files::new();
        let error = alone.with("v.hdr", &bytes).open("v.hdr", &Selection::default()).map(drop).unwrap_err();
        assert!(error.to_string().contains("v.img is missing"), "{error}");
    }
    // One file by the name of an image.
    let files = Files::new();
    let volume = files.with("v.img", &single(One)).open("v.img", &Selection::default()).unwrap();
    assert_eq!(volume.voxels.bytes(), TWELVE);
    // An image without a header is no Analyze file.
    let files = Files::new();
    let error = files.with("v.img", &TWELVE).open("v.img", &Selection::default()).map(drop).unwrap_err();
    assert!(matches!(error, VolumeError::UnknownFormat { .. }), "{error}");
}

#[test]
fn bytes_before_the_voxels_are_skipped_whatever_they_say() {
    for version in [One, Two] {
        let header = Header::with(version, |header| header.vox_offset = 1001.0);
        let mut bytes = header.bytes();
        // An extension whose length means nothing.
        let end = if version == Two { 540 } else { 348 };
        bytes[end..end + 8].copy_from_slice(&[1, 0, 0, 0, 255, 255, 255, 127]);
        bytes.extend(TWELVE);
        let files = Files::new();
        files.with("a.nii", &bytes).with("a.nii.gz", &gzip(&bytes));
        for name in ["a.nii", "a.nii.gz"] {
            assert_eq!(files.open(name, &Selection::default()).unwrap().voxels.bytes(), TWELVE, "{name}");
        }
    }
    let analyze = Header::with(Analyze, |header| header.vox_offset = 5.0);
    assert_eq!(open(&analyze, &TWELVE).unwrap().voxels.bytes(), TWELVE);
}

/// Steps, as columns, and origin of a volume, against rows of four in RAS.
fn lies_at(volume: &Volume, ras: [[f64; 4]; 3]) {
    let geometry = volume.geometry;
    let turn = [-1.0, -1.0, 1.0];
    for (row, ras) in ras.iter().enumerate() {
        for (column, stated) in ras[..3].iter().enumerate() {
            let ours = geometry.direction.col(column)[row] * geometry.spacing[column];
            let theirs = turn[row] * stated;
            assert!((ours - theirs).abs() <= 1e-6, "row {row}, column {column}: {ours}, not {theirs}");
        }
        let (ours, theirs) = (geometry.origin[row], turn[row] * ras[3]);
        assert!((ours - theirs).abs() <= 1e-5, "origin {row}: {ours}, not {theirs}");
    }
}

const ROWS: [f64; 12] = [0.0, -2.0, 0.0, 10.0, 1.5, 0.0, 0.0, -20.0, 0.0, 0.0, 3.0, 30.0];

#[test]
fn rows_of_the_sform_become_left_and_posterior() {
    for version in [One, Two] {
        let header = Header::with(version, |header| (header.codes, header.rows) = ([0, 4], ROWS));
        let volume = open(&header, &TWELVE).unwrap();
        lies_at(&volume, [[0.0, -2.0, 0.0, 10.0], [1.5, 0.0, 0.0, -20.0], [0.0, 0.0, 3.0, 30.0]]);
        assert_eq!(volume.geometry.spacing, DVec3::new(1.5, 2.0, 3.0), "lengths of the columns, not pixdim");
        assert_eq!((volume.anatomical, volume.unit), (true, Some(Unit::Millimetre)));
        assert!(volume.metadata.contains(&("space".to_owned(), "MNI 152 (4)".to_owned())));
        assert!(volume.metadata.contains(&("descrip".to_owned(), "words".to_owned())));
        assert!(volume.notes.is_empty(), "{:?}", volume.notes);
    }
    // A left-handed grid is a grid.
    let mut rows = ROWS;
    rows[10] = -3.0;
    let volume = open(&Header::with(One, |header| (header.codes, header.rows) = ([0, 1], rows)), &TWELVE).unwrap();
    assert!((volume.geometry.direction.determinant() + 1.0).abs() < 1e-6, "the hand of the file");
}

#[test]
fn a_quaternion_turns_the_axes_and_the_sign_of_pixdim_mirrors_the_third() {
    // A third of a turn around (1, 1, 1): x to y, y to z, z to x.
    for (version, hand) in [(One, 1.0), (One, 0.0), (One, -1.0), (Two, 1.0), (Two, -1.0)] {
        let header = Header::with(version, |header| {
            header.codes = [1, 0];
            header.pixdim = [hand, 2.0, 3.0, 4.0, 1.0, 1.0, 1.0, 1.0];
            header.quaternion = [0.5, 0.5, 0.5, 7.0, 8.0, 9.0];
        });
        let volume = open(&header, &TWELVE).unwrap();
        let third = if hand < 0.0 { -4.0 } else { 4.0 };
        lies_at(&volume, [[0.0, 0.0, third, 7.0], [2.0, 0.0, 0.0, 8.0], [0.0, 3.0, 0.0, 9.0]]);
        assert!(volume.anatomical);
    }
    // Half a turn around x, where the rounding of the header makes b² exceed 1.
    let half = Header::with(Two, |header| {
        header.codes = [1, 0];
        header.quaternion = [1.0 + 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0];
    });
    lies_at(&open(&half, &TWELVE).unwrap(), [[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]);
}

#[test]
fn the_sform_is_used_and_a_note_says_if_the_qform_disagrees() {
    let both = |x: f64| {
        Header::with(One, |header| {
            header.codes = [1, 1];
            header.rows = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        })
    };
    let volume = open(&both(5.0), &TWELVE).unwrap();
    assert_eq!(volume.geometry.origin, DVec3::new(-5.0, 0.0, 0.0));
    assert!(volume.notes[0].contains("5.0 voxels apart"), "{:?}", volume.notes);
    assert!(open(&both(0.9), &TWELVE).unwrap().notes.is_empty(), "less than a voxel");
}

#[test]
fn without_a_placement_only_the_spacings_are_used_and_a_note_says_so() {
    for version in [Analyze, One, Two] {
        let header = Header::with(version, |header| header.pixdim = [0.0, -2.0, 0.0, 4.0, 0.0, 0.0, 0.0, 0.0]);
        let volume = open(&header, &TWELVE).unwrap();
        assert_eq!(volume.geometry.spacing, DVec3::new(2.0, 1.0, 4.0), "no signs, and 0 is 1");
        assert_eq!((volume.geometry.origin, volume.geometry.direction), (DVec3::ZERO, DMat3::IDENTITY));
        assert!(!volume.anatomical && volume.notes.len() == 2, "{:?}", volume.notes);
    }
}

#[test]
fn lengths_become_millimetres() {
    for (units, factor) in [(0, 1.0), (1, 1000.0), (2, 1.0), (3, 1e-3), (2 | 8, 1.0)] {
        let header = Header::with(Two, |header| {
            (header.units, header.codes, header.rows) = (units, [0, 1], ROWS);
        });
        let geometry = open(&header, &TWELVE).unwrap().geometry;
        assert!(geometry.spacing.abs_diff_eq(DVec3::new(1.5, 2.0, 3.0) * factor, 1e-12), "{units}: {geometry:?}");
        assert!(geometry.origin.abs_diff_eq(DVec3::new(-10.0, 20.0, 30.0) * factor, 1e-9), "{units}: {geometry:?}");
    }
}

#[test]
fn a_slope_of_0_scales_nothing_and_a_negative_one_swaps_the_ends() {
    let scaled = |slope: [f64; 2]| open(&Header::with(One, |header| header.slope = slope), &TWELVE).unwrap();
    let ends = |volume: &Volume| volume.statistics().map(|it| (it.min, it.max)).unwrap();
    assert_eq!(ends(&scaled([2.0, 5.0])), (7.0, 29.0));
    assert_eq!(ends(&scaled([-2.0, 5.0])), (-19.0, 3.0));
    for slope in [0.0, f64::NAN, f64::INFINITY] {
        assert_eq!(ends(&scaled([slope, 5.0])), (1.0, 12.0), "{slope}: the intercept is not added either");
    }
    let header = Header::with(One, |header| header.slope = [2.0, f64::NAN]);
    refused(&header, &TWELVE, &["scl_inter", "NaN", "2"]);
}

#[test]
fn a_window_and_labels_are_kept() {
    let header = Header::with(One, |header| header.window = [-100.0, 200.0]);
    let window = Window { name: "window of the file".to_owned(), low: -100.0, high: 200.0 };
    assert_eq!(open(&header, &TWELVE).unwrap().presets.windows, [window]);
    for window in [[0.0, 0.0], [2.0, 1.0], [0.0, f64::NAN]] {
        let header = Header::with(One, |header| header.window = window);
        assert!(open(&header, &TWELVE).unwrap().presets.windows.is_empty(), "{window:?}");
    }
    assert!(open(&Header::with(One, |header| header.intent = 1002), &TWELVE).unwrap().has_labels);
    assert!(!open(&Header::new(One), &TWELVE).unwrap().has_labels);
}

#[test]
fn colours_vectors_and_times_are_chosen() {
    let choose = |component, time| Selection { component, time, ..Selection::default() };
    let asked = |header: &Header, data: &[u8], flag: &str| {
        let error = open(header, data).map(|volume| volume.voxels).unwrap_err();
        assert!(matches!(error, VolumeError::Choose { .. }) && error.to_string().contains(flag), "{error}");
    };
    // Colours lie side by side, and a slope does not apply to them.
    let colours = Header::with(One, |header| {
        (header.datatype, header.bitpix, header.dim) = (128, 24, [3, 2, 2, 1, 1, 1, 1, 1]);
        header.slope = [3.0, 1.0];
    });
    asked(&colours, &TWELVE, "RGB");
    let volume = select(&colours, &TWELVE, &choose(Some(1), None)).unwrap();
    assert_eq!((volume.voxels, volume.components), (Voxels::U8(vec![2, 5, 8, 11]), 3));
    assert_eq!((volume.slope, volume.intercept), (1.0, 0.0));
    let colours = Header::with(Two, |header| {
        (header.datatype, header.bitpix, header.dim) = (2304, 32, [3, 3, 1, 1, 1, 1, 1, 1]);
    });
    asked(&colours, &TWELVE, "RGBA");
    assert_eq!(select(&colours, &TWELVE, &choose(Some(3), None)).unwrap().voxels, Voxels::U8(vec![4, 8, 12]));
    // Vectors and tensors are planes behind all times.
    for (intent, name) in [(1005, "symmetric matrix"), (1006, "displacement vector"), (1007, "vector"), (0, "2 comp")] {
        let vectors = Header::with(One, |header| (header.intent, header.dim) = (intent, [5, 3, 2, 1, 1, 2, 1, 1]));
        asked(&vectors, &TWELVE, name);
        let volume = select(&vectors, &TWELVE, &choose(Some(1), None)).unwrap();
        assert_eq!(volume.voxels, Voxels::U8(vec![7, 8, 9, 10, 11, 12]));
    }
    let times = Header::with(One, |header| {
        (header.dim, header.pixdim[4], header.units) = ([4, 3, 1, 2, 2, 1, 1, 1], 2.5, 2 | 16);
    });
    asked(&times, &TWELVE, "2 time steps");
    let volume = select(&times, &TWELVE, &choose(None, Some(1))).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(vec![7, 8, 9, 10, 11, 12]));
    assert!(volume.metadata.contains(&("time step".to_owned(), "2.5 ms".to_owned())), "{:?}", volume.metadata);
    let both = Header::with(One, |header| header.dim = [5, 3, 1, 1, 2, 2, 1, 1]);
    let volume = select(&both, &TWELVE, &choose(Some(1), Some(0))).unwrap();
    assert_eq!(volume.voxels, Voxels::U8(vec![7, 8, 9]));
}

/// A grid of 4×3×5 whose z axis leans along y: half a voxel of y per slice. The values are 10 y in the world.
fn leaning(labels: bool) -> Header {
    Header::with(One, |header| {
        header.dim = [3, 4, 3, 5, 1, 1, 1, 1];
        (header.datatype, header.bitpix) = (16, 32);
        header.codes = [0, 1];
        header.rows = [-2.0, 0.0, 0.0, 0.0, 0.0, -1.0, -0.5, 0.0, 0.0, 0.0, 1.5, 0.0];
        header.intent = if labels { 1002 } else { 0 };
    })
}

fn slanted() -> Vec<u8> {
    let at = |i: u8| 10.0_f32 * (f32::from(i / 4 % 3) + 0.5 * f32::from(i / 12));
    (0..60).flat_map(|i| at(i).to_le_bytes()).collect()
}

#[test]
fn a_leaning_grid_is_refused_with_its_angles_or_resampled_to_a_straight_one() {
    let degrees = (0.5_f64 / 2.5_f64.sqrt()).acos().to_degrees();
    refused(
        &leaning(false),
        &slanted(),
        &["lean", "90.000° between x and y", &format!("{degrees:.3}° between y and z")],
    );
    let resample = Selection { resample: true, ..Selection::default() };
    let volume = select(&leaning(false), &slanted(), &resample).unwrap();
    // y runs from 0 to 2 in the first slice and from 2 to 4 in the last.
    assert_eq!(volume.geometry.dims, [4, 5, 5]);
    assert!(volume.geometry.spacing.abs_diff_eq(DVec3::new(2.0, 1.0, 1.5), 1e-6), "{}", volume.geometry.spacing);
    assert!(volume.notes.iter().any(|note| note.contains("4×3×5") && note.contains("4×5×5")), "{:?}", volume.notes);
    for (z, y) in (0..5).flat_map(|z| (0..5).map(move |y| (z, y))) {
        let (place, start) = (f64::from(y), 0.5 * f64::from(z));
        let inside = place >= start && place <= start + 2.0;
        let expected = if inside { 10.0 * place } else { 0.0 };
        for x in 0..4 {
            let value = volume.value([x, y as usize, z as usize]).unwrap();
            assert!((value - expected).abs() < 1e-4, "{x} {y} {z}: {value}, not {expected}");
        }
    }
    // Labels are never mixed: only numbers of the file come out.
    let volume = select(&leaning(true), &slanted(), &resample).unwrap();
    let Voxels::F32(voxels) = &volume.voxels else { panic!("{:?}", volume.voxels) };
    assert!(voxels.iter().all(|voxel| (voxel / 5.0).fract() == 0.0), "{voxels:?}");
    assert!(volume.has_labels);
    // Outside lies the smallest value, not the smallest number, whether the first voxel is NaN or not.
    let mut stored = slanted();
    stored[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    for (slope, outside) in [(1.0, 0.0), (-1.0, -40.0)] {
        let mut header = leaning(false);
        header.slope = [slope, 0.0];
        let volume = select(&header, &stored, &resample).unwrap();
        assert_eq!(volume.value([3, 4, 0]), Some(outside), "slope {slope}");
    }
    // A straight grid is not resampled.
    let straight = select(&Header::new(One), &TWELVE, &resample).unwrap();
    assert_eq!(straight.voxels.bytes(), TWELVE);
    // Axes in a plane cannot be told apart.
    let flat = Header::with(One, |header| {
        header.codes = [0, 1];
        header.rows = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.05, 0.0];
    });
    let error = select(&flat, &TWELVE, &resample).map(drop).unwrap_err();
    assert!(matches!(error, VolumeError::Lean { .. }), "{error}");
}

#[test]
fn a_scene_and_a_session_can_ask_for_resampling() {
    let files = Files::new();
    let volume = files.with("v.nii", &[leaning(false).bytes(), slanted()].concat()).path("v.nii");
    let loaded = |selection, definition: &str| {
        let definitions = vec![Definition::new("volume.phantom_labels=false"), Definition::new(definition)];
        let options = SceneOptions { volume: Some(volume.clone()), selection, definitions, ..SceneOptions::default() };
        document::load_embedded(&options, &Quiet).map(|file| file.scene.frame.geometry.dims)
    };
    let resample = Selection { resample: true, ..Selection::default() };
    assert_eq!(loaded(resample, "background=0.5").unwrap(), [4, 5, 5]);
    assert!(loaded(Selection::default(), "background=0.5").is_err(), "nobody asked for it");
}

#[test]
fn the_window_of_a_file_is_the_first_transfer_function() {
    let files = Files::new();
    let header = Header::with(One, |header| header.window = [3.0, 9.0]);
    files.with("v.nii", &[header.bytes(), TWELVE.to_vec()].concat());
    let (file, _) = Source::of(&files.path("v.nii")).read(&Quiet).unwrap();
    let terms = &file.scene.transfer.terms;
    assert_eq!(terms.len(), 3);
    assert_eq!(terms[0].opacity[0], (3.0, 0.0), "nothing up to its low end");
    let end = terms[2].opacity[2];
    assert_eq!(end.0, 12.0, "the values above it are as solid as its high end");
    let without = Header::new(One);
    files.with("v.nii", &[without.bytes(), TWELVE.to_vec()].concat());
    let (file, _) = Source::of(&files.path("v.nii")).read(&Quiet).unwrap();
    assert!(file.scene.transfer.terms[0].opacity[0].0 > 3.0, "by the histogram: the upper half");
}

#[test]
fn headers_that_contradict_themselves_are_refused_with_the_numbers() {
    let with = |change: fn(&mut Header)| Header::with(One, change);
    for (header, words) in [
        (with(|it| it.dim[2] = 0), &["dim[2]", "0 voxels"][..]),
        (with(|it| it.dim[3] = -2), &["dim[3]", "-2 voxels"]),
        (with(|it| it.dim[0] = 0), &["dim[0]", "0 axes", "1 to 7"]),
        (with(|it| it.dim[0] = 8), &["dim[0]", "8 axes"]),
        (with(|it| it.dim = [6, 3, 2, 1, 1, 1, 2, 1]), &["3×2×1×1×1×2", "more than three"]),
        (with(|it| it.dim = [7, 3, 2, 1, 1, 1, 1, 2]), &["3×2×1×1×1×1×2"]),
        (with(|it| it.datatype = 1), &["datatype", "1 bit"]),
        (with(|it| it.datatype = 32), &["complex", "32"]),
        (with(|it| it.datatype = 1536), &["128 bits"]),
        (with(|it| it.datatype = 1792), &["complex", "64"]),
        (with(|it| it.datatype = -9510), &["-9510"]),
        (with(|it| it.bitpix = 16), &["bitpix", "16 bits", "datatype 2 has 8"]),
        (with(|it| it.vox_offset = 100.0), &["vox_offset", "byte 100", "348"]),
        (with(|it| it.vox_offset = -1.0), &["vox_offset", "-1"]),
        (with(|it| it.vox_offset = 400.5), &["vox_offset", "400.5"]),
        (with(|it| it.vox_offset = f64::NAN), &["vox_offset", "NaN"]),
        (with(|it| it.vox_offset = 1e12), &["vox_offset", "999999995904", "360 bytes"]),
        (with(|it| (it.codes, it.rows[3]) = ([0, 1], f64::INFINITY)), &["srow_x", "inf"]),
        (with(|it| (it.codes, it.quaternion[0]) = ([1, 0], f64::NAN)), &["quatern_b", "NaN"]),
        (with(|it| it.pixdim[1] = f64::NAN), &["pixdim", "NaN"]),
        (with(|it| it.dim = [3, 300, 200, 100, 1, 1, 1, 1]), &["12 bytes", "6000000"]),
    ] {
        refused(&header, &TWELVE, words);
    }
    let two = Header::with(Two, |it| it.dim = [3, i64::MAX, 2, 2, 1, 1, 1, 1]);
    refused(&two, &TWELVE, &["9223372036854775807"]);
    refused(&Header::with(Two, |it| it.vox_offset = 400.0), &TWELVE, &["byte 400", "540"]);
    refused(&Header::new(One), &TWELVE[..11], &["11 bytes", "12"]);
    let files = Files::new();
    for (bytes, words) in [(&[0; 1024][..], "0 is not the length"), (&[1; 40], "40 bytes")] {
        let error = files.with("v.nii", bytes).open("v.nii", &Selection::default()).map(drop).unwrap_err();
        assert!(error.to_string().contains(words), "{error}");
    }
}

#[test]
fn compressed_files_that_lie_are_refused_before_memory_is_taken() {
    let huge = Header::with(One, |header| header.dim = [3, 30000, 30000, 30000, 1, 1, 1, 1]);
    let whole = |header: &Header, data: &[u8]| gzip(&[header.bytes(), data.to_vec()].concat());
    let files = Files::new();
    let open = |bytes: &[u8]| {
        let error = files.with("v.nii.gz", bytes).open("v.nii.gz", &Selection::default()).map(drop).unwrap_err();
        volumes::whole_message(&error)
    };
    let message = open(&whole(&huge, &TWELVE));
    assert!(message.contains("27000000000352") && message.contains("gzip"), "{message}");
    let far = Header::with(Two, |header| header.vox_offset = 1e12);
    let message = open(&whole(&far, &TWELVE));
    assert!(message.contains("vox_offset") && message.contains("1000000000000"), "{message}");
    let message = open(&whole(&Header::new(One), &TWELVE[..11]));
    assert!(message.contains("11 bytes") && message.contains("12"), "{message}");
    let mut damaged = whole(&Header::new(One), &TWELVE);
    let length = damaged.len();
    damaged[length - 6] ^= 1;
    assert!(open(&damaged).contains("damaged gzip"), "the checksum");
    let whole = whole(&Header::new(One), &TWELVE);
    assert!(open(&whole[..20]).contains("v.nii.gz"), "cut in the header");
}

#[test]
fn a_file_longer_than_its_header_says_is_read_with_a_note() {
    let volume = open(&Header::new(One), &[&TWELVE[..], &[0; 4]].concat()).unwrap();
    assert!(volume.notes.iter().any(|note| note.contains("16 bytes") && note.contains("12")), "{:?}", volume.notes);
}

/// An sform in whose columns the axes have these lengths, with the first voxel at 7, 8, 9.
fn sform(x: [f64; 3], y: [f64; 3], z: [f64; 3]) -> [f64; 12] {
    let row = |row: usize, first: f64| [x[row], y[row], z[row], first];
    [row(0, 7.0), row(1, 8.0), row(2, 9.0)].concat().try_into().unwrap()
}

#[test]
fn a_singular_sform_gives_way_to_the_qform_or_the_spacings() {
    let flat = [
        [0.0; 12],
        sform([3.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0; 3]),
        // All axes in the plane of x and y.
        sform([3.0, 0.0, 0.0], [0.0, 0.5, 0.0], [2.0, 1.0, 0.0]),
        sform([1.0, 2.0, 2.0], [2.0, 4.0, 4.0], [0.0, 0.0, 1.0]),
    ];
    for (version, rows) in [(One, flat[0]), (One, flat[1]), (Two, flat[2]), (Two, flat[3])] {
        let header = |codes: [i16; 2]| {
            Header::with(version, |header| {
                (header.codes, header.rows) = (codes, rows);
                header.pixdim = [1.0, 0.75, 1.25, 2.5, 1.0, 1.0, 1.0, 1.0];
                // No rotation.
                header.quaternion = [0.0, 0.0, 0.0, 4.0, 5.0, 6.0];
            })
        };
        // `codes` are those of the qform and the sform.
        let by_qform = open(&header([1, 2]), &TWELVE).unwrap();
        assert_eq!(by_qform.geometry.spacing, DVec3::new(0.75, 1.25, 2.5), "{rows:?}");
        assert_eq!(by_qform.geometry.origin, DVec3::new(-4.0, -5.0, 6.0), "{rows:?}");
        assert!(by_qform.anatomical, "{rows:?}");
        let [note] = &by_qform.notes[..] else { panic!("{:?}", by_qform.notes) };
        assert!(note.contains("sform (code 2)") && note.contains("uses the qform"), "{note}");
        let by_spacings = open(&header([0, 1]), &TWELVE).unwrap();
        assert_eq!(by_spacings.geometry.spacing, DVec3::new(0.75, 1.25, 2.5), "{rows:?}");
        assert!(!by_spacings.anatomical, "{rows:?}");
        let [note] = &by_spacings.notes[..] else { panic!("{:?}", by_spacings.notes) };
        assert!(note.contains("sform (code 1)") && note.contains("spacings of pixdim"), "{note}");
    }
    // One slice has no step across it; its sform is none that is singular.
    let slice = Header::with(One, |header| {
        (header.codes, header.rows) = ([0, 1], flat[1]);
        header.dim = [3, 3, 4, 1, 1, 1, 1, 1];
    });
    let slice = open(&slice, &TWELVE).unwrap();
    assert_eq!((slice.geometry.spacing.x, slice.geometry.spacing.y, slice.notes.len()), (3.0, 0.5, 0));
}
