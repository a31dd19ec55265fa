//! The light panel: switches, solo, sliders and brightness.

use egui::Vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document::moves::{Move, Side};
use relume::document::{self, Document, Edit, Mixing};
use relume::plan::Stale;
use relume::progress::Quiet;
use relume::scene::{AmbientShares, Lighting, Orders};
use relume::view::Action;

use crate::app::{App, document, light_names, wide};

#[test]
fn a_switch_and_solo_of_the_light_panel_decide_which_lights_shine() {
    let mut window = wide(document());
    window.get_by_label("lamp").click();
    window.run();
    let mix = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().mix();
    assert_eq!(light_names(&mix(&window)), ["day"]);
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(light_names(&mix(&window)).len(), 2);
    window.get_all_by_label("solo").nth(1).unwrap().click();
    window.run();
    assert_eq!(light_names(&mix(&window)), ["lamp"]);
}

#[test]
fn names_of_designed_lights_are_readable_in_a_small_window() {
    let mut scene = document().opened().clone();
    let name = "for_large_labels";
    name.clone_into(&mut scene.scene.lights[1].name);
    let mut window = App::open(Vec2::new(1280.0, 720.0), Some(Document::new(scene)));
    window.run();
    let shown = window.output().shapes.iter().filter_map(|clipped| match &clipped.shape {
        egui::Shape::Text(text) if text.galley.text() == name => Some(text.galley.elided),
        _ => None,
    });
    assert_eq!(shown.collect::<std::collections::BTreeSet<bool>>(), [false].into(), "all names are whole");
}

#[test]
fn all_lights_off_is_a_notice_that_turns_them_on_again() {
    let mut document = document();
    for light in 0..2 {
        document.edit(&Edit::On(light, false));
    }
    assert!(!document.state().is_lit());
    let mut window = wide(document);
    window.run();
    window.get_by_label("Turn the lights on").click();
    window.run();
    assert!(window.state().document.as_ref().unwrap().state().is_lit());
    assert!(window.query_by_label("Turn the lights on").is_none(), "the notice has gone");
}

#[test]
fn nothing_of_the_light_is_asked_for_that_marches() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    for label in ["lamp", "keep brightness", "white balance", "10° (1964)", "evening"] {
        window.get_all_by_label(label).next().unwrap().click();
        window.run();
    }
    let asked = &window.state().asked;
    assert!(asked.len() >= 4, "{asked:?}");
    let document = document();
    let scene = &document.state().scene;
    let planned = relume::plan::plan(scene, &Quiet).unwrap();
    for action in asked {
        let Action::Edit(edit) = action else { continue };
        let after = document.preview(edit).scene;
        assert!(Stale::between(scene, &planned, &after) < Stale::Accumulators, "{edit:?}");
    }
    window.get_by_label("Top").click();
    window.run();
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::Camera(Move::Axis(Side::Top), _)))));
}

#[test]
fn the_shaded_sides_are_chosen_in_the_light_panel_undone_and_kept_by_sessions() {
    let mut window = wide(document());
    window.run();
    let lighting = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().scene.lighting;
    assert_eq!(lighting(&window), Lighting::TwoSided);
    window.get_by_label("outer side").click();
    window.run();
    assert_eq!(lighting(&window), Lighting::OneSided);
    assert!(matches!(window.state().asked.last(), Some(Action::Edit(Edit::Lighting(Lighting::OneSided)))));
    let opened = document();
    let planned = relume::plan::plan(&opened.state().scene, &Quiet).unwrap();
    let after = opened.preview(&Edit::Lighting(Lighting::OneSided)).scene;
    assert!(Stale::between(&opened.state().scene, &planned, &after) >= Stale::Accumulators, "it marches");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(lighting(&window), Lighting::TwoSided);
}

#[test]
fn ambient_occlusion_is_switched_in_the_light_panel_undone_and_kept_by_sessions() {
    let mut window = wide(document());
    window.run();
    let ambient = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().scene.shadows.ambient;
    assert_eq!(ambient(&window), AmbientShares::Open);
    window.get_by_label("ambient occlusion").click();
    window.run();
    assert_eq!(ambient(&window), AmbientShares::Occluded);
    let reach = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().scene.shadows.reach;
    window.get_by_label("occlusion ends after").click();
    window.run();
    let scene = &document().state().scene.clone();
    let tenth = 0.1 * scene.frame.geometry.extent().length();
    assert_eq!(reach(&window), Some(tenth.max(scene.least_reach())));
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(reach(&window), None);
    let mut edited = document();
    edited.edit(&Edit::AmbientShares(AmbientShares::Occluded));
    edited.edit(&Edit::Reach(Some(1e-9)));
    assert_eq!(edited.state().scene.shadows.reach, Some(scene.least_reach()), "at least what a light grid holds");
    edited.edit(&Edit::Reach(Some(77.5)));
    let path = std::path::Path::new("session.toml");
    let text = document::session::text(path, &document::Source::default(), edited.opened(), edited.state()).unwrap();
    assert!(text.contains("[shadows]\nambient = \"occluded\"\nreach = 77.5"), "{text}");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(ambient(&window), AmbientShares::Open);
}

#[test]
fn scattered_light_is_switched_in_the_light_panel_undone_and_kept_by_sessions() {
    let mut window = wide(document());
    window.run();
    let orders = |window: &Harness<'_, App>| window.state().document.as_ref().unwrap().state().scene.scattering.orders;
    assert_eq!(orders(&window), Orders::Single);
    window.get_by_label("scattered light").click();
    window.run();
    assert_eq!(orders(&window), Orders::Multiple);
    let mut edited = document();
    edited.edit(&Edit::Orders(Orders::Multiple));
    let path = std::path::Path::new("session.toml");
    let text = document::session::text(path, &document::Source::default(), edited.opened(), edited.state()).unwrap();
    assert!(text.contains("[scattering]\norders = \"multiple\""), "{text}");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(orders(&window), Orders::Single);
}

#[test]
fn a_slider_takes_over_what_the_dial_made() {
    let mut document = document();
    document.edit(&Edit::Hand(DVec2::new(0.2, 0.4)));
    let by_dial = document.state().mix();
    let share = document.state().shares()[0];
    document.edit(&Edit::Weight(0, share));
    assert_eq!(document.state().light.mixing, Mixing::Sliders);
    for (ours, theirs) in document.state().mix().0.iter().zip(&by_dial.0) {
        assert!((ours.weight - theirs.weight).abs() <= 1e-12 * theirs.weight, "{} {}", ours.weight, theirs.weight);
    }
}

#[test]
fn the_lights_that_are_turned_on_again_shine_on_the_dial_too() {
    let mut document = document();
    for light in 0..2 {
        document.edit(&Edit::NodeOn(light, false));
        document.edit(&Edit::On(light, false));
    }
    document.edit(&Edit::Hand(DVec2::ZERO));
    let mut window = wide(document);
    window.run();
    window.get_by_label("Turn the lights on").click();
    window.run();
    let document = window.state_mut().document.as_mut().unwrap();
    document.edit(&Edit::Hand(DVec2::new(0.1, 0.2)));
    assert!(document.state().is_lit());
}

#[test]
fn who_decides_is_said_in_a_line_and_the_panels_below_stay_where_they_are() {
    let mut document = document();
    document.edit(&Edit::Mix(Mixing::Sliders));
    let top = |document: Document, line: &str| {
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document));
        window.run();
        assert!(window.query_by_label(line).is_some(), "{line}");
        window.get_by_label("Transfer function").rect().top()
    };
    let by_sliders = top(document.clone(), "Mix by");
    document.edit(&Edit::Hand(DVec2::ZERO));
    let by_dial = top(document, "Mix by");
    assert!((by_sliders - by_dial).abs() < 0.5, "{by_sliders} and {by_dial}");
}

#[test]
fn lights_that_are_turned_on_again_where_the_dial_mixes_leave_the_dial_and_the_sliders_as_they_are() {
    let mut document = document();
    document.edit(&Edit::Weight(0, 0.3));
    document.edit(&Edit::On(1, false));
    document.edit(&Edit::Hand(DVec2::new(0.1, 0.2)));
    let light = document.state().light.clone();
    for node in 0..2 {
        document.edit(&Edit::NodeOn(node, false));
    }
    assert!(!document.state().is_lit());
    let mut window = wide(document);
    window.run();
    window.get_by_label("Turn the lights on").click();
    window.run();
    let state = window.state().document.as_ref().unwrap().state();
    assert!(state.is_lit());
    assert_eq!(state.light, light, "who decides, the hand and the sliders");
}

#[test]
fn whose_brightness_is_kept_is_said_beside_the_switch() {
    let mut document = document();
    for (edit, whose) in [(Edit::Weight(0, 0.5), "by the sliders"), (Edit::Hand(DVec2::ZERO), "by the dial")] {
        document.edit(&edit);
        let mut window = wide(document.clone());
        window.run();
        assert!(window.query_by_label_contains(whose).is_some(), "{whose}");
    }
}
