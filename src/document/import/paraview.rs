//! Presets of ParaView: a JSON list of colour maps, with opacities if they were saved.

use serde_json::{Map, Value};

use super::colours::{SPACES, Space, colours};
use super::{Interpolation, Point, Preset, checked, heights, numbers};

/// Keys of which a preset has at least one.
const KEYS: [&str; 3] = ["RGBPoints", "IndexedColors", "Points"];

/// True for a JSON object that is a preset.
pub(super) fn is_preset(table: &Map<String, Value>) -> bool {
    KEYS.iter().any(|key| table.contains_key(*key))
}

/// The only preset of a file.
pub(super) fn json(list: &[Value]) -> Result<Preset, String> {
    /// Names that a message lists.
    const LISTED: usize = 5;
    let name = |preset: &Value| preset["Name"].as_str().map(str::to_owned);
    let [preset] = list else {
        let names: Vec<String> = list.iter().filter_map(name).take(LISTED).collect();
        let more = if list.len() > names.len() { ", …" } else { "" };
        return Err(format!(
            "it has {} presets ({}{more}); keep one of them in the file",
            list.len(),
            names.join(", ")
        ));
    };
    if preset["RGBPoints"].is_null() {
        return Err(if preset["IndexedColors"].is_null() {
            "it has no colours (RGBPoints)".to_owned()
        } else {
            "its colours are those of categories (IndexedColors), and of no values".to_owned()
        });
    }
    if is_set(&preset["UseLogScale"]) {
        return Err(
            "its scale is logarithmic (UseLogScale), and that of a scene is not; switch it off in ParaView".to_owned()
        );
    }
    let of_colours = points("RGBPoints", &preset["RGBPoints"])?;
    let of_colours =
        of_colours.into_iter().map(|[value, red, green, blue]| Point::plain(value, [red, green, blue])).collect();
    let opacity = match &preset["Points"] {
        // Opacity rises evenly over the values.
        Value::Null => vec![Point::plain(0.0, [0.0]), Point::plain(1.0, [1.0])],
        stated => {
            let point = |[value, height, midpoint, sharpness]: [f64; 4]| Point {
                value,
                heights: [height],
                midpoint,
                sharpness,
            };
            points("Points", stated)?.into_iter().map(point).collect()
        }
    };
    let space = match preset["ColorSpace"].as_str().unwrap_or("RGB") {
        "RGB" => Space::Rgb,
        "HSV" => Space::Hsv { wraps: is_set(&preset["HSVWrap"]) },
        "Lab" | "CIELAB" | "Lab/CIEDE2000" => Space::Lab,
        "Diverging" => Space::Diverging,
        "Step" => Space::Step,
        other => return Err(format!("its ColorSpace is {other:?}; {SPACES} are read")),
    };
    Ok(Preset {
        program: "ParaView",
        name: name(preset),
        opacity: heights(&checked("Points", opacity)?),
        colours: colours(&checked("RGBPoints", of_colours)?, space),
        gradient_opacity: Vec::new(),
        // ParaView shades volumes on request.
        shading: None,
        unit_distance: None,
        phase: 0.0,
        interpolation: Interpolation::Linear,
        is_spread: true,
    })
}

/// True for a switch, a number or a word, that is on.
fn is_set(switch: &Value) -> bool {
    switch.as_bool().or_else(|| switch.as_f64().map(|number| number != 0.0)).unwrap_or(false)
}

/// Groups of four numbers, the first of which is a value.
fn points(what: &str, list: &Value) -> Result<Vec<[f64; 4]>, String> {
    let numbers = numbers(what, list)?;
    let (groups, rest) = numbers.as_chunks::<4>();
    if !rest.is_empty() {
        return Err(format!("{what} has {} numbers, which are no groups of 4", numbers.len()));
    }
    let groups = groups.to_vec();
    Ok(groups)
}
