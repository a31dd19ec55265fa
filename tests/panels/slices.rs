//! Slices around the picture.

use std::sync::Arc;

use egui::{Event, Key, Modifiers, MouseWheelUnit, PointerButton, Pos2, TouchPhase, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use relume::document::{Document, Edit};
use relume::view::layout::Arrange;
use relume::view::script::Command;
use relume::view::{Action, Script};
use relume::volume::Volume;

use crate::app::{App, click_at, document, drag_along, is_painted};

const NAMES: [&str; 3] = ["slice: XY", "slice: XZ", "slice: YZ"];

/// A window with slices of the document, whose axes are anatomical if `anatomical`.
pub(crate) fn opened(anatomical: bool) -> Harness<'static, App> {
    let mut scene = document().opened().clone();
    let volume = Volume { anatomical, ..(**scene.scene.volume()).clone() };
    scene.scene.set_volume(Arc::new(volume));
    let statistics = scene.scene.volume().statistics().unwrap();
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(Document::new(scene).with_statistics(statistics)));
    window.run();
    window.key_press(Key::S);
    window.run();
    window.run();
    window
}

fn dims(window: &Harness<'_, App>) -> [usize; 3] {
    window.state().document.as_ref().unwrap().state().scene.frame.geometry.dims
}

fn centre(window: &Harness<'_, App>, label: &str) -> Pos2 {
    window.get_by_label(label).rect().center()
}

fn last_at(window: &Harness<'_, App>) -> DVec3 {
    window.state().layout.slices.at.unwrap()
}

#[test]
fn a_key_shows_three_slices_around_the_picture_and_hides_them_without_a_trace() {
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(document()));
    let statistics = document().opened().scene.volume().statistics().unwrap();
    window.state_mut().document = Some(document().with_statistics(statistics));
    window.run();
    let textures = |window: &Harness<'_, App>| window.ctx.tex_manager().read().num_allocated();
    let (before, without) = (window.state().place, textures(&window));
    window.key_press(Key::S);
    window.run();
    window.run();
    let picture = window.state().place;
    assert_eq!(textures(&window), without + 3);
    let rects = NAMES.map(|name| window.get_by_label(name).rect());
    for (rect, other) in rects.iter().zip([rects[1], rects[2], picture]) {
        assert!(before.contains_rect(*rect) && !rect.intersects(other) && rect.width() > 300.0, "{rect:?}");
    }
    assert!(picture.left() > before.center().x && picture.bottom() < before.center().y, "{picture:?}");
    window.key_press(Key::S);
    window.run();
    window.run();
    assert_eq!((window.state().place, textures(&window)), (before, without));
    assert!(NAMES.iter().all(|name| window.query_by_label(name).is_none()));
}

#[test]
fn a_click_puts_the_crosshair_at_the_voxel_there() {
    let mut window = opened(false);
    let middle = DVec3::from_array(dims(&window).map(|n| f64::from(u32::try_from(n).unwrap()) - 1.0)) / 2.0;
    for (name, right, down) in [(NAMES[0], 0, (1, 1.0)), (NAMES[1], 0, (2, -1.0)), (NAMES[2], 1, (2, -1.0))] {
        let at = centre(&window, name);
        click_at(&mut window, at);
        let here = last_at(&window);
        click_at(&mut window, at + Vec2::new(10.0, 0.0));
        let step = last_at(&window) - here;
        assert!(step[right] > 0.0 && (step.length() - step[right]).abs() < 1e-9, "{name}: {step}");
        click_at(&mut window, at + Vec2::new(10.0, 10.0));
        let step = last_at(&window) - here - step;
        assert!(step[down.0] * down.1 > 0.0 && (step.length() - step[down.0].abs()).abs() < 1e-9, "{name}: {step}");
        // Pixels of the picture's edges are rounded to those of the screen.
        click_at(&mut window, at);
        assert!((last_at(&window) - middle)[right].abs() < 0.5, "{name}: {}", last_at(&window));
    }
}

#[test]
fn a_line_of_the_wheel_turns_one_slice_and_no_further_than_the_last() {
    let mut window = opened(false);
    let z = |window: &Harness<'_, App>| window.state().layout.slices.at.map(|at| at.z);
    window.event(Event::PointerMoved(centre(&window, NAMES[0])));
    let mut turn = |lines: f32| {
        let (unit, delta, phase) = (MouseWheelUnit::Line, Vec2::new(0.0, lines), TouchPhase::Move);
        window.event(Event::MouseWheel { unit, delta, phase, modifiers: Modifiers::NONE });
        window.run_steps(20);
        z(&window).unwrap()
    };
    let first = turn(1.0);
    let steps = [turn(1.0), turn(-3.0)].map(|z| z - first);
    assert_eq!(steps.to_vec(), [1.0, -2.0]);
    let last = turn(1000.0);
    let count = f64::from(u32::try_from(dims(&window)[2]).unwrap());
    assert!((last - (count - 1.0)).abs() < 1e-12);
    let camera = |action: &Action| matches!(action, Action::Edit(_));
    assert!(!window.state().asked.iter().any(camera), "the camera stays");
}

#[test]
fn the_right_button_drags_window_and_level() {
    let mut window = opened(false);
    window.state_mut().layout.arrange(Arrange::Window([40.0, 80.0]));
    let from = centre(&window, NAMES[0]) - Vec2::new(100.0, 0.0);
    let press = |pos, pressed| {
        let button = PointerButton::Secondary;
        Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
    };
    let to = from + Vec2::new(200.0, 0.0);
    for event in [Event::PointerMoved(from), press(from, true), Event::PointerMoved(to), press(to, false)] {
        window.event(event);
        window.run();
    }
    let [low, high] = window.state().layout.slices.window.unwrap();
    assert!((high - low - 80.0).abs() < 1e-6 && (f64::midpoint(low, high) - 60.0).abs() < 1e-6, "{low} to {high}");
    assert!(!window.state().asked.iter().any(|action| matches!(action, Action::Edit(_))), "the camera stays");
}

#[test]
fn slices_of_a_patient_have_their_names_and_letters() {
    let window = opened(true);
    for name in ["slice: axial", "slice: coronal", "slice: sagittal"] {
        assert!(window.query_by_label(name).is_some(), "{name}");
    }
    for letter in ["R", "L", "A", "P", "S", "I"] {
        assert!(is_painted(&window, letter), "{letter}");
    }
    assert!(is_painted(&opened(false), "XY ") && is_painted(&window, "axial "));
}

#[test]
fn the_controls_of_the_slices_set_their_window_and_what_lies_over_them() {
    let mut window = opened(false);
    window.get_by_label("materials").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Arrange(Arrange::SliceMaterials(true))));
    let statistics = window.state().document.as_ref().unwrap().statistics().cloned().unwrap();
    window.get_by_label("Window").click();
    window.run();
    window.get_by_label("all values").click();
    window.run();
    assert_eq!(window.state().layout.slices.window, Some([statistics.min, statistics.max]));
    window.get_by_label("labels").click();
    window.run();
    assert!(!window.state().layout.slices.labels, "the scene has none");
}

#[test]
fn scripts_set_everything_of_the_slices() {
    let of = |line: &str| Script::parse("test", line).map(|script| script.command(0).cloned().unwrap());
    for (line, change) in [
        ("slices on", Arrange::Slices(true)),
        ("slices at 1 2.5 3", Arrange::SliceAt(DVec3::new(1.0, 2.5, 3.0))),
        ("slices window -160 240", Arrange::Window([-160.0, 240.0])),
        ("slices materials on", Arrange::SliceMaterials(true)),
        ("slices labels off", Arrange::SliceLabels(false)),
    ] {
        assert_eq!(of(line).unwrap(), Command::Do(Action::Arrange(change)), "{line}");
    }
    // A colour is no comment.
    for (line, is_read) in [
        ("slices on # comment", true),
        ("# 3", false),
        ("#comment", false),
        ("palette target 0 0 #ceb49c #comment", true),
    ] {
        let script = Script::parse("test", line).unwrap();
        assert_eq!(script.command(0).is_some(), is_read, "{line}");
    }
    for (line, told) in
        [("slices window 2 1", "does not ascend"), ("slices at 1 2", "3 numbers"), ("slices x", "slices on, off")]
    {
        let error = of(line).unwrap_err().to_string();
        assert!(error.contains(told), "{line}: {error}");
    }
}

#[test]
fn the_wheel_with_ctrl_enlarges_the_slices_around_the_pointer() {
    let mut window = opened(false);
    let at = centre(&window, NAMES[0]) + Vec2::new(40.0, 20.0);
    click_at(&mut window, at);
    let before = last_at(&window);
    let mut turn = |lines: f32| {
        window.event(Event::PointerMoved(at));
        let (unit, delta, phase) = (MouseWheelUnit::Line, Vec2::new(0.0, lines), TouchPhase::Move);
        window.event(Event::MouseWheel { unit, delta, phase, modifiers: Modifiers::COMMAND });
        window.run_steps(20);
        window.state().layout.slices.zoom.map(|(zoom, _)| zoom)
    };
    let zoom = turn(5.0).unwrap();
    assert!((zoom - 1.2_f64.powi(5)).abs() < 1e-9, "{zoom}");
    click_at(&mut window, at);
    let same = last_at(&window);
    assert!((same - before).abs().max_element() < 0.3, "the voxel below the pointer: {before} and {same}");
    click_at(&mut window, at + Vec2::new(50.0, 0.0));
    let near = last_at(&window).x - same.x;
    window.get_by_label("whole slices").click();
    window.run();
    assert_eq!(window.state().layout.slices.zoom, None);
    click_at(&mut window, at);
    let here = last_at(&window).x;
    click_at(&mut window, at + Vec2::new(50.0, 0.0));
    let far = last_at(&window).x - here;
    assert!((far / near - zoom).abs() < 0.1, "50 points are {near} voxels enlarged, {far} otherwise");
    assert!(!window.state().asked.iter().any(|action| matches!(action, Action::Edit(_))), "the camera stays");
}

#[test]
fn the_middle_button_moves_enlarged_slices() {
    let mut window = opened(false);
    let middle = DVec3::from_array(dims(&window).map(|n| f64::from(u32::try_from(n).unwrap()) - 1.0)) / 2.0;
    window.state_mut().layout.arrange(Arrange::SliceZoom(4.0, middle));
    window.run();
    let at = centre(&window, NAMES[0]);
    click_at(&mut window, at);
    let before = last_at(&window);
    let press = |pos, pressed| {
        let button = PointerButton::Middle;
        Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
    };
    let to = at + Vec2::new(60.0, 0.0);
    for event in [Event::PointerMoved(at), press(at, true), Event::PointerMoved(to), press(to, false)] {
        window.event(event);
        window.run();
    }
    click_at(&mut window, to);
    let after = last_at(&window);
    assert!((after - before).abs().max_element() < 0.3, "the voxel follows the pointer: {before} and {after}");
}

#[test]
fn a_side_of_the_crop_box_is_dragged_in_a_slice_and_the_others_stay() {
    let mut window = opened(false);
    let crop = [DVec3::splat(0.25), DVec3::splat(0.75)];
    window.state_mut().document.as_mut().unwrap().edit(&Edit::Crop(Some(crop)));
    window.run();
    for (label, end, axis, by) in [
        ("crop in XY: x to", 1, 0, Vec2::new(-20.0, 0.0)),
        ("crop in XY: y from", 0, 1, Vec2::new(0.0, 20.0)),
        ("crop in XZ: z from", 0, 2, Vec2::new(0.0, -20.0)),
    ] {
        let now = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().crop().unwrap();
        let before = now(&window);
        let side = window.get_by_label(label).rect().center();
        drag_along(&mut window, &[side, side + by / 2.0, side + by]);
        window.run();
        let after = now(&window);
        let moved = after[end][axis] - before[end][axis];
        assert!(moved.abs() > 0.02 && (moved < 0.0) == (end == 1), "{label}: {before:?} to {after:?}");
        let mut rest = after;
        rest[end][axis] = before[end][axis];
        assert_eq!(rest, before, "{label}");
    }
}
