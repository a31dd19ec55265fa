//! Help over the picture: keys and mouse, and a first minute for those who want it.

use egui::{Grid, Id, Key, Rect, RichText, ScrollArea, Ui, vec2};

use super::{Shown, floating};
use crate::view::action::Action;
use crate::view::layout::Arrange;

/// Width of the contents in points.
const WIDTH: f32 = 430.0;

/// Keys and mouse, by their place: input and its effect.
const INPUTS: [(&str, &[[&str; 2]]); 4] = [
    (
        "Picture",
        &[
            ["drag", "orbit"],
            ["Shift and drag, right or middle drag", "pan"],
            ["Ctrl and drag", "roll"],
            ["wheel, + −", "nearer, farther"],
            ["click; Alt and move", "probe a pixel"],
            ["1 to 6", "view from a side"],
            ["arrows; , .", "orbit; roll"],
            ["P", "perspective or orthographic"],
            ["R", "the camera of the scene"],
        ],
    ),
    (
        "Slices",
        &[
            ["S", "show and hide"],
            ["click, drag", "move the crosshair"],
            ["wheel", "next slice"],
            ["right drag", "window (across) and level (down)"],
        ],
    ),
    (
        "Dial",
        &[
            ["drag the hand", "mix the lights"],
            ["click a node", "its light alone"],
            ["right click a node", "switch it off or on"],
            ["Shift and drag a node", "move it"],
        ],
    ),
    (
        "Window",
        &[
            ["M", "measuring line: click both ends"],
            ["L", "legend of the materials"],
            ["F1", "hide and show the panels"],
            ["Ctrl+O", "open"],
            ["Ctrl+P, Ctrl+S", "save the picture, the session"],
            ["Ctrl+Z, Ctrl+Shift+Z", "undo, redo"],
            ["?", "this help"],
        ],
    ),
];

/// Steps of the first minute: title and text.
pub(super) const LESSONS: [[&str; 2]; 6] = [
    [
        "Turn the volume",
        "Drag in the picture to turn the volume, and use the wheel to go nearer. R brings the first view back.",
    ],
    [
        "Change the light",
        "Drag the hand of the light dial between the lights, or move a slider. The picture follows at once, because \
         it is only lit anew and not marched.",
    ],
    [
        "Ask a pixel",
        "Click in the picture: the probe shows the spectrum of a pixel, its colour under each light, and the materials \
         along its ray.",
    ],
    [
        "Choose what is visible",
        "In the transfer function, drag an interval over the histogram of the values: a material, its range of values \
         and its opacity. Presets suggest some. These controls march: first coarse, then fine.",
    ],
    [
        "Look inside",
        "Press S for slices. Drag the crosshair, turn slices with the wheel, and drag with the right button for window \
         and level. A click in the picture puts the crosshair there.",
    ],
    [
        "Keep it",
        "Ctrl+P saves the picture, and Ctrl+S a session, which opens again here and in relume render. Every change can \
         be undone with Ctrl+Z. The key ? lists all keys.",
    ],
];

/// Handles the key of the help.
pub(super) fn keys(ui: &Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) {
    // `?` needs Shift on many keyboards, and some report the key without it.
    let asks = ui
        .input(|input| input.key_pressed(Key::Questionmark) || input.modifiers.shift && input.key_pressed(Key::Slash));
    if asks {
        asked.push(Action::Arrange(Arrange::Help(!shown.layout.help)));
    }
}

/// Shows the open help, or the present step of the first minute, in `rect`.
pub(super) fn show(ui: &Ui, shown: &Shown<'_>, rect: Rect, asked: &mut Vec<Action>) {
    let mut ask = |change| asked.push(Action::Arrange(change));
    let escapes = !shown.chooses && ui.input(|input| input.key_pressed(Key::Escape));
    if shown.layout.help {
        let width = WIDTH.min(rect.width() - 40.0).max(80.0);
        let height = (rect.height() - 70.0).clamp(60.0, 620.0);
        let at = rect.center_top() + vec2(-0.5 * width - 10.0, 10.0);
        let mut begins = false;
        let open = floating::show(ui, ("Keys and mouse", Id::new("help")), rect, (at, vec2(width, height)), |ui| {
            ScrollArea::vertical().max_height(height).show(ui, |ui| {
                ui.set_width(width);
                ui.spacing_mut().interact_size.y = 14.0;
                begins = ui.button("Show me around").on_hover_text("The first minute in six steps.").clicked();
                for (place, inputs) in INPUTS {
                    ui.add_space(4.0);
                    ui.strong(place);
                    Grid::new(place).num_columns(2).spacing([16.0, 2.0]).min_col_width(0.45 * width).show(ui, |ui| {
                        for [input, effect] in inputs {
                            ui.label(RichText::new(*input).small());
                            ui.label(RichText::new(*effect).small());
                            ui.end_row();
                        }
                    });
                }
            });
        });
        if begins {
            ask(Arrange::Lesson(Some(0)));
        }
        if !open || escapes || begins {
            ask(Arrange::Help(false));
        }
    }
    let Some((step, [title, text])) = shown.layout.lesson.and_then(|step| Some((step, LESSONS.get(step)?))) else {
        return;
    };
    let width = 300.0_f32.min(rect.width() - 40.0).max(80.0);
    let at = rect.center_bottom() - vec2(0.5 * width, 190.0_f32.min(rect.height()));
    let open = floating::show(ui, ("First minute", Id::new("first minute")), rect, (at, vec2(width, 120.0)), |ui| {
        ui.set_width(width);
        ui.strong(*title);
        ui.label(*text);
        ui.horizontal(|ui| {
            if step > 0 && ui.button("Back").clicked() {
                ask(Arrange::Lesson(Some(step - 1)));
            }
            let is_last = step + 1 == LESSONS.len();
            if ui.button(if is_last { "Done" } else { "Next" }).clicked() {
                ask(Arrange::Lesson(Some(step + 1).filter(|_| !is_last)));
            }
            ui.label(RichText::new(format!("{} of {}", step + 1, LESSONS.len())).small().weak());
        });
    });
    if !open || escapes {
        ask(Arrange::Lesson(None));
    }
}
