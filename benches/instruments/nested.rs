//! Random palettes within nested bounds: whether wider bounds end with a worse result.

use std::fmt::Write as _;

use serde::Serialize;

use relume::model::random::Random;
use relume::palette::{Cell, LAMP, Member, NATURAL, Palette, PaletteError, SMOOTHNESS, Target, solve, solve_from};
use relume::progress::Progress;
use relume::spectrum::Spectrum;
use relume::spectrum::colour::Lab;

/// Number of nested bounds for each palette.
pub(crate) const LEVELS: usize = 4;
/// ΔE00 below which the search ends.
const EXACT: f64 = 1e-3;
/// Largest relative difference by rounding.
const ROUNDING: f64 = 1e-6;
/// A tenth of a just noticeable difference.
pub(crate) const INVISIBLE: f64 = 0.1;
/// Given lights.
const LIGHTS: [&str; 5] = ["D65", "A", "D50", "E", "FL2"];

/// Largest ΔE00 of a seeded palette.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct NestedRow {
    pub(crate) seed: u64,
    /// Within bounds of which each contains the one before.
    pub(crate) worst: [f64; LEVELS],
    /// The same, each started from the solution before.
    pub(crate) started: [f64; LEVELS],
    /// Within the default bounds, and within bounds that contain these and the last of the others.
    pub(crate) default: [f64; 2],
}

/// Returns whether `wide` is worse than `narrow`, by more than rounding.
fn is_worse(narrow: f64, wide: f64) -> bool {
    wide > narrow.max(EXACT) * (1.0 + ROUNDING)
}

impl NestedRow {
    /// Whether the solver keeps its promises: a known start is never made worse, nor makes a solution worse; and bounds that
    /// contain the default ones are never worse than these.
    pub(crate) fn holds(&self) -> bool {
        let [default, wider] = self.default;
        let is_kept = !self.started.windows(2).any(|pair| is_worse(pair[0], pair[1]));
        let is_gain = !self.worst.iter().zip(&self.started).any(|(alone, started)| is_worse(*alone, *started));
        is_kept && is_gain && !is_worse(default, wider)
    }

    /// Largest ΔE00 within each pair of nested bounds.
    fn pairs(&self) -> impl Iterator<Item = [f64; 2]> {
        (0..LEVELS).flat_map(move |narrow| (narrow + 1..LEVELS).map(move |wide| [self.worst[narrow], self.worst[wide]]))
    }
}

/// A palette of one to three materials and two or three lights, some of them given, with random targets.
pub(crate) fn random_palette(seed: u64, light: impl Fn(&str) -> Option<Spectrum>) -> Palette {
    let mut random = Random::new(seed);
    let member = |name: String, bounds| Member { name, spectrum: None, bounds, smoothness: SMOOTHNESS };
    let (rows, columns) = (1 + random.index(3), 2 + random.index(2));
    let given = random.index(columns);
    let lights = (0..columns).map(|column| {
        let spectrum = if column < given { light(LIGHTS[random.index(LIGHTS.len())]) } else { None };
        Member { spectrum, ..member(format!("light {column}"), LAMP) }
    });
    let lights = lights.collect();
    let mut cells = Vec::new();
    for (material, light) in (0..rows).flat_map(|material| (0..columns).map(move |light| (material, light))) {
        let colour = Lab([random.between(5.0, 95.0), random.between(-40.0, 40.0), random.between(-40.0, 40.0)]);
        let target = match random.index(6) {
            0 if (material, light) != (0, 0) => Target::Like { material: 0, light: 0 },
            1 => Target::Black,
            2 => continue,
            _ => Target::Lab(colour),
        };
        cells.push(Cell { material, light, target, weight: 1.0 });
    }
    let materials = (0..rows).map(|row| member(format!("material {row}"), NATURAL)).collect();
    Palette { source: format!("random {seed}"), inputs: Vec::new(), materials, lights, cells, model: None }
}

/// Nested bounds within these ranges of the lower and the upper one.
fn nested(random: &mut Random, lower: [f64; 2], upper: [f64; 2]) -> [[f64; 2]; LEVELS] {
    let [mut low, mut high] =
        [lower, upper].map(|[least, most]| -> [f64; LEVELS] { std::array::from_fn(|_| random.between(least, most)) });
    low.sort_by(|one, two| two.total_cmp(one));
    high.sort_by(f64::total_cmp);
    std::array::from_fn(|level| [low[level], high[level]])
}

/// A palette within nested bounds of this `seed`.
pub(crate) fn nested_levels(palette: &Palette, seed: u64) -> [Palette; LEVELS] {
    let mut random = Random::new(!seed);
    // A third of the palettes has lights with peaks alone, as most palettes of people.
    let is_natural = seed.is_multiple_of(3);
    let mut levels: [Palette; LEVELS] = std::array::from_fn(|_| palette.clone());
    for row in 0..palette.materials.len() {
        let bounds = nested(&mut random, [-1.0, 0.1], [0.4, 2.0]);
        for (level, bounds) in levels.iter_mut().zip(bounds) {
            level.materials[row].bounds = if is_natural { NATURAL } else { bounds };
        }
    }
    for column in 0..palette.lights.len() {
        let bounds = nested(&mut random, [0.0, 0.3], [0.4, 3.7]);
        for (level, [low, high]) in levels.iter_mut().zip(bounds) {
            level.lights[column].bounds = [if is_natural { 0.0 } else { low }, high.exp()];
        }
    }
    levels
}

/// Designs the random palette of `seed` within its nested bounds.
///
/// # Errors
///
/// [`PaletteError::Cancelled`].
pub(crate) fn nested_row(
    seed: u64,
    light: impl Fn(&str) -> Option<Spectrum>,
    progress: &dyn Progress,
) -> Result<NestedRow, PaletteError> {
    let palette = random_palette(seed, light);
    let levels = nested_levels(&palette, seed);
    let mut row = NestedRow { seed, worst: [0.0; LEVELS], started: [0.0; LEVELS], default: [0.0; 2] };
    let mut before: Option<Palette> = None;
    for (level, palette) in levels.iter().enumerate() {
        let solution = solve(palette, progress)?;
        row.worst[level] = solution.worst();
        let started = before.map_or(Ok(solution), |before| solve_from(palette, &before, progress))?;
        row.started[level] = started.worst();
        before = Some(started.with_spectra());
    }
    let mut wider = palette.clone();
    for (wider, last) in
        [(&mut wider.materials, &levels[LEVELS - 1].materials), (&mut wider.lights, &levels[LEVELS - 1].lights)]
    {
        for (wider, last) in wider.iter_mut().zip(last) {
            wider.bounds = [wider.bounds[0].min(last.bounds[0]), wider.bounds[1].max(last.bounds[1])];
        }
    }
    row.default = [solve(&palette, progress)?.worst(), solve(&wider, progress)?.worst()];
    Ok(row)
}

/// Summary of many palettes.
pub(crate) fn text(rows: &[NestedRow]) -> String {
    let pairs: Vec<[f64; 2]> = rows.iter().flat_map(NestedRow::pairs).collect();
    let worse: Vec<f64> =
        pairs.iter().filter(|[narrow, wide]| is_worse(*narrow, *wide)).map(|[narrow, wide]| wide - narrow).collect();
    let visible = worse.iter().filter(|&&more| more > INVISIBLE).count();
    let missed: Vec<u64> = rows.iter().filter(|row| !row.holds()).map(|row| row.seed).collect();
    let mut text = format!(
        "{} random palettes, each within {LEVELS} nested bounds:\n\
         of {} pairs of bounds, the wider ends worse in {}, by more than ΔE00 {INVISIBLE} in {visible}, at most by {:.2}\n",
        rows.len(),
        pairs.len(),
        worse.len(),
        worse.iter().copied().fold(0.0, f64::max),
    );
    let good = pairs.iter().filter(|[narrow, wide]| *narrow <= 10.0 && wide - narrow > INVISIBLE).count();
    let _ = writeln!(text, "where the narrower bounds reach ΔE00 10: by more than {INVISIBLE} in {good}");
    let _ = writeln!(
        text,
        "worse than the default bounds within wider ones, or than a known start: {}",
        if missed.is_empty() { "none".to_owned() } else { format!("seeds {missed:?}") }
    );
    text
}
