//! Sessions and film files of released versions open and give the same pictures as then.
//!
//! `tests/data/0.1.0` was written by version 0.1.0: a session of `data/figures/fig1.toml` (40×38×24 voxels, dial presets,
//! node switches, an interval, a label, camera, exposure and observer changed in the window), its film and pictures; and a
//! film of `data/scenes/glass_shells.toml` (24×24×24 voxels), whose pixels hold k-vectors.

use crate::support;

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use relume::document::{Source, State, session};
use relume::progress::Quiet;
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

/// A file of version 0.1.0 in a folder of its own.
fn with(name: &str) -> Folder {
    let folder = Folder::new();
    std::fs::copy(released(name), folder.path(name)).unwrap();
    folder
}

#[test]
fn former_names_of_keys_and_flags_work_and_are_told_once() {
    let folder = with("session.toml");
    let told = "dial.situations is now called dial.presets";
    let outcome = folder.done(&["info", "session.toml", "--json"]);
    assert_eq!(outcome.err.matches(told).count(), 1, "{}", outcome.err);
    let json = outcome.json();
    assert_eq!(json["presets"][3], "between");
    assert_eq!(json["presets"], json["situations"]);
    assert_eq!(json["warnings"], serde_json::json!([told]));

    let folder = with("session.exr");
    let relit = |flags: &[&str]| folder.done(&[&["relight", "session.exr", "-o", "now.png"], flags].concat()).err;
    assert_eq!(relit(&["--dial-preset", "between"]), "");
    assert_eq!(largest_difference(&folder.path("now.png"), &released("relit.png")), 0);
    assert_eq!(relit(&["--situation", "between"]), "warning: --situation is now called --dial-preset\n");
    assert_eq!(largest_difference(&folder.path("now.png"), &released("relit.png")), 0);
    assert_eq!(relit(&["--tour", "--frames", "1"]), "warning: --tour is now called --loop\n");
}

#[test]
fn a_session_of_0_1_0_is_saved_with_the_names_of_now() {
    let folder = with("session.toml");
    let source = Source::of(&folder.path("session.toml"));
    let (file, _) = source.read(&Quiet).unwrap();
    let state = State::new(&file);
    let text = session::text(&folder.path("again.toml"), &source, &file, &state).unwrap();
    assert!(text.contains("presets = [{ name = \"1b\"") && !text.contains("situations"), "{text}");
    std::fs::write(
        folder.path("both.toml"),
        text.replace("[dial]\n", "[dial]\nsituations = [{ name = \"x\", hand = [0, 0] }]\n"),
    )
    .unwrap();
    folder.refused(1, &["info", "both.toml"], &["dial.situations is now called dial.presets; keep one"]);
}

/// Devices round the march and the sRGB curve differently, by up to one code.
#[test]
fn a_session_of_0_1_0_renders_as_it_did() {
    // There were no segments yet, and labels between voxels were those of the nearest voxel. Steps cut by a face counted whole or
    // not at all: up to 6 codes.
    let as_then = ["-D", "accuracy.integration=samples", "-D", "accuracy.labels=nearest"];
    gives(&[&["render", "session.toml", "--size", "64x48"][..], &as_then].concat(), "session.png", 6);
}

#[test]
fn a_film_of_weights_of_0_1_0_relights_as_it_did() {
    gives(&["relight", "session.exr", "--dial-preset", "between"], "relit.png", 0);
    gives(&["relight", "session.exr", "--light", "A=0.7"], "bulb.png", 0);
}

#[test]
fn a_film_of_k_vectors_of_0_1_0_relights_as_it_did() {
    gives(&["relight", "glass.exr"], "glass.png", 1);
    // A light that is not in the film shone from every position, with all of its weight.
    gives(&["relight", "glass.exr", "--light", "FL2@lamp", "--light", "FL2@window"], "glass_tube.png", 0);
}

#[test]
fn a_picture_of_another_light_is_not_taken_for_the_same() {
    assert!(largest_difference(&released("relit.png"), &released("bulb.png")) > 32);
}
