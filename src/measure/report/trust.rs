//! Whether times can be chosen by: decided once, and all that the page says of times goes by it.

use crate::measure::findings::{ALIKE, cheapest_for_sure, closest, is_faster, scatter, span};
use crate::measure::survey::Measured;
use crate::measure::table::short;

/// Times of the same thing that differ by more than this are rough.
const SCATTERED: f64 = 1.4;

/// How far times of the same thing were apart. Where that is far, times are rough: nothing is called faster by them, nothing
/// is chosen by them, and each stands behind a ≈.
#[derive(Clone, Copy, Debug)]
pub(super) struct Trust {
    apart: f64,
}

impl Trust {
    /// That of `rows`.
    pub(super) fn of(rows: &[Measured]) -> Self {
        Self { apart: scatter(rows) }
    }

    pub(super) fn is_rough(self) -> bool {
        self.apart > SCATTERED
    }

    /// How many times as long the same took, where times are rough.
    pub(super) fn rough(self) -> Option<f64> {
        self.is_rough().then_some(self.apart)
    }

    /// A time.
    pub(super) fn ms(self, ms: f64) -> String {
        format!("{}{}", if self.is_rough() { "≈ " } else { "" }, short(ms))
    }

    /// What a frame of `row` took, for a cell of a table: the median, and the shortest and the longest run.
    pub(super) fn cell(self, row: &Measured) -> String {
        let [least, most] = span(row).map(short);
        self.grey(format!("{} <small>({least}–{most})</small>", self.ms(row.frame_ms)))
    }

    /// HTML of a time, in grey where times are rough.
    pub(super) fn grey(self, html: String) -> String {
        if self.is_rough() { format!("<span class=\"rough\">{html}</span>") } else { html }
    }

    /// Whether `one` is faster than `other` beyond doubt.
    pub(super) fn is_faster(self, one: &Measured, other: &Measured) -> bool {
        !self.is_rough() && is_faster(one, other)
    }

    /// Whether no other row beats this one.
    pub(super) fn is_best(self, row: &Measured) -> bool {
        !self.is_rough() && row.pareto
    }

    /// The fastest of `rows` within `error`, as [`cheapest_for_sure`] has it; nothing where times are rough.
    pub(super) fn cheapest(self, rows: &[Measured], error: f64) -> Option<&Measured> {
        if self.is_rough() { None } else { cheapest_for_sure(rows, error) }
    }

    /// Of the rows that are as close as the closest by mean, p95 and worst, the fastest that is faster than the scene's own
    /// beyond doubt; else that, where it is as close; else the closest where times are rough, and the fastest where not.
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

/// Whether `one` errs no more than `other` by mean, p95 and worst.
pub(super) fn is_as_close(one: &Measured, other: &Measured) -> bool {
    let errors = |row: &Measured| [row.error.delta_e.mean, row.error.delta_e.p95, row.error.delta_e.max];
    errors(one).into_iter().zip(errors(other)).all(|(one, other)| one <= other * ALIKE)
}
