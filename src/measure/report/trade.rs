//! Chart of time against error: a dot per setting, and a line through the Pareto-optimal ones.

use super::drawing::{Drawing, Logarithmic, tick};
use super::entry::{Entry, LEAST};
use super::labels::Labels;
use super::trust::Trust;

const WIDTH: f64 = 860.0;
const HEIGHT: f64 = 440.0;
/// Distance within which dots share a tooltip.
const TOGETHER: f64 = 3.0;

/// Formats a number on an axis of ΔE00 that ends at [`LEAST`].
pub(super) fn floored(value: f64) -> String {
    if value > LEAST * 1.0001 { tick(value) } else { format!("≤ {}", tick(LEAST)) }
}

pub(super) fn p95(entry: &Entry<'_>) -> f64 {
    entry.row.error.delta_e.p95.max(LEAST)
}

/// Draws time against error, with a line through the Pareto-optimal settings unless times are rough.
pub(super) fn trade(entries: &[Entry<'_>], trust: Trust) -> Drawing {
    let (left, right, top, bottom) = (62.0, WIDTH - 20.0, 34.0, HEIGHT - 46.0);
    let mut drawing = Drawing::new(WIDTH, HEIGHT);
    let across = Logarithmic::of(entries.iter().map(|entry| entry.row.frame_ms), left, right);
    // Leaves room for names below the lowest dots.
    let lowest = entries.iter().map(p95).fold(f64::INFINITY, f64::min);
    let up = Logarithmic::of(entries.iter().map(p95).chain([(0.6 * lowest).max(LEAST)]), bottom, top);
    for value in across.ticks() {
        let x = across.at(value);
        drawing.line([x, top], [x, bottom], "grid");
        drawing.small([x, bottom + 16.0], "middle", &tick(value));
    }
    for value in up.ticks() {
        let y = up.at(value);
        drawing.line([left, y], [right, y], "grid");
        drawing.small([left - 8.0, y + 4.0], "end", &floored(value));
    }
    drawing.text([left, 20.0], "ink", "start", "p95 of ΔE00 over the compared pixels");
    drawing.text(
        [right, bottom + 36.0],
        "ink",
        "end",
        if trust.is_rough() { "rough time per frame, ms" } else { "time per frame, ms" },
    );

    let place = |entry: &Entry<'_>| [across.at(entry.row.frame_ms), up.at(p95(entry))];
    let mut front: Vec<&Entry<'_>> = entries.iter().filter(|entry| trust.is_best(entry.row)).collect();
    front.sort_by(|one, two| one.row.frame_ms.total_cmp(&two.row.frame_ms));
    let points: Vec<[f64; 2]> = front.iter().map(|entry| place(entry)).collect();
    if !points.is_empty() {
        drawing.path(&points, "front");
    }

    let own = entries.first();
    let radius = |entry: &Entry<'_>| match own {
        Some(own) if std::ptr::eq(own, entry) => 9.0,
        _ if trust.is_best(entry.row) => 5.0,
        _ => 4.0,
    };
    let dots: Vec<([f64; 2], f64)> = entries.iter().map(|entry| (place(entry), radius(entry) + 1.0)).collect();
    let mut labels = Labels::new([left, top, right, bottom], &dots, &points);
    let named =
        own.into_iter().chain(front.iter().copied().filter(|entry| own.is_none_or(|own| !std::ptr::eq(own, *entry))));
    for entry in named {
        let Some(found) = labels.place(place(entry), radius(entry) + 1.0, &entry.name()) else { continue };
        if let Some([from, to]) = found.leader {
            drawing.line(from, to, "axis");
        }
        drawing.text(found.at, "ink", "start", &entry.name());
    }
    // Other settings get names only where there is room beside their dots.
    let is_named = |entry: &Entry<'_>| trust.is_best(entry.row) || own.is_some_and(|own| std::ptr::eq(own, entry));
    for entry in entries.iter().filter(|entry| !is_named(entry)) {
        if let Some(at) = labels.beside(place(entry), radius(entry) + 1.0, &entry.name()) {
            drawing.small(at, "start", &entry.name());
        }
    }

    // Drawn last, so that tooltips work; settings at one place share a tooltip.
    let told = |entry: &Entry<'_>| {
        let [x, y] = place(entry);
        let near = |other: &&Entry<'_>| {
            let [other_x, other_y] = place(other);
            (x - other_x).hypot(y - other_y) <= TOGETHER
        };
        entries.iter().filter(near).map(|entry| entry.described(trust)).collect::<Vec<_>>().join("\n")
    };
    for entry in entries.iter().filter(|entry| !trust.is_best(entry.row)).chain(front) {
        let (class, radius) = if trust.is_best(entry.row) { ("accent", 5.0) } else { ("dot", 4.0) };
        drawing.circle(place(entry), radius, class, &told(entry));
    }
    if let Some(own) = own {
        drawing.circle(place(own), 9.0, "own", &told(own));
    }
    drawing
}
