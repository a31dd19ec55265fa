//! Sums of light front to back, and the transmittance behind a step. Twin of `composite` in `shaders/march.wgsl` and of
//! `attenuate` in `shaders/grey.wgsl` and `shaders/coloured.wgsl`.

use relume_base::number::Real;

/// Adds one premultiplied sample front to back, `A += T·s`. T has one number for all components or one per component.
pub fn composite<R: Real>(accumulator: &mut [R], source: &[R], transmittance: &[R]) {
    let lefts = transmittance.iter().cycle();
    for ((sum, &part), left) in accumulator.iter_mut().zip(source).zip(lefts) {
        *sum = left.mul_add(part, *sum);
    }
}

/// The loss by rounding of the sums and the transmittance of a ray so far (Kahan 1965).
#[derive(Debug)]
pub(super) struct Lost<R> {
    pub(super) sums: Vec<R>,
    pub(super) transmittance: Vec<R>,
}

impl<R> Lost<R> {
    /// Of the sums of this position, which has `components`.
    pub(super) fn of_position(&mut self, position: usize, components: usize) -> &mut [R] {
        &mut self.sums[position * components..(position + 1) * components]
    }
}

/// `sum + term` as rounded; sets `lost` to what the sum has too much.
fn compensated<R: Real>(sum: R, term: R, lost: &mut R) -> R {
    let total = sum + term;
    *lost = (total - sum) - term;
    total
}

/// [`composite`], with what rounding has `lost`.
pub(super) fn composite_compensated<R: Real>(accumulator: &mut [R], lost: &mut [R], source: &[R], transmittance: &[R]) {
    let lefts = transmittance.iter().cycle();
    for (((sum, lost), &part), left) in accumulator.iter_mut().zip(lost).zip(source).zip(lefts) {
        *sum = compensated(*sum, left.mul_add(part, -*lost), lost);
    }
}

/// [`attenuate`] for every number, with what rounding has `lost`.
pub(super) fn attenuate_all<R: Real>(transmittance: &mut [R], opacity: &[R], lost: Option<&mut Lost<R>>) {
    let numbers = transmittance.iter_mut().zip(opacity);
    match lost {
        None => numbers.for_each(|(left, &opacity)| *left = attenuate(*left, opacity)),
        Some(lost) => {
            for ((left, &opacity), lost) in numbers.zip(&mut lost.transmittance) {
                *left = compensated(*left, (-*left).mul_add(opacity, -*lost), lost);
            }
        }
    }
}

/// Returns the transmittance after a step, `T − T·α`, rounded once (`T *= 1 − α` drifts over many equal steps:
/// docs/theory/march.md).
pub fn attenuate<R: Real>(transmittance: R, opacity: R) -> R {
    (-transmittance).mul_add(opacity, transmittance)
}

/// [`composite`] for a row-major matrix T: each component of the sample adds to each of the sum.
pub fn composite_matrix<R: Real>(accumulator: &mut [R], source: &[R], transmittance: &[R]) {
    for (sum, row) in accumulator.iter_mut().zip(transmittance.chunks_exact(source.len().max(1))) {
        for (&left, &part) in row.iter().zip(source) {
            *sum = left.mul_add(part, *sum);
        }
    }
}

/// [`attenuate`] for matrices with `dimension` rows, `T − T·A`.
pub fn attenuate_matrix<R: Real>(transmittance: &[R], opacity: &[R], dimension: usize) -> Vec<R> {
    let mut left = transmittance.to_vec();
    let rows = left.chunks_exact_mut(dimension.max(1)).zip(transmittance.chunks_exact(dimension.max(1)));
    for (row, before) in rows {
        for (&through, opacity) in before.iter().zip(opacity.chunks_exact(dimension.max(1))) {
            for (left, &opacity) in row.iter_mut().zip(opacity) {
                *left = (-through).mul_add(opacity, *left);
            }
        }
    }
    left
}
