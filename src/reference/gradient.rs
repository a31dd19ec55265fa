//! Factor on the opacity by the gradient magnitude. Twin of `shaders/gradient_opacity.wgsl`.

use crate::number::{Real, count, dot};
use crate::plan::{LANE, ScenePlan, Transmittance};
use crate::tables::GradientTable;

/// Square roots before the series of [`thinning`].
const ROOTS: usize = 6;
/// Terms of the series of [`thinning`].
const TERMS: usize = 8;

/// Evaluates `table` at a decoded gradient.
pub(super) fn gradient_factor<R: Real>(table: &GradientTable, gradient: [R; 3]) -> R {
    let number = |number: f32| R::from_f64(f64::from(number));
    let length = dot(gradient, gradient).sqrt();
    let mut factor = table.0.first().map_or(R::from_f64(1.0), |vector| number(vector[0]));
    for &[start, steepness, rise, _] in table.0.iter().skip(1) {
        let part = ((length - number(start)) * number(steepness)).max(R::default()).min(R::from_f64(1.0));
        factor = part.mul_add(number(rise), factor);
    }
    factor
}

/// Multiplies extinction and scattering of a step, given by its source and opacity, by `factor`: each opacity becomes
/// α·[`thinning`], and the source of its component is scaled alike. `thinning(α, factor)` is called only for factors
/// below 1. A matrix, whose power is no short formula, is multiplied by `factor` itself.
pub(super) fn thin<R: Real>(
    [source, opacity]: [&mut [R]; 2],
    plan: &ScenePlan,
    factor: R,
    thinning: impl Fn(R, R) -> R,
) {
    if factor >= R::from_f64(1.0) {
        return;
    }
    if plan.transmittance == Transmittance::Mixed {
        source.iter_mut().chain(opacity).for_each(|number| *number = *number * factor);
        return;
    }
    let ratios: Vec<R> = opacity.iter().map(|&opacity| thinning(opacity, factor)).collect();
    let lanes = match plan.transmittance {
        Transmittance::Grey => 1,
        _ => plan.transmittance_lanes() * LANE,
    };
    for (i, number) in source.iter_mut().enumerate() {
        // Numbers of a lane beyond the components are 0.
        *number = *number * ratios.get(i % lanes).copied().unwrap_or_default();
    }
    for (opacity, ratio) in opacity.iter_mut().zip(ratios) {
        *opacity = *opacity * ratio;
    }
}

/// α'/α for α' = 1 − (1 − α)^f with f from 0 to below 1 (docs/theory/march.md); f if α is 0.
///
/// Six square roots turn 1 − α into 1 − β with a small β, whose power is a short series; six squares turn it back.
/// Neither form subtracts from 1 a number close to it, so thin media keep their digits.
pub(super) fn thinning<R: Real>(opacity: R, factor: R) -> R {
    let (zero, one, two) = (R::default(), R::from_f64(1.0), R::from_f64(2.0));
    if factor <= zero {
        return zero;
    }
    if opacity >= one {
        return one;
    }
    if opacity < R::from_f64(1e-30) {
        return factor;
    }
    let (mut part, mut left) = (opacity, one - opacity);
    for _ in 0..ROOTS {
        left = left.sqrt();
        part = part / (one + left);
    }
    let mut series = one;
    for term in (1..TERMS).rev() {
        let term = R::from_f64(count(term));
        series = (series * part).mul_add((term - factor) / (term + one), one);
    }
    let mut thin = factor * part * series;
    for _ in 0..ROOTS {
        thin = thin * (two - thin);
    }
    thin / opacity
}

/// [`thinning`] without a series.
pub(super) fn exact_thinning(opacity: f64, factor: f64) -> f64 {
    if factor <= 0.0 {
        return 0.0;
    }
    if opacity > 0.0 { -(factor * (-opacity).ln_1p()).exp_m1() / opacity } else { factor }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_series_agrees_with_the_power_at_every_opacity_and_factor() {
        let mut worst = [0.0_f64; 2];
        for exponent in 0..=240 {
            let opacities = [10.0_f64.powf(-f64::from(exponent) / 8.0), -(-f64::from(exponent) / 16.0).exp_m1()];
            for opacity in opacities.map(|opacity| f64::from(crate::number::rounded(opacity))) {
                for factor in [1e-6, 0.003, 0.1, 0.5, 0.9, 0.999] {
                    let exact = exact_thinning(opacity, factor);
                    let double = thinning(opacity, factor);
                    let single: f32 = thinning(crate::number::rounded(opacity), crate::number::rounded(factor));
                    worst[0] = worst[0].max((double / exact - 1.0).abs());
                    worst[1] = worst[1].max((f64::from(single) / exact - 1.0).abs());
                }
            }
        }
        // The ninth term at the largest opacity below 1 in f32, β = 0.23: 0.23^8/9.
        assert!(worst[0] <= 0.23_f64.powi(8) / 9.0, "the series is cut off: {worst:?}");
        // Three roundings per root, two per square, four per term, and some others.
        assert!(worst[1] <= 68.0 * 2.0_f64.powi(-24) + worst[0], "f32: {worst:?}");
    }

    #[test]
    fn a_factor_of_0_hides_and_opaque_steps_stay_opaque() {
        for opacity in [0.0, 0.3, 1.0] {
            assert!(thinning(opacity, 0.0_f64) == 0.0 && exact_thinning(opacity, 0.0) == 0.0, "opacity {opacity}");
        }
        assert!((thinning(1.0_f64, 0.1) - 1.0).abs() == 0.0 && (exact_thinning(1.0, 0.1) - 1.0).abs() == 0.0);
        assert!((thinning(0.0_f32, 0.25) - 0.25).abs() == 0.0, "without loss the source follows the factor");
    }
}
