//! Factors on the medium by the gradient magnitude and by the values of other fields, as the march evaluates them.

use super::Storage;
use crate::plan::{LANE, Planned};
use crate::{FieldFactor, Group, Scene};
use relume_base::number::{count, rounded};

/// Largest start and reciprocal width of a piece; f32 holds their products with any gradient.
const LARGEST: f64 = 1e30;

/// The factor of each group of terms as a sum of clamped ramps over the length of a decoded gradient: as many vectors for each group as
/// the longest factor has points, at least one. The first has the factor at 0, and where the group finds its table coordinate: the index of
/// its field in a texel, and scale and offset from its value. Each further one has the start, the reciprocal width and the rise of a piece
/// between two points. Factors by the values of other fields follow likewise, in units of their texels.
#[derive(Clone, Debug, PartialEq)]
pub struct FactorTable(pub Vec<[f32; LANE]>);

impl FactorTable {
    /// Builds the table of `scene` for fields decoded by `storages`, gradients of the first, and tables of so many `entries`; a single
    /// factor of 1 if the plan has no groups.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, storages: &[&Storage], entries: usize) -> Self {
        let groups =
            if planned.plan.groups.any() { scene.groups() } else { vec![Group { field: 0, factor: &[], by: &[] }] };
        let points = planned.plan.groups.points.max(1);
        let unit = storages.first().map_or(0.0, |storage| storage.magnitude_scale());
        // Without any gradient the unit is 0, and every magnitude lies before the second point.
        let length = |magnitude: f64| if unit > 0.0 { (magnitude / unit).min(LARGEST) } else { LARGEST };
        let [most_fields, most_points] = planned.plan.groups.by_fields;
        let of_group = |Group { field, factor, by }: Group<'_>| {
            let scales = storages.get(field).map_or([0.0; 2], |storage| storage.normalised_from_texel());
            let [scale, offset] = scales.map(|term| term * count(entries - 1));
            let first = factor.first().map_or(1.0, |point| point.1);
            let pieces = factor.windows(2).map(|pair| {
                let ((start, low), (end, high)) = (pair[0], pair[1]);
                let steepness = (unit / (end - start)).min(LARGEST);
                [length(start), steepness, high - low, 0.0]
            });
            let mut vectors: Vec<[f64; LANE]> =
                std::iter::once([first, count(field), scale, offset]).chain(pieces).collect();
            // A piece of 0 adds nothing.
            vectors.resize(points, [0.0; LANE]);
            for number in 0..most_fields {
                // A factor of 1 where a group has none.
                let mut of_field = by.get(number).map_or_else(|| vec![ONE], |factor| by_field(factor, scene, storages));
                of_field.resize(most_points, [0.0; LANE]);
                vectors.extend(of_field);
            }
            vectors
        };
        Self(groups.into_iter().flat_map(of_group).map(|vector| vector.map(rounded)).collect())
    }
}

/// A factor of 1.
const ONE: [f64; LANE] = [1.0, 0.0, 0.0, 0.0];

/// The vectors of a factor by the value of a field.
fn by_field(factor: &FieldFactor, scene: &Scene, storages: &[&Storage]) -> Vec<[f64; LANE]> {
    let first = factor.points.first().map_or(1.0, |point| point.1);
    let field = scene.fields.iter().position(|field| field.name == factor.field);
    let Some((field, storage)) = field.and_then(|field| Some((field, storages.get(field)?))) else {
        // As outside its box.
        return vec![[first, 0.0, 0.0, 0.0]];
    };
    let [low, high] = storage.domain;
    let [scale, offset] = storage.normalised_from_texel();
    let head = [first, count(field), 0.0, 0.0];
    if !(high > low && scale > 0.0) {
        // Its only value is above every start.
        return vec![head, [-1.0, LARGEST, factor.at(low) - first, 0.0]];
    }
    let texel = |value: f64| ((value - low) / (high - low) - offset) / scale;
    let pieces = factor.points.windows(2).map(|pair| {
        let ((start, before), (end, after)) = (pair[0], pair[1]);
        let steepness = (1.0 / (texel(end) - texel(start))).min(LARGEST);
        [texel(start).clamp(-LARGEST, LARGEST), steepness, after - before, 0.0]
    });
    std::iter::once(head).chain(pieces).collect()
}
