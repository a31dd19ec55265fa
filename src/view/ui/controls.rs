//! Controls shared by several panels.

use std::cell::{Cell, RefCell};
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

use egui::emath::Numeric;
use egui::response::Flags;
use egui::{
    Button, CollapsingHeader, Color32, Context, DragValue, Id, Key, Popup, PopupCloseBehavior, Rect, Response,
    RichText, Sense, Shape, Sides, Slider, SliderClamping, Stroke, Ui, UiBuilder, UiStackInfo, Vec2, WidgetInfo,
    WidgetType, pos2, vec2,
};

use crate::number::whole;
use crate::plan::Stale;
use crate::scene::BRIGHTEST;
use crate::view::action::Action;

/// Display time of the message about rejected input.
const LONG_ENOUGH: Duration = Duration::from_secs(5);

/// Tag of a [`Ui`] in a tab, whose panels have no headers.
const TAB: &str = "tab";

/// Shows `contents` as a tab: its panels have no headers, since the tab is their header.
pub(super) fn tab(ui: &mut Ui, contents: impl FnOnce(&mut Ui)) {
    let info = UiStackInfo::default().with_tag(TAB);
    let all = ui.available_rect_before_wrap();
    ui.scope_builder(UiBuilder::new().ui_stack_info(info).max_rect(all), contents);
}

/// Whether `ui` lies in a tab.
pub(super) fn is_tab(ui: &Ui) -> bool {
    ui.stack().iter().any(|part| part.tags().contains(TAB))
}

/// Shows a panel: collapsible with a header, or without in a [`tab`]. Its mark tells what its controls make `stale`.
pub(super) fn panel(ui: &mut Ui, name: &str, stale: Stale, contents: impl FnOnce(&mut Ui)) {
    if is_tab(ui) {
        return contents(ui);
    }
    let title = RichText::new(name).strong();
    let header = CollapsingHeader::new(title).id_salt(name).default_open(true).show(ui, contents).header_response;
    let at = pos2(ui.max_rect().right() - 10.0, header.rect.center().y);
    let place = Rect::from_center_size(at, Vec2::splat(MARK));
    let response = ui.interact(place, header.id.with("mark"), Sense::hover());
    paint_mark(ui, response, stale);
    ui.add_space(4.0);
}

/// Size of a mark in points.
const MARK: f32 = 12.0;

/// Shows the mark of controls that make `stale` something: a flash if they relight, a block beside dots if they march.
pub(super) fn mark(ui: &mut Ui, stale: Stale) {
    let (_, response) = ui.allocate_exact_size(Vec2::splat(MARK), Sense::hover());
    paint_mark(ui, response, stale);
}

fn paint_mark(ui: &Ui, response: Response, stale: Stale) {
    let (rect, colour) = (response.rect, colour(ui, stale));
    let at = |x: f32, y: f32| rect.min + vec2(x, y) / 12.0 * rect.size();
    if stale < Stale::Accumulators {
        for triangle in [[(7.5, 0.5), (2.0, 7.0), (6.8, 7.0)], [(5.2, 5.0), (10.0, 5.0), (4.5, 11.5)]] {
            let triangle = triangle.map(|(x, y)| at(x, y)).to_vec();
            ui.painter().add(Shape::convex_polygon(triangle, colour, Stroke::NONE));
        }
    } else {
        ui.painter().rect_filled(Rect::from_min_max(at(0.5, 1.0), at(5.0, 11.0)), 0.0, colour);
        for (x, y) in [6.2, 9.2].into_iter().flat_map(|x| [1.0, 5.0, 9.0].map(|y| (x, y))) {
            ui.painter().rect_filled(Rect::from_min_max(at(x, y), at(x + 2.0, y + 2.0)), 0.0, colour);
        }
    }
    response.widget_info(|| WidgetInfo::labeled(WidgetType::Image, true, word(stale)));
    response.on_hover_text(sentence(stale));
}

/// Legend of the marks, from right to left.
pub(super) fn legend(ui: &mut Ui) {
    for stale in [Stale::Accumulators, Stale::Picture] {
        ui.label(RichText::new(word(stale)).small().color(colour(ui, stale))).on_hover_text(sentence(stale));
        mark(ui, stale);
    }
}

/// Shows a line with `left` and `right` contents (outermost first on the right). Truncates long texts, which would
/// widen the panels.
pub(super) fn sides(
    ui: &mut Ui,
    asked: &mut Vec<Action>,
    left: impl FnOnce(&mut Ui) -> Option<Action>,
    right: impl FnOnce(&mut Ui) -> Option<Action>,
) {
    let (left, right) = Sides::new().shrink_left().truncate().show(ui, left, right);
    asked.extend([left, right].into_iter().flatten());
}

/// A selectable button with a frame in both states.
pub(super) fn toggle(ui: &mut Ui, on: bool, text: &str) -> Response {
    ui.add(Button::selectable(on, text).frame_when_inactive(true))
}

/// A row of choices, each with a name and help; the reason of one that is not possible, of `why`, is told on it. Returns a new one.
pub(super) fn choices<T: Copy + PartialEq>(
    ui: &mut Ui,
    (label, help): (&str, &str),
    all: &[(T, &str, &str)],
    now: T,
    why: impl Fn(T) -> Option<String>,
) -> Option<T> {
    let mut chosen = None;
    ui.horizontal_wrapped(|ui| {
        ui.label(label).on_hover_text(help);
        for &(choice, name, help) in all {
            let button = toggle(ui, choice == now, name);
            // Asked where a user is about to choose it, because it takes a plan.
            let is_asked = choice != now && (button.hovered() || button.clicked());
            let why = if is_asked { why(choice) } else { None };
            let is_possible = why.is_none();
            let button = button.on_hover_text(why.as_deref().unwrap_or(help));
            if button.clicked() && choice != now && is_possible {
                chosen = Some(choice);
            }
        }
    });
    chosen
}

/// A number field to drag or type in. Typed text is applied as one edit on Enter or on a click elsewhere. The number is
/// shown with `decimals` decimals and [`SIGNIFICANT`] digits at most; a negative count of decimals rounds to tens, hundreds
/// and so on. `with` sets further options.
pub(super) fn number<N: Numeric>(
    ui: &mut Ui,
    value: &mut N,
    decimals: i32,
    with: impl FnOnce(DragValue<'_>) -> DragValue<'_>,
) -> Response {
    let (before, id, typing) = (*value, ui.next_auto_id(), Typing::new(ui));
    // An existing value of a scene is not clamped, even outside the range of the control.
    let field = DragValue::new(value).update_while_editing(false).max_decimals(plain_decimals(decimals));
    let field = field.clamp_existing_to_range(false).custom_parser(|text| typing.parsed(text));
    let field = field.custom_formatter(|value, plain| typing.shown::<N>(value, plain, decimals));
    let response = ui.add(with(field));
    typing.end(id, response, before, value)
}

/// A number field for a value that is not part of the scene and is kept while the window is open. Its initial value is
/// `usual`.
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

/// A slider with a number field, for a factor. Typed values may exceed `range`, up to [`BRIGHTEST`].
pub(super) fn slider(
    ui: &mut Ui,
    value: &mut f64,
    range: RangeInclusive<f64>,
    decimals: i32,
    with: impl FnOnce(Slider<'_>) -> Slider<'_>,
) -> Response {
    // The response may be that of the slider or of its field.
    let (before, id, typing) = (*value, ui.next_auto_id(), Typing::new(ui));
    let slider = Slider::new(value, range).clamping(SliderClamping::Never).max_decimals(plain_decimals(decimals));
    let slider = slider.custom_parser(|text| {
        let number = typing.parsed(text)?;
        let allowed = number.clamp(0.0, BRIGHTEST);
        if number.to_bits() == allowed.to_bits() {
            // The field keeps the typed value, rounded to its decimals.
            typing.typed.set(None);
        }
        Some(allowed)
    });
    let slider = slider.custom_formatter(|value, plain| typing.shown::<f64>(value, plain, decimals));
    let response = ui.add(with(slider).update_while_editing(false));
    typing.end(id, response, before, value)
}

/// Takes the keyboard focus from the focused field, which applies its text.
pub(super) fn leave_field(context: &Context) {
    context.memory_mut(|memory| memory.focused().into_iter().for_each(|field| memory.surrender_focus(field)));
}

/// Input typed into a field.
#[derive(Default)]
struct Typing {
    /// Text that the field showed before.
    shown: RefCell<Option<String>>,
    /// Typed number.
    typed: Cell<Option<f64>>,
    /// Message about rejected input.
    refused: RefCell<Option<String>>,
    /// Whether Escape cancelled the input.
    given_up: bool,
}

impl Typing {
    fn new(ui: &Ui) -> Self {
        let (id, frame) = (Id::new("frame of the last Escape"), ui.ctx().cumulative_frame_nr());
        if ui.input(|input| input.key_pressed(Key::Escape)) {
            ui.data_mut(|data| data.insert_temp(id, frame));
        }
        // egui applies the typed text one frame after the key.
        let given_up = ui.data(|data| data.get_temp::<u64>(id)).is_some_and(|last| frame <= last + 1);
        Self { given_up, ..Self::default() }
    }

    fn shown<N: Numeric>(&self, value: f64, plain: RangeInclusive<usize>, decimals: i32) -> String {
        let plain = egui::emath::format_with_decimals_in_range(value, plain);
        let text = if N::INTEGRAL { plain } else { shorter(value, plain, (decimals, SIGNIFICANT)) };
        self.shown.borrow_mut().get_or_insert_with(|| text.clone());
        text
    }

    fn parsed(&self, text: &str) -> Option<f64> {
        if self.given_up {
            return None;
        }
        let number = parsed(text);
        if number.is_none() {
            *self.refused.borrow_mut() = Some(format!("“{text}” is not a number (such as 0.25): nothing was changed."));
        }
        self.typed.set(number);
        number
    }

    /// Shows why input was rejected or adjusted. A field left unchanged keeps its full-precision value, although it
    /// shows fewer digits.
    fn end<N: Numeric>(self, id: Id, mut field: Response, before: N, value: &mut N) -> Response {
        self.refused.into_inner().into_iter().for_each(|text| say(&field.ctx, id, text));
        let is = value.to_f64();
        // Tolerances for decimals typed into an integer field and for digits beyond f32 precision.
        let near = |typed: f64| if N::INTEGRAL { 0.999 } else { 1e-6 * typed.abs() };
        if let Some(typed) = self.typed.get().filter(|typed| (typed - is).abs() > near(*typed)) {
            let than = if typed > is { "more" } else { "less" };
            let [typed, is] = [typed, is].map(|number| shorter(number, number.to_string(), (3, ALL)));
            say(&field.ctx, id, format!("{typed} is {than} than the limit: the value is now {is}."));
        }
        show_said(id, &field, is);
        let as_shown =
            || self.shown.borrow().as_deref().and_then(parsed).is_some_and(|shown| shown.to_bits() == is.to_bits());
        // A slider also reports a change if the text of its field changes.
        if is.to_bits() == before.to_f64().to_bits() || field.lost_focus() && as_shown() {
            *value = before;
            field.flags.remove(Flags::CHANGED);
        }
        field
    }
}

/// Longest plain number in characters, before an exponent is used.
const LONGEST: usize = 11;
/// Most significant digits of a number in a field.
const SIGNIFICANT: usize = 7;
/// Significant digits that nearly all f64 have.
const ALL: usize = 16;

/// Formats `value` with `decimals` decimals, or with an exponent if it would be long.
pub(super) fn text(value: f64, decimals: i32) -> String {
    shorter(value, format!("{value:.*}", plain_decimals(decimals)), (decimals, ALL))
}

fn plain_decimals(decimals: i32) -> usize {
    usize::try_from(decimals.min(30)).unwrap_or(0)
}

/// Significant digits of a number as text, those of its mantissa.
fn significant(plain: &str) -> usize {
    let mantissa = plain.split(['e', 'E']).next().unwrap_or(plain);
    let digits = mantissa.chars().filter(char::is_ascii_digit).skip_while(|&digit| digit == '0');
    digits.count()
}

/// Returns `plain` with `most` significant digits at most, or `value` with an exponent if that is as precise and shorter.
fn shorter(value: f64, plain: String, (decimals, most): (i32, usize)) -> String {
    let plain = match significant(&plain) > most {
        // Parsing removes trailing zeros.
        true => format!("{value:.*e}", most - 1).parse::<f64>().unwrap_or(value).to_string(),
        // A zero has no significant digits.
        false if value == 0.0 && plain.len() > LONGEST => "0".to_owned(),
        false => plain,
    };
    let is_short = plain.len() <= LONGEST && significant(&plain) <= most;
    if is_short || value == 0.0 || !value.is_finite() {
        return plain;
    }
    let exponent = whole(value.abs().log10().floor().abs());
    let exponent = i32::try_from(exponent).unwrap_or(0) * if value.abs() < 1.0 { -1 } else { 1 };
    let digits = usize::try_from(exponent + decimals).unwrap_or(0).min(most - 1);
    let rounded: f64 = format!("{value:.digits$e}").parse().unwrap_or(value);
    let short = format!("{rounded:e}");
    if short.len() < plain.len() { short } else { plain }
}

/// Parses a finite number. Ignores spaces between digits and accepts the minus sign U+2212.
fn parsed(text: &str) -> Option<f64> {
    let digits: String = text.chars().filter(|letter| !letter.is_whitespace()).collect();
    digits.replace('−', "-").parse().ok().filter(|number: &f64| number.is_finite())
}

/// Shows a temporary message next to a field about its input.
pub(super) fn say_beside(field: &Response, text: String) {
    say(&field.ctx, field.id, text);
}

/// Message next to a field.
#[derive(Clone)]
struct Said {
    text: String,
    since: Instant,
    /// Value of the field when the message was first shown.
    of: Option<f64>,
}

fn say(context: &Context, field: Id, text: String) {
    context.data_mut(|data| data.insert_temp(field.with("said"), Said { text, since: Instant::now(), of: None }));
    context.request_repaint();
}

/// Shows the message of `field`, stored under `id`, until its display time ends or the value `is` changes.
fn show_said(id: Id, field: &Response, is: f64) {
    let id = id.with("said");
    let Some(said) = field.ctx.data(|data| data.get_temp::<Said>(id)) else { return };
    let left = LONG_ENOUGH.saturating_sub(said.since.elapsed());
    if left.is_zero() || field.has_focus() || said.of.is_some_and(|of| of.to_bits() != is.to_bits()) {
        field.ctx.data_mut(|data| data.remove::<Said>(id));
        return;
    }
    field.ctx.request_repaint_after(left);
    // Not a tooltip, because egui shows none over a widget that was just used. Clicks pass through it.
    Popup::from_response(field)
        .id(id)
        .open(true)
        .interactable(false)
        .close_behavior(PopupCloseBehavior::IgnoreClicks)
        .show(|ui| ui.label(&said.text));
    field.ctx.data_mut(|data| data.insert_temp(id, Said { of: Some(is), ..said }));
}

/// Word, explanation and colour of the mark for what a panel makes stale.
fn word(stale: Stale) -> &'static str {
    if stale < Stale::Accumulators { "at once" } else { "coarse first" }
}

fn sentence(stale: Stale) -> &'static str {
    if stale < Stale::Accumulators {
        "Relights: these controls change only the light. The marched picture is kept."
    } else {
        "Marches: these controls march all rays again, first to a coarse picture, then to the full resolution."
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
