//! Colours that depend on the ends of the visible range, where small differences of lamps and observers matter most.

use super::Solution;
use crate::spectrum::colour::{OBSERVER, d65_white, lab_from_xyz};
use crate::spectrum::{BANDS, wavelength_nm};

/// Wavelengths in nm beyond which a colour leans on the ends: the observer sees less than 1 % of its peak there.
const ENDS: [f64; 2] = [410.0, 690.0];
/// Share of a colour from beyond them that is worth a message. White has 0.01 under D65.
const NOTABLE: f64 = 0.25;
/// L* below which a cell is too dark to matter.
const DARK: f64 = 10.0;

/// Cell whose colour comes from the ends of the visible range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Row index.
    pub material: usize,
    /// Column index.
    pub light: usize,
    /// Share of X + Y + Z from below 410 nm and from above 690 nm.
    pub shares: [f64; 2],
}

impl Solution {
    /// Returns the cells with a quarter or more of their colour from the ends of the visible range, by an open spectrum.
    #[must_use]
    pub fn edges(&self) -> Vec<Edge> {
        let edge = |cell: &super::CellColour| {
            let (row, column) = (self.materials.get(cell.material)?, self.lights.get(cell.light)?);
            let is_open = self.material_facts.get(cell.material)?.open || self.light_facts.get(cell.light)?.open;
            let reflected = row.spectrum() * column.spectrum();
            let (mut all, mut shares) = (0.0, [0.0; 2]);
            for band in 0..BANDS {
                let seen =
                    OBSERVER.iter().map(|part| part.samples()[band]).sum::<f64>() * reflected.samples()[band].abs();
                all += seen;
                if wavelength_nm(band) < ENDS[0] {
                    shares[0] += seen;
                } else if wavelength_nm(band) > ENDS[1] {
                    shares[1] += seen;
                }
            }
            let shares = shares.map(|share| share / all);
            let is_lit = lab_from_xyz(cell.xyz, d65_white()).0[0] >= DARK;
            (is_open && is_lit && shares[0] + shares[1] >= NOTABLE).then_some(Edge {
                material: cell.material,
                light: cell.light,
                shares,
            })
        };
        self.cells.iter().filter_map(edge).collect()
    }
}
