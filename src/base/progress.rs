//! Progress reports and cancellation of long work.

/// Receiver of progress reports. Implementations must be cheap: work may report thousands of times a second.
pub trait Progress: Sync {
    /// Reports that `done` of `total` units of `stage` (a short noun phrase such as "reading frog.zraw") are finished.
    fn report(&self, stage: &str, done: u64, total: u64);

    /// Whether the work should stop at the next opportunity, with its module's `Cancelled` error.
    fn cancelled(&self) -> bool {
        false
    }
}

/// Progress without reports, for one part of a work whose parts are counted; `progress` still cancels it.
#[must_use]
pub fn unreported(progress: &dyn Progress) -> impl Progress {
    struct Unreported<'a>(&'a dyn Progress);
    impl Progress for Unreported<'_> {
        fn report(&self, _stage: &str, _done: u64, _total: u64) {}

        fn cancelled(&self) -> bool {
            self.0.cancelled()
        }
    }
    Unreported(progress)
}

/// Ignores reports and never cancels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quiet;

impl Progress for Quiet {
    fn report(&self, _stage: &str, _done: u64, _total: u64) {}
}
