//! The command line: one result on standard output, one error on standard error.

mod accuracy;
mod advice;
mod bench;
mod bricks;
mod composite;
mod convert;
mod design;
mod dial;
mod extremes;
mod figures;
mod files;
mod frames;
mod goal;
mod info;
mod level;
mod light_grid;
mod measure;
mod model;
mod page;
mod processes;
mod relight;
mod render;
mod scene;
mod shaders;
mod shell;
mod slice;
mod terminal;
mod turntable;
mod view;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::{Parser, Subcommand};

use crate::document::import::ImportError;
use crate::document::{OpenError, SceneError};
use crate::live::LiveError;
use crate::measure::{LadderError, MeasureError};
use crate::model::ModelError;
use crate::output::OutputError;
use crate::output::page::PageError;
use crate::palette::PaletteError;
use crate::plan::PlanError;
use crate::progress::Progress;
use crate::reference::ReferenceError;
use crate::render::{RenderError, RenderWarning};
use crate::volume::VolumeError;
use crate::vulkan::VulkanError;
use processes::Processes;
use terminal::{INTERRUPTED, Terminal};

/// Renders volumes with spectral materials and lights: march once, relight any number of times.
#[derive(Debug, Parser)]
#[command(version, arg_required_else_help = true, max_term_width = 110, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    /// Print results as JSON on standard output.
    #[arg(long, global = true)]
    json: bool,
    /// Show no progress bars, no warnings and no list of written files.
    #[arg(long, short, global = true)]
    quiet: bool,
}

const EXAMPLES: &str = "\
Examples:
  relume render -o frog.png                           the built-in scene
  relume view                                         the same in a window, with controls for its lights
  relume info head.mhd                                the contents of a volume
  relume slice head.mhd --axis z --at 66 -o s.png     one slice of it
  relume render scene.toml -o day.png --accumulators acc.exr
  relume relight acc.exr --light A -o evening.png     the same view under a light bulb
  relume page scene.toml -o picture.html              a page that relights in a browser, to send or publish
  relume design palette.toml --report palette.html    spectra for the target colours of a palette

The keys of a scene file are in docs/SCENE.md. `relume help COMMAND` describes a command.
Exit codes: 0 done, 1 failed, 2 wrong usage, 3 no usable Vulkan device, 130 interrupted.";

#[derive(Debug, Subcommand)]
enum Command {
    /// March a scene and write pictures, its film or spectra.
    Render(Box<render::Args>),
    /// Open a scene or a volume in a window and change its lights.
    View(view::Args),
    /// Write one slice of a volume as a picture, as the window shows it.
    Slice(Box<slice::Args>),
    /// Relight a saved film: no volume, no march, no GPU.
    Relight(relight::Args),
    /// Composite the parts of a film that `relume render --block` saved.
    Composite(composite::Args),
    /// Write a film or a scene as one HTML file that anyone can relight in a browser.
    Page(page::Args),
    /// Solve a palette for spectra with its target colours, and report conflicts.
    Design(design::Args),
    /// Render the figures of the paper.
    Figures(figures::Args),
    /// Describe a volume, the plan of a scene, or (without a file) the Vulkan devices.
    Info(info::Args),
    /// Write a volume as a file of bricks, from which `relume render` reads only those that it needs.
    Bricks(bricks::Args),
    /// Write a volume of any format as .nrrd, .mha, .nii or .nii.gz.
    Convert(convert::Args),
    /// Measure the cost and the error of each setting of a scene on this device, and the causes of the error.
    Measure(measure::Args),
    /// Measure the time of marching, relighting and reading, as a table or as JSON.
    Bench(bench::Args),
    /// Write or check the compiled shaders in `spirv/`.
    Shaders(shaders::Args),
    /// Print the completions of this command line for a shell.
    Completions(shell::CompletionsArgs),
    /// Write the manual pages.
    Man(shell::ManArgs),
}

/// Failure of a command.
#[derive(Debug, thiserror::Error)]
pub(crate) enum CliError {
    #[error(transparent)]
    Scene(#[from] SceneError),
    #[error(transparent)]
    Volume(#[from] VolumeError),
    #[error(transparent)]
    Preset(#[from] ImportError),
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Vulkan(#[from] VulkanError),
    #[error(transparent)]
    Palette(#[from] PaletteError),
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    #[error(transparent)]
    Output(#[from] OutputError),
    #[error(transparent)]
    Page(#[from] PageError),
    #[error(transparent)]
    Live(LiveError),
    #[error(transparent)]
    Measure(#[from] MeasureError),
    #[error(transparent)]
    Check(#[from] LadderError),
    #[error("the colour model cannot be fitted to the lights")]
    Lights(#[from] ModelError),
    #[error(transparent)]
    Shader(#[from] crate::shader::ShaderError),
    #[cfg(feature = "window")]
    #[error(transparent)]
    View(#[from] crate::view::ViewError),
    #[cfg(feature = "window")]
    #[error(transparent)]
    Script(#[from] crate::view::ScriptError),
    #[error("interrupted; finished pictures are complete")]
    Cancelled,
    #[error("rank {rank} of {count} processes failed")]
    OfRank { rank: usize, count: usize, source: Box<Self> },
    #[error("another process failed, and tells why")]
    Elsewhere,
    #[error("{0}")]
    Usage(String),
    #[error("{0}")]
    Failed(String),
}

impl CliError {
    /// Name for programs; it does not change between versions.
    pub(crate) fn code(&self) -> &'static str {
        match self {
            Self::Scene(error) => error.code(),
            Self::Volume(error) => error.code(),
            Self::Preset(error) => error.code(),
            Self::Render(error) => error.code(),
            Self::Vulkan(error) => error.code(),
            Self::Palette(error) => error.code(),
            Self::Plan(error) => error.code(),
            Self::Reference(error) => error.code(),
            Self::Output(error) => error.code(),
            Self::Page(error) => error.code(),
            Self::Live(error) => error.code(),
            Self::Measure(error) => error.code(),
            Self::Check(error) => error.code(),
            Self::Lights(error) => error.code(),
            Self::Shader(error) => error.code(),
            #[cfg(feature = "window")]
            Self::View(error) => error.code(),
            #[cfg(feature = "window")]
            Self::Script(error) => error.code(),
            Self::Cancelled => "cancelled",
            Self::OfRank { source, .. } => source.code(),
            Self::Elsewhere => "failed-elsewhere",
            Self::Usage(_) => "usage",
            Self::Failed(_) => "failed",
        }
    }
}

impl From<OpenError> for CliError {
    fn from(error: OpenError) -> Self {
        match error {
            OpenError::Scene(error) => Self::Scene(error),
            OpenError::Volume(error) => Self::Volume(error),
            OpenError::Preset(error) => Self::Preset(error),
            error => Self::Usage(error.to_string()),
        }
    }
}

impl From<LiveError> for CliError {
    fn from(error: LiveError) -> Self {
        match error {
            LiveError::Plan(error) => Self::Plan(error),
            LiveError::Render(error) => Self::Render(error),
            LiveError::Volume(error) => Self::Volume(error),
            LiveError::Page(error) => Self::Page(error),
            LiveError::TooLarge { .. } => Self::Live(error),
        }
    }
}

/// Returns the exit code of an error other than an interruption: 1 failed, 2 wrong usage, 3 no usable device.
fn exit_code(error: &CliError) -> u8 {
    let of_device = |error: &VulkanError| match error {
        VulkanError::NoLoader { .. }
        | VulkanError::NoDriver
        | VulkanError::NoDevice
        | VulkanError::NoMatch { .. }
        | VulkanError::Unsuitable { .. }
        | VulkanError::NoValidation => 3,
        _ => 1,
    };
    match error {
        CliError::OfRank { source, .. } => exit_code(source),
        CliError::Usage(_) | CliError::Scene(SceneError::LightRequest { .. } | SceneError::Define { .. }) => 2,
        CliError::Vulkan(error)
        | CliError::Render(RenderError::Vulkan(error))
        | CliError::Measure(MeasureError::Render(RenderError::Vulkan(error))) => of_device(error),
        #[cfg(feature = "window")]
        CliError::View(crate::view::ViewError::Vulkan(error)) => of_device(error),
        _ => 1,
    }
}

/// The arguments, with a list behind `--annotate` joined to it: without a list, the next argument may be a file.
fn with_joined_lists(arguments: impl Iterator<Item = OsString>) -> Vec<OsString> {
    let is_list = |text: &OsString| {
        let text = text.to_string_lossy();
        text.split(',').all(|name| files::ANNOTATIONS.contains(&name))
    };
    let mut joined: Vec<OsString> = Vec::new();
    for argument in arguments {
        match joined.last_mut() {
            Some(flag) if *flag == "--annotate" && is_list(&argument) => {
                flag.push("=");
                flag.push(argument);
            }
            _ => joined.push(argument),
        }
    }
    joined
}

/// Former names of flags, which are hidden aliases for one release.
const RENAMED: [(&str, &str); 2] = [("--situation", "--dial-preset"), ("--tour", "--loop")];

/// Prints warnings of a picture, with the flags that help.
fn warn_of(warnings: impl IntoIterator<Item = RenderWarning>) {
    for warning in warnings {
        let help = match warning {
            RenderWarning::Thin { .. } => " (--size)",
            _ => "",
        };
        tracing::warn!("{warning}{help}");
    }
}

/// Warns of the former names of flags among `arguments`.
fn warn_of_former_names(arguments: impl Iterator<Item = OsString>) {
    for argument in arguments {
        let argument = argument.to_string_lossy();
        let flag = argument.split('=').next().unwrap_or_default();
        if let Some((old, new)) = RENAMED.iter().find(|(old, _)| *old == flag) {
            tracing::warn!("{old} is now called {new}");
        }
    }
}

/// Runs a command.
fn run(
    command: &Command,
    processes: Option<&Processes>,
    terminal: &Terminal,
    started: std::time::Instant,
) -> Result<Report, CliError> {
    match command {
        Command::Render(args) => render::run(args, processes, terminal),
        Command::View(args) => view::run(args),
        Command::Slice(args) => slice::run(args, terminal),
        Command::Relight(args) => relight::run(args, terminal),
        Command::Composite(args) => composite::run(args, terminal),
        Command::Page(args) => page::run(args, terminal),
        Command::Design(args) => design::run(args, terminal),
        Command::Figures(args) => figures::run(args, terminal),
        Command::Info(args) => info::run(args, terminal),
        Command::Bricks(args) => bricks::run(args, terminal),
        Command::Convert(args) => convert::run(args, terminal),
        Command::Measure(args) => {
            terminal.wait_for_rows();
            measure::run(args, terminal)
        }
        Command::Bench(args) => {
            if args.makes_frames() {
                terminal.wait_for_rows();
            }
            bench::run(args, terminal, started)
        }
        Command::Shaders(args) => shaders::run(args, terminal),
        Command::Completions(args) => Ok(shell::completions(args)),
        Command::Man(args) => shell::man(args),
    }
}

/// Runs the command line; prints the result or the error.
pub fn main() -> ExitCode {
    ExitCode::from(run_on(&std::env::args_os().collect::<Vec<_>>()))
}

/// Runs the command line `arguments`, the first of which is the name of the program; prints the result or the error, and
/// returns the exit code.
pub fn run_on(arguments: &[OsString]) -> u8 {
    let started = std::time::Instant::now();
    let cli = Cli::parse_from(with_joined_lists(arguments.iter().cloned()));
    let (processes, refused) = match &cli.command {
        Command::Render(args) => args.processes().map_or_else(|error| (None, Some(error)), |found| (found, None)),
        _ => (None, None),
    };
    // Of several processes the first speaks.
    let is_silent = processes.as_ref().is_some_and(|processes| !processes.is_first());
    let terminal = Terminal::new(cli.quiet || is_silent, cli.json && !is_silent);
    if let Some(processes) = processes.as_ref().filter(|processes| processes.count() > 1) {
        terminal.end_with_others(processes.rank(), processes.count());
    }
    warn_of_former_names(arguments.iter().cloned());
    let outcome = match refused {
        Some(error) => Err(error),
        None => run(&cli.command, processes.as_ref(), &terminal, started),
    };
    terminal.finish();
    match outcome {
        Ok(mut report) => {
            report.json["warnings"] = terminal.warnings().into();
            // A result may be partial after Ctrl-C.
            let interrupted = report.json["interrupted"] == true;
            let missed = report.json["holds"] == false;
            // The result of these commands is files.
            let writes = matches!(
                cli.command,
                Command::Render(_)
                    | Command::Relight(_)
                    | Command::Slice(_)
                    | Command::Composite(_)
                    | Command::Bricks(_)
                    | Command::Page(_)
                    | Command::Figures(_)
                    | Command::Convert(_)
            ) || matches!(cli.command, Command::Design(_))
                && report.json["outputs"].as_array().is_some_and(|files| !files.is_empty());
            let printed = match (is_silent, cli.json) {
                (true, _) => Ok(()),
                (false, true) => terminal::conclude(&report.json_text()),
                (false, false) if cli.quiet && writes => Ok(()),
                (false, false) => terminal::conclude(&report.text),
            };
            if let Err(error) = printed {
                let failed = CliError::Failed(format!("cannot write the result to standard output: {error}"));
                terminal::complain(&failed, None);
                return 1;
            }
            if interrupted { INTERRUPTED } else { missed.into() }
        }
        Err(error) => {
            let error = match &processes {
                Some(processes) => processes.told(error),
                None => error,
            };
            let interrupted = terminal.cancelled();
            let code = if interrupted { INTERRUPTED } else { exit_code(&error) };
            let error = match error {
                error @ CliError::Cancelled => error,
                // The part of the work that noticed Ctrl-C first does not matter.
                _ if interrupted => CliError::Failed(terminal::TOLD.to_owned()),
                error => error,
            };
            if matches!(error, CliError::Elsewhere) {
                terminal::leave_to_others();
            } else {
                let json = (cli.json && !is_silent).then(|| error_json(&error, code, &terminal.warnings()));
                terminal::complain(&error, json.as_deref());
            }
            if let Some(processes) = processes {
                processes.end(code);
            }
            code
        }
    }
}

/// The error of a failed or interrupted command as JSON text: its code, its sentence and its causes, with the exit code and the
/// warnings.
fn error_json(error: &CliError, exit_code: u8, warnings: &[String]) -> String {
    let mut sentences = advice::sentences(error);
    let message = sentences.next();
    let mut json = serde_json::json!({
        "error": { "code": error.code(), "message": message, "causes": sentences.collect::<Vec<_>>() },
        "exit_code": exit_code,
        "warnings": warnings,
    });
    if exit_code == INTERRUPTED {
        json["interrupted"] = true.into();
    }
    format!("{:#}\n", sorted(json))
}

/// Result of a command as text and as JSON.
pub(crate) struct Report {
    /// Text for the terminal.
    pub(crate) text: String,
    /// JSON; names are stable.
    pub(crate) json: serde_json::Value,
}

impl Report {
    fn json_text(&self) -> String {
        format!("{:#}\n", sorted(self.json.clone()))
    }
}

/// `json` with the keys of its objects in alphabetical order; a feature of `serde_json`, which a dependency may turn on, keeps
/// the order in which they were inserted.
fn sorted(json: serde_json::Value) -> serde_json::Value {
    use serde_json::Value;
    match json {
        Value::Object(map) => {
            let mut entries: Vec<(String, Value)> = map.into_iter().map(|(key, value)| (key, sorted(value))).collect();
            entries.sort_by(|(one, _), (other, _)| one.cmp(other));
            Value::Object(entries.into_iter().collect())
        }
        Value::Array(list) => Value::Array(list.into_iter().map(sorted).collect()),
        other => other,
    }
}
