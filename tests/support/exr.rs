//! OpenEXR files as another program reads them, and when two pictures are one.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use exr::prelude::attribute::AttributeValue;
use exr::prelude::{ReadChannels as _, ReadLayers as _};

/// An OpenEXR file as another program reads it: channels by name, and the attributes that this program added.
pub struct Exr {
    pub size: (usize, usize),
    pub channels: BTreeMap<String, Vec<f32>>,
    pub attributes: HashMap<String, String>,
}

impl Exr {
    pub fn read(path: &Path) -> Self {
        let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
        let image = reader.first_valid_layer().all_attributes().from_file(path).unwrap();
        let layer = image.layer_data;
        let channels = layer
            .channel_data
            .list
            .iter()
            .map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect()));
        let attributes = layer.attributes.other.iter().filter_map(|(name, value)| match value {
            AttributeValue::Text(text) => Some((name.to_string(), text.to_string())),
            _ => None,
        });
        Self { size: (layer.size.0, layer.size.1), channels: channels.collect(), attributes: attributes.collect() }
    }

    /// Linear RGB and opacity, channel after channel.
    pub fn rgba(&self) -> Vec<f32> {
        ["R", "G", "B", "A"].iter().flat_map(|name| self.channels[*name].iter().copied()).collect()
    }
}

/// Two pictures are one, but for the rounding of f32: `relative` of the larger value, and 1e-6 of white.
pub fn assert_same(one: &[f32], other: &[f32], relative: f32) {
    assert_eq!(one.len(), other.len(), "pictures of one size");
    assert!(one.iter().any(|&value| value > 0.01), "a black picture shows nothing");
    for (&a, &b) in one.iter().zip(other) {
        assert!((a - b).abs() <= relative * a.abs().max(b.abs()) + 1e-6, "{a} against {b}");
    }
}

/// Cuts the accumulator file at `path` at every length, and damages it everywhere but in the middle of its text, which is long
/// and harmless: `read`, which says whether it was read, refuses what is cut and has an answer to the rest.
pub fn damage(path: &Path, read: impl Fn() -> bool) {
    let whole = std::fs::read(path).unwrap();
    assert!(read(), "before");
    for length in 0..whole.len() {
        std::fs::write(path, &whole[..length]).unwrap();
        assert!(!read(), "cut to {length} of {} bytes", whole.len());
    }
    let text = whole.windows(7).position(|bytes| bytes == b"version").unwrap();
    for at in (0..text + 20).chain(whole.len() - 700..whole.len()) {
        for bits in [0xff, 0x80, 0x01] {
            let mut damaged = whole.clone();
            damaged[at] ^= bits;
            std::fs::write(path, &damaged).unwrap();
            // Some bytes do not matter; what counts is that an answer comes.
            let _answer = read();
        }
    }
}
