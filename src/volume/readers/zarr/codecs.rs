//! Decoding of a chunk. The crate `zarrs` decodes; here, every stage is bound by the size that the metadata state.

use std::borrow::Cow;
use std::io::{self, Read as _};
use std::num::NonZeroU64;
use std::sync::Arc;

use flate2::bufread::{MultiGzDecoder, ZlibDecoder};
use zarrs::array::codec::{BloscCodec, BloscCodecConfiguration, BytesCodec, CodecChain, Crc32cCodec, TransposeCodec};
use zarrs::array::{
    ArrayBytes, ArrayToArrayCodecTraits, ArrayToBytesCodecTraits as _, BytesRepresentation, BytesToBytesCodecTraits,
    CodecOptions, DataType, Endianness, FillValue, data_type,
};
use zarrs::metadata_ext::codec::transpose::TransposeOrder;

use super::array::{Coding, Packing, Shard};
use crate::readers::guard::guarded;
use crate::{ByteOrder, VoxelType};

/// Decoder of chunks of one size.
pub(super) struct Decoder {
    packed: Vec<Packing>,
    numbers: CodecChain,
    shape: Vec<NonZeroU64>,
    data_type: DataType,
    /// Bytes of a decoded chunk.
    bytes: usize,
    blosc: BloscCodec,
}

impl Decoder {
    /// A decoder of chunks of these lengths; all of them are at least 1.
    pub(super) fn new(coding: &Coding, lengths: &[usize], voxel_type: VoxelType) -> io::Result<Self> {
        let order = |order: &Vec<usize>| -> io::Result<Arc<dyn ArrayToArrayCodecTraits>> {
            let order = TransposeOrder::new(order).map_err(|error| invalid(error.to_string()))?;
            Ok(Arc::new(TransposeCodec::new(order)))
        };
        let transposed = coding.transposed.iter().map(order).collect::<io::Result<_>>()?;
        // The shuffling is in every chunk; a decoder needs no configuration.
        let configuration = serde_json::json!({"cname": "lz4", "clevel": 5, "shuffle": "noshuffle", "blocksize": 0});
        let configuration: BloscCodecConfiguration = serde_json::from_value(configuration)?;
        let blosc = BloscCodec::new_with_configuration(&configuration).map_err(|error| invalid(error.to_string()))?;
        Ok(Self {
            packed: coding.packed.clone(),
            numbers: CodecChain::new(
                transposed,
                Arc::new(BytesCodec::new(Some(endianness(coding.byte_order)))),
                Vec::new(),
            ),
            shape: shape(lengths)?,
            data_type: type_of(voxel_type),
            bytes: lengths.iter().product::<usize>() * voxel_type.bytes(),
            blosc,
        })
    }

    /// Bytes of a decoded chunk.
    pub(super) fn bytes(&self) -> usize {
        self.bytes
    }

    /// Most bytes that a chunk of this size has when it is coded, with a margin.
    pub(super) fn most_coded(&self) -> u64 {
        crate::stream::count(margin(self.bytes))
    }

    /// Names of the compressions, for messages.
    pub(super) fn name(&self) -> &'static str {
        self.packed.last().map_or("raw", |packing| packing.name())
    }

    /// The numbers of the chunk `coded`, the last axis fastest, in the byte order of this machine.
    pub(super) fn decode(&self, coded: Vec<u8>) -> io::Result<Vec<u8>> {
        guarded(|| {
            let mut bytes = coded;
            for (index, packing) in self.packed.iter().enumerate().rev() {
                // A checksum or a second compression is around data that are not much longer than the numbers.
                let most = if index == 0 { self.bytes } else { margin(self.bytes) };
                bytes = self.unpacked(*packing, bytes, most)?;
            }
            if bytes.len() != self.bytes {
                return Err(invalid(format!("{} bytes of numbers instead of {}", bytes.len(), self.bytes)));
            }
            let fill = FillValue::new(vec![
                0;
                self.bytes
                    / self
                        .shape
                        .iter()
                        .map(|side| side.get())
                        .product::<u64>()
                        .try_into()
                        .unwrap_or(1)
                        .max(1)
            ]);
            let options = CodecOptions::default();
            let decoded = self.numbers.decode(Cow::Owned(bytes), &self.shape, &self.data_type, &fill, &options);
            fixed(decoded.map_err(|error| invalid(error.to_string()))?)
        })
    }

    /// Undoes one compression or checksum; more than `most` bytes are an error.
    fn unpacked(&self, packing: Packing, bytes: Vec<u8>, most: usize) -> io::Result<Vec<u8>> {
        let limit = crate::stream::count(most) + 1;
        let mut decoded = Vec::new();
        match packing {
            Packing::Gzip => drop(MultiGzDecoder::new(&bytes[..]).take(limit).read_to_end(&mut decoded)?),
            Packing::Zlib => drop(ZlibDecoder::new(&bytes[..]).take(limit).read_to_end(&mut decoded)?),
            Packing::Zstd => {
                let frames = Frames::of(&bytes);
                if frames.is_none_or(|frames| frames.are_stated) {
                    check(frames.map(|frames| frames.most), most)?;
                }
                // One byte more tells a chunk that is too long.
                let room = frames.map_or(0, |frames| frames.most).min(limit);
                decoded.try_reserve_exact(usize::try_from(room).unwrap_or(usize::MAX))?;
                zstd::bulk::Decompressor::new()?.decompress_to_buffer(&bytes, &mut decoded)?;
            }
            Packing::Blosc => {
                check(size_of_blosc(&bytes), most)?;
                decoded = through(&self.blosc, bytes, most)?;
            }
            Packing::Crc32c => decoded = through(&Crc32cCodec::new(), bytes, most)?,
        }
        if decoded.len() > most {
            return Err(invalid(format!("more than the {most} bytes of a chunk")));
        }
        Ok(decoded)
    }
}

/// Decodes `bytes` by a codec of `zarrs`.
fn through(codec: &dyn BytesToBytesCodecTraits, bytes: Vec<u8>, most: usize) -> io::Result<Vec<u8>> {
    let size = BytesRepresentation::BoundedSize(crate::stream::count(most));
    let decoded = codec.decode(Cow::Owned(bytes), &size, &CodecOptions::default());
    decoded.map(Cow::into_owned).map_err(|error| invalid(error.to_string()))
}

/// The size that compressed data state, compared with `most`: the decoder allocates by it.
fn check(stated: Option<u64>, most: usize) -> io::Result<()> {
    match stated {
        Some(stated) if stated <= crate::stream::count(most) => Ok(()),
        Some(stated) => Err(invalid(format!("it states {stated} bytes, but a chunk has {most}"))),
        None => Err(invalid("its header is damaged".to_owned())),
    }
}

/// Bytes of coded data of `bytes` bytes, at most: no compression adds an eighth.
fn margin(bytes: usize) -> usize {
    bytes + bytes / 8 + (1 << 16)
}

fn fixed(bytes: ArrayBytes<'_>) -> io::Result<Vec<u8>> {
    bytes.into_fixed().map(Cow::into_owned).map_err(|error| invalid(error.to_string()))
}

fn invalid(problem: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, problem)
}

fn endianness(order: ByteOrder) -> Endianness {
    match order {
        ByteOrder::Little => Endianness::Little,
        ByteOrder::Big => Endianness::Big,
    }
}

fn shape(lengths: &[usize]) -> io::Result<Vec<NonZeroU64>> {
    let side = |&length: &usize| NonZeroU64::new(crate::stream::count(length));
    lengths.iter().map(side).collect::<Option<_>>().ok_or_else(|| invalid("an axis of length 0".to_owned()))
}

/// The type of `zarrs`; halves and booleans are read as whole numbers.
fn type_of(voxel_type: VoxelType) -> DataType {
    match voxel_type {
        VoxelType::U8 => data_type::uint8(),
        VoxelType::I8 => data_type::int8(),
        VoxelType::U16 => data_type::uint16(),
        VoxelType::I16 => data_type::int16(),
        VoxelType::U32 => data_type::uint32(),
        VoxelType::I32 => data_type::int32(),
        VoxelType::U64 => data_type::uint64(),
        VoxelType::I64 => data_type::int64(),
        VoxelType::F32 => data_type::float32(),
        VoxelType::F64 => data_type::float64(),
    }
}

/// Bytes that a Blosc chunk states; `None` for less than a header, and for another length of the chunk.
fn size_of_blosc(bytes: &[u8]) -> Option<u64> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    let (decoded, coded) = (word(4)?, word(12)?);
    (usize::try_from(coded).ok()? <= bytes.len()).then_some(u64::from(decoded))
}

/// Size of the frames of zstd data (RFC 8878).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Frames {
    /// Bytes that they have, as stated; at most so many where a frame states none.
    most: u64,
    /// Whether each frame states its size.
    are_stated: bool,
}

impl Frames {
    /// `None` for damaged frames.
    fn of(mut bytes: &[u8]) -> Option<Self> {
        /// Largest size of a block.
        const BLOCK: u64 = 128 << 10;
        let mut frames = Self { most: 0, are_stated: true };
        let word = |bytes: &[u8], length: usize| {
            let part = bytes.get(..length)?;
            Some(part.iter().rev().fold(0_u64, |word, &byte| word << 8 | u64::from(byte)))
        };
        while !bytes.is_empty() {
            let magic = word(bytes, 4)?;
            bytes = &bytes[4..];
            if magic & 0xffff_fff0 == 0x184d_2a50 {
                // A frame that is skipped.
                let length = usize::try_from(word(bytes, 4)?).ok()?;
                bytes = bytes.get(4..)?.get(length..)?;
                continue;
            }
            if magic != 0xfd2f_b528 {
                return None;
            }
            let descriptor = *bytes.first()?;
            let is_single = descriptor & 0x20 != 0;
            let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
            let size_bytes = match (descriptor >> 6, is_single) {
                (0, false) => 0,
                (0, true) => 1,
                (1, _) => 2,
                (2, _) => 4,
                _ => 8,
            };
            // No block is longer than the window: eighths of a power of two.
            let window = match is_single {
                true => u64::MAX,
                false => {
                    let byte = *bytes.get(1)?;
                    let base = 1_u64 << (10 + (byte >> 3));
                    base + base / 8 * u64::from(byte & 7)
                }
            };
            bytes = bytes.get(1 + usize::from(!is_single) + dictionary..)?;
            let stated = word(bytes, size_bytes)? + if size_bytes == 2 { 256 } else { 0 };
            bytes = &bytes[size_bytes..];
            let mut in_blocks = 0_u64;
            loop {
                let header = word(bytes, 3)?;
                let (kind, length) = (header >> 1 & 3, header >> 3);
                // A block as it is, one byte repeated, or a compressed block.
                in_blocks += if kind < 2 { length } else { BLOCK.min(window) };
                let length = if kind == 1 { 1 } else { usize::try_from(length).ok()? };
                bytes = bytes.get(3 + length..)?;
                if header & 1 == 1 {
                    break;
                }
            }
            bytes = bytes.get(if descriptor & 4 != 0 { 4 } else { 0 }..)?;
            frames.are_stated &= size_bytes > 0;
            frames.most = frames.most.checked_add(if size_bytes > 0 { stated } else { in_blocks })?;
        }
        Some(frames)
    }
}

/// The index of a shard: offset and length of each of its `chunks` chunks, the last axis fastest; `None` for a chunk that is
/// not there.
pub(super) fn index(shard: &Shard, chunks: usize, coded: Vec<u8>) -> io::Result<Vec<Option<(u64, u64)>>> {
    let bytes = if shard.index_has_checksum { through(&Crc32cCodec::new(), coded, usize::MAX >> 1)? } else { coded };
    if bytes.len() != 16 * chunks {
        return Err(invalid(format!("its index has {} bytes instead of {}", bytes.len(), 16 * chunks)));
    }
    let word = |bytes: &[u8]| {
        let word = <[u8; 8]>::try_from(bytes).unwrap_or_default();
        match shard.index_order {
            ByteOrder::Little => u64::from_le_bytes(word),
            ByteOrder::Big => u64::from_be_bytes(word),
        }
    };
    let entry = |entry: &[u8]| match (word(&entry[..8]), word(&entry[8..])) {
        (u64::MAX, u64::MAX) => None,
        entry => Some(entry),
    };
    Ok(bytes.chunks_exact(16).map(entry).collect())
}

/// Bytes of the coded index of a shard of `chunks` chunks.
pub(super) fn index_bytes(shard: &Shard, chunks: usize) -> u64 {
    crate::stream::count(16 * chunks + if shard.index_has_checksum { 4 } else { 0 })
}
