//! Clip planes: rows of numbers, handles on the picture and in the slices.

use egui::{
    Color32, CursorIcon, Painter, Pos2, Rect, Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo, WidgetType, vec2,
};
use glam::{DVec2, DVec3};

use super::Shown;
use super::controls::{number, panel};
use super::crop::Map;
use super::spectrum::narrow;
use crate::document::{Document, Edit};
use crate::number::count;
use crate::plan::Stale;
use crate::scene::{CLIP_PLANES, Clip, ClipPlane, Frame, Keep, Scene};
use crate::view::action::Action;
use crate::view::slices::{Plane, index_from_world};

/// Size of a handle and of its grab area in points.
const HANDLE: f32 = 10.0;
const CATCH: f32 = 22.0;
/// Least length in points of 1 % of the box on the screen for a handle to be draggable.
const SHORTEST_WAY: f32 = 0.3;
/// Steps over the box of a dragged plane.
const PARTS: f64 = 1e4;
/// Colour of planes.
const COLOUR: Color32 = Color32::from_rgb(120, 200, 255);
const AXES: [(&str, DVec3); 3] = [("x", DVec3::X), ("y", DVec3::Y), ("z", DVec3::Z)];

/// Shows the planes in numbers.
pub(super) fn show(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    panel(ui, "Clip planes", Stale::Accumulators, |ui| {
        let scene = &document.state().scene;
        let mut next = scene.clip.clone();
        ui.horizontal(|ui| {
            ui.label("add a plane across");
            let has_room = next.planes.len() < CLIP_PLANES;
            for (name, axis) in AXES {
                let button = ui.add_enabled(has_room, egui::Button::new(name).small());
                let help = format!("Cuts away what lies beyond the middle along {name}; the row below moves, flips and removes the plane.");
                if button.on_hover_text(help).clicked() {
                    next.planes.extend(middle(&scene.frame, axis));
                }
            }
            let view = scene.camera.view(&scene.frame.geometry, 1.0);
            let button = ui.add_enabled(has_room && view.is_some(), egui::Button::new("view").small());
            if button.on_hover_text("Cuts away the half that is nearer to you.").clicked() {
                next.planes.extend(view.and_then(|view| middle(&scene.frame, -view.forward)));
            }
        });
        let mut removed = None;
        for (index, plane) in scene.clip.planes.iter().enumerate() {
            if ui.horizontal(|ui| row(ui, scene, (index, plane), &mut next)).inner {
                removed = Some(index);
            }
        }
        removed.map(|index| next.planes.remove(index));
        if !scene.clip.planes.is_empty() {
            let help =
                "Shades cut faces as though nothing lay beyond the plane. Without, what is alike inside has no face.";
            ui.checkbox(&mut next.cap, "shade cut faces").on_hover_text(help);
        }
        if scene.clip.planes.len() > 1 {
            let mut any = scene.clip.keep == Keep::Any;
            let help = "Cuts out the corner alone that lies beyond all planes. Off, what lies beyond any of them goes.";
            ui.checkbox(&mut any, "cut out the corner").on_hover_text(help);
            next.keep = if any { Keep::Any } else { Keep::All };
        }
        if next != scene.clip {
            asked.push(Action::Edit(Edit::Clip(next)));
        }
    });
}

/// The plane through the middle of the box that cuts away what lies in this direction.
fn middle(frame: &Frame, outward: DVec3) -> Option<ClipPlane> {
    Some(ClipPlane::new(frame.middle(), outward)?.with_part(frame, 0.5))
}

/// The row of a plane; true if it is to be removed.
fn row(ui: &mut Ui, scene: &Scene, (index, plane): (usize, &ClipPlane), next: &mut Clip) -> bool {
    let frame = &scene.frame;
    let called = name(index, plane);
    let help = "The plane cuts. Off, it stays here, without an effect.";
    ui.checkbox(&mut next.planes[index].on, &called).on_hover_text(help);
    let mut part = plane.part(frame);
    let before = part;
    let field = number(ui, &mut part, 4, |drag| drag.speed(0.002).range(0.0..=1.0));
    field.widget_info(|| WidgetInfo::slider(true, part, format!("{called}: part that stays")));
    let help = "The part of the box that stays, from 0 to 1, along the direction that goes. Drag, or type.";
    if field.on_hover_text(help).changed() && part.to_bits() != before.to_bits() {
        next.planes[index] = plane.with_part(frame, part);
    }
    if ui.small_button("flip").on_hover_text("Shows the other side.").clicked() {
        next.planes[index].normal = -plane.normal;
    }
    let removed = ui.small_button("remove").on_hover_text("Removes the plane.").clicked();
    if !scene.fields.further().is_empty() {
        cuts(ui, scene, (index, plane), next);
    }
    removed
}

/// The choice of the volumes that a plane cuts.
fn cuts(ui: &mut Ui, scene: &Scene, (index, plane): (usize, &ClipPlane), next: &mut Clip) {
    let names: Vec<String> = scene.fields.iter().map(|field| field.name.clone()).collect();
    let cut = plane.fields.iter().zip(&names).filter(|(cuts, _)| **cuts);
    let cut: Vec<&str> = cut.map(|(_, name)| name.as_str()).collect();
    let called = match &cut[..] {
        _ if plane.cuts_all() => "all".to_owned(),
        [one] => (*one).to_owned(),
        several => format!("{} volumes", several.len()),
    };
    let menu = ui.menu_button(format!("cuts {called}"), |ui| {
        for (field, name) in names.iter().enumerate() {
            let mut cuts = plane.fields[field];
            // A plane that cuts nothing is one that is off.
            let is_last = cut.len() == 1 && cuts;
            if ui.add_enabled(!is_last, egui::Checkbox::new(&mut cuts, name)).changed() {
                let count = names.len();
                let mut fields = plane.fields;
                fields[field] = cuts;
                let is_all = fields[..count].iter().all(|&cuts| cuts);
                fields[count..].fill(is_all);
                next.planes[index].fields = fields;
            }
        }
    });
    menu.response.on_hover_text("The volumes that the plane cuts; the others stay whole.");
}

/// Name of a plane: its number, and the direction that goes.
fn name(index: usize, plane: &ClipPlane) -> String {
    let outward = plane.outward();
    let along = AXES.into_iter().find(|(_, axis)| outward.dot(*axis).abs() > 1.0 - 1e-9);
    let direction = along.map_or_else(
        || "oblique".to_owned(),
        |(name, axis)| format!("{}{name}", if outward.dot(axis) > 0.0 { '+' } else { '−' }),
    );
    format!("plane {} ({direction})", index + 1)
}

/// Asks for plane `index` in another place.
fn ask(asked: &mut Vec<Action>, clip: &Clip, index: usize, plane: ClipPlane) {
    if clip.planes[index] != plane {
        let mut next = clip.clone();
        next.planes[index] = plane;
        asked.push(Action::Edit(Edit::Clip(next)));
    }
}

/// A line that is seen on light and dark.
fn line(painter: &Painter, ends: [Pos2; 2], near: bool) {
    let colour = if near { Color32::YELLOW } else { COLOUR };
    painter.line_segment(ends, Stroke::new(2.5, Color32::from_black_alpha(140)));
    painter.line_segment(ends, Stroke::new(1.0, colour));
}

fn knob(painter: &Painter, at: Pos2, near: bool, is_draggable: bool) {
    let colour = if near { Color32::YELLOW } else { COLOUR };
    let fill = if is_draggable { colour } else { colour.gamma_multiply(0.4) };
    painter.circle(at, HANDLE / 2.0, fill, Stroke::new(1.0, Color32::BLACK));
}

/// Corners of the cut through the box of `frame`, in order around it.
fn outline(frame: &Frame, plane: &ClipPlane) -> Vec<DVec3> {
    let [low, high] = frame.whole_box();
    let corner = |bits: usize| {
        let index = DVec3::from_array(std::array::from_fn(|axis| [low, high][bits >> axis & 1][axis]));
        frame.geometry.world_from_index(index)
    };
    let mut cut = Vec::new();
    for from in 0..8_usize {
        for axis in (0..3).filter(|axis| from >> axis & 1 == 0) {
            let ends = [corner(from), corner(from | 1 << axis)];
            let [one, other] = ends.map(|end| plane.beyond(end));
            if (one > 0.0) != (other > 0.0) {
                cut.push(ends[0].lerp(ends[1], one / (one - other)));
            }
        }
    }
    let centre = cut.iter().sum::<DVec3>() / count(cut.len().max(1));
    let right = plane.outward().any_orthonormal_vector();
    let up = plane.outward().cross(right);
    let angle = |corner: &DVec3| up.dot(*corner - centre).atan2(right.dot(*corner - centre));
    cut.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    cut
}

/// Shows the planes that are on over the picture: the edge of each cut, with a handle in its middle.
pub(super) fn handles(ui: &Ui, shown: &Shown<'_>, rect: Rect, asked: &mut Vec<Action>) {
    let Some(document) = shown.document.filter(|_| shown.loading.is_none()) else { return };
    let scene = &document.state().scene;
    if scene.clip.planes.is_empty() {
        return;
    }
    let geometry = &scene.frame.geometry;
    let aspect = f64::from(rect.width() / rect.height().max(1.0));
    let Some(view) = scene.camera.view(geometry, aspect) else { return };
    let map = Map { view, geometry, rect };
    let painter = ui.painter().with_clip_rect(rect);
    for (index, plane) in scene.clip.planes.iter().enumerate().filter(|(_, plane)| plane.on) {
        // A plane in or beyond a face of the box is shown inside, so that it can be pulled back.
        let part = plane.part(&scene.frame).clamp(1.0 / PARTS, 1.0 - 1.0 / PARTS);
        let corners = outline(&scene.frame, &plane.with_part(&scene.frame, part));
        if corners.len() < 3 {
            continue;
        }
        let middle = corners.iter().sum::<DVec3>() / count(corners.len());
        let Some(at) = map.place(map.world(middle)).filter(|at| rect.contains(*at)) else { continue };
        let [least, most] = scene.frame.extent_along(plane.outward());
        let step = plane.outward() * (most - least) / 100.0;
        // A plane that faces the eye cannot be dragged.
        let along = map.place(map.world(middle + step)).map(|there| there - at);
        let along = along.filter(|along| along.length() > SHORTEST_WAY);
        let called = name(index, plane);
        let hand = ui.interact(
            Rect::from_center_size(at, Vec2::splat(CATCH)),
            ui.id().with(("clip plane", index)),
            Sense::drag(),
        );
        hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, format!("clip {called}")));
        let near = along.is_some() && (hand.hovered() || hand.dragged());
        for (i, corner) in corners.iter().enumerate() {
            let after = corners[(i + 1) % corners.len()];
            if let Some(ends) = map.line(map.world(*corner), map.world(after)) {
                line(&painter, ends, near);
            }
        }
        if let Some(along) = along {
            painter.arrow(at, along.normalized() * 2.5 * HANDLE, Stroke::new(1.5, COLOUR));
        }
        knob(&painter, at, near, along.is_some());
        if let (true, Some(pointer), Some(along)) = (hand.dragged(), hand.interact_pointer_pos(), along) {
            let steps = f64::from((pointer - at).dot(along) / along.length_sq()).clamp(-25.0, 25.0);
            let part = (plane.part(&scene.frame) + steps / 100.0).clamp(0.0, 1.0);
            ask(asked, &scene.clip, index, plane.with_part(&scene.frame, (part * PARTS).round() / PARTS));
        }
        let help = match along {
            Some(_) => "Drag this plane",
            None => "This plane faces you: turn the camera to drag it, or type its number",
        };
        hand.on_hover_text(format!("{help}: {called}, {:.4} of the box stay", plane.part(&scene.frame)));
    }
}

/// Shows where the planes that are on cut a slice through `at`, with a handle on each line.
pub(super) fn in_slice(
    ui: &Ui,
    document: &Document,
    (slice, at, image, cell): (&Plane, DVec3, Rect, Rect),
    asked: &mut Vec<Action>,
) {
    let scene = &document.state().scene;
    let geometry = &scene.frame.geometry;
    let painter = ui.painter().with_clip_rect(cell);
    let on_screen = |place: DVec2| image.min + vec2(narrow(place.x), narrow(place.y)) * image.size();
    let world = |place: DVec2| geometry.world_from_index(slice.index_at(geometry, place, at));
    // Corners of the slice, in order around it.
    let corners = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    for (index, plane) in scene.clip.planes.iter().enumerate().filter(|(_, plane)| plane.on) {
        let mut ends = Vec::new();
        for (i, &corner) in corners.iter().enumerate() {
            let after = corners[(i + 1) % 4];
            let [one, other] = [corner, after].map(|place| plane.beyond(world(place)));
            if (one > 0.0) != (other > 0.0) {
                ends.push(corner.lerp(after, one / (one - other)));
            }
        }
        let &[one, other] = &ends[..] else { continue };
        let middle = on_screen((one + other) / 2.0);
        let called = name(index, plane);
        let caught = Rect::from_center_size(middle, Vec2::splat(CATCH)).intersect(cell);
        let mut near = false;
        if caught.is_positive() {
            let hand = ui.interact(caught, ui.id().with(("clip plane in slice", slice.normal, index)), Sense::drag());
            hand.widget_info(|| {
                WidgetInfo::labeled(WidgetType::Slider, true, format!("clip in {}: {called}", slice.name))
            });
            near = hand.hovered() || hand.dragged();
            if let (true, Some(pointer)) = (hand.dragged(), hand.interact_pointer_pos()) {
                let there = (pointer - image.min) / image.size();
                let place = world(DVec2::new(there.x.into(), there.y.into()));
                let moved = ClipPlane { point: plane.point + plane.outward() * plane.beyond(place), ..*plane };
                let part = moved.part(&scene.frame).clamp(0.0, 1.0);
                ask(asked, &scene.clip, index, plane.with_part(&scene.frame, (part * PARTS).round() / PARTS));
            }
            hand.on_hover_cursor(CursorIcon::Grab).on_hover_text(format!("Drag this plane: {called}"));
        }
        line(&painter, [one, other].map(on_screen), near);
        let away =
            index_from_world(geometry, world((one + other) / 2.0) + plane.outward() * geometry.extent().max_element());
        let away = on_screen(slice.place_of(geometry, away)) - middle;
        if away != Vec2::ZERO {
            painter.arrow(middle, away.normalized() * 2.0 * HANDLE, Stroke::new(1.5, COLOUR));
        }
        painter.rect_stroke(
            Rect::from_center_size(middle, Vec2::splat(HANDLE)),
            0.0,
            Stroke::new(1.0, if near { Color32::YELLOW } else { COLOUR }),
            StrokeKind::Middle,
        );
    }
}
