//! The coarsest step of a page's numbers that keeps a tolerance.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::PageError;
use super::difference::{Compared, Conditions, Largest};
use super::lights::Lights;
use super::packing::{BLOCK, Channels, blocks, planes};
use relume_base::progress::{Progress, unreported};
use relume_scene::film::Film;

/// Steps in an octave of the search.
const OF_OCTAVE: i32 = 8;

/// Coarsest and finest step of the search, in octaves of codes per unit of a root.
const OCTAVES: [i32; 2] = [4, 16];

/// Pixels of the first search; all pixels are checked at its end.
const SAMPLE: usize = 1 << 14;

/// Pixels above the tolerance with which a comparison ends before all are compared.
const ENOUGH: usize = 1 << 8;

/// A step, and the largest ΔE00 that it adds to any pixel under any light of the page, if that was searched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) step: f64,
    pub(super) largest: Option<f64>,
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
    let conditions = Conditions::new(conditions);
    let compared = |film: &Film<f32>, index: i32, limit: f64, known: f64, progress: &dyn Progress| {
        compared(film, lights, channels, step(index), &conditions, (limit, known), progress)
    };
    let quiet = unreported(progress);
    let refused = |index: i32| -> Result<Found, PageError> {
        let mut kept = 0.0;
        for film in films {
            kept = compared(film, index, f64::INFINITY, kept, progress)?.largest;
        }
        let numbers = films.iter().flat_map(|film| film.accumulators.iter().chain(&film.transmittance));
        let largest = numbers.fold(0.0_f32, |largest, number| largest.max(number.abs()));
        Err(if kept.is_finite() { PageError::Tolerance { tolerance, kept } } else { PageError::Range { largest } })
    };
    let [mut least, mut most] = OCTAVES.map(|octave| octave * OF_OCTAVE);
    // The finest step whose codes have two bytes.
    while most > least && channels.at(step(most)).is_none() {
        most -= 1;
    }
    let finest = most;
    let mut sample = sampled(films, lights);
    let keeps = |index: i32, sample: &Film<f32>| -> Result<bool, PageError> {
        Ok(compared(sample, index, tolerance, tolerance, &quiet)?.largest <= tolerance)
    };
    if !keeps(finest, &sample)? {
        return refused(finest);
    }
    while least < most {
        progress.report(
            "searching the rounding on a sample",
            u64::from(finest.abs_diff(most - least)),
            finest.unsigned_abs().into(),
        );
        let middle = i32::midpoint(least, most);
        if keeps(middle, &sample)? { most = middle } else { least = middle + 1 }
    }
    let mut index = most;
    loop {
        let mut worst = compared(&sample, index, tolerance, 0.0, &quiet)?.largest;
        for film in films {
            let Compared { largest, above } = compared(film, index, tolerance, worst, progress)?;
            worst = worst.max(largest);
            if !above.is_empty() {
                // The next steps are tried on these pixels first.
                append(&mut sample, &film.of_pixels(&above));
                break;
            }
        }
        if worst <= tolerance {
            return Ok(Found { step: step(index), largest: Some(worst) });
        }
        loop {
            if index >= finest {
                return refused(finest);
            }
            index += 1;
            if keeps(index, &sample)? {
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

/// Compares `film` with its numbers packed with `step`. ΔE00 up to `known` and pixels up to `limit` are not told apart.
fn compared(
    film: &Film<f32>,
    lights: &Lights,
    channels: &Channels,
    step: f64,
    conditions: &Conditions,
    (limit, known): (f64, f64),
    progress: &dyn Progress,
) -> Result<Compared, PageError> {
    let Some(kept) = channels.at(step) else {
        return Ok(Compared { largest: f64::INFINITY, above: Vec::new() });
    };
    let (largest, done, found) = (Largest::new(known), AtomicUsize::new(0), AtomicUsize::new(0));
    let block = |(index, planes): (usize, Vec<&[f32]>)| -> Vec<usize> {
        if progress.cancelled() || found.load(Ordering::Relaxed) > ENOUGH {
            return Vec::new();
        }
        let all = film.pixels().div_ceil(BLOCK);
        progress.report("comparing all pixels", done.fetch_add(1, Ordering::Relaxed) as u64, all as u64);
        if planes.iter().all(|plane| plane.iter().all(|&number| number == 0.0)) {
            // An empty pixel has no error.
            return Vec::new();
        }
        let values = channels.values(&channels.codes(&planes, &kept, step), &kept, step);
        let above = conditions.above(&planes, &values, limit, &largest);
        found.fetch_add(above.len(), Ordering::Relaxed);
        above.into_iter().map(|pixel| index * BLOCK + pixel).collect()
    };
    let above = blocks(&planes(film, lights)).enumerate().map(block).collect::<Vec<_>>().concat();
    if progress.cancelled() { Err(PageError::Cancelled) } else { Ok(Compared { largest: largest.read(), above }) }
}
