//! The level of resolution of a picture, by `accuracy.voxel_pixels`, and what it costs labels.

use serde_json::{Value, json};

use crate::progress::Progress;
use crate::scene::{Camera, Coarse, LabelLeft, Scene};
use crate::volume::Statistics;

use super::CliError;

/// A scene with the level of its volume that it asks for.
pub(crate) struct Taken {
    pub(crate) scene: Scene,
    /// Those of the voxels of the level.
    pub(crate) statistics: Statistics,
    /// The level and its reason, a line; empty if the scene asks for none.
    pub(crate) text: String,
    /// The same for programs; null if the scene asks for none.
    pub(crate) json: Value,
}

/// Takes the level that `scene` asks for in pictures of `size` by `cameras`, and warns of labels that it loses.
pub(crate) fn taken(
    scene: &Scene,
    statistics: Statistics,
    (cameras, size): (&[Camera], [usize; 2]),
    progress: &dyn Progress,
) -> Result<Taken, CliError> {
    let same = |text: String, json: Value| Taken { scene: scene.clone(), statistics: statistics.clone(), text, json };
    if scene.accuracy.voxel_pixels <= 0.0 {
        return Ok(same(String::new(), Value::Null));
    }
    let level = scene.level_of(cameras, size);
    let mut text = level.sentence();
    let has_size = level.pixels > 0.0 && level.pixels.is_finite();
    if level.coarsest == 0 && has_size && scene.fields.first().bricks().is_some() {
        text.push_str(" in its file of bricks; make it anew with `relume bricks`");
    }
    let mut json = json!(level);
    if level.level == 0 {
        return Ok(same(text + "\n", json));
    }
    let coarse = Coarse::of_level(scene, level.level, progress)?;
    let labels = coarse.labels_left(scene)?;
    let lost: Vec<String> = labels.iter().filter(|label| label.is_mostly_lost()).map(counted).collect();
    if !lost.is_empty() {
        tracing::warn!(
            "level {} has less than half of these labels, which the majority of its blocks outvotes: {}; a smaller \
             accuracy.voxel_pixels keeps more of them",
            level.level,
            lost.join(", ")
        );
    }
    if let Some(smallest) = labels.first() {
        text.push_str(&format!("; of the smallest visible label, {}", counted(smallest)));
    }
    json["labels"] = json!(labels);
    let statistics = coarse.volume().statistics()?;
    Ok(Taken { scene: coarse.scene_in(scene, size), statistics, text: text + "\n", json })
}

/// `3 (nerve), 1 voxel of the level (for 8) of its 41 voxels`.
fn counted(label: &LabelLeft) -> String {
    let LabelLeft { label, name, voxels, left, stands_for } = label;
    let plural = |number: u64| if number == 1 { "" } else { "s" };
    format!(
        "{label} ({name}), {left} voxel{} of the level (for {stands_for}) of its {voxels} voxel{}",
        plural(*left),
        plural(*voxels)
    )
}
