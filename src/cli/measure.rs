//! `relume measure`: cost and error of each setting of a scene, with the causes of the error.

use std::collections::BTreeMap;
use std::io::IsTerminal as _;
use std::path::PathBuf;

use serde_json::{Value, json};

use crate::document::SceneFile;
use crate::measure::{
    Findings, MeasureError, Measured, NodesBesideRgb, Setting, Stopwatch, Survey, SurveyOptions, html, mark_pareto,
    settings, to_csv, to_markdown, to_text, trade,
};
use crate::number;
use crate::output::page::escaped;
use crate::output::{write_atomically, write_drawing};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer};
use crate::scene::Mix;
use crate::vulkan::{Device, DeviceChoice, Validation};

use super::advice::sentence;
use super::extremes;
use super::files;
use super::goal::{self, GoalArgs};
use super::page::{frame, small_page};
use super::scene::{SceneArgs, size};
use super::{CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume measure -o report.html                       every knob of the built-in scene
  relume measure scene.toml --sweep k=3..12,step=0.25..4 --csv
  relume measure scene.toml --sweep model=nodes,rgb-fitted --sweep storage=f16 --markdown
  relume measure --extremes                           results at extreme inputs, compared with their bounds

Errors are ΔE00 (1 is just visible side by side) against the truth: the full spectrum of 81 wavelengths in f64, exact samples
at an eighth of the shortest step, and no early ray termination. Only pixels that show the volume count. Errors are split by
cause, rung by rung: step, termination, level, basis, tables and storage, rounding, device; the parts need not add up. Times are
medians; a frame is a march and a relight. * marks settings on the Pareto front: no other is both faster and more accurate.";

/// Arguments of `relume measure`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Settings to measure in addition to that of the scene (repeatable). Relume combines all values of all given knobs.
    ///
    /// KNOB is model, k, accumulate, storage, step (in voxels), termination, rays (per pixel), integration, variation, spacing (of
    /// the light grid, in voxels), directions (of the sky), interpolation, labels, volume, gradients, entries, lookup, skipping, `voxel_pixels` (of
    /// coarser levels) or scale (of the picture, 0.05 to 1). Commas separate VALUES. A..B is a range: for k all whole numbers from A to B, for termination A, 10A, 100A and so on,
    /// for rays A, 4A, 16A, for other knobs A, 2A, 4A and so on. Without --sweep, every knob is swept by itself, but for those
    /// that take a truth of their own (rays) or have no effect on most scenes.
    #[arg(long, value_name = "KNOB=VALUES,…")]
    sweep: Vec<String>,
    /// Pixels across and down of the pictures that are timed.
    #[arg(long, value_name = "WxH", default_value = "400x400", value_parser = size)]
    size: [usize; 2],
    /// Number of pixels in which the error is measured, at most.
    #[arg(long, value_name = "N", default_value_t = 4096, value_parser = clap::value_parser!(u32).range(1..))]
    pixels: u32,
    /// Timed runs, after two for warming up.
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..))]
    runs: u16,
    #[command(flatten)]
    goal: GoalArgs,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them. auto prefers a GPU to the CPU.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
    /// Print all numbers as CSV.
    #[arg(long, conflicts_with_all = ["json", "markdown"])]
    csv: bool,
    /// Print the table as Markdown.
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
    /// Check extreme inputs in place of a scene: very large, very small and missing ones. Compares every rung, from f64 to
    /// the device, with its error bound. Exits with 1 if an error exceeds its bound.
    #[arg(long, conflicts_with_all = [
        "SceneArgs", "DefineArgs", "AccuracyArgs", "SelectionArgs", "RawArgs", "goal", "sweep", "size", "pixels", "runs",
        "output",
    ])]
    extremes: bool,
    /// Report to write (repeatable): .html is one page with everything, .svg and .png are the chart of time against
    /// error.
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
}

/// Result of a survey.
struct Outcome {
    rows: Vec<Measured>,
    /// Refused settings with their reasons.
    refused: Vec<(Setting, String)>,
    interrupted: bool,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    if args.extremes {
        // clap's group of arguments does not include the positional argument.
        if let Some(scene) = &args.scene.scene {
            return Err(CliError::Usage(format!(
                "the argument '--extremes' cannot be used with a scene, {}: it has scenes of its own",
                scene.display()
            )));
        }
        return extremes::run(&args.device, args.csv, args.markdown, progress);
    }
    let mut settings = settings(&args.sweep).map_err(|error| CliError::Usage(format!("--sweep {error}")))?;
    let outputs: Vec<&PathBuf> = args.output.iter().collect();
    let kinds: Vec<ReportKind> = outputs.iter().map(|path| report_kind(path)).collect::<Result<_, _>>()?;
    let file = args.scene.load(progress)?;
    let scene = &file.scene;
    let inputs: Vec<_> = file.inputs.iter().chain(&args.scene.scene).map(PathBuf::as_path).collect();
    files::check_outputs(&outputs, &inputs)?;
    let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
    let options = SurveyOptions {
        size: args.size,
        pixels: usize::try_from(args.pixels).unwrap_or(usize::MAX),
        runs: args.runs.into(),
    };
    let choice = match args.goal.goal() {
        Some(goal) => Some(goal::chosen(&renderer, scene, &Mix::of_scene(scene), args.size, goal, progress)?),
        None => None,
    };
    settings.extend(
        choice
            .iter()
            .map(|choice| choice.setting.clone())
            .filter(|setting| !settings.contains(setting))
            .collect::<Vec<_>>(),
    );
    progress.report("marching the truth", 0, settings.len() as u64);
    let mut survey = Survey::new(&renderer, scene, &settings, options, progress)?;
    let outcome = measure(&mut survey, &settings, progress)?;
    for (path, kind) in outputs.iter().zip(kinds) {
        match kind {
            ReportKind::Html => {
                let relit = relit(&renderer, &file, progress)?;
                let spectra = file.stated_spectra();
                write_text(path, &page(&mut survey, &outcome, &spectra, &relit, progress)?)?;
            }
            ReportKind::Svg => write_text(path, &trade(&outcome.rows))?,
            ReportKind::Png => {
                if !write_drawing(path, &trade(&outcome.rows), 1.5)? {
                    tracing::warn!("{}: this system has no fonts, so the picture has no text", path.display());
                }
            }
        }
    }
    let mut json = json(&survey, &options, &outcome);
    if let Some(choice) = &choice {
        json["choice"] = json!(choice);
    }
    let text = if args.csv {
        to_csv(&outcome.rows)
    } else if args.markdown {
        to_markdown(&outcome.rows)
    } else {
        text(&survey, &outcome) + &choice.map_or_else(String::new, |choice| format!("\n{}\n", choice.why))
    };
    Ok(Report { text, json })
}

/// Kind of a report.
#[derive(Clone, Copy)]
enum ReportKind {
    Html,
    Svg,
    Png,
}

fn report_kind(path: &std::path::Path) -> Result<ReportKind, CliError> {
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("html" | "htm") => Ok(ReportKind::Html),
        Some("svg") => Ok(ReportKind::Svg),
        Some("png") => Ok(ReportKind::Png),
        _ => Err(CliError::Usage(format!(
            "{}: unknown kind of report; end its name in .html, .svg or .png",
            path.display()
        ))),
    }
}

/// The number of settings in words.
fn settings_in_words(number: usize) -> String {
    if number == 1 { "1 setting".to_owned() } else { format!("{number} settings") }
}

/// Measures the settings one by one. A cancellation keeps the finished rows.
fn measure(survey: &mut Survey<'_>, settings: &[Setting], progress: &dyn Progress) -> Result<Outcome, CliError> {
    let mut outcome = Outcome { rows: Vec::new(), refused: Vec::new(), interrupted: false };
    // A terminal shows a bar in place of these notes.
    let is_told = !std::io::stderr().is_terminal();
    if is_told {
        tracing::info!("{} to measure", settings_in_words(settings.len()));
    }
    let clock = Stopwatch::start();
    let mut is_timed = false;
    for (done, setting) in settings.iter().enumerate() {
        if is_told && outcome.rows.len() == 1 && !is_timed {
            is_timed = true;
            let seconds = clock.read().wall_ms / 1e3 / number::count(done);
            let all = seconds * number::count(settings.len());
            tracing::info!("the first took {seconds:.1} s, so a pass over all takes about {all:.0} s");
        }
        progress.report(&format!("measuring {setting}"), done as u64, settings.len() as u64);
        match survey.measure(setting, progress) {
            Ok(row) => outcome.rows.push(row),
            Err(error) if progress.cancelled() => {
                if outcome.rows.is_empty() {
                    return Err(error.into());
                }
                outcome.interrupted = true;
                break;
            }
            // The scene refuses this setting; all others are measured.
            Err(MeasureError::Plan(error)) => outcome.refused.push((setting.clone(), sentence(&error))),
            Err(MeasureError::Render(error @ RenderError::Matrix)) => {
                outcome.refused.push((setting.clone(), sentence(&error)));
            }
            Err(error) => return Err(error.into()),
        }
    }
    if !outcome.interrupted {
        match survey.time_in_turn(&mut outcome.rows, progress) {
            Err(_) if progress.cancelled() => outcome.interrupted = true,
            timed => timed?,
        }
    }
    mark_pareto(&mut outcome.rows);
    Ok(outcome)
}

/// HTML page of the report.
fn page(
    survey: &mut Survey<'_>,
    outcome: &Outcome,
    spectra: &BTreeMap<String, String>,
    relit: &str,
    progress: &dyn Progress,
) -> Result<String, CliError> {
    // Skipped after a cancellation; the finished rows are reported.
    let close_up = match outcome.rows.first() {
        Some(own) if !outcome.interrupted => survey.close_up(own, progress)?,
        _ => None,
    };
    let findings = Findings {
        rows: &outcome.rows,
        refused: &outcome.refused,
        close_up: close_up.as_ref(),
        interrupted: outcome.interrupted,
        spectra,
        relit,
    };
    Ok(html(survey, &findings)?)
}

/// HTML of the scene as a small page that relights; empty after a cancellation.
fn relit(renderer: &Renderer, file: &SceneFile, progress: &dyn Progress) -> Result<String, CliError> {
    if progress.cancelled() {
        return Ok(String::new());
    }
    match small_page(renderer, file, progress) {
        Ok(page) => Ok(frame(&page, "The scene under any light")),
        Err(_) if progress.cancelled() => Ok(String::new()),
        // The numbers are worth a report without it.
        Err(CliError::Page(error)) => {
            Ok(format!("<p>There is no picture that relights: {}.</p>\n", escaped(&error.to_string())))
        }
        Err(error) => Err(error),
    }
}

fn write_text(path: &std::path::Path, text: &str) -> Result<(), CliError> {
    Ok(write_atomically(path, |sink| sink.write_all(text.as_bytes()))?)
}

fn json(survey: &Survey<'_>, options: &SurveyOptions, outcome: &Outcome) -> Value {
    let refused: Vec<Value> =
        outcome.refused.iter().map(|(setting, why)| json!({"setting": setting, "why": why})).collect();
    json!({
        "scene": survey.scene().name,
        "device": survey.device(),
        "size": options.size,
        "pixels": survey.pixels().len(),
        "runs": options.runs,
        "rows": outcome.rows,
        "refused": refused,
        "nodes_beside_rgb": NodesBesideRgb::of(&outcome.rows),
        "interrupted": outcome.interrupted,
    })
}

fn text(survey: &Survey<'_>, outcome: &Outcome) -> String {
    let mut text = format!(
        "{} on {}\nΔE00 against the full spectrum, in {} pixels that show the volume; * marks the Pareto front of time and error\n\n{}",
        survey.scene().name,
        survey.device(),
        survey.pixels().len(),
        to_text(&outcome.rows)
    );
    for (setting, why) in &outcome.refused {
        text.push_str(&format!("{setting}: {why}\n"));
    }
    if let Some(found) = NodesBesideRgb::of(&outcome.rows) {
        text.push_str(&format!("\n{}\n", found.sentence()));
    }
    if outcome.interrupted {
        text.push_str("\ninterrupted: only the finished settings are listed\n");
    }
    text
}
