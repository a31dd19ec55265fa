//! The viewer's window on a virtual display, driven by scripts.

use crate::support;

use std::io::BufReader;
use std::time::{Duration, Instant};

use serde_json::Value;
use support::program::{Folder, Outcome, SCENE};
use support::screen::{Screen, report};

/// Without normalisation, so that a node equals `--light`.
const DIAL: &str = "[dial]\nnormalise = false\n[dial.nodes]\nday = [0, 1]\nlamp = [0, -1]\n";

fn folder() -> Folder {
    Folder::new().with("dial.toml", format!("{SCENE}{DIAL}"))
}

fn bytes(folder: &Folder, name: &str) -> Vec<u8> {
    std::fs::read(folder.path(name)).unwrap()
}

/// Size of a picture in pixels, and its RGB samples.
fn rgb(folder: &Folder, name: &str) -> ([usize; 2], Vec<u8>) {
    let file = BufReader::new(std::fs::File::open(folder.path(name)).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    ([info.width, info.height].map(|side| usize::try_from(side).unwrap()), pixels)
}

/// `WxH` of a session's pictures.
fn size(report: &Value) -> String {
    format!("{}x{}", report["size"][0], report["size"][1])
}

#[test]
fn without_a_display_one_sentence_names_the_command_that_needs_none() {
    let folder = folder();
    let mut command = folder.command(&["view"]);
    command.env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY").env_remove("WAYLAND_SOCKET");
    Outcome::of(&mut command).assert_refused(1, &["display", "relume render"]);
}

#[test]
fn without_a_vulkan_driver_it_says_what_render_does() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let mut command = screen.command(&folder, &["--frames", "1"]);
    command.env("VK_DRIVER_FILES", "/dev/null").env("VK_ICD_FILENAMES", "/dev/null");
    Outcome::of(&mut command).assert_refused(3, &["driver", "apt-get install", "mesa-vulkan-drivers"]);
}

#[test]
fn a_scene_opens_as_render_shows_it_and_its_light_never_marches() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle
picture opened.png
settle
light lamp 0.3
off day
on day
solo lamp
all
normalise on
master 0.7
exposure 2
adapt on
hand 0.3 -0.1
place day 0.5 0.5
leave day
take day
undo
redo
settle
node lamp
exposure 1
adapt off
picture node.png
settle
solo lamp
light lamp 1
normalise off
master 1
picture alone.png
settle
";
    let report = screen.script(&folder, "dial.toml", script);
    let settled: Vec<[u64; 2]> = report["settled"]
        .as_array()
        .unwrap()
        .iter()
        .map(|counts| ["marches", "relights"].map(|count| counts[count].as_u64().unwrap()))
        .collect();
    assert!(settled.windows(2).all(|pair| pair[0][0] == pair[1][0]), "marches and relights: {settled:?}");
    assert!(settled[2][1] > settled[1][1] + 8, "marches and relights: {settled:?}");
    assert_eq!(bytes(&folder, "node.png"), bytes(&folder, "alone.png"), "a node is its light alone");

    let size = size(&report);
    folder.done(&["render", "dial.toml", "-o", "rendered.png", "--size", &size]);
    assert_eq!(bytes(&folder, "opened.png"), bytes(&folder, "rendered.png"), "as it opens");
    folder.done(&["render", "dial.toml", "-o", "lamp.png", "--size", &size, "--light", "lamp"]);
    assert_eq!(bytes(&folder, "node.png"), bytes(&folder, "lamp.png"), "on a node");
    assert_ne!(bytes(&folder, "opened.png"), bytes(&folder, "node.png"), "the light has changed");
}

#[test]
fn the_camera_marches_and_every_step_back_is_the_same_picture() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle
picture first.png
settle
orbit 40 20
pan 0.1 0
dolly 1.5
roll 10
projection
settle
picture moved.png
undo
undo
undo
undo
undo
picture undone.png
axis top
reset
picture reset.png
settle
";
    let report = screen.script(&folder, "scene.toml", script);
    let marches = |at: usize| report["settled"][at]["marches"].as_u64().unwrap();
    assert!(marches(2) >= marches(1) + 2, "{}", report["settled"]);
    assert_ne!(bytes(&folder, "first.png"), bytes(&folder, "moved.png"));
    assert_eq!(bytes(&folder, "first.png"), bytes(&folder, "undone.png"), "undone");
    assert_eq!(bytes(&folder, "first.png"), bytes(&folder, "reset.png"), "reset");
}

#[test]
fn a_hand_at_the_mouse_and_the_keyboard_moves_the_camera() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "panels off
settle
picture first.png
pointer 320 240
press
pointer 380 260
release
settle
picture dragged.png
scroll 3
frames 20
settle
picture scrolled.png
key R
settle
picture reset.png
settle
";
    screen.script(&folder, "scene.toml", script);
    let pictures = ["first", "dragged", "scrolled", "reset"].map(|name| bytes(&folder, &format!("{name}.png")));
    assert_ne!(pictures[0], pictures[1], "dragged");
    assert_ne!(pictures[1], pictures[2], "scrolled");
    assert_eq!(pictures[0], pictures[3], "R brings the scene's camera back");
}

#[test]
fn a_window_of_any_size_shows_its_picture() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let sizes = [[300, 200], [1600, 1000], [1, 1], [640, 480], [301, 199], [1280, 720]];
    let resize = |[width, height]: [u32; 2]| format!("size {width} {height}\nframes 2\n");
    let mut script: String = sizes.iter().cycle().take(18).map(|&size| resize(size)).collect();
    script += "settle\nwindow window.png\n";
    let report = screen.script(&folder, "scene.toml", &script);
    assert_eq!(report["notices"], Value::Array(Vec::new()));
    let decoder = png::Decoder::new(std::io::Cursor::new(bytes(&folder, "window.png")));
    let shown = decoder.read_info().unwrap().info().size();
    assert_eq!(shown, (1280, 720), "the last size asked for");
}

/// A window is redrawn where it has changed; after a change of its size, everywhere.
#[test]
fn a_window_that_was_drawn_in_parts_is_the_one_that_is_drawn_whole() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "size 900 760
settle
hand 0.3 -0.1
frames 2
pointer 120 200
frames 3
light lamp 0.4
frames 1
off day
frames 1
on day
pointer 60 420
press
frames 2
release
pointer 500 300
hand -0.2 0.4
frames 4
palette on
frames 30
hand 0.1 0.1
settle
window parts.png
settle
size 910 750
settle
size 900 760
frames 30
settle
window whole.png
settle
";
    screen.script(&folder, "dial.toml", script);
    let ([width, height], parts) = rgb(&folder, "parts.png");
    let (size, whole) = rgb(&folder, "whole.png");
    assert_eq!(([width, height], size), ([900, 760], [900, 760]));
    // The last line shows frame times. Devices draw triangles in blocks, whose origins affect the rounding of colours.
    let codes = 3 * width * (height - 26);
    let wrong = (0..codes).find(|&code| parts[code].abs_diff(whole[code]) > 1).map(|code| code / 3);
    assert_eq!(wrong.map(|pixel| [pixel % width, pixel / width]), None, "the first pixel that is not the same");
}

#[test]
fn resizing_without_a_pause_in_the_middle_of_marches_leaves_the_device_in_order() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let any = |round: u32| format!("{} {}", 200 + round * 97 % 400, 150 + round * 131 % 300);
    let storm: String = (0..200).map(|round| format!("orbit 3 1\nsize {}\nframes 1\n", any(round))).collect();
    let report = screen.script(&folder, "scene.toml", &format!("{storm}settle\n"));
    assert_eq!(report["notices"], Value::Array(Vec::new()));
}

#[test]
fn what_cannot_be_opened_is_told_in_the_window_which_stays_usable() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder().with("broken.toml", "version = 1\n[lights.day]\nspectrum = \"D99\"\n");
    let script = "settle
picture before.png
open nothing.toml
settle
open broken.toml
settle
picture after.png
open dial.toml
settle
node lamp
picture other.png
";
    let report = screen.script(&folder, "scene.toml", script);
    let notices = report["notices"].to_string();
    assert!(notices.contains("nothing.toml") && notices.contains("D99"), "{notices}");
    assert_eq!(bytes(&folder, "before.png"), bytes(&folder, "after.png"));
    assert_ne!(bytes(&folder, "before.png"), bytes(&folder, "other.png"));
}

#[test]
fn a_volume_without_a_scene_shows_something_at_once() {
    let Some(screen) = Screen::new() else { return };
    // A ball with a core, in air.
    let voxel = |index: usize| {
        let [x, y, z] = [index % 24, index / 24 % 24, index / 576].map(|at| i32::try_from(at).unwrap() - 12);
        match x * x + y * y + z * z {
            0..20 => 220,
            20..90 => 110,
            _ => u8::try_from(index % 7).unwrap(),
        }
    };
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 24 24 24\nencoding: raw\n\n";
    let ball: Vec<u8> = header.bytes().chain((0..24 * 24 * 24).map(voxel)).collect();
    let folder = folder().with("ball.nrrd", ball);
    let script = "settle\npicture ball.png\npicture ball.exr\nsave session ball.toml\nsettle\n";
    let report = screen.script(&folder, "ball.nrrd", script);
    assert_opens_as_it_was_saved(&screen, &folder, "ball.toml", ["ball.png", "ball.exr"], &size(&report));
    let mut decoder = png::Decoder::new(std::io::Cursor::new(bytes(&folder, "ball.png"))).read_info().unwrap();
    let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
    let info = decoder.next_frame(&mut pixels).unwrap();
    let at = |x: u32, y: u32| {
        let first = 3 * (y * info.width + x) as usize;
        pixels[first..first + 3].iter().map(|&part| u32::from(part)).sum::<u32>()
    };
    assert!(at(info.width / 2, info.height / 2) > 150, "the ball is seen in the middle");
    assert_eq!(at(2, 2), 0x2a + 0x2f + 0x38, "and air is not seen: it is the backdrop");
}

#[test]
fn an_automatic_exposure_is_found_again_for_another_light() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle\nexposure auto\nsettle\nsave session one.toml\nmaster 0.2\nsettle\nexposure auto\nsettle\nsave session two.toml\n";
    screen.script(&folder, "scene.toml", script);
    let exposure = |name: &str| -> f64 {
        let text = std::fs::read_to_string(folder.path(name)).unwrap();
        let line = text.lines().find(|line| line.starts_with("exposure = ")).unwrap_or_else(|| panic!("{text}"));
        line["exposure = ".len()..].trim().parse().unwrap()
    };
    let [one, two] = ["one.toml", "two.toml"].map(exposure);
    assert!(two > 3.0 * one, "{two} under a fifth of the light, {one}");
}

/// Switches, sliders and colours are at hand, as the look says; under the dial they would have no effect.
#[test]
fn channels_open_by_the_sliders() {
    let Some(screen) = Screen::new() else { return };
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/tiff/channels.ome.tif");
    let folder = folder();
    screen.script(&folder, file, "settle\nsave session opened.toml\n");
    let session = std::fs::read_to_string(folder.path("opened.toml")).unwrap();
    assert!(session.contains("by = \"sliders\"") && session.contains("off = [\"all\"]"), "{session}");
}

#[test]
fn it_ends_after_its_frames_and_in_the_middle_of_a_march() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let outcome = screen.run(&folder, &["scene.toml", "--frames", "5"]);
    assert_eq!(outcome.code, Some(0), "{}", outcome.err);
    assert!(outcome.json()["frames"].as_u64().unwrap() >= 5);
    screen.script(&folder, "scene.toml", "settle\nsize 1600 1000\norbit 10 0\n");
}

#[test]
fn what_cannot_be_done_with_nobody_there_to_see_it_ends_in_1() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle\nopen nothing.mhd\nsettle\npicture nowhere/picture.png\nsettle\n";
    let failures = screen.script(&folder, "scene.toml", script)["failures"].to_string();
    assert!(failures.contains("nothing.mhd") && failures.contains("nowhere"), "{failures}");
    assert!(!failures.contains("the volume of"), "the file is the volume: {failures}");
    let outcome = screen.run(&folder, &["nothing.mhd", "--frames", "5"]);
    assert!(report(&outcome)["failures"][0].as_str().unwrap().contains("nothing.mhd"), "{}", outcome.err);
}

/// Opens the `session` saved from `opened` and renders its picture: all pictures are equal to the bit.
fn assert_opens_as_it_was_saved(screen: &Screen, folder: &Folder, session: &str, saved: [&str; 2], size: &str) {
    folder.done(&["render", session, "-o", "again.png", "-o", "again.exr", "--size", size]);
    assert_eq!(bytes(folder, saved[0]), bytes(folder, "again.png"), "{session} rendered");
    assert_eq!(bytes(folder, saved[1]), bytes(folder, "again.exr"), "{session} rendered, linear");
    screen.script(folder, session, "settle\npicture reopened.png\nsave session resaved.toml\n");
    assert_eq!(bytes(folder, saved[0]), bytes(folder, "reopened.png"), "{session} opened again");
}

#[test]
fn a_session_opens_as_it_was_saved_and_renders_equal() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    std::fs::create_dir(folder.path("other")).unwrap();
    let script = "settle
picture opened.png
exposure 1.3
orbit 33.3 7
roll 11.1
interval 0 35.1 95 6 0.2
settle
picture edited.png
light lamp 0.37
off day
on day
normalise on
master 0.71
picture sliders.png
picture sliders.exr
save session sliders.toml
hand 0.21 -0.13
place day 0.5 0.5
interval 1 material flesh
interval add bone 100.3 120 4.2 0.05
picture dial.png
picture dial.exr
save session other/dial.toml
undo
interval remove 0
settle
picture removed.png
picture removed.exr
save session removed.toml
settle
";
    let report = screen.script(&folder, "dial.toml", script);
    assert_eq!(report["notices"], Value::Array(Vec::new()));
    assert_ne!(bytes(&folder, "opened.png"), bytes(&folder, "edited.png"), "an interval was edited");
    let size = size(&report);
    for name in ["sliders", "dial", "removed"] {
        let session = if name == "dial" { "other/dial.toml".to_owned() } else { format!("{name}.toml") };
        let pictures = ["png", "exr"].map(|ending| format!("{name}.{ending}"));
        assert_opens_as_it_was_saved(&screen, &folder, &session, pictures.each_ref().map(|it| &**it), &size);
    }
}

#[test]
fn an_edit_of_the_transfer_function_is_undone_to_the_bit() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle
picture first.png
interval 0 30 90 5 0.4
settle
picture thicker.png
interval 0 material bone
settle
interval remove 1
settle
picture bone.png
undo
undo
undo
settle
picture undone.png
interval 0 30 90 5 0
settle
interval 0 30 90 5 0.1
settle
picture back.png
settle
";
    let report = screen.script(&folder, "scene.toml", script);
    let marches = |at: usize| report["settled"][at]["marches"].as_u64().unwrap();
    assert!(marches(1) > marches(0), "{}", report["settled"]);
    assert_ne!(bytes(&folder, "first.png"), bytes(&folder, "thicker.png"));
    assert_ne!(bytes(&folder, "thicker.png"), bytes(&folder, "bone.png"));
    assert_eq!(bytes(&folder, "first.png"), bytes(&folder, "undone.png"), "undone");
    assert_eq!(bytes(&folder, "first.png"), bytes(&folder, "back.png"), "out of sight and back");
}

#[test]
fn a_script_that_cannot_be_carried_out_says_which_line() {
    let folder = folder().with("bad.txt", "settle\ndance\n").with("name.txt", "settle\nnode moon\n");
    folder.refused(1, &["view", "--script", "bad.txt"], &["bad.txt:2", "dance"]);
    let Some(screen) = Screen::new() else { return };
    let outcome = screen.run(&folder, &["scene.toml", "--script", "name.txt"]);
    outcome.assert_refused(1, &["name.txt:2", "moon", "day, lamp"]);
}

#[test]
fn a_probed_pixel_has_the_colour_that_is_shown_and_nothing_of_it_marches() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "probe 0.5 0.5\nprobe 0.4 0.45\npicture shown.png\nsettle\nlight lamp 0.2\nprobe 0.4 0.45\nsettle\n\
                  spectrum material flesh = cyan\nprobe 0.5 0.5\npicture dyed.png\nsettle\n";
    let report = screen.script(&folder, "dial.toml", script);
    let probes = report["probes"].as_array().unwrap();
    assert_eq!(probes.len(), 4);
    let of = |probe: &Value, which: &str, axis: usize| usize::try_from(probe[which][axis].as_u64().unwrap()).unwrap();
    for (probe, shown) in [(0, "shown.png"), (1, "shown.png"), (3, "dyed.png")] {
        let (probe, (picture, pixels)) = (&probes[probe], rgb(&folder, shown));
        assert_eq!([of(probe, "size", 0), of(probe, "size", 1)], picture);
        let at = 3 * (of(probe, "pixel", 1) * picture[0] + of(probe, "pixel", 0));
        let [r, g, b] = [pixels[at], pixels[at + 1], pixels[at + 2]];
        assert_eq!(probe["now"]["code"], format!("#{r:02x}{g:02x}{b:02x}"));
        assert!(probe["now"]["model_error"].as_f64().unwrap() <= 0.05, "{}", probe["now"]);
        let parts = probe["shares"].as_array().unwrap().iter().map(|share| share["light"].as_f64().unwrap());
        assert!((parts.sum::<f64>() - 1.0).abs() <= 1e-9, "{}", probe["shares"]);
        assert!(!probe["ray"].as_array().unwrap().is_empty());
    }
    assert_ne!(probes[1]["now"]["code"], probes[2]["now"]["code"], "the lamp is dimmed");
    assert_eq!(probes[1]["lights"], probes[2]["lights"], "each light alone is as it was");
    assert_ne!(probes[0]["now"]["code"], probes[3]["now"]["code"], "it is dyed");
    assert_eq!(report["settled"][0]["marches"], report["settled"][2]["marches"]);
}

#[test]
fn a_setting_is_chosen_by_what_was_measured_and_undone() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "size 320 300\nsettle\npicture before.png\nmeasure error 1.5\nsettle\npicture chosen.png\nsave session chosen.toml\nundo\nsettle\npicture after.png\n";
    let report = screen.script(&folder, "dial.toml", script);
    let choice = &report["choices"][0];
    assert!(choice["point"]["error"]["p95"].as_f64().unwrap() <= 1.5, "{choice}");
    assert!(report["curve"].as_array().unwrap().len() >= 2, "{}", report["curve"]);
    assert_eq!(bytes(&folder, "before.png"), bytes(&folder, "after.png"), "undone");
    folder.done(&["render", "chosen.toml", "-o", "rendered.png", "--size", &size(&report)]);
    assert_eq!(bytes(&folder, "chosen.png"), bytes(&folder, "rendered.png"), "as the session says");
}

#[test]
fn a_solved_palette_takes_effect_without_a_march_and_is_saved() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "size 320 300\nsettle\npicture before.png\npalette on\npalette offer\nsettle\nsolve\nsettle\nnode lamp\nprobe 0.5 0.5\n\
                  picture solved.png\nsave session solved.toml\nundo\nundo\nsettle\npicture after.png\n";
    let report = screen.script(&folder, "dial.toml", script);
    let marches = |settled: usize| report["settled"][settled]["marches"].as_u64().unwrap();
    assert_eq!(marches(1), marches(2), "weights are the same for other spectra");
    assert_eq!(report["solved"].as_array().unwrap().len(), 1);
    folder.done(&["render", "solved.toml", "-o", "rendered.png", "--size", &size(&report)]);
    assert_eq!(bytes(&folder, "solved.png"), bytes(&folder, "rendered.png"), "as the session says");
    assert_eq!(bytes(&folder, "before.png"), bytes(&folder, "after.png"), "undone");
    assert_ne!(bytes(&folder, "before.png"), bytes(&folder, "solved.png"));
}

#[test]
fn another_spectrum_is_relit_where_weights_are_kept_and_marched_where_a_model_is_fitted() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder().with("model.toml", format!("{SCENE}{DIAL}[accuracy]\naccumulate = \"spectral\"\nk = 4\n"));
    let script = "size 320 300\nsettle\nspectrum light lamp = FL11\nspectrum material flesh = orange\nsettle\npicture shown.png\nsave session other.toml\n";
    for (scene, marches) in [("dial.toml", false), ("model.toml", true)] {
        let report = screen.script(&folder, scene, script);
        let before_and_after = [0, 1].map(|settled| report["settled"][settled]["marches"].as_u64().unwrap());
        assert_eq!(before_and_after[0] < before_and_after[1], marches, "{scene}: {before_and_after:?}");
        folder.done(&["render", "other.toml", "-o", "rendered.png", "--size", &size(&report)]);
        assert_eq!(bytes(&folder, "shown.png"), bytes(&folder, "rendered.png"), "{scene}: as the session says");
    }
}

#[test]
fn a_file_that_is_dropped_on_the_window_opens_or_is_told_of() {
    let Some(screen) = Screen::new() else { return };
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n";
    let ball: Vec<u8> = header.bytes().chain((0..512_u16).map(|index| (index % 251) as u8)).collect();
    let folder = folder().with("ball.nrrd", ball).with("nonsense.dat", [7; 99]);
    std::fs::create_dir(folder.path("empty")).unwrap();
    let script = "size 320 300\nsettle\npicture first.png\ndrop ball.nrrd\nsettle\npicture volume.png\ndrop nonsense.dat\nsettle\n\
                  picture kept.png\ndrop empty\nsettle\ndrop dial.toml\nsettle\nnode lamp\npicture scene.png\n";
    let report = screen.script(&folder, "scene.toml", script);
    let notices = report["notices"].to_string();
    assert!(notices.contains("nonsense.dat") && notices.contains("empty"), "{notices}");
    assert_ne!(bytes(&folder, "first.png"), bytes(&folder, "volume.png"), "the volume alone");
    assert_eq!(bytes(&folder, "volume.png"), bytes(&folder, "kept.png"), "what was there before stays");
    folder.done(&["render", "dial.toml", "-o", "lamp.png", "--size", &size(&report), "--light", "lamp"]);
    assert_eq!(bytes(&folder, "scene.png"), bytes(&folder, "lamp.png"), "the scene, usable as any");
}

#[test]
fn a_folder_of_dicom_opens_as_an_argument_and_when_it_is_dropped() {
    use support::dicom::{EXPLICIT, Value, file, slice};
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    for name in ["scan", "two"] {
        std::fs::create_dir(folder.path(name)).unwrap();
    }
    for z in 0..8_u16 {
        let pixels: Vec<u16> = (0..64).map(|index| (index * 5 + z * 31) % 97).collect();
        let one = slice(f64::from(z), 0).short(0x0028_0010, &[8]).short(0x0028_0011, &[8]);
        let one = one.with(0x7fe0_0010, "OW", Value::Short(pixels));
        let other = one.clone().text(0x0020_000e, "UI", "9.9").text(0x0020_0011, "IS", "6");
        for (name, slice) in
            [(format!("scan/{}", 9 - z), &one), (format!("two/a{z}"), &one), (format!("two/b{z}"), &other)]
        {
            std::fs::write(folder.path(&name), file(slice, EXPLICIT)).unwrap();
        }
    }
    let dropped = "size 320 300\nsettle\ndrop scan\nsettle\npicture dropped.png\ndrop two\nsettle\n";
    let report = screen.script(&folder, "scene.toml", dropped);
    let notices = report["notices"].to_string();
    assert!(notices.contains("2 series: 5 «made» MR 8×8×8, 6 «made» MR 8×8×8"), "{notices}");
    screen.script(&folder, "scan", "size 320 300\nsettle\npicture opened.png\n");
    assert_eq!(bytes(&folder, "dropped.png"), bytes(&folder, "opened.png"));
}

#[test]
fn lines_about_a_scene_wait_until_it_is_open() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let edits = "node lamp\norbit 20 10\ninterval 0 30 90 5 0.3\nspectrum material flesh = orange\n";
    let [at_once, settled] = ["", "settle\n"].map(|first| {
        screen.script(&folder, "dial.toml", &format!("size 320 300\n{first}{edits}settle\npicture shown.png\n"));
        bytes(&folder, "shown.png")
    });
    assert_eq!(at_once, settled);
    let outcome = {
        std::fs::write(folder.path("script.txt"), "node lamp\n").unwrap();
        screen.run(&folder, &["nothing.toml", "--script", "script.txt"])
    };
    outcome.assert_refused(1, &["script.txt:1", "nothing is open"]);
}

#[test]
fn another_observer_is_a_relight_of_weights_and_of_a_model_and_renders_equal() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder().with("model.toml", format!("{SCENE}{DIAL}[accuracy]\naccumulate = \"spectral\"\nk = 4\n"));
    let script = "size 320 300\nsettle\npicture before.png\nobserver 1964\nlight lamp 0.8\nsettle\npicture seen.png\nsave session seen.toml\n\
                  undo\nundo\nsettle\npicture after.png\n";
    for scene in ["dial.toml", "model.toml"] {
        let report = screen.script(&folder, scene, script);
        let marches = [0, 1, 2].map(|settled| report["settled"][settled]["marches"].as_u64().unwrap());
        assert_eq!(marches, [marches[0]; 3], "{scene}: who looks never marches");
        folder.done(&["render", "seen.toml", "-o", "rendered.png", "--size", &size(&report)]);
        assert_eq!(bytes(&folder, "seen.png"), bytes(&folder, "rendered.png"), "{scene}: as the session says");
        assert_ne!(bytes(&folder, "before.png"), bytes(&folder, "seen.png"), "{scene}");
        assert_eq!(bytes(&folder, "before.png"), bytes(&folder, "after.png"), "{scene}: undone");
    }
}

#[test]
fn crops_previews_and_presets_save_and_render_equal_and_light_never_marches() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "settle
crop 0.2 0.9 0 1 0.1 0.8
settle
picture cropped.png
vision deutan
node lamp
keep evening
hand 0.3 0.2
keep noon
hand 0.15 -0.4
keep dusk
rename noon to midday
tour 0.3
preset midday
settle
picture seen.png
picture seen.exr
save session seen.toml
tour tour.png 5
preset midday
settle
picture still.png
sees all
settle
crop off
settle
";
    let report = screen.script(&folder, "dial.toml", script);
    assert_eq!(report["notices"], Value::Array(Vec::new()));
    let marches = |at: usize| report["settled"][at]["marches"].as_u64().unwrap();
    assert!(marches(1) > marches(0), "a crop marches: {}", report["settled"]);
    assert_eq!([marches(2), marches(3), marches(4)], [marches(1); 3], "light never does: {}", report["settled"]);
    assert!(marches(5) > marches(4), "{}", report["settled"]);
    assert_ne!(bytes(&folder, "cropped.png"), bytes(&folder, "seen.png"));
    assert_eq!(bytes(&folder, "seen.png"), bytes(&folder, "still.png"), "a saved tour leaves the light as it was");
    let size = size(&report);
    assert_opens_as_it_was_saved(&screen, &folder, "seen.toml", ["seen.png", "seen.exr"], &size);
    // Every picture of a tour equals that of `render` for the session with the hand at that position.
    for (number, hand) in [(1, "[0, -1]"), (3, "[0.3, 0.2]"), (5, "[0.15, -0.4]")] {
        let mix = format!("mix.hand={hand}");
        folder.done(&[
            "render",
            "seen.toml",
            "-o",
            "rendered.png",
            "--size",
            &size,
            "-D",
            "mix.by=\"dial\"",
            "-D",
            &mix,
        ]);
        let saved = bytes(&folder, &format!("tour-000{number}.png"));
        assert_eq!(saved, bytes(&folder, "rendered.png"), "picture {number} of the tour");
    }
}

#[test]
fn a_file_that_is_no_scene_is_told_of_as_info_does() {
    let vaa3d = b"raw_image_stack_by_hpengL".to_vec();
    let folder = folder().with("head.v3draw", &vaa3d).with("head", vaa3d);
    for name in ["head.v3draw", "head"] {
        folder.refused(1, &["info", name], &["this is a Vaa3D raw file"]);
        folder.refused(1, &["render", name, "-o", "head.png"], &["this is a Vaa3D raw file", "NRRD"]);
    }
    let Some(screen) = Screen::new() else { return };
    let report = screen.script(&folder, "scene.toml", "size 320 300\nsettle\ndrop head.v3draw\nsettle\n");
    assert!(report["notices"][0].as_str().unwrap().contains("this is a Vaa3D raw file"), "{}", report["notices"]);
}

#[test]
fn a_tour_that_is_played_ends_with_a_step_back_and_with_what_it_is_of() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "size 320 300
settle
picture before.png
hand 0.3 0.2
keep noon
hand 0.15 -0.4
keep dusk
settle
picture dusk.png
tour 600
frames 3
orbit 10 0
frames 3
undo
settle
picture turned.png
undo
settle
picture after.png
tour 600
frames 2
open dial.toml
settle
picture other.png
";
    let begun = Instant::now();
    let report = screen.script(&folder, "dial.toml", script);
    assert!(begun.elapsed() < Duration::from_secs(300), "a tour of ten minutes was waited for");
    assert_eq!(report["notices"], Value::Array(Vec::new()));
    assert_eq!(bytes(&folder, "dusk.png"), bytes(&folder, "after.png"), "the tour is one step back");
    assert_ne!(bytes(&folder, "dusk.png"), bytes(&folder, "turned.png"), "the hand is at noon");
    assert_eq!(bytes(&folder, "before.png"), bytes(&folder, "other.png"), "what is opened is not toured");
}

#[test]
fn a_script_that_drops_a_file_of_several_volumes_is_told_how_one_is_chosen() {
    let Some(screen) = Screen::new() else { return };
    let header = "NRRD0004\ntype: uint8\ndimension: 4\nsizes: 4 4 4 2\nencoding: raw\n\n";
    let steps: Vec<u8> = header.bytes().chain(0..128).collect();
    let folder = folder().with("steps.nrrd", steps);
    let report = screen.script(&folder, "scene.toml", "size 320 300\nsettle\ndrop steps.nrrd\nsettle\n");
    let notice = report["notices"][0].as_str().unwrap();
    assert!(notice.contains("steps.nrrd") && notice.contains("choose a time step from 0 to 1"), "{notice}");
}

#[test]
fn a_light_of_intensity_0_is_off_as_the_scene_opens_and_there_to_be_turned_on() {
    let folder = folder()
        .with("dark.toml", format!("{SCENE}{DIAL}").replace("intensity = 0.5", "intensity = 0"))
        .with("one.toml", format!("{SCENE}{DIAL}").replace("intensity = 0.5", "intensity = 1"));
    let render = |scene: &str, picture: &str, more: &[&str]| {
        folder.done(&[&["render", scene, "-o", picture, "--size", "40x30"], more].concat());
        bytes(&folder, picture)
    };
    let dark = render("dark.toml", "dark.png", &[]);
    assert_eq!(dark, render("one.toml", "day.png", &["--light", "day"]), "the other light alone");
    let lamp = render("one.toml", "lamp.png", &["--light", "lamp"]);
    assert_eq!(render("dark.toml", "asked.png", &["--light", "lamp"]), lamp, "it is there to be asked for");
    let on = ["-D", "mix.on=[\"lamp\"]"];
    assert_eq!(render("dark.toml", "on.png", &on), render("one.toml", "both.png", &[]), "and to be turned on");
    let Some(screen) = Screen::new() else { return };
    let script = "size 320 300\nsettle\npicture off.png\non lamp\npicture on.png\nsave session on.toml\nnode lamp\npicture node.png\n";
    let report = screen.script(&folder, "dark.toml", script);
    assert_opens_as_it_was_saved_in(&folder, "on.toml", "on.png", &size(&report));
    let rendered = |more: &[&str]| {
        folder.done(&[&["render", "dark.toml", "-o", "rendered.png", "--size", &size(&report)], more].concat());
        bytes(&folder, "rendered.png")
    };
    assert_eq!(bytes(&folder, "off.png"), rendered(&[]));
    assert_eq!(bytes(&folder, "node.png"), rendered(&["--light", "lamp"]));
}

/// Asserts that `render` makes the picture `saved` from `session`.
fn assert_opens_as_it_was_saved_in(folder: &Folder, session: &str, saved: &str, size: &str) {
    folder.done(&["render", session, "-o", "again.png", "--size", size]);
    assert_eq!(bytes(folder, saved), bytes(folder, "again.png"), "{session} rendered");
}

#[test]
fn what_a_hand_saves_has_a_name_of_its_own_each_time() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder().with("relume-0002.png", "kept");
    // The file menu and its entry "Save picture".
    let click = |[x, y]: [u32; 2]| format!("pointer {x} {y}\nframes 2\npress\nrelease\nframes 2\nsettle\n");
    let save = [[22, 17], [60, 168]].map(click).concat();
    screen.script(&folder, "dial.toml", &format!("size 1280 800\nsettle\n{save}{save}"));
    let names = folder.names();
    assert!(
        names.contains(&"relume-0001.png".to_owned()) && names.contains(&"relume-0003.png".to_owned()),
        "{names:?}"
    );
    assert_eq!(bytes(&folder, "relume-0002.png"), b"kept");
}

#[test]
fn accumulators_are_saved_as_render_writes_them_of_the_session() {
    let Some(screen) = Screen::new() else { return };
    let model = format!("{SCENE}{DIAL}[accuracy]\naccumulate = \"spectral\"\nk = 4\n");
    let folder = folder().with("model.toml", model);
    let script = "size 320 300\nsettle\norbit 20 10\ninterval 0 40 95 4 0.2\nlight lamp 0.8\noff day\nobserver 1964\nsettle\n\
                  accumulators saved.exr\nlight lamp 0.1\nsave session later.toml\nlight lamp 0.8\nsave session saved.toml\n\
                  accumulators saved.png\n";
    for scene in ["dial.toml", "model.toml"] {
        let report = screen.script(&folder, scene, script);
        let refused = report["notices"].to_string();
        assert!(refused.contains("saved.png: the name of this file must end in .exr"), "{scene}: {refused}");
        let of = ["render", "saved.toml", "--accumulators", "rendered.exr", "--size", &size(&report)];
        folder.done(&of);
        assert!(bytes(&folder, "saved.exr") == bytes(&folder, "rendered.exr"), "{scene}: as the session says");
        assert!(folder.names().iter().all(|name| name != "saved.png"), "{scene}");
    }
}

#[test]
fn a_page_is_saved_as_page_writes_it_of_the_film_and_a_cancelled_one_is_not() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "size 320 300\nsettle\nhand 0.3 -0.1\nsettle\naccumulators film.exr\npage saved.html\nlight lamp 0.1\nsettle\n\
                  page cancelled.html\ncancel page\nsettle\npage saved.png\n";
    let report = screen.script(&folder, "dial.toml", script);
    let refused = report["notices"].to_string();
    assert!(refused.contains("saved.png: the name of a page must end in .html"), "{refused}");
    folder.done(&["page", "film.exr", "-o", "of_film.html"]);
    assert!(bytes(&folder, "saved.html") == bytes(&folder, "of_film.html"), "as the film says");
    let names = folder.names();
    assert!(names.iter().all(|name| name != "cancelled.html" && name != "saved.png"), "{names:?}");
}

#[test]
fn a_volume_that_is_put_into_no_scene_opens_as_one_without_a_scene() {
    let Some(screen) = Screen::new() else { return };
    let header = "NRRD0004\ntype: uint16\nendian: little\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n";
    // Values far outside those of the built-in scene.
    let values = (0..512_u16).flat_map(|index| (index * 120).to_le_bytes());
    let folder = folder().with("ball.nrrd", header.bytes().chain(values).collect::<Vec<u8>>());
    std::fs::write(folder.path("script.txt"), "settle\npicture shown.png\n").unwrap();
    let [alone, named] = [&["ball.nrrd"][..], &["--volume", "ball.nrrd"]].map(|source| {
        let outcome = screen.run(&folder, &[source, &["--script", "script.txt"]].concat());
        assert_eq!(outcome.code, Some(0), "{}", outcome.err);
        bytes(&folder, "shown.png")
    });
    assert_eq!(alone, named);
}

#[test]
fn a_window_without_a_size_is_as_large_on_every_screen_and_one_with_a_size_has_its_pixels() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let size = |mut command: std::process::Command, scale: &str| {
        let outcome = Outcome::of(command.env("WINIT_X11_SCALE_FACTOR", scale));
        assert_eq!(outcome.code, Some(0), "{}", outcome.err);
        let side = |axis: usize| outcome.json()["size"][axis].as_u64().unwrap();
        [side(0), side(1)]
    };
    let arguments = ["scene.toml", "--frames", "4"];
    let usual = ["1", "2"].map(|scale| size(screen.command_of_any_size(&folder, &arguments), scale));
    for axis in 0..2 {
        assert!(usual[1][axis].abs_diff(2 * usual[0][axis]) <= 2, "{usual:?}");
    }
    assert_eq!(size(screen.command(&folder, &arguments), "2")[0], 640, "too few points for panels");
}

#[test]
fn a_volume_of_one_slice_opens_face_on_and_is_seen_and_saved_so() {
    let Some(screen) = Screen::new() else { return };
    // A bright disc in a darker square, with a brighter spot at the top left.
    let [across, down] = [64_usize, 48];
    let value = |i: usize| {
        let [x, y] = [i % across, i / across].map(|at| f64::from(u32::try_from(at).unwrap()));
        let away = |at: [f64; 2]| (x - at[0]).hypot(y - at[1]);
        if away([10.0, 8.0]) < 4.0 { 250 } else { 60 + 100 * u8::from(away([32.0, 24.0]) < 12.0) }
    };
    let voxels: Vec<u8> = (0..across * down).map(value).collect();
    let header =
        "ObjectType = Image\nNDims = 3\nDimSize = 64 48 1\nElementType = MET_UCHAR\nElementDataFile = slice.raw\n";
    let folder = folder().with("slice.raw", voxels).with("slice.mhd", header);
    let script = "size 400 400\npanels off\nsettle\npicture slice.png\nsave session again.toml\n";
    let report = screen.script(&folder, "slice.mhd", script);
    assert_opens_as_it_was_saved_in(&folder, "again.toml", "slice.png", &size(&report));
    let ([width, height], pixels) = rgb(&folder, "slice.png");
    let middle = &pixels[3 * (height / 2 * width + width / 2)..][..3];
    assert!(middle.iter().any(|&code| code > 80), "the disc: {middle:?}");
    let lit = pixels.chunks_exact(3).filter(|pixel| pixel.iter().any(|&code| code > 60)).count();
    assert!(10 * lit > width * height, "{lit} of {}", width * height);
    // The left and the top of the slice are left and top on the screen too.
    let spot =
        pixels.chunks_exact(3).enumerate().max_by_key(|(_, pixel)| pixel.iter().map(|&c| u32::from(c)).sum::<u32>());
    let (index, _) = spot.unwrap();
    assert!(index % width < width / 2 && index / width < height / 2, "{} {}", index % width, index / width);
}

#[test]
fn slices_follow_the_probe_and_neither_march_nor_appear_in_saved_pictures() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let script = "size 1280 720\nslices on\nsettle\nslices at 10 11 12\nslices window 0 100\nslices materials on\nframes 3\nsettle\n\
                  window slices.png\npicture shown.png\nprobe 0.5 0.5\nframes 3\nsettle\n";
    let report = screen.script(&folder, "dial.toml", script);
    let marches = |at: usize| report["settled"][at]["marches"].as_u64().unwrap();
    assert_eq!([marches(1), marches(2)], [marches(0); 2], "slices march nothing");
    folder.done(&["render", "dial.toml", "-o", "rendered.png", "--size", &size(&report)]);
    assert_eq!(bytes(&folder, "shown.png"), bytes(&folder, "rendered.png"));
    // Origin of most of the light of the probed ray.
    let slices = &report["slices"];
    assert_eq!(slices["window"].as_array().unwrap().len(), 2);
    assert!(slices["value"].is_number() && slices["at"] != serde_json::json!([10.0, 11.0, 12.0]), "{slices}");
    let report = screen.script(&folder, "dial.toml", "size 1280 720\nslices on\nsettle\nslices at 10 11 12\nsettle\n");
    assert_eq!(report["slices"]["at"], serde_json::json!([10.0, 11.0, 12.0]));
    let report = screen.script(&folder, "dial.toml", "settle\n");
    assert_eq!(report["slices"], Value::Null, "hidden");
}

#[test]
fn the_measuring_line_ends_where_the_light_of_a_pixel_comes_from() {
    let Some(screen) = Screen::new() else { return };
    let folder = folder();
    let measured = |lines: &str| {
        let script = format!("size 640 480\nsettle\nruler on\n{lines}frames 2\nsettle\n");
        let report = screen.script(&folder, "dial.toml", &script);
        let marches = |at: usize| report["settled"][at]["marches"].as_u64().unwrap();
        assert_eq!(marches(0), marches(1), "measuring marches nothing in the picture");
        report["ruler"].clone()
    };
    assert_eq!(measured("ruler world 1 2 3\nruler world 4 6 3\n")["length"].as_f64(), Some(5.0));
    let ruler = measured("ruler at 0.45 0.5\nruler at 0.55 0.5\n");
    let end = |at: usize| [0, 1, 2].map(|axis| ruler["ends"][at][axis].as_f64().unwrap());
    let square: f64 = end(0).iter().zip(end(1)).map(|(one, two)| (one - two) * (one - two)).sum();
    assert!(square > 0.0 && (square.sqrt() - ruler["length"].as_f64().unwrap()).abs() < 1e-9, "{ruler}");
    // A corner of the picture shows nothing.
    let report =
        screen.script(&folder, "dial.toml", "size 640 480\nsettle\nruler on\nruler at 0 0\nframes 2\nsettle\n");
    assert_eq!(report["ruler"]["ends"], serde_json::json!([]));
    assert!(report["notices"].to_string().contains("nothing is visible at this pixel"), "{report}");
}
