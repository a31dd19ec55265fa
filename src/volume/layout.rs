//! Layout of headerless voxels, as a sidecar, a scene or the command line states it.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use glam::DMat3;
use serde::{Deserialize, Deserializer, de::Error as _};

use super::{Unit, VoxelType};
use relume_base::number::{count, whole};

/// Order of the bytes of a number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ByteOrder {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl ByteOrder {
    /// The byte order of this machine.
    pub const NATIVE: Self = if cfg!(target_endian = "big") { Self::Big } else { Self::Little };
}

/// Layout of headerless voxels: the keys of a sidecar, and the flags of the command line.
///
/// ```toml
/// file = "CThead.%d"        # one file, or a pattern with one %d
/// slices = [1, 113]         # first and last number of the pattern, and the step if it is not 1
/// dims = [256, 256, 113]    # x first, which varies fastest
/// type = "uint16"
/// byte_order = "big"        # or "little", the default
/// header_bytes = 0          # bytes to skip at the beginning of every file
/// spacing = [1.0, 1.0, 2.0]
/// unit = "mm"               # of the spacing: cm, mm, µm, nm or Å; default: unknown
/// origin = [0.0, 0.0, 0.0]
/// direction = [1, 0, 0,  0, 1, 0,  0, 0, 1]   # three axes, one after the other
/// downsample = [2, 2, 1]    # average blocks of voxels
/// component = 0             # only 0: voxels have one component
/// time = 0                  # only 0: there is one time step
/// ```
///
/// These are the keys of a scene's `[volume]`. The other keys of `[volume]` do not apply: `labels` describe what a
/// scene shows, as does `largest_part_above`, `phantom` replaces a file, and headerless voxels have no named `array`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RawLayout {
    /// The file of voxels, or the pattern of its slices, relative to the sidecar. Optional in a sidecar whose name is
    /// that of the file.
    pub file: Option<PathBuf>,
    /// First number, last number and step of a pattern (step 1 if omitted); default: 1 to `dims[2]`.
    pub slices: Option<Vec<i64>>,
    /// Voxels along x, y and z; x varies fastest.
    #[serde(deserialize_with = "from_one")]
    pub dims: [usize; 3],
    /// Type of the voxels.
    #[serde(rename = "type", deserialize_with = "voxel_type")]
    pub voxel_type: VoxelType,
    /// Byte order of the voxels.
    #[serde(default)]
    pub byte_order: ByteOrder,
    /// Bytes to skip at the beginning of every file.
    #[serde(default)]
    pub header_bytes: u64,
    /// World units between neighbouring voxels.
    #[serde(default = "ones")]
    pub spacing: [f64; 3],
    /// Unit of the spacing, if it is known.
    #[serde(default, deserialize_with = "unit")]
    pub unit: Option<Unit>,
    /// World position of voxel (0, 0, 0).
    #[serde(default)]
    pub origin: [f64; 3],
    /// Unit vectors of the axes in the world, one after the other.
    #[serde(default = "identity")]
    pub direction: [f64; 9],
    /// Blocks of voxels to average after reading ([`Volume::downsample`](super::Volume::downsample)).
    #[serde(default, deserialize_with = "blocks")]
    pub downsample: Option<[usize; 3]>,
    /// Component to read if the caller selects none; only 0 exists.
    pub component: Option<usize>,
    /// Time step to read if the caller selects none; only 0 exists.
    pub time: Option<usize>,
}

fn ones() -> [f64; 3] {
    [1.0; 3]
}

fn identity() -> [f64; 9] {
    DMat3::IDENTITY.to_cols_array()
}

/// Deserializes positive whole numbers, one per axis.
fn from_one<'de, D: Deserializer<'de>>(deserializer: D) -> Result<[usize; 3], D::Error> {
    Ok(<[NonZeroUsize; 3]>::deserialize(deserializer)?.map(NonZeroUsize::get))
}

fn blocks<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<[usize; 3]>, D::Error> {
    from_one(deserializer).map(Some)
}

fn unit<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<Unit>, D::Error> {
    let name = String::deserialize(deserializer)?;
    let known = Unit::named(&name).map(Some);
    known.ok_or_else(|| D::Error::custom(format!("{name:?} is no unit; the units are cm, mm, µm, nm and Å")))
}

fn voxel_type<'de, D: Deserializer<'de>>(deserializer: D) -> Result<VoxelType, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}

impl RawLayout {
    /// A layout of little-endian voxels in one file without a header, with spacing 1, origin 0 and the identity as
    /// direction.
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
            unit: None,
            origin: [0.0; 3],
            direction: identity(),
            downsample: None,
            component: None,
            time: None,
        }
    }

    /// Size of one file with all voxels and the skipped header, in bytes; `None` on overflow.
    #[must_use]
    pub fn bytes(&self) -> Option<u64> {
        let [nx, ny, nz] = self.dims;
        let sides = [nx, ny, nz, self.voxel_type.bytes()].map(|side| u64::try_from(side).ok());
        let voxels = sides.into_iter().try_fold(1_u64, |all, side| all.checked_mul(side?));
        voxels?.checked_add(self.header_bytes)
    }

    /// Guesses a layout from the name and the size of a file, as in `foot_256x256x256_uint8.raw`. Without dimensions in
    /// the name, the guess is a cube. The guess fills the file exactly: if the name has both dimensions and type, the
    /// excess bytes are a header before the voxels.
    #[must_use]
    pub fn guessed(name: &str, bytes: u64) -> Option<Self> {
        let words: Vec<&str> = name.split(|letter: char| !letter.is_ascii_alphanumeric()).collect();
        let sides = |word: &&str| -> Option<[usize; 3]> {
            let sides: Result<Vec<usize>, _> = word.split('x').map(str::parse).collect();
            sides.ok()?.try_into().ok()
        };
        let dims = words.iter().find_map(sides);
        // Two words first: `unsigned char` is not `char`.
        let two = words.windows(2).find_map(|pair| pair.join(" ").parse().ok());
        let named: Option<VoxelType> = two.or_else(|| words.iter().rev().find_map(|word| word.parse().ok()));
        if let (Some(dims), Some(voxel_type)) = (dims, named) {
            let plain = Self::new(dims, voxel_type);
            let header_bytes = bytes.checked_sub(plain.bytes()?)?;
            return Some(Self { header_bytes, ..plain });
        }
        let types = named.map_or_else(|| vec![VoxelType::U8, VoxelType::U16, VoxelType::F32], |named| vec![named]);
        let of_type = |&voxel_type: &VoxelType| {
            let voxels = bytes / u64::try_from(voxel_type.bytes()).ok()?;
            let side = whole(count(usize::try_from(voxels).ok()?).cbrt().round());
            let layout = Self::new(dims.unwrap_or([side; 3]), voxel_type);
            (bytes > 0 && layout.bytes() == Some(bytes)).then_some(layout)
        };
        types.iter().find_map(of_type)
    }
}
