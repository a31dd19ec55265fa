//! Background computations: the probe, measurements of settings and the palette solver.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::{Viewer, Woken};
use crate::document::design::{self, Spectra, Step};
use crate::document::{Document, Edit};
use crate::measure::{Choice, Goal, MeasureError};
use crate::palette::{self, Conflict, Palette, PaletteError, SMOOTHNESS, SmoothCost, Solution};
use crate::progress::Progress;
use crate::render::RenderError;
use crate::scene::Accuracy;
use crate::view::action::Action;
use crate::view::effort::{self, Curve};
use crate::view::prober::StepError;
use crate::view::task::Task;
use crate::vulkan::VulkanError;

/// Least time between two frames that show the progress of a measurement.
pub(super) const NEWS_OF_MEASURING: Duration = Duration::from_millis(700);

/// Largest number of palettes whose conflicts are kept.
const MOST_VERDICTS: usize = 20;

/// Barely visible ΔE00.
const UNSEEN: f64 = 0.5;

/// Measured settings, and the chosen one.
pub(super) type Chosen = Result<(Curve, Option<Choice>), MeasureError>;

/// Result of the palette solver.
pub(super) enum Solved {
    /// Initial palette.
    Offered(Palette),
    /// Solved open spectra of a palette.
    Found {
        /// Palette as requested.
        palette: Arc<Palette>,
        /// Solution.
        solution: Box<Solution>,
        /// Step applied to the palette together with the solution.
        step: Option<Step>,
    },
    /// Costs of smoother spectra for a palette.
    Compared(Arc<Palette>, Vec<SmoothCost>),
}

/// Conflicts of a solved palette.
pub(super) type Verdict = (Arc<Palette>, Vec<Conflict>);

/// Background computations and their last results.
#[derive(Default)]
pub(super) struct Tasks {
    /// Measured settings and the measurement in progress.
    pub(super) curve: Option<Curve>,
    pub(super) measuring: Option<Task<Chosen>>,
    /// Accuracy of the last chosen setting and its description.
    pub(super) chosen: Option<(Accuracy, String)>,
    pub(super) solving: Option<Task<Result<Solved, PaletteError>>>,
    /// Conflicts of the solved palettes.
    pub(super) verdicts: Vec<Verdict>,
    /// Last costs of smoother spectra, and their palette.
    pub(super) smoother: Option<(Arc<Palette>, Vec<SmoothCost>)>,
}

/// Returns the costs of smoother spectra for `document`'s palette, if they are known for it with any smoothness.
pub(super) fn smoother<'a>(tasks: &'a Tasks, document: Option<&Document>) -> &'a [SmoothCost] {
    let plain = |palette: &Palette| palette.smoothed(SMOOTHNESS);
    let now = document.and_then(|document| document.state().palette.as_ref());
    let (Some((of, costs)), Some(now)) = (&tasks.smoother, now) else { return &[] };
    if plain(of) == plain(now) { costs } else { &[] }
}

/// Returns the conflicts of `document`'s palette if it was solved before, possibly before an undo.
pub(super) fn conflicts<'a>(verdicts: &'a [Verdict], document: Option<&Document>) -> &'a [Conflict] {
    let now = document.and_then(|document| document.state().palette.as_ref());
    let verdict = verdicts.iter().find(|(of, _)| Some(of) == now);
    verdict.map_or(&[], |(_, conflicts)| conflicts)
}

/// Returns the notice for a solved palette without known conflicts, given its largest ΔE00.
fn verdict(palette: &Palette, worst: f64) -> Option<String> {
    if palette.cells.is_empty() {
        None
    } else if worst <= UNSEEN {
        Some(format!("Solved: all cells are within ΔE00 {worst:.2} of their targets."))
    } else {
        Some(format!("Solved as far as possible: the worst cell is off by ΔE00 {worst:.2}."))
    }
}

impl Viewer {
    /// Updates the probe. Returns whether it changed.
    pub(super) fn probe(&mut self) -> Result<bool, VulkanError> {
        let (Some(engine), Some(document)) = (&self.engine, &self.opened.document) else { return Ok(false) };
        let proxy = self.proxy.clone();
        let wake = move || drop(proxy.send_event(Woken::Progress));
        match self.picture.prober.step(engine, document.state(), wake) {
            Ok(new) => Ok(new),
            Err(StepError::Render(RenderError::Vulkan(lost @ VulkanError::DeviceLost { .. }))) => Err(lost),
            Err(error) => {
                self.tell(&error);
                Ok(false)
            }
        }
    }

    /// Measures settings of the document, for `goal` or for a curve; cancels a measurement in progress.
    pub(super) fn measure(&mut self, goal: Option<Goal>) {
        let (Some(engine), Some(document)) = (&self.engine, &self.opened.document) else { return };
        let renderer = engine.renderer().clone();
        let (scene, mix) = (document.state().scene.clone(), document.state().mix());
        if let Err(error) = scene.volume().require_voxels("measured settings") {
            return self.tell(&error);
        }
        let (size, cache) = (self.record.report.size, self.options.cache.clone());
        let (proxy, last) = (self.proxy.clone(), Arc::new(Mutex::new(None::<Instant>)));
        // Frames disturb the measurement, so few of them show its progress.
        let wake = move || {
            let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
            if last.is_none_or(|last| last.elapsed() > NEWS_OF_MEASURING) {
                *last = Some(Instant::now());
                drop(proxy.send_event(Woken::Progress));
            }
        };
        self.tasks.measuring = Some(Task::start(wake, move |progress| {
            effort::measure(&renderer, &scene, &mix, size, goal, cache.as_deref(), progress)
        }));
    }

    /// Takes over a finished measurement. Returns whether there was one.
    pub(super) fn measured(&mut self) -> bool {
        let Some(measured) = self.tasks.measuring.as_mut().and_then(Task::take) else { return false };
        self.tasks.measuring = None;
        match measured {
            Err(error) => self.tell(&error),
            Ok((curve, choice)) => {
                match &mut self.tasks.curve {
                    Some(known) => known.merge(curve),
                    none => *none = Some(curve),
                }
                // The old description states times of an earlier measurement.
                self.tasks.chosen = None;
                if let (Some(choice), Some(document)) = (choice, &self.opened.document) {
                    let accuracy = choice.setting.applied(&document.state().scene).accuracy;
                    self.ask(Action::Edit(Edit::Accuracy(accuracy)));
                    let told = format!("Chosen: {}. {}.", choice.setting, choice.why);
                    let taken = self.opened.document.as_ref().map(|document| document.state().scene.accuracy.clone());
                    self.tasks.chosen = taken.map(|accuracy| (accuracy, told));
                    if self.is_scripted() {
                        self.record.report.choices.push(choice);
                    }
                }
            }
        }
        true
    }

    /// Designs a palette for the scene; cancels a solver in progress.
    pub(super) fn offer(&mut self) {
        let Some(document) = &self.opened.document else { return };
        let scene = document.state().scene.clone();
        self.begin_to_solve(move |progress| Ok(Solved::Offered(design::offer(&scene, progress)?)));
    }

    /// Solves the palette's open spectra, after `step` if given; cancels a solver in progress.
    pub(super) fn solve(&mut self, step: Option<Step>) {
        let state = self.opened.document.as_ref().map(Document::state);
        let palette = state.and_then(|state| match &step {
            None => state.palette.clone(),
            Some(step) => step.applied(&state.scene, state.palette.as_deref()).map(Arc::new),
        });
        let Some(palette) = palette else {
            self.note("There is no palette to solve: design one first.".to_owned());
            return;
        };
        self.begin_to_solve(move |progress| {
            let solution = Box::new(palette::solve(&palette, progress)?);
            Ok(Solved::Found { palette, solution, step })
        });
    }

    /// Solves the palette with each preset of smoothness; cancels a solver in progress.
    pub(super) fn compare_smoothness(&mut self) {
        let palette = self.opened.document.as_ref().and_then(|document| document.state().palette.clone());
        let Some(palette) = palette else { return };
        self.begin_to_solve(move |progress| {
            // Of the default smoothness, so that all presets are compared.
            let costs = palette::smoother(&palette.smoothed(SMOOTHNESS), progress)?;
            Ok(Solved::Compared(palette, costs))
        });
    }

    fn begin_to_solve(&mut self, solve: impl FnOnce(&dyn Progress) -> Result<Solved, PaletteError> + Send + 'static) {
        let proxy = self.proxy.clone();
        let wake = move || drop(proxy.send_event(Woken::Progress));
        self.tasks.solving = Some(Task::start(wake, solve));
    }

    /// Takes over a finished solution. Returns whether there was one.
    pub(super) fn solved(&mut self) -> bool {
        let Some(solved) = self.tasks.solving.as_mut().and_then(Task::take) else { return false };
        self.tasks.solving = None;
        match (solved, &self.opened.document) {
            (Err(PaletteError::Cancelled), _) | (_, None) => {}
            (Err(error), _) => self.tell(&error),
            (Ok(Solved::Offered(palette)), _) => self.ask(Action::Edit(Edit::Design(Step::Take(Arc::new(palette))))),
            (Ok(Solved::Compared(palette, costs)), _) => self.tasks.smoother = Some((palette, costs)),
            (Ok(Solved::Found { palette, solution, step }), Some(document)) => {
                let spectra = Spectra { step, ..Spectra::of(&document.state().scene, &solution) };
                self.ask(Action::Edit(Edit::Spectra(Arc::new(spectra))));
                let worst = solution.worst();
                self.record.report.solved.push(worst);
                // The editor opens and explains conflicts whenever the error is visible.
                let conflicts = if worst > UNSEEN { solution.conflicts } else { Vec::new() };
                self.panels.editing |= !conflicts.is_empty();
                self.tasks.verdicts.retain(|(of, _)| *of != palette);
                let told = if conflicts.is_empty() { verdict(&palette, worst) } else { None };
                // The palette may have changed in the meantime.
                let is_there =
                    self.opened.document.as_ref().is_some_and(|it| it.state().palette.as_ref() == Some(&palette));
                told.filter(|_| is_there).into_iter().for_each(|told| self.tell_done(told));
                self.tasks.verdicts.push((palette, conflicts));
                if self.tasks.verdicts.len() > MOST_VERDICTS {
                    self.tasks.verdicts.remove(0);
                }
            }
        }
        true
    }
}
