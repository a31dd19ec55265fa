//! What several panels are made of.

use std::ops::RangeInclusive;

use egui::emath::Numeric;
use egui::response::Flags;
use egui::{
    Button, CollapsingHeader, Color32, DragValue, Response, RichText, Sense, Sides, Slider, SliderClamping, Ui, Vec2,
};

use crate::number::count;
use crate::view::action::Action;
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

/// What stands at the left of a line, texts cut off where they are too long for it, and what stands at its right, the outermost
/// first. Long names would widen the panels.
pub(super) fn sides(
    ui: &mut Ui,
    asked: &mut Vec<Action>,
    left: impl FnOnce(&mut Ui) -> Option<Action>,
    right: impl FnOnce(&mut Ui) -> Option<Action>,
) {
    let (left, right) = Sides::new().shrink_left().truncate().show(ui, left, right);
    asked.extend([left, right].into_iter().flatten());
}

/// A choice that looks like one also while it is not taken.
pub(super) fn toggle(ui: &mut Ui, on: bool, text: &str) -> Response {
    ui.add(Button::selectable(on, text).frame_when_inactive(true))
}

/// A number that is dragged, or typed: what is typed holds, as one step, once Enter or another place is pressed. It is shown
/// to so many `decimals`; `with` says the rest of it.
pub(super) fn number<N: Numeric>(
    ui: &mut Ui,
    value: &mut N,
    decimals: usize,
    with: impl FnOnce(DragValue<'_>) -> DragValue<'_>,
) -> Response {
    let before = *value;
    // What a scene has stays as it is, also where a hand may not go.
    let field = DragValue::new(value).update_while_editing(false).max_decimals(decimals);
    let response = ui.add(with(field.clamp_existing_to_range(false)));
    typed(response, before, value, decimals)
}

/// A slider with such a number beside it.
pub(super) fn slider(
    ui: &mut Ui,
    value: &mut f64,
    range: RangeInclusive<f64>,
    decimals: usize,
    with: impl FnOnce(Slider<'_>) -> Slider<'_>,
) -> Response {
    let before = *value;
    let slider = Slider::new(value, range).clamping(SliderClamping::Never).max_decimals(decimals);
    let response = ui.add(with(slider).update_while_editing(false));
    typed(response, before, value, decimals)
}

/// A field that is left as it was has changed nothing, though it shows fewer digits than there are.
fn typed<N: Numeric>(mut response: Response, before: N, value: &mut N, decimals: usize) -> Response {
    let (was, is) = (before.to_f64(), value.to_f64());
    // What egui takes for the same when it chooses how many digits it shows.
    let shown = 0.5 * 0.1_f64.powf(count(decimals)) + 16.0 * f64::from(f32::EPSILON) * was.abs();
    let shown = if N::INTEGRAL { 0.0 } else { shown };
    if response.lost_focus() && (is - was).abs() <= shown {
        *value = before;
        response.flags.remove(Flags::CHANGED);
    }
    response
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
