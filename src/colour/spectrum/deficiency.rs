//! Simulation of colour vision deficiencies: vision without one type of cone.

use std::fmt;
use std::sync::LazyLock;

use glam::{DMat3, DVec3};

use super::colour::LinearSrgb;

/// Colour vision deficiency, by the missing type of cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deficiency {
    /// Long-wavelength cones: no red.
    Protan,
    /// Middle-wavelength cones: no green.
    Deutan,
    /// Short-wavelength cones: no blue.
    Tritan,
}

impl Deficiency {
    /// All deficiencies.
    pub const ALL: [Self; 3] = [Self::Protan, Self::Deutan, Self::Tritan];

    /// Simulates the deficiency: returns the colour that looks to normal vision as `colour` looks to this deficiency
    /// (Machado, Oliveira and Fernandes 2009, severity 1). Clips `colour` and the result to the displayable range.
    #[must_use]
    pub fn seen(self, colour: LinearSrgb) -> LinearSrgb {
        let shown = DVec3::from(colour.0).clamp(DVec3::ZERO, DVec3::ONE);
        LinearSrgb((self.matrix() * shown).clamp(DVec3::ZERO, DVec3::ONE).to_array())
    }

    /// Matrix of [`Self::seen`] on linear sRGB, without clipping.
    #[must_use]
    pub fn matrix(self) -> DMat3 {
        static MATRICES: LazyLock<[DMat3; 3]> = LazyLock::new(|| Deficiency::ALL.map(published));
        match self {
            Self::Protan => MATRICES[0],
            Self::Deutan => MATRICES[1],
            Self::Tritan => MATRICES[2],
        }
    }
}

impl fmt::Display for Deficiency {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Protan => "protan",
            Self::Deutan => "deutan",
            Self::Tritan => "tritan",
        })
    }
}

/// Matrix from the published table; NaN for missing entries.
fn published(deficiency: Deficiency) -> DMat3 {
    let table = include_str!("../../../data/observers/machado2009_dichromats.csv");
    let name = deficiency.to_string();
    let row = table.lines().find_map(|line| line.strip_prefix(name.as_str())?.strip_prefix(','));
    let mut numbers = row.unwrap_or_default().split(',').map(|field| field.parse().unwrap_or(f64::NAN));
    let rows = std::array::from_fn(|_| numbers.next().unwrap_or(f64::NAN));
    DMat3::from_cols_array(&rows).transpose()
}
