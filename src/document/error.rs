//! Why a scene file cannot be read.

use std::path::PathBuf;

use crate::palette::PaletteError;
use crate::spectrum::SpectrumError;
use crate::volume::VolumeError;

/// A scene that cannot be, or cannot be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The scene's text is not what a scene may say; `at` is `file:line:column`.
    #[error("{at}: {message}")]
    Invalid {
        /// `file:line:column`.
        at: String,
        /// What is wrong, and what is allowed.
        message: String,
    },
    /// The scene file cannot be read.
    #[error("cannot read the scene {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A spectrum of the scene cannot be had.
    #[error("{at}: {what}")]
    Spectrum {
        /// `file:line:column`.
        at: String,
        /// Which spectrum, by its key.
        what: String,
        /// Why.
        source: SpectrumError,
    },
    /// The scene's palette cannot be had.
    #[error("{scene} has no palette to take its spectra from")]
    Palette {
        /// The scene.
        scene: String,
        /// Why.
        source: PaletteError,
    },
    /// The scene's volume cannot be had.
    #[error("{scene} has no volume to show")]
    Volume {
        /// The scene.
        scene: String,
        /// Why.
        source: VolumeError,
    },
    /// The labels of its voxels cannot be had.
    #[error("{scene} has no labels to show")]
    Labels {
        /// The scene.
        scene: String,
        /// Why.
        source: VolumeError,
    },
    /// The file is no scene and no volume that is read.
    #[error(transparent)]
    NoScene(VolumeError),
    /// No volume is named, neither in the scene nor beside it.
    #[error("{scene} names no volume: give one with --volume FILE, or write `file = …` into its [volume]")]
    NoVolume {
        /// The scene.
        scene: String,
    },
    /// Labels lie on another grid than the values.
    #[error("the labels {labels} have {theirs:?} voxels, the volume {volume} has {ours:?}; they must be the same grid")]
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
    /// `--light` asks for a light or a position that is not there.
    #[error("--light {request}: {message}")]
    LightRequest {
        /// As asked.
        request: String,
        /// What is wrong and what is there.
        message: String,
    },
    /// A `-D key=value`, or a flag that stands for one, cannot be applied, or makes the scene one that cannot be.
    #[error("{given}: {message}")]
    Define {
        /// The flag, as given.
        given: String,
        /// What is wrong.
        message: String,
    },
}
