//! Invalid input is refused with one message and the right exit code, without leaving files behind; unusual input
//! works.

use crate::support;

use std::io::Write as _;

use exr::prelude::{ReadChannels as _, ReadLayers as _};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use relume::vulkan::{Device, DeviceChoice, Validation};
use support::program::{Folder, Outcome, SCENE};

/// Arguments of `render scene.toml` to a small picture, and more.
fn render<'a>(more: &[&'a str]) -> Vec<&'a str> {
    [&["render", "scene.toml", "--size", "8x8", "-o", "p.png"], more].concat()
}

/// Asserts that the base scene with `from` replaced by `to` is refused at `line:column`, with `words`.
fn scene_refused(from: &str, to: &str, place: &str, words: &[&str]) {
    assert!(SCENE.contains(from), "the scene has no {from:?}");
    let folder = Folder::new().with("scene.toml", SCENE.replacen(from, to, 1));
    let at = format!("scene.toml:{place}: ");
    folder.refused(1, &render(&[]), &[&[at.as_str()], words].concat());
}

/// Asserts that the scene with `-D definition` is refused with `words`, naming the definition.
fn definition_refused(definition: &str, words: &[&str]) {
    let named = format!("error: -D {definition}: ");
    Folder::new().refused(2, &render(&["-D", definition]), &[&[named.as_str()], words].concat());
}

// Scenes.

#[test]
fn unknown_keys_are_refused_at_every_level_where_they_stand() {
    scene_refused(
        "version = 1",
        "version = 1\nlightz = 1",
        "2:1",
        &["unknown field `lightz`", "did you mean `lights`?"],
    );
    scene_refused("dims =", "dimz =", "4:1", &["unknown field `dimz`", "`spacing`", "did you mean `dims`?"]);
    scene_refused("specular", "speculer", "7:1", &["did you mean `specular`?"]);
    scene_refused("intervals =", "interval =", "11:1", &["did you mean `intervals`?"]);
    scene_refused("ramp =", "rump =", "12:45", &["did you mean `ramp`?"]);
    scene_refused("kind =", "knd =", "17:1", &["did you mean `kind`?"]);
    for (table, known) in [("camera", "azimuth"), ("accuracy", "termination"), ("display", "exposure"), ("crop", "min")]
    {
        let text = format!("version = 1\n[{table}]\nnonsense = 1\n");
        scene_refused("version = 1\n", &text, "3:1", &["unknown field `nonsense`", known]);
    }
    scene_refused(
        "[transfer]",
        "[labels.1]\nnonsense = 1\n[transfer]",
        "11:1",
        &["unknown field `nonsense`", "opacity"],
    );
}

#[test]
fn wrong_types_and_words_are_refused_where_they_stand() {
    scene_refused("version = 1", "version = \"1\"", "1:11", &["invalid type: string \"1\"", "expected a whole number"]);
    scene_refused("[32, 30, 18]", "[32, 30]", "4:8", &["an array of length 3"]);
    scene_refused(
        "intensity = 0.5",
        "intensity = true",
        "22:13",
        &["= true; it must be a number from 0 to 1000000000"],
    );
    scene_refused("\"directional\"", "\"direct\"", "17:8", &["unknown variant `direct`", "`headlight`"]);
    scene_refused("spectrum = \"A\"", "spectrum = true", "20:12", &["a spectrum"]);
    scene_refused("spectrum = \"A\"\n", "", "19:1", &["missing field `spectrum`"]);
    scene_refused("version = 1\n", "", "1:1", &["missing field `version`"]);
    scene_refused("version = 1", "version = 2", "1:11", &["version = 2", "reads scene version 1"]);
}

#[test]
fn every_range_is_stated_where_it_is_left() {
    for (definition, range) in [
        ("materials.flesh.ambient=1.5", "from 0 to 1"),
        ("materials.flesh.diffuse=-1", "from 0 to 1"),
        ("materials.flesh.specular=nan", "from 0 to 1"),
        ("materials.flesh.exponent=0", "from 1 to 1024"),
        ("materials.flesh.exponent=1025", "from 1 to 1024"),
        ("lights.day.intensity=-1", "from 0 to 1000000000"),
        ("lights.day.intensity=inf", "from 0 to 1000000000"),
        ("lights.day.direction=[0,0,0]", "no direction"),
        ("lights.day.direction=[nan,0,0]", "not finite"),
        ("transfer.opacity_length=0", "above 0"),
        ("transfer.opacity_length=-1", "above 0"),
        ("transfer.entries=1", "from 2 to 1048576"),
        ("transfer.intervals.0.opacity=1.1", "from 0 to 1"),
        ("transfer.intervals.0.ramp=-1", "a finite number from 0"),
        ("transfer.intervals.0.range=[9,3]", "the lower one first"),
        ("accuracy.step=0", "above 0"),
        ("accuracy.step=inf", "above 0"),
        ("accuracy.termination=0.6", "from 0 to 0.5"),
        ("display.exposure=-1", "from 0 to 1000000000"),
        ("camera.fov=0", "from 0.001 to 179"),
        ("camera.elevation=90", "from -89.9 to 89.9"),
        ("camera.azimuth=inf", "a finite number"),
        ("camera.fill=0", "from 0.01 to 100"),
        ("camera.up=[0,0,0]", "no direction"),
        ("camera.front=[0,0,0]", "no direction"),
        ("camera={projection=\"orthographic\",height=0}", "above 0"),
        ("volume.dims=[0,1,1]", "from 1"),
        ("volume.downsample=[0,1,1]", "from 1"),
        ("volume.spacing=[1,1,0]", "positive"),
        ("volume.origin=[nan,0,0]", "not finite"),
        ("volume.direction=[1,0,0,0,1,0,0,0,0]", "not orthonormal"),
        ("volume.header_bytes=-1", "a whole number from 0"),
        ("volume.dims=[-1,1,1]", "a whole number from 1"),
        ("transfer.entries=-1", "from 2 to 1048576"),
        ("accuracy.k=-1", "a whole number from 1 to 31"),
        ("materials.flesh.exponent=1.5", "a whole number"),
        ("materials.flesh.exponent=-1", "from 1 to 1024"),
        ("labels.-1={material=\"flesh\",opacity=1}", "a whole number from 0 to 9223372036854775807"),
        ("labels.others={material=\"flesh\",opacity=1}", "labels.others"),
        ("labels.4={materials=[\"flesh\"],material=\"flesh\",opacity=1}", "one label has one `material`"),
        ("labels.1={material=\"flesh\",opacity=2}", "from 0 to 1"),
        ("labels.1={name=\"a\",material=\"flesh\"}", "opacity"),
        ("labels.1={opacity=1,transfer={intervals=[{material=\"flesh\",range=[1,2],opacity=1}]}}", "remove its own"),
        ("labels.1.transfer={}", "labels.1.transfer shows nothing"),
        ("labels.1.transfer={intervals=[{material=\"flesh\",range=[2,1],opacity=1}]}", "the lower one first"),
        (
            "labels.1.transfer={intervals=[{material=\"flesh\",range=[1,2],opacity=1,gradient=[[0,1],[9,0]]}]}",
            "labels have no factors by the gradient",
        ),
        ("labels.others={materials=[\"flesh\"],opacity=1,transfer={}}", "nor `transfer`"),
        ("labels={3={material=\"flesh\",opacity=1},03={material=\"bone\",opacity=1}}", "label 3 is declared twice"),
        ("version=2", "reads scene version 1"),
    ] {
        definition_refused(definition, &[range]);
    }
}

#[test]
fn names_that_nothing_has_are_refused_with_those_there_are() {
    scene_refused("material = \"flesh\"", "material = \"blood\"", "12:18", &["no material \"blood\"", "bone, flesh"]);
    scene_refused("\"foliage\"", "\"folage\"", "6:15", &["materials.flesh.reflectance", "did you mean \"foliage\"?"]);
    scene_refused("\"D65\"", "\"foliage\"", "16:12", &["foliage is a reflectance, and cannot be used as a light"]);
    scene_refused("\"frog\"", "\"dog\"", "3:11", &["unknown phantom \"dog\"", "frog, engine"]);
    definition_refused("labels.1={material=\"skin\",opacity=1}", &["no material \"skin\""]);
    definition_refused("lights.dya.intensity=2", &["lights.dya", "day, lamp", "missing field `spectrum`"]);
    definition_refused("shadin=1", &["unknown field `shadin`", "`shading`"]);
    definition_refused("lights.new.kind=ambient", &["missing field `spectrum`"]);
    definition_refused("transfer.intervals.2.opacity=1", &["\"2\"", "0 to 1"]);
    definition_refused("volume.phantom.x=1", &["\"x\"", "there is no key"]);
    definition_refused("nothing", &["write key=value"]);
    definition_refused("=1", &["key is empty"]);
}

#[test]
fn an_error_of_the_file_is_no_error_of_a_definition() {
    let folder = Folder::new().with("scene.toml", SCENE.replace("specular = 0.2", "specular = 3"));
    folder.refused(1, &render(&["-D", "lights.day.intensity=2"]), &["scene.toml:7:12: ", "from 0 to 1"]);
}

#[test]
fn what_does_not_factor_by_the_light_is_refused_with_the_reason() {
    for key in ["emission", "fluorescence"] {
        scene_refused(
            "specular = 0.2",
            &format!("{key} = \"D65\""),
            &format!("7:{}", key.len() + 4),
            &[&format!("materials.flesh.{key}"), "`reflectance`"],
        );
    }
}

#[test]
fn an_xray_material_of_opacity_one_is_refused() {
    let xray = SCENE.replace("\"white 9.5\"", "\"white 9.5\"\nxray = true").replace("opacity = 0.9", "opacity = 1");
    let folder = Folder::new().with("scene.toml", xray);
    folder.refused(1, &render(&[]), &["scene.toml:14:56: ", "X-ray material bone", "less than 1"]);
}

#[test]
fn points_of_the_opacity_by_gradient_and_kinds_of_lighting_that_do_not_exist_are_refused() {
    definition_refused("transfer.gradient_opacity=[[5,0],[5,1]]", &["the value 5 follows 5"]);
    definition_refused("transfer.gradient_opacity=[[-1,0],[5,1]]", &["starts at -1", "at least 0"]);
    definition_refused("transfer.gradient_opacity=[[1,1.5]]", &["[1, 1.5]", "a factor from 0 to 1"]);
    definition_refused("transfer.gradient_opacity=[]", &["at least one point"]);
    let many: Vec<String> = (0..17).map(|magnitude| format!("[{magnitude},0]")).collect();
    let many = format!("transfer.gradient_opacity=[{}]", many.join(","));
    definition_refused(&many, &["17 points", "the limit is 16"]);
    definition_refused("transfer.intervals.bone.gradient=[[-1,0],[5,1]]", &["gradient starts at -1", "at least 0"]);
    let five: Vec<String> =
        (1..=5).map(|n| format!("{{material=\"bone\",range=[1,9],opacity=0.1,gradient=[[{n},0],[9,1]]}}")).collect();
    let five = format!("transfer.intervals=[{}]", five.join(","));
    definition_refused(&five, &["5 different factors by the gradient", "the limit is 4"]);
    definition_refused("lighting=\"both\"", &["`both`", "`two_sided`", "`one_sided`"]);
    definition_refused(
        "lights.day={spectrum=\"D65\",kind=\"three_point\",direction=[1,0,0]}",
        &["other lights neither"],
    );
}

#[test]
fn combinations_that_say_two_things_are_refused() {
    definition_refused("lights.day.kind=point", &["a point light a `position`"]);
    definition_refused("camera.position=[1,1,1]", &["`position`", "`target`"]);
    definition_refused("camera={position=[9,9,9],target=[0,0,0],azimuth=1}", &["no `azimuth`"]);
    definition_refused("camera.height=3", &["a perspective camera has a `fov`"]);
    definition_refused("transfer.opacity=[[0,0],[255,1]]", &["needs a `material` curve"]);
    definition_refused("transfer.material=[[0,\"bone\"]]", &["needs an `opacity` curve"]);
    definition_refused("crop={min=[0,0,0],max=[32,29,17]}", &["on axis x", "from 0 to 31"]);
    definition_refused("crop={min=[5,5,5],max=[4,6,6]}", &["the lower one first"]);
    definition_refused("crop={min=[5,5,5],max=[6,6,5]}", &["on axis z", "from 0 to 17"]);
    definition_refused("clip.planes=[\"q:3\"]", &["\"q:3\"", "no such direction", "DIRECTION:PLACE"]);
    definition_refused("clip.planes=[\"left:50%\"]", &["a patient's sides"]);
    definition_refused("clip.planes=[\"z:120%\"]", &["from 0% to 100%"]);
    definition_refused("clip.planes=[{point=[0,0,0],normal=[0,0,0]}]", &["the normal", "a direction"]);
    definition_refused("clip.planes=[{point=[0,0,0]}]", &["a clip plane is {", "z:50%"]);
    let nine = format!("clip.planes={:?}", ["z:1"; 9]);
    definition_refused(&nine, &["9 clip planes", "may have 8"]);
    let nowhere = "\n[camera]\nposition = [1, 1, 1]\ntarget = [1, 1, 1]\n[materials.flesh]";
    scene_refused("\n[materials.flesh]", nowhere, "5:1", &["camera", "line of sight"]);
    let curves = "material = [[0, \"bone\"]]\nopacity = [[9, 0], [3, 1]]\n[lights.day]";
    scene_refused("[lights.day]", curves, "16:11", &["the value 3 follows 9; the values of a curve must ascend"]);
    for value in ["inf", "-inf", "nan"] {
        let curves = format!("material = [[{value}, \"bone\"]]\nopacity = [[3, 0], [9, 1]]\n[lights.day]");
        scene_refused("[lights.day]", &curves, "15:12", &["material curve", "not finite"]);
    }
}

#[test]
fn more_labels_than_a_byte_counts_can_be_declared() {
    let labels: String = (1..=256).map(|n| format!("[labels.{n}]\nmaterial = \"flesh\"\nopacity = 1\n")).collect();
    let folder = Folder::new().with("scene.toml", [SCENE, &labels].concat());
    folder.done(&render(&[]));
}

#[test]
fn numbers_far_from_one_are_short_in_messages() {
    let ramp = Folder::new().refused(
        2,
        &render(&["-D", "transfer.intervals.0.ramp=-1e-300"]),
        &["= -1e-300", "a finite number from 0"],
    );
    assert!(ramp.err.len() < 200, "{}", ramp.err);
    definition_refused("transfer.intervals.0.range=[1e300,-1e300]", &["range = [1e300, -1e300]"]);
}

#[test]
fn what_is_no_scene_is_refused() {
    let mut folder = Folder::new();
    for (name, bytes, words) in [
        ("words.toml", b"Dear program, show me a frog.\n".to_vec(), &["words.toml:1:6: "][..]),
        ("words.md", b"# Frogs\nOf frogs.\n".to_vec(), &["words.md:2:", "scenes are TOML files"]),
        ("binary.toml", (0..=255).collect(), &["binary.toml: not UTF-8 text from byte 128 on", "--volume"]),
        ("empty.toml", Vec::new(), &["empty.toml:1:1: ", "`version`"]),
        ("novolume.toml", b"version = 1\n".to_vec(), &["novolume.toml names no volume", "--volume FILE"]),
        ("large.toml", vec![b'#'; 20_000_000], &["at most 393216 bytes, this one has 20000000", "--volume"]),
    ] {
        folder = folder.with(name, bytes);
        folder.refused(1, &["render", name, "-o", "p.png"], words);
    }
    folder.refused(
        1,
        &["render", "missing.toml", "-o", "p.png"],
        &[
            "missing.toml; /",
            "has binary.toml, empty.toml, large.toml, novolume.toml, scene.toml, …",
            "because: No such file",
        ],
    );
    folder.refused(1, &["render", "gone/scan.mhd"], &["there is no folder /", "gone"]);
    let palette = "version = 1\n[lights.day]\nspectrum = \"D65\"\n[materials.a]\n[cells]\na = { day = \"#804020\" }\n";
    let folder = folder.with("palette.toml", palette);
    folder.refused(
        1,
        &["render", "palette.toml", "-o", "p.png"],
        &["this is a palette: relume design", "[palette] use"],
    );
    folder.refused(2, &["design", "palette.toml", "--save-scene", "s.toml"], &["palette.toml is a palette; use -o"]);
    folder.refused(
        1,
        &["render", ".", "-o", "p.png"],
        &["this is a folder with", "none of which", "Relume reads folders of DICOM"],
    );
    folder.refused(1, &["info", "missing.mhd"], &["missing.mhd", "because: No such file"]);
}

// Volumes.

const HEADER: &str = "NDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = v.raw\n";

/// Asserts that `info` and `render` refuse a volume of `header` and `voxels`.
fn volume_refused(header: &str, voxels: &[u8], words: &[&str]) {
    let folder = Folder::new().with("v.mhd", header).with("v.raw", voxels);
    folder.refused(1, &["info", "v.mhd"], words);
    folder.refused(1, &render(&["--volume", "v.mhd"]), words);
}

fn deflated(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn truncated_and_lying_headers_are_refused() {
    volume_refused(HEADER, &[0; 63], &["63 bytes of voxels", "64"]);
    volume_refused(&HEADER[..40], &[0; 64], &["v.mhd"]);
    volume_refused(&HEADER.replace("4 4 4", "4 4"), &[0; 64], &["line 2", "DimSize"]);
    volume_refused(&HEADER.replace("4 4 4", "4 0 4"), &[0; 64], &["4"]);
    volume_refused(&HEADER.replace("4 4 4", "4000000 4000000 4000000"), &[0; 64], &["4000000"]);
    volume_refused(&HEADER.replace("4 4 4", "99999 99999 99"), &[0; 64], &["64 bytes"]);
    volume_refused(&HEADER.replace("MET_UCHAR", "MET_CHARM"), &[0; 64], &["MET_CHARM"]);
    volume_refused(&HEADER.replace("v.raw", "gone.raw"), &[0; 64], &["gone.raw"]);
    volume_refused("", &[], &["v.mhd"]);
    volume_refused("\u{0}\u{1}binary", &[], &["v.mhd"]);
}

#[test]
fn damaged_and_incredible_compression_is_refused() {
    let header =
        |dims: &str| HEADER.replace("4 4 4", dims).replace("ElementType", "CompressedData = True\nElementType");
    let packed = deflated(&[7; 64]);
    volume_refused(&header("4 4 4"), &packed[..packed.len() / 2], &["v.raw", "64"]);
    volume_refused(&header("4 4 4"), &[0x55; 40], &["zlib"]);
    volume_refused(&header("4 4 5"), &packed, &["64", "80"]);
    // The reverse of a decompression bomb: a short file that claims a large volume.
    volume_refused(&header("9999 9999 9999"), &packed, &["compressed bytes cannot hold"]);
}

#[test]
fn flags_of_headerless_volumes_that_do_not_fit_are_refused() {
    let folder = Folder::new().with("v.raw", [0; 64]);
    folder.refused(1, &["info", "v.raw"], &["raw voxels have no header", "v.raw.toml"]);
    let folder = folder.with("foot_2x4x8_uint8.raw", [0; 64]);
    folder.refused(1, &["info", "foot_2x4x8_uint8.raw"], &["--dims 2x4x8 --type uint8"]);
    let folder = folder.with("foot_2x4x8_uint8.raw", [0; 67]);
    folder.refused(1, &["info", "foot_2x4x8_uint8.raw"], &["--dims 2x4x8 --type uint8 --header-bytes 3"]);
    folder.refused(1, &["info", "v.raw", "--dims", "4x4x5", "--type", "uint8"], &["64", "80"]);
    folder.refused(2, &["info", "v.raw", "--dims", "4x4x4"], &["--type"]);
    folder.refused(2, &["info", "v.raw", "--dims", "4x4", "--type", "uint8"], &["three whole numbers"]);
    folder.refused(2, &["info", "v.raw", "--dims", "4x4x0", "--type", "uint8"], &["at least 1"]);
    folder.refused(2, &["info", "v.raw", "--dims", "4x4x4", "--type", "uint9"], &["unknown voxel type", "float64"]);
    folder.refused(2, &["info", "v.raw", "--dims", "4x4x4", "--type", "uint8", "--spacing", "1x0x1"], &["positive"]);
    folder.refused(
        2,
        &["info", "v.raw", "--dims", "4x4x4", "--type", "uint8", "--voxel", "4,0,0"],
        &["[4, 0, 0]", "[4, 4, 4]"],
    );
    folder.refused(
        1,
        &render(&["--volume", "v.raw", "--dims", "4x4x4", "--type", "uint8", "--downsample", "5x1x1"]),
        &["5×1×1", "4×4×4"],
    );
}

#[test]
fn flags_that_info_has_no_use_for_are_refused() {
    let folder = Folder::new().with("v.raw", [0; 64]).with("v.mhd", HEADER);
    folder.refused(2, &["info", "v.mhd", "-D", "display.exposure=2"], &["-D", "v.mhd is a volume"]);
    folder.refused(2, &["info", "v.mhd", "--labels", "v.mhd"], &["--labels", "v.mhd is a volume"]);
    folder.refused(2, &["info", "v.mhd", "--light", "D65"], &["--light"]);
    folder.refused(
        2,
        &["info", "scene.toml", "--voxel", "32,0,0"],
        &["--voxel [32, 0, 0] is outside the volume's [32"],
    );
    folder.refused(2, &["info", "--labels", "v.mhd"], &["--labels", "a scene or a volume"]);
    folder.refused(2, &["info", "--downsample", "2x2x2"], &["--downsample", "a scene or a volume"]);
    folder.refused(2, &["info", "--voxel", "0,0,0"], &["--voxel", "a scene or a volume"]);
    folder.refused(2, &["info", "--dims", "4x4x4", "--type", "uint8"], &["--dims", "a scene or a volume"]);
}

#[test]
fn volumes_of_nothing_finite_are_refused() {
    let voxels: Vec<u8> = [f32::NAN, f32::INFINITY].iter().flat_map(|value| value.to_le_bytes()).collect();
    let header = HEADER.replace("4 4 4", "2 1 1").replace("MET_UCHAR", "MET_FLOAT");
    volume_refused(&header, &voxels, &["no finite voxel (1 NaN, 1 infinite)"]);
}

#[test]
fn labels_on_another_grid_or_of_other_values_are_refused() {
    let header = |name: &str| HEADER.replace("v.raw", name);
    let folder = Folder::new().with("v.raw", [0; 64]).with("v.mhd", header("v.raw"));
    folder.refused(1, &render(&["--labels", "v.mhd"]), &["[4, 4, 4]", "[32, 30, 18]", "same grid"]);
    folder.refused(1, &render(&["--labels", "gone.mhd"]), &["gone.mhd"]);
    let fractions: Vec<u8> = [0.5_f32; 64].iter().flat_map(|value| value.to_le_bytes()).collect();
    let folder = folder.with("l.raw", fractions).with("l.mhd", header("l.raw").replace("UCHAR", "FLOAT"));
    let arguments = ["--volume", "v.mhd", "--labels", "l.mhd", "-D", "labels.1={material=\"bone\",opacity=1}"];
    folder.refused(1, &render(&arguments), &["l.mhd", "holds 0.5", "whole numbers up to 9223372036854775807"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_sidecar_that_averages_labels_is_refused() {
    let layout = "dims = [64, 30, 18]\ntype = \"uint8\"\ndownsample = [2, 1, 1]\n";
    let folder = Folder::new().with("l.raw", vec![0; 64 * 30 * 18]).with("l.raw.toml", layout);
    folder.refused(1, &render(&["--labels", "l.raw"]), &["l.raw", "downsample", "[volume]"]);
}

#[test]
fn volumes_that_no_memory_holds_are_refused_with_their_bytes() {
    let folder = Folder::new();
    for phantom in ["frog", "engine", "slab", "shells"] {
        let phantom = format!("volume.phantom={phantom}");
        let arguments = ["-D", &phantom, "-D", "volume.dims=[40000,40000,40000]"];
        let bytes = if phantom.contains("shells") { "256000000000000 bytes" } else { "64000000000000 bytes" };
        folder.refused(1, &render(&arguments), &["volume of scene.toml", bytes]);
        folder.refused(1, &[&["info", "scene.toml"], &arguments[..]].concat(), &[bytes]);
    }
}

#[test]
fn files_that_are_given_as_what_they_are_not_are_recognised() {
    let folder = Folder::new().with("v.mhd", HEADER).with("v.raw", [0; 64]).with("header", HEADER);
    let folder = folder.with("n.nrrd", "NRRD0004\n").with("x.vti", "<?xml version=\"1.0\"?>\n<VTKFile type=");
    // A volume is rendered; one that cannot be read is no scene either.
    for name in ["v.mhd", "header"] {
        folder.done(&["render", name, "-o", "p.png", "--size", "4x4"]);
    }
    for (name, words) in [("v.raw", "v.raw: raw voxels have no header"), ("n.nrrd", "n.nrrd"), ("x.vti", "x.vti")] {
        folder.refused(1, &["render", name, "-o", "q.png"], &[words]);
    }
    for name in ["v.mhd", "header", "n.nrrd", "x.vti"] {
        let layout = ["--dims", "4x4x4", "--type", "uint8"];
        let why = ["the file has a header", "--dims"];
        folder.refused(1, &[&["info", name], &layout[..]].concat(), &why);
        folder.refused(1, &render(&[&["--volume", name], &layout[..]].concat()), &why);
    }
}

#[test]
fn a_sidecar_is_refused_where_it_is_wrong_in_one_sentence() {
    let layout = "dims = [4, 4, 4]\ntype = \"uint8\"\n";
    let folder = Folder::new().with("v.raw", [0; 64]).with("v.raw.toml", format!("{layout}\nnonsense = 1\n"));
    folder.refused(
        1,
        &["info", "v.raw"],
        &["v.raw.toml, line 4, column 1", "unknown field `nonsense`", "`header_bytes`"],
    );
    folder.refused(1, &["info", "v.raw.toml"], &["v.raw.toml, line 4, column 1"]);
    let folder = folder.with("v.raw.toml", layout.replace("[4, 4, 4]", "[4, -4, 4]"));
    folder.refused(1, &["info", "v.raw"], &["v.raw.toml, line 1, column 12", "a whole number from 1"]);
    let folder = folder.with("v.raw.toml", "dims = [");
    folder.refused(1, &["info", "v.raw"], &["v.raw.toml, line 1"]);
}

#[test]
fn a_scene_without_a_version_is_still_a_scene() {
    let folder = Folder::new().with("old.toml", SCENE.replace("version = 1\n", ""));
    folder.refused(1, &["info", "old.toml"], &["old.toml:1:1", "missing field `version`"]);
}

#[test]
fn a_step_that_no_ray_can_take_is_refused_in_few_digits() {
    let step = ["-D", "accuracy.step=1e-300"];
    let folder = Folder::new();
    folder.refused(1, &render(&step), &["a step of 1e-300"]);
    folder.refused(1, &render(&[&step[..], &["--reference"]].concat()), &["length 1e-300"]);
}

// Lights.

#[test]
fn lights_that_are_not_there_are_refused() {
    let folder = Folder::new();
    folder.refused(2, &render(&["--light", "D66"]), &["--light D66", "did you mean \"D65\"?", "lamp, day"]);
    folder.refused(2, &render(&["--light", "D65@moon"]), &["no position \"moon\"", "lamp, day"]);
    folder.refused(2, &render(&["--light", "day=-1"]), &["-1"]);
    folder.refused(2, &render(&["--light", "D65@day=1e308"]), &["1e308", "from 0 to 1000000000"]);
    folder.refused(2, &render(&["--light", "day=much"]), &["\"much\" is not a number"]);
    folder.refused(2, &render(&["--light", "=2"]), &["needs a name"]);
    folder.refused(2, &render(&["--light", "foliage"]), &["reflectance"]);
    folder.refused(2, &render(&["--light", "blackbody 3"]), &["100 K"]);
    folder.refused(2, &render(&["--light", "blackbody -3000"]), &["-3000", "100 K"]);
    folder.done(&render(&["--accumulators", "acc.exr"]));
    folder.refused(2, &["relight", "acc.exr", "-o", "q.png", "--light", "D66"], &["did you mean \"D65\"?"]);
    folder.refused(2, &["relight", "acc.exr", "-o", "q.png", "--light", "A@moon"], &["no position \"moon\""]);
}

// Sizes and devices.

#[test]
fn flags_that_no_workload_has_a_use_for_are_refused() {
    let folder = Folder::new();
    let volume = "--volume has no effect";
    folder.refused(2, &["bench", "default", "--volume", "frog.mhd"], &[volume]);
    folder.refused(2, &["bench", "default", "scenes", "--volume", "frog.mhd"], &[volume]);
    folder.refused(2, &["bench", "default", "--time", "1"], &["--time has no effect"]);
}

#[test]
fn sizes_that_no_picture_has_are_refused() {
    let folder = Folder::new();
    for size in ["0x0", "100000x100000", "0x8", "65537x1"] {
        folder.refused(2, &["render", "scene.toml", "-o", "p.png", "--size", size], &[size, "1 to 65536"]);
    }
    let arguments = ["render", "scene.toml", "-o", "p.png", "--reference", "--size", "60000x60000"];
    folder.refused(2, &arguments, &["3600000000 pixels", "at most 2147483648"]);
    for size in ["8", "8x8x8", "axb", ""] {
        folder.refused(2, &["render", "scene.toml", "-o", "p.png", "--size", size], &["--size"]);
    }
}

#[test]
fn a_picture_over_the_devices_limit_is_refused_with_both_numbers() {
    let folder = Folder::new();
    folder.refused(
        1,
        &["render", "scene.toml", "-o", "p.png", "--size", "65536x1"],
        &["65536×1", "too large", "--size"],
    );
}

#[test]
fn a_volume_over_the_devices_extent_is_marched_in_bricks() {
    // No known device has 3D images of more than 16384 texels per side.
    let folder = Folder::new().with("long.raw", vec![200; 20_000]);
    let arguments = ["--volume", "long.raw", "--dims", "20000x1x1", "--type", "uint8", "--json"];
    let bricks = folder.done(&render(&arguments)).json()["march"]["bricks"].clone();
    assert_eq!(bricks["visible"], 313, "{bricks}");
}

#[test]
#[expect(clippy::print_stderr, reason = "a test that did not run says so")]
fn a_volume_over_the_devices_memory_is_marched_in_bricks() {
    let device = Device::open(&DeviceChoice::Auto, Validation::Off).unwrap();
    let limits = device.limits();
    // Value and gradient take 8 bytes per voxel; the file is sparse.
    let side = 1024_u64;
    let slices = limits.device_heap_bytes.min(limits.max_allocation_bytes) / (8 * side * side) + 1;
    if slices > 512 {
        eprintln!("NOT RUN: a volume that this device cannot hold takes more than 512 MB of host memory");
        return;
    }
    let folder = Folder::new().with("large.raw", []);
    let file = std::fs::OpenOptions::new().write(true).open(folder.path("large.raw")).unwrap();
    file.set_len(side * side * slices).unwrap();
    let dims = format!("{side}x{side}x{slices}");
    let arguments = ["--volume", "large.raw", "--dims", &dims, "--type", "uint8", "--json"];
    let bricks = folder.done(&render(&arguments)).json()["march"]["bricks"].clone();
    assert_eq!(bricks["visible"], 0, "the file holds zeros: {bricks}");
}

#[test]
fn a_texture_that_takes_more_memory_than_its_texels_is_marched_in_fewer_bricks() {
    let device = Device::open(&DeviceChoice::Auto, Validation::Off).unwrap();
    let values: Vec<u8> =
        (0..128_u8).flat_map(|z| (0..128 * 128_u16).map(move |i| z + (i % 128).to_le_bytes()[0])).collect();
    let folder = Folder::new().with("cube.raw", values);
    let arguments = ["--volume", "cube.raw", "--dims", "128x128x128", "--type", "uint8", "--json"];
    let exact = ["-D", "accuracy.interpolation=exact_linear"];
    let arguments = render(&[&arguments[..], &exact].concat());
    assert!(folder.done(&arguments).json()["march"]["bricks"].is_null(), "its texels fit");
    let whole = std::fs::read(folder.path("p.png")).unwrap();
    // A volume of value and gradient, 8 bytes per voxel, is half as large again as the device allocates at once.
    let percent = device.limits().max_allocation_bytes / (128_u64.pow(3) * 8) * 150;
    let mut command = folder.command(&arguments);
    let outcome = Outcome::of(command.env("RELUME_SIMULATE", format!("image-padding={percent}")));
    assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    let bricks = outcome.json()["march"]["bricks"].clone();
    assert!(bricks["held"].as_u64() < bricks["visible"].as_u64(), "{bricks}");
    assert!(std::fs::read(folder.path("p.png")).unwrap() == whole, "the picture is the same");
}

#[test]
fn without_a_vulkan_device_the_way_to_get_one_is_said() {
    let folder = Folder::new();
    for arguments in [render(&[]), vec!["info"], vec!["bench", "--frames", "1"]] {
        let mut command = folder.command(&arguments);
        command.env("VK_DRIVER_FILES", "/dev/null").env("VK_ICD_FILENAMES", "/dev/null");
        let words = ["driver", "apt-get install", "mesa-vulkan-drivers", "VK_DRIVER_FILES is set to /dev/null"];
        Outcome::of(&mut command).assert_refused(3, &words);
    }
    assert_eq!(folder.names(), ["scene.toml"]);
    // Volumes, scenes, the reference and relighting need no device.
    for arguments in [vec!["info", "scene.toml"], render(&["--reference"])] {
        let mut command = folder.command(&arguments);
        command.env("VK_DRIVER_FILES", "/dev/null").env("VK_ICD_FILENAMES", "/dev/null");
        let outcome = Outcome::of(&mut command);
        assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    }
}

#[test]
fn a_device_that_is_not_there_is_refused_with_those_there_are() {
    let folder = Folder::new();
    let listed = folder.done(&["info", "--json"]).json();
    let name = listed["devices"][0]["name"].as_str().unwrap();
    folder.refused(3, &render(&["--device", "Voodoo"]), &["\"Voodoo\"", name]);
    folder.refused(3, &render(&["--device", "99"]), &["99", name]);
    folder.refused(2, &render(&["--device", "0", "--reference"]), &["--reference"]);
}

// Outputs.

#[test]
fn outputs_that_cannot_be_are_refused_before_the_work() {
    let folder = Folder::new().with("v.exr", [0; 64]);
    let refused = |code, outputs: &[&str], words: &[&str]| {
        // Large enough that marching it would be noticed.
        let arguments = [&["render", "scene.toml", "--size", "4000x4000"], outputs].concat();
        folder.refused(code, &arguments, words);
    };
    refused(1, &["-o", "gone/p.png"], &["gone/p.png", "no folder gone"]);
    refused(1, &["-o", "p.png", "--accumulators", "gone/a.exr"], &["no folder gone"]);
    refused(2, &["-o", "p.gif"], &["p.gif", ".png", ".exr"]);
    refused(2, &["-o", "p"], &[".png"]);
    refused(2, &["-o", "p.png", "-o", "./p.png"], &["./p.png is named twice"]);
    refused(2, &["--spectral", "a.exr", "--accumulators", "a.exr"], &["a.exr is named twice"]);
    refused(2, &["--spectral", "s.toml"], &["--spectral s.toml", ".exr"]);
    refused(2, &["--accumulators", "a.png"], &["--accumulators a.png", ".exr"]);
    refused(2, &["-o", "p.png", "--reference", "--device", "auto"], &["--reference", "--device"]);
    refused(2, &["--volume", "v.exr", "--accumulators", "./v.exr"], &["v.exr is an input"]);
    refused(2, &[], &["no output", "-o FILE.png"]);
    refused(2, &["-o"], &["-o"]);
    folder.refused(2, &["relight", "scene.toml"], &["--output"]);
    folder.refused(2, &["paint"], &["paint"]);
}

#[test]
fn names_that_no_accumulator_file_can_hold_are_refused_before_the_march() {
    let long = "x".repeat(250);
    for (light, material, words) in [
        ("a", "b.c", &["\"a.b\" with \"c\", and \"a\" with \"b.c\"", "\"a.b.c\""][..]),
        ("", "b", &["a position has an empty name"]),
        (&long, "flesh", &["256 bytes", "OpenEXR allows 255"]),
    ] {
        let scene = SCENE.replace("[lights.day]", &format!("[lights.\"{light}\"]"));
        let scene = scene.replace("[lights.lamp]", "[lights.\"a.b\"]");
        let scene = scene.replace("[materials.flesh]", &format!("[materials.\"{material}\"]"));
        let scene = scene.replace("material = \"flesh\"", &format!("material = \"{material}\""));
        let scene =
            scene.replace("[materials.bone]", "[materials.c]").replace("material = \"bone\"", "material = \"c\"");
        let folder = Folder::new().with("scene.toml", scene);
        // Large enough that marching it would be noticed.
        let arguments = ["render", "scene.toml", "--size", "4000x4000", "-o", "p.png", "--accumulators", "a.exr"];
        folder.refused(1, &arguments, &[words, &["--accumulators a.exr", "rename a light or a material"]].concat());
    }
}

#[test]
fn every_file_that_is_read_is_kept() {
    let spectrum = "400,0.5\n700,0.5\n";
    let folder = Folder::new().with("light.exr", spectrum).with("skin.exr", spectrum).with("wall.exr", spectrum);
    let folder = folder.with("v.exr", [9; 64]).with("l.exr", [0; 64]);
    let folder = folder.with("v.mhd", HEADER.replace("v.raw", "v.exr")).with("l.mhd", HEADER.replace("v.raw", "l.exr"));
    let text = SCENE.replace("phantom = \"frog\"\ndims = [32, 30, 18]", "file = \"v.mhd\"\nlabels = \"l.mhd\"");
    let text = text.replace("\"foliage\"", "\"skin.exr\"").replace("\"A\"", "{ file = \"light.exr\" }");
    let folder = folder.with("files.toml", text.replace("version = 1", "version = 1\nbackground = \"wall.exr\""));
    for output in ["v.exr", "l.exr", "light.exr", "skin.exr", "./wall.exr"] {
        for flag in ["-o", "--spectral", "--accumulators"] {
            let before = std::fs::read(folder.path(output)).unwrap();
            folder.refused(2, &["render", "files.toml", flag, output], &[output, "is an input"]);
            assert_eq!(std::fs::read(folder.path(output)).unwrap(), before);
        }
    }
    folder.refused(2, &["render", "scene.toml", "--light", "light.exr=2", "-o", "light.exr"], &["is an input"]);
    folder.done(&render(&["--accumulators", "acc.exr"]));
    folder.refused(2, &["relight", "acc.exr", "--light", "light.exr", "-o", "light.exr"], &["is an input"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_that_may_not_be_written_is_refused() {
    let folder = Folder::new().with("folder.png", []);
    std::fs::remove_file(folder.path("folder.png")).unwrap();
    std::fs::create_dir(folder.path("folder.png")).unwrap();
    folder.refused(1, &["render", "scene.toml", "-o", "folder.png"], &["folder.png", "it is a folder"]);
    // No user, not even root, can create files there.
    folder.refused(
        1,
        &["render", "scene.toml", "-o", "/proc/p.png"],
        &["cannot write /proc/p.png", "/proc; write elsewhere", "because: "],
    );
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_to_be_full() {
    let folder = Folder::new();
    std::os::unix::fs::symlink("/dev/full", folder.path("full.png")).unwrap();
    std::os::unix::fs::symlink("/dev/full", folder.path("full.exr")).unwrap();
    for outputs in [["-o", "full.png"], ["-o", "full.exr"], ["--accumulators", "full.exr"], ["--spectral", "full.exr"]]
    {
        let arguments = [&["render", "scene.toml", "--size", "32x32"], &outputs[..]].concat();
        folder.refused(1, &arguments, &[outputs[1], "the disk is full"]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_result_that_cannot_be_printed_is_an_error() {
    let folder = Folder::new();
    let program = env!("CARGO_BIN_EXE_relume");
    for arguments in ["info scene.toml", "info scene.toml --json"] {
        let mut command = std::process::Command::new("bash");
        command.args(["-c", &format!("'{program}' {arguments} > /dev/full")]).current_dir(folder.path("."));
        Outcome::of(&mut command).assert_refused(1, &["cannot write the result to standard output"]);
    }
}

/// The system kills a program that exceeds `ulimit -f` unless it handles the signal.
#[cfg(target_os = "linux")]
#[test]
fn a_file_over_the_limit_of_the_shell_is_an_error_and_leaves_nothing() {
    let folder = Folder::new().with("p.png", "what was there before");
    let program = env!("CARGO_BIN_EXE_relume");
    let line = format!("ulimit -f 8; exec '{program}' render scene.toml -o p.png --bits 16 --size 128x128");
    let mut command = std::process::Command::new("bash");
    command.args(["-c", &line]).current_dir(folder.path("."));
    let before = folder.names();
    Outcome::of(&mut command).assert_refused(1, &["p.png", "8192 bytes"]);
    assert_eq!(folder.names(), before);
    assert_eq!(std::fs::read(folder.path("p.png")).unwrap(), b"what was there before");
}

#[cfg(unix)]
#[test]
fn ctrl_c_ends_long_work_at_once_and_leaves_nothing() {
    let folder = Folder::new();
    let arguments = ["render", "scene.toml", "-o", "p.png", "--reference", "--size", "2000x2000", "--json"];
    let mut command = folder.command(&arguments);
    let child = command.stderr(std::process::Stdio::piped()).stdout(std::process::Stdio::piped()).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(700));
    let begun = std::time::Instant::now();
    let sent = std::process::Command::new("bash").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(sent.success(), "it had ended before");
    let output = child.wait_with_output().unwrap();
    let took = begun.elapsed();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(took.as_secs_f64() <= 2.0, "it took {took:?} to stop");
    assert_eq!(folder.names(), ["scene.toml"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        [&json["interrupted"], &json["exit_code"]],
        [&serde_json::json!(true), &serde_json::json!(130)],
        "{json}"
    );
}

// Files of another kind.

#[test]
fn files_of_another_kind_are_told_from_those_that_a_command_reads() {
    let folder = Folder::new();
    folder.done(&render(&["--accumulators", "acc.exr"]));
    let film = std::fs::read(folder.path("acc.exr")).unwrap();
    let folder = folder
        .with("short.exr", &film[..film.len() / 2])
        .with("empty.nrrd", b"")
        .with("empty.dcm", b"")
        .with("text.dcm", b"my notes on a scan")
        .with("notes.txt", b"my notes")
        .with("v.npy", b"\x93NUMPY");
    for name in ["empty.nrrd", "empty.dcm"] {
        for command in ["info", "render"] {
            folder.refused(1, &[command, name], &[name, "empty", "0 bytes"]);
        }
    }
    folder.refused(1, &["info", "text.dcm"], &["text.dcm", "no DICOM file"]);
    folder.refused(2, &["design", "v.npy"], &["v.npy is a volume", "palette"]);
    folder.refused(1, &["relight", "p.png", "-o", "q.png"], &["p.png", "a picture cannot be relit", "--accumulators"]);
    folder.refused(1, &["relight", "short.exr", "-o", "q.png"], &["short.exr", "cut off"]);
    folder.refused(1, &["render", "notes.txt"], &["notes.txt", "neither a volume nor a scene"]);
    for (slip, meant) in
        [("v.ny", "v.npy"), ("V.npy", "v.npy"), ("emtpy.nrrd", "empty.nrrd"), ("scene.tml", "scene.toml")]
    {
        for output in [&["-o", "q.png"][..], &[]] {
            folder.refused(1, &[&["render", slip], output].concat(), &[slip, &format!("did you mean {meant}?")]);
        }
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("moved.nrrd", folder.path("link.nrrd")).unwrap();
        folder.refused(1, &["info", "link.nrrd"], &["link.nrrd", "a link to moved.nrrd"]);
    }
    let other = folder.refused(1, &["render", "w.nii", "-o", "q.png"], &["w.nii"]);
    assert!(!other.err.contains("did you mean"), "{}", other.err);
}

// Accumulator files.

#[test]
fn what_is_no_accumulator_file_is_refused() {
    let folder = Folder::new();
    folder.done(&render(&["-o", "p.exr", "--accumulators", "acc.exr"]));
    let whole = std::fs::read(folder.path("acc.exr")).unwrap();
    let folder = folder.with("short.exr", &whole[..whole.len() / 2]);
    for (name, words) in [
        ("scene.toml", "scene.toml"),
        ("short.exr", "short.exr"),
        ("p.exr", "p.exr is not a film file"),
        ("gone.exr", "No such file"),
    ] {
        folder.refused(1, &["relight", name, "-o", "q.png"], &[words]);
    }
    folder.refused(2, &["relight", "acc.exr", "-o", "acc.exr"], &["acc.exr is an input"]);
    folder.refused(1, &["relight", "acc.exr", "-o", "gone/q.png"], &["no folder gone"]);
}

// Unusual but valid input.

/// One white material with opacity ½ between 50 and 150 under a white light, seen along z without shading.
const ODD: &str = r#"version = 1
shading = "none"
[materials.paper]
reflectance = 1
[transfer]
intervals = [{ material = "paper", range = [50, 150], opacity = 0.5 }]
[lights.flat]
spectrum = "E"
kind = "ambient"
[camera]
projection = "orthographic"
azimuth = 0
elevation = 0
[accuracy]
termination = 0
"#;

/// R, G, B and A of the only pixel of a picture of `voxels` with type `element`, and the messages; from the device and
/// the
/// reference, which must agree.
fn odd_pixel(scene: &str, dims: &str, element: &str, voxels: &[u8], more: &[&str]) -> ([f64; 4], String) {
    let header = HEADER.replace("4 4 4", dims).replace("MET_UCHAR", element);
    let folder = Folder::new().with("odd.toml", scene).with("v.mhd", header).with("v.raw", voxels);
    let pixel = |rung: &[&str]| {
        let arguments = ["render", "odd.toml", "--volume", "v.mhd", "--size", "1x1", "-o", "p.exr"];
        let outcome = folder.done(&[&arguments[..], more, rung].concat());
        let reader = exr::prelude::read().no_deep_data().largest_resolution_level().all_channels();
        let image = reader.first_valid_layer().all_attributes().from_file(folder.path("p.exr")).unwrap();
        let channels = &image.layer_data.channel_data.list;
        let value = |name: &str| {
            let channel = channels.iter().find(|channel| channel.name.to_string() == name).unwrap();
            channel.sample_data.values_as_f32().next().map(f64::from).unwrap()
        };
        (["R", "G", "B", "A"].map(value), outcome.err)
    };
    let ((device, said), (reference, _)) = (pixel(&[]), pixel(&["--reference"]));
    for (device, reference) in device.iter().zip(reference) {
        assert!((device - reference).abs() <= 1e-4, "the device has {device}, the reference {reference}");
    }
    (device, said)
}

/// Asserts an opacity within the f32 rounding of `steps` products and sums.
fn assert_opacity(pixel: [f64; 4], expected: f64, steps: i32) {
    let rounding = f64::from(3 * steps + 2) * f64::exp2(-24.0);
    assert!((pixel[3] - expected).abs() <= rounding, "opacity {}, not {expected}", pixel[3]);
    // Under illuminant E, white has R : G : B = 1.2048 : 0.9484 : 0.9087 (row sums of the sRGB matrix).
    for (channel, row) in pixel.iter().zip([1.2048, 0.9484, 0.9087]) {
        assert!((channel - row * expected).abs() <= 1e-3, "{pixel:?}");
    }
}

#[test]
fn one_voxel_is_one_voxel_thick() {
    let (pixel, said) = odd_pixel(ODD, "1 1 1", "MET_UCHAR", &[100], &[]);
    assert_opacity(pixel, 0.5, 1);
    assert_eq!(said, "");
}

#[test]
fn a_needle_seen_along_its_length_hides_by_every_step() {
    let scene = ODD.replace("opacity = 0.5", "opacity = 0.001");
    let (pixel, _) = odd_pixel(&scene, "1 1 2048", "MET_UCHAR", &[100; 2048], &[]);
    assert_opacity(pixel, 1.0 - 0.999_f64.powi(2047), 2047);
}

#[test]
fn constant_volumes_show_what_their_one_value_is() {
    let three = 1.0 - 0.5_f64.powi(3);
    let (inside, _) = odd_pixel(ODD, "4 4 4", "MET_UCHAR", &[100; 64], &[]);
    assert_opacity(inside, three, 3);
    let (outside, _) = odd_pixel(ODD, "4 4 4", "MET_UCHAR", &[200; 64], &[]);
    assert_opacity(outside, 0.0, 3);
}

#[test]
fn voxels_that_are_not_a_number_take_the_smallest_value_and_are_counted() {
    let voxels: Vec<u8> = [f32::NAN, 100.0, f32::NAN, f32::NAN].iter().flat_map(|value| value.to_le_bytes()).collect();
    let (pixel, said) = odd_pixel(ODD, "1 1 4", "MET_FLOAT", &voxels, &[]);
    assert_opacity(pixel, 1.0 - 0.5_f64.powi(3), 3);
    assert!(said.starts_with("warning: 3 voxels are NaN") && said.contains("100"), "{said}");
}

#[test]
fn zero_lights_are_darkness_and_hide_as_ever() {
    let scene = ODD.replace("[lights.flat]\nspectrum = \"E\"\nkind = \"ambient\"\n", "");
    let (pixel, _) = odd_pixel(&scene, "1 1 1", "MET_UCHAR", &[100], &[]);
    assert!(pixel[..3].iter().all(|&channel| channel == 0.0) && (pixel[3] - 0.5).abs() <= 1e-6, "{pixel:?}");
}

#[test]
fn zero_materials_show_the_background() {
    let scene = ODD.replace("[materials.paper]\nreflectance = 1\n", "");
    let scene =
        scene.replace("[transfer]\nintervals = [{ material = \"paper\", range = [50, 150], opacity = 0.5 }]\n", "");
    let (pixel, _) = odd_pixel(&scene, "1 1 1", "MET_UCHAR", &[100], &[]);
    assert_opacity(pixel, 0.0, 1);
    let (pixel, _) = odd_pixel(&scene, "1 1 1", "MET_UCHAR", &[100], &["-D", "background=1"]);
    assert!(pixel[3] == 0.0 && (pixel[1] - 0.9484).abs() <= 1e-3, "{pixel:?}");
}

#[test]
fn values_that_no_texture_holds_are_shown_and_the_loss_is_said() {
    let doubles: Vec<u8> = [-1e300, 1e300, 1e300, 1e300].iter().flat_map(|value: &f64| value.to_le_bytes()).collect();
    let scene = ODD.replace("range = [50, 150]", "range = [-2e300, 2e300]");
    let (pixel, said) = odd_pixel(&scene, "1 1 4", "MET_DOUBLE", &doubles, &[]);
    assert_opacity(pixel, 1.0 - 0.5_f64.powi(3), 3);
    assert!(said.is_empty() || said.starts_with("warning: the device stores the values as"), "{said}");

    let integers: Vec<u8> = [i32::MIN, i32::MAX, 7, 7].iter().flat_map(|value| value.to_le_bytes()).collect();
    let scene = ODD.replace("range = [50, 150]", "range = [-3e9, 3e9]");
    let (pixel, said) = odd_pixel(&scene, "1 1 4", "MET_INT", &integers, &[]);
    assert_opacity(pixel, 1.0 - 0.5_f64.powi(3), 3);
    assert!(said.starts_with("warning: the device stores the values as"), "7 in a range of 2³² is moved: {said}");
}

#[test]
fn an_error_is_an_object_of_json_with_its_code_its_causes_and_the_exit_code() {
    let folder = Folder::new();
    let outcome = folder.refused(1, &["info", "nowhere.mhd", "--json"], &["nowhere.mhd"]);
    let json = outcome.json();
    assert_eq!((&json["error"]["code"], &json["exit_code"]), (&"volume-not-openable".into(), &1.into()), "{json}");
    let sentences = [&[json["error"]["message"].clone()], json["error"]["causes"].as_array().unwrap().as_slice()];
    let told: Vec<&str> = outcome.err.lines().filter_map(|line| Some(line.split_once(": ")?.1)).collect();
    assert_eq!(sentences.concat(), told, "standard error has the same sentences");

    let json = folder.refused(2, &["relight", "a.exr", "--json", "-D", "x=1"], &[]).out;
    assert_eq!(json, "", "clap ends the program before anything is known of --json");
    let outcome = folder.with("scene.toml", SCENE).refused(2, &render(&["--json", "-D", "display.exposure=-1"]), &[]);
    assert_eq!(outcome.json()["error"]["code"], "definition-invalid", "{}", outcome.out);
}

#[test]
fn an_error_names_the_same_flags_whichever_work_met_it() {
    let folder = Folder::new();
    let small = ["--device-memory", "16KiB", "-o", "a.png"];
    let way = "take a larger --device-memory, or --downsample";
    folder.refused(1, &[&["render"], &small[..]].concat(), &[way]);
    // The search for a setting passes the error on.
    folder.refused(1, &[&["render", "--max-error", "1"], &small[..]].concat(), &[way]);
}

#[test]
fn fields_that_do_not_belong_together_are_refused() {
    let field = "{phantom=\"frog\",transfer={intervals=[{material=\"bone\",range=[1,9],opacity=0.1}]}}";
    let four: Vec<String> = ["a", "b", "c", "d"].iter().map(|name| format!("{name}={field}")).collect();
    definition_refused(&format!("volumes={{{}}}", four.join(",")), &["5 fields", "the limit is 4"]);
    definition_refused("volumes.a={component=1}", &["volumes.a", "another component", "`file`"]);
    definition_refused("volumes.a={phantom=\"frog\"}", &["volumes.a has no effect", "transfer", "by = "]);
    let mask = ["-D", "volumes.a={phantom=\"frog\",only=[999]}"];
    Folder::new().refused(1, &render(&mask), &["no voxel has the value 999"]);
    definition_refused(
        "volumes.a={phantom=\"frog\",transform=[1,0,0,0,0,1,0,0,0,0,0,0]}",
        &["singular", "determinant"],
    );
    definition_refused("volumes.a={component=1,transfer={gradient=[[0,1]]}}", &["gradient"]);
    let graded = field.replace("opacity=0.1", "opacity=0.1,gradient=[[5,0],[9,1]]");
    definition_refused(&format!("volumes.a={graded}"), &["volumes.a.transfer", "only the first field"]);
    definition_refused(&format!("volumes.volume={field}"), &["volumes.volume", "another name"]);
    for (factor, words) in [
        ("by={a=[[0,1]]}", &["by.a", "no other field"][..]),
        ("by={volume=[[0,1]]}", &["by.volume", "no other field"]),
        ("shape={by=\"a\",ratio=[[0,1]]}", &["shape.by", "gradient"]),
        ("shape={by=\"gradient\"}", &["polygon", "ratio", "image"]),
        ("shape={by=\"gradient\",polygon=[[0,1],[2,3]]}", &["3 to 64 corners"]),
        ("shape={by=\"gradient\",polygon=[[0,1],[2,3],[4,nan]]}", &["3 to 64 corners"]),
        ("shape={by=\"gradient\",polygon=[[0,1],[0,3],[0,9]]}", &["line"]),
        ("shape={by=\"gradient\",polygon=[[0,1],[2,3],[4,1]],soft=0.6}", &["shape.soft", "0.5"]),
        ("shape={by=\"gradient\",polygon=[[0,1],[2,3],[4,1]],ratio=[[0,1]]}", &["one form", "ratio"]),
        ("shape={by=\"gradient\",ratio=[[1,0],[1,1]]}", &["ascend"]),
        ("shape={by=\"gradient\",ratio=[[1,0]],soft=0.1}", &["soft"]),
        ("shape={by=\"gradient\",image=\"a.png\",values=[0,1]}", &["second"]),
        ("shape={by=\"gradient\",image=\"a.png\",values=[1,0],second=[0,1]}", &["values", "lower one first"]),
        ("shape={by=\"gradient\",image=\"nowhere.png\",values=[0,1],second=[0,1]}", &["shape.image", "nowhere.png"]),
    ] {
        let interval = format!("transfer.intervals=[{{material=\"bone\",range=[1,9],opacity=0.1,{factor}}}]");
        definition_refused(&interval, words);
    }
    for (planes, words) in [
        ("[{plane=\"z:50%\",volumes=[\"ct\"]}]", &["\"ct\"", "there are: volume"][..]),
        ("[{plane=\"z:50%\",volumes=[]}]", &["no volume"]),
        ("[{plane=\"z:50%\",point=[1,2,3]}]", &["a clip plane is"]),
    ] {
        definition_refused(&format!("clip.planes={planes}"), words);
    }
    definition_refused("clip.keep=\"some\"", &["keep", "any"]);
    definition_refused("overlap=\"second\"", &["overlap", "first"]);
    definition_refused("hidden=[\"volume\"]", &["hidden", "one field"]);
    definition_refused("materials.bone.occludes=1.5", &["occludes", "from 0 to 1"]);
    definition_refused("materials.bone.xray=0", &["xray", "boolean"]);
    definition_refused(&format!("volumes.a={}", field.replace("frog", "toad")), &["toad"]);
    definition_refused(&format!("volumes.a={}", field.replace("bone", "stone")), &["stone"]);

    let nrrd = |sizes: &str, voxels: usize| {
        let head = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: {sizes}\nspacings: 1 1 1\nencoding: raw\n\n");
        [head.as_bytes(), &vec![7; voxels]].concat()
    };
    let scene = |file: &str| {
        format!(
            "version = 1\nshading = \"none\"\n[volume]\nfile = \"a.nrrd\"\n[materials.bone]\nreflectance = \"white 9.5\"\n\
             [transfer]\nintervals = [{{ material = \"bone\", range = [1, 9], opacity = 0.1 }}]\n[lights.day]\nspectrum = \"D65\"\n\
             [volumes.other]\nfile = \"{file}\"\ntransfer = {{ intervals = [{{ material = \"bone\", range = [1, 9], opacity = 0.1 }}] }}\n"
        )
    };
    let folder = Folder::new()
        .with("a.nrrd", nrrd("2 2 2", 8))
        .with("b.nrrd", nrrd("3 2 2", 12))
        .with("other.toml", scene("b.nrrd"))
        .with("none.toml", scene("c.nrrd"))
        .with("lit.toml", scene("a.nrrd").replace("shading = \"none\"\n", ""));
    let other = folder.done(&["render", "other.toml", "-o", "a.png", "--size", "8x8"]);
    assert!(other.err.contains("volumes.other reaches beyond the box of the volume"), "{}", other.err);
    folder.refused(1, &["render", "none.toml", "-o", "a.png"], &["c.nrrd"]);
    // What was refused once: a further field is shaded by normals of its own.
    folder.done(&["render", "lit.toml", "-o", "a.png", "--size", "8x8"]);
}
