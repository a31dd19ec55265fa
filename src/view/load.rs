//! Opening of scenes in the background: reading, planning and upload to the device.

use std::sync::Arc;
use std::thread::JoinHandle;

use super::task::Listener;
use crate::document::{OpenError, SceneFile, Source};
use crate::memory::give_back_freed;
use crate::plan::Planned;
use crate::progress::Progress;
use crate::render::{Job, PlannedJob, RenderError, Renderer, SceneRenderer, finest_level};
use crate::scene::Coarse;
use crate::volume::{HostMemory, Statistics};

/// Reason why a scene could not be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// Error of the scene or its volume.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Error of the plan or the device.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl LoadError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Open(error) => error.code(),
            Self::Render(error) => error.code(),
        }
    }

    /// Returns the error of reading the source, if reading failed.
    #[must_use]
    pub fn of_source(&self) -> Option<&OpenError> {
        if let Self::Open(error) = self { Some(error) } else { None }
    }
}

/// Scene on the device.
#[derive(Debug)]
pub struct Loaded {
    /// The scene, planned, uploaded and warmed up; with a coarse level in place of a volume that the device or the memory
    /// cannot hold whole.
    pub on_device: SceneRenderer,
    /// This coarse level.
    pub coarse: Option<Coarse>,
    /// The scene file.
    pub file: SceneFile,
    /// Source of the scene.
    pub source: Source,
}

/// Background task that opens a source. Dropping it cancels it.
#[derive(Debug)]
pub struct Loading {
    source: Source,
    listener: Arc<Listener>,
    thread: Option<JoinHandle<()>>,
}

impl Loading {
    /// Starts to `load` `source`. `progressed` is called from time to time, `loaded` at the end.
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
            // Reading and planning need many times the memory that they keep.
            give_back_freed();
            loaded(result);
        });
        Self { source, listener, thread: Some(thread) }
    }

    /// The source being opened.
    #[must_use]
    pub fn source(&self) -> &Source {
        &self.source
    }

    /// Asks the task to stop; it may take a moment to do so.
    pub fn give_up(&self) {
        self.listener.cancel();
    }

    /// Whether the task's thread has ended.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Cancels the task and waits for its thread to end.
    pub fn end(mut self) {
        self.give_up();
        // A panic of the thread has already been reported.
        self.thread.take().map(JoinHandle::join).transpose().ok();
    }

    /// Name of the source, completed fraction of the current stage (0 to 1, if known), and the stage's name.
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
    /// Opens `source` on a device: reads, plans and uploads it, and warms the pipelines up. Its voxels are kept in `memory`.
    ///
    /// # Errors
    ///
    /// [`LoadError`].
    pub fn open(
        renderer: &Renderer,
        source: Source,
        memory: HostMemory,
        progress: &dyn Progress,
    ) -> Result<Self, LoadError> {
        let mut bounded = source.clone();
        bounded.options.selection.memory = memory;
        let (file, statistics) = bounded.read(progress)?;
        Self::prepare(renderer, file, statistics, source, progress)
    }

    /// Plans the scene of `file`, which was read from `source`, uploads its volume and warms the pipelines up.
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
        let job = Job::new(file.scene.clone(), statistics);
        let in_file = job.scene.fields.first().bricks().is_some();
        let whole = if in_file { None } else { Some(job.clone().planned(progress)?) };
        let is_held = |job: &PlannedJob| renderer.holds_whole(&job.scene, &job.planned, &job.statistics);
        let (job, coarse) = match whole.filter(is_held) {
            Some(whole) => (whole, None),
            None if !job.scene.fields.further().is_empty() => return Err(RenderError::Fields.into()),
            None => {
                let coarse = finest_level(&job.scene, |dims| renderer.has_room_for_coarse(dims), progress)?;
                (Job { scene: coarse.scene(&job.scene), ..job }.planned(progress)?, Some(coarse))
            }
        };
        warn_of_plan(&job.planned);
        let on_device = job.uploaded(renderer, progress)?;
        on_device.warm_up()?;
        Ok(Self { on_device, coarse, file, source })
    }
}
