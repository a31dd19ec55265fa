//! Edits of a palette.

use std::sync::Arc;

use super::{Side, spectrum};
use relume_colour::model::LARGEST_DIMENSION;
use relume_colour::palette::{Cell, Member, ModelTerm, Palette, SMOOTHNESSES, Target};
use relume_scene::Scene;

/// An edit of a palette. Edits of missing rows, columns and cells have no effect.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Replaces the palette.
    Take(Arc<Palette>),
    /// Target colour of a cell, by row and column; `None` leaves it free.
    Target(usize, usize, Option<Target>),
    /// Weight of a cell, by row and column, above 0.
    Weight(usize, usize, f64),
    /// Whether a spectrum is open, to be solved for; a closed spectrum keeps its current samples.
    Open(Side, usize, bool),
    /// Bounds of the samples of an open spectrum; for a light, in multiples of its mean.
    Bounds(Side, usize, [f64; 2]),
    /// Weight of the squared second differences of an open spectrum, relative to squared ΔE00.
    Smoothness(Side, usize, f64),
    /// The same for every open spectrum.
    SmoothAll(f64),
    /// Colour model that is to reproduce the colours, if it is fixed before the spectra are solved.
    Model(Option<ModelTerm>),
}

impl Side {
    fn members(self, palette: &mut Palette) -> &mut Vec<Member> {
        match self {
            Self::Material => &mut palette.materials,
            Self::Light => &mut palette.lights,
        }
    }
}

impl Step {
    /// Applies the edit to `palette`, which belongs to `scene`; `None` if there is no palette to edit.
    #[must_use]
    pub fn applied(&self, scene: &Scene, palette: Option<&Palette>) -> Option<Palette> {
        if let Self::Take(palette) = self {
            return Some((**palette).clone());
        }
        let mut palette = palette?.clone();
        let at = |cell: &Cell, row: usize, column: usize| (cell.material, cell.light) == (row, column);
        match *self {
            Self::Take(_) => {}
            Self::Target(row, column, target) => {
                let weight = palette.cells.iter().find(|cell| at(cell, row, column)).map_or(1.0, |cell| cell.weight);
                palette.cells.retain(|cell| !at(cell, row, column));
                let there = |row: usize, column: usize| row < palette.materials.len() && column < palette.lights.len();
                let like_another = |target: &Target| match *target {
                    Target::Like { material, light } => there(material, light) && (material, light) != (row, column),
                    _ => true,
                };
                if let (Some(target), true) = (target.filter(like_another), there(row, column)) {
                    palette.cells.push(Cell { material: row, light: column, target, weight });
                }
            }
            Self::Weight(row, column, weight) => {
                if let Some(cell) = palette.cells.iter_mut().find(|cell| at(cell, row, column)) {
                    cell.weight = if weight.is_finite() { weight.clamp(1e-6, 1e6) } else { 1.0 };
                }
            }
            Self::Open(side, index, open) => {
                if let Some(member) = side.members(&mut palette).get_mut(index) {
                    let now = spectrum(scene, side, member).cloned();
                    member.spectrum = if open { None } else { now.or_else(|| member.spectrum.clone()) };
                }
            }
            Self::Bounds(side, index, [low, high]) => {
                if let Some(member) = side.members(&mut palette).get_mut(index) {
                    let wanted = Member { bounds: [low.clamp(-1e3, 1e3), high.clamp(-1e3, 1e3)], ..member.clone() };
                    let [low, high] = wanted.bounds;
                    let kept = low < high && (side == Side::Material || (low < 1.0 && high > 1.0));
                    if kept {
                        *member = wanted;
                    }
                }
            }
            Self::Smoothness(side, index, smoothness) => {
                if let (Some(member), true) = (side.members(&mut palette).get_mut(index), smoothness.is_finite()) {
                    member.smoothness = smoothness.clamp(*SMOOTHNESSES.start(), *SMOOTHNESSES.end());
                }
            }
            Self::SmoothAll(smoothness) => {
                if smoothness.is_finite() {
                    palette = palette.smoothed(smoothness.clamp(*SMOOTHNESSES.start(), *SMOOTHNESSES.end()));
                }
            }
            Self::Model(term) => {
                palette.model = term.map(|ModelTerm { dimension, weight }| ModelTerm {
                    dimension: dimension.clamp(1, LARGEST_DIMENSION),
                    weight: if weight.is_finite() { weight.clamp(1e-6, 1e6) } else { 1.0 },
                });
            }
        }
        Some(palette)
    }
}
