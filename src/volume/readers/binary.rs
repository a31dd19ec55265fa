//! Numbers at byte offsets of a binary header, and its decompression.

use std::path::Path;

use flate2::bufread::MultiGzDecoder;

use crate::stream::{self, Encoding};
use crate::{ByteOrder, VolumeError};

/// The first bytes of gzip.
const GZIP: [u8; 2] = [0x1f, 0x8b];

/// Numbers at byte offsets; beyond the end of `bytes` they are 0.
pub(crate) struct Numbers<'a> {
    pub(crate) bytes: &'a [u8],
    pub(crate) byte_order: ByteOrder,
}

impl Numbers<'_> {
    /// `N` bytes from offset `at` on, in little-endian order.
    fn little<const N: usize>(&self, at: usize) -> [u8; N] {
        let mut bytes = std::array::from_fn(|i| self.bytes.get(at + i).copied().unwrap_or(0));
        if self.byte_order == ByteOrder::Big {
            bytes.reverse();
        }
        bytes
    }

    pub(crate) fn u8(&self, at: usize) -> u8 {
        u8::from_le_bytes(self.little(at))
    }

    pub(crate) fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.little(at))
    }

    pub(crate) fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.little(at))
    }

    pub(crate) fn i64(&self, at: usize) -> i64 {
        i64::from_le_bytes(self.little(at))
    }

    pub(crate) fn f32(&self, at: usize) -> f64 {
        f32::from_le_bytes(self.little(at)).into()
    }

    pub(crate) fn f64(&self, at: usize) -> f64 {
        f64::from_le_bytes(self.little(at))
    }

    /// Text of at most `length` bytes up to a zero, without white space around it; `None` if it is empty.
    pub(crate) fn text(&self, at: usize, length: usize) -> Option<String> {
        let bytes = self.bytes.get(at..at + length)?;
        let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(length);
        let text = String::from_utf8_lossy(&bytes[..end]).trim().to_owned();
        (!text.is_empty()).then_some(text)
    }
}

/// The first `length` bytes that a file holds, decompressed if its `beginning` is gzip.
pub(crate) fn inside(beginning: &[u8], length: usize) -> Vec<u8> {
    if !beginning.starts_with(&GZIP) {
        return beginning[..beginning.len().min(length)].to_vec();
    }
    let mut bytes = vec![0; length];
    // The compressed stream is cut, so a later error means nothing.
    let there = stream::read_fully(&mut MultiGzDecoder::new(beginning), &mut bytes).unwrap_or(0);
    bytes.truncate(there);
    bytes
}

/// The first `length` bytes of a file, or fewer if it is shorter, decompressed; and how they are compressed.
pub(crate) fn beginning(path: &Path, length: usize) -> Result<(Vec<u8>, Encoding), VolumeError> {
    let mut mark = [0; 2];
    stream::read_fully(&mut stream::open(path)?, &mut mark).map_err(|source| stream::failed(path, source))?;
    let encoding = if mark == GZIP { Encoding::Gzip } else { Encoding::Raw };
    let mut bytes = vec![0; length];
    let mut stream = stream::decoded(path, 0, encoding)?;
    let there = stream::read_fully(&mut stream, &mut bytes).map_err(|source| match encoding.name() {
        Some(encoding) => VolumeError::Inflate { path: path.to_owned(), encoding, decoded: 0, source },
        None => stream::failed(path, source),
    })?;
    bytes.truncate(there);
    Ok((bytes, encoding))
}
