//! The march along rays, front to back. `shaders/march.wgsl` is its twin: same names, same order.

use rayon::prelude::*;

use super::real::{dot, power, unit};
use super::{Real, ReferenceError, Samples, Step};
use crate::number::count;
use crate::plan::{Planned, PositionCounts};
use crate::progress::Progress;
use crate::scene::{Mix, Scene};
use crate::spectrum::colour::{Xyz, xyz_of};
use crate::spectrum::{BANDS, Spectrum};
use crate::tables::{Accumulation, PositionTable, RayTable};

/// A ray through a pixel.
#[derive(Clone, Copy, Debug)]
struct Ray<R> {
    base: [R; 3],
    direction: [R; 3],
    /// Where samples start, in world units from `base`.
    start: R,
    /// How many samples there are.
    samples: usize,
    /// Towards the eye, in the volume's own axes.
    view: [R; 3],
}

/// The numbers of a frame.
struct Frame<'a, R> {
    scene: &'a Scene,
    planned: &'a Planned,
    rays: RayTable,
    lights: Vec<[R; 3]>,
    step_length: R,
    termination: R,
    size: [usize; 2],
}

impl<'a, R: Real> Frame<'a, R> {
    fn new(scene: &'a Scene, planned: &'a Planned, size: [usize; 2]) -> Result<Self, ReferenceError> {
        let aspect = count(size[0]) / count(size[1]);
        let view = scene.camera.view(&scene.volume.geometry, aspect).ok_or(ReferenceError::Camera)?;
        let step_length = scene.accuracy.step_length;
        let rays = RayTable::new(scene, &view).ok_or(ReferenceError::TooManySamples { step_length })?;
        let lights = PositionTable::new(scene, planned).0;
        Ok(Self {
            scene,
            planned,
            rays,
            lights: lights.into_iter().map(|light| light.to_array().map(R::from_f64)).collect(),
            step_length: R::from_f64(rays.step_length),
            termination: R::from_f64(scene.accuracy.termination),
            size,
        })
    }

    /// The ray through pixel `[x, y]`, y down.
    fn ray_through(&self, [x, y]: [usize; 2]) -> Ray<R> {
        let rays = &self.rays;
        let from = |vector: glam::DVec3| vector.to_array().map(R::from_f64);
        let one = R::from_f64(1.0);
        let half = R::from_f64(0.5);
        let centre = |i: usize, n: usize| (R::from_f64(count(i)) + half) * R::from_f64(2.0 / count(n));
        let u = centre(x, self.size[0]) - one;
        let v = one - centre(y, self.size[1]);
        let along = |middle: [R; 3], right: [R; 3], up: [R; 3]| -> [R; 3] {
            std::array::from_fn(|axis| v.mul_add(up[axis], u.mul_add(right[axis], middle[axis])))
        };
        let base = along(from(rays.base), from(rays.base_u), from(rays.base_v));
        let slant = along(from(rays.direction), from(rays.direction_u), from(rays.direction_v));
        let (spread_u, spread_v) = (R::from_f64(rays.spread_u), R::from_f64(rays.spread_v));
        let length = (v * v).mul_add(spread_v, (u * u).mul_add(spread_u, one)).sqrt();
        let direction = slant.map(|component| component / length);

        // From the eye on, within the box.
        let mut near = -(R::from_f64(rays.eye_distance) * length);
        let mut far = R::from_f64(FAR);
        let (low, high) = (from(rays.low), from(rays.high));
        for axis in 0..3 {
            let [enter, leave] = between(base[axis], direction[axis], low[axis], high[axis]);
            near = near.max(enter);
            far = far.min(leave);
        }
        let steps = ((far - near) / self.step_length - half).ceil();
        let samples = if far > near { steps.max(R::default()).index().min(rays.samples as usize) } else { 0 };
        let local_scale = from(rays.local_scale);
        let view = std::array::from_fn(|axis| -(direction[axis] * local_scale[axis]));
        Ray { base, direction, start: near, samples, view }
    }

    /// Marches pixel `[x, y]`; `deposit(transmittance, position, source)` takes what every step adds. Returns the light
    /// that passes.
    fn march_pixel(&self, samples: &impl Samples<R>, pixel: [usize; 2], mut deposit: impl FnMut(R, usize, &[R])) -> R {
        let ray = self.ray_through(pixel);
        let mut transmittance = R::from_f64(1.0);
        let mut step = Step::default();
        let mut source = vec![R::default(); self.planned.plan.components()];
        for n in 0..ray.samples {
            let s = (R::from_f64(count(n)) + R::from_f64(0.5)).mul_add(self.step_length, ray.start);
            let place = std::array::from_fn(|axis| s.mul_add(ray.direction[axis], ray.base[axis]));
            samples.sample(place, &mut step);
            for position in 0..self.planned.positions.len() {
                self.shade(position, &ray, place, &step, &mut source);
                deposit(transmittance, position, &source);
            }
            transmittance = pass_by(transmittance, step.opacity);
            if transmittance < self.termination {
                break;
            }
        }
        transmittance
    }

    /// What a step sends to the eye for light from `position`: per material, and white for highlights.
    fn shade(&self, position: usize, ray: &Ray<R>, place: [R; 3], step: &Step<R>, source: &mut [R]) {
        let plan = &self.planned.plan;
        let materials = plan.materials();
        let PositionCounts { ambient, headlight, directional, .. } = plan.positions;
        let used = || self.planned.materials.iter().map(|&m| &self.scene.materials[m]);
        if position < ambient {
            source[..materials].copy_from_slice(&step.weights);
            source[materials..].fill(R::default());
            return;
        }
        let light = if position < ambient + headlight {
            ray.view
        } else if position < ambient + headlight + directional {
            self.lights[position]
        } else {
            let local_scale = self.rays.local_scale.to_array().map(R::from_f64);
            unit(std::array::from_fn(|axis| self.lights[position][axis] - place[axis] * local_scale[axis]))
        };
        let facing = dot(step.normal, light).abs();
        for ((part, &weight), material) in source.iter_mut().zip(&step.weights).zip(used()) {
            *part = weight * R::from_f64(material.diffuse).mul_add(facing, R::from_f64(material.ambient));
        }
        if plan.specular().is_some() {
            let halfway = unit(std::array::from_fn(|axis| light[axis] + ray.view[axis]));
            let facing = dot(step.normal, halfway).abs();
            let mut white = R::default();
            for (&weight, material) in step.weights.iter().zip(used()) {
                white = (weight * R::from_f64(material.specular)).mul_add(power(facing, material.exponent), white);
            }
            source[materials] = white;
        }
    }
}

/// Farther than any box.
const FAR: f64 = 1e30;

/// Where a ray's coordinate `base + s·direction` is between `low` and `high`; a ray along the faces is, or never is.
fn between<R: Real>(base: R, direction: R, low: R, high: R) -> [R; 2] {
    let far = R::from_f64(FAR);
    if direction.abs() < R::from_f64(1e-30) {
        return if low <= base && base <= high { [-far, far] } else { [far, -far] };
    }
    let (a, b) = ((low - base) / direction, (high - base) / direction);
    [a.min(b), a.max(b)]
}

/// Adds one premultiplied sample front to back, `A += T·s`.
pub fn composite<R: Real>(accumulator: &mut [R], source: &[R], transmittance: R) {
    for (sum, &part) in accumulator.iter_mut().zip(source) {
        *sum = transmittance.mul_add(part, *sum);
    }
}

/// The light that passes a step, `T − T·α`, rounded once (`T *= 1 − α` drifts over many equal steps: COLOUR.md A7).
pub fn pass_by<R: Real>(transmittance: R, opacity: R) -> R {
    (-transmittance).mul_add(opacity, transmittance)
}

/// Marches every pixel of a picture of `size` (width, height) in the planned model.
///
/// # Errors
///
/// [`ReferenceError`].
pub fn march<R: Real>(
    scene: &Scene,
    planned: &Planned,
    samples: &impl Samples<R>,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Accumulation<R>, ReferenceError> {
    let frame = Frame::<R>::new(scene, planned, size)?;
    let components = planned.plan.components();
    let kept = components * planned.positions.len();
    let rows = by_rows(size, progress, |y| {
        let mut row = vec![R::default(); (kept + 1) * size[0]];
        for (x, pixel) in row.chunks_exact_mut(kept + 1).enumerate() {
            let (sums, rest) = pixel.split_at_mut(kept);
            rest[0] = frame.march_pixel(samples, [x, y], |transmittance, position, source| {
                composite(&mut sums[position * components..][..components], source, transmittance);
            });
        }
        row
    })?;
    let pixels = size[0] * size[1];
    let mut accumulation =
        Accumulation { size, weights: vec![R::default(); kept * pixels], transmittance: vec![R::default(); pixels] };
    for (i, pixel) in rows.iter().flat_map(|row| row.chunks_exact(kept + 1)).enumerate() {
        for (k, &weight) in pixel[..kept].iter().enumerate() {
            accumulation.weights[k * pixels + i] = weight;
        }
        accumulation.transmittance[i] = pixel[kept];
    }
    Ok(accumulation)
}

/// The truth: every pixel marched with all 81 bands in f64, lit by `mix`. XYZ of each pixel, background included, and
/// the light that passes.
///
/// # Errors
///
/// [`ReferenceError`].
pub fn full_spectrum(
    scene: &Scene,
    planned: &Planned,
    samples: &impl Samples<f64>,
    mix: &Mix,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<(Vec<Xyz>, Vec<f64>), ReferenceError> {
    let frame = Frame::<f64>::new(scene, planned, size)?;
    let (light_at, all) = mix.light_at(planned.positions.len());
    let reflectances: Vec<&[f64; BANDS]> =
        planned.materials.iter().map(|&m| scene.materials[m].reflectance.spectrum().samples()).collect();
    let rows = by_rows(size, progress, |y| {
        let mut row = Vec::with_capacity(size[0]);
        for x in 0..size[0] {
            let mut spectrum = [0.0; BANDS];
            let passed = frame.march_pixel(samples, [x, y], |transmittance, position, source| {
                for (band, sum) in spectrum.iter_mut().enumerate() {
                    // What a step reflects in this band: every material its own share, highlights all of it.
                    let reflected: f64 = source
                        .iter()
                        .enumerate()
                        .map(|(c, &part)| part * reflectances.get(c).map_or(1.0, |reflectance| reflectance[band]))
                        .sum();
                    *sum += transmittance * reflected * light_at[position].samples()[band];
                }
            });
            if let Some(background) = &scene.background {
                for (band, sum) in spectrum.iter_mut().enumerate() {
                    *sum += passed * all.samples()[band] * background.spectrum().samples()[band];
                }
            }
            row.push((xyz_of(&Spectrum::from_samples(spectrum)), passed));
        }
        row
    })?;
    Ok(rows.into_iter().flatten().unzip())
}

/// `row(y)` for every row of a picture, in parallel, reported and cancellable.
fn by_rows<T: Send>(
    size: [usize; 2],
    progress: &dyn Progress,
    row: impl Fn(usize) -> T + Sync,
) -> Result<Vec<T>, ReferenceError> {
    let done = std::sync::atomic::AtomicU64::new(0);
    (0..size[1])
        .into_par_iter()
        .map(|y| {
            if progress.cancelled() {
                return Err(ReferenceError::Cancelled);
            }
            let row = row(y);
            let done = done.fetch_add(1, std::sync::atomic::Ordering::Relaxed) + 1;
            progress.report("marching the reference", done, size[1] as u64);
            Ok(row)
        })
        .collect()
}
