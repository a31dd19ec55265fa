//! The status line: what is being computed, and what it has cost.

use egui::{RichText, Ui};

use super::Shown;
use crate::view::engine::Counts;

/// What the status line says.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// The device's name.
    pub device: String,
    /// Pixels of the picture, across and down.
    pub size: [usize; 2],
    /// How far the march under way is, 0 to 1.
    pub marching: Option<f64>,
    /// What is at work beside the picture.
    pub beside: Option<&'static str>,
    /// Whether the picture is as fine as it gets.
    pub finest: bool,
    /// What was done so far.
    pub counts: Counts,
    /// How long the last frame took, in ms.
    pub frame_ms: f64,
}

/// Shows it.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>) {
    let status = shown.status;
    ui.horizontal(|ui| {
        let at = match (status.marching, status.beside, status.finest) {
            (Some(part), _, _) => format!("refining {:.0} %", 100.0 * part),
            (None, Some(beside), _) => beside.to_owned(),
            (None, None, true) => "at rest".to_owned(),
            (None, None, false) if shown.document.is_none() => "nothing is open".to_owned(),
            (None, None, false) => "preparing".to_owned(),
        };
        let Counts { marches, relights, .. } = status.counts;
        let [width, height] = status.size;
        // The most useful first: what does not fit is cut off at the end.
        let text = format!(
            "{at}  |  {width}×{height}  |  marches {marches}  relights {relights}  |  last frame of the window {:.1} ms  |  {}",
            status.frame_ms, status.device
        );
        ui.add(egui::Label::new(RichText::new(text).small()).truncate());
    });
}
