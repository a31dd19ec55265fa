//! Errors of colour models on spectra outside their fit.

use rayon::prelude::*;
use serde::Serialize;

use relume::document::SceneError;
use relume::measure::{NodesBesideRgb, Stopwatch, summary};
use relume::model::random::Random;
use relume::model::{
    Amplification, ChainClass, Cloud, ColourModel, ErrorSummary, Ingredients, LARGEST_DEPTH, ModelError, ModelKind,
    fit_automatic, fit_cloud,
};
use relume::plan::PlanError;
use relume::progress::Progress;
use relume::reference::ReferenceError;
use relume::spectrum::{Kind, Light, Spectrum, SpectrumError, standard};
use relume::volume::VolumeError;

/// Groups of lights: smooth, mixed, and with spectral lines.
pub(crate) const LIGHT_GROUPS: [(&str, &[&str]); 3] = [
    ("smooth", &["D65", "A", "E"]),
    ("mixed", &["D65", "A", "FL11", "LED-B3"]),
    ("spiky", &["FL2", "FL11", "LED-RGB1", "LED-B3"]),
];

/// Columns of the table: name, class of chains in the published tables, and number of chains.
const CLASSES: [(&str, ChainClass, usize); 5] = [
    ("a", ChainClass::Reflections, 1),
    ("b", ChainClass::Bounces, 200),
    ("c", ChainClass::SinglyAbsorbed, 300),
    ("d0", ChainClass::GreyRays(100), 60),
    ("d1", ChainClass::ColouredRays(100), 100),
];
/// Classes and numbers of the chains on which the models of the table are fitted.
const FITTED: [(ChainClass, usize); 4] = [
    (ChainClass::Bounces, 120),
    (ChainClass::SinglyAbsorbed, 300),
    (ChainClass::GreyRays(24), 60),
    (ChainClass::ColouredRays(24), 150),
];
/// Random seeds of this module; the fits use 1 and 2.
const FIT_SEED: u64 = 11;
const UNSEEN_SEED: u64 = 12;
const SCENES_SEED: u64 = 1000;

/// Why nothing could be measured.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ModelTableError {
    /// A model could not be fitted.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A standard spectrum is missing.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// A scene could not be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A volume could not be read.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// A scene could not be planned.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A march was stopped.
    #[error(transparent)]
    March(#[from] ReferenceError),
}

/// One setting of [`model_row`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct ModelSetting {
    /// The kind of model.
    pub(crate) kind: ModelKind,
    /// Index of the lights in [`LIGHT_GROUPS`]; larger indices select the last group.
    pub(crate) lights: usize,
    /// Number of `ColorChecker` patches that serve as a scene's materials.
    pub(crate) materials: usize,
    /// The dimension `k`.
    pub(crate) dimension: usize,
    /// Treatment of negative coefficients of absorption spectra.
    pub(crate) amplification: Amplification,
}

/// Errors of a model in one setting, over all scenes, lights and chains.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ModelRow {
    /// The kind of model.
    pub(crate) model: ModelKind,
    /// Whether negative coefficients of absorption spectra were kept.
    pub(crate) unclamped: bool,
    /// The group of lights.
    pub(crate) lights: &'static str,
    /// Materials per scene.
    pub(crate) materials: usize,
    /// The dimension.
    pub(crate) k: usize,
    /// Number of scenes.
    pub(crate) scenes: usize,
    /// ΔE00 over all classes.
    pub(crate) all: ErrorSummary,
    /// ΔE00 per class of chains: a one reflection, b two or three, c one behind an absorber of optical depth up to 20,
    /// d0 grey rays, d1 coloured rays.
    pub(crate) classes: Vec<(&'static str, ErrorSummary)>,
    /// Median time of a fit in ms, including the computation of the chains it is fitted on.
    pub(crate) fit_ms: f64,
    /// Median time of fitting a light that the model does not know, in ms.
    pub(crate) new_light_ms: f64,
}

/// Measures one setting on `scenes` scenes of `ColorChecker` patches, with absorption spectra derived from the
/// patches.
///
/// # Errors
///
/// [`ModelTableError::Model`] when a model cannot be fitted or `progress` asks to stop.
pub(crate) fn model_row(
    setting: ModelSetting,
    scenes: usize,
    progress: &dyn Progress,
) -> Result<ModelRow, ModelTableError> {
    let (group, names) = LIGHT_GROUPS[setting.lights.min(LIGHT_GROUPS.len() - 1)];
    let mut classes: Vec<(&'static str, Vec<f64>)> = CLASSES.iter().map(|&(name, ..)| (name, Vec::new())).collect();
    let (mut fits, mut lights) = (Vec::new(), Vec::new());
    let newcomer = standard::light("FL7")?;
    for scene in 0..scenes {
        let mut random = Random::new(SCENES_SEED + seed(scene));
        let ingredients = Ingredients {
            highlights: true,
            ..coloured(patches(setting.materials, &mut random)?, lights_called(names)?)
        };
        let watch = Stopwatch::start();
        let cloud = Cloud::new(&ingredients, &FITTED, FIT_SEED)?;
        let model = fit_cloud(&cloud, &ingredients.lights, setting.kind, setting.dimension, progress)?;
        fits.push(watch.read().wall_ms);
        let watch = Stopwatch::start();
        model.matrix(&newcomer);
        lights.push(watch.read().wall_ms);
        for (&(_, class, count), (_, errors)) in CLASSES.iter().zip(&mut classes) {
            let unseen = Cloud::new(&ingredients, &[(class, count)], UNSEEN_SEED)?;
            errors.extend(errors_under_all_lights(&model, &unseen, setting.amplification));
        }
    }
    let all: Vec<f64> = classes.iter().flat_map(|(_, errors)| errors).copied().collect();
    let median = |times: &[f64]| summary(times).map_or(f64::NAN, |summary| summary.median);
    Ok(ModelRow {
        model: setting.kind,
        unclamped: setting.amplification == Amplification::Kept,
        lights: group,
        materials: setting.materials,
        k: setting.dimension,
        scenes,
        all: ErrorSummary::of(&all),
        classes: classes.iter().map(|(name, errors)| (*name, ErrorSummary::of(errors))).collect(),
        fit_ms: median(&fits),
        new_light_ms: median(&lights),
    })
}

fn errors_under_all_lights(model: &ColourModel, cloud: &Cloud, amplification: Amplification) -> Vec<f64> {
    model.lights().par_iter().flat_map_iter(|(_, light, _)| model.errors(cloud, light, amplification)).collect()
}

/// Kind of reflectances in a scene of [`automatic_dimension`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum SpectraKind {
    /// Patches of the `ColorChecker`.
    Patches,
    /// Random steps from one reflectance to another, 5 to 50 nm wide.
    Sigmoids,
    /// Random Gaussians with σ from 10 to 80 nm on a dark ground.
    Gaussians,
}

/// An automatically chosen dimension and its measured error.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct AutomaticRow {
    /// Number of the scene.
    pub(crate) scene: usize,
    /// Kind of its reflectances.
    pub(crate) spectra: SpectraKind,
    /// Number of materials.
    pub(crate) materials: usize,
    /// Whether its materials absorb in colour, up to an optical depth of 20.
    pub(crate) coloured: bool,
    /// The group of its lights.
    pub(crate) lights: &'static str,
    /// The requested tolerance.
    pub(crate) tolerance: f64,
    /// The chosen dimension; `None` if the fit reported that no dimension keeps the tolerance.
    pub(crate) k: Option<usize>,
    /// Largest ΔE00 on spectra used neither in the fit nor in its validation, divided by the tolerance.
    pub(crate) worst_over_tolerance: f64,
    /// Time of the choice, in ms.
    pub(crate) fit_ms: f64,
}

/// Chooses the dimension of seeded scene number `scene` for a tolerance, and measures its error.
///
/// Scenes consist of patches, sigmoids and Gaussians in equal parts, with 2, 4 or 8 materials, grey or coloured, under
/// smooth or spiky lights. Any 36 consecutive scenes contain all cases.
///
/// # Errors
///
/// [`ModelTableError::Model`] when a model cannot be fitted or `progress` asks to stop.
pub(crate) fn automatic_dimension(
    scene: usize,
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<AutomaticRow, ModelTableError> {
    let mut random = Random::new(2 * SCENES_SEED + seed(scene));
    let spectra = [SpectraKind::Patches, SpectraKind::Sigmoids, SpectraKind::Gaussians][scene % 3];
    let materials = [2, 4, 8][(scene + scene / 6) % 3];
    let is_coloured = scene % 2 == 1;
    let (group, names) = LIGHT_GROUPS[2 * ((scene / 3 + scene / 18) % 2)];
    let reflectances = match spectra {
        SpectraKind::Patches => patches(materials, &mut random)?,
        SpectraKind::Sigmoids => (0..materials).map(|_| sigmoid(&mut random)).collect(),
        SpectraKind::Gaussians => (0..materials).map(|_| band(&mut random)).collect::<Result<_, _>>()?,
    };
    let mut ingredients = coloured(reflectances, lights_called(names)?);
    ingredients.highlights = true;
    if !is_coloured {
        ingredients.largest_depth = 0.0;
    }
    let watch = Stopwatch::start();
    let fitted = fit_automatic(&ingredients, ModelKind::Nodes, tolerance, progress);
    let fit_ms = watch.read().wall_ms;
    let (k, worst) = match fitted {
        Ok(model) => {
            let unseen =
                [(ChainClass::GreyRays(100), 300), (ChainClass::Absorbed, 600), (ChainClass::ColouredRays(100), 200)];
            let unseen = Cloud::new(&ingredients, &unseen, UNSEEN_SEED)?;
            let errors = errors_under_all_lights(&model, &unseen, Amplification::Held);
            (Some(model.dimension()), ErrorSummary::of(&errors).max / tolerance)
        }
        Err(ModelError::Tolerance { reached, .. }) => (None, reached / tolerance),
        Err(error) => return Err(error.into()),
    };
    Ok(AutomaticRow {
        scene,
        spectra,
        materials,
        coloured: is_coloured,
        lights: group,
        tolerance,
        k,
        worst_over_tolerance: worst,
        fit_ms,
    })
}

fn seed(scene: usize) -> u64 {
    u64::try_from(scene).unwrap_or(u64::MAX / 2)
}

fn lights_called(names: &[&str]) -> Result<Vec<(String, Light)>, SpectrumError> {
    names.iter().map(|&name| Ok((name.to_owned(), standard::light(name)?))).collect()
}

/// Materials that absorb the light they do not reflect: −ln of the reflectance, clamped to 0.02 to 0.995, scaled to a
/// peak of 1.
fn coloured(reflectances: Vec<Spectrum>, lights: Vec<(String, Light)>) -> Ingredients {
    let absorption = |reflectance: &Spectrum| {
        let depths = Spectrum::from_samples(reflectance.samples().map(|share| -share.clamp(0.02, 0.995).ln()));
        let peak = depths.samples().iter().copied().fold(0.0, f64::max);
        depths.scaled(1.0 / peak)
    };
    let absorptions = reflectances.iter().map(absorption).collect();
    Ingredients { reflectances, absorptions, lights, largest_depth: LARGEST_DEPTH, ..Ingredients::default() }
}

/// Draws `number` different patches, or all if there are fewer.
fn patches(number: usize, random: &mut Random) -> Result<Vec<Spectrum>, SpectrumError> {
    let mut left: Vec<&str> = standard::names(Kind::Reflectance).to_vec();
    let number = number.min(left.len());
    let drawn = (0..number).map(|_| left.swap_remove(random.index(left.len())));
    drawn.map(|name| Ok(standard::reflectance(name)?.spectrum().clone())).collect()
}

fn sigmoid(random: &mut Random) -> Spectrum {
    let (low, high) = (random.between(0.02, 0.3), random.between(0.4, 0.95));
    let (centre, width) = (random.between(430.0, 670.0), random.between(5.0, 50.0));
    let rises = if random.unit() < 0.5 { 1.0 } else { -1.0 };
    Spectrum::from_fn(|nm| low + (high - low) / (1.0 + (rises * (centre - nm) / width).exp()))
}

fn band(random: &mut Random) -> Result<Spectrum, SpectrumError> {
    let (ground, height) = (random.between(0.02, 0.2), random.between(0.3, 0.75));
    let band = Spectrum::gaussian(random.between(430.0, 670.0), random.between(10.0, 80.0), height)?;
    Ok(&band + &Spectrum::constant(ground))
}

/// Results of automatic dimensions over many scenes.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct AutomaticSummary {
    /// The requested tolerance.
    pub(crate) tolerance: f64,
    /// Scenes for which a dimension was found.
    pub(crate) found: usize,
    /// Scenes for which the fit reported that no dimension keeps the tolerance.
    pub(crate) refused: usize,
    /// Fraction of the found dimensions that keep the tolerance.
    pub(crate) kept: f64,
    /// Worst error of the found dimensions, divided by the tolerance.
    pub(crate) worst_over_tolerance: f64,
    /// Median of the found dimensions.
    pub(crate) median_k: f64,
    /// Largest of the found dimensions.
    pub(crate) largest_k: usize,
}

impl AutomaticSummary {
    /// Summarises `rows`, which share one tolerance.
    pub(crate) fn of<'a>(rows: impl IntoIterator<Item = &'a AutomaticRow>) -> Self {
        let rows: Vec<&AutomaticRow> = rows.into_iter().collect();
        let found: Vec<(usize, f64)> =
            rows.iter().filter_map(|row| row.k.map(|k| (k, row.worst_over_tolerance))).collect();
        let kept = found.iter().filter(|(_, worst)| *worst <= 1.0).count();
        let dimensions: Vec<f64> = found.iter().map(|&(k, _)| count(k)).collect();
        Self {
            tolerance: rows.first().map_or(f64::NAN, |row| row.tolerance),
            found: found.len(),
            refused: rows.len() - found.len(),
            kept: if found.is_empty() { 1.0 } else { count(kept) / count(found.len()) },
            worst_over_tolerance: found.iter().map(|&(_, worst)| worst).fold(0.0, f64::max),
            median_k: summary(&dimensions).map_or(f64::NAN, |summary| summary.median),
            largest_k: found.iter().map(|&(k, _)| k).max().unwrap_or(0),
        }
    }
}

/// Compares eight nodes with the best kind of RGB by mean ΔE00 over all spectra, for equal numbers of materials; `None`
/// unless both are in `rows`.
pub(crate) fn nodes_beside_rgb<'a>(rows: impl Iterator<Item = &'a ModelRow> + Clone) -> Option<NodesBesideRgb> {
    let rgb = rows.clone().filter(|row| row.model.is_rgb());
    let materials = rgb.clone().next()?.materials;
    let mut rows = rows.filter(|row| row.materials == materials);
    let nodes = rows.find(|row| row.model == ModelKind::Nodes && row.k == 8)?.all.mean;
    NodesBesideRgb::found(nodes, rgb.map(|row| (row.model, row.all.mean)).collect())
}

/// A count of scenes or dimensions; exact below 2⁵³.
#[expect(clippy::cast_precision_loss, reason = "counts are far below 2⁵³")]
fn count(n: usize) -> f64 {
    n as f64
}
