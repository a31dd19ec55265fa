//! Colour differences between numbers of a film and their rounded ones, under many lights at a time.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;

use relume_base::number::rounded;
use relume_colour::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};

/// Pixels of a step of a comparison, for the vector units of a processor.
const LANES: usize = 16;

/// What a comparison found.
#[derive(Debug, PartialEq)]
pub(super) struct Compared {
    /// Largest ΔE00; inexact where there are pixels above the limit.
    pub(super) largest: f64,
    /// Pixels above the limit.
    pub(super) above: Vec<usize>,
}

/// Largest ΔE00 so far, of all cores.
pub(super) struct Largest(AtomicU64);

impl Largest {
    pub(super) fn new(known: f64) -> Self {
        Self(AtomicU64::new(known.to_bits()))
    }

    pub(super) fn read(&self) -> f64 {
        f64::from_bits(self.0.load(Ordering::Relaxed))
    }

    fn add(&self, found: f64) {
        // Numbers that are not negative order as their bits do.
        self.0.fetch_max(found.to_bits(), Ordering::Relaxed);
    }
}

/// Lights under which pixels are compared: for each, the planes that shine and their XYZ relative to the white of D65.
pub(super) struct Conditions(Vec<Vec<(usize, [f32; 3])>>);

impl Conditions {
    /// Conditions of the XYZ of each plane.
    pub(super) fn new(conditions: &[Vec<DVec3>]) -> Self {
        let white = DVec3::from(d65_white().0);
        let of = |planes: &Vec<DVec3>| {
            let shining = planes.iter().enumerate().filter(|(_, colour)| **colour != DVec3::ZERO);
            shining.map(|(plane, &colour)| (plane, (colour / white).to_array().map(rounded))).collect()
        };
        Self(conditions.iter().map(of).collect())
    }

    /// Pixels of `planes` whose ΔE00 to `values` under any condition is above `limit`, each of equal neighbours once. `largest` grows to the largest
    /// ΔE00; a pixel above the limit may count with less than its largest one.
    pub(super) fn above(&self, planes: &[&[f32]], values: &[Vec<f32>], limit: f64, largest: &Largest) -> Vec<usize> {
        let pixels = planes.first().map_or(0, |plane| plane.len());
        // Not one that equals the pixel before it, as beside a volume.
        let differs = |&pixel: &usize| {
            planes.iter().zip(values).any(|(plane, value)| plane[pixel].to_bits() != value[pixel].to_bits())
                && (pixel == 0 || planes.iter().any(|plane| plane[pixel].to_bits() != plane[pixel - 1].to_bits()))
        };
        let shown: Vec<usize> = (0..pixels).filter(differs).collect();
        // Contiguous numbers, filled up with zeros, which have no error.
        let numbers = |of: &dyn Fn(usize) -> f32| -> Vec<f32> {
            let filled = shown.len().next_multiple_of(LANES);
            shown.iter().map(|&pixel| of(pixel)).chain(std::iter::repeat(0.0)).take(filled).collect()
        };
        let pairs: Vec<[Vec<f32>; 2]> = (planes.iter().zip(values))
            .map(|(plane, value)| [numbers(&|at| plane[at]), numbers(&|at| value[at] - plane[at])])
            .collect();
        let is_empty: Vec<bool> = pairs.iter().map(|pair| pair.iter().flatten().all(|&number| number == 0.0)).collect();
        let mut is_above = vec![false; shown.len()];
        let mut used = Vec::new();
        for condition in &self.0 {
            used.clear();
            used.extend(
                condition.iter().filter(|(plane, _)| !is_empty[*plane]).map(|&(plane, xyz)| (&pairs[plane], xyz)),
            );
            for first in (0..shown.len()).step_by(LANES) {
                let sums = sums(&used, first);
                let bounds = bounds(&sums);
                let least = rounded(largest.read().min(limit));
                // NaN is above everything.
                if bounds.iter().all(|&bound| bound <= least) {
                    continue;
                }
                for lane in
                    (0..LANES.min(shown.len() - first)).filter(|&lane| bounds[lane].is_nan() || bounds[lane] > least)
                {
                    if is_above[first + lane] {
                        continue;
                    }
                    let found = exact(std::array::from_fn(|axis| sums[axis][lane]));
                    largest.add(found);
                    is_above[first + lane] = found > limit;
                }
            }
        }
        shown.iter().zip(is_above).filter(|(_, above)| *above).map(|(&pixel, _)| pixel).collect()
    }
}

/// XYZ of pixels relative to white, and their errors.
type Sums = [[f32; LANES]; 6];

/// Sums over planes, given as numbers, errors and XYZ, of the pixels from `first`.
fn sums(planes: &[(&[Vec<f32>; 2], [f32; 3])], first: usize) -> Sums {
    let mut sums = [[0.0; LANES]; 6];
    for (part, sums) in sums.chunks_exact_mut(3).enumerate() {
        let [mut x, mut y, mut z] = [[0.0; LANES]; 3];
        for (pair, colour) in planes {
            let Some(numbers) = pair[part][first..].first_chunk::<LANES>() else { continue };
            for lane in 0..LANES {
                x[lane] += colour[0] * numbers[lane];
                y[lane] += colour[1] * numbers[lane];
                z[lane] += colour[2] * numbers[lane];
            }
        }
        sums.copy_from_slice(&[x, y, z]);
    }
    sums
}

/// ΔE00 between the XYZ of a pixel relative to white, and the one with its error; NaN is infinite.
fn exact(sums: [f32; 6]) -> f64 {
    let white = d65_white().0;
    let [one, two] = [0.0, 1.0].map(|with| {
        let xyz = std::array::from_fn(|axis| white[axis] * (f64::from(sums[axis]) + with * f64::from(sums[3 + axis])));
        lab_from_xyz(Xyz(xyz), d65_white())
    });
    let found = ciede2000(one, two);
    if found.is_nan() { f64::INFINITY } else { found }
}

/// Upper bounds of the ΔE00 of pixels (docs/theory/page.md); NaN where nothing is known.
fn bounds(sums: &Sums) -> [f32; LANES] {
    let mut bounds = [0.0; LANES];
    for (lane, bound) in bounds.iter_mut().enumerate() {
        // Written out, so that the compiler uses vectors at every level of optimisation.
        let [x, y, z, dx, dy, dz] = sums;
        *bound = self::bound([x[lane], y[lane], z[lane], dx[lane], dy[lane], dz[lane]]);
    }
    bounds
}

/// Cube of the knee of CIELAB's cube root.
const KNEE_CUBED: f32 = 216.0 / 24_389.0;

/// Slope of CIELAB's cube root below its knee.
const STEEPEST: f32 = 841.0 / 108.0;

/// Largest relative error of [`cube_root`].
const OF_ROOT: f32 = 5e-5;

/// A cube root of a normal number, within [`OF_ROOT`]: a third of the exponent, and one step of Halley's method.
#[inline(always)]
fn cube_root(t: f32) -> f32 {
    let first = f32::from_bits(t.to_bits() / 3 + 0x2a51_37a0);
    let cubed = first * first * first;
    first * (cubed + 2.0 * t) / (2.0 * cubed + t)
}

/// CIELAB's cube root at `t`, and the middle and half the width of an interval that has its change to `t + d`.
#[inline(always)]
fn change(t: f32, d: f32) -> [f32; 3] {
    let other = t + d;
    let (one, two) = (cube_root(t.max(KNEE_CUBED)), cube_root(other.max(KNEE_CUBED)));
    // a³ − b³ = (a − b)(a² + ab + b²); the slope below the knee is that at the knee.
    let flattest = 1.0 / (one * one + one * two + two * two);
    let steepest = if t.min(other) < KNEE_CUBED { STEEPEST } else { flattest };
    let root = if t > KNEE_CUBED { one } else { STEEPEST * t + 4.0 / 29.0 };
    let middle = 0.5 * (steepest + flattest) * d;
    [root, middle, 0.5 * (steepest - flattest) * d.abs() + 2.0 * OF_ROOT * middle.abs()]
}

/// An upper bound of the ΔE00 of XYZ relative to white and their error.
#[expect(clippy::imprecise_flops, reason = "a root is within its allowance, and vectors have no hypot")]
#[inline(always)]
fn bound([x, y, z, dx, dy, dz]: [f32; 6]) -> f32 {
    let (fx, fy, fz) = (change(x, dx), change(y, dy), change(z, dz));
    let dl = 116.0 * (fy[1].abs() + fy[2]);
    let da = 500.0 * ((fx[1] - fy[1]).abs() + fx[2] + fy[2]);
    let db = 200.0 * ((fy[1] - fz[1]).abs() + fy[2] + fz[2]);
    // Errors of the roots themselves.
    let slack = 2.0 * OF_ROOT * 500.0 * (fx[0].abs() + fy[0].abs() + fz[0].abs());
    let (a, b) = (500.0 * (fx[0] - fy[0]), 200.0 * (fy[0] - fz[0]));
    let chroma = ((a * a + b * b).sqrt() - 0.5 * (da + db) - slack).max(0.0);
    // Weights of lightness and hue, from below; that of chroma is larger than that of hue.
    let from_middle = ((116.0 * fy[0] - 66.0).abs() - 0.5 * dl - slack).max(0.0);
    let square = from_middle * from_middle;
    let of_lightness = 1.0 + 0.015 * square / (20.0 + square).sqrt();
    let of_hue = 1.0 + 0.015 * 0.362 * chroma;
    // a* grows with the chroma that it has not; 25⁷ as f32, which is above it.
    let power = chroma * chroma * chroma * (chroma * chroma) * (chroma * chroma);
    let grown = 1.5 - 0.5 * (power / (power + 6_103_515_600.0)).sqrt();
    // Blue hues are turned.
    let turned = if b - db - slack > 0.0 { 1.0001 } else { 1.867 };
    let (l, a, b) = (dl / of_lightness, grown * da / of_hue, db / of_hue);
    (l * l + turned * (a * a + b * b)).sqrt() * 1.0005 + 2e-4
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from 0 to 1 in a fixed order (Steele et al. 2014).
    fn random(state: &mut u64) -> f32 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = *state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let bits = u16::try_from((mixed ^ (mixed >> 31)) >> 48).unwrap_or(0);
        f32::from(bits) / 65_536.0
    }

    #[test]
    fn the_cube_root_keeps_its_error() {
        let mut t = KNEE_CUBED;
        while t < 1e6 {
            let error = f64::from(cube_root(t)) / f64::from(t).cbrt() - 1.0;
            assert!(error.abs() <= f64::from(OF_ROOT), "{t}: {error}");
            t *= 1.0003;
        }
    }

    #[test]
    fn no_difference_is_above_its_bound_and_few_are_far_below() {
        const CASES: u32 = 200_000;
        let (mut state, mut near) = (28, 0_u32);
        for case in 0..CASES {
            // Dark to bright, grey to saturated, with errors from invisible to gross; at times near the knee, or negative.
            let level = 10_f32.powf(5.0 * random(&mut state) - 4.0);
            let spread = random(&mut state);
            let size = level * 10_f32.powf(-4.0 * random(&mut state));
            let colour: [f32; 3] = std::array::from_fn(|_| level * (1.0 - spread * random(&mut state)));
            let error: [f32; 3] = std::array::from_fn(|_| size * (random(&mut state) - 0.5));
            let sign = if case % 50 == 0 { -1.0 } else { 1.0 };
            let sums = [sign * colour[0], colour[1], colour[2], error[0], error[1], error[2]];
            let (found, bound) = (exact(sums), f64::from(bound(sums)));
            assert!(found <= bound, "{sums:?}: {found} above {bound}");
            near += u32::from(found >= bound / 3.0);
        }
        assert!(near > CASES / 2, "a bound that skips little: {near} of {CASES}");
    }
}
