//! Consistency checks: results must not depend on the step length, nor on whether a light was known at the march.

use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use relume::document::{SceneOptions, parse};
use relume::film::{Film, RelightMatrices};
use relume::plan::{Planned, plan, plan_for};
use relume::progress::Progress;
use relume::reference::{self, Stored};
use relume::scene::{Mix, Scene};
use relume::spectrum::colour::{XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::spectrum::standard;
use relume::tables::StoredScene;

use super::model::ModelTableError;

/// A homogeneous slab with coloured scattering and absorption, seen straight on.
const SLAB: &str = include_str!("slab.toml");
/// Glass in several colours under two lights, one of them with spectral lines.
const GLASS: &str = include_str!("../../data/scenes/glass_shells.toml");
/// Pixels across and down of the glass pictures.
const SIZE: [usize; 2] = [48, 48];

/// Effect of halving the step in a homogeneous coloured slab.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct HalvedStep {
    /// The step length; the slab is 64 thick.
    pub(crate) step: f64,
    /// Largest relative change of an accumulator or transmittance of the pixel, marched in f32.
    pub(crate) changed: f64,
}

/// Marches the slab on stored tables in f32, halving the step each time.
///
/// # Errors
///
/// [`ModelTableError`] when a march fails or `progress` asks to stop.
pub(crate) fn halved_steps(progress: &dyn Progress) -> Result<Vec<HalvedStep>, ModelTableError> {
    const STEPS: [f64; 5] = [4.0, 2.0, 1.0, 0.5, 0.25];
    let mut marches = Vec::new();
    for step in STEPS {
        let mut scene = parse("the slab", SLAB, Path::new(""), &SceneOptions::default(), progress)?.scene;
        scene.accuracy.step_length = step;
        let planned = plan(&scene, progress)?;
        let Film { accumulators, transmittance, .. } = march::<f32>(&scene, &planned, [1, 1], progress)?;
        marches.push((step, [accumulators, transmittance].concat()));
    }
    let changed = |pair: &[(f64, Vec<f32>)]| {
        let numbers = pair[0].1.iter().zip(&pair[1].1);
        let changes = numbers.map(|(&whole, &half)| ((f64::from(half) - f64::from(whole)) / f64::from(whole)).abs());
        HalvedStep { step: pair[0].0, changed: changes.fold(0.0, f64::max) }
    };
    Ok(marches.windows(2).map(changed).collect())
}

/// Errors under a light that was unknown at the march of the glass.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct RelitRow {
    /// Name of the light.
    pub(crate) light: String,
    /// Relit film against an f64 render with the same model: largest difference of an XYZ coordinate, divided by the
    /// allowed difference of 1e-5 of the coordinate plus 1e-6.
    pub(crate) rendered: f64,
    /// Relit film against an f64 render with a model planned for the light: largest ΔE00.
    pub(crate) replanned: f64,
    /// Largest ΔE00 for the light that each of the two models reports.
    pub(crate) reported: [f64; 2],
}

/// Relights an f32 film of the glass under lights that its plan did not know.
///
/// # Errors
///
/// [`ModelTableError`] when a march or a fit fails or `progress` asks to stop.
pub(crate) fn relit_against_rendered(progress: &dyn Progress) -> Result<Vec<RelitRow>, ModelTableError> {
    let scene = parse("glass", GLASS, Path::new(""), &SceneOptions::default(), progress)?.scene;
    let planned = plan(&scene, progress)?;
    let kept = march::<f32>(&scene, &planned, SIZE, progress)?;
    let exact = march::<f64>(&scene, &planned, SIZE, progress)?;
    let mut rows = Vec::new();
    for name in ["A", "FL2", "LED-B3", "LED-RGB1"] {
        let light = standard::light(name)?;
        let mut mix = Mix::of_scene(&scene);
        for shining in &mut mix.0 {
            (shining.name, shining.spectrum) = (name.to_owned(), light.clone());
        }
        let mut model = planned.model.as_deref().cloned();
        let mut reported = [0.0; 2];
        if let Some(model) = &mut model {
            model.learn(name, &light)?;
            reported[0] = model.matrix(&light).worst().max;
        }
        let learnt = Planned { model: model.map(Arc::new), ..planned.clone() };
        let relit = xyz(&scene, &learnt, &mix, &kept);
        let rendered = xyz(&scene, &learnt, &mix, &exact);
        let replan = plan_for(&scene, &[(name.to_owned(), light.clone())], progress)?;
        reported[1] = replan.model.as_ref().map_or(0.0, |model| model.matrix(&light).worst().max);
        let replanned = xyz(&scene, &replan, &mix, &march::<f64>(&scene, &replan, SIZE, progress)?);
        let share = |(relit, rendered): (&Xyz, &Xyz)| {
            let axes = relit.0.iter().zip(&rendered.0);
            axes.map(|(relit, rendered)| (relit - rendered).abs() / (1e-5 * rendered.abs() + 1e-6)).fold(0.0, f64::max)
        };
        let lab = |xyz: &Xyz| lab_from_xyz(*xyz, d65_white());
        rows.push(RelitRow {
            light: name.to_owned(),
            rendered: relit.iter().zip(&rendered).map(share).fold(0.0, f64::max),
            replanned: relit.iter().zip(&replanned).map(|(one, two)| ciede2000(lab(one), lab(two))).fold(0.0, f64::max),
            reported,
        });
    }
    Ok(rows)
}

/// Marches the stored volume and tables.
fn march<R: reference::Marching>(
    scene: &Scene,
    planned: &Planned,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Film<R>, ModelTableError> {
    let stored = StoredScene::new(scene, planned, &scene.volume().statistics()?)?;
    let samples = Stored::<R>::new(planned, &stored);
    Ok(reference::march(scene, planned, &samples, size, progress)?)
}

/// XYZ of every pixel under `mix`.
fn xyz<R: reference::Marching>(scene: &Scene, planned: &Planned, mix: &Mix, kept: &Film<R>) -> Vec<Xyz> {
    let matrices = RelightMatrices::of_scene(scene, planned, mix);
    let picture = kept.relight(&matrices);
    picture.into_iter().map(|colour| Xyz((*XYZ_FROM_LINEAR_SRGB * colour).to_array())).collect()
}
