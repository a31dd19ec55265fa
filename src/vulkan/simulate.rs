//! Simulated device failures, for tests on a healthy device.

use std::sync::atomic::{AtomicU64, Ordering};

/// Environment variable that requests a failure. `device-lost=N` fails every submission from the Nth on;
/// `out-of-memory=N` fails every allocation from the Nth on. N counts from 1.
const VARIABLE: &str = "RELUME_SIMULATE";

/// Failures that the environment requests; none by default.
#[derive(Debug)]
pub(crate) struct Simulated {
    lost: Countdown,
    full: Countdown,
}

/// Number of operations left before the failure.
#[derive(Debug)]
struct Countdown(Option<AtomicU64>);

impl Simulated {
    /// Reads the environment variable.
    pub(super) fn asked_for() -> Self {
        Self::new(&std::env::var(VARIABLE).unwrap_or_default())
    }

    fn new(text: &str) -> Self {
        let after = |name: &str| {
            let (_, number) = text.split_once('=').filter(|(key, _)| *key == name)?;
            Some(AtomicU64::new(number.parse::<u64>().ok()?.saturating_sub(1)))
        };
        Self { lost: Countdown(after("device-lost")), full: Countdown(after("out-of-memory")) }
    }

    /// Whether the next submission loses the device.
    pub(crate) fn loses_device(&self) -> bool {
        self.lost.is_over()
    }

    /// Whether the next allocation fails.
    pub(super) fn has_no_memory(&self) -> bool {
        self.full.is_over()
    }
}

impl Countdown {
    fn is_over(&self) -> bool {
        let less = |left: u64| left.checked_sub(1);
        self.0.as_ref().is_some_and(|left| left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, less).is_err())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failure_comes_when_it_is_asked_for_and_stays() {
        let third = Simulated::new("device-lost=3");
        assert_eq!([(); 5].map(|()| third.loses_device()), [false, false, true, true, true]);
        assert!(!third.has_no_memory(), "nobody asked for that");
        for nothing in ["", "device-lost", "device-lost=often", "rain=1"] {
            assert!(!Simulated::new(nothing).loses_device(), "{nothing:?}");
        }
        assert!(Simulated::new("out-of-memory=1").has_no_memory(), "from the first object on");
    }
}
