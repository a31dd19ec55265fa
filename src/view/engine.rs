//! Pictures of a state, made in slices: coarse at once, then as fine as the window; relit as often as the light changes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::load::Loaded;
use super::state::State;
use crate::plan::{Planned, ScenePlan};
use crate::render::{March, Relight, RenderError, Renderer, Speed, Uploaded};
use crate::scene::{Scene, positions};
use crate::tables::{Components, RelightMatrices};
use crate::vulkan::StorageImage;

/// How long one dispatch of a march may take, about.
const DISPATCH: Duration = Duration::from_millis(10);
/// How long the work of a frame may take, about: with a dispatch and a relight on top it is well under 50 ms.
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
    renderer: Arc<Renderer>,
    planned: Planned,
    uploaded: Uploaded,
    components: Components,
    /// Pixels of the finest picture.
    size: [usize; 2],
    /// The scene to march, where another than the one that is marched or shown.
    wanted: Option<Box<Scene>>,
    /// The scene of the march under way and of those that refine it.
    scene: Box<Scene>,
    marching: Option<Marching>,
    lit: Option<Lit>,
    /// The light to show it in.
    state: Box<State>,
    /// Whether what is shown has another light than it should.
    unlit: bool,
    /// Whether the last march or relight could not be made: no finer one is tried.
    failed: bool,
    /// Where the next picture of a new scene starts.
    coarse: usize,
    speed: (ScenePlan, Speed),
    counts: Counts,
    changed: Instant,
    /// From a change of what is marched to its first picture, and to its finest.
    latency: Latency,
}

/// Times from a change of what is marched.
#[derive(Clone, Copy, Debug, Default)]
pub struct Latency {
    /// To the first picture, where there is one since.
    pub first: Option<Duration>,
    /// To the finest picture, where there is one since.
    pub finest: Option<Duration>,
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
    level: usize,
    /// The pixels of the window that it was marched for.
    size: [usize; 2],
    /// How many light positions its accumulators have.
    positions: usize,
}

impl Engine {
    /// Makes pictures of what was `loaded`; nothing is marched yet.
    #[must_use]
    pub fn new(loaded: Loaded) -> Self {
        let Loaded { renderer, scene, planned, uploaded, .. } = loaded;
        let state = State::new(scene);
        let components = Components::new(&state.scene, &planned);
        let speed = (planned.plan.clone(), Speed::unknown(DISPATCH));
        Self {
            renderer,
            planned,
            uploaded,
            components,
            size: [0; 2],
            wanted: None,
            scene: Box::new(state.scene.clone()),
            marching: None,
            lit: None,
            state: Box::new(state),
            unlit: false,
            failed: false,
            coarse: FINER,
            speed,
            counts: Counts::default(),
            changed: Instant::now(),
            latency: Latency::default(),
        }
    }

    /// Asks for pictures of `size` (width, height) of `scene`. The march of a picture for any other is given up, but for
    /// the coarsest: a hand that never rests sees that one.
    pub fn look(&mut self, scene: &Scene, size: [usize; 2]) {
        self.size = size;
        self.wanted = Some(Box::new(scene.clone()));
        self.failed = false;
        self.latency = Latency::default();
        self.changed = Instant::now();
        if self.marching.as_ref().is_some_and(|marching| marching.level < self.coarse) {
            self.marching = None;
        }
    }

    /// Asks for the light of `state`. Nothing is marched.
    pub fn light(&mut self, state: &State) {
        self.unlit = true;
        *self.state = state.clone();
    }

    /// Goes on for about 16 ms with what there is to do; `hand_rests` allows pictures finer than the first. Says whether
    /// the picture is another.
    ///
    /// # Errors
    ///
    /// [`RenderError`]. What failed is not tried again before something else is asked for.
    pub fn step(&mut self, hand_rests: bool) -> Result<bool, RenderError> {
        let done = self.advance(hand_rests);
        if done.is_err() {
            (self.wanted, self.marching, self.unlit, self.failed) = (None, None, false, true);
        }
        done
    }

    fn advance(&mut self, hand_rests: bool) -> Result<bool, RenderError> {
        let begun = Instant::now();
        let mut shown = self.relight()?;
        while begun.elapsed() < SLICE && self.has_work(hand_rests) {
            if self.marching.is_none() {
                self.begin()?;
            }
            if let Some(marching) = &mut self.marching {
                let dispatched = Instant::now();
                marching.march.step(&self.renderer)?;
                marching.spent += dispatched.elapsed();
                self.counts.dispatches += 1;
            }
            if self.marching.as_ref().is_some_and(|marching| marching.march.is_done()) {
                self.finish()?;
                shown |= self.relight()?;
            }
        }
        Ok(shown)
    }

    /// Whether [`Self::step`] has anything to do.
    #[must_use]
    pub fn has_work(&self, hand_rests: bool) -> bool {
        let finer = !self.failed && self.lit.as_ref().is_some_and(|lit| lit.level > 1);
        self.unlit || self.wanted.is_some() || self.marching.is_some() || (hand_rests && finer)
    }

    /// Begins the march of what is wanted, or else a finer one of what is shown.
    fn begin(&mut self) -> Result<(), RenderError> {
        let level = match (self.wanted.take(), &self.lit) {
            (Some(scene), _) => {
                let planned = self.planned.seen_otherwise(&scene);
                if planned.plan != self.planned.plan {
                    self.speed = (planned.plan.clone(), Speed::unknown(DISPATCH));
                }
                (self.planned, self.scene) = (planned, scene);
                self.coarse
            }
            (None, Some(lit)) if lit.level > 1 => lit.level / FINER.min(lit.level),
            _ => return Ok(()),
        };
        let size = self.size.map(|pixels| pixels.div_ceil(level).max(1));
        let speed = self.speed.1;
        let march = self.renderer.begin_march(&self.scene, &self.planned, &self.uploaded, size, speed)?;
        self.counts.marches += 1;
        self.marching = Some(Marching { march, level, spent: Duration::ZERO });
        Ok(())
    }

    /// Shows what the march has left.
    fn finish(&mut self) -> Result<(), RenderError> {
        let Some(Marching { march, level, spent }) = self.marching.take() else { return Ok(()) };
        self.speed.1 = march.speed();
        if level == self.coarse {
            if spent > COARSE && self.coarse < COARSEST {
                self.coarse *= 2;
            } else if spent < COARSE / 5 && self.coarse > 1 {
                self.coarse /= 2;
            }
        }
        let accumulators = march.finish(&self.renderer)?;
        let relight = self.renderer.relight_display(&accumulators)?;
        let positions = accumulators.planned.positions.len();
        self.lit = Some(Lit { relight, level, size: self.size, positions });
        self.unlit = true;
        if self.wanted.is_none() {
            self.latency.first.get_or_insert_with(|| self.changed.elapsed());
            if level == 1 {
                self.latency.finest.get_or_insert_with(|| self.changed.elapsed());
            }
        }
        Ok(())
    }

    fn relight(&mut self) -> Result<bool, RenderError> {
        let Some(lit) = self.lit.as_ref().filter(|_| self.unlit) else { return Ok(false) };
        let (scene, mix) = (&self.state.scene, self.state.mix());
        if positions(scene).len() != lit.positions {
            // Where parallel rays turn, a headlight may come to stand where another light does: the march that is wanted
            // will have as many positions as the mix.
            return Ok(false);
        }
        let background = scene.background.as_ref();
        lit.relight.run(&RelightMatrices::new(&self.components, lit.positions, background, &mix, &scene.display))?;
        self.counts.relights += 1;
        self.unlit = false;
        Ok(true)
    }

    /// The picture to show: linear light encoded as sRGB, 8 bits.
    #[must_use]
    pub fn picture(&self) -> Option<&StorageImage> {
        self.lit.as_ref().map(|lit| lit.relight.picture())
    }

    /// The picture's pixels, RGBA, rows from the top; none before the first.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn read(&self) -> Result<Vec<u8>, RenderError> {
        let pixels: Vec<[u8; 4]> = self.lit.as_ref().map_or_else(|| Ok(Vec::new()), |lit| lit.relight.read())?;
        Ok(pixels.into_flattened())
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
        Some(f64::from(marching.march.rows_done()) / crate::number::count(height.max(1)))
    }

    /// What was done so far.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// How long pictures took since [`Self::look`] was last called.
    #[must_use]
    pub fn latency(&self) -> Latency {
        self.latency
    }

    /// What is computed for each pixel.
    #[must_use]
    pub fn planned(&self) -> &Planned {
        &self.planned
    }

    /// The renderer, and with it the device.
    #[must_use]
    pub fn renderer(&self) -> &Arc<Renderer> {
        &self.renderer
    }
}
