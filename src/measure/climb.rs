//! Differences from rung to rung, and the order of the step's error.

use glam::DVec3;

use super::difference::{Difference, delta_e};
use super::ladder::Cause;

/// Differences from rung to rung, starting at the truth.
pub(super) struct Climb {
    pub(super) pixels: Vec<[usize; 2]>,
    pub(super) last: Vec<DVec3>,
    pub(super) causes: Vec<(Cause, Difference)>,
    /// ΔE00 of each pixel, per cause.
    moved: Vec<Vec<f64>>,
}

impl Climb {
    pub(super) fn from(last: Vec<DVec3>, pixels: Vec<[usize; 2]>) -> Self {
        Self { pixels, last, causes: Vec::new(), moved: Vec::new() }
    }

    pub(super) fn to(&mut self, cause: Cause, next: Vec<DVec3>) {
        self.causes.push((cause, Difference::between(&next, &self.last, &self.pixels)));
        self.moved.push(delta_e(&next, &self.last));
        self.last = next;
    }

    /// ΔE00 from rung to rung in `pixel`.
    pub(super) fn at(&self, pixel: [usize; 2]) -> Vec<(Cause, f64)> {
        let Some(index) = self.pixels.iter().position(|known| *known == pixel) else { return Vec::new() };
        let moved = self.moved.iter().filter_map(|moved| moved.get(index));
        self.causes.iter().map(|(cause, _)| *cause).zip(moved.copied()).collect()
    }
}

/// p in error ∝ Δsᵖ, from errors at Δs and Δs/2.
pub(super) fn order(at_step: &[f64], at_half: &[f64]) -> Option<f64> {
    let [whole, half] = [at_step, at_half].map(|errors| errors.iter().sum::<f64>());
    (whole > 0.0 && half > 0.0 && whole.is_finite() && half.is_finite()).then(|| (whole / half).log2())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_that_quarter_when_the_step_halves_are_of_second_order() {
        assert_eq!(order(&[4.0, 8.0], &[1.0, 2.0]), Some(2.0));
        assert_eq!(order(&[0.0], &[0.0]), None);
    }
}
