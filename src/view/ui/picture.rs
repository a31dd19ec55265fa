//! Camera control over the picture, by mouse, keyboard and buttons.

use egui::{
    Align2, FontId, Frame, Key, Modifiers, PointerButton, ProgressBar, Rect, Sense, StrokeKind, Ui, UiBuilder, Vec2,
    vec2,
};

use glam::DVec2;

use super::axes::side_name;
use super::controls::{panel, toggle};
use super::spectrum::narrow;
use super::{Shown, help};
use crate::document::moves::{Move, Side};
use crate::document::{Document, Edit};
use crate::number::count;
use crate::plan::Stale;
use crate::scene::Projection;
use crate::view::action::{Action, File};
use crate::view::layout::{Arrange, Note};

/// Rotation in degrees for a drag over the height of the picture; the widget of notebooks turns alike (python/widget).
const TURN: f64 = 180.0;
/// Rotation in degrees per arrow key.
const KEY_TURN: f64 = 5.0;
/// Dolly factor per line of the wheel or per key.
const NEARER: f64 = 1.1;

/// Help text for the mouse.
pub(super) const HELP: &str = "Drag to orbit, drag with the right button or Shift to pan, with Ctrl to roll; use the wheel to go nearer. Click to probe a pixel.";

/// Moves the camera by mouse and keyboard. Without a picture, shows the progress of loading or how to open a file. A
/// click only closes an open `popup`.
pub(super) fn show(ui: &mut Ui, shown: &Shown<'_>, rect: Rect, popup: bool, asked: &mut Vec<Action>) {
    if let Some((name, part, stage)) = shown.loading {
        let at = Rect::from_center_size(rect.center(), vec2(rect.width().min(340.0) - 20.0, 60.0));
        ui.scope_builder(UiBuilder::new().max_rect(at), |ui| {
            Frame::popup(ui.style()).show(ui, |ui| {
                ui.label(format!("Opening {name}"));
                ui.add(part.map_or_else(|| ProgressBar::new(0.0), |part| ProgressBar::new(part).show_percentage()));
                ui.label(stage);
            });
        });
        return;
    }
    if shown.document.is_none() {
        empty(ui, rect, asked);
        return;
    }
    // The handles to resize the docks extend into the picture.
    let edge = if shown.panels { ui.style().interaction.resize_grab_radius_side } else { 0.0 };
    let inside = Rect::from_min_max(rect.min + vec2(edge, 0.0), rect.max - Vec2::splat(edge));
    let inside = if inside.is_positive() { inside } else { rect };
    let hand = ui.interact(inside, ui.id().with("picture"), Sense::click_and_drag());
    hand.widget_info(|| egui::WidgetInfo::labeled(egui::WidgetType::Image, true, "picture"));
    let followed =
        hand.hovered() && !shown.layout.ruler.on && ui.input(|input| input.modifiers.alt && !input.pointer.any_down());
    if let Some(at) =
        hand.interact_pointer_pos().filter(|_| hand.clicked() && !popup).or(hand.hover_pos().filter(|_| followed))
    {
        let part = (at - rect.min) / rect.size();
        let place = DVec2::new(part.x.into(), part.y.into());
        asked.push(if shown.layout.ruler.on { Action::RulerAt(place) } else { Action::Probe(Some(place)) });
    }
    let mut go = |step: Move| asked.push(Action::Edit(Edit::Camera(step, shown.aspect)));
    let (dragged, height) = (hand.drag_delta(), f64::from(rect.height()).max(1.0));
    let [right, down] = [f64::from(dragged.x) / height, f64::from(dragged.y) / height];
    if right != 0.0 || down != 0.0 {
        let modifiers = ui.input(|input| input.modifiers);
        let pans = hand.dragged_by(PointerButton::Secondary) || hand.dragged_by(PointerButton::Middle);
        if pans || modifiers.shift {
            go(Move::Pan { right, up: -down });
        } else if modifiers.command {
            go(Move::Roll(TURN * right));
        } else {
            // The volume follows the pointer, so the camera moves the opposite way.
            go(Move::Orbit { right: -TURN * right, up: TURN * down });
        }
    }
    let turned = ui.input(|input| input.events.iter().any(|event| matches!(event, egui::Event::MouseWheel { .. })));
    let wheel = ui.id().with("the wheel was turned here");
    if turned {
        ui.data_mut(|data| data.insert_temp(wheel, hand.hovered()));
    }
    // egui smooths scrolling over several frames; they count for the place where scrolling began.
    if hand.hovered() && ui.data(|data| data.get_temp(wheel).unwrap_or(true)) {
        let (scrolled, pinched) = ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta()));
        let closer = NEARER.powf(f64::from(scrolled) / 50.0) * f64::from(pinched);
        if (closer - 1.0).abs() > 1e-6 {
            go(Move::Dolly(closer));
        }
    }
    if !shown.chooses && ui.memory(|memory| memory.focused().is_none_or(|focused| focused == hand.id)) {
        keys(ui, &mut go);
        let layout = shown.layout;
        let switches = [
            (Key::S, Arrange::Slices(!layout.slices.shown)),
            (Key::M, Arrange::Ruler(!layout.ruler.on)),
            (Key::L, Arrange::Note(Note::Legend, !layout.has(Note::Legend))),
        ];
        for (key, change) in switches {
            if ui.input(|input| input.modifiers.is_none() && input.key_pressed(key)) {
                asked.push(Action::Arrange(change));
            }
        }
        help::keys(ui, shown, asked);
    }
    if hand.has_focus() {
        ui.painter().rect_stroke(inside, 0.0, ui.visuals().selection.stroke, StrokeKind::Inside);
    }
}

/// Camera control by keyboard.
fn keys(ui: &Ui, go: &mut impl FnMut(Move)) {
    let presses = |key: Key, modifiers: Modifiers| {
        ui.input(|input| {
            let pressed = |event: &&egui::Event| {
                matches!(event, egui::Event::Key { key: it, pressed: true, modifiers: with, .. }
                    if *it == key && with.shift == modifiers.shift && !with.command && !with.alt)
            };
            count(input.events.iter().filter(pressed).count())
        })
    };
    let arrows = |modifiers| {
        let times = |key| presses(key, modifiers);
        let right: f64 = times(Key::ArrowRight) - times(Key::ArrowLeft);
        [right, times(Key::ArrowUp) - times(Key::ArrowDown)]
    };
    let [right, up] = arrows(Modifiers::NONE);
    if right != 0.0 || up != 0.0 {
        go(Move::Orbit { right: KEY_TURN * right, up: KEY_TURN * up });
    }
    let [right, up] = arrows(Modifiers::SHIFT);
    if right != 0.0 || up != 0.0 {
        go(Move::Pan { right: -0.05 * right, up: -0.05 * up });
    }
    let times = |key| presses(key, Modifiers::NONE);
    // `+` needs Shift on some keyboard layouts.
    let anyhow = |key| presses(key, Modifiers::NONE) + presses(key, Modifiers::SHIFT);
    let nearer =
        anyhow(Key::Plus) + anyhow(Key::Equals) + times(Key::PageUp) - times(Key::Minus) - times(Key::PageDown);
    if nearer != 0.0 {
        go(Move::Dolly(NEARER.powf(nearer)));
    }
    let rolled = times(Key::Period) - times(Key::Comma);
    if rolled != 0.0 {
        go(Move::Roll(KEY_TURN * rolled));
    }
    for (key, side) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6].into_iter().zip(Side::ALL) {
        if times(key) > 0.0 {
            go(Move::Axis(side));
        }
    }
    if times(Key::P) > 0.0 {
        go(Move::Projection);
    }
    if times(Key::R) > 0.0 {
        go(Move::Reset);
    }
}

/// Shows the camera panel.
pub(super) fn controls(ui: &mut Ui, document: &Document, aspect: f64, asked: &mut Vec<Action>) {
    panel(ui, "Camera", Stale::Accumulators, |ui| {
        let mut go = |step: Move| asked.push(Action::Edit(Edit::Camera(step, aspect)));
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing.x = 3.0;
            for (number, side) in (1..).zip(Side::ALL) {
                let sign = if side.outward().element_sum() < 0.0 { '−' } else { '+' };
                let axis = ['x', 'y', 'z'][side.outward().abs().max_position()];
                let volume = document.state().scene.volume();
                let help = format!("View from this side of the volume, {sign}{axis} (key {number}).");
                let name = side_name(side, volume.anatomical);
                if ui.small_button(name).on_hover_text(help).clicked() {
                    go(Move::Axis(side));
                }
            }
        });
        ui.horizontal_wrapped(|ui| {
            let parallel = matches!(document.state().scene.camera.projection, Projection::Orthographic { .. });
            let kinds = [
                ("Perspective", false, "Distant parts look smaller (key P toggles)."),
                ("Orthographic", true, "The size of a part does not depend on its distance (key P toggles)."),
            ];
            for (name, is_it, help) in kinds {
                let kind = toggle(ui, parallel == is_it, name).on_hover_text(help);
                if kind.clicked() && parallel != is_it {
                    go(Move::Projection);
                }
            }
            if ui.button("Reset").on_hover_text("The camera of the scene (key R).").clicked() {
                go(Move::Reset);
            }
        });
        let volume = document.state().scene.volume();
        if !volume.anatomical && !volume.files.is_empty() {
            let text = "Sides are axes of the file, which has no anatomical orientation.";
            ui.label(egui::RichText::new(text).small().weak());
        }
        ui.label(egui::RichText::new(HELP).small().weak());
    });
}

fn empty(ui: &mut Ui, rect: Rect, asked: &mut Vec<Action>) {
    let text = "Nothing is open.\n\nDrop a scene (.toml) or a volume\n(.mhd, .nrrd, .vti, .raw) on this window,\nor open one here.";
    let size = narrow(f64::from(rect.width()) / 24.0).clamp(10.0, 18.0);
    ui.painter().text(
        rect.center(),
        Align2::CENTER_CENTER,
        text,
        FontId::proportional(size),
        ui.visuals().text_color(),
    );
    let actions = [("Open…", Action::Choose(File::Opened)), ("Open the built-in scene", Action::Open(Box::default()))];
    for ((text, action), line) in actions.into_iter().zip([0.0, 30.0]) {
        let below = rect.center() + vec2(0.0, 4.5 * size + line);
        let place = Rect::from_center_size(below, vec2(220.0, 26.0).min(rect.size()));
        if place.is_positive() && ui.put(place, egui::Button::new(text)).clicked() {
            asked.push(action);
        }
    }
}
