//! The spectra panel: what materials and lights are made of, and standards that can take their place.

use std::sync::Arc;

use egui::{ComboBox, RichText, Ui, vec2};

use super::accuracy::Effort;
use super::controls::panel;
use super::spectrum::{curve, plot};
use crate::scene::Scene;
use crate::spectrum::{Kind, Spectrum, standard};
use crate::view::action::Action;
use crate::view::design::{Side, Spectra};
use crate::view::state::{Cost, Document, Edit};

/// Shows the spectra panel.
pub(super) fn show(ui: &mut Ui, document: &Document, effort: Effort<'_>, asked: &mut Vec<Action>) {
    let fitted = effort.planned.is_some_and(|planned| planned.model.is_some());
    panel(ui, "Spectra", if fitted { Cost::March } else { Cost::Relight }, |ui| {
        let (scene, opened) = (&document.state().scene, document.opened());
        for (now, then) in scene.materials.iter().zip(&opened.materials) {
            let back = (now.reflectance.spectrum(), then.reflectance.spectrum());
            row(ui, scene, opened, Side::Material, &now.name, back, asked);
        }
        ui.separator();
        for (now, then) in scene.lights.iter().zip(&opened.lights) {
            row(ui, scene, opened, Side::Light, &now.name, (now.spectrum.spectrum(), then.spectrum.spectrum()), asked);
        }
    });
}

fn row(
    ui: &mut Ui,
    scene: &Scene,
    opened: &Scene,
    side: Side,
    name: &str,
    (now, then): (&Spectrum, &Spectrum),
    asked: &mut Vec<Action>,
) {
    ui.horizontal(|ui| {
        curve(ui, now, vec2(56.0, 16.0)).on_hover_ui(|ui| {
            ui.label(format!("{name}, from 380 to 780 nm"));
            plot(ui, &[(now, ui.visuals().strong_text_color())], vec2(260.0, 90.0));
        });
        ui.label(format!("{name}:"));
        ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
            let kind = if side == Side::Light { Kind::Light } else { Kind::Reflectance };
            let of = |standard: &&&str| {
                let found = Spectra::standard(scene, side, name, standard).unwrap_or_default();
                let spectrum = found.materials.first().map(|(_, it)| it.spectrum());
                spectrum.or(found.lights.first().map(|(_, it)| it.spectrum())) == Some(now)
            };
            let known = standard::names(kind).iter().find(of).copied();
            let shown = known.unwrap_or("its own");
            let combo = ComboBox::from_id_salt((kind == Kind::Light, name))
                .width(116.0)
                .selected_text(RichText::new(shown).small());
            combo.show_ui(ui, |ui| {
                if ui.selectable_label(now == then, "as the scene has it").clicked() {
                    asked.push(Action::Edit(Edit::Spectra(Arc::new(Spectra::of_scene(opened, side, name)))));
                }
                for &standard in standard::names(kind) {
                    if ui.selectable_label(known == Some(standard), standard).clicked()
                        && let Ok(spectra) = Spectra::standard(scene, side, name, standard)
                    {
                        asked.push(Action::Edit(Edit::Spectra(Arc::new(spectra))));
                    }
                }
            });
        });
    });
}
