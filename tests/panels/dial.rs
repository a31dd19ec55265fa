//! Hand and nodes of the light dial.

use egui::{Event, Modifiers, PointerButton, Pos2, Rect, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document::{Document, Edit, Mixing};
use relume::view::ui;

use crate::app::{App, document, drag_along, light_names, reopened, wide};

#[test]
fn the_hand_of_the_dial_is_dragged_and_snaps_onto_a_node() {
    let mut window = wide(document());
    window.run();
    let rect = window.get_by_label("light dial").rect();
    let nodes = ui::node_places(window.state().document.as_ref().unwrap(), rect);
    let to = |window: &mut Harness<'_, App>, place: Pos2| {
        window.event(Event::PointerMoved(place));
        window.run();
    };
    let button = |window: &mut Harness<'_, App>, pos: Pos2, pressed: bool| {
        window.event(Event::PointerButton { pos, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE });
        window.run();
    };
    to(&mut window, rect.center());
    button(&mut window, rect.center(), true);
    to(&mut window, rect.center() + Vec2::new(30.0, 20.0));
    let light = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().light.clone();
    assert_eq!(light(&window).mixing, Mixing::Dial);
    assert!(light(&window).hand.x > 0.0 && light(&window).hand.y < 0.0, "{}", light(&window).hand);
    to(&mut window, nodes[1] + Vec2::new(4.0, -3.0));
    assert_eq!(light(&window).hand, DVec2::new(0.0, -1.0), "exactly on the node");
    button(&mut window, nodes[1], false);
    let document = window.state_mut().document.as_mut().unwrap();
    assert_eq!(light_names(&document.state().mix()), ["lamp"], "that light alone");
    document.rest();
    document.undo();
    assert_eq!(document.state().light.hand, DVec2::ZERO, "a drag is one step back");
}

#[test]
fn on_a_node_the_mix_is_that_light_alone_to_the_bit() {
    let mut document = document();
    document.edit(&Edit::HandOnNode(1));
    let on_node = document.state().mix();
    document.edit(&Edit::Solo(Some(1)));
    document.edit(&Edit::Normalise(true));
    assert_eq!(document.state().mix(), on_node);
}

#[test]
fn a_node_that_is_off_keeps_its_place_and_comes_back_to_it() {
    let mut document = document();
    document.edit(&Edit::NodePlace(0, DVec2::new(0.5, 0.25)));
    document.edit(&Edit::NodeOn(0, false));
    document.edit(&Edit::Hand(DVec2::new(0.4, 0.2)));
    assert_eq!(light_names(&document.state().mix()), ["lamp"]);
    document.edit(&Edit::NodeOn(0, true));
    assert_eq!(document.state().dial.nodes[0].place, DVec2::new(0.5, 0.25));
    document.edit(&Edit::ResetDial);
    assert_eq!(document.state().dial, document.opened().dial);
}

#[test]
fn nodes_that_a_session_has_left_out_are_brought_back() {
    let mut document = document();
    document.edit(&Edit::NodeOn(1, false));
    // As a saved session opens.
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(Document::new(reopened(&document))));
    window.run();
    window.get_by_label("Reset nodes").click();
    window.run();
    let on = |window: &Harness<'_, App>| {
        let nodes = &window.state().document.as_ref().unwrap().state().dial.nodes;
        nodes.iter().map(|node| node.on).collect::<Vec<_>>()
    };
    assert_eq!(on(&window), [true, true]);
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(on(&window), [true, false]);
}

#[test]
fn the_dial_holds_the_hand_of_every_preset_and_stays_while_nodes_move_within_it() {
    let mut document = document();
    let rect = Rect::from_min_size(Pos2::ZERO, Vec2::new(255.0, 210.0));
    let before = ui::node_places(&document, rect);
    document.edit(&Edit::NodePlace(0, DVec2::new(0.0, 0.2)));
    assert_eq!(ui::node_places(&document, rect)[1], before[1], "the other node stays");
    // Nodes stay apart on the panel when the hand is far away.
    document.edit(&Edit::Hand(DVec2::new(1e6, 0.0)));
    let far = ui::node_places(&document, rect);
    assert!(far[0].distance(far[1]) > 10.0, "{far:?}");
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(document));
    window.run();
    let dial = window.get_by_label("light dial").rect();
    let outside = dial.center() + Vec2::new(0.0, 300.0);
    drag_along(&mut window, &[dial.center(), dial.center() + Vec2::new(0.0, 80.0), outside]);
    let state = window.state().document.as_ref().unwrap().state();
    assert!(state.light.hand.y > -2.0, "a hand stays in the dial: {}", state.light.hand);
}

#[test]
fn a_hand_on_a_node_goes_back_with_it() {
    for edit in [Edit::ResetDial, Edit::Polygon] {
        let mut document = document();
        document.edit(&Edit::NodePlace(1, DVec2::new(0.4, 0.2)));
        document.edit(&Edit::HandOnNode(1));
        document.edit(&edit);
        assert_eq!(light_names(&document.state().mix()), ["lamp"], "{edit:?}");
    }
}

#[test]
fn nodes_are_put_on_a_regular_polygon() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.state_mut().document.as_mut().unwrap().edit(&Edit::NodePlace(0, DVec2::new(0.3, 0.2)));
    window.run();
    window.get_by_label("Polygon").click();
    window.run();
    let nodes = &window.state().document.as_ref().unwrap().state().dial.nodes;
    assert!((nodes[0].place + nodes[1].place).length() < 1e-9 && (nodes[0].place.length() - 1.0).abs() < 1e-9);
}

#[test]
fn a_node_that_is_moved_moves_no_other() {
    let mut window = wide(document());
    window.run();
    let places = |window: &Harness<'_, App>| {
        ["day on the dial", "lamp on the dial"].map(|label| window.get_by_label(label).rect().center())
    };
    let [day, lamp] = places(&window);
    let button = |window: &mut Harness<'_, App>, pos: Pos2, pressed: bool| {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::SHIFT);
        window.event_modifiers(Event::PointerButton { pos, button, pressed, modifiers }, modifiers);
        window.run();
    };
    let to = |window: &mut Harness<'_, App>, place: Pos2| {
        window.event_modifiers(Event::PointerMoved(place), Modifiers::SHIFT);
        window.run();
    };
    to(&mut window, lamp);
    button(&mut window, lamp, true);
    let end = lamp + Vec2::new(40.0, -60.0);
    to(&mut window, lamp + Vec2::new(20.0, -30.0));
    to(&mut window, end);
    window.run();
    let [day_now, lamp_now] = places(&window);
    assert!((day_now - day).length() < 0.5, "{day_now:?} was at {day:?}");
    assert!((lamp_now - end).length() < 0.5, "{lamp_now:?} is to be under the hand at {end:?}");
    button(&mut window, end, false);
}

#[test]
fn what_stands_below_the_dial_stays_where_it_is_as_nodes_are_left_out() {
    let mut window = wide(document());
    window.run();
    let below = |window: &Harness<'_, App>| window.get_by_label("Dial presets").rect();
    let before = below(&window);
    window.state_mut().document.as_mut().unwrap().edit(&Edit::NodeOn(0, false));
    window.run();
    assert_eq!(below(&window), before);
    window.get_by_label("Reset nodes").click();
    window.run();
    assert!(window.state().document.as_ref().unwrap().state().dial.nodes[0].on);
}
