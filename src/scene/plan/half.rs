//! Colour errors of finished accumulators in 16-bit floats (docs/theory/numerics.md).

use super::{PlanError, Planned, Transmittance, longest_way};
use crate::{BRIGHTENED, Material, Scene, SceneLight, StoreAs, depth_from_opacity};
use relume_colour::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz, xyz_of};

/// Largest relative rounding error: half of the last of 11 bits.
const ROUNDING: f64 = 1.0 / 2048.0;
/// Largest absolute rounding error of numbers below 2⁻¹⁴, which have fewer bits.
const LEAST: f64 = 1.0 / 33_554_432.0;
/// The largest 16-bit float.
const LARGEST: f64 = 65504.0;

/// Refuses 16-bit storage with an error above the tolerance.
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

/// [`Planned::half_precision_error`] for any plan.
pub(super) fn error(planned: &Planned, scene: &Scene) -> f64 {
    let sums = planned.materials.iter().filter_map(|&material| Some((scene.materials.get(material)?, material)));
    let (mut xrays, mut surface) = (0.0, 0.0_f64);
    for (material, index) in sums {
        let largest = largest_number(planned, material);
        match most(material, scene, index) {
            Most::Sum(sum) => xrays += largest * sum,
            Most::Surface(gain) => surface = surface.max(gain * largest),
        }
    }
    if xrays + surface > LARGEST {
        return f64::INFINITY;
    }
    match &planned.model {
        Some(model) => {
            let brightest = scene.lights.iter().map(|light| brightness(scene, light)).fold(1.0, f64::max);
            model.half_precision_error(brightest, largest_total(planned, scene))
        }
        None => of_weights(planned, scene),
    }
}

/// Displayed brightness of a surface under the light, relative to a unit light; at least 1.
fn brightness(scene: &Scene, light: &SceneLight) -> f64 {
    (light.intensity * scene.display.exposure.unwrap_or(BRIGHTENED)).max(1.0)
}

/// Largest number in a pixel that shows only `material`.
fn largest_number(planned: &Planned, material: &Material) -> f64 {
    let most = planned.positions.iter().map(|position| position.placement.largest_shade()).fold(1.0, f64::max);
    let shares = if planned.plan.shading.is_some() {
        material.ambient + material.diffuse * most
    } else {
        largest_phase(planned, material)
    };
    let coefficients =
        planned.model.as_ref().map_or_else(|| vec![1.0], |model| model.coefficients(material.reflectance.spectrum()));
    let of_film = planned
        .model
        .iter()
        .zip(&material.film)
        .flat_map(|(model, film)| film.at_angles().iter().flat_map(|spectrum| model.coefficients(spectrum)));
    let largest = |numbers: &mut dyn Iterator<Item = f64>| numbers.fold(0.0_f64, |most, part| most.max(part.abs()));
    let (own, of_film) = (largest(&mut coefficients.into_iter()), largest(&mut of_film.into_iter()));
    // Highlights are white, or have the colours of a film.
    own.max(of_film) * shares + material.specular * most * of_film.max(1.0)
}

/// Largest value of the phase function of `material`, if the plan has phase functions: (1 − g²)/(1 − |g|)³.
fn largest_phase(planned: &Planned, material: &Material) -> f64 {
    let size = material.phase.abs();
    if planned.plan.phases > 0 { (1.0 + size) / (1.0 - size).powi(2) } else { 1.0 }
}

/// Largest weight of a material along a ray.
enum Most {
    /// By itself, which adds to all others.
    Sum(f64),
    /// As a surface, which hides what it adds to: one over the part of its scattering that occludes.
    Surface(f64),
}

/// The bound on the weight of the material of this index that is lower, but that of a surface where it hides all behind it.
fn most(material: &Material, scene: &Scene, index: usize) -> Most {
    let surface = 1.0 / material.occludes;
    if material.occludes >= 1.0 {
        return Most::Surface(1.0);
    }
    let sum = largest_sum(scene, index);
    if sum < surface { Most::Sum(sum) } else { Most::Surface(surface) }
}

/// Largest sum of a material that hides nothing along the longest path.
fn largest_sum(scene: &Scene, material: usize) -> f64 {
    let terms = scene.all_terms().filter(|term| term.material.0.iter().any(|point| point.1 == material));
    let of_terms = terms.map(|term| term.opacity.iter().map(|point| point.1).fold(0.0, f64::max));
    let of_labels =
        scene.declared().iter().filter(|it| it.terms.is_empty() && it.material == material).map(|it| it.opacity);
    of_terms.chain(of_labels).map(depth_from_opacity).sum::<f64>() * longest_way(scene)
}

/// Largest sum of weights: the largest surface, or the sum of the X-ray materials if that is larger, times the largest phase function.
fn largest_total(planned: &Planned, scene: &Scene) -> f64 {
    let (mut xrays, mut surface) = (0.0, 1.0_f64);
    for (index, material) in scene.materials.iter().enumerate() {
        match most(material, scene, index) {
            Most::Sum(sum) => xrays += sum,
            Most::Surface(gain) => surface = surface.max(gain),
        }
    }
    let used = planned.materials.iter().filter_map(|&material| scene.materials.get(material));
    let phase = used.map(|material| largest_phase(planned, material)).fold(1.0, f64::max);
    xrays.max(surface) * phase
}

/// Error of material weights.
///
/// A weight w of a material with colour X has an error of ROUNDING·w, so each coordinate of the pixel has an error of
/// ROUNDING·Σ w·|X|. With N = Σ w·|X| over the negative coordinates, that is ROUNDING times the sum of the pixel's own
/// coordinate and 2N. The first part is the same fraction of every colour. It is most visible in white, because
/// differences count less the more colour there is, and lightness, which counts more in mid greys, is a tenth of it.
/// The second part is most visible in black. Weights sum to at most 1, or to the sum of the X-ray materials; N is at
/// most this sum times the most negative coordinate of a material at its displayed brightness. The error of small
/// weights, LEAST each, is also visible in black.
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
        // Terms of a film are positive or negative. The negative ones count most at some angle, and a sum over angles has no more.
        for film in planned.thin_films(scene) {
            let terms = film.film.terms().spectra.iter().take(film.terms);
            let colours: Vec<[f64; 3]> = terms.map(|term| xyz_of(&(light.spectrum.spectrum() * term)).0).collect();
            for axis in 0..3 {
                let below_zero = |factors: &Vec<f64>| -> f64 {
                    factors.iter().zip(&colours).map(|(factor, colour)| (-factor * colour[axis]).max(0.0)).sum()
                };
                let most = film.film.terms().factors.iter().map(below_zero).fold(0.0, f64::max);
                negative[axis] = negative[axis].max(most);
                all[axis] += colours.iter().map(|colour| colour[axis].abs()).sum::<f64>();
            }
        }
        let (shown, total) = (brightness(scene, light), largest_total(planned, scene));
        let dark = |axis: usize| shown * (2.0 * total * negative[axis] + LEAST / ROUNDING * all[axis]);
        largest_difference(white, white) + largest_difference([0.0; 3], std::array::from_fn(dark))
    });
    under.fold(0.0, f64::max)
}

/// Largest ΔE00 between `colour` and the colours that differ by ROUNDING times `size` along each axis.
fn largest_difference(colour: [f64; 3], size: [f64; 3]) -> f64 {
    let lab = |xyz| lab_from_xyz(Xyz(xyz), d65_white());
    let off = |corner: usize| {
        let side = |axis: usize| if corner >> axis & 1 == 0 { ROUNDING } else { -ROUNDING };
        ciede2000(lab(colour), lab(std::array::from_fn(|axis| colour[axis] + side(axis) * size[axis])))
    };
    (0..8).map(off).fold(0.0, f64::max)
}
