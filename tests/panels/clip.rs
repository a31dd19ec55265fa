//! Clip planes by buttons, numbers, and handles in the picture and in the slices.

use egui::Vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use relume::document::Edit;
use relume::document::moves::{Move, Side};
use relume::scene::{Clip, ClipPlane};

use crate::app::{App, click_at, document, drag_along, retype};
use crate::slices;

fn planes(window: &Harness<'_, App>) -> Vec<ClipPlane> {
    window.state().document.as_ref().unwrap().state().scene.clip.planes.clone()
}

fn part(window: &Harness<'_, App>, index: usize) -> f64 {
    planes(window)[index].part(&window.state().document.as_ref().unwrap().state().scene.frame)
}

fn opened() -> Harness<'static, App> {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Axis(Side::Front), 1.5));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    window
}

#[test]
fn a_plane_is_added_typed_flipped_dragged_switched_and_removed() {
    let mut window = opened();
    window.get_by_label("x").click();
    window.run();
    assert_eq!(planes(&window).iter().map(ClipPlane::outward).collect::<Vec<_>>(), [DVec3::X]);
    assert!((part(&window, 0) - 0.5).abs() < 1e-9, "the middle");
    retype(&mut window, "plane 1 (+x): part that stays", "0.7");
    window.run();
    assert!((part(&window, 0) - 0.7).abs() < 1e-9);
    // Seen from the front, x is to the right: 30 points along the arrow let more stay.
    let at = window.get_by_label("clip plane 1 (+x)").rect().center();
    drag_along(&mut window, &[at, at + Vec2::new(15.0, 0.0), at + Vec2::new(30.0, 0.0)]);
    let dragged = part(&window, 0);
    assert!(dragged > 0.72 && dragged < 1.0, "{dragged}");
    window.get_by_label("flip").click();
    window.run();
    assert_eq!(planes(&window)[0].outward(), DVec3::NEG_X);
    assert!((part(&window, 0) - (1.0 - dragged)).abs() < 1e-9, "the other side, at the same place");
    window.get_by_label("plane 1 (−x)").click();
    window.run();
    assert!(!planes(&window)[0].on);
    assert!(window.query_by_label("clip plane 1 (−x)").is_none(), "no handle");
    // The first of two.
    window.get_by_label("y").click();
    window.run();
    let first = window.get_all_by_label("remove").next().unwrap().rect().center();
    click_at(&mut window, first);
    window.run();
    assert_eq!(planes(&window).iter().map(ClipPlane::outward).collect::<Vec<_>>(), [DVec3::Y]);
    window.get_by_label("remove").click();
    window.run();
    assert!(planes(&window).is_empty());
}

#[test]
fn a_plane_in_a_face_of_the_box_can_be_pulled_back() {
    let mut window = opened();
    window.get_by_label("x").click();
    window.run();
    retype(&mut window, "plane 1 (+x): part that stays", "1");
    window.run();
    let at = window.get_by_label("clip plane 1 (+x)").rect().center();
    drag_along(&mut window, &[at, at - Vec2::new(20.0, 0.0), at - Vec2::new(40.0, 0.0)]);
    assert!(part(&window, 0) < 0.97, "{}", part(&window, 0));
}

#[test]
fn a_plane_that_faces_the_eye_is_added_by_the_view_and_cannot_be_dragged() {
    let mut window = opened();
    window.get_by_label("view").click();
    window.run();
    let outward = planes(&window)[0].outward();
    assert!(outward.dot(DVec3::NEG_Y) > 0.99, "towards the eye: {outward}");
    let at = window.get_by_label("clip plane 1 (−y)").rect().center();
    drag_along(&mut window, &[at, at + Vec2::new(0.0, 40.0)]);
    assert!((part(&window, 0) - 0.5).abs() < 1e-9);
}

#[test]
fn a_plane_is_dragged_in_a_slice() {
    let mut window = slices::opened(false);
    let document = window.state_mut().document.as_mut().unwrap();
    let plane = ClipPlane::new(DVec3::ZERO, DVec3::Z).unwrap().with_part(&document.state().scene.frame, 0.5);
    document.edit(&Edit::Clip(Clip { planes: vec![plane], ..Clip::default() }));
    window.run();
    let at = window.get_by_label("clip in XZ: plane 1 (+z)").rect().center();
    // Slices have z upwards.
    drag_along(&mut window, &[at, at - Vec2::new(0.0, 10.0), at - Vec2::new(0.0, 20.0)]);
    let dragged = part(&window, 0);
    assert!(dragged > 0.52 && dragged < 1.0, "{dragged}");
    assert!(window.query_by_label("clip in XY: plane 1 (+z)").is_none(), "along the slice there is no line");
}
