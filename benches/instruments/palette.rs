//! Errors and times of palette design.

#[path = "hard_palettes.rs"]
pub(crate) mod hard_palettes;

use std::path::Path;

use serde::Serialize;

use relume::measure::{Stopwatch, Summary, Timing, summary};
use relume::palette::{self, PaletteError, Solution};
use relume::progress::Progress;
use relume::spectrum::standard;

use hard_palettes::{Hard, nearly_black};

/// Palette files, and scenes with a palette.
const PALETTES: [(&str, &str); 15] = [
    ("metamers", include_str!("../../data/palettes/metamers.toml")),
    ("metamers_two_lights", include_str!("../../data/palettes/metamers_two_lights.toml")),
    ("metameric_black", include_str!("../../data/palettes/metameric_black.toml")),
    ("metameric_black_two_lights", include_str!("../../data/palettes/metameric_black_two_lights.toml")),
    ("xray", include_str!("../../data/palettes/xray.toml")),
    ("constancy", include_str!("../../data/palettes/constancy.toml")),
    ("negative", include_str!("../../data/palettes/negative.toml")),
    ("background", include_str!("../../data/palettes/background.toml")),
    ("daylight_and_bulb", include_str!("../../data/palettes/daylight_and_bulb.toml")),
    ("one_light_each", include_str!("../../data/palettes/one_light_each.toml")),
    ("one_light_each_of_eight", include_str!("../../data/palettes/one_light_each_of_eight.toml")),
    ("figure 1", include_str!("../../data/figures/fig1.toml")),
    ("figure 5", include_str!("../../data/figures/fig5.toml")),
    ("figure 6", include_str!("../../data/figures/fig6.toml")),
    ("figure 7", include_str!("../../data/figures/fig7.toml")),
];

/// Times of repeated work.
#[derive(Debug, Serialize)]
pub(crate) struct Times {
    pub(crate) wall_ms: Option<Summary>,
    pub(crate) cpu_ms: Option<Summary>,
}

impl Times {
    fn of(times: &[Timing]) -> Self {
        let over = |value: fn(&Timing) -> f64| summary(&times.iter().map(value).collect::<Vec<_>>());
        Self { wall_ms: over(|time| time.wall_ms), cpu_ms: over(|time| time.cpu_ms) }
    }
}

/// Measurement of one palette.
#[derive(Debug, Serialize)]
pub(crate) struct PaletteRow {
    pub(crate) palette: String,
    pub(crate) materials: usize,
    pub(crate) lights: usize,
    /// Largest ΔE00 of a cell.
    pub(crate) worst: f64,
    /// In a conflict: lower limit of the root mean square ΔE00, and its actual value.
    pub(crate) least: Option<f64>,
    pub(crate) reached: Option<f64>,
    /// Root mean square ΔE00 of the cells with a target.
    pub(crate) residual: f64,
    /// Least residual known, of a seeded palette.
    pub(crate) best_known: Option<f64>,
    pub(crate) solve: Times,
}

/// The seeded palettes.
pub(crate) fn hard_palettes() -> Vec<Hard> {
    nearly_black(|name| Some(standard::light(name).ok()?.spectrum().clone()))
}

/// Root mean square ΔE00 of the cells with a target; 0 without targets.
pub(crate) fn residual(solution: &Solution) -> f64 {
    let differences = solution.cells.iter().filter_map(|cell| cell.difference);
    let (squares, count) =
        differences.fold((0.0, 0.0_f64), |(squares, count), one| (one.mul_add(one, squares), count + 1.0));
    (squares / count.max(1.0)).sqrt()
}

/// Designs each palette `times` times.
///
/// # Errors
///
/// [`PaletteError`] when a palette cannot be solved or `progress` asks to stop.
pub(crate) fn palette_rows(times: u32, progress: &dyn Progress) -> Result<Vec<PaletteRow>, PaletteError> {
    let mut rows = Vec::new();
    let mut palettes = Vec::new();
    for (name, text) in PALETTES {
        palettes.push((name.to_owned(), palette::parse(name, text, Path::new(""))?, None));
    }
    palettes.extend(hard_palettes().into_iter().map(|hard| (hard.name, hard.palette, Some(hard.best_known))));
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
        rows.push(PaletteRow {
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
    Ok(rows)
}
