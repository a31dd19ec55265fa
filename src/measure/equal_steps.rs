//! Steps of equal visible change along a path of lights.

use glam::DVec3;

use super::difference::delta_e;
use relume_base::number::count;
use relume_colour::spectrum::colour::{LinearSrgb, xyz_from_linear_srgb};

/// Positions along a path, from 0 to 1, between which pictures differ by equal mean ΔE00.
///
/// `pictures` are linear sRGB at evenly spaced positions from 0 to 1, both included. An open path has its first and last
/// of `steps` positions at its ends; a closed path ends one step before 1. A path without any change is divided evenly.
#[must_use]
pub fn equal_steps(pictures: impl IntoIterator<Item = Vec<DVec3>>, steps: usize, closed: bool) -> Vec<f64> {
    let shown = |picture: Vec<DVec3>| -> Vec<DVec3> {
        let screen = |colour: DVec3| colour.clamp(DVec3::ZERO, DVec3::ONE).to_array();
        picture.into_iter().map(|colour| DVec3::from(xyz_from_linear_srgb(LinearSrgb(screen(colour))).0)).collect()
    };
    let mut travelled = vec![0.0];
    let mut pictures = pictures.into_iter().map(shown);
    let mut before = pictures.next().unwrap_or_default();
    for picture in pictures {
        let change: f64 = delta_e(&picture, &before).iter().sum();
        travelled.push(travelled.last().copied().unwrap_or_default() + change / count(picture.len().max(1)));
        before = picture;
    }
    let legs = count(travelled.len() - 1).max(1.0);
    let whole = travelled.last().copied().unwrap_or_default();
    let of = count(if closed { steps } else { steps.saturating_sub(1) }.max(1));
    let position = |step: usize| {
        let part = count(step) / of;
        if !(whole > 0.0 && whole.is_finite()) {
            return part;
        }
        // The last step ends at 1 exactly.
        let wanted = part * whole;
        let leg = travelled.partition_point(|&there| there <= wanted).clamp(1, travelled.len() - 1);
        let (from, to) = (travelled[leg - 1], travelled[leg]);
        let within = if to > from { ((wanted - from) / (to - from)).min(1.0) } else { 1.0 };
        (count(leg - 1) + within) / legs
    };
    (0..steps).map(position).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pictures of one pixel with lightness `at(0)`, `at(0.1)` … `at(1)`.
    fn greys(at: impl Fn(f64) -> f64) -> Vec<Vec<DVec3>> {
        use relume_colour::spectrum::colour::{Lab, Xyz, d65_white, linear_srgb_from_xyz, xyz_from_lab};
        let grey = |lightness: f64| {
            let Xyz(xyz) = xyz_from_lab(Lab([lightness, 0.0, 0.0]), d65_white());
            DVec3::from(linear_srgb_from_xyz(Xyz(xyz)).0)
        };
        (0..=10).map(|tenth| vec![grey(at(f64::from(tenth) / 10.0))]).collect()
    }

    #[test]
    fn a_path_whose_second_half_alone_changes_has_its_steps_there() {
        let positions = equal_steps(greys(|at| 50.0 + (at - 0.5).max(0.0)), 3, false);
        // ΔE00 of neighbouring greys near L* = 50 is their difference in lightness.
        assert!((0.0..=0.5).contains(&positions[0]), "{positions:?}");
        assert!((positions[1] - 0.75).abs() <= 0.01 && (positions[2] - 1.0).abs() <= 1e-12, "{positions:?}");
    }

    #[test]
    fn a_path_without_change_is_divided_evenly_and_a_closed_one_ends_a_step_early() {
        assert_eq!(equal_steps(greys(|_| 50.0), 3, false), [0.0, 0.5, 1.0]);
        assert_eq!(equal_steps(greys(|_| 50.0), 4, true), [0.0, 0.25, 0.5, 0.75]);
        assert_eq!(equal_steps(Vec::new(), 1, false), [0.0]);
        let closed = equal_steps(greys(|at| 50.0 + 0.1 * at), 4, true);
        assert!(closed.iter().zip([0.0, 0.25, 0.5, 0.75]).all(|(one, two)| (one - two).abs() <= 1e-3), "{closed:?}");
    }
}
