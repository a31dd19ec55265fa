//! The table of all that was measured.

use std::fmt::Write as _;

use super::causes::told_causes;
use super::drawing::escaped;
use super::entry::{Entry, LEAST};
use super::words::meaning;
use crate::measure::findings::span;
use crate::measure::ladder::Cause;
use crate::measure::setting::Knob;
use crate::measure::table::{megabytes, short};

/// A row a measurement, grouped by knob, causes by size.
pub(super) fn numbers(entries: &[Entry<'_>]) -> String {
    let causes = told_causes(entries);
    let head = |name: &str| format!("<th title=\"{}\">{name}</th>", escaped(meaning(name).unwrap_or("")));
    let before = ["frame ms", "bytes/pixel", "mean", "p95", "max"];
    let after = ["at", "march", "relight", "read-back", "upload", "MB"];
    let heads: String =
        before.into_iter().chain(causes.iter().map(|cause| cause.name())).chain(after).map(head).collect();
    let mut table = format!("<div class=\"wide numbers\">\n<table>\n<tr><th class=\"text\">setting</th>{heads}</tr>\n");
    let knob = |entry: &Entry<'_>| entry.row.setting.knobs().next().map(|(knob, _)| knob);
    let mut last: Option<Knob> = None;
    for entry in entries {
        let row = entry.row;
        let (times, error) = (&row.times, &row.error.delta_e);
        let [least, most] = span(row).map(short);
        let parts = causes.iter().map(|&cause| {
            let found = row.causes.iter().find(|(known, _)| *known == cause);
            found.map_or_else(|| "–".to_owned(), |(_, error)| short(error.delta_e.mean))
        });
        let at = row.error.at.map_or_else(|| "–".to_owned(), |[x, y]| format!("{x}, {y}"));
        let [mean, p95, max] = [error.mean, error.p95, error.max].map(short);
        let work = [times.march, times.relight, times.read_back, times.upload].map(|cost| short(cost.wall_ms.median));
        let cells: Vec<String> =
            [format!("{} <small>({least}–{most})</small>", short(row.frame_ms)), row.pixel_bytes.to_string()]
                .into_iter()
                .chain([mean, p95, max])
                .chain(parts)
                .chain([at])
                .chain(work)
                .chain([short(megabytes(row.total_bytes))])
                .map(|cell| format!("<td>{cell}</td>"))
                .collect();
        let best = if row.pareto { " best" } else { "" };
        let group = if knob(entry) == last { "" } else { " group" };
        last = knob(entry);
        let names = escaped(&entry.names());
        writeln!(
            table,
            "<tr class=\"{}\"><td class=\"text\">{names}</td>{}</tr>",
            format!("{best}{group}").trim(),
            cells.concat()
        )
        .ok();
    }
    table.push_str("</table>\n</div>\n");
    let small: Vec<&str> = Cause::ALL
        .into_iter()
        .filter(|cause| !causes.contains(cause))
        .filter(|cause| entries.iter().any(|entry| entry.row.causes.iter().any(|(known, _)| known == cause)))
        .map(Cause::name)
        .collect();
    if !small.is_empty() {
        writeln!(table, "<p class=\"about\">Below {LEAST} on average in every row: {}.</p>", small.join(", ")).ok();
    }
    table
}
