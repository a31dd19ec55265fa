//! Errors of scene files.

use std::path::PathBuf;

use crate::palette::PaletteError;
use crate::spectrum::SpectrumError;
use crate::volume::VolumeError;

/// Why a scene cannot be read, or is invalid.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The text of the scene is invalid.
    #[error("{at}: {message}")]
    Invalid {
        /// `file:line:column`.
        at: String,
        /// The mistake, and the allowed values.
        message: String,
    },
    /// The scene file cannot be read.
    #[error("cannot read the scene {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// A spectrum of the scene is not available.
    #[error("{at}: {what}")]
    Spectrum {
        /// `file:line:column`.
        at: String,
        /// Key of the spectrum.
        what: String,
        /// The cause.
        source: SpectrumError,
    },
    /// The palette of the scene is not available.
    #[error("the palette of {scene} cannot be used")]
    Palette {
        /// The scene.
        scene: String,
        /// The cause.
        source: PaletteError,
    },
    /// The volume of the scene is not available.
    #[error("the volume of {scene} cannot be used")]
    Volume {
        /// The scene.
        scene: String,
        /// The cause.
        source: VolumeError,
    },
    /// The labels of the scene are not available.
    #[error("the labels of {scene} cannot be used")]
    Labels {
        /// The scene.
        scene: String,
        /// The cause.
        source: VolumeError,
    },
    /// The file is neither a scene nor a supported volume.
    #[error(transparent)]
    NoScene(VolumeError),
    /// Neither the scene nor the command line names a volume.
    #[error("{scene} names no volume: give one with --volume FILE, or write `file = …` into its [volume]")]
    NoVolume {
        /// The scene.
        scene: String,
    },
    /// Labels and values have different grids.
    #[error("the labels {labels} have {theirs:?} voxels, the volume {volume} has {ours:?}; both need the same grid")]
    LabelGrid {
        /// The label file.
        labels: String,
        /// Its dimensions.
        theirs: [usize; 3],
        /// The volume's file.
        volume: String,
        /// Its dimensions.
        ours: [usize; 3],
    },
    /// `--light` names a missing light or position.
    #[error("--light {request}: {message}")]
    LightRequest {
        /// The request as given.
        request: String,
        /// The mistake, and the available names.
        message: String,
    },
    /// A `-D key=value`, or a flag that stands for one, cannot be applied or makes the scene invalid.
    #[error("{given}: {message}")]
    Define {
        /// The flag as given.
        given: String,
        /// The mistake.
        message: String,
    },
}
