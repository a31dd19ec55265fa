//! Errors and times of settings of one scene on one device.

use glam::DVec3;

use super::clock::{Limit, Stopwatch, Timing, summary};
use super::difference::delta_e;
use super::enlarge::Enlargement;
use super::error::MeasureError;
use super::ladder::{FINER, Ladder, LadderError};
use super::sample::{Drawn, LEAST_PIXELS, drawn, p95_of_all};
use super::setting::{Setting, Value};
use super::shown::{looked_up, picture};
use relume_base::progress::Progress;
use relume_colour::model::ErrorSummary;
use relume_render::{RenderError, Renderer, SceneRenderer};
use relume_scene::plan::{Planned, plan};
use relume_scene::{Coarse, Mix, Scene};

/// Factor by which the truth's steps are shorter than needed, because the next settings tried often have slightly
/// shorter steps.
const AHEAD: f64 = 1.5;

/// A scene on a device, with the true colours of its sampled pixels.
pub struct Bench<'a> {
    scene: &'a Scene,
    ladder: Ladder<'a>,
    /// Estimated number of visible pixels in the picture; the ladder's pixels are a sample of them.
    showing: usize,
    on_device: SceneRenderer,
    /// The level of the volume that the scene asks for, if it is coarser.
    coarse: Option<Coarse>,
    size: [usize; 2],
    truth: Vec<DVec3>,
    /// Step length of the truth, in world units.
    step_length: f64,
    /// Plans by the dimension that a setting states.
    plans: Vec<(Option<Value>, Planned)>,
    /// Dimensions that have rendered a frame. Their first frame waits for pipelines and is not timed.
    warm: Vec<Option<Value>>,
}

/// A setting ready to render.
#[derive(Debug)]
pub struct Ready {
    numbers: Option<Value>,
    on_device: SceneRenderer,
    marched: [usize; 2],
    /// Step length that the setting states, in world units; longer on the device by a coarser level.
    step_length: f64,
}

impl Ready {
    /// Step length in world units.
    #[must_use]
    pub fn step_length(&self) -> f64 {
        self.step_length
    }
}

/// Errors of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// ΔE00 over the sampled pixels.
    pub of_sample: ErrorSummary,
    /// Upper bound of the p95 of ΔE00 over all visible pixels.
    pub at_most: f64,
}

impl std::fmt::Debug for Bench<'_> {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Bench").field("size", &self.size).finish_non_exhaustive()
    }
}

impl<'a> Bench<'a> {
    /// Creates a bench for pictures of `size`. Errors are measured in at most `most` visible pixels, drawn at random
    /// with `seed`; in fewer if `limit` is over before so many are found.
    ///
    /// # Errors
    ///
    /// [`MeasureError`], also if no pixel shows the volume.
    pub fn new(
        renderer: &Renderer,
        scene: &'a Scene,
        mix: &Mix,
        size: [usize; 2],
        (most, seed, limit): (usize, u64, Limit),
        progress: &dyn Progress,
    ) -> Result<Self, MeasureError> {
        let Drawn { ladder, showing } = drawn(scene, mix, size, most, (seed, limit), progress)?;
        if ladder.pixels.is_empty() {
            return Err(MeasureError::Nothing { sampled: size[0] * size[1], source_name: scene.name.clone() });
        }
        let coarse = match scene.level(size).level {
            0 => None,
            level => Some(Coarse::of_level(scene, level, progress).map_err(LadderError::from)?),
        };
        let marched = coarse.as_ref().map_or_else(|| scene.clone(), |coarse| coarse.scene_in(scene, size));
        let planned = plan(&marched, progress)?;
        let statistics = match &coarse {
            None => ladder.statistics().clone(),
            Some(coarse) => coarse.volume().statistics().map_err(LadderError::from)?,
        };
        let on_device = SceneRenderer::with_plan(renderer, marched, planned.clone(), statistics, progress)?;
        let (truth, step_length) = (Vec::new(), f64::INFINITY);
        let (plans, warm) = (vec![(None, planned)], Vec::new());
        Ok(Self { scene, ladder, showing, on_device, coarse, size, truth, step_length, plans, warm })
    }

    /// Prepares `setting` for rendering. It may set only step, dimension and scale; other knobs would need another
    /// upload.
    ///
    /// # Errors
    ///
    /// [`RenderError`] if the setting cannot be planned or uploaded.
    pub fn ready(&mut self, setting: &Setting, progress: &dyn Progress) -> Result<Ready, RenderError> {
        let (stated, numbers) = (setting.applied(self.scene), setting.get("k"));
        let step_length = stated.accuracy.step_length;
        let scene = self.coarse.as_ref().map_or_else(|| stated.clone(), |coarse| coarse.scene_in(&stated, self.size));
        let planned = match self.plans.iter().find(|(known, _)| *known == numbers) {
            Some((_, planned)) => planned.clone(),
            None => {
                let planned = plan(&scene, progress)?;
                self.plans.push((numbers, planned.clone()));
                planned
            }
        };
        let marched = setting.marched_size(self.size);
        let on_device = self.on_device.with_scene(scene, planned, progress)?;
        Ok(Ready { numbers, on_device, marched, step_length })
    }

    /// Checks that the device can hold the picture.
    ///
    /// # Errors
    ///
    /// [`MeasureError::Render`] if it cannot.
    pub fn check(&self, ready: &Ready) -> Result<(), MeasureError> {
        let Ready { on_device, marched, .. } = ready;
        let bytes = on_device.uploaded().bytes();
        Ok(on_device.renderer().check_picture(&on_device.planned().plan, *marched, bytes)?)
    }

    /// Computes the truth for measuring pictures with steps of `step_length`, unless the present one is fine enough.
    /// Steps of an eighth leave a thirtieth of an error proportional to Δs^1.7. Errors are measured in fewer pixels from then
    /// on if `limit` does not suffice for all.
    ///
    /// # Errors
    ///
    /// [`MeasureError::Ladder`] if the reference fails or `progress` asks to stop.
    pub fn truth_for(&mut self, step_length: f64, limit: Limit, progress: &dyn Progress) -> Result<(), MeasureError> {
        if self.step_length > step_length / FINER {
            self.ladder.finest = step_length / AHEAD;
            self.truth = self.ladder.truth_within(&self.ladder.pixels, (limit, LEAST_PIXELS), progress)?;
            self.ladder.pixels.truncate(self.truth.len());
            self.step_length = self.ladder.finest / FINER;
        }
        Ok(())
    }

    /// Number of pixels in which errors are measured.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.ladder.pixels.len()
    }

    /// Errors against the present truth, regardless of the step length it was computed for.
    ///
    /// # Errors
    ///
    /// [`MeasureError`] if the march fails or `progress` asks to stop.
    pub fn errors(&self, ready: &Ready, progress: &dyn Progress) -> Result<Errors, MeasureError> {
        let Ready { on_device, marched, .. } = ready;
        let shown = picture(&self.ladder, on_device, *marched, progress)?;
        let shown = looked_up(&Enlargement::new(*marched, self.size).pixels(&shown), self.size, &self.ladder.pixels);
        let errors = delta_e(&shown, &self.truth);
        Ok(Errors { of_sample: ErrorSummary::of(&errors), at_most: p95_of_all(&errors, self.showing) })
    }

    /// Median frame times of `settings` over `frames` frames each. The settings take turns, so that a disturbance
    /// affects all of them.
    ///
    /// # Errors
    ///
    /// [`MeasureError`] if a march fails or `progress` asks to stop.
    pub fn times(
        &mut self,
        settings: &[Ready],
        frames: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<Timing>, MeasureError> {
        for setting in settings {
            if !self.warm.contains(&setting.numbers) {
                self.frame(setting, progress)?;
                self.warm.push(setting.numbers);
            }
        }
        let mut taken: Vec<Vec<Timing>> = vec![Vec::new(); settings.len()];
        for _ in 0..frames {
            for (setting, taken) in settings.iter().zip(&mut taken) {
                taken.push(self.frame(setting, progress)?);
            }
        }
        let median = |taken: &[Timing], of: fn(&Timing) -> f64| {
            summary(&taken.iter().map(of).collect::<Vec<_>>()).map_or(f64::NAN, |times| times.median)
        };
        let medians = |taken: &Vec<Timing>| Timing {
            wall_ms: median(taken, |timing| timing.wall_ms),
            cpu_ms: median(taken, |timing| timing.cpu_ms),
        };
        Ok(taken.iter().map(medians).collect())
    }

    /// Renders and times one frame.
    fn frame(&self, setting: &Ready, progress: &dyn Progress) -> Result<Timing, MeasureError> {
        let Ready { on_device, marched, .. } = setting;
        let matrices = self.ladder.shown(on_device.scene(), on_device.planned());
        let enlargement = Enlargement::new(*marched, self.size);
        let blank = vec![[0.0; 4]; if enlargement.is_none() { 0 } else { marched[0] * marched[1] }];
        let clock = Stopwatch::start();
        let accumulators = on_device.march(*marched, progress)?;
        let relight = on_device.renderer().relight_display(&accumulators)?;
        relight.run(&matrices)?;
        if !enlargement.is_none() {
            std::hint::black_box(enlargement.pixels(&blank));
        }
        Ok(clock.read())
    }
}
