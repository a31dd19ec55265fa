//! Transfer function panel: intervals over the value histogram, in their materials' colours under the current light.

use std::ops::RangeInclusive;
use std::sync::Arc;

use egui::style::ScrollStyle;
use egui::{
    Color32, ComboBox, CursorIcon, Id, Pos2, Rect, Response, RichText, ScrollArea, Sense, Shape, Stroke, StrokeKind,
    Ui, UiBuilder, Vec2, WidgetInfo, WidgetType, pos2,
};

use super::axis::{HANDLE, Map, choose, chosen, middle, places, snapped};
use super::controls::{choices, number, panel, say_beside, sides, text};
use super::fields;
use super::rectangles;
use super::spectrum::{code, narrow};
use crate::annotate::material_colours;
use crate::document::transfer_presets::{TransferPreset, of_window};
use crate::document::{Document, Edit, State};
use crate::number::{brief_in, count};
use crate::plan::Stale;
use crate::plan::is_constant;
use crate::scene::{
    self, Blending, Form, GRADIENT_POINTS, GradientFactor, Interval, LabelEntry, Material, OPAQUE_DEPTH, SOFT, Scene,
    Second, Term,
};
use crate::spectrum::colour::display_code;
use crate::view::action::Action;
use crate::volume::{Statistics, Window};

/// Height of opacity 1 in points, in a column.
const HEIGHT: f32 = 110.0;
/// Width of the numbers beside a wide graph.
const NUMBERS: f32 = 300.0;
const HELP: &str = "Grey: histogram of the values, on a log scale. Drag the inside of an interval to shift it, its corners to \
    move an end, its feet to widen its ramps, and the middle of its top for its opacity; the height is the square root of the \
    opacity.";

/// Shows the transfer function and the labels. `seen` is the value and the gradient magnitude of what the probe sees.
pub(super) fn show(ui: &mut Ui, document: &Document, seen: Option<[f64; 2]>, asked: &mut Vec<Action>) {
    panel(ui, "Transfer function", Stale::Tables, |ui| {
        let colours = colours(document.state());
        graph(ui, document, (&colours, seen), HEIGHT, asked);
        rows(ui, document, &colours, asked);
        fields::show(ui, document, asked);
        buttons(ui, document, asked);
        window(ui, document, asked);
        along_rays(ui, &document.state().scene, asked);
        gradient(ui, document, asked);
        labels(ui, document.state(), &colours, asked);
    });
}

/// Shows the choice of the rule that blends the values along a ray.
fn along_rays(ui: &mut Ui, scene: &Scene, asked: &mut Vec<Action>) {
    let label = ("Along a ray", "The rule that blends the values along a ray. A change marches the volume again.");
    let all = [
        (Blending::Composite, "all", "All values, front to back: each dims what is behind it."),
        (
            Blending::Maximum,
            "largest",
            "The largest value alone (maximum intensity projection), with the opacity of its interval: for vessels and channels. \
             Nothing is shaded.",
        ),
        (
            Blending::Minimum,
            "smallest",
            "The smallest value alone (minimum intensity projection): for airways, within a crop box. Nothing is shaded.",
        ),
    ];
    let why = |blending: Blending| Scene { blending, ..scene.clone() }.refused().map(|why| why.to_string());
    let chosen = choices(ui, label, &all, scene.blending, why);
    asked.extend(chosen.map(|blending| Action::Edit(Edit::Blending(blending))));
}

/// Shows the transfer function in a wide dock: the graph on the left, the numbers of the intervals on the right.
pub(super) fn wide(ui: &mut Ui, document: &Document, seen: Option<[f64; 2]>, asked: &mut Vec<Action>) {
    let colours = colours(document.state());
    let all = ui.available_rect_before_wrap();
    let (left, right) = all.split_left_right_at_x(all.right() - NUMBERS.min(0.5 * all.width()));
    let left = &mut ui.new_child(UiBuilder::new().max_rect(left.with_max_x(left.right() - 12.0)));
    // The presets and the ends of the histogram lie below it.
    graph(left, document, (&colours, seen), (left.available_height() - 76.0).max(40.0), asked);
    buttons(left, document, asked);
    window(left, document, asked);
    let right = &mut ui.new_child(UiBuilder::new().max_rect(right));
    right.spacing_mut().scroll = ScrollStyle::solid();
    ScrollArea::vertical().id_salt("intervals").auto_shrink(false).show(right, |ui| {
        rows(ui, document, &colours, asked);
        fields::show(ui, document, asked);
        along_rays(ui, &document.state().scene, asked);
        gradient(ui, document, asked);
        labels(ui, document.state(), &colours, asked);
    });
}

/// The histogram with the intervals over it.
fn graph(
    ui: &mut Ui,
    document: &Document,
    (colours, seen): (&[Color32], Option<[f64; 2]>),
    height: f32,
    asked: &mut Vec<Action>,
) {
    let Some(statistics) = document.statistics() else { return };
    let transfer = &document.state().scene.transfer;
    let map = Map::new(ui, statistics, height);
    if let Some(joint) = by_gradient(ui).then(|| document.joint_histogram()).flatten() {
        rectangles::show(ui, document, (&map, joint), (colours, seen), asked);
        ends(ui, statistics, rectangles::HELP);
        return;
    }
    let terms: Vec<Option<Interval>> = transfer.terms.iter().map(Term::as_interval).collect();
    histogram(ui, statistics, &map);
    // The last one lies on top: the chosen interval over others, and handles over all bodies.
    let front = chosen(ui);
    let mut order: Vec<usize> = (0..terms.len()).collect();
    order.sort_by_key(|&index| front == Some(index));
    for &index in &order {
        outline(ui, &transfer.terms[index], &map, colours, front == Some(index));
    }
    let intervals = || order.iter().filter_map(|&index| Some((index, terms[index].as_ref()?)));
    for (index, interval) in intervals() {
        body(ui, index, interval, &map, asked);
    }
    for (index, interval) in intervals() {
        handles(ui, index, interval, &map, asked);
    }
    ends(ui, statistics, HELP);
}

fn gradient_switch() -> Id {
    Id::new("values by gradient")
}

/// True if the graph shows values and gradient magnitudes.
fn by_gradient(ui: &Ui) -> bool {
    ui.data(|data| data.get_temp(gradient_switch())).unwrap_or(false)
}

/// The numbers of the intervals.
fn rows(ui: &mut Ui, document: &Document, colours: &[Color32], asked: &mut Vec<Action>) {
    for index in 0..document.state().scene.transfer.terms.len() {
        row(ui, document.state(), index, colours, document.statistics(), asked);
    }
}

/// Buttons for the whole transfer function.
fn buttons(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    let state = document.state();
    ui.horizontal_wrapped(|ui| {
        let help = "Adds an interval in the middle of the values.";
        if ui.button("Add interval").on_hover_text(help).clicked() {
            let add = |it: &Statistics| Action::Edit(Edit::AddInterval(middle([it.min, it.max]), Vec::new()));
            asked.extend(document.statistics().map(add));
        }
        let mut on = by_gradient(ui);
        let help = "Shows values and gradient magnitudes, with the intervals as rectangles: boundaries between materials are arcs, \
            and the materials themselves lie at the bottom.";
        if ui.checkbox(&mut on, "By gradient").on_hover_text(help).changed() {
            ui.data_mut(|data| data.insert_temp(gradient_switch(), on));
        }
        let opened = &document.opened().scene;
        let labels = |scene: &Scene| scene.labels.as_ref().map(|labels| labels.declared.clone());
        let changed = state.scene.transfer != opened.transfer
            || labels(&state.scene) != labels(opened)
            || state.scene.fields.terms() != opened.fields.terms();
        presets(ui, state, document.statistics(), asked);
        let help = "Restores the transfer function and the labels of the scene.";
        if ui.add_enabled(changed, egui::Button::new("Reset transfer")).on_hover_text(help).clicked() {
            asked.push(Action::Edit(Edit::ResetTransfer));
        }
    });
}

/// Level and width of a window of values, and a button that makes layers of it.
fn window(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    let Some(statistics) = document.statistics() else { return };
    let Statistics { min, max, .. } = *statistics;
    let span = (max - min).max(f64::MIN_POSITIVE);
    // Kept while the window is open, for each range of values.
    let id = Id::new(("level and width", min.to_bits(), max.to_bits()));
    let first = document.state().scene.volume().presets.windows.first();
    let ends = first.map_or([min, max], |window| [window.low, window.high]);
    let usual = [f64::midpoint(ends[0], ends[1]), ends[1] - ends[0]];
    let mut kept: [f64; 2] = ui.data(|data| data.get_temp(id)).unwrap_or(usual);
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let helps = ["Middle of a window of values.", "Width of a window of values."];
        for ((value, name), help) in kept.iter_mut().zip(["Level", "Width"]).zip(helps) {
            ui.label(name);
            let least = if name == "Width" { 0.0 } else { f64::MIN };
            let field = number(ui, value, places(span / 10.0), |drag| drag.speed(span / 500.0).range(least..=f64::MAX));
            let value = *value;
            field.widget_info(|| WidgetInfo::slider(true, value, format!("window: {name}")));
            field.on_hover_text(help);
        }
        let [level, width] = kept;
        let window = Window::new("window", level - width / 2.0, level + width / 2.0);
        let layers = window.and_then(|window| of_window(&window, statistics, &document.state().scene.materials));
        let button = ui.add_enabled(layers.is_some(), egui::Button::new("Apply window"));
        let help = "Replaces the transfer function by three layers over this window of values; one undo reverts it.";
        let button = button.on_hover_text(help).on_disabled_hover_text("No value lies in this window.");
        if let (true, Some(layers)) = (button.clicked(), layers) {
            asked.push(Action::Edit(Edit::Intervals(layers)));
        }
    });
    ui.data_mut(|data| data.insert_temp(id, kept));
}

/// The factor on all terms without one of their own.
fn gradient(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    let scene = &document.state().scene;
    let help = "Multiplies the opacity by a factor that depends on how fast the values change: noise and the inside of \
        materials disappear, and boundaries stay. Intervals may have a factor of their own.";
    let switch = Switch { text: "Opacity by gradient", help, name: "gradient point".to_owned() };
    let found = factor(ui, &switch, &scene.transfer.gradient_opacity, steepest(scene, document.statistics()));
    asked.extend(found.map(|next| Action::Edit(Edit::GradientOpacity(next))));
}

/// Change of the value from one voxel to the next over all of its range.
fn steepest(scene: &Scene, statistics: Option<&Statistics>) -> f64 {
    let span = statistics.map_or(1.0, |it| (it.max - it.min).max(f64::MIN_POSITIVE));
    span / scene.frame.geometry.spacing.min_element()
}

/// The switch of a factor by the gradient magnitude.
struct Switch<'a> {
    text: &'a str,
    help: &'a str,
    /// Of a point, in the names of fields.
    name: String,
}

/// A factor by the gradient magnitude: a switch, and its points in ascending order. Returns its points after a change.
fn factor(
    ui: &mut Ui,
    Switch { text, help, name }: &Switch<'_>,
    points: &[(f64, f64)],
    steepest: f64,
) -> Option<GradientFactor> {
    // Points that were switched off, kept while the window is open.
    let id = Id::new(("gradient factor", name));
    let mut next = points.to_vec();
    let mut on = !points.is_empty();
    ui.horizontal_wrapped(|ui| {
        let switch = ui.checkbox(&mut on, *text).on_hover_text(*help);
        if switch.changed() && on {
            // A boundary between two materials takes a few voxels, over which the values change by much of their range.
            let usual =
                || [(0.02, 0.0), (0.1, 1.0)].map(|(part, it)| (snapped(part * steepest, steepest), it)).to_vec();
            next = ui.data(|data| data.get_temp(id)).unwrap_or_else(usual);
        } else if switch.changed() {
            ui.data_mut(|data| data.insert_temp(id, std::mem::take(&mut next)));
        }
        let room = !points.is_empty() && points.len() < GRADIENT_POINTS;
        if room && ui.small_button("add point").on_hover_text("Adds a point beyond the last one.").clicked() {
            let last = points.last().map_or(0.0, |point| point.0);
            next.push((snapped(last + 0.05 * steepest, steepest), 1.0));
        }
    });
    let mut removed = None;
    for (index, (magnitude, factor)) in next.iter_mut().enumerate().take(points.len()) {
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            let field = |ui: &mut Ui, value: &mut f64, decimals, speed, most, part: &str, help: &str| {
                let dragged = number(ui, value, decimals, |drag| drag.speed(speed).range(0.0..=most));
                let value = *value;
                dragged.widget_info(|| WidgetInfo::slider(true, value, format!("{name} {index}: {part}")));
                dragged.on_hover_text(help);
            };
            ui.label("at");
            let help = "Change of the value per unit of length.";
            field(ui, magnitude, places(steepest / 10.0), steepest / 500.0, f64::MAX, "magnitude", help);
            ui.label("×");
            let help = "Factor on the opacity, 0 to 1; linear between the points.";
            field(ui, factor, 3, 0.005, 1.0, "factor", help);
            let remove = ui.small_button("remove");
            remove.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, format!("remove {name} {index}")));
            removed = removed.or(remove.clicked().then_some(index));
        });
    }
    if let Some(index) = removed {
        next.remove(index);
    }
    (next != points).then_some(next)
}

/// Menu of transfer presets.
fn presets(ui: &mut Ui, state: &State, statistics: Option<&Statistics>, asked: &mut Vec<Action>) {
    let Some(statistics) = statistics else { return };
    let menu = ui.menu_button("Presets", |ui| {
        for window in &state.scene.volume().presets.windows {
            let intervals = of_window(window, statistics, &state.scene.materials);
            let button = ui.add_enabled(intervals.is_some(), egui::Button::new(&window.name));
            let [low, high] = [window.low, window.high].map(|end| brief_in(end, statistics.max - statistics.min));
            let help = format!("Shows the values from {low} to {high}, as the file asks for.");
            let clicked = button.on_hover_text(help).on_disabled_hover_text("No value lies in this window.").clicked();
            if let (true, Some(intervals)) = (clicked, intervals) {
                asked.push(Action::Edit(Edit::Intervals(intervals)));
                ui.close();
            }
        }
        for preset in TransferPreset::ALL {
            let intervals = preset.intervals(statistics, &state.scene.materials);
            let button = ui.add_enabled(intervals.is_some(), egui::Button::new(preset.name()));
            let none = format!("{} These values are not a CT in Hounsfield units.", preset.help());
            let clicked = button.on_hover_text(preset.help_for(statistics)).on_disabled_hover_text(none).clicked();
            if let (true, Some(intervals)) = (clicked, intervals) {
                asked.push(Action::Edit(Edit::Intervals(intervals)));
                ui.close();
            }
        }
    });
    menu.response.on_hover_text("Replaces the transfer function by a preset. One undo reverts it.");
}

/// Colours of the scene's materials under the current light, lit from all its positions.
pub(super) fn colours(state: &State) -> Vec<Color32> {
    let colours = material_colours(&state.scene, &state.mix_of_swatches()).into_iter();
    colours.map(|colour| Color32::from_hex(&display_code(colour)).unwrap_or(Color32::GRAY)).collect()
}

fn histogram(ui: &Ui, statistics: &Statistics, map: &Map) {
    let visuals = ui.visuals();
    ui.painter().rect_filled(map.rect.expand(HANDLE / 2.0), 2.0, visuals.extreme_bg_color);
    let height = |&bin: &u64| count(usize::try_from(bin).unwrap_or(usize::MAX)).ln_1p();
    let most = statistics.histogram.iter().map(height).fold(f64::MIN_POSITIVE, f64::max);
    let bins = count(statistics.histogram.len());
    let bar = visuals.weak_text_color().gamma_multiply(0.35);
    for (index, bin) in statistics.histogram.iter().enumerate() {
        let edge = |index: f64| map.x(map.low + index / bins * map.span);
        let top = map.rect.bottom() - narrow(height(bin) / most) * map.rect.height();
        let rect = Rect::from_min_max(pos2(edge(count(index)), top), pos2(edge(count(index + 1)), map.rect.bottom()));
        ui.painter().rect_filled(rect, 0.0, bar);
    }
}

/// Shows the values at both ends of the histogram, and `help` between them.
fn ends(ui: &mut Ui, statistics: &Statistics, help: &str) {
    let places = places(statistics.max - statistics.min);
    let end = |value: f64| RichText::new(text(value, places)).small().weak();
    ui.horizontal(|ui| {
        ui.label(end(statistics.min));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            ui.label(end(statistics.max));
            ui.with_layout(egui::Layout::top_down(egui::Align::Center), |ui| {
                // Not on the histogram, where the tooltip would cover the handles and the numbers below.
                let icon = ui.label(RichText::new("ℹ").weak()).on_hover_text(help);
                icon.widget_info(|| WidgetInfo::labeled(WidgetType::Label, true, "help"));
            });
        });
    });
}

/// Plots a term's opacity over the values, filled with its material's colour.
fn outline(ui: &Ui, term: &Term, map: &Map, colours: &[Color32], chosen: bool) {
    let colour = |material: usize| colours.get(material).copied().unwrap_or(Color32::GRAY);
    let fill = term.material.0.first().map_or(Color32::GRAY, |&(_, material)| colour(material));
    let strong = ui.visuals().strong_text_color();
    let stroke = if chosen { Stroke::new(2.0, strong) } else { Stroke::new(1.0, strong.gamma_multiply(0.8)) };
    let painter = ui.painter().with_clip_rect(map.rect.expand(HANDLE / 2.0));
    let points: Vec<Pos2> = term.opacity.iter().map(|&(value, opacity)| pos2(map.x(value), map.y(opacity))).collect();
    // Filled piecewise, because each piece is convex but the whole curve may not be.
    for pair in points.windows(2) {
        let foot = |point: Pos2| pos2(point.x, map.rect.bottom());
        let piece = vec![foot(pair[0]), pair[0], pair[1], foot(pair[1])];
        painter.add(Shape::convex_polygon(piece, fill.gamma_multiply(0.75), Stroke::NONE));
    }
    painter.line(points, stroke);
}

/// If no occurring value and no label is visible, returns a button text and an edit that makes something visible.
pub(super) fn nothing_shown(document: &Document) -> Option<(&'static str, Edit)> {
    let (statistics, scene) = (document.statistics()?, &document.state().scene);
    let bins = &statistics.histogram;
    let width = (statistics.max - statistics.min) / count(bins.len().max(1));
    let edge = |bin: usize| statistics.min + width * count(bin);
    let occurs = |[low, high]: [f64; 2]| {
        let overlaps = |bin: usize| edge(bin) <= high && edge(bin + 1) >= low;
        bins.iter().enumerate().any(|(bin, &voxels)| voxels > 0 && overlaps(bin))
    };
    let shows = |curve: &[(f64, f64)]| {
        let pieces = curve.windows(2).map(|pair| [pair[0], pair[1]]);
        let ends = curve.first().into_iter().map(|&(value, height)| [(f64::NEG_INFINITY, height), (value, height)]);
        let ends = ends.chain(curve.last().map(|&(value, height)| [(value, height), (f64::INFINITY, height)]));
        pieces.chain(ends).any(|piece| piece.iter().any(|end| end.1 > 0.0) && occurs(piece.map(|end| end.0)))
    };
    let by_label = scene.declared().iter().any(LabelEntry::is_visible);
    let by_further = scene.fields.further().iter().any(|field| !field.terms.is_empty());
    if by_label || by_further || scene.transfer.terms.iter().any(|term| shows(&term.opacity) || shows(&term.absorption))
    {
        return None;
    }
    let declared = |scene: &Scene| scene.labels.as_ref().map(|labels| labels.declared.clone());
    if scene.transfer != document.opened().scene.transfer || declared(scene) != declared(&document.opened().scene) {
        return Some(("Reset transfer", Edit::ResetTransfer));
    }
    let range = [statistics.min, statistics.max];
    Some(("Show all values", Edit::AddInterval(Interval { range, ramp: 0.0, ..middle(range) }, Vec::new())))
}

/// Draggable part of an interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Part {
    From,
    To,
    Before,
    Behind,
    Top,
}

fn place(interval: &Interval, map: &Map, part: Part) -> Pos2 {
    let [low, high] = interval.range;
    let (top, bottom) = (map.y(interval.opacity), map.rect.bottom());
    match part {
        Part::From => pos2(map.x(low), top),
        Part::To => pos2(map.x(high), top),
        Part::Before => pos2(map.x(low - interval.ramp), bottom),
        Part::Behind => pos2(map.x(high + interval.ramp), bottom),
        Part::Top => pos2(map.x(f64::midpoint(low, high)), top),
    }
}

fn moved(interval: &Interval, map: &Map, part: Part, to: Pos2) -> Interval {
    let [low, high] = interval.range;
    let value = map.value(to.x);
    let ramp = |ramp: f64| snapped(ramp.max(0.0), map.span);
    match part {
        Part::From => Interval { range: [value.min(high), high], ..*interval },
        Part::To => Interval { range: [low, value.max(low)], ..*interval },
        Part::Before => Interval { ramp: ramp(low - value), ..*interval },
        Part::Behind => Interval { ramp: ramp(value - high), ..*interval },
        Part::Top => Interval { opacity: map.opacity(to.y), ..*interval },
    }
}

/// Shifts both ends of `interval` by the same amount, rounded to the precision of files and fields.
fn shifted(interval: &Interval, by: f64, map: &Map) -> Interval {
    let places = usize::try_from((places(map.span) + 3).min(400)).unwrap_or(0);
    let range = interval.range.map(|end| format!("{:.places$}", end + by).parse().unwrap_or(end));
    Interval { range, ..*interval }
}

/// Draggable inside of an interval, which moves both its ends.
fn body(ui: &Ui, index: usize, interval: &Interval, map: &Map, asked: &mut Vec<Action>) {
    let [low, high] = interval.range.map(|end| map.x(end));
    let inside = Rect::from_x_y_ranges(low..=high, map.y(interval.opacity)..=map.rect.bottom());
    // Flat and thin intervals get a minimum grab area.
    let inside = inside.expand2((Vec2::splat(HANDLE) - inside.size()).max(Vec2::ZERO) / 2.0);
    let inside = inside.intersect(map.rect.expand(HANDLE / 2.0));
    if !inside.is_positive() {
        return;
    }
    let id = ui.id().with(("interval", index));
    let hand = ui.interact(inside, id, Sense::click_and_drag());
    hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, format!("interval {index}: Body")));
    let pointer = hand.interact_pointer_pos().map(|pointer| map.value(pointer.x));
    if let (true, Some(value)) = (hand.is_pointer_button_down_on(), pointer) {
        choose(ui, index);
        // Interval and value at the start of the drag, so that small pointer moves are not lost to rounding.
        let (was, from) = ui.data_mut(|data| *data.get_temp_mut_or(id, (*interval, value)));
        if hand.dragged() {
            asked.push(Action::Edit(Edit::Interval(index, shifted(&was, value - from, map))));
        }
    } else {
        ui.data_mut(|data| data.remove::<(Interval, f64)>(id));
    }
    hand.on_hover_cursor(CursorIcon::ResizeHorizontal);
}

fn handles(ui: &Ui, index: usize, interval: &Interval, map: &Map, asked: &mut Vec<Action>) {
    for part in [Part::Top, Part::Before, Part::Behind, Part::From, Part::To] {
        let at = place(interval, map, part);
        if !map.rect.expand(HANDLE).contains(at) {
            continue;
        }
        let rect = Rect::from_center_size(at, Vec2::splat(HANDLE));
        let hand = ui.interact(rect, ui.id().with(("interval", index, part)), Sense::click_and_drag());
        hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, format!("interval {index}: {part:?}")));
        if hand.is_pointer_button_down_on() {
            choose(ui, index);
        }
        if let (true, Some(pointer)) = (hand.dragged(), hand.interact_pointer_pos()) {
            asked.push(Action::Edit(Edit::Interval(index, moved(interval, map, part, pointer))));
        }
        let near = hand.hovered() || hand.dragged();
        if near || chosen(ui) == Some(index) {
            let colour = ui.visuals().strong_text_color();
            let size = Vec2::splat(if near { HANDLE } else { HANDLE - 3.0 });
            ui.painter().rect_filled(Rect::from_center_size(at, size), 2.0, colour);
        }
    }
}

/// A term with its number fields.
fn row(
    ui: &mut Ui,
    state: &State,
    index: usize,
    colours: &[Color32],
    statistics: Option<&Statistics>,
    asked: &mut Vec<Action>,
) {
    let Some(term) = state.scene.transfer.terms.get(index) else { return };
    let interval = term.as_interval();
    let materials = &state.scene.materials;
    let shown = term.material.0.first().map_or(0, |&(_, material)| material);
    let material = |ui: &mut Ui| {
        let swatch = swatch(ui, colours.get(shown).copied().unwrap_or(Color32::GRAY), materials.get(shown));
        let swatch = swatch.interact(Sense::click()).on_hover_text("Click to bring the interval to the front.");
        if swatch.clicked() {
            choose(ui, index);
        }
        let Some(interval) = &interval else {
            ui.label("curves of the scene file");
            return None;
        };
        let material = choose_material(ui, ("material", index), materials, interval.material)?;
        choose(ui, index);
        Some(Action::Edit(Edit::Interval(index, Interval { material, ..*interval })))
    };
    let remove = |ui: &mut Ui| {
        let remove = ui.small_button("remove").on_hover_text("Removes this from the transfer function.");
        remove.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, format!("remove interval {index}")));
        remove.clicked().then_some(Action::Edit(Edit::RemoveTerm(index)))
    };
    sides(ui, asked, material, remove);
    let Some(interval) = interval else { return };
    let span = statistics.map_or(1.0, |it| it.max - it.min).max(f64::MIN_POSITIVE);
    let mut now = interval;
    // Wrapped, because long numbers would widen the panels.
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.spacing_mut().interact_size.x = 46.0;
        let field = |ui: &mut Ui, value: &mut f64, speed: f64, range: RangeInclusive<f64>, name: &str, help: &str| {
            // Values with the digits that their range needs, opacity with four decimals.
            let decimals = if name == "opacity" { 4 } else { places(span / 10.0) };
            let dragged = number(ui, value, decimals, |drag| drag.speed(speed).range(range)).on_hover_text(help);
            let value = *value;
            dragged.widget_info(|| WidgetInfo::slider(true, value, format!("interval {index}: {name}")));
            if dragged.has_focus() || dragged.dragged() {
                choose(ui, index);
            }
            dragged
        };
        let all = || f64::MIN..=f64::MAX;
        let help = "Start of full opacity. Typed above “to”, it moves that as well.";
        let from_field = field(ui, &mut now.range[0], span / 500.0, all(), "from", help);
        ui.label("to");
        let help = "End of full opacity. Typed below “from”, it moves that as well.";
        let to_field = field(ui, &mut now.range[1], span / 500.0, all(), "to", help);
        let [from, to] = now.range;
        let is_typed = |field: &Response| field.changed() && !field.dragged();
        if from > to {
            // A dragged end stops at the other; a typed one moves the other along.
            let from_rules = is_typed(&from_field) || !from_field.changed() && to_field.dragged();
            now.range = [if from_rules { from } else { to }; 2];
        }
        for (field, other) in [(&from_field, "to"), (&to_field, "from")] {
            if from > to && is_typed(field) {
                say_beside(
                    field,
                    format!("It moved “{other}” as well, because an interval cannot end before it begins."),
                );
            }
        }
        ui.label("±").on_hover_text("Ramp: the value range over which the opacity falls to 0 on either side.");
        field(
            ui,
            &mut now.ramp,
            span / 1000.0,
            0.0..=f64::MAX,
            "ramp",
            "Value range over which the opacity falls to 0 on either side.",
        );
        ui.label("α").on_hover_text("Opacity: fraction of light lost over one opacity length, 0 to 1.");
        field(
            ui,
            &mut now.opacity,
            0.002,
            0.0..=1.0,
            "opacity",
            "Fraction of light lost over one opacity length, 0 to 1.",
        );
    });
    let absorbs = materials.get(interval.material).is_some_and(|material| material.absorption.is_some());
    if absorbs {
        ui.horizontal(|ui| {
            let help = "Absorption: optical depth of one opacity length at the peak of the material's absorption spectrum, which is in Spectra.";
            ui.label(RichText::new("absorbs").small()).on_hover_text(help);
            let most = 0.0..=OPAQUE_DEPTH;
            let dragged = number(ui, &mut now.absorption, 4, |drag| drag.speed(0.005).range(most)).on_hover_text(help);
            let absorption = now.absorption;
            dragged.widget_info(|| WidgetInfo::slider(true, absorption, format!("interval {index}: absorption")));
        });
    }
    if now != interval {
        asked.push(Action::Edit(Edit::Interval(index, now)));
    }
    if by_gradient(ui) || !term.gradient.is_empty() {
        let help = "A factor on this interval alone, in place of that of all: with its values, a rectangle.";
        let switch = Switch { text: "own factor", help, name: format!("interval {index}: gradient point") };
        let found = factor(ui, &switch, &term.gradient, steepest(&state.scene, statistics));
        asked.extend(found.map(|next| Action::Edit(Edit::TermGradient(index, next))));
        let half = steepest(&state.scene, statistics) / 2.0;
        asked.extend(polygon(ui, index, term, half).map(|shape| Action::Edit(Edit::TermShape(index, shape))));
    }
}

/// The switch of a term's polygon over values and gradient magnitudes, of which central differences reach `most`. Returns the new shape.
fn polygon(ui: &mut Ui, index: usize, term: &Term, most: f64) -> Option<Option<Arc<scene::Shape>>> {
    let told = term.shape.as_deref().and_then(|shape| match &shape.form {
        Form::Polygon { .. } if shape.second == Second::Gradient => None,
        Form::Polygon { .. } => Some("a polygon over another field"),
        Form::Ratio(_) => Some("the ratio to another field"),
        Form::Painted(_) => Some("a painted picture"),
    });
    if let Some(told) = told {
        let help = "A shape of the scene file. Remove it there.";
        ui.label(RichText::new(format!("shown by {told}")).small()).on_hover_text(help);
        return None;
    }
    let mut on = term.shape.is_some();
    let help = "Limits the interval to an area over values and gradient magnitudes: drag its corners above. It fades behind its edges.";
    let switch = ui.checkbox(&mut on, "polygon");
    switch.widget_info(|| WidgetInfo::selected(WidgetType::Checkbox, true, on, format!("interval {index}: polygon")));
    if !switch.on_hover_text(help).changed() {
        return None;
    }
    let [low, high] = term.as_interval()?.range;
    let width = (high - low).max(f64::MIN_POSITIVE);
    let corners =
        vec![[f64::midpoint(low, high), 0.0], [low - width / 2.0, most / 2.0], [high + width / 2.0, most / 2.0]];
    let triangle = scene::Shape { second: Second::Gradient, form: Form::Polygon { corners, soft: SOFT } };
    Some(on.then(|| Arc::new(triangle)))
}

fn swatch(ui: &mut Ui, colour: Color32, material: Option<&Material>) -> Response {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(14.0), Sense::hover());
    let outline = Stroke::new(1.0, ui.visuals().widgets.noninteractive.fg_stroke.color);
    ui.painter().rect(rect, 2.0, colour, outline, StrokeKind::Inside);
    response.widget_info(|| WidgetInfo::labeled(WidgetType::ColorButton, true, code(colour)));
    let absorption = material.and_then(|material| material.absorption.as_ref());
    let help = if absorption.is_some_and(|it| !is_constant(it.spectrum())) {
        "The present light through a layer of the material with a transmittance of 0.1 at its absorption peak, times its \
         reflectance, if not 0. Thinner layers are paler, thicker ones darker."
    } else {
        "The material under the present light, as displayed."
    };
    response.on_hover_text(help)
}

/// Returns the newly chosen material, if it changed.
fn choose_material(ui: &mut Ui, id: (&str, usize), materials: &[Material], now: usize) -> Option<usize> {
    let mut material = now;
    let name = |index: usize| materials.get(index).map_or("", |material| &*material.name);
    ComboBox::from_id_salt(id).selected_text(name(now)).width(120.0).truncate().show_ui(ui, |ui| {
        for index in 0..materials.len() {
            ui.selectable_value(&mut material, index, name(index));
        }
    });
    (material != now).then_some(material)
}

/// Shows the label table.
fn labels(ui: &mut Ui, state: &State, colours: &[Color32], asked: &mut Vec<Action>) {
    let Some(labels) = state.scene.labels.as_ref().filter(|labels| !labels.declared.is_empty()) else { return };
    let title = RichText::new("Labels").strong();
    ui.label(title).on_hover_text("Voxels with a label use its material and opacity, regardless of their value.");
    /// Rows that can be found again, and drawn in every frame.
    const ROWS: usize = 400;
    for (index, entry) in labels.declared.iter().enumerate().take(ROWS) {
        let shown = |ui: &mut Ui| {
            let material = state.scene.materials.get(entry.material);
            swatch(ui, colours.get(entry.material).copied().unwrap_or(Color32::GRAY), material);
            ui.allocate_ui(Vec2::new(56.0, 18.0), |ui| {
                ui.set_min_width(56.0);
                ui.add(egui::Label::new(&entry.name).truncate());
            });
            if !entry.terms.is_empty() {
                ui.label(RichText::new("by value").small().weak())
                    .on_hover_text("The label has a transfer function of its own, which the scene file states.");
                return None;
            }
            let material = choose_material(ui, ("label", index), &state.scene.materials, entry.material)?;
            Some(Action::Edit(Edit::Label(index, material, entry.opacity)))
        };
        let hidden = |ui: &mut Ui| {
            if !entry.terms.is_empty() {
                return None;
            }
            let mut opacity = entry.opacity;
            let dragged = number(ui, &mut opacity, 4, |drag| drag.speed(0.002).range(0.0..=1.0))
                .on_hover_text("Fraction of light lost over one opacity length, 0 to 1.");
            dragged.widget_info(|| WidgetInfo::slider(true, opacity, format!("{}: opacity", entry.name)));
            dragged.changed().then_some(Action::Edit(Edit::Label(index, entry.material, opacity)))
        };
        sides(ui, asked, shown, hidden);
    }
    if let more @ 1.. = labels.declared.len().saturating_sub(ROWS) {
        ui.label(RichText::new(format!("and {more} more labels, which the scene file can change")).small().weak());
    }
}
