//! What storing finished accumulators in 16-bit floats can do to colours (COLOUR.md B6).

use super::{PlanError, Planned, longest_way};
use crate::scene::{Scene, depth_from_opacity};
use crate::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz, xyz_of};

/// The most that a number is off by, relative to itself: half of the last of 11 bits. Numbers below 2⁻¹⁴ are off by 2⁻²⁵
/// at most, which no colour shows.
const ROUNDING: f64 = 1.0 / 2048.0;
/// The largest 16-bit float.
const LARGEST: f64 = 65504.0;

/// Refuses a plan of 16 bits whose error is over the tolerance.
pub(super) fn check(planned: &Planned, scene: &Scene) -> Result<(), PlanError> {
    let tolerance = scene.accuracy.tolerance;
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
    match &planned.model {
        _ if largest_sum(scene) > LARGEST => f64::INFINITY,
        Some(model) => model.half_precision_error(),
        None => of_weights(planned, scene),
    }
}

/// What X-ray materials, which hide nothing, can add up to along the longest way.
fn largest_sum(scene: &Scene) -> f64 {
    let is_xray = |material: usize| scene.materials.get(material).is_some_and(|material| material.xray);
    let terms = scene.transfer.terms.iter().filter(|term| term.material.0.iter().any(|point| is_xray(point.1)));
    let of_terms = terms.flat_map(|term| &term.opacity).map(|point| point.1);
    let labels = scene.labels.iter().flat_map(|labels| &labels.declared);
    let of_labels = labels.filter(|entry| is_xray(entry.material)).map(|entry| entry.opacity);
    of_terms.chain(of_labels).map(depth_from_opacity).sum::<f64>() * longest_way(scene)
}

/// The error of weights.
///
/// A weight w of a material of colour X is off by ROUNDING·w, and so each coordinate of the pixel by ROUNDING·Σ w·|X|. With
/// N = Σ w·|X| over the coordinates that are negative, that is ROUNDING times the pixel's own plus 2N. The first part is the
/// same share of every colour: it shows most in white, because differences count less the more colour there is, and
/// lightness, which counts more in mid greys, is a tenth of it. The second shows most in black; and because weights add up
/// to 1 at most, N is at most the most negative coordinate of a material.
fn of_weights(planned: &Planned, scene: &Scene) -> f64 {
    let white = d65_white().0;
    let under = scene.lights.iter().map(|light| {
        let materials = planned.materials.iter().filter_map(|&material| scene.materials.get(material));
        let colours = materials.map(|it| xyz_of(&(light.spectrum.spectrum() * it.reflectance.spectrum())).0);
        let negative =
            colours.fold([0.0_f64; 3], |most, colour| std::array::from_fn(|axis| most[axis].max(-colour[axis])));
        largest_difference(white, white) + largest_difference([0.0; 3], negative.map(|most| 2.0 * most))
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
