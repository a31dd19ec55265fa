//! Display presets of a file: windows, and names and colours of labels.

/// Display presets of a file; empty where the file has none.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Presets {
    /// Windows, in the order of the file.
    pub windows: Vec<Window>,
    /// Names and colours of labels, in the order of the file.
    pub labels: Vec<LabelPreset>,
    /// sRGB code values from 0 to 1 of the channel that was read, if the file states a colour other than grey.
    pub colour: Option<[f64; 3]>,
}

impl Presets {
    /// Takes `colour`, `#rrggbb` in any case, as that of the channel, unless it is grey or no colour.
    pub(super) fn take_colour(&mut self, colour: &str) {
        let digits = colour.trim_start_matches('#');
        let part = |index: usize| u8::from_str_radix(digits.get(2 * index..2 * index + 2)?, 16).ok();
        let parts = [part(0), part(1), part(2)];
        if let [Some(red), Some(green), Some(blue)] = parts
            && digits.len() == 6
            && !(red == green && green == blue)
        {
            self.colour = Some([red, green, blue].map(|part| f64::from(part) / 255.0));
        }
    }
}

/// The colour, `#rrggbb`, in which light of this wavelength in nm is usually drawn: from violet to red, without its brightness.
pub(super) fn drawn_colour(nm: f64) -> Option<String> {
    /// Wavelengths with their colours, linear in between.
    const ANCHORS: [(f64, [f64; 3]); 7] = [
        (380.0, [1.0, 0.0, 1.0]),
        (440.0, [0.0, 0.0, 1.0]),
        (490.0, [0.0, 1.0, 1.0]),
        (510.0, [0.0, 1.0, 0.0]),
        (580.0, [1.0, 1.0, 0.0]),
        (645.0, [1.0, 0.0, 0.0]),
        (1000.0, [1.0, 0.0, 0.0]),
    ];
    let pair = ANCHORS.windows(2).find(|pair| (pair[0].0..=pair[1].0).contains(&nm))?;
    let part = (nm - pair[0].0) / (pair[1].0 - pair[0].0);
    let code = |index: usize| {
        let [from, to] = [pair[0].1[index], pair[1].1[index]];
        format!("{:02x}", relume_base::number::Real::index((255.0 * part.mul_add(to - from, from)).round()))
    };
    Some(format!("#{}{}{}", code(0), code(1), code(2)))
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
