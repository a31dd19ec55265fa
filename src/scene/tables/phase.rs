//! Phase functions of the materials, as numbers of the march (docs/theory/phase-functions.md).

use crate::Scene;
use crate::plan::{LANE, Planned};
use relume_base::number::rounded;

/// Numbers of a phase function of Henyey and Greenstein with parameter g, 1 on average over all directions:
///
/// p = gain / d^(3/2),  d = least + forward · |v + l|² + backward · |v − l|²
///
/// for unit vectors v to the eye and l to the light. |v + l|² is 2 − 2 cos θ for the angle θ by which the ray turns, so d
/// is 1 + g² − 2g cos θ, without the cancellation of that form near θ = 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// 1 − g².
    pub gain: f64,
    /// (1 − |g|)².
    pub least: f64,
    /// g of a material that scatters forwards, otherwise 0.
    pub forward: f64,
    /// −g of a material that scatters backwards, otherwise 0.
    pub backward: f64,
}

impl Phase {
    /// The phase function with this parameter.
    #[must_use]
    pub fn new(parameter: f64) -> Self {
        let size = parameter.abs();
        Self {
            gain: (1.0 - size) * (1.0 + size),
            least: (1.0 - size) * (1.0 - size),
            forward: parameter.max(0.0),
            backward: (-parameter).max(0.0),
        }
    }

    /// The phase functions of the components of `planned`.
    #[must_use]
    pub fn of_plan(scene: &Scene, planned: &Planned) -> Vec<Self> {
        planned.phases(scene).into_iter().map(Self::new).collect()
    }
}

/// Phase functions in lanes; those of unused numbers are 0.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseTable {
    /// [`Phase::gain`].
    pub gain: Vec<[f32; LANE]>,
    /// [`Phase::least`].
    pub least: Vec<[f32; LANE]>,
    /// [`Phase::forward`].
    pub forward: Vec<[f32; LANE]>,
    /// [`Phase::backward`].
    pub backward: Vec<[f32; LANE]>,
}

impl PhaseTable {
    /// Builds the table of `planned`.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned) -> Self {
        let phases = Phase::of_plan(scene, planned);
        let lanes = planned.plan.phase_lanes();
        let table = |of: fn(&Phase) -> f64, unused: f32| {
            let mut table = vec![[unused; LANE]; lanes];
            phases.iter().enumerate().for_each(|(i, phase)| table[i / LANE][i % LANE] = rounded(of(phase)));
            table
        };
        Self {
            gain: table(|phase| phase.gain, 0.0),
            // Not 0, by which the shader would divide.
            least: table(|phase| phase.least, 1.0),
            forward: table(|phase| phase.forward, 0.0),
            backward: table(|phase| phase.backward, 0.0),
        }
    }
}
