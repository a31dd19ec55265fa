//! Values and gradient magnitudes of the volume, with the terms of the transfer function as rectangles and polygons.

use std::sync::Arc;

use egui::epaint::{Mesh, Vertex, WHITE_UV};
use egui::{
    Color32, ColorImage, CursorIcon, Id, Pos2, Rangef, Rect, Sense, Shape, Stroke, StrokeKind, TextureHandle,
    TextureOptions, Ui, Vec2, WidgetInfo, WidgetType, pos2,
};

use super::axis::{HANDLE, Map, choose, chosen, middle, snapped};
use super::spectrum::narrow;
use crate::document::{Document, Edit};
use crate::number::count;
use crate::scene::{self, Form, GradientFactor, Interval, Second, Term, Transfer, factor_at};
use crate::view::action::Action;
use crate::volume::{JOINT_BINS, JointHistogram};

/// Cells of a shape along each axis.
const CELLS: usize = 32;

/// Part of the axis of magnitudes over which a new rectangle begins and ends.
const RAMP: f64 = 0.05;

pub(super) const HELP: &str = "Grey: voxels by value (to the right) and gradient magnitude (upwards), on a log scale; boundaries between \
    materials are arcs. Drag over an area to add an interval with a factor of its own, and a rectangle's edges to move them. A cross marks \
    what the probe sees. Terms may have four different factors, none counted as one.";

/// Values and magnitudes on the screen.
struct Plane<'a> {
    map: &'a Map,
    steepest: f64,
}

impl Plane<'_> {
    fn y(&self, magnitude: f64) -> f32 {
        let part = narrow((magnitude / self.steepest).clamp(0.0, 1.0));
        self.map.rect.bottom() - part * self.map.rect.height()
    }

    /// The screen rows where a factor is not 0.
    fn rows(&self, factor: &[(f64, f64)]) -> Rangef {
        // It is 0 up to the point before its first positive one, and from the point behind its last.
        let positive = |point: &(f64, f64)| point.1 > 0.0;
        let row = |point: Option<&(f64, f64)>, end: f32| point.map_or(end, |point| self.y(point.0));
        let first = factor.iter().position(positive).and_then(|first| factor.get(first.checked_sub(1)?));
        let last = factor.iter().rposition(positive).and_then(|last| factor.get(last + 1));
        let (top, bottom) = (row(last, self.map.rect.top()), row(first, self.map.rect.bottom()));
        Rangef::new(top.min(bottom), bottom)
    }

    fn magnitude(&self, y: f32) -> f64 {
        let part = f64::from((self.map.rect.bottom() - y) / self.map.rect.height().max(1.0)).clamp(0.0, 1.0);
        snapped(part * self.steepest, self.steepest)
    }
}

/// Shows the joint histogram with the rectangles of the terms. `seen` is the value and the magnitude of what the probe sees.
pub(super) fn show(
    ui: &mut Ui,
    document: &Document,
    (map, joint): (&Map, &JointHistogram),
    (colours, seen): (&[Color32], Option<[f64; 2]>),
    asked: &mut Vec<Action>,
) {
    let plane = Plane { map, steepest: joint.steepest };
    let transfer = &document.state().scene.transfer;
    ui.painter().rect_filled(map.rect.expand(HANDLE / 2.0), 2.0, ui.visuals().extreme_bg_color);
    let uv = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
    ui.painter().image(texture(ui, joint).id(), map.rect, uv, ui.visuals().weak_text_color());
    add_by_drag(ui, transfer, &plane, asked);
    let front = chosen(ui);
    let mut order: Vec<usize> = (0..transfer.terms.len()).collect();
    order.sort_by_key(|&index| front == Some(index));
    for &index in &order {
        paint(ui, transfer, &transfer.terms[index], &plane, colours);
    }
    for &index in &order {
        if let Some(interval) = transfer.terms[index].as_interval() {
            let rows = plane.rows(transfer.factor_of(&transfer.terms[index]));
            edges(ui, index, (&interval, rows), &plane, asked);
            levels(ui, index, (&interval, &transfer.terms[index].gradient), &plane, asked);
            if let Some(shape) = &transfer.terms[index].shape {
                corners(ui, index, shape, &plane, asked);
            }
        }
    }
    if let Some([value, magnitude]) = seen {
        let at = pos2(map.x(value), plane.y(magnitude));
        for (width, colour) in [(3.0, Color32::BLACK), (1.0, Color32::WHITE)] {
            let stroke = Stroke::new(width, colour);
            ui.painter().line_segment([at - Vec2::X * 6.0, at + Vec2::X * 6.0], stroke);
            ui.painter().line_segment([at - Vec2::Y * 6.0, at + Vec2::Y * 6.0], stroke);
        }
    }
}

/// The histogram as a texture, from the steepest magnitudes at its top.
fn texture(ui: &Ui, joint: &JointHistogram) -> TextureHandle {
    let id = Id::new("joint histogram");
    let key = std::ptr::from_ref(joint) as usize;
    if let Some((known, texture)) = ui.data(|data| data.get_temp::<(usize, TextureHandle)>(id))
        && known == key
    {
        return texture;
    }
    let height = |voxels: u32| f64::from(voxels).ln_1p();
    let most = joint.counts.iter().map(|&voxels| height(voxels)).fold(f64::MIN_POSITIVE, f64::max);
    let [width, rows] = JOINT_BINS;
    let pixels = joint.counts.chunks(width).rev().flatten();
    let pixels = pixels.map(|&voxels| Color32::WHITE.gamma_multiply(narrow(height(voxels) / most))).collect();
    let picture = ColorImage::new([width, rows], pixels);
    let texture = ui.ctx().load_texture("joint histogram", picture, TextureOptions::NEAREST);
    ui.data_mut(|data| data.insert_temp(id, (key, texture.clone())));
    texture
}

/// A new rectangle where the user drags over an area.
fn add_by_drag(ui: &Ui, transfer: &Transfer, plane: &Plane<'_>, asked: &mut Vec<Action>) {
    let hand = ui.interact(plane.map.rect, ui.id().with("joint histogram"), Sense::click_and_drag());
    hand.widget_info(|| WidgetInfo::labeled(WidgetType::Image, true, "values and gradients"));
    if let (true, Some(from)) = (hand.drag_started(), ui.input(|input| input.pointer.press_origin())) {
        ui.data_mut(|data| data.insert_temp(hand.id, from));
    }
    let from = ui.data(|data| data.get_temp::<Pos2>(hand.id));
    let (Some(from), Some(to)) = (from, hand.interact_pointer_pos()) else { return };
    let area = Rect::from_two_pos(from, to).intersect(plane.map.rect);
    if hand.dragged() {
        let stroke = Stroke::new(1.0, ui.visuals().strong_text_color());
        ui.painter().rect_stroke(area, 0.0, stroke, StrokeKind::Inside);
    } else if hand.drag_stopped() && area.width() > HANDLE / 2.0 && area.height() > HANDLE / 2.0 {
        let range = [area.left(), area.right()].map(|x| plane.map.value(x));
        let ends = [area.bottom(), area.top()].map(|y| plane.magnitude(y));
        let shown = chosen(ui).and_then(|index| transfer.terms.get(index)).and_then(Term::as_interval);
        let usual = middle([plane.map.low, plane.map.low + plane.map.span]);
        let interval = Interval { range, ..Interval { material: shown.map_or(0, |it| it.material), ..usual } };
        asked.push(Action::Edit(Edit::AddInterval(interval, band(ends, plane.steepest))));
    }
}

/// The factor that is 1 from the first to the second magnitude; beyond the axis, if the second lies at its end.
fn band([from, to]: [f64; 2], steepest: f64) -> GradientFactor {
    let ramp = snapped(RAMP * steepest, steepest);
    let at = |magnitude: f64| snapped(magnitude, steepest);
    let mut points = if from > ramp { vec![(at(from - ramp), 0.0), (from, 1.0)] } else { vec![(0.0, 1.0)] };
    if to < steepest - ramp {
        points.extend([(to, 1.0), (at(to + ramp), 0.0)]);
    }
    points.dedup_by(|next, one| next.0 <= one.0);
    points
}

/// Fills the rectangle of a term with its material's colour, the more the more opaque.
fn paint(ui: &Ui, transfer: &Transfer, term: &Term, plane: &Plane<'_>, colours: &[Color32]) {
    let material = term.material.0.first().map_or(0, |&(_, material)| material);
    let colour = colours.get(material).copied().unwrap_or(Color32::GRAY);
    let factor = transfer.factor_of(term);
    let inner = factor.iter().map(|point| point.0).filter(|magnitude| (0.0..plane.steepest).contains(magnitude));
    let shape = term.shape.as_deref().filter(|shape| shape.second == Second::Gradient);
    let mut rows: Vec<f64> = std::iter::once(0.0).chain(inner).chain([plane.steepest]).collect();
    let mut columns = term.opacity.clone();
    if shape.is_some() {
        // Cells over which a shape is nearly linear.
        let part = |i: usize| count(i) / count(CELLS);
        rows.extend((1..CELLS).map(|i| part(i) * plane.steepest));
        rows.sort_by(f64::total_cmp);
        let pairs = term.opacity.windows(2);
        let between = pairs.flat_map(|ends| {
            (0..CELLS).map(move |i| {
                let [(from, low), (to, high)] = [ends[0], ends[1]];
                (part(i).mul_add(to - from, from), part(i).mul_add(high - low, low))
            })
        });
        columns = between.chain(term.opacity.last().copied()).collect();
    }
    let mut mesh = Mesh::default();
    for &magnitude in &rows {
        for &(value, opacity) in &columns {
            let shown = shape.map_or(1.0, |shape| shape.at(value, magnitude));
            let strength = narrow(opacity.sqrt() * factor_at(factor, magnitude) * shown);
            let pos = pos2(plane.map.x(value), plane.y(magnitude));
            let color = colour.gamma_multiply(0.75 * strength);
            mesh.vertices.push(Vertex { pos, uv: WHITE_UV, color });
        }
    }
    let width = u32::try_from(columns.len()).unwrap_or(0);
    for row in 1..u32::try_from(rows.len()).unwrap_or(1) {
        for column in 1..width {
            let [a, b] = [(row - 1) * width + column - 1, row * width + column - 1];
            mesh.add_triangle(a, a + 1, b);
            mesh.add_triangle(a + 1, b, b + 1);
        }
    }
    ui.painter().with_clip_rect(plane.map.rect).add(Shape::mesh(mesh));
}

/// Draggable ends of the values of a rectangle.
fn edges(ui: &Ui, index: usize, (interval, rows): (&Interval, Rangef), plane: &Plane<'_>, asked: &mut Vec<Action>) {
    let stroke = Stroke::new(if chosen(ui) == Some(index) { 2.0 } else { 1.0 }, ui.visuals().strong_text_color());
    for (side, name) in ["from", "to"].into_iter().enumerate() {
        let x = plane.map.x(interval.range[side]);
        if !plane.map.rect.x_range().expand(1.0).contains(x) {
            continue;
        }
        ui.painter().vline(x, rows, stroke);
        let rect = Rect::from_x_y_ranges(x - HANDLE / 2.0..=x + HANDLE / 2.0, rows);
        let hand = ui.interact(rect, ui.id().with(("rectangle", index, name)), Sense::click_and_drag());
        hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, format!("rectangle {index}: {name}")));
        if hand.is_pointer_button_down_on() {
            choose(ui, index);
        }
        if let (true, Some(pointer)) = (hand.dragged(), hand.interact_pointer_pos()) {
            let value = plane.map.value(pointer.x);
            let [low, high] = interval.range;
            let range = if side == 0 { [value.min(high), high] } else { [low, value.max(low)] };
            asked.push(Action::Edit(Edit::Interval(index, Interval { range, ..*interval })));
        }
        hand.on_hover_cursor(CursorIcon::ResizeHorizontal);
    }
}

/// Draggable corners of a term's polygon.
fn corners(ui: &Ui, index: usize, shape: &Arc<scene::Shape>, plane: &Plane<'_>, asked: &mut Vec<Action>) {
    let (Second::Gradient, Form::Polygon { corners, soft }) = (&shape.second, &shape.form) else { return };
    let painter = ui.painter().with_clip_rect(plane.map.rect.expand(HANDLE / 2.0));
    let place = |corner: &[f64; 2]| pos2(plane.map.x(corner[0]), plane.y(corner[1]));
    let stroke = Stroke::new(if chosen(ui) == Some(index) { 2.0 } else { 1.0 }, ui.visuals().strong_text_color());
    for (number, corner) in corners.iter().enumerate() {
        painter.line_segment([place(corner), place(&corners[(number + 1) % corners.len()])], stroke);
    }
    for (number, corner) in corners.iter().enumerate() {
        let at = place(corner);
        painter.circle_filled(at, HANDLE / 3.0, ui.visuals().strong_text_color());
        let rect = Rect::from_center_size(at, Vec2::splat(1.5 * HANDLE));
        let hand = ui.interact(rect, ui.id().with(("polygon", index, number)), Sense::click_and_drag());
        hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, format!("polygon {index}: corner {number}")));
        if hand.is_pointer_button_down_on() {
            choose(ui, index);
        }
        if let (true, Some(pointer)) = (hand.dragged(), hand.interact_pointer_pos()) {
            let mut next = corners.clone();
            next[number] = [plane.map.value(pointer.x), plane.magnitude(pointer.y)];
            let form = Form::Polygon { corners: next, soft: *soft };
            let moved = Arc::new(scene::Shape { second: Second::Gradient, form });
            asked.push(Action::Edit(Edit::TermShape(index, Some(moved))));
        }
        hand.on_hover_cursor(CursorIcon::Move);
    }
}

/// Draggable magnitudes of the points of a term's own factor.
fn levels(
    ui: &Ui,
    index: usize,
    (interval, factor): (&Interval, &GradientFactor),
    plane: &Plane<'_>,
    asked: &mut Vec<Action>,
) {
    let [low, high] = interval.range.map(|end| plane.map.x(end));
    let across = low.max(plane.map.rect.left())..=high.min(plane.map.rect.right()).max(low + HANDLE);
    for (point, &(magnitude, _)) in factor.iter().enumerate() {
        let y = plane.y(magnitude);
        let stroke = Stroke::new(1.0, ui.visuals().strong_text_color());
        ui.painter().hline(across.clone(), y, stroke);
        let rect = Rect::from_x_y_ranges(across.clone(), y - HANDLE / 2.0..=y + HANDLE / 2.0);
        let hand = ui.interact(rect, ui.id().with(("rectangle", index, point)), Sense::click_and_drag());
        let name = || format!("rectangle {index}: gradient point {point}");
        hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, name()));
        if hand.is_pointer_button_down_on() {
            choose(ui, index);
        }
        if let (true, Some(pointer)) = (hand.dragged(), hand.interact_pointer_pos()) {
            let mut next = factor.clone();
            // Between its neighbours, from which it keeps a distance that files can state.
            let least = plane.steepest / 1000.0;
            let before = point.checked_sub(1).map_or(0.0, |before| factor[before].0 + least);
            let after = factor.get(point + 1).map_or(f64::INFINITY, |next| next.0 - least);
            next[point].0 = plane.magnitude(pointer.y).min(after).max(before);
            asked.push(Action::Edit(Edit::TermGradient(index, next)));
        }
        hand.on_hover_cursor(CursorIcon::ResizeVertical);
    }
}
