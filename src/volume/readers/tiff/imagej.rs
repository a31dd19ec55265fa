//! The description that `ImageJ` and SCIFIO write into the first page: lines of `key=value`.
//!
//! Meanings follow `ij.io.FileSaver`, `ij.io.FileOpener` and `ij.io.TiffEncoder` of `ImageJ` 1.

use super::directory::{Directory, Tiff, tag};
use super::stated::Stated;
use crate::readers::lengths::{printable, unit};
use crate::{Unit, VolumeError, Window};

/// Bytes of a description that are interpreted.
const LONGEST: usize = 1 << 20;

/// Largest number of further keys that are kept.
const MOST_KEYS: usize = 64;

/// Keys that are interpreted.
const KNOWN: [&str; 24] = [
    "ImageJ",
    "SCIFIO",
    "images",
    "channels",
    "slices",
    "frames",
    "unit",
    "yunit",
    "zunit",
    "spacing",
    "min",
    "max",
    "cf",
    "c0",
    "c1",
    "scales",
    "units",
    "axes",
    "lengths",
    "hyperstack",
    "mode",
    "loop",
    "bitsPerPixel",
    "vunit",
];

/// Code of the linear calibration of values.
const LINEAR: &str = "0";

/// Name of the display ranges among `ImageJ`'s own metadata: "rang".
const RANGES: u64 = 0x7261_6e67;

/// Name of the colour maps among them: "luts".
const MAPS: u64 = 0x6c75_7473;

/// Entries of a colour map, each with a red, a green and a blue part.
const ENTRIES: usize = 256;

/// Most channels of which colour maps are read.
const MOST_MAPS: usize = 1 << 10;

/// What `ImageJ` states in tags of its own.
#[derive(Debug, Default)]
pub(super) struct Own {
    /// Lowest and highest number of each channel.
    ranges: Vec<f64>,
    /// Colour of the largest number of each channel, `#rrggbb`.
    colours: Vec<String>,
}

/// Whether a description is one of `ImageJ` or SCIFIO.
pub(super) fn recognises(description: &[u8]) -> bool {
    description.starts_with(b"ImageJ=") || description.starts_with(b"SCIFIO=")
}

/// Interprets `description`. Returns the number of images, `pages` if it is not stated, and what is stated of them; the sizes
/// of the axes are as many images. `resolution` has the pixels per unit along x and y, and the code of the unit; `own` has the
/// display ranges and colours of the channels.
pub(super) fn read(
    description: &[u8],
    pages: usize,
    resolution: ([Option<f64>; 2], u64),
    own: &Own,
) -> (usize, Stated) {
    let description = &description[..description.len().min(LONGEST)];
    let text = match std::str::from_utf8(description) {
        Ok(text) => text.to_owned(),
        // Latin-1.
        Err(_) => description.iter().map(|&byte| char::from(byte)).collect(),
    };
    let pairs: Vec<(&str, &str)> =
        text.lines().filter_map(|line| line.trim_end_matches('\0').split_once('=')).collect();
    let find = |key: &str| pairs.iter().find(|(name, _)| *name == key).map(|(_, value)| value.trim());
    let whole = |key: &str| find(key).and_then(|value| value.parse::<usize>().ok()).filter(|&number| number > 0);
    let number = |key: &str| find(key).and_then(|value| value.parse::<f64>().ok()).filter(|number| number.is_finite());
    let mut stated = Stated::default();
    let images = whole("images").unwrap_or(pages);
    let [channels, slices, frames] = ["channels", "slices", "frames"].map(whole);
    let (channels, frames) = (channels.unwrap_or(1), frames.unwrap_or(1));
    stated.sizes = [slices.unwrap_or(1), channels, frames];
    let others = channels.saturating_mul(frames);
    if stated.sizes[0].saturating_mul(others) != images {
        if slices.is_none() && images.is_multiple_of(others) {
            stated.sizes[0] = images / others;
        } else {
            stated.notes.push(format!(
                "ImageJ's description states {images} images, but {channels} channels of {} slices at {frames} times; all \
                 images are taken as slices",
                stated.sizes[0]
            ));
            stated.sizes = [images, 1, 1];
        }
    }
    spacing(&mut stated, &find, resolution);
    if let Some(depth) = number("spacing")
        && stated.spacing[2].is_none()
    {
        let name = find("zunit").or(find("unit")).map(unescaped);
        // A negative distance states that the first slice is the last.
        stated.set_spacing(2, depth.abs(), name.and_then(|name| unit(&name)));
    }
    if find("cf") == Some(LINEAR) {
        if let (Some(intercept), Some(slope)) = (number("c0"), number("c1"))
            && slope != 0.0
        {
            stated.scale = Some([slope, intercept]);
        }
    } else if let Some(function) = find("cf") {
        let function = printable(function);
        stated
            .notes
            .push(format!("ImageJ's calibration function {function} of the values is not applied; it applies 0"));
    }
    let [slope, intercept] = stated.scale.unwrap_or([1.0, 0.0]);
    // The limits are stored numbers.
    let window = |low: f64, high: f64| {
        let ends = [low, high].map(|end| end.mul_add(slope, intercept));
        Window::new("window of the file", ends[0].min(ends[1]), ends[0].max(ends[1]))
    };
    stated.windows = own.ranges.as_chunks().0.iter().map(|&[low, high]| window(low, high)).collect();
    if stated.windows.is_empty()
        && let (Some(low), Some(high)) = (number("min"), number("max"))
    {
        stated.windows.push(window(low, high));
    }
    let unknown = pairs.iter().filter(|(key, _)| !KNOWN.contains(key)).take(MOST_KEYS);
    stated.metadata = unknown.map(|(key, value)| (printable(key), printable(value))).collect();
    // A file without channels may have a map for its one picture.
    for (index, colour) in own.colours.iter().take(channels).enumerate() {
        stated.metadata.push((format!("colour of channel {index}"), colour.clone()));
    }
    stated.colours = own.colours.iter().cloned().map(Some).collect();
    (images, stated)
}

/// Sets the distances of voxels that the description and the resolution state.
fn spacing<'a>(stated: &mut Stated, find: &impl Fn(&str) -> Option<&'a str>, (pixels, code): ([Option<f64>; 2], u64)) {
    // SCIFIO's own keys, one value per axis.
    if let (Some(axes), Some(scales)) = (find("axes"), find("scales")) {
        let units: Vec<String> = find("units").unwrap_or_default().split(',').map(unescaped).collect();
        for (index, (axis, scale)) in axes.split(',').zip(scales.split(',')).enumerate() {
            let Some(axis) = ["X", "Y", "Z"].iter().position(|name| *name == axis.trim()) else { continue };
            let Ok(scale) = scale.trim().parse() else { continue };
            stated.set_spacing(axis, scale, units.get(index).and_then(|name| unit(name)));
        }
        return;
    }
    let x_unit = find("unit").map(unescaped);
    let stated_unit = x_unit.as_deref().and_then(unit);
    for (axis, key) in ["unit", "yunit"].into_iter().enumerate() {
        let Some(pixels) = pixels[axis].filter(|&pixels| pixels > 0.0) else { continue };
        let own = find(key).map(unescaped).and_then(|name| unit(&name)).or(stated_unit);
        // Pixels per centimetre, whatever the unit; other codes are per unit. Without a unit, nothing is calibrated.
        let own = if code == 3 { Some((Unit::Centimetre, 1.0)) } else { own };
        let Some(own) = own else { continue };
        if axis == 0 {
            stated.unit = Some(stated_unit.unwrap_or(own).0);
        }
        stated.set_spacing(axis, 1.0 / pixels, Some(own));
    }
}

/// Replaces `\u00B5` by the letter with this number.
fn unescaped(text: &str) -> String {
    let mut parts = text.trim().split("\\u");
    let mut answer = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let letter = part.get(..4).and_then(|digits| u32::from_str_radix(digits, 16).ok()).and_then(char::from_u32);
        match letter {
            Some(letter) => {
                answer.push(letter);
                answer.push_str(&part[4..]);
            }
            None => {
                answer.push_str("\\u");
                answer.push_str(part);
            }
        }
    }
    answer
}

/// Display ranges and colour maps of the channels from `ImageJ`'s own tags; empty if there are none.
pub(super) fn own(tiff: &mut Tiff, directory: &Directory) -> Result<Own, VolumeError> {
    let mut own = Own::default();
    let (Some(lengths), Some(data)) = (directory.find(tag::IMAGEJ_BYTES), directory.find(tag::IMAGEJ)) else {
        return Ok(own);
    };
    let place = format!("page {}, IJMetadata", directory.page);
    let bytes = tiff.bytes(data, &place)?;
    // A header of pairs of a name and a count; then as many blocks of the stated lengths.
    let Some(header) = tiff.whole(lengths, 0, &place)?.and_then(|length| usize::try_from(length).ok()) else {
        return Ok(own);
    };
    let (mut at, mut block) = (header, 1);
    for pair in bytes.get(4..header).unwrap_or_default().chunks_exact(8) {
        let [name, count] = [&pair[..4], &pair[4..]].map(|word| tiff.number(word));
        for _ in 0..count {
            let Some(length) = tiff.whole(lengths, block, &place)?.and_then(|length| usize::try_from(length).ok())
            else {
                return Ok(own);
            };
            let end = at.saturating_add(length);
            let block_bytes = bytes.get(at..end).unwrap_or_default();
            if name == RANGES {
                own.ranges = block_bytes.chunks_exact(8).map(|word| f64::from_bits(tiff.number(word))).collect();
            } else if name == MAPS && block_bytes.len() == 3 * ENTRIES && own.colours.len() < MOST_MAPS {
                // All red parts, then all green and all blue ones.
                let [red, green, blue] = [1, 2, 3].map(|part| block_bytes[part * ENTRIES - 1]);
                own.colours.push(format!("#{red:02x}{green:02x}{blue:02x}"));
            }
            (at, block) = (end, block + 1);
        }
    }
    Ok(own)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_by_their_number_are_letters() {
        assert_eq!(unescaped("\\u00B5m"), "µm");
        assert_eq!(unescaped("a\\u00b"), "a\\u00b");
        assert_eq!(unescaped("\\u00B5\\u00B5"), "µµ");
    }

    #[test]
    fn an_axis_of_a_hyperstack_that_is_not_stated_follows_from_the_others() {
        let of = |text: &str| read(text.as_bytes(), 12, ([None; 2], 1), &Own::default()).1;
        assert_eq!(of("ImageJ=1.54\nimages=12\nchannels=2\nframes=3\n").sizes, [2, 2, 3]);
        assert_eq!(of("ImageJ=1.54\nimages=9\n").sizes, [9, 1, 1]);
        assert_eq!(of("ImageJ=1.54\n").sizes, [12, 1, 1], "the pages of the file");
        let odd = of("ImageJ=1.54\nimages=7\nchannels=2\nslices=3\n");
        assert_eq!(odd.sizes, [7, 1, 1]);
        assert!(odd.notes[0].contains("7 images") && odd.notes[0].contains("2 channels of 3"), "{:?}", odd.notes);
    }
}
