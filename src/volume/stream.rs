//! Byte streams of data files, with decompression and decoding.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use bzip2::bufread::MultiBzDecoder;
use flate2::CrcReader;
use flate2::bufread::{DeflateDecoder, MultiGzDecoder, ZlibDecoder};

use crate::VolumeError;
use relume_base::input;

/// Largest expansion by deflate: 1032 bytes per byte (a match of two bits yields 258 bytes).
pub(crate) const DEFLATE_LIMIT: u64 = 1032;

/// Largest number of bytes that a byte of baseline JPEG yields: two bits yield at most a block of 64 bytes, and the colour of
/// four of them.
pub(crate) const JPEG_LIMIT: u64 = 512;

/// Largest expansion by bzip2: a block is longer than 24 bytes, and holds at most 900 000 · 255 / 5 bytes.
const BZIP2_LIMIT: u64 = 1 << 21;

/// Position of the numbers in a file: encoded data begin `lines` lines after byte `at`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Start {
    /// Byte offset from which lines are counted.
    pub(crate) at: u64,
    /// Number of lines to skip.
    pub(crate) lines: u64,
    /// Part of the decoded data to skip.
    pub(crate) skip: Skip,
}

/// Part of the decoded bytes that is skipped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Skip {
    /// A number of bytes at the beginning.
    Bytes(u64),
    /// Everything before the numbers, which end the data.
    Tail,
}

impl Start {
    /// The numbers end the file.
    pub(crate) const TAIL: Self = Self { at: 0, lines: 0, skip: Skip::Tail };

    /// The numbers begin at byte `at`.
    pub(crate) const fn at(at: u64) -> Self {
        Self { at, lines: 0, skip: Skip::Bytes(0) }
    }
}

/// Encoding of the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Encoding {
    /// Binary, in some byte order.
    Raw,
    /// Binary, in one zlib stream; `said` is the number of compressed bytes stated in the header.
    Zlib { said: Option<u64> },
    /// Binary, in one deflate stream without a header; `crc` is the checksum of the decoded bytes.
    Deflate { crc: u32 },
    /// Binary, compressed with gzip.
    Gzip,
    /// Binary, compressed with bzip2.
    Bzip2,
    /// Binary, two hexadecimal digits per byte.
    Hex,
    /// Numbers separated by white space or commas.
    Text,
}

impl Encoding {
    /// Largest number of bytes per compressed byte; `None` if the encoding does not compress.
    pub(crate) fn packing(self) -> Option<u64> {
        match self {
            Self::Raw | Self::Hex | Self::Text => None,
            Self::Zlib { .. } | Self::Deflate { .. } | Self::Gzip => Some(DEFLATE_LIMIT),
            Self::Bzip2 => Some(BZIP2_LIMIT),
        }
    }

    /// Name of the encoding in errors about damaged data; `None` for raw bytes, which cannot be damaged, and for text.
    pub(crate) fn name(self) -> Option<&'static str> {
        match self {
            Self::Raw | Self::Text => None,
            Self::Zlib { .. } => Some("zlib"),
            Self::Deflate { .. } => Some("deflate"),
            Self::Gzip => Some("gzip"),
            Self::Bzip2 => Some("bzip2"),
            Self::Hex => Some("hex"),
        }
    }
}

/// Stream of decoded bytes.
pub(crate) enum Decoded {
    Raw(BufReader<File>),
    Zlib(ZlibDecoder<BufReader<File>>),
    Deflate(CrcReader<DeflateDecoder<BufReader<File>>>),
    Gzip(MultiGzDecoder<BufReader<File>>),
    Bzip2(MultiBzDecoder<BufReader<File>>),
    Hex(BufReader<File>),
}

impl Decoded {
    /// Number of compressed bytes read; `None` except for zlib.
    pub(crate) fn read_in(&self) -> Option<u64> {
        match self {
            Self::Zlib(stream) => Some(stream.total_in()),
            _ => None,
        }
    }

    /// Checksum of the bytes decoded so far; `None` except for deflate.
    pub(crate) fn checksum(&self) -> Option<u32> {
        match self {
            Self::Deflate(stream) => Some(stream.crc().sum()),
            _ => None,
        }
    }
}

impl Read for Decoded {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Raw(stream) => stream.read(bytes),
            Self::Zlib(stream) => stream.read(bytes),
            Self::Deflate(stream) => stream.read(bytes),
            Self::Gzip(stream) => stream.read(bytes),
            Self::Bzip2(stream) => stream.read(bytes),
            Self::Hex(stream) => read_hex(stream, bytes),
        }
    }
}

/// Opens the bytes of `path` from offset `start` on, decoded; text is not parsed.
pub(crate) fn decoded(path: &Path, start: u64, encoding: Encoding) -> Result<Decoded, VolumeError> {
    let stream = at(path, start)?;
    Ok(match encoding {
        Encoding::Raw | Encoding::Text => Decoded::Raw(stream),
        Encoding::Zlib { .. } => Decoded::Zlib(ZlibDecoder::new(stream)),
        Encoding::Deflate { .. } => Decoded::Deflate(CrcReader::new(DeflateDecoder::new(stream))),
        Encoding::Gzip => Decoded::Gzip(MultiGzDecoder::new(stream)),
        Encoding::Bzip2 => Decoded::Bzip2(MultiBzDecoder::new(stream)),
        Encoding::Hex => Decoded::Hex(stream),
    })
}

/// Opens a regular file; pipes, devices and folders are refused.
pub(crate) fn open(path: &Path) -> Result<File, VolumeError> {
    input::open(path).map_err(|source| VolumeError::Open { path: path.to_owned(), source })
}

/// Number of bytes examined to recognise a file.
const BEGINNING: u64 = 4096;

/// The first bytes of a file.
pub(crate) fn beginning(path: &Path) -> Result<Vec<u8>, VolumeError> {
    let mut bytes = Vec::new();
    let read = open(path)?.take(BEGINNING).read_to_end(&mut bytes);
    read.map_err(|source| failed(path, source))?;
    Ok(bytes)
}

/// Opens the bytes of `path` from offset `start` on.
pub(crate) fn at(path: &Path, start: u64) -> Result<BufReader<File>, VolumeError> {
    let mut stream = BufReader::with_capacity(1 << 16, open(path)?);
    stream.seek(SeekFrom::Start(start)).map_err(|source| failed(path, source))?;
    Ok(stream)
}

/// Returns the offset at which the encoded data of `path` begin, and the length of the file.
pub(crate) fn after_lines(path: &Path, start: Start) -> Result<(u64, u64), VolumeError> {
    let failed = |source| failed(path, source);
    let mut stream = at(path, start.at)?;
    let length = stream.get_ref().metadata().map_err(failed)?.len();
    let (mut begin, mut lines) = (start.at, 0);
    while lines < start.lines {
        let buffer = stream.fill_buf().map_err(failed)?;
        if buffer.is_empty() {
            break;
        }
        let end = buffer.iter().position(|&byte| byte == b'\n');
        lines += u64::from(end.is_some());
        let used = end.map_or(buffer.len(), |end| end + 1);
        stream.consume(used);
        begin += count(used);
    }
    Ok((begin.min(length), length))
}

pub(crate) fn failed(path: &Path, source: io::Error) -> VolumeError {
    VolumeError::Read { path: path.to_owned(), source }
}

/// Converts a count in memory to a count of bytes in a file; memory is never larger than 2⁶⁴ bytes.
pub(crate) fn count(number: usize) -> u64 {
    u64::try_from(number).unwrap_or(u64::MAX)
}

/// `PackBits`: runs of copied and of repeated bytes.
pub(crate) struct PackBits<'a> {
    packed: &'a [u8],
    run: Run,
}

/// Rest of a run.
#[derive(Clone, Copy)]
enum Run {
    Copy(usize),
    Repeat(u8, usize),
}

impl<'a> PackBits<'a> {
    pub(crate) fn new(packed: &'a [u8]) -> Self {
        Self { packed, run: Run::Copy(0) }
    }

    /// Fills `bytes` until the runs end; returns the number of bytes.
    pub(crate) fn fill(&mut self, bytes: &mut [u8]) -> usize {
        let mut filled = 0;
        while filled < bytes.len() {
            let room = bytes.len() - filled;
            match self.run {
                Run::Copy(0) | Run::Repeat(_, 0) => {
                    let Some((&head, rest)) = self.packed.split_first() else { break };
                    self.packed = rest;
                    self.run = match head {
                        0..=127 => Run::Copy(usize::from(head) + 1),
                        128 => Run::Copy(0),
                        129.. => {
                            let Some((&byte, rest)) = self.packed.split_first() else { break };
                            self.packed = rest;
                            Run::Repeat(byte, 257 - usize::from(head))
                        }
                    };
                }
                Run::Copy(left) => {
                    let part = left.min(room).min(self.packed.len());
                    if part == 0 {
                        break;
                    }
                    let (now, rest) = self.packed.split_at(part);
                    bytes[filled..filled + part].copy_from_slice(now);
                    self.packed = rest;
                    self.run = Run::Copy(left - part);
                    filled += part;
                }
                Run::Repeat(byte, left) => {
                    let part = left.min(room);
                    bytes[filled..filled + part].fill(byte);
                    self.run = Run::Repeat(byte, left - part);
                    filled += part;
                }
            }
        }
        filled
    }
}

impl Read for PackBits<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        Ok(self.fill(bytes))
    }
}

/// Fills `bytes` from pairs of hexadecimal digits, and ignores white space.
fn read_hex(stream: &mut impl BufRead, bytes: &mut [u8]) -> io::Result<usize> {
    let (mut filled, mut high) = (0, None);
    while filled < bytes.len() {
        let buffer = stream.fill_buf()?;
        if buffer.is_empty() {
            break;
        }
        let mut used = 0;
        for &byte in buffer {
            if filled == bytes.len() {
                break;
            }
            used += 1;
            if byte.is_ascii_whitespace() {
                continue;
            }
            let digit = char::from(byte).to_digit(16).and_then(|digit| u8::try_from(digit).ok());
            let wrong = || io::Error::other(format!("{:?} is not a hexadecimal digit", char::from(byte)));
            let digit = digit.ok_or_else(wrong)?;
            high = match high {
                None => Some(digit),
                Some(high) => {
                    bytes[filled] = high << 4 | digit;
                    filled += 1;
                    None
                }
            };
        }
        stream.consume(used);
    }
    Ok(filled)
}

/// Fills `bytes` until `stream` ends; returns the number of bytes read.
pub(crate) fn read_fully(stream: &mut dyn Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < bytes.len() {
        match stream.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            // A compressed stream that is truncated.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

/// Longest word that can be a number; longer words are cut, and then do not parse.
const LONGEST_WORD: usize = 400;

/// Reads the next word between white space or commas into `word`; `None` at the end.
pub(crate) fn next_word<'a>(stream: &mut dyn BufRead, word: &'a mut Vec<u8>) -> io::Result<Option<Cow<'a, str>>> {
    let parts = |byte: &u8| byte.is_ascii_whitespace() || *byte == b',';
    word.clear();
    loop {
        let buffer = stream.fill_buf()?;
        let blank = if word.is_empty() { buffer.iter().take_while(|byte| parts(byte)).count() } else { 0 };
        let rest = &buffer[blank..buffer.len().min(blank + LONGEST_WORD - word.len())];
        let length = rest.iter().position(parts).unwrap_or(rest.len());
        word.extend_from_slice(&rest[..length]);
        let ended = buffer.is_empty() || length < rest.len() || word.len() == LONGEST_WORD;
        stream.consume(blank + length);
        if ended {
            return Ok((!word.is_empty()).then(|| String::from_utf8_lossy(word)));
        }
    }
}
