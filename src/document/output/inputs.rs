//! Digest of the inputs of a picture in its file, by which a later run recognises what it need not make again.

use std::io::BufReader;
use std::path::Path;

use ::exr::block::{self, reader::ChunksReader};
use ::exr::meta::attribute::AttributeValue;

use super::PictureKind;
use relume_base::input;

/// Keyword of the text in a PNG, and name of the attribute in an OpenEXR file.
pub(super) const INPUTS: &str = "relumeInputs";

/// The digest of [`super::Picture::made_of`] in the picture file `path` of `size` (width, height). `None` for a file that
/// is missing, incomplete, damaged, of another size or made by another program.
#[must_use]
pub fn inputs_of(path: &Path, size: [usize; 2]) -> Option<u64> {
    let text = match PictureKind::of(path).ok()? {
        PictureKind::Png => of_png(path, size),
        PictureKind::Exr => of_exr(path, size),
    }?;
    u64::from_str_radix(&text, 16).ok()
}

/// Reads every pixel, so that a file cut short has no digest.
fn of_png(path: &Path, size: [usize; 2]) -> Option<String> {
    let mut reader = png::Decoder::new(BufReader::new(input::open(path).ok()?)).read_info().ok()?;
    let info = reader.info();
    if [info.width, info.height].map(|side| usize::try_from(side).ok()) != size.map(Some) {
        return None;
    }
    let text = info.uncompressed_latin1_text.iter().find(|text| text.keyword == INPUTS)?.text.clone();
    let mut pixels = vec![0; reader.output_buffer_size()?];
    reader.next_frame(&mut pixels).ok()?;
    reader.finish().ok()?;
    Some(text)
}

/// Reads every block, so that a file cut short has no digest.
fn of_exr(path: &Path, size: [usize; 2]) -> Option<String> {
    let reader = block::read(BufReader::new(input::open(path).ok()?), false).ok()?;
    let [header] = reader.headers() else { return None };
    if [header.layer_size.width(), header.layer_size.height()] != size {
        return None;
    }
    let named = |name: &&::exr::meta::attribute::Text| name.as_slice() == INPUTS.as_bytes();
    let (_, value) = header.own_attributes.other.iter().find(|(name, _)| named(name))?;
    let AttributeValue::Text(text) = value else { return None };
    let text = text.to_string();
    let blocks = reader.all_chunks(false).ok()?;
    blocks.decompress_sequential(false, |_, _| Ok(())).ok()?;
    Some(text)
}
