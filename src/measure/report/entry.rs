//! Measured settings and their names on a page.

use super::trust::Trust;
use crate::digits::short;
use crate::findings::span;
use crate::measured::Measured;
use crate::setting::Setting;
use relume_colour::model::ErrorSummary;

/// Name of the scene's own setting.
pub(super) const OWN: &str = "the scene's own";
/// ΔE00 below which a difference is invisible.
pub(super) const INVISIBLE: f64 = 0.5;
/// Note on cubic interpolation where the scene does not use it.
pub(super) const CUBIC: &str =
    "cubic is a different reconstruction of the data, not a worse one: the truth uses the scene's interpolation.";
/// ΔE00 below which a page does not distinguish errors.
pub(super) const LEAST: f64 = 1e-3;

/// A measurement and its settings.
pub(super) struct Entry<'a> {
    pub(super) row: &'a Measured,
    /// Settings that are equivalent to the row's under another name; all share one measurement.
    pub(super) also: Vec<&'a Setting>,
}

/// Returns every measurement once, the scene's own first.
pub(super) fn entries(rows: &[Measured]) -> Vec<Entry<'_>> {
    let mut found: Vec<Entry<'_>> = Vec::new();
    for row in rows {
        // Equal times identify a shared measurement, because no two measurements have all times equal.
        match found.iter_mut().find(|known| known.row.times == row.times) {
            Some(known) => known.also.push(&row.setting),
            None => found.push(Entry { row, also: Vec::new() }),
        }
    }
    found
}

/// Name of a setting.
pub(super) fn name(setting: &Setting) -> String {
    if setting.knobs().next().is_none() { OWN.to_owned() } else { setting.to_string() }
}

impl Entry<'_> {
    pub(super) fn name(&self) -> String {
        name(&self.row.setting)
    }

    /// Name with its aliases.
    pub(super) fn names(&self) -> String {
        let also: Vec<String> = self.also.iter().map(ToString::to_string).collect();
        if also.is_empty() { self.name() } else { format!("{} (also {})", self.name(), also.join(", ")) }
    }

    /// Tooltip text.
    pub(super) fn described(&self, trust: Trust) -> String {
        let error = &self.row.error.delta_e;
        let ms = trust.ms(self.row.frame_ms);
        let [mean, p95, max] = [error.mean, error.p95, error.max].map(told_error);
        let [least, most] = span(self.row).map(short);
        format!("{}: {ms} ms ({least} to {most}), ΔE00 {mean} on average, p95 {p95}, at most {max}", self.names())
    }
}

/// Formats a ΔE00, or states that it is below [`LEAST`].
pub(super) fn told_error(error: f64) -> String {
    if error < LEAST { format!("< {LEAST}") } else { short(error) }
}

/// Describes how visible an error is.
pub(super) fn seen(error: &ErrorSummary) -> String {
    let worst = || format!("; worst {}", short(error.max));
    match error.p95 {
        // Compares the rounded text: an error printed as 0.50 is not below 0.5.
        _ if error.max < INVISIBLE - 0.005 => "invisible".to_owned(),
        p95 if p95 < INVISIBLE => format!("not visible in 95 % of the pixels{}", worst()),
        p95 if p95 < 1.0 => format!("hardly visible in 95 % of the pixels{}", worst()),
        p95 if p95 < 2.0 => "visible side by side".to_owned(),
        p95 if p95 < 4.0 => "visible at a glance".to_owned(),
        _ => "visible at once".to_owned(),
    }
}
