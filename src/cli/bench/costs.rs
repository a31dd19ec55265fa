//! Evaluation of the rows of `relume bench`: ratios against the paper and against limits, a table and a page.

use serde::Serialize;

use crate::measure::{CostCurve, CostTable, costs_html};
use crate::vulkan::{DeviceInfo, DeviceKind};

use super::frames::Row;

/// Ratio of two costs.
#[derive(Serialize)]
struct Ratio {
    name: String,
    ours: f64,
    /// Ratio in the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    paper: Option<f64>,
    /// Largest allowed ratio.
    most: f64,
}

impl Ratio {
    fn sentence(&self) -> String {
        let paper = self.paper.map_or_else(String::new, |paper| format!("; paper: {paper}"));
        format!("{}: {:.2} (limit {}{paper})", self.name, self.ours, self.most)
    }
}

/// The rows and their device.
pub(super) struct Costs<'a> {
    rows: &'a [Row],
    software: bool,
    device: String,
    interrupted: bool,
}

impl<'a> Costs<'a> {
    pub(super) fn of(rows: &'a [Row], info: &DeviceInfo, interrupted: bool) -> Self {
        let software = info.kind == DeviceKind::Software;
        let label = if software { ", a software device: times are this CPU's" } else { "" };
        Self { rows, software, device: format!("{} ({}){label}", info.name, info.driver), interrupted }
    }

    /// Clock of the compared times.
    fn clock(&self) -> &'static str {
        if self.software { "CPU time of all threads" } else { "wall time" }
    }

    /// Median march time in ms of the first matching row.
    fn march(&self, workload: &str, line: &str, is_it: impl Fn(&Row) -> bool) -> Option<f64> {
        let row = self.rows.iter().find(|row| row.workload == workload && row.line == line && is_it(row))?;
        Some(row.march.cost_ms(self.software))
    }

    fn all_ratios(&self) -> Vec<Ratio> {
        let mut ratios = Vec::new();
        for (size, paper) in [([400, 400], 1.25), ([800, 800], 1.29)] {
            let of = |line| self.march("paper", line, |row| row.size == size);
            let pairs = [
                ("spectra, 4 weights", "RGB", Some(paper), 1.05),
                ("spectra, k = 8", "RGB", Some(paper), 1.2),
                ("coloured spectra, k = 8", "coloured RGB", None, 1.2),
            ];
            for (ours, theirs, paper, most) in pairs {
                let Some((ours_ms, theirs_ms)) = of(ours).zip(of(theirs)) else { continue };
                let name = format!("{ours}, over {theirs} at {}×{}", size[0], size[1]);
                ratios.push(Ratio { name, ours: ours_ms / theirs_ms, paper, most });
            }
        }
        let varied = |workload: &str, line: &str, value: u32| {
            self.march(workload, line, |row| row.varied.is_some_and(|varied| varied.value == value))
        };
        let compared = [
            ("positions", "grey, 4 weights", [1, 4], "4 positions over 1", 1.6),
            ("positions", "grey, k = 8", [1, 4], "4 positions over 1", 2.2),
            ("positions", "coloured, k = 8", [1, 4], "4 positions over 1", 2.2),
            ("pixels", "grey, 4 weights", [160_000, 640_000], "800×800 over 400×400", 4.0),
            ("pixels", "coloured, k = 8", [160_000, 640_000], "800×800 over 400×400", 4.0),
            ("voxels", "grey, 4 weights", [128 * 128 * 128, 512 * 512 * 512], "512³ voxels over 128³", 4.0),
            ("voxels", "coloured, k = 8", [128 * 128 * 128, 512 * 512 * 512], "512³ voxels over 128³", 4.0),
        ];
        for (workload, line, [before, after], name, most) in compared {
            if let Some((before, after)) = varied(workload, line, before).zip(varied(workload, line, after)) {
                ratios.push(Ratio { name: format!("{name}, {line}"), ours: after / before, paper: None, most });
            }
        }
        ratios
    }

    /// Ratios of marches as JSON.
    pub(super) fn ratios(&self) -> serde_json::Value {
        serde_json::json!(self.all_ratios())
    }

    /// Summary in sentences.
    fn findings(&self) -> Vec<String> {
        let ratios = self.all_ratios();
        let mut said = Vec::new();
        if !ratios.is_empty() {
            said.push(format!("Marches, {}:", self.clock()));
            said.extend(ratios.iter().map(Ratio::sentence));
        }
        let relit = self
            .rows
            .iter()
            .find(|row| row.workload == "paper" && row.line == "spectra, k = 8" && row.size == [800, 800]);
        if let Some(wall) = relit.and_then(|row| row.relight.wall_ms) {
            said.push(format!(
                "Relights of 800×800 pixels with k = 8: {:.0} per second of wall time (goal: at least 180; paper: 7).",
                1e3 / wall.median
            ));
        }
        if self.interrupted {
            said.push("Interrupted: only the finished rows are listed.".to_owned());
        }
        said
    }

    /// Formats the rows in columns.
    pub(super) fn text(&self) -> String {
        let named = |row: &Row| format!("{:<12} {}×{}", row.name(), row.size[0], row.size[1]);
        let width = self.rows.iter().map(|row| named(row).chars().count()).max().unwrap_or(0);
        let mut text = format!(
            "{}\n{:<width$}  shading  positions  keeps           lanes  march cpu ms (wall)     relight cpu ms (wall)  startup ms\n",
            self.device, "workload"
        );
        let median = |times: Option<crate::measure::Summary>| times.map_or(f64::NAN, |times| times.median);
        for row in self.rows {
            text.push_str(&format!(
                "{:<width$}  {:<8} {:>8}  {:<14}  {:>5}  {:>9.1} ({:.1})  {:>16.2} ({:.2})  {:>10}\n",
                named(row),
                row.shading,
                row.positions,
                row.keeps(),
                row.lanes,
                median(row.march.cpu_ms),
                median(row.march.wall_ms),
                median(row.relight.cpu_ms),
                median(row.relight.wall_ms),
                row.startup_ms.map_or_else(|| "-".to_owned(), |time| format!("{:.0}", time.median)),
            ));
        }
        let findings = self.findings();
        if !findings.is_empty() {
            text.push_str(&format!("\n{}\n", findings.join("\n")));
        }
        text
    }

    /// The paper's table: a row per renderer, a column per size.
    fn paper(&self) -> Option<CostTable> {
        let rows: Vec<&Row> = self.rows.iter().filter(|row| row.workload == "paper").collect();
        let (mut sizes, mut lines) = (Vec::new(), Vec::new());
        for row in &rows {
            if !sizes.contains(&row.size) {
                sizes.push(row.size);
            }
            if !lines.contains(&row.line) {
                lines.push(row.line);
            }
        }
        let heads = sizes.iter().map(|[width, height]| format!("{width}×{height}, ms"));
        let mut table = vec![std::iter::once(String::new()).chain(heads).collect::<Vec<String>>()];
        let mut add = |name: String, cost: &dyn Fn(&Row) -> f64, line: &str| {
            let of = |size: &[usize; 2]| {
                let found = rows.iter().find(|row| row.line == line && row.size == *size);
                found.map_or_else(String::new, |row| format!("{:.2}", cost(row)))
            };
            table.push(std::iter::once(name).chain(sizes.iter().map(of)).collect());
        };
        for line in &lines {
            add(format!("march, {line}"), &|row| row.march.cost_ms(self.software), line);
        }
        for line in &lines {
            add(format!("relight, {line}"), &|row| row.relight.cost_ms(self.software), line);
        }
        let about = format!(
            "The benchmark scene, shaded, under one light; {}, medians. The paper's renderer took 1.25 times as long for spectra \
             as for RGB at 400×400, 1.29 times at 800×800, and relit 7 pictures of 800×800 per second.",
            self.clock()
        );
        (!rows.is_empty()).then_some(CostTable { head: "The paper's table".to_owned(), about, rows: table })
    }

    /// Table of all rows.
    fn all(&self) -> CostTable {
        let heads = [
            "",
            "pixels",
            "shading",
            "positions",
            "keeps",
            "march wall ms",
            "CPU",
            "device",
            "relight wall ms",
            "CPU",
            "device",
            "B/pixel",
            "volume MB",
            "relight MB",
        ];
        let time = |times: Option<crate::measure::Summary>| {
            times.map_or_else(String::new, |it| format!("{:.2} ({:.2}–{:.2})", it.median, it.min, it.max))
        };
        #[expect(clippy::cast_precision_loss, reason = "two decimals are shown")]
        let megabytes = |bytes: u64| format!("{:.2}", bytes as f64 / 1e6);
        let cells = |row: &Row| {
            vec![
                row.name(),
                format!("{}×{}", row.size[0], row.size[1]),
                row.shading.to_owned(),
                row.positions.to_string(),
                row.keeps(),
                time(row.march.wall_ms),
                time(row.march.cpu_ms),
                time(row.march.device_ms),
                time(row.relight.wall_ms),
                time(row.relight.cpu_ms),
                time(row.relight.device_ms),
                row.counts.pixel_bytes.to_string(),
                megabytes(row.counts.volume_bytes),
                megabytes(row.counts.relight_bytes),
            ]
        };
        let rows = std::iter::once(heads.map(str::to_owned).to_vec()).chain(self.rows.iter().map(cells)).collect();
        let about = "Medians (smallest–largest). Device: GPU timestamps, if the device has them.".to_owned();
        CostTable { head: "All rows".to_owned(), about, rows }
    }

    /// Curve per varied quantity.
    fn curves(&self) -> Vec<CostCurve> {
        let heads = [
            ("k", "dimension of the colour model, k"),
            ("positions", "light positions"),
            ("pixels", "pixels"),
            ("voxels", "voxels"),
        ];
        let curve = |(name, head): (&str, &str)| {
            let rows = || self.rows.iter().filter(|row| row.varied.is_some_and(|varied| varied.name == name));
            let mut lines: Vec<(String, Vec<[f64; 2]>)> = Vec::new();
            for row in rows() {
                let Some(varied) = row.varied else { continue };
                let parts = [("march", &row.march), ("relight", &row.relight)];
                for (part, times) in parts {
                    let point = [f64::from(varied.value), times.cost_ms(self.software)];
                    let line = format!("{part}, {}", row.line);
                    match lines.iter_mut().find(|(known, _)| *known == line) {
                        Some((_, points)) => points.push(point),
                        None => lines.push((line, vec![point])),
                    }
                }
            }
            let clock = if self.software { "CPU ms" } else { "ms" };
            (!lines.is_empty()).then(|| CostCurve { head: format!("{head}: {clock}"), lines })
        };
        heads.into_iter().filter_map(curve).collect()
    }

    /// The HTML page.
    pub(super) fn html(&self) -> String {
        let tables: Vec<CostTable> = self.paper().into_iter().chain([self.all()]).collect();
        costs_html(&self.device, &self.findings(), &tables, &self.curves())
    }
}
