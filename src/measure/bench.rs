//! A scene on a device, set up to measure what settings err by and take.

use glam::DVec3;

use super::choice::ChoiceError;
use super::clock::{Stopwatch, Timing, summary};
use super::difference::delta_e;
use super::enlarge::Enlargement;
use super::ladder::{FINER, Ladder};
use super::sample::{Drawn, drawn, p95_of_all};
use super::setting::{Knob, Setting, Value};
use super::survey::{looked_up, picture};
use crate::model::ErrorSummary;
use crate::plan::{Planned, plan};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer, SceneRenderer};
use crate::scene::{Mix, Scene};

/// A truth is made for steps by so much shorter than those that it is needed for: the next that are tried are often a little so.
const AHEAD: f64 = 1.5;

/// A scene on a device, and the truth of its pictures.
pub(super) struct Bench<'a> {
    scene: &'a Scene,
    ladder: Ladder<'a>,
    /// How many pixels show anything, of which the ladder's are drawn.
    showing: usize,
    on_device: SceneRenderer,
    size: [usize; 2],
    truth: Vec<DVec3>,
    /// Of the truth, in world units.
    step_length: f64,
    /// By the numbers of a colour model that a setting says.
    plans: Vec<(Option<Value>, Planned)>,
    /// Those of them that a frame was made of: the first one waits for pipelines.
    warm: Vec<Option<Value>>,
}

/// A setting as it is rendered.
pub(super) struct Ready {
    numbers: Option<Value>,
    on_device: SceneRenderer,
    marched: [usize; 2],
}

impl Ready {
    /// In world units.
    pub(super) fn step_length(&self) -> f64 {
        self.on_device.scene().accuracy.step_length
    }
}

/// What a picture errs by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Errors {
    /// Of the pixels that were looked at.
    pub(super) of_sample: ErrorSummary,
    /// What 95 of 100 of all keep: [`p95_of_all`].
    pub(super) at_most: f64,
}

impl<'a> Bench<'a> {
    /// For pictures of `size` of `scene`, whose errors are those of so many pixels, drawn by a seed.
    pub(super) fn new(
        renderer: &Renderer,
        scene: &'a Scene,
        mix: &Mix,
        size: [usize; 2],
        (most, seed): (usize, u64),
        progress: &dyn Progress,
    ) -> Result<Self, ChoiceError> {
        let Drawn { ladder, showing } = drawn(scene, mix, size, most, seed, progress)?;
        if ladder.pixels.is_empty() {
            return Err(ChoiceError::Nothing { source_name: scene.source.clone() });
        }
        let planned = plan(scene, progress)?;
        let statistics = ladder.statistics().clone();
        let on_device = SceneRenderer::with_plan(renderer, scene.clone(), planned.clone(), statistics, progress)?;
        let (truth, step_length) = (Vec::new(), f64::INFINITY);
        let (plans, warm) = (vec![(None, planned)], Vec::new());
        Ok(Self { scene, ladder, showing, on_device, size, truth, step_length, plans, warm })
    }

    /// `setting` of steps, numbers of a colour model and scale as it is rendered: other knobs would need another upload.
    pub(super) fn ready(&mut self, setting: &Setting, progress: &dyn Progress) -> Result<Ready, RenderError> {
        let (scene, numbers) = (setting.applied(self.scene), setting.get(Knob::K));
        let planned = match self.plans.iter().find(|(known, _)| *known == numbers) {
            Some((_, planned)) => planned.clone(),
            None => {
                let planned = plan(&scene, progress)?;
                self.plans.push((numbers, planned.clone()));
                planned
            }
        };
        let marched = setting.marched_size(self.size);
        Ok(Ready { numbers, on_device: self.on_device.with_scene(scene, planned, progress)?, marched })
    }

    /// Refuses a picture that the device cannot hold.
    pub(super) fn check(&self, ready: &Ready) -> Result<(), ChoiceError> {
        let Ready { on_device, marched, .. } = ready;
        let bytes = on_device.uploaded().bytes();
        Ok(on_device.renderer().check_picture(&on_device.planned().plan, *marched, bytes)?)
    }

    /// Makes the truth that errors of pictures with steps of such a length can be told from: an eighth leaves a thirtieth of an
    /// error that goes with the power 1.7 of the step.
    pub(super) fn truth_for(&mut self, step_length: f64, progress: &dyn Progress) -> Result<(), ChoiceError> {
        if self.step_length > step_length / FINER {
            self.ladder.finest = step_length / AHEAD;
            self.truth = self.ladder.truth_in(&self.ladder.pixels, progress)?;
            self.step_length = self.ladder.finest / FINER;
        }
        Ok(())
    }

    /// How far a picture is from the truth, whatever that was made for.
    pub(super) fn errors(&self, ready: &Ready, progress: &dyn Progress) -> Result<Errors, ChoiceError> {
        let Ready { on_device, marched, .. } = ready;
        let shown = picture(&self.ladder, on_device, *marched, progress)?;
        let shown = looked_up(&Enlargement::new(*marched, self.size).pixels(&shown), self.size, &self.ladder.pixels);
        let errors = delta_e(&shown, &self.truth);
        Ok(Errors { of_sample: ErrorSummary::of(&errors), at_most: p95_of_all(&errors, self.showing) })
    }

    /// What frames take, the medians of so many of each: they take turns, so that what disturbs one disturbs all.
    pub(super) fn times(
        &mut self,
        settings: &[Ready],
        frames: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<Timing>, ChoiceError> {
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

    /// What one takes.
    fn frame(&self, setting: &Ready, progress: &dyn Progress) -> Result<Timing, ChoiceError> {
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
