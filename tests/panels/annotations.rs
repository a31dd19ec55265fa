//! Annotations over the picture, the measuring line and the help.

use std::path::PathBuf;
use std::sync::Arc;

use egui::{Event, Key, Modifiers, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document::moves::Move;
use relume::document::{Document, Edit, Source};
use relume::view::layout::{Arrange, Note};
use relume::view::script::Command;
use relume::view::{Action, Script};
use relume::volume::{Unit, Volume};

use crate::app::{App, click_at, document, is_painted};

/// A window with an anatomical volume in millimetres.
fn opened() -> Harness<'static, App> {
    let mut scene = document().opened().clone();
    let volume = (**scene.scene.volume()).clone();
    let volume = Volume { anatomical: true, unit: Some(Unit::Millimetre), ..volume };
    scene.scene.set_volume(Arc::new(volume));
    let statistics = scene.scene.volume().statistics().unwrap();
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(Document::new(scene).with_statistics(statistics)));
    window.run();
    window
}

fn arrange(window: &mut Harness<'_, App>, change: Arrange) {
    window.state_mut().layout.arrange(change);
    window.run();
}

#[test]
fn the_scale_bar_has_the_unit_of_the_file_and_says_where_it_applies() {
    let mut window = opened();
    let orthographic = Edit::Camera(Move::Projection, 1.5);
    assert!(is_painted(&window, " mm at the target"), "a camera with perspective");
    window.state_mut().document.as_mut().unwrap().edit(&orthographic);
    window.run();
    assert!(is_painted(&window, " mm") && !is_painted(&window, "at the target"), "parallel rays");
    arrange(&mut window, Arrange::Note(Note::Scale, false));
    assert!(!is_painted(&window, " mm"));
    arrange(&mut window, Arrange::Note(Note::Scale, true));
    window.state_mut().panels = false;
    window.run();
    assert!(!is_painted(&window, " mm"), "F1 hides it with the panels");
}

#[test]
fn letters_stand_at_the_edges_of_a_picture_of_a_patient() {
    let mut window = opened();
    window.state_mut().document.as_mut().unwrap().edit(&Edit::Camera(Move::Reset, 1.5));
    window.run();
    // The drawing of the axes in the corner has single letters, too.
    let count = |window: &Harness<'_, App>| {
        let is_letter = |text: &str| ["R", "L", "A", "P", "S", "I"].contains(&text);
        let shapes = &window.output().shapes;
        let texts = shapes.iter().filter_map(|clipped| match &clipped.shape {
            egui::Shape::Text(text) => Some(text.galley.text().to_owned()),
            _ => None,
        });
        texts.filter(|text| is_letter(text)).count()
    };
    let with = count(&window);
    arrange(&mut window, Arrange::Note(Note::Letters, false));
    assert!(with >= count(&window) + 12, "two letters with their outlines, at least");
}

#[test]
fn the_legend_names_the_visible_materials() {
    let mut window = opened();
    assert!(window.query_by_label("legend").is_none());
    window.key_press(Key::L);
    window.run();
    let [legend, picture] = ["legend", "picture"].map(|label| window.get_by_label(label).rect());
    assert!(picture.expand(8.0).contains_rect(legend), "{legend:?}");
    let names = |window: &Harness<'_, App>| {
        let shapes = &window.output().shapes;
        let inside = shapes.iter().filter_map(|clipped| match &clipped.shape {
            egui::Shape::Text(text) if legend.contains(text.pos) => Some(text.galley.text().to_owned()),
            _ => None,
        });
        inside.collect::<Vec<_>>()
    };
    for name in ["flesh", "day", "lamp"] {
        assert!(names(&window).contains(&name.to_owned()), "no {name}: {:?}", names(&window));
    }
    let curves = |window: &Harness<'_, App>| {
        let shapes = &window.output().shapes;
        let is_curve = |shape: &egui::Shape| matches!(shape, egui::Shape::Path(path) if path.points.len() == 81 && legend.contains(path.points[0]));
        shapes.iter().filter(|clipped| is_curve(&clipped.shape)).count()
    };
    assert_eq!(curves(&window), names(&window).len(), "each has its spectrum");
    window.state_mut().document.as_mut().unwrap().edit(&Edit::On(1, false));
    window.run();
    assert!(!names(&window).contains(&"lamp".to_owned()), "it is off: {:?}", names(&window));
    window.key_press(Key::L);
    window.run();
    assert!(window.query_by_label("legend").is_none());
}

#[test]
fn the_title_over_the_picture_is_the_name_of_the_file() {
    let mut window = opened();
    let is_shown = |window: &Harness<'_, App>| {
        let text = |clipped: &egui::epaint::ClippedShape| matches!(&clipped.shape, egui::Shape::Text(text) if text.galley.text() == "body.nrrd");
        window.output().shapes.iter().any(text)
    };
    assert!(!is_shown(&window));
    arrange(&mut window, Arrange::Note(Note::Title, true));
    assert!(is_shown(&window));
}

#[test]
fn two_clicks_in_a_slice_measure_their_distance() {
    let mut window = opened();
    arrange(&mut window, Arrange::Slices(true));
    window.run();
    window.key_press(Key::M);
    window.run();
    let at = window.get_by_label("slice: axial").rect().center();
    for by in [Vec2::new(-30.0, 0.0), Vec2::new(30.0, 0.0)] {
        click_at(&mut window, at + by);
    }
    let ruler = window.state().layout.ruler;
    let [Some(from), Some(to)] = ruler.ends else { panic!("{ruler:?}") };
    let length = ruler.length().unwrap();
    assert!(length > 0.0 && ((to - from).x.abs() - length).abs() < 1e-9, "along one axis: {from} to {to}");
    assert!(window.state().layout.slices.at.is_none(), "the crosshair stays");
    let digits: f64 = format!("{length:.3e}").parse().unwrap();
    assert!(is_painted(&window, &format!("{digits} mm")), "{digits}");
}

#[test]
fn a_click_in_the_picture_asks_for_the_depth_of_an_end() {
    let mut window = opened();
    window.key_press(Key::M);
    window.run();
    assert!(is_painted(&window, "Click an end of the line"));
    let picture = window.state().place;
    click_at(&mut window, picture.min + picture.size() * Vec2::new(0.25, 0.5));
    let Some(Action::RulerAt(place)) = window.state().asked.last() else { panic!("{:?}", window.state().asked) };
    assert!((*place - DVec2::new(0.25, 0.5)).length() <= 1e-3, "{place}");
    window.key_press(Key::M);
    window.run();
    click_at(&mut window, picture.center());
    assert!(matches!(window.state().asked.last(), Some(Action::Probe(Some(_)))));
}

#[test]
fn a_question_mark_lists_the_keys_and_escape_closes_the_list() {
    let mut window = opened();
    for (modifiers, key) in [(Modifiers::NONE, Key::Questionmark), (Modifiers::SHIFT, Key::Slash)] {
        window.key_press_modifiers(modifiers, key);
        window.run();
        for label in ["perspective or orthographic", "next slice", "switch it off or on", "this help"] {
            assert!(window.query_by_label(label).is_some(), "{label}");
        }
        window.key_press(Key::Escape);
        window.run();
        assert!(window.query_by_label("this help").is_none());
    }
}

#[test]
fn the_first_minute_goes_on_step_by_step_to_its_end() {
    let mut window = opened();
    arrange(&mut window, Arrange::Help(true));
    window.get_by_label("Show me around").click();
    window.run();
    for title in ["Turn the volume", "Change the light", "Ask a pixel", "Choose what is visible", "Look inside"] {
        assert!(window.query_by_label(title).is_some() && window.query_by_label("this help").is_none(), "{title}");
        window.get_by_label("Next").click();
        window.run();
    }
    window.get_by_label("Done").click();
    window.run();
    assert_eq!(window.state().layout.lesson, None);
}

#[test]
fn the_menu_opens_a_recent_file() {
    let mut window = opened();
    let file = PathBuf::from("/data/heads/head.mhd");
    window.state_mut().recent = vec![file.clone()];
    window.run();
    window.get_by_label("File").click();
    window.run();
    let menu = window.get_by_label_contains("Open recent").rect().center();
    window.event(Event::PointerMoved(menu));
    window.run();
    click_at(&mut window, menu);
    window.get_by_label("head.mhd").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Open(Box::new(Source::of(&file)))));
}

#[test]
fn scripts_set_annotations_line_and_help() {
    let of = |line: &str| Script::parse("test", line).map(|script| script.command(0).cloned().unwrap());
    for (line, change) in [
        ("note scale off", Arrange::Note(Note::Scale, false)),
        ("note letters on", Arrange::Note(Note::Letters, true)),
        ("note legend on", Arrange::Note(Note::Legend, true)),
        ("ruler on", Arrange::Ruler(true)),
        ("ruler world 1 2 3", Arrange::RulerEnd(glam::DVec3::new(1.0, 2.0, 3.0))),
        ("help on", Arrange::Help(true)),
        ("lesson 2", Arrange::Lesson(Some(1))),
        ("lesson 0", Arrange::Lesson(None)),
    ] {
        assert_eq!(of(line).unwrap(), Command::Do(Action::Arrange(change)), "{line}");
    }
    assert_eq!(of("ruler at 0.25 0.5").unwrap(), Command::Ruler(DVec2::new(0.25, 0.5)));
    for (line, told) in
        [("note x on", "scale, letters, legend or title"), ("ruler", "at X Y"), ("ruler at 1", "2 numbers")]
    {
        let error = of(line).unwrap_err().to_string();
        assert!(error.contains(told), "{line}: {error}");
    }
}
