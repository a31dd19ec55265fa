//! Status line: current work and its cost.

use egui::{RichText, Sides, Ui};

use super::{Shown, controls};

/// Content of the status line.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Device name.
    pub device: String,
    /// Picture size in pixels: width, height.
    pub size: [usize; 2],
    /// Marched pixels of the picture that is shown, if there is one.
    pub shown: Option<[usize; 2]>,
    /// Error of the colours in words.
    pub error: Option<String>,
    /// Progress of the current march, 0 to 1.
    pub marching: Option<f64>,
    /// Name of the running background task.
    pub beside: Option<&'static str>,
    /// Whether the picture has its final quality.
    pub finest: bool,
    /// Duration of the last frame in ms.
    pub frame_ms: f64,
}

/// Shows the status line.
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
        let [width, height] = status.size;
        let coarse = status.shown.filter(|shown| *shown != status.size);
        let coarse = coarse.map_or_else(String::new, |[width, height]| format!(" (now {width}×{height})"));
        let error = status.error.as_ref().map_or_else(String::new, |error| format!("  |  {error}"));
        // The most useful parts first, because a long line is truncated at its end.
        let text = format!(
            "{at}  |  {width}×{height}{coarse}  |  frame {:.1} ms{error}  |  {}",
            status.frame_ms, status.device
        );
        let left = |ui: &mut Ui| drop(ui.add(egui::Label::new(RichText::new(text).small()).truncate()));
        let right = |ui: &mut Ui| {
            if shown.panels && shown.document.is_some() {
                controls::legend(ui);
            }
        };
        Sides::new().shrink_left().truncate().show(ui, left, right);
    });
}
