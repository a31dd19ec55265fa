//! Blocks of a volume in films of their own, and their composite.

use std::process::Command;

use relume::output::FilmFile;
use relume::output::film::composite;
use relume::progress::Quiet;

use crate::support::program::Folder;

/// Saves the parts of `leaves` blocks as `p1.exr`, `p2.exr` …
fn in_blocks(folder: &Folder, leaves: usize) {
    for number in 1..=leaves {
        folder.done(&part(&format!("{number}/{leaves}"), &format!("p{number}.exr"), &[]));
    }
}

/// Command that saves block `block` as `name`.
fn part<'a>(block: &'a str, name: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let usual = ["render", "scene.toml", "--size", "16x12", "--block", block, "--accumulators", name];
    [&usual[..], more].concat()
}

#[test]
fn parts_composite_to_one_film_in_any_order_and_grouping() {
    let folder = Folder::new();
    in_blocks(&folder, 4);
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    let out = folder.done(&["composite", "p1.exr", "p2.exr", "p3.exr", "p4.exr", "-o", "film.exr", "--json"]).json();
    assert_eq!(out["whole"], true);
    assert_eq!(out["blocks"], serde_json::json!({"first": 1, "last": 4, "count": 4}));
    folder.done(&["composite", "p3.exr", "p1.exr", "p4.exr", "p2.exr", "-o", "other.exr"]);
    let half = folder.done(&["composite", "p4.exr", "p3.exr", "--partial", "-o", "half.exr"]);
    assert!(half.err.contains("half.exr is a part: blocks 3 to 4 of 4"), "{}", half.err);
    folder.done(&["composite", "p2.exr", "half.exr", "p1.exr", "-o", "grouped.exr"]);
    for name in ["other.exr", "grouped.exr"] {
        assert!(bytes("film.exr") == bytes(name), "{name}");
    }
    folder.done(&["render", "scene.toml", "--size", "16x12", "--accumulators", "march.exr"]);
    let [film, march] = ["film.exr", "march.exr"].map(|name| FilmFile::read(&folder.path(name)).unwrap());
    assert_eq!(film.part, None);
    let pairs = film.accumulators.iter().zip(&march.accumulators);
    let pairs = pairs.chain(film.transmittance.iter().zip(&march.transmittance));
    let worst = pairs.map(|(one, other)| (one - other).abs()).fold(0.0, f32::max);
    // Termination at 1e-4 is the largest difference.
    assert!(worst <= 2e-4, "{worst}");
    folder.done(&["relight", "film.exr", "--light", "A", "-o", "film.png"]);
    let info = folder.done(&["info", "half.exr", "--json"]).json();
    assert_eq!(info["part"], serde_json::json!({"first": 3, "last": 4, "count": 4}));
    let alone = folder.done(&["relight", "p2.exr", "-o", "part.png"]);
    assert!(alone.err.contains("p2.exr is a part of a film: block 2 of 4"), "{}", alone.err);
}

#[test]
fn parts_that_do_not_composite_are_refused_with_a_sentence() {
    let folder = Folder::new();
    in_blocks(&folder, 4);
    let refused = |parts: &[&str], words: &[&str]| {
        folder.refused(1, &[&["composite"], parts, &["-o", "film.exr"]].concat(), words);
    };
    refused(&["p1.exr", "p2.exr", "p4.exr"], &["block 3 of 4 is missing", "--block 3/4"]);
    refused(&["p2.exr", "p3.exr"], &["blocks 1, 4 of 4 are missing"]);
    refused(&["p2.exr", "p3.exr", "--partial"], &["blocks 1, 4 of 4 are missing", "--block 1/4"]);
    // All blocks below a cut are no whole film either, unless that is what was asked for.
    refused(&["p3.exr", "p4.exr"], &["p3.exr: blocks 1 to 2 of 4 are missing", "--partial"]);
    std::fs::copy(folder.path("p2.exr"), folder.path("copy.exr")).unwrap();
    refused(&["p1.exr", "p2.exr", "copy.exr"], &["block 2 of 4 is also in"]);
    let scene = std::fs::read_to_string(folder.path("scene.toml")).unwrap();
    folder.done(&["render", "scene.toml", "--size", "16x12", "--accumulators", "whole.exr"]);
    refused(&["p1.exr", "whole.exr"], &["whole.exr: this film is whole, not a part"]);
    folder.done(&part("2/2", "two.exr", &[]));
    refused(&["p1.exr", "two.exr"], &["a part of 2 blocks", "one of 4"]);
    folder.done(&part("2/4", "moved.exr", &["-D", "camera.azimuth=77"]));
    refused(&["p1.exr", "moved.exr"], &["the camera differs"]);
    folder.done(&part("2/4", "thin.exr", &["-D", "accuracy.step=0.3"]));
    refused(&["p1.exr", "thin.exr"], &["thin.exr: scene", "differs from"]);
    let sized = ["render", "scene.toml", "--size", "15x12", "--block", "2/4", "--accumulators", "small.exr"];
    folder.done(&sized);
    refused(&["p1.exr", "small.exr"], &["15×12 pixels", "16×12"]);
    let mut other = FilmFile::read(&folder.path("p2.exr")).unwrap();
    other.part.as_mut().unwrap().program = "0.0.9".to_owned();
    other.write(&folder.path("old.exr")).unwrap();
    refused(&["p1.exr", "old.exr"], &["version 0.0.9 of Relume made this part"]);
    let bytes = std::fs::read(folder.path("p2.exr")).unwrap();
    std::fs::write(folder.path("cut.exr"), &bytes[..bytes.len() - 9]).unwrap();
    refused(&["p1.exr", "cut.exr"], &["cut.exr"]);
    folder.refused(1, &["composite", "p1.exr", "p2.exr", "p3.exr", "p4.exr", "-o", "none/film.exr"], &["none"]);
    folder.refused(2, &["composite", "p1.exr", "-o", "film.png"], &[".exr"]);
    let paths = ["p1.exr", "p2.exr", "p3.exr", "p4.exr"].map(|name| folder.path(name));
    let error = composite(&paths, false, Some(1000), &Quiet).unwrap_err();
    assert!(error.to_string().contains("bytes of memory, and 1000 are free"), "{error}");
    // Scenes and flags that blocks refuse.
    folder.refused(1, &part("1/2", "n.exr", &["-D", "accuracy.rays=4"]), &["4 rays a pixel", "accuracy.rays=1"]);
    folder.refused(1, &part("1/4096000", "n.exr", &[]), &["no 4096000 blocks", "4096"]);
    folder.refused(2, &part("3/2", "n.exr", &[]), &["write I/N"]);
    folder.refused(2, &part("1/2", "n.exr", &["-o", "n.png"]), &["--output"]);
    folder.refused(2, &["render", "scene.toml", "--block", "1/2"], &["--accumulators"]);
    let head = format!("{scene}[lights.head]\nspectrum = \"A\"\nkind = \"headlight\"\nshadows = true\n");
    std::fs::write(folder.path("scene.toml"), head).unwrap();
    folder.refused(1, &part("1/2", "n.exr", &[]), &["the headlight casts shadows"]);
}

#[test]
fn gnu_parallel_renders_the_blocks_of_the_recipe() {
    let folder = Folder::new();
    let program = env!("CARGO_BIN_EXE_relume");
    let command = format!("{program} render scene.toml --size 16x12 --block {{}}/4 --accumulators part-{{}}.exr");
    let parallel =
        Command::new("parallel").arg(command).args([":::", "1", "2", "3", "4"]).current_dir(folder.path("")).output();
    let parallel = parallel.unwrap();
    assert!(parallel.status.success(), "{}", String::from_utf8_lossy(&parallel.stderr));
    folder.done(&["composite", "part-1.exr", "part-2.exr", "part-3.exr", "part-4.exr", "-o", "film.exr"]);
}
