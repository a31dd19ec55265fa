//! Errors of reading and solving palettes.

use std::path::PathBuf;

use crate::model::ModelError;
use crate::spectrum::SpectrumError;

/// Error of reading or solving a palette.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaletteError {
    /// The palette file cannot be read.
    #[error("cannot read the palette {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The palette text is invalid.
    #[error("{at}: {message}")]
    Invalid {
        /// Position, as `file:line:column`.
        at: String,
        /// Error, and what is allowed.
        message: String,
    },
    /// A spectrum of the palette cannot be loaded.
    #[error("{at}: {what}")]
    Spectrum {
        /// Position, as `file:line:column`.
        at: String,
        /// Key of the spectrum.
        what: String,
        /// Cause.
        source: SpectrumError,
    },
    /// The palette cannot be solved.
    #[error("the palette {palette}: {message}")]
    Unsolvable {
        /// Source of the palette.
        palette: String,
        /// Error, and what is allowed.
        message: String,
    },
    /// The colour model of the palette cannot be fitted.
    #[error("cannot fit a colour model for the palette {palette}")]
    Model {
        /// Source of the palette.
        palette: String,
        /// Cause.
        source: ModelError,
    },
    /// The caller cancelled the search.
    #[error("solving the palette was stopped")]
    Cancelled,
}

impl PaletteError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Read { .. } => "palette-not-readable",
            Self::Invalid { .. } => "palette-invalid",
            Self::Spectrum { source, .. } => source.code(),
            Self::Unsolvable { .. } => "palette-unsolvable",
            Self::Model { source, .. } => source.code(),
            Self::Cancelled => "cancelled",
        }
    }
}
