//! Background tasks: started, watched, and cancelled when their result is no longer needed.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::progress::Progress;

/// Least time between two progress notifications.
const NEWS: Duration = Duration::from_millis(50);

/// Progress of the current stage.
#[derive(Debug, Default)]
struct Stage {
    name: String,
    done: u64,
    total: u64,
    reported: Option<Instant>,
}

/// Receives the progress of a background task and tells it to stop.
pub(super) struct Listener {
    stage: Mutex<Stage>,
    cancelled: AtomicBool,
    progressed: Box<dyn Fn() + Send + Sync>,
}

impl Listener {
    /// Creates a listener that calls `progressed` from time to time.
    pub(super) fn new(progressed: impl Fn() + Send + Sync + 'static) -> Self {
        Self { stage: Mutex::default(), cancelled: AtomicBool::new(false), progressed: Box::new(progressed) }
    }

    /// Asks the task to stop.
    pub(super) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// Completed fraction of the current stage (0 to 1, if known), and the stage's name.
    pub(super) fn progress(&self) -> (Option<f32>, String) {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "for a bar on the screen")]
        let part = (stage.total > 0).then(|| (stage.done as f64 / stage.total as f64) as f32);
        (part, stage.name.clone())
    }
}

impl fmt::Debug for Listener {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Listener").field("stage", &self.stage).finish_non_exhaustive()
    }
}

impl Progress for Listener {
    fn report(&self, name: &str, done: u64, total: u64) {
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        if stage.name != name {
            name.clone_into(&mut stage.name);
        }
        (stage.done, stage.total) = (done, total);
        if stage.reported.is_none_or(|reported| reported.elapsed() > NEWS) {
            stage.reported = Some(Instant::now());
            drop(stage);
            (self.progressed)();
        }
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

/// Background task on its own thread. Dropping it cancels it.
#[derive(Debug)]
pub struct Task<T> {
    listener: Arc<Listener>,
    made: Arc<Mutex<Option<T>>>,
    thread: Option<JoinHandle<()>>,
    begun: Instant,
}

impl<T: Send + 'static> Task<T> {
    /// Starts `work`. `wake` is called from time to time and at the end.
    pub fn start(
        wake: impl Fn() + Send + Sync + Clone + 'static,
        work: impl FnOnce(&dyn Progress) -> T + Send + 'static,
    ) -> Self {
        let (listener, made) = (Arc::new(Listener::new(wake.clone())), Arc::new(Mutex::new(None)));
        let (heard, place) = (Arc::clone(&listener), Arc::clone(&made));
        let thread = std::thread::spawn(move || {
            let result = work(&*heard);
            *place.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            wake();
        });
        Self { listener, made, thread: Some(thread), begun: Instant::now() }
    }

    /// Returns the result once the task is finished, and only once.
    #[must_use]
    pub fn take(&mut self) -> Option<T> {
        self.made.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Completed fraction of the current stage (0 to 1, if known), and the stage's name.
    #[must_use]
    pub fn progress(&self) -> (Option<f32>, String) {
        self.listener.progress()
    }

    /// Time since the start.
    #[must_use]
    pub fn spent(&self) -> Duration {
        self.begun.elapsed()
    }

    /// Asks the task to stop; its result says whether it did.
    pub fn cancel(&self) {
        self.listener.cancel();
    }

    /// Whether the task has been asked to stop.
    #[must_use]
    pub fn is_cancelled(&self) -> bool {
        self.listener.cancelled()
    }

    /// Whether the task's thread has ended; without a result if it panicked.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Cancels the task and returns its thread, which may take a moment to end.
    #[must_use]
    pub fn give_up(mut self) -> Option<JoinHandle<()>> {
        self.listener.cancel();
        self.thread.take()
    }

    /// Cancels the task and waits for its thread to end.
    pub fn end(self) {
        // A panic of the thread has already been reported.
        self.give_up().map(JoinHandle::join).transpose().ok();
    }
}

impl<T> Drop for Task<T> {
    fn drop(&mut self) {
        self.listener.cancel();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn a_job_says_how_far_it_is_and_hands_over_its_result_once() {
        let (woken, wakes) = channel();
        let (go, going) = channel::<()>();
        let wake = move || woken.send(()).unwrap_or_default();
        let mut job = Task::start(wake, move |progress| {
            progress.report("counting", 1, 4);
            going.recv().ok();
            7
        });
        assert!(wakes.recv_timeout(Duration::from_secs(10)).is_ok(), "news of the stage");
        assert_eq!((job.progress(), job.take()), ((Some(0.25), "counting".to_owned()), None));
        assert!(go.send(()).is_ok() && wakes.recv_timeout(Duration::from_secs(10)).is_ok(), "news of the end");
        assert_eq!([job.take(), job.take()], [Some(7), None]);
    }

    #[test]
    fn a_job_that_is_dropped_hears_that_it_should_stop() {
        let (heard, hears) = channel();
        let job = Task::start(
            || {},
            move |progress| {
                while !progress.cancelled() {
                    std::thread::yield_now();
                }
                heard.send(()).ok();
            },
        );
        drop(job);
        assert!(hears.recv_timeout(Duration::from_secs(10)).is_ok());
    }
}
