//! Any failure during a render is reported in one sentence and leaves no partial file.
#![cfg(unix)]

use crate::support;

use std::io::Read as _;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use support::program::{Folder, Outcome};

const OLD: &str = "what was there before";

fn render<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["render", "scene.toml", "--size", "16x16"], more].concat()
}

/// Temporary files in `folder`.
fn parts(folder: &Folder) -> Vec<String> {
    folder.names().into_iter().filter(|name| name.ends_with(".part")).collect()
}

/// Waits up to a minute until `ready`.
fn wait_until(what: &str, mut ready: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !ready() {
        assert!(begun.elapsed() < Duration::from_secs(60), "still not: {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn make_pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().unwrap().success(), "mkfifo");
}

fn start(folder: &Folder, arguments: &[&str]) -> Child {
    folder.command(arguments).stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap()
}

// The disk.

#[test]
fn a_disk_that_fills_up_keeps_the_old_file_and_no_part_of_the_new_one() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("disk")).unwrap();
    // A small tmpfs if the system permits one; otherwise a limit on file sizes.
    let mount = "mount -t tmpfs -o size=16k none disk";
    let lent = Command::new("unshare").args(["-rm", "sh", "-c", mount]).current_dir(folder.path(".")).output();
    let lent = lent.is_ok_and(|output| output.status.success());
    let (limit, words) = if lent { (mount, "the disk is full") } else { ("ulimit -f 8", "limits files to") };
    let program = env!("CARGO_BIN_EXE_relume");
    for arguments in
        ["-o disk/old.png --bits 16", "-o disk/old.exr", "--spectral disk/old.exr", "--accumulators disk/old.exr"]
    {
        let name = arguments.split(' ').nth(1).unwrap();
        let script = format!(
            "{limit} && printf '{OLD}' >{name} && '{program}' render scene.toml --size 128x128 {arguments}; \
             code=$?; ls -A disk; cat {name}; rm {name}; exit $code"
        );
        let mut command = if lent { Command::new("unshare") } else { Command::new("sh") };
        command.args(if lent { &["-rm", "sh", "-c"][..] } else { &["-c"] });
        let outcome = Outcome::of(command.arg(script).current_dir(folder.path(".")).stdin(Stdio::null()));
        assert_eq!(outcome.code, Some(1), "{arguments}: {}", outcome.err);
        assert!(outcome.err.contains(words) && outcome.err.contains(name), "{arguments}: {}", outcome.err);
        let file = name.trim_start_matches("disk/");
        assert_eq!(outcome.out, format!("{file}\n{OLD}"), "{arguments}: the old file and nothing else");
    }
}

#[test]
fn a_pipe_gets_the_whole_picture() {
    let folder = Folder::new();
    make_pipe(&folder.path("pipe.png"));
    let child = start(&folder, &render(&["-o", "pipe.png"]));
    let mut bytes = Vec::new();
    std::fs::File::open(folder.path("pipe.png")).unwrap().read_to_end(&mut bytes).unwrap();
    assert!(child.wait_with_output().unwrap().status.success(), "rendered");
    folder.done(&render(&["-o", "file.png"]));
    assert!(bytes == std::fs::read(folder.path("file.png")).unwrap(), "the pipe got {} bytes", bytes.len());
    assert!(
        std::fs::symlink_metadata(folder.path("pipe.png")).unwrap().file_type()
            != std::fs::metadata(folder.path("file.png")).unwrap().file_type(),
        "still a pipe"
    );
}

#[test]
fn an_output_that_is_an_input_by_another_name_is_refused_or_leaves_it_alone() {
    let header = "NDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = v.raw\n";
    let folder = Folder::new().with("v.raw", [9; 64]).with("v.mhd", header);
    symlink("v.raw", folder.path("link.png")).unwrap();
    let refused = ["--volume", "v.mhd", "-o", "link.png"];
    folder.refused(2, &render(&refused), &["link.png is an input"]);
    // A hard link to the same bytes: its name is replaced by the picture, the bytes stay.
    std::fs::hard_link(folder.path("v.raw"), folder.path("same.png")).unwrap();
    folder.done(&render(&["--volume", "v.mhd", "-o", "same.png"]));
    assert_eq!(std::fs::read(folder.path("v.raw")).unwrap(), [9; 64]);
}

/// Starts to write a long spectral picture over an old one.
fn writing(folder: &Folder) -> Child {
    let child = start(folder, &["render", "scene.toml", "--size", "900x900", "--spectral", "s.exr"]);
    let growing = || {
        let size = |name: &String| std::fs::metadata(folder.path(name)).map_or(0, |metadata| metadata.len());
        parts(folder).iter().any(|name| size(name) > 1 << 20)
    };
    wait_until("written to", growing);
    child
}

#[test]
fn a_program_that_is_killed_while_it_writes_leaves_the_old_file_whole() {
    let folder = Folder::new().with("s.exr", OLD);
    let mut child = writing(&folder);
    child.kill().unwrap();
    assert_eq!(child.wait().unwrap().code(), None, "killed");
    assert_eq!(std::fs::read(folder.path("s.exr")).unwrap(), OLD.as_bytes());
    // The remaining file has a recognisable name, and no program takes it for a picture.
    assert!(matches!(&parts(&folder)[..], [part] if part.starts_with(".relume-")), "{:?}", folder.names());
    folder.done(&render(&["--spectral", "s.exr"]));
    assert!(std::fs::read(folder.path("s.exr")).unwrap().starts_with(b"v/1\x01"), "the next picture");
}

// The device.

/// Renders with the failure `name` injected at every step at which it can occur.
fn fails_at_every_step(name: &str, words: &[&str]) {
    let folder = Folder::new().with("p.png", OLD);
    let arguments = render(&["-o", "p.png", "--accumulators", "a.exr"]);
    let before = folder.names();
    for step in 1.. {
        let outcome = Outcome::of(folder.command(&arguments).env("RELUME_SIMULATE", format!("{name}={step}")));
        if outcome.code == Some(0) {
            assert!(step > 3, "only {step} steps could fail");
            return;
        }
        outcome.assert_refused(1, words);
        assert_eq!(folder.names(), before, "step {step} left something behind");
        assert_eq!(std::fs::read(folder.path("p.png")).unwrap(), OLD.as_bytes(), "step {step}");
    }
}

#[test]
fn a_device_that_is_lost_is_reported_whenever_that_happens() {
    fails_at_every_step("device-lost", &["the device was lost", "open it again"]);
}

#[test]
fn a_device_without_memory_is_reported_whenever_that_happens() {
    fails_at_every_step("out-of-memory", &["bytes, and the device does not have them free"]);
}

// Ctrl-C.

/// Longest delay, in seconds, that a user perceives as immediate.
const AT_ONCE: f64 = 0.3;

/// Runs the program, interrupts it when `ready`, and returns the time it takes to end; it must leave the folder's files
/// alone.
fn interrupted(folder: &Folder, arguments: &[&str], ready: impl Fn(&Folder)) -> f64 {
    let before = folder.names();
    let child = start(folder, arguments);
    ready(folder);
    let begun = Instant::now();
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success(), "{arguments:?} had ended before");
    let output = child.wait_with_output().unwrap();
    let took = begun.elapsed().as_secs_f64();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(130), "{arguments:?}: {said}");
    assert!(said.lines().filter(|line| line.starts_with("error: ")).count() == 1, "{said}");
    assert!(said.contains("error: interrupted"), "{said}");
    assert_eq!(folder.names(), before, "{arguments:?} left something behind");
    took
}

/// Launchers end programs by TERM, closed terminals by HUP; `nohup` has a program go on after HUP.
#[test]
fn a_signal_that_ends_the_program_leaves_no_incomplete_file() {
    let program = env!("CARGO_BIN_EXE_relume");
    let turning = render(&["--turntable", "600", "-o", "t.apng"]).join(" ");
    for (signal, code) in [("TERM", 143), ("HUP", 129)] {
        let folder = Folder::new();
        let before = folder.names();
        // This test may itself run under `nohup`.
        let mut command = Command::new("env");
        command.args(["--default-signal=HUP", program]).args(turning.split(' ')).current_dir(folder.path("."));
        let child = command.stderr(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let begun = Instant::now();
        while parts(&folder).is_empty() && begun.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert!(!parts(&folder).is_empty(), "the animation is being written");
        Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(&format!("ended by the signal {signal}")), "{said}");
        assert_eq!(folder.names(), before, "{signal} left something behind");
    }
    let folder = Folder::new();
    let line = format!(
        "trap '' HUP; '{program}' render scene.toml -o p.png --size 300x300 & sleep 0.3; kill -HUP $!; wait $!"
    );
    let mut command = Command::new("bash");
    command.args(["-c", &line]).current_dir(folder.path("."));
    assert_eq!(Outcome::of(&mut command).code, Some(0), "nohup");
}

/// Shortest time of several attempts, since the machine may be busy.
fn ends_at_once(folder: &Folder, arguments: &[&str], ready: impl Fn(&Folder)) {
    let tries = (0..5).map(|_| interrupted(folder, arguments, &ready));
    let mut slowest = Vec::new();
    for took in tries {
        if took <= AT_ONCE {
            return;
        }
        slowest.push(took);
    }
    panic!("{arguments:?} ended only after {slowest:?} s");
}

fn after(milliseconds: u64) -> impl Fn(&Folder) {
    move |_| std::thread::sleep(Duration::from_millis(milliseconds))
}

#[test]
fn ctrl_c_ends_loading_at_once() {
    let header = "NRRD0004\ntype: float\ndimension: 3\nsizes: 400 400 400\nencoding: ascii\n\n";
    let folder = Folder::new().with("v.nrrd", [header.as_bytes(), &b"1 ".repeat(64_000_000)].concat());
    ends_at_once(&folder, &["info", "v.nrrd"], after(300));
}

#[test]
fn ctrl_c_ends_work_that_does_not_listen_at_once() {
    // Generating a phantom has no cancellation checks.
    let folder = Folder::new();
    let phantom = ["info", "scene.toml", "-D", "volume.dims=[800,800,800]"];
    ends_at_once(&folder, &phantom, after(300));
    // The pipe has no reader.
    make_pipe(&folder.path("pipe.png"));
    ends_at_once(&folder, &render(&["-o", "pipe.png"]), after(1500));
}

#[test]
fn ctrl_c_ends_designing_at_once() {
    let name = "one_light_each_of_eight.toml";
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/palettes");
    let scene = format!("version = 1\n[volume]\nphantom = \"slab\"\n[palette]\nuse = \"{name}\"\n");
    let folder = Folder::new().with(name, std::fs::read(examples.join(name)).unwrap()).with("designed.toml", scene);
    ends_at_once(&folder, &["design", name], after(300));
    ends_at_once(&folder, &["info", "designed.toml"], after(300));
}

#[test]
fn ctrl_c_ends_fitting_at_once() {
    // No dimension keeps the tolerance for this many dyes and lights, so all are fitted, for seconds.
    let mut scene = "version = 1\n[volume]\nphantom = \"slab\"\ndims = [3, 3, 3]\n".to_owned();
    let mut intervals = String::new();
    for dye in 0..64 {
        let (centre, low, high) = (400 + 5 * dye, 10 * dye, 10 * dye + 5);
        scene += &format!(
            "[materials.m{dye}]\nreflectance = 0.5\n\
             absorption = {{ gaussian = [{{ centre = {centre}, sigma = 20, height = 1 }}] }}\n"
        );
        intervals +=
            &format!("{{ material = \"m{dye}\", range = [{low}, {high}], opacity = 0.1, absorption = 0.1 }},\n");
    }
    scene += &format!("[transfer]\nintervals = [\n{intervals}]\n");
    for light in ["FL2", "FL7", "FL11", "LED-B3", "LED-RGB1", "D65", "A", "E"] {
        scene += &format!("[lights.{light}]\nspectrum = \"{light}\"\n");
    }
    let folder = Folder::new().with("dyes.toml", scene);
    ends_at_once(&folder, &["info", "dyes.toml", "--tolerance", "0.001"], after(300));
}

#[test]
fn ctrl_c_ends_benchmarks_at_once() {
    let folder = Folder::new().with("costs.html", OLD);
    for slow in [
        &["bench", "peer", "--size", "2000x2000", "-D", "accuracy.step=0.001", "-o", "costs.html"][..],
        &["bench", "load", "--frames", "100000"],
    ] {
        ends_at_once(&folder, slow, after(2000));
        let page = std::fs::read(folder.path("costs.html")).unwrap();
        assert_eq!(page, OLD.as_bytes(), "nothing was finished that a page could show");
    }
}

#[test]
fn ctrl_c_keeps_the_rows_of_a_benchmark_on_a_whole_page() {
    let folder = Folder::new().with("costs.html", OLD);
    let small = ["--size", "16x16", "--frames", "1000", "-D", "volume.dims=[62,58,34]", "--largest", "64"];
    let arguments = [&["bench", "scaling", "--json", "-o", "costs.html"], &small[..]].concat();
    let mut slowest = Vec::new();
    for seconds in [3, 3, 6, 12, 24] {
        let child = start(&folder, &arguments);
        std::thread::sleep(Duration::from_secs(seconds));
        let begun = Instant::now();
        assert!(Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap().success());
        let output = child.wait_with_output().unwrap();
        slowest.push(begun.elapsed().as_secs_f64());
        assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
        let json: serde_json::Value = match &output.stdout[..] {
            // Ended before it could print.
            [] => serde_json::json!({ "error": {} }),
            printed => serde_json::from_slice(printed).unwrap(),
        };
        if json["error"].is_object() {
            // On a busy machine, nothing was finished yet.
            assert_eq!(std::fs::read(folder.path("costs.html")).unwrap(), OLD.as_bytes());
            continue;
        }
        assert!(json["interrupted"] == true && !json["rows"].as_array().unwrap().is_empty(), "{json}");
        let page = std::fs::read_to_string(folder.path("costs.html")).unwrap();
        assert!(page.starts_with("<!") && page.trim_end().ends_with("</html>"), "{page}");
        assert!(page.contains("Interrupted: only the finished rows"), "{page}");
        assert_eq!(folder.names(), ["costs.html", "scene.toml"], "nothing unfinished is left");
        if slowest.last().is_some_and(|took| *took <= AT_ONCE) {
            return;
        }
    }
    panic!("it ended only after {slowest:?} s");
}

#[test]
fn ctrl_c_ends_marching_at_once_on_the_device_and_on_the_cpu() {
    let folder = Folder::new();
    let step = ["render", "scene.toml", "-o", "p.png", "--size", "2000x2000", "-D", "accuracy.step=0.001"];
    ends_at_once(&folder, &step, after(1500));
    ends_at_once(&folder, &[&step[..], &["--reference"]].concat(), after(500));
}

#[test]
fn ctrl_c_ends_writing_at_once_and_leaves_the_old_file() {
    let folder = Folder::new().with("s.exr", OLD);
    let before = folder.names();
    let mut quickest = f64::INFINITY;
    for _ in 0..3 {
        let child = writing(&folder);
        let begun = Instant::now();
        let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        assert!(sent.success(), "it had ended before");
        let output = child.wait_with_output().unwrap();
        quickest = quickest.min(begun.elapsed().as_secs_f64());
        assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(folder.names(), before, "something is left behind");
        assert_eq!(std::fs::read(folder.path("s.exr")).unwrap(), OLD.as_bytes());
        if quickest <= AT_ONCE {
            return;
        }
    }
    panic!("it ended only after {quickest} s");
}
