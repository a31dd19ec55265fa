//! Status line: current work and its cost.

use egui::{RichText, Sides, Ui};

use super::{Shown, controls};
use crate::view::engine::{Refining, ShownLevel};

/// Content of the status line.
#[derive(Clone, Debug, Default)]
pub struct Status {
    /// Device name.
    pub device: String,
    /// Picture size in pixels: width, height.
    pub size: [usize; 2],
    /// Marched pixels of the picture that is shown, if there is one.
    pub shown: Option<[usize; 2]>,
    /// Coarse level of the volume that is shown, if it is not the volume itself.
    pub level: Option<ShownLevel>,
    /// Voxels whose mean is one of the coarse level that its shadows come from, along each axis, if they do.
    pub light_block: Option<[usize; 3]>,
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

/// Coarse level of the volume and its refinement, in words.
fn told(shown: ShownLevel) -> String {
    let then = match shown.then {
        Refining::Waits => "refined at rest".to_owned(),
        Refining::Prepares => "preparing its bricks (Esc stops)".to_owned(),
        Refining::Loads([loaded, all, 1]) => format!("loading bricks, {loaded} of {all} (Esc stops)"),
        Refining::Loads([loaded, all, round]) => {
            format!("loading bricks, {loaded} of {all} in round {round} (Esc stops)")
        }
        Refining::Marches => "marching its bricks (Esc stops)".to_owned(),
        Refining::Stopped => "stopped; the next change refines it".to_owned(),
        Refining::Failed => "it cannot be refined, see the notice".to_owned(),
    };
    format!("level {} of the volume, 1/{} of its voxels; {then}", shown.level, shown.voxels)
}

/// Shows the status line.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>) {
    let status = shown.status;
    ui.horizontal(|ui| {
        let at = match (status.marching, status.beside, status.finest) {
            _ if status.level.is_some() => status.level.map_or_else(String::new, told),
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
        let shadows = status
            .light_block
            .map_or_else(String::new, |[x, y, z]| format!("  |  shadows from means of {x}×{y}×{z} voxels"));
        // The most useful parts first, because a long line is truncated at its end.
        let text = format!(
            "{at}  |  {width}×{height}{coarse}  |  frame {:.1} ms{error}{shadows}  |  {}",
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
