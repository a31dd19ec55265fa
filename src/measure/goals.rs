//! Whether what is asked of pictures is kept, and at what cost, over seeded scenes.

use std::path::Path;

use serde::Serialize;

use super::bench::Bench;
use super::choice::{Choice, ChoiceError, DIMENSIONS, Goal, Pixels, SCALES, Wanted, choose, setting, voxels};
use super::clock::summary;
use super::setting::{Knob, Setting, Value};
use crate::model::ErrorSummary;
use crate::model::random::Random;
use crate::number::count;
use crate::progress::{Progress, Quiet};
use crate::render::Renderer;
use crate::scene::{Mix, Scene, SceneError, SceneOptions, parse};
use crate::vulkan::DeviceKind;

/// Pixels across and down of the pictures.
const SIZE: [usize; 2] = [64, 56];
/// All pixels that show anything are looked at, not those alone that a choice is made by.
const PIXELS: usize = SIZE[0] * SIZE[1];
const SEED: u64 = 77;
/// The finest part of an octave by which steps are told apart.
const PART: i32 = 16;
/// Frames that are timed of every setting that keeps what is asked for.
const FRAMES: usize = 5;
/// The same of the chosen one and the cheapest.
const FRAMES_OF_TWO: usize = 25;

/// A scene, and the error that is asked for.
#[derive(Debug)]
pub struct GoalScene {
    /// The scene.
    pub scene: Scene,
    /// ΔE00 that 95 of 100 pixels are to keep.
    pub asked: f64,
}

impl GoalScene {
    /// Scene number `seed`: one of the phantoms, two to four materials at random values, opacities, lights and views; every
    /// second one absorbs in colour.
    ///
    /// # Errors
    ///
    /// [`SceneError`].
    pub fn new(seed: u64) -> Result<Self, SceneError> {
        let text = text(&mut Random::new(9000 + seed), seed % 2 == 1);
        let scene = parse(&format!("scene {seed}"), &text, Path::new(""), &SceneOptions::default(), &Quiet)?;
        let asked = match seed % 3 {
            0 => 3.0,
            1 => 1.0,
            _ => 0.5,
        };
        Ok(Self { scene, asked })
    }
}

fn text(random: &mut Random, coloured: bool) -> String {
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

/// A setting in a picture of such a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalCost {
    /// Where the knobs stand.
    pub setting: Setting,
    /// ΔE00 that 95 of 100 of all pixels that show anything keep.
    pub p95: f64,
    /// Samples that are taken on the way through a voxel, of a pixel that is shown.
    pub samples: f64,
    /// What a frame takes, the median, in ms: CPU time of a software device, time on the wall of another.
    pub ms: f64,
}

/// What became of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalRow {
    /// ΔE00 that 95 of 100 pixels are to keep.
    pub asked: f64,
    /// The setting that was chosen.
    pub chosen: GoalCost,
    /// The cheapest by time of all settings that would have kept it; the chosen one where there is none.
    pub cheapest: GoalCost,
    /// How many times more samples were chosen than the fewest that would have kept it, of no more numbers each.
    pub samples: f64,
}

impl GoalRow {
    /// The error that was measured over that which was asked for.
    #[must_use]
    pub fn error(&self) -> f64 {
        self.chosen.p95 / self.asked
    }

    /// The time of what was chosen over that of the cheapest that would have kept it.
    #[must_use]
    pub fn time(&self) -> f64 {
        self.chosen.ms / self.cheapest.ms
    }
}

/// Chooses a setting for `of` on the device of `renderer`, and seeks the cheapest that would have done, among steps a sixteenth
/// of an octave apart, with every number of a colour model and several scales. `None` where the scene shows nothing, or
/// nothing keeps what is asked for.
///
/// # Errors
///
/// [`ChoiceError`].
pub fn goal_row(renderer: &Renderer, of: &GoalScene, progress: &dyn Progress) -> Result<Option<GoalRow>, ChoiceError> {
    let GoalScene { scene, asked } = of;
    let mix = Mix::of_scene(scene);
    let wanted = Wanted { size: SIZE, goal: Goal::MaxError(*asked), pixels: Pixels::Fewer };
    let Choice { setting: chosen, .. } = match choose(renderer, scene, &mix, wanted, None, progress) {
        Err(ChoiceError::Nothing { .. } | ChoiceError::None { .. }) => return Ok(None),
        choice => choice?,
    };
    let number = |setting: &Setting, knob| match setting.get(knob) {
        Some(Value::Number(number)) => Some(number),
        _ => None,
    };
    let samples = |setting: &Setting| setting.scale().powi(2) / number(setting, Knob::Step).unwrap_or(1.0);
    let dimension = number(&chosen, Knob::K);
    let mut bench = Bench::new(renderer, scene, &mix, SIZE, (PIXELS, SEED), progress)?;
    // Finer than the steps that are looked at.
    bench.truth_for(0.5 * chosen.applied(scene).accuracy.step_length, progress)?;

    let mut p95_of = |setting: &Setting| -> Result<f64, ChoiceError> {
        let ready = bench.ready(setting, progress)?;
        Ok(bench.errors(&ready, progress)?.of_sample.p95)
    };
    // The chosen one comes first.
    let mut keep = vec![(chosen.clone(), p95_of(&chosen)?)];
    let dimensions = match dimension {
        None => vec![None],
        Some(_) => DIMENSIONS.map(Some).to_vec(),
    };
    for k in dimensions {
        // What takes more samples, each of as many numbers, takes longer; of fewer numbers, not twice as long.
        let most = if k.map(count) < dimension { 2.0 } else { 1.0 } * samples(&chosen);
        // Not the smallest: so small pictures have few pixels to spare.
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
    let fewest = keep.iter().filter(|(setting, _)| number(setting, Knob::K) <= dimension).map(|(it, _)| samples(it));
    let samples_over = samples(&chosen) / fewest.fold(f64::INFINITY, f64::min);

    let software = renderer.device().info().kind == DeviceKind::Software;
    let mut ms_of = |settings: &[&Setting], frames| -> Result<Vec<f64>, ChoiceError> {
        let ready: Result<Vec<_>, _> = settings.iter().map(|setting| bench.ready(setting, progress)).collect();
        let times = bench.times(&ready?, frames, progress)?;
        Ok(times.iter().map(|time| if software { time.cpu_ms } else { time.wall_ms }).collect())
    };
    let all: Vec<&Setting> = keep.iter().map(|(setting, _)| setting).collect();
    let quick = ms_of(&all, FRAMES)?;
    let cheapest = (0..keep.len()).min_by(|&one, &two| quick[one].total_cmp(&quick[two])).unwrap_or(0);
    // Timed anew beside the chosen one: of many times the least is so by chance as well.
    let ms = ms_of(&[all[0], all[cheapest]], FRAMES_OF_TWO)?;
    let cost = |index: usize, ms: f64| {
        let (setting, p95) = keep[index].clone();
        GoalCost { samples: samples(&setting), setting, p95, ms }
    };
    let chosen = cost(0, ms[0]);
    let cheapest = if ms[1] < ms[0] { cost(cheapest, ms[1]) } else { chosen.clone() };
    Ok(Some(GoalRow { asked: *asked, chosen, cheapest, samples: samples_over }))
}

/// A ratio over many scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Ratios {
    /// The middle one.
    pub median: f64,
    /// What 95 of 100 are within.
    pub p95: f64,
    /// The largest.
    pub max: f64,
    /// How many are above [`GoalSummary::COST`].
    pub dear: usize,
}

impl Ratios {
    fn of(ratios: &[f64]) -> Option<Self> {
        let (ErrorSummary { p95, max, .. }, median) = (ErrorSummary::of(ratios), summary(ratios)?.median);
        let dear = ratios.iter().filter(|&&ratio| ratio.is_nan() || ratio > GoalSummary::COST).count();
        Some(Self { median, p95, max, dear })
    }
}

/// What became of many scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GoalSummary {
    /// Scenes that show something, and that something keeps what is asked of.
    pub scenes: usize,
    /// How many of them have pictures that keep it.
    pub kept: usize,
    /// The largest error over what was asked for.
    pub worst: f64,
    /// The time of what was chosen over that of the cheapest that would have kept it.
    pub time: Ratios,
    /// The same in samples.
    pub samples: Ratios,
}

impl GoalSummary {
    /// The share of scenes that are to keep what is asked for.
    pub const KEPT: f64 = 0.95;
    /// What a choice may cost over the cheapest setting that would have done, in 95 of 100 scenes.
    pub const COST: f64 = 1.3;

    /// The summary of `rows`; `None` of none.
    #[must_use]
    pub fn of(rows: &[GoalRow]) -> Option<Self> {
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

    /// The share of scenes whose pictures keep what is asked for.
    #[must_use]
    pub fn share(&self) -> f64 {
        count(self.kept) / count(self.scenes)
    }

    /// What does not reach the bars, in words; nothing where all does.
    #[must_use]
    pub fn missed(&self) -> Vec<String> {
        let mut missed = Vec::new();
        let (kept, asked) = (100.0 * self.share(), 100.0 * Self::KEPT);
        if kept < asked || kept.is_nan() {
            missed.push(format!("{kept:.1} % of the scenes keep what is asked for, and at least {asked:.0} % are to"));
        }
        for (what, ratios) in [("samples", self.samples), ("time", self.time)] {
            if ratios.p95.is_nan() || ratios.p95 > Self::COST {
                missed.push(format!(
                    "95 of 100 scenes take up to {:.2} times the {what} of the cheapest, and {} is the most that they may",
                    ratios.p95,
                    Self::COST
                ));
            }
        }
        missed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A choice off by `error` of what was asked for, at `time` and `samples` times the least.
    fn row(error: f64, time: f64, samples: f64) -> GoalRow {
        let cost = |p95, ms| GoalCost { setting: Setting::default(), p95, samples: 1.0, ms };
        GoalRow { asked: 2.0, chosen: cost(2.0 * error, 3.0 * time), cheapest: cost(2.0, 3.0), samples }
    }

    #[test]
    fn bars_are_missed_by_what_is_off_and_by_what_is_dear() {
        let good = row(0.5, 1.25, 1.0);
        let with = |others: &[GoalRow], many: usize| {
            let rows = [others, &vec![good.clone(); many - others.len()]].concat();
            GoalSummary::of(&rows).map(|found| found.missed())
        };
        assert_eq!(with(&[], 40), Some(Vec::new()));
        let one_in_twenty = [row(1.5, 2.0, 2.0), row(1.01, 1.5, 1.5)];
        assert_eq!(with(&one_in_twenty, 40), Some(Vec::new()), "95 of 100 are asked for");
        let missed = with(&[&one_in_twenty[..], &[row(f64::NAN, f64::NAN, 1.4)]].concat(), 40).unwrap_or_default();
        assert_eq!(missed.len(), 3, "{missed:?}");
        assert!(missed[0].starts_with("92.5 % of the scenes keep"), "{missed:?}");
        assert!(missed[1].contains("up to 1.40 times the samples"), "{missed:?}");
        assert_eq!(GoalSummary::of(&[]), None);
    }

    #[test]
    fn a_summary_says_how_many_are_dear() {
        let rows = [row(0.5, 1.0, 1.0), row(0.25, 1.5, 1.25), row(1.5, 1.25, 2.0)];
        let found = GoalSummary::of(&rows);
        let near = |one: f64, two: f64| (one - two).abs() <= 1e-12;
        assert!(found.is_some_and(|it| (it.scenes, it.kept) == (3, 2) && near(it.worst, 1.5)), "{found:?}");
        assert!(found.is_some_and(|it| near(it.time.median, 1.25) && near(it.time.max, 1.5)), "{found:?}");
        assert!(found.is_some_and(|it| (it.time.dear, it.samples.dear) == (1, 1)), "{found:?}");
    }
}
