//! Camera movement by keys, buttons and the wheel.

use std::sync::Arc;

use egui::{Event, Key, Modifiers, MouseWheelUnit, Pos2, TouchPhase, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use relume::document::moves::{Move, Side};
use relume::document::{Document, Edit};
use relume::view::Action;
use relume::volume::Volume;

use crate::app::{App, document, wide};

#[test]
fn keys_move_the_camera() {
    let mut window = wide(document());
    window.run();
    let keys = [
        (Key::ArrowLeft, Move::Orbit { right: -5.0, up: 0.0 }),
        (Key::Num6, Move::Axis(Side::Top)),
        (Key::P, Move::Projection),
        (Key::R, Move::Reset),
    ];
    for (key, expected) in keys {
        window.key_press(key);
        window.run();
        let last = window.state().asked.last();
        assert!(matches!(last, Some(Action::Edit(Edit::Camera(step, _))) if *step == expected), "{key:?}: {last:?}");
    }
}

#[test]
fn plus_goes_nearer_with_shift_and_without() {
    let mut window = wide(document());
    window.run();
    for (modifiers, key) in
        [(Modifiers::SHIFT, Key::Plus), (Modifiers::SHIFT, Key::Equals), (Modifiers::NONE, Key::Equals)]
    {
        window.state_mut().asked.clear();
        window.key_press_modifiers(modifiers, key);
        window.run();
        let asked = &window.state().asked;
        assert!(matches!(asked[..], [Action::Edit(Edit::Camera(Move::Dolly(nearer), _))] if nearer > 1.0), "{asked:?}");
    }
}

#[test]
fn the_sides_of_a_patient_are_called_so() {
    for (anatomical, names) in [(false, ["Left", "Front", "Top"]), (true, ["Right", "Anterior", "Superior"])] {
        let mut scene = document().opened().clone();
        let volume = Volume { anatomical, ..(**scene.scene.volume()).clone() };
        scene.scene.set_volume(Arc::new(volume));
        let mut window = App::open(Vec2::new(1000.0, 2000.0), Some(Document::new(scene)));
        window.run();
        for (name, side) in names.into_iter().zip([Side::Left, Side::Front, Side::Top]) {
            window.get_by_label(name).click();
            window.run();
            let asked = window.state().asked.last();
            assert!(matches!(asked, Some(Action::Edit(Edit::Camera(Move::Axis(it), _))) if *it == side), "{name}");
        }
    }
}

#[test]
fn a_wheel_that_was_turned_over_the_panels_moves_no_camera() {
    let mut window = wide(document());
    window.run();
    let place = window.state().place;
    let turned = |window: &mut Harness<'_, App>, at: Pos2| {
        window.state_mut().asked.clear();
        window.event(Event::PointerMoved(at));
        window.step();
        window.event(Event::MouseWheel {
            unit: MouseWheelUnit::Line,
            delta: Vec2::new(0.0, 3.0),
            phase: TouchPhase::Move,
            modifiers: Modifiers::NONE,
        });
        window.step();
        // egui spreads a wheel event over several frames; the rest arrives with the pointer over the picture.
        window.event(Event::PointerMoved(place.center()));
        window.run();
        window.state().asked.iter().any(|action| matches!(action, Action::Edit(Edit::Camera(..))))
    };
    assert!(!turned(&mut window, Pos2::new(100.0, 400.0)), "over the panels");
    assert!(turned(&mut window, place.center()), "over the picture");
}
