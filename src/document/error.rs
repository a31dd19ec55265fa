//! Errors of scene files.

use std::path::PathBuf;

use relume_colour::palette::PaletteError;
use relume_colour::spectrum::SpectrumError;
use relume_volume::VolumeError;

/// Why a scene cannot be read, or is invalid.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SceneError {
    /// The text of the scene is invalid.
    #[error("{at}: {message}")]
    Invalid {
        /// `file:line:column`.
        at: String,
        /// The key, such as `lights.day.direction`; empty where there is none.
        key: String,
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
        /// The key, as in [`Self::Invalid`].
        key: String,
        /// The spectrum.
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
    /// The file is a volume, not a scene.
    #[error("{}: this is a volume, not a scene", path.display())]
    IsVolume {
        /// The file.
        path: PathBuf,
    },
    /// The file is too long for a scene.
    #[error("{}: a scene file has at most {limit} bytes, this one has {length}", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its length in bytes.
        length: u64,
        /// Greatest length of a scene file.
        limit: u64,
    },
    /// The file is not text.
    #[error("{}: not UTF-8 text from byte {byte} on", path.display())]
    NoText {
        /// The file.
        path: PathBuf,
        /// Index of the first byte that is not text.
        byte: usize,
    },
    /// The file is neither a scene nor a supported volume.
    #[error(transparent)]
    NoScene(VolumeError),
    /// Neither the scene nor the options name a volume.
    #[error("{scene} names no volume: write `file = …` into its [volume]")]
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
    /// A request names a missing light or position.
    #[error("{request}: {message}")]
    LightRequest {
        /// The request as given.
        request: String,
        /// The mistake, and the available names.
        message: String,
    },
    /// A definition `key=value` cannot be applied or makes the scene invalid.
    #[error("{given}: {message}")]
    Define {
        /// The definition as its user gave it.
        given: String,
        /// The mistake.
        message: String,
    },
}

impl SceneError {
    /// The key of the scene that is wrong, such as `lights.day.direction`, if it is one.
    #[must_use]
    pub fn key(&self) -> Option<&str> {
        match self {
            Self::Invalid { key, .. } | Self::Spectrum { key, .. } => Some(key.as_str()).filter(|key| !key.is_empty()),
            // Flags stand for definitions too.
            Self::Define { given, .. } => {
                given.split_once('=').map(|(key, _)| key).filter(|key| !key.starts_with('-') && !key.contains(' '))
            }
            _ => None,
        }
    }

    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Invalid { .. } => "scene-invalid",
            Self::Read { .. } => "scene-not-readable",
            Self::Spectrum { source, .. } => source.code(),
            Self::Palette { source, .. } => source.code(),
            Self::Volume { source, .. } | Self::Labels { source, .. } | Self::NoScene(source) => source.code(),
            Self::IsVolume { .. } => "scene-is-volume",
            Self::TooLong { .. } => "scene-too-long",
            Self::NoText { .. } => "scene-not-text",
            Self::NoVolume { .. } => "scene-without-volume",
            Self::LabelGrid { .. } => "label-grid-differs",
            Self::LightRequest { .. } => "light-request-invalid",
            Self::Define { .. } => "definition-invalid",
        }
    }
}

/// Text of an error and its causes in one line.
pub fn chain(error: &dyn std::error::Error) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        text = format!("{text}: {error}");
        cause = error.source();
    }
    text
}
