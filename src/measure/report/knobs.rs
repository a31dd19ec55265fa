//! Each knob turned by itself: a chart where that moves what the eye sees, else a line of a table.

use std::fmt::Write as _;

use super::drawing::{Drawing, Logarithmic, Paint, escaped};
use super::entry::{CUBIC, Entry};
use super::trade::{floored, p95};
use super::words::meaning;
use crate::measure::findings::{is_faster, span};
use crate::measure::setting::Knob;
use crate::measure::survey::Measured;
use crate::measure::table::short;
use crate::measure::written::written;
use crate::number::{count, readable};
use crate::scene::Scene;

/// A knob that moves p95 by less than this from the scene's own gets no chart.
const MOVED: f64 = 0.05;

/// A row of a knob's chart.
struct Turned<'a> {
    /// What the knob is turned to, where that is a number.
    number: Option<f64>,
    label: String,
    entry: Entry<'a>,
    is_own: bool,
}

/// Where a knob stands in the scene.
fn stands(knob: Knob, scene: &Scene, own: &Measured) -> String {
    let weights = own.carrier.starts_with("weights");
    match knob {
        Knob::Model | Knob::K | Knob::Accumulate if weights => "weights".to_owned(),
        Knob::Model => format!("{}, k = {}", scene.accuracy.model, own.components),
        Knob::K => own.components.to_string(),
        Knob::Accumulate => "spectral".to_owned(),
        Knob::Step => readable(step_in_voxels(scene)),
        Knob::Skipping => if scene.accuracy.skipping { "on" } else { "off" }.to_owned(),
        Knob::Scale => "1".to_owned(),
        _ => written(scene)
            .into_iter()
            .find(|(_, key, _)| *key == knob.name())
            .map_or_else(|| "by the data".to_owned(), |(.., value)| value.replace('"', "")),
    }
}

/// The step of a scene in voxels.
pub(super) fn step_in_voxels(scene: &Scene) -> f64 {
    scene.accuracy.step_length / scene.volume.geometry.spacing.min_element()
}

/// The settings that turn nothing but `knob`, and the scene's own among them.
fn turned<'a>(rows: &'a [Measured], knob: Knob, scene: &Scene) -> Vec<Turned<'a>> {
    let Some(own) = rows.first() else { return Vec::new() };
    let row_of = |row: &'a Measured, label: String| {
        let is_own = row.times == own.times;
        let number = label.parse().ok();
        let label = if is_own { format!("{label} (own)") } else { label };
        Turned { number, label, entry: Entry { row, also: Vec::new() }, is_own }
    };
    let alone = |row: &'a Measured| Some(row).filter(|row| row.setting.knobs().count() == 1)?.setting.get(knob);
    let mut found: Vec<Turned<'a>> = rows.iter().filter_map(|row| Some(row_of(row, alone(row)?.to_string()))).collect();
    if !found.is_empty() && !found.iter().any(|it| it.is_own) {
        found.insert(0, row_of(own, stands(knob, scene, own)));
    }
    // Names stay in the order in which they were asked for, before numbers.
    let number = |it: &Turned<'_>| it.number.unwrap_or(f64::NEG_INFINITY);
    found.sort_by(|one, two| number(one).total_cmp(&number(two)));
    found
}

/// Charts of the knobs that matter here, and a table of those that do not.
pub(super) fn knobs(rows: &[Measured], scene: &Scene) -> String {
    let Some(own) = rows.first() else { return String::new() };
    let (mut charts, mut table) = (String::new(), String::new());
    for knob in Knob::ALL {
        let found = turned(rows, knob, scene);
        let moves = |it: &Turned<'_>| (it.entry.row.error.delta_e.p95 - own.error.delta_e.p95).abs() >= MOVED;
        if found.iter().any(moves) {
            let is_spline = found.iter().any(|it| it.label == "cubic");
            let note = if is_spline { format!("<figcaption>{CUBIC}</figcaption>") } else { String::new() };
            let hover = escaped(meaning(knob.name()).unwrap_or(""));
            let drawn = chart(&found, own).inline(knob.name());
            write!(charts, "<figure><h3 title=\"{hover}\">{knob}: {}</h3>\n{drawn}{note}</figure>\n", knob.meaning())
                .ok();
        } else {
            let lines = found.iter().filter(|it| !it.is_own).map(|it| line(knob, it.entry.row, own));
            table.extend(lines);
        }
    }
    if !charts.is_empty() {
        charts = format!("<div class=\"curves\">\n{charts}</div>\n");
    }
    if !table.is_empty() {
        let error = &own.error.delta_e;
        let [ms, p95, max] = [own.frame_ms, error.p95, error.max].map(short);
        let [least, most] = span(own).map(short);
        table = format!(
            "<p>These knobs move that error by less than {MOVED}:</p>\n<div class=\"wide\"><table>\n\
             <tr><th class=\"text\">setting</th><th>ms</th><th class=\"text\">beside the scene's own</th><th>p95</th><th>worst</th></tr>\n\
             <tr><td class=\"text\"><b>the scene's own</b></td><td>{ms} <small>({least}–{most})</small></td><td></td><td>{p95}</td><td>{max}</td></tr>\n\
             {table}</table></div>\n"
        );
    }
    charts + &table
}

/// A knob that does not matter, in a line.
fn line(knob: Knob, row: &Measured, own: &Measured) -> String {
    let error = &row.error.delta_e;
    let [ms, p95, max] = [row.frame_ms, error.p95, error.max].map(short);
    let [least, most] = span(row).map(short);
    let beside = if is_faster(row, own) {
        "faster"
    } else if is_faster(own, row) {
        "slower"
    } else {
        "no difference that the spread allows to tell"
    };
    format!(
        "<tr><td class=\"text\" title=\"{}\">{}</td><td>{ms} <small>({least}–{most})</small></td><td class=\"text\">{beside}</td><td>{p95}</td><td>{max}</td></tr>\n",
        knob.meaning(),
        escaped(&row.setting.to_string())
    )
}

/// A row a value: how far it is off, and how long it takes.
fn chart(found: &[Turned<'_>], own: &Measured) -> Drawing {
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
    drawing.small([left + 4.0, 12.0], "start", "ΔE00, 95 of 100 below");
    drawing.small([bars, 12.0], "start", "ms a frame");
    let mut last = f64::NEG_INFINITY;
    for value in across.ticks() {
        let x = across.at(value);
        drawing.line([x, TOP - 6.0], [x, bottom], "grid");
        // No two numbers on one another.
        if x - last > 26.0 {
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
        drawing.circle([x, y], 4.0, "accent", &it.entry.told());
        if it.is_own {
            drawing.circle([x, y], 7.5, "own", "");
        }
        drawing.bar([bars, y - 6.0], [at(it.entry.row.frame_ms) - bars, 12.0], Paint::Class("time"), &it.entry.told());
    }
    drawing.line([at(own.frame_ms), TOP - 2.0], [at(own.frame_ms), bottom], "level");
    for (it, &[_, y]) in found.iter().zip(&points) {
        let [least, most] = span(it.entry.row).map(at);
        drawing.line([least, y], [most, y], "whisker");
        for end in [least, most] {
            drawing.line([end, y - 3.0], [end, y + 3.0], "whisker");
        }
        drawing.small([most + 5.0, y + 4.0], "start", &short(it.entry.row.frame_ms));
    }
    drawing.line([bars, TOP - 2.0], [bars, bottom], "axis");
    drawing
}
