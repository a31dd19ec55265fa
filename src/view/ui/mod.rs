//! The panels, one file each. They show a [`Document`] and return [`Action`]s; they do not modify it.

mod accuracy;
mod annotations;
mod axes;
mod axis;
mod chooser;
mod clip;
mod controls;
mod crop;
mod dial;
mod dial_presets;
mod display;
mod docks;
mod fields;
mod floating;
mod help;
mod lights;
mod notices;
mod palette;
mod picture;
mod previews;
mod probe;
mod reading;
mod rectangles;
mod slices;
mod spectra;
mod spectrum;
mod status;
mod toolbar;
mod transfer;

use egui::layers::PaintList;
use egui::{CentralPanel, Color32, Context, Frame, Id, Order, Panel, Popup, Pos2, Rect, Ui};

pub use accuracy::Effort;
pub use chooser::Chooser;
pub use dial::{node_places, show as show_dial};
pub use docks::{dock_sizes, resized_dock};
pub use lights::show as show_lights;
pub use notices::Notice;
pub use palette::Design;
pub use slices::forget as forget_slices;
pub use status::Status;

use std::path::PathBuf;

use glam::DVec2;

use super::action::Action;
use super::layout::Layout;
use super::probe::Probe;
use super::tour::Tour;
use crate::document::Document;

/// Window width in points below which the window opens without panels.
pub const ROOM_FOR_PANELS: f32 = 560.0;

/// Input of the panels.
#[derive(Debug)]
pub struct Shown<'a> {
    /// The open document; `None` before anything is open.
    pub document: Option<&'a Document>,
    /// Name of the scene or volume.
    pub title: &'a str,
    /// Content of the status line.
    pub status: &'a Status,
    /// Name of the file being opened, its progress (0 to 1, if known) and current stage, until its first picture.
    pub loading: Option<(&'a str, Option<f32>, &'a str)>,
    /// Notices, oldest first.
    pub notices: &'a [Notice],
    /// Name of the page being written, its progress (0 to 1, if known) and current stage.
    pub page: Option<(&'a str, Option<f32>, &'a str)>,
    /// Whether the device was lost and rendering waits for a restart by the user.
    pub stopped: bool,
    /// Whether a file dialog is open, which then takes keys and mouse.
    pub chooses: bool,
    /// Whether the user asked the window to close.
    pub closes: bool,
    /// Whether the file contains more volumes.
    pub several: bool,
    /// The tour that is played or saved.
    pub tour: Option<&'a Tour>,
    /// Whether the panels are visible.
    pub panels: bool,
    /// Docks and tabs, slices, annotations and the measuring line.
    pub layout: &'a Layout,
    /// Files opened last, the latest first.
    pub recent: &'a [PathBuf],
    /// Position of the probed pixel as fractions of the picture, and the result of the probe.
    pub probe: Option<(DVec2, Option<&'a Probe>)>,
    /// Cost and error of pictures.
    pub effort: Effort<'a>,
    /// State of the palette editor.
    pub design: Design<'a>,
    /// Aspect ratio (width / height) of the picture in the last frame.
    pub aspect: f64,
}

/// Sets font sizes and text colours for all panels.
pub fn style(context: &Context) {
    context.all_styles_mut(|style| {
        let font = egui::FontId::proportional(11.5);
        style.text_styles.insert(egui::TextStyle::Small, font);
        // egui's text has a contrast of 5:1 to its background; its weak text, used for explanations, has less than 3:1.
        let ink = if style.visuals.dark_mode { 190 } else { 40 };
        style.visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(ink);
        style.visuals.weak_text_alpha = 0.75;
    });
}

/// Shows everything except the picture and adds the user's actions to `asked`. Returns the rectangle of the picture.
pub fn show(ui: &mut Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) -> Rect {
    // A click that closes a popup has no other effect.
    let popup = Popup::is_any_open(ui.ctx());
    // The cleared window already has the background colour; a second fill took a tenth of a frame.
    let frame = Frame::side_top_panel(ui.style()).fill(Color32::TRANSPARENT);
    Panel::bottom("status").frame(frame).show(ui, |ui| status::show(ui, shown));
    let mut meant = Vec::new();
    // egui may run the panels several times per frame.
    if shown.closes && !asked.contains(&Action::Close) {
        meant.push(Action::Close);
    }
    if !shown.chooses {
        toolbar::keys(ui, shown, popup, &mut meant);
    }
    if !meant.is_empty() {
        // The text being typed is applied first.
        controls::leave_field(ui.ctx());
    }
    let docked = docks::has_docks(ui.available_size());
    let mut around = ui.available_rect_before_wrap();
    if shown.panels {
        Panel::top("toolbar").frame(frame).show(ui, |ui| toolbar::show(ui, shown, docked, asked));
        around = ui.available_rect_before_wrap();
        docks::show(ui, shown, docked, frame, asked);
    }
    let picture = CentralPanel::default()
        .frame(Frame::NONE)
        .show(ui, |ui| {
            let rect = ui.available_rect_before_wrap();
            let rect = slices::show(ui, shown, rect, asked);
            picture::show(ui, shown, rect, popup, asked);
            if let Some(document) = shown.document.filter(|_| shown.panels && shown.loading.is_none()) {
                axes::show(ui, document, shown.aspect, rect);
            }
            annotations::show(ui, shown, rect);
            slices::crosshair(ui, shown, rect);
            crop::handles(ui, shown, rect, asked);
            clip::handles(ui, shown, rect, asked);
            notices::show(ui, shown, rect, asked);
            // Windows may lie over docks, but not over the only column.
            let around = if docked { around } else { rect };
            probe::show(ui, shown, [rect, around], asked);
            palette::show(ui, shown, [rect, around], asked);
            help::show(ui, shown, around, asked);
            if !shown.panels {
                toolbar::opener(ui, rect, asked);
            }
            rect
        })
        .inner;
    toolbar::note_typed(ui);
    if is_in_use(ui.ctx()) {
        hide_tooltips(ui.ctx());
    }
    // Text typed in a field is applied before the action of a button, even one that is shown earlier.
    asked.sort_by_key(|action| !matches!(action, Action::Edit(_)));
    asked.append(&mut meant);
    picture
}

/// Whether the pointer holds something, or has not moved away since it was released.
fn is_in_use(context: &Context) -> bool {
    const GONE_ON: f32 = 12.0;
    let id = Id::new("held at");
    let (down, pointer) = context.input(|input| (input.pointer.any_down(), input.pointer.latest_pos()));
    context.data_mut(|data| {
        let held = if down { pointer } else { data.get_temp(id) };
        let held = held.filter(|held: &Pos2| pointer.is_some_and(|pointer| pointer.distance(*held) < GONE_ON));
        match held {
            Some(held) => drop(data.insert_temp(id, held)),
            None => data.remove::<Pos2>(id),
        }
        held.is_some()
    })
}

/// Hides all tooltips, which would cover what the pointer holds. egui itself keeps a tooltip until the pointer leaves
/// its widget.
fn hide_tooltips(context: &Context) {
    let mut seen = context.memory(|memory| memory.areas().visible_layer_ids());
    seen.retain(|layer| layer.order == Order::Tooltip);
    context.graphics_mut(|graphics| seen.into_iter().for_each(|layer| *graphics.entry(layer) = PaintList::default()));
}
