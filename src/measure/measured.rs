//! A measured setting: its times, errors and their causes.

use std::time::Duration;

use glam::DVec3;
use serde::Serialize;

use super::clock::{Summary, Timing, summary};
use super::difference::Difference;
use super::ladder::Cause;
use super::setting::Setting;
use relume_scene::Level;
use relume_scene::plan::Integrate;

/// Time of repeated work.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Cost {
    /// Wall time, in ms.
    pub wall_ms: Summary,
    /// CPU time of all threads of this process, in ms.
    pub cpu_ms: Summary,
    /// Time by the device's own clock, in ms; `None` if it has none or the work consists of no device commands.
    pub device_ms: Option<Summary>,
}

/// Times of a run: on the host, and by the device's own clock.
pub(super) type Run = (Timing, Option<Duration>);

impl Cost {
    /// Summarises `runs`; zeros if there are none.
    pub(super) fn of(runs: &[Run]) -> Self {
        let over = |times: Vec<f64>| summary(&times);
        let nothing = Summary { median: 0.0, min: 0.0, max: 0.0 };
        let device: Option<Vec<f64>> = runs.iter().map(|(_, took)| Some(took.as_ref()?.as_secs_f64() * 1e3)).collect();
        Self {
            wall_ms: over(runs.iter().map(|(time, _)| time.wall_ms).collect()).unwrap_or(nothing),
            cpu_ms: over(runs.iter().map(|(time, _)| time.cpu_ms).collect()).unwrap_or(nothing),
            device_ms: device.and_then(over),
        }
    }
}

/// Times of a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Times {
    /// Number of timed frames.
    pub runs: usize,
    /// Upload of the volume to the device; done once.
    pub upload: Cost,
    /// Tables and march of a frame.
    pub march: Cost,
    /// Relight from accumulators to 8-bit sRGB.
    pub relight: Cost,
    /// Read-back of the 8-bit picture from the device.
    pub read_back: Cost,
    /// Enlargement of the picture to the displayed size, on the CPU; `None` if all pixels are marched.
    pub enlarge: Option<Cost>,
}

/// Measurements of a setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// The setting.
    pub setting: Setting,
    /// The level of the volume that is marched, with its reason; `None` if the setting asks for none.
    pub level: Option<Level>,
    /// Integration along a ray.
    pub integration: Integrate,
    /// Whether `integration = "auto"` took another one than for the setting of the scene.
    pub other_integration: bool,
    /// Representation of spectra, in words.
    pub carrier: String,
    /// Components per pixel and light position.
    pub components: usize,
    /// Times.
    pub times: Times,
    /// Wall time of a frame in ms: sum of the medians of march, relight and enlargement.
    pub frame_ms: f64,
    /// Dispatches of a march.
    pub dispatches: usize,
    /// Bytes of a finished pixel.
    pub pixel_bytes: u64,
    /// Bytes of the volume on the device.
    pub volume_bytes: u64,
    /// Bytes of the volume, the tables and the picture during a march.
    pub total_bytes: u64,
    /// Difference from the truth.
    pub error: Difference,
    /// Differences between rungs, by cause. Their ΔE00 need not add up to that of [`Self::error`].
    pub causes: Vec<(Cause, Difference)>,
    /// p in error ∝ Δsᵖ, from the mean ΔE00 of full spectra at Δs and Δs/2; `None` if there is no error.
    pub order: Option<f64>,
    /// Whether the setting is Pareto-optimal among the measured ones ([`super::mark_pareto`]).
    pub pareto: bool,
    /// ΔE00 between rungs in the pixel of the largest error.
    #[serde(skip)]
    pub worst_by: Vec<(Cause, f64)>,
    /// ΔE00 of each pixel of [`Survey::pixels`](super::Survey::pixels).
    #[serde(skip)]
    pub differences: Vec<f64>,
    /// XYZ of each of these pixels on the device.
    #[serde(skip)]
    pub colours: Vec<DVec3>,
}

/// A square part of a picture, row by row.
#[derive(Clone, Debug)]
pub struct CloseUp {
    /// Pixels across and down.
    pub side: usize,
    /// Its first pixel in the picture, x and y from the top left.
    pub first: [usize; 2],
    /// True XYZ.
    pub truth: Vec<DVec3>,
    /// XYZ on the device.
    pub shown: Vec<DVec3>,
    /// ΔE00 between the two.
    pub differences: Vec<f64>,
    /// XYZ of the whole picture on the device.
    pub whole: Vec<DVec3>,
}

/// Timed frames of a setting.
#[derive(Default)]
pub(super) struct Frames {
    pub(super) marches: Vec<Run>,
    pub(super) relights: Vec<Run>,
    pub(super) read_backs: Vec<Run>,
    /// Empty if all pixels are marched.
    pub(super) enlarges: Vec<Run>,
    pub(super) dispatches: usize,
}

impl Frames {
    /// Summarises the times, together with those of `upload`.
    pub(super) fn times(&self, upload: Cost) -> Times {
        let [march, relight, read_back] = [&self.marches, &self.relights, &self.read_backs].map(|runs| Cost::of(runs));
        let enlarge = (!self.enlarges.is_empty()).then(|| Cost::of(&self.enlarges));
        Times { runs: self.marches.len(), upload, march, relight, read_back, enlarge }
    }
}

impl Times {
    /// Median wall time of a frame: march, relight and enlargement.
    pub(super) fn frame_ms(&self) -> f64 {
        [Some(self.march), Some(self.relight), self.enlarge].into_iter().flatten().map(|cost| cost.wall_ms.median).sum()
    }
}
