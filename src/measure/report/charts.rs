//! The charts of a report: the trade, a curve per knob, errors by cause.

use super::drawing::{Drawing, Logarithmic, PARTS, Paint, middles, tick};
use crate::measure::ladder::Cause;
use crate::measure::setting::{Knob, Value};
use crate::measure::survey::Measured;
use crate::measure::table::short;
use crate::number::count;

/// Below this ΔE00 nobody sees anything, and axes end.
const LEAST: f64 = 1e-3;
/// The most bars of the chart of causes.
const MOST_BARS: usize = 60;

fn p95(row: &Measured) -> f64 {
    row.error.delta_e.p95.max(LEAST)
}

/// What a pointer is told of a setting.
fn told(row: &Measured) -> String {
    let error = &row.error.delta_e;
    format!(
        "{}: {} ms, ΔE00 {} on average, p95 {}, at most {}",
        row.setting,
        short(row.frame_ms),
        short(error.mean),
        short(error.p95),
        short(error.max)
    )
}

/// Time against error, with what no other setting beats as a line.
pub(super) fn trade(rows: &[Measured]) -> Drawing {
    const WIDTH: f64 = 860.0;
    const HEIGHT: f64 = 440.0;
    let (left, right, top, bottom) = (62.0, WIDTH - 20.0, 34.0, HEIGHT - 46.0);
    let mut drawing = Drawing::new(WIDTH, HEIGHT);
    let across = Logarithmic::of(rows.iter().map(|row| row.frame_ms), left, right - 130.0);
    let up = Logarithmic::of(rows.iter().map(p95), bottom, top);
    for value in across.ticks() {
        let x = across.at(value);
        drawing.line([x, top], [x, bottom], "grid");
        drawing.small([x, bottom + 16.0], "middle", &tick(value));
    }
    for value in up.ticks() {
        let y = up.at(value);
        drawing.line([left, y], [right, y], "grid");
        drawing.small([left - 8.0, y + 4.0], "end", &tick(value));
    }
    drawing.text([left, 20.0], "ink", "start", "ΔE00, p95: how far 95 of 100 pixels are within the truth");
    drawing.text([right, bottom + 36.0], "ink", "end", "time of a frame, ms");
    let place = |row: &Measured| [across.at(row.frame_ms), up.at(p95(row))];
    for row in rows.iter().filter(|row| !row.pareto) {
        drawing.circle(place(row), 4.0, "dot", &told(row));
    }
    let mut front: Vec<&Measured> = rows.iter().filter(|row| row.pareto).collect();
    front.sort_by(|one, two| one.frame_ms.total_cmp(&two.frame_ms));
    let points: Vec<[f64; 2]> = front.iter().copied().map(place).collect();
    drawing.path(&points, "front");
    let mut labelled: Vec<[f64; 2]> = Vec::new();
    for (row, [x, y]) in front.iter().zip(&points) {
        drawing.circle([*x, *y], 5.0, "accent", &told(row));
        // What is beside another differs by what measurements do; its name is in the table.
        if labelled.iter().all(|[other_x, other_y]| (x - other_x).abs() > 90.0 || (y - other_y).abs() > 16.0) {
            drawing.text([x + 10.0, y - 5.0], "ink", "start", &row.setting.to_string());
            labelled.push([*x, *y]);
        }
    }
    if let Some(own) = rows.iter().find(|row| row.setting.knobs().next().is_none()) {
        let [x, y] = place(own);
        drawing.circle([x, y], 9.0, "own", &told(own));
        drawing.small([x - 13.0, y + 4.0], "end", "the scene's own");
    }
    drawing
}

/// A knob's settings with all other knobs as the scene has them.
fn alone(rows: &[Measured], knob: Knob) -> Vec<(Value, &Measured)> {
    let only = |row: &&Measured| row.setting.knobs().count() == 1;
    let found = rows.iter().filter(only).filter_map(|row| Some((row.setting.get(knob)?, row)));
    let mut found: Vec<(Value, &Measured)> = found.collect();
    // Names stay in the order in which they were asked for.
    found.sort_by(|(one, _), (two, _)| match (one, two) {
        (Value::Number(one), Value::Number(two)) => one.total_cmp(two),
        _ => std::cmp::Ordering::Equal,
    });
    found
}

/// What a knob moves by itself.
fn moved(knob: Knob) -> Option<Cause> {
    match knob {
        Knob::Model | Knob::K | Knob::Accumulate => Some(Cause::Basis),
        Knob::Step => Some(Cause::Step),
        Knob::Termination => Some(Cause::Termination),
        Knob::Interpolation => Some(Cause::Interpolation),
        Knob::Storage | Knob::Volume | Knob::Gradients | Knob::Entries | Knob::Lookup => Some(Cause::Tables),
        Knob::Scale => Some(Cause::Resolution),
        Knob::Skipping => None,
    }
}

/// Error above, time below, over the values of one knob; the scene's own setting as lines, and as the first of names.
pub(super) fn curve(rows: &[Measured], knob: Knob) -> Option<Drawing> {
    const SIZE: [f64; 2] = [420.0, 276.0];
    let own = rows.iter().find(|row| row.setting.knobs().next().is_none())?;
    let turned = alone(rows, knob);
    let mut found: Vec<(String, &Measured)> = turned.iter().map(|(value, row)| (value.to_string(), *row)).collect();
    let are_numbers = matches!(turned.first()?.0, Value::Number(_));
    if !are_numbers {
        found.insert(0, ("as it is".to_owned(), own));
    }
    let by_itself = |row: &Measured| {
        let cause = moved(knob)?;
        let known = row.causes.iter().find(|(known, _)| *known == cause);
        Some(known.map_or(0.0, |(_, error)| error.delta_e.p95).max(LEAST))
    };
    let mut drawing = Drawing::new(SIZE[0], SIZE[1]);
    let (left, right) = (52.0, SIZE[0] - 10.0);
    drawing.text([left, 16.0], "ink", "start", &format!("{knob}: {}", knob.meaning()));

    let shown = || found.iter().map(|(_, row)| *row).chain([own]);
    let up = Logarithmic::of(shown().map(p95).chain(shown().filter_map(by_itself)), 150.0, 40.0);
    for value in up.ticks() {
        drawing.line([left, up.at(value)], [right, up.at(value)], "grid");
        drawing.small([left - 6.0, up.at(value) + 4.0], "end", &tick(value));
    }
    let legend = moved(knob).map_or_else(String::new, |cause| format!("; open circles: by {} alone", cause.name()));
    drawing.small([right, 31.0], "end", &format!("ΔE00, p95{legend}"));
    drawing.line([left, up.at(p95(own))], [right, up.at(p95(own))], "level");
    let places: Vec<f64> = middles(found.len(), left, right - left).collect();
    let at = |height: &dyn Fn(&Measured) -> Option<f64>| -> Vec<[f64; 2]> {
        places.iter().zip(&found).filter_map(|(x, (_, row))| Some([*x, up.at(height(row)?)])).collect()
    };
    let (all, rings) = (at(&|row| Some(p95(row))), at(&by_itself));
    if are_numbers {
        drawing.path(&rings, "faint");
        drawing.path(&all, "curve");
    }
    for point in rings {
        drawing.circle(point, 4.5, "ring", "");
    }
    for ((_, row), point) in found.iter().zip(all) {
        drawing.circle(point, 4.0, "accent", &told(row));
    }

    let longest = shown().map(|row| row.frame_ms).fold(f64::MIN_POSITIVE, f64::max);
    let (floor, height) = (230.0, 52.0);
    let width = ((right - left) / count(found.len()) * 0.5).min(34.0);
    let crowded = found.len() > 4 && !are_numbers;
    for (i, (x, (value, row))) in places.iter().zip(&found).enumerate() {
        let tall = row.frame_ms / longest * height;
        drawing.bar([x - width / 2.0, floor - tall], [width, tall], Paint::Class("time"), &told(row));
        drawing.small([*x, floor - tall - 3.0], "middle", &short(row.frame_ms));
        // Long names side by side take turns above and below.
        let lower = if crowded && i % 2 == 1 { 13.0 } else { 0.0 };
        drawing.small([*x, floor + 14.0 + lower], "middle", value);
    }
    let level = floor - own.frame_ms / longest * height;
    drawing.line([left, level], [right, level], "level");
    drawing.line([left, floor], [right, floor], "axis");
    drawing.small([left - 6.0, floor], "end", "ms");
    drawing.small([right, SIZE[1] - 4.0], "end", "dashed: the scene's own setting");
    Some(drawing)
}

/// The next of 1, 2, 4 and 8 times a power of ten, whose quarters are short to write.
fn round_up(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 4.0, 8.0, 10.0].map(|factor| factor * power).into_iter().find(|it| *it >= value).unwrap_or(value)
}

/// Mean ΔE00 by cause, a bar a setting; long ones are cut.
pub(super) fn causes(rows: &[Measured]) -> Drawing {
    const WIDTH: f64 = 860.0;
    const LINE: f64 = 20.0;
    let rows = &rows[..rows.len().min(MOST_BARS)];
    let (left, right, top) = (250.0, WIDTH - 70.0, 72.0);
    let mut drawing = Drawing::new(WIDTH, count(rows.len()).mul_add(LINE, top + 16.0));
    let sum = |row: &Measured| row.causes.iter().map(|(_, error)| error.delta_e.mean).sum::<f64>();
    let mut sums: Vec<f64> = rows.iter().map(sum).filter(|sum| sum.is_finite()).collect();
    sums.sort_by(f64::total_cmp);
    // A few large ones must not hide all others.
    let middle = sums.get(sums.len() / 2).copied().unwrap_or(1.0);
    let most = round_up(sums.last().copied().unwrap_or(1.0).min(4.0 * middle).max(LEAST));
    let mut x = 20.0;
    for (cause, colour) in Cause::ALL.into_iter().zip(PARTS) {
        let is_there =
            |row: &Measured| row.causes.iter().any(|(known, error)| *known == cause && error.delta_e.mean > 0.0);
        if rows.iter().any(is_there) {
            drawing.bar([x, 10.0], [11.0, 11.0], Paint::Colour(colour), cause.name());
            drawing.small([x + 15.0, 20.0], "start", cause.name());
            x += 26.0 + 5.6 * count(cause.name().len());
        }
    }
    drawing.small([left, 42.0], "start", "ΔE00 on average: the sum of the parts; → is longer than the axis");
    for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
        let at = (right - left).mul_add(part, left);
        drawing.line([at, top - 4.0], [at, count(rows.len()).mul_add(LINE, top)], "grid");
        drawing.small([at, top - 8.0], "middle", &short(part * most));
    }
    for (i, row) in rows.iter().enumerate() {
        let y = count(i).mul_add(LINE, top);
        drawing.text([left - 10.0, y + 12.0], "ink", "end", &row.setting.to_string());
        let mut from = 0.0;
        for (cause, error) in &row.causes {
            let mean = error.delta_e.mean;
            let colour = Cause::ALL.iter().position(|known| known == cause).map_or("#999999", |at| PARTS[at]);
            let ends = [from, from + mean].map(|sum: f64| sum.min(most) / most * (right - left));
            let told =
                format!("{}: ΔE00 {} on average, at most {}", cause.name(), short(mean), short(error.delta_e.max));
            if ends[1] - ends[0] > 0.05 {
                drawing.bar([left + ends[0], y], [ends[1] - ends[0], LINE - 5.0], Paint::Colour(colour), &told);
            }
            from += mean;
        }
        let end = from.min(most) / most * (right - left) + left;
        let cut = if from > most { " →" } else { "" };
        drawing.small([end + 6.0, y + 12.0], "start", &format!("{}{cut}", short(from)));
    }
    drawing
}
