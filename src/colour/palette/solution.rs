//! Solution of a palette: spectra, colours, errors and spectral statistics.

use super::step::{Side, Spectra};
use super::{Conflict, Member, Palette, Place, Target};
use crate::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use crate::spectrum::{BANDS, Light, Reflectance, Spectrum};
use relume_base::number::count;

/// A palette with all its spectra.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The palette to solve.
    pub palette: Palette,
    /// Reflectance of each row, given or found.
    pub materials: Vec<Reflectance>,
    /// Light of each column, given or found; open ones have luminance 1.
    pub lights: Vec<Light>,
    /// All cells, row by row.
    pub cells: Vec<CellColour>,
    /// Statistics of each row's spectrum.
    pub material_facts: Vec<Facts>,
    /// Statistics of each column's spectrum.
    pub light_facts: Vec<Facts>,
    /// Cells that match others only because both are dark, although black was not asked for.
    pub dark_merges: Vec<Merge>,
    /// Conflicts that the convex relaxation proves.
    pub conflicts: Vec<Conflict>,
}

/// Colour of a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellColour {
    /// Row index.
    pub material: usize,
    /// Column index.
    pub light: usize,
    /// Colour of the material under the light.
    pub xyz: Xyz,
    /// Target colour; for a relation, the colour of the other cell; `None` for a free cell.
    pub target: Option<Xyz>,
    /// ΔE00 between `xyz` and `target`.
    pub difference: Option<f64>,
    /// Colour under the palette's model with its ΔE00 from [`Self::xyz`], if there is a model.
    pub shown: Option<(Xyz, f64)>,
}

/// Statistics of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facts {
    /// Whether the spectrum was open.
    pub open: bool,
    /// Smallest sample, for a light in multiples of its mean.
    pub lowest: f64,
    /// Largest sample, for a light in multiples of its mean.
    pub highest: f64,
    /// Number of the 81 samples at the lower bound; 0 for a given spectrum.
    pub at_low: usize,
    /// Number of the 81 samples at the upper bound; 0 for a given spectrum.
    pub at_high: usize,
    /// Sum of the negative samples over the sum of all magnitudes; 0 for a natural spectrum.
    pub negative: f64,
}

/// Two cells that match because both are dark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Merge {
    /// Row and column of the cell.
    pub cell: (usize, usize),
    /// Row and column of the cell that it refers to.
    pub like: (usize, usize),
}

impl Facts {
    fn new(member: &Member, side: Side, spectrum: &Spectrum) -> Self {
        /// Distance, as a fraction of the bounds' span, within which a sample counts as at a bound.
        const AT: f64 = 1e-4;
        let samples = spectrum.samples();
        let unit = match side {
            Side::Materials => 1.0,
            Side::Lights => spectrum.sum() / count(BANDS),
        };
        let unit = if unit > 0.0 { unit } else { 1.0 };
        let [low, high] = member.bounds;
        let near = AT * (high - low);
        let open = member.spectrum.is_none();
        let at = |is_at: &dyn Fn(f64) -> bool| {
            if open { samples.iter().filter(|&&sample| is_at(sample / unit)).count() } else { 0 }
        };
        let all: f64 = samples.iter().map(|sample| sample.abs()).sum();
        let below: f64 = samples.iter().map(|sample| (-sample).max(0.0)).sum();
        Self {
            open,
            lowest: samples.iter().copied().fold(f64::INFINITY, f64::min) / unit,
            highest: samples.iter().copied().fold(f64::NEG_INFINITY, f64::max) / unit,
            at_low: at(&|sample| sample <= low + near),
            at_high: at(&|sample| sample >= high - near),
            negative: if all > 0.0 { below / all } else { 0.0 },
        }
    }
}

impl Solution {
    /// Evaluates `spectra` on the palette. The caller adds the conflicts.
    pub(super) fn of(palette: &Palette, spectra: Spectra, shown: impl Fn(Place) -> Option<Xyz>) -> Self {
        let places = (0..palette.materials.len())
            .flat_map(|material| (0..palette.lights.len()).map(move |light| Place { material, light }));
        let colour = |place: Place| Xyz(spectra.xyz(place).to_array());
        let cells = places
            .map(|place| {
                let xyz = colour(place);
                let target = palette.cell(place).map(|cell| cell.wanted(colour));
                CellColour {
                    material: place.material,
                    light: place.light,
                    xyz,
                    target,
                    difference: target.map(|target| difference(xyz, target)),
                    shown: shown(place).map(|shown| (shown, difference(shown, xyz))),
                }
            })
            .collect();
        let facts = |side: Side, spectra: &[Spectrum]| {
            side.members(palette)
                .iter()
                .zip(spectra)
                .map(|(member, spectrum)| Facts::new(member, side, spectrum))
                .collect()
        };
        Self {
            palette: palette.clone(),
            cells,
            material_facts: facts(Side::Materials, &spectra.materials),
            light_facts: facts(Side::Lights, &spectra.lights),
            dark_merges: dark_merges(palette, &spectra),
            conflicts: Vec::new(),
            materials: spectra.materials.into_iter().map(Reflectance::of_finite).collect(),
            lights: spectra.lights.into_iter().map(Light::of_normalised).collect(),
        }
    }

    /// Returns the cell of a row and a column.
    #[must_use]
    pub fn cell(&self, material: usize, light: usize) -> Option<&CellColour> {
        self.cells.get(material * self.palette.lights.len() + light).filter(|_| light < self.palette.lights.len())
    }

    /// The palette with all spectra given: a start of [`super::solve_from`].
    #[must_use]
    pub fn with_spectra(&self) -> Palette {
        let mut palette = self.palette.clone();
        for (member, found) in palette.materials.iter_mut().zip(&self.materials) {
            member.spectrum = Some(found.spectrum().clone());
        }
        for (member, found) in palette.lights.iter_mut().zip(&self.lights) {
            member.spectrum = Some(found.spectrum().clone());
        }
        palette
    }

    /// Returns the largest ΔE00 between a cell and its target; 0 without targets.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.cells.iter().filter_map(|cell| cell.difference).fold(0.0, f64::max)
    }
}

/// ΔE00 between two colours.
pub(super) fn difference(one: Xyz, two: Xyz) -> f64 {
    ciede2000(lab_from_xyz(one, d65_white()), lab_from_xyz(two, d65_white()))
}

/// Returns the relations whose two cells are both darker than L* 10, where the other cell's target is not that dark.
fn dark_merges(palette: &Palette, spectra: &Spectra) -> Vec<Merge> {
    const DARK: f64 = 10.0;
    let lightness = |place| lab_from_xyz(Xyz(spectra.xyz(place).to_array()), d65_white()).0[0];
    let is_asked_dark = |place| {
        let target = palette.cell(place).and_then(|cell| cell.target.xyz());
        target.is_some_and(|xyz| lab_from_xyz(xyz, d65_white()).0[0] < DARK)
    };
    let merge = |cell: &super::Cell| match cell.target {
        Target::Like { material, light } => {
            let (place, like) = (Place::of(cell), Place { material, light });
            let dark = lightness(place) < DARK && lightness(like) < DARK && !is_asked_dark(like);
            dark.then_some(Merge { cell: (place.material, place.light), like: (material, light) })
        }
        _ => None,
    };
    palette.cells.iter().filter_map(merge).collect()
}
