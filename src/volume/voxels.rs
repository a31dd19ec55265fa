//! Voxels in the type of their file.

use std::fmt;
use std::str::FromStr;

use super::{VolumeError, VoxelType};

impl VoxelType {
    /// No voxels of this type.
    pub(super) fn no_voxels(self) -> Voxels {
        with_type!(self, T => <T as Voxel>::into_voxels(Vec::new()))
    }
}

impl FromStr for VoxelType {
    type Err = VolumeError;

    /// Parses the names of numpy and of C (`uchar`, `short`, `unsigned short`, …) in any case. C's `long` is excluded,
    /// because its size depends on the platform that wrote the file.
    fn from_str(text: &str) -> Result<Self, VolumeError> {
        Ok(match text.trim().to_ascii_lowercase().as_str() {
            "uint8" | "u8" | "uchar" | "unsigned char" | "byte" => Self::U8,
            "int8" | "i8" | "char" | "schar" | "signed char" => Self::I8,
            "uint16" | "u16" | "ushort" | "unsigned short" => Self::U16,
            "int16" | "i16" | "short" => Self::I16,
            "uint32" | "u32" | "uint" | "unsigned int" => Self::U32,
            "int32" | "i32" | "int" => Self::I32,
            "uint64" | "u64" => Self::U64,
            "int64" | "i64" => Self::I64,
            "float32" | "f32" | "float" => Self::F32,
            "float64" | "f64" | "double" => Self::F64,
            _ => return Err(VolumeError::UnknownType { name: text.to_owned() }),
        })
    }
}

/// A voxel type; generic code over it runs on the voxels as stored.
pub trait Voxel: bytemuck::Pod + PartialOrd + Send + Sync + fmt::Debug {
    /// The corresponding [`VoxelType`].
    const TYPE: VoxelType;

    /// The value; 64-bit integers round to the nearest `f64`.
    fn to_f64(self) -> f64;

    /// The exact value of an integer type; `None` for float types.
    fn to_whole(self) -> Option<i128>;

    /// The stored number nearest to `value`; integers round half up, and saturate.
    fn nearest(value: f64) -> Self;

    /// The value with its bytes reversed.
    #[must_use]
    fn with_bytes_swapped(self) -> Self;

    /// The mean. Integers round half up; floats ignore NaN, and give NaN if all values are NaN. `None` without values.
    fn mean(values: impl Iterator<Item = Self> + Clone) -> Option<Self>;

    /// Parses the number in `text`; `None` if it is not a number of this type.
    fn parse(text: &str) -> Option<Self>;

    /// Wraps the vector as [`Voxels`].
    fn into_voxels(vector: Vec<Self>) -> Voxels;
}

macro_rules! integer_voxel {
    ($($type:ident $variant:ident),*) => {$(
        impl Voxel for $type {
            const TYPE: VoxelType = VoxelType::$variant;

            #[allow(clippy::cast_lossless, clippy::cast_precision_loss, reason = "64 bits round, as documented")]
            fn to_f64(self) -> f64 {
                self as f64
            }

            fn to_whole(self) -> Option<i128> {
                Some(i128::from(self))
            }

            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "saturates, as documented")]
            fn nearest(value: f64) -> Self {
                (value + 0.5).floor() as Self
            }

            fn with_bytes_swapped(self) -> Self {
                self.swap_bytes()
            }

            #[inline]
            fn mean(values: impl Iterator<Item = Self> + Clone) -> Option<Self> {
                let (mut sum, mut count) = (0_i128, 0_i128);
                for value in values {
                    sum += i128::from(value);
                    count += 1;
                }
                // ⌊sum / count + ½⌋ in integers. 64-bit division is several times faster, and nearly always wide
                // enough.
                let (numerator, denominator) = (2 * sum + count, 2 * count);
                match (i64::try_from(numerator), i64::try_from(denominator)) {
                    (_, Ok(0)) => None,
                    (Ok(numerator), Ok(denominator)) => Self::try_from(numerator.div_euclid(denominator)).ok(),
                    _ => Self::try_from(numerator.div_euclid(denominator)).ok(),
                }
            }

            #[allow(clippy::cast_possible_truncation, reason = "checked to be whole and in range")]
            #[allow(clippy::cast_precision_loss, clippy::cast_lossless, reason = "limits of 64 bits round up, and are excluded")]
            #[allow(clippy::cast_sign_loss, clippy::float_cmp, reason = "whole numbers compare exactly")]
            fn parse(text: &str) -> Option<Self> {
                // MetaIO writes integers via a double: 1e+06.
                text.parse().ok().or_else(|| {
                    let number: f64 = text.parse().ok()?;
                    let whole = number == number.trunc();
                    (whole && number >= Self::MIN as f64 && number < Self::MAX as f64 + 1.0).then_some(number as Self)
                })
            }

            fn into_voxels(vector: Vec<Self>) -> Voxels {
                Voxels::$variant(vector)
            }
        }
    )*};
}

macro_rules! float_voxel {
    ($($type:ident $variant:ident),*) => {$(
        impl Voxel for $type {
            const TYPE: VoxelType = VoxelType::$variant;

            fn to_f64(self) -> f64 {
                f64::from(self)
            }

            fn to_whole(self) -> Option<i128> {
                None
            }

            #[allow(clippy::cast_possible_truncation, trivial_numeric_casts, reason = "rounds to the stored type")]
            fn nearest(value: f64) -> Self {
                value as Self
            }

            fn with_bytes_swapped(self) -> Self {
                Self::from_bits(self.to_bits().swap_bytes())
            }

            #[allow(clippy::cast_possible_truncation, trivial_numeric_casts, reason = "rounds to the stored type")]
            fn mean(values: impl Iterator<Item = Self> + Clone) -> Option<Self> {
                // Keeps the sum of the largest floats of 64 bits finite.
                const SMALL: f64 = f64::EPSILON;
                let (mut sum, mut count, mut any) = (0.0_f64, 0.0_f64, false);
                for value in values.clone() {
                    any = true;
                    if !value.is_nan() {
                        sum += f64::from(value);
                        count += 1.0;
                    }
                }
                let mean = if sum.is_infinite() {
                    let scaled: f64 = values.filter(|value| !value.is_nan()).map(|value| f64::from(value) * SMALL).sum();
                    scaled / count / SMALL
                } else {
                    sum / count
                };
                any.then_some(mean as Self)
            }

            fn parse(text: &str) -> Option<Self> {
                text.parse().ok()
            }

            fn into_voxels(vector: Vec<Self>) -> Voxels {
                Voxels::$variant(vector)
            }
        }
    )*};
}

integer_voxel!(u8 U8, i8 I8, u16 U16, i16 I16, u32 U32, i32 I32, u64 U64, i64 I64);
float_voxel!(f32 F32, f64 F64);

/// Voxels of a volume, x fastest, in the type of their file.
#[derive(Clone, PartialEq)]
pub enum Voxels {
    /// `uint8`
    U8(Vec<u8>),
    /// `int8`
    I8(Vec<i8>),
    /// `uint16`
    U16(Vec<u16>),
    /// `int16`
    I16(Vec<i16>),
    /// `uint32`
    U32(Vec<u32>),
    /// `int32`
    I32(Vec<i32>),
    /// `uint64`
    U64(Vec<u64>),
    /// `int64`
    I64(Vec<i64>),
    /// `float32`
    F32(Vec<f32>),
    /// `float64`
    F64(Vec<f64>),
}

/// Evaluates an expression with the typed vector inside a [`Voxels`]: `with_voxels!(&volume.voxels, stored =>
/// stored.len())`.
#[macro_export]
macro_rules! with_voxels {
    ($voxels:expr, $stored:ident => $body:expr) => {
        match $voxels {
            $crate::Voxels::U8($stored) => $body,
            $crate::Voxels::I8($stored) => $body,
            $crate::Voxels::U16($stored) => $body,
            $crate::Voxels::I16($stored) => $body,
            $crate::Voxels::U32($stored) => $body,
            $crate::Voxels::I32($stored) => $body,
            $crate::Voxels::U64($stored) => $body,
            $crate::Voxels::I64($stored) => $body,
            $crate::Voxels::F32($stored) => $body,
            $crate::Voxels::F64($stored) => $body,
        }
    };
}
pub(crate) use with_voxels;

/// Evaluates an expression with the type of a [`VoxelType`]: `with_type!(voxel_type, T => read::<T>())`.
macro_rules! with_type {
    ($voxel_type:expr, $stored:ident => $body:expr) => {
        with_type!(@ $voxel_type, $stored => $body; U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, U64 u64, I64 i64,
                   F32 f32, F64 f64)
    };
    (@ $voxel_type:expr, $stored:ident => $body:expr; $($variant:ident $type:ident),*) => {
        match $voxel_type {$(
            $crate::VoxelType::$variant => {
                type $stored = $type;
                $body
            }
        )*}
    };
}
pub(crate) use with_type;

impl Voxels {
    /// Raises each number to that of `other`, where that is larger; false, without a change, if the types differ.
    pub(super) fn raise_to(&mut self, other: &Self) -> bool {
        fn raise<T: PartialOrd + Copy>(ours: &mut [T], theirs: &[T]) {
            for (our, &their) in ours.iter_mut().zip(theirs) {
                if their > *our {
                    *our = their;
                }
            }
        }
        match (self, other) {
            (Self::U8(ours), Self::U8(theirs)) => raise(ours, theirs),
            (Self::I8(ours), Self::I8(theirs)) => raise(ours, theirs),
            (Self::U16(ours), Self::U16(theirs)) => raise(ours, theirs),
            (Self::I16(ours), Self::I16(theirs)) => raise(ours, theirs),
            (Self::U32(ours), Self::U32(theirs)) => raise(ours, theirs),
            (Self::I32(ours), Self::I32(theirs)) => raise(ours, theirs),
            (Self::U64(ours), Self::U64(theirs)) => raise(ours, theirs),
            (Self::I64(ours), Self::I64(theirs)) => raise(ours, theirs),
            (Self::F32(ours), Self::F32(theirs)) => raise(ours, theirs),
            (Self::F64(ours), Self::F64(theirs)) => raise(ours, theirs),
            _ => return false,
        }
        true
    }

    /// Number of voxels.
    #[must_use]
    pub fn len(&self) -> usize {
        with_voxels!(self, stored => stored.len())
    }

    /// Whether there are no voxels.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Type of the voxels.
    #[must_use]
    pub fn voxel_type(&self) -> VoxelType {
        fn type_of<T: Voxel>(_: &[T]) -> VoxelType {
            T::TYPE
        }
        with_voxels!(self, stored => type_of(stored))
    }

    /// numpy's name of the type of the voxels.
    #[must_use]
    pub fn type_name(&self) -> &'static str {
        self.voxel_type().name()
    }

    /// Voxel `index` as stored, before slope and intercept; `None` past the end. 64-bit integers round to the nearest
    /// `f64`.
    #[must_use]
    pub fn value(&self, index: usize) -> Option<f64> {
        with_voxels!(self, stored => stored.get(index).map(|&value| value.to_f64()))
    }

    /// The voxels as bytes in native byte order.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        with_voxels!(self, stored => bytemuck::cast_slice(stored))
    }
}

/// Floats of 16 bits, whose bits were read as `uint16`, as floats of 32 bits, which hold all of them; other types stay.
/// `source` is the file.
pub(super) fn float_of_half(bits: u16) -> f32 {
    half::f16::from_bits(bits).to_f32()
}

/// Floats of 16 bits, each as two bytes of this machine's order, as floats of 32.
pub(super) fn bytes_of_floats(halves: &[u8]) -> Vec<u8> {
    let float = |&bytes: &[u8; 2]| float_of_half(u16::from_ne_bytes(bytes)).to_ne_bytes();
    halves.as_chunks::<2>().0.iter().flat_map(float).collect()
}

/// The values of floats of 16 bits.
pub(super) fn floats_of_halves(voxels: Voxels, source: &str) -> Result<Voxels, VolumeError> {
    let Voxels::U16(halves) = voxels else { return Ok(voxels) };
    let mut values = super::allocate::zeroed::<f32>(std::path::Path::new(source), halves.len())?;
    for (value, bits) in values.iter_mut().zip(halves) {
        *value = float_of_half(bits);
    }
    Ok(Voxels::F32(values))
}

impl fmt::Debug for Voxels {
    /// Writes the count and the type, not the millions of voxels.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{} × {}", self.len(), self.type_name())
    }
}
