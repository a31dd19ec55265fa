//! Models of what a scene holds: of so many coefficients, or of the fewest that keep a tolerance.

use std::ops::RangeInclusive;

use rayon::prelude::*;

use super::target::Target;
use super::{
    ChainClass, Cloud, ColourModel, Ingredients, LARGEST_AUTOMATIC_DIMENSION, LARGEST_DIMENSION, LightMatrix,
    ModelError, ModelKind, Samples, cloud, fixed, nodes, one_band, peercy, sharpened,
};
use crate::progress::Progress;
use crate::spectrum::observer::Observer;
use crate::spectrum::{Light, Spectrum, standard};

/// What models are fitted on: all that the renderer can make of a scene. It makes single reflections and rays.
const FIT: [(ChainClass, usize); 5] = [
    (ChainClass::GreyRays(24), 100),
    (ChainClass::Absorbed, 400),
    (ChainClass::ColouredRays(24), 150),
    (ChainClass::ShadedRays(24), 60),
    (ChainClass::Reflections, 120),
];

const FIT_SEED: u64 = 1;

/// What models are checked on. Most of it is behind absorbers, where a rare few of them can be far worse than all others.
const VALIDATION: [(ChainClass, usize); 4] = [
    (ChainClass::GreyRays(24), 200),
    (ChainClass::Absorbed, 800),
    (ChainClass::ColouredRays(24), 200),
    (ChainClass::ShadedRays(24), 400),
];

const VALIDATION_SEED: u64 = 2;

/// The model of `kind` with `dimension` coefficients for what is in `ingredients`.
///
/// It takes equal steps for equal input: equal models come out, also when materials or lights are given in another
/// order. Without lights it is fitted for D65. Whoever looks, it is planned for the observer of 1931.
///
/// # Errors
///
/// [`ModelError::Dimension`] unless 1 ≤ `dimension` ≤ 31, [`ModelError::NotThree`] for RGB of another dimension than
/// 3, [`ModelError::Sample`] and [`ModelError::NotFinite`] for spectra that cannot be computed with,
/// [`ModelError::Cancelled`] when `progress` says so.
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

/// The model of `kind` with the fewest coefficients whose worst ΔE00 keeps `tolerance`.
///
/// Kept means: over the cloud of the fit, and over the spectra not used in it that [`ColourModel::check_on`] finds.
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
    let way_out = match kind {
        ModelKind::Nodes => "; --reference renders all bands, slowly and without this error",
        _ => "; --model nodes may keep yours",
    };
    Err(ModelError::Tolerance {
        kind,
        tolerance,
        largest,
        dimension,
        reached,
        kept: (reached * 1000.0).ceil() / 1000.0,
        way_out: way_out.to_owned(),
    })
}

/// The model of [`fit_automatic`] if it has at most `largest` coefficients; `None` where so few do not keep `tolerance`.
///
/// # Errors
///
/// Those of [`fit_automatic`] but [`ModelError::Tolerance`].
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

/// Spectra that are not used in fits for `ingredients`: what [`ColourModel::check_on`] begins with.
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

/// The dimensions up to `largest` that a model of `kind` can have.
fn dimensions(kind: ModelKind, largest: usize) -> RangeInclusive<usize> {
    if kind.is_rgb() { 3..=largest.min(3) } else { 1..=largest }
}

/// The model of the first of `dimensions` that keeps `tolerance`, or the dimension that comes nearest.
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

/// The model of `kind` with `dimension` coefficients for the spectra of `cloud` under `lights`.
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

/// [`fit_cloud`], whose nodes are left as they are once an error above `hopeless` shows that there are too few.
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
    // What the fit is for, in an order that does not depend on the scene's.
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
