//! Table of chosen settings, their errors, and their cost relative to the cheapest setting.

use crate::goals::{GoalRow, GoalSummary, Ratios};

/// The table and its summary; missed limits are in the last line.
pub(crate) fn text(rows: &[(u64, GoalRow)], scenes: u16, summary: Option<&GoalSummary>, missed: &[String]) -> String {
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
    if !missed.is_empty() {
        text.push_str(&format!("missed: {}\n", missed.join("; ")));
    }
    text
}
