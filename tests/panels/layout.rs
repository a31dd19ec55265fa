//! Layout of the panels in windows of any size.

use std::path::Path;

use egui::accesskit::Role;
use egui::{Event, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document;
use relume::document::SceneOptions;
use relume::document::{Document, Edit};
use relume::progress::Quiet;
use relume::scene::Projection;
use relume::view::Action;

use crate::app::{App, click_at, document, drag_along, is_painted, probed, wide, with_histogram};
use crate::support::program::{DIAL, SCENE};

#[test]
fn an_empty_window_of_any_size_shows_what_to_do() {
    for size in [[1.0, 1.0], [300.0, 200.0], [1280.0, 720.0]] {
        App::open(Vec2::from(size), None).run();
        App::open(Vec2::from(size), Some(document())).run();
    }
}

#[test]
fn the_bar_of_the_panels_lies_over_no_control() {
    let document = document();
    let statistics = document.opened().scene.volume().statistics().unwrap();
    let mut window = App::open(Vec2::new(1000.0, 720.0), Some(document.with_statistics(statistics)));
    window.run();
    let solo = window.get_all_by_label("solo").next().unwrap().rect();
    click_at(&mut window, Pos2::new(solo.right() - 1.0, solo.center().y));
    assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Solo(Some(0)))));
    // A wider control would push the scroll bar out of sight: margins, indent and bar leave 255 of the panel's 300
    // points.
    let left = window.get_by_label("light dial").rect().left();
    for label in ["light dial", "10° (1964)", "Top", "Forget", "remove interval 0", "Measure the curve"] {
        let control = window.get_by_label(label).rect();
        assert!(control.right() <= left + 256.0, "{label}: {control:?} from {left}");
    }
}

#[test]
fn a_window_over_a_picture_that_was_small_goes_back_to_where_it_was() {
    let mut window = wide(document());
    window.state_mut().design = true;
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probed())));
    window.run();
    let title = |window: &Harness<'_, App>, name: &str| window.get_by_role_and_label(Role::Window, name).rect().min;
    for name in ["Probe", "Palette"] {
        let (small, large) = (Vec2::new(640.0, 480.0), Vec2::new(1280.0, 720.0));
        let before = title(&window, name);
        for size in [small, large] {
            window.set_size(size);
            window.run();
            window.run();
        }
        assert_eq!(title(&window, name), before, "{name}");
        let at = before + Vec2::new(40.0, 10.0);
        drag_along(&mut window, &[at, at + Vec2::new(30.0, 40.0), at + Vec2::new(60.0, 90.0)]);
        window.run();
        let put = title(&window, name);
        assert_ne!(put, before, "{name}");
        for size in [small, large] {
            window.set_size(size);
            window.run();
            window.run();
        }
        assert_eq!(title(&window, name), put, "{name}: where a hand has put it");
    }
}

#[test]
fn the_transfer_function_comes_right_after_the_lights_and_the_camera_says_which_rays_it_has() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    let panels = ["Lights", "Light dial", "Dial presets", "Transfer function", "Display", "Camera", "Accuracy"];
    let tops = panels.map(|panel| window.get_all_by_label(panel).next().unwrap().rect().top());
    assert!(tops.is_sorted(), "{tops:?}");
    let is_parallel = |window: &Harness<'_, App>| {
        let document = window.state().document.as_ref().unwrap();
        matches!(document.state().scene.camera.projection, Projection::Orthographic { .. })
    };
    for (choice, parallel) in
        [("Perspective", false), ("Orthographic", true), ("Orthographic", true), ("Perspective", false)]
    {
        window.get_by_label(choice).click();
        window.run();
        assert_eq!(is_parallel(&window), parallel, "{choice}");
    }
}

#[test]
fn an_empty_window_offers_the_scene_of_the_program() {
    let mut window = App::open(Vec2::new(1280.0, 720.0), None);
    window.run();
    assert!(
        window.query_by_label_contains("nothing is open  |").is_some()
            && window.query_by_label_contains("preparing").is_none()
    );
    window.get_by_label("Open the built-in scene").click();
    window.run();
    assert_eq!(window.state().asked, [Action::Open(Box::default())]);
}

#[test]
fn no_tooltip_is_seen_while_a_button_is_held_nor_until_the_pointer_goes_on() {
    let mut window = with_histogram();
    window.run();
    let dial = window.get_by_label("light dial").rect().center();
    window.event(Event::PointerMoved(dial));
    // Longer than the delay of a tooltip.
    window.run_steps(60);
    let help = "Drag the hand between the lights";
    assert!(is_painted(&window, help), "a pointer that rests is told");
    let button = PointerButton::Primary;
    for place in [dial, dial + Vec2::new(3.0, 2.0), dial + Vec2::new(30.0, 20.0)] {
        window.event(Event::PointerButton { pos: place, button, pressed: true, modifiers: Modifiers::NONE });
        window.event(Event::PointerMoved(place));
        window.run_steps(60);
        assert!(!is_painted(&window, help), "held at {place}");
    }
    let last = dial + Vec2::new(30.0, 20.0);
    window.event(Event::PointerButton { pos: last, button, pressed: false, modifiers: Modifiers::NONE });
    window.run_steps(60);
    assert!(!is_painted(&window, help), "nor where something was moved to just now");
    window.event(Event::PointerMoved(last - Vec2::new(20.0, 0.0)));
    window.run_steps(60);
    assert!(is_painted(&window, help), "who goes on is told again");
}

#[test]
fn long_names_do_not_widen_the_panels() {
    let narrow = App::open(Vec2::new(1000.0, 2000.0), Some(document())).state().place.left();
    let text = format!("{SCENE}{DIAL}");
    for name in ["flesh", "day"] {
        let long = format!("{name}-{}", "of-a-very-long-name-".repeat(5));
        let text = text.replace(name, &long);
        let scene = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
        let mut window = App::open(Vec2::new(1000.0, 2000.0), Some(Document::new(scene)));
        window.run();
        assert!((window.state().place.left() - narrow).abs() < 1.0, "{name}: {}", window.state().place.left());
    }
}

#[test]
fn the_edge_of_the_panels_is_dragged() {
    let mut window = wide(document());
    window.run();
    let edge = |window: &Harness<'_, App>| window.state().place.left();
    let narrowest = edge(&window);
    for to in [420.0, narrowest] {
        let at = Pos2::new(edge(&window) + 1.0, 500.0);
        drag_along(&mut window, &[at, Pos2::new(at.x + (to - at.x) / 2.0, 500.0), Pos2::new(to, 500.0)]);
        window.run();
        assert!((edge(&window) - to).abs() < 4.0, "{to}: {}", edge(&window));
        assert!(!window.state().asked.iter().any(|action| matches!(action, Action::Edit(_))), "the camera stays");
    }
}
