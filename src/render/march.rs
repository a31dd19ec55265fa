//! The march on the device, in bands of rows and slices of rays, so that every dispatch is short.

mod browser;
mod dispatching;
mod gathered;
mod inputs;
mod light;
mod light_grid;
mod mean;
mod others;
mod read;
mod rounds;
mod schedule;
mod setup;
mod source;
mod tile;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

pub use browser::{BrowserMarch, FieldNumbers, LightTexture, browser_shader};
pub use dispatching::{Dispatching, TableMemory, Target};
pub use inputs::MarchUniform;
pub use rounds::BrickCounts;
pub use schedule::Speed;

pub(super) use dispatching::SLICE;
pub(super) use read::read_layer;
pub(super) use source::{common, images, source};

use super::pool::Pool;
use super::{RenderError, Renderer, Uploaded};
use gathered::Scattered;
use light_grid::DeviceGrid;
use mean::Mean;
use relume_base::number::whole;
use relume_base::progress::Progress;
use relume_scene::Scene;
use relume_scene::plan::Planned;
use relume_vulkan::{ComputePipeline, ResourceSet, StorageImage};
use rounds::Rounds;
use schedule::Schedule;

/// A film on the device. Clones share its images.
#[derive(Clone, Debug)]
pub struct DeviceFilm {
    /// The plan of its march.
    pub planned: Planned,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Number of dispatches of its march.
    pub dispatches: usize,
    /// Duration of these dispatches by the device's clock; `None` if it has none.
    pub device_time: Option<Duration>,
    /// Number of occupied macrocells, and of all macrocells.
    pub occupied: [usize; 2],
    /// Spacing of its light grid in voxels, if it has one: the stated one, or more where memory is short.
    pub light_spacing: Option<f64>,
    /// Voxels of the volume whose mean is one of those that its light grid was filled from, along each axis, if these are of a
    /// coarse level.
    pub light_block: Option<[usize; 3]>,
    /// Bricks that its march loaded, if the volume is in bricks.
    pub bricks: Option<BrickCounts>,
    pub(super) accumulators: StorageImage,
    pub(super) transmittance: StorageImage,
}

/// Light of a march that takes long to find: that of a light grid, and scattered light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightQuality {
    /// A coarse light grid, and the last scattered light or none: a picture of a view that changes.
    Last,
    /// A coarse light grid, and [rough](Scene::with_rough_scattering) scattered light.
    Rough,
    /// As the scene states it.
    Full,
}

/// A march in progress. It pauses after every dispatch, and is cancelled by dropping it.
#[derive(Debug)]
pub struct March {
    pipeline: ComputePipeline,
    set: ResourceSet,
    schedule: Schedule,
    left: DeviceFilm,
    grid: Option<Arc<DeviceGrid>>,
    /// Light that has scattered before.
    scattered: Option<Scattered>,
    /// Quality of its light, if light scatters more than once.
    quality: Option<LightQuality>,
    /// Rounds of a volume in bricks.
    rounds: Option<Rounds>,
    /// Places of the rays of a pixel that remain after the current one, the last first.
    places: Vec<schedule::RayPlace>,
    /// Mean of the finished rays; `None` if a pixel has one ray.
    mean: Option<Mean>,
    /// True if a block is marched, whose rays begin with the film in the images.
    is_block: bool,
}

impl Renderer {
    /// Marches a picture of `size` (width, height) of the `uploaded` volume of `scene`.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn march(
        &self,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        size: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<DeviceFilm, RenderError> {
        let known =
            self.learnt().as_ref().filter(|(plan, _)| *plan == planned.plan).map(|(_, speed)| speed.elsewhere());
        let mut march = self.begin_march(scene, planned, uploaded, size, known.unwrap_or(self.speed))?;
        while !march.is_done() {
            if progress.cancelled() {
                return Err(RenderError::Cancelled);
            }
            march.step(self, uploaded)?;
            if let Some([done, all]) = march.gathering() {
                progress.report("gathering scattered light", done as u64, all as u64);
            } else {
                let [done, all] = march.rows();
                progress.report("marching", done as u64, all as u64);
            }
        }
        *self.learnt() = Some((planned.plan.clone(), march.speed()));
        march.finish(self)
    }
}

impl March {
    /// Whether only [`Self::finish`] remains.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.schedule.is_done()
            && self.rounds.as_ref().is_none_or(|rounds| rounds.done)
            && self.places.is_empty()
            && self.mean.as_ref().is_none_or(|mean| mean.has_all())
    }

    /// Whether its light grid and its scattered light are complete, or it has none.
    #[must_use]
    pub fn fill_is_done(&self) -> bool {
        self.grid.as_ref().is_none_or(|grid| grid.is_complete())
            && self.scattered.as_ref().is_none_or(Scattered::is_complete)
    }

    /// The light that it takes: [`LightQuality::Full`] where an earlier march has left that; `None` if light scatters once.
    #[must_use]
    pub const fn scattered_light(&self) -> Option<LightQuality> {
        self.quality
    }

    /// Parts of its scattered light that are gathered, and all; `None` if it waits for none.
    #[must_use]
    pub fn gathering(&self) -> Option<[usize; 2]> {
        self.scattered.as_ref().and_then(Scattered::progress)
    }

    /// Number of finished rows, and of all rows: those of the picture, once for each ray of a pixel.
    #[must_use]
    pub fn rows(&self) -> [usize; 2] {
        let [height, row] = [self.schedule.size[1], self.schedule.row].map(|rows| rows as usize);
        let all = self.left.planned.plan.rays * height;
        let done = match &self.rounds {
            Some(rounds) if rounds.done => height,
            Some(rounds) if !rounds.is_single() => rounds.passed(height),
            _ => row.min(height),
        };
        [all - (self.places.len() + 1) * height + done, all]
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        self.left.size
    }

    /// Speed measured so far.
    #[must_use]
    pub fn speed(&self) -> Speed {
        self.schedule.speed()
    }

    /// Runs the next dispatch on `renderer`, which must be the one that began the march of `uploaded`. The light grid is
    /// completed first, and then the scattered light, for which it waits a moment.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`], [`RenderError::Shader`].
    pub fn step(&mut self, renderer: &Renderer, uploaded: &Uploaded) -> Result<(), RenderError> {
        if let Some(grid) = self.grid.as_ref().filter(|grid| !grid.is_complete()) {
            return grid.advance(renderer, &self.left.planned, uploaded);
        }
        if let Some(scattered) = self.scattered.as_mut().filter(|scattered| !scattered.is_complete()) {
            return scattered.advance(renderer, uploaded);
        }
        if let (Some(rounds), Some(pool)) = (&mut self.rounds, &uploaded.pool) {
            if rounds.is_loading() {
                return rounds.load(renderer, uploaded, pool);
            }
            if self.schedule.is_done()
                && !rounds.done
                && let Some(round) = rounds.settle(renderer, pool)?
            {
                self.schedule.begin_round(round);
                return Ok(());
            }
        }
        self.dispatch(renderer, uploaded)
    }

    /// Runs the next dispatch, whether or not bricks are to be loaded before.
    pub(super) fn dispatch(&mut self, renderer: &Renderer, uploaded: &Uploaded) -> Result<(), RenderError> {
        if self.schedule.is_done() {
            if let Some(mean) = &mut self.mean {
                mean.add(renderer)?;
            }
            if let Some(place) = self.places.pop() {
                self.schedule.begin_rays(place);
                if self.is_block {
                    renderer.fill_with_light(
                        [&self.left.accumulators, &self.left.transmittance],
                        &self.left.planned.plan,
                    )?;
                }
                if let Some(rounds) = &mut self.rounds {
                    rounds.restart()?;
                }
            }
        }
        let Some((band, rows)) = self.schedule.next() else { return Ok(()) };
        // No other march moves bricks under this dispatch.
        let held = uploaded.pool.as_ref().map(Pool::held);
        let begun = Instant::now();
        let took = renderer.device.run_timed("march", |recorder| {
            // A later ray overwrites what the mean has read, and a later round what an earlier one has written.
            if band.first_sample > 0 || self.mean.is_some() || self.rounds.is_some() {
                recorder.compute_to_compute();
            }
            let group = self.schedule.dispatching.group;
            let groups = [self.schedule.size[0].div_ceil(group[0]), rows.div_ceil(group[1]), 1];
            recorder.dispatch(&self.pipeline, &self.set, bytemuck::bytes_of(&band), groups)
        })?;
        drop(held);
        renderer.shared.longest_dispatch.fetch_max(whole(self.schedule.taken) as u64, Ordering::Relaxed);
        self.schedule.took(begun.elapsed());
        self.left.device_time = self.left.device_time.zip(took).map(|(sum, took)| sum + took);
        self.left.dispatches += 1;
        Ok(())
    }

    /// As [`Self::step`], but does not wait for bricks to be read: a thread does that, and meanwhile the device does nothing.
    /// Returns whether the device did any work.
    ///
    /// # Errors
    ///
    /// As for [`Self::step`], and [`RenderError::Volume`] if a file of bricks cannot be read.
    pub fn step_ahead(&mut self, renderer: &Renderer, uploaded: &Uploaded) -> Result<bool, RenderError> {
        if let (Some(rounds), Some(pool)) = (&mut self.rounds, &uploaded.pool)
            && rounds.is_loading()
        {
            return rounds.load_ahead(renderer, uploaded, pool);
        }
        self.step(renderer, uploaded).map(|()| true)
    }

    /// Bricks of the present round that are loaded, all that it waits for, and its number from 1; `None` of a volume that the
    /// device holds whole.
    #[must_use]
    pub fn bricks(&self) -> Option<[usize; 3]> {
        self.rounds.as_ref().map(|rounds| {
            let [loaded, all] = rounds.progress();
            [loaded, all, rounds.counts.rounds]
        })
    }

    /// Returns the film of a finished march, stored as its plan states.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn finish(self, renderer: &Renderer) -> Result<DeviceFilm, RenderError> {
        let left = DeviceFilm { bricks: self.rounds.as_ref().map(|rounds| rounds.counts), ..self.left };
        renderer.store(match self.mean {
            None => left,
            Some(mean) => DeviceFilm { accumulators: mean.accumulators, transmittance: mean.transmittance, ..left },
        })
    }
}
