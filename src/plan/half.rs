//! What storing finished accumulators in 16-bit floats can do to colours (docs/theory/numerics.md).

use super::{PlanError, Planned, Transmittance, longest_way};
use crate::scene::{Material, Scene, SceneLight, StoreAs, depth_from_opacity};
use crate::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz, xyz_of};

/// The most that a number is off by, relative to itself: half of the last of 11 bits.
const ROUNDING: f64 = 1.0 / 2048.0;
/// The most that a number below 2⁻¹⁴ is off by, which have fewer bits.
const LEAST: f64 = 1.0 / 33_554_432.0;
/// The largest 16-bit float.
const LARGEST: f64 = 65504.0;

/// Refuses a plan of 16 bits whose error is over the tolerance.
pub(super) fn check(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let tolerance = scene.accuracy.tolerance;
    if planned.plan.storage == StoreAs::Half && planned.plan.transmittance == Transmittance::Mixed {
        return Err(PlanError::HalfMatrix);
    }
    match planned.half_precision_error(scene) {
        None => Ok(()),
        Some(error) if error <= tolerance => Ok(()),
        Some(error) if error.is_finite() => {
            let kept = (error * 100.0).ceil() / 100.0;
            Err(PlanError::HalfPrecision { error, tolerance, kept })
        }
        Some(_) => Err(PlanError::HalfRange),
    }
}

/// [`Planned::half_precision_error`], whatever the plan.
pub(super) fn error(planned: &Planned, scene: &Scene) -> f64 {
    let sums = planned.materials.iter().filter_map(|&material| Some((scene.materials.get(material)?, material)));
    let (mut xrays, mut surface) = (0.0, 0.0_f64);
    for (material, index) in sums {
        let largest = largest_number(planned, material);
        if material.xray { xrays += largest * largest_sum(scene, index) } else { surface = surface.max(largest) }
    }
    if xrays + surface > LARGEST {
        return f64::INFINITY;
    }
    match &planned.model {
        Some(model) => {
            let brightest = scene.lights.iter().map(|light| brightness(scene, light)).fold(1.0, f64::max);
            model.half_precision_error(brightest, largest_total(scene))
        }
        None => of_weights(planned, scene),
    }
}

/// How bright what a light shines on is shown, beside a unit light: dimmer ones show no more than that.
fn brightness(scene: &Scene, light: &SceneLight) -> f64 {
    (light.intensity * scene.display.exposure).max(1.0)
}

/// The largest number that a pixel can hold of a material that it shows all of.
fn largest_number(planned: &Planned, material: &Material) -> f64 {
    let shares = if planned.plan.shading.is_some() { material.ambient + material.diffuse } else { 1.0 };
    let coefficients =
        planned.model.as_ref().map_or_else(|| vec![1.0], |model| model.coefficients(material.reflectance.spectrum()));
    coefficients.iter().fold(0.0_f64, |most, part| most.max(part.abs())) * shares + material.specular
}

/// What a material that hides nothing can add up to along the longest way.
fn largest_sum(scene: &Scene, material: usize) -> f64 {
    let terms = scene.transfer.terms.iter().filter(|term| term.material.0.iter().any(|point| point.1 == material));
    let of_terms = terms.map(|term| term.opacity.iter().map(|point| point.1).fold(0.0, f64::max));
    let labels = scene.labels.iter().flat_map(|labels| &labels.declared);
    let of_labels = labels.filter(|entry| entry.material == material).map(|entry| entry.opacity);
    of_terms.chain(of_labels).map(depth_from_opacity).sum::<f64>() * longest_way(scene)
}

/// What weights can add up to: 1, or what X-ray materials make of it.
fn largest_total(scene: &Scene) -> f64 {
    let xrays = (0..scene.materials.len()).filter(|&material| scene.materials[material].xray);
    xrays.map(|material| largest_sum(scene, material)).sum::<f64>().max(1.0)
}

/// The error of weights.
///
/// A weight w of a material of colour X is off by ROUNDING·w, and so each coordinate of the pixel by ROUNDING·Σ w·|X|. With
/// N = Σ w·|X| over the coordinates that are negative, that is ROUNDING times the pixel's own plus 2N. The first part is the
/// same share of every colour: it shows most in white, because differences count less the more colour there is, and
/// lightness, which counts more in mid greys, is a tenth of it. The second shows most in black; and because weights add up
/// to 1 at most, or to what X-rays add up to, N is at most that much of the most negative coordinate of a material, as
/// bright as it is shown. In black shows, too, what small weights are off by: LEAST each.
fn of_weights(planned: &Planned, scene: &Scene) -> f64 {
    let white = d65_white().0;
    let under = scene.lights.iter().map(|light| {
        let materials = planned.materials.iter().filter_map(|&material| scene.materials.get(material));
        let colours = materials.map(|it| xyz_of(&(light.spectrum.spectrum() * it.reflectance.spectrum())).0);
        let (mut negative, mut all) = ([0.0_f64; 3], [0.0_f64; 3]);
        for colour in colours {
            for axis in 0..3 {
                negative[axis] = negative[axis].max(-colour[axis]);
                all[axis] += colour[axis].abs();
            }
        }
        let (shown, total) = (brightness(scene, light), largest_total(scene));
        let dark = |axis: usize| shown * (2.0 * total * negative[axis] + LEAST / ROUNDING * all[axis]);
        largest_difference(white, white) + largest_difference([0.0; 3], std::array::from_fn(dark))
    });
    under.fold(0.0, f64::max)
}

/// ΔE00 from `colour` to the farthest of those off by ROUNDING times `size` along each axis.
fn largest_difference(colour: [f64; 3], size: [f64; 3]) -> f64 {
    let lab = |xyz| lab_from_xyz(Xyz(xyz), d65_white());
    let off = |corner: usize| {
        let side = |axis: usize| if corner >> axis & 1 == 0 { ROUNDING } else { -ROUNDING };
        ciede2000(lab(colour), lab(std::array::from_fn(|axis| colour[axis] + side(axis) * size[axis])))
    };
    (0..8).map(off).fold(0.0, f64::max)
}
