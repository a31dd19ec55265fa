//! Factor on the opacity by the gradient magnitude, as the march evaluates it.

use super::Storage;
use crate::Scene;
use crate::plan::LANE;
use relume_base::number::rounded;

/// Largest start and reciprocal width of a piece; f32 holds their products with any gradient.
const LARGEST: f64 = 1e30;

/// The factor as a sum of clamped ramps over the length of a decoded gradient. Vector 0 has the first factor; each
/// further one has the start, the reciprocal width and the rise of a piece between two points.
#[derive(Clone, Debug, PartialEq)]
pub struct GradientTable(pub Vec<[f32; LANE]>);

impl GradientTable {
    /// Builds the table of `scene` for gradients decoded by `storage`; a factor of 1 if the scene has none.
    #[must_use]
    pub fn new(scene: &Scene, storage: &Storage) -> Self {
        let points = &scene.transfer.gradient_opacity;
        let first = points.first().map_or(1.0, |point| point.1);
        let unit = storage.magnitude_scale();
        // Without any gradient the unit is 0, and every magnitude lies before the second point.
        let length = |magnitude: f64| if unit > 0.0 { (magnitude / unit).min(LARGEST) } else { LARGEST };
        let pieces = points.windows(2).map(|pair| {
            let ((start, low), (end, high)) = (pair[0], pair[1]);
            let steepness = (unit / (end - start)).min(LARGEST);
            [length(start), steepness, high - low, 0.0]
        });
        Self(std::iter::once([first, 0.0, 0.0, 0.0]).chain(pieces).map(|vector| vector.map(rounded)).collect())
    }
}
