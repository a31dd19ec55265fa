//! Display presets of a file: windows, and names and colours of labels.

/// Display presets of a file; empty where the file has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Presets {
    /// Windows, in the order of the file.
    pub windows: Vec<Window>,
    /// Names and colours of labels, in the order of the file.
    pub labels: Vec<LabelPreset>,
}

/// A range of values from black to white.
#[derive(Clone, Debug, PartialEq)]
pub struct Window {
    /// Display name.
    pub name: String,
    /// Value shown as black.
    pub low: f64,
    /// Value shown as white, above `low`.
    pub high: f64,
}

impl Window {
    /// The window from `low` to `high`; `None` unless both are finite and in ascending order.
    #[must_use]
    pub fn new(name: &str, low: f64, high: f64) -> Option<Self> {
        let sound = low.is_finite() && high.is_finite() && low < high;
        sound.then(|| Self { name: name.to_owned(), low, high })
    }
}

/// Name and colour of a label.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelPreset {
    /// Value of its voxels.
    pub value: i64,
    /// Display name.
    pub name: String,
    /// sRGB code values from 0 to 1, if the file states a colour.
    pub colour: Option<[f64; 3]>,
}
