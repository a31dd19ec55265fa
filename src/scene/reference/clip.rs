//! Clip planes along rays. Twin of `shaders/clip.wgsl`.

use crate::plan::Planned;
use crate::tables::{CapTable, ClipTable};
use relume_base::number::{Real, dot};

/// A distance beyond any box.
pub(super) const FAR: f64 = 1e30;

/// Planes as distances beyond them, in texture coordinates, and the vectors towards the side of each that goes.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes<R> {
    planes: Vec<([R; 3], R)>,
    /// Of planes that shading sees.
    outward: Vec<[R; 3]>,
}

impl<R: Real> Planes<R> {
    pub(super) fn new(table: &ClipTable) -> Self {
        let planes = table.planes().iter().map(|plane| (from(plane.truncate()), R::from_f64(plane.w)));
        Self { planes: planes.collect(), outward: Vec::new() }
    }

    /// Those that shading sees, if any.
    pub(super) fn of_caps(planned: &Planned, table: &CapTable) -> Option<Self> {
        let outward = table.outward.iter().copied().map(from).collect();
        planned.plan.clip.caps.then(|| Self { outward, ..Self::new(&table.planes) })
    }

    /// The part of a line between two distances that all planes leave.
    pub(super) fn left(&self, base: [R; 3], direction: [R; 3], range: [R; 2]) -> [R; 2] {
        let (zero, far) = (R::default(), R::from_f64(FAR));
        self.planes.iter().fold(range, |[near, end], (across, offset)| {
            let (beyond, along) = (dot(*across, base) + *offset, dot(*across, direction));
            if along.abs() < R::from_f64(1e-30) {
                return if beyond > zero { [near, -far] } else { [near, end] };
            }
            let at = -beyond / along;
            if along > zero { [near, end.min(at)] } else { [near.max(at), end] }
        })
    }

    /// A gradient as shading sees it: near a plane, as though the lowest value lay beyond it, at a gradient of `fall`.
    pub(super) fn capped(&self, gradient: [R; 3], fall: R, place: [R; 3]) -> [R; 3] {
        let (one, half) = (R::from_f64(1.0), R::from_f64(1.5));
        self.planes.iter().zip(&self.outward).fold(gradient, |seen, ((across, offset), outward)| {
            let near = (dot(*across, place) + *offset + half).max(R::default()).min(one);
            std::array::from_fn(|axis| (-(near * fall)).mul_add(outward[axis], seen[axis]))
        })
    }
}

fn from<R: Real>(vector: glam::DVec3) -> [R; 3] {
    vector.to_array().map(R::from_f64)
}
