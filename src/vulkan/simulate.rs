//! Failures that a healthy device does not have: what the program makes of them can be tested on any.

use std::sync::atomic::{AtomicU64, Ordering};

/// The environment variable that asks for a failure: `device-lost=N` from the Nth submission on, `out-of-memory=N` for
/// the Nth object and all after it, counted from 1.
const VARIABLE: &str = "RELUME_SIMULATE";

/// Which failures a device is to have; none, unless the environment asks for one.
#[derive(Debug)]
pub(super) struct Simulated {
    lost: Countdown,
    full: Countdown,
}

/// How often something works.
#[derive(Debug)]
struct Countdown(Option<AtomicU64>);

impl Simulated {
    /// What the environment asks for.
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
    pub(super) fn loses_device(&self) -> bool {
        self.lost.is_over()
    }

    /// Whether there is no memory for the next object.
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
