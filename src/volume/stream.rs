//! Bytes of a data file, as they were before they were encoded.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use bzip2::bufread::MultiBzDecoder;
use flate2::bufread::{MultiGzDecoder, ZlibDecoder};

use super::VolumeError;

/// Deflate packs at most 1032 bytes into one (258 bytes into a match of two bits).
pub(super) const DEFLATE_LIMIT: u64 = 1032;

/// A block of bzip2 is longer than 24 bytes, and holds at most 900 000 · 255 / 5 bytes.
const BZIP2_LIMIT: u64 = 1 << 21;

/// Where the numbers of a file begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Start {
    /// So many bytes after the beginning,
    pub(super) at: u64,
    /// and then so many lines later,
    pub(super) lines: u64,
    /// something encoded begins; what of it is left out, decoded.
    pub(super) skip: Skip,
}

/// What is left out of decoded bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Skip {
    /// So many at the beginning.
    Bytes(u64),
    /// All but as many at the end as there are numbers.
    Tail,
}

impl Start {
    /// Just the numbers end the file.
    pub(super) const TAIL: Self = Self { at: 0, lines: 0, skip: Skip::Tail };

    /// So many bytes after the beginning.
    pub(super) const fn at(at: u64) -> Self {
        Self { at, lines: 0, skip: Skip::Bytes(0) }
    }
}

/// How numbers are written down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// As they lie in memory, in some byte order.
    Raw,
    /// The same, as one zlib stream; `said` is the number of compressed bytes the header claims.
    Zlib { said: Option<u64> },
    /// The same, by gzip.
    Gzip,
    /// The same, by bzip2.
    Bzip2,
    /// The same, two hexadecimal digits a byte.
    Hex,
    /// As numbers between white space or commas.
    Text,
}

impl Encoding {
    /// How many bytes one compressed byte can hold at most, where they are compressed.
    pub(super) fn packing(self) -> Option<u64> {
        match self {
            Self::Raw | Self::Hex | Self::Text => None,
            Self::Zlib { .. } | Self::Gzip => Some(DEFLATE_LIMIT),
            Self::Bzip2 => Some(BZIP2_LIMIT),
        }
    }

    /// What damaged data of this kind are called; raw bytes cannot be damaged.
    pub(super) fn name(self) -> Option<&'static str> {
        match self {
            Self::Raw | Self::Text => None,
            Self::Zlib { .. } => Some("zlib"),
            Self::Gzip => Some("gzip"),
            Self::Bzip2 => Some("bzip2"),
            Self::Hex => Some("hex"),
        }
    }
}

/// Decoded bytes.
pub(super) enum Decoded {
    Raw(BufReader<File>),
    Zlib(ZlibDecoder<BufReader<File>>),
    Gzip(MultiGzDecoder<BufReader<File>>),
    Bzip2(MultiBzDecoder<BufReader<File>>),
    Hex(BufReader<File>),
}

impl Decoded {
    /// How many compressed bytes were read, where that can be told.
    pub(super) fn read_in(&self) -> Option<u64> {
        match self {
            Self::Zlib(stream) => Some(stream.total_in()),
            _ => None,
        }
    }
}

impl Read for Decoded {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Raw(stream) => stream.read(bytes),
            Self::Zlib(stream) => stream.read(bytes),
            Self::Gzip(stream) => stream.read(bytes),
            Self::Bzip2(stream) => stream.read(bytes),
            Self::Hex(stream) => read_hex(stream, bytes),
        }
    }
}

/// The bytes of `path` from `start` on, decoded; not of text.
pub(super) fn decoded(path: &Path, start: u64, encoding: Encoding) -> Result<Decoded, VolumeError> {
    let stream = at(path, start)?;
    Ok(match encoding {
        Encoding::Raw | Encoding::Text => Decoded::Raw(stream),
        Encoding::Zlib { .. } => Decoded::Zlib(ZlibDecoder::new(stream)),
        Encoding::Gzip => Decoded::Gzip(MultiGzDecoder::new(stream)),
        Encoding::Bzip2 => Decoded::Bzip2(MultiBzDecoder::new(stream)),
        Encoding::Hex => Decoded::Hex(stream),
    })
}

/// Opens a regular file. All others are refused: a pipe would wait for ever, a device would never end.
pub(super) fn open(path: &Path) -> Result<File, VolumeError> {
    let failed = |source| VolumeError::Open { path: path.to_owned(), source };
    // Before it is opened, because opening a pipe waits for somebody to write.
    let metadata = std::fs::metadata(path).map_err(failed)?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a folder" } else { "a pipe, a socket or a device" };
        return Err(failed(io::Error::other(format!("this is {what}, not a file"))));
    }
    File::open(path).map_err(failed)
}

/// The bytes of `path` from `start` on.
pub(super) fn at(path: &Path, start: u64) -> Result<BufReader<File>, VolumeError> {
    let mut stream = BufReader::with_capacity(1 << 16, open(path)?);
    stream.seek(SeekFrom::Start(start)).map_err(|source| failed(path, source))?;
    Ok(stream)
}

/// Where something encoded begins in `path`, and how long the file is.
pub(super) fn after_lines(path: &Path, start: Start) -> Result<(u64, u64), VolumeError> {
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

pub(super) fn failed(path: &Path, source: io::Error) -> VolumeError {
    VolumeError::Read { path: path.to_owned(), source }
}

/// A number of things in memory as a number of bytes of a file; memory is never larger than 2⁶⁴.
pub(super) fn count(number: usize) -> u64 {
    u64::try_from(number).unwrap_or(u64::MAX)
}

/// Fills `bytes` from pairs of hexadecimal digits, with white space anywhere.
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
            let wrong = || io::Error::other(format!("{:?} is no hexadecimal digit", char::from(byte)));
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

/// Fills `bytes` as far as `stream` goes, and says how far that was.
pub(super) fn read_fully(stream: &mut dyn Read, bytes: &mut [u8]) -> io::Result<usize> {
    let mut filled = 0;
    while filled < bytes.len() {
        match stream.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(read) => filled += read,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            // A compressed stream that stops in the middle.
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => break,
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

/// The longest word that can be a number; longer ones are cut, and then are none.
const LONGEST_WORD: usize = 400;

/// The next run of bytes between white space or commas, which `word` is to hold; `None` at the end.
pub(super) fn next_word<'a>(stream: &mut dyn BufRead, word: &'a mut Vec<u8>) -> io::Result<Option<Cow<'a, str>>> {
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
