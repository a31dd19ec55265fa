//! The examples run and write their documented output.

use std::path::{Path, PathBuf};
use std::process::Command;

use relume::progress::Quiet;
use relume::volume::Selection;

use crate::support::dicom;

/// `cargo test` builds the examples next to the program.
fn example(name: &str) -> PathBuf {
    let program = Path::new(env!("CARGO_BIN_EXE_relume"));
    program.parent().unwrap().join("examples").join(name).with_extension(std::env::consts::EXE_EXTENSION)
}

/// Runs an example in a temporary folder; returns the folder and standard output.
fn run(name: &str, arguments: &[&Path]) -> (tempfile::TempDir, String) {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(example(name)).args(arguments).current_dir(folder.path()).output().unwrap();
    assert!(output.status.success(), "{name}: {}", String::from_utf8_lossy(&output.stderr));
    (folder, String::from_utf8(output.stdout).unwrap())
}

#[test]
fn a_volume_is_relit_under_three_lights_after_one_march() {
    let (folder, text) = run("relight_a_volume", &[]);
    let pictures = ["D65", "A", "FL11"].map(|name| std::fs::read(folder.path().join(format!("{name}.png"))).unwrap());
    assert!(pictures[0] != pictures[1] && pictures[1] != pictures[2], "one picture for two lights");
    assert_eq!(text.matches("1 marches").count(), 3, "{text}");
}

#[test]
fn voxels_from_memory_are_rendered() {
    let (folder, _) = run("own_voxels_from_memory", &[]);
    assert!(std::fs::metadata(folder.path().join("ball.png")).unwrap().len() > 1000, "an empty picture");
}

#[test]
fn two_metamers_are_designed() {
    let (_, text) = run("design_two_metamers", &[]);
    let luminance = |line: &&str| line.split("Y = ").nth(1).unwrap()[..5].parse::<f64>().unwrap();
    let day: Vec<f64> = text.lines().filter(|line| line.contains("under  day")).map(|line| luminance(&line)).collect();
    assert!(day.len() == 2 && (day[0] - day[1]).abs() < 0.002, "{text}");
}

#[test]
fn dicom_slices_become_an_array_with_its_frame() {
    let slices = tempfile::tempdir().unwrap();
    for (name, z, first) in [("b", 2.0, 12), ("a", 0.0, 0)] {
        let bytes = dicom::file(&dicom::slice(z, first), dicom::EXPLICIT);
        std::fs::write(slices.path().join(name), bytes).unwrap();
    }
    let (_, text) = run("dicom_to_array", &[slices.path()]);
    let volume = relume::volume::open(slices.path(), &Selection::default(), &Quiet).unwrap();
    let [first, second] = [0, volume.voxels.len() - 1].map(|i| volume.voxels.value(i).unwrap());
    assert!(text.starts_with(&format!("{:?} voxels from {first} to {second}", volume.geometry.dims)), "{text}");
    assert!(text.contains(&format!("origin {}", volume.geometry.origin)), "{text}");
}

#[test]
fn a_film_file_is_read() {
    let film = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/0.1.0/session.exr");
    let (_, text) = run("read_accumulators", &[&film]);
    assert!(text.starts_with("64×48 pixels") && text.contains("light organs"), "{text}");
}
