//! What is opened: read, planned and brought to the device beside the window.

use std::sync::Arc;
use std::thread::JoinHandle;

use super::job::Listener;
use crate::document::{OpenError, SceneFile, Source};
use crate::memory::give_back_freed;
use crate::plan::Planned;
use crate::progress::Progress;
use crate::render::{RenderError, Renderer, SceneRenderer};
use crate::volume::Statistics;

/// Why something could not be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The scene or its volume.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Its plan, or the device.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl LoadError {
    /// The error of opening the source, if that is what failed.
    #[must_use]
    pub fn of_source(&self) -> Option<&OpenError> {
        if let Self::Open(error) = self { Some(error) } else { None }
    }
}

/// A scene on the device.
#[derive(Debug)]
pub struct Loaded {
    /// The scene, planned, uploaded and warmed up.
    pub on_device: SceneRenderer,
    /// The scene file.
    pub file: SceneFile,
    /// What was opened.
    pub source: Source,
}

/// Something that is being opened on a thread of its own. Dropping it is to give up.
#[derive(Debug)]
pub struct Loading {
    source: Source,
    listener: Arc<Listener>,
    thread: Option<JoinHandle<()>>,
}

impl Loading {
    /// Begins to `load` what is at `source`. `progressed` is called now and then, `loaded` at the end.
    pub fn start(
        source: Source,
        load: impl FnOnce(&dyn Progress) -> Result<Loaded, LoadError> + Send + 'static,
        progressed: impl Fn() + Send + Sync + 'static,
        loaded: impl FnOnce(Result<Loaded, LoadError>) + Send + 'static,
    ) -> Self {
        let listener = Arc::new(Listener::new(progressed));
        let heard = Arc::clone(&listener);
        let thread = std::thread::spawn(move || {
            let result = load(&*heard);
            // Reading and planning take many times what they leave.
            give_back_freed();
            loaded(result);
        });
        Self { source, listener, thread: Some(thread) }
    }

    /// What is opened.
    #[must_use]
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// Gives up; what is under way may take a moment to hear of it.
    pub fn give_up(&self) {
        self.listener.cancel();
    }

    /// Whether nothing is done for it any more.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Gives up, and waits until nothing is done for it any more.
    pub fn end(mut self) {
        self.give_up();
        // A panic there has been told of.
        self.thread.take().map(JoinHandle::join).transpose().ok();
    }

    /// What is opened, how much of the present stage is done (0 to 1, where known), and what stage that is.
    #[must_use]
    pub fn progress(&self) -> (String, Option<f32>, String) {
        let (part, stage) = self.listener.progress();
        (self.source.name(), part, stage)
    }
}

impl Drop for Loading {
    fn drop(&mut self) {
        self.give_up();
    }
}

/// Logs the warnings of a plan.
pub(super) fn warn_of_plan(planned: &Planned) {
    for warning in &planned.warnings {
        tracing::warn!("{warning}");
    }
}

impl Loaded {
    /// Opens `source` on a device: reads, plans, uploads, and warms the pipelines up.
    ///
    /// # Errors
    ///
    /// [`LoadError`].
    pub fn open(renderer: &Renderer, source: Source, progress: &dyn Progress) -> Result<Self, LoadError> {
        let (file, statistics) = source.read(progress)?;
        Self::prepare(renderer, file, statistics, source, progress)
    }

    /// Plans the scene of `file`, read from `source`, uploads its volume and warms the pipelines up.
    ///
    /// # Errors
    ///
    /// [`LoadError::Render`].
    pub fn prepare(
        renderer: &Renderer,
        file: SceneFile,
        statistics: Statistics,
        source: Source,
        progress: &dyn Progress,
    ) -> Result<Self, LoadError> {
        let on_device = SceneRenderer::with_statistics(renderer, file.scene.clone(), statistics, progress)?;
        warn_of_plan(on_device.planned());
        on_device.warm_up()?;
        Ok(Self { on_device, file, source })
    }
}
