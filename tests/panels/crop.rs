//! Editing of the crop box by dragging on the picture and by typing.

use egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use relume::document::Edit;
use relume::document::moves::{Move, Side};

use crate::app::{App, document, drag_along, is_painted, retype, type_into, wide};

#[test]
fn a_side_of_the_crop_box_is_dragged_on_the_picture() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    window.get_by_label("crop").click();
    window.run();
    let crop = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().crop();
    assert_eq!(crop(&window), Some([DVec3::ZERO, DVec3::ONE]));
    let at = window.get_by_label("crop box: x to").rect().center();
    let across = window.get_by_label("crop box: x from").rect().center() - at;
    let to = at + 0.4 * across;
    window.event(Event::PointerMoved(at));
    window.run();
    for (pos, pressed) in [(at, true), (to, true), (to, false)] {
        window.event(Event::PointerMoved(pos));
        window.run();
        let button = PointerButton::Primary;
        window.event(Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE });
        window.run();
    }
    let [low, high] = crop(&window).unwrap();
    assert!((high.x - 0.6).abs() < 0.02, "{high}");
    assert_eq!((low, high.y, high.z), (DVec3::ZERO, 1.0, 1.0), "the other sides stay");
    window.get_by_label("Undo").click();
    window.run();
    window.get_by_label("Reset crop").click();
    window.run();
    assert_eq!(crop(&window), None, "as the scene has it");
}

#[test]
fn of_two_handles_on_one_spot_the_nearer_one_is_caught() {
    for (side, near) in [(Side::Front, "−y"), (Side::Back, "+y"), (Side::Left, "−x"), (Side::Top, "+z")] {
        let mut document = document();
        document.edit(&Edit::Camera(Move::Axis(side), 1.5));
        document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
        let mut window = wide(document);
        window.run();
        let [from, to] = ["from", "to"].map(|end| format!("crop box: {} {end}", near.trim_start_matches(['−', '+'])));
        let (end, other) = if near.starts_with('−') { (from, to) } else { (to, from) };
        let [at, behind] = [&end, &other].map(|label| window.get_by_label(label).rect().center());
        assert!(at.distance(behind) < 1.0, "{near}: both are on one spot");
        window.event(Event::PointerMoved(at));
        window.run_steps(60);
        let told = format!(
            "faces you: turn the camera to drag it, or type its number: {}",
            end.trim_start_matches("crop box: ")
        );
        assert!(is_painted(&window, &told), "{told}");
    }
}

#[test]
fn a_side_of_the_crop_box_that_is_typed_past_the_other_stops_there_and_says_so() {
    let mut document = document();
    document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    type_into(&mut window, "crop x: to", "0.1");
    window.key_press(Key::Enter);
    window.run();
    let [low, high] = window.state().document.as_ref().unwrap().state().crop().unwrap();
    assert!((low.x - 0.25).abs() < 1e-9 && (high.x - 0.25).abs() < 2e-3, "{low} {high}");
    assert!(is_painted(&window, "“from”, which is 0.2500"));
}

#[test]
fn a_side_of_the_crop_box_that_faces_the_eye_says_that_it_cannot_be_dragged() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    document.edit(&Edit::Camera(Move::Projection, 1.5));
    document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
    let mut window = wide(document);
    window.run();
    let handle = window.get_by_label("crop box: y to").rect().center();
    window.event(Event::PointerMoved(handle));
    window.run_steps(60);
    assert!(is_painted(&window, "faces you: turn the camera to drag it"));
    window.event(Event::PointerMoved(window.get_by_label("crop box: x to").rect().center()));
    window.run_steps(60);
    assert!(is_painted(&window, "Drag this side of the box"));
}

#[test]
fn a_handle_of_the_crop_box_is_caught_within_ten_points_and_says_which_side_it_is() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    document.edit(&Edit::Crop(Some([DVec3::splat(0.25), DVec3::splat(0.75)])));
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(document));
    window.run();
    let handle = window.get_by_label("crop box: x to").rect();
    assert!(handle.width() >= 20.0 && handle.height() >= 20.0, "{handle:?}");
    window.event(Event::PointerMoved(handle.center() + Vec2::new(9.0, -9.0)));
    window.run_steps(60);
    assert!(is_painted(&window, "x to 0.75"));
}

#[test]
fn a_side_of_the_crop_box_stops_at_the_other_which_stays() {
    let mut document = document();
    document.edit(&Edit::Crop(Some([DVec3::ZERO, DVec3::splat(0.75)])));
    document.rest();
    let crop = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().crop().unwrap();
    let mut window = wide(document.clone());
    window.run();
    let [from, to] = ["x from", "x to"].map(|end| window.get_by_label(&format!("crop box: {end}")).rect().center());
    let way: Vec<Pos2> = (0..=40_u8).map(|part| from.lerp(to, 1.5 * f32::from(part) / 40.0)).collect();
    drag_along(&mut window, &way);
    let [low, high] = crop(&window);
    assert!((high - DVec3::splat(0.75)).length() < 1e-9 && low.x > 0.74 && low.x < high.x, "{low} {high}");
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    for _ in 0..3 {
        retype(&mut window, "crop x: from", "0.9");
        let [low, high] = crop(&window);
        assert!((high - DVec3::splat(0.75)).length() < 1e-9 && low.x > 0.74 && low.x < high.x, "{low} {high}");
    }
}

#[test]
fn a_handle_that_can_be_dragged_lies_over_one_that_cannot() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Left), 1.5));
    document.edit(&Edit::Crop(Some([DVec3::new(0.25, 0.25, 0.49), DVec3::new(0.75, 0.75, 0.51)])));
    let mut window = wide(document);
    window.run();
    let [at, facing] = ["crop box: z to", "crop box: x from"].map(|label| window.get_by_label(label).rect().center());
    assert!(at.distance(facing) < 11.0, "one lies over the other");
    window.event(Event::PointerMoved(facing));
    window.run_steps(60);
    assert!(is_painted(&window, "Drag this side of the box: z"), "not the side that faces the eye");
}
