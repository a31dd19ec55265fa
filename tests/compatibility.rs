//! Sessions and film files of released versions open and give the same pictures as then.
//!
//! `tests/data/0.1.0` was written by version 0.1.0: a session of `data/figures/fig1.toml` (40×38×24 voxels, dial presets,
//! node switches, an interval, a label, camera, exposure and observer changed in the window), its film and pictures; and a
//! film of `data/scenes/glass_shells.toml` (24×24×24 voxels), whose pixels hold k-vectors.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use support::program::Folder;

fn released(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/0.1.0").join(name)
}

/// Width, height and 8-bit samples of a PNG.
fn pixels(path: &Path) -> (u32, u32, Vec<u8>) {
    let mut reader = png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    (info.width, info.height, bytes)
}

/// Largest difference of two pictures of the same size, in codes.
fn largest_difference(one: &Path, other: &Path) -> u8 {
    let (one, other) = (pixels(one), pixels(other));
    assert_eq!((one.0, one.1, one.2.len()), (other.0, other.1, other.2.len()), "size");
    assert!(one.2.iter().any(|&code| code > 32), "a black picture proves nothing");
    one.2.iter().zip(&other.2).map(|(&a, &b)| a.abs_diff(b)).max().unwrap()
}

/// Runs the program on a file of version 0.1.0 and asserts that its picture equals that version's within `codes`.
fn gives(arguments: &[&str], picture: &str, codes: u8) {
    let folder = Folder::new();
    let files = ["session.toml", "session.exr", "glass.exr"];
    for name in files {
        std::fs::copy(released(name), folder.path(name)).unwrap();
    }
    folder.done(&[arguments, &["-o", "now.png"]].concat());
    let difference = largest_difference(&folder.path("now.png"), &released(picture));
    assert!(difference <= codes, "{arguments:?}: {difference} codes off {picture}");
}

/// Devices round the march and the sRGB curve differently, by up to one code.
#[test]
fn a_session_of_0_1_0_renders_as_it_did() {
    gives(&["render", "session.toml", "--size", "64x48"], "session.png", 1);
}

#[test]
fn a_film_of_weights_of_0_1_0_relights_as_it_did() {
    gives(&["relight", "session.exr", "--situation", "between"], "relit.png", 0);
    gives(&["relight", "session.exr", "--light", "A=0.7"], "bulb.png", 0);
}

#[test]
fn a_film_of_k_vectors_of_0_1_0_relights_as_it_did() {
    gives(&["relight", "glass.exr"], "glass.png", 1);
    gives(&["relight", "glass.exr", "--light", "FL2"], "glass_tube.png", 0);
}

#[test]
fn a_picture_of_another_light_is_not_taken_for_the_same() {
    assert!(largest_difference(&released("relit.png"), &released("bulb.png")) > 32);
}
