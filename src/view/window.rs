//! The window: handles the system's events and draws a frame when something has changed.

mod beside;
mod opening;
mod replay;
mod report;
mod saving;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use egui::{Context, Rect, TexturesDelta, Vec2, ViewportId};
use egui_winit::accesskit_winit;
use glam::{DVec2, DVec3};
use winit::application::ApplicationHandler;
use winit::error::{EventLoopError, OsError};
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::WindowId;

use super::action::{Action, Leaving, Losing};
use super::effort::Curve;
use super::engine::{Counts, Engine, Reached, Stepped};
use super::export::write_rgba;
use super::job::Job;
use super::load::{LoadError, Loaded, Loading};
use super::probe::Probe;
use super::prober::Prober;
use super::screen::Screen;
use super::script::{Script, ScriptError};
use super::tour::Tour;
use super::ui::{self, Chooser, Design, Effort, Notice, Shown, Status};
use crate::document::Source;
use crate::document::{Document, Edit};
use crate::number::{count, unsigned, whole};
use crate::palette::PaletteError;
use crate::present::Frame;
use crate::render::RenderError;
use crate::scene::{Accuracy, Camera};
use crate::volume::Selection;
use crate::vulkan::{DeviceChoice, Validation, VulkanError};
use beside::{Chosen, Solved, Verdict};
use replay::Position;
pub use report::Report;
use report::{Times, keep};
use saving::Saving;

/// Time after the last change of the camera or scene at which finer pictures start.
const REST: Duration = Duration::from_millis(150);
/// Largest number of device losses before a finest picture; the window closes after more.
const MOST_LOSSES: u32 = 4;
/// Time between two frames that only update the progress of a march.
const NEWS_OF_MARCHING: Duration = Duration::from_millis(100);
/// Interval for checking on background tasks that block the march.
const LOOKED_AFTER: Duration = Duration::from_millis(4);
/// Least time between two frames that show the progress of a measurement.
const NEWS_OF_MEASURING: Duration = Duration::from_millis(700);
/// Largest number of notices kept.
const MOST_NOTICES: usize = 4;

/// Options of the viewer.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// First scene or volume.
    pub source: Source,
    /// Width and height of the window in pixels; 1280 by 800 points by default.
    pub size: Option<[u32; 2]>,
    /// Rendering device.
    pub device: DeviceChoice,
    /// Use of the validation layer.
    pub validation: Validation,
    /// Folder for cached measurements.
    pub cache: Option<PathBuf>,
    /// Number of frames of the opened scene after which the viewer exits.
    pub frames: Option<u32>,
    /// Script to run; the viewer exits after it.
    pub script: Option<Script>,
    /// Ends the process when the display disappears and the system permits nothing else.
    pub display_gone: Option<fn() -> !>,
}

/// Reason why the window could not open or had to close.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// There is no screen.
    #[error("no display for a window; `relume render` needs none, and `xvfb-run` provides a virtual one")]
    NoDisplay,
    /// The system's events ended in an error.
    #[error("the event loop of the window failed")]
    Events(#[source] EventLoopError),
    /// The system gives no window.
    #[error("cannot open a window")]
    NoWindow(#[from] OsError),
    /// Error of the device.
    #[error(transparent)]
    Vulkan(#[from] VulkanError),
    /// Error of the script.
    #[error(transparent)]
    Script(#[from] ScriptError),
}

/// Opens the window and returns when it closes. Must be called once, on the main thread.
///
/// # Errors
///
/// [`ViewError`].
pub fn run(options: Options) -> Result<Report, ViewError> {
    let begun = Instant::now();
    let events = EventLoop::with_user_event().build().map_err(|error| {
        tracing::debug!("{error}");
        ViewError::NoDisplay
    })?;
    #[cfg(target_os = "linux")]
    if let Some(gone) = options.display_gone {
        crate::present::when_display_is_gone(gone);
    }
    let mut viewer = Viewer::new(options, events.create_proxy(), begun);
    events.run_app(&mut viewer).map_err(ViewError::Events)?;
    viewer.end()
}

/// Event sent to the window by another thread.
#[derive(Debug)]
enum Woken {
    /// Event of the accessibility interface.
    Accessibility(accesskit_winit::Event),
    /// Progress of a background task.
    Progress,
    /// Scene with its number, after loading; `again` if it is already the open one.
    Loaded { number: u64, again: bool, loaded: Box<Result<Loaded, LoadError>> },
}

impl From<accesskit_winit::Event> for Woken {
    fn from(event: accesskit_winit::Event) -> Self {
        Self::Accessibility(event)
    }
}

/// The application.
struct Viewer {
    options: Options,
    proxy: EventLoopProxy<Woken>,
    begun: Instant,
    context: Context,
    engine: Option<Engine>,
    screen: Option<Screen>,
    document: Option<Document>,
    /// Source of the document.
    source: Source,
    /// Selected volume of the source's file.
    selection: Selection,
    /// Window title derived from the document.
    title: String,
    /// Title as last set, with the mark for unsaved changes if any.
    title_shown: String,
    loading: Option<Loading>,
    /// Cancelled loading tasks that may still be running.
    given_up: Vec<Loading>,
    lost: Lost,
    tour: Option<Tour>,
    /// Number of loading tasks started.
    opened: u64,
    notices: Vec<Notice>,
    /// Whether a notice was added after the last layout of the panels.
    untold: bool,
    panels: Option<bool>,
    textures: TexturesDelta,
    /// Rectangle of the picture in the window, in points.
    place: Rect,
    /// Probe of the selected pixel.
    prober: Prober,
    /// World point kept under the probe while the picture's size changes, with its position in the picture and the
    /// camera.
    looked_at: Option<(DVec2, Camera, DVec3)>,
    /// Measured settings and the measurement in progress.
    curve: Option<Curve>,
    measuring: Option<Job<Chosen>>,
    /// Accuracy of the last chosen setting and its description.
    chosen: Option<(Accuracy, String)>,
    /// Whether the palette editor is open, and the solver in progress.
    editing: bool,
    solving: Option<Job<Result<Solved, PaletteError>>>,
    /// Conflicts of the solved palettes.
    verdicts: Vec<Verdict>,
    /// Time of the last edit that needed a march.
    moved: Instant,
    /// Pictures of the current request that were shown.
    reached: Reached,
    /// Latest time of the next frame while the engine marches.
    marches_until: Option<Instant>,
    turn: Turn,
    /// Counts before the last frame.
    counted: Counts,
    /// Files still to be written, and the dialog for their paths.
    saving: Saving,
    chooser: Chooser,
    script: Position,
    drawn: Times,
    /// Durations of frames that only relit.
    relit: Times,
    report: Report,
    /// Counts of previous engines.
    before: Counts,
    /// Whether the window was asked to close; the next frame commits typed values first.
    to_close: bool,
    /// Whether the window closes after this frame.
    closes: bool,
    failed: Option<ViewError>,
}

/// Last turn of the event loop: frames and march slices alternate, and input is handled before either.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Turn {
    /// Slice of a march.
    #[default]
    Marched,
    /// Frame in an earlier turn.
    Drawn,
    /// Frame in this turn.
    Drawing,
}

/// State after device losses.
#[derive(Default)]
struct Lost {
    /// Number of losses since the last finest picture.
    times: u32,
    /// Whether rendering waits for the user to restart it.
    stopped: bool,
}

impl Viewer {
    fn new(options: Options, proxy: EventLoopProxy<Woken>, begun: Instant) -> Self {
        Self {
            options,
            proxy,
            begun,
            context: Context::default(),
            engine: None,
            screen: None,
            document: None,
            source: Source::default(),
            selection: Selection::default(),
            title: String::new(),
            title_shown: String::new(),
            loading: None,
            given_up: Vec::new(),
            lost: Lost::default(),
            tour: None,
            opened: 0,
            notices: Vec::new(),
            untold: false,
            panels: None,
            textures: TexturesDelta::default(),
            place: Rect::ZERO,
            prober: Prober::default(),
            looked_at: None,
            curve: None,
            measuring: None,
            chosen: None,
            editing: false,
            solving: None,
            verdicts: Vec::new(),
            moved: begun,
            reached: Reached::default(),
            marches_until: None,
            turn: Turn::default(),
            counted: Counts::default(),
            saving: Saving::default(),
            chooser: Chooser::default(),
            script: Position::default(),
            drawn: Times::default(),
            relit: Times::default(),
            report: Report::default(),
            before: Counts::default(),
            to_close: false,
            closes: false,
            failed: None,
        }
    }

    fn end(mut self) -> Result<Report, ViewError> {
        self.report.counts = self.counts();
        self.prober.end();
        if let Some(measuring) = self.measuring.take() {
            measuring.end();
        }
        self.saving.end();
        self.give_up();
        // Background tasks must not use the device while the process exits.
        self.engine.take().into_iter().for_each(Engine::end);
        self.given_up.drain(..).for_each(Loading::end);
        if let Some(failed) = self.failed.take() {
            return Err(failed);
        }
        self.report.curve = self.curve.take().map_or_else(Vec::new, |curve| curve.settings);
        self.report.notices = self.notices.drain(..).map(|notice| notice.text).collect();
        self.report.frame_ms = self.drawn.spread();
        self.report.relit_ms = self.relit.spread();
        if let Some(screen) = &self.screen {
            self.report.validation.extend(screen.renderer.device().validation_messages());
        }
        Ok(self.report)
    }

    fn counts(&self) -> Counts {
        let now = self.engine.as_ref().map(Engine::counts).unwrap_or_default();
        Counts {
            marches: self.before.marches + now.marches,
            dispatches: self.before.dispatches + now.dispatches,
            relights: self.before.relights + now.relights,
        }
    }

    fn tell(&mut self, error: &dyn std::error::Error) {
        let mut text = error.to_string();
        let mut cause = error.source();
        while let Some(error) = cause {
            text = format!("{text}: {error}");
            cause = error.source();
        }
        keep(&mut self.report.failures, text.clone());
        self.note(text);
    }

    /// Adds a notice of success, except in a scripted run, where nobody reads it.
    fn tell_done(&mut self, text: String) {
        if !self.is_scripted() {
            self.add(Notice::done(text));
        }
    }

    fn note(&mut self, text: String) {
        self.add(Notice::wrong(text));
    }

    fn add(&mut self, notice: Notice) {
        self.notices.retain(|known| known.text != notice.text);
        self.notices.push(notice);
        self.untold = true;
        if self.notices.len() > MOST_NOTICES {
            self.notices.remove(0);
        }
    }

    fn open_screen(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        ui::style(&self.context);
        let screen = Screen::open(events, &self.options, &self.context, &self.proxy)?;
        self.report.device.clone_from(&screen.renderer.device().info().name);
        self.screen = Some(screen);
        self.open(self.options.source.clone());
        Ok(())
    }

    fn ask(&mut self, action: Action) {
        match action {
            Action::Edit(edit) => {
                if !edit.leaves_light() {
                    self.stop_tour();
                }
                // Neither changes the picture.
                let spares = matches!(edit, Edit::Design(_) | Edit::Rename(..));
                self.change(spares, |document| document.edit(&edit));
            }
            Action::Undo => {
                self.stop_tour();
                self.change(false, Document::undo);
            }
            Action::Redo => {
                self.stop_tour();
                self.change(false, Document::redo);
            }
            Action::Open(source) if self.losing().anything() => {
                self.chooser.leave(Leaving::Open(source));
            }
            Action::Open(source) | Action::Leave(Leaving::Open(source)) => self.open(*source),
            Action::Another => self.open_another(),
            Action::Close if self.losing().anything() => self.chooser.leave(Leaving::Close),
            Action::Close | Action::Leave(Leaving::Close) => self.closes = true,
            Action::Choose(file) => self.choose(file),
            Action::SavePicture(path) => self.save_picture(path),
            Action::SaveAccumulators(path) => self.save_accumulators(path),
            Action::SaveSession(path) => self.save_session(path),
            Action::SaveWindow(path) => self.saving.capture = Some(path),
            Action::Restart => {
                self.lost.times = 1;
                self.restore();
            }
            Action::Tour(seconds) => self.tour(seconds),
            Action::SaveTour(path, frames) => self.begin_tour(path, frames),
            Action::Panels(shown) => self.panels = Some(shown),
            Action::Probe(place) => self.prober.look(place),
            Action::Measure(goal) => self.measure(goal),
            Action::Palette(shown) => self.editing = shown,
            Action::Offer => self.offer(),
            Action::Solve(step) => self.solve(step),
            Action::GiveUp => (self.measuring, self.solving) = (None, None),
            Action::Dismiss(index) => {
                if index < self.notices.len() {
                    self.notices.remove(index);
                }
            }
        }
    }

    /// Changes the document. Gives up a tour being saved, whose pictures must show one state, unless the change
    /// `spares` it.
    fn change(&mut self, spares: bool, change: impl FnOnce(&mut Document) -> bool) {
        if !self.document.as_mut().is_some_and(change) {
            return;
        }
        if !spares {
            self.give_up_tour("The scene or the light was changed");
        }
        self.show_again();
    }

    /// Updates the picture from the document.
    fn show_again(&mut self) {
        let (Some(document), Some(engine)) = (&self.document, &mut self.engine) else { return };
        if engine.update(document.state(), self.report.size) {
            (self.moved, self.reached) = (Instant::now(), Reached::default());
        }
    }

    /// Rectangle of the picture in window pixels: left, top, width, height.
    fn pixels(&self, pixels_per_point: f32) -> [u32; 4] {
        let edge = |points: f32| unsigned(whole(f64::from(points * pixels_per_point).round().max(0.0)));
        let (low, high) = (self.place.min, self.place.max);
        let [left, top] = [edge(low.x), edge(low.y)];
        [left, top, edge(high.x).saturating_sub(left), edge(high.y).saturating_sub(top)]
    }

    /// Runs `work`, which blocks input. Reopens a lost device; any other error closes the window.
    fn attempt(&mut self, events: &ActiveEventLoop, work: impl FnOnce(&mut Self) -> Result<(), ViewError>) {
        let (begun, shown) = (Instant::now(), self.report.first_picture_ms.is_some());
        let done = work(self);
        if shown {
            let took = 1000.0 * begun.elapsed().as_secs_f64();
            self.report.stall_ms = self.report.stall_ms.max(took);
        }
        let done = match done {
            Err(ViewError::Vulkan(lost @ VulkanError::DeviceLost { .. })) => self.recover(lost),
            done => done,
        };
        if let Err(error) = done {
            self.failed = Some(error);
            events.exit();
        }
    }

    /// Continues the march between two frames, and requests a frame when a picture is finished or one is due.
    fn go_on(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        if self.turn == Turn::Drawing {
            // Input is handled first.
            self.turn = Turn::Drawn;
            return Ok(());
        }
        let rests = self.hand_rests();
        let mut stepped = Stepped::default();
        if let (Some(screen), Some(engine)) = (&mut self.screen, &mut self.engine)
            && engine.has_work(rests)
        {
            screen.surface.wait()?;
            let begun = Instant::now();
            let made = engine.step(rests);
            let took = 1000.0 * begun.elapsed().as_secs_f64();
            self.report.longest_step_ms = self.report.longest_step_ms.max(took);
            stepped = self.made(made)?;
        }
        self.turn = Turn::Marched;
        let Some(due) = self.marches_until else { return Ok(()) };
        let now = Instant::now();
        if stepped.shown || !self.is_busy() || now >= due {
            self.marches_until = None;
            events.set_control_flow(ControlFlow::Wait);
            self.redraw();
        } else if stepped.worked {
            events.set_control_flow(ControlFlow::Poll);
        } else {
            events.set_control_flow(ControlFlow::WaitUntil(due.min(now + LOOKED_AFTER)));
        }
        Ok(())
    }

    /// Whether there is something to march at present.
    fn is_busy(&self) -> bool {
        let rests = self.hand_rests();
        self.engine.as_ref().is_some_and(|engine| engine.has_work(rests))
    }

    /// Requests a frame: now, or after the next march slice if it is the march's turn.
    fn redraw(&mut self) {
        if self.turn != Turn::Marched && self.is_busy() {
            self.marches_until = Some(Instant::now());
        } else {
            self.screen.iter().for_each(|screen| screen.window.request_redraw());
        }
    }

    /// Returns the engine's result; reports an error other than device loss and returns the default.
    fn made<T: Default>(&mut self, made: Result<T, RenderError>) -> Result<T, VulkanError> {
        match made {
            Err(RenderError::Vulkan(lost @ VulkanError::DeviceLost { .. })) => Err(lost),
            Err(error) => {
                self.tell(&error);
                Ok(T::default())
            }
            Ok(made) => Ok(made),
        }
    }

    /// Draws one frame and schedules the next one.
    fn draw(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        (self.marches_until, self.turn) = (None, Turn::Drawing);
        let begun = Instant::now();
        if let Some(screen) = &mut self.screen {
            screen.surface.wait()?;
        }
        let inputs = self.run_script(events)?;
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let mut raw = screen.egui.take_egui_input(&screen.window);
        raw.events.extend(inputs);
        let (status, losing) = (self.status(), self.losing());
        let loading = self.loading.as_ref().map(Loading::progress).or_else(|| self.first_march());
        let Some(screen) = &mut self.screen else { return Ok(()) };
        // Asking the window again would wait for the screen.
        let (scale, points) = (
            egui_winit::pixels_per_point(&self.context, &screen.window),
            raw.screen_rect.map_or(Vec2::ZERO, |rect| rect.size()),
        );
        let size = [points.x, points.y].map(|points| unsigned(whole(f64::from((points * scale).round()))));
        let wide = points.x >= ui::ROOM_FOR_PANELS;
        let loading = loading.as_ref().map(|(name, part, stage)| (name.as_str(), *part, stage.as_str()));
        let running = self.measuring.as_ref().map(|job| {
            let (part, stage) = job.progress();
            (part, format!("{stage}, {} s", job.spent().as_secs()))
        });
        let effort = Effort {
            planned: self.engine.as_ref().map(Engine::planned),
            curve: self
                .curve
                .as_ref()
                .zip(self.document.as_ref())
                .map(|(curve, document)| (curve, curve.is_of(&document.state().scene, self.report.size))),
            // Shown while the chosen accuracy is in use.
            chosen: (self.chosen.as_ref().zip(self.document.as_ref()))
                .filter(|((accuracy, _), document)| *accuracy == document.state().scene.accuracy)
                .map(|((_, told), _)| told.as_str()),
            running: running.as_ref().map(|(part, stage)| (*part, stage.as_str())),
        };
        let solving = self.solving.as_ref().map(Job::progress);
        let solving = solving.as_ref().map(|(part, stage)| (*part, stage.as_str()));
        let (mut asked, mut place) = (Vec::new(), Rect::ZERO);
        let aspect = self.place.width() / self.place.height().max(1.0);
        let shown = Shown {
            document: self.document.as_ref(),
            status: &status,
            loading,
            notices: &self.notices,
            stopped: self.lost.stopped,
            chooses: self.chooser.is_open(),
            closes: std::mem::take(&mut self.to_close),
            several: Selection { resample: false, ..self.selection.clone() } != Selection::default(),
            tour: self.tour.as_ref(),
            panels: self.panels.unwrap_or(wide),
            effort,
            design: Design {
                shown: self.editing,
                running: solving,
                conflicts: beside::conflicts(&self.verdicts, self.document.as_ref()),
            },
            probe: self.prober.place().map(|place| (place, self.prober.probe())),
            aspect: if aspect > 0.0 { f64::from(aspect) } else { 1.0 },
        };
        self.untold = false;
        let chooser = &mut self.chooser;
        let output = self.context.run_ui(raw, |ui| {
            place = ui::show(ui, &shown, &mut asked);
            asked.extend(chooser.show(ui.ctx(), losing));
        });
        let again = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |view| view.repaint_delay);
        screen.egui.handle_platform_output(&screen.window, output.platform_output);
        self.textures.append(output.textures_delta);

        let [red, green, blue, _] = self.context.global_style().visuals.panel_fill.to_array();
        let background = [red, green, blue].map(|part| f32::from(part) / 255.0);
        asked.into_iter().for_each(|action| self.ask(action));
        let plays = self.go_on_tour();
        if !self.context.input(|input| input.pointer.any_down()) {
            self.document.iter_mut().for_each(if plays { Document::rest_beside_tour } else { Document::rest });
        }
        self.fit(place, output.pixels_per_point);
        let shown = self.engine.as_mut().map_or(Ok(false), Engine::show);
        self.made(shown)?;
        // The panels were laid out before a playing tour advanced; after its end they are laid out once more.
        let news = self.probe()? | self.measured() | self.solved() | self.tour.is_some() | plays;
        let failed = !self.written();
        self.save_tour(failed);
        self.save_pictures();

        let capture = self.saving.capture.take();
        let place = self.pixels(output.pixels_per_point);
        let picture = self.engine.as_ref().and_then(Engine::picture).map(|picture| (picture, place));
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let shown = screen.surface.show(Frame {
            size,
            background,
            picture,
            textures: &mut self.textures,
            panels: output.shapes,
            context: &self.context,
            pixels_per_point: output.pixels_per_point,
            capture: capture.is_some(),
        });
        let captured = match shown {
            Ok(captured) => captured,
            Err(error @ VulkanError::OutOfMemory { .. }) if capture.is_some() => {
                self.tell(&error);
                self.next(events, Duration::ZERO, news);
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        match (captured, capture) {
            (Some(pixels), Some(path)) => {
                let size = size.map(|pixels| pixels as usize);
                if let Err(error) = write_rgba(&path, size, &pixels) {
                    self.tell(&error);
                }
            }
            // No frame was shown; the next one is captured instead.
            (None, Some(path)) => self.saving.capture = Some(path),
            _ => {}
        }
        self.name_window();
        self.note_reached();
        self.report.frames += 1;
        let (took, now) = (1000.0 * begun.elapsed().as_secs_f64(), self.counts());
        self.drawn.add(took);
        let before = std::mem::replace(&mut self.counted, now);
        if now.relights > before.relights && now.dispatches == before.dispatches {
            self.relit.add(took);
        }
        self.next(events, again, news);
        Ok(())
    }

    /// Name and progress of the opened scene until its first picture.
    fn first_march(&self) -> Option<(String, Option<f32>, String)> {
        let engine = self.engine.as_ref().filter(|engine| engine.picture().is_none() && engine.has_work(true))?;
        #[expect(clippy::cast_possible_truncation, reason = "for a bar on the screen")]
        let part = engine.progress().map(|part| part as f32);
        Some((self.source.name(), part, "marching the first picture".to_owned()))
    }

    /// Sets the picture's rectangle and requests a picture if it has changed.
    fn fit(&mut self, place: Rect, pixels_per_point: f32) {
        if self.place == place && self.report.size != [0; 2] {
            return;
        }
        self.place = place;
        let [_, _, width, height] = self.pixels(pixels_per_point).map(|pixels| pixels.max(1));
        let before = std::mem::replace(&mut self.report.size, [width as usize, height as usize]);
        self.look_at_the_same(before);
        self.show_again();
    }

    /// Moves the probe to the same world point after a size change; removes it if the point has left the picture.
    fn look_at_the_same(&mut self, before: [usize; 2]) {
        let (Some(place), Some(document)) = (self.prober.place(), &self.document) else { return };
        let (camera, geometry) = (&document.state().scene.camera, &document.state().scene.volume.geometry);
        let view = |[width, height]: [usize; 2]| camera.view(geometry, count(width.max(1)) / count(height.max(1)));
        let (Some(was), Some(is)) = (view(before), view(self.report.size)) else { return };
        let at = |index: DVec3| geometry.world_from_index(index);
        let middle = at((DVec3::from_array(geometry.dims.map(count)) - 1.0) / 2.0);
        // During successive size changes, intermediate pixels are not probed.
        let known = self.looked_at.take().filter(|(there, by, _)| *there == place && by == camera);
        let point = match (known, self.prober.probe().and_then(Probe::brightest)) {
            (Some((.., point)), _) => point,
            (None, Some(stretch)) => at(stretch.place),
            (None, None) => was.point_at(place, middle),
        };
        let inside = |place: &DVec2| place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all();
        let there = is.place_of(point).filter(inside);
        self.looked_at = there.map(|there| (there, camera.clone(), point));
        self.prober.look(there);
    }

    fn hand_rests(&self) -> bool {
        self.moved.elapsed() > REST || self.is_scripted()
    }

    /// Records the times of the first and finest pictures shown.
    fn note_reached(&mut self) {
        let Some(engine) = &self.engine else { return };
        let (before, after) = (self.reached, engine.reached());
        let took = 1000.0 * engine.since_change().as_secs_f64();
        if after.first && !before.first {
            keep(&mut self.report.coarse_ms, took);
            self.report.first_picture_ms.get_or_insert(1000.0 * self.begun.elapsed().as_secs_f64());
        }
        if after.finest && !before.finest {
            keep(&mut self.report.finest_ms, took);
            self.lost.times = 0;
        }
        self.reached = after;
    }

    /// Sets the window title, with a mark for unsaved changes.
    fn name_window(&mut self) {
        let Some(screen) = &self.screen else { return };
        let changed = self.document.as_ref().is_some_and(|document| !document.is_saved());
        let title = if changed { format!("*{}", self.title) } else { self.title.clone() };
        if self.title_shown != title {
            screen.window.set_title(&title);
            self.title_shown = title;
        }
    }

    fn status(&self) -> Status {
        let engine = self.engine.as_ref();
        let is_held = engine.is_some_and(|it| it.picture().is_some() && !it.is_finest()) && !self.hand_rests();
        Status {
            device: self.report.device.clone(),
            size: self.report.size,
            marching: engine.and_then(Engine::progress),
            beside: match (&self.measuring, &self.solving, &self.loading) {
                (_, _, Some(_)) => Some("opening"),
                (Some(_), _, None) => Some("measuring"),
                (None, Some(_), None) => Some("solving"),
                (None, None, None) if matches!(self.tour, Some(Tour::Saving { .. })) => Some("saving the tour"),
                (None, None, None) => is_held.then_some("coarse while the input lasts"),
            },
            finest: engine.is_some_and(Engine::is_finest),
            counts: self.counts(),
            frame_ms: self.drawn.last(),
        }
    }

    /// Whether a field outside the file dialogs has the keyboard focus.
    fn is_typed_into(&self) -> bool {
        !self.chooser.is_open() && self.context.memory(|memory| memory.focused().is_some())
    }

    /// Unsaved work; none in a scripted run, which nobody can answer for.
    fn losing(&self) -> Losing {
        if self.is_scripted() {
            return Losing::default();
        }
        Losing {
            changes: self.document.as_ref().is_some_and(|document| !document.is_saved()),
            tour: matches!(self.tour, Some(Tour::Saving { .. })),
            picture: self.is_awaited(),
        }
    }

    fn is_scripted(&self) -> bool {
        self.options.script.is_some() || self.options.frames.is_some()
    }

    /// Schedules the next frame.
    fn next(&mut self, events: &ActiveEventLoop, again: Duration, news: bool) {
        let over = self.options.frames.is_some_and(|frames| self.report.frames >= u64::from(frames));
        if self.failed.is_some() || self.closes || (over && self.options.script.is_none() && self.loading.is_none()) {
            events.exit();
            return;
        }
        events.set_control_flow(ControlFlow::Wait);
        let (busy, unfinished) = (self.is_busy(), self.engine.as_ref().is_some_and(|engine| engine.has_work(true)));
        // Frames would disturb the measurement, and a script waits for its end.
        let again =
            if self.measuring.is_some() { again.clamp(NEWS_OF_MEASURING / 7, NEWS_OF_MEASURING) } else { again };
        // `settle` waits for a picture, which needs no frames.
        let driven = self.is_scripted() && self.measuring.is_none() && !(busy && self.settles());
        let at_once = news || self.untold || driven || self.saving.capture.is_some();
        match if at_once { Next::Frame } else { next(again, busy, unfinished) } {
            Next::Frame => self.redraw(),
            Next::March(most) => self.marches_until = Some(Instant::now() + most),
            Next::Rest(most) => {
                let due = Instant::now().checked_add(most).filter(|_| most < Duration::from_secs(3600));
                due.into_iter().for_each(|due| events.set_control_flow(ControlFlow::WaitUntil(due)));
            }
        }
        if self.marches_until.is_some() {
            events.set_control_flow(ControlFlow::Poll);
        }
    }
}

/// Work after a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// Another frame.
    Frame,
    /// The march, for this long at most.
    March(Duration),
    /// Nothing, for this long at most.
    Rest(Duration),
}

/// Chooses the work after a frame, where the panels want a frame after `again`. `busy`: the engine has work at present.
/// `unfinished`: the engine has more work once input pauses, which may already have happened during a coarse march.
fn next(again: Duration, busy: bool, unfinished: bool) -> Next {
    if again.is_zero() {
        Next::Frame
    } else if busy {
        Next::March(again.min(NEWS_OF_MARCHING))
    } else {
        Next::Rest(if unfinished { again.min(REST) } else { again })
    }
}

impl ApplicationHandler<Woken> for Viewer {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.screen.is_none()
            && let Err(error) = self.open_screen(events)
        {
            self.failed = Some(error);
            events.exit();
        }
    }

    fn new_events(&mut self, _events: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, None, Some(screen)) = (cause, self.marches_until, &self.screen) {
            screen.window.request_redraw();
        }
    }

    fn about_to_wait(&mut self, events: &ActiveEventLoop) {
        if !events.exiting() {
            self.attempt(events, |viewer| viewer.go_on(events));
        }
    }

    fn user_event(&mut self, _events: &ActiveEventLoop, woken: Woken) {
        match woken {
            Woken::Accessibility(event) => {
                if let (accesskit_winit::WindowEvent::ActionRequested(request), Some(screen)) =
                    (event.window_event, &mut self.screen)
                {
                    screen.egui.on_accesskit_action_request(request);
                }
            }
            Woken::Progress => {}
            Woken::Loaded { number, again, loaded } if number == self.opened => self.loaded(*loaded, again),
            // Another scene was opened in the meantime.
            Woken::Loaded { .. } => {}
        }
        self.redraw();
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        self.hear(events, &event);
    }
}

impl Viewer {
    /// Handles an event of the window.
    fn hear(&mut self, events: &ActiveEventLoop, event: &WindowEvent) {
        match event {
            // A hidden window may show no frame: a second request to close takes effect at once.
            WindowEvent::CloseRequested if self.is_typed_into() && !self.to_close => self.to_close = true,
            WindowEvent::CloseRequested => {
                self.to_close = false;
                self.ask(Action::Close);
                if self.closes {
                    events.exit();
                    return;
                }
            }
            WindowEvent::RedrawRequested => {
                self.attempt(events, |viewer| viewer.draw(events));
                return;
            }
            WindowEvent::DroppedFile(path) => {
                let source = Box::new(Source::of(path));
                self.ask(Action::Open(source));
            }
            _ => {}
        }
        let Some(screen) = &mut self.screen else { return };
        let due = matches!(event, WindowEvent::Resized(_) | WindowEvent::CloseRequested);
        if screen.egui.on_window_event(&screen.window, event).repaint || due {
            self.redraw();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarse_picture_that_took_longer_than_the_hand_moved_is_refined() {
        assert_eq!(
            next(Duration::MAX, true, true),
            Next::March(NEWS_OF_MARCHING),
            "at once: nothing else would wake it"
        );
        assert_eq!(next(Duration::MAX, false, true), Next::Rest(REST), "when the hand rests");
        assert_eq!(next(Duration::MAX, false, false), Next::Rest(Duration::MAX), "a finished picture needs no frame");
        assert_eq!(next(REST / 2, false, true), Next::Rest(REST / 2), "or when the panels want one");
        assert_eq!(next(Duration::ZERO, true, true), Next::Frame, "at once, if they want it");
    }
}
