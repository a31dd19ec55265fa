//! Table of the cost of each scene feature.

use crate::needs::NeedRow;

/// Table with a row per feature; `a → b` is without and with it.
pub(crate) fn text(rows: &[NeedRow]) -> String {
    let mut table = vec![
        [
            "feature",
            "samples",
            "dispatches",
            "B/pixel",
            "volume kB",
            "relight kB",
            "march instr.",
            "relight instr.",
            "same picture",
            "",
        ]
        .map(str::to_owned),
    ];
    for row in rows {
        let of = |index: usize, unit: u64| {
            let [without, with] = [row.without, row.with].map(|counts| counts.named()[index].1 / unit);
            if without == with { without.to_string() } else { format!("{without} → {with}") }
        };
        let trade = if row.saves.is_empty() { String::new() } else { format!("saves {}", row.saves.join(", ")) };
        let told = if row.holds() { trade } else { "DIFFERS FROM THE PREDICTION".to_owned() };
        table.push([
            row.name.to_owned(),
            of(0, 1),
            of(1, 1),
            of(2, 1),
            of(3, 1000),
            of(4, 1000),
            of(5, 1),
            of(6, 1),
            format!("{:.0e} of {:.0e}", row.picture_difference, row.picture_limit),
            told,
        ]);
    }
    let width = |column: usize| table.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: [usize; 10] = std::array::from_fn(width);
    let mut text = "Cost of a scene without a feature → with it. The picture without it is compared with that of a plan in which every\n\
                    feature is on, but has no effect.\n\n"
        .to_owned();
    for row in &table {
        let cells: Vec<String> = row.iter().zip(widths).map(|(cell, width)| format!("{cell:<width$}")).collect();
        text.push_str(cells.join("  ").trim_end());
        text.push('\n');
    }
    text
}
