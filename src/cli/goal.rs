//! `--max-error`, `--budget` and `--preset`: settings chosen by measurement.

use std::io::IsTerminal as _;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use clap::Args;
use serde_json::{Value, json};

use crate::document::Look;
use crate::measure::{Choice, Goal, Limit, Pixels, Preset, Wanted, cache_folder, check_within, choose};
use crate::progress::Progress;
use crate::render::Renderer;
use crate::scene::{Mix, Scene};

use super::CliError;
use super::accuracy::tolerance;

/// Heading in `--help`.
const CHOICE: &str = "Accuracy against time: measures settings of this scene on this device, and chooses one";

/// Goal of a picture.
#[derive(Debug, Args)]
#[group(id = "goal", multiple = false)]
pub(crate) struct GoalArgs {
    /// Use the fastest setting within this ΔE00 of the truth in 95 % of the pixels, and report the measured error.
    ///
    /// The limit applies to the total error of samples, colour model, tables, rounding and device; --tolerance limits only
    /// the colour model. Relume chooses the step, the dimension of the colour model and the number of marched pixels. If it
    /// marches a smaller picture, it enlarges it and measures the error at full size. It keeps the measurements in the
    /// user's cache folder. Where light scatters more than once, Relume also chooses the nodes and directions that the scene does not
    /// state, and adds their stated error. The search takes at most 20 times as long as a frame of the chosen setting, or 8 s, and says what it
    /// did not try.
    #[arg(long, help_heading = CHOICE, value_name = "DE", value_parser = tolerance, allow_negative_numbers = true)]
    max_error: Option<f64>,
    /// Use the most accurate setting whose frames (march, relight and enlargement) take at most this many milliseconds.
    #[arg(long, help_heading = CHOICE, value_name = "MS", value_parser = milliseconds, allow_negative_numbers = true)]
    budget: Option<f64>,
    /// Use a predefined goal: interactive (--budget 50), balanced (--max-error 1) or reference (--max-error 0.25).
    #[arg(long, help_heading = CHOICE, value_name = "NAME", value_parser = preset)]
    preset: Option<Preset>,
}

impl GoalArgs {
    pub(crate) fn goal(&self) -> Option<Goal> {
        let error = self.max_error.map(Goal::MaxError);
        error.or(self.budget.map(Goal::Budget)).or(self.preset.map(Preset::goal))
    }
}

/// Parses the name of a goal. The name of a look is told its flag.
fn preset(name: &str) -> Result<Preset, String> {
    Preset::of(name).map_err(|error| match Look::named(name) {
        Ok(_) => format!("{error}; for the look of a volume, use --look {name}"),
        Err(_) => error,
    })
}

fn milliseconds(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0 && number.is_finite());
    number.ok_or_else(|| "write a time in ms above 0, such as 40".to_owned())
}

/// Times of a frame that the check of the picture takes at most, and its least time in ms; but for 256 pixels.
const CHECK: (f64, f64) = (8.0, 4000.0);

/// Progress that also prints each stage, at most one a second: a terminal shows a bar in place of these notes.
struct Noted<'a> {
    progress: &'a dyn Progress,
    last: Mutex<(String, Option<Instant>)>,
}

impl Progress for Noted<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) {
        const PAUSE: Duration = Duration::from_secs(1);
        self.progress.report(stage, done, total);
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.0 != stage && last.1.is_none_or(|at| at.elapsed() >= PAUSE) {
            tracing::info!("{stage}");
            *last = (stage.to_owned(), Some(Instant::now()));
        }
    }

    fn cancelled(&self) -> bool {
        self.progress.cancelled()
    }
}

/// `work` with progress that is told from its first second on, also where no terminal shows it.
fn told<T>(progress: &dyn Progress, work: impl FnOnce(&dyn Progress) -> T) -> T {
    if std::io::stderr().is_terminal() {
        return work(progress);
    }
    work(&Noted { progress, last: Mutex::default() })
}

/// The search for `goal` in words.
fn sought(goal: Goal) -> String {
    match goal {
        Goal::MaxError(error) => format!("the fastest setting within ΔE00 {error} of the truth in 95 % of the pixels"),
        Goal::Budget(ms) => format!("the most accurate setting of which a frame takes at most {ms} ms"),
    }
}

/// Chooses the setting for `goal`.
pub(crate) fn chosen(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    goal: Goal,
    progress: &dyn Progress,
) -> Result<Choice, CliError> {
    let wanted = Wanted { size, goal, pixels: Pixels::Fewer };
    tracing::info!("measuring settings to find {}", sought(goal));
    progress.report("measuring settings", 0, 1);
    Ok(told(progress, |progress| choose(renderer, scene, mix, wanted, cache_folder().as_deref(), progress))?)
}

/// Measures the picture `rgba` of a choice; returns a line of text and JSON.
pub(crate) fn checked(
    choice: &Choice,
    args: &GoalArgs,
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    rgba: &[f32],
    progress: &dyn Progress,
) -> Result<(String, Value), CliError> {
    let limit = Limit((CHECK.0 * choice.point.frame_ms).max(CHECK.1));
    tracing::info!("the picture is written; measuring its error");
    let found = told(progress, |progress| check_within(scene, mix, size, rgba, limit, progress))?;
    let asked = match args.goal() {
        Some(Goal::MaxError(error)) => Some(error),
        _ => None,
    };
    let mut measured =
        found.map_or_else(|| "no pixel shows the volume: no error was measured".to_owned(), |it| it.sentence(asked));
    if let Some(scattered) = choice.scattered.filter(|_| found.is_some()) {
        measured.push_str(&format!("; scattered light, which this leaves out, adds up to {:.2}", scattered.p95));
    }
    if let (Some(asked), Some(found)) = (asked, &found)
        && found.difference.delta_e.p95 + choice.scattered.map_or(0.0, |scattered| scattered.p95) > asked
    {
        tracing::warn!("the error of the picture is above the limit: {measured}");
    }
    let json = json!({
        "setting": choice.setting,
        "expected": choice.point,
        "from_cache": choice.from_cache,
        "why": choice.why,
        "untried": choice.untried,
        "scattered_light": choice.scattered,
        "asked_error": asked,
        "asked_ms": match args.goal() {
            Some(Goal::Budget(ms)) => Some(ms),
            _ => None,
        },
        "measured": found,
    });
    let kept = match cache_folder() {
        _ if choice.from_cache => "; measured in an earlier run".to_owned(),
        Some(folder) => format!("; the measurements are kept in {} for the next run", folder.display()),
        None => String::new(),
    };
    Ok((format!("{}{kept}\n{measured}\n", choice.why), json))
}
