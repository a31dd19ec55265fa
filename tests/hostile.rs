//! Reading any file ends soon, uses little memory and does not panic.
#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test fails by panicking")]
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a row of a table, and the place of a finding")]

#[path = "support/dicom.rs"]
#[allow(dead_code, unreachable_pub, reason = "this program uses a part of it")]
mod dicom;
#[path = "support/hostile.rs"]
mod hostile;

use std::io::Write as _;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

use glam::DVec3;
use hostile::{Counting, Place, Reader, most_held};
use relume::document;
use relume::model::{ColourModel, ErrorSummary, LightMatrix, ModelKind};
use relume::output::FilmFile;
use relume::output::film::{Component, Components, Dial, DialPreset, Frame, Light, Node, Position, Stored};
use relume::progress::{Progress, Quiet};
use relume::scene::Placement;
use relume::spectrum::{self, Spectrum};
use relume::volume::{self, Selection, Volume, VolumeError};
use rustix::time::{ClockId, clock_gettime};

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// One in this many scenes is planned, and one in this many palettes is solved.
const RARELY: u64 = 64;

/// Deterministic random numbers (Steele et al. 2014, "Fast splittable pseudorandom number generators").
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.0;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, limit: usize) -> usize {
        usize::try_from(self.next() % u64::try_from(limit.max(1)).unwrap()).unwrap()
    }

    /// Random range of `bytes`, rarely a long one.
    fn range(&mut self, bytes: &[u8]) -> std::ops::Range<usize> {
        let start = self.below(bytes.len() + 1);
        let longest = if self.below(4) == 0 { bytes.len() } else { 8 };
        start..(start + self.below(longest + 1)).min(bytes.len())
    }
}

/// Numbers that readers may mishandle.
const NUMBERS: [&str; 16] = [
    "0",
    "-1",
    "1",
    "3",
    "65536",
    "4294967295",
    "2147483648",
    "9223372036854775807",
    "18446744073709551616",
    "1e308",
    "-1e-320",
    "nan",
    "inf",
    "0x10",
    "1e999",
    "",
];

/// Damages `bytes` in one place; `other` is another file of the same kind.
fn damage(bytes: &mut Vec<u8>, other: &[u8], random: &mut Random) {
    let range = random.range(bytes);
    match random.below(8) {
        0 => bytes[range].iter_mut().for_each(|byte| *byte ^= 1 << (byte.count_ones() % 8)),
        1 => bytes[range].fill([0x00, 0xff, b' ', b'\n', b'9', 0x80][random.below(6)]),
        2 => bytes.truncate(range.start),
        3 => drop(bytes.drain(range)),
        4 => {
            let again = bytes[range.clone()].to_vec();
            drop(bytes.splice(range.start..range.start, again));
        }
        5 => {
            let from = random.range(other);
            drop(bytes.splice(range, other[from].iter().copied()));
        }
        _ => {
            let digit = |byte: &u8| byte.is_ascii_digit() || matches!(byte, b'-' | b'.');
            let Some(start) = bytes[range.start..].iter().position(digit).map(|at| range.start + at) else { return };
            let length = bytes[start..].iter().take_while(|&byte| digit(byte)).count();
            let number = NUMBERS[random.below(NUMBERS.len())].bytes();
            drop(bytes.splice(start..start + length, number));
        }
    }
}

/// CPU time of this thread, which excludes other programs.
fn cpu_seconds() -> f64 {
    let now = clock_gettime(ClockId::ThreadCPUTime);
    f64::from(u32::try_from(now.tv_sec).unwrap()) + f64::from(u32::try_from(now.tv_nsec).unwrap()) * 1e-9
}

/// Time of this processor in units of the one on which the limits of seconds were set, and at least 1: hosts differ by
/// three.
fn slowness() -> f64 {
    let begun = cpu_seconds();
    let mut hash = 0_u64;
    for step in 0..1_u64 << 26 {
        hash = (hash ^ step).wrapping_mul(0x0000_0100_0000_01b3).rotate_left(29);
    }
    std::hint::black_box(hash);
    ((cpu_seconds() - begun) / 0.5).max(1.0)
}

/// Environment variable with the number of damaged copies per reader; `scripts/damaged` sets it.
const COPIES: &str = "DAMAGED_COPIES";

/// Writes the bytes that were read last to `target/hostile` when the test fails.
struct Kept<'a> {
    reader: Reader,
    round: usize,
    bytes: &'a [u8],
}

impl Drop for Kept<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).with_file_name("hostile");
            let path = folder.join(format!("{:?}-{}", self.reader, self.round));
            let written = std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&path, self.bytes));
            eprintln!("{}: {written:?}", path.display());
        }
    }
}

/// Feeds `reader` all `seeds` unchanged, and `rounds` damaged ones, or as many as [`COPIES`] says; then prints a row of
/// `benches/results/damaged.md`.
fn withstands(reader: Reader, seeds: &[Vec<u8>], rounds: usize) {
    let asked = std::env::var(COPIES).ok().map(|copies| copies.parse().expect("DAMAGED_COPIES is a whole number"));
    let rounds = asked.unwrap_or(rounds);
    let place = Place::new(reader, RARELY);
    for (index, seed) in seeds.iter().enumerate() {
        assert!(place.read(seed), "seed {index} of {reader:?} should be sound");
    }
    let mut random = Random(1);
    let (mut accepted, mut seconds, mut longest) = (0, 0.0, 0.0_f64);
    for round in 0..rounds {
        let mut bytes = seeds[random.below(seeds.len())].clone();
        let other = &seeds[random.below(seeds.len())];
        for _ in 0..=random.below(4) {
            damage(&mut bytes, other, &mut random);
        }
        let kept = Kept { reader, round, bytes: &bytes };
        let begun = cpu_seconds();
        accepted += usize::from(place.read(&bytes));
        let (took, allowed) = (cpu_seconds() - begun, f64::from(u32::try_from(bytes.len() / 1024 + 1).unwrap()));
        assert!(took <= allowed, "round {round} of {reader:?}: {took} s for {} bytes", bytes.len());
        drop(kept);
        (seconds, longest) = (seconds + took, longest.max(took));
    }
    let each = 1e6 * seconds / f64::from(u32::try_from(rounds.max(1)).unwrap());
    println!(
        "| {reader:?} | {} | {rounds} | {accepted} | {seconds:.0} | {each:.0} | {:.0} | {:.1} |",
        seeds.len(),
        1e3 * longest,
        f64::from(u32::try_from(place.most()).unwrap()) / 1e6
    );
}

/// Files of a folder of `tests/data`.
fn seeds(folder: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(folder);
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

#[test]
fn a_metaimage_of_anything_is_read_or_refused() {
    withstands(Reader::MetaImage, &seeds("hostile/metaimage"), 8000);
}

#[test]
fn an_nrrd_of_anything_is_read_or_refused() {
    withstands(Reader::Nrrd, &seeds("hostile/nrrd"), 8000);
}

#[test]
fn vtk_xml_of_anything_is_read_or_refused() {
    let place = Place::new(Reader::Vti, RARELY);
    // Some contain several arrays and need a choice.
    let sound: Vec<_> = seeds("vti").into_iter().filter(|seed| place.read(seed)).collect();
    withstands(Reader::Vti, &sound, 8000);
}

#[test]
fn a_nifti_file_of_anything_is_read_or_refused() {
    withstands(Reader::Nifti, &seeds("hostile/nifti"), 8000);
}

#[test]
fn an_mgh_file_of_anything_is_read_or_refused() {
    withstands(Reader::Mgh, &seeds("hostile/mgh"), 4000);
}

#[test]
fn an_mrc_file_of_anything_is_read_or_refused() {
    withstands(Reader::Mrc, &seeds("hostile/mrc"), 8000);
}

#[test]
fn a_numpy_array_of_anything_is_read_or_refused() {
    withstands(Reader::Numpy, &seeds("hostile/numpy"), 8000);
}

#[test]
fn a_numpy_archive_of_anything_is_read_or_refused() {
    withstands(Reader::Archive, &seeds("hostile/archive"), 8000);
}

#[test]
fn a_legacy_vtk_file_of_anything_is_read_or_refused() {
    withstands(Reader::Vtk, &seeds("hostile/vtk"), 8000);
}

#[test]
fn a_dicom_file_of_anything_is_read_or_refused() {
    withstands(Reader::Dicom, &seeds("hostile/dicom"), 8000);
}

#[test]
fn a_tiff_file_of_anything_is_read_or_refused() {
    let place = Place::new(Reader::Tiff, RARELY);
    // Some need other files, or a choice of series.
    let sound: Vec<_> = seeds("tiff").into_iter().filter(|seed| place.read(seed)).collect();
    withstands(Reader::Tiff, &sound, 8000);
}

#[test]
fn a_zarr_store_of_anything_is_read_or_refused() {
    let place = Place::new(Reader::Zarr, RARELY);
    // Some need a choice of series, or have more files than a test has time for.
    let is_short = |seed: &Vec<u8>| seed.len() < 6000;
    let sound: Vec<_> = seeds("zarr").into_iter().filter(is_short).filter(|seed| place.read(seed)).collect();
    assert!(sound.len() > 30, "{} stores", sound.len());
    withstands(Reader::Zarr, &sound, 4000);
}

#[test]
fn an_hdf5_file_of_anything_is_read_or_refused() {
    let is_netcdf = |seed: &Vec<u8>| seed.starts_with(b"CDF");
    let place = Place::new(Reader::Hdf5, RARELY);
    // Some need a choice of axes.
    let all = seeds("hdf5").into_iter().filter(|seed| !is_netcdf(seed) && place.read(seed));
    let sound: Vec<_> = all.collect();
    assert!(sound.len() >= 5, "{} files", sound.len());
    withstands(Reader::Hdf5, &sound, 4000);
}

#[test]
fn a_netcdf_file_of_anything_is_read_or_refused() {
    let netcdf: Vec<_> = seeds("hdf5").into_iter().filter(|seed| seed.starts_with(b"CDF")).collect();
    withstands(Reader::NetCdf, &netcdf, 8000);
}

#[test]
fn a_slice_of_anything_is_read_or_refused() {
    withstands(Reader::Slices, &seeds("hostile/slices"), 8000);
}

#[test]
fn long_tiff_files_of_many_small_things_take_little_memory_and_time() {
    // One page of one voxel, its tags in ascending order, with a long description.
    let described = |text: &[u8]| {
        let at = u32::try_from(8 + text.len()).unwrap();
        let tags = [(256_u16, 1), (257, 1), (258, 8), (270, 8), (273, 4), (279, 1)];
        let mut bytes = [&b"II*\0"[..], &at.to_le_bytes(), text, &6_u16.to_le_bytes()].concat();
        for (tag, value) in tags {
            let (kind, count) = if tag == 270 { (2_u16, text.len()) } else { (4, 1) };
            bytes.extend(
                [&tag.to_le_bytes()[..], &kind.to_le_bytes(), &u32::try_from(count).unwrap().to_le_bytes()].concat(),
            );
            bytes.extend(u32::to_le_bytes(value));
        }
        bytes.extend([0; 4]);
        bytes
    };
    let pixels = "<OME><Image><Pixels SizeX=\"1\" SizeY=\"1\" SizeC=\"1\" SizeT=\"1\" SizeZ=";
    let ome = |rest: String| described(format!("{pixels}{rest}").as_bytes());
    // Directories of one tag each.
    let mut directories = b"II*\0\x08\0\0\0".to_vec();
    for index in 1..200_000_u32 {
        directories.extend([&1_u16.to_le_bytes()[..], &254_u16.to_le_bytes(), &4_u16.to_le_bytes()].concat());
        directories.extend([1, 1, 8 + 18 * index].map(u32::to_le_bytes).concat());
    }
    for (what, bytes) in [
        ("planes", ome(format!("\"900000\">{}", "<TiffData IFD=\"0\"/>".repeat(900_000)))),
        ("long runs", ome(format!("\"900000\">{}", "<TiffData IFD=\"0\" PlaneCount=\"900000\"/>".repeat(300_000)))),
        ("files", ome(format!("\"900000\">{}", "<TiffData><UUID FileName=\"v.tif\"/></TiffData>".repeat(300_000)))),
        ("depth", ome(format!("\"1\">{}", "<a>".repeat(4_000_000)))),
        ("keys", described(format!("ImageJ=1\n{}", "a=b\n".repeat(4_000_000)).as_bytes())),
        ("directories", directories),
    ] {
        let place = Place::new(Reader::Tiff, RARELY);
        let begun = cpu_seconds();
        place.read(&bytes);
        let took = cpu_seconds() - begun;
        assert!(took <= 2.0, "{what}: {took} s");
    }
}

#[test]
fn a_long_axis_of_small_chunks_takes_little_time() {
    let single = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hdf5/single.h5");
    let mut bytes = std::fs::read(single).unwrap();
    // 65807 slices in place of 7: 148,000 chunks, of which few are in the file.
    bytes[832..835].copy_from_slice(&[0x0f, 1, 1]);
    let place = Place::new(Reader::Hdf5, RARELY);
    let begun = cpu_seconds();
    place.read(&bytes);
    let took = cpu_seconds() - begun;
    assert!(took <= 2.0, "{took} s");
}

#[test]
fn a_file_of_bricks_of_anything_is_read_or_refused() {
    withstands(Reader::Bricks, &seeds("hostile/bricks"), 8000);
}

/// 64 MiB in chunks of 50 slices of 3 MiB.
#[test]
fn bricks_of_a_store_take_no_more_memory_than_they_are_given() {
    let store = tempfile::tempdir().expect("a folder");
    let array = r#"{"zarr_format": 2, "shape": [1024, 256, 256], "chunks": [50, 256, 256], "dtype": "|u1",
        "compressor": null, "fill_value": 0, "order": "C", "filters": null}"#;
    std::fs::write(store.path().join(".zarray"), array).expect("a file");
    for chunk in 0..21_u8 {
        let voxels: Vec<u8> = (0..50 * 65_536_u32).map(|at| (at / 77).to_le_bytes()[0] ^ chunk).collect();
        std::fs::write(store.path().join(format!("{chunk}.0.0")), voxels).expect("a file");
    }
    let out = tempfile::tempdir().expect("a folder");
    let path = out.path().join("v.bricks");
    let make = || relume::output::write_bricks(&path, (store.path(), None), &Selection::default(), 10 << 20, &Quiet);
    let (made, most) = most_held(make);
    assert!(made.is_ok_and(|made| made.levels.len() == 5 && !made.spilled));
    // Beside the memory that is given: the 16 bricks of a slab as their bytes and halves, and a chunk as it is read.
    let beside = 8 << 20;
    assert!(most <= (10 << 20) + beside, "{most}");
}

#[test]
fn a_sidecar_of_anything_is_read_or_refused() {
    withstands(Reader::Sidecar, &seeds("hostile/sidecar"), 8000);
}

#[test]
fn a_scene_of_anything_is_read_or_refused() {
    withstands(Reader::Scene, &seeds("hostile/scene"), 4000);
}

#[test]
fn a_palette_of_anything_is_read_or_refused() {
    withstands(Reader::Palette, &seeds("hostile/palette"), 4000);
}

#[test]
fn a_spectrum_of_anything_is_read_or_refused() {
    withstands(Reader::Spectrum, &seeds("hostile/spectrum"), 8000);
}

#[test]
fn accumulators_of_anything_are_read_or_refused() {
    withstands(Reader::Accumulators, &seeds("hostile/accumulators"), 4000);
}

#[test]
#[ignore = "writes the files of accumulators in tests/data/hostile"]
fn accumulators_to_damage() {
    let ramp: [f64; 81] = std::array::from_fn(|band| f64::from(u8::try_from(band).unwrap()) / 81.0);
    let bone = Component { name: "bone".to_owned(), spectrum: ramp };
    let point = FilmFile {
        positions: vec![Position {
            name: "key".to_owned(),
            placement: Placement::Point(DVec3::from_array([1.0, 2.0, 3.0])),
            shadows: false,
        }],
        lights: vec![Light { name: "day".to_owned(), position: 0, weight: 2.0, shown: None, spectrum: ramp }],
        adapt: true,
        accumulators: vec![0.5; 12],
        transmittance: vec![0.25; 12],
        ..FilmFile::empty([4, 3], Components::Surfaces(vec![bone]))
    };
    let node = |light: &str, on| Node { light: light.to_owned(), place: [0.0, f64::from(u8::from(on))], on };
    let preset = |name: &str, hand| DialPreset {
        name: name.to_owned(),
        caption: "at dusk".to_owned(),
        hand,
        off: vec!["day".to_owned()],
        on: vec!["lamp".to_owned()],
    };
    let lamp = |name: &str| Light { name: name.to_owned(), position: 0, weight: 1.0, shown: None, spectrum: [1.0; 81] };
    let dial = FilmFile {
        lights: vec![lamp("day"), lamp("lamp")],
        dial: Some(Dial {
            hand: None,
            normalise: true,
            master: 1.5,
            nodes: vec![node("day", true), node("lamp", false)],
            presets: vec![preset("evening", [0.5, -2.0]), preset("night", [0.0, 0.0])],
        }),
        frame: Some(Frame {
            pixel: Some(0.5),
            parallel: false,
            unit: Some("mm".to_owned()),
            edges: Some(["R", "L", "S", "I"].map(str::to_owned)),
        }),
        ..point.clone()
    };
    // Spectra with few digits, because the text is not compressed.
    let ones = |range: std::ops::Range<usize>| {
        Spectrum::from_samples(std::array::from_fn(|band| f64::from(u8::from(range.contains(&band)))))
    };
    let cloud = vec![ones(0..81), ones(30..81), ones(10..50)];
    let error = ErrorSummary { mean: 0.5, p95: 1.0, max: 2.0 };
    let lights = |dimension: usize| {
        let matrix = LightMatrix { xyz: vec![[0.25, 0.5, 0.125]; dimension], error, unseen: Some(error) };
        vec![("lamp".to_owned(), spectrum::Light::new(ones(0..81)).unwrap(), matrix)]
    };
    let model = |kind, projection: Vec<Spectrum>, coloured| {
        let dimension = projection.len();
        let model = ColourModel::from_parts(kind, projection, cloud.clone(), None, lights(dimension)).unwrap();
        FilmFile {
            components: Components::Model(Stored { model, coloured, tolerance: 1.0 }),
            lights: vec![lamp("lamp")],
            background: coloured.then_some([0.5; 81]),
            accumulators: vec![0.5; 12 * dimension],
            transmittance: vec![0.25; if coloured { 12 * dimension } else { 12 }],
            ..point.clone()
        }
    };
    let nodes = model(ModelKind::Nodes, vec![ones(20..21), ones(44..45)], true);
    let bands = model(ModelKind::Bands, vec![ones(0..81)], false);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hostile/accumulators");
    std::fs::create_dir_all(&folder).unwrap();
    for (name, file) in [("point", point), ("dial", dial), ("nodes", nodes), ("bands", bands)] {
        file.write(&folder.join(name)).unwrap();
    }
}

/// Bytes that reading may take beyond the voxels and a frame or chunk.
const BESIDE: usize = 64 << 20;

#[test]
fn reading_takes_the_volume_and_little_more() {
    use dicom::{DEFLATED, EXPLICIT, Value, file, place, slice};

    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    // 80 frames of 1 MB, the last one first: a copy of them would be more than the bar.
    let side = 1024_u16;
    let frames = slice(0.0, 0)
        .without(0x0020_0032)
        .text(0x0028_0008, "IS", "80")
        .short(0x0028_0010, &[side])
        .short(0x0028_0011, &[side / 2])
        .items(0x5200_9230, (0..80).rev().map(|z| place(f64::from(z))).collect())
        .with(0x7fe0_0010, "OW", Value::Bytes((0..80_u8).flat_map(|z| vec![z; 1 << 20]).collect()));
    write("deflated.dcm", &file(&frames, DEFLATED));
    write("plain.dcm", &file(&frames, EXPLICIT));
    // 80 MB of 16 bits in Fortran order, and 40 MB of halves, which are 80 MB of floats.
    let npy = |descr: &str, order: &str, numbers: usize| {
        let text = format!(
            "{{'descr': '{descr}', 'fortran_order': {order}, 'shape': (40, {}, 1024), }}\n",
            numbers / 40 / 1024
        );
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend(u16::try_from(text.len()).unwrap().to_le_bytes());
        bytes.extend(text.bytes());
        bytes.extend((0..numbers).flat_map(|index| [u8::try_from(index / 1024 % 64).unwrap(), 0x3c]));
        bytes
    };
    write("fortran.npy", &npy("<u2", "True", 40 << 20));
    write("half.npy", &npy("<f2", "False", 20 << 20));
    write("both.npy", &npy("<f2", "True", 20 << 20));
    for name in ["plain.dcm", "deflated.dcm", "fortran.npy", "half.npy", "both.npy"] {
        let path = folder.path().join(name);
        let (volume, most) = most_held(|| volume::open(&path, &Selection::default(), &Quiet).unwrap());
        let voxels = volume.voxels.bytes().len();
        eprintln!("{name}: {voxels} bytes of voxels, {most} bytes at most");
        assert!(voxels >= 80 << 20, "{name}: a volume that the bar notices: {voxels}");
        assert!(most <= voxels + BESIDE, "{name}: {most} bytes for {voxels}");
    }
}

#[test]
fn memory_is_counted_where_it_is_taken() {
    let (kept, most) = most_held(|| {
        drop(vec![1_u8; 3 << 20]);
        let mut grown = vec![1_u8; 1 << 20];
        grown.resize(5 << 20, 1);
        grown.truncate(1);
        grown.shrink_to_fit();
        grown
    });
    assert_eq!((kept.len(), most), (1, 5 << 20));
}

#[test]
fn long_files_of_many_small_things_take_little_memory_and_time() {
    let long = |start: &str, again: &str, length: usize| [start, &again.repeat(length / again.len())].concat();
    let meta = "NDims = 1\nDimSize = 4\nElementType = MET_UCHAR\n";
    let nrrd = "NRRD0004\ntype: uchar\ndimension: 2\nsizes: 1 900000\nencoding: raw\n";
    let vti =
        "<VTKFile type=\"ImageData\"><ImageData WholeExtent=\"0 1 0 1 0 1\"><Piece Extent=\"0 1 0 1 0 1\"><PointData>";
    let vtk = "# vtk DataFile Version 3.0\n\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n";
    let values = "version = 1\n[transfer]\nopacity = [";
    let (mega, mut failed) = (1 << 20, Vec::new());
    let allowed = 2.0 * slowness();
    eprintln!("{allowed:.2} s are allowed");
    for (reader, text) in [
        (Reader::MetaImage, long(meta, "a=b\n", 4 * mega)),
        (Reader::MetaImage, long(meta, "=\n", 4 * mega)),
        (Reader::MetaImage, long(&format!("{meta}ElementDataFile = LIST 0\n"), "a\n", 40 * mega)),
        (Reader::Nrrd, long(nrrd, "a:b\n", 4 * mega)),
        (Reader::Nrrd, long(nrrd, "a:=b\n", 4 * mega)),
        (Reader::Nrrd, long(nrrd, "#\n", 4 * mega)),
        (Reader::Nrrd, long(&format!("{nrrd}data file: LIST 1\n"), "a\n", 40 * mega)),
        (Reader::Nrrd, long(nrrd, " ", 4 * mega)),
        (Reader::Nrrd, long(&format!("{nrrd}space directions: "), "none ", 4 * mega)),
        (Reader::Vti, long(vti, "<DataArray/>", 17 * mega)),
        (Reader::Vti, long(vti, "<DataArray type=\"Int8\" Name=\"a\" format=\"ascii\">1</DataArray>", 17 * mega)),
        (Reader::Vti, long(vti, "<a>", 17 * mega)),
        (Reader::Vtk, long(&format!("{vtk}FIELD f 4000\n"), "a 1 0 int\n", 40 * mega)),
        (Reader::Vtk, long(&format!("{vtk}POINT_DATA 8\n"), "VECTORS a word\n", 4 * mega)),
        (Reader::Vtk, long(vtk, "\n", 40 * mega)),
        (Reader::Vtk, long(vtk, "METADATA\n\n", 40 * mega)),
        (Reader::Vtk, long(vtk, "a", 40 * mega)),
        (Reader::Sidecar, long("a = [", "0,", mega)),
        (Reader::Sidecar, long("a = ", "[", mega)),
        (Reader::Scene, long(values, "[0,0],", 3 * mega / 8 - 64)),
        (Reader::Scene, long(values, "0,", 3 * mega / 8 - 64)),
        (Reader::Scene, (0..50_000).map(|n| format!("a{n}={{}}\n")).collect()),
        (Reader::Scene, long("a = ", "{a=", mega / 2)),
        (Reader::Spectrum, long("", "1 1\n", 9 * mega)),
        (Reader::Spectrum, (1..900_000).map(|n| format!("{n} 1\n")).collect()),
        (Reader::Spectrum, long("", ",", 9 * mega)),
    ] {
        let place = Place::new(reader, RARELY);
        let begun = cpu_seconds();
        let read = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| place.read(text.as_bytes())));
        let took = cpu_seconds() - begun;
        let start: String = text.chars().rev().take(40).collect::<Vec<_>>().into_iter().rev().collect();
        eprintln!("{reader:?} …{start:?}: {took:.2} s");
        if read.is_err() || took > allowed {
            failed.push(format!("{reader:?} …{start:?}: {took} s, {:?}", read.map_err(|why| why.downcast::<String>())));
        }
    }
    assert!(failed.is_empty(), "{failed:#?}");
}

// Special files, and files that change while being read.

/// Truncates a file to `length` when the first progress is reported.
struct Cutter<'a> {
    path: &'a Path,
    length: u64,
    done: AtomicBool,
}

impl Progress for Cutter<'_> {
    fn report(&self, _stage: &str, _done: u64, _total: u64) {
        if !self.done.swap(true, Ordering::Relaxed) {
            std::fs::OpenOptions::new().write(true).open(self.path).unwrap().set_len(self.length).unwrap();
        }
    }
}

/// Reads `header` while the file `cut` is truncated to `length` bytes.
fn open_cut(header: &Path, cut: &Path, length: u64) -> Result<Volume, VolumeError> {
    let cutter = Cutter { path: cut, length, done: AtomicBool::new(false) };
    let opened = volume::open(header, &Selection::default(), &cutter);
    assert!(cutter.done.into_inner(), "it was cut");
    opened
}

/// A TIFF file of pages of `side` × `side` bytes.
fn pages(voxels: &[u8], side: usize) -> Vec<u8> {
    let small = |number: usize| u32::try_from(number).unwrap().to_le_bytes();
    let mut bytes = [&b"II*\0"[..], &small(8 + voxels.len()), voxels].concat();
    let count = voxels.len() / (side * side);
    for page in 0..count {
        bytes.extend(5_u16.to_le_bytes());
        for (tag, value) in [(256_u16, side), (257, side), (258, 8), (273, 8 + page * side * side), (279, side * side)]
        {
            bytes.extend([&tag.to_le_bytes()[..], &4_u16.to_le_bytes(), &small(1), &small(value)].concat());
        }
        let next = if page + 1 < count { bytes.len() + 4 } else { 0 };
        bytes.extend(small(next));
    }
    bytes
}

#[test]
fn files_that_shrink_or_grow_while_they_are_read_are_noticed_or_harmless() {
    const SIDE: usize = 240;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut random = Random(2);
    let voxels: Vec<u8> = (0..SIDE * SIDE * SIDE).map(|_| random.next().to_le_bytes()[0]).collect();
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::none());
    gzip.write_all(&voxels).unwrap();
    let gzip = gzip.finish().unwrap();
    let nrrd = |encoding: &str| {
        format!("NRRD0004\ntype: uchar\ndimension: 3\nsizes: 240 240 240\nencoding: {encoding}\ndata file: data\n")
    };
    let vti = "<VTKFile type=\"ImageData\" byte_order=\"LittleEndian\" header_type=\"UInt32\"><ImageData WholeExtent=\"0 239 \
               0 239 0 239\"><Piece Extent=\"0 239 0 239 0 239\"><PointData><DataArray type=\"UInt8\" Name=\"v\" \
               format=\"appended\" offset=\"0\"/></PointData></Piece></ImageData><AppendedData encoding=\"raw\">_";
    let length = u32::try_from(voxels.len()).unwrap().to_le_bytes();
    let whole = [vti.as_bytes(), &length, &voxels, b"</AppendedData></VTKFile>"].concat();
    for (name, header, data) in [
        ("v.nhdr", nrrd("raw").into_bytes(), &voxels),
        ("v.nhdr", nrrd("gzip").into_bytes(), &gzip),
        (
            "v.mhd",
            b"NDims = 3\nDimSize = 240 240 240\nElementType = MET_UCHAR\nElementDataFile = data\n".to_vec(),
            &voxels,
        ),
        ("data.toml", b"dims = [240, 240, 240]\ntype = 'uint8'\n".to_vec(), &voxels),
        ("v.vti", Vec::new(), &whole),
        ("v.tif", Vec::new(), &pages(&voxels, SIDE)),
    ] {
        let (header_path, data_path) = (path(name), if header.is_empty() { path(name) } else { path("data") });
        let write = || {
            std::fs::write(&header_path, &header).unwrap();
            std::fs::write(&data_path, data).unwrap();
        };
        write();
        let error = open_cut(&header_path, &data_path, 6 << 20).map(|volume| volume.voxels.len()).unwrap_err();
        let message = error.to_string();
        assert!(message.contains(name) || message.contains("data"), "{name}: {message}");
        write();
        let grown = u64::try_from(data.len()).unwrap() + 1000;
        match open_cut(&header_path, &data_path, grown) {
            Ok(grown) => assert!(grown.voxels.bytes() == voxels, "{name}: other voxels"),
            // A further gzip stream may follow, but the appended bytes are none.
            Err(error) => assert!(matches!(error, VolumeError::Inflate { decoded: 13_824_000, .. }), "{error}"),
        }
    }
}

#[cfg(unix)]
#[test]
fn what_never_ends_or_never_begins_is_no_file_for_any_reader() {
    use relume::document::SceneOptions;
    use relume::spectrum::SpectrumSource;
    let folder = tempfile::tempdir().unwrap();
    let pipe = folder.path().join("pipe.toml");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success(), "mkfifo");
    for (path, what) in [(pipe.as_path(), "a pipe"), (Path::new("/dev/zero"), "a device"), (folder.path(), "a folder")]
    {
        let said = |error: &dyn std::error::Error| {
            error.source().map_or_else(|| error.to_string(), |cause| format!("{error}: {cause}"))
        };
        let light = SpectrumSource::File { path: path.to_owned(), column: None }.light(Path::new("")).unwrap_err();
        let file = FilmFile::read(path).unwrap_err();
        let scene = document::load(path, &SceneOptions::default(), &Quiet).map(drop).unwrap_err();
        let volume = volume::open(path, &Selection::default(), &Quiet).map(drop).unwrap_err();
        for error in [&light as &dyn std::error::Error, &file, &volume] {
            assert!(said(error).contains(what), "{}", said(error));
        }
        // A folder may be a volume, but no scene.
        let what = if path.is_dir() { "is a volume" } else { what };
        assert!(said(&scene).contains(what), "{}", said(&scene));
    }
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_names_and_headers_need_not_be_utf8() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt as _;
    use std::os::unix::fs::symlink;
    let (folder, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let name = |bytes: &[u8]| folder.path().join(OsStr::from_bytes(bytes));
    let open = |path: &Path| volume::open(path, &Selection::default(), &Quiet);
    let voxels: Vec<u8> = (0..24).collect();
    std::fs::write(elsewhere.path().join("data"), &voxels).unwrap();
    symlink(elsewhere.path().join("data"), name(b"link")).unwrap();
    symlink(elsewhere.path(), name(b"sub")).unwrap();
    // Latin-1 in names and in uninterpreted values.
    let nrrd = |file: &[u8]| {
        let head =
            b"NRRD0004\n# Kn\xf6chel\ncontent: caf\xe9\ntype: uchar\ndimension: 3\nsizes: 4 3 2\nencoding: raw\n";
        [head, &b"data file: "[..], file, b"\n"].concat()
    };
    std::fs::write(name(b"Kn\xf6chel.nhdr"), nrrd(b"link")).unwrap();
    assert_eq!(open(&name(b"Kn\xf6chel.nhdr")).unwrap().voxels.bytes(), voxels, "a link that leads elsewhere");
    std::fs::write(name(b"below.nhdr"), nrrd(b"sub/data")).unwrap();
    assert_eq!(open(&name(b"below.nhdr")).unwrap().voxels.bytes(), voxels, "a link to a folder");
    std::fs::write(name(b"above.nhdr"), nrrd(b"sub/../link")).unwrap();
    assert!(matches!(open(&name(b"above.nhdr")), Err(VolumeError::Outside { .. })), "out of the folder");

    let meta = b"NDims = 3\nComment = caf\xe9\nDimSize = 4 3 2\nElementType = MET_UCHAR\nElementDataFile = link\n";
    std::fs::write(name(b"\xff.mhd"), meta).unwrap();
    assert_eq!(open(&name(b"\xff.mhd")).unwrap().voxels.bytes(), voxels);

    std::fs::write(name(b"\xff.raw"), &voxels).unwrap();
    std::fs::write(name(b"\xff.raw.toml"), "dims = [4, 3, 2]\ntype = 'uint8'").unwrap();
    for path in [name(b"\xff.raw"), name(b"\xff.raw.toml")] {
        assert_eq!(open(&path).unwrap().voxels.bytes(), voxels, "{path:?}");
    }
    std::fs::write(name(b"\xff.raw.toml"), b"dims = [4, 3, 2] # caf\xe9\ntype = 'uint8'").unwrap();
    let error = open(&name(b"\xff.raw")).map(drop).unwrap_err();
    let cause = std::error::Error::source(&error).expect("a cause").to_string();
    assert!(error.to_string().contains(".raw.toml") && cause.contains("UTF-8"), "{error}: {cause}");
}
