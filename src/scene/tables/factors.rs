//! Factors on the medium by the gradient magnitude and by the values of other fields, as the march evaluates them.

use super::Storage;
use crate::plan::{LANE, Planned};
use crate::{Factors, FieldFactor, Group, SHAPE_EDGE, Scene, Second, Shape};
use relume_base::number::{count, rounded};

/// Largest start and reciprocal width of a piece; f32 holds their products with any gradient.
const LARGEST: f64 = 1e30;

/// The factor of each group of terms as a sum of clamped ramps over the length of a decoded gradient: as many vectors for each group as
/// the longest factor has points, at least one. The first has the factor at 0, and where the group finds its table coordinate: the index of
/// its field in a texel, and scale and offset from its value. Each further one has the start, the reciprocal width and the rise of a piece
/// between two points. Factors by the values of other fields follow likewise, in units of their texels. The last two vectors, if there are
/// any shapes, tell where the group finds its own: scale and offset from its value to a column, and the number of its table, negative for
/// none; scale and offset from the second number to a row, and its field, negative for the gradient.
#[derive(Clone, Debug, PartialEq)]
pub struct FactorTable {
    /// The vectors.
    pub vectors: Vec<[f32; LANE]>,
    /// Tables of the shapes, row by row.
    pub shapes: Vec<f32>,
}

impl FactorTable {
    /// Builds the table of `scene` for fields decoded by `storages`, gradients of the first, and tables of so many `entries`; a single
    /// factor of 1 if the plan has no groups.
    #[must_use]
    pub fn new(scene: &Scene, planned: &Planned, storages: &[&Storage], entries: usize) -> Self {
        let groups = if planned.plan.groups.any() {
            scene.groups()
        } else {
            vec![Group { field: 0, factors: Factors::default() }]
        };
        let mut table = Self { vectors: Vec::new(), shapes: Vec::new() };
        let points = planned.plan.groups.points.max(1);
        let unit = storages.first().map_or(0.0, |storage| storage.magnitude_scale());
        // Without any gradient the unit is 0, and every magnitude lies before the second point.
        let length = |magnitude: f64| if unit > 0.0 { (magnitude / unit).min(LARGEST) } else { LARGEST };
        let [most_fields, most_points] = planned.plan.groups.by_fields;
        for Group { field, factors } in groups {
            let scales = storages.get(field).map_or([0.0; 2], |storage| storage.normalised_from_texel());
            let [scale, offset] = scales.map(|term| term * count(entries - 1));
            let first = factors.gradient.first().map_or(1.0, |point| point.1);
            let pieces = factors.gradient.windows(2).map(|pair| {
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
                let factor = factors.by.get(number);
                let mut of_field = factor.map_or_else(|| vec![ONE], |factor| by_field(factor, scene, storages));
                of_field.resize(most_points, [0.0; LANE]);
                vectors.extend(of_field);
            }
            if planned.plan.groups.shapes[0] > 0 {
                vectors.extend(match factors.shape {
                    None => [[0.0, 0.0, -1.0, 0.0], [0.0; LANE]],
                    Some(shape) => table.add_shape(shape, field, scene, storages),
                });
            }
            table.vectors.extend(vectors.into_iter().map(|vector| vector.map(rounded)));
        }
        table
    }

    /// Adds the table of the shape of a group; returns its vectors.
    fn add_shape(&mut self, shape: &Shape, field: usize, scene: &Scene, storages: &[&Storage]) -> [[f64; LANE]; 2] {
        let page = count(self.shapes.len() / (SHAPE_EDGE * SHAPE_EDGE));
        let domain = |field: usize| storages.get(field).map_or([0.0; 2], |storage| storage.domain);
        let second = match &shape.second {
            Second::Gradient => None,
            Second::Field(name) => scene.fields.iter().position(|field| field.name == *name),
        };
        let steepest = |[low, high]: [f64; 2]| [0.0, (high - low) / scene.frame.geometry.spacing.min_element()];
        let extent = shape.extent([domain(field), second.map_or_else(|| steepest(domain(0)), domain)]);
        let last = count(SHAPE_EDGE - 1);
        // A range without a width has one number.
        let of_number = |[low, high]: [f64; 2], number: usize| (high - low).mul_add(count(number) / last, low);
        for row in 0..SHAPE_EDGE {
            let second = of_number(extent[1], row);
            let heights = (0..SHAPE_EDGE).map(|column| rounded(shape.at(of_number(extent[0], column), second)));
            self.shapes.extend(heights);
        }
        let cells = |[low, high]: [f64; 2], [scale, offset]: [f64; 2]| {
            let per_unit = if high > low { last / (high - low) } else { 0.0 };
            [scale * per_unit, (offset - low) * per_unit].map(|number| number.clamp(-LARGEST, LARGEST))
        };
        // From a texel to a value.
        let decoded = |field: usize| {
            let [low, high] = domain(field);
            let [scale, offset] = storages.get(field).map_or([0.0; 2], |storage| storage.normalised_from_texel());
            [scale * (high - low), offset.mul_add(high - low, low)]
        };
        let unit = storages.first().map_or(0.0, |storage| storage.magnitude_scale());
        let across = cells(extent[0], decoded(field));
        let up = cells(extent[1], second.map_or([unit, 0.0], decoded));
        [[across[0], across[1], page, 0.0], [up[0], up[1], second.map_or(-1.0, count), 0.0]]
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
