//! Elapsed time and memory use.

use std::ops::{AddAssign, Sub};
use std::time::Instant;

use rustix::time::{ClockId, clock_gettime};
use serde::Serialize;

/// Elapsed wall and CPU time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Timing {
    /// Wall time, in ms.
    pub wall_ms: f64,
    /// CPU time of all threads of this process, in ms.
    pub cpu_ms: f64,
}

impl Sub for Timing {
    type Output = Self;

    fn sub(self, part: Self) -> Self {
        Self { wall_ms: self.wall_ms - part.wall_ms, cpu_ms: self.cpu_ms - part.cpu_ms }
    }
}

impl AddAssign for Timing {
    fn add_assign(&mut self, more: Self) {
        self.wall_ms += more.wall_ms;
        self.cpu_ms += more.cpu_ms;
    }
}

/// A limit of wall time in ms; infinite for none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit(pub f64);

impl Limit {
    /// No limit.
    pub const NONE: Self = Self(f64::INFINITY);
}

/// Measures time from its start; can be read any number of times.
#[derive(Clone, Copy, Debug)]
pub struct Stopwatch {
    wall: Instant,
    cpu_ms: f64,
}

impl Stopwatch {
    /// Starts a stopwatch.
    #[must_use]
    pub fn start() -> Self {
        Self { wall: Instant::now(), cpu_ms: process_cpu_ms() }
    }

    /// Returns the time since the start.
    #[must_use]
    pub fn read(&self) -> Timing {
        Timing { wall_ms: self.wall.elapsed().as_secs_f64() * 1e3, cpu_ms: process_cpu_ms() - self.cpu_ms }
    }
}

/// CPU time of all threads of this process since its start, in ms.
#[expect(clippy::cast_precision_loss, reason = "seconds and nanoseconds of a process are far below 2⁵³")]
fn process_cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    (time.tv_sec as f64).mul_add(1e3, time.tv_nsec as f64 * 1e-6)
}

/// Median and range of repeated measurements.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The median; for an even number of values, the mean of the middle two.
    pub median: f64,
    /// The smallest value.
    pub min: f64,
    /// The largest value.
    pub max: f64,
}

/// Summarises `values`. Returns `None` if there are none, and NaN throughout if one of them is NaN.
#[must_use]
pub fn summary(values: &[f64]) -> Option<Summary> {
    if values.iter().any(|value| value.is_nan()) {
        return Some(Summary { median: f64::NAN, min: f64::NAN, max: f64::NAN });
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (&min, &max) = (sorted.first()?, sorted.last()?);
    let (lower, upper) = (sorted[(sorted.len() - 1) / 2], sorted[sorted.len() / 2]);
    Some(Summary { median: f64::midpoint(lower, upper), min, max })
}

/// Peak memory use of this process so far, in MB (10⁶ bytes); `None` where the system does not report it.
#[must_use]
pub fn peak_mb() -> Option<f64> {
    peak_mb_in(&std::fs::read_to_string("/proc/self/status").ok()?)
}

/// `VmHWM` (`proc_pid_status(5)`, "kB" of 1024 bytes) in MB.
fn peak_mb_in(status: &str) -> Option<f64> {
    let kibibytes = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?.trim().strip_suffix("kB")?;
    Some(kibibytes.trim().parse::<f64>().ok()? * 1024.0 / 1e6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_summary_has_the_middle_and_the_ends() {
        assert_eq!(summary(&[3.0, 1.0, 2.0]), Some(Summary { median: 2.0, min: 1.0, max: 3.0 }));
        assert_eq!(summary(&[4.0, 1.0, 2.0, 8.0]), Some(Summary { median: 3.0, min: 1.0, max: 8.0 }));
        assert_eq!(summary(&[]), None);
        assert!(summary(&[1.0, f64::NAN]).is_some_and(|found| found.median.is_nan() && found.max.is_nan()));
    }

    #[test]
    fn the_cpu_clock_counts_all_threads() {
        let watch = Stopwatch::start();
        let spin = || while watch.read().cpu_ms < 20.0 {};
        std::thread::scope(|scope| {
            scope.spawn(spin);
        });
        // This thread only waited, so the other thread used the counted time.
        let found = watch.read();
        assert!(found.cpu_ms >= 20.0, "{found:?}");
        assert!(found.wall_ms > 0.0, "{found:?}");
    }

    #[test]
    fn peak_memory_is_read_in_units_of_1024_bytes() {
        assert_eq!(peak_mb_in("VmPeak:\t  9 kB\nVmHWM:\t  125000 kB\nThreads: 1\n"), Some(128.0));
        assert_eq!(peak_mb_in("Threads: 1\n"), None);
    }
}
