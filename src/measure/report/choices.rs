//! Recommended settings by purpose, with the scene-file lines and commands for them.

use std::fmt::Write as _;

use super::drawing::escaped;
use super::entry::{Entry, seen};
use super::trust::Trust;
use crate::digits::short;
use crate::measured::Measured;
use crate::survey::Survey;
use relume_base::number::readable;

/// Purposes of pictures, each with its limit on p95 (ΔE00).
const PURPOSES: [(&str, f64); 3] = [("dragging", 8.0), ("looking", 2.0), ("a figure", 0.5)];

/// A setting and its purposes.
struct Chosen<'a> {
    row: &'a Measured,
    purposes: Vec<String>,
}

/// Returns the setting for each purpose, each setting once. Where times are rough, only errors decide.
fn chosen(rows: &[Measured], trust: Trust) -> Vec<Chosen<'_>> {
    let mut found: Vec<Chosen<'_>> = Vec::new();
    let mut add = |row, purpose: String| add_purpose(&mut found, row, purpose);
    if let Some(own) = rows.first().filter(|_| trust.is_rough()) {
        add(own, also_good_for(own));
    }
    for (purpose, limit) in PURPOSES {
        if let Some(row) = trust.cheapest(rows, limit) {
            add(row, good_for(purpose, limit));
        }
    }
    if let Some(row) = trust.most_exact(rows) {
        add(row, "most accurate measured setting".to_owned());
    }
    if let Some(own) = rows.first().filter(|own| !found.iter().any(|it| it.row.times == own.times)) {
        found.insert(0, Chosen { row: own, purposes: vec![also_good_for(own)] });
    }
    found
}

fn add_purpose<'a>(found: &mut Vec<Chosen<'a>>, row: &'a Measured, purpose: String) {
    match found.iter_mut().find(|it| it.row.times == row.times) {
        Some(known) => known.purposes.push(purpose),
        None => found.push(Chosen { row, purposes: vec![purpose] }),
    }
}

fn good_for(purpose: &str, limit: f64) -> String {
    format!("{purpose} (p95\u{a0}≤\u{a0}{})", readable(limit))
}

/// States how settings were chosen.
pub(super) fn about(survey: &Survey<'_>, trust: Trust) -> String {
    let by = if trust.is_rough() {
        "The times are rough, so no setting is chosen by time: the table has the scene's own setting and the most accurate one."
    } else {
        "For each purpose the fastest measured setting whose times do not overlap those of the scene's own. The most accurate \
         setting is the fastest within 5 % of the smallest mean, p95 and worst error. One knob is changed at a time."
    };
    let given = survey.scene().name.split_once(" with ").map_or_else(String::new, |(_, given)| {
        format!(" The commands repeat the other flags of this scene (<code>{}</code>).", escaped(given))
    });
    format!("{by}{given}")
}

/// Table with a row per chosen setting, followed by whole commands.
pub(super) fn choices(survey: &Survey<'_>, entries: &[Entry<'_>], rows: &[Measured], trust: Trust) -> String {
    let Some(own) = rows.first() else { return String::new() };
    let mut table = "<div class=\"wide\"><table class=\"choice\">\n<tr><th class=\"text\">good for</th><th class=\"text\">setting, and its keys in the scene file</th>\
         <th title=\"Time of a frame: median, shortest and longest run\">ms</th>\
         <th title=\"95th percentile of ΔE00\">p95</th><th title=\"ΔE00 of the worst compared pixel\">worst</th>\
         <th class=\"text\">visibility</th></tr>\n"
        .to_owned();
    for Chosen { row, purposes } in &chosen(rows, trust) {
        let named = entries.iter().find(|entry| entry.row.times == row.times).map_or_else(String::new, Entry::name);
        let error = &row.error.delta_e;
        let [p95, max] = [error.p95, error.max].map(short);
        writeln!(
            table,
            "<tr><td class=\"text\">{}</td><td class=\"text\"><b>{}</b>{}</td><td>{}</td><td>{p95}</td><td>{max}</td>\
             <td class=\"text\">{}</td></tr>",
            escaped(&purposes.join(", ")),
            escaped(&named),
            how(survey, row),
            trust.cell(row),
            escaped(&seen(error))
        )
        .ok();
    }
    table.push_str("</table></div>\n");
    let figure = trust.cheapest(rows, PURPOSES[2].1).filter(|row| row.times != own.times);
    let flags = figure.map(|row| flags(survey, row)).filter(|flags| !flags.is_empty());
    let named = flags.map(|flags| {
        format!(
            "# {} for a figure\n{}\n",
            figure.map_or_else(String::new, |row| row.setting.to_string()),
            command(survey, &flags)
        )
    });
    format!(
        "{table}<pre>{}# the fastest setting within ΔE00 1: changes several knobs together, and tries intermediate values\n{}</pre>\n",
        escaped(&named.unwrap_or_default()),
        escaped(&command(survey, "--max-error 1"))
    )
}

/// Purpose of the scene's own setting where times cannot show that it is the fastest.
fn also_good_for(own: &Measured) -> String {
    let fit = PURPOSES.iter().rev().find(|(_, limit)| own.error.delta_e.p95 <= *limit);
    fit.map_or_else(
        || "none of these purposes, unchanged".to_owned(),
        |(purpose, limit)| good_for(purpose, *limit) + ", unchanged",
    )
}

/// Describes the changes of a row: in the scene file, and as flags for one run.
fn how(survey: &Survey<'_>, row: &Measured) -> String {
    let changed = row.setting.changed(survey.scene());
    let parts = |path: &'static str| path.split_once('.').unwrap_or(("", path));
    let lines = changed.chunk_by(|one, two| parts(one.0).0 == parts(two.0).0).map(|keys| {
        let values: Vec<String> = keys.iter().map(|(path, value)| format!("{} = {value}", parts(path).1)).collect();
        format!("[{}]\n{}", parts(keys[0].0).0, values.join("\n"))
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
        let [width, height] = survey.lattice().size;
        write!(
            text,
            "<div>no key of a scene: the picture has this smaller size, and these errors after bilinear enlargement to \
             {width}×{height}</div>"
        )
        .ok();
    }
    text
}

/// Flags of `relume render` that apply a row to the scene.
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
    let source = &survey.scene().name;
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

/// File that a scene was read from; `None` for the built-in scene, which has only a name.
fn file(source: &str) -> Option<&str> {
    source.split(" with ").next().filter(|file| std::path::Path::new(file).extension().is_some())
}

/// Title of a scene: its file name without folders and extension.
pub(super) fn title(source: &str) -> String {
    let name = source.split(" with ").next().unwrap_or(source);
    let stem = file(source).and_then(|file| std::path::Path::new(file).file_stem()?.to_str());
    stem.unwrap_or(name).to_owned()
}
