//! Table of the errors of colour models.

use relume::measure::NodesBesideRgb;
use relume::model::ErrorSummary;

use crate::consistency::{HalvedStep, RelitRow};
use crate::model::{AutomaticRow, AutomaticSummary, ModelRow};

/// Formats the consistency checks: step length and relighting must not change colours.
pub(crate) fn consistency(halved: &[HalvedStep], relit: &[RelitRow]) -> String {
    let mut text =
        "\nStep halved in a homogeneous coloured slab of thickness 64, k = 8, marched in f32: largest relative change.\n\
                    step  relative change\n"
            .to_owned();
    for row in halved {
        text.push_str(&format!("{:>4}  {:>15.1e}\n", row.step, row.changed));
    }
    text.push_str(
        "\nRelit from a film in f32 under a light that was not in the plan (glass_shells.toml). Largest difference from an f64 render\n\
         with the same model, as a share of 1e-5 of each of X, Y, Z plus 1e-6; and from one with the light in its plan, in ΔE00,\n\
         with the errors that the two models report for the light.\n\
         light      same model  replanned       reported  replanned\n",
    );
    for row in relit {
        let [learnt, replanned] = row.reported;
        let (light, rendered, apart) = (&row.light, row.rendered, row.replanned);
        text.push_str(&format!("{light:<9}  {rendered:>10.2}  {apart:>14.2}  {learnt:>8.2}  {replanned:.2}\n"));
    }
    text
}

/// Required ratio of the mean error of the best RGB to that of eight nodes (docs/theory/acceptance.md C8).
const LEAST_RATIO: f64 = 20.0;

/// Formats the errors of fixed and of automatic dimensions.
pub(crate) fn text(
    models: &[ModelRow],
    beside: &[(&str, NodesBesideRgb)],
    automatic: &[AutomaticRow],
    summaries: &[AutomaticSummary],
) -> String {
    let numbers = |error: &ErrorSummary| format!("{:.3}/{:.2}/{:.2}", error.mean, error.p95, error.max);
    let scenes = models.first().map_or(0, |row| row.scenes);
    let mut text = format!(
        "Colour models on unseen spectra: ΔE00 mean/p95/max over {scenes} scenes of ColorChecker patches.\n\
         a: one reflection, b: two or three, c: one behind an absorber (optical depth up to 20), d0: grey rays, d1: \
         coloured rays.\n(unclamped: without the clamp of amplifying absorption, to show the model itself)\n\
         {:<20} {:<9} {:<7} {:>9} {:>3}  {:<18}",
        "model", "", "lights", "materials", "k", "all"
    );
    for (name, _) in models.first().iter().flat_map(|row| &row.classes) {
        text.push_str(&format!(" {name:<18}"));
    }
    text.push_str("  fit ms  new light ms\n");
    for row in models {
        text.push_str(&format!(
            "{:<20} {:<9} {:<7} {:>9} {:>3}  {:<18}",
            row.model,
            if row.unclamped { "unclamped" } else { "" },
            row.lights,
            row.materials,
            row.k,
            numbers(&row.all)
        ));
        for (_, error) in &row.classes {
            text.push_str(&format!(" {:<18}", numbers(error)));
        }
        text.push_str(&format!("  {:>6.0}  {:>12.1}\n", row.fit_ms, row.new_light_ms));
    }
    text.push_str(&format!(
        "\nEight nodes compared with RGB, mean ΔE00 (goal: at least {LEAST_RATIO} times smaller):\n"
    ));
    for (lights, found) in beside {
        text.push_str(&format!("{lights:<7} {}\n", found.sentence()));
    }
    text.push_str("\nAutomatic k of nodes: largest ΔE00 on unseen spectra, as a share of the tolerance.\n");
    text.push_str("tolerance  scenes  refused  kept   worst/tolerance  median k  largest k\n");
    for summary in summaries {
        text.push_str(&format!(
            "{:>9}  {:>6}  {:>7}  {:>4.0}%  {:>15.2}  {:>8}  {:>9}\n",
            summary.tolerance,
            summary.found + summary.refused,
            summary.refused,
            100.0 * summary.kept,
            summary.worst_over_tolerance,
            summary.median_k,
            summary.largest_k
        ));
    }
    if let Some(slowest) = automatic.iter().max_by(|one, two| one.fit_ms.total_cmp(&two.fit_ms)) {
        text.push_str(&format!(
            "The slowest choice of k took {:.0} ms (scene {}, tolerance {}).\n",
            slowest.fit_ms, slowest.scene, slowest.tolerance
        ));
    }
    text
}
