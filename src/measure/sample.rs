//! Random samples of the visible pixels, and the error of a picture in them.

use glam::DVec3;

use super::clock::{Limit, Stopwatch};
use super::difference::Difference;
use super::ladder::{Ladder, LadderError};
use relume_base::number::{count, whole};
use relume_base::progress::Progress;
use relume_colour::model::random::Random;
use relume_scene::{Mix, Scene};

/// Pixels examined in each round of drawing.
const ROUND: usize = 4096;
/// The same, if the time is limited.
const SHORT_ROUND: usize = 512;

/// Random pixels in which errors are measured at least: the bound of the p95 of 256 is about the fourth largest error.
pub(super) const LEAST_PIXELS: usize = 256;

/// A random sample of the visible pixels.
pub(super) struct Drawn<'a> {
    /// Ladder of the drawn pixels.
    pub(super) ladder: Ladder<'a>,
    /// Estimated number of visible pixels in the whole picture.
    pub(super) showing: usize,
}

/// Draws up to `most` visible pixels of a picture of `size` under `mix` with `seed`, and creates their ladder. If
/// there are fewer, draws them all; if `limit` is over, those that are found, but [`LEAST_PIXELS`]. The truth of the ladder has the scattered
/// light of `scene`.
pub(super) fn drawn<'a>(
    scene: &'a Scene,
    mix: &Mix,
    size: [usize; 2],
    most: usize,
    (seed, limit): (u64, Limit),
    progress: &dyn Progress,
) -> Result<Drawn<'a>, LadderError> {
    let (clock, round) = (Stopwatch::start(), if limit.0.is_finite() { SHORT_ROUND } else { ROUND });
    let mut random = Random::new(seed);
    let pixels = size[0] * size[1];
    let mut left: Vec<[usize; 2]> = (0..pixels).map(|i| [i % size[0], i / size[0]]).collect();
    let mut found: Vec<[usize; 2]> = Vec::new();
    let mut ladder =
        Ladder::new(scene, mix.clone(), size, &[], (scene.accuracy.step_length, scene.accuracy.rays), progress)?;
    ladder.stated_scattering = true;
    let is_over = |found: usize| found >= LEAST_PIXELS && clock.read().wall_ms >= limit.0;
    while found.len() < most && !left.is_empty() && !is_over(found.len()) {
        let round: Vec<[usize; 2]> =
            (0..round.min(left.len())).map(|_| left.swap_remove(random.index(left.len()))).collect();
        found.extend(ladder.showing(&round, progress)?);
    }
    let showing = whole(count(found.len()) * count(pixels) / count(pixels - left.len()).max(1.0));
    found.truncate(most);
    ladder.pixels = found;
    ladder.expose(progress)?;
    Ok(Drawn { ladder, showing })
}

/// Upper bound of the p95 of `all` pixels, given the `errors` of a random sample of them. It is larger than the p95 of
/// the sample, so that it holds in 99 of 100 draws for any distribution of errors. If the sample is complete, it is
/// the p95 of the sample.
///
/// The number of drawn errors above the p95 of all pixels is hypergeometric, here approximated by a normal
/// distribution.
pub(super) fn p95_of_all(errors: &[f64], all: usize) -> f64 {
    /// Number of standard deviations that a normal variable exceeds once in 100 times.
    const DEVIATIONS: f64 = 2.326;
    let mut sorted: Vec<f64> = errors.iter().map(|&error| if error.is_nan() { f64::INFINITY } else { error }).collect();
    sorted.sort_by(f64::total_cmp);
    let drawn = count(sorted.len());
    let left = (1.0 - drawn / count(all)).max(0.0);
    let deviation = (drawn * 0.95 * 0.05 * left).sqrt();
    let rank = whole(0.95f64.mul_add(drawn, DEVIATIONS * deviation).ceil()).clamp(1, sorted.len().max(1));
    sorted.get(rank - 1).copied().unwrap_or_default()
}

/// [`check_within`] without a limit.
///
/// # Errors
///
/// [`LadderError`].
pub fn check(
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    rgba: &[f32],
    progress: &dyn Progress,
) -> Result<Option<Checked>, LadderError> {
    check_within(scene, mix, size, rgba, Limit::NONE, progress)
}

/// Measures the error of a finished picture, to check a `--max-error`. `rgba` is linear RGBA of `size` under `mix`.
/// The truth has steps of an eighth of those of `scene`. Compares 4096 random visible pixels, or all if there are
/// fewer, or 256 and as many more as `limit` gives time for. Returns `None` if no pixel shows the volume.
///
/// # Errors
///
/// [`LadderError`].
pub fn check_within(
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    rgba: &[f32],
    limit: Limit,
    progress: &dyn Progress,
) -> Result<Option<Checked>, LadderError> {
    const PIXELS: usize = 4096;
    /// Differs from the seed of a choice, so that other pixels are drawn.
    const SEED: u64 = 77;
    let Drawn { mut ladder, .. } = drawn(scene, mix, size, PIXELS, (SEED, Limit(0.4 * limit.0)), progress)?;
    let truth = ladder.truth_within(&ladder.pixels, (Limit(0.6 * limit.0), LEAST_PIXELS), progress)?;
    ladder.pixels.truncate(truth.len());
    let shown: Vec<DVec3> = ladder
        .pixels
        .iter()
        .map(|[x, y]| {
            let first = 4 * (x + size[0] * y);
            let part = |channel: usize| rgba.get(first + channel).copied().map_or(f64::NAN, f64::from);
            *relume_colour::spectrum::colour::XYZ_FROM_LINEAR_SRGB * DVec3::new(part(0), part(1), part(2))
        })
        .collect();
    let difference = Difference::between(&shown, &truth, &ladder.pixels);
    Ok((!truth.is_empty()).then_some(Checked { pixels: truth.len(), difference }))
}

/// Result of [`check`].
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Checked {
    /// Number of compared pixels.
    pub pixels: usize,
    /// Their difference from the truth.
    pub difference: Difference,
}

impl Checked {
    /// The result in words: `asked 0.5, measured 0.31`, and the largest error.
    #[must_use]
    pub fn sentence(&self, asked: Option<f64>) -> String {
        let error = &self.difference.delta_e;
        let asked = asked.map_or_else(String::new, |asked| format!("asked {asked}, "));
        let pixels = self.pixels;
        format!(
            "{asked}measured ΔE00 {:.2} in the finished picture (95th percentile of {pixels} other random pixels; maximum {:.2})",
            error.p95, error.max
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_pixels_keep_what_they_keep_and_a_draw_says_a_little_more() {
        let errors: Vec<f64> = (1..=2000).map(f64::from).collect();
        assert_eq!(p95_of_all(&errors, 2000).total_cmp(&1900.0), std::cmp::Ordering::Equal);
        // 2.326·√(2000·0.95·0.05) = 22.67; times √½ if half of all pixels are drawn.
        assert_eq!(p95_of_all(&errors, usize::MAX).total_cmp(&1923.0), std::cmp::Ordering::Equal);
        assert_eq!(p95_of_all(&errors, 4000).total_cmp(&1917.0), std::cmp::Ordering::Equal);
        assert!(p95_of_all(&[1.0, f64::NAN], 2).is_infinite());
        assert_eq!(p95_of_all(&[], 0).total_cmp(&0.0), std::cmp::Ordering::Equal);
    }

    /// Draws from errors with a known p95.
    #[test]
    fn in_99_of_100_draws_95_of_100_keep_what_it_says() {
        let (mut random, all) = (Random::new(5), 6000);
        let (mut short, draws) = (0, 2000);
        for _ in 0..draws {
            let mut left: Vec<usize> = (1..=all).collect();
            let drawn: Vec<f64> = (0..500).map(|_| count(left.swap_remove(random.index(left.len())))).collect();
            short += usize::from(p95_of_all(&drawn, all) < 0.95 * count(all));
        }
        // Twenty are expected; three standard deviations more are 34.
        assert!(short <= 34, "{short} of {draws}");
    }
}
