//! Background measurement of the time and error of a scene's accuracy settings on this device, and the choice of one.

use std::path::Path;

use serde::Serialize;

use crate::measure::{Choice, Goal, MeasureError, Pixels, Point, Tried, Wanted, choose, curve};
use crate::progress::Progress;
use crate::render::Renderer;
use crate::scene::{Accuracy, Camera, Mix, Scene, Transfer};

/// Measured setting.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Measured {
    /// Description of the changed knobs.
    pub name: String,
    /// Accuracy of the scene with the setting applied.
    #[serde(skip)]
    pub accuracy: Accuracy,
    /// Measured time and error.
    pub point: Point,
}

/// Settings measured for one view of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Settings, fastest first.
    pub settings: Vec<Measured>,
    camera: Camera,
    transfer: Transfer,
    /// Pixels of the pictures, across and down.
    pub size: [usize; 2],
}

impl Curve {
    /// Creates the curve of the settings `tried` on `scene` in pictures of `size`.
    #[must_use]
    pub fn new(scene: &Scene, size: [usize; 2], tried: &[Tried]) -> Self {
        let mut settings: Vec<Measured> = tried
            .iter()
            .map(|(setting, point)| Measured {
                name: setting.to_string(),
                accuracy: setting.applied(scene).accuracy,
                point: *point,
            })
            .collect();
        settings.sort_by(|one, two| one.point.frame_ms.total_cmp(&two.point.frame_ms));
        Self { settings, camera: scene.camera.clone(), transfer: scene.transfer.clone(), size }
    }

    /// Whether the curve belongs to this view of the scene.
    #[must_use]
    pub fn is_of(&self, scene: &Scene, size: [usize; 2]) -> bool {
        self.camera == scene.camera && self.transfer == scene.transfer && self.size == size
    }

    /// Adds the settings of `other`, which replace equal ones; if `other` belongs to another view, it replaces the
    /// curve.
    pub fn merge(&mut self, other: Self) {
        if (&self.camera, &self.transfer, self.size) != (&other.camera, &other.transfer, other.size) {
            *self = other;
            return;
        }
        for new in other.settings {
            self.settings.retain(|known| known.accuracy != new.accuracy);
            self.settings.push(new);
        }
        self.settings.sort_by(|one, two| one.point.frame_ms.total_cmp(&two.point.frame_ms));
    }

    /// Whether no other setting is at least as fast and as accurate as setting `index`, and better in one of the two.
    #[must_use]
    pub fn is_on_the_front(&self, index: usize) -> bool {
        let Some(Measured { point, .. }) = self.settings.get(index) else { return false };
        let better = |other: &Measured| {
            let Point { frame_ms, error, .. } = other.point;
            let (faster, nearer) = (frame_ms <= point.frame_ms, error.p95 <= point.error.p95);
            faster && nearer && (frame_ms < point.frame_ms || error.p95 < point.error.p95)
        };
        !self.settings.iter().any(better)
    }
}

/// Measures settings of `scene` under `mix` in pictures of `size`: a curve of them, or those needed to find the one
/// that
/// meets `goal`.
///
/// # Errors
///
/// [`MeasureError`].
pub fn measure(
    renderer: &Renderer,
    scene: &Scene,
    mix: &Mix,
    size: [usize; 2],
    goal: Option<Goal>,
    cache: Option<&Path>,
    progress: &dyn Progress,
) -> Result<(Curve, Option<Choice>), MeasureError> {
    // The window marches level 0.
    let mut shown = scene.clone();
    shown.accuracy.voxel_pixels = 0.0;
    let Some(goal) = goal else {
        return Ok((Curve::new(scene, size, &curve(renderer, &shown, mix, size, cache, progress)?), None));
    };
    // Pictures in progress are coarse anyway.
    let wanted = Wanted { size, goal, pixels: Pixels::All };
    let choice = choose(renderer, &shown, mix, wanted, cache, progress)?;
    Ok((Curve::new(scene, size, &choice.tried), Some(choice)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::{SceneError, SceneOptions, load_embedded};
    use crate::measure::Setting;
    use crate::model::ErrorSummary;
    use crate::progress::Quiet;

    fn point(frame_ms: f64, p95: f64) -> Point {
        Point { frame_ms, error: ErrorSummary { mean: p95, p95, max: p95 }, ..Point::default() }
    }

    #[test]
    fn the_front_is_what_nothing_beats() -> Result<(), SceneError> {
        let options = SceneOptions { downsample: Some([8, 8, 8]), ..SceneOptions::default() };
        let scene = load_embedded(&options, &Quiet)?.scene;
        let tried = [(9.0, 0.1), (1.0, 3.0), (4.0, 3.0), (5.0, 0.5), (9.0, 0.2)];
        let tried = tried.map(|(ms, error)| (Setting::default(), point(ms, error)));
        let curve = Curve::new(&scene, [3, 4], &tried);
        let front: Vec<_> = (0..5).filter(|&index| curve.is_on_the_front(index)).collect();
        let kept: Vec<_> = front.iter().map(|&index| curve.settings[index].point).collect();
        assert_eq!(kept, [point(1.0, 3.0), point(5.0, 0.5), point(9.0, 0.1)]);
        assert!(curve.is_of(&scene, [3, 4]) && !curve.is_of(&scene, [4, 3]));
        let mut merged = curve.clone();
        merged.merge(Curve::new(&scene, [3, 4], &[(Setting::default(), point(2.0, 2.0))]));
        assert_eq!(merged.settings.len(), 1, "a setting that is measured again replaces what was known of it");
        merged.merge(Curve::new(&scene, [9, 9], &tried));
        assert_eq!(merged.settings.len(), 5, "another view is another curve");
        Ok(())
    }
}
