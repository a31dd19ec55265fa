//! Goals of a picture.

use relume_scene::key::{Choices, Named};

/// Accuracy or time goal of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// p95 of ΔE00 from the truth.
    MaxError(f64),
    /// Wall time of a frame in ms: march, relight and, if any, enlargement.
    Budget(f64),
}

/// Which pixels of a picture are marched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// All.
    All,
    /// Fewer where that serves the goal; the picture is then enlarged ([`Enlargement`](super::Enlargement)).
    Fewer,
}

/// A picture size and its goal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Pixels across and down.
    pub size: [usize; 2],
    /// The goal.
    pub goal: Goal,
    /// Which pixels are marched.
    pub pixels: Pixels,
}

/// Named goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Fast enough to rotate the volume by hand.
    Interactive,
    /// Visible differences in a few pixels at most.
    Balanced,
    /// No visible difference.
    Reference,
}

impl Named for Preset {
    /// From the fastest to the most accurate.
    const ALL: Choices<Self> =
        &[(Self::Interactive, "interactive"), (Self::Balanced, "balanced"), (Self::Reference, "reference")];
}

impl Preset {
    /// The preset of this name.
    ///
    /// # Errors
    ///
    /// The names of all presets, and the most similar one.
    pub fn of(name: &str) -> Result<Self, String> {
        Self::named(name, "the presets of accuracy")
    }

    /// Returns the goal of this preset.
    #[must_use]
    pub const fn goal(self) -> Goal {
        match self {
            Self::Interactive => Goal::Budget(50.0),
            Self::Balanced => Goal::MaxError(1.0),
            Self::Reference => Goal::MaxError(0.25),
        }
    }
}
