//! Page of frame costs: tables, and a chart per varied parameter.

use std::fmt::Write as _;

use super::STYLE;
use super::drawing::{Drawing, Logarithmic, PARTS, escaped, tick};
use crate::digits::short;
use relume_base::number::count;

/// A table of the page; its first row holds the column heads.
#[derive(Clone, Debug, Default)]
pub struct CostTable {
    /// Heading.
    pub head: String,
    /// Description in a sentence or two.
    pub about: String,
    /// Cells by row.
    pub rows: Vec<Vec<String>>,
}

/// Time against one varied parameter, with a line per kind of work.
#[derive(Clone, Debug, Default)]
pub struct CostCurve {
    /// The varied parameter, and what is constant.
    pub head: String,
    /// Lines by name; each point is a parameter value and the time in ms.
    pub lines: Vec<(String, Vec<[f64; 2]>)>,
}

/// Returns the page of frame costs on `device`: `findings` as a summary, then tables and curves.
#[must_use]
pub fn costs_html(device: &str, findings: &[String], tables: &[CostTable], curves: &[CostCurve]) -> String {
    let mut page = format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>Costs of frames</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<h1>Costs of frames</h1>\n\
         <p class=\"about\">{}. Relume {}.</p>\n",
        escaped(device),
        env!("CARGO_PKG_VERSION")
    );
    // Writing to a String cannot fail.
    if !findings.is_empty() {
        let said: String = findings.iter().map(|text| format!("<p>{}</p>\n", escaped(text))).collect();
        write!(page, "<div class=\"short\">\n{said}</div>\n").ok();
    }
    let (first, others) = tables.split_at(tables.len().min(1));
    for table in first {
        page.push_str(&table_html(table));
    }
    if !curves.is_empty() {
        let drawn: String = curves.iter().map(|curve| drawing(curve).inline(&curve.head)).collect();
        write!(
            page,
            "<h2>Cost curves</h2>\n<p class=\"about\">Filled: a march. Rings: a relight. Both axes are \
             logarithmic.</p>\n<div class=\"curves\">\n{drawn}</div>\n"
        )
        .ok();
    }
    for table in others {
        page.push_str(&table_html(table));
    }
    page.push_str("</body>\n</html>\n");
    page
}

fn table_html(table: &CostTable) -> String {
    let row = |row: &Vec<String>, tag: &str| {
        let cells: String = row.iter().map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell))).collect();
        format!("<tr>{cells}</tr>\n")
    };
    let (heads, rows) = table.rows.split_at(table.rows.len().min(1));
    let rows: String = heads.iter().map(|it| row(it, "th")).chain(rows.iter().map(|it| row(it, "td"))).collect();
    let (head, about) = (escaped(&table.head), escaped(&table.about));
    format!("<h2>{head}</h2>\n<p class=\"about\">{about}</p>\n<div class=\"wide\">\n<table>\n{rows}</table>\n</div>\n")
}

fn drawing(curve: &CostCurve) -> Drawing {
    const SIZE: [f64; 2] = [420.0, 300.0];
    let mut drawing = Drawing::new(SIZE[0], SIZE[1]);
    let legend = 26.0 + 13.0 * count(curve.lines.len());
    let (left, right, top, bottom) = (46.0, SIZE[0] - 12.0, legend + 12.0, SIZE[1] - 24.0);
    drawing.text([left, 16.0], "ink", "start", &curve.head);
    let points = || curve.lines.iter().flat_map(|(_, points)| points);
    let across = Logarithmic::of(points().map(|point| point[0]), left, right);
    let up = Logarithmic::of(points().map(|point| point[1]), bottom, top);
    for value in up.ticks() {
        drawing.line([left, up.at(value)], [right, up.at(value)], "grid");
        drawing.small([left - 6.0, up.at(value) + 4.0], "end", &tick(value));
    }
    drawing.small([left - 6.0, top - 8.0], "end", "ms");
    let mut values: Vec<f64> = points().map(|point| point[0]).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    for value in values {
        drawing.small([across.at(value), bottom + 16.0], "middle", &relume_base::number::readable(value));
    }
    for (i, (name, points)) in curve.lines.iter().enumerate() {
        let colour = PARTS[i / 2 % PARTS.len()];
        let relight = name.starts_with("relight");
        let places: Vec<[f64; 2]> = points.iter().map(|&[x, y]| [across.at(x), up.at(y)]).collect();
        drawing.coloured_path(&places, colour, relight);
        for (&[x, y], place) in points.iter().zip(&places) {
            let told = format!("{name}: {} ms at {}", short(y), relume_base::number::readable(x));
            drawing.marker(*place, colour, relight, &told);
        }
        let row = 30.0 + 13.0 * count(i);
        drawing.marker([left + 6.0, row - 4.0], colour, relight, name);
        drawing.small([left + 16.0, row], "start", name);
    }
    drawing.line([left, bottom], [right, bottom], "axis");
    drawing
}
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_of_costs_needs_nothing_else() {
        let line = |name: &str, factor: f64| (name.to_owned(), [1.0, 2.0, 8.0].map(|x| [x, factor * x]).to_vec());
        let curve = CostCurve { head: "k".to_owned(), lines: vec![line("march, <grey>", 2.0), line("relight", 0.1)] };
        let rows = vec![vec!["what".to_owned()], vec!["R&B".to_owned()]];
        let table = CostTable { head: "The table".to_owned(), about: String::new(), rows };
        let page = costs_html("a device", &["In short.".to_owned()], &[table], &[curve]);
        assert!(page.contains("<td>R&amp;B</td>") && page.contains("<svg") && page.contains("In short."));
        for alien in ["<script", "<link", "<grey>", "src=\"http", "href"] {
            assert!(!page.contains(alien), "{alien} in {page}");
        }
    }
}
