//! `relume bench palette`: errors and times of palette design.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;
use serde_json::json;

use relume::measure::Stopwatch;
use relume::palette;
use relume::progress::Progress;
use relume::spectrum::standard;

use super::frames::Times;
use super::hard_palettes;
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
    palette: String,
    materials: usize,
    lights: usize,
    /// Largest ΔE00 of a cell.
    worst: f64,
    /// In a conflict: lower limit of the root mean square ΔE00, and its actual value.
    least: Option<f64>,
    reached: Option<f64>,
    /// Root mean square ΔE00 of the cells with a target.
    residual: f64,
    /// Least residual known, of a seeded palette.
    best_known: Option<f64>,
    solve: Times,
}

/// Root mean square ΔE00 of the cells with a target; 0 without targets.
fn residual(solution: &palette::Solution) -> f64 {
    let differences = solution.cells.iter().filter_map(|cell| cell.difference);
    let (squares, count) =
        differences.fold((0.0, 0.0_f64), |(squares, count), one| (one.mul_add(one, squares), count + 1.0));
    (squares / count.max(1.0)).sqrt()
}

pub(super) fn run(times: u32, progress: &dyn Progress) -> Result<Report, CliError> {
    let mut rows = Vec::new();
    let mut palettes = Vec::new();
    for (name, text) in PALETTES {
        palettes.push((name.to_owned(), palette::parse(name, text, Path::new(""))?, None));
    }
    let light = |name: &str| Some(standard::light(name).ok()?.spectrum().clone());
    let hard = hard_palettes::nearly_black(light).into_iter();
    palettes.extend(hard.map(|hard| (hard.name, hard.palette, Some(hard.best_known))));
    for (name, palette, best_known) in palettes {
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
            residual: residual(&solution),
            best_known,
            solve: Times::of(&taken),
        });
    }
    Ok(Report { text: text(&rows), json: json!({ "palettes": rows }) })
}

fn text(rows: &[Row]) -> String {
    let mut text =
        "Palettes: largest ΔE00 of a target; of conflicting targets, the least possible rms ΔE00 and the reached one;\n\
         rms ΔE00 of all targets, and the least known\n\
         palette                     size   largest   least reached     rms   known   wall ms    CPU ms\n"
            .to_owned();
    let number = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.3}"));
    for row in rows {
        let median = |times: &Option<relume::measure::Summary>| times.as_ref().map_or(0.0, |times| times.median);
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
