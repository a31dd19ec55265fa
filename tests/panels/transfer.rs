//! The transfer function panel: intervals and labels.

use std::path::Path;

use egui::accesskit::Role;
use egui::{Event, Key, Modifiers, PointerButton, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use relume::document;
use relume::document::SceneOptions;
use relume::document::{Document, Edit};
use relume::plan::Stale;
use relume::progress::Quiet;
use relume::scene::{Blending, Interval};
use relume::view::Action;

use crate::app::{
    App, click_at, document, drag_along, intervals, is_painted, reopened, retype, type_into, wide, with_histogram,
};
use crate::support::program::SCENE;

#[test]
fn what_is_seen_along_a_ray_is_chosen_in_the_transfer_panel_and_undone() {
    let mut window = wide(document());
    window.run();
    let blending = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().scene.blending;
    window.get_by_label("largest").click();
    window.run();
    assert_eq!(blending(&window), Blending::Maximum);
    let opened = document();
    let planned = relume::plan::plan(&opened.state().scene, &Quiet).unwrap();
    let after = opened.preview(&Edit::Blending(Blending::Maximum)).scene;
    assert!(Stale::between(&opened.state().scene, &planned, &after) >= Stale::Tables, "it marches");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(blending(&window), Blending::Composite);
}

#[test]
fn an_interval_below_another_is_brought_to_the_front_by_its_swatch() {
    let mut window = with_histogram();
    window.run();
    let below = intervals(&window)[0];
    let [from, to] = below.range;
    let over = Interval { range: [from - 50.0, to + 50.0], opacity: 1.0, ..intervals(&window)[1] };
    window.state_mut().document.as_mut().unwrap().edit(&Edit::Interval(1, over));
    window.run();
    let drag_below = |window: &mut Harness<'_, App>| {
        window.state_mut().asked.clear();
        // Beside the handle in the middle of the interval's top.
        let body = window.get_by_label("interval 0: Body").rect();
        let at = body.left_center().lerp(body.center(), 0.5);
        drag_along(window, &[at, at + Vec2::new(12.0, 0.0)]);
        let moved = |action: &Action| matches!(action, Action::Edit(Edit::Interval(0, _)));
        window.state().asked.iter().any(moved)
    };
    assert!(!drag_below(&mut window), "the other one lies over it");
    let line = window.get_by_label("remove interval 0").rect().center().y;
    let swatches = window.get_all_by_role(Role::ColorWell).map(|node| node.rect());
    let swatch = swatches.into_iter().find(|rect| (rect.center().y - line).abs() < 5.0).unwrap();
    click_at(&mut window, swatch.center());
    assert!(drag_below(&mut window), "it lies over the other one now");
}

#[test]
fn the_top_and_the_ends_of_an_interval_are_dragged_and_a_drag_is_one_step_back() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    let drag = |window: &mut Harness<'_, App>, label: &str, by: Vec2| {
        let from = window.get_by_label(label).rect().center();
        let button = PointerButton::Primary;
        let press = |pos, pressed| Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE };
        let steps = [Event::PointerMoved(from), press(from, true)];
        let half = Event::PointerMoved(from + by / 2.0);
        for event in steps.into_iter().chain([half, Event::PointerMoved(from + by), press(from + by, false)]) {
            window.event(event);
            window.run();
        }
        window.state_mut().document.as_mut().unwrap().rest();
    };
    drag(&mut window, "interval 0: Top", Vec2::new(0.0, -20.0));
    let raised = intervals(&window);
    assert!(raised[0].opacity > 1.5 * before[0].opacity, "{raised:?}");
    assert_eq!(raised[0], Interval { opacity: raised[0].opacity, ..before[0] });
    drag(&mut window, "interval 0: To", Vec2::new(30.0, 0.0));
    let wider = intervals(&window);
    assert!(wider[0].range[1] > before[0].range[1] + 10.0, "{wider:?}");
    drag(&mut window, "interval 0: Before", Vec2::new(-10.0, 0.0));
    assert!(intervals(&window)[0].ramp > before[0].ramp, "{:?}", intervals(&window));
    for undone in [wider, raised, before] {
        window.get_by_label("Undo").click();
        window.run();
        assert_eq!(intervals(&window), undone);
    }
}

#[test]
fn intervals_are_added_removed_and_brought_back() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    window.get_by_label("Add interval").click();
    window.run();
    assert_eq!(intervals(&window).len(), 3);
    window.get_by_label("remove interval 0").click();
    window.run();
    assert_eq!(intervals(&window)[0], before[1]);
    window.get_by_label("Reset transfer").click();
    window.run();
    assert_eq!(intervals(&window), before);
    let of_volume =
        window.state().asked.iter().all(|action| matches!(action, Action::Edit(edit) if edit.leaves_light()));
    assert!(of_volume, "{:?}", window.state().asked);
}

#[test]
fn reset_transfer_is_there_where_a_label_alone_has_changed() {
    let more = "[labels.2]\nname = \"gut\"\nmaterial = \"bone\"\nopacity = 0.25\n";
    let scene = SCENE.replace("dims =", "phantom_labels = true\ndims =");
    let text = format!("{scene}{more}");
    let opened = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let stated = opened.scene.labels.as_ref().unwrap().declared.clone();
    let mut document = Document::new(opened);
    document.edit(&Edit::Label(0, 0, 0.75));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    window.get_by_label("Reset transfer").click();
    window.run();
    let state = window.state().document.as_ref().unwrap().state();
    assert_eq!(state.scene.labels.as_ref().unwrap().declared, stated);
}

#[test]
fn an_end_of_an_interval_that_is_typed_past_the_other_takes_it_along() {
    for (end, typed) in [("from", 300.0), ("to", -20.0)] {
        let mut window = with_histogram();
        window.run();
        let before = intervals(&window)[0];
        type_into(&mut window, &format!("interval 0: {end}"), &typed.to_string());
        window.key_press(Key::Enter);
        window.run();
        assert_eq!(intervals(&window)[0], Interval { range: [typed; 2], ..before }, "{end}");
        assert!(is_painted(&window, "as well, because an interval cannot end before it begins"), "{end}: and says so");
    }
}

#[test]
fn a_transfer_function_that_shows_no_value_says_so() {
    let mut window = with_histogram();
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is visible").is_none());
    let mut document = document();
    let statistics = document.opened().scene.volume().statistics().unwrap();
    for index in [0, 1] {
        let stated = document.state().scene.transfer.terms[index].as_interval().unwrap();
        document.edit(&Edit::Interval(index, Interval { range: [1e4, 2e4], ..stated }));
    }
    let mut window = wide(document.clone().with_statistics(statistics.clone()));
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is visible").is_some());
    window.get_all_by_label("Reset transfer").last().unwrap().click();
    window.run();
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is visible").is_none());
    // Where it opened so, there is nothing to go back to.
    let mut window = wide(Document::new(reopened(&document)).with_statistics(statistics));
    window.run();
    window.get_by_label("Show all values").click();
    window.run();
    window.run();
    assert!(window.query_by_label_contains("Nothing of the volume is visible").is_none());
}

#[test]
fn an_end_of_an_interval_that_is_dragged_past_the_other_stops_there() {
    for (end, by, other) in [("from", 3000.0, 1), ("to", -3000.0, 0)] {
        let mut window = with_histogram();
        window.run();
        let before = intervals(&window)[0];
        let at = window.get_by_label(&format!("interval 0: {end}")).rect().center();
        drag_along(&mut window, &[at, at + Vec2::new(by / 2.0, 0.0), at + Vec2::new(by, 0.0)]);
        assert_eq!(intervals(&window)[0], Interval { range: [before.range[other]; 2], ..before }, "{end}");
    }
}

#[test]
fn what_an_interval_absorbs_is_a_number_where_its_material_absorbs() {
    let text = SCENE.replace(
        "[materials.flesh]",
        "[materials.flesh]\nabsorption = { gaussian = [{ centre = 527, sigma = 17, height = 1.0 }], base = 0.02 }",
    );
    assert_ne!(text, SCENE);
    let opened = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let shown = opened.scene.transfer.terms.iter().map(|term| term.as_interval().unwrap().material);
    let of_flesh = shown.map(|material| opened.scene.materials[material].name == "flesh").collect::<Vec<_>>();
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(Document::new(opened)));
    window.run();
    for (index, absorbs) in of_flesh.iter().enumerate() {
        let label = format!("interval {index}: absorption");
        let field = window.query_by_label(&label);
        assert_eq!(field.is_some(), *absorbs, "{index}");
    }
    let index = of_flesh.iter().position(|it| *it).unwrap();
    type_into(&mut window, &format!("interval {index}: absorption"), "0.75");
    window.key_press(Key::Enter);
    window.run();
    assert!((intervals(&window)[index].absorption - 0.75).abs() < 1e-12, "{:?}", intervals(&window));
    assert!(window.query_all_by_label("absorbs").count() >= 2, "beside the interval, and in the spectra");
}

#[test]
fn the_body_of_an_interval_is_dragged_with_both_its_ends_and_back_by_one_step() {
    let mut window = with_histogram();
    window.run();
    let before = intervals(&window);
    let body = window.get_by_label("interval 0: Body").rect();
    let by = |x: f32| body.center() + Vec2::new(x, 3.0);
    drag_along(&mut window, &[by(0.0), by(0.3), by(0.6), by(-20.0), by(30.0)]);
    let moved = intervals(&window);
    let [from, to] = [0, 1].map(|end| moved[0].range[end] - before[0].range[end]);
    assert!(from > 10.0 && (from - to).abs() < 1e-9, "{moved:?} from {before:?}");
    assert_eq!(moved[0], Interval { range: moved[0].range, ..before[0] }, "as steep and as opaque as it was");
    assert_eq!(moved[1], before[1]);
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(intervals(&window), before);
}

#[test]
fn a_window_of_values_by_level_and_width_makes_layers_above_its_low_end() {
    let mut window = with_histogram();
    window.run();
    retype(&mut window, "window: Level", "60");
    retype(&mut window, "window: Width", "60");
    window.get_by_label("Apply window").click();
    window.run();
    let layers = intervals(&window);
    let foot = layers[0].range[0] - layers[0].ramp;
    // From 30 to 90, in three layers of 20.
    assert!(layers.len() == 3 && (foot - 30.0).abs() < 1e-9, "{layers:?}");
    assert!((layers[1].range[0] - layers[1].ramp / 2.0 - 50.0).abs() < 1e-9, "{layers:?}");
}

#[test]
fn the_opacity_by_gradient_is_switched_edited_and_kept_while_it_is_off() {
    let mut window = with_histogram();
    window.run();
    let points = |window: &Harness<'_, App>| {
        window.state().document.as_ref().unwrap().state().scene.transfer.gradient_opacity.clone()
    };
    assert!(points(&window).is_empty() && window.query_by_label("gradient point 0: magnitude").is_none());
    let switch = |window: &mut Harness<'_, App>| {
        window.get_by_label("Opacity by gradient").click();
        window.run();
        window.run();
        window.state_mut().document.as_mut().unwrap().rest();
    };
    switch(&mut window);
    // Fiftieth and tenth of the largest change from one voxel to the next.
    let statistics = window.state().document.as_ref().unwrap().statistics().cloned().unwrap();
    let steepest = statistics.max - statistics.min;
    let usual = points(&window);
    for (&(magnitude, _), part) in usual.iter().zip([0.02, 0.1]) {
        assert!((magnitude / steepest - part).abs() < 1e-3, "{usual:?} of {steepest}, at a spacing of 1");
    }
    retype(&mut window, "gradient point 0: magnitude", "7");
    retype(&mut window, "gradient point 1: factor", "0.5");
    assert_eq!(points(&window), [(7.0, 0.0), (usual[1].0, 0.5)]);
    window.get_by_label("add point").click();
    window.run();
    window.run();
    assert_eq!(points(&window).len(), 3);
    window.get_by_label("remove gradient point 1").click();
    window.run();
    window.run();
    let left = points(&window);
    assert!(left.len() == 2 && left[0].1 <= 0.0 && left[1].0 > usual[1].0, "{left:?}");
    switch(&mut window);
    assert!(points(&window).is_empty());
    switch(&mut window);
    assert_eq!(points(&window), left, "as it was switched off");
    window.get_by_label("Reset transfer").click();
    window.run();
    assert!(points(&window).is_empty());
}

#[test]
fn a_drag_over_values_and_gradients_adds_a_rectangle_whose_edges_move() {
    let mut window = with_histogram();
    window.run();
    assert!(window.query_by_label("values and gradients").is_none());
    window.get_by_label("By gradient").click();
    window.run();
    let plane = window.get_by_label("values and gradients").rect();
    let before = intervals(&window).len();
    let rest = |window: &mut Harness<'_, App>| window.state_mut().document.as_mut().unwrap().rest();
    let [from, to] =
        [plane.left_bottom().lerp(plane.right_top(), 0.3), plane.left_bottom().lerp(plane.right_top(), 0.6)];
    drag_along(&mut window, &[from, from.lerp(to, 0.5), to]);
    rest(&mut window);
    let document = window.state().document.as_ref().unwrap();
    let transfer = document.state().scene.transfer.clone();
    let statistics = document.statistics().unwrap().clone();
    let steepest = document.joint_histogram().unwrap().steepest;
    assert_eq!(transfer.terms.len(), before + 1, "one more");
    let added = transfer.terms.last().unwrap();
    let span = statistics.max - statistics.min;
    let range = added.as_interval().unwrap().range.map(|end| (end - statistics.min) / span);
    assert!((range[0] - 0.3).abs() < 0.02 && (range[1] - 0.6).abs() < 0.02, "{range:?}");
    let points: Vec<(f64, f64)> = added.gradient.iter().map(|point| (point.0 / steepest, point.1)).collect();
    let expected = [(0.25, 0.0), (0.3, 1.0), (0.6, 1.0), (0.65, 0.0)];
    for (found, expected) in points.iter().zip(expected) {
        assert!((found.0 - expected.0).abs() < 0.02 && (found.1 - expected.1).abs() < 1e-9, "{points:?}");
    }
    assert_eq!(points.len(), 4, "{points:?}");

    // Its upper edge, then its left one; each drag is one step back.
    let dragged = |window: &mut Harness<'_, App>, (label, part): (&str, f32), by: Vec2| {
        let edge = window.get_by_label(label).rect();
        let at = edge.center_bottom().lerp(edge.center_top(), part);
        drag_along(window, &[at, at + by / 2.0, at + by]);
        window.state_mut().document.as_mut().unwrap().rest();
        window.state().document.as_ref().unwrap().state().scene.transfer.terms.last().unwrap().clone()
    };
    let index = before;
    let lower = dragged(&mut window, (&format!("rectangle {index}: gradient point 2"), 0.5), Vec2::new(0.0, 12.0));
    assert!(lower.gradient[2].0 < added.gradient[2].0 && lower.gradient[3] == added.gradient[3], "{lower:?}");
    let left = dragged(&mut window, (&format!("rectangle {index}: from"), 0.4), Vec2::new(-20.0, 0.0));
    assert!(left.opacity[1].0 < lower.opacity[1].0 && left.gradient == lower.gradient, "{left:?}");
    let undo = |window: &mut Harness<'_, App>| window.state_mut().document.as_mut().unwrap().undo();
    assert!((0..3).all(|_| undo(&mut window)));
    assert_eq!(intervals(&window).len(), before, "three steps back");

    // Its numbers stand below, and an interval takes the factor of all again.
    window.run();
    window.get_all_by_label("own factor").next().unwrap().click();
    window.run();
    window.run();
    assert_eq!(window.state().document.as_ref().unwrap().state().scene.transfer.terms[0].gradient.len(), 2);
    retype(&mut window, "interval 0: gradient point 0: magnitude", "3");
    assert!(
        (window.state().document.as_ref().unwrap().state().scene.transfer.terms[0].gradient[0].0 - 3.0).abs() < 1e-9
    );
}
