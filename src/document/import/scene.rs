//! The scene of a preset on a volume: its points, a material for each of its colours, and a camera that fits what they show.

use std::fmt::Write as _;

use super::{Interpolation, Preset, Shading};
use crate::look::first_look::{FirstLook, viewed};
use relume_base::number::{brief_in, count};
use relume_colour::spectrum::colour::{LinearSrgb, decode_srgb, display_code};
use relume_scene::{GRADIENT_POINTS, MaterialCurve, Term};
use relume_volume::{Geometry, Statistics, Volume};

/// The scene of `preset`, which was read from the file `file`, on `volume`, whose file is called `name`.
///
/// # Errors
///
/// A gradient opacity that a scene does not have, in words.
pub(crate) fn scene(
    preset: &Preset,
    file: &str,
    (name, volume, statistics): (&str, &Volume, &Statistics),
) -> Result<FirstLook, String> {
    // A comment ends with its line.
    let [name, file] = [name, file].map(|name| name.replace(char::is_control, " "));
    let geometry = &volume.geometry;
    let ends = [statistics.min, statistics.max];
    let spread = |value: f64, [first, last]: [f64; 2]| {
        let [low, high] = if ends[0] < ends[1] { ends } else { [ends[0] - 0.5, ends[0] + 0.5] };
        // Points that have the range of the values keep their numbers to the last digit.
        if !preset.is_spread || is_same([first, last], ends) {
            return value;
        }
        let share = if first < last { (value - first) / (last - first) } else { 0.0 };
        low.mul_add(1.0 - share, high * share)
    };
    let opacity = visible(spread_over(&preset.opacity, spread));
    let colours = of_visible(ascending(spread_over(&preset.colours, spread)), &opacity);
    let gradient = gradient_opacity(&preset.gradient_opacity)?;
    let length = preset.unit_distance.unwrap_or_else(|| unit_distance(geometry));
    let term = Term {
        ramp: None,
        opacity,
        absorption: Vec::new(),
        material: MaterialCurve(Vec::new()),
        gradient: Vec::new(),
        by: Vec::new(),
        shape: None,
    };
    let is_interpolated = preset.interpolation != Interpolation::Nearest;
    let view = viewed(volume, statistics, std::slice::from_ref(&term), length, is_interpolated);
    // A single slice has no gradient across it to shade.
    let shading = preset.shading.filter(|_| !view.is_flat);

    let of_name =
        preset.name.as_ref().map_or_else(String::new, |name| format!(" {:?}", name.replace(char::is_control, " ")));
    let range = ends[1] - ends[0];
    let shown = term.opacity.first().map_or(0.0, |point| point.0);
    let spread_words = if preset.is_spread { ", spread over the values of the volume" } else { "" };
    let guess = format!(
        "{name} is shown by the preset{of_name} of {} in {file}{spread_words}: its points begin at {}.",
        preset.program,
        brief_in(shown, range.max(f64::MIN_POSITIVE))
    );
    let mut text = format!(
        "# A preset of {} on {name}: Relume made this scene from {file}. docs/SCENE.md describes the keys.\n# {guess}\nversion = 1\n",
        preset.program
    );
    let mut line = |words: &str| {
        let _ = writeln!(text, "{words}");
    };
    if shading.is_none() {
        line("shading = \"none\"");
    }
    line(
        "\n[volume]\n\n# Opacity is the fraction of light lost over the opacity length, the unit distance of the preset.\n[transfer]",
    );
    line(&format!("opacity_length = {length:?}"));
    line(&format!("opacity = {}", pairs(&term.opacity)));
    let (names, materials) = named(&colours);
    let points: Vec<String> =
        colours.iter().zip(&names).map(|((value, _), name)| format!("[{value:?}, \"{name}\"]")).collect();
    line(&format!("material = [{}]", points.join(", ")));
    if !gradient.is_empty() {
        line("# A factor on the opacity, by the gradient magnitude in values per world unit.");
        line(&format!("gradient_opacity = {}", pairs(&gradient)));
    }
    line("\n# The colours of the preset, which they have in daylight.");
    for (name, code) in materials {
        line(&format!("[materials.{name}]\nreflectance = {{ srgb = \"{code}\" }}"));
        match shading {
            Some(Shading { ambient, diffuse, specular, exponent }) => line(&format!(
                "ambient = {ambient:?}\ndiffuse = {diffuse:?}\nspecular = {specular:?}\nexponent = {}\n",
                exponent.round().clamp(1.0, 1024.0)
            )),
            // Gradients replace the phase function.
            None if preset.phase != 0.0 => line(&format!("phase = {:?}\n", preset.phase.clamp(-0.99, 0.99))),
            None => line(""),
        }
    }
    line("[lights.head]\nspectrum = \"D65\"");
    line(&view.text);
    match preset.interpolation {
        Interpolation::Linear => {}
        Interpolation::Nearest => line("\n[accuracy]\ninterpolation = \"nearest\""),
        Interpolation::Cubic => line("\n[accuracy]\ninterpolation = \"cubic\""),
    }
    Ok(FirstLook { text, guess, is_changed: false, is_label_map: false })
}

/// Points at the places of `spread`, which maps the range of the points.
fn spread_over<T: Copy>(points: &[(f64, T)], spread: impl Fn(f64, [f64; 2]) -> f64) -> Vec<(f64, T)> {
    let ends = [points.first(), points.last()].map(|end| end.map_or(0.0, |point| point.0));
    points.iter().map(|&(value, height)| (spread(value, ends), height)).collect()
}

/// The opacity without the points before and behind the visible values.
fn visible(opacity: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let is_visible = |point: &(f64, f64)| point.1 > 0.0;
    let (Some(first), Some(last)) = (opacity.iter().position(is_visible), opacity.iter().rposition(is_visible)) else {
        return opacity;
    };
    opacity[first.saturating_sub(1)..opacity.len().min(last + 2)].to_vec()
}

/// The colours that visible values have.
fn of_visible(mut colours: Vec<(f64, [f64; 3])>, opacity: &[(f64, f64)]) -> Vec<(f64, [f64; 3])> {
    let hidden = |end: Option<&(f64, f64)>| end.filter(|point| point.1 <= 0.0).map(|point| point.0);
    if let Some(least) = hidden(opacity.first()) {
        let at_or_before = colours.partition_point(|point| point.0 <= least);
        colours.drain(..at_or_before.saturating_sub(1));
    }
    if let Some(most) = hidden(opacity.last()) {
        let before = colours.partition_point(|point| point.0 < most);
        colours.truncate(before + 1);
    }
    // Colours are constant beyond the ends.
    while colours.len() > 1 && is_same(colours[0].1, colours[1].1) {
        colours.remove(0);
    }
    while colours.len() > 1 && is_same(colours[colours.len() - 1].1, colours[colours.len() - 2].1) {
        colours.pop();
    }
    colours
}

fn is_same<const N: usize>(one: [f64; N], other: [f64; N]) -> bool {
    one.map(f64::to_bits) == other.map(f64::to_bits)
}

/// The points with values that ascend: a jump becomes a steep ramp, of half a thousandth of the range at most.
fn ascending<T: Copy>(points: Vec<(f64, T)>) -> Vec<(f64, T)> {
    const STEEP: f64 = 1.0 / 2048.0;
    let range = match points[..] {
        [first, .., last] => last.0 - first.0,
        _ => 0.0,
    };
    let range = if range > 0.0 { range } else { 1.0 };
    let mut found: Vec<(f64, T)> = Vec::new();
    for (index, &(value, height)) in points.iter().enumerate() {
        let value = match found.last() {
            Some(&(before, _)) if value <= before => {
                let next = points[index..].iter().map(|point| point.0).find(|&next| next > before);
                let room = next.map_or(f64::INFINITY, |next| (next - before) / 2.0);
                (before + room.min(STEEP * range)).max(before.next_up())
            }
            _ => value,
        };
        found.push((value, height));
    }
    found
}

/// Points of the gradient opacity that a scene may state.
fn gradient_opacity(points: &[(f64, f64)]) -> Result<Vec<(f64, f64)>, String> {
    if let Some((magnitude, _)) = points.first().filter(|point| point.0 < 0.0) {
        return Err(format!("the gradient opacity begins at {magnitude}; a gradient magnitude is at least 0"));
    }
    if points.len() > GRADIENT_POINTS {
        return Err(format!("the gradient opacity has {} points; at most {GRADIENT_POINTS} are read", points.len()));
    }
    Ok(ascending(points.to_vec()))
}

/// The default unit distance of ParaView: the diagonal of the box of the voxels' centres, divided by the cube root of the number of
/// cells between them.
fn unit_distance(geometry: &Geometry) -> f64 {
    let cells = geometry.dims.map(|side| count(side.saturating_sub(1)));
    let diagonal = (glam::DVec3::from_array(cells) * geometry.spacing).length();
    let number: f64 = cells.iter().map(|side| side.max(1.0)).product();
    let length = diagonal / number.cbrt();
    // Six digits are enough, and readable.
    let length = format!("{length:.5e}").parse().unwrap_or(length);
    if length > 0.0 { length } else { geometry.spacing.min_element() }
}

/// The name of the material of each point, and the materials with their sRGB codes. Points of one colour share a material.
fn named(colours: &[(f64, [f64; 3])]) -> (Vec<String>, Vec<(String, String)>) {
    let codes: Vec<String> = colours.iter().map(|(_, srgb)| display_code(LinearSrgb(srgb.map(decode_srgb)))).collect();
    let mut different: Vec<&String> = Vec::new();
    for code in &codes {
        if !different.contains(&code) {
            different.push(code);
        }
    }
    let words: Vec<String> = match different.len() {
        1 => vec!["colour".to_owned()],
        2 => ["low", "high"].map(str::to_owned).to_vec(),
        3 => ["low", "middle", "high"].map(str::to_owned).to_vec(),
        number => (1..=number).map(|index| format!("colour_{index}")).collect(),
    };
    let word = |code: &String| different.iter().position(|it| *it == code).and_then(|at| words.get(at)).cloned();
    let names = codes.iter().map(|code| word(code).unwrap_or_default()).collect();
    (names, words.iter().cloned().zip(different.iter().map(|code| (*code).clone())).collect())
}

fn pairs(points: &[(f64, f64)]) -> String {
    let points: Vec<String> = points.iter().map(|(value, height)| format!("[{value:?}, {height:?}]")).collect();
    format!("[{}]", points.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_visible_points_stay() {
        let opacity = visible(vec![(-9.0, 0.0), (-1.0, 0.0), (2.0, 0.5), (3.0, 0.0), (4.0, 0.0)]);
        assert_eq!(opacity, [(-1.0, 0.0), (2.0, 0.5), (3.0, 0.0)]);
        let grey = |value: f64| (value, [value / 10.0; 3]);
        let colours = [-9.0, -2.0, 1.0, 3.5, 8.0].map(grey).to_vec();
        assert_eq!(of_visible(colours, &opacity), [-2.0, 1.0, 3.5].map(grey));
        let hidden = vec![(0.0, 0.0), (1.0, 0.0)];
        assert_eq!(visible(hidden.clone()), hidden, "nothing is visible");
    }

    #[test]
    fn jumps_of_colours_become_steep_ramps() {
        let found = ascending(vec![(0.0, 'a'), (0.0, 'b'), (1e-9, 'c'), (2048.0, 'd'), (2048.0, 'e')]);
        assert!(found.windows(2).all(|pair| pair[0].0 < pair[1].0), "{found:?}");
        assert_eq!(found.iter().map(|point| point.1).collect::<String>(), "abcde");
        assert!((found[4].0 - 2049.0).abs() < 1e-9, "{found:?}");
    }

    #[test]
    fn colours_that_are_equal_share_a_material() {
        let (names, materials) = named(&[(0.0, [0.0; 3]), (1.0, [1.0; 3]), (2.0, [0.0; 3])]);
        assert_eq!(names, ["low", "high", "low"]);
        assert_eq!(materials[1], ("high".to_owned(), "#ffffff".to_owned()));
    }
}
