//! Light that has scattered before, by random paths from each pixel: the truth of [`super::rows`] (docs/theory/scattering.md).

use super::scatterer::{Arriving, Majorants, Numbers, Scatterer, is_sky};
use super::{Exact, ReferenceError, Step};
use crate::Scene;
use crate::plan::Planned;
use crate::tables::{LabelMap, Storage};
use glam::DVec3;
use relume_base::number::count;
use relume_base::progress::Progress;
use relume_colour::model::random::Random;

/// Scatterings from which on a path may end by chance.
const ROULETTE: usize = 4;
/// Most scatterings of a path, far beyond what chance leaves.
const MOST_SCATTERINGS: usize = 100_000;

/// Paths through the medium of a scene.
pub(super) struct Paths {
    scatterer: Scatterer,
    storage: Storage,
    labels: Option<LabelMap>,
    arriving: Arriving,
    majorants: Majorants,
    /// Positions whose light comes from everywhere.
    sky: Vec<usize>,
    /// Numbers of the light of all positions.
    components: usize,
    positions: usize,
    /// Paths of a ray.
    number: usize,
}

/// A place on a ray of the eye, and the light of each component that it scatters towards the eye, of a unit of mean intensity.
pub(super) struct Seen {
    pub(super) place: [f64; 3],
    pub(super) light: Vec<f64>,
}

impl Paths {
    /// The paths of each of `rays` rays of a pixel.
    pub(super) fn new(
        scene: &Scene,
        planned: &Planned,
        samples: Option<(&Storage, Option<&LabelMap>)>,
        progress: &dyn Progress,
    ) -> Result<Self, ReferenceError> {
        let (storage, labels) = samples.ok_or(ReferenceError::Volumeless)?;
        let scatterer = Scatterer::new(scene, planned, Numbers::Components);
        let majorants = scatterer.majorants(storage, labels);
        let arriving = scatterer.reaching(&scatterer.samples(storage, labels), usize::MAX, progress)?;
        let positions = planned.positions.len();
        Ok(Self {
            arriving,
            majorants,
            sky: (0..positions).filter(|&position| is_sky(planned, position)).collect(),
            components: planned.plan.components(),
            positions,
            number: scene.scattering.paths.div_ceil(planned.plan.rays.max(1)),
            storage: storage.clone(),
            labels: labels.cloned(),
            scatterer,
        })
    }

    /// Adds to `sums`, accumulator by accumulator, the light of all orders but the first that a ray with these places sees: ray number `ray` of a
    /// pixel. The paths begin at places by the light that these scatter towards the eye, evenly spread.
    pub(super) fn add(&self, seen: &[Seen], ([x, y], ray): ([usize; 2], usize), sums: &mut [f64]) {
        let largest = |light: &[f64]| light.iter().fold(0.0_f64, |most, &number| most.max(number));
        let mut before = Vec::with_capacity(seen.len());
        let all = seen.iter().fold(0.0, |sum, seen| {
            before.push(sum);
            sum + largest(&seen.light)
        });
        if all <= 0.0 {
            return;
        }
        let samples = self.scatterer.samples(&self.storage, self.labels.as_ref());
        let seed = (x as u64) << 40 ^ (y as u64) << 16 ^ ray as u64;
        let mut random = Random::new(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x7061_7468);
        let mut light = vec![0.0; self.positions * self.components];
        for path in 0..self.number {
            let part = (count(path) + random.unit()) / count(self.number) * all;
            let index = before.partition_point(|&before| before <= part).saturating_sub(1);
            let start = &seen[index];
            light.fill(0.0);
            self.walk(&samples, start.place, &mut random, &mut light);
            let scale = all / (largest(&start.light) * count(self.number));
            for (i, (sum, light)) in sums.iter_mut().zip(&light).enumerate() {
                *sum += scale * start.light[i % self.components] * light;
            }
        }
    }

    /// Adds to `light` what a path from `place` brings there: the mean intensity of light that has scattered, of each position and component.
    fn walk(&self, samples: &Exact<'_>, mut place: [f64; 3], random: &mut Random, light: &mut [f64]) {
        let shares = self.scatterer.shares();
        let mut brought = vec![1.0; self.components];
        let mut arrived = vec![0.0; self.positions * shares];
        for scatterings in 0..MOST_SCATTERINGS {
            let Some(next) = self.fly(samples, place, random, &mut brought) else {
                if scatterings > 0 {
                    for &position in &self.sky {
                        let sums = &mut light[position * self.components..][..self.components];
                        sums.iter_mut().zip(&brought).for_each(|(sum, brought)| *sum += brought);
                    }
                }
                return;
            };
            place = next;
            arrived.fill(0.0);
            self.scatterer.arrive(&self.arriving, place, samples, &mut arrived);
            for (i, sum) in light.iter_mut().enumerate() {
                let (position, component) = (i / self.components, i % self.components);
                *sum += brought[component] * arrived[position * shares + if shares == 1 { 0 } else { component }];
            }
            let most = brought.iter().fold(0.0_f64, |most, &part| most.max(part));
            if most <= 0.0 {
                return;
            }
            if scatterings + 1 >= ROULETTE && most < 1.0 {
                if random.unit() >= most {
                    return;
                }
                brought.iter_mut().for_each(|part| *part /= most);
            }
        }
    }

    /// The place of the next scattering from `place` in a random direction, by null collisions (Woodcock 1965); `None` beyond the medium.
    /// Multiplies `brought` by what is scattered there, and by what absorbs before.
    ///
    /// A collision scatters with the part s/(s + |μ − τ|) of the largest scattered light s, the least extinction τ and the majorant μ: with a larger
    /// τ, what goes on of the other components would never or seldom be followed. The light is divided by that part and not by a
    /// component's own probability, so no component gains noise, and any majorant gives the same mean.
    fn fly(&self, samples: &Exact<'_>, place: [f64; 3], random: &mut Random, brought: &mut [f64]) -> Option<[f64; 3]> {
        let height = random.between(-1.0, 1.0);
        let (sine, cosine) = (std::f64::consts::TAU * random.unit()).sin_cos();
        let radius = height.mul_add(-height, 1.0).max(0.0).sqrt();
        let way = self.scatterer.way(place, DVec3::new(radius * cosine, radius * sine, height));
        let [mut distance, end] = way.range;
        let mut density = Step::default();
        while distance < end {
            let (majorant, leave) = self.majorants.at(&way, distance);
            let leave = leave.min(end);
            let step = if majorant > 0.0 { -(-random.unit()).ln_1p() / majorant } else { f64::INFINITY };
            if distance + step >= leave {
                distance = leave;
                continue;
            }
            distance += step;
            let at = way.at(distance);
            self.scatterer.density(samples, at, &mut density);
            let scattered = self.scatterer.scattered(&density);
            let most = scattered.iter().fold(0.0_f64, |most, &part| most.max(part));
            let extinction = density.opacity.iter().fold(f64::INFINITY, |least, &depth| least.min(depth));
            let rest = (majorant - extinction).abs();
            if most + rest <= 0.0 {
                // All that is here absorbs.
                brought.fill(0.0);
                return Some(at);
            }
            let part = most / (most + rest);
            if random.unit() < part {
                for (brought, &own) in brought.iter_mut().zip(scattered) {
                    *brought *= own / (majorant * part);
                }
                return Some(at);
            }
            for (i, brought) in brought.iter_mut().enumerate() {
                let depth = density.opacity[if density.opacity.len() == 1 { 0 } else { i }];
                *brought *= (majorant - depth) / (majorant * (1.0 - part));
            }
        }
        None
    }
}
