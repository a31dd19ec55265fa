//! Settings as a scene file says them, and as `-D` does.

use super::setting::Setting;
use crate::number::readable;
use crate::scene::Scene;

/// Every key that a setting may change, as `scene` has it: its table, its name and its value in TOML; of the entries of the
/// transfer table only where they are stated.
pub(super) fn written(scene: &Scene) -> Vec<(&'static str, &'static str, String)> {
    let accuracy = &scene.accuracy;
    let k = accuracy.dimension.map_or_else(|| toml("auto"), |k| k.to_string());
    let stated = [
        ("step", readable(accuracy.step_length)),
        ("termination", readable(accuracy.termination)),
        ("interpolation", toml(accuracy.interpolation)),
        ("accumulate", toml(accuracy.accumulate)),
        ("model", toml(accuracy.model.name())),
        ("k", k),
        ("storage", toml(accuracy.storage)),
        ("volume", toml(accuracy.volume)),
        ("gradients", toml(accuracy.gradients)),
        ("skipping", accuracy.skipping.to_string()),
    ];
    let entries = scene.transfer.entries.map(|entries| ("transfer", "entries", entries.to_string()));
    let accuracy = stated.into_iter().map(|(key, value)| ("accuracy", key, value));
    accuracy.chain([("transfer", "lookup", toml(scene.transfer.lookup))]).chain(entries).collect()
}

/// A value as TOML has it.
fn toml(value: impl serde::Serialize) -> String {
    // Names of values and numbers are all that comes here, and have a form.
    toml::Value::try_from(value).map_or_else(|_| String::new(), |value| value.to_string())
}

impl Setting {
    /// The keys of a scene file that it changes in `scene`, with their values in TOML. How many pixels are marched is no key.
    pub(super) fn changed(&self, scene: &Scene) -> Vec<(&'static str, &'static str, String)> {
        let before = written(scene);
        let mut after = written(&self.applied(scene));
        after.retain(|key| !before.contains(key));
        after
    }

    /// What `-D` takes to change `scene` to this setting, a definition a key: `accuracy.step=0.5`. How many pixels are
    /// marched is no key of a scene.
    #[must_use]
    pub fn definitions(&self, scene: &Scene) -> Vec<String> {
        self.changed(scene)
            .iter()
            .map(|(table, key, value)| format!("{table}.{key}={}", value.replace('"', "")))
            .collect()
    }
}
