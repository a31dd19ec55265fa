//! Toolbar: file menu, undo and redo, palette, theme, and visibility of the panels.

use egui::{Area, Button, Id, Key, KeyboardShortcut, Modifiers, Rect, Theme, Ui, vec2};

use super::Shown;
use super::controls::toggle;
use super::{docks, palette};
use crate::document::Source;
use crate::view::action::{Action, File};
use crate::view::layout::{Arrange, Note};

const SHIFT: Modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);
const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut = KeyboardShortcut::new(SHIFT, Key::Z);
const PANELS: KeyboardShortcut = KeyboardShortcut::new(Modifiers::NONE, Key::F1);

/// An item of the file menu.
struct Item {
    text: &'static str,
    help: &'static str,
    action: fn() -> Action,
    shortcut: Option<KeyboardShortcut>,
    /// Whether the item needs an open document.
    saves: bool,
}

/// Shortcuts with more modifiers come first, because a shortcut also matches with extra modifiers.
const FILES: [Item; 11] = [
    Item {
        text: "Open…",
        help: "Opens another scene or volume, as by dropping it on the window.",
        action: || Action::Choose(File::Opened),
        shortcut: Some(KeyboardShortcut::new(Modifiers::COMMAND, Key::O)),
        saves: false,
    },
    Item {
        text: "Open the built-in scene",
        help: "Opens the scene of the program.",
        action: || Action::Open(Box::default()),
        shortcut: None,
        saves: false,
    },
    Item {
        text: "Another volume of this file…",
        help: "Opens another time step, component or array with the same settings.",
        action: || Action::Another,
        shortcut: None,
        saves: false,
    },
    Item {
        text: "Save session as…",
        help: "Saves all settings as a scene file, to continue later or for relume render.",
        action: || Action::Choose(File::Session),
        shortcut: Some(KeyboardShortcut::new(SHIFT, Key::S)),
        saves: true,
    },
    Item {
        text: "Save session",
        help: "Saves relume-session-0001.toml, or the next free number, in the current folder of relume.",
        action: || Action::SaveSession(None),
        shortcut: Some(KeyboardShortcut::new(Modifiers::COMMAND, Key::S)),
        saves: true,
    },
    Item {
        text: "Save picture as…",
        help: "Saves the picture without panels, as PNG.",
        action: || Action::Choose(File::Picture),
        shortcut: Some(KeyboardShortcut::new(SHIFT, Key::P)),
        saves: true,
    },
    Item {
        text: "Save picture",
        help: "Saves relume-0001.png, or the next free number, in the current folder of relume.",
        action: || Action::SavePicture(None),
        shortcut: Some(KeyboardShortcut::new(Modifiers::COMMAND, Key::P)),
        saves: true,
    },
    Item {
        text: "Save linear picture as…",
        help: "Saves the picture without panels, as OpenEXR with linear values, for further processing.",
        action: || Action::Choose(File::LinearPicture),
        shortcut: None,
        saves: true,
    },
    Item {
        text: "Save film as…",
        help: "Saves the film: relume relight makes pictures of it under any light.",
        action: || Action::Choose(File::Accumulators),
        shortcut: None,
        saves: true,
    },
    Item {
        text: "Save page as…",
        help: "Saves the picture as one HTML file: whoever opens it in a browser changes the light, without Relume.",
        action: || Action::Choose(File::Page),
        shortcut: None,
        saves: true,
    },
    Item {
        text: "Quit",
        help: "Closes the window, and asks about unsaved work first.",
        action: || Action::Close,
        shortcut: Some(KeyboardShortcut::new(Modifiers::COMMAND, Key::Q)),
        saves: false,
    },
];

/// Handles keyboard shortcuts, also without panels. `popup`: whether one is open, which Escape closes.
pub(super) fn keys(ui: &Ui, shown: &Shown<'_>, popup: bool, asked: &mut Vec<Action>) {
    let pressed = |shortcut: &KeyboardShortcut| ui.input_mut(|input| input.consume_shortcut(shortcut));
    // The longer shortcut first, as above.
    if pressed(&REDO) {
        asked.push(Action::Redo);
    } else if pressed(&UNDO) {
        asked.push(Action::Undo);
    }
    for item in &FILES {
        if item.shortcut.as_ref().is_some_and(pressed) {
            asked.push((item.action)());
        }
    }
    if pressed(&PANELS) {
        asked.push(Action::Panels(!shown.panels));
    }
    // Escape closes windows over the picture first.
    let over = shown.probe.is_some() || shown.layout.help || shown.layout.lesson.is_some() || shown.layout.ruler.on;
    // The library uses Escape to leave the focused field before this frame.
    let typed = ui.data(|data| data.get_temp(typed_id())).unwrap_or(false);
    let is_free = !(over || popup || typed);
    if is_free && shown.status.level.is_some() && ui.input(|input| input.key_pressed(Key::Escape)) {
        asked.push(Action::StopRefining);
    }
}

/// Notes for the next frame whether a field has the keyboard focus.
pub(super) fn note_typed(ui: &Ui) {
    let typed = ui.memory(|memory| memory.focused().is_some());
    ui.data_mut(|data| data.insert_temp(typed_id(), typed));
}

fn typed_id() -> Id {
    Id::new("typed before")
}

/// Shows the toolbar.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>, docked: bool, asked: &mut Vec<Action>) {
    ui.add_space(2.0);
    ui.horizontal_wrapped(|ui| {
        ui.menu_button("File", |ui| files(ui, shown, asked)).response.on_hover_text("Opens and saves.");
        let mut button = |ui: &mut Ui, enabled: bool, text: &str, help: &str, action: Action| {
            if ui.add_enabled(enabled, Button::new(text)).on_hover_text(help).clicked() {
                asked.push(action);
            }
        };
        let has = |can: fn(&crate::document::Document) -> bool| shown.document.is_some_and(can);
        button(ui, has(crate::document::Document::can_undo), "Undo", "Reverts the last change (Ctrl+Z).", Action::Undo);
        button(
            ui,
            has(crate::document::Document::can_redo),
            "Redo",
            "Repeats the reverted change (Ctrl+Shift+Z).",
            Action::Redo,
        );
        button(ui, true, "Hide", "Hides the panels (F1).", Action::Panels(false));
        let other = match ui.theme() {
            Theme::Dark => Theme::Light,
            Theme::Light => Theme::Dark,
        };
        if ui.button("Theme").on_hover_text("Switches between the light and the dark theme.").clicked() {
            ui.ctx().set_theme(other);
        }
        let help = "Designs spectra for target colours of the materials under the lights.";
        let palette = ui.add_enabled_ui(shown.document.is_some(), |ui| toggle(ui, shown.design.shown, "Palette"));
        if palette.inner.on_hover_text(help).clicked() {
            asked.push(Action::Palette(!shown.design.shown));
            // The editor may lie behind the probe window.
            ui.ctx().move_to_top(palette::layer());
        }
        let slices = shown.layout.slices.shown;
        let help = "Shows three slices of the volume around the picture (S).";
        let button = ui.add_enabled_ui(shown.document.is_some(), |ui| toggle(ui, slices, "Slices")).inner;
        if button.on_hover_text(help).clicked() {
            asked.push(Action::Arrange(Arrange::Slices(!slices)));
        }
        ui.menu_button("View", |ui| view(ui, shown, asked)).response.on_hover_text("Slices, annotations and help.");
        if docked && shown.document.is_some() {
            docks::switches(ui, shown, asked);
        }
    });
}

/// Shows the menu of what lies around and over the picture.
fn view(ui: &mut Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) {
    ui.set_min_width(190.0);
    let layout = shown.layout;
    let mut line = |ui: &mut Ui, on: bool, name: &str, key: &str, change: Arrange| {
        let button = Button::selectable(on, name).shortcut_text(key);
        if ui.add(button).clicked() {
            asked.push(Action::Arrange(change));
            ui.close();
        }
    };
    line(ui, layout.slices.shown, "Slices around the picture", "S", Arrange::Slices(!layout.slices.shown));
    line(ui, layout.ruler.on, "Measuring line", "M", Arrange::Ruler(!layout.ruler.on));
    for note in Note::ALL {
        let (on, key) = (layout.has(note), if note == Note::Legend { "L" } else { "" });
        line(ui, on, note.name(), key, Arrange::Note(note, !on));
    }
    ui.separator();
    line(ui, layout.help, "Keys and mouse", "?", Arrange::Help(!layout.help));
    line(ui, layout.lesson.is_some(), "First minute", "", Arrange::Lesson(layout.lesson.xor(Some(0))));
}

/// Shows the file menu.
fn files(ui: &mut Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) {
    ui.set_min_width(230.0);
    for item in &FILES {
        let button = Button::new(item.text);
        let button = match &item.shortcut {
            Some(shortcut) => button.shortcut_text(ui.ctx().format_shortcut(shortcut)),
            None => button,
        };
        let action = (item.action)();
        let enabled = if action == Action::Another { shown.several } else { !item.saves || shown.document.is_some() };
        let line = ui.add_enabled(enabled, button).on_hover_text(item.help);
        let line =
            if action == Action::Another { line.on_disabled_hover_text("The file has no other volume.") } else { line };
        if line.clicked() {
            asked.push(action);
            ui.close();
        }
        if item.text == RECENT_BELOW && !shown.recent.is_empty() {
            ui.menu_button("Open recent", |ui| recent(ui, shown, asked));
        }
    }
}

/// Item above the files opened last.
const RECENT_BELOW: &str = "Open…";

/// Shows the files opened last.
fn recent(ui: &mut Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) {
    for path in shown.recent {
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
        if ui.button(name).on_hover_text(path.display().to_string()).clicked() {
            asked.push(Action::Open(Box::new(Source::of(path))));
            ui.close();
        }
    }
}

/// Button that shows the panels again.
pub(super) fn opener(ui: &Ui, rect: Rect, asked: &mut Vec<Action>) {
    Area::new("opener".into()).fixed_pos(rect.min + vec2(4.0, 4.0)).show(ui.ctx(), |ui| {
        if ui.button("Panels").on_hover_text("Shows the panels (F1).").clicked() {
            asked.push(Action::Panels(true));
        }
    });
}
