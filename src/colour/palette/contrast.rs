//! Colour differences between materials under each light, with normal and deficient colour vision.

use super::Solution;
use super::solution::difference;
use crate::spectrum::colour::{linear_srgb_from_xyz, xyz_from_linear_srgb};
use crate::spectrum::deficiency::Deficiency;

/// ΔE00 of two materials under one light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contrast {
    /// Index of the light.
    pub light: usize,
    /// Indices of the materials.
    pub materials: [usize; 2],
    /// With normal colour vision, between the colours themselves.
    pub normal: f64,
    /// With each colour vision deficiency, in the order of [`Deficiency::ALL`], between the displayed colours.
    pub deficient: [f64; 3],
}

impl Solution {
    /// Returns the contrast of every pair of materials under every light, light by light.
    #[must_use]
    pub fn contrasts(&self) -> Vec<Contrast> {
        let rows = self.palette.materials.len();
        let pairs =
            move |light: usize| (0..rows).flat_map(move |one| (one + 1..rows).map(move |two| (light, [one, two])));
        let contrast = |(light, materials): (usize, [usize; 2])| {
            let [one, two] = [self.cell(materials[0], light)?.xyz, self.cell(materials[1], light)?.xyz];
            let deficient = Deficiency::ALL.map(|deficiency| {
                let [one, two] = [one, two].map(|xyz| xyz_from_linear_srgb(deficiency.seen(linear_srgb_from_xyz(xyz))));
                difference(one, two)
            });
            Some(Contrast { light, materials, normal: difference(one, two), deficient })
        };
        (0..self.palette.lights.len()).flat_map(pairs).filter_map(contrast).collect()
    }
}
