//! A volume without a scene: its picture, its scene, and the words about it.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod support;

use support::program::{Folder, SCENE};

const RENDER: [&str; 6] = ["render", "scene.toml", "--size", "8x8", "-o", "p.png"];

#[test]
fn a_misspelt_light_of_the_scene_is_suggested_before_any_standard() {
    let folder = Folder::new().with("scene.toml", SCENE.replace("lights.day", "lights.key"));
    let outcome = folder.refused(2, &[&RENDER[..], &["--light", "kee"]].concat(), &["did you mean \"key\" of the scene?"]);
    assert!(outcome.err.find("\"key\"") < outcome.err.find("standard"), "{}", outcome.err);
}

#[test]
fn a_body_without_gradient_and_without_ambient_light_is_said_to_be_black() {
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: raw\n\n";
    let voxels: Vec<u8> = header.bytes().chain([50; 64]).collect();
    let scene = SCENE.replace("phantom = \"frog\"\ndims = [32, 30, 18]", "file = \"v.nrrd\"");
    let scene = scene.replace("kind = \"ambient\"", "kind = \"headlight\"");
    let dark = scene.replace("specular = 0.2", "ambient = 0");
    let folder = Folder::new().with("v.nrrd", voxels).with("scene.toml", &dark);
    let err = folder.done(&RENDER).err;
    assert!(err.contains("all voxels have the value 50") && err.contains("ambient"), "{err}");
    assert_eq!(folder.with("scene.toml", scene).done(&RENDER).err, "");
}

#[test]
fn a_number_with_a_unit_is_told_what_to_write() {
    let scene = SCENE.replace("dims = [32, 30, 18]", "spacing = \"0.957 mm\"");
    let folder = Folder::new().with("scene.toml", scene);
    folder.refused(1, &RENDER, &["\"0.957 mm\"", "three numbers in brackets without a unit, such as [1, 1, 2]"]);
}

#[test]
fn quiet_commands_that_write_files_print_nothing() {
    let folder = Folder::new();
    let outcome = folder.done(&[&RENDER[..], &["-q", "--accumulators", "film.exr"]].concat());
    assert_eq!((&*outcome.out, &*outcome.err), ("", ""));
    assert_eq!(folder.done(&["relight", "film.exr", "-o", "q.png", "-q"]).out, "");
    assert!(folder.done(&[&RENDER[..], &["-q", "--json"]].concat()).out.starts_with('{'), "JSON is asked for");
    assert!(folder.done(&["info", "scene.toml", "-q"]).out.contains("materials"), "a description is the result");
}

#[test]
fn the_search_for_a_setting_is_not_booked_as_loading() {
    let folder = Folder::new();
    let mut command = folder.command(&["render", "scene.toml", "--size", "16x16", "-o", "p.png", "--max-error", "8"]);
    let outcome = support::program::Outcome::of(command.env("XDG_CACHE_HOME", folder.path("cache")));
    let number = |stage: &str| -> f64 {
        let rest = outcome.out.split(&format!("{stage} ")).nth(1).unwrap_or_else(|| panic!("{}", outcome.out));
        rest.split(' ').next().unwrap().parse().unwrap()
    };
    assert!(number("search") > number("load"), "{}", outcome.out);
    assert!(outcome.out.contains("measurements are kept in"), "{}", outcome.out);
}

#[test]
fn a_sweep_between_two_lights_has_no_third_unless_the_scene_arranges_the_dial() {
    let more = "[lights.night]\nspectrum = \"E\"\nkind = \"headlight\"\nintensity = 0\n";
    let folder = Folder::new().with("scene.toml", format!("{SCENE}{more}"));
    let lights = |folder: &Folder| {
        folder.done(&[&RENDER[..], &["--accumulators", "film.exr"]].concat());
        let json = folder.done(&["relight", "film.exr", "--sweep", "day..lamp", "--frames", "3", "-o", "s.png", "--json"]);
        json.json()["frames"][1]["lights"].as_array().unwrap().len()
    };
    assert_eq!(lights(&folder), 2);
    let placed = format!("{SCENE}{more}[dial.nodes]\nday = [0, 1]\nlamp = [0, -1]\nnight = [0.5, 0]\n");
    assert_eq!(lights(&folder.with("scene.toml", placed)), 3);
}

#[test]
fn a_scene_with_headerless_voxels_is_not_told_of_a_header() {
    let voxels = "file = \"v.raw\"\ntype = \"uint8\"\ndims = [4, 4, 5]";
    let scene = SCENE.replace("phantom = \"frog\"\ndims = [32, 30, 18]", voxels);
    let folder = Folder::new().with("v.raw", [0; 64]).with("scene.toml", scene);
    let err = folder.refused(1, &RENDER, &["the volume of scene.toml", "64 bytes", "dims and type require 80"]).err;
    assert!(!err.contains("header"), "{err}");
}

/// A smooth body of 16-bit voxels, x fastest.
fn body([nx, ny, nz]: [usize; 3]) -> Vec<u8> {
    let value = |at: usize| {
        let part = |index: usize, of: usize| {
            f64::from(u32::try_from(index).unwrap()) / f64::from(u32::try_from(of).unwrap()) - 0.5
        };
        let [x, y, z] = [part(at % nx, nx), part(at / nx % ny, ny), part(at / nx / ny, nz)];
        let height = 1.0 - 3.0 * (x * x + 2.0 * y * y + z * z);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 3000")]
        let value = (3000.0 * height.max(0.0)) as u16;
        value
    };
    (0..nx * ny * nz).flat_map(|at| value(at).to_be_bytes()).collect()
}

#[test]
fn wrong_dimensions_of_the_right_size_are_doubted_and_unknown_ones_are_guessed() {
    let folder = Folder::new().with("body.raw", body([48, 64, 36]));
    let layout = ["--type", "uint16", "--big-endian"];
    let wrong = folder.done(&[&["info", "body.raw", "--dims", "64x48x36"][..], &layout].concat());
    assert!(wrong.err.contains("try --dims 48x64x36"), "{}", wrong.err);
    assert_eq!(folder.done(&[&["info", "body.raw", "--dims", "48x64x36"][..], &layout].concat()).err, "");
    folder.refused(1, &["info", "body.raw"], &["suggest --dims 48x64x36 --type uint16 --big-endian"]);
}
