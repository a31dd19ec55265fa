//! Spectra panel: the spectra of materials and lights, and standard spectra to replace them.

use std::ops::RangeInclusive;
use std::sync::Arc;

use egui::{ComboBox, Id, Rect, RichText, Sense, Slider, Stroke, Ui, Vec2, WidgetInfo, WidgetType, pos2, vec2};

use super::accuracy::Effort;
use super::controls::{number, panel, sides};
use super::spectrum::{curve, narrow, plot, strip};
use crate::document::design::{BANDS_PER_HANDLE, HANDLES, Side, Spectra};
use crate::document::{Document, Edit};
use crate::number::count;
use crate::plan::Stale;
use crate::scene::{Material, PHASES, Scene, Shading};
use crate::spectrum::{
    Absorption, BANDS, INDICES, Kind, Layers, Spectrum, THICKNESSES, ThinFilm, ThinFilmAngle, standard, wavelength_nm,
};
use crate::view::action::Action;

/// egui key of the name of the material whose curve is edited.
const DRAWN: &str = "spectra: drawn";

/// Material whose curve is edited.
fn drawn_material(ui: &Ui) -> Option<String> {
    ui.data(|data| data.get_temp::<Option<String>>(Id::new(DRAWN))).flatten()
}

/// Spectrum of material `index` as a curve from 0 to 1, with handles to drag up and down.
fn handles(ui: &mut Ui, index: usize, name: &str, now: &Spectrum, asked: &mut Vec<Action>) {
    let (frame, _) = ui.allocate_exact_size(vec2(ui.available_width().min(264.0), 116.0), Sense::hover());
    let (rect, below) = frame.split_top_bottom_at_y(frame.bottom() - 16.0);
    ui.painter().rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let inner = rect.shrink(5.0);
    let place = |band: usize, sample: f64| {
        let (x, y) = (narrow(count(band) / count(BANDS - 1)), narrow(sample.clamp(0.0, 1.0)));
        pos2(inner.left() + x * inner.width(), inner.bottom() - y * inner.height())
    };
    let line = now.samples().iter().enumerate().map(|(band, &sample)| place(band, sample)).collect();
    ui.painter().line(line, Stroke::new(1.5, ui.visuals().strong_text_color()));
    strip(ui, inner.x_range(), below);
    let before = Id::new((DRAWN, "before"));
    for handle in 0..HANDLES {
        let band = handle * BANDS_PER_HANDLE;
        let at = place(band, now.samples()[band]);
        let touch = Rect::from_center_size(at, Vec2::splat(13.0));
        let response = ui.interact(touch, Id::new((DRAWN, name, handle)), Sense::drag());
        let nm = wavelength_nm(band);
        let label = format!("{name} at {nm} nm");
        response.widget_info(|| WidgetInfo::labeled(WidgetType::Slider, true, &label));
        if response.drag_started() {
            ui.data_mut(|data| data.insert_temp(before, now.clone()));
        }
        if let (true, Some(pointer)) = (response.dragged(), response.interact_pointer_pos())
            && let Some(was) = ui.data(|data| data.get_temp::<Spectrum>(before))
        {
            let value = f64::from((inner.bottom() - pointer.y) / inner.height());
            asked.push(Action::Edit(Edit::Spectra(Arc::new(Spectra::drawn(index, &was, handle, value)))));
        }
        let held = response.hovered() || response.dragged();
        ui.painter().circle_filled(at, if held { 5.0 } else { 3.5 }, ui.visuals().selection.bg_fill);
        ui.painter().circle_stroke(
            at,
            if held { 5.0 } else { 3.5 },
            Stroke::new(1.0, ui.visuals().strong_text_color()),
        );
        response.on_hover_text(format!("{nm} nm: reflectance {:.3}. Drag up or down.", now.samples()[band]));
    }
}

/// Stage that a spectrum makes stale: the march only if a colour model is fitted.
pub(super) fn stale(effort: Effort<'_>) -> Stale {
    let fitted = effort.planned.is_some_and(|planned| planned.model.is_some());
    if fitted { Stale::Tables } else { Stale::Picture }
}

/// Shows the spectra panel.
pub(super) fn show(ui: &mut Ui, document: &Document, effort: Effort<'_>, asked: &mut Vec<Action>) {
    panel(ui, "Spectra", stale(effort), |ui| {
        let (scene, opened) = (&document.state().scene, &document.opened().scene);
        for (index, (now, then)) in scene.materials.iter().zip(&opened.materials).enumerate() {
            let back = (now.reflectance.spectrum(), then.reflectance.spectrum());
            row(ui, scene, opened, Side::Material, &now.name, back, asked);
            if let Some(absorption) = &now.absorption {
                absorbed(ui, &now.name, absorption);
            }
            if scene.shading == Shading::None {
                phase(ui, index, now, asked);
            } else if now.diffuse > 0.0 || now.specular > 0.0 {
                film(ui, index, now, asked);
            }
            if drawn_material(ui).as_deref() == Some(&now.name) {
                handles(ui, index, &now.name, back.0, asked);
            }
        }
        ui.separator();
        for (now, then) in scene.lights.iter().zip(&opened.lights) {
            row(ui, scene, opened, Side::Light, &now.name, (now.spectrum.spectrum(), then.spectrum.spectrum()), asked);
        }
    });
}

/// Slider of a material's phase function.
fn phase(ui: &mut Ui, index: usize, material: &Material, asked: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.label(RichText::new("scatters").small());
        let mut phase = material.phase;
        let help = "Where the material scatters light: at 0 evenly in all directions, above 0 forwards, so that light from behind shines through, and below 0 backwards, to where it came from. A change marches the volume again.";
        let slider = ui.add(Slider::new(&mut phase, PHASES).step_by(0.01).show_value(false)).on_hover_text(help);
        slider.widget_info(|| WidgetInfo::slider(true, phase, format!("{}: phase function", material.name)));
        let field = number(ui, &mut phase, 2, |drag| drag.speed(0.01).range(PHASES)).on_hover_text(help);
        field.widget_info(|| WidgetInfo::slider(true, phase, format!("{}: phase function, as a number", material.name)));
        if slider.changed() || field.changed() {
            asked.push(Action::Edit(Edit::Phase(index, phase)));
        }
    });
}

/// Part of the light that a film reflects, in words; `None` is no film.
const FILMS: [(Option<ThinFilmAngle>, &str); 3] = [
    (None, "none"),
    (Some(ThinFilmAngle::Facing), "in the diffuse light"),
    (Some(ThinFilmAngle::Lobe), "in the highlights"),
];

/// Layers of a film that is added: soapy water in air.
const ADDED: Layers = Layers { index: 1.33, thickness_nm: 400.0, above: 1.0, below: 1.0 };

/// Controls of a material's thin film.
fn film(ui: &mut Ui, index: usize, material: &Material, asked: &mut Vec<Action>) {
    let now = material.film.as_ref();
    let (mut layers, mut angle) = (now.map_or(ADDED, ThinFilm::layers), now.map(ThinFilm::angle));
    ui.horizontal(|ui| {
        let help = "A thin film on the surface: its colours are interference, and change with the angle. In the diffuse light it takes the place of the reflectance, in the highlights that of white. A change marches the volume again.";
        ui.label(RichText::new("film").small()).on_hover_text(help);
        let name = format!("{}: film", material.name);
        let shown = FILMS.iter().find(|film| film.0 == angle).map_or("", |film| film.1);
        let possible = FILMS.iter().filter(|film| match film.0 {
            None => true,
            Some(ThinFilmAngle::Facing) => material.diffuse > 0.0,
            Some(ThinFilmAngle::Lobe) => material.specular > 0.0,
        });
        let response = ComboBox::from_id_salt(&name)
            .selected_text(RichText::new(shown).small())
            .show_ui(ui, |ui| {
                for &(film, text) in possible {
                    ui.selectable_value(&mut angle, film, text);
                }
            })
            .response
            .on_hover_text(help);
        response.widget_info(|| WidgetInfo::labeled(WidgetType::ComboBox, true, name.clone()));
    });
    if angle.is_some() {
        let layer =
            |ui: &mut Ui, key: &str, help: &str, value: &mut f64, (range, decimals): (RangeInclusive<f64>, i32)| {
                ui.label(RichText::new(key).small()).on_hover_text(help);
                let speed = if decimals == 0 { 5.0 } else { 0.01 };
                let field = number(ui, value, decimals, |drag| drag.speed(speed).range(range)).on_hover_text(help);
                field.widget_info(|| WidgetInfo::slider(true, *value, format!("{}: film, {key}", material.name)));
            };
        ui.horizontal(|ui| {
            let help = "Thickness of the film in nm";
            layer(ui, "nm", help, &mut layers.thickness_nm, (THICKNESSES, 0));
            layer(ui, "index", "Refractive index of the film: 1.33 water, 1.47 oil", &mut layers.index, (INDICES, 2));
        });
        ui.horizontal(|ui| {
            layer(
                ui,
                "above",
                "Refractive index of the medium in front of the film: 1 for air",
                &mut layers.above,
                (INDICES, 2),
            );
            layer(ui, "below", "Refractive index of the medium behind the film", &mut layers.below, (INDICES, 2));
        });
    }
    let changed = angle.map(|angle| ThinFilm::new(layers, angle)).transpose();
    // A field keeps within its range.
    if let Ok(film) = changed
        && film != material.film
    {
        asked.push(Action::Edit(Edit::Film(index, film)));
    }
}

/// Absorption curve of a material.
fn absorbed(ui: &mut Ui, name: &str, absorption: &Absorption) {
    ui.horizontal(|ui| {
        let shape = absorption.spectrum();
        curve(ui, shape, vec2(56.0, 16.0)).on_hover_ui(|ui| {
            ui.label(format!("{name}: absorption from 380 to 780 nm, relative to its peak"));
            plot(ui, &[(shape, ui.visuals().strong_text_color())], vec2(260.0, 90.0));
        });
        let help = "Transmitted light loses the wavelengths with high values; each interval sets the strength. The curve above is the reflectance.";
        ui.label(RichText::new("absorbs").small()).on_hover_text(help);
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
    let curve_and_name = |ui: &mut Ui| {
        let small = curve(ui, now, vec2(56.0, 16.0)).on_hover_ui(|ui| {
            ui.label(format!("{name}, from 380 to 780 nm"));
            plot(ui, &[(now, ui.visuals().strong_text_color())], vec2(260.0, 90.0));
            if side == Side::Material {
                ui.label(RichText::new("Click to edit the curve.").small());
            }
        });
        if side == Side::Material {
            let small = small.interact(Sense::click());
            let label = format!("draw {name}");
            small.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, &label));
            if small.clicked() {
                let drawn = drawn_material(ui).filter(|drawn| drawn == name).map_or(Some(name.to_owned()), |_| None);
                ui.data_mut(|data| data.insert_temp(Id::new(DRAWN), drawn));
            }
        }
        ui.label(format!("{name}:"));
        None
    };
    let standards = |ui: &mut Ui| {
        let kind = if side == Side::Light { Kind::Light } else { Kind::Reflectance };
        let known = standard::name_of(now, kind);
        let shown = known.unwrap_or("custom");
        let combo = ComboBox::from_id_salt((kind == Kind::Light, name))
            .width(116.0)
            .selected_text(RichText::new(shown).small());
        let mut chosen = None;
        combo.show_ui(ui, |ui| {
            if ui.selectable_label(now == then, "as in the scene").clicked() {
                chosen = Some(Spectra::of_scene(opened, side, name));
            }
            for &standard in standard::names(kind) {
                if ui.selectable_label(known == Some(standard) && now != then, standard).clicked()
                    && let Ok(spectra) = Spectra::standard(scene, side, name, standard)
                {
                    chosen = Some(spectra);
                }
            }
        });
        chosen.map(|spectra| Action::Edit(Edit::Spectra(Arc::new(spectra))))
    };
    sides(ui, asked, curve_and_name, standards);
}
