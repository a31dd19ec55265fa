//! Levels of resolution by the size of voxels in the picture.

use std::sync::Arc;

use relume::output::write_bricks;
use relume::progress::Quiet;
use relume::scene::{Coarse, LabelEntry, Labels, Scene};
use relume::volume::{self, Geometry, HostMemory, RawLayout, Selection, Volume, VoxelType, Voxels};

use crate::support::program::Folder;

const DIMS: [usize; 3] = [70, 50, 40];

/// A volume of 8 bits with structures of some voxels, a sidecar, and its file of bricks with levels 0 and 1.
fn volume(folder: Folder) -> Folder {
    let [nx, ny, nz] = DIMS;
    let value = |i: usize| u8::try_from(((i % nx * 7) ^ (i / nx % ny * 13) ^ (i / (nx * ny) * 5)) % 256).unwrap();
    let folder = folder.with("v.raw", (0..nx * ny * nz).map(value).collect::<Vec<u8>>());
    let folder = folder.with("v.raw.toml", "dims = [70, 50, 40]\ntype = \"uint8\"\n");
    folder.done(&["bricks", "v.raw", "-o", "v.bricks"]);
    folder
}

/// The eye is 60 before the first voxels, of which one is 24 / (2·60·tan 15°) = 0.7464 pixels wide.
const CAMERA: [&str; 6] =
    ["-D", "camera.position=[35,25,-60]", "-D", "camera.target=[35,25,20]", "-D", "transfer.opacity_length=1"];

#[test]
fn a_level_by_the_size_of_its_voxels_is_the_level_of_the_file_and_none_is_taken_unasked() {
    let folder = volume(Folder::new());
    let picture = |name: &str, file: &str, more: &[&str]| {
        let outputs = ["--size", "24x24", "-o", name, "--json"];
        let json = folder.done(&[&["render", "scene.toml", "--volume", file][..], &outputs, &CAMERA, more].concat());
        (std::fs::read(folder.path(name)).unwrap(), json.json()["level"].clone())
    };
    let (whole, none) = picture("whole.png", "v.bricks", &[]);
    let (zero, still_none) = picture("zero.png", "v.bricks", &["-D", "accuracy.voxel_pixels=0"]);
    assert!(none.is_null() && still_none.is_null() && whole == zero, "{none} {still_none}");
    let (fine, level) = picture("fine.png", "v.bricks", &["-D", "accuracy.voxel_pixels=1.49"]);
    assert!(fine == whole && level["level"] == 0, "{level}");
    let (of_file, none) = picture("file.png", "v.bricks", &["--pyramid-level", "1"]);
    assert!(none.is_null() && of_file != whole);
    for file in ["v.bricks", "v.raw"] {
        let (coarse, level) = picture("coarse.png", file, &["-D", "accuracy.voxel_pixels=1.5"]);
        assert!(coarse == of_file, "{file}: {level}");
        assert_eq!((&level["level"], &level["block"]), (&1.into(), &serde_json::json!([2, 2, 2])), "{level}");
        // Twice 0.7464, and twice that.
        let pixels = ["pixels", "next_pixels"].map(|key| level[key].as_f64().unwrap());
        assert!((pixels[0] - 1.49282).abs() < 1e-4 && (pixels[1] - 2.0 * pixels[0]).abs() < 1e-12, "{level}");
    }
    let told = [&["render", "scene.toml", "--volume", "v.bricks", "-o", "p.png", "--size", "24x24"][..], &CAMERA];
    let told = folder.done(&[&told.concat()[..], &["-D", "accuracy.voxel_pixels=1.5"]].concat()).out;
    let sentence = "level 1 of the volume, means of 2×2×2 voxels: its voxels take up to 1.49 of 1.50 allowed pixels, and level 2 2.99";
    assert!(told.contains(sentence), "{told}");
}

/// 16×16×16 voxels: a plate of label 3, one voxel thick, and a cube of label 5 that fills whole blocks of level 1.
fn labels() -> Vec<u8> {
    let of_voxel = |i: usize| match [i % 16, i / 16 % 16, i / 256] {
        [0..8, 0..8, 4] => 3,
        [8..16, 8..16, 8..16] => 5,
        _ => 0,
    };
    (0..4096).map(of_voxel).collect()
}

#[test]
fn a_label_that_its_blocks_outvote_is_counted_and_named() {
    let header = "NDims = 3\nDimSize = 16 16 16\nElementType = MET_UCHAR\nElementDataFile = labels.raw\n";
    let folder = Folder::new().with("v.raw", [100; 4096]).with("labels.raw", labels()).with("labels.mhd", header);
    let picture = ["render", "scene.toml", "-o", "p.png", "--size", "16x16", "--labels", "labels.mhd"];
    let volume = ["--volume", "v.raw", "--dims", "16x16x16", "--type", "uint8", "-D", "camera.projection=orthographic"];
    let labelled = [
        "-D",
        "labels.3={name=\"nerve\",material=\"flesh\",opacity=1}",
        "-D",
        "labels.5={name=\"bone\",material=\"bone\",opacity=1}",
        "-D",
        "accuracy.voxel_pixels=2",
    ];
    let outcome = folder.done(&[&picture[..], &volume, &labelled].concat());
    let nerve = "3 (nerve), 0 voxels of the level (for 0) of its 64 voxels";
    assert!(outcome.err.contains("less than half of these labels") && outcome.err.contains(nerve), "{}", outcome.err);
    assert!(!outcome.err.contains("5 (bone)"), "{}", outcome.err);
    assert!(outcome.out.contains(&format!("of the smallest visible label, {nerve}")), "{}", outcome.out);
    let json = folder.done(&[&picture[..], &volume, &labelled, &["--json"]].concat()).json();
    let bone = serde_json::json!({"label": 5, "name": "bone", "voxels": 512, "left": 64, "stands_for": 512});
    assert_eq!(json["level"]["labels"][1], bone, "{json}");
}

#[test]
fn labels_in_a_file_are_counted_there_unless_its_levels_are_means() {
    let folder = tempfile::tempdir().unwrap();
    let [raw, path] = ["l.raw", "l.bricks"].map(|name| folder.path().join(name));
    std::fs::write(&raw, [labels(), vec![0; 15 * 4096]].concat()).unwrap();
    let dims = [16, 16, 256];
    let layout = RawLayout::new(dims, VoxelType::U8);
    write_bricks(&path, (&raw, Some(&layout)), &Selection::default(), u64::MAX, &Quiet).unwrap();
    let selection = Selection { memory: HostMemory::InFile, ..Selection::default() };
    let open = || volume::open(&path, &selection, &Quiet).unwrap();
    let whole = Volume::new("v", Voxels::U8(vec![0; 16 * 16 * 256]), Geometry::unit("v", dims).unwrap()).unwrap();
    let mut scene = Scene::new("labels", Arc::new(whole));
    let entry =
        LabelEntry { label: 5, name: "bone".to_owned(), material: 0, opacity: 1.0, absorption: 0.0, terms: Vec::new() };
    let labelled = |volume: Volume| Some(Labels { volume: Arc::new(volume), declared: vec![entry.clone()] });
    scene.labels = labelled(open());
    let message = Coarse::of_level(&scene, 1, &Quiet).unwrap_err().to_string();
    assert!(message.contains("labels that are not marked as labels"), "{message}");
    scene.labels = labelled(Volume { has_labels: true, ..open() });
    let left = Coarse::of_level(&scene, 1, &Quiet).unwrap().labels_left(&scene).unwrap();
    assert_eq!((left[0].voxels, left[0].left, left[0].is_mostly_lost()), (512, 64, false), "{left:?}");
}
