//! What several panels are made of.

use std::cell::RefCell;
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

use egui::emath::Numeric;
use egui::response::Flags;
use egui::{
    Button, CollapsingHeader, Color32, Context, DragValue, Id, Popup, PopupCloseBehavior, Response, RichText, Sense,
    Sides, Slider, SliderClamping, Ui, Vec2,
};

use crate::number::count;
use crate::view::action::Action;
use crate::view::state::Cost;

/// How long it is told that something typed was refused.
const LONG_ENOUGH: Duration = Duration::from_secs(5);

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
    let (id, refused) = (ui.next_auto_id(), RefCell::new(None));
    let field = DragValue::new(value).update_while_editing(false).max_decimals(decimals);
    let field = field.clamp_existing_to_range(false).custom_parser(|text| parsed(text, &refused));
    let field = if N::INTEGRAL { field } else { field.custom_formatter(text) };
    let response = ui.add(with(field));
    tell(id, &response, refused);
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
    // A slider's answer is now its own, now its field's.
    let (id, refused) = (ui.next_auto_id(), RefCell::new(None));
    let slider = Slider::new(value, range).clamping(SliderClamping::Never).max_decimals(decimals);
    let response = ui.add(with(slider).update_while_editing(false).custom_parser(|text| parsed(text, &refused)));
    tell(id, &response, refused);
    typed(response, before, value, decimals)
}

/// Digits behind the first one of a number that is shown with an exponent.
const DIGITS: i32 = 4;

/// The exponent that `value` is shown with where it would take too many digits without, to so many `decimals`.
fn exponent(value: f64, decimals: usize) -> Option<i32> {
    let is_long = value.is_finite() && value != 0.0 && (value.abs() >= 1e9 || decimals > 7);
    is_long.then(|| whole_exponent(value))
}

#[expect(clippy::cast_possible_truncation, reason = "exponents of f64 are few")]
fn whole_exponent(value: f64) -> i32 {
    value.abs().log10().floor() as i32
}

/// `value` to so many decimals at most, or with an exponent and few digits where those would be many.
pub(super) fn text(value: f64, decimals: RangeInclusive<usize>) -> String {
    if exponent(value, *decimals.end()).is_none() {
        return egui::emath::format_with_decimals_in_range(value, decimals);
    }
    let few = format!("{value:.4e}").parse().unwrap_or(value);
    format!("{few:e}")
}

/// The number that `text` is; why it is none goes to `refused`. Spaces may part digits, and a minus may be a long one.
fn parsed(text: &str, refused: &RefCell<Option<String>>) -> Option<f64> {
    let digits: String = text.chars().filter(|letter| !letter.is_whitespace()).collect();
    let number = digits.replace('−', "-").parse().ok().filter(|number: &f64| number.is_finite());
    if number.is_none() {
        *refused.borrow_mut() = Some(format!("“{text}” is no number, such as 0.25: nothing was changed."));
    }
    number
}

/// Says why what was typed was `refused`, or what was said before.
fn tell(id: Id, field: &Response, refused: RefCell<Option<String>>) {
    refused.into_inner().into_iter().for_each(|text| say(&field.ctx, id, text));
    show_said(id, field);
}

/// Says beside a field for a while what became of what was typed there.
pub(super) fn say_beside(field: &Response, text: String) {
    say(&field.ctx, field.id, text);
}

fn say(context: &Context, field: Id, text: String) {
    context.data_mut(|data| data.insert_temp(field.with("said"), (text, Instant::now())));
    context.request_repaint();
}

/// Shows what is said beside a `field`, which it is called by here, until that can have been read.
fn show_said(id: Id, field: &Response) {
    let id = id.with("said");
    let Some((text, since)) = field.ctx.data(|data| data.get_temp::<(String, Instant)>(id)) else { return };
    let left = LONG_ENOUGH.saturating_sub(since.elapsed());
    if left.is_zero() || field.has_focus() {
        field.ctx.data_mut(|data| data.remove::<(String, Instant)>(id));
        return;
    }
    field.ctx.request_repaint_after(left);
    // No tooltip: those are not shown over what was just used.
    Popup::from_response(field)
        .id(id)
        .open(true)
        .close_behavior(PopupCloseBehavior::IgnoreClicks)
        .show(|ui| ui.label(text));
}

/// A field that is left as it was has changed nothing, though it shows fewer digits than there are.
fn typed<N: Numeric>(mut response: Response, before: N, value: &mut N, decimals: usize) -> Response {
    let (was, is) = (before.to_f64(), value.to_f64());
    // What egui takes for the same when it chooses how many digits it shows.
    let shown = match exponent(was, decimals) {
        Some(exponent) => 0.51 * 10_f64.powi(exponent - DIGITS),
        None => 0.5 * 0.1_f64.powf(count(decimals)) + 16.0 * f64::from(f32::EPSILON) * was.abs(),
    };
    let shown = if N::INTEGRAL { 0.0 } else { shown };
    // A slider calls it a change, too, when what is in its field changes.
    let most = if response.lost_focus() { shown } else { 0.0 };
    if (is - was).abs() <= most {
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
