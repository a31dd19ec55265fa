//! What several panels are made of.

use egui::{CollapsingHeader, Color32, RichText, Sense, Ui, Vec2};

use crate::view::state::Cost;

/// A panel that can be folded, with what its controls cost. The same words everywhere, so that they are learnt once.
pub(super) fn panel(ui: &mut Ui, name: &str, cost: Cost, contents: impl FnOnce(&mut Ui)) {
    let title = RichText::new(name).strong();
    CollapsingHeader::new(title).id_salt(name).default_open(true).show(ui, |ui| {
        ui.horizontal(|ui| {
            let (dot, _) = ui.allocate_exact_size(Vec2::splat(8.0), Sense::hover());
            ui.painter().circle_filled(dot.center(), 3.5, colour(ui, cost));
            ui.label(RichText::new(word(cost)).small().color(colour(ui, cost))).on_hover_text(sentence(cost));
        });
        contents(ui);
    });
    ui.add_space(4.0);
}

fn word(cost: Cost) -> &'static str {
    match cost {
        Cost::Relight => "relights: at once",
        Cost::March => "marches: coarse first",
    }
}

fn sentence(cost: Cost) -> &'static str {
    match cost {
        Cost::Relight => "What is changed here changes the light alone: the rays through the volume are kept.",
        Cost::March => "What is changed here sends all rays through the volume anew: first a few, then all of them.",
    }
}

fn colour(ui: &Ui, cost: Cost) -> Color32 {
    match (cost, ui.visuals().dark_mode) {
        (Cost::Relight, true) => Color32::from_rgb(110, 200, 130),
        (Cost::Relight, false) => Color32::from_rgb(20, 110, 50),
        (Cost::March, true) => Color32::from_rgb(235, 170, 90),
        (Cost::March, false) => Color32::from_rgb(150, 80, 0),
    }
}
