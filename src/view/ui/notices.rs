//! Notices: what went wrong, and what makes the picture black, over the picture and never instead of it.

use egui::{Color32, Frame, Rect, Ui, UiBuilder, vec2};

use super::Shown;
use crate::view::action::Action;
use crate::view::state::{Document, Edit};

/// Shows them at the top of the picture.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>, rect: Rect, asked: &mut Vec<Action>) {
    let width = rect.width().min(560.0) - 60.0;
    let at = Rect::from_min_size(rect.min + vec2((rect.width() - width) / 2.0, 8.0), vec2(width, rect.height() - 16.0));
    ui.scope_builder(UiBuilder::new().max_rect(at), |ui| {
        if let Some(document) = shown.document.filter(|document| !document.state().is_lit()) {
            notice(ui, "No light arrives: the picture is black.", "Turn the lights on", || {
                asked.extend(lit(document).into_iter().map(Action::Edit));
            });
        }
        if shown.stopped {
            let text = "The device was lost again before it had shown a picture. Perhaps this scene takes it too long.";
            notice(ui, text, "Start the device again", || asked.push(Action::Restart));
        }
        for (index, text) in shown.notices.iter().enumerate() {
            notice(ui, text, "Close", || asked.push(Action::Dismiss(index)));
        }
    });
}

/// What makes the lights shine again.
fn lit(document: &Document) -> Vec<Edit> {
    let state = document.state();
    let count = state.scene.lights.len();
    let mut edits = vec![Edit::Mix(crate::scene::Mixing::Sliders), Edit::Solo(None)];
    edits.extend((0..count).map(|light| Edit::On(light, true)));
    edits.extend((0..count).map(|light| Edit::Weight(light, 1.0)));
    edits.push(Edit::Master(1.0));
    if state.scene.display.exposure <= 0.0 {
        edits.push(Edit::Exposure(1.0));
    }
    edits
}

fn notice(ui: &mut Ui, text: &str, button: &str, clicked: impl FnOnce()) {
    let (fill, ink) = (Color32::from_rgb(255, 236, 179), Color32::from_rgb(60, 40, 0));
    Frame::popup(ui.style()).fill(fill).show(ui, |ui| {
        ui.horizontal_wrapped(|ui| {
            ui.colored_label(ink, text);
            if ui.small_button(button).clicked() {
                clicked();
            }
        });
    });
}
