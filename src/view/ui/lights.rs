//! Light panel: slider, switch, swatch and spectrum per light.

use egui::{Checkbox, RichText, Ui, Vec2, WidgetInfo, WidgetType};

use super::axis::places;
use super::controls::{number, panel, sides, slider, toggle};
use super::spectrum::{curve, swatch};
use crate::document::Mixing;
use crate::document::{Document, Edit, in_colour, shown_colour};
use crate::plan::Stale;
use crate::scene::{AmbientShares, BRIGHTEST, Lighting, Orders, Placement, Scene, SceneLight, Shading};
use crate::view::action::Action;

/// Shows the light panel.
pub fn show(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    panel(ui, "Lights", Stale::Picture, |ui| {
        let state = document.state();
        let shares = state.shares();
        if state.scene.lights.is_empty() {
            ui.label("The scene has no lights.");
        }
        for (index, light) in state.scene.lights.iter().enumerate() {
            let share = shares.get(index).copied().unwrap_or(0.0);
            let stated = state.light.sliders.get(index);
            let by_slider = state.light.mixing == Mixing::Sliders;
            let other_alone = state.light.solo.is_some_and(|alone| alone != index);
            let switch = |ui: &mut Ui| {
                let chosen = colour(ui, &state.scene, light);
                if let Some(code) = chosen {
                    return Some(Action::Edit(Edit::LightColour(index, code)));
                }
                let mut on = if by_slider { stated.is_some_and(|slider| slider.on) } else { share > 0.0 };
                let name = RichText::new(&light.name).strong();
                let switch = ui.add_enabled(by_slider && !other_alone, Checkbox::new(&mut on, name));
                let switch =
                    switch.on_hover_text("Switches this light on and off.").on_disabled_hover_text(if by_slider {
                        "Another light is on solo: press its solo again for all lights."
                    } else {
                        "The dial mixes the lights and ignores the switches. Move a slider or press solo to mix by sliders."
                    });
                switch.changed().then_some(Action::Edit(Edit::On(index, on)))
            };
            let solo = |ui: &mut Ui| {
                let alone = state.light.solo == Some(index) && by_slider;
                let solo = toggle(ui, alone, "solo").on_hover_text("This light alone, or all lights again.");
                curve(ui, light.spectrum.spectrum(), Vec2::new(56.0, 16.0)).on_hover_ui(|ui| {
                    ui.label(format!("{}: power from 380 to 780 nm", light.name));
                    curve(ui, light.spectrum.spectrum(), Vec2::new(260.0, 90.0));
                });
                solo.clicked().then(|| Action::Edit(Edit::Solo((!alone).then_some(index))))
            };
            sides(ui, asked, switch, solo);
            // Under the dial, the slider shows the dial's weight; moving it switches to the sliders.
            let mut weight = if by_slider { stated.map_or(0.0, |slider| slider.weight) } else { share };
            let strength = |ui: &mut Ui| {
                ui.spacing_mut().slider_width = ui.available_width() - 62.0;
                let moved = slider(ui, &mut weight, 0.0..=2.0, 2, |slider| slider.fixed_decimals(2))
                    .on_hover_text("Strength of the light, as a multiple of its intensity in the scene.");
                name(&moved, &format!("{}: strength", light.name), weight);
                moved.changed().then_some(Action::Edit(Edit::Weight(index, weight)))
            };
            let shadows = |ui: &mut Ui| {
                // A single value of a ray has none; those that are on can be switched off.
                if state.scene.blending.is_extreme() && !light.shadows {
                    return None;
                }
                let shadows = toggle(ui, light.shadows, "shadows").on_hover_text(
                    "Shadows: the medium between a sample and this light dims it. This marches the volume again.",
                );
                shadows.clicked().then_some(Action::Edit(Edit::Shadows(index, !light.shadows)))
            };
            sides(ui, asked, strength, shadows);
        }
        let (mut normalise, mut master) = state.master();
        let (whose, help) = match state.light.mixing {
            Mixing::Sliders => (
                "master and brightness: kept by the sliders",
                "A white surface has the same brightness under every mix of the sliders. The dial has a switch of its own.",
            ),
            Mixing::Dial => (
                "master and brightness: kept by the dial",
                "A white surface has the same brightness at every position of the hand. The sliders have a switch of their own.",
            ),
        };
        ui.horizontal(|ui| {
            ui.label("Master").on_hover_text("Strength of all lights together.");
            let dragged = number(ui, &mut master, 3, |drag| drag.speed(0.01).range(0.0..=BRIGHTEST))
                .on_hover_text("Drag, or type a number.");
            name(&dragged, "master", master);
            if dragged.changed() {
                asked.push(Action::Edit(Edit::Master(master)));
            }
            let keep = ui.checkbox(&mut normalise, "keep brightness");
            if keep.on_hover_text(help).changed() {
                asked.push(Action::Edit(Edit::Normalise(normalise)));
            }
        });
        ui.label(RichText::new(whose).small().weak()).on_hover_text(
            "The sliders and the dial each have a master and a switch; these belong to the one that mixes.",
        );
        let shades = state.scene.shading == Shading::Gradient && !state.scene.blending.is_extreme();
        if shades {
            shaded_sides(ui, state.scene.lighting, asked);
            ambient_shares(ui, state.scene.shadows.ambient, asked);
        }
        if !state.scene.blending.is_extreme() {
            scattered_light(ui, state.scene.scattering.orders, asked);
        }
        let sky = |light: &SceneLight| light.shadows && light.placement == Placement::Ambient;
        let occluded = shades && state.scene.shadows.ambient == AmbientShares::Occluded;
        if occluded || state.scene.lights.iter().any(sky) {
            reach(ui, &state.scene, asked);
        }
    });
}

/// The colour of a light: of what it shows alone, which another one can take, or of the light itself. Returns a new colour.
fn colour(ui: &mut Ui, scene: &Scene, light: &SceneLight) -> Option<[u8; 3]> {
    let surfaces = || scene.materials.iter().map(|material| material.reflectance.spectrum());
    let shown = shown_colour(&light.spectrum, surfaces());
    let can_change = shown.is_some() && in_colour(&light.spectrum, surfaces(), [1.0; 3]).is_some();
    let Some(mut code) = shown.filter(|_| can_change) else {
        swatch(ui, &light.spectrum, &scene.display, 16.0)
            .on_hover_text("Colour of the light on the display, at full brightness.");
        return None;
    };
    ui.spacing_mut().interact_size = Vec2::splat(16.0);
    let before = code;
    let button = ui.color_edit_button_srgb(&mut code);
    button.widget_info(|| WidgetInfo::labeled(WidgetType::ColorButton, true, format!("{}: colour", light.name)));
    button.on_hover_text(
        "Colour of what this light shows alone. Another one is a relight: the volume is not marched again.",
    );
    (code != before).then_some(code)
}

/// Shows the choice of the sides of surfaces that lights shade.
fn shaded_sides(ui: &mut Ui, lighting: Lighting, asked: &mut Vec<Action>) {
    ui.horizontal_wrapped(|ui| {
        ui.label("Shaded sides").on_hover_text(
            "Sides of surfaces on which headlights, directional, point and three-point lights fall. A change marches the volume again.",
        );
        let choices = [
            (Lighting::TwoSided, "both sides", "Light falls on both sides of a surface alike: for shells and thin sheets."),
            (
                Lighting::OneSided,
                "outer side",
                "Light falls on the side towards lower values alone: an object's side in shade is dark, and shows its form.",
            ),
        ];
        for (choice, name, help) in choices {
            if toggle(ui, lighting == choice, name).on_hover_text(help).clicked() && lighting != choice {
                asked.push(Action::Edit(Edit::Lighting(choice)));
            }
        }
    });
}

/// Shows whether the medium dims the ambient shares of directed lights.
fn ambient_shares(ui: &mut Ui, shares: AmbientShares, asked: &mut Vec<Action>) {
    let mut occluded = shares == AmbientShares::Occluded;
    let switch = ui.checkbox(&mut occluded, "ambient occlusion").on_hover_text(
        "Hollows and inner parts get less of the ambient light that headlights, directional, point and three-point lights bring along. A change marches the volume again, and sums the light of a sky first.",
    );
    if switch.changed() {
        let shares = if occluded { AmbientShares::Occluded } else { AmbientShares::Open };
        asked.push(Action::Edit(Edit::AmbientShares(shares)));
    }
}

/// Shows whether light scatters more than once.
fn scattered_light(ui: &mut Ui, orders: Orders, asked: &mut Vec<Action>) {
    let mut multiple = orders == Orders::Multiple;
    let switch = ui.checkbox(&mut multiple, "scattered light").on_hover_text(
        "Light scatters any number of times, as in wax, milk and tissue, and every light casts shadows. A change marches the volume again, and gathers this light first; other colours of lights do not.",
    );
    if switch.changed() {
        asked.push(Action::Edit(Edit::Orders(if multiple { Orders::Multiple } else { Orders::Single })));
    }
}

/// First reach of a sky, as a part of the volume's diagonal.
const FIRST_REACH: f64 = 0.1;

/// Shows the distance beyond which nothing dims the sky.
fn reach(ui: &mut Ui, scene: &Scene, asked: &mut Vec<Action>) {
    let help = "Distance from a sample, in world units, beyond which nothing takes its ambient light: with a short one only creases and narrow gaps are dark; without one, wide hollows too. A change marches the volume again, and sums the light of a sky first.";
    let (least, longest) = (scene.least_reach(), scene.frame.geometry.extent().length());
    ui.horizontal(|ui| {
        let mut limited = scene.shadows.reach.is_some();
        if ui.checkbox(&mut limited, "occlusion ends after").on_hover_text(help).changed() {
            asked.push(Action::Edit(Edit::Reach(limited.then_some((FIRST_REACH * longest).max(least)))));
        }
        if let Some(mut reach) = scene.shadows.reach {
            let decimals = places(longest);
            let speed = 0.005 * longest;
            let dragged = number(ui, &mut reach, decimals, |drag| drag.speed(speed).range(least..=longest.max(least)));
            name(&dragged, "reach of the sky", reach);
            if dragged.on_hover_text(help).changed() {
                asked.push(Action::Edit(Edit::Reach(Some(reach))));
            }
        }
    });
}

/// Names a number for screen readers and tests.
fn name(response: &egui::Response, of: &str, value: f64) {
    response.widget_info(|| WidgetInfo::slider(true, value, of));
}
