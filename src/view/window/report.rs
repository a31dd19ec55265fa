//! Report of a session, for `--json`.

use crate::measure::Choice;
use crate::number::{count, whole};
use crate::render::BrickCounts;
use crate::view::effort::Measured;
use crate::view::engine::Counts;
use crate::volume::CacheCounts;

/// Report of a session.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Report {
    /// Device name.
    pub device: String,
    /// Pixels of the picture at the end, across and down.
    pub size: [usize; 2],
    /// Number of frames.
    pub frames: u64,
    /// Marches, dispatches and relights of all scenes.
    #[serde(flatten)]
    pub counts: Counts,
    /// Counts at each `settle` of the script.
    pub settled: Vec<Counts>,
    /// Coarse level of the volume that the picture shows at the end: its number, and the voxels whose mean is one of it.
    pub volume_level: Option<serde_json::Value>,
    /// Voxels whose mean is one of the coarse level that the shadows of a volume in bricks come from.
    pub light_block: Option<[usize; 3]>,
    /// Bricks of the last march of all voxels, of a volume in bricks.
    pub bricks: Option<BrickCounts>,
    /// Bricks read from a file, if voxels stay in one.
    pub host_bricks: Option<CacheCounts>,
    /// Settings chosen by measurements.
    pub choices: Vec<Choice>,
    /// Measured settings at the end.
    pub curve: Vec<Measured>,
    /// Largest ΔE00 of each solved palette from its target colours.
    pub solved: Vec<f64>,
    /// Slices at the end, if they are visible: crosshair in voxel indices, value there, and window.
    pub slices: Option<serde_json::Value>,
    /// Ends of the measuring line in world units, and its length if it has both.
    pub ruler: serde_json::Value,
    /// Results of the script's `probe` commands.
    pub probes: Vec<serde_json::Value>,
    /// Time from the start to the first picture.
    pub first_picture_ms: Option<f64>,
    /// Time from each change that needs a march to the first picture of it; the last 10,000.
    pub coarse_ms: Vec<f64>,
    /// Time from each of these changes to the finest picture, unless interrupted; the last 10,000.
    pub finest_ms: Vec<f64>,
    /// Frame durations: median, 95th percentile, maximum. With more than 65,536 frames, the first two come from an
    /// evenly
    /// chosen subset.
    pub frame_ms: [f64; 3],
    /// The same for frames that relit without a dispatch since the previous frame.
    pub relit_ms: [f64; 3],
    /// Longest slice of a march.
    pub longest_step_ms: f64,
    /// Longest time without input handling after the first picture: a frame or a march slice.
    pub stall_ms: f64,
    /// Number of device losses.
    pub losses: u64,
    /// Last notices.
    pub notices: Vec<String>,
    /// Failures to open, save or do something; the last 10,000.
    pub failures: Vec<String>,
    /// Messages of the validation layer.
    pub validation: Vec<String>,
}

/// Counts and times for the report.
#[derive(Default)]
pub(super) struct Record {
    pub(super) report: Report,
    /// Durations of frames.
    pub(super) drawn: Times,
    /// Durations of frames that only relit.
    pub(super) relit: Times,
    /// Counts before the last frame.
    pub(super) counted: Counts,
    /// Counts of previous engines.
    pub(super) before: Counts,
}

/// Largest number of frame durations kept.
const MOST_TIMES: usize = 1 << 16;

/// Largest number of entries of each list.
pub(super) const MOST_TOLD: usize = 10_000;

/// Frame durations. When the storage is full, which may take days, every second entry is dropped, repeatedly.
#[derive(Default)]
pub(super) struct Times {
    kept: Vec<f64>,
    /// Number of times that entries were dropped.
    halved: u32,
    count: u64,
    last: f64,
    longest: f64,
}

impl Times {
    /// Adds a frame.
    pub(super) fn add(&mut self, time: f64) {
        if self.count.trailing_zeros() >= self.halved {
            if self.kept.len() == MOST_TIMES {
                let mut stays = false;
                self.kept.retain(|_| {
                    stays = !stays;
                    stays
                });
                self.halved += 1;
            }
            self.kept.push(time);
        }
        self.count += 1;
        (self.last, self.longest) = (time, self.longest.max(time));
    }

    /// Duration of the last frame; 0 without frames.
    pub(super) fn last(&self) -> f64 {
        self.last
    }

    /// Median, 95th percentile and maximum; zeros without frames.
    pub(super) fn spread(mut self) -> [f64; 3] {
        self.kept.sort_by(f64::total_cmp);
        let at = |part: f64| self.kept.get(whole(part * count(self.kept.len().saturating_sub(1)))).copied();
        let [median, most] = [0.5, 0.95].map(|part| at(part).unwrap_or_default());
        [median, most, self.longest]
    }
}

/// Appends `new` to `all`, which keeps its last entries.
pub(super) fn keep<T>(all: &mut Vec<T>, new: T) {
    if all.len() >= MOST_TOLD {
        all.remove(0);
    }
    all.push(new);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_few_frames_every_time_counts() {
        let none = Times::default();
        assert_eq!((none.last(), none.spread()), (0.0, [0.0; 3]));
        let mut times = Times::default();
        [7.0, 1.0, 3.0, 9.0, 5.0].into_iter().for_each(|time| times.add(time));
        assert_eq!((times.last(), times.spread()), (5.0, [5.0, 7.0, 9.0]));
    }

    #[test]
    fn days_of_frames_take_no_more_memory_than_minutes() {
        let mut times = Times::default();
        let frames: u32 = 5_000_000;
        for frame in 0..frames {
            times.add(if frame == 77_777 { 1e9 } else { f64::from(frame) });
            assert!(times.kept.len() <= MOST_TIMES, "frame {frame}");
        }
        assert!(times.kept.capacity() <= MOST_TIMES && times.kept.len() > MOST_TIMES / 2);
        let (last, [median, most, longest]) = (times.last(), times.spread());
        for (told, part) in [(median, 0.5), (most, 0.95)] {
            let exact = part * f64::from(frames);
            assert!((told - exact).abs() < 1e-4 * f64::from(frames), "{part}: {told}, not {exact}");
        }
        assert_eq!((last, longest), (f64::from(frames - 1), 1e9), "the longest is of all of them");
    }

    #[test]
    fn of_what_is_told_again_and_again_the_last_is_kept() {
        let mut all = Vec::new();
        (0..3 * MOST_TOLD).for_each(|new| keep(&mut all, new));
        assert_eq!(
            (all.len(), all.first(), all.last()),
            (MOST_TOLD, Some(&(2 * MOST_TOLD)), Some(&(3 * MOST_TOLD - 1)))
        );
    }
}
