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
