//! Tables of measured settings: plain text, Markdown and CSV.

use super::digits::{megabytes, short};
use super::findings::main_cause;
use super::ladder::Cause;
use super::measured::{Cost, Measured};
use super::setting::Knob;
use relume_scene::plan::Integrate;

/// Column heads for text and Markdown; all columns but the first hold numbers or single words.
const HEADS: [&str; 12] = [
    "setting",
    "frame ms",
    "march ms",
    "min–max",
    "relight ms",
    "B/pixel",
    "MB",
    "mean ΔE00",
    "p95",
    "max",
    "at",
    "mostly by",
];

/// The integration in brackets, if `auto` took another one than for the setting of the scene.
pub(super) fn taken_integration(row: &Measured) -> String {
    let name = match row.integration {
        Integrate::Segments => "segments",
        Integrate::Samples => "samples",
        Integrate::Refined => "adaptive",
    };
    if row.other_integration { format!(" (auto took {name})") } else { String::new() }
}

/// The columns of a row for text and Markdown.
fn cells(row: &Measured) -> [String; 12] {
    let march = &row.times.march.wall_ms;
    let error = &row.error.delta_e;
    let level = row.level.map_or_else(String::new, |asked| format!(" (level {})", asked.level));
    let taken = taken_integration(row);
    [
        format!("{}{level}{taken}{}", row.setting, if row.pareto { " *" } else { "" }),
        short(row.frame_ms),
        short(march.median),
        format!("{}–{}", short(march.min), short(march.max)),
        short(row.times.relight.wall_ms.median),
        row.pixel_bytes.to_string(),
        short(megabytes(row.total_bytes)),
        short(error.mean),
        short(error.p95),
        short(error.max),
        row.error.at.map_or_else(String::new, |[x, y]| format!("{x},{y}")),
        main_cause(row).map_or("–", Cause::name).to_owned(),
    ]
}

/// Formats the rows in aligned columns; Pareto-optimal rows are marked with *.
#[must_use]
pub fn to_text(rows: &[Measured]) -> String {
    let mut table = vec![HEADS.map(str::to_owned)];
    table.extend(rows.iter().map(cells));
    let width = |column: usize| table.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; HEADS.len()] = std::array::from_fn(width);
    let mut text = String::new();
    for row in &table {
        for (column, (cell, width)) in row.iter().zip(widths).enumerate() {
            let padded = if column == 0 { format!("{cell:<width$}") } else { format!("  {cell:>width$}") };
            text.push_str(&padded);
        }
        text.truncate(text.trim_end().len());
        text.push('\n');
    }
    text
}

/// Formats the rows as a Markdown table.
#[must_use]
pub fn to_markdown(rows: &[Measured]) -> String {
    let line = |cells: &[String]| format!("| {} |\n", cells.join(" | ").replace('*', "\\*"));
    let mut text = line(&HEADS.map(str::to_owned));
    text.push_str(&format!("|---|{}\n", "--:|".repeat(HEADS.len() - 1)));
    for row in rows {
        text.push_str(&line(&cells(row)));
    }
    text
}

/// Formats all numbers as CSV, one setting per line; missing values are empty.
#[must_use]
pub fn to_csv(rows: &[Measured]) -> String {
    let costs = ["upload", "march", "relight", "read_back"];
    let clocks = ["wall", "cpu", "device"];
    let mut heads: Vec<String> = Knob::all().map(|knob| knob.name().to_owned()).collect();
    heads.extend(["level", "frame_ms"].map(str::to_owned));
    for cost in costs {
        for clock in clocks {
            heads.extend(["median", "min", "max"].map(|part| format!("{cost}_{clock}_ms_{part}")));
        }
    }
    heads.extend(["dispatches", "pixel_bytes", "volume_bytes", "total_bytes"].map(str::to_owned));
    heads.extend(["mean", "p95", "max", "x", "y", "xyz"].map(str::to_owned));
    for cause in Cause::ALL {
        let name = cause.name().replace(' ', "_");
        heads.extend(["mean", "p95", "max", "xyz"].map(|part| format!("{name}_{part}")));
    }
    heads.extend(["order", "pareto"].map(str::to_owned));
    let mut text = heads.join(",") + "\n";
    for row in rows {
        let mut cells: Vec<String> = Knob::all()
            .map(|knob| row.setting.get(knob.name()).map_or_else(String::new, |value| value.to_string()))
            .collect();
        cells.push(row.level.map_or_else(String::new, |asked| asked.level.to_string()));
        cells.push(row.frame_ms.to_string());
        let times = &row.times;
        cells.extend([times.upload, times.march, times.relight, times.read_back].iter().flat_map(numbers));
        cells
            .extend([row.dispatches as u64, row.pixel_bytes, row.volume_bytes, row.total_bytes].map(|n| n.to_string()));
        let error = &row.error.delta_e;
        cells.extend([error.mean, error.p95, error.max].map(|error| error.to_string()));
        cells.extend(row.error.at.map_or([String::new(), String::new()], |at| at.map(|n| n.to_string())));
        cells.push(row.error.xyz.to_string());
        for cause in Cause::ALL {
            let found = row.causes.iter().find(|(known, _)| *known == cause);
            let parts = |error: &super::Difference| {
                let colours = error.delta_e;
                [colours.mean, colours.p95, colours.max, error.xyz].map(|part| part.to_string())
            };
            cells.extend(found.map_or([const { String::new() }; 4], |(_, error)| parts(error)));
        }
        cells.push(row.order.map_or_else(String::new, |order| order.to_string()));
        cells.push(row.pareto.to_string());
        text.push_str(&(cells.join(",") + "\n"));
    }
    text
}

/// The numbers of a cost, by clock.
fn numbers(cost: &Cost) -> Vec<String> {
    let clocks = [Some(cost.wall_ms), Some(cost.cpu_ms), cost.device_ms];
    let parts = clocks.into_iter().map(|clock| {
        clock.map_or([const { String::new() }; 3], |times| [times.median, times.min, times.max].map(|t| t.to_string()))
    });
    parts.flatten().collect()
}
