//! Frames of scenes on a device, timed and counted.

use std::time::{Duration, Instant};

use serde::Serialize;

use crate::film::RelightMatrices;
use crate::measure::{Stopwatch, Summary, Timing, peak_mb, summary};
use crate::plan::{Accumulate, Planned, plan};
use crate::progress::Progress;
use crate::render::{Renderer, SceneRenderer};
use crate::scene::{Aim, Mix, Scene, Shading};
use crate::volume::Statistics;
use crate::vulkan::DeviceKind;

use super::cases::{Case, Subject, Varied};
use super::{Args, CliError, Learnt};
use crate::cli::model::warn_of_plan;

/// Untimed frames before the timed ones.
const WARM_UP: u32 = 2;
/// Smallest total number of timed relights.
const RELIGHTS: u32 = 11;

/// Measurement of one case.
#[derive(Serialize)]
pub(super) struct Row {
    /// Identifier in comparisons with other runs.
    pub(super) id: String,
    pub(super) workload: String,
    /// Name of the group of rows, if the row is one of several.
    #[serde(skip_serializing_if = "str::is_empty")]
    pub(super) line: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) varied: Option<Varied>,
    volume: String,
    pub(super) size: [usize; 2],
    pub(super) shading: &'static str,
    accumulate: &'static str,
    model: Option<serde_json::Value>,
    components: usize,
    pub(super) lanes: usize,
    pub(super) positions: usize,
    device: String,
    pub(super) software: bool,
    pub(super) march: Times,
    pub(super) relight: Times,
    pub(super) counts: Counts,
    /// Time to the first picture of the process; `None` in later rows, when the device is already open.
    pub(super) startup_ms: Option<Summary>,
    /// Peak memory of the process so far, in MB.
    peak_mb: Option<f64>,
}

/// Counts that do not depend on the speed of the device, except the number of dispatches of a march.
#[derive(Serialize)]
pub(super) struct Counts {
    /// Bytes per finished pixel.
    pub(super) pixel_bytes: u64,
    /// Bytes of the volume on the device.
    pub(super) volume_bytes: u64,
    march_dispatches: usize,
    /// Dispatches of one relight.
    relight_dispatches: u64,
    /// Marches during the relights.
    relight_marches: u64,
    /// Bytes that one relight reads and writes.
    pub(super) relight_bytes: u64,
}

impl Row {
    /// What a pixel stores per light position: "4 weights", "k = 8 (nodes)".
    pub(super) fn keeps(&self) -> String {
        match self.model.as_ref().and_then(|model| model["kind"].as_str()) {
            Some(kind) => format!("k = {} ({kind})", self.components),
            None => format!("{} {}", self.components, self.accumulate),
        }
    }

    /// Name of the row for people.
    pub(super) fn name(&self) -> String {
        let line = if self.line.is_empty() { String::new() } else { format!(", {}", self.line) };
        let varied = self.varied.map_or_else(String::new, |varied| format!(" = {}", varied.value));
        format!("{}{varied}{line}", self.workload)
    }
}

/// Times of repeated work.
#[derive(Serialize)]
pub(super) struct Times {
    pub(super) wall_ms: Option<Summary>,
    pub(super) cpu_ms: Option<Summary>,
    /// By the device's own clock, if it has a working one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) device_ms: Option<Summary>,
}

impl Times {
    pub(super) fn of(times: &[Timing]) -> Self {
        let over = |value: fn(&Timing) -> f64| summary(&times.iter().map(value).collect::<Vec<_>>());
        Self { wall_ms: over(|time| time.wall_ms), cpu_ms: over(|time| time.cpu_ms), device_ms: None }
    }

    fn with_device(runs: &[(Timing, Option<Duration>)]) -> Self {
        let device: Option<Vec<f64>> = runs.iter().map(|(_, took)| Some(took.as_ref()?.as_secs_f64() * 1e3)).collect();
        let times: Vec<Timing> = runs.iter().map(|(time, _)| *time).collect();
        Self { device_ms: device.and_then(|times| summary(&times)), ..Self::of(&times) }
    }

    /// Time for comparisons, in ms: CPU time on software devices, because other programs disturb it least, and wall
    /// time on others.
    pub(super) fn cost_ms(&self, software: bool) -> f64 {
        let clock = if software { self.cpu_ms } else { self.wall_ms };
        clock.map_or(f64::NAN, |times| times.median)
    }
}

/// A device, and data kept for the next cases.
pub(super) struct Bench<'a> {
    args: &'a Args,
    renderer: &'a Renderer,
    progress: &'a dyn Progress,
    loaded: Option<Loaded>,
    /// The scene on the device, once per storage of its volume.
    resident: Vec<SceneRenderer>,
    /// Plans of the scene, each with the scene it was made for: a colour model is fitted, and warned of, once.
    plans: Vec<(Scene, Planned)>,
    /// Frames marched, and frames in total.
    frames: (u64, u64),
}

struct Loaded {
    key: (Subject, Option<u32>),
    scene: Scene,
    statistics: Statistics,
}

/// A case on the device, with its measurements so far.
struct Running<'a> {
    case: &'a Case,
    on_device: SceneRenderer,
    matrices: RelightMatrices,
    marches: Vec<(Timing, Option<Duration>)>,
    relights: Vec<(Timing, Option<Duration>)>,
    counts: Counts,
    startup_ms: Option<Summary>,
}

impl<'a> Bench<'a> {
    /// Starts a bench for `cases` cases in total.
    pub(super) fn new(args: &'a Args, renderer: &'a Renderer, progress: &'a dyn Progress, cases: usize) -> Self {
        let frames = (0, cases as u64 * u64::from(WARM_UP + args.frames));
        Self { args, renderer, progress, loaded: None, resident: Vec::new(), plans: Vec::new(), frames }
    }

    /// Measures `cases` one frame each in turn, so that other load on the machine affects them equally. With `started`,
    /// the start time of the program, the first case records the time to its first picture. After an error, `rows`
    /// contains the measurements so far.
    pub(super) fn measure(
        &mut self,
        cases: &[Case],
        mut started: Option<Instant>,
        rows: &mut Vec<Row>,
    ) -> Result<(), CliError> {
        let mut running: Vec<Running<'_>> = Vec::new();
        for case in cases {
            let mut one = self.prepare(case)?;
            one.frame(0, self, started.take())?;
            running.push(one);
        }
        let measured = (1..WARM_UP + self.args.frames)
            .try_for_each(|frame| running.iter_mut().try_for_each(|one| one.frame(frame, self, None)));
        rows.extend(running.into_iter().filter(|one| !one.marches.is_empty()).map(|one| one.row(self.renderer)));
        measured
    }

    /// Loads and plans the scene of `case`, and uploads it.
    fn prepare<'c>(&mut self, case: &'c Case) -> Result<Running<'c>, CliError> {
        let (renderer, progress) = (self.renderer, self.progress);
        let key = (case.subject, case.side);
        if self.loaded.as_ref().is_none_or(|loaded| loaded.key != key) {
            // Frees the previous scene first.
            (self.loaded, self.resident, self.plans) = (None, Vec::new(), Vec::new());
            let scene = case.scene(self.args, progress)?;
            if scene.accuracy.voxel_pixels > 0.0 {
                return Err(CliError::Usage(
                    "accuracy.voxel_pixels is not for bench, which marches the volume itself: -D accuracy.voxel_pixels=0 does \
                     so, and relume measure --sweep voxel_pixels=… times coarser levels"
                        .to_owned(),
                ));
            }
            let statistics = scene.volume().statistics()?;
            self.loaded = Some(Loaded { key, scene, statistics });
        }
        let Some(Loaded { scene, statistics, .. }) = &self.loaded else { return Err(CliError::Cancelled) };
        let mut scene = scene.clone();
        case.change(&mut scene)?;
        let known = self.plans.iter().find_map(|(before, planned)| planned.changed_to(before, &scene));
        let planned = match known {
            Some(planned) => planned,
            None => {
                let planned = plan(&scene, progress)?;
                warn_of_plan(&planned);
                self.plans.push((scene.clone(), planned.clone()));
                planned
            }
        };
        let on_device = match self.resident.iter().find(|resident| resident.holds(&scene, &planned)) {
            Some(resident) => resident.with_scene(scene, planned, progress)?,
            None => {
                let resident = SceneRenderer::with_plan(renderer, scene, planned, statistics.clone(), progress)?;
                self.resident.push(resident.clone());
                resident
            }
        };
        let counts = Counts {
            pixel_bytes: on_device.planned().plan.pixel_bytes(),
            volume_bytes: on_device.uploaded().bytes(),
            march_dispatches: 0,
            relight_dispatches: 0,
            relight_marches: 0,
            relight_bytes: 0,
        };
        let matrices = on_device.matrices(&Mix::of_scene(on_device.scene()));
        let (marches, relights) = (Vec::new(), Vec::new());
        Ok(Running { case, on_device, matrices, marches, relights, counts, startup_ms: None })
    }
}

impl Running<'_> {
    /// Marches and relights frame number `frame`; times both after the warm-up.
    fn frame(&mut self, frame: u32, bench: &mut Bench<'_>, started: Option<Instant>) -> Result<(), CliError> {
        let renderer = bench.renderer;
        let (done, all) = bench.frames;
        bench.progress.report(&format!("measuring {}", self.case.workload), done, all);
        bench.frames.0 += 1;
        if let Aim::Orbit { azimuth, .. } = &mut self.on_device.camera_mut().aim {
            *azimuth = -20.0 + 8.0 * f64::from(frame);
        }
        let clock = Stopwatch::start();
        let accumulators = self.on_device.march(self.case.size, bench.progress)?;
        let march = (clock.read(), accumulators.device_time);
        let relight = renderer.relight_display(&accumulators)?;
        relight.run(&self.matrices)?;
        if let Some(started) = started {
            self.startup_ms = summary(&[started.elapsed().as_secs_f64() * 1e3]);
        }
        if frame < WARM_UP {
            return Ok(());
        }
        self.marches.push(march);
        let before = (renderer.device().dispatches(), renderer.marches());
        let runs = RELIGHTS.div_ceil(bench.args.frames);
        for _ in 0..runs {
            let clock = Stopwatch::start();
            let took = relight.run(&self.matrices)?;
            self.relights.push((clock.read(), took));
        }
        self.counts.march_dispatches = accumulators.dispatches;
        self.counts.relight_dispatches = (renderer.device().dispatches() - before.0) / u64::from(runs);
        self.counts.relight_marches += renderer.marches() - before.1;
        self.counts.relight_bytes = relight.bytes();
        Ok(())
    }

    fn row(self, renderer: &Renderer) -> Row {
        let Self { case, on_device, marches, relights, counts, startup_ms, .. } = self;
        let (scene, planned) = (on_device.scene(), on_device.planned());
        let info = renderer.device().info();
        let shading = if scene.shading == Shading::None { "none" } else { "diffuse" };
        let varied = case.varied.map_or_else(String::new, |Varied { name, value }| format!(" {name}={value}"));
        let [width, height] = case.size;
        Row {
            id: format!("{} {}{varied} {shading} {width}x{height}", case.workload, case.line),
            workload: case.workload.clone(),
            line: case.line,
            varied: case.varied,
            volume: scene.volume().source.clone(),
            size: case.size,
            shading,
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
            march: Times::with_device(&marches),
            relight: Times::with_device(&relights),
            counts,
            startup_ms,
            peak_mb: peak_mb(),
        }
    }
}
