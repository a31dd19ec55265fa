//! Transfer-function presets of other programs: 3D Slicer (.vp, .vp.json), ParaView (.json) and OMERO (rendering settings in
//! JSON), recognised by their contents.

mod colours;
mod omero;
mod paraview;
mod scene;
mod slicer;

use std::path::{Path, PathBuf};

use serde_json::Value;

use relume_base::input;
use relume_base::number::{count, readable};

pub(crate) use self::scene::scene;

/// A file of another program that states how values look.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Import {
    /// The functions of a preset.
    Preset(Box<Preset>),
    /// Channels of rendering settings, at least one of which is active.
    Channels(Vec<Channel>),
}

/// The functions of a preset of 3D Slicer or ParaView.
#[derive(Clone, Debug, PartialEq)]
pub struct Preset {
    /// The program that wrote it.
    pub program: &'static str,
    /// Its name, if the file states one.
    pub name: Option<String>,
    /// Points of value and opacity, values not descending: linear between them, constant beyond the ends.
    pub opacity: Vec<(f64, f64)>,
    /// Points of value and sRGB numbers from 0 to 1, likewise.
    pub colours: Vec<(f64, [f64; 3])>,
    /// Points of gradient magnitude and a factor on the opacity, likewise; none if the factor is 1 everywhere.
    pub gradient_opacity: Vec<(f64, f64)>,
    /// How gradients shade it; `None` without shading.
    pub shading: Option<Shading>,
    /// Length in world units that opacities refer to; `None` is the default of ParaView, which depends on the grid.
    pub unit_distance: Option<f64>,
    /// Asymmetry of scattering: above 0 forwards.
    pub phase: f64,
    /// Interpolation between voxels.
    pub interpolation: Interpolation,
    /// True if the points are spread over the values of the volume.
    pub is_spread: bool,
}

/// Lighting of a preset, as a material has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shading {
    /// Factor of the ambient term, 0 to 1.
    pub ambient: f64,
    /// Factor of the diffuse term, 0 to 1.
    pub diffuse: f64,
    /// Factor of highlights, 0 to 1.
    pub specular: f64,
    /// Sharpness of highlights, from 0.
    pub exponent: f64,
}

/// Interpolation between voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interpolation {
    /// The nearest voxel.
    Nearest,
    /// Linear.
    Linear,
    /// Cubic.
    Cubic,
}

/// A channel of rendering settings.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Its number, from 1.
    pub number: usize,
    /// Its name.
    pub label: Option<String>,
    /// True if it is shown.
    pub is_active: bool,
    /// Values from transparent to most opaque.
    pub window: [f64; 2],
    /// sRGB numbers from 0 to 1.
    pub colour: [f64; 3],
}

/// Why a file is not read as a preset.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ImportError {
    /// The file cannot be read.
    #[error("cannot read the preset {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: std::io::Error,
    },
    /// The contents are those of no known preset.
    #[error(
        "{name} is no preset that Relume reads: {found}; it reads those of 3D Slicer (.vp, .vp.json) and ParaView (.json), and \
         rendering settings of OMERO in JSON"
    )]
    Unknown {
        /// The file.
        name: String,
        /// Its contents, in words.
        found: String,
    },
    /// A preset with a mistake, or with something that a scene does not have.
    #[error("{name}, {what}: {problem}")]
    Invalid {
        /// The file.
        name: String,
        /// The kind of preset that its contents are, in words.
        what: &'static str,
        /// The mistake.
        problem: String,
    },
}

impl ImportError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Read { .. } => "preset-not-readable",
            Self::Unknown { .. } => "preset-unknown",
            Self::Invalid { .. } => "preset-invalid",
        }
    }
}

/// Longest preset, in bytes; the collection of all presets of ParaView is shorter.
const LONGEST: u64 = 4 << 20;
/// Most points of a function. A point may become a material.
const MOST_POINTS: usize = 1024;

/// Reads the preset in the file `path`.
///
/// # Errors
///
/// [`ImportError`].
pub fn read(path: &Path) -> Result<Import, ImportError> {
    let bytes = input::read(path, LONGEST).map_err(|source| ImportError::Read { path: path.to_owned(), source })?;
    parse(&bytes, &path.display().to_string())
}

/// Reads the preset in `bytes`; `name` heads messages.
///
/// # Errors
///
/// [`ImportError::Unknown`] and [`ImportError::Invalid`].
pub fn parse(bytes: &[u8], name: &str) -> Result<Import, ImportError> {
    let unknown = |found: String| ImportError::Unknown { name: name.to_owned(), found };
    let invalid = |what| move |problem| ImportError::Invalid { name: name.to_owned(), what, problem };
    if u64::try_from(bytes.len()).is_ok_and(|length| length > LONGEST) {
        return Err(unknown(format!("it has more than {LONGEST} bytes")));
    }
    let text = std::str::from_utf8(bytes)
        .map_err(|error| unknown(format!("this is not UTF-8 text from byte {} on", error.valid_up_to())))?;
    let text = text.trim_start_matches('\u{feff}').trim();
    match text.chars().next() {
        None => Err(unknown("the file is empty".to_owned())),
        Some('{' | '[') => {
            let json: Value =
                serde_json::from_str(text).map_err(|error| unknown(format!("this is no valid JSON ({error})")))?;
            match &json {
                Value::Object(table) if table.contains_key("volumeProperties") => {
                    slicer::json(&json).map(preset).map_err(invalid("a preset of 3D Slicer"))
                }
                Value::Object(table) if table.contains_key("channels") => {
                    omero::channels(&json).map(Import::Channels).map_err(invalid("rendering settings of OMERO"))
                }
                Value::Object(table) if paraview::is_preset(table) => {
                    paraview::json(std::slice::from_ref(&json)).map(preset).map_err(invalid("a preset of ParaView"))
                }
                Value::Array(list) if list.iter().any(|it| it.as_object().is_some_and(paraview::is_preset)) => {
                    paraview::json(list).map(preset).map_err(invalid("a preset of ParaView"))
                }
                Value::Object(table) => {
                    let keys: Vec<&str> = table.keys().take(5).map(String::as_str).collect();
                    Err(unknown(format!(
                        "this is JSON with the keys {}",
                        if keys.is_empty() { "{}".to_owned() } else { keys.join(", ") }
                    )))
                }
                _ => Err(unknown("this is a JSON list without RGBPoints, IndexedColors or Points".to_owned())),
            }
        }
        Some('<') => Err(unknown("this is XML; save the preset as .vp or .json".to_owned())),
        Some(first) if first.is_ascii_digit() => {
            slicer::vp(text).map(preset).map_err(invalid("read as a preset of 3D Slicer (.vp)"))
        }
        Some(_) if text.lines().any(|line| line.trim_end() == "channels:") => {
            Err(unknown("these are rendering settings in YAML; write them as JSON".to_owned()))
        }
        Some(_) => {
            let first: String = text.lines().next().unwrap_or_default().chars().take(40).collect();
            Err(unknown(format!("this is text that begins with {first:?}")))
        }
    }
}

fn preset(preset: Preset) -> Import {
    Import::Preset(Box::new(preset))
}

/// A point of a function as files state it: a value with its heights, and the shape of the curve behind it.
#[derive(Clone, Copy, Debug)]
struct Point<const N: usize> {
    value: f64,
    heights: [f64; N],
    /// Place between this point and the next, where the curve has the mean of both.
    midpoint: f64,
    /// 0 linear, 1 a jump at the midpoint.
    sharpness: f64,
}

impl<const N: usize> Point<N> {
    /// A point of straight lines.
    fn plain(value: f64, heights: [f64; N]) -> Self {
        Self { value, heights, midpoint: 0.5, sharpness: 0.0 }
    }
}

/// Checks the points of the function `what`, whose heights are from 0 to 1.
fn checked<const N: usize>(what: &str, mut points: Vec<Point<N>>) -> Result<Vec<Point<N>>, String> {
    /// Excess of heights that rounding explains.
    const ROUNDING: f64 = 1e-4;
    if points.is_empty() {
        return Err(format!("{what} has no points"));
    }
    if points.len() > MOST_POINTS {
        return Err(format!("{what} has {} points; at most {MOST_POINTS} are read", points.len()));
    }
    for (index, point) in points.iter_mut().enumerate() {
        let number = index + 1;
        if !point.value.is_finite() {
            return Err(format!("{what}: the value of point {number} is {}, which is not finite", point.value));
        }
        if let Some(height) = point.heights.iter().find(|height| !(-ROUNDING..=1.0 + ROUNDING).contains(*height)) {
            return Err(format!("{what}: point {number} has {}; 0 to 1 are read", readable(*height)));
        }
        for (name, part) in [("midpoint", point.midpoint), ("sharpness", point.sharpness)] {
            if !(0.0..=1.0).contains(&part) {
                return Err(format!("{what}: the {name} of point {number} is {}; 0 to 1 are read", readable(part)));
            }
        }
        point.heights = point.heights.map(|height| height.clamp(0.0, 1.0));
    }
    match points.windows(2).position(|pair| pair[1].value < pair[0].value) {
        Some(at) => Err(format!(
            "{what}: its points are not in order: {} follows {}",
            readable(points[at + 1].value),
            readable(points[at].value)
        )),
        None => Ok(points),
    }
}

/// Places between two points, 0 at the first and 1 at the second, and the share of the second there, as VTK's functions have
/// them; none on a straight line.
fn between(midpoint: f64, sharpness: f64) -> Vec<[f64; 2]> {
    /// Straight pieces of a curve.
    const PIECES: usize = 16;
    if sharpness > 0.99 {
        return vec![[midpoint, 0.0], [midpoint, 1.0]];
    }
    if sharpness < 0.01 {
        let is_bent = (midpoint - 0.5).abs() > 1e-6;
        return if is_bent { vec![[midpoint, 0.5]] } else { Vec::new() };
    }
    let share = |place: f64| {
        let even = if place < midpoint {
            0.5 * place / midpoint
        } else {
            0.5 + 0.5 * (place - midpoint) / (1.0 - midpoint).max(f64::MIN_POSITIVE)
        };
        let power = 10.0f64.mul_add(sharpness, 1.0);
        let steep = if even < 0.5 {
            0.5 * (2.0 * even).powf(power)
        } else {
            1.0 - 0.5 * (2.0 * (1.0 - even)).max(0.0).powf(power)
        };
        // Hermite, with slopes that sharpness flattens.
        let (two, three) = (steep.powi(2), steep.powi(3));
        let share = 3.0f64.mul_add(two, -2.0 * three) + (1.0 - sharpness) * (2.0 * three - 3.0 * two + steep);
        share.clamp(0.0, 1.0)
    };
    (1..PIECES).map(|piece| count(piece) / count(PIECES)).map(|place| [place, share(place)]).collect()
}

/// The function as straight lines between points; `pieces` are the shares between two points beside those of their shape, and `mix`
/// is what lies between two heights.
fn straight<const N: usize>(
    points: &[Point<N>],
    pieces: &[[f64; 2]],
    mix: impl Fn([f64; N], [f64; N], f64) -> [f64; N],
) -> Vec<(f64, [f64; N])> {
    let mut found = Vec::new();
    for (index, from) in points.iter().enumerate() {
        found.push((from.value, from.heights));
        let Some(to) = points.get(index + 1) else { break };
        let of_shape = between(from.midpoint, from.sharpness);
        for &[place, share] in if of_shape.is_empty() { pieces } else { &of_shape } {
            // A difference of values may exceed the largest number.
            let value = from.value.mul_add(1.0 - place, to.value * place);
            found.push((value.clamp(from.value, to.value), mix(from.heights, to.heights, share)));
        }
    }
    found
}

/// The function of one height as straight lines.
fn heights(points: &[Point<1>]) -> Vec<(f64, f64)> {
    let mix = |[from]: [f64; 1], [to]: [f64; 1], share: f64| [share.mul_add(to - from, from)];
    straight(points, &[], mix).into_iter().map(|(value, [height])| (value, height)).collect()
}

/// The numbers of the JSON list `what`.
fn numbers(what: &str, list: &Value) -> Result<Vec<f64>, String> {
    let list = list.as_array().ok_or_else(|| format!("{what} is no list of numbers"))?;
    let number = |(index, value): (usize, &Value)| {
        value.as_f64().ok_or_else(|| format!("{what}: entry {} is {value}, and no number", index + 1))
    };
    list.iter().enumerate().map(number).collect()
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;

    /// CT-Bone of 3D Slicer.
    const BONE: &str = "1\n1\n0.9\n0.1\n0.2\n10\n8 -3024 0 -16.4458 0 641.385 0.715686 3071 0.705882\n4 0 1 255 1\n\
                        16 -3024 0 0 0 -16.4458 0.729412 0.254902 0.301961 641.385 0.905882 0.815686 0.552941 3071 1 1 1\n";

    fn functions(text: &str) -> Preset {
        match parse(text.as_bytes(), "p").unwrap() {
            Import::Preset(preset) => *preset,
            Import::Channels(channels) => panic!("{channels:?}"),
        }
    }

    fn problem(text: &str) -> String {
        parse(text.as_bytes(), "p.vp").unwrap_err().to_string()
    }

    #[test]
    fn a_preset_has_the_points_of_its_file() {
        let preset = functions(BONE);
        assert_eq!(preset.opacity[1..], [(-16.4458, 0.0), (641.385, 0.715_686), (3071.0, 0.705_882)]);
        assert_eq!(preset.colours[3], (3071.0, [1.0; 3]));
        assert_eq!(preset.shading, Some(Shading { ambient: 0.1, diffuse: 0.9, specular: 0.2, exponent: 10.0 }));
        assert!(preset.gradient_opacity.is_empty(), "a factor of 1");
        let with_comments = BONE.lines().map(|line| format!("{line} => of a page\r\n")).collect::<String>();
        assert_eq!(functions(&with_comments), preset, "the documentation of Slicer shows presets so");
    }

    #[test]
    fn every_shortened_preset_is_refused() {
        // The last number alone may lose digits.
        for end in 0..BONE.trim_end().len() - 1 {
            assert!(parse(&BONE.as_bytes()[..end], "p").is_err(), "{end}");
        }
    }

    #[test]
    fn mistakes_are_named() {
        let changed = |from: &str, to: &str| problem(&BONE.replacen(from, to, 1));
        assert!(changed("641.385 0.715686", "nan 0.715686").contains("not finite"), "NaN");
        assert!(changed("641.385 0.715686", "641.385 1.5").contains("point 3 has 1.5; 0 to 1"), "an opacity");
        assert!(changed("-16.4458 0 ", "-9999 0 ").contains("not in order: -9999 follows -3024"), "order");
        assert!(changed("8 -3024", "7 -3024").contains("7 numbers"), "a count");
        assert!(changed("8 -3024 0 -16.4458 0 641.385 0.715686 3071 0.705882", "0").contains("no points"), "points");
        assert!(changed("0.9", "x").contains("line 3, the diffuse reflection"), "a word");
        assert!(problem("<MRML/>").contains("XML"), "XML");
        assert!(problem("channels:\n  1:\n").contains("YAML"), "YAML");
        assert!(problem("{\"a\": 1}").contains("the keys a"), "JSON");
        assert!(problem("[{\"RGBPoints\": [").contains("no valid JSON"), "a part");
        assert!(problem("").contains("empty") && problem("hello").contains("\"hello\""), "others");
    }

    #[test]
    fn a_bent_function_passes_its_midpoint() {
        assert_eq!(between(0.5, 0.0), [[0.0; 2]; 0]);
        assert_eq!(between(0.25, 0.0), [[0.25, 0.5]]);
        assert_eq!(between(0.25, 1.0), [[0.25, 0.0], [0.25, 1.0]]);
        let curve = between(0.5, 0.5);
        assert!(curve.windows(2).all(|pair| pair[0][1] <= pair[1][1]), "it rises");
        assert!((curve[7][1] - 0.5).abs() < 1e-12, "through the middle");
    }
}
