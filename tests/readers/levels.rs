//! Levels of resolution in a file of bricks: their voxels, places, statistics and refusals.

use std::path::{Path, PathBuf};

use relume::output::write_bricks;
use relume::progress::Quiet;
use relume::volume::{
    self, Geometry, HostMemory, RawLayout, Selection, Several, Volume, VolumeError, VoxelType, Voxels,
};

struct Made {
    _folder: tempfile::TempDir,
    path: PathBuf,
}

impl Made {
    /// Bricks of `voxels`; the spacing is a binary fraction.
    fn of(voxels: &Voxels, dims: [usize; 3]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [raw, path] = ["v.raw", "v.bricks"].map(|name| folder.path().join(name));
        std::fs::write(&raw, voxels.bytes()).unwrap();
        let layout = RawLayout {
            spacing: [0.5, 0.75, 2.0],
            origin: [-3.0, 8.0, 0.25],
            byte_order: if cfg!(target_endian = "big") { volume::ByteOrder::Big } else { volume::ByteOrder::Little },
            ..RawLayout::new(dims, voxels.voxel_type())
        };
        write_bricks(&path, (&raw, Some(&layout)), &Selection::default(), u64::MAX, &Quiet).unwrap();
        Self { _folder: folder, path }
    }

    fn level(&self, level: usize, memory: HostMemory) -> Volume {
        open(&self.path, level, memory).unwrap()
    }
}

fn open(path: &Path, level: usize, memory: HostMemory) -> Result<Volume, VolumeError> {
    volume::open(path, &Selection { level: Some(level), memory, ..Selection::default() }, &Quiet)
}

fn index(geometry: &Geometry, number: usize) -> [usize; 3] {
    let [nx, ny, _] = geometry.dims;
    [number % nx, number / nx % ny, number / (nx * ny)]
}

/// A linear function of the world is its own mean over a block whose voxel lies at the centre.
#[test]
fn a_level_of_a_ramp_is_the_ramp_at_the_places_of_its_voxels() {
    let dims = [256, 32, 4];
    let finest = Geometry::unit("", dims).unwrap();
    let ramp = |place: glam::DVec3| 2.0 * place.x + 4.0 * place.y + place.z;
    let spacing = glam::DVec3::new(0.5, 0.75, 2.0);
    let origin = glam::DVec3::new(-3.0, 8.0, 0.25);
    let all = 0..finest.voxels();
    let at = |number| glam::DVec3::from_array(index(&finest, number).map(|at| f64::from(u16::try_from(at).unwrap())));
    let made = Made::of(&Voxels::F64(all.map(|number| ramp(origin + spacing * at(number))).collect()), dims);
    let levels = volume::brick_levels(&made.path).unwrap();
    assert_eq!(levels.iter().map(|level| level.geometry.dims).collect::<Vec<_>>(), [dims, [128, 16, 2], [64, 8, 1]]);
    for (number, stated) in levels.iter().enumerate() {
        let volume = made.level(number, HostMemory::Whole);
        assert_eq!((volume.geometry, volume.selection.level), (stated.geometry, Some(number)));
        assert_eq!(stated.bytes, 8 * u64::try_from(volume.geometry.voxels()).unwrap());
        assert_eq!(volume.geometry.extent(), finest.extent() * spacing, "the box stays");
        for at in 0..volume.geometry.voxels() {
            let at = index(&volume.geometry, at);
            let place = at.map(|at| f64::from(u16::try_from(at).unwrap()));
            let expected = ramp(volume.geometry.world_from_index(place.into()));
            // All are binary fractions of few digits.
            assert!(volume.value(at) == Some(expected), "level {number} at {at:?}: {:?}, {expected}", volume.value(at));
        }
    }
}

/// Where all lengths are powers of two, every voxel has the same part in the means of all levels.
#[test]
fn all_levels_have_the_mean_of_the_finest_and_know_the_ranges_of_their_macrocells() {
    let dims = [128, 64, 64];
    let number = |at: usize| f32::from(u16::try_from(at * 40_503 % 65_536).unwrap());
    let made = Made::of(&Voxels::F32((0..dims.iter().product()).map(number).collect()), dims);
    let means = [0, 1].map(|level| made.level(level, HostMemory::InFile).statistics().unwrap().mean);
    // Means of eight whole numbers are exact.
    assert!((means[0] - means[1]).abs() <= 2e-12 * means[0], "{means:?}");

    let odd = [70, 66, 129];
    let made = Made::of(&Voxels::F32((0..odd.iter().product()).map(number).collect()), odd);
    let middle = Selection { middle: true, level: Some(1), ..Selection::default() };
    let [whole, slice] = [made.level(1, HostMemory::Whole), volume::open(&made.path, &middle, &Quiet).unwrap()];
    assert_eq!(slice.geometry.origin, whole.geometry.world_from_index(glam::DVec3::new(0.0, 0.0, 32.0)));
    assert!(slice.voxels.bytes() == &whole.voxels.bytes()[4 * 35 * 33 * 32..][..4 * 35 * 33]);
    for level in 0..3 {
        let [whole, in_file] = [HostMemory::Whole, HostMemory::InFile].map(|memory| made.level(level, memory));
        let [known, expected] = [&in_file, &whole].map(|volume| volume.statistics().unwrap());
        assert!((known.mean - expected.mean).abs() <= 2e-12 * expected.max, "level {level}: {known:?}");
        assert_eq!(volume::Statistics { mean: expected.mean, ..known }, expected, "level {level}");
        let cache = in_file.bricks.as_ref().unwrap();
        assert_eq!((cache.level(), cache.levels().len()), (level, 3));
        let dims = whole.geometry.dims;
        assert!(cache.part([0; 3], dims).unwrap().voxels == whole.voxels, "level {level}");
        let cells = volume::macrocells(dims);
        let mut cell = 0;
        let check = |[low, high]: [f64; 2], nan: bool| {
            let at = [cell % cells[0], cell / cells[0] % cells[1], cell / (cells[0] * cells[1])];
            cell += 1;
            let span = |axis: usize| (8 * at[axis]).saturating_sub(1)..(8 * at[axis] + 10).min(dims[axis]);
            let values = span(2).flat_map(|z| span(1).flat_map(move |y| span(0).map(move |x| [x, y, z])));
            let values = values.map(|at| whole.value(at).unwrap());
            let range = values.fold([f64::MAX, f64::MIN], |[low, high], value| [low.min(value), high.max(value)]);
            assert!(
                [low, high].map(f64::to_bits) == range.map(f64::to_bits) && !nan,
                "level {level}, macrocell {at:?}: {low} to {high}, {range:?}"
            );
        };
        cache.each_cell(check).unwrap();
        assert_eq!(cell, cells.iter().product::<usize>());
    }
}

/// Level 1 of voxels in a row, and of the same in a column and a pile.
fn halved(voxels: &Voxels) -> Voxels {
    let length = voxels.len();
    let of = |dims: [usize; 3]| made_voxels(&Made::of(voxels, dims));
    let row = of([length, 1, 1]);
    assert!(same(&of([1, length, 1]), &row) && same(&of([1, 1, length]), &row), "{row:?}");
    row
}

fn made_voxels(made: &Made) -> Voxels {
    made.level(1, HostMemory::Whole).voxels
}

/// Whether the bits agree: NaN is not equal to itself.
fn same(one: &Voxels, other: &Voxels) -> bool {
    one.bytes() == other.bytes()
}

#[test]
fn halves_round_as_means_do_leave_nan_out_and_end_with_what_is_there() {
    macro_rules! whole {
        ($($variant:ident $type:ident),*) => {$(
            let mut voxels: Vec<$type> = vec![1; 67];
            voxels[..6].copy_from_slice(&[$type::MAX, $type::MAX, $type::MIN, $type::MIN, $type::MAX, $type::MAX - 1]);
            voxels[6..10].copy_from_slice(&[$type::MIN, $type::MIN + 1, 2, 3]);
            voxels[66] = 9;
            let mut expected: Vec<$type> = vec![1; 34];
            // A half is rounded up.
            expected[..5].copy_from_slice(&[$type::MAX, $type::MIN, $type::MAX, $type::MIN + 1, 3]);
            expected[33] = 9;
            assert!(halved(&Voxels::$variant(voxels)) == Voxels::$variant(expected), stringify!($type));
        )*};
    }
    whole!(U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64);
    macro_rules! float {
        ($($variant:ident $type:ident),*) => {$(
            let mut voxels: Vec<$type> = vec![1.0; 67];
            voxels[..4].copy_from_slice(&[$type::MAX, $type::MAX, -$type::MAX, $type::MAX]);
            voxels[4..10].copy_from_slice(&[$type::NAN, $type::NAN, $type::NAN, 3.0, $type::INFINITY, 1.0]);
            voxels[66] = 9.0;
            let Voxels::$variant(found) = halved(&Voxels::$variant(voxels)) else { panic!("another type") };
            assert!(found[..2] == [$type::MAX, 0.0] && found[2].is_nan(), "{found:?}");
            assert!(found[3..6] == [3.0, $type::INFINITY, 1.0] && found[33..] == [9.0], "{found:?}");
        )*};
    }
    float!(F32 f32, F64 f64);
}

#[test]
fn a_level_of_labels_has_the_most_frequent_ones() {
    let geometry = Geometry::unit("made", [66, 2, 1]).unwrap();
    // Two rows: 1, 7, 1, 7, … over 7, 7, 7, …: three of four are 7; the last block has 1, 1 over 7, 7.
    let mut voxels: Vec<u8> = (0..132).map(|at| if at < 66 && at % 2 == 0 { 1 } else { 7 }).collect();
    voxels[65] = 1;
    let mut volume = Volume::new("made", Voxels::U8(voxels), geometry).unwrap();
    volume.has_labels = true;
    volume.presets.labels = vec![volume::LabelPreset { value: 7, name: "seven".to_owned(), colour: None }];
    let folder = tempfile::tempdir().unwrap();
    let [nrrd, bricks] = ["v.nrrd", "v.bricks"].map(|name| folder.path().join(name));
    relume::output::write_volume(&nrrd, &volume, &Quiet).unwrap();
    write_bricks(&bricks, (&nrrd, None), &Selection::default(), u64::MAX, &Quiet).unwrap();
    let level = open(&bricks, 1, HostMemory::Whole).unwrap();
    let mut expected = vec![7; 33];
    expected[32] = 1;
    assert_eq!((level.voxels, level.geometry.dims), (Voxels::U8(expected), [33, 1, 1]));
}

#[test]
fn a_level_is_chosen_as_in_a_store_and_none_is_chosen_silently() {
    let made = Made::of(&Voxels::U8(vec![5; 200 * 4]), [200, 4, 1]);
    let message = open(&made.path, 3, HostMemory::Whole).unwrap_err().to_string();
    assert!(
        message.contains("level 3 does not exist") && message.contains("3 levels: 0 200×4×1, 1 100×2×1"),
        "{message}"
    );
    let asks = Selection { asks: true, ..Selection::default() };
    match volume::open(&made.path, &asks, &Quiet).unwrap_err() {
        VolumeError::Choose { there: Several::Levels(all), .. } => {
            assert_eq!(all, [[200, 4, 1], [100, 2, 1], [50, 1, 1]]);
        }
        error => panic!("{error}"),
    }
    let read = volume::open(&made.path, &Selection::default(), &Quiet).unwrap();
    assert_eq!((read.geometry.dims, read.selection.level), ([200, 4, 1], Some(0)));
    let told: Vec<_> = read.metadata.iter().filter(|(key, _)| key == "pyramid" || key == "level").collect();
    assert!(told.len() == 2 && told[0].1.starts_with("3 levels: 0 200×4×1") && told[1].1 == "0", "{told:?}");
    // 100 bytes of memory are enough for level 2, but level 0 was asked for.
    let memory = HostMemory::Bounded { bytes: Some(100) };
    assert!(volume::open(&made.path, &Selection { memory, ..Selection::default() }, &Quiet).is_err());
    assert_eq!(open(&made.path, 2, memory).unwrap().voxels, Voxels::U8(vec![5; 50]));
}

/// Made by Relume 0.1.0 before files of bricks had levels.
#[test]
fn a_file_of_bricks_of_version_1_has_its_one_level() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/hostile/bricks/long");
    assert_eq!(std::fs::read(&path).unwrap()[8], 1);
    let folder = tempfile::tempdir().unwrap();
    let old = folder.path().join("old.bricks");
    std::fs::copy(path, &old).unwrap();
    for memory in [HostMemory::Whole, HostMemory::InFile] {
        let read = volume::open(&old, &Selection { memory, ..Selection::default() }, &Quiet).unwrap();
        assert_eq!((read.geometry.dims, read.voxels.voxel_type()), ([130, 1, 1], VoxelType::U16));
        assert_eq!(read.selection.level, None);
    }
    assert_eq!(volume::brick_levels(&old).unwrap().len(), 1);
    assert_eq!(
        volume::open(&old, &Selection { memory: HostMemory::InFile, ..Selection::default() }, &Quiet)
            .unwrap()
            .coarser_levels(),
        0
    );
    // Its coarse level is averaged from its three bricks.
    let [in_file, whole] = [HostMemory::InFile, HostMemory::Whole]
        .map(|memory| volume::open(&old, &Selection { memory, ..Selection::default() }, &Quiet).unwrap());
    in_file.prepare_coarse(&Quiet).unwrap();
    let coarse = in_file.at_hand();
    assert_eq!((coarse.geometry.dims, coarse.voxels.len()), ([65, 1, 1], 65));
    assert!(coarse.voxels == whole.coarse_level([2, 1, 1], &Quiet).unwrap().voxels);
    let message = open(&old, 1, HostMemory::Whole).unwrap_err().to_string();
    assert!(message.contains("level 1 does not exist; the file holds one level, 0"), "{message}");
}

#[test]
fn a_damaged_level_is_named() {
    let made = Made::of(&Voxels::U8((0..200_u8).collect()), [200, 1, 1]);
    let mut bytes = std::fs::read(&made.path).unwrap();
    // Four bricks of level 0, then two of level 1: 64 bytes of header, and 200 that LZ4 does not shorten.
    bytes[64 + 200 + 5] ^= 1;
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&made.path, bytes).unwrap();
    assert!(open(&made.path, 0, HostMemory::Whole).is_ok(), "another level");
    let message = open(&made.path, 1, HostMemory::Whole).unwrap_err().to_string();
    assert!(message.contains("brick 0 of level 1 is damaged: the digest is"), "{message}");
    let cells = |level| made.level(level, HostMemory::InFile).bricks.unwrap().each_cell(|_, _| ());
    assert!(cells(2).unwrap_err().to_string().contains("macrocells are damaged"));
    assert!(cells(0).is_ok() && cells(1).is_ok());
}

#[test]
fn halving_in_memory_makes_the_levels_of_the_file() {
    let dims = [131, 70, 3];
    let voxels = Voxels::U8((0..131 * 70 * 3_usize).map(|i| u8::try_from(i * i % 251).unwrap()).collect());
    let made = Made::of(&voxels, dims);
    for memory in [HostMemory::Whole, HostMemory::InFile] {
        let finest = made.level(0, memory);
        assert_eq!(finest.coarser_levels(), 8, "131 voxels, halved eight times, are one");
        for halvings in [1, 2] {
            let level = made.level(halvings, HostMemory::Whole);
            let halved = finest.coarser_by(u32::try_from(halvings).unwrap(), false, &Quiet).unwrap();
            assert!(halved.voxels == level.voxels && halved.geometry == level.geometry, "{memory:?}: {halvings}");
        }
        // The file ends with level 2, a single brick.
        let [third, of_second] = [(&finest, 3), (&made.level(2, HostMemory::Whole), 1)]
            .map(|(volume, halvings)| volume.coarser_by(halvings, false, &Quiet).unwrap().voxels);
        assert!(third == of_second && third.len() == 17 * 9, "{memory:?}");
    }
}
