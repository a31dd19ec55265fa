//! Pixels drawn at random among those that show anything, and how far a picture is from the truth there.

use glam::DVec3;

use super::difference::Difference;
use super::ladder::{Ladder, LadderError};
use crate::model::random::Random;
use crate::progress::Progress;
use crate::scene::{Mix, Scene};

/// Pixels that are looked at in each round of drawing.
const ROUND: usize = 4096;

/// A ladder of up to `most` of the pixels of a picture of `size` under `mix` that show anything, drawn by `seed`; all of them where
/// there are fewer.
pub(super) fn drawn<'a>(
    scene: &'a Scene,
    mix: &Mix,
    size: [usize; 2],
    most: usize,
    seed: u64,
    progress: &dyn Progress,
) -> Result<Ladder<'a>, LadderError> {
    let mut random = Random::new(seed);
    let mut left: Vec<[usize; 2]> = (0..size[0] * size[1]).map(|i| [i % size[0], i / size[0]]).collect();
    let mut found: Vec<[usize; 2]> = Vec::new();
    let mut ladder = Ladder::new(scene, mix.clone(), size, &[], scene.accuracy.step_length, progress)?;
    while found.len() < most && !left.is_empty() {
        let round: Vec<[usize; 2]> =
            (0..ROUND.min(left.len())).map(|_| left.swap_remove(random.index(left.len()))).collect();
        found.extend(ladder.showing(&round, progress)?);
    }
    found.truncate(most);
    ladder.pixels = found;
    Ok(ladder)
}

/// How far linear RGBA of a picture of `size` under `mix` is from the truth, whose steps are an eighth of those of `scene`, in 4096
/// pixels or more drawn at random among those that show anything, or in all of them: how the promise of a `--max-error` is
/// kept. `None` where nothing is shown.
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
    const PIXELS: usize = 4096;
    /// Other pixels than a choice is made by.
    const SEED: u64 = 77;
    let ladder = drawn(scene, mix, size, PIXELS, SEED, progress)?;
    let truth = ladder.truth_in(&ladder.pixels, progress)?;
    let shown: Vec<DVec3> = ladder
        .pixels
        .iter()
        .map(|[x, y]| {
            let first = 4 * (x + size[0] * y);
            let part = |channel: usize| rgba.get(first + channel).copied().map_or(f64::NAN, f64::from);
            *crate::spectrum::colour::XYZ_FROM_LINEAR_SRGB * DVec3::new(part(0), part(1), part(2))
        })
        .collect();
    let difference = Difference::between(&shown, &truth, &ladder.pixels);
    Ok((!truth.is_empty()).then_some(Checked { pixels: truth.len(), difference }))
}

/// What [`check`] found.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Checked {
    /// How many pixels were looked at.
    pub pixels: usize,
    /// How far they are from the truth.
    pub difference: Difference,
}

impl Checked {
    /// `asked 0.5, measured 0.31`, and the worst.
    #[must_use]
    pub fn sentence(&self, asked: Option<f64>) -> String {
        let error = &self.difference.delta_e;
        let asked = asked.map_or_else(String::new, |asked| format!("asked {asked}, "));
        let pixels = self.pixels;
        format!("{asked}measured {:.2}: p95 of ΔE00 over {pixels} random pixels; at most {:.2}", error.p95, error.max)
    }
}
