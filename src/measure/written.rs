//! Settings as a scene file says them, and as `-D` does.

use super::setting::Setting;
use crate::number::readable;
use crate::scene::{AccumulateAs, Gradients, Interpolation, Lookup, Scene, StoreAs, VolumeAs};

/// Every key that a setting may change, as `scene` has it: its table, its name and its value in TOML; of the entries of the
/// transfer table only where they are stated.
pub(super) fn written(scene: &Scene) -> Vec<(&'static str, &'static str, String)> {
    let accuracy = &scene.accuracy;
    let name = |name: &str| format!("\"{name}\"");
    let interpolation = match accuracy.interpolation {
        Interpolation::Nearest => "nearest",
        Interpolation::Linear => "linear",
        Interpolation::ExactLinear => "exact_linear",
        Interpolation::Cubic => "cubic",
    };
    let volume = match accuracy.volume {
        VolumeAs::Auto => "auto",
        VolumeAs::Single => "f32",
        VolumeAs::Short => "u16",
    };
    let gradients = match accuracy.gradients {
        Gradients::Packed => "packed",
        Gradients::Central => "central",
    };
    let accumulate = match accuracy.accumulate {
        AccumulateAs::Auto => "auto",
        AccumulateAs::Weights => "weights",
        AccumulateAs::Spectral => "spectral",
    };
    let storage = match accuracy.storage {
        StoreAs::Single => "f32",
        StoreAs::Half => "f16",
    };
    let lookup = match scene.transfer.lookup {
        Lookup::Nearest => "nearest",
        Lookup::Linear => "linear",
    };
    let k = accuracy.dimension.map_or_else(|| name("auto"), |k| k.to_string());
    let stated = [
        ("step", readable(accuracy.step_length)),
        ("termination", readable(accuracy.termination)),
        ("interpolation", name(interpolation)),
        ("accumulate", name(accumulate)),
        ("model", name(accuracy.model.name())),
        ("k", k),
        ("storage", name(storage)),
        ("volume", name(volume)),
        ("gradients", name(gradients)),
        ("skipping", accuracy.skipping.to_string()),
    ];
    let entries = scene.transfer.entries.map(|entries| ("transfer", "entries", entries.to_string()));
    let accuracy = stated.into_iter().map(|(key, value)| ("accuracy", key, value));
    accuracy.chain([("transfer", "lookup", name(lookup))]).chain(entries).collect()
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
