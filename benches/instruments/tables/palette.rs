//! Table of the errors and times of palette design.

use std::fmt::Write as _;

use relume::measure::Summary;

use crate::palette::PaletteRow;

/// Table with a row per palette.
pub(crate) fn text(rows: &[PaletteRow]) -> String {
    let mut text =
        "Palettes: largest ΔE00 of a target; of conflicting targets, the least possible rms ΔE00 and the reached one;\n\
         rms ΔE00 of all targets, and the least known\n\
         palette                     size   largest   least reached     rms   known   wall ms    CPU ms\n"
            .to_owned();
    let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.3}"));
    for row in rows {
        let median = |times: &Option<Summary>| times.as_ref().map_or(0.0, |times| times.median);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:<27} {:>2}×{:<2} {:>8.4} {:>7} {:>7} {:>7.3} {:>7} {:>9.0} {:>9.0}",
            row.palette,
            row.materials,
            row.lights,
            row.worst,
            number(row.least),
            number(row.reached),
            row.residual,
            number(row.best_known),
            median(&row.solve.wall_ms),
            median(&row.solve.cpu_ms)
        );
    }
    text
}
