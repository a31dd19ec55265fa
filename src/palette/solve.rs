//! Search for the open spectra: alternating convex programs for rows and columns, from several starts.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::solution::difference;
use super::start::starts;
use super::step::{Shown, Side, Spectra, form, groups, of_unit_luminance, solved};
use super::{Cell, Member, ModelTerm, Palette, PaletteError, Place, Solution, Target, bound};
use crate::model::{self, ColourModel, Ingredients, ModelKind, Reconstruction};
use crate::progress::Progress;
use crate::spectrum::colour::Xyz;
use crate::spectrum::{Kind, Light, Spectrum, standard};

/// Largest number of alternations between rows and columns.
const ALTERNATIONS: u64 = 60;
/// Number of alternations before the starts are compared and only the best continue.
const TRIAL: u64 = 8;
/// Number of starts that continue.
const FINALISTS: usize = 2;
/// Smallest relative gain of the objective for which a start continues.
const LEAST_GAIN: f64 = 1e-4;
/// ΔE00 below which no cell needs better spectra.
const EXACT: f64 = 1e-3;
/// ΔE00 of the worst cell at which later starts are abandoned.
const GOOD: f64 = 0.02;
/// Initial extrapolation of the lights beyond an alternation, relative to their change.
const STRIDE: f64 = 0.5;
/// Growth factor of the extrapolation after each improving alternation.
const LENGTHENED: f64 = 1.6;
/// Largest number of alternations of a start without improvement.
const SETBACKS: u64 = 8;
const STAGE: &str = "designing spectra";

/// Finds the open spectra of a palette, and reports the differences from the target colours.
///
/// Rows and columns alternate: with fixed lights, the reflectances are the solution of a convex quadratic program in
/// ΔE00, and vice versa. Of several starts, the one with the smallest maximum ΔE00 is kept. Equal palettes have equal
/// solutions, for any number of threads and any order of rows and columns.
///
/// # Errors
///
/// [`PaletteError::Unsolvable`] for a palette without rows or columns, with more than [`super::LARGEST`] of them, or
/// with numbers out of range; [`PaletteError::Model`] if its colour model cannot be fitted;
/// [`PaletteError::Cancelled`]. Unreachable targets are not an error: they are in [`Solution::conflicts`].
pub fn solve(palette: &Palette, progress: &dyn Progress) -> Result<Solution, PaletteError> {
    palette.check()?;
    let order = ByName::new(palette);
    let sorted = order.sorted(palette);
    let model = sorted.model.as_ref().map(|term| fitted(&sorted, term, progress)).transpose()?;
    let search = Search {
        palette: &sorted,
        model: sorted.model.zip(model.as_ref().map(|model| (model, model.reconstruction()))),
        materials: groups(&sorted, Side::Materials),
        lights: groups(&sorted, Side::Lights),
        settled: AtomicUsize::new(usize::MAX),
        done: AtomicU64::new(0),
        progress,
    };
    let spectra = search.best()?;
    let shown = search.shown(&spectra);
    let shown = |place: Place| {
        let place = order.place(place);
        Some(shown.as_ref()?.colour(place, &spectra.materials[place.material]))
    };
    let mut solution = Solution::of(palette, order.as_written(&spectra), shown);
    solution.conflicts = bound::conflicts(&sorted, &spectra, progress)?;
    for conflict in &mut solution.conflicts {
        for cells in [&mut conflict.cells, &mut conflict.part] {
            *cells = cells.iter().map(|&(row, column)| (order.materials[row], order.lights[column])).collect();
            cells.sort_unstable();
        }
    }
    solution.conflicts.sort_by(|one, two| (&one.part, &one.cells).cmp(&(&two.part, &two.cells)));
    Ok(solution)
}

/// Rows and columns sorted by name, so that the solution does not depend on their order in the file.
struct ByName {
    /// File index of each row, in sorted order.
    materials: Vec<usize>,
    lights: Vec<usize>,
}

impl ByName {
    fn new(palette: &Palette) -> Self {
        let order = |members: &[Member]| {
            let mut order: Vec<usize> = (0..members.len()).collect();
            order.sort_by(|&one, &two| members[one].name.cmp(&members[two].name));
            order
        };
        Self { materials: order(&palette.materials), lights: order(&palette.lights) }
    }

    /// Returns the sorted position of `place`, which is in file order.
    fn place(&self, place: Place) -> Place {
        let at = |order: &[usize], index| order.iter().position(|&other| other == index).unwrap_or(index);
        Place { material: at(&self.materials, place.material), light: at(&self.lights, place.light) }
    }

    fn sorted(&self, palette: &Palette) -> Palette {
        let members = |order: &[usize], members: &[Member]| order.iter().map(|&index| members[index].clone()).collect();
        let cell = |cell: &Cell| {
            let Place { material, light } = self.place(Place::of(cell));
            let target = match cell.target {
                Target::Like { material, light } => {
                    let Place { material, light } = self.place(Place { material, light });
                    Target::Like { material, light }
                }
                target => target,
            };
            Cell { material, light, target, weight: cell.weight }
        };
        let mut cells: Vec<Cell> = palette.cells.iter().map(cell).collect();
        cells.sort_by_key(Place::of);
        Palette {
            materials: members(&self.materials, &palette.materials),
            lights: members(&self.lights, &palette.lights),
            cells,
            ..palette.clone()
        }
    }

    /// Returns sorted spectra in file order.
    fn as_written(&self, spectra: &Spectra) -> Spectra {
        let members = |order: &[usize], spectra: &[Spectrum]| {
            let mut written = spectra.to_vec();
            for (spectrum, &index) in spectra.iter().zip(order) {
                written[index] = spectrum.clone();
            }
            written
        };
        Spectra {
            materials: members(&self.materials, &spectra.materials),
            lights: members(&self.lights, &spectra.lights),
        }
    }
}

/// Spectra with the errors of their colours.
#[derive(Clone)]
struct Found {
    spectra: Spectra,
    /// Value of the objective over all cells.
    squares: f64,
    /// Largest ΔE00.
    worst: f64,
}

/// State of one start.
struct Run {
    /// Index among all starts, from 0.
    index: usize,
    best: Found,
    /// Input of the next alternation: the best spectra, or an extrapolation beyond them.
    next: Spectra,
    stride: f64,
    /// Number of alternations without improvement and without extrapolation.
    setbacks: u64,
    ended: bool,
}

/// Data shared by all starts.
struct Search<'a> {
    palette: &'a Palette,
    model: Option<(ModelTerm, (&'a ColourModel, Reconstruction))>,
    materials: Vec<Vec<usize>>,
    lights: Vec<Vec<usize>>,
    /// Index of the first good start; later ones stop.
    settled: AtomicUsize,
    done: AtomicU64,
    progress: &'a dyn Progress,
}

impl Search<'_> {
    /// Returns the spectra with the smallest maximum ΔE00 of all starts.
    fn best(&self) -> Result<Spectra, PaletteError> {
        let mut runs: Vec<Run> = starts(self.palette)
            .into_iter()
            .enumerate()
            .map(|(index, start)| Run {
                index,
                best: Found { spectra: start.clone(), squares: f64::INFINITY, worst: f64::INFINITY },
                next: start,
                stride: 0.0,
                setbacks: 0,
                ended: false,
            })
            .collect();
        let finalists = if self.model.is_some() { runs.len() } else { runs.len().min(FINALISTS) };
        let finalists = u64::try_from(finalists).unwrap_or(1);
        let trials = TRIAL * u64::try_from(runs.len()).unwrap_or(1);
        let total = trials + (ALTERNATIONS - TRIAL) * finalists;
        for alternations in [TRIAL, ALTERNATIONS - TRIAL] {
            let going = runs.into_par_iter().map(|run| self.advanced(run, alternations, total));
            runs = going.collect::<Result<_, _>>()?;
            // The state of a later start depends on when it was stopped, and thus on the threads.
            let settled = self.settled.load(Ordering::Relaxed);
            runs.retain(|run| run.index <= settled);
            if runs.iter().any(|run| run.best.worst <= GOOD) {
                runs.retain(|run| run.best.worst <= GOOD);
            }
            runs.sort_by(|one, two| one.best.squares.total_cmp(&two.best.squares));
            // With a model, the early order of the starts says little about their final order.
            runs.truncate(if self.model.is_some() { runs.len() } else { FINALISTS });
        }
        self.progress.report(STAGE, total, total);
        let best = runs.into_iter().min_by(|one, two| one.best.worst.total_cmp(&two.best.worst));
        best.map(|run| run.best.spectra).ok_or(PaletteError::Cancelled)
    }

    /// Runs up to `alternations` more alternations.
    fn advanced(&self, mut run: Run, alternations: u64, total: u64) -> Result<Run, PaletteError> {
        for _ in 0..alternations {
            if self.progress.cancelled() {
                return Err(PaletteError::Cancelled);
            }
            if run.ended || self.settled.load(Ordering::Relaxed) < run.index {
                break;
            }
            let found = self.alternated(&run.next);
            self.progress.report(STAGE, self.done.fetch_add(1, Ordering::Relaxed) + 1, total);
            // Without open lights nothing alternates: the reflectances only settle.
            let settles = self.lights.is_empty();
            let is_first = run.best.squares.is_infinite();
            let gain = run.best.squares - found.squares;
            if settles || gain > 0.0 {
                run.ended = found.worst <= EXACT || !is_first && gain.abs() <= LEAST_GAIN * run.best.squares;
                run.stride = if is_first || settles { 0.0 } else { f64::max(STRIDE, LENGTHENED * run.stride) };
                run.next = self.beyond(&run.best.spectra, &found.spectra, run.stride);
                run.best = found;
            } else if run.stride > 0.0 {
                // The extrapolation went too far.
                run.stride = 0.0;
                run.next = run.best.spectra.clone();
            } else {
                // The objective omits smoothness, and the metric of relations moves with their colours: a worse result
                // may still lead to a better one.
                run.next = found.spectra;
                run.setbacks += 1;
                run.ended = run.setbacks > SETBACKS;
            }
            if run.best.worst <= GOOD {
                self.settled.fetch_min(run.index, Ordering::Relaxed);
            }
        }
        Ok(run)
    }

    /// Solves the reflectances for the lights of `from`, then the lights for those reflectances.
    fn alternated(&self, from: &Spectra) -> Found {
        let mut spectra = from.clone();
        if !self.materials.is_empty() {
            let shown = self.shown(&spectra);
            spectra = solved(self.palette, Side::Materials, &self.materials, &spectra, shown.as_ref());
        }
        if !self.lights.is_empty() {
            let shown = self.shown(&spectra);
            spectra = solved(self.palette, Side::Lights, &self.lights, &spectra, shown.as_ref());
        }
        let (squares, worst) = self.differences(&spectra, self.shown(&spectra).as_ref());
        Found { spectra, squares, worst }
    }

    /// Extrapolates the open lights of `to` by `stride` times their change since `from`.
    fn beyond(&self, from: &Spectra, to: &Spectra, stride: f64) -> Spectra {
        let mut beyond = to.clone();
        for &light in self.lights.iter().flatten() {
            let way = &to.lights[light] + &from.lights[light].scaled(-1.0);
            let moved = &to.lights[light] + &way.scaled(stride);
            if let Some(moved) = of_unit_luminance(*moved.samples(), self.palette.lights[light].bounds[0]) {
                beyond.lights[light] = moved;
            }
        }
        beyond
    }

    /// Returns the objective over all cells, and the largest weighted ΔE00.
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

    /// Evaluates the palette's model on `spectra`; `None` without a model.
    fn shown(&self, spectra: &Spectra) -> Option<Shown> {
        let (term, (model, reconstruction)) = self.model.as_ref()?;
        let of_light = |light: &Spectrum| {
            let matrix = model.matrix(&Light::of_normalised(light.clone()));
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

/// Fits the palette's colour model of nodes to the `ColorChecker` and the given spectra.
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
