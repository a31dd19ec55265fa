//! The probe of a pixel.

use std::path::Path;

use egui::{Event, Key, Modifiers, PointerButton, Vec2};
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use relume::document;
use relume::document::SceneOptions;
use relume::document::moves::Move;
use relume::document::{Document, Edit};
use relume::progress::Quiet;
use relume::scene::Interval;
use relume::view::Action;

use crate::app::{click_at, document, probed, probed_of, wide};
use crate::support::program::SCENE;

#[expect(clippy::cast_possible_truncation, reason = "parts of a window")]
fn narrow(number: f64) -> f32 {
    number as f32
}

#[test]
fn a_click_on_the_picture_looks_at_the_pixel_there() {
    let mut window = wide(document());
    window.run();
    let rect = window.state().place;
    let at = rect.min + rect.size() * Vec2::new(0.25, 0.5);
    window.event(Event::PointerMoved(at));
    window.run();
    for pressed in [true, false] {
        let button = PointerButton::Primary;
        window.event(Event::PointerButton { pos: at, button, pressed, modifiers: Modifiers::NONE });
        window.run();
    }
    let Some(Action::Probe(Some(place))) = window.state().asked.last() else { panic!("{:?}", window.state().asked) };
    assert!((*place - DVec2::new(0.25, 0.5)).length() <= 1e-3, "{place}");
}

#[test]
fn the_probe_names_lights_and_materials_and_escape_closes_it() {
    let mut window = wide(document());
    window.state_mut().probe = Some((DVec2::splat(0.5), None));
    window.run();
    assert!(window.query_by_label("Waiting for the picture.").is_some());
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probed())));
    window.run();
    for label in ["Under each light", "What it shows", "Where its light comes from", "Along the ray", "flesh", "now"] {
        assert!(window.query_all_by_label(label).next().is_some(), "{label}");
    }
    window.key_press(Key::Escape);
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Probe(None)));
}

#[test]
fn a_ray_that_misses_the_volume_is_said_to_and_not_to_be_followed_for_ever() {
    let mut document = document();
    document.edit(&Edit::Camera(Move::Dolly(0.1), 1.0));
    let mut window = wide(document.clone());
    window.state_mut().probe = Some((DVec2::splat(0.25), Some(probed_of(&document))));
    window.run();
    assert!(window.query_by_label_contains("The ray misses the volume").is_some());
    assert!(window.query_by_label_contains("marching the ray").is_none());
}

#[test]
fn all_that_the_probe_says_is_seen_in_a_window_of_1280_by_720() {
    let mut window = wide(document());
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probed())));
    window.run();
    window.run();
    let last = window.get_by_label_contains("orange: transmittance").rect();
    // Above the status line.
    assert!(last.bottom() <= 720.0 - 30.0 && last.top() > 300.0, "{last:?}");
}

#[test]
fn a_click_that_closes_a_popup_looks_at_no_pixel() {
    let mut window = wide(document());
    window.run();
    let picture = window.get_by_label("picture").rect();
    window.get_by_label("File").click();
    window.run();
    click_at(&mut window, picture.center());
    assert!(window.state().asked.is_empty(), "{:?}", window.state().asked);
    click_at(&mut window, picture.center() + Vec2::new(20.0, 0.0));
    assert!(matches!(window.state().asked.last(), Some(Action::Probe(Some(_)))), "{:?}", window.state().asked);
}

#[test]
fn what_colours_the_light_that_passes_is_named() {
    let text = SCENE.replace(
        "[materials.flesh]",
        "[materials.stain]\nreflectance = 0\nabsorption = { 380 = 1, 560 = 1, 580 = 0, 780 = 0 }\n[materials.flesh]",
    );
    let scene = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let mut document = Document::new(scene);
    document.edit(&Edit::AddInterval(
        Interval {
            material: document.state().scene.materials.iter().position(|material| material.name == "stain").unwrap(),
            range: [-1e6, 1e6],
            ramp: 0.0,
            opacity: 0.0,
            absorption: 0.05,
        },
        Vec::new(),
    ));
    let mut window = wide(document.clone());
    let probe = probed_of(&document);
    assert!(probe.absorbed.iter().sum::<f64>() > 0.1, "{:?}", probe.absorbed);
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probe)));
    window.run();
    assert!(window.query_by_label("What colours its light").is_some());
    // In the panel and in the legend of the ray.
    let named = window.query_all_by_label("stain").filter(|node| node.rect().left() > 300.0).count();
    assert_eq!(named, 2);
}

#[test]
fn the_probe_opens_beside_the_pixel_that_was_clicked() {
    for part in [0.05, 0.5, 0.95] {
        let mut window = wide(document());
        window.state_mut().probe = Some((DVec2::new(part, 0.3), Some(probed())));
        window.run();
        window.run();
        let picture = window.get_by_label("picture").rect();
        let at = picture.left() + picture.width() * narrow(part);
        let left = window.get_by_label("Under each light").rect().left();
        let (left, right) = (left - 12.0, left + 300.0);
        assert!(at < left || at > right, "{at} from {left} to {right}");
    }
}

#[test]
fn what_the_probe_says_of_materials_are_parts_of_a_whole() {
    let probe = probed();
    let seen = probe.seen.iter().sum::<f64>() + probe.transmittance;
    assert!((seen - 1.0).abs() < 0.01, "the pixel: {seen}");
    let light = probe.shares.iter().map(|share| share.light).sum::<f64>();
    assert!((light - 1.0).abs() < 1e-9, "its light: {light}");
    let mut window = wide(document());
    window.state_mut().probe = Some((DVec2::splat(0.5), Some(probe)));
    window.run();
    for label in ["of the pixel", "blue: fraction of equal-energy light"] {
        assert!(window.query_by_label(label).is_some(), "{label}");
    }
    assert!(window.query_all_by_label("of its light").count() >= 1);
}
