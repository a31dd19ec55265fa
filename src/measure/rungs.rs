//! Rungs of a scene: exact samples, stored tables and volume, and the device.

use std::ops::{Deref, DerefMut};

use relume_base::number::Real;
use relume_base::progress::{Progress, Quiet};
use relume_render::{DeviceFilm, RenderError, Renderer, SceneRenderer};
use relume_scene::film::{Film, RelightMatrices};
use relume_scene::plan::{PlanError, Planned, plan, plan_full_spectrum};
use relume_scene::reference::{self, Exact, Marching, ReferenceError, Samples, Stored};
use relume_scene::tables::StoredScene;
use relume_scene::{Mix, Scene};
use relume_volume::VolumeError;

/// A scene with all data that the rungs read.
#[derive(Clone, Debug)]
pub struct Rungs {
    /// The scene.
    pub scene: Scene,
    /// Its plan.
    pub planned: Planned,
    /// Its tables and volume as stored.
    pub stored: StoredScene,
    /// Mix of the scene's own lights.
    pub mix: Mix,
    /// Pixels across and down.
    pub size: [usize; 2],
}

/// Why a rung failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RungError {
    /// Planning failed.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The volume or its labels cannot be used.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The reference failed.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The device failed.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl RungError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Plan(error) => error.code(),
            Self::Volume(error) => error.code(),
            Self::Reference(error) => error.code(),
            Self::Render(error) => error.code(),
        }
    }
}

impl Deref for Rungs {
    type Target = StoredScene;

    fn deref(&self) -> &StoredScene {
        &self.stored
    }
}

impl DerefMut for Rungs {
    fn deref_mut(&mut self) -> &mut StoredScene {
        &mut self.stored
    }
}

impl Rungs {
    /// Plans `scene` and prepares its rungs for pictures of `size`.
    ///
    /// # Errors
    ///
    /// [`RungError::Plan`], and the errors of [`Self::planned`].
    pub fn new(scene: Scene, size: [usize; 2]) -> Result<Self, RungError> {
        let planned = plan(&scene, &Quiet)?;
        Self::planned(scene, planned, size)
    }

    /// Prepares the rungs of `scene` under a given plan.
    ///
    /// # Errors
    ///
    /// [`RungError::Volume`].
    pub fn planned(scene: Scene, planned: Planned, size: [usize; 2]) -> Result<Self, RungError> {
        let statistics = scene.volume().statistics()?;
        let stored = StoredScene::new(&scene, &planned, &statistics)?;
        Ok(Self { mix: Mix::of_scene(&scene), scene, planned, stored, size })
    }

    /// Returns the rungs of the same scene with all 81 bands.
    ///
    /// # Errors
    ///
    /// [`RungError::Volume`].
    pub fn full_spectrum(&self) -> Result<Self, RungError> {
        Self::planned(self.scene.clone(), plan_full_spectrum(&self.scene), self.size)
    }

    /// Exact samples of the scene.
    #[must_use]
    pub fn exact(&self) -> Exact<'_> {
        Exact::new(&self.scene, &self.planned, self.storage.clone(), self.labels.as_deref())
    }

    /// Samples of the stored tables and volume.
    #[must_use]
    pub fn stored<R: Real>(&self) -> Stored<'_, R> {
        Stored::new(&self.planned, &self.stored)
    }

    /// Marches `samples` with the reference.
    ///
    /// # Errors
    ///
    /// [`RungError::Reference`].
    pub fn march<R: Marching>(&self, samples: &dyn Samples<R>, progress: &dyn Progress) -> Result<Film<R>, RungError> {
        Ok(reference::march(&self.scene, &self.planned, samples, self.size, progress)?)
    }

    /// Marches the scene on the device.
    ///
    /// # Errors
    ///
    /// [`RungError::Volume`], [`RungError::Render`].
    pub fn render(&self, renderer: &Renderer, progress: &dyn Progress) -> Result<DeviceFilm, RungError> {
        let statistics = self.scene.volume().statistics()?;
        let (scene, planned) = (self.scene.clone(), self.planned.clone());
        let on_device = SceneRenderer::with_plan(renderer, scene, planned, statistics, progress)?;
        Ok(on_device.march(self.size, progress)?)
    }

    /// Relight matrices to linear sRGB under `mix`.
    #[must_use]
    pub fn matrices(&self, mix: &Mix) -> RelightMatrices {
        RelightMatrices::of_scene(&self.scene, &self.planned, mix)
    }
}
