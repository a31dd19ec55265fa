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
    /// From each change of what is marched to a picture of it.
    pub coarse_ms: Vec<f64>,
    /// From each to the finest picture, where nothing came between.
    pub finest_ms: Vec<f64>,
    /// Frames by how long they took, the longest of them last: median, 95th of a hundred, longest.
    pub frame_ms: [f64; 3],
    /// The same of frames that showed another light and marched nothing.
    pub relit_ms: [f64; 3],
    /// The longest call into the engine.
    pub longest_step_ms: f64,
    /// The longest that nobody was heard after the first picture was there: from a frame's begin to its end.
    pub stall_ms: f64,
    /// How often the device was lost, and opened again.
    pub losses: u64,
    /// What was told last.
    pub notices: Vec<String>,
    /// What could not be opened, saved or done, all of it.
    pub failures: Vec<String>,
    /// What the validation layer has said.
    pub validation: Vec<String>,
}

/// Median, 95th of a hundred and longest of times; zeros of none.
pub(super) fn spread(times: &mut [f64]) -> [f64; 3] {
    times.sort_by(f64::total_cmp);
    let at = |part: f64| times.get(whole(part * count(times.len().saturating_sub(1)))).copied();
    [0.5, 0.95, 1.0].map(|part| at(part).unwrap_or_default())
}
