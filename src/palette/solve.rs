//! The search for the open spectra: convex programs for rows and columns in turn, from several starts.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::solution::difference;
use super::start::starts;
use super::step::{Shown, Side, Spectra, form, groups, solved};
use super::{ModelTerm, Palette, PaletteError, Place, Solution, bound};
use crate::model::{self, ColourModel, Ingredients, ModelKind, Reconstruction};
use crate::progress::Progress;
use crate::spectrum::colour::Xyz;
use crate::spectrum::{Kind, Light, Spectrum, standard};

/// How often rows and columns take turns, at most.
const ALTERNATIONS: u64 = 60;
/// A smaller share of the squares gained by an alternation is not worth another one.
const LEAST_GAIN: f64 = 1e-4;
/// Cells within this ΔE00 need no better spectra.
const EXACT: f64 = 1e-3;
/// Once every cell is within this ΔE00, later starts are not looked at.
const GOOD: f64 = 0.02;
const STAGE: &str = "designing spectra";

/// Finds the open spectra of a palette, and tells how near their colours come to what was asked.
///
/// Rows and columns take turns: with the lights fixed, the reflectances are the solution of a convex quadratic program
/// in ΔE00, and the other way round. Of several starts the one with the least largest ΔE00 is kept. Equal palettes have
/// equal solutions, on any number of threads.
///
/// # Errors
///
/// [`PaletteError::Unsolvable`] for a palette without rows or columns, of more than [`super::LARGEST`] of them, or of
/// numbers that cannot be computed with; [`PaletteError::Model`] when its colour model cannot be fitted;
/// [`PaletteError::Cancelled`]. What cannot be had is no error: [`Solution::conflicts`] tells of it.
pub fn solve(palette: &Palette, progress: &dyn Progress) -> Result<Solution, PaletteError> {
    palette.check()?;
    let model = palette.model.as_ref().map(|term| fitted(palette, term, progress)).transpose()?;
    let search = Search {
        palette,
        model: palette.model.zip(model.as_ref().map(|model| (model, model.reconstruction()))),
        materials: groups(palette, Side::Materials),
        lights: groups(palette, Side::Lights),
        settled: AtomicUsize::new(usize::MAX),
        done: AtomicU64::new(0),
        progress,
    };
    let starts = starts(palette);
    let total = ALTERNATIONS * u64::try_from(starts.len()).unwrap_or(1);
    let found: Result<Vec<_>, PaletteError> =
        starts.into_par_iter().enumerate().map(|(index, start)| search.run(index, start, total)).collect();
    let settled = search.settled.load(Ordering::Relaxed);
    let mut best: Option<(f64, Spectra)> = None;
    // What a later start came to depends on when it was told to stop.
    for (worst, spectra) in found?.into_iter().take(settled.saturating_add(1)) {
        if best.as_ref().is_none_or(|(least, _)| worst < *least) {
            best = Some((worst, spectra));
        }
    }
    progress.report(STAGE, total, total);
    let Some((_, spectra)) = best else { return Err(PaletteError::Cancelled) };
    let shown = search.shown(&spectra);
    let shown = |place: Place| Some(shown.as_ref()?.colour(place, &spectra.materials[place.material]));
    let mut solution = Solution::of(palette, spectra.clone(), shown);
    solution.conflicts = bound::conflicts(palette, &spectra, progress)?;
    Ok(solution)
}

/// What all starts share.
struct Search<'a> {
    palette: &'a Palette,
    model: Option<(ModelTerm, (&'a ColourModel, Reconstruction))>,
    materials: Vec<Vec<usize>>,
    lights: Vec<Vec<usize>>,
    /// The first start that is good; later ones need not go on.
    settled: AtomicUsize,
    done: AtomicU64,
    progress: &'a dyn Progress,
}

impl Search<'_> {
    /// The largest ΔE00 that a start leads to, and the spectra.
    fn run(&self, index: usize, start: Spectra, total: u64) -> Result<(f64, Spectra), PaletteError> {
        let mut spectra = start;
        let mut shown = self.shown(&spectra);
        let (mut last, mut worst) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..ALTERNATIONS {
            if self.progress.cancelled() {
                return Err(PaletteError::Cancelled);
            }
            if self.settled.load(Ordering::Relaxed) < index {
                break;
            }
            if !self.materials.is_empty() {
                spectra = solved(self.palette, Side::Materials, &self.materials, &spectra, shown.as_ref());
            }
            if !self.lights.is_empty() {
                shown = self.shown(&spectra);
                spectra = solved(self.palette, Side::Lights, &self.lights, &spectra, shown.as_ref());
            }
            shown = self.shown(&spectra);
            let squares;
            (squares, worst) = self.differences(&spectra, shown.as_ref());
            self.progress.report(STAGE, self.done.fetch_add(1, Ordering::Relaxed) + 1, total);
            if worst <= EXACT || last.is_finite() && (last - squares).abs() <= LEAST_GAIN * last {
                break;
            }
            last = squares;
        }
        if worst <= GOOD {
            self.settled.fetch_min(index, Ordering::Relaxed);
        }
        Ok((worst, spectra))
    }

    /// What the programs make small, over all cells, and the largest ΔE00 times its weight.
    fn differences(&self, spectra: &Spectra, shown: Option<&Shown>) -> (f64, f64) {
        let colour = |place: Place| Xyz(spectra.xyz(place).to_array());
        let (mut squares, mut worst) = (0.0, 0.0);
        for cell in &self.palette.cells {
            let place = Place::of(cell);
            let seen = colour(place);
            let form = form(cell, |place| spectra.xyz(place));
            let mut add = |other: Xyz, weight: f64| {
                let apart = form * (DVec3::from(seen.0) - DVec3::from(other.0)) * weight;
                squares += apart.length_squared();
                worst = f64::max(worst, cell.weight * weight * difference(seen, other));
            };
            add(cell.wanted(colour), 1.0);
            if let Some(shown) = shown {
                add(shown.colour(place, &spectra.materials[place.material]), shown.weight);
            }
        }
        (squares, worst)
    }

    /// What the palette's model shows of spectra, where there is one.
    fn shown(&self, spectra: &Spectra) -> Option<Shown> {
        let (term, (model, reconstruction)) = self.model.as_ref()?;
        let of_light = |light: &Spectrum| {
            let matrix = model.matrix(&Light::normalised(light.clone()));
            std::array::from_fn(|axis| {
                let parts = matrix.xyz.iter().zip(model.projection());
                parts.fold(Spectrum::constant(0.0), |sum, (column, row)| &sum + &row.scaled(column[axis]))
            })
        };
        let rebuilt = |row: &Spectrum| reconstruction.spectrum(&model.coefficients(row));
        Some(Shown {
            xyz: spectra.lights.par_iter().map(of_light).collect(),
            rebuilt: spectra.materials.iter().map(rebuilt).collect(),
            weight: term.weight,
        })
    }
}

/// The model of nodes that the palette is to be shown with: fitted on the `ColorChecker` and the given spectra.
fn fitted(palette: &Palette, term: &ModelTerm, progress: &dyn Progress) -> Result<ColourModel, PaletteError> {
    let patches = standard::names(Kind::Reflectance).iter().filter_map(|name| standard::reflectance(name).ok());
    let given = palette.materials.iter().filter_map(|row| row.spectrum.clone());
    let lights = palette
        .lights
        .iter()
        .filter_map(|column| Some((column.name.clone(), Light::new(column.spectrum.clone()?).ok()?)));
    let ingredients = Ingredients {
        reflectances: patches.map(|patch| patch.spectrum().clone()).chain(given).collect(),
        lights: lights.collect(),
        ..Ingredients::default()
    };
    let failed = |source| match source {
        model::ModelError::Cancelled => PaletteError::Cancelled,
        source => PaletteError::Model { palette: palette.source.clone(), source },
    };
    model::fit(&ingredients, ModelKind::Nodes, term.dimension, progress).map_err(failed)
}
