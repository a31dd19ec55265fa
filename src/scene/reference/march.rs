//! Front-to-back march along rays. Twin of `shaders/march.wgsl`, with the runs of `samples.wgsl` and `segments.wgsl`.

use std::ops::Range;

use glam::DVec3;
use smallvec::SmallVec;

use super::clip::{FAR, Own, Planes};
use super::closing::across;
use super::composite::{Lost, attenuate_all, attenuate_matrix};
use super::factors::thin;
use super::light::{At, Light, Scratch};
use super::paths::{Paths, Seen};
use super::{Crossing, End, ReferenceError, Samples, Step, Values, store};
use crate::film::relit_pixel;
use crate::film::{Film, RelightMatrices};
use crate::plan::{Integrate, LANE, MOST_PARTS, Planned, ScenePlan, Transmittance, refinement_bound};
use crate::tables::{RayTable, phase_of_ray, ray_phase, ray_places};
use crate::{Blending, FIELDS, ScatteringMethod, Scene};
use relume_base::number::{Real, count, dot, unit};
use relume_base::parallel;
use relume_base::progress::Progress;

/// Arguments of a march.
#[doc(hidden)]
#[derive(Clone, Copy)]
pub struct Marched<'a, R> {
    pub scene: &'a Scene,
    pub planned: &'a Planned,
    pub samples: &'a dyn Samples<R>,
    pub size: [usize; 2],
    pub progress: &'a dyn Progress,
}

impl<R> std::fmt::Debug for Marched<'_, R> {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.debug_struct("Marched").field("scene", &self.scene.name).field("size", &self.size).finish_non_exhaustive()
    }
}

/// A ray through a pixel.
#[derive(Clone, Copy, Debug)]
struct Ray<R> {
    base: [R; 3],
    direction: [R; 3],
    /// Where the ray enters the volume, in units of length from `base`.
    start: R,
    /// Number of the first step, from `start`.
    first: R,
    /// Ends of the part of the ray that the crop box and the clip planes leave, in steps from the beginning of the
    /// first step.
    inside: [R; 2],
    /// Number of samples.
    samples: usize,
    /// Parts of the ray that planes keep, or remove, of each field by itself, in steps from the beginning of the first.
    own: Option<Own<R>>,
    /// Direction to the eye in the volume's axes.
    view: [R; 3],
}

impl<R: Real> Ray<R> {
    /// Ends of the part of step `n` that is left, in steps from the beginning of that step.
    fn part(&self, n: usize) -> [R; 2] {
        let (n, one) = (R::from_f64(count(n)), R::from_f64(1.0));
        [(self.inside[0] - n).max(R::default()), (self.inside[1] - n).min(one)]
    }

    /// Place `within` steps behind the beginning of step `n`, in texture coordinates.
    fn place(&self, n: usize, within: R, step_length: R) -> [R; 3] {
        let s = (R::from_f64(count(n)) + within + self.first).mul_add(step_length, self.start);
        std::array::from_fn(|axis| s.mul_add(self.direction[axis], self.base[axis]))
    }
}

/// A sample along a ray.
#[derive(Clone, Copy, Debug)]
pub struct RaySample<'a, R> {
    /// Index from 0 at the first sample that the crop box and the clip planes leave.
    pub index: usize,
    /// Position in texture coordinates.
    pub place: [R; 3],
    /// Length in steps: 1, less for a step that a face cuts and for a part of a segment.
    pub length: R,
    /// Transmittance from the sample to the eye.
    pub transmittance: &'a [R],
}

/// The extreme value of a field along a ray, and the sample that holds it.
#[derive(Clone, Copy, Debug)]
struct Extreme<R> {
    value: R,
    index: usize,
    place: [R; 3],
}

/// A sample whose neighbours decide on further ones.
#[derive(Clone)]
struct Known<R> {
    density: Step<R>,
    crossing: Crossing<R>,
}

/// Part of a step with a medium of its own.
struct Part<R> {
    place: [R; 3],
    density: Step<R>,
    /// In steps.
    length: R,
}

/// Constants of a frame.
struct Frame<'a, R> {
    planned: &'a Planned,
    rays: RayTable,
    step_length: R,
    termination: R,
    variation: R,
    /// Difference above which a step is refined.
    bound: R,
    clip: Planes<R>,
    light: Light<'a, R>,
    /// Paths of light that has scattered before, if the plan follows these.
    paths: Option<Paths>,
    size: [usize; 2],
    /// Places of the rays in a pixel.
    places: Vec<[f64; 2]>,
}

impl<'a, R: Real> Frame<'a, R> {
    /// The frame of a march of `pixels` pixels.
    fn new(of: &Marched<'a, R>, pixels: usize) -> Result<Self, ReferenceError> {
        let Marched { scene, planned, samples, size, progress } = *of;
        let aspect = count(size[0]) / count(size[1]);
        let view = scene.camera.view(&scene.frame.geometry, aspect).ok_or(ReferenceError::Camera)?;
        let step_length = scene.accuracy.step_length;
        let rays = RayTable::new(scene, &view).ok_or(ReferenceError::TooManySamples { step_length })?;
        let clip = Planes::new(&rays.clip);
        let light = Light::new(scene, planned, samples, rays.local_scale, pixels, progress)?;
        Ok(Self {
            planned,
            rays,
            step_length: R::from_f64(rays.step_length),
            termination: R::from_f64(scene.accuracy.termination),
            variation: R::from_f64(scene.accuracy.variation),
            bound: R::from_f64(refinement_bound(scene.accuracy.variation)),
            clip,
            light,
            paths: paths(of)?,
            size,
            places: ray_places(planned.plan.rays),
        })
    }

    /// Returns ray number `index` through `place` of pixel `[x, y]`, y down; a place is from 0 to 1 across and down.
    fn ray_through(&self, [x, y]: [usize; 2], index: usize, place: [f64; 2]) -> Ray<R> {
        let rays = &self.rays;
        let from = |vector: DVec3| vector.to_array().map(R::from_f64);
        let one = R::from_f64(1.0);
        let across =
            |i: usize, place: f64, n: usize| (R::from_f64(count(i)) + R::from_f64(place)) * R::from_f64(2.0 / count(n));
        let u = across(x, place[0], self.size[0]) - one;
        let v = one - across(y, place[1], self.size[1]);
        let along = |middle: [R; 3], right: [R; 3], up: [R; 3]| -> [R; 3] {
            std::array::from_fn(|axis| v.mul_add(up[axis], u.mul_add(right[axis], middle[axis])))
        };
        let base = along(from(rays.base), from(rays.base_u), from(rays.base_v));
        let slant = along(from(rays.direction), from(rays.direction_u), from(rays.direction_v));
        let (spread_u, spread_v) = (R::from_f64(rays.spread_u), R::from_f64(rays.spread_v));
        let length = (v * v).mul_add(spread_v, (u * u).mul_add(spread_u, one)).sqrt();
        let direction = slant.map(|component| component / length);

        // Steps are numbered from the volume's box; crop box and clip planes select some of them, and parts of the first and
        // the last.
        // Rays start at the eye.
        let eye = -(R::from_f64(rays.eye_distance) * length);
        let clip = |low: [R; 3], high: [R; 3]| {
            (0..3).fold([eye, R::from_f64(FAR)], |[near, far], axis| {
                let [enter, leave] = between(base[axis], direction[axis], low[axis], high[axis]);
                [near.max(enter), far.min(leave)]
            })
        };
        let [mut start, _] = clip(from(rays.low), from(rays.high));
        if self.planned.plan.jitter {
            start = start - R::from_f64(ray_phase([x, y], phase_of_ray(index))) * self.step_length;
        }
        let shown = clip(from(rays.crop_low), from(rays.crop_high));
        let [near, far] = self.clip.left(base, direction, shown);
        let zero = R::default();
        let steps = |s: R| ((s - start) / self.step_length).max(zero);
        let first = steps(near).floor();
        let inside = [steps(near) - first, steps(far) - first];
        let samples = if far > near { inside[1].ceil().index().min(rays.samples as usize) } else { 0 };
        let own = self.clip.own(base, direction).map(|own| own.in_steps(start, self.step_length, first));
        let local_scale = from(rays.local_scale);
        let view = std::array::from_fn(|axis| -(direction[axis] * local_scale[axis]));
        Ray { base, direction, start, first, inside, samples, own, view }
    }

    /// Steps of `ray` whose samples lie in the marched block.
    fn within_block(&self, ray: &Ray<R>) -> Range<usize> {
        let all = 0..ray.samples;
        let Some(block) = &self.rays.block else { return all };
        let from = |vector: DVec3| vector.to_array().map(R::from_f64);
        let far = R::from_f64(FAR);
        let [low, high] = [from(block.low), from(block.high)];
        let [enter, leave] = (0..3).fold([-far, far], |[near, far], axis| {
            let [enter, leave] = between(ray.base[axis], ray.direction[axis], low[axis], high[axis]);
            [near.max(enter), far.min(leave)]
        });
        // A ray in the face between two blocks belongs to the upper one.
        let in_face = (0..3).any(|axis| {
            block.open[axis] && ray.direction[axis].abs() < R::from_f64(1e-30) && ray.base[axis] == high[axis]
        });
        if in_face || ray.samples == 0 {
            return 0..0;
        }
        // The first sample at or behind `s`: a cut step has its sample in the middle of its part.
        let half = R::from_f64(0.5);
        let last = ray.samples - 1;
        let middle = |n: usize| {
            let [from, to] = ray.part(n);
            R::from_f64(count(n)) + (from + to) * half
        };
        let first_behind = |s: R| {
            let steps = (s - ray.start) / self.step_length - ray.first;
            if steps <= middle(0) {
                0
            } else if steps > middle(last) {
                ray.samples
            } else {
                (steps - half).ceil().index().clamp(1, last.max(1))
            }
        };
        first_behind(enter)..first_behind(leave)
    }

    /// Marches `ray`: adds the light of its steps to `sums`, position by position, and returns the transmittance. Calls
    /// `seen` for each sample before compositing it; `seen` returns whether to continue.
    fn march_along(
        &self,
        samples: &dyn Samples<R>,
        ray: &Ray<R>,
        sums: &mut [R],
        mut seen: impl FnMut(&RaySample<'_, R>) -> bool,
    ) -> Vec<R> {
        if self.planned.plan.integration == Integrate::Segments {
            return self.march_segments(samples, ray, sums, seen);
        }
        if self.planned.plan.blending.is_extreme() {
            return self.march_extremes(samples, ray, sums, seen);
        }
        if self.planned.plan.integration == Integrate::Refined {
            return self.march_refined(samples, ray, sums, seen);
        }
        let mixed = self.planned.plan.transmittance == Transmittance::Mixed;
        let plan = &self.planned.plan;
        let mut transmittance = self.all_light();
        let (mut read, mut closed, mut scratch) = (Step::default(), Step::default(), Scratch::default());
        let mut lost = self.lost(sums.len(), transmittance.len());
        for (n, place) in self.occupied(samples, ray) {
            let [from, to] = ray.part(n);
            if let Some(own) = &ray.own {
                let first = R::from_f64(count(n));
                read.parts = own.parts([first + from, first + to]);
            }
            samples.sample(place, &mut read);
            let length = to - from;
            let step = effect(plan, &mut read, length, &mut closed);
            if !seen(&RaySample { index: n, place, length, transmittance: &transmittance }) {
                break;
            }
            if step.does_nothing() {
                continue;
            }
            step.normal = samples.normal(place);
            let at = At { view: ray.view, place, step, transmittance: &transmittance };
            self.light.add(&at, samples, sums, &mut lost, &mut scratch);
            let others = std::mem::take(&mut step.others);
            for (mut other, normal) in others.into_iter().zip(samples.normals_of_others(place)) {
                std::mem::swap(&mut step.source, &mut other);
                step.normal = normal;
                let at = At { view: ray.view, place, step, transmittance: &transmittance };
                self.light.add(&at, samples, sums, &mut lost, &mut scratch);
            }
            if mixed {
                transmittance = attenuate_matrix(&transmittance, &step.opacity, plan.components());
            } else {
                attenuate_all(&mut transmittance, &step.opacity, lost.as_mut());
            }
            if transmittance.iter().all(|&left| left.abs() < self.termination) {
                break;
            }
        }
        transmittance
    }

    /// Numbers of the steps of `ray` that are not in empty space, and the places of their middles.
    fn occupied<'s>(
        &'s self,
        samples: &'s dyn Samples<R>,
        ray: &'s Ray<R>,
    ) -> impl Iterator<Item = (usize, [R; 3])> + 's {
        let (mut steps, mut leave) = (self.within_block(ray), 0);
        let along = ray.direction.map(|part| part * self.step_length);
        std::iter::from_fn(move || {
            while let Some(n) = steps.next() {
                let [from, to] = ray.part(n);
                let place = ray.place(n, (from + to) * R::from_f64(0.5), self.step_length);
                if n >= leave {
                    let (is_occupied, ahead) = samples.ahead(place, along);
                    leave = n.saturating_add(ahead);
                    if !is_occupied {
                        steps.start = leave.min(steps.end);
                        continue;
                    }
                }
                return Some((n, place));
            }
            None
        })
    }

    /// [`Self::march_along`] for the extreme value of each field alone (docs/theory/march.md): their media, an opacity length of each.
    /// `seen` is called for the samples that hold them, the first of equal ones. Twin of `shaders/extremes.wgsl`.
    fn march_extremes(
        &self,
        samples: &dyn Samples<R>,
        ray: &Ray<R>,
        sums: &mut [R],
        mut seen: impl FnMut(&RaySample<'_, R>) -> bool,
    ) -> Vec<R> {
        let plan = &self.planned.plan;
        let mut transmittance = self.all_light();
        let mut extremes: SmallVec<[Option<Extreme<R>>; FIELDS]> = SmallVec::new();
        for (n, place) in self.occupied(samples, ray) {
            let values = samples.values(place);
            extremes.resize(values.len(), None);
            for (extreme, value) in extremes.iter_mut().zip(values) {
                let Some(value) = value else { continue };
                let is_beyond = |other: R| match plan.blending {
                    Blending::Minimum => value < other,
                    Blending::Composite | Blending::Maximum => value > other,
                };
                if extreme.is_none_or(|other| is_beyond(other.value)) {
                    *extreme = Some(Extreme { value, index: n, place });
                }
            }
        }
        let mut held: Vec<(usize, [R; 3])> = extremes.iter().flatten().map(|it| (it.index, it.place)).collect();
        held.sort_by_key(|&(n, _)| n);
        held.dedup_by_key(|&mut (n, _)| n);
        let Some(&(_, place)) = held.first() else { return transmittance };
        let one = R::from_f64(1.0);
        for (index, place) in held {
            if !seen(&RaySample { index, place, length: one, transmittance: &transmittance }) {
                return transmittance;
            }
        }
        let (mut density, mut step, mut scratch) = (Step::default(), Step::default(), Scratch::default());
        let values: Values<R> = extremes.iter().map(|extreme| extreme.map(|it| it.value)).collect();
        samples.density_of(&values, &mut density);
        across(&density, one, plan.lanes() * LANE, &mut step);
        let at = At { view: ray.view, place, step: &step, transmittance: &transmittance };
        self.light.add(&at, samples, sums, &mut None, &mut scratch);
        attenuate_all(&mut transmittance, &step.opacity, None);
        transmittance
    }

    /// [`Self::march_along`] in segments (docs/theory/segments.md): each step is a segment between two ends, divided
    /// where the medium or the normal changes. A segment depends on the ray and the volume alone.
    fn march_segments(
        &self,
        samples: &dyn Samples<R>,
        ray: &Ray<R>,
        sums: &mut [R],
        mut seen: impl FnMut(&RaySample<'_, R>) -> bool,
    ) -> Vec<R> {
        let (zero, one, half) = (R::default(), R::from_f64(1.0), R::from_f64(0.5));
        let mut transmittance = self.all_light();
        let (mut density, mut step, mut scratch) = (Step::default(), Step::default(), Scratch::default());
        let mut lost = self.lost(sums.len(), transmittance.len());
        // The end of the segment before, and its number.
        let mut known: Option<(usize, End<R>)> = None;
        // Place at a fraction of the part of step `n` that is left.
        let place = |n: usize, fraction: R| {
            let [from, to] = ray.part(n);
            ray.place(n, (to - from).mul_add(fraction, from), self.step_length)
        };
        for (n, _) in self.occupied(samples, ray) {
            let [from, to] = ray.part(n);
            let inside = to - from;
            let before =
                known.filter(|(last, _)| last + 1 == n).map_or_else(|| samples.end(place(n, zero)), |(_, end)| end);
            let after = samples.end(place(n, one));
            let varied = samples.mean([&before, &after], place(n, half), &mut density);
            let parts = self.parts([&before, &after], varied, &density);
            let (mut from, mut done) = (before, zero);
            for part in 1..=parts.ceil().index() {
                let number = R::from_f64(count(part));
                let (end, to) = if number < parts {
                    let end = number / parts;
                    (end, samples.end(place(n, end)))
                } else {
                    (one, after)
                };
                let middle = place(n, (done + end) * half);
                let length = (end - done) * inside;
                samples.mean([&from, &to], middle, &mut density);
                across(&density, length, self.planned.plan.lanes() * LANE, &mut step);
                step.normal = samples.normal_between([&from, &to], middle);
                if !seen(&RaySample { index: n, place: middle, length, transmittance: &transmittance }) {
                    return transmittance;
                }
                let at = At { view: ray.view, place: middle, step: &step, transmittance: &transmittance };
                self.light.add(&at, samples, sums, &mut lost, &mut scratch);
                attenuate_all(&mut transmittance, &step.opacity, lost.as_mut());
                if transmittance.iter().all(|&left| left.abs() < self.termination) {
                    return transmittance;
                }
                (from, done) = (to, end);
            }
            known = Some((n, after));
        }
        transmittance
    }

    /// [`Self::march_along`] with steps that are refined (docs/theory/refinement.md): one sample in the middle, and one more at each end where
    /// the medium differs from that of the sample beside. Twin of `shaders/refined.wgsl`.
    fn march_refined(
        &self,
        samples: &dyn Samples<R>,
        ray: &Ray<R>,
        sums: &mut [R],
        mut seen: impl FnMut(&RaySample<'_, R>) -> bool,
    ) -> Vec<R> {
        let (half, one) = (R::from_f64(0.5), R::from_f64(1.0));
        let mut transmittance = self.all_light();
        let (mut step, mut scratch) = (Step::default(), Scratch::default());
        let mut lost = self.lost(sums.len(), transmittance.len());
        let density_at = |place: [R; 3]| {
            let mut density = Step::default();
            samples.sample(place, &mut density);
            density.normal = samples.normal(place);
            density
        };
        let at = |place: [R; 3]| Known { density: density_at(place), crossing: samples.crossing(place) };
        // Places of samples in steps from the beginning of step n, whole steps beyond the ray.
        let middle = |n: usize| {
            let [from, to] = if n < ray.samples { ray.part(n) } else { [R::default(), one] };
            (from + to) * half
        };
        let behind = |n: usize| {
            let place = n.checked_sub(1).map(|before| ray.place(before, middle(before), self.step_length));
            at(place.unwrap_or_else(|| ray.place(0, -half, self.step_length)))
        };
        // The samples of a step and of the one ahead, and its number.
        let mut known: Option<(usize, [Known<R>; 2])> = None;
        for (n, place) in self.occupied(samples, ray) {
            let [from, to] = ray.part(n);
            let length = to - from;
            let [behind, here] = match known.take() {
                Some((last, samples)) if last + 1 == n => samples,
                _ => [behind(n), at(place)],
            };
            let ahead = at(ray.place(n + 1, middle(n + 1), self.step_length));
            // A part of a picture does not know the light that is left.
            let left = if self.rays.block.is_some() {
                one
            } else {
                transmittance.iter().fold(R::default(), |most, &left| most.max(left))
            };
            let outer = [self.rise(&behind, &here), self.rise(&here, &ahead)];
            let outer = outer.map(|rise| outer_part(left * rise, self.bound));
            let places = [from + outer[0] * length * half, to - outer[1] * length * half];
            let places = places.map(|within| ray.place(n, within, self.step_length));
            let mut parts: SmallVec<[Part<R>; 3]> = SmallVec::new();
            let part = |end: usize| {
                let place = places[end];
                Part { place, density: density_at(place), length: outer[end] * length }
            };
            parts.extend((outer[0] > R::default()).then(|| part(0)));
            parts.push(Part { place, density: here.density.clone(), length: (one - outer[0] - outer[1]) * length });
            parts.extend((outer[1] > R::default()).then(|| part(1)));
            known = Some((n, [here, ahead]));
            for Part { place, density, length } in parts {
                across(&density, length, self.planned.plan.lanes() * LANE, &mut step);
                step.normal = density.normal;
                if !seen(&RaySample { index: n, place, length, transmittance: &transmittance }) {
                    return transmittance;
                }
                if step.does_nothing() {
                    continue;
                }
                let at = At { view: ray.view, place, step: &step, transmittance: &transmittance };
                self.light.add(&at, samples, sums, &mut lost, &mut scratch);
                attenuate_all(&mut transmittance, &step.opacity, lost.as_mut());
                if transmittance.iter().all(|&left| left.abs() < self.termination) {
                    return transmittance;
                }
            }
        }
        transmittance
    }

    /// Difference between the media of two samples: the largest of the numbers that they scatter and hide and of what lies between their
    /// values, and half of the turn of the normal, times what both scatter.
    fn rise(&self, one: &Known<R>, other: &Known<R>) -> R {
        let (a, b) = (&one.density, &other.density);
        let difference =
            |a: &[R], b: &[R]| a.iter().zip(b).fold(R::default(), |most, (&a, &b)| most.max((a - b).abs()));
        let lit = |step: &Step<R>| step.source.iter().fold(R::default(), |most, &lit| most.max(lit.abs()));
        let rise = difference(&a.source, &b.source).max(difference(&a.opacity, &b.opacity));
        let rise = rise.max(Crossing::between(&one.crossing, &other.crossing));
        if !self.planned.plan.shades_by_gradient() {
            return rise;
        }
        let turn: [R; 3] = std::array::from_fn(|axis| b.normal[axis] - a.normal[axis]);
        let both = lit(a).min(lit(b));
        (dot(turn, turn).sqrt() * R::from_f64(0.5)).mul_add(both, rise)
    }

    /// Number of parts of a segment, 1 to [`MOST_PARTS`], not necessarily whole: the last part is shorter, so that a
    /// picture depends continuously on the data. `density` is the segment's mean, and `varied` its variation.
    fn parts(&self, [a, b]: [&End<R>; 2], varied: R, density: &Step<R>) -> R {
        let mut variation = varied;
        if self.planned.plan.gradient() {
            let (one, other) = (unit(a.gradient), unit(b.gradient));
            let turn: [R; 3] = std::array::from_fn(|axis| other[axis] - one[axis]);
            let most = density.source.iter().fold(R::default(), |most, &number| most.max(number.abs()));
            variation = dot(turn, turn).sqrt().mul_add(most, variation);
        }
        let one = R::from_f64(1.0);
        (variation.min(one) / self.variation).sqrt().max(one).min(R::from_f64(MOST_PARTS.into()))
    }

    /// What rounding took so far from this many sums and numbers of the transmittance: nothing. `None` if the plan does not
    /// compensate.
    fn lost(&self, sums: usize, transmittance: usize) -> Option<Lost<R>> {
        let nothing = |numbers: usize| vec![R::default(); numbers];
        self.planned.plan.compensated.then(|| Lost { sums: nothing(sums), transmittance: nothing(transmittance) })
    }

    /// Initial transmittance: 1 per number, or the identity matrix.
    fn all_light(&self) -> Vec<R> {
        let (numbers, components) = (self.planned.plan.transmittance_numbers(), self.planned.plan.components());
        let is_one =
            |n: usize| self.planned.plan.transmittance != Transmittance::Mixed || n.is_multiple_of(components + 1);
        (0..numbers).map(|n| if is_one(n) { R::from_f64(1.0) } else { R::default() }).collect()
    }

    /// The light that a sample of `ray` scatters towards the eye, of a unit of mean intensity; `None` if there is none.
    fn seen(&self, samples: &dyn Samples<R>, ray: &Ray<R>, sample: &RaySample<'_, R>) -> Option<Seen> {
        let plan = &self.planned.plan;
        let mut read = Step::default();
        if let Some(own) = &ray.own {
            let first = R::from_f64(count(sample.index));
            let [from, to] = ray.part(sample.index);
            read.parts = own.parts([first + from, first + to]);
        }
        samples.sample(sample.place, &mut read);
        let mut closed = Step::default();
        let step = effect(plan, &mut read, sample.length, &mut closed);
        let mut unshaded = self.light.unshaded(&step.source);
        for other in &step.others {
            unshaded.iter_mut().zip(self.light.unshaded(other)).for_each(|(sum, part)| *sum = *sum + part);
        }
        let left = sample.transmittance.iter().cycle();
        let light: Vec<f64> = unshaded.iter().zip(left).map(|(&own, &left)| (own * left).to_f64()).collect();
        light.iter().any(|&light| light != 0.0).then(|| Seen { place: sample.place.map(Real::to_f64), light })
    }

    /// [`Self::march_along`] for ray number `i` through `place` of a pixel, with its paths of light that has scattered before.
    fn march_with_paths(
        &self,
        samples: &dyn Samples<R>,
        (pixel, i, place): ([usize; 2], usize, [f64; 2]),
        sums: &mut [R],
        mut seen: impl FnMut(&RaySample<'_, R>) -> bool,
    ) -> Vec<R> {
        let ray = self.ray_through(pixel, i, place);
        let mut starts = Vec::new();
        let left = self.march_along(samples, &ray, sums, |sample| {
            if self.paths.is_some() {
                starts.extend(self.seen(samples, &ray, sample));
            }
            seen(sample)
        });
        if let Some(paths) = &self.paths {
            let mut light = vec![0.0; sums.len()];
            paths.add(&starts, (pixel, i), &mut light);
            sums.iter_mut().zip(light).for_each(|(sum, light)| *sum = *sum + R::from_f64(light));
        }
        left
    }

    /// Marches and stores pixel `[x, y]`, the mean of its rays, and returns `finish(sums, transmittance)`.
    fn finished<T>(&self, samples: &dyn Samples<R>, pixel: [usize; 2], finish: impl Fn(&[R], &[R]) -> T) -> T {
        let (mut sums, mut transmittance) = (Vec::new(), Vec::new());
        for (i, &place) in self.places.iter().enumerate() {
            let mut of_ray = vec![R::default(); self.planned.plan.components() * self.planned.positions.len()];
            let left = self.march_with_paths(samples, (pixel, i, place), &mut of_ray, |_| true);
            if i == 0 {
                (sums, transmittance) = (of_ray, left);
                continue;
            }
            let share = R::from_f64(1.0 / count(i + 1));
            let added = of_ray.into_iter().chain(left);
            for (mean, added) in sums.iter_mut().chain(&mut transmittance).zip(added) {
                *mean = share.mul_add(added - *mean, *mean);
            }
        }
        store(&self.planned.plan, &mut sums, &mut transmittance);
        finish(&sums, &transmittance)
    }
}

/// The effect of a step of this `length` where samples `read` it or, if the plan adds densities, its density.
fn effect<'s, R: Real>(plan: &ScenePlan, read: &'s mut Step<R>, length: R, closed: &'s mut Step<R>) -> &'s mut Step<R> {
    if plan.adds_densities() {
        across(read, length, plan.lanes() * LANE, closed);
        closed
    } else {
        thin([&mut read.source, &mut read.opacity], plan, length);
        read
    }
}

/// Paths of light that has scattered before, if the plan follows these.
fn paths<R: Real>(of: &Marched<'_, R>) -> Result<Option<Paths>, ReferenceError> {
    let wants = of.planned.plan.light.gathered == Some(ScatteringMethod::Paths);
    wants.then(|| Paths::new(of.scene, of.planned, of.samples.volume(), of.progress)).transpose()
}

/// Length of the first or the last part of a step, as a part of it, where its sample and the one beside differ by `rise`: 0 up to `bound`, and a
/// third from one and a half of it on, so that a picture depends continuously on the data.
fn outer_part<R: Real>(rise: R, bound: R) -> R {
    let (zero, one) = (R::default(), R::from_f64(1.0));
    ((rise / bound - one) * R::from_f64(2.0)).max(zero).min(one) * R::from_f64(1.0 / 3.0)
}

/// Range of `s` where the coordinate `base + s·direction` lies between `low` and `high`. For a ray parallel to the
/// faces the range is unbounded or empty.
fn between<R: Real>(base: R, direction: R, low: R, high: R) -> [R; 2] {
    let far = R::from_f64(FAR);
    if direction.abs() < R::from_f64(1e-30) {
        return if low <= base && base <= high { [-far, far] } else { [far, -far] };
    }
    let (a, b) = ((low - base) / direction, (high - base) / direction);
    [a.min(b), a.max(b)]
}

/// [`super::march`], of any numbers.
pub(super) fn march<R: Real>(of: &Marched<'_, R>) -> Result<Film<R>, ReferenceError> {
    let planned = of.planned;
    let kept = planned.plan.components() * planned.positions.len();
    let marched = pixels(of, |sums, transmittance| [sums, transmittance].concat())?;
    let numbers = kept + planned.plan.transmittance_numbers();
    let mut planes = vec![R::default(); numbers * marched.len()];
    for (i, pixel) in marched.iter().enumerate() {
        for (k, &number) in pixel.iter().enumerate() {
            planes[k * marched.len() + i] = number;
        }
    }
    let transmittance = planes.split_off(kept * marched.len());
    Ok(Film { size: of.size, components: planned.plan.components(), accumulators: planes, transmittance })
}

/// [`super::render`], of any numbers.
pub(super) fn render<R: Real>(
    of: &Marched<'_, R>,
    matrices: &RelightMatrices,
) -> Result<Vec<(DVec3, f64)>, ReferenceError> {
    pixels(of, |sums, transmittance| relit_pixel(sums, transmittance, matrices))
}

/// [`super::render_pixels`], of any numbers.
pub(super) fn render_pixels<R: Real>(
    of: &Marched<'_, R>,
    matrices: &RelightMatrices,
    wanted: &[[usize; 2]],
) -> Result<Vec<(DVec3, f64)>, ReferenceError> {
    /// Pixels between two checks for cancellation.
    const AT_ONCE: usize = 32;
    let frame = Frame::<R>::new(of, wanted.len())?;
    let chunks = wanted.len().div_ceil(AT_ONCE);
    let found: Vec<Vec<_>> = in_parallel(chunks, of.progress, |chunk| {
        let pixels = wanted.iter().skip(chunk * AT_ONCE).take(AT_ONCE);
        pixels
            .map(|&pixel| {
                frame.finished(of.samples, pixel, |sums, transmittance| relit_pixel(sums, transmittance, matrices))
            })
            .collect()
    })?;
    Ok(found.concat())
}

/// [`super::march_ray`], of any numbers.
pub(super) fn march_ray<R: Real>(
    of: &Marched<'_, R>,
    pixel: [usize; 2],
    seen: &mut dyn FnMut(&RaySample<'_, R>),
) -> Result<Film<R>, ReferenceError> {
    /// Samples between two checks for cancellation.
    const AT_ONCE: usize = 1024;
    let Marched { planned, progress, .. } = *of;
    let frame = Frame::<R>::new(of, 1)?;
    let mut accumulators = vec![R::default(); planned.plan.components() * planned.positions.len()];
    let of_middle = (pixel, 0, [0.5; 2]);
    let mut transmittance = frame.march_with_paths(of.samples, of_middle, &mut accumulators, |sample| {
        seen(sample);
        sample.index % AT_ONCE > 0 || !progress.cancelled()
    });
    if progress.cancelled() {
        return Err(ReferenceError::Cancelled);
    }
    store(&planned.plan, &mut accumulators, &mut transmittance);
    Ok(Film { size: [1, 1], components: planned.plan.components(), accumulators, transmittance })
}

/// Marches every pixel and returns `finish(sums, transmittance)` of each.
fn pixels<R: Real, T: Send>(
    of: &Marched<'_, R>,
    finish: impl Fn(&[R], &[R]) -> T + Sync,
) -> Result<Vec<T>, ReferenceError> {
    let Marched { samples, size, progress, .. } = *of;
    let frame = Frame::<R>::new(of, size[0] * size[1])?;
    let rows = in_parallel(size[1], progress, |y| -> Vec<T> {
        (0..size[0]).map(|x| frame.finished(samples, [x, y], &finish)).collect()
    })?;
    Ok(rows.into_iter().flatten().collect())
}

/// Returns `part(i)` for each of `parts` parts, computed in parallel, with progress and cancellation.
fn in_parallel<T: Send>(
    parts: usize,
    progress: &dyn Progress,
    part: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>, ReferenceError> {
    let done = std::sync::atomic::AtomicU64::new(0);
    let made = parallel::map(parts, &|i| {
        if progress.cancelled() {
            return Err(ReferenceError::Cancelled);
        }
        let part = part(i);
        let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
        progress.report("marching the reference", done, parts as u64);
        Ok(part)
    });
    made.into_iter().collect()
}
