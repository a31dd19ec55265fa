//! The window: the system's events in, frames out; it draws when something has changed, and rests otherwise.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use egui::{Context, Pos2, Rect, TexturesDelta, ViewportId};
use egui_winit::accesskit_winit;
use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::error::{EventLoopError, OsError};
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::window::WindowId;

use super::action::Action;
use super::design::{Spectra, Step};
use super::effort::{self, Curve, Measured};
use super::engine::{Counts, Engine, EngineError};
use super::export::{ExportError, write_rgba};
use super::job::Job;
use super::load::{LoadError, Loaded, Loading, Source};
use super::prober::{Prober, StepError};
use super::screen::Screen;
use super::script::{self, Command, Input, Script, ScriptError};
use super::session;
use super::state::{Cost, Document, Edit};
use super::tour::Tour;
use super::ui::{self, Design, Effort, Notice, Shown, Status};
use crate::measure::{Choice, ChoiceError, Goal};
use crate::number::{count, unsigned, whole};
use crate::output::numbered;
use crate::palette::{self, Conflict, PaletteError, Solution};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer};
use crate::scene::{Interval, Scene};
use crate::volume::VolumeError;
use crate::vulkan::{DeviceChoice, Frame, Validation, VulkanError};

/// How long after its last movement a hand rests.
const REST: Duration = Duration::from_millis(150);
/// Frames that a script waits for a size it has asked for; a window that cannot have it goes on.
const PATIENCE: u32 = 120;
/// How often the device may be lost before a picture is there, until the window is given up.
const MOST_LOSSES: u32 = 4;
/// Least time between two pieces of news of what is measured.
const NEWS_OF_MEASURING: Duration = Duration::from_millis(700);
/// Notices that are kept.
const MOST_NOTICES: usize = 4;

/// How the viewer is started.
#[derive(Clone, Debug, Default)]
pub struct Options {
    /// What is opened first.
    pub source: Source,
    /// Pixels of the window, across and down; without them, 1280 by 800 points.
    pub size: Option<[u32; 2]>,
    /// What renders.
    pub device: DeviceChoice,
    /// Whether the validation layer watches.
    pub validation: Validation,
    /// The folder that measurements are kept in.
    pub cache: Option<PathBuf>,
    /// Ends after so many frames of what was opened.
    pub frames: Option<u32>,
    /// Ends after what is recorded here.
    pub script: Option<Script>,
    /// Ends the program when its display goes away, where the system leaves no other way.
    pub display_gone: Option<fn() -> !>,
}

/// What a session was like.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Report {
    /// The device's name.
    pub device: String,
    /// Pixels of the picture, at the end.
    pub size: [usize; 2],
    /// Frames drawn.
    pub frames: u64,
    /// Marches, dispatches and relights, of all that was opened.
    #[serde(flatten)]
    pub counts: Counts,
    /// The counts at each `settle` of the script.
    pub settled: Vec<Counts>,
    /// Settings that were chosen by what was measured.
    pub choices: Vec<Choice>,
    /// What was measured of settings, at the end.
    pub curve: Vec<Measured>,
    /// The largest ΔE00 of a cell of each palette that was solved, from what was asked.
    pub solved: Vec<f64>,
    /// What `probe` of the script has found.
    pub probes: Vec<serde_json::Value>,
    /// From the start to the first picture.
    pub first_picture_ms: Option<f64>,
    /// From each change of what is marched to a picture of it.
    pub coarse_ms: Vec<f64>,
    /// From each to the finest picture, where nothing came between.
    pub finest_ms: Vec<f64>,
    /// Frames by how long they took, the longest of them last: median, 95th of a hundred, longest.
    pub frame_ms: [f64; 3],
    /// The same of frames that showed another light and marched nothing.
    pub relit_ms: [f64; 3],
    /// The longest call into the engine.
    pub longest_step_ms: f64,
    /// The longest that nobody was heard after the first picture was there: from a frame's begin to its end.
    pub stall_ms: f64,
    /// How often the device was lost, and opened again.
    pub losses: u64,
    /// What was told last.
    pub notices: Vec<String>,
    /// What could not be opened, saved or done, all of it.
    pub failures: Vec<String>,
    /// What the validation layer has said.
    pub validation: Vec<String>,
}

/// Why there is no window, or no longer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// There is no screen.
    #[error(
        "there is no display to open a window on; `relume render` writes pictures without one, and `xvfb-run` lends one"
    )]
    NoDisplay,
    /// The system's events ended in an error.
    #[error("the window's events ended")]
    Events(#[source] EventLoopError),
    /// The system gives no window.
    #[error("the system opens no window")]
    NoWindow(#[from] OsError),
    /// The device.
    #[error(transparent)]
    Vulkan(#[from] VulkanError),
    /// The script.
    #[error(transparent)]
    Script(#[from] ScriptError),
}

/// Opens the window and returns when it is closed. Must be called on the main thread, once.
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
        crate::vulkan::when_display_is_gone(gone);
    }
    let mut viewer = Viewer::new(options, events.create_proxy(), begun);
    events.run_app(&mut viewer).map_err(ViewError::Events)?;
    viewer.end()
}

/// What other threads tell the window.
#[derive(Debug)]
enum Woken {
    /// Something is read aloud, or asks to be.
    Accessibility(accesskit_winit::Event),
    /// What is opened has gone on.
    Progress,
    /// What was opened, by its number; `again` where it is what was looked at already.
    Loaded { number: u64, again: bool, loaded: Box<Result<Loaded, LoadError>> },
}

impl From<accesskit_winit::Event> for Woken {
    fn from(event: accesskit_winit::Event) -> Self {
        Self::Accessibility(event)
    }
}

/// What settings take and err by, and the one that was chosen by it.
type Chosen = Result<(Curve, Option<Choice>), ChoiceError>;

/// What was solved, and what of the palette changes with it.
type Solved = Result<(Solution, Option<Step>), PaletteError>;

/// The application.
struct Viewer {
    options: Options,
    proxy: EventLoopProxy<Woken>,
    begun: Instant,
    context: Context,
    engine: Option<Engine>,
    screen: Option<Screen>,
    document: Option<Document>,
    /// What the document was read from.
    source: Source,
    loading: Option<Loading>,
    /// What was being opened before, and may still be at work.
    given_up: Vec<Loading>,
    lost: Lost,
    tour: Option<Tour>,
    /// How many things were opened.
    opened: u64,
    notices: Vec<Notice>,
    panels: Option<bool>,
    textures: TexturesDelta,
    /// The picture's place in the window, in points.
    place: Rect,
    /// The pixel that is looked at.
    prober: Prober,
    /// What was measured, and what is being measured.
    curve: Option<Curve>,
    measuring: Option<Job<Chosen>>,
    /// What the setting that was chosen last came to.
    chosen: Option<String>,
    /// Whether the palette's editor is there, and what is being solved.
    editing: bool,
    solving: Option<Job<Solved>>,
    /// What excluded itself in what was solved last.
    conflicts: Vec<Conflict>,
    /// The last edit that marches.
    moved: Instant,
    /// What to save once the picture is finest.
    to_save: Vec<Export>,
    /// Files that are being written.
    writing: Vec<Writing>,
    /// Names that were given to files, which may not be there yet.
    named: Vec<PathBuf>,
    /// Where the window's pixels of this frame go.
    to_capture: Option<PathBuf>,
    script: Position,
    drawn: Vec<f64>,
    /// Those of frames that showed another light and marched nothing.
    relit: Vec<f64>,
    report: Report,
    /// Counts of engines that are gone.
    before: Counts,
    failed: Option<ViewError>,
}

/// What of a picture is to be saved, and where.
enum Export {
    Picture(PathBuf),
    Accumulators(PathBuf),
}

/// A file that is being written, and what is said of it once it is there.
struct Writing {
    job: Job<Result<(), ExportError>>,
    there: Option<String>,
}

/// What became of the device.
#[derive(Default)]
struct Lost {
    /// How often it was lost since a picture was as fine as it gets.
    times: u32,
    /// Whether nothing is rendered until somebody asks for it.
    stopped: bool,
}

/// How far the script is.
#[derive(Default)]
struct Position {
    /// The next command.
    next: usize,
    /// Frames that the last one still waits.
    waits: u32,
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
            loading: None,
            given_up: Vec::new(),
            lost: Lost::default(),
            tour: None,
            opened: 0,
            notices: Vec::new(),
            panels: None,
            textures: TexturesDelta::default(),
            place: Rect::ZERO,
            prober: Prober::default(),
            curve: None,
            measuring: None,
            chosen: None,
            editing: false,
            solving: None,
            conflicts: Vec::new(),
            moved: begun,
            to_save: Vec::new(),
            writing: Vec::new(),
            named: Vec::new(),
            to_capture: None,
            script: Position::default(),
            drawn: Vec::new(),
            relit: Vec::new(),
            report: Report::default(),
            before: Counts::default(),
            failed: None,
        }
    }

    fn end(mut self) -> Result<Report, ViewError> {
        self.report.counts = self.counts();
        self.prober.end();
        if let Some(measuring) = self.measuring.take() {
            measuring.end();
        }
        for writing in std::mem::take(&mut self.writing) {
            writing.job.end();
        }
        self.give_up();
        // The end of the program is no time to be at work on the device.
        self.engine.take().into_iter().for_each(Engine::end);
        self.given_up.drain(..).for_each(Loading::end);
        if let Some(failed) = self.failed.take() {
            return Err(failed);
        }
        self.report.curve = self.curve.take().map_or_else(Vec::new, |curve| curve.settings);
        self.report.notices = self.notices.drain(..).map(|notice| notice.text).collect();
        self.report.frame_ms = spread(&mut self.drawn);
        self.report.relit_ms = spread(&mut self.relit);
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
        self.report.failures.push(text.clone());
        self.note(text);
    }

    /// Tells that something was done; a script has asked for it, and nobody reads.
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

    /// Opens something beside the window; what was being opened is given up.
    fn open(&mut self, source: Source) {
        let name = source.name();
        self.load(name, false, move |renderer, progress| source.load(renderer, progress));
    }

    /// Brings what is looked at to the device again.
    fn restore(&mut self) {
        self.lost.stopped = false;
        let Some(document) = &self.document else { return self.open(self.options.source.clone()) };
        let (scene, statistics) = (document.state().scene.clone(), document.statistics().cloned());
        let source = self.source.clone();
        self.load(source.name(), true, move |renderer, progress| {
            let statistics = statistics.map_or_else(|| scene.volume.statistics(), Ok)?;
            Loaded::prepare(renderer, scene, statistics, source, progress)
        });
    }

    /// Begins to `load` on a thread what is called `name`, a thing that is looked at already or another one.
    fn load(
        &mut self,
        name: String,
        again: bool,
        load: impl FnOnce(Arc<Renderer>, &dyn Progress) -> Result<Loaded, LoadError> + Send + 'static,
    ) {
        let Some(screen) = &self.screen else { return };
        self.opened += 1;
        let (number, proxy) = (self.opened, self.proxy.clone());
        let loaded = {
            let proxy = proxy.clone();
            // A window that is gone needs no news.
            move |loaded| drop(proxy.send_event(Woken::Loaded { number, again, loaded: Box::new(loaded) }))
        };
        let progressed = move || drop(proxy.send_event(Woken::Progress));
        let renderer = Arc::clone(&screen.renderer);
        self.give_up();
        self.loading = Some(Loading::start(name, move |progress| load(renderer, progress), progressed, loaded));
    }

    /// Gives up what is being opened.
    fn give_up(&mut self) {
        self.given_up.retain(|loading| !loading.is_over());
        if let Some(loading) = self.loading.take() {
            loading.give_up();
            self.given_up.push(loading);
        }
    }

    fn loaded(&mut self, loaded: Result<Loaded, LoadError>, again: bool) {
        self.loading = None;
        let loaded = match loaded {
            Ok(loaded) => loaded,
            // The next frame notices it too, and starts again.
            Err(LoadError::Render(RenderError::Vulkan(VulkanError::DeviceLost { .. }))) => return,
            Err(error) => {
                self.tell(&error);
                if let (true, Some(notice)) = (chooses(&error), self.notices.last_mut()) {
                    notice.text.push_str("; a window cannot be told: start `relume view` with the file and that");
                }
                return;
            }
        };
        self.before = self.counts();
        if !again {
            let mut document = Document::new(loaded.scene.clone());
            if loaded.source.bare_volume().is_some() {
                // Its lights are there to choose from, and not meant together.
                document = Document::starting(loaded.scene.clone(), &Edit::HandOnNode(0));
            }
            self.document = Some(document.with_statistics(loaded.statistics.clone()));
            self.source = loaded.source.clone();
            self.screen.iter().for_each(|screen| screen.window.set_title(&self.source.title()));
            (self.curve, self.chosen) = (None, None);
        }
        (self.measuring, self.solving) = (None, None);
        self.conflicts.clear();
        // Pictures are counted anew.
        let looked_at = self.prober.place().filter(|_| again);
        self.prober.look(None);
        self.prober.look(looked_at);
        let mut engine = Engine::new(loaded);
        if let Some(document) = &self.document {
            engine.light(document.state());
        }
        self.engine = Some(engine);
        // The next frame looks: only there is the size of the picture known.
        self.place = Rect::ZERO;
    }

    /// Opens the device anew that `error` has lost, and goes on where it was. What is lost again before it has shown a
    /// picture waits for somebody to say so: it may be the scene that does it.
    fn recover(&mut self, error: VulkanError) -> Result<(), ViewError> {
        let Some(screen) = self.screen.take() else { return Ok(()) };
        self.lost.times += 1;
        if self.lost.times > MOST_LOSSES {
            return Err(error.into());
        }
        tracing::debug!("{error}");
        self.report.losses += 1;
        self.report.validation.extend(screen.renderer.device().validation_messages());
        self.before = self.counts();
        (self.engine, self.measuring) = (None, None);
        self.textures.clear();
        let was_opening = self.loading.as_ref().map(|loading| loading.progress().0);
        self.give_up();
        let screen = screen.renewed(&self.options)?;
        screen.window.request_redraw();
        self.screen = Some(screen);
        if let Some(name) = was_opening.filter(|_| self.document.is_some()) {
            self.note(format!("{name} was not opened: the device was lost, and started again."));
        } else {
            self.note("The device was lost, and started again.".to_owned());
        }
        if self.lost.times == 1 {
            self.restore();
        } else {
            self.lost.stopped = true;
        }
        Ok(())
    }

    fn ask(&mut self, action: Action) {
        match action {
            Action::Edit(edit) => {
                if edit.cost() == Cost::Relight && matches!(self.tour, Some(Tour::Playing { .. })) {
                    self.tour = None;
                }
                let cost = self.document.as_mut().and_then(|document| document.edit(&edit));
                self.show_again(cost);
            }
            Action::Undo => {
                let cost = self.document.as_mut().and_then(Document::undo);
                self.show_again(cost);
            }
            Action::Redo => {
                let cost = self.document.as_mut().and_then(Document::redo);
                self.show_again(cost);
            }
            Action::Open(path) => self.open(Source::of(&path)),
            Action::OpenBuiltIn => self.open(Source::default()),
            Action::SavePicture(path) => {
                let path = path.unwrap_or_else(|| self.free("relume.png"));
                self.to_save.push(Export::Picture(path));
            }
            Action::SaveAccumulators(path) => {
                let path = path.unwrap_or_else(|| self.free("relume-accumulators.exr"));
                self.to_save.push(Export::Accumulators(path));
            }
            Action::SaveSession(path) => {
                let path = path.unwrap_or_else(|| self.free("relume-session.toml"));
                self.save_session(&path);
            }
            Action::SaveWindow(path) => self.to_capture = Some(path),
            Action::Restart => {
                self.lost.times = 1;
                self.restore();
            }
            Action::Tour(seconds) => self.tour = seconds.map(Tour::playing),
            Action::SaveTour(path, frames) => self.tour = Some(Tour::saving(path.unwrap_or_else(free_tour), frames)),
            Action::Panels(shown) => self.panels = Some(shown),
            Action::Probe(place) => self.prober.look(place),
            Action::Measure(goal) => self.measure(goal),
            Action::Palette(shown) => self.editing = shown,
            Action::Solve(step) => self.solve(step),
            Action::GiveUp => (self.measuring, self.solving) = (None, None),
            Action::Dismiss(index) => {
                if index < self.notices.len() {
                    self.notices.remove(index);
                }
            }
        }
    }

    /// What a line of a script is about; why it cannot be done where nothing is open.
    fn open_document(&self) -> Result<&Document, String> {
        self.document.as_ref().ok_or_else(|| match self.report.failures.last() {
            Some(failure) => format!("nothing is open: {failure}"),
            None => "nothing is open".to_owned(),
        })
    }

    /// The first of the numbered names after `name` that no file has or will have.
    fn free(&mut self, name: &str) -> PathBuf {
        let mut names = (1..=u16::MAX).map(|number| numbered(Path::new(name), number));
        let free = names.find(|path| !path.exists() && !self.named.contains(path)).unwrap_or_else(|| name.into());
        self.named.push(free.clone());
        free
    }

    fn show_again(&mut self, cost: Option<Cost>) {
        let (Some(document), Some(engine), Some(cost)) = (&self.document, &mut self.engine, cost) else { return };
        let state = document.state();
        engine.light(state);
        if cost == Cost::March {
            engine.look(&state.scene, self.report.size);
            self.moved = Instant::now();
        }
    }

    /// The picture's place in pixels of the window: left, top, width, height.
    fn pixels(&self, pixels_per_point: f32) -> [u32; 4] {
        let edge = |points: f32| unsigned(whole(f64::from(points * pixels_per_point).round().max(0.0)));
        let (low, high) = (self.place.min, self.place.max);
        let [left, top] = [edge(low.x), edge(low.y)];
        [left, top, edge(high.x).saturating_sub(left), edge(high.y).saturating_sub(top)]
    }

    /// One frame; a device that is lost in it is opened anew.
    fn frame(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        let (begun, shown) = (Instant::now(), self.report.first_picture_ms.is_some());
        let drawn = self.draw(events);
        if shown {
            let took = 1000.0 * begun.elapsed().as_secs_f64();
            self.report.stall_ms = self.report.stall_ms.max(took);
        }
        match drawn {
            Err(ViewError::Vulkan(lost @ VulkanError::DeviceLost { .. })) => self.recover(lost),
            drawn => drawn,
        }
    }

    /// One frame. Says when the next one is due: at once, later, or when something happens.
    fn draw(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        let (begun, before) = (Instant::now(), self.counts());
        if let Some(screen) = &mut self.screen {
            screen.surface.wait()?;
        }
        let inputs = self.run_script(events)?;
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let mut raw = screen.egui.take_egui_input(&screen.window);
        raw.events.extend(inputs);
        let status = self.status();
        let loading = self.loading.as_ref().map(Loading::progress).or_else(|| self.first_march());
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let size = screen.window.inner_size();
        let points = f64::from(size.width) / f64::from(self.context.pixels_per_point());
        let wide = points >= f64::from(ui::ROOM_FOR_PANELS);
        let loading = loading.as_ref().map(|(name, part, stage)| (name.as_str(), *part, stage.as_str()));
        let running = self.measuring.as_ref().map(Job::progress);
        let effort = Effort {
            planned: self.engine.as_ref().map(Engine::planned),
            curve: self
                .curve
                .as_ref()
                .zip(self.document.as_ref())
                .map(|(curve, document)| (curve, curve.is_of(&document.state().scene, self.report.size))),
            chosen: self.chosen.as_deref(),
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
            plays: matches!(self.tour, Some(Tour::Playing { .. })),
            panels: self.panels.unwrap_or(wide),
            effort,
            design: Design { shown: self.editing, running: solving, conflicts: &self.conflicts },
            probe: self.prober.place().map(|place| (place, self.prober.probe())),
            aspect: if aspect > 0.0 { f64::from(aspect) } else { 1.0 },
        };
        let output = self.context.run_ui(raw, |ui| place = ui::show(ui, &shown, &mut asked));
        let again = output.viewport_output.get(&ViewportId::ROOT).map_or(Duration::MAX, |view| view.repaint_delay);
        screen.egui.handle_platform_output(&screen.window, output.platform_output);
        self.textures.append(output.textures_delta);

        let [red, green, blue, _] = self.context.global_style().visuals.panel_fill.to_array();
        let background = [red, green, blue].map(|part| f32::from(part) / 255.0);
        asked.into_iter().for_each(|action| self.ask(action));
        let plays = self.go_on_tour();
        if !plays && !self.context.input(|input| input.pointer.any_down()) {
            self.document.iter_mut().for_each(Document::rest);
        }
        self.fit(place, output.pixels_per_point);
        let stepped = self.step()? | self.probe()? | self.measured() | self.solved() | self.tour.is_some();
        let failed = !self.written();
        self.save_tour(failed);
        self.save_pictures();

        let panels = self.context.tessellate(output.shapes, output.pixels_per_point);
        let capture = self.to_capture.take();
        let place = self.pixels(output.pixels_per_point);
        let picture = self.engine.as_ref().and_then(Engine::picture).map(|picture| (picture, place));
        let Some(screen) = &mut self.screen else { return Ok(()) };
        let shown = screen.surface.show(Frame {
            size: [size.width, size.height],
            background,
            picture,
            textures: &mut self.textures,
            panels: &panels,
            pixels_per_point: output.pixels_per_point,
            capture: capture.is_some(),
        });
        let captured = match shown {
            Ok(captured) => captured,
            Err(error @ VulkanError::OutOfMemory { .. }) if capture.is_some() => {
                self.tell(&error);
                self.next(events, Duration::ZERO, stepped);
                return Ok(());
            }
            Err(error) => return Err(error.into()),
        };
        match (captured, capture) {
            (Some(pixels), Some(path)) => {
                let size = [size.width as usize, size.height as usize];
                if let Err(error) = write_rgba(&path, size, &pixels) {
                    self.tell(&error);
                }
            }
            // It was shown in no frame; the next one will do.
            (None, Some(path)) => self.to_capture = Some(path),
            _ => {}
        }
        self.report.frames += 1;
        let (took, now) = (1000.0 * begun.elapsed().as_secs_f64(), self.counts());
        self.drawn.push(took);
        if now.relights > before.relights && now.dispatches == before.dispatches {
            self.relit.push(took);
        }
        self.next(events, again, stepped);
        Ok(())
    }

    /// What was opened, while its first picture is on its way, and how far that is.
    fn first_march(&self) -> Option<(String, Option<f32>, String)> {
        let engine = self.engine.as_ref().filter(|engine| engine.picture().is_none() && engine.has_work(true))?;
        #[expect(clippy::cast_possible_truncation, reason = "for a bar on the screen")]
        let part = engine.progress().map(|part| part as f32);
        Some((self.source.name(), part, "marching the first picture".to_owned()))
    }

    /// Gives the picture its place; a picture of another size is marched.
    fn fit(&mut self, place: Rect, pixels_per_point: f32) {
        if self.place == place && self.report.size != [0; 2] {
            return;
        }
        self.place = place;
        let [_, _, width, height] = self.pixels(pixels_per_point).map(|pixels| pixels.max(1));
        self.report.size = [width as usize, height as usize];
        self.show_again(Some(Cost::March));
    }

    fn hand_rests(&self) -> bool {
        self.moved.elapsed() > REST || self.is_scripted()
    }

    /// Goes on with the picture. Says whether there is more to do.
    fn step(&mut self) -> Result<bool, VulkanError> {
        let rests = self.hand_rests();
        let Some(engine) = &mut self.engine else { return Ok(false) };
        let begun = Instant::now();
        let before = engine.latency();
        let stepped = engine.step(rests);
        let took = 1000.0 * begun.elapsed().as_secs_f64();
        self.report.longest_step_ms = self.report.longest_step_ms.max(took);
        let (after, more) = (engine.latency(), engine.has_work(rests));
        if let (None, Some(first)) = (before.first, after.first) {
            self.report.coarse_ms.push(1000.0 * first.as_secs_f64());
            let since_start = 1000.0 * self.begun.elapsed().as_secs_f64();
            self.report.first_picture_ms.get_or_insert(since_start);
        }
        if let (None, Some(finest)) = (before.finest, after.finest) {
            self.report.finest_ms.push(1000.0 * finest.as_secs_f64());
            self.lost.times = 0;
        }
        match stepped {
            Ok(_) => {}
            Err(EngineError::Render(RenderError::Vulkan(lost @ VulkanError::DeviceLost { .. }))) => return Err(lost),
            Err(error) => self.tell(&error),
        }
        Ok(more)
    }

    /// Goes on with the pixel that is looked at. Says whether there is something new to show.
    fn probe(&mut self) -> Result<bool, VulkanError> {
        let (Some(engine), Some(document)) = (&self.engine, &self.document) else { return Ok(false) };
        let proxy = self.proxy.clone();
        let wake = move || drop(proxy.send_event(Woken::Progress));
        match self.prober.step(engine, document.state(), wake) {
            Ok(new) => Ok(new),
            Err(StepError::Render(RenderError::Vulkan(lost @ VulkanError::DeviceLost { .. }))) => Err(lost),
            Err(error) => {
                self.tell(&error);
                Ok(false)
            }
        }
    }

    /// Measures settings of what is looked at, for `goal` or for a curve; what was being measured is given up.
    fn measure(&mut self, goal: Option<Goal>) {
        let (Some(engine), Some(document)) = (&self.engine, &self.document) else { return };
        let renderer = Arc::clone(engine.renderer());
        let (scene, mix) = (document.state().scene.clone(), document.state().mix());
        let (size, cache) = (self.report.size, self.options.cache.clone());
        let (proxy, last) = (self.proxy.clone(), Arc::new(Mutex::new(None::<Instant>)));
        // Frames take time of what is measured: few of them say how far it is.
        let wake = move || {
            let mut last = last.lock().unwrap_or_else(PoisonError::into_inner);
            if last.is_none_or(|last| last.elapsed() > NEWS_OF_MEASURING) {
                *last = Some(Instant::now());
                drop(proxy.send_event(Woken::Progress));
            }
        };
        self.measuring = Some(Job::start(wake, move |progress| {
            effort::measure(&renderer, &scene, &mix, size, goal, cache.as_deref(), progress)
        }));
    }

    /// Takes what was measured, once it is. Says whether there is something new to show.
    fn measured(&mut self) -> bool {
        let Some(measured) = self.measuring.as_mut().and_then(Job::take) else { return false };
        self.measuring = None;
        match measured {
            Err(error) => self.tell(&error),
            Ok((curve, choice)) => {
                match &mut self.curve {
                    Some(known) => known.merge(curve),
                    none => *none = Some(curve),
                }
                if let (Some(choice), Some(document)) = (choice, &self.document) {
                    let accuracy = choice.setting.applied(&document.state().scene).accuracy;
                    self.ask(Action::Edit(Edit::Accuracy(accuracy)));
                    self.chosen = Some(format!("Chosen, {}: {}.", choice.setting, choice.why));
                    if self.is_scripted() {
                        self.report.choices.push(choice);
                    }
                }
            }
        }
        true
    }

    /// Finds the open spectra of the palette, after `step` where there is one; what was being solved is given up.
    fn solve(&mut self, step: Option<Step>) {
        let state = self.document.as_ref().map(Document::state);
        let palette = state.and_then(|state| match &step {
            None => state.palette.clone(),
            Some(step) => step.applied(&state.scene, state.palette.as_deref()).map(Arc::new),
        });
        let Some(palette) = palette else {
            self.note("There is no palette to solve: offer one for the materials first.".to_owned());
            return;
        };
        self.conflicts.clear();
        let proxy = self.proxy.clone();
        let wake = move || drop(proxy.send_event(Woken::Progress));
        self.solving = Some(Job::start(wake, move |progress| Ok((palette::solve(&palette, progress)?, step))));
    }

    /// Takes what was solved, once it is. Says whether there is something new to show.
    fn solved(&mut self) -> bool {
        let Some(solved) = self.solving.as_mut().and_then(Job::take) else { return false };
        self.solving = None;
        match (solved, &self.document) {
            (Err(PaletteError::Cancelled), _) | (_, None) => {}
            (Err(error), _) => self.tell(&error),
            (Ok((solution, step)), Some(document)) => {
                let spectra = Spectra { step, ..Spectra::of(&document.state().scene, &solution) };
                self.ask(Action::Edit(Edit::Spectra(Arc::new(spectra))));
                self.report.solved.push(solution.worst());
                // The editor tells why, and offers ways out.
                self.editing |= !solution.conflicts.is_empty();
                self.conflicts = solution.conflicts;
            }
        }
        true
    }

    fn save_session(&mut self, path: &Path) {
        let Some(document) = &self.document else {
            self.note("There is no session to save: nothing is open.".to_owned());
            return;
        };
        match session::save(path, &self.source, document.opened(), document.state()) {
            Err(error) => self.tell(&error),
            Ok(()) => {
                let ([width, height], path) = (self.report.size, whole_path(path));
                self.tell_done(format!(
                    "The session is {path}; relume render with --size {width}x{height} makes this picture."
                ));
            }
        }
    }

    /// Begins to write what is to be saved of a picture that is finest.
    fn save_pictures(&mut self) {
        if self.to_save.is_empty() || self.loading.is_some() {
            return;
        }
        let (Some(engine), Some(document)) = (&self.engine, &self.document) else {
            self.to_save.clear();
            self.note("There is no picture to save: nothing is open.".to_owned());
            return;
        };
        if !engine.is_finest() {
            return;
        }
        let state = document.state();
        for export in std::mem::take(&mut self.to_save) {
            let Some(snapshot) = engine.snapshot() else { continue };
            match export {
                Export::Picture(path) => {
                    let there = format!("The picture is {}.", whole_path(&path));
                    self.writing.push(self.write(Some(there), move || snapshot.write_picture(&path)));
                }
                Export::Accumulators(path) => {
                    let there = format!("The accumulators are {}.", whole_path(&path));
                    let scene = Scene { light: state.light.clone(), ..state.scene.clone() };
                    self.writing.push(self.write(Some(there), move || snapshot.write_accumulators(&scene, &path)));
                }
            }
        }
    }

    /// Does `write` beside the window.
    fn write(
        &self,
        there: Option<String>,
        write: impl FnOnce() -> Result<(), ExportError> + Send + 'static,
    ) -> Writing {
        let proxy = self.proxy.clone();
        let wake = move || drop(proxy.send_event(Woken::Progress));
        Writing { job: Job::start(wake, move |_| write()), there }
    }

    /// Says what became of files that were being written. Whether all could be.
    fn written(&mut self) -> bool {
        let mut all = true;
        for mut writing in std::mem::take(&mut self.writing) {
            match (writing.job.take(), writing.there) {
                (None, there) => self.writing.push(Writing { job: writing.job, there }),
                (Some(Err(error)), _) => {
                    self.tell(&error);
                    all = false;
                }
                (Some(Ok(())), there) => there.into_iter().for_each(|there| self.tell_done(there)),
            }
        }
        all
    }

    /// Shows where a tour is now. Says whether one is played: all of it is one step back.
    fn go_on_tour(&mut self) -> bool {
        let (Some(tour), Some(document)) = (&self.tour, &mut self.document) else { return false };
        let edit = tour.edit();
        let plays = matches!(tour, Tour::Playing { .. });
        if plays {
            let cost = document.edit(&edit);
            if matches!(edit, Edit::Tour(step, of) if step >= of) {
                self.tour = None;
            }
            self.show_again(cost);
        } else if let Some(engine) = &mut self.engine {
            engine.light(&document.preview(&edit));
        }
        plays
    }

    /// Saves the picture of a tour that is there, and shows what was there before once all are saved, or one `failed`.
    fn save_tour(&mut self, failed: bool) {
        let Some(Tour::Saving { path, frames, saved }) = &mut self.tour else { return };
        if !self.writing.is_empty() {
            return;
        }
        if failed || saved == frames {
            let there = format!(
                "The pictures of the tour are there, the last of them {}.",
                whole_path(&numbered(path, *saved))
            );
            self.tour = None;
            if let (Some(engine), Some(document)) = (&mut self.engine, &self.document) {
                engine.light(document.state());
            }
            if !failed {
                self.tell_done(there);
            }
            return;
        }
        let snapshot = self.engine.as_ref().filter(|engine| engine.is_finest()).and_then(Engine::snapshot);
        let Some(snapshot) = snapshot else { return };
        *saved += 1;
        let path = numbered(path, *saved);
        self.writing.push(self.write(None, move || snapshot.write_picture(&path)));
    }

    fn status(&self) -> Status {
        let engine = self.engine.as_ref();
        Status {
            device: self.report.device.clone(),
            size: self.report.size,
            marching: engine.and_then(Engine::progress),
            beside: match (&self.measuring, &self.solving, &self.loading) {
                (_, _, Some(_)) => Some("opening"),
                (Some(_), _, None) => Some("measuring"),
                (None, Some(_), None) => Some("solving"),
                (None, None, None) => None,
            },
            finest: engine.is_some_and(Engine::is_finest),
            counts: self.counts(),
            frame_ms: self.drawn.last().copied().unwrap_or_default(),
        }
    }

    fn is_scripted(&self) -> bool {
        self.options.script.is_some() || self.options.frames.is_some()
    }

    /// When the next frame is due.
    fn next(&mut self, events: &ActiveEventLoop, again: Duration, more: bool) {
        let over = self.options.frames.is_some_and(|frames| self.report.frames >= u64::from(frames));
        if self.failed.is_some() || (over && self.options.script.is_none() && self.loading.is_none()) {
            events.exit();
            return;
        }
        events.set_control_flow(ControlFlow::Wait);
        let Some(screen) = &self.screen else { return };
        let unfinished = self.engine.as_ref().is_some_and(|engine| engine.has_work(true));
        let waits = until_next(again, unfinished, self.hand_rests());
        // Frames would take time of what is measured, and a script has nothing to do before that.
        let waits =
            if self.measuring.is_some() { waits.clamp(NEWS_OF_MEASURING / 7, NEWS_OF_MEASURING) } else { waits };
        let driven = self.is_scripted() && self.measuring.is_none();
        if more || waits.is_zero() || driven || self.to_capture.is_some() {
            screen.window.request_redraw();
        } else if let Some(due) = Instant::now().checked_add(waits).filter(|_| waits < Duration::from_secs(3600)) {
            events.set_control_flow(ControlFlow::WaitUntil(due));
        }
    }

    /// Whether nothing is left to do of what was asked for.
    fn is_settled(&self) -> bool {
        let finest = self.engine.as_ref().is_none_or(Engine::is_finest);
        // The first frame after something was opened has not yet looked at it.
        let looked = self.document.is_none() || self.place != Rect::ZERO;
        self.loading.is_none()
            && finest
            && looked
            && self.tour.is_none()
            && self.measuring.is_none()
            && self.solving.is_none()
            && !self.is_saving()
    }

    /// Whether pictures are still to be saved of what was asked for.
    fn is_saving(&self) -> bool {
        !(self.to_save.is_empty() && self.writing.is_empty())
            || self.to_capture.is_some()
            || matches!(self.tour, Some(Tour::Saving { .. }))
    }

    /// The next command of the script; what a hand does is answered.
    fn run_script(&mut self, events: &ActiveEventLoop) -> Result<Vec<egui::Event>, ViewError> {
        let Some(script) = &self.options.script else { return Ok(Vec::new()) };
        if self.script.waits > 0 {
            self.script.waits -= 1;
            return Ok(Vec::new());
        }
        let at = self.script.next;
        // What is opened first is what the first lines are about.
        let opens = self.document.is_none() && self.loading.is_some();
        let Some(command) = script.command(at).cloned() else {
            if !self.is_saving() {
                events.exit();
            }
            return Ok(Vec::new());
        };
        let inputs = match command {
            Command::Settle if !self.is_settled() => return Ok(Vec::new()),
            _ if opens && command.is_about_a_scene() => return Ok(Vec::new()),
            // What is saved is what was asked for before, and not after.
            _ if self.is_saving() => return Ok(Vec::new()),
            Command::Settle => {
                self.report.settled.push(self.counts());
                Vec::new()
            }
            Command::Frames(frames) => {
                self.script.waits = frames.saturating_sub(1);
                Vec::new()
            }
            Command::Do(action) => {
                self.ask(action);
                Vec::new()
            }
            Command::Named(about, name) => {
                let edit = self.open_document().and_then(|document| about.edit(document.state(), &name));
                self.ask(Action::Edit(edit.map_err(|message| script.wrong(at, message))?));
                Vec::new()
            }
            Command::Interval(index, [from, to, ramp, opacity]) => {
                let stated = self.open_document().and_then(|document| script::interval(document.state(), index));
                let stated = stated.map_err(|message| script.wrong(at, message))?;
                self.ask(Action::Edit(Edit::Interval(index, Interval { range: [from, to], ramp, opacity, ..stated })));
                Vec::new()
            }
            Command::Spectrum(side, name, standard) => {
                let spectra = self
                    .open_document()
                    .and_then(|document| Spectra::standard(&document.state().scene, side, &name, &standard));
                let spectra = Arc::new(spectra.map_err(|message| script.wrong(at, message))?);
                self.ask(Action::Edit(Edit::Spectra(spectra)));
                Vec::new()
            }
            Command::Camera(step) => {
                let aspect = f64::from(self.place.width() / self.place.height().max(1.0));
                self.ask(Action::Edit(Edit::Camera(step, if aspect > 0.0 { aspect } else { 1.0 })));
                Vec::new()
            }
            Command::Size([width, height]) => {
                let Some(screen) = &self.screen else { return Ok(Vec::new()) };
                let wanted = PhysicalSize::new(width, height);
                if self.options.size != Some([width, height]) {
                    self.options.size = Some([width, height]);
                    // Where the system gives it at once, it tells of it as always.
                    let _given = screen.window.request_inner_size(wanted);
                    self.script.waits = 1;
                    return Ok(Vec::new());
                }
                if screen.window.inner_size() != wanted {
                    self.script.waits = PATIENCE;
                }
                Vec::new()
            }
            Command::Probe(place) => {
                if self.loading.is_none() {
                    self.open_document().map_err(|message| script.wrong(at, message))?;
                }
                self.prober.look(Some(place));
                if !(self.is_settled() && self.prober.is_done()) {
                    return Ok(Vec::new());
                }
                if let (Some(probe), Some(document)) = (self.prober.probe(), &self.document) {
                    self.report.probes.push(probe.json(&document.state().scene));
                }
                Vec::new()
            }
            Command::Input(Input::Drop(path)) => {
                self.hear(events, &WindowEvent::DroppedFile(path));
                Vec::new()
            }
            Command::Input(input) => self.input(&input).map_err(|message| script.wrong(at, message))?,
        };
        self.script.next += 1;
        Ok(inputs)
    }

    /// What a hand does, as egui hears of it.
    fn input(&self, input: &Input) -> Result<Vec<egui::Event>, String> {
        let pointer = self.context.input(|input| input.pointer.latest_pos()).unwrap_or(Pos2::ZERO);
        let modifiers = egui::Modifiers::NONE;
        Ok(match input {
            Input::Pointer(x, y) => vec![egui::Event::PointerMoved(Pos2::new(*x, *y))],
            Input::Button(pressed) => {
                let button = egui::PointerButton::Primary;
                vec![egui::Event::PointerButton { pos: pointer, button, pressed: *pressed, modifiers }]
            }
            Input::Scroll(lines) => vec![egui::Event::MouseWheel {
                unit: egui::MouseWheelUnit::Line,
                delta: egui::vec2(0.0, *lines),
                phase: egui::TouchPhase::Move,
                modifiers,
            }],
            Input::Key(name) => {
                let key = egui::Key::from_name(name).ok_or_else(|| format!("{name:?} is no key"))?;
                let event = |pressed| egui::Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
                vec![event(true), event(false)]
            }
            // The system tells of it in another way.
            Input::Drop(_) => Vec::new(),
        })
    }
}

/// Median, 95th of a hundred and longest of times; zeros of none.
fn spread(times: &mut [f64]) -> [f64; 3] {
    times.sort_by(f64::total_cmp);
    let at = |part: f64| times.get(whole(part * count(times.len().saturating_sub(1)))).copied();
    [0.5, 0.95, 1.0].map(|part| at(part).unwrap_or_default())
}

/// Whether the file holds several volumes, and nobody has said which.
fn chooses(error: &LoadError) -> bool {
    let mut causes = std::iter::successors(Some(error as &dyn std::error::Error), |error| error.source());
    causes.any(|error| matches!(error.downcast_ref(), Some(VolumeError::Choose { .. })))
        || matches!(error, LoadError::Volume(VolumeError::Choose { .. }))
}

/// When the next frame is due, which the panels want `again` after this one. A picture that is `unfinished` is gone on with as
/// soon as the hand rests: it may have come to rest while a coarse picture was made.
fn until_next(again: Duration, unfinished: bool, hand_rests: bool) -> Duration {
    match (unfinished, hand_rests) {
        (false, _) => again,
        (true, false) => again.min(REST),
        (true, true) => Duration::ZERO,
    }
}

/// A name of a tour whose first picture is not there.
fn free_tour() -> PathBuf {
    let further = (2..=u16::MAX).map(|number| format!("relume-tour-{number}.png").into());
    let mut names = std::iter::once(PathBuf::from("relume-tour.png")).chain(further);
    names.find(|name| !numbered(name, 1).exists()).unwrap_or_else(|| "relume-tour.png".into())
}

/// Where `path` is, to somebody who does not know what folder this is.
fn whole_path(path: &Path) -> String {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned()).display().to_string()
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
        if let (StartCause::ResumeTimeReached { .. }, Some(screen)) = (cause, &self.screen) {
            screen.window.request_redraw();
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
            // Something else was opened since.
            Woken::Loaded { .. } => {}
        }
        if let Some(screen) = &self.screen {
            screen.window.request_redraw();
        }
    }

    fn window_event(&mut self, events: &ActiveEventLoop, _window: WindowId, event: WindowEvent) {
        self.hear(events, &event);
    }
}

impl Viewer {
    /// What the system tells of the window.
    fn hear(&mut self, events: &ActiveEventLoop, event: &WindowEvent) {
        match event {
            WindowEvent::CloseRequested => {
                events.exit();
                return;
            }
            WindowEvent::RedrawRequested => {
                if let Err(error) = self.frame(events) {
                    self.failed = Some(error);
                    events.exit();
                }
                return;
            }
            WindowEvent::DroppedFile(path) => {
                let path = path.clone();
                self.ask(Action::Open(path));
            }
            _ => {}
        }
        let Some(screen) = &mut self.screen else { return };
        if screen.egui.on_window_event(&screen.window, event).repaint || matches!(event, WindowEvent::Resized(_)) {
            screen.window.request_redraw();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coarse_picture_that_took_longer_than_the_hand_moved_is_refined() {
        assert_eq!(until_next(Duration::MAX, true, true), Duration::ZERO, "at once: nothing else would wake it");
        assert_eq!(until_next(Duration::MAX, true, false), REST, "when the hand rests");
        assert_eq!(until_next(Duration::MAX, false, true), Duration::MAX, "a finished picture needs no frame");
        assert_eq!(until_next(REST / 2, true, false), REST / 2, "or when the panels want one");
    }
}
