//! A volume without a scene: its picture, its scene, and the words about it.

use crate::support;

use relume::spectrum::colour::{decode_srgb, encode_srgb};
use support::program::{Folder, SCENE};

const RENDER: [&str; 6] = ["render", "scene.toml", "--size", "8x8", "-o", "p.png"];

#[test]
fn a_misspelt_light_of_the_scene_is_suggested_before_any_standard() {
    let folder = Folder::new().with("scene.toml", SCENE.replace("lights.day", "lights.key"));
    let outcome =
        folder.refused(2, &[&RENDER[..], &["--light", "kee"]].concat(), &["did you mean \"key\" of the scene?"]);
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
    let folder = folder.with("ball.nrrd", ball());
    assert_eq!(folder.done(&["convert", "ball.nrrd", "ball.mha", "-q"]).out, "");
    assert!(folder.done(&[&RENDER[..], &["-q", "--json"]].concat()).out.starts_with('{'), "JSON is asked for");
    let palette = folder
        .with("p.toml", "version = 1\n[lights.day]\nspectrum = \"D65\"\n[materials.a]\n[cells.a]\nday = \"#808080\"\n");
    assert_eq!(palette.done(&["design", "p.toml", "-o", "q.toml", "-q"]).out, "");
    let folder = palette;
    assert!(folder.done(&["design", "p.toml", "-q"]).out.contains("solved in"), "the report is the result");
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
        let json =
            folder.done(&["relight", "film.exr", "--sweep", "day..lamp", "--frames", "3", "-o", "s.png", "--json"]);
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
    let folder = Folder::new().with("body.raw", body([40, 56, 36]));
    let layout = ["--type", "uint16", "--big-endian"];
    let wrong = folder.done(&[&["info", "body.raw", "--dims", "56x40x36"][..], &layout].concat());
    assert!(wrong.err.contains("dims 40×56×36"), "{}", wrong.err);
    assert_eq!(folder.done(&[&["info", "body.raw", "--dims", "40x56x36"][..], &layout].concat()).err, "");
    let words = ["suggest dims 40×56×36", ", or dims", "--dims 40x56x36 --type uint16 --big-endian"];
    folder.refused(1, &["info", "body.raw"], &words);
}

/// An NRRD file of bytes.
fn nrrd([nx, ny, nz]: [usize; 3], more: &str, value: impl Fn([i32; 3]) -> u8) -> Vec<u8> {
    let header = format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: {nx} {ny} {nz}\nencoding: raw\n{more}\n");
    let at = |index: usize| [index % nx, index / nx % ny, index / nx / ny].map(|at| i32::try_from(at).unwrap());
    header.bytes().chain((0..nx * ny * nz).map(|index| value(at(index)))).collect()
}

/// A ball with a core away from the middle of a volume, in air.
fn ball() -> Vec<u8> {
    nrrd([48, 40, 36], "", |[x, y, z]| {
        let [x, y, z] = [x - 30, y - 18, z - 15];
        match x * x + y * y + z * z {
            0..20 => 220,
            20..150 => 110,
            _ => u8::try_from((x + 2 * y + 3 * z).rem_euclid(7)).unwrap(),
        }
    })
}

/// Fractions of width and height that pixels brighter than black span, and the middle of each.
fn spans(path: &std::path::Path) -> [[f64; 2]; 2] {
    spans_above(8, path)
}

/// As [`spans`], of pixels above a code.
fn spans_above(black: u8, path: &std::path::Path) -> [[f64; 2]; 2] {
    let mut decoder =
        png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
    let info = decoder.next_frame(&mut pixels).unwrap();
    let width = usize::try_from(info.width).unwrap();
    let lit: Vec<usize> = pixels
        .chunks_exact(3)
        .enumerate()
        .filter(|(_, it)| it.iter().any(|&code| code > black))
        .map(|(at, _)| at)
        .collect();
    let sides = [info.width, info.height].map(f64::from);
    [0, 1].map(|axis| {
        let places = || lit.iter().map(|at| [at % width, at / width][axis]);
        let [low, high] = [places().min().unwrap(), places().max().unwrap() + 1];
        let [low, high] = [low, high].map(|place| f64::from(u32::try_from(place).unwrap()) / sides[axis]);
        [high - low, f64::midpoint(low, high)]
    })
}

#[cfg(feature = "window")]
#[test]
fn render_of_a_volume_is_the_picture_of_the_window_to_the_bit() {
    let Some(screen) = support::screen::Screen::new() else { return };
    let folder = Folder::new().with("ball.nrrd", ball());
    let report =
        screen.script(&folder, "ball.nrrd", "size 640 480\nsettle\npicture window.png\nsave session again.toml\n");
    let size = format!("{}x{}", report["size"][0], report["size"][1]);
    folder.done(&["render", "ball.nrrd", "--size", &size, "-o", "render.png"]);
    folder.done(&["render", "--volume", "ball.nrrd", "--size", &size, "-o", "flag.png"]);
    folder.done(&["render", "again.toml", "--size", &size, "-o", "session.png"]);
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    for name in ["render.png", "flag.png", "session.png"] {
        assert!(bytes(name) == bytes("window.png"), "{name} differs from the window");
    }
}

#[test]
fn the_scene_of_a_volume_is_saved_with_comments_and_renders_the_same() {
    for look in ["", "bone", "grey", "fluorescence", "vessel", "maximum"] {
        let look: &[&str] = if look.is_empty() { &[] } else { &["--look", look] };
        let folder = Folder::new().with("ball.nrrd", ball());
        let shown =
            [&["render", "ball.nrrd", "--size", "40x40", "-o", "a.png", "--save-scene", "a.toml"][..], look].concat();
        let outcome = folder.done(&shown);
        let notes: Vec<&str> = outcome.err.lines().collect();
        assert_eq!(notes.len(), 2, "two sentences: {}", outcome.err);
        assert!(notes[0].contains("ball.nrrd has no scene") && notes[1].contains("--look"), "{}", outcome.err);
        folder.done(&["render", "a.toml", "--size", "40x40", "-o", "b.png"]);
        let [a, b] = ["a.png", "b.png"].map(|name| std::fs::read(folder.path(name)).unwrap());
        assert!(a == b, "{look:?}");
        let text = std::fs::read_to_string(folder.path("a.toml")).unwrap();
        assert!(text.starts_with("# First look at ball.nrrd") && text.contains("# Opacity is"), "{text}");
    }
    let folder = Folder::new().with("ball.nrrd", ball());
    let window = ["--window", "100", "--level", "110"];
    folder.done(&[&["render", "ball.nrrd", "--size", "40x40", "-o", "a.png"][..], &window].concat());
    folder.refused(2, &["render", "ball.nrrd", "--window", "100"], &["--level"]);
    folder.refused(2, &[&RENDER[..], &window].concat(), &["--look, --window and --level are for a volume"]);
    folder.refused(
        2,
        &["render", "ball.nrrd", "--look", "teeth"],
        &["tissue, bone, vessel, grey, fluorescence, maximum, ct-bone"],
    );
}

#[test]
fn an_edited_cell_of_a_solved_palette_is_not_ignored_in_silence() {
    let folder = Folder::new().with("ball.nrrd", ball());
    folder.done(&["render", "ball.nrrd", "--size", "8x8", "-o", "a.png", "--save-scene", "a.toml"]);
    let scene = std::fs::read_to_string(folder.path("a.toml")).unwrap();
    let warning = |name: &str| folder.done(&["render", name, "--size", "8x8", "-o", "p.png"]).err;
    assert_eq!(warning("a.toml").matches("palette.cells").count(), 0, "nothing was edited");
    let (before, after) = scene.split_once("day = \"#").unwrap();
    let edited = format!("{before}day = \"#3060ff{}", &after[6..]);
    std::fs::write(folder.path("b.toml"), &edited).unwrap();
    let warning = warning("b.toml");
    for word in
        ["palette.cells", "under day", "#3060ff", "were changed, or designed for another palette", "relume design"]
    {
        assert!(warning.contains(word), "no {word} in {warning}");
    }
    let designed = folder.done(&["design", "b.toml"]).err;
    assert!(designed.contains("b.toml has spectra of its own for ") && designed.contains("--save-scene"), "{designed}");
    std::fs::create_dir(folder.path("there")).unwrap();
    let designed = folder.done(&["design", "b.toml", "--save-scene", "there/c.toml"]);
    assert!(designed.err.is_empty() && designed.out.contains("wrote there/c.toml"), "{}", designed.err);
    let render = |name: &str| folder.done(&["render", name, "--size", "8x8", "-o", "p.exr", "--json"]);
    let outcome = render("there/c.toml");
    assert!(!outcome.err.contains("palette.cells"), "the spectra are those of the palette: {}", outcome.err);
    let json: serde_json::Value = serde_json::from_str(&outcome.out).unwrap();
    assert_eq!(json["lights"], serde_json::json!([{ "name": "day", "weight": 1.0 }]), "{json}");
}

#[test]
fn numbers_and_names_that_mean_nothing_are_refused_with_those_that_do() {
    let folder = Folder::new().with("ball.nrrd", ball());
    fn render<'a>(more: &[&'a str]) -> Vec<&'a str> {
        [&["render", "ball.nrrd", "--size", "8x8", "-o", "p.png"], more].concat()
    }
    folder.refused(2, &render(&["--window", "-5", "--level", "3"]), &["-5", "write a width above 0"]);
    folder.refused(2, &render(&["--component", "DAPI"]), &["DAPI", "the number of a component", "relume info"]);
    let of = "materials.femur.reflectance=0.3";
    folder.refused(
        2,
        &render(&["-D", of]),
        &[of, "there is no materials.femur (there are: ", "nothing uses a new one"],
    );
    let used = ["-D", "materials.femur.reflectance=0.3", "-D", "transfer.intervals.0.material=femur"];
    folder.done(&render(&used));
}

#[test]
fn a_light_that_is_renamed_in_the_palette_shines_from_where_the_others_do() {
    let folder = Folder::new().with("ball.nrrd", ball());
    folder.done(&["render", "ball.nrrd", "--size", "8x8", "-o", "a.png", "--save-scene", "a.toml"]);
    let scene = std::fs::read_to_string(folder.path("a.toml")).unwrap();
    let table: toml::Table = scene.parse().unwrap();
    let name = table["palette"]["lights"].as_table().unwrap().keys().find(|name| name.starts_with("for_")).unwrap();
    // Only the palette is edited, as its user may do.
    let (before, palette) = scene.split_at(scene.find("[palette").unwrap());
    let (palette, after) = palette.split_at(palette.find("[materials").unwrap_or(palette.len()));
    let edited = format!("{before}{}{after}", palette.replace(name.as_str(), "for_core"));
    std::fs::write(folder.path("b.toml"), &edited).unwrap();
    let outcome = folder.done(&["design", "b.toml", "--save-scene", "c.toml"]);
    assert!(outcome.err.contains(&format!("[palette.lights] does not have {name}")), "{}", outcome.err);
    let solved: toml::Table = std::fs::read_to_string(folder.path("c.toml")).unwrap().parse().unwrap();
    let [day, core] = ["day", "for_core"].map(|name| solved["lights"][name].as_table().unwrap());
    assert!(day.contains_key("kind"), "{day:?}");
    for key in ["kind", "direction", "position", "shadows"] {
        assert_eq!(core.get(key), day.get(key), "{key}");
    }
    // Its old table may be removed, as the warning says: nothing else names the light.
    let (kept, removed) = edited.split_at(edited.find(&format!("[lights.{name}]")).unwrap());
    let behind = removed.match_indices("\n[").map(|(at, _)| &removed[at + 1..]);
    let rest = behind.into_iter().find(|rest| !rest.starts_with(&format!("[lights.{name}."))).unwrap();
    std::fs::write(folder.path("d.toml"), format!("{kept}{rest}")).unwrap();
    let quiet = folder.done(&["design", "d.toml", "--save-scene", "e.toml"]).err;
    assert!(!quiet.contains("[palette.lights]"), "{quiet}");
    folder.done(&["render", "e.toml", "--light", "for_core", "--size", "8x8", "-o", "e.png"]);
}

#[test]
fn a_material_that_is_renamed_in_one_place_alone_is_told() {
    let folder = Folder::new().with("ball.nrrd", ball());
    folder.done(&["render", "ball.nrrd", "--size", "8x8", "-o", "a.png", "--save-scene", "a.toml"]);
    let scene = std::fs::read_to_string(folder.path("a.toml")).unwrap();
    let quiet = folder.done(&["design", "a.toml", "--save-scene", "b.toml"]).err;
    assert!(!quiet.contains("no interval"), "{quiet}");
    let (before, palette) = scene.split_at(scene.find("[palette").unwrap());
    let (palette, after) = palette.split_at(palette.find("[materials").unwrap_or(palette.len()));
    std::fs::write(folder.path("c.toml"), format!("{before}{}{after}", palette.replace("solid", "bone"))).unwrap();
    let warned = folder.done(&["design", "c.toml", "--save-scene", "d.toml"]).err;
    assert!(warned.contains("no interval and no label has the material bone; a material that is renamed"), "{warned}");
    std::fs::write(folder.path("e.toml"), format!("{}{palette}{after}", before.replace("\"solid\"", "\"bone\"")))
        .unwrap();
    let missing =
        "e.toml: an interval or a label has the material bone, which neither [palette.materials] nor [materials] has";
    folder.refused(1, &["design", "e.toml", "--save-scene", "f.toml"], &[missing]);
    assert!(!folder.path("f.toml").exists());
}

#[test]
fn a_scene_that_was_edited_is_kept_where_another_is_saved() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let save = ["render", "ball.nrrd", "--size", "8x8", "-o", "a.png", "--save-scene", "a.toml"];
    let first = folder.done(&save);
    assert!(first.out.contains("wrote a.png, a.toml; lit by day\n"), "{}", first.out);
    let scene = std::fs::read_to_string(folder.path("a.toml")).unwrap();
    assert!(scene.contains("hand = \"day\""), "a name that stays right where lights are added: {scene}");
    folder.done(&save);
    assert!(!folder.path("a.toml.bak").exists(), "the same scene");
    std::fs::write(folder.path("a.toml"), format!("{scene}# edited\n")).unwrap();
    let note = folder.done(&save).err;
    assert!(note.contains("a.toml had another content, which is now in a.toml.bak"), "{note}");
    assert_eq!(std::fs::read_to_string(folder.path("a.toml")).unwrap(), scene);
    assert!(std::fs::read_to_string(folder.path("a.toml.bak")).unwrap().ends_with("# edited\n"));
    let renamed = scene.replace("hand = \"day\"", "hand = \"noon\"");
    std::fs::write(folder.path("b.toml"), renamed).unwrap();
    folder.refused(
        1,
        &["render", "b.toml", "-o", "b.png"],
        &["mix.hand: noon: there is no such light; there are: day"],
    );
}

#[test]
fn a_picture_without_a_name_takes_the_volumes_and_keeps_what_is_there() {
    let folder = Folder::new().with("ball.nrrd", ball()).with("ball.png", b"mine");
    let outcome = folder.done(&["render", "ball.nrrd", "--size", "8x8"]);
    assert!(outcome.out.starts_with("wrote ball-2.png"), "{}", outcome.out);
    assert_eq!(std::fs::read(folder.path("ball.png")).unwrap(), b"mine");
    folder.refused(2, &["render", "scene.toml"], &["no output"]);
    // A picture is told to be one, and not that it lacks an output.
    folder.refused(1, &["render", "ball-2.png"], &["ball-2.png", "PNG picture"]);
}

#[test]
fn the_camera_fits_what_is_visible_and_not_the_box_of_the_volume() {
    let folder = Folder::new().with("ball.nrrd", ball());
    folder.done(&["render", "ball.nrrd", "--size", "300x300", "-o", "p.png", "--background", "#000000"]);
    let spans = spans(&folder.path("p.png"));
    let larger = spans[0][0].max(spans[1][0]);
    assert!((larger / 0.9 - 1.0).abs() <= 0.02, "{spans:?}");
    assert!(spans.iter().all(|[_, middle]| (middle - 0.5).abs() <= 0.02), "{spans:?}");
}

/// A shallow slab is seen from above.
#[test]
fn the_camera_fits_wide_and_high_pictures() {
    let slab = nrrd([48, 40, 24], "", |[x, y, z]| {
        let inside = (4..44).contains(&x) && (6..34).contains(&y) && (8..14).contains(&z);
        u8::from(inside) * 150 + u8::try_from((x + 2 * y + 3 * z).rem_euclid(7)).unwrap()
    });
    // The march ends at the centres of thick slices, and specks of noise hardly show.
    let column = nrrd([40, 40, 8], "spacings: 1 1 6\n", |[x, y, z]| {
        // Noise, without which these would be labels.
        let noise = u8::try_from((x + 2 * y + 3 * z).rem_euclid(7)).unwrap();
        let (x, y) = (x - 20, y - 20);
        let is_speck = z == 4 && (x, y) == (-18, 0);
        noise + if x * x + y * y < 144 { 200 } else { u8::from(is_speck) * 60 }
    });
    let folder = Folder::new().with("slab.nrrd", slab).with("column.nrrd", column);
    let sizes = ["256x256", "320x240", "320x180", "240x320", "180x320"];
    for (name, size) in sizes.into_iter().flat_map(|size| [("slab.nrrd", size), ("column.nrrd", size)]) {
        folder.done(&["render", name, "--size", size, "-o", "p.png", "--background", "#000000"]);
        let spans = spans(&folder.path("p.png"));
        let larger = spans[0][0].max(spans[1][0]);
        // 2 %, and half of one of at least 180 pixels at either end.
        assert!((larger - 0.9).abs() <= 0.018 + 1.0 / 180.0, "{name}, {size}: {spans:?}");
    }
}

#[test]
fn a_patient_stands_upright_and_a_stack_has_z_up() {
    // A tall body with a small bright head at the upper end of z, which the file may call inferior.
    let body = |[x, y, z]: [i32; 3]| {
        let wide = if z < 24 { 6 } else { 2 };
        if (x - 10).abs() <= wide && (y - 10).abs() <= 3 && (3..37).contains(&z) { 200 } else { 0 }
    };
    let axes = "space: left-posterior-superior\nspace directions: (1,0,0) (0,1,0) (0,0,-1)\n";
    let stack = nrrd([20, 20, 40], "", body);
    let patient = nrrd([20, 20, 40], axes, body);
    let folder = Folder::new().with("stack.nrrd", stack).with("patient.nrrd", patient);
    for (name, head_is_up) in [("stack.nrrd", true), ("patient.nrrd", false)] {
        folder.done(&[
            "render",
            name,
            "--size",
            "100x100",
            "-o",
            "p.png",
            "--background",
            "#000000",
            "--save-scene",
            "p.toml",
        ]);
        let mut decoder =
            png::Decoder::new(std::io::BufReader::new(std::fs::File::open(folder.path("p.png")).unwrap()))
                .read_info()
                .unwrap();
        let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
        decoder.next_frame(&mut pixels).unwrap();
        let lit =
            |row: usize| pixels[300 * row..300 * (row + 1)].chunks(3).filter(|it| it.iter().any(|&c| c > 8)).count();
        assert_eq!(lit(15) < lit(80), head_is_up, "{name}: {} above, {} below", lit(15), lit(80));
    }
}

#[test]
fn a_ct_is_recognised_by_its_values_and_info_names_them() {
    // Air, a body of water with a bone.
    let value = |[x, y, z]: [i32; 3]| {
        let far = |at: i32| (x - at) * (x - at) + (y - 16) * (y - 16) + (z - 16) * (z - 16);
        if far(12) < 12 {
            24
        } else if far(16) < 150 {
            10 + u8::from((x + y + z) % 2 == 0)
        } else {
            0
        }
    };
    // A byte is a hundred units: the slope of MetaImage is not read, and so the values are written as int16.
    let bytes: Vec<u8> = nrrd([32, 32, 32], "", value);
    let voxels = bytes[bytes.len() - 32 * 32 * 32..].iter().flat_map(|&it| (i16::from(it) * 100 - 1000).to_le_bytes());
    let header = "NRRD0004\ntype: int16\ndimension: 3\nsizes: 32 32 32\nencoding: raw\nendian: little\n\n";
    let folder = Folder::new().with("ct.nrrd", header.bytes().chain(voxels).collect::<Vec<u8>>());
    let outcome = folder.done(&["render", "ct.nrrd", "--size", "8x8", "--save-scene", "ct.toml", "-o", "p.png"]);
    assert!(
        outcome.err.contains("a CT in Hounsfield units") && outcome.err.contains("bone from 220"),
        "{}",
        outcome.err
    );
    let info = folder.done(&["info", "ct.nrrd"]).out;
    for words in ["bone 250 to 3000", "percentile", "-1000", "1400"] {
        assert!(info.contains(words), "no {words}: {info}");
    }
    let json = folder.done(&["info", "ct.nrrd", "--json"]).json();
    assert_eq!(json["kind"], "ct");
    assert_eq!(json["percentiles"][0]["value"], -1000.0);
}

#[test]
fn no_two_of_twenty_labels_have_one_colour() {
    let value = |[x, y, z]: [i32; 3]| if (2..14).contains(&y) && (2..14).contains(&z) { x / 3 } else { 0 };
    let value = |at: [i32; 3]| u8::try_from(value(at)).unwrap();
    let folder = Folder::new().with("tissues.nrrd", nrrd([63, 16, 16], "", value));
    folder.done(&["render", "tissues.nrrd", "--size", "8x8", "-o", "p.png", "--save-scene", "s.toml"]);
    let text = std::fs::read_to_string(folder.path("s.toml")).unwrap();
    let codes: Vec<&str> =
        text.lines().filter_map(|line| line.strip_suffix(" in daylight")?.split(" # ").nth(1)).collect();
    let different: std::collections::BTreeSet<&str> = codes.iter().copied().collect();
    assert_eq!((codes.len(), different.len()), (20, 20), "{codes:?}");
}

#[test]
fn labels_have_colours_that_can_be_told_apart() {
    let value = |[x, y, z]: [i32; 3]| {
        if (4..28).contains(&y) && (4..28).contains(&z) { [0, 1, 5, 9][usize::try_from(x).unwrap() / 8] } else { 0 }
    };
    let folder = Folder::new().with("tissues.nrrd", nrrd([32, 32, 32], "", value));
    let outcome = folder.done(&["render", "tissues.nrrd", "--size", "64x64", "-o", "p.png", "--save-scene", "s.toml"]);
    assert!(outcome.err.contains("a segmentation with 3 labels"), "{}", outcome.err);
    let text = std::fs::read_to_string(folder.path("s.toml")).unwrap();
    assert!(
        ["label_1", "label_5", "label_9"].iter().all(|name| text.contains(&format!("[materials.{name}."))),
        "{text}"
    );
    assert!(text.contains("are_labels = true") && !text.contains("interpolation"), "{text}");
    // Daylight makes up for what the combs leave out.
    let codes = |arguments: &[&str]| {
        folder.done(&[&["render", "s.toml", "--size", "64x64", "-o", "q.png"][..], arguments].concat());
        png(&folder.path("q.png")).1.iter().map(|&code| u64::from(code)).sum::<u64>()
    };
    let [by_dial, by_flag] = [codes(&[]), codes(&["--light", "day"])];
    assert_eq!(by_dial, by_flag, "the dial does not dim it");
    // Each light shows its own label alone, and daylight shows all.
    let lit = |light: &str| -> Vec<usize> {
        let size = ["render", "s.toml", "--size", "64x64", "-o", "q.png", "--light", light];
        folder.done(&[&size[..], &["-D", "accuracy.rays=1", "--background", "#000000"]].concat());
        let (_, pixels) = png(&folder.path("q.png"));
        let bright = pixels.chunks_exact(3).enumerate().filter(|(_, it)| it.iter().any(|&code| code > 8));
        bright.map(|(at, _)| at % 64).collect()
    };
    let [one, five, nine] = ["for_label_1", "for_label_5", "for_label_9"].map(lit);
    let day = lit("day");
    assert!([&one, &five, &nine].iter().all(|it| it.len() > 100), "{} {} {}", one.len(), five.len(), nine.len());
    // They lie from left to right.
    let ends = |columns: &[usize]| [*columns.iter().min().unwrap(), *columns.iter().max().unwrap()];
    let [one, five, nine, day] = [one, five, nine, day].map(|columns| ends(&columns));
    assert!(
        one[1] < five[1] && five[1] < nine[1] && one[0] < five[0] && five[0] < nine[0],
        "{one:?} {five:?} {nine:?}"
    );
    assert_eq!(day, [one[0], nine[1]], "all of them");
}

/// A MetaImage with the values of a CT, a body with a bone in air, whose header has the line `more`.
fn ct(more: &str) -> Vec<u8> {
    let stored = |index: i32| {
        let [x, y, z] = [index % 24 - 12, index / 24 % 24 - 12, index / 576 - 12];
        match x * x + y * y + z * z {
            0..9 => 1200_i16,
            9..81 => 20 + i16::try_from(index % 7).unwrap(),
            _ => -1000,
        }
    };
    let header = format!(
        "ObjectType = Image\nNDims = 3\nDimSize = 24 24 24\nElementType = MET_SHORT\n{more}ElementDataFile = LOCAL\n"
    );
    header.into_bytes().into_iter().chain((0..24 * 24 * 24).flat_map(|index| stored(index).to_le_bytes())).collect()
}

#[test]
fn what_a_body_lies_on_becomes_air_also_inside_its_box() {
    // A rod beside a ball, within the box of the ball.
    let scan = |has_rest: bool| {
        let stored = |index: i32| {
            let [x, y, z] = [index % 40, index / 40 % 40, index / 1600].map(|at| at - 20);
            match x * x + y * y + z * z {
                0..40 => 1200_i16,
                40..150 => 20 + i16::try_from(index % 7).unwrap(),
                150..196 => -250,
                _ if has_rest && (-15..=-13).contains(&x) && (-15..=-13).contains(&y) && z.abs() < 15 => 300,
                // The surface shares its voxels with air.
                _ if has_rest && (-16..=-12).contains(&x) && (-16..=-12).contains(&y) && z.abs() < 16 => -370,
                _ => -1000,
            }
        };
        let header = "NRRD0004\ntype: int16\ndimension: 3\nsizes: 40 40 40\nencoding: raw\nendian: little\n\n";
        header.bytes().chain((0..40 * 40 * 40).flat_map(|index| stored(index).to_le_bytes())).collect::<Vec<u8>>()
    };
    let folder = Folder::new().with("rest.nrrd", scan(true)).with("alone.nrrd", scan(false));
    let render = |more: &[&str], picture: &str| {
        let outcome = folder.done(&[&["render", "--size", "60x60", "-o", picture], more].concat());
        (outcome.err, std::fs::read(folder.path(picture)).unwrap())
    };
    let (said, shown) = render(&["rest.nrrd", "--save-scene", "rest.toml"], "rest.png");
    assert!(said.contains("; only the largest connected part is shown."), "{said}");
    let text = std::fs::read_to_string(folder.path("rest.toml")).unwrap();
    assert!(text.contains("\nlargest_part_above = -380.0\n") && !text.contains("[crop]"), "{text}");
    assert!(render(&["rest.toml"], "saved.png").1 == shown, "the saved scene shows the same");
    assert!(render(&["rest.toml", "--volume", "alone.nrrd"], "alone.png").1 == shown, "the rest is air");
    std::fs::write(folder.path("whole.toml"), text.replace("largest_part_above", "# largest_part_above")).unwrap();
    assert!(render(&["whole.toml"], "whole.png").1 != shown, "the rest would be visible");
    let (said, _) = render(&["alone.nrrd"], "first.png");
    assert!(!said.contains("connected"), "{said}");
    // A choice of specks is none of the table.
    let (said, _) = render(&["rest.nrrd", "-D", "volume.without_specks={above=-300,voxels=5}"], "specks.png");
    assert!(said.contains("; only the largest connected part is shown."), "{said}");
    // A definition decides, and the saved scene has it.
    for value in ["-2000", "200"] {
        let definition = format!("volume.largest_part_above={value}");
        let (said, shown) = render(&["rest.nrrd", "-D", &definition, "--save-scene", "own.toml"], "own.png");
        assert!(!said.contains("connected"), "{said}");
        assert!(render(&["own.toml"], "again.png").1 == shown, "{value}");
        std::fs::remove_file(folder.path("own.toml")).unwrap();
    }
    for (value, words) in [
        ("1200", &["no voxel is above 1200", "the largest value is 1200", "write a smaller value"][..]),
        ("nan", &["volume.largest_part_above = NaN", "a finite number"]),
        ("\"bone\"", &["largest_part_above"]),
    ] {
        let definition = format!("volume.largest_part_above={value}");
        folder.refused(2, &["render", "whole.toml", "-o", "q.png", "-D", &definition], words);
    }
}

#[test]
fn the_table_of_a_patient_becomes_air_in_values_without_a_unit_too() {
    // A body from end to end of the stack, in front of a plate (y to the back), with a bone as far from the middle.
    let scan = |space: &str, at: i32| {
        let header = format!("space: {space}\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nspace origin: (0,0,0)\n");
        nrrd([40, 48, 32], &header, move |[x, y, z]| match ((x - 20).pow(2) + (y - 20).pow(2), y - at) {
            (0..20, _) => 220,
            (20..160, _) => 110 + u8::try_from((x + 2 * y + 3 * z).rem_euclid(60)).unwrap(),
            (_, 0..2) if (6..34).contains(&x) => 190,
            _ => 0,
        })
    };
    let patient = "left-posterior-superior";
    let folder = Folder::new()
        .with("patient.nrrd", scan(patient, 40))
        // A plate in front of the body; no patient; and no plate.
        .with("front.nrrd", scan(patient, 3))
        .with("part.nrrd", scan("3D-right-handed", 40))
        .with("alone.nrrd", scan(patient, 60));
    for (name, is_removed) in [("patient", true), ("front", false), ("part", false), ("alone", false)] {
        let [volume, scene] = ["nrrd", "toml"].map(|ending| format!("{name}.{ending}"));
        let said = folder.done(&["render", &volume, "--size", "60x60", "-o", "p.png", "--save-scene", &scene]).err;
        assert_eq!(said.contains("; only the largest connected part is shown."), is_removed, "{name}: {said}");
        let text = std::fs::read_to_string(folder.path(&scene)).unwrap();
        assert_eq!(text.contains("\nlargest_part_above = "), is_removed, "{name}: {text}");
    }
}

#[test]
fn specks_of_layers_are_left_out_and_grains_are_not() {
    // A ball with a bubble, in which is a nodule; beside it a small cube and a larger one, or many small ones.
    let scan = |side: i32, grains: bool| {
        nrrd([48, 40, 40], "", move |[x, y, z]| {
            let from = |centre: [i32; 3]| (x - centre[0]).pow(2) + (y - centre[1]).pow(2) + (z - centre[2]).pow(2);
            let within =
                |low: [i32; 3], side: i32| [x, y, z].iter().zip(low).all(|(at, low)| (low..low + side).contains(at));
            match from([18, 20, 20]) {
                0..2 => 210,
                2..20 => 8,
                20..170 => 120 + u8::try_from((x + 2 * y + 3 * z).rem_euclid(60)).unwrap(),
                _ if within([41, 4, 4], side) || within([40, 30, 30], 5) => 200,
                _ if grains && x > 34 && [x, y, z].iter().all(|at| at % 4 < 2) => 190,
                _ => u8::try_from((x + y + z) % 5).unwrap(),
            }
        })
    };
    let folder = Folder::new()
        .with("speck.nrrd", scan(3, false))
        .with("none.nrrd", scan(0, false))
        .with("grains.nrrd", scan(3, true));
    let render = |more: &[&str], picture: &str| {
        let outcome = folder.done(&[&["render", "--size", "60x60", "-o", picture], more].concat());
        (outcome.err, std::fs::read(folder.path(picture)).unwrap())
    };
    let (said, shown) = render(&["speck.nrrd", "--save-scene", "speck.toml"], "speck.png");
    assert!(said.contains("; connected parts of fewer than 50 voxels are left out."), "{said}");
    let text = std::fs::read_to_string(folder.path("speck.toml")).unwrap();
    assert!(text.contains("\nwithout_specks = { above = ") && text.contains(", voxels = 50 }\n"), "{text}");
    assert!(render(&["speck.toml"], "saved.png").1 == shown, "the saved scene shows the same");
    assert!(render(&["speck.toml", "--volume", "none.nrrd"], "none.png").1 == shown, "the speck alone is air");
    std::fs::write(folder.path("whole.toml"), text.replace("without_specks", "# without_specks")).unwrap();
    assert!(render(&["whole.toml"], "whole.png").1 != shown, "the speck would be visible");
    // A definition decides, and the saved scene has it.
    let all = "volume.without_specks={above=50,voxels=0}";
    let (said, _) = render(&["speck.nrrd", "-D", all, "--save-scene", "own.toml"], "own.png");
    assert!(!said.contains("connected parts"), "{said}");
    assert!(std::fs::read_to_string(folder.path("own.toml")).unwrap().contains("voxels = 0"));
    for more in [&["none.nrrd"][..], &["grains.nrrd"], &["speck.nrrd", "--look", "tissue"]] {
        assert!(!render(more, "other.png").0.contains("connected parts"), "{more:?}");
    }
    for (value, words) in [
        ("{above=nan,voxels=50}", &["volume.without_specks: above = NaN", "a finite number"][..]),
        ("{above=1,voxels=-1}", &["without_specks"]),
        ("50", &["without_specks=50", "a table of `above` and `voxels`"]),
        ("{above=1}", &["voxels"]),
    ] {
        let definition = format!("volume.without_specks={value}");
        folder.refused(2, &["render", "whole.toml", "-o", "q.png", "-D", &definition], words);
    }
}

#[test]
fn info_says_what_the_first_look_shows() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let said = folder.done(&["render", "ball.nrrd", "--size", "8x8", "-o", "p.png"]).err;
    let info = folder.done(&["info", "ball.nrrd"]).out;
    let line = info.lines().find_map(|line| line.strip_prefix("  first look ")).unwrap_or_else(|| panic!("{info}"));
    assert!(line.contains("shown as ") && said.contains(&format!("Relume made one: {line}.")), "{line}, {said}");
    assert_eq!(folder.done(&["info", "ball.nrrd", "--json"]).json()["first_look"], line);
}

#[test]
fn a_row_without_targets_is_told() {
    let palette = |cells: &str| {
        format!("version = 1\n[lights.day]\nspectrum = \"D65\"\n[materials.bone]\n[materials.flesh]\n{cells}")
    };
    let folder = Folder::new()
        .with("all.toml", palette("[cells]\nbone = { day = \"black\" }\nflesh = { day = \"as bone\" }\n"))
        .with("some.toml", palette("[cells]\nbone = { day = \"black\" }\n"));
    assert_eq!(folder.done(&["design", "all.toml"]).err, "");
    let said = folder.done(&["design", "some.toml"]).err;
    assert!(said.contains("no cell has a target for flesh"), "{said}");
}

#[test]
fn both_feet_are_shown_and_a_ct_without_tissue_opens() {
    let stored = |of: &dyn Fn([i32; 3]) -> i16| -> Vec<u8> {
        let header = "ObjectType = Image\nNDims = 3\nModality = MET_MOD_CT\nDimSize = 40 40 40\nElementType = MET_SHORT\n\
                      ElementDataFile = LOCAL\n";
        let voxel = |index: i32| of([index % 40, index / 40 % 40, index / 1600].map(|at| at - 20)).to_le_bytes();
        header.bytes().chain((0..40 * 40 * 40).flat_map(voxel)).collect()
    };
    let ball = |x: i32, [at, y, z]: [i32; 3], inside: [i16; 2]| match (at - x).pow(2) + y * y + z * z {
        0..20 => inside[0],
        20..64 => inside[1],
        _ => -1000,
    };
    let feet = |at: [i32; 3]| ball(-10, at, [900, 40]).max(ball(10, at, [900, 50]));
    let folder = Folder::new().with("feet.mha", stored(&feet)).with("air.mha", stored(&|at| ball(0, at, [-600, -700])));
    for name in ["feet.mha", "air.mha"] {
        let said = folder.done(&["render", name, "--size", "40x40", "-o", "p.png"]).err;
        assert!(said.contains("a CT in Hounsfield units") && !said.contains("connected"), "{said}");
    }
}

#[test]
fn the_modality_of_a_file_decides_whether_it_is_a_ct() {
    for (modality, words) in [
        ("", "a CT in Hounsfield units"),
        ("Modality = MET_MOD_CT\n", "a CT in Hounsfield units"),
        ("Modality = MET_MOD_MR\n", "an MR scan, whose values have no known unit"),
    ] {
        let folder = Folder::new().with("v.mha", ct(modality));
        let err = folder.done(&["render", "v.mha", "--size", "8x8", "-o", "p.png"]).err;
        assert!(err.contains(words), "{modality}: {err}");
    }
}

#[test]
fn a_look_may_be_a_transfer_preset_of_the_window() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let words = ["the look lung is for CT", "0 to 220", "mr-t1"];
    folder.refused(2, &["render", "ball.nrrd", "--look", "lung", "-o", "p.png"], &words);
    let mut seen = std::collections::BTreeSet::new();
    for (look, name) in
        [("mr", "MR"), ("mr-t1", "MR: T1"), ("mr-t2", "MR: T2"), ("micro-ct", "micro-CT"), ("haze", "fluorescence")]
    {
        let arguments =
            ["render", "ball.nrrd", "--size", "24x24", "--look", look, "-o", "p.png", "--save-scene", "s.toml"];
        folder.done(&arguments);
        let text = std::fs::read_to_string(folder.path("s.toml")).unwrap();
        assert!(text.contains(&format!("the transfer preset {name:?}")), "{look}: {text}");
        seen.insert(std::fs::read(folder.path("p.png")).unwrap());
    }
    assert!(seen.len() >= 4, "they differ");
    let folder = Folder::new().with("ct.mha", ct(""));
    for look in ["lung", "skin", "soft-tissue", "ct-bone", "ct-vessels"] {
        folder.done(&["render", "ct.mha", "--size", "8x8", "--look", look, "-o", "p.png"]);
    }
}

/// Voxels along each side of a head.
const HEAD: usize = 24;

/// A head with an ear at the left of the patient, in voxels that run to the left, to the back and to the top.
fn head() -> Vec<u16> {
    let value = |index: usize| {
        let [x, y, z] = [index % HEAD, index / HEAD % HEAD, index / HEAD / HEAD].map(|it| i32::try_from(it).unwrap());
        let far = (x - 11).pow(2) + (y - 12).pow(2) + (z - 12).pow(2);
        let ear = (x - 21).pow(2) + (y - 12).pow(2) + (z - 10).pow(2);
        if far < 64 || ear < 5 { 900 } else { u16::try_from(index % 7).unwrap() }
    };
    (0..HEAD.pow(3)).map(value).collect()
}

/// The head as `NIfTI`: rows of the sform to the right, to the front and to the top, for spacings 2, 2 and 3 mm.
fn head_in_nifti() -> Vec<u8> {
    let mut bytes = vec![0_u8; 352];
    bytes[..4].copy_from_slice(&348_i32.to_le_bytes());
    let side = i16::try_from(HEAD).unwrap();
    for (at, value) in
        [(40, 3), (42, side), (44, side), (46, side), (48, 1), (50, 1), (52, 1), (54, 1), (70, 512), (72, 16), (254, 1)]
    {
        bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
    }
    bytes[108..112].copy_from_slice(&352.0_f32.to_le_bytes());
    bytes[123] = 2;
    // x grows to the left, which is −R, and y to the back, which is −A; voxel 0 lies at −10, −20, 5 in RAS.
    for (at, value) in [(280, -2.0_f32), (292, -10.0), (300, -2.0), (308, -20.0), (320, 3.0), (324, 5.0)] {
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
    }
    bytes[344..348].copy_from_slice(b"n+1\0");
    bytes.extend(head().iter().flat_map(|value| value.to_le_bytes()));
    bytes
}

/// The head as slices of DICOM, with names in no order of their positions.
fn head_in_dicom(folder: &Folder) {
    use crate::support::dicom::{EXPLICIT, Value, file, slice};
    std::fs::create_dir(folder.path("head")).unwrap();
    for (z, pixels) in head().chunks(HEAD * HEAD).enumerate() {
        // To the left is +x, to the back is +y: voxel 0 lies at 10, 20, 5 in LPS.
        let height = 5 + 3 * z;
        let side = u16::try_from(HEAD).unwrap();
        let one = slice(0.0, 0)
            .text(0x0020_0032, "DS", &format!("10\\20\\{height}"))
            .text(0x0028_0030, "DS", "2\\2")
            .short(0x0028_0010, &[side])
            .short(0x0028_0011, &[side])
            .with(0x7fe0_0010, "OW", Value::Short(pixels.to_vec()));
        let name = format!("head/{:02}", z * 7 % HEAD);
        std::fs::write(folder.path(&name), file(&one, EXPLICIT)).unwrap();
    }
}

#[test]
fn nifti_and_dicom_of_one_head_give_the_same_picture() {
    let folder = Folder::new().with("head.nii", head_in_nifti());
    head_in_dicom(&folder);
    for (name, picture) in [("head.nii", "n.png"), ("head", "d.png")] {
        folder.done(&["render", name, "--size", "64x64", "-o", picture, "--background", "#000000"]);
    }
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert!(bytes("n.png") == bytes("d.png"), "the two pictures differ");
    // Seen from the front, the left of the patient is on the right.
    let file = std::io::BufReader::new(std::fs::File::open(folder.path("d.png")).unwrap());
    let mut reader = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut pixels).unwrap();
    let samples = pixels.len() / 64 / 64;
    assert_eq!((frame.width, frame.height), (64, 64));
    let lit = |column: usize| {
        (0..64)
            .filter(|row| pixels[(row * 64 + column) * samples..][..samples.min(3)].iter().any(|&it| it > 20))
            .count()
    };
    let columns: Vec<usize> = (0..64).filter(|&column| lit(column) > 0).collect();
    let [first, last] = [columns[0], columns[columns.len() - 1]];
    // The ear is a narrow part at one end; the head begins wide at the other.
    assert!(
        lit(last - 1) < 16 && lit(first + 6) > lit(last - 6),
        "from {first}, {last}: {:?}",
        (first..=last).map(lit).collect::<Vec<_>>()
    );
}

#[test]
fn the_light_of_a_layer_leaves_the_solid_one_black() {
    let folder = Folder::new().with("ball.nrrd", ball());
    folder.done(&["render", "ball.nrrd", "--size", "64x64", "-o", "a.png", "--accumulators", "film.exr"]);
    let brightest = |light: &str| {
        folder.done(&["relight", "film.exr", "--light", light, "--background", "#000000", "-o", "b.png"]);
        let (samples, pixels) = png(&folder.path("b.png"));
        // The core lies in the middle of the ball.
        pixels.chunks_exact(samples).map(|pixel| pixel.iter().copied().max().unwrap_or(0)).max()
    };
    let json = folder.done(&["info", "film.exr", "--json"]).json();
    let components = json["components"].to_string();
    assert!(!components.contains("white"), "highlights would shine under every light: {components}");
    assert!(brightest("for_faint") > Some(20), "the shell is seen by its own light");
    let alone =
        ["render", "ball.nrrd", "--look", "bone", "--size", "64x64", "-o", "c.png", "--accumulators", "alone.exr"];
    folder.done(&alone);
    let json = folder.done(&["info", "alone.exr", "--json"]).json();
    assert!(json["components"].to_string().contains("white"), "one material alone has highlights: {json}");
}

#[test]
fn a_ramp_of_few_values_is_no_segmentation() {
    let stored = |index: usize| u16::try_from(index % 50 * 1311).unwrap().to_le_bytes();
    let ramp = nrrd_of("uint16", &[50, 20, 20], "", (0..50 * 20 * 20).flat_map(stored));
    let folder = Folder::new().with("ramp.nrrd", ramp);
    let told = folder.done(&["render", "ramp.nrrd", "--size", "8x8", "-o", "p.png"]).err;
    assert!(!told.contains("segmentation"), "{told}");
}

#[test]
fn names_of_segments_are_those_of_the_materials() {
    use crate::support::dicom::{EXPLICIT, file, segmentation};
    let half = [0, 1, 1, 0, 1, 1, 0, 1, 1];
    let frames = [(1, 0.0, half), (1, 2.0, half), (2, 4.0, half)];
    let folder = Folder::new().with("seg.dcm", file(&segmentation("BINARY", &frames), EXPLICIT));
    let outcome = folder.done(&["render", "seg.dcm", "--size", "32x32", "-o", "p.png", "--save-scene", "s.toml"]);
    assert!(outcome.err.contains("a segmentation with 2 labels: liver, spleen"), "{}", outcome.err);
    let text = std::fs::read_to_string(folder.path("s.toml")).unwrap();
    for words in ["[materials.liver.", "[materials.spleen.", "[lights.for_spleen]", "[labels.2]"] {
        assert!(text.contains(words), "no {words} in {text}");
    }
    // The saved scene is read like any other.
    folder.done(&["render", "s.toml", "--size", "32x32", "-o", "q.png", "--volume", "seg.dcm"]);
}

#[test]
fn a_channel_is_shown_in_its_colour() {
    let omero = "{\"multiscales\": [{\"axes\": [\"z\", \"y\", \"x\"], \"datasets\": [{\"path\": \"0\"}]}], \"omero\": {\"channels\": \
                 [{\"label\": \"GFP\", \"color\": \"00FF20\", \"window\": {\"start\": 20, \"end\": 200}}]}}";
    let array = "{\"zarr_format\": 2, \"shape\": [16, 16, 16], \"chunks\": [16, 16, 16], \"dtype\": \"|u1\", \"compressor\": null, \
                 \"fill_value\": 0, \"order\": \"C\", \"filters\": null}";
    let folder = Folder::new();
    std::fs::create_dir_all(folder.path("cells.zarr/0")).unwrap();
    let value = |index: usize| u8::try_from(index % 16 * 15).unwrap();
    let folder = folder
        .with("cells.zarr/.zgroup", "{\"zarr_format\": 2}")
        .with("cells.zarr/.zattrs", omero)
        .with("cells.zarr/0/.zarray", array)
        .with("cells.zarr/0/0.0.0", (0..4096).map(value).collect::<Vec<u8>>());
    let outcome = folder.done(&["render", "cells.zarr", "--size", "32x32", "-o", "p.png", "--save-scene", "s.toml"]);
    assert!(outcome.err.contains("shown in the colour of the channel, #00ff20"), "{}", outcome.err);
    let text = std::fs::read_to_string(folder.path("s.toml")).unwrap();
    assert!(text.contains("reflectance = { srgb = \"#00ff20\" }") && text.contains(", 0.0], [200.0,"), "{text}");
    let grey = folder.done(&["render", "cells.zarr", "--look", "grey", "--size", "32x32", "-o", "g.png"]);
    assert!(grey.err.contains("shown in grey"), "a look that is asked for: {}", grey.err);
}

#[test]
fn a_head_whose_slices_begin_at_the_top_is_turned_over() {
    // A ball of water with a bone at its middle, on a neck that the last slice cuts off.
    let value = |[x, y, z]: [i32; 3]| {
        let across = (x - 16) * (x - 16) + (y - 16) * (y - 16);
        let far = across + (z - 13) * (z - 13);
        if far < 20 {
            24
        } else if far < 110 || (across < 60 && z > 13) {
            10
        } else {
            0
        }
    };
    let bytes: Vec<u8> = nrrd([32, 32, 32], "", value);
    let voxels = bytes[bytes.len() - 32 * 32 * 32..].iter().flat_map(|&it| (i16::from(it) * 100 - 1000).to_le_bytes());
    let header = "NRRD0004\ntype: int16\ndimension: 3\nsizes: 32 32 32\nencoding: raw\nendian: little\n\n";
    let folder = Folder::new().with("head.nrrd", header.bytes().chain(voxels).collect::<Vec<u8>>());
    folder.done(&["render", "head.nrrd", "--size", "8x8", "--save-scene", "head.toml", "-o", "p.png"]);
    let text = std::fs::read_to_string(folder.path("head.toml")).unwrap();
    assert!(text.contains("up = [0.0, 0.0, -1.0]"), "{text}");
}

#[test]
fn a_skull_whose_crown_is_cut_off_at_the_lower_end_is_turned_over() {
    // From below: the crown, a bony shell around the brain, then a neck with a spine.
    let value = |[x, y, z]: [i32; 3]| {
        let across = (x - 16) * (x - 16) + (y - 16) * (y - 16);
        match z {
            ..20 if across < 100 => 10,
            ..20 if across < 140 => 24,
            20.. if across < 9 => 24,
            20.. if across < 60 => 10,
            _ => 0,
        }
    };
    let up = |flipped: bool| {
        let bytes: Vec<u8> = nrrd([32, 32, 32], "", |[x, y, z]| value([x, y, if flipped { 31 - z } else { z }]));
        let voxels = &bytes[bytes.len() - 32 * 32 * 32..];
        let voxels = voxels.iter().flat_map(|&it| (i16::from(it) * 100 - 1000).to_le_bytes());
        let header = "NRRD0004\ntype: int16\ndimension: 3\nsizes: 32 32 32\nencoding: raw\nendian: little\n\n";
        let folder = Folder::new().with("head.nrrd", header.bytes().chain(voxels).collect::<Vec<u8>>());
        folder.done(&["render", "head.nrrd", "--size", "8x8", "--save-scene", "head.toml", "-o", "p.png"]);
        let text = std::fs::read_to_string(folder.path("head.toml")).unwrap();
        text.lines().find(|line| line.starts_with("up = ")).unwrap().to_owned()
    };
    assert_eq!(up(false), "up = [0.0, 0.0, -1.0]");
    assert_eq!(up(true), "up = [0.0, 0.0, 1.0]");
}

/// The scene of a first look at 32³ voxels.
fn scene_of(value: impl Fn([i32; 3]) -> u8) -> toml::Table {
    let folder = Folder::new().with("v.nrrd", nrrd([32, 32, 32], "", value));
    folder.done(&["render", "v.nrrd", "--size", "8x8", "--save-scene", "s.toml", "-o", "p.png"]);
    std::fs::read_to_string(folder.path("s.toml")).unwrap().parse().unwrap()
}

#[test]
fn the_outer_layer_is_a_surface_around_a_ragged_core_and_glass_around_a_compact_one() {
    let far = |[x, y, z]: [i32; 3]| (x - 16) * (x - 16) + (y - 16) * (y - 16) + (z - 16) * (z - 16);
    let is_odd = |[x, y, z]: [i32; 3]| (x / 2 + y / 2 + z / 2) % 2 == 0;
    let outer = |core: &dyn Fn([i32; 3]) -> bool| {
        // Noise, so that the values are not labels.
        let noise = |[x, y, z]: [i32; 3]| u8::try_from((7 * x + 13 * y + 29 * z) % 9).unwrap();
        let scene = scene_of(|at| {
            let value = if core(at) {
                200
            } else if far(at) < 144 {
                100
            } else {
                0
            };
            value + noise(at)
        });
        scene["transfer"]["intervals"][0]["opacity"].as_float().unwrap()
    };
    let ragged = outer(&|at| far(at) < 90 && is_odd(at));
    let compact = outer(&|at| far(at) < 36);
    let surface = |depth: f64| -(-depth).exp_m1();
    assert!((ragged - surface(0.6)).abs() < 1e-3, "the most along a coarse voxel: {ragged}");
    assert!(compact < 0.06, "{compact}");
    // 22 along the edge of a cube with as many voxels as a ball of radius 30.
    let folder = Folder::new().with(
        "v.nrrd",
        nrrd([64, 64, 64], "", |[x, y, z]| {
            let at = [x / 2, y / 2, z / 2];
            let inner = if far(at) < 170 && is_odd([x, y, z]) { 200 } else { 100 };
            let noise = u8::try_from((7 * x + 13 * y + 29 * z) % 9).unwrap();
            noise + if (x - 32).pow(2) + (y - 32).pow(2) + (z - 32).pow(2) < 900 { inner } else { 0 }
        }),
    );
    folder.done(&["render", "v.nrrd", "--size", "8x8", "--save-scene", "s.toml", "-o", "p.png"]);
    let scene: toml::Table = std::fs::read_to_string(folder.path("s.toml")).unwrap().parse().unwrap();
    let found = scene["transfer"]["intervals"][0]["opacity"].as_float().unwrap();
    // Glass around a glowing volume.
    let glow = nrrd([8, 8, 8], "space origin: (28,28,28)\n", |[x, y, z]| u8::try_from(x * 20 + y + z).unwrap());
    let folder = folder.with("glow.nrrd", glow);
    folder.done(&["render", "v.nrrd", "glow.nrrd", "--size", "8x8", "--save-scene", "t.toml", "-o", "p.png"]);
    let both: toml::Table = std::fs::read_to_string(folder.path("t.toml")).unwrap().parse().unwrap();
    let through = both["transfer"]["intervals"][0]["opacity"].as_float().unwrap();
    assert!(((-through).ln_1p() / (-found).ln_1p() - 0.05).abs() < 1e-3, "{through} for {found}");
    let edge = (4.0 / 3.0 * std::f64::consts::PI * 30.0_f64.powi(3)).cbrt();
    assert!((found - surface(22.0 / edge)).abs() < 0.01, "{found} for {}", surface(22.0 / edge));
}

#[test]
fn a_shallow_object_is_seen_from_higher_up() {
    let elevation = |height: i32| {
        let scene = scene_of(|[x, y, z]| {
            u8::from((4..28).contains(&x) && (4..28).contains(&y) && (4..4 + height).contains(&z)) * 200
        });
        scene["camera"]["elevation"].as_float().unwrap()
    };
    assert!((elevation(16) - 20.0).abs() < 1e-9);
    assert!((elevation(8) - 45.0).abs() < 1e-9);
}

/// Samples per pixel, and the samples.
fn png(path: &std::path::Path) -> (usize, Vec<u8>) {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut decoder = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
    let info = decoder.next_frame(&mut pixels).unwrap();
    (info.color_type.samples(), pixels)
}

#[test]
fn a_picture_has_any_background_or_none() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let corner = |background: &str| {
        folder.done(&["render", "ball.nrrd", "--size", "32x32", "-o", "p.png", "--background", background]);
        let (samples, pixels) = png(&folder.path("p.png"));
        let middle = samples * (16 * 32 + 16);
        (pixels[..samples].to_vec(), pixels[middle..middle + samples].to_vec())
    };
    let (outside, inside) = corner("transparent");
    assert_eq!((outside.len(), outside[3]), (4, 0), "nothing is behind");
    assert!(inside[3] > 200, "{inside:?}");
    assert_eq!(corner("#20c0ff").0, [0x20, 0xc0, 0xff]);
    // A gradient from the top to the bottom row.
    let column = |from: &str| {
        corner(from);
        let (samples, rgb) = png(&folder.path("p.png"));
        [0, 16, 31].map(|y| rgb[samples * 32 * y..][..3].to_vec())
    };
    let [top, middle, bottom] = column("#20c0ff..#000000");
    assert_eq!((top, bottom), (vec![0x20, 0xc0, 0xff], vec![0, 0, 0]));
    // Square roots of linear light change evenly.
    let expected = [0x20_u8, 0xc0, 0xff].map(|code| {
        let root = decode_srgb(f64::from(code) / 255.0).sqrt() * 15.0 / 31.0;
        255.0 * encode_srgb(root * root)
    });
    assert!(middle.iter().zip(expected).all(|(&code, part)| (f64::from(code) - part).abs() <= 1.0), "{middle:?}");
    for wrong in ["white", "#fffffg", "#ffffff..", "..#ffffff", "#ffffff..#00"] {
        let words = ["#ffffff", "#202838..#000000"];
        folder.refused(2, &["render", "ball.nrrd", "-o", "p.png", "--background", wrong], &words);
    }
}

/// Names of materials are whole numbers of at most seven digits.
#[test]
fn volumes_of_odd_numbers_open_without_being_taken_for_labels() {
    let blocks = |values: [i32; 2]| {
        let voxel = |place: usize| if place % 16 < 8 { values[0] } else { values[1] };
        (0..16 * 16 * 16).flat_map(|place| voxel(place).to_le_bytes()).collect::<Vec<u8>>()
    };
    let header = "NRRD0004\ntype: int32\ndimension: 3\nsizes: 16 16 16\nencoding: raw\nendian: little\n\n";
    let file = |values| header.bytes().chain(blocks(values)).collect::<Vec<u8>>();
    let folder = Folder::new().with("large.nrrd", file([10_000_001, 10_000_002])).with("small.nrrd", file([0, 7]));
    folder.done(&["render", "large.nrrd", "--size", "8x8", "-o", "p.png"]);
    let labels = folder.done(&["render", "small.nrrd", "--size", "8x8", "-o", "p.png"]);
    assert!(labels.err.contains("a segmentation with 1 label"), "{}", labels.err);
}

#[test]
fn a_definition_of_the_grid_is_seen_by_the_first_look() {
    let header = |spacings: &str| {
        format!("NRRD0004\ntype: uint8\ndimension: 3\nsizes: 12 10 8\n{spacings}encoding: raw\n\n").into_bytes()
    };
    let ball = |index: i32| {
        let [x, y, z] = [index % 12 - 6, index / 12 % 10 - 5, index / 120 - 4];
        u8::try_from(200 - 5 * (x * x + y * y + z * z)).unwrap_or(0)
    };
    let voxels: Vec<u8> = (0..12 * 10 * 8).map(ball).collect();
    let folder = Folder::new()
        .with("flat.nrrd", [header(""), voxels.clone()].concat())
        .with("tall.nrrd", [header("spacings: 1 1 3\n"), voxels].concat());
    let picture = |arguments: &[&str]| {
        folder.done(&[&["render", "--size", "24x24", "-o", "p.png"], arguments].concat());
        std::fs::read(folder.path("p.png")).unwrap()
    };
    assert_eq!(picture(&["flat.nrrd", "-D", "volume.spacing=[1, 1, 3]"]), picture(&["tall.nrrd"]));
    let halved = picture(&["flat.nrrd", "--downsample", "2x2x2"]);
    assert_eq!(picture(&["flat.nrrd", "-D", "volume.downsample=[2, 2, 2]"]), halved);
    assert_ne!(picture(&["flat.nrrd"]), halved);
    folder.refused(2, &["render", "flat.nrrd", "-o", "q.png", "-D", "volume.spacing=[1, 0, 1]"], &["volume.spacing"]);
}

#[test]
fn labels_beside_a_volume_without_a_scene_are_shown_by_name() {
    let header =
        |kind: &str| format!("NRRD0004\ntype: {kind}\ndimension: 3\nsizes: 12 12 12\nencoding: raw\n{kind}:=x\n\n");
    let inside = |index: usize, radius: usize| {
        [index % 12, index / 12 % 12, index / 144].iter().all(|at| at.abs_diff(6) < radius)
    };
    let values: Vec<u8> = (0..12 * 12 * 12).map(|index| if inside(index, 5) { 180 } else { 0 }).collect();
    let labels: Vec<u8> = (0..12 * 12 * 12).map(|index| if inside(index, 3) { 7 } else { 0 }).collect();
    let segments = "Segment0_LabelValue:=7\nSegment0_Name:=the \"core\"\nSegment0_Color:=1 0 0\n\n";
    let named = header("uint8").trim_end().to_owned() + "\n" + segments;
    let folder = Folder::new()
        .with("v.nrrd", [header("uint8").into_bytes(), values].concat())
        .with("l.seg.nrrd", [named.into_bytes(), labels].concat());
    let arguments = ["render", "v.nrrd", "--labels", "l.seg.nrrd", "--size", "16x16", "--save-scene", "s.toml", "-o"];
    let err = folder.done(&[&arguments[..], &["p.png"]].concat()).err;
    assert!(!err.contains("not used") && err.contains("Voxels with a label are shown as materials"), "{err}");
    let none = header("uint8").into_bytes().into_iter().chain([0; 12 * 12 * 12]).collect::<Vec<u8>>();
    let folder = folder.with("none.nrrd", none);
    let err = folder.done(&["render", "v.nrrd", "--labels", "none.nrrd", "--size", "8x8", "-o", "none.png"]).err;
    assert!(err.contains("The labels are not used"), "{err}");
    let scene = std::fs::read_to_string(folder.path("s.toml")).unwrap();
    assert!(scene.contains("[labels.7]") && scene.contains("#ff0000") && scene.contains("the \"core\""), "{scene}");
    folder.done(&["render", "v.nrrd", "--size", "16x16", "-o", "q.png"]);
    assert_ne!(std::fs::read(folder.path("p.png")).unwrap(), std::fs::read(folder.path("q.png")).unwrap());
    folder.done(&["render", "s.toml", "--size", "16x16", "-o", "again.png"]);
    assert_eq!(std::fs::read(folder.path("p.png")).unwrap(), std::fs::read(folder.path("again.png")).unwrap());
}

/// Sums of the codes of the left and the right half of a picture.
fn halves(path: &std::path::Path) -> [f64; 2] {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut decoder = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
    let width = usize::try_from(decoder.next_frame(&mut pixels).unwrap().width).unwrap();
    let mut sums = [0.0; 2];
    for (at, pixel) in pixels.chunks_exact(3).enumerate() {
        sums[usize::from(at % width >= width / 2)] += pixel.iter().copied().map(f64::from).sum::<f64>();
    }
    sums
}

#[test]
fn the_lights_of_a_first_look_are_three_point_lights_that_follow_the_camera() {
    let folder = Folder::new().with("ball.nrrd", ball());
    for look in [&[][..], &["--look", "grey"]] {
        let saved = ["render", "ball.nrrd", "--size", "40x40", "-o", "a.png", "--save-scene", "a.toml"];
        folder.done(&[&saved[..], look].concat());
        let json = folder.done(&["info", "a.toml", "--json"]).json();
        folder.done(&["render", "a.toml", "--size", "40x40", "-o", "a.png", "--accumulators", "film.exr"]);
        folder.done(&["relight", "film.exr", "-o", "again.png"]);
        // The host displays it in f64, the device in f32.
        let [one, other] = ["a.png", "again.png"].map(|name| codes(&folder.path(name)));
        let apart = one.iter().zip(&other).map(|(one, other)| one.abs_diff(*other)).max();
        assert!(apart <= Some(1), "{look:?}: {apart:?} relit from its film");
        let lights = json["lights"].as_array().unwrap();
        assert!(lights.iter().all(|light| light["kind"] == "three_point"), "{lights:?}");
        assert_eq!(json["plan"]["positions"].as_array().unwrap().len(), 1, "one accumulator: {}", json["plan"]);
        // A ball has its left side towards the key, wherever the camera is.
        let sides = [0, 120, 240].map(|azimuth| {
            let turned = format!("camera.azimuth={azimuth}");
            folder.done(&["render", "a.toml", "--size", "40x40", "-o", "b.png", "-D", &turned]);
            halves(&folder.path("b.png"))
        });
        let ratios = sides.map(|[left, right]| left / right);
        for ratio in ratios {
            assert!(ratio > 1.03 && (ratio / ratios[0] - 1.0).abs() < 0.03, "{look:?}: {ratios:?}");
        }
    }
}

#[test]
fn a_saved_scene_names_a_volume_below_it_so_that_the_folder_can_be_moved() {
    let folder = Folder::new();
    for name in ["study", "study/scans", "elsewhere"] {
        std::fs::create_dir(folder.path(name)).unwrap();
    }
    let folder = folder.with("study/scans/ball.nrrd", ball()).with("elsewhere/ball.nrrd", ball());
    let saved = |volume: &str, scene: &str| {
        let scene_file = ["--save-scene", scene, "-o", "p.png", "--size", "16x16"];
        folder.done(&[&["render", volume][..], &scene_file].concat());
        let text = std::fs::read_to_string(folder.path(scene)).unwrap();
        let of = |key: &str| text.lines().find(|line| line.starts_with(key)).map(str::to_owned);
        (of("file = ").unwrap(), of("base = "))
    };
    let below = saved("study/scans/ball.nrrd", "study/scan.toml");
    assert_eq!(below, ("file = \"scans/ball.nrrd\"".to_owned(), None));
    assert_eq!(saved("elsewhere/ball.nrrd", "elsewhere/scan.toml").0, "file = \"ball.nrrd\"");
    let other = saved("elsewhere/ball.nrrd", "study/other.toml").0;
    assert!(other.contains(&*folder.path("elsewhere").to_string_lossy()), "absolute: {other}");
    std::fs::rename(folder.path("study"), folder.path("moved")).unwrap();
    folder.done(&["render", "moved/scan.toml", "--size", "16x16", "-o", "q.png"]);
    assert_eq!(std::fs::read(folder.path("q.png")).unwrap(), {
        folder.done(&["render", "moved/scans/ball.nrrd", "--size", "16x16", "-o", "p.png"]);
        std::fs::read(folder.path("p.png")).unwrap()
    });
}

#[test]
fn files_of_another_command_are_told_theirs() {
    let folder = Folder::new().with("ball.nrrd", ball()).with("notes", "apples: 3\npears: 4\n");
    folder.done(&[&RENDER[..], &["--accumulators", "film.exr"]].concat());
    folder.refused(1, &["render", "film.exr", "-o", "q.png"], &["film.exr", "relume relight film.exr -o picture.png"]);
    for (file, words) in [("scene.toml", "relume render scene.toml"), ("ball.nrrd", "relume render ball.nrrd")] {
        folder.refused(1, &["relight", file, "-o", "q.png"], &[words, "--accumulators"]);
    }
    for (flag, value) in [("--sweep", "key..fill"), ("--dial", "-0.5,0.2")] {
        let way = format!("relume relight film.exr {flag} {value} -o FILE");
        folder.refused(2, &[&RENDER[..], &[flag, value]].concat(), &[flag, "--accumulators film.exr", &way]);
    }
    folder.refused(2, &[&RENDER[..], &["--loop"]].concat(), &["relume relight film.exr --loop -o FILE"]);
    let neither =
        folder.refused(1, &["render", "notes", "-o", "q.png"], &["notes", "neither a volume nor a scene"]).err;
    assert!(neither.contains("NRRD") && neither.contains("--dims"), "what is read, and the way out: {neither}");
    // Text of a scene keeps the message about its mistake.
    let odd = folder.with("odd", "version = 1\nlighting = \"none\"\n");
    odd.refused(1, &["render", "odd", "-o", "q.png"], &["odd:2", "`two_sided`"]);
}

#[test]
fn the_working_directory_is_a_volume_or_told_to_be_none() {
    let folder = Folder::new();
    for command in [&["render", "."][..], &["render", "--volume", "."], &["render", ".", "-o", "p.png"]] {
        folder.refused(1, command, &["this is a folder with", "none of which Relume reads"]);
    }
}

#[test]
fn a_folder_of_volumes_names_them() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("scans")).unwrap();
    let folder = folder.with("scans/a.nhdr", "NRRD0004\n").with("scans/b.nii.gz", [0; 4]).with("scans/notes.txt", "");
    for command in [&["info", "scans"][..], &["render", "scans", "-o", "p.png"]] {
        let err = folder.refused(1, command, &["open one of them", "scans/a.nhdr, scans/b.nii.gz"]).err;
        assert!(!err.contains("notes.txt"), "{err}");
    }
}

#[test]
fn films_that_are_not_written_are_made_by_a_command() {
    let folder = Folder::new();
    let turn = ["render", "scene.toml", "--size", "8x8", "--turntable", "4", "--fps", "12", "-o"];
    for film in ["turn.mp4", "turn.gif", "turn.webm"] {
        let ffmpeg = "ffmpeg -framerate 12 -i \"turn-%04d.png\"";
        let err = folder.refused(2, &[&turn[..], &[film]].concat(), &["-o turn.apng", "-o turn.png", ffmpeg]).err;
        assert!(err.contains(&format!("\"{film}\"")), "{err}");
    }
    folder.refused(2, &["render", "scene.toml", "-o", "p.mp4"], &["-o p.apng", "ffmpeg"]);
}

#[test]
fn a_light_with_a_direction_is_told_the_kind_that_it_needs() {
    let scene = SCENE.replace("kind = \"ambient\"\n", "");
    let folder = Folder::new().with("scene.toml", scene);
    let define = |text: &'static str| [&RENDER[..], &["-D", text]].concat();
    let words = ["lights.lamp", "`direction`", "headlight (the default)", "kind = \"directional\""];
    folder.refused(2, &define("lights.lamp.direction=[0, 0, 1]"), &words);
    folder.refused(2, &define("lights.lamp.position=[0, 0, 1]"), &["`position`", "kind = \"point\""]);
    folder.refused(2, &define("lights.lamp.kind=point"), &["point light without a `position`", "[10, 20, 30]"]);
    folder.refused(2, &define("lights.lamp.kind=directional"), &["directional light without a `direction`"]);
}

#[test]
fn names_of_looks_and_presets_are_suggested() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let render = ["render", "ball.nrrd", "-o", "p.png"];
    for (flag, name, words) in [
        ("--look", "bones", "did you mean bone?"),
        ("--look", "fluo", "did you mean fluorescence?"),
        ("--look", "zzzzzzzzz", "tissue, bone, vessel, grey, fluorescence"),
        ("--preset", "inter", "did you mean interactive?"),
        ("--preset", "bone", "interactive, balanced, reference; for the look of a volume, use --look bone"),
    ] {
        folder.refused(2, &[&render[..], &[flag, name]].concat(), &[words]);
    }
}

#[test]
fn the_unit_of_a_sidecar_is_that_of_the_scale_bar() {
    let sidecar = |unit: &str| format!("dims = [40, 56, 36]\ntype = \"uint16\"\nbyte_order = \"big\"\n{unit}");
    let folder = Folder::new().with("body.raw", body([40, 56, 36])).with("body.raw.toml", sidecar(""));
    let picture = ["render", "body.raw", "--size", "120x120", "--annotate", "-o", "p.png"];
    let warned = folder.done(&picture).err;
    assert!(warned.contains("the scale bar has no unit") && warned.contains("--spacing 1x1x1mm"), "{warned}");
    let plain = std::fs::read(folder.path("p.png")).unwrap();
    let folder = folder.with("body.raw.toml", sidecar("spacing = [0.5, 0.5, 1.25]\n"));
    let warned = folder.done(&picture).err;
    assert!(warned.contains("such as --spacing 0.5x0.5x1.25mm"), "the spacing of the file: {warned}");
    let warned = folder.done(&[&picture[..], &["--downsample", "2x2x1"]].concat()).err;
    assert!(warned.contains("such as --spacing 0.5x0.5x1.25mm"), "that of averaged voxels: {warned}");
    let folder = folder.with("body.raw.toml", sidecar("unit = \"um\"\n"));
    assert!(!folder.done(&picture).err.contains("the scale bar has no unit"), "the unit is known");
    assert_ne!(std::fs::read(folder.path("p.png")).unwrap(), plain, "the unit stands at the bar");
    let odd = folder.with("body.raw.toml", sidecar("unit = \"inch\"\n"));
    odd.refused(1, &["info", "body.raw"], &["inch", "cm, mm, µm, nm and Å"]);
}

#[test]
fn a_turntable_fits_its_widest_view_and_does_not_breathe() {
    // A long bar, seen first from one of its ends.
    let bar = nrrd([24, 64, 24], "", |[x, y, z]| {
        let inside = (8..16).contains(&x) && (4..60).contains(&y) && (8..20).contains(&z);
        u8::from(inside) * 150 + u8::try_from((x + 2 * y + 3 * z).rem_euclid(7)).unwrap()
    });
    let folder = Folder::new().with("bar.nrrd", bar);
    for size in ["72x72", "96x48", "48x96"] {
        folder.done(&[
            "render",
            "bar.nrrd",
            "--size",
            size,
            "--turntable",
            "12",
            "-o",
            "t.png",
            "-D",
            "camera.azimuth=0",
            "--background",
            "#000000",
        ]);
        let spans: Vec<[[f64; 2]; 2]> = (1..=12).map(|n| spans(&folder.path(&format!("t-{n:04}.png")))).collect();
        let ends = spans.iter().flatten().flat_map(|[span, middle]| [middle - span / 2.0, middle + span / 2.0]);
        let [low, high] = ends.fold([1.0, 0.0], |[low, high]: [f64; 2], end| [low.min(end), high.max(end)]);
        assert!(low > 0.0 && high < 1.0, "{size}: cut off, {low} to {high}");
        let widest = spans.iter().flatten().map(|[span, _]| *span).fold(0.0, f64::max);
        assert!((0.8..0.95).contains(&widest), "{size}: {widest}");
    }
}

#[test]
fn windows_choose_what_is_seen() {
    // A bone in fat in air, in Hounsfield units.
    let value = |[x, y, z]: [i32; 3]| {
        let far = (x - 20) * (x - 20) + (y - 20) * (y - 20) + (z - 20) * (z - 20);
        if far < 36 {
            22
        } else if far < 256 {
            9
        } else {
            0
        }
    };
    let bytes: Vec<u8> = nrrd([40, 40, 40], "", value);
    let voxels = bytes[bytes.len() - 40 * 40 * 40..].iter().flat_map(|&it| (i16::from(it) * 100 - 1000).to_le_bytes());
    let header = "NRRD0004\ntype: int16\ndimension: 3\nsizes: 40 40 40\nencoding: raw\nendian: little\n\n";
    let folder = Folder::new().with("ct.nrrd", header.bytes().chain(voxels).collect::<Vec<u8>>());
    // Size of the box around the visible voxels, and the opacity of the fat beside the bone.
    let shown = |window: &str, level: &str| {
        let arguments = ["render", "ct.nrrd", "--size", "64x64", "--window", window, "--level", level];
        folder.done(&[&arguments[..], &["-o", "p.exr", "--save-scene", "s.toml"]].concat());
        let text = std::fs::read_to_string(folder.path("s.toml")).unwrap();
        let camera =
            "camera={azimuth=0, elevation=0, front=[0, -1, 0], up=[0, 0, 1], around=[[0, 0, 0], [39, 39, 39]], fill=1}";
        folder.done(&["render", "s.toml", "--size", "64x64", "-o", "q.exr", "-D", camera]);
        let rgba = support::exr::Exr::read(&folder.path("q.exr")).rgba();
        let scene: toml::Table = text.parse().unwrap();
        let around = scene["camera"]["around"].as_array().unwrap();
        let corner = |index: usize| [0, 1, 2].map(|axis| around[index][axis].as_float().unwrap());
        let [low, high] = [0, 1].map(corner);
        let diagonal = [0, 1, 2].map(|axis| (high[axis] - low[axis]).powi(2)).iter().sum::<f64>().sqrt();
        let alpha = rgba[3 * 64 * 64 + 32 * 64 + 32 + 14];
        (diagonal, f64::from(alpha))
    };
    let (bone, fat_of_bone) = shown("1800", "400");
    let (body, fat_of_body) = shown("400", "-100");
    // Radii of 6 and 16 voxels.
    assert!((2.3..3.0).contains(&(body / bone)), "{bone}, {body}");
    assert!(fat_of_bone < 0.1 && fat_of_body > 0.5, "{fat_of_bone}, {fat_of_body}");
    // The same above 0, as unsigned numbers of scanners: water is 1024.
    let offset = bytes[bytes.len() - 40 * 40 * 40..].iter().flat_map(|&it| (u16::from(it) * 100 + 24).to_le_bytes());
    let header = "ObjectType = Image\nNDims = 3\nModality = MET_MOD_CT\nDimSize = 40 40 40\nElementType = MET_USHORT\n\
                  ElementDataFile = LOCAL\n";
    let folder = Folder::new().with("ct.mha", header.bytes().chain(offset).collect::<Vec<u8>>());
    let said =
        folder.done(&["render", "ct.mha", "--size", "8x8", "-o", "p.png", "--window", "400", "--level", "40"]).err;
    let wanted = "transparent up to -160, most opaque from 240 (-1184 and -784 Hounsfield units; for a window in these, add 1024";
    assert!(said.contains(wanted), "{said}");
}

#[test]
fn a_window_without_transparent_values_and_labels_taken_as_values_are_told() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let said = |file: &str, wish: &[&str]| {
        folder.done(&[&["render", file, "--size", "8x8", "-o", "p.png"][..], wish].concat()).err
    };
    let words = "no value is transparent, because they begin at 0";
    let wide = said("ball.nrrd", &["--window", "400", "--level", "40"]);
    assert!(wide.contains(words), "{wide}");
    let fitting = said("ball.nrrd", &["--window", "100", "--level", "150"]);
    assert!(fitting.contains("transparent up to 100") && !fitting.contains(words), "{fitting}");
    let halves = |[x, _, _]: [i32; 3]| if x < 8 { 0 } else { 3 };
    let folder = Folder::new().with("halves.nrrd", nrrd([16, 16, 16], "", halves));
    let said = folder.done(&["render", "halves.nrrd", "--size", "8x8", "-o", "p.png", "--look", "bone"]).err;
    assert!(said.contains("a segmentation with 1 label as if it were measured, shown as bone"), "{said}");
}

#[test]
fn a_soft_object_in_one_colour_fits_the_picture_by_what_is_visible_of_it() {
    let soft = nrrd([40, 40, 40], "", |[x, y, z]| {
        let far = f64::from((x - 20).pow(2) + (y - 20).pow(2) + (z - 20).pow(2));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "from 0 to 250")]
        let value = (250.0 * (-far / 60.0).exp()).round() as u8;
        value
    });
    let folder = Folder::new().with("soft.nrrd", soft);
    for look in [
        ["--window=250", "--level=125"],
        ["--window=100", "--level=60"],
        ["--look", "grey"],
        ["--look", "fluorescence"],
        ["--look", "maximum"],
    ] {
        // The fit counts on light that nothing dims, at this exposure.
        let lit = ["-D", "display.exposure=1.3", "-D", "shadows.ambient=open", "-D", "lights.*.shadows=false"];
        let black = ["render", "soft.nrrd", "--size", "240x240", "--background", "#000000", "-o", "p.png"];
        folder.done(&[&black[..], &lit, &look].concat());
        let [[width, _], [height, _]] = spans_above(12, &folder.path("p.png"));
        assert!((width.max(height) - 0.9).abs() < 0.018, "{look:?}: {width} wide, {height} high");
    }
}

#[test]
fn a_single_slice_of_any_thickness_is_seen_face_on() {
    let slice =
        nrrd([20, 16, 1], "spacings: 1 1 4\n", |[x, y, _]| if (x - 10).abs() + (y - 8).abs() < 7 { 200 } else { 0 });
    let folder = Folder::new().with("slice.nrrd", slice);
    folder.done(&["render", "slice.nrrd", "--size", "40x40", "-o", "p.png"]);
    let [width, height] = spans(&folder.path("p.png")).map(|[span, _]| span);
    assert!(width > 0.8 && height > 0.6, "{width} wide, {height} high; its edge is a fifth as high as wide");
}

#[test]
fn noise_around_sparse_vessels_is_left_out() {
    // A bright vessel along x, and single voxels of noise, fainter than it.
    let noise = |[x, y, z]: [i32; 3]| (x * 7919 + y * 104_729 + z * 1_299_709).rem_euclid(97);
    let value = |[x, y, z]: [i32; 3]| {
        let vessel = (y - 24) * (y - 24) + (z - 24) * (z - 24) < 9;
        match noise([x, y, z]) {
            _ if vessel => 190 + u8::try_from((x + y) % 40).unwrap(),
            0 => 70 + u8::try_from(x % 20).unwrap(),
            other => u8::try_from(other % 8).unwrap(),
        }
    };
    let folder = Folder::new().with("v.nrrd", nrrd([48, 48, 48], "", value));
    folder.done(&["render", "v.nrrd", "--size", "8x8", "--save-scene", "s.toml", "-o", "p.png"]);
    let scene: toml::Table = std::fs::read_to_string(folder.path("s.toml")).unwrap().parse().unwrap();
    let from = scene["transfer"]["intervals"][0]["range"][0].as_float().unwrap();
    assert!((90.0..200.0).contains(&from), "above the noise, below the vessel: {from}");
}

/// The codes of a PNG of 8 bits.
fn codes(path: &std::path::Path) -> Vec<u8> {
    let file = std::io::BufReader::new(std::fs::File::open(path).unwrap());
    let mut decoder = png::Decoder::new(file).read_info().unwrap();
    let mut pixels = vec![0; decoder.output_buffer_size().unwrap()];
    decoder.next_frame(&mut pixels).unwrap();
    pixels
}

#[test]
fn a_film_is_relit_with_exposure_background_and_annotations_as_rendered() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let dressed = ["--annotate", "--title", "A ball", "--background", "#204060"];
    let render = ["render", "ball.nrrd", "--size", "160x120", "--spacing", "0.5x0.5x0.5mm"];
    folder.done(&[&render[..], &["-o", "a.png", "--accumulators", "film.exr"], &dressed].concat());
    let relit = |more: &[&str], name: &str| {
        folder.done(&[&["relight", "film.exr", "-o", name][..], more].concat());
        codes(&folder.path(name))
    };
    let expected = codes(&folder.path("a.png"));
    let apart =
        |one: &[u8], other: &[u8]| one.iter().zip(other).filter(|(one, other)| one.abs_diff(**other) > 1).count();
    let same = relit(&dressed, "b.png");
    assert_eq!(apart(&same, &expected), 0, "scale bar, legend, title and background are those of render");
    assert!(apart(&relit(&dressed[3..], "c.png"), &expected) > 100, "without annotations");
    folder.done(&[&render[..], &["-o", "d.png", "-D", "display.exposure=2.6"]].concat());
    let brighter = relit(&["--exposure", "2.6"], "e.png");
    assert_eq!(apart(&brighter, &codes(&folder.path("d.png"))), 0, "the exposure of render");
    folder.refused(2, &["relight", "film.exr", "-o", "f.png", "--exposure", "0"], &["--exposure", "above 0"]);
    folder.refused(2, &["relight", "film.exr", "-o", "f.png", "--title", "x"], &["--annotate"]);
}

#[test]
fn an_automatic_exposure_is_one_number_wherever_the_picture_is_made() {
    let folder = Folder::new().with("ball.nrrd", ball());
    let render = ["render", "ball.nrrd", "--size", "64x64"];
    folder.done(
        &[&render[..], &["-o", "a.png", "-o", "a.exr", "--accumulators", "film.exr", "--save-scene", "s.toml"]]
            .concat(),
    );
    let scene: toml::Table = std::fs::read_to_string(folder.path("s.toml")).unwrap().parse().unwrap();
    let exposure = scene["display"]["exposure"].as_float().unwrap();
    assert!(exposure > 0.2 && exposure <= 3.0, "{exposure}");
    assert_eq!(scene["display"]["tone"].as_str(), Some("soft"));
    let expected = codes(&folder.path("a.png"));
    // The scene with its number, the film, and the film in parts.
    folder.done(&["render", "s.toml", "--size", "64x64", "-o", "b.png"]);
    assert!(codes(&folder.path("b.png")) == expected, "the saved scene");
    folder.done(&["relight", "film.exr", "-o", "c.png"]);
    let apart = |other: &[u8]| expected.iter().zip(other).filter(|(one, other)| one.abs_diff(**other) > 1).count();
    assert_eq!(apart(&codes(&folder.path("c.png"))), 0, "the film");
    for part in ["1", "2"] {
        let (block, name) = (format!("{part}/2"), format!("part-{part}.exr"));
        let plain = ["-D", "accuracy.integration=samples"];
        folder.done(&[&render[..], &plain, &["--block", &block, "--accumulators", &name]].concat());
    }
    folder.done(&["composite", "part-1.exr", "part-2.exr", "-o", "whole.exr"]);
    let told = folder.done(&["relight", "whole.exr", "-o", "d.png", "--json"]).json();
    let whole = told["exposure"].as_f64().unwrap();
    assert!((whole / exposure - 1.0).abs() < 0.03, "{whole} of parts, {exposure} of the whole");
    // Under other lights the exposure stays; `auto` finds another one.
    let told = folder.done(&["relight", "film.exr", "--light", "A=0.1", "-o", "e.png", "--json"]).json();
    assert_eq!(told["exposure"].as_f64(), Some(exposure));
    let dim = ["relight", "film.exr", "--light", "A=0.1", "--exposure", "auto", "-o", "f.png", "--json"];
    let found = folder.done(&dim).json()["exposure"].as_f64().unwrap();
    assert!(found > 5.0 * exposure, "{found} under a dim light, {exposure}");
    // Requested lights of the scene do not change it either, nor do those of a turn or a page.
    let dim = ["-o", "i.png", "--light", "day=0.1", "--accumulators", "dim.exr", "--save-scene", "dim.toml"];
    folder.done(&[&render[..], &dim].concat());
    let scene: toml::Table = std::fs::read_to_string(folder.path("dim.toml")).unwrap().parse().unwrap();
    assert_eq!(scene["display"]["exposure"].as_float(), Some(exposure), "under a dim light");
    let told = folder.done(&["relight", "dim.exr", "-o", "j.png", "--json"]).json();
    assert_eq!(told["exposure"].as_f64(), Some(exposure), "its film");
    // However little light there is, it is a number that a scene may state.
    let faint = [&render[..], &["-o", "k.png", "-D", "lights.*.intensity=1e-12", "--save-scene", "k.toml"]].concat();
    folder.done(&faint);
    folder.done(&["render", "k.toml", "--size", "8x8", "-o", "k.png"]);
    // Pictures of a turn have one exposure, whichever part of them is made.
    folder.done(&[&render[..], &["--turntable", "3", "-o", "t.png"]].concat());
    let all: Vec<Vec<u8>> = (1..=3).map(|n| codes(&folder.path(&format!("t-000{n}.png")))).collect();
    folder.done(&[&render[..], &["--turntable", "3", "--part", "3/3", "-o", "u.png"]].concat());
    assert!(codes(&folder.path("u-0003.png")) == all[2], "the third picture of a turn");
    // Linear pictures have neither tone nor backdrop.
    folder.done(&[&render[..], &["-o", "g.exr", "-D", "display.tone=linear", "-D", "display.backdrop=none"]].concat());
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert!(bytes("a.exr") == bytes("g.exr"), "the linear picture");
    folder.refused(2, &["relight", "film.exr", "-o", "h.png", "--tone", "sof"], &["--tone", "did you mean soft?"]);
    folder.refused(
        2,
        &[&render[..], &["-o", "h.png", "-D", "display.exposure=bright"]].concat(),
        &["exposure", "auto"],
    );
}

#[test]
fn an_unreadable_file_is_named_and_not_the_built_in_scene() {
    let folder = Folder::new().with("short.nrrd", &ball()[..2000]).with("odd.mhd", "NDims = three\n");
    for (file, words) in
        [("short.nrrd", "short.nrrd"), ("odd.mhd", "odd.mhd"), ("gone.nrrd", "gone.nrrd"), ("gone.toml", "gone.toml")]
    {
        for command in
            [&["render", file, "-o", "p.png"][..], &["render", "--volume", file, "-o", "p.png"], &["info", file]]
        {
            let err = folder.refused(1, command, &[words]).err;
            assert!(!err.contains("default scene") && !err.contains("no volume"), "{command:?}: {err}");
        }
    }
}

#[test]
fn a_folder_of_dicom_files_is_a_volume_and_says_so() {
    let folder = Folder::new();
    std::fs::create_dir(folder.path("scan")).unwrap();
    for (name, z, first) in [("a", 0.0, 1), ("b", 2.0, 13)] {
        let bytes = support::dicom::file(&support::dicom::slice(z, first), support::dicom::EXPLICIT);
        std::fs::write(folder.path("scan").join(name), bytes).unwrap();
    }
    let info = folder.done(&["info", "scan"]).out;
    assert!(info.contains("4 × 3 × 2") && info.contains("anatomical"), "{info}");
    // Two series are asked about, with the flag.
    let other = support::dicom::slice(0.0, 5).text(0x0020_000e, "UI", "1.2.4");
    std::fs::write(folder.path("scan").join("c"), support::dicom::file(&other, support::dicom::EXPLICIT)).unwrap();
    folder.refused(1, &["render", "scan", "-o", "p.png"], &["scan", "2 series", "--series N"]);
}

/// A volume as NRRD.
fn nrrd_of(kind: &str, sizes: &[usize], more: &str, voxels: impl IntoIterator<Item = u8>) -> Vec<u8> {
    let sizes: Vec<String> = sizes.iter().map(ToString::to_string).collect();
    let header = format!(
        "NRRD0005\ntype: {kind}\ndimension: {}\nsizes: {}\nencoding: raw\nendian: little\n{more}\n",
        sizes.len(),
        sizes.join(" ")
    );
    header.into_bytes().into_iter().chain(voxels).collect()
}

#[test]
fn a_volume_that_is_long_in_one_direction_is_seen_from_its_end() {
    let voxels = || (0..14 * 12 * 11_usize).map(|index| u8::try_from(30 + index % 14 * 15).unwrap());
    for spacings in ["1 1 150", "260 1 1", "0.5 190 0.7"] {
        let spacings = format!("spacings: {spacings}\n");
        let folder = Folder::new().with("v.nrrd", nrrd_of("uint8", &[14, 12, 11], &spacings, voxels()));
        let outcome = folder.done(&["render", "v.nrrd", "--size", "80x80", "-o", "p.png"]);
        assert!(!outcome.err.contains("warning"), "{}", outcome.err);
        let bright = codes(&folder.path("p.png")).chunks(3).filter(|pixel| pixel.iter().any(|&code| code > 60)).count();
        assert!(bright > 80 * 80 / 5, "{spacings}: {bright} bright pixels");
    }
    // From the side it is thinner than a pixel, and may be missed.
    let folder = Folder::new();
    let thin =
        ["render", "scene.toml", "--size", "8x8", "-o", "p.png", "-D", "camera={azimuth=0,elevation=0,fill=0.05}"];
    let err = folder.done(&thin).err;
    assert!(err.contains("thinner than a pixel") && err.contains("× 0.") && err.contains("--size"), "{err}");
}

#[test]
fn a_volume_of_one_value_is_shown_and_said_to_be_one() {
    let float = |value: f32, count: usize| value.to_le_bytes().repeat(count);
    for (kind, sizes, voxels, value) in [
        ("uint8", [1, 1, 1], vec![77], "77"),
        ("uint8", [6, 5, 4], vec![131; 120], "131"),
        ("float", [7, 6, 5], float(-2.5, 210), "-2.5"),
        ("float", [5, 5, 5], float(0.0, 125), "0"),
    ] {
        for look in [&[][..], &["--look", "grey"]] {
            let folder = Folder::new().with("v.nrrd", nrrd_of(kind, &sizes, "spacings: 1 1 1\n", voxels.clone()));
            let outcome = folder.done(&[&["render", "v.nrrd", "--size", "40x40", "-o", "p.png"][..], look].concat());
            assert!(outcome.err.contains(&format!("all of them {value}, shown")), "{}", outcome.err);
            assert!(!outcome.err.contains("warning: nothing in"), "{}", outcome.err);
            let brightest = codes(&folder.path("p.png")).into_iter().max();
            assert!(brightest > Some(40), "{value} {look:?}: {brightest:?}");
        }
    }
}

#[test]
fn values_far_from_zero_are_told_apart() {
    // A ball of two shells in noise, all of them beyond 3·10⁹; f32 has steps of 256 there.
    let value = |index: usize| {
        let [x, y, z] = [index % 20, index / 20 % 20, index / 400].map(|it| i32::try_from(it).unwrap() - 10);
        let noise = f64::from(u8::try_from(index * 37 % 11).unwrap());
        let ball = match x * x + y * y + z * z {
            0..20 => 300.25,
            20..60 => 150.25,
            _ => 0.25,
        };
        3_000_000_000.0 + noise + ball
    };
    let voxels = (0..8000).flat_map(|index| value(index).to_le_bytes());
    let folder = Folder::new().with("v.nrrd", nrrd_of("double", &[20, 20, 20], "spacings: 1 1 1\n", voxels));
    let outcome = folder.done(&["info", "v.nrrd"]);
    let mean = (0..8000).map(value).sum::<f64>() / 8000.0;
    let line = |name: &str| outcome.out.lines().find(|line| line.trim_start().starts_with(name)).unwrap().to_owned();
    let told: f64 = line("values").split("mean ").nth(1).unwrap().parse().unwrap();
    assert!((told - mean).abs() < 0.01, "{told}, not {mean}");
    let percentiles: Vec<f64> =
        line("percentile").split(", ").map(|it| it.split(": ").nth(1).unwrap().trim().parse().unwrap()).collect();
    assert!(percentiles.first() < percentiles.last() && percentiles[6] - percentiles[0] > 100.0, "{percentiles:?}");
    assert!(percentiles.iter().all(|it| it.fract() > 0.2 && it.fract() < 0.3), "no value is rounded: {percentiles:?}");
    let err = folder.done(&["render", "v.nrrd", "--size", "24x24", "-o", "p.png"]).err;
    let words = err.split([' ', ',', ';', '\n']).map(|word| word.trim_end_matches('.'));
    let numbers: Vec<f64> = words.filter_map(|word| word.parse().ok()).filter(|it| *it > 1e9).collect();
    assert!(numbers.len() >= 4 && numbers.windows(2).all(|pair| pair[0] < pair[1]), "{err}");
    assert!(codes(&folder.path("p.png")).into_iter().max() > Some(60), "a picture with something in it");
}

#[test]
fn the_lung_look_shows_lungs_through_ribs() {
    // A chest of ribs, muscle and two lungs in full inspiration, 4 mm a voxel; the ribs cover half of the front.
    const SIDES: [usize; 3] = [56, 40, 40];
    let stored = |index: usize| {
        let [x, y, z] = [index % 56, index / 56 % 40, index / (56 * 40)].map(|it| i32::try_from(it).unwrap());
        let [x, y, z] = [f64::from(x) - 27.5, f64::from(y) - 19.5, f64::from(z) - 19.5];
        let body = (x / 26.0).powi(2) + (y / 17.0).powi(2);
        let lung = ((x.abs() - 12.0) / 8.5).powi(2) + (y / 11.0).powi(2) + (z / 16.0).powi(2);
        let noise = i16::try_from(index * 7 % 31).unwrap() - 15;
        let is_rib = (0.68..0.8).contains(&body) && z.rem_euclid(8.0) < 4.0;
        noise
            + if body > 1.0 {
                -1000
            } else if lung < 1.0 {
                -880
            } else if is_rib {
                500
            } else {
                40
            }
    };
    let voxels = (0..SIDES.iter().product()).flat_map(|index| stored(index).to_le_bytes());
    let axes = "space: left-posterior-superior\nspace directions: (4,0,0) (0,4,0) (0,0,4)\n";
    let folder = Folder::new().with("chest.nrrd", nrrd_of("int16", &SIDES, axes, voxels));
    folder.done(&["render", "chest.nrrd", "--look", "lung", "--size", "84x84", "-o", "p.png"]);
    let shown = codes(&folder.path("p.png"));
    // Columns of pixels through the middle of a lung, and between lungs, at the height of its middle half.
    let mean = |x: usize| -> [f64; 3] {
        let rows = 30..54;
        [0, 1, 2].map(|channel| rows.clone().map(|y| f64::from(shown[3 * (84 * y + x) + channel])).sum::<f64>() / 24.0)
    };
    let (left, right, middle) = (mean(25), mean(58), mean(42));
    for lung in [left, right] {
        // The lung is brighter than what is between, and its colour is not that of bones, which are nearly white.
        assert!(lung[0] > 90.0 && lung[0] > 1.5 * middle[0], "{lung:?} beside {middle:?}");
        assert!(lung[0] > 1.25 * lung[2], "{lung:?}");
    }
}

#[test]
fn all_times_of_several_channels_have_one_look() {
    // A ball that loses a third of its light from time to time, beside one that keeps it.
    let value = |index: usize| {
        let (channel, voxel, time) = (index % 2, index / 2 % 4096, index / 8192);
        let [x, y, z] = [voxel % 16, voxel / 16 % 16, voxel / 256].map(|it| i32::try_from(it).unwrap());
        let inside = (x - if channel == 0 { 4 } else { 11 }).pow(2) + (y - 8).pow(2) + (z - 8).pow(2) < 16;
        let bright = if channel == 0 { [210, 140, 93][time] } else { 180 };
        u8::try_from(index % 5).unwrap() + if inside { bright } else { 0 }
    };
    let axes =
        "space dimension: 3\nspace directions: none (1,0,0) (0,1,0) (0,0,1) none\nkinds: none space space space time\n";
    let voxels = (0..3 * 8192).map(value);
    let folder = Folder::new().with("c.nrrd", nrrd_of("uint8", &[2, 16, 16, 16, 3], axes, voxels));
    let all = ["render", "c.nrrd", "--time", "all", "--size", "32x32"];
    let told = folder.done(&[&all[..], &["-o", "p.png", "--save-scene", "s.toml"]].concat()).err;
    assert!(told.contains("2 channels") && told.contains("All 3 time steps have this look"), "{told}");
    let sums = |name: &str| {
        [1, 2, 3]
            .map(|n| codes(&folder.path(&format!("{name}-000{n}.png"))).iter().map(|&it| u32::from(it)).sum::<u32>())
    };
    for (light, fades) in [("channel 1", true), ("channel 2", false)] {
        folder.done(&[&all[..], &["--light", light, "-o", "alone.png"]].concat());
        let sums = sums("alone");
        let falls = sums.windows(2).all(|pair| 10 * pair[1] < 9 * pair[0]);
        assert!(
            sums[2] > 0 && falls == fades && (fades || sums[0].abs_diff(sums[2]) < sums[0] / 50),
            "{light}: {sums:?}"
        );
    }
    folder.done(&["render", "s.toml", "--time", "1", "--size", "32x32", "-o", "second.png"]);
    assert_eq!(codes(&folder.path("second.png")), codes(&folder.path("p-0002.png")), "the saved scene");
    folder.done(&[&all[..], &["--channels", "1", "-o", "one.png"]].concat());
    assert!(sums("one").windows(2).all(|pair| pair[0].abs_diff(pair[1]) < pair[0] / 50), "{:?}", sums("one"));
}

#[test]
fn all_times_of_a_series_have_one_look_so_that_bleaching_is_seen() {
    // A ball that moves, and loses a third of its light from time to time.
    let value = |index: usize| {
        let [x, y, z] = [index % 16, index / 16 % 16, index / 256 % 16].map(|it| i32::try_from(it).unwrap());
        let time = index / 4096;
        let inside = (x - 6 - i32::try_from(time).unwrap()).pow(2) + (y - 8).pow(2) + (z - 8).pow(2) < 20;
        u8::try_from(index % 5).unwrap() + if inside { [210, 140, 93][time] } else { 0 }
    };
    let axes = "space dimension: 3\nspace directions: (1,0,0) (0,1,0) (0,0,1) none\nkinds: space space space time\n";
    let folder = Folder::new().with("t.nrrd", nrrd_of("uint8", &[16, 16, 16, 3], axes, (0..3 * 4096).map(value)));
    let all = ["render", "t.nrrd", "--time", "all", "--size", "32x32"];
    let outcome = folder.done(&[&all[..], &["--look", "grey", "-o", "p.png", "--save-scene", "s.toml"]].concat());
    assert!(
        outcome.err.contains("All 3 time steps have this look") && outcome.err.contains("from 0 to 214"),
        "{}",
        outcome.err
    );
    let sum = |name: &str| codes(&folder.path(name)).iter().map(|&code| u32::from(code)).sum::<u32>();
    let sums = [1, 2, 3].map(|n| sum(&format!("p-000{n}.png")));
    assert!(sums[2] > 0 && sums.windows(2).all(|pair| 10 * pair[1] < 9 * pair[0]), "{sums:?}");
    // The saved scene has the same look for each time alone, and a look of a time alone says so.
    folder.done(&["render", "s.toml", "--time", "1", "--size", "32x32", "-o", "second.png"]);
    assert_eq!(codes(&folder.path("second.png")), codes(&folder.path("p-0002.png")));
    let alone = folder.done(&["render", "t.nrrd", "--time", "2", "--size", "8x8", "-o", "alone.png"]).err;
    assert!(alone.contains("time step 2 alone") && alone.contains("--time all"), "{alone}");
    // The times pass once during a turn.
    let json = folder.done(&[&all[..], &["--turntable", "6", "-o", "t.apng", "--json"]].concat()).json();
    assert_eq!((&json["time_steps"], &json["pictures"]["written"]), (&3.into(), &6.into()), "{json}");
    folder.refused(2, &["info", "t.nrrd", "--time", "all"], &["only `relume render` takes all time steps"]);
    folder.refused(2, &[&all[..], &["--accumulators", "a.exr"]].concat(), &["--time all", "--accumulators"]);
    folder.refused(2, &["render", "scene.toml", "--time", "all", "-o", "q.png"], &["has one time step"]);
}

#[test]
fn what_is_small_at_each_time_stays_in_a_look_of_all_times() {
    // A large ball at rest, a particle that moves, whose way is long, and a speck at one time.
    let value = |index: usize| {
        let [x, y, z] = [index % 32, index / 32 % 24, index / 768 % 24].map(|it| i32::try_from(it).unwrap());
        let time = i32::try_from(index / (768 * 24)).unwrap();
        let ball = (x - 9).pow(2) + (y - 9).pow(2) + (z - 9).pow(2) < 60;
        let particle = (3 * time + 2..3 * time + 6).contains(&x) && (19..22).contains(&y) && (19..22).contains(&z);
        let speck = (x, y, z, time) == (28, 4, 4, 0);
        u8::try_from(index % 5).unwrap()
            + if ball || particle || speck { 150 + u8::try_from(index % 37).unwrap() } else { 0 }
    };
    let axes = "space dimension: 3\nspace directions: (1,0,0) (0,1,0) (0,0,1) none\nkinds: space space space time\n";
    let voxels = (0..5 * 768 * 24).map(value);
    let folder = Folder::new().with("t.nrrd", nrrd_of("uint8", &[32, 24, 24, 5], axes, voxels));
    let render =
        |more: &[&str]| folder.done(&[&["render", "t.nrrd", "--size", "8x8", "-o", "p.png"], more].concat()).err;
    let said = render(&["--time", "all", "--save-scene", "s.toml"]);
    assert!(!said.contains("connected parts"), "{said}");
    assert!(!std::fs::read_to_string(folder.path("s.toml")).unwrap().contains("without_specks"));
    assert!(render(&["--time", "0"]).contains("; connected parts of fewer than 50 voxels are left out"), "alone");
}
