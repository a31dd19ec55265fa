//! The accuracy panel.

use egui::Vec2;
use egui_kittest::kittest::Queryable;
use relume::document::Edit;
use relume::measure::{Goal, Point, Preset, Setting};
use relume::model::ErrorSummary;
use relume::scene::{Accuracy, Integration};
use relume::view::Action;
use relume::view::effort::Curve;

use crate::app::{App, document};

#[test]
fn a_preset_asks_to_measure_and_a_point_of_the_curve_is_taken_by_a_click() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    window.get_by_label("balanced").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Measure(Some(Preset::Balanced.goal()))));
    window.get_by_label("choose by frame within").click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Measure(Some(Goal::Budget(50.0)))));
    let scene = document().state().scene.clone();
    let error = |p95: f64| ErrorSummary { mean: p95, p95, max: p95 };
    let point = |frame_ms: f64, p95: f64| Point { frame_ms, error: error(p95), ..Point::default() };
    let mut finer = scene.clone();
    finer.accuracy.step_length = 0.5;
    let mut curve = Curve::new(&scene, [4, 4], &[(Setting::default(), point(2.0, 3.0))]);
    curve.merge(Curve::new(&finer, [4, 4], &[(Setting::default(), point(4.0, 1.0))]));
    window.state_mut().curve = Some(curve);
    window.run();
    window.get_all_by_label("as the scene says").nth(1).unwrap().click();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Accuracy(finer.accuracy.clone()))));
    assert_eq!(window.state().document.as_ref().unwrap().state().scene.accuracy, finer.accuracy);
}

#[test]
fn rays_are_chosen_from_a_menu() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    window.get_by_label("rays per pixel").click();
    window.run();
    window.get_by_label("16").click();
    window.run();
    let changed = Accuracy { rays: 16, ..document().state().scene.accuracy.clone() };
    assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Accuracy(changed))));
    assert_eq!(window.state().document.as_ref().unwrap().state().scene.accuracy.rays, 16);
    assert!(window.query_by_label("Smooth labels").is_none(), "the scene has no labels");
}

#[test]
fn the_switch_of_segments_changes_the_integration_where_the_plan_has_them() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    window.get_by_label("Segments").click();
    window.run();
    let accuracy = || document().state().scene.accuracy.clone();
    let changed = Accuracy { integration: Integration::Segments, ..accuracy() };
    assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Accuracy(changed))));
    window.get_by_label("Segments").click();
    window.run();
    let changed = Accuracy { integration: Integration::Samples, ..accuracy() };
    assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Accuracy(changed))));
    for (label, changed) in [
        ("Adaptive", Accuracy { integration: Integration::Adaptive, ..accuracy() }),
        ("Jitter", Accuracy { integration: Integration::Adaptive, jitter: true, ..accuracy() }),
    ] {
        window.get_by_label(label).click();
        window.run();
        assert_eq!(window.state().asked.last(), Some(&Action::Edit(Edit::Accuracy(changed))));
    }
}
