//! Light that a step scatters by phase functions (docs/theory/phase-functions.md). Twin of `shaders/phase.wgsl`.

use super::Step;
use crate::plan::{Accumulate, LANE, ScenePlan};
use crate::tables;
use relume_base::number::{Real, dot};

/// Numbers of a phase function, [`tables::Phase`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Phase<R> {
    gain: R,
    least: R,
    forward: R,
    backward: R,
}

impl<R: Real> Phase<R> {
    pub(super) fn new(phase: &tables::Phase) -> Self {
        let [gain, least, forward, backward] =
            [phase.gain, phase.least, phase.forward, phase.backward].map(R::from_f64);
        Self { gain, least, forward, backward }
    }

    /// The phase function between two directions, by their [`turns`].
    fn of(&self, [ahead, back]: [R; 2]) -> R {
        let square = self.backward.mul_add(back, self.forward.mul_add(ahead, self.least));
        self.gain / (square * square.sqrt())
    }
}

/// |v + l|² and |v − l|² for the unit vectors v to the eye and l to the light: 0 for light from straight behind, and for
/// light from the eye.
fn turns<R: Real>(view: [R; 3], light: [R; 3]) -> [R; 2] {
    let ahead: [R; 3] = std::array::from_fn(|axis| view[axis] + light[axis]);
    let back: [R; 3] = std::array::from_fn(|axis| view[axis] - light[axis]);
    [dot(ahead, ahead), dot(back, back)]
}

/// Adds to `source` what `step` scatters from the direction `light` towards `view`, of light of which these fractions of the
/// components have `reached` it. The `phases` are those of `plan`.
pub(super) fn add_scattered<R: Real>(
    plan: &ScenePlan,
    phases: &[Phase<R>],
    step: &Step<R>,
    [view, light]: [[R; 3]; 2],
    reached: impl Fn(usize) -> R,
    source: &mut [R],
) {
    let turns = turns(view, light);
    let parts = phases.iter().map(|phase| phase.of(turns));
    match plan.accumulate {
        Accumulate::Weights { .. } => {
            for ((sum, &weight), part) in source.iter_mut().zip(&step.source).zip(parts) {
                *sum = weight.mul_add(part * reached(0), *sum);
            }
        }
        Accumulate::Spectral { .. } => {
            for (part, scattered) in parts.zip(step.source.chunks((plan.lanes() * LANE).max(1))) {
                for (component, (sum, &scattered)) in source.iter_mut().zip(scattered).enumerate() {
                    *sum = scattered.mul_add(part * reached(component), *sum);
                }
            }
        }
    }
}

/// Adds to `source` what `step` scatters evenly, of light of which the fraction `reached` arrives.
pub(super) fn add_even<R: Real>(plan: &ScenePlan, step: &Step<R>, reached: R, source: &mut [R]) {
    for scattered in step.source.chunks((plan.lanes() * LANE).max(1)) {
        for (sum, &scattered) in source.iter_mut().zip(scattered) {
            *sum = scattered.mul_add(reached, *sum);
        }
    }
}
