//! Volumes in bricks on the command line.

use std::path::Path;

use crate::support::program::Folder;

/// A long volume of 8-bit values, with a sidecar: 5000×14×15 voxels.
fn long(folder: Folder) -> Folder {
    let voxels: Vec<u8> = (0..5000 * 14 * 15_usize).map(|i| u8::try_from(i % 5000 / 10 % 251).unwrap()).collect();
    folder.with("long.raw", voxels)
}

const ARGUMENTS: [&str; 8] = ["render", "--volume", "long.raw", "--dims", "5000x14x15", "--type", "uint8", "--json"];

/// Lavapipe has textures of at most 4096 texels along an axis.
#[test]
fn a_long_volume_is_rendered_in_bricks_and_the_report_counts_them() {
    let folder = long(Folder::new());
    // Large enough for rays that meet it.
    let more = ["--size", "640x480", "--device-memory", "12MiB", "-o", "long.png"];
    let out = folder.done(&[&ARGUMENTS[..], &more].concat());
    let json = out.json();
    let bricks = &json["march"]["bricks"];
    if bricks.is_null() {
        // A device with longer textures holds it whole.
        assert!(json["march"]["volume_bytes"].as_u64().unwrap() <= 12 << 20);
        return;
    }
    assert!(bricks["loaded"].as_u64().unwrap() > 0 && bricks["again"] == 0, "{bricks}");
    assert!(json["march"]["volume_bytes"].as_u64().unwrap() <= 12 << 20, "{json}");
    assert!(Path::new(&folder.path("long.png")).exists());
}

#[test]
fn the_picture_is_the_same_however_little_memory_the_device_has() {
    let folder = long(Folder::new());
    let picture = |memory: &str, name: &str, size: &str| {
        let common = ["render", "--volume", "long.raw", "--dims", size, "--type", "uint8", "--size", "40x30"];
        let exact = ["-D", "accuracy.interpolation=\"exact_linear\"", "--device-memory", memory, "-o", name, "--json"];
        let json = folder.done(&[&common[..], &exact].concat()).json();
        (std::fs::read(folder.path(name)).unwrap(), json["march"]["bricks"].clone())
    };
    let (whole, none) = picture("1GiB", "whole.png", "250x210x20");
    assert!(none.is_null(), "{none}");
    let (bricked, counts) = picture("5000KiB", "bricked.png", "250x210x20");
    assert!(counts["rounds"].as_u64().unwrap() > 1, "{counts}");
    assert!(whole == bricked, "{counts}");
}

#[test]
fn memory_that_is_no_size_or_too_small_is_refused() {
    let folder = long(Folder::new());
    let with = |memory: &'static str| [&ARGUMENTS[..], &["--device-memory", memory, "-o", "long.png"]].concat();
    for wrong in ["much", "0", "1.5GiB", "GiB", "99999999999TiB"] {
        folder.refused(2, &with(wrong), &["--device-memory", "such as 512MiB"]);
    }
    let scene = ["render", "scene.toml", "--size", "8x8", "--device-memory", "100KiB", "-o", "p.png"];
    folder.refused(1, &scene, &["a brick of the volume needs", "102 kB", "--device-memory", "--downsample"]);
}
