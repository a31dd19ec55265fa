//! The window: handles the system's events and draws a frame when something has changed.

mod asking;
mod beside;
mod frame;
mod opening;
mod pace;
mod panels;
mod picture;
mod replay;
mod report;
mod saving;

use std::time::Instant;

use egui_winit::accesskit_winit;
use glam::DVec3;
use winit::application::ApplicationHandler;
use winit::event::{StartCause, WindowEvent};
use winit::event_loop::{ActiveEventLoop, EventLoop, EventLoopProxy};
use winit::window::WindowId;

use super::action::Action;
use super::engine::{Counts, Engine};
use super::load::{LoadError, Loaded, Loading};
use super::options::{Options, ViewError};
use super::recent::Recent;
use super::screen::Screen;
use super::sizes::KeptSizes;
use super::tour::Tour;
use super::ui;
use crate::document::Source;
use beside::Tasks;
use opening::{Lost, Opened, Opening};
use pace::Pace;
use panels::Panels;
use picture::Picture;
use replay::Position;
use report::Record;
pub use report::Report;
use saving::Saving;

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
    screen: Option<Screen>,
    engine: Option<Engine>,
    opened: Opened,
    loading: Opening,
    lost: Lost,
    panels: Panels,
    picture: Picture,
    tasks: Tasks,
    tour: Option<Tour>,
    saving: Saving,
    script: Position,
    pace: Pace,
    record: Record,
    ending: Ending,
}

/// Whether and why the window closes.
#[derive(Default)]
struct Ending {
    /// Whether the window was asked to close; the next frame commits typed values first.
    asked: bool,
    /// Whether the window closes after this frame.
    now: bool,
    failed: Option<ViewError>,
}

impl Viewer {
    fn new(options: Options, proxy: EventLoopProxy<Woken>, begun: Instant) -> Self {
        Self {
            options,
            proxy,
            begun,
            screen: None,
            engine: None,
            opened: Opened::default(),
            loading: Opening::default(),
            lost: Lost::default(),
            panels: Panels::default(),
            picture: Picture::new(begun),
            tasks: Tasks::default(),
            tour: None,
            saving: Saving::default(),
            script: Position::default(),
            pace: Pace::default(),
            record: Record::default(),
            ending: Ending::default(),
        }
    }

    fn end(mut self) -> Result<Report, ViewError> {
        self.record.report.counts = self.counts();
        let ruler = &self.panels.layout.ruler;
        let ends: Vec<_> = ruler.ends.iter().flatten().map(DVec3::to_array).collect();
        self.record.report.ruler = serde_json::json!({ "ends": ends, "length": ruler.length() });
        self.record.report.slices = self
            .opened
            .document
            .as_ref()
            .and_then(|document| self.panels.layout.slices.json(document.state().scene.volume()));
        if let Some(engine) = &self.engine {
            self.record.report.volume_level =
                engine.shown_level().map(|shown| serde_json::json!({ "level": shown.level, "voxels": shown.voxels }));
            self.record.report.light_block = engine.light_block();
            self.record.report.bricks = engine.brick_counts();
            self.record.report.host_bricks = engine.scene().fields.first().reads();
        }
        self.picture.prober.end();
        if let Some(measuring) = self.tasks.measuring.take() {
            measuring.end();
        }
        self.saving.end();
        self.give_up();
        // Background tasks must not use the device while the process exits.
        self.give_up_engine();
        // A panic of a thread has already been reported.
        self.loading.planning.drain(..).for_each(|thread| drop(thread.join()));
        self.loading.given_up.drain(..).for_each(Loading::end);
        if let Some(failed) = self.ending.failed.take() {
            return Err(failed);
        }
        self.record.report.curve = self.tasks.curve.take().map_or_else(Vec::new, |curve| curve.settings);
        self.record.report.notices = self.panels.notices.drain(..).map(|notice| notice.text).collect();
        self.record.report.frame_ms = self.record.drawn.spread();
        self.record.report.relit_ms = self.record.relit.spread();
        if let Some(screen) = &self.screen {
            self.record.report.validation.extend(screen.renderer.device().validation_messages());
        }
        Ok(self.record.report)
    }

    fn counts(&self) -> Counts {
        let now = self.engine.as_ref().map(Engine::counts).unwrap_or_default();
        Counts {
            marches: self.record.before.marches + now.marches,
            dispatches: self.record.before.dispatches + now.dispatches,
            relights: self.record.before.relights + now.relights,
        }
    }

    fn open_screen(&mut self, events: &ActiveEventLoop) -> Result<(), ViewError> {
        ui::style(&self.panels.context);
        // A script sees the same window wherever it runs.
        if let Some(cache) = self.options.cache.as_deref().filter(|_| !self.is_scripted()) {
            self.panels.recent = Recent::read(cache);
            (self.panels.sizes, self.panels.layout.sizes) = KeptSizes::read(cache);
        }
        let screen = Screen::open(events, &self.options, &self.panels.context, &self.proxy)?;
        self.record.report.device.clone_from(&screen.renderer.device().info().name);
        self.screen = Some(screen);
        self.open(self.options.source.clone());
        Ok(())
    }

    /// Whether a field outside the file dialogs has the keyboard focus.
    fn is_typed_into(&self) -> bool {
        !self.panels.chooser.is_open() && self.panels.context.memory(|memory| memory.focused().is_some())
    }

    fn is_scripted(&self) -> bool {
        self.options.script.is_some() || self.options.frames.is_some()
    }
}

impl ApplicationHandler<Woken> for Viewer {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        if self.screen.is_none()
            && let Err(error) = self.open_screen(events)
        {
            self.ending.failed = Some(error);
            events.exit();
        }
    }

    fn new_events(&mut self, _events: &ActiveEventLoop, cause: StartCause) {
        if let (StartCause::ResumeTimeReached { .. }, None, Some(screen)) =
            (cause, self.pace.marches_until, &self.screen)
        {
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
            Woken::Loaded { number, again, loaded } if number == self.loading.number => self.loaded(*loaded, again),
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
            WindowEvent::CloseRequested if self.is_typed_into() && !self.ending.asked => self.ending.asked = true,
            WindowEvent::CloseRequested => {
                self.ending.asked = false;
                self.ask(Action::Close);
                if self.ending.now {
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
