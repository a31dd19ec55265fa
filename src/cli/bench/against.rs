//! Comparison with an earlier run: costs that have grown by more than a budget.

use std::path::Path;

use serde::Serialize;
use serde_json::Value;

use super::CliError;
use super::frames::Row;

/// Largest file that is read, in bytes.
const LONGEST: u64 = 16 << 20;
/// Differences of times in ms that are ignored for every measurement.
const ALIKE_MS: f64 = 0.5;

/// An earlier run.
pub(super) struct Earlier<'a> {
    path: &'a Path,
    rows: Vec<Value>,
}

/// Result of the comparison.
#[derive(Serialize)]
pub(super) struct Against {
    file: String,
    budget_percent: f64,
    /// Number of rows in both runs.
    compared: usize,
    /// Number of rows in this run only.
    new: usize,
    dearer: Vec<Dearer>,
}

/// A cost that has grown.
#[derive(Serialize)]
struct Dearer {
    id: String,
    what: &'static str,
    before: f64,
    now: f64,
}

impl<'a> Earlier<'a> {
    /// Reads the output of `--json` at `path`, which must come from `device`.
    ///
    /// # Errors
    ///
    /// [`CliError`] if the file has other contents or comes from another device.
    pub(super) fn read(path: &'a Path, device: &str) -> Result<Self, CliError> {
        let wrong = |problem: &str| CliError::Failed(format!("--against {}: {problem}", path.display()));
        let bytes = crate::input::read(path, LONGEST)
            .map_err(|error| wrong(&format!("{error}; the flag takes the output of `relume bench --json`")))?;
        let mut stored: Value = serde_json::from_slice(&bytes)
            .map_err(|error| wrong(&format!("not the output of `relume bench --json`: {error}")))?;
        let rows = stored["rows"].as_array_mut().map(std::mem::take).filter(|rows| !rows.is_empty());
        let rows = rows.ok_or_else(|| wrong("the file has no rows of `relume bench --json`"))?;
        if let Some(other) = rows.iter().filter_map(|row| row["device"].as_str()).find(|other| *other != device) {
            return Err(wrong(&format!(
                "its times are from {other}, and this device is {device}; compare runs of one device"
            )));
        }
        Ok(Self { path, rows })
    }
}

impl Against {
    /// Compares `rows` with those of `earlier`.
    ///
    /// # Errors
    ///
    /// [`CliError`] if the runs have no row in common.
    pub(super) fn new(earlier: &Earlier<'_>, rows: &[Row], budget_percent: f64) -> Result<Self, CliError> {
        let Earlier { path, rows: known } = earlier;
        let (mut compared, mut dearer) = (0, Vec::new());
        for row in rows {
            let Some(before) = known.iter().find(|before| before["id"] == row.id.as_str()) else { continue };
            compared += 1;
            let clock = if row.software { "cpu_ms" } else { "wall_ms" };
            let measured = [
                ("march, ms", &before["march"][clock]["median"], row.march.cost_ms(row.software), ALIKE_MS),
                ("relight, ms", &before["relight"][clock]["median"], row.relight.cost_ms(row.software), ALIKE_MS),
                ("bytes a pixel", &before["counts"]["pixel_bytes"], float(row.counts.pixel_bytes), 0.0),
                ("bytes of the volume", &before["counts"]["volume_bytes"], float(row.counts.volume_bytes), 0.0),
                ("bytes of a relight", &before["counts"]["relight_bytes"], float(row.counts.relight_bytes), 0.0),
            ];
            for (what, before, now, alike) in measured {
                let Some(before) = before.as_f64() else { continue };
                if now > before * (1.0 + budget_percent / 100.0) + alike {
                    dearer.push(Dearer { id: row.id.clone(), what, before, now });
                }
            }
        }
        if compared == 0 {
            let problem = "it has no row of this run; name the same workloads";
            return Err(CliError::Failed(format!("--against {}: {problem}", path.display())));
        }
        let (file, new) = (path.display().to_string(), rows.len() - compared);
        Ok(Self { file, budget_percent, compared, new, dearer })
    }

    /// Whether all costs are within the budget.
    pub(super) fn holds(&self) -> bool {
        self.dearer.is_empty()
    }

    /// Formats the comparison as text.
    pub(super) fn text(&self) -> String {
        let Self { file, budget_percent, compared, new, dearer } = self;
        let more = if *new > 0 { format!("; {new} are not in the file") } else { String::new() };
        let verdict = match dearer.len() {
            0 => format!("no cost is over {budget_percent} % higher"),
            1 => format!("1 cost is over {budget_percent} % higher"),
            many => format!("{many} costs are over {budget_percent} % higher"),
        };
        let mut text = format!("\n{file}: {compared} rows compared{more}; {verdict}\n");
        for Dearer { id, what, before, now } in dearer {
            let percent = 100.0 * (now / before - 1.0);
            text.push_str(&format!("  {id}: {what}: {before:.2} → {now:.2} (+{percent:.0} %)\n"));
        }
        text
    }
}

/// Converts a number of bytes; the rounding above 2⁵³ is far below any budget.
#[expect(clippy::cast_precision_loss, reason = "the comparison is in per cent")]
fn float(bytes: u64) -> f64 {
    bytes as f64
}
