//! Joint design of spectra: materials that match, vanish or keep their colour as the light changes.
//!
//! A palette is a matrix of colours with one row per material and one column per light. A cell states the target colour
//! of its material under its light. Spectra are given or open; [`solve()`] finds the open ones.

mod bound;
mod contrast;
mod drawing;
mod edge;
mod error;
mod file;
mod program;
mod smoother;
mod solution;
mod solve;
mod start;
mod step;

use std::ops::RangeInclusive;
use std::path::PathBuf;

pub use bound::{Conflict, WayOut};
pub use contrast::Contrast;
pub use edge::Edge;
pub use error::PaletteError;
pub use file::{Misplaced, PaletteFile};
pub use file::{load, of_scene, parse};
pub use smoother::{SmoothCost, Smoothing, smoother};
pub use solution::{CellColour, Facts, Merge, Solution};
pub use solve::{solve, solve_from};

use crate::spectrum::colour::{Lab, LinearSrgb, Xyz, d65_white, decode_srgb, xyz_from_lab, xyz_from_linear_srgb};
use crate::spectrum::{BANDS, Kind, Spectrum};
use relume_base::number::{count, readable};

/// Largest number of rows, and of columns, of a palette.
pub const LARGEST: usize = 32;
/// Default bounds of an open reflectance.
pub const NATURAL: [f64; 2] = [0.0, 1.0];
/// Default bounds of an open light, in multiples of its mean.
pub const LAMP: [f64; 2] = [0.0, 10.0];
/// Default smoothness of an open spectrum.
pub const SMOOTHNESS: f64 = 1e-4;
/// Range of bounds, for a light in multiples of its mean. The peak of a spectrum of 81 samples is at most 81 times its
/// mean.
const BOUNDS: RangeInclusive<f64> = -1e3..=1e3;
/// Range of smoothness.
pub const SMOOTHNESSES: RangeInclusive<f64> = 1e-12..=1e6;
/// Range of the weight of a cell or of a model. In a wider range, large squares would drown small ones.
const WEIGHTS: RangeInclusive<f64> = 1e-6..=1e6;

/// Target colours of materials under lights, with the given spectra.
#[derive(Clone, Debug, PartialEq)]
pub struct Palette {
    /// Source of the palette; starts messages.
    pub source: String,
    /// Files of the given spectra.
    pub inputs: Vec<PathBuf>,
    /// Rows.
    pub materials: Vec<Member>,
    /// Columns.
    pub lights: Vec<Member>,
    /// Cells that are not free, at most one per material and light.
    pub cells: Vec<Cell>,
    /// Colour model that displays the palette, if it is fixed before solving.
    pub model: Option<ModelTerm>,
}

/// Row or column of a palette: a reflectance or a light.
#[derive(Clone, Debug, PartialEq)]
pub struct Member {
    /// Name.
    pub name: String,
    /// Spectrum, for a light normalised to luminance 1; `None` is open.
    pub spectrum: Option<Spectrum>,
    /// Lowest and highest sample of an open spectrum, for a light in multiples of its mean.
    pub bounds: [f64; 2],
    /// Weight of the squared second differences of an open spectrum, relative to squared ΔE00. Samples of a light count
    /// in multiples of those of an equal-energy light.
    pub smoothness: f64,
}

impl Member {
    /// Returns an error message if the bounds are invalid.
    fn bounds_problem(&self, kind: Kind) -> Option<String> {
        let [low, high] = self.bounds;
        let in_order = BOUNDS.contains(&low) && BOUNDS.contains(&high) && low < high;
        let allowed = match kind {
            Kind::Light if in_order && low < 1.0 && high > 1.0 => return None,
            Kind::Light => "multiples of the mean, the lower from -1000 to below 1 and the upper from above 1 to 1000",
            _ if in_order => return None,
            _ => "two numbers from -1000 to 1000 in ascending order",
        };
        Some(format!("{} to {}; they must be {allowed}", readable(low), readable(high)))
    }

    /// Whether a spectrum is within the bounds, as nearly as the solver meets them.
    fn allows(&self, spectrum: &Spectrum, kind: Kind) -> bool {
        const SLACK: f64 = 1e-6;
        let unit = match kind {
            Kind::Light => spectrum.sum() / count(BANDS),
            _ => 1.0,
        };
        let [low, high] = self.bounds;
        let slack = SLACK * (high - low);
        spectrum.samples().iter().all(|sample| (low - slack..=high + slack).contains(&(sample / unit)))
    }

    /// Returns an error message if the smoothness is invalid.
    fn smoothness_problem(&self) -> Option<String> {
        (!SMOOTHNESSES.contains(&self.smoothness))
            .then(|| format!("{}; it must be {}", readable(self.smoothness), range(&SMOOTHNESSES)))
    }
}

/// "a number from 1e-6 to 1000000"
fn range(allowed: &RangeInclusive<f64>) -> String {
    format!("a number from {} to {}", readable(*allowed.start()), readable(*allowed.end()))
}

/// Target colour of one material under one light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Index of the row.
    pub material: usize,
    /// Index of the column.
    pub light: usize,
    /// Target colour.
    pub target: Target,
    /// Weight of its ΔE00, above 0.
    pub weight: f64,
}

/// Target colour of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Target {
    /// Display colour: `#rrggbb`.
    Srgb([u8; 3]),
    /// Tristimulus values; Y of the perfect reflector is 1.
    Xyz(Xyz),
    /// CIE L*a*b* relative to D65.
    Lab(Lab),
    /// Black.
    Black,
    /// Same colour as another cell.
    Like {
        /// Row index of the other cell.
        material: usize,
        /// Column index of the other cell.
        light: usize,
    },
}

impl Target {
    /// Returns the colour; `None` for [`Target::Like`].
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
    /// Returns the target colour; `colour` gives the colours of other cells.
    fn wanted(&self, colour: impl Fn(Place) -> Xyz) -> Xyz {
        match self.target {
            Target::Like { material, light } => colour(Place { material, light }),
            target => target.xyz().unwrap_or(Xyz([0.0; 3])),
        }
    }
}

/// Colour model of nodes that is fixed before the palette is solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelTerm {
    /// Number of nodes, 1 to 31.
    pub dimension: usize,
    /// Weight of the ΔE00 between the model's colours and the exact colours.
    pub weight: f64,
}

impl Palette {
    /// Describes the target of a cell: `#808080`, `as bone under day`, `free`.
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

    /// Refuses palettes that cannot be solved at all. [`Solution`] reports targets that are only missed.
    ///
    /// # Errors
    ///
    /// [`PaletteError::Unsolvable`], with what is missing or contradicts itself.
    pub fn check(&self) -> Result<(), PaletteError> {
        let wrong = |message: String| Err(PaletteError::Unsolvable { palette: self.source.clone(), message });
        let sides = [
            (&self.materials, "materials", "[materials.NAME]", Kind::Reflectance),
            (&self.lights, "lights", "[lights.NAME]", Kind::Light),
        ];
        for (members, what, table, kind) in sides {
            if members.is_empty() {
                return wrong(format!("it has no {what}; add at least one {table}"));
            }
            if members.len() > LARGEST {
                return wrong(format!(
                    "it has {} {what}, but at most {LARGEST} can be designed together; split it",
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
                return wrong(format!("the cell {index} refers to a missing material or light"));
            }
            let name = self.name(at);
            if self.cells[..index].iter().any(|earlier| Place::of(earlier) == at) {
                return wrong(format!("the cell {name} is defined twice"));
            }
            if other == at && matches!(cell.target, Target::Like { .. }) {
                return wrong(format!(
                    "the target of the cell {name} is the cell itself; omit the cell to leave it free"
                ));
            }
            if !WEIGHTS.contains(&cell.weight) {
                return wrong(format!(
                    "the weight of the cell {name} is {}; it must be {}",
                    readable(cell.weight),
                    range(&WEIGHTS)
                ));
            }
            // Far brighter than any light. Squares of larger values would drown the other targets.
            const LARGEST_PART: f64 = 1e3;
            if cell.target.xyz().is_some_and(|xyz| !xyz.0.iter().all(|part| part.abs() <= LARGEST_PART)) {
                return wrong(format!(
                    "the colour of the cell {name} is not finite, or exceeds {LARGEST_PART} times white"
                ));
            }
        }
        if let Some(term) = &self.model
            && !WEIGHTS.contains(&term.weight)
        {
            return wrong(format!("the model's weight is {}; it must be {}", readable(term.weight), range(&WEIGHTS)));
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

    /// Names of the open rows and columns that no cell concerns.
    #[must_use]
    pub fn without_target(&self) -> Vec<&str> {
        let places: Vec<Place> = self.cells.iter().flat_map(Place::both).collect();
        let rows = self.materials.iter().enumerate().map(|(row, it)| (it, places.iter().any(|it| it.material == row)));
        let columns =
            self.lights.iter().enumerate().map(|(column, it)| (it, places.iter().any(|it| it.light == column)));
        let free = rows.chain(columns).filter(|(member, has_target)| member.spectrum.is_none() && !has_target);
        free.map(|(member, _)| member.name.as_str()).collect()
    }

    /// Names of the open rows and columns of which `start` has no spectrum.
    #[must_use]
    pub fn without_start(&self, start: &Self) -> Vec<&str> {
        let sides = [(&self.materials, &start.materials), (&self.lights, &start.lights)];
        let has = |others: &[Member], name: &str| others.iter().any(|it| it.name == name && it.spectrum.is_some());
        let missing = sides.into_iter().flat_map(|(members, others)| {
            members.iter().filter(|member| member.spectrum.is_none() && !has(others, &member.name))
        });
        missing.map(|member| member.name.as_str()).collect()
    }

    fn cell(&self, place: Place) -> Option<&Cell> {
        self.cells.iter().find(|cell| Place::of(cell) == place)
    }
}

/// Row and column of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Place {
    material: usize,
    light: usize,
}

impl Place {
    const fn of(cell: &Cell) -> Self {
        Self { material: cell.material, light: cell.light }
    }

    /// Returns the places whose colours the cell constrains.
    fn both(cell: &Cell) -> impl Iterator<Item = Self> {
        let other = match cell.target {
            Target::Like { material, light } => Some(Self { material, light }),
            _ => None,
        };
        std::iter::once(Self::of(cell)).chain(other)
    }
}
