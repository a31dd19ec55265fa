//! Whether what is asked of pictures is kept, and at what cost, over seeded scenes.

use std::path::Path;

use serde::Serialize;

use super::choice::{Bench, Choice, ChoiceError, DIMENSIONS, Goal, Pixels, SCALES, Wanted, choose, setting, voxels};
use super::clock::summary;
use super::setting::{Knob, Setting, Value};
use crate::model::random::Random;
use crate::number::count;
use crate::plan::plan;
use crate::progress::{Progress, Quiet};
use crate::render::Renderer;
use crate::scene::{Mix, Scene, SceneError, SceneOptions, parse};

/// Pixels across and down of the pictures.
const SIZE: [usize; 2] = [64, 56];
/// All pixels that show anything are looked at, not those alone that a choice is made by.
const PIXELS: usize = SIZE[0] * SIZE[1];
const SEED: u64 = 77;
/// The finest part of an octave by which steps are told apart.
const PART: i32 = 8;

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

/// What became of one scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GoalRow {
    /// ΔE00 that 95 of 100 pixels are to keep.
    pub asked: f64,
    /// What those of the setting that was chosen keep: p95 over all pixels that show anything.
    pub measured: f64,
    /// The setting that was chosen.
    pub setting: Setting,
    /// Its frames on the wall, the median, in ms.
    pub frame_ms: f64,
    /// The fastest of all settings that would have kept it; the chosen one where there is no faster.
    pub cheapest: Setting,
    /// Its frames.
    pub cheapest_ms: f64,
    /// How many times more samples were chosen than the longest step takes that would have kept it, all else alike.
    pub samples: f64,
}

impl GoalRow {
    /// Whether what was asked for is kept.
    #[must_use]
    pub fn kept(&self) -> bool {
        self.measured <= self.asked
    }

    /// What was chosen costs over the cheapest that would have kept it.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.frame_ms / self.cheapest_ms
    }
}

/// Chooses a setting for `of` on the device of `renderer`, and seeks the fastest that would have done, among steps an eighth
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
    let number = |knob| match chosen.get(knob) {
        Some(Value::Number(number)) => Some(number),
        _ => None,
    };
    let (step, dimension) = (number(Knob::Step).unwrap_or(1.0), number(Knob::K));
    let work = |step: f64, scale: f64| scale * scale / step;
    let mut bench = Bench::new(renderer, scene, &mix, &plan(scene, progress)?, SIZE, (PIXELS, SEED), progress)?;
    // Finer than the steps that are looked at.
    bench.truth_for(0.5 * chosen.applied(scene).accuracy.step_length, progress)?;

    let mut measured = f64::NAN;
    let mut keep: Vec<Setting> = Vec::new();
    let mut longest = step;
    let dimensions = match dimension {
        None => vec![None],
        Some(_) => DIMENSIONS.map(Some).to_vec(),
    };
    for k in dimensions {
        let is_chosen_k = k.map(count) == dimension;
        // What takes more samples, each of as many numbers, takes longer; of fewer numbers, not twice as long.
        let most = if k.map(count) < dimension { 2.0 } else { 1.0 } * work(step, chosen.scale());
        let planned = plan(&setting(1.0, k, 1.0).applied(scene), progress)?;
        if is_chosen_k {
            measured =
                bench.error(renderer, &chosen.applied(scene), &planned, chosen.marched_size(SIZE), progress)?.p95;
        }
        // Not the smallest: so small pictures have few pixels to spare.
        for &scale in &SCALES[..4] {
            let steps = (-3 * PART..=4 * PART).rev().map(|n| voxels(f64::from(n) / f64::from(PART)));
            for longer in steps.take_while(|longer| work(*longer, scale) < most) {
                let tried = setting(longer, k, scale);
                let marched = tried.marched_size(SIZE);
                if bench.error(renderer, &tried.applied(scene), &planned, marched, progress)?.p95 <= *asked {
                    if is_chosen_k && scale.total_cmp(&chosen.scale()).is_eq() {
                        longest = longest.max(longer);
                    }
                    keep.push(tried);
                    break;
                }
            }
        }
    }
    let time = |setting: &Setting| -> Result<f64, ChoiceError> {
        let scene = setting.applied(scene);
        bench.time(renderer, &scene, &plan(&scene, progress)?, setting.marched_size(SIZE), progress)
    };
    let frame_ms = time(&chosen)?;
    let (mut cheapest, mut cheapest_ms) = (chosen.clone(), frame_ms);
    for setting in keep {
        let ms = time(&setting)?;
        if ms < cheapest_ms {
            (cheapest, cheapest_ms) = (setting, ms);
        }
    }
    let samples = longest / step;
    Ok(Some(GoalRow { asked: *asked, measured, setting: chosen, frame_ms, cheapest, cheapest_ms, samples }))
}

/// What became of many scenes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct GoalSummary {
    /// Scenes that show something, and that something keeps what is asked of.
    pub scenes: usize,
    /// The share of them whose pictures keep it.
    pub kept: f64,
    /// The largest error over what was asked for.
    pub worst: f64,
    /// What was chosen costs over the cheapest that would have kept it: the median.
    pub cost: f64,
    /// The most of that.
    pub dearest: f64,
    /// The same in samples, the median.
    pub samples: f64,
}

impl GoalSummary {
    /// The summary of `rows`; `None` of none.
    #[must_use]
    pub fn of(rows: &[GoalRow]) -> Option<Self> {
        let of = |part: &dyn Fn(&GoalRow) -> f64| summary(&rows.iter().map(part).collect::<Vec<_>>());
        let (errors, costs) = (of(&|row| row.measured / row.asked)?, of(&GoalRow::cost)?);
        let kept = rows.iter().filter(|row| row.kept()).count();
        Some(Self {
            scenes: rows.len(),
            kept: count(kept) / count(rows.len()),
            worst: errors.max,
            cost: costs.median,
            dearest: costs.max,
            samples: of(&|row| row.samples)?.median,
        })
    }
}
