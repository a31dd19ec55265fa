//! What came of solving a palette: the colours, how far they are from what was asked, and what the spectra are like.

use super::step::{Side, Spectra};
use super::{Conflict, Member, Palette, Place, Target};
use crate::number::count;
use crate::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};
use crate::spectrum::{BANDS, Light, Reflectance, Spectrum};

/// A palette with all its spectra.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// What was asked for.
    pub palette: Palette,
    /// A reflectance per row, given or found.
    pub materials: Vec<Reflectance>,
    /// A light per column, given or found; an open one has luminance 1.
    pub lights: Vec<Light>,
    /// Every cell, row by row.
    pub cells: Vec<CellColour>,
    /// What each row's spectrum is like.
    pub material_facts: Vec<Facts>,
    /// What each column's spectrum is like.
    pub light_facts: Vec<Facts>,
    /// Cells that look as others by being dark, though nobody asked for black.
    pub dark_merges: Vec<Merge>,
    /// What cannot be had, as convex problems show.
    pub conflicts: Vec<Conflict>,
}

/// What a cell looks like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellColour {
    /// Index of the row.
    pub material: usize,
    /// Index of the column.
    pub light: usize,
    /// The colour that the two spectra make.
    pub xyz: Xyz,
    /// The colour asked for: of a relation, what the other cell looks like; `None` where the cell is free.
    pub target: Option<Xyz>,
    /// ΔE00 between the two.
    pub difference: Option<f64>,
    /// The colour that the palette's model shows, and its ΔE00 from [`Self::xyz`], where there is a model.
    pub shown: Option<(Xyz, f64)>,
}

/// What a spectrum is like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Facts {
    /// Whether it was open.
    pub open: bool,
    /// The least sample; of a light in multiples of its mean.
    pub lowest: f64,
    /// The largest sample; of a light in multiples of its mean, its peak over mean.
    pub highest: f64,
    /// Of an open one, how many of the 81 samples lie at the lower bound.
    pub at_low: usize,
    /// Of an open one, how many of the 81 samples lie at the upper bound.
    pub at_high: usize,
    /// The sum of its negative samples over the sum of all magnitudes: 0 for a natural spectrum.
    pub negative: f64,
}

/// Two cells that look alike because both are dark.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Merge {
    /// Row and column.
    pub cell: (usize, usize),
    /// Row and column of the cell it is to look as.
    pub like: (usize, usize),
}

impl Facts {
    fn new(member: &Member, side: Side, spectrum: &Spectrum) -> Self {
        /// Nearer to a bound than this share of what lies between the two, a sample is at it.
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
    /// What `spectra` make of the palette; conflicts are left to the caller.
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

    /// The cell of a row and a column.
    #[must_use]
    pub fn cell(&self, material: usize, light: usize) -> Option<&CellColour> {
        self.cells.get(material * self.palette.lights.len() + light).filter(|_| light < self.palette.lights.len())
    }

    /// The largest ΔE00 of a cell from what was asked; 0 where nothing was.
    #[must_use]
    pub fn worst(&self) -> f64 {
        self.cells.iter().filter_map(|cell| cell.difference).fold(0.0, f64::max)
    }
}

/// ΔE00 of two colours.
pub(super) fn difference(one: Xyz, two: Xyz) -> f64 {
    ciede2000(lab_from_xyz(one, d65_white()), lab_from_xyz(two, d65_white()))
}

/// Cells that are to look as others, and do so as dark as L* 10, where neither is asked to be black.
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
