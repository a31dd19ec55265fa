//! The axis of values that graphs of the transfer function share, and the interval that is chosen in them.

use egui::{Id, Rect, Sense, Ui, WidgetInfo, WidgetType, vec2};

use super::spectrum::narrow;
use crate::number::whole;
use crate::scene::Interval;
use crate::volume::Statistics;

/// Size of a handle in points.
pub(super) const HANDLE: f32 = 9.0;
/// Drag steps over the value range.
const PARTS: f64 = 1000.0;

/// Mapping between values and opacities, and screen coordinates.
pub(super) struct Map {
    pub(super) rect: Rect,
    pub(super) low: f64,
    pub(super) span: f64,
}

impl Map {
    pub(super) fn new(ui: &mut Ui, statistics: &Statistics, height: f32) -> Self {
        let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), height), Sense::hover());
        response.widget_info(|| WidgetInfo::labeled(WidgetType::Image, true, "histogram and intervals"));
        let span = statistics.max - statistics.min;
        let span = if span > 0.0 && span.is_finite() { span } else { 1.0 };
        Self { rect: rect.shrink(HANDLE / 2.0), low: statistics.min, span }
    }

    pub(super) fn x(&self, value: f64) -> f32 {
        self.rect.left() + narrow((value - self.low) / self.span).clamp(-1.0, 2.0) * self.rect.width()
    }

    pub(super) fn y(&self, opacity: f64) -> f32 {
        self.rect.bottom() - narrow(opacity.clamp(0.0, 1.0).sqrt()) * self.rect.height()
    }

    pub(super) fn value(&self, x: f32) -> f64 {
        let part = f64::from((x - self.rect.left()) / self.rect.width().max(1.0));
        snapped(self.low + part.clamp(0.0, 1.0) * self.span, self.span)
    }

    pub(super) fn opacity(&self, y: f32) -> f64 {
        let part = f64::from((self.rect.bottom() - y) / self.rect.height().max(1.0)).clamp(0.0, 1.0);
        (part * part * 1000.0).round() / 1000.0
    }
}

/// Rounds `value` to the precision of a drag over a range of `span`.
pub(super) fn snapped(value: f64, span: f64) -> f64 {
    let step = 10.0_f64.powf((span / PARTS).log10().floor());
    // Parsed from text, to be exactly the short decimal that files and fields show.
    let places = usize::try_from(places(span).min(400)).unwrap_or(0);
    format!("{:.places$}", (value / step).round() * step).parse().unwrap_or(value)
}

/// Decimals that resolve a thousandth of `span`; negative for tens, hundreds and so on.
pub(super) fn places(span: f64) -> i32 {
    let digits = (span / PARTS).log10().floor();
    let decimals = i32::try_from(whole(digits.abs().min(400.0))).unwrap_or(0);
    if digits > 0.0 { -decimals } else { decimals }
}

fn choice() -> Id {
    Id::new("chosen interval")
}

pub(super) fn chosen(ui: &Ui) -> Option<usize> {
    ui.data(|data| data.get_temp(choice()))
}

pub(super) fn choose(ui: &Ui, index: usize) {
    ui.data_mut(|data| data.insert_temp(choice(), index));
}

/// Default interval, in the middle of the value range.
pub(super) fn middle([low, high]: [f64; 2]) -> Interval {
    let span = high - low;
    let at = |part: f64| snapped(low + part * span, span);
    Interval {
        material: 0,
        range: [at(0.45), at(0.55)],
        ramp: snapped(0.03 * span, span),
        opacity: 0.1,
        absorption: 0.0,
    }
}
