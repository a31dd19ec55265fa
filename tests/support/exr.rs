//! Independent reader of OpenEXR files, and comparison of pictures.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use exr::prelude::attribute::AttributeValue;
use exr::prelude::{ReadChannels as _, ReadLayers as _};

/// Contents of an OpenEXR file: channels by name, and non-standard text attributes.
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

/// Asserts that two pictures agree up to f32 rounding: `relative` of the larger value, plus 1e-6 of white.
pub fn assert_same(one: &[f32], other: &[f32], relative: f32) {
    assert_eq!(one.len(), other.len(), "pictures of one size");
    assert!(one.iter().any(|&value| value > 0.01), "a black picture shows nothing");
    for (&a, &b) in one.iter().zip(other) {
        assert!((a - b).abs() <= relative * a.abs().max(b.abs()) + 1e-6, "{a} against {b}");
    }
}

/// Truncates the film file at `path` to every length, and damages all its bytes except the middle of its text, which is
/// long
/// and harmless. `read` returns whether reading succeeded; it must refuse every truncated file and return for every
/// other.
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
            // Some bytes do not matter; only a panic or a hang is a failure.
            let _answer = read();
        }
    }
}
