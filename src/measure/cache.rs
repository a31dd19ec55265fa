//! Cache of the measurements of a scene on a device, kept between runs.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::setting::Setting;
use relume_base::input;
use relume_colour::model::ErrorSummary;
use relume_document::output::{OutputError, write_atomically};
use relume_scene::{Mix, Scene};

/// Size limit of a cache file, in bytes.
const LONGEST: u64 = 1 << 20;

/// Folder of the measurements: the user's cache folder, if the system has one.
#[must_use]
pub fn cache_folder() -> Option<PathBuf> {
    let folder = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    let home =
        || folder("HOME").map(|home| home.join(if cfg!(target_os = "macos") { "Library/Caches" } else { ".cache" }));
    let base = folder("XDG_CACHE_HOME").or_else(|| if cfg!(windows) { folder("LOCALAPPDATA") } else { home() });
    base.map(|base| base.join("relume"))
}

/// Measurements of a setting.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Median wall time of a frame in ms: march, relight and, if any, enlargement.
    pub frame_ms: f64,
    /// Median CPU time of a frame over all threads of this process, in ms.
    pub cpu_ms: f64,
    /// Number of timed frames.
    pub frames: usize,
    /// ΔE00 from the truth in the sampled pixels: mean, p95 and maximum.
    pub error: ErrorSummary,
    /// Upper bound of the p95 of ΔE00 over all visible pixels, with 99 % confidence.
    pub at_most: f64,
}

/// Measured points by the name of their setting.
pub(super) struct Known {
    path: Option<PathBuf>,
    points: BTreeMap<String, Point>,
}

#[derive(Serialize, Deserialize)]
struct File {
    scene: String,
    device: String,
    points: BTreeMap<String, Point>,
}

impl Known {
    /// Reads from the folder `cache` the measurements of `scene` under `mix` in pictures of `size` on `device`, made
    /// by this version of the program. An unreadable or damaged file counts as empty.
    pub(super) fn of(cache: Option<&Path>, scene: &Scene, mix: &Mix, device: &str, size: [usize; 2]) -> Self {
        let path = cache.map(|folder| folder.join(format!("{:016x}.json", key(scene, mix, device, size))));
        let read = |path: &PathBuf| input::read(path, LONGEST).ok().filter(|bytes| bytes.len() as u64 <= LONGEST);
        let file = path.as_ref().and_then(read).and_then(|bytes| serde_json::from_slice::<File>(&bytes).ok());
        Self { path, points: file.map(|file| file.points).unwrap_or_default() }
    }

    pub(super) fn get(&self, setting: &Setting) -> Option<Point> {
        self.points.get(&setting.to_string()).copied()
    }

    pub(super) fn insert(&mut self, setting: &Setting, point: Point) {
        self.points.insert(setting.to_string(), point);
    }

    /// Writes the file and creates its folder.
    pub(super) fn write(&self, scene: &Scene, device: &str) -> Result<(), OutputError> {
        let Some(path) = &self.path else { return Ok(()) };
        let failed = |source| OutputError::Write { path: path.clone(), source };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(failed)?;
        }
        let file = File { scene: scene.name.clone(), device: device.to_owned(), points: self.points.clone() };
        let text = serde_json::to_vec_pretty(&file).map_err(|error| failed(error.into()))?;
        write_atomically(path, |sink| sink.write_all(&text))
    }
}

/// Hash of everything that a measurement depends on.
fn key(scene: &Scene, mix: &Mix, device: &str, size: [usize; 2]) -> u64 {
    let mut hasher = DefaultHasher::new();
    (env!("CARGO_PKG_VERSION"), device, size, scene.digest(), format!("{mix:?}")).hash(&mut hasher);
    hasher.finish()
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use relume_base::progress::Quiet;
    use relume_colour::model::ErrorSummary;
    use relume_document::{SceneOptions, load_embedded};

    #[test]
    fn another_scene_device_or_size_knows_nothing_of_this_one() {
        let folder = tempfile::tempdir().unwrap();
        let cache = folder.path().join("made/when/needed");
        let scene = load_embedded(&SceneOptions { downsample: Some([8, 8, 8]), ..SceneOptions::default() }, &Quiet)
            .unwrap()
            .scene;
        let error = ErrorSummary { mean: 0.1, p95: 0.2, max: 0.3 };
        let point = Point { frame_ms: 2.5, cpu_ms: 4.5, frames: 3, error, at_most: 0.25 };
        let (setting, mix) = (Setting::default(), Mix::of_scene(&scene));
        let mut known = Known::of(Some(&cache), &scene, &mix, "device", [3, 4]);
        assert_eq!(known.get(&setting), None);
        known.insert(&setting, point);
        known.write(&scene, "device").unwrap();
        let known = |scene: &Scene, device, size| Known::of(Some(&cache), scene, &mix, device, size).get(&setting);
        assert_eq!(known(&scene, "device", [3, 4]), Some(point));
        assert_eq!(known(&scene, "other", [3, 4]), None);
        assert_eq!(known(&scene, "device", [4, 3]), None);
        let mut brighter = scene.clone();
        brighter.display.exposure = Some(2.0);
        assert_eq!(known(&brighter, "device", [3, 4]), None);
        let mut one_sided = scene.clone();
        one_sided.lighting = relume_scene::Lighting::OneSided;
        assert_eq!(known(&one_sided, "device", [3, 4]), None);
        let mut other = scene.clone();
        other.set_volume(std::sync::Arc::new(scene.volume().downsample([2, 2, 2]).unwrap()));
        assert_eq!(known(&other, "device", [3, 4]), None);
        for entry in std::fs::read_dir(&cache).unwrap() {
            std::fs::write(entry.unwrap().path(), "{").unwrap();
        }
        assert_eq!(known(&scene, "device", [3, 4]), None, "a damaged file has nothing");
    }
}
