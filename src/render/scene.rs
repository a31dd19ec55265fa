//! A scene on the device: its plan and its volume, ready to march and relight.

use std::sync::Arc;

use super::{DeviceFilm, LightQuality, March, RenderError, Renderer, Speed, Uploaded};
use relume_base::progress::Progress;
use relume_colour::model::ColourModel;
use relume_scene::film::RelightMatrices;
use relume_scene::plan::{Planned, ScenePlan, plan};
use relume_scene::{Camera, Display, Mix, Scene};
use relume_volume::Statistics;

/// Size of the picture that compiles the shaders. Lavapipe compiles again if a side becomes a power of two or stops
/// being one, and few sides are.
const WARM_UP: [usize; 2] = [9, 7];

/// A scene on the device: scene → statistics → plan → upload, then any number of marches and relights.
///
/// Clones share the uploaded volume.
#[derive(Clone, Debug)]
pub struct SceneRenderer {
    renderer: Renderer,
    scene: Scene,
    planned: Planned,
    statistics: Statistics,
    uploaded: Arc<Uploaded>,
}

impl SceneRenderer {
    /// Plans `scene` and uploads its volume.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn new(renderer: &Renderer, scene: Scene, progress: &dyn Progress) -> Result<Self, RenderError> {
        let statistics = scene.fields.first().volume.statistics().map_err(RenderError::Volume)?;
        Self::with_statistics(renderer, scene, statistics, progress)
    }

    /// Plans `scene`, whose values have `statistics`, and uploads its volume.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn with_statistics(
        renderer: &Renderer,
        scene: Scene,
        statistics: Statistics,
        progress: &dyn Progress,
    ) -> Result<Self, RenderError> {
        let planned = plan(&scene, progress)?;
        Self::with_plan(renderer, scene, planned, statistics, progress)
    }

    /// Uploads the volume of `scene`, whose values have `statistics`, as `planned` stores it.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn with_plan(
        renderer: &Renderer,
        scene: Scene,
        planned: Planned,
        statistics: Statistics,
        progress: &dyn Progress,
    ) -> Result<Self, RenderError> {
        let uploaded = Arc::new(renderer.upload(&scene, &planned, &statistics, progress)?);
        Ok(Self { renderer: renderer.clone(), scene, planned, statistics, uploaded })
    }

    /// Whether the uploaded volume is the one of `scene`, stored as `planned` needs it.
    #[must_use]
    pub fn holds(&self, scene: &Scene, planned: &Planned) -> bool {
        self.scene.frame == scene.frame
            && self.scene.fields.are(&scene.fields)
            && self.planned.plan.is_stored_as(&planned.plan)
            && self.uploaded.reaches(scene, &planned.plan)
    }

    /// Replaces the scene. Uploads its volume only if the device does not hold it yet ([`holds`](Self::holds)).
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn with_scene(&self, scene: Scene, planned: Planned, progress: &dyn Progress) -> Result<Self, RenderError> {
        if self.holds(&scene, &planned) {
            return Ok(Self { scene, planned, ..self.clone() });
        }
        let statistics = if self.scene.fields.are(&scene.fields) {
            self.statistics.clone()
        } else {
            scene.fields.first().volume.statistics().map_err(RenderError::Volume)?
        };
        Self::with_plan(&self.renderer, scene, planned, statistics, progress)
    }

    /// The camera, for changes. No plan depends on it.
    pub fn camera_mut(&mut self) -> &mut Camera {
        &mut self.scene.camera
    }

    /// Replaces the colour model by `model`, which has equal accumulators and is fitted for another observer.
    pub fn set_model(&mut self, model: Arc<ColourModel>) {
        self.planned.model = Some(model);
    }

    /// Replaces scene and plan. The device must already hold the volume as the plan stores it.
    pub fn retarget(&mut self, scene: Scene, planned: Planned) {
        debug_assert!(self.holds(&scene, &planned), "another volume, or stored otherwise");
        (self.scene, self.planned) = (scene, planned);
    }

    /// Sets the bytes of other volumes that stay on the device beside this one: pictures have less memory then.
    pub fn set_beside(&mut self, bytes: u64) {
        self.renderer.beside_bytes = bytes;
    }

    /// The renderer and its device.
    #[must_use]
    pub fn renderer(&self) -> &Renderer {
        &self.renderer
    }

    /// The scene.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The plan of the scene.
    #[must_use]
    pub fn planned(&self) -> &Planned {
        &self.planned
    }

    /// Statistics of the volume's values.
    #[must_use]
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// The volume on the device.
    #[must_use]
    pub fn uploaded(&self) -> &Uploaded {
        &self.uploaded
    }

    /// Marches a picture of `size` (width, height).
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn march(&self, size: [usize; 2], progress: &dyn Progress) -> Result<DeviceFilm, RenderError> {
        self.renderer.march(&self.scene, &self.planned, &self.uploaded, size, progress)
    }

    /// Sets up the march of a picture of `size` (width, height), which proceeds step by step.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn begin_march(&self, size: [usize; 2], speed: Speed) -> Result<March, RenderError> {
        self.renderer.begin_march(&self.scene, &self.planned, &self.uploaded, size, speed)
    }

    /// [`Self::begin_march`] with one ray per pixel and this light.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn begin_march_of_one_ray(
        &self,
        size: [usize; 2],
        speed: Speed,
        lighting: LightQuality,
    ) -> Result<March, RenderError> {
        self.renderer.begin(&self.scene, &self.of_one_ray(), &self.uploaded, size, speed, lighting)
    }

    /// The plan with one ray per pixel.
    fn of_one_ray(&self) -> Planned {
        Planned { plan: ScenePlan { rays: 1, ..self.planned.plan.clone() }, ..self.planned.clone() }
    }

    /// The relight matrices of the scene under `mix`.
    #[must_use]
    pub fn matrices(&self, mix: &Mix) -> RelightMatrices {
        RelightMatrices::of_scene(&self.scene, &self.planned, mix)
    }

    /// Conversion of colours for the screen, which no march depends on.
    pub fn display_mut(&mut self) -> &mut Display {
        &mut self.scene.display
    }

    /// Makes an automatic exposure of the scene that of `film` under `mix`.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn expose(&mut self, film: &DeviceFilm, mix: &Mix) -> Result<(), RenderError> {
        self.scene.display.exposure = Some(self.exposure(film, mix)?);
        Ok(())
    }

    /// The exposure of the scene; an automatic one is that of `film` under `mix`.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn exposure(&self, film: &DeviceFilm, mix: &Mix) -> Result<f64, RenderError> {
        let display = &self.scene.display;
        let found = || self.renderer.automatic_exposure(film, &self.matrices(mix), mix, display);
        display.exposure.map_or_else(found, Ok)
    }

    /// Runs the pipeline of a march in bricks once, without bricks: all rays wait. No compilation delays the march then.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn warm_up_rounds(&self) -> Result<(), RenderError> {
        let lighting = LightQuality::Last;
        let mut march =
            self.renderer.begin(&self.scene, &self.planned, &self.uploaded, WARM_UP, Speed::default(), lighting)?;
        march.dispatch(&self.renderer, &self.uploaded)
    }

    /// Runs every pipeline of the scene once, so that no compilation delays the first picture.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn warm_up(&self) -> Result<(), RenderError> {
        // A coarse light grid suffices for the first picture.
        let mut march = self.begin_march_of_one_ray(WARM_UP, Speed::default(), LightQuality::Last)?;
        while !march.is_done() {
            march.step(&self.renderer, &self.uploaded)?;
        }
        let relight = self.renderer.relight_display(&march.finish(&self.renderer)?)?;
        relight.run(&self.matrices(&Mix::of_scene(&self.scene)))?;
        Ok(())
    }
}
