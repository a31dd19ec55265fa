//! Transfer syntaxes: how a file encodes elements and pixels (DICOM PS3.5, §10, and PS3.6, annex A).

use dicom_dictionary_std::uids;

use crate::ByteOrder;
use crate::stream::JPEG_LIMIT;

/// Largest number of bytes of a decoded frame.
pub(super) const MOST_BYTES: u64 = 1 << 28;
/// Largest number of pixels that a byte of JPEG-LS or JPEG 2000 stands for. Neither has a limit: an empty frame of any
/// size takes a hundred bytes.
const MOST_PIXELS: u64 = 1 << 16;

/// Explicit big endian, retired from the standard, but not from archives.
const EXPLICIT_VR_BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
/// A private one of GE: implicit little-endian elements, and big-endian pixels.
const GE_PRIVATE: &str = "1.2.840.113619.5.2";

/// Coding of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Coding {
    /// As they are, perhaps in fragments.
    Plain,
    /// As they are, in a data set that is one deflate stream.
    Deflated,
    Rle,
    /// JPEG: lossless, baseline, or extended with 8 bits.
    Jpeg,
    JpegLs,
    Jpeg2000,
    /// A coding that Relume does not decode.
    Foreign(&'static str),
}

impl Coding {
    /// Name in messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Plain => "uncompressed",
            Self::Deflated => "deflate",
            Self::Rle => "RLE",
            Self::Jpeg => "JPEG",
            Self::JpegLs => "JPEG-LS",
            Self::Jpeg2000 => "JPEG 2000",
            Self::Foreign(name) => name,
        }
    }

    /// Largest number of bytes of pixels that a byte of compressed data stands for, for numbers of `allocated` bits; `None`
    /// for pixels that are not compressed by frames.
    pub(super) fn packing(self, allocated: u32) -> Option<u64> {
        match self {
            Self::Rle => Some(64),
            Self::Jpeg => Some(JPEG_LIMIT),
            Self::JpegLs | Self::Jpeg2000 => Some(MOST_PIXELS.saturating_mul(u64::from(allocated).div_ceil(8))),
            Self::Plain | Self::Deflated | Self::Foreign(_) => None,
        }
    }
}

/// A transfer syntax.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Syntax {
    /// Identifier; empty if the file states none.
    pub(super) uid: String,
    pub(super) coding: Coding,
    /// That of the pixels, and of explicit elements.
    pub(super) byte_order: ByteOrder,
    /// Whether the elements are implicit, and thus little-endian.
    pub(super) is_implicit: bool,
}

impl Syntax {
    /// The transfer syntax of the identifier `uid`. The elements of most are explicit little endian.
    pub(super) fn of(uid: &str) -> Self {
        let coding = match uid {
            uids::IMPLICIT_VR_LITTLE_ENDIAN
            | uids::EXPLICIT_VR_LITTLE_ENDIAN
            | EXPLICIT_VR_BIG_ENDIAN
            | GE_PRIVATE
            | uids::ENCAPSULATED_UNCOMPRESSED_EXPLICIT_VR_LITTLE_ENDIAN => Coding::Plain,
            uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN => Coding::Deflated,
            uids::RLE_LOSSLESS => Coding::Rle,
            uids::JPEG_BASELINE8_BIT | uids::JPEG_EXTENDED12_BIT | uids::JPEG_LOSSLESS | uids::JPEG_LOSSLESS_SV1 => {
                Coding::Jpeg
            }
            uids::JPEGLS_LOSSLESS | uids::JPEGLS_NEAR_LOSSLESS => Coding::JpegLs,
            uids::JPEG2000_LOSSLESS | uids::JPEG2000 => Coding::Jpeg2000,
            uids::HTJ2K_LOSSLESS | uids::HTJ2K_LOSSLESS_RPCL | uids::HTJ2K => {
                Coding::Foreign("High-Throughput JPEG 2000")
            }
            uids::JPEGXL_LOSSLESS | uids::JPEGXLJPEG_RECOMPRESSION | uids::JPEGXL => Coding::Foreign("JPEG XL"),
            uids::JPEG2000MC_LOSSLESS | uids::JPEG2000MC => Coding::Foreign("JPEG 2000 of several components"),
            uids::DEFLATED_IMAGE_FRAME_COMPRESSION => Coding::Foreign("deflated frames"),
            other if is_video(other) => Coding::Foreign("video"),
            other if other.starts_with("1.2.840.10008.1.2.4.") => Coding::Foreign("a retired or unknown kind of JPEG"),
            _ => Coding::Foreign("an unknown coding"),
        };
        let is_big = [EXPLICIT_VR_BIG_ENDIAN, GE_PRIVATE].contains(&uid);
        let byte_order = if is_big { ByteOrder::Big } else { ByteOrder::Little };
        let is_implicit = [uids::IMPLICIT_VR_LITTLE_ENDIAN, GE_PRIVATE].contains(&uid);
        Self { uid: uid.to_owned(), coding, byte_order, is_implicit }
    }

    /// The transfer syntax of a file that states none, by the encoding of its first element: whether it is implicit, and its
    /// byte order.
    pub(super) fn guessed(found: Option<(bool, ByteOrder)>) -> Self {
        let uid = match found {
            Some((false, ByteOrder::Little)) => uids::EXPLICIT_VR_LITTLE_ENDIAN,
            Some((false, ByteOrder::Big)) => EXPLICIT_VR_BIG_ENDIAN,
            Some((true, _)) | None => uids::IMPLICIT_VR_LITTLE_ENDIAN,
        };
        Self { uid: String::new(), ..Self::of(uid) }
    }

    /// This transfer syntax, which a file states, with the encoding `found` in its first element, and a remark if the file states
    /// another one.
    pub(super) fn corrected(self, found: Option<(bool, ByteOrder)>) -> (Self, Option<String>) {
        let elements = if self.is_implicit { ByteOrder::Little } else { self.byte_order };
        let Some((is_implicit, byte_order)) = found else { return (self, None) };
        let is_deflated = self.coding == Coding::Deflated;
        if (self.is_implicit, elements) == (is_implicit, byte_order) && !is_deflated {
            return (self, None);
        }
        let order = if byte_order == ByteOrder::Big { "big" } else { "little" };
        let words = if is_implicit { "implicit" } else { "explicit" };
        let remark = format!(
            "the stated transfer syntax, {}, is wrong: the elements are {words} {order}-endian{}, and read so",
            self.uid,
            if is_deflated { ", not deflated" } else { "" }
        );
        let coding = match self.coding {
            // Nothing says which bytes of the pixels come first.
            _ if self.uid == GE_PRIVATE => Coding::Foreign("a private coding of GE with elements of another one"),
            Coding::Deflated => Coding::Plain,
            coding => coding,
        };
        (Self { coding, byte_order, is_implicit, ..self }, Some(remark))
    }
}

/// Whether `uid` is one of MPEG-2, MPEG-4 and HEVC: the numbers 100 to 108.
fn is_video(uid: &str) -> bool {
    let number = uid.strip_prefix("1.2.840.10008.1.2.4.").and_then(|rest| rest.split('.').next());
    number.and_then(|number| number.parse().ok()).is_some_and(|number: u32| (100..=108).contains(&number))
}
