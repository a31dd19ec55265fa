//! Schedule of a march: bands of rows and slices of rays, each a dispatch of about the target duration.

use std::time::Duration;

use bytemuck::{Pod, Zeroable};

use super::dispatching::{Dispatching, SLICE};
use super::rounds::Round;
use relume_base::number::{count, unsigned, whole};
use relume_scene::plan::{Integrate, MOST_PARTS};
use relume_vulkan::DeviceKind;
use relume_vulkan::shader::Iterations;

/// Target duration of a dispatch: short for responses to user input, and for the device's watchdog.
const DISPATCH: Duration = Duration::from_millis(50);
/// Samples in the first dispatch of a march of unknown speed.
const FIRST_SAMPLES: f64 = 2e7;
/// Fraction of a march's time that counts as its slow part; an occasional delay of a dispatch takes less.
const SLOW: f64 = 0.1;
/// Smallest fraction of the target duration at which a dispatch measures the device's speed.
const TELLING: f64 = 0.15;
/// Largest dispatch, as a multiple of the samples that fit into the target duration in the slow part of the march.
const BOLDNESS: f64 = 1.5;
/// The same after a march of a picture of another size.
const BOLDNESS_ELSEWHERE: f64 = 4.0;
/// Smallest number of samples along a ray per dispatch; with fewer, the start of a ray would take longer.
const SHORTEST_SLICE: u32 = 16;
/// Largest number of iterations of all loops of an invocation; some devices stop it, silently, at 65,535.
const ITERATIONS: usize = 65_000;

/// Push constants of a dispatch, in the layout of `shaders/march.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Band {
    pub(super) first_row: u32,
    pub(super) first_sample: u32,
    pub(super) end_sample: u32,
    /// The ray in its pixel.
    place: RayPlace,
}

/// A ray in its pixel.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct RayPlace {
    /// From 0 to 1 across and down.
    pub(super) place: [f32; 2],
    /// Its phase, in 2⁻³² of a step.
    pub(super) phase: u32,
}

/// Target duration of a dispatch, and how many samples fit into it, as far as is known.
#[derive(Clone, Copy, Debug)]
pub struct Speed {
    dispatch: Duration,
    /// Samples of the first dispatch, if known.
    first: Option<f64>,
    /// Largest number of samples of any dispatch: fast rows in empty space may precede slow rows in the volume.
    most: f64,
}

impl Speed {
    /// Speed of an unknown device of this kind, for dispatches of about `dispatch`.
    pub(crate) fn unknown(dispatch: Duration, kind: DeviceKind) -> Self {
        // Few enough samples for a slow device.
        let first = FIRST_SAMPLES / 32.0;
        // The speed of a software device in empty space does not predict its speed elsewhere; other devices adapt.
        let most = if kind == DeviceKind::Software { first } else { f64::INFINITY };
        Self { dispatch, first: Some(first), most }
    }

    /// The speed to assume for pictures of another size.
    #[must_use]
    pub fn elsewhere(self) -> Self {
        Self { most: self.most * BOLDNESS_ELSEWHERE / BOLDNESS, ..self }
    }
}

impl Default for Speed {
    fn default() -> Self {
        Self { dispatch: DISPATCH, first: None, most: f64::INFINITY }
    }
}

/// Largest number of samples along a ray per dispatch of a march with these `iterations`. Each loop along the ray, over
/// macrocells, samples and visible samples, goes on by at least one sample a turn, or by a part of one in segments.
pub(super) fn longest_slice(iterations: Iterations, integration: Integrate) -> u32 {
    let turns = match integration {
        Integrate::Samples => 1,
        // The most parts, and the segment as a whole.
        Integrate::Segments => 1 + whole(f64::from(MOST_PARTS)),
        // Three parts, and two samples before the first of a run.
        Integrate::Refined => 5,
    };
    let per_sample = (turns * iterations.per_turn).max(1);
    unsigned(ITERATIONS.saturating_sub(iterations.once) / per_sample).clamp(1, SLICE)
}

/// Divides a march into dispatches: rows of the picture, and slices of long rays. A dispatch has the samples that fit
/// into `dispatch` at the speed of the last one, but little more than fit in the slow part of the march, because fast
/// rows in empty space may precede slow rows in the volume.
#[derive(Debug)]
pub(super) struct Schedule {
    pub(super) dispatching: Dispatching,
    dispatch: Duration,
    pub(super) size: [u32; 2],
    samples: u32,
    pub(super) row: u32,
    rows: u32,
    sample: u32,
    /// End of the rows, and first sample, of the present rays.
    end_row: u32,
    first_sample: u32,
    slice: u32,
    /// The present rays in their pixels.
    place: RayPlace,
    /// Target number of samples of the next dispatch.
    budget: f64,
    /// Approximate largest number of samples of any dispatch, from an earlier march.
    most: f64,
    /// Samples of the current dispatch.
    pub(super) taken: f64,
    /// For each dispatch that was long enough to measure: the samples that would have fitted, and its seconds; the
    /// smallest number of samples first. A shorter dispatch only measures the time to start one.
    timed: Vec<[f64; 2]>,
    /// Samples of the largest dispatch among the shorter ones.
    untimed: f64,
}

impl Schedule {
    pub(super) fn new(size: [u32; 2], samples: u32, dispatching: Dispatching, layers: usize, speed: Speed) -> Self {
        let unknown = || speed.first.unwrap_or(FIRST_SAMPLES / count(layers.max(1)));
        let budget = dispatching.samples.map_or_else(unknown, f64::from);
        let Speed { dispatch, most, .. } = speed;
        Self {
            dispatching,
            dispatch,
            size,
            samples,
            row: 0,
            rows: 0,
            sample: 0,
            end_row: size[1],
            first_sample: 0,
            slice: 0,
            place: RayPlace { place: [0.5; 2], phase: 0 },
            budget,
            most,
            taken: 0.0,
            timed: Vec::new(),
            untimed: 0.0,
        }
    }

    /// Begins with the rays through `place` of each pixel, at the speed measured so far.
    pub(super) fn begin_rays(&mut self, place: RayPlace) {
        self.place = place;
        self.begin_round(Round { first_row: 0, end_row: self.size[1], first_sample: 0 });
    }

    /// Begins with the samples of the present rays that wait for bricks.
    pub(super) fn begin_round(&mut self, Round { first_row, end_row, first_sample }: Round) {
        let group = self.dispatching.group[1];
        // Whole workgroups, as in the round before.
        self.row = first_row / group * group;
        self.end_row = end_row.min(self.size[1]);
        (self.sample, self.first_sample) = (first_sample, first_sample);
    }

    /// Number of samples that fit in the slow part of the march, if known. Ignores the slowest dispatch, whose delay
    /// may have another cause.
    fn slow(&self) -> Option<f64> {
        let most = 2.0 * self.dispatch.as_secs_f64();
        let timed = self.timed.get(1..)?;
        let mut left = SLOW * timed.iter().map(|[_, seconds]| seconds.min(most)).sum::<f64>();
        let slow = timed.iter().find(|[_, seconds]| {
            left -= seconds.min(most);
            left <= 0.0
        });
        slow.map(|[fitting, _]| *fitting)
    }

    /// Speed measured so far.
    pub(super) fn speed(&self) -> Speed {
        let dispatch = self.dispatch;
        let most = match (self.slow(), self.timed.first()) {
            (Some(slow), _) => BOLDNESS * slow,
            // The only measurement.
            (None, Some([fitting, _])) => BOLDNESS * fitting,
            (None, None) => self.most.max(BOLDNESS_ELSEWHERE * self.untimed),
        };
        Speed { dispatch, first: Some(self.budget.min(most)), most }
    }

    pub(super) fn is_done(&self) -> bool {
        self.row >= self.end_row
    }

    /// Returns the next dispatch and its rows; `None` at the end of the march.
    pub(super) fn next(&mut self) -> Option<(Band, u32)> {
        if self.is_done() {
            return None;
        }
        if self.sample == self.first_sample {
            // Whole rays if a row of workgroups fits, otherwise equal parts of rays.
            let width = f64::from(self.size[0]);
            let Dispatching { group, slice: longest, .. } = self.dispatching;
            let groups = self.budget / (width * f64::from(group[1]) * f64::from(self.samples.min(longest)));
            // A stated number of samples is a limit; otherwise rounds to the nearest.
            let is_limit = self.dispatching.samples.is_some();
            let fewer = |number: f64| if is_limit { number.floor() } else { number.round() };
            let more = |number: f64| if is_limit { number.ceil() } else { number.round() };
            self.rows = group[1] * unsigned(whole(fewer(groups))).clamp(1, self.size[1]);
            let parts = width * f64::from(self.rows) * f64::from(self.samples) / self.budget;
            let parts = unsigned(whole(more(parts))).max(1);
            self.slice = self.samples.div_ceil(parts).clamp(longest.min(SHORTEST_SLICE), longest);
        }
        let end_sample = self.sample.saturating_add(self.slice);
        let band = Band { first_row: self.row, first_sample: self.sample, end_sample, place: self.place };
        let rows = self.rows.min(self.end_row - self.row);
        self.taken = f64::from(self.size[0]) * f64::from(rows) * f64::from(self.slice.min(self.samples.max(1)));
        if end_sample >= self.samples {
            self.row += rows;
            self.sample = self.first_sample;
        } else {
            self.sample = end_sample;
        }
        Some((band, rows))
    }

    /// Records the duration of the last dispatch.
    pub(super) fn took(&mut self, time: Duration) {
        if self.dispatching.samples.is_some() {
            return;
        }
        let (seconds, aim) = (time.as_secs_f64().max(1e-6), self.dispatch.as_secs_f64());
        let fitting = self.taken * aim / seconds;
        if seconds >= TELLING * aim {
            let place = self.timed.partition_point(|[known, _]| *known < fitting);
            self.timed.insert(place, [fitting, seconds]);
        } else {
            self.untimed = self.untimed.max(self.taken);
        }
        let most = self.most.min(self.slow().map_or(f64::INFINITY, |slow| BOLDNESS * slow));
        self.budget = fitting.clamp(self.budget / 8.0, self.budget * 8.0).min(most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dispatches of successive pictures whose middle takes twenty times as long as the rows above and below, starting
    /// on an unknown device. In each picture, the dispatch `held_up` is delayed by half a second, which the result does
    /// not contain.
    fn marched(pictures: usize, held_up: Option<usize>) -> Vec<Vec<Duration>> {
        let (size, samples, aim) = ([800_u32, 800], 300, Duration::from_millis(10));
        let seconds =
            |row: u32| 3.0e-9 * f64::from(size[0] * samples) * if (250..550).contains(&row) { 1.0 } else { 0.05 };
        let mut speed = Speed::unknown(aim, DeviceKind::Software);
        let picture = |_| {
            let mut schedule = Schedule::new(size, samples, Dispatching::default(), 1, speed);
            let mut dispatches = Vec::new();
            while let Some((band, rows)) = schedule.next() {
                let part = f64::from(band.end_sample.min(samples) - band.first_sample) / f64::from(samples);
                let took = part * (band.first_row..band.first_row + rows).map(seconds).sum::<f64>();
                let more = if held_up == Some(dispatches.len()) { 0.5 } else { 0.0 };
                schedule.took(Duration::from_secs_f64(took + more));
                dispatches.push(Duration::from_secs_f64(took));
            }
            speed = schedule.speed();
            dispatches
        };
        (0..pictures).map(picture).collect()
    }

    #[test]
    fn a_dispatch_that_enters_the_volume_takes_little_longer_than_it_may() {
        for (picture, dispatches) in marched(4, None).iter().enumerate() {
            let longest = dispatches.iter().max();
            assert!(longest < Some(&Duration::from_millis(18)), "picture {picture}: {longest:?}, not 10 ms");
            let count = dispatches.len();
            assert!(picture == 0 || count < 60, "{count} for 22 times 10 ms and what is empty");
        }
    }

    #[test]
    fn a_fast_gpu_is_known_within_its_first_march() {
        let speed = Speed::unknown(Duration::from_millis(8), DeviceKind::Discrete);
        let mut schedule = Schedule::new([1280, 800], 400, Dispatching::default(), 1, speed);
        let mut dispatches = 0;
        while schedule.next().is_some() {
            schedule.took(Duration::from_secs_f64(5.0e-5 + 1.0e-11 * schedule.taken));
            dispatches += 1;
        }
        assert!(dispatches < 12, "{dispatches} for 4 ms");
    }

    /// Dispatches of a few pixels are too short to measure a speed.
    #[test]
    fn a_picture_of_a_few_pixels_says_nothing_of_a_large_one() {
        let aim = Duration::from_millis(10);
        let dispatches = |size: [u32; 2], speed: Speed| {
            let mut schedule = Schedule::new(size, 300, Dispatching::default(), 1, speed);
            let mut dispatches = 0;
            while schedule.next().is_some() {
                schedule.took(Duration::from_secs_f64(4.0e-4 + 1.0e-9 * schedule.taken));
                dispatches += 1;
            }
            (dispatches, schedule.speed())
        };
        let mut speed = Speed::unknown(aim, DeviceKind::Software);
        for _ in 0..4 {
            speed = dispatches([20, 16], speed).1;
        }
        let ((small, _), (unknown, known)) =
            (dispatches([800, 800], speed), dispatches([800, 800], Speed::unknown(aim, DeviceKind::Software)));
        assert!(small <= unknown, "{small} dispatches, not {unknown}");
        let (_, known) = dispatches([800, 800], known);
        let (least, _) = dispatches([800, 800], known);
        assert!((18..30).contains(&least), "{least} dispatches of 10 ms for 192");
    }

    #[test]
    fn a_dispatch_that_was_held_up_does_not_cut_the_next_picture_into_crumbs() {
        let [calm, held] = [None, Some(20)].map(|held_up| marched(4, held_up).iter().map(Vec::len).collect::<Vec<_>>());
        assert!(calm.iter().all(|calm| *calm > 21), "{calm:?}: none is held up");
        assert!(held.iter().zip(&calm).skip(1).all(|(held, calm)| 4 * held <= 5 * calm), "{held:?}, not {calm:?}");
    }
}
