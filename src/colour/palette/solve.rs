//! Search for the open spectra: alternating convex programs for rows and columns, from several starts.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::bound::is_open;
use super::solution::difference;
use super::start::{further_starts, starts};
use super::step::{Metric, Shown, Side, Spectra, connected, form, groups, of_unit_luminance, solved};
use super::{Cell, LAMP, Member, ModelTerm, NATURAL, Palette, PaletteError, Place, Solution, Target, bound};
use crate::model::{self, ColourModel, Ingredients, ModelKind, Reconstruction};
use crate::spectrum::colour::Xyz;
use crate::spectrum::metric::difference_matrix;
use crate::spectrum::{Kind, Light, Spectrum, standard};
use relume_base::number::count;
use relume_base::progress::Progress;

/// How far a set of starts is followed.
struct Effort {
    /// Progress stage.
    stage: &'static str,
    /// Alternations of each start in a round, and the number of starts that continue after it.
    rounds: &'static [(u64, usize)],
    /// Smallest relative gain of the objective for which a start continues.
    least_gain: f64,
    /// Whether an extrapolation that went too far is shortened before it is given up.
    shortens: bool,
}

/// Effort for the starts that every palette has.
const FIRST: Effort =
    Effort { stage: "designing spectra", rounds: &[(8, 2), (52, 2)], least_gain: 1e-4, shortens: false };
/// Effort for the further starts of a palette that misses its targets. Near-black cells gain little with each
/// alternation, for a long time.
const FURTHER: Effort = Effort {
    stage: "designing spectra from further starts",
    rounds: &[(3, 5), (5, 3), (100, 3)],
    least_gain: 1e-5,
    shortens: true,
};
/// ΔE00 below which no cell needs better spectra.
const EXACT: f64 = 1e-3;
/// ΔE00 of the worst cell at which later starts are abandoned.
const GOOD: f64 = 0.02;
/// ΔE00 of the worst cell up to which the first starts suffice: a tenth of a just noticeable difference.
const INVISIBLE: f64 = 0.1;
/// Share of the objective that its proven lower bound has when the first starts suffice: root mean squares within 10 %.
const PROVEN: f64 = 0.81;
/// Initial extrapolation of the lights beyond an alternation, relative to their change.
const STRIDE: f64 = 0.5;
/// Growth factor of the extrapolation after each improving alternation.
const LENGTHENED: f64 = 1.6;
/// Bounds of a light in the narrowest search, in multiples of its mean.
const BROAD: [f64; 2] = [0.0, 3.0];
/// Factor of an extrapolation that went too far.
const SHORTENED: f64 = 0.25;
/// Largest number of alternations of a start without improvement.
const SETBACKS: u64 = 8;
/// Progress stage of the search that minimises the largest ΔE00.
const MINIMAX_STAGE: &str = "reducing the largest colour difference";
/// Weighted ΔE00 of the worst cell beyond which the largest ΔE00 is minimised, in place of the squares.
const FAR: f64 = 10.0;
/// Alternations of each start that minimise the largest ΔE00: in a first round, and in a second one of the best starts.
const MINIMAX_ALTERNATIONS: [u64; 2] = [6, 54];
/// Number of starts that continue after the first.
const MINIMAX_KEPT: usize = 3;
/// Smallest relative gain of the largest ΔE00 that counts.
const MINIMAX_GAIN: f64 = 1e-4;
/// Number of alternations without such a gain after which a start ends.
const MINIMAX_IDLE: u64 = 8;
/// Smallest weight of a cell in them, relative to the mean.
const LEAST_WEIGHT: f64 = 1e-6;
/// Step of a numerical slope of ΔE00, in XYZ.
const STEP: f64 = 1e-5;

/// Finds the open spectra of a palette, and reports the differences from the target colours.
///
/// Rows and columns alternate: with fixed lights, the reflectances are the solution of a convex quadratic program in
/// ΔE00, and vice versa. Of several starts, the one with the smallest maximum ΔE00 is kept. A palette that misses its
/// targets has further starts (docs/theory/palettes.md). Equal palettes have equal solutions, for any number of threads
/// and any order of rows and columns.
///
/// # Errors
///
/// [`PaletteError::Unsolvable`] for a palette without rows or columns, with more than [`super::LARGEST`] of them, or
/// with numbers out of range; [`PaletteError::Model`] if its colour model cannot be fitted;
/// [`PaletteError::Cancelled`]. Unreachable targets are not an error: they are in [`Solution::conflicts`].
pub fn solve(palette: &Palette, progress: &dyn Progress) -> Result<Solution, PaletteError> {
    solve_with(palette, None, progress)
}

/// As [`solve`], with one more start: the spectra in `start` of rows and columns that `palette` leaves open, by their
/// names. The solution is not worse than without it. If `start` has all open spectra, within the bounds and with no less
/// smoothness, the solution is not worse than they are either. (Below ΔE00 0.001 no solution is better than another.)
///
/// # Errors
///
/// As [`solve`], and [`PaletteError::Unsolvable`] for a `start` without such a spectrum.
pub fn solve_from(palette: &Palette, start: &Palette, progress: &dyn Progress) -> Result<Solution, PaletteError> {
    solve_with(palette, Some(start), progress)
}

fn solve_with(palette: &Palette, start: Option<&Palette>, progress: &dyn Progress) -> Result<Solution, PaletteError> {
    palette.check()?;
    let order = ByName::new(palette);
    let sorted = order.sorted(palette);
    let model = sorted.model.as_ref().map(|term| fitted(&sorted, term, progress)).transpose()?;
    let search = Search::new(&sorted, model.as_ref(), progress);
    let known = start.map(|start| search.known(start)).transpose()?;
    let mut found = search.best()?;
    if let Some(known) = known {
        found = search.improved(found, known)?;
    }
    let spectra = found.spectra;
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

/// Returns the palette with the bounds of its open spectra within these bounds of reflectances and of lights; `None` if
/// they are already.
fn narrowed(palette: &Palette, reflectances: [f64; 2], lights: [f64; 2]) -> Option<Palette> {
    let mut narrow = palette.clone();
    for (members, [least, most]) in [(&mut narrow.materials, reflectances), (&mut narrow.lights, lights)] {
        for member in members.iter_mut().filter(|member| member.spectrum.is_none()) {
            let bounds = [member.bounds[0].max(least), member.bounds[1].min(most)];
            if bounds[0] < bounds[1] {
                member.bounds = bounds;
            }
        }
    }
    (narrow != *palette).then_some(narrow)
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

impl Found {
    /// No result yet, from these spectra.
    fn nothing(spectra: Spectra) -> Self {
        Self { spectra, squares: f64::INFINITY, worst: f64::INFINITY }
    }
}

/// Returns the first of those with the smallest maximum ΔE00.
fn least(found: impl IntoIterator<Item = Found>) -> Result<Found, PaletteError> {
    found.into_iter().min_by(|one, two| one.worst.total_cmp(&two.worst)).ok_or(PaletteError::Cancelled)
}

/// State of one start.
struct Run {
    /// Index among all starts, from 0.
    index: usize,
    best: Found,
    /// The best spectra before those.
    before: Spectra,
    /// Input of the next alternation: the best spectra, or an extrapolation beyond them.
    next: Spectra,
    stride: f64,
    /// Number of alternations without improvement and without extrapolation.
    setbacks: u64,
    ended: bool,
}

/// State of one start while its largest ΔE00 is minimised.
#[derive(Clone)]
struct MinimaxRun {
    best: Found,
    /// Input of the next alternation.
    spectra: Spectra,
    /// Weights of the squares of cells far from their targets, and of the cells coupled with them.
    weights: Vec<Option<f64>>,
    /// Whether the metrics have the slopes of ΔE00. Either may end nearer to the targets.
    has_slopes: bool,
    /// Number of the last alternations without a gain.
    idle: u64,
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

/// Start of the search.
#[derive(Clone)]
enum Start {
    /// Spectra to alternate from.
    Rough(Spectra),
    /// Solution of another search, which a result must not be worse than.
    Solved(Found),
}

impl<'a> Search<'a> {
    fn new(palette: &'a Palette, model: Option<&'a ColourModel>, progress: &'a dyn Progress) -> Self {
        Self {
            palette,
            model: palette.model.zip(model.map(|model| (model, model.reconstruction()))),
            materials: groups(palette, Side::Materials),
            lights: groups(palette, Side::Lights),
            settled: AtomicUsize::new(usize::MAX),
            done: AtomicU64::new(0),
            progress,
        }
    }

    /// Returns the spectra with the smallest maximum ΔE00 of all starts.
    fn best(&self) -> Result<Found, PaletteError> {
        let rough = |starts: &[Spectra]| starts.iter().cloned().map(Start::Rough).collect::<Vec<_>>();
        let mut starts = starts(self.palette);
        let first = self.searched(rough(&starts), &FIRST)?;
        if first.worst <= EXACT {
            return Ok(first);
        }
        let narrow = self.narrow(NATURAL, LAMP)?;
        let relaxed = self.unproven(&first)?;
        // The search within the default bounds has its own search of broad lights.
        let broad = if relaxed.is_some() && narrow.is_none() { self.narrow(NATURAL, BROAD)? } else { None };
        let mut found: Vec<Found> = [Some(first), narrow, broad].into_iter().flatten().collect();
        if let Some(relaxed) = relaxed {
            let further = further_starts(self.palette, &relaxed.lights);
            let solved = found.iter().cloned().map(Start::Solved);
            found.push(self.searched(rough(&further).into_iter().chain(solved).collect(), &FURTHER)?);
            starts.extend(further);
        }
        self.minimax(found, starts)
    }

    /// Returns the one of `found` with the smallest maximum ΔE00. If all are far from their targets, first minimises their
    /// maximum ΔE00, and that from `starts`, until it is no longer far.
    ///
    /// The weights of the cells follow their errors (Lawson 1961). Under given lights alone the result stays that of least
    /// squares, of which reports state a bound.
    fn minimax(&self, found: Vec<Found>, starts: Vec<Spectra>) -> Result<Found, PaletteError> {
        let best = least(found.iter().cloned())?;
        let far = self.far_parts(&best.spectra);
        if best.worst <= FAR || far.is_empty() || self.model.is_some() {
            return Ok(best);
        }
        let mut weights = vec![None; self.palette.cells.len()];
        for &cell in far.iter().flatten() {
            weights[cell] = Some(1.0);
        }
        // Elsewhere the spectra found stay.
        let start = |from: Spectra| {
            let mut start = best.spectra.clone();
            for place in far.iter().flatten().flat_map(|&cell| Place::both(&self.palette.cells[cell])) {
                start.materials[place.material] = from.materials[place.material].clone();
                start.lights[place.light] = from.lights[place.light].clone();
            }
            Found::nothing(start)
        };
        let run = |best: Found| MinimaxRun {
            spectra: best.spectra.clone(),
            best,
            weights: weights.clone(),
            has_slopes: false,
            idle: 0,
        };
        let runs: Vec<MinimaxRun> = found.into_iter().chain(starts.into_iter().map(start)).map(run).collect();
        let [first, second] = MINIMAX_ALTERNATIONS;
        let number = |runs: usize| u64::try_from(runs).unwrap_or(1);
        let total = first * number(runs.len()) + second * number(2 * runs.len().min(MINIMAX_KEPT));
        self.done.store(0, Ordering::Relaxed);
        let mut runs = self.minimax_round(runs, &far, first, total)?;
        runs.sort_by(|one, two| one.best.worst.total_cmp(&two.best.worst));
        runs.truncate(MINIMAX_KEPT);
        let both = |run: MinimaxRun| [false, true].map(|has_slopes| MinimaxRun { has_slopes, idle: 0, ..run.clone() });
        let runs = self.minimax_round(runs.into_iter().flat_map(both).collect(), &far, second, total)?;
        self.progress.report(MINIMAX_STAGE, total, total);
        least(runs.into_iter().map(|run| run.best))
    }

    /// Runs up to `alternations` more alternations of each start.
    fn minimax_round(
        &self,
        runs: Vec<MinimaxRun>,
        far: &[Vec<usize>],
        alternations: u64,
        total: u64,
    ) -> Result<Vec<MinimaxRun>, PaletteError> {
        let advanced = |mut run: MinimaxRun| {
            for _ in 0..alternations {
                if self.progress.cancelled() {
                    return Err(PaletteError::Cancelled);
                }
                if run.best.worst <= FAR || run.idle >= MINIMAX_IDLE {
                    break;
                }
                self.reduce_largest(&mut run, far);
                self.progress.report(MINIMAX_STAGE, self.done.fetch_add(1, Ordering::Relaxed) + 1, total);
            }
            Ok(run)
        };
        runs.into_par_iter().map(advanced).collect()
    }

    /// Indices of the cells of each part of the palette that has open lights and a cell far from its target. Open spectra
    /// couple the cells of a part.
    fn far_parts(&self, spectra: &Spectra) -> Vec<Vec<usize>> {
        let rows = self.palette.materials.len();
        let open = |cell: &Cell| -> Vec<usize> {
            let of_place = |place: Place| {
                let row = is_open(&self.palette.materials, place.material).then_some(place.material);
                [row, is_open(&self.palette.lights, place.light).then_some(rows + place.light)]
            };
            Place::both(cell).flat_map(of_place).flatten().collect()
        };
        let parts = connected(rows + self.palette.lights.len(), self.palette.cells.iter().map(open)).into_iter();
        let with_lights = parts
            .filter(|part| part.iter().any(|&member| member >= rows && is_open(&self.palette.lights, member - rows)));
        let of_cells = with_lights.map(|part| {
            let cells = self.palette.cells.iter().enumerate();
            cells
                .filter(|(_, cell)| open(cell).iter().any(|member| part.contains(member)))
                .map(|(cell, _)| cell)
                .collect()
        });
        let is_far = |part: &Vec<usize>| part.iter().any(|&cell| error(&self.palette.cells[cell], spectra).0 > FAR);
        of_cells.filter(is_far).collect()
    }

    /// Multiplies the weight of each cell of the `far` parts by the square root of its error, then runs one more alternation.
    fn reduce_largest(&self, run: &mut MinimaxRun, far: &[Vec<usize>]) {
        for part in far {
            let next = |&cell: &usize| {
                run.weights[cell].unwrap_or(1.0) * error(&self.palette.cells[cell], &run.spectra).0.sqrt()
            };
            let next: Vec<f64> = part.iter().map(next).collect();
            let mean = next.iter().sum::<f64>() / count(part.len());
            for (&cell, next) in part.iter().zip(next) {
                run.weights[cell] = Some(f64::max(next / mean, LEAST_WEIGHT));
            }
        }
        let found = self.alternated(&run.spectra, &|spectra| self.minimax_metrics(spectra, run));
        run.spectra = found.spectra.clone();
        if found.worst < (1.0 - MINIMAX_GAIN) * run.best.worst {
            (run.best, run.idle) = (found, 0);
        } else {
            run.idle += 1;
        }
    }

    /// Metrics of the cells: for those with weights, the square is that of ΔE00 at `spectra`, and so is its slope if the run
    /// `has_slopes`.
    fn minimax_metrics(&self, spectra: &Spectra, run: &MinimaxRun) -> Vec<Metric> {
        let at_colours = |cell: &Cell, weight: f64| {
            let (error, [seen, wanted]) = error(cell, spectra);
            let form = difference_matrix(Xyz(((seen + wanted) / 2.0).to_array()));
            let measured = (form * (seen - wanted)).length();
            let form = form * if measured > 0.0 { error / measured } else { cell.weight };
            let offset = if run.has_slopes {
                let slope = DVec3::from_array([DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
                    let at = |step: f64| difference(Xyz((seen + step * axis).to_array()), Xyz(wanted.to_array()));
                    cell.weight * (at(STEP) - at(-STEP)) / (2.0 * STEP)
                }));
                error * (form.transpose().inverse() * slope) - form * (seen - wanted)
            } else {
                DVec3::ZERO
            };
            // Where the observer is almost blind, the matrix has no inverse.
            let offset = if offset.is_finite() { offset.clamp_length_max(error) } else { DVec3::ZERO };
            Metric { form: form * weight.sqrt(), offset: offset * weight.sqrt() }
        };
        let cells = self.palette.cells.iter().zip(&run.weights);
        cells
            .map(|(cell, weight)| weight.map_or_else(|| metric(cell, spectra), |weight| at_colours(cell, weight)))
            .collect()
    }

    /// Returns the best of `found`, of `known` and of a search from there.
    fn improved(&self, found: Found, known: Start) -> Result<Found, PaletteError> {
        if found.worst <= EXACT {
            return Ok(found);
        }
        let searched = self.searched(vec![known.clone()], &FURTHER)?;
        let known = match known {
            Start::Solved(known) => Some(known),
            Start::Rough(_) => None,
        };
        self.minimax([found, searched].into_iter().chain(known).collect(), Vec::new())
    }

    /// Returns the relaxation of a palette for which the `first` starts may not suffice.
    fn unproven(&self, first: &Found) -> Result<Option<bound::Relaxation>, PaletteError> {
        // The relaxation knows no model, and with one every start is followed to its end.
        if first.worst <= INVISIBLE || self.lights.is_empty() || self.model.is_some() {
            return Ok(None);
        }
        let relaxed = bound::relaxed(self.palette, &first.spectra, self.progress)?;
        Ok((relaxed.squares < PROVEN * first.squares).then_some(relaxed))
    }

    /// Returns the spectra with the smallest maximum ΔE00 within these bounds of reflectances and of lights; `None` if
    /// all bounds of the palette lie there.
    fn narrow(&self, reflectances: [f64; 2], lights: [f64; 2]) -> Result<Option<Found>, PaletteError> {
        let model = self.model.as_ref().map(|&(_, (model, _))| model);
        let narrowed = narrowed(self.palette, reflectances, lights);
        narrowed.map(|palette| Search::new(&palette, model, self.progress).best()).transpose()
    }

    /// Returns the start with the spectra of `start` that this palette leaves open. It is solved if it has them all, within
    /// the bounds and with no less smoothness.
    fn known(&self, start: &Palette) -> Result<Start, PaletteError> {
        let mut spectra = starts(self.palette).swap_remove(0);
        let (mut has_any, mut fits) = (false, true);
        for side in [Side::Materials, Side::Lights] {
            let own = match side {
                Side::Materials => &mut spectra.materials,
                Side::Lights => &mut spectra.lights,
            };
            let members = side.members(self.palette).iter().zip(own);
            for (member, own) in members.filter(|(member, _)| member.spectrum.is_none()) {
                let named = side.members(start).iter().find(|other| other.name == member.name);
                // A rougher spectrum may be nearer to the targets than this palette allows.
                let is_as_smooth = named.is_some_and(|other| other.smoothness >= member.smoothness);
                let known = named.and_then(|other| other.spectrum.clone());
                fits &= is_as_smooth && known.as_ref().is_some_and(|known| member.allows(known, side.kind()));
                has_any |= known.is_some();
                *own = known.unwrap_or_else(|| own.clone());
            }
        }
        if !has_any {
            let missing = self.palette.without_start(start).join(", ");
            let message = format!("{} has no spectrum for {missing}, which are open here", start.source);
            return Err(PaletteError::Unsolvable { palette: self.palette.source.clone(), message });
        }
        Ok(if fits { Start::Solved(self.judged(spectra)) } else { Start::Rough(spectra) })
    }

    /// Returns the result with the smallest maximum ΔE00 of `starts`.
    fn searched(&self, starts: Vec<Start>, effort: &Effort) -> Result<Found, PaletteError> {
        self.settled.store(usize::MAX, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
        let run = |(index, start)| {
            let (next, best) = match start {
                Start::Rough(spectra) => (spectra.clone(), Found::nothing(spectra)),
                Start::Solved(found) => (found.spectra.clone(), found),
            };
            Run { index, before: best.spectra.clone(), best, next, stride: 0.0, setbacks: 0, ended: false }
        };
        let mut runs: Vec<Run> = starts.into_iter().enumerate().map(run).collect();
        // With a model, the early order of the starts says little about their final order.
        let left = |most: usize| if self.model.is_some() { most.max(runs.len()) } else { most };
        let mut going = runs.len();
        let mut total = 0;
        for &(alternations, most) in effort.rounds {
            total += alternations * u64::try_from(going).unwrap_or(1);
            going = going.min(left(most));
        }
        let rounds: Vec<(u64, usize)> =
            effort.rounds.iter().map(|&(alternations, most)| (alternations, left(most))).collect();
        for (alternations, most) in rounds {
            let going = runs.into_par_iter().map(|run| self.advanced(run, alternations, total, effort));
            runs = going.collect::<Result<_, _>>()?;
            // The state of a later start depends on when it was stopped, and thus on the threads.
            let settled = self.settled.load(Ordering::Relaxed);
            runs.retain(|run| run.index <= settled);
            if runs.iter().any(|run| run.best.worst <= GOOD) {
                runs.retain(|run| run.best.worst <= GOOD);
            }
            runs.sort_by(|one, two| one.best.squares.total_cmp(&two.best.squares));
            runs.truncate(most);
        }
        self.progress.report(effort.stage, total, total);
        least(runs.into_iter().map(|run| run.best))
    }

    /// Runs up to `alternations` more alternations.
    fn advanced(&self, mut run: Run, alternations: u64, total: u64, effort: &Effort) -> Result<Run, PaletteError> {
        for _ in 0..alternations {
            if self.progress.cancelled() {
                return Err(PaletteError::Cancelled);
            }
            if run.ended || self.settled.load(Ordering::Relaxed) < run.index {
                break;
            }
            let found = self.alternated(&run.next, &|spectra| self.metrics(spectra));
            self.progress.report(effort.stage, self.done.fetch_add(1, Ordering::Relaxed) + 1, total);
            // Without open lights nothing alternates: the reflectances only settle.
            let settles = self.lights.is_empty();
            let is_first = run.best.squares.is_infinite();
            let gain = run.best.squares - found.squares;
            if settles || gain > 0.0 {
                run.ended = found.worst <= EXACT || !is_first && gain.abs() <= effort.least_gain * run.best.squares;
                run.stride = if is_first || settles { 0.0 } else { f64::max(STRIDE, LENGTHENED * run.stride) };
                run.next = self.beyond(&run.best.spectra, &found.spectra, run.stride);
                run.before = run.best.spectra;
                run.best = found;
            } else if effort.shortens && run.stride > 1.0 {
                run.stride *= SHORTENED;
                run.next = self.beyond(&run.before, &run.best.spectra, run.stride);
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

    /// Metrics of the cells at their targets.
    fn metrics(&self, spectra: &Spectra) -> Vec<Metric> {
        self.palette.cells.iter().map(|cell| metric(cell, spectra)).collect()
    }

    /// Solves the reflectances for the lights of `from`, then the lights for those reflectances, each with the `metrics` of
    /// the cells at the spectra so far.
    fn alternated(&self, from: &Spectra, metrics: &dyn Fn(&Spectra) -> Vec<Metric>) -> Found {
        let mut spectra = from.clone();
        for (side, groups) in [(Side::Materials, &self.materials), (Side::Lights, &self.lights)] {
            if !groups.is_empty() {
                let shown = self.shown(&spectra);
                spectra = solved(self.palette, side, groups, &spectra, &metrics(&spectra), shown.as_ref());
            }
        }
        self.judged(spectra)
    }

    /// Returns `spectra` with their errors.
    fn judged(&self, spectra: Spectra) -> Found {
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

    /// Returns the objective, and the largest weighted ΔE00, over the cells with an open spectrum. Other cells are fixed:
    /// a target missed there must not hide the others.
    fn differences(&self, spectra: &Spectra, shown: Option<&Shown>) -> (f64, f64) {
        let colour = |place: Place| Xyz(spectra.xyz(place).to_array());
        let (mut squares, mut worst) = (0.0, 0.0);
        let is_open = |place: Place| {
            is_open(&self.palette.materials, place.material) || is_open(&self.palette.lights, place.light)
        };
        for cell in self.palette.cells.iter().filter(|cell| Place::both(cell).any(is_open)) {
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

/// Metric of a cell at its target.
fn metric(cell: &Cell, spectra: &Spectra) -> Metric {
    Metric { form: form(cell, |place| spectra.xyz(place)), offset: DVec3::ZERO }
}

/// Weighted ΔE00 of a cell, its colour and the wanted one.
fn error(cell: &Cell, spectra: &Spectra) -> (f64, [DVec3; 2]) {
    let seen = spectra.xyz(Place::of(cell));
    let wanted = cell.wanted(|place| Xyz(spectra.xyz(place).to_array()));
    (cell.weight * difference(Xyz(seen.to_array()), wanted), [seen, wanted.0.into()])
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
