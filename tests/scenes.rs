//! The scene files that come with the program: each loads, and shows every material it states.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use relume::plan::plan;
use relume::progress::Quiet;
use relume::scene::{self, Scene, SceneOptions, positions};

/// A folder of this test's own.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("relume-scenes-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A `MetaImage` of zeros in `folder`.
fn zeros(folder: &Path, name: &str, dims: [usize; 3]) -> PathBuf {
    let [x, y, z] = dims;
    let header = format!("NDims = 3\nDimSize = {x} {y} {z}\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n");
    let mut bytes = header.into_bytes();
    bytes.resize(bytes.len() + x * y * z, 0);
    let path = folder.join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn load(name: &str, options: &SceneOptions) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/scenes").join(name);
    scene::load(&path, options, &Quiet).unwrap()
}

/// Two lights that relighting can tell apart, and no material that nothing shows.
fn check(scene: &Scene) {
    assert_eq!(positions(scene).len(), 2, "{}", scene.source);
    let used = plan(scene, &Quiet).unwrap().materials;
    let unused: Vec<_> = (0..scene.materials.len())
        .filter(|material| !used.contains(material))
        .map(|material| &scene.materials[material].name)
        .collect();
    assert_eq!(unused, [""; 0], "{}", scene.source);
}

#[test]
fn the_default_scene_shows_all_its_materials() {
    check(&scene::load_embedded(&SceneOptions::default(), &Quiet).unwrap());
}

#[test]
fn the_made_engine_shows_all_its_materials() {
    check(&load("engine.toml", &SceneOptions::default()));
}

#[test]
fn the_frog_shows_all_its_materials_with_labels_and_a_few_without() {
    let folder = folder("frog");
    let volume = Some(zeros(&folder, "frog.mha", [5, 4, 3]));
    let labels = Some(zeros(&folder, "labels.mha", [5, 4, 3]));
    let labelled = load("frog.toml", &SceneOptions { volume: volume.clone(), labels, ..SceneOptions::default() });
    check(&labelled);
    assert_eq!(labelled.labels.unwrap().declared.len(), 15);
    let plain = load("frog.toml", &SceneOptions { volume, ..SceneOptions::default() });
    assert_eq!(plan(&plain, &Quiet).unwrap().materials.len(), 4);
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn the_scanned_engine_shows_all_its_materials() {
    let folder = folder("engine");
    let volume = Some(zeros(&folder, "engine.mha", [256, 256, 128]));
    check(&load("engine_ct.toml", &SceneOptions { volume, ..SceneOptions::default() }));
    std::fs::remove_dir_all(folder).unwrap();
}
