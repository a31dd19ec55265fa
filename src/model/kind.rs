//! The kinds of colour models, and their names.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// How the few numbers of a model stand for a spectrum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum ModelKind {
    /// Its samples at wavelengths chosen for the scene, with a matrix fitted to each light: the default.
    #[default]
    Nodes,
    /// Its coefficients in the sharpened factor model (Bergner et al. 2002, section 5.1; Drew and Finlayson 2003).
    Sharpened(Order),
    /// Its coefficients in an orthonormal basis of the scene, with a k × k matrix for what light meets on its way (Peercy 1993).
    Peercy,
    /// Its means over equal intervals from 400 to 700 nm, with a matrix fitted to each light.
    Bands,
    /// Red, green and blue, multiplied as if they were wavelengths: the better of the next two.
    Rgb,
    /// Those of the spectrum itself, as under a light that is equal at all wavelengths.
    RgbNaive,
    /// Those under D65 (prefiltered).
    RgbPrefiltered,
    /// Those under D65, with a matrix fitted to each light: the most that three such numbers can do.
    RgbFitted,
}

/// In which order a sharpened model projects and exponentiates an absorption.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Order {
    /// The paper's: each step's transmittance is projected (its equations 9 and 11).
    Step,
    /// The absorption is projected, and exponentiated per component: no step length enters.
    Semigroup,
}

impl ModelKind {
    /// All kinds.
    pub const ALL: [Self; 9] = [
        Self::Nodes,
        Self::Sharpened(Order::Step),
        Self::Sharpened(Order::Semigroup),
        Self::Peercy,
        Self::Bands,
        Self::Rgb,
        Self::RgbNaive,
        Self::RgbPrefiltered,
        Self::RgbFitted,
    ];

    /// Its name on the command line and in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Nodes => "nodes",
            Self::Sharpened(Order::Step) => "sharpened",
            Self::Sharpened(Order::Semigroup) => "sharpened-semigroup",
            Self::Peercy => "peercy",
            Self::Bands => "bands",
            Self::Rgb => "rgb",
            Self::RgbNaive => "rgb-naive",
            Self::RgbPrefiltered => "rgb-prefiltered",
            Self::RgbFitted => "rgb-fitted",
        }
    }

    /// Whether it has three numbers, and no others.
    pub const fn is_rgb(self) -> bool {
        matches!(self, Self::Rgb | Self::RgbNaive | Self::RgbPrefiltered | Self::RgbFitted)
    }
}

impl fmt::Display for ModelKind {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.pad(self.name())
    }
}

impl From<ModelKind> for String {
    fn from(kind: ModelKind) -> Self {
        kind.name().to_owned()
    }
}

impl FromStr for ModelKind {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("there is no colour model {name:?}; the models are {names}")
        })
    }
}

impl TryFrom<String> for ModelKind {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        name.parse()
    }
}
