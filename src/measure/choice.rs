//! The setting that a scene needs on a device: the fastest within an error, or the closest to the truth within a time.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::cache::Known;
use super::clock::{Stopwatch, summary};
use super::difference::delta_e;
use super::enlarge::Enlargement;
use super::ladder::{FINER, Ladder, LadderError};
use super::sample::drawn;
use super::setting::{Knob, Setting, Value};
use super::survey::{looked_up, picture};
use super::table::short;
use crate::model::ErrorSummary;
use crate::number::{count, nearest};
use crate::plan::{PlanError, Planned, plan};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer, Uploaded};
use crate::scene::{Mix, Scene};

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
    /// Fewer where that serves what is asked for, and the picture is enlarged ([`Enlargement`]).
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
/// Runs of a march that are timed, and the one before.
const RUNS: usize = 5;
/// The share of a goal that a choice uses up: other pixels, and other times, differ a little.
const MARGIN: f64 = 0.92;
/// Steps are 2^(n/4) voxels, for n in this range: between an eighth and 16.
const STEPS: RangeInclusive<i32> = -12..=16;
/// What a pixel keeps where weights are not exact: whole vectors, which cost what their spare numbers would.
pub(super) const DIMENSIONS: [usize; 4] = [4, 8, 12, 16];
/// Shares of the pixels across that are marched: half of all pixels less each time.
pub(super) const SCALES: [f64; 7] = [1.0, 0.71, 0.5, 0.35, 0.25, 0.18, 0.125];
/// By how many steps shorter the march of one of them takes as long as that of the one before.
const STEPS_A_SCALE: i32 = 4;

/// What was measured of a setting.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// March and relight (and enlarging) on the wall, the median, in ms.
    pub frame_ms: f64,
    /// ΔE00 from the truth: the mean, p95 and the largest.
    pub error: ErrorSummary,
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
    /// Whether somebody asked to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        match self {
            Self::Plan(PlanError::Model(error)) => matches!(error, crate::model::ModelError::Cancelled),
            Self::Ladder(LadderError::Reference(error)) => {
                matches!(error, crate::reference::ReferenceError::Cancelled)
            }
            Self::Render(error) => matches!(error, RenderError::Cancelled),
            _ => false,
        }
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
    const OCTAVES: [i32; 5] = [-8, -4, 0, 4, 8];
    let mut curve = Curve::new(renderer, scene, mix, size, cache, progress)?;
    let settings: Vec<Setting> = std::iter::once(Setting::default())
        .chain(curve.dimensions.iter().flat_map(|&dimension| OCTAVES.map(|n| setting(quarters(n), dimension, 1.0))))
        .collect();
    let measured: Result<(), ChoiceError> = settings.iter().try_for_each(|setting| curve.point(setting).map(drop));
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
    tried: Vec<Tried>,
    /// Where weights are exact none are chosen.
    dimensions: Vec<Option<usize>>,
    /// Those of [`SCALES`] that may be chosen, 1 first.
    scales: &'static [f64],
    bench: Option<Bench<'a>>,
}

/// What measuring needs, made when it is first needed.
pub(super) struct Bench<'a> {
    ladder: Ladder<'a>,
    uploaded: Uploaded,
    size: [usize; 2],
    truth: Vec<glam::DVec3>,
    /// Of the truth, in world units.
    step_length: f64,
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
fn quarters(n: i32) -> f64 {
    voxels(f64::from(n) / 4.0)
}

/// A step of so many voxels, so many numbers of a colour model where there is one, and such a share of the pixels across.
pub(super) fn setting(step: f64, dimension: Option<usize>, scale: f64) -> Setting {
    let mut setting = Setting::default().with(Knob::Step, Value::Number(step));
    if let Some(k) = dimension {
        setting = setting.with(Knob::K, Value::Number(count(k)));
    }
    if scale < 1.0 { setting.with(Knob::Scale, Value::Number(scale)) } else { setting }
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
            tried: Vec::new(),
            dimensions,
            scales: &SCALES[..1],
            bench: None,
        })
    }

    /// What `setting` takes and errs by.
    fn point(&mut self, setting: &Setting) -> Result<Point, ChoiceError> {
        let point = self.known_or_measured(setting)?;
        if !self.tried.iter().any(|(tried, _)| tried == setting) {
            self.tried.push((setting.clone(), point));
        }
        Ok(point)
    }

    fn known_or_measured(&mut self, setting: &Setting) -> Result<Point, ChoiceError> {
        if let Some(point) = self.known.get(setting) {
            return Ok(point);
        }
        self.progress.report(&format!("trying {setting}"), self.measured as u64, self.measured as u64 + 4);
        let scene = setting.applied(self.scene);
        let planned = plan(&scene, self.progress)?;
        let mut bench = match self.bench.take() {
            Some(bench) => bench,
            None => {
                let drawn = (PIXELS, SEED);
                Bench::new(self.renderer, self.scene, self.mix, &planned, self.size, drawn, self.progress)?
            }
        };
        let marched = setting.marched_size(self.size);
        let error = bench.error(self.renderer, &scene, &planned, marched, self.progress)?;
        let frame_ms = bench.time(self.renderer, &scene, &planned, marched, self.progress)?;
        self.bench = Some(bench);
        let point = Point { frame_ms, error };
        self.measured += 1;
        self.known.insert(setting, point);
        Ok(point)
    }

    /// The fastest setting whose p95 is at most `asked`.
    fn within_error(&mut self, asked: f64) -> Result<Choice, ChoiceError> {
        let limit = MARGIN * asked;
        let mut best: Option<Kept> = None;
        let mut nearest: Option<Tried> = None;
        for dimension in self.dimensions.clone() {
            match self.longest_step(limit, dimension, 1.0, STEPS, 0)? {
                Ok(kept) => {
                    let slower = best.as_ref().is_some_and(|best| kept.point.frame_ms >= best.point.frame_ms);
                    // More numbers take longer: where that shows, they are not tried further.
                    if slower {
                        break;
                    }
                    best = Some(kept);
                }
                Err(broken) => {
                    if nearest.as_ref().is_none_or(|(_, nearest)| broken.1.error.p95 < nearest.error.p95) {
                        nearest = Some(broken);
                    }
                }
            }
        }
        let Some(mut best) = best else {
            return Err(ChoiceError::None {
                asked: format!("ΔE00 {asked} in 95 of 100 pixels"),
                nearest: nearest.map_or_else(String::new, |(setting, point)| {
                    format!("{setting} comes nearest, with {}; allow more, or take --reference", short(point.error.p95))
                }),
            });
        };
        for &scale in self.scales.iter().skip(1) {
            // Steps that are shorter by more than pixels are fewer save nothing.
            let shortest = (best.n - STEPS_A_SCALE + 1).max(*STEPS.start());
            match self.longest_step(limit, best.dimension, scale, shortest..=best.n, shortest)? {
                Ok(kept) if kept.point.frame_ms < best.point.frame_ms => best = kept,
                _ => break,
            }
        }
        let Kept { setting, point, broken, .. } = best;
        let beyond = broken.map_or_else(String::new, |(beyond, broken)| {
            format!("; {beyond} is off by {} in {} ms", short(broken.error.p95), short(broken.frame_ms))
        });
        let why = format!(
            "{setting} is the fastest of the settings tried whose ΔE00 is within {asked} in 95 of 100 pixels, with some to spare: {} in {} ms{beyond}",
            short(point.error.p95),
            short(point.frame_ms)
        );
        Ok(self.chosen(setting, point, why))
    }

    /// Of the settings of `dimension` and `scale` with one of `steps`: the one with the longest whose p95 is at most `limit`;
    /// where none keeps it, that which comes nearest. The search begins at step `first`.
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
            let setting = setting(quarters(next), dimension, scale);
            let point = self.point(&setting)?;
            tried.insert(next, (setting.clone(), point));
            let keeps = |n: &i32| tried.get(n).is_some_and(|(_, point)| point.error.p95 <= limit);
            let kept = tried.keys().copied().filter(keeps).max();
            let broken = tried.keys().copied().find(|n| !keeps(n) && kept.is_none_or(|kept| *n > kept));
            let low = kept.map_or(*steps.start(), |kept| kept + 1);
            let high = broken.map_or(*steps.end(), |broken| broken - 1);
            if low > high {
                let broken = broken.and_then(|n| tried.get(&n).cloned());
                // Where none keeps it, the last that was tried is the shortest.
                return Ok(match kept.and_then(|n| Some((n, tried.remove(&n)?))) {
                    Some((n, (setting, point))) => Ok(Kept { n, dimension, setting, point, broken }),
                    None => Err((setting, point)),
                });
            }
            let further = 4.0 * (limit / point.error.p95.max(1e-9)).log2() / ORDER;
            next = (next + nearest(further.clamp(-40.0, 40.0))).clamp(low, high);
        }
    }

    /// The setting with the least p95 that takes at most `asked` ms.
    fn within_time(&mut self, asked: f64) -> Result<Choice, ChoiceError> {
        let limit = MARGIN * asked;
        let mut least = f64::INFINITY;
        for dimension in self.dimensions.clone() {
            let (mut of_dimension, mut first) = (f64::INFINITY, 0);
            for &scale in self.scales {
                let (n, p95) = self.shortest_step(limit, dimension, scale, first)?;
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
        Err(ChoiceError::None {
            asked: format!("{asked} ms a frame"),
            nearest: fastest.map_or_else(String::new, |(setting, point)| {
                format!("{setting} takes {} ms; take a smaller --size, or more time", short(point.frame_ms))
            }),
        })
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
            let point = self.point(&setting(quarters(next), dimension, scale))?;
            // Where a step is fast enough longer ones are as well, about.
            if point.frame_ms <= limit {
                (found, least, high) = (next, least.min(point.error.p95), next - 1);
            } else {
                low = next + 1;
            }
            tries += 1;
            // Time goes about with 1/Δs.
            let further = nearest((4.0 * (point.frame_ms / limit).log2()).clamp(-40.0, 40.0));
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

impl<'a> Bench<'a> {
    /// For pictures of `size` of `scene`, whose errors are those of so many pixels, drawn by a seed.
    pub(super) fn new(
        renderer: &Renderer,
        scene: &'a Scene,
        mix: &Mix,
        planned: &Planned,
        size: [usize; 2],
        (most, seed): (usize, u64),
        progress: &dyn Progress,
    ) -> Result<Self, ChoiceError> {
        let ladder = drawn(scene, mix, size, most, seed, progress)?;
        if ladder.pixels.is_empty() {
            return Err(ChoiceError::Nothing { source_name: scene.source.clone() });
        }
        let uploaded = renderer.upload(scene, planned, ladder.statistics(), progress)?;
        Ok(Self { ladder, uploaded, size, truth: Vec::new(), step_length: f64::INFINITY })
    }

    /// Makes the truth that pictures with steps of such a length are measured against.
    pub(super) fn truth_for(&mut self, step_length: f64, progress: &dyn Progress) -> Result<(), ChoiceError> {
        // A truth of a quarter of the step leaves a sixteenth of an error of second order; one is made for several steps.
        if self.step_length > step_length / 4.0 {
            self.ladder.finest = step_length;
            self.truth = self.ladder.truth_in(&self.ladder.pixels, progress)?;
            self.step_length = step_length / FINER;
        }
        Ok(())
    }

    /// How far a picture of `scene` is from the truth of which so many pixels are `marched`.
    pub(super) fn error(
        &mut self,
        renderer: &Renderer,
        scene: &Scene,
        planned: &Planned,
        marched: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<ErrorSummary, ChoiceError> {
        self.truth_for(scene.accuracy.step_length, progress)?;
        let shown = picture(renderer, &self.ladder, scene, planned, &self.uploaded, marched, progress)?;
        let shown = looked_up(&Enlargement::new(marched, self.size).pixels(&shown), self.size, &self.ladder.pixels);
        Ok(ErrorSummary::of(&delta_e(&shown, &self.truth)))
    }

    /// What a frame of it takes on the wall, the median, in ms.
    pub(super) fn time(
        &self,
        renderer: &Renderer,
        scene: &Scene,
        planned: &Planned,
        marched: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<f64, ChoiceError> {
        let matrices = self.ladder.shown(scene, planned);
        let enlargement = Enlargement::new(marched, self.size);
        let blank = vec![[0.0; 4]; marched[0] * marched[1]];
        let mut times = Vec::new();
        for run in 0..=RUNS {
            let clock = Stopwatch::start();
            let accumulators = renderer.march(scene, planned, &self.uploaded, marched, progress)?;
            let relight = renderer.relight_display(&accumulators)?;
            relight.run(&matrices)?;
            if !enlargement.is_none() {
                std::hint::black_box(enlargement.pixels(&blank));
            }
            if run > 0 {
                times.push(clock.read().wall_ms);
            }
        }
        Ok(summary(&times).map_or(f64::NAN, |times| times.median))
    }
}
