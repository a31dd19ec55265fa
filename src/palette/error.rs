//! What keeps a palette from being read or solved.

use std::path::PathBuf;

use crate::model::ModelError;
use crate::spectrum::SpectrumError;

/// Why there is no palette, or none that is solved.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaletteError {
    /// The palette file cannot be read.
    #[error("cannot read the palette {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The palette's text is not what a palette may say; `at` is `file:line:column`.
    #[error("{at}: {message}")]
    Invalid {
        /// `file:line:column`.
        at: String,
        /// What is wrong, and what is allowed.
        message: String,
    },
    /// A spectrum of the palette cannot be had.
    #[error("{at}: {what}")]
    Spectrum {
        /// `file:line:column`.
        at: String,
        /// Which spectrum, by its key.
        what: String,
        /// Why.
        source: SpectrumError,
    },
    /// A palette that cannot be solved as it stands.
    #[error("the palette {palette}: {message}")]
    Unsolvable {
        /// The palette.
        palette: String,
        /// What is wrong, and what would be right.
        message: String,
    },
    /// The colour model that the palette is to be shown with cannot be fitted.
    #[error("the palette {palette} has no colour model to be shown with")]
    Model {
        /// The palette.
        palette: String,
        /// Why.
        source: ModelError,
    },
    /// Whoever listened wished to stop.
    #[error("solving the palette was stopped")]
    Cancelled,
}
