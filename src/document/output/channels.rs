//! OpenEXR files with named f32 channels, written a few rows at a time.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use ::exr::block::writer::ChunksWriter;
use ::exr::block::{self, UncompressedBlock, enumerate_ordered_header_block_indices};
use ::exr::error::Error as ExrError;
use ::exr::math::Vec2;
use ::exr::meta::attribute::{AttributeValue, ChannelDescription, Chromaticities, LineOrder, SampleType, Text};
use ::exr::meta::header::Header;
use ::exr::meta::{BlockDescription, Headers};
use ::exr::prelude::Compression;

use super::picture::check_size;
use super::{OutputError, SOFTWARE, Sink, write_atomically};

/// Part of an OpenEXR file.
pub(super) struct Part<'a> {
    /// Name; none for a single part.
    pub(super) name: Option<&'a str>,
    /// Width and height in pixels.
    pub(super) size: (usize, usize),
    /// Channel names, in the order of the values.
    pub(super) channels: &'a [String],
    /// String attributes: names and values.
    pub(super) attributes: &'a [(&'a str, &'a str)],
}

impl Part<'_> {
    /// Order of the channels in the file, which must be sorted by name.
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.channels.len()).collect();
        order.sort_by_key(|&channel| self.channels[channel].as_bytes());
        order
    }

    fn header(&self) -> Header {
        let sorted = self.order().into_iter().map(|channel| ChannelDescription {
            name: text(&self.channels[channel]),
            sample_type: SampleType::F32,
            quantize_linearly: false,
            sampling: Vec2(1, 1),
        });
        let mut header = Header::new(text(self.name.unwrap_or_default()), self.size, sorted.collect()).with_encoding(
            Compression::ZIP16,
            BlockDescription::ScanLines,
            LineOrder::Increasing,
        );
        header.own_attributes.layer_name = self.name.map(text);
        header.own_attributes.software_name = Some(text(SOFTWARE));
        // The `exr` crate writes a map in the order of its random hashes. Equal films should be equal files, so maps are made
        // until one has the order of the list.
        header.own_attributes.other = loop {
            let entries = self.attributes.iter().map(|&(name, value)| (text(name), AttributeValue::Text(text(value))));
            let map = entries.collect::<HashMap<_, _>>();
            if map.keys().zip(self.attributes).all(|(key, &(name, _))| *key == text(name)) {
                break map;
            }
        };
        header.shared_attributes.chromaticities = Some(SRGB);
        header
    }
}

/// Destination of an OpenEXR file.
#[derive(Debug)]
pub(super) enum Target<'a> {
    /// A file, by [`write_atomically`].
    File(&'a Path),
    /// Memory, after what it holds.
    Memory(&'a mut Vec<u8>),
}

impl Target<'_> {
    fn fill(self, fill: impl FnOnce(&mut dyn Sink) -> io::Result<()>) -> Result<(), OutputError> {
        match self {
            Self::File(path) => write_atomically(path, fill),
            Self::Memory(bytes) => {
                let mut sink = io::Cursor::new(Vec::new());
                fill(&mut sink).map_err(|source| OutputError::Write { path: PathBuf::from("memory"), source })?;
                bytes.append(sink.get_mut());
                Ok(())
            }
        }
    }
}

/// Writes an OpenEXR file with 32-bit float channels in scan lines, compressed by zlib in blocks of sixteen lines.
///
/// `rows(part, y, data)` is called from the top of each of `parts` down, and fills `data` with the rows from `y` on:
/// row by row, within a row channel by channel in the order of the part, within a channel from left to right.
/// Attributes and names are stored as UTF-8. The display window of the file is that of the first part.
///
/// # Errors
///
/// [`OutputError::Size`], and those of [`write_atomically`].
pub(super) fn write(
    target: Target<'_>,
    parts: &[Part<'_>],
    mut rows: impl FnMut(usize, usize, &mut [f32]),
) -> Result<(), OutputError> {
    for part in parts {
        check_size(part.size.0, part.size.1)?;
    }
    let mut headers: Headers = parts.iter().map(Part::header).collect();
    if let Some(shared) = headers.first().map(|header| header.shared_attributes.clone()) {
        headers.iter_mut().for_each(|header| header.shared_attributes = shared.clone());
    }
    let orders: Vec<Vec<usize>> = parts.iter().map(Part::order).collect();
    target.fill(|sink| {
        block::write(sink, headers, true, |meta, writer| {
            let mut given = Vec::new();
            let blocks = enumerate_ordered_header_block_indices(&meta.headers).map(|(index, block)| {
                let (width, order) = (parts[block.layer].size.0, &orders[block.layer]);
                let row = width * order.len();
                given.clear();
                given.resize(block.pixel_size.height() * row, f32::NAN);
                rows(block.layer, block.pixel_position.y(), &mut given);
                let mut data = Vec::with_capacity(given.len() * size_of::<f32>());
                for line in given.chunks_exact(row) {
                    for &channel in order {
                        let values = &line[channel * width..][..width];
                        data.extend_from_slice(bytemuck::cast_slice(values));
                    }
                }
                (index, UncompressedBlock { index: block, data })
            });
            // `on_progress` only borrows the writer, which the compressor would consume.
            writer.on_progress(|_| ()).compress_all_blocks_parallel(&meta, blocks)
        })
        .map_err(|error| match error {
            ExrError::Io(error) => error,
            other => io::Error::other(other.to_string()),
        })
    })
}

/// Primaries and white point of sRGB (ITU-R BT.709-6, table 1).
const SRGB: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Bytes of `string`, unchanged.
pub(super) fn text(string: &str) -> Text {
    Text::from_slice_unchecked(string.as_bytes())
}
