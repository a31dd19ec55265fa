//! Texels of whole numbers of at most two bytes, computed in whole numbers.

use std::ops::Range;

use relume_base::number::nearest;
use relume_volume::{Voxel, VoxelType};

/// Codes of texels as multiples of stored whole numbers: to these, the codes of normalised values round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct WholeCodes {
    /// Stored number of the lowest value, and its code.
    lowest: i32,
    lowest_code: i32,
    /// Codes per stored number; negative if its value falls.
    per_number: i32,
    /// Codes per difference of stored numbers, likewise.
    per_difference: i32,
}

impl WholeCodes {
    /// Those for stored numbers of `voxel_type` with values in `domain`: of the lowest, and per normalised unit of values and of
    /// differences. `None` unless all are such multiples.
    pub(super) fn of(
        voxel_type: VoxelType,
        [slope, intercept]: [f64; 2],
        [low, high]: [f64; 2],
        lowest_code: i32,
        codes: [f64; 2],
    ) -> Option<Self> {
        /// Error of a number that is whole.
        const WHOLE: f64 = 1e-6;
        /// Error of a code that rounds to the nearest one for certain.
        const CERTAIN: f64 = 0.1;
        /// Errors of the type f64 that a normalised value has, relative to the largest number on the way, and largest code.
        const ERRORS: f64 = 8.0 * f64::EPSILON * 65536.0;
        let is_small = matches!(voxel_type, VoxelType::U8 | VoxelType::I8 | VoxelType::U16 | VoxelType::I16);
        let largest = low.abs().max(high.abs()) + intercept.abs();
        if !is_small || slope == 0.0 || largest * ERRORS > CERTAIN * (high - low) {
            return None;
        }
        let whole = |number: f64| {
            let whole = nearest(number);
            ((f64::from(whole) - number).abs() <= WHOLE).then_some(whole)
        };
        let per_unit = slope / (high - low);
        let found = Self {
            lowest: whole((low - intercept) / slope)?,
            lowest_code,
            per_number: whole(codes[0] * per_unit)?,
            per_difference: whole(codes[1] * per_unit)?,
        };
        (found.per_number != 0).then_some(found)
    }

    /// Code of a stored number.
    fn code<T: Voxel>(self, number: T) -> i32 {
        // Sums of codes cannot overflow, and checks of them take most of the time.
        whole(number).wrapping_sub(self.lowest).wrapping_mul(self.per_number).wrapping_add(self.lowest_code)
    }

    /// Encodes numbers as texels without gradients.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "codes have 16 bits")]
    pub(super) fn values<T: Voxel>(self, line: &[T], out: &mut [u8]) {
        for (out, &number) in out.as_chunks_mut::<2>().0.iter_mut().zip(line) {
            *out = (self.code(number) as u16).to_ne_bytes();
        }
    }

    /// Encodes the `xs` of a line as texels with gradients. The `lines` are this one, and those before and behind it along y
    /// and along z, with the factors of their differences.
    #[expect(clippy::cast_possible_truncation, reason = "codes have 16 bits")]
    pub(super) fn gradients<T: Voxel>(
        self,
        [here, y0, y1, z0, z1]: [&[T]; 5],
        one_sided: [bool; 2],
        xs: Range<usize>,
        out: &mut [u8],
    ) {
        let factor = |one_sided: bool| if one_sided { 2 } else { 1 };
        let [y_factor, z_factor] = one_sided.map(factor);
        let difference = |before: T, after: T, factor: i32| {
            let codes = whole(after).wrapping_sub(whole(before)).wrapping_mul(self.per_difference);
            codes.wrapping_mul(factor) as i16
        };
        let texel = |[x0, x, x1]: [T; 3], x_factor: i32, [y0, y1, z0, z1]: [T; 4]| -> [u8; 8] {
            bytemuck::cast([
                difference(x0, x1, x_factor),
                difference(y0, y1, y_factor),
                difference(z0, z1, z_factor),
                self.code(x) as i16,
            ])
        };
        let nx = here.len();
        let out = out.as_chunks_mut::<8>().0;
        // One-sided differences at the faces.
        for x in [0, nx - 1].into_iter().filter(|x| xs.contains(x)) {
            let [x0, x1] = neighbours(x, nx);
            let factor = factor(x1 - x0 == 1);
            out[x - xs.start] = texel([here[x0], here[x], here[x1]], factor, [y0[x], y1[x], z0[x], z1[x]]);
        }
        let start = xs.start.max(1);
        let inner = start..xs.end.min(nx - 1).max(start);
        let out = out.get_mut(start - xs.start..).unwrap_or_default();
        let [y0, y1, z0, z1] = [y0, y1, z0, z1].map(|line| &line[inner.clone()]);
        let around = here[start - 1..(inner.end + 1).min(nx)].windows(3);
        for ((((out, x), (&y0, &y1)), &z0), &z1) in out.iter_mut().zip(around).zip(y0.iter().zip(y1)).zip(z0).zip(z1) {
            *out = texel([x[0], x[1], x[2]], 1, [y0, y1, z0, z1]);
        }
    }
}

/// Places of the neighbours of `i` among `n`: itself at the ends.
pub(super) fn neighbours(i: usize, n: usize) -> [usize; 2] {
    [i.saturating_sub(1), (i + 1).min(n - 1)]
}

/// A stored number, which is whole and has at most two bytes.
fn whole<T: Voxel>(number: T) -> i32 {
    number.to_whole().and_then(|whole| i32::try_from(whole).ok()).unwrap_or_default()
}
