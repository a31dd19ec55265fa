//! What light meets on its way to the eye, as arithmetic that is the same for 81 bands and for k coefficients.

use super::peercy::Matrices;
use super::random::Random;
use crate::spectrum::{BANDS, Spectrum};

/// The way of some light: through steps of a medium, and from what is behind them.
#[derive(Clone, Debug)]
pub(crate) struct Chain {
    /// Front to back.
    steps: Vec<Step>,
    /// The sources that reflect it one after the other behind the steps; none: nothing is there.
    behind: Option<Vec<usize>>,
    /// The share of light that shading leaves there.
    lit_behind: f64,
}

/// A piece of a medium that is the same throughout.
#[derive(Clone, Debug)]
struct Step {
    /// The share of light that shading leaves.
    lit: f64,
    /// Optical depths by which sources scatter, alike at all wavelengths.
    scattered: Vec<(usize, f64)>,
    /// Optical depths, at the peak, by which absorptions absorb.
    absorbed: Vec<(usize, f64)>,
}

/// The optical depth per component of so much of these absorptions.
type Depths<'a> = dyn Fn(&[(usize, f64)]) -> Vec<f64> + 'a;

/// The optical depth per wavelength of so much of these absorptions.
type FullDepth<'a> = dyn Fn(&[(usize, f64)]) -> Spectrum + 'a;

/// Kinds of chains; letters are those of the published tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainClass {
    /// One reflection (a).
    Reflections,
    /// Two (two thirds) or three reflections (b). No renderer here makes them; the published tables have them.
    Bounces,
    /// One reflection seen through one absorber or several, half of them deep: optical depths are log-uniform from 0.05
    /// to the largest, or uniform in the upper three quarters. What deep absorbers leave together is hardest to carry.
    Absorbed,
    /// One reflection seen through one absorber of log-uniform optical depth: what the published tables call c.
    SinglyAbsorbed,
    /// Rays of this many steps through grey media of total optical depth 0.3 to 20 (d0).
    GreyRays(usize),
    /// Rays of this many steps through media that scatter and absorb, of total optical depth 0.3 to 20 (d1).
    ColouredRays(usize),
    /// The same (without absorptions, through grey media) where shading leaves less of the light: from all of it to a
    /// fiftieth, more and more, or less and less, along the ray.
    ShadedRays(usize),
}

/// The least share of light that shading leaves a shaded ray: what is darker is too dark for errors to show.
const DARKEST: f64 = 0.02;

/// What chains can be made of.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Supply {
    /// How many sources there are: materials, white, the background.
    pub(crate) sources: usize,
    /// How many of them scatter inside a medium: all but the background, which is the last.
    pub(crate) scattering: usize,
    /// How many absorptions there are.
    pub(crate) absorptions: usize,
    /// The largest optical depth of coloured absorption.
    pub(crate) largest_depth: f64,
}

impl Chain {
    /// The light of one source, by its number.
    pub(crate) fn reflection(source: usize) -> Self {
        Self::of(Vec::new(), Some(vec![source]))
    }

    fn of(steps: Vec<Step>, behind: Option<Vec<usize>>) -> Self {
        Self { steps, behind, lit_behind: 1.0 }
    }

    /// A random chain of a class.
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
                let largest = supply.largest_depth;
                let depth = if any && random.unit() < 0.5 {
                    random.between(0.25 * largest, largest)
                } else {
                    random.between_magnitudes(0.05_f64.min(largest), largest)
                };
                let several = any && random.unit() < 0.5;
                let absorbers = if several { 2 + random.index(supply.absorptions.saturating_sub(1)) } else { 1 };
                let absorbed = shared(depth, absorbers, supply.absorptions, random);
                let behind = Some(vec![random.index(supply.sources)]);
                Self::of(vec![Step { lit: 1.0, scattered: Vec::new(), absorbed }], behind)
            }
            ChainClass::GreyRays(steps) => Self::grey_ray(steps, supply, random),
            ChainClass::ColouredRays(steps) => Self::coloured_ray(steps, supply, random),
            ChainClass::ShadedRays(steps) if supply.absorptions > 0 => {
                Self::coloured_ray(steps, supply, random).shaded(supply, random)
            }
            ChainClass::ShadedRays(steps) => Self::grey_ray(steps, supply, random).shaded(supply, random),
        }
    }

    fn grey_ray(steps: usize, supply: Supply, random: &mut Random) -> Self {
        let depth = random.between_magnitudes(0.3, 20.0);
        let scattered = clouds(supply.scattering, steps, depth, random);
        let step = |scattered| Step { lit: 1.0, scattered, absorbed: Vec::new() };
        Self::of(scattered.into_iter().map(step).collect(), drawn_behind(supply, random))
    }

    fn coloured_ray(steps: usize, supply: Supply, random: &mut Random) -> Self {
        let depth = random.between_magnitudes(0.3, 20.0);
        let coloured = (depth * random.between(0.1, 0.9)).min(supply.largest_depth);
        let scattered = clouds(supply.scattering, steps, depth - coloured, random);
        let absorbed = clouds(supply.absorptions, steps, coloured, random);
        let pairs = scattered.into_iter().zip(absorbed);
        let steps = pairs.map(|(scattered, absorbed)| Step { lit: 1.0, scattered, absorbed }).collect();
        Self::of(steps, drawn_behind(supply, random))
    }

    /// The same, less and less lit from one of its ends to the other. A background is not shaded.
    fn shaded(mut self, supply: Supply, random: &mut Random) -> Self {
        let [front, back] = [(); 2].map(|()| random.between_magnitudes(DARKEST, 1.0));
        let steps = crate::number::count(self.steps.len());
        for (index, step) in self.steps.iter_mut().enumerate() {
            step.lit = front * (back / front).powf((crate::number::count(index) + 0.5) / steps);
        }
        if supply.sources == supply.scattering {
            self.lit_behind = back;
        }
        self
    }

    /// The same way through somewhat more or less of each thing, somewhat better or worse lit.
    pub(crate) fn varied(&self, supply: Supply, random: &mut Random) -> Self {
        let mut varied = self.clone();
        // Cubed, so that most are near 1.
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
        if total > supply.largest_depth {
            let absorbed = varied.steps.iter_mut().flat_map(|step| &mut step.absorbed);
            absorbed.for_each(|(_, depth)| *depth *= supply.largest_depth / total);
        }
        if supply.sources == supply.scattering {
            varied.lit_behind = (varied.lit_behind * lit).min(1.0);
        }
        varied
    }

    /// The light that comes back, per component.
    ///
    /// `sources` holds the components of each source, `depths` gives the optical depth per component of a step's
    /// absorptions. One step is exact for a medium that is the same throughout.
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
            for (component, light) in light.iter_mut().enumerate() {
                let reflected: f64 = behind.iter().map(|&source| sources[source][component]).product();
                *light += transmittance[component] * self.lit_behind * reflected;
            }
        }
        light
    }
}

impl Chain {
    /// The light that comes back as a vector of `matrices`, each step being a matrix, as is what it lets pass.
    ///
    /// `depth` gives the optical depth per wavelength of a step's absorptions.
    pub(crate) fn walk_by_matrices(
        &self,
        matrices: &Matrices,
        sources: &[Spectrum],
        depth: &FullDepth<'_>,
    ) -> Vec<f64> {
        let white = matrices.vector(&[1.0; BANDS]);
        let dimension = white.len();
        let mut light = vec![0.0; dimension];
        let mut passing = matrices.matrix(&[1.0; BANDS]);
        for step in &self.steps {
            let scattering: f64 = step.scattered.iter().map(|(_, depth)| depth).sum();
            let depths = depth(&step.absorbed).samples().map(|absorbed| absorbed + scattering);
            let mut sent = [0.0; BANDS];
            for &(index, scattering) in &step.scattered {
                for (sent, reflected) in sent.iter_mut().zip(sources[index].samples()) {
                    *sent += step.lit * scattering * reflected;
                }
            }
            for (sent, depth) in sent.iter_mut().zip(depths) {
                *sent *= if depth == 0.0 { 1.0 } else { absorbed_share(depth) / depth };
            }
            add_product(&mut light, &passing, &matrices.vector(&sent), 1.0);
            let met = matrices.matrix(&depths.map(|depth| (-depth).exp()));
            let mut passed = vec![0.0; met.len()];
            for (passed, row) in passed.chunks_exact_mut(dimension).zip(passing.chunks_exact(dimension)) {
                for (factor, met) in row.iter().zip(met.chunks_exact(dimension)) {
                    passed.iter_mut().zip(met).for_each(|(sum, met)| *sum += factor * met);
                }
            }
            passing = passed;
        }
        if let Some(behind) = &self.behind {
            let mut last_first = behind.iter().rev();
            let mut reflected = last_first.next().map_or(white, |&source| matrices.vector(sources[source].samples()));
            for &source in last_first {
                let mut next = vec![0.0; dimension];
                add_product(&mut next, &matrices.matrix(sources[source].samples()), &reflected, 1.0);
                reflected = next;
            }
            add_product(&mut light, &passing, &reflected, self.lit_behind);
        }
        light
    }
}

/// Adds `factor` times the product of a matrix, row by row, and a vector.
fn add_product(sum: &mut [f64], matrix: &[f64], vector: &[f64], factor: f64) {
    for (sum, row) in sum.iter_mut().zip(matrix.chunks_exact(vector.len())) {
        *sum += factor * row.iter().zip(vector).map(|(part, number)| part * number).sum::<f64>();
    }
}

/// 1 − e^(−depth).
fn absorbed_share(depth: f64) -> f64 {
    -(-depth).exp_m1()
}

/// Behind a ray is the background where there is one; a third of the others end on a surface.
fn drawn_behind(supply: Supply, random: &mut Random) -> Option<Vec<usize>> {
    if supply.sources > supply.scattering {
        return Some(vec![supply.sources - 1]);
    }
    (random.unit() < 1.0 / 3.0).then(|| vec![random.index(supply.sources)])
}

/// A total optical depth in random shares, all equally likely, of so many of the `count` absorptions there are.
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

/// Per step, the optical depth of each of `count` smooth clouds along a ray; all together `total`.
fn clouds(count: usize, steps: usize, total: f64, random: &mut Random) -> Vec<Vec<(usize, f64)>> {
    let mut depths = vec![Vec::with_capacity(count); steps];
    let mut sum = 0.0;
    for index in 0..count {
        // Cubed, so that one or two of many are most of it.
        let height = random.unit().powi(3) + 1e-3;
        let bumps = [(); 2].map(|()| (random.unit(), random.between_magnitudes(0.03, 0.5)));
        for (step, depths) in depths.iter_mut().enumerate() {
            let place = (crate::number::count(step) + 0.5) / crate::number::count(steps);
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
