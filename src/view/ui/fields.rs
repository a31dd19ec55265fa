//! Values of several fields, such as channels: the range that each shows.

use egui::{Ui, WidgetInfo};

use super::axis::places;
use super::controls::{choices, number, say_beside};
use crate::document::{Document, Edit};
use crate::scene::{FIRST_FIELD, Field, Overlap, Scene};
use crate::view::action::Action;

/// Shows a row for each field, if there are several.
pub(super) fn show(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    let scene = &document.state().scene;
    let further = scene.fields.further().len();
    if further == 0 {
        return;
    }
    ui.separator();
    for index in 0..=further {
        let Some(range) = scene.range_of(index) else { continue };
        ui.horizontal(|ui| row(ui, scene, (index, range), asked));
    }
    let label = ("Where they overlap", "What is seen where several have a medium. A change marches the volume again.");
    let all = [
        (Overlap::Add, "together", "Their media scatter and absorb together."),
        (Overlap::First, "first", "The first of them alone: it hides the others."),
        (Overlap::Last, "last", "The last of them alone: it replaces the others."),
    ];
    let why = |overlap: Overlap| Scene { overlap, ..scene.clone() }.refused().map(|why| why.to_string());
    let chosen = choices(ui, label, &all, scene.overlap, why);
    asked.extend(chosen.map(|overlap| Action::Edit(Edit::Overlap(overlap))));
}

fn row(ui: &mut Ui, scene: &Scene, (index, range): (usize, [f64; 2]), asked: &mut Vec<Action>) {
    let name = name(scene, index);
    ui.label(&name).on_hover_text("The values of this field that are shown: what it shows is stretched to other ones.");
    let statistics = scene.fields.iter().nth(index).map(Field::statistics);
    let span = statistics.map_or(1.0, |statistics| statistics.max - statistics.min);
    for (end, word) in ["from", "to"].into_iter().enumerate() {
        ui.label(word);
        let mut value = range[end];
        let field = number(ui, &mut value, places(span / 10.0), |drag| drag.speed(span / 1000.0));
        field.widget_info(|| WidgetInfo::slider(true, value, format!("field {name}: {word}")));
        if field.changed() && value.to_bits() != range[end].to_bits() {
            let mut next = range;
            next[end] = value;
            if next[0] < next[1] {
                asked.push(Action::Edit(Edit::FieldRange(index, next)));
            } else {
                say_beside(&field, "The range would have no width: move its other end first.".to_owned());
            }
        }
    }
}

/// Name of a field: that of the first is its material, if it has none and shows one alone.
fn name(scene: &Scene, index: usize) -> String {
    match index.checked_sub(1).and_then(|further| scene.fields.further().get(further)) {
        Some(field) => field.name.clone(),
        None if scene.fields.first().name != FIRST_FIELD => scene.fields.first().name.clone(),
        None => match scene.terms_of(0) {
            [term] if term.material.0.len() == 1 => {
                scene.materials.get(term.material.0[0].1).map_or_else(String::new, |material| material.name.clone())
            }
            _ => "the volume".to_owned(),
        },
    }
}
