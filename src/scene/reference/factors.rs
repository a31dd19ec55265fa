//! Factors on the medium by the gradient magnitude and by the values of other fields, and opacities of parts of a step. Twin of `shaders/factors.wgsl` and
//! `shaders/thinning.wgsl`.

use crate::SHAPE_EDGE;
use crate::plan::{LANE, ScenePlan, Transmittance};
use crate::tables::FactorTable;
use relume_base::number::{Real, count, dot};
use smallvec::SmallVec;

/// The factors of the groups of terms where the first field has this `gradient`, and all have these `values`, as stored; none without
/// factors by other fields.
pub(super) fn factors_at<R: Real>(
    table: &FactorTable,
    plan: &ScenePlan,
    gradient: [R; 3],
    values: &[Option<R>],
) -> SmallVec<[R; 4]> {
    let number = |number: f32| R::from_f64(f64::from(number));
    let one = R::from_f64(1.0);
    let length = if plan.groups.by_gradient() { dot(gradient, gradient).sqrt() } else { R::default() };
    let height = |first: R, at: R, pieces: &[[f32; LANE]]| {
        pieces.iter().fold(first, |height, &[start, steepness, rise, _]| {
            let part = ((at - number(start)) * number(steepness)).max(R::default()).min(one);
            part.mul_add(number(rise), height)
        })
    };
    let (points, [most_fields, by_points]) = (plan.groups.points.max(1), plan.groups.by_fields);
    let of_group = |(group, vectors): (usize, &[[f32; LANE]])| {
        let (by_gradient, further) = vectors.split_at(points);
        let (by_fields, by_shape) = further.split_at(most_fields * by_points);
        let factor = match by_gradient {
            [first, pieces @ ..] if plan.groups.by_gradient() => height(number(first[0]), length, pieces),
            _ => one,
        };
        let factor = match by_shape {
            [across, up] if across[2] >= 0.0 => {
                let value = values.get(plan.groups.fields[group]).copied().flatten().unwrap_or_default();
                let second =
                    if up[2] < 0.0 { Some(length) } else { values.get(number(up[2]).index()).copied().flatten() };
                factor * shape_at(table, [across, up], value, second)
            }
            _ => factor,
        };
        by_fields.chunks(by_points.max(1)).fold(factor, |factor, vectors| match vectors {
            [[first, field, ..], pieces @ ..] => {
                let value = values.get(number(*field).index()).copied().flatten();
                factor * value.map_or(number(*first), |value| height(number(*first), value, pieces))
            }
            [] => factor,
        })
    };
    table.vectors.chunks(plan.groups.factor_vectors()).enumerate().map(of_group).collect()
}

/// The shape of a group at a value and a second number, the lowest one outside the box of another field.
fn shape_at<R: Real>(table: &FactorTable, [across, up]: [&[f32; LANE]; 2], value: R, second: Option<R>) -> R {
    let number = |number: f32| R::from_f64(f64::from(number));
    let last = R::from_f64(count(SHAPE_EDGE - 1));
    let cell = |[scale, offset, ..]: &[f32; LANE], at: R| {
        at.mul_add(number(*scale), number(*offset)).max(R::default()).min(last)
    };
    let x = cell(across, value);
    let y = second.map_or_else(R::default, |second| cell(up, second));
    let [column, row] = [x, y].map(|place| place.floor().index().min(SHAPE_EDGE - 2));
    let (right, above) = (x - R::from_f64(count(column)), y - R::from_f64(count(row)));
    let first = number(across[2]).index() * SHAPE_EDGE * SHAPE_EDGE;
    let height = |row: usize| {
        let at = first + row * SHAPE_EDGE + column;
        let here = number(table.shapes[at]);
        right.mul_add(number(table.shapes[at + 1]) - here, here)
    };
    let here = height(row);
    above.mul_add(height(row + 1) - here, here)
}

/// Index of the field of each group, and scale and offset from its value to a table coordinate.
pub(super) fn coordinates_of<'a, R: Real>(
    table: &'a FactorTable,
    plan: &ScenePlan,
) -> impl Iterator<Item = (usize, [R; 2])> + 'a {
    let number = |number: f32| R::from_f64(f64::from(number));
    let first = table.vectors.iter().step_by(plan.groups.factor_vectors());
    first.map(move |&[_, field, scale, offset]| (number(field).index(), [number(scale), number(offset)]))
}

/// Leaves the sum of the densities of groups of terms, whose sources and depths lie one behind the other, times their `factors`.
pub(super) fn sum_groups<R: Real>(densities: [&mut Vec<R>; 2], factors: &[R]) {
    for numbers in densities {
        let of_group = numbers.len() / factors.len();
        for (group, &factor) in factors.iter().enumerate() {
            for i in 0..of_group {
                let number = numbers[group * of_group + i];
                numbers[i] = if group == 0 { factor * number } else { factor.mul_add(number, numbers[i]) };
            }
        }
        numbers.truncate(of_group);
    }
}

/// Multiplies extinction and scattering of a step, given by its source and opacity, by `factor`: each opacity becomes
/// α·[`thinning`], and the source of its component is scaled alike. A matrix, whose power is no short formula, is multiplied by `factor` itself.
pub(super) fn thin<R: Real>([source, opacity]: [&mut [R]; 2], plan: &ScenePlan, factor: R) {
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
pub(super) fn thinning<R: Real>(opacity: R, factor: R) -> R {
    let zero = R::default();
    if factor <= zero {
        return zero;
    }
    if opacity > zero { -(factor * (-opacity).ln_1p()).exp_m1() / opacity } else { factor }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    /// Twin of `thinning` in `shaders/thinning.wgsl`, operation by operation.
    fn on_a_device(opacity: f32, factor: f32) -> f32 {
        let bits = (1.0 - opacity).to_bits() + 0x4a_fb0d;
        let exponent = f32::from(i16::try_from(bits >> 23).unwrap() - 127);
        let mantissa = f32::from_bits((bits & 0x7f_ffff) + 0x3f35_04f3);
        let part = if exponent == 0.0 { -opacity } else { mantissa - 1.0 };
        let z = part / (2.0 + part);
        let square = z * z;
        let series = square.mul_add(square.mul_add(square.mul_add(1.0 / 9.0, 1.0 / 7.0), 0.2), 1.0 / 3.0);
        let logarithm = (2.0 * z * square).mul_add(series, 2.0 * z);
        let depth = exponent.mul_add(-std::f32::consts::LN_2, -logarithm);
        let x = (factor * depth).clamp(-80.0, 80.0) * -std::f32::consts::LOG2_E;
        let (whole, f) = (x.round(), x - x.round());
        let series = [1.525_273_4e-5, 1.540_353e-4, 1.333_355_8e-3, 9.618_129e-3, 5.550_411e-2, 2.402_265e-1];
        let series =
            series.into_iter().chain([std::f32::consts::LN_2]).reduce(|sum, next| f.mul_add(sum, next)).unwrap();
        let scale = whole.exp2();
        (-scale).mul_add(f * series, 1.0 - scale) / opacity
    }

    #[test]
    fn a_device_thins_as_the_power_at_every_opacity_and_factor() {
        let mut worst = [0.0_f64; 2];
        for exponent in 0..=960 {
            let opacities = [10.0_f64.powf(-f64::from(exponent) / 32.0), -(-f64::from(exponent) / 64.0).exp_m1()];
            for opacity in opacities.map(|opacity| f64::from(relume_base::number::rounded(opacity))) {
                if opacity <= 1e-30 || opacity >= 1.0 {
                    continue;
                }
                for factor in [1e-6, 0.003, 0.1, 0.5, 0.9, 0.999].map(|it| f64::from(relume_base::number::rounded(it)))
                {
                    let exact = thinning(opacity, factor);
                    let single: f32 =
                        thinning(relume_base::number::rounded(opacity), relume_base::number::rounded(factor));
                    let device =
                        on_a_device(relume_base::number::rounded(opacity), relume_base::number::rounded(factor));
                    worst[0] = worst[0].max((f64::from(single) / exact - 1.0).abs());
                    worst[1] = worst[1].max((f64::from(device) / exact - 1.0).abs());
                }
            }
        }
        // Three functions within two roundings each, a product and a quotient.
        assert!(worst[0] <= 8.0 * 2.0_f64.powi(-24), "f32: {worst:?}");
        // Four of the logarithm's quotient and series, three times as many where it nearly cancels the exponent, and six of the power.
        assert!(worst[1] <= 18.0 * 2.0_f64.powi(-24), "device: {worst:?}");
    }

    #[test]
    fn a_factor_of_0_hides_and_opaque_steps_stay_opaque() {
        for opacity in [0.0, 0.3, 1.0] {
            assert!(thinning(opacity, 0.0_f64) == 0.0, "opacity {opacity}");
        }
        assert!((thinning(1.0_f64, 0.1) - 1.0).abs() == 0.0 && (thinning(1.0_f32, 0.1) - 1.0).abs() == 0.0);
        assert!((thinning(0.0_f32, 0.25) - 0.25).abs() == 0.0, "without loss the source follows the factor");
    }
}
