//! Long work: a thread of its own without the interpreter's lock, its progress, Ctrl-C and its warnings.

use std::cell::RefCell;
use std::fmt;
use std::panic::resume_unwind;
use std::process;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, Once, OnceLock, PoisonError};
use std::thread;
use std::time::Duration;

use pyo3::prelude::*;
use pyo3::types::PyBool;
use rayon::{ThreadPool, ThreadPoolBuilder};
use relume::progress::Progress;
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt as _};

use crate::errors::{Failed, Made};

/// Pause between looks at signals and progress.
const PAUSE: Duration = Duration::from_millis(50);

/// Stage, units done, and their total.
type Stage = (String, u64, u64);

/// Progress, cancellation and end of a work, shared by its thread and the caller's.
#[derive(Default)]
struct Shared {
    stage: Mutex<Option<Stage>>,
    cancelled: AtomicBool,
    ended: Mutex<bool>,
    wakes: Condvar,
}

fn locked<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Progress for Shared {
    fn report(&self, stage: &str, done: u64, total: u64) {
        *locked(&self.stage) = Some((stage.to_owned(), done, total));
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

/// Cancelled if `progress` answered `False`.
fn answered(py: Python<'_>, answer: &Bound<'_, PyAny>) -> PyResult<()> {
    if answer.cast::<PyBool>().is_ok_and(|answer| !answer.is_true()) {
        return Err(Failed::new("Cancelled", "cancelled", "progress returned False").raised(py));
    }
    Ok(())
}

/// Sets the end, however the work ends.
struct Ending<'a>(&'a Shared);

impl Drop for Ending<'_> {
    fn drop(&mut self) {
        *locked(&self.0.ended) = true;
        self.0.wakes.notify_all();
    }
}

impl Shared {
    /// Waits for the end of the work, or for a pause; returns whether it has ended.
    fn waited(&self) -> bool {
        let ended = locked(&self.ended);
        let (ended, _) =
            self.wakes.wait_timeout_while(ended, PAUSE, |ended| !*ended).unwrap_or_else(PoisonError::into_inner);
        *ended
    }

    /// Looks for signals, and calls `progress` if there is a new stage.
    fn looked(&self, py: Python<'_>, progress: Option<&Bound<'_, PyAny>>, told: &mut Option<Stage>) -> PyResult<()> {
        py.check_signals()?;
        let stage = locked(&self.stage).clone();
        if let (Some(progress), Some(stage)) = (progress, stage.filter(|stage| told.as_ref() != Some(stage))) {
            let answer = progress.call1(stage.clone())?;
            *told = Some(stage);
            answered(py, &answer)?;
        }
        Ok(())
    }
}

/// The process that imported the module.
static OWNER: OnceLock<u32> = OnceLock::new();

/// Threads of a forked process, which has none of those of its parent.
static FORKED: Mutex<Option<(u32, Arc<ThreadPool>)>> = Mutex::new(None);

/// Notes the process that imports the module.
pub(crate) fn import() {
    OWNER.get_or_init(process::id);
}

/// Runs `work` on all cores, also in a process that was forked from the one that imported the module.
fn on_cores<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    let this = process::id();
    if OWNER.get() == Some(&this) {
        return work();
    }
    let mut forked = locked(&FORKED);
    let known = forked.as_ref().filter(|(owner, _)| *owner == this).map(|(_, pool)| Arc::clone(pool));
    let Some(pool) = known.or_else(|| ThreadPoolBuilder::new().build().ok().map(Arc::new)) else { return work() };
    *forked = Some((this, Arc::clone(&pool)));
    drop(forked);
    pool.install(work)
}

/// Runs short `work` on all cores without the interpreter's lock.
pub(crate) fn detached<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    py.detach(|| on_cores(work))
}

/// Runs `work` in a thread of its own. `progress(stage, done, total)` is called in the calling thread; an exception in it, a
/// signal or its answer `False` cancels the work, and is raised when the work has ended. Warnings of the library become
/// those of Python.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&dyn Progress) -> Made<T> + Send,
) -> PyResult<T> {
    listen();
    let (shared, warnings) = (Shared::default(), Warnings::default());
    let mut interrupted = None;
    let made = thread::scope(|scope| {
        let worker = thread::Builder::new().name("relume".to_owned()).spawn_scoped(scope, || {
            let _ending = Ending(&shared);
            on_cores(|| listening(&warnings, || work(&shared)))
        })?;
        let mut told = None;
        while !py.detach(|| shared.waited()) {
            if interrupted.is_none()
                && let Err(error) = shared.looked(py, progress, &mut told)
            {
                shared.cancelled.store(true, Ordering::Relaxed);
                interrupted = Some(error);
            }
        }
        py.detach(|| worker.join()).map_or_else(|panic| resume_unwind(panic), PyResult::Ok)
    })?;
    let raised = warn(py, &warnings);
    if let Some(error) = interrupted {
        return Err(error);
    }
    if let (Ok(_), Some(progress), Some((stage, _, total))) = (&made, progress, locked(&shared.stage).take()) {
        answered(py, &progress.call1((stage, total, total))?)?;
    }
    let made = made.map_err(|failed| failed.raised(py))?;
    raised?;
    Ok(made)
}

/// Runs short `work` with the interpreter's lock, and raises its warnings.
pub(crate) fn warned<T>(py: Python<'_>, work: impl FnOnce() -> PyResult<T>) -> PyResult<T> {
    listen();
    let warnings = Warnings::default();
    let made = listening(&warnings, work)?;
    warn(py, &warnings)?;
    Ok(made)
}

/// Warnings of a work.
type Warnings = Arc<Mutex<Vec<String>>>;

thread_local! {
    /// Those of the work of this thread.
    static WARNINGS: RefCell<Option<Warnings>> = const { RefCell::new(None) };
}

/// Runs `work`, whose warnings in this thread are added to `warnings`.
fn listening<T>(warnings: &Warnings, work: impl FnOnce() -> T) -> T {
    let before = WARNINGS.replace(Some(Arc::clone(warnings)));
    let made = work();
    WARNINGS.set(before);
    made
}

/// Raises warnings as `RelumeWarning`, all of them, also where one is an error.
fn warn(py: Python<'_>, warnings: &Warnings) -> PyResult<()> {
    let warnings = std::mem::take(&mut *locked(warnings));
    if warnings.is_empty() {
        return Ok(());
    }
    let class = py.import("relume._errors")?.getattr("RelumeWarning")?;
    let warn = py.import("warnings")?.getattr("warn")?;
    let raised: Vec<PyResult<_>> = warnings.into_iter().map(|warning| warn.call1((warning, &class, 1))).collect();
    raised.into_iter().collect::<PyResult<Vec<_>>>().map(|_| ())
}

/// Adds a warning to those of the work of this thread.
pub(crate) fn heard(warning: impl fmt::Display) {
    WARNINGS.with_borrow(|warnings| {
        if let Some(warnings) = warnings {
            locked(warnings).push(warning.to_string());
        }
    });
}

/// Hears the warnings of the library from now on.
fn listen() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        // Another subscriber of the process keeps its place.
        let _ = tracing::subscriber::set_global_default(tracing_subscriber::registry().with(Ear));
    });
}

/// Keeps warnings for [`warn`].
struct Ear;

impl<S: Subscriber> Layer<S> for Ear {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        if *event.metadata().level() == Level::WARN {
            let mut message = Message(String::new());
            event.record(&mut message);
            heard(message.0);
        }
    }
}

struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn fmt::Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}
