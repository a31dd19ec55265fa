//! The values of a volume: percentiles, peaks, and the kind of data they suggest.

use rayon::prelude::*;
use serde::Serialize;

use super::super::otsu::otsu;
use super::super::transfer_presets::hounsfield;
use super::regions;
use super::sample::Thinned;
use relume_base::number::{brief, count, in_range, whole};
use relume_volume::{LabelCounts, MOST_LABELS, Modality, Statistics, Unit, Volume, Window, is_background};

/// Bins of the histogram between the 0.05th and the 99.95th percentile.
const BINS: usize = 256;
/// Values that are sorted for percentiles.
const SORTED: usize = 400_000;
/// Most labels that are shown as intervals of the transfer function; a volume with more values needs more evidence, too.
pub(super) const FEW_LABELS: usize = 48;

/// Kind of data, as far as the values tell.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// CT with this value for water; air is 1000 below.
    Ct {
        /// Value of 0 Hounsfield units.
        water: f64,
    },
    /// A segmentation with these labels, without the background.
    Labels(Vec<i64>),
    /// Anything else, of the modality that the file states.
    Other(Option<Modality>),
}

impl Kind {
    /// Name for programs.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Ct { .. } => "ct",
            Self::Labels(_) => "labels",
            Self::Other(_) => "other",
        }
    }
}

/// A range of values with a name.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Named {
    /// Name of the tissue.
    pub name: &'static str,
    /// Its values.
    pub interval: [f64; 2],
    /// Fraction of all voxels in the interval.
    pub share: f64,
}

/// Tissues in Hounsfield units (Hounsfield 1980; docs/theory/first-look.md).
const TISSUES: [(&str, [f64; 2]); 6] = [
    ("air", [-1100.0, -900.0]),
    ("lung", [-900.0, -400.0]),
    ("fat", [-130.0, -60.0]),
    ("muscle and organs", [20.0, 90.0]),
    ("vessels with contrast agent", [150.0, 420.0]),
    ("bone", [250.0, 3000.0]),
];

/// A peak of the histogram.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Peak {
    /// Value of the most voxels.
    pub value: f64,
    /// Suggested interval: between the valleys beside the peak.
    pub interval: [f64; 2],
    /// Fraction of all voxels in the interval.
    pub share: f64,
}

/// Statistics of the values of a volume.
#[derive(Clone, Debug)]
pub struct Values {
    /// Kind of data.
    pub kind: Kind,
    /// Peaks of the histogram in ascending order.
    pub peaks: Vec<Peak>,
    /// Values from which voxels are objects and not their surroundings.
    pub objects_from: f64,
    /// Values from which fainter voxels may be the surface of an object: halfway from the surroundings, above their
    /// noise.
    pub(super) surface_from: f64,
    pub(super) sorted: Vec<f64>,
    pub(super) thinned: Thinned,
    pub(super) least: f64,
    pub(super) most: f64,
    /// Numbers of voxels of the labels of a segmentation, with the background.
    pub(super) label_counts: LabelCounts,
}

impl Values {
    /// Examines the values of `volume`, which has these `statistics`.
    #[must_use]
    pub fn of(volume: &Volume, statistics: &Statistics) -> Self {
        let thinned = Thinned::of(volume, [statistics.min, statistics.max]);
        let mut sorted: Vec<f64> =
            thinned.values.iter().copied().step_by((thinned.values.len() / SORTED).max(1)).collect();
        sorted.par_sort_unstable_by(f64::total_cmp);
        let (least, most) = (statistics.min, statistics.max);
        let (kind, label_counts) = kind(volume, &thinned, &sorted, statistics);
        let peaks = Vec::new();
        let mut values =
            Self { kind, peaks, objects_from: least, surface_from: least, sorted, thinned, least, most, label_counts };
        let histogram = Histogram::of(&values);
        values.peaks = histogram.peaks();
        [values.surface_from, values.objects_from] = values.boundaries(&histogram);
        values
    }

    /// Value below which the fraction `part` of the voxels lies.
    #[must_use]
    pub fn percentile(&self, part: f64) -> f64 {
        let last = self.sorted.len().saturating_sub(1);
        self.sorted.get(whole((part * count(last)).round()).min(last)).copied().unwrap_or(self.least)
    }

    /// Whether a window of the file tells values apart: it holds others than the smallest, or reaches the largest.
    pub(super) fn are_in(&self, window: &Window) -> bool {
        let Some(&least) = self.sorted.first() else { return false };
        let begin = self.sorted.partition_point(|&value| value < window.low || value <= least);
        let end = self.sorted.partition_point(|&value| value <= window.high);
        window.low < self.most && window.high > self.least && (window.high >= self.most || begin < end)
    }

    /// Value of water in a CT; for a look that only CT has, values of the range of a CT are enough.
    pub(super) fn water(&self, statistics: &Statistics) -> Option<f64> {
        match self.kind {
            Kind::Ct { water } => Some(water),
            Kind::Labels(_) => None,
            Kind::Other(_) => hounsfield(statistics),
        }
    }

    /// Ranges of values that have names in this kind of data; empty except for CT.
    #[must_use]
    pub fn named(&self) -> Vec<Named> {
        let Kind::Ct { water } = self.kind else { return Vec::new() };
        let named = |(name, [low, high]): (&'static str, [f64; 2])| {
            let interval = [water + low, water + high];
            Named { name, interval, share: self.share(interval) }
        };
        TISSUES.into_iter().map(named).filter(|named| named.share > 0.0).collect()
    }

    /// Suggested intervals in sentences: by name for a CT, by peaks of the histogram otherwise.
    #[must_use]
    pub fn sentences(&self) -> Vec<String> {
        let percent = |share: f64| format!("{:.1} % of the voxels", 100.0 * share);
        let range = |[low, high]: [f64; 2]| format!("{} to {}", brief(low.round()), brief(high.round()));
        match &self.kind {
            Kind::Ct { water } => {
                let unit = if *water == 0.0 {
                    "a CT in Hounsfield units: air is -1000, water is 0".to_owned()
                } else {
                    format!("a CT with an offset: water is {}, air is {}", brief(*water), brief(water - 1000.0))
                };
                let named = self.named().into_iter();
                let named = named.map(|it| format!("{} {}: {}", it.name, range(it.interval), percent(it.share)));
                std::iter::once(unit).chain(named).collect()
            }
            Kind::Labels(labels) => {
                let listed: Vec<String> = labels.iter().take(FEW_LABELS).map(i64::to_string).collect();
                let more = labels.len() - listed.len();
                let more = if more > 0 { format!(" and {more} more") } else { String::new() };
                vec![format!("a segmentation with the labels {}{more}", listed.join(", "))]
            }
            Kind::Other(_) => {
                let digits = |value: f64| in_range(value, self.most - self.least, 4);
                let peak = |peak: &Peak| {
                    let [low, high] = peak.interval.map(digits);
                    let side = if peak.value < self.objects_from { ", surroundings" } else { "" };
                    format!("a peak at {}: interval {low} to {high}, {}{side}", digits(peak.value), percent(peak.share))
                };
                self.peaks.iter().map(peak).collect()
            }
        }
    }

    /// Value below which the fraction `part` of the voxels from [`Self::objects_from`] on lies.
    pub(super) fn percentile_of_objects(&self, part: f64) -> f64 {
        let first = self.sorted.partition_point(|&value| value < self.objects_from);
        let objects = self.sorted.get(first..).unwrap_or_default();
        let last = objects.len().saturating_sub(1);
        objects.get(whole((part * count(last)).round()).min(last)).copied().unwrap_or(self.most)
    }

    /// Fraction of the voxels with values in a range.
    pub(super) fn share(&self, [low, high]: [f64; 2]) -> f64 {
        let below = self.sorted.partition_point(|&value| value < low);
        let within = self.sorted.partition_point(|&value| value <= high);
        count(within.saturating_sub(below)) / count(self.sorted.len().max(1))
    }

    /// Values from which on voxels may be the surface of an object, and from which on they are objects: where the voxels
    /// with large gradients, which lie on boundaries, fall apart into two classes (docs/theory/first-look.md).
    fn boundaries(&self, histogram: &Histogram) -> [f64; 2] {
        let mut border = self.thinned.border();
        border.sort_unstable_by(f64::total_cmp);
        let at = |part: f64| border.get(whole(part * count(border.len()))).copied().unwrap_or(self.least);
        let [middle, high] = [at(0.5), at(0.9)];
        let [low_end, high_end] = histogram.range;
        let span = high_end - low_end;
        // Surroundings are dark, and alike over most of the border.
        let surrounded = high - middle < 0.25 * span && middle < low_end + 0.35 * span;
        let edges = histogram.weighted_by_gradient();
        let all = histogram.value(otsu(&histogram.counts));
        let of_edges = histogram.value(otsu(&edges));
        let cut = of_edges.min(all);
        let [level, noise] = if surrounded { [middle, high + 0.02 * span] } else { [low_end, low_end] };
        let from = self.above_specks(cut.max(noise));
        [f64::midpoint(level, from).max(noise), from]
    }

    /// `from`, or if objects are sparse and many of the voxels from there on lie in specks of noise, the smallest value
    /// without so many (docs/theory/first-look.md).
    fn above_specks(&self, from: f64) -> f64 {
        /// Fraction of the voxels below which objects are sparse, as vessels are.
        const SPARSE: f64 = 0.15;
        /// Fraction of the objects' voxels in specks that is too much.
        const MANY: f64 = 0.05;
        /// Tenths of the objects' voxels that may be noise.
        const MOST: i32 = 6;
        if self.share([from, f64::MAX]) > SPARSE || self.thinned.specks(from) <= MANY {
            return from;
        }
        let objects = self.sorted.partition_point(|&value| value < from);
        let objects = self.sorted.get(objects..).unwrap_or_default();
        let at = |tenth: i32| objects.get(objects.len() * whole(f64::from(tenth)) / 10).copied();
        let quiet = |cut: &f64| *cut > from && self.thinned.specks(*cut) <= MANY;
        // Where it stays so, as in vessels thinner than the voxels of the copy, these parts are no noise.
        (1..=MOST).filter_map(at).find(quiet).unwrap_or(from)
    }
}

/// Histogram over the range of almost all values.
pub(super) struct Histogram {
    pub(super) range: [f64; 2],
    pub(super) counts: Vec<f64>,
    gradients: Vec<f64>,
    all: f64,
}

impl Histogram {
    pub(super) fn of(values: &Values) -> Self {
        let range = [values.percentile(0.0005), values.percentile(0.9995)];
        let range = if range[1] > range[0] { range } else { [values.least, values.most] };
        let (mut counts, mut gradients) = (vec![0.0; BINS], vec![0.0; BINS]);
        let thinned = &values.thinned;
        let scale = count(BINS) / (range[1] - range[0]).max(f64::MIN_POSITIVE);
        // Four parts of the voxels are more than the bins need.
        let step = (thinned.values.len() / 1_000_000).max(1);
        for (&value, gradient) in thinned.values.iter().step_by(step).zip(thinned.gradients(step)) {
            let bin = whole((value - range[0]) * scale).min(BINS - 1);
            counts[bin] += 1.0;
            gradients[bin] += gradient;
        }
        let all = counts.iter().sum();
        Self { range, counts, gradients, all }
    }

    /// Lower edge of a bin.
    fn value(&self, bin: usize) -> f64 {
        self.range[0] + (self.range[1] - self.range[0]) * count(bin) / count(BINS)
    }

    /// Sums of gradient sizes, in place of counts.
    fn weighted_by_gradient(&self) -> Vec<f64> {
        self.gradients.clone()
    }

    /// Peaks of the smoothed logarithm of the counts that rise above their valleys.
    fn peaks(&self) -> Vec<Peak> {
        /// Ratio of a peak to the higher of its valleys, as a logarithm.
        const PROMINENCE: f64 = 0.25;
        /// Fraction of all voxels below which a bin is noise.
        const NOISE: f64 = 2e-5;
        const PASSES: usize = 3;
        if self.range[1] <= self.range[0] {
            return vec![Peak { value: self.range[0], interval: self.range, share: 1.0 }];
        }
        // Integers with fewer values than bins leave bins empty, which smoothing fills.
        let mut smooth = self.counts.clone();
        for _ in 0..PASSES {
            let at = |bin: usize, off: usize| {
                let place = (bin + off).saturating_sub(2).min(BINS - 1);
                smooth[place]
            };
            smooth = (0..BINS).map(|bin| (0..5).map(|off| at(bin, off)).sum::<f64>() / 5.0).collect();
        }
        let height: Vec<f64> = smooth.iter().map(|n| (n + NOISE * self.all).ln()).collect();
        let mut valleys = vec![0];
        let mut tops: Vec<usize> = Vec::new();
        let (mut top, mut valley) = (0, 0);
        let mut rising = true;
        for bin in 1..BINS {
            if rising {
                if height[bin] > height[top] {
                    top = bin;
                } else if height[top] - height[bin] > PROMINENCE {
                    tops.push(top);
                    (rising, valley) = (false, bin);
                }
            } else if height[bin] < height[valley] {
                valley = bin;
            } else if height[bin] - height[valley] > PROMINENCE {
                valleys.push(valley);
                (rising, top) = (true, bin);
            }
        }
        if rising {
            tops.push(top);
        }
        valleys.push(BINS);
        let peak = |(&top, between): (&usize, &[usize])| Peak {
            value: self.value(top) + (self.range[1] - self.range[0]) / count(2 * BINS),
            interval: [self.value(between[0]), self.value(between[1])],
            share: self.counts[between[0]..between[1]].iter().sum::<f64>() / self.all,
        };
        tops.iter().zip(valleys.windows(2)).map(peak).collect()
    }
}

fn kind(volume: &Volume, thinned: &Thinned, sorted: &[f64], statistics: &Statistics) -> (Kind, LabelCounts) {
    // Maps of microscopes may have the values of a CT, but not its unit.
    let is_small = matches!(volume.unit, Some(Unit::Micrometre | Unit::Nanometre | Unit::Angstrom));
    let modality = volume.modality();
    let may_be_ct = !volume.has_labels && !is_small && modality.is_none_or(|it| it == Modality::Ct);
    let water = water(sorted, statistics, modality.is_some()).filter(|_| may_be_ct);
    // Labels from 1000 on may have the distances of air, water and bone, but no number below 0 other than -1.
    let is_offset = water.is_some_and(|water| water > 0.0) && modality.is_none();
    let labels = if water.is_some() && !is_offset { None } else { labels(volume, thinned, sorted, statistics) };
    match (labels, water) {
        (Some((labels, counts)), _) => (Kind::Labels(labels), counts),
        (None, Some(water)) => (Kind::Ct { water }, LabelCounts::new()),
        (None, None) => (Kind::Other(modality), LabelCounts::new()),
    }
}

/// Labels of a segmentation, without the background, and their numbers of voxels.
fn labels(
    volume: &Volume,
    thinned: &Thinned,
    sorted: &[f64],
    statistics: &Statistics,
) -> Option<(Vec<i64>, LabelCounts)> {
    // A channel of a microscope has no labels, however few its values are.
    let is_whole = [statistics.min, statistics.max].iter().all(|end| end.fract() == 0.0);
    if volume.presets.colour.is_some() || !is_whole || sorted.iter().any(|value| value.fract() != 0.0) {
        return None;
    }
    let is_few = is_few_labels(thinned, sorted, volume.has_labels);
    let may_be_many = volume.bricks.is_none() && (volume.has_labels || volume.modality().is_none());
    if !is_few && !may_be_many {
        return None;
    }
    if !is_few && !volume.has_labels && !regions::may_be_labels(volume) {
        return None;
    }
    // A label may have fewer voxels than the copy tells, and floats may have others than whole numbers.
    let counts = volume.label_counts(MOST_LABELS + 1).ok()?;
    if !is_few && !volume.has_labels && !regions::are_labels(volume, &counts) {
        return None;
    }
    let lowest = counts.keys().next().copied()?;
    let is_object = |label: i64| label != lowest && (lowest >= 0 || !is_background(label, &counts));
    let found: Vec<i64> = counts.keys().copied().filter(|&label| is_object(label)).collect();
    (!found.is_empty()).then_some((found, counts))
}

/// Whether the values are those of a segmentation with few labels: few, and constant over neighbourhoods unless the file says that they
/// are labels.
fn is_few_labels(thinned: &Thinned, sorted: &[f64], are_stated: bool) -> bool {
    let mut distinct: Vec<f64> = Vec::new();
    for &value in sorted {
        if distinct.last().is_none_or(|&last| last < value) {
            distinct.push(value);
            if distinct.len() > FEW_LABELS {
                return false;
            }
        }
    }
    let Some(background) = distinct.first().copied() else { return false };
    // Between surfaces all neighbours of a voxel of a segmentation are alike, and neighbours of other values differ by
    // any number; values of a scan differ by small ones.
    let step = (thinned.values.len() / 50_000).max(1);
    let (mut alike, mut objects) = (0, 0);
    for place in (0..thinned.values.len()).step_by(step) {
        if thinned.values[place] > background {
            objects += 1;
            let own = thinned.values[place];
            // Voxels at a face of the volume have fewer neighbours.
            let (mut all, mut other) = (0, 0);
            for it in thinned.neighbours(place) {
                all += 1;
                other += usize::from((thinned.values[it] - own).abs() > 0.0);
            }
            alike += usize::from(2 * other <= all);
        }
    }
    let is_constant = objects > 0 && count(alike) >= 0.6 * count(objects);
    (is_constant || are_stated) && distinct.len() > 1
}

/// Value of water if the values are those of a CT: air lies 1000 below, and most other voxels near water, unless the file
/// states that they are.
fn water(sorted: &[f64], statistics: &Statistics, is_stated: bool) -> Option<f64> {
    let share = |low: f64, high: f64| {
        let below = |limit: f64| sorted.partition_point(|&value| value < limit);
        count(below(high) - below(low)) / count(sorted.len().max(1))
    };
    let is_ct = |water: f64| {
        let air = share(f64::MIN, water - 800.0);
        let soft = share(water - 150.0, water + 150.0);
        let dense = share(water + 200.0, f64::MAX);
        air > 0.02 && soft > 0.04 && dense > 5e-4 && dense < 0.5 && statistics.max >= water + 300.0
    };
    let candidates: &[f64] = if statistics.min < -200.0 { &[0.0] } else { &[1024.0, 1000.0] };
    let reaches = |water: f64| statistics.min <= water - 800.0 && statistics.max <= 40_000.0;
    candidates.iter().copied().find(|&water| reaches(water) && (is_stated || is_ct(water)))
}
