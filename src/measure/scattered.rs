//! Stated error of scattered light, and its settings for an error goal.

use glam::DVec3;
use serde::Serialize;

use super::candidates::voxels;
use super::clock::{Limit, Stopwatch};
use super::difference::delta_e;
use super::error::MeasureError;
use super::ladder::{Ladder, LadderError};
use super::sample::drawn;
use super::setting::{Setting, Value};
use relume_base::number::count;
use relume_base::progress::Progress;
use relume_colour::model::ErrorSummary;
use relume_scene::plan::{Planned, plan};
use relume_scene::reference::ReferenceError;
use relume_scene::{Half, Mix, Scattering, Scene};

/// Factor on both differences: light near surfaces that lie between nodes may converge more slowly than twice as fine nodes tell.
const SAFETY: f64 = 1.25;
/// Error that no difference shows, in ΔE00: of faces, and of rays that end.
const LEAST: f64 = 0.1;
/// Random pixels in which the error is stated.
const PIXELS: usize = 512;
const SEED: u64 = 57;
/// Part of the allowed error that scattered light may have.
const SHARE: f64 = 0.5;
/// The same of [`LEAST`], where the share is smaller.
const NEAR_LEAST: f64 = 1.5;
/// Half octaves by which the spacing that a search tries differs from that of the scene.
const FINEST: i32 = 4;
const COARSEST: i32 = -2;
/// Growth of the work by half an octave: nodes, and steps of each ray.
const GROWTH: f64 = 4.0;
/// Most directions that a search tries.
const MOST_DIRECTIONS: usize = 128;

/// Stated error of scattered light, as the p95 of ΔE00 (docs/theory/scattering.md).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ScatteredError {
    /// Difference from light at nodes twice as far apart.
    pub nodes: f64,
    /// Half of the difference between both halves of the directions.
    pub directions: f64,
    /// Both together, with a margin.
    pub p95: f64,
}

/// Scattered light for an error goal.
pub(super) struct ChosenLight {
    /// Its spacing and directions, if they are not those of the scene.
    pub(super) setting: Setting,
    /// Its stated error.
    pub(super) error: ScatteredError,
    /// True if time ended the search.
    pub(super) is_cut: bool,
}

/// The pixels of `scene` with this scattered light, from exact samples.
fn pixels(
    ladder: &Ladder<'_>,
    (scene, planned): (&Scene, &Planned),
    scattering: Scattering,
    progress: &dyn Progress,
) -> Result<Vec<DVec3>, LadderError> {
    let mut scene = scene.clone();
    scene.scattering = scattering;
    ladder.model(&scene, planned, progress)
}

/// The error of the pixels `found`, whose scattered light has this setting, beside those at nodes `rough`, twice as far apart.
fn stated(
    ladder: &Ladder<'_>,
    of: (&Scene, &Planned),
    (scattering, found, rough): (Scattering, &[DVec3], &[DVec3]),
    progress: &dyn Progress,
) -> Result<ScatteredError, LadderError> {
    let halves = [Half::Even, Half::Odd].map(|half| pixels(ladder, of, Scattering { half, ..scattering }, progress));
    let [even, odd] = halves;
    let nodes = delta_e(found, rough);
    let directions: Vec<f64> = delta_e(&even?, &odd?).into_iter().map(|apart| 0.5 * apart).collect();
    let both = nodes.iter().zip(&directions).map(|(nodes, directions)| SAFETY * nodes.hypot(*directions)).collect();
    let [nodes, directions, both]: [f64; 3] = [nodes, directions, both].map(|errors| ErrorSummary::of(&errors).p95);
    Ok(ScatteredError { nodes, directions, p95: both.hypot(LEAST) })
}

/// The stated error of the scattered light of `scene` under `mix` in a picture of `size`; `None` if light scatters once, or no pixel shows
/// the volume.
///
/// # Errors
///
/// [`MeasureError`].
pub fn scattered_error(
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Option<ScatteredError>, MeasureError> {
    Ok(light_within(scene, mix, size, (None, Limit::NONE), progress)?.map(|light| light.error))
}

/// The coarsest scattered light whose stated error takes no more than its share of `asked`, from twice the spacing of the scene to a quarter
/// of it; the most accurate that `limit` gives time for, if none does; that of the scene without an error goal. What the scene states stays.
/// `None` if light scatters once, or no pixel shows the volume.
pub(super) fn light_within(
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    (asked, limit): (Option<f64>, Limit),
    progress: &dyn Progress,
) -> Result<Option<ChosenLight>, MeasureError> {
    let planned = plan(scene, progress)?;
    if planned.plan.light.gathered.is_none() {
        return Ok(None);
    }
    let ladder = drawn(scene, mix, size, PIXELS, (SEED, Limit::NONE), progress)?.ladder;
    if ladder.pixels.is_empty() {
        return Ok(None);
    }
    let own = (scene, &planned);
    // No light has less than the least error.
    let asked = asked.filter(|&asked| asked > LEAST);
    let share = asked.map_or(f64::INFINITY, |asked| (SHARE * asked).max(NEAR_LEAST * LEAST));
    let spacing = |finer: i32| match finer {
        0 => scene.scattering_spacing(),
        _ => voxels(scene.scattering_spacing().log2() - 0.5 * f64::from(finer)),
    };
    let is_stated = [scene.scattering.spacing.is_some(), scene.scattering.directions.is_some()];
    let [spacing_stays, directions_stay] = is_stated.map(|is_stated| is_stated || asked.is_none());
    let mut finer = if spacing_stays { 0 } else { COARSEST };
    let mut directions = scene.scattering_directions();
    let (mut seen, mut best): (Vec<(i32, Vec<DVec3>)>, Option<ChosenLight>) = (Vec::new(), None);
    loop {
        let clock = Stopwatch::start();
        let of =
            |finer: i32| Scattering { spacing: Some(spacing(finer)), directions: Some(directions), ..scene.scattering };
        let mut make = |finer: i32| -> Result<Vec<DVec3>, LadderError> {
            if let Some((_, known)) = seen.iter().find(|(it, _)| *it == finer) {
                return Ok(known.clone());
            }
            let made = pixels(&ladder, own, of(finer), progress)?;
            seen.push((finer, made.clone()));
            Ok(made)
        };
        let rough = make(finer - 2)?;
        let found = match make(finer) {
            // The search ends where memory does.
            Err(LadderError::Reference(ReferenceError::ScatteredLight { .. })) if best.is_some() => break,
            found => found?,
        };
        let error = stated(&ladder, own, (of(finer), &found, &rough), progress)?;
        if best.as_ref().is_none_or(|best| error.p95 < best.error.p95) {
            let mut setting = Setting::default();
            if !spacing_stays {
                setting = setting.with("scattering.spacing", Value::Number(spacing(finer)));
            }
            if !directions_stay {
                setting = setting.with("scattering.directions", Value::Number(count(directions)));
            }
            best = Some(ChosenLight { setting, error, is_cut: false });
        }
        if error.p95 <= share {
            break;
        }
        let more = !directions_stay && error.directions > error.nodes && directions < MOST_DIRECTIONS;
        if more {
            directions = (2 * directions).min(MOST_DIRECTIONS);
            seen.clear();
        }
        if spacing_stays && !more || finer == FINEST {
            break;
        }
        if !spacing_stays {
            finer += 1;
        }
        if GROWTH * clock.read().wall_ms > limit.0 {
            best = best.map(|best| ChosenLight { is_cut: true, ..best });
            break;
        }
    }
    Ok(best)
}
