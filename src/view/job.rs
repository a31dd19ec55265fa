//! Work beside the window: started, watched, and given up when nobody waits for it any more.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crate::progress::Progress;

/// Least time between two pieces of news.
const NEWS: Duration = Duration::from_millis(50);

/// How far something is.
#[derive(Debug, Default)]
struct Stage {
    name: String,
    done: u64,
    total: u64,
    told: Option<Instant>,
}

/// What work on another thread reports to, and hears from that it should stop.
pub(super) struct Listener {
    stage: Mutex<Stage>,
    cancelled: AtomicBool,
    progressed: Box<dyn Fn() + Send + Sync>,
}

impl Listener {
    /// One that calls `progressed` now and then.
    pub(super) fn new(progressed: impl Fn() + Send + Sync + 'static) -> Self {
        Self { stage: Mutex::default(), cancelled: AtomicBool::new(false), progressed: Box::new(progressed) }
    }

    /// Asks the work to stop.
    pub(super) fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    /// How much of the present stage is done (0 to 1, where known), and what stage that is.
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
        if stage.told.is_none_or(|told| told.elapsed() > NEWS) {
            stage.told = Some(Instant::now());
            drop(stage);
            (self.progressed)();
        }
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

/// Work on a thread of its own. Dropping it is to give it up.
#[derive(Debug)]
pub struct Job<T> {
    listener: Arc<Listener>,
    made: Arc<Mutex<Option<T>>>,
    thread: Option<JoinHandle<()>>,
    begun: Instant,
}

impl<T: Send + 'static> Job<T> {
    /// Begins `work`. `wake` is called now and then, and when it is done.
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

    /// What came of it, once it is done; only once.
    #[must_use]
    pub fn take(&mut self) -> Option<T> {
        self.made.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// How much of the present stage is done (0 to 1, where known), and what stage that is.
    #[must_use]
    pub fn progress(&self) -> (Option<f32>, String) {
        self.listener.progress()
    }

    /// How long it has been at work.
    #[must_use]
    pub fn spent(&self) -> Duration {
        self.begun.elapsed()
    }

    /// Gives up, and waits until nothing is done for it any more.
    pub fn end(mut self) {
        self.listener.cancel();
        // A panic there has been told of.
        self.thread.take().map(JoinHandle::join).transpose().ok();
    }
}

impl<T> Drop for Job<T> {
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
        let mut job = Job::start(wake, move |progress| {
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
        let job = Job::start(
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
