//! File dialogs, and questions before work is lost.

use std::path::Path;
use std::time::Duration;

use egui::accesskit::Role;
use egui::{Event, Key, Modifiers, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use relume::document::SceneOptions;
use relume::document::Source;
use relume::document::{Question, Unknown};
use relume::view::Action;
use relume::view::action::{File, Leaving, Losing};
use relume::volume::{RawLayout, Selection, Series, Several, VoxelType};

use relume::progress::Quiet;

use crate::app::{App, document, drag_along, is_painted, wide};
use crate::support::{dicom, volumes};

/// Opens the file menu and clicks `line`.
fn file_menu(window: &mut Harness<'_, App>, line: &str) {
    window.get_by_label("File").click();
    window.run();
    window.get_by_label_contains(line).click();
    window.step();
}

/// Waits until the dialog has listed its folder.
fn until_listed(window: &mut Harness<'_, App>) {
    for _ in 0..50 {
        std::thread::sleep(Duration::from_millis(10));
        window.step();
    }
}

fn saved_or_opened(window: &Harness<'_, App>) -> Vec<Action> {
    let is_file = |action: &&Action| {
        matches!(
            action,
            Action::SavePicture(_) | Action::SavePage(_) | Action::SaveSession(_) | Action::Open(_) | Action::Leave(_)
        )
    };
    window.state().asked.iter().filter(is_file).cloned().collect()
}

/// Question about a file.
fn asked(unknown: Unknown) -> Question {
    Question { file: "/data/beat.nrrd".into(), unknown }
}

#[test]
fn another_volume_of_a_file_is_asked_for_where_there_are_several() {
    for several in [false, true] {
        let mut window = wide(document());
        window.state_mut().several = several;
        file_menu(&mut window, "Another volume of this file");
        window.run();
        assert_eq!(window.state().asked.contains(&Action::Another), several);
    }
}

#[test]
fn a_picture_is_saved_where_the_dialog_says_and_asks_before_it_replaces_one() {
    let mut window = wide(document());
    let path = window.state().folder.path("relume-0001.png");
    file_menu(&mut window, "Save picture as");
    until_listed(&mut window);
    window.key_press(Key::Enter);
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window), [Action::SavePicture(Some(path.canonicalize().unwrap_or(path.clone())))]);
    std::fs::write(&path, "another picture").unwrap();
    file_menu(&mut window, "Save picture as");
    until_listed(&mut window);
    window.key_press(Key::Enter);
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window).len(), 1, "a file that is there is asked for");
    window.key_press(Key::Enter);
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window).len(), 1, "Enter has chosen the name, and answers nothing");
    window.get_by_label_contains("Overwrite").click();
    until_listed(&mut window);
    assert_eq!(saved_or_opened(&window).len(), 2);
    assert!(!window.state().chooser.is_open());
}

#[test]
fn a_page_is_saved_where_the_dialog_says_as_html() {
    let mut window = wide(document());
    let folder = window.state().folder.path("relume-0001.png").parent().unwrap().to_owned();
    file_menu(&mut window, "Save page as");
    until_listed(&mut window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    until_listed(&mut window);
    window.event(Event::Text("lecture".to_owned()));
    until_listed(&mut window);
    window.key_press(Key::Enter);
    until_listed(&mut window);
    let path = folder.canonicalize().unwrap_or(folder).join("lecture.html");
    assert_eq!(saved_or_opened(&window), [Action::SavePage(Some(path))]);
}

#[test]
fn a_page_being_written_holds_up_the_end_of_the_window_and_no_other_file() {
    for (leaving, asks) in [(Leaving::Close, true), (Leaving::Open(Box::default()), false)] {
        let mut window = wide(document());
        window.state_mut().losing = Losing { page: true, ..Losing::default() };
        window.state_mut().chooser.leave(leaving);
        window.run();
        assert_eq!(window.query_by_label_contains("A page is being written").is_some(), asks);
    }
}

#[test]
fn a_name_without_an_extension_gets_that_of_the_file() {
    let mut window = wide(document());
    file_menu(&mut window, "Save session as");
    until_listed(&mut window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run();
    window.event(Event::Text("mine".to_owned()));
    window.run();
    window.key_press(Key::Enter);
    until_listed(&mut window);
    let path = window.state().folder.path("mine.toml");
    assert_eq!(saved_or_opened(&window), [Action::SaveSession(Some(path))]);
}

#[test]
fn escape_leaves_the_dialog_also_from_its_field_and_files_of_other_kinds_are_not_listed() {
    let mut window = wide(document());
    for name in ["earlier.toml", "picture.png"] {
        std::fs::write(window.state().folder.path(name), "").unwrap();
    }
    file_menu(&mut window, "Save session as");
    until_listed(&mut window);
    assert!(window.query_by_label_contains("earlier.toml").is_some());
    assert!(window.query_by_label_contains("picture.png").is_none(), "no session");
    assert!(window.ctx.memory(|memory| memory.focused().is_some()), "the name can be typed at once");
    window.key_press(Key::Escape);
    window.run();
    assert!(!window.state().chooser.is_open());
    assert_eq!(saved_or_opened(&window), []);
}

#[test]
fn a_scene_without_its_volume_is_shown_the_one_that_is_chosen() {
    let mut window = wide(document());
    for name in ["head.mhd", "notes.pdf"] {
        std::fs::write(window.state().folder.path(name), "").unwrap();
    }
    let (scene, volume) = (window.state().folder.path("scene.toml"), window.state().folder.path("head.mhd"));
    let mut source = Source::of(&scene);
    window.state_mut().chooser.ask_volume(source.clone(), (&scene, false));
    // The dialog repaints until it has listed its folder.
    window.step();
    until_listed(&mut window);
    assert!(is_painted(&window, "Which volume should scene.toml show?"));
    window.get_by_label_contains("head.mhd").click();
    window.run();
    window.get_by_label_contains("  Open").click();
    until_listed(&mut window);
    source.options.volume = Some(volume);
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(source)))]);
}

#[test]
fn what_can_be_opened_is_listed_and_keys_are_the_dialogs_own() {
    let mut window = wide(document());
    for name in ["head.mhd", "scene.toml", "notes.pdf"] {
        std::fs::write(window.state().folder.path(name), "").unwrap();
    }
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    window.run();
    until_listed(&mut window);
    assert!(window.query_by_label_contains("notes.pdf").is_none(), "no volume and no scene");
    window.get_by_label_contains("head.mhd").click();
    window.run();
    window.key_press(Key::ArrowDown);
    window.run();
    window.key_press(Key::P);
    window.run();
    assert!(!window.state().asked.iter().any(|action| matches!(action, Action::Edit(_))), "the camera stays");
    window.get_by_label_contains("head.mhd").click();
    window.run();
    window.get_by_label_contains("  Open").click();
    until_listed(&mut window);
    let path = window.state().folder.path("head.mhd");
    assert_eq!(saved_or_opened(&window), [Action::Open(Box::new(Source::of(&path)))]);
}

fn series(key: &str, side: usize) -> Series {
    Series { key: key.to_owned(), description: "«head» MR".to_owned(), dims: [side; 3], times: 1 }
}

#[test]
fn the_largest_series_is_chosen_at_first() {
    let mut window = wide(document());
    let source = Source::of(Path::new("scans"));
    let there = Several::Series([("1", 2), ("2", 9), ("3", 5)].map(|(key, side)| series(key, side)).to_vec());
    window.state_mut().chooser.ask(source.clone(), asked(Unknown::Which(there)), &Selection::default());
    window.run();
    window.key_press(Key::Enter);
    window.run();
    let mut chosen = source;
    chosen.options.selection.series = Some("2".to_owned());
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(chosen)))]);
}

#[test]
fn series_channels_and_levels_are_shown_with_their_middle_slices() {
    let scans = volumes::folder(&[1, 2].map(|number| {
        let slice = dicom::slice(0.0, 100 * number).text(0x0020_0011, "IS", &number.to_string());
        let name = if number == 1 { "a" } else { "b" };
        (name, dicom::file(&slice.text(0x0020_000e, "UI", &format!("1.{number}")), dicom::EXPLICIT))
    }));
    let cells = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tiff/channels.ome.tif");
    let store = volumes::bundle(&Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/zarr/image.bundle"));
    let all = [(scans.path(), "series"), (&*cells, "channels"), (store.path(), "levels of resolution")];
    for (path, kind) in all {
        // As the menu asks for another volume of a file.
        let source = Source::of(path).reselected();
        let error = source.read(&Quiet).map(drop).unwrap_err();
        let question = error.question().unwrap();
        let mut window = wide(document());
        window.state_mut().chooser.ask(source, question, &Selection::default());
        window.step();
        assert!(window.query_by_label_contains(kind).is_some(), "{kind}");
        assert!(window.query_by_label("middle slice 0").is_none(), "{kind}: it is not read by the panel");
        for index in 0..2 {
            let name = format!("middle slice {index}");
            let begun = std::time::Instant::now();
            while window.query_by_label(&name).is_none() {
                assert!(begun.elapsed() < Duration::from_secs(20), "{kind}: no picture {index}");
                std::thread::sleep(Duration::from_millis(10));
                window.step();
            }
        }
        window.get_by_label("middle slice 1").click();
        window.run_steps(3);
        window.key_press(Key::Enter);
        window.run_steps(3);
        let opened = saved_or_opened(&window);
        let [Action::Leave(Leaving::Open(source))] = &opened[..] else { panic!("{kind}: {opened:?}") };
        let Selection { series, component, level, .. } = &source.options.selection;
        let chosen = (series.as_deref(), *component, *level);
        let expected = match kind {
            "series" => (Some("2"), None, None),
            "channels" => (None, Some(1), None),
            _ => (None, None, Some(1)),
        };
        assert_eq!(chosen, expected, "{kind}");
    }
}

#[test]
fn a_file_of_several_volumes_is_opened_by_the_one_that_is_chosen() {
    let several = [
        (Several::Times(4), Selection { time: Some(3), ..Selection::default() }),
        (
            Several::Steps { axis: "image type".to_owned(), values: ["W", "F"].map(str::to_owned).to_vec() },
            Selection { time: Some(1), ..Selection::default() },
        ),
        (
            Several::Components { count: 4, kind: String::new(), names: Vec::new() },
            Selection { component: Some(3), ..Selection::default() },
        ),
        (
            Several::Arrays(vec!["ct".to_owned(), "pet".to_owned()]),
            Selection { array: Some("pet".to_owned()), ..Selection::default() },
        ),
        (
            Several::Series([("3", 9), ("7", 2)].map(|(key, side)| series(key, side)).to_vec()),
            Selection { series: Some("7".to_owned()), ..Selection::default() },
        ),
    ];
    for (there, chosen) in several {
        let mut window = wide(document());
        // Other options of the source are kept.
        let mut source = Source::of(Path::new("beat.nrrd"));
        source.options.downsample = Some([2; 3]);
        window.state_mut().chooser.ask(source.clone(), asked(Unknown::Which(there.clone())), &Selection::default());
        window.run();
        match there {
            Several::Arrays(_) => window.get_by_label("pet").click(),
            Several::Steps { .. } => window.get_by_label("image type F").click(),
            Several::Series(_) => window.get_by_label("7 «head» MR 2×2×2").click(),
            _ => {
                let what = if chosen.time.is_some() { "Time step" } else { "Component" };
                window.get_by_role_and_label(Role::SpinButton, what).focus();
                window.run();
                window.key_press_modifiers(Modifiers::COMMAND, Key::A);
                window.event(Event::Text("3".to_owned()));
                window.run();
                window.key_press(Key::Enter);
            }
        }
        window.run();
        assert_eq!(saved_or_opened(&window), [], "{there} is asked for");
        window.key_press(Key::Enter);
        window.run();
        source.options.selection = chosen;
        assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(source)))], "{there}");
    }
}

#[test]
fn channels_with_names_are_chosen_by_them() {
    let mut window = wide(document());
    let source = Source::of(Path::new("cells.ome.tif"));
    let names = ["DAPI", "", "GFP"].map(str::to_owned).to_vec();
    let there = Several::Components { count: 3, kind: String::new(), names };
    window.state_mut().chooser.ask(source.clone(), asked(Unknown::Which(there)), &Selection::default());
    window.run();
    assert!(window.query_by_label("channel 1").is_some(), "a channel without a name has its number");
    window.get_by_label("GFP").click();
    window.run();
    window.key_press(Key::Enter);
    window.run();
    let mut chosen = source;
    chosen.options.selection.component = Some(2);
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(chosen)))]);
}

#[test]
fn another_of_several_volumes_is_chosen_from_the_one_that_is_shown() {
    let mut window = wide(document());
    let shown = Selection { time: Some(2), ..Selection::default() };
    let source = Source::of(Path::new("beat.nrrd"));
    window.state_mut().chooser.ask(source.clone(), asked(Unknown::Which(Several::Times(4))), &shown);
    window.run();
    window.key_press(Key::Enter);
    window.run();
    let expected = Source { options: SceneOptions { selection: shown, ..SceneOptions::default() }, ..source };
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(expected)))]);
}

#[test]
fn a_crooked_grid_is_resampled_when_somebody_says_so() {
    let mut window = wide(document());
    let source = Source::of(Path::new("tilt"));
    let problem = "tilt: the slices lean by 12°".to_owned();
    window.state_mut().chooser.ask(source.clone(), asked(Unknown::Grid { problem }), &Selection::default());
    window.run();
    assert!(window.query_by_label_contains("lean by 12°").is_some(), "the numbers are shown");
    window.get_by_label("Resample").click();
    window.run();
    let mut resampled = source;
    resampled.options.selection.resample = true;
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(resampled)))]);
}

#[test]
fn a_file_without_a_header_is_opened_as_somebody_says_that_it_lies() {
    let mut window = wide(document());
    let source = Source::of(Path::new("foot.raw"));
    let guess = RawLayout::guessed("foot.raw", 1000).map(Box::new);
    window.state_mut().chooser.ask(
        source.clone(),
        asked(Unknown::Layout { bytes: 1000, guess }),
        &Selection::default(),
    );
    window.run();
    assert!(window.query_by_label_contains("all 1000 bytes").is_some(), "a cube");
    window.get_by_label("Open").click();
    window.run();
    let cube = RawLayout::new([10; 3], VoxelType::U8);
    let mut said = source.clone();
    said.options.raw = Some(cube.clone());
    assert_eq!(saved_or_opened(&window), [Action::Leave(Leaving::Open(Box::new(said)))]);

    // The file is too short for this guess, which therefore yields no volume.
    let guess = Some(Box::new(RawLayout { voxel_type: VoxelType::F64, ..cube }));
    window.state_mut().chooser.ask(source, asked(Unknown::Layout { bytes: 1000, guess }), &Selection::default());
    window.run();
    assert!(window.get_by_label("Open").accesskit_node().is_disabled());
    // Neither a click outside the dialog nor Escape in a field discards the input.
    for escapes in 0..2 {
        drag_along(&mut window, &[Pos2::new(900.0, 20.0)]);
        assert!(window.state().chooser.is_open(), "after {escapes}");
        if escapes == 0 {
            window.get_by_role_and_label(Role::SpinButton, "bytes to skip").focus();
            window.run();
        }
        window.key_press(Key::Escape);
        window.run();
    }
    assert!(!window.state().chooser.is_open() && saved_or_opened(&window).len() == 1);
}

#[test]
fn what_was_changed_is_left_only_once_somebody_says_so() {
    let leaving = Leaving::Open(Box::new(Source::of(Path::new("other.toml"))));
    let answers = [
        ("Cancel", None),
        ("Open without saving", Some(Action::Leave(leaving.clone()))),
        ("Save session…", Some(Action::Choose(File::Session))),
    ];
    for (button, action) in answers {
        let mut window = wide(document());
        window.state_mut().losing.changes = true;
        window.state_mut().chooser.leave(leaving.clone());
        window.run();
        assert!(window.state().chooser.is_open());
        window.get_by_label(button).click();
        window.step();
        assert_eq!(window.state().asked.last().cloned(), action, "{button}");
        assert_eq!(window.state().chooser.is_open(), button.starts_with("Save"), "{button}");
    }
}

#[test]
fn a_tour_whose_pictures_are_not_all_there_is_left_only_once_somebody_says_so() {
    for (changes, button) in [(false, "Close now"), (true, "Close without saving")] {
        let mut window = wide(document());
        window.state_mut().losing = Losing { changes, tour: true, picture: !changes, page: false };
        window.state_mut().chooser.leave(Leaving::Close);
        window.run();
        assert!(is_painted(&window, "A tour is being saved"));
        assert_eq!(is_painted(&window, "not saved as a session"), changes);
        assert_eq!(is_painted(&window, "waits for the full resolution"), !changes);
        assert_eq!(window.query_by_label("Save session…").is_some(), changes);
        window.get_by_label(button).click();
        window.step();
        assert_eq!(window.state().asked.last(), Some(&Action::Leave(Leaving::Close)));
    }
    // After the last picture of the tour there is nothing left to ask.
    let mut window = wide(document());
    window.state_mut().losing.tour = true;
    window.state_mut().chooser.leave(Leaving::Close);
    window.run();
    assert!(window.state().asked.is_empty());
    window.state_mut().losing.tour = false;
    window.run();
    assert_eq!(window.state().asked, [Action::Leave(Leaving::Close)]);
}

#[test]
fn a_dialog_has_the_keyboard_from_what_lies_behind_it() {
    for opens in ["Ctrl+O", "Open…"] {
        let mut window = wide(document());
        window.run();
        for _ in 0..3 {
            window.key_press(Key::Tab);
            window.run();
        }
        if opens == "Ctrl+O" {
            window.key_press_modifiers(Modifiers::COMMAND, Key::O);
        } else {
            window.state_mut().chooser.open(File::Opened, Path::new("."));
        }
        window.step();
        until_listed(&mut window);
        assert!(window.state().chooser.is_open());
        window.key_press(Key::Escape);
        window.run();
        assert!(!window.state().chooser.is_open(), "{opens}");
    }
}

#[test]
fn nothing_is_offered_to_be_saved_while_nothing_is_open() {
    let mut window = App::open(Vec2::new(1280.0, 720.0), None);
    window.run();
    window.get_by_label("File").click();
    window.run();
    for line in ["Save session as", "Save picture as", "Save film"] {
        assert!(window.get_by_label_contains(line).accesskit_node().is_disabled(), "{line}");
    }
}

#[test]
fn a_linear_picture_is_openexr_whatever_its_name_is_typed_as() {
    let mut window = wide(document());
    file_menu(&mut window, "Save linear picture as");
    until_listed(&mut window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run();
    window.event(Event::Text("light".to_owned()));
    window.run();
    window.key_press(Key::Enter);
    until_listed(&mut window);
    let path = window.state().folder.path("light.exr");
    assert_eq!(saved_or_opened(&window), [Action::SavePicture(Some(path))]);
}
