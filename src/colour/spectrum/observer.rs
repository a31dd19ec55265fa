//! CIE standard observers.

use std::fmt;
use std::sync::LazyLock;

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::colour::{Xyz, bradford, d65_white};
use super::matching::OBSERVER;
pub use super::matching::OBSERVER_1964;
use super::{Spectrum, standard};

/// Standard observer for the colours of spectra. It does not affect the strength of lights: their luminance is always
/// that of 1931.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Observer {
    /// CIE 1931 2-degree standard observer, for small fields such as on a screen. Displays are designed for it.
    #[default]
    #[serde(rename = "1931")]
    Cie1931,
    /// CIE 1964 10-degree standard observer, for large fields.
    #[serde(rename = "1964")]
    Cie1964,
}

impl Observer {
    /// All observers.
    pub const ALL: [Self; 2] = [Self::Cie1931, Self::Cie1964];

    /// Returns the three functions whose plain sums of products with a spectrum are the XYZ to display.
    ///
    /// Those of 1931 are [`OBSERVER`]. Displays are designed for these and have a D65 white. The functions of 1964 are
    /// therefore scaled so that D65 has Y = 1, and adapted by Bradford to the D65 white of 1931: D65 looks white to
    /// either observer.
    pub fn matching(self) -> &'static [Spectrum; 3] {
        static SHOWN_1964: LazyLock<[Spectrum; 3]> = LazyLock::new(|| {
            let white = OBSERVER_1964.each_ref().map(|matching| matching.dot(standard::d65().spectrum()));
            let relative = white.map(|part| part / white[1]);
            let shown = bradford(Xyz(relative), d65_white()) * white[1].recip();
            let rows = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| shown.transpose() * axis);
            rows.map(|row| {
                let parts = row.to_array().into_iter().zip(&OBSERVER_1964);
                parts.fold(Spectrum::constant(0.0), |sum, (part, matching)| &sum + &matching.scaled(part))
            })
        });
        match self {
            Self::Cie1931 => &OBSERVER,
            Self::Cie1964 => &SHOWN_1964,
        }
    }

    /// XYZ to display for a spectrum that reaches this observer; D65 at Y = 1 has the white of the display.
    pub fn xyz_of(self, spectrum: &Spectrum) -> Xyz {
        Xyz(self.matching().each_ref().map(|matching| matching.dot(spectrum)))
    }
}

impl fmt::Display for Observer {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Cie1931 => "1931",
            Self::Cie1964 => "1964",
        })
    }
}
