//! Choice of a setting for a scene on a device: the fastest within an error, or the most accurate within a time.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::Path;

use serde::Serialize;

use super::bench::Bench;
use super::cache::{Known, Point};
use super::candidates::{DIMENSIONS, SCALES, setting, voxels};
use super::clock::{Limit, Stopwatch, Timing};
use super::digits::short;
use super::error::MeasureError;
use super::goal::{Goal, Pixels, Wanted};
use super::scattered::{ChosenLight, ScatteredError, light_within};
use super::setting::Setting;
use relume_base::number::nearest;
use relume_base::progress::Progress;
use relume_render::Renderer;
use relume_scene::plan::plan;
use relume_scene::{Mix, Scene};
use relume_vulkan::DeviceKind;

/// Number of random pixels in which the choice measures errors.
const PIXELS: usize = 2048;
const SEED: u64 = 41;
/// Number of timed frames of a setting that is compared with others by time.
const FRAMES: usize = 5;
/// Fraction of the time budget that a choice may use; repeated timings differ a little.
const SHARE_OF_TIME: f64 = 0.92;
/// Fraction of the allowed error that a choice may use; the truth has a small error itself.
const SHARE_OF_ERROR: f64 = 0.97;
/// Step lengths per octave.
const PARTS: i32 = 8;
/// Range of n for step lengths of 2^(n/8) voxels: from 1/8 to 16 voxels.
const STEPS: RangeInclusive<i32> = -3 * PARTS..=4 * PARTS;
/// Time that the search for scattered light may expect of its next try, as a multiple of the least time of a search.
const LIGHT: f64 = 15.0;
/// Decrease of the step number that costs as much as the next smaller scale saves.
const STEPS_A_SCALE: i32 = PARTS;

/// A chosen setting and the reason for it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// The setting.
    pub setting: Setting,
    /// Its measured times and errors, without that of scattered light.
    pub point: Point,
    /// Stated error of scattered light, if light scatters more than once.
    pub scattered: Option<ScatteredError>,
    /// Whether all measurements came from the cache.
    pub from_cache: bool,
    /// Reason for the choice, in a sentence.
    pub why: String,
    /// What a search that ran out of time did not try, in words.
    pub untried: Vec<String>,
    /// All settings examined for the choice.
    #[serde(skip)]
    pub tried: Vec<Tried>,
}

/// Time that a search within an error may take.
///
/// A search that has found a setting ends at this time, and what it leaves out is told. The truth takes half of it at most,
/// but for 256 pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// Times of a frame of the fastest setting found.
    pub frames: f64,
    /// Least time, in ms: the truth takes as long for a picture of a fast device.
    pub least_ms: f64,
}

impl Patience {
    /// No limit.
    pub const ENDLESS: Self = Self { frames: f64::INFINITY, least_ms: f64::INFINITY };
}

impl Default for Patience {
    /// 20 frames: with the picture and its check, the run takes 30.
    fn default() -> Self {
        Self { frames: 20.0, least_ms: 8000.0 }
    }
}

/// A setting with its measurements.
pub type Tried = (Setting, Point);

/// A setting within the error limit, and its step number.
struct Kept {
    n: i32,
    dimension: Option<usize>,
    scale: f64,
    setting: Setting,
    point: Point,
    /// The next longer step, which exceeds the limit.
    broken: Option<Tried>,
}

/// Chooses the setting of `scene` under `mix` for the picture `wanted` on the device of `renderer`.
///
/// Chooses the step length, the dimension of a colour model if the scene needs one, and the number of marched pixels; within an error,
/// also the spacing and the directions of scattered light that the scene does not state. A frame takes as long with any of them.
/// All other knobs keep the scene's values. Measurements are cached in the folder `cache` by scene, volume, device and
/// version of this program, and are not repeated.
///
/// # Errors
///
/// [`MeasureError`].
pub fn choose(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    wanted: Wanted,
    cache: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Choice, MeasureError> {
    choose_within(renderer, scene, mix, (wanted, Patience::default()), cache, progress)
}

/// [`choose`] with a stated time of the search, if it is for an error.
///
/// # Errors
///
/// [`MeasureError`].
pub fn choose_within(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    (wanted, patience): (Wanted, Patience),
    cache: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Choice, MeasureError> {
    let asked = match wanted.goal {
        Goal::MaxError(error) => Some(error),
        Goal::Budget(_) => None,
    };
    let limit = (asked, Limit(LIGHT * patience.least_ms));
    let light = light_within(scene, mix, wanted.size, limit, progress)?;
    let lit = light.as_ref().map(|light| light.setting.applied(scene));
    let mut curve = Curve::new(renderer, lit.as_ref().unwrap_or(scene), mix, wanted.size, cache, progress)?;
    if light.as_ref().is_some_and(|light| light.is_cut) {
        curve.leave_out("finer scattered light".to_owned());
    }
    curve.light = light;
    curve.patience = matches!(wanted.goal, Goal::MaxError(_)).then_some(patience);
    if wanted.pixels == Pixels::Fewer {
        curve.scales = &SCALES;
    }
    let chosen = match wanted.goal {
        Goal::MaxError(error) => curve.within_error(error),
        Goal::Budget(ms) => curve.within_time(ms),
    };
    curve.keep();
    chosen
}

/// Measures times and errors of `scene` under `mix` in a picture of `size` on the device of `renderer`: with the
/// scene's own setting, and with steps an octave apart. Where a colour model is needed, each step is measured with
/// several dimensions. Measurements are cached as by [`choose`].
///
/// # Errors
///
/// [`MeasureError`].
pub fn curve(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    cache: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Vec<Tried>, MeasureError> {
    const OCTAVES: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
    let mut curve = Curve::new(renderer, scene, mix, size, cache, progress)?;
    let settings: Vec<Setting> = std::iter::once(Setting::default())
        .chain(curve.dimensions.iter().flat_map(|&dimension| OCTAVES.map(|n| setting(voxels(n), dimension, 1.0))))
        .collect();
    curve.settings = Some(settings.len());
    let measured: Result<(), MeasureError> =
        settings.iter().try_for_each(|setting| curve.point(setting, FRAMES).map(drop));
    curve.keep();
    measured.map(|()| curve.tried)
}

/// Measured settings of a scene, and the means to measure more.
struct Curve<'a> {
    renderer: &'a Renderer,
    scene: &'a Scene,
    mix: &'a Mix,
    size: [usize; 2],
    progress: &'a dyn Progress,
    device: String,
    known: Known,
    measured: usize,
    /// Total number of settings, if known in advance.
    settings: Option<usize>,
    tried: Vec<Tried>,
    /// Dimensions to choose from; a single `None` where weights are exact.
    dimensions: Vec<Option<usize>>,
    /// Those of [`SCALES`] to choose from, starting with 1.
    scales: &'static [f64],
    bench: Option<Bench<'a>>,
    /// Scattered light of the scene.
    light: Option<ChosenLight>,
    /// Lower limit of the step length for which the truth is computed, in world units.
    finest: f64,
    clock: Stopwatch,
    /// Limit of the time, if there is one.
    patience: Option<Patience>,
    /// Least frame time of the settings within the error, in ms; infinite before the first.
    fastest_ms: f64,
    untried: Vec<String>,
}

/// Progress that puts the number of the setting before each stage, because a setting has several long stages that each
/// start from zero. With a known number of settings, the progress of a stage counts as the progress of its setting.
struct Numbered<'a> {
    progress: &'a dyn Progress,
    number: usize,
    settings: Option<usize>,
}

impl Progress for Numbered<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) {
        match self.settings {
            None => self.progress.report(&format!("setting {}: {stage}", self.number), done, total),
            Some(settings) => {
                let (before, all) = ((self.number.saturating_sub(1)) as u64, settings as u64);
                let name = format!("{} of {settings} settings: {stage}", self.number);
                self.progress.report(
                    &name,
                    before.saturating_mul(total).saturating_add(done),
                    all.saturating_mul(total),
                );
            }
        }
    }

    fn cancelled(&self) -> bool {
        self.progress.cancelled()
    }
}

/// Step number `n`, in voxels.
fn step(n: i32) -> f64 {
    voxels(f64::from(n) / f64::from(PARTS))
}

/// Whether errors no longer fall with the step, because another cause dominates.
fn is_level(tried: &BTreeMap<i32, Tried>) -> bool {
    /// An error caused by the step falls below this fraction when the step is an octave shorter.
    const LEFT: f64 = 0.8;
    let Some((shortest, (_, least))) = tried.first_key_value() else { return false };
    let mut longer = tried.range(shortest + PARTS..);
    longer.next().is_some_and(|(_, (_, point))| least.at_most > LEFT * point.at_most)
}

impl<'a> Curve<'a> {
    fn new(
        renderer: &'a Renderer,
        scene: &'a Scene,
        mix: &'a Mix,
        size: [usize; 2],
        cache: Option<&Path>,
        progress: &'a dyn Progress,
    ) -> Result<Self, MeasureError> {
        let planned = plan(scene, progress)?;
        let info = renderer.device().info();
        let device = format!("{} {} {:?}", info.name, info.driver, info.api_version);
        let dimensions = match planned.model {
            None => vec![None],
            Some(_) => DIMENSIONS.map(Some).to_vec(),
        };
        let known = Known::of(cache, scene, mix, &device, size);
        Ok(Self {
            renderer,
            scene,
            mix,
            size,
            progress,
            device,
            known,
            measured: 0,
            settings: None,
            tried: Vec::new(),
            dimensions,
            scales: &SCALES[..1],
            bench: None,
            light: None,
            finest: 0.0,
            clock: Stopwatch::start(),
            patience: None,
            fastest_ms: f64::INFINITY,
            untried: Vec::new(),
        })
    }

    /// Time of the search in ms, if a frame takes `frame_ms`; infinite without a limit.
    fn time_for(&self, frame_ms: f64) -> f64 {
        self.patience.map_or(f64::INFINITY, |Patience { frames, least_ms }| (frames * frame_ms).max(least_ms))
    }

    /// Whether the search has found a setting and may take no more time.
    fn is_over(&self) -> bool {
        self.fastest_ms.is_finite() && self.clock.read().wall_ms >= self.time_for(self.fastest_ms)
    }

    /// Says what a search that is over leaves out.
    fn leave_out(&mut self, what: String) {
        if !self.untried.contains(&what) {
            self.untried.push(what);
        }
    }

    /// Measures `setting`, with at least `frames` timed frames, and records it as tried.
    fn point(&mut self, setting: &Setting, frames: usize) -> Result<Point, MeasureError> {
        let point = self.known_or_measured(setting, frames)?;
        self.try_out(setting, point);
        Ok(point)
    }

    fn try_out(&mut self, setting: &Setting, point: Point) {
        match self.tried.iter_mut().find(|(tried, _)| tried == setting) {
            Some((_, known)) => *known = point,
            None => self.tried.push((setting.clone(), point)),
        }
    }

    fn known_or_measured(&mut self, setting: &Setting, frames: usize) -> Result<Point, MeasureError> {
        let known = self.known.get(setting);
        if let Some(point) = known.filter(|point| point.frames >= frames) {
            return Ok(point);
        }
        let number = self.tried.len() + 1;
        let progress = &Numbered { progress: self.progress, number, settings: self.settings };
        let (finest, fastest) = (self.finest, self.fastest_ms);
        let ready = [self.bench()?.ready(setting, progress)?];
        let bench = self.bench()?;
        if known.is_none() {
            bench.check(&ready[0])?;
        }
        // Frames come first: they tell how much time the truth may take.
        let timed = bench.times(&ready, frames, progress)?.first().copied().unwrap_or_default();
        let limit = self.time_for(fastest.min(timed.wall_ms)) - self.clock.read().wall_ms;
        let bench = self.bench()?;
        let point = match known {
            Some(point) => point,
            None => {
                bench.truth_for(ready[0].step_length().max(finest), Limit(0.5 * limit), progress)?;
                let errors = bench.errors(&ready[0], progress)?;
                Point { error: errors.of_sample, at_most: errors.at_most, ..Point::default() }
            }
        };
        Ok(self.keep_times(setting, point, timed, frames))
    }

    fn bench(&mut self) -> Result<&mut Bench<'a>, MeasureError> {
        let bench = match self.bench.take() {
            Some(bench) => bench,
            None => {
                // A fifth of the least time, as no frame has been timed.
                let limit = Limit(self.patience.map_or(f64::INFINITY, |it| 0.2 * it.least_ms));
                let drawn = (PIXELS, SEED, limit);
                Bench::new(self.renderer, self.scene, self.mix, self.size, drawn, self.progress)?
            }
        };
        Ok(self.bench.insert(bench))
    }

    fn keep_times(&mut self, setting: &Setting, point: Point, times: Timing, frames: usize) -> Point {
        let point = Point { frame_ms: times.wall_ms, cpu_ms: times.cpu_ms, frames, ..point };
        self.measured += 1;
        self.known.insert(setting, point);
        point
    }

    /// Step number `n`, in world units.
    fn world(&self, n: i32) -> f64 {
        step(n) * self.scene.frame.geometry.spacing.min_element()
    }

    /// Cost by which settings are compared. On a software device it is the CPU time, which other programs disturb
    /// least.
    fn cost(&self, point: &Point) -> f64 {
        let software = self.renderer.device().info().kind == DeviceKind::Software;
        if software { point.cpu_ms } else { point.frame_ms }
    }

    /// The cheapest of `kept`. The candidates are timed again over more frames, in turns.
    fn cheapest(&mut self, mut kept: Vec<Kept>) -> Result<Option<Kept>, MeasureError> {
        /// Ratio of single-frame costs above which more frames do not reverse the order.
        const CLEARLY: f64 = 1.5;
        let least = kept.iter().map(|kept| self.cost(&kept.point)).fold(f64::INFINITY, f64::min);
        kept.retain(|kept| self.cost(&kept.point) <= CLEARLY * least);
        let progress = self.progress;
        let is_over = self.is_over();
        let mut again: Vec<&mut Kept> = kept.iter_mut().filter(|kept| kept.point.frames < FRAMES).collect();
        if !again.is_empty() && !is_over {
            let bench = self.bench()?;
            let ready: Result<Vec<_>, _> = again.iter().map(|kept| bench.ready(&kept.setting, progress)).collect();
            let times = bench.times(&ready?, FRAMES, progress)?;
            for (kept, times) in again.iter_mut().zip(times) {
                kept.point = self.keep_times(&kept.setting, kept.point, times, FRAMES);
                self.try_out(&kept.setting, kept.point);
            }
        }
        Ok(kept.into_iter().min_by(|one, two| self.cost(&one.point).total_cmp(&self.cost(&two.point))))
    }

    /// The cheapest setting whose p95 is at most `asked`.
    fn within_error(&mut self, asked: f64) -> Result<Choice, MeasureError> {
        let of_light = self.light.as_ref().map_or(0.0, |light| light.error.p95);
        if let Some(light) = self.light.as_ref().filter(|_| of_light >= asked) {
            let with =
                if light.setting == Setting::default() { String::new() } else { format!(" with {}", light.setting) };
            return Err(MeasureError::None {
                goal: Goal::MaxError(asked),
                nearest: format!("; its scattered light alone has up to {}{with}", short(of_light)),
            });
        }
        let limit = SHARE_OF_ERROR * (asked - of_light);
        let (mut best, mut nearest, mut too_large): (Option<Kept>, Option<Tried>, _) = (None, None, None);
        for &scale in self.scales {
            if self.is_over() {
                self.leave_out(format!("pictures of {scale} of the pixels across or fewer"));
                break;
            }
            match self.longest_steps(limit, scale, best.as_ref()) {
                Ok(Ok(kept)) => best = self.cheapest(best.into_iter().chain(kept).collect())?,
                Ok(Err(broken)) => {
                    nearest = broken;
                    break;
                }
                // Fewer pixels may fit.
                Err(error) if error.is_too_large() => too_large = Some(error),
                Err(error) => return Err(error),
            }
            if let Some(best) = &best {
                if best.scale.total_cmp(&scale).is_ne() {
                    break;
                }
                // Further truths need no shorter steps: relative to the allowed error, the error of the truth stays as
                // small.
                self.finest = self.world(best.n);
            }
        }
        let Some(best) = best else {
            return Err(too_large.filter(|_| nearest.is_none()).unwrap_or_else(|| MeasureError::None {
                goal: Goal::MaxError(asked),
                nearest: nearest.map_or_else(String::new, |(setting, point)| {
                    format!("; the nearest is {setting}, with {}", short(point.error.p95))
                }),
            }));
        };
        let Kept { setting, point, broken, .. } = best;
        let beyond = broken.map_or_else(String::new, |(beyond, broken)| {
            format!(
                "; {beyond} has ΔE00 {}, and up to {} including unmeasured pixels",
                short(broken.error.p95),
                short(broken.at_most)
            )
        });
        let why = format!(
            "{setting} is the fastest tried setting within ΔE00 {asked} in 95 % of the pixels: ΔE00 {} in {} ms per frame{beyond}",
            short(point.error.p95),
            short(point.frame_ms)
        );
        Ok(self.chosen(setting, point, why))
    }

    /// For each dimension worth trying at `scale`, the setting with the longest step within `limit`. If no setting is
    /// within it, the nearest one.
    ///
    /// `best`, if given, is the best setting at a larger scale. Then only its dimension is tried, with steps that take
    /// fewer samples than `best`.
    fn longest_steps(
        &mut self,
        limit: f64,
        scale: f64,
        best: Option<&Kept>,
    ) -> Result<Result<Vec<Kept>, Option<Tried>>, MeasureError> {
        let dimensions = best.map_or_else(|| self.dimensions.clone(), |best| vec![best.dimension]);
        let (mut kept, mut nearest): (Vec<Kept>, Option<Tried>) = (Vec::new(), None);
        for dimension in dimensions {
            if self.is_over() && !kept.is_empty() {
                let k = dimension.map_or_else(String::new, |k| k.to_string());
                self.leave_out(format!("colour models with k = {k} or more"));
                break;
            }
            let (steps, first) = match (kept.last(), best) {
                // A larger dimension takes longer and pays only if it allows longer steps.
                (Some(shorter), _) => (shorter.n + 1..=*STEPS.end(), shorter.n + 1),
                // Even shorter steps would cost more than the smaller number of pixels saves.
                (None, Some(best)) => {
                    let shortest = (best.n - STEPS_A_SCALE + 1).max(*STEPS.start());
                    (shortest..=best.n, shortest)
                }
                (None, None) => (STEPS, 0),
            };
            if steps.is_empty() {
                break;
            }
            match self.longest_step(limit, dimension, scale, steps, first)? {
                Ok(longer) => kept.push(longer),
                Err(_) if !kept.is_empty() => break,
                Err(broken) => {
                    if nearest.as_ref().is_none_or(|(_, nearest)| broken.1.error.p95 < nearest.error.p95) {
                        nearest = Some(broken);
                    }
                }
            }
        }
        Ok(if kept.is_empty() { Err(nearest) } else { Ok(kept) })
    }

    /// The setting of `dimension` and `scale` with the longest of `steps` within `limit`, or else the nearest one. The
    /// search starts at step `first`.
    fn longest_step(
        &mut self,
        limit: f64,
        dimension: Option<usize>,
        scale: f64,
        steps: RangeInclusive<i32>,
        first: i32,
    ) -> Result<Result<Kept, Tried>, MeasureError> {
        /// Approximate order of the error in the step; only predicts the next step to try.
        const ORDER: f64 = 1.7;
        let mut tried: BTreeMap<i32, Tried> = BTreeMap::new();
        let mut next = first;
        loop {
            let setting = setting(step(next), dimension, scale);
            let point = self.point(&setting, 1)?;
            tried.insert(next, (setting.clone(), point));
            if point.at_most <= limit {
                self.fastest_ms = self.fastest_ms.min(point.frame_ms);
            }
            let keeps = |n: &i32| tried.get(n).is_some_and(|(_, point)| point.at_most <= limit);
            let kept = tried.keys().copied().filter(keeps).max();
            let broken = tried.keys().copied().find(|n| !keeps(n) && kept.is_none_or(|kept| *n > kept));
            let low = kept.map_or(*steps.start(), |kept| kept + 1);
            let high = broken.map_or(*steps.end(), |broken| broken - 1);
            // An error caused by the colour model remains at every step, so the search ends early. With the largest
            // dimension, or with weights, it goes on to the end.
            let more_are_left = dimension.is_some_and(|k| k < DIMENSIONS[DIMENSIONS.len() - 1]);
            let done = low > high || kept.is_none() && more_are_left && is_level(&tried);
            let is_over = !done && kept.is_some() && self.is_over();
            if let (true, Some(kept)) = (is_over, kept) {
                self.leave_out(format!("steps longer than {} voxels", step(kept)));
            }
            if done || is_over {
                let broken = broken.and_then(|n| tried.get(&n).cloned());
                // If no step is within the limit, the last one tried is the shortest.
                return Ok(match kept.and_then(|n| Some((n, tried.remove(&n)?))) {
                    Some((n, (setting, point))) => Ok(Kept { n, dimension, scale, setting, point, broken }),
                    None => Err((setting, point)),
                });
            }
            let further = f64::from(PARTS) * (limit / point.at_most.max(1e-9)).log2() / ORDER;
            next = (next + nearest(further.clamp(-80.0, 80.0))).clamp(low, high);
        }
    }

    /// The setting with the smallest p95 that takes at most `asked` ms.
    fn within_time(&mut self, asked: f64) -> Result<Choice, MeasureError> {
        let limit = SHARE_OF_TIME * asked;
        let (mut least, mut too_large) = (f64::INFINITY, None);
        for dimension in self.dimensions.clone() {
            let (mut of_dimension, mut first) = (f64::INFINITY, 0);
            for &scale in self.scales {
                let (n, p95) = match self.shortest_step(limit, dimension, scale, first) {
                    // Fewer pixels may fit.
                    Err(error) if error.is_too_large() => {
                        too_large = Some(error);
                        continue;
                    }
                    found => found?,
                };
                // If fewer pixels add more error than shorter steps remove, still fewer pixels do as well.
                if of_dimension.is_finite() && p95 >= of_dimension {
                    break;
                }
                of_dimension = p95;
                if p95.is_finite() && n == *STEPS.start() {
                    break;
                }
                first = (n - STEPS_A_SCALE).max(*STEPS.start());
            }
            // A larger dimension takes longer; the search ends when it no longer reduces the error.
            if of_dimension >= least {
                break;
            }
            least = of_dimension;
        }
        let fits = |(_, point): &&Tried| point.frame_ms <= limit;
        let closest = self.tried.iter().filter(fits).min_by(|one, two| one.1.error.p95.total_cmp(&two.1.error.p95));
        if let Some((setting, point)) = closest.cloned() {
            let why = format!(
                "{setting} is the most accurate of the tried settings within {asked} ms a frame, with a margin: ΔE00 {} in 95 % of the pixels, in {} ms",
                short(point.error.p95),
                short(point.frame_ms)
            );
            return Ok(self.chosen(setting, point, why));
        }
        let fastest = self.tried.iter().min_by(|one, two| one.1.frame_ms.total_cmp(&two.1.frame_ms));
        Err(too_large.filter(|_| fastest.is_none()).unwrap_or_else(|| MeasureError::None {
            goal: Goal::Budget(asked),
            nearest: fastest.map_or_else(String::new, |(setting, point)| {
                format!("; the fastest is {setting}, with {} ms", short(point.frame_ms))
            }),
        }))
    }

    /// The shortest step of `dimension` and `scale` that takes at most `limit` ms, with the smallest p95 of the steps
    /// tried that do. If none does, the longest step and infinity. The search starts at step `first`.
    fn shortest_step(
        &mut self,
        limit: f64,
        dimension: Option<usize>,
        scale: f64,
        first: i32,
    ) -> Result<(i32, f64), MeasureError> {
        /// Number of tries predicted from the last time, before bisection. The prediction ignores the part of the
        /// frame time that does not depend on the step.
        const POINTED: usize = 3;
        let (mut low, mut high, mut next) = (*STEPS.start(), *STEPS.end(), first);
        let (mut found, mut least, mut tries) = (*STEPS.end(), f64::INFINITY, 0);
        while low <= high {
            let point = self.point(&setting(step(next), dimension, scale), FRAMES)?;
            // Longer steps are about as fast or faster.
            if point.frame_ms <= limit {
                (found, least, high) = (next, least.min(point.error.p95), next - 1);
            } else {
                low = next + 1;
            }
            tries += 1;
            // Time is about proportional to 1/Δs.
            let further = nearest((f64::from(PARTS) * (point.frame_ms / limit).log2()).clamp(-80.0, 80.0));
            next = if tries < POINTED { next + further } else { i32::midpoint(low, high) }.clamp(low, high.max(low));
        }
        Ok((found, least))
    }

    fn chosen(&self, setting: Setting, point: Point, mut why: String) -> Choice {
        let [[across, down], [width, height]] = [setting.marched_size(self.size), self.size];
        if [across, down] != self.size {
            why.push_str(&format!("; marched at {across}×{down} pixels and enlarged to {width}×{height}"));
        }
        let untried = self.untried.clone();
        if !untried.is_empty() {
            why.push_str(&format!(
                "; the search ended after {:.0} s, and did not try {}",
                self.clock.read().wall_ms / 1e3,
                untried.join(", ")
            ));
        }
        let scattered = self.light.as_ref().map(|light| light.error);
        let setting = match &self.light {
            None => setting,
            Some(ChosenLight { setting: of_light, error, .. }) => {
                let with = if *of_light == Setting::default() { String::new() } else { format!(" of {of_light}") };
                why.push_str(&format!("; scattered light{with} adds up to ΔE00 {}", short(error.p95)));
                setting.and(of_light.clone())
            }
        };
        Choice { setting, point, scattered, from_cache: self.measured == 0, why, untried, tried: self.tried.clone() }
    }

    /// Writes the measurements to the cache. A failure costs time in later runs, but no picture.
    fn keep(&self) {
        if self.measured > 0
            && let Err(error) = self.known.write(self.scene, &self.device)
        {
            tracing::warn!("cannot cache the measurements: {error}");
        }
    }
}
