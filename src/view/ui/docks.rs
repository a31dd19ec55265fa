//! Docks beside the picture: lights on the left, tabs on the right, transfer function and spectra at the bottom. A
//! small window has one column with all panels instead.

use egui::panel::PanelState;
use egui::scroll_area::ScrollBarVisibility;
use egui::style::ScrollStyle;
use egui::{
    Context, Frame, Id, Panel, Rect, Response, ScrollArea, Sense, Stroke, StrokeKind, Ui, UiBuilder, Vec2, WidgetInfo,
    WidgetType, vec2,
};

use super::controls::{is_tab, mark, tab, toggle};
use super::{Shown, accuracy, clip, crop, dial, dial_presets, display, lights, picture, spectra, transfer};
use crate::document::Document;
use crate::plan::Stale;
use crate::view::action::Action;
use crate::view::layout::{Arrange, Dock, DockSizes, Tab};

/// Size of a window in points from which it has docks.
const ROOM_FOR_DOCKS: Vec2 = vec2(1100.0, 480.0);
/// Width of a dock at the side: initial and minimum, and maximum.
const WIDTH: f32 = 300.0;
const WIDEST: f32 = 520.0;
/// Height of the bottom dock: initial, and minimum.
const HEIGHT: f32 = 232.0;
const LOWEST: f32 = 120.0;
/// Minimum size of the picture in points.
const LEAST_PICTURE: Vec2 = vec2(240.0, 160.0);
/// Width of the bottom dock from which its tabs lie side by side.
const ROOM_FOR_BOTH: f32 = 900.0;
/// Width of the spectra in the bottom dock, beside the transfer function.
const SPECTRA: f32 = 300.0;

/// Names of the docks' panels, in the order of [`Dock::ALL`].
const PANELS: [&str; Dock::ALL.len()] = ["left dock", "right dock", "bottom dock"];

/// Present sizes of the docks that have been shown, in points.
pub fn dock_sizes(context: &Context) -> DockSizes {
    let size = |dock: Dock| {
        let size = PanelState::load(context, Id::new(PANELS[dock as usize]))?.size();
        Some(if dock == Dock::Bottom { size.y } else { size.x })
    };
    Dock::ALL.map(size)
}

/// The dock whose edge has just been released after a drag, and its size in points.
pub fn resized_dock(context: &Context) -> Option<(Dock, f32)> {
    // The identity that egui gives to the edge of a panel.
    let edge = |dock: &Dock| Id::new(PANELS[*dock as usize]).with("__resize");
    let released = context.drag_stopped_id()?;
    let dock = Dock::ALL.into_iter().find(|dock| edge(dock) == released)?;
    dock_sizes(context)[dock as usize].map(|size| (dock, size))
}

/// Whether a window of `size` has docks.
pub(super) fn has_docks(size: Vec2) -> bool {
    size.x >= ROOM_FOR_DOCKS.x && size.y >= ROOM_FOR_DOCKS.y
}

/// Shows the open docks, or the column of a window without room for them.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>, docked: bool, frame: Frame, asked: &mut Vec<Action>) {
    let Some(document) = shown.document else { return };
    if !docked {
        let widest = WIDEST.min(ui.available_width() - LEAST_PICTURE.x).max(WIDTH);
        Panel::left("column").frame(frame).default_size(WIDTH).size_range(WIDTH..=widest).show(ui, |ui| {
            scrolled(ui, |ui| {
                light(ui, shown, document, asked);
                transfer::show(ui, document, seen(shown), asked);
                for tab in [Tab::Display, Tab::Camera, Tab::Crop, Tab::Spectra, Tab::Accuracy] {
                    contents(ui, shown, document, tab, asked);
                }
            });
        });
        return;
    }
    let layout = shown.layout;
    // Each dock leaves the others their minimum size.
    let other = |dock: Dock| if layout.is_open(dock) { WIDTH } else { 0.0 };
    let kept = |dock: Dock, [usual, most]: [f32; 2]| layout.sizes[dock as usize].unwrap_or(usual).min(most);
    let panel = |dock: Dock| Id::new(PANELS[dock as usize]);
    if layout.is_open(Dock::Left) {
        let widest = WIDEST.min(ui.available_width() - LEAST_PICTURE.x - other(Dock::Right)).max(WIDTH);
        let usual = kept(Dock::Left, [WIDTH, widest]).max(WIDTH);
        let dock = Panel::left(panel(Dock::Left)).frame(frame).default_size(usual).size_range(WIDTH..=widest);
        dock.show(ui, |ui| {
            scrolled(ui, |ui| light(ui, shown, document, asked));
        });
    }
    if layout.is_open(Dock::Right) {
        let widest = WIDEST.min(ui.available_width() - LEAST_PICTURE.x).max(WIDTH);
        let usual = kept(Dock::Right, [WIDTH, widest]).max(WIDTH);
        let dock = Panel::right(panel(Dock::Right)).frame(frame).default_size(usual).size_range(WIDTH..=widest);
        dock.show(ui, |ui| {
            fixed(ui, |ui| {
                tabs(ui, shown, &Tab::RIGHT, layout.right, asked);
                tab(ui, |ui| scrolled(ui, |ui| contents(ui, shown, document, layout.right, asked)));
            });
        });
    }
    if layout.is_open(Dock::Bottom) {
        let highest = (ui.available_height() - LEAST_PICTURE.y).max(LOWEST);
        let usual = kept(Dock::Bottom, [HEIGHT, highest]).max(LOWEST);
        let dock = Panel::bottom(panel(Dock::Bottom)).frame(frame).default_size(usual).size_range(LOWEST..=highest);
        dock.show(ui, |ui| {
            fixed(ui, |ui| bottom(ui, shown, document, asked));
        });
    }
}

/// Contents of the left dock.
fn light(ui: &mut Ui, shown: &Shown<'_>, document: &Document, asked: &mut Vec<Action>) {
    lights::show(ui, document, asked);
    dial::show(ui, document, asked);
    dial_presets::show(ui, document, shown.tour, asked);
}

/// Contents of the bottom dock.
fn bottom(ui: &mut Ui, shown: &Shown<'_>, document: &Document, asked: &mut Vec<Action>) {
    let all = ui.available_rect_before_wrap();
    if all.width() < ROOM_FOR_BOTH {
        tabs(ui, shown, &Tab::BOTTOM, shown.layout.bottom, asked);
        tab(ui, |ui| match shown.layout.bottom {
            Tab::Transfer => transfer::wide(ui, document, seen(shown), asked),
            other => scrolled(ui, |ui| contents(ui, shown, document, other, asked)),
        });
        return;
    }
    let (left, right) = all.split_left_right_at_x(all.right() - SPECTRA);
    let side = |ui: &mut Ui, rect: Rect, name: Tab| {
        let mut ui = ui.new_child(UiBuilder::new().max_rect(rect));
        ui.horizontal(|ui| {
            ui.strong(if name == Tab::Transfer { "Transfer function" } else { name.name() });
            mark(ui, stale(shown, name));
        });
        ui
    };
    let mut transfer = side(ui, left.with_max_x(left.right() - 12.0), Tab::Transfer);
    tab(&mut transfer, |ui| transfer::wide(ui, document, seen(shown), asked));
    let mut spectra = side(ui, right, Tab::Spectra);
    tab(&mut spectra, |ui| scrolled(ui, |ui| contents(ui, shown, document, Tab::Spectra, asked)));
}

/// Value and gradient magnitude where the probe sees most.
fn seen(shown: &Shown<'_>) -> Option<[f64; 2]> {
    let brightest = shown.probe?.1?.brightest()?;
    Some([brightest.value, brightest.magnitude])
}

/// Stage that the controls of a tab make stale.
fn stale(shown: &Shown<'_>, tab: Tab) -> Stale {
    match tab {
        Tab::Camera | Tab::Crop => Stale::Accumulators,
        Tab::Display => Stale::Picture,
        Tab::Accuracy | Tab::Transfer => Stale::Tables,
        Tab::Spectra => spectra::stale(shown.effort),
    }
}

fn contents(ui: &mut Ui, shown: &Shown<'_>, document: &Document, tab: Tab, asked: &mut Vec<Action>) {
    match tab {
        Tab::Camera => picture::controls(ui, document, shown.aspect, asked),
        Tab::Crop => {
            crop::show(ui, document, asked);
            ui.separator();
            clip::show(ui, document, asked);
        }
        Tab::Display => display::show(ui, document, asked),
        Tab::Accuracy => accuracy::show(ui, document, shown.effort, asked),
        Tab::Transfer => transfer::show(ui, document, seen(shown), asked),
        Tab::Spectra => spectra::show(ui, document, shown.effort, asked),
    }
}

/// Row of tabs, each with the mark of its controls.
fn tabs(ui: &mut Ui, shown: &Shown<'_>, all: &[Tab], now: Tab, asked: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        for &tab in all {
            let button = toggle(ui, tab == now, tab.name());
            button.widget_info(|| WidgetInfo::selected(WidgetType::RadioButton, true, tab == now, tab_name(tab)));
            if button.clicked() {
                asked.push(Action::Arrange(Arrange::Tab(tab)));
            }
            mark(ui, stale(shown, tab));
            ui.add_space(2.0);
        }
    });
    ui.separator();
}

/// Name of a tab for screen readers and tests.
fn tab_name(tab: Tab) -> String {
    format!("tab: {}", tab.name())
}

/// Shows `contents` in the present size of the panel. A field may temporarily grow while text is typed; the panel keeps
/// its size, because a new picture size needs a new march.
fn fixed(ui: &mut Ui, contents: impl FnOnce(&mut Ui)) {
    let all = ui.available_rect_before_wrap();
    ui.advance_cursor_after_rect(all);
    contents(&mut ui.new_child(UiBuilder::new().max_rect(all)));
}

/// Shows `contents` with a scroll bar beside them.
fn scrolled(ui: &mut Ui, contents: impl FnOnce(&mut Ui)) {
    fixed(ui, |ui| {
        // The scroll bar lies next to the controls, because a bar over them would take their clicks. It is always
        // visible, because a bar that appears later would widen the panels.
        ui.spacing_mut().scroll = ScrollStyle::solid();
        let area = ScrollArea::vertical().auto_shrink(false).id_salt(is_tab(ui));
        area.scroll_bar_visibility(ScrollBarVisibility::AlwaysVisible).show(ui, contents);
    });
}

/// Buttons that open and close the docks.
pub(super) fn switches(ui: &mut Ui, shown: &Shown<'_>, asked: &mut Vec<Action>) {
    for dock in Dock::ALL {
        let open = shown.layout.is_open(dock);
        let help = match dock {
            Dock::Left => "Lights, light dial and dial presets.",
            Dock::Right => "Camera, crop box, display and accuracy.",
            Dock::Bottom => "Transfer function and spectra.",
        };
        if switch(ui, dock, open).on_hover_text(help).clicked() {
            asked.push(Action::Arrange(Arrange::Dock(dock, !open)));
        }
    }
}

/// Button with a drawing of a window and one of its docks.
fn switch(ui: &mut Ui, dock: Dock, open: bool) -> Response {
    let (rect, response) = ui.allocate_exact_size(vec2(24.0, ui.spacing().interact_size.y), Sense::click());
    response.widget_info(|| WidgetInfo::selected(WidgetType::Button, true, open, format!("{} dock", dock.name())));
    let visuals = ui.style().interact(&response);
    let window = Rect::from_center_size(rect.center(), vec2(17.0, 13.0));
    let part = match dock {
        Dock::Left => window.with_max_x(window.left() + 6.0),
        Dock::Right => window.with_min_x(window.right() - 6.0),
        Dock::Bottom => window.with_min_y(window.bottom() - 5.0),
    };
    let colour = if open { visuals.fg_stroke.color } else { visuals.fg_stroke.color.gamma_multiply(0.25) };
    ui.painter().rect_filled(part, 1.0, colour);
    ui.painter().rect_stroke(window, 1.0, Stroke::new(1.0, visuals.fg_stroke.color), StrokeKind::Inside);
    response
}
