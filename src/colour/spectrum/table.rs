//! Curves through tabulated points, also read from text files.

use std::path::Path;

use serde::Deserialize;

use super::{FIRST_NM, LAST_NM, SpectrumError};
use relume_base::input;

/// Largest number of rows: even a spacing of 0.01 nm needs fewer.
const MOST_ROWS: usize = 100_000;

/// Longest line in bytes, enough for thousands of columns.
const LONGEST_LINE: usize = 1 << 16;

/// Column of a file with the values of a spectrum.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
#[serde(untagged, expecting = "a column is a name or a number from 1")]
pub enum Column {
    /// Column number from 1; column 1 holds the wavelengths.
    Number(usize),
    /// Column name in the header line; case is ignored.
    Name(String),
}

/// Piecewise linear curve, constant beyond its ends.
pub(super) struct Curve {
    /// Wavelengths in nm, strictly ascending, and values; never empty.
    points: Vec<(f64, f64)>,
}

impl Curve {
    /// Builds the curve through `points` in any order; see [`super::Spectrum::interpolate`].
    pub(super) fn new(points: &[(f64, f64)]) -> Result<Self, SpectrumError> {
        let mut points = points.to_vec();
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
        for &(nm, value) in &points {
            if let Some(problem) = point_problem(nm, value) {
                return Err(SpectrumError::Points(problem));
            }
        }
        for pair in points.windows(2) {
            if pair[0].0 >= pair[1].0 {
                return Err(SpectrumError::Points(format!("the wavelength {} nm is given twice", pair[0].0)));
            }
        }
        let (Some(&(first, _)), Some(&(last, _))) = (points.first(), points.last()) else {
            return Err(SpectrumError::Points("a table of a spectrum needs at least one wavelength".to_owned()));
        };
        if last < FIRST_NM || first > LAST_NM {
            let hint = if last < 10.0 { "; are they in micrometres? Write nm" } else { "" };
            return Err(SpectrumError::Points(format!(
                "the wavelengths run from {first} to {last} nm, outside {FIRST_NM} to {LAST_NM} nm{hint}"
            )));
        }
        Ok(Self { points })
    }

    /// Value at a wavelength.
    pub(super) fn at(&self, nm: f64) -> f64 {
        let above = self.points.partition_point(|point| point.0 <= nm);
        match (above.checked_sub(1).and_then(|below| self.points.get(below)), self.points.get(above)) {
            (Some(&(nm0, value0)), Some(&(nm1, value1))) => {
                let share = (nm - nm0) / (nm1 - nm0);
                value0 * (1.0 - share) + value1 * share
            }
            (Some(&(_, value)), None) | (None, Some(&(_, value))) => value,
            (None, None) => f64::NAN,
        }
    }

    /// Mean over the part of `from..to` between the curve's ends; the value at the middle of `from..to` if that part is
    /// empty.
    pub(super) fn mean(&self, from: f64, to: f64) -> f64 {
        let first = self.points.first().map_or(from, |point| point.0.max(from));
        let last = self.points.last().map_or(to, |point| point.0.min(to));
        if first >= last {
            return self.at((from + to) / 2.0);
        }
        let inner = self.points.iter().map(|point| point.0).filter(|&nm| first < nm && nm < last);
        let mut mean = 0.0;
        let mut start = first;
        for end in inner.chain([last]) {
            let share = (end - start) / (last - first);
            mean += share * (0.5 * self.at(start) + 0.5 * self.at(end));
            start = end;
        }
        mean
    }
}

/// Returns the reason why a point is invalid, if any.
fn point_problem(nm: f64, value: f64) -> Option<String> {
    if !(nm.is_finite() && nm > 0.0) {
        return Some(format!("a wavelength must be a positive number of nm, not {nm}"));
    }
    (!value.is_finite()).then(|| format!("the value at {nm} nm must be finite, not {value}"))
}

/// Reads wavelengths in nm and values from a text file, in the file's order.
///
/// Columns are separated by semicolons, tabs, commas or blanks. Blank lines and comments (`#`, `%`) are skipped; one
/// header line may come first. The first column is the wavelength; `column` is optional in a file of two columns.
///
/// # Errors
///
/// A [`SpectrumError`] with the file and, where known, the line.
pub(super) fn read(path: &Path, column: Option<&Column>) -> Result<Vec<(f64, f64)>, SpectrumError> {
    let text = read_text(path)?;
    let text = text.strip_prefix('\u{feff}').unwrap_or(&text);
    let mut header: Option<Vec<&str>> = None;
    let mut chosen: Option<usize> = None;
    let mut rows: Vec<(usize, f64, f64)> = Vec::new();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if line.is_empty() || line.starts_with(['#', '%']) {
            continue;
        }
        let wrong = |problem| SpectrumError::Line { path: path.into(), line: number, text: shortened(line), problem };
        if line.len() > LONGEST_LINE {
            return Err(wrong(format!("a line has at most {LONGEST_LINE} bytes")));
        }
        let fields = fields(line);
        if rows.is_empty() && header.is_none() && fields.first().is_some_and(|field| field.parse::<f64>().is_err()) {
            header = Some(fields);
            continue;
        }
        let index = match chosen {
            Some(index) => index,
            None => *chosen.insert(choose(path, column, header.as_deref(), fields.len())?),
        };
        let nm = parsed(&fields, 0).map_err(wrong)?;
        let value = parsed(&fields, index).map_err(wrong)?;
        if let Some(problem) = point_problem(nm, value) {
            return Err(wrong(problem));
        }
        if rows.len() == MOST_ROWS {
            return Err(wrong(format!("a spectrum has at most {MOST_ROWS} wavelengths")));
        }
        rows.push((number, nm, value));
    }
    if rows.is_empty() {
        return Err(SpectrumError::Empty { path: path.into() });
    }
    refuse_repetition(path, text, &rows)?;
    Ok(rows.into_iter().map(|(_, nm, value)| (nm, value)).collect())
}

fn read_text(path: &Path) -> Result<String, SpectrumError> {
    const LARGEST: u64 = 10_000_000;
    let unreadable = |source| SpectrumError::Read { path: path.into(), source };
    let bytes = input::read(path, LARGEST).map_err(unreadable)?;
    if u64::try_from(bytes.len()).is_ok_and(|length| length > LARGEST) {
        return Err(SpectrumError::TooLarge { path: path.into() });
    }
    match String::from_utf8(bytes) {
        Ok(text) if !text.contains('\0') => Ok(text),
        _ => Err(SpectrumError::NotText { path: path.into() }),
    }
}

/// Splits a line into fields without quotes; a trailing separator adds none.
fn fields(line: &str) -> Vec<&str> {
    let separator = [';', '\t', ','].into_iter().find(|&separator| line.contains(separator));
    let mut fields: Vec<&str> = match separator {
        Some(separator) => line.split(separator).map(|field| field.trim().trim_matches('"')).collect(),
        None => line.split_whitespace().map(|field| field.trim_matches('"')).collect(),
    };
    if fields.last().is_some_and(|field| field.is_empty()) {
        fields.pop();
    }
    fields
}

fn parsed(fields: &[&str], index: usize) -> Result<f64, String> {
    let field = fields.get(index).ok_or_else(|| format!("column {} is missing", index + 1))?;
    field.parse().map_err(|_| format!("{:?} is not a number", shortened(field)))
}

/// Index, from 0, of the column of values.
fn choose(path: &Path, column: Option<&Column>, header: Option<&[&str]>, count: usize) -> Result<usize, SpectrumError> {
    let problem = match column {
        None if count == 2 => return Ok(1),
        None => "choose the column of values with `column = NAME` or `column = NUMBER`".to_owned(),
        Some(Column::Number(1)) => "column 1 holds the wavelengths".to_owned(),
        Some(&Column::Number(number)) if (2..=count).contains(&number) => return Ok(number - 1),
        Some(Column::Number(number)) => format!("there is no column {number}"),
        Some(Column::Name(name)) => {
            let is_named = |field: &&str| field.eq_ignore_ascii_case(name.trim());
            match header.and_then(|header| header.iter().position(is_named)) {
                Some(0) => format!("the column {name:?} holds the wavelengths"),
                Some(index) => return Ok(index),
                None => format!("there is no column {name:?}"),
            }
        }
    };
    let columns = match header {
        Some(header) => shortened(&header.join(", ")),
        None => format!("numbered 1 to {count}, without names"),
    };
    Err(SpectrumError::Column { path: path.into(), problem, columns })
}

fn refuse_repetition(path: &Path, text: &str, rows: &[(usize, f64, f64)]) -> Result<(), SpectrumError> {
    let mut sorted = rows.to_vec();
    sorted.sort_by(|a, b| a.1.total_cmp(&b.1));
    for pair in sorted.windows(2) {
        if pair[0].1 >= pair[1].1 {
            let line = pair[1].0;
            let problem = format!("the wavelength {} nm was already given on line {}", pair[1].1, pair[0].0);
            let text = shortened(text.lines().nth(line - 1).unwrap_or_default());
            return Err(SpectrumError::Line { path: path.into(), line, text, problem });
        }
    }
    Ok(())
}

/// Truncates to 60 characters.
fn shortened(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
