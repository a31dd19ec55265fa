//! Decoding of an array's bytes from base64 and compressed blocks.

use std::io::{self, BufRead, Read};

use base64::Engine as _;
use base64::alphabet;
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use flate2::{Decompress, FlushDecompress, Status};

use crate::layout::ByteOrder;
use crate::stream::{DEFLATE_LIMIT, count};

/// Compression method of the blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Compressor {
    /// One zlib stream per block.
    Zlib,
    /// Bare LZ4 blocks.
    Lz4,
    /// One xz stream per block.
    Lzma,
}

/// Memory limit of an xz decoder in bytes; the largest preset takes 65 MiB.
const LZMA_MEMORY: u64 = 72 << 20;

impl Compressor {
    pub(super) const ALL: [Self; 3] = [Self::Zlib, Self::Lz4, Self::Lzma];

    /// VTK's class name.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Zlib => "vtkZLibDataCompressor",
            Self::Lz4 => "vtkLZ4DataCompressor",
            Self::Lzma => "vtkLZMADataCompressor",
        }
    }

    pub(super) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|compressor| compressor.name() == name)
    }

    /// Largest expansion, in bytes per compressed byte.
    pub(super) fn limit(self) -> u64 {
        match self {
            Self::Zlib => DEFLATE_LIMIT,
            // One byte of a length adds up to 255.
            Self::Lz4 => 255,
            // A match of 273 bytes takes 14 decisions of at least log₂(2048/2017) bits.
            Self::Lzma => 7200,
        }
    }

    /// Decodes a block, which must have exactly `block.len()` bytes.
    fn decode(self, packed: &[u8], block: &mut [u8], inflater: &mut Decompress) -> io::Result<()> {
        let decoded = match self {
            Self::Zlib => {
                inflater.reset(true);
                let status = inflater.decompress(packed, block, FlushDecompress::Finish).map_err(io::Error::other)?;
                if status != Status::StreamEnd {
                    return Err(wrong(format!("it continues beyond the expected {} bytes", block.len())));
                }
                inflater.total_out()
            }
            Self::Lz4 => count(lz4_flex::block::decompress_into(packed, block).map_err(io::Error::other)?),
            Self::Lzma => {
                let stream = liblzma::stream::Stream::new_stream_decoder(LZMA_MEMORY, 0).map_err(io::Error::other)?;
                let mut decoder = liblzma::read::XzDecoder::new_stream(packed, stream);
                decoder.read_exact(block)?;
                if decoder.read(&mut [0])? > 0 {
                    return Err(wrong(format!("it continues beyond the expected {} bytes", block.len())));
                }
                decoder.total_out()
            }
        };
        if decoded != count(block.len()) {
            return Err(wrong(format!("it has {decoded} bytes instead of {}", block.len())));
        }
        Ok(())
    }
}

/// The error for invalid bytes of a file.
pub(super) fn wrong(problem: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, problem)
}

/// Format of the header words before the values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Words {
    pub(super) wide: bool,
    pub(super) byte_order: ByteOrder,
}

impl Words {
    /// Bytes per word.
    pub(super) fn bytes(self) -> u64 {
        if self.wide { 8 } else { 4 }
    }

    /// Reads the next word of `stream`.
    pub(super) fn next(self, stream: &mut impl Read) -> io::Result<u64> {
        let mut bytes = [0; 8];
        let word = if self.wide { &mut bytes[..] } else { &mut bytes[..4] };
        stream.read_exact(word).map_err(|error| match error.kind() {
            io::ErrorKind::UnexpectedEof => wrong("the data end within the header of the values".to_owned()),
            _ => error,
        })?;
        if self.byte_order == ByteOrder::Big {
            word.reverse();
        }
        Ok(u64::from_le_bytes(bytes))
    }
}

/// Reader that ends at the next tag.
pub(super) struct UntilTag<R> {
    stream: R,
    /// Bytes of the buffer known to be before the next tag; cached, because words are short and buffers are long.
    text: usize,
}

impl<R> UntilTag<R> {
    pub(super) fn new(stream: R) -> Self {
        Self { stream, text: 0 }
    }
}

impl<R: BufRead> Read for UntilTag<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(bytes)?;
        self.consume(read);
        Ok(read)
    }
}

impl<R: BufRead> BufRead for UntilTag<R> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        let buffer = self.stream.fill_buf()?;
        if self.text == 0 {
            self.text = memchr::memchr(b'<', buffer).unwrap_or(buffer.len());
        }
        Ok(&buffer[..self.text])
    }

    fn consume(&mut self, amount: usize) {
        self.text -= amount;
        self.stream.consume(amount);
    }
}

/// Number of characters decoded at once; a multiple of four.
const CHARACTERS: usize = 1 << 14;

/// Requires canonical padding, but ignores spare bits, as VTK does.
const BASE64: GeneralPurpose = GeneralPurpose::new(
    &alphabet::STANDARD,
    GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::RequireCanonical)
        .with_decode_allow_trailing_bits(true),
);

/// Base64 decoder. Padding ends a group, not the data: VTK pads the table of blocks separately.
pub(super) struct Base64<R> {
    text: R,
    characters: Vec<u8>,
    decoded: Vec<u8>,
    at: usize,
}

/// Number of characters before the first white space or padding.
fn plain(characters: &[u8]) -> usize {
    let special = |byte: u8| byte.is_ascii_whitespace() || byte == b'=';
    // Groups without a branch per character, which is several times faster.
    let groups =
        characters.chunks_exact(32).take_while(|group| !group.iter().fold(false, |any, &byte| any | special(byte)));
    let whole = groups.count() * 32;
    whole + characters[whole..].iter().take_while(|&&byte| !special(byte)).count()
}

impl<R: BufRead> Base64<R> {
    pub(super) fn new(text: R) -> Self {
        Self { text, characters: Vec::with_capacity(CHARACTERS), decoded: vec![0; CHARACTERS / 4 * 3], at: usize::MAX }
    }

    /// Decodes the next characters, up to the next padding. If the buffer stays empty, the text has ended.
    fn refill(&mut self) -> io::Result<()> {
        self.characters.clear();
        let mut padded = false;
        while self.characters.len() < CHARACTERS && !padded {
            let buffer = self.text.fill_buf()?;
            if buffer.is_empty() {
                break;
            }
            let wanted = &buffer[..buffer.len().min(CHARACTERS - self.characters.len())];
            let plain = plain(wanted);
            self.characters.extend_from_slice(&wanted[..plain]);
            let mut used = plain;
            if let Some(&byte) = wanted.get(plain) {
                used += 1;
                if byte == b'=' {
                    self.characters.push(byte);
                    padded = self.characters.len().is_multiple_of(4);
                }
            }
            self.text.consume(used);
        }
        self.decoded.resize(CHARACTERS / 4 * 3, 0);
        let length = BASE64.decode_slice(&self.characters, &mut self.decoded);
        let length = length.map_err(|error| wrong(format!("invalid base64: {error}")))?;
        self.decoded.truncate(length);
        self.at = 0;
        Ok(())
    }
}

impl<R: BufRead> Read for Base64<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.at >= self.decoded.len() {
            self.refill()?;
        }
        let read = (&self.decoded[self.at..]).read(bytes)?;
        self.at += read;
        Ok(read)
    }
}

/// Decoder of compressed blocks.
pub(super) struct Blocks<R> {
    packed: R,
    compressor: Compressor,
    inflater: Decompress,
    /// Compressed size of each remaining block, last block first.
    sizes: Vec<u64>,
    /// Total number of blocks.
    number: u64,
    /// Decoded bytes of a full block.
    full: u64,
    /// Bytes still to decode.
    left: u64,
    input: Vec<u8>,
    block: Vec<u8>,
    at: usize,
}

impl<R: Read> Blocks<R> {
    /// Reads the table of blocks. The blocks must decode to `expected` bytes and fit into `there` compressed bytes.
    pub(super) fn new(
        mut packed: R,
        compressor: Compressor,
        words: Words,
        expected: u64,
        there: u64,
    ) -> io::Result<Self> {
        let [number, full, partial] = [words.next(&mut packed)?, words.next(&mut packed)?, words.next(&mut packed)?];
        let last = if partial == 0 { full } else { partial };
        let before = number.checked_sub(1).and_then(|blocks| blocks.checked_mul(full));
        if before.and_then(|before| before.checked_add(last)) != Some(expected) || last > full {
            return Err(wrong(format!(
                "{number} blocks of {full} bytes, the last of {last}, do not add up to the {expected} bytes of its extent"
            )));
        }
        // The table takes eight bytes per block in memory, and must not exceed the values.
        if number > expected / 8 + (1 << 16) || number.saturating_mul(words.bytes()) > there {
            return Err(wrong(format!(
                "{number} blocks of {full} bytes are too many for {expected} bytes of values in {there} stored bytes"
            )));
        }
        let mut sizes = Vec::new();
        let mut sum = 0_u64;
        for index in 0..number {
            let size = words.next(&mut packed)?;
            let block = if index + 1 == number { last } else { full };
            // Incompressible data grow only slightly.
            if size.saturating_mul(compressor.limit()) < block || size > block.saturating_add(block / 8 + 1024) {
                return Err(wrong(format!(
                    "block {index}: {size} compressed bytes are impossible for {block} bytes of values"
                )));
            }
            sum = sum.saturating_add(size);
            sizes.push(size);
        }
        let left = there.saturating_sub((number + 3).saturating_mul(words.bytes()));
        if sum > left {
            return Err(wrong(format!("its blocks take {sum} compressed bytes, but the file has only {left}")));
        }
        sizes.reverse();
        Ok(Self {
            packed,
            compressor,
            inflater: Decompress::new(true),
            sizes,
            number,
            full,
            left: expected,
            input: Vec::new(),
            block: Vec::new(),
            at: 0,
        })
    }

    /// Decodes the next block of `block.len()` bytes.
    fn decode(&mut self, block: &mut [u8]) -> io::Result<()> {
        let index = self.number - count(self.sizes.len());
        let size = self.sizes.pop().unwrap_or_default();
        resize(&mut self.input, size)?;
        self.packed.read_exact(&mut self.input)?;
        self.left -= count(block.len());
        let decoded = self.compressor.decode(&self.input, block, &mut self.inflater);
        decoded.map_err(|error| wrong(format!("block {index}: {error}")))
    }
}

/// Compressed blocks in memory; decoding them without storing the result is the baseline for reading a file.
#[derive(Debug)]
pub struct PackedBlocks {
    compressor: Compressor,
    /// The compressed bytes of each block, and its decoded size.
    blocks: Vec<(Vec<u8>, usize)>,
}

impl PackedBlocks {
    pub(super) fn new(compressor: Compressor) -> Self {
        Self { compressor, blocks: Vec::new() }
    }

    /// Appends all of `blocks`, still compressed.
    pub(super) fn add(&mut self, mut blocks: Blocks<impl Read>) -> io::Result<()> {
        while let Some(size) = blocks.sizes.pop() {
            let mut packed = Vec::new();
            resize(&mut packed, size)?;
            blocks.packed.read_exact(&mut packed)?;
            let next = blocks.left.min(blocks.full);
            blocks.left -= next;
            self.blocks.push((packed, usize::try_from(next).unwrap_or(usize::MAX)));
        }
        Ok(())
    }

    /// Compression method: "zlib", "lz4" or "lzma".
    #[must_use]
    pub fn compression(&self) -> &'static str {
        match self.compressor {
            Compressor::Zlib => "zlib",
            Compressor::Lz4 => "lz4",
            Compressor::Lzma => "lzma",
        }
    }

    /// Decodes all blocks into one reused buffer; returns the total number of decoded bytes.
    ///
    /// # Errors
    ///
    /// A damaged block, or not enough memory for a block.
    pub fn decode(&self) -> io::Result<usize> {
        let (mut inflater, mut place, mut all) = (Decompress::new(true), Vec::new(), 0);
        for (packed, bytes) in &self.blocks {
            resize(&mut place, count(*bytes))?;
            self.compressor.decode(packed, &mut place, &mut inflater)?;
            all += bytes;
        }
        Ok(all)
    }
}

/// Resizes `buffer` to exactly `size` bytes.
fn resize(buffer: &mut Vec<u8>, size: u64) -> io::Result<()> {
    let size = usize::try_from(size).unwrap_or(usize::MAX);
    if size > buffer.len() {
        buffer.try_reserve_exact(size - buffer.len()).map_err(|_| io::Error::from(io::ErrorKind::OutOfMemory))?;
    }
    buffer.resize(size, 0);
    Ok(())
}

impl<R: Read> Read for Blocks<R> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if self.at == self.block.len() && !bytes.is_empty() && self.left > 0 {
            let next = self.left.min(self.full);
            // A block that fits is decoded directly into the caller's buffer.
            if let Some(place) = usize::try_from(next).ok().and_then(|next| bytes.get_mut(..next)) {
                let read = place.len();
                self.decode(place)?;
                return Ok(read);
            }
            let mut block = std::mem::take(&mut self.block);
            resize(&mut block, next)?;
            self.decode(&mut block)?;
            (self.block, self.at) = (block, 0);
        }
        let read = (&self.block[self.at..]).read(bytes)?;
        self.at += read;
        Ok(read)
    }
}
