//! Each knob by itself: a chart if it has a visible effect, otherwise a table row.

use std::fmt::Write as _;

use super::drawing::{Drawing, Logarithmic, Paint, escaped};
use super::entry::{CUBIC, Entry, INVISIBLE, name};
use super::trade::{floored, p95};
use super::trust::{Trust, is_as_close};
use super::words::meaning;
use crate::digits::{megabytes, short};
use crate::findings::span;
use crate::measured::Measured;
use crate::setting::Knob;
use relume_base::number::count;
use relume_scene::Scene;

/// Change of p95 from the scene's own below which a knob gets no chart.
const MOVED: f64 = 0.05;

/// A row of a knob's chart.
struct Turned<'a> {
    /// Value of the knob, if it is a number.
    number: Option<f64>,
    label: String,
    entry: Entry<'a>,
    is_own: bool,
}

/// Value of a knob in the scene.
fn stands(knob: Knob, scene: &Scene, own: &Measured) -> String {
    let weights = own.carrier.starts_with("weights");
    match knob.name() {
        "model" | "k" | "accumulate" if weights => "weights".to_owned(),
        "model" => format!("{}, k = {}", scene.accuracy.model, own.components),
        "k" => own.components.to_string(),
        "accumulate" => "spectral".to_owned(),
        _ => knob.value(scene).map_or_else(|| "chosen by the data".to_owned(), |value| value.to_string()),
    }
}

/// Step length of a scene in voxels.
pub(super) fn step_in_voxels(scene: &Scene) -> f64 {
    scene.accuracy.step_length / scene.frame.geometry.spacing.min_element()
}

/// Settings that change only `knob`, together with the scene's own.
fn turned<'a>(rows: &'a [Measured], knob: Knob, scene: &Scene) -> Vec<Turned<'a>> {
    let Some(own) = rows.first() else { return Vec::new() };
    let row_of = |row: &'a Measured, label: String| {
        let is_own = row.times == own.times;
        let number = label.parse().ok();
        let label = if is_own { format!("{label} (own)") } else { label };
        Turned { number, label, entry: Entry { row, also: Vec::new() }, is_own }
    };
    let alone = |row: &'a Measured| Some(row).filter(|row| row.setting.knobs().count() == 1)?.setting.get(knob.name());
    let mut found: Vec<Turned<'a>> = rows.iter().filter_map(|row| Some(row_of(row, alone(row)?.to_string()))).collect();
    if !found.is_empty() && !found.iter().any(|it| it.is_own) {
        found.insert(0, row_of(own, stands(knob, scene, own)));
    }
    // Names keep their order and precede numbers.
    let number = |it: &Turned<'_>| it.number.unwrap_or(f64::NEG_INFINITY);
    found.sort_by(|one, two| number(one).total_cmp(&number(two)));
    found
}

/// Whether a row's p95 differs from the scene's own by at least [`MOVED`].
fn moves(row: &Measured, own: &Measured) -> bool {
    (row.error.delta_e.p95 - own.error.delta_e.p95).abs() >= MOVED
}

/// States which knobs matter, and which setting saves memory at the same accuracy; `None` if no knob was varied alone.
pub(super) fn worth(rows: &[Measured], scene: &Scene, trust: Trust) -> Option<String> {
    let own = rows.first()?;
    let turned = Knob::all().map(|knob| (knob, turned(rows, knob, scene)));
    let turned: Vec<(Knob, Vec<Turned<'_>>)> = turned.filter(|(_, found)| found.len() > 1).collect();
    let (moving, still): (Vec<_>, Vec<_>) =
        turned.iter().partition(|(_, found)| found.iter().any(|it| moves(it.entry.row, own)));
    let names = |knobs: &[&(Knob, Vec<Turned<'_>>)]| {
        let names: Vec<&str> = knobs.iter().map(|(knob, _)| knob.name()).collect();
        match names.split_last() {
            Some((last, [])) => (*last).to_owned(),
            Some((last, others)) => format!("{} and {last}", others.join(", ")),
            None => String::new(),
        }
    };
    let verb = |knobs: &[&(Knob, Vec<Turned<'_>>)], one: &'static str, many| if knobs.len() == 1 { one } else { many };
    let mut said = Vec::new();
    if !moving.is_empty() {
        said.push(format!("{} {} p95 by {MOVED} or more.", names(&moving), verb(&moving, "changes", "change")));
    }
    if !still.is_empty() {
        said.push(format!("{} {} p95 by less than {MOVED}.", names(&still), verb(&still, "changes", "change")));
    }
    let small = rows.iter().filter(|row| is_as_close(row, own));
    let small = small.min_by_key(|row| row.total_bytes).filter(|row| 5 * row.total_bytes < 4 * own.total_bytes);
    if let Some(row) = small {
        let [mb, own_mb] = [row, own].map(|row| short(megabytes(row.total_bytes)));
        let [ms, own_ms] = [row, own].map(|row| trust.ms(row.frame_ms));
        said.push(format!(
            "{} takes {mb} MB instead of {own_mb} and {ms} ms instead of {own_ms}, at the same accuracy.",
            row.setting
        ));
    }
    (!said.is_empty()).then(|| said.join(" "))
}

/// Charts of the knobs that matter, and a table of the others.
pub(super) fn knobs(rows: &[Measured], scene: &Scene, trust: Trust) -> String {
    let Some(own) = rows.first() else { return String::new() };
    let (mut charts, mut table) = (String::new(), String::new());
    for knob in Knob::all() {
        let found = turned(rows, knob, scene);
        if found.iter().any(|it| moves(it.entry.row, own)) {
            let is_spline = found.iter().any(|it| it.label == "cubic");
            let note = if is_spline { format!("<figcaption>{CUBIC}</figcaption>") } else { String::new() };
            let hover = escaped(meaning(knob.name()).unwrap_or(""));
            let drawn = chart(&found, own, trust).inline(knob.name());
            write!(charts, "<figure><h3 title=\"{hover}\">{knob}: {}</h3>\n{drawn}{note}</figure>\n", knob.meaning())
                .ok();
        } else {
            let lines = found.iter().filter(|it| !it.is_own).map(|it| line(it.entry.row, own, knob.meaning(), trust));
            table.extend(lines);
        }
    }
    if !charts.is_empty() {
        charts = format!("<div class=\"curves\">\n{charts}</div>\n");
    }
    if !table.is_empty() {
        let speed = if trust.is_rough() { "" } else { "<th class=\"text\">compared with the scene's own</th>" };
        table = format!(
            "<p>These settings change p95 by less than {MOVED}; bold: the worst pixel changes by {INVISIBLE} or more.</p>\n\
             <div class=\"wide\"><table>\n<tr><th class=\"text\">setting</th><th>p95</th><th>worst</th><th>ms</th>{speed}<th>MB</th></tr>\n\
             {}{table}</table></div>\n",
            line(own, own, "", trust)
        );
    }
    charts + &table
}

/// Table row of a setting without effect.
fn line(row: &Measured, own: &Measured, meaning: &str, trust: Trust) -> String {
    let error = &row.error.delta_e;
    let [p95, max] = [error.p95, error.max].map(short);
    let max = if (error.max - own.error.delta_e.max).abs() >= INVISIBLE { format!("<b>{max}</b>") } else { max };
    let speed = match () {
        () if trust.is_rough() => "",
        () if row.times == own.times => "<td></td>",
        () if trust.is_faster(row, own) => "<td class=\"text\">faster</td>",
        () if trust.is_faster(own, row) => "<td class=\"text\">slower</td>",
        () => "<td class=\"text\">no difference beyond the spread</td>",
    };
    format!(
        "<tr><td class=\"text\" title=\"{meaning}\">{}</td><td>{p95}</td><td>{max}</td><td>{}</td>{speed}<td>{}</td></tr>\n",
        escaped(&name(&row.setting)),
        trust.cell(row),
        short(megabytes(row.total_bytes))
    )
}

/// Chart with a row per value: its error and its time.
fn chart(found: &[Turned<'_>], own: &Measured, trust: Trust) -> Drawing {
    const WIDTH: f64 = 424.0;
    const LINE: f64 = 21.0;
    const TOP: f64 = 40.0;
    let letters = found.iter().map(|it| it.label.chars().count()).max().unwrap_or(0);
    let left = 6.2f64.mul_add(count(letters), 8.0).min(170.0);
    let middle = (WIDTH - 60.0 - left).mul_add(0.55, left);
    let (bars, right) = (middle + 22.0, WIDTH - 52.0);
    let bottom = count(found.len()).mul_add(LINE, TOP);
    let mut drawing = Drawing::new(WIDTH, bottom + 6.0);
    let across = Logarithmic::of(found.iter().map(|it| p95(&it.entry)), left + 4.0, middle);
    drawing.small([left + 4.0, 12.0], "start", "p95 of ΔE00");
    drawing.small([bars, 12.0], "start", if trust.is_rough() { "≈ ms per frame" } else { "ms per frame" });
    let mut last = f64::NEG_INFINITY;
    for value in across.ticks() {
        let x = across.at(value);
        // Keeps labels apart, and draws no line without a label.
        if x - last > 26.0 {
            drawing.line([x, TOP - 6.0], [x, bottom], "grid");
            drawing.small([x, TOP - 10.0], "middle", &floored(value));
            last = x;
        }
    }
    let points: Vec<[f64; 2]> = found
        .iter()
        .enumerate()
        .map(|(i, it)| [across.at(p95(&it.entry)), LINE.mul_add(count(i) + 0.5, TOP)])
        .collect();
    if found.iter().all(|it| it.number.is_some()) {
        drawing.path(&points, "curve");
    }
    let longest = found.iter().map(|it| span(it.entry.row)[1]).fold(f64::MIN_POSITIVE, f64::max);
    let at = |ms: f64| (right - bars).mul_add(ms / longest, bars);
    for (it, &[x, y]) in found.iter().zip(&points) {
        drawing.small([left - 4.0, y + 4.0], "end", &it.label);
        drawing.circle([x, y], 4.0, "accent", &it.entry.described(trust));
        if it.is_own {
            drawing.circle([x, y], 7.5, "own", "");
        }
        let paint = Paint::Class(if trust.is_rough() { "time rough" } else { "time" });
        drawing.bar([bars, y - 6.0], [at(it.entry.row.frame_ms) - bars, 12.0], paint, &it.entry.described(trust));
    }
    if !trust.is_rough() {
        drawing.line([at(own.frame_ms), TOP - 2.0], [at(own.frame_ms), bottom], "level");
    }
    for (it, &[_, y]) in found.iter().zip(&points) {
        let [least, most] = span(it.entry.row).map(at);
        drawing.line([least, y], [most, y], "whisker");
        for end in [least, most] {
            drawing.line([end, y - 3.0], [end, y + 3.0], "whisker");
        }
        drawing.small([WIDTH - 4.0, y + 4.0], "end", &trust.ms(it.entry.row.frame_ms));
    }
    drawing.line([bars, TOP - 2.0], [bars, bottom], "axis");
    drawing
}
