//! Tours of the dial presets.

use egui::{Key, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document::moves::Move;
use relume::document::{Document, Edit};
use relume::view::Action;
use relume::view::tour::Tour;

use crate::app::{App, document, is_painted, type_into};

#[test]
fn a_tour_takes_as_long_and_saves_as_many_pictures_as_somebody_says() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    let press = |window: &mut Harness<'_, App>, button: &str| {
        window.get_by_label(button).click();
        window.run();
        window.state().asked.last().cloned()
    };
    assert_eq!(press(&mut window, "Tour"), Some(Action::Tour(Some(8.0))), "as usual");
    assert_eq!(press(&mut window, "save the tour"), Some(Action::SaveTour(None, 50)), "as usual");
    for (field, typed) in [("tour: seconds", "2.5"), ("tour: pictures", "1")] {
        type_into(&mut window, field, typed);
        window.key_press(Key::Enter);
        window.run();
    }
    assert!(is_painted(&window, "1 is less than the limit: the value is now 2."), "both ends of the way");
    assert_eq!(press(&mut window, "Tour"), Some(Action::Tour(Some(2.5))));
    assert_eq!(press(&mut window, "save the tour"), Some(Action::SaveTour(None, 2)));
}

#[test]
fn a_tour_that_is_saved_says_how_far_it_is_and_can_be_given_up() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.state_mut().tour = Some(Tour::Saving { path: "tour.png".into(), frames: 50, saved: 12, size: None });
    window.run();
    assert!(window.query_by_label_contains("12 of 50 pictures").is_some());
    assert!(window.state().place.contains_rect(window.get_by_label("Cancel").rect()));
    window.get_by_label("Cancel").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Tour(None)));
}

#[test]
fn a_camera_that_is_turned_while_a_tour_is_played_is_a_step_back_and_the_tour_another() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.rest();
    let looked = |document: &Document| (document.state().scene.camera.clone(), document.state().light.hand);
    let before = looked(&document);
    for frame in 1..=400 {
        document.edit(&Edit::Tour(frame, 400));
        if (100..300).contains(&frame) {
            document.edit(&Edit::Camera(Move::Orbit { right: 0.5, up: 0.0 }, 1.5));
        }
    }
    document.rest();
    let after = looked(&document);
    document.undo();
    assert_eq!(looked(&document).0, before.0, "the camera is where it was");
    document.undo();
    assert_eq!(looked(&document), before, "and so is the hand");
    assert!(document.can_undo(), "what was done before is not forgotten");
    document.redo();
    document.redo();
    assert_eq!(looked(&document), after);
}

#[test]
fn a_hand_that_lets_go_while_a_tour_is_played_begins_another_step_back() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.rest();
    let (terms, hand) = (document.state().scene.transfer.terms.len(), document.state().light.hand);
    for frame in 1..=40 {
        document.edit(&Edit::Tour(frame, 40));
        if frame % 20 == 10 {
            document.edit(&Edit::RemoveTerm(0));
        }
        document.rest_during_tour();
    }
    document.rest();
    for left in [terms - 1, terms] {
        document.undo();
        assert_eq!(document.state().scene.transfer.terms.len(), left);
    }
    document.undo();
    assert_eq!(document.state().light.hand, hand, "the tour is the step before");
}
