//! Instruments for developers: whether features, chosen settings, colour models and palettes keep their limits.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "results and progress are for the terminal")]

mod bricks;
#[cfg(feature = "mpi")]
mod composite;
mod consistency;
mod effects;
mod goals;
mod light_levels;
mod machines;
mod model;
mod needs;
mod nested;
mod out_of_core;
mod palette;
mod scattering;
mod shadows;
mod tables;

use std::error::Error;
use std::process::ExitCode;
use std::time::Duration;

use clap::{Parser, ValueEnum};
use serde_json::{Value, json};

use relume::measure::NodesBesideRgb;
use relume::model::{Amplification, ModelKind, Order};
use relume::progress::{Progress, Quiet};
use relume::render::Renderer;
use relume::spectrum::standard;
use relume::vulkan::{Device, DeviceChoice, Validation};

use bricks::{BrickRow, brick_rows};
use consistency::{halved_steps, relit_against_rendered};
use effects::effect_rows;
use goals::{GoalRow, GoalScene, GoalSummary, goal_row};
use light_levels::light_level_rows;
use machines::machine_rows;
use model::{AutomaticSummary, LIGHT_GROUPS, ModelSetting, automatic_dimension, model_row, nodes_beside_rgb};
use needs::{NeedRow, need_rows};
use nested::{NestedRow, nested_row};
use out_of_core::{OutOfCore, out_of_core};
use palette::palette_rows;
use scattering::{scattering_rows, stated_rows};
use shadows::{ShadowRow, shadow_rows};

const EXAMPLES: &str = "\
Examples:
  cargo bench --bench instruments -- needs
  cargo bench --bench instruments -- goals --scenes 50
  cargo bench --bench instruments -- model --scenes 100
  cargo bench --bench instruments -- palette --frames 3 --json";

/// Measures the renderer itself. Exits with 1 if a limit is missed.
#[derive(Debug, Parser)]
#[command(after_help = EXAMPLES)]
struct Args {
    /// The workload to measure.
    #[arg(value_enum, required = true)]
    instruments: Vec<Instrument>,
    /// Number of scenes for `model`, `goals` and `scattering-error`, and of palettes for `nested`.
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u16).range(1..))]
    scenes: u16,
    /// Number of runs of `palette`, and thousands of paths of `scattering` and `scattering-error`.
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// The frog for `shadows` and `effects`; default: the phantom.
    #[arg(long, value_name = "FILE")]
    volume: Option<std::path::PathBuf>,
    /// Scenes for `light-levels`.
    #[arg(long, value_name = "FILE", default_values = ["data/scenes/default.toml", "data/scenes/engine.toml"])]
    scene: Vec<std::path::PathBuf>,
    /// Voxels along each axis of the phantom for `bricks` and `machines`.
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u16).range(64..=2048))]
    edge: u16,
    /// Size of the volume of `out-of-core` in MiB.
    #[arg(long, value_name = "N", default_value_t = 6144, value_parser = clap::value_parser!(u16).range(768..=32768))]
    mib: u16,
    /// The program that `out-of-core` runs, such as a release build.
    #[arg(long, value_name = "FILE", default_value = env!("CARGO_BIN_EXE_relume"))]
    relume: std::path::PathBuf,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
    /// Print results as JSON on standard output.
    #[arg(long)]
    json: bool,
    /// Added by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Instrument {
    /// Cost of each scene feature in samples, dispatches, bytes and instructions, and that scenes without it do not
    /// pay.
    Needs,
    /// Whether pictures of seeded scenes keep their --max-error, and their cost relative to the cheapest setting that
    /// would. Fails if fewer than 95 of 100 scenes keep it, or if fewer than 95 take at most 1.3 times the samples and
    /// the time of the cheapest setting. --scenes 50 takes some minutes on two cores.
    Goals,
    /// Colour models on seeded scenes: no march, no device.
    Model,
    /// Error of the light grid against rays, and times of shadows beside the march without, in the frog of the peer scene.
    Shadows,
    /// Error and time of light that scatters more than once against --frames times 1,000 paths of a pixel, in the frog of the peer scene with
    /// voxels of four: no device.
    Scattering,
    /// Stated and true error of scattered light in --scenes seeded scenes, against --frames times 1,000 paths of a pixel. Fails if fewer
    /// than 95 of 100 are within what is stated, or one exceeds it by a factor of more than 1.3. --scenes 50 takes half an hour on two cores.
    ScatteringError,
    /// Cost of coloured shadows, phase functions and thin films beside the march without them, in the frog of the peer scene.
    Effects,
    /// Cost of a volume in bricks beside that of the whole volume. Fails above 1.25 times the march, or above twice with
    /// room for a quarter of them.
    Bricks,
    /// Error of shadows from coarse levels, as volumes in bricks have them, against those of the voxels.
    LightLevels,
    /// A simulated table of one picture composited by up to 1,024 machines: measured marches of blocks and rates of
    /// compositing, and a model of the network.
    Machines,
    /// Time to composite 61 MB in each of 1, 2 and 4 processes, which it starts by mpirun. Fails above 0.1 s for four.
    #[cfg(feature = "mpi")]
    Composite,
    /// A generated volume of --mib MiB that is never held: made into bricks, once interrupted, rendered with an eighth of it
    /// on the host and at most 512 MiB on the device, and compared with its formula. Takes its size twice on the disk of the
    /// temporary folder. Fails if the picture is not that of the formula, or if the render takes more than 1.25 times these
    /// memories beside what a small volume takes.
    OutOfCore,
    /// Design of the palettes in data/palettes and of the figures: no device.
    Palette,
    /// Random palettes within nested bounds: how often wider bounds end worse. Fails if bounds that contain the default
    /// ones, or a search from a known start, do. --scenes 400 takes half an hour on two cores. No device.
    Nested,
}

/// Progress on standard error, one line a stage.
struct Stages;

impl Progress for Stages {
    fn report(&self, stage: &str, done: u64, total: u64) {
        eprintln!("{stage}: {done} of {total}");
    }
}

/// Result of an instrument as text and as JSON; `holds` in the JSON says whether all limits are kept.
struct Report {
    text: String,
    json: Value,
}

fn main() -> ExitCode {
    let args = Args::parse();
    let mut json = json!({});
    let mut holds = true;
    for instrument in &args.instruments {
        let report = match run(*instrument, &args) {
            Ok(report) => report,
            Err(error) => {
                eprintln!("error: {error}");
                return ExitCode::FAILURE;
            }
        };
        holds &= report.json["holds"] != false;
        if let (Some(all), Value::Object(part)) = (json.as_object_mut(), report.json) {
            all.extend(part);
        }
        if !args.json {
            println!("{}", report.text);
        }
    }
    if args.json {
        json["holds"] = holds.into();
        println!("{json:#}");
    }
    if holds { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn run(instrument: Instrument, args: &Args) -> Result<Report, Box<dyn Error>> {
    match instrument {
        Instrument::Needs => needs(&args.device),
        Instrument::Shadows => {
            let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
            let rows = shadow_rows(&renderer, args.volume.as_deref())?;
            let holds = rows.iter().all(ShadowRow::holds);
            Ok(Report { text: shadows::text(&rows), json: json!({ "shadows": rows, "holds": holds }) })
        }
        Instrument::Scattering => {
            let rows = scattering_rows(args.volume.as_deref(), 1000 * args.frames as usize)?;
            Ok(Report { text: scattering::table(&rows), json: json!({ "scattering": rows }) })
        }
        Instrument::ScatteringError => {
            let rows = stated_rows(args.scenes, 1000 * args.frames as usize)?;
            let [within, largest] = scattering::kept(&rows);
            let holds = within >= 0.95 && largest <= 1.3;
            let json = json!({ "scattering_error": rows, "holds": holds });
            Ok(Report { text: scattering::stated_text(&rows), json })
        }
        Instrument::Effects => {
            let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
            let rows = effect_rows(&renderer, args.volume.as_deref())?;
            Ok(Report { text: effects::text(&rows), json: json!({ "effects": rows }) })
        }
        Instrument::Bricks => {
            let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
            let rows = brick_rows(&renderer, args.edge.into())?;
            let holds = rows.iter().all(BrickRow::holds);
            Ok(Report { text: bricks::text(&rows), json: json!({ "bricks": rows, "holds": holds }) })
        }
        Instrument::LightLevels => {
            let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
            let rows = light_level_rows(&renderer, &args.scene)?;
            Ok(Report { text: light_levels::text(&rows), json: json!({ "light_levels": rows }) })
        }
        Instrument::Machines => {
            let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
            let rows = machine_rows(&renderer, args.edge.into())?;
            Ok(Report { text: machines::text(&rows), json: json!({ "machines": rows }) })
        }
        #[cfg(feature = "mpi")]
        Instrument::Composite => {
            let rows = composite::composite_rows()?;
            let holds = rows.iter().all(composite::CompositeRow::holds);
            Ok(Report { text: composite::text(&rows), json: json!({ "composite": rows, "holds": holds }) })
        }
        Instrument::OutOfCore => beyond_memory(args),
        Instrument::Goals => goals(args.scenes, &args.device),
        Instrument::Model => models(args.scenes.into()),
        Instrument::Palette => {
            let rows = palette_rows(args.frames, &Quiet)?;
            Ok(Report { text: tables::palette::text(&rows), json: json!({ "palettes": rows }) })
        }
        Instrument::Nested => {
            let light = |name: &str| Some(standard::light(name).ok()?.spectrum().clone());
            let mut rows = Vec::new();
            for seed in 0..u64::from(args.scenes) {
                Stages.report("designing random palettes", seed, args.scenes.into());
                rows.push(nested_row(seed, light, &Quiet)?);
            }
            let holds = rows.iter().all(NestedRow::holds);
            Ok(Report { text: nested::text(&rows), json: json!({ "nested": rows, "holds": holds }) })
        }
    }
}

/// Renders a volume out of core.
fn beyond_memory(args: &Args) -> Result<Report, Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let (dims, memory) = OutOfCore::sizes(args.mib);
    let row = out_of_core(&args.relume, folder.path(), dims, memory, Duration::from_secs(1))?;
    let holds = row.is_true() && row.peak[1] - row.beside <= row.allowed();
    Ok(Report { text: out_of_core::text(&row), json: json!({ "out_of_core": row, "holds": holds }) })
}

fn needs(device: &DeviceChoice) -> Result<Report, Box<dyn Error>> {
    let renderer = Renderer::new(Device::open(device, Validation::Off)?);
    let rows = need_rows(&renderer, &Stages)?;
    let holds = rows.iter().all(NeedRow::holds);
    Ok(Report { text: tables::needs::text(&rows), json: json!({ "needs": rows, "holds": holds }) })
}

/// Chooses settings for `scenes` seeded scenes.
fn goals(scenes: u16, device: &DeviceChoice) -> Result<Report, Box<dyn Error>> {
    let renderer = Renderer::new(Device::open(device, Validation::Off)?);
    let mut rows: Vec<(u64, GoalRow)> = Vec::new();
    for seed in 0..u64::from(scenes) {
        Stages.report("choosing settings for seeded scenes", seed, scenes.into());
        rows.extend(goal_row(&renderer, &GoalScene::new(seed)?, &Quiet)?.map(|row| (seed, row)));
    }
    let only: Vec<GoalRow> = rows.iter().map(|(_, row)| row.clone()).collect();
    let summary = GoalSummary::of(&only);
    let missed = summary.as_ref().map_or_else(Vec::new, GoalSummary::missed);
    Ok(Report {
        text: tables::goals::text(&rows, scenes, summary.as_ref(), &missed),
        json: json!({ "goals": only, "goals_summary": summary, "missed": missed, "holds": missed.is_empty() }),
    })
}

const TOLERANCES: [f64; 3] = [2.0, 1.0, 0.5];
/// Above this number of scenes, the errors of fixed dimensions do not change.
const MOST_SCENES: usize = 12;

fn models(scenes: usize) -> Result<Report, Box<dyn Error>> {
    let settings: Vec<ModelSetting> = (0..LIGHT_GROUPS.len()).flat_map(settings).collect();
    let total = u64::try_from(settings.len() + scenes).unwrap_or(u64::MAX);
    let mut done = 0;
    let mut advance = || {
        Stages.report("measuring colour models", done, total);
        done += 1;
    };
    let mut models = Vec::new();
    for setting in settings {
        advance();
        models.push(model_row(setting, scenes.min(MOST_SCENES), &Quiet)?);
    }
    let mut automatic = Vec::new();
    for scene in 0..scenes {
        advance();
        for tolerance in TOLERANCES {
            automatic.push(automatic_dimension(scene, tolerance, &Quiet)?);
        }
    }
    let of = |tolerance: &f64| {
        AutomaticSummary::of(automatic.iter().filter(|row| row.tolerance.total_cmp(tolerance).is_eq()))
    };
    let summaries: Vec<AutomaticSummary> = TOLERANCES.iter().map(of).collect();
    let beside: Vec<(&str, NodesBesideRgb)> = LIGHT_GROUPS
        .iter()
        .filter_map(|&(lights, _)| Some((lights, nodes_beside_rgb(models.iter().filter(|row| row.lights == lights))?)))
        .collect();
    let (halved, relit) = (halved_steps(&Quiet)?, relit_against_rendered(&Quiet)?);
    let beside_json = |(lights, found): &(&str, NodesBesideRgb)| {
        json!({
            "lights": lights, "nodes": found.nodes, "rgb": found.rgb, "best": found.best, "ratio": found.ratio(),
        })
    };
    Ok(Report {
        text: tables::model::text(&models, &beside, &automatic, &summaries)
            + &tables::model::consistency(&halved, &relit),
        json: json!({
            "models": models,
            "nodes_beside_rgb": beside.iter().map(beside_json).collect::<Vec<_>>(),
            "automatic": automatic,
            "automatic_summary": summaries,
            "halved_steps": halved,
            "relit": relit,
        }),
    })
}

/// Settings to measure under one group of lights.
fn settings(lights: usize) -> Vec<ModelSetting> {
    let (held, kept) = (Amplification::Held, Amplification::Kept);
    let (step, semigroup) = (ModelKind::Sharpened(Order::Step), ModelKind::Sharpened(Order::Semigroup));
    [
        (ModelKind::Nodes, 4, 4, held),
        (ModelKind::Nodes, 4, 6, held),
        (ModelKind::Nodes, 4, 8, held),
        (ModelKind::Nodes, 4, 12, held),
        (ModelKind::Nodes, 8, 8, held),
        (step, 4, 8, held),
        (step, 4, 8, kept),
        (semigroup, 4, 8, held),
        (semigroup, 4, 8, kept),
        (ModelKind::Peercy, 4, 8, held),
        (ModelKind::Bands, 4, 8, held),
        (ModelKind::RgbNaive, 4, 3, held),
        (ModelKind::RgbPrefiltered, 4, 3, held),
        (ModelKind::RgbFitted, 4, 3, held),
    ]
    .into_iter()
    .map(|(kind, materials, dimension, amplification)| ModelSetting {
        kind,
        lights,
        materials,
        dimension,
        amplification,
    })
    .collect()
}
