//! Colour difference between two sets of colours.

use glam::DVec3;
use serde::Serialize;

use relume_colour::model::ErrorSummary;
use relume_colour::spectrum::colour::{Xyz, ciede2000, d65_white, lab_from_xyz};

/// Colour difference between two pictures over a set of pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Difference {
    /// Mean, p95 and maximum of ΔE00.
    #[serde(flatten)]
    pub delta_e: ErrorSummary,
    /// Pixel of the maximum, x and y from the top left.
    pub at: Option<[usize; 2]>,
    /// Largest difference of X, Y or Z; white is 1.
    pub xyz: f64,
}

/// ΔE00 of each pair of XYZ colours, with D65 as white. NaN counts as infinite.
pub(super) fn delta_e(actual: &[DVec3], expected: &[DVec3]) -> Vec<f64> {
    let lab = |colour: &DVec3| lab_from_xyz(Xyz(colour.to_array()), d65_white());
    let pairs = actual.iter().zip(expected);
    let found =
        pairs.map(|(actual, expected)| if actual == expected { 0.0 } else { ciede2000(lab(actual), lab(expected)) });
    found.map(|error| if error.is_nan() { f64::INFINITY } else { error }).collect()
}

impl Difference {
    /// Computes the difference of XYZ colours at `pixels`.
    pub(super) fn between(actual: &[DVec3], expected: &[DVec3], pixels: &[[usize; 2]]) -> Self {
        let errors = delta_e(actual, expected);
        let worst = errors.iter().enumerate().max_by(|one, two| one.1.total_cmp(two.1).then(two.0.cmp(&one.0)));
        let apart = actual.iter().zip(expected).map(|(a, e)| (*a - *e).abs().max_element());
        let apart = apart.map(|apart| if apart.is_nan() { f64::INFINITY } else { apart });
        Self {
            delta_e: ErrorSummary::of(&errors),
            at: worst.and_then(|(index, _)| pixels.get(index)).copied(),
            xyz: apart.fold(0.0, f64::max),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sharma, Wu and Dalal 2005, the first pair: ΔE00 2.0425.
    #[test]
    fn a_published_pair_has_its_published_difference_and_place() {
        let lab = |lab| {
            DVec3::from(
                relume_colour::spectrum::colour::xyz_from_lab(relume_colour::spectrum::colour::Lab(lab), d65_white()).0,
            )
        };
        let (one, two) = (lab([50.0, 2.6772, -79.7751]), lab([50.0, 0.0, -82.7485]));
        let found = Difference::between(&[one, one, one], &[one, two, one], &[[0, 0], [7, 3], [9, 9]]);
        assert!((found.delta_e.max - 2.0425).abs() <= 1e-4, "{found:?}");
        assert!((found.delta_e.mean - 2.0425 / 3.0).abs() <= 1e-4, "{found:?}");
        assert_eq!(found.at, Some([7, 3]));
        assert!((found.xyz - (one - two).abs().max_element()).abs() <= 1e-15, "{found:?}");
    }

    #[test]
    fn a_colour_that_is_none_is_infinitely_different() {
        let found = Difference::between(&[DVec3::NAN], &[DVec3::ONE], &[[1, 2]]);
        assert!(found.delta_e.mean >= f64::INFINITY && found.xyz >= f64::INFINITY, "{found:?}");
    }
}
