//! The rows of several fields: what is shown, its range, and what it hides.

use std::path::Path;

use egui::Vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use relume::document::{self, Document, SceneOptions};
use relume::progress::Quiet;
use relume::scene::{Overlap, Scene};

use crate::app::{App, retype};

fn scene<'a>(window: &'a Harness<'_, App>) -> &'a Scene {
    &window.state().document.as_ref().unwrap().state().scene
}

#[test]
fn a_row_hides_a_field_and_sets_its_range_and_what_it_hides() {
    let interval =
        |material: &str| format!("intervals = [{{ material = \"{material}\", range = [50, 90], opacity = 0.2 }}]\n");
    let text = [
        "version = 1\nshading = \"none\"\n[volume]\nphantom = \"frog\"\ndims = [9, 9, 9]\nname = \"ct\"\n[lights.day]\nspectrum = \"D65\"\n",
        "[materials]\nbone.reflectance = \"white 9.5\"\nglow.reflectance = \"orange\"\n[transfer]\n",
        &interval("bone"),
        "[volumes.pet]\nphantom = \"frog\"\n[volumes.pet.transfer]\n",
        &interval("glow"),
    ];
    let file = document::parse("test", &text.concat(), Path::new(""), &SceneOptions::default(), &Quiet).unwrap();
    let mut window = App::open(Vec2::new(1000.0, 3000.0), Some(Document::new(file)));
    window.run();
    window.get_by_label("field pet: shown").click();
    window.run();
    assert_eq!(scene(&window).hidden, [false, true, false, false]);
    retype(&mut window, "field pet: from", "60");
    retype(&mut window, "field pet: occludes", "0.25");
    retype(&mut window, "field ct: occludes", "0");
    window.run();
    assert_eq!(scene(&window).range_of(1), Some([60.0, 90.0]), "also of a hidden one");
    assert_eq!(scene(&window).materials.iter().map(|material| material.occludes).collect::<Vec<_>>(), [0.0, 0.25]);
    window.get_by_label("field pet: shown").click();
    window.get_by_label("last").click();
    window.run();
    assert!(!scene(&window).hidden[1] && scene(&window).overlap == Overlap::Last);
}
