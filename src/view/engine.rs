//! Pictures of a state, made in slices: coarse at once, then as fine as the window; relit as often as the light changes.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec2;

use super::export::Snapshot;
use super::load::{Loaded, warn_of_plan};
use super::probe::Pixel;
use crate::document::State;
use crate::film::{Components, RelightMatrices};
use crate::memory::give_back_freed;
use crate::model::{ColourModel, ModelError};
use crate::number::{count, whole};
use crate::plan::{PlanError, Planned, Stale, plan};
use crate::progress::Quiet;
use crate::render::{DeviceFilm, March, Relight, RenderError, Renderer, SceneRenderer, Speed};
use crate::scene::{Scene, positions};
use crate::volume::Statistics;
use crate::vulkan::StorageImage;

/// How long one dispatch of a march may take, about.
pub(super) const DISPATCH: Duration = Duration::from_millis(8);
/// How long a step may take, about: between two frames, nobody waits for it longer than for a frame.
const SLICE: Duration = Duration::from_millis(16);
/// How long a picture may take while a hand moves the camera, about.
const COARSE: Duration = Duration::from_millis(60);
/// Most pixels of the window, across and down, that a pixel of a coarse picture stands for.
const COARSEST: usize = 16;
/// Pixels of a coarse picture for one of the next finer one.
const FINER: usize = 4;

/// What was done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Marches that were begun, coarse ones too.
    pub marches: u64,
    /// Dispatches of all marches.
    pub dispatches: u64,
    /// Times that accumulators were lit.
    pub relights: u64,
}

/// Makes pictures of one loaded scene.
#[derive(Debug)]
pub struct Engine {
    /// The scene of the march under way and of those that refine it.
    on_device: SceneRenderer,
    /// Pixels of the finest picture.
    size: [usize; 2],
    /// The scene to march, where another than the one that is marched or shown.
    wanted: Option<Box<Scene>>,
    /// Another plan, which is made ready beside the window: its colour model, its pipelines, the volume as it needs it.
    planning: Option<Planning>,
    /// The colour model for whoever looks now, which is fitted beside the window.
    fitting: Option<Fitting>,
    marching: Option<Marching>,
    lit: Option<Lit>,
    /// The light to show it in.
    state: Box<State>,
    /// Whether what is shown may have another light than it should.
    unlit: bool,
    /// How often a light was asked for.
    lights: u64,
    /// Whether the last march or relight could not be made: no finer one is tried.
    failed: bool,
    /// Where the next picture of a new scene starts.
    coarse: usize,
    /// How fast the last march by the plan was, for each level.
    speeds: BTreeMap<usize, Speed>,
    counts: Counts,
    changed: Instant,
    /// What is there of what was asked for then.
    reached: Reached,
    /// Marches that were finished.
    pictures: u64,
}

/// Which pictures there are of what was last asked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reached {
    /// A first one.
    pub first: bool,
    /// The finest.
    pub finest: bool,
}

/// What a step has done.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stepped {
    /// Whether the picture is another.
    pub shown: bool,
    /// Whether anything was done on the device: else what is to be done waits for what is made beside the window.
    pub worked: bool,
}

/// A plan under way.
#[derive(Debug)]
struct Planning {
    thread: JoinHandle<Result<SceneRenderer, RenderError>>,
}

/// A fit of a colour model's matrices under way.
#[derive(Debug)]
struct Fitting {
    of: Arc<ColourModel>,
    thread: JoinHandle<Result<ColourModel, ModelError>>,
}

/// A march under way.
#[derive(Debug)]
struct Marching {
    march: March,
    /// Pixels of the window, across and down, that one of its own stands for.
    level: usize,
    spent: Duration,
}

/// A picture that can be shown.
#[derive(Debug)]
struct Lit {
    relight: Relight,
    /// What it is lit by; none before it is.
    by: Option<RelightMatrices>,
    level: usize,
    /// The pixels of the window that it was marched for.
    size: [usize; 2],
    accumulators: DeviceFilm,
    components: Components,
}

impl Lit {
    /// What lights it as `state` asks, to whom its colour model is for; `None` before a march has the light positions of
    /// that.
    fn matrices(&self, state: &State) -> Option<RelightMatrices> {
        let (scene, count) = (&state.scene, self.accumulators.planned.positions.len());
        // Where parallel rays turn, or other materials show, a light may come to stand where another one does, or no longer:
        // the march that is wanted will have as many positions as the mix.
        (positions(scene).len() == count).then(|| {
            let (background, mut display) = (scene.background.as_ref(), scene.display.clone());
            if let Components::Model(model, _) = &self.components {
                display.observer = model.observer();
            }
            RelightMatrices::new(&self.components, count, background, &state.mix(), &display)
        })
    }
}

impl Engine {
    /// Makes pictures of what was `loaded`; nothing is marched yet.
    #[must_use]
    pub fn new(loaded: Loaded) -> Self {
        let Loaded { on_device, file, .. } = loaded;
        let state = State::new(&file);
        Self {
            on_device,
            size: [0; 2],
            wanted: None,
            planning: None,
            fitting: None,
            marching: None,
            lit: None,
            state: Box::new(state),
            unlit: false,
            lights: 0,
            failed: false,
            coarse: FINER,
            speeds: BTreeMap::new(),
            counts: Counts::default(),
            changed: Instant::now(),
            reached: Reached::default(),
            pictures: 0,
        }
    }

    /// Asks for pictures of `size` (width, height) of `scene`. The march of a picture for any other is given up, but for
    /// the coarsest: a hand that never rests sees that one.
    pub fn look(&mut self, scene: &Scene, size: [usize; 2]) {
        let pixels = |[width, height]: [usize; 2]| width * height;
        if pixels(size) > pixels(self.size) {
            // What was quick enough of a small window may not be of a large one.
            self.coarse = self.coarse.max(FINER);
        }
        self.size = size;
        self.wanted = Some(Box::new(scene.clone()));
        self.failed = false;
        self.reached = Reached::default();
        self.changed = Instant::now();
        if self.marching.as_ref().is_some_and(|marching| marching.level < self.coarse) {
            self.marching = None;
        }
    }

    /// Asks for the light of `state`. Nothing is marched.
    pub fn light(&mut self, state: &State) {
        self.unlit = true;
        self.lights += 1;
        *self.state = state.clone();
    }

    /// Asks for pictures of `size` of `state`, and does what has become stale since the last one. Returns whether rays
    /// are marched anew.
    pub fn update(&mut self, state: &State, size: [usize; 2]) -> bool {
        let stale = Stale::between(&self.state.scene, self.planned(), &state.scene);
        // A scene that waits for its plan has its spectra from there.
        let waits = self.wanted.is_some() || self.planning.is_some();
        let marches = stale >= Stale::Accumulators || size != self.size || (waits && stale > Stale::Nothing);
        self.light(state);
        if marches {
            self.look(&state.scene, size);
        } else if stale > Stale::Nothing && !self.failed {
            self.follow_spectra(&state.scene);
        }
        marches
    }

    /// Takes the spectra of `scene`, in which what pixels keep is the same.
    fn follow_spectra(&mut self, scene: &Scene) {
        let planned = self.planned().clone();
        self.on_device.retarget(scene.clone(), planned);
        if let Some(lit) = &mut self.lit
            && let Components::Surfaces(spectra) = &mut lit.components
            && let Components::Surfaces(now) = Components::new(scene, &lit.accumulators.planned)
            && *spectra != now
        {
            *spectra = now;
            // The same numbers are another picture.
            self.pictures += 1;
        }
    }

    /// Lights the picture as it was last asked for. Says whether it is another.
    ///
    /// # Errors
    ///
    /// [`RenderError`]. What failed is not tried again before something else is asked for.
    pub fn show(&mut self) -> Result<bool, RenderError> {
        let shown = self.follow_observer().and_then(|()| self.relight());
        self.attempted(shown)
    }

    /// Goes on for about 16 ms with what there is to do; `hand_rests` allows pictures finer than the first.
    ///
    /// # Errors
    ///
    /// As [`Self::show`].
    pub fn step(&mut self, hand_rests: bool) -> Result<Stepped, RenderError> {
        let stepped = self.advance(hand_rests);
        self.attempted(stepped)
    }

    fn attempted<T>(&mut self, done: Result<T, RenderError>) -> Result<T, RenderError> {
        if done.is_err() {
            (self.wanted, self.marching, self.unlit, self.failed) = (None, None, false, true);
        }
        done
    }

    fn advance(&mut self, hand_rests: bool) -> Result<Stepped, RenderError> {
        let begun = Instant::now();
        self.follow_observer()?;
        let shown = self.relight()?;
        let mut stepped = Stepped { shown, worked: shown };
        // A dispatch begins only where it will be done in time.
        while begun.elapsed() + DISPATCH <= SLICE && self.has_work(hand_rests) {
            if self.marching.is_none() && !self.begin()? {
                break;
            }
            if let Some(marching) = &mut self.marching {
                let dispatched = Instant::now();
                marching.march.step(self.on_device.renderer())?;
                marching.spent += dispatched.elapsed();
                self.counts.dispatches += 1;
                stepped.worked = true;
            }
            if self.marching.as_ref().is_some_and(|marching| marching.march.is_done()) {
                self.finish()?;
                // Else it is the first thing of the next step.
                if begun.elapsed() + DISPATCH <= SLICE {
                    stepped.shown |= self.relight()?;
                }
            }
        }
        Ok(stepped)
    }

    /// Whether [`Self::step`] has anything to do.
    #[must_use]
    pub fn has_work(&self, hand_rests: bool) -> bool {
        let finer = !self.failed && self.lit.as_ref().is_some_and(|lit| lit.level > 1);
        let wanted = self.wanted.is_some() || self.planning.is_some() || self.fitting.is_some();
        // Where nothing can be lit, or no more be made, frames look after it.
        let unlit = self.unlit && !self.failed && self.lit.is_some();
        unlit || wanted || self.marching.is_some() || (hand_rests && finer)
    }

    /// Takes the colour model that was fitted for whoever looks, or begins to fit it; until it is there, the picture is as
    /// it was seen before. What pixels keep stays.
    fn follow_observer(&mut self) -> Result<(), RenderError> {
        if let Some(Fitting { of, thread }) = self.fitting.take_if(|fitting| fitting.thread.is_finished()) {
            // A panic there has been told of.
            if let Ok(fitted) = thread.join() {
                let fitted = Arc::new(fitted.map_err(PlanError::from)?);
                if self.planned().model.as_ref().is_some_and(|model| Arc::ptr_eq(model, &of)) {
                    self.on_device.set_model(Arc::clone(&fitted));
                }
                if let Some(lit) = &mut self.lit
                    && let Components::Model(model, _) = &mut lit.components
                    && Arc::ptr_eq(model, &of)
                {
                    *model = Arc::clone(&fitted);
                    lit.accumulators.planned.model = Some(fitted);
                    // The same numbers are another picture.
                    self.pictures += 1;
                    self.unlit = true;
                }
            }
        }
        let observer = self.state.scene.display.observer;
        let stale = self.planned().model.as_ref().filter(|model| model.observer() != observer);
        if let (Some(of), None) = (stale.map(Arc::clone), &self.fitting) {
            let model = Arc::clone(&of);
            self.fitting = Some(Fitting { of, thread: std::thread::spawn(move || model.seen_by(observer)) });
        }
        Ok(())
    }

    /// Begins the march of what is wanted, or else a finer one of what is shown. Says whether there is one to go on with:
    /// a new plan may take its time.
    fn begin(&mut self) -> Result<bool, RenderError> {
        let mut level = self.lit.as_ref().map(|lit| lit.level).filter(|&level| level > 1).map(|it| it / FINER.min(it));
        if let Some(planning) = self.planning.take() {
            if !planning.thread.is_finished() {
                self.planning = Some(planning);
                return Ok(false);
            }
            // A panic there has been told of.
            if let Ok(on_device) = planning.thread.join() {
                let on_device = on_device?;
                if on_device.planned().plan != self.planned().plan {
                    self.speeds.clear();
                }
                self.on_device = on_device;
                level = Some(self.coarse);
            }
        }
        if let Some(scene) = self.wanted.take() {
            let Some(planned) = self.planned().changed_to(self.scene(), &scene) else {
                self.plan(*scene);
                return Ok(false);
            };
            self.on_device.retarget(*scene, planned);
            level = Some(self.coarse);
        }
        let Some(level) = level else { return Ok(false) };
        let size = self.size.map(|pixels| pixels.div_ceil(level).max(1));
        let elsewhere = || self.speeds.values().next().map(|speed| speed.elsewhere());
        let speed = self.speeds.get(&level).copied().or_else(elsewhere).unwrap_or_else(|| self.renderer().speed());
        let march = self.on_device.begin_march(size, speed)?;
        self.counts.marches += 1;
        self.marching = Some(Marching { march, level, spent: Duration::ZERO });
        Ok(true)
    }

    /// Begins to plan `scene`, and to make ready on the device what the plan runs there.
    fn plan(&mut self, scene: Scene) {
        let before = self.on_device.clone();
        let thread = std::thread::spawn(move || {
            let made = ready(&before, scene);
            // Its volume may have been replaced.
            drop(before);
            give_back_freed();
            made
        });
        self.planning = Some(Planning { thread });
    }

    /// Waits for the plan under way: the end of the program is no time to be at work on the device.
    pub fn end(mut self) {
        // A panic there has been told of.
        self.planning.take().map(|planning| planning.thread.join()).transpose().ok();
    }

    /// Shows what the march has left.
    fn finish(&mut self) -> Result<(), RenderError> {
        let Some(Marching { march, level, spent }) = self.marching.take() else { return Ok(()) };
        self.speeds.insert(level, march.speed());
        if level == self.coarse {
            if spent > COARSE && self.coarse < COARSEST {
                self.coarse *= 2;
            } else if spent < COARSE / 5 && self.coarse > 1 {
                self.coarse /= 2;
            }
        }
        let mut accumulators = march.finish(self.renderer())?;
        let relight = self.renderer().relight_window(&accumulators)?;
        // Its colour model may have been fitted for another observer since.
        accumulators.planned.model.clone_from(&self.planned().model);
        let components = Components::new(self.scene(), &accumulators.planned);
        self.pictures += 1;
        self.lit = Some(Lit { relight, by: None, level, size: self.size, accumulators, components });
        self.unlit = true;
        if self.wanted.is_none() && self.planning.is_none() {
            self.reached = Reached { first: true, finest: self.reached.finest || level == 1 };
        }
        Ok(())
    }

    fn relight(&mut self) -> Result<bool, RenderError> {
        let Some(lit) = self.lit.as_mut().filter(|_| self.unlit) else { return Ok(false) };
        let Some(matrices) = lit.matrices(&self.state) else { return Ok(false) };
        self.unlit = false;
        if lit.by.as_ref() == Some(&matrices) {
            return Ok(false);
        }
        lit.relight.run(&matrices)?;
        lit.by = Some(matrices);
        self.counts.relights += 1;
        Ok(true)
    }

    /// The picture to show: linear light encoded as sRGB, 8 bits, blue first.
    #[must_use]
    pub fn picture(&self) -> Option<&StorageImage> {
        self.lit.as_ref().map(|lit| lit.relight.picture())
    }

    /// What the picture is made of; none before the first.
    #[must_use]
    pub fn snapshot(&self) -> Option<Snapshot> {
        let lit = self.lit.as_ref()?;
        let (renderer, accumulators) = (self.renderer().clone(), lit.accumulators.clone());
        Some(Snapshot { renderer, accumulators, matrices: lit.matrices(&self.state)? })
    }

    /// Whether the picture is the finest one of what was asked for, or the last one that could be made.
    #[must_use]
    pub fn is_finest(&self) -> bool {
        let lit = self.lit.as_ref().is_some_and(|lit| lit.level == 1 && lit.size == self.size);
        (lit || self.failed) && !self.has_work(true)
    }

    /// How far the march under way is, 0 to 1.
    #[must_use]
    pub fn progress(&self) -> Option<f64> {
        let marching = self.marching.as_ref()?;
        let [_, height] = marching.march.size();
        Some(f64::from(marching.march.rows_done()) / count(height.max(1)))
    }

    /// What the picture keeps of the pixel at `place`, in parts of its width and height from the top left; none before the
    /// first picture.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn pixel(&self, place: DVec2) -> Result<Option<Pixel>, RenderError> {
        let Some(Lit { accumulators, components, .. }) = &self.lit else { return Ok(None) };
        let size = accumulators.size;
        let [across, down] = place.to_array();
        let at = |part: f64, pixels: usize| whole((part * count(pixels)).max(0.0)).min(pixels - 1);
        let place = [at(across, size[0]), at(down, size[1])];
        let numbers = self.renderer().read_pixel(accumulators, place)?;
        let (planned, components) = (accumulators.planned.clone(), components.clone());
        Ok(Some(Pixel { place, size, numbers, planned, components }))
    }

    /// How many pictures were finished, coarse ones too: a number that tells one from the next.
    #[must_use]
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// How often a light was asked for: a number that tells one from the next.
    #[must_use]
    pub fn lights(&self) -> u64 {
        self.lights
    }

    /// The scene whose picture is shown or on its way.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        self.on_device.scene()
    }

    /// What the volume's values are like.
    #[must_use]
    pub fn statistics(&self) -> &Statistics {
        self.on_device.statistics()
    }

    /// What was done so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Which pictures there are of what [`Self::look`] last asked for.
    #[must_use]
    pub fn reached(&self) -> Reached {
        self.reached
    }

    /// How long ago [`Self::look`] was last called.
    #[must_use]
    pub fn since_change(&self) -> Duration {
        self.changed.elapsed()
    }

    /// What is computed for each pixel.
    #[must_use]
    pub fn planned(&self) -> &Planned {
        self.on_device.planned()
    }

    /// The renderer, and with it the device.
    #[must_use]
    pub fn renderer(&self) -> &Renderer {
        self.on_device.renderer()
    }
}

/// `scene` planned and on the device, warmed up where its plan differs from the one `before`.
fn ready(before: &SceneRenderer, scene: Scene) -> Result<SceneRenderer, RenderError> {
    let planned = plan(&scene, &Quiet)?;
    warn_of_plan(&planned);
    let on_device = before.with_scene(scene, planned, &Quiet)?;
    if on_device.planned().plan != before.planned().plan {
        on_device.warm_up()?;
    }
    Ok(on_device)
}
