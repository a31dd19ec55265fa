//! One picture by several processes that `mpirun` starts. Without `mpirun` these tests fail.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::support::program::{Folder, Outcome};

const PROGRAM: &str = env!("CARGO_BIN_EXE_relume");

/// `mpirun` in this folder, also as root and on fewer cores than processes.
fn mpirun(folder: &Folder, arguments: &[&str]) -> Command {
    let mut command = Command::new("mpirun");
    command.args(["--allow-run-as-root", "--oversubscribe"]).args(arguments);
    command.current_dir(folder.path("")).stdin(Stdio::null());
    command
}

/// Runs the program in `count` processes.
fn by(folder: &Folder, count: &str, arguments: &[&str]) -> Outcome {
    Outcome::of(&mut mpirun(folder, &[&["-n", count, PROGRAM][..], arguments].concat()))
}

fn done(folder: &Folder, count: &str, arguments: &[&str]) -> Outcome {
    let outcome = by(folder, count, arguments);
    assert_eq!(outcome.code, Some(0), "{count} processes: {arguments:?}: {}", outcome.err);
    outcome
}

const SIZE: [&str; 4] = ["render", "scene.toml", "--size", "20x36"];

#[test]
fn a_relay_writes_the_files_of_one_process() {
    let folder = Folder::new();
    let outputs = |name: &str| [format!("{name}.exr"), format!("{name}.png"), format!("{name}-linear.exr")];
    let bytes = |name: &str| outputs(name).map(|name| std::fs::read(folder.path(&name)).unwrap());
    let arguments = |outputs: &[String; 3]| -> Vec<String> {
        let [film, png, exr] = outputs;
        let outputs = ["--accumulators", film, "-o", png, "-o", exr, "--json"];
        SIZE.iter().chain(&outputs).map(|&text| text.to_owned()).collect()
    };
    let half: &[&str] = &["-D", "accuracy.storage=\"f16\""];
    // Each process gathers all of it.
    let scattered: &[&str] = &["-D", "scattering.orders=\"multiple\"", "-D", "scattering.spacing=4"];
    for (changes, counts) in [(&[][..], &["1", "2", "3", "4"][..]), (half, &["3"]), (scattered, &["3"])] {
        let run = |count: Option<&str>, name: &str| {
            let arguments = arguments(&outputs(name));
            let mut arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            arguments.extend(changes);
            match count {
                Some(count) => done(&folder, count, &arguments).json(),
                None => folder.done(&arguments).json(),
            }
        };
        run(None, "one");
        for count in counts {
            let told = run(Some(count), "many");
            assert!(bytes("many") == bytes("one"), "{count} processes");
            if *count == "3" {
                let processes = &told["march"]["processes"];
                assert_eq!((&processes["sharing"], &processes["count"]), (&"relay".into(), &3.into()), "{told:#}");
                assert!(processes["sent_bytes"].as_u64() > Some(0), "{told:#}");
            }
        }
    }
}

#[test]
fn over_gives_one_film_for_any_number_of_processes() {
    let folder = Folder::new();
    for block in 1..=8 {
        let (block, part) = (format!("{block}/8"), format!("part-{block}.exr"));
        folder.done(&[&SIZE[..], &["--block", &block, "--accumulators", &part]].concat());
    }
    let parts: Vec<String> = (1..=8).map(|block| format!("part-{block}.exr")).collect();
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    folder.done(&[&["composite"], &parts[..], &["-o", "film.exr"]].concat());
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    let over = [&SIZE[..], &["--mpi", "over", "--accumulators", "over.exr", "-o", "over.png"]].concat();
    folder.done(&over);
    let picture = bytes("over.png");
    assert!(bytes("over.exr") == bytes("film.exr"), "one process without a launcher");
    for count in ["2", "3", "4"] {
        std::fs::remove_file(folder.path("over.exr")).unwrap();
        done(&folder, count, &over);
        assert!(bytes("over.exr") == bytes("film.exr"), "{count} processes");
        assert!(bytes("over.png") == picture, "{count} processes");
    }
    // Under a light that no process knew.
    let relit = |film: &str, name: &str| {
        folder.done(&["relight", film, "--light", "FL11", "-o", name]);
        bytes(name)
    };
    assert!(relit("over.exr", "one.png") == relit("film.exr", "other.png"), "relit");
}

#[test]
fn processes_that_cannot_share_a_picture_end_with_one_sentence() {
    let folder = Folder::new();
    let refused = |command: &mut Command, words: &[&str]| {
        let before = folder.names();
        let outcome = Outcome::of(command);
        assert!(outcome.code.is_some_and(|code| code > 0), "{outcome:?}");
        let told: Vec<&str> = outcome.err.lines().filter(|line| line.starts_with("error: ")).collect();
        assert_eq!(told.len(), 1, "{}", outcome.err);
        for word in words {
            assert!(outcome.err.contains(word), "no {word:?} in: {}", outcome.err);
        }
        assert_eq!(folder.names(), before, "something is left");
        assert_eq!(outcome.out, "", "{}", outcome.err);
    };
    let film = ["--accumulators", "film.exr"];
    let all = [&["-n", "3", PROGRAM], &SIZE[..], &film].concat();
    let with = |more: &[&str]| mpirun(&folder, &[&all[..], more].concat());
    // The same on all, and on one of them.
    refused(&mut with(&["-D", "accuracy.rays=4"]), &["several processes: the scene has 4 rays a pixel"]);
    refused(&mut with(&["-D", "materials.flesh.reflectance=\"none\""]), &["none"]);
    refused(&mut with(&["--mpi", "over/2"]), &["3 processes have only 2 blocks", "--mpi over/3"]);
    let one = [&["-n", "1", PROGRAM], &SIZE[..], &film].concat();
    let other = |more: &[&str]| mpirun(&folder, &[&one[..], &[":"], &one[..], more].concat());
    refused(
        &mut other(&["-D", "transfer.intervals.0.opacity=0.2"]),
        &["rank 1 of 2 renders something else than rank 0"],
    );
    refused(&mut other(&["--device", "no such device"]), &["rank 1 of 2 processes failed", "no such device"]);
    refused(&mut other(&["--volume", "none.nrrd"]), &["rank 1 of 2 processes failed", "none.nrrd"]);
    // Other outputs need other messages.
    refused(&mut other(&["-o", "other.png"]), &["rank 1 of 2 renders something else", "--mpi off"]);
    refused(&mut with(&["-D", "model.kind=\"peercy\""]), &["peercy"]);
    refused(&mut with(&["--reference"]), &["not --reference", "--mpi off"]);
    // A launcher that MPI does not know, and programs that it starts for pictures of their own.
    let foreign = |more: &[&str]| {
        let mut command = Command::new(PROGRAM);
        command.args([&SIZE[..], &film, more].concat()).current_dir(folder.path("")).env("PMI_SIZE", "4");
        command
    };
    refused(&mut foreign(&[]), &["4 processes were started, and MPI knows of 1"]);
    let apart = Outcome::of(&mut foreign(&["--mpi", "off"]));
    assert_eq!(apart.code, Some(0), "{}", apart.err);
    // Slurm without PMIx: each process would write the whole picture into the same file.
    let by_slurm = |more: &[&str]| {
        let mut command = Command::new(PROGRAM);
        command.args([&SIZE[..], &film, more].concat()).current_dir(folder.path("")).env("SLURM_STEP_NUM_TASKS", "2");
        command
    };
    refused(&mut by_slurm(&[]), &["Slurm started 2 processes", "srun --mpi=pmix", "--mpi off"]);
    let apart = Outcome::of(&mut by_slurm(&["--mpi", "off"]));
    assert_eq!(apart.code, Some(0), "{}", apart.err);
    std::fs::remove_file(folder.path("film.exr")).unwrap();
    folder.refused(2, &[&SIZE[..], &["--mpi", "relay", "--block", "1/2"], &film].concat(), &["--block"]);
    folder.refused(2, &[&SIZE[..], &["--mpi", "across"], &film].concat(), &["write relay, over"]);
}

#[test]
fn when_a_process_fails_during_the_march_the_run_ends_with_its_rank() {
    let folder = Folder::new();
    let one = [&["-n", "1", "-x", "RELUME_SIMULATE=device-lost=1000", PROGRAM], &SIZE[..]].concat();
    let other = [&["-n", "1", "-x", "RELUME_SIMULATE=device-lost=30", PROGRAM], &SIZE[..]].concat();
    for way in ["relay", "over"] {
        let more = ["--mpi", way, "-o", "picture.png"];
        let outcome = Outcome::of(&mut mpirun(&folder, &[&one[..], &more, &[":"], &other[..], &more].concat()));
        assert!(outcome.code.is_some_and(|code| code > 0), "{way}: {outcome:?}");
        for told in ["rank 1 of 2 processes failed", "lost", "rank 0 of 2 processes: the launcher ended this process"] {
            assert!(outcome.err.contains(told), "{way}: no {told:?} in: {}", outcome.err);
        }
        assert_eq!(folder.names(), ["scene.toml"], "{way}: something is left");
    }
}

/// Processes whose parent is the process `of`.
fn children(of: u32) -> Vec<u32> {
    let all = std::fs::read_dir("/proc").unwrap().flatten();
    let numbers = all.filter_map(|entry| entry.file_name().to_str()?.parse::<u32>().ok());
    let parent = |process: &u32| -> Option<u32> {
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
        stat.rsplit(')').next()?.split_whitespace().nth(1)?.parse().ok()
    };
    numbers.filter(|process| parent(process) == Some(of)).collect()
}

#[test]
fn when_a_process_is_killed_the_others_end_with_a_sentence() {
    let folder = Folder::new();
    // Long enough to be killed: it never ends by itself within the test.
    let long = ["-n", "3", PROGRAM, "render", "scene.toml", "--size", "2000x2000", "-D", "accuracy.step=0.0005"];
    let mut command = mpirun(&folder, &[&long[..], &["-o", "picture.png"]].concat());
    let run = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    let victim = loop {
        // The second of the processes, once all three have been started for a while.
        if let [_, victim, _] = children(run.id())[..] {
            std::thread::sleep(Duration::from_millis(1500));
            break victim;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "three processes");
        std::thread::sleep(Duration::from_millis(20));
    };
    assert!(Command::new("kill").args(["-9", &victim.to_string()]).status().unwrap().success(), "{victim}");
    let killed = Instant::now();
    let output = run.wait_with_output().unwrap();
    let err = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success(), "{err}");
    assert!(killed.elapsed() < Duration::from_secs(20), "the others go on for {:?}", killed.elapsed());
    for rank in [0, 2] {
        let sentence = format!("error: rank {rank} of 3 processes: the launcher ended this process");
        assert!(err.contains(&sentence), "no {sentence:?} in: {err}");
    }
    assert_eq!(folder.names(), ["scene.toml"], "something is left");
}
