//! Opening of scenes in the background, and recovery of a lost device.

use std::thread::JoinHandle;

use egui::Rect;

use super::{ViewError, Viewer, Woken};
use crate::document::{Document, Edit, OpenError, Question, SceneFile, Source, Unknown};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer};
use crate::view::action::Leaving;
use crate::view::engine::Engine;
use crate::view::load::{LoadError, Loaded, Loading};
use crate::view::ui;
use crate::volume::{HostMemory, Selection};
use crate::vulkan::VulkanError;

/// Largest number of device losses before a finest picture; the window closes after more.
const MOST_LOSSES: u32 = 4;

/// The open document and its files.
#[derive(Default)]
pub(super) struct Opened {
    pub(super) document: Option<Document>,
    /// Source of the document.
    pub(super) source: Source,
    /// Selected volume of the source's file.
    pub(super) selection: Selection,
    /// Window title derived from the document.
    pub(super) title: String,
    /// Title as last set, with the mark for unsaved changes if any.
    pub(super) title_shown: String,
}

/// Loading tasks.
#[derive(Default)]
pub(super) struct Opening {
    pub(super) now: Option<Loading>,
    /// Cancelled tasks that may still be running.
    pub(super) given_up: Vec<Loading>,
    /// Threads of replaced engines that may still be running.
    pub(super) planning: Vec<JoinHandle<()>>,
    /// Number of tasks started.
    pub(super) number: u64,
}

/// State after device losses.
#[derive(Default)]
pub(super) struct Lost {
    /// Number of losses since the last finest picture.
    pub(super) times: u32,
    /// Whether rendering waits for the user to restart it.
    pub(super) stopped: bool,
}

impl Viewer {
    /// Opens `source` in the background; cancels loading in progress.
    pub(super) fn open(&mut self, source: Source) {
        // An open question belongs to the previous source.
        self.panels.chooser.close();
        let memory = HostMemory::Bounded { bytes: self.options.memory };
        self.load(source.clone(), false, move |renderer, progress| Loaded::open(renderer, source, memory, progress));
    }

    /// Opens another volume of the current file.
    pub(super) fn open_another(&mut self) {
        self.open(self.opened.source.reselected());
    }

    /// Loads the document onto the device again.
    pub(super) fn restore(&mut self) {
        self.lost.stopped = false;
        let Some(document) = &self.opened.document else { return self.open(self.options.source.clone()) };
        let file = SceneFile { scene: document.state().scene.clone(), ..document.opened().clone() };
        let statistics = document.statistics().cloned();
        let source = self.opened.source.clone();
        self.load(source.clone(), true, move |renderer, progress| {
            let statistics =
                statistics.map_or_else(|| file.scene.volume().statistics(), Ok).map_err(OpenError::from)?;
            Loaded::prepare(renderer, file, statistics, source, progress)
        });
    }

    /// Starts to `load` `source` on a thread; `again` if it is already the open one.
    fn load(
        &mut self,
        source: Source,
        again: bool,
        load: impl FnOnce(&Renderer, &dyn Progress) -> Result<Loaded, LoadError> + Send + 'static,
    ) {
        let Some(screen) = &self.screen else { return };
        self.loading.number += 1;
        let (number, proxy) = (self.loading.number, self.proxy.clone());
        let loaded = {
            let proxy = proxy.clone();
            // The event loop may be gone.
            move |loaded| drop(proxy.send_event(Woken::Loaded { number, again, loaded: Box::new(loaded) }))
        };
        let progressed = move || drop(proxy.send_event(Woken::Progress));
        let renderer = screen.renderer.clone();
        self.give_up();
        self.loading.now = Some(Loading::start(source, move |progress| load(&renderer, progress), progressed, loaded));
    }

    /// Cancels loading in progress.
    pub(super) fn give_up(&mut self) {
        self.loading.given_up.retain(|loading| !loading.is_over());
        if let Some(loading) = self.loading.now.take() {
            loading.give_up();
            self.loading.given_up.push(loading);
        }
    }

    /// Removes the engine and cancels its planning.
    pub(super) fn give_up_engine(&mut self) {
        self.loading.planning.retain(|thread| !thread.is_finished());
        self.loading.planning.extend(self.engine.take().into_iter().flat_map(Engine::give_up));
    }

    pub(super) fn loaded(&mut self, loaded: Result<Loaded, LoadError>, again: bool) {
        let opened = self.loading.now.take().map(|loading| loading.source().clone());
        let loaded = match loaded {
            Ok(loaded) => loaded,
            // The next frame reports the loss and recovers.
            Err(LoadError::Render(RenderError::Vulkan(VulkanError::DeviceLost { .. }))) => return,
            Err(error) => {
                // A script cannot answer, and an open question stays; the error says as much.
                let opened = opened.filter(|_| !self.is_scripted() && !self.panels.chooser.is_open());
                let of_source = error.of_source();
                // A grid that resampling did not straighten is an error.
                let is_new = |question: &Question| {
                    let resampled = opened.as_ref().is_some_and(|source| source.options.selection.resample);
                    !(resampled && matches!(question.unknown, Unknown::Grid { .. }))
                };
                let question = of_source.and_then(OpenError::question).filter(is_new);
                match (opened, question, of_source.and_then(OpenError::scene_without_volume)) {
                    (Some(source), Some(question), _) => {
                        let none = Selection::default();
                        let shown =
                            if source.is_another_of(&self.opened.source) { &self.opened.selection } else { &none };
                        self.panels.chooser.ask(source, question, shown);
                    }
                    (Some(source), None, Some(scene)) => {
                        self.tell(&error);
                        self.panels.chooser.ask_volume(source, scene);
                    }
                    _ => self.tell(&error),
                }
                return;
            }
        };
        let document = self.document_of(&loaded);
        if document.is_none() && !again {
            // Asked once: if the user agrees, the source opens as a new document.
            let mut source = loaded.source;
            source.options.selection.asks = false;
            return self.panels.chooser.leave(Leaving::Open(Box::new(source)));
        }
        self.record.before = self.counts();
        if let Some(document) = document.filter(|_| !again) {
            if !self.is_scripted() {
                // Older errors no longer apply.
                self.panels.notices.retain(|notice| notice.until.is_some());
            }
            self.stop_tour();
            self.give_up_tour("Another file was opened");
            self.forget_waiting();
            let before = self.opened.document.as_ref();
            if !before.is_some_and(|before| before.has_grid_of(&loaded.file.scene)) {
                self.panels.layout.forget_volume();
            }
            self.opened.document = Some(document.with_statistics(loaded.on_device.statistics().clone()));
            self.opened.source = loaded.source.clone();
            if let Some(path) = self.opened.source.path.as_deref().filter(|_| !self.is_scripted()) {
                self.panels.recent.add(path);
            }
            // The place of the voxels is no choice of a volume.
            self.opened.selection =
                Selection { memory: HostMemory::default(), ..loaded.file.scene.volume().selection.clone() };
            self.opened.title = self.opened.source.title(&self.opened.selection);
            (self.tasks.curve, self.tasks.chosen) = (None, None);
            if let Some(guess) = &loaded.file.guess {
                self.tell_done(format!(
                    "{guess} To change it, use the presets or window and level of the transfer function, or the materials."
                ));
            }
        }
        (self.tasks.measuring, self.tasks.solving) = (None, None);
        self.tasks.verdicts.clear();
        // The new engine counts its pictures from zero.
        let looked_at = self.picture.prober.place().filter(|_| again);
        self.picture.prober.look(None);
        self.picture.prober.look(looked_at);
        let mut engine = Engine::new(loaded);
        if let Some(document) = &self.opened.document {
            engine.light(document.state());
        }
        self.give_up_engine();
        self.engine = Some(engine);
        // The next frame requests a picture, since it knows the picture's size.
        self.picture.place = Rect::ZERO;
    }

    /// Returns the initial document of a loaded scene; `None` if it would discard unsaved changes.
    fn document_of(&self, loaded: &Loaded) -> Option<Document> {
        let scene = &loaded.file.scene;
        let but_time =
            |selection: &Selection| Selection { time: None, memory: HostMemory::default(), ..selection.clone() };
        let alike = but_time(&scene.volume().selection) == but_time(&self.opened.selection);
        match self.opened.document.as_ref().filter(|_| loaded.source.is_another_of(&self.opened.source)) {
            Some(before) if before.has_grid_of(scene) => Some(before.clone().with_file(loaded.file.clone(), alike)),
            Some(_) if self.losing().changes => None,
            // The lights of a bare volume are a choice, not a mix, unless its look mixes them.
            _ if loaded.source.bare_volume().is_some() && loaded.file.light.is_of_all() => {
                Some(Document::starting(loaded.file.clone(), &Edit::HandOnNode(0)))
            }
            _ => Some(Document::new(loaded.file.clone())),
        }
    }

    /// Reopens the device after the loss `error` and restores the scene. After a second loss without a finest picture,
    /// rendering waits for the user, since the scene may be the cause.
    pub(super) fn recover(&mut self, error: VulkanError) -> Result<(), ViewError> {
        let Some(screen) = self.screen.take() else { return Ok(()) };
        self.lost.times += 1;
        if self.lost.times > MOST_LOSSES {
            return Err(error.into());
        }
        tracing::debug!("{error}");
        self.record.report.losses += 1;
        self.record.report.validation.extend(screen.renderer.device().validation_messages());
        self.record.before = self.counts();
        self.give_up_engine();
        self.tasks.measuring = None;
        ui::forget_slices(&self.panels.context);
        self.panels.textures.clear();
        let was_opening = self.loading.now.as_ref().map(|loading| loading.source().clone());
        self.give_up();
        let screen = screen.renewed(&self.options)?;
        screen.window.request_redraw();
        self.screen = Some(screen);
        match was_opening {
            Some(source) if self.opened.document.is_some() => {
                self.note(format!("{} was not opened: the device was lost, and has restarted.", source.name()));
            }
            was_opening => {
                self.note("The device was lost, and has restarted.".to_owned());
                // It is what is opened again.
                self.options.source = was_opening.unwrap_or(std::mem::take(&mut self.options.source));
            }
        }
        if self.lost.times == 1 {
            self.restore();
        } else {
            self.lost.stopped = true;
        }
        Ok(())
    }
}
