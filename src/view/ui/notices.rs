//! Notices over the picture: errors, completed actions, and reasons for a black picture.

use std::time::{Duration, Instant};

use egui::{Align2, Area, Color32, Frame, Id, Order, Rect, Ui, vec2};

use super::Shown;
use super::crop::{out_of_sight, thin_crop};
use super::transfer::nothing_shown;
use crate::document::Mixing;
use crate::document::{Document, Edit};
use crate::view::action::Action;
use crate::view::tour::Tour;

/// Minimum width of a notice in points.
const LEAST_WIDTH: f32 = 120.0;
/// Display time of a notice about a completed action.
const LONG_ENOUGH: Duration = Duration::from_secs(8);

/// A notice over the picture.
#[derive(Clone, Debug)]
pub struct Notice {
    /// Text.
    pub text: String,
    /// Time at which the notice disappears; `None` until the user closes it.
    pub until: Option<Instant>,
}

impl Notice {
    /// Creates a notice of an error, which stays until it is closed.
    #[must_use]
    pub fn wrong(text: String) -> Self {
        Self { text, until: None }
    }

    /// Creates a notice of a completed action, which disappears after a reading time.
    #[must_use]
    pub fn done(text: String) -> Self {
        Self { text, until: Instant::now().checked_add(LONG_ENOUGH) }
    }
}

/// Shows the notices at the bottom right of the picture. The top right has the close buttons of floating windows.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>, rect: Rect, asked: &mut Vec<Action>) {
    let width = (rect.width().min(560.0) - 60.0).max(LEAST_WIDTH);
    let corner = rect.right_bottom() - vec2(8.0, 8.0);
    let area = Area::new(Id::new("notices")).order(Order::Foreground);
    let area = area.pivot(Align2::RIGHT_BOTTOM).fixed_pos(corner).show(ui.ctx(), |ui| {
        ui.set_max_width(width);
        if let Some(document) = shown.document.filter(|document| !document.state().is_lit()) {
            notice(ui, "All lights are off: the picture is black.", "Turn the lights on", || {
                asked.extend(lit(document).into_iter().map(Action::Edit));
            });
        }
        if let Some(document) = shown.document.filter(|_| shown.loading.is_none()) {
            // In a smaller picture every volume is thin.
            let is_large = rect.size().min_elem() >= LEAST_WIDTH;
            if let Some((text, button, step)) =
                out_of_sight(document, shown.aspect, rect).filter(|_| is_large)
            {
                notice(ui, text, button, || asked.push(Action::Edit(Edit::Camera(step, shown.aspect))));
            } else if let Some((text, edit)) = thin_crop(document) {
                notice(ui, &text, "Show the whole axis", || asked.push(Action::Edit(edit)));
            }
            if let Some((button, edit)) = nothing_shown(document) {
                let text = "Nothing of the volume is visible: the opacity of all its values is 0.";
                notice(ui, text, button, || asked.push(Action::Edit(edit)));
            }
        }
        if let Some(Tour::Saving { frames, saved, .. }) = shown.tour {
            let text = format!(
                "Saving the tour: {saved} of {frames} pictures. Until then the picture shows the tour instead of the light of the panels."
            );
            notice(ui, &text, "Cancel", || asked.push(Action::Tour(None)));
        }
        if let Some((name, part, stage)) = shown.page {
            let part = part.map_or_else(String::new, |part| format!(", {:.0} %", 100.0 * part));
            let stage = if stage.is_empty() { String::new() } else { format!(": {stage}{part}") };
            notice(ui, &format!("Writing {name}{stage}."), "Cancel", || asked.push(Action::GiveUpPage));
        }
        if shown.stopped {
            let text = "The device was lost again before the first picture. The scene may be too slow for this device.";
            notice(ui, text, "Start the device again", || asked.push(Action::Restart));
        }
        for (index, Notice { text, .. }) in shown.notices.iter().enumerate() {
            notice(ui, text, "Close", || asked.push(Action::Dismiss(index)));
        }
    });
    // The position depends on the size in the last frame.
    let (id, now) = (area.response.id, area.response.rect);
    if ui.data(|data| data.get_temp(id)) != Some(now) {
        ui.data_mut(|data| data.insert_temp(id, now));
        ui.ctx().request_repaint();
    }
    let left = |notice: &Notice| Some(notice.until?.saturating_duration_since(Instant::now()));
    let next = shown.notices.iter().enumerate().filter_map(|(index, notice)| Some((left(notice)?, index))).min();
    match next {
        Some((left, index)) if left.is_zero() => {
            asked.push(Action::Dismiss(index));
            ui.ctx().request_repaint();
        }
        // An idle window draws no frames.
        Some((left, _)) => ui.ctx().request_repaint_after(left),
        None => {}
    }
}

/// Edits that turn the lights on again.
fn lit(document: &Document) -> Vec<Edit> {
    let state = document.state();
    let (count, nodes) = (state.scene.lights.len(), &state.dial.nodes);
    let all_nodes = (0..nodes.len()).map(|node| Edit::NodeOn(node, true));
    if state.light.mixing == Mixing::Dial && nodes.iter().all(|node| !node.on) {
        return all_nodes.collect();
    }
    let mut edits = vec![Edit::Mix(Mixing::Sliders), Edit::Solo(None)];
    edits.extend((0..count).map(|light| Edit::On(light, true)));
    edits.extend((0..count).map(|light| Edit::Weight(light, 1.0)));
    edits.push(Edit::Master(1.0));
    // Also the dial's nodes, else the picture would be dark again as soon as the dial mixes.
    edits.extend(all_nodes);
    if state.scene.display.factor() <= 0.0 {
        edits.push(Edit::Exposure(Some(1.0)));
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
