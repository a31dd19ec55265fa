//! Palette editor: the colour matrix, the targets of its cells and spectra, and the solver.

use egui::{
    Button, Color32, ComboBox, Grid, Id, LayerId, Order, ProgressBar, Rect, RichText, ScrollArea, Sense, Stroke,
    StrokeKind, Ui, WidgetInfo, WidgetType, pos2, vec2,
};

use super::controls::{number, toggle};
use super::spectrum::{curve, narrow, plot};
use super::{Shown, floating};
use crate::document::Mixing;
use crate::document::design::{Look, Side, Step, look, spectrum};
use crate::document::{Edit, State};
use crate::model::LARGEST_DIMENSION;
use crate::number::{capital, count};
use crate::palette::{Conflict, Member, ModelTerm, NATURAL, Palette, SmoothCost, Smoothing, Target, WayOut};
use crate::scene::{Display, Scene};
use crate::spectrum::colour::{Xyz, display_code, linear_srgb_from_xyz};
use crate::spectrum::observer::Observer;
use crate::view::action::Action;

/// State of the palette design.
#[derive(Clone, Copy, Debug, Default)]
pub struct Design<'a> {
    /// Whether the editor is open.
    pub shown: bool,
    /// Progress of the solver (0 to 1, if known), and its current stage.
    pub running: Option<(Option<f32>, &'a str)>,
    /// Conflicts found in the last solution.
    pub conflicts: &'a [Conflict],
    /// Costs of smoother spectra, if compared.
    pub smoother: &'a [SmoothCost],
}

/// Width of a matrix cell in points.
const WIDE: f32 = 92.0;

/// Subject of the details below the matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Chosen {
    Cell(usize, usize),
    Member(Side, usize),
}

/// Layer of the editor window.
pub(super) fn layer() -> LayerId {
    LayerId::new(Order::Middle, Id::new("palette"))
}

/// Shows the editor over the `picture`, in the rectangle `rect` around it.
pub(super) fn show(ui: &Ui, shown: &Shown<'_>, [picture, rect]: [Rect; 2], asked: &mut Vec<Action>) {
    let Some(document) = shown.document.filter(|_| shown.design.shown) else { return };
    let at = picture.left_top() + vec2(8.0, 8.0);
    // Wide enough for the columns of all lights with their names.
    let lights = document.state().palette.as_ref().map_or(0, |palette| palette.lights.len());
    let most = (140.0 + 120.0 * narrow(count(lights))).max(504.0);
    let size = vec2(most, (rect.height() - 20.0).max(80.0));
    let open = floating::show(ui, ("Palette", layer().id), rect, (at, size), |ui| {
        let height = (rect.height() - 56.0).max(80.0);
        // The minimum size lets the area grow again after the window was smaller.
        let width = (rect.width() - 40.0).clamp(80.0, most);
        let area = ScrollArea::both().max_height(height).min_scrolled_height(height).min_scrolled_width(width);
        area.show(ui, |ui| {
            ui.set_max_width(width);
            match &document.state().palette {
                None => offer(ui, shown.design, asked),
                Some(palette) => {
                    matrix(ui, document.state(), palette, asked);
                    for_whom(ui, &document.state().scene.display);
                    ui.separator();
                    details(ui, &document.state().scene, palette, asked);
                    ui.separator();
                    model(ui, palette, asked);
                    solve(ui, palette, shown.design, asked);
                    smoother(ui, palette, shown.design, asked);
                    conflicts(ui, palette, shown.design, asked);
                }
            }
        });
    });
    if !open {
        asked.push(Action::Palette(false));
    }
}

fn offer(ui: &mut Ui, design: Design<'_>, asked: &mut Vec<Action>) {
    ui.label("This scene has no palette: its spectra are independent of each other.");
    ui.label("A palette has a target colour for each material under each light. The default palette has the visible materials: under the second light they all look alike, under the first they keep their hues as far as possible.");
    if is_running(ui, design, asked) {
        return;
    }
    if ui.button("Design a palette").on_hover_text("You can change the targets before solving.").clicked() {
        asked.push(Action::Offer);
    }
}

fn step(asked: &mut Vec<Action>, step: Step) {
    asked.push(Action::Edit(Edit::Design(step)));
}

fn screen(xyz: Xyz) -> Color32 {
    Color32::from_hex(&display_code(linear_srgb_from_xyz(xyz))).unwrap_or(Color32::GRAY)
}

fn chosen(ui: &Ui) -> Option<Chosen> {
    ui.data(|data| data.get_temp(Id::new("palette: chosen")))
}

fn choose(ui: &Ui, what: Chosen) {
    ui.data_mut(|data| data.insert_temp(Id::new("palette: chosen"), what));
}

fn matrix(ui: &mut Ui, state: &State, palette: &Palette, asked: &mut Vec<Action>) {
    let scene = &state.scene;
    Grid::new("palette matrix").spacing([6.0, 6.0]).show(ui, |ui| {
        ui.label(RichText::new("target | now, ΔE00").small().weak()).on_hover_text(
            "A cell is a material under a light. Left: the target, with = for the colour of another cell. Right: the present colour and \
             its difference from the target in ΔE00 (1 is just visible).",
        );
        for (index, light) in palette.lights.iter().enumerate() {
            ui.vertical(|ui| {
                member(ui, scene, Side::Light, index, light, asked);
                alone(ui, state, &light.name, asked);
            });
        }
        ui.end_row();
        for (row, material) in palette.materials.iter().enumerate() {
            ui.vertical(|ui| member(ui, scene, Side::Material, row, material, asked));
            for column in 0..palette.lights.len() {
                cell(ui, scene, palette, row, column);
            }
            ui.end_row();
        }
    });
}

/// States the observer of the colours, if the display uses another one.
fn for_whom(ui: &mut Ui, display: &Display) {
    if display.observer != Observer::default() || display.deficiency.is_some() {
        let text = "Regardless of the display settings, palettes are designed and shown here for the 2° observer with normal colour vision.";
        ui.label(RichText::new(text).small());
    }
}

/// Header of a row or a column.
fn member(ui: &mut Ui, scene: &Scene, side: Side, index: usize, member: &Member, asked: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().icon_spacing = 2.0;
        let is_chosen = chosen(ui) == Some(Chosen::Member(side, index));
        if ui.selectable_label(is_chosen, &member.name).on_hover_text("Shows its spectrum and the bounds.").clicked() {
            choose(ui, Chosen::Member(side, index));
        }
        let mut open = member.spectrum.is_none();
        let check = ui.checkbox(&mut open, RichText::new("open").small());
        let name = format!("{}: open", member.name);
        check.widget_info(|| WidgetInfo::selected(WidgetType::Checkbox, true, open, &name));
        if check.on_hover_text("Open: solving finds its spectrum. Otherwise the spectrum is given and stays.").changed()
        {
            step(asked, Step::Open(side, index, open));
        }
    });
    if let Some(spectrum) = spectrum(scene, side, member) {
        curve(ui, spectrum, vec2(WIDE, 18.0));
    }
}

/// Button for the picture under the light `name` alone, if the scene has it.
fn alone(ui: &mut Ui, state: &State, name: &str, asked: &mut Vec<Action>) {
    let Some(index) = state.scene.lights.iter().position(|light| light.name == name) else { return };
    let alone = state.light.solo == Some(index) && state.light.mixing == Mixing::Sliders;
    let solo =
        toggle(ui, alone, "solo").on_hover_text("The picture under this light alone, or under all lights again.");
    solo.widget_info(|| WidgetInfo::selected(WidgetType::Button, true, alone, format!("{name}: solo")));
    if solo.clicked() {
        asked.push(Action::Edit(Edit::Solo((!alone).then_some(index))));
    }
}

fn cell(ui: &mut Ui, scene: &Scene, palette: &Palette, row: usize, column: usize) {
    let Look { achieved, target, difference } = look(scene, palette, row, column);
    let (rect, response) = ui.allocate_exact_size(vec2(WIDE, 34.0), Sense::click());
    let (left, right) = rect.split_left_right_at_fraction(0.5);
    let ground = ui.visuals().extreme_bg_color;
    for (half, colour) in [(left, target), (right, achieved)] {
        ui.painter().rect_filled(half, 0.0, colour.map_or(ground, screen));
    }
    let is_like = palette
        .cells
        .iter()
        .any(|cell| (cell.material, cell.light) == (row, column) && matches!(cell.target, Target::Like { .. }));
    if is_like {
        let ink = if target.map_or(0.5, |xyz| xyz.0[1]) > 0.2 { Color32::BLACK } else { Color32::WHITE };
        ui.painter().text(left.center(), egui::Align2::CENTER_CENTER, "=", egui::FontId::proportional(11.0), ink);
    }
    if target.is_none() {
        // Hatching marks a cell without a target, unlike a black target.
        let (painter, step) = (ui.painter().with_clip_rect(left), left.width() / 4.0);
        for line in (0_u8..8).map(|line| left.left() + f32::from(line) * step) {
            let ends = [pos2(line, left.top()), pos2(line - left.height(), left.bottom())];
            painter.line_segment(ends, Stroke::new(1.0, ui.visuals().weak_text_color()));
        }
    }
    let is_chosen = chosen(ui) == Some(Chosen::Cell(row, column));
    let (width, colour) =
        if is_chosen { (2.0, ui.visuals().strong_text_color()) } else { (1.0, ui.visuals().weak_text_color()) };
    ui.painter().rect_stroke(rect, 2.0, Stroke::new(width, colour), StrokeKind::Inside);
    let asks = palette.target_text(row, column);
    let short = match difference {
        Some(difference) => format!("{difference:.1}"),
        None => asks.clone(),
    };
    let middle = achieved.map_or(0.5, |xyz| xyz.0[1]);
    let ink = if middle > 0.2 { Color32::BLACK } else { Color32::WHITE };
    ui.painter().text(right.center(), egui::Align2::CENTER_CENTER, short, egui::FontId::proportional(11.0), ink);
    let [material, light] =
        [palette.materials.get(row), palette.lights.get(column)].map(|it| it.map_or("", |it| &it.name));
    let name = format!("{material} under {light}");
    response.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, &name));
    let off = difference.map_or_else(String::new, |off| format!("; difference ΔE00 {off:.2}"));
    if response.on_hover_text(format!("{name}: target {asks}{off}. Left: target. Right: present colour.")).clicked() {
        choose(ui, Chosen::Cell(row, column));
    }
}

fn details(ui: &mut Ui, scene: &Scene, palette: &Palette, asked: &mut Vec<Action>) {
    match chosen(ui) {
        Some(Chosen::Cell(row, column)) => cell_details(ui, scene, palette, row, column, asked),
        Some(Chosen::Member(side, index)) => member_details(ui, scene, palette, side, index, asked),
        None => {
            ui.label(RichText::new("Click a cell, a material or a light for its target or spectrum.").weak());
        }
    }
}

fn cell_details(ui: &mut Ui, scene: &Scene, palette: &Palette, row: usize, column: usize, asked: &mut Vec<Action>) {
    let (Some(material), Some(light)) = (palette.materials.get(row), palette.lights.get(column)) else { return };
    let found = palette.cells.iter().find(|cell| (cell.material, cell.light) == (row, column));
    let now = look(scene, palette, row, column);
    let [r, g, b, _] = now.target.or(now.achieved).map_or(Color32::GRAY, screen).to_array();
    ui.horizontal_wrapped(|ui| {
        ui.label(RichText::new(format!("{} under {}", material.name, light.name)).strong());
        let mut ask = |target: Option<Target>| step(asked, Step::Target(row, column, target));
        ComboBox::from_id_salt("target").selected_text(palette.target_text(row, column)).show_ui(ui, |ui| {
            let kind = found.map(|cell| cell.target);
            if ui.selectable_label(kind.is_none(), "free").on_hover_text("No target.").clicked() {
                ask(None);
            }
            if ui.selectable_label(matches!(kind, Some(Target::Srgb(_))), "a colour").clicked() {
                ask(Some(Target::Srgb([r, g, b])));
            }
            if ui.selectable_label(kind == Some(Target::Black), "black").on_hover_text("No reflected light.").clicked()
            {
                ask(Some(Target::Black));
            }
            for (other, it) in palette.materials.iter().enumerate().filter(|(other, _)| *other != row) {
                let like = Target::Like { material: other, light: column };
                if ui.selectable_label(kind == Some(like), format!("as {}", it.name)).clicked() {
                    ask(Some(like));
                }
            }
            for (other, it) in palette.lights.iter().enumerate().filter(|(other, _)| *other != column) {
                let like = Target::Like { material: row, light: other };
                if ui.selectable_label(kind == Some(like), format!("as under {}", it.name)).clicked() {
                    ask(Some(like));
                }
            }
        });
        let mut code = [r, g, b];
        if found.is_some() && ui.color_edit_button_srgb(&mut code).on_hover_text("Target colour.").changed() {
            ask(Some(Target::Srgb(code)));
        }
        if let Some(cell) = found {
            let mut weight = cell.weight;
            ui.label("weight").on_hover_text("Weight of its ΔE00 relative to other cells.");
            if number(ui, &mut weight, 3, |drag| drag.speed(0.02).range(1e-3..=1e3)).changed() {
                step(asked, Step::Weight(row, column, weight));
            }
        }
    });
    if found.is_some() && material.spectrum.is_some() && light.spectrum.is_some() {
        let text = format!(
            "{} and {} are both given, so solving changes nothing here. Tick the one with the spectrum to solve for.",
            material.name, light.name
        );
        ui.label(RichText::new(text).small());
    }
}

fn member_details(ui: &mut Ui, scene: &Scene, palette: &Palette, side: Side, index: usize, asked: &mut Vec<Action>) {
    let members = match side {
        Side::Material => &palette.materials,
        Side::Light => &palette.lights,
    };
    let Some(member) = members.get(index) else { return };
    ui.label(RichText::new(&member.name).strong());
    if let Some(spectrum) = spectrum(scene, side, member) {
        plot(ui, &[(spectrum, ui.visuals().strong_text_color())], vec2(300.0, 90.0));
    }
    if member.spectrum.is_some() {
        ui.label(RichText::new("given: solving does not change it").small().weak());
        return;
    }
    ui.horizontal(|ui| {
        let [mut low, mut high] = member.bounds;
        let unit = if side == Side::Light { "times its mean" } else { "of the incident light" };
        ui.label("from");
        let lower = number(ui, &mut low, 3, |drag| drag.speed(0.02).range(-1e3..=1e3));
        ui.label("to");
        let upper = number(ui, &mut high, 3, |drag| drag.speed(0.02).range(-1e3..=1e3));
        ui.label(RichText::new(unit).small());
        if lower.changed() || upper.changed() {
            step(asked, Step::Bounds(side, index, [low, high]));
        }
        if side == Side::Material {
            let mut bounds = |ui: &mut Ui, name: &str, to: [f64; 2], help: &str| {
                if ui.small_button(name).on_hover_text(help).clicked() {
                    step(asked, Step::Bounds(side, index, to));
                }
            };
            bounds(ui, "natural", NATURAL, "Bounds from 0 to 1, as for real surfaces.");
            bounds(
                ui,
                "signed",
                [-1.0, 1.0],
                "Bounds from -1 to 1: negative reflectance is unphysical, but reaches more colours.",
            );
        }
    });
    ui.horizontal(|ui| {
        ui.label("smoothness");
        // Logarithmic: the steps 10⁻⁶ → 10⁻³ and 10⁻³ → 1 are equal.
        let mut power = member.smoothness.log10();
        let field = number(ui, &mut power, 2, |drag| drag.speed(0.02).range(-12.0..=6.0).prefix("10^"));
        let help = "Weight of the curvature relative to ΔE00: larger is smoother and less exact.";
        if field.on_hover_text(help).changed() {
            step(asked, Step::Smoothness(side, index, 10.0_f64.powf(power)));
        }
    });
}

/// Controls of the colour model that is fitted before the spectra, if the palette has one.
fn model(ui: &mut Ui, palette: &Palette, asked: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        let mut settled = palette.model.is_some();
        let help = "Fits a colour model of this dimension first, and solves for spectra that it represents well; the scene must use the same k.";
        let usual = ModelTerm { dimension: 8, weight: 1.0 };
        if ui.checkbox(&mut settled, "for a colour model").on_hover_text(help).changed() {
            step(asked, Step::Model(settled.then_some(usual)));
        }
        if let Some(mut term) = palette.model {
            ui.label("of k =");
            let k = number(ui, &mut term.dimension, 0, |drag| drag.speed(0.05).range(1..=LARGEST_DIMENSION));
            ui.label("weight");
            let weight = number(ui, &mut term.weight, 3, |drag| drag.speed(0.02).range(1e-3..=1e3));
            if weight.on_hover_text("Weight of the model's ΔE00.").changed() || k.changed() {
                step(asked, Step::Model(Some(term)));
            }
        }
    });
}

/// Shows the progress of the solver. Returns whether it is running.
fn is_running(ui: &mut Ui, design: Design<'_>, asked: &mut Vec<Action>) -> bool {
    let Some((part, stage)) = design.running else { return false };
    ui.add(part.map_or_else(|| ProgressBar::new(0.0), ProgressBar::new).text(RichText::new(stage).small()));
    if ui.button("Cancel").on_hover_text("Stops solving; the spectra stay unchanged.").clicked() {
        asked.push(Action::GiveUp);
    }
    true
}

fn solve(ui: &mut Ui, palette: &Palette, design: Design<'_>, asked: &mut Vec<Action>) {
    if is_running(ui, design, asked) {
        return;
    }
    ui.horizontal(|ui| {
        let help =
            "Solves for the open spectra, with all cells as close to their targets as possible, and applies them.";
        let opens = palette.materials.iter().chain(&palette.lights).any(|member| member.spectrum.is_none());
        let solve = ui.add_enabled(opens, Button::new("Solve")).on_hover_text(help);
        if solve.on_disabled_hover_text("All spectra are given. Tick the open ones to solve for.").clicked() {
            asked.push(Action::Solve(None));
        }
        if ui
            .small_button("New default palette")
            .on_hover_text("Replaces this palette by the default one of the visible materials: under the second of two lights they all look alike, under the first they keep their hues as far as possible.")
            .clicked()
        {
            asked.push(Action::Offer);
        }
    });
}

/// Presets of smoothness, each of which solves again, with their costs after a comparison.
fn smoother(ui: &mut Ui, palette: &Palette, design: Design<'_>, asked: &mut Vec<Action>) {
    let mut open =
        palette.materials.iter().chain(&palette.lights).filter(|member| member.spectrum.is_none()).peekable();
    if design.running.is_some() || open.peek().is_none() {
        return;
    }
    let smoothness: Vec<f64> = open.map(|member| member.smoothness).collect();
    ui.horizontal_wrapped(|ui| {
        ui.label("Spectra").on_hover_text("Smoother spectra are easier to make, and reach their targets less exactly.");
        for preset in Smoothing::ALL {
            let cost = design.smoother.iter().find(|cost| cost.smoothing == preset);
            let text = match cost {
                Some(cost) => format!("{}: ΔE00 {:.2}", preset.name(), cost.worst),
                None => preset.name().to_owned(),
            };
            let on = smoothness.iter().all(|own| own.to_bits() == preset.smoothness().to_bits());
            let help = match cost {
                Some(cost) if cost.edge > 0.0 => format!(
                    "Largest ΔE00 {:.3}; up to {:.0} % of a colour come from the edge of the visible range.",
                    cost.worst,
                    100.0 * cost.edge
                ),
                Some(cost) => format!("Largest ΔE00 {:.3}.", cost.worst),
                None => "Its cost is not known yet: Compare shows it.".to_owned(),
            };
            let button = toggle(ui, on, &text);
            button.widget_info(|| WidgetInfo::selected(WidgetType::Button, true, on, format!("spectra: {text}")));
            let help = format!("Smoothness {} for every open spectrum; solves again. {help}", preset.smoothness());
            if button.on_hover_text(help).clicked() {
                asked.push(Action::Solve(Some(Step::SmoothAll(preset.smoothness()))));
            }
        }
        let help = "Solves with each of these, and shows the largest ΔE00 of each. No spectrum changes.";
        if ui.small_button("Compare").on_hover_text(help).clicked() {
            asked.push(Action::CompareSmoothness);
        }
    });
}

/// Lists the unsatisfiable targets, the reasons, and possible changes. Each change solves the palette again at once.
fn conflicts(ui: &mut Ui, palette: &Palette, design: Design<'_>, asked: &mut Vec<Action>) {
    for conflict in design.conflicts.iter().filter(|_| design.running.is_none()) {
        ui.separator();
        ui.label(format!("The targets conflict: {}.", conflict.reason.trim_end_matches('.')));
        let steps: Vec<_> = conflict.ways_out.iter().filter_map(|way| Some((way, changed(palette, way)?))).collect();
        if steps.is_empty() {
            ui.label(RichText::new("No single change is known to resolve it.").small().weak());
            continue;
        }
        ui.label(
            RichText::new("One of these changes may resolve it; each solves again, and one undo reverts it:")
                .small()
                .weak(),
        );
        ui.horizontal_wrapped(|ui| {
            for (way, change) in steps {
                if ui.button(capital(&way.to_string())).clicked() {
                    asked.push(Action::Solve(Some(change)));
                }
            }
        });
    }
}

/// The edit for this way out, if `palette` still has the objects concerned.
fn changed(palette: &Palette, way: &WayOut) -> Option<Step> {
    let index = |members: &[Member], name: &str| members.iter().position(|member| member.name == name);
    match way {
        WayOut::Free { material, light } => {
            Some(Step::Target(index(&palette.materials, material)?, index(&palette.lights, light)?, None))
        }
        WayOut::Bounds { material, bounds } => {
            Some(Step::Bounds(Side::Material, index(&palette.materials, material)?, *bounds))
        }
        WayOut::Open { light } => Some(Step::Open(Side::Light, index(&palette.lights, light)?, true)),
    }
}
