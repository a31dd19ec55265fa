//! Errors of spectra.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// Kind of a spectrum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kind {
    /// See [`super::Reflectance`].
    Reflectance,
    /// See [`super::Light`].
    Light,
    /// See [`super::Absorption`].
    Absorption,
}

impl fmt::Display for Kind {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Self::Reflectance => "a reflectance",
            Self::Light => "a light",
            Self::Absorption => "an absorption",
        })
    }
}

/// Error of a spectrum's description, file or samples.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// A sample is infinite or NaN.
    #[error("{kind} must be finite, but this one is {value} at {nm} nm")]
    NotFinite {
        /// Intended kind of the spectrum.
        kind: Kind,
        /// Wavelength of the sample in nm.
        nm: f64,
        /// Value of the sample.
        value: f64,
    },
    /// An absorption is negative somewhere.
    #[error("an absorption must not be negative (it would amplify light), but this one is {value} at {nm} nm")]
    NegativeAbsorption {
        /// Wavelength of the sample in nm.
        nm: f64,
        /// Value of the sample.
        value: f64,
    },
    /// An absorption is zero everywhere and cannot be scaled to a peak of 1.
    #[error("an absorption of zeros cannot be scaled to a peak of 1; omit it to absorb nothing")]
    NoAbsorption,
    /// A temperature too low, or not finite, for a black body.
    #[error("a black body of {kelvin} K cannot be used as a light; its temperature must be at least 100 K")]
    Temperature {
        /// Requested temperature in kelvin.
        kelvin: f64,
    },
    /// A Gaussian that the grid cannot sample.
    #[error(
        "a Gaussian of centre {centre_nm} nm, sigma {sigma_nm} nm and height {height} cannot be sampled every 5 nm; \
         all three must be finite, and sigma at least 2.5 nm (give a narrower line as a table)"
    )]
    Gaussian {
        /// Requested centre in nm.
        centre_nm: f64,
        /// Requested standard deviation in nm.
        sigma_nm: f64,
        /// Requested height.
        height: f64,
    },
    /// A list of samples of the wrong length.
    #[error("{found} samples are given; the grid from 380 to 780 nm in steps of 5 nm has 81")]
    SampleCount {
        /// Number of samples given.
        found: usize,
    },
    /// Points that do not define a curve, with the reason.
    #[error("{0}")]
    Points(String),
    /// A colour code that is not `#rrggbb`.
    #[error(
        "{text:?} is not an sRGB colour; write \"#rrggbb\" with hexadecimal digits, such as \"#ff8000\" for orange"
    )]
    ColourCode {
        /// Text of the code.
        text: String,
    },
    /// A colour that no reflectance between 0 and 1 has.
    #[error("no reflectance between 0 and 1 has the linear sRGB colour [{}, {}, {}] under D65", .linear_srgb[0], .linear_srgb[1], .linear_srgb[2])]
    Unattainable {
        /// Requested colour.
        linear_srgb: [f64; 3],
    },
    /// A spectrum of one kind is used as another.
    #[error("{name} is {is}, and cannot be used as {wanted}")]
    WrongKind {
        /// Name of the spectrum.
        name: String,
        /// Its kind.
        is: Kind,
        /// Requested kind.
        wanted: Kind,
    },
    /// A name that no standard of the kind has.
    #[error("{name:?} is not the name of {kind}; {hint}")]
    NoStandard {
        /// Name.
        name: String,
        /// Requested kind.
        kind: Kind,
        /// Suggestion for the message.
        hint: String,
    },
    /// A name that is neither a standard nor a file.
    #[error("no standard spectrum is called {name:?}, and there is no file {}; {hint}", .path.display())]
    Unknown {
        /// Name.
        name: String,
        /// Path of the missing file.
        path: PathBuf,
        /// Suggestion for the message.
        hint: String,
    },
    /// A file cannot be read.
    #[error("the spectrum file {} cannot be read", .path.display())]
    Read {
        /// Path of the file.
        path: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// A file too large for a spectrum.
    #[error("{} is larger than 10 MB, the limit for a spectrum file", .path.display())]
    TooLarge {
        /// Path of the file.
        path: PathBuf,
    },
    /// A file that is not UTF-8 text.
    #[error("{} is not text; a spectrum file is UTF-8 text of wavelengths in nm and values", .path.display())]
    NotText {
        /// Path of the file.
        path: PathBuf,
    },
    /// A file without rows of numbers.
    #[error("{} holds no rows of numbers; a spectrum file is text of wavelengths in nm and values", .path.display())]
    Empty {
        /// Path of the file.
        path: PathBuf,
    },
    /// An invalid line of a file.
    #[error("{}, line {line}: {problem}, in {text:?}", .path.display())]
    Line {
        /// Path of the file.
        path: PathBuf,
        /// Line number from 1.
        line: usize,
        /// Text of the line, shortened.
        text: String,
        /// What is wrong with the line.
        problem: String,
    },
    /// No column of a file could be chosen.
    #[error("{}: {problem}; its columns are {columns}", .path.display())]
    Column {
        /// Path of the file.
        path: PathBuf,
        /// What is wrong with the choice.
        problem: String,
        /// Available columns.
        columns: String,
    },
    /// A file with valid rows that do not form a spectrum.
    #[error("the spectrum file {} cannot be used", .path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Cause.
        source: Box<Self>,
    },
}

impl SpectrumError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::NotFinite { .. } => "spectrum-not-finite",
            Self::NegativeAbsorption { .. } => "absorption-negative",
            Self::NoAbsorption => "absorption-zero",
            Self::Temperature { .. } => "temperature-invalid",
            Self::Gaussian { .. } => "gaussian-invalid",
            Self::SampleCount { .. } => "sample-count-invalid",
            Self::Points(_) => "spectrum-points-invalid",
            Self::ColourCode { .. } => "colour-code-invalid",
            Self::Unattainable { .. } => "colour-unattainable",
            Self::WrongKind { .. } => "spectrum-kind-differs",
            Self::NoStandard { .. } => "standard-unknown",
            Self::Unknown { .. } => "spectrum-unknown",
            Self::Read { .. } => "spectrum-not-readable",
            Self::TooLarge { .. } => "spectrum-file-too-large",
            Self::NotText { .. } => "spectrum-file-not-text",
            Self::Empty { .. } => "spectrum-file-empty",
            Self::Line { .. } => "spectrum-line-invalid",
            Self::Column { .. } => "spectrum-column-unknown",
            Self::File { source, .. } => source.code(),
        }
    }
}
