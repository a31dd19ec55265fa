//! The setting that a scene needs on a device: the fastest within an error, or the closest to the truth within a time.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::bench::Bench;
use super::cache::Known;
use super::clock::Timing;
use super::ladder::LadderError;
use super::setting::{Knob, Setting, Value};
use super::table::short;
use crate::model::ErrorSummary;
use crate::number::{count, nearest};
use crate::plan::{PlanError, plan};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer};
use crate::scene::{Mix, Scene};
use crate::vulkan::DeviceKind;

/// What is asked of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// ΔE00 from the truth that 95 of 100 pixels keep.
    MaxError(f64),
    /// Time of a frame, march and relight (and enlarging), on the wall, in ms.
    Budget(f64),
}

/// Which pixels of a picture are marched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// All.
    All,
    /// Fewer where that serves what is asked for, and the picture is enlarged ([`Enlargement`](super::Enlargement)).
    Fewer,
}

/// A picture, and what is asked of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Its pixels across and down.
    pub size: [usize; 2],
    /// What is asked of it.
    pub goal: Goal,
    /// Which of its pixels are marched.
    pub pixels: Pixels,
}

/// Points on the curve of what can be had.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Fast enough to turn the picture by hand.
    Interactive,
    /// No pixel but a few looks different.
    Balanced,
    /// Nobody sees a difference.
    Reference,
}

impl Preset {
    /// What it asks for.
    #[must_use]
    pub const fn goal(self) -> Goal {
        match self {
            Self::Interactive => Goal::Budget(50.0),
            Self::Balanced => Goal::MaxError(1.0),
            Self::Reference => Goal::MaxError(0.25),
        }
    }
}

/// Pixels that the choice looks at.
const PIXELS: usize = 2048;
const SEED: u64 = 41;
/// Frames that are timed of a setting that is chosen from others by its time.
const FRAMES: usize = 5;
/// The share of a time that a choice uses up: other times differ a little.
const SHARE_OF_TIME: f64 = 0.92;
/// The share of an error: the truth that it is told from is a little off itself.
const SHARE_OF_ERROR: f64 = 0.97;
/// Parts of an octave by which steps differ.
const PARTS: i32 = 8;
/// Steps are 2^(n/8) voxels, for n in this range: between an eighth and 16.
const STEPS: RangeInclusive<i32> = -3 * PARTS..=4 * PARTS;
/// What a pixel keeps where weights are not exact: whole vectors, which cost what their spare numbers would.
pub(super) const DIMENSIONS: [usize; 4] = [4, 8, 12, 16];
/// Shares of the pixels across that are marched: half of all pixels less each time.
pub(super) const SCALES: [f64; 7] = [1.0, 0.71, 0.5, 0.35, 0.25, 0.18, 0.125];
/// By how many steps shorter the march of one of them takes as long as that of the one before.
const STEPS_A_SCALE: i32 = PARTS;

/// What was measured of a setting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// March and relight (and enlarging) on the wall, the median, in ms.
    pub frame_ms: f64,
    /// The same of all threads of this process on a CPU.
    pub cpu_ms: f64,
    /// Over so many frames.
    pub frames: usize,
    /// ΔE00 from the truth in the pixels that were looked at: the mean, p95 and the largest.
    pub error: ErrorSummary,
    /// ΔE00 that 95 of 100 of all pixels keep, which is said wrongly once in a hundred times.
    pub at_most: f64,
}

/// A setting that was chosen, and why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// Where the knobs stand.
    pub setting: Setting,
    /// What it was measured to take and to err by.
    pub point: Point,
    /// Whether nothing had to be measured, because all of it was before.
    pub from_cache: bool,
    /// Why this one, in a sentence.
    pub why: String,
    /// Everything that was looked at for it.
    #[serde(skip)]
    pub tried: Vec<Tried>,
}

/// A setting with what was measured of it.
pub type Tried = (Setting, Point);

/// A setting that keeps an error, and how long its steps are.
struct Kept {
    n: i32,
    dimension: Option<usize>,
    scale: f64,
    setting: Setting,
    point: Point,
    /// The next longer step, which does not.
    broken: Option<Tried>,
}

/// Why nothing was chosen.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChoiceError {
    /// No setting does what is asked for.
    #[error("no setting keeps {asked} here; {nearest}")]
    None {
        /// What was asked for.
        asked: String,
        /// What comes nearest, and the way out.
        nearest: String,
    },
    /// The scene shows nothing, so that nothing can be measured.
    #[error("{source_name} shows nothing in this picture, so that no error can be measured")]
    Nothing {
        /// The scene.
        source_name: String,
    },
    /// There is no plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The reference gave up.
    #[error(transparent)]
    Ladder(#[from] LadderError),
    /// The device gave up.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl ChoiceError {
    /// Whether the device holds a picture of fewer pixels.
    fn is_too_large(&self) -> bool {
        matches!(self, Self::Render(RenderError::PictureSize { .. } | RenderError::PictureMemory { .. }))
    }
}

/// The setting of `scene` under `mix` that makes the picture that is `wanted` on the device of `renderer`.
///
/// Steps, the numbers of a colour model where there is one, and how many pixels are marched are chosen; all other knobs stay
/// as the scene has them.
/// What is measured is kept in the folder `cache`, by scene, volume, device and version of this program, and not measured
/// again.
///
/// # Errors
///
/// [`ChoiceError`].
pub fn choose(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    wanted: Wanted,
    cache: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Choice, ChoiceError> {
    let mut curve = Curve::new(renderer, scene, mix, wanted.size, cache, progress)?;
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

/// What `scene` as it is, and with steps an octave apart, takes and errs by in a picture of `size` under `mix` on the device
/// of `renderer`; where a colour model is needed, with several numbers of it. Kept as by [`choose`].
///
/// # Errors
///
/// [`ChoiceError`].
pub fn curve(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    cache: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Vec<Tried>, ChoiceError> {
    const OCTAVES: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
    let mut curve = Curve::new(renderer, scene, mix, size, cache, progress)?;
    let settings: Vec<Setting> = std::iter::once(Setting::default())
        .chain(curve.dimensions.iter().flat_map(|&dimension| OCTAVES.map(|n| setting(voxels(n), dimension, 1.0))))
        .collect();
    curve.settings = Some(settings.len());
    let measured: Result<(), ChoiceError> =
        settings.iter().try_for_each(|setting| curve.point(setting, FRAMES).map(drop));
    curve.keep();
    measured.map(|()| curve.tried)
}

/// What is known of the settings of a scene, and the means to know more.
struct Curve<'a> {
    renderer: &'a Renderer,
    scene: &'a Scene,
    mix: &'a Mix,
    size: [usize; 2],
    progress: &'a dyn Progress,
    device: String,
    known: Known,
    measured: usize,
    /// How many settings there will be, where that is known.
    settings: Option<usize>,
    tried: Vec<Tried>,
    /// Where weights are exact none are chosen.
    dimensions: Vec<Option<usize>>,
    /// Those of [`SCALES`] that may be chosen, 1 first.
    scales: &'static [f64],
    bench: Option<Bench<'a>>,
    /// The truth is made for no shorter steps than this, in world units.
    finest: f64,
}

/// Says of each stage which setting it is for: several stages long, each begins anew. Where the number of settings is known,
/// what is done of a stage is done of its setting.
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

/// A step of so many octaves of a voxel, to three digits.
pub(super) fn voxels(octaves: f64) -> f64 {
    let exact = octaves.exp2();
    let digit = 10_f64.powf(exact.log10().floor() - 2.0);
    let rounded = (exact / digit).round() * digit;
    // Without the last bits of that product.
    format!("{rounded:.6}").parse().unwrap_or(exact)
}

/// Step number `n`, in voxels.
fn step(n: i32) -> f64 {
    voxels(f64::from(n) / f64::from(PARTS))
}

/// A step of so many voxels, so many numbers of a colour model where there is one, and such a share of the pixels across.
pub(super) fn setting(step: f64, dimension: Option<usize>, scale: f64) -> Setting {
    let mut setting = Setting::default().with(Knob::Step, Value::Number(step));
    if let Some(k) = dimension {
        setting = setting.with(Knob::K, Value::Number(count(k)));
    }
    if scale < 1.0 { setting.with(Knob::Scale, Value::Number(scale)) } else { setting }
}

/// Whether errors do not go with the step any more, but are of something else.
fn is_level(tried: &BTreeMap<i32, Tried>) -> bool {
    /// An error of the step that is left over after an octave of it is smaller than that.
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
    ) -> Result<Self, ChoiceError> {
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
            finest: 0.0,
        })
    }

    /// What `setting` takes, over so many `frames` at least, and errs by.
    fn point(&mut self, setting: &Setting, frames: usize) -> Result<Point, ChoiceError> {
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

    fn known_or_measured(&mut self, setting: &Setting, frames: usize) -> Result<Point, ChoiceError> {
        let known = self.known.get(setting);
        if let Some(point) = known.filter(|point| point.frames >= frames) {
            return Ok(point);
        }
        let number = self.tried.len() + 1;
        let progress = &Numbered { progress: self.progress, number, settings: self.settings };
        let finest = self.finest;
        let bench = self.bench()?;
        let ready = bench.ready(setting, progress)?;
        let point = match known {
            Some(point) => point,
            None => {
                bench.check(&ready)?;
                bench.truth_for(ready.step_length().max(finest), progress)?;
                let errors = bench.errors(&ready, progress)?;
                Point { error: errors.of_sample, at_most: errors.at_most, ..Point::default() }
            }
        };
        let timed = bench.times(&[ready], frames, progress)?;
        Ok(self.keep_times(setting, point, timed.first().copied().unwrap_or_default(), frames))
    }

    fn bench(&mut self) -> Result<&mut Bench<'a>, ChoiceError> {
        let bench = match self.bench.take() {
            Some(bench) => bench,
            None => Bench::new(self.renderer, self.scene, self.mix, self.size, (PIXELS, SEED), self.progress)?,
        };
        Ok(self.bench.insert(bench))
    }

    fn keep_times(&mut self, setting: &Setting, point: Point, times: Timing, frames: usize) -> Point {
        let point = Point { frame_ms: times.wall_ms, cpu_ms: times.cpu_ms, frames, ..point };
        self.measured += 1;
        self.known.insert(setting, point);
        point
    }

    /// Step number `n` in world units.
    fn world(&self, n: i32) -> f64 {
        step(n) * self.scene.volume.geometry.spacing.min_element()
    }

    /// What is compared where less is better: other programs disturb the CPU time of a software device least.
    fn cost(&self, point: &Point) -> f64 {
        let software = self.renderer.device().info().kind == DeviceKind::Software;
        if software { point.cpu_ms } else { point.frame_ms }
    }

    /// The cheapest of `kept`. Those that may be are timed again, over more frames, and by turns.
    fn cheapest(&mut self, mut kept: Vec<Kept>) -> Result<Option<Kept>, ChoiceError> {
        /// What takes so many times longer in one frame than another does so in more.
        const CLEARLY: f64 = 1.5;
        let least = kept.iter().map(|kept| self.cost(&kept.point)).fold(f64::INFINITY, f64::min);
        kept.retain(|kept| self.cost(&kept.point) <= CLEARLY * least);
        let progress = self.progress;
        let mut again: Vec<&mut Kept> = kept.iter_mut().filter(|kept| kept.point.frames < FRAMES).collect();
        if !again.is_empty() {
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

    /// The cheapest setting that keeps `asked` in 95 of 100 pixels.
    fn within_error(&mut self, asked: f64) -> Result<Choice, ChoiceError> {
        let limit = SHARE_OF_ERROR * asked;
        let (mut best, mut nearest, mut too_large): (Option<Kept>, Option<Tried>, _) = (None, None, None);
        for &scale in self.scales {
            match self.longest_steps(limit, scale, best.as_ref()) {
                Ok(Ok(kept)) => best = self.cheapest(best.into_iter().chain(kept).collect())?,
                Ok(Err(broken)) => {
                    nearest = broken;
                    break;
                }
                // Fewer pixels may do.
                Err(error) if error.is_too_large() => too_large = Some(error),
                Err(error) => return Err(error),
            }
            if let Some(best) = &best {
                if best.scale.total_cmp(&scale).is_ne() {
                    break;
                }
                // Whatever else is tried: beside the error that is allowed, that of the truth stays as small.
                self.finest = self.world(best.n);
            }
        }
        let Some(best) = best else {
            return Err(too_large.filter(|_| nearest.is_none()).unwrap_or_else(|| ChoiceError::None {
                asked: format!("ΔE00 {asked} in 95 of 100 pixels"),
                nearest: nearest.map_or_else(String::new, |(setting, point)| {
                    format!("{setting} comes nearest, with {}; allow more, or take --reference", short(point.error.p95))
                }),
            }));
        };
        let Kept { setting, point, broken, .. } = best;
        let beyond = broken.map_or_else(String::new, |(beyond, broken)| {
            format!(
                "; with {beyond} it is {}, and may be {} where pixels were not looked at",
                short(broken.error.p95),
                short(broken.at_most)
            )
        });
        let why = format!(
            "{setting} is the cheapest of the settings tried whose ΔE00 is within {asked} in 95 of 100 pixels, with some to spare: {} in {} ms{beyond}",
            short(point.error.p95),
            short(point.frame_ms)
        );
        Ok(self.chosen(setting, point, why))
    }

    /// Of the settings of `scale`, and of each number of a colour model that may pay, the one with the longest step that keeps
    /// `limit`; where `best` does with more pixels, of those of its numbers that take fewer samples. Where none keeps it, the one
    /// that comes nearest.
    fn longest_steps(
        &mut self,
        limit: f64,
        scale: f64,
        best: Option<&Kept>,
    ) -> Result<Result<Vec<Kept>, Option<Tried>>, ChoiceError> {
        let dimensions = best.map_or_else(|| self.dimensions.clone(), |best| vec![best.dimension]);
        let (mut kept, mut nearest): (Vec<Kept>, Option<Tried>) = (Vec::new(), None);
        for dimension in dimensions {
            let (steps, first) = match (kept.last(), best) {
                // More numbers take longer: they pay where they allow longer steps.
                (Some(shorter), _) => (shorter.n + 1..=*STEPS.end(), shorter.n + 1),
                // Steps that are shorter by more than pixels are fewer save nothing.
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

    /// Of the settings of `dimension` and `scale` with one of `steps`: the one with the longest that keeps `limit`; where none
    /// does, that which comes nearest. The search begins at step `first`.
    fn longest_step(
        &mut self,
        limit: f64,
        dimension: Option<usize>,
        scale: f64,
        steps: RangeInclusive<i32>,
        first: i32,
    ) -> Result<Result<Kept, Tried>, ChoiceError> {
        /// Errors of pictures go about with this power of the step; it only says where to look next.
        const ORDER: f64 = 1.7;
        let mut tried: BTreeMap<i32, Tried> = BTreeMap::new();
        let mut next = first;
        loop {
            let setting = setting(step(next), dimension, scale);
            let point = self.point(&setting, 1)?;
            tried.insert(next, (setting.clone(), point));
            let keeps = |n: &i32| tried.get(n).is_some_and(|(_, point)| point.at_most <= limit);
            let kept = tried.keys().copied().filter(keeps).max();
            let broken = tried.keys().copied().find(|n| !keeps(n) && kept.is_none_or(|kept| *n > kept));
            let low = kept.map_or(*steps.start(), |kept| kept + 1);
            let high = broken.map_or(*steps.end(), |broken| broken - 1);
            // What errs by its colour model keeps no step; the most numbers, and weights, are tried to the end.
            let more_are_left = dimension.is_some_and(|k| k < DIMENSIONS[DIMENSIONS.len() - 1]);
            let done = low > high || kept.is_none() && more_are_left && is_level(&tried);
            if done {
                let broken = broken.and_then(|n| tried.get(&n).cloned());
                // Where none keeps it, the last that was tried is the shortest.
                return Ok(match kept.and_then(|n| Some((n, tried.remove(&n)?))) {
                    Some((n, (setting, point))) => Ok(Kept { n, dimension, scale, setting, point, broken }),
                    None => Err((setting, point)),
                });
            }
            let further = f64::from(PARTS) * (limit / point.at_most.max(1e-9)).log2() / ORDER;
            next = (next + nearest(further.clamp(-80.0, 80.0))).clamp(low, high);
        }
    }

    /// The setting with the least p95 that takes at most `asked` ms.
    fn within_time(&mut self, asked: f64) -> Result<Choice, ChoiceError> {
        let limit = SHARE_OF_TIME * asked;
        let (mut least, mut too_large) = (f64::INFINITY, None);
        for dimension in self.dimensions.clone() {
            let (mut of_dimension, mut first) = (f64::INFINITY, 0);
            for &scale in self.scales {
                let (n, p95) = match self.shortest_step(limit, dimension, scale, first) {
                    // Fewer pixels may do.
                    Err(error) if error.is_too_large() => {
                        too_large = Some(error);
                        continue;
                    }
                    found => found?,
                };
                // Where fewer pixels cost more than shorter steps gain, fewer still do so, too.
                if of_dimension.is_finite() && p95 >= of_dimension {
                    break;
                }
                of_dimension = p95;
                if p95.is_finite() && n == *STEPS.start() {
                    break;
                }
                first = (n - STEPS_A_SCALE).max(*STEPS.start());
            }
            // More numbers take longer: where that shows, they are not tried further.
            if of_dimension >= least {
                break;
            }
            least = of_dimension;
        }
        let fits = |(_, point): &&Tried| point.frame_ms <= limit;
        let closest = self.tried.iter().filter(fits).min_by(|one, two| one.1.error.p95.total_cmp(&two.1.error.p95));
        if let Some((setting, point)) = closest.cloned() {
            let why = format!(
                "{setting} is the closest to the truth of the settings tried that take no more than {asked} ms, with some to spare: ΔE00 {} in 95 of 100 pixels, in {} ms",
                short(point.error.p95),
                short(point.frame_ms)
            );
            return Ok(self.chosen(setting, point, why));
        }
        let fastest = self.tried.iter().min_by(|one, two| one.1.frame_ms.total_cmp(&two.1.frame_ms));
        Err(too_large.filter(|_| fastest.is_none()).unwrap_or_else(|| ChoiceError::None {
            asked: format!("{asked} ms a frame"),
            nearest: fastest.map_or_else(String::new, |(setting, point)| {
                format!(
                    "{setting} takes {} ms; take fewer pixels (--size, or a smaller window), or more time",
                    short(point.frame_ms)
                )
            }),
        }))
    }

    /// Of the settings of `dimension` and `scale`: the shortest step that takes at most `limit` ms, and the least p95 of those
    /// tried that do; the longest step, and infinity, where none does. The search begins at step `first`.
    fn shortest_step(
        &mut self,
        limit: f64,
        dimension: Option<usize>,
        scale: f64,
        first: i32,
    ) -> Result<(i32, f64), ChoiceError> {
        /// After so many steps to where the last time points, halves are tried: a frame takes some time whatever its steps.
        const POINTED: usize = 3;
        let (mut low, mut high, mut next) = (*STEPS.start(), *STEPS.end(), first);
        let (mut found, mut least, mut tries) = (*STEPS.end(), f64::INFINITY, 0);
        while low <= high {
            let point = self.point(&setting(step(next), dimension, scale), FRAMES)?;
            // Where a step is fast enough longer ones are as well, about.
            if point.frame_ms <= limit {
                (found, least, high) = (next, least.min(point.error.p95), next - 1);
            } else {
                low = next + 1;
            }
            tries += 1;
            // Time goes about with 1/Δs.
            let further = nearest((f64::from(PARTS) * (point.frame_ms / limit).log2()).clamp(-80.0, 80.0));
            next = if tries < POINTED { next + further } else { i32::midpoint(low, high) }.clamp(low, high.max(low));
        }
        Ok((found, least))
    }

    fn chosen(&self, setting: Setting, point: Point, mut why: String) -> Choice {
        let [[across, down], [width, height]] = [setting.marched_size(self.size), self.size];
        if [across, down] != self.size {
            why.push_str(&format!("; {across}×{down} pixels are marched, and enlarged to {width}×{height}"));
        }
        Choice { setting, point, from_cache: self.measured == 0, why, tried: self.tried.clone() }
    }

    /// Keeps what was measured. A cache that cannot be written costs time, and no picture.
    fn keep(&self) {
        if self.measured > 0
            && let Err(error) = self.known.write(self.scene, &self.device)
        {
            tracing::warn!("what was measured is not kept: {error}");
        }
    }
}
