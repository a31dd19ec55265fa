//! Errors of measuring and choosing settings.

use super::goal::Goal;
use super::ladder::LadderError;
use relume_render::RenderError;
use relume_scene::plan::PlanError;

/// Failure of a measurement or a choice of settings.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeasureError {
    /// No setting reaches the goal.
    #[error("no setting of this scene reaches {}{nearest}", described(*goal))]
    None {
        /// The goal.
        goal: Goal,
        /// The nearest setting, as the end of the sentence.
        nearest: String,
    },
    /// No sampled pixel shows the volume, so that there is no error to measure.
    #[error("none of the {sampled} sampled pixels shows {source_name}, so no error can be measured")]
    Nothing {
        /// Number of sampled pixels.
        sampled: usize,
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

impl MeasureError {
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
