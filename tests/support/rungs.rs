//! One scene on every rung; errors fail the test.

use std::ops::{Deref, DerefMut};

use glam::DVec3;
use relume::film::{Film, RelightMatrices};
use relume::measure;
use relume::number::Real;
use relume::plan::Planned;
use relume::progress::Quiet;
use relume::reference::{self, Marching, Samples};
use relume::render::{DeviceFilm, Renderer};
use relume::scene::{Interpolation, Mix, Scene};
use relume::spectrum::colour::XYZ_FROM_LINEAR_SRGB;
use relume::vulkan::DeviceKind;

use super::device::open;

/// Scene with the input of every rung.
#[derive(Clone, Debug)]
pub struct Rungs(measure::Rungs);

impl Deref for Rungs {
    type Target = measure::Rungs;

    fn deref(&self) -> &measure::Rungs {
        &self.0
    }
}

impl DerefMut for Rungs {
    fn deref_mut(&mut self) -> &mut measure::Rungs {
        &mut self.0
    }
}

impl Rungs {
    pub fn new(scene: Scene, size: [usize; 2]) -> Self {
        Self(measure::Rungs::new(scene, size).unwrap())
    }

    pub fn planned(scene: Scene, planned: Planned, size: [usize; 2]) -> Self {
        Self(measure::Rungs::planned(scene, planned, size).unwrap())
    }

    pub fn march<R: Marching>(&self, samples: &dyn Samples<R>) -> Film<R> {
        self.0.march(samples, &Quiet).unwrap()
    }

    /// Returns the same scene with all 81 bands.
    pub fn full_spectrum(&self) -> Self {
        Self(self.0.full_spectrum().unwrap())
    }

    /// XYZ and opacity of the scene, sampled by `samples`.
    pub fn lit(&self, samples: &dyn Samples<f64>) -> Vec<(DVec3, f64)> {
        let matrices = self.xyz_matrices();
        reference::render(&self.scene, &self.planned, samples, &matrices, self.size, &Quiet).unwrap()
    }

    /// XYZ of the scene with all 81 bands.
    pub fn truth(&self) -> Vec<DVec3> {
        let full = self.full_spectrum();
        full.lit(&full.exact()).into_iter().map(|(colour, _)| colour).collect()
    }

    /// As [`Self::truth`], over the stored tables and volume.
    pub fn stored_truth(&self) -> Vec<DVec3> {
        let full = self.full_spectrum();
        full.lit(&full.stored()).into_iter().map(|(colour, _)| colour).collect()
    }

    pub fn gpu(&self, renderer: &Renderer) -> Film<f32> {
        renderer.read(&self.gpu_accumulators(renderer)).unwrap()
    }

    /// The film of the device, which interpolates in f32 like the reference: software devices filter so, and others, whose filter
    /// has eight bits, are asked for exact interpolation. The ladder judges their filter by [`Self::filtered_accumulators`].
    pub fn gpu_accumulators(&self, renderer: &Renderer) -> DeviceFilm {
        let is_software = renderer.device().info().kind == DeviceKind::Software;
        if is_software || self.planned.plan.interpolation != Interpolation::Linear {
            return self.filtered_accumulators(renderer);
        }
        let mut exact = self.clone();
        exact.scene.accuracy.interpolation = Interpolation::ExactLinear;
        exact.planned.plan.interpolation = Interpolation::ExactLinear;
        exact.filtered_accumulators(renderer)
    }

    pub fn filtered(&self, renderer: &Renderer) -> Film<f32> {
        renderer.read(&self.filtered_accumulators(renderer)).unwrap()
    }

    /// The film of the device as the scene says, for comparisons of the device with itself too.
    pub fn filtered_accumulators(&self, renderer: &Renderer) -> DeviceFilm {
        self.0.render(renderer, &Quiet).unwrap()
    }

    /// Relight matrices in linear sRGB for the scene's lights.
    pub fn matrices(&self) -> RelightMatrices {
        self.matrices_under(&self.mix)
    }

    pub fn matrices_under(&self, mix: &Mix) -> RelightMatrices {
        self.0.matrices(mix)
    }

    /// Relight matrices in XYZ for the scene's lights.
    pub fn xyz_matrices(&self) -> RelightMatrices {
        in_xyz(&self.matrices())
    }
}

/// Converts relight matrices from linear sRGB to XYZ.
pub fn in_xyz(matrices: &RelightMatrices) -> RelightMatrices {
    RelightMatrices {
        colours: matrices.colours.iter().map(|&colour| *XYZ_FROM_LINEAR_SRGB * colour).collect(),
        background: matrices.background.iter().map(|&colour| *XYZ_FROM_LINEAR_SRGB * colour).collect(),
        ..matrices.clone()
    }
}

/// Σ|weight · colour| of every pixel and channel, the scale of relative errors.
pub fn magnitudes<R: Real>(accumulation: &Film<R>, matrices: &RelightMatrices) -> Vec<DVec3> {
    let absolute = accumulation.map(|number| number.to_f64().abs());
    let matrices = RelightMatrices {
        colours: matrices.colours.iter().map(|colour| colour.abs()).collect(),
        background: matrices.background.iter().map(|colour| colour.abs()).collect(),
        ..matrices.clone()
    };
    absolute.relight(&matrices)
}

/// Runs `test` on a renderer and fails on any validation message.
pub fn with_renderer<T>(test: impl FnOnce(&Renderer) -> T) -> Option<T> {
    let renderer = Renderer::new(open()?);
    let found = test(&renderer);
    let messages = renderer.device().validation_messages();
    assert!(messages.is_empty(), "the validation layer says:\n{}", messages.join("\n"));
    Some(found)
}
