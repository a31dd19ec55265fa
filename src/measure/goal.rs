//! Goals of a picture, and why no setting reaches one.

use super::ladder::LadderError;
use crate::plan::PlanError;
use crate::render::RenderError;

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

impl Preset {
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

/// Why no setting was chosen.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ChoiceError {
    /// No setting reaches the goal.
    #[error("no setting of this scene reaches {}{nearest}", described(*goal))]
    None {
        /// The goal.
        goal: Goal,
        /// The nearest setting, as the end of the sentence.
        nearest: String,
    },
    /// No pixel shows the volume, so that no error can be measured.
    #[error("no pixel of this picture shows {source_name}, so no error can be measured")]
    Nothing {
        /// The scene.
        source_name: String,
    },
    /// Planning failed.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The reference failed.
    #[error(transparent)]
    Ladder(#[from] LadderError),
    /// The device failed.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// A goal in words.
fn described(goal: Goal) -> String {
    match goal {
        Goal::MaxError(error) => format!("ΔE00 {error} in 95 % of the pixels"),
        Goal::Budget(ms) => format!("{ms} ms a frame"),
    }
}

impl ChoiceError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::None { goal: Goal::MaxError(_), .. } => "error-not-reached",
            Self::None { goal: Goal::Budget(_), .. } => "time-not-reached",
            Self::Nothing { .. } => "volume-not-visible",
            Self::Plan(error) => error.code(),
            Self::Ladder(error) => error.code(),
            Self::Render(error) => error.code(),
        }
    }

    /// Whether the picture is too large for the device, so that fewer pixels might fit.
    pub(super) fn is_too_large(&self) -> bool {
        matches!(self, Self::Render(RenderError::PictureSize { .. } | RenderError::PictureMemory { .. }))
    }
}
