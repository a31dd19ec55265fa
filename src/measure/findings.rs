//! Conclusions from measured settings, such as the Pareto front and the cheapest setting.

use serde::Serialize;

use super::digits::short;
use super::ladder::Cause;
use super::measured::Measured;
use relume_colour::model::{ErrorSummary, ModelKind};

/// Ratio within which times and errors count as equal; repeated measurements differ by as much.
pub(super) const ALIKE: f64 = 1.05;

/// Marks the Pareto-optimal rows: no other row is as fast and more accurate, or as accurate and faster. Accuracy is
/// the p95 of ΔE00. Of rows equal in both, the first is marked.
pub fn mark_pareto(rows: &mut [Measured]) {
    let points: Vec<[f64; 2]> = rows.iter().map(|row| [row.frame_ms, row.error.delta_e.p95]).collect();
    for (index, row) in rows.iter_mut().enumerate() {
        let point = points[index];
        let beats = |(other_index, other): (usize, &[f64; 2])| {
            let as_good = other.iter().zip(point).all(|(other, own)| *other <= own * ALIKE);
            let better = other.iter().zip(point).any(|(other, own)| *other * ALIKE < own);
            as_good && (better || other_index < index)
        };
        row.pareto = !points.iter().enumerate().any(beats);
    }
}

/// The fastest of `rows` whose p95 of ΔE00 is at most `error`.
#[must_use]
pub fn cheapest(rows: &[Measured], error: f64) -> Option<&Measured> {
    rows.iter().filter(|row| row.error.delta_e.p95 <= error).min_by(|a, b| a.frame_ms.total_cmp(&b.frame_ms))
}

/// Shortest and longest frame time of `row`, in ms.
pub(super) fn span(row: &Measured) -> [f64; 2] {
    let parts = || [Some(row.times.march), Some(row.times.relight), row.times.enlarge].into_iter().flatten();
    [parts().map(|cost| cost.wall_ms.min).sum(), parts().map(|cost| cost.wall_ms.max).sum()]
}

/// Whether every run of `one` was faster than every run of `other`.
pub(super) fn is_faster(one: &Measured, other: &Measured) -> bool {
    span(one)[1] < span(other)[0]
}

/// The fastest of `rows` within `error` that is certainly faster than the first row, the scene's own setting. If there
/// is none, the first row; if the first row exceeds `error`, the fastest row within it.
pub(super) fn cheapest_for_sure(rows: &[Measured], error: f64) -> Option<&Measured> {
    let own = rows.first().filter(|own| own.error.delta_e.p95 <= error);
    let Some(own) = own else { return cheapest(rows, error) };
    let sure = rows.iter().filter(|row| row.error.delta_e.p95 <= error && is_faster(row, own));
    Some(sure.min_by(|one, two| one.frame_ms.total_cmp(&two.frame_ms)).unwrap_or(own))
}

/// The row with the smallest mean ΔE00; the first row if its error counts as equal.
pub(super) fn closest(rows: &[Measured]) -> Option<&Measured> {
    let mean = |row: &Measured| row.error.delta_e.mean;
    let found = rows.iter().min_by(|one, two| mean(one).total_cmp(&mean(two)))?;
    Some(rows.first().filter(|own| mean(own) <= mean(found) * ALIKE).unwrap_or(found))
}

/// Mean ΔE00 caused by the colour model alone: nodes with k = 8 against the best kind of RGB.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NodesBesideRgb {
    /// Error of eight nodes.
    pub nodes: f64,
    /// Error of the best kind of RGB.
    pub rgb: f64,
    /// The best kind of RGB.
    pub best: ModelKind,
    /// All measured kinds of RGB.
    pub of: Vec<ModelKind>,
}

impl NodesBesideRgb {
    /// Compares the two in `rows`; `None` unless both were measured.
    #[must_use]
    pub fn of(rows: &[Measured]) -> Option<Self> {
        let basis = |row: &Measured| Some(by_model(row)?.mean);
        let nodes = carried(rows, |kind, components| kind == ModelKind::Nodes && components == 8).next();
        let rgb = carried(rows, |kind, _| kind.is_rgb());
        let rgb = rgb.filter_map(|row| Some((row.setting.model()?, basis(row)?)));
        Self::found(nodes.and_then(basis)?, rgb.collect())
    }

    /// Compares the error of eight nodes with the smallest of `rgb`; `None` if `rgb` is empty.
    #[must_use]
    pub fn found(nodes: f64, rgb: Vec<(ModelKind, f64)>) -> Option<Self> {
        let &(best, error) = rgb.iter().min_by(|one, two| one.1.total_cmp(&two.1))?;
        Some(Self { nodes, rgb: error, best, of: rgb.into_iter().map(|(kind, _)| kind).collect() })
    }

    /// Ratio of the RGB error to the nodes' error; infinite if the nodes have none.
    #[must_use]
    pub fn ratio(&self) -> f64 {
        self.rgb / self.nodes
    }

    /// The comparison as a sentence.
    #[must_use]
    pub fn sentence(&self) -> String {
        let Self { nodes, rgb, best, .. } = self;
        let tried: Vec<&str> = self.of.iter().map(|kind| kind.name()).collect();
        let times = match self.ratio() {
            ratio if ratio.is_finite() => format!("{} times smaller", short(ratio)),
            _ => "the nodes have no error".to_owned(),
        };
        format!(
            "Eight nodes have a mean ΔE00 of {}; the best of the RGB models ({best}, out of {}) has {}: {times}.",
            short(*nodes),
            tried.join(", "),
            short(*rgb)
        )
    }
}

/// Rows that differ from the scene's own setting only in a named colour model, of a kind and number of components that
/// `are_asked_for`.
pub(super) fn carried(
    rows: &[Measured],
    are_asked_for: impl Fn(ModelKind, usize) -> bool,
) -> impl Iterator<Item = &Measured> {
    let only_model = |row: &&Measured| row.setting.knobs().all(|(knob, _)| ["model", "k"].contains(&knob.name()));
    let is_asked_for =
        move |row: &&Measured| row.setting.model().is_some_and(|kind| are_asked_for(kind, row.components));
    rows.iter().filter(only_model).filter(is_asked_for)
}

/// ΔE00 of a row caused by its colour model alone.
fn by_model(row: &Measured) -> Option<ErrorSummary> {
    row.causes.iter().find(|(cause, _)| *cause == Cause::Basis).map(|(_, difference)| difference.delta_e)
}

/// Ratio of the slowest to the fastest run of a march, median over all rows: the influence of other programs.
pub(super) fn scatter(rows: &[Measured]) -> f64 {
    let mut ratios: Vec<f64> =
        rows.iter().map(|row| row.times.march.wall_ms.max / row.times.march.wall_ms.min).collect();
    ratios.sort_by(f64::total_cmp);
    ratios.get(ratios.len() / 2).copied().unwrap_or(1.0)
}

/// Mean ΔE00 of a row due to `cause`; 0 if the row has no such rung.
pub(super) fn by_cause(row: &Measured, cause: Cause) -> f64 {
    row.causes.iter().find(|(known, _)| *known == cause).map_or(0.0, |(_, difference)| difference.delta_e.mean)
}

/// The cause of the largest part of a row's error.
#[must_use]
pub fn main_cause(row: &Measured) -> Option<Cause> {
    let causes = row.causes.iter().filter(|(_, difference)| difference.delta_e.mean > 0.0);
    causes.max_by(|one, two| one.1.delta_e.mean.total_cmp(&two.1.delta_e.mean)).map(|&(cause, _)| cause)
}

/// Relative half-range of the runs of a march around their median, median over all rows: 0.05 is ±5 %.
pub(super) fn spread(rows: &[Measured]) -> f64 {
    let mut shares: Vec<f64> = rows
        .iter()
        .map(|row| row.times.march.wall_ms)
        .map(|march| (march.max - march.min) / 2.0 / march.median)
        .collect();
    shares.sort_by(f64::total_cmp);
    shares.get(shares.len() / 2).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::super::clock::Summary;
    use super::super::difference::Difference;
    use super::super::measured::{Cost, Times};
    use super::super::setting::Setting;
    use super::*;

    /// A setting with frame times from `fastest` to `slowest`, median `frame_ms`, and errors `mean` and `p95`.
    fn row([fastest, frame_ms, slowest]: [f64; 3], mean: f64, p95: f64) -> Measured {
        let cost = |part: f64| {
            let [median, min, max] = [frame_ms, fastest, slowest].map(|ms| part * ms);
            let wall_ms = Summary { median, min, max };
            Cost { wall_ms, cpu_ms: wall_ms, device_ms: None }
        };
        let times = Times {
            runs: 3,
            upload: cost(9.0),
            march: cost(0.75),
            relight: cost(0.25),
            read_back: cost(9.0),
            enlarge: None,
        };
        Measured {
            setting: Setting::default(),
            level: None,
            carrier: String::new(),
            components: 8,
            times,
            frame_ms,
            dispatches: 1,
            pixel_bytes: 1,
            volume_bytes: 1,
            total_bytes: 1,
            error: Difference { delta_e: ErrorSummary { mean, p95, max: 9.0 }, ..Difference::default() },
            causes: Vec::new(),
            order: None,
            pareto: false,
            worst_by: Vec::new(),
            integration: relume_scene::plan::Integrate::Samples,
            other_integration: false,
            differences: Vec::new(),
            colours: Vec::new(),
        }
    }

    fn found(row: Option<&Measured>) -> Option<f64> {
        row.map(|row| row.frame_ms)
    }

    #[test]
    fn a_frame_takes_its_march_and_its_relight_and_is_faster_where_no_run_overlaps() {
        let [slow, fast, between] = [[8.0, 10.0, 12.0], [5.0, 6.0, 7.0], [6.0, 8.0, 9.0]].map(|ms| row(ms, 1.0, 1.0));
        assert_eq!(span(&slow).map(f64::to_bits), [8.0_f64, 12.0].map(f64::to_bits));
        assert!(is_faster(&fast, &slow));
        assert!(!is_faster(&between, &slow) && !is_faster(&fast, &between), "their runs overlap");
    }

    #[test]
    fn the_own_setting_is_the_cheapest_until_another_is_faster_beyond_doubt() {
        let own = row([8.0, 10.0, 12.0], 0.5, 1.0);
        let doubtful = row([6.0, 8.0, 9.0], 0.5, 1.0);
        let wrong = row([1.0, 2.0, 3.0], 2.0, 4.0);
        let faster = row([5.0, 6.0, 7.0], 0.5, 2.0);
        let rows = [own, doubtful, wrong, faster];
        assert_eq!(found(cheapest_for_sure(&rows, 1.0)), Some(10.0));
        assert_eq!(found(cheapest_for_sure(&rows, 2.0)), Some(6.0));
        assert_eq!(found(cheapest_for_sure(&rows, 0.5)), None, "none is within that");
        assert_eq!(found(cheapest_for_sure(&rows[2..], 2.0)), Some(6.0), "the first is not within it");
    }

    #[test]
    fn the_own_setting_is_the_closest_until_another_is_closer_than_measuring_again_would_be() {
        let [own, alike, closer] = [0.50, 0.49, 0.40].map(|mean| row([1.0, 100.0 * mean, 99.0], mean, 1.0));
        assert_eq!(found(closest(&[own.clone(), alike.clone()])), Some(50.0));
        assert_eq!(found(closest(&[own, alike, closer])), Some(40.0));
        assert_eq!(found(closest(&[])), None);
    }
}
