//! The first line: steps back and forward, what can be saved, light or dark, panels or none.

use egui::{Area, Key, KeyboardShortcut, Modifiers, Rect, Theme, Ui, vec2};

use super::Shown;
use super::controls::toggle;
use crate::view::action::Action;

const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const SAVE_PICTURE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::P);
const SAVE_SESSION: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::S);
const PANELS: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::F1);

/// What keys ask for, with panels or without.
pub(super) fn keys(ui: &Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) {
    let pressed = |shortcut: &KeyboardShortcut| ui.input_mut(|input| input.consume_shortcut(shortcut));
    // The longer one first: a shortcut takes more modifiers than it names.
    if pressed(&REDO) {
        asked.push(Action::Redo);
    } else if pressed(&UNDO) {
        asked.push(Action::Undo);
    }
    if pressed(&SAVE_PICTURE) {
        asked.push(Action::SavePicture(None));
    }
    if pressed(&SAVE_SESSION) {
        asked.push(Action::SaveSession(None));
    }
    if pressed(&PANELS) {
        asked.push(Action::Panels(!shown.panels));
    }
}

/// Shows it.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) {
    ui.add_space(6.0);
    ui.horizontal_wrapped(|ui| {
        let mut button = |ui: &mut Ui, enabled: bool, text: &str, help: &str, action: Action| {
            if ui.add_enabled(enabled, egui::Button::new(text)).on_hover_text(help).clicked() {
                asked.push(action);
            }
        };
        let has = |can: fn(&crate::view::Document) -> bool| shown.document.is_some_and(can);
        button(ui, has(crate::view::Document::can_undo), "Undo", "A step back (Ctrl+Z).", Action::Undo);
        button(ui, has(crate::view::Document::can_redo), "Redo", "A step forward (Ctrl+Shift+Z).", Action::Redo);
        let help = "Saves the picture as relume-0001.png, or the next number that is free, in the folder that relume was started in (Ctrl+P).";
        button(ui, shown.document.is_some(), "Picture", help, Action::SavePicture(None));
        let help = "Saves what the rays have left as relume-accumulators-0001.exr, or the next number that is free: `relume relight` \
                    makes pictures of it under any light.";
        button(ui, shown.document.is_some(), "Accumulators", help, Action::SaveAccumulators(None));
        let help = "Saves all this as relume-session-0001.toml, or the next number that is free: a scene file to go on from (Ctrl+S).";
        button(ui, shown.document.is_some(), "Session", help, Action::SaveSession(None));
        button(ui, true, "Hide", "Shows the picture alone (F1).", Action::Panels(false));
        let other = match ui.theme() {
            Theme::Dark => Theme::Light,
            Theme::Light => Theme::Dark,
        };
        if ui.button("Theme").on_hover_text("Changes between a light and a dark window.").clicked() {
            ui.ctx().set_theme(other);
        }
        let help = "Designs spectra: which colour each material is to have under each light.";
        let palette =
            ui.add_enabled_ui(shown.document.is_some(), |ui| toggle(ui, shown.design.shown, "Palette"));
        if palette.inner.on_hover_text(help).clicked() {
            asked.push(Action::Palette(!shown.design.shown));
        }
    });
}

/// The way back to the panels.
pub(super) fn opener(ui: &Ui, rect: Rect, asked: &mut Vec<Action>) {
    Area::new("opener".into()).fixed_pos(rect.min + vec2(4.0, 4.0)).show(ui.ctx(), |ui| {
        if ui.button("Panels").on_hover_text("Shows the panels (F1).").clicked() {
            asked.push(Action::Panels(true));
        }
    });
}
