//! Slices beside the picture: three planes through a common crosshair, with window and level, materials and labels.

use std::sync::{Arc, Weak};

use egui::emath::GuiRounding;
use egui::{
    Align2, Color32, ColorImage, Context, CursorIcon, Id, PointerButton, Pos2, Rect, Sense, Stroke, StrokeKind,
    TextureHandle, TextureOptions, Ui, UiBuilder, Vec2, WidgetInfo, WidgetType, pos2, vec2,
};
use glam::{DVec2, DVec3};

use super::Shown;
use super::annotations;
use super::axes::COLOURS;
use super::axis::places;
use super::clip;
use super::controls::number;
use super::crop;
use super::spectrum::narrow;
use super::transfer::colours;
use crate::annotate::PixelLength;
use crate::document::Document;
use crate::number::{brief_in, count, whole};
use crate::scene::{Scene, Transfer};
use crate::view::action::Action;
use crate::view::layout::{Arrange, MOST_ZOOM, Ruler};
use crate::view::slices::{Overlay, Painted, Plane, Slices, index_from_world, planes, voxel, window_of, windows};
use crate::volume::{Statistics, Volume, Window};

/// Height of the controls below the slices, in points.
const BAR: f32 = 26.0;
/// Gap between the views.
const GAP: f32 = 3.0;
/// Smallest view in points that shows a slice.
const LEAST: f32 = 16.0;
/// Drag in points that doubles the width of the window, or moves its level by the width.
const WINDOW_DRAG: f64 = 200.0;
/// Points of a smooth scroll that turn one slice.
const SCROLL: f32 = 24.0;

/// Shows the slices in `rect` around the picture, and returns the rectangle left for the picture.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>, rect: Rect, asked: &mut Vec<Action>) -> Rect {
    let slices = &shown.layout.slices;
    let (true, Some(document), None) = (slices.shown, shown.document, shown.loading) else {
        forget(ui.ctx());
        return rect;
    };
    let Some(statistics) = document.statistics() else { return rect };
    let volume = document.state().scene.volume();
    let (views, bar) = rect.split_top_bottom_at_y((rect.bottom() - BAR).max(rect.top()));
    let middle = views.center().round_to_pixels(ui.pixels_per_point());
    let half = 0.5 * GAP;
    let [left, right] = [views.left()..=middle.x - half, middle.x + half..=views.right()];
    let [top, bottom] = [views.top()..=middle.y - half, middle.y + half..=views.bottom()];
    let picture = Rect::from_x_y_ranges(right.clone(), top.clone());
    let cells = [(left.clone(), top), (left, bottom.clone()), (right, bottom)];
    let window = slices.window.unwrap_or_else(|| window_of(&windows(volume, statistics), statistics));
    let shows_colours = slices.materials || slices.labels;
    let colours = if shows_colours { colours(document.state()) } else { Vec::new() };
    ui.painter().rect_filled(bar, 0.0, ui.visuals().panel_fill);
    for (plane, (x, y)) in planes(volume).iter().zip(cells) {
        let cell = Rect::from_x_y_ranges(x, y);
        if cell.size().min_elem() >= LEAST {
            view(ui, document, statistics, (plane, cell, window), &colours, shown, asked);
        }
    }
    let bar = &mut ui.new_child(UiBuilder::new().max_rect(bar.shrink2(vec2(8.0, 2.0))));
    controls(bar, document, statistics, (slices, window), asked);
    picture
}

/// One slice: its pixels, crosshair, letters and scale bar, and what the pointer does on it.
fn view(
    ui: &mut Ui,
    document: &Document,
    statistics: &Statistics,
    (plane, cell, window): (&Plane, Rect, [f64; 2]),
    colours: &[Color32],
    shown: &Shown<'_>,
    asked: &mut Vec<Action>,
) {
    let scene = &document.state().scene;
    let (volume, slices) = (scene.volume(), &shown.layout.slices);
    let geometry = &volume.geometry;
    let at = slices.crosshair(geometry);
    let size = plane.size(geometry);
    // World units of a point, so that the slice fits into the cell below its name.
    let room = cell.shrink(4.0);
    let units = (size.x / f64::from(room.width().max(1.0))).max(size.y / f64::from(room.height().max(1.0)));
    let (zoom, middle) = slices.zoom.unwrap_or((1.0, at));
    let units = units / zoom;
    let extent = vec2(narrow(size.x / units), narrow(size.y / units));
    let image = placed(room, extent, plane.place_of(geometry, middle)).round_to_pixels(ui.pixels_per_point());
    let painter = ui.painter().with_clip_rect(cell);
    painter.rect_filled(cell, 0.0, Color32::BLACK);
    let index = voxel(at)[plane.normal];
    if let Some(texture) = texture(ui, scene, statistics, (plane, index, image, window), slices, colours) {
        let all = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
        painter.image(texture.id(), image, all, Color32::WHITE);
    }
    let hand = ui.interact(cell, ui.id().with(("slice", plane.normal)), Sense::click_and_drag());
    let last = geometry.dims[plane.normal] - 1;
    let name = format!("{} {index} of 0 to {last}", plane.name);
    hand.widget_info(|| WidgetInfo::labeled(WidgetType::Image, true, format!("slice: {}", plane.name)));

    let screen = |index: DVec3| {
        let place = plane.place_of(geometry, index);
        image.min + vec2(narrow(place.x), narrow(place.y)) * image.size()
    };
    let cross = screen(at);
    let faint = |axis: usize| Stroke::new(1.0, COLOURS[axis].gamma_multiply(0.75));
    // Each line lies in the plane across its axis. A gap leaves the voxel at the crosshair visible.
    for (from, to) in [(image.left(), cross.x - 7.0), (cross.x + 7.0, image.right())] {
        if from < to {
            painter.hline(from..=to, cross.y, faint(plane.down.0));
        }
    }
    for (from, to) in [(image.top(), cross.y - 7.0), (cross.y + 7.0, image.bottom())] {
        if from < to {
            painter.vline(cross.x, from..=to, faint(plane.right.0));
        }
    }
    painter.rect_stroke(image, 0.0, Stroke::new(1.0, Color32::from_gray(60)), StrokeKind::Outside);
    annotations::text(&painter, cell.min + vec2(6.0, 4.0), Align2::LEFT_TOP, &name, 11.5, COLOURS[plane.normal]);
    match &plane.edges {
        Some(edges) => annotations::letters(&painter, cell, edges),
        None => axes(&painter, cell, plane),
    }
    let point = PixelLength { units, exact: true };
    annotations::scale_bar(&painter, cell, point, volume.unit);

    ruler(&painter, volume, plane, index, shown.layout.ruler, &screen);
    let ends_line = shown.layout.ruler.on && hand.clicked();
    if let (true, Some(pointer)) =
        (hand.clicked() || hand.dragged_by(PointerButton::Primary), hand.interact_pointer_pos())
    {
        let place = (pointer - image.min) / image.size();
        let mut there = plane.index_at(geometry, DVec2::new(place.x.into(), place.y.into()), at);
        if ends_line {
            // In the middle of the voxels that the slice shows.
            there[plane.normal] = count(index);
            asked.push(Action::Arrange(Arrange::RulerEnd(geometry.world_from_index(there))));
        } else {
            asked.push(Action::Arrange(Arrange::SliceAt(there)));
        }
    }
    // Place of the middle of the view in the slice.
    let part =
        |at: Pos2| DVec2::new(((at - image.min) / image.size()).x.into(), ((at - image.min) / image.size()).y.into());
    let around = |place: DVec2| plane.index_at(geometry, place, middle);
    if hand.dragged_by(PointerButton::Middle) && hand.drag_delta() != Vec2::ZERO && zoom > 1.0 {
        asked.push(Action::Arrange(Arrange::SliceZoom(zoom, around(part(room.center() - hand.drag_delta())))));
    }
    if let (Some(factor), Some(pointer)) = (zoomed(ui, &hand), hand.hover_pos()) {
        let next = (zoom * factor).clamp(1.0, MOST_ZOOM);
        // The voxel below the pointer stays there.
        let (here, middle) = (part(pointer), part(room.center()));
        asked.push(Action::Arrange(Arrange::SliceZoom(next, around(here + (middle - here) * (zoom / next)))));
    }
    crop::in_slice(ui, document, (plane, at, image, cell), asked);
    clip::in_slice(ui, document, (plane, at, image, cell), asked);
    let dragged = hand.drag_delta();
    if hand.dragged_by(PointerButton::Secondary) && dragged != Vec2::ZERO {
        asked.push(Action::Arrange(Arrange::Window(dragged_window(window, dragged, statistics))));
    }
    if let Some(by) = turned(ui, &hand, plane.normal) {
        let mut next = at;
        next[plane.normal] = (count(index) + by).clamp(0.0, count(last));
        asked.push(Action::Arrange(Arrange::SliceAt(next)));
    }
    hand.on_hover_cursor(CursorIcon::Crosshair);
}

/// The rectangle of a slice of `extent` points with `middle`, a fraction of it, in the middle of `room`: without gaps at
/// the edges, and centred where it is smaller.
fn placed(room: Rect, extent: Vec2, middle: DVec2) -> Rect {
    let along = |low: f32, high: f32, extent: f32, middle: f64| {
        let centre = f32::midpoint(low, high);
        if extent <= high - low {
            centre - extent / 2.0
        } else {
            (centre - narrow(middle) * extent).clamp(high - extent, low)
        }
    };
    let left = along(room.left(), room.right(), extent.x, middle.x);
    let top = along(room.top(), room.bottom(), extent.y, middle.y);
    Rect::from_min_size(pos2(left, top), extent)
}

/// The measuring line, as far as it lies in the slice at `index`; faint if an end lies outside.
fn ruler(
    painter: &egui::Painter,
    volume: &Volume,
    plane: &Plane,
    index: usize,
    ruler: Ruler,
    screen: &impl Fn(DVec3) -> Pos2,
) {
    let ends = ruler.ends.map(|end| Some(index_from_world(&volume.geometry, end?)));
    let is_inside = |end: &DVec3| (end[plane.normal] - count(index)).abs() <= 0.5 + 1e-9;
    let inside = ends.iter().flatten().all(is_inside);
    let places = ends.map(|end| end.map(screen).filter(|at| at.is_finite()));
    annotations::line(painter, places, ruler.length().map(|length| (length, volume.unit)), inside);
}

/// Names of the axes at the right and the bottom of a slice of a volume without anatomical axes.
fn axes(painter: &egui::Painter, cell: Rect, plane: &Plane) {
    let name = |axis: usize| ["x", "y", "z"][axis];
    let inner = cell.shrink(5.0);
    let (down, ascends) = plane.down;
    let (at, align) =
        if ascends { (inner.center_bottom(), Align2::CENTER_BOTTOM) } else { (inner.center_top(), Align2::CENTER_TOP) };
    annotations::text(painter, at, align, name(down), 13.0, COLOURS[down]);
    let right = plane.right.0;
    annotations::text(painter, inner.right_center(), Align2::RIGHT_CENTER, name(right), 13.0, COLOURS[right]);
}

/// The window after a drag: to the right wider, downwards brighter. It stays at least a thousandth of the values wide.
fn dragged_window([low, high]: [f64; 2], by: Vec2, statistics: &Statistics) -> [f64; 2] {
    let least = ((statistics.max - statistics.min) / 1000.0).max(f64::MIN_POSITIVE);
    let width = ((high - low).max(least) * (f64::from(by.x) / WINDOW_DRAG).exp2()).max(least);
    let level = f64::midpoint(low, high) - f64::from(by.y) / WINDOW_DRAG * width;
    let level = level.clamp(statistics.min, statistics.max);
    [level - width / 2.0, level + width / 2.0]
}

/// Slices to turn by the wheel over a view: one per line.
fn turned(ui: &Ui, hand: &egui::Response, normal: usize) -> Option<f64> {
    if !hand.hovered() {
        return None;
    }
    let mut steps = 0.0;
    let id = Id::new(("scrolled slices", normal));
    let mut rest: f32 = ui.data(|data| data.get_temp(id)).unwrap_or(0.0);
    ui.input(|input| {
        for event in &input.events {
            if let egui::Event::MouseWheel { unit, delta, modifiers, .. } = event
                && !modifiers.command
            {
                match unit {
                    egui::MouseWheelUnit::Point => rest += delta.y / SCROLL,
                    egui::MouseWheelUnit::Line | egui::MouseWheelUnit::Page => rest += delta.y,
                }
            }
        }
    });
    if rest.abs() >= 1.0 {
        steps = f64::from(rest.trunc());
        rest = rest.fract();
    }
    ui.data_mut(|data| data.insert_temp(id, rest));
    (steps != 0.0).then_some(steps)
}

/// Factor by which the wheel with Ctrl enlarges a view: 1.2 for a line.
fn zoomed(ui: &Ui, hand: &egui::Response) -> Option<f64> {
    if !hand.hovered() {
        return None;
    }
    let mut lines = 0.0;
    ui.input(|input| {
        for event in &input.events {
            if let egui::Event::MouseWheel { unit, delta, modifiers, .. } = event
                && modifiers.command
            {
                lines += if *unit == egui::MouseWheelUnit::Point { delta.y / SCROLL } else { delta.y };
            }
        }
    });
    (lines != 0.0).then(|| 1.2_f64.powf(lines.into()))
}

/// Controls of the window and the overlays, and the value at the crosshair.
fn controls(
    ui: &mut Ui,
    document: &Document,
    statistics: &Statistics,
    (slices, window): (&Slices, [f64; 2]),
    asked: &mut Vec<Action>,
) {
    let mut ask = |change: Arrange| asked.push(Action::Arrange(change));
    let scene = &document.state().scene;
    ui.horizontal(|ui| {
        let menu = ui.menu_button("Window", |ui| {
            let all = Window::new("all values", statistics.min, statistics.max);
            for Window { name, low, high } in windows(scene.volume(), statistics).into_iter().chain(all) {
                let ends = [low, high].map(|end| brief_in(end, statistics.max - statistics.min));
                let help = format!("Values from {} (black) to {} (white).", ends[0], ends[1]);
                if ui.button(name).on_hover_text(help).clicked() {
                    ask(Arrange::Window([low, high]));
                    ui.close();
                }
            }
        });
        menu.response.on_hover_text(
            "Values from black to white in the slices. Drag a slice with the right button: to the right for a wider \
             window, downwards for a brighter one.",
        );
        let speed = (window[1] - window[0]).max(f64::MIN_POSITIVE) / 200.0;
        let mut next = window;
        for (end, name) in ["window: low", "window: high"].into_iter().enumerate() {
            let field = number(ui, &mut next[end], places(statistics.max - statistics.min), |drag| drag.speed(speed));
            let value = next[end];
            field.widget_info(|| WidgetInfo::slider(true, value, name));
            field.on_hover_text(["Value shown black.", "Value shown white."][end]);
            if end == 0 {
                ui.label("to");
            }
        }
        if next.map(f64::to_bits) != window.map(f64::to_bits) && next[0] < next[1] {
            ask(Arrange::Window(next));
        }
        let mut materials = slices.materials;
        let help = "Materials of the transfer function over the values, in their colours under the present light. The \
                    square root of the opacity covers the value, as in the graph.";
        if ui.checkbox(&mut materials, "materials").on_hover_text(help).changed() {
            ask(Arrange::SliceMaterials(materials));
        }
        let mut labels = slices.labels;
        let there = scene.labels.as_ref().is_some_and(|labels| !labels.declared.is_empty());
        let tick = ui.add_enabled(there, egui::Checkbox::new(&mut labels, "labels"));
        let help = "Labels over the values, in the colours of their materials under the present light.";
        if tick.on_hover_text(help).on_disabled_hover_text("The scene declares no labels.").changed() {
            ask(Arrange::SliceLabels(labels));
        }
        if let Some((zoom, middle)) = slices.zoom {
            let button = ui.small_button(format!("× {zoom:.1}"));
            let help = "Enlargement of the slices; a click shows them whole. Turn the wheel with Ctrl to enlarge, drag with \
                        the middle button to move.";
            button.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, "whole slices"));
            if button.on_hover_text(help).clicked() {
                ask(Arrange::SliceZoom(1.0, middle));
            }
        }
        let span = statistics.max - statistics.min;
        let text = told(scene.volume(), span, slices.crosshair(&scene.frame.geometry));
        ui.add(egui::Label::new(egui::RichText::new(text).small()).truncate());
    });
}

/// Value and position of the voxel at the crosshair; the values lie in a range of the length `span`.
fn told(volume: &Volume, span: f64, at: DVec3) -> String {
    let voxel = voxel(at);
    let at_hand = volume.at_hand();
    let block = volume.block_of(at_hand);
    let coarse = std::array::from_fn(|axis| voxel[axis] / block[axis]);
    let value = at_hand.value(coarse).map_or_else(String::new, |value| brief_in(value, span));
    let of_level = match block.iter().product::<usize>() {
        1 => String::new(),
        voxels => format!(" (mean of {voxels} voxels)"),
    };
    let [x, y, z] = volume.geometry.world_from_index(at).to_array().map(|along| format!("{:.1}", along + 0.0));
    let unit = volume.unit.map_or_else(String::new, |unit| format!(" {unit}"));
    let [i, j, k] = voxel;
    format!("value {value}{of_level} at voxel {i} {j} {k}: {x} {y} {z}{unit}")
}

/// Draws the crosshair of the slices into the picture in `rect`: short lines along the axes of the grid.
pub(super) fn crosshair(ui: &Ui, shown: &Shown<'_>, rect: Rect) {
    const ARM: f64 = 0.06;
    let (true, Some(document), None) = (shown.layout.slices.shown, shown.document, shown.loading) else { return };
    let scene = &document.state().scene;
    let geometry = &scene.frame.geometry;
    let Some(view) = scene.camera.view(geometry, shown.aspect) else { return };
    let at = shown.layout.slices.crosshair(geometry);
    let arm = ARM * geometry.extent().max_element();
    let painter = ui.painter().with_clip_rect(rect);
    let place = |index: DVec3| annotations::screen(&view, rect, geometry.world_from_index(index));
    for (axis, colour) in DVec3::AXES.into_iter().zip(COLOURS) {
        let along = axis * arm / geometry.spacing;
        if let (Some(from), Some(to)) = (place(at - along), place(at + along)) {
            painter.line_segment([from, to], Stroke::new(3.0, Color32::from_black_alpha(140)));
            painter.line_segment([from, to], Stroke::new(1.5, colour));
        }
    }
}

/// Everything that the pixels of a slice depend on.
#[derive(Clone)]
struct Key {
    volume: Weak<Volume>,
    labels: Option<Weak<Volume>>,
    plane: Plane,
    index: usize,
    size: [usize; 2],
    window: [f64; 2],
    /// Transfer function and colours of the materials, where they are shown.
    materials: Option<(Transfer, Vec<Color32>)>,
    label_materials: Vec<(i64, usize)>,
    label_colours: Vec<Color32>,
}

impl PartialEq for Key {
    fn eq(&self, other: &Self) -> bool {
        let same_labels = match (&self.labels, &other.labels) {
            (Some(one), Some(two)) => one.ptr_eq(two),
            (None, None) => true,
            _ => false,
        };
        same_labels
            && self.volume.ptr_eq(&other.volume)
            && self.plane == other.plane
            && (self.index, self.size) == (other.index, other.size)
            && self.window.map(f64::to_bits) == other.window.map(f64::to_bits)
            && self.materials == other.materials
            && self.label_materials == other.label_materials
            && self.label_colours == other.label_colours
    }
}

/// Id of the texture of the plane across an axis.
fn texture_id(normal: usize) -> Id {
    Id::new(("texture of a slice", normal))
}

/// Frees the textures: when the slices are hidden, or when the device that held them is lost.
pub fn forget(context: &Context) {
    context.data_mut(|data| {
        (0..3).for_each(|normal| data.remove::<(Key, TextureHandle)>(texture_id(normal)));
        data.remove::<Covered>(covered_id());
    });
}

/// Materials over the values, after the volume, the transfer function and the colours that they belong to.
type Covered = (Weak<Volume>, (Transfer, Vec<Color32>), Arc<Overlay>);

fn covered_id() -> Id {
    Id::new("materials over the slices")
}

/// Materials over the values `of` a transfer function and colours, made again if these or the volume have changed.
fn overlay(ui: &Ui, scene: &Scene, statistics: &Statistics, of: &(Transfer, Vec<Color32>)) -> Arc<Overlay> {
    let volume = Arc::downgrade(scene.volume());
    let known: Option<Covered> = ui.data(|data| data.get_temp(covered_id()));
    if let Some((.., overlay)) = known.filter(|(there, by, _)| there.ptr_eq(&volume) && by == of) {
        return overlay;
    }
    let overlay = Arc::new(Overlay::new(scene, statistics, &codes(&of.1)));
    ui.data_mut(|data| data.insert_temp(covered_id(), (volume, of.clone(), Arc::clone(&overlay))));
    overlay
}

/// Codes of colours from 0 to 1.
fn codes(colours: &[Color32]) -> Vec<[f64; 3]> {
    colours.iter().map(|colour| [colour.r(), colour.g(), colour.b()].map(|code| f64::from(code) / 255.0)).collect()
}

/// Texture of a slice, drawn again if anything in it has changed.
fn texture(
    ui: &Ui,
    scene: &Scene,
    statistics: &Statistics,
    (plane, index, image, window): (&Plane, usize, Rect, [f64; 2]),
    slices: &Slices,
    colours: &[Color32],
) -> Option<TextureHandle> {
    let scale = ui.pixels_per_point();
    let most = ui.input(|input| input.max_texture_side);
    // An enlarged slice takes no more texels than it has voxels.
    let side = |points: f32, (axis, _): (usize, bool)| {
        let voxels = if slices.zoom.is_some() { scene.frame.geometry.dims[axis] } else { usize::MAX };
        whole(f64::from((points * scale).round())).clamp(1, most).min(voxels)
    };
    let size = [side(image.width(), plane.right), side(image.height(), plane.down)];
    let labels = scene.labels.as_ref().filter(|_| slices.labels);
    let key = Key {
        volume: Arc::downgrade(scene.volume()),
        labels: labels.map(|labels| Arc::downgrade(&labels.volume)),
        plane: plane.clone(),
        index,
        size,
        window,
        materials: slices.materials.then(|| (scene.transfer.clone(), colours.to_vec())),
        label_materials: labels.map_or_else(Vec::new, |labels| {
            labels.declared.iter().map(|entry| (entry.label, entry.material)).collect()
        }),
        label_colours: if labels.is_some() { colours.to_vec() } else { Vec::new() },
    };
    let id = texture_id(plane.normal);
    let known: Option<(Key, TextureHandle)> = ui.data(|data| data.get_temp(id));
    if let Some((_, texture)) = known.as_ref().filter(|(of, _)| *of == key) {
        return Some(texture.clone());
    }
    let codes = codes(colours);
    let overlay = key.materials.as_ref().map(|of| overlay(ui, scene, statistics, of));
    // Of voxels that stay in a file, those of a coarse level; labels are in memory.
    let (at_hand, block) = scene.fields.first().at_hand();
    let of_level = index / block[plane.normal];
    let painted = Painted {
        volume: at_hand,
        window,
        overlay: overlay.as_deref(),
        labels: labels.map(|labels| (labels, index, codes.as_slice())),
    };
    let pixels = painted.pixels(plane, of_level, size);
    let pixels = pixels.into_iter().map(|[red, green, blue]| Color32::from_rgb(red, green, blue)).collect();
    let picture = ColorImage::new(size, pixels);
    let texture = match known {
        Some((_, mut texture)) => {
            texture.set(picture, TextureOptions::NEAREST);
            texture
        }
        None => ui.ctx().load_texture(format!("slice {}", plane.normal), picture, TextureOptions::NEAREST),
    };
    ui.data_mut(|data| data.insert_temp(id, (key, texture.clone())));
    Some(texture)
}
