//! Spectra as small curves, and lights as swatches.

use egui::{Color32, Pos2, Rect, Response, Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo, WidgetType, pos2};

use crate::number::count;
use crate::spectrum::colour::{LinearSrgb, display_code, linear_srgb_from_xyz, xyz_of};
use crate::spectrum::{Light, Spectrum};

/// The colour of a light that shines `share` times as strongly as stated, and its name to screen readers.
pub(super) fn swatch(ui: &mut Ui, light: &Light, share: f64, side: f32) -> Response {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(side), Sense::hover());
    let code = paint_swatch(ui, light, share, rect);
    response.widget_info(|| WidgetInfo::labeled(WidgetType::ColorButton, true, &code));
    response
}

/// Paints it in `rect`, and says its colour.
pub(super) fn paint_swatch(ui: &Ui, light: &Light, share: f64, rect: Rect) -> String {
    let LinearSrgb(linear) = linear_srgb_from_xyz(xyz_of(light.spectrum()));
    // Full strength is the brightest that its colour can be on a screen.
    let brightest = linear.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let code = display_code(LinearSrgb(linear.map(|part| part.max(0.0) / brightest * share.clamp(0.0, 1.0))));
    let colour = Color32::from_hex(&code).unwrap_or(Color32::BLACK);
    let outline = Stroke::new(1.0, ui.visuals().widgets.noninteractive.fg_stroke.color);
    ui.painter().rect(rect, 2.0, colour, outline, StrokeKind::Inside);
    code
}

/// Power over wavelength, from 380 to 780 nm, scaled to fill `size`.
pub(super) fn curve(ui: &mut Ui, spectrum: &Spectrum, size: Vec2) -> Response {
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let samples = spectrum.samples();
    let most = samples.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let last = count(samples.len().saturating_sub(1).max(1));
    let place = |(index, &sample): (usize, &f64)| -> Pos2 {
        let (x, y) = (narrow(count(index) / last), narrow((sample / most).clamp(0.0, 1.0)));
        pos2(rect.left() + x * rect.width(), rect.bottom() - 1.0 - y * (rect.height() - 2.0))
    };
    let points: Vec<Pos2> = samples.iter().enumerate().map(place).collect();
    let visuals = ui.visuals();
    ui.painter().rect_filled(rect, 2.0, visuals.extreme_bg_color);
    ui.painter().line(points, Stroke::new(1.0, visuals.text_color()));
    response
}

/// A place on the screen.
#[expect(clippy::cast_possible_truncation, reason = "pixels need no more")]
pub(super) fn narrow(number: f64) -> f32 {
    number as f32
}
