//! MRC and CCP4 maps: those of the shared folder, and generated ones of every mode, byte order and order of axes;
//! invalid files.
#![expect(clippy::cast_possible_truncation, reason = "numbers of headers are small")]

use crate::support::volumes;

use std::io::Write as _;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::{DMat3, DVec3};
use relume::progress::Quiet;
use relume::volume::{self, Selection, Unit, Volume, VolumeError, Voxels};

#[test]
fn every_shared_file_reads_as_an_independent_reader_found_it() {
    volumes::check_below("mrc/", 4);
    let Some(folder) = volumes::shared() else { return };
    let open = |name: &str| volume::open(&folder.join(name), &Selection::default(), &Quiet).unwrap();
    assert_eq!(open("mrc/mode2.mrc").unit, Some(Unit::Angstrom));
    assert_eq!(open("mrc/mode6_ext.map").geometry.origin, DVec3::new(-4.5, 6.0, 7.5), "by nstart");
}

/// A file of 3×2×2 signed bytes with a cell of 3 Å × 2 Å × 2 Å, whose words (byte offset, bits) can be changed.
#[derive(Clone)]
struct File {
    big: bool,
    words: Vec<(usize, u32)>,
    extended: usize,
    data: Vec<u8>,
}

const TWELVE: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

impl File {
    fn new() -> Self {
        let one = |at: usize, number: f32| (at, number.to_bits());
        let mut words =
            vec![(0, 3), (4, 2), (8, 2), (12, 0), (28, 3), (32, 2), (36, 2), (64, 1), (68, 2), (72, 3), (88, 1)];
        words.extend([one(40, 3.0), one(44, 2.0), one(48, 2.0), one(52, 90.0), one(56, 90.0), one(60, 90.0)]);
        Self { big: false, words, extended: 0, data: TWELVE.to_vec() }
    }

    fn with(&self, words: &[(usize, u32)]) -> Self {
        let mut file = self.clone();
        file.words.extend(words);
        file
    }

    fn floats(&self, floats: &[(usize, f32)]) -> Self {
        self.with(&floats.iter().map(|&(at, number)| (at, number.to_bits())).collect::<Vec<_>>())
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0; 1024];
        for &(at, word) in &self.words {
            let word = if self.big { word.to_be_bytes() } else { word.to_le_bytes() };
            bytes[at..at + 4].copy_from_slice(&word);
        }
        bytes[208..212].copy_from_slice(b"MAP ");
        bytes[212..214].copy_from_slice(if self.big { &[0x11, 0x11] } else { &[0x44, 0x44] });
        bytes.extend(vec![9; self.extended]);
        bytes.extend(&self.data);
        bytes
    }

    fn open(&self) -> Result<Volume, VolumeError> {
        open("v.mrc", &self.bytes(), &Selection::default())
    }

    fn refused(&self, words: &[&str]) {
        volumes::refused(self.open(), &[&["v.mrc"], words].concat());
    }
}

fn open(name: &str, bytes: &[u8], selection: &Selection) -> Result<Volume, VolumeError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    volume::open(&path, selection, &Quiet)
}

/// Numbers as bytes in either order.
macro_rules! bytes {
    ($values:expr, $big:expr) => {
        $values.iter().flat_map(|value| if $big { value.to_be_bytes() } else { value.to_le_bytes() }).collect()
    };
}

#[test]
fn every_mode_is_read_in_both_byte_orders_with_and_without_a_stamp() {
    for big in [false, true] {
        let mode = |mode: u32, data: Vec<u8>| File { big, data, ..File::new().with(&[(12, mode)]) };
        let shorts: [i16; 12] = std::array::from_fn(|i| 300 * i as i16 - 1000);
        let words: [u16; 12] = std::array::from_fn(|i| 5000 * i as u16);
        let floats: [f32; 12] = std::array::from_fn(|i| f32::from(i as u8) / 8.0 - 1.0);
        let halves = floats.map(|value| half::f16::from_f32(value).to_bits());
        let signed = TWELVE.map(|byte| byte.cast_signed());
        for (file, voxels) in [
            (mode(0, TWELVE.to_vec()), Voxels::I8(signed.to_vec())),
            (mode(1, bytes!(shorts, big)), Voxels::I16(shorts.to_vec())),
            (mode(2, bytes!(floats, big)), Voxels::F32(floats.to_vec())),
            (mode(6, bytes!(words, big)), Voxels::U16(words.to_vec())),
            (mode(12, bytes!(halves, big)), Voxels::F32(floats.to_vec())),
        ] {
            assert!(file.open().unwrap().voxels == voxels, "{:?}, big-endian: {big}", voxels.type_name());
            // Old files have neither the word MAP nor a stamp.
            let mut old = file.bytes();
            old[208..216].fill(0);
            assert!(open("v.mrc", &old, &Selection::default()).unwrap().voxels == voxels, "{}", voxels.type_name());
        }
        let imod = mode(0, TWELVE.to_vec()).with(&[(152, 1_146_047_817)]);
        assert_eq!(imod.open().unwrap().voxels, Voxels::U8(TWELVE.to_vec()), "IMOD's unsigned bytes");
        assert_eq!(imod.with(&[(156, 1)]).open().unwrap().voxels, Voxels::I8(signed.to_vec()), "IMOD's signed ones");
    }
    let stamp = |second: u8| {
        let mut bytes = File::new().bytes();
        bytes[213] = second;
        open("v.mrc", &bytes, &Selection::default()).unwrap().voxels.len()
    };
    assert_eq!(stamp(0x41), 12, "the other stamp of little-endian machines");
}

#[test]
fn maps_are_found_by_their_content_and_inside_gzip() {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(&File { extended: 80, ..File::new().with(&[(92, 80)]) }.bytes()).unwrap();
    let packed = encoder.finish().unwrap();
    for name in ["v.map.gz", "v.data"] {
        assert_eq!(open(name, &packed, &Selection::default()).unwrap().voxels.bytes(), TWELVE, "{name}");
    }
    let plain = File::new().bytes();
    for name in ["v.ccp4", "v.map", "v.rec", "v.MRC", "v.unknown"] {
        assert_eq!(open(name, &plain, &Selection::default()).unwrap().voxels.bytes(), TWELVE, "{name}");
    }
    // A map whose first side looks like the mark of bzip2 is a map.
    let error = File::new().with(&[(0, u32::from_le_bytes(*b"BZh9"))]).open().map(drop).unwrap_err();
    assert!(error.to_string().contains("12 bytes"), "{error}");
    // Another format by the name of a map.
    let error = open("v.map", b"%PDF-1.7", &Selection::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("8 bytes"), "{error}");
    let error = open("v.map", b"\x89PNG\r\n\x1a\n", &Selection::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("a PNG picture"), "{error}");
}

#[test]
fn voxels_begin_behind_the_extended_header() {
    let file = File { extended: 800, ..File::new().with(&[(92, 800)]) };
    assert_eq!(file.open().unwrap().voxels.bytes(), TWELVE);
}

#[test]
fn columns_rows_and_sections_run_along_the_axes_that_the_header_names() {
    // The cell is 6×8×10 Å of 3×2×2 intervals along x, y, z; columns run along z, rows along x, sections along y.
    let file = File::new().with(&[(64, 3), (68, 1), (72, 2), (28, 2), (32, 2), (36, 3)]).floats(&[
        (40, 6.0),
        (44, 8.0),
        (48, 10.5),
    ]);
    let geometry = file.open().unwrap().geometry;
    assert_eq!(geometry.dims, [3, 2, 2], "the voxels stay as they are");
    assert_eq!(geometry.spacing, DVec3::new(3.5, 3.0, 4.0), "of z, x and y");
    assert_eq!(geometry.direction, DMat3::from_cols(DVec3::Z, DVec3::X, DVec3::Y));
    // The start is counted in columns, rows and sections.
    let started = file.with(&[(16, 2), (20, u32::MAX), (24, 10)]).open().unwrap();
    assert_eq!(started.geometry.origin, DVec3::new(-3.0, 40.0, 7.0));
    let placed = file.with(&[(16, 2)]).floats(&[(196, 1.0), (200, 2.0), (204, 3.0)]).open().unwrap();
    assert_eq!(placed.geometry.origin, DVec3::new(1.0, 2.0, 3.0), "an origin has priority");
    let unset = File::new().with(&[(64, 0), (68, 0), (72, 0)]).open().unwrap();
    assert_eq!(unset.geometry.direction, DMat3::IDENTITY);
    assert!(unset.notes.iter().any(|note| note.contains("taken as 1 2 3")), "{:?}", unset.notes);
    File::new().with(&[(68, 1)]).refused(&["1 1 3"]);
    File::new().with(&[(68, 4)]).refused(&["1 4 3"]);
}

#[test]
fn a_cell_gives_the_spacing_in_angstrom() {
    let volume = File::new().floats(&[(40, 4.5), (44, 1.0), (48, 4.0)]).open().unwrap();
    assert_eq!((volume.geometry.spacing, volume.unit), (DVec3::new(1.5, 0.5, 2.0), Some(Unit::Angstrom)));
    assert!(!volume.anatomical && volume.notes.is_empty(), "{:?}", volume.notes);
    // Without intervals, the cell is as long as the volume.
    let volume = File::new().with(&[(28, 0), (32, 0), (36, 0)]).floats(&[(40, 4.5)]).open().unwrap();
    assert_eq!(volume.geometry.spacing, DVec3::new(1.5, 1.0, 1.0));
    let volume = File::new().floats(&[(40, 0.0), (44, 0.0), (48, 0.0)]).open().unwrap();
    assert_eq!((volume.geometry.spacing, volume.unit), (DVec3::ONE, None));
    assert!(volume.notes[0].contains("0 0 0"), "{:?}", volume.notes);
    File::new().floats(&[(44, f32::NAN)]).refused(&["cella", "NaN"]);
    File::new().floats(&[(200, f32::INFINITY)]).refused(&["origin", "inf"]);
}

#[test]
fn a_leaning_cell_is_refused_with_its_angles_or_resampled() {
    let file = File { data: TWELVE.map(|byte| 10 * byte).to_vec(), ..File::new().floats(&[(60, 120.0)]) };
    file.refused(&["lean", "120.000° between x and y", "90.000° between x and z"]);
    let resample = Selection { resample: true, ..Selection::default() };
    let volume = open("v.mrc", &file.bytes(), &resample).unwrap();
    // The second row lies half a voxel to the left: 4 columns hold both.
    assert_eq!(volume.geometry.dims, [4, 2, 2]);
    assert!((volume.geometry.spacing.y - 0.75_f64.sqrt()).abs() < 1e-12, "{}", volume.geometry.spacing);
    let Voxels::I8(voxels) = &volume.voxels else { panic!("{:?}", volume.voxels) };
    // The columns lie at -0.5, 0.5, 1.5, 2.5: between the voxels of the first row, on those of the second.
    assert_eq!(voxels[..8], [10, 15, 25, 10, 40, 50, 60, 10]);
    File::new().floats(&[(60, 3.0)]).refused(&["3.000°"]);
    for angles in [[90.0, 90.0, 180.0], [60.0, 60.0, 150.0]] {
        let [a, b, c] = angles;
        let words = format!("{a}, {b} and {c}");
        File::new().floats(&[(52, a), (56, b), (60, c)]).refused(&["cellb", "no cell", &words]);
    }
}

#[test]
fn a_stack_of_volumes_is_a_choice_of_times() {
    let stack = File::new().with(&[(88, 401), (36, 1)]);
    let error = stack.open().map(drop).unwrap_err();
    assert!(error.to_string().contains("2 time steps"), "{error}");
    let second = Selection { time: Some(1), ..Selection::default() };
    let volume = open("v.mrc", &stack.bytes(), &second).unwrap();
    assert_eq!((volume.geometry.dims, volume.voxels.bytes()), ([3, 2, 1], &TWELVE[6..]));
    // 400 and the space group.
    for (group, dims) in [(400, [3, 2, 2]), (419, [3, 2, 1]), (630, [3, 2, 1]), (631, [3, 2, 2])] {
        let chosen = Selection { time: Some(0), ..Selection::default() };
        let volume = open("v.mrc", &File::new().with(&[(88, group), (36, 1)]).bytes(), &chosen).unwrap();
        assert_eq!(volume.geometry.dims, dims, "{group}");
    }
    File::new().with(&[(88, 401), (36, 3)]).refused(&["mz", "3 sections each", "2 sections"]);
    let images = File::new().with(&[(88, 0)]).open().unwrap();
    assert!(images.notes[0].contains("stack of images"), "{:?}", images.notes);
}

#[test]
fn headers_that_contradict_themselves_are_refused_with_the_numbers() {
    File::new().with(&[(12, 3)]).refused(&["mode", "3", "complex"]);
    File::new().with(&[(12, 4)]).refused(&["complex"]);
    File::new().with(&[(12, 101)]).refused(&["101", "4 bits"]);
    File::new().with(&[(12, 77)]).refused(&["77"]);
    File::new().with(&[(4, 0)]).refused(&["3×0×2"]);
    File::new().with(&[(4, u32::MAX)]).refused(&["3×-1×2"]);
    File::new().with(&[(0, 60000), (4, 60000), (8, 60000)]).refused(&["12 bytes", "216000000000000"]);
    File::new().with(&[(92, u32::MAX)]).refused(&["nsymbt", "-1 bytes"]);
    File::new().with(&[(92, 13)]).refused(&["nsymbt", "1037", "1036"]);
    File { data: TWELVE[1..].to_vec(), ..File::new() }.refused(&["11 bytes", "12"]);
    let mut bytes = File::new().with(&[(12, 77)]).bytes();
    bytes[212..214].fill(0);
    let error = open("v.mrc", &bytes, &Selection::default()).map(drop).unwrap_err();
    assert!(error.to_string().contains("machine stamp"), "{error}");
}

#[test]
fn labels_of_the_header_are_kept() {
    let mut bytes = File::new().with(&[(220, 1)]).bytes();
    bytes[224..236].copy_from_slice(b"made by hand");
    let volume = open("v.mrc", &bytes, &Selection::default()).unwrap();
    assert!(volume.metadata.contains(&("label 0".to_owned(), "made by hand".to_owned())), "{:?}", volume.metadata);
}
