//! Film files of a colour model: contents, files of other programs, relighting, and invalid files.

use crate::support;

use std::path::Path;

use exr::prelude::attribute::AttributeValue;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
    ReadChannels as _, ReadLayers as _, Text, Vec2, WritableImage as _, read,
};
use glam::DVec3;
use relume::model::{Ingredients, ModelKind, Order, fit, unseen};
use relume::output::film::{Components, Light, Position, Stored};
use relume::output::{BANDS, FilmFile};
use relume::progress::Quiet;
use relume::scene::Mix;
use relume::scene::Placement;
use relume::spectrum::colour::{XYZ_FROM_LINEAR_SRGB, xyz_of};
use relume::spectrum::{Spectrum, standard};

use support::exr::{Exr, damage};
use support::program::{Folder, Outcome};
use support::rungs::Rungs;
use support::scenes::{GLASS, parsed};

const KINDS: [(ModelKind, usize); 5] = [
    (ModelKind::Nodes, 3),
    (ModelKind::Sharpened(Order::Step), 4),
    (ModelKind::Sharpened(Order::Semigroup), 2),
    (ModelKind::Bands, 5),
    (ModelKind::Rgb, 3),
];

fn ingredients() -> Ingredients {
    let patch = |name| standard::reflectance(name).unwrap().spectrum().clone();
    Ingredients {
        reflectances: vec![patch("orange"), patch("foliage")],
        absorptions: vec![Spectrum::gaussian(520.0, 30.0, 1.0).unwrap()],
        lights: ["A", "D65"].map(|name| (name.to_owned(), standard::light(name).unwrap())).to_vec(),
        largest_depth: 3.0,
        ..Ingredients::default()
    }
}

/// Example for every kind of model, with grey or coloured transmittance.
fn example(kind: ModelKind, dimension: usize, coloured: bool) -> FilmFile {
    let Ingredients { lights, .. } = ingredients();
    let model = fit(&ingredients(), kind, dimension, &Quiet).unwrap();
    let (width, height) = (5, 19);
    let number = |index: usize| f32::from(u16::try_from(index % 251).unwrap()) / 251.0;
    let numbers = if coloured { dimension } else { 1 };
    let light = |(index, (name, light)): (usize, &(String, relume::spectrum::Light))| Light {
        name: name.clone(),
        position: 1 - index,
        weight: 0.5,
        shown: None,
        spectrum: *light.spectrum().samples(),
    };
    FilmFile {
        positions: vec![
            Position { name: "transmittance".to_owned(), placement: Placement::Ambient, shadows: false },
            Position {
                name: "key.0".to_owned(),
                placement: Placement::Point(DVec3::from_array([1.0, 2.0, 3.0])),
                shadows: false,
            },
        ],
        lights: lights.iter().enumerate().map(light).collect(),
        background: Some([0.25; BANDS]),
        exposure: Some(2.0),
        accumulators: (0..2 * dimension * width * height).map(number).collect(),
        transmittance: (0..numbers * width * height).map(|index| number(index + 7)).collect(),
        ..FilmFile::empty([width, height], Components::Model(Stored { model, coloured, tolerance: 0.7 }))
    }
}

#[test]
fn a_model_comes_back_to_the_bit_and_fits_new_lights_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("acc.exr");
    let newcomer = standard::light("FL11").unwrap();
    for (kind, dimension) in KINDS {
        for (coloured, checked) in [(false, true), (true, false)] {
            let mut written = example(kind, dimension, coloured);
            if let (true, Components::Model(stored)) = (checked, &mut written.components) {
                stored.model.check_on(&unseen(&ingredients()).unwrap()).unwrap();
            }
            written.write(&path).unwrap();
            let found = FilmFile::read(&path).unwrap();
            assert!(found == written, "{kind}, coloured {coloured}, checked {checked}");
            let model = |it: FilmFile| match it.components {
                Components::Model(stored) => stored.model,
                Components::Surfaces(_) => panic!("a model was written"),
            };
            let [mut found, mut written] = [found, written].map(model);
            for model in [&mut found, &mut written] {
                model.learn("FL11", &newcomer).unwrap();
            }
            assert_eq!(found.matrix(&newcomer).unseen.is_some(), checked, "{kind}");
            assert!(found == written, "{kind}: one light more, and its error");
        }
    }
}

#[test]
fn the_parts_of_a_file_are_those_that_are_documented() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("acc.exr");
    for (kind, dimension) in [(ModelKind::Nodes, 3), (ModelKind::Bands, 5)] {
        let written = example(kind, dimension, true);
        written.write(&path).unwrap();
        let Components::Model(Stored { model, .. }) = &written.components else { panic!("a model") };
        let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
        let image = image.from_file(&path).unwrap();
        let spectra = model.cloud().len();
        let mut expected = vec![("accumulators", (5, 19)), ("cloud", (81, spectra))];
        if kind == ModelKind::Bands {
            expected.push(("coefficients", (dimension, spectra)));
        }
        let found = image
            .layer_data
            .iter()
            .map(|layer| (layer.attributes.layer_name.as_ref().unwrap().to_string(), (layer.size.0, layer.size.1)));
        let expected: Vec<_> = expected.into_iter().map(|(name, size)| (name.to_owned(), size)).collect();
        assert_eq!(found.collect::<Vec<_>>(), expected);
        let values = |layer: usize, name: &str| -> Vec<f64> {
            let channels = &image.layer_data[layer].channel_data.list;
            let channel = channels.iter().find(|channel| channel.name == *name).unwrap();
            channel.sample_data.values_as_f32().map(f64::from).collect()
        };
        let narrow = |numbers: &[f32]| numbers.iter().copied().map(f64::from).collect::<Vec<_>>();
        assert_eq!(values(0, "key.0.1"), narrow(&written.accumulators[(dimension + 1) * 95..][..95]));
        assert_eq!(values(0, "transmittance.0"), narrow(&written.accumulators[..95]));
        assert_eq!(values(0, "transmittance_2"), narrow(&written.transmittance[2 * 95..][..95]));
        assert_eq!(values(1, "spectrum")[81..162], model.cloud()[1].samples()[..]);
        if kind == ModelKind::Bands {
            assert_eq!(values(2, "coefficient")[dimension..][..dimension], model.cloud_vectors()[1]);
        }
    }
}

// ---- files of other programs ----

type Part = (&'static str, (usize, usize), Vec<(&'static str, Vec<f32>)>);

/// Writes a file from the documentation alone, without this program's code.
fn write_by_hand(path: &Path, text: &str, parts: &[Part]) {
    let layers = parts.iter().enumerate().map(|(index, (name, size, channels))| {
        let mut attributes = LayerAttributes::named(*name);
        if index == parts.len() - 1 {
            attributes.other.insert("relume".into(), AttributeValue::Text(Text::new_or_panic(text)));
        }
        let list = channels.iter().map(|(name, values)| AnyChannel::new(*name, FlatSamples::F32(values.clone())));
        Layer::new(*size, attributes, Encoding::SMALL_LOSSLESS, AnyChannels::sort(list.collect()))
    });
    let bounds = IntegerBounds::from_dimensions(parts[parts.len() - 1].1);
    Image::from_layers(ImageAttributes::new(bounds), layers.collect::<Vec<_>>()).write().to_file(path).unwrap();
}

/// 1 at wavelengths of at least `nm`, else 0.
fn step(nm: usize) -> Vec<f32> {
    (0..BANDS).map(|band| f32::from(u8::from(380 + 5 * band >= nm))).collect()
}

fn row(numbers: &[f32]) -> String {
    let numbers: Vec<String> = numbers.iter().map(|number| format!("{number:?}")).collect();
    format!("[{}]", numbers.join(", "))
}

/// Two nodes, at 500 and 600 nm, a lamp with its own matrix, and another light without one.
fn small_text() -> String {
    let node = |nm: usize| step(nm).iter().zip(step(nm + 5)).map(|(here, next)| here - next).collect::<Vec<_>>();
    let ones = row(&[1.0; BANDS]);
    format!(
        "version = 2\nbackground = {}\n[model]\nkind = \"nodes\"\ntransmittance = \"coloured\"\n\
         projection = [{}, {}]\n[[positions]]\nname = \"key\"\nkind = \"headlight\"\n\
         [[lights]]\nname = \"lamp\"\nposition = \"key\"\nweight = 2.0\nspectrum = {ones}\n\
         matrix = [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]\nerror = {{ mean = 0.0, p95 = 0.0, max = 0.0 }}\n\
         [[lights]]\nname = \"red\"\nposition = \"key\"\nweight = 1.0\nspectrum = {}\n",
        row(&[0.5; BANDS]),
        row(&node(500)),
        row(&node(600)),
        row(&step(600)),
    )
}

/// Three spectra with two degrees of freedom, and two pixels.
fn small_parts() -> Vec<Part> {
    let half: Vec<f32> = step(550).iter().map(|share| 0.5f32.mul_add(-share, 0.75)).collect();
    let cloud = [vec![1.0; BANDS], step(550), half].concat();
    let picture = vec![
        ("key.0", vec![0.25, 0.0]),
        ("key.1", vec![0.25, 0.5]),
        ("transmittance_0", vec![0.0, 0.5]),
        ("transmittance_1", vec![0.0, 0.25]),
    ];
    vec![("cloud", (BANDS, 3), vec![("spectrum", cloud)]), ("anything", (2, 1), picture)]
}

/// XYZ of the picture of `relight` on `name`, without a Vulkan device, and the program's output.
fn relit(folder: &Folder, name: &str, lights: &[&str]) -> (Vec<DVec3>, Outcome) {
    let arguments = [&["relight", name, "-o", "picture.exr", "--json"], lights].concat();
    let mut command = folder.command(&arguments);
    let outcome = Outcome::of(command.env("VK_DRIVER_FILES", "/dev/null").env("VK_ICD_FILENAMES", "/dev/null"));
    assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    (xyz(&folder.path("picture.exr")), outcome)
}

/// XYZ of every pixel of a linear picture.
fn xyz(path: &Path) -> Vec<DVec3> {
    let picture = Exr::read(path);
    let [r, g, b] = ["R", "G", "B"].map(|name| &picture.channels[name]);
    let pixels = r.iter().zip(g).zip(b);
    pixels.map(|((&r, &g), &b)| *XYZ_FROM_LINEAR_SRGB * DVec3::new(r.into(), g.into(), b.into())).collect()
}

/// Tolerance of issue 3: 1e-5 of the value, and 1e-6 of white.
fn assert_same_xyz(what: &str, found: &[DVec3], expected: &[DVec3]) {
    assert_eq!(found.len(), expected.len(), "{what}");
    assert!(expected.iter().any(|colour| colour.max_element() > 0.01), "{what}: a black picture shows nothing");
    for (found, expected) in found.iter().zip(expected) {
        let within = (*found - *expected).abs().cmple(expected.abs() * 1e-5 + DVec3::splat(1e-6));
        assert!(within.all(), "{what}: {found} for {expected}");
    }
}

#[test]
fn a_file_that_another_program_wrote_is_relit() {
    let folder = Folder::new().with("flat.csv", "380 1\n780 1\n");
    write_by_hand(&folder.path("hand.exr"), &small_text(), &small_parts());
    // The lamp's own matrix, twice: for the scattered light, and for half of the transmitted light.
    let (found, outcome) = relit(&folder, "hand.exr", &["--light", "lamp"]);
    let (w0, w1) = (2.0 * DVec3::new(0.1, 0.2, 0.3), 2.0 * DVec3::new(0.4, 0.5, 0.6));
    assert_same_xyz("lamp", &found, &[0.25 * w0 + 0.25 * w1, 0.5 * w1 + 0.5 * (0.5 * w0 + 0.25 * w1)]);
    assert_eq!(outcome.err, "");
    // Other lights are fitted, exactly because the cloud has two degrees of freedom.
    for (name, light) in [("A", "A"), ("FL11", "FL11"), ("blackbody 4000", "blackbody 4000")] {
        let light = if light == "blackbody 4000" {
            relume::spectrum::Light::blackbody(4000.0).unwrap()
        } else {
            standard::light(light).unwrap()
        };
        let (found, outcome) = relit(&folder, "hand.exr", &["--light", &format!("{name}@key")]);
        let colour = |low: f64, high: f64| {
            let spectrum = Spectrum::from_fn(|nm| if nm >= 550.0 { high } else { low });
            DVec3::from_array(xyz_of(&(light.spectrum() * &spectrum)).0)
        };
        let transmitted = colour(0.5 * 0.5, 0.25 * 0.5);
        assert_same_xyz(name, &found, &[colour(0.25, 0.25), colour(0.0, 0.5) + transmitted]);
        // In place of the lamp of weight 2 and the red light of weight 1, it is as bright as both.
        let (in_place, _) = relit(&folder, "hand.exr", &["--light", name]);
        let thrice: Vec<DVec3> = found.iter().map(|colour| 3.0 * *colour).collect();
        assert_same_xyz(name, &in_place, &thrice);
        let json = outcome.json();
        let lights = json["model"]["lights"].as_array().unwrap();
        let new = lights.iter().find(|light| light["planned"] == false).unwrap();
        assert!(new["name"] == name && new["max"].as_f64().unwrap() < 1e-3, "{json}");
    }
    // A light of the file without a matrix is fitted too, and a mix is a sum.
    let (mix, _) = relit(&folder, "hand.exr", &[]);
    let (lamp, _) = relit(&folder, "hand.exr", &["--light", "lamp"]);
    let (red, _) = relit(&folder, "hand.exr", &["--light", "red"]);
    let sum: Vec<DVec3> = lamp.iter().zip(&red).map(|(one, other)| *one + *other).collect();
    assert_same_xyz("mix", &mix, &sum);
    let text = folder.done(&["info", "hand.exr"]).out;
    assert!(text.contains("2 nodes (500, 600 nm)") && text.contains("transmittance is coloured"), "{text}");
    let json = folder.done(&["info", "hand.exr", "--json"]).json();
    assert_eq!((&json["model"]["k"], &json["model"]["nodes_nm"][1]), (&2.into(), &600.0.into()));
}

#[test]
fn hostile_files_are_refused_in_one_sentence() {
    let folder = Folder::new();
    let good = small_text();
    let one_row = |text: &str| {
        let (start, end) = (text.find("projection").unwrap(), text.find("[[positions]]").unwrap());
        (text[..start].to_owned(), text[end..].to_owned())
    };
    let rows = |count: usize| {
        let (before, after) = one_row(&good);
        format!("{before}projection = [{}]\n{after}", vec![row(&[1.0; BANDS]); count].join(", "))
    };
    let bands = good.replace("kind = \"nodes\"", "kind = \"bands\"");
    for (text, reason) in [
        (good.replace("version = 2", "version = 1"), "a file with a `[model]` needs the version 2"),
        (rows(0), "has 0 coefficients"),
        (rows(32), "has 32 coefficients"),
        (rows(2), "a single wavelength"),
        (good.replacen("[0.0, 0.0", "[0.0", 1), "row 0 of `projection` has 80 numbers"),
        (good.replacen("[0.0, 0.0", "[nan, 0.0", 1), "\"projection\" holds NaN"),
        (good.replacen("[0.0, 0.0", "[1e300, 0.0", 1), "row 0 of `projection` holds 1e300"),
        (good.replace("\"nodes\"", "\"knots\""), "there is no colour model \"knots\""),
        (good.replace("kind = \"nodes\"", "kind = \"rgb\""), "rgb cannot have 2"),
        (good.replace("\"coloured\"", "\"tinted\""), "unknown variant `tinted`"),
        (good.replace("[0.1, 0.2, 0.3], ", ""), "the matrix of the light \"lamp\" has 1 columns, not 2"),
        (good.replace("[0.1, 0.2, 0.3]", "[0.1, inf, 0.3]"), "the matrix of the light \"lamp\" holds inf"),
        (good.replace("max = 0.0", "max = nan"), "the error of the light \"lamp\" holds NaN"),
        (good.replace("error = { mean = 0.0, p95 = 0.0, max = 0.0 }\n", ""), "needs both `matrix` and `error`"),
        (good.replace("[model]", "[model]\ntolerance = nan"), "\"tolerance\" holds NaN"),
        (
            format!("{good}[[components]]\nname = \"x\"\nspectrum = {}\n", row(&[1.0; BANDS])),
            "cannot have `[[components]]`",
        ),
        (bands, "the part \"coefficients\" is missing"),
    ] {
        let parts = if reason.contains("rgb") { with_coefficients(2, 3) } else { small_parts() };
        write_by_hand(&folder.path("hand.exr"), &text, &parts);
        folder.refused(1, &["relight", "hand.exr", "-o", "p.png"], &[reason]);
    }
    let changed = |change: &dyn Fn(&mut Vec<Part>)| {
        let mut parts = small_parts();
        change(&mut parts);
        parts
    };
    let bands = good.replace("kind = \"nodes\"", "kind = \"bands\"");
    let red = |spectrum: &str| format!("weight = 1.0\nspectrum = {spectrum}");
    let huge = good.replace(&red(&row(&step(600))), &red(&format!("[{}]", vec!["-1e308"; BANDS].join(", "))));
    assert!(huge != good, "the light was replaced");
    let extra: Part = ("more", (1, 1), vec![("x", vec![0.0])]);
    let large: Part = ("cloud", (BANDS, 20_000), vec![("spectrum", vec![0.5; BANDS * 20_000])]);
    for (text, parts, reason) in [
        (&good, changed(&|it| drop(it.remove(0))), "the part \"cloud\" is missing"),
        (&good, changed(&|it| it.insert(0, extra.clone())), "it has 3 parts, and 2 belong"),
        (&good, changed(&|it| it[0].2[0].0 = "spectra"), "its channel \"spectra\" of the part \"cloud\" is unknown"),
        (
            &good,
            changed(&|it| it[0].2[0].1[100] = f32::NAN),
            "of the part \"cloud\" has no finite value at pixel (19, 1)",
        ),
        (&good, changed(&|it| it[0].1 = (3, BANDS)), "its part \"cloud\" is 3 pixels wide, not 81"),
        (&good, changed(&|it| it[0] = large.clone()), "20000 spectra; the limits are 1 to 16384"),
        (&good, changed(&|it| drop(it[1].2.remove(1))), "the channel \"key.1\" is missing"),
        (&good, changed(&|it| drop(it[1].2.remove(3))), "the channel \"transmittance_1\" is missing"),
        (
            &good,
            changed(&|it| it[1].2[2].1[1] = f32::INFINITY),
            "\"transmittance_0\" has no finite value at pixel (1, 0)",
        ),
        (&huge, changed(&|it| it[0].2[0].1.fill(3e38)), "a fitted colour is not finite"),
        (&bands, with_coefficients(3, 3), "its part \"coefficients\" is 3 pixels wide, not 2"),
        (&bands, with_coefficients(2, 4), "its part cloud has 3 spectra, and coefficients has 4 rows"),
    ] {
        write_by_hand(&folder.path("hand.exr"), text, &parts);
        folder.refused(1, &["relight", "hand.exr", "-o", "p.png"], &[reason]);
    }
}

/// The small file with this many coefficients of this many spectra.
fn with_coefficients(dimension: usize, spectra: usize) -> Vec<Part> {
    let mut parts = small_parts();
    parts.insert(1, ("coefficients", (dimension, spectra), vec![("coefficient", vec![0.5; dimension * spectra])]));
    parts
}

#[test]
fn no_damage_to_a_file_of_several_parts_is_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hand.exr");
    write_by_hand(&path, &small_text().replace("\"nodes\"", "\"bands\""), &with_coefficients(2, 3));
    damage(&path, || FilmFile::read(&path).is_ok());
}

// ---- files of this program ----

/// Models with coefficients in their films, with coloured and with grey transmittance.
const KEPT: [(&str, &[&str]); 5] = [
    ("glass.toml", &[]),
    ("glass.toml", &["--k", "5", "--model", "bands"]),
    ("glass.toml", &["--k", "6", "--model", "sharpened"]),
    ("glass.toml", &["--k", "3", "--model", "rgb"]),
    ("scene.toml", &["--accumulate", "spectral", "-D", "background=0.3"]),
];

const LIGHTS: [&[&str]; 4] =
    [&[], &["--light", "FL11"], &["--light", "LED-RGB1", "--light", "A=0.3"], &["--light", "blackbody 2000=2"]];

#[test]
fn relighting_a_file_equals_rendering_with_the_same_model_under_that_light() {
    let folder = Folder::new().with("glass.toml", GLASS);
    for (scene, flags) in KEPT {
        let render = [&["render", scene, "--size", "32x32"], flags].concat();
        folder.done(&[&render[..], &["--accumulators", "acc.exr"]].concat());
        for lights in LIGHTS {
            folder.done(&[&render[..], lights, &["-o", "fresh.exr"]].concat());
            let fresh = xyz(&folder.path("fresh.exr"));
            let (found, _) = relit(&folder, "acc.exr", lights);
            assert_same_xyz(&format!("{scene} {flags:?} {lights:?}"), &found, &fresh);
        }
    }
}

/// Another program relights a file from the documentation, using the Python in `RELUME_PYTHON`.
#[test]
#[expect(clippy::print_stderr, reason = "a test that did not run says so")]
fn another_program_relights_a_file_by_the_documentation() {
    let Some(python) = std::env::var_os("RELUME_PYTHON") else {
        assert!(std::env::var_os("CI").is_none(), "CI needs RELUME_PYTHON, which scripts/test sets");
        eprintln!(
            "NOT RUN: RELUME_PYTHON names no Python with numpy and OpenImageIO, so no other program relit a file"
        );
        return;
    };
    let folder = Folder::new().with("glass.toml", GLASS);
    let files = ["--accumulators", "acc.exr", "-o", "picture.exr"];
    folder.done(&[&["render", "glass.toml", "--size", "16x16", "-D", "display.exposure=1.5"], &files[..]].concat());
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/relight.py");
    let mut command = std::process::Command::new(python);
    let output = command.arg(script).args(["acc.exr", "picture.exr"].map(|name| folder.path(name))).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    eprintln!("{out}");
}

#[test]
fn relighting_what_the_reference_marched_equals_the_reference_under_that_light() {
    let folder = Folder::new().with("glass.toml", GLASS);
    for flags in [&["--k", "8"][..], &["--k", "4", "--model", "bands"]] {
        let render = [&["render", "glass.toml", "--size", "16x16", "--reference"], flags].concat();
        folder.done(&[&render[..], &["--accumulators", "acc.exr"]].concat());
        let stated = flags.chunks(2).map(|pair| format!("{} = {:?}\n", &pair[0][2..], pair[1])).collect::<String>();
        let stated = stated.replace("k = \"8\"", "k = 8").replace("k = \"4\"", "k = 4");
        let text = GLASS.replace("[accuracy]", &format!("[accuracy]\n{stated}"));
        let scene = parsed(&text);
        let rungs = Rungs::new(scene, [16, 16]);
        let marched = rungs.march::<f64>(&rungs.exact());
        for name in ["FL11", "E"] {
            let asked = relume::document::requested(
                &rungs.mix,
                &rungs.mix,
                &["fill".into(), "key".into()],
                &[name.parse().unwrap()],
                Path::new(""),
            );
            let matrices = support::rungs::in_xyz(&rungs.matrices_under(&asked.unwrap().mix));
            let (found, _) = relit(&folder, "acc.exr", &["--light", name]);
            assert_same_xyz(&format!("{flags:?} {name}"), &found, &marched.relight(&matrices));
        }
    }
}

#[test]
fn spectra_of_k_numbers_come_with_their_errors() {
    let folder = Folder::new().with("glass.toml", GLASS);
    // Under one equal-energy light, radiance is proportional to reflectance.
    let lights = ["--light", "E@key", "--light", "E@fill"];
    let render = [&["render", "glass.toml", "--size", "16x16", "-D", "lights.fill.intensity=0"][..], &lights].concat();
    let json = folder.done(&[&render[..], &["--spectral", "s.exr", "--json"]].concat()).json();
    let spectral = Exr::read(&folder.path("s.exr"));
    let stored: serde_json::Value = serde_json::from_str(&spectral.attributes["relumeReconstruction"]).unwrap();
    assert_eq!(stored, json["reconstruction"], "the file and the program say the same");
    let rms = stored["rms"].as_f64().unwrap();
    for light in stored["lights"].as_array().unwrap() {
        assert!(light["mean"].as_f64().unwrap() <= light["max"].as_f64().unwrap(), "{light}");
    }
    // Truth: all bands, in f64.
    let text = GLASS.replace("FL11", "E").replace("D65", "E");
    let scene = parsed(&text);
    let full = Rungs::new(scene, [16, 16]).full_spectrum();
    let marched = full.march::<f64>(&full.exact());
    let power = standard::light("E").unwrap().spectrum().samples()[0];
    let (mut squares, mut largest) = (0.0, 0.0_f64);
    for band in 0..BANDS {
        let found = &spectral.channels[&format!("S0.{},000nm", 380 + 5 * band)];
        for (pixel, &found) in found.iter().enumerate() {
            // E shines from both positions, and twice on the background.
            let kept = |position: usize| marched.accumulators[(position * BANDS + band) * 256 + pixel];
            let truth = kept(0) + kept(1) + 2.0 * 0.6 * marched.transmittance[band * 256 + pixel];
            squares += (f64::from(found) / power - truth).powi(2);
            largest = largest.max(truth);
        }
    }
    let found = (squares / (256.0 * 81.0)).sqrt();
    // The pixels are mixtures of the cloud's spectra, twice as bright.
    assert!(rms > 0.0 && found <= 2.0 * rms && largest > 0.5, "{found} of {rms}, up to {largest}");

    // The reference uses all bands and no model.
    let glass = GLASS.replace("FL11", "E").replace("D65", "E");
    let folder = folder.with("even.toml", glass);
    let render = ["render", "even.toml", "--size", "16x16", "--reference", "--spectral", "r.exr", "--json"];
    let json = folder.done(&render).json();
    assert!(json["reconstruction"].is_null(), "{json}");
    let reference = Exr::read(&folder.path("r.exr"));
    assert!(!reference.attributes.contains_key("relumeReconstruction"));
    let weights = Mix::of_scene(&full.scene).0.into_iter().map(|light| (light.position, light.weight));
    let weights: Vec<(usize, f64)> = weights.collect();
    for band in 0..BANDS {
        let found = &reference.channels[&format!("S0.{},000nm", 380 + 5 * band)];
        for (pixel, &found) in found.iter().enumerate() {
            let kept = |position: usize| marched.accumulators[(position * BANDS + band) * 256 + pixel];
            let behind = 0.6 * marched.transmittance[band * 256 + pixel];
            let truth: f64 = weights.iter().map(|&(position, weight)| weight * (kept(position) + behind)).sum();
            let error = (f64::from(found) / power - truth).abs();
            assert!(error <= 1e-6 * truth + 1e-9, "band {band}, pixel {pixel}: {found} for {truth}");
        }
    }

    // Weights are exact and need no reconstruction.
    let json = folder.done(&["render", "scene.toml", "--size", "8x8", "--spectral", "w.exr", "--json"]).json();
    assert!(json["reconstruction"].is_null());
    assert!(!Exr::read(&folder.path("w.exr")).attributes.contains_key("relumeReconstruction"));
}

#[test]
fn sizes_of_windows_follow_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("acc.exr");
    example(ModelKind::Nodes, 3, false).write(&path).unwrap();
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image = image.from_file(&path).unwrap();
    assert_eq!(image.attributes.display_window.size, Vec2(5, 19), "viewers open the picture");
}
