//! Light that arrives at a step, and what of it goes to the eye. Twin of `shaders/light.wgsl` and of the lines that
//! `render::march::light` writes for it.

use std::sync::Arc;

use super::composite::{Lost, composite, composite_compensated, composite_matrix};
use super::gathered::{Gathered, GatheredLight, TransferRows};
use super::phase::{Phase, add_even, add_scattered};
use super::shadows::Reaching;
use super::thin_film::ThinFilm;
use super::{ReferenceError, Samples, Step};
use crate::plan::{Accumulate, Arrival, LANE, Planned, Share, Shares, Transmittance};
use crate::tables::{self, PositionTable};
use crate::{Direction, Material, ScatteringMethod, Scene};
use relume_base::number::{Real, dot, power, unit};
use relume_base::progress::Progress;
use smallvec::SmallVec;

/// The light of a frame.
pub(super) struct Light<'a, R> {
    planned: &'a Planned,
    /// Vectors of the arrivals, and their weights.
    vectors: Vec<([R; 3], R)>,
    /// Specular exponents.
    exponents: Vec<u32>,
    /// Of the materials of the plan.
    shades: Vec<Shade<R>>,
    /// Phase functions of the components.
    phases: Vec<Phase<R>>,
    /// Thin films, those of the diffuse part first.
    thin_films: Vec<ThinFilm<R>>,
    /// Light that reaches a sample, if the medium dims light other than along rays of the eye.
    reaching: Option<Reaching<R>>,
    /// Light that has scattered before, if its nodes are known.
    gathered: Option<Gathered<R>>,
    local_scale: [R; 3],
}

/// Shading of a material without that of its thin films.
struct Shade<R> {
    ambient: R,
    diffuse: R,
    specular: R,
    exponent: u32,
}

impl<R: Real> Shade<R> {
    fn of(material: &Material) -> Self {
        let [ambient, diffuse, specular] =
            [material.ambient, material.own_diffuse(), material.white_specular()].map(R::from_f64);
        Self { ambient, diffuse, specular, exponent: material.exponent }
    }

    /// The part of its own light that it reflects, of which this arrives as diffuse and the fraction `open` as ambient light.
    fn reflected(&self, facing: R, open: R) -> R {
        self.diffuse.mul_add(facing, self.ambient * open)
    }
}

/// A step of a ray.
pub(super) struct At<'a, R> {
    /// Unit vector towards the eye.
    pub(super) view: [R; 3],
    pub(super) place: [R; 3],
    pub(super) step: &'a Step<R>,
    /// Transmittance from the step to the eye.
    pub(super) transmittance: &'a [R],
}

/// Light that arrives at a step on one way.
#[derive(Clone, Debug, Default)]
struct Arrived<R> {
    /// Unit vector towards the light; `None` if it comes from everywhere.
    direction: Option<[R; 3]>,
    /// Its weight times the part that arrives: one number per component with coloured absorbers, otherwise one.
    share: Vec<R>,
    /// Diffuse shade of a surface.
    facing: R,
}

impl<R: Real> Arrived<R> {
    /// Share of a `component`.
    fn of(&self, component: usize) -> R {
        self.share[if self.share.len() == 1 { 0 } else { component }]
    }
}

/// The sum over `arrived` for each component, by `add(component, way, sum)`: found once where shares have one number.
fn by_component<'a, R: Real>(
    arrived: &'a [Arrived<R>],
    add: impl Fn(usize, &Arrived<R>, R) -> R + 'a,
) -> impl Fn(usize) -> R + 'a {
    let sum = move |component: usize| arrived.iter().fold(R::default(), |sum, way| add(component, way, sum));
    let of_all = arrived.iter().all(|way| way.share.len() == 1).then(|| sum(0));
    move |component| of_all.unwrap_or_else(|| sum(component))
}

/// Memory of [`Light::add`] from step to step.
#[derive(Debug, Default)]
pub(super) struct Scratch<R> {
    arrived: Vec<Arrived<R>>,
    source: Vec<R>,
}

impl<'a, R: Real> Light<'a, R> {
    /// Prepares the light of `planned` for so many `pixels`.
    ///
    /// # Errors
    ///
    /// [`ReferenceError::Cancelled`], [`ReferenceError::LightGrid`].
    pub(super) fn new(
        scene: &'a Scene,
        planned: &'a Planned,
        samples: &dyn Samples<R>,
        local_scale: glam::DVec3,
        pixels: usize,
        progress: &dyn Progress,
    ) -> Result<Self, ReferenceError> {
        let vectors = PositionTable::new(scene, planned).0.into_iter();
        let reaching = if planned.plan.light.grid_lights() == 0 {
            None
        } else {
            Some(Reaching::new(scene, planned, samples, local_scale, pixels, progress)?)
        };
        Ok(Self {
            planned,
            vectors: vectors
                .map(|vector| (vector.truncate().to_array().map(R::from_f64), R::from_f64(vector.w)))
                .collect(),
            exponents: planned.exponents(scene),
            shades: planned
                .materials
                .iter()
                .filter_map(|&material| scene.materials.get(material))
                .map(Shade::of)
                .collect(),
            phases: tables::Phase::of_plan(scene, planned).iter().map(Phase::new).collect(),
            thin_films: tables::ThinFilmRows::of_plan(scene, planned).iter().map(ThinFilm::new).collect(),
            reaching,
            gathered: gathered(scene, planned, samples, progress)?,
            local_scale: local_scale.to_array().map(R::from_f64),
        })
    }

    /// Adds the light that a step sends to the eye to `sums`, accumulator by accumulator.
    pub(super) fn add(
        &self,
        at: &At<'_, R>,
        samples: &dyn Samples<R>,
        sums: &mut [R],
        lost: &mut Option<Lost<R>>,
        Scratch { arrived, source }: &mut Scratch<R>,
    ) {
        let plan = &self.planned.plan;
        source.resize(plan.components(), R::default());
        // The light of the sky is the same for all accumulators.
        let mut sky = [R::from_f64(1.0)];
        if let (Some(reaching), Some(number)) = (&self.reaching, plan.light.sky()) {
            reaching.light(number, at.place, samples, &mut sky);
        }
        let open = if plan.light.occluded { sky[0] } else { R::from_f64(1.0) };
        for (accumulator, sums) in sums.chunks_exact_mut(source.len().max(1)).enumerate() {
            let ways = plan.light.of(accumulator);
            arrived.resize_with(ways.clone().count(), Arrived::default);
            for ((vector, arrival), arrived) in ways.zip(arrived.iter_mut()) {
                self.arrive(at, samples, (vector, arrival), sky[0], arrived);
            }
            self.respond(at, arrived, open, source);
            if let Some(gathered) = &self.gathered {
                gathered.add(accumulator, at.place, &self.unshaded(&at.step.source), source);
            }
            if plan.transmittance == Transmittance::Mixed {
                composite_matrix(sums, source, at.transmittance);
            } else if let Some(lost) = lost {
                let lost = lost.of_position(accumulator, source.len());
                composite_compensated(sums, lost, source, at.transmittance);
            } else {
                composite(sums, source, at.transmittance);
            }
        }
    }

    /// Sets `arrived` to the light of an arrival, under this light of the `sky`.
    fn arrive(
        &self,
        at: &At<'_, R>,
        samples: &dyn Samples<R>,
        (vector, arrival): (usize, Arrival),
        sky: R,
        Arrived { direction, share, facing }: &mut Arrived<R>,
    ) {
        let plan = &self.planned.plan;
        let (towards, weight) = self.vectors[vector];
        *direction = match arrival.direction {
            Direction::Everywhere => None,
            Direction::Eye => Some(at.view),
            Direction::Infinity => Some(towards),
            Direction::Place => {
                Some(unit(std::array::from_fn(|axis| towards[axis] - at.place[axis] * self.local_scale[axis])))
            }
        };
        share.clear();
        share.resize(if plan.light.absorbers > 0 { plan.components() } else { 1 }, R::from_f64(1.0));
        match (arrival.share, &self.reaching) {
            (Share::Open, _) => {}
            (Share::OfRay, _) => {
                // The light shines along the ray of the eye: its mean over the step, (1 − e^(−2τΔs))/(2τ) over (1 − e^(−τΔs))/τ.
                for ((share, &left), &opacity) in share.iter_mut().zip(at.transmittance).zip(&at.step.opacity) {
                    *share = (-(left * R::from_f64(0.5))).mul_add(opacity, left);
                }
            }
            (Share::Behind(_), _) if arrival.direction == Direction::Everywhere => share.fill(sky),
            (Share::Behind(number), Some(reaching)) => reaching.light(number, at.place, samples, share),
            (Share::Behind(_), None) => {}
        }
        share.iter_mut().for_each(|share| *share = weight * *share);
        *facing = direction.map_or(R::default(), |light| self.facing(dot(at.step.normal, light)));
    }

    /// Sets `source` to what a step sends to the eye of the light that has `arrived`, and of ambient shares of which the
    /// fraction `open` arrives: material weights and white for the highlights, or a spectrum.
    fn respond(&self, at: &At<'_, R>, arrived: &[Arrived<R>], open: R, source: &mut [R]) {
        let (plan, step) = (&self.planned.plan, at.step);
        source.fill(R::default());
        if plan.phases > 0 {
            for way in arrived {
                match way.direction {
                    None => add_even(plan, step, way.of(0), source),
                    Some(light) => {
                        let share = |component| way.of(component);
                        add_scattered(plan, &self.phases, step, [at.view, light], share, source);
                    }
                }
            }
            return;
        }
        if plan.shading.is_none() || arrived.iter().all(|way| way.direction.is_none()) {
            let first = plan.parts().unshaded * LANE;
            let reflected = self.reflected_parts();
            let all = by_component(arrived, |component, way, sum| sum + way.of(component));
            for (component, (part, &own)) in source[..reflected].iter_mut().zip(&step.source[first..]).enumerate() {
                *part = own * all(component);
            }
            return;
        }
        let facing = by_component(arrived, |component, way, sum| way.of(component).mul_add(way.facing, sum));
        self.reflect(step, facing, open, source);
        let directed = || arrived.iter().filter_map(|way| way.direction.map(|light| (way, light)));
        if plan.specular().is_some() {
            for (way, light) in directed() {
                let halfway = unit(std::array::from_fn(|axis| light[axis] + at.view[axis]));
                let is_lit = !self.one_sided() || way.facing > R::default();
                let shine = if is_lit { self.facing(dot(step.normal, halfway)) } else { R::default() };
                self.highlight(step, shine, |component| way.of(component), source);
            }
        }
        for (way, light) in directed() {
            self.add_thin_films(light, at, |component| way.of(component), source);
        }
    }

    /// Adds to `source` what thin films reflect from the direction `light`, of which these shares of the components arrive.
    fn add_thin_films(&self, light: [R; 3], at: &At<'_, R>, share: impl Fn(usize) -> R, source: &mut [R]) {
        let plan = &self.planned.plan;
        if self.thin_films.is_empty() {
            return;
        }
        let (step, view) = (at.step, at.view);
        let along = dot(step.normal, light);
        let facing = self.facing(along);
        let halfway = unit(std::array::from_fn(|axis| light[axis] + view[axis]));
        let shine = self.facing(dot(step.normal, halfway));
        let shine = if facing > R::default() || !self.one_sided() { shine } else { R::default() };
        for (i, film) in self.thin_films.iter().enumerate() {
            let (cosine, shade) = if i < plan.thin_films.facing {
                (R::from_f64(0.5) * (along.abs() + dot(step.normal, view).abs()), facing)
            } else {
                (dot(light, halfway).abs(), power(shine, film.exponent))
            };
            film.add(plan, i, step, cosine, |component| shade * share(component), source);
        }
    }

    /// True if only the side towards lower values is lit.
    fn one_sided(&self) -> bool {
        self.planned.plan.shading.is_some_and(|terms| terms.one_sided)
    }

    /// |n·l|, or max(n·l, 0) with one-sided lighting, for `cosine` = ∇v·l/|∇v|.
    fn facing(&self, cosine: R) -> R {
        if self.one_sided() { (-cosine).max(R::default()) } else { cosine.abs() }
    }

    /// Light of the `source` of a step that is not shaded: of all phase functions together.
    pub(super) fn unshaded(&self, source: &[R]) -> SmallVec<[R; 8]> {
        let plan = &self.planned.plan;
        let (first, lanes) = (plan.parts().unshaded * LANE, plan.lanes() * LANE);
        let mut sum: SmallVec<[R; 8]> = source[first..][..plan.components()].into();
        for phase in 1..plan.phases.max(1) {
            let own = &source[first + phase * lanes..];
            sum.iter_mut().zip(own).for_each(|(sum, &part)| *sum = *sum + part);
        }
        sum
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
        match plan.accumulate {
            Accumulate::Weights { .. } => {
                let facing = facing(0);
                for ((part, &weight), shade) in source.iter_mut().zip(&step.source).zip(&self.shades) {
                    *part = weight * shade.reflected(facing, open);
                }
            }
            Accumulate::Spectral { shares: Shares::Equal, .. } => {
                let first = self.shades.first();
                for (component, (part, &reflected)) in
                    source.iter_mut().zip(&step.source[parts.unshaded * LANE..]).enumerate()
                {
                    *part = reflected * first.map_or(R::default(), |first| first.reflected(facing(component), open));
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

    /// Adds the highlights of a step to `source`, by these shares of the components.
    fn highlight(&self, step: &Step<R>, facing: R, share: impl Fn(usize) -> R, source: &mut [R]) {
        let plan = &self.planned.plan;
        let parts = plan.parts();
        match (plan.accumulate, plan.transmittance) {
            (Accumulate::Weights { materials }, _) => {
                let mut white = R::default();
                for (&weight, shade) in step.source.iter().zip(&self.shades) {
                    white = (weight * shade.specular).mul_add(power(facing, shade.exponent), white);
                }
                source[materials] = share(0).mul_add(white, source[materials]);
            }
            (_, Transmittance::Grey) => {
                let whites = self.exponents.iter().zip(&step.source[parts.highlights * LANE..]);
                let white =
                    whites.fold(R::default(), |sum, (&exponent, &white)| white.mul_add(power(facing, exponent), sum));
                source
                    .iter_mut()
                    .enumerate()
                    .for_each(|(component, part)| *part = share(component).mul_add(white, *part));
            }
            (_, Transmittance::Coloured | Transmittance::Mixed) => {
                for (i, &exponent) in self.exponents.iter().enumerate() {
                    let shine = power(facing, exponent);
                    let whites = &step.source[(parts.highlights + i * plan.lanes()) * LANE..];
                    for (component, (part, &white)) in source.iter_mut().zip(whites).enumerate() {
                        *part = white.mul_add(shine * share(component), *part);
                    }
                }
            }
        }
    }
}

/// Light that further marches read.
struct KeptLight {
    key: String,
    light: GatheredLight,
}

/// Light that has scattered before, if the plan gathers it at nodes.
fn gathered<R: Real>(
    scene: &Scene,
    planned: &Planned,
    samples: &dyn Samples<R>,
    progress: &dyn Progress,
) -> Result<Option<Gathered<R>>, ReferenceError> {
    if planned.plan.light.gathered != Some(ScatteringMethod::Rows) {
        return Ok(None);
    }
    let (storage, labels) = samples.volume().ok_or(ReferenceError::Volumeless)?;
    let made = || TransferRows::new(scene, planned, storage, labels, progress);
    let rows = match samples.keeping() {
        None => Arc::new(made()?),
        Some(keeping) => keeping.depths.rows(|rows: &TransferRows| rows.are_of(scene, planned), made)?,
    };
    let key = GatheredLight::key(scene, planned);
    let made = || Ok(KeptLight { light: rows.light(scene, planned, progress)?, key: key.clone() });
    let kept = match samples.keeping() {
        None => Arc::new(made()?),
        Some(keeping) => keeping.depths.rows(|kept: &KeptLight| kept.key == key, made)?,
    };
    Ok(Some(Gathered::new(&kept.light, planned.plan.components(), samples)))
}
