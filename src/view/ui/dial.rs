//! Light dial: nodes stand for lights, and the hand between them mixes them.

use egui::{Align2, Key, Pos2, Rect, Response, Sense, Stroke, Ui, Vec2, WidgetInfo, WidgetType, vec2};
use glam::DVec2;

use super::controls::{panel, toggle};
use super::spectrum::{narrow, paint_swatch, readable_text};
use crate::document::{Dial, Mixing};
use crate::document::{Document, Edit, polygon, reset_nodes};
use crate::number::count;
use crate::plan::Stale;
use crate::view::action::Action;

/// Margin in points around the outermost nodes, for their names.
const MARGIN: f32 = 28.0;
/// Radius of a node in points.
const NODE: f32 = 7.0;
/// Distance in points at which the hand snaps to a node.
const SNAP: f32 = 9.0;
/// Step of an arrow key, in units of the dial's plane.
const STEP: f64 = 0.02;

/// Shows the dial.
pub fn show(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    let dial = &document.state().dial;
    if dial.nodes.len() < 2 {
        return;
    }
    panel(ui, "Light dial", Stale::Picture, |ui| {
        let side = ui.available_width().min(210.0);
        let (rect, hand) = ui.allocate_exact_size(vec2(ui.available_width(), side), Sense::click_and_drag());
        hand.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, "light dial"));
        let map = held(ui, document, rect);
        ui.painter().rect_filled(rect, 4.0, ui.visuals().extreme_bg_color);
        let inside = rect.shrink(NODE);
        nodes(ui, document, &map, inside, asked);
        move_hand(ui, document, &map, inside, &hand, asked);
        draw_hand(ui, document, &map);
        names(ui, document, &map);
        hand.on_hover_text(
            "Drag the hand between the lights: nearer lights are stronger. Click a node for its light alone. \
             Right-click a node to switch it off, drag it with Shift to move it.",
        );
        ui.horizontal(|ui| {
            ui.label("Mix by");
            let choices = [
                (
                    Mixing::Sliders,
                    "sliders",
                    "The sliders set the weights of the lights. Moving a slider selects them.",
                ),
                (
                    Mixing::Dial,
                    "dial",
                    "The dial sets the weights of the lights, with its own master and keep brightness. It ignores the \
                     switches of the lights. Moving the hand selects the dial.",
                ),
            ];
            for (mixing, name, help) in choices {
                let is_used = document.state().light.mixing == mixing;
                if toggle(ui, is_used, name).on_hover_text(help).clicked() && !is_used {
                    asked.push(Action::Edit(Edit::Mix(mixing)));
                }
            }
        });
        // The row is always shown, so that the controls below do not move under the pointer.
        ui.horizontal(|ui| {
            let moved = reset_nodes(document.opened()) != dial.nodes;
            let reset = ui.add_enabled(moved, egui::Button::new("Reset nodes"));
            let reset = reset.on_hover_text("Switches all nodes on and moves them to their positions in the scene.");
            if reset.on_disabled_hover_text("All nodes are on, at their positions in the scene.").clicked() {
                asked.push(Action::Edit(Edit::ResetDial));
            }
            let even = ui.add_enabled(polygon(dial) != dial.nodes, egui::Button::new("Polygon"));
            let even = even.on_hover_text("Switches all nodes on and moves them to the corners of a regular polygon.");
            if even.on_disabled_hover_text("All nodes are on, at the corners of a regular polygon.").clicked() {
                asked.push(Action::Edit(Edit::Polygon));
            }
        });
    });
}

/// Mapping between the dial's plane and the screen.
#[derive(Clone, Copy)]
struct Map {
    centre: DVec2,
    middle: Pos2,
    scale: f64,
}

impl Map {
    fn new(document: &Document, rect: Rect) -> Self {
        // The map also covers the nodes of the opened scene, so that nodes moved within these bounds do not change it.
        let (dial, opened) = (&document.state().dial, &document.opened().dial);
        let nodes = || dial.nodes.iter().chain(&opened.nodes).map(|node| node.place);
        let around = |places: &mut dyn Iterator<Item = DVec2>| {
            places.fold([DVec2::INFINITY, DVec2::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
        };
        let [low, high] = around(&mut nodes());
        // The map also covers the hands, but distant ones are clamped so that the nodes do not shrink too far.
        let far = DVec2::splat((high - low).max_element().max(1e-3));
        let hands = dial.presets.iter().map(|preset| preset.hand).chain([document.state().light.hand]);
        let hands = hands.map(|hand| hand.clamp(low - far, high + far));
        let [low, high] = around(&mut nodes().chain(hands));
        let room = (rect.size().min_elem() - 2.0 * MARGIN).max(10.0);
        let scale = f64::from(room) / (high - low).max_element().max(1e-3);
        Self { centre: (low + high) / 2.0, middle: rect.center(), scale }
    }

    fn screen_from_dial(&self, place: DVec2) -> Pos2 {
        let from_centre = (place - self.centre) * self.scale;
        self.middle + vec2(narrow(from_centre.x), -narrow(from_centre.y))
    }

    fn dial_from_screen(&self, place: Pos2) -> DVec2 {
        let from_middle = place - self.middle;
        self.centre + DVec2::new(f64::from(from_middle.x), -f64::from(from_middle.y)) / self.scale
    }
}

/// Returns the map of the dial. It stays fixed while a button is held, so that moving a node does not move the others.
fn held(ui: &Ui, document: &Document, rect: Rect) -> Map {
    let (id, now) = (ui.id().with("map"), Map::new(document, rect));
    let before = ui.data(|data| data.get_temp::<Map>(id)).filter(|_| ui.input(|input| input.pointer.any_down()));
    let map = before.map_or(now, |before| Map { middle: now.middle, ..before });
    ui.data_mut(|data| data.insert_temp(id, map));
    map
}

/// Returns the positions of the dial's nodes if the dial is shown in `rect`.
#[must_use]
pub fn node_places(document: &Document, rect: Rect) -> Vec<Pos2> {
    let map = Map::new(document, rect);
    document.state().dial.nodes.iter().map(|node| map.screen_from_dial(node.place)).collect()
}

fn nodes(ui: &Ui, document: &Document, map: &Map, inside: Rect, asked: &mut Vec<Action>) {
    let state = document.state();
    let dial = &state.dial;
    let weights = dial.weights(state.light.hand);
    let visuals = ui.visuals().clone();
    for (index, node) in dial.nodes.iter().enumerate() {
        let place = map.screen_from_dial(node.place);
        let rect = Rect::from_center_size(place, Vec2::splat(3.0 * NODE));
        let touched = ui.interact(rect, ui.id().with(("node", index)), Sense::click_and_drag());
        touched.widget_info(|| {
            WidgetInfo::selected(WidgetType::Button, true, node.on, format!("{} on the dial", node.light))
        });
        let shift = ui.input(|input| input.modifiers.shift);
        if touched.clicked() {
            asked.push(Action::Edit(Edit::HandOnNode(index)));
        } else if touched.secondary_clicked() {
            asked.push(Action::Edit(Edit::NodeOn(index, !node.on)));
        } else if let (true, Some(pointer)) = (touched.dragged(), touched.interact_pointer_pos()) {
            let pointer = pointer.clamp(inside.min, inside.max);
            let here = map.dial_from_screen(pointer);
            asked.push(Action::Edit(if shift { Edit::NodePlace(index, here) } else { snapped(dial, map, pointer) }));
        }
        let colour = if node.on { visuals.text_color() } else { visuals.weak_text_color() };
        if node.on {
            let weight = weights.get(index).copied().unwrap_or(0.0);
            // The selection background is too pale for a line on white.
            let ink = if visuals.dark_mode { visuals.selection.bg_fill } else { visuals.selection.stroke.color };
            let thick = Stroke::new(0.5 + 3.0 * narrow(weight), ink);
            if state.light.mixing == Mixing::Dial {
                ui.painter().line_segment([place, map.screen_from_dial(state.light.hand)], thick);
            }
        }
        if let Some(light) = state.scene.lights.iter().find(|light| light.name == node.light) {
            let rect = Rect::from_center_size(place, Vec2::splat(2.0 * NODE));
            paint_swatch(ui, &light.spectrum, if node.on { 1.0 } else { 0.15 }, &state.scene.display, rect);
        }
        if touched.hovered() || touched.has_focus() {
            ui.painter().circle_stroke(place, 1.6 * NODE, Stroke::new(1.0, colour));
        }
    }
}

/// Draws the names of the nodes on top, even over the hand.
fn names(ui: &Ui, document: &Document, map: &Map) {
    let visuals = ui.visuals();
    for node in &document.state().dial.nodes {
        let place = map.screen_from_dial(node.place);
        let colour = if node.on { visuals.text_color() } else { visuals.weak_text_color() };
        let below = (place - map.middle).y >= 0.0;
        let (align, at) = if below {
            (Align2::CENTER_TOP, place + vec2(0.0, NODE + 2.0))
        } else {
            (Align2::CENTER_BOTTOM, place - vec2(0.0, NODE + 2.0))
        };
        let text = if node.on { node.light.clone() } else { format!("({})", node.light) };
        readable_text(ui, at, align, text, 12.0, colour);
    }
}

/// Edit that moves the hand to `pointer`, or exactly onto a nearby node.
fn snapped(dial: &Dial, map: &Map, pointer: Pos2) -> Edit {
    let near = dial.nodes.iter().position(|node| node.on && map.screen_from_dial(node.place).distance(pointer) < SNAP);
    near.map_or_else(|| Edit::Hand(map.dial_from_screen(pointer)), Edit::HandOnNode)
}

fn move_hand(ui: &Ui, document: &Document, map: &Map, inside: Rect, hand: &Response, asked: &mut Vec<Action>) {
    let light = &document.state().light;
    if let (true, Some(pointer)) = (hand.dragged() || hand.clicked(), hand.interact_pointer_pos()) {
        let pointer = pointer.clamp(inside.min, inside.max);
        asked.push(Action::Edit(snapped(&document.state().dial, map, pointer)));
    }
    if hand.has_focus() {
        let keys = [Key::ArrowLeft, Key::ArrowRight, Key::ArrowDown, Key::ArrowUp];
        let pressed = ui.input(|input| keys.map(|key| count(input.num_presses(key))));
        let step = DVec2::new(pressed[1] - pressed[0], pressed[3] - pressed[2]) * STEP;
        if step != DVec2::ZERO {
            asked.push(Action::Edit(Edit::Hand(light.hand + step)));
        }
    }
}

fn draw_hand(ui: &Ui, document: &Document, map: &Map) {
    let light = &document.state().light;
    let place = map.screen_from_dial(light.hand);
    let active = light.mixing == Mixing::Dial;
    let visuals = ui.visuals();
    let fill = if active { visuals.selection.bg_fill } else { visuals.extreme_bg_color };
    ui.painter().circle(place, 6.0, fill, Stroke::new(2.0, visuals.strong_text_color()));
}
