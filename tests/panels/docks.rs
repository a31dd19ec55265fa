//! Docks around the picture.

use egui::{Key, Pos2, Rect, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use relume::document::Document;
use relume::view::Script;
use relume::view::layout::{Arrange, Dock, Tab};
use relume::view::script::Command;
use relume::view::{Action, ui};

use crate::app::{App, click_at, document, drag_along};

fn with_values() -> Document {
    let document = document();
    let statistics = document.opened().scene.volume().statistics().unwrap();
    document.with_statistics(statistics)
}

fn opened(size: [f32; 2]) -> Harness<'static, App> {
    let mut window = App::open(Vec2::from(size), Some(with_values()));
    window.run();
    window
}

fn rect(window: &Harness<'_, App>, label: &str) -> Rect {
    window.get_by_label(label).rect()
}

#[test]
fn the_picture_keeps_the_middle_of_a_window_with_docks_on_three_sides() {
    for (size, least) in [([1280.0, 720.0], [640.0, 400.0]), ([1920.0, 1080.0], [1280.0, 760.0])] {
        let window = opened(size);
        let picture = window.state().place;
        assert!(picture.width() >= least[0] && picture.height() >= least[1], "{size:?}: {picture:?}");
        let window_rect = Rect::from_min_size(Pos2::ZERO, Vec2::from(size));
        for (label, is_there) in [
            ("light dial", [true, false, false]),
            ("tab: Camera", [false, true, false]),
            ("histogram and intervals", [false, false, true]),
        ] {
            let control = rect(&window, label);
            assert!(window_rect.contains_rect(control), "{label}: {control:?}");
            let sides = [
                control.right() <= picture.left(),
                control.left() >= picture.right(),
                control.top() >= picture.bottom(),
            ];
            assert_eq!(sides, is_there, "{label}: {control:?} beside {picture:?}");
        }
    }
}

#[test]
fn no_control_of_the_bottom_dock_is_cut_off() {
    for size in [[1280.0, 720.0], [1920.0, 1080.0]] {
        let mut window = opened(size);
        window.run();
        let (picture, height) = (window.state().place, size[1]);
        for label in ["histogram and intervals", "Add interval", "Presets", "interval 0: from", "remove interval 0"] {
            let control = rect(&window, label);
            let inside = control.left() >= picture.left() && control.right() <= picture.right();
            assert!(inside && control.bottom() < height - 20.0, "{size:?}: {label}: {control:?}");
        }
    }
}

#[test]
fn a_wide_bottom_dock_shows_the_spectra_beside_the_transfer_function() {
    assert!(opened([1280.0, 720.0]).query_by_label("draw flesh").is_none());
    let window = opened([1920.0, 1080.0]);
    let [histogram, curve] = ["histogram and intervals", "draw flesh"].map(|label| rect(&window, label));
    assert!(curve.left() > histogram.right() && curve.top() > window.state().place.bottom());
}

#[test]
fn a_tab_shows_its_panel_and_the_others_leave() {
    let mut window = opened([1280.0, 720.0]);
    let inside = [(Tab::Crop, "crop"), (Tab::Display, "white balance"), (Tab::Accuracy, "Measure the curve")];
    for (tab, shown) in inside {
        assert!(window.query_by_label(shown).is_none(), "{shown}");
        window.get_by_label(&format!("tab: {}", tab.name())).click();
        window.run();
        assert_eq!(window.state().asked.last(), Some(&Action::Arrange(Arrange::Tab(tab))));
        assert!(window.query_by_label(shown).is_some() && window.query_by_label("Orthographic").is_none(), "{shown}");
    }
    window.get_by_label("tab: Spectra").click();
    window.run();
    assert!(window.query_by_label("draw flesh").is_some() && window.query_by_label("Add interval").is_none());
}

#[test]
fn a_closed_dock_leaves_its_room_to_the_picture_and_returns_with_its_size() {
    let mut window = opened([1280.0, 720.0]);
    let edge = |window: &Harness<'_, App>| window.state().place.right();
    let before = window.state().place;
    let at = Pos2::new(before.right() + 1.0, 300.0);
    drag_along(&mut window, &[at, at - Vec2::new(40.0, 0.0), at - Vec2::new(60.0, 0.0)]);
    window.run();
    let dragged = edge(&window);
    assert!((dragged - (before.right() - 60.0)).abs() < 4.0, "{dragged}");
    for (dock, grows) in [(Dock::Right, [true, false]), (Dock::Bottom, [false, true]), (Dock::Left, [true, false])] {
        let with = window.state().place.size();
        let label = format!("{} dock", dock.name());
        window.get_by_label(&label).click();
        window.run();
        let without = window.state().place.size();
        assert_eq!([without.x > with.x + 100.0, without.y > with.y + 100.0], grows, "{label}");
        window.get_by_label(&label).click();
        window.run();
        assert_eq!(window.state().place.size(), with, "{label}");
    }
    assert!((edge(&window) - dragged).abs() < 1.0, "its size is kept");
    window.key_press(Key::F1);
    window.run();
    assert!(window.state().place.width() > 1250.0 && window.query_by_label("light dial").is_none());
}

#[test]
fn a_window_without_room_for_docks_has_one_column() {
    let window = opened([1000.0, 3000.0]);
    let labels = ["light dial", "histogram and intervals", "Orthographic", "white balance", "Measure the curve"];
    for label in labels {
        assert!(rect(&window, label).right() <= window.state().place.left(), "{label}");
    }
    assert!(window.query_by_label("tab: Camera").is_none() && window.query_by_label("left dock").is_none());
    let small = opened([ui::ROOM_FOR_PANELS - 1.0, 400.0]);
    assert!(small.state().place.width() > 530.0, "it opens without");
}

#[test]
fn each_panel_has_a_mark_and_one_legend_explains_them() {
    let mut window = opened([1000.0, 3000.0]);
    // The panels' marks and the legend's.
    let marks = |window: &Harness<'_, App>, word: &str| window.query_all_by_label(word).count();
    let before = ["at once", "coarse first"].map(|word| marks(&window, word));
    // A mark and a word in the legend; lights, dial, presets, display and spectra; transfer function, camera, crop box,
    // clip planes and accuracy.
    assert_eq!(before, [2 + 5, 2 + 5]);
    window.state_mut().panels = false;
    window.run();
    assert_eq!(["at once", "coarse first"].map(|word| marks(&window, word)), [0, 0]);
}

#[test]
fn a_window_over_the_docks_hides_nothing_of_the_picture() {
    let mut window = opened([1280.0, 720.0]);
    window.state_mut().probe = Some((glam::DVec2::new(0.9, 0.5), Some(crate::app::probed())));
    window.run();
    window.run();
    let picture = window.state().place;
    assert!(rect(&window, "Under each light").left() > picture.left() + 0.9 * picture.width());
}

#[test]
fn scripts_arrange_docks_and_tabs() {
    let of = |line: &str| Script::parse("test", line).map(|script| script.command(0).cloned().unwrap());
    for (line, change) in [
        ("dock left off", Arrange::Dock(Dock::Left, false)),
        ("dock bottom on", Arrange::Dock(Dock::Bottom, true)),
        ("tab accuracy", Arrange::Tab(Tab::Accuracy)),
        ("tab transfer", Arrange::Tab(Tab::Transfer)),
    ] {
        assert_eq!(of(line).unwrap(), Command::Do(Action::Arrange(change)), "{line}");
    }
    for (line, told) in
        [("dock top on", "left, right or bottom"), ("dock left", "on or off"), ("tab x", "crop, display")]
    {
        let error = of(line).unwrap_err().to_string();
        assert!(error.contains(told), "{line}: {error}");
    }
}

#[test]
fn a_click_beside_the_docks_still_probes() {
    let mut window = opened([1280.0, 720.0]);
    let picture = window.state().place;
    for at in [picture.center(), picture.left_top() + Vec2::splat(12.0), picture.right_bottom() - Vec2::splat(12.0)] {
        click_at(&mut window, at);
        assert!(matches!(window.state().asked.last(), Some(Action::Probe(Some(_)))), "{at}");
    }
}

#[test]
fn docks_open_with_the_sizes_of_the_last_run_within_their_limits() {
    let with = |sizes: [Option<f32>; 3]| {
        let mut window = App::open(Vec2::new(1600.0, 900.0), Some(with_values()));
        window.state_mut().layout.sizes = sizes;
        // The first frames were laid out without the sizes.
        window.ctx.data_mut(egui::util::IdTypeMap::clear);
        window.run();
        window.run();
        window
    };
    let apart = |window: &Harness<'_, App>, expected: [f32; 3]| {
        let sizes = ui::dock_sizes(&window.ctx).map(Option::unwrap);
        sizes.iter().zip(expected).map(|(size, expected)| (size - expected).abs()).fold(0.0, f32::max)
    };
    let window = with([Some(345.0), Some(410.0), Some(300.0)]);
    assert!(apart(&window, [345.0, 410.0, 300.0]) <= 1.0, "{:?}", ui::dock_sizes(&window.ctx));
    assert!((window.state().place.left() - 345.0).abs() < 20.0, "{:?}", window.state().place);
    let usual = with([None; 3]);
    let sizes = ui::dock_sizes(&usual.ctx).map(Option::unwrap);
    let damaged = with([Some(1.0), Some(1e9), Some(f32::MIN_POSITIVE)]);
    let found = ui::dock_sizes(&damaged.ctx).map(Option::unwrap);
    assert!((found[0] - sizes[0]).abs() <= 1.0 && (500.0..=540.0).contains(&found[1]), "{found:?}");
    assert!((100.0..200.0).contains(&found[2]), "{found:?}");
}

#[test]
fn a_dragged_edge_of_a_dock_changes_the_size_that_is_kept() {
    let mut window = opened([1600.0, 900.0]);
    let before = ui::dock_sizes(&window.ctx).map(Option::unwrap);
    let edge = Pos2::new(window.state().place.left() - 1.0, 400.0);
    drag_along(&mut window, &[edge, edge + Vec2::new(20.0, 0.0), edge + Vec2::new(40.0, 0.0)]);
    window.run();
    let after = ui::dock_sizes(&window.ctx).map(Option::unwrap);
    assert!((after[0] - before[0] - 40.0).abs() < 3.0, "{before:?} to {after:?}");
    let [(Dock::Left, size)] = window.state().resized[..] else { panic!("{:?}", window.state().resized) };
    assert!((size - after[0]).abs() < 3.0, "{size}, {after:?}");
    // Other clicks and drags leave the sizes as they are, in a window that is too small for them, too.
    let middle = window.state().place.center();
    click_at(&mut window, middle);
    drag_along(&mut window, &[middle, middle + Vec2::new(20.0, 0.0), middle + Vec2::new(40.0, 0.0)]);
    assert_eq!(window.state().resized.len(), 1, "{:?}", window.state().resized);
}
