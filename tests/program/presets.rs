//! Presets of 3D Slicer, ParaView and OMERO as scenes.

use crate::support;

use std::path::Path;

use serde_json::json;
use support::program::{Folder, Outcome};
use toml::{Table, Value};

/// Points of the scalar opacity of CT-Bone of 3D Slicer: value and opacity.
const OPACITY: [[f64; 2]; 4] = [[-3024.0, 0.0], [-16.4458, 0.0], [641.385, 0.715_686], [3071.0, 0.705_882]];
/// Points of its colours: value, red, green and blue.
const COLOURS: [[f64; 4]; 4] = [
    [-3024.0, 0.0, 0.0, 0.0],
    [-16.4458, 0.729_412, 0.254_902, 0.301_961],
    [641.385, 0.905_882, 0.815_686, 0.552_941],
    [3071.0, 1.0, 1.0, 1.0],
];

/// The numbers of `points` behind their count.
fn line(points: &[f64]) -> String {
    let words: Vec<String> = points.iter().map(f64::to_string).collect();
    format!("{} {}", words.len(), words.join(" "))
}

/// CT-Bone as text, shaded or not.
fn vp(is_shaded: bool) -> String {
    let functions = [line(OPACITY.as_flattened()), "4 0 1 255 1".to_owned(), line(COLOURS.as_flattened())].join("\n");
    format!("1\n{}\n0.9\n0.1\n0.2\n10\n{functions}\n", u8::from(is_shaded))
}

/// The same in the JSON of Slicer.
fn vp_json(is_shaded: bool) -> serde_json::Value {
    let point = |[x, y]: [f64; 2]| json!({"x": x, "y": y, "midpoint": 0.5, "sharpness": 0.0});
    let colour = |[x, red, green, blue]: [f64; 4]| json!({"x": x, "color": [red, green, blue], "midpoint": 0.5, "sharpness": 0.0});
    json!({
        "@schema": "https://raw.githubusercontent.com/slicer/slicer/main/Modules/Loadable/VolumeRendering/Resources/Schema/volume-property-schema-v1.0.0.json#",
        "volumeProperties": [{
            "effectiveRange": [-3024.0, 3071.0], "interpolationType": "linear", "scatteringAnisotropy": 0.0,
            "components": [{
                "componentWeight": 1.0, "shade": is_shaded, "disableGradientOpacity": false, "scalarOpacityUnitDistance": 1.0,
                "lighting": {"ambient": 0.1, "diffuse": 0.9, "specular": 0.2, "specularPower": 10.0},
                "scalarOpacity": {"type": "piecewiseLinearFunction", "points": OPACITY.map(point)},
                "gradientOpacity": {"type": "piecewiseLinearFunction", "points": [point([0.0, 1.0]), point([255.0, 1.0])]},
                "rgbTransferFunction": {"type": "colorTransferFunction", "points": COLOURS.map(colour)},
            }],
        }],
    })
}

/// The same in the JSON of ParaView, which has no lighting.
fn paraview() -> serde_json::Value {
    let opacity: Vec<f64> = OPACITY.iter().flat_map(|&[value, height]| [value, height, 0.5, 0.0]).collect();
    json!([{"ColorSpace": "RGB", "Name": "CT-Bone", "NanColor": [1, 1, 0], "RGBPoints": COLOURS.as_flattened(), "Points": opacity}])
}

/// A ball of flesh around a core, in a cube whose values go from -3024 to 3071, and whose default unit distance in ParaView is 1.
fn cube() -> Vec<u8> {
    let voxel = |index: usize| -> i16 {
        let far =
            [index % 12, index / 12 % 12, index / 144].map(|at| (2 * at).abs_diff(11).pow(2)).iter().sum::<usize>();
        match far {
            0..20 => 3071,
            20..80 => 300,
            _ => -3024,
        }
    };
    let header = "NRRD0005\ntype: int16\ndimension: 3\nsizes: 12 12 12\nspacings: 0.577350269 0.577350269 0.577350269\n\
                  endian: little\nencoding: raw\n\n";
    header.bytes().chain((0..12 * 12 * 12).flat_map(|index| voxel(index).to_le_bytes())).collect()
}

/// Renders the cube by the preset `name`; returns the saved scene and the words.
fn scene_of(folder: &Folder, name: &str) -> (String, Outcome) {
    let scene = format!("{name}.toml");
    let arguments = ["render", "cube.nrrd", "--look", name, "--size", "16x16", "-o", "p.png", "--save-scene", &scene];
    let outcome = folder.done(&arguments);
    (std::fs::read_to_string(folder.path(&scene)).unwrap(), outcome)
}

/// A scene without its comments.
fn stated(text: &str) -> String {
    text.lines().filter(|line| !line.starts_with('#')).collect::<Vec<_>>().join("\n")
}

/// The value with all numbers as floats.
fn in_floats(value: &Value) -> Value {
    match value {
        #[expect(clippy::cast_precision_loss, reason = "small numbers of a page")]
        Value::Integer(number) => Value::Float(*number as f64),
        Value::Array(list) => Value::Array(list.iter().map(in_floats).collect()),
        Value::Table(table) => Value::Table(table.iter().map(|(key, value)| (key.clone(), in_floats(value))).collect()),
        other => other.clone(),
    }
}

#[test]
fn one_preset_in_three_formats_is_one_scene() {
    let folder = Folder::new().with("cube.nrrd", cube()).with("a.vp", vp(false));
    let folder = folder.with("b.vp.json", vp_json(false).to_string()).with("c.json", paraview().to_string());
    let scenes = ["a.vp", "b.vp.json", "c.json"].map(|name| {
        let (scene, outcome) = scene_of(&folder, name);
        assert!(outcome.err.contains(name) && outcome.err.contains("preset"), "{}", outcome.err);
        stated(&scene)
    });
    assert!(scenes[0].contains("shading = \"none\"") && scenes[0].contains("opacity_length = 1.0"), "{}", scenes[0]);
    assert_eq!(scenes[0], scenes[1]);
    assert_eq!(scenes[0], scenes[2]);
}

#[test]
fn ct_bone_is_the_scene_of_the_tutorial() {
    let folder =
        Folder::new().with("cube.nrrd", cube()).with("a.vp", vp(true)).with("b.json", vp_json(true).to_string());
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/tutorial/from-paraview-and-slicer.md");
    let page = std::fs::read_to_string(page).unwrap();
    let block = page.split("# ct-bone.toml\n").nth(1).unwrap().split("```").next().unwrap();
    let expected: Table = block.parse().unwrap();
    for name in ["a.vp", "b.json"] {
        let found: Table = scene_of(&folder, name).0.parse().unwrap();
        for key in ["transfer", "materials", "lights"] {
            assert_eq!(in_floats(&found[key]), in_floats(&expected[key]), "{name}: {key}");
        }
        assert!(!found.contains_key("shading"), "gradients shade it");
    }
}

#[test]
fn a_saved_scene_of_a_preset_renders_the_same_picture() {
    let folder = Folder::new().with("cube.nrrd", cube()).with("a.vp", vp(true));
    scene_of(&folder, "a.vp");
    folder.done(&["render", "a.vp.toml", "--size", "16x16", "-o", "q.png"]);
    let [first, again] = ["p.png", "q.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    assert!(first == again, "one picture");
}

#[test]
fn colours_of_paraview_spread_over_the_values() {
    let map = json!([{"ColorSpace": "Diverging", "Name": "Cool to Warm", "RGBPoints": [
        0.0, 0.231_373, 0.298_039, 0.752_941, 0.5, 0.865_003, 0.865_003, 0.865_003, 1.0, 0.705_882, 0.015_686_3, 0.149_02]}]);
    let steps = json!({"ColorSpace": "Step", "RGBPoints": [0, 1, 0, 0, 5, 0, 1, 0, 10, 0, 0, 1]});
    let folder = Folder::new().with("cube.nrrd", cube());
    let folder = folder.with("map.json", map.to_string()).with("steps.json", steps.to_string());
    let found: Table = scene_of(&folder, "map.json").0.parse().unwrap();
    let transfer = &found["transfer"];
    assert_eq!(transfer["opacity"].to_string(), "[[-3024.0, 0.0], [3071.0, 1.0]]", "ParaView's default");
    let points = transfer["material"].as_array().unwrap();
    assert!((5..40).contains(&points.len()), "colours between the three of the file: {points:?}");
    let has_middle = points.iter().any(|point| (point[0].as_float().unwrap() - 23.5).abs() < 1e-6);
    assert!(has_middle, "{points:?}");
    let found: Table = scene_of(&folder, "steps.json").0.parse().unwrap();
    let points = found["transfer"]["material"].as_array().unwrap();
    let names: Vec<&str> = points.iter().map(|point| point[1].as_str().unwrap()).collect();
    // An interval has its second colour.
    assert_eq!(names[names.len() - 2..], ["middle", "high"], "{points:?}");
}

#[test]
fn an_active_channel_of_omero_is_shown_in_its_window_and_colour() {
    let settings = json!({"version": 2, "greyscale": false, "channels": {
        "1": {"active": false, "color": "FF0000", "label": "DAPI", "start": 0.0, "end": 9.0},
        "2": {"active": true, "color": "00FF00", "label": "GFP", "start": 100.0, "end": 200.0, "min": 0.0, "max": 255.0}}});
    let folder = Folder::new().with("cube.nrrd", cube()).with("o.json", settings.to_string());
    let (scene, outcome) = scene_of(&folder, "o.json");
    assert!(outcome.err.contains("channel 2 (GFP) in o.json"), "{}", outcome.err);
    assert!(scene.contains("opacity = [[100.0, 0.0], [200.0,") && scene.contains("#00ff00"), "{scene}");
}

#[test]
fn a_file_that_is_no_preset_is_refused_by_name() {
    let whole = vp(true);
    let changed = |from: &str, to: &str| whole.replacen(from, to, 1);
    let two = json!([paraview()[0], paraview()[0]]).to_string();
    let named = |name: &str, words: &'static str, text: String| (name.to_owned(), words, text.into_bytes());
    let mut files = vec![
        named("empty.vp", "the file is empty", String::new()),
        named("text.vp", "text that begins with", "hello".to_owned()),
        named("presets.json", "XML", "<MRML></MRML>".to_owned()),
        named("set.yaml", "YAML", "version: 2\nchannels:\n  1:\n    active: true\n".to_owned()),
        named("other.json", "the keys a, b", "{\"a\": 1, \"b\": 2}".to_owned()),
        named("cut.vp", "ends after line 7 of 9", whole.lines().take(7).collect::<Vec<_>>().join("\n")),
        named("cut.json", "no valid JSON", paraview().to_string()[..90].to_owned()),
        named("order.vp", "not in order", changed("-16.4458", "-9999")),
        named("nan.vp", "not finite", changed("641.385", "nan")),
        named("none.vp", "no points", changed(&line(OPACITY.as_flattened()), "0")),
        named("count.vp", "states 9 numbers", changed("8 -3024", "9 -3024")),
        named("two.json", "2 presets (CT-Bone, CT-Bone)", two),
        named("categories.json", "categories", "[{\"Name\": \"a\", \"IndexedColors\": [1, 0, 0]}]".to_owned()),
        named("space.json", "ColorSpace", paraview().to_string().replace("\"RGB\"", "\"CMYK\"")),
        named("null.json", "no number", paraview().to_string().replace("641.385", "null")),
        named(
            "off.json",
            "no channel is active",
            "{\"channels\": {\"1\": {\"active\": false, \"start\": 0, \"end\": 1}}}".to_owned(),
        ),
        named("window.json", "no window", "{\"channels\": {\"1\": {\"color\": \"FF0000\"}}}".to_owned()),
        named("components.json", "no components", "{\"volumeProperties\": []}".to_owned()),
    ];
    files.push(("binary.vp".to_owned(), "not UTF-8", vec![0xff; 40]));
    files.push(("deep.json".to_owned(), "no valid JSON", vec![b'['; 100_000]));
    for (name, words, bytes) in files {
        let folder = Folder::new().with("cube.nrrd", cube()).with(&name, bytes);
        folder.refused(1, &["render", "cube.nrrd", "--look", &name, "-o", "p.png"], &[&name, words]);
    }
    let folder = Folder::new().with("cube.nrrd", cube()).with("a.vp", whole);
    folder.refused(
        1,
        &["render", "cube.nrrd", "--look", "none.vp", "-o", "p.png"],
        &["cannot read the preset none.vp"],
    );
    folder.refused(2, &["render", "scene.toml", "--look", "a.vp", "-o", "p.png"], &["--look", "without a scene"]);
    folder.refused(2, &["render", "cube.nrrd", "--look", "nothing", "-o", "p.png"], &["tissue, bone"]);
}
