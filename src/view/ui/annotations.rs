//! Annotations over a picture or a slice: scale bar, orientation letters, title, legend and measuring line. Saved pictures have
//! none of them.

use egui::{
    Align2, Color32, FontId, Id, Painter, Pos2, Rect, Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo, WidgetType, vec2,
};
use glam::DVec3;

use super::Shown;
use super::spectrum::{narrow, points_of_curve};
use crate::annotate::{Edges, Entry, PixelLength, ScaleBar, in_unit, pixel_length};
use crate::document::Document;
use crate::number::{count, whole};
use crate::scene::View;
use crate::spectrum::colour::display_code;
use crate::view::layout::Note;
use crate::volume::Unit;

/// Longest scale bar, as a fraction of the width of the picture, and in points.
const LONGEST: f32 = 0.3;
const MOST: f32 = 240.0;
/// Smallest picture in points that has annotations.
const LEAST: f32 = 100.0;

/// Text with a dark outline, readable over any picture.
pub(super) fn text(painter: &Painter, at: Pos2, align: Align2, text: &str, size: f32, colour: Color32) {
    for (x, y) in [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, 1.0)] {
        painter.text(at + vec2(x, y), align, text, FontId::proportional(size), Color32::from_black_alpha(200));
    }
    painter.text(at, align, text, FontId::proportional(size), colour);
}

/// Draws a scale bar that ends at the bottom right of `rect`, where a point has the length of `point`.
pub(super) fn scale_bar(painter: &Painter, rect: Rect, point: PixelLength, unit: Option<Unit>) {
    if rect.size().min_elem() < LEAST {
        return;
    }
    let most = (LONGEST * rect.width()).min(MOST);
    let Some(bar) = ScaleBar::new(point, f64::from(most), unit) else { return };
    let right = rect.right_bottom() - vec2(12.0, 10.0);
    let left = right - vec2(narrow(bar.pixels), 0.0);
    let ticks = [left, right].map(|end| [end - vec2(0.0, 6.0), end]);
    for (width, colour) in [(4.0, Color32::from_black_alpha(200)), (1.5, Color32::WHITE)] {
        for line in ticks.into_iter().chain([[left, right]]) {
            painter.line_segment(line, Stroke::new(width, colour));
        }
    }
    // Beside the bar, so that a long text stays in the picture.
    text(painter, right - vec2(0.0, 8.0), Align2::RIGHT_BOTTOM, &bar.text, 11.5, Color32::WHITE);
}

/// Writes the letters at the edges of `rect`.
pub(super) fn letters(painter: &Painter, rect: Rect, edges: &Edges) {
    if rect.size().min_elem() < LEAST {
        return;
    }
    let inner = rect.shrink(5.0);
    for (at, align, letters) in [
        (inner.left_center(), Align2::LEFT_CENTER, &edges.left),
        (inner.right_center(), Align2::RIGHT_CENTER, &edges.right),
        (inner.center_top(), Align2::CENTER_TOP, &edges.top),
        (inner.center_bottom(), Align2::CENTER_BOTTOM, &edges.bottom),
    ] {
        text(painter, at, align, letters, 13.0, Color32::from_rgb(255, 220, 120));
    }
}

/// Draws a measuring line between two ends, as far as they are known, with its length; faint unless `clear`.
pub(super) fn line(painter: &Painter, ends: [Option<Pos2>; 2], length: Option<(f64, Option<Unit>)>, clear: bool) {
    let colour = Color32::from_rgb(255, 240, 90).gamma_multiply(if clear { 1.0 } else { 0.4 });
    if let [Some(from), Some(to)] = ends {
        painter.line_segment([from, to], Stroke::new(3.5, Color32::from_black_alpha(160)));
        painter.line_segment([from, to], Stroke::new(1.5, colour));
    }
    for end in ends.into_iter().flatten() {
        painter.circle(end, 3.5, colour, Stroke::new(1.0, Color32::from_black_alpha(200)));
    }
    if let ([Some(from), Some(to)], Some((length, unit)), true) = (ends, length, clear) {
        // Four digits: the ends are set to a pixel.
        let digits: f64 = format!("{length:.3e}").parse().unwrap_or(length);
        let at = from.lerp(to, 0.5) - vec2(0.0, 6.0);
        text(painter, at, Align2::CENTER_BOTTOM, &in_unit(digits, unit), 13.0, colour);
    }
}

/// Point of the screen at which `view` shows a world point in the picture in `rect`; `None` behind the eye.
pub(super) fn screen(view: &View, rect: Rect, world: DVec3) -> Option<Pos2> {
    let place = view.place_of(world)?;
    let at = rect.min + vec2(narrow(place.x), narrow(place.y)) * rect.size();
    Some(at).filter(|at| at.is_finite())
}

/// Annotates the picture in `rect`.
pub(super) fn show(ui: &Ui, shown: &Shown<'_>, rect: Rect) {
    let (Some(document), None) = (shown.document, shown.loading) else { return };
    let (scene, layout, painter) = (&document.state().scene, shown.layout, ui.painter_at(rect));
    let frame = &scene.frame;
    let size = [f64::from(rect.width()), f64::from(rect.height().max(1.0))];
    let Some(view) = scene.camera.view(&frame.geometry, shown.aspect) else { return };
    if shown.panels && layout.has(Note::Letters) && frame.anatomical {
        letters(&painter, rect, &Edges::of(&view));
    }
    if let (true, Some(point)) =
        (shown.panels && layout.has(Note::Scale), pixel_length(&scene.camera, &frame.geometry, size))
    {
        scale_bar(&painter, rect, point, frame.unit);
    }
    if layout.has(Note::Title) {
        let title = shown.title.trim_end_matches(" — Relume");
        let at = rect.center_top() + vec2(0.0, if shown.panels { 8.0 } else { 30.0 });
        text(&painter, at, Align2::CENTER_TOP, title, 17.0, Color32::WHITE);
    }
    if layout.has(Note::Legend) {
        let below = if shown.panels { 8.0 } else { 34.0 };
        legend(ui, document, rect.min + vec2(8.0, below), &painter);
    }
    let ruler = layout.ruler;
    let ends = ruler.ends.map(|end| screen(&view, rect, end?));
    line(&painter, ends, ruler.length().map(|length| (length, frame.unit)), true);
    if ruler.on {
        let told = match ruler.ends {
            [Some(_), None] => "Click the other end of the line",
            _ => "Click an end of the line (M: no more measuring)",
        };
        text(&painter, rect.center_top() + vec2(0.0, 34.0), Align2::CENTER_TOP, told, 12.5, Color32::WHITE);
    }
}

/// Names, colours and spectra of the visible materials under the current light, and of the lights that are on.
fn legend(ui: &Ui, document: &Document, at: Pos2, painter: &Painter) {
    const LINE: f32 = 17.0;
    const GAP: f32 = 6.0;
    /// Left edges of the spectrum and of the name.
    const CURVE: f32 = 18.0;
    const NAME: f32 = 56.0;
    let state = document.state();
    let scene = &state.scene;
    let visible: Vec<usize> =
        (0..scene.materials.len()).filter(|&index| scene.shows(index) || scene.absorbs(index)).collect();
    let mut materials = Entry::of_labels_and_materials(scene, &visible, &state.mix_of_swatches());
    let lights = Entry::of_lights(&state.mix(), &scene.display);
    if materials.is_empty() && lights.is_empty() {
        return;
    }
    // Many labels have no room.
    let room =
        whole(f64::from((painter.clip_rect().bottom() - at.y - 80.0) / LINE)).saturating_sub(lights.len() + 1).max(3);
    if let left @ 1.. = materials.len().saturating_sub(room) {
        materials.truncate(room);
        if let Some(last) = materials.last_mut() {
            *last = Entry { name: format!("and {} more", left + 1), ..last.clone() };
        }
    }
    let gap = if materials.is_empty() || lights.is_empty() { 0.0 } else { GAP };
    let rows: Vec<(f32, &Entry)> = materials
        .iter()
        .map(|entry| (0.0, entry))
        .chain(lights.iter().map(|entry| (gap, entry)))
        .enumerate()
        .map(|(row, (gap, entry))| (narrow(count(row)).mul_add(LINE, gap), entry))
        .collect();
    let name = |entry: &Entry| painter.layout_no_wrap(entry.name.clone(), FontId::proportional(12.5), Color32::WHITE);
    let galleys: Vec<_> = rows.iter().map(|(_, entry)| name(entry)).collect();
    let width = galleys.iter().map(|galley| galley.size().x).fold(0.0, f32::max);
    let height = narrow(count(rows.len())).mul_add(LINE, gap);
    let frame = Rect::from_min_size(at, vec2(width + NAME + 14.0, height + 8.0));
    painter.rect_filled(frame, 3.0, Color32::from_black_alpha(170));
    for ((below, entry), galley) in rows.into_iter().zip(galleys) {
        let corner = at + vec2(8.0, 4.0 + below);
        let swatch = Rect::from_min_size(corner + vec2(0.0, 2.0), Vec2::splat(12.0));
        let colour = Color32::from_hex(&display_code(entry.colour)).unwrap_or(Color32::GRAY);
        painter.rect(swatch, 2.0, colour, Stroke::new(1.0, Color32::from_gray(150)), StrokeKind::Inside);
        let curve = Rect::from_min_size(corner + vec2(CURVE, 2.0), vec2(NAME - CURVE - 6.0, 12.0));
        painter.line(points_of_curve(&entry.spectrum, curve), Stroke::new(1.0, Color32::from_gray(220)));
        painter.galley(corner + vec2(NAME, 0.5), galley, Color32::WHITE);
    }
    let response = ui.interact(frame, Id::new("legend"), Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(WidgetType::Image, true, "legend"));
}
