//! Front-to-back march along rays. Twin of `shaders/march.wgsl`, with the runs of `samples.wgsl` and `segments.wgsl`.

use std::ops::Range;

use glam::DVec3;

use super::gradient::thin;
use super::phase::{Phase, add_even, add_scattered};
use super::shadows::Reaching;
use super::thin_film::ThinFilm;
use super::{End, ReferenceError, Samples, Step, store};
use crate::film::relit_pixel;
use crate::film::{Film, RelightMatrices};
use crate::plan::{Accumulate, Integrate, LANE, MOST_PARTS, Planned, PositionCounts, Shares, Transmittance};
use crate::tables::{self, PositionTable, RayTable, ray_places};
use crate::{Material, Scene, THREE_POINT_PARTS};
use relume_base::number::{Real, count, dot, power, unit};
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
    /// Where the ray enters and leaves the crop box, in steps from the beginning of the first step.
    inside: [R; 2],
    /// Number of samples.
    samples: usize,
    /// Direction to the eye in the volume's axes.
    view: [R; 3],
}

impl<R: Real> Ray<R> {
    /// Where the part of step `n` inside the crop box begins and ends, in steps from the beginning of that step.
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
    /// Index from 0 at the first sample in the crop box.
    pub index: usize,
    /// Position in texture coordinates.
    pub place: [R; 3],
    /// Length in steps: 1, less for a step that is cut by the crop box and for a part of a segment.
    pub length: R,
    /// Transmittance from the sample to the eye.
    pub transmittance: &'a [R],
}

/// Constants of a frame.
struct Frame<'a, R> {
    scene: &'a Scene,
    planned: &'a Planned,
    rays: RayTable,
    /// Vectors of the positions, and their weights.
    lights: Vec<([R; 3], R)>,
    step_length: R,
    termination: R,
    variation: R,
    /// Specular exponents.
    exponents: Vec<u32>,
    /// Phase functions of the components.
    phases: Vec<Phase<R>>,
    /// Thin films, those of the diffuse part first.
    thin_films: Vec<ThinFilm<R>>,
    /// Light that reaches a sample, if the medium dims light other than a headlight's.
    reaching: Option<Reaching<R>>,
    size: [usize; 2],
    /// Places of the rays in a pixel.
    places: Vec<[f64; 2]>,
}

impl<'a, R: Real> Frame<'a, R> {
    /// The frame of a march of `pixels` pixels.
    fn new(of: &Marched<'a, R>, pixels: usize) -> Result<Self, ReferenceError> {
        let Marched { scene, planned, samples, size, progress } = *of;
        let aspect = count(size[0]) / count(size[1]);
        let view = scene.camera.view(&scene.volume.geometry, aspect).ok_or(ReferenceError::Camera)?;
        let step_length = scene.accuracy.step_length;
        let rays = RayTable::new(scene, &view).ok_or(ReferenceError::TooManySamples { step_length })?;
        let lights = PositionTable::new(scene, planned).0;
        let reaching = if planned.plan.grid_lights() == 0 {
            None
        } else {
            Some(Reaching::new(scene, planned, samples, rays.local_scale, pixels, progress)?)
        };
        Ok(Self {
            scene,
            planned,
            rays,
            lights: lights
                .into_iter()
                .map(|light| (light.truncate().to_array().map(R::from_f64), R::from_f64(light.w)))
                .collect(),
            step_length: R::from_f64(rays.step_length),
            termination: R::from_f64(scene.accuracy.termination),
            variation: R::from_f64(scene.accuracy.variation),
            exponents: planned.exponents(scene),
            phases: tables::Phase::of_plan(scene, planned).iter().map(Phase::new).collect(),
            thin_films: tables::ThinFilmRows::of_plan(scene, planned).iter().map(ThinFilm::new).collect(),
            reaching,
            size,
            places: ray_places(planned.plan.rays),
        })
    }

    /// Returns the ray through `place` of pixel `[x, y]`, y down; a place is from 0 to 1 across and down.
    fn ray_through(&self, [x, y]: [usize; 2], place: [f64; 2]) -> Ray<R> {
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

        // Steps are numbered from the volume's box; the crop box selects some of them, and parts of the first and the last.
        // Rays start at the eye.
        let eye = -(R::from_f64(rays.eye_distance) * length);
        let clip = |low: [R; 3], high: [R; 3]| {
            (0..3).fold([eye, R::from_f64(FAR)], |[near, far], axis| {
                let [enter, leave] = between(base[axis], direction[axis], low[axis], high[axis]);
                [near.max(enter), far.min(leave)]
            })
        };
        let [start, _] = clip(from(rays.low), from(rays.high));
        let [near, far] = clip(from(rays.crop_low), from(rays.crop_high));
        let zero = R::default();
        let steps = |s: R| ((s - start) / self.step_length).max(zero);
        let first = steps(near).floor();
        let inside = [steps(near) - first, steps(far) - first];
        let samples = if far > near { inside[1].ceil().index().min(rays.samples as usize) } else { 0 };
        let local_scale = from(rays.local_scale);
        let view = std::array::from_fn(|axis| -(direction[axis] * local_scale[axis]));
        Ray { base, direction, start, first, inside, samples, view }
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
        let mixed = self.planned.plan.transmittance == Transmittance::Mixed;
        let mut transmittance = self.all_light();
        let (mut step, mut reached) = (Step::default(), Reached::default());
        let mut source = vec![R::default(); self.planned.plan.components()];
        let mut lost = self.lost(sums.len(), transmittance.len());
        for n in self.within_block(ray) {
            let [from, to] = ray.part(n);
            let place = ray.place(n, (from + to) * R::from_f64(0.5), self.step_length);
            samples.sample(place, &mut step);
            let length = to - from;
            thin([&mut step.source, &mut step.opacity], &self.planned.plan, length);
            if !seen(&RaySample { index: n, place, length, transmittance: &transmittance }) {
                break;
            }
            if step.does_nothing() {
                continue;
            }
            let sky = self.sky_light(place, samples);
            for (position, sums) in sums.chunks_exact_mut(source.len().max(1)).enumerate() {
                self.light(position, place, samples, (&transmittance, &step, sky), &mut reached);
                self.shade(position, ray, place, &step, &reached, &mut source);
                if mixed {
                    composite_matrix(sums, &source, &transmittance);
                } else if let Some(lost) = &mut lost {
                    composite_compensated(sums, lost.of_position(position, source.len()), &source, &transmittance);
                } else {
                    composite(sums, &source, &transmittance);
                }
            }
            if mixed {
                transmittance = attenuate_matrix(&transmittance, &step.opacity, source.len());
            } else {
                attenuate_all(&mut transmittance, &step.opacity, lost.as_mut());
            }
            if transmittance.iter().all(|&left| left.abs() < self.termination) {
                break;
            }
        }
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
        let (mut density, mut step, mut reached) = (Step::default(), Step::default(), Reached::default());
        let mut source = vec![zero; self.planned.plan.components()];
        let mut lost = self.lost(sums.len(), transmittance.len());
        let steps = self.within_block(ray);
        if steps.is_empty() {
            return transmittance;
        }
        // Place at a fraction of the part of step `n` inside the crop box.
        let place = |n: usize, fraction: R| {
            let [from, to] = ray.part(n);
            ray.place(n, (to - from).mul_add(fraction, from), self.step_length)
        };
        let mut before = samples.end(place(steps.start, zero));
        for n in steps {
            let [from, to] = ray.part(n);
            let inside = to - from;
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
                step.normal = unit(std::array::from_fn(|axis| (from.gradient[axis] + to.gradient[axis]) * half));
                if !seen(&RaySample { index: n, place: middle, length, transmittance: &transmittance }) {
                    return transmittance;
                }
                let sky = self.sky_light(middle, samples);
                for (position, sums) in sums.chunks_exact_mut(source.len().max(1)).enumerate() {
                    self.light(position, middle, samples, (&transmittance, &step, sky), &mut reached);
                    self.shade(position, ray, middle, &step, &reached, &mut source);
                    if let Some(lost) = &mut lost {
                        composite_compensated(sums, lost.of_position(position, source.len()), &source, &transmittance);
                    } else {
                        composite(sums, &source, &transmittance);
                    }
                }
                attenuate_all(&mut transmittance, &step.opacity, lost.as_mut());
                if transmittance.iter().all(|&left| left.abs() < self.termination) {
                    return transmittance;
                }
                (from, done) = (to, end);
            }
            before = after;
        }
        transmittance
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

    /// Marches and stores pixel `[x, y]`, the mean of its rays, and returns `finish(sums, transmittance)`.
    fn finished<T>(&self, samples: &dyn Samples<R>, pixel: [usize; 2], finish: impl Fn(&[R], &[R]) -> T) -> T {
        let (mut sums, mut transmittance) = (Vec::new(), Vec::new());
        for (i, &place) in self.places.iter().enumerate() {
            let mut of_ray = vec![R::default(); self.planned.plan.components() * self.planned.positions.len()];
            let left = self.march_along(samples, &self.ray_through(pixel, place), &mut of_ray, |_| true);
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

    /// Fraction of the light of the sky that reaches `place`; 1 if the medium does not dim it.
    fn sky_light(&self, place: [R; 3], samples: &dyn Samples<R>) -> R {
        let sky = self.reaching.as_ref().zip(self.planned.plan.sky());
        let mut reached = [R::from_f64(1.0)];
        if let Some((reaching, number)) = sky {
            reaching.light(number, place, samples, &mut reached);
        }
        reached[0]
    }

    /// Sets `reached` to the light at `position` that reaches the step at `place`, whose light reaches the eye with this
    /// transmittance, under this light of the `sky`.
    fn light(
        &self,
        position: usize,
        place: [R; 3],
        samples: &dyn Samples<R>,
        (transmittance, step, sky): (&[R], &Step<R>, R),
        reached: &mut Reached<R>,
    ) {
        let plan = &self.planned.plan;
        let shadowed = plan.shadowed();
        let one = R::from_f64(1.0);
        reached.components = if plan.absorbers() > 0 { plan.components() } else { 1 };
        reached.light.clear();
        reached.light.resize(3 * reached.components, one);
        let occluded = plan.shadows.is_some_and(|shadows| shadows.occluded) && position >= plan.positions.ambient;
        reached.ambient = if occluded { sky } else { one };
        // Of all lights but a three-point light only the first is read.
        let mut lights = reached.light.chunks_exact_mut(reached.components);
        let mut set = |number: usize| {
            if let (Some(reaching), Some(light)) = (&self.reaching, lights.next()) {
                reaching.light(number, place, samples, light);
            }
        };
        if plan.shadowed_headlight() == Some(position) {
            // The light shines along the ray of the eye: its mean over the step, (1 − e^(−2τΔs))/(2τ) over (1 − e^(−τΔs))/τ.
            for ((light, &left), &opacity) in reached.light.iter_mut().zip(transmittance).zip(&step.opacity) {
                *light = (-(left * R::from_f64(0.5))).mul_add(opacity, left);
            }
        } else if shadowed.contains(&position) {
            set(position - shadowed.start);
        } else if plan.shadowed_three_point() == Some(position) {
            (0..3).for_each(|i| set(shadowed.len() + i));
        } else if plan.shadowed_points().contains(&position) {
            set(plan.first_point() + position - plan.shadowed_points().start);
        } else if plan.shadowed_ambient() == Some(position) {
            reached.light.fill(sky);
        }
    }

    /// Sets `source` to the light that a step sends to the eye from the light at `position`, as much as has `reached` it:
    /// material weights and white for the highlights, or a spectrum.
    fn shade(
        &self,
        position: usize,
        ray: &Ray<R>,
        place: [R; 3],
        step: &Step<R>,
        reached: &Reached<R>,
        source: &mut [R],
    ) {
        let plan = &self.planned.plan;
        let PositionCounts { ambient, headlight, directional, point, .. } = plan.positions;
        if plan.phases > 0 {
            self.scatter(position, ray, place, step, reached, source);
            return;
        }
        if position < ambient || plan.shading.is_none() {
            source.fill(R::default());
            let first = plan.parts().unshaded * LANE;
            let parts = self.reflected_parts();
            source[..parts].copy_from_slice(&step.source[first..first + parts]);
            let three = plan.shadowed_three_point() == Some(position);
            for (component, part) in source.iter_mut().enumerate() {
                let of = |light| reached.of(light, component);
                *part = *part * if three { mean_of_three([of(0), of(1), of(2)]) } else { of(0) };
            }
            return;
        }
        if position >= ambient + headlight + directional + point {
            self.shade_three_point(position, ray, step, reached, source);
            return;
        }
        source.fill(R::default());
        let light = self.direction(position, ray, place);
        let facing = self.facing(dot(step.normal, light));
        self.reflect(step, |component| facing * reached.of(0, component), reached.ambient, source);
        if plan.specular().is_some() {
            let halfway = unit(std::array::from_fn(|axis| light[axis] + ray.view[axis]));
            let lit = facing > R::default();
            let shine = self.facing(dot(step.normal, halfway));
            let shine = if lit || !self.one_sided() { shine } else { R::default() };
            if self.planned.positions[position].shadows {
                let mut white = vec![R::default(); source.len()];
                self.highlight(step, shine, &mut white);
                // The weight of white is set, not added to.
                source[self.reflected_parts()..].fill(R::default());
                for (component, (part, white)) in source.iter_mut().zip(white).enumerate() {
                    *part = reached.of(0, component).mul_add(white, *part);
                }
            } else {
                self.highlight(step, shine, source);
            }
        }
        self.add_thin_films(light, ray, step, |component| reached.of(0, component), source);
    }

    /// Adds to `source` what thin films reflect from the direction `light`, of which these fractions of the components have
    /// `reached` the step.
    fn add_thin_films(
        &self,
        light: [R; 3],
        ray: &Ray<R>,
        step: &Step<R>,
        reached: impl Fn(usize) -> R,
        source: &mut [R],
    ) {
        let plan = &self.planned.plan;
        if self.thin_films.is_empty() {
            return;
        }
        let along = dot(step.normal, light);
        let facing = self.facing(along);
        let halfway = unit(std::array::from_fn(|axis| light[axis] + ray.view[axis]));
        let shine = self.facing(dot(step.normal, halfway));
        let shine = if facing > R::default() || !self.one_sided() { shine } else { R::default() };
        for (i, film) in self.thin_films.iter().enumerate() {
            let (cosine, shade) = if i < plan.thin_films.facing {
                (R::from_f64(0.5) * (along.abs() + dot(step.normal, ray.view).abs()), facing)
            } else {
                (dot(light, halfway).abs(), power(shine, film.exponent))
            };
            film.add(plan, i, step, cosine, |component| shade * reached(component), source);
        }
    }

    /// Unit vector from `place` to the light at `position`, which is neither ambient nor a three-point light.
    fn direction(&self, position: usize, ray: &Ray<R>, place: [R; 3]) -> [R; 3] {
        let PositionCounts { ambient, headlight, directional, .. } = self.planned.plan.positions;
        if position < ambient + headlight {
            ray.view
        } else if position < ambient + headlight + directional {
            self.lights[position].0
        } else {
            let local_scale = self.rays.local_scale.to_array().map(R::from_f64);
            unit(std::array::from_fn(|axis| self.lights[position].0[axis] - place[axis] * local_scale[axis]))
        }
    }

    /// As [`Self::shade`], without shading and by phase functions.
    fn scatter(
        &self,
        position: usize,
        ray: &Ray<R>,
        place: [R; 3],
        step: &Step<R>,
        reached: &Reached<R>,
        source: &mut [R],
    ) {
        let plan = &self.planned.plan;
        let PositionCounts { ambient, three_point, .. } = plan.positions;
        source.fill(R::default());
        if position < ambient {
            add_even(plan, step, reached.of(0, 0), source);
            return;
        }
        let mut add = |light: [R; 3], reached: &dyn Fn(usize) -> R| {
            add_scattered(plan, &self.phases, step, [ray.view, light], reached, source);
        };
        if position < plan.positions.total() - three_point {
            add(self.direction(position, ray, place), &|component| reached.of(0, component));
            return;
        }
        let first = plan.positions.first_vector(position);
        let lights = self.lights[first..first + 3].iter().zip(THREE_POINT_PARTS);
        for (i, (&(light, _), part)) in lights.enumerate() {
            add(light, &|component| reached.of(i, component) * R::from_f64(part));
        }
    }

    /// As [`Self::shade`], for the three directions of the light at `position`, and their weights.
    fn shade_three_point(&self, position: usize, ray: &Ray<R>, step: &Step<R>, reached: &Reached<R>, source: &mut [R]) {
        source.fill(R::default());
        let first = self.planned.plan.positions.first_vector(position);
        let lights = &self.lights[first..first + 3];
        let facing = |component: usize| {
            lights.iter().enumerate().fold(R::default(), |sum, (i, &(light, weight))| {
                (weight * reached.of(i, component)).mul_add(self.facing(dot(step.normal, light)), sum)
            })
        };
        self.reflect(step, facing, reached.ambient, source);
        if self.planned.plan.specular().is_some() {
            for (i, &(light, weight)) in lights.iter().enumerate() {
                let halfway = unit(std::array::from_fn(|axis| light[axis] + ray.view[axis]));
                let lit = !self.one_sided() || self.facing(dot(step.normal, light)) > R::default();
                let shine = if lit { self.facing(dot(step.normal, halfway)) } else { R::default() };
                let mut white = vec![R::default(); source.len()];
                self.highlight(step, shine, &mut white);
                for (component, (part, white)) in source.iter_mut().zip(white).enumerate() {
                    *part = (weight * reached.of(i, component)).mul_add(white, *part);
                }
            }
        }
        for (i, &(light, weight)) in lights.iter().enumerate() {
            self.add_thin_films(light, ray, step, |component| weight * reached.of(i, component), source);
        }
    }

    /// Whether only the side towards lower values is lit.
    fn one_sided(&self) -> bool {
        self.planned.plan.shading.is_some_and(|terms| terms.one_sided)
    }

    /// |n·l|, or max(n·l, 0) with one-sided lighting, for `cosine` = ∇v·l/|∇v|.
    fn facing(&self, cosine: R) -> R {
        if self.one_sided() { (-cosine).max(R::default()) } else { cosine.abs() }
    }

    /// Number of components, without the white component of the highlights.
    fn reflected_parts(&self) -> usize {
        match self.planned.plan.accumulate {
            Accumulate::Weights { materials } => materials,
            Accumulate::Spectral { dimension, .. } => dimension,
        }
    }

    /// Sets `source` to the diffuse light of a step, by the shade of each component, and to its ambient light of which the
    /// fraction `open` arrives.
    fn reflect(&self, step: &Step<R>, facing: impl Fn(usize) -> R, open: R, source: &mut [R]) {
        let plan = &self.planned.plan;
        let parts = plan.parts();
        let shade = |material: &Material, facing: R| {
            R::from_f64(material.own_diffuse()).mul_add(facing, R::from_f64(material.ambient) * open)
        };
        match plan.accumulate {
            Accumulate::Weights { .. } => {
                for ((part, &weight), material) in source.iter_mut().zip(&step.source).zip(self.used()) {
                    *part = weight * shade(material, facing(0));
                }
            }
            Accumulate::Spectral { shares: Shares::Equal, .. } => {
                let first = self.used().next();
                for (component, (part, &reflected)) in
                    source.iter_mut().zip(&step.source[parts.unshaded * LANE..]).enumerate()
                {
                    *part = reflected * first.map_or(R::default(), |first| shade(first, facing(component)));
                }
            }
            Accumulate::Spectral { shares: Shares::Own, .. } => {
                let [ambient, diffuse] = [parts.ambient, parts.diffuse].map(|first| &step.source[first * LANE..]);
                for (component, ((part, &ambient), &diffuse)) in source.iter_mut().zip(ambient).zip(diffuse).enumerate()
                {
                    *part = diffuse.mul_add(facing(component), ambient * open);
                }
            }
        }
    }

    /// Adds the highlights of a step to `source`.
    fn highlight(&self, step: &Step<R>, facing: R, source: &mut [R]) {
        let plan = &self.planned.plan;
        let parts = plan.parts();
        match (plan.accumulate, plan.transmittance) {
            (Accumulate::Weights { materials }, _) => {
                let mut white = R::default();
                for (&weight, material) in step.source.iter().zip(self.used()) {
                    white = (weight * R::from_f64(material.white_specular()))
                        .mul_add(power(facing, material.exponent), white);
                }
                source[materials] = white;
            }
            (_, Transmittance::Grey) => {
                let whites = self.exponents.iter().zip(&step.source[parts.highlights * LANE..]);
                let white =
                    whites.fold(R::default(), |sum, (&exponent, &white)| white.mul_add(power(facing, exponent), sum));
                source.iter_mut().for_each(|part| *part = *part + white);
            }
            (_, Transmittance::Coloured | Transmittance::Mixed) => {
                for (i, &exponent) in self.exponents.iter().enumerate() {
                    let shine = power(facing, exponent);
                    let whites = &step.source[(parts.highlights + i * plan.lanes()) * LANE..];
                    for (part, &white) in source.iter_mut().zip(whites) {
                        *part = white.mul_add(shine, *part);
                    }
                }
            }
        }
    }

    /// Materials of the plan.
    fn used(&self) -> impl Iterator<Item = &Material> {
        self.planned.materials.iter().filter_map(|&material| self.scene.materials.get(material))
    }
}

/// Sets `step` to the effect of a segment of `length`, in steps, with this mean density: α = 1 − e^(−τ·length), and the
/// scattered light times α/τ. Component c of each `components` numbers of the source has opacity c, or the only one.
fn across<R: Real>(density: &Step<R>, length: R, components: usize, step: &mut Step<R>) {
    let zero = R::default();
    step.opacity.clear();
    step.opacity.extend(density.opacity.iter().map(|&depth| -(-(depth * length)).exp_m1()));
    let gain = |component: usize| {
        let component = if step.opacity.len() == 1 { 0 } else { component };
        match density.opacity.get(component) {
            Some(&depth) if depth > zero && length > zero => step.opacity[component] / depth,
            _ => length,
        }
    };
    let gains: Vec<R> = (0..components.max(1)).map(gain).collect();
    step.source.clear();
    step.source.extend(density.source.iter().enumerate().map(|(i, &lit)| lit * gains[i % gains.len()]));
}

/// Light that reaches a step.
#[derive(Debug, Default)]
struct Reached<R> {
    /// Fractions of each light: one per component with coloured absorbers, otherwise one for all.
    components: usize,
    /// Fractions from each direction of a three-point light; of another light only the first ones count.
    light: Vec<R>,
    /// Fraction of the ambient share of a directed light.
    ambient: R,
}

impl<R: Real> Reached<R> {
    /// Fraction of a `component` of the light number `i`.
    fn of(&self, i: usize, component: usize) -> R {
        self.light[i * self.components + if self.components == 1 { 0 } else { component }]
    }
}

/// A distance beyond any box.
const FAR: f64 = 1e30;

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

/// Mean of the fractions that reach a step from the directions of a three-point light, by their weights.
fn mean_of_three<R: Real>(reached: [R; 3]) -> R {
    let parts = THREE_POINT_PARTS.map(R::from_f64);
    reached.into_iter().zip(parts).fold(R::default(), |sum, (reached, part)| part.mul_add(reached, sum))
}

/// Adds one premultiplied sample front to back, `A += T·s`. T has one number for all components or one per component.
pub fn composite<R: Real>(accumulator: &mut [R], source: &[R], transmittance: &[R]) {
    let lefts = transmittance.iter().cycle();
    for ((sum, &part), left) in accumulator.iter_mut().zip(source).zip(lefts) {
        *sum = left.mul_add(part, *sum);
    }
}

/// What rounding took from the sums and the transmittance of a ray so far (Kahan 1965).
#[derive(Debug)]
struct Lost<R> {
    sums: Vec<R>,
    transmittance: Vec<R>,
}

impl<R> Lost<R> {
    /// Of the sums of this position, which has `components`.
    fn of_position(&mut self, position: usize, components: usize) -> &mut [R] {
        &mut self.sums[position * components..(position + 1) * components]
    }
}

/// `sum + term` as rounded; sets `lost` to what the sum has too much.
fn compensated<R: Real>(sum: R, term: R, lost: &mut R) -> R {
    let total = sum + term;
    *lost = (total - sum) - term;
    total
}

/// [`composite`], with what rounding has `lost`.
fn composite_compensated<R: Real>(accumulator: &mut [R], lost: &mut [R], source: &[R], transmittance: &[R]) {
    let lefts = transmittance.iter().cycle();
    for (((sum, lost), &part), left) in accumulator.iter_mut().zip(lost).zip(source).zip(lefts) {
        *sum = compensated(*sum, left.mul_add(part, -*lost), lost);
    }
}

/// [`attenuate`] for every number, with what rounding has `lost`.
fn attenuate_all<R: Real>(transmittance: &mut [R], opacity: &[R], lost: Option<&mut Lost<R>>) {
    let numbers = transmittance.iter_mut().zip(opacity);
    match lost {
        None => numbers.for_each(|(left, &opacity)| *left = attenuate(*left, opacity)),
        Some(lost) => {
            for ((left, &opacity), lost) in numbers.zip(&mut lost.transmittance) {
                *left = compensated(*left, (-*left).mul_add(opacity, -*lost), lost);
            }
        }
    }
}

/// Returns the transmittance after a step, `T − T·α`, rounded once (`T *= 1 − α` drifts over many equal steps:
/// docs/theory/march.md).
pub fn attenuate<R: Real>(transmittance: R, opacity: R) -> R {
    (-transmittance).mul_add(opacity, transmittance)
}

/// [`composite`] for a row-major matrix T: each component of the sample adds to each of the sum.
pub fn composite_matrix<R: Real>(accumulator: &mut [R], source: &[R], transmittance: &[R]) {
    for (sum, row) in accumulator.iter_mut().zip(transmittance.chunks_exact(source.len().max(1))) {
        for (&left, &part) in row.iter().zip(source) {
            *sum = left.mul_add(part, *sum);
        }
    }
}

/// [`attenuate`] for matrices with `dimension` rows, `T − T·A`.
pub fn attenuate_matrix<R: Real>(transmittance: &[R], opacity: &[R], dimension: usize) -> Vec<R> {
    let mut left = transmittance.to_vec();
    let rows = left.chunks_exact_mut(dimension.max(1)).zip(transmittance.chunks_exact(dimension.max(1)));
    for (row, before) in rows {
        for (&through, opacity) in before.iter().zip(opacity.chunks_exact(dimension.max(1))) {
            for (left, &opacity) in row.iter_mut().zip(opacity) {
                *left = (-through).mul_add(opacity, *left);
            }
        }
    }
    left
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
    let ray = frame.ray_through(pixel, [0.5; 2]);
    let mut transmittance = frame.march_along(of.samples, &ray, &mut accumulators, |sample| {
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
