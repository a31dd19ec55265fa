//! Transfer presets: for CT in Hounsfield units, for other data by the histogram, and by the windows of a file.

use relume_base::number::count;
use relume_scene::{Interval, Material};
use relume_volume::{Statistics, Window};

/// Words in the names of materials for outer, middle and dense layers, the best first.
const SKIN: [&str; 3] = ["skin", "faint", "flesh"];
const SOFT: [&str; 4] = ["muscle", "flesh", "tissue", "middle"];
const BONE: [&str; 3] = ["bone", "skelet", "solid"];

/// A transfer preset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransferPreset {
    /// Bone in CT.
    Bone,
    /// Soft tissue and bone in CT.
    SoftTissue,
    /// Glassy skin and bone in CT.
    SkinAndBone,
    /// Lungs in CT.
    Lung,
    /// Vessels with contrast agent in CT.
    Vessels,
    /// MR, which has no units.
    Mr,
    /// MR weighted by T1: fat and white matter are bright, fluid is dark.
    MrT1,
    /// MR weighted by T2: fluid is bright.
    MrT2,
    /// Micro-CT: a specimen and its densest parts.
    MicroCt,
    /// Fluorescence microscopy: the brightest fifth as a haze.
    Fluorescence,
    /// The highest quarter of the voxels that are not air.
    Densest,
    /// Three layers with equal numbers of voxels that are not air.
    Layers,
}

impl TransferPreset {
    /// All presets.
    pub const ALL: [Self; 12] = [
        Self::Bone,
        Self::SoftTissue,
        Self::SkinAndBone,
        Self::Lung,
        Self::Vessels,
        Self::Mr,
        Self::MrT1,
        Self::MrT2,
        Self::MicroCt,
        Self::Fluorescence,
        Self::Densest,
        Self::Layers,
    ];

    /// Display name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Bone => "CT: bone",
            Self::SoftTissue => "CT: soft tissue",
            Self::SkinAndBone => "CT: skin and bone",
            Self::Lung => "CT: lung",
            Self::Vessels => "CT: vessels with contrast",
            Self::Mr => "MR",
            Self::MrT1 => "MR: T1",
            Self::MrT2 => "MR: T2",
            Self::MicroCt => "micro-CT",
            Self::Fluorescence => "fluorescence",
            Self::Densest => "the densest",
            Self::Layers => "layers",
        }
    }

    /// Its name on the command line, one word.
    #[must_use]
    pub const fn word(self) -> &'static str {
        match self {
            Self::Bone => "ct-bone",
            Self::SoftTissue => "soft-tissue",
            Self::SkinAndBone => "skin",
            Self::Lung => "lung",
            Self::Vessels => "ct-vessels",
            Self::Mr => "mr",
            Self::MrT1 => "mr-t1",
            Self::MrT2 => "mr-t2",
            Self::MicroCt => "micro-ct",
            Self::Fluorescence => "haze",
            Self::Densest => "densest",
            Self::Layers => "layers",
        }
    }

    /// Names of its layers, in ascending order of values, where they are tissues.
    pub(super) const fn tissues(self) -> &'static [&'static str] {
        match self {
            Self::Bone => &["bone"],
            Self::SoftTissue => &["flesh", "bone"],
            Self::SkinAndBone => &["skin", "bone"],
            Self::Lung => &["lung", "bone"],
            Self::Vessels => &["vessel", "bone"],
            _ => &[],
        }
    }

    /// Description in one sentence.
    #[must_use]
    pub fn help(self) -> &'static str {
        match self {
            Self::Bone => "Shows everything denser than 250 Hounsfield units, and hides the rest.",
            Self::SoftTissue => "Shows muscle and organs, -20 to 160 Hounsfield units, as a haze around solid bone.",
            Self::SkinAndBone => {
                "Shows the surface of the body, -400 to -150 Hounsfield units, like glass, with the bones inside."
            }
            Self::Lung => "Shows lungs, -900 to -500 Hounsfield units, through faint bones.",
            Self::Vessels => {
                "Shows vessels with contrast agent, 150 to 420 Hounsfield units, and dense bone from 550 on as a haze."
            }
            Self::Fluorescence => "Shows the brightest fifth of the values that are not dark as a haze.",
            Self::Mr => "Hides air and the darker half of the other values; the brightest tenth is solid.",
            Self::MrT1 => {
                "Shows the brightest quarter, fat and white matter in T1, behind a haze of muscle and grey matter, and hides the darkest third."
            }
            Self::MrT2 => "Shows the brightest twentieth, fluid in T2, in a thin haze of the upper half.",
            Self::MicroCt => "Shows the specimen like glass, and its densest twentieth solid.",
            Self::Densest => "Shows the highest quarter of the values that are not air.",
            Self::Layers => {
                "Divides the values that are not air into three layers with equal numbers of voxels; the highest is the most solid."
            }
        }
    }

    /// The description, with the offset of Hounsfield units if the values suggest one.
    #[must_use]
    pub fn help_for(self, statistics: &Statistics) -> String {
        match hounsfield(statistics) {
            Some(zero) if self.is_of_ct() && zero != 0.0 => {
                format!(
                    "{} If these values are from a CT, they have an offset of {zero}: {zero} is water.",
                    self.help()
                )
            }
            _ => self.help().to_owned(),
        }
    }

    /// Whether it is for CT alone.
    #[must_use]
    pub const fn is_of_ct(self) -> bool {
        matches!(self, Self::Bone | Self::SoftTissue | Self::SkinAndBone | Self::Lung | Self::Vessels)
    }

    /// Intervals for these values and materials; `None` for a CT preset if the values are not those of a CT.
    #[must_use]
    pub fn intervals(self, statistics: &Statistics, materials: &[Material]) -> Option<Vec<Interval>> {
        self.intervals_of(statistics, hounsfield(statistics), |words, part| of(materials, words, part))
    }

    /// [`Self::intervals`] where water has the value `water`, if these are values of a CT, with the materials that `of`
    /// finds by words in their names, or else at a fraction of their list.
    pub(super) fn intervals_of(
        self,
        statistics: &Statistics,
        water: Option<f64>,
        of: impl Fn(&[&str], f64) -> usize,
    ) -> Option<Vec<Interval>> {
        let hounsfield = || water;
        let quantile = |part: f64| quantile(statistics, part);
        let span = statistics.max - statistics.min;
        let ramp = span / 100.0;
        let layer = |material, range, ramp, opacity| Interval { material, range, ramp, opacity, absorption: 0.0 };
        let skin = of(&SKIN, 0.0);
        let soft = of(&SOFT, 0.5);
        let bone = of(&BONE, 1.0);
        Some(match self {
            Self::Bone => {
                let zero = hounsfield()?;
                vec![layer(bone, [zero + 300.0, statistics.max], 50.0, 0.5)]
            }
            Self::SoftTissue => {
                let zero = hounsfield()?;
                vec![
                    layer(soft, [zero, zero + 140.0], 20.0, 0.03),
                    layer(bone, [zero + 300.0, statistics.max], 50.0, 0.5),
                ]
            }
            Self::SkinAndBone => {
                let zero = hounsfield()?;
                vec![
                    layer(skin, [zero - 350.0, zero - 200.0], 50.0, 0.02),
                    layer(bone, [zero + 300.0, statistics.max], 50.0, 0.5),
                ]
            }
            Self::Lung => {
                let zero = hounsfield()?;
                // From the values of full inspiration on; bones in front of the lungs hide little of them.
                vec![
                    layer(skin, [zero - 900.0, zero - 500.0], 50.0, 0.06),
                    layer(bone, [zero + 300.0, statistics.max], 50.0, 0.03),
                ]
            }
            Self::Vessels => {
                let zero = hounsfield()?;
                vec![
                    layer(soft, [zero + 170.0, zero + 400.0], 20.0, 0.3),
                    layer(bone, [zero + 550.0, statistics.max], 50.0, 0.05),
                ]
            }
            Self::Fluorescence => vec![layer(bone, [quantile(0.8), statistics.max], ramp, 0.05)],
            Self::Mr => vec![
                layer(soft, [quantile(0.5), quantile(0.9)], ramp, 0.03),
                layer(bone, [quantile(0.9), statistics.max], ramp, 0.3),
            ],
            Self::MrT1 => vec![
                layer(soft, [quantile(1.0 / 3.0), quantile(0.75)], ramp, 0.015),
                layer(bone, [quantile(0.75), statistics.max], ramp, 0.2),
            ],
            Self::MrT2 => vec![
                layer(soft, [quantile(0.5), quantile(0.95)], ramp, 0.01),
                layer(bone, [quantile(0.95), statistics.max], ramp, 0.3),
            ],
            Self::MicroCt => vec![
                layer(soft, [quantile(0.05), quantile(0.95)], ramp, 0.03),
                layer(bone, [quantile(0.95), statistics.max], ramp, 0.5),
            ],
            Self::Densest => vec![layer(bone, [quantile(0.75), statistics.max], ramp, 0.3)],
            Self::Layers => vec![
                layer(skin, [quantile(0.0), quantile(1.0 / 3.0)], ramp, 0.01),
                layer(soft, [quantile(1.0 / 3.0), quantile(2.0 / 3.0)], ramp, 0.05),
                layer(bone, [quantile(2.0 / 3.0), statistics.max], ramp, 0.3),
            ],
        })
    }
}

/// Opacities of the thirds of a window, in ascending order of values.
pub(super) const OPACITIES: [f64; 3] = [0.01, 0.06, 0.4];

/// Intervals for a window of a file: nothing up to its low end, three layers of equal width inside, and the values above
/// it as the highest; `None` if no value lies above its low end.
#[must_use]
pub fn of_window(window: &Window, statistics: &Statistics, materials: &[Material]) -> Option<Vec<Interval>> {
    let Window { low, high, .. } = *window;
    if low >= statistics.max {
        return None;
    }
    let third = (high - low) / 3.0;
    let ramp = third / 4.0;
    let words: [&[&str]; 3] = [&SKIN, &SOFT, &BONE];
    let layer = |index: usize| {
        let (at, is_last) = (count(index), index == 2);
        // Neighbours cross in the middle of their ramps; below the window there is nothing.
        let first = low + at * third + if index == 0 { ramp } else { ramp / 2.0 };
        let last = if is_last { high.max(statistics.max) } else { low + (at + 1.0) * third - ramp / 2.0 };
        let material = of(materials, words[index], at / 2.0);
        Interval { material, range: [first, last], ramp, opacity: OPACITIES[index], absorption: 0.0 }
    };
    Some((0..OPACITIES.len()).map(layer).collect())
}

/// The first material with one of `words` in its name, otherwise the material at the fraction `part` of the list.
fn of(materials: &[Material], words: &[&str], part: f64) -> usize {
    let named = |word: &&str| materials.iter().position(|material| material.name.to_lowercase().contains(word));
    let last = materials.len().saturating_sub(1);
    words.iter().find_map(named).unwrap_or_else(|| relume_base::number::whole((part * count(last)).round()))
}

/// Customary windows of a CT, that of soft tissue first; none if the values are not those of a CT.
#[must_use]
pub fn ct_windows(statistics: &Statistics) -> Vec<Window> {
    let Some(zero) = hounsfield(statistics) else { return Vec::new() };
    // Level and width in Hounsfield units, as customary in radiology.
    let windows = [
        ("CT: soft tissue", 40.0, 400.0),
        ("CT: lung", -600.0, 1500.0),
        ("CT: bone", 400.0, 1800.0),
        ("CT: brain", 40.0, 80.0),
    ];
    let window = |(name, level, width)| Window::new(name, zero + level - width / 2.0, zero + level + width / 2.0);
    windows.into_iter().filter_map(window).collect()
}

/// Value of 0 Hounsfield units (water) if the values are those of a CT. Air is at -1000; scanners that store no sign
/// add 1024.
pub(super) fn hounsfield(statistics: &Statistics) -> Option<f64> {
    let Statistics { min, max, .. } = *statistics;
    match (min, max) {
        (-4096.0..=-500.0, 300.0..=40000.0) => Some(0.0),
        (0.0..=524.0, 1324.0..=5120.0) => Some(1024.0),
        _ => None,
    }
}

/// Value below which the fraction `part` of the voxels lies, air excluded.
fn quantile(statistics: &Statistics, part: f64) -> f64 {
    let bins = &statistics.histogram;
    let first = super::otsu::threshold(bins);
    let voxels = |bin: &u64| count(usize::try_from(*bin).unwrap_or(usize::MAX));
    let wanted = part * bins.iter().skip(first).map(voxels).sum::<f64>();
    let width = (statistics.max - statistics.min) / count(bins.len());
    let mut below = 0.0;
    for (index, bin) in bins.iter().enumerate().skip(first) {
        let here = voxels(bin);
        if below + here >= wanted {
            let within = if here > 0.0 { (wanted - below) / here } else { 0.0 };
            return statistics.min + width * (count(index) + within);
        }
        below += here;
    }
    statistics.max
}

#[cfg(test)]
mod tests {
    use super::*;

    fn statistics(min: f64, max: f64, histogram: impl Fn(usize) -> u64) -> Statistics {
        let histogram = std::array::from_fn(histogram);
        Statistics { min, max, mean: 0.0, histogram, not_a_number: 0, infinite: 0 }
    }

    #[test]
    fn quantiles_are_of_what_is_not_air() {
        // Half of the voxels are 0; the others are distributed evenly from 32 to 64.
        let values = statistics(0.0, 64.0, |bin| if bin == 0 { 3200 } else { 100 * u64::from(bin >= 32) });
        for (part, value) in [(0.25, 40.0), (0.5, 48.0), (1.0, 64.0)] {
            assert!((quantile(&values, part) - value).abs() < 1e-9, "{part}: {}", quantile(&values, part));
        }
    }

    #[test]
    fn presets_by_quantiles_show_the_share_that_they_promise() {
        // Half of the voxels are 0; the others are distributed evenly from 32 to 64.
        let values = statistics(0.0, 64.0, |bin| if bin == 0 { 3200 } else { 100 * u64::from(bin >= 32) });
        let at = |part: f64| 32.0f64.mul_add(part, 32.0);
        for (preset, ranges) in [
            (TransferPreset::Mr, &[[0.5, 0.9], [0.9, 1.0]][..]),
            (TransferPreset::MrT1, &[[1.0 / 3.0, 0.75], [0.75, 1.0]]),
            (TransferPreset::MrT2, &[[0.5, 0.95], [0.95, 1.0]]),
            (TransferPreset::MicroCt, &[[0.05, 0.95], [0.95, 1.0]]),
            (TransferPreset::Fluorescence, &[[0.8, 1.0]]),
            (TransferPreset::Densest, &[[0.75, 1.0]]),
            (TransferPreset::Layers, &[[0.0, 1.0 / 3.0], [1.0 / 3.0, 2.0 / 3.0], [2.0 / 3.0, 1.0]]),
        ] {
            let intervals = preset.intervals(&values, &[]).unwrap_or_default();
            assert_eq!(intervals.len(), ranges.len(), "{preset:?}");
            for (interval, expected) in intervals.iter().zip(ranges) {
                for (found, part) in interval.range.iter().zip(expected) {
                    // The lowest value lies anywhere between the air and the first voxel.
                    let is_lowest = *part <= 0.0 && *found > 0.0 && *found <= at(0.0);
                    let is_it = is_lowest || (found - at(*part)).abs() < 1e-9;
                    assert!(is_it, "{preset:?}: {found} is not the quantile {part}");
                }
            }
            // Solid parts hide more than the haze around them.
            assert!(intervals.is_sorted_by(|one, other| one.opacity < other.opacity), "{preset:?}");
        }
    }

    #[test]
    fn presets_of_a_ct_show_the_tissues_of_their_names() {
        let ct = statistics(-1024.0, 3071.0, |_| 1);
        // Hounsfield units that a preset shows, and that it hides.
        for (preset, shown, hidden) in [
            (TransferPreset::Bone, &[400.0, 1500.0][..], &[-1000.0, -100.0, 60.0][..]),
            (TransferPreset::SoftTissue, &[60.0, 1000.0], &[-1000.0, -100.0, 220.0]),
            (TransferPreset::SkinAndBone, &[-300.0, 1000.0], &[-1000.0, 60.0]),
            (TransferPreset::Lung, &[-700.0, 1000.0], &[-1000.0, 60.0]),
            (TransferPreset::Vessels, &[300.0, 1000.0], &[-100.0, 60.0]),
        ] {
            let intervals = preset.intervals(&ct, &[]).unwrap_or_default();
            let shows = |value: f64| {
                intervals.iter().any(|it| (it.range[0] - it.ramp..=it.range[1] + it.ramp).contains(&value))
            };
            assert!(shown.iter().all(|&value| shows(value)), "{preset:?}: {intervals:?}");
            assert!(!hidden.iter().any(|&value| shows(value)), "{preset:?}: {intervals:?}");
        }
    }

    #[test]
    fn a_ct_is_told_by_its_values_and_nothing_else_gets_its_presets() {
        let even = |_| 1;
        assert_eq!(hounsfield(&statistics(-1024.0, 3071.0, even)), Some(0.0));
        assert_eq!(hounsfield(&statistics(0.0, 4095.0, even)), Some(1024.0));
        let told =
            |preset: TransferPreset, min, max| preset.help_for(&statistics(min, max, even)).contains("1024 is water");
        assert!(
            told(TransferPreset::Bone, 0.0, 4095.0)
                && !told(TransferPreset::Bone, -1024.0, 3071.0)
                && !told(TransferPreset::Mr, 0.0, 4095.0)
        );
        for [min, max] in [[0.0, 255.0], [0.0, 1.0], [-1.0, 1.0], [0.0, 65535.0]] {
            let other = statistics(min, max, even);
            assert_eq!(TransferPreset::Bone.intervals(&other, &[]), None, "{min} to {max}");
            for preset in TransferPreset::ALL.into_iter().skip(5) {
                let intervals = preset.intervals(&other, &[]).unwrap_or_default();
                assert!(!intervals.is_empty(), "{preset:?}");
                for interval in intervals {
                    let [low, high] = interval.range;
                    assert!(min <= low && low <= high && high <= max, "{preset:?}: {interval:?}");
                }
            }
        }
    }

    #[test]
    fn the_windows_of_a_ct_lie_around_their_level_in_hounsfield_units() {
        let ends = |min, max| {
            let windows = ct_windows(&statistics(min, max, |_| 1));
            windows.into_iter().map(|window| (window.low, window.high)).collect::<Vec<_>>()
        };
        assert_eq!(ends(-1024.0, 3071.0), [(-160.0, 240.0), (-1350.0, 150.0), (-500.0, 1300.0), (0.0, 80.0)]);
        assert_eq!(ends(0.0, 4095.0).first(), Some(&(864.0, 1264.0)), "with an offset of 1024");
        assert!(ends(0.0, 255.0).is_empty());
    }

    #[test]
    fn a_window_shows_nothing_below_and_all_above_it() {
        let even = |_| 1;
        let values = statistics(-1000.0, 2000.0, even);
        let window = Window { name: String::new(), low: -160.0, high: 240.0 };
        let layers = of_window(&window, &values, &[]).unwrap_or_default();
        assert_eq!(layers.len(), 3);
        let foot = layers[0].range[0] - layers[0].ramp;
        assert!((foot + 160.0).abs() < 1e-9, "the first value is black: {foot}");
        assert!((layers[2].range[1] - 2000.0).abs() < 1e-9, "what is white stays so up to the largest value");
        for pair in layers.windows(2) {
            let middle = f64::midpoint(pair[0].range[1], pair[1].range[0]);
            let (down, up) = (pair[0].range[1] + pair[0].ramp, pair[1].range[0] - pair[1].ramp);
            assert!((f64::midpoint(down, up) - middle).abs() < 1e-9, "they cross halfway: {pair:?}");
            assert!(pair[0].opacity < pair[1].opacity, "brighter is more solid");
        }
        let above = Window { low: 2000.0, high: 3000.0, ..window };
        assert_eq!(of_window(&above, &values, &[]), None, "it would show nothing");
    }
}
