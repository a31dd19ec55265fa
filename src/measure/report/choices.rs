//! Which setting to use, for what, and how to write it.

use std::fmt::Write as _;

use super::drawing::escaped;
use super::entry::{Entry, seen};
use crate::measure::findings::{cheapest_for_sure, closest, span};
use crate::measure::survey::{Measured, Survey};
use crate::measure::table::short;
use crate::number::readable;

/// What pictures are made for, and the ΔE00 that 95 of 100 pixels stay below where they are good for it.
const PURPOSES: [(&str, f64); 3] = [("dragging", 8.0), ("looking", 2.0), ("a figure", 0.5)];

/// A setting, and what it is good for.
struct Chosen<'a> {
    row: &'a Measured,
    purposes: Vec<String>,
}

/// The setting for each purpose, each setting once.
fn chosen<'a>(rows: &'a [Measured]) -> Vec<Chosen<'a>> {
    let mut found: Vec<Chosen<'a>> = Vec::new();
    let mut add = |row: &'a Measured, purpose: String| match found.iter_mut().find(|it| it.row.times == row.times) {
        Some(known) => known.purposes.push(purpose),
        None => found.push(Chosen { row, purposes: vec![purpose] }),
    };
    for (purpose, limit) in PURPOSES {
        if let Some(row) = cheapest_for_sure(rows, limit) {
            add(row, format!("{purpose} (p95 ≤ {})", readable(limit)));
        }
    }
    if let Some(row) = closest(rows) {
        add(row, "as exact as was measured".to_owned());
    }
    found
}

/// A row a purpose, the scene's own first; then whole commands.
pub(super) fn choices(survey: &Survey<'_>, entries: &[Entry<'_>], rows: &[Measured]) -> String {
    let Some(own) = rows.first() else { return String::new() };
    let mut chosen = chosen(rows);
    if !chosen.iter().any(|it| it.row.times == own.times) {
        chosen.insert(0, Chosen { row: own, purposes: vec![also_good_for(own)] });
    }
    let mut table = "<div class=\"wide\"><table class=\"choice\">\n<tr><th class=\"text\">good for</th><th class=\"text\">setting, and how to write it</th>\
         <th title=\"Of a frame: median, and the shortest and longest run\">ms</th>\
         <th title=\"ΔE00 that 95 of 100 pixels stay below\">p95</th><th title=\"ΔE00 of the worst pixel compared\">worst</th>\
         <th class=\"text\">what the eye sees</th></tr>\n"
        .to_owned();
    for Chosen { row, purposes } in &chosen {
        let named = entries.iter().find(|entry| entry.row.times == row.times).map_or_else(String::new, Entry::name);
        let error = &row.error.delta_e;
        let [ms, p95, max] = [row.frame_ms, error.p95, error.max].map(short);
        let [least, most] = span(row).map(short);
        writeln!(
            table,
            "<tr><td class=\"text\">{}</td><td class=\"text\"><b>{}</b>{}</td><td>{ms} <small>({least}–{most})</small></td><td>{p95}</td><td>{max}</td>\
             <td class=\"text\">{}</td></tr>",
            escaped(&purposes.join(", ")),
            escaped(&named),
            how(survey, row),
            escaped(&seen(error))
        )
        .ok();
    }
    table.push_str("</table></div>\n");
    let figure = cheapest_for_sure(rows, PURPOSES[2].1).filter(|row| row.times != own.times);
    let flags = figure.map(|row| flags(survey, row)).filter(|flags| !flags.is_empty());
    let named = flags.map(|flags| {
        format!(
            "# {} for a figure\n{}\n",
            figure.map_or_else(String::new, |row| row.setting.to_string()),
            command(survey, &flags)
        )
    });
    format!(
        "{table}<pre>{}# whatever is fastest within ΔE00 1: several knobs are turned together, and values between these are tried, too\n{}</pre>\n",
        escaped(&named.unwrap_or_default()),
        escaped(&command(survey, "--max-error 1"))
    )
}

/// What the scene's own is good for where something else is faster.
fn also_good_for(own: &Measured) -> String {
    let fit = PURPOSES.iter().rev().find(|(_, limit)| own.error.delta_e.p95 <= *limit);
    fit.map_or_else(|| "nothing here, as it is".to_owned(), |(purpose, _)| format!("{purpose}, as it is"))
}

/// What a row changes: in the scene file, and for one run.
fn how(survey: &Survey<'_>, row: &Measured) -> String {
    let changed = row.setting.changed(survey.scene());
    let lines = changed.chunk_by(|one, two| one.0 == two.0).map(|keys| {
        let values: Vec<String> = keys.iter().map(|(_, key, value)| format!("{key} = {value}")).collect();
        format!("[{}]\n{}", keys[0].0, values.join("\n"))
    });
    let lines: Vec<String> = lines.collect();
    let scaled = row.setting.scale() < 1.0;
    let mut text = String::new();
    if !lines.is_empty() {
        write!(text, "<pre>{}</pre>", escaped(&lines.join("\n"))).ok();
    }
    let flags = flags(survey, row);
    if !flags.is_empty() {
        write!(
            text,
            "<div>{} <code>{}</code></div>",
            if lines.is_empty() { "in one run:" } else { "or in one run:" },
            escaped(&flags)
        )
        .ok();
    }
    if scaled {
        text.push_str("<div>a smaller picture, then enlarged</div>");
    }
    text
}

/// The flags of `relume render` that make a row of the scene.
fn flags(survey: &Survey<'_>, row: &Measured) -> String {
    let mut flags: Vec<String> =
        row.setting.definitions(survey.scene()).iter().map(|definition| format!("-D {definition}")).collect();
    if row.setting.scale() < 1.0 {
        let [width, height] = row.setting.marched_size(survey.lattice().size);
        flags.push(format!("--size {width}x{height}"));
    }
    flags.join(" ")
}

/// A whole command.
fn command(survey: &Survey<'_>, flags: &str) -> String {
    let source = &survey.scene().source;
    let given = source.split_once(" with ").map_or("", |(_, given)| given);
    let (file, picture) = match file(source) {
        None => (String::new(), "-o picture.png".to_owned()),
        Some(file) => {
            let quoted = |text: &str| if text.contains(' ') { format!("'{text}'") } else { text.to_owned() };
            (quoted(file), format!("-o {}", quoted(&format!("{}.png", title(source)))))
        }
    };
    let words = ["relume render", &file, given, flags, &picture];
    words.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
}

/// The file that a scene was read from. The scene that is part of the program has a name and no file.
fn file(source: &str) -> Option<&str> {
    source.split(" with ").next().filter(|file| std::path::Path::new(file).extension().is_some())
}

/// What a scene is called: its file without folders and ending.
pub(super) fn title(source: &str) -> String {
    let name = source.split(" with ").next().unwrap_or(source);
    let stem = file(source).and_then(|file| std::path::Path::new(file).file_stem()?.to_str());
    stem.unwrap_or(name).to_owned()
}
