//! The fixed header of `NIfTI`-1, `NIfTI`-2 and Analyze 7.5: numbers as stored.

use crate::ByteOrder;
use crate::readers::binary::Numbers;

/// Bytes of the header of `NIfTI`-1 and Analyze, and of `NIfTI`-2.
pub(super) const SIZES: [usize; 2] = [348, 540];

/// Format of a header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Version {
    Analyze,
    One,
    Two,
}

/// Format, byte order, and whether the voxels have a file of their own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Kind {
    pub(super) version: Version,
    pub(super) byte_order: ByteOrder,
    pub(super) is_pair: bool,
}

impl Kind {
    /// The kind of header that `bytes` begin with, by their length field and magic word; `None` for anything else.
    pub(super) fn of(bytes: &[u8]) -> Option<Self> {
        [ByteOrder::Little, ByteOrder::Big].into_iter().find_map(|byte_order| {
            let numbers = Numbers { bytes, byte_order };
            let kind = |version, is_pair| Some(Self { version, byte_order, is_pair });
            match (numbers.i32(0), bytes.get(4..7), bytes.get(344..348)) {
                (540, Some(b"n+2"), _) if bytes.len() >= SIZES[1] => kind(Version::Two, false),
                (540, Some(b"ni2"), _) if bytes.len() >= SIZES[1] => kind(Version::Two, true),
                (348, _, Some(b"n+1\0")) => kind(Version::One, false),
                (348, _, Some(b"ni1\0")) => kind(Version::One, true),
                (348, _, Some(_)) if (1..=7).contains(&numbers.i16(40)) => kind(Version::Analyze, true),
                _ => None,
            }
        })
    }
}

/// Fields of a header; those that Analyze lacks are 0.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) kind: Kind,
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) bitpix: i16,
    pub(super) pixdim: [f64; 8],
    pub(super) vox_offset: f64,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    pub(super) cal_min: f64,
    pub(super) cal_max: f64,
    pub(super) units: i32,
    pub(super) intent_code: i32,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// `quatern_b`, `quatern_c`, `quatern_d`.
    pub(super) quaternion: [f64; 3],
    pub(super) offset: [f64; 3],
    /// `srow_x`, `srow_y`, `srow_z`.
    pub(super) rows: [[f64; 4]; 3],
    /// Texts that are not empty, by name.
    pub(super) texts: Vec<(String, String)>,
}

impl Header {
    /// Reads the header at the beginning of `bytes`, which are as many as its kind requires.
    pub(super) fn of(bytes: &[u8]) -> Option<Self> {
        let kind = Kind::of(bytes)?;
        let numbers = Numbers { bytes, byte_order: kind.byte_order };
        Some(match kind.version {
            Version::Analyze => Self::analyze(kind, &numbers),
            Version::One => Self::one(kind, &numbers),
            Version::Two => Self::two(kind, &numbers),
        })
    }

    /// The image dimensions of Analyze, which `NIfTI`-1 keeps in place.
    fn analyze(kind: Kind, numbers: &Numbers<'_>) -> Self {
        Self {
            kind,
            dim: std::array::from_fn(|axis| numbers.i16(40 + 2 * axis).into()),
            datatype: numbers.i16(70),
            bitpix: numbers.i16(72),
            pixdim: std::array::from_fn(|axis| numbers.f32(76 + 4 * axis)),
            vox_offset: numbers.f32(108),
            slope: 0.0,
            intercept: 0.0,
            cal_min: numbers.f32(128),
            cal_max: numbers.f32(124),
            units: 0,
            intent_code: 0,
            qform_code: 0,
            sform_code: 0,
            quaternion: [0.0; 3],
            offset: [0.0; 3],
            rows: [[0.0; 4]; 3],
            texts: texts(numbers, &[("descrip", 148, 80), ("aux_file", 228, 24), ("vox_units", 56, 4)]),
        }
    }

    fn one(kind: Kind, numbers: &Numbers<'_>) -> Self {
        Self {
            slope: numbers.f32(112),
            intercept: numbers.f32(116),
            units: numbers.u8(123).into(),
            intent_code: numbers.i16(68).into(),
            qform_code: numbers.i16(252).into(),
            sform_code: numbers.i16(254).into(),
            quaternion: std::array::from_fn(|i| numbers.f32(256 + 4 * i)),
            offset: std::array::from_fn(|i| numbers.f32(268 + 4 * i)),
            rows: std::array::from_fn(|row| std::array::from_fn(|i| numbers.f32(280 + 16 * row + 4 * i))),
            texts: texts(numbers, &[("descrip", 148, 80), ("aux_file", 228, 24), ("intent_name", 328, 16)]),
            ..Self::analyze(kind, numbers)
        }
    }

    fn two(kind: Kind, numbers: &Numbers<'_>) -> Self {
        #[expect(clippy::cast_precision_loss, reason = "an offset above 2⁵³ is beyond the end of any file")]
        let vox_offset = numbers.i64(168) as f64;
        Self {
            kind,
            dim: std::array::from_fn(|axis| numbers.i64(16 + 8 * axis)),
            datatype: numbers.i16(12),
            bitpix: numbers.i16(14),
            pixdim: std::array::from_fn(|axis| numbers.f64(104 + 8 * axis)),
            vox_offset,
            slope: numbers.f64(176),
            intercept: numbers.f64(184),
            cal_min: numbers.f64(200),
            cal_max: numbers.f64(192),
            units: numbers.i32(500),
            intent_code: numbers.i32(504),
            qform_code: numbers.i32(344),
            sform_code: numbers.i32(348),
            quaternion: std::array::from_fn(|i| numbers.f64(352 + 8 * i)),
            offset: std::array::from_fn(|i| numbers.f64(376 + 8 * i)),
            rows: std::array::from_fn(|row| std::array::from_fn(|i| numbers.f64(400 + 32 * row + 8 * i))),
            texts: texts(numbers, &[("descrip", 240, 80), ("aux_file", 320, 24), ("intent_name", 508, 16)]),
        }
    }
}

/// Texts of name, offset and length, as far as they are not empty.
fn texts(numbers: &Numbers<'_>, places: &[(&str, usize, usize)]) -> Vec<(String, String)> {
    places.iter().filter_map(|&(name, at, length)| Some((name.to_owned(), numbers.text(at, length)?))).collect()
}
