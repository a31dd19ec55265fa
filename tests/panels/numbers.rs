//! Typed numbers.

use std::path::Path;

use egui::{Event, Key, Modifiers, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{DVec2, DVec3};
use relume::document;
use relume::document::SceneOptions;
use relume::document::{Document, Edit};
use relume::progress::Quiet;
use relume::scene::Interval;
use relume::view::Action;

use crate::app::{App, click_at, document, intervals, is_painted, painted_in, retype, type_into, wide, with_histogram};
use crate::support::program::{DIAL, SCENE};

/// Replaces the contents of a field with `text` and keeps the focus there.
fn type_unfinished(window: &mut Harness<'_, App>, label: &str, text: &str) {
    window.get_by_label(label).click();
    window.run();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.run();
    window.event(Event::Text(text.to_owned()));
    window.run();
}

#[test]
fn a_typed_number_holds_once_enter_is_pressed_and_is_one_step_back() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    type_into(&mut window, "interval 0: to", "85");
    assert_eq!(intervals(&window), before, "not yet");
    window.key_press(Key::Enter);
    window.run();
    assert_eq!(intervals(&window)[0], Interval { range: [before[0].range[0], 85.0], ..before[0] });
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(intervals(&window), before);
}

#[test]
fn a_number_that_no_hand_may_reach_stays_as_the_scene_has_it() {
    // A step length below the field's range, and an exposure above its slider's.
    let text = format!("{SCENE}{DIAL}[accuracy]\nstep = 0.001\n[display]\nexposure = 1000\n");
    let scene = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(Document::new(scene)));
    window.run();
    assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
    assert!(window.state().document.as_ref().unwrap().is_saved());
}

#[test]
fn a_field_that_is_left_as_it_was_changes_nothing_though_it_shows_fewer_digits() {
    let mut document = document();
    let stated = document.state().scene.transfer.terms[0].as_interval().unwrap();
    document.edit(&Edit::Interval(0, Interval { opacity: 0.123_456_7, ..stated }));
    let mut window = App::open(Vec2::new(1000.0, 2000.0), Some(document));
    window.run();
    type_into(&mut window, "interval 0: opacity", "");
    window.key_press(Key::Enter);
    window.run();
    assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
}

#[test]
fn what_is_typed_and_is_no_number_changes_nothing_and_says_so() {
    for text in ["thick", "0,5", "inf", "1e999", ""] {
        for label in ["interval 0: opacity", "day: strength"] {
            let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
            window.run();
            retype(&mut window, label, text);
            assert!(window.state().asked.is_empty(), "{label} {text}: {:?}", window.state().asked);
            assert!(is_painted(&window, &format!("“{text}” is not a number")), "{label} {text}");
        }
    }
}

#[test]
fn what_is_typed_and_is_too_much_says_what_became_of_it() {
    for (typed, told, opacity) in [("2", "2 is more than the limit: the value is now 1.", 1.0), ("0.5", "", 0.5)] {
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
        window.run();
        let before = intervals(&window)[0];
        type_into(&mut window, "interval 0: opacity", typed);
        window.key_press(Key::Enter);
        window.run();
        assert_eq!(intervals(&window)[0], Interval { opacity, ..before });
        assert_eq!(is_painted(&window, "than the limit"), !told.is_empty(), "{typed}");
        assert!(is_painted(&window, told), "{typed}");
    }
}

#[test]
fn escape_leaves_a_number_as_it_was() {
    for label in ["master", "interval 0: opacity", "crop x: to", "tour: seconds"] {
        let mut document = document();
        document.edit(&Edit::Crop(Some([DVec3::ZERO, DVec3::splat(0.75)])));
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
        window.run();
        type_unfinished(&mut window, label, "0.5");
        window.key_press(Key::Escape);
        window.run();
        window.run();
        assert!(window.state().asked.is_empty(), "{label}: {:?}", window.state().asked);
        assert!(!is_painted(&window, "0.5"), "{label}");
        // The field still works afterwards.
        type_unfinished(&mut window, "master", "0.25");
        window.key_press(Key::Enter);
        window.run();
        assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Master(0.25))), "{label}");
    }
}

#[test]
fn what_is_typed_holds_before_a_key_saves_opens_or_closes() {
    for (key, action) in [
        (Some(Key::S), Action::SaveSession(None)),
        (Some(Key::P), Action::SavePicture(None)),
        (Some(Key::Q), Action::Close),
        (None, Action::Close),
    ] {
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
        window.run();
        type_unfinished(&mut window, "master", "0.5");
        assert!(window.state().asked.is_empty(), "it is not left yet");
        match key {
            Some(key) => window.key_press_modifiers(Modifiers::COMMAND, key),
            None => window.state_mut().closes = true,
        }
        window.step();
        assert_eq!(window.state().asked, [Action::Edit(Edit::Master(0.5)), action], "{key:?}");
    }
}

#[test]
fn a_step_back_while_a_number_is_typed_takes_what_is_typed_back() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    let master = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().master();
    let before = master(&window);
    type_unfinished(&mut window, "master", "0.5");
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run();
    window.run();
    assert_eq!(master(&window), before);
    assert_eq!(window.state().asked, [Action::Edit(Edit::Master(0.5)), Action::Undo], "nothing comes after it");
}

#[test]
fn what_is_typed_holds_before_what_is_clicked_then() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.rest();
    for (button, action) in
        [("Undo", Action::Undo), ("Tour", Action::Tour(Some(8.0))), ("save the tour", Action::SaveTour(None, 50))]
    {
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document.clone()));
        window.run();
        type_unfinished(&mut window, "interval 0: opacity", "0.5");
        assert!(window.state().asked.is_empty());
        window.get_by_label(button).click();
        window.run();
        assert!(
            matches!(&*window.state().asked, [Action::Edit(Edit::Interval(0, _)), last] if *last == action),
            "{button}: {:?}",
            window.state().asked
        );
    }
}

#[test]
fn a_slider_that_is_typed_below_nothing_says_that_it_became_nothing() {
    for (typed, told, weight) in [("-1", "-1 is less than the limit: the value is now 0.", 0.0), ("5", "", 5.0)] {
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
        window.run();
        retype(&mut window, "Exposure", typed);
        let display = &window.state().document.as_ref().unwrap().state().scene.display;
        assert!((display.factor() - weight).abs() < 1e-9, "{typed}: {}", display.factor());
        assert_eq!(is_painted(&window, "than the limit"), !told.is_empty(), "{typed}");
        assert!(is_painted(&window, told), "{typed}");
    }
}

#[test]
fn values_of_three_hundred_digits_leave_the_panels_as_they_are() {
    let width = |scale: f64| {
        let mut document = document();
        let stated = document.state().scene.transfer.terms[0].as_interval().unwrap();
        document.edit(&Edit::Interval(0, Interval { range: [1.234_567_89 * scale, 2.0 * scale], ..stated }));
        let mut statistics = document.opened().scene.volume().statistics().unwrap();
        (statistics.min, statistics.max) = (-3.0 * scale, 3.0 * scale);
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document.with_statistics(statistics)));
        window.run();
        let left = window.state().place.left();
        // Leaving a field unchanged keeps the value's hidden digits.
        type_into(&mut window, "interval 0: from", "");
        window.key_press(Key::Enter);
        window.run();
        assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
        left
    };
    for scale in [1e300, 1e12, 1e-12, 1e-300] {
        assert!((width(scale) - width(10.0)).abs() < 0.5, "{scale}");
    }
}

#[test]
fn values_that_differ_in_their_last_digits_alone_can_be_typed() {
    for (low, span, typed) in [(1.0, 1e-5, "1.000004"), (1e9, 1000.0, "1000000123"), (-3e-20, 1e-21, "-2.95e-20")] {
        let mut document = document();
        let stated = document.state().scene.transfer.terms[0].as_interval().unwrap();
        let interval = Interval { range: [low + 0.3 * span, low + 0.6 * span], ramp: 0.0, ..stated };
        document.edit(&Edit::Interval(0, interval));
        let mut statistics = document.opened().scene.volume().statistics().unwrap();
        (statistics.min, statistics.max) = (low, low + span);
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document.with_statistics(statistics)));
        window.run();
        type_into(&mut window, "interval 0: from", typed);
        window.key_press(Key::Enter);
        window.run();
        let from = intervals(&window)[0].range[0];
        assert_eq!(from.to_bits(), typed.parse::<f64>().unwrap().to_bits(), "{typed}: {from}");
    }
}

#[test]
fn a_long_number_takes_no_room_from_the_picture() {
    let mut window = wide(document());
    window.run();
    let place = window.state().place;
    type_unfinished(&mut window, "master", "0.12345678901234567890123456789012345678901234567890");
    window.run();
    assert_eq!(window.state().place, place);
    window.key_press(Key::Enter);
    window.run();
    assert_eq!(window.state().place, place);
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::Master(_)))));
}

#[test]
fn what_is_said_of_a_number_is_clicked_through_and_goes_with_it() {
    let told = "2 is more than the limit";
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    retype(&mut window, "interval 0: opacity", "2");
    assert!(is_painted(&window, told));
    // The error message covers the field below.
    let below = window.get_by_label("remove interval 1").rect().center();
    click_at(&mut window, below);
    window.run();
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::RemoveTerm(1)))));
    assert!(is_painted(&window, told), "it can still be read");
    for _ in 0..2 {
        window.get_by_label("Undo").click();
        window.run();
    }
    window.run();
    assert!(!is_painted(&window, told), "the number is another one");
}

#[test]
fn fields_show_seven_digits_at_most_and_do_not_lie_over_each_other() {
    // Constant volumes, and one whose values differ in their last digits alone.
    for (low, high) in
        [(0.0, 0.0), (87.0, 87.0), (-1.0 / 3.0, -1.0 / 3.0), (4.1e9, 4.1e9), (12_345.678_901, 12_345.678_902)]
    {
        let mut document = document();
        let stated = document.state().scene.transfer.terms[0].as_interval().unwrap();
        document.edit(&Edit::Interval(0, Interval { range: [low, high], ..stated }));
        let mut statistics = document.opened().scene.volume().statistics().unwrap();
        (statistics.min, statistics.max) = (low, high);
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document.with_statistics(statistics)));
        window.run();
        for label in ["window: Level", "window: Width", "interval 0: from", "interval 0: to", "interval 0: ramp"] {
            let shown = painted_in(&window, window.get_by_label(label).rect()).concat();
            let digits = shown.split('e').next().unwrap().trim_start_matches(['-', '0', '.']);
            let digits = digits.chars().filter(char::is_ascii_digit).count();
            assert!(!shown.is_empty() && digits <= 7 && shown.len() <= 12, "{label} of {low}: {shown}");
            let number: f64 = shown.parse().unwrap();
            let is = match label {
                "window: Level" | "interval 0: from" => low,
                "interval 0: to" => high,
                "window: Width" => 0.0,
                _ => stated.ramp,
            };
            assert!((number - is).abs() <= 1e-6 * is.abs().max(1.0), "{label} of {low}: {shown}");
        }
        let button = window.get_by_label("Apply window").rect();
        let fields = ["window: Level", "window: Width"].map(|label| window.get_by_label(label).rect());
        let [level, width] = fields;
        assert!(
            !level.intersects(width) && !width.intersects(button) && level.width() < 120.0,
            "{fields:?} {button:?}"
        );
    }
}
