//! Report of a survey: a self-contained HTML page, and the chart of time against error as SVG.

mod causes;
mod choices;
mod costs;
mod drawing;
mod eight;
mod entry;
mod head;
mod knobs;
mod labels;
mod numbers;
mod pictures;
mod places;
mod trade;
mod trust;
mod verdict;
mod words;

use std::collections::BTreeMap;
use std::fmt::Write as _;

use super::setting::Setting;
use super::survey::{CloseUp, Measured, Survey};
use crate::output::OutputError;
pub use costs::{CostCurve, CostTable, costs_html};
use drawing::escaped;
use eight::Carried;
use entry::entries;
use places::scale_for;
use trust::Trust;

/// Contents of a report besides the survey.
#[derive(Clone, Copy, Debug)]
pub struct Findings<'a> {
    /// Measured settings, the scene's own first.
    pub rows: &'a [Measured],
    /// Refused settings with their reasons.
    pub refused: &'a [(Setting, String)],
    /// Surroundings of the worst pixel of the first row.
    pub close_up: Option<&'a CloseUp>,
    /// Whether the measurement was cancelled.
    pub interrupted: bool,
    /// Stated spectra of the lights, by the lights' names.
    pub spectra: &'a BTreeMap<String, String>,
}

const STYLE: &str = include_str!("style.css");

/// Returns the page: a summary, recommended settings, the value of k = 8, time against error, the knobs one by one,
/// errors by cause, maps of errors, all numbers and a glossary.
///
/// # Errors
///
/// [`OutputError`] if a picture cannot be encoded.
pub fn html(survey: &Survey<'_>, findings: &Findings<'_>) -> Result<String, OutputError> {
    let rows = findings.rows;
    let entries = entries(rows);
    let carried = Carried::of(rows);
    let trust = Trust::of(rows);
    // One scale for all maps, so that they can be compared.
    let shown = rows.first().into_iter().chain(carried.eight).chain(carried.rgb.map(|(row, ..)| row));
    let near = findings.close_up.map_or(&[][..], |close| &close.differences);
    let scale = scale_for(shown.flat_map(|row| &row.differences).chain(near).copied());
    let mut page = String::new();
    // Writing to a String cannot fail.
    let mut section = |head: &str, about: &str, body: &str| {
        if !body.is_empty() {
            let about = if about.is_empty() { String::new() } else { format!("<p class=\"about\">{about}</p>\n") };
            write!(page, "<h2>{head}</h2>\n{about}{body}").ok();
        }
    };
    section("Which setting to use", &choices::about(survey, trust), &choices::choices(survey, &entries, rows, trust));
    if let Some(own) = rows.first() {
        section("What k = 8 buys", "", &eight::eight(survey, &carried, own, scale, trust)?);
    }
    section(
        "Time against error",
        if trust.is_rough() {
            "Each dot is a setting. Lower is closer to the truth; how far left is rough, and which settings are not beaten cannot be \
             told."
        } else {
            "Each dot is a setting. Lower and further left is better: no setting is both faster and closer to the truth (by p95, as \
             drawn; what is within 5 % counts as equal) than those on the line."
        },
        &format!("<div class=\"wide\">\n{}</div>\n", trade::trade(&entries, trust).inline("time against error")),
    );
    section(
        "Knob by knob",
        &format!(
            "One knob turned, all others as the scene has them. Bars are medians from 0, each chart on a scale of its own, whiskers \
             the shortest and the longest run; the {} the scene's own.",
            if trust.is_rough() { "ring is" } else { "ring and the dashed line are" }
        ),
        &knobs::knobs(rows, survey.scene(), trust),
    );
    section(
        "Where the error comes from",
        "From the truth to the picture, one simplification after the other. Left, how far the picture is off; right, how \
         that is shared by how far each simplification moves colours. Parts partly cancel: together they are more than the whole.",
        &causes::causes(&entries),
    );
    if let Some(own) = rows.first() {
        section(
            "Where the error is",
            "The scene's own; the ring is around the worst pixel compared. Colours of ΔE00 are the same on the whole page.",
            &places::places(survey, own, findings.close_up, scale)?,
        );
    }
    let best = if trust.is_rough() { "" } else { " Blue names are those on the line of time against error." };
    section(
        "All numbers",
        &format!(
            "Errors are ΔE00, – where a setting has no such part.{best} relume measure --csv and --json have more digits, and \
             upload and read-back."
        ),
        &numbers::numbers(&entries, trust),
    );
    let refused: String = findings
        .refused
        .iter()
        .map(|(setting, why)| format!("<p>{}: {}</p>\n", escaped(&setting.to_string()), escaped(why)))
        .collect();
    section("Not possible here", "", &refused);
    if findings.interrupted {
        section("Interrupted", "", "<p>These are the settings that were measured before.</p>\n");
    }
    let words = words::words(&page);
    let top = head::head(survey, findings, trust);
    let said = verdict::verdict(survey.scene(), findings, &carried, trust);
    let title = escaped(&choices::title(&survey.scene().name));
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>What accuracy costs: {title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>What accuracy costs: {title}</h1>\n\
         {top}<div class=\"short\">\n{said}</div>\n{page}{words}</body>\n</html>\n"
    ))
}

/// Returns the chart of time against error as a standalone SVG.
#[must_use]
pub fn trade(rows: &[Measured]) -> String {
    trade::trade(&entries(rows), Trust::of(rows)).standalone()
}
