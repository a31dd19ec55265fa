//! Kinds of colour models and their names.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Kind of a colour model: the meaning of its coefficients.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum ModelKind {
    /// Samples at wavelengths chosen for the scene, with a matrix fitted to each light: the default.
    #[default]
    Nodes,
    /// Coefficients in the sharpened factor model (Bergner et al. 2002, section 5.1; Drew and Finlayson 2003).
    Sharpened(Order),
    /// Coefficients in an orthonormal basis of the scene, with a k × k matrix per interaction of light (Peercy 1993).
    Peercy,
    /// Means over equal intervals from 400 to 700 nm, with a matrix fitted to each light.
    Bands,
    /// Red, green and blue, multiplied componentwise: the better of [`Self::RgbNaive`] and [`Self::RgbPrefiltered`].
    Rgb,
    /// RGB of the spectrum itself, i.e. under an equal-energy light.
    RgbNaive,
    /// RGB under D65 (prefiltered).
    RgbPrefiltered,
    /// RGB under D65, with a matrix fitted to each light: the best result from these three coefficients.
    RgbFitted,
}

/// Order in which a sharpened model projects and exponentiates an absorption.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Order {
    /// Projects each step's transmittance, as in the paper (equations 9 and 11).
    Step,
    /// Projects the absorption and exponentiates it per component, independently of the step length.
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

    /// Name on the command line and in files.
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

    /// Whether the model always has three coefficients.
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
