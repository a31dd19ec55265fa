//! Units of length and other texts of files.

use crate::Unit;

/// Number of units in a metre.
fn per_metre(unit: Unit) -> f64 {
    match unit {
        Unit::Centimetre => 1e2,
        Unit::Millimetre => 1e3,
        Unit::Micrometre => 1e6,
        Unit::Nanometre => 1e9,
        Unit::Angstrom => 1e10,
    }
}

/// A length of `factor` times `unit`, in `own` units.
pub(crate) fn converted(length: f64, (unit, factor): (Unit, f64), own: Unit) -> f64 {
    // One division, so that whole numbers stay whole.
    length * factor * per_metre(own) / per_metre(unit)
}

/// The unit that `name` is a multiple of, and the factor; `None` if it is no unit of length.
pub(crate) fn unit(name: &str) -> Option<(Unit, f64)> {
    let name = name.trim();
    if let Some(unit) = Unit::named(name) {
        return Some((unit, 1.0));
    }
    Some(match name {
        "m" | "meter" | "metre" | "meters" | "metres" => (Unit::Millimetre, 1e3),
        "dm" | "decimeter" => (Unit::Millimetre, 1e2),
        "km" | "kilometer" | "kilometers" => (Unit::Millimetre, 1e6),
        "pm" | "picometer" => (Unit::Angstrom, 1e-2),
        "in" | "inch" | "inches" | "\"" => (Unit::Millimetre, 25.4),
        "ft" | "foot" | "feet" => (Unit::Millimetre, 304.8),
        _ => return None,
    })
}

/// The sentence about axes x, y and z of which `holder` states no spacing, and the `spacing` that is used; `None` if it
/// states all of them.
pub(crate) fn assumed_spacing(holder: &str, unknown: [bool; 3], spacing: [f64; 3]) -> Option<String> {
    let list = |words: Vec<String>, between: &str| words.join(between);
    if unknown == [true; 3] {
        let spacing = list(spacing.iter().map(ToString::to_string).collect(), " ");
        return Some(format!("{holder} states no spacing; Relume uses {spacing}"));
    }
    let unknown: Vec<usize> = (0..3).filter(|&axis| unknown[axis]).collect();
    let along = list(unknown.iter().map(|&axis| ["x", "y", "z"][axis].to_owned()).collect(), " and ");
    let mut used: Vec<String> = unknown.iter().map(|&axis| spacing[axis].to_string()).collect();
    used.dedup();
    let used = list(used, " and ");
    (!unknown.is_empty()).then(|| format!("{holder} states no spacing along {along}; Relume uses {used}"))
}

/// A text of a file for one line of a message: without control characters, and shortened.
pub(crate) fn printable(text: &str) -> String {
    const LONGEST: usize = 80;
    let mut line: String = text.trim().chars().map(|letter| if letter.is_control() { ' ' } else { letter }).collect();
    if let Some((end, _)) = line.char_indices().nth(LONGEST) {
        line.truncate(end);
        line.push('…');
    }
    line
}
