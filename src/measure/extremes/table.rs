//! Tables of rows: text for a terminal, Markdown and CSV.

use super::{Group, Row};

/// Column headings of the text tables.
const HEADS: [&str; 6] = ["extreme", "rung", "bound", "measured", "holds", "by"];

/// Returns the cells of a row in the text tables.
fn cells(row: &Row) -> [String; 6] {
    let holds = if row.holds { "yes" } else { "NO" };
    [
        row.name.clone(),
        row.rung.to_string(),
        short(row.bound),
        short(row.measured),
        holds.to_owned(),
        row.derivation.name.to_owned(),
    ]
}

/// Formats a number with two significant digits.
fn short(number: f64) -> String {
    if number == 0.0 || !number.is_finite() { number.to_string() } else { format!("{number:.1e}") }
}

/// Groups the rows, in the order of the groups.
fn by_group(rows: &[Row]) -> impl Iterator<Item = (Group, Vec<&Row>)> {
    let of = |group| rows.iter().filter(move |row| row.group == group).collect::<Vec<_>>();
    Group::ALL.into_iter().map(move |group| (group, of(group))).filter(|(_, rows)| !rows.is_empty())
}

/// Returns each bound of the rows once: name and derivation.
#[must_use]
pub fn derivations(rows: &[Row]) -> Vec<[&'static str; 2]> {
    let mut all: Vec<[&str; 2]> = Vec::new();
    for row in rows {
        let bound = [row.derivation.name, row.derivation.why];
        if !all.contains(&bound) {
            all.push(bound);
        }
    }
    all
}

/// States how many rows hold.
fn verdict(rows: &[Row]) -> String {
    let missed = rows.iter().filter(|row| !row.holds).count();
    match missed {
        0 => format!("All {} rows hold.", rows.len()),
        1 => format!("1 of {} rows does not hold.", rows.len()),
        _ => format!("{missed} of {} rows do not hold.", rows.len()),
    }
}

/// Formats the rows in columns by group, with messages below their rows and the derivations of the bounds at the end.
#[must_use]
pub fn to_text(rows: &[Row]) -> String {
    let table: Vec<[String; 6]> = rows.iter().map(cells).collect();
    let width = |column: usize| {
        let cells = table.iter().map(|row| row[column].chars().count());
        cells.chain([HEADS[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: [usize; 6] = std::array::from_fn(width);
    let line = |cells: &[String; 6]| {
        let padded = cells.iter().zip(widths).enumerate().map(|(column, (cell, width))| match column {
            2 | 3 => format!("{cell:>width$}"),
            _ => format!("{cell:<width$}"),
        });
        format!("{}\n", padded.collect::<Vec<_>>().join("  ").trim_end())
    };
    let mut text = line(&HEADS.map(str::to_owned));
    for (group, rows) in by_group(rows) {
        text.push_str(&format!("\n{}\n", group.name()));
        for row in rows {
            text.push_str(&line(&cells(row)));
            if let Some(said) = &row.said {
                text.push_str(&format!("    {said}\n"));
            }
        }
    }
    text.push_str("\nbounds\n");
    for [name, why] in derivations(rows) {
        text.push_str(&format!("{name}: {why}\n"));
    }
    text.push_str(&format!("\n{}\n", verdict(rows)));
    text
}

/// Formats the same tables in Markdown.
#[must_use]
pub fn to_markdown(rows: &[Row]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | ").replace('*', "\\*"));
    let mut text = String::new();
    for (group, rows) in by_group(rows) {
        text.push_str(&format!("## {}\n\n", group.name()));
        text.push_str(&line(&HEADS.map(str::to_owned)));
        text.push_str("|---|---|--:|--:|---|---|\n");
        for row in rows {
            let mut cells = cells(row);
            if let Some(said) = &row.said {
                cells[0].push_str(&format!(" (“{said}”)"));
            }
            text.push_str(&line(&cells));
        }
        text.push('\n');
    }
    text.push_str("## bounds\n\n");
    for [name, why] in derivations(rows) {
        text.push_str(&format!("- {name}: {why}\n"));
    }
    text.push_str(&format!("\n{}\n", verdict(rows)));
    text
}

/// Formats all numbers as CSV, one row per line; numbers that are not finite are empty.
#[must_use]
pub fn to_csv(rows: &[Row]) -> String {
    let quoted = |text: &str| format!("\"{}\"", text.replace('"', "\"\""));
    let number = |number: f64| if number.is_finite() { number.to_string() } else { String::new() };
    let mut text = "group,name,rung,bound,measured,holds,derivation,said\n".to_owned();
    for row in rows {
        let said = row.said.as_deref().map_or_else(String::new, quoted);
        let cells = [
            row.group.name().to_owned(),
            quoted(&row.name),
            row.rung.to_string(),
            number(row.bound),
            number(row.measured),
            row.holds.to_string(),
            row.derivation.name.to_owned(),
            said,
        ];
        text.push_str(&(cells.join(",") + "\n"));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::extremes::{Bound, Rung};

    fn rows() -> Vec<Row> {
        let row = |name: &str, measured: f64, said: Option<&str>| Row {
            group: Group::Steps,
            name: name.to_owned(),
            rung: Rung::Single,
            bound: 0.0,
            derivation: Bound::EXACT,
            measured,
            holds: measured <= 0.0,
            said: said.map(str::to_owned),
        };
        vec![row("none", 0.0, None), row("a \"long\" one", f64::NAN, Some("it ends, here"))]
    }

    #[test]
    fn a_row_that_does_not_hold_is_counted_and_says_why() {
        let text = to_text(&rows());
        assert!(text.contains("NO") && text.contains("    it ends, here\n"), "{text}");
        assert!(text.ends_with("1 of 2 rows does not hold.\n"), "{text}");
        assert_eq!(text.matches(Bound::EXACT.why).count(), 1, "each bound is explained once: {text}");
        assert!(to_markdown(&rows()).contains("(“it ends, here”) | f32 | 0 | NaN | NO |"), "{}", to_markdown(&rows()));
    }

    #[test]
    fn csv_and_json_say_nothing_where_there_is_no_number() {
        let csv = to_csv(&rows());
        assert!(csv.contains("steps,\"a \"\"long\"\" one\",f32,0,,false,exact,\"it ends, here\"\n"), "{csv}");
        let json = serde_json::to_value(rows()).unwrap_or_default();
        assert!(
            json[1]["measured"].is_null() && json[1]["rung"] == "f32" && json[0]["derivation"] == "exact",
            "{json}"
        );
    }
}
