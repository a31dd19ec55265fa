//! Colours between the points of a colour function, as VTK mixes them.

use std::f64::consts::PI;

use super::{Point, straight};
use relume_base::number::count;
use relume_colour::spectrum::colour::{
    Lab, LinearSrgb, d65_white, decode_srgb, encode_srgb, lab_from_xyz, linear_srgb_from_xyz, xyz_from_lab,
    xyz_from_linear_srgb,
};

/// Colour space in which a function mixes colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Space {
    Rgb,
    /// Hue, saturation and value; `wraps` if hues go the shorter way around.
    Hsv {
        wraps: bool,
    },
    Lab,
    /// Lab in polar coordinates, through white between two saturated colours (Moreland 2009).
    Diverging,
    /// The second colour.
    Step,
}

/// Names of the spaces, for messages.
pub(super) const SPACES: &str = "RGB, HSV, Lab, Diverging and Step";

/// Points of value and sRGB numbers between which light is mixed. Between two points of RGB there are no others: a scene mixes light,
/// and VTK numbers, which differs a little.
pub(super) fn colours(points: &[Point<3>], space: Space) -> Vec<(f64, [f64; 3])> {
    /// Pieces between two points of other spaces, if there are few.
    const PIECES: usize = 16;
    const FEW: usize = 32;
    let pieces: Vec<[f64; 2]> = match space {
        Space::Rgb => Vec::new(),
        Space::Step => vec![[0.0, 1.0]],
        _ if points.len() > FEW => Vec::new(),
        _ => (1..PIECES).map(|piece| [count(piece) / count(PIECES); 2]).collect(),
    };
    thinned(&straight(points, &pieces, |from, to, share| mixed(space, from, to, share)))
}

/// The colour between two others.
fn mixed(space: Space, from: [f64; 3], to: [f64; 3], share: f64) -> [f64; 3] {
    let line = |from: [f64; 3], to: [f64; 3], share: f64| {
        [0, 1, 2].map(|part| share.mul_add(to[part] - from[part], from[part]))
    };
    match space {
        Space::Rgb | Space::Step => line(from, to, share),
        Space::Hsv { wraps } => {
            let (mut from, mut to) = (hsv(from), hsv(to));
            if wraps && (from[0] - to[0]).abs() > 0.5 {
                let later = if from[0] > to[0] { &mut from[0] } else { &mut to[0] };
                *later -= 1.0;
            }
            let [hue, saturation, value] = line(from, to, share);
            let part = |offset: f64| {
                let place = ((hue + offset).rem_euclid(1.0) * 6.0 - 3.0).abs() - 1.0;
                value * saturation.mul_add(place.clamp(0.0, 1.0) - 1.0, 1.0)
            };
            [part(0.0), part(2.0 / 3.0), part(1.0 / 3.0)]
        }
        Space::Lab => srgb(line(lab(from), lab(to), share)),
        Space::Diverging => {
            let (mut from, mut to, mut share) = (polar(lab(from)), polar(lab(to)), share);
            let turn = (from[2] - to[2]).rem_euclid(2.0 * PI);
            if from[1] > 0.05 && to[1] > 0.05 && turn.min(2.0 * PI - turn) > 0.33 * PI {
                let white = [from[0].max(to[0]).max(88.0), 0.0, 0.0];
                if share < 0.5 {
                    (to, share) = (white, 2.0 * share);
                } else {
                    (from, share) = (white, 2.0 * share - 1.0);
                }
            }
            if from[1] < 0.05 && to[1] > 0.05 {
                from[2] = hue_beside(to, from[0]);
            } else if to[1] < 0.05 && from[1] > 0.05 {
                to[2] = hue_beside(from, to[0]);
            }
            let [magnitude, saturation, hue] = line(from, to, share);
            let chroma = magnitude * saturation.sin();
            srgb([magnitude * saturation.cos(), chroma * hue.cos(), chroma * hue.sin()])
        }
    }
}

/// Hue, saturation and value, 0 to 1, of sRGB numbers.
fn hsv([red, green, blue]: [f64; 3]) -> [f64; 3] {
    let (most, least) = (red.max(green).max(blue), red.min(green).min(blue));
    let span = most - least;
    if span <= 0.0 {
        return [0.0, 0.0, most];
    }
    let sixth = if red >= most {
        (green - blue) / span
    } else if green >= most {
        2.0 + (blue - red) / span
    } else {
        4.0 + (red - green) / span
    };
    [(sixth / 6.0).rem_euclid(1.0), span / most, most]
}

fn lab(srgb: [f64; 3]) -> [f64; 3] {
    lab_from_xyz(xyz_from_linear_srgb(LinearSrgb(srgb.map(decode_srgb))), d65_white()).0
}

fn srgb(lab: [f64; 3]) -> [f64; 3] {
    linear_srgb_from_xyz(xyz_from_lab(Lab(lab), d65_white())).0.map(|part| encode_srgb(part).clamp(0.0, 1.0))
}

/// Magnitude, saturation as an angle, and hue of a colour in Lab.
fn polar([lightness, a, b]: [f64; 3]) -> [f64; 3] {
    let magnitude = lightness.hypot(a).hypot(b);
    let saturation = if magnitude > 0.001 { (lightness / magnitude).clamp(-1.0, 1.0).acos() } else { 0.0 };
    [magnitude, saturation, if saturation > 0.001 { b.atan2(a) } else { 0.0 }]
}

/// The hue of a colour without saturation on the way to a saturated one.
fn hue_beside([magnitude, saturation, hue]: [f64; 3], unsaturated: f64) -> f64 {
    if magnitude >= unsaturated - 0.1 {
        return hue;
    }
    let spin = saturation * unsaturated.mul_add(unsaturated, -magnitude.powi(2)).max(0.0).sqrt()
        / (magnitude * saturation.sin());
    if hue > -0.3 * PI { hue + spin } else { hue - spin }
}

/// The points without those that a mix of light between their neighbours shows as well, to half a code of 8 bits.
fn thinned(points: &[(f64, [f64; 3])]) -> Vec<(f64, [f64; 3])> {
    const HALF_A_CODE: f64 = 0.5 / 255.0;
    let light: Vec<[f64; 3]> = points.iter().map(|point| point.1.map(decode_srgb)).collect();
    let error = |first: usize, last: usize, at: usize| {
        let span = points[last].0 - points[first].0;
        let share = if span > 0.0 { (points[at].0 - points[first].0) / span } else { 0.0 };
        let part = |part: usize| {
            let mix = share.mul_add(light[last][part] - light[first][part], light[first][part]);
            (encode_srgb(mix) - points[at].1[part]).abs()
        };
        [0, 1, 2].map(part).into_iter().fold(0.0, f64::max)
    };
    let mut is_kept = vec![false; points.len()];
    let mut open = vec![(0, points.len().saturating_sub(1))];
    while let Some((first, last)) = open.pop() {
        for end in [first, last] {
            if let Some(kept) = is_kept.get_mut(end) {
                *kept = true;
            }
        }
        let worst =
            (first + 1..last).map(|at| (error(first, last, at), at)).max_by(|one, other| one.0.total_cmp(&other.0));
        if let Some((_, at)) = worst.filter(|&(error, _)| error > HALF_A_CODE) {
            open.extend([(first, at), (at, last)]);
        }
    }
    points.iter().zip(is_kept).filter(|(_, is_kept)| *is_kept).map(|(point, _)| *point).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const BLUE: [f64; 3] = [0.230, 0.299, 0.754];
    const RED: [f64; 3] = [0.706, 0.016, 0.150];

    fn is_near(found: [f64; 3], expected: [f64; 3], tolerance: f64) -> bool {
        found.iter().zip(expected).all(|(found, expected)| (found - expected).abs() <= tolerance)
    }

    #[test]
    fn every_space_has_the_colours_of_its_points() {
        for space in [Space::Rgb, Space::Hsv { wraps: false }, Space::Hsv { wraps: true }, Space::Lab, Space::Diverging]
        {
            assert!(is_near(mixed(space, BLUE, RED, 0.0), BLUE, 1e-3), "{space:?}");
            assert!(is_near(mixed(space, BLUE, RED, 1.0), RED, 1e-3), "{space:?}");
        }
    }

    #[test]
    fn blue_and_red_diverge_through_the_published_grey() {
        // Moreland 2009, table of the cool to warm map: 221, 221, 221 in the middle.
        assert!(
            is_near(mixed(Space::Diverging, BLUE, RED, 0.5), [0.865; 3], 0.006),
            "{:?}",
            mixed(Space::Diverging, BLUE, RED, 0.5)
        );
    }

    #[test]
    fn hues_go_through_green_or_the_shorter_way() {
        let (red, blue) = ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0]);
        assert!(is_near(mixed(Space::Hsv { wraps: false }, red, blue, 0.5), [0.0, 1.0, 0.0], 1e-12), "green");
        assert!(is_near(mixed(Space::Hsv { wraps: true }, red, blue, 0.5), [1.0, 0.0, 1.0], 1e-12), "magenta");
    }

    #[test]
    fn points_that_light_passes_anyway_are_left_out() {
        let mix = |share: f64| {
            (
                share,
                [0, 1, 2].map(|part| {
                    let [from, to] = [BLUE, RED].map(|colour| decode_srgb(colour[part]));
                    encode_srgb(share.mul_add(to - from, from))
                }),
            )
        };
        let points: Vec<(f64, [f64; 3])> = (0_u8..=10).map(|step| mix(f64::from(step) / 10.0)).collect();
        assert_eq!(thinned(&points).len(), 2);
        let line = [Point::plain(0.0, BLUE), Point::plain(0.5, [1.0; 3]), Point::plain(1.0, RED)];
        assert_eq!(colours(&line, Space::Rgb).len(), 3);
        assert!(colours(&line[..1], Space::Lab).len() == 1, "one point");
        let steps: Vec<f64> = colours(&line, Space::Step).into_iter().map(|point| point.0).collect();
        assert_eq!(steps, [0.0, 0.0, 0.5, 0.5, 1.0]);
    }
}
