//! Check over seeded scenes that chosen settings reach their error goal, and at what cost.

use std::path::Path;

use serde::Serialize;

use relume::document::{SceneError, SceneOptions, parse};
use relume::measure::candidates::{DIMENSIONS, SCALES, setting, voxels};
use relume::measure::{
    Bench, Choice, Goal, Limit, MeasureError, Patience, Pixels, Setting, Value, Wanted, choose_within, summary,
};
use relume::model::ErrorSummary;
use relume::model::random::Random;
use relume::progress::{Progress, Quiet};
use relume::render::Renderer;
use relume::scene::{Mix, Scene};
use relume::vulkan::DeviceKind;

/// Pixels across and down of the pictures.
const SIZE: [usize; 2] = [64, 56];
/// All visible pixels are measured, unlike in the choice, which measures a sample.
const PIXELS: usize = SIZE[0] * SIZE[1];
const SEED: u64 = 77;
/// Step lengths per octave of the search for the cheapest setting.
const PART: i32 = 16;
/// Timed frames of every setting within the asked error.
const FRAMES: usize = 5;
/// Timed frames of the chosen and the cheapest setting.
const FRAMES_OF_TWO: usize = 25;

/// A scene and its error goal.
#[derive(Debug)]
pub(crate) struct GoalScene {
    /// The scene.
    pub(crate) scene: Scene,
    /// Largest allowed p95 of ΔE00.
    pub(crate) asked: f64,
}

impl GoalScene {
    /// Scene number `seed`: one of the phantoms with two to four materials at random values, and random opacities,
    /// lights and camera angles. Materials absorb in colour in every second scene.
    ///
    /// # Errors
    ///
    /// [`SceneError`].
    pub(crate) fn new(seed: u64) -> Result<Self, SceneError> {
        let text = text(&mut Random::new(9000 + seed), seed % 2 == 1);
        let scene = parse(&format!("scene {seed}"), &text, Path::new(""), &SceneOptions::default(), &Quiet)?.scene;
        let asked = match seed % 3 {
            0 => 3.0,
            1 => 1.0,
            _ => 0.5,
        };
        Ok(Self { scene, asked })
    }
}

/// A scene of one of the phantoms with two to four materials, two lights and a camera, all at random.
pub(crate) fn text(random: &mut Random, coloured: bool) -> String {
    let (phantom, span) = [("frog", 255.0), ("engine", 255.0), ("gaussian", 1.0), ("shells", 65535.0)][random.index(4)];
    let dims = 24 + random.index(16);
    let mut text = format!("version = 1\n[volume]\nphantom = \"{phantom}\"\ndims = [{dims}, {dims}, {dims}]\n");
    let patches = ["dark skin", "foliage", "blue sky", "orange", "purple", "yellow green", "red", "cyan"];
    let materials = 2 + random.index(3);
    for m in 0..materials {
        let (patch, peak) = (patches[random.index(patches.len())], random.between(440.0, 640.0));
        text.push_str(&format!("[materials.m{m}]\nreflectance = \"{patch}\"\n"));
        if coloured {
            text.push_str(&format!("absorption = {{ gaussian = [{{ centre = {peak}, sigma = 40, height = 1 }}] }}\n"));
        }
    }
    text.push_str("[transfer]\nintervals = [\n");
    for m in 0..materials {
        let low = span * random.between(0.12, 0.8);
        let (high, ramp) = (low + span * random.between(0.05, 0.2), span * random.between(0.04, 0.15));
        let opacity = random.between_magnitudes(0.01, 0.6);
        let absorption =
            if coloured { format!(", absorption = {}", random.between_magnitudes(0.01, 0.4)) } else { String::new() };
        text.push_str(&format!(
            "{{ material = \"m{m}\", range = [{low}, {high}], ramp = {ramp}, opacity = {opacity}{absorption} }},\n"
        ));
    }
    text.push_str("]\n");
    for (name, light) in
        [("key", ["D65", "A", "FL11"][random.index(3)]), ("fill", ["LED-B3", "FL2", "D50"][random.index(3)])]
    {
        let direction: [f64; 3] = std::array::from_fn(|_| random.between(-1.0, 1.0));
        text.push_str(&format!(
            "[lights.{name}]\nspectrum = \"{light}\"\nkind = \"directional\"\ndirection = {direction:?}\nintensity = 0.6\n"
        ));
    }
    let (azimuth, elevation) = (random.between(-180.0, 180.0), random.between(-60.0, 60.0));
    text + &format!("[camera]\nazimuth = {azimuth}\nelevation = {elevation}\n")
}

/// Error and cost of a setting in a picture of a seeded scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct GoalCost {
    /// The setting.
    pub(crate) setting: Setting,
    /// p95 of ΔE00 over all visible pixels.
    pub(crate) p95: f64,
    /// Samples per voxel of ray length and displayed pixel.
    pub(crate) samples: f64,
    /// Median frame time, in ms: CPU time on a software device, wall time on any other.
    pub(crate) ms: f64,
}

/// Result of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct GoalRow {
    /// Largest allowed p95 of ΔE00.
    pub(crate) asked: f64,
    /// The chosen setting.
    pub(crate) chosen: GoalCost,
    /// The fastest setting within the asked error; the chosen one if there is none.
    pub(crate) cheapest: GoalCost,
    /// Samples of the chosen setting, divided by the fewest samples of any setting within the asked error and with no
    /// more components.
    pub(crate) samples: f64,
}

impl GoalRow {
    /// Measured error divided by the asked error.
    pub(crate) fn error(&self) -> f64 {
        self.chosen.p95 / self.asked
    }

    /// Frame time of the chosen setting divided by that of the cheapest one.
    pub(crate) fn time(&self) -> f64 {
        self.chosen.ms / self.cheapest.ms
    }
}

/// Chooses a setting for `of` on the device of `renderer`, and searches for the cheapest setting within the asked
/// error: steps a sixteenth of an octave apart, every dimension of a colour model, and several scales. Returns `None`
/// if the scene has no visible pixels or no setting reaches the goal.
///
/// # Errors
///
/// [`MeasureError`].
pub(crate) fn goal_row(
    renderer: &Renderer,
    of: &GoalScene,
    progress: &dyn Progress,
) -> Result<Option<GoalRow>, MeasureError> {
    let GoalScene { scene, asked } = of;
    let mix = Mix::of_scene(scene);
    let wanted = Wanted { size: SIZE, goal: Goal::MaxError(*asked), pixels: Pixels::Fewer };
    let Choice { setting: chosen, .. } =
        match choose_within(renderer, scene, &mix, (wanted, Patience::ENDLESS), None, progress) {
            Err(MeasureError::Nothing { .. } | MeasureError::None { .. }) => return Ok(None),
            choice => choice?,
        };
    let number = |setting: &Setting, knob| match setting.get(knob) {
        Some(Value::Number(number)) => Some(number),
        _ => None,
    };
    let samples = |setting: &Setting| setting.scale().powi(2) / number(setting, "step").unwrap_or(1.0);
    let dimension = number(&chosen, "k");
    let mut bench = Bench::new(renderer, scene, &mix, SIZE, (PIXELS, SEED, Limit::NONE), progress)?;
    // Leaves room for settings with shorter steps.
    bench.truth_for(0.5 * chosen.applied(scene).accuracy.step_length, Limit::NONE, progress)?;

    let mut p95_of = |setting: &Setting| -> Result<f64, MeasureError> {
        let ready = bench.ready(setting, progress)?;
        Ok(bench.errors(&ready, progress)?.of_sample.p95)
    };
    // The chosen setting comes first.
    let mut keep = vec![(chosen.clone(), p95_of(&chosen)?)];
    let dimensions = match dimension {
        None => vec![None],
        Some(_) => DIMENSIONS.map(Some).to_vec(),
    };
    for k in dimensions {
        // With as many components, more samples take longer. With fewer components, twice the samples take longer.
        let most = if k.map(count) < dimension { 2.0 } else { 1.0 } * samples(&chosen);
        // Without the smallest scales: these small pictures have few pixels to spare.
        for &scale in &SCALES[..4] {
            let steps = (-3 * PART..=4 * PART).rev().map(|n| setting(voxels(f64::from(n) / f64::from(PART)), k, scale));
            for longer in steps.take_while(|longer| samples(longer) < most) {
                let p95 = p95_of(&longer)?;
                if p95 <= *asked {
                    keep.push((longer, p95));
                    break;
                }
            }
        }
    }
    let fewest = keep.iter().filter(|(setting, _)| number(setting, "k") <= dimension).map(|(it, _)| samples(it));
    let samples_over = samples(&chosen) / fewest.fold(f64::INFINITY, f64::min);

    let software = renderer.device().info().kind == DeviceKind::Software;
    let mut ms_of = |settings: &[&Setting], frames| -> Result<Vec<f64>, MeasureError> {
        let ready: Result<Vec<_>, _> = settings.iter().map(|setting| bench.ready(setting, progress)).collect();
        let times = bench.times(&ready?, frames, progress)?;
        Ok(times.iter().map(|time| if software { time.cpu_ms } else { time.wall_ms }).collect())
    };
    let all: Vec<&Setting> = keep.iter().map(|(setting, _)| setting).collect();
    let quick = ms_of(&all, FRAMES)?;
    let cheapest = (0..keep.len()).min_by(|&one, &two| quick[one].total_cmp(&quick[two])).unwrap_or(0);
    // Times the two again together: the smallest of many times is partly luck.
    let ms = ms_of(&[all[0], all[cheapest]], FRAMES_OF_TWO)?;
    let cost = |index: usize, ms: f64| {
        let (setting, p95) = keep[index].clone();
        GoalCost { samples: samples(&setting), setting, p95, ms }
    };
    let chosen = cost(0, ms[0]);
    let cheapest = if ms[1] < ms[0] { cost(cheapest, ms[1]) } else { chosen.clone() };
    Ok(Some(GoalRow { asked: *asked, chosen, cheapest, samples: samples_over }))
}

/// Distribution of a ratio over many scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Ratios {
    /// The median.
    pub(crate) median: f64,
    /// The 95th percentile.
    pub(crate) p95: f64,
    /// The largest ratio.
    pub(crate) max: f64,
    /// Number of ratios above [`GoalSummary::COST`].
    pub(crate) dear: usize,
}

impl Ratios {
    fn of(ratios: &[f64]) -> Option<Self> {
        let (ErrorSummary { p95, max, .. }, median) = (ErrorSummary::of(ratios), summary(ratios)?.median);
        let dear = ratios.iter().filter(|&&ratio| ratio.is_nan() || ratio > GoalSummary::COST).count();
        Some(Self { median, p95, max, dear })
    }
}

/// Summary of many scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct GoalSummary {
    /// Scenes with visible pixels and at least one setting within the asked error.
    pub(crate) scenes: usize,
    /// How many of them have pictures within the asked error.
    pub(crate) kept: usize,
    /// Largest ratio of the measured to the asked error.
    pub(crate) worst: f64,
    /// Frame time of the chosen setting divided by that of the cheapest one.
    pub(crate) time: Ratios,
    /// The same for samples ([`GoalRow::samples`]).
    pub(crate) samples: Ratios,
}

impl GoalSummary {
    /// Required fraction of scenes within the asked error.
    pub(crate) const KEPT: f64 = 0.95;
    /// Largest allowed cost of a choice relative to the cheapest setting, in 95 of 100 scenes.
    pub(crate) const COST: f64 = 1.3;

    /// Summarises `rows`; `None` if there are none.
    pub(crate) fn of(rows: &[GoalRow]) -> Option<Self> {
        let of = |part: &dyn Fn(&GoalRow) -> f64| rows.iter().map(part).collect::<Vec<_>>();
        let errors = of(&GoalRow::error);
        Some(Self {
            scenes: rows.len(),
            kept: errors.iter().filter(|error| **error <= 1.0).count(),
            worst: ErrorSummary::of(&errors).max,
            time: Ratios::of(&of(&GoalRow::time))?,
            samples: Ratios::of(&of(&|row| row.samples))?,
        })
    }

    /// Fraction of scenes within the asked error.
    pub(crate) fn share(&self) -> f64 {
        count(self.kept) / count(self.scenes)
    }

    /// The missed requirements, in words; empty if all are met.
    pub(crate) fn missed(&self) -> Vec<String> {
        let mut missed = Vec::new();
        let (kept, asked) = (100.0 * self.share(), 100.0 * Self::KEPT);
        if kept < asked || kept.is_nan() {
            missed.push(format!("{kept:.1} % of the scenes meet the goal; the limit is at least {asked:.0} %"));
        }
        for (what, ratios) in [("samples", self.samples), ("time", self.time)] {
            if ratios.p95.is_nan() || ratios.p95 > Self::COST {
                missed.push(format!(
                    "95 of 100 scenes take up to {:.2} times the {what} of the cheapest setting; the limit is {}",
                    ratios.p95,
                    Self::COST
                ));
            }
        }
        missed
    }
}

/// A count of scenes or components; exact below 2⁵³.
#[expect(clippy::cast_precision_loss, reason = "counts are far below 2⁵³")]
fn count(n: usize) -> f64 {
    n as f64
}
