//! MGH files of `FreeSurfer`: generated ones of every type, placement and compression; invalid files.

use crate::support::volumes;

use std::io::Write as _;

use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use relume::progress::Quiet;
use relume::volume::{self, Selection, Unit, Volume, VolumeError, Voxels};

/// A file of 3×2×4 voxels, whose words (byte offset, big-endian bits) can be changed.
#[derive(Clone)]
struct File {
    words: Vec<(usize, u32)>,
    flag: i16,
    data: Vec<u8>,
}

/// Sizes of a voxel, unit vectors of the axes in right-anterior-superior, and the place of the centre.
const DELTA: [f32; 3] = [1.5, 0.5, 2.0];
const AXES: [[f32; 3]; 3] = [[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];
const CENTRE: [f32; 3] = [4.0, -10.0, 21.0];

impl File {
    fn new(kind: u32, data: Vec<u8>) -> Self {
        let mut words = vec![(0, 1), (4, 3), (8, 2), (12, 4), (16, 1), (20, kind)];
        let floats = DELTA.iter().chain(AXES.iter().flatten()).chain(&CENTRE);
        words.extend(floats.enumerate().map(|(index, &number)| (30 + 4 * index, number.to_bits())));
        Self { words, flag: 1, data }
    }

    fn with(&self, words: &[(usize, u32)]) -> Self {
        let mut file = self.clone();
        file.words.extend(words);
        file
    }

    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![0; 284];
        for &(at, word) in &self.words {
            bytes[at..at + 4].copy_from_slice(&word.to_be_bytes());
        }
        bytes[28..30].copy_from_slice(&self.flag.to_be_bytes());
        bytes.extend(&self.data);
        // The times of the scanner, and a tag.
        bytes.extend([7; 20]);
        bytes
    }

    fn gzip(&self) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
        encoder.write_all(&self.bytes()).unwrap();
        encoder.finish().unwrap()
    }
}

fn open(name: &str, bytes: &[u8]) -> Result<Volume, VolumeError> {
    volumes::opened(name, bytes, &Selection::default())
}

/// Numbers from 0, in the type of the file.
fn shorts(count: i16) -> Vec<u8> {
    (0..count).flat_map(|number| (number * 37 - 400).to_be_bytes()).collect()
}

#[test]
fn every_type_is_read_with_and_without_compression() {
    let numbers = 0..24_u8;
    let bytes: Vec<u8> = numbers.clone().collect();
    let ints: Vec<i32> = numbers.clone().map(|n| i32::from(n) * 100_003 - 7).collect();
    let floats: Vec<f32> = numbers.clone().map(|n| f32::from(n) * -0.375).collect();
    let short: Vec<i16> = (0..24).map(|n| n * 37 - 400).collect();
    let cases = [
        (0, bytes.clone(), Voxels::U8(bytes)),
        (1, ints.iter().flat_map(|n| n.to_be_bytes()).collect(), Voxels::I32(ints.clone())),
        (3, floats.iter().flat_map(|n| n.to_be_bytes()).collect(), Voxels::F32(floats.clone())),
        (4, shorts(24), Voxels::I16(short)),
    ];
    for (kind, data, expected) in cases {
        let file = File::new(kind, data);
        for (name, bytes) in
            [("v.mgh", file.bytes()), ("v.MGZ", file.gzip()), ("v.mgh.gz", file.gzip()), ("v", file.gzip())]
        {
            let volume = open(name, &bytes).unwrap();
            assert!(volume.voxels == expected, "type {kind}, {name}: {:?}", volume.voxels);
            assert_eq!((volume.geometry.dims, volume.notes.len()), ([3, 2, 4], 0), "{name}: {:?}", volume.notes);
        }
    }
}

#[test]
fn voxels_are_placed_around_the_centre_and_turned_to_left_posterior_superior() {
    let volume = open("v.mgh", &File::new(4, shorts(24)).bytes()).unwrap();
    assert!(volume.anatomical && volume.unit == Some(Unit::Millimetre));
    assert_eq!(volume.geometry.spacing, DVec3::new(1.5, 0.5, 2.0));
    // vox2ras: the centre is voxel (width, height, depth) / 2.
    let world = |index: [f64; 3]| {
        let mut place = CENTRE.map(f64::from);
        for (axis, &size) in DELTA.iter().enumerate() {
            let steps = (index[axis] - [3.0, 2.0, 4.0][axis] / 2.0) * f64::from(size);
            (0..3).for_each(|row| place[row] += f64::from(AXES[axis][row]) * steps);
        }
        DVec3::new(-place[0], -place[1], place[2])
    };
    for index in [[0.0; 3], [2.0, 1.0, 3.0], [1.0, 0.0, 2.0]] {
        let found = volume.geometry.world_from_index(DVec3::from_array(index));
        assert!(found.abs_diff_eq(world(index), 1e-12), "{index:?}: {found}, not {}", world(index));
    }
    let unplaced = open("v.mgh", &File { flag: 0, ..File::new(4, shorts(24)) }.bytes()).unwrap();
    assert_eq!(unplaced.geometry.spacing, DVec3::ONE);
    assert_eq!(unplaced.geometry.direction.x_axis, DVec3::X, "from right to left");
    assert!(unplaced.notes[0].contains("goodRASFlag is 0"), "{:?}", unplaced.notes);
}

#[test]
fn frames_are_times() {
    let file = File::new(4, shorts(72)).with(&[(16, 3)]);
    volumes::refused(open("v.mgz", &file.gzip()), &["3 time steps"]);
    let selection = Selection { time: Some(2), ..Selection::default() };
    let last = volumes::opened("v.mgz", &file.gzip(), &selection).unwrap();
    let expected: Vec<i16> = (48..72).map(|n| n * 37 - 400).collect();
    assert!(last.voxels == Voxels::I16(expected));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("v.mgh");
    std::fs::write(&path, File::new(4, shorts(24)).bytes()).unwrap();
    let middle = volume::open(&path, &Selection { middle: true, ..Selection::default() }, &Quiet).unwrap();
    assert_eq!((middle.geometry.dims, middle.value([0, 0, 0])), ([3, 2, 1], Some(12.0 * 37.0 - 400.0)));
}

#[test]
fn headers_that_contradict_themselves_are_refused_with_the_numbers() {
    let file = File::new(4, shorts(24));
    let refuse = |words: &[(usize, u32)], told: &[&str]| {
        volumes::refused(open("v.mgh", &file.with(words).bytes()), &[&["v.mgh"], told].concat());
    };
    refuse(&[(0, 2)], &["version is 2"]);
    refuse(&[(20, 5)], &["type 5 (voxels of 1 bit)", "mri_convert"]);
    refuse(&[(20, 77)], &["type 77 (not a type of the format)"]);
    refuse(&[(8, 0)], &["3×0×4 voxels in 1 frames"]);
    refuse(&[(12, u32::MAX)], &["3×2×-1 voxels"]);
    refuse(&[(12, 7)], &["68 bytes of voxels", "require 84"]);
    refuse(&[(4, 1 << 20), (8, 1 << 20), (12, 1 << 10)], &["bytes of voxels"]);
    refuse(&[(78, f32::NAN.to_bits())], &["delta, Mdc, Pxyz_c", "NaN"]);
    refuse(&[(34, 0)], &["spacing is 1.5 0 2"]);
    volumes::refused(open("v.mgz", &[0, 0, 0, 1]), &["4 bytes", "284"]);
    volumes::refused(open("v.mgz", &file.gzip()[..60]), &["v.mgz"]);
    for length in 0..284 {
        drop(open("v.mgh", &file.bytes()[..length]));
    }
}
