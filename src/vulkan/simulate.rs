//! Simulated devices: those that fail and those that need more memory, for tests on a healthy one.

use std::sync::atomic::{AtomicU64, Ordering};

/// Environment variable that requests one of these. `device-lost=N` fails every submission from the Nth on; `out-of-memory=N`
/// fails every allocation from the Nth on; N counts from 1. With `image-padding=N`, images take N per cent more memory.
const VARIABLE: &str = "RELUME_SIMULATE";

/// What the environment requests; nothing by default.
#[derive(Debug)]
pub(crate) struct Simulated {
    lost: Countdown,
    full: Countdown,
    image_padding: u64,
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
        let stated = |name: &str| {
            let (_, number) = text.split_once('=').filter(|(key, _)| *key == name)?;
            number.parse::<u64>().ok()
        };
        let after = |name: &str| Countdown(stated(name).map(|number| AtomicU64::new(number.saturating_sub(1))));
        let image_padding = stated("image-padding").unwrap_or(0);
        Self { lost: after("device-lost"), full: after("out-of-memory"), image_padding }
    }

    /// Whether the next submission loses the device.
    pub(crate) fn loses_device(&self) -> bool {
        self.lost.is_over()
    }

    /// Whether the next allocation fails.
    pub(super) fn has_no_memory(&self) -> bool {
        self.full.is_over()
    }

    /// Bytes of an image whose texels take `bytes`.
    pub(super) fn padded(&self, bytes: u64) -> u64 {
        bytes.saturating_add(bytes.saturating_mul(self.image_padding) / 100)
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
        assert_eq!([third.padded(1000), Simulated::new("image-padding=7").padded(1000)], [1000, 1070]);
    }
}
