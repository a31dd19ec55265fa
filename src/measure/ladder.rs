//! Colours of selected pixels on each rung of the ladder, and names for the errors between rungs.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DVec3;
use serde::Serialize;

use super::clock::{Limit, Stopwatch};
use super::skipping::occupancy;
use relume_base::number::{count, rounded, whole};
use relume_base::progress::Progress;
use relume_colour::spectrum::colour::{LINEAR_SRGB_FROM_XYZ, XYZ_FROM_LINEAR_SRGB};
use relume_scene::film::{RelightMatrices, Relightable, automatic_exposure};
use relume_scene::plan::{Planned, ScenePlan, plan_full_spectrum};
use relume_scene::reference::{Exact, KeptDepths, Marching, ReferenceError, Skipping, Stored, render_pixels};
use relume_scene::tables::{LabelMap, Occupancy, Storage, StoredScene, StoredVolume};
use relume_scene::{
    Accuracy, AmbientShares, Integration, Interpolation, LabelInterpolation, Mix, Orders, Scattering, Scene,
    ShadowMethod, Shadows, StoreAs,
};
use relume_volume::{Statistics, VolumeError};

/// Cause of a difference from the truth: the difference between two rungs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Cause {
    /// Fewer rays per pixel than the truth.
    PixelArea,
    /// Samples Δs apart: full spectrum at Δs against full spectrum at an eighth of the shortest measured Δs.
    Step,
    /// Interpolation between voxels other than the scene's.
    Interpolation,
    /// Early ray termination.
    Termination,
    /// A coarser level of the volume, with steps as long in its voxels.
    Level,
    /// Shadows from a light grid instead of rays to the lights.
    LightGrid,
    /// Scattered light from a coarser grid and fewer directions.
    Scattering,
    /// Spectra represented by few numbers.
    Basis,
    /// The transfer function as a table, the volume as a texture, and possibly 16-bit accumulators.
    Tables,
    /// Arithmetic in f32.
    Rounding,
    /// Filtering and rounding of the device.
    Device,
    /// Fewer marched than displayed pixels.
    Resolution,
}

impl Cause {
    /// All causes, from the truth down.
    pub const ALL: [Self; 12] = [
        Self::PixelArea,
        Self::Step,
        Self::Interpolation,
        Self::Termination,
        Self::Level,
        Self::LightGrid,
        Self::Scattering,
        Self::Basis,
        Self::Tables,
        Self::Rounding,
        Self::Device,
        Self::Resolution,
    ];

    /// Name in reports.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PixelArea => "pixel area",
            Self::Step => "step",
            Self::Interpolation => "interpolation",
            Self::Termination => "termination",
            Self::Level => "level",
            Self::LightGrid => "light grid",
            Self::Scattering => "scattered light",
            Self::Basis => "basis",
            Self::Tables => "tables and storage",
            Self::Rounding => "rounding",
            Self::Device => "device",
            Self::Resolution => "resolution",
        }
    }
}

/// Regular grid of sampled pixels in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Lattice {
    /// Pixels of the picture, across and down.
    pub size: [usize; 2],
    /// Distance between sampled pixels, across and down.
    pub stride: usize,
}

impl Lattice {
    /// Selects between 1 and `most` equally spaced pixels of a picture of `size`.
    #[must_use]
    pub fn new(size: [usize; 2], most: usize) -> Self {
        let stride = (count(size[0]) * count(size[1]) / count(most.max(1))).sqrt();
        let mut lattice = Self { size, stride: whole(stride).max(1) };
        while lattice.dims()[0] * lattice.dims()[1] > most.max(1) {
            lattice.stride += 1;
        }
        lattice
    }

    /// Number of sampled pixels, across and down.
    #[must_use]
    pub fn dims(&self) -> [usize; 2] {
        self.size.map(|side| (side / self.stride).max(1))
    }

    /// All sampled pixels, row by row.
    #[must_use]
    pub fn pixels(&self) -> Vec<[usize; 2]> {
        let [across, down] = self.dims();
        let at = |i: usize, side: usize| (i * self.stride + self.stride / 2).min(side - 1);
        (0..across * down).map(|i| [at(i % across, self.size[0]), at(i / across, self.size[1])]).collect()
    }
}

/// Largest rounding error of a zero, for XYZ of at most about 1 and for opacities.
const ROUNDING: f64 = 1e-12;
/// Ratio of the shortest measured step to the step of the truth.
pub(super) const FINER: f64 = 8.0;

/// Rays of a pixel of the truth, where settings have up to `most`: four times as many, and 64 at most unless there are
/// more. Where all settings have one ray, so has the truth: errors then do not contain that of the pixel's area.
pub(super) fn true_rays(most: usize) -> usize {
    if most > 1 { (4 * most).min(64).max(most) } else { 1 }
}

/// The part of a setting that affects the full spectrum.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
struct March {
    step_length: u64,
    termination: u64,
    interpolation: Interpolation,
    labels: LabelInterpolation,
    rays: usize,
    jitter: bool,
    integration: Integration,
    variation: u64,
    /// Spacing of the light grid and directions of the sky; rays without them.
    grid: Option<(u64, usize)>,
    /// Spacing of the nodes of scattered light and their directions.
    scattering: (Option<u64>, Option<usize>),
}

/// Settings of light on its way to samples.
pub(super) type Transport = (Shadows, Scattering);

impl March {
    fn of(accuracy: &Accuracy, (shadows, scattering): &Transport) -> Self {
        Self {
            scattering: (scattering.spacing.map(f64::to_bits), scattering.directions),
            grid: (shadows.method == ShadowMethod::Grid).then(|| (shadows.spacing.to_bits(), shadows.directions)),
            step_length: accuracy.step_length.to_bits(),
            termination: accuracy.termination.to_bits(),
            interpolation: accuracy.interpolation,
            labels: accuracy.labels,
            rays: accuracy.rays,
            jitter: accuracy.jitter,
            integration: accuracy.integration,
            variation: accuracy.variation.to_bits(),
        }
    }
}

/// The volume as a device would store it, and the plan that it is stored for.
struct Kept {
    plan: ScenePlan,
    storage: Storage,
    volume: Arc<StoredVolume>,
}

/// The rungs of one scene that need no device.
pub(super) struct Ladder<'a> {
    scene: &'a Scene,
    statistics: Statistics,
    labels: Option<Arc<LabelMap>>,
    occupancy: Occupancy,
    size: [usize; 2],
    mix: Mix,
    /// Exposure of all colours.
    exposure: Option<f64>,
    /// The visible pixels.
    pub(super) pixels: Vec<[usize; 2]>,
    /// XYZ behind the volume.
    pub(super) background: DVec3,
    /// The shortest measured Δs, in world units.
    pub(super) finest: f64,
    /// Rays of a pixel of the truth.
    pub(super) rays: usize,
    /// True if the truth has the scattered light of the scene, whose error is [stated](super::ScatteredError) apart.
    pub(super) stated_scattering: bool,
    full: HashMap<March, Arc<Vec<DVec3>>>,
    kept: Option<Kept>,
    /// Depths of light grids, which marches with the same grid share.
    depths: KeptDepths<f64>,
}

impl<'a> Ladder<'a> {
    /// Creates the ladder of the visible ones of `pixels` of `scene` under `mix`. No measured step may be shorter than
    /// `finest`, and no pixel may have more than `most_rays`.
    pub(super) fn new(
        scene: &'a Scene,
        mix: Mix,
        size: [usize; 2],
        pixels: &[[usize; 2]],
        (finest, most_rays): (f64, usize),
        progress: &dyn Progress,
    ) -> Result<Self, LadderError> {
        let mut ladder = Self::without_pixels(scene, mix, size, (finest, true_rays(most_rays)))?;
        ladder.pixels = ladder.showing(pixels, progress)?;
        ladder.expose(progress)?;
        Ok(ladder)
    }

    /// Makes an automatic exposure that of some of the pixels, as the scene states them.
    pub(super) fn expose(&mut self, progress: &dyn Progress) -> Result<(), LadderError> {
        const MOST: usize = 512;
        if self.exposure.is_none() {
            let step = self.pixels.len().div_ceil(MOST).max(1);
            let pixels: Vec<[usize; 2]> = self.pixels.iter().copied().step_by(step).collect();
            let truth = plan_full_spectrum(self.scene);
            let found = self.march_exact(self.scene, &truth, &pixels, progress)?;
            let rgba = |(xyz, opacity): &(DVec3, f64)| {
                let colour = *LINEAR_SRGB_FROM_XYZ * *xyz;
                [colour.x, colour.y, colour.z, *opacity].map(rounded)
            };
            let picture: Vec<f32> = found.iter().flat_map(rgba).collect();
            self.exposure = Some(automatic_exposure(&picture, &self.mix, &self.scene.display));
            self.background = self.matrices(self.scene, &truth).background.iter().copied().sum();
        }
        Ok(())
    }

    /// The ladder of the same pixels of `scene`, which is that of this ladder with a coarser level of its volume.
    pub(super) fn of_level<'b>(&self, scene: &'b Scene) -> Result<Ladder<'b>, LadderError> {
        let ladder = Ladder::without_pixels(scene, self.mix.clone(), self.size, (self.finest, self.rays))?;
        Ok(Ladder {
            pixels: self.pixels.clone(),
            exposure: self.exposure,
            background: self.background,
            stated_scattering: self.stated_scattering,
            ..ladder
        })
    }

    fn without_pixels(
        scene: &'a Scene,
        mix: Mix,
        size: [usize; 2],
        (finest, rays): (f64, usize),
    ) -> Result<Self, LadderError> {
        let statistics = scene.volume().statistics()?;
        let labels = scene.labels.as_ref().filter(|labels| !labels.declared.is_empty());
        let labels = labels.map(LabelMap::new).transpose()?.map(Arc::new);
        let truth = plan_full_spectrum(scene);
        let storage = Storage::new(&truth.plan, scene.volume(), &statistics);
        let mut ladder = Self {
            occupancy: occupancy(scene, &storage, labels.as_deref()),
            scene,
            statistics,
            labels,
            size,
            mix,
            exposure: scene.display.exposure,
            pixels: Vec::new(),
            background: DVec3::ZERO,
            finest,
            rays,
            stated_scattering: false,
            full: HashMap::new(),
            kept: None,
            depths: KeptDepths::default(),
        };
        ladder.background = ladder.matrices(scene, &truth).background.iter().copied().sum();
        Ok(ladder)
    }

    /// Returns those of `pixels` in which the volume is visible.
    pub(super) fn showing(
        &self,
        pixels: &[[usize; 2]],
        progress: &dyn Progress,
    ) -> Result<Vec<[usize; 2]>, LadderError> {
        let mut scene = self.scene.clone();
        (scene.accuracy.integration, scene.accuracy.rays) = (Integration::Samples, self.rays);
        scene.lights.iter_mut().for_each(|light| light.shadows = false);
        scene.shadows.ambient = AmbientShares::Open;
        // Whatever light scatters, it scatters once.
        scene.scattering.orders = Orders::Single;
        let found = self.march_exact(&scene, &plan_full_spectrum(&scene), pixels, progress)?;
        // The fractions of 81 bands in the light sum to 1 only up to rounding.
        let shows = |(colour, opacity): &(DVec3, f64)| {
            *opacity > ROUNDING || (*colour - self.background).abs().max_element() > ROUNDING
        };
        let shown = pixels.iter().zip(&found).filter(|(_, found)| shows(found));
        Ok(shown.map(|(&pixel, _)| pixel).collect())
    }

    /// The truth: full spectrum, point samples without tables, an eighth of the shortest Δs, rays to the lights, finer scattered light, no early
    /// ray termination, [`true_rays`] per pixel.
    pub(super) fn truth(&mut self, progress: &dyn Progress) -> Result<Arc<Vec<DVec3>>, LadderError> {
        self.full(&self.true_accuracy(), &self.true_transport(), progress)
    }

    /// Shadows by rays, and scattered light of half the spacing from twice the directions unless that of the scene is taken: paths have noise,
    /// which every other cause of error would contain.
    pub(super) fn true_transport(&self) -> Transport {
        let scene = self.scene;
        let scattering = if self.stated_scattering {
            scene.scattering
        } else {
            Scattering {
                spacing: Some(0.5 * scene.scattering_spacing()),
                directions: Some(2 * scene.scattering_directions()),
                ..scene.scattering
            }
        };
        (Shadows { method: ShadowMethod::Rays, ..scene.shadows }, scattering)
    }

    pub(super) fn true_accuracy(&self) -> Accuracy {
        Accuracy {
            step_length: self.finest / FINER,
            termination: 0.0,
            integration: Integration::Samples,
            rays: self.rays,
            ..self.scene.accuracy.clone()
        }
    }

    /// Full spectrum without tables, with the step, termination, interpolation, rays and integration of `accuracy`, and with
    /// this transport; cached.
    pub(super) fn full(
        &mut self,
        accuracy: &Accuracy,
        transport: &Transport,
        progress: &dyn Progress,
    ) -> Result<Arc<Vec<DVec3>>, LadderError> {
        let key = March::of(accuracy, transport);
        if let Some(known) = self.full.get(&key) {
            return Ok(Arc::clone(known));
        }
        let mut scene = self.scene.clone();
        (scene.accuracy, (scene.shadows, scene.scattering)) = (accuracy.clone(), *transport);
        let found = self.march_full(&scene, progress)?.into_iter().map(|(colour, _)| colour);
        let found = Arc::new(found.collect::<Vec<_>>());
        self.full.insert(key, Arc::clone(&found));
        Ok(found)
    }

    fn march_full(&self, scene: &Scene, progress: &dyn Progress) -> Result<Vec<(DVec3, f64)>, LadderError> {
        self.march_exact(scene, &plan_full_spectrum(scene), &self.pixels, progress)
    }

    /// The truth in other pixels.
    pub(super) fn truth_in(&self, pixels: &[[usize; 2]], progress: &dyn Progress) -> Result<Vec<DVec3>, LadderError> {
        let mut scene = self.scene.clone();
        (scene.accuracy, (scene.shadows, scene.scattering)) = (self.true_accuracy(), self.true_transport());
        let found = self.march_exact(&scene, &plan_full_spectrum(&scene), pixels, progress)?;
        Ok(found.into_iter().map(|(colour, _)| colour).collect())
    }

    /// The truth in the first of `pixels`: in `least` of them, and in as many more as `limit` gives time for.
    pub(super) fn truth_within(
        &self,
        pixels: &[[usize; 2]],
        (limit, least): (Limit, usize),
        progress: &dyn Progress,
    ) -> Result<Vec<DVec3>, LadderError> {
        /// Pixels between two looks at the clock.
        const TOGETHER: usize = 128;
        let clock = Stopwatch::start();
        let mut found = Vec::new();
        while found.len() < pixels.len() && (found.len() < least || clock.read().wall_ms < limit.0) {
            let end = (found.len() + TOGETHER.max(least.saturating_sub(found.len()))).min(pixels.len());
            let end = if limit.0.is_finite() { end } else { pixels.len() };
            found.extend(self.truth_in(&pixels[found.len()..end], progress)?);
        }
        Ok(found)
    }

    /// XYZ and opacity of `scene` under the plan `planned`, from exact samples.
    fn march_exact(
        &self,
        scene: &Scene,
        planned: &Planned,
        pixels: &[[usize; 2]],
        progress: &dyn Progress,
    ) -> Result<Vec<(DVec3, f64)>, LadderError> {
        let storage = Storage::new(&planned.plan, scene.volume(), &self.statistics);
        let labels = self.labels.as_deref().filter(|_| planned.plan.labels);
        let exact = Exact::new(scene, planned, storage, labels).keeping_depths(&self.depths);
        let skipping = Skipping::new(exact, &self.occupancy, scene, planned);
        let matrices = self.matrices(scene, planned);
        Ok(render_pixels(scene, planned, &skipping, &matrices, self.size, pixels, progress)?)
    }

    /// XYZ under the plan `planned` in f64 from exact samples, with unrounded accumulators.
    pub(super) fn model(
        &self,
        scene: &Scene,
        planned: &Planned,
        progress: &dyn Progress,
    ) -> Result<Vec<DVec3>, LadderError> {
        let mut exact = planned.clone();
        exact.plan.storage = StoreAs::Single;
        Ok(self.march_exact(scene, &exact, &self.pixels, progress)?.into_iter().map(|(colour, _)| colour).collect())
    }

    /// Tables and volume of `scene` as a device stores them for `planned`.
    pub(super) fn store(&mut self, scene: &Scene, planned: &Planned) -> StoredScene {
        let statistics = &self.statistics;
        let stored = || {
            let storage = Storage::new(&planned.plan, scene.volume(), statistics);
            let volume = Arc::new(StoredVolume::new(scene.volume(), &storage));
            Kept { plan: planned.plan.clone(), storage, volume }
        };
        let kept = self.kept.take().filter(|kept| kept.plan.is_stored_as(&planned.plan)).unwrap_or_else(stored);
        let Kept { storage, volume, .. } = self.kept.insert(kept);
        let labels = self.labels.as_ref().filter(|_| planned.plan.labels).cloned();
        StoredScene::of(scene, planned, (storage.clone(), Arc::clone(volume)), labels)
    }

    /// XYZ under the plan `planned` from what a device has `stored` of `scene`.
    pub(super) fn stored<R: Marching>(
        &self,
        scene: &Scene,
        planned: &Planned,
        stored: &StoredScene,
        progress: &dyn Progress,
    ) -> Result<Vec<DVec3>, LadderError> {
        let matrices = self.matrices(scene, planned);
        let samples = Stored::<R>::new(planned, stored);
        let found = render_pixels(scene, planned, &samples, &matrices, self.size, &self.pixels, progress)?;
        Ok(found.into_iter().map(|(colour, _)| colour).collect())
    }

    pub(super) fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Matrices from accumulators to XYZ as displayed, including exposure and adaptation.
    fn matrices(&self, scene: &Scene, planned: &Planned) -> RelightMatrices {
        let shown = self.shown(scene, planned);
        let in_xyz = |colours: Vec<DVec3>| colours.into_iter().map(|colour| *XYZ_FROM_LINEAR_SRGB * colour).collect();
        RelightMatrices { colours: in_xyz(shown.colours), background: in_xyz(shown.background), ..shown }
    }

    /// The same matrices to linear sRGB.
    pub(super) fn shown(&self, scene: &Scene, planned: &Planned) -> RelightMatrices {
        let mut means = Relightable::new(scene, planned);
        means.display.exposure = self.exposure;
        means.under(&self.mix)
    }
}

/// Why a rung could not be computed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LadderError {
    /// The reference failed.
    #[error(transparent)]
    Reference(#[from] ReferenceError),
    /// The volume or its labels cannot be used.
    #[error(transparent)]
    Volume(#[from] VolumeError),
}

impl LadderError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Reference(error) => error.code(),
            Self::Volume(error) => error.code(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Lattice;

    #[test]
    fn a_lattice_has_pixels_of_the_picture_and_no_more_than_asked_for() {
        for (size, most) in [([400, 400], 4096), ([1, 1], 10), ([7, 3], 4), ([1000, 1], 16), ([5, 5], 1)] {
            let pixels = Lattice::new(size, most).pixels();
            assert!((1..=most).contains(&pixels.len()), "{size:?}: {}", pixels.len());
            assert!(pixels.iter().all(|[x, y]| *x < size[0] && *y < size[1]), "{size:?}: {pixels:?}");
        }
        assert_eq!(Lattice::new([400, 400], 4096).dims(), [57, 57]);
        assert_eq!(Lattice::new([3, 2], 100).pixels(), [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]);
    }
}
