//! Infeasibility proofs for palettes: convex relaxations with a lower bound on the colour difference.
//!
//! Under given lights the colours are linear in the reflectances, and the convex problem is exact. Under an open light
//! the reflected spectrum is a product of two unknowns. The relaxation replaces it by an unknown of its own within
//! McCormick's inequalities (McCormick 1976). A target that the relaxation cannot reach is out of reach of every
//! spectrum.

use std::fmt;

use glam::DVec3;

use super::program::Program;
use super::step::{Seen, Spectra, alike, connected, equal_energy, form, light, of_unit_luminance, reflectance};
use super::{Cell, LAMP, Member, Palette, PaletteError, Place, Target};
use crate::spectrum::colour::{OBSERVER, Xyz};
use crate::spectrum::{BANDS, Spectrum};
use relume_base::number::readable;
use relume_base::progress::Progress;

/// Largest bound, as ΔE00, that counts as zero: the accuracy of the solver.
const REACHABLE: f64 = 0.02;
const STAGE: &str = "searching for conflicts";

/// Cells that no spectra within their bounds can satisfy together.
#[derive(Clone, Debug, PartialEq)]
pub struct Conflict {
    /// Row and column of the conflicting cells. The set is minimal: without any one of them, the others are possible.
    pub cells: Vec<(usize, usize)>,
    /// Row and column of all cells coupled to them.
    pub part: Vec<(usize, usize)>,
    /// Lower bound of the root mean square ΔE00 over the part, linearised at the targets and weighted by the cells'
    /// weights.
    pub least: f64,
    /// The same root mean square in the solved palette.
    pub reached: f64,
    /// Reason, as a sentence.
    pub reason: String,
    /// Single changes that may make the cells possible: the same relaxation does not exclude the result. The part's
    /// other conflicts are left aside.
    pub ways_out: Vec<WayOut>,
}

/// Single change that may resolve a conflict. Displays as a clause: "leave a under b free".
#[derive(Clone, Debug, PartialEq)]
pub enum WayOut {
    /// Frees a cell.
    Free {
        /// Name of the row.
        material: String,
        /// Name of the column.
        light: String,
    },
    /// Allows an artificial spectrum for a material.
    Bounds {
        /// Name of the material.
        material: String,
        /// New bounds of its samples.
        bounds: [f64; 2],
    },
    /// Opens the spectrum of a light.
    Open {
        /// Name of the light.
        light: String,
    },
}

impl fmt::Display for WayOut {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Free { material, light } => write!(formatter, "leave {material} under {light} free"),
            Self::Bounds { material, bounds } => {
                write!(formatter, "give {material} the bounds {bounds:?} (an artificial spectrum)")
            }
            Self::Open { light } => write!(formatter, "leave the light {light} open"),
        }
    }
}

/// Returns all conflicts that the relaxation proves.
pub(super) fn conflicts(
    palette: &Palette,
    spectra: &Spectra,
    progress: &dyn Progress,
) -> Result<Vec<Conflict>, PaletteError> {
    let relaxed = Relaxed { spectra, progress };
    let mut conflicts = Vec::new();
    let parts = parts(palette);
    let total = u64::try_from(parts.len()).unwrap_or(u64::MAX);
    for (part, done) in parts.iter().zip(0..) {
        progress.report(STAGE, done, total);
        if !relaxed.is_possible(palette, part)? {
            conflicts.extend(relaxed.conflicts(palette, part)?);
        }
    }
    Ok(conflicts)
}

/// Solution of the relaxation of some cells.
pub(super) struct Relaxation {
    /// Lower bound of the sum of the squared ΔE00, linearised at the targets and weighted.
    pub(super) squares: f64,
    /// Sum of the squared weights of the cells.
    weights: f64,
    /// Relaxed light of each open column, of luminance 1.
    pub(super) lights: Vec<Option<Spectrum>>,
}

/// Relaxes the whole palette; `spectra` fix the metric of relations.
pub(super) fn relaxed(
    palette: &Palette,
    spectra: &Spectra,
    progress: &dyn Progress,
) -> Result<Relaxation, PaletteError> {
    let relaxed = Relaxed { spectra, progress };
    let mut whole = Relaxation { squares: 0.0, weights: 0.0, lights: vec![None; palette.lights.len()] };
    for part in parts(palette) {
        let part = relaxed.part(palette, &part)?;
        whole.squares += part.squares;
        whole.weights += part.weights;
        for (light, found) in whole.lights.iter_mut().zip(part.lights) {
            *light = found.or_else(|| light.take());
        }
    }
    Ok(whole)
}

/// Groups the cells by the unknown spectra that couple them. Leaves out cells whose spectra are all given: their ΔE00
/// is fixed.
fn parts(palette: &Palette) -> Vec<Vec<Cell>> {
    let rows = palette.materials.len();
    let touched = |cell: &Cell| -> Vec<usize> {
        Place::both(cell)
            .flat_map(|place| {
                let column = is_open(&palette.lights, place.light).then_some(rows + place.light);
                let row = is_open(&palette.materials, place.material)
                    && under_given_light(palette, &palette.cells, place.material);
                [row.then_some(place.material), column]
            })
            .flatten()
            .collect()
    };
    let of_node = connected(rows + palette.lights.len(), palette.cells.iter().map(touched));
    let mut parts: Vec<Vec<Cell>> = Vec::new();
    for nodes in of_node {
        let cells = palette.cells.iter().filter(|cell| touched(cell).iter().any(|node| nodes.contains(node)));
        parts.push(cells.copied().collect());
    }
    parts.retain(|part| !part.is_empty());
    parts
}

pub(super) fn is_open(members: &[Member], index: usize) -> bool {
    members.get(index).is_some_and(|member| member.spectrum.is_none())
}

/// Whether one of `cells` uses the row under a given light.
fn under_given_light(palette: &Palette, cells: &[Cell], row: usize) -> bool {
    let mut places = cells.iter().flat_map(Place::both);
    places.any(|place| place.material == row && !is_open(&palette.lights, place.light))
}

struct Relaxed<'a> {
    /// The solved spectra, at which the metric of relations is evaluated.
    spectra: &'a Spectra,
    progress: &'a dyn Progress,
}

impl Relaxed<'_> {
    /// Returns a lower bound of the root mean square ΔE00 of `cells`.
    fn least(&self, palette: &Palette, cells: &[Cell]) -> Result<f64, PaletteError> {
        let Relaxation { squares, weights, .. } = self.part(palette, cells)?;
        Ok(if weights > 0.0 { (squares / weights).sqrt() } else { 0.0 })
    }

    /// Solves the relaxation of `cells`.
    fn part(&self, palette: &Palette, cells: &[Cell]) -> Result<Relaxation, PaletteError> {
        if self.progress.cancelled() {
            return Err(PaletteError::Cancelled);
        }
        let mut program = Program::default();
        let rows: Vec<Option<usize>> = (0..palette.materials.len())
            .map(|row| {
                let used = is_open(&palette.materials, row) && under_given_light(palette, cells, row);
                used.then(|| reflectance(&mut program, palette.materials[row].bounds))
            })
            .collect();
        let places = || cells.iter().flat_map(Place::both);
        let columns: Vec<Option<usize>> = (0..palette.lights.len())
            .map(|column| {
                let used = is_open(&palette.lights, column) && places().any(|place| place.light == column);
                used.then(|| light(&mut program, palette.lights[column].bounds))
            })
            .collect();
        let mut seen: Vec<(Place, Seen)> = Vec::new();
        for place in places() {
            if seen.iter().any(|(known, _)| *known == place) {
                continue;
            }
            let (row, column) = (&palette.materials[place.material], &palette.lights[place.light]);
            let colour = match (&row.spectrum, rows[place.material], &column.spectrum, columns[place.light]) {
                (Some(_), _, Some(_), _) => Seen::Fixed(self.spectra.xyz(place)),
                (None, Some(first), Some(light), _) => Seen::through(first, light),
                (Some(reflectance), _, None, Some(first)) => {
                    Seen::through(first, &reflectance.scaled(1.0 / equal_energy()))
                }
                (None, reflectance, None, Some(light)) => {
                    let even = Spectrum::constant(1.0 / equal_energy());
                    Seen::through(product(&mut program, row.bounds, reflectance, column.bounds, light), &even)
                }
                _ => continue,
            };
            seen.push((place, colour));
        }
        let find = |place: Place| seen.iter().find(|(known, _)| *known == place).map(|(_, colour)| colour);
        let (mut fixed, mut weights) = (0.0, 0.0);
        for cell in cells {
            let Some(one) = find(Place::of(cell)) else { continue };
            let two = match cell.target {
                Target::Like { material, light } => find(Place { material, light }).cloned(),
                target => target.xyz().map(|xyz| Seen::Fixed(xyz.0.into())),
            };
            let Some(two) = two else { continue };
            let form = form(cell, |place| self.spectra.xyz(place));
            weights += cell.weight.powi(2);
            match (one, &two) {
                (Seen::Fixed(one), Seen::Fixed(two)) => fixed += (form * (*one - *two)).length_squared(),
                _ => alike(&mut program, form, one, &two),
            }
        }
        let answer = program.solve();
        let light = |(member, first): (&Member, Option<usize>)| {
            let unknowns = answer.as_ref()?.unknowns.get(first?..)?.first_chunk()?;
            of_unit_luminance(*unknowns, member.bounds[0])
        };
        Ok(Relaxation {
            squares: fixed + answer.as_ref().map_or(0.0, |answer| answer.least),
            weights,
            lights: palette.lights.iter().zip(columns).map(light).collect(),
        })
    }

    fn is_possible(&self, palette: &Palette, cells: &[Cell]) -> Result<bool, PaletteError> {
        Ok(self.least(palette, cells)? <= REACHABLE)
    }

    /// Returns one conflict per minimal infeasible set of the part.
    fn conflicts(&self, palette: &Palette, part: &[Cell]) -> Result<Vec<Conflict>, PaletteError> {
        let cores = self.cores(palette, part)?;
        let least = self.least(palette, part)?;
        let reached = self.reached(part);
        let places = |cells: &[Cell]| cells.iter().map(|cell| (cell.material, cell.light)).collect();
        let told = |core: &Vec<Cell>| {
            let elsewhere = |cell: &Cell| cores.iter().any(|other| other.contains(cell)) && !core.contains(cell);
            let around: Vec<Cell> = part.iter().filter(|cell| !elsewhere(cell)).copied().collect();
            Ok(Conflict {
                cells: places(core),
                part: places(part),
                least,
                reached,
                reason: reason(palette, core),
                ways_out: self.ways_out(palette, &around, core)?,
            })
        };
        cores.iter().map(told).collect()
    }

    /// Returns disjoint minimal infeasible sets of the part. Searches each material alone first, with the cells that
    /// its targets refer to, because those conflicts are the easiest to explain; then searches the remaining cells.
    fn cores(&self, palette: &Palette, part: &[Cell]) -> Result<Vec<Vec<Cell>>, PaletteError> {
        let mut cores: Vec<Vec<Cell>> = Vec::new();
        for row in 0..palette.materials.len() {
            let mut own: Vec<Cell> = part.iter().filter(|cell| cell.material == row).copied().collect();
            while !own.is_empty() {
                let is_model = |cell: &&Cell| {
                    cell.material != row && own.iter().any(|one| Place::both(one).any(|place| place == Place::of(cell)))
                };
                let among: Vec<Cell> = own.iter().chain(part.iter().filter(is_model)).copied().collect();
                if self.is_possible(palette, &among)? {
                    break;
                }
                let core = self.core(palette, &among)?;
                let before = own.len();
                own.retain(|cell| !core.contains(cell));
                if own.len() == before {
                    // The core holds only cells of another material.
                    break;
                }
                cores.push(core);
            }
        }
        let mut rest = part.to_vec();
        loop {
            rest.retain(|cell| !cores.iter().any(|core| core.contains(cell)));
            if rest.is_empty() || self.is_possible(palette, &rest)? {
                return Ok(cores);
            }
            cores.push(self.core(palette, &rest)?);
        }
    }

    /// Returns a minimal infeasible subset of the part.
    fn core(&self, palette: &Palette, part: &[Cell]) -> Result<Vec<Cell>, PaletteError> {
        let mut core = part.to_vec();
        let mut size = core.len().div_ceil(2);
        loop {
            let mut at = 0;
            while at < core.len() && core.len() > 1 {
                let kept: Vec<Cell> = core
                    .iter()
                    .enumerate()
                    .filter(|(index, _)| !(at..at + size).contains(index))
                    .map(|(_, cell)| *cell)
                    .collect();
                if !kept.is_empty() && !self.is_possible(palette, &kept)? {
                    core = kept;
                } else {
                    at += size;
                }
            }
            if size <= 1 {
                return Ok(core);
            }
            size = size.div_ceil(2);
        }
    }

    /// Returns the root mean square ΔE00 of the part in the solved palette.
    fn reached(&self, part: &[Cell]) -> f64 {
        let (mut squares, mut weights) = (0.0, 0.0);
        for cell in part {
            let wanted = cell.wanted(|place| Xyz(self.spectra.xyz(place).to_array()));
            let form = form(cell, |place| self.spectra.xyz(place));
            squares += (form * (self.spectra.xyz(Place::of(cell)) - DVec3::from(wanted.0))).length_squared();
            weights += cell.weight.powi(2);
        }
        f64::sqrt(squares / weights)
    }

    /// Returns single changes after which the relaxation no longer excludes `part`.
    fn ways_out(&self, palette: &Palette, part: &[Cell], core: &[Cell]) -> Result<Vec<WayOut>, PaletteError> {
        let mut ways = Vec::new();
        for freed in core {
            let others: Vec<Cell> = part.iter().filter(|cell| Place::of(cell) != Place::of(freed)).copied().collect();
            if self.is_possible(palette, &others)? {
                let Place { material, light } = Place::of(freed);
                ways.push(WayOut::Free {
                    material: palette.materials[material].name.clone(),
                    light: palette.lights[light].name.clone(),
                });
            }
        }
        let mut rows: Vec<usize> = core.iter().flat_map(Place::both).map(|place| place.material).collect();
        rows.sort_unstable();
        rows.dedup();
        for row in rows.into_iter().filter(|&row| is_open(&palette.materials, row)) {
            for wider in [[-1.0, 1.0], [-4.0_f64, 4.0_f64]] {
                let [low, high] = palette.materials[row].bounds;
                let mut changed = palette.clone();
                let is_wider = wider[0] < low || wider[1] > high;
                let bounds = [wider[0].min(low), wider[1].max(high)];
                changed.materials[row].bounds = bounds;
                if is_wider && self.is_possible(&changed, part)? {
                    ways.push(WayOut::Bounds { material: palette.materials[row].name.clone(), bounds });
                    break;
                }
            }
        }
        let mut columns: Vec<usize> = core.iter().flat_map(Place::both).map(|place| place.light).collect();
        columns.sort_unstable();
        columns.dedup();
        for column in columns.into_iter().filter(|&column| !is_open(&palette.lights, column)) {
            let mut changed = palette.clone();
            changed.lights[column].spectrum = None;
            changed.lights[column].bounds = LAMP;
            if self.is_possible(&changed, part)? {
                ways.push(WayOut::Open { light: palette.lights[column].name.clone() });
            }
        }
        Ok(ways)
    }
}

/// Adds the product of an open reflectance and an open light as relaxed unknowns. Returns the index of the first.
fn product(
    program: &mut Program,
    [low, high]: [f64; 2],
    reflectance: Option<usize>,
    light_bounds: [f64; 2],
    light: usize,
) -> usize {
    let first = program.unknowns(BANDS);
    if light_bounds[0] < 0.0 {
        // The inequalities need a light without negative power.
        return first;
    }
    for band in 0..BANDS {
        let (sent, power) = (first + band, light + band);
        program.at_most(vec![(sent, -1.0), (power, low)], 0.0);
        program.at_most(vec![(sent, 1.0), (power, -high)], 0.0);
        // Largest power of a band: all of the luminance 1 in this band. Where the observer is almost blind, the limit
        // is too large to be useful.
        let most = equal_energy() / OBSERVER[1].samples()[band];
        if let Some(reflectance) = reflectance.filter(|_| most < 1e4) {
            let share = reflectance + band;
            program.at_most(vec![(sent, 1.0 / most), (share, -1.0), (power, -low / most)], -low);
            program.at_most(vec![(sent, -1.0 / most), (share, 1.0), (power, high / most)], high);
        }
    }
    first
}

/// Explains why the cells of a core conflict.
fn reason(palette: &Palette, core: &[Cell]) -> String {
    let cells: Vec<String> = core
        .iter()
        .map(|cell| format!("{} ({})", palette.name(Place::of(cell)), palette.target_text(cell.material, cell.light)))
        .collect();
    let listed = cells.join(", ");
    let one_of = |index: fn(Place) -> usize| {
        let mut indices = core.iter().flat_map(Place::both).map(index);
        let first = indices.next()?;
        indices.all(|index| index == first).then_some(first)
    };
    let (row, column) = (one_of(|place| place.material), one_of(|place| place.light));
    let bounds = |row: usize| {
        let [low, high] = palette.materials[row].bounds;
        format!("from {} to {}", readable(low), readable(high))
    };
    let open = |members: &[Member], index: Option<usize>| index.filter(|&index| is_open(members, index));
    let (open_row, open_column) = (open(&palette.materials, row), open(&palette.lights, column));
    let black = core.iter().find(|cell| {
        let power = palette.lights[cell.light].spectrum.as_ref();
        cell.target == Target::Black && power.is_some_and(|power| power.samples().iter().all(|&sample| sample > 0.0))
    });
    match (black, open_row, open_column, core) {
        (Some(black), Some(row), ..) if core.len() > 1 && palette.materials[row].bounds[0] >= 0.0 => format!(
            "{listed}: {} has power at every wavelength; a reflectance without negative samples is black under it only if it is 0 everywhere, and is then black under every light",
            palette.lights[black.light].name
        ),
        (_, Some(row), _, [only])
            if only.target.xyz().is_some_and(|xyz| xyz.0[1] > palette.materials[row].bounds[1].max(0.0)) =>
        {
            format!(
                "{listed}: a reflectance {1} cannot reach Y = {0}",
                readable(only.target.xyz().map_or(0.0, |xyz| (xyz.0[1] * 1e3).round() / 1e3)),
                bounds(row)
            )
        }
        (_, Some(row), _, [_]) => format!(
            "{listed}: no reflectance {} has this colour{}",
            bounds(row),
            if open_column.is_some() { " under any light within its bounds" } else { " under this light" }
        ),
        (_, Some(row), ..) => format!("{listed}: no single reflectance {} has all these colours", bounds(row)),
        (_, None, Some(column), _) => {
            let rounded = |number: f64| readable((number * 1e3).round() / 1e3);
            // Under a light of luminance 1, the Y of a reflectance is an average of its samples.
            let beyond = core.iter().find_map(|cell| {
                let samples = palette.materials.get(cell.material)?.spectrum.as_ref()?.samples();
                let [low, high] = [
                    samples.iter().copied().fold(f64::INFINITY, f64::min),
                    samples.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                ];
                let asked = cell.target.xyz()?.0[1];
                let name = &palette.materials[cell.material].name;
                (palette.lights[column].bounds[0] >= 0.0 && !(low..=high).contains(&asked)).then(|| {
                    format!(
                        "under any light of luminance 1, {name} has Y = {} to {}, not Y = {}",
                        rounded(low),
                        rounded(high),
                        rounded(asked)
                    )
                })
            });
            let shape = || {
                format!(
                    "no single light of luminance 1 with a peak of at most {} times its mean gives all these colours",
                    readable(palette.lights[column].bounds[1])
                )
            };
            format!("{listed}: {}", beyond.unwrap_or_else(shape))
        }
        _ => format!("{listed}: no spectra within their bounds have all these colours"),
    }
}
