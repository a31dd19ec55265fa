//! Spectra designed together: materials that merge, vanish and keep their colour as one light follows another.
//!
//! A palette is a matrix of colours: rows are materials, columns are lights, and a cell says which colour the material
//! is to have under the light. Spectra are given or open; [`solve()`] finds the open ones.

mod bound;
mod contrast;
mod drawing;
mod error;
mod file;
mod program;
mod solution;
mod solve;
mod start;
mod step;

use std::ops::RangeInclusive;
use std::path::PathBuf;

pub use bound::{Conflict, WayOut};
pub use contrast::Contrast;
pub use error::PaletteError;
pub(crate) use file::{Misplaced, PaletteFile};
pub use file::{load, of_scene, parse};
pub use solution::{CellColour, Facts, Merge, Solution};
pub use solve::solve;

use crate::number::readable;
use crate::spectrum::colour::{Lab, LinearSrgb, Xyz, d65_white, decode_srgb, xyz_from_lab, xyz_from_linear_srgb};
use crate::spectrum::{Kind, Spectrum};

/// The most rows, and the most columns, of a palette that is solved.
pub const LARGEST: usize = 32;
/// What an open reflectance may be where nothing else is said.
pub const NATURAL: [f64; 2] = [0.0, 1.0];
/// What an open light may be where nothing else is said, in multiples of its mean.
pub const LAMP: [f64; 2] = [0.0, 10.0];
/// How much the bends of an open spectrum count where nothing else is said.
pub const SMOOTHNESS: f64 = 1e-4;
/// What bounds may be, of a light in multiples of its mean; a spectrum of 81 samples peaks at 81 times its mean.
const BOUNDS: RangeInclusive<f64> = -1e3..=1e3;
/// What a smoothness may be.
pub(crate) const SMOOTHNESSES: RangeInclusive<f64> = 1e-12..=1e6;
/// What the weight of a cell or of a model may be; squares of what lies farther apart drown one another.
const WEIGHTS: RangeInclusive<f64> = 1e-6..=1e6;

/// Colours that materials are to have under lights, and what is known of the spectra.
#[derive(Clone, Debug, PartialEq)]
pub struct Palette {
    /// Where it was read from; heads messages.
    pub source: String,
    /// The files that its given spectra were read from.
    pub inputs: Vec<PathBuf>,
    /// The rows.
    pub materials: Vec<Member>,
    /// The columns.
    pub lights: Vec<Member>,
    /// The cells that are not free, at most one per material and light.
    pub cells: Vec<Cell>,
    /// The colour model that is to show the palette's colours, where that is settled beforehand.
    pub model: Option<ModelTerm>,
}

/// A row or a column: a reflectance or a light.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Its name.
    pub name: String,
    /// Its spectrum; of a light normalised to luminance 1. `None`: open.
    pub spectrum: Option<Spectrum>,
    /// What the samples of an open one may be, lowest and highest; of a light in multiples of its mean.
    pub bounds: [f64; 2],
    /// What the squares of an open one's second differences are multiplied by, where squares of ΔE00 are made small. A
    /// light's samples count in multiples of those of an equal-energy light.
    pub smoothness: f64,
}

impl Member {
    /// What is wrong with the bounds, where something is.
    fn bounds_problem(&self, kind: Kind) -> Option<String> {
        let [low, high] = self.bounds;
        let in_order = BOUNDS.contains(&low) && BOUNDS.contains(&high) && low < high;
        let allowed = match kind {
            Kind::Light if in_order && low < 1.0 && high > 1.0 => return None,
            Kind::Light => "in multiples of its mean, one from -1000 to below 1 and one from above 1 to 1000",
            _ if in_order => return None,
            _ => "two numbers from -1000 to 1000, the lower one first",
        };
        Some(format!("{} to {}; they are {allowed}", readable(low), readable(high)))
    }

    /// What is wrong with the smoothness, where something is.
    fn smoothness_problem(&self) -> Option<String> {
        (!SMOOTHNESSES.contains(&self.smoothness))
            .then(|| format!("{}; it is {}", readable(self.smoothness), range(&SMOOTHNESSES)))
    }
}

/// "a number from 1e-6 to 1000000"
fn range(allowed: &RangeInclusive<f64>) -> String {
    format!("a number from {} to {}", readable(*allowed.start()), readable(*allowed.end()))
}

/// What one material is to look like under one light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Index of the row.
    pub material: usize,
    /// Index of the column.
    pub light: usize,
    /// The colour.
    pub target: Target,
    /// What its ΔE00 is multiplied by, above 0.
    pub weight: f64,
}

/// The colour of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// A colour of the display: `#rrggbb`.
    Srgb([u8; 3]),
    /// Tristimulus values; Y of the perfect reflector is 1.
    Xyz(Xyz),
    /// CIE L*a*b* relative to D65.
    Lab(Lab),
    /// No light at all.
    Black,
    /// Whatever another cell looks like.
    Like {
        /// Index of that cell's row.
        material: usize,
        /// Index of that cell's column.
        light: usize,
    },
}

impl Target {
    /// The colour itself; none for [`Target::Like`].
    #[must_use]
    pub fn xyz(&self) -> Option<Xyz> {
        match *self {
            Self::Srgb(code) => {
                let linear = code.map(|part| decode_srgb(f64::from(part) / 255.0));
                Some(xyz_from_linear_srgb(LinearSrgb(linear)))
            }
            Self::Xyz(xyz) => Some(xyz),
            Self::Lab(lab) => Some(xyz_from_lab(lab, d65_white())),
            Self::Black => Some(Xyz([0.0; 3])),
            Self::Like { .. } => None,
        }
    }
}

impl Cell {
    /// The colour asked for, where `colour` tells what the other cells look like.
    fn wanted(&self, colour: impl Fn(Place) -> Xyz) -> Xyz {
        match self.target {
            Target::Like { material, light } => colour(Place { material, light }),
            target => target.xyz().unwrap_or(Xyz([0.0; 3])),
        }
    }
}

/// A colour model of nodes that is settled before the palette is solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelTerm {
    /// How many nodes it has, 1 to 31.
    pub dimension: usize,
    /// What ΔE00 between what it shows and the colours themselves is multiplied by.
    pub weight: f64,
}

impl Palette {
    /// The target of a cell in words: `#808080`, `as bone under day`, `free`.
    #[must_use]
    pub fn target_text(&self, material: usize, light: usize) -> String {
        let cell = self.cells.iter().find(|cell| (cell.material, cell.light) == (material, light));
        let numbers = |numbers: [f64; 3]| numbers.map(readable).join(" ");
        match cell.map(|cell| cell.target) {
            None => "free".to_owned(),
            Some(Target::Srgb([r, g, b])) => format!("#{r:02x}{g:02x}{b:02x}"),
            Some(Target::Xyz(xyz)) => format!("XYZ {}", numbers(xyz.0)),
            Some(Target::Lab(lab)) => format!("Lab {}", numbers(lab.0)),
            Some(Target::Black) => "black".to_owned(),
            Some(Target::Like { material: row, light: column }) => {
                let name = |members: &[Member], index: usize| {
                    members.get(index).map_or_else(String::new, |member| member.name.clone())
                };
                let (row_name, column_name) = (name(&self.materials, row), name(&self.lights, column));
                match (row == material, column == light) {
                    (false, true) => format!("as {row_name}"),
                    (true, false) => format!("as under {column_name}"),
                    _ => format!("as {row_name} under {column_name}"),
                }
            }
        }
    }

    /// Refuses what cannot be solved at all; what can be solved badly is told by [`Solution`].
    pub(crate) fn check(&self) -> Result<(), PaletteError> {
        let wrong = |message: String| Err(PaletteError::Unsolvable { palette: self.source.clone(), message });
        let sides = [
            (&self.materials, "materials", "[materials.NAME]", Kind::Reflectance),
            (&self.lights, "lights", "[lights.NAME]", Kind::Light),
        ];
        for (members, what, table, kind) in sides {
            if members.is_empty() {
                return wrong(format!("it has no {what}; write at least one {table}"));
            }
            if members.len() > LARGEST {
                return wrong(format!(
                    "it has {} {what}, and {LARGEST} can be designed together; split it",
                    members.len()
                ));
            }
            for member in members {
                if let Some(problem) = member.bounds_problem(kind) {
                    return wrong(format!("the bounds of {} are {problem}", member.name));
                }
                if let Some(problem) = member.smoothness_problem() {
                    return wrong(format!("the smoothness of {} is {problem}", member.name));
                }
                if member.spectrum.as_ref().is_some_and(|spectrum| !spectrum.is_finite()) {
                    return wrong(format!("the spectrum of {} is not finite", member.name));
                }
            }
        }
        for (index, cell) in self.cells.iter().enumerate() {
            let at = Place { material: cell.material, light: cell.light };
            let other = match cell.target {
                Target::Like { material, light } => Place { material, light },
                _ => at,
            };
            if [at, other]
                .iter()
                .any(|place| place.material >= self.materials.len() || place.light >= self.lights.len())
            {
                return wrong(format!("the cell {index} is of a material or a light that is not there"));
            }
            let name = self.name(at);
            if self.cells[..index].iter().any(|earlier| Place::of(earlier) == at) {
                return wrong(format!("the cell {name} is said twice"));
            }
            if other == at && matches!(cell.target, Target::Like { .. }) {
                return wrong(format!("the cell {name} is to look as itself; leave it out to let it be free"));
            }
            if !WEIGHTS.contains(&cell.weight) {
                return wrong(format!(
                    "the weight of the cell {name} is {}; it is {}",
                    readable(cell.weight),
                    range(&WEIGHTS)
                ));
            }
            // Far beyond any light; squares of what is larger lose what else is asked for.
            const LARGEST_PART: f64 = 1e3;
            if cell.target.xyz().is_some_and(|xyz| !xyz.0.iter().all(|part| part.abs() <= LARGEST_PART)) {
                return wrong(format!(
                    "the colour of the cell {name} is not finite, or above {LARGEST_PART} times white"
                ));
            }
        }
        if let Some(term) = &self.model
            && !WEIGHTS.contains(&term.weight)
        {
            return wrong(format!("the model's weight is {}; it is {}", readable(term.weight), range(&WEIGHTS)));
        }
        Ok(())
    }

    /// "flesh under day"
    fn name(&self, place: Place) -> String {
        match (self.materials.get(place.material), self.lights.get(place.light)) {
            (Some(material), Some(light)) => format!("{} under {}", material.name, light.name),
            _ => String::new(),
        }
    }

    fn cell(&self, place: Place) -> Option<&Cell> {
        self.cells.iter().find(|cell| Place::of(cell) == place)
    }
}

/// A row and a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    material: usize,
    light: usize,
}

impl Place {
    const fn of(cell: &Cell) -> Self {
        Self { material: cell.material, light: cell.light }
    }

    /// The places whose colours the cell speaks of.
    fn both(cell: &Cell) -> impl Iterator<Item = Self> {
        let other = match cell.target {
            Target::Like { material, light } => Some(Self { material, light }),
            _ => None,
        };
        std::iter::once(Self::of(cell)).chain(other)
    }
}
