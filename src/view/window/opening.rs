//! Opening of scenes in the background, and recovery of a lost device.

use egui::Rect;

use super::{MOST_LOSSES, ViewError, Viewer, Woken};
use crate::document::{Document, Edit, OpenError, SceneFile, Source};
use crate::progress::Progress;
use crate::render::{RenderError, Renderer};
use crate::view::action::Leaving;
use crate::view::engine::Engine;
use crate::view::load::{LoadError, Loaded, Loading};
use crate::volume::Selection;
use crate::vulkan::VulkanError;

impl Viewer {
    /// Opens `source` in the background; cancels loading in progress.
    pub(super) fn open(&mut self, source: Source) {
        // An open question belongs to the previous source.
        self.chooser.close();
        self.load(source.clone(), false, move |renderer, progress| Loaded::open(renderer, source, progress));
    }

    /// Opens another volume of the current file.
    pub(super) fn open_another(&mut self) {
        self.open(self.source.reselected());
    }

    /// Loads the document onto the device again.
    pub(super) fn restore(&mut self) {
        self.lost.stopped = false;
        let Some(document) = &self.document else { return self.open(self.options.source.clone()) };
        let file = SceneFile { scene: document.state().scene.clone(), ..document.opened().clone() };
        let statistics = document.statistics().cloned();
        let source = self.source.clone();
        self.load(source.clone(), true, move |renderer, progress| {
            let statistics = statistics.map_or_else(|| file.scene.volume.statistics(), Ok).map_err(OpenError::from)?;
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
        self.opened += 1;
        let (number, proxy) = (self.opened, self.proxy.clone());
        let loaded = {
            let proxy = proxy.clone();
            // The event loop may be gone.
            move |loaded| drop(proxy.send_event(Woken::Loaded { number, again, loaded: Box::new(loaded) }))
        };
        let progressed = move || drop(proxy.send_event(Woken::Progress));
        let renderer = screen.renderer.clone();
        self.give_up();
        self.loading = Some(Loading::start(source, move |progress| load(&renderer, progress), progressed, loaded));
    }

    /// Cancels loading in progress.
    pub(super) fn give_up(&mut self) {
        self.given_up.retain(|loading| !loading.is_over());
        if let Some(loading) = self.loading.take() {
            loading.give_up();
            self.given_up.push(loading);
        }
    }

    pub(super) fn loaded(&mut self, loaded: Result<Loaded, LoadError>, again: bool) {
        let opened = self.loading.take().map(|loading| loading.source().clone());
        let loaded = match loaded {
            Ok(loaded) => loaded,
            // The next frame reports the loss and recovers.
            Err(LoadError::Render(RenderError::Vulkan(VulkanError::DeviceLost { .. }))) => return,
            Err(error) => {
                // A script cannot answer, and an open question stays; the error says as much.
                let opened = opened.filter(|_| !self.is_scripted() && !self.chooser.is_open());
                let of_source = error.of_source();
                let question = of_source.and_then(OpenError::question);
                match (opened, question, of_source.and_then(OpenError::scene_without_volume)) {
                    (Some(source), Some(question), _) => {
                        let none = Selection::default();
                        let shown = if source.is_another_of(&self.source) { &self.selection } else { &none };
                        self.chooser.ask(source, question, shown);
                    }
                    (Some(source), None, Some(scene)) => {
                        self.tell(&error);
                        self.chooser.ask_volume(source, scene);
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
            return self.chooser.leave(Leaving::Open(Box::new(source)));
        }
        self.before = self.counts();
        if let Some(document) = document.filter(|_| !again) {
            if !self.is_scripted() {
                // Older errors no longer apply.
                self.notices.retain(|notice| notice.until.is_some());
            }
            self.stop_tour();
            self.give_up_tour("Another file was opened");
            self.forget_waiting();
            self.document = Some(document.with_statistics(loaded.on_device.statistics().clone()));
            self.source = loaded.source.clone();
            self.selection = loaded.on_device.scene().volume.selection.clone();
            self.title = self.source.title(&self.selection);
            (self.curve, self.chosen) = (None, None);
        }
        (self.measuring, self.solving) = (None, None);
        self.verdicts.clear();
        // The new engine counts its pictures from zero.
        let looked_at = self.prober.place().filter(|_| again);
        self.prober.look(None);
        self.prober.look(looked_at);
        let mut engine = Engine::new(loaded);
        if let Some(document) = &self.document {
            engine.light(document.state());
        }
        self.engine = Some(engine);
        // The next frame requests a picture, since it knows the picture's size.
        self.place = Rect::ZERO;
    }

    /// Returns the initial document of a loaded scene; `None` if it would discard unsaved changes.
    fn document_of(&self, loaded: &Loaded) -> Option<Document> {
        let scene = loaded.on_device.scene();
        let but_time = |selection: &Selection| Selection { time: None, ..selection.clone() };
        let alike = but_time(&scene.volume.selection) == but_time(&self.selection);
        match self.document.as_ref().filter(|_| loaded.source.is_another_of(&self.source)) {
            Some(before) if before.has_grid_of(scene) => Some(before.clone().with_file(loaded.file.clone(), alike)),
            Some(_) if self.losing().changes => None,
            // The lights of a bare volume are a choice, not a mix.
            _ if loaded.source.bare_volume().is_some() => {
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
        self.report.losses += 1;
        self.report.validation.extend(screen.renderer.device().validation_messages());
        self.before = self.counts();
        (self.engine, self.measuring) = (None, None);
        self.textures.clear();
        let was_opening = self.loading.as_ref().map(|loading| loading.source().clone());
        self.give_up();
        let screen = screen.renewed(&self.options)?;
        screen.window.request_redraw();
        self.screen = Some(screen);
        match was_opening {
            Some(source) if self.document.is_some() => {
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
