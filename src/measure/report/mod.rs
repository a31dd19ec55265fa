//! The report of a survey: one page that needs nothing else, and the trade as a picture.

mod charts;
mod costs;
mod drawing;
mod pictures;

use std::fmt::Write as _;

use super::findings::{NodesBesideRgb, carried, cheapest, main_cause, scatter};
use super::ladder::Cause;
use super::setting::{Knob, Setting, Value};
use super::survey::{CloseUp, Measured, Survey};
use super::table::{megabytes, short};
use crate::model::ModelKind;
use crate::number::{capital, count, readable};
use crate::output::OutputError;
use crate::scene::Scene;
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
    /// What a frame of the first row took once more at the end, in ms.
    pub again_ms: Option<f64>,
    /// Whether somebody stopped it.
    pub interrupted: bool,
}

/// ΔE00 that the page names the cheapest setting for, and what a picture within them is good for.
const LIMITS: [(f64, &str); 5] = [
    (0.5, "figures: nobody sees it"),
    (1.0, "figures: hardly anybody sees it"),
    (2.0, "work: seen side by side"),
    (4.0, "a quick look: seen at a glance"),
    (8.0, "while dragging"),
];

const STYLE: &str = "\
:root{color-scheme:light dark;--paper:#fff;--ink:#1c1c1c;--soft:#5f6368;--grid:#e6e6e6;--axis:#9a9a9a;--accent:#0b62c4;--dot:#b4b8bd;--card:#f6f7f9}
@media(prefers-color-scheme:dark){:root{--paper:#15171a;--ink:#e8e8e8;--soft:#a0a6ad;--grid:#2b2f34;--axis:#666c73;--accent:#69a9f5;--dot:#565c63;--card:#1e2126}}
body{background:var(--paper);color:var(--ink);font:15px/1.5 system-ui,'DejaVu Sans',Helvetica,Arial,sans-serif;margin:0 auto;max-width:900px;padding:24px}
h1{font-size:24px;margin:0}h2{font-size:18px;margin:36px 0 6px}p{margin:6px 0}.about{color:var(--soft)}
.short{background:var(--card);border-radius:10px;padding:14px 18px;margin:18px 0}
svg{max-width:100%;height:auto;font:12px system-ui,'DejaVu Sans',Helvetica,Arial,sans-serif}
.paper{fill:var(--paper)}.ink{fill:var(--ink)}.soft{fill:var(--soft);paint-order:stroke;stroke:var(--paper);stroke-width:3px;stroke-linejoin:round}.grid{stroke:var(--grid)}.axis{stroke:var(--axis)}
.accent{fill:var(--accent)}.front{fill:none;stroke:var(--accent);stroke-width:2}.dot{fill:var(--dot)}.own{fill:none;stroke:var(--ink);stroke-width:1.6}
.curve{fill:none;stroke:var(--accent);stroke-width:1.8}.ring{fill:none;stroke:var(--accent);stroke-opacity:.6}.faint{fill:none;stroke:var(--accent);stroke-opacity:.3}.time{fill:var(--dot)}.level{stroke:var(--axis);stroke-dasharray:4 3}
.curves{display:grid;grid-template-columns:repeat(auto-fit,minmax(380px,1fr));gap:16px}
.pictures{display:flex;flex-wrap:wrap;gap:16px}figure{margin:0}figcaption{color:var(--soft);font-size:13px}
img{image-rendering:pixelated;display:block}.at{position:relative}.at i{position:absolute;width:14px;height:14px;margin:-9px 0 0 -9px;border:2px solid #fff;border-radius:50%;box-shadow:0 0 0 1.5px #000}
.wide{overflow-x:auto}.wide td:first-child,.wide th:first-child{position:sticky;left:0;background:var(--paper)}table{border-collapse:collapse;font-size:13px;font-variant-numeric:tabular-nums}
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
         <p class=\"about\">The scene's own setting: {own}.</p>\n\
         <p class=\"about\">{device}; pictures of {width}×{height} pixels; errors in {} of those that show the volume, against the \
         full spectrum in f64. Relume {}.</p>\n",
        survey.pixels().len(),
        env!("CARGO_PKG_VERSION"),
        source = escaped(&survey.scene().source),
        own = escaped(&own_setting(survey.scene(), rows)),
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
         staying as it is. Here one knob is turned at a time: relume render --max-error 1 turns several together, and looks \
         between these values, too.",
        &choices(rows),
    );
    section("What the words mean", "", &defined(&WORDS));
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
        "From the truth to the picture, one simplification after the other: each part is how much it alone \
         moves colours. Parts may cancel, so that a picture can be closer to the truth than their sum; where a coarser setting \
         comes out closer than a finer one, that is why, and luck.",
        &charts::causes(rows).inline("error by cause"),
    );
    if let Some(own) = rows.first() {
        section(
            "Where the error is",
            &format!(
                "{}, in a picture of the truth and on a map; then the worst pixel, ringed there, from near.",
                escaped(&capital(&own.setting.to_string()))
            ),
            &places(survey, own, findings.close_up)?,
        );
    }
    section(
        "All numbers",
        "Errors are ΔE00, on average by cause in the columns after max; more columns are to the right. No other setting beats those whose name is blue: \
         none is as fast and closer to the truth, or as close and faster.",
        &numbers(rows),
    );
    section("What the knobs and columns are", "", &defined(&COLUMNS));
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

/// Where the knobs stand in the scene itself.
fn own_setting(scene: &Scene, rows: &[Measured]) -> String {
    let voxels = scene.accuracy.step_length / scene.volume.geometry.spacing.min_element();
    let step = format!("step {} (voxels)", short(voxels));
    let ends = format!("termination {}", readable(scene.accuracy.termination));
    let own = rows.first();
    let carrier = own.map(|own| format!("{}, {} bytes a pixel", own.carrier, own.pixel_bytes));
    carrier.into_iter().chain([step, ends]).collect::<Vec<_>>().join("; ")
}

/// What was found, in short.
fn sentences(findings: &Findings<'_>) -> Vec<String> {
    let rows = findings.rows;
    let mut sentences = Vec::new();
    let drift = findings
        .again_ms
        .zip(rows.first())
        .map_or(1.0, |(again, own)| again.max(own.frame_ms) / again.min(own.frame_ms));
    let times = scatter(rows).max(drift);
    let rough = times > SCATTERED;
    if rough {
        sentences.push(format!(
            "Do not choose by these times: what is the same took up to {times:.1} times as long here, because other programs ran. Measure \
             again on an idle machine."
        ));
    }
    if let Some(own) = rows.first() {
        let error = &own.error.delta_e;
        sentences.push(format!(
            "{}, a frame takes {} ms here, and colours are off by ΔE00 {} on average, by at most {} in 95 of 100 pixels, and by {} in the worst of those looked at.",
            capital(&own.setting.to_string()),
            short(own.frame_ms),
            short(error.mean),
            short(error.p95),
            short(error.max)
        ));
        if let Some(cause) = main_cause(own) {
            let share = own.causes.iter().find(|(known, _)| *known == cause);
            let order = own
                .order
                .filter(|_| cause == Cause::Step)
                .map_or_else(String::new, |order| format!(" Half the step leaves {} of that error.", fraction(order)));
            let worst = share.filter(|(_, there)| there.at.is_some() && there.at == own.error.at);
            let worst = if worst.is_some() { ", and so does the worst pixel" } else { "" };
            sentences.push(format!(
                "Most of it, {} on average, comes from {}{worst}: {}.{order}",
                short(share.map_or(0.0, |(_, error)| error.delta_e.mean)),
                cause.name(),
                way_out(cause)
            ));
        }
    }
    sentences.extend(advice(rows, rough));
    sentences.extend(bought(rows));
    if rows.first().is_some_and(|own| own.carrier.starts_with("weights")) {
        sentences.push(
            "This scene keeps weights of its materials, which are exact under every light: what carries spectra adds no error."
                .to_owned(),
        );
    }
    sentences
}

/// Times of the same thing that differ by more than this are told of.
const SCATTERED: f64 = 1.4;

/// What k = 8 buys, for people who look at pictures: what it errs by and costs, beside fewer numbers and beside RGB.
fn bought(rows: &[Measured]) -> Option<String> {
    let found = NodesBesideRgb::of(rows)?;
    let nodes = |k: usize| carried_by_nodes(rows, k);
    let eight = nodes(8)?;
    let rgb = carried(rows, |kind, _| kind == found.best).next()?;
    let own = rows.first()?;
    let p95 = |row: &Measured| row.error.delta_e.p95;
    let fewer: Vec<String> =
        [6, 4, 3].into_iter().filter_map(|k| Some(format!("k = {k} within {}", short(p95(nodes(k)?))))).collect();
    let fewer = if fewer.is_empty() { String::new() } else { format!("; {}", fewer.join(", ")) };
    let has = if own.carrier.starts_with("weights") {
        String::new()
    } else {
        format!(
            " The scene carries {} and is within {}, at {} bytes a pixel.",
            own.components,
            short(p95(own)),
            own.pixel_bytes
        )
    };
    let only =
        if found.of.len() > 1 { format!(", the best of {} kinds on average", found.of.len()) } else { String::new() };
    let ratio = match found.ratio() {
        ratio if found.nodes < 1e-3 => format!("more than {} times", short((found.rgb / 1e-3).min(ratio).floor())),
        ratio => format!("{} times", short(ratio)),
    };
    Some(format!(
        "What k = 8 buys, with all else as the scene has it: carrying spectra in eight numbers keeps 95 of 100 pixels within ΔE00 {}, \
         {}; red, green and blue ({}{only}) within {}, {}{fewer}.{has} Of the model alone, RGB's error is {ratio} as large on average. \
         A frame of k = 8 takes {} ms and {} bytes a pixel, one of RGB {} ms and {}.",
        short(p95(eight)),
        seen(p95(eight)),
        found.best,
        short(p95(rgb)),
        seen(p95(rgb)),
        short(eight.frame_ms),
        eight.pixel_bytes,
        short(rgb.frame_ms),
        rgb.pixel_bytes,
    ))
}

/// The row of so many nodes, where the model is named or is the scene's own.
fn carried_by_nodes(rows: &[Measured], k: usize) -> Option<&Measured> {
    let named = |row: &&Measured| row.setting.get(Knob::K) == Some(Value::Number(count(k)));
    let alone = rows.iter().filter(|row| row.setting.knobs().count() == 1).find(named);
    alone
        .filter(|row| row.components == k)
        .or_else(|| carried(rows, |kind, n| kind == ModelKind::Nodes && n == k).next())
}

/// Who sees a ΔE00.
fn seen(error: f64) -> &'static str {
    match error {
        error if error < 0.5 => "which nobody sees",
        error if error < 1.0 => "which hardly anybody sees",
        error if error < 2.0 => "which is seen side by side",
        _ => "which is seen at a glance",
    }
}

/// Which setting keeps what can just be seen side by side.
fn advice(rows: &[Measured], rough: bool) -> Option<String> {
    const SEEN: f64 = 1.0;
    const WORTH: f64 = 0.9;
    let own = rows.first()?;
    let found = cheapest(rows, SEEN)?;
    if own.error.delta_e.p95 <= SEEN {
        let faster = if rough {
            String::new()
        } else if found.frame_ms < WORTH * own.frame_ms {
            let less = 100.0 * (1.0 - found.frame_ms / own.frame_ms);
            format!(" {} stays within ΔE00 {SEEN}, too, in {less:.0} % less time.", capital(&found.setting.to_string()))
        } else {
            " There is nothing to change.".to_owned()
        };
        return Some(format!(
            "It is good as it is: 95 of 100 pixels are within {}, {}.{faster}",
            short(own.error.delta_e.p95),
            seen(own.error.delta_e.p95)
        ));
    }
    Some(format!(
        "To be within ΔE00 {SEEN}, which can just be seen side by side, in 95 of 100 pixels, take {}: {} ms a frame, {:.1} times as \
         long.",
        found.setting,
        short(found.frame_ms),
        found.frame_ms / own.frame_ms
    ))
}

/// The page's words for whoever has not met them.
const WORDS: [(&str, &str); 7] = [
    ("ΔE00", "how different two colours look (CIEDE2000): below 0.5 nobody sees it, 1 can just be seen side by side"),
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
        "the setting of the scene file, which the second line of this page states; every other row differs from it in what is \
         named. A model that is named has the scene's k where that is stated, else 8; RGB has 3",
    ),
];

/// The knobs and columns, for whoever wants to turn one.
const COLUMNS: [(&str, &str); 16] = [
    (
        "march, relight, read-back, upload",
        "ms: rays through the volume; light put on what they left; the picture from the device; the volume to it, once",
    ),
    ("B/pixel, MB", "bytes that a finished pixel keeps; all memory of a march with the volume"),
    (
        "at, |ΔXYZ|",
        "the worst pixel, from the left and from the top; the largest difference of X, Y or Z there is, white being 1",
    ),
    ("order", "how fast the step error falls: half the step leaves a half of it at 1, a quarter at 2"),
    ("termination", "a ray ends once less than this share of light can pass"),
    ("tables", "the transfer function as a table, the volume as a texture, storage in 16 bits"),
    ("rounding, device", "arithmetic in f32 in place of f64; what the device does otherwise than that"),
    ("resolution, scale", "fewer pixels are marched, as a share across, and the picture is enlarged"),
    ("storage", "bits of the numbers that pixels keep: f16 halves their memory"),
    ("interpolation", "values between voxels: nearest, linear by the device, linear in f32 (exact-linear), or cubic"),
    (
        "volume, gradients",
        "bits of voxels; whether gradients are stored beside them (packed) or taken as rays go (central)",
    ),
    ("entries, lookup", "entries of the transfer table, and whether it is read between them"),
    ("skipping", "leaping over empty space: exact, so it only saves time"),
    (
        "sharpened, sharpened-semigroup",
        "factor models whose spectra are made to multiply: each step's light is projected, or each absorption",
    ),
    ("peercy", "k numbers with full matrices in place of products (Peercy 1993)"),
    (
        "bands, rgb-naive, -prefiltered, -fitted",
        "k bands alike; RGB of materials as it is, under the scene's light, and with a matrix fitted to each light",
    ),
];

fn defined(words: &[(&str, &str)]) -> String {
    let rows: String = words.iter().map(|(word, meaning)| format!("<dt>{word}</dt><dd>{meaning}.</dd>\n")).collect();
    format!("<dl>\n{rows}</dl>\n")
}

/// What half a step leaves of an error of this order, in words.
fn fraction(order: f64) -> String {
    format!("{:.0} %", 100.0 * 0.5_f64.powf(order))
}

fn way_out(cause: Cause) -> &'static str {
    match cause {
        Cause::Step => {
            "what is thinner than the distance of samples is missed; a shorter step costs time in proportion"
        }
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
        "<table>\n<tr><th>ΔE00 within</th><th>setting</th><th>ms</th><th>p95</th><th>max</th><th>good for</th></tr>\n"
            .to_owned();
    let mut add = |limits: &str, row: &Measured, good_for: &str| {
        let error = &row.error.delta_e;
        let [ms, p95, max] = [row.frame_ms, error.p95, error.max].map(short);
        let setting = escaped(&row.setting.to_string());
        writeln!(
            table,
            "<tr><td>{limits}</td><td>{setting}</td><td>{ms}</td><td>{p95}</td><td>{max}</td><td>{good_for}</td></tr>"
        )
        .ok();
    };
    if let Some(own) = rows.first() {
        add("the scene's own", own, "");
    }
    let found: Vec<(f64, &str, &Measured)> =
        LIMITS.iter().filter_map(|&(limit, good_for)| Some((limit, good_for, cheapest(rows, limit)?))).collect();
    // What is within a small error as cheaply as within a larger one is named once.
    for same in found.chunk_by(|one, two| std::ptr::eq(one.2, two.2)) {
        let limits: Vec<String> = same.iter().map(|(limit, ..)| readable(*limit)).collect();
        if let Some((_, good_for, row)) = same.first() {
            add(&limits.join(", "), row, good_for);
        }
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
    let figure = |picture: &Picture, [width, height]: [usize; 2], caption: &str, mark: &str| {
        format!(
            "<figure><div class=\"at\"><img alt=\"{caption}\" width=\"{width}\" height=\"{height}\" src=\"data:image/png;base64,{}\">{mark}</div><figcaption>{caption}</figcaption></figure>\n",
            picture.base64
        )
    };
    // In the middle of the worst pixel; percentages, as pictures shrink with the page.
    let mark = own.error.at.map_or_else(String::new, |at| {
        let place = [0, 1].map(|axis| {
            let cell = looked_at.iter().position(|pixel| *pixel == at).map_or([0, 0], |i| [i % dims[0], i / dims[0]]);
            100.0 * (count(cell[axis]) + 0.5) / count(dims[axis])
        });
        format!("<i style=\"left:{:.2}%;top:{:.2}%\"></i>", place[0], place[1])
    });
    let enlarged = |dims: [usize; 2], most: usize| {
        let times = (most / dims[0].max(dims[1])).max(1);
        dims.map(|side| side * times)
    };
    let shown = enlarged(dims, 400);
    let stride = survey.lattice().stride;
    let every = if stride == 1 { String::new() } else { format!(", every {stride} pixels") };
    let mut text = format!(
        "<div class=\"pictures\">\n{}{}</div>\n{}",
        figure(&truth, shown, &format!("the truth{every}"), &mark),
        figure(&map, shown, "ΔE00 (grey: shows nothing of the volume)", &mark),
        legend()
    );
    if let (Some(close), Some([x, y])) = (close_up, own.error.at) {
        let dims = [close.side; 2];
        let shown = enlarged(dims, 260);
        let pictures = [
            (Picture::of_colours(dims, close.truth.iter().copied())?, "the truth"),
            (Picture::of_colours(dims, close.shown.iter().copied())?, "this picture"),
            (Picture::of_differences(dims, close.differences.iter().copied().map(Some))?, "ΔE00"),
        ];
        let figures: String = pictures.iter().map(|(picture, caption)| figure(picture, shown, caption, "")).collect();
        write!(
            text,
            "<p>The worst of those looked at, pixel {x}, {y}, with ΔE00 {}, and what is around it:</p>\n<div class=\"pictures\">\n{figures}</div>\n",
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
    let mut drawing = drawing::Drawing::new(420.0, 36.0);
    for (i, x) in drawing::middles(PARTS, 20.0, 360.0).enumerate() {
        let share = (count(i) + 0.5) / count(PARTS);
        let [red, green, blue] = heat(10_f64.powf((high - low).mul_add(share, low)));
        let colour = format!("#{red:02x}{green:02x}{blue:02x}");
        drawing.bar([x - 3.0, 4.0], [6.3, 12.0], drawing::Paint::Colour(&colour), "");
    }
    for value in [0.01, 0.1, 1.0, 10.0] {
        let x = (f64::log10(value) - low) / (high - low) * 360.0 + 20.0;
        drawing.small([x, 30.0], "middle", &drawing::tick(value));
    }
    drawing.inline("scale of ΔE00")
}

fn numbers(rows: &[Measured]) -> String {
    let before = ["setting", "frame ms", "B/pixel", "mean", "p95", "max"];
    let after = ["at", "|ΔXYZ|", "order", "march", "relight", "read-back", "upload", "MB"];
    let causes = Cause::ALL.map(Cause::name);
    let heads = before.iter().chain(&causes).chain(&after).map(|head| format!("<th>{head}</th>"));
    let mut table = format!("<div class=\"wide\">\n<table>\n<tr>{}</tr>\n", heads.collect::<String>());
    for row in rows {
        let (times, error) = (&row.times, &row.error.delta_e);
        let named = [escaped(&row.setting.to_string())];
        let [frame, mean, p95, max] = [row.frame_ms, error.mean, error.p95, error.max].map(short);
        let found = [frame, row.pixel_bytes.to_string(), mean, p95, max];
        let causes = Cause::ALL.map(|cause| {
            let found = row.causes.iter().find(|(known, _)| *known == cause);
            found.map_or_else(String::new, |(_, error)| short(error.delta_e.mean))
        });
        let march = &times.march.wall_ms;
        let rest = [
            row.error.at.map_or_else(String::new, |[x, y]| format!("{x}, {y}")),
            short(row.error.xyz),
            row.order.map_or_else(String::new, |order| format!("{order:.1}")),
            format!("{} ({}–{})", short(march.median), short(march.min), short(march.max)),
            short(times.relight.wall_ms.median),
            short(times.read_back.wall_ms.median),
            short(times.upload.wall_ms.median),
            short(megabytes(row.total_bytes)),
        ];
        let cells = named.iter().chain(&found).chain(&causes).chain(&rest).map(|cell| format!("<td>{cell}</td>"));
        let class = if row.pareto { " class=\"best\"" } else { "" };
        writeln!(table, "<tr{class}>{}</tr>", cells.collect::<String>()).ok();
    }
    table + "</table>\n</div>\n"
}
