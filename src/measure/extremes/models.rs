//! Colour models of the smallest and largest dimensions.

use super::left::{Left, worst};
use super::slab::{GREEN, Picture, Slab};
use super::{Answer, Bound, Extreme, ExtremeError, Group, Rung};
use relume_colour::model::{Amplification, LARGEST_DIMENSION};
use relume_colour::spectrum::Spectrum;
use relume_document::SceneError;

pub(super) fn extremes() -> Vec<Extreme> {
    let mut all: Vec<Extreme> = [1, 2, 3, 16, LARGEST_DIMENSION].map(|k| followed("nodes", k)).into();
    all.extend([16, LARGEST_DIMENSION].map(|k| followed("bands", k)));
    all.push(followed("rgb", 3));
    for model in ["sharpened-semigroup", "sharpened"] {
        all.extend([6, LARGEST_DIMENSION].map(|k| followed(model, k)));
    }
    all.push(unclamped());
    all.push(all_bands());
    all.push(too_many());
    all
}

/// Absorption spectrum so narrow that some of its coefficients in sharpened models are negative and would amplify
/// light.
const NARROW: &str = "{ gaussian = [{ centre = 480, sigma = 6, height = 1 }] }";

fn slab(model: &str, k: usize) -> Slab {
    let shape = if model.starts_with("sharpened") { NARROW } else { GREEN };
    Slab { absorption: Some((shape, 0.5)), accuracy: format!("model = \"{model}\"\nk = {k}"), ..Slab::default() }
}

/// Coloured glass at dimension `k`: each coefficient follows its own closed form.
fn followed(model: &'static str, k: usize) -> Extreme {
    let slab = slab(model, k);
    let asked = slab.clone();
    let scene = move || Ok(vec![asked.picture()?]);
    Extreme::shown(Group::Models, format!("k = {k}, {model}"), Bound::picture(8.0), scene, move |lefts| {
        worst(lefts.iter().map(|left| match left.planned().plan.components() {
            // The model `sharpened` projects each step, so the general closed form does not apply.
            components if components == k && model == "sharpened" => by_step(&slab, left),
            components if components == k => slab.error(left).max(slab.picture_error(left)),
            _ => f64::NAN,
        }))
    })
}

/// Error of the transmittance of `slab` where each step's transmittance is projected and held in [0, 1].
fn by_step(slab: &Slab, left: &Left<'_>) -> f64 {
    let (Some(model), Some(material)) = (&left.planned().model, left.rungs.scene.materials.first()) else {
        return f64::NAN;
    };
    let Some((shape, (_, depth))) = material.absorption.as_ref().zip(slab.absorption) else { return f64::NAN };
    let absorbed = shape.spectrum().scaled(depth * slab.step);
    let step = &absorbed + &Spectrum::constant(-slab.step * (-slab.opacity).ln_1p());
    let depths = model.step_depths(&step, Amplification::Held);
    worst(
        depths.iter().enumerate().map(|(c, depth)| (left.transmittance(c, 0) - (-depth * slab.samples()).exp()).abs()),
    )
}

/// The documented exception: sharpened models amplify unless absorption coefficients are clamped at 0. No picture uses
/// them.
fn unclamped() -> Extreme {
    const DEPTH: f64 = 5.0;
    let ask = |_: Option<&_>, _: &dyn relume_base::progress::Progress| {
        let rungs = slab("sharpened-semigroup", 6).picture()?.rungs()?;
        let shape = rungs.scene.materials.first().and_then(|material| material.absorption.as_ref());
        let largest = rungs.planned.model.as_ref().zip(shape).map(|(model, shape)| {
            let parts = model.unclamped_absorption_coefficients(shape.spectrum());
            let transmittance = parts.iter().map(|part| (-DEPTH * part).exp()).fold(0.0, f64::max);
            // |Σ P·shape| ≤ Σ|P|, because a shape is at most 1.
            let row = |row: &Spectrum| row.samples().iter().map(|sample| sample.abs()).sum::<f64>();
            let most = (DEPTH * model.projection().iter().map(row).fold(0.0, f64::max)).exp();
            let told = model.amplification(shape.spectrum())?;
            Some((transmittance / most, format!("transmittance {transmittance:.3} at a depth of {DEPTH}: {told}")))
        });
        // Without amplification, the extreme tests nothing.
        let (measured, said) = largest.flatten().map_or((f64::NAN, None), |(measured, said)| (measured, Some(said)));
        Ok(vec![Answer { rung: Rung::Plan, measured, said }])
    };
    let bound = Bound::given(
        "amplification",
        1.0,
        "the only exception to T in [0, 1], used in reports only: the transmittance of an optical depth D is at most \
         e^(D·Σ|P|), and is measured relative to it",
    );
    Extreme { group: Group::Models, name: "sharpened, unclamped (the exception)".to_owned(), bound, ask: Box::new(ask) }
}

/// Every band of the wavelength grid: 21 lanes, also on a device.
fn all_bands() -> Extreme {
    let slab = slab("nodes", 4);
    let asked = slab.clone();
    let scene = move || Ok(vec![Picture { full_spectrum: true, ..asked.picture()? }]);
    Extreme::shown(Group::Models, "k = 81, all bands", Bound::picture(8.0), scene, move |lefts| {
        worst(lefts.iter().flat_map(|left| [slab.error(left), slab.picture_error(left)]))
    })
}

/// A dimension beyond the limit of a model.
fn too_many() -> Extreme {
    let k = LARGEST_DIMENSION + 1;
    let picture = move || slab("nodes", k).picture();
    Extreme::refused(Group::Models, format!("k = {k}"), picture, |error| {
        matches!(error, ExtremeError::Scene(SceneError::Invalid { message, .. })
            if message.contains(&LARGEST_DIMENSION.to_string()))
    })
}
