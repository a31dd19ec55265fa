//! The command line: files and messages of every command.

use crate::support;

use crate::support::dicom;

use std::fs::File;
use std::path::{Path, PathBuf};

use exr::prelude::attribute::AttributeValue;
use exr::prelude::{
    AnyChannel, AnyChannels, Compression, Encoding, FlatSamples, Image, Layer, LayerAttributes, Text,
    WritableImage as _,
};
use serde_json::Value;
use support::exr::{Exr, assert_same};
use support::program::{Folder, Outcome, SCENE};

/// Size of the pictures.
const SIZE: &str = "32x32";

/// Linear picture written by the program with `arguments`.
fn picture(folder: &Folder, arguments: &[&str]) -> Vec<f32> {
    folder.done(&[arguments, &["-o", "picture.exr"]].concat());
    Exr::read(&folder.path("picture.exr")).rgba()
}

/// Linear picture of the base scene, rendered with `arguments`.
fn rendered(folder: &Folder, arguments: &[&str]) -> Vec<f32> {
    picture(folder, &[&["render", "scene.toml", "--size", SIZE], arguments].concat())
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn srgb_from_linear(value: f64) -> f64 {
    let value = value.clamp(0.0, 1.0);
    if value <= 0.003_130_8 { 12.92 * value } else { 1.055 * value.powf(1.0 / 2.4) - 0.055 }
}

/// Bit depth and samples of a PNG.
fn png(path: &Path) -> (u32, Vec<u16>) {
    let mut reader = png::Decoder::new(std::io::BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((frame.width, frame.height, frame.color_type), (32, 32, png::ColorType::Rgb), "{}", path.display());
    match frame.bit_depth {
        png::BitDepth::Eight => (8, bytes.iter().map(|&byte| byte.into()).collect()),
        _ => (16, bytes.chunks_exact(2).map(|pair| u16::from_be_bytes([pair[0], pair[1]])).collect()),
    }
}

#[test]
fn pictures_of_all_kinds_show_the_same() {
    let folder = Folder::new();
    folder.done(&["render", "scene.toml", "--size", SIZE, "-o", "p.exr", "-o", "p8.png"]);
    folder.done(&["render", "scene.toml", "--size", SIZE, "-o", "p16.png", "--bits", "16"]);
    let linear = Exr::read(&folder.path("p.exr"));
    assert_eq!(linear.size, (32, 32));
    assert_eq!(linear.channels.keys().collect::<Vec<_>>(), ["A", "B", "G", "R"]);
    for (name, bits, largest) in [("p8.png", 8, 255.0), ("p16.png", 16, 65535.0)] {
        let (found, samples) = png(&folder.path(name));
        assert_eq!(found, bits);
        for (index, &sample) in samples.iter().enumerate() {
            let channel = &linear.channels[["R", "G", "B"][index % 3]];
            let exact = srgb_from_linear(f64::from(channel[index / 3])) * largest;
            // Rounding to the next code, on a device with a power function accurate to at least 2⁻¹² of white.
            assert!((f64::from(sample) - exact).abs() <= 0.5 + largest / 4096.0, "{name} {index}: {sample}, {exact}");
        }
    }
}

#[test]
fn render_tells_programs_what_it_did() {
    let folder = Folder::new();
    let outcome = folder.done(&["render", "scene.toml", "--size", SIZE, "-o", "p.png", "--json"]);
    let json = outcome.json();
    let expected =
        ["block", "device", "level", "lights", "march", "outputs", "peak_mb", "plan", "size", "times", "warnings"];
    assert_eq!(keys(&json), expected);
    assert!(json["block"].is_null());
    assert_eq!(json["outputs"], serde_json::json!(["p.png"]));
    assert_eq!(json["lights"][0], serde_json::json!({ "name": "lamp", "weight": 0.5 }));
    assert_eq!(json["size"], serde_json::json!([32, 32]));
    assert_eq!(json["plan"]["positions"], serde_json::json!(["lamp", "day"]));
    assert_eq!(json["plan"]["materials"], serde_json::json!(["bone", "flesh"]));
    for stage in ["load", "device", "upload", "march", "relight", "write"] {
        assert_eq!(keys(&json["times"][stage]), ["cpu_ms", "wall_ms"]);
    }
    assert_eq!(outcome.err, "", "nothing was odd");
    let text = folder.done(&["render", "scene.toml", "--size", SIZE, "-o", "p.png"]).out;
    assert!(text.starts_with("wrote p.png; lit by lamp × 0.5, day\n"), "{text}");
}

#[test]
fn the_scene_of_the_program_needs_no_file() {
    let folder = Folder::new();
    folder.done(&["render", "--size", SIZE, "-o", "p.png", "-D", "volume.dims=[32,30,18]"]);
    assert_eq!(folder.names(), ["p.png", "scene.toml"]);
}

/// 4×2×2 voxels with values 0 to 15, as int16.
fn ramp() -> Vec<u8> {
    (0..16_i16).flat_map(i16::to_le_bytes).collect()
}

const RAMP_HEADER: &str = "NDims = 3\nDimSize = 4 2 2\nElementType = MET_SHORT\nElementSpacing = 1 2 3\n\
                           Offset = 5 6 7\nTransformMatrix = 0 1 0 -1 0 0 0 0 1\nElementDataFile = ramp.raw\n";

#[test]
fn info_of_a_volume_has_the_promised_keys() {
    let folder = Folder::new().with("ramp.raw", ramp()).with("ramp.mhd", RAMP_HEADER);
    let json = folder.done(&["info", "ramp.mhd", "--json", "--voxel", "1,0,0", "--voxel", "3,1,1"]).json();
    let expected = serde_json::json!({
        "dims": [4, 2, 2], "type": "int16", "spacing": [1.0, 2.0, 3.0], "origin": [5.0, 6.0, 7.0], "components": 1,
        "min": 0.0, "max": 15.0, "mean": 7.5, "unit": null, "has_labels": false, "windows": [], "labels": [],
        "voxels": [{"index": [1, 0, 0], "value": 1.0}, {"index": [3, 1, 1], "value": 15.0}],
    });
    for (key, value) in expected.as_object().unwrap() {
        assert_eq!(&json[key], value, "{key}");
    }
    // MetaImage lists the axes one after the other; ITK prints them as columns.
    let turned = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    assert_eq!(json["direction"], serde_json::json!(turned));
    // The axis vectors in order, as in a scene's `direction`.
    assert_eq!(json["axes"], serde_json::json!([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]));
    let bins: Vec<u64> = serde_json::from_value(json["histogram"].clone()).unwrap();
    assert_eq!((bins.len(), bins.iter().sum::<u64>(), bins[0], bins[63]), (64, 16, 1, 1));

    let text = folder.done(&["info", "ramp.mhd", "--voxel", "3,1,1"]).out;
    for word in ["4 × 2 × 2", "int16", "1 × 2 × 3", "(5, 6, 7)", "0 to 15, mean 7.5", "3,1,1 is 15"] {
        assert!(text.contains(word), "no {word:?} in {text}");
    }
}

/// A cube of `side` voxels of this size, placed by its first one, whose values fall from its middle.
fn cube(side: usize, spacing: f64, origin: [f64; 3]) -> Vec<u8> {
    let [x, y, z] = origin;
    let head = format!(
        "NRRD0005\ntype: uint8\ndimension: 3\nspace: left-posterior-superior\nsizes: {side} {side} {side}\nspace directions: \
         ({spacing},0,0) (0,{spacing},0) (0,0,{spacing})\nspace origin: ({x},{y},{z})\nencoding: raw\n\n"
    );
    let half = side / 2;
    let far = |i: usize| i.abs_diff(half);
    let value = |i: usize| {
        let [x, y, z] = [i % side, i / side % side, i / side / side].map(far);
        u8::try_from(240 - (240 * (x + y + z)) / (3 * half + 1)).unwrap()
    };
    head.into_bytes().into_iter().chain((0..side.pow(3)).map(value)).collect()
}

#[test]
fn a_painted_transfer_function_shows_what_is_white() {
    let painted = |levels: &[u8]| [b"P5 4 4 255\n".as_slice(), &levels.repeat(16 / levels.len())].concat();
    let folder = Folder::new()
        .with("ct.nrrd", cube(24, 1.0, [0.0; 3]))
        .with("white.pgm", painted(&[255]))
        .with("black.pgm", painted(&[0]))
        .with("right.pgm", painted(&[0, 0, 255, 255]))
        .with("thin.pgm", b"P5 4 1 255\nabcd");
    let scene = |name: &str, interval: &str| {
        let text = format!(
            "version = 1\n[volume]\nfile = \"ct.nrrd\"\n[materials.bone]\nreflectance = \"white 9.5\"\n[lights.day]\nspectrum = \"D65\"\n\
             [transfer]\nintervals = [{{ material = \"bone\", range = [0, 255], {interval} }}]\n"
        );
        std::fs::write(folder.path(&format!("{name}.toml")), text).unwrap();
    };
    let picture = |name: &str| {
        folder.done(&["render", &format!("{name}.toml"), "--size", "24x24", "-o", &format!("{name}.png")]);
        std::fs::read(folder.path(&format!("{name}.png"))).unwrap()
    };
    let by = |name: &str, image: &str| {
        let shape =
            format!("shape = {{ by = \"gradient\", image = \"{image}\", values = [0, 255], second = [0, 200] }}");
        scene(name, &format!("opacity = 0.2, {shape}"));
    };
    scene("plain", "opacity = 0.2");
    scene("nothing", "opacity = 0");
    for name in ["white", "black", "right"] {
        by(name, &format!("{name}.pgm"));
    }
    let [plain, white, black, right] = ["plain", "white", "black", "right"].map(picture);
    assert!(white == plain && black == picture("nothing") && black != plain && right != plain && right != black);
    // A saved session paints the same.
    folder.done(&["render", "right.toml", "--size", "24x24", "-o", "again.png", "--save-scene", "sub.toml"]);
    assert!(picture("sub") == right);
    by("thin", "thin.pgm");
    folder.refused(1, &["render", "thin.toml", "-o", "no.png"], &["shape.image", "thin.pgm", "4×1"]);
    by("missing", "nowhere.pgm");
    folder.refused(1, &["render", "missing.toml", "-o", "no.png"], &["shape.image", "nowhere.pgm"]);
}

#[test]
fn volumes_on_grids_of_their_own_are_shown_together_and_none_is_dropped() {
    let folder = Folder::new();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path(name), bytes).unwrap();
    write("ct.nrrd", &cube(24, 1.0, [0.0; 3]));
    write("pet.nrrd", &cube(8, 2.5, [2.0, 2.0, 2.0]));
    write("far.nrrd", &cube(8, 2.5, [900.0, 2.0, 2.0]));
    write("pet.tfm", b"#Insight Transform File V1.0\nTransform: AffineTransform_double_3_3\nParameters: 1 0 0 0 1 0 0 0 1 3 0 0\nFixedParameters: 0 0 0\n");
    let small = ["--size", "24x24"];
    let done = |args: &[&str]| folder.done(&[args, &small].concat());
    let both = done(&["render", "ct.nrrd", "pet.nrrd", "-o", "both.png", "--save-scene", "sub.toml"]);
    assert!(both.err.contains("Beside it") && both.err.contains("pet from"), "{}", both.err);
    done(&["render", "sub.toml", "-o", "again.png"]);
    done(&["render", "ct.nrrd", "-o", "ct.png"]);
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert!(bytes("both.png") == bytes("again.png") && bytes("both.png") != bytes("ct.png"));
    // ITK's transform leads to the moving volume: it lies 3 units nearer.
    let moved = |value: &str, name: &str| {
        done(&["render", "ct.nrrd", "pet.nrrd", "-D", &format!("volumes.pet.transform={value}"), "-o", name]);
        bytes(name)
    };
    let by_file = moved("pet.tfm", "file.png");
    assert!(by_file == moved("[1, 0, 0, -3, 0, 1, 0, 0, 0, 0, 1, 0]", "numbers.png") && by_file != bytes("both.png"));
    // The time of a series beside a volume of one time, also of its saved scene.
    let series = [&cube(4, 2.5, [2.0; 3])[..], &cube(4, 2.5, [2.0; 3])].concat();
    let text = String::from_utf8_lossy(&series[..300]).into_owned();
    let head = text.split("\n\n").next().unwrap_or_default().to_owned();
    let voxels = cube(4, 2.5, [2.0; 3])[head.len() + 2..].to_vec();
    let head = head
        .replace("dimension: 3", "dimension: 4")
        .replace("sizes: 4 4 4", "sizes: 4 4 4 2")
        .replace("(0,0,2.5)", "(0,0,2.5) none")
        + "\nkinds: domain domain domain time";
    write("series.nrrd", &[head.as_bytes(), b"\n\n", &voxels[..], &voxels[..]].concat());
    folder.refused(1, &["render", "ct.nrrd", "series.nrrd", "-o", "no.png"], &["series.nrrd", "2 time steps"]);
    done(&["render", "ct.nrrd", "series.nrrd", "--time", "1", "-o", "second.png", "--save-scene", "second.toml"]);
    done(&["render", "second.toml", "-o", "again.png"]);
    assert_eq!(bytes("second.png"), bytes("again.png"));
    // Inside a label, elsewhere, and where the other is bright; by the names of the files.
    let of_labels = cube(24, 1.0, [0.0; 3]);
    write("organs.nrrd", &of_labels);
    let changed = |flags: &[&str]| {
        done(&[&["render", "ct.nrrd", "pet.nrrd", "-o", "changed.png"][..], flags].concat());
        bytes("changed.png")
    };
    let [inside, outside, above] = ["pet=organs.nrrd:240", "PET=!organs.nrrd:240", "pet=ct:238"].map(|mask| {
        let what = mask.replace("organs.nrrd", &folder.path("organs.nrrd").display().to_string());
        changed(&["--mask", &what])
    });
    let by_hand = "volumes.pet.transfer.by={mask=[[0.4,0],[0.6,1]]}";
    let file = "volumes.mask={file=\"organs.nrrd\",only=[240]}";
    assert!(inside == changed(&["-D", file, "-D", by_hand]), "a mask by hand");
    assert!(inside != bytes("both.png") && outside != inside && above != bytes("both.png"));
    assert!(changed(&["--hide", "CT"]) == changed(&["--hide", "volume"]));
    assert!(
        changed(&["--crop", "0%:50%,0:23,11.5:100%"]) == changed(&["-D", "crop={min=[0,0,11.5],max=[11.5,23,23]}"])
    );
    for (flags, words) in [
        (["--mask", "pet=nosuch.nrrd:1"], &["no file nosuch.nrrd"][..]),
        (["--mask", "pet"], &["NAME=FILE:LABELS"]),
        (["--mask", "pet=ct:1,2"], &["one value"]),
        (["--mask", "pet=bone:1"], &["\"bone\"", "ct"]),
        (["--crop", "1:2"], &["LOW:HIGH along x, y and z"]),
        (["--crop", "0:200%,0:1,0:1"], &["200%", "100%"]),
    ] {
        folder.refused(2, &[&["render", "ct.nrrd", "pet.nrrd"][..], &flags].concat(), words);
    }
    let twice = ["render", "ct.nrrd", "pet.nrrd", "-D", by_hand, "--mask", "PET=ct:200"];
    folder.refused(2, &twice, &["-D volumes.pet.transfer.by", "--mask PET=ct follows"]);
    let none = done(&["render", "ct.nrrd", "pet.nrrd", "--range", "pet=5000:6000", "-o", "none.png"]);
    assert!(none.err.contains("no voxel of pet"), "{}", none.err);
    let far = done(&["render", "ct.nrrd", "far.nrrd", "-o", "far.png"]);
    assert!(far.err.contains("nothing of it is shown"), "{}", far.err);
    let channels = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tiff/channels.ome.tif");
    folder.refused(1, &["render", channels, "pet.nrrd"], &["choose one component", "[volumes]"]);
    folder.refused(1, &["render", "ct.nrrd", "nosuch.nrrd"], &["nosuch.nrrd"]);
    folder.refused(2, &["render", "sub.toml", "pet.nrrd"], &["pet.nrrd", "[volumes]"]);
    folder.refused(2, &["info", "ct.nrrd", "pet.nrrd"], &["one volume", "pet.nrrd"]);
    folder.refused(2, &["render", "ct.nrrd", "a", "b", "c", "d"], &["5 volumes", "up to 4"]);
    folder.refused(
        2,
        &["render", "ct.nrrd", "pet.nrrd", "-D", "volumes.pet.transform=[1, 0.5, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]"],
        &["right angles"],
    );
    // Planes.
    let cut = done(&["render", "ct.nrrd", "--clip", "z:50%", "--clip", "-z:50%", "-o", "cut.png"]);
    assert!(cut.err.contains("clip planes leave nothing"), "{}", cut.err);
    let cut = done(&["render", "ct.nrrd", "--clip", "left:50%", "-o", "cut.png"]);
    assert!(!cut.err.contains("clip planes leave nothing") && bytes("cut.png") != bytes("ct.png"), "{}", cut.err);
    folder.refused(2, &["info", "ct.nrrd", "--clip", "z:50%"], &["--clip has no effect"]);
    folder.refused(2, &["render", "ct.nrrd", "--clip", "w:3"], &["--clip w:3", "no such direction"]);
}

#[test]
fn channels_are_listed_by_their_names() {
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tiff/channels.ome.tif");
    let folder = Folder::new();
    // A listing, as of the series of a folder, and no error.
    let listed = folder.done(&["info", file]).out;
    for words in ["2 components per voxel (DAPI, GFP)", "0 DAPI", "1 GFP", "--component N"] {
        assert!(listed.contains(words), "no {words:?} in {listed}");
    }
    let json = folder.done(&["info", file, "--json"]).json();
    assert_eq!((&json["components"], &json["component_names"]), (&2.into(), &serde_json::json!(["DAPI", "GFP"])));
    folder.refused(2, &["info", file, "--voxel", "0,0,0"], &["--voxel has no effect", "--component N"]);
    // All of them, those that are named, or one.
    let small = ["--size", "32x32"];
    let both = folder.done(&[&["render", file, "-o", "c.png", "--save-scene", "c.toml"][..], &small].concat());
    for words in ["2 channels", "DAPI from", "GFP from"] {
        assert!(both.err.contains(words), "no {words:?} in {}", both.err);
    }
    assert!(both.out.contains("lit by DAPI, GFP"), "{}", both.out);
    let scene = std::fs::read_to_string(folder.path("c.toml")).unwrap();
    for words in ["[volumes.GFP]", "component = 0", "component = 1", "[materials.DAPI]", "[lights.GFP]", "2 channels"] {
        assert!(scene.contains(words), "no {words:?} in {scene}");
    }
    folder.done(&[&["render", "c.toml", "-o", "again.png"][..], &small].concat());
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert_eq!(bytes("c.png"), bytes("again.png"), "the saved scene is the same picture");
    folder.done(&[&["render", file, "--channels", "GFP,0", "-o", "two.png"][..], &small].concat());
    folder.done(&[&["render", file, "--channels", "GFP", "-o", "one.png"][..], &small].concat());
    folder
        .done(&[&["render", file, "--look", "maximum", "-o", "m.png", "--save-scene", "m.toml"][..], &small].concat());
    let largest = std::fs::read_to_string(folder.path("m.toml")).unwrap();
    for words in ["blending = \"maximum\"", "[volumes.GFP]", "[lights.DAPI]", "of which the largest values add up"] {
        assert!(largest.contains(words), "{words}: {largest}");
    }
    folder.done(&[&["render", "m.toml", "-o", "again.png"][..], &small].concat());
    assert_eq!(std::fs::read(folder.path("m.png")).unwrap(), std::fs::read(folder.path("again.png")).unwrap());
    // Contrast limits and hidden channels, of the first one too; a session keeps them.
    for (flags, words) in [
        (["--range", "GFP=20:90"], ["[volumes.GFP.transfer]", "range = [20.0, 90.0]"]),
        (["--range", "DAPI=20:90"], ["[transfer]", "range = [20.0, 90.0]"]),
        (["--range", "1e2:2e2"], ["[transfer]", "range = [100.0, 200.0]"]),
        (["--hide", "DAPI"], ["hidden = [", "DAPI"]),
    ] {
        let more = ["-o", "changed.png", "--save-scene", "changed.toml"];
        folder.done(&[&["render", file][..], &flags, &more, &small].concat());
        let scene = std::fs::read_to_string(folder.path("changed.toml")).unwrap();
        assert!(words.iter().all(|word| scene.contains(word)), "{flags:?}: {scene}");
        folder.done(&[&["render", "changed.toml", "-o", "again.png"][..], &small].concat());
        assert!(bytes("changed.png") == bytes("again.png") && bytes("changed.png") != bytes("c.png"), "{flags:?}");
    }
    folder.refused(2, &["render", file, "--range", "RFP=1:2"], &["--range RFP=1:2", "no \"RFP\"", "DAPI, GFP"]);
    let twice = ["render", file, "--range", "GFP=1:2", "--range", "GFP=3:4"];
    folder.refused(2, &twice, &["--range GFP=1:2", "has no effect", "--range GFP=3:4 follows"]);
    let named = ["render", file, "--range", "1:2", "--range", "DAPI=3:4"];
    folder.refused(2, &named, &["--range 1:2", "--range DAPI=3:4 follows"]);
    folder.refused(
        2,
        &["render", file, "--range", "1:2", "-D", "transfer.range=[3,4]"],
        &["transfer.range", "--range"],
    );
    let clipped = ["render", file, "--clip", "z:50%", "-D", "clip.planes.0.on=false"];
    folder.refused(2, &clipped, &["clip.planes.0.on", "--clip"]);
    folder.refused(2, &["render", file, "--range", "GFP=2:1"], &["--range", "the lower one first"]);
    folder.refused(2, &["render", file, "--hide", "RFP"], &["--hide RFP", "there are: DAPI, GFP"]);
    folder.refused(1, &["render", file, "--channels", "GFP,0", "--look", "bone"], &["the look maximum"]);
    folder.refused(
        1,
        &["render", "m.toml", "-D", "accuracy.integration=segments", "-o", "no.png"],
        &["segments", "a single value of a ray is seen"],
    );
    folder.refused(
        1,
        &["render", "m.toml", "--block", "1/2", "--accumulators", "no.exr"],
        &["blending = \"maximum\"", "as a whole"],
    );
    folder.refused(
        2,
        &["render", "m.toml", "-D", "blending=maximal", "-o", "no.png"],
        &["one of `composite`, `maximum`, `minimum`"],
    );
    folder.refused(1, &["render", file, "--channels", "RFP"], &["no channel \"RFP\"", "DAPI, GFP"]);
    folder.refused(1, &["render", file, "--channels", "GFP,1"], &["\"1\" is named twice"]);
    folder.refused(
        2,
        &["render", "c.toml", "--channels", "GFP"],
        &["--channels has no effect on a scene", "[volumes]"],
    );
    folder.refused(2, &["render", file, "--channels", "GFP", "--component", "1"], &["--channels", "--component"]);
    // A look is at one of them.
    let words =
        ["2 components per voxel (DAPI, GFP)", "choose a component from 0 to 1 with --component N", "--channels A,B"];
    folder.refused(1, &["render", file, "--look", "grey", "-o", "c.png"], &words);
    assert!(folder.done(&["info", file, "--component", "1"]).out.contains("2 (DAPI, GFP), one of which is read"));
    let json = folder.done(&["info", file, "--component", "1", "--json"]).json();
    assert_eq!((&json["component_names"], &json["unit"]), (&serde_json::json!(["DAPI", "GFP"]), &"nm".into()));
}

#[test]
fn a_component_is_chosen_by_flag_or_by_the_scene() {
    let header = "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 3 2 2 2\nkinds: RGB-color space space space\n\
                  encoding: raw\n\n";
    let numbers: Vec<u8> = (0..24).collect();
    let folder = Folder::new()
        .with("rgb.nrrd", [header.as_bytes(), &numbers].concat())
        .with("rgb.toml", "version = 1\n[volume]\nfile = \"rgb.nrrd\"\ncomponent = 2\n");
    folder.refused(
        1,
        &["convert", "rgb.nrrd", "one.nrrd"],
        &["3 components per voxel (rgb-color)", "choose a component from 0 to 2 with --component N"],
    );
    folder.refused(1, &["info", "rgb.nrrd", "--component", "3"], &["--component 3", "3 components"]);
    folder.refused(1, &["info", "rgb.nrrd", "--component", "0", "--time", "1"], &["--time 1", "1 time step"]);
    folder.refused(1, &["info", "rgb.nrrd", "--component", "0", "--array", "ct"], &["--array ct"]);
    folder.refused(2, &["info", "--component", "0"], &["--component has no effect"]);
    let outcome = folder.done(&["info", "rgb.nrrd", "--component", "1", "--json"]).json();
    assert_eq!((&outcome["min"], &outcome["max"], &outcome["components"]), (&1.0.into(), &22.0.into(), &3.into()));
    assert!(folder.done(&["info", "rgb.nrrd", "--component", "1"]).out.contains("3, one of which is read"));
    folder.done(&["info", "rgb.toml"]);
    folder.done(&["info", "rgb.toml", "-D", "volume.component=0"]);
    folder.refused(1, &["info", "rgb.toml", "--component", "3"], &["--component 3"]);
}

#[test]
fn a_folder_of_several_series_is_listed_and_one_is_read_by_flag_or_by_the_scene() {
    let scene = |series: &str| format!("version = 1\n[volume]\nfile = \"scans\"\nseries = {series}\n");
    let folder = Folder::new().with("five.toml", scene("5")).with("seven.toml", scene("\"1.2.7\""));
    let second = |z, first| dicom::slice(z, first).text(0x0020_0011, "IS", "7").text(0x0020_000e, "UI", "1.2.7");
    std::fs::create_dir(folder.path("scans")).unwrap();
    let slices = [("a", dicom::slice(0.0, 0)), ("b", dicom::slice(2.0, 12)), ("c", second(0.0, 100))];
    for (name, slice) in slices {
        std::fs::write(folder.path("scans").join(name), dicom::file(&slice, dicom::EXPLICIT)).unwrap();
    }
    let listed = folder.done(&["info", "scans"]).out;
    for line in ["series     5 «made» MR 4×3×2", "series     7 «made» MR 4×3×1", "--series N"] {
        assert!(listed.contains(line), "{line}: {listed}");
    }
    let json = folder.done(&["info", "scans", "--json"]).json();
    assert_eq!((&json["series"][1]["series"], &json["series"][0]["dims"][2]), (&"7".into(), &2.into()));
    folder.refused(2, &["info", "scans", "--voxel", "0,0,0"], &["--voxel has no effect", "--series"]);
    folder.refused(1, &["render", "scans", "-o", "p.png"], &["2 series: 5 «made»", "with --series N"]);
    folder.refused(1, &["info", "scans", "--series", "6"], &["--series 6", "series 6 does not exist"]);
    folder.refused(1, &["info", "scans", "--series", "5", "--pyramid-level", "1"], &["--pyramid-level 1", "one level"]);
    for arguments in [&["info", "scans", "--series", "5"][..], &["info", "five.toml"]] {
        assert!(folder.done(arguments).out.contains("0 to 23"), "{arguments:?}");
    }
    for arguments in [&["info", "scans", "--series", "7"][..], &["info", "seven.toml"]] {
        assert!(folder.done(arguments).out.contains("100 to 111"), "{arguments:?}");
    }
    // A picture of the folder, which is named for it.
    folder.done(&["render", "scans", "--series", "5", "--size", SIZE]);
    assert!(folder.path("scans.png").exists());
}

#[test]
fn info_of_a_headerless_volume_takes_its_layout_from_flags() {
    let big: Vec<u8> = [9; 3].into_iter().chain((0..16_i16).flat_map(i16::to_be_bytes)).collect();
    let folder = Folder::new().with("ramp.raw", big);
    let flags = ["--dims", "4x2x2", "--type", "int16", "--big-endian", "--header-bytes", "3", "--spacing", "1x1x2.5"];
    let json = folder.done(&[&["info", "ramp.raw", "--json"], &flags[..]].concat()).json();
    assert_eq!((&json["max"], &json["spacing"]), (&serde_json::json!(15.0), &serde_json::json!([1.0, 1.0, 2.5])));
}

#[test]
fn info_of_a_scene_says_what_is_shown_and_what_it_takes() {
    let folder = Folder::new();
    let text = folder.done(&["info", "scene.toml", "-D", "lights.day.intensity=2"]).out;
    for word in
        ["scene.toml with -D lights.day.intensity=2", "frog", "32 × 30 × 18", "bone, flesh", "lamp", "intensity 2"]
    {
        assert!(text.contains(word), "no {word:?} in {text}");
    }
    let json = folder.done(&["info", "scene.toml", "--json"]).json();
    assert_eq!(json["plan"]["components"], 3);
    assert!(json["plan"]["explanation"].as_array().unwrap().len() > 2);
    let stored = |json: &Value| ["format", "bytes"].map(|key| json["plan"]["texture"][key].clone());
    assert_eq!(stored(&json), [Value::from("rgba16snorm"), Value::from(32 * 30 * 18 * 8)]);
    let sentence =
        "For the device, the volume takes 0.1 MB, which way values change included; storing it so loses nothing.";
    assert!(text.contains(sentence), "{text}");
    assert_eq!(json["plan"]["explanation"].as_array().unwrap().last(), Some(&Value::from(sentence)));
    let plain = folder.done(&["info", "scene.toml", "-D", "shading=none", "--json"]).json();
    assert_eq!(stored(&plain), [Value::from("r16unorm"), Value::from(32 * 30 * 18 * 2)]);
    assert_eq!(json["volume"]["dims"], serde_json::json!([32, 30, 18]));
    let ball = folder.with("ball.toml", "version = 1\n[volume]\nphantom = \"shells\"\ndims = [3, 3, 3]\n");
    for (dims, amount) in [("3,3,3", "108 bytes"), ("20,20,20", "32.0 kB")] {
        let text = ball.done(&["info", "ball.toml", "-D", &format!("volume.dims=[{dims}]")]).out;
        assert!(text.contains(&format!("the volume takes {amount};")), "{text}");
    }
    let text = ball.done(&["info", "ball.toml", "--voxel", "1,1,1"]).out;
    assert!(text.contains("values     ") && text.contains("1,1,1 is 1"), "{text}");
    assert_eq!(json["labels"], Value::Null);
    assert_eq!(json["materials"], serde_json::json!(["bone", "flesh"]));
    let lights: Vec<_> =
        json["lights"].as_array().unwrap().iter().map(|light| (&light["name"], &light["kind"])).collect();
    assert!(lights.contains(&(&"day".into(), &"directional".into())), "{lights:?}");
}

#[test]
fn info_of_an_accumulator_file_says_what_it_holds() {
    let folder = Folder::new();
    folder.done(&["render", "scene.toml", "--size", SIZE, "--accumulators", "acc.exr"]);
    let text = folder.done(&["info", "acc.exr"]).out;
    for word in ["acc.exr: a film file", "32 × 32", "bone, flesh, white", "lamp, day", "lamp@lamp=0.5"] {
        assert!(text.contains(word), "no {word:?} in {text}");
    }
    let json = folder.done(&["info", "acc.exr", "--json"]).json();
    assert_eq!(
        keys(&json),
        [
            "accumulators",
            "components",
            "lights",
            "model",
            "part",
            "positions",
            "presets",
            "situations",
            "size",
            "warnings"
        ]
    );
    assert_eq!(json["positions"], serde_json::json!(["lamp", "day"]));
    assert!(folder.done(&["info", "--help"]).out.contains("film file (.exr)"));
}

#[test]
fn info_alone_lists_devices() {
    let folder = Folder::new();
    let json = folder.done(&["info", "--json"]).json();
    assert_eq!(keys(&json["devices"][0]), ["driver", "index", "kind", "missing", "name", "vulkan"]);
    let name = json["devices"][0]["name"].as_str().unwrap();
    assert!(folder.done(&["info"]).out.contains(name));
    // A device can be selected by its number or any part of its name.
    for device in ["0", &name[..4].to_uppercase()] {
        let json =
            folder.done(&["render", "scene.toml", "--size", "8x8", "-o", "p.png", "--device", device, "--json"]).json();
        assert_eq!(json["device"]["name"], name);
    }
}

#[test]
fn bench_measures_with_the_promised_keys() {
    let folder = Folder::new();
    let small = ["-D", "volume.dims=[62,58,34]"];
    let arguments = [&["bench", "peer", "default", "--size", "16x16", "--frames", "3", "--json"], &small[..]].concat();
    let json = folder.done(&arguments).json();
    let rows = json["rows"].as_array().unwrap();
    let workloads: Vec<_> =
        rows.iter().map(|row| (row["workload"].as_str().unwrap(), row["shading"].as_str().unwrap())).collect();
    assert_eq!(workloads, [("peer", "none"), ("peer", "diffuse"), ("default", "none"), ("default", "diffuse")]);
    for (number, row) in rows.iter().enumerate() {
        for key in ["volume", "size", "accumulate", "lanes", "positions", "device", "peak_mb"] {
            assert!(!row[key].is_null(), "{key}");
        }
        // The device is already open for later rows.
        let startup = &row["startup_ms"];
        assert!(if number == 0 { startup["median"].as_f64() > Some(0.0) } else { startup.is_null() }, "{row}");
        assert!(startup["min"] == startup["median"] && startup["max"] == startup["median"], "measured once: {row}");
        for stage in ["march", "relight"] {
            for clock in ["wall_ms", "cpu_ms"] {
                let time = |of: &str| row[stage][clock][of].as_f64().unwrap();
                assert!(time("min") <= time("median") && time("median") <= time("max"), "{row}");
            }
        }
    }
    let text = folder
        .done(&[&["bench", "peer", "--size", "16x16", "--frames", "1", "--shading", "none"], &small[..]].concat())
        .out;
    assert!(text.contains("peer") && !text.contains("diffuse"), "{text}");
}

#[test]
fn bench_measures_reading_beside_decoding() {
    let numbers = (0_u16..4096).flat_map(|n| n.wrapping_mul(40503).to_le_bytes()).collect::<Vec<u8>>();
    let gzip = |bytes: &[u8]| {
        use std::io::Write as _;
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    };
    let header = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 16 16 16\nendian: little\nencoding: gzip\n";
    let folder = Folder::new()
        .with("attached.nrrd", [header.as_bytes(), b"\n", &gzip(&numbers)].concat())
        .with("detached.nhdr", format!("{header}data file: v.gz\n"))
        .with("v.gz", gzip(&numbers))
        .with("v.raw", &numbers);
    for (name, stream) in [("attached.nrrd", Some("gzip")), ("detached.nhdr", Some("gzip")), ("v.raw", None)] {
        let layout = "dims = [16, 16, 16]\ntype = \"uint16\"\n";
        std::fs::write(folder.path("v.raw.toml"), layout).unwrap();
        let load = folder.done(&["bench", "load", "--volume", name, "--frames", "3", "--json"]).json()["load"].clone();
        assert_eq!((&load["volume"], &load["stream"]), (&name.into(), &stream.into()));
        assert_eq!(load["voxels_mb"], 0.008192, "{name}");
        let number = |key: &str| load[key].as_f64().unwrap();
        let near = |ours: f64, theirs: f64| (ours / theirs - 1.0).abs() < 1e-9;
        let median = |key: &str| load[key]["cpu_ms"]["median"].as_f64().unwrap();
        assert!(near(number("ratio"), median("open") / median("bare")), "{load}");
        assert!(near(number("open_mb_s"), 8.192 / median("open")), "{load}");
        // For compressed files only the voxel data counts, not the header.
        let bare = if stream.is_some() { 8.192 } else { 8.192 + f64::from(u16::try_from(layout.len()).unwrap()) / 1e3 };
        assert!(near(number("bare_mb_s"), bare / median("bare")), "{load}");
    }
    let text = folder.done(&["bench", "load", "--volume", "attached.nrrd", "--frames", "1"]).out;
    assert!(text.contains("MB/s") && text.contains("inflating its gzip stream"), "{text}");
}

#[test]
fn bench_measures_reading_beside_decoding_for_every_compression() {
    use std::io::Write as _;
    let mut bzip2 = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::fast());
    bzip2.write_all(&[7; 4096]).unwrap();
    let header = b"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 16 16 16\nencoding: bzip2\n\n";
    let folder = Folder::new().with("v.nrrd", [&header[..], &bzip2.finish().unwrap()].concat());
    let packed = folder.path("v.nrrd");
    for (file, stream) in [
        ("vti/raw_zlib_little_32.vti", "zlib"),
        ("vti/base64_lz4_big_64.vti", "lz4"),
        ("vti/binary_lzma_little_32.vti", "lzma"),
        (packed.to_str().unwrap(), "bzip2"),
    ] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(file);
        let arguments = ["bench", "load", "--volume", path.to_str().unwrap(), "--frames", "3", "--json"];
        let load = folder.done(&arguments).json()["load"].clone();
        assert_eq!(load["stream"], stream, "{file}");
        // The number of decoded bytes is that of the voxels.
        let decoded = load["bare_mb_s"].as_f64().unwrap() * load["bare"]["cpu_ms"]["median"].as_f64().unwrap() / 1e3;
        assert!((decoded - load["voxels_mb"].as_f64().unwrap()).abs() < 1e-9, "{load}");
    }
}

#[test]
fn written_shaders_pass_their_own_check_until_a_byte_changes() {
    let folder = Folder::new();
    folder.done(&["shaders", "--write", "--folder", "."]);
    folder.done(&["shaders", "--check", "--folder", "."]);
    let name = folder.names().into_iter().find(|name| name.ends_with(".spv")).unwrap();
    let mut bytes = std::fs::read(folder.path(&name)).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(folder.path(&name), bytes).unwrap();
    folder.refused(1, &["shaders", "--check", "--folder", "."], &[&name, "shaders --write"]);
}

#[test]
fn the_committed_shaders_are_those_that_are_compiled() {
    let committed = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("spirv");
    let folder = Folder::new();
    let checked = folder.done(&["--json", "shaders", "--check", "--folder", committed.to_str().unwrap()]).json();
    let mut checked: Vec<String> =
        checked["files"].as_array().unwrap().iter().map(|file| file.as_str().unwrap().to_owned()).collect();
    let entries = std::fs::read_dir(&committed).unwrap();
    let mut there: Vec<String> = entries.map(|entry| entry.unwrap().path().to_str().unwrap().to_owned()).collect();
    checked.sort();
    there.sort();
    assert_eq!(there, checked, "no stray files");
}

#[test]
fn lights_add_up_and_weights_multiply() {
    let folder = Folder::new();
    let under = |lights: &[&str]| {
        let flags: Vec<&str> = lights.iter().flat_map(|light| ["--light", light]).collect();
        rendered(&folder, &flags)
    };
    let colours = 3 * 32 * 32;
    let sum = |a: Vec<f32>, b: Vec<f32>| -> Vec<f32> {
        let added = a.iter().zip(&b).take(colours).map(|(a, b)| a + b);
        added.chain(a[colours..].iter().copied()).collect()
    };
    let (all, day, lamp) = (under(&[]), under(&["day"]), under(&["lamp"]));
    assert_same(&all, &under(&["day", "lamp"]), 1e-5);
    assert_same(&all, &sum(day.clone(), lamp.clone()), 1e-5);
    assert_same(&under(&["day=2"]), &sum(day.clone(), day.clone()), 1e-5);
    // Another light takes the place of the mix, or shines from the named position.
    assert_same(&day, &under(&["D65@day"]), 1e-5);
    assert_same(&lamp, &under(&["A@lamp=0.5"]), 1e-5);
    assert_same(&under(&["FL11"]), &sum(under(&["FL11@day"]), under(&["FL11@lamp=0.5"])), 1e-5);
    // Illuminant A is a black body of 2856 K, to the precision of its table.
    assert_same(&under(&["A"]), &under(&["blackbody 2856"]), 2e-3);
    // A light of the scene can shine from another position.
    assert_same(&under(&["lamp@day=2"]), &under(&["A@day"]), 1e-5);
}

#[test]
fn names_of_lights_may_hold_the_signs_of_positions_and_weights() {
    let scene = SCENE.replace("[lights.lamp]", "[lights.\"lamp@day=2\"]").replace("[lights.day]", "[lights.\"d@y\"]");
    let folder = Folder::new().with("scene.toml", scene).with("tube=3.csv", "400,1\n700,2\n").with("a@b", "500,1\n");
    folder.done(&["render", "scene.toml", "--size", "4x4", "--accumulators", "acc.exr"]);
    for (asked, name, positions, weights) in [
        ("lamp@day=2", "lamp@day=2", &["lamp@day=2"][..], &[0.5][..]),
        ("lamp@day=2=2", "lamp@day=2", &["lamp@day=2"], &[1.0]),
        ("lamp@day=2@d@y=3", "lamp@day=2", &["d@y"], &[1.5]),
        ("d@y", "d@y", &["d@y"], &[1.0]),
        ("tube=3.csv", "tube=3.csv", &["lamp@day=2", "d@y"], &[0.5, 1.0]),
        ("tube=3.csv@d@y=4", "tube=3.csv", &["d@y"], &[4.0]),
        ("a@b", "a@b", &["lamp@day=2", "d@y"], &[0.5, 1.0]),
        ("D65@d@y", "D65", &["d@y"], &[1.0]),
        ("D65=2", "D65", &["lamp@day=2", "d@y"], &[1.0, 2.0]),
    ] {
        let json = folder.done(&["relight", "acc.exr", "-o", "p.png", "--light", asked, "--json"]).json();
        let lights = json["frames"][0]["lights"].as_array().unwrap();
        let found: Vec<_> = lights.iter().map(|light| light["position"].as_str().unwrap()).collect();
        assert_eq!(found, positions, "{asked}");
        assert!(lights.iter().all(|light| light["name"] == name), "{asked}: {json}");
        let found: Vec<_> = lights.iter().map(|light| light["weight"].as_f64().unwrap()).collect();
        assert_eq!(found, weights, "{asked}");
    }
    folder.refused(
        2,
        &["relight", "acc.exr", "-o", "q.png", "--light", "lamp@day"],
        &["lamp@day", "no position \"day\""],
    );
}

#[test]
fn a_light_can_be_a_file() {
    let folder = Folder::new().with("flat.csv", "380 3\n580 3\n780 3\n");
    // Scale is irrelevant: a white surface under it has Y = 1, as under illuminant E.
    assert_same(&rendered(&folder, &["--light", "flat.csv"]), &rendered(&folder, &["--light", "E"]), 1e-5);
}

#[test]
fn relighting_saved_accumulators_equals_rendering_under_that_light() {
    let folder = Folder::new();
    let background = ["-D", "background=0.3", "-D", "display.exposure=1.5"];
    folder.done(&[&["render", "scene.toml", "--size", SIZE, "--accumulators", "acc.exr"], &background[..]].concat());
    assert_eq!(folder.names(), ["acc.exr", "scene.toml"]);
    for lights in [&[][..], &["--light", "FL11"], &["--light", "day=0.3", "--light", "blackbody 3000@lamp"]] {
        let fresh = rendered(&folder, &[&background[..], lights].concat());
        let relit = picture(&folder, &[&["relight", "acc.exr"], lights].concat());
        assert_same(&fresh, &relit, 1e-5);
    }
    let json = folder.done(&["relight", "acc.exr", "--light", "A@day=2", "-o", "p.png", "--json"]).json();
    assert_eq!(keys(&json), ["exposure", "frames", "model", "outputs", "pictures", "size", "times", "warnings"]);
    assert_eq!(json["frames"][0]["lights"], serde_json::json!([{"name": "A", "position": "day", "weight": 2.0}]));
}

/// A light that the scene does not have changes the spectrum of a picture, and not its brightness or its shadows.
#[test]
fn a_film_under_another_light_has_the_positions_and_shares_of_its_mix() {
    let folder = Folder::new();
    let film = |flags: &[&str]| {
        folder.done(&[&["render", "scene.toml", "--size", SIZE, "--accumulators", "acc.exr"], flags].concat());
    };
    let day = rendered(&folder, &["--light", "day"]);
    // The light day is D65; the lamp is off, by the scene or by a flag.
    for flags in [&["-D", "mix.off=[\"lamp\"]"][..], &["--light", "day"], &["--light", "day=0.5", "--light", "day=0.5"]]
    {
        film(flags);
        assert_same(&day, &picture(&folder, &["relight", "acc.exr"]), 1e-5);
        assert_same(&day, &picture(&folder, &["relight", "acc.exr", "--light", "D65"]), 1e-5);
    }
    let outcome = folder.done(&["relight", "acc.exr", "--light", "D65=2", "-o", "p.png", "--json"]);
    let placed =
        serde_json::json!([{"name": "D65", "in_place_of": "picture", "at": [{"position": "day", "weight": 2.0}]}]);
    assert_eq!(outcome.json()["placed"], placed);
    let told = folder.done(&["relight", "acc.exr", "--light", "D65=2", "-o", "p.png"]).out;
    assert!(told.contains("\n--light D65 shines in place of the lights of the picture: D65@day=2\n"), "{told}");
    // A page and a picture of the scene alike.
    let off = ["--size", "8x8", "-D", "mix.off=[\"lamp\"]", "--light", "D65=2", "--json"];
    for command in [&["render", "scene.toml", "-o", "p.png"][..], &["page", "scene.toml", "-o", "p.html"]] {
        assert_eq!(folder.done(&[command, &off].concat()).json()["placed"], placed, "{command:?}");
    }
    // A film has the lights of its scene alone: under another light it opens as the scene does.
    film(&["--light", "FL11@day"]);
    assert_same(&rendered(&folder, &[]), &picture(&folder, &["relight", "acc.exr"]), 1e-5);
}

#[test]
fn accumulators_are_relit_as_their_scene_is_mixed() {
    let folder = Folder::new();
    for mix in
        ["mix.weights.day=0.3", "mix.off=[\"day\"]", "mix.solo=\"lamp\"", "mix={ by = \"dial\", hand = [0.1, 0.4] }"]
    {
        let asked = ["-D", mix, "-D", "display.adapt=true"];
        folder.done(&[&["render", "scene.toml", "--size", SIZE, "--accumulators", "acc.exr"], &asked[..]].concat());
        let fresh = rendered(&folder, &asked);
        assert_same(&fresh, &picture(&folder, &["relight", "acc.exr"]), 1e-5);
        // Requested lights and the dial have the intensities of the scene.
        let day = rendered(&folder, &[&asked[..], &["--light", "day"]].concat());
        assert_same(&day, &picture(&folder, &["relight", "acc.exr", "--light", "day"]), 1e-5);
    }
}

/// Relighting needs no device, scene or volume, and reads files that another program wrote from the documentation.
#[test]
fn accumulators_that_another_program_wrote_are_relit() {
    let ones = vec!["1.0"; 81].join(", ");
    let text = format!(
        "version = 1\n[[components]]\nname = \"paper\"\nspectrum = [{ones}]\n\
         [[positions]]\nname = \"sun\"\nkind = \"directional\"\nvector = [0.0, 0.0, 1.0]\n\
         [[lights]]\nname = \"flat\"\nposition = \"sun\"\nweight = 2.0\nspectrum = [{ones}]\n"
    );
    let channel = |name: &str, values: Vec<f32>| AnyChannel::new(name, FlatSamples::F32(values));
    let channels = vec![channel("sun.paper", vec![0.25, 0.0]), channel("transmittance", vec![0.75, 1.0])];
    let mut attributes = LayerAttributes::named("");
    attributes.layer_name = None;
    attributes.other.insert("relume".into(), AttributeValue::Text(Text::new_or_panic(&text)));
    let encoding = Encoding { compression: Compression::RLE, ..Encoding::FAST_LOSSLESS };
    let layer = Layer::new((2, 1), attributes, encoding, AnyChannels::sort(channels.into()));
    let folder = Folder::new();
    Image::from_layer(layer).write().to_file(folder.path("hand.exr")).unwrap();

    let mut command = folder.command(&["relight", "hand.exr", "-o", "picture.exr"]);
    let outcome = Outcome::of(command.env("VK_DRIVER_FILES", "/dev/null").env("VK_ICD_FILENAMES", "/dev/null"));
    assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    let picture = Exr::read(&folder.path("picture.exr"));
    assert_eq!(picture.channels["A"], [0.25, 0.0]);
    // Half of X = Y = Z = 1 in linear sRGB (row sums of the matrix of IEC 61966-2-1); the sums of the colour matching
    // functions
    // agree to 3e-4.
    for (name, row) in
        [("R", 3.2406 - 1.5372 - 0.4986), ("G", -0.9689 + 1.8758 + 0.0415), ("B", 0.0557 - 0.2040 + 1.0570)]
    {
        let [first, second] = picture.channels[name][..] else { panic!("two pixels") };
        assert!((f64::from(first) - 0.5 * row).abs() <= 1e-3, "{name} is {first}, not {}", 0.5 * row);
        assert_eq!(second.to_bits(), 0, "{name}: nothing is there");
    }
}

/// The ladder bounds the difference between the rungs; here, `--reference` must show the same scene.
#[test]
fn the_reference_shows_what_the_device_shows() {
    let folder = Folder::new();
    let device = rendered(&folder, &[]);
    let reference = rendered(&folder, &["--reference"]);
    let differences = device.iter().zip(&reference).map(|(a, b)| f64::from((a - b).abs()));
    // Devices filter with 8 bits between voxels, and a voxel next to bone differs by half of white: 0.5 / 256.
    let mean = differences.sum::<f64>() / f64::from(u32::try_from(device.len()).unwrap());
    assert!(mean <= 0.5 / 256.0, "mean difference {mean}");
    assert!(device.iter().any(|&value| value > 0.1));
    let json = folder.done(&["render", "scene.toml", "--size", "4x4", "-o", "p.png", "--reference", "--json"]).json();
    assert!(json["device"]["name"].as_str().unwrap().contains("CPU"));
}

#[test]
fn a_definition_is_an_edit_of_the_file() {
    let edited = SCENE.replace("intensity = 0.5", "intensity = 0.25").replace("opacity = 0.1", "opacity = 0.3");
    let folder = Folder::new().with("edited.toml", edited + "[camera]\nprojection = \"orthographic\"\n");
    let flags = [
        "-D",
        "lights.lamp.intensity=0.25",
        "-D",
        "transfer.intervals.0.opacity=0.3",
        "-D",
        "camera.projection=orthographic",
    ];
    folder.done(&[&["render", "scene.toml", "--size", SIZE, "-o", "a.png"], &flags[..]].concat());
    folder.done(&["render", "edited.toml", "--size", SIZE, "-o", "b.png"]);
    let [a, b] = ["a.png", "b.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
    assert!(a == b, "the pictures differ");
}

/// 16×16×16 voxels of a ball with value 200 in 0, as uint8.
fn ball() -> Vec<u8> {
    let inside =
        |i: usize| [i % 16, i / 16 % 16, i / 256].iter().map(|&x| (2 * x).abs_diff(15).pow(2)).sum::<usize>() < 150;
    (0..4096).map(|i| if inside(i) { 200 } else { 0 }).collect()
}

const BALL_HEADER: &str = "NDims = 3\nDimSize = 16 16 16\nElementType = MET_UCHAR\nElementDataFile = ball.raw\n";
const BALL_FLAGS: [&str; 6] = ["--volume", "ball.raw", "--dims", "16x16x16", "--type", "uint8"];

#[test]
fn another_volume_takes_the_place_of_the_scenes() {
    let folder = Folder::new().with("ball.raw", ball()).with("ball.mhd", BALL_HEADER);
    let raw = rendered(&folder, &BALL_FLAGS);
    assert_same(&raw, &rendered(&folder, &["--volume", "ball.mhd"]), 0.0);
    assert!(raw != rendered(&folder, &[]), "the frog is no ball");
}

#[test]
fn averaged_blocks_are_the_volume_of_their_means() {
    let ball = ball();
    let mean = |x: usize, y: usize, z: usize| {
        let at = |i: usize| u32::from(ball[2 * x + (i & 1) + 16 * (2 * y + (i >> 1 & 1)) + 256 * (2 * z + (i >> 2))]);
        u8::try_from(((0..8).map(at).sum::<u32>() + 4) / 8).unwrap()
    };
    let half: Vec<u8> = (0..512).map(|i| mean(i % 8, i / 8 % 8, i / 64)).collect();
    let header = BALL_HEADER.replace("16 16 16", "8 8 8").replace("ball.raw", "half.raw");
    let header = header.replace("ElementData", "ElementSpacing = 2 2 2\nOffset = 0.5 0.5 0.5\nElementData");
    let folder = Folder::new().with("ball.raw", &ball).with("half.raw", half).with("half.mhd", header);
    let averaged = rendered(&folder, &[&BALL_FLAGS[..], &["--downsample", "2x2x2"]].concat());
    assert_same(&averaged, &rendered(&folder, &["--volume", "half.mhd"]), 1e-5);
}

#[test]
fn labels_show_as_what_the_scene_declares() {
    let labels: Vec<u8> = ball().iter().map(|&value| u8::from(value > 0) * 7).collect();
    let folder = Folder::new().with("ball.raw", ball()).with("labels.raw", labels);
    let folder = folder.with("labels.mhd", BALL_HEADER.replace("ball.raw", "labels.raw"));
    // Without labels the ball is bone; label 7 makes it flesh with the same opacity.
    let define = |path: &str, value: &str| ["-D".to_owned(), format!("{path}={value}")];
    let labelled = define("labels.7", "{ material = \"flesh\", opacity = 0.9 }");
    let both: Vec<&str> = ["--labels", "labels.mhd"].into_iter().chain(labelled.iter().map(String::as_str)).collect();
    let flesh = rendered(&folder, &[&BALL_FLAGS[..], &both].concat());
    let bone = rendered(&folder, &BALL_FLAGS);
    let colour = |picture: &[f32]| {
        let sum = |c: usize| picture[c * 1024..][..1024].iter().sum::<f32>();
        (sum(0), sum(1), sum(2))
    };
    // Foliage is green and white is white: under D65 and A, red exceeds green in white.
    let ((r, g, _), (white_r, white_g, _)) = (colour(&flesh), colour(&bone));
    assert!(g > r && white_r > white_g, "flesh {r} {g}, bone {white_r} {white_g}");
    // An undeclared label follows the transfer function and is reported.
    let outcome = folder.done(
        &[
            &[
                "render",
                "scene.toml",
                "-o",
                "p.png",
                "--size",
                "8x8",
                "--labels",
                "labels.mhd",
                "-D",
                "labels.3={material=\"flesh\",opacity=1}",
            ],
            &BALL_FLAGS[..],
        ]
        .concat(),
    );
    assert!(
        outcome.err.starts_with("warning: the scene does not declare these labels") && outcome.err.contains("7 ("),
        "{}",
        outcome.err
    );
}

/// Warnings of `render` with `more`, on the device and with the reference.
fn warnings(folder: &Folder, more: &[&str]) -> [String; 2] {
    [&[][..], &["--reference"]]
        .map(|how| folder.done(&[&["render", "scene.toml", "-o", "p.png", "--size", "8x8"], more, how].concat()).err)
}

#[test]
fn labels_that_are_not_used_or_not_declared_are_reported() {
    let labels = [7; 4096];
    let folder = Folder::new().with("ball.raw", ball()).with("labels.raw", labels);
    let folder = folder.with("labels.mhd", BALL_HEADER.replace("ball.raw", "labels.raw"));
    let flags = [&BALL_FLAGS[..], &["--labels", "labels.mhd"]].concat();
    for err in warnings(&folder, &flags) {
        assert!(err.starts_with("warning: --labels labels.mhd: the scene declares no labels"), "{err}");
        assert_eq!(err.lines().count(), 1, "{err}");
    }
    for err in warnings(&folder, &[&flags[..], &["-D", "labels.3={material=\"flesh\",opacity=1}"]].concat()) {
        assert!(err.starts_with("warning: the scene does not declare these labels") && err.contains("7 ("), "{err}");
    }
    let declared = warnings(&folder, &["-D", "labels.3={material=\"flesh\",opacity=1}"]);
    assert_eq!(declared, ["", ""], "labels that are not there are no matter");
    let quiet = folder.done(&[&["render", "scene.toml", "-o", "p.png", "--json", "--quiet"], &flags[..]].concat());
    assert_eq!(quiet.err, "");
    let told = quiet.json()["warnings"][0].as_str().unwrap().to_owned();
    assert!(told.starts_with("--labels labels.mhd: the scene declares no labels"), "{told}");
}

#[test]
fn many_undeclared_labels_are_cut_short() {
    let labels: Vec<u8> =
        (0..4096).map(|index| if index < 4000 { 1 } else { u8::try_from(index - 4000 + 2).unwrap() }).collect();
    let folder = Folder::new().with("ball.raw", ball()).with("labels.raw", labels);
    let folder = folder.with("labels.mhd", BALL_HEADER.replace("ball.raw", "labels.raw"));
    let declared = ["--labels", "labels.mhd", "-D", "labels.200={material=\"flesh\",opacity=1}"];
    for err in warnings(&folder, &[&BALL_FLAGS[..], &declared].concat()) {
        assert!(err.contains("1 (4000 voxels), 2 (1 voxel), "), "{err}");
        assert!(err.trim_end().ends_with("8 (1 voxel), and 89 more"), "{err}");
    }
}

#[test]
fn spectra_that_nature_does_not_have_are_reported() {
    let folder = Folder::new().with("percent.csv", "400,20\n700,80\n").with("odd.csv", "400,-1\n500,9\n700,9\n");
    for err in warnings(&folder, &["-D", "materials.bone.reflectance=percent.csv"]) {
        let said = "warning: materials.bone.reflectance reaches 80";
        assert!(err.starts_with(said) && err.contains("percent"), "{err}");
    }
    for err in warnings(&folder, &["-D", "background=2"]) {
        assert!(err.starts_with("warning: background reaches 2") && !err.contains("percent"), "{err}");
    }
    for err in warnings(&folder, &["-D", "lights.lamp.spectrum=odd.csv"]) {
        assert!(err.starts_with("warning: lights.lamp.spectrum is negative"), "{err}");
    }
    for err in warnings(&folder, &["--light", "odd.csv"]) {
        assert!(err.starts_with("warning: the light odd.csv is negative"), "{err}");
    }
    // Artificial reflectances may be negative, and white may be 1.
    assert_eq!(warnings(&folder, &["-D", "materials.bone.reflectance={400=-0.5,700=1}"]), ["", ""]);
    assert_eq!(warnings(&folder, &["-D", "materials.bone.reflectance={srgb=\"#ffffff\"}"]), ["", ""]);
}

#[test]
fn what_leaves_a_picture_black_is_said_on_every_device() {
    let folder = Folder::new();
    for err in warnings(&folder, &["-D", "lights={}"]) {
        assert!(err.contains("no light shines"), "{err}");
    }
    for err in warnings(&folder, &["-D", "transfer.intervals=[]"]) {
        assert!(err.contains("no material is visible"), "{err}");
    }
}

#[test]
fn labels_that_lie_elsewhere_than_the_volume_are_reported() {
    let folder = Folder::new().with("ball.raw", ball()).with("ball.mhd", BALL_HEADER);
    let elsewhere = |geometry: &str| {
        let header = BALL_HEADER.replace("ElementData", &format!("{geometry}\nElementData"));
        std::fs::write(folder.path("labels.mhd"), header).unwrap();
        let flags = ["--volume", "ball.mhd", "--labels", "labels.mhd", "-D", "volume.spacing=[3,3,3]"];
        warnings(&folder, &[&flags[..], &["-D", "labels.200={material=\"flesh\",opacity=1}"]].concat())
    };
    for same in ["ElementSpacing = 1 1 1.0005", "Offset = 0.0005 0 0", "TransformMatrix = 1 0.0005 0 -0.0005 1 0 0 0 1"]
    {
        assert_eq!(elsewhere(same), ["", ""], "{same}");
    }
    for other in ["ElementSpacing = 1 1 1.01", "Offset = 0.5 0 0", "TransformMatrix = -1 0 0 0 -1 0 0 0 1"] {
        for err in elsewhere(other) {
            assert!(err.starts_with("warning: ") && err.contains("labels.mhd") && err.contains("ball.mhd"), "{err}");
            assert_eq!(err.lines().count(), 1, "{err}");
        }
    }
}

#[test]
fn values_at_the_ends_of_f64_are_shown_and_warnings_stay_short() {
    let bytes =
        |values: [f64; 2]| -> Vec<u8> { (0..512).flat_map(|i| values[usize::from(i % 8 > 3)].to_le_bytes()).collect() };
    let header = "NDims = 3\nDimSize = 8 8 8\nElementType = MET_DOUBLE\nElementDataFile = v.raw\n";
    let folder = Folder::new().with("v.mhd", header);
    for values in [[-1.7e308, 1.7e308], [1.7e308, 1.7e308], [f64::MAX, f64::MAX], [0.0, 1e300]] {
        std::fs::write(folder.path("v.raw"), bytes(values)).unwrap();
        let shown = "transfer.intervals=[{material=\"bone\",range=[1e299,1.7976931348623157e308],opacity=0.9}]";
        for shading in ["shading=none", "shading=gradient"] {
            let flags = ["--volume", "v.mhd", "-D", shown, "-D", shading];
            let picture = rendered(&folder, &flags);
            assert!(picture.iter().any(|&value| value > 0.1), "{values:?}, {shading}: black");
            let [err, _] = warnings(&folder, &flags);
            assert!(!err.contains("inf") && err.len() < 200, "{values:?}: {err}");
        }
    }
}

#[test]
fn spectral_pictures_have_the_layout_of_fichet_and_others() {
    let folder = Folder::new();
    folder.done(&["render", "scene.toml", "--size", SIZE, "--spectral", "s.exr", "-o", "p.exr"]);
    let (spectral, linear) = (Exr::read(&folder.path("s.exr")), Exr::read(&folder.path("p.exr")));
    let mut bands: Vec<String> = (0..81).map(|band| format!("S0.{},000nm", 380 + 5 * band)).collect();
    bands.extend(["R", "G", "B"].map(str::to_owned));
    bands.sort();
    assert_eq!(spectral.channels.keys().cloned().collect::<Vec<_>>(), bands);
    assert_eq!(spectral.attributes["spectralLayoutVersion"], "1.0");
    assert_eq!(spectral.attributes["emissiveUnits"], "W.m^-2.sr^-1");
    for name in ["R", "G", "B"] {
        assert_eq!(spectral.channels[name], linear.channels[name], "the preview is the picture");
    }
    read_by_python(&folder.path("s.exr"));
}

/// Reads a spectral file with colour-science, using the Python in `RELUME_PYTHON`.
#[expect(clippy::print_stderr, reason = "a test that did not run says so")]
fn read_by_python(path: &Path) {
    let Some(python) = std::env::var_os("RELUME_PYTHON") else {
        assert!(std::env::var_os("CI").is_none(), "CI needs RELUME_PYTHON, which scripts/test sets");
        eprintln!(
            "NOT RUN: RELUME_PYTHON names no Python with colour-science and OpenEXR, so no other program read it"
        );
        return;
    };
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools/read_spectral.py");
    let output = std::process::Command::new(python).arg(script).arg(path).output().unwrap();
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{out}{err}");
    eprintln!("{out}");
}

#[test]
fn warnings_go_to_standard_error_and_can_be_left_out() {
    let folder = Folder::new().with("ball.raw", [ball(), vec![0]].concat());
    let arguments = [&["render", "scene.toml", "--size", "8x8", "-o", "p.png"], &BALL_FLAGS[..]].concat();
    let outcome = folder.done(&arguments);
    assert!(outcome.err.starts_with("warning: ball.raw: 4097 bytes"), "{}", outcome.err);
    assert!(outcome.out.starts_with("wrote"), "{}", outcome.out);
    assert_eq!(folder.done(&[&arguments[..], &["--quiet"]].concat()).err, "");
}

#[test]
fn help_teaches_by_examples() {
    let folder = Folder::new();
    for command in ["render", "relight", "info", "bench"] {
        let text = folder.done(&[command, "--help"]).out;
        assert!(text.contains("Examples:\n  relume "), "{text}");
    }
    let outcome = folder.run(&[]);
    assert_eq!(outcome.code, Some(2));
    for word in ["render", "relight", "info", "bench", "Examples:", "Exit codes:"] {
        assert!(outcome.err.contains(word), "no {word:?} in {}", outcome.err);
    }
    assert!(folder.done(&["--version"]).out.contains(env!("CARGO_PKG_VERSION")));
}

/// The example of docs/SCENE.md without the lines for other kinds of volume and camera.
fn documented_scene() -> String {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/SCENE.md")).unwrap();
    text.split("```toml\n").nth(1).unwrap().split("```").next().unwrap().to_owned()
}

#[test]
fn the_documented_scene_is_a_scene() {
    let for_files = ["file =", "labels =", "type =", "slices =", "downsample =", "dims ="];
    let kept = documented_scene();
    let kept = kept.lines().filter(|line| !for_files.iter().any(|key| line.starts_with(key)));
    let kept: Vec<&str> =
        kept.map(|line| if line.starts_with("# phantom =") { "phantom = \"frog\"" } else { line }).collect();
    let folder = Folder::new().with("documented.toml", kept.join("\n"));
    folder.done(&["info", "documented.toml"]);
}

/// The keys that the program expects are those in the documentation.
#[test]
fn every_key_of_a_scene_is_documented() {
    let folder = Folder::new();
    let documented = documented_scene();
    for table in [
        "",
        "volume.",
        "materials.flesh.",
        "transfer.",
        "transfer.intervals.0.",
        "labels.1.",
        "lights.day.",
        "dial.",
        "mix.",
        "camera.",
        "crop.",
        "accuracy.",
        "display.",
    ] {
        let outcome = folder.run(&["info", "scene.toml", "-D", &format!("{table}zzzzzz=1")]);
        let expected = outcome.err.split("expected one of ").nth(1).or(outcome.err.split("expected ").nth(1)).unwrap();
        let keys: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
        assert!(keys.len() >= 2, "{}", outcome.err);
        // `situations` is the former name of `presets`.
        for key in keys.into_iter().filter(|key| !["emission", "fluorescence", "situations"].contains(key)) {
            let header = format!("[{key}");
            let written = |line: &str| {
                let line = line.trim_start_matches(['#', ' ', '{']);
                line.starts_with(&header)
                    || line.starts_with(&format!("[[{table}{key}]]"))
                    || line.starts_with(&format!("{key} ="))
                    || line.contains(&format!(" {key} = "))
            };
            assert!(documented.lines().any(written), "{table}{key} is not in docs/SCENE.md");
        }
    }
}

/// Picture of `relight` with `arguments` from the film of the base scene.
fn dialled(folder: &Folder, arguments: &[&str]) -> Vec<f32> {
    picture(folder, &[&["relight", "acc.exr"], arguments].concat())
}

#[test]
fn the_hand_of_the_dial_mixes_lights_and_on_a_node_is_that_light_alone() {
    let folder = Folder::new();
    folder.done(&["render", "scene.toml", "--size", SIZE, "--accumulators", "acc.exr", "-D", "dial.nodes.day=[2,1]"]);
    let day = dialled(&folder, &["--light", "day"]);
    assert_eq!(dialled(&folder, &["--dial", "2,1", "-o", "p.png"]), day, "the scene's place is in the file");
    assert_eq!(dialled(&folder, &["--dial", "-9,-9", "--nodes-off", "lamp"]), day);
    // Halfway between the two nodes each light has half the weight: lamp has the intensity 0.5, and white keeps the
    // luminance 1.
    let json = folder.done(&["relight", "acc.exr", "--sweep", "lamp..day", "--frames", "3", "-o", "s.png", "--json"]);
    let frames = json.json()["frames"].clone();
    assert_eq!(frames[2]["dial"], serde_json::json!([2.0, 1.0]));
    let weights: Vec<f64> = (0..2).map(|light| frames[1]["lights"][light]["weight"].as_f64().unwrap()).collect();
    let [lamp, day] = [weights[0], weights[1]];
    assert!((lamp + day - 1.0).abs() < 1e-9 && (day - 2.0 * lamp).abs() < 1e-9, "{weights:?}");
    let names = folder.names();
    for name in ["s-0001.png", "s-0002.png", "s-0003.png"] {
        assert!(names.iter().any(|there| there == name), "no {name} in {names:?}");
    }
    assert!(!names.iter().any(|name| name == "s.png"));
    folder.done(&["relight", "acc.exr", "--loop", "--frames", "2", "-o", "t.png"]);
    assert_eq!(std::fs::read(folder.path("t-0001.png")).unwrap(), std::fs::read(folder.path("s-0003.png")).unwrap());
}

#[test]
fn a_dial_that_cannot_be_turned_so_is_refused() {
    let folder = Folder::new();
    folder.done(&["render", "scene.toml", "--size", "4x4", "--accumulators", "acc.exr"]);
    for (arguments, words) in [
        (&["--dial", "north"][..], "write x,y"),
        (&["--dial", "0,0", "--light", "A"], "cannot be used with"),
        (&["--nodes-off", "lamp"], "--dial, --dial-preset, --sweep or --loop"),
        (&["--dial", "0,0", "--nodes-off", "lam"], "there are: day, lamp"),
        (&["--sweep", "day"], "A..B"),
        (&["--sweep", "day..night"], "night: there is no such light"),
        (&["--dial", "0,0", "--frames", "7"], "--sweep <A..B>|--loop"),
        (&["--frames", "3"], "--sweep <A..B>|--loop"),
        (&["--dial-preset", "dusk"], "dusk: the dial has no presets; [[dial.presets]]"),
    ] {
        folder.refused(2, &[&["relight", "acc.exr", "-o", "p.png"], arguments].concat(), &[words]);
    }
    let all_off = ["--dial", "0,0", "--nodes-off", "lamp", "--nodes-off", "day"];
    let outcome = folder.done(&[&["relight", "acc.exr", "-o", "p.png"], &all_off[..]].concat());
    assert!(outcome.err.starts_with("warning: all nodes of the dial are off"), "{}", outcome.err);
}

/// Frames of an animated PNG.
fn animation(path: &Path) -> Vec<Vec<u8>> {
    let mut reader = png::Decoder::new(std::io::BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let control = *reader.info().animation_control().unwrap();
    assert_eq!(control.num_plays, 0, "it repeats without end");
    let frame = |_| {
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        let control = reader.info().frame_control().unwrap();
        assert_eq!((control.delay_num, control.delay_den), (1, 12), "12 pictures per second");
        bytes
    };
    (0..control.num_frames).map(frame).collect()
}

#[test]
fn an_animated_png_has_the_frames_of_the_numbered_pictures() {
    let folder = Folder::new();
    folder.done(&["render", "scene.toml", "--size", SIZE, "--accumulators", "acc.exr"]);
    let path = ["relight", "acc.exr", "--loop", "--frames", "3", "--fps", "12"];
    folder.done(&[&path[..], &["-o", "l.apng"]].concat());
    let told = folder.done(&[&path[..], &["-o", "l.png"]].concat()).out;
    assert!(told.contains("ffmpeg -framerate 12 -i \"l-%04d.png\" -vf \"pad=ceil(iw/2)*2:ceil(ih/2)*2\""), "{told}");
    let bytes = |name: &str| -> Vec<u8> {
        png(&folder.path(name)).1.into_iter().map(|sample| sample.try_into().unwrap()).collect()
    };
    let frames = animation(&folder.path("l.apng"));
    assert_eq!(frames, ["l-0001.png", "l-0002.png", "l-0003.png"].map(bytes));
    folder.refused(2, &["relight", "acc.exr", "-o", "p.apng"], &["p.apng", "still picture"]);
    folder.refused(2, &[&path[..], &["-o", "p.apng", "-o", "q.png"]].concat(), &["only output"]);
}

#[test]
fn a_turntable_shows_the_volume_from_all_around() {
    let folder = Folder::new();
    let parallel = ["-D", "camera.projection=\"orthographic\"", "-D", "camera.height=40", "-D", "camera.azimuth=30"];
    let scene = ["render", "scene.toml", "--size", SIZE];
    let turn = [&scene[..], &parallel, &["--turntable", "4"]].concat();
    folder.done(&[&turn[..], &["-o", "t.png"]].concat());
    for (name, azimuth) in [("t-0001.png", 30), ("t-0002.png", 120), ("t-0003.png", 210), ("t-0004.png", 300)] {
        let azimuth = format!("camera.azimuth={azimuth}");
        folder.done(&[&scene[..], &parallel, &["-D", &azimuth, "-o", "still.png"]].concat());
        let (turned, still) = (png(&folder.path(name)).1, png(&folder.path("still.png")).1);
        assert!(still.iter().any(|&code| code > 40), "the picture is not black");
        // The eyes differ by rounding.
        let apart = turned.iter().zip(&still).map(|(one, two)| one.abs_diff(*two)).max();
        assert!(apart <= Some(1), "{name}: {apart:?} codes");
    }
    assert!(!folder.names().contains(&"t-0005.png".to_owned()));
    folder.done(&[&turn[..], &["-o", "t.apng", "--fps", "12"]].concat());
    assert_eq!(animation(&folder.path("t.apng")).len(), 4);
    // Linear pictures have neither backdrop nor annotations.
    let dressed = ["--background", "#ffffff", "--annotate", "-o", "d.exr", "-o", "d.png"];
    folder.done(&[&turn[..], &dressed].concat());
    folder.done(&[&turn[..], &["-o", "e.exr"]].concat());
    let linear = |name: &str| Exr::read(&folder.path(name)).rgba();
    assert!(linear("d-0002.exr") == linear("e-0002.exr"), "a linear picture is dressed");
    assert!(png(&folder.path("d-0002.png")).1 != png(&folder.path("t-0002.png")).1, "a PNG is not dressed");
    folder.refused(2, &[&turn[..], &["-o", "u.png", "--reference"]].concat(), &["--reference"]);
    folder.refused(2, &[&scene[..], &["-o", "u.png", "--fps", "12"]].concat(), &["--fps", "--turntable"]);
}

#[test]
fn steps_of_equal_visible_change_end_on_the_same_nodes() {
    let folder = Folder::new();
    // Near its node a light outshines the others, so that equal steps of the hand change little there.
    let far = ["-D", "lights.lamp.intensity=0.01", "--accumulators", "acc.exr"];
    folder.done(&[&["render", "scene.toml", "--size", SIZE], &far[..]].concat());
    let sweep = ["relight", "acc.exr", "--sweep", "day..lamp", "--frames", "5", "-o", "s.exr", "--json"];
    let heights = |more: &[&str]| -> Vec<f64> {
        let json = folder.done(&[&sweep[..], more].concat()).json();
        json["frames"].as_array().unwrap().iter().map(|frame| frame["dial"][1].as_f64().unwrap()).collect()
    };
    let differences = || -> Vec<f64> {
        let pictures: Vec<_> = (1..=5).map(|n| Exr::read(&folder.path(&format!("s-000{n}.exr"))).rgba()).collect();
        let apart = |pair: &[Vec<f32>]| pair[0].iter().zip(&pair[1]).map(|(a, b)| f64::from((a - b).abs())).sum();
        pictures.windows(2).map(apart).collect()
    };
    let spread =
        |steps: &[f64]| steps.iter().copied().fold(0.0, f64::max) / steps.iter().copied().fold(f64::INFINITY, f64::min);
    let (even, of_hand) = (heights(&[]), differences());
    let (visible, of_eye) = (heights(&["--steps", "visible"]), differences());
    assert_eq!((visible[0], visible[4]), (even[0], even[4]));
    assert!(visible.windows(2).all(|pair| pair[1] < pair[0]), "{visible:?}");
    assert!(spread(&of_eye) < 0.8 * spread(&of_hand), "{of_eye:?}, {of_hand:?}");
    folder.refused(2, &["relight", "acc.exr", "--steps", "visible", "-o", "p.png"], &["--sweep"]);
}

#[test]
fn annotations_lie_over_the_picture_and_leave_the_rest_as_it_is() {
    let scene = SCENE.replace("materials.flesh", "materials.\"flesh & <b>\"").replace("\"flesh\"", "\"flesh & <b>\"");
    let folder = Folder::new().with("scene.toml", scene);
    let sized = ["render", "scene.toml", "--size", "256x256"];
    folder.done(&[&sized[..], &["-o", "plain.png", "-o", "plain.exr"]].concat());
    let annotated = ["--annotate", "--title", "a <b> & c", "-o", "a.png", "-o", "a.exr"];
    folder.done(&[&sized[..], &annotated].concat());
    let samples = |name: &str| {
        let file = std::io::BufReader::new(File::open(folder.path(name)).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        bytes
    };
    let (plain, annotated) = (samples("plain.png"), samples("a.png"));
    let differs = |&index: &usize| annotated[3 * index..][..3] != plain[3 * index..][..3];
    let changed: Vec<[usize; 2]> = (0..256 * 256).filter(differs).map(|i| [i % 256, i / 256]).collect();
    let within = |columns: std::ops::Range<usize>, rows: std::ops::Range<usize>| {
        changed.iter().any(|[x, y]| columns.contains(x) && rows.contains(y))
    };
    // Letters are 11 pixels high; the bar is at most a quarter as wide as the picture, one letter above its bottom.
    assert!(within(8..76, 240..247) && !within(76..256, 240..247), "a scale bar");
    assert!(within(11..22, 30..60), "swatches of the legend");
    assert!(!within(0..5, 0..256) && !within(251..256, 0..256), "nothing runs out of the picture");
    let linear = |name: &str| Exr::read(&folder.path(name)).rgba();
    assert!(linear("a.exr") == linear("plain.exr"), "a linear picture is annotated");
    folder.refused(2, &[&sized[..], &["--title", "t", "-o", "t.png"]].concat(), &["--annotate"]);
}

#[test]
fn times_and_arrays_are_listed_by_info() {
    let header =
        "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 2 2 1 3\nkinds: space space space time\nencoding: raw\n\n";
    let folder = Folder::new().with("beat.nrrd", [header.as_bytes(), &[7; 12]].concat());
    let listed = folder.done(&["info", "beat.nrrd"]).out;
    assert!(listed.contains("3 time steps") && listed.contains("0 to 2") && listed.contains("--time N"), "{listed}");
    assert_eq!(folder.done(&["info", "beat.nrrd", "--json"]).json()["times"], 3);
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/hdf5/netcdf3.nc");
    let listed = folder.done(&["info", file]).out;
    assert!(listed.contains("/kelvin\n") && listed.contains("/wind\n") && listed.contains("--array NAME"), "{listed}");
    assert_eq!(folder.done(&["info", file, "--json"]).json()["arrays"], serde_json::json!(["/kelvin", "/wind"]));
}

#[test]
fn a_spacing_that_is_given_needs_no_warning() {
    let header = b"\x93NUMPY\x01\0\x4b\0{'descr': '|u1', 'fortran_order': False, 'shape': (2, 2, 3), }            \n";
    let folder = Folder::new()
        .with("v.npy", [&header[..], &[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]].concat())
        .with("v.toml", "version = 1\n[volume]\nfile = \"v.npy\"\nspacing = [2, 2, 3]\nunit = \"nm\"\n");
    let said = folder.done(&["info", "v.npy"]);
    assert!(said.err.contains("NumPy files have no spacing"), "{}", said.err);
    let said = folder.done(&["info", "v.npy", "--spacing", "0.2x0.2x0.6um"]);
    assert!(said.out.contains("0.2 × 0.2 × 0.6 µm") && !said.err.contains("spacing"), "{}{}", said.out, said.err);
    let said = folder.done(&["info", "v.toml"]);
    assert!(!said.err.contains("no spacing"), "{}", said.err);
    // The spacing is that of the voxels of the file, before they are averaged.
    let arguments = ["convert", "v.npy", "v.nrrd", "--spacing", "1x2x4mm", "--downsample", "1x2x2"];
    assert!(!folder.done(&arguments).err.contains("no spacing"));
    let json = folder.done(&["info", "v.nrrd", "--json"]).json();
    assert_eq!((&json["spacing"], &json["unit"]), (&serde_json::json!([1.0, 4.0, 8.0]), &"mm".into()));
    folder.refused(2, &["info", "v.npy", "--spacing", "1x1x1furlong"], &["furlong is no unit", "um"]);
    folder.refused(2, &["info", "--spacing", "1x1x1"], &["--spacing has no effect"]);
}
