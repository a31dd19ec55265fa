//! Settings in the syntax of scene files and of `-D`.

use super::setting::Setting;
use relume_base::number::readable;
use relume_scene::Scene;

/// All keys that a setting may change, with the values of `scene`: table, name and value in TOML. The entries of the
/// transfer table are included only if stated.
pub(super) fn written(scene: &Scene) -> Vec<(&'static str, &'static str, String)> {
    let accuracy = &scene.accuracy;
    let k = accuracy.dimension.map_or_else(|| toml("auto"), |k| k.to_string());
    let stated = [
        ("step", readable(accuracy.step_length)),
        ("termination", readable(accuracy.termination)),
        ("rays", accuracy.rays.to_string()),
        ("integration", toml(accuracy.integration)),
        ("variation", readable(accuracy.variation)),
        ("interpolation", toml(accuracy.interpolation)),
        ("labels", toml(accuracy.labels)),
        ("accumulate", toml(accuracy.accumulate)),
        ("model", toml(accuracy.model.name())),
        ("k", k),
        ("storage", toml(accuracy.storage)),
        ("volume", toml(accuracy.volume)),
        ("gradients", toml(accuracy.gradients)),
        ("skipping", accuracy.skipping.to_string()),
        ("voxel_pixels", readable(accuracy.voxel_pixels)),
    ];
    let entries = scene.transfer.entries.map(|entries| ("transfer", "entries", entries.to_string()));
    let accuracy = stated.into_iter().map(|(key, value)| ("accuracy", key, value));
    let shadows = [("spacing", readable(scene.shadows.spacing)), ("directions", scene.shadows.directions.to_string())];
    let shadows = shadows.into_iter().filter(|_| scene.asks_for_shadows()).map(|(key, value)| ("shadows", key, value));
    accuracy.chain(shadows).chain([("transfer", "lookup", toml(scene.transfer.lookup))]).chain(entries).collect()
}

/// A value in TOML.
fn toml(value: impl serde::Serialize) -> String {
    // Only names and numbers are passed, and both have a TOML form.
    toml::Value::try_from(value).map_or_else(|_| String::new(), |value| value.to_string())
}

impl Setting {
    /// Scene file keys whose values the setting changes in `scene`: table, name and new value in TOML. The number of
    /// marched pixels is not a key.
    pub(super) fn changed(&self, scene: &Scene) -> Vec<(&'static str, &'static str, String)> {
        let before = written(scene);
        let mut after = written(&self.applied(scene));
        after.retain(|key| !before.contains(key));
        after
    }

    /// Definitions for `-D` that change `scene` to this setting, one per key: `accuracy.step=0.5`. The number of
    /// marched pixels is not a key of a scene.
    #[must_use]
    pub fn definitions(&self, scene: &Scene) -> Vec<String> {
        self.changed(scene)
            .iter()
            .map(|(table, key, value)| format!("{table}.{key}={}", value.replace('"', "")))
            .collect()
    }
}
