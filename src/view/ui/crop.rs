//! Crop box: the part of the volume that is shown, set by numbers and by handles on the picture.

use egui::{
    Align2, Color32, CursorIcon, FontId, Id, Pos2, Rect, Sense, Stroke, Ui, Vec2, WidgetInfo, WidgetType, vec2,
};
use glam::{DVec2, DVec3};

use super::Shown;
use super::axes::{COLOURS, patient_end};
use super::controls::{number, panel, say_beside};
use super::spectrum::narrow;
use crate::document::moves::{Move, Side};
use crate::document::{Document, Edit, THINNEST};
use crate::number::count;
use crate::plan::Stale;
use crate::scene::View;
use crate::view::action::Action;
use crate::view::slices::Plane;
use crate::volume::Geometry;

/// Size of a handle and of its grab area in points.
const HANDLE: f32 = 9.0;
const CATCH: f32 = 22.0;
/// Minimum length in points of 1 % of the volume on the screen for a handle to be draggable.
const SHORTEST_WAY: f32 = 0.6;
/// Thickness in points below which the volume counts as invisible.
const THINNEST_SEEN: f32 = 2.0;
/// Steps per volume length of a dragged handle.
const PARTS: f64 = 1e4;
/// Half the width in points of the grab area of a side in a slice.
const SIDE: f32 = 4.0;
const AXES: [&str; 3] = ["x", "y", "z"];

/// Text of a fraction of the volume along an axis, with its voxel index.
fn part_text(document: &Document, axis: usize, part: f64) -> String {
    let last = count(document.state().scene.frame.geometry.dims[axis]) - 1.0;
    format!("{part:.4} of the volume, voxel {:.1} of 0 to {last}", part * last)
}

/// Anatomical side at an end of a volume axis, after a space; empty if the file has no anatomical orientation.
fn side(document: &Document, axis: usize, end: usize) -> String {
    let volume = document.state().scene.volume();
    let outward = volume.geometry.direction.col(axis) * [-1.0, 1.0][end];
    if volume.anatomical { format!(" {}", patient_end(outward)) } else { String::new() }
}

fn hidden() -> Id {
    Id::new("crop box is hidden")
}

fn kept() -> Id {
    Id::new("crop box that is off")
}

/// Shows the crop panel.
pub(super) fn show(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    panel(ui, "Crop box", Stale::Accumulators, |ui| {
        let crop = document.state().crop();
        ui.horizontal(|ui| {
            let mut on = crop.is_some();
            let switch = ui.checkbox(&mut on, "crop").on_hover_text("Shows only the part of the volume in a box.");
            if switch.changed() {
                let last = ui.data(|data| data.get_temp::<[DVec3; 2]>(kept()));
                asked.push(Action::Edit(Edit::Crop(on.then(|| last.unwrap_or([DVec3::ZERO, DVec3::ONE])))));
                ui.data_mut(|data| crop.map(|crop| data.insert_temp(kept(), crop)));
            }
            let mut shown = !ui.data(|data| data.get_temp(hidden())).unwrap_or(false);
            let help = "Shows the edges of the box, with a handle to drag on each side.";
            if ui.add_enabled(on, egui::Checkbox::new(&mut shown, "box")).on_hover_text(help).changed() {
                ui.data_mut(|data| data.insert_temp(hidden(), !shown));
            }
            // Without a crop box in the scene, a reset selects the whole volume; only the tick removes the box.
            let all = [DVec3::ZERO, DVec3::ONE];
            let opened = document.opened().scene.crop;
            let (changed, reset) = match opened {
                Some(_) => (document.state().scene.crop != opened, Edit::ResetCrop),
                None => (crop.is_some_and(|crop| crop != all), Edit::Crop(Some(all))),
            };
            let button = ui.add_enabled(changed, egui::Button::new("Reset crop").small());
            if button.on_hover_text("The crop box of the scene, or the whole volume.").clicked() {
                asked.push(Action::Edit(reset));
            }
        });
        let Some(now) = crop else { return };
        for (axis, name) in AXES.into_iter().enumerate() {
            ui.horizontal(|ui| {
                ui.label(format!("{name}{}", [0, 1].map(|end| side(document, axis, end)).join("")));
                let mut next = now;
                for (end, word) in ["from", "to"].into_iter().enumerate() {
                    ui.label(word);
                    let value = &mut next[end][axis];
                    let dragged = number(ui, value, 4, |drag| drag.speed(0.002).range(0.0..=1.0));
                    let value = *value;
                    let other = now[1 - end][axis];
                    if dragged.changed() && !dragged.dragged() && if end == 0 { value > other } else { value < other } {
                        let word = ["to", "from"][end];
                        say_beside(&dragged, format!("The limit is “{word}”, which is {other:.4}: move that first."));
                    }
                    let dragged = dragged.on_hover_ui(|ui| {
                        ui.label(format!(
                            "{}. Drag, or type a fraction from 0 to 1.",
                            part_text(document, axis, value)
                        ));
                    });
                    dragged.widget_info(|| WidgetInfo::slider(true, value, format!("crop {name}: {word}")));
                }
                if next != now {
                    asked.push(Action::Edit(Edit::Crop(Some(ordered(next, now)))));
                }
            });
        }
    });
}

/// Limits a changed side so that it stops before the opposite side, which stays.
fn ordered([low, high]: [DVec3; 2], now: [DVec3; 2]) -> [DVec3; 2] {
    [
        DVec3::select(low.cmpne(now[0]), low.min(high - THINNEST).max(DVec3::ZERO), low),
        DVec3::select(high.cmpne(now[1]), high.max(low + THINNEST).min(DVec3::ONE), high),
    ]
}

/// Mapping from fractions of the volume to the picture.
pub(super) struct Map<'a> {
    pub(super) view: View,
    pub(super) geometry: &'a Geometry,
    pub(super) rect: Rect,
}

impl Map<'_> {
    /// View coordinates of a point of the volume ([`View::seen`]).
    fn seen(&self, parts: DVec3) -> DVec3 {
        let last = DVec3::from_array(self.geometry.dims.map(count)) - 1.0;
        // An axis of one voxel has the thickness of one voxel.
        let index = DVec3::select(last.cmpgt(DVec3::ZERO), parts * last, parts - 0.5);
        self.world(self.geometry.world_from_index(index))
    }

    /// View coordinates of a point of the world.
    pub(super) fn world(&self, point: DVec3) -> DVec3 {
        self.view.seen(point)
    }

    /// Screen position of view coordinates; `None` behind the eye, or if a picture of a few pixels gives no finite
    /// number.
    pub(super) fn place(&self, seen: DVec3) -> Option<Pos2> {
        let by = if self.view.parallel { 1.0 } else { seen.z };
        if by <= 1e-6 {
            return None;
        }
        let half = self.rect.size() / 2.0;
        let place = self.rect.center() + vec2(narrow(seen.x / by) * half.x, -narrow(seen.y / by) * half.y);
        place.is_finite().then_some(place)
    }

    fn edge(&self, from: DVec3, to: DVec3) -> Option<[Pos2; 2]> {
        self.line(self.seen(from), self.seen(to))
    }

    /// The line between two view coordinates.
    pub(super) fn line(&self, mut from: DVec3, mut to: DVec3) -> Option<[Pos2; 2]> {
        // Clips the part behind the eye.
        let near = 1e-3 * (from - to).length();
        if !self.view.parallel {
            if from.z < near && to.z > near {
                from = from.lerp(to, (near - from.z) / (to.z - from.z));
            } else if to.z < near && from.z > near {
                to = to.lerp(from, (near - to.z) / (from.z - to.z));
            }
        }
        Some([self.place(from)?, self.place(to)?])
    }
}

/// Returns why the volume is not visible in the picture `rect`, and a remedy: it lies outside the picture, is too far
/// away, or its cropped part is seen edge-on.
pub(super) fn out_of_sight(document: &Document, aspect: f64, rect: Rect) -> Option<(&'static str, &'static str, Move)> {
    let scene = &document.state().scene;
    let geometry = &scene.frame.geometry;
    let map = Map { view: scene.camera.view(geometry, aspect)?, geometry, rect };
    let shown = document.state().crop().unwrap_or([DVec3::ZERO, DVec3::ONE]);
    let corners = (0..8_usize).map(|bits| DVec3::from_array(std::array::from_fn(|axis| shown[bits >> axis & 1][axis])));
    let places: Vec<Option<Pos2>> = corners.map(|corner| map.place(map.seen(corner))).collect();
    let corners: Vec<Pos2> = places.iter().copied().flatten().collect();
    let around = Rect::from_points(&corners);
    // If only some corners are behind the eye, the eye is in or close to the volume.
    let is_beside = corners.len() == places.len() && !around.intersects(rect);
    if corners.is_empty() || is_beside {
        return Some(("The volume is outside the picture.", "Reset the camera", Move::Reset));
    }
    if corners.len() < places.len() {
        return None;
    }
    if around.size().max_elem() < THINNEST_SEEN {
        return Some(("The volume is too far away to be visible.", "Reset the camera", Move::Reset));
    }
    let spread = |normal: Vec2| {
        let along = || corners.iter().map(|corner| corner.to_vec2().dot(normal));
        along().fold(f32::NEG_INFINITY, f32::max) - along().fold(f32::INFINITY, f32::min)
    };
    // The minimum width of a convex shape is perpendicular to one of its edges.
    let edges = corners.iter().flat_map(|one| corners.iter().map(move |other| (*other - *one).normalized().rot90()));
    let thickness = edges.filter(|normal| *normal != Vec2::ZERO).map(spread).fold(f32::INFINITY, f32::min);
    let thin = (geometry.extent() * (shown[1] - shown[0])).min_position();
    let outward = geometry.direction.col(thin);
    let face =
        Side::ALL.into_iter().max_by(|one, other| outward.dot(one.outward()).total_cmp(&outward.dot(other.outward())));
    let told = ("The visible part is a thin sheet, seen edge-on.", "Look at its face", Move::Axis(face?));
    (thickness < THINNEST_SEEN).then_some(told)
}

/// Returns a message if the crop box is thinner than a ray step, and an edit that shows the whole axis. A crop box of
/// the scene itself is taken as intended.
pub(super) fn thin_crop(document: &Document) -> Option<(String, Edit)> {
    /// Fraction of an axis below which the box counts as thin, however few slices the axis has.
    const SLICE: f64 = 0.1;
    let (crop, scene) = (document.state().crop()?, &document.state().scene);
    if scene.crop == document.opened().scene.crop {
        return None;
    }
    let geometry = &scene.frame.geometry;
    let parts = crop[1] - crop[0];
    let lengths = parts * geometry.spacing * (DVec3::from_array(geometry.dims.map(count)) - 1.0);
    let is_thin =
        |axis: &usize| geometry.dims[*axis] > 1 && parts[*axis] < SLICE && lengths[*axis] < scene.accuracy.step_length;
    let axis = (0..3).find(is_thin)?;
    let text = format!("Along {}, the crop box is thinner than one step, so little is visible.", AXES[axis]);
    let mut whole = crop;
    (whole[0][axis], whole[1][axis]) = (0.0, 1.0);
    Some((text, Edit::Crop(Some(whole))))
}

/// Shows the box in a slice, whose sides can be dragged; faint if the slice at the crosshair `at` lies outside the box.
pub(super) fn in_slice(
    ui: &Ui,
    document: &Document,
    (plane, at, image, cell): (&Plane, DVec3, Rect, Rect),
    asked: &mut Vec<Action>,
) {
    let state = document.state();
    let (Some(crop), false) = (state.crop(), ui.data(|data| data.get_temp(hidden())).unwrap_or(false)) else { return };
    let geometry = &state.scene.frame.geometry;
    let last = DVec3::from_array(geometry.dims.map(count)) - 1.0;
    let place = |parts: DVec3| {
        let place = plane.place_of(geometry, parts * last);
        image.min + vec2(narrow(place.x), narrow(place.y)) * image.size()
    };
    let shown = Rect::from_two_pos(place(crop[0]), place(crop[1]));
    let across = plane.normal;
    let inside = (crop[0] * last)[across] - 0.5 <= at[across] && at[across] <= (crop[1] * last)[across] + 0.5;
    let painter = ui.painter().with_clip_rect(cell);
    let colour = if inside { Color32::WHITE } else { Color32::from_gray(110) };
    painter.rect_stroke(shown, 0.0, Stroke::new(2.5, Color32::from_black_alpha(140)), egui::StrokeKind::Middle);
    painter.rect_stroke(shown, 0.0, Stroke::new(1.0, colour), egui::StrokeKind::Middle);
    for ((axis, ascends), along) in [(plane.right, 0), (plane.down, 1)] {
        if geometry.dims[axis] < 2 {
            continue;
        }
        for end in 0..2 {
            // The low end lies at the left and at the top if indices ascend there.
            let first = (end == 0) == ascends;
            let caught = match (along, first) {
                (0, true) => Rect::from_x_y_ranges(shown.left()..=shown.left(), shown.y_range()),
                (0, false) => Rect::from_x_y_ranges(shown.right()..=shown.right(), shown.y_range()),
                (_, true) => Rect::from_x_y_ranges(shown.x_range(), shown.top()..=shown.top()),
                (_, false) => Rect::from_x_y_ranges(shown.x_range(), shown.bottom()..=shown.bottom()),
            };
            let caught = caught.expand(SIDE).intersect(cell);
            if !caught.is_positive() {
                continue;
            }
            let hand = ui.interact(caught, ui.id().with(("crop in slice", across, axis, end)), Sense::drag());
            let (name, word) = (AXES[axis], ["from", "to"][end]);
            let label = format!("crop in {}: {name} {word}", plane.name);
            hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, label.clone()));
            if let (true, Some(pointer)) = (hand.dragged(), hand.interact_pointer_pos()) {
                let there = (pointer - image.min) / image.size();
                let there = plane.index_at(geometry, DVec2::new(there.x.into(), there.y.into()), at);
                let mut next = crop;
                next[end][axis] = ((there / last)[axis].clamp(0.0, 1.0) * PARTS).round() / PARTS;
                if next != crop {
                    asked.push(Action::Edit(Edit::Crop(Some(ordered(next, crop)))));
                }
            }
            if hand.hovered() || hand.dragged() {
                painter.rect_stroke(
                    caught.shrink(SIDE),
                    0.0,
                    Stroke::new(2.0, Color32::YELLOW),
                    egui::StrokeKind::Middle,
                );
            }
            hand.on_hover_cursor(if along == 0 { CursorIcon::ResizeHorizontal } else { CursorIcon::ResizeVertical });
        }
    }
}

/// Shows the box over the picture with a handle on each side.
pub(super) fn handles(ui: &Ui, shown: &Shown<'_>, rect: Rect, asked: &mut Vec<Action>) {
    let Some(document) = shown.document.filter(|_| shown.loading.is_none()) else { return };
    let state = document.state();
    let (Some(crop), false) = (state.crop(), ui.data(|data| data.get_temp(hidden())).unwrap_or(false)) else { return };
    let geometry = &state.scene.frame.geometry;
    let aspect = f64::from(rect.width() / rect.height().max(1.0));
    let Some(view) = state.scene.camera.view(geometry, aspect) else { return };
    let map = Map { view, geometry, rect };
    let painter = ui.painter().with_clip_rect(rect);
    let corner = |bits: usize| DVec3::from_array(std::array::from_fn(|axis| crop[bits >> axis & 1][axis]));
    for from in 0..8_usize {
        for axis in (0..3).filter(|axis| from >> axis & 1 == 0) {
            if let Some(edge) = map.edge(corner(from), corner(from | 1 << axis)) {
                // Two lines, visible on light and dark backgrounds.
                painter.line_segment(edge, Stroke::new(2.5, Color32::from_black_alpha(140)));
                painter.line_segment(edge, Stroke::new(1.0, Color32::WHITE));
            }
        }
    }
    let mut sides: Vec<_> = (0..6_usize)
        .filter_map(|side| {
            let (axis, end) = (side / 2, side % 2);
            let (mut middle, mut step) = ((crop[0] + crop[1]) / 2.0, DVec3::ZERO);
            (middle[axis], step[axis]) = (crop[end][axis], 0.01);
            let seen = map.seen(middle);
            let at = map.place(seen).filter(|at| rect.contains(*at))?;
            // A side that faces the eye cannot be dragged.
            let along = map.place(map.seen(middle + step)).map(|there| there - at);
            let along = along.filter(|along| along.length() > SHORTEST_WAY);
            Some((axis, end, at, along, seen.z))
        })
        .collect();
    // Of overlapping handles the topmost takes the pointer: a draggable one, and of those the nearest.
    sides.sort_by(|(.., one, near), (.., other, far)| one.is_some().cmp(&other.is_some()).then(far.total_cmp(near)));
    for (axis, end, at, along, _) in sides {
        let (name, word) = (AXES[axis], ["from", "to"][end]);
        let caught = Rect::from_center_size(at, Vec2::splat(CATCH));
        let hand = ui.interact(caught, ui.id().with(("crop", axis, end)), Sense::drag());
        hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, format!("crop box: {name} {word}")));
        let near = along.is_some() && (hand.hovered() || hand.dragged());
        let fill = match along {
            None => COLOURS[axis].gamma_multiply(0.4),
            Some(_) if near => Color32::YELLOW,
            Some(_) => COLOURS[axis],
        };
        painter.rect(
            Rect::from_center_size(at, Vec2::splat(HANDLE)),
            2.0,
            fill,
            Stroke::new(1.0, Color32::BLACK),
            egui::StrokeKind::Outside,
        );
        // Direction of the handle, labelled like the axes in the corner.
        let sign = if end == 0 { '−' } else { '+' };
        let (beside, font) = (at + vec2(HANDLE, 0.0), FontId::proportional(11.5));
        for (away, colour) in [(vec2(1.0, 1.0), Color32::BLACK), (Vec2::ZERO, fill)] {
            let text = format!("{sign}{name}{}", side(document, axis, end));
            painter.text(beside + away, Align2::LEFT_CENTER, text, font.clone(), colour);
        }
        if let (true, Some(pointer), Some(along)) = (hand.dragged(), hand.interact_pointer_pos(), along) {
            let steps = f64::from((pointer - at).dot(along) / along.length_sq());
            let part = crop[end][axis] + 0.01 * steps.clamp(-25.0, 25.0);
            let mut next = crop;
            next[end][axis] = (part.clamp(0.0, 1.0) * PARTS).round() / PARTS;
            if next != crop {
                asked.push(Action::Edit(Edit::Crop(Some(ordered(next, crop)))));
            }
        }
        hand.on_hover_ui(|ui| {
            let help = match along {
                Some(_) => "Drag this side of the box",
                None => "This side of the box faces you: turn the camera to drag it, or type its number",
            };
            ui.label(format!("{help}: {name} {word} {}", part_text(document, axis, crop[end][axis])));
        });
    }
}
