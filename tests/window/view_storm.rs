//! Under random input and display failures, the window survives or ends with an error message.
#![cfg(all(feature = "window", unix))]
#![expect(clippy::unwrap_used, clippy::print_stdout, reason = "a test fails by panicking, and says what was measured")]

use crate::support;

use std::fmt::Write as _;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use relume::model::random::Random;
use serde_json::Value;
use support::program::{Folder, Outcome, SCENE, labelled};
use support::screen::{Screen, report};

/// Folder of scenes with the same names, a bare volume, and files that cannot be opened.
fn folder() -> Folder {
    let more = labelled();
    let absorbing =
        "reflectance = \"white 9.5\"\nabsorption = { gaussian = [{ centre = 620, sigma = 40, height = 1 }] }";
    let stained = more.replace("reflectance = \"white 9.5\"", absorbing);
    let stained = stained.replace("opacity = 0.9 }", "opacity = 0.2, absorption = 0.4 }");
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n";
    let ball: Vec<u8> = header.bytes().chain((0..512_u16).map(|index| (index % 251) as u8)).collect();
    Folder::new()
        .with("scene.toml", &more)
        .with("stained.toml", stained)
        .with("parallel.toml", format!("{more}[camera]\nprojection = \"orthographic\"\n"))
        .with("short.nrrd", &ball[..200])
        .with("ball.nrrd", ball)
        .with("broken.toml", more.replace("D65", "D99"))
}

/// Number of inputs between two memory measurements.
const MARK: usize = 1000;

/// Generates random script lines.
struct Storm {
    random: Random,
    /// Whether the open scene has the names of [`SCENE`].
    named: bool,
}

impl Storm {
    /// Returns a script of `inputs` lines that saves `early.toml` after a fifth of them and `late.toml` at the end.
    /// Before each
    /// save it reopens the same scene and lets it settle after the largest picture of the storm, because memory that a
    /// software
    /// device has used stays with the process for reuse.
    fn script(seed: u64, inputs: usize) -> String {
        let mut storm = Self { random: Random::new(seed), named: true };
        let mut script = "settle\n".to_owned();
        let rest = |name: &str| {
            let largest =
                "release\npanels off\nslices on\nsize 1400 900\nopen stained.toml\nsettle\nslices off\nsettle\n";
            format!("{largest}panels on\nsize 640 480\nopen scene.toml\nsettle\nsave session {name}\nframes 30\n")
        };
        for input in 0..inputs {
            if input > 0 && input % MARK == 0 {
                writeln!(script, "save session mark-{input}.toml").unwrap();
            }
            if input == inputs / 5 {
                storm.named = true;
                script += &rest("early.toml");
            }
            let line = storm.line();
            writeln!(script, "{line}").unwrap();
        }
        script + &rest("late.toml")
    }

    fn one_of<'a>(&mut self, all: &[&'a str]) -> &'a str {
        all[self.random.index(all.len())]
    }

    /// A plausible number, sometimes an unusual one.
    fn number(&mut self, low: f64, high: f64) -> f64 {
        match self.random.index(40) {
            0 => f64::NAN,
            1 => f64::INFINITY,
            2 => -1e300,
            3 => 0.0,
            4 => 1e-300,
            _ => self.random.between(low, high),
        }
    }

    fn line(&mut self) -> String {
        match self.random.index(100) {
            0..30 => {
                let [x, y] = [self.random.between(-20.0, 720.0), self.random.between(-20.0, 560.0)];
                format!("pointer {x:.0} {y:.0}")
            }
            30..40 => "press".to_owned(),
            40..50 => "release".to_owned(),
            50..54 => format!("scroll {:.1}", self.random.between(-5.0, 5.0)),
            54..64 => format!("key {}", egui::Key::ALL[self.random.index(egui::Key::ALL.len())].name()),
            64..67 => ["undo", "undo", "redo"][self.random.index(3)].to_owned(),
            67..69 => self.open(),
            69..71 => {
                let [x, y] = [self.random.between(1.0, 700.0), self.random.between(1.0, 600.0)];
                format!("size {x:.0} {y:.0}")
            }
            71 => self
                .one_of(&["settle", "frames 3", "save session saved.toml", "picture saved.png", "window shot.png"])
                .to_owned(),
            72..84 if self.named => self.named(),
            _ => self.nameless(),
        }
    }

    fn open(&mut self) -> String {
        let file = self.one_of(&[
            "scene.toml",
            "stained.toml",
            "parallel.toml",
            "ball.nrrd",
            "short.nrrd",
            "broken.toml",
            "nothing.toml",
        ]);
        match file {
            "ball.nrrd" => self.named = false,
            "scene.toml" | "stained.toml" | "parallel.toml" => {
                // Names refer to the open scene, which the next line can use only after loading.
                let settles = !self.named || self.random.index(3) == 0;
                self.named = true;
                return format!("open {file}{}", if settles { "\nsettle" } else { "" });
            }
            _ => {}
        }
        format!("open {file}")
    }

    /// Line that refers to a name in the scene.
    fn named(&mut self) -> String {
        let light = self.one_of(&["day", "lamp"]);
        let material = self.one_of(&["flesh", "bone"]);
        match self.random.index(9) {
            0 => format!("light {light} {}", self.number(0.0, 2.0)),
            1 => format!("{} {light}", self.one_of(&["on", "off", "solo", "node"])),
            2 => format!("{} {light}", self.one_of(&["take", "leave"])),
            3 => format!("place {light} {} {}", self.number(-2.0, 2.0), self.number(-2.0, 2.0)),
            4 => self
                .one_of(&["keep evening\npreset evening", "tour 0.1", "keep evening", "keep dusk", "tour tour.png 3"])
                .to_owned(),
            5 => format!("label gut {}", self.number(0.0, 1.0)),
            6 => format!("interval add {material} 20 90 5 0.1\ninterval 0 material {material}"),
            7 => format!("interval add {material} {}", self.interval()),
            _ => format!("interval add {material} 30 80 2 0.2\ninterval 0 {}", self.interval()),
        }
    }

    fn interval(&mut self) -> String {
        let [from, to] = [self.number(-10.0, 255.0), self.number(0.0, 260.0)];
        format!("{from} {to} {} {}", self.number(0.0, 20.0), self.number(0.0, 1.0))
    }

    /// Line that suits every scene.
    fn nameless(&mut self) -> String {
        let switch = self.one_of(&["on", "off"]);
        match self.random.index(26) {
            0 => format!("hand {} {}", self.number(-2.0, 2.0), self.number(-2.0, 2.0)),
            1 => format!("master {}", self.number(0.0, 2.0)),
            2 => format!("normalise {switch}"),
            3 => format!("adapt {switch}"),
            4 => format!("exposure {}", self.number(0.0, 4.0)),
            5 | 6 => format!("orbit {} {}", self.number(-90.0, 90.0), self.number(-40.0, 40.0)),
            7 => format!("roll {}", self.number(-90.0, 90.0)),
            8 => format!("pan {} {}", self.number(-1.0, 1.0), self.number(-1.0, 1.0)),
            9 => format!("dolly {}", self.number(0.3, 3.0)),
            10 => format!("axis {}", self.one_of(&["left", "right", "front", "back", "bottom", "top"])),
            11 => self.one_of(&["projection", "reset", "reset", "all"]).to_owned(),
            12 => format!("panels {switch}"),
            14 => format!("sees {}", self.one_of(&["all", "protan", "deutan", "tritan"])),
            15 => {
                let parts = [(); 6].map(|()| self.number(0.0, 1.0).to_string());
                format!("crop {}", parts.join(" "))
            }
            16 => format!("crop {}", self.one_of(&["off", "reset"])),
            13 => format!("interval remove {}", self.random.index(5)),
            17 => format!("slices {switch}"),
            18 => {
                format!("slices at {} {} {}", self.number(-9.0, 99.0), self.number(0.0, 30.0), self.number(0.0, 30.0))
            }
            19 => self.one_of(&["slices window 0 100", "slices window -1e30 1e30", "slices window 3 3.001"]).to_owned(),
            20 => format!("slices {} {switch}", self.one_of(&["materials", "labels"])),
            21 => format!("dock {} {switch}", self.one_of(&["left", "right", "bottom"])),
            22 => format!("tab {}", self.one_of(&["camera", "crop", "display", "accuracy", "transfer", "spectra"])),
            23 => format!("note {} {switch}", self.one_of(&["scale", "letters", "legend"])),
            24 => self
                .one_of(&["ruler on", "ruler off", "ruler at 0.5 0.5", "help on", "help off", "lesson 1", "lesson 0"])
                .to_owned(),
            25 => self
                .one_of(&["size 1200 700", "size 1400 900", "ruler world 9 9 9", "ruler world 1e300 0 0"])
                .to_owned(),
            _ => "undo".to_owned(),
        }
    }
}

/// Resident memory of `child` in bytes.
fn resident(child: &Child) -> Option<u64> {
    let text = std::fs::read_to_string(format!("/proc/{}/status", child.id())).ok()?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix(" kB")?.parse::<u64>().ok().map(|kib| kib << 10)
}

/// Waits up to `seconds` until `ready`.
fn wait_until(what: &str, seconds: u64, mut ready: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !ready() {
        assert!(begun.elapsed() < Duration::from_secs(seconds), "still not: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn ended(child: Child) -> Outcome {
    let output = child.wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    Outcome { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
}

/// Starts the viewer with captured output.
fn start(screen: &Screen, folder: &Folder, arguments: &[&str]) -> Child {
    let mut command = screen.command(folder, arguments);
    // One pool of memory for all threads: glibc otherwise keeps up to eight a core, which fill by chance, 20 to 40 MB.
    command.env("MALLOC_ARENA_MAX", "1");
    command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Drives a window by `inputs` random lines. It must end without failure or validation messages, and use no more memory
/// at
/// the end than after a fifth of the lines, except for additional plans and sizes.
fn storm(seed: u64, inputs: usize) {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    std::fs::write(folder.path("script.txt"), Storm::script(seed, inputs)).unwrap();
    let mut child = start(&screen, &folder, &["scene.toml", "--script", "script.txt"]);
    let mut bytes = [None; 2];
    let mut mark = MARK;
    for (name, bytes) in ["early.toml", "late.toml"].iter().zip(&mut bytes) {
        let mut over = false;
        wait_until(name, 3600, || {
            if folder.path(&format!("mark-{mark}.toml")).exists() {
                println!("after {mark} inputs: {:?} MB", resident(&child).map(|bytes| bytes >> 20));
                mark += MARK;
            }
            over = child.try_wait().unwrap().is_some();
            over || folder.path(name).exists()
        });
        *bytes = resident(&child);
        if over {
            break;
        }
    }
    let outcome = ended(child);
    let report = report(&outcome);
    let megabytes = bytes.map(|bytes| bytes.map(|bytes| bytes >> 20));
    println!("{} frames, {} marches, {megabytes:?} MB", report["frames"], report["marches"]);
    // Only Linux reports it.
    if let [Some(early), Some(late)] = bytes {
        assert!(late <= early + ALLOWANCE, "seed {seed}: {early} bytes became {late}");
    }
}

/// Memory for additional plans and sizes, in bytes. Without the validation layer, 10,000 inputs took 18 MB more than
/// 2000,
/// all within the first 5000: pipelines of new plans, 1.2 MB each on a software device, of which at most 64 are kept.
/// The
/// layer takes 0.5 MB more per 1000 inputs, for freed marches and swapchains.
const ALLOWANCE: u64 = 32 << 20;

#[test]
fn random_inputs_leave_the_window_in_order() {
    storm(1, 1000);
}

#[test]
#[ignore = "it takes minutes: cargo test --release --test window view_storm:: -- --ignored"]
fn ten_thousand_random_inputs_leave_the_window_in_order() {
    storm(2, 10_000);
}

/// A round of typical work that ends in its initial state.
const ROUND: &str = "open stained.toml
settle
size 500 400
settle
orbit 40 10
settle
interval add bone 20 90 5 0.2
settle
undo
picture saved.png
settle
open scene.toml
settle
size 640 480
settle
hand 0.3 0.4
orbit 10 0
settle
";

#[test]
fn what_is_done_again_and_again_takes_no_more_memory() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let rounds = |count: usize, name: &str| format!("{}save session {name}\nframes 30\n", ROUND.repeat(count));
    // Memory that a software device has used stays with the process, but pictures may be placed differently in it.
    let first = "panels off\nsize 900 700\nopen stained.toml\nsettle\norbit 40 10\nsettle\npanels on\n";
    let script = [first.to_owned(), rounds(ROUNDS, "early.toml"), rounds(3 * ROUNDS, "late.toml")].concat();
    std::fs::write(folder.path("script.txt"), script).unwrap();
    let mut child = start(&screen, &folder, &["scene.toml", "--script", "script.txt"]);
    let bytes = ["early.toml", "late.toml"].map(|name| {
        wait_until(name, 600, || child.try_wait().unwrap().is_some() || folder.path(name).exists());
        resident(&child)
    });
    report(&ended(child));
    println!("{:?} MB", bytes.map(|bytes| bytes.map(|bytes| bytes >> 20)));
    // Only Linux reports it.
    if let [Some(early), Some(late)] = bytes {
        assert!(late <= early + ROUNDS_ALLOWANCE, "{early} bytes became {late}");
    }
}

/// Rounds until every cache is filled.
const ROUNDS: usize = 6;

/// Variation of the threads' heaps, and the validation layer's records of marches and swapchains, in bytes. A leak of,
/// say,
/// one picture per round exceeds it in this many rounds, even if it first fills memory already allocated.
const ROUNDS_ALLOWANCE: u64 = 10 << 20;

#[test]
#[cfg(target_os = "linux")]
fn a_window_that_is_closed_during_a_march_ends_well() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    for patience in [0, 300, 1000] {
        let child = start(&screen, &folder, &["scene.toml", "-D", "accuracy.step=0.001"]);
        let window = screen.window();
        std::thread::sleep(Duration::from_millis(patience));
        window.close();
        assert_ended_well(child, patience);
    }
}

fn assert_ended_well(child: Child, after: u64) {
    let outcome = ended(child);
    assert_eq!(outcome.code, Some(0), "after {after} ms: {}", outcome.err);
    assert_eq!(outcome.json()["validation"], Value::Array(Vec::new()), "after {after} ms: the validation layer");
}

#[test]
#[cfg(target_os = "linux")]
fn a_window_that_is_out_of_sight_for_a_while_goes_on() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let child = start(&screen, &folder, &["scene.toml"]);
    let window = screen.window();
    for shown in [false, true, false, true] {
        window.show(shown);
        window.point(500, 300);
        window.point(520, 310);
        std::thread::sleep(Duration::from_millis(200));
    }
    window.close();
    assert_ended_well(child, 800);
}

/// CPU time of `child` in seconds, which Linux counts in hundredths.
#[cfg(target_os = "linux")]
fn computed(child: &Child) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
    let fields: Vec<&str> = text.rsplit(") ").next().unwrap().split(' ').collect();
    [fields[11], fields[12]].iter().map(|ticks| ticks.parse::<f64>().unwrap() / 100.0).sum()
}

#[test]
#[cfg(target_os = "linux")]
fn a_window_at_rest_computes_nothing() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let child = start(&screen, &folder, &["scene.toml"]);
    let window = screen.window();
    let mut shares = Vec::new();
    // The first picture must be finished first.
    wait_until("at rest", 30, || {
        let (before, begun) = (computed(&child), Instant::now());
        std::thread::sleep(Duration::from_secs(2));
        shares.push((computed(&child) - before) / begun.elapsed().as_secs_f64());
        shares.last() < Some(&0.02)
    });
    println!("shares of a core: {shares:?}");
    window.close();
    assert_ended_well(child, 2000);
}

#[test]
#[cfg(target_os = "linux")]
fn a_picture_that_was_saved_is_told_of_though_nothing_moves() {
    /// Background colour of notices.
    const PAPER: [u8; 3] = [255, 236, 179];
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let child = start(&screen, &folder, &["scene.toml"]);
    let window = screen.window();
    for number in 1..=3 {
        // Idle, without the previous notice.
        std::thread::sleep(Duration::from_secs(2));
        wait_until("no notice", 20, || window.pixels_of(PAPER) == 0);
        window.press_with_control('p');
        wait_until("saved", 20, || folder.path(&format!("relume-{number:04}.png")).exists());
        wait_until("told of", 2, || window.pixels_of(PAPER) > 100);
    }
    window.close();
    assert_ended_well(child, 0);
}

#[test]
#[cfg(target_os = "linux")]
fn the_pictures_of_a_tour_are_of_one_thing() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "size 320 300\nhand 0.3 0.2\nkeep noon\nhand 0.1 -0.4\nkeep dusk\nsettle\ntour tour.png 9000\nsettle\npicture still.png\n";
    std::fs::write(folder.path("script.txt"), script).unwrap();
    let mut child = start(&screen, &folder, &["scene.toml", "--script", "script.txt"]);
    let window = screen.window();
    let mut wait = |name: &str| {
        wait_until(name, 60, || child.try_wait().unwrap().is_some() || folder.path(name).exists());
    };
    wait("tour-0003.png");
    // The saved picture shows the document, not a position of the tour: it waits for the end of the tour.
    window.press_with_control('p');
    wait("tour-0009.png");
    assert!(!folder.path("relume-0001.png").exists());
    window.press_with_control('z');
    let report = report(&ended(child));
    let told = report["notices"].to_string();
    assert!(told.contains("was changed: the tour was cancelled after"), "{told}");
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert_eq!(bytes("relume-0001.png"), bytes("still.png"));
    assert!(!folder.path("tour-9000.png").exists());
}

#[test]
#[cfg(target_os = "linux")]
fn the_key_that_quits_closes_the_window() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let child = start(&screen, &folder, &["scene.toml"]);
    let window = screen.window();
    window.press_with_control('q');
    assert_ended_well(child, 0);
}

#[test]
#[cfg(target_os = "linux")]
fn a_display_that_goes_away_is_told_of_in_one_sentence() {
    let folder = folder();
    for patience in [0, 10, 50, 300, 1500] {
        let Some(mut screen) = Screen::new() else { return };
        let child = start(&screen, &folder, &["scene.toml"]);
        drop(screen.window());
        std::thread::sleep(Duration::from_millis(patience));
        screen.end();
        let outcome = ended(child);
        outcome.assert_refused(1, &["display"]);
    }
}

/// Runs `script` with the device failure `failure`.
fn failing(screen: &Screen, folder: &Folder, failure: &str, script: &str) -> Outcome {
    std::fs::write(folder.path("script.txt"), script).unwrap();
    let mut command = screen.command(folder, &["scene.toml", "--script", "script.txt"]);
    Outcome::of(command.env("RELUME_SIMULATE", failure))
}

#[test]
fn a_lost_device_is_opened_again_and_nothing_that_was_done_is_lost() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let edits = "settle\nlight lamp 0.3\norbit 20 10\ninterval 0 30 90 5 0.3\n";
    let script = format!(
        "{edits}frames 200\nsettle\npicture after.png\nsettle\nundo\nsettle\npicture undone.png\nwindow window.png\nsettle\n"
    );
    let whole = screen.script(&folder, "scene.toml", &script);
    assert_eq!(whole["losses"], 0);
    let wanted = ["after.png", "undone.png", "window.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    let outcome = failing(&screen, &folder, "device-lost=100", &script);
    let report = report(&outcome);
    assert!(report["losses"].as_u64() > Some(0), "{report}");
    assert!(report["notices"].to_string().contains("device was lost"), "{report}");
    for (name, wanted) in ["after.png", "undone.png"].iter().zip(&wanted) {
        assert!(std::fs::read(folder.path(name)).unwrap() == *wanted, "{name} is another picture");
    }
}

#[test]
fn a_device_that_is_lost_again_and_again_waits_for_somebody_or_ends_in_a_sentence() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle\nframes 8\nrestart\nsettle\nframes 30\nwindow window.png\n";
    for submissions in [1, 5, 14] {
        let outcome = failing(&screen, &folder, &format!("device-lost={submissions}"), script);
        assert!(!outcome.err.contains("panicked"), "{submissions}: {}", outcome.err);
        if outcome.out.is_empty() || outcome.json()["error"].is_object() {
            outcome.assert_refused(1, &["the device was lost"]);
        } else {
            report(&outcome);
        }
    }
}

#[test]
fn what_does_not_fit_into_memory_is_told_and_the_scene_before_stays() {
    let Some(screen) = Screen::new() else { return };
    let huge = SCENE.replace("dims = [32, 30, 18]", "dims = [90000, 90000, 90000]");
    let large = SCENE.replace("dims = [32, 30, 18]", "dims = [3000, 4, 4]");
    let folder = folder().with("huge.toml", huge).with("large.toml", large);
    let script = "settle
picture before.png
open huge.toml
settle
picture after.png
node lamp
picture lamp.png
orbit 20 0
settle
";
    let report = screen.script(&folder, "scene.toml", script);
    assert!(report["notices"].to_string().contains("memory"), "{}", report["notices"]);
    let [before, after, lamp] =
        ["before", "after", "lamp"].map(|it| std::fs::read(folder.path(&format!("{it}.png"))).unwrap());
    assert_eq!(before, after, "the scene before stays");
    assert_ne!(before, lamp, "and its light can be changed");
}

#[test]
fn wherever_the_device_runs_out_of_memory_the_window_goes_on_or_ends_in_a_sentence() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle\nopen stained.toml\nsettle\nmaster 0.5\norbit 20 0\nsettle\nsize 500 400\nsettle\nwindow window.png\nframes 5\n";
    let mut goes_on = 0;
    for objects in (1..60).step_by(9) {
        let outcome = failing(&screen, &folder, &format!("out-of-memory={objects}"), script);
        if outcome.out.is_empty() || outcome.json()["error"].is_object() {
            // The script went on before a scene was open.
            outcome.assert_refused(1, &[]);
        } else {
            report(&outcome);
            goes_on += 1;
        }
    }
    assert!(goes_on > 2, "it went on {goes_on} times");
}
