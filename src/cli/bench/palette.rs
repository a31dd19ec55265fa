//! `relume bench palette`: errors and times of palette design.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use serde_json::json;

use relume::measure::Stopwatch;
use relume::palette;
use relume::progress::Progress;

use super::frames::Times;
use super::{CliError, Report};

/// Palette files, and scenes with a palette.
const PALETTES: [(&str, &str); 15] = [
    ("metamers", include_str!("../../../data/palettes/metamers.toml")),
    ("metamers_two_lights", include_str!("../../../data/palettes/metamers_two_lights.toml")),
    ("metameric_black", include_str!("../../../data/palettes/metameric_black.toml")),
    ("metameric_black_two_lights", include_str!("../../../data/palettes/metameric_black_two_lights.toml")),
    ("xray", include_str!("../../../data/palettes/xray.toml")),
    ("constancy", include_str!("../../../data/palettes/constancy.toml")),
    ("negative", include_str!("../../../data/palettes/negative.toml")),
    ("background", include_str!("../../../data/palettes/background.toml")),
    ("daylight_and_bulb", include_str!("../../../data/palettes/daylight_and_bulb.toml")),
    ("one_light_each", include_str!("../../../data/palettes/one_light_each.toml")),
    ("one_light_each_of_eight", include_str!("../../../data/palettes/one_light_each_of_eight.toml")),
    ("figure 1", include_str!("../../../data/figures/fig1.toml")),
    ("figure 5", include_str!("../../../data/figures/fig5.toml")),
    ("figure 6", include_str!("../../../data/figures/fig6.toml")),
    ("figure 7", include_str!("../../../data/figures/fig7.toml")),
];

/// Measurement of one palette.
#[derive(Serialize)]
struct Row {
    palette: &'static str,
    materials: usize,
    lights: usize,
    /// Largest ΔE00 of a cell.
    worst: f64,
    /// In a conflict: lower limit of the root mean square ΔE00, and its actual value.
    least: Option<f64>,
    reached: Option<f64>,
    solve: Times,
}

pub(super) fn run(times: u32, progress: &dyn Progress) -> Result<Report, CliError> {
    let mut rows = Vec::new();
    for (name, text) in PALETTES {
        let palette = palette::parse(name, text, Path::new(""))?;
        let mut solutions = Vec::new();
        for _ in 0..times {
            let clock = Stopwatch::start();
            let solution = palette::solve(&palette, progress)?;
            solutions.push((solution, clock.read()));
        }
        let taken: Vec<_> = solutions.iter().map(|(_, time)| *time).collect();
        let Some((solution, _)) = solutions.pop() else { continue };
        let conflict = solution.conflicts.first();
        rows.push(Row {
            palette: name,
            materials: palette.materials.len(),
            lights: palette.lights.len(),
            worst: solution.worst(),
            least: conflict.map(|conflict| conflict.least),
            reached: conflict.map(|conflict| conflict.reached),
            solve: Times::of(&taken),
        });
    }
    Ok(Report { text: text(&rows), json: json!({ "palettes": rows }) })
}

fn text(rows: &[Row]) -> String {
    let mut text =
        "Palettes: largest ΔE00 of a target; of conflicting targets, the least possible rms ΔE00 and the reached one\n\
                    palette                     size   largest   least reached   wall ms    CPU ms\n"
            .to_owned();
    let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.3}"));
    for row in rows {
        let median = |times: &Option<relume::measure::Summary>| times.as_ref().map_or(0.0, |times| times.median);
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{:<27} {:>2}×{:<2} {:>8.4} {:>7} {:>7} {:>9.0} {:>9.0}",
            row.palette,
            row.materials,
            row.lights,
            row.worst,
            number(row.least),
            number(row.reached),
            median(&row.solve.wall_ms),
            median(&row.solve.cpu_ms)
        );
    }
    text
}
