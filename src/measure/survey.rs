//! Settings of a scene measured on a device: what each costs, and how far from the truth it is and why.

use std::sync::Arc;
use std::time::Duration;

use glam::DVec3;
use serde::Serialize;

use super::clock::{Stopwatch, Summary, Timing, summary};
use super::difference::{Difference, delta_e};
use super::enlarge::Enlargement;
use super::ladder::{Cause, Ladder, LadderError, Lattice};
use super::setting::Setting;
use crate::plan::{PlanError, Planned, ScenePlan, plan};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer, Uploaded};
use crate::scene::{Mix, Scene};
use crate::spectrum::colour::XYZ_FROM_LINEAR_SRGB;
use crate::tables::TransferTable;
use crate::vulkan::DeviceKind;

/// Runs before those that count.
const WARM_UP: usize = 2;

/// What is measured of every setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurveyOptions {
    /// Pixels of the pictures whose time is taken, across and down.
    pub size: [usize; 2],
    /// The most of them whose error is.
    pub pixels: usize,
    /// Runs that count, after two that warm up.
    pub runs: usize,
}

/// What repeated work took.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// On the wall, in ms.
    pub wall_ms: Summary,
    /// Of all threads of this process on a CPU, in ms.
    pub cpu_ms: Summary,
    /// By the device's own clock, in ms; `None` where it has none, or where the work is not one of commands.
    pub device_ms: Option<Summary>,
}

impl Cost {
    /// That of `runs`; zeros of none.
    fn of(runs: &[(Timing, Option<Duration>)]) -> Self {
        let over = |times: Vec<f64>| summary(&times);
        let nothing = Summary { median: 0.0, min: 0.0, max: 0.0 };
        let device: Option<Vec<f64>> = runs.iter().map(|(_, took)| Some(took.as_ref()?.as_secs_f64() * 1e3)).collect();
        Self {
            wall_ms: over(runs.iter().map(|(time, _)| time.wall_ms).collect()).unwrap_or(nothing),
            cpu_ms: over(runs.iter().map(|(time, _)| time.cpu_ms).collect()).unwrap_or(nothing),
            device_ms: device.and_then(over),
        }
    }
}

/// What a setting takes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Times {
    /// The volume onto the device, once.
    pub upload: Cost,
    /// Tables and march of a frame.
    pub march: Cost,
    /// Accumulators to 8-bit sRGB.
    pub relight: Cost,
    /// That from the device.
    pub read_back: Cost,
    /// The picture enlarged to the size that is shown, on the CPU; `None` where all pixels are marched.
    pub enlarge: Option<Cost>,
}

/// A setting, measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Where the knobs stand.
    pub setting: Setting,
    /// What carries spectra, in words.
    pub carrier: String,
    /// Numbers that a pixel keeps per light position.
    pub components: usize,
    /// Times.
    pub times: Times,
    /// March, relight and enlarging on the wall, medians, in ms: what a frame takes.
    pub frame_ms: f64,
    /// Dispatches of a march.
    pub dispatches: usize,
    /// Bytes that a finished pixel keeps.
    pub pixel_bytes: u64,
    /// Bytes of the volume on the device.
    pub volume_bytes: u64,
    /// Bytes of the volume, the tables and the picture while it is marched.
    pub total_bytes: u64,
    /// From the truth.
    pub error: Difference,
    /// From rung to rung; their ΔE00 need not add up to that.
    pub causes: Vec<(Cause, Difference)>,
    /// p in error ∝ Δsᵖ, from the mean ΔE00 of full spectra at Δs and Δs/2; `None` where there is no error.
    pub order: Option<f64>,
    /// Whether no other setting measured is both faster and closer to the truth ([`super::mark_pareto`]).
    pub pareto: bool,
    /// ΔE00 of each pixel of [`Survey::pixels`].
    #[serde(skip)]
    pub differences: Vec<f64>,
    /// XYZ of each of them on the device.
    #[serde(skip)]
    pub colours: Vec<DVec3>,
}

/// Why a setting could not be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SurveyError {
    /// There is no such plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The reference gave up.
    #[error(transparent)]
    Ladder(#[from] LadderError),
    /// The device gave up.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Nothing can be measured where nothing is seen.
    #[error(
        "none of the {looked_at} pixels that were looked at shows anything of {source_name}: there is no error to measure"
    )]
    Nothing {
        /// How many there were.
        looked_at: usize,
        /// The scene.
        source_name: String,
    },
}

/// Pixels across and down of a close-up.
const CLOSE_UP: usize = 17;

/// A square of a picture, pixel by pixel, row by row.
#[derive(Clone, Debug)]
pub struct CloseUp {
    /// Pixels across and down.
    pub side: usize,
    /// The first of them in the picture, x and y from the top left.
    pub first: [usize; 2],
    /// XYZ as it should be.
    pub truth: Vec<DVec3>,
    /// XYZ on the device.
    pub shown: Vec<DVec3>,
    /// ΔE00 of the two.
    pub differences: Vec<f64>,
}

/// A volume on the device, and what it was put there for.
struct Resident {
    plan: ScenePlan,
    uploaded: Uploaded,
    cost: Cost,
}

/// Measures settings of one scene on one device.
pub struct Survey<'a> {
    renderer: &'a Renderer,
    scene: &'a Scene,
    options: SurveyOptions,
    lattice: Lattice,
    ladder: Ladder<'a>,
    truth: Arc<Vec<DVec3>>,
    resident: Option<Resident>,
    /// What was measured. A knob that is turned to where the scene has it is measured no second time: it would take another
    /// time.
    known: Vec<(Same, Measured)>,
}

/// What settings have in common that are the same.
#[derive(PartialEq)]
struct Same {
    plan: ScenePlan,
    carrier: String,
    /// Step, termination and scale.
    numbers: [f64; 3],
    /// Of the transfer table.
    entries: usize,
}

/// What carries spectra, in words.
fn carrier(planned: &Planned) -> String {
    let weights = || format!("weights of {} components", planned.plan.components());
    planned.model.as_ref().map_or_else(weights, |model| model.description())
}

impl std::fmt::Debug for Survey<'_> {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Survey").field("options", &self.options).finish_non_exhaustive()
    }
}

impl<'a> Survey<'a> {
    /// A survey of `scene`; the truth is computed for the shortest step of `settings`.
    ///
    /// # Errors
    ///
    /// [`SurveyError`].
    pub fn new(
        renderer: &'a Renderer,
        scene: &'a Scene,
        settings: &[Setting],
        options: SurveyOptions,
        progress: &dyn Progress,
    ) -> Result<Self, SurveyError> {
        let lattice = Lattice::new(options.size, options.pixels);
        let steps = settings.iter().map(|setting| setting.applied(scene).accuracy.step_length);
        let finest = steps.fold(scene.accuracy.step_length, f64::min);
        let looked_at = lattice.pixels();
        let mut ladder = Ladder::new(scene, Mix::of_scene(scene), options.size, &looked_at, finest, progress)?;
        if ladder.pixels.is_empty() {
            return Err(SurveyError::Nothing { looked_at: looked_at.len(), source_name: scene.source.clone() });
        }
        let truth = ladder.truth(progress)?;
        Ok(Self { renderer, scene, options, lattice, ladder, truth, resident: None, known: Vec::new() })
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        self.scene
    }

    /// Which pixels were looked at.
    #[must_use]
    pub fn lattice(&self) -> Lattice {
        self.lattice
    }

    /// Those of them that show something: the ones whose errors are measured.
    #[must_use]
    pub fn pixels(&self) -> &[[usize; 2]] {
        &self.ladder.pixels
    }

    /// The truth in those pixels: XYZ of the full spectrum, as the display shows it.
    #[must_use]
    pub fn truth(&self) -> &[DVec3] {
        &self.truth
    }

    /// XYZ of what is behind the volume.
    #[must_use]
    pub fn background(&self) -> DVec3 {
        self.ladder.background
    }

    /// The device in words.
    #[must_use]
    pub fn device(&self) -> String {
        let info = self.renderer.device().info();
        let software = if info.kind == DeviceKind::Software { ", a software device: times are this CPU's" } else { "" };
        format!("{} ({}){software}", info.name, info.driver)
    }

    /// Measures `setting`.
    ///
    /// # Errors
    ///
    /// [`SurveyError`].
    pub fn measure(&mut self, setting: &Setting, progress: &dyn Progress) -> Result<Measured, SurveyError> {
        let progress = &Unreported(progress);
        let scene = setting.applied(self.scene);
        let planned = plan(&scene, progress)?;
        self.upload(&scene, &planned, progress)?;
        let size = setting.marched_size(self.options.size);
        let Some(Resident { uploaded, cost: upload, .. }) = &self.resident else {
            return Err(RenderError::Cancelled.into());
        };
        let table = TransferTable::new(&scene, &planned, uploaded.storage.domain);
        let same = Same {
            plan: planned.plan.clone(),
            carrier: carrier(&planned),
            numbers: [scene.accuracy.step_length, scene.accuracy.termination, setting.scale()],
            entries: table.entries(),
        };
        if let Some((_, row)) = self.known.iter().find(|(known, _)| *known == same) {
            return Ok(Measured { setting: setting.clone(), ..row.clone() });
        }
        let volume_bytes = uploaded.bytes();
        let upload = *upload;
        let frames = self.frames(&scene, &planned, uploaded, size, progress)?;
        let whole_size = if size == self.options.size {
            frames.picture.clone()
        } else {
            picture(self.renderer, &self.ladder, &scene, &planned, uploaded, self.options.size, progress)?
        };

        let truth = Arc::clone(&self.truth);
        let mut climb = Climb { pixels: self.ladder.pixels.clone(), last: truth.to_vec(), causes: Vec::new() };
        let accuracy = &scene.accuracy;
        let stated = self.scene.accuracy.interpolation;
        let stepped = self.ladder.full(accuracy.step_length, 0.0, stated, progress)?;
        let halved = self.ladder.full(accuracy.step_length / 2.0, 0.0, stated, progress)?;
        let order = order(&delta_e(&stepped, &truth), &delta_e(&halved, &truth));
        climb.to(Cause::Step, stepped.to_vec());
        if accuracy.interpolation != stated {
            let other = self.ladder.full(accuracy.step_length, 0.0, accuracy.interpolation, progress)?;
            climb.to(Cause::Interpolation, other.to_vec());
        }
        let ended = (accuracy.step_length, accuracy.termination, accuracy.interpolation);
        climb.to(Cause::Termination, self.ladder.full(ended.0, ended.1, ended.2, progress)?.to_vec());
        climb.to(Cause::Basis, self.ladder.model(&scene, &planned, progress)?);
        climb.to(Cause::Tables, self.ladder.stored::<f64>(&scene, &planned, &table, progress)?);
        climb.to(Cause::Rounding, self.ladder.stored::<f32>(&scene, &planned, &table, progress)?);
        climb.to(Cause::Device, looked_up(&whole_size, self.options.size, &self.ladder.pixels));
        if size != self.options.size {
            climb.to(Cause::Resolution, looked_up(&frames.picture, self.options.size, &self.ladder.pixels));
        }
        let colours = climb.last;
        let plan = &planned.plan;
        let tables = size_of_val(table.source.as_slice()) + size_of_val(table.opacity.as_slice());
        let row = Measured {
            setting: setting.clone(),
            carrier: same.carrier.clone(),
            components: plan.components(),
            frame_ms: frames.frame_ms(),
            times: Times {
                upload,
                march: frames.march,
                relight: frames.relight,
                read_back: frames.read_back,
                enlarge: frames.enlarge,
            },
            dispatches: frames.dispatches,
            pixel_bytes: plan.pixel_bytes(),
            volume_bytes,
            total_bytes: volume_bytes + tables as u64 + (size[0] * size[1]) as u64 * plan.marched_bytes(),
            error: Difference::between(&colours, &truth, &self.ladder.pixels),
            causes: climb.causes,
            order,
            pareto: false,
            differences: delta_e(&colours, &truth),
            colours,
        };
        self.known.push((same, row.clone()));
        Ok(row)
    }

    /// What a frame of `setting` takes now, in ms: another time than before is what other programs did.
    ///
    /// # Errors
    ///
    /// [`SurveyError`].
    pub fn time_again(&mut self, setting: &Setting, progress: &dyn Progress) -> Result<f64, SurveyError> {
        let progress = &Unreported(progress);
        let scene = setting.applied(self.scene);
        let planned = plan(&scene, progress)?;
        self.upload(&scene, &planned, progress)?;
        let Some(Resident { uploaded, .. }) = &self.resident else { return Err(RenderError::Cancelled.into()) };
        let size = setting.marched_size(self.options.size);
        Ok(self.frames(&scene, &planned, uploaded, size, progress)?.frame_ms())
    }

    /// The surroundings of the worst pixel of `row`, pixel by pixel; `None` where it has no error.
    ///
    /// # Errors
    ///
    /// [`SurveyError`].
    pub fn close_up(&mut self, row: &Measured, progress: &dyn Progress) -> Result<Option<CloseUp>, SurveyError> {
        let Some(worst) = row.error.at else { return Ok(None) };
        let progress = &Unreported(progress);
        let side = CLOSE_UP.min(self.options.size[0]).min(self.options.size[1]);
        let first: [usize; 2] =
            std::array::from_fn(|axis| worst[axis].saturating_sub(side / 2).min(self.options.size[axis] - side));
        let pixels: Vec<[usize; 2]> = (0..side * side).map(|i| [first[0] + i % side, first[1] + i / side]).collect();
        let scene = row.setting.applied(self.scene);
        let planned = plan(&scene, progress)?;
        self.upload(&scene, &planned, progress)?;
        let Some(Resident { uploaded, .. }) = &self.resident else { return Ok(None) };
        let size = row.setting.marched_size(self.options.size);
        let marched = picture(self.renderer, &self.ladder, &scene, &planned, uploaded, size, progress)?;
        let shown = looked_up(&Enlargement::new(size, self.options.size).pixels(&marched), self.options.size, &pixels);
        let truth = self.ladder.truth_in(&pixels, progress)?;
        Ok(Some(CloseUp { side, first, differences: delta_e(&shown, &truth), shown, truth }))
    }

    /// Puts the volume onto the device as `planned` needs it, unless it is there.
    fn upload(&mut self, scene: &Scene, planned: &Planned, progress: &dyn Progress) -> Result<(), SurveyError> {
        let interpolation = planned.plan.interpolation;
        let fits = |it: &Resident| it.plan.is_stored_as(&planned.plan) && it.plan.interpolation == interpolation;
        if self.resident.as_ref().is_some_and(fits) {
            return Ok(());
        }
        self.resident = None;
        let mut runs = Vec::new();
        for run in 0..WARM_UP + self.options.runs {
            let clock = Stopwatch::start();
            let uploaded = self.renderer.upload(scene, planned, self.ladder.statistics(), progress)?;
            runs.push((clock.read(), None));
            if run + 1 == WARM_UP + self.options.runs {
                let cost = Cost::of(&runs[WARM_UP..]);
                self.resident = Some(Resident { plan: planned.plan.clone(), uploaded, cost });
            }
        }
        Ok(())
    }

    /// Frames of `size`, timed, and the last of them, as large as it is shown.
    fn frames(
        &self,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        size: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<Frames, SurveyError> {
        let matrices = self.ladder.shown(scene, planned);
        let (mut marches, mut relights, mut read_backs) = (Vec::new(), Vec::new(), Vec::new());
        let mut dispatches = 0;
        for _ in 0..WARM_UP + self.options.runs {
            let clock = Stopwatch::start();
            let accumulators = self.renderer.march(scene, planned, uploaded, size, progress)?;
            marches.push((clock.read(), accumulators.device_time));
            dispatches = accumulators.dispatches;
            let relight = self.renderer.relight_display(&accumulators)?;
            let clock = Stopwatch::start();
            let took = relight.run(&matrices)?;
            relights.push((clock.read(), took));
            let clock = Stopwatch::start();
            let _picture: Vec<[u8; 4]> = relight.read()?;
            read_backs.push((clock.read(), None));
        }
        let mut picture = picture(self.renderer, &self.ladder, scene, planned, uploaded, size, progress)?;
        let mut enlarge = None;
        let enlargement = Enlargement::new(size, self.options.size);
        if !enlargement.is_none() {
            let (mut enlarged, mut runs) = (Vec::new(), Vec::new());
            for _ in 0..WARM_UP + self.options.runs {
                let clock = Stopwatch::start();
                enlarged = enlargement.pixels(&picture);
                runs.push((clock.read(), None));
            }
            (picture, enlarge) = (enlarged, Some(Cost::of(&runs[WARM_UP..])));
        }
        let [march, relight, read_back] = [marches, relights, read_backs].map(|runs| Cost::of(&runs[WARM_UP..]));
        Ok(Frames { march, relight, read_back, enlarge, dispatches, picture })
    }
}

/// Frames that were timed.
struct Frames {
    march: Cost,
    relight: Cost,
    read_back: Cost,
    enlarge: Option<Cost>,
    dispatches: usize,
    /// Linear RGBA, as large as it is shown.
    picture: Vec<[f32; 4]>,
}

impl Frames {
    /// What a frame takes on the wall, medians.
    fn frame_ms(&self) -> f64 {
        [Some(self.march), Some(self.relight), self.enlarge].into_iter().flatten().map(|cost| cost.wall_ms.median).sum()
    }
}

/// Linear RGBA of every pixel, marched and relit on the device.
pub(super) fn picture(
    renderer: &Renderer,
    ladder: &Ladder<'_>,
    scene: &Scene,
    planned: &Planned,
    uploaded: &Uploaded,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Vec<[f32; 4]>, RenderError> {
    let accumulators = renderer.march(scene, planned, uploaded, size, progress)?;
    let relight = renderer.relight_linear(&accumulators)?;
    relight.run(&ladder.shown(scene, planned))?;
    relight.read()
}

/// XYZ of `pixels` of a picture of `size`.
pub(super) fn looked_up(picture: &[[f32; 4]], size: [usize; 2], pixels: &[[usize; 2]]) -> Vec<DVec3> {
    let of_pixel = |[x, y]: &[usize; 2]| {
        let [red, green, blue, _] = picture.get(x + size[0] * y).copied().unwrap_or([f32::NAN; 4]);
        *XYZ_FROM_LINEAR_SRGB * DVec3::new(red.into(), green.into(), blue.into())
    };
    pixels.iter().map(of_pixel).collect()
}

/// Rung after rung.
struct Climb {
    pixels: Vec<[usize; 2]>,
    last: Vec<DVec3>,
    causes: Vec<(Cause, Difference)>,
}

impl Climb {
    fn to(&mut self, cause: Cause, next: Vec<DVec3>) {
        self.causes.push((cause, Difference::between(&next, &self.last, &self.pixels)));
        self.last = next;
    }
}

/// p in error ∝ Δsᵖ, from the means of errors at Δs and Δs/2.
fn order(at_step: &[f64], at_half: &[f64]) -> Option<f64> {
    let [whole, half] = [at_step, at_half].map(|errors| errors.iter().sum::<f64>());
    (whole > 0.0 && half > 0.0 && whole.is_finite() && half.is_finite()).then(|| (whole / half).log2())
}

/// Hears that work should stop, and reports nothing: who measures reports settings.
struct Unreported<'a>(&'a dyn Progress);

impl Progress for Unreported<'_> {
    fn report(&self, _stage: &str, _done: u64, _total: u64) {}

    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_that_quarter_when_the_step_halves_are_of_second_order() {
        assert_eq!(order(&[4.0, 8.0], &[1.0, 2.0]), Some(2.0));
        assert_eq!(order(&[0.0], &[0.0]), None);
    }
}
