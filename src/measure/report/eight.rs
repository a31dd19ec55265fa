//! Effect of the dimension of the colour model: a table, and pictures next to the truth.

use std::fmt::Write as _;

use super::drawing::escaped;
use super::entry::{OWN, seen, told_error};
use super::pictures::Scale;
use super::places::{Figure, mosaic};
use super::trust::Trust;
use crate::digits::short;
use crate::findings::{by_cause, carried};
use crate::ladder::Cause;
use crate::measured::Measured;
use crate::setting::Value;
use crate::survey::Survey;
use relume_base::number::count;
use relume_colour::model::ModelKind;
use relume_document::output::OutputError;
use relume_scene::StoreAs;

/// Rows that change only the colour model and its dimension.
pub(super) struct Carried<'a> {
    rows: Vec<(String, &'a Measured)>,
    pub(super) eight: Option<&'a Measured>,
    /// The RGB row with the smallest p95, its model, and the number of RGB rows.
    pub(super) rgb: Option<(&'a Measured, ModelKind, usize)>,
}

impl<'a> Carried<'a> {
    pub(super) fn of(rows: &'a [Measured]) -> Self {
        let p95 = |row: &Measured| row.error.delta_e.p95;
        let all: Vec<&Measured> = carried(rows, |kind, _| kind.is_rgb()).collect();
        let best = all.iter().copied().min_by(|one, two| p95(one).total_cmp(&p95(two)));
        let rgb = best.and_then(|row| Some((row, row.setting.model()?, all.len())));
        let own = rows.first();
        let is_own = |row: &Measured| own.is_some_and(|own| own.times == row.times);
        let mut found: Vec<(String, &Measured)> = Vec::new();
        found.extend(rgb.map(|(row, kind, _)| (format!("RGB ({kind})"), row)));
        let fewer = [3, 4, 6, 8].into_iter().filter_map(|k| Some((k, nodes(rows, k)?)));
        found.extend(fewer.map(|(k, row)| {
            let own = if is_own(row) { format!(" ({OWN})") } else { String::new() };
            (format!("k = {k}{own}"), row)
        }));
        let known = found.iter().any(|(_, row)| is_own(row));
        found.extend(own.filter(|_| !known).map(|row| (own_name(row), row)));
        Self { rows: found, eight: nodes(rows, 8), rgb }
    }
}

/// Short name of the scene's own row.
fn own_name(own: &Measured) -> String {
    if own.carrier.starts_with("weights") {
        format!("{OWN}: weights")
    } else {
        format!("{OWN}: k = {}", own.components)
    }
}

/// Row of `k` nodes, with the model named or as the scene has it.
fn nodes(rows: &[Measured], k: usize) -> Option<&Measured> {
    let named = |row: &&Measured| row.setting.get("k") == Some(Value::Number(count(k)));
    let alone = rows.iter().filter(|row| row.setting.knobs().count() == 1).find(named);
    alone
        .filter(|row| row.components == k)
        .or_else(|| carried(rows, |kind, n| kind == ModelKind::Nodes && n == k).next())
}

/// Explains the bytes per pixel: coefficients per light position, and transmittance. `None` for material weights.
fn kept_as(row: &Measured, storage: StoreAs) -> Option<String> {
    let number = if storage == StoreAs::Half { 2 } else { 4 };
    let padded = row.components.next_multiple_of(4);
    let bytes = usize::try_from(row.pixel_bytes).ok()?;
    let (vectors, rest) = (bytes / (padded * number), bytes % (padded * number));
    let (what, sum) = match rest {
        // Coloured transmittance has as many components.
        0 => ("and k numbers of transmittance", format!("{vectors} × {padded} × {number}")),
        // Grey transmittance is one number.
        4 => ("and one number of transmittance", format!("{vectors} × {padded} × {number} + 4")),
        _ => return None,
    };
    let spectral = !row.carrier.starts_with("weights");
    spectral.then(|| {
        format!(
            "Bytes: a pixel stores k numbers per light position, {what}; k is rounded up to a multiple of 4, and a number \
             has {number} bytes. For k = {}: {sum} = {bytes}.",
            row.components
        )
    })
}

/// Section on k = 8: the scene's own dimension and the reason for 8, a table row per dimension, and pictures. Empty if
/// there are no other rows than the scene's own.
pub(super) fn eight(
    survey: &Survey<'_>,
    found: &Carried<'_>,
    own: &Measured,
    scale: Scale,
    trust: Trust,
) -> Result<String, OutputError> {
    if found.rows.len() < 2 {
        return Ok(String::new());
    }
    let scene = survey.scene();
    let has = match scene.accuracy.dimension {
        _ if own.carrier.starts_with("weights") => {
            "This scene stores material weights, which are exact under every light. With coloured absorption, k coefficients \
             of a colour model represent spectra instead"
                .to_owned()
        }
        Some(k) => format!("This scene states k = {k}"),
        None => format!(
            "This scene uses k = {}: with it, the model alone changes no spectrum of the scene's materials by more than \
             ΔE00 {} (the scene's tolerance), and the picture by less",
            own.components,
            relume_base::number::readable(scene.accuracy.tolerance)
        ),
    };
    let why = if own.components == 8 && !own.carrier.starts_with("weights") {
        "."
    } else {
        "; 8 is the usual k for comparisons of models."
    };
    let mut text = format!(
        "<p class=\"about\">{has}{why} The rows below change only the colour model.</p>\n<div class=\"wide\"><table>\n<tr><th class=\"text\">represented as</th>\
         <th title=\"95th percentile of ΔE00\">p95</th><th class=\"text\">visibility</th><th title=\"Mean ΔE00\">mean</th>\
         <th title=\"Mean ΔE00 of the representation alone, without step and other causes\">by this alone</th>\
         <th>ms</th><th title=\"Bytes of a finished pixel\">bytes/pixel</th></tr>\n"
    );
    for (name, row) in &found.rows {
        let error = &row.error.delta_e;
        let [p95, mean] = [error.p95, error.mean].map(short);
        let ms = trust.grey(trust.ms(row.frame_ms));
        let alone = escaped(&told_error(by_cause(row, Cause::Basis)));
        writeln!(
            text,
            "<tr><td class=\"text\">{}</td><td>{p95}</td><td class=\"text\">{}</td><td>{mean}</td><td>{alone}</td><td>{ms}</td><td>{}</td></tr>",
            escaped(name),
            seen(error),
            row.pixel_bytes
        )
        .ok();
    }
    text.push_str("</table></div>\n");
    let kept = found.eight.filter(|_| !own.carrier.starts_with("weights")).unwrap_or(own);
    if let Some(kept) = kept_as(kept, scene.accuracy.storage) {
        writeln!(text, "<p class=\"about\">{kept}</p>").ok();
    }
    if let (Some(eight), Some((rgb, kind, _))) = (found.eight, found.rgb) {
        let rgb_name = format!("RGB ({kind})");
        let of_colours = |colours, caption: &str| Figure::of_colours(survey, colours, caption);
        let of_differences = |row: &Measured, caption: &str| {
            Figure::of_differences(survey, &row.differences, scale, &format!("ΔE00 of {caption}"))
        };
        let cells = [
            of_colours(survey.truth(), "the truth")?.html(250, None),
            of_colours(&eight.colours, "k = 8")?.html(250, None),
            of_colours(&rgb.colours, &rgb_name)?.html(250, None),
            format!("<div>{}</div>", scale.html(250.0)),
            of_differences(eight, "k = 8")?.html(250, None),
            of_differences(rgb, &rgb_name)?.html(250, None),
        ];
        write!(
            text,
            "<div class=\"keep\">\n<p>The compared pixels{}:</p>\n<div class=\"thirds\">\n{}</div>\n</div>\n",
            mosaic(survey),
            cells.concat()
        )
        .ok();
    }
    Ok(text)
}
