//! One scene on every rung.

use glam::DVec3;
use relume::plan::{Planned, plan, plan_full_spectrum};
use relume::progress::Quiet;
use relume::reference::{self, Exact, Real, Samples, Stored};
use relume::render::Renderer;
use relume::scene::{Mix, Scene};
use relume::spectrum::colour::XYZ_FROM_LINEAR_SRGB;
use relume::tables::{Accumulation, Components, LabelMap, RelightMatrices, Storage, StoredVolume, TransferTable};

use super::device::open;

/// A scene with everything the rungs read.
#[derive(Debug)]
pub struct Rungs {
    pub scene: Scene,
    pub planned: Planned,
    pub storage: Storage,
    pub volume: StoredVolume,
    pub table: TransferTable,
    pub label_table: TransferTable,
    pub labels: Option<LabelMap>,
    pub mix: Mix,
    pub size: [usize; 2],
}

impl Rungs {
    pub fn new(scene: Scene, size: [usize; 2]) -> Self {
        let planned = plan(&scene, &Quiet).unwrap();
        Self::planned(scene, planned, size)
    }

    pub fn planned(scene: Scene, planned: Planned, size: [usize; 2]) -> Self {
        let statistics = scene.volume.statistics().unwrap();
        let storage = Storage::new(&planned.plan, &scene.volume, &statistics);
        let labels = scene.labels.as_ref().filter(|_| planned.plan.labels).map(|labels| LabelMap::new(labels).unwrap());
        Self {
            volume: StoredVolume::new(&scene.volume, &storage),
            table: TransferTable::new(&scene, &planned, storage.domain),
            label_table: TransferTable::of_labels(&scene, &planned),
            mix: Mix::of_scene(&scene),
            scene,
            planned,
            storage,
            labels,
            size,
        }
    }

    pub fn exact(&self) -> Exact<'_> {
        Exact::new(&self.scene, &self.planned, self.storage.clone(), self.labels.as_ref())
    }

    pub fn stored<R: Real>(&self) -> Stored<'_, R> {
        let labels = self.labels.as_ref().map(|labels| (labels, &self.label_table));
        Stored::new(&self.planned, &self.storage, &self.volume, &self.table, labels)
    }

    pub fn march<R: Real>(&self, samples: &impl Samples<R>) -> Accumulation<R> {
        reference::march(&self.scene, &self.planned, samples, self.size, &Quiet).unwrap()
    }

    /// The same scene with all 81 bands.
    pub fn full_spectrum(&self) -> Self {
        Self::planned(self.scene.clone(), plan_full_spectrum(&self.scene), self.size)
    }

    /// XYZ and opacity, from what `samples` finds of the scene.
    pub fn lit(&self, samples: &impl Samples<f64>) -> Vec<(DVec3, f64)> {
        let matrices = self.xyz_matrices();
        reference::render(&self.scene, &self.planned, samples, &matrices, self.size, &Quiet).unwrap()
    }

    /// XYZ of the scene with all 81 bands.
    pub fn truth(&self) -> Vec<DVec3> {
        let full = self.full_spectrum();
        full.lit(&full.exact()).into_iter().map(|(colour, _)| colour).collect()
    }

    /// The same over the stored tables and volume.
    pub fn stored_truth(&self) -> Vec<DVec3> {
        let full = self.full_spectrum();
        full.lit(&full.stored()).into_iter().map(|(colour, _)| colour).collect()
    }

    pub fn gpu(&self, renderer: &Renderer) -> Accumulation<f32> {
        let accumulators = self.gpu_accumulators(renderer);
        renderer.read(&accumulators).unwrap()
    }

    pub fn gpu_accumulators(&self, renderer: &Renderer) -> relume::render::Accumulators {
        let statistics = self.scene.volume.statistics().unwrap();
        let uploaded = renderer.upload(&self.scene, &self.planned, &statistics, &Quiet).unwrap();
        renderer.march(&self.scene, &self.planned, &uploaded, self.size, &Quiet).unwrap()
    }

    /// Linear sRGB of the components under the scene's own lights.
    pub fn matrices(&self) -> RelightMatrices {
        self.matrices_under(&self.mix)
    }

    pub fn matrices_under(&self, mix: &Mix) -> RelightMatrices {
        RelightMatrices::new(
            &Components::new(&self.scene, &self.planned),
            self.planned.positions.len(),
            self.scene.background.as_ref(),
            mix,
            &self.scene.display,
        )
    }

    /// The same as XYZ.
    pub fn xyz_matrices(&self) -> RelightMatrices {
        in_xyz(&self.matrices())
    }
}

/// Matrices of linear sRGB as matrices of XYZ.
pub fn in_xyz(matrices: &RelightMatrices) -> RelightMatrices {
    RelightMatrices {
        colours: matrices.colours.iter().map(|&colour| *XYZ_FROM_LINEAR_SRGB * colour).collect(),
        background: matrices.background.iter().map(|&colour| *XYZ_FROM_LINEAR_SRGB * colour).collect(),
        passing: matrices.passing.clone(),
    }
}

/// Σ|weight · colour| of every pixel and channel: what errors of a picture are relative to.
pub fn magnitudes<R: Real>(accumulation: &Accumulation<R>, matrices: &RelightMatrices) -> Vec<DVec3> {
    let absolute = Accumulation {
        size: accumulation.size,
        weights: accumulation.weights.iter().map(|weight| weight.to_f64().abs()).collect(),
        transmittance: accumulation.transmittance.iter().map(|passed| passed.to_f64().abs()).collect::<Vec<f64>>(),
    };
    let matrices = RelightMatrices {
        colours: matrices.colours.iter().map(|colour| colour.abs()).collect(),
        background: matrices.background.iter().map(|colour| colour.abs()).collect(),
        passing: matrices.passing.clone(),
    };
    reference::relight(&absolute, &matrices)
}

/// Runs `test` on a renderer, and fails where the validation layer has something to say.
pub fn with_renderer(test: impl FnOnce(&Renderer)) {
    let Some(device) = open() else { return };
    let renderer = Renderer::new(device);
    test(&renderer);
    let messages = renderer.device().validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
}
