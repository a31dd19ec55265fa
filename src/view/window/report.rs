//! What a session was like, for `--json`.

use crate::measure::Choice;
use crate::number::{count, whole};
use crate::view::effort::Measured;
use crate::view::engine::Counts;

/// What a session was like.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Report {
    /// The device's name.
    pub device: String,
    /// Pixels of the picture, at the end.
    pub size: [usize; 2],
    /// Frames drawn.
    pub frames: u64,
    /// Marches, dispatches and relights, of all that was opened.
    #[serde(flatten)]
    pub counts: Counts,
    /// The counts at each `settle` of the script.
    pub settled: Vec<Counts>,
    /// Settings that were chosen by what was measured.
    pub choices: Vec<Choice>,
    /// What was measured of settings, at the end.
    pub curve: Vec<Measured>,
    /// The largest ΔE00 of a cell of each palette that was solved, from what was asked.
    pub solved: Vec<f64>,
    /// What `probe` of the script has found.
    pub probes: Vec<serde_json::Value>,
    /// From the start to the first picture.
    pub first_picture_ms: Option<f64>,
    /// From each change of what is marched to a picture of it, of the last 10,000.
    pub coarse_ms: Vec<f64>,
    /// From each to the finest picture, where nothing came between, of the last 10,000.
    pub finest_ms: Vec<f64>,
    /// Frames by how long they took, the longest of them last: median, 95th of a hundred, longest. Of more than 65,536 frames,
    /// the first two are of a part of them, evenly chosen.
    pub frame_ms: [f64; 3],
    /// The same of frames that showed another light, where nothing was marched since the last one.
    pub relit_ms: [f64; 3],
    /// The longest slice of a march.
    pub longest_step_ms: f64,
    /// The longest that nobody was heard after the first picture was there: during a frame, or a slice of a march.
    pub stall_ms: f64,
    /// How often the device was lost, and opened again.
    pub losses: u64,
    /// What was told last.
    pub notices: Vec<String>,
    /// What could not be opened, saved or done: all of it, or the last 10,000.
    pub failures: Vec<String>,
    /// What the validation layer has said.
    pub validation: Vec<String>,
}

/// Frame times that are kept.
const MOST_TIMES: usize = 1 << 16;

/// Of what is told one by one, so much is kept.
pub(super) const MOST_TOLD: usize = 10_000;

/// How long frames took. A window may be open for days: of more frames than are kept, every second is let go, again and again.
#[derive(Default)]
pub(super) struct Times {
    kept: Vec<f64>,
    /// How often half of them were let go.
    halved: u32,
    count: u64,
    last: f64,
    longest: f64,
}

impl Times {
    /// One frame more.
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

    /// How long the last one took; 0 of none.
    pub(super) fn last(&self) -> f64 {
        self.last
    }

    /// Median, 95th of a hundred and longest; zeros of none.
    pub(super) fn spread(mut self) -> [f64; 3] {
        self.kept.sort_by(f64::total_cmp);
        let at = |part: f64| self.kept.get(whole(part * count(self.kept.len().saturating_sub(1)))).copied();
        let [median, most] = [0.5, 0.95].map(|part| at(part).unwrap_or_default());
        [median, most, self.longest]
    }
}

/// Keeps `new` after `all`, and of too many the last.
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
