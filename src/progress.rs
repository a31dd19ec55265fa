//! How long work says how far it is, and hears that it should stop.

/// Listens to long work. Implementations are cheap: work may report thousands of times a second.
pub trait Progress: Sync {
    /// `done` of `total` units of `stage` (a short noun phrase such as "reading frog.zraw") are finished.
    fn report(&self, stage: &str, done: u64, total: u64);

    /// Whether the work should stop at the next opportunity, with its module's `Cancelled` error.
    fn cancelled(&self) -> bool {
        false
    }
}

/// Nobody listens, nobody cancels.
#[derive(Clone, Copy, Debug, Default)]
pub struct Quiet;

impl Progress for Quiet {
    fn report(&self, _stage: &str, _done: u64, _total: u64) {}
}
