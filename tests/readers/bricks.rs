//! Files of bricks hold the volume of which they were made; damaged ones are refused in a sentence.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use relume::output::write_bricks;
use relume::progress::{Progress, Quiet};
use relume::volume::{self, Geometry, HostMemory, RawLayout, Selection, Volume, VoxelType, Voxels};

const DIMS: [usize; 3] = [70, 66, 129];

/// Distinct numbers of two bytes for each voxel.
fn number(index: usize) -> u16 {
    u16::try_from(index * 40_503 % 65_536).unwrap()
}

/// Voxels of `voxel_type`, little-endian.
fn bytes_of(voxel_type: VoxelType) -> Vec<u8> {
    let all = 0..DIMS.iter().product::<usize>();
    let float = |index| f32::from(number(index)) * 0.37 - 9.0;
    match voxel_type {
        VoxelType::U8 | VoxelType::I8 => all.map(|index| number(index).to_le_bytes()[1]).collect(),
        VoxelType::U16 | VoxelType::I16 => all.flat_map(|index| number(index).to_le_bytes()).collect(),
        VoxelType::F32 => all.flat_map(|index| float(index).to_le_bytes()).collect(),
        VoxelType::F64 => all.flat_map(|index| f64::from(float(index)).to_le_bytes()).collect(),
        VoxelType::U32 | VoxelType::I32 => {
            all.flat_map(|index| (u32::from(number(index)) << 15).wrapping_neg().to_le_bytes()).collect()
        }
        VoxelType::U64 | VoxelType::I64 => {
            all.flat_map(|index| (u64::from(number(index)) << 47 | 1).wrapping_neg().to_le_bytes()).collect()
        }
    }
}

struct Made {
    folder: tempfile::TempDir,
    layout: RawLayout,
}

impl Made {
    fn new(voxel_type: VoxelType) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("v.raw"), bytes_of(voxel_type)).unwrap();
        let layout = RawLayout { spacing: [0.5, 0.75, 2.0], ..RawLayout::new(DIMS, voxel_type) };
        Self { folder, layout }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Makes bricks with `budget` bytes for a slab, and returns whether it was spilled.
    fn bricks(&self, name: &str, budget: u64, progress: &dyn Progress) -> Result<bool, String> {
        let source = (&*self.path("v.raw"), Some(&self.layout));
        let made = write_bricks(&self.path(name), source, &Selection::default(), budget, progress);
        made.map(|made| made.spilled).map_err(|error| error.to_string())
    }

    fn whole(&self) -> Volume {
        volume::open_by(&self.path("v.raw"), Some(&self.layout), &Selection::default(), &Quiet).unwrap()
    }
}

fn open(path: &Path, memory: HostMemory) -> Result<Volume, String> {
    let selection = Selection { memory, ..Selection::default() };
    volume::open(path, &selection, &Quiet).map_err(|error| error.to_string())
}

#[test]
fn bricks_of_every_type_hold_the_voxels_and_their_statistics() {
    for voxel_type in VoxelType::ALL {
        let made = Made::new(voxel_type);
        assert_eq!(made.bricks("v.bricks", u64::MAX, &Quiet), Ok(false));
        assert_eq!(made.bricks("spilled.bricks", 1, &Quiet), Ok(true));
        let [one, other] = ["v.bricks", "spilled.bricks"].map(|name| std::fs::read(made.path(name)).unwrap());
        assert!(one == other, "{voxel_type}: the same through a temporary file");
        let whole = made.whole();
        let read = open(&made.path("v.bricks"), HostMemory::Whole).unwrap();
        assert!(read.voxels == whole.voxels, "{voxel_type}");
        assert_eq!((read.geometry, read.unit), (whole.geometry, whole.unit));
        let in_file = open(&made.path("v.bricks"), HostMemory::InFile).unwrap();
        assert!(in_file.voxels.is_empty() && in_file.voxels.voxel_type() == voxel_type);
        let [known, expected] = [&in_file, &whole].map(|volume| volume.statistics().unwrap());
        assert!((known.mean - expected.mean).abs() <= 2e-12 * expected.max.abs(), "{voxel_type}: {known:?}");
        assert_eq!(volume::Statistics { mean: expected.mean, ..known }, expected, "{voxel_type}");
        // A box across eight bricks.
        let cache = in_file.bricks.as_ref().unwrap();
        let part = cache.part([63, 60, 62], [66, 66, 67]).unwrap();
        for (at, expected) in [([0, 0, 0], [63, 60, 62]), ([2, 5, 4], [65, 65, 66]), ([1, 4, 2], [64, 64, 64])] {
            assert_eq!(part.value(at), whole.value(expected), "{voxel_type} {expected:?}");
        }
        assert_eq!((cache.counts().loaded, cache.counts().again), (8, 0));
    }
}

/// Progress that cancels after some reports.
struct Impatient(AtomicU64);

impl Progress for Impatient {
    fn report(&self, _: &str, _: u64, _: u64) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }

    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }
}

#[test]
fn cancelled_bricks_leave_the_file_before_or_none() {
    // Two slabs of 4 MiB are read, and then the bricks once more.
    let made = Made::new(VoxelType::F64);
    for reports in [1, 2, 3] {
        let failed = made.bricks("v.bricks", 1 << 20, &Impatient(AtomicU64::new(reports)));
        assert!(failed.unwrap_err().contains("was cancelled"), "after {reports} reports");
        let left: Vec<_> = std::fs::read_dir(made.folder.path()).unwrap().map(|it| it.unwrap().file_name()).collect();
        assert_eq!(left, ["v.raw"], "after {reports} reports");
    }
    std::fs::write(made.path("v.bricks"), "before").unwrap();
    assert!(made.bricks("v.bricks", u64::MAX, &Impatient(AtomicU64::new(1))).is_err());
    assert_eq!(std::fs::read(made.path("v.bricks")).unwrap(), b"before");
}

fn crc(bytes: &[u8]) -> [u8; 4] {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum().to_le_bytes()
}

fn u64_at(bytes: &[u8], at: usize) -> usize {
    usize::try_from(u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())).unwrap()
}

#[test]
fn damaged_bricks_of_another_version_and_overlapping_ones_are_refused_in_a_sentence() {
    let made = Made::new(VoxelType::U8);
    made.bricks("v.bricks", u64::MAX, &Quiet).unwrap();
    let sound = std::fs::read(made.path("v.bricks")).unwrap();
    let text_at = u64_at(&sound, 16);
    let text_bytes = usize::try_from(u32::from_le_bytes(sound[12..16].try_into().unwrap())).unwrap();
    let (index_at, cells_at) = (text_at + text_bytes, text_at + text_bytes + 15 * 32);
    // Text and index with their digest, for changes that the digest does not notice.
    let redigested = |bytes: &mut Vec<u8>| {
        let digest = crc(&bytes[text_at..cells_at]);
        bytes[40..44].copy_from_slice(&digest);
    };
    let text = String::from_utf8(sound[text_at..index_at].to_vec()).unwrap();
    type Change<'a> = Box<dyn Fn(&mut Vec<u8>) + 'a>;
    let in_text = |from: &'static str, to: &'static str| -> Change<'_> {
        assert!(text.contains(from) && from.len() == to.len(), "{from} in {text}");
        let at = text_at + text.find(from).unwrap();
        Box::new(move |bytes| {
            bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
            redigested(bytes);
        })
    };
    let cases: Vec<(Change<'_>, &str)> = vec![
        (Box::new(|bytes| bytes.truncate(bytes.len() - 1)), "but its header makes it"),
        (Box::new(|bytes| bytes.truncate(40)), "its beginning is damaged"),
        (Box::new(|bytes| bytes.push(0)), "but its header makes it"),
        (Box::new(|bytes| bytes[8] = 7), "version 7; this Relume reads versions 1 to 2"),
        (Box::new(|bytes| bytes[24..32].fill(255)), "but its header makes it"),
        (Box::new(|bytes| bytes[16..24].fill(255)), "but its header makes it"),
        (Box::new(|bytes| bytes[text_at + 3] ^= 1), "text and index are damaged"),
        (Box::new(|bytes| bytes[cells_at - 1] ^= 1), "text and index are damaged"),
        (Box::new(|bytes| bytes[100] ^= 1), "brick 0 is damaged: the digest is"),
        (
            Box::new(|bytes| {
                bytes[index_at + 32] ^= 1;
                redigested(bytes);
            }),
            "brick 1 begins at byte",
        ),
        (
            Box::new(|bytes| {
                bytes[index_at + 8..index_at + 12].copy_from_slice(&7_u32.to_le_bytes());
                redigested(bytes);
            }),
            "brick 0 has 7 bytes, which cannot hold 262144 bytes of voxels",
        ),
        (in_text("dims = [70, 66, 129]", "dims = [70, 66, 192]"), "bytes of macrocells, but the file has"),
        (in_text("dims = [70, 66, 129]", "dims = [90, 66, 129]"), "bytes of macrocells, but the file has"),
        (in_text("dims = [35, 33, 65]", "dims = [35, 33, 66]"), "its coarser levels have [[35, 33, 66], [18, 17, 33]]"),
        (
            // Bricks 2 of level 0, then 0 of level 1, which is written after two slabs of four.
            Box::new(|bytes| {
                bytes[index_at + 12 * 32] ^= 1;
                redigested(bytes);
            }),
            "brick 0 of level 1 begins at byte",
        ),
        (Box::new(|bytes| bytes[8] = 1), "but the file has 15 and"),
        (in_text("slope = 1.0", "slope = nan"), "no usable slope"),
        (in_text("anatomical", "anatomicaX"), "its text: unknown field"),
        (in_text("not_a_number = 0", "not_a_number = 9"), "its statistics contradict each other"),
        (in_text("0.75", "-7.5"), "spacing"),
    ];
    let path = made.path("damaged.bricks");
    for (change, expected) in cases {
        let mut bytes = sound.clone();
        change(&mut bytes);
        std::fs::write(&path, bytes).unwrap();
        let message = open(&path, HostMemory::Whole).unwrap_err();
        assert!(message.contains(expected) && message.contains("damaged.bricks"), "no {expected:?} in {message}");
    }
    // Bricks that a march reads later are compared with their digests, too.
    let mut bytes = sound.clone();
    bytes[cells_at] ^= 1;
    bytes[100] ^= 1;
    std::fs::write(&path, bytes).unwrap();
    let read = open(&path, HostMemory::InFile).unwrap();
    let cache = read.bricks.as_ref().unwrap();
    assert!(cache.each_cell(|_, _| ()).unwrap_err().to_string().contains("macrocells are damaged"));
    assert!(cache.part([0; 3], [1; 3]).unwrap_err().to_string().contains("brick 0 is damaged"));
    assert!(cache.part([64, 0, 0], [65, 1, 1]).is_ok(), "another brick");
}

#[test]
fn voxels_without_a_value_make_no_bricks_and_nothing_needs_voxels_that_stay_in_the_file() {
    let made = Made::new(VoxelType::F32);
    made.bricks("v.bricks", u64::MAX, &Quiet).unwrap();
    let mut in_file = open(&made.path("v.bricks"), HostMemory::InFile).unwrap();
    let message = in_file.keep_largest_part_above(0.0, &Quiet).unwrap_err().to_string();
    assert!(message.contains("volume.largest_part_above needs all of them in memory"), "{message}");
    let message = in_file.downsample([2; 3]).unwrap_err().to_string();
    assert!(message.contains("averaging blocks needs all of them in memory"), "{message}");
    let nothing = f32::NAN.to_le_bytes().repeat(DIMS.iter().product());
    std::fs::write(made.path("v.raw"), nothing).unwrap();
    let message = made.bricks("nan.bricks", u64::MAX, &Quiet).unwrap_err();
    assert!(message.contains("no finite voxel") && !made.path("nan.bricks").exists(), "{message}");
}

#[test]
fn headers_survive_in_bricks() {
    let geometry = Geometry::unit("made", [3, 2, 2]).unwrap();
    let mut volume = Volume::new("made", Voxels::I16((0..12).collect()), geometry).unwrap();
    (volume.anatomical, volume.unit) = (true, Some(volume::Unit::Millimetre));
    volume.presets.labels =
        vec![volume::LabelPreset { value: 3, name: "a \"b\"".to_owned(), colour: Some([1.0, 0.5, 0.0]) }];
    volume.has_labels = true;
    let folder = tempfile::tempdir().unwrap();
    let [nrrd, bricks] = ["v.nrrd", "v.bricks"].map(|name| folder.path().join(name));
    relume::output::write_volume(&nrrd, &volume, &Quiet).unwrap();
    write_bricks(&bricks, (&nrrd, None), &Selection::default(), u64::MAX, &Quiet).unwrap();
    let [stated, read] = [&nrrd, &bricks].map(|path| open(path, HostMemory::Whole).unwrap());
    assert_eq!((read.anatomical, read.unit, read.has_labels), (true, stated.unit, true));
    assert_eq!((&read.presets, read.geometry), (&stated.presets, stated.geometry));
    assert!(read.voxels == stated.voxels);
    let (last, others) = read.metadata.split_last().unwrap();
    assert_eq!(others, stated.metadata);
    assert!(last.1.contains("v.nrrd, ") && last.1.contains(" bytes, changed "), "{last:?}");
}

#[test]
fn a_header_that_promises_more_than_its_file_has_is_refused_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lies.nrrd");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 100000 100000 100000\nencoding: raw\n\nshort";
    std::fs::write(&path, header).unwrap();
    let made = write_bricks(&folder.path().join("v.bricks"), (&path, None), &Selection::default(), 1 << 24, &Quiet);
    let error = made.unwrap_err().to_string();
    assert!(error.contains("lies.nrrd") && error.contains("1000000000000000"), "{error}");
}

#[test]
fn the_coarse_level_of_voxels_in_a_file_is_that_of_voxels_in_memory() {
    for voxel_type in [VoxelType::U8, VoxelType::I16, VoxelType::F32] {
        let made = Made::new(voxel_type);
        made.bricks("v.bricks", u64::MAX, &Quiet).unwrap();
        // Level 0 has a coarser one in the file; the last level has none, and its bricks are averaged.
        let last = volume::brick_levels(&made.path("v.bricks")).unwrap().len() - 1;
        for level in [0, last] {
            let open = |memory| {
                let selection = Selection { level: Some(level), memory, ..Selection::default() };
                volume::open(&made.path("v.bricks"), &selection, &Quiet).unwrap()
            };
            let (in_file, whole) = (open(HostMemory::InFile), open(HostMemory::Whole));
            assert!(in_file.at_hand().voxels.is_empty(), "before it is made");
            in_file.prepare_coarse(&Quiet).unwrap();
            let coarse = in_file.at_hand();
            let expected = whole.coarse_level([2; 3], &Quiet).unwrap();
            assert_eq!(
                (coarse.geometry, in_file.block_of(coarse)),
                (expected.geometry, [2; 3]),
                "{voxel_type} {level}"
            );
            assert!(coarse.voxels == expected.voxels, "{voxel_type} {level}");
        }
    }
}

#[test]
fn the_coarse_level_takes_a_small_part_of_the_memory_from_the_bricks() {
    // 4×4×4 bricks of bytes, of which 27 and what is beside them take just less than the voxels.
    let folder = tempfile::tempdir().unwrap();
    let [raw, bricks] = ["v.raw", "v.bricks"].map(|name| folder.path().join(name));
    let dims = [300, 300, 280];
    std::fs::write(&raw, vec![7_u8; dims.iter().product()]).unwrap();
    let source = (&*raw, Some(&RawLayout::new(dims, VoxelType::U8)));
    write_bricks(&bricks, source, &Selection::default(), u64::MAX, &Quiet).unwrap();
    let bounded = |bytes: u64| open(&bricks, HostMemory::Bounded { bytes: Some(bytes) });
    let error = bounded(1 << 20).unwrap_err();
    let least: u64 = error.split("at least ").nth(1).and_then(|text| text.split(' ').next()?.parse().ok()).unwrap();
    let read = bounded(24 << 20).unwrap();
    assert!(read.bricks.is_some() && least <= 24, "{error}");
    let before = read.bricks.as_ref().unwrap().counts().held;
    read.prepare_coarse(&Quiet).unwrap();
    let after = read.bricks.as_ref().unwrap().counts().held;
    let coarse = read.at_hand();
    assert_eq!(coarse.geometry.dims, [75, 75, 70], "an eighth of the memory at most");
    assert!(after < before && after >= 27, "{after} of {before} bricks");
}
