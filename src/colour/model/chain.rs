//! Chains: light paths to the eye, with the same arithmetic for 81 bands and for k coefficients.

use super::peercy::Matrices;
use super::random::Random;
use crate::spectrum::{BANDS, Spectrum};

/// Path of light through steps of a medium, from a surface behind them.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    /// Steps, front to back.
    steps: Vec<Step>,
    /// Sources that reflect the light in sequence behind the steps; `None` for a path without light from behind.
    behind: Option<Vec<usize>>,
    /// Fraction of the light behind the steps that shading leaves.
    lit_behind: f64,
    /// Absorptions between the light and what is behind the steps, with their optical depths at the peak.
    lit_behind_through: Vec<(usize, f64)>,
    /// Light that has scattered before; `None` for light that scatters once.
    scattered_before: Option<ScatteredBefore>,
}

/// Light that has scattered before it meets a chain: a geometric series of scatterings.
#[derive(Clone, Debug)]
struct ScatteredBefore {
    /// Part of the light that scatters again.
    again: f64,
    /// Sources that scatter it, and their shares.
    sources: Vec<(usize, f64)>,
    /// Absorptions between two scatterings, with their optical depths at the peak.
    absorbed: Vec<(usize, f64)>,
}

impl ScatteredBefore {
    /// Σ over n of (1 − q) qⁿ aⁿ fⁿ⁺¹ for each component, with the reflectance a and the transmittance f between two scatterings.
    fn light<'a>(
        &'a self,
        reflectance: impl Fn(usize) -> f64 + 'a,
        depth: Option<Vec<f64>>,
    ) -> impl Fn(usize) -> f64 + 'a {
        move |component| {
            let passed = depth.as_ref().map_or(1.0, |depth| (-depth[component]).exp());
            (1.0 - self.again) * passed / (-(self.again * passed)).mul_add(reflectance(component), 1.0)
        }
    }
}

/// A homogeneous piece of a medium.
#[derive(Clone, Debug)]
struct Step {
    /// Fraction of the light that shading leaves.
    lit: f64,
    /// Absorptions between the light and the step, with their optical depths at the peak.
    lit_through: Vec<(usize, f64)>,
    /// Scattering sources and their optical depths, equal at all wavelengths.
    scattered: Vec<(usize, f64)>,
    /// Absorptions and their optical depths at the peak.
    absorbed: Vec<(usize, f64)>,
}

/// Optical depth per component of a list of absorptions with their depths.
type Depths<'a> = dyn Fn(&[(usize, f64)]) -> Vec<f64> + 'a;

/// Optical depth per wavelength of a list of absorptions with their depths.
type FullDepth<'a> = dyn Fn(&[(usize, f64)]) -> Spectrum + 'a;

/// Class of chains; letters in brackets are those of the published tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainClass {
    /// One reflection (a).
    Reflections,
    /// Two (in two thirds of the chains) or three reflections (b). No renderer of this crate produces them; the
    /// published tables contain them.
    Bounces,
    /// One reflection seen through one or several absorbers. Optical depths are log-uniform from 0.05 to the largest;
    /// in half of the chains they are uniform in the upper three quarters instead, because combinations of deep
    /// absorbers are the hardest to represent.
    Absorbed,
    /// One reflection seen through one absorber of log-uniform optical depth (c).
    SinglyAbsorbed,
    /// Rays of this many steps through grey media of total optical depth 0.3 to 20 (d0).
    GreyRays(usize),
    /// Rays of this many steps through media that scatter and absorb, of total optical depth 0.3 to 20 (d1).
    ColouredRays(usize),
    /// [`Self::ColouredRays`] (without absorptions, [`Self::GreyRays`]) with shading: the fraction of light left,
    /// between 1 and 1/50, rises or falls along the ray.
    ShadedRays(usize),
    /// One reflection of light that has scattered before, 0 to 9 times on average, from mixtures of sources, through absorptions.
    Scattered,
}

/// Largest mean number of scatterings of a path (docs/theory/colour-models.md).
const MOST_SCATTERINGS: f64 = 10.0;

/// Least fraction of light that shading leaves; errors in darker light are not visible.
const DARKEST: f64 = 0.02;

/// Sources and absorptions available to chains.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Supply {
    /// Number of sources: materials, white, the background.
    pub(crate) sources: usize,
    /// Number of sources that scatter inside a medium: all except the background, which is the last.
    pub(crate) scattering: usize,
    /// Number of absorptions.
    pub(crate) absorptions: usize,
    /// Largest optical depth of coloured absorption.
    pub(crate) largest_depth: f64,
    /// Whether light comes through absorptions, too, of as large a depth.
    pub(crate) two_ways: bool,
    /// Largest optical depth of all ways together.
    pub(crate) deepest: f64,
}

impl Chain {
    /// Chain of one reflection by a source, given by its index.
    pub(crate) fn reflection(source: usize) -> Self {
        Self::of(Vec::new(), Some(vec![source]))
    }

    fn of(steps: Vec<Step>, behind: Option<Vec<usize>>) -> Self {
        Self { steps, behind, lit_behind: 1.0, lit_behind_through: Vec::new(), scattered_before: None }
    }

    /// Draws a random chain of a class.
    pub(crate) fn draw(class: ChainClass, supply: Supply, random: &mut Random) -> Self {
        match class {
            ChainClass::Reflections => Self::reflection(random.index(supply.sources)),
            ChainClass::Bounces => {
                let count = if random.unit() < 2.0 / 3.0 { 2 } else { 3 };
                let behind = (0..count).map(|_| random.index(supply.scattering)).collect();
                Self::of(Vec::new(), Some(behind))
            }
            ChainClass::Absorbed | ChainClass::SinglyAbsorbed => {
                let any = class == ChainClass::Absorbed;
                // Of a reflection, only the sum of both ways counts.
                let largest = supply.deepest;
                let depth = if any && random.unit() < 0.5 {
                    random.between(0.25 * largest, largest)
                } else {
                    random.between_magnitudes(0.05_f64.min(largest), largest)
                };
                let several = any && random.unit() < 0.5;
                let absorbers = if several { 2 + random.index(supply.absorptions.saturating_sub(1)) } else { 1 };
                let absorbed = shared(depth, absorbers, supply.absorptions, random);
                let behind = Some(vec![random.index(supply.sources)]);
                Self::of(vec![Step { lit: 1.0, lit_through: Vec::new(), scattered: Vec::new(), absorbed }], behind)
            }
            ChainClass::GreyRays(steps) => Self::grey_ray(steps, supply, random),
            ChainClass::ColouredRays(steps) => Self::coloured_ray(steps, supply, random),
            ChainClass::ShadedRays(steps) if supply.absorptions > 0 => {
                Self::coloured_ray(steps, supply, random).shaded(supply, random)
            }
            ChainClass::ShadedRays(steps) => Self::grey_ray(steps, supply, random).shaded(supply, random),
            ChainClass::Scattered => Self::scattered(supply, random),
        }
    }

    fn scattered(supply: Supply, random: &mut Random) -> Self {
        let orders = random.between_magnitudes(1.0, MOST_SCATTERINGS);
        let sources = shared(1.0, supply.scattering, supply.scattering, random);
        let absorbed = if supply.absorptions > 0 && random.unit() < 0.5 {
            let depth = random.between_magnitudes(0.01, 1.0).min(supply.largest_depth);
            shared(depth, supply.absorptions, supply.absorptions, random)
        } else {
            Vec::new()
        };
        let before = ScatteredBefore { again: 1.0 - 1.0 / orders, sources, absorbed };
        Self { scattered_before: Some(before), ..Self::reflection(random.index(supply.scattering)) }
    }

    fn grey_ray(steps: usize, supply: Supply, random: &mut Random) -> Self {
        let depth = random.between_magnitudes(0.3, 20.0);
        let scattered = clouds(supply.scattering, steps, depth, random);
        let step = |scattered| Step { lit: 1.0, lit_through: Vec::new(), scattered, absorbed: Vec::new() };
        Self::of(scattered.into_iter().map(step).collect(), drawn_behind(supply, random))
    }

    fn coloured_ray(steps: usize, supply: Supply, random: &mut Random) -> Self {
        let depth = random.between_magnitudes(0.3, 20.0);
        let coloured = (depth * random.between(0.1, 0.9)).min(supply.largest_depth);
        let scattered = clouds(supply.scattering, steps, depth - coloured, random);
        let absorbed = clouds(supply.absorptions, steps, coloured, random);
        let pairs = scattered.into_iter().zip(absorbed);
        let step = |(scattered, absorbed)| Step { lit: 1.0, lit_through: Vec::new(), scattered, absorbed };
        let ray = Self::of(pairs.map(step).collect(), drawn_behind(supply, random));
        if supply.two_ways { ray.lit_through_absorptions(supply, random) } else { ray }
    }

    /// Adds absorptions on the way of the light, whose depth rises or falls evenly from one end to the other. A background is
    /// not shadowed.
    fn lit_through_absorptions(mut self, supply: Supply, random: &mut Random) -> Self {
        let largest = supply.largest_depth;
        let [front, back] = [(); 2].map(|()| random.between_magnitudes(0.05_f64.min(largest), largest));
        let several = random.unit() < 0.5;
        let absorbers = if several { 2 + random.index(supply.absorptions.saturating_sub(1)) } else { 1 };
        let shares = shared(1.0, absorbers, supply.absorptions, random);
        let through = |depth: f64| shares.iter().map(|&(absorption, share)| (absorption, share * depth)).collect();
        let steps = relume_base::number::count(self.steps.len());
        for (index, step) in self.steps.iter_mut().enumerate() {
            let place = (relume_base::number::count(index) + 0.5) / steps;
            step.lit_through = through((back - front).mul_add(place, front));
        }
        if supply.sources == supply.scattering {
            self.lit_behind_through = through(back);
        }
        self
    }

    /// Adds shading that rises or falls geometrically from one end to the other. A background is not shaded.
    fn shaded(mut self, supply: Supply, random: &mut Random) -> Self {
        let [front, back] = [(); 2].map(|()| random.between_magnitudes(DARKEST, 1.0));
        let steps = relume_base::number::count(self.steps.len());
        for (index, step) in self.steps.iter_mut().enumerate() {
            step.lit = front * (back / front).powf((relume_base::number::count(index) + 0.5) / steps);
        }
        if supply.sources == supply.scattering {
            self.lit_behind = back;
        }
        self
    }

    /// Returns the same path with randomly scaled amounts of each source and absorption, and scaled shading.
    pub(crate) fn varied(&self, supply: Supply, random: &mut Random) -> Self {
        let mut varied = self.clone();
        // Cubed, so that most factors are near 1.
        let mut factor = || (random.between(-1.0, 1.0).powi(3)).exp();
        let scattering: Vec<f64> = (0..supply.sources).map(|_| factor()).collect();
        let absorbing: Vec<f64> = (0..supply.absorptions).map(|_| factor()).collect();
        let lit = factor();
        let mut total = 0.0;
        for step in &mut varied.steps {
            step.lit = (step.lit * lit).min(1.0);
            step.scattered.iter_mut().for_each(|(source, depth)| *depth *= scattering[*source]);
            for (absorption, depth) in &mut step.absorbed {
                *depth *= absorbing[*absorption];
                total += *depth;
            }
        }
        let ways = varied.steps.iter_mut().map(|step| &mut step.lit_through);
        for through in ways.chain(std::iter::once(&mut varied.lit_behind_through)) {
            through.iter_mut().for_each(|(absorption, depth)| *depth *= absorbing[*absorption]);
            let total: f64 = through.iter().map(|(_, depth)| depth).sum();
            if total > supply.largest_depth {
                through.iter_mut().for_each(|(_, depth)| *depth *= supply.largest_depth / total);
            }
        }
        if total > supply.largest_depth {
            let absorbed = varied.steps.iter_mut().flat_map(|step| &mut step.absorbed);
            absorbed.for_each(|(_, depth)| *depth *= supply.largest_depth / total);
        }
        if supply.sources == supply.scattering {
            varied.lit_behind = (varied.lit_behind * lit).min(1.0);
        }
        if let Some(before) = &mut varied.scattered_before {
            before.again = 1.0 - ((1.0 - before.again) * lit).clamp(1.0 / MOST_SCATTERINGS, 1.0);
            before.sources.iter_mut().for_each(|(source, share)| *share *= scattering[*source]);
            let sum: f64 = before.sources.iter().map(|(_, share)| share).sum();
            before.sources.iter_mut().for_each(|(_, share)| *share /= sum.max(1e-12));
            before.absorbed.iter_mut().for_each(|(absorption, depth)| *depth *= absorbing[*absorption]);
        }
        varied
    }

    /// Returns the reflected light per component.
    ///
    /// `sources` holds the components of each source; `depths` returns the optical depth per component of a step's
    /// absorptions. A step is exact for a homogeneous medium.
    pub(crate) fn walk(&self, dimension: usize, sources: &[Vec<f64>], depths: &Depths<'_>) -> Vec<f64> {
        let mut light = vec![0.0; dimension];
        let mut transmittance = vec![1.0; dimension];
        for step in &self.steps {
            let mut depth = if step.absorbed.is_empty() { vec![0.0; dimension] } else { depths(&step.absorbed) };
            let mut source = vec![0.0; dimension];
            for &(index, scattering) in &step.scattered {
                for component in 0..dimension {
                    depth[component] += scattering;
                    source[component] += step.lit * scattering * sources[index][component];
                }
            }
            if !step.lit_through.is_empty() {
                for (source, depth) in source.iter_mut().zip(depths(&step.lit_through)) {
                    *source *= (-depth).exp();
                }
            }
            let grey = step.absorbed.is_empty().then(|| absorbed_share(depth.first().copied().unwrap_or(0.0)));
            for component in 0..dimension {
                let depth = depth[component];
                let lost = grey.unwrap_or_else(|| absorbed_share(depth));
                let mean = if depth == 0.0 { 1.0 } else { lost / depth };
                light[component] += transmittance[component] * source[component] * mean;
                transmittance[component] *= 1.0 - lost;
            }
        }
        if let Some(behind) = &self.behind {
            let through = &self.lit_behind_through;
            let lit = if through.is_empty() { vec![0.0; dimension] } else { depths(through) };
            for (component, light) in light.iter_mut().enumerate() {
                let reflected: f64 = behind.iter().map(|&source| sources[source][component]).product();
                let lit = if through.is_empty() { self.lit_behind } else { self.lit_behind * (-lit[component]).exp() };
                *light += transmittance[component] * lit * reflected;
            }
        }
        if let Some(before) = &self.scattered_before {
            let depth = (!before.absorbed.is_empty()).then(|| depths(&before.absorbed));
            let reflectance = |component: usize| {
                before.sources.iter().map(|&(source, share)| share * sources[source][component]).sum()
            };
            let arriving = before.light(reflectance, depth);
            light.iter_mut().enumerate().for_each(|(component, light)| *light *= arriving(component));
        }
        light
    }
}

impl Chain {
    /// Returns the reflected light as a vector of `matrices`; each step, and the transmittance in front of it, is a
    /// matrix.
    ///
    /// `depth` returns the optical depth per wavelength of a step's absorptions.
    pub(crate) fn walk_by_matrices(
        &self,
        matrices: &Matrices,
        sources: &[Spectrum],
        depth: &FullDepth<'_>,
    ) -> Vec<f64> {
        let white = matrices.vector(&[1.0; BANDS]);
        let dimension = white.len();
        let mut light = vec![0.0; dimension];
        let mut transmittance = matrices.matrix(&[1.0; BANDS]);
        for step in &self.steps {
            let scattering: f64 = step.scattered.iter().map(|(_, depth)| depth).sum();
            let depths = depth(&step.absorbed).samples().map(|absorbed| absorbed + scattering);
            let mut sent = [0.0; BANDS];
            for &(index, scattering) in &step.scattered {
                for (sent, reflected) in sent.iter_mut().zip(sources[index].samples()) {
                    *sent += step.lit * scattering * reflected;
                }
            }
            if !step.lit_through.is_empty() {
                for (sent, depth) in sent.iter_mut().zip(depth(&step.lit_through).samples()) {
                    *sent *= (-depth).exp();
                }
            }
            for (sent, depth) in sent.iter_mut().zip(depths) {
                *sent *= if depth == 0.0 { 1.0 } else { absorbed_share(depth) / depth };
            }
            add_product(&mut light, &transmittance, &matrices.vector(&sent), 1.0);
            let step_transmittance = matrices.matrix(&depths.map(|depth| (-depth).exp()));
            let mut left = vec![0.0; step_transmittance.len()];
            for (into, row) in left.chunks_exact_mut(dimension).zip(transmittance.chunks_exact(dimension)) {
                for (factor, parts) in row.iter().zip(step_transmittance.chunks_exact(dimension)) {
                    into.iter_mut().zip(parts).for_each(|(sum, part)| *sum += factor * part);
                }
            }
            transmittance = left;
        }
        if let Some(behind) = &self.behind {
            let mut last_first = behind.iter().rev();
            let lit = (!self.lit_behind_through.is_empty()).then(|| depth(&self.lit_behind_through));
            let vector = |source: usize| match &lit {
                None => matrices.vector(sources[source].samples()),
                Some(depth) => {
                    let samples = sources[source].samples().iter().zip(depth.samples());
                    let mut lit = [0.0; BANDS];
                    lit.iter_mut().zip(samples).for_each(|(lit, (part, depth))| *lit = part * (-depth).exp());
                    matrices.vector(&lit)
                }
            };
            let mut reflected = last_first.next().map_or(white, |&source| vector(source));
            for &source in last_first {
                let mut next = vec![0.0; dimension];
                add_product(&mut next, &matrices.matrix(sources[source].samples()), &reflected, 1.0);
                reflected = next;
            }
            add_product(&mut light, &transmittance, &reflected, self.lit_behind);
        }
        if let Some(before) = &self.scattered_before {
            let depth = (!before.absorbed.is_empty()).then(|| depth(&before.absorbed).samples().to_vec());
            let reflectance = |band: usize| {
                before.sources.iter().map(|&(source, share)| share * sources[source].samples()[band]).sum()
            };
            let arriving = before.light(reflectance, depth);
            let mut scattered = vec![0.0; dimension];
            add_product(&mut scattered, &matrices.matrix(&std::array::from_fn(arriving)), &light, 1.0);
            light = scattered;
        }
        light
    }
}

/// Adds `factor` times the product of a row-major matrix and a vector.
fn add_product(sum: &mut [f64], matrix: &[f64], vector: &[f64], factor: f64) {
    for (sum, row) in sum.iter_mut().zip(matrix.chunks_exact(vector.len())) {
        *sum += factor * row.iter().zip(vector).map(|(part, number)| part * number).sum::<f64>();
    }
}

/// Absorbed fraction 1 − e^(−depth).
fn absorbed_share(depth: f64) -> f64 {
    -(-depth).exp_m1()
}

/// Draws the end of a ray: the background if there is one, else a surface for a third of the rays.
fn drawn_behind(supply: Supply, random: &mut Random) -> Option<Vec<usize>> {
    if supply.sources > supply.scattering {
        return Some(vec![supply.sources - 1]);
    }
    (random.unit() < 1.0 / 3.0).then(|| vec![random.index(supply.sources)])
}

/// Splits a total optical depth into random shares, all equally likely, over `absorbers` of `count` absorptions.
fn shared(depth: f64, absorbers: usize, count: usize, random: &mut Random) -> Vec<(usize, f64)> {
    if absorbers == 1 {
        return vec![(random.index(count), depth)];
    }
    let mut left: Vec<usize> = (0..count).collect();
    let drawn =
        (0..absorbers.min(count)).map(|_| (left.swap_remove(random.index(left.len())), -random.unit().max(1e-12).ln()));
    let mut shares: Vec<(usize, f64)> = drawn.collect();
    let sum: f64 = shares.iter().map(|(_, share)| share).sum();
    shares.iter_mut().for_each(|(_, share)| *share *= depth / sum);
    shares
}

/// Per step, the optical depths of `count` smooth clouds along a ray; their sum is `total`.
fn clouds(count: usize, steps: usize, total: f64, random: &mut Random) -> Vec<Vec<(usize, f64)>> {
    let mut depths = vec![Vec::with_capacity(count); steps];
    let mut sum = 0.0;
    for index in 0..count {
        // Cubed, so that one or two clouds dominate.
        let height = random.unit().powi(3) + 1e-3;
        let bumps = [(); 2].map(|()| (random.unit(), random.between_magnitudes(0.03, 0.5)));
        for (step, depths) in depths.iter_mut().enumerate() {
            let place = (relume_base::number::count(step) + 0.5) / relume_base::number::count(steps);
            let bell = |(centre, width): (f64, f64)| (-0.5 * ((place - centre) / width).powi(2)).exp();
            let density: f64 = height * bumps.map(bell).iter().sum::<f64>();
            sum += density;
            depths.push((index, density));
        }
    }
    for (_, depth) in depths.iter_mut().flatten() {
        *depth *= if sum > 0.0 { total / sum } else { 0.0 };
    }
    depths
}
