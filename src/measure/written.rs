//! Settings in the syntax of scene files and of `-D`.

use super::setting::{Knob, Setting};
use relume_scene::Scene;

/// All keys that a setting may change, with the values of `scene`: path and value in TOML. The entries of the transfer table
/// are included only if stated, those of the light grid only if the scene asks for shadows, and those of
/// scattered light only if it asks for that. Keys of a table follow each other.
pub(super) fn written(scene: &Scene) -> Vec<(&'static str, String)> {
    let keys = Knob::all().map(Knob::key).filter(|key| key.path.contains('.'));
    let keys = keys.filter(|key| !key.path.starts_with("shadows.") || scene.asks_for_shadows());
    let keys = keys.filter(|key| !key.path.starts_with("scattering.") || scene.scatters_often());
    let mut written: Vec<_> = keys.filter_map(|key| Some((key.path, key.get(scene)?.to_string()))).collect();
    written.sort_by_key(|(path, _)| path.split('.').next());
    written
}

impl Setting {
    /// Scene file keys whose values the setting changes in `scene`: path and new value in TOML. The number of
    /// marched pixels is not a key.
    pub(super) fn changed(&self, scene: &Scene) -> Vec<(&'static str, String)> {
        let before = written(scene);
        let mut after = written(&self.applied(scene));
        after.retain(|key| !before.contains(key));
        after
    }

    /// Definitions for `-D` that change `scene` to this setting, one per key: `accuracy.step=0.5`. The number of
    /// marched pixels is not a key of a scene.
    #[must_use]
    pub fn definitions(&self, scene: &Scene) -> Vec<String> {
        self.changed(scene).iter().map(|(path, value)| format!("{path}={}", value.replace('"', ""))).collect()
    }
}
