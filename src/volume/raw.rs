//! Headerless voxels, whose layout somebody has to state.

use std::io::Read;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde::{Deserialize, Deserializer, de::Error as _};

use super::data::{self, Data, DataFile};
use super::pattern::{self, Pattern};
use super::stream::{self, Encoding, Start};
use super::{Geometry, Selection, Volume, VolumeError, VoxelType};
use crate::number::{in_words, line_and_column};
use crate::progress::Progress;

/// A layout is a few lines; what is longer is none.
const LONGEST_SIDECAR: u64 = 1 << 20;

/// Which byte of a number comes first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ByteOrder {
    /// The least significant.
    #[default]
    Little,
    /// The most significant.
    Big,
}

impl ByteOrder {
    /// The order of this machine.
    pub const NATIVE: Self = if cfg!(target_endian = "big") { Self::Big } else { Self::Little };
}

/// How headerless voxels lie: the keys of a sidecar, and what the command line's flags say.
///
/// ```toml
/// file = "CThead.%d"        # one file, or a pattern with one %d
/// slices = [1, 113]         # first and last number of the pattern, and the step if it is not 1
/// dims = [256, 256, 113]    # x first, which varies fastest
/// type = "uint16"
/// byte_order = "big"        # or "little", the default
/// header_bytes = 0          # to leave out at the beginning of every file
/// spacing = [1.0, 1.0, 2.0]
/// origin = [0.0, 0.0, 0.0]
/// direction = [1, 0, 0,  0, 1, 0,  0, 0, 1]   # three axes, one after the other
/// ```
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawLayout {
    /// The file of voxels, or the pattern of its slices, relative to the sidecar; with one sidecar beside one file it
    /// may be left out.
    pub file: Option<String>,
    /// First number of a pattern, last number, and the step between them (1 if left out); default: 1 to `dims[2]`.
    pub slices: Option<Vec<i64>>,
    /// Voxels along x, y and z; x varies fastest.
    pub dims: [usize; 3],
    /// The type of a voxel.
    #[serde(rename = "type", deserialize_with = "voxel_type")]
    pub voxel_type: VoxelType,
    /// The order of the bytes of a voxel.
    #[serde(default)]
    pub byte_order: ByteOrder,
    /// Bytes to leave out at the beginning of every file.
    #[serde(default)]
    pub header_bytes: u64,
    /// World units between neighbours.
    #[serde(default = "ones")]
    pub spacing: [f64; 3],
    /// World position of voxel (0, 0, 0).
    #[serde(default)]
    pub origin: [f64; 3],
    /// The directions of the axes, one after the other.
    #[serde(default = "identity")]
    pub direction: [f64; 9],
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

fn identity() -> [f64; 9] {
    DMat3::IDENTITY.to_cols_array()
}

fn voxel_type<'de, D: Deserializer<'de>>(deserializer: D) -> Result<VoxelType, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}

impl RawLayout {
    /// Little-endian voxels of a type in one file, with nothing before them and the plainest geometry.
    #[must_use]
    pub fn new(dims: [usize; 3], voxel_type: VoxelType) -> Self {
        Self {
            file: None,
            slices: None,
            dims,
            voxel_type,
            byte_order: ByteOrder::Little,
            header_bytes: 0,
            spacing: ones(),
            origin: [0.0; 3],
            direction: identity(),
        }
    }

    /// Reads a sidecar: the keys above, at the top level or in a table `[volume]`.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Open`], [`VolumeError::Read`], and [`VolumeError::Sidecar`] with line and column where it is no layout.
    pub fn from_sidecar(path: &Path) -> Result<Self, VolumeError> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Wrapped {
            volume: RawLayout,
        }
        let mut text = String::new();
        let read = stream::open(path)?.take(LONGEST_SIDECAR).read_to_string(&mut text);
        read.map_err(|source| stream::failed(path, source))?;
        let wrong = |error: toml::de::Error| {
            let place = line_and_column(&text, error.span().map_or(0, |span| span.start));
            VolumeError::Sidecar { path: path.to_owned(), place, problem: in_words(error.message()) }
        };
        let table: toml::Table = toml::from_str(&text).map_err(wrong)?;
        let layout = if table.contains_key("volume") {
            toml::from_str::<Wrapped>(&text).map(|wrapped| wrapped.volume)
        } else {
            toml::from_str(&text)
        };
        layout.map_err(wrong)
    }
}

/// Reads what `layout` describes; its `file` is relative to the folder `base`.
pub(super) fn read(
    layout: &RawLayout,
    base: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let Some(file) = &layout.file else {
        let problem = "the layout does not say which file the voxels are in; add the key file".to_owned();
        return Err(VolumeError::Layout { source_name: base.display().to_string(), problem });
    };
    let source_name = base.join(file).display().to_string();
    let wrong = |problem| VolumeError::Layout { source_name: source_name.clone(), problem };
    selection.only(&source_name)?;
    let geometry = Geometry::new(
        &source_name,
        layout.dims,
        DVec3::from_array(layout.spacing),
        DVec3::from_array(layout.origin),
        DMat3::from_cols_array(&layout.direction),
    )?;
    let [nx, ny, nz] = layout.dims;
    // A name with a per cent sign is a pattern, unless there is just such a file.
    let files = if layout.slices.is_some() || file.contains('%') && !base.join(file).exists() {
        let last = i64::try_from(nz).unwrap_or(i64::MAX);
        let range = match layout.slices.as_deref() {
            None => [1, last, 1],
            Some(&[first, last]) => [first, last, 1],
            Some(&[first, last, step]) => [first, last, step],
            Some(other) => {
                return Err(wrong(format!("slices = {other:?} should be [first, last] or [first, last, step]")));
            }
        };
        let pattern = Pattern::parse(file).map_err(wrong)?;
        let numbers = pattern::numbers(range, nz).map_err(wrong)?;
        numbers.map(|number| DataFile::found(base.join(pattern.name(number)), nx * ny)).collect::<Result<_, _>>()?
    } else {
        vec![DataFile { path: base.join(file), numbers: geometry.voxels() }]
    };
    let data = Data {
        files,
        start: Start::at(layout.header_bytes),
        encoding: Encoding::Raw,
        voxel_type: layout.voxel_type,
        byte_order: layout.byte_order,
        picks: Vec::new(),
    };
    let mut notes = Vec::new();
    let voxels = data.read(progress, &mut notes)?;
    let mut volume = Volume::new(&source_name, voxels, geometry)?;
    volume.files = data.paths();
    volume.notes = notes;
    Ok(volume)
}

/// Reads what the sidecar `path` describes; without a key `file`, `NAME.toml` describes `NAME`.
pub(super) fn read_sidecar(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let mut layout = RawLayout::from_sidecar(path)?;
    if let Some(file) = &layout.file {
        data::beside(path, file)?;
    }
    layout.file = layout.file.or_else(|| Some(path.file_stem()?.to_string_lossy().into_owned()));
    read_by(path, &layout, selection, progress)
}

/// Reads a file of headerless voxels by the sidecar beside it, `NAME.raw.toml` or `NAME.toml`.
pub(super) fn read_beside_sidecar(
    path: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let mut appended = path.as_os_str().to_owned();
    appended.push(".toml");
    let sidecars = [PathBuf::from(appended), path.with_extension("toml")];
    let Some(sidecar) = sidecars.iter().find(|sidecar| sidecar.exists()) else {
        // A file that is not there needs no sidecar.
        stream::open(path)?;
        let [sidecar, _] = sidecars;
        return Err(VolumeError::NoLayout { path: path.to_owned(), sidecar });
    };
    let mut layout = RawLayout::from_sidecar(sidecar)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    if let Some(other) = layout.file.as_ref().filter(|&file| *file != name) {
        let problem = format!("describes {other}, not {name}; open the sidecar itself to read {other}");
        return Err(VolumeError::Layout { source_name: sidecar.display().to_string(), problem });
    }
    layout.file = Some(name);
    read_by(sidecar, &layout, selection, progress)
}

/// Reads what `layout` of the sidecar `path` describes.
fn read_by(
    path: &Path,
    layout: &RawLayout,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let mut volume = read(layout, path.parent().unwrap_or(Path::new("")), selection, progress)?;
    volume.files.push(path.to_owned());
    Ok(volume)
}
