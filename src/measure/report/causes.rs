//! Chart of errors by cause: a line per setting with the total error and its parts.

use super::drawing::{Drawing, Logarithmic, PARTS, Paint, escaped, tick};
use super::entry::{Entry, LEAST, name, told_error};
use crate::findings::by_cause;
use crate::ladder::Cause;
use crate::measured::Measured;
use crate::setting::Setting;
use relume_base::number::count;

/// Largest number of lines.
const MOST_LINES: usize = 60;

/// Causes with a measurable effect on any of `entries`, in order from the truth to the picture.
pub(super) fn told_causes(entries: &[Entry<'_>]) -> Vec<Cause> {
    let told = |cause: &Cause| entries.iter().any(|entry| by_cause(entry.row, *cause) >= LEAST);
    Cause::ALL.into_iter().filter(told).collect()
}

/// Whether the errors of two rows are indistinguishable.
fn are_alike(one: &Measured, two: &Measured) -> bool {
    let near = |one: f64, two: f64| (one - two).abs() < LEAST;
    near(one.error.delta_e.mean, two.error.delta_e.mean)
        && Cause::ALL.into_iter().all(|cause| near(by_cause(one, cause), by_cause(two, cause)))
}

/// Chart of causes, and the names of the settings with the same errors as the first.
pub(super) fn causes(entries: &[Entry<'_>]) -> String {
    let Some((own, others)) = entries.split_first() else { return String::new() };
    let (alike, different): (Vec<&Entry<'_>>, Vec<&Entry<'_>>) =
        others.iter().partition(|entry| are_alike(own.row, entry.row));
    let rows: Vec<&Measured> = std::iter::once(own.row).chain(different.iter().map(|entry| entry.row)).collect();
    let drawn = lines(&rows[..rows.len().min(MOST_LINES)], &told_causes(entries)).inline("error by cause");
    let names = |settings: &mut dyn Iterator<Item = &Setting>| settings.map(Setting::to_string).collect::<Vec<_>>();
    let itself = names(&mut own.also.iter().copied());
    let same = names(
        &mut alike.iter().flat_map(|entry| std::iter::once(&entry.row.setting).chain(entry.also.iter().copied())),
    );
    let said = [("Equivalent to the scene's own", itself), ("Same errors as the scene's own", same)];
    let said: String = said
        .into_iter()
        .filter(|(_, names)| !names.is_empty())
        .map(|(what, names)| format!("<p class=\"about\">{what}: {}.</p>\n", escaped(&names.join(", "))))
        .collect();
    format!("<div class=\"wide\">\n{drawn}</div>\n{said}")
}

fn lines(rows: &[&Measured], causes: &[Cause]) -> Drawing {
    const WIDTH: f64 = 860.0;
    const LINE: f64 = 20.0;
    let [left, middle, bar, right, top] = [200.0, 420.0, 480.0, WIDTH - 10.0, 52.0];
    let bottom = count(rows.len()).mul_add(LINE, top);
    let mut drawing = Drawing::new(WIDTH, bottom + 8.0);
    let colour = |cause: Cause| Cause::ALL.iter().position(|known| *known == cause).map_or("#999999", |at| PARTS[at]);
    drawing.small([left, 14.0], "start", "mean ΔE00, all causes");
    let mut at = [bar, 14.0];
    for &cause in causes {
        let long = 24.0 + 5.8 * count(cause.name().chars().count());
        if at[0] + long > right + 10.0 {
            at = [bar, at[1] + 15.0];
        }
        drawing.bar([at[0], at[1] - 9.0], [11.0, 11.0], Paint::Colour(colour(cause)), cause.name());
        drawing.small([at[0] + 15.0, at[1]], "start", cause.name());
        at[0] += long;
    }
    let mean = |row: &Measured| row.error.delta_e.mean.max(LEAST);
    let across = Logarithmic::of(rows.iter().map(|row| mean(row)), left + 6.0, middle);
    for value in across.ticks() {
        drawing.line([across.at(value), top - 6.0], [across.at(value), bottom], "grid");
        drawing.small([across.at(value), top - 10.0], "middle", &tick(value));
    }
    for (i, row) in rows.iter().enumerate() {
        let y = count(i).mul_add(LINE, top);
        let centre = [across.at(mean(row)), y + 8.0];
        let told = told_error(row.error.delta_e.mean);
        drawing.text([left - 10.0, y + 12.0], "ink", "end", &name(&row.setting));
        drawing.circle(centre, 4.0, "accent", &format!("ΔE00 {told} on average"));
        if i == 0 {
            drawing.circle(centre, 7.5, "own", "");
        }
        drawing.small([centre[0] + 11.0, y + 12.0], "start", &told);
        // Without a measurable sum, no parts are drawn.
        let sum: f64 = causes.iter().map(|&cause| by_cause(row, cause)).sum();
        let mut from = bar;
        for (cause, error) in row.causes.iter().filter(|(cause, _)| sum >= LEAST && causes.contains(cause)) {
            let [mean, max] = [error.delta_e.mean, error.delta_e.max];
            let long = (right - bar) * mean / sum;
            let told = format!("{}: ΔE00 {} on average, at most {}", cause.name(), told_error(mean), told_error(max));
            if long > 0.3 {
                drawing.bar([from, y], [long, LINE - 5.0], Paint::Colour(colour(*cause)), &told);
            }
            from += long;
        }
    }
    drawing
}
