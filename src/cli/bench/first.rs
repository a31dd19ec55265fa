//! `relume bench first`: time of the first picture of a volume without a scene, by stages.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use serde_json::json;

use crate::document::first_look::scene_text;
use crate::document::{SceneOptions, Source, Wish};
use crate::measure::{Stopwatch, Timing, peak_mb};
use crate::number::count;
use crate::output::write_ready_png;
use crate::plan::plan_for;
use crate::progress::Progress;
use crate::render::{Renderer, SceneRenderer};
use crate::volume::{self, Selection};
use crate::vulkan::{Device, DeviceChoice, Validation};

use super::frames::Times;
use super::{CliError, Report};

/// A stage of a first picture, in the order of `relume render VOLUME`.
#[derive(Serialize)]
struct Stage {
    name: &'static str,
    times: Times,
}

/// Stages of a first picture. The first three are parts of the fourth, which makes the scene and so runs them again; the
/// others are those of every picture.
const STAGES: [&str; 10] =
    ["reading", "statistics", "guess", "scene", "plan", "device", "upload", "march", "relight", "writing"];

/// Makes the first picture of `path` once from the start of the program at `started`, and `times` times after it.
pub(super) fn run(
    path: &Path,
    selection: &Selection,
    (size, device): ([usize; 2], &DeviceChoice),
    times: u32,
    progress: &dyn Progress,
    started: Instant,
) -> Result<Report, CliError> {
    let folder = tempfile::tempdir().map_err(|error| CliError::Failed(format!("no temporary folder: {error}")))?;
    let output = folder.path().join("first.png");
    let options = SceneOptions { selection: selection.clone(), ..SceneOptions::default() };
    let source = Source { path: Some(path.to_owned()), options };
    if source.bare_volume().is_none() {
        let message = format!("--volume {}: first looks are of volumes without a scene", path.display());
        return Err(CliError::Usage(message));
    }
    let mut startup_ms = None;
    let mut spent: Vec<Vec<Timing>> = STAGES.iter().map(|_| Vec::new()).collect();
    let mut peak = None;
    let mut spans = [0.0; 2];
    // The first picture of the program is as a user's: the whole of it counts, and no stage is read twice.
    for time in 0..=times {
        let mut stages = Vec::with_capacity(STAGES.len());
        let mut clock = Stopwatch::start();
        let mut ended = |clock: &mut Stopwatch| {
            stages.push(clock.read());
            *clock = Stopwatch::start();
        };
        if time > 0 {
            let mut volume = std::sync::Arc::new(volume::open(path, selection, progress)?);
            ended(&mut clock);
            let statistics = volume.statistics()?;
            ended(&mut clock);
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            std::hint::black_box(scene_text(&name, &mut volume, &statistics, Wish::default(), progress).ok());
            ended(&mut clock);
        }
        let (file, statistics) = source.read(progress)?;
        ended(&mut clock);
        let planned = plan_for(&file.scene, &[], progress)?;
        ended(&mut clock);
        let renderer = Renderer::new(Device::open(device, Validation::Off)?);
        renderer.check_picture(&planned.plan, size, 0)?;
        ended(&mut clock);
        let on_device = SceneRenderer::with_plan(&renderer, file.scene.clone(), planned, statistics, progress)?;
        ended(&mut clock);
        let film = on_device.march(size, progress)?;
        ended(&mut clock);
        let relight = renderer.relight_display(&film)?;
        relight.run(&on_device.matrices(&file.opening_mix()))?;
        let codes: Vec<u8> = relight.read()?;
        ended(&mut clock);
        let rgb: Vec<u8> = codes.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
        spans = visible_spans(size, &rgb);
        write_ready_png(&output, size[0], size[1], &rgb)?;
        ended(&mut clock);
        if time == 0 {
            startup_ms = Some(started.elapsed().as_secs_f64() * 1e3);
            peak = peak_mb();
            continue;
        }
        for (of_stage, time) in spent.iter_mut().zip(stages) {
            of_stage.push(time);
        }
    }
    let stages: Vec<Stage> =
        STAGES.iter().zip(&spent).map(|(name, times)| Stage { name, times: Times::of(times) }).collect();
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
    let startup_ms = startup_ms.unwrap_or(f64::NAN);
    let mut text = format!(
        "{name}, first picture of {}×{} pixels: {startup_ms:.0} ms from the start of the program\n",
        size[0], size[1]
    );
    let _ = writeln!(text, "medians of {times} more: {:>14}  {:>7}", "wall ms", "cpu ms");
    for Stage { name, times } in &stages {
        let median = |summary: &Option<crate::measure::Summary>| summary.map_or(f64::NAN, |it| it.median);
        let _ = writeln!(text, "{name:<29}  {:>7.1}  {:>7.1}", median(&times.wall_ms), median(&times.cpu_ms));
    }
    let parts = "reading, statistics and guess are parts of scene";
    let _ = writeln!(text, "{parts}; pixels brighter than {DARK} of 255 span {:.3} × {:.3}", spans[0], spans[1]);
    let json = json!({
        "first": {"volume": name, "spans": spans, "size": size, "startup_ms": startup_ms, "peak_mb": peak, "stages": stages},
    });
    Ok(Report { text, json })
}

/// Code value up to which a pixel is not visible beside black.
const DARK: u8 = 12;

/// Fractions of the width and the height of a picture that its visible pixels span.
fn visible_spans([width, height]: [usize; 2], rgb: &[u8]) -> [f64; 2] {
    let visible = rgb.chunks_exact(3).enumerate().filter(|(_, pixel)| pixel.iter().any(|&code| code > DARK));
    let [mut low, mut high] = [[usize::MAX; 2], [0; 2]];
    for (index, _) in visible {
        for (axis, at) in [index % width, index / width].into_iter().enumerate() {
            low[axis] = low[axis].min(at);
            high[axis] = high[axis].max(at + 1);
        }
    }
    [(0, width), (1, height)].map(|(axis, side)| count(high[axis].saturating_sub(low[axis])) / count(side))
}
