//! Flags are used or refused: none is ignored without a word.
//!
//! Each flag of each command states where it has an effect. A flag that has one in every run is `Always`. For any other, a run
//! without what it acts on is refused, or says that the flag is not used. So two flags are both used, or one of them is told of,
//! unless they state the same thing: those pairs are in [`COMPETING`], and each is refused.

use std::collections::BTreeSet;

use crate::support::program::Folder;

/// Where a flag has an effect.
enum Use {
    /// In every run.
    Always,
    /// Not in this run, which ends with this code and says this.
    Not(&'static [&'static str], i32, &'static str),
}

use Use::{Always, Not};

/// Flags of every command.
const GLOBAL: [(&str, Use); 3] = [("--json", Always), ("--quiet", Always), ("--help", Always)];

/// Flags that choose one of several volumes, of the commands that read a volume.
const SELECTION: [(&str, Use); 7] = [
    ("--component", Not(&["info", "ball.nrrd", "--component", "1"], 1, "--component 1")),
    ("--time", Not(&["info", "ball.nrrd", "--time", "1"], 1, "--time 1")),
    ("--array", Not(&["info", "ball.nrrd", "--array", "a"], 1, "--array a")),
    ("--series", Not(&["info", "ball.nrrd", "--series", "1"], 1, "--series 1")),
    ("--pyramid-level", Not(&["info", "ball.nrrd", "--pyramid-level", "1"], 1, "--pyramid-level 1")),
    ("--axes", Not(&["info", "ball.nrrd", "--axes", "zyx"], 1, "--axes zyx")),
    // States what to do with a volume that is sheared.
    ("--resample", Always),
];

/// Flags for headerless volumes.
const RAW: [(&str, Use); 5] = [
    ("--dims", Not(&["info", "ball.nrrd", "--dims", "9x9x9", "--type", "uint8"], 1, "omit --dims")),
    ("--type", Not(&["info", "ball.nrrd", "--type", "uint8"], 2, "--dims")),
    ("--big-endian", Not(&["info", "ball.nrrd", "--big-endian"], 2, "--dims")),
    ("--header-bytes", Not(&["info", "ball.nrrd", "--header-bytes", "3"], 2, "--dims")),
    ("--spacing", Always),
];

/// Flags of a scene and its colour accuracy.
const SCENE: [(&str, Use); 16] = [
    ("--quality", Not(&["slice", "ball.nrrd", "--quality", "best", "-o", "p.png"], 2, "--quality has no effect")),
    ("--mask", Not(&["slice", "ball.nrrd", "--mask", "pet=ct:3", "-o", "p.png"], 2, "--mask has no effect")),
    ("--crop", Not(&["slice", "ball.nrrd", "--crop", "0:1,0:1,0:1", "-o", "p.png"], 2, "--crop has no effect")),
    ("--range", Not(&["slice", "ball.nrrd", "--range", "1:9", "-o", "p.png"], 2, "--range has no effect")),
    ("--hide", Not(&["slice", "ball.nrrd", "--hide", "pet", "-o", "p.png"], 2, "--hide has no effect")),
    ("--clip", Not(&["slice", "ball.nrrd", "--clip", "z:50%", "-o", "p.png"], 2, "--clip has no effect")),
    ("--channels", Not(&["slice", "ball.nrrd", "--channels", "GFP", "-o", "p.png"], 1, "channels GFP")),
    ("--volume", Always),
    ("--labels", Not(&["render", "scene.toml", "--labels", "ball.nrrd", "-o", "p.png", "--size", "8x8"], 1, "labels")),
    ("--label-names", Always),
    ("--downsample", Always),
    ("--define", Always),
    ("--tolerance", Not(&["info", "ball.nrrd", "--tolerance", "1"], 2, "--tolerance has no effect")),
    ("--k", Not(&["render", "--reference", "--k", "5", "-o", "p.png"], 2, "--k has no effect")),
    ("--model", Not(&["render", "--reference", "--model", "rgb", "-o", "p.png"], 2, "--model has no effect")),
    (
        "--accumulate",
        Not(&["render", "--reference", "--accumulate", "weights", "-o", "p.png"], 2, "--accumulate has no effect"),
    ),
];

const LOOK: [(&str, Use); 3] = [
    ("--look", Not(&["render", "scene.toml", "--look", "bone", "-o", "p.png"], 2, "--look")),
    ("--window", Not(&["render", "scene.toml", "--window", "9", "--level", "3", "-o", "p.png"], 2, "--window")),
    ("--level", Not(&["render", "ball.nrrd", "--level", "3", "-o", "p.png"], 2, "--window")),
];

const DRESS: [(&str, Use); 4] = [
    ("--bits", Not(&["render", "--bits", "16", "-o", "p.exr"], 2, "--bits has no effect")),
    (
        "--background",
        Not(&["render", "--background", "#ffffff", "--accumulators", "f.exr"], 2, "--background has no effect"),
    ),
    ("--annotate", Not(&["render", "--annotate", "--spectral", "s.exr"], 2, "--annotate has no effect")),
    ("--title", Not(&["render", "--annotate", "scale", "--title", "t", "-o", "p.png"], 2, "--title")),
];

const ANIMATION: [(&str, Use); 2] = [
    ("--fps", Not(&["render", "--turntable", "3", "--fps", "9", "-o", "p.exr"], 2, "--fps has no effect")),
    ("--part", Not(&["render", "--part", "1/2", "-o", "p.png"], 2, "--part")),
];

const GOAL: [(&str, Use); 3] = [("--max-error", Always), ("--budget", Always), ("--preset", Always)];

const RENDER: [(&str, Use); 13] = [
    ("--output", Always),
    ("--turntable", Not(&["render", "--turntable", "3", "--save-scene", "s.toml"], 2, "-o FILE.png")),
    ("--light", Not(&["render", "--light", "A", "--save-scene", "s.toml"], 2, "--light has no effect")),
    ("--replan", Not(&["render", "--replan", "-o", "p.png"], 2, "--replan has no effect")),
    ("--size", Always),
    ("--device", Always),
    ("--device-memory", Always),
    ("--memory", Always),
    ("--reference", Always),
    ("--accumulators", Always),
    ("--block", Not(&["render", "--block", "1/2", "-o", "p.png"], 2, "--accumulators")),
    ("--spectral", Always),
    ("--save-scene", Always),
];

const RELIGHT: [(&str, Use); 13] = [
    ("--light", Always),
    ("--dial", Always),
    ("--dial-preset", Always),
    ("--sweep", Always),
    ("--loop", Always),
    ("--frames", Not(&["relight", "film.exr", "--frames", "3", "-o", "p.png"], 2, "--sweep")),
    ("--steps", Not(&["relight", "film.exr", "--steps", "hand", "-o", "p.png"], 2, "--sweep")),
    ("--nodes-off", Not(&["relight", "film.exr", "--nodes-off", "day", "-o", "p.png"], 2, "--nodes-off needs")),
    ("--observer", Always),
    ("--tolerance", Not(&["relight", "film.exr", "--tolerance", "1", "-o", "p.png"], 2, "--tolerance has no effect")),
    ("--output", Always),
    ("--exposure", Always),
    ("--tone", Always),
];

const PAGE: [(&str, Use); 9] = [
    ("--light", Always),
    ("--output", Always),
    ("--title", Always),
    ("--max-bytes", Always),
    ("--views", Not(&["page", "film.exr", "--views", "3", "-o", "p.html"], 2, "--views")),
    ("--live", Not(&["page", "film.exr", "--live", "-o", "p.html"], 2, "--live")),
    ("--elevations", Not(&["page", "--elevations", "3", "-o", "p.html"], 2, "--views")),
    ("--size", Not(&["page", "film.exr", "--size", "9x9", "-o", "p.html"], 2, "--size")),
    ("--device", Not(&["page", "film.exr", "--device", "0", "-o", "p.html"], 2, "--device")),
];

const SLICE: [(&str, Use); 7] = [
    ("--axis", Always),
    ("--at", Always),
    ("--window", Always),
    ("--level", Not(&["slice", "ball.nrrd", "--level", "3", "-o", "p.png"], 2, "--window")),
    ("--over", Not(&["slice", "scene.toml", "--over", "labels", "-o", "p.png"], 2, "--over labels")),
    ("--size", Always),
    ("--output", Always),
];

const MEASURE: [(&str, Use); 8] = [
    ("--sweep", Always),
    ("--size", Always),
    ("--pixels", Always),
    ("--runs", Always),
    ("--device", Always),
    ("--csv", Always),
    ("--markdown", Always),
    ("--extremes", Not(&["measure", "--extremes", "scene.toml"], 2, "--extremes")),
];

const BENCH: [(&str, Use); 10] = [
    ("--volume", Not(&["bench", "default", "--volume", "ball.nrrd"], 2, "--volume has no effect")),
    ("--size", Not(&["bench", "load", "--size", "9x9"], 2, "--size has no effect")),
    ("--largest", Not(&["bench", "default", "--largest", "64"], 2, "--largest has no effect")),
    ("--frames", Always),
    ("--define", Not(&["bench", "load", "-D", "accuracy.k=3"], 2, "-D has no effect")),
    ("--shading", Not(&["bench", "load", "--shading", "none"], 2, "--shading has no effect")),
    ("--device", Not(&["bench", "load", "--device", "0"], 2, "--device has no effect")),
    ("--against", Not(&["bench", "load", "--against", "b.json"], 2, "--against has no effect")),
    ("--budget-percent", Not(&["bench", "--budget-percent", "3"], 2, "--against")),
    ("--output", Not(&["bench", "load", "-o", "p.html"], 2, "--output has no effect")),
];

/// Flags of a command that are used or refused as those of another one; runs of these are not repeated.
const SAME_AS_OTHERS: [(&str, &[&str]); 5] = [
    ("view", &["--size", "--device", "--device-memory", "--memory", "--frames", "--script"]),
    ("composite", &["--partial", "--output"]),
    ("design", &["--output", "--save-scene", "--start", "--report", "--smoothness", "--compare-smoothness"]),
    ("figures", &["--output", "--volume-frog", "--labels", "--volume-engine", "--size", "--define", "--device"]),
    ("shaders", &["--write", "--check", "--folder"]),
];

/// Pairs of arguments that state the same thing: each is refused, with these words.
const COMPETING: &[(&[&str], &str)] = &[
    (&["render", "ball.nrrd", "--volume", "none.nrrd", "-o", "p.png"], "to show them together"),
    (&["render", "ball.nrrd", "--volume", "ball.nrrd"], "to show them together"),
    (&["view", "ball.nrrd", "--volume", "none.nrrd", "--frames", "1"], "to show them together"),
    (&["page", "ball.nrrd", "--volume", "none.nrrd", "-o", "p.html"], "to show them together"),
    (&["info", "ball.nrrd", "--volume", "none.nrrd"], "to show them together"),
    (&["measure", "ball.nrrd", "--volume", "none.nrrd"], "to show them together"),
    (&["slice", "ball.nrrd", "--volume", "none.nrrd", "-o", "p.png"], "to show them together"),
    (&["page", "film.exr", "--volume", "ball.nrrd", "-o", "p.html"], "--volume"),
    (&["render", "ball.nrrd", "-D", "volume.file=none.nrrd", "-o", "p.png"], "-D volume.file=none.nrrd has no effect"),
    (
        &["render", "scene.toml", "--volume", "ball.nrrd", "-D", "volume.component=1", "-o", "p.png"],
        "-D volume.component=1",
    ),
    (&["render", "--spacing", "1x1x2", "-D", "volume.spacing=[1,1,3]", "-o", "p.png"], "-D volume.spacing=[1,1,3]"),
    (&["render", "--downsample", "2x2x2", "-D", "volume.downsample=[3,3,3]", "-o", "p.png"], "-D volume.downsample"),
    (&["render", "--k", "4", "-D", "accuracy.k=5", "-o", "p.png"], "-D accuracy.k=5 has no effect beside --k"),
    (&["render", "--model", "rgb", "-D", "accuracy.model=nodes", "-o", "p.png"], "-D accuracy.model=nodes"),
    (&["render", "--k", "4", "--tolerance", "1", "-o", "p.png"], "--tolerance"),
    (&["render", "--k", "4", "--max-error", "1", "-o", "p.png"], "--k has no effect"),
    (&["render", "--max-error", "1", "--budget", "9", "-o", "p.png"], "--budget"),
    (&["render", "--preset", "balanced", "--budget", "9", "-o", "p.png"], "--budget"),
    (&["render", "--reference", "--device", "0", "-o", "p.png"], "--device"),
    (&["render", "--reference", "--device-memory", "9MiB", "-o", "p.png"], "--device-memory"),
    (&["render", "--reference", "--max-error", "1", "-o", "p.png"], "--max-error"),
    (&["render", "ball.nrrd", "--look", "bone", "--window", "9", "--level", "4"], "--look"),
    (&["render", "--turntable", "3", "--accumulators", "f.exr", "-o", "p.png"], "--accumulators"),
    (&["render", "--turntable", "3", "--spectral", "f.exr", "-o", "p.png"], "--spectral"),
    (&["render", "--turntable", "3", "--reference", "-o", "p.png"], "--reference"),
    (&["render", "--turntable", "3", "--budget", "9", "-o", "p.png"], "--budget"),
    (&["render", "--block", "1/2", "--accumulators", "f.exr", "-o", "p.png"], "--output"),
    (&["render", "--block", "1/2", "--accumulators", "f.exr", "--bits", "16"], "--bits has no effect"),
    (&["relight", "film.exr", "--light", "A", "--dial", "0,0", "-o", "p.png"], "--dial"),
    (&["relight", "film.exr", "--light", "A", "--nodes-off", "day", "-o", "p.png"], "--nodes-off"),
    (&["relight", "film.exr", "--dial", "0,0", "--loop", "-o", "p.png"], "--dial"),
    (&["relight", "film.exr", "--dial-preset", "evening", "--dial", "0,0", "-o", "p.png"], "--dial"),
    (&["relight", "film.exr", "--sweep", "day..lamp", "--loop", "-o", "p.png"], "--loop"),
    (&["relight", "film.exr", "--annotate", "--bits", "16", "-o", "p.exr"], "--bits has no effect"),
    (&["page", "film.exr", "--component", "1", "-o", "p.html"], "--component"),
    (&["info", "film.exr", "--component", "1"], "--component has no effect"),
    (&["info", "ball.nrrd", "--k", "4"], "--k has no effect"),
    (&["info", "--volume", "ball.nrrd", "-D", "accuracy.k=4"], "-D has no effect"),
    (&["info", "--volume", "ball.nrrd", "--labels", "ball.nrrd"], "--labels has no effect"),
    (&["info", "--resample"], "--resample has no effect"),
    (&["slice", "ball.nrrd", "--k", "4", "-o", "p.png"], "--k has no effect"),
    (&["slice", "ball.nrrd", "-D", "display.exposure=2", "-o", "p.png"], "-D display.exposure=2 has no effect"),
    (&["slice", "ball.nrrd", "--annotate", "-o", "p.exr"], "--annotate has no effect"),
    (&["measure", "--csv", "--markdown"], "--markdown"),
    (&["measure", "--csv", "--json"], "--json"),
    (&["measure", "--extremes", "--runs", "3"], "--runs"),
    (&["bench", "load", "--time", "3"], "--time has no effect"),
    (&["bricks", "ball.nrrd", "--spacing", "1x1x2", "-o", "b.bricks"], "--spacing has no effect"),
    (&["view", "--frames", "3", "--script", "s.txt"], "--script"),
    (&["shaders", "--write", "--check"], "--check"),
];

/// Flags in the help of a command.
fn flags_of(folder: &Folder, command: &str) -> BTreeSet<String> {
    let help = folder.done(&[command, "--help"]).out;
    // Descriptions, which may mention flags, are indented further.
    let lines =
        help.lines().take_while(|line| *line != "Examples:").filter(|line| line.len() - line.trim_start().len() < 8);
    let flags = lines.filter_map(|line| {
        let line = line.trim_start();
        let behind_short = || line.split_once(", --").filter(|(short, _)| short.len() == 2).map(|(_, long)| long);
        let long = line.strip_prefix("--").or_else(behind_short)?;
        let name: String = long.chars().take_while(|letter| letter.is_ascii_lowercase() || *letter == '-').collect();
        Some(format!("--{name}"))
    });
    flags.collect()
}

/// 9×9×9 voxels of 8 bits: 200 within 3 voxels of the middle.
fn ball() -> Vec<u8> {
    let voxel = |i: usize| {
        let far = [i % 9, i / 9 % 9, i / 81].map(|at| at.abs_diff(4).pow(2)).iter().sum::<usize>();
        if far <= 9 { 200 } else { u8::try_from(far).unwrap() }
    };
    let header = "NRRD0005\ntype: uint8\ndimension: 3\nsizes: 9 9 9\nencoding: raw\n\n";
    [header.as_bytes(), &(0..729).map(voxel).collect::<Vec<u8>>()].concat()
}

/// Flags, and what each one does.
type Flags<'a> = &'a [(&'static str, Use)];

#[test]
fn every_flag_is_used_or_refused() {
    let folder = Folder::new().with("ball.nrrd", ball());
    folder.done(&["render", "scene.toml", "--size", "8x8", "--accumulators", "film.exr"]);
    let commands: [(&str, Vec<Flags<'_>>); 9] = [
        ("render", vec![&SCENE, &SELECTION, &RAW, &LOOK, &RENDER, &ANIMATION, &DRESS, &GOAL, &[("--mpi", Always)]]),
        ("relight", vec![&RELIGHT, &ANIMATION, &DRESS]),
        ("page", vec![&SCENE, &SELECTION, &RAW, &LOOK, &PAGE]),
        ("slice", vec![&SCENE, &SELECTION, &RAW, &SLICE, &DRESS[2..]]),
        (
            "info",
            vec![
                &SCENE,
                &SELECTION,
                &RAW,
                &[("--voxel", Not(&["info", "--voxel", "0,0,0"], 2, "--voxel has no effect"))],
            ],
        ),
        ("measure", vec![&SCENE, &SELECTION, &RAW, &MEASURE, &GOAL, &[("--output", Always)]]),
        ("bench", vec![&SELECTION, &SCENE[11..], &BENCH]),
        ("convert", vec![&SELECTION, &RAW, &[("--downsample", Always)]]),
        ("bricks", vec![&SELECTION, &RAW, &[("--memory", Always), ("--output", Always)]]),
    ];
    let mut told: BTreeSet<&[&str]> = BTreeSet::new();
    let mut told_of = |arguments: &'static [&'static str], code: i32, word: &str| {
        if told.insert(arguments) {
            let outcome = folder.run(arguments);
            assert_eq!(outcome.code, Some(code), "{arguments:?}: {}", outcome.err);
            assert!(outcome.err.contains(word), "{arguments:?} does not say {word:?}: {}", outcome.err);
        }
    };
    for (command, lists) in &commands {
        let listed: BTreeSet<String> =
            lists.iter().copied().chain([&GLOBAL[..]]).flatten().map(|(flag, _)| (*flag).to_owned()).collect();
        assert_eq!(flags_of(&folder, command), listed, "flags of {command}: state where a new one has an effect");
        for (_, used) in lists.iter().copied().flatten() {
            if let Not(arguments, code, word) = used {
                told_of(arguments, *code, word);
            }
        }
    }
    for (command, others) in SAME_AS_OTHERS {
        let of_scene = if command == "view" { vec![&SCENE[..], &SELECTION, &RAW, &LOOK] } else { Vec::new() };
        let listed =
            of_scene.into_iter().chain([&GLOBAL[..]]).flatten().map(|(flag, _)| *flag).chain(others.iter().copied());
        assert_eq!(flags_of(&folder, command), listed.map(str::to_owned).collect(), "flags of {command}");
    }
    for (arguments, word) in COMPETING {
        told_of(arguments, 2, word);
    }
    assert_eq!(folder.names(), ["ball.nrrd", "film.exr", "scene.toml"], "a refused command leaves nothing behind");
}

#[test]
fn a_list_of_annotations_is_no_file_and_a_file_no_list() {
    let folder = Folder::new();
    let picture = |name: &str, annotate: &[&str]| {
        folder.done(&[annotate, &["scene.toml", "--size", "96x96", "-o", name]].concat());
        std::fs::read(folder.path(name)).unwrap()
    };
    // The file behind the flag is the scene, as before there were lists.
    let all = picture("all.png", &["render", "--annotate"]);
    let three = picture("three.png", &["render", "--annotate", "scale,letters,legend"]);
    let legend = picture("legend.png", &["render", "--annotate=legend"]);
    let scale = picture("scale.png", &["render", "--annotate", "scale"]);
    let none = picture("none.png", &["render"]);
    assert!(all == three, "without a title, all are these three");
    assert!(legend != all && scale != all && legend != scale && ![&all, &legend, &scale].contains(&&none));
    folder.refused(2, &["render", "--annotate=scales", "-o", "p.png"], &["scales", "scale, letters, legend, title"]);
    folder.refused(2, &["render", "--annotate", "scale,title", "-o", "p.png"], &["lists title", "--title TEXT"]);
}
