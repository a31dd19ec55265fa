//! Errors of volumes.

use std::io;
use std::path::PathBuf;

use super::{Asked, ByteOrder, RawLayout, Several};
use relume_base::number::brief;

/// Error in reading, making or processing a volume.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VolumeError {
    /// A file cannot be opened.
    #[error("cannot open {}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// A file without content.
    #[error("{}: the file is empty: it has 0 bytes; copy or download it again", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A file cannot be read to its end.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
    /// No reader recognises the file.
    #[error("{}: {what}; Relume reads {known}", path.display())]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Description of the file, as far as it is recognised.
        what: String,
        /// Whether the content is that of a known format without a reader, and so has a header.
        is_known: bool,
        /// Formats with a reader, with their extensions.
        known: String,
    },
    /// A folder has too many files.
    #[error(
        "{}: the folder and its folders hold more than {limit} files; open a folder with the files of one series",
        path.display()
    )]
    FolderTooLarge {
        /// The folder.
        path: PathBuf,
        /// Largest number of files and folders.
        limit: usize,
    },
    /// Headerless voxels without a layout.
    #[error(
        "{}: raw voxels have no header; give dims and type, or write them into {} (defaults: byte_order little, \
         header_bytes 0, spacing 1 1 1, origin 0 0 0, direction identity){}",
        path.display(),
        sidecar.display(),
        perhaps(guesses)
    )]
    NoLayout {
        /// The file of voxels.
        path: PathBuf,
        /// The sidecar that would be read.
        sidecar: PathBuf,
        /// Size of the file in bytes.
        bytes: u64,
        /// Layouts guessed from the name, the size and the values of the file, the likeliest first.
        guesses: Vec<RawLayout>,
    },
    /// A layout is given for a file with a header.
    #[error("{}: the file has a header; dims and type apply only to headerless files", path.display())]
    HasHeader {
        /// The file.
        path: PathBuf,
    },
    /// The layout of headerless voxels is invalid.
    #[error("{source_name}: {problem}")]
    Layout {
        /// The sidecar or the file of voxels.
        source_name: String,
        /// Description of the error.
        problem: String,
    },
    /// A sidecar is not TOML, or has unknown or mistyped keys.
    #[error("{}, line {}, column {}: {problem}", path.display(), place[0], place[1])]
    Sidecar {
        /// The sidecar.
        path: PathBuf,
        /// Line and column, from 1.
        place: [usize; 2],
        /// Description of the error.
        problem: String,
    },
    /// A line of a header is invalid.
    #[error("{}, line {line}: {problem}", path.display())]
    Header {
        /// The header.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// Description of the error.
        problem: String,
    },
    /// A field of a binary header, or another place of a file, is invalid.
    #[error("{}, {place}: {problem}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field or the place.
        place: String,
        /// Description of the error, with the numbers.
        problem: String,
    },
    /// A required key is missing.
    #[error("{}: the key {key} is missing", path.display())]
    MissingKey {
        /// The header.
        path: PathBuf,
        /// The key.
        key: &'static str,
    },
    /// No voxel type has this name.
    #[error(
        "unknown voxel type {name:?}; known are uint8, int8, uint16, int16, uint32, int32, uint64, int64, float32, float64"
    )]
    UnknownType {
        /// The name.
        name: String,
    },
    /// An axis has no voxels, or the voxels are too many to address.
    #[error(
        "{source_name}: {dims} voxels; every axis needs at least one voxel, and the whole volume must be addressable in memory"
    )]
    Dims {
        /// The file or phantom.
        source_name: String,
        /// The dimensions as given.
        dims: String,
    },
    /// The volume has more than three axes and time.
    #[error(
        "{source_name}: {dims} voxels have more than three spatial axes and one time axis; every further axis must have length 1"
    )]
    TooManyAxes {
        /// The file.
        source_name: String,
        /// The dimensions as given.
        dims: String,
    },
    /// An array does not say which of its axes are x, y and z.
    #[error(
        "{}: the shape is {shape}, slowest axis first; more than three axes are longer than 1, and the file does not say \
         which are z, y and x; state the axes, as in czyx",
        path.display()
    )]
    AxesUnknown {
        /// The file.
        path: PathBuf,
        /// Lengths of the axes.
        shape: String,
    },
    /// A spacing is not a positive number.
    #[error(
        "{source_name}: the spacing is {} {} {}; each number must be positive (to mirror an axis, change the direction)",
        spacing[0], spacing[1], spacing[2]
    )]
    Spacing {
        /// The file or phantom.
        source_name: String,
        /// The spacing as given.
        spacing: [f64; 3],
    },
    /// The origin is not finite.
    #[error("{source_name}: origin {} {} {} is not finite", origin[0], origin[1], origin[2])]
    Origin {
        /// The file or phantom.
        source_name: String,
        /// The origin as given.
        origin: [f64; 3],
    },
    /// The axes are not of unit length, or not orthogonal.
    #[error(
        "{source_name}: the axes {axes:?} are not orthonormal (|DᵀD − I| is {deviation}, the limit is {limit}); move lengths to the spacing; a sheared volume must be resampled"
    )]
    Direction {
        /// The file or phantom.
        source_name: String,
        /// The axis vectors, in order.
        axes: [[f64; 3]; 3],
        /// The largest entry of `|DᵀD − I|`.
        deviation: f64,
        /// Largest permitted entry.
        limit: f64,
    },
    /// The axes of a grid are not orthogonal.
    #[error(
        "{source_name}: the volume is sheared (its axes lean): {:.3}° between x and y, {:.3}° between x and z, {:.3}° between y \
         and z; resampling makes an orthogonal grid unless an angle is below 6°",
        angles[0], angles[1], angles[2]
    )]
    Lean {
        /// The file.
        source_name: String,
        /// Angles in degrees between x and y, x and z, y and z.
        angles: [f64; 3],
    },
    /// The slices are not evenly spaced.
    #[error("{source_name}: {problem}; resampling makes even steps")]
    Uneven {
        /// The file or folder.
        source_name: String,
        /// Description of the uneven steps, with the numbers.
        problem: String,
    },
    /// The file holds several scalar volumes, and none is selected.
    #[error("{source_name}: {there}; choose {}", there.range())]
    Choose {
        /// The file.
        source_name: String,
        /// Its contents.
        there: Several,
    },
    /// The selected volume is not in the file.
    #[error("{source_name}: {asked} does not exist; the file holds {there}")]
    NoSuch {
        /// The file.
        source_name: String,
        /// The selection.
        asked: Asked,
        /// Its contents.
        there: String,
    },
    /// A header names a file outside its folder.
    #[error(
        "{}: the header refers to {name:?}, outside the folder of the header; Relume does not read it, because the header may be untrusted. Open the data file directly, or move it into that folder",
        header.display()
    )]
    Outside {
        /// The header.
        header: PathBuf,
        /// The file of voxels as named in the header.
        name: String,
    },
    /// The data are shorter than the header states.
    #[error("{}: {found} bytes of voxels, but the stated dims and type require {expected}", path.display())]
    Short {
        /// The file of voxels.
        path: PathBuf,
        /// Bytes found (after decompression).
        found: u64,
        /// Bytes needed.
        expected: u64,
    },
    /// The compressed data are too short for the size in the header.
    #[error(
        "{}: {compressed} compressed bytes cannot hold the {expected} bytes of voxels that the header requires \
         ({encoding} expands one byte to at most {limit} bytes)",
        path.display()
    )]
    Incredible {
        /// The file of voxels.
        path: PathBuf,
        /// Compressed bytes found.
        compressed: u64,
        /// Bytes needed.
        expected: u64,
        /// The compression method.
        encoding: &'static str,
        /// Largest number of bytes that the method packs into one.
        limit: u64,
    },
    /// Compressed data are damaged.
    #[error("{}: damaged {encoding} data; {}", path.display(), sound(*decoded))]
    Inflate {
        /// The file of voxels.
        path: PathBuf,
        /// The compression method.
        encoding: &'static str,
        /// Intact bytes of voxels before the damage.
        decoded: u64,
        /// Error of the decoder.
        source: io::Error,
    },
    /// A compressed part of a file is damaged.
    #[error("{}, {place}: damaged {encoding} data", path.display())]
    DamagedPart {
        /// The file.
        path: PathBuf,
        /// The part.
        place: String,
        /// The compression method.
        encoding: &'static str,
        /// Error of the decoder.
        source: io::Error,
    },
    /// A voxel written as text is not a number of the voxel type.
    #[error("{}: voxel {index} is {text:?}, not a number of type {voxel_type}", path.display())]
    Text {
        /// The file of voxels.
        path: PathBuf,
        /// Index of the voxel in the file, from 0.
        index: usize,
        /// The text.
        text: String,
        /// The voxel type.
        voxel_type: &'static str,
    },
    /// Voxels written as text end early.
    #[error("{}: {found} numbers, but the header requires {expected} voxels", path.display())]
    ShortText {
        /// The file of voxels.
        path: PathBuf,
        /// Numbers found.
        found: usize,
        /// Voxels needed.
        expected: usize,
    },
    /// A VTK XML file is inconsistent or invalid.
    #[error("{}: {problem}", path.display())]
    Vti {
        /// The file.
        path: PathBuf,
        /// Description of the error.
        problem: String,
    },
    /// The values of an array of a VTK XML file cannot be decoded.
    #[error("{}: the array {array:?} cannot be read beyond the first {decoded} bytes of its values", path.display())]
    VtiArray {
        /// The file.
        path: PathBuf,
        /// The array.
        array: String,
        /// Intact bytes of values before the error.
        decoded: u64,
        /// The cause.
        source: io::Error,
    },
    /// There is not enough memory.
    #[error("{source_name}: not enough memory for {bytes} bytes of voxels; reduce the number of voxels")]
    Memory {
        /// The file or phantom.
        source_name: String,
        /// Bytes requested.
        bytes: u64,
    },
    /// The voxels exceed the memory that they may take.
    #[error("{source_name}: the voxels take {} of memory, and may take {}", mebibytes(*bytes), mebibytes(*limit))]
    Exceeds {
        /// The file.
        source_name: String,
        /// Bytes of the voxels.
        bytes: u64,
        /// Bytes that they may take.
        limit: u64,
    },
    /// The bricks that a march needs at once exceed the memory that they may take.
    #[error("{source_name}: rendering it in bricks takes at least {} of memory, and may take {}", mebibytes(*least), mebibytes(*limit))]
    BrickMemory {
        /// The file of bricks.
        source_name: String,
        /// Bytes needed.
        least: u64,
        /// Bytes that they may take.
        limit: u64,
    },
    /// The voxels stay in a file of bricks, and are needed in memory.
    #[error(
        "{source_name}: the voxels exceed the memory and stay in their file of bricks, and {what} needs all of them in memory"
    )]
    InFile {
        /// The file of bricks.
        source_name: String,
        /// The feature that needs them.
        what: &'static str,
    },
    /// No connected parts, because no voxel is above the value.
    #[error(
        "{source_name}: no voxel is above {}, so there is no connected part; the largest value is {}",
        brief(*value),
        brief(*most)
    )]
    NothingAbove {
        /// The volume.
        source_name: String,
        /// Value above which voxels are connected.
        value: f64,
        /// Largest value.
        most: f64,
    },
    /// The voxels are not read slab by slab.
    #[error("{source_name}: no bricks can be made of this file slice by slice, because {reason}")]
    NotStreamed {
        /// The file.
        source_name: String,
        /// Reason.
        reason: &'static str,
    },
    /// A file of bricks is damaged, or of another version.
    #[error("{}: {problem}", path.display())]
    Bricks {
        /// The cache.
        path: PathBuf,
        /// Description of the error, with the numbers.
        problem: String,
    },
    /// Every voxel is NaN or infinite.
    #[error("{source_name}: no finite voxel ({not_a_number} NaN, {infinite} infinite)")]
    NothingFinite {
        /// The file or phantom.
        source_name: String,
        /// Voxels that are NaN.
        not_a_number: u64,
        /// Voxels that are ±∞.
        infinite: u64,
    },
    /// Downsampling blocks that are empty, or larger than the volume.
    #[error(
        "{source_name}: cannot average blocks of {}×{}×{} in {}×{}×{} voxels; each side must be from 1 to the length of its axis",
        block[0], block[1], block[2], dims[0], dims[1], dims[2]
    )]
    Block {
        /// The file or phantom.
        source_name: String,
        /// The requested block.
        block: [usize; 3],
        /// The volume's dimensions.
        dims: [usize; 3],
    },
    /// No phantom has this name.
    #[error("unknown phantom {name:?}; known are {known}")]
    UnknownPhantom {
        /// The name.
        name: String,
        /// The known names.
        known: String,
    },
    /// The progress listener cancelled the reading.
    #[error("reading {source_name} was cancelled")]
    Cancelled {
        /// The file.
        source_name: String,
    },
}

impl VolumeError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Open { .. } => "volume-not-openable",
            Self::Empty { .. } => "volume-empty",
            Self::Read { .. } => "volume-not-readable",
            Self::UnknownFormat { .. } => "volume-format-unknown",
            Self::FolderTooLarge { .. } => "volume-folder-too-large",
            Self::NoLayout { .. } => "volume-layout-missing",
            Self::HasHeader { .. } => "volume-has-header",
            Self::Layout { .. } => "volume-layout-invalid",
            Self::Sidecar { .. } => "sidecar-invalid",
            Self::Header { .. } => "volume-header-invalid",
            Self::Field { .. } => "volume-field-invalid",
            Self::MissingKey { .. } => "volume-key-missing",
            Self::UnknownType { .. } => "voxel-type-unknown",
            Self::Dims { .. } => "volume-dims-invalid",
            Self::TooManyAxes { .. } => "volume-axes-too-many",
            Self::AxesUnknown { .. } => "volume-axes-unknown",
            Self::Spacing { .. } => "volume-spacing-invalid",
            Self::Origin { .. } => "volume-origin-invalid",
            Self::Direction { .. } => "volume-direction-invalid",
            Self::Lean { .. } => "volume-axes-lean",
            Self::Uneven { .. } => "volume-slices-uneven",
            Self::Choose { .. } => "volume-choice-missing",
            Self::NoSuch { .. } => "volume-choice-unknown",
            Self::Outside { .. } => "volume-data-outside-folder",
            Self::Short { .. } => "volume-data-short",
            Self::Incredible { .. } => "volume-compression-impossible",
            Self::Inflate { .. } | Self::DamagedPart { .. } => "volume-data-damaged",
            Self::Text { .. } => "voxel-text-invalid",
            Self::ShortText { .. } => "voxel-text-short",
            Self::Vti { .. } => "vti-invalid",
            Self::VtiArray { .. } => "vti-array-damaged",
            Self::Memory { .. } => "volume-memory-short",
            Self::Exceeds { .. } => "volume-exceeds-memory",
            Self::BrickMemory { .. } => "brick-memory-short",
            Self::InFile { .. } => "bricks-stay-in-file",
            Self::NothingAbove { .. } => "volume-nothing-above",
            Self::NotStreamed { .. } => "bricks-impossible",
            Self::Bricks { .. } => "bricks-damaged",
            Self::NothingFinite { .. } => "volume-not-finite",
            Self::Block { .. } => "downsample-block-invalid",
            Self::UnknownPhantom { .. } => "phantom-unknown",
            Self::Cancelled { .. } => "cancelled",
        }
    }
}

/// A number of bytes in the unit of the flags, rounded up.
fn mebibytes(bytes: u64) -> String {
    format!("{} MiB", bytes.div_ceil(1 << 20))
}

/// Describes the usable part of damaged data.
fn sound(decoded: u64) -> String {
    match decoded {
        0 => "no voxel is intact".to_owned(),
        decoded => format!("only the first {decoded} bytes of voxels are intact"),
    }
}

/// Describes the guessed layouts.
fn perhaps(guesses: &[RawLayout]) -> String {
    let words = |RawLayout { dims: [x, y, z], voxel_type, byte_order, header_bytes, .. }: &RawLayout| {
        let before = if *header_bytes > 0 { format!(", after {header_bytes} bytes") } else { String::new() };
        let order = if *byte_order == ByteOrder::Big { ", big-endian" } else { "" };
        format!("dims {x}×{y}×{z} and type {voxel_type}{order}{before}")
    };
    let words: Vec<String> = guesses.iter().map(words).collect();
    if words.is_empty() {
        return String::new();
    }
    format!("; its name, size and values suggest {}", words.join(", or "))
}
