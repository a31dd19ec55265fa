//! Fits of colour models to a scene: with a given number of coefficients, or with the fewest that keep a tolerance.

use std::ops::RangeInclusive;

use rayon::prelude::*;

use super::target::Target;
use super::{
    ChainClass, Cloud, ColourModel, Ingredients, LARGEST_AUTOMATIC_DIMENSION, LARGEST_DIMENSION, LightMatrix,
    ModelError, ModelKind, Samples, cloud, fixed, nodes, one_band, peercy, sharpened,
};
use crate::spectrum::observer::Observer;
use crate::spectrum::{Light, Spectrum, standard};
use relume_base::progress::Progress;

/// Chains that models are fitted on: everything that the renderer can make of a scene, i.e. single reflections and
/// rays.
const FIT: [(ChainClass, usize); 6] = [
    (ChainClass::GreyRays(24), 100),
    (ChainClass::Absorbed, 400),
    (ChainClass::ColouredRays(24), 150),
    (ChainClass::ShadedRays(24), 60),
    (ChainClass::Reflections, 120),
    (ChainClass::Scattered, 300),
];

const FIT_SEED: u64 = 1;

/// Chains that models are checked on. Most are behind absorbers, where a rare few can be far worse than all others.
const VALIDATION: [(ChainClass, usize); 5] = [
    (ChainClass::GreyRays(24), 200),
    (ChainClass::Absorbed, 800),
    (ChainClass::ColouredRays(24), 200),
    (ChainClass::ShadedRays(24), 400),
    (ChainClass::Scattered, 600),
];

const VALIDATION_SEED: u64 = 2;

/// Fits a model of `kind` with `dimension` coefficients to `ingredients`.
///
/// The fit is deterministic: equal ingredients give equal models, also with the materials or lights in another order.
/// Without lights, the model is fitted for D65. The fit is always for the observer of 1931.
///
/// # Errors
///
/// [`ModelError::Dimension`] unless 1 ≤ `dimension` ≤ 31, [`ModelError::NotThree`] for RGB of another dimension than 3,
/// [`ModelError::Sample`] and [`ModelError::NotFinite`] for unusable spectra, [`ModelError::Cancelled`] when `progress`
/// cancels.
pub fn fit(
    ingredients: &Ingredients,
    kind: ModelKind,
    dimension: usize,
    progress: &dyn Progress,
) -> Result<ColourModel, ModelError> {
    let cloud = Cloud::new(ingredients, &FIT, FIT_SEED)?;
    let mut model = fit_cloud(&cloud, &ingredients.lights, kind, dimension, progress)?;
    model.refit(&cloud)?;
    Ok(model)
}

/// Fits the model of `kind` with the fewest coefficients whose worst ΔE00 keeps `tolerance`.
///
/// The tolerance holds over the cloud of the fit, and over the spectra not used in it that [`ColourModel::check_on`]
/// finds.
///
/// # Errors
///
/// [`ModelError::Tolerance`] when 16 coefficients do not keep it (or RGB's 3), [`ModelError::NotATolerance`] unless it
/// is above 0, and the errors of [`fit`].
pub fn fit_automatic(
    ingredients: &Ingredients,
    kind: ModelKind,
    tolerance: f64,
    progress: &dyn Progress,
) -> Result<ColourModel, ModelError> {
    check_tolerance(tolerance)?;
    let cloud = Cloud::new(ingredients, &FIT, FIT_SEED)?;
    let unseen = unseen(ingredients)?;
    let dimensions = dimensions(kind, LARGEST_AUTOMATIC_DIMENSION);
    let largest = *dimensions.end();
    let dimension = match least(&cloud, &unseen, &ingredients.lights, kind, tolerance, dimensions, progress)? {
        Ok(model) => return Ok(model),
        Err(nearest) => nearest,
    };
    let mut model = fit_targets(&cloud, &ingredients.lights, kind, dimension, f64::INFINITY, progress)?;
    model.refit(&cloud)?;
    model.check_on(&unseen)?;
    let reached = model.worst().max;
    Err(ModelError::Tolerance {
        kind,
        tolerance,
        largest,
        dimension,
        reached,
        kept: (reached * 1000.0).ceil() / 1000.0,
    })
}

/// Returns the model of [`fit_automatic`] if it has at most `largest` coefficients; `None` if these do not keep
/// `tolerance`.
///
/// # Errors
///
/// Those of [`fit_automatic`] except [`ModelError::Tolerance`].
pub fn fit_narrow(
    ingredients: &Ingredients,
    kind: ModelKind,
    tolerance: f64,
    largest: usize,
    progress: &dyn Progress,
) -> Result<Option<ColourModel>, ModelError> {
    check_tolerance(tolerance)?;
    let (cloud, unseen) = (Cloud::new(ingredients, &FIT, FIT_SEED)?, unseen(ingredients)?);
    let dimensions = dimensions(kind, largest.min(LARGEST_AUTOMATIC_DIMENSION));
    Ok(least(&cloud, &unseen, &ingredients.lights, kind, tolerance, dimensions, progress)?.ok())
}

/// Builds a cloud of spectra not used in fits for `ingredients`, the starting point of [`ColourModel::check_on`].
///
/// # Errors
///
/// [`ModelError::Sample`] and [`ModelError::NotFinite`].
pub fn unseen(ingredients: &Ingredients) -> Result<Cloud, ModelError> {
    Cloud::new(ingredients, &VALIDATION, VALIDATION_SEED)
}

fn check_tolerance(tolerance: f64) -> Result<(), ModelError> {
    if tolerance.is_nan() || tolerance <= 0.0 { Err(ModelError::NotATolerance { tolerance }) } else { Ok(()) }
}

/// Dimensions up to `largest` that a model of `kind` can have.
fn dimensions(kind: ModelKind, largest: usize) -> RangeInclusive<usize> {
    if kind.is_rgb() { 3..=largest.min(3) } else { 1..=largest }
}

/// Fits the model of the first of `dimensions` that keeps `tolerance`; otherwise returns the dimension with the
/// smallest error.
fn least(
    cloud: &Cloud,
    unseen: &Cloud,
    lights: &[(String, Light)],
    kind: ModelKind,
    tolerance: f64,
    dimensions: RangeInclusive<usize>,
    progress: &dyn Progress,
) -> Result<Result<ColourModel, usize>, ModelError> {
    let largest = *dimensions.end();
    let mut nearest = (f64::INFINITY, largest);
    for dimension in dimensions {
        let hopeless = if dimension == largest { f64::INFINITY } else { 2.0 * tolerance };
        let mut model = fit_targets(cloud, lights, kind, dimension, hopeless, progress)?;
        if model.worst().max <= tolerance {
            model.refit(cloud)?;
            model.check_on(unseen)?;
            if model.worst().max <= tolerance {
                return Ok(Ok(model));
            }
        }
        if model.worst().max < nearest.0 {
            nearest = (model.worst().max, dimension);
        }
    }
    Ok(Err(nearest.1))
}

/// Fits a model of `kind` with `dimension` coefficients to the spectra of `cloud` under `lights`.
///
/// # Errors
///
/// Those of [`fit`].
pub fn fit_cloud(
    cloud: &Cloud,
    lights: &[(String, Light)],
    kind: ModelKind,
    dimension: usize,
    progress: &dyn Progress,
) -> Result<ColourModel, ModelError> {
    fit_targets(cloud, lights, kind, dimension, f64::INFINITY, progress)
}

/// [`fit_cloud`] that stops optimising the nodes once an error above `hopeless` shows that they are too few.
fn fit_targets(
    cloud: &Cloud,
    lights: &[(String, Light)],
    kind: ModelKind,
    dimension: usize,
    hopeless: f64,
    progress: &dyn Progress,
) -> Result<ColourModel, ModelError> {
    if kind.is_rgb() && dimension != 3 {
        return Err(ModelError::NotThree { dimension });
    }
    if !(1..=LARGEST_DIMENSION).contains(&dimension) {
        return Err(ModelError::Dimension { dimension, largest: LARGEST_DIMENSION });
    }
    // Lights of the fit, in an order independent of the scene's.
    let mut wanted: Vec<&Light> = lights.iter().map(|(_, light)| light).collect();
    wanted.sort_by(|one, two| cloud::compare(one.spectrum(), two.spectrum()));
    wanted.dedup();
    wanted.retain(|light| light.spectrum().samples().iter().any(|&power| power != 0.0));
    if wanted.is_empty() {
        wanted.push(standard::d65());
    }
    let candidates = match kind {
        ModelKind::Nodes => {
            let observer = Observer::default();
            let targets: Vec<Target> =
                wanted.par_iter().map(|light| Target::new(&cloud.spectra, light, observer)).collect();
            let bands = nodes::select(&cloud.spectra, &targets, dimension, hopeless, progress)?;
            vec![bands.into_iter().map(one_band).collect()]
        }
        ModelKind::Sharpened(_) => vec![sharpened::projection(&cloud.spectra, &wanted, dimension)],
        ModelKind::Peercy => vec![peercy::projection(&cloud.spectra, dimension)],
        ModelKind::Bands => vec![fixed::bands(dimension)],
        ModelKind::Rgb => vec![fixed::rgb(), fixed::rgb_prefiltered()],
        ModelKind::RgbNaive => vec![fixed::rgb()],
        ModelKind::RgbPrefiltered | ModelKind::RgbFitted => vec![fixed::rgb_prefiltered()],
    };
    let models = candidates.into_iter().map(|projection: Vec<Spectrum>| {
        let mut model = ColourModel {
            kind,
            observer: Observer::default(),
            projection,
            cloud: cloud.spectra.clone(),
            vectors: Vec::new(),
            unseen: Samples::default(),
            mixed: cloud.mixed,
            lights: Vec::new(),
        };
        model.vectors = model.stored_vectors_of(cloud);
        let matrices: Vec<LightMatrix> = lights.par_iter().map(|(_, light)| model.fitted(light)).collect();
        let named = lights.iter().zip(matrices);
        model.lights = named.map(|((name, light), matrix)| (name.clone(), light.clone(), matrix)).collect();
        model
    });
    let mean = |model: &ColourModel| model.lights.iter().map(|(.., matrix)| matrix.error.mean).sum::<f64>();
    let model = models.reduce(|best, next| if mean(&next) < mean(&best) { next } else { best });
    progress.report("fitting the colour model", 1, 1);
    match model {
        _ if progress.cancelled() => Err(ModelError::Cancelled),
        Some(model) if model.is_finite() => Ok(model),
        _ => Err(ModelError::NotFinite),
    }
}
