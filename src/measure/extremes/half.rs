//! Film stored as 16-bit floats: the planner detects what they cannot hold.

use super::left::{Left, delta_e, worst};
use super::slab::{GREEN, Picture, Slab};
use super::spectra::{AMPLITUDES, black_slab, metameric_black};
use super::{Bound, Extreme, ExtremeError, Group};
use crate::rungs::RungError;
use relume_colour::spectrum::Reflectance;
use relume_scene::plan::PlanError;
use relume_scene::{Scene, StoreAs};

pub(super) fn extremes() -> Vec<Extreme> {
    let [surface, designed, largest] = AMPLITUDES;
    vec![
        underflow(),
        opaque(),
        largest_sum(),
        moved("a metameric black of amplitude 0.7", move || black_slab(surface)),
        moved("a metameric black of amplitude 4", move || black_slab(designed)),
        moved("a metameric black of amplitude 270, where ΔE00 100 is allowed", move || {
            let mut scene = black_slab(largest)?;
            scene.accuracy.tolerance = 100.0;
            Ok(scene)
        }),
        moved("a light of 1e3", || lit(1e3)),
        moved("an exposure of 1e3", || exposed(1e3)),
        cancels("a metameric black of amplitude 270", move || black_slab(largest)),
        cancels("a reflectance of -0.5", || Slab { reflectance: "-0.5", ..Slab::default() }.scene()),
        cancels("X-rays of negative reflectance", || shining("-0.01", 3e4)),
        cancels("a light of 1e6 on low opacity", || lit(1e6)),
        cancels("a light of 1e6, k = 8", || {
            let mut scene = Slab { absorption: Some((GREEN, 0.5)), ..k8() }.scene()?;
            scene.lights.iter_mut().for_each(|light| light.intensity = 1e6);
            Ok(scene)
        }),
        cancels("an exposure of 1e6", || exposed(1e6)),
        overflows("X-rays with a sum of 1e5", || shining("0.5", 1e5)),
        overflows("X-rays of reflectance 1e3 with a sum of 1e3", || {
            let mut scene = shining("1e3", 1e3)?;
            scene.accuracy = k8().scene()?.accuracy;
            Ok(scene)
        }),
        overflows("a reflectance of 1e6, k = 8", || {
            let mut scene = k8().scene()?;
            let black = Reflectance::new(metameric_black(1e6))?;
            scene.materials.iter_mut().for_each(|material| material.reflectance = black.clone());
            Ok(scene)
        }),
    ]
}

fn k8() -> Slab {
    Slab { accuracy: "accumulate = \"spectral\"\nk = 8".to_owned(), ..Slab::default() }
}

fn in_half(mut scene: Scene) -> Picture {
    scene.accuracy.storage = StoreAs::Half;
    Picture::of(scene)
}

/// A weight of 8e-8, between the first and the second positive 16-bit float.
fn underflow() -> Extreme {
    let slab = Slab { opacity: 1e-8, ..Slab::default() };
    let scene = move || Ok(vec![in_half(slab.scene()?)]);
    let bound = Bound::given(
        "denormal",
        1.01 * 0.5_f64.powi(25),
        "below 2⁻¹⁴, 16-bit floats have a spacing of 2⁻²⁴: an error of half of it, and a thousandth of that for the march",
    );
    Extreme::shown(Group::Half, "f16: opacity 1e-8", bound, scene, |lefts| {
        worst(lefts.iter().map(|left| (left.weight(0, 0) + (8.0 * (-1e-8_f64).ln_1p()).exp_m1()).abs()))
    })
}

/// Transmittance after 1e4 optical depths, which is 0 in 16 bits, too.
fn opaque() -> Extreme {
    let slab = Slab { absorption: Some((GREEN, 1e4 / 8.0)), ..k8() };
    let asked = slab.clone();
    let scene = move || Ok(vec![in_half(asked.scene()?)]);
    let bound = Bound::march(8.0).and(
        0.5_f64.powi(11),
        "16 bits",
        "the numbers of a pixel are rounded to 11 bits, a relative error of 2⁻¹¹; and the roundings of the march",
    );
    Extreme::shown(Group::Half, "f16: optical depth 1e4, coloured", bound, scene, move |lefts| {
        worst(lefts.iter().map(|left| {
            let dark = left.sums.transmittance.iter().all(|&left| left == 0.0);
            // Denormal numbers have larger relative errors, but are off by at most 2⁻²⁵.
            let [weights, _] = slab.closed_form(left, slab.length());
            let error = |(c, expected): (usize, &f64)| {
                let apart = (left.weight(c, 0) - expected).abs();
                if apart <= 1.01 * 0.5_f64.powi(25) { 0.0 } else { apart / expected.abs() }
            };
            if dark { worst(weights.iter().enumerate().map(error)) } else { f64::NAN }
        }))
    })
}

/// X-rays whose sum along the diagonal is just below the largest 16-bit float.
fn largest_sum() -> Extreme {
    let scene = || Ok(vec![in_half(shining("0.5", 6.5e4)?)]);
    let bound = Bound::march(8.0).and(
        0.5_f64.powi(11),
        "16 bits",
        "the sum is rounded to 11 bits; and the roundings of the march",
    );
    Extreme::shown(Group::Half, "f16: X-rays of several thousands", bound, scene, |lefts| {
        worst(lefts.iter().map(|left| (left.weight(0, 0) / shone(left) - 1.0).abs()))
    })
}

/// Sum of X-rays straight through a scene of [`shining`].
fn shone(left: &Left<'_>) -> f64 {
    let transfer = &left.rungs.scene.transfer;
    8.0 / transfer.opacity_length * std::f64::consts::LN_2
}

/// X-rays of opacity 0.5 in 9 × 9 × 9 voxels; the opacity length is so short that the diagonal adds up to `sum`.
fn shining(reflectance: &'static str, sum: f64) -> Result<Scene, ExtremeError> {
    let mut scene = Slab { dims: [9, 9, 9], opacity: 0.5, reflectance, ..Slab::default() }.scene()?;
    scene.materials.iter_mut().for_each(|material| material.occludes = 0.0);
    let diagonal = 243.0_f64.sqrt();
    scene.transfer.opacity_length = diagonal * std::f64::consts::LN_2 / sum;
    Ok(scene)
}

/// A slab that hides about a millionth of the light, under a light of `intensity`.
fn lit(intensity: f64) -> Result<Scene, ExtremeError> {
    let mut scene = Slab { opacity: 1e-7, ..Slab::default() }.scene()?;
    scene.lights.iter_mut().for_each(|light| light.intensity = intensity);
    Ok(scene)
}

/// The same slab at `exposure`.
fn exposed(exposure: f64) -> Result<Scene, ExtremeError> {
    let mut scene = lit(1.0)?;
    scene.display.exposure = Some(exposure);
    Ok(scene)
}

/// Error of the picture from 16-bit storage, as a fraction of the error that the plan predicts.
fn moved(name: &str, scene: impl Fn() -> Result<Scene, ExtremeError> + Send + Sync + 'static) -> Extreme {
    let both = move || {
        let scene = scene()?;
        Ok(vec![Picture::of(scene.clone()), in_half(scene)])
    };
    let bound = Bound::given(
        "as the plan says",
        1.0,
        "ΔE00 between the 32-bit and the 16-bit picture, as a share of the plan's limit: that of an error of 2⁻¹¹ of \
         every number, and 2⁻²⁵ of small ones, at the displayed brightness",
    );
    Extreme::shown(Group::Half, format!("f16: {name}"), bound, both, |lefts| match lefts {
        [full, half] => {
            let said = half.planned().half_precision_error(&half.rungs.scene).unwrap_or(f64::NAN);
            delta_e(full.xyz(0), half.xyz(0)) / said
        }
        _ => f64::NAN,
    })
}

/// The plan refuses 16 bits because the error would be visible.
fn cancels(name: &str, scene: impl Fn() -> Result<Scene, ExtremeError> + Send + Sync + 'static) -> Extreme {
    Extreme::refused(
        Group::Half,
        format!("f16: {name}"),
        move || Ok(in_half(scene()?)),
        |error| matches!(error, ExtremeError::Rung(RungError::Plan(PlanError::HalfPrecision { .. }))),
    )
}

/// The plan refuses 16 bits because a number may be too large.
fn overflows(name: &str, scene: impl Fn() -> Result<Scene, ExtremeError> + Send + Sync + 'static) -> Extreme {
    Extreme::refused(
        Group::Half,
        format!("f16: {name}"),
        move || Ok(in_half(scene()?)),
        |error| matches!(error, ExtremeError::Rung(RungError::Plan(PlanError::HalfRange))),
    )
}
