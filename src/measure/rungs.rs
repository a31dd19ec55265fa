//! Rungs of a scene: exact samples, stored tables and volume, and the device.

use relume_base::number::Real;
use relume_base::progress::{Progress, Quiet};
use relume_render::{DeviceFilm, RenderError, Renderer, SceneRenderer};
use relume_scene::film::{Film, RelightMatrices};
use relume_scene::plan::{Integrate, PlanError, Planned, plan, plan_full_spectrum};
use relume_scene::reference::{self, Exact, Marching, ReferenceError, Samples, Stored};
use relume_scene::tables::{
    ExtinctionTable, GradientTable, LabelMap, SegmentTable, Storage, StoredVolume, TransferTable,
};
use relume_scene::{Mix, Scene};
use relume_volume::VolumeError;

/// A scene with all data that the rungs read.
#[derive(Clone, Debug)]
pub struct Rungs {
    /// The scene.
    pub scene: Scene,
    /// Its plan.
    pub planned: Planned,
    /// How its volume is stored.
    pub storage: Storage,
    /// The volume as stored on a device.
    pub volume: StoredVolume,
    /// The transfer table.
    pub table: TransferTable,
    /// Table of the media of labels.
    pub label_table: TransferTable,
    /// Table of segments, and the densities of labels, if the plan integrates in segments.
    pub segments: Option<(SegmentTable, TransferTable)>,
    /// Extinction of shadows, if lights with a direction cast them.
    pub extinctions: Vec<ExtinctionTable>,
    /// Label of every voxel, if the plan uses labels.
    pub labels: Option<LabelMap>,
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
        let storage = Storage::new(&planned.plan, scene.volume(), &statistics);
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(LabelMap::new).transpose()?;
        Ok(Self {
            volume: StoredVolume::new(scene.volume(), &storage),
            table: TransferTable::new(&scene, &planned, storage.domain),
            label_table: TransferTable::of_labels(&scene, &planned),
            segments: (planned.plan.integration == Integrate::Segments).then(|| {
                let table = SegmentTable::new(&scene, &planned, storage.domain);
                (table, TransferTable::densities_of_labels(&scene, &planned))
            }),
            extinctions: if planned.plan.light.grid_lights() > 0 {
                ExtinctionTable::of_plan(&scene, &planned, storage.domain)
            } else {
                Vec::new()
            },
            mix: Mix::of_scene(&scene),
            scene,
            planned,
            storage,
            labels,
            size,
        })
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
        Exact::new(&self.scene, &self.planned, self.storage.clone(), self.labels.as_ref())
    }

    /// Samples of the stored tables and volume.
    #[must_use]
    pub fn stored<R: Real>(&self) -> Stored<'_, R> {
        let labels = self.labels.as_ref().map(|labels| (labels, &self.label_table));
        let gradients = GradientTable::new(&self.scene, &self.storage);
        let stored = Stored::new(&self.planned, &self.storage, &self.volume, &self.table, labels, gradients);
        let stored = match &self.segments {
            Some((table, densities)) => stored.with_segments(&self.storage, table, Some(densities)),
            None => stored,
        };
        stored.with_shadows(&self.extinctions)
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
