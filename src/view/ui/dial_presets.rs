//! Dial presets: named positions of the dial's hand, to return to and to tour.

use egui::{Id, Key, TextEdit, Ui, WidgetInfo};

use super::controls::{panel, remembered, toggle};
use crate::document::{DialPreset, Mixing};
use crate::document::{Document, Edit};
use crate::plan::Stale;
use crate::view::action::Action;
use crate::view::tour::{LONGEST, Tour};

/// Initial duration of a tour in seconds.
const SECONDS: f64 = 8.0;
/// Initial number of pictures of a saved tour.
const FRAMES: u16 = 50;

/// Shows the presets and the controls to save and tour them, if the scene has a dial.
pub(super) fn show(ui: &mut Ui, document: &Document, tour: Option<&Tour>, asked: &mut Vec<Action>) {
    let state = document.state();
    let presets = &state.dial.presets;
    if state.dial.nodes.len() < 2 {
        return;
    }
    let here = document.preset();
    let mut places = state.dial.nodes.iter().zip(&document.opened().dial.nodes);
    let are_moved = places.any(|(node, opened)| node.place != opened.place);
    panel(ui, "Dial presets", Stale::Picture, |ui| {
        let mut ask = |edit| asked.push(Action::Edit(edit));
        // An empty row would still take space.
        if !presets.is_empty() {
            ui.horizontal_wrapped(|ui| {
                for (index, preset) in presets.iter().enumerate() {
                    let label = toggle(ui, here == Some(index), &preset.name);
                    let label = if preset.caption.is_empty() { label } else { label.on_hover_text(&preset.caption) };
                    if label.clicked() {
                        ask(Edit::DialPreset(index));
                    }
                }
            });
        }
        let nodes = &state.dial.nodes;
        let between = |preset: &DialPreset| !nodes.iter().any(|node| node.lies_at(preset.hand));
        if are_moved && presets.iter().any(between) {
            let text = "Nodes were moved: presets between nodes now have a different light.";
            let help = "A preset is a position of the hand. A preset on a node moves with it; elsewhere, its light is the mix at this position.";
            ui.label(egui::RichText::new(text).small().weak()).on_hover_text(help);
        }
        let id = Id::new("name of a preset");
        let mut name: String = ui.data(|data| data.get_temp(id)).unwrap_or_default();
        // Wrapped, because a longer word would widen the panels and cause a new march.
        ui.horizontal_wrapped(|ui| {
            let field = ui.add(TextEdit::singleline(&mut name).hint_text("a name").desired_width(64.0));
            let entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            field.on_hover_text("Name for the present light.");
            let given = name.trim().to_owned();
            let can = !given.is_empty() && state.light.mixing == Mixing::Dial;
            let replaces = presets.iter().any(|preset| preset.name == given);
            let (word, help) = if replaces {
                ("Replace", "A preset of this name exists: replaces it by the present hand and switched-off nodes.")
            } else {
                ("Keep", "Saves the hand and the switched-off nodes as a preset of this name.")
            };
            let keep = ui.add_enabled(can, egui::Button::new(word)).on_hover_text(help);
            if keep
                .on_disabled_hover_text("Type a name, and mix with the dial: a preset is a position of its hand.")
                .clicked()
                || entered && can
            {
                ask(Edit::Keep(given.clone()));
            }
            let rename = ui.add_enabled(here.is_some() && !given.is_empty(), egui::Button::new("Rename"));
            let rename = rename.on_hover_text("Renames the shown preset.");
            if let (true, Some(index)) = (rename.clicked(), here) {
                ask(Edit::Rename(index, given));
            }
            let forget = ui.add_enabled(here.is_some(), egui::Button::new("Forget"));
            let forget = forget.on_hover_text("Deletes the shown preset.");
            if let (true, Some(index)) = (forget.clicked(), here) {
                ask(Edit::Forget(index));
            }
        });
        ui.data_mut(|data| data.insert_temp(id, name));
        ui.horizontal_wrapped(|ui| {
            let (plays, saves) = (matches!(tour, Some(Tour::Playing { .. })), matches!(tour, Some(Tour::Saving { .. })));
            let enough = presets.len() > 1 && !saves;
            let none = if saves { "The pictures of a tour are being saved." } else { "A tour needs at least two presets." };
            let play = ui.add_enabled(enough, egui::Button::new(if plays { "Stop" } else { "Tour" }));
            let help = "Moves the hand from each preset to the next; one undo reverts it.";
            let play = play.on_hover_text(help).on_disabled_hover_text(none);
            let help = "Duration of the tour.";
            let seconds = remembered(ui, ("tour: seconds", help), SECONDS, 1, |drag| {
                drag.speed(0.1).range(0.1..=LONGEST).suffix(" s")
            });
            if play.clicked() {
                asked.push(Action::Tour((!plays).then_some(seconds)));
            }
            let save = ui.add_enabled(enough, egui::Button::new("Save"));
            let help = "Saves pictures of the tour as relume-tour-0001-0001.png and so on, in the current folder of relume. Existing tours are kept: the next one is relume-tour-0002-0001.png.";
            let save = save.on_hover_text(help).on_disabled_hover_text(none);
            save.widget_info(|| WidgetInfo::labeled(egui::WidgetType::Button, enough, "save the tour"));
            let help = "Number of pictures, evenly spaced along the tour.";
            let frames = remembered(ui, ("tour: pictures", help), FRAMES, 0, |drag| {
                drag.speed(0.5).range(2..=u16::MAX).suffix(" pictures")
            });
            if save.clicked() {
                asked.push(Action::SaveTour(None, frames));
            }
        });
    });
}
