//! Cost of bricks: the march of a volume that fits, whole and in bricks.

use std::error::Error;
use std::sync::Arc;

use serde::Serialize;

use relume::document::{SceneOptions, load_peer};
use relume::measure::Stopwatch;
use relume::progress::Quiet;
use relume::render::{BrickCounts, Renderer, SceneRenderer};
use relume::scene::{Interpolation, Shading};
use relume::volume::{Phantom, Volume};

/// Side of the pictures.
const SIDE: usize = 400;
/// Timed marches.
const RUNS: usize = 5;
/// Largest CPU time of the march in bricks that are all there, as a multiple of that of the whole volume, and largest time of the device
/// with room for a quarter of them.
const LIMITS: [f64; 2] = [1.25, 2.0];

/// CPU times of a scene, in ms: the medians of several marches.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct BrickRow {
    /// What was marched.
    pub(crate) name: String,
    /// The whole volume.
    pub(crate) whole_ms: f64,
    /// Bricks that are all there.
    pub(crate) bricks_ms: f64,
    /// Bricks in a pool with room for a quarter, their uploads included.
    pub(crate) quarter_ms: f64,
    /// Times of the same by the device's clock, uploads not included.
    pub(crate) device_ms: [f64; 3],
    /// The quarter's bricks.
    pub(crate) quarter: Option<BrickCounts>,
}

impl BrickRow {
    /// CPU time of bricks that are all there over that of the whole volume, and time of the device for a quarter.
    fn ratios(&self) -> [f64; 2] {
        [self.bricks_ms / self.whole_ms, self.device_ms[2] / self.device_ms[0]]
    }

    /// True if both keep their limits.
    pub(crate) fn holds(&self) -> bool {
        self.ratios().iter().zip(LIMITS).all(|(&ratio, limit)| ratio <= limit)
    }
}

fn median(mut times: Vec<f64>) -> f64 {
    times.sort_by(f64::total_cmp);
    times[times.len() / 2]
}

/// Measures the phantom frog of `edge` voxels along each axis.
pub(crate) fn brick_rows(renderer: &Renderer, edge: usize) -> Result<Vec<BrickRow>, Box<dyn Error>> {
    let mut scene = load_peer(&SceneOptions::default(), &Quiet)?.scene;
    scene.set_volume(Arc::new(Volume::phantom(Phantom::Frog, Some([edge; 3]))?));
    let mut rows = Vec::new();
    for (shading, interpolation, name) in [
        (Shading::None, Interpolation::Linear, "unshaded"),
        (Shading::None, Interpolation::ExactLinear, "unshaded, interpolated exactly"),
        (Shading::Gradient, Interpolation::Linear, "by gradients"),
    ] {
        (scene.shading, scene.accuracy.interpolation) = (shading, interpolation);
        let in_bricks = renderer.clone().always_in_bricks();
        let whole = SceneRenderer::new(renderer, scene.clone(), &Quiet)?;
        let bricks = SceneRenderer::new(&in_bricks.clone().with_memory(u64::MAX), scene.clone(), &Quiet)?;
        let visible = bricks.march([SIDE; 2], &Quiet)?.bricks.ok_or("no bricks")?.visible;
        whole.march([SIDE; 2], &Quiet)?;
        let (mut times, mut device) = ([Vec::new(), Vec::new(), Vec::new()], [Vec::new(), Vec::new(), Vec::new()]);
        let mut march = |i: usize, on_device: &SceneRenderer| -> Result<Option<BrickCounts>, Box<dyn Error>> {
            let watch = Stopwatch::start();
            let film = on_device.march([SIDE; 2], &Quiet)?;
            times[i].push(watch.read().cpu_ms);
            device[i].push(film.device_time.unwrap_or_default().as_secs_f64() * 1e3);
            Ok(film.bricks)
        };
        for _ in 0..RUNS {
            march(0, &whole)?;
            march(1, &bricks)?;
        }
        let pool_bytes = bricks.uploaded().bytes();
        let slots = u64::try_from(edge.div_ceil(64).pow(3))?;
        drop((whole, bricks));
        let memory = pool_bytes / slots * u64::try_from(visible.div_ceil(4))?;
        let mut quarter = None;
        for _ in 0..RUNS {
            // A new pool is empty.
            let on_device = SceneRenderer::new(&in_bricks.clone().with_memory(memory), scene.clone(), &Quiet)?;
            quarter = march(2, &on_device)?;
        }
        let [whole_ms, bricks_ms, quarter_ms] = times.map(median);
        let (name, device_ms) = (format!("{edge}³, {name}"), device.map(median));
        rows.push(BrickRow { name, whole_ms, bricks_ms, quarter_ms, device_ms, quarter });
    }
    Ok(rows)
}

/// The rows as a table.
pub(crate) fn text(rows: &[BrickRow]) -> String {
    let mut text = format!(
        "{SIDE}×{SIDE} pixels, medians of {RUNS}. CPU ms: whole, bricks, ratio, room for a quarter of them (with their uploads); \
         ms of the device: the same three, ratio of the last\n"
    );
    for row in rows {
        let BrickRow { name, whole_ms, bricks_ms, quarter_ms, device_ms: [whole, bricks, quarter], quarter: counts } =
            row;
        let [ratio, of_quarter] = row.ratios();
        text += &format!(
            "{name}: {whole_ms:.0}, {bricks_ms:.0}, {ratio:.2}, {quarter_ms:.0}; {whole:.0}, {bricks:.0}, {quarter:.0}, \
             {of_quarter:.2}; {counts:?}\n"
        );
    }
    text
}
