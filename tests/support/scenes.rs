//! Scenes of the list in `tests/scenes.toml`, and others with a closed form.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Arc, LazyLock};

use glam::DVec3;
use relume::document::{Definition, SceneOptions, parse};
use relume::progress::Quiet;
use relume::scene::{Integration, Scene};
use relume::volume::{Geometry, Volume, Voxels};

/// Size of the pictures, width and height: not square, and no multiple of a workgroup.
pub const SIZE: [usize; 2] = [44, 36];

/// Names of the scenes with golden images.
pub const NAMES: &[&str] = &[
    "unshaded_one",
    "unshaded_three",
    "diffuse_one",
    "diffuse_three",
    "specular_one",
    "specular_three",
    "xray",
    "labels",
    "nearest_labels",
    "background",
    "orthographic",
    "inside",
    "negative",
    "cropped",
    "rotated",
    "nearest",
    "ambient_only",
    "coloured_one",
    "coloured_three",
    "coloured_labels",
    "coloured_background",
    "coloured_xray",
    "sharpened",
    "sharpened_semigroup",
];

/// Two kinds of coloured glass and a shiny material, lit from two positions, in front of a background.
pub const GLASS: &str = r#"
version = 1
background = 0.6
[volume]
phantom = "gaussian"
dims = [32, 32, 32]
[materials.red]
reflectance = "dark skin"
absorption = { gaussian = [{ centre = 480, sigma = 40, height = 1.0 }] }
[materials.green]
reflectance = "foliage"
absorption = { gaussian = [{ centre = 620, sigma = 30, height = 1.0 }], base = 0.1 }
ambient = 0.4
diffuse = 0.5
specular = 0.3
exponent = 12
[materials.shiny]
reflectance = 0.5
specular = 0.2
exponent = 5
[[transfer.intervals]]
material = "red"
range = [0.05, 0.3]
ramp = 0.05
opacity = 0.02
absorption = 0.15
[[transfer.intervals]]
material = "green"
range = [0.4, 0.7]
ramp = 0.05
opacity = 0.05
absorption = 0.2
[[transfer.intervals]]
material = "shiny"
range = [0.8, 1.0]
ramp = 0.05
opacity = 0.3
[lights.key]
spectrum = "D65"
kind = "directional"
direction = [0.3, -0.8, -0.6]
[lights.fill]
spectrum = "FL11"
kind = "ambient"
intensity = 0.3
[accuracy]
termination = 0
"#;

/// The list: bases and scenes.
#[derive(serde::Deserialize)]
struct List {
    bases: BTreeMap<String, String>,
    scenes: BTreeMap<String, Row>,
}

/// A scene of the list.
#[derive(Debug, serde::Deserialize)]
pub struct Row {
    /// The scene or base that it changes.
    from: String,
    /// The features of its plan.
    pub plan: String,
    /// `key.path = value`, one a line.
    #[serde(default)]
    changes: String,
}

static LIST: LazyLock<List> = LazyLock::new(|| toml::from_str(include_str!("../scenes.toml")).unwrap());

/// All scenes of the list.
pub fn all() -> &'static BTreeMap<String, Row> {
    &LIST.scenes
}

/// The base of the scene `name`, and the definitions that change it.
fn derived(name: &str) -> (&str, Vec<Definition>) {
    let Some(row) = LIST.scenes.get(name) else {
        return (name, Vec::new());
    };
    let (base, mut definitions) = derived(&row.from);
    definitions.extend(row.changes.lines().map(Definition::new));
    (base, definitions)
}

/// Returns the scene `name` of the list.
pub fn named(name: &str) -> Scene {
    changed(name, "")
}

/// Returns the scene `name` of the list with further `changes`, one a line.
pub fn changed(name: &str, changes: &str) -> Scene {
    let (base, mut definitions) = derived(name);
    definitions.extend(changes.lines().map(Definition::new));
    let options = SceneOptions { definitions, ..SceneOptions::default() };
    let text = if base == "glass" { GLASS } else { &LIST.bases[base] };
    let file = parse(name, text, Path::new(""), &options, &Quiet);
    let scene = file.unwrap_or_else(|error| panic!("{name}: {error:?}")).scene;
    let voxels = match base {
        "balls" => balls().voxels,
        "occluded" => occluder().voxels,
        _ => return scene,
    };
    let volume = Volume::new("sampled", voxels, scene.frame.geometry).unwrap();
    let further = scene.fields.further().to_vec();
    let mut scene = scene.with_volume(Arc::new(volume));
    scene.fields = scene.fields.with(further);
    scene
}

/// Parses the scene `text`.
pub fn parsed(text: &str) -> Scene {
    parse("the test's scene", text, Path::new(""), &SceneOptions::default(), &Quiet)
        .unwrap_or_else(|error| panic!("{error:?}\n{text}"))
        .scene
}

/// Parses the scene `text` and replaces its volume with `volume`.
pub fn of(text: &str, volume: Volume) -> Scene {
    // A crop box is checked against the dimensions of the file's own volume, which are therefore the same.
    let text = format!("version = 1\n{text}\n[volume]\nphantom = \"slab\"\ndims = {:?}\n", volume.geometry.dims);
    parsed(&text).with_volume(Arc::new(volume))
}

/// Slab with one value, 24 units thick, seen along its normal by parallel rays: equal steps with
/// `α = 1 − (1 − o)^Δs`, of which a part of the last is inside. `material` adds properties to its orange material.
pub fn slab_straight_on(step: f64, opacity: f64, material: &str) -> Scene {
    let text = format!(
        r#"
        shading = "none"
        [materials.only]
        reflectance = "orange"
        {material}
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "only"
        range = [100, 200]
        opacity = {opacity}
        [lights.day]
        spectrum = "D65"
        [camera]
        projection = "orthographic"
        height = 4
        position = [8, 8, -10]
        target = [8, 8, 0]
        [accuracy]
        step = {step}
        termination = 0
    "#
    );
    of(&text, slab([17, 17, 25], 150))
}

/// Slab with one value, 64 units thick, that scatters and absorbs, in front of `background`, seen along its normal by
/// parallel rays; `accuracy` adds accuracy settings.
pub fn glass_straight_on(background: &str, accuracy: &str) -> Scene {
    parsed(&format!(
        r#"
        version = 1
        shading = "none"
        background = {background}
        [volume]
        phantom = "slab"
        dims = [3, 3, 65]
        [materials.glass]
        reflectance = "orange"
        absorption = {{ gaussian = [{{ centre = 560, sigma = 50, height = 1.0 }}], base = 0.05 }}
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "glass"
        range = [-1e9, 1e9]
        opacity = 0.02
        absorption = 0.04
        [lights.day]
        spectrum = "D65"
        kind = "ambient"
        [camera]
        projection = "orthographic"
        height = 1
        azimuth = 0
        elevation = 0
        [accuracy]
        termination = 0
        {accuracy}
        "#
    ))
}

/// Samples `value(x, y, z)` in 16 bits, with every axis from −1 to 1 and spacing 1.
pub fn sampled(dims: [usize; 3], value: impl Fn(DVec3) -> f64) -> Volume {
    let place = |i: usize, n: usize| if n == 1 { 0.0 } else { 2.0 * float(i) / float(n - 1) - 1.0 };
    let [nx, ny, nz] = dims;
    let mut voxels = Vec::new();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                voxels.push(code(value(DVec3::new(place(x, nx), place(y, ny), place(z, nz)))));
            }
        }
    }
    Volume::new("sampled", Voxels::U16(voxels), Geometry::unit("sampled", dims).unwrap()).unwrap()
}

/// Two touching soft balls.
pub fn balls() -> Volume {
    let ball = |p: DVec3, centre: DVec3, width: f64| (-(p - centre).length_squared() / (2.0 * width * width)).exp();
    sampled([32, 28, 26], |p| {
        60000.0 * ball(p, DVec3::new(-0.2, 0.1, 0.0), 0.33) + 30000.0 * ball(p, DVec3::new(0.5, -0.35, 0.2), 0.24)
    })
}

/// A small ball above a large one.
pub fn occluder() -> Volume {
    let ball = |p: DVec3, centre: DVec3, width: f64| (-(p - centre).length_squared() / (2.0 * width * width)).exp();
    sampled([25, 25, 40], |p| {
        let small = ball(p, DVec3::new(0.0, -0.2, 0.7), 0.25);
        60000.0 * ball(p, DVec3::new(0.0, 0.0, -0.4), 0.4) * f64::from(p.z < 0.3)
            + 60000.0 * small * f64::from(p.z > 0.4)
    })
}

/// Volume with one value.
pub fn slab(dims: [usize; 3], value: u16) -> Volume {
    sampled(dims, |_| f64::from(value))
}

/// Returns `scene`, integrated in segments.
pub fn in_segments(mut scene: Scene) -> Scene {
    scene.accuracy.integration = Integration::Segments;
    scene
}

/// Returns the scenes `names` of [`NAMES`], each integrated in samples and in segments, with a name for messages.
pub fn both_ways(names: &[&str]) -> Vec<(String, Scene)> {
    let both = |&name: &&str| {
        let mut samples = named(name);
        samples.accuracy.integration = Integration::Samples;
        [(name.to_owned(), samples), (format!("{name} in segments"), in_segments(named(name)))]
    };
    names.iter().flat_map(both).collect()
}

/// Converts a small count to f64.
pub fn float(n: usize) -> f64 {
    f64::from(u32::try_from(n).unwrap())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded to 16 bits, casts saturate")]
fn code(value: f64) -> u16 {
    value.round() as u16
}
