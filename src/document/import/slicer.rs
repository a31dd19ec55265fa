//! Presets of 3D Slicer: volume properties as text (.vp) and as JSON (.vp.json, volume-property-schema 1).

use serde_json::Value;

use super::colours::{Space, colours};
use super::{Interpolation, Point, Preset, Shading, checked, heights, numbers};
use relume_base::number::readable;

/// Lines of a text, in order.
const LINES: [&str; 9] = [
    "the interpolation",
    "the shading",
    "the diffuse reflection",
    "the ambient reflection",
    "the specular reflection",
    "the specular power",
    "the scalar opacity",
    "the gradient opacity",
    "the colour function",
];

/// The preset in a text: a number on each of six lines, and three functions, which begin with the count of their numbers.
pub(super) fn vp(text: &str) -> Result<Preset, String> {
    let lines: Vec<&str> = text.lines().collect();
    let line = |index: usize| {
        let found = lines.get(index).copied();
        found.ok_or_else(|| {
            format!("the file ends after line {} of {}; {} is missing", lines.len(), LINES.len(), LINES[index])
        })
    };
    let number = |index: usize| {
        let word = line(index)?.split_whitespace().next().unwrap_or_default();
        let found: Option<f64> = word.parse().ok().filter(|number: &f64| number.is_finite());
        found.ok_or_else(|| format!("line {}, {}: {word:?} is no number", index + 1, LINES[index]))
    };
    let points = |index: usize| {
        function(line(index)?).map_err(|problem| format!("line {}, {}: {problem}", index + 1, LINES[index]))
    };
    let interpolation = interpolation(number(0)?)?;
    let is_shaded = number(1)? != 0.0;
    let shading = Shading { diffuse: number(2)?, ambient: number(3)?, specular: number(4)?, exponent: number(5)? };
    let opacity = one(LINES[6], &points(6)?)?;
    let gradient = points(7)?;
    let gradient = if gradient.is_empty() { Vec::new() } else { one(LINES[7], &gradient)? };
    let of_colours = points(8)?;
    let whole = groups::<4>(LINES[8], &of_colours)?;
    let of_colours =
        whole.into_iter().map(|[value, red, green, blue]| Point::plain(value, [red, green, blue])).collect();
    let functions = Functions { opacity, gradient, colours: of_colours };
    functions.preset(interpolation, (is_shaded, shading))
}

/// The numbers of a line that begins with their count. Words behind them are a comment.
fn function(line: &str) -> Result<Vec<f64>, String> {
    let mut words = line.split_whitespace();
    let first = words.next().unwrap_or_default();
    let count: usize = first.parse().map_err(|_| format!("{first:?} is no count of numbers"))?;
    let found: Vec<f64> = words.map_while(|word| word.parse().ok()).collect();
    if found.len() == count { Ok(found) } else { Err(format!("it states {count} numbers, and {} follow", found.len())) }
}

/// Groups of `N` numbers.
fn groups<const N: usize>(what: &str, numbers: &[f64]) -> Result<Vec<[f64; N]>, String> {
    let (whole, rest) = numbers.as_chunks::<N>();
    if rest.is_empty() {
        Ok(whole.to_vec())
    } else {
        Err(format!("{what} has {} numbers, which are no groups of {N}", numbers.len()))
    }
}

/// Points of a function of one height.
fn one(what: &str, numbers: &[f64]) -> Result<Vec<Point<1>>, String> {
    Ok(groups::<2>(what, numbers)?.into_iter().map(|[value, height]| Point::plain(value, [height])).collect())
}

/// The interpolation of this number of VTK.
fn interpolation(number: f64) -> Result<Interpolation, String> {
    let all = [Interpolation::Nearest, Interpolation::Linear, Interpolation::Cubic];
    let found = all.into_iter().zip([0.0, 1.0, 2.0]).find(|(_, of_vtk): &(_, f64)| (of_vtk - number).abs() < 0.5);
    let found = found.map(|(interpolation, _)| interpolation);
    found.ok_or_else(|| format!("line 1, {}: it is {}; 0, 1 and 2 are read", LINES[0], readable(number)))
}

/// The preset in JSON: the first component of the first volume property, as Slicer reads it.
pub(super) fn json(file: &Value) -> Result<Preset, String> {
    let property = &file["volumeProperties"][0];
    let component = &property["components"][0];
    if !component.is_object() {
        return Err("volumeProperties has no components".to_owned());
    }
    let interpolation = match property["interpolationType"].as_str() {
        Some("nearest") => Interpolation::Nearest,
        Some("cubic") => Interpolation::Cubic,
        _ => Interpolation::Linear,
    };
    // The defaults of the schema.
    let lighting = |key: &str, default| number(&component["lighting"], key, default);
    let shading = Shading {
        ambient: lighting("ambient", 0.1)?,
        diffuse: lighting("diffuse", 0.7)?,
        specular: lighting("specular", 0.2)?,
        exponent: lighting("specularPower", 10.0)?,
    };
    let is_shaded = component["shade"].as_bool().unwrap_or(false);
    let one = |key: &str| points(component, key, |point| Ok([number(point, "y", f64::NAN)?]));
    let opacity = one("scalarOpacity")?;
    let is_graded = !component["disableGradientOpacity"].as_bool().unwrap_or(false);
    let has_gradient = component["gradientOpacity"]["points"].as_array().is_some_and(|points| !points.is_empty());
    let gradient = if is_graded && has_gradient { one("gradientOpacity")? } else { Vec::new() };
    let of_colours = points(component, "rgbTransferFunction", |point| {
        let found = numbers("color", &point["color"])?;
        <[f64; 3]>::try_from(found).map_err(|found| format!("a colour has {} numbers; it has 3", found.len()))
    })?;
    let functions = Functions { opacity, gradient, colours: of_colours };
    let preset = functions.preset(interpolation, (is_shaded, shading))?;
    let distance = number(component, "scalarOpacityUnitDistance", 1.0)?;
    if distance <= 0.0 {
        return Err(format!("scalarOpacityUnitDistance is {}; it is read if it is above 0", readable(distance)));
    }
    let phase = number(property, "scatteringAnisotropy", 0.0)?;
    if !(-1.0..=1.0).contains(&phase) {
        return Err(format!("scatteringAnisotropy is {}; -1 to 1 are read", readable(phase)));
    }
    Ok(Preset { unit_distance: Some(distance), phase, ..preset })
}

/// The number `key` of a table.
fn number(table: &Value, key: &str, default: f64) -> Result<f64, String> {
    match &table[key] {
        Value::Null if !default.is_nan() => Ok(default),
        value => value.as_f64().ok_or_else(|| format!("{key} is {value}, and no number")),
    }
}

/// The points of the function `key` of a component.
fn points<const N: usize>(
    component: &Value,
    key: &str,
    heights: impl Fn(&Value) -> Result<[f64; N], String>,
) -> Result<Vec<Point<N>>, String> {
    let list = component[key]["points"].as_array().ok_or_else(|| format!("{key} has no points"))?;
    let point = |point: &Value| {
        Ok(Point {
            value: number(point, "x", f64::NAN)?,
            heights: heights(point)?,
            midpoint: number(point, "midpoint", 0.5)?,
            sharpness: number(point, "sharpness", 0.0)?,
        })
    };
    list.iter().map(point).collect::<Result<_, String>>().map_err(|problem| format!("{key}: {problem}"))
}

/// The functions of a volume property, before they are checked.
struct Functions {
    opacity: Vec<Point<1>>,
    gradient: Vec<Point<1>>,
    colours: Vec<Point<3>>,
}

impl Functions {
    fn preset(self, interpolation: Interpolation, (is_shaded, shading): (bool, Shading)) -> Result<Preset, String> {
        let Shading { ambient, diffuse, specular, exponent } = shading;
        for (what, factor) in [("ambient", ambient), ("diffuse", diffuse), ("specular", specular)] {
            if !(0.0..=1.0).contains(&factor) {
                return Err(format!("the {what} reflection is {}; 0 to 1 are read", readable(factor)));
            }
        }
        if exponent < 0.0 {
            return Err(format!("the specular power is {}; numbers from 0 on are read", readable(exponent)));
        }
        let gradient =
            if self.gradient.is_empty() { Vec::new() } else { checked("the gradient opacity", self.gradient)? };
        let gradient = heights(&gradient);
        let is_one = gradient.iter().all(|point| point.1 >= 1.0);
        Ok(Preset {
            program: "3D Slicer",
            name: None,
            opacity: heights(&checked("the scalar opacity", self.opacity)?),
            colours: colours(&checked("the colour function", self.colours)?, Space::Rgb),
            gradient_opacity: if is_one { Vec::new() } else { gradient },
            shading: is_shaded.then_some(shading),
            // The default of VTK.
            unit_distance: Some(1.0),
            phase: 0.0,
            interpolation,
            is_spread: false,
        })
    }
}
