//! Where errors come from: a bar a setting, in parts.

use super::drawing::{Drawing, PARTS, Paint, escaped};
use super::entry::{CUBIC, Entry, LEAST, name};
use crate::measure::findings::by_cause;
use crate::measure::ladder::Cause;
use crate::measure::setting::{Knob, Setting, Value};
use crate::measure::survey::Measured;
use crate::measure::table::short;
use crate::number::count;

/// The most bars.
const MOST_BARS: usize = 60;

/// The causes that move any of `entries` enough to tell, the largest first.
pub(super) fn told_causes(entries: &[Entry<'_>]) -> Vec<Cause> {
    let each = |cause: Cause| entries.iter().map(move |entry| by_cause(entry.row, cause));
    let mut causes: Vec<Cause> =
        Cause::ALL.into_iter().filter(|&cause| each(cause).any(|mean| mean >= LEAST)).collect();
    let sum = |cause: &Cause| each(*cause).sum::<f64>();
    causes.sort_by(|one, two| sum(two).total_cmp(&sum(one)));
    causes
}

/// Whether nobody can tell two rows apart by what they err by.
fn are_alike(one: &Measured, two: &Measured) -> bool {
    let near = |one: f64, two: f64| (one - two).abs() < LEAST;
    near(one.error.delta_e.mean, two.error.delta_e.mean)
        && Cause::ALL.into_iter().all(|cause| near(by_cause(one, cause), by_cause(two, cause)))
}

/// The bars, and the names of the settings that look as the first does.
pub(super) fn causes(entries: &[Entry<'_>]) -> String {
    let Some((own, others)) = entries.split_first() else { return String::new() };
    let (alike, different): (Vec<&Entry<'_>>, Vec<&Entry<'_>>) =
        others.iter().partition(|entry| are_alike(own.row, entry.row));
    let rows: Vec<&Measured> = std::iter::once(own.row).chain(different.iter().map(|entry| entry.row)).collect();
    let drawn = bars(&rows[..rows.len().min(MOST_BARS)], &told_causes(entries)).inline("error by cause");
    let same: Vec<String> = own
        .also
        .iter()
        .copied()
        .chain(alike.iter().flat_map(|entry| std::iter::once(&entry.row.setting).chain(entry.also.iter().copied())))
        .map(Setting::to_string)
        .collect();
    let same = match same.len() {
        0 => String::new(),
        1 => format!("<p class=\"about\">As the scene's own: {}.</p>\n", escaped(&same[0])),
        number => format!(
            "<p class=\"about\">{number} settings err as the scene's own does: {}.</p>\n",
            escaped(&same.join(", "))
        ),
    };
    let spline = Some(Value::Name("cubic"));
    let is_spline = different.iter().any(|entry| entry.row.setting.get(Knob::Interpolation) == spline);
    let note = if is_spline { format!("<p class=\"about\">interpolation={CUBIC}</p>\n") } else { String::new() };
    format!("<div class=\"wide\">\n{drawn}</div>\n{note}{same}")
}

/// The next of 1, 2, 4 and 8 times a power of ten, whose quarters are short to write.
fn round_up(value: f64) -> f64 {
    let power = 10_f64.powf(value.log10().floor());
    [1.0, 2.0, 4.0, 8.0, 10.0].map(|factor| factor * power).into_iter().find(|it| *it >= value).unwrap_or(value)
}

fn bars(rows: &[&Measured], causes: &[Cause]) -> Drawing {
    const WIDTH: f64 = 860.0;
    const LINE: f64 = 20.0;
    let (left, right, top) = (230.0, WIDTH - 70.0, 72.0);
    let mut drawing = Drawing::new(WIDTH, count(rows.len()).mul_add(LINE, top + 12.0));
    let colour = |cause: Cause| Cause::ALL.iter().position(|known| *known == cause).map_or("#999999", |at| PARTS[at]);
    let sum = |row: &Measured| row.causes.iter().map(|(_, error)| error.delta_e.mean).sum::<f64>();
    let longest = |row: &&Measured| sum(row).max(row.error.delta_e.mean);
    let mut sums: Vec<f64> = rows.iter().map(longest).filter(|sum| sum.is_finite()).collect();
    sums.sort_by(f64::total_cmp);
    // A few large ones must not hide the first, nor most of the others.
    let middle = sums.get(sums.len() / 2).copied().unwrap_or(1.0);
    let enough = (8.0 * rows.first().map_or(1.0, longest)).max(middle);
    let most = round_up(sums.last().copied().unwrap_or(1.0).min(enough).max(LEAST));
    let at = |value: f64| (right - left).mul_add(value.min(most) / most, left);
    let mut x = left;
    for &cause in causes {
        drawing.bar([x, 10.0], [11.0, 11.0], Paint::Colour(colour(cause)), cause.name());
        drawing.small([x + 15.0, 20.0], "start", cause.name());
        x += 30.0 + 6.0 * count(cause.name().len());
    }
    drawing.small([left, 42.0], "start", "mean ΔE00 by cause; number and tick: mean ΔE00 of the whole");
    for part in [0.0, 0.25, 0.5, 0.75, 1.0] {
        drawing.line([at(part * most), top - 4.0], [at(part * most), count(rows.len()).mul_add(LINE, top)], "grid");
        drawing.small([at(part * most), top - 8.0], "middle", &short(part * most));
    }
    for (i, row) in rows.iter().enumerate() {
        let y = count(i).mul_add(LINE, top);
        let tall = LINE - 5.0;
        drawing.text([left - 10.0, y + 12.0], "ink", "end", &name(&row.setting));
        let mut from = 0.0;
        for (cause, error) in &row.causes {
            let mean = error.delta_e.mean;
            let ends = [from, from + mean].map(at);
            let told =
                format!("{}: ΔE00 {} on average, at most {}", cause.name(), short(mean), short(error.delta_e.max));
            if ends[1] - ends[0] > 0.05 {
                drawing.bar([ends[0], y], [ends[1] - ends[0], tall], Paint::Colour(colour(*cause)), &told);
            }
            from += mean;
        }
        if from > most {
            drawing.torn([right, y - 1.0], tall + 2.0);
        }
        let mean = row.error.delta_e.mean;
        if mean <= most {
            drawing.line([at(mean), y - 2.0], [at(mean), y + tall + 2.0], "mark");
        }
        drawing.small([at(from.max(mean)) + 6.0, y + 12.0], "start", &short(mean));
    }
    drawing
}
