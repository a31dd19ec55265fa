//! Probe: details of the pixel under the crosshair, over the picture.

use egui::{Color32, Grid, Id, Key, Label, Rect, RichText, ScrollArea, Sense, Stroke, StrokeKind, Ui, pos2, vec2};

use glam::DVec3;

use super::spectrum::{code, narrow, patch, plot};
use super::transfer::colours;
use super::{Shown, floating};
use crate::document::Document;
use crate::number::{brief_in, readable};
use crate::scene::Scene;
use crate::spectrum::colour::Lab;
use crate::view::action::Action;
use crate::view::probe::{Lit, Probe, Share, Stretch};
use crate::view::slices::index_from_world;

/// Sum of the pixel shares above which a note is shown, as a multiple of the pixel.
const MORE_THAN_ALL: f64 = 1.002;
/// Width of the contents in points.
const WIDTH: f32 = 300.0;

/// Shows the crosshair on the `picture`, and the probe window in the rectangle `rect` around it.
pub(super) fn show(ui: &Ui, shown: &Shown<'_>, [picture, rect]: [Rect; 2], asked: &mut Vec<Action>) {
    let (Some((place, probe)), Some(document)) = (shown.probe, shown.document) else { return };
    let at = picture.min + vec2(narrow(place.x), narrow(place.y)) * picture.size();
    for (width, colour) in [(3.0, Color32::BLACK), (1.0, Color32::WHITE)] {
        ui.painter().circle_stroke(at, 6.0, Stroke::new(width, colour));
    }
    // Opens away from the probed pixel, and stays where it is or where the user moves it.
    let right = (rect.right() - WIDTH - 30.0).max(rect.left());
    let left = if at.x + 20.0 > right { rect.left() + 8.0 } else { right };
    // A window as wide as the picture covers only the half without the pixel.
    let narrow_picture = rect.width() < 1.5 * WIDTH;
    let height = if narrow_picture { 0.5 * rect.height() } else { rect.height() };
    let top = if narrow_picture && at.y < rect.center().y { rect.center().y } else { rect.top() + 8.0 };
    let height = (height - 60.0).max(80.0);
    let size = vec2(WIDTH, height + 40.0);
    let open = floating::show(ui, ("Probe", Id::new("Probe")), rect, (pos2(left, top), size), |ui| {
        // The minimum size lets the area grow again after the window was smaller.
        let area = ScrollArea::vertical().max_height(height).min_scrolled_height(height);
        area.show(ui, |ui| {
            ui.set_width(WIDTH);
            match probe {
                None => drop(ui.label("Waiting for the picture.")),
                Some(probe) => contents(ui, document, probe),
            }
        });
    });
    if !open || !shown.chooses && ui.input(|input| input.key_pressed(Key::Escape)) {
        asked.push(Action::Probe(None));
    }
}

fn contents(ui: &mut Ui, document: &Document, probe: &Probe) {
    let [[x, y], [width, height]] = [probe.place, probe.size];
    ui.horizontal(|ui| {
        patch(ui, &probe.now.shown.code(), 34.0).on_hover_text("Present colour of the pixel.");
        ui.vertical(|ui| {
            ui.label(RichText::new(format!("{}   {}", probe.now.shown.code(), lab(&probe.now))).monospace())
                .on_hover_text(
                    "The pixel as a web colour, and in CIE L*a*b*: lightness, green to red, blue to yellow.",
                );
            ui.label(
                RichText::new(format!(
                    "pixel {x}, {y} of {width}×{height}; {:.1} % transmitted",
                    100.0 * probe.transmittance
                ))
                .small(),
            )
            .on_hover_text("Fraction of the light from behind the volume that reaches the eye here.");
        });
    });
    spectra(ui, probe);
    section(
        ui,
        "Under each light",
        "The pixel under each light alone, at its intensity in the scene: CIE L*a*b*, and its error in ΔE00 (1 is just visible). The truth is this pixel with full spectra in double precision, at an eighth of the step.",
    );
    Grid::new("lights").num_columns(4).min_col_width(14.0).spacing([8.0, 3.0]).show(ui, |ui| {
        for lit in std::iter::once(&probe.now).chain(&probe.lights) {
            patch(ui, &lit.shown.code(), 14.0);
            ui.label(&lit.name);
            ui.label(RichText::new(lab(lit)).small().monospace());
            error(ui, lit, probe.level.is_some());
            ui.end_row();
        }
    });
    let colours = colours(document.state());
    let of = |name: &str| {
        let materials = &document.state().scene.materials;
        let found = materials.iter().position(|material| material.name == name);
        found.and_then(|index| colours.get(index)).copied()
    };
    if !probe.shares.is_empty() {
        section(
            ui,
            "What it shows",
            "Share of each material in the pixel, and in its present brightness, which is smaller for parts in the shade. The shares of the light add up to 100 %. Voxels without a label get materials by their value: edges have intermediate values, and \
             thus materials that the object does not have.",
        );
        shares(ui, ["shares", "of the pixel", "of its light"], &probe.shares, of);
        if probe.shares.iter().filter_map(|share| share.seen).sum::<f64>() > MORE_THAN_ALL {
            let text = "The sum exceeds the pixel: X-ray materials hide nothing behind them.";
            ui.label(RichText::new(text).small().weak());
        }
    } else if !probe.seen.is_empty() {
        section(
            ui,
            "What it shows",
            "This picture stores coefficients of a colour model, which do not separate materials: the shares come from the ray, without shading.",
        );
        let materials = document.state().scene.materials.iter().map(|material| &material.name);
        for (name, seen) in materials.zip(&probe.seen).filter(|(_, seen)| **seen > 0.0005) {
            ui.horizontal(|ui| {
                bar(ui, *seen, of(name).unwrap_or(Color32::GRAY));
                ui.label(name);
                ui.label(percent(*seen));
            });
        }
    }
    absorbers(ui, document, probe, &colours);
    if probe.positions.len() > 1 {
        section(
            ui,
            "Where its light comes from",
            "Share of each light position in the present brightness of the pixel.",
        );
        shares(ui, ["positions", "", "of its light"], &probe.positions, |_| None);
    }
    section(
        ui,
        "Along the ray",
        "From the eye: the thin line is the data value, bars are opacities in the colours of the materials, and the falling line is the transmittance.",
    );
    if let Some(voxels) = probe.level {
        let text = format!(
            "The ray goes through the coarse level in memory, means of {voxels} voxels. The errors of the colours are unknown."
        );
        ui.label(RichText::new(text).small());
    }
    match probe.ray.as_deref() {
        None => {
            ui.label(RichText::new("marching the ray …").small().weak());
        }
        Some([]) => {
            ui.label(RichText::new("The ray misses the volume, or its shown part.").small());
        }
        Some(stretches) => {
            ray(ui, document, stretches, &colours);
            if let Some(stretch) = probe.brightest() {
                let (place, value) = (place(document, stretch), told_value(document, stretch.value));
                let others = others(&document.state().scene, stretch.place);
                let first = &document.state().scene.fields.first().name;
                let values =
                    if others.is_empty() { format!("the value {value}") } else { format!("{first} {value}, {others}") };
                let text = format!("Most of the light comes from {values}, at {place}.");
                ui.label(RichText::new(text).small());
            }
        }
    }
}

/// Materials that absorb light on its path to the eye.
fn absorbers(ui: &mut Ui, document: &Document, probe: &Probe, colours: &[Color32]) {
    let materials = document.state().scene.materials.iter().zip(colours).zip(&probe.absorbed);
    let taking: Vec<_> = materials.filter(|(_, taken)| **taken > 0.0005).collect();
    if taking.is_empty() {
        return;
    }
    section(
        ui,
        "What colours its light",
        "Materials that absorb along the ray, and the share of the light towards the eye that each absorbs. They are visible by \
         the light that they transmit, even if they reflect none.",
    );
    for ((material, &colour), &taken) in taking {
        ui.horizontal(|ui| {
            bar(ui, taken, colour);
            ui.label(&material.name);
            ui.label(percent(taken));
            ui.label(RichText::new("absorbed").small().weak());
        });
    }
}

fn section(ui: &mut Ui, title: &str, help: &str) {
    ui.add_space(6.0);
    ui.label(RichText::new(title).strong()).on_hover_text(help);
}

fn lab(lit: &Lit) -> String {
    let Lab([l, a, b]) = lit.shown.lab();
    // Adding 0 removes the sign of −0.
    let [l, a, b] = [l, a, b].map(|number| (10.0 * number).round() / 10.0 + 0.0);
    format!("Lab {l:5.1} {a:6.1} {b:6.1}")
}

/// Error of a colour. It stays unknown if the ray was marched in a coarse level of the volume.
fn error(ui: &mut Ui, lit: &Lit, unknown: bool) {
    match lit.error {
        None if unknown => ui.label(RichText::new("ΔE ?").small().weak()),
        None => ui.label(RichText::new("ΔE …").small().weak()),
        Some(error) => {
            let help = format!(
                "{:.4} from the truth in total; {:.4} from full spectra at the same step, which is the error of the colour model, tables and rounding.",
                error.all, error.model
            );
            ui.label(RichText::new(format!("ΔE {:.2}", error.all)).small()).on_hover_text(help)
        }
    };
}

fn spectra(ui: &mut Ui, probe: &Probe) {
    let (strong, weak) = (ui.visuals().strong_text_color(), blue(ui));
    let (Some(spectrum), Some(reflectance)) = (&probe.spectrum, &probe.reflectance) else {
        ui.label(RichText::new("reconstructing spectra from the colour model …").small().weak());
        return;
    };
    // Power and reflectance have different units, so the curves are scaled to equal height.
    let most =
        |spectrum: &crate::spectrum::Spectrum| spectrum.samples().iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let scaled = spectrum.scaled(most(reflectance) / most(spectrum));
    let scaled = if scaled.is_finite() { scaled } else { spectrum.clone() };
    plot(ui, &[(reflectance, weak), (&scaled, strong)], vec2(WIDTH, 74.0)).on_hover_text(
        "Light from this pixel per wavelength, reflected or transmitted. Blue: under equal-energy light, as a fraction of it. White \
         or black: under the present light, scaled to the same height.",
    );
    ui.horizontal(|ui| {
        ui.label(RichText::new("blue: fraction of equal-energy light").small().color(weak));
        ui.label(
            RichText::new(format!("{}: present light", if ui.visuals().dark_mode { "white" } else { "black" })).small(),
        );
    });
    if let Some(rms) = probe.spectral_error {
        let text = format!("reconstructed from a colour model: mean error {:.2} %", 100.0 * rms);
        ui.label(RichText::new(text).small().weak());
    }
}

/// Second curve colour.
fn blue(ui: &Ui) -> Color32 {
    if ui.visuals().dark_mode { Color32::from_rgb(120, 150, 220) } else { Color32::from_rgb(30, 70, 170) }
}

fn percent(part: f64) -> RichText {
    RichText::new(format!("{:5.1} %", 100.0 * part + 0.0)).small().monospace()
}

fn bar(ui: &mut Ui, part: f64, colour: Color32) {
    let (rect, _) = ui.allocate_exact_size(vec2(60.0, 12.0), Sense::hover());
    let visuals = ui.visuals();
    let (ground, outline) = (visuals.extreme_bg_color, Stroke::new(1.0, visuals.weak_text_color()));
    ui.painter().rect_filled(rect, 2.0, ground);
    let filled = Rect::from_min_size(rect.min, vec2(rect.width() * narrow(part.clamp(0.0, 1.0)), rect.height()));
    ui.painter().rect(filled, 2.0, colour, outline, StrokeKind::Inside);
}

/// Shows the parts of the pixel with their share of it, if known, and of its light.
fn shares(ui: &mut Ui, [id, pixel, light]: [&str; 3], shares: &[Share], colour: impl Fn(&str) -> Option<Color32>) {
    // Limits the width of long names.
    Grid::new(id).num_columns(4).spacing([8.0, 3.0]).max_col_width(88.0).show(ui, |ui| {
        for head in ["", "", pixel, light] {
            ui.label(RichText::new(head).small().weak());
        }
        ui.end_row();
        for share in shares {
            bar(ui, share.light, colour(&share.name).unwrap_or(Color32::LIGHT_GRAY));
            ui.add(Label::new(&share.name).truncate());
            match share.seen {
                Some(seen) => ui.label(percent(seen)).on_hover_text(
                    "Share of the pixel, regardless of shading. The sum may exceed 100 %, because X-ray materials hide nothing.",
                ),
                None => ui.label(""),
            };
            ui.label(percent(share.light)).on_hover_text("Share of the brightness of the pixel.");
            ui.end_row();
        }
    });
}

fn ray(ui: &mut Ui, document: &Document, stretches: &[Stretch], colours: &[Color32]) {
    let (frame, response) = ui.allocate_exact_size(vec2(WIDTH, 64.0), Sense::hover());
    let rect = frame.shrink2(vec2(0.0, 2.0));
    let visuals = ui.visuals().clone();
    let painter = ui.painter_at(frame);
    painter.rect_filled(frame, 2.0, visuals.extreme_bg_color);
    let length = stretches.last().map_or(1.0, |last| last.distance).max(f64::MIN_POSITIVE);
    let [low, high] = document.statistics().map_or_else(|| range(stretches), |known| [known.min, known.max]);
    let x = |distance: f64| rect.left() + narrow(distance / length).clamp(0.0, 1.0) * rect.width();
    let y = |part: f64| rect.bottom() - narrow(part.clamp(0.0, 1.0)) * rect.height();
    let width = (rect.width() / narrow(crate::number::count(stretches.len()))).max(1.0);
    for stretch in stretches.iter().filter(|stretch| stretch.opacity > 0.0) {
        let left = x(stretch.distance) - width / 2.0;
        let column = Rect::from_x_y_ranges(left..=left + width + 0.5, y(stretch.opacity.sqrt())..=rect.bottom());
        painter.rect_filled(column, 0.0, mixed(stretch, colours));
    }
    let line = |part: &dyn Fn(&Stretch) -> f64| stretches.iter().map(|it| pos2(x(it.distance), y(part(it)))).collect();
    let span = if high > low { high - low } else { 1.0 };
    // With an outline, because the bars have any colour.
    for (width, colour) in [(3.0, visuals.extreme_bg_color), (1.0, visuals.text_color())] {
        painter.line(line(&|stretch| (stretch.value - low) / span), Stroke::new(width, colour));
    }
    painter.line(line(&|stretch| stretch.transmittance), Stroke::new(1.5, Color32::from_rgb(230, 140, 40)));
    if let Some(pointer) = response.hover_pos() {
        let part = f64::from((pointer.x - rect.left()) / rect.width());
        let near = |stretch: &&Stretch| ((stretch.distance / length - part).abs() * 1e9).min(1e18);
        if let Some(stretch) = stretches.iter().min_by(|one, two| near(one).total_cmp(&near(two))) {
            painter.vline(x(stretch.distance), rect.y_range(), Stroke::new(0.5, visuals.weak_text_color()));
            response.on_hover_text(told(document, stretch));
        }
    }
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let materials = &document.state().scene.materials;
        for (index, (material, &colour)) in materials.iter().zip(colours).enumerate() {
            let depth = |of: &[f64]| of.get(index).is_some_and(|depth| *depth > 0.0);
            if stretches.iter().any(|stretch| depth(&stretch.scattering) || depth(&stretch.absorption)) {
                patch(ui, &code(colour), 9.0);
                ui.label(RichText::new(&material.name).small());
            }
        }
    });
    let [from, to] = [low, high].map(|value| told_value(document, value));
    let text = format!(
        "thin line: value, {from} to {to}, over {length:.1} units of the file, such as mm; orange: transmittance"
    );
    ui.label(RichText::new(text).small().weak());
}

fn range(ray: &[Stretch]) -> [f64; 2] {
    let values = || ray.iter().map(|stretch| stretch.value);
    [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]
}

/// Mean colour of the materials of a stretch, weighted by their optical depths.
fn mixed(stretch: &Stretch, colours: &[Color32]) -> Color32 {
    let depths: Vec<f64> = stretch.scattering.iter().zip(&stretch.absorption).map(|(one, other)| one + other).collect();
    let all: f64 = depths.iter().sum();
    let channel = |of: fn(&Color32) -> u8| {
        let sum: f64 = (depths.iter().zip(colours))
            .map(|(depth, colour)| depth / all.max(f64::MIN_POSITIVE) * f64::from(of(colour)))
            .sum();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a mean of bytes is a byte")]
        let byte = sum.round().clamp(0.0, 255.0) as u8;
        byte
    };
    Color32::from_rgb(channel(Color32::r as fn(&Color32) -> u8), channel(|it| it.g()), channel(|it| it.b()))
}

/// Text of a stretch's position in world coordinates and voxels.
fn place(document: &Document, stretch: &Stretch) -> String {
    let world = document.state().scene.frame.geometry.world_from_index(stretch.place);
    let [x, y, z] = world.to_array().map(|along| readable(format!("{along:.3e}").parse().unwrap_or(along)));
    // Adding 0 removes the sign of −0.
    let [i, j, k] = stretch.place.to_array().map(|along| along.round() + 0.0);
    format!("{x} {y} {z} (near voxel {i} {j} {k})")
}

/// Names and values of further fields at the voxel around a place of the first, in voxel indices.
fn others(scene: &Scene, place: DVec3) -> String {
    let world = scene.frame.geometry.world_from_index(place);
    let told = scene.fields.further().iter().filter_map(|field| {
        let volume = field.at_hand().0;
        let [width, height, depth] = volume.geometry.dims;
        let nearest = index_from_world(&volume.geometry, world).round();
        let last = DVec3::from_array([width, height, depth].map(crate::number::count)) - 1.0;
        if nearest.cmplt(DVec3::ZERO).any() || nearest.cmpgt(last).any() {
            return Some(format!("no {}", field.name));
        }
        let [x, y, z] = nearest.to_array().map(crate::number::Real::index);
        let value = volume.voxels.value(x + width * (y + height * z))?.mul_add(volume.slope, volume.intercept);
        let statistics = field.statistics();
        Some(format!("{} {}", field.name, brief_in(value, statistics.max - statistics.min)))
    });
    told.collect::<Vec<_>>().join(", ")
}

/// A value of the volume, with the digits that tell its values apart.
fn told_value(document: &Document, value: f64) -> String {
    let span = document.statistics().map_or(f64::INFINITY, |it| it.max - it.min);
    brief_in(value, span)
}

fn told(document: &Document, stretch: &Stretch) -> String {
    let materials = &document.state().scene.materials;
    let named = |depths: &[f64], does: &str| {
        let there = materials.iter().zip(depths).filter(|(_, depth)| **depth > 0.0);
        let names: Vec<&str> = there.map(|(material, _)| material.name.as_str()).collect();
        (!names.is_empty()).then(|| format!("{does} {}", names.join(", ")))
    };
    let shown = [named(&stretch.scattering, "shows"), named(&stretch.absorption, "is coloured by")];
    let shown: Vec<String> = shown.into_iter().flatten().collect();
    let shown = if shown.is_empty() { "shows nothing".to_owned() } else { shown.join(" and ") };
    format!(
        "At {:.2}, {}: value {}, which {shown}. Opacity {:.2} %; transmittance up to here {:.2} %.",
        stretch.distance,
        place(document, stretch),
        told_value(document, stretch.value),
        100.0 * stretch.opacity,
        100.0 * stretch.transmittance
    )
}
