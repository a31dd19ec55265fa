//! File output of pictures, films and volumes.

mod atomic;
mod bricks;
mod channels;
mod drawing;
mod exr;
pub mod film;
mod inputs;
pub mod page;
mod picture;
mod png;
mod spectral;
mod volume;

pub use self::exr::write_exr;
pub use self::png::{
    Alpha, Animation, Depth, display_codes, png_bytes, ready_png, write_apng, write_png, write_ready_png,
};
pub use atomic::{Sink, check_writable, discard_unfinished, write_atomically};
pub use bricks::write_bricks;
pub use drawing::{draw_over, write_drawing};
pub use film::FilmFile;
pub use inputs::inputs_of;
pub use picture::Picture;
pub use spectral::{SpectralRow, write_spectral};
pub use volume::{VolumeKind, Written, write_volume};

use std::path::{Path, PathBuf};

use relume_volume::VolumeError;

/// Returns the path of picture `number` of a sequence: `picture.png` becomes `picture-0001.png`.
#[must_use]
pub fn numbered(path: &Path, number: u16) -> PathBuf {
    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!("{}-{number:04}.{}", part(path.file_stem()), part(path.extension())))
}

/// Kind of a picture file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// Display-referred sRGB.
    Png,
    /// Linear OpenEXR.
    Exr,
}

impl PictureKind {
    /// Returns the kind by the extension of `path`.
    ///
    /// # Errors
    ///
    /// [`OutputError::Kind`] for an unknown extension.
    pub fn of(path: &Path) -> Result<Self, OutputError> {
        match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            _ => Err(OutputError::Kind { path: path.to_owned() }),
        }
    }

    /// Requires the extension of OpenEXR, for film files and spectral pictures.
    ///
    /// # Errors
    ///
    /// [`OutputError::NoExr`] for other extensions.
    pub fn require_exr(path: &Path) -> Result<(), OutputError> {
        match Self::of(path) {
            Ok(Self::Exr) => Ok(()),
            _ => Err(OutputError::NoExr { path: path.to_owned() }),
        }
    }
}

/// Number of samples of a stored spectrum: 380–780 nm in steps of 5 nm.
pub const BANDS: usize = 81;

/// First wavelength of a stored spectrum in nm.
const FIRST_NM: u16 = 380;

/// Wavelength step of a stored spectrum in nm.
const STEP_NM: u16 = 5;

/// Value of the `software` attribute of written files.
const SOFTWARE: &str = concat!("relume ", env!("CARGO_PKG_VERSION"));

/// Error of writing a file or reading a film file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The transmittance is a matrix.
    #[error("the model peercy has a transmittance of matrices, which a film file cannot store; use another model")]
    Matrix,
    /// The extension is of no kind of picture.
    #[error(
        "{}: the name of a picture must end in .png (sRGB) or .exr (linear float)",
        path.display()
    )]
    Kind {
        /// The file.
        path: PathBuf,
    },
    /// The volume cannot be read.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The extension is of no kind of volume that is written.
    #[error(
        "{}: unknown kind of volume; end its name in .nrrd, .mha, .nii or .nii.gz",
        path.display()
    )]
    VolumeKind {
        /// The file.
        path: PathBuf,
    },
    /// The progress listener cancelled the writing; the previous file at `path` is unchanged.
    #[error("writing {} was cancelled", path.display())]
    Cancelled {
        /// The file.
        path: PathBuf,
    },
    /// The file must be OpenEXR, and its extension differs.
    #[error("{}: the name of this file must end in .exr, because its format is OpenEXR", path.display())]
    NoExr {
        /// The file.
        path: PathBuf,
    },
    /// The folder accepts no new file.
    #[error("cannot write {}: cannot create files in {}; write elsewhere", path.display(), folder.display())]
    NoFile {
        /// The file.
        path: PathBuf,
        /// Folder of the file.
        folder: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// The folder does not exist.
    #[error("cannot write {}: there is no folder {}; make it, or write elsewhere", path.display(), folder.display())]
    NoFolder {
        /// Requested file.
        path: PathBuf,
        /// Missing folder.
        folder: PathBuf,
    },
    /// The path is a folder.
    #[error("cannot write {}: it is a folder; add a file name", path.display())]
    IsFolder {
        /// Requested path.
        path: PathBuf,
    },
    /// The disk is full; the previous file at `path` is unchanged.
    #[error("cannot write {}: the disk is full after {written} bytes; free space there, or write elsewhere", path.display())]
    DiskFull {
        /// Requested file.
        path: PathBuf,
        /// Number of bytes written.
        written: u64,
        /// System error.
        source: std::io::Error,
    },
    /// The file would exceed the size limit (`ulimit -f`, or that of the file system).
    #[error("cannot write {}: the system limits files to {written} bytes (`ulimit -f`); raise the limit, or write elsewhere", path.display())]
    FileLimit {
        /// Requested file.
        path: PathBuf,
        /// Number of bytes written.
        written: u64,
        /// System error.
        source: std::io::Error,
    },
    /// Any other write error; the previous file at `path` is unchanged.
    #[error("cannot write {}", path.display())]
    Write {
        /// Requested file.
        path: PathBuf,
        /// System error.
        source: std::io::Error,
    },
    /// The number of samples does not match the size of the picture.
    #[error("{what} of {width}×{height} pixels needs {expected} samples, and has {found}")]
    Shape {
        /// Object to write.
        what: &'static str,
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Required numbers of samples.
        expected: String,
        /// Number of samples given.
        found: usize,
    },
    /// The picture has no pixels, or a side is longer than a file can hold.
    #[error("a picture of {width}×{height} pixels cannot be stored: each side must be 1 to {largest}")]
    Size {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Longest side that can be stored.
        largest: usize,
    },
    /// The drawing cannot be rendered.
    #[error("cannot render the drawing for {}: {detail}", path.display())]
    Drawing {
        /// Requested file.
        path: PathBuf,
        /// Cause.
        detail: String,
    },
    /// The file cannot be opened or read.
    #[error("cannot read {}", path.display())]
    Read {
        /// Requested file.
        path: PathBuf,
        /// System error.
        source: std::io::Error,
    },
    /// The file is damaged, truncated, or not an OpenEXR file.
    #[error("{} is not a readable OpenEXR file: {detail}", path.display())]
    Damaged {
        /// Requested file.
        path: PathBuf,
        /// Message of the decoder.
        detail: String,
    },
    /// The OpenEXR file is not a film file.
    #[error("{} is not a film file: {detail}", path.display())]
    NotAccumulators {
        /// Requested file.
        path: PathBuf,
        /// Missing or unexpected content.
        detail: String,
    },
    /// The attribute `relume` is invalid.
    #[error("{}: invalid attribute `relume`: {detail}", path.display())]
    Attribute {
        /// Requested file.
        path: PathBuf,
        /// Position and cause.
        detail: String,
    },
    /// Parts do not composite.
    #[error("{}: {detail}", path.display())]
    Parts {
        /// The part.
        path: PathBuf,
        /// Numbers and way out.
        detail: String,
    },
    /// Blocks are missing beside a part.
    #[error("{}: {} missing beside this part", path.display(), film::blocks_are(missing, *blocks))]
    Missing {
        /// The part.
        path: PathBuf,
        /// First and last block of each gap.
        missing: Vec<[usize; 2]>,
        /// Number of blocks of the volume.
        blocks: usize,
        /// Whether the parts are all of a larger part, which was not asked for.
        is_part: bool,
    },
    /// The film is inconsistent, in memory or in a file.
    #[error("this film cannot be stored or relit: {detail}")]
    Inconsistent {
        /// Offending item and number.
        detail: String,
    },
}

impl OutputError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Matrix => "film-of-matrices",
            Self::Volume(error) => error.code(),
            Self::Kind { .. } => "picture-kind-unknown",
            Self::VolumeKind { .. } => "volume-kind-unknown",
            Self::Cancelled { .. } => "cancelled",
            Self::NoExr { .. } => "film-extension-invalid",
            Self::NoFile { .. } => "folder-not-writable",
            Self::NoFolder { .. } => "folder-missing",
            Self::IsFolder { .. } => "output-is-folder",
            Self::DiskFull { .. } => "disk-full",
            Self::FileLimit { .. } => "file-limit-exceeded",
            Self::Write { .. } => "output-not-written",
            Self::Shape { .. } => "sample-count-differs",
            Self::Size { .. } => "picture-size-invalid",
            Self::Drawing { .. } => "drawing-failed",
            Self::Read { .. } => "film-not-readable",
            Self::Damaged { .. } => "exr-damaged",
            Self::NotAccumulators { .. } => "exr-not-film",
            Self::Attribute { .. } => "film-attribute-invalid",
            Self::Parts { .. } => "film-parts-differ",
            Self::Missing { .. } => "film-parts-missing",
            Self::Inconsistent { .. } => "film-inconsistent",
        }
    }
}
