//! Dial presets: keep, rename, select, forget.

use egui::accesskit::Role;
use egui::{Event, Key, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document::{Document, Edit};
use relume::view::Action;

use crate::app::{App, document, light_names, reopened};

#[test]
fn presets_are_kept_renamed_and_forgotten() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    let names = |window: &Harness<'_, App>| -> Vec<String> {
        let document = window.state().document.as_ref().unwrap();
        document.state().dial.presets.iter().map(|preset| preset.name.clone()).collect()
    };
    let type_name = |window: &mut Harness<'_, App>, name: &str| {
        let field = window.get_by_role(Role::TextInput);
        field.focus();
        window.run();
        window.event(Event::Text(name.to_owned()));
        window.run();
    };
    type_name(&mut window, "dusk");
    window.get_by_label("Keep").click();
    window.run();
    assert_eq!(names(&window), ["evening", "dusk"]);
    type_name(&mut window, "2");
    window.get_by_label("Rename").click();
    window.run();
    assert!(names(&window)[1].contains('2'), "{:?}", names(&window));
    window.get_by_label("Forget").click();
    window.run();
    assert_eq!(names(&window), ["evening"]);
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::Forget(1)))));
}

#[test]
fn a_preset_on_a_node_is_that_light_alone_wherever_the_node_goes() {
    let mut document = document();
    let here = document.state().dial.nodes[1].place;
    assert_eq!(document.state().dial.presets[0].hand, here);
    for edit in [Edit::NodePlace(1, DVec2::new(0.3, 0.2)), Edit::Polygon, Edit::NodePlace(0, here), Edit::ResetDial] {
        document.edit(&edit);
        document.edit(&Edit::DialPreset(0));
        assert_eq!(light_names(&document.state().mix()), ["lamp"], "{edit:?}");
        let now = document.state().dial.nodes[1].place;
        assert_eq!(document.state().dial.presets[0].hand, now, "{edit:?}");
    }
    // A node that is off moves along as well, and the preset stays selected wherever that node is.
    document.edit(&Edit::NodePlace(0, DVec2::new(0.7, 0.1)));
    assert_eq!(document.preset(), Some(0));
    document.edit(&Edit::NodeOn(1, false));
    for edit in [Edit::NodePlace(1, DVec2::new(0.3, 0.2)), Edit::Polygon, Edit::ResetDial] {
        document.edit(&edit);
        let dial = &document.state().dial;
        assert_eq!(dial.presets[0].hand, dial.nodes[1].place, "{edit:?}");
    }
}

#[test]
fn enter_keeps_a_preset_and_moved_nodes_are_told_of_where_it_lies_between_them() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.1, 0.3)));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    window.get_by_role(Role::TextInput).focus();
    window.run();
    window.event(Event::Text("noon".to_owned()));
    window.run();
    window.key_press(Key::Enter);
    window.run();
    let names = |window: &Harness<'_, App>| -> Vec<String> {
        let dial = &window.state().document.as_ref().unwrap().state().dial;
        dial.presets.iter().map(|preset| preset.name.clone()).collect()
    };
    assert_eq!(names(&window), ["evening", "noon"]);
    assert!(window.query_by_label_contains("Nodes were moved").is_none());
    window.state_mut().document.as_mut().unwrap().edit(&Edit::NodePlace(0, DVec2::new(0.5, 0.5)));
    window.run();
    assert!(window.query_by_label_contains("Nodes were moved").is_some());
}

#[test]
fn a_name_that_is_taken_is_said_to_be_replaced() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
    window.run();
    window.get_by_role(Role::TextInput).focus();
    window.run();
    window.event(Event::Text("evening".to_owned()));
    window.run();
    window.get_by_label("Replace").click();
    window.run();
    let document = window.state().document.as_ref().unwrap();
    let presets = &document.state().dial.presets;
    assert_eq!((presets.len(), presets[0].hand), (1, DVec2::new(0.2, 0.1)));
}

#[test]
fn after_a_tour_the_preset_that_the_hand_stands_on_is_the_one_that_is_shown() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.1)));
    document.edit(&Edit::Keep("dusk".to_owned()));
    document.edit(&Edit::Tour(3, 8));
    assert_eq!(document.state().light.preset, None, "on its way");
    document.edit(&Edit::Tour(8, 8));
    assert_eq!(document.state().light.preset, Some(1), "at its end");
}

#[test]
fn the_names_of_presets_stand_in_their_own_section() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    let top = |label: &str| window.get_by_label(label).rect().top();
    assert!(top("Dial presets") < top("evening") && top("evening") < top("Transfer function"));
}

#[test]
fn a_preset_that_looks_as_what_is_seen_is_shown_as_the_one_that_is() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.3, 0.2)));
    document.edit(&Edit::Keep("evening".to_owned()));
    let index = document.preset();
    assert!(index.is_some());
    // A session stores the position of the hand, but not the name of its preset.
    let mut again = Document::new(reopened(&document));
    assert_eq!(again.preset(), None, "sliders mix");
    again.edit(&Edit::Hand(DVec2::new(0.3, 0.2)));
    assert_eq!(again.preset(), index);
    again.edit(&Edit::NodeOn(0, false));
    assert_eq!(again.preset(), None, "another mix");
}
