//! `relume bench goals`: whether pictures keep the requested error, and their cost relative to the cheapest setting.

use serde_json::json;

use relume::measure::{GoalRow, GoalScene, GoalSummary, Ratios, goal_row};
use relume::progress::Progress;
use relume::render::Renderer;
use relume::vulkan::{Device, DeviceChoice, Validation};

use super::{CliError, Report, Silent};

/// Chooses settings for `scenes` seeded scenes. A cancellation keeps the finished ones.
pub(super) fn run(scenes: u16, device: &DeviceChoice, progress: &dyn Progress) -> Result<Report, CliError> {
    let renderer = Renderer::new(Device::open(device, Validation::Off)?);
    let (mut rows, mut interrupted): (Vec<(u64, GoalRow)>, bool) = (Vec::new(), false);
    for seed in 0..u64::from(scenes) {
        progress.report("choosing settings for seeded scenes", seed, scenes.into());
        match goal_row(&renderer, &GoalScene::new(seed)?, &Silent(progress)) {
            Ok(row) => rows.extend(row.map(|row| (seed, row))),
            Err(_) if progress.cancelled() && !rows.is_empty() => {
                interrupted = true;
                break;
            }
            Err(error) => return Err(error.into()),
        }
    }
    let only: Vec<GoalRow> = rows.iter().map(|(_, row)| row.clone()).collect();
    let summary = GoalSummary::of(&only);
    let missed = summary.as_ref().map_or_else(Vec::new, GoalSummary::missed);
    Ok(Report {
        text: text(&rows, scenes, summary.as_ref(), interrupted, &missed),
        json: json!({
            "goals": only,
            "goals_summary": summary,
            "interrupted": interrupted,
            "missed": missed,
            "holds": missed.is_empty(),
        }),
    })
}

/// The table and its summary; missed limits are in the last line.
fn text(
    rows: &[(u64, GoalRow)],
    scenes: u16,
    summary: Option<&GoalSummary>,
    interrupted: bool,
    missed: &[String],
) -> String {
    let mut text = format!(
        "--max-error on seeded scenes. Chosen setting: p95 of ΔE00 over all pixels that show the volume, and its ratio to the goal;\n\
         samples per voxel and pixel; CPU ms per frame (wall ms on a GPU). Cheapest setting that meets the goal, of steps a sixteenth\n\
         of an octave apart, every k and several scales: the same. Last two columns: samples and time of chosen over cheapest\n\
         {:>5}  {:>5}  {:<22} {:>6} {:>5}  {:>7}  {:>6}   {:<22} {:>6}  {:>7}  {:>6}   {:>7}  {:>4}\n",
        "scene",
        "asked",
        "chosen",
        "p95",
        "ratio",
        "samples",
        "ms",
        "cheapest",
        "p95",
        "samples",
        "ms",
        "samples",
        "time"
    );
    for (scene, row) in rows {
        let GoalRow { asked, chosen, cheapest, samples } = row;
        let [of_chosen, of_cheapest] = [chosen, cheapest].map(|it| it.setting.to_string());
        text.push_str(&format!(
            "{scene:>5}  {asked:>5}  {of_chosen:<22} {:>6.3} {:>5.2}  {:>7.2}  {:>6.2}   {of_cheapest:<22} {:>6.3}  {:>7.2}  {:>6.2}   {:>7.2}  {:>4.2}\n",
            chosen.p95,
            row.error(),
            chosen.samples,
            chosen.ms,
            cheapest.p95,
            cheapest.samples,
            cheapest.ms,
            samples,
            row.time()
        ));
    }
    if let Some(found) = summary {
        text.push_str(&format!(
            "\n{} of {scenes} scenes show the volume. {} of them, {:.0} %, meet the goal (limit: at least {:.0} %); the worst error is\n\
             {:.2} of the goal.\n\n\
             {:<52} {:>6} {:>6} {:>7} {:>8}\n",
            found.scenes,
            found.kept,
            100.0 * found.share(),
            100.0 * GoalSummary::KEPT,
            found.worst,
            format!("cost over the cheapest (limit of p95: {})", GoalSummary::COST),
            "median",
            "p95",
            "dearest",
            format!("over {}", GoalSummary::COST)
        ));
        for (name, ratios) in [("samples", found.samples), ("time", found.time)] {
            let Ratios { median, p95, max, dear } = ratios;
            text.push_str(&format!("{name:<52} {median:>6.2} {p95:>6.2} {max:>7.2} {dear:>8}\n"));
        }
    }
    if interrupted {
        text.push_str("\ninterrupted: only the finished scenes are listed\n");
    }
    if !missed.is_empty() {
        text.push_str(&format!("missed: {}\n", missed.join("; ")));
    }
    text
}
