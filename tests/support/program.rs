//! Runs the program as a user does, in a temporary folder.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use tempfile::TempDir;

/// Small frog with two materials and two lights; the base scene of the tests.
pub const SCENE: &str = r#"version = 1
[volume]
phantom = "frog"
dims = [32, 30, 18]
[materials.flesh]
reflectance = "foliage"
specular = 0.2
[materials.bone]
reflectance = "white 9.5"
[transfer]
intervals = [
    { material = "flesh", range = [30, 90], ramp = 5, opacity = 0.1 },
    { material = "bone", range = [180, 255], opacity = 0.9 },
]
[lights.day]
spectrum = "D65"
kind = "directional"
direction = [-0.4, -0.7, -0.6]
[lights.lamp]
spectrum = "A"
kind = "ambient"
intensity = 0.5
"#;

/// Dial for [`SCENE`], with a preset in which one node is off.
pub const DIAL: &str = r#"
[dial.nodes]
day = [0, 1]
lamp = [0, -1]
[[dial.presets]]
name = "evening"
hand = "lamp"
off = ["day"]
"#;

/// [`SCENE`] with [`DIAL`] and a label.
pub fn labelled() -> String {
    let labels = "[labels.2]\nname = \"gut\"\nmaterial = \"bone\"\nopacity = 0.25\n";
    format!("{}{DIAL}{labels}", SCENE.replace("dims =", "phantom_labels = true\ndims ="))
}

/// Temporary folder with `scene.toml`, the program's working directory.
pub struct Folder(TempDir);

impl Folder {
    pub fn new() -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        folder.with("scene.toml", SCENE)
    }

    pub fn with(self, name: &str, bytes: impl AsRef<[u8]>) -> Self {
        std::fs::write(self.path(name), bytes).unwrap();
        self
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Sorted file names, including hidden files.
    pub fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Returns the program's command in this folder.
    pub fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_relume"));
        command.args(arguments).current_dir(self.0.path()).stdin(Stdio::null());
        command
    }

    /// Runs the program.
    pub fn run(&self, arguments: &[&str]) -> Outcome {
        Outcome::of(&mut self.command(arguments))
    }

    /// Runs the program and asserts success.
    pub fn done(&self, arguments: &[&str]) -> Outcome {
        let outcome = self.run(arguments);
        assert_eq!(outcome.code, Some(0), "{arguments:?}: {}", outcome.err);
        outcome
    }

    /// Runs the program and asserts that it exits with `code`, mentions each of `words` and leaves the folder
    /// unchanged.
    pub fn refused(&self, code: i32, arguments: &[&str], words: &[&str]) -> Outcome {
        let before = self.names();
        let outcome = self.run(arguments);
        outcome.assert_refused(code, words);
        assert_eq!(self.names(), before, "{arguments:?} left something behind");
        outcome
    }
}

/// Exit code and output of the program.
#[derive(Debug)]
pub struct Outcome {
    pub code: Option<i32>,
    pub out: String,
    pub err: String,
}

impl Outcome {
    pub fn of(command: &mut Command) -> Self {
        let output = command.output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Self { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }

    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {}", self.out))
    }

    /// Asserts a single error with its causes that mentions each of `words`, no result on standard output (with `--json`,
    /// the error) and no panic.
    pub fn assert_refused(&self, code: i32, words: &[&str]) {
        let Self { err, out, .. } = self;
        assert_eq!(self.code, Some(code), "{err}");
        let is_error = !out.is_empty() && self.json()["error"]["code"].is_string();
        assert!(out.is_empty() || is_error, "standard output is for results: {out}");
        let told: Vec<&str> =
            err.lines().filter(|line| !["warning: ", "note: "].iter().any(|it| line.starts_with(it))).collect();
        assert!(told[0].starts_with("error: "), "{err}");
        // clap ends its message with a usage hint and indents lists.
        let by_clap = code == 2 && err.ends_with("try '--help'.\n");
        let told = told.into_iter().skip(1).take_while(|line| !by_clap || !line.is_empty());
        let more = told.filter(|line| !line.starts_with(if by_clap { "  " } else { "  because: " }));
        assert_eq!(more.count(), 0, "more than one message: {err}");
        for word in ["panicked", "RUST_BACKTRACE", "unwrap", ".rs:"] {
            assert!(!err.contains(word), "{err}");
        }
        for word in words {
            assert!(err.contains(word), "no {word:?} in: {err}");
        }
    }
}
