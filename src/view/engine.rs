//! Renders a state in slices: a coarse picture first, then finer ones up to the window's size, relit when the light
//! changes.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use glam::DVec2;

use super::export::Snapshot;
use super::load::{Loaded, warn_of_plan};
use super::probe::Pixel;
use super::task::Task;
use crate::document::State;
use crate::film::{Components, RelightMatrices, Relightable};
use crate::memory::give_back_freed;
use crate::model::{ColourModel, ModelError};
use crate::number::{count, whole};
use crate::plan::{PlanError, Planned, Stale, plan, read_ahead};
use crate::progress::Progress;
use crate::render::{
    BrickCounts, DeviceFilm, Job, LightQuality, March, PlannedJob, Relight, RenderError, Renderer, SceneRenderer, Speed,
};
use crate::scene::{Backdrop, Coarse, Scene, positions};
use crate::volume::Statistics;
use crate::vulkan::StorageImage;

/// Approximate duration of one dispatch of a march.
pub(super) const DISPATCH: Duration = Duration::from_millis(8);
/// Approximate duration of a step: work between two frames delays input by no more than a frame.
const SLICE: Duration = Duration::from_millis(16);
/// Approximate duration of a picture while the camera moves.
const COARSE: Duration = Duration::from_millis(60);
/// Largest width and height, in window pixels, of a pixel of a coarse picture.
const COARSEST: usize = 16;
/// Factor between the pixel widths of a coarse picture and the next finer one.
const FINER: usize = 4;
/// Level of the picture with all rays of every pixel, if the scene has several; the levels before it have one.
const ALL_RAYS: usize = 0;

/// Numbers of operations so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Counts {
    /// Marches started, coarse ones included.
    pub marches: u64,
    /// Dispatches of all marches.
    pub dispatches: u64,
    /// Relights.
    pub relights: u64,
}

/// Renders pictures of one loaded scene.
#[derive(Debug)]
pub struct Engine {
    /// Scene of the current march and of its refinements; with a coarse level in place of a volume in bricks.
    on_device: SceneRenderer,
    /// The volume in bricks, of which `on_device` has a coarse level.
    bricks: Option<Bricks>,
    /// Size of the finest picture, in pixels.
    size: [usize; 2],
    /// Scene to march next, if it differs from the scene that is marched or shown.
    wanted: Option<Box<Scene>>,
    /// New plan in preparation in the background: its colour model, its pipelines and the volume in its storage format.
    planning: Option<Task<Result<SceneRenderer, RenderError>>>,
    /// Colour model for the current observer, fitted in the background.
    fitting: Option<Fitting>,
    marching: Option<Marching>,
    lit: Option<Lit>,
    /// State whose light the picture shows.
    state: Box<State>,
    /// Whether the light has changed since the last relight.
    unlit: bool,
    /// Number of requested lights.
    lights: u64,
    /// Whether the last march or relight failed; no finer one is tried then.
    failed: bool,
    /// Whether all voxels of a volume in bricks are planned or marched, or that failed: the coarse picture is complete.
    refines: bool,
    /// Whether the user stopped the refinement.
    stopped: bool,
    /// Level of the next picture of a new scene.
    coarse: usize,
    /// Speed of the last march with this plan, per level.
    speeds: BTreeMap<usize, Speed>,
    counts: Counts,
    changed: Instant,
    /// Pictures completed since the last change.
    reached: Reached,
    /// Number of finished marches.
    pictures: u64,
}

/// Pictures completed since the last request.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reached {
    /// A first picture.
    pub first: bool,
    /// The finest picture.
    pub finest: bool,
}

/// Result of a step.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stepped {
    /// Whether the picture changed.
    pub shown: bool,
    /// Whether the device did any work; otherwise the remaining work waits for a background task.
    pub worked: bool,
}

/// A volume in bricks.
#[derive(Debug)]
struct Bricks {
    coarse: Coarse,
    /// The scene with the volume itself.
    scene: Box<Scene>,
    /// It on the device, once it is planned. The bricks there stay between marches.
    on_device: Option<SceneRenderer>,
    /// Plan in preparation.
    planning: Option<Planning>,
    /// Speed of the last march.
    speed: Option<Speed>,
}

/// Next picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// At this level.
    Level(usize, LightQuality),
    /// Of all voxels of a volume in bricks.
    Voxels,
}

/// Coarse level of the volume that the picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShownLevel {
    /// Its number; 0 are the voxels themselves.
    pub level: u32,
    /// Number of voxels whose mean is one of it.
    pub voxels: usize,
    /// State of its refinement.
    pub then: Refining,
}

/// Refinement of a coarse level of the volume.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refining {
    /// It waits until the hand rests and the coarse picture is complete.
    Waits,
    /// It is being planned.
    Prepares,
    /// Bricks that are loaded, those that the round needs, and its number from 1.
    Loads([usize; 3]),
    /// The bricks that are loaded are marched.
    Marches,
    /// The user stopped it.
    Stopped,
    /// It failed.
    Failed,
}

/// Planning of a volume in bricks in the background.
#[derive(Debug)]
struct Planning {
    job: Task<Prepared>,
    /// Whether the scene has changed since: an error of the former one does not concern it.
    outdated: bool,
}

/// Result of such planning.
#[derive(Debug)]
struct Prepared {
    /// The scene on the device, or the former one if the bricks there are still of use.
    on_device: Option<SceneRenderer>,
    made: Result<(), RenderError>,
}

/// Fit of a colour model's matrices in the background.
#[derive(Debug)]
struct Fitting {
    of: Arc<ColourModel>,
    thread: JoinHandle<Result<ColourModel, ModelError>>,
}

/// March in progress.
#[derive(Debug)]
struct Marching {
    march: March,
    /// Width and height of a pixel of the march, in window pixels; or [`ALL_RAYS`].
    level: usize,
    /// Whether it is of all voxels of a volume in bricks.
    of_bricks: bool,
    spent: Duration,
}

/// Picture ready to be shown.
#[derive(Debug)]
struct Lit {
    relight: Relight,
    /// Matrices of the last relight; `None` before the first.
    by: Option<RelightMatrices>,
    level: usize,
    /// Its scattered light, if it has any.
    scattered: Option<LightQuality>,
    /// Whether it is of all voxels of a volume in bricks.
    of_bricks: bool,
    /// Window size for which the picture was marched, in pixels.
    size: [usize; 2],
    accumulators: DeviceFilm,
    means: Relightable,
    /// Exposure of this film where the state has an automatic one.
    exposure: Option<f64>,
    /// Backdrop that `relight` was prepared for.
    backdrop: Backdrop,
}

impl Lit {
    /// Returns the relight matrices for `state` and the colour model's observer; `None` while the film lacks the light
    /// positions of `state`.
    fn matrices(&self, state: &State) -> Option<RelightMatrices> {
        let (scene, count) = (&state.scene, self.accumulators.planned.positions.len());
        // When directional lights turn or other materials become visible, light positions may merge or separate. The
        // pending
        // march will have as many positions as the mix.
        (positions(scene).len() == count).then(|| {
            let mut display = scene.display.clone();
            display.exposure = display.exposure.or(self.exposure);
            if let Components::Model(model, _) = &self.means.components {
                display.observer = model.observer();
            }
            self.means.under_on(&state.mix(), scene.background.as_ref(), &display)
        })
    }
}

impl Engine {
    /// Creates the engine for the scene `loaded`, without marching.
    #[must_use]
    pub fn new(loaded: Loaded) -> Self {
        let Loaded { on_device, coarse, file, .. } = loaded;
        let state = State::new(&file);
        let scene = || Box::new(state.scene.clone());
        let bricks =
            coarse.map(|coarse| Bricks { coarse, scene: scene(), on_device: None, planning: None, speed: None });
        Self {
            on_device,
            bricks,
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
            refines: false,
            stopped: false,
            coarse: FINER,
            speeds: BTreeMap::new(),
            counts: Counts::default(),
            changed: Instant::now(),
            reached: Reached::default(),
            pictures: 0,
        }
    }

    /// Requests pictures of `scene` in `size` (width, height). Cancels any other march except one at the coarsest
    /// level that waits for no scattered light: it stays visible during continuous input.
    pub fn look(&mut self, scene: &Scene, size: [usize; 2]) {
        let pixels = |[width, height]: [usize; 2]| width * height;
        if pixels(size) > pixels(self.size) {
            // A level that was fast enough in a small window may not be in a large one.
            self.coarse = self.coarse.max(FINER);
        }
        self.size = size;
        self.wanted = Some(Box::new(self.marched(scene).into_owned()));
        if let Some(bricks) = &mut self.bricks {
            bricks.change(scene);
        }
        (self.failed, self.refines) = (false, false);
        self.resume();
        self.reached = Reached::default();
        self.changed = Instant::now();
        let takes_long = |Marching { march, level, of_bricks, .. }: &Marching| {
            *of_bricks || *level < self.coarse || march.gathering().is_some()
        };
        if self.marching.as_ref().is_some_and(takes_long) {
            self.marching = None;
        }
    }

    /// `scene` as it is marched first: with a coarse level in place of a volume in bricks.
    fn marched<'a>(&self, scene: &'a Scene) -> Cow<'a, Scene> {
        self.bricks.as_ref().map_or(Cow::Borrowed(scene), |bricks| Cow::Owned(bricks.coarse.scene(scene)))
    }

    /// Stops the refinement of a coarse level of the volume until the next [`update`](Self::update). The bricks that are loaded stay.
    pub fn stop(&mut self) {
        if self.bricks.is_some() {
            self.marching.take_if(|marching| marching.of_bricks);
            self.stopped = true;
        }
        if let Some(planning) = self.bricks.as_ref().and_then(|bricks| bricks.planning.as_ref()) {
            planning.job.cancel();
        }
    }

    /// Ends a stop, except one before the first picture, which holds for it.
    fn resume(&mut self) {
        self.stopped &= self.lit.is_none();
    }

    /// Requests the light of `state`, without a march.
    pub fn light(&mut self, state: &State) {
        self.unlit = true;
        self.lights += 1;
        *self.state = state.clone();
    }

    /// Requests pictures of `state` in `size`, updates everything that has become stale, and ends a stop. Returns whether a new
    /// march is needed.
    pub fn update(&mut self, state: &State, size: [usize; 2]) -> bool {
        self.resume();
        self.renew(state, size)
    }

    /// As [`Self::update`], but a stop goes on: a tour changes the light by itself.
    pub fn renew(&mut self, state: &State, size: [usize; 2]) -> bool {
        // Of a volume in bricks, the coarse level decides: comparing plans reads voxels.
        let [before, after] = [&self.state.scene, &state.scene].map(|scene| self.marched(scene));
        let stale = Stale::between(&before, self.planned(), &after);
        // A scene waiting for its plan takes its spectra from the plan.
        let waits = self.wanted.is_some() || self.planning.is_some();
        let marches = stale >= Stale::Accumulators || size != self.size || (waits && stale > Stale::Nothing);
        self.light(state);
        if marches {
            self.look(&state.scene, size);
        } else if stale > Stale::Nothing && (!self.failed || self.refines) {
            self.follow_spectra(&state.scene);
        }
        marches
    }

    /// Takes over the spectra of `scene`, which leave the films valid.
    fn follow_spectra(&mut self, scene: &Scene) {
        let planned = self.planned().clone();
        self.on_device.retarget(self.marched(scene).into_owned(), planned);
        if let Some(bricks) = &mut self.bricks {
            bricks.change(scene);
        }
        if let Some(lit) = &mut self.lit
            && let Components::Surfaces(spectra) = &mut lit.means.components
            && let Components::Surfaces(now) = Components::new(scene, &lit.accumulators.planned)
            && *spectra != now
        {
            *spectra = now;
            // The same film yields another picture.
            self.pictures += 1;
        }
    }

    /// Relights the picture as last requested. Returns whether it changed.
    ///
    /// # Errors
    ///
    /// [`RenderError`]. A failed operation is not repeated before the next request.
    pub fn show(&mut self) -> Result<bool, RenderError> {
        let shown = self.follow_observer().and_then(|()| self.relight());
        self.attempted(shown)
    }

    /// Continues the outstanding work for about 16 ms; `hand_rests` allows pictures finer than the first.
    ///
    /// # Errors
    ///
    /// As for [`Self::show`].
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
        // A dispatch starts only if it is expected to end in time.
        while begun.elapsed() + DISPATCH <= SLICE && self.has_work(hand_rests) {
            if self.marching.is_none() && !self.begin()? {
                break;
            }
            if let Some(marching) = &mut self.marching {
                let of_bricks = self.bricks.as_ref().and_then(|bricks| bricks.on_device.as_ref());
                let on_device = of_bricks.filter(|_| marching.of_bricks).unwrap_or(&self.on_device);
                let (dispatched, waits) = (Instant::now(), marching.march.gathering().is_some());
                if !marching.march.step_ahead(on_device.renderer(), on_device.uploaded())? {
                    // Bricks are being read.
                    break;
                }
                if !waits {
                    marching.spent += dispatched.elapsed();
                }
                self.counts.dispatches += 1;
                stepped.worked = true;
            }
            if self.marching.as_ref().is_some_and(|marching| marching.march.is_done()) {
                self.finish()?;
                // Otherwise the next step starts with it.
                if begun.elapsed() + DISPATCH <= SLICE {
                    stepped.shown |= self.relight()?;
                }
            }
        }
        Ok(stepped)
    }

    /// Whether [`Self::step`] has work to do.
    #[must_use]
    pub fn has_work(&self, hand_rests: bool) -> bool {
        let finer = !self.failed && self.finer().is_some();
        let wanted = self.wanted.is_some() || self.planning.is_some() || self.fitting.is_some();
        // Without a picture or after a failure, frames handle the relight.
        let unlit = self.unlit && !self.failed && self.lit.is_some();
        unlit || wanted || self.marching.is_some() || (hand_rests && finer)
    }

    /// Applies the colour model fitted for the current observer, or starts its fit; until then the picture keeps the
    /// previous
    /// observer. Films stay valid.
    fn follow_observer(&mut self) -> Result<(), RenderError> {
        if let Some(Fitting { of, thread }) = self.fitting.take_if(|fitting| fitting.thread.is_finished()) {
            // A panic of the thread has already been reported.
            if let Ok(fitted) = thread.join() {
                let fitted = Arc::new(fitted.map_err(PlanError::from)?);
                let of_bricks = self.bricks.as_mut().and_then(|bricks| bricks.on_device.as_mut());
                for on_device in [Some(&mut self.on_device), of_bricks].into_iter().flatten() {
                    if on_device.planned().model.as_ref().is_some_and(|model| Arc::ptr_eq(model, &of)) {
                        on_device.set_model(Arc::clone(&fitted));
                    }
                }
                if let Some(lit) = &mut self.lit
                    && let Components::Model(model, _) = &mut lit.means.components
                    && Arc::ptr_eq(model, &of)
                {
                    *model = Arc::clone(&fitted);
                    lit.accumulators.planned.model = Some(fitted);
                    // The same film yields another picture.
                    self.pictures += 1;
                    self.unlit = true;
                }
            }
        }
        let observer = self.state.scene.display.observer;
        let of_bricks = self.bricks.as_ref().and_then(|bricks| bricks.on_device.as_ref());
        // The model of the picture first.
        let of_picture = self.lit.as_ref().and_then(|lit| lit.accumulators.planned.model.as_ref());
        let of_plans = [Some(&self.on_device), of_bricks].map(|it| it.and_then(|it| it.planned().model.as_ref()));
        let mut models = [of_picture].into_iter().chain(of_plans).flatten();
        let stale = models.find(|model| model.observer() != observer);
        if let (Some(of), None) = (stale.map(Arc::clone), &self.fitting) {
            let model = Arc::clone(&of);
            self.fitting = Some(Fitting { of, thread: std::thread::spawn(move || model.seen_by(observer)) });
        }
        Ok(())
    }

    /// Level of the finest picture.
    fn finest_level(&self) -> usize {
        // Several rays a pixel are for all voxels.
        if self.planned().plan.rays > 1 && self.bricks.is_none() { ALL_RAYS } else { 1 }
    }

    /// Whether no picture is finer than that of `lit`.
    fn is_complete(&self, lit: &Lit) -> bool {
        if self.bricks.is_some() {
            lit.of_bricks
        } else {
            lit.level == self.finest_level() && lit.scattered.is_none_or(|lighting| lighting == LightQuality::Full)
        }
    }

    /// Picture after the shown one, if there is a finer one.
    fn finer(&self) -> Option<Next> {
        let finest = self.finest_level();
        let lit = self.lit.as_ref().filter(|lit| !self.is_complete(lit))?;
        let finer = match lit.level {
            level if level > 1 => level / FINER.min(level),
            _ => finest,
        };
        match (lit.level, lit.scattered) {
            // Light that has scattered shows in a picture as coarse as before, while the rest of it is gathered.
            (level, Some(LightQuality::Last)) => Some(Next::Level(level, LightQuality::Rough)),
            // Of bricks, all voxels follow, with light of their own.
            (1, Some(LightQuality::Rough)) if self.bricks.is_none() => Some(Next::Level(1, LightQuality::Full)),
            (level, _) if level == finest => (!self.stopped).then_some(Next::Voxels),
            _ => Some(Next::Level(finer, LightQuality::Rough)),
        }
    }

    /// Starts the march of the requested scene, or else a refinement of the shown one. Returns whether a march has
    /// started; a
    /// new plan may delay it.
    fn begin(&mut self) -> Result<bool, RenderError> {
        let mut next = self.finer();
        self.refines = false;
        if let Some(mut planning) = self.planning.take() {
            if !planning.is_over() {
                self.planning = Some(planning);
                return Ok(false);
            }
            match planning.take().ok_or(RenderError::Panicked).flatten() {
                Ok(on_device) => {
                    if on_device.planned().plan != self.planned().plan {
                        self.speeds.clear();
                    }
                    self.on_device = on_device;
                    next = Some(Next::Level(self.coarse, LightQuality::Last));
                }
                Err(error) if self.wanted.is_none() => return Err(error),
                // It concerns a scene that nobody waits for any more.
                Err(_) => {}
            }
        }
        if let Some(scene) = self.wanted.take() {
            let Some(planned) = self.planned().changed_to(self.on_device.scene(), &scene) else {
                self.plan(*scene);
                return Ok(false);
            };
            self.on_device.retarget(*scene, planned);
            next = Some(Next::Level(self.coarse, LightQuality::Last));
        }
        let (level, lighting) = match next {
            None => return Ok(false),
            Some(Next::Voxels) => {
                self.refines = true;
                return self.begin_voxels();
            }
            Some(Next::Level(level, lighting)) => (level, lighting),
        };
        let of_bricks = self.bricks.as_ref().and_then(|bricks| bricks.on_device.as_ref());
        self.on_device.set_beside(of_bricks.map_or(0, |on_device| on_device.uploaded().bytes()));
        let size = self.size.map(|pixels| pixels.div_ceil(level.max(1)).max(1));
        let elsewhere = || self.speeds.values().next().map(|speed| speed.elsewhere());
        let speed = self.speeds.get(&level).copied().or_else(elsewhere).unwrap_or_else(|| self.renderer().speed());
        let march = match level {
            ALL_RAYS => self.on_device.begin_march(size, speed)?,
            // Without scattered light, no picture of this size follows.
            1 if self.planned().plan.light.gathered.is_none() => {
                self.on_device.begin_march_of_one_ray(size, speed, LightQuality::Full)?
            }
            _ => self.on_device.begin_march_of_one_ray(size, speed, lighting)?,
        };
        self.counts.marches += 1;
        self.marching = Some(Marching { march, level, of_bricks: false, spent: Duration::ZERO });
        Ok(true)
    }

    /// Starts the march of all voxels of the volume in bricks; its plan may delay it.
    fn begin_voxels(&mut self) -> Result<bool, RenderError> {
        let Some(bricks) = &mut self.bricks else { return Ok(false) };
        if let Some(mut planning) = bricks.planning.take() {
            if !planning.job.is_over() {
                bricks.planning = Some(planning);
                return Ok(false);
            }
            let Prepared { on_device, made } = planning.job.take().ok_or(RenderError::Panicked)?;
            bricks.on_device = on_device;
            match made {
                Ok(()) => bricks.speed = None,
                // The present scene is planned anew.
                Err(_) if planning.outdated || planning.job.is_cancelled() => {}
                Err(error) => return Err(error),
            }
        }
        let planned = bricks.on_device.as_ref().and_then(|on_device| {
            let planned = on_device.planned().changed_to(on_device.scene(), &bricks.scene)?;
            on_device.holds(&bricks.scene, &planned).then_some(planned)
        });
        let (Some(planned), Some(on_device)) = (planned, &mut bricks.on_device) else {
            bricks.plan(&self.on_device);
            return Ok(false);
        };
        on_device.retarget((*bricks.scene).clone(), planned);
        let speed = bricks.speed.unwrap_or_else(|| on_device.renderer().speed());
        let march = on_device.begin_march(self.size, speed)?;
        self.counts.marches += 1;
        self.marching = Some(Marching { march, level: 1, of_bricks: true, spent: Duration::ZERO });
        Ok(true)
    }

    /// Starts to plan `scene` in the background and to prepare the device for the plan.
    fn plan(&mut self, scene: Scene) {
        let before = self.on_device.clone();
        let planning = move |progress: &dyn Progress| {
            let made = ready(&before, scene, progress);
            // This may be the last use of a replaced volume.
            drop(before);
            give_back_freed();
            made
        };
        self.planning = Some(Task::start(|| {}, planning));
    }

    /// Cancels the planning, and returns its threads, which may take a moment to end: they must not use the device while the
    /// program exits.
    #[must_use]
    pub fn give_up(self) -> Vec<JoinHandle<()>> {
        let of_bricks = self.bricks.and_then(|bricks| bricks.planning);
        let threads = [self.planning.map(Task::give_up), of_bricks.map(|planning| planning.job.give_up())];
        threads.into_iter().flatten().flatten().collect()
    }

    /// Cancels the planning and waits for its threads.
    pub fn end(self) {
        for thread in self.give_up() {
            // A panic of the thread has already been reported.
            thread.join().ok();
        }
    }

    /// Shows the film of the finished march.
    fn finish(&mut self) -> Result<(), RenderError> {
        let Some(Marching { march, level, of_bricks, spent }) = self.marching.take() else { return Ok(()) };
        match &mut self.bricks {
            Some(bricks) if of_bricks => bricks.speed = Some(march.speed()),
            _ => {
                self.speeds.insert(level, march.speed());
                if level == self.coarse {
                    if spent > COARSE && self.coarse < COARSEST {
                        self.coarse *= 2;
                    } else if spent < COARSE / 5 && self.coarse > 1 {
                        self.coarse /= 2;
                    }
                }
            }
        }
        let bricks = self.bricks.as_ref().filter(|_| of_bricks);
        let marched = bricks.and_then(|bricks| bricks.on_device.as_ref()).unwrap_or(&self.on_device);
        let model = marched.planned().model.clone();
        let scattered = march.scattered_light();
        let mut accumulators = march.finish(self.renderer())?;
        let backdrop = self.state.scene.display.backdrop;
        let relight = self.renderer().relight_window(&accumulators, backdrop)?;
        // Its colour model may have been refitted for another observer in the meantime.
        accumulators.planned.model = model;
        // Spectra that leave the film valid may have changed, too. Before a coarse march ends, `bricks` may have a scene of
        // other materials, which waits for its plan.
        let scene = bricks.map_or_else(|| self.on_device.scene(), |bricks| &bricks.scene);
        let means = Relightable::new(scene, &accumulators.planned);
        self.pictures += 1;
        self.lit = Some(Lit {
            relight,
            by: None,
            level,
            scattered,
            of_bricks,
            size: self.size,
            accumulators,
            means,
            exposure: None,
            backdrop,
        });
        self.unlit = true;
        if self.wanted.is_none() && self.planning.is_none() {
            let complete = self.lit.as_ref().is_some_and(|lit| self.is_complete(lit));
            self.reached = Reached { first: true, finest: self.reached.finest || complete };
        }
        Ok(())
    }

    fn relight(&mut self) -> Result<bool, RenderError> {
        let Some(lit) = self.lit.as_mut().filter(|_| self.unlit) else { return Ok(false) };
        let Some(mut matrices) = lit.matrices(&self.state) else { return Ok(false) };
        let display = &self.state.scene.display;
        if display.exposure.is_some() {
            // Another automatic one is that of its own lights.
            lit.exposure = None;
        } else if lit.exposure.is_none() {
            let renderer = self.on_device.renderer();
            let exposure = renderer.automatic_exposure(&lit.accumulators, &matrices, &self.state.mix(), display)?;
            lit.exposure = Some(exposure);
            matrices = lit.matrices(&self.state).unwrap_or(matrices);
        }
        self.unlit = false;
        if lit.by.as_ref() == Some(&matrices) {
            return Ok(false);
        }
        if lit.backdrop != display.backdrop {
            lit.backdrop = display.backdrop;
            lit.relight = self.on_device.renderer().relight_window(&lit.accumulators, lit.backdrop)?;
        }
        lit.relight.run(&matrices)?;
        lit.by = Some(matrices);
        self.counts.relights += 1;
        Ok(true)
    }

    /// The picture to show: linear light encoded as sRGB, 8 bits per channel, BGRA.
    #[must_use]
    pub fn picture(&self) -> Option<&StorageImage> {
        self.lit.as_ref().map(|lit| lit.relight.picture())
    }

    /// Returns the film and relight matrices of the picture; `None` before the first picture.
    #[must_use]
    pub fn snapshot(&self) -> Option<Snapshot> {
        let lit = self.lit.as_ref()?;
        let (renderer, accumulators) = (self.renderer().clone(), lit.accumulators.clone());
        Some(Snapshot { renderer, accumulators, matrices: lit.matrices(&self.state)? })
    }

    /// Whether the picture is the finest one requested, or the last one before a failure or before [`Self::stop`].
    #[must_use]
    pub fn is_finest(&self) -> bool {
        let lit = self.lit.as_ref().is_some_and(|lit| self.is_complete(lit) && lit.size == self.size);
        (lit || self.failed || (self.stopped && self.lit.is_some())) && !self.has_work(true)
    }

    /// The exposure of the finest picture, if that of its state is automatic.
    #[must_use]
    pub fn found_exposure(&self) -> Option<f64> {
        let lit = self.lit.as_ref().filter(|_| self.state.scene.display.exposure.is_none() && self.is_finest())?;
        lit.exposure
    }

    /// Coarse level of the volume that the picture shows; `None` if it shows all voxels, and before the first picture.
    #[must_use]
    pub fn shown_level(&self) -> Option<ShownLevel> {
        let (bricks, lit) = (self.bricks.as_ref()?, self.lit.as_ref()?);
        let of_bricks = self.marching.as_ref().filter(|marching| marching.of_bricks);
        let then = match of_bricks.and_then(|marching| marching.march.bricks()) {
            _ if self.failed => Refining::Failed,
            _ if self.stopped => Refining::Stopped,
            Some(bricks @ [loaded, all, _]) if loaded < all => Refining::Loads(bricks),
            Some(_) => Refining::Marches,
            None if bricks.planning.is_some() => Refining::Prepares,
            None => Refining::Waits,
        };
        let voxels = bricks.coarse.block().iter().product();
        (!lit.of_bricks).then_some(ShownLevel { level: bricks.coarse.level(), voxels, then })
    }

    /// Bricks that the march of the picture loaded, if it shows all voxels of a volume in bricks.
    #[must_use]
    pub fn brick_counts(&self) -> Option<BrickCounts> {
        self.lit.as_ref().and_then(|lit| lit.accumulators.bricks)
    }

    /// Voxels whose mean is one of the coarse level that the shadows of the picture come from, along each axis, if it shows all
    /// voxels of a volume in bricks.
    #[must_use]
    pub fn light_block(&self) -> Option<[usize; 3]> {
        self.lit.as_ref().and_then(|lit| lit.accumulators.light_block)
    }

    /// Pixels of the marched picture that is shown, across and down; fewer than the window's while it is coarse.
    #[must_use]
    pub fn resolution(&self) -> Option<[usize; 2]> {
        self.lit.as_ref().map(|lit| lit.size.map(|pixels| pixels.div_ceil(lit.level.max(1))))
    }

    /// Completed fraction of the current march, or of the scattered light that it waits for, 0 to 1.
    #[must_use]
    pub fn progress(&self) -> Option<f64> {
        let marching = self.marching.as_ref()?;
        if let Some([done, all]) = marching.march.gathering() {
            return Some(count(done) / count(all.max(1)));
        }
        let [done, all] = marching.march.rows();
        Some(count(done) / count(all.max(1)))
    }

    /// Returns the film's values at the pixel at `place`, given as fractions of the width and height from the top left;
    /// `None`
    /// before the first picture.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn pixel(&self, place: DVec2) -> Result<Option<Pixel>, RenderError> {
        let Some(Lit { accumulators, means, .. }) = &self.lit else { return Ok(None) };
        let size = accumulators.size;
        let [across, down] = place.to_array();
        let at = |part: f64, pixels: usize| whole((part * count(pixels)).max(0.0)).min(pixels - 1);
        let place = [at(across, size[0]), at(down, size[1])];
        let numbers = self.renderer().read_pixel(accumulators, place)?;
        Ok(Some(Pixel { place, size, numbers, planned: accumulators.planned.clone(), means: means.clone() }))
    }

    /// Number of finished pictures, coarse ones included; identifies a picture.
    #[must_use]
    pub fn pictures(&self) -> u64 {
        self.pictures
    }

    /// Number of requested lights; identifies a light.
    #[must_use]
    pub fn lights(&self) -> u64 {
        self.lights
    }

    /// The scene whose picture is shown or being marched.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        self.bricks.as_ref().map_or_else(|| self.on_device.scene(), |bricks| &bricks.scene)
    }

    /// The scene whose voxels are in memory, to follow a ray in: [`Self::scene`], or with a coarse level of blocks of so many
    /// voxels if its own voxels stay in a file.
    #[must_use]
    pub fn scene_at_hand(&self) -> (Scene, Option<[usize; 3]>) {
        match &self.bricks {
            Some(bricks) if bricks.scene.fields.first().bricks().is_some() => {
                (bricks.coarse.scene(&bricks.scene), Some(bricks.coarse.block()))
            }
            _ => (self.scene().clone(), None),
        }
    }

    /// Statistics of the volume.
    #[must_use]
    pub fn statistics(&self) -> &Statistics {
        self.on_device.statistics()
    }

    /// Numbers of operations so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Pictures completed since the last [`Self::look`].
    #[must_use]
    pub fn reached(&self) -> Reached {
        self.reached
    }

    /// Time since the last [`Self::look`].
    #[must_use]
    pub fn since_change(&self) -> Duration {
        self.changed.elapsed()
    }

    /// Plan of the current scene.
    #[must_use]
    pub fn planned(&self) -> &Planned {
        self.on_device.planned()
    }

    /// The renderer and its device.
    #[must_use]
    pub fn renderer(&self) -> &Renderer {
        self.on_device.renderer()
    }
}

impl Bricks {
    /// Replaces the scene.
    fn change(&mut self, scene: &Scene) {
        *self.scene = scene.clone();
        if let Some(planning) = &mut self.planning {
            planning.outdated = true;
        }
    }

    /// Starts to plan the scene in the background and to prepare the device for it; `coarse` is its coarse level there.
    fn plan(&mut self, coarse: &SceneRenderer) {
        let (before, scene) = (self.on_device.take(), (*self.scene).clone());
        let (renderer, statistics) = (coarse.renderer().beside(coarse.uploaded().bytes()), coarse.statistics().clone());
        let known = (coarse.planned().clone(), coarse.scene().clone());
        let planning = move |progress: &dyn Progress| {
            let mut on_device = before;
            let made = prepare(&mut on_device, &renderer, (scene, known), statistics, progress);
            Prepared { on_device, made }
        };
        self.planning = Some(Planning { job: Task::start(|| {}, planning), outdated: false });
    }
}

/// Plans `scene`, whose voxels have `statistics`, for a march in bricks and replaces what is `on_device` by it. After an error of
/// the plan, the former scene stays. `known` is the plan of its coarse level, whose colour model it mostly shares.
fn prepare(
    on_device: &mut Option<SceneRenderer>,
    renderer: &Renderer,
    (scene, known): (Scene, (Planned, Scene)),
    statistics: Statistics,
    progress: &dyn Progress,
) -> Result<(), RenderError> {
    // Later plans are compared between frames.
    read_ahead(&scene, progress);
    if progress.cancelled() {
        return Err(RenderError::Cancelled);
    }
    let planned = match known.0.changed_to(&known.1, &scene) {
        Some(planned) => planned,
        None => plan(&scene, progress)?,
    };
    warn_of_plan(&planned);
    PlannedJob::new(scene, planned, statistics).put(on_device, renderer, progress)?;
    // A scene whose pipelines do not compile is not marched.
    let warm = on_device.as_ref().map_or(Ok(()), SceneRenderer::warm_up_rounds);
    if warm.is_err() {
        *on_device = None;
    }
    warm
}

/// Plans `scene` and moves it to the device; warms the pipelines up if the plan differs from the one `before`.
fn ready(before: &SceneRenderer, scene: Scene, progress: &dyn Progress) -> Result<SceneRenderer, RenderError> {
    let job = Job::new(scene, before.statistics().clone()).planned(progress)?;
    warn_of_plan(&job.planned);
    let on_device = before.with_scene(job.scene, job.planned, progress)?;
    if on_device.planned().plan != before.planned().plan {
        on_device.warm_up()?;
    }
    Ok(on_device)
}
