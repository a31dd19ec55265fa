//! The report of a survey: one page that needs nothing else, and the trade as a picture.

mod charts;
mod costs;
mod drawing;
mod pictures;

use std::fmt::Write as _;

use super::findings::{NodesBesideRgb, cheapest, main_cause};
use super::ladder::Cause;
use super::setting::{Knob, Setting};
use super::survey::{CloseUp, Measured, Survey};
use super::table::{megabytes, short};
use crate::number::count;
use crate::output::OutputError;
pub use costs::{CostCurve, CostTable, costs_html};
use drawing::escaped;
use pictures::{Picture, SCALE, heat};

/// What a report is about, beside the survey.
#[derive(Clone, Copy, Debug)]
pub struct Findings<'a> {
    /// The settings that were measured, the scene's own first.
    pub rows: &'a [Measured],
    /// Those that cannot be, and why.
    pub refused: &'a [(Setting, String)],
    /// The surroundings of the worst pixel of the first row.
    pub close_up: Option<&'a CloseUp>,
    /// Whether somebody stopped it.
    pub interrupted: bool,
}

/// ΔE00 that the page names the cheapest setting for.
const LIMITS: [f64; 5] = [0.5, 1.0, 2.0, 4.0, 8.0];

const STYLE: &str = "\
:root{color-scheme:light dark;--paper:#fff;--ink:#1c1c1c;--soft:#5f6368;--grid:#e6e6e6;--axis:#9a9a9a;--accent:#0b62c4;--dot:#b4b8bd;--card:#f6f7f9}
@media(prefers-color-scheme:dark){:root{--paper:#15171a;--ink:#e8e8e8;--soft:#a0a6ad;--grid:#2b2f34;--axis:#666c73;--accent:#69a9f5;--dot:#565c63;--card:#1e2126}}
body{background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,'DejaVu Sans',Helvetica,Arial,sans-serif;margin:0 auto;max-width:900px;padding:24px}
h1{font-size:24px;margin:0}h2{font-size:18px;margin:36px 0 6px}p{margin:6px 0}.about{color:var(--soft)}
.short{background:var(--card);border-radius:10px;padding:14px 18px;margin:18px 0}
svg{max-width:100%;height:auto;font:12px system-ui,'DejaVu Sans',Helvetica,Arial,sans-serif}
.paper{fill:var(--paper)}.ink{fill:var(--ink)}.soft{fill:var(--soft)}.grid{stroke:var(--grid)}.axis{stroke:var(--axis)}
.accent{fill:var(--accent)}.front{fill:none;stroke:var(--accent);stroke-width:2}.dot{fill:var(--dot)}.own{fill:none;stroke:var(--ink);stroke-width:1.6}
.curve{fill:none;stroke:var(--accent);stroke-width:1.8}.ring{fill:none;stroke:var(--accent);stroke-opacity:.6}.faint{fill:none;stroke:var(--accent);stroke-opacity:.3}.time{fill:var(--dot)}.level{stroke:var(--axis);stroke-dasharray:4 3}
.curves{display:grid;grid-template-columns:repeat(auto-fit,minmax(380px,1fr));gap:16px}
.pictures{display:flex;flex-wrap:wrap;gap:16px}figure{margin:0}figcaption{color:var(--soft);font-size:13px}
img{image-rendering:pixelated;display:block}
.wide{overflow-x:auto}table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums}
th,td{padding:3px 9px;text-align:right;border-bottom:1px solid var(--grid);white-space:nowrap}th:first-child,td:first-child{text-align:left}
dl{display:grid;grid-template-columns:max-content 1fr;gap:4px 16px;margin:8px 0}dt{font-weight:600}dd{margin:0}
tr.best td:first-child{font-weight:600;color:var(--accent)}";

/// The page: what was found in short, time against error, a curve per knob, errors by cause, where they are, all numbers.
///
/// # Errors
///
/// [`OutputError`] for pictures that cannot be.
pub fn html(survey: &Survey<'_>, findings: &Findings<'_>) -> Result<String, OutputError> {
    let rows = findings.rows;
    let [width, height] = survey.lattice().size;
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>What accuracy costs: {source}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>What accuracy costs: {source}</h1>\n\
         <p class=\"about\">{device}; pictures of {width}×{height} pixels; errors in {} of them, against the full spectrum in f64. \
         Relume {}.</p>\n",
        survey.pixels().len(),
        env!("CARGO_PKG_VERSION"),
        source = escaped(&survey.scene().source),
        device = escaped(&survey.device()),
    );
    // Writing to a String cannot fail.
    let mut section = |head: &str, about: &str, body: &str| {
        let head = if head.is_empty() { String::new() } else { format!("<h2>{head}</h2>\n") };
        let about = if about.is_empty() { String::new() } else { format!("<p class=\"about\">{about}</p>\n") };
        write!(page, "{head}{about}{body}").ok();
    };
    let sentences: Vec<String> = sentences(findings).iter().map(|text| format!("<p>{}</p>\n", escaped(text))).collect();
    section("", "", &format!("<div class=\"short\">\n{}</div>\n", sentences.concat()));
    section(
        "Which setting to use",
        "The fastest of those measured whose ΔE00 is within a limit in 95 of 100 pixels. \
         1 can just be seen side by side, 2 to 4 at a glance. What is named goes into the [accuracy] of the scene, all else \
         staying as it is; relume render --max-error 1 looks for such a setting itself, also between these.",
        &choices(rows),
    );
    section("What the words mean", "", &words());
    section(
        "Time against error",
        "Each dot is a setting; rest the pointer on it to read it. No setting is both faster and \
         closer to the truth than those on the line. Lower and further left is better.",
        &charts::trade(rows).inline("time against error"),
    );
    let curves: Vec<String> =
        Knob::ALL.into_iter().filter_map(|knob| Some(charts::curve(rows, knob)?.inline(knob.name()))).collect();
    if !curves.is_empty() {
        section(
            "Knob by knob",
            "One knob turned, all others as the scene has them: error above, time below.",
            &format!("<div class=\"curves\">\n{}</div>\n", curves.concat()),
        );
    }
    section(
        "Where the error comes from",
        "Rung by rung from the truth to the picture: each part is how much one thing alone \
         moves colours. Parts may cancel, so that a picture can be closer to the truth than their sum.",
        &charts::causes(rows).inline("error by cause"),
    );
    if let Some(own) = rows.first() {
        section(
            "Where the error is",
            &format!(
                "{}. Colours are those of the truth and of the device.",
                escaped(&capital(&own.setting.to_string()))
            ),
            &places(survey, own, findings.close_up)?,
        );
    }
    section(
        "All numbers",
        "Times are medians on the wall; a frame is a march and a relight. No other setting beats those in \
         colour.",
        &numbers(rows),
    );
    if !findings.refused.is_empty() {
        let refused = findings
            .refused
            .iter()
            .map(|(setting, why)| format!("<p>{}: {}</p>\n", escaped(&setting.to_string()), escaped(why)));
        section("Not possible here", "", &refused.collect::<String>());
    }
    if findings.interrupted {
        section("", "Interrupted: these are the settings that were measured before.", "");
    }
    page.push_str("</body>\n</html>\n");
    Ok(page)
}

/// Time against error as a drawing by itself, in SVG.
#[must_use]
pub fn trade(rows: &[Measured]) -> String {
    charts::trade(rows).standalone()
}

fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or_else(String::new, |first| first.to_uppercase().chain(letters).collect())
}

/// What was found, in short.
fn sentences(findings: &Findings<'_>) -> Vec<String> {
    let rows = findings.rows;
    let mut sentences = Vec::new();
    if let Some(own) = rows.first() {
        let error = &own.error.delta_e;
        sentences.push(format!(
            "{}, a frame takes {} ms here, and colours are off by ΔE00 {} on average, by at most {} in 95 of 100 pixels, and by {} in the worst.",
            capital(&own.setting.to_string()),
            short(own.frame_ms),
            short(error.mean),
            short(error.p95),
            short(error.max)
        ));
        if let Some(cause) = main_cause(own) {
            let share = own.causes.iter().find(|(known, _)| *known == cause);
            let share = share.map_or(0.0, |(_, error)| error.delta_e.mean);
            let order = own.order.filter(|_| cause == Cause::Step).map_or_else(String::new, |order| {
                format!(" Half the step leaves {} of that error (order {order:.1}).", fraction(order))
            });
            sentences.push(format!(
                "Most of it, {} on average, comes from {}: {}.{order}",
                short(share),
                cause.name(),
                way_out(cause)
            ));
        }
    }
    sentences.extend(advice(rows));
    sentences.extend(NodesBesideRgb::of(rows).map(|found| found.bought()));
    if rows.first().is_some_and(|own| own.carrier.starts_with("weights")) {
        sentences.push(
            "This scene keeps weights of its materials, which are exact under every light: what carries spectra adds no error."
                .to_owned(),
        );
    }
    sentences
}

/// Which setting keeps what can just be seen side by side.
fn advice(rows: &[Measured]) -> Option<String> {
    const SEEN: f64 = 1.0;
    let own = rows.first()?;
    if own.error.delta_e.p95 <= SEEN {
        return Some(format!(
            "There is nothing to change: that is within ΔE00 {SEEN}, which can just be seen side by side, in 95 of 100 pixels."
        ));
    }
    let found = cheapest(rows, SEEN)?;
    Some(format!(
        "To be within ΔE00 {SEEN}, which can just be seen side by side, in 95 of 100 pixels, take {}: {} ms a frame, {:.1} times as \
         long.",
        found.setting,
        short(found.frame_ms),
        found.frame_ms / own.frame_ms
    ))
}

/// The page's words for whoever has not met them.
fn words() -> String {
    const WORDS: [(&str, &str); 7] = [
        (
            "ΔE00",
            "how different two colours look (CIEDE2000): below 0.5 nobody sees it, 1 can just be seen side by side",
        ),
        ("mean, p95, max", "on average over the pixels; what 95 of 100 pixels are within; in the worst of them"),
        ("the truth", "the same scene with all 81 wavelengths, exact arithmetic and steps too short to matter"),
        (
            "step",
            "how far apart light looks at the volume along a ray, in voxels: what is thinner is missed; half the step takes up to \
             twice the time",
        ),
        (
            "weights",
            "a pixel keeps how much it shows of each material. That is exact under every light, but only where all wavelengths are \
             absorbed alike",
        ),
        (
            "k, basis",
            "where a pixel keeps no weights it keeps k numbers in place of 81 wavelengths; the basis is how they stand for them. \
             Nodes, the usual one, are k wavelengths chosen for the scene; rgb is what renderers without spectra do",
        ),
        (
            "the scene's own",
            "the setting of the scene file; every other row differs from it in what is named, and in nothing else",
        ),
    ];
    let row = |(word, meaning): (&str, &str)| format!("<dt>{word}</dt><dd>{meaning}.</dd>\n");
    format!("<dl>\n{}</dl>\n", WORDS.map(row).concat())
}

/// What half a step leaves of an error of this order, in words.
fn fraction(order: f64) -> String {
    format!("{:.0} %", 100.0 * 0.5_f64.powf(order))
}

fn way_out(cause: Cause) -> &'static str {
    match cause {
        Cause::Step => "samples are that far apart; a shorter accuracy.step costs time in proportion",
        Cause::Interpolation => "values between voxels are made otherwise than the scene says",
        Cause::Termination => "rays end early; a smaller accuracy.termination follows them further",
        Cause::Basis => "spectra are carried in few numbers; more of them (accuracy.k) carry them better",
        Cause::Tables => "tables and textures are rounded; more transfer.entries and f32 storage round less",
        Cause::Rounding => "arithmetic is in f32",
        Cause::Device => "the device filters and rounds in its own way",
        Cause::Resolution => "fewer pixels are marched than shown",
    }
}

fn choices(rows: &[Measured]) -> String {
    let mut table =
        "<table>\n<tr><th>ΔE00 within</th><th>setting</th><th>ms</th><th>p95</th><th>max</th></tr>\n".to_owned();
    for limit in LIMITS {
        let cells = match cheapest(rows, limit) {
            Some(row) => format!(
                "<td>{}</td><td>{}</td><td>{}</td><td>{}</td>",
                escaped(&row.setting.to_string()),
                short(row.frame_ms),
                short(row.error.delta_e.p95),
                short(row.error.delta_e.max)
            ),
            None => "<td>none of those measured</td><td></td><td></td><td></td>".to_owned(),
        };
        writeln!(table, "<tr><td>{limit}</td>{cells}</tr>").ok();
    }
    table + "</table>\n"
}

/// The map of ΔE00, and its worst pixel enlarged.
fn places(survey: &Survey<'_>, own: &Measured, close_up: Option<&CloseUp>) -> Result<String, OutputError> {
    let dims = survey.lattice().dims();
    let looked_at = survey.lattice().pixels();
    let at = |pixel: &[usize; 2]| survey.pixels().iter().position(|shown| shown == pixel);
    let found: Vec<Option<usize>> = looked_at.iter().map(at).collect();
    let colour = |colours: &[glam::DVec3], i: &Option<usize>| {
        i.and_then(|i| colours.get(i)).copied().unwrap_or_else(|| survey.background())
    };
    let truth = Picture::of_colours(dims, found.iter().map(|i| colour(survey.truth(), i)))?;
    let map = Picture::of_differences(dims, found.iter().map(|i| i.and_then(|i| own.differences.get(i).copied())))?;
    let figure = |picture: &Picture, [width, height]: [usize; 2], caption: &str| {
        format!(
            "<figure><img alt=\"{caption}\" width=\"{width}\" height=\"{height}\" src=\"data:image/png;base64,{}\"><figcaption>{caption}</figcaption></figure>\n",
            picture.base64
        )
    };
    let enlarged = |dims: [usize; 2], most: usize| {
        let times = (most / dims[0].max(dims[1])).max(1);
        dims.map(|side| side * times)
    };
    let shown = enlarged(dims, 400);
    let stride = survey.lattice().stride;
    let every = if stride == 1 { String::new() } else { format!(", every {stride} pixels") };
    let mut text = format!(
        "<div class=\"pictures\">\n{}{}</div>\n{}",
        figure(&truth, shown, &format!("the truth{every}")),
        figure(&map, shown, "ΔE00 (grey: shows nothing)"),
        legend()
    );
    if let (Some(close), Some([x, y])) = (close_up, own.error.at) {
        let dims = [close.side; 2];
        let shown = enlarged(dims, 260);
        let pictures = [
            (Picture::of_colours(dims, close.truth.iter().copied())?, "the truth"),
            (Picture::of_colours(dims, close.shown.iter().copied())?, "the device"),
            (Picture::of_differences(dims, close.differences.iter().copied().map(Some))?, "ΔE00"),
        ];
        let figures: String = pictures.iter().map(|(picture, caption)| figure(picture, shown, caption)).collect();
        write!(
            text,
            "<p>The worst of them, pixel {x}, {y}, with ΔE00 {}, and what is around it:</p>\n<div class=\"pictures\">\n{figures}</div>\n",
            short(own.error.delta_e.max)
        )
        .ok();
    }
    Ok(text)
}

/// The scale of the maps.
fn legend() -> String {
    const PARTS: usize = 60;
    let [low, high] = SCALE.map(f64::log10);
    let mut drawing = drawing::Drawing::new(400.0, 36.0);
    for (i, x) in drawing::middles(PARTS, 10.0, 360.0).enumerate() {
        let share = (count(i) + 0.5) / count(PARTS);
        let [red, green, blue] = heat(10_f64.powf((high - low).mul_add(share, low)));
        let colour = format!("#{red:02x}{green:02x}{blue:02x}");
        drawing.bar([x - 3.0, 4.0], [6.3, 12.0], drawing::Paint::Colour(&colour), "");
    }
    for value in [0.01, 0.1, 1.0, 10.0] {
        let x = (f64::log10(value) - low) / (high - low) * 360.0 + 10.0;
        drawing.small([x, 30.0], "middle", &drawing::tick(value));
    }
    drawing.inline("scale of ΔE00")
}

fn numbers(rows: &[Measured]) -> String {
    let heads = [
        "setting",
        "frame ms",
        "march",
        "relight",
        "read-back",
        "upload",
        "B/pixel",
        "MB",
        "mean",
        "p95",
        "max",
        "at",
        "|ΔXYZ|",
        "order",
    ];
    let heads: String = heads.iter().map(|head| format!("<th>{head}</th>")).collect();
    let causes: String = Cause::ALL.iter().map(|cause| format!("<th>{}</th>", cause.name())).collect();
    let mut table = format!("<div class=\"wide\">\n<table>\n<tr>{heads}{causes}</tr>\n");
    for row in rows {
        let (times, error) = (&row.times, &row.error.delta_e);
        let mut cells = vec![
            escaped(&row.setting.to_string()),
            short(row.frame_ms),
            format!(
                "{} ({}–{})",
                short(times.march.wall_ms.median),
                short(times.march.wall_ms.min),
                short(times.march.wall_ms.max)
            ),
            short(times.relight.wall_ms.median),
            short(times.read_back.wall_ms.median),
            short(times.upload.wall_ms.median),
            row.pixel_bytes.to_string(),
            short(megabytes(row.total_bytes)),
            short(error.mean),
            short(error.p95),
            short(error.max),
            row.error.at.map_or_else(String::new, |[x, y]| format!("{x}, {y}")),
            short(row.error.xyz),
            row.order.map_or_else(String::new, |order| format!("{order:.1}")),
        ];
        cells.extend(Cause::ALL.iter().map(|cause| {
            let found = row.causes.iter().find(|(known, _)| known == cause);
            found.map_or_else(String::new, |(_, error)| short(error.delta_e.mean))
        }));
        let cells: String = cells.iter().map(|cell| format!("<td>{cell}</td>")).collect();
        let class = if row.pareto { " class=\"best\"" } else { "" };
        writeln!(table, "<tr{class}>{cells}</tr>").ok();
    }
    table + "</table>\n</div>\n"
}
