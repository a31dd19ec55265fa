//! Reports on the level of resolution of a picture, by `accuracy.voxel_pixels`.

use serde_json::{Value, json};

use crate::render::{PlannedJob, RenderWarning};

/// The level that a job took and its reason, a line and for programs, and warns of labels that it loses; nothing if the scene
/// asks for none.
pub(crate) fn told(job: &PlannedJob) -> (String, Value) {
    let Some(taken) = &job.level else { return (String::new(), Value::Null) };
    let level = &taken.level;
    let mut text = level.sentence();
    let mut json = json!(level);
    if level.level == 0 {
        let has_size = level.pixels > 0.0 && level.pixels.is_finite();
        if level.coarsest == 0 && has_size && job.scene.fields.first().bricks().is_some() {
            text.push_str(" in its file of bricks; make it anew with `relume bricks`");
        }
        return (text + "\n", json);
    }
    super::warn_of(RenderWarning::of_level(taken));
    if let Some(smallest) = taken.labels.first() {
        text.push_str(&format!("; of the smallest visible label, {smallest}"));
    }
    json["labels"] = json!(taken.labels);
    (text + "\n", json)
}
