//! Keeps the probe of one pixel up to date: values of the film immediately, the marched ray from a background task.

use std::sync::Arc;

use glam::DVec2;

use super::engine::Engine;
use super::probe::{Pixel, Probe, ProbeError, Ray};
use super::task::Task;
use crate::document::State;
use crate::film::Components;
use crate::model::ColourModel;
use crate::render::RenderError;
use crate::scene::positions;
use crate::tables::Reflected;

/// Results of the background task.
struct Behind {
    reflected: Option<Reflected>,
    ray: Result<Ray, ProbeError>,
}

/// Probes one pixel.
#[derive(Debug, Default)]
pub struct Prober {
    /// Position of the pixel, as fractions of the picture from the top left.
    place: Option<DVec2>,
    /// Numbers of the picture that `pixel` belongs to and of the light of `probe`.
    picture: u64,
    light: u64,
    pixel: Option<Pixel>,
    /// Spectra reconstructed from a colour model's coefficients, which is slow; with their model.
    reflected: Option<(Arc<ColourModel>, Reflected)>,
    job: Option<Task<Behind>>,
    ray: Option<Ray>,
    /// Whether the ray was marched or cannot be.
    followed: bool,
    probe: Option<Probe>,
}

impl std::fmt::Debug for Behind {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.debug_struct("Behind").field("ray", &self.ray.is_ok()).finish_non_exhaustive()
    }
}

impl Prober {
    /// Selects the pixel to probe; `None` for no pixel.
    pub fn look(&mut self, place: Option<DVec2>) {
        let inside = |place: DVec2| if place.is_finite() { place.clamp(DVec2::ZERO, DVec2::ONE) } else { DVec2::ZERO };
        let place = place.map(inside);
        if place != self.place {
            let reflected = self.reflected.take();
            *self = Self { place, reflected, ..Self::default() };
        }
    }

    /// Position of the pixel, as fractions of the picture.
    #[must_use]
    pub fn place(&self) -> Option<DVec2> {
        self.place
    }

    /// Current probe.
    #[must_use]
    pub fn probe(&self) -> Option<&Probe> {
        self.probe.as_ref()
    }

    /// Whether the probe is complete or no pixel is selected.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.place.is_none() || self.followed
    }

    /// Updates the probe from the picture of `engine`, which shows `state`. `wake` is called when there is more to
    /// update.
    /// Returns whether anything changed.
    ///
    /// # Errors
    ///
    /// [`RenderError`] if the pixel cannot be read, [`ProbeError`] if its ray cannot be marched.
    pub fn step(
        &mut self,
        engine: &Engine,
        state: &State,
        wake: impl Fn() + Send + Sync + Clone + 'static,
    ) -> Result<bool, StepError> {
        let Some(place) = self.place else { return Ok(false) };
        let mut new = self.light != engine.lights();
        if self.picture != engine.pictures() {
            let reflected = self.reflected.take();
            *self = Self { place: self.place, reflected, picture: engine.pictures(), ..Self::default() };
            self.pixel = engine.pixel(place).inspect_err(|_| self.followed = true)?;
            new = true;
        }
        let Some(pixel) = &self.pixel else {
            // A finest state without a picture means that there will be none.
            self.followed |= engine.is_finest();
            return Ok(false);
        };
        let model = match &pixel.means.components {
            Components::Model(model, _) => Some(Arc::clone(model)),
            Components::Surfaces(_) => None,
        };
        let known =
            |(of, _): &(Arc<ColourModel>, Reflected)| model.as_ref().is_some_and(|model| Arc::ptr_eq(of, model));
        let lacks_spectra = model.is_some() && !self.reflected.as_ref().is_some_and(known);
        if let Some(behind) = self.job.as_mut().and_then(Task::take) {
            (self.job, self.followed, new) = (None, true, true);
            if let (Some(model), Some(reflected)) = (&model, behind.reflected) {
                self.reflected = Some((Arc::clone(model), reflected));
            }
            self.ray = Some(behind.ray?);
        } else if self.job.is_none() && !self.followed && engine.is_finest() {
            let ((scene, block), statistics) = (engine.scene_at_hand(), engine.statistics().clone());
            let (which, components) = ([pixel.size, pixel.place], pixel.means.components.clone());
            self.job = Some(Task::start(wake, move |progress| {
                let background = scene.background.as_ref();
                let reflected = lacks_spectra.then(|| Reflected::new(&components, background));
                let ray = Ray::march(&scene, &statistics, which, progress);
                Behind { reflected, ray: ray.map(|ray| ray.of_blocks(block)) }
            }));
        }
        // The refitted picture for another observer is still pending.
        let is_seen = model.as_ref().is_none_or(|model| model.observer() == state.scene.display.observer);
        // If light positions have merged or separated, the pending picture has the right ones.
        if new && is_seen && positions(&state.scene).len() == pixel.planned.positions.len() {
            self.light = engine.lights();
            let exact = || Reflected::new(&pixel.means.components, state.scene.background.as_ref());
            let reflected = match &model {
                None => Some(exact()),
                Some(_) => self.reflected.as_ref().filter(|one| known(one)).map(|(_, reflected)| reflected.clone()),
            };
            let mix = state.mix();
            self.probe = Some(Probe::new(pixel, &state.scene, &mix, reflected.as_ref(), self.ray.as_ref()));
        }
        Ok(new)
    }

    /// Cancels the background task and waits for its thread to end.
    pub fn end(&mut self) {
        if let Some(job) = self.job.take() {
            job.end();
        }
    }
}

/// Reason why a pixel cannot be probed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// Error of the device.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Its ray.
    #[error("cannot march the ray of this pixel")]
    Ray(#[from] ProbeError),
}

impl StepError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Render(error) => error.code(),
            Self::Ray(error) => error.code(),
        }
    }
}
