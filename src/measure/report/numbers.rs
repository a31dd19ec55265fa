//! Table of all measurements.

use std::fmt::Write as _;

use super::causes::told_causes;
use super::drawing::escaped;
use super::entry::{Entry, LEAST, told_error};
use super::trust::Trust;
use super::words::meaning;
use crate::digits::{megabytes, short};
use crate::ladder::Cause;
use crate::setting::Knob;

/// Table with a row per measurement, grouped by knob: time, memory and errors first, then the mean by cause, then the
/// rest.
pub(super) fn numbers(entries: &[Entry<'_>], trust: Trust) -> String {
    let causes = told_causes(entries);
    let head = |name: &str| format!("<th title=\"{}\">{name}</th>", escaped(meaning(name).unwrap_or("")));
    let heads = |names: &[&str]| names.iter().map(|name| head(name)).collect::<String>();
    let (before, after) = (["frame ms", "MB", "bytes/pixel", "mean", "p95", "max"], ["at", "march", "relight"]);
    let names: Vec<&str> = causes.iter().map(|cause| cause.name()).collect();
    let above = match names.len() {
        0 => String::new(),
        number => format!(
            "<tr><td colspan=\"{}\"></td><th class=\"by\" colspan=\"{number}\">mean by cause</th></tr>\n",
            1 + before.len()
        ),
    };
    let mut table = format!(
        "<div class=\"wide numbers\">\n<table>\n<thead>\n{above}<tr><th class=\"text\">setting</th>{}{}{}</tr>\n</thead>\n",
        heads(&before),
        heads(&names),
        heads(&after)
    );
    let knob = |entry: &Entry<'_>| entry.row.setting.knobs().next().map(|(knob, _)| knob);
    let mut last: Option<Knob> = None;
    for entry in entries {
        let row = entry.row;
        let (times, error) = (&row.times, &row.error.delta_e);
        let parts = causes.iter().map(|&cause| {
            let found = row.causes.iter().find(|(known, _)| *known == cause);
            found.map_or_else(|| "–".to_owned(), |(_, error)| escaped(&told_error(error.delta_e.mean)))
        });
        let at = row.error.at.map_or_else(|| "–".to_owned(), |[x, y]| format!("{x}, {y}"));
        let errors = [error.mean, error.p95, error.max].map(|error| escaped(&told_error(error)));
        let work = [times.march, times.relight].map(|cost| trust.grey(short(cost.wall_ms.median)));
        let cells: String = [trust.cell(row), short(megabytes(row.total_bytes)), row.pixel_bytes.to_string()]
            .into_iter()
            .chain(errors)
            .chain(parts)
            .chain([at])
            .chain(work)
            .map(|cell| format!("<td>{cell}</td>"))
            .collect();
        let best = if trust.is_best(row) { " best" } else { "" };
        let group = if knob(entry) == last { "" } else { " group" };
        last = knob(entry);
        let names = escaped(&entry.names());
        writeln!(
            table,
            "<tr class=\"{}\"><td class=\"text\">{names}</td>{cells}</tr>",
            format!("{best}{group}").trim()
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
