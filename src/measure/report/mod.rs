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

use super::measured::{CloseUp, Measured};
use super::setting::Setting;
use super::survey::Survey;
pub use costs::{CostCurve, CostTable, costs_html};
use drawing::escaped;
use eight::Carried;
use entry::entries;
use places::scale_for;
use relume_document::output::OutputError;
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
    /// HTML of the scene as a page that relights, or the reason why there is none; empty for none.
    pub relit: &'a str,
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
        section("Effect of k = 8", "", &eight::eight(survey, &carried, own, scale, trust)?);
    }
    section(
        "Time against error",
        if trust.is_rough() {
            "Each dot is a setting. Lower is closer to the truth; the times are rough, so there is no Pareto front."
        } else {
            "Each dot is a setting. Lower and further left is better. The line is the Pareto front: no setting is both faster and \
             closer to the truth (by p95; errors within 5 % count as equal)."
        },
        &format!("<div class=\"wide\">\n{}</div>\n", trade::trade(&entries, trust).inline("time against error")),
    );
    section(
        "Knob by knob",
        &format!(
            "One knob changed, all others as in the scene. Bars are median times from 0, whiskers the shortest and the longest run; \
             each chart has its own scale. The {} the scene's own.",
            if trust.is_rough() { "ring marks" } else { "ring and the dashed line mark" }
        ),
        &knobs::knobs(rows, survey.scene(), trust),
    );
    section(
        "Where the error comes from",
        "From the truth to the picture, one simplification after the other. Left: the error of the picture. Right: the colour \
         changes of the simplifications as shares. Parts partly cancel, so their sum exceeds the total.",
        &causes::causes(&entries),
    );
    if let Some(own) = rows.first() {
        section(
            "Where the error is",
            "The scene's own setting; the ring marks the worst compared pixel. All maps on the page have the same ΔE00 scale.",
            &places::places(survey, own, findings.close_up, scale)?,
        );
    }
    section(
        "Under any light",
        "The errors above are for one light. Here the same scene is mixed anew: its lights, standard lights, and drawn spectra.",
        findings.relit,
    );
    let best = if trust.is_rough() { "" } else { " Blue: settings on the Pareto front of time against error." };
    section(
        "All numbers",
        &format!(
            "Errors are ΔE00; – marks a cause that a setting does not have.{best} relume measure --csv and --json print more digits, \
             and the times of upload and read-back."
        ),
        &numbers::numbers(&entries, trust),
    );
    let refused: String = findings
        .refused
        .iter()
        .map(|(setting, why)| format!("<p>{}: {}</p>\n", escaped(&setting.to_string()), escaped(why)))
        .collect();
    section("Refused settings", "", &refused);
    if findings.interrupted {
        section("Interrupted", "", "<p>Only the finished settings are listed.</p>\n");
    }
    let words = words::words(&page);
    let top = head::head(survey, findings, trust);
    let said = verdict::verdict(survey.scene(), findings, &carried, trust);
    let title = escaped(&choices::title(&survey.scene().name));
    Ok(format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>Cost of accuracy: {title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>Cost of accuracy: {title}</h1>\n\
         {top}<div class=\"short\">\n{said}</div>\n{page}{words}</body>\n</html>\n"
    ))
}

/// Returns the chart of time against error as a standalone SVG.
#[must_use]
pub fn trade(rows: &[Measured]) -> String {
    trade::trade(&entries(rows), Trust::of(rows)).standalone()
}
