//! Bounds of the difference between two rungs in every number of every pixel, from bounds of their samples.
//!
//! If a step's sources s are off by at most δs, its opacity by δα and its normal by δn, an accumulator Σ T·s·shade is
//! off
//! by at most Σ T·(δs·shade + |s|·|shade′|·δn + δα·B): an excess opacity δα removes at most that share of the light
//! from
//! behind, which is bounded by B. B ≤ 1 for weights of materials that occlude as much as they scatter (Σ s = α). For
//! spectra, B is the largest coefficient of a reflectance times its shading coefficients. With X-ray materials, B is
//! the
//! brightest pixel's own sum. The bound is itself a march, with differences in place of the sources, and
//! `reference::march`
//! evaluates it for each component with its own transmittance. Products of two errors are omitted; they are below 1e-5
//! of
//! the bounds.

use glam::DVec3;
use relume::film::Film;
use relume::number::{Real, rounded as single};
use relume::plan::{Accumulate, FilmCounts, Groups, LANE, LightPlan, Planned, ScenePlan, Shares, Transmittance};
use relume::reference::{End, Samples, Step, Stored, across};
use relume::scene::{Direction, Lookup, Material, Placement, Position, View};
use relume::tables::{RayTable, Steps, StoredVolume};

use super::rungs::Rungs;
use super::scenes::float;
use super::tolerance::ROUNDING_UNIT;

/// Half-vectors are off by up to 2/|l + v| times the error of their directions; this assumes lights in front.
const HALFWAY: f64 = 2.0;

/// Bound of the difference between two rungs' samples.
#[derive(Debug, Default)]
pub struct Difference {
    pub source: Vec<f64>,
    pub opacity: Vec<f64>,
    pub normal: f64,
}

impl Difference {
    /// Widens the bound to include the difference between `one` and `other`.
    fn include(&mut self, one: &Step<f64>, other: &Step<f64>) {
        let widen = |differences: &mut Vec<f64>, one: &[f64], other: &[f64]| {
            differences.resize(one.len(), 0.0);
            for (difference, (one, other)) in differences.iter_mut().zip(one.iter().zip(other)) {
                *difference = difference.max((one - other).abs());
            }
        };
        widen(&mut self.source, &one.source, &other.source);
        widen(&mut self.opacity, &one.opacity, &other.opacity);
        let square: f64 = one.normal.iter().zip(other.normal).map(|(a, b)| (a - b) * (a - b)).sum();
        self.normal = self.normal.max(square.sqrt());
    }
}

/// Samples with the bounds of the components, followed by the bounds of the transmittance's components.
struct Bounding<'a, F> {
    rungs: &'a Rungs,
    behind: f64,
    /// Rounding error of the spectral arithmetic, relative to Σ|terms|.
    rounded: f64,
    sample: F,
}

impl<F: Fn([f64; 3]) -> (Step<f64>, Difference) + Sync> Samples<f64> for Bounding<'_, F> {
    fn sample(&self, place: [f64; 3], step: &mut Step<f64>) {
        let (found, difference) = (self.sample)(place);
        let plan = &self.rungs.planned.plan;
        step.source = match plan.accumulate {
            Accumulate::Weights { .. } => self.of_weights(&found, &difference),
            Accumulate::Spectral { dimension, .. } => self.of_spectra(&found, &difference, dimension),
        };
        let of = |numbers: &[f64], i: usize| numbers[i % plan.transmittance_numbers()];
        let components = plan.components();
        for (i, bound) in step.source.iter_mut().enumerate() {
            *bound += of(&difference.opacity, i) * self.behind;
        }
        step.source.extend(&difference.opacity[..plan.transmittance_numbers()]);
        step.opacity = (0..components).chain(0..plan.transmittance_numbers()).map(|i| of(&found.opacity, i)).collect();
    }

    // The bounds of a step hold its shades.
    fn normal(&self, _: [f64; 3]) -> [f64; 3] {
        [0.0; 3]
    }

    fn end(&self, _: [f64; 3]) -> End<f64> {
        unreachable!("bounds are those of samples")
    }

    fn mean(&self, _: [&End<f64>; 2], _: [f64; 3], _: &mut Step<f64>) -> f64 {
        unreachable!("bounds are those of samples")
    }

    fn extinction(&self, _: [f64; 3], _: usize) -> f64 {
        unreachable!("bounds are those of scenes without shadows")
    }
}

impl<F> Bounding<'_, F> {
    /// Materials in use.
    fn used(&self) -> impl Iterator<Item = &Material> {
        self.rungs.planned.materials.iter().map(|&m| &self.rungs.scene.materials[m])
    }

    /// Largest change of a highlight of this exponent per change of the normal.
    fn steepness(exponent: u32) -> f64 {
        f64::from(exponent) * (1.0 + HALFWAY)
    }

    fn of_weights(&self, found: &Step<f64>, difference: &Difference) -> Vec<f64> {
        let plan = &self.rungs.planned.plan;
        let (mut bounds, mut white) = (Vec::new(), 0.0);
        for ((&weight, &moved), material) in found.source.iter().zip(&difference.source).zip(self.used()) {
            let (shade, slope) = match plan.shading {
                None => (1.0, 0.0),
                Some(_) => ((material.ambient + material.diffuse).max(1.0), material.diffuse),
            };
            bounds.push(moved * shade + weight * slope * difference.normal);
            white += material.specular * (moved + weight * Self::steepness(material.exponent) * difference.normal);
        }
        if plan.specular().is_some() {
            bounds.push(white);
        }
        bounds
    }

    /// Largest bound over the kinds of light position.
    fn of_spectra(&self, found: &Step<f64>, difference: &Difference, dimension: usize) -> Vec<f64> {
        let (scene, planned) = (&self.rungs.scene, &self.rungs.planned);
        let plan = &planned.plan;
        let (parts, directed) = (plan.parts(), plan.shading.is_some());
        let Accumulate::Spectral { shares, .. } = plan.accumulate else { return Vec::new() };
        let first = |lanes: usize| 4 * lanes;
        // Bound of the change and the size of a component that entry `at` of the step contributes to.
        let of = |at: usize, shade: f64, slope: f64| {
            let (size, moved) = (found.source[at].abs(), difference.source[at]);
            moved * shade + size * (slope * difference.normal + self.rounded * shade)
        };
        let component = |i: usize| {
            let mut bound: f64 = 0.0;
            if plan.light.is_ambient() || !directed {
                bound = of(first(parts.unshaded) + i, 1.0, 0.0);
            }
            if !directed {
                return bound;
            }
            let mut lit = match shares {
                Shares::Equal => {
                    let share = |of: fn(&Material) -> f64| self.used().next().map_or(0.0, of);
                    let (ambient, diffuse) = (share(|material| material.ambient), share(|material| material.diffuse));
                    of(first(parts.unshaded) + i, ambient + diffuse, diffuse)
                }
                Shares::Own => of(first(parts.ambient) + i, 1.0, 0.0) + of(first(parts.diffuse) + i, 1.0, 1.0),
            };
            for (e, &exponent) in planned.exponents(scene).iter().enumerate() {
                let at = match plan.transmittance {
                    Transmittance::Grey => first(parts.highlights) + e,
                    Transmittance::Coloured | Transmittance::Mixed => first(parts.highlights + e * plan.lanes()) + i,
                };
                lit += of(at, 1.0, Self::steepness(exponent));
            }
            bound.max(lit)
        };
        (0..dimension).map(component).collect()
    }
}

/// Returns the bound of every number of `expected`, in its layout, for samples that differ as `sample` says and for
/// `roundings` roundings per step in the arithmetic of a step and its sum.
pub fn bounds<R: Real>(
    rungs: &Rungs,
    expected: &Film<R>,
    roundings: f64,
    sample: impl Fn([f64; 3]) -> (Step<f64>, Difference) + Sync,
) -> Film<f64> {
    let (scene, planned, size) = (&rungs.scene, &rungs.planned, &rungs.size);
    let (components, numbers) = (planned.plan.components(), planned.plan.transmittance_numbers());
    let plan = ScenePlan {
        accumulate: Accumulate::Spectral { dimension: components + numbers, shares: Shares::Equal, exponents: 0 },
        transmittance: Transmittance::Coloured,
        light: LightPlan::open(&[Direction::Everywhere]),
        shading: None,
        phases: 0,
        thin_films: FilmCounts::default(),
        // Samples close their densities.
        groups: Groups::default(),
        ..planned.plan.clone()
    };
    let everywhere =
        Position { name: "everywhere".into(), placement: Placement::Ambient, shadows: false, lights: Vec::new() };
    let differences =
        Planned { plan, materials: Vec::new(), positions: vec![everywhere], model: None, warnings: Vec::new() };
    let behind =
        expected.accumulators.iter().fold(largest_behind(rungs), |most, weight| most.max(weight.to_f64().abs()));
    let rounded = roundings * longest(rungs) * ROUNDING_UNIT;
    let bounding = Bounding { rungs, behind, rounded, sample };
    let marched = relume::reference::march(scene, &differences, &bounding, *size, &relume::progress::Quiet).unwrap();

    let pixels = size[0] * size[1];
    let plane = |component: usize| &marched.accumulators[component * pixels..][..pixels];
    // Weights are sums of positive terms; spectral terms may cancel, and already include their roundings.
    let of_sum = if planned.model.is_some() { 0.0 } else { rounded };
    let weights = expected.accumulators.iter().enumerate().map(|(i, weight)| {
        plane(i / pixels % components)[i % pixels] + of_sum * weight.to_f64().abs() + f64::from(f32::MIN_POSITIVE)
    });
    let transmittance = expected.transmittance.iter().enumerate().map(|(i, number)| {
        plane(components + i / pixels)[i % pixels] + rounded * number.to_f64() + f64::from(f32::MIN_POSITIVE)
    });
    Film { size: *size, components, accumulators: weights.collect(), transmittance: transmittance.collect() }
}

/// Largest value of a component that can arrive from behind a step, for materials that occlude as much as they scatter.
fn largest_behind(rungs: &Rungs) -> f64 {
    let (scene, planned) = (&rungs.scene, &rungs.planned);
    let Some(model) = &planned.model else { return 1.0 };
    let of_material = |&m: &usize| {
        let material = &scene.materials[m];
        let coefficients = model.coefficients(material.reflectance.spectrum());
        let largest = coefficients.iter().fold(0.0_f64, |most, part| most.max(part.abs()));
        let shares = if planned.plan.shading.is_some() { material.ambient + material.diffuse } else { 1.0 };
        largest * shares.max(1.0) + material.specular
    };
    planned.materials.iter().map(of_material).fold(1.0, f64::max)
}

/// Bounds between two f64 rungs: the scene itself, and its stored tables and volume.
///
/// Except for rounding of its entries, a linear table is off by at most a quarter of the second difference over two
/// entries. (Its error at a kink in the middle of an entry is a quarter of the change of slope per entry, and such a
/// difference includes at least 1.5 entries of that; the error for a parabola is a 32nd of the difference.) A stored
/// value
/// is off by [`relume::tables::Storage::loss`], a stored gradient component by half a code.
pub fn of_tables(rungs: &Rungs, expected: &Film<f64>) -> Film<f64> {
    assert_eq!(rungs.planned.plan.lookup, Lookup::Linear, "jumps move by an entry");
    let [low, high] = rungs.storage.domain;
    let entry = (high - low) / float(rungs.table.entries() - 1);
    let exact = rungs.exact();
    let steps = Steps::new(&rungs.scene, &rungs.planned);
    let texels = Texels::new(&rungs.volume);
    let scale = DVec3::from_array(rungs.storage.gradient_scale());
    let [value_scale, value_offset] = rungs.storage.normalised_from_texel();
    bounds(rungs, expected, 4.0, |place| {
        let mut here = Step::default();
        exact.sample(place, &mut here);
        here.normal = exact.normal(place);
        let texel = texels.at(place);
        let value = (high - low).mul_add(texel[3].mul_add(value_scale, value_offset), low);
        let at = |entries: f64| steps.of_value(entry.mul_add(entries, value));
        let around: Vec<_> = (-3..=3).map(|entries| at(f64::from(entries))).collect();
        let lost = (rungs.storage.loss + (high - low) * ROUNDING_UNIT) / entry;
        let moved = [at(lost), at(-lost)];
        let second = |pick: &dyn Fn(&relume::tables::Step) -> f64| {
            let differences = (2..=4_usize).map(|middle| {
                (pick(&around[middle - 2]) - 2.0 * pick(&around[middle]) + pick(&around[middle + 2])).abs()
            });
            let moved = moved.iter().map(|step| (pick(step) - pick(&around[3])).abs()).fold(0.0, f64::max);
            differences.fold(0.0, f64::max) / 4.0 + moved + ROUNDING_UNIT * pick(&around[3]).abs()
        };
        let difference = Difference {
            source: (0..here.source.len())
                .map(|m| second(&|step| step.source[m]) + ROUNDING_UNIT * here.source[m].abs())
                .collect(),
            opacity: (0..here.opacity.len())
                .map(|i| second(&|step| step.opacity[i]) + ROUNDING_UNIT * here.opacity[i])
                .collect(),
            normal: direction_error(&texel, scale, 0.5 / 32767.0),
        };
        (here, difference)
    })
}

/// Bounds between two rungs that read the same tables and volume at places up to `reach` (texture coordinates) apart:
/// the differences to the corners of the cube of that half-width, which contain the extremes of any function that is
/// monotonic in the cube, plus the roundings of interpolation.
pub fn of_places<R: Real>(rungs: &Rungs, expected: &Film<R>, reach: [f64; 3], roundings: f64) -> Film<f64> {
    let stored = rungs.stored::<f64>();
    let texels = Texels::new(&rungs.volume);
    let scale = DVec3::from_array(rungs.storage.gradient_scale());
    // Magnitudes of gradients that are a little shorter and longer.
    let rounded: Vec<Rungs> = if rungs.planned.plan.groups.by_gradient() {
        vec![with_longer_gradients(rungs, -MAGNITUDE), with_longer_gradients(rungs, MAGNITUDE)]
    } else {
        Vec::new()
    };
    let rounded: Vec<Stored<'_, f64>> = rounded.iter().map(|rungs| rungs.stored()).collect();
    let mut bounds = bounds(rungs, expected, roundings, |place| {
        let mut here = step_of(rungs, &stored, place);
        here.normal = stored.normal(place);
        let mut difference = Difference::default();
        for corner in 0..8 {
            let moved = std::array::from_fn(|axis| {
                if corner >> axis & 1 == 0 { place[axis] - reach[axis] } else { place[axis] + reach[axis] }
            });
            let mut there = step_of(rungs, &stored, moved);
            there.normal = stored.normal(moved);
            difference.include(&here, &there);
        }
        for stored in &rounded {
            let mut there = step_of(rungs, stored, place);
            there.normal = here.normal;
            difference.include(&here, &there);
        }
        if rungs.volume.gradients.is_some() {
            // Three interpolations, each with at most three roundings of numbers up to 1.
            difference.normal += direction_error(&texels.at(place), scale, 9.0 * ROUNDING_UNIT) + 8.0 * ROUNDING_UNIT;
        }
        // The roundings of a value are covered by those of its place: three interpolations, a scale and an offset.
        (here, difference)
    });
    let cut = of_cuts(rungs, reach);
    bounds.accumulators.iter_mut().chain(&mut bounds.transmittance).for_each(|bound| *bound += cut);
    bounds
}

/// Bound of the light and the opacity that the rounded lengths of a first and a last step add or take, where clip planes cut them. The
/// shaded scenes with a crop box stay within the other bounds.
fn of_cuts(rungs: &Rungs, reach: [f64; 3]) -> f64 {
    let scene = &rungs.scene;
    if scene.clip.in_force().next().is_none() {
        return 0.0;
    }
    let rays = rays(rungs).0;
    let length = (DVec3::from_array(reach) * rays.local_scale).max_element() / rays.step_length;
    let numbers = rungs.table.source.iter().flatten().chain(&rungs.table.opacity);
    let largest = numbers.fold(0.0_f64, |most, &number| most.max(f64::from(number).abs()));
    2.0 * GRAZING * length * largest
}

/// Relative error of a gradient magnitude: three interpolations, with at most three roundings each, a scale, and six of the length and
/// its place in a piece of a factor.
const MAGNITUDE: f64 = 16.0 * ROUNDING_UNIT;

/// The same rungs; every gradient counts as longer by a part of it.
fn with_longer_gradients(rungs: &Rungs, part: f64) -> Rungs {
    let mut rungs = rungs.clone();
    let length = 1.0 + part;
    for [start, steepness, ..] in &mut rungs.factors.vectors {
        *start = single(f64::from(*start) / length);
        *steepness = single(f64::from(*steepness) * length);
    }
    rungs
}

/// The effect of a step at `place`.
fn step_of(rungs: &Rungs, samples: &impl Samples<f64>, place: [f64; 3]) -> Step<f64> {
    let (mut found, mut closed) = (Step::default(), Step::default());
    samples.sample(place, &mut found);
    let plan = &rungs.planned.plan;
    if !plan.adds_densities() {
        return found;
    }
    across(&found, 1.0, plan.lanes() * LANE, &mut closed);
    closed
}

/// Largest change of a normal if each stored gradient component is off by `error`.
fn direction_error(texel: &[f64; 4], scale: DVec3, error: f64) -> f64 {
    let gradient = DVec3::new(texel[0], texel[1], texel[2]) * scale;
    let off = (scale * error).length();
    if off > 0.0 { (2.0 * off / gradient.length()).min(2.0) } else { 0.0 }
}

/// Independent implementation of trilinear interpolation in a stored volume.
struct Texels<'a> {
    volume: &'a StoredVolume,
}

impl<'a> Texels<'a> {
    fn new(volume: &'a StoredVolume) -> Self {
        Self { volume }
    }

    /// The differences and the value.
    fn at(&self, place: [f64; 3]) -> [f64; 4] {
        let dims = self.volume.dims;
        let mut sum = [0.0; 4];
        for corner in 0..8 {
            let (mut weight, mut index) = (1.0, [0; 3]);
            for axis in 0..3 {
                let voxel = (place[axis] * float(dims[axis]) - 0.5).clamp(0.0, float(dims[axis] - 1));
                let below = voxel.floor();
                let upper = corner >> axis & 1 == 1;
                weight *= if upper { voxel - below } else { 1.0 - (voxel - below) };
                index[axis] = (whole(below) + usize::from(upper)).min(dims[axis] - 1);
            }
            let index = index[0] + dims[0] * (index[1] + dims[1] * index[2]);
            let [x, y, z] = self.volume.gradients.as_ref().map_or([0.0; 3], |gradients| gradients[index]);
            for (sum, texel) in sum.iter_mut().zip([x, y, z, self.volume.values[index]]) {
                *sum += weight * f64::from(texel);
            }
        }
        sum
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small whole number")]
fn whole(value: f64) -> usize {
    value as usize
}

/// Number of samples of the longest ray.
pub fn longest(rungs: &Rungs) -> f64 {
    f64::from(rays(rungs).0.samples)
}

fn rays(rungs: &Rungs) -> (RayTable, View) {
    let aspect = float(rungs.size[0]) / float(rungs.size[1]);
    let view = rungs.scene.camera.view(&rungs.scene.frame.geometry, aspect).unwrap();
    (RayTable::new(&rungs.scene, &view).unwrap(), view)
}

/// Rounding error of sample places in f32, in texture coordinates, and the pixels excluded from comparison.
#[derive(Debug)]
pub struct Places {
    pub error: f64,
    /// Pixels in which a rounding may add or remove a sample: the ray's length is a whole number of steps, or the ray
    /// grazes
    /// the face it enters.
    pub undecided: Vec<bool>,
}

/// Largest factor from a rounding error to the resulting error of a ray's entry; larger factors count as grazing.
const GRAZING: f64 = 8.0;

/// About 16 roundings of numbers up to the farthest coordinate: two each in u and v, three in the base, five in the
/// direction, five in its length, one in a division, one in a difference to the box, and two in the place itself. The
/// division by the direction enlarges them by up to [`GRAZING`]; the factor is measured for each picture.
pub fn places(rungs: &Rungs) -> Places {
    let rays = rays(rungs).0;
    let [width, height] = rungs.size;
    let farthest = (rays.base.abs() + rays.base_u.abs() + rays.base_v.abs()).max_element() + 1.0;
    let step = rungs.scene.accuracy.step_length;
    let mut steepest = 1.0_f64;
    let mut undecided = Vec::new();
    for pixel in 0..width * height {
        let u = 2.0 * (float(pixel % width) + 0.5) / float(width) - 1.0;
        let v = 1.0 - 2.0 * (float(pixel / width) + 0.5) / float(height);
        let base = rays.base + u * rays.base_u + v * rays.base_v;
        let length = (1.0 + u * u * rays.spread_u + v * v * rays.spread_v).sqrt();
        let direction = (rays.direction + u * rays.direction_u + v * rays.direction_v) / length;
        let (a, b) = ((rays.low - base) / direction, (rays.high - base) / direction);
        let (enter, leave) = (a.min(b), a.max(b));
        let (from_box, from_eye) = (enter.max_element(), -rays.eye_distance * length);
        let near = from_box.max(from_eye);
        let steps = (leave.min_element() - near) / step - 0.5;
        let slowest = if from_box > from_eye {
            (0..3).filter(|&axis| enter[axis] >= from_box).map(|axis| direction[axis].abs()).fold(f64::MAX, f64::min)
        } else {
            direction.abs().max_element()
        };
        let grazing = direction.abs().max_element() / slowest;
        let misses = steps < -0.6;
        undecided.push(!misses && ((steps - steps.round()).abs() < 1e-3 || grazing > GRAZING));
        if !misses && grazing <= GRAZING {
            steepest = steepest.max(grazing);
        }
    }
    Places { error: 16.0 * ROUNDING_UNIT * farthest * steepest, undecided }
}
