//! What can be wrong with a spectrum.

use std::fmt;
use std::io;
use std::path::PathBuf;

/// What a spectrum is used as.
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

/// Why there is no spectrum.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// A sample is infinite or NaN.
    #[error("{kind} must be finite, and this one is {value} at {nm} nm")]
    NotFinite {
        /// What the spectrum was to be.
        kind: Kind,
        /// Where the sample is.
        nm: f64,
        /// The sample.
        value: f64,
    },
    /// An absorption is negative somewhere.
    #[error("an absorption must not be negative (it would amplify light), and this one is {value} at {nm} nm")]
    NegativeAbsorption {
        /// Where it is.
        nm: f64,
        /// The sample.
        value: f64,
    },
    /// An absorption is zero everywhere, so that its peak cannot be 1.
    #[error("an absorption of zeros has no peak; leave it out to absorb nothing")]
    NoAbsorption,
    /// A temperature at which no black body can be computed.
    #[error("a black body of {kelvin} K cannot be used as a light; its temperature must be at least 100 K")]
    Temperature {
        /// The temperature asked for.
        kelvin: f64,
    },
    /// A Gaussian band that the grid cannot hold.
    #[error(
        "a Gaussian of centre {centre_nm} nm, sigma {sigma_nm} nm and height {height} cannot be sampled every 5 nm; \
         all three must be finite, and sigma at least 2.5 nm (give a narrower line as a table)"
    )]
    Gaussian {
        /// The centre asked for.
        centre_nm: f64,
        /// The standard deviation asked for.
        sigma_nm: f64,
        /// The height asked for.
        height: f64,
    },
    /// A list of samples of the wrong length.
    #[error("{found} samples are given; the grid from 380 to 780 nm in steps of 5 nm has 81")]
    SampleCount {
        /// How many there are.
        found: usize,
    },
    /// A list of points that is no curve; the text says why.
    #[error("{0}")]
    Points(String),
    /// A colour code that is not `#rrggbb`.
    #[error("{text:?} is no sRGB colour; write it as \"#rrggbb\" with hexadecimal digits, \"#ff8000\" for orange")]
    ColourCode {
        /// What was written.
        text: String,
    },
    /// A colour that no reflectance has.
    #[error("no reflectance between 0 and 1 has the linear sRGB colour [{}, {}, {}] under D65", .linear_srgb[0], .linear_srgb[1], .linear_srgb[2])]
    Unattainable {
        /// The colour asked for.
        linear_srgb: [f64; 3],
    },
    /// A spectrum of one kind is used as another.
    #[error("{name} is {is}, and cannot be used as {wanted}")]
    WrongKind {
        /// The spectrum.
        name: String,
        /// What it is.
        is: Kind,
        /// What it was to be.
        wanted: Kind,
    },
    /// A name that no standard has.
    #[error("{name:?} is not the name of {kind}; {hint}")]
    NoStandard {
        /// The name.
        name: String,
        /// What was to be called so.
        kind: Kind,
        /// What could be meant.
        hint: String,
    },
    /// A name that is neither a standard nor a file.
    #[error("no standard spectrum is called {name:?}, and there is no file {}; {hint}", .path.display())]
    Unknown {
        /// The name.
        name: String,
        /// Where the file would be.
        path: PathBuf,
        /// What could be meant.
        hint: String,
    },
    /// A file cannot be read.
    #[error("the spectrum file {} cannot be read", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file whose size shows that it is no spectrum.
    #[error("{} is larger than 10 MB; that is no spectrum file", .path.display())]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
    /// A file that is not UTF-8 text.
    #[error("{} is not text; a spectrum file is UTF-8 text of wavelengths in nm and values", .path.display())]
    NotText {
        /// The file.
        path: PathBuf,
    },
    /// A file without a single row of numbers.
    #[error("{} holds no rows of numbers; a spectrum file is text of wavelengths in nm and values", .path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A line of a file that cannot be used.
    #[error("{}, line {line}: {problem}, in {text:?}", .path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line's number, the first being 1.
        line: usize,
        /// The line, shortened.
        text: String,
        /// What is wrong with it.
        problem: String,
    },
    /// A file's column cannot be chosen.
    #[error("{}: {problem}; its columns are {columns}", .path.display())]
    Column {
        /// The file.
        path: PathBuf,
        /// What is wrong with the choice.
        problem: String,
        /// The columns there are.
        columns: String,
    },
    /// A file whose rows, each in order, are no spectrum.
    #[error("the spectrum file {} cannot be used", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        source: Box<Self>,
    },
}
