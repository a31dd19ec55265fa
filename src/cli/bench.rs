//! `relume bench`: how long marching, relighting, reading and designing take; how good colour models are.

use std::path::PathBuf;
use std::time::Instant;

use clap::ValueEnum;
use glam::DVec3;
use serde::Serialize;
use serde_json::json;

use relume::measure::{Stopwatch, Summary, Timing, peak_mb, summary};
use relume::model::ModelKind;
use relume::plan::{Accumulate, plan};
use relume::progress::Progress;
use relume::render::Renderer;
use relume::scene::{self, AccumulateAs, Aim, Material, Mix, Placement, Scene, SceneLight, SceneOptions, Shading};
use relume::spectrum::{Absorption, Spectrum};
use relume::vulkan::{Device, DeviceChoice, DeviceKind, Validation};

use super::accuracy::AccuracyArgs;
use super::model::Learnt;
use super::render::matrices;
use super::scene::{DefineArgs, SelectionArgs, size};
use super::{CliError, Report, bench_load, bench_model, bench_palette};

const EXAMPLES: &str = "\
Examples:
  relume bench                                        both workloads, shaded and not
  relume bench peer --volume frog.mhd --shading diffuse --frames 9 --json
  relume bench load --volume ct.nrrd                  reading, beside what decodes its bytes
  relume bench palette --frames 1                     how exact designed palettes are, and how long they take
  relume bench model --scenes 100                     errors of colour models, and whether automatic k keeps its word

Times are medians over the frames: CPU time of all threads, and wall time; --json has {median, min, max} of each.
startup_ms, from the start of the program to its first picture, is that of the first row of a process (n = 1), and null
in the others: the device is open by then. peak_mb is the most memory that the process has held so far, rows before
included.";

/// `relume bench`
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// What to measure.
    #[arg(value_enum, default_values_t = [Workload::Peer, Workload::Default])]
    workloads: Vec<Workload>,
    /// The real frog for the workloads `peer…`, in place of its phantom; what `load` reads.
    #[arg(long, value_name = "FILE")]
    volume: Option<PathBuf>,
    #[command(flatten)]
    selection: SelectionArgs,
    #[command(flatten)]
    accuracy: AccuracyArgs,
    /// Pixels across and down.
    #[arg(long, value_name = "WxH", default_value = "800x800", value_parser = size)]
    size: [usize; 2],
    /// Frames to measure, after two that warm up; how often `load` reads and `palette` solves.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// Scenes that colour models are measured on.
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u16).range(1..))]
    scenes: u16,
    #[command(flatten)]
    define: DefineArgs,
    /// Only this shading.
    #[arg(long, value_enum)]
    shading: Option<BenchShading>,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Workload {
    /// The scene that other renderers are set beside; its camera turns by 8° a frame.
    Peer,
    /// The same under four directional lights in four positions.
    PeerFourLights,
    /// The same with twice as many materials: eight weights a pixel.
    PeerEightMaterials,
    /// The same carried as linear RGB: what a renderer without spectra does.
    PeerRgb,
    /// The same carried as the eight numbers of a colour model.
    PeerK8,
    /// The peer's materials dyed, carried as linear RGB.
    PeerColouredRgb,
    /// The dyed materials carried as the eight numbers of a colour model.
    PeerColouredK8,
    /// The embedded default scene.
    Default,
    /// Colour models on seeded scenes: no march, no device.
    Model,
    /// Palettes designed: those of data/palettes and of the figures: no device.
    Palette,
    /// Reading a volume, beside what decodes its bytes: no device.
    Load,
}

impl Workload {
    fn needs_device(self) -> bool {
        !matches!(self, Self::Model | Self::Palette | Self::Load)
    }

    /// What the command line calls it.
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Whether it shows or reads what --volume names.
    fn takes_volume(&self) -> bool {
        !matches!(self, Self::Default | Self::Model | Self::Palette)
    }

    /// Whether it says itself what pixels keep, or has none.
    fn is_fixed(&self) -> bool {
        let fixed = matches!(self, Self::PeerRgb | Self::PeerK8 | Self::PeerColouredRgb | Self::PeerColouredK8);
        fixed || !self.needs_device()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum BenchShading {
    None,
    Diffuse,
}

/// One setting, measured.
#[derive(Serialize)]
struct Row {
    workload: String,
    volume: String,
    size: [usize; 2],
    shading: &'static str,
    accumulate: &'static str,
    model: Option<serde_json::Value>,
    components: usize,
    lanes: usize,
    positions: usize,
    device: String,
    software: bool,
    march: Times,
    relight: Times,
    /// To the first picture of the process; none in later rows, which find the device open.
    startup_ms: Option<Summary>,
    /// The most memory that the process has held so far, in MB.
    peak_mb: Option<f64>,
}

impl Row {
    /// What a pixel keeps of a position: "4 weights", "k = 8 (nodes)".
    fn keeps(&self) -> String {
        match self.model.as_ref().and_then(|model| model["kind"].as_str()) {
            Some(kind) => format!("k = {} ({kind})", self.components),
            None => format!("{} {}", self.components, self.accumulate),
        }
    }
}

#[derive(Serialize)]
pub(super) struct Times {
    pub(super) wall_ms: Option<Summary>,
    pub(super) cpu_ms: Option<Summary>,
}

impl Times {
    pub(super) fn of(times: &[Timing]) -> Self {
        let over = |value: fn(&Timing) -> f64| summary(&times.iter().map(value).collect::<Vec<_>>());
        Self { wall_ms: over(|time| time.wall_ms), cpu_ms: over(|time| time.cpu_ms) }
    }
}

pub(crate) fn run(args: &Args, progress: &dyn Progress, started: Instant) -> Result<Report, CliError> {
    if let (true, Some(flag)) = (args.workloads.iter().all(Workload::is_fixed), args.accuracy.given().first()) {
        return Err(CliError::Usage(format!(
            "{flag} does nothing here: these workloads say what pixels keep, or have none"
        )));
    }
    for flag in args.accuracy.given() {
        let fixed = args.workloads.iter().filter(|workload| workload.is_fixed()).map(|workload| workload.name());
        let fixed: Vec<String> = fixed.collect();
        if !fixed.is_empty() {
            tracing::warn!(
                "{flag} is for the other workloads: {} have or say themselves what pixels keep",
                fixed.join(", ")
            );
        }
    }
    if !args.define.is_empty() && args.workloads.iter().all(|workload| !workload.needs_device()) {
        return Err(CliError::Usage("-D does nothing here: these workloads have no scene".to_owned()));
    }
    let selection = args.selection.selection();
    let of_volumes = [
        ("--volume", args.volume.is_some()),
        ("--component", selection.component.is_some()),
        ("--time", selection.time.is_some()),
        ("--array", selection.array.is_some()),
    ];
    if let Some((flag, _)) = of_volumes.iter().find(|(_, given)| *given)
        && !args.workloads.iter().any(Workload::takes_volume)
    {
        return Err(CliError::Usage(format!("{flag} does nothing here: these workloads have what they show")));
    }
    let mut reports = Vec::new();
    if args.workloads.iter().any(|workload| workload.needs_device()) {
        reports.push(run_frames(args, progress, started)?);
    }
    if args.workloads.contains(&Workload::Model) {
        reports.push(bench_model::run(args.scenes.into(), progress)?);
    }
    if args.workloads.contains(&Workload::Palette) {
        reports.push(bench_palette::run(args.frames, progress)?);
    }
    if args.workloads.contains(&Workload::Load) {
        reports.push(bench_load::run(args.volume.as_deref(), &selection, args.frames, progress)?);
    }
    let mut all = Report { text: String::new(), json: json!({}) };
    for report in reports {
        all.text.push_str(&report.text);
        if let (Some(all), serde_json::Value::Object(part)) = (all.json.as_object_mut(), report.json) {
            all.extend(part);
        }
    }
    Ok(all)
}

/// Measures what needs a device.
fn run_frames(args: &Args, progress: &dyn Progress, started: Instant) -> Result<Report, CliError> {
    let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
    let mut rows = Vec::new();
    let mut started = Some(started);
    for &workload in args.workloads.iter().filter(|workload| workload.needs_device()) {
        for shading in [BenchShading::None, BenchShading::Diffuse] {
            if args.shading.is_none_or(|only| only == shading) {
                rows.push(measure(args, &renderer, workload, shading, progress, started.take())?);
            }
        }
    }
    let name = renderer.device().info();
    let mut text = format!(
        "{} ({}){}\n",
        name.name,
        name.driver,
        if name.kind == DeviceKind::Software { ", a software device: times are this CPU's" } else { "" }
    );
    text.push_str(
        "workload             shading  positions  keeps           lanes  march cpu ms (wall)     relight cpu ms (wall)  startup ms\n",
    );
    let median = |summary: Option<Summary>| summary.map_or(f64::NAN, |summary| summary.median);
    for row in &rows {
        text.push_str(&format!(
            "{:<20} {:<8} {:>9}  {:<14}  {:>5}  {:>9.1} ({:.1})  {:>16.2} ({:.2})  {:>10}\n",
            row.workload,
            row.shading,
            row.positions,
            row.keeps(),
            row.lanes,
            median(row.march.cpu_ms),
            median(row.march.wall_ms),
            median(row.relight.cpu_ms),
            median(row.relight.wall_ms),
            row.startup_ms.map_or_else(|| "-".to_owned(), |time| format!("{:.0}", time.median)),
        ));
    }
    Ok(Report { text, json: json!({ "rows": rows }) })
}

fn measure(
    args: &Args,
    renderer: &Renderer,
    workload: Workload,
    shading: BenchShading,
    progress: &dyn Progress,
    started: Option<Instant>,
) -> Result<Row, CliError> {
    let definitions = args.define.definitions().chain(args.accuracy.definitions()).collect();
    let options = SceneOptions { definitions, ..SceneOptions::default() };
    let mut scene = if workload == Workload::Default {
        scene::load_embedded(&options, progress)?
    } else {
        let (volume, selection) = (args.volume.clone(), args.selection.selection());
        scene::load_peer(&SceneOptions { volume, selection, ..options }, progress)?
    };
    if shading == BenchShading::None {
        scene.shading = Shading::None;
    }
    match workload {
        Workload::Peer | Workload::Default | Workload::Model | Workload::Palette | Workload::Load => {}
        Workload::PeerFourLights => add_peer_lights(&mut scene),
        Workload::PeerEightMaterials => {
            double_materials(&mut scene);
            // Fewer numbers would do for them, and what is measured is eight weights.
            if scene.accuracy.accumulate == AccumulateAs::Auto {
                scene.accuracy.accumulate = AccumulateAs::Weights;
            }
        }
        Workload::PeerRgb => carry(&mut scene, ModelKind::Rgb, 3),
        Workload::PeerK8 => carry(&mut scene, ModelKind::Nodes, 8),
        Workload::PeerColouredRgb => {
            dye(&mut scene)?;
            carry(&mut scene, ModelKind::Rgb, 3);
        }
        Workload::PeerColouredK8 => {
            dye(&mut scene)?;
            carry(&mut scene, ModelKind::Nodes, 8);
        }
    }
    let planned = plan(&scene, progress)?;
    let statistics = scene.volume.statistics()?;
    let uploaded = renderer.upload(&scene, &planned, &statistics, progress)?;
    let matrices = matrices(&scene, &planned, &Mix::of_scene(&scene));
    let (mut marches, mut relights) = (Vec::new(), Vec::new());
    let mut startup_ms = None;
    const WARM_UP: u32 = 2;
    let mut relit = None;
    for frame in 0..WARM_UP + args.frames {
        if let Aim::Orbit { azimuth, .. } = &mut scene.camera.aim {
            *azimuth = -20.0 + 8.0 * f64::from(frame);
        }
        let clock = Stopwatch::start();
        let accumulators = renderer.march(&scene, &planned, &uploaded, args.size, progress)?;
        let march = clock.read();
        if frame == 0 {
            let relight = renderer.relight_display(&accumulators)?;
            relight.run(&matrices)?;
            startup_ms = started.and_then(|started| summary(&[started.elapsed().as_secs_f64() * 1e3]));
        }
        if frame >= WARM_UP {
            marches.push(march);
        }
        relit = Some(accumulators);
    }
    if let Some(accumulators) = &relit {
        let relight = renderer.relight_display(accumulators)?;
        for frame in 0..WARM_UP + args.frames.max(11) {
            let clock = Stopwatch::start();
            relight.run(&matrices)?;
            if frame >= WARM_UP {
                relights.push(clock.read());
            }
        }
    }
    let info = renderer.device().info();
    Ok(Row {
        workload: workload.name(),
        volume: scene.volume.source.clone(),
        size: args.size,
        shading: if shading == BenchShading::None { "none" } else { "diffuse" },
        accumulate: match planned.plan.accumulate {
            Accumulate::Weights { .. } => "weights",
            Accumulate::Spectral { .. } => "spectral",
        },
        model: planned.model.as_ref().map(|model| Learnt::nothing(model).json(model)),
        components: planned.plan.components(),
        lanes: planned.plan.lanes(),
        positions: planned.positions.len(),
        device: format!("{} ({})", info.name, info.driver),
        software: info.kind == DeviceKind::Software,
        march: Times::of(&marches),
        relight: Times::of(&relights),
        startup_ms,
        peak_mb: peak_mb(),
    })
}

/// The peers' other three lights (shared/bench/peerlib.py), as directions; spectra do not enter a march.
fn add_peer_lights(scene: &mut Scene) {
    let Some(key) = scene.lights.first().cloned() else {
        return;
    };
    let directions = [[0.8, -0.2, -0.5], [-0.8, 0.3, -0.5], [0.1, 0.9, -0.4]];
    for (name, direction) in ["second", "third", "fourth"].into_iter().zip(directions) {
        let placement = Placement::Directional(DVec3::from_array(direction).normalize());
        scene.lights.push(SceneLight { name: name.to_owned(), placement, ..key.clone() });
    }
}

/// Carries spectra in `dimension` numbers of a colour model, though weights would be exact.
fn carry(scene: &mut Scene, model: ModelKind, dimension: usize) {
    scene.accuracy.accumulate = AccumulateAs::Spectral;
    scene.accuracy.model = model;
    scene.accuracy.dimension = Some(dimension);
}

/// Gives every material a dye of its own, whose optical depth at its peak is that of what the material scatters.
fn dye(scene: &mut Scene) -> Result<(), CliError> {
    const PEAKS_NM: [f64; 4] = [450.0, 510.0, 570.0, 630.0];
    for (material, peak) in scene.materials.iter_mut().zip(PEAKS_NM.into_iter().cycle()) {
        let dye = Spectrum::gaussian(peak, 40.0, 1.0).and_then(Absorption::new);
        material.absorption = Some(dye.map_err(|error| CliError::Failed(error.to_string()))?);
    }
    for term in &mut scene.transfer.terms {
        term.absorption = term.opacity.iter().map(|&(value, opacity)| (value, -(-opacity).ln_1p())).collect();
    }
    Ok(())
}

/// Shows every material twice, the second time under another name.
fn double_materials(scene: &mut Scene) {
    let materials = scene.materials.len();
    for material in scene.materials.clone() {
        scene.materials.push(Material { name: format!("{} again", material.name), ..material });
    }
    for mut term in scene.transfer.terms.clone() {
        for (_, material) in &mut term.material.0 {
            *material += materials;
        }
        scene.transfer.terms.push(term);
    }
}
