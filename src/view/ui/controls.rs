//! What several panels are made of.

use std::cell::{Cell, RefCell};
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

use egui::emath::Numeric;
use egui::response::Flags;
use egui::{
    Button, CollapsingHeader, Color32, Context, DragValue, Id, Key, Popup, PopupCloseBehavior, Response, RichText,
    Sense, Sides, Slider, SliderClamping, Ui, Vec2, WidgetInfo,
};

use crate::number::whole;
use crate::plan::Stale;
use crate::view::action::Action;
use crate::view::state::BRIGHTEST;

/// How long it is told that something typed was refused.
const LONG_ENOUGH: Duration = Duration::from_secs(5);

/// A collapsible panel. Its badge says in the same words everywhere what its controls make `stale`.
pub(super) fn panel(ui: &mut Ui, name: &str, stale: Stale, contents: impl FnOnce(&mut Ui)) {
    let title = RichText::new(name).strong();
    CollapsingHeader::new(title).id_salt(name).default_open(true).show(ui, |ui| {
        ui.horizontal(|ui| {
            let (dot, _) = ui.allocate_exact_size(Vec2::splat(8.0), Sense::hover());
            ui.painter().circle_filled(dot.center(), 3.5, colour(ui, stale));
            ui.label(RichText::new(word(stale)).small().color(colour(ui, stale))).on_hover_text(sentence(stale));
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
/// to so many `decimals`, of less than none to tens, hundreds and so on; `with` says the rest of it.
pub(super) fn number<N: Numeric>(
    ui: &mut Ui,
    value: &mut N,
    decimals: i32,
    with: impl FnOnce(DragValue<'_>) -> DragValue<'_>,
) -> Response {
    let (before, id, typing) = (*value, ui.next_auto_id(), Typing::new(ui));
    // What a scene has stays as it is, also where a hand may not go.
    let field = DragValue::new(value).update_while_editing(false).max_decimals(plain_decimals(decimals));
    let field = field.clamp_existing_to_range(false).custom_parser(|text| typing.parsed(text));
    let field = field.custom_formatter(|value, plain| typing.shown::<N>(value, plain, decimals));
    let response = ui.add(with(field));
    typing.end(id, response, before, value)
}

/// A number that is no part of the scene, and is kept as long as the window is open; at first it is as `usual`.
pub(super) fn remembered<N: Numeric + Send + Sync>(
    ui: &mut Ui,
    (name, help): (&str, &str),
    usual: N,
    decimals: i32,
    with: impl FnOnce(DragValue<'_>) -> DragValue<'_>,
) -> N {
    let id = Id::new(name);
    let mut value = ui.data_mut(|data| *data.get_temp_mut_or(id, usual));
    let field = number(ui, &mut value, decimals, with);
    field.widget_info(|| WidgetInfo::slider(true, value.to_f64(), name));
    if field.on_hover_text(help).changed() {
        ui.data_mut(|data| data.insert_temp(id, value));
    }
    value
}

/// A slider with such a number beside it, for a factor: typed, it may be any that [`BRIGHTEST`] allows.
pub(super) fn slider(
    ui: &mut Ui,
    value: &mut f64,
    range: RangeInclusive<f64>,
    decimals: i32,
    with: impl FnOnce(Slider<'_>) -> Slider<'_>,
) -> Response {
    // A slider's answer is now its own, now its field's.
    let (before, id, typing) = (*value, ui.next_auto_id(), Typing::new(ui));
    let slider = Slider::new(value, range).clamping(SliderClamping::Never).max_decimals(plain_decimals(decimals));
    let slider = slider.custom_parser(|text| {
        let number = typing.parsed(text)?;
        let allowed = number.clamp(0.0, BRIGHTEST);
        if number.to_bits() == allowed.to_bits() {
            // It keeps what is typed, to so many decimals.
            typing.typed.set(None);
        }
        Some(allowed)
    });
    let slider = slider.custom_formatter(|value, plain| typing.shown::<f64>(value, plain, decimals));
    let response = ui.add(with(slider).update_while_editing(false));
    typing.end(id, response, before, value)
}

/// Takes the keyboard from whatever has it: what is typed there holds.
pub(super) fn leave_field(context: &Context) {
    context.memory_mut(|memory| memory.focused().into_iter().for_each(|field| memory.surrender_focus(field)));
}

/// What is typed into a field.
#[derive(Default)]
struct Typing {
    /// What it showed before.
    shown: RefCell<Option<String>>,
    /// The number that was typed.
    typed: Cell<Option<f64>>,
    /// Why what was typed is not taken.
    refused: RefCell<Option<String>>,
    /// Whether it is left as it was, because somebody has pressed Escape.
    given_up: bool,
}

impl Typing {
    fn new(ui: &Ui) -> Self {
        let (id, frame) = (Id::new("frame of the last Escape"), ui.ctx().cumulative_frame_nr());
        if ui.input(|input| input.key_pressed(Key::Escape)) {
            ui.data_mut(|data| data.insert_temp(id, frame));
        }
        // egui takes what was typed in the frame after it.
        let given_up = ui.data(|data| data.get_temp::<u64>(id)).is_some_and(|last| frame <= last + 1);
        Self { given_up, ..Self::default() }
    }

    fn shown<N: Numeric>(&self, value: f64, plain: RangeInclusive<usize>, decimals: i32) -> String {
        let plain = egui::emath::format_with_decimals_in_range(value, plain);
        let text = if N::INTEGRAL { plain } else { shorter(value, plain, decimals) };
        self.shown.borrow_mut().get_or_insert_with(|| text.clone());
        text
    }

    fn parsed(&self, text: &str) -> Option<f64> {
        if self.given_up {
            return None;
        }
        let number = parsed(text);
        if number.is_none() {
            *self.refused.borrow_mut() = Some(format!("“{text}” is no number, such as 0.25: nothing was changed."));
        }
        self.typed.set(number);
        number
    }

    /// Says why what was typed was refused, or what became of it. A field that is left as it was has changed nothing, though it
    /// shows fewer digits than there are.
    fn end<N: Numeric>(self, id: Id, mut field: Response, before: N, value: &mut N) -> Response {
        self.refused.into_inner().into_iter().for_each(|text| say(&field.ctx, id, text));
        let is = value.to_f64();
        // Of a whole number decimals may have been typed, and of an f32 more digits than it has.
        let near = |typed: f64| if N::INTEGRAL { 0.999 } else { 1e-6 * typed.abs() };
        if let Some(typed) = self.typed.get().filter(|typed| (typed - is).abs() > near(*typed)) {
            let than = if typed > is { "more" } else { "less" };
            let [typed, is] = [typed, is].map(|number| shorter(number, number.to_string(), 3));
            say(&field.ctx, id, format!("{typed} is {than} than is possible here: it became {is}."));
        }
        show_said(id, &field, is);
        let as_shown =
            || self.shown.borrow().as_deref().and_then(parsed).is_some_and(|shown| shown.to_bits() == is.to_bits());
        // A slider calls it a change, too, when what is in its field changes.
        if is.to_bits() == before.to_f64().to_bits() || field.lost_focus() && as_shown() {
            *value = before;
            field.flags.remove(Flags::CHANGED);
        }
        field
    }
}

/// Digits that a number may take where it is shown without an exponent.
const LONGEST: usize = 11;

/// `value` to so many `decimals`, with an exponent where it would be long without.
pub(super) fn text(value: f64, decimals: i32) -> String {
    shorter(value, format!("{value:.*}", plain_decimals(decimals)), decimals)
}

fn plain_decimals(decimals: i32) -> usize {
    usize::try_from(decimals.min(30)).unwrap_or(0)
}

/// `plain`, or `value` with an exponent where that says as much and is shorter.
fn shorter(value: f64, plain: String, decimals: i32) -> String {
    if plain.len() <= LONGEST || value == 0.0 || !value.is_finite() {
        return plain;
    }
    let exponent = whole(value.abs().log10().floor().abs());
    let exponent = i32::try_from(exponent).unwrap_or(0) * if value.abs() < 1.0 { -1 } else { 1 };
    let digits = usize::try_from((exponent + decimals).min(15)).unwrap_or(0);
    // Without the zeros at its end.
    let rounded: f64 = format!("{value:.digits$e}").parse().unwrap_or(value);
    let short = format!("{rounded:e}");
    if short.len() < plain.len() { short } else { plain }
}

/// The number that `text` is. Spaces may part digits, and a minus may be a long one.
fn parsed(text: &str) -> Option<f64> {
    let digits: String = text.chars().filter(|letter| !letter.is_whitespace()).collect();
    digits.replace('−', "-").parse().ok().filter(|number: &f64| number.is_finite())
}

/// Says beside a field for a while what became of what was typed there.
pub(super) fn say_beside(field: &Response, text: String) {
    say(&field.ctx, field.id, text);
}

/// What is said beside a field.
#[derive(Clone)]
struct Said {
    text: String,
    since: Instant,
    /// Of which number, once that is shown.
    of: Option<f64>,
}

fn say(context: &Context, field: Id, text: String) {
    context.data_mut(|data| data.insert_temp(field.with("said"), Said { text, since: Instant::now(), of: None }));
    context.request_repaint();
}

/// Shows what is said beside a `field`, which it is called by here, until that can have been read, or the number `is` another one.
fn show_said(id: Id, field: &Response, is: f64) {
    let id = id.with("said");
    let Some(said) = field.ctx.data(|data| data.get_temp::<Said>(id)) else { return };
    let left = LONG_ENOUGH.saturating_sub(said.since.elapsed());
    if left.is_zero() || field.has_focus() || said.of.is_some_and(|of| of.to_bits() != is.to_bits()) {
        field.ctx.data_mut(|data| data.remove::<Said>(id));
        return;
    }
    field.ctx.request_repaint_after(left);
    // No tooltip: those are not shown over what was just used. What lies behind it can be clicked.
    Popup::from_response(field)
        .id(id)
        .open(true)
        .interactable(false)
        .close_behavior(PopupCloseBehavior::IgnoreClicks)
        .show(|ui| ui.label(&said.text));
    field.ctx.data_mut(|data| data.insert_temp(id, Said { of: Some(is), ..said }));
}

/// What a panel's controls make stale, in two words, in a sentence and in colour.
fn word(stale: Stale) -> &'static str {
    if stale < Stale::Accumulators { "relights: at once" } else { "marches: coarse first" }
}

fn sentence(stale: Stale) -> &'static str {
    if stale < Stale::Accumulators {
        "These controls change only the light. The marched picture is kept."
    } else {
        "These controls march all rays again: first a coarse picture, then the full resolution."
    }
}

fn colour(ui: &Ui, stale: Stale) -> Color32 {
    match (stale < Stale::Accumulators, ui.visuals().dark_mode) {
        (true, true) => Color32::from_rgb(110, 200, 130),
        (true, false) => Color32::from_rgb(20, 110, 50),
        (false, true) => Color32::from_rgb(235, 170, 90),
        (false, false) => Color32::from_rgb(150, 80, 0),
    }
}
