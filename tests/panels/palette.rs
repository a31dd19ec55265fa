//! The palette designer.

use std::sync::Arc;

use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use relume::document::design::{self, Spectra, Step};
use relume::document::{Document, Edit};
use relume::palette::{Conflict, SmoothCost, Smoothing, WayOut};
use relume::spectrum::colour::{LinearSrgb, OBSERVER, Xyz, bradford, d65_white, display_code, linear_srgb_from_xyz};
use relume::spectrum::observer::{OBSERVER_1964, Observer};
use relume::spectrum::{Spectrum, standard};
use relume::view::Action;

use crate::app::{App, document, offered, wide};

#[test]
fn a_palette_is_offered_its_cells_are_chosen_and_its_spectra_opened() {
    let mut window = wide(document());
    window.run();
    window.get_all_by_label("Palette").next().unwrap().click();
    window.run();
    window.get_by_label("Design a palette").click_accesskit();
    window.run();
    let palette = |window: &Harness<'_, App>| {
        window.state().document.as_ref().unwrap().state().palette.as_deref().cloned().unwrap()
    };
    assert_eq!(palette(&window).materials.len(), 2);
    // As the window does while no button is held: the next edit is an undo step of its own.
    window.state_mut().document.as_mut().unwrap().rest();
    window.get_by_label("flesh under day").click_accesskit();
    window.run();
    assert!(window.query_by_label("weight").is_some(), "what is asked of the cell");
    window.get_by_label("lamp: open").click_accesskit();
    window.run();
    assert_eq!(palette(&window).lights.iter().filter(|light| light.spectrum.is_none()).count(), 1);
    window.get_by_label("Solve").click_accesskit();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Solve(None)));
    window.get_by_label("Undo").click();
    window.run();
    assert!(palette(&window).lights.iter().all(|light| light.spectrum.is_some()), "a step back");
}

#[test]
fn swatches_are_as_whoever_looks_sees_them_and_a_palette_says_for_whom_it_is() {
    let mut window = wide(document());
    window.run();
    window.get_all_by_label("Palette").next().unwrap().click();
    window.run();
    window.get_by_label("Design a palette").click_accesskit();
    let scene = document().state().scene.clone();
    for (observer, table) in [(Observer::Cie1931, &OBSERVER), (Observer::Cie1964, &OBSERVER_1964)] {
        window.state_mut().document.as_mut().unwrap().edit(&Edit::Observer(observer));
        window.run();
        // From the published table, with daylight as the display white.
        let raw = |spectrum: &Spectrum| DVec3::from(table.each_ref().map(|matching| matching.dot(spectrum)));
        let white = raw(standard::d65().spectrum());
        let linear = |spectrum: &Spectrum| -> DVec3 {
            let shown = bradford(Xyz((white / white.y).to_array()), d65_white()) * raw(spectrum) / white.y;
            linear_srgb_from_xyz(Xyz(shown.to_array())).0.into()
        };
        let light = |spectrum: &Spectrum| linear(spectrum).max(DVec3::ZERO) / linear(spectrum).max_element();
        let lights: Vec<DVec3> = scene.lights.iter().map(|it| light(it.spectrum.spectrum())).collect();
        let material = |reflectance: &Spectrum| -> DVec3 {
            let under = scene.lights.iter().map(|it| it.intensity * linear(&(it.spectrum.spectrum() * reflectance)));
            under.sum()
        };
        let materials = scene.materials.iter().map(|it| material(it.reflectance.spectrum()));
        for colour in lights.into_iter().chain(materials) {
            let code = display_code(LinearSrgb(colour.to_array()));
            assert!(window.query_all_by_label(&code).next().is_some(), "{observer}: there is no swatch of {code}");
        }
        let told = window.query_all_by_label_contains("palettes are designed").count();
        assert_eq!(told, usize::from(observer == Observer::Cie1964), "{observer}");
    }
}

#[test]
fn a_way_out_of_what_cannot_be_had_is_a_button_that_changes_it_and_solves_again() {
    let mut document = document();
    document.edit(&offered(&document));
    document.rest();
    let mut window = wide(document);
    window.state_mut().design = true;
    let open = WayOut::Open { light: "lamp".to_owned() };
    let gone = WayOut::Open { light: "moon".to_owned() };
    window.state_mut().conflicts = vec![Conflict {
        cells: vec![(0, 0)],
        part: vec![(0, 0)],
        least: 1.0,
        reached: 1.0,
        reason: "flesh cannot be black".to_owned(),
        ways_out: vec![open, gone],
    }];
    window.run();
    assert!(window.query_by_label("The targets conflict: flesh cannot be black.").is_some());
    assert!(window.query_by_label("Leave the light moon open").is_none(), "there is no such light any more");
    window.get_by_label("Leave the light lamp open").click_accesskit();
    window.run();
    let asked = &window.state().asked;
    let step = Step::Open(design::Side::Light, 1, true);
    assert_eq!(
        asked[..],
        [Action::Solve(Some(step))],
        "both or none: a step back undoes what it changes and what is solved"
    );
}

#[test]
fn a_way_out_and_the_spectra_that_are_solved_by_it_are_one_step_back() {
    let mut document = document();
    document.edit(&offered(&document));
    document.rest();
    let is_open = |document: &Document| document.state().palette.as_ref().unwrap().lights[1].spectrum.is_none();
    let lamp = |document: &Document| document.state().scene.lights[1].spectrum.clone();
    let before = lamp(&document);
    let step = Some(Step::Open(design::Side::Light, 1, true));
    let found = Spectra::standard(&document.state().scene, design::Side::Light, "lamp", "FL11").unwrap();
    document.edit(&Edit::Spectra(Arc::new(Spectra { step, ..found })));
    assert!(is_open(&document) && lamp(&document) != before);
    document.undo();
    assert!(!is_open(&document) && lamp(&document) == before, "both");
    document.redo();
    assert!(is_open(&document) && lamp(&document) != before, "both again");
}

#[test]
fn a_preset_of_smoothness_solves_again_and_shows_its_cost_after_a_comparison() {
    let mut document = document();
    document.edit(&offered(&document));
    document.rest();
    let mut window = wide(document);
    window.state_mut().design = true;
    window.run();
    window.get_by_label("Compare").click_accesskit();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::CompareSmoothness));
    window.state_mut().smoother = vec![SmoothCost { smoothing: Smoothing::Smoother, worst: 0.314, edge: 0.0 }];
    window.run();
    assert!(window.query_by_label("spectra: smooth").is_some(), "not compared");
    window.get_by_label("spectra: smoother: ΔE00 0.31").click_accesskit();
    window.run();
    assert_eq!(window.state().asked.last(), Some(&Action::Solve(Some(Step::SmoothAll(1e-2)))));
}
