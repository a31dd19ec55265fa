//! Colour differences between a film and its packed numbers, and the coarsest step that keeps a tolerance.

use std::sync::LazyLock;

use glam::DVec3;
use rayon::prelude::*;

use super::PageError;
use super::lights::Lights;
use super::packing::{Channel, Channels, planes};
use crate::film::Film;
use crate::number::count;
use crate::progress::Progress;
use crate::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};

/// Steps in an octave of the search.
const OF_OCTAVE: i32 = 8;

/// Coarsest and finest step of the search, in octaves of codes per unit of a root.
const OCTAVES: [i32; 2] = [4, 16];

/// Pixels of the first search; all pixels are checked at its end.
const SAMPLE: usize = 1 << 14;

/// Pixels that a task compares at a time.
const BLOCK: usize = 1 << 10;

/// A step of the search, and the largest ΔE00 that it adds to any pixel under any light of the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) step: f64,
    pub(super) largest: f64,
}

/// The step of index `index`.
fn step(index: i32) -> f64 {
    (f64::from(index) / f64::from(OF_OCTAVE)).exp2()
}

/// The coarsest step at which packing `films` keeps `tolerance` in every pixel under all `conditions` (XYZ of each plane);
/// the error states the smallest ΔE00 that can be kept.
pub(super) fn search(
    films: &[Film<f32>],
    lights: &Lights,
    channels: &Channels,
    conditions: &[Vec<DVec3>],
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<Found, PageError> {
    let refused = |kept: f64| {
        let numbers = films.iter().flat_map(|film| film.accumulators.iter().chain(&film.transmittance));
        let largest = numbers.fold(0.0_f32, |largest, number| largest.max(number.abs()));
        Err(if kept.is_finite() { PageError::Tolerance { tolerance, kept } } else { PageError::Range { largest } })
    };
    let wanted = || if progress.cancelled() { Err(PageError::Cancelled) } else { Ok(()) };
    let mut sample = sampled(films, lights);
    let [mut least, mut most] = OCTAVES.map(|octave| octave * OF_OCTAVE);
    // The finest step whose codes have two bytes.
    while most > least && channels.at(step(most)).is_none() {
        most -= 1;
    }
    let finest = most;
    let largest = |index: i32, film: &Film<f32>, known: f64| {
        let Some(kept) = channels.at(step(index)) else { return f64::INFINITY };
        compared(film, lights, channels, &kept, step(index), conditions, known).0
    };
    if largest(finest, &sample, 0.0) > tolerance {
        return refused(films.iter().map(|film| largest(finest, film, 0.0)).fold(0.0, f64::max));
    }
    while least < most {
        wanted()?;
        let middle = i32::midpoint(least, most);
        if largest(middle, &sample, 0.0) <= tolerance { most = middle } else { least = middle + 1 }
    }
    let mut index = most;
    loop {
        let Some(kept) = channels.at(step(index)) else { return refused(f64::INFINITY) };
        let mut worst = largest(index, &sample, 0.0);
        for film in films {
            wanted()?;
            let (found, pixel) = compared(film, lights, channels, &kept, step(index), conditions, worst);
            worst = worst.max(found);
            if found > tolerance {
                // The next steps are tried on this pixel first.
                append(&mut sample, &film.of_pixels(&[pixel]));
                break;
            }
        }
        if worst <= tolerance {
            return Ok(Found { step: step(index), largest: worst });
        }
        loop {
            if index >= finest {
                return refused(worst);
            }
            index += 1;
            if largest(index, &sample, 0.0) <= tolerance {
                break;
            }
        }
    }
}

/// Evenly spread pixels of `films` that are not empty, as one film.
fn sampled(films: &[Film<f32>], lights: &Lights) -> Film<f32> {
    let shown = |film: &Film<f32>| -> Vec<usize> {
        let planes = planes(film, lights);
        (0..film.pixels()).filter(|&pixel| planes.iter().any(|plane| plane[pixel] != 0.0)).collect()
    };
    let shown: Vec<Vec<usize>> = films.iter().map(shown).collect();
    let stride = (shown.iter().map(Vec::len).sum::<usize>() / SAMPLE).max(1);
    let mut sample: Option<Film<f32>> = None;
    for (film, shown) in films.iter().zip(shown) {
        let part = film.of_pixels(&shown.into_iter().step_by(stride).collect::<Vec<_>>());
        match &mut sample {
            None => sample = Some(part),
            Some(sample) => append(sample, &part),
        }
    }
    sample.unwrap_or_else(|| Film { size: [0, 1], components: 0, accumulators: Vec::new(), transmittance: Vec::new() })
}

/// Appends the pixels of `part` to `film`, both of one row.
fn append(film: &mut Film<f32>, part: &Film<f32>) {
    let joined = |one: &[f32], two: &[f32]| -> Vec<f32> {
        match (film.pixels(), part.pixels()) {
            (0, _) => two.to_vec(),
            (_, 0) => one.to_vec(),
            (first, second) => {
                let rows = one.chunks_exact(first).zip(two.chunks_exact(second));
                rows.flat_map(|(one, two)| one.iter().chain(two).copied()).collect()
            }
        }
    };
    let accumulators = joined(&film.accumulators, &part.accumulators);
    let transmittance = joined(&film.transmittance, &part.transmittance);
    let size = [film.pixels() + part.pixels(), 1];
    *film = Film { size, components: part.components, accumulators, transmittance };
}

/// The largest ΔE00 of `film` packed with `step`, if above `known`, and its pixel.
pub(super) fn compared(
    film: &Film<f32>,
    lights: &Lights,
    channels: &Channels,
    kept: &[Channel],
    step: f64,
    conditions: &[Vec<DVec3>],
    known: f64,
) -> (f64, usize) {
    let planes = planes(film, lights);
    let codes = channels.codes(&planes, kept, step);
    let values = channels.values(&codes, kept, step);
    difference(&planes, &values, conditions, known)
}

/// The largest ΔE00 between `planes` and `values` under `conditions`, if above `known`, and its pixel.
pub(super) fn difference(
    planes: &[&[f32]],
    values: &[Vec<f32>],
    conditions: &[Vec<DVec3>],
    known: f64,
) -> (f64, usize) {
    let pixels = planes.first().map_or(0, |plane| plane.len());
    let blocks: Vec<usize> = (0..pixels).step_by(BLOCK).collect();
    let narrow = |colour: &DVec3| colour.as_vec3().to_array();
    let conditions: Vec<Vec<[f32; 3]>> = conditions.iter().map(|planes| planes.iter().map(narrow).collect()).collect();
    let block = |&first: &usize| {
        let there = first..(first + BLOCK).min(pixels);
        // An empty pixel has no error.
        let shown: Vec<usize> = there
            .filter(|&pixel| {
                planes.iter().zip(values).any(|(plane, value)| plane[pixel].to_bits() != value[pixel].to_bits())
            })
            .collect();
        let mut worst = (known, first);
        // Contiguous numbers: the sums below are the time of a check.
        let picked = |plane: &[f32]| shown.iter().map(|&pixel| plane[pixel]).collect::<Vec<f32>>();
        let wanted: Vec<Vec<f32>> = planes.iter().map(|plane| picked(plane)).collect();
        let errors: Vec<Vec<f32>> = (values.iter().zip(&wanted))
            .map(|(value, wanted)| picked(value).iter().zip(wanted).map(|(value, wanted)| value - wanted).collect())
            .collect();
        let mut sums = [const { Vec::<f32>::new() }; 6];
        for colours in &conditions {
            for sum in &mut sums {
                sum.clear();
                sum.resize(shown.len(), 0.0);
            }
            let (of_colour, of_error) = sums.split_at_mut(3);
            for ((wanted, errors), colour) in wanted.iter().zip(&errors).zip(colours) {
                for (axis, &part) in colour.iter().enumerate() {
                    add(&mut of_colour[axis], wanted, part);
                    add(&mut of_error[axis], errors, part);
                }
            }
            for (at, &pixel) in shown.iter().enumerate() {
                let colour: [f32; 3] = std::array::from_fn(|axis| sums[axis][at]);
                let error: [f32; 3] = std::array::from_fn(|axis| sums[3 + axis][at]);
                if bound(colour, error) <= worst.0 {
                    continue;
                }
                let one = colour.map(f64::from);
                let two: [f64; 3] = std::array::from_fn(|axis| one[axis] + f64::from(error[axis]));
                let [one, two] = [one, two].map(|xyz| lab_from_xyz(Xyz(xyz), d65_white()));
                if lab_bound(std::array::from_fn(|axis| two.0[axis] - one.0[axis])) <= worst.0 {
                    continue;
                }
                let found = ciede2000(one, two);
                if found.is_nan() || found > worst.0 {
                    worst = (if found.is_nan() { f64::INFINITY } else { found }, pixel);
                }
            }
        }
        worst
    };
    let larger = |one: (f64, usize), two: (f64, usize)| if two.0 > one.0 { two } else { one };
    blocks.par_iter().map(block).reduce(|| (0.0, 0), larger)
}

/// An upper bound of ΔE00 for a difference of CIELAB.
///
/// ΔE00² is at most ΔL*² + 1.867 · (2.25 Δa*² + Δb*²): its weights are at least 1, a* grows by at most a half, and the
/// rotation term is at most √3 of the product of chroma and hue differences.
fn lab_bound([l, a, b]: [f64; 3]) -> f64 {
    (l * l + 1.867 * (2.25 * a * a + b * b)).sqrt()
}

/// An upper bound of ΔE00 between the XYZ `colour` and `colour + error`: L*, a* and b* are linear in cube roots, whose
/// change is that of the colour times a slope between those at its ends.
fn bound(colour: [f32; 3], error: [f32; 3]) -> f64 {
    let white = d65_white().0;
    let [x, y, z] = std::array::from_fn(|axis| {
        let t = f64::from(colour[axis]) / white[axis];
        let d = f64::from(error[axis]) / white[axis];
        let [_, steepest] = slopes(t.min(t + d));
        let [flattest, _] = slopes(t.max(t + d));
        [0.5 * (flattest + steepest) * d, 0.5 * (steepest - flattest) * d.abs()]
    });
    let apart = |one: [f64; 2], two: [f64; 2]| (one[0] - two[0]).abs() + one[1] + two[1];
    lab_bound([116.0 * apart(y, [0.0; 2]), 500.0 * apart(x, y), 200.0 * apart(y, z)])
}

/// `sums += part · numbers`.
fn add(sums: &mut [f32], numbers: &[f32], part: f32) {
    for (sum, &number) in sums.iter_mut().zip(numbers) {
        *sum += number * part;
    }
}

/// Parts of an octave in [`SLOPES`].
const PARTS: usize = 32;

/// Octaves of [`SLOPES`], from 2⁻⁸.
const SPAN: usize = 16;

/// Slope of CIELAB's cube root at the ends of each part of each octave.
static SLOPES: LazyLock<Vec<f64>> = LazyLock::new(|| {
    let end = |index: usize| {
        let (octave, part) = (count(index / PARTS) - 8.0, count(index % PARTS) / count(PARTS));
        slope(octave.exp2() * (1.0 + part))
    };
    (0..=PARTS * SPAN).map(end).collect()
});

/// Lower and upper bound of the slope of CIELAB's cube root at `t`.
fn slopes(t: f64) -> [f64; 2] {
    /// Bits behind the exponent and the part of the octave.
    const REST: u32 = 52 - PARTS.ilog2();
    if t <= KNEE * KNEE * KNEE {
        return [slope(0.0); 2];
    }
    let index = usize::try_from(t.to_bits() >> REST).unwrap_or(usize::MAX).saturating_sub((1023 - 8) * PARTS);
    match (SLOPES.get(index), SLOPES.get(index + 1)) {
        (Some(&upper), Some(&lower)) => [lower, upper],
        _ => [0.0, SLOPES[PARTS * SPAN]],
    }
}

/// Knee of CIELAB's cube root.
const KNEE: f64 = 6.0 / 29.0;

/// Slope of CIELAB's cube root.
fn slope(t: f64) -> f64 {
    if t > KNEE * KNEE * KNEE { 1.0 / (3.0 * t.cbrt().powi(2)) } else { 1.0 / (3.0 * KNEE * KNEE) }
}
