//! `relume bench goals`: whether pictures keep the error that is asked for, and what that costs over the least it could.

use serde_json::json;

use relume::measure::{GoalRow, GoalScene, GoalSummary, goal_row};
use relume::progress::Progress;
use relume::render::Renderer;
use relume::vulkan::{Device, DeviceChoice, Validation};

use super::{CliError, Report, Silent};

/// The share of scenes that is to keep what is asked for.
const KEPT: f64 = 0.95;
/// What a choice may cost over the cheapest setting that would have done, in the median.
const COST: f64 = 1.3;

/// Chooses for so many seeded scenes; where somebody asks to stop, those that are finished are kept.
pub(super) fn run(scenes: u16, device: &DeviceChoice, progress: &dyn Progress) -> Result<Report, CliError> {
    let renderer = Renderer::new(Device::open(device, Validation::Off)?);
    let (mut rows, mut interrupted): (Vec<(u64, GoalRow)>, bool) = (Vec::new(), false);
    for seed in 0..u64::from(scenes) {
        progress.report("choosing for seeded scenes", seed, scenes.into());
        match goal_row(&renderer, &GoalScene::new(seed)?, &Silent(progress)) {
            Ok(row) => rows.extend(row.map(|row| (seed, row))),
            Err(error) if error.is_cancelled() && !rows.is_empty() => {
                interrupted = true;
                break;
            }
            Err(error) => return Err(error.into()),
        }
    }
    let only: Vec<GoalRow> = rows.iter().map(|(_, row)| row.clone()).collect();
    let summary = GoalSummary::of(&only);
    Ok(Report {
        text: text(&rows, scenes, summary.as_ref(), interrupted),
        json: json!({ "goals": only, "goals_summary": summary, "interrupted": interrupted }),
    })
}

fn text(rows: &[(u64, GoalRow)], scenes: u16, summary: Option<&GoalSummary>, interrupted: bool) -> String {
    let mut text = format!(
        "--max-error of seeded scenes: p95 of ΔE00 over all pixels that show anything, and frames beside the fastest that would have\n\
         kept it (steps an eighth of an octave apart, every k, several scales)\n\
         {:>5}  {:>5}  {:>8}  {:>5}  {:<26}  {:>8}  {:<26}  {:>8}  {:>5}  {:>7}\n",
        "scene", "asked", "measured", "ratio", "chosen", "ms", "cheapest", "ms", "cost", "samples"
    );
    for (scene, row) in rows {
        let [chosen, cheapest] = [&row.setting, &row.cheapest].map(ToString::to_string);
        text.push_str(&format!(
            "{scene:>5}  {:>5}  {:>8.3}  {:>5.2}  {chosen:<26}  {:>8.2}  {cheapest:<26}  {:>8.2}  {:>5.2}  {:>7.2}\n",
            row.asked,
            row.measured,
            row.measured / row.asked,
            row.frame_ms,
            row.cheapest_ms,
            row.cost(),
            row.samples
        ));
    }
    if let Some(found) = summary {
        text.push_str(&format!(
            "\n{} of {scenes} scenes show what can be asked for: {:.0} % keep it (at least {:.0} % is asked for), the worst is \
             {:.2} of it.\nThe median costs {:.2} times the cheapest (at most {COST} is asked for), the dearest {:.2} times; in \
             samples the median is {:.2}.\n",
            found.scenes,
            100.0 * found.kept,
            100.0 * KEPT,
            found.worst,
            found.cost,
            found.dearest,
            found.samples
        ));
    }
    if interrupted {
        text.push_str("\ninterrupted: these are the scenes that were measured before\n");
    }
    text
}
