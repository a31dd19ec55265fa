//! Several fields, such as channels: which are shown, the range of values that each shows, and what it hides.

use egui::{Grid, RichText, Ui, WidgetInfo, WidgetType};

use super::axis::places;
use super::controls::{choices, number, say_beside};
use crate::document::{Document, Edit};
use crate::scene::{FIRST_FIELD, Field, Overlap, Scene};
use crate::view::action::Action;

const SHOWN: &str = "Shows or hides this field. Its light, switched off, would leave it dark, and it would still hide what is behind. A change marches the volume again.";
const VALUES: &str = "The values that are shown: what the field shows is stretched to other ones.";
const OCCLUDES: &str = "Part of its scattering that hides what is behind: at 0 its light only adds, at 1 it hides others as its opacity says. A change marches the volume again.";

/// Shows a row for each field, if there are several.
pub(super) fn show(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    let scene = &document.state().scene;
    let further = scene.fields.further().len();
    if further == 0 {
        return;
    }
    ui.separator();
    Grid::new("fields").num_columns(4).spacing([8.0, 4.0]).show(ui, |ui| {
        ui.label("").on_hover_text(SHOWN);
        ui.label(RichText::new("from").small().weak()).on_hover_text(VALUES);
        ui.label(RichText::new("to").small().weak()).on_hover_text(VALUES);
        ui.label(RichText::new("occludes").small().weak()).on_hover_text(OCCLUDES);
        ui.end_row();
        for index in 0..=further {
            let Some(range) = scene.range_of(index) else { continue };
            row(ui, scene, (index, range), asked);
            ui.end_row();
        }
    });
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
    let mut shown = !scene.hidden[index];
    let eye = ui.checkbox(&mut shown, &name);
    eye.widget_info(|| WidgetInfo::selected(WidgetType::Checkbox, true, shown, format!("field {name}: shown")));
    if eye.on_hover_text(SHOWN).changed() {
        asked.push(Action::Edit(Edit::Hidden(index, !shown)));
    }
    let statistics = scene.fields.iter().nth(index).map(Field::statistics);
    let span = statistics.map_or(1.0, |statistics| statistics.max - statistics.min);
    for (end, word) in ["from", "to"].into_iter().enumerate() {
        let mut value = range[end];
        let field = number(ui, &mut value, places(span / 10.0), |drag| drag.speed(span / 1000.0));
        field.widget_info(|| WidgetInfo::slider(true, value, format!("field {name}: {word}")));
        let field = field.on_hover_text(VALUES);
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
    if let Some((index, material)) = own_material(scene, index).and_then(|own| Some((own, scene.materials.get(own)?))) {
        let mut part = material.occludes;
        let field = number(ui, &mut part, 2, |drag| drag.speed(0.01).range(0.0..=1.0)).on_hover_text(OCCLUDES);
        field.widget_info(|| WidgetInfo::slider(true, part, format!("field {name}: occludes")));
        if field.changed() {
            asked.push(Action::Edit(Edit::Occludes(index, part)));
        }
    }
}

/// The one material that field `index` shows, if no other field shows it.
fn own_material(scene: &Scene, index: usize) -> Option<usize> {
    let shown = |field: usize| scene.own_terms_of(field).iter().flat_map(|term| &term.material.0).map(|point| point.1);
    let own = shown(index).next()?;
    let others = (0..=scene.fields.further().len()).filter(|&other| other != index);
    (shown(index).all(|other| other == own) && !others.flat_map(shown).any(|other| other == own)).then_some(own)
}

/// Name of a field: that of the first is its material, if it has none and shows one alone.
fn name(scene: &Scene, index: usize) -> String {
    match index.checked_sub(1).and_then(|further| scene.fields.further().get(further)) {
        Some(field) => field.name.clone(),
        None if scene.fields.first().name != FIRST_FIELD => scene.fields.first().name.clone(),
        None => match scene.own_terms_of(0) {
            [term] if term.material.0.len() == 1 => {
                scene.materials.get(term.material.0[0].1).map_or_else(String::new, |material| material.name.clone())
            }
            _ => "the volume".to_owned(),
        },
    }
}
