//! Error bounds of the rungs and their derivations.

use super::Rung;

/// Largest relative error of one f32 rounding: half the distance from 1 to the next f32.
pub const ROUNDING_UNIT: f64 = 1.0 / 16_777_216.0;
/// Largest relative error of one f64 rounding.
const ROUNDING_UNIT_OF_TWO: f64 = f64::EPSILON / 2.0;

/// Bound for equal steps in f32 against their closed form, for any number of steps (docs/theory/acceptance.md C15).
pub const EQUAL_STEPS: f64 = 2e-5;
/// Bound for the opacity of one sample in f32, from a table in f64 (docs/theory/acceptance.md C14).
pub const OPACITY: f64 = 2e-6;
/// Bound for the linearity of light, relative to Σ|terms| (docs/theory/acceptance.md C12). The matrices are rounded
/// once. A pixel sums up to twenty products in f32, as do the pictures it is compared with. 2e-6 is the error of 34
/// roundings of one sign.
pub const LINEARITY: f64 = 2e-6;
/// Largest ΔE00 from early ray termination (docs/theory/acceptance.md C17).
pub const TERMINATION_DELTA_E: f64 = 0.1;
/// Largest ΔE00 of a metameric black from black after 500 samples (docs/theory/acceptance.md C18).
pub const BLACK_DELTA_E: f64 = 0.05;

/// Error bound: a number of roundings of the rung, plus a part that is the same on every rung.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// Name in tables.
    pub name: &'static str,
    /// Derivation.
    pub why: &'static str,
    roundings: f64,
    besides: f64,
}

impl Bound {
    /// No error.
    pub(super) const EXACT: Self = Self {
        name: "exact",
        why: "no rounding: the result is 0 or 1, or both sides compute the same numbers in the same order",
        roundings: 0.0,
        besides: 0.0,
    };

    /// Bound of a march of `samples` steps through one medium.
    pub(super) fn march(samples: f64) -> Self {
        Self {
            name: "march",
            why: "two roundings of T and one of the sum per sample, and eight of a term: its product, the table entry, the \
                  interpolation and the host's exponential; relative to a sum of one sign, and to 1 for T",
            roundings: 3.0 * samples + 8.0,
            besides: 0.0,
        }
    }

    /// Bound of a march of a large number of equal steps.
    pub(super) fn equal_steps(samples: f64) -> Self {
        Self {
            name: "equal steps",
            why: "one rounding of the fused T − T·α and one of the sum per step; their signs are practically random, so √n \
                  roundings remain, within the 2e-5 of docs/theory/acceptance.md C15 (T·(1 − α) would drift by about n)",
            roundings: samples.sqrt(),
            besides: 0.0,
        }
    }

    /// Bound of a march of any number of equal steps through an optical `depth`, whose sums are compensated.
    pub(super) fn compensated(depth: f64) -> Self {
        Self {
            name: "compensated steps",
            why: "compensated sums have two roundings, however many terms (Kahan 1965); sixteen of a term as for a march, and of \
                  the transmittance one by the depth, since each opacity is rounded",
            roundings: 18.0 + depth,
            besides: 0.0,
        }
    }

    /// Bound of a march of `samples` steps, relit.
    pub(super) fn picture(samples: f64) -> Self {
        Self {
            name: "picture",
            why: "the roundings of the march, and 34 of the relight: its matrix, and on both sides up to 20 products and \
                  their sum (docs/theory/acceptance.md C12); relative to Σ|terms|",
            roundings: Self::march(samples).roundings + LINEARITY / ROUNDING_UNIT,
            besides: 0.0,
        }
    }

    /// Bound of `limit` on every rung.
    pub(super) const fn given(name: &'static str, limit: f64, why: &'static str) -> Self {
        Self { name, why, roundings: 0.0, besides: limit }
    }

    /// Adds `besides` on every rung.
    pub(super) const fn and(self, besides: f64, name: &'static str, why: &'static str) -> Self {
        Self { name, why, roundings: self.roundings, besides: self.besides + besides }
    }

    /// Limit on a rung.
    #[must_use]
    pub fn limit(&self, rung: Rung) -> f64 {
        let unit = if rung == Rung::Double { ROUNDING_UNIT_OF_TWO } else { ROUNDING_UNIT };
        self.roundings.mul_add(unit, self.besides)
    }
}
