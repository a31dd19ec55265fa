//! Cost of each feature of a scene, measured on a scene with it and one without.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use serde::Serialize;

use relume::document::{SceneError, SceneOptions, parse};
use relume::measure::{RungError, Rungs, occupancy};
use relume::plan::{Accumulate, LightPlan, Planned, ScenePlan, ShadingTerms, Shares, Specular, Transmittance, plan};
use relume::progress::{Progress, Quiet};
use relume::reference::{End, Samples, Skipping, Step, march};
use relume::render::{RenderError, Renderer, SceneRenderer, shaders_of};
use relume::scene::{
    AccumulateAs, Direction, Gradients, Interpolation, LabelEntry, LabelInterpolation, Labels, Lookup, Placement,
    Scene, SceneLight, Shading, StoreAs, VolumeAs,
};
use relume::spectrum::{Absorption, Reflectance, Spectrum, SpectrumError};
use relume::volume::{VolumeError, phantom};

/// Pixels across and down of the pictures.
const SIZE: [usize; 2] = [40, 32];
/// Voxels along each side.
const SIDE: usize = 40;

/// A minimal scene: three materials under ambient light. There is no early ray termination, so that it does not affect
/// the comparison.
const LEAST: &str = r#"version = 1
shading = "none"
[volume]
phantom = "gaussian"
dims = [40, 40, 40]
[materials.shell]
reflectance = "foliage"
[materials.middle]
reflectance = "orange"
[materials.core]
reflectance = "blue sky"
[[transfer.intervals]]
material = "shell"
range = [0.3, 0.4]
ramp = 0.1
opacity = 0.05
[[transfer.intervals]]
material = "middle"
range = [0.45, 0.6]
ramp = 0.1
opacity = 0.1
[[transfer.intervals]]
material = "core"
range = [0.8, 1.1]
ramp = 0.1
opacity = 0.3
[lights.key]
spectrum = "D65"
kind = "ambient"
[camera]
azimuth = 35
elevation = 28
fill = 1.6
[accuracy]
termination = 0
"#;

/// A feature: scenes without and with it, and its change to the plan.
struct Need {
    name: &'static str,
    without: Box<dyn Fn(&mut Scene)>,
    with: Box<dyn Fn(&mut Scene)>,
    planned: Box<dyn Fn(&mut ScenePlan)>,
}

/// Counted costs of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub(crate) struct FrameCounts {
    /// Samples looked up along all rays.
    pub(crate) samples: u64,
    /// Dispatches of a march and a relight.
    pub(crate) dispatches: u64,
    /// Bytes of a finished pixel.
    pub(crate) pixel_bytes: u64,
    /// Bytes of the volume on the device.
    pub(crate) volume_bytes: u64,
    /// Bytes of the source of a table entry, which a sample reads twice.
    pub(crate) entry_bytes: u64,
    /// Bytes read and written by a relight.
    pub(crate) relight_bytes: u64,
    /// Instructions of the march shader.
    pub(crate) march_instructions: usize,
    /// Instructions of the relight shader.
    pub(crate) relight_instructions: usize,
}

impl FrameCounts {
    /// The counts with their names.
    pub(crate) fn named(&self) -> [(&'static str, u64); 8] {
        [
            ("samples", self.samples),
            ("dispatches", self.dispatches),
            ("bytes a pixel", self.pixel_bytes),
            ("bytes of the volume", self.volume_bytes),
            ("bytes of a table entry", self.entry_bytes),
            ("bytes of a relight", self.relight_bytes),
            ("instructions of the march", self.march_instructions as u64),
            ("instructions of the relight", self.relight_instructions as u64),
        ]
    }
}

/// A feature and its cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct NeedRow {
    /// The feature.
    pub(crate) name: &'static str,
    /// Costs without it.
    pub(crate) without: FrameCounts,
    /// Costs with it.
    pub(crate) with: FrameCounts,
    /// Whether the plans differ only in the feature's own change.
    pub(crate) differs_in_it_alone: bool,
    /// Names of the counts that are lower with the feature: it then trades one cost for another.
    pub(crate) saves: Vec<&'static str>,
    /// Largest difference in linear sRGB between two pictures of the scene without the feature: as planned, and with
    /// the fullest plan, in which every feature is on without effect.
    pub(crate) picture_difference: f64,
    /// Largest allowed difference.
    pub(crate) picture_limit: f64,
}

impl NeedRow {
    /// Whether the plan is as expected and the pictures agree.
    pub(crate) fn holds(&self) -> bool {
        self.differs_in_it_alone && self.picture_difference <= self.picture_limit
    }
}

/// Why the features could not be counted.
#[derive(Debug, thiserror::Error)]
pub(crate) enum NeedError {
    /// A scene could not be made.
    #[error("cannot make the scene of the feature {0:?}")]
    Scene(&'static str, #[source] SceneError),
    /// A volume could not be made.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A spectrum could not be made.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// A rung failed.
    #[error(transparent)]
    Rung(#[from] RungError),
    /// The device failed.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// Counts the samples taken from `inner`.
struct Counting<'a, S> {
    inner: S,
    taken: &'a AtomicU64,
}

impl<S: Samples<f64>> Samples<f64> for Counting<'_, S> {
    fn sample(&self, place: [f64; 3], step: &mut Step<f64>) {
        self.taken.fetch_add(1, Ordering::Relaxed);
        self.inner.sample(place, step);
    }

    fn normal(&self, place: [f64; 3]) -> [f64; 3] {
        self.inner.normal(place)
    }

    fn end(&self, place: [f64; 3]) -> End<f64> {
        self.taken.fetch_add(1, Ordering::Relaxed);
        self.inner.end(place)
    }

    fn mean(&self, ends: [&End<f64>; 2], middle: [f64; 3], density: &mut Step<f64>) -> f64 {
        self.inner.mean(ends, middle, density)
    }

    fn extinction(&self, place: [f64; 3], number: usize) -> f64 {
        self.inner.extinction(place, number)
    }

    fn stored_depth(&self, depth: f64) -> f64 {
        self.inner.stored_depth(depth)
    }
}

/// Tolerance between pictures that should be equal: the same sums in the same order, plus light of 1e-30.
const SAME: f64 = 1e-6;
/// The same for voxels in 16 bits. Next to a gradient, their values have 15 bits: an error of 2⁻¹⁶, which the steepest
/// ramp (opacity 0.3 over 0.1) turns into 4.6e-5 per step. A ray has about four steps in that ramp.
const SAME_IN_15_BITS: f64 = 2e-4;

fn light(scene: &mut Scene, name: &str, placement: Placement, intensity: f64) {
    if let Some(key) = scene.lights.first().cloned() {
        scene.lights.push(SceneLight { name: name.to_owned(), placement, intensity, ..key });
    }
}

fn as_it_is(_: &mut Scene) {}

/// Shades the scene with one directional light.
fn shaded(scene: &mut Scene) {
    scene.shading = Shading::Gradient;
    if let Some(key) = scene.lights.first_mut() {
        key.placement = Placement::Directional(DVec3::new(0.4, 0.6, 0.7).normalize());
    }
}

/// Adds highlights of one exponent.
fn shine(scene: &mut Scene) {
    for material in &mut scene.materials {
        (material.specular, material.exponent) = (0.3, 12);
    }
}

fn shining(scene: &mut Scene) {
    shaded(scene);
    shine(scene);
}

/// Accumulates coefficients of a colour model.
fn spectral(scene: &mut Scene) {
    scene.accuracy.accumulate = AccumulateAs::Spectral;
    scene.accuracy.dimension = Some(8);
}

fn shaded_spectral(scene: &mut Scene) {
    shaded(scene);
    spectral(scene);
}

/// Adds a label map with `label` in every voxel.
fn labelled(scene: &mut Scene, label: u8) {
    let entry = LabelEntry {
        label: 9,
        name: "labelled".to_owned(),
        material: 0,
        opacity: 0.5,
        absorption: 0.0,
        terms: Vec::new(),
    };
    // Phantoms of this size have been made before, so this succeeds.
    if let Ok(volume) = phantom::slab([SIDE; 3], label) {
        scene.labels = Some(Labels { volume: Arc::new(volume), declared: vec![entry] });
    }
}

fn behind(scene: &mut Scene, reflectance: f64) {
    scene.background = Reflectance::new(Spectrum::constant(reflectance)).ok();
}

const TWO_EXPONENTS: Specular = Specular { one_exponent: None, exponent_bits: 4 };
const ONE_EXPONENT: Specular = Specular { one_exponent: Some(12), exponent_bits: 4 };

/// A feature that changes the plan by `planned`.
fn need(
    name: &'static str,
    without: impl Fn(&mut Scene) + 'static,
    with: impl Fn(&mut Scene) + 'static,
    planned: impl Fn(&mut ScenePlan) + 'static,
) -> Need {
    Need { name, without: Box::new(without), with: Box::new(with), planned: Box::new(planned) }
}

/// A feature that changes an option from the first value to the second, in the scene and in the plan. `base` prepares
/// the scene.
fn choice<T: Copy + 'static>(
    name: &'static str,
    base: impl Fn(&mut Scene) + 'static,
    [without, with]: [T; 2],
    of_scene: fn(&mut Scene) -> &mut T,
    of_plan: fn(&mut ScenePlan) -> &mut T,
) -> Need {
    let before = move |scene: &mut Scene| {
        base(scene);
        *of_scene(scene) = without;
    };
    need(name, before, move |scene| *of_scene(scene) = with, move |plan| *of_plan(plan) = with)
}

fn needs() -> Vec<Need> {
    vec![
        need(
            "labels",
            |scene| scene.accuracy.labels = LabelInterpolation::Nearest,
            |scene| labelled(scene, 9),
            |plan| plan.labels = true,
        ),
        need(
            "smooth labels",
            |scene| {
                labelled(scene, 9);
                scene.accuracy.labels = LabelInterpolation::Nearest;
            },
            |scene| scene.accuracy.labels = LabelInterpolation::Smooth,
            |plan| plan.smooth_labels = true,
        ),
        need("a background", as_it_is, |scene| behind(scene, 0.5), |plan| plan.background = true),
        need(
            "two more materials",
            |scene| scene.accuracy.accumulate = AccumulateAs::Weights,
            |scene| {
                for number in 0..2 {
                    let mut material = scene.materials[0].clone();
                    material.name = format!("more {number}");
                    scene.materials.push(material);
                    let mut term = scene.transfer.terms[0].clone();
                    term.material.0.iter_mut().for_each(|(_, index)| *index = 3 + number);
                    scene.transfer.terms.push(term);
                }
            },
            |plan| plan.accumulate = Accumulate::Weights { materials: 5 },
        ),
        need("a directional light, shaded", as_it_is, shaded, |plan| {
            plan.shading = Some(ShadingTerms { diffuse: true, specular: None, one_sided: false });
            plan.light = LightPlan::open(&[Direction::Infinity]);
        }),
        need(
            "a second light position",
            shaded,
            |scene| light(scene, "second", Placement::Directional(DVec3::X), 1.0),
            |plan| plan.light = LightPlan::open(&[Direction::Infinity; 2]),
        ),
        need(
            "a point light",
            shaded,
            |scene| light(scene, "lamp", Placement::Point(DVec3::new(-50.0, 0.0, 0.0)), 1.0),
            |plan| plan.light = LightPlan::open(&[Direction::Infinity, Direction::Place]),
        ),
        need(
            "an ambient light in addition",
            shaded,
            |scene| light(scene, "sky", Placement::Ambient, 0.5),
            |plan| plan.light = LightPlan::open(&[Direction::Everywhere, Direction::Infinity]),
        ),
        need("highlights", shaded, shine, |plan| {
            plan.shading = Some(ShadingTerms { diffuse: true, specular: Some(ONE_EXPONENT), one_sided: false });
        }),
        need(
            "highlights of several exponents",
            shining,
            |scene| scene.materials[0].exponent = 9,
            |plan| plan.shading = Some(ShadingTerms { diffuse: true, specular: Some(TWO_EXPONENTS), one_sided: false }),
        ),
        need(
            "different shading coefficients",
            shaded_spectral,
            |scene| scene.materials[0].ambient = 0.7,
            |plan| {
                if let Accumulate::Spectral { shares, .. } = &mut plan.accumulate {
                    *shares = Shares::Own;
                }
            },
        ),
        need(
            "coloured absorption",
            spectral,
            |scene| {
                let dye = Spectrum::gaussian(480.0, 40.0, 1.0).and_then(Absorption::new).ok();
                scene.materials.iter_mut().for_each(|material| material.absorption.clone_from(&dye));
                for term in &mut scene.transfer.terms {
                    term.absorption = term.opacity.clone();
                }
            },
            |plan| plan.transmittance = Transmittance::Coloured,
        ),
        choice(
            "central gradients",
            shaded,
            [Gradients::Packed, Gradients::Central],
            |scene| &mut scene.accuracy.gradients,
            |plan| &mut plan.gradients,
        ),
        choice(
            "linear tables",
            as_it_is,
            [Lookup::Nearest, Lookup::Linear],
            |scene| &mut scene.transfer.lookup,
            |plan| &mut plan.lookup,
        ),
        choice(
            "exact linear interpolation",
            as_it_is,
            [Interpolation::Linear, Interpolation::ExactLinear],
            |scene| &mut scene.accuracy.interpolation,
            |plan| &mut plan.interpolation,
        ),
        choice(
            "cubic interpolation",
            as_it_is,
            [Interpolation::Linear, Interpolation::Cubic],
            |scene| &mut scene.accuracy.interpolation,
            |plan| &mut plan.interpolation,
        ),
        choice(
            "voxels in 32 bits",
            as_it_is,
            [VolumeAs::Short, VolumeAs::Single],
            |scene| &mut scene.accuracy.volume,
            |plan| &mut plan.volume,
        ),
        choice(
            "pixels in 32 bits",
            |scene| scene.accuracy.tolerance = 10.0,
            [StoreAs::Half, StoreAs::Single],
            |scene| &mut scene.accuracy.storage,
            |plan| &mut plan.storage,
        ),
        choice(
            "empty-space skipping",
            as_it_is,
            [false, true],
            |scene| &mut scene.accuracy.skipping,
            |plan| &mut plan.skipping,
        ),
        need(
            "no crop box",
            |scene| scene.crop = Some([DVec3::splat(10.0), DVec3::splat(30.0)]),
            |scene| scene.crop = None,
            |_| {},
        ),
    ]
}

/// Switches on every feature without effect: labels that are all 0, a background and highlights of 1e-30, and lights
/// of intensity 0 at all kinds of position. Switches empty-space skipping off.
fn to_no_effect(scene: &mut Scene) {
    if scene.labels.is_none() {
        labelled(scene, 0);
    }
    if scene.background.is_none() {
        behind(scene, 1e-30);
    }
    scene.shading = Shading::Gradient;
    scene.accuracy.skipping = false;
    for (name, placement) in [
        ("unlit everywhere", Placement::Ambient),
        ("unlit head", Placement::Headlight),
        ("unlit side", Placement::Directional(DVec3::new(0.1, -0.9, 0.2).normalize())),
        ("unlit point", Placement::Point(DVec3::new(0.0, -50.0, 0.0))),
    ] {
        light(scene, name, placement, 0.0);
    }
    for (material, exponent) in scene.materials.iter_mut().zip([3, 5, 70]) {
        if material.specular == 0.0 {
            (material.specular, material.exponent) = (1e-30, exponent);
        }
    }
}

/// Rungs of a scene and the counts of its frame.
struct Counted {
    rungs: Rungs,
    counts: FrameCounts,
}

/// Counts the cost of each feature in turn on the device of `renderer`.
///
/// # Errors
///
/// [`NeedError`].
pub(crate) fn need_rows(renderer: &Renderer, progress: &dyn Progress) -> Result<Vec<NeedRow>, NeedError> {
    let needs = needs();
    let total = needs.len() as u64;
    let mut rows = Vec::new();
    for (done, need) in needs.iter().enumerate() {
        progress.report(&format!("counting {}", need.name), done as u64, total);
        if progress.cancelled() {
            return Err(RenderError::Cancelled.into());
        }
        rows.push(row(renderer, need)?);
    }
    Ok(rows)
}

fn row(renderer: &Renderer, need: &Need) -> Result<NeedRow, NeedError> {
    let base = || {
        let file = parse("least", LEAST, Path::new(""), &SceneOptions::default(), &Quiet);
        file.map(|file| file.scene).map_err(|error| NeedError::Scene(need.name, error))
    };
    let mut scene = base()?;
    (need.without)(&mut scene);
    let without = counted(renderer, scene.clone())?;
    let mut full = scene.clone();
    (need.with)(&mut scene);
    let with = counted(renderer, scene)?;
    let mut expected = without.rungs.planned.plan.clone();
    (need.planned)(&mut expected);

    to_no_effect(&mut full);
    // Uses the same colour model, if any: the errors of another one are no cost of the feature.
    let mut planned = plan(&full, &Quiet).map_err(RungError::Plan)?;
    planned.model.clone_from(&without.rungs.planned.model);
    if matches!(planned.plan.accumulate, Accumulate::Spectral { .. }) {
        planned.plan.transmittance = Transmittance::Coloured;
    }
    let full = Rungs::planned(full, planned, SIZE)?;
    let (least, full) = (picture(renderer, &without.rungs)?, picture(renderer, &full)?);
    let differences = least.iter().flatten().zip(full.iter().flatten());
    let picture_difference = differences.map(|(one, two)| f64::from(one - two).abs()).fold(0.0, f64::max);
    let pairs = without.counts.named().into_iter().zip(with.counts.named());
    Ok(NeedRow {
        name: need.name,
        differs_in_it_alone: expected == with.rungs.planned.plan,
        saves: pairs.filter(|((_, without), (_, with))| with < without).map(|((name, _), _)| name).collect(),
        without: without.counts,
        with: with.counts,
        picture_difference,
        picture_limit: if without.rungs.planned.plan.volume == VolumeAs::Short { SAME_IN_15_BITS } else { SAME },
    })
}

fn counted(renderer: &Renderer, scene: Scene) -> Result<Counted, NeedError> {
    let rungs = Rungs::new(scene, SIZE)?;
    let Planned { plan, .. } = &rungs.planned;
    let taken = AtomicU64::new(0);
    let counting = Counting { inner: rungs.stored::<f64>(), taken: &taken };
    if plan.skipping {
        let occupancy = occupancy(&rungs.scene, &rungs.storage, rungs.labels.as_deref());
        let skipping = Skipping::new(counting, &occupancy, &rungs.scene, &rungs.planned);
        march(&rungs.scene, &rungs.planned, &skipping, SIZE, &Quiet).map_err(RungError::Reference)?;
    } else {
        march(&rungs.scene, &rungs.planned, &counting, SIZE, &Quiet).map_err(RungError::Reference)?;
    }
    let statistics = rungs.scene.volume().statistics()?;
    let (scene, planned) = (rungs.scene.clone(), rungs.planned.clone());
    let on_device = SceneRenderer::with_plan(renderer, scene, planned, statistics, &Quiet)?;
    let before = renderer.device().dispatches();
    let accumulators = on_device.march(SIZE, &Quiet)?;
    let relight = renderer.relight_display(&accumulators)?;
    relight.run(&rungs.matrices(&rungs.mix))?;
    let [(_, march_shader), (_, relight_shader), _] = shaders_of(plan).map_err(RenderError::Shader)?;
    let counts = FrameCounts {
        samples: taken.load(Ordering::Relaxed),
        dispatches: renderer.device().dispatches() - before,
        pixel_bytes: plan.pixel_bytes(),
        volume_bytes: on_device.uploaded().bytes(),
        entry_bytes: (plan.parts().lanes * size_of::<[f32; 4]>()) as u64,
        relight_bytes: relight.bytes(),
        march_instructions: march_shader.instructions(),
        relight_instructions: relight_shader.instructions(),
    };
    Ok(Counted { rungs, counts })
}

/// Linear RGB of every pixel, rendered on the device.
fn picture(renderer: &Renderer, rungs: &Rungs) -> Result<Vec<[f32; 3]>, NeedError> {
    let accumulators = rungs.render(renderer, &Quiet)?;
    let relight = renderer.relight_linear(&accumulators)?;
    relight.run(&rungs.matrices(&rungs.mix))?;
    let pixels: Vec<[f32; 4]> = relight.read()?;
    Ok(pixels.into_iter().map(|[red, green, blue, _]| [red, green, blue]).collect())
}
