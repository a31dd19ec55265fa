//! Display panel: conversion of colours for the screen.

use egui::{ComboBox, Ui};

use super::controls::{panel, slider, toggle};
use crate::document::{Document, Edit};
use crate::plan::Stale;
use crate::scene::{Backdrop, Tone};
use crate::spectrum::deficiency::Deficiency;
use crate::spectrum::observer::Observer;
use crate::view::action::Action;

/// Shows the display panel.
pub(super) fn show(ui: &mut Ui, document: &Document, asked: &mut Vec<Action>) {
    panel(ui, "Display", Stale::Picture, |ui| {
        let display = &document.state().scene.display;
        let mut exposure = display.factor();
        ui.horizontal(|ui| {
            ui.label("Exposure");
            ui.spacing_mut().slider_width = ui.available_width() - 120.0;
            let slider = slider(ui, &mut exposure, 0.05..=20.0, 2, |slider| slider.logarithmic(true));
            if slider.on_hover_text("Factor of all colours before display.").changed() {
                asked.push(Action::Edit(Edit::Exposure(Some(exposure))));
            }
            let auto = ui
                .button("Auto")
                .on_hover_text("As bright as the screen can show the picture: its brighter parts just below white.");
            if auto.clicked() {
                asked.push(Action::Edit(Edit::Exposure(None)));
            }
        });
        let mut soft = display.tone == Tone::Soft;
        let tone = ui.checkbox(&mut soft, "soft highlights");
        let help = "On: colours near white keep their hue. Off: they are clipped. Measured colours and EXR files are without it.";
        if tone.on_hover_text(help).changed() {
            asked.push(Action::Edit(Edit::Tone(if soft { Tone::Soft } else { Tone::Linear })));
        }
        let mut dark = display.backdrop == Backdrop::Dark;
        let backdrop = ui.checkbox(&mut dark, "dark gradient behind");
        if backdrop
            .on_hover_text("Glass and dark sides stand out against it. No light changes it. Off: black.")
            .changed()
        {
            asked.push(Action::Edit(Edit::Backdrop(if dark { Backdrop::Dark } else { Backdrop::None })));
        }
        let mut adapt = display.adapt;
        let adapts = ui.checkbox(&mut adapt, "white balance");
        if adapts.on_hover_text("On: white looks white under every light. Off: tungsten light looks orange.").changed()
        {
            asked.push(Action::Edit(Edit::Adapt(adapt)));
        }
        ui.horizontal_wrapped(|ui| {
            ui.label("Colour vision");
            let mut vision = display.deficiency;
            let named = |vision: Option<Deficiency>| match vision {
                None => "normal",
                Some(Deficiency::Protan) => "protan (red-blind)",
                Some(Deficiency::Deutan) => "deutan (green-blind)",
                Some(Deficiency::Tritan) => "tritan (blue-blind)",
            };
            ComboBox::from_id_salt("colour vision").width(0.0).selected_text(named(vision)).show_ui(ui, |ui| {
                ui.selectable_value(&mut vision, None, named(None))
                    .on_hover_text("Vision with all three kinds of cones.");
                for one in Deficiency::ALL {
                    let help = match one {
                        Deficiency::Protan => "Vision without cones for long wavelengths: red is dark.",
                        Deficiency::Deutan => "Vision without cones for medium wavelengths: red and green look alike.",
                        Deficiency::Tritan => "Vision without cones for short wavelengths: blue and green look alike.",
                    };
                    ui.selectable_value(&mut vision, Some(one), named(Some(one))).on_hover_text(help);
                }
            });
            if vision != display.deficiency {
                asked.push(Action::Edit(Edit::Deficiency(vision)));
            }
        });
        ui.horizontal_wrapped(|ui| {
            ui.label("Observer");
            for observer in Observer::ALL {
                let (name, help) = match observer {
                    Observer::Cie1931 => {
                        ("2° (1931)", "CIE standard observer of 1931, for small fields such as details on a screen. D65 is white.")
                    }
                    Observer::Cie1964 => (
                        "10° (1964)",
                        "CIE standard observer of 1964, for large fields. D65 is white, too; metamers for one observer may \
                         differ for the other.",
                    ),
                };
                let button = toggle(ui, display.observer == observer, name).on_hover_text(help);
                if button.clicked() && display.observer != observer {
                    asked.push(Action::Edit(Edit::Observer(observer)));
                }
            }
        });
    });
}
