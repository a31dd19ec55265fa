//! Type strings of `NumPy`'s array interface, which Zarr 2 has, too.

use crate::{ByteOrder, VoxelType};

/// Meaning of stored numbers beside their type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// The number itself.
    Number,
    /// Floats of 16 bits, in `uint16`.
    Half,
    /// 0 and 1, in `uint8`.
    Boolean,
}

/// Type, byte order and kind of the numbers of a type string of `NumPy`'s array interface, as `<u2` and `|b1`; a missing
/// byte order is little-endian. `None` for anything but booleans, whole numbers of 1 to 8 bytes, and floats of 2, 4 and 8.
pub(crate) fn of(name: &str) -> Option<(VoxelType, ByteOrder, Kind)> {
    let (byte_order, code) = match name.split_at_checked(1) {
        Some(("<" | "|", code)) => (ByteOrder::Little, code),
        Some((">", code)) => (ByteOrder::Big, code),
        Some(("=", code)) => (ByteOrder::NATIVE, code),
        _ => (ByteOrder::Little, name),
    };
    let (voxel_type, kind) = match code {
        "b1" => (VoxelType::U8, Kind::Boolean),
        "u1" => (VoxelType::U8, Kind::Number),
        "i1" => (VoxelType::I8, Kind::Number),
        "u2" => (VoxelType::U16, Kind::Number),
        "i2" => (VoxelType::I16, Kind::Number),
        "u4" => (VoxelType::U32, Kind::Number),
        "i4" => (VoxelType::I32, Kind::Number),
        "u8" => (VoxelType::U64, Kind::Number),
        "i8" => (VoxelType::I64, Kind::Number),
        "f2" => (VoxelType::U16, Kind::Half),
        "f4" => (VoxelType::F32, Kind::Number),
        "f8" => (VoxelType::F64, Kind::Number),
        _ => return None,
    };
    Some((voxel_type, byte_order, kind))
}
