//! Solids as distance fields, evaluated slice by slice.

use std::ops::{Range, RangeInclusive};

use glam::Vec3;

/// A distance larger than any other.
const FAR: f32 = 1e6;

/// Voxel positions in the design space of a phantom, whose unit is a voxel at the default size.
pub(super) struct Grid {
    pub(super) dims: [usize; 3],
    /// Coordinates of the voxels along each axis.
    pub(super) at: [Vec<f32>; 3],
    /// Half the width of a soft edge: one voxel, of the largest side.
    pub(super) edge: f32,
}

impl Grid {
    /// A grid of `dims` voxels over a box of `size`.
    #[expect(clippy::cast_precision_loss, reason = "axes have fewer than 2²⁴ voxels")]
    pub(super) fn new(dims: [usize; 3], size: [f32; 3]) -> Self {
        let steps: [f32; 3] = std::array::from_fn(|axis| size[axis] / dims[axis] as f32);
        let at = std::array::from_fn(|axis| (0..dims[axis]).map(|i| (i as f32 + 0.5) * steps[axis]).collect());
        Self { dims, at, edge: steps.into_iter().fold(0.0, f32::max) }
    }

    /// Range of the voxels along `axis` within `[low, high]`.
    fn within(&self, axis: usize, low: f32, high: f32) -> Range<usize> {
        let at = &self.at[axis];
        at.partition_point(|&place| place < low)..at.partition_point(|&place| place <= high)
    }
}

/// A solid; lengths are in the design space.
#[derive(Clone, Copy, Debug)]
pub(super) enum Solid {
    /// A rod with a radius at each end.
    Rod { ends: [Vec3; 2], radii: [f32; 2] },
    /// An ellipsoid with its axes along the grid's.
    Ellipsoid { centre: Vec3, radii: Vec3 },
    /// A block with rounded edges.
    Block { centre: Vec3, half: Vec3, rounding: f32 },
    /// A cylinder along a grid axis.
    Cylinder { axis: usize, centre: Vec3, radius: f32, half: f32 },
    /// The wall of a cylinder along a grid axis, from `radius - wall` to `radius + wall`.
    Pipe { axis: usize, centre: Vec3, radius: f32, wall: f32, half: f32 },
}

impl Solid {
    pub(super) fn rod(from: Vec3, to: Vec3, radii: [f32; 2]) -> Self {
        Self::Rod { ends: [from, to], radii }
    }

    pub(super) fn ball(centre: Vec3, radius: f32) -> Self {
        Self::Ellipsoid { centre, radii: Vec3::splat(radius) }
    }

    /// Corners of a bounding box.
    fn bounds(&self) -> [Vec3; 2] {
        let around = |centre: Vec3, half: Vec3| [centre - half, centre + half];
        let along = |axis: usize, centre: Vec3, radius: f32, half: f32| {
            let mut sides = Vec3::splat(radius);
            sides[axis] = half;
            around(centre, sides)
        };
        match *self {
            Self::Rod { ends: [a, b], radii: [ra, rb] } => [(a - ra).min(b - rb), (a + ra).max(b + rb)],
            Self::Ellipsoid { centre, radii } => around(centre, radii),
            Self::Block { centre, half, .. } => around(centre, half),
            Self::Cylinder { axis, centre, radius, half } => along(axis, centre, radius, half),
            Self::Pipe { axis, centre, radius, wall, half } => along(axis, centre, radius + wall, half),
        }
    }

    /// Bounds of the x range in which the row at `y`, `z` is nearer than `margin`; may be larger than that range.
    fn reach(&self, [low, high]: [Vec3; 2], y: f32, z: f32, margin: f32) -> Option<[f32; 2]> {
        let (mut from, mut to) = (low.x - margin, high.x + margin);
        match *self {
            Self::Rod { ends: [a, b], radii: [ra, rb] } => {
                // Restricts the axis to the part near enough in y and in z.
                let (reach, along) = (ra.max(rb) + margin, b - a);
                let (mut first, mut last) = (0.0_f32, 1.0_f32);
                for (start, slope, place) in [(a.y, along.y, y), (a.z, along.z, z)] {
                    if slope.abs() > 1e-3 {
                        let [t, u] = [(place - reach - start) / slope, (place + reach - start) / slope];
                        (first, last) = (first.max(t.min(u)), last.min(t.max(u)));
                    }
                }
                let [t, u] = [a.x + first * along.x, a.x + last * along.x];
                (from, to) = (t.min(u) - reach, t.max(u) + reach);
                (first <= last).then_some([from, to])
            }
            Self::Ellipsoid { centre, radii } => {
                let radii = radii + margin;
                let rest = 1.0 - ((y - centre.y) / radii.y).powi(2) - ((z - centre.z) / radii.z).powi(2);
                let half = radii.x * rest.max(0.0).sqrt();
                (from, to) = (centre.x - half, centre.x + half);
                (rest > 0.0).then_some([from, to])
            }
            _ => Some([from, to]),
        }
    }

    /// Unites a row of distances with this solid: takes the smaller distance, smoothed over `blend` where the two are
    /// similar. `xs` are the positions of `row`.
    fn unite(&self, xs: &[f32], y: f32, z: f32, blend: f32, row: &mut [f32]) {
        match *self {
            Self::Rod { ends: [a, b], radii: [ra, rb] } => {
                let (along, from) = (b - a, Vec3::new(0.0, y, z) - a);
                let per_length = 1.0 / along.length_squared().max(1e-12);
                let across = from.y * along.y + from.z * along.z;
                join(xs, blend, row, |x| {
                    let x = x + from.x;
                    let t = limit((x * along.x + across) * per_length);
                    let (ex, ey, ez) = (x - t * along.x, from.y - t * along.y, from.z - t * along.z);
                    (ex * ex + ey * ey + ez * ez).sqrt() - (ra + t * (rb - ra))
                });
            }
            Self::Ellipsoid { centre, radii } => {
                let per = 1.0 / (radii * radii);
                let (ey, ez) = ((y - centre.y) * per.y, (z - centre.z) * per.z);
                let rest = ey * (y - centre.y) + ez * (z - centre.z) - 1.0;
                let slope = ey * ey + ez * ez + 1e-9;
                // First-order distance: the implicit function divided by the length of its gradient.
                join(xs, blend, row, |x| {
                    let x = x - centre.x;
                    let ex = x * per.x;
                    0.5 * (ex * x + rest) / (ex * ex + slope).sqrt()
                });
            }
            Self::Block { centre, half, rounding } => {
                let inner = half - rounding;
                let (qy, qz) = ((y - centre.y).abs() - inner.y, (z - centre.z).abs() - inner.z);
                let (outside, inside) = (qy.max(0.0).powi(2) + qz.max(0.0).powi(2), qy.max(qz));
                join(xs, blend, row, |x| {
                    let qx = (x - centre.x).abs() - inner.x;
                    let positive = if qx > 0.0 { qx } else { 0.0 };
                    let deepest = if qx > inside { qx } else { inside };
                    (positive * positive + outside).sqrt() + if deepest < 0.0 { deepest } else { 0.0 } - rounding
                });
            }
            Self::Cylinder { axis: 0, centre, radius, half } => {
                let across = (y - centre.y).hypot(z - centre.z) - radius;
                join(xs, blend, row, |x| greater((x - centre.x).abs() - half, across));
            }
            Self::Cylinder { axis, centre, radius, half } => {
                let (end, side) = turned(axis, centre, y, z, half);
                join(xs, blend, row, |x| {
                    let x = x - centre.x;
                    greater((x * x + side).sqrt() - radius, end)
                });
            }
            Self::Pipe { axis: 0, centre, radius, wall, half } => {
                let across = ((y - centre.y).hypot(z - centre.z) - radius).abs() - wall;
                join(xs, blend, row, |x| greater((x - centre.x).abs() - half, across));
            }
            Self::Pipe { axis, centre, radius, wall, half } => {
                let (end, side) = turned(axis, centre, y, z, half);
                join(xs, blend, row, |x| {
                    let x = x - centre.x;
                    greater(((x * x + side).sqrt() - radius).abs() - wall, end)
                });
            }
        }
    }
}

/// For a cylinder along y or z: the distance from its flat ends, and the squared distance from its axis without the x
/// term.
fn turned(axis: usize, centre: Vec3, y: f32, z: f32, half: f32) -> (f32, f32) {
    let (along, across) = if axis == 1 { (y - centre.y, z - centre.z) } else { (z - centre.z, y - centre.y) };
    (along.abs() - half, across * across)
}

/// `max` for operands that are not NaN, in one instruction.
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

fn limit(value: f32) -> f32 {
    let value = if value > 0.0 { value } else { 0.0 };
    if value < 1.0 { value } else { 1.0 }
}

fn join(xs: &[f32], blend: f32, row: &mut [f32], distance: impl Fn(f32) -> f32) {
    let per = 0.25 / blend;
    for (sum, &x) in row.iter_mut().zip(xs) {
        let (a, b) = (*sum, distance(x));
        let near = blend - (a - b).abs();
        let near = if near > 0.0 { near } else { 0.0 };
        *sum = if a < b { a } else { b } - near * near * per;
    }
}

/// A tissue or a part: solids, each with the corners of its bounds and the width of its blend.
pub(super) struct Layer(Vec<(Solid, [Vec3; 2], f32)>);

impl Layer {
    pub(super) fn new(blend: f32, solids: impl IntoIterator<Item = Solid>) -> Self {
        Self(Vec::new()).and(blend, solids)
    }

    pub(super) fn and(mut self, blend: f32, solids: impl IntoIterator<Item = Solid>) -> Self {
        self.0.extend(solids.into_iter().map(|solid| (solid, solid.bounds(), blend)));
        self
    }
}

/// Distances from a layer in one slice: negative inside, `FAR` outside `spans`.
pub(super) struct Slice {
    distance: Vec<f32>,
    spans: Vec<Range<usize>>,
    width: usize,
}

impl Slice {
    pub(super) fn new(grid: &Grid) -> Self {
        let [width, height, _] = grid.dims;
        Self { distance: vec![FAR; width * height], spans: vec![0..0; height], width }
    }

    /// Evaluates slice `z` of `layer`.
    pub(super) fn fill(&mut self, layer: &Layer, grid: &Grid, z: usize) {
        for (row, span) in self.spans.iter_mut().enumerate() {
            self.distance[row * self.width..][std::mem::take(span)].fill(FAR);
        }
        let place = grid.at[2][z];
        for (solid, bounds, blend) in &layer.0 {
            let ([low, high], margin) = (*bounds, grid.edge + blend);
            if place < low.z - margin || place > high.z + margin {
                continue;
            }
            for row in grid.within(1, low.y - margin, high.y + margin) {
                let y = grid.at[1][row];
                let Some([from, to]) = solid.reach(*bounds, y, place, margin) else { continue };
                let reached = grid.within(0, from, to);
                if reached.is_empty() {
                    continue;
                }
                let span = &mut self.spans[row];
                *span = if span.start == span.end {
                    reached.clone()
                } else {
                    span.start.min(reached.start)..span.end.max(reached.end)
                };
                let distances = &mut self.distance[row * self.width..][reached.clone()];
                solid.unite(&grid.at[0][reached], y, place, *blend, distances);
            }
        }
    }

    /// Span of row `y` that may be near the layer, and its distances.
    pub(super) fn row(&self, y: usize) -> (Range<usize>, &[f32]) {
        let span = self.spans[y].clone();
        (span.clone(), &self.distance[y * self.width..][span])
    }
}

/// Fraction of a voxel inside a solid: a ramp from 0 to 1 over two voxels.
pub(super) fn covered(distance: f32, edge: f32) -> f32 {
    limit(0.5 - distance * (0.5 / edge))
}

/// Blends a part over a row of values. The part's own values span `values` as `texture` goes from −1 to 1.
pub(super) fn lay(
    row: &mut [f32],
    distances: &[f32],
    edge: f32,
    values: &RangeInclusive<u8>,
    texture: impl Fn(usize, f32) -> f32,
) {
    let (low, high) = (f32::from(*values.start()), f32::from(*values.end()));
    for (index, (value, &distance)) in row.iter_mut().zip(distances).enumerate() {
        let part = low + (high - low) * limit(0.5 + 0.5 * texture(index, distance));
        *value += covered(distance, edge) * (part - *value);
    }
}

/// A plane wave `sin(k·p + phase)`, tabulated along x.
pub(super) struct Wave {
    sin: Vec<f32>,
    cos: Vec<f32>,
    across: [f32; 2],
    phase: f32,
}

impl Wave {
    pub(super) fn new(grid: &Grid, wave: [f32; 3], phase: f32) -> Self {
        let (sin, cos) = grid.at[0].iter().map(|&x| (wave[0] * x).sin_cos()).unzip();
        Self { sin, cos, across: [wave[1], wave[2]], phase }
    }

    /// Evaluates the wave along a row.
    pub(super) fn row(&self, y: f32, z: f32, row: &mut [f32]) {
        let (sin, cos) = (self.across[0] * y + self.across[1] * z + self.phase).sin_cos();
        for ((value, along), across) in row.iter_mut().zip(&self.sin).zip(&self.cos) {
            *value = along * cos + across * sin;
        }
    }
}

/// Noise in `[0, 1)`, a hash of the position.
pub(super) fn grain(x: usize, row: u32) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "any bits will do")]
    let mut bits = (x as u32).wrapping_mul(0x9e37_79b1) ^ row;
    bits = (bits ^ (bits >> 15)).wrapping_mul(0x85eb_ca6b);
    bits ^= bits >> 13;
    // 23 mantissa bits of a number in [1, 2).
    f32::from_bits(0x3f80_0000 | (bits >> 9)) - 1.0
}

/// Seed of `grain` for a row.
pub(super) fn grain_row(y: usize, z: usize) -> u32 {
    #[expect(clippy::cast_possible_truncation, reason = "any bits will do")]
    let bits = (y as u32).wrapping_mul(0xc2b2_ae35) ^ (z as u32).wrapping_mul(0x27d4_eb2f);
    bits ^ (bits >> 16)
}

/// Rounds values between 0 and 255 to bytes.
pub(super) fn store(row: &[f32], out: &mut [u8]) {
    for (voxel, value) in out.iter_mut().zip(row) {
        // Added to 2²³, a float is rounded to a whole number in its lowest bits.
        *voxel = (value + 8_388_608.0).to_bits().to_le_bytes()[0];
    }
}
