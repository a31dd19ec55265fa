//! Pictures and accumulators as files.

mod atomic;
mod channels;
mod drawing;
mod exr;
pub mod film;
mod picture;
mod png;
mod spectral;

pub use self::exr::write_exr;
pub use self::png::{Alpha, Depth, ready_png, write_png, write_ready_png};
pub use atomic::{Sink, check_writable, discard_unfinished, write_atomically};
pub use drawing::write_drawing;
pub use film::FilmFile;
pub use picture::Picture;
pub use spectral::{SpectralRow, write_spectral};

use std::path::{Path, PathBuf};

/// The name of picture `number` of several: `picture.png` as `picture-0001.png`.
#[must_use]
pub fn numbered(path: &Path, number: u16) -> PathBuf {
    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!("{}-{number:04}.{}", part(path.file_stem()), part(path.extension())))
}

/// The kinds of picture file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// sRGB for the screen.
    Png,
    /// Linear OpenEXR.
    Exr,
}

impl PictureKind {
    /// What `path` will be, by its extension.
    ///
    /// # Errors
    ///
    /// [`OutputError::Kind`] where that says nothing.
    pub fn of(path: &Path) -> Result<Self, OutputError> {
        match path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("png") => Ok(Self::Png),
            Some("exr") => Ok(Self::Exr),
            _ => Err(OutputError::Kind { path: path.to_owned() }),
        }
    }

    /// Whether `path` will be OpenEXR, as accumulators and spectral pictures are.
    ///
    /// # Errors
    ///
    /// [`OutputError::NoExr`] where it will not.
    pub fn require_exr(path: &Path) -> Result<(), OutputError> {
        match Self::of(path) {
            Ok(Self::Exr) => Ok(()),
            _ => Err(OutputError::NoExr { path: path.to_owned() }),
        }
    }
}

/// Samples of every spectrum in a file: 380–780 nm in steps of 5 nm.
pub const BANDS: usize = 81;

/// The first wavelength of a stored spectrum in nm.
const FIRST_NM: u16 = 380;

/// The distance between the wavelengths of a stored spectrum in nm.
const STEP_NM: u16 = 5;

/// What the `software` attribute of our files says.
const SOFTWARE: &str = concat!("relume ", env!("CARGO_PKG_VERSION"));

/// Why a file could not be written, or an accumulator file not be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// What passes is a matrix.
    #[error("the model peercy keeps a matrix of what passes, which accumulator files do not hold; take another model")]
    Matrix,
    /// The name says no kind of picture.
    #[error(
        "cannot tell what kind of picture {} is to be: end its name in .png (sRGB) or .exr (linear float)",
        path.display()
    )]
    Kind {
        /// The file.
        path: PathBuf,
    },
    /// The name is of no OpenEXR file, which this is to be.
    #[error("{} will be OpenEXR; end its name in .exr", path.display())]
    NoExr {
        /// The file.
        path: PathBuf,
    },
    /// The folder that should hold the file takes no other.
    #[error("cannot write {}: no file can be made in {}; write elsewhere", path.display(), folder.display())]
    NoFile {
        /// The file.
        path: PathBuf,
        /// Its folder.
        folder: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The folder that should hold the file does not exist.
    #[error("cannot write {}: there is no folder {}; make it, or write elsewhere", path.display(), folder.display())]
    NoFolder {
        /// The file asked for.
        path: PathBuf,
        /// The folder that is missing.
        folder: PathBuf,
    },
    /// The path names a folder.
    #[error("cannot write {}: it is a folder; add a file name", path.display())]
    IsFolder {
        /// The path asked for.
        path: PathBuf,
    },
    /// The disk filled up; what stood at `path` before is untouched.
    #[error("cannot write {}: the disk is full after {written} bytes; free space there, or write elsewhere", path.display())]
    DiskFull {
        /// The file asked for.
        path: PathBuf,
        /// How many bytes the disk took.
        written: u64,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file would outgrow what a file may hold here (`ulimit -f`, or the file system's own limit).
    #[error("cannot write {}: a file here may not grow past {written} bytes; raise the limit, or write elsewhere", path.display())]
    FileLimit {
        /// The file asked for.
        path: PathBuf,
        /// How many bytes were taken.
        written: u64,
        /// What the system said.
        source: std::io::Error,
    },
    /// Any other failure to write; what stood at `path` before is untouched.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file asked for.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The samples handed over are not the picture that its size promises.
    #[error("{what} of {width}×{height} pixels needs {expected} samples, and {found} were given")]
    Shape {
        /// What was to be written.
        what: &'static str,
        /// Pixels across.
        width: usize,
        /// Pixels down.
        height: usize,
        /// How many samples that takes.
        expected: String,
        /// How many there are.
        found: usize,
    },
    /// A picture has no pixels, or more of them across or down than a file can hold.
    #[error("a picture of {width}×{height} pixels cannot be stored: each side must be 1 to {largest}")]
    Size {
        /// Pixels across.
        width: usize,
        /// Pixels down.
        height: usize,
        /// The longest side that can be stored.
        largest: usize,
    },
    /// A drawing cannot be made a picture.
    #[error("the drawing for {} cannot be made a picture: {detail}", path.display())]
    Drawing {
        /// The file asked for.
        path: PathBuf,
        /// Why.
        detail: String,
    },
    /// The file could not be opened or read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file asked for.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is damaged, cut short, or not an OpenEXR file.
    #[error("{} is no readable OpenEXR file: {detail}", path.display())]
    Damaged {
        /// The file asked for.
        path: PathBuf,
        /// What the decoder met.
        detail: String,
    },
    /// The file is an OpenEXR file, but not one of accumulators.
    #[error("{} is not an accumulator file: {detail}", path.display())]
    NotAccumulators {
        /// The file asked for.
        path: PathBuf,
        /// What is missing, or there too much.
        detail: String,
    },
    /// The attribute `relume` cannot be understood.
    #[error("the attribute `relume` of {} is wrong: {detail}", path.display())]
    Attribute {
        /// The file asked for.
        path: PathBuf,
        /// Where and why.
        detail: String,
    },
    /// The accumulators contradict themselves, in memory or in a file.
    #[error("these accumulators cannot be stored or relit: {detail}")]
    Inconsistent {
        /// The thing and the number.
        detail: String,
    },
}
