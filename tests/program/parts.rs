//! Animations in parts, by several runs of the program.

use std::collections::BTreeMap;
use std::process::Command;

use crate::support::program::Folder;

const TURN: [&str; 6] = ["render", "scene.toml", "--size", "16x12", "--turntable", "5"];

/// All pictures of the folder that begin with `stem`, by name.
fn pictures(folder: &Folder, stem: &str) -> BTreeMap<String, Vec<u8>> {
    let names = folder.names().into_iter().filter(|name| name.starts_with(stem));
    names.map(|name| (name[stem.len()..].to_owned(), std::fs::read(folder.path(&name)).unwrap())).collect()
}

/// Runs the parts of `command`, last first.
fn in_parts(folder: &Folder, command: &[&str], parts: usize) {
    for part in (1..=parts).rev() {
        let part = format!("{part}/{parts}");
        folder.done(&[command, &["--part", &part]].concat());
    }
}

#[test]
fn any_number_of_parts_writes_the_same_files() {
    let folder = Folder::new();
    folder.done(&["render", "scene.toml", "--size", "16x12", "--accumulators", "acc.exr"]);
    let sweep = ["relight", "acc.exr", "--sweep", "day..lamp", "--frames", "5"];
    for (command, stem) in [(&TURN[..], "t"), (&sweep, "s")] {
        let outputs = |name: &str| [format!("{name}.png"), format!("{name}.exr")];
        let run = |parts: Option<usize>, name: &str| {
            let [png, exr] = outputs(name);
            let command = [command, &["-o", &png, "-o", &exr]].concat();
            match parts {
                None => drop(folder.done(&command)),
                Some(parts) => in_parts(&folder, &command, parts),
            }
            pictures(&folder, &format!("{name}-"))
        };
        let whole = run(None, &format!("{stem}whole"));
        assert_eq!(whole.len(), 10);
        for parts in [1, 3, 16] {
            assert!(run(Some(parts), &format!("{stem}{parts}")) == whole, "{stem} in {parts} parts");
        }
    }
}

#[test]
fn a_part_keeps_whole_pictures_of_the_same_inputs_only() {
    let folder = Folder::new();
    for kind in ["png", "exr"] {
        let name = format!("t.{kind}");
        let all = [&TURN[..], &["-o", &name]].concat();
        let resumed = |more: &[&str]| folder.done(&[&all[..], &["--part", "1/1"], more].concat()).out;
        folder.done(&all);
        let whole = pictures(&folder, "t-");
        assert!(resumed(&[]).contains("wrote 0 and kept 5"), "all are there");
        // Gone, cut short, damaged within its pixels, and of another program.
        std::fs::remove_file(folder.path(&format!("t-0001.{kind}"))).unwrap();
        let cut = &whole[&format!("0002.{kind}")];
        std::fs::write(folder.path(&format!("t-0002.{kind}")), &cut[..cut.len() - 20]).unwrap();
        std::fs::write(folder.path(&format!("t-0004.{kind}")), "no picture").unwrap();
        let told = resumed(&[]);
        assert!(told.contains("part 1 of 1: wrote 3 and kept 2 of the pictures"), "{told}");
        assert!(pictures(&folder, "t-") == whole, "the same files");
        // Without a part, everything is made anew.
        assert!(!folder.done(&all).out.contains("kept"));
        for other in [
            &["-D", "display.exposure=2"][..],
            &["--light", "day=0.5"],
            &["--background", "#ffffff"],
            &["-D", "camera.azimuth=3"],
            &["--bits", "16"],
            &["--annotate"],
        ] {
            // EXR files have one form, which these flags do not change.
            if kind == "exr" && ["--background", "--bits", "--annotate"].contains(&other[0]) {
                folder.refused(2, &[&all[..], &["--part", "1/1"], other].concat(), &[other[0], "has no effect"]);
                continue;
            }
            assert!(resumed(other).contains("wrote 5 and kept 0"), "{other:?}");
        }
        for name in whole.keys() {
            std::fs::remove_file(folder.path(&format!("t-{name}"))).unwrap();
        }
    }
    let part = folder.done(&[&TURN[..], &["-o", "u.png", "--part", "2/3"]].concat()).out;
    assert!(part.contains("part 2 of 3: wrote 2 and kept 0 of the pictures u-0002.png to u-0005.png"), "{part}");
    assert!(part.contains("for a film of all parts: ffmpeg"), "{part}");
    assert_eq!(pictures(&folder, "u-").into_keys().collect::<Vec<_>>(), ["0002.png", "0005.png"]);
    let one = [&TURN[..], &["-o", "u.png", "--part", "5/5"]].concat();
    assert!(folder.done(&one).out.contains("wrote 0 and kept 1 of the pictures u-0005.png"), "a part of one picture");
    let none = folder.done(&[&TURN[..], &["-o", "v.png", "--part", "9/9"]].concat()).out;
    assert!(none.contains("nothing to write: there are 5 pictures"), "{none}");
}

#[test]
fn a_film_of_other_pixels_is_relit_anew() {
    let folder = Folder::new();
    let render = ["render", "scene.toml", "--size", "16x12", "--accumulators", "acc.exr"];
    let relight = ["relight", "acc.exr", "--loop", "--frames", "2", "-o", "l.png", "--part", "1/1"];
    folder.done(&render);
    folder.done(&relight);
    assert!(folder.done(&relight).out.contains("wrote 0 and kept 2"));
    folder.done(&[&render[..], &["-D", "camera.azimuth=3"]].concat());
    assert!(folder.done(&relight).out.contains("wrote 2 and kept 0"));
}

#[test]
fn parts_that_cannot_be_are_refused() {
    let folder = Folder::new();
    for part in ["0/3", "4/3", "1", "1/0", "a/b"] {
        folder.refused(2, &[&TURN[..], &["-o", "t.png", "--part", part]].concat(), &["I/N", "3/16"]);
    }
    folder.refused(2, &[&TURN[..], &["-o", "t.apng", "--part", "1/2"]].concat(), &["t.apng", "numbered pictures"]);
    folder.refused(2, &["render", "scene.toml", "-o", "t.png", "--part", "1/2"], &["--part", "--turntable"]);
}

/// The recipe of docs/SCALE.md.
#[test]
fn gnu_parallel_runs_the_parts() {
    let folder = Folder::new();
    folder.done(&[&TURN[..], &["-o", "whole.png"]].concat());
    let command = format!("{} {} -o t.png --part {{}}/3", env!("CARGO_BIN_EXE_relume"), TURN.join(" "));
    let parallel =
        Command::new("parallel").arg(command).args([":::", "1", "2", "3"]).current_dir(folder.path("")).output();
    // scripts/setup --tests installs it.
    let parallel = parallel.unwrap();
    assert!(parallel.status.success(), "{}", String::from_utf8_lossy(&parallel.stderr));
    assert!(pictures(&folder, "t-") == pictures(&folder, "whole-"), "the same files");
}

#[test]
fn pictures_that_a_longer_animation_left_behind_are_named() {
    let folder = Folder::new();
    let all = [&TURN[..], &["-o", "t.png"]].concat();
    let first = folder.done(&[&all[..], &["--part", "2/2", "--json"]].concat());
    assert_eq!(first.json()["pictures"], serde_json::json!({"part": [2, 2], "written": 2, "kept": 0}));
    assert!(!first.err.contains("another animation"), "{}", first.err);
    folder.done(&all);
    let shorter = folder.done(&["render", "scene.toml", "--size", "16x12", "--turntable", "3", "-o", "t.png"]);
    assert!(shorter.err.contains("t-0004.png is of another animation"), "{}", shorter.err);
}
