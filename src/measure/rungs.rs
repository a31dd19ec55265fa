//! A scene on the rungs of the ladder: the scene itself, its stored tables and volume, and what a device leaves.

use crate::film::{Film, RelightMatrices};
use crate::number::Real;
use crate::plan::{PlanError, Planned, plan, plan_full_spectrum};
use crate::progress::{Progress, Quiet};
use crate::reference::{self, Exact, ReferenceError, Samples, Stored};
use crate::render::{DeviceFilm, RenderError, Renderer, SceneRenderer};
use crate::scene::{Mix, Scene};
use crate::tables::{LabelMap, Storage, StoredVolume, TransferTable};
use crate::volume::VolumeError;

/// A scene with everything that the rungs read.
#[derive(Clone, Debug)]
pub struct Rungs {
    /// The scene.
    pub scene: Scene,
    /// Its plan.
    pub planned: Planned,
    /// How its volume is stored.
    pub storage: Storage,
    /// The volume as a device has it.
    pub volume: StoredVolume,
    /// The transfer table.
    pub table: TransferTable,
    /// What labels show as.
    pub label_table: TransferTable,
    /// Which voxel has which of them, where the plan looks.
    pub labels: Option<LabelMap>,
    /// The scene's own lights.
    pub mix: Mix,
    /// Pixels across and down.
    pub size: [usize; 2],
}

/// Why a scene has no rungs.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RungError {
    /// There is no plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The volume or its labels cannot be used.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The reference gave up.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The device gave up.
    #[error(transparent)]
    Render(#[from] RenderError),
}

impl Rungs {
    /// The rungs of `scene` as it is planned, for pictures of `size`.
    ///
    /// # Errors
    ///
    /// [`RungError::Plan`], and those of [`Self::planned`].
    pub fn new(scene: Scene, size: [usize; 2]) -> Result<Self, RungError> {
        let planned = plan(&scene, &Quiet)?;
        Self::planned(scene, planned, size)
    }

    /// The rungs of `scene` under another plan of it.
    ///
    /// # Errors
    ///
    /// [`RungError::Volume`].
    pub fn planned(scene: Scene, planned: Planned, size: [usize; 2]) -> Result<Self, RungError> {
        let statistics = scene.volume.statistics()?;
        let storage = Storage::new(&planned.plan, &scene.volume, &statistics);
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(LabelMap::new).transpose()?;
        Ok(Self {
            volume: StoredVolume::new(&scene.volume, &storage),
            table: TransferTable::new(&scene, &planned, storage.domain),
            label_table: TransferTable::of_labels(&scene, &planned),
            mix: Mix::of_scene(&scene),
            scene,
            planned,
            storage,
            labels,
            size,
        })
    }

    /// The same scene with all 81 bands.
    ///
    /// # Errors
    ///
    /// [`RungError::Volume`].
    pub fn full_spectrum(&self) -> Result<Self, RungError> {
        Self::planned(self.scene.clone(), plan_full_spectrum(&self.scene), self.size)
    }

    /// Samples of the scene itself.
    #[must_use]
    pub fn exact(&self) -> Exact<'_> {
        Exact::new(&self.scene, &self.planned, self.storage.clone(), self.labels.as_ref())
    }

    /// Samples of the tables and the volume that a device has.
    #[must_use]
    pub fn stored<R: Real>(&self) -> Stored<'_, R> {
        let labels = self.labels.as_ref().map(|labels| (labels, &self.label_table));
        Stored::new(&self.planned, &self.storage, &self.volume, &self.table, labels)
    }

    /// What the reference makes of `samples`.
    ///
    /// # Errors
    ///
    /// [`RungError::Reference`].
    pub fn march<R: Real>(&self, samples: &impl Samples<R>, progress: &dyn Progress) -> Result<Film<R>, RungError> {
        Ok(reference::march(&self.scene, &self.planned, samples, self.size, progress)?)
    }

    /// What a device makes of the scene.
    ///
    /// # Errors
    ///
    /// [`RungError::Volume`], [`RungError::Render`].
    pub fn render(&self, renderer: &Renderer, progress: &dyn Progress) -> Result<DeviceFilm, RungError> {
        let statistics = self.scene.volume.statistics()?;
        let (scene, planned) = (self.scene.clone(), self.planned.clone());
        let on_device = SceneRenderer::with_plan(renderer, scene, planned, statistics, progress)?;
        Ok(on_device.march(self.size, progress)?)
    }

    /// Linear sRGB of the components under `mix`.
    #[must_use]
    pub fn matrices(&self, mix: &Mix) -> RelightMatrices {
        RelightMatrices::of_scene(&self.scene, &self.planned, mix)
    }
}
