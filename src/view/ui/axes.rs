//! World axes in a corner of the picture.

use egui::{Align2, Color32, FontId, Rect, Stroke, Ui, vec2};

use glam::DVec3;

use super::spectrum::narrow;
use crate::annotate::PATIENT;
use crate::document::Document;
use crate::document::moves::Side;

/// Length of an axis in points.
const LENGTH: f64 = 20.0;
/// Radius of the drawing in points.
const ROOM: f32 = 32.0;

/// Conventional colours of x, y and z.
pub(super) const COLOURS: [Color32; 3] =
    [Color32::from_rgb(255, 110, 100), Color32::from_rgb(120, 220, 110), Color32::from_rgb(110, 170, 255)];

/// Labels of the negative and positive ends of x, y and z.
const ENDS: [[&str; 2]; 3] = [["", "x"], ["", "y"], ["", "z"]];

/// Name of a side of the volume. In anatomical orientation, +x points to the patient's left.
pub(super) fn side_name(side: Side, anatomical: bool) -> &'static str {
    match (side, anatomical) {
        (Side::Left, false) | (Side::Right, true) => "Left",
        (Side::Right, false) | (Side::Left, true) => "Right",
        (Side::Front, false) => "Front",
        (Side::Back, false) => "Back",
        (Side::Bottom, false) => "Bottom",
        (Side::Top, false) => "Top",
        (Side::Front, true) => "Anterior",
        (Side::Back, true) => "Posterior",
        (Side::Bottom, true) => "Inferior",
        (Side::Top, true) => "Superior",
    }
}

/// Anatomical letter of the side that `outward` is closest to.
pub(super) fn patient_end(outward: DVec3) -> &'static str {
    let axis = outward.abs().max_position();
    PATIENT[axis][usize::from(outward[axis] > 0.0)]
}

/// Draws the axes at the bottom left of the picture in `rect`, with anatomical labels for an anatomical volume.
pub(super) fn show(ui: &Ui, document: &Document, aspect: f64, rect: Rect) {
    let scene = &document.state().scene;
    let Some(view) = scene.camera.view(&scene.frame.geometry, aspect) else { return };
    let middle = rect.left_bottom() + vec2(ROOM + 6.0, -ROOM - 6.0);
    let names = if scene.frame.anatomical { PATIENT } else { ENDS };
    let mut ends: Vec<(f64, DVec3, &str, Color32)> = Vec::new();
    for ((axis, names), colour) in DVec3::AXES.into_iter().zip(names).zip(COLOURS) {
        for (end, name) in [-axis, axis].into_iter().zip(names) {
            if !name.is_empty() {
                ends.push((end.dot(view.forward), end, name, colour));
            }
        }
    }
    // The nearest end last, on top.
    ends.sort_by(|one, other| other.0.total_cmp(&one.0));
    let painter = ui.painter_at(rect);
    painter.circle_filled(middle, ROOM, Color32::from_black_alpha(190));
    for (depth, end, name, colour) in ends {
        let at = vec2(narrow(LENGTH * end.dot(view.right)), narrow(-LENGTH * end.dot(view.up)));
        let colour = if depth > 0.2 { colour.gamma_multiply(0.6) } else { colour };
        painter.line_segment([middle, middle + 0.7 * at], Stroke::new(1.5, colour));
        painter.text(middle + 1.15 * at, Align2::CENTER_CENTER, name, FontId::proportional(11.5), colour);
    }
}
