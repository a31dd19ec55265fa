//! Scenes on volumes in memory: nothing is copied, read or looked at twice.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use relume::document::{InMemory, SceneError, SceneOptions, Source, first_look_of, parse, parse_on};
use relume::plan::Planned;
use relume::progress::Quiet;
use relume::render::{Job, PlannedJob};
use relume::volume::{Geometry, Volume, Voxels};

use crate::support;
use support::rungs::Rungs;

const SCENE: &str = r#"
version = 1
[materials.bone]
reflectance = 0.8
[[transfer.intervals]]
material = "bone"
range = [100, 1000]
opacity = 0.3
[lights.day]
spectrum = "D65"
kind = "directional"
direction = [-1, -1, -1]
"#;

const DIMS: [usize; 3] = [24, 20, 16];

/// Values of a ball, from 1000 in its middle.
fn values() -> Vec<u16> {
    let value = |index: usize| {
        let [nx, ny, nz] = DIMS;
        let place = [index % nx, index / nx % ny, index / (nx * ny)];
        let square: usize = place.iter().zip([nx, ny, nz]).map(|(&at, side)| (2 * at).abs_diff(side - 1).pow(2)).sum();
        u16::try_from(1000_usize.saturating_sub(4 * square)).unwrap()
    };
    (0..DIMS.iter().product()).map(value).collect()
}

fn ball() -> Arc<Volume> {
    let grid = Geometry::new("ball", DIMS, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY).unwrap();
    Arc::new(Volume::new("ball", Voxels::U16(values()), grid).unwrap())
}

fn of(volume: &Arc<Volume>) -> InMemory {
    InMemory { volume: Arc::clone(volume), labels: None, further: Vec::new() }
}

fn parsed(volumes: InMemory, text: &str) -> Result<relume::document::SceneFile, SceneError> {
    parse_on(volumes, "notebook", text, Path::new(""), &SceneOptions::default(), &Quiet)
}

#[test]
fn a_scene_holds_the_volume_itself_unless_a_key_changes_it() {
    let volume = ball();
    let file = parsed(of(&volume), SCENE).unwrap();
    assert!(Arc::ptr_eq(file.scene.volume(), &volume), "the same volume");
    let spaced = parsed(of(&volume), &format!("{SCENE}[volume]\nspacing = [1, 1, 2]\n")).unwrap();
    assert_eq!(spaced.scene.frame.geometry.spacing, DVec3::new(1.0, 1.0, 2.0));
    assert_ne!(volume.geometry.spacing, spaced.scene.frame.geometry.spacing, "of a copy");
    let halved = parsed(of(&volume), &format!("{SCENE}[volume]\ndownsample = [2, 2, 2]\n")).unwrap();
    assert_eq!(halved.scene.frame.geometry.dims, [12, 10, 8]);
}

#[test]
fn labels_in_memory_are_those_of_the_scene() {
    let volume = ball();
    let voxels = Voxels::U8((0..DIMS.iter().product()).map(|i: usize| u8::from(i % DIMS[0] < 12)).collect());
    let labels = Arc::new(Volume::new("labels", voxels, volume.geometry).unwrap());
    let text = format!("{SCENE}[labels.1]\nmaterial = \"bone\"\nopacity = 0.5\n");
    let volumes = InMemory { volume, labels: Some(Arc::clone(&labels)), further: Vec::new() };
    let file = parsed(volumes, &text).unwrap();
    let of_scene = file.scene.labels.unwrap();
    assert!(Arc::ptr_eq(&of_scene.volume, &labels) && of_scene.declared.len() == 1);
}

#[test]
fn a_first_look_at_an_array_is_that_at_its_file() {
    let header = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 24 20 16\nendian: little\nencoding: raw\n\n";
    let voxels = values().into_iter().flat_map(u16::to_le_bytes);
    let folder = support::program::Folder::new().with("ball.nrrd", header.bytes().chain(voxels).collect::<Vec<u8>>());
    let path = folder.path("ball.nrrd");
    let (of_file, _) = Source::of(&path).read(&Quiet).unwrap();
    let mut named = Volume::clone(of_file.scene.volume());
    named.source = path.display().to_string();
    let named = Arc::new(named);
    let (of_array, _) = first_look_of(of(&named), &SceneOptions::default(), &Quiet).unwrap();
    assert_eq!(of_array.text, of_file.text);
    assert_eq!(of_array.guess, of_file.guess);
    assert!(Arc::ptr_eq(of_array.scene.volume(), &named), "the same volume");
}

#[test]
fn errors_of_a_scene_name_the_key() {
    for (from, to, key) in [
        ("0.3", "3", "transfer.intervals.0.opacity"),
        ("\"D65\"", "\"D66\"", "lights.day.spectrum"),
        ("[-1, -1, -1]", "[0, 0, 0]", "lights.day.direction"),
    ] {
        let error = parsed(of(&ball()), &SCENE.replace(from, to)).unwrap_err();
        assert_eq!(error.key(), Some(key), "{error}");
    }
    let options = SceneOptions {
        definitions: vec![relume::document::Definition::new("camera.fov=500")],
        ..SceneOptions::default()
    };
    let scene = format!("{SCENE}[volume]\nphantom = \"engine\"\n");
    let error = parse("scene", &scene, Path::new(""), &options, &Quiet).unwrap_err();
    assert_eq!(error.key(), Some("camera.fov"), "{error}");
}

#[test]
fn the_cpu_marches_as_a_device_within_rounding() {
    let file = parsed(of(&ball()), SCENE).unwrap();
    let statistics = file.scene.volume().statistics().unwrap();
    let job: PlannedJob = Job::new(file.scene, statistics).planned(&Quiet).unwrap();
    let size = [24, 18];
    let found = job.on_cpu(&mut None).unwrap().film(&job.cameras[0], size, &Quiet).unwrap();
    let planned: Planned = job.planned.clone();
    let rungs = Rungs::planned(job.scene.clone(), planned, size);
    let expected = rungs.march::<f32>(&rungs.stored::<f32>());
    assert_eq!(found, expected);
    assert!(found.accumulators.iter().any(|&number| number > 0.01), "something is seen");
}
