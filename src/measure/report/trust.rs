//! Whether times are reliable enough to choose by; one decision for the whole page.

use crate::digits::short;
use crate::findings::{ALIKE, cheapest_for_sure, closest, is_faster, scatter, span};
use crate::measured::Measured;

/// Ratio between times of the same work above which times are rough.
const SCATTERED: f64 = 1.4;

/// Scatter of repeated times. If it is large, times are rough: they show no setting as faster, choose none, and are
/// marked with ≈.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trust {
    apart: f64,
}

impl Trust {
    /// Scatter of `rows`.
    pub(super) fn of(rows: &[Measured]) -> Self {
        Self { apart: scatter(rows) }
    }

    pub(super) fn is_rough(self) -> bool {
        self.apart > SCATTERED
    }

    /// Ratio between times of the same work, if times are rough.
    pub(super) fn rough(self) -> Option<f64> {
        self.is_rough().then_some(self.apart)
    }

    /// Formats a time.
    pub(super) fn ms(self, ms: f64) -> String {
        format!("{}{}", if self.is_rough() { "≈ " } else { "" }, short(ms))
    }

    /// Formats the frame time of `row` for a table: the median, and the shortest and the longest run.
    pub(super) fn cell(self, row: &Measured) -> String {
        let [least, most] = span(row).map(short);
        self.grey(format!("{} <small>({least}–{most})</small>", self.ms(row.frame_ms)))
    }

    /// Greys out the HTML of a time where times are rough.
    pub(super) fn grey(self, html: String) -> String {
        if self.is_rough() { format!("<span class=\"rough\">{html}</span>") } else { html }
    }

    /// Whether `one` is faster than `other` beyond the spread of times.
    pub(super) fn is_faster(self, one: &Measured, other: &Measured) -> bool {
        !self.is_rough() && is_faster(one, other)
    }

    /// Whether a row is Pareto-optimal; false where times are rough.
    pub(super) fn is_best(self, row: &Measured) -> bool {
        !self.is_rough() && row.pareto
    }

    /// Fastest of `rows` within `error`, by [`cheapest_for_sure`]; `None` where times are rough.
    pub(super) fn cheapest(self, rows: &[Measured], error: f64) -> Option<&Measured> {
        if self.is_rough() { None } else { cheapest_for_sure(rows, error) }
    }

    /// Returns the most accurate row. Among the rows that are as close as the closest by mean, p95 and worst pixel, it
    /// is the fastest one that is certainly faster than the scene's own; failing that, the scene's own if it is as
    /// close, otherwise the closest. Where times are rough, only the last two apply.
    pub(super) fn most_exact(self, rows: &[Measured]) -> Option<&Measured> {
        let best = closest(rows)?;
        let own = rows.first().filter(|own| is_as_close(own, best));
        let fits = |row: &&Measured| {
            is_as_close(row, best) && !self.is_rough() && own.is_none_or(|own| self.is_faster(row, own))
        };
        let fastest = rows.iter().filter(fits).min_by(|one, two| one.frame_ms.total_cmp(&two.frame_ms));
        Some(fastest.or(own).unwrap_or(best))
    }
}

/// Whether `one` has no larger errors than `other` by mean, p95 and worst pixel, up to [`ALIKE`].
pub(super) fn is_as_close(one: &Measured, other: &Measured) -> bool {
    let errors = |row: &Measured| [row.error.delta_e.mean, row.error.delta_e.p95, row.error.delta_e.max];
    errors(one).into_iter().zip(errors(other)).all(|(one, other)| one <= other * ALIKE)
}
