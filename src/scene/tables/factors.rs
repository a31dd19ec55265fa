//! Factors on the medium by the gradient magnitude, as the march evaluates them.

use super::Storage;
use crate::Scene;
use crate::plan::{LANE, Planned};
use relume_base::number::rounded;

/// Largest start and reciprocal width of a piece; f32 holds their products with any gradient.
const LARGEST: f64 = 1e30;

/// The factor of each group of terms as a sum of clamped ramps over the length of a decoded gradient: as many vectors for each group as
/// the longest factor has points. The first has the factor at 0; each further one has the start, the reciprocal width and the rise of a
/// piece between two points.
#[derive(Clone, Debug, PartialEq)]
pub struct FactorTable(pub Vec<[f32; LANE]>);

impl FactorTable {
    /// Builds the table of `scene` for gradients decoded by `storage`; a single factor of 1 if the plan has none.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, storage: &Storage) -> Self {
        let factors = if planned.plan.factors.any() { scene.transfer.factors() } else { vec![&[][..]] };
        let points = planned.plan.factors.points.max(1);
        let unit = storage.magnitude_scale();
        // Without any gradient the unit is 0, and every magnitude lies before the second point.
        let length = |magnitude: f64| if unit > 0.0 { (magnitude / unit).min(LARGEST) } else { LARGEST };
        let of_group = |factor: &[(f64, f64)]| {
            let first = factor.first().map_or(1.0, |point| point.1);
            let pieces = factor.windows(2).map(|pair| {
                let ((start, low), (end, high)) = (pair[0], pair[1]);
                let steepness = (unit / (end - start)).min(LARGEST);
                [length(start), steepness, high - low, 0.0]
            });
            let mut vectors: Vec<[f64; LANE]> = std::iter::once([first, 0.0, 0.0, 0.0]).chain(pieces).collect();
            // A piece of 0 adds nothing.
            vectors.resize(points, [0.0; LANE]);
            vectors
        };
        Self(factors.into_iter().flat_map(of_group).map(|vector| vector.map(rounded)).collect())
    }
}
