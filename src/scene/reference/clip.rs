//! Clip planes along rays. Twin of `shaders/clip.wgsl`.

use crate::FIELDS;
use crate::plan::Planned;
use crate::tables::{CapTable, ClipTable};
use relume_base::number::{Real, dot};
use smallvec::SmallVec;

/// A distance beyond any box.
pub(super) const FAR: f64 = 1e30;

/// Planes as distances beyond them, in texture coordinates, and the vectors towards the side of each that goes.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes<R> {
    planes: Vec<([R; 3], R)>,
    /// The fields that each cuts.
    fields: Vec<[bool; FIELDS]>,
    /// Number of the first ones, at which rays end.
    shortening: usize,
    /// True if the others keep together what any of them keeps.
    keeps_any: bool,
    /// Of planes that shading sees.
    outward: Vec<[R; 3]>,
}

/// For each field the part of a line between two distances that its planes keep, or remove.
#[derive(Clone, Copy, Debug)]
pub(super) struct Own<R> {
    range: [[R; 2]; FIELDS],
    keeps_any: bool,
}

impl<R: Real> Own<R> {
    /// The same in units of steps, of the `start` and the `length` of the first.
    pub(super) fn in_steps(self, start: R, length: R, first: R) -> Self {
        let steps = |at: R| (at - start) / length - first;
        Self { range: self.range.map(|ends| ends.map(steps)), ..self }
    }

    /// The parts of a range that are left of each field.
    pub(super) fn parts(&self, [from, to]: [R; 2]) -> SmallVec<[R; FIELDS]> {
        let (zero, one) = (R::default(), R::from_f64(1.0));
        let part = |[low, high]: [R; 2]| {
            let within = (to.min(high) - from.max(low)).max(zero) / (to - from).max(R::from_f64(1e-30));
            if self.keeps_any { one - within } else { within }
        };
        self.range.map(part).into_iter().collect()
    }
}

impl<R: Real> Planes<R> {
    pub(super) fn new(table: &ClipTable) -> Self {
        let planes = table.planes().iter().map(|plane| (from(plane.truncate()), R::from_f64(plane.w)));
        Self {
            planes: planes.collect(),
            fields: table.fields().to_vec(),
            shortening: table.shortening(),
            keeps_any: table.keeps_any,
            outward: Vec::new(),
        }
    }

    /// Those that a sample meets: that shading sees, or that cut each field by itself.
    pub(super) fn of_samples(planned: &Planned, table: &CapTable) -> Option<Self> {
        let clip = planned.plan.clip;
        let outward = if clip.caps { table.outward.iter().copied().map(from).collect() } else { Vec::new() };
        (clip.caps || clip.is_by_field()).then(|| Self { outward, ..Self::new(&table.planes) })
    }

    /// The part of a line between two distances that the planes leave at which rays end.
    pub(super) fn left(&self, base: [R; 3], direction: [R; 3], range: [R; 2]) -> [R; 2] {
        let zero = R::default();
        self.planes[..self.shortening].iter().fold(range, |[near, end], &plane| {
            let (beyond, along) = (dot(plane.0, base) + plane.1, dot(plane.0, direction));
            if along.abs() < R::from_f64(1e-30) {
                return if beyond > zero { [near, R::from_f64(-FAR)] } else { [near, end] };
            }
            let at = -beyond / along;
            if along > zero { [near, end.min(at)] } else { [near.max(at), end] }
        })
    }

    /// Of each field, the part of a line that its other planes keep, or remove; `None` if there are none.
    pub(super) fn own(&self, base: [R; 3], direction: [R; 3]) -> Option<Own<R>> {
        let (zero, far) = (R::default(), R::from_f64(FAR));
        if self.shortening == self.planes.len() {
            return None;
        }
        let of_field = |field: usize| {
            let own = self.own_planes(field);
            // Nothing is removed of a field without planes of its own.
            let nothing = self.keeps_any && own.clone().next().is_none();
            own.fold([-far, if nothing { -far } else { far }], |[low, high], index| {
                let plane = self.planes[index];
                let (beyond, along) = (dot(plane.0, base) + plane.1, dot(plane.0, direction));
                if along.abs() < R::from_f64(1e-30) {
                    return if (beyond > zero) == self.keeps_any { [low, high] } else { [far, -far] };
                }
                let at = -beyond / along;
                if (along > zero) == self.keeps_any { [low.max(at), high] } else { [low, high.min(at)] }
            })
        };
        Some(Own { range: std::array::from_fn(of_field), keeps_any: self.keeps_any })
    }

    /// Planes at which rays do not end that cut a field.
    fn own_planes(&self, field: usize) -> impl Iterator<Item = usize> + Clone {
        (self.shortening..self.planes.len()).filter(move |&plane| self.fields[plane][field])
    }

    /// Distance of a place beyond plane `index`.
    fn beyond(&self, index: usize, place: [R; 3]) -> R {
        dot(self.planes[index].0, place) + self.planes[index].1
    }

    /// The part of a field that is left around a place, within half a unit of length of its own planes.
    pub(super) fn part_at(&self, field: usize, place: [R; 3]) -> R {
        let beyond = self.own_planes(field).map(|plane| self.beyond(plane, place));
        let beyond = if self.keeps_any { beyond.reduce(Real::min) } else { beyond.reduce(Real::max) };
        let one = R::from_f64(1.0);
        beyond.map_or(one, |beyond| (R::from_f64(0.5) - beyond).max(R::default()).min(one))
    }

    /// A gradient of a field as shading sees it: near a plane, as though the lowest value lay beyond it, at a gradient of `fall`.
    pub(super) fn capped(&self, field: usize, gradient: [R; 3], fall: R, place: [R; 3]) -> [R; 3] {
        let (one, half) = (R::from_f64(1.0), R::from_f64(1.5));
        let towards = |seen: [R; 3], index: usize, beyond: R| {
            let near = (beyond + half).max(R::default()).min(one);
            std::array::from_fn(|axis| (-(near * fall)).mul_add(self.outward[index][axis], seen[axis]))
        };
        let of_field = (0..self.outward.len()).filter(|&index| self.fields[index][field]);
        let beyond = of_field.map(|index| (index, self.beyond(index, place)));
        if self.keeps_any {
            // The face of what is removed that is next.
            let nearest = beyond.reduce(|nearest, other| if other.1 < nearest.1 { other } else { nearest });
            return nearest.map_or(gradient, |(index, beyond)| towards(gradient, index, beyond));
        }
        beyond.fold(gradient, |seen, (index, beyond)| towards(seen, index, beyond))
    }
}

fn from<R: Real>(vector: glam::DVec3) -> [R; 3] {
    vector.to_array().map(R::from_f64)
}
