//! OpenEXR files of named f32 channels, written a few rows at a time.

use std::collections::HashMap;
use std::io;
use std::path::Path;

use ::exr::block::writer::ChunksWriter;
use ::exr::block::{self, UncompressedBlock, enumerate_ordered_header_block_indices};
use ::exr::error::Error as ExrError;
use ::exr::math::Vec2;
use ::exr::meta::BlockDescription;
use ::exr::meta::attribute::{AttributeValue, ChannelDescription, Chromaticities, LineOrder, SampleType, Text};
use ::exr::meta::header::Header;
use ::exr::prelude::Compression;

use super::picture::check_size;
use super::{OutputError, SOFTWARE, write_atomically};

/// Writes an OpenEXR file of one part: 32-bit float channels in scan lines, compressed by zlib sixteen lines at a time.
///
/// `rows(y, count, data)` is called from the top of the picture on and fills `data` with the rows `y` to `y + count`:
/// row by row, in each the channels in the order of `names`, in each its `width` values. `attributes` are strings;
/// their text and the names are stored as UTF-8.
///
/// # Errors
///
/// [`OutputError::Size`], and those of [`write_atomically`].
pub(super) fn write(
    path: &Path,
    (width, height): (usize, usize),
    names: &[String],
    attributes: &[(&str, &str)],
    mut rows: impl FnMut(usize, usize, &mut [f32]),
) -> Result<(), OutputError> {
    check_size(width, height)?;
    // The file wants its channels in the order of their names.
    let mut order: Vec<usize> = (0..names.len()).collect();
    order.sort_by_key(|&channel| names[channel].as_bytes());
    let sorted = order.iter().map(|&channel| ChannelDescription {
        name: text(&names[channel]),
        sample_type: SampleType::F32,
        quantize_linearly: false,
        sampling: Vec2(1, 1),
    });
    let mut header = Header::new(text(""), (width, height), sorted.collect()).with_encoding(
        Compression::ZIP16,
        BlockDescription::ScanLines,
        LineOrder::Increasing,
    );
    header.own_attributes.layer_name = None;
    header.own_attributes.software_name = Some(text(SOFTWARE));
    header.own_attributes.other = attributes
        .iter()
        .map(|&(name, value)| (text(name), AttributeValue::Text(text(value))))
        .collect::<HashMap<_, _>>();
    header.shared_attributes.chromaticities = Some(SRGB);
    let row = width * names.len();
    write_atomically(path, |sink| {
        block::write(sink, std::iter::once(header).collect(), true, |meta, writer| {
            let mut given = Vec::new();
            let blocks = enumerate_ordered_header_block_indices(&meta.headers).map(|(index, block)| {
                let (first, count) = (block.pixel_position.y(), block.pixel_size.height());
                given.resize(count * row, f32::NAN);
                rows(first, count, &mut given);
                let mut data = Vec::with_capacity(count * row * size_of::<f32>());
                for line in given.chunks_exact(row) {
                    for &channel in &order {
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

/// The primaries and the white of sRGB (ITU-R BT.709-6, table 1).
const SRGB: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// The bytes of `string`, unchanged.
pub(super) fn text(string: &str) -> Text {
    Text::from_slice_unchecked(string.as_bytes())
}
