//! Widgets for spectra and colours.

use egui::{
    Align2, Color32, FontId, Pos2, Rangef, Rect, Response, Sense, Stroke, StrokeKind, Ui, Vec2, WidgetInfo, WidgetType,
    pos2,
};

use crate::number::count;
use crate::scene::Display;
use crate::spectrum::colour::{LinearSrgb, OBSERVER, Xyz, display_code, linear_srgb_from_xyz};
use crate::spectrum::{BANDS, FIRST_NM, LAST_NM, Light, Spectrum, wavelength_nm};

/// Swatch of a light's colour at full brightness, as seen by the observer of `display`. Its name for screen readers is
/// the colour code.
pub(super) fn swatch(ui: &mut Ui, light: &Light, display: &Display, side: f32) -> Response {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(side), Sense::hover());
    let code = paint_swatch(ui, light, 1.0, display, rect);
    response.widget_info(|| WidgetInfo::labeled(WidgetType::ColorButton, true, &code));
    response
}

/// Paints the swatch in `rect` at `share` of full brightness and returns its colour code.
pub(super) fn paint_swatch(ui: &Ui, light: &Light, share: f64, display: &Display, rect: Rect) -> String {
    let LinearSrgb(linear) = linear_srgb_from_xyz(display.observer.xyz_of(light.spectrum()));
    // Full brightness is the brightest displayable colour of this chromaticity.
    let brightest = linear.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let own = LinearSrgb(linear.map(|part| part.max(0.0) / brightest * share.clamp(0.0, 1.0)));
    let code = display_code(display.deficiency.map_or(own, |deficiency| deficiency.seen(own)));
    let colour = Color32::from_hex(&code).unwrap_or(Color32::BLACK);
    let outline = Stroke::new(1.0, ui.visuals().widgets.noninteractive.fg_stroke.color);
    ui.painter().rect(rect, 2.0, colour, outline, StrokeKind::Inside);
    code
}

/// Plots power over wavelength, 380 to 780 nm, scaled to fill `size`.
pub(super) fn curve(ui: &mut Ui, spectrum: &Spectrum, size: Vec2) -> Response {
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    let visuals = ui.visuals();
    ui.painter().rect_filled(rect, 2.0, visuals.extreme_bg_color);
    ui.painter().line(points_of_curve(spectrum, rect), Stroke::new(1.0, visuals.text_color()));
    response
}

/// Points of the curve of `spectrum` over wavelength, 380 to 780 nm, scaled to fill `rect`.
pub(super) fn points_of_curve(spectrum: &Spectrum, rect: Rect) -> Vec<Pos2> {
    let samples = spectrum.samples();
    let most = samples.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let last = count(samples.len().saturating_sub(1).max(1));
    let place = |(index, &sample): (usize, &f64)| -> Pos2 {
        let (x, y) = (narrow(count(index) / last), narrow((sample / most).clamp(0.0, 1.0)));
        pos2(rect.left() + x * rect.width(), rect.bottom() - 1.0 - y * (rect.height() - 2.0))
    };
    samples.iter().enumerate().map(place).collect()
}

/// Plots several spectra over wavelength in one frame, from 0 (or the lowest negative sample) to the highest, above a
/// strip of spectral colours.
pub(super) fn plot(ui: &mut Ui, curves: &[(&Spectrum, Color32)], size: Vec2) -> Response {
    let (frame, response) = ui.allocate_exact_size(size, Sense::hover());
    let (rect, strip) = frame.split_top_bottom_at_y(frame.bottom() - 16.0);
    ui.painter().rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let samples = || curves.iter().flat_map(|(spectrum, _)| spectrum.samples()).copied();
    let low = samples().fold(0.0, f64::min);
    let high = samples().fold(low + f64::MIN_POSITIVE, f64::max);
    let x = |nm: f64| rect.left() + narrow((nm - FIRST_NM) / (LAST_NM - FIRST_NM)) * rect.width();
    let y = |sample: f64| rect.bottom() - 2.0 - narrow((sample - low) / (high - low)) * (rect.height() - 4.0);
    let weak = Stroke::new(1.0, ui.visuals().weak_text_color());
    if low < 0.0 {
        ui.painter().hline(rect.x_range(), y(0.0), Stroke::new(0.5, weak.color));
    }
    for (spectrum, colour) in curves {
        let points =
            spectrum.samples().iter().enumerate().map(|(band, &sample)| pos2(x(wavelength_nm(band)), y(sample)));
        ui.painter().line(points.collect(), Stroke::new(1.5, *colour));
    }
    self::strip(ui, rect.x_range(), strip);
    readable_text(ui, rect.left_top() + Vec2::splat(2.0), Align2::LEFT_TOP, format!("{high:.2}"), 9.0, weak.color);
    response
}

/// Text in a plot, with an outline in the background colour.
pub(super) fn readable_text(ui: &Ui, at: Pos2, align: Align2, text: String, size: f32, colour: Color32) {
    let (font, edge) = (FontId::proportional(size), ui.visuals().extreme_bg_color);
    let around = [(-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0)].map(|(x, y)| Vec2::new(x, y));
    for (away, colour) in around.map(|away| (away, edge)).into_iter().chain([(Vec2::ZERO, colour)]) {
        ui.painter().text(at + away, align, &text, font.clone(), colour);
    }
}

/// Strip of spectral colours with wavelength labels, below a curve that spans `across`.
pub(super) fn strip(ui: &Ui, across: Rangef, rect: Rect) {
    let x = |nm: f64| across.min + narrow((nm - FIRST_NM) / (LAST_NM - FIRST_NM)) * across.span();
    for band in 0..BANDS - 1 {
        let [from, to] = [band, band + 1].map(|band| x(wavelength_nm(band)));
        let part = Rect::from_x_y_ranges(from..=to, rect.top() + 1.0..=rect.top() + 4.0);
        ui.painter().rect_filled(part, 0.0, of_wavelength(band));
    }
    for nm in [400.0, 500.0, 600.0, 700.0] {
        let (at, font) = (pos2(x(nm), rect.bottom()), FontId::proportional(9.0));
        ui.painter().text(at, Align2::CENTER_BOTTOM, format!("{nm} nm"), font, ui.visuals().weak_text_color());
    }
}

/// Approximate display colour of one wavelength band.
fn of_wavelength(band: usize) -> Color32 {
    let xyz = OBSERVER.each_ref().map(|matching| matching.samples()[band]);
    let LinearSrgb(linear) = linear_srgb_from_xyz(Xyz(xyz));
    // Adds white until no component is negative, and scales to the approximate perceived brightness.
    let white = linear.iter().copied().fold(0.0, f64::min);
    let most = linear.iter().copied().fold(f64::MIN_POSITIVE, f64::max) - white;
    let seen =
        (xyz.iter().sum::<f64>() / OBSERVER[1].samples().iter().copied().fold(f64::MIN_POSITIVE, f64::max)).min(1.0);
    let code = display_code(LinearSrgb(linear.map(|part| (part - white) / most * seen)));
    Color32::from_hex(&code).unwrap_or(Color32::BLACK)
}

/// Formats a colour as `#rrggbb`.
pub(super) fn code(colour: Color32) -> String {
    let [red, green, blue, _] = colour.to_array();
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// Square of a display colour, named by its code for screen readers.
pub(super) fn patch(ui: &mut Ui, code: &str, side: f32) -> Response {
    let (rect, response) = ui.allocate_exact_size(Vec2::splat(side), Sense::hover());
    let colour = Color32::from_hex(code).unwrap_or(Color32::BLACK);
    let outline = Stroke::new(1.0, ui.visuals().widgets.noninteractive.fg_stroke.color);
    ui.painter().rect(rect, 2.0, colour, outline, StrokeKind::Inside);
    response.widget_info(|| WidgetInfo::labeled(WidgetType::ColorButton, true, code));
    response
}

/// Converts to f32 for screen coordinates.
#[expect(clippy::cast_possible_truncation, reason = "pixels need no more")]
pub(super) fn narrow(number: f64) -> f32 {
    number as f32
}
