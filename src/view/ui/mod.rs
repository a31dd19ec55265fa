//! The panels: one file each. They show a [`Document`] and answer with [`Action`]s; they change nothing themselves.

mod accuracy;
mod axes;
mod chooser;
mod controls;
mod crop;
mod dial;
mod display;
mod floating;
mod lights;
mod notices;
mod palette;
mod picture;
mod probe;
mod reading;
mod situations;
mod spectra;
mod spectrum;
mod status;
mod toolbar;
mod transfer;

use egui::layers::PaintList;
use egui::scroll_area::ScrollBarVisibility;
use egui::style::ScrollStyle;
use egui::{CentralPanel, Color32, Context, Frame, Id, Order, Panel, Popup, Pos2, Rect, ScrollArea, Ui, UiBuilder};

pub use accuracy::Effort;
pub use chooser::Chooser;
pub use dial::{node_places, show as show_dial};
pub use lights::show as show_lights;
pub use notices::Notice;
pub use palette::Design;
pub use status::Status;

use glam::DVec2;

use super::action::Action;
use super::probe::Probe;
use super::state::Document;
use super::tour::Tour;

/// Narrower windows open with the picture alone.
pub const ROOM_FOR_PANELS: f32 = 560.0;
/// Width of the panels in points: at first, which is the least, and as far as their edge is dragged.
const WIDTH: f32 = 300.0;
const WIDEST: f32 = 520.0;
/// Points across that are left to the picture.
const LEAST_PICTURE: f32 = 240.0;

/// What the panels show.
#[derive(Debug)]
pub struct Shown<'a> {
    /// What is looked at; `None` before anything is open.
    pub document: Option<&'a Document>,
    /// What the last line says.
    pub status: &'a Status,
    /// What is being opened, until its first picture is there: how far it is (0 to 1, where known), and what is done for it.
    pub loading: Option<(&'a str, Option<f32>, &'a str)>,
    /// What went wrong or was done, the newest last.
    pub notices: &'a [Notice],
    /// Whether the device was lost, and nothing is rendered until somebody asks for it.
    pub stopped: bool,
    /// Whether something is asked about a file, which keys and the mouse are for.
    pub chooses: bool,
    /// Whether somebody has asked the window to close.
    pub closes: bool,
    /// Whether it is one of several volumes in a file.
    pub several: bool,
    /// The tour that is played or saved, if one is.
    pub tour: Option<&'a Tour>,
    /// Whether there are panels beside the picture.
    pub panels: bool,
    /// Where in the picture a pixel is looked at, in parts of it, and what is known of it.
    pub probe: Option<(DVec2, Option<&'a Probe>)>,
    /// What pictures take, and how far from the truth they are.
    pub effort: Effort<'a>,
    /// Whether the palette's editor is there, and how far solving is.
    pub design: Design<'a>,
    /// Width over height of the picture in the last frame.
    pub aspect: f64,
}

/// Sizes and inks that all panels share.
pub fn style(context: &Context) {
    context.all_styles_mut(|style| {
        let font = egui::FontId::proportional(11.5);
        style.text_styles.insert(egui::TextStyle::Small, font);
        // egui's own text is at 5 to 1 of what is behind it, and its weak text, which explains, at less than 3 to 1.
        let ink = if style.visuals.dark_mode { 190 } else { 40 };
        style.visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(ink);
        style.visuals.weak_text_alpha = 0.75;
    });
}

/// Shows everything but the picture. What is asked for is added to `asked`; the answer is where the picture belongs.
pub fn show(ui: &mut Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) -> Rect {
    // A click that closes it is for nothing else.
    let popup = Popup::is_any_open(ui.ctx());
    // What the window is cleared with is behind the panels: to fill them again took a tenth of a frame.
    let frame = Frame::side_top_panel(ui.style()).fill(Color32::TRANSPARENT);
    Panel::bottom("status").frame(frame).show(ui, |ui| status::show(ui, shown));
    let mut meant = Vec::new();
    // egui may ask for the panels of a frame more than once.
    if shown.closes && !asked.contains(&Action::Close) {
        meant.push(Action::Close);
    }
    if !shown.chooses {
        toolbar::keys(ui, shown, &mut meant);
    }
    if !meant.is_empty() {
        // What is typed holds first.
        controls::leave_field(ui.ctx());
    }
    if shown.panels {
        let widest = WIDEST.min(ui.available_width() - LEAST_PICTURE).max(WIDTH);
        Panel::left("panels").frame(frame).default_size(WIDTH).size_range(WIDTH..=widest).show(ui, |ui| {
            // What is typed may be wider for a while: the picture, which would be marched anew, keeps its size.
            let all = ui.available_rect_before_wrap();
            ui.advance_cursor_after_rect(all);
            let ui = &mut ui.new_child(UiBuilder::new().max_rect(all));
            toolbar::show(ui, shown, asked);
            ui.separator();
            let Some(document) = shown.document else { return };
            // Beside the controls: a bar over them takes what is meant for them. It is always there: one that comes later
            // would have widened the panels.
            ui.spacing_mut().scroll = ScrollStyle::solid();
            let area = ScrollArea::vertical().auto_shrink(false);
            area.scroll_bar_visibility(ScrollBarVisibility::AlwaysVisible).show(ui, |ui| {
                lights::show(ui, document, asked);
                dial::show(ui, document, asked);
                situations::show(ui, document, shown.tour, asked);
                transfer::show(ui, document, asked);
                display::show(ui, document, asked);
                picture::controls(ui, document, shown.aspect, asked);
                crop::show(ui, document, asked);
                spectra::show(ui, document, shown.effort, asked);
                accuracy::show(ui, document, shown.effort, asked);
            });
        });
    }
    let picture = CentralPanel::default()
        .frame(Frame::NONE)
        .show(ui, |ui| {
            let rect = ui.available_rect_before_wrap();
            picture::show(ui, shown, rect, popup, asked);
            if let Some(document) = shown.document.filter(|_| shown.panels && shown.loading.is_none()) {
                axes::show(ui, document, shown.aspect, rect);
            }
            crop::handles(ui, shown, rect, asked);
            notices::show(ui, shown, rect, asked);
            probe::show(ui, shown, rect, asked);
            palette::show(ui, shown, rect, asked);
            if !shown.panels {
                toolbar::opener(ui, rect, asked);
            }
            rect
        })
        .inner;
    if is_in_use(ui.ctx()) {
        hide_tooltips(ui.ctx());
    }
    // What is typed above a button holds before what that asks for, too, though it is shown first or later.
    asked.sort_by_key(|action| !matches!(action, Action::Edit(_)));
    asked.append(&mut meant);
    picture
}

/// Whether something is held, or was until now: the pointer has not gone on since.
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

/// Whoever holds something wants to see it, and egui keeps a tooltip that is there until the pointer has left what it is of.
fn hide_tooltips(context: &Context) {
    let mut seen = context.memory(|memory| memory.areas().visible_layer_ids());
    seen.retain(|layer| layer.order == Order::Tooltip);
    context.graphics_mut(|graphics| seen.into_iter().for_each(|layer| *graphics.entry(layer) = PaintList::default()));
}
