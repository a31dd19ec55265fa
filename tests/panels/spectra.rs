//! Spectral curves and swatches of materials.

use std::path::Path;

use egui::{Event, Modifiers, PointerButton, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use relume::document;
use relume::document::Document;
use relume::document::SceneOptions;
use relume::progress::Quiet;
use relume::spectrum::colour::{LinearSrgb, OBSERVER, Xyz, display_code, linear_srgb_from_xyz};
use relume::spectrum::{Spectrum, ThinFilmAngle};

use crate::app::{App, document};
use crate::support::program::SCENE;

#[test]
fn a_curve_of_a_material_is_drawn_by_its_handles_and_a_drag_is_one_step_back() {
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(document()));
    window.run();
    let samples = |window: &Harness<'_, App>| {
        let document = window.state().document.as_ref().unwrap();
        let flesh = document.state().scene.materials.iter().find(|it| it.name == "flesh").unwrap();
        flesh.reflectance.spectrum().samples().map(f64::to_bits)
    };
    let before = samples(&window);
    assert!(window.query_by_label("flesh at 480 nm").is_none());
    window.get_by_label("draw flesh").click();
    window.run();
    let from = window.get_by_label("flesh at 480 nm").rect().center();
    let press = |pos, pressed| {
        let button = PointerButton::Primary;
        Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
    };
    let by = |y: f32| Event::PointerMoved(from + Vec2::new(0.0, y));
    for event in
        [by(0.0), press(from, true), by(-15.0), by(-400.0), by(-30.0), press(from + Vec2::new(0.0, -30.0), false)]
    {
        window.event(event);
        window.run();
    }
    window.state_mut().document.as_mut().unwrap().rest();
    let drawn = samples(&window);
    let [was, is] = [before, drawn].map(|samples| f64::from_bits(samples[20]));
    assert!(is > was + 0.2 && is < 1.0, "{is} from {was}");
    assert_eq!(drawn[40..], before[40..], "580 nm and longer: what is far stays, wherever the hand was on its way");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(samples(&window), before);
    window.get_by_label("draw flesh").click();
    window.run();
    assert!(window.query_by_label("flesh at 480 nm").is_none(), "a click more puts the curve away");
}

#[test]
fn a_phase_function_has_a_slider_where_nothing_shades() {
    let opened = |shading: &str| {
        let text = SCENE.replacen("version = 1", &format!("version = 1\nshading = \"{shading}\""), 1);
        Document::new(document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap())
    };
    let mut shaded = App::open(Vec2::new(1000.0, 3000.0), Some(opened("gradient")));
    shaded.run();
    assert!(shaded.query_by_label("flesh: phase function").is_none(), "it would have no effect");
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(opened("none")));
    window.run();
    let phase = |window: &Harness<'_, App>| {
        let document = window.state().document.as_ref().unwrap();
        document.state().scene.materials.iter().find(|it| it.name == "flesh").unwrap().phase
    };
    assert!(phase(&window).abs() <= 0.0);
    let rect = window.get_by_label("flesh: phase function").rect();
    let press = |pos, pressed| {
        let button = PointerButton::Primary;
        Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
    };
    let at = |part: f32| rect.lerp_inside(Vec2::new(part, 0.5));
    for event in [
        Event::PointerMoved(at(0.5)),
        press(at(0.5), true),
        Event::PointerMoved(at(0.6)),
        Event::PointerMoved(at(0.75)),
        press(at(0.75), false),
    ] {
        window.event(event);
        window.run();
    }
    window.state_mut().document.as_mut().unwrap().rest();
    let dragged = phase(&window);
    assert!(dragged > 0.4 && dragged < 0.7, "{dragged}");
    window.get_by_label("Undo").click();
    window.run();
    assert!(phase(&window).abs() <= 0.0, "a drag is one step back");
}

#[test]
fn a_film_is_chosen_where_surfaces_have_an_angle() {
    let opened = |shading: &str| {
        let text = SCENE.replacen("version = 1", &format!("version = 1\nshading = \"{shading}\""), 1);
        Document::new(document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap())
    };
    let mut unshaded = App::open(Vec2::new(1000.0, 3000.0), Some(opened("none")));
    unshaded.run();
    assert!(unshaded.query_by_label("flesh: film").is_none(), "it would have no effect");
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(opened("gradient")));
    window.run();
    let film = |window: &Harness<'_, App>| {
        let document = window.state().document.as_ref().unwrap();
        document.state().scene.materials.iter().find(|it| it.name == "flesh").unwrap().film.clone()
    };
    assert_eq!(film(&window), None);
    assert!(window.query_by_label("flesh: film, nm").is_none(), "without a film it has no thickness");
    window.get_by_label("flesh: film").click();
    window.run();
    window.get_by_label("in the diffuse light").click();
    window.run();
    let added = film(&window).unwrap();
    assert_eq!(added.angle(), ThinFilmAngle::Facing);
    window.state_mut().document.as_mut().unwrap().rest();
    let field = window.get_by_label("flesh: film, nm").rect().center();
    let press = |pos, pressed| {
        let button = PointerButton::Primary;
        Event::PointerButton { pos, button, pressed, modifiers: Modifiers::NONE }
    };
    let by = |x: f32| field + Vec2::new(x, 0.0);
    for event in [
        Event::PointerMoved(by(0.0)),
        press(by(0.0), true),
        Event::PointerMoved(by(10.0)),
        Event::PointerMoved(by(30.0)),
        press(by(30.0), false),
    ] {
        window.event(event);
        window.run();
    }
    window.state_mut().document.as_mut().unwrap().rest();
    let dragged = film(&window).unwrap().layers();
    assert!(dragged.thickness_nm > added.layers().thickness_nm, "{dragged:?}");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(film(&window), Some(added), "a drag is one step back");
    window.get_by_label("Undo").click();
    window.run();
    assert_eq!(film(&window), None);
}

#[test]
fn the_swatch_of_a_material_that_absorbs_is_the_light_seen_through_it() {
    let shapes = [
        "[materials.flesh]\nabsorption = { 380 = 0, 560 = 0, 580 = 1, 780 = 1 }",
        "[materials.flesh]\nabsorption = 0.5",
        "[materials.clear]\nreflectance = 0\nabsorption = { 380 = 0, 560 = 0, 580 = 1, 780 = 1 }\n[materials.flesh]",
    ];
    for (shape, of) in shapes.into_iter().zip(["flesh", "flesh", "clear"]) {
        let text =
            SCENE.replace("[materials.flesh]", shape).replace("material = \"flesh\"", &format!("material = \"{of}\""));
        let opened = document::parse("test", &text, Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
        let material = opened.scene.materials.iter().find(|material| material.name == of).unwrap();
        let transmittance = material.absorption.as_ref().unwrap().spectrum().samples().map(|depth| {
            let is_flat = shape.contains("0.5");
            if is_flat { 1.0 } else { 0.1_f64.powf(depth) }
        });
        let reflects = if of == "clear" { Spectrum::constant(1.0) } else { material.reflectance.spectrum().clone() };
        let seen = &Spectrum::from_samples(transmittance) * &reflects;
        let colour: DVec3 = opened
            .scene
            .lights
            .iter()
            .map(|light| {
                let sent = light.spectrum.spectrum() * &seen;
                let xyz = OBSERVER.each_ref().map(|matching| matching.dot(&sent));
                light.intensity * DVec3::from_array(linear_srgb_from_xyz(Xyz(xyz)).0)
            })
            .sum();
        let code = display_code(LinearSrgb(colour.to_array()));
        let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(Document::new(opened)));
        window.run();
        assert!(window.query_all_by_label(&code).next().is_some(), "{shape}: there is no swatch of {code}");
    }
}
