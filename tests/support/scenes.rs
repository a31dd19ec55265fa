//! Small scenes, each testing one feature; every rung renders them.
//!
//! The ramps of their transfer functions are wide compared with a table entry, so that a table's error is given by its
//! second difference and not by the ramp's height. Their cameras look obliquely, so that no ray grazes the face it
//! enters.

use std::path::Path;
use std::sync::Arc;

use glam::{DMat3, DVec3};
use relume::document::{SceneOptions, parse};
use relume::progress::Quiet;
use relume::scene::{AccumulateAs, Integration, LabelEntry, LabelInterpolation, Labels, Scene};
use relume::spectrum::{Absorption, BANDS, Reflectance, Spectrum};
use relume::volume::{Geometry, Volume, Voxels};

/// Size of the pictures, width and height: not square, and no multiple of a workgroup.
pub const SIZE: [usize; 2] = [44, 36];

/// Names of the scenes.
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

/// Three nested layers by data value: a shell, a middle and a core.
const MATERIALS: &str = r#"
    [materials.core]
    reflectance = "blue sky"
    [materials.middle]
    reflectance = "orange"
    [materials.shell]
    reflectance = "foliage"
"#;

const TRANSFER: &str = r#"
    [transfer]
    opacity_length = 1
    [[transfer.intervals]]
    material = "shell"
    range = [9000, 13000]
    ramp = 6000
    opacity = 0.06
    [[transfer.intervals]]
    material = "middle"
    range = [22000, 30000]
    ramp = 6000
    opacity = 0.2
    [[transfer.intervals]]
    material = "core"
    range = [44000, 70000]
    ramp = 8000
    opacity = 0.6
"#;

const CAMERA: &str = "
    [camera]
    azimuth = 35
    elevation = 28
    fill = 1.8
";

/// Rays are marched to the end; early ray termination has its own test.
const ACCURACY: &str = "
    [accuracy]
    step = 0.7
    termination = 0
";

const KEY: &str = r#"
    [lights.key]
    spectrum = "D65"
    kind = "directional"
    direction = [-0.5, -0.8, -0.4]
"#;

/// Two more lights than [`KEY`], with other spectra and positions.
const MORE: &str = r#"
    [lights.head]
    spectrum = "FL11"
    intensity = 0.4
    [lights.lamp]
    spectrum = "A"
    intensity = 0.7
    kind = "point"
    position = [40, -5, 10]
"#;

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

/// Returns the scene `name` of [`NAMES`].
pub fn named(name: &str) -> Scene {
    let usual = |head: &str, lights: &str| of(&[head, MATERIALS, TRANSFER, CAMERA, ACCURACY, lights].concat(), balls());
    match name {
        "unshaded_one" => usual("shading = \"none\"", KEY),
        "unshaded_three" => usual("shading = \"none\"", &[KEY, MORE].concat()),
        "diffuse_one" => usual("", KEY),
        "diffuse_three" => usual("", &[KEY, MORE].concat()),
        "specular_one" => {
            let mut scene = usual("", "[lights.lamp]\nspectrum = \"A\"\nkind = \"point\"\nposition = [40, -30, -20]\n");
            for material in &mut scene.materials {
                (material.specular, material.exponent) = (0.5, 20);
            }
            scene
        }
        "specular_three" => {
            let sky = "[lights.sky]\nspectrum = \"D50\"\nkind = \"ambient\"\nintensity = 0.3\n";
            let mut scene = usual("", &[KEY, MORE, sky].concat());
            // With white, four materials need five components, one more than a lane. (Four coefficients of a colour
            // model would keep
            // the tolerance.)
            scene.accuracy.accumulate = AccumulateAs::Weights;
            let mut fourth = scene.materials[1].clone();
            fourth.name = "tip".into();
            fourth.reflectance = Reflectance::new(Spectrum::gaussian(610.0, 30.0, 0.9).unwrap()).unwrap();
            scene.materials.push(fourth);
            let mut term = scene.transfer.terms[1].clone();
            term.material.0 = vec![(20000.0, 1), (30000.0, 3)];
            scene.transfer.terms[1] = term;
            for (material, (specular, exponent)) in
                scene.materials.iter_mut().zip([(0.5, 12), (0.3, 7), (0.0, 20), (0.8, 33)])
            {
                (material.specular, material.exponent) = (specular, exponent);
            }
            scene
        }
        "xray" => {
            let mut scene = usual("shading = \"none\"", KEY);
            scene.materials[2].xray = true;
            scene
        }
        "labels" => labels(),
        "nearest_labels" => {
            let mut scene = labels();
            scene.accuracy.labels = LabelInterpolation::Nearest;
            scene
        }
        "background" => usual("shading = \"none\"\nbackground = \"moderate red\"", &[KEY, MORE].concat()),
        "orthographic" => {
            let camera = "[camera]\nprojection = \"orthographic\"\nazimuth = 35\nelevation = 28\nfill = 1.8\n";
            let head = "[lights.head]\nspectrum = \"FL2\"\n";
            of(&[MATERIALS, TRANSFER, camera, ACCURACY, head].concat(), balls())
        }
        "inside" => {
            let camera = "[camera]\nfov = 70\nposition = [27.3, 6.1, 20.2]\ntarget = [13, 15, 12]\n";
            of(&[MATERIALS, TRANSFER, camera, ACCURACY, KEY].concat(), balls())
        }
        "negative" => {
            let mut scene = usual("", KEY);
            let wave = |band: usize| 0.4 + 0.9 * (float(band) * 0.35).sin();
            scene.materials[0].reflectance =
                Reflectance::new(Spectrum::from_samples(std::array::from_fn::<_, BANDS, _>(wave))).unwrap();
            scene
        }
        "cropped" => usual("crop = { min = [10.5, 3.25, 4.5], max = [22.5, 20, 13] }", KEY),
        "rotated" => {
            let mut scene = usual("", &[KEY, MORE].concat());
            let mut volume = balls();
            // Axes are nearly permuted, so that the camera still looks obliquely.
            let direction = DMat3::from_euler(glam::EulerRot::XYZ, 1.67, 0.1, 1.47);
            volume.geometry =
                Geometry::new("rotated", volume.geometry.dims, DVec3::new(0.8, 1.0, 1.7), DVec3::splat(5.0), direction)
                    .unwrap();
            scene.set_volume(Arc::new(volume));
            scene
        }
        "nearest" => {
            let mut scene = usual("", KEY);
            scene.accuracy.interpolation = relume::scene::Interpolation::Nearest;
            scene.transfer.lookup = relume::scene::Lookup::Nearest;
            scene
        }
        "ambient_only" => {
            // Shading does not depend on the gradient, yet directional and ambient lights differ.
            let sky = "[lights.sky]\nspectrum = \"A\"\nkind = \"ambient\"\nintensity = 0.3\n";
            let mut scene = usual("", &[KEY, sky].concat());
            for (material, ambient) in scene.materials.iter_mut().zip([0.5, 0.2, 0.9]) {
                (material.ambient, material.diffuse) = (ambient, 0.0);
            }
            scene
        }
        "coloured_one" => glass("", KEY, ""),
        "coloured_three" => {
            let sky = "[lights.sky]\nspectrum = \"D50\"\nkind = \"ambient\"\nintensity = 0.3\n";
            let mut scene = glass("background = 0.7", &[KEY, MORE, sky].concat(), "");
            for (material, (specular, exponent)) in scene.materials.iter_mut().zip([(0.5, 12), (0.3, 7), (0.0, 20)]) {
                (material.specular, material.exponent) = (specular, exponent);
            }
            // Shading coefficients that differ between materials.
            (scene.materials[0].ambient, scene.materials[0].diffuse) = (0.5, 0.4);
            scene
        }
        "coloured_labels" => {
            let mut scene = labels();
            let declared = &mut scene.labels.as_mut().unwrap().declared;
            for (entry, depth) in declared.iter_mut().zip([0.4, 0.1]) {
                entry.absorption = depth;
            }
            for (material, centre) in scene.materials.iter_mut().zip([470.0, 540.0, 640.0]) {
                material.absorption = Some(absorbing(centre));
            }
            scene.transfer.terms[0].absorption = vec![(30.0, 0.0), (60.0, 0.05), (120.0, 0.05), (150.0, 0.0)];
            scene
        }
        "coloured_background" => glass("shading = \"none\"\nbackground = \"yellow green\"", &[KEY, MORE].concat(), ""),
        "coloured_xray" => {
            let mut scene = glass("shading = \"none\"", KEY, "");
            scene.materials[2].xray = true;
            scene
        }
        "sharpened" => glass("background = 0.7", KEY, "model = \"sharpened\"\nk = 6"),
        "sharpened_semigroup" => glass("background = 0.7", KEY, "model = \"sharpened-semigroup\"\nk = 6"),
        _ => panic!("there is no scene {name}"),
    }
}

/// Nested glass shells, each of which absorbs other wavelengths.
fn glass(head: &str, lights: &str, accuracy: &str) -> Scene {
    let materials = MATERIALS.lines().map(|line| {
        let absorption = |centre| {
            format!(
                "{line}\nabsorption = {{ gaussian = [{{ centre = {centre}, sigma = 40, height = 1 }}], base = 0.05 }}"
            )
        };
        match line.trim() {
            "reflectance = \"blue sky\"" => absorption(470.0),
            "reflectance = \"orange\"" => absorption(540.0),
            "reflectance = \"foliage\"" => absorption(640.0),
            _ => line.to_owned(),
        }
    });
    let transfer = TRANSFER.replace("opacity = 0.06", "opacity = 0.02\nabsorption = 0.15");
    let transfer = transfer.replace("opacity = 0.2", "opacity = 0.05\nabsorption = 0.2");
    let transfer = transfer.replace("opacity = 0.6", "opacity = 0.15\nabsorption = 0.3");
    let materials: String = materials.map(|line| line + "\n").collect();
    let accuracy = [ACCURACY, accuracy, "\n"].concat();
    of(&[head, &materials, &transfer, CAMERA, &accuracy, lights].concat(), balls())
}

/// Absorption spectrum with a peak at `centre` nm.
fn absorbing(centre: f64) -> Absorption {
    let band = &Spectrum::gaussian(centre, 40.0, 1.0).unwrap() + &Spectrum::constant(0.05);
    Absorption::new(band).unwrap()
}

/// Frog phantom with the skin by value and two organs by label.
fn labels() -> Scene {
    let dims = Some([36, 34, 20]);
    let text = r#"
        [materials.bone]
        reflectance = "white 9.5"
        [materials.organ]
        reflectance = "moderate red"
        [materials.skin]
        reflectance = "foliage"
        [transfer]
        opacity_length = 1
        [[transfer.intervals]]
        material = "skin"
        range = [60, 120]
        ramp = 30
        opacity = 0.1
    "#;
    let volume = Volume::phantom(relume::volume::Phantom::Frog, dims).unwrap();
    let labels = Volume::frog_labels(dims).unwrap();
    let mut scene = of(&[text, CAMERA, ACCURACY, KEY].concat(), volume);
    let entry = |label, name: &str, material, opacity| LabelEntry {
        label,
        name: name.into(),
        material,
        opacity,
        absorption: 0.0,
    };
    // Two of the phantom's labels; the others are undeclared and follow the transfer function.
    let declared = vec![entry(1, "first", 1, 0.3), entry(2, "second", 0, 0.7)];
    scene.labels = Some(Labels { volume: Arc::new(labels), declared });
    scene
}

/// Converts a small count to f64.
pub fn float(n: usize) -> f64 {
    f64::from(u32::try_from(n).unwrap())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "rounded to 16 bits, casts saturate")]
fn code(value: f64) -> u16 {
    value.round() as u16
}
