//! Accuracy panel: the computation, its error against the truth, and settings by measured cost.

use egui::{
    Align2, Button, Checkbox, Color32, ComboBox, FontId, Grid, ProgressBar, RichText, Sense, Stroke, Ui, WidgetInfo,
    WidgetType, pos2, vec2,
};

use super::controls::{number, panel, remembered};
use super::spectrum::narrow;
use crate::document::{Document, Edit};
use crate::measure::{Goal, Preset};
use crate::plan::Planned;
use crate::plan::Stale;
use crate::scene::key::{self, Value};
use crate::scene::{Accuracy, Integration, LabelInterpolation, Scene};
use crate::view::action::Action;
use crate::view::effort::{Curve, Measured};

/// Cost and error of pictures.
#[derive(Clone, Copy, Debug, Default)]
pub struct Effort<'a> {
    /// The plan, if there is one.
    pub planned: Option<&'a Planned>,
    /// Measured settings, and whether they belong to the current view.
    pub curve: Option<(&'a Curve, bool)>,
    /// Result of the last choice of a setting.
    pub chosen: Option<&'a str>,
    /// Progress of a measurement (0 to 1, if known), and its current stage.
    pub running: Option<(Option<f32>, &'a str)>,
}

/// Presets, with their goals.
const PRESETS: [(&str, Preset, &str); 3] = [
    ("interactive", Preset::Interactive, "At most 50 ms per frame: fast enough for interactive rotation."),
    ("balanced", Preset::Balanced, "Within ΔE00 1 of the truth in 95 % of the pixels: hardly visible differences."),
    ("reference", Preset::Reference, "Within ΔE00 0.25 of the truth in 95 % of the pixels: no visible difference."),
];

/// Shows the accuracy panel.
pub(super) fn show(ui: &mut Ui, document: &Document, effort: Effort<'_>, asked: &mut Vec<Action>) {
    panel(ui, "Accuracy", Stale::Tables, |ui| {
        let scene = &document.state().scene;
        if let Some(planned) = effort.planned {
            colours(ui, planned);
            ui.collapsing("What is computed", |ui| {
                for sentence in planned.explain(scene) {
                    ui.label(RichText::new(sentence).small());
                }
            });
        }
        let help = "Distance between samples along a ray. Half the step takes about twice the time, and has a quarter of the error.";
        drag(ui, scene, ("accuracy.step", "Step", " voxels", 3), help, asked);
        rays(ui, &scene.accuracy, asked);
        if effort.planned.is_some_and(|planned| planned.plan.labels) {
            labels(ui, &scene.accuracy, asked);
        }
        // The window itself marches all voxels.
        let help = "relume render, page and measure take a coarser level of the volume whose voxels are at most so large: \
                    faster, and thin layers fade. 0 takes all voxels, as this window always does at rest.";
        drag(ui, scene, ("accuracy.voxel_pixels", "Voxels up to", " pixels", 2), help, asked);
        integration(ui, &scene.accuracy, effort.planned.and_then(Planned::no_segments), asked);
        match effort.running {
            Some((part, stage)) => {
                let bar = part.map_or_else(|| ProgressBar::new(0.0), ProgressBar::new);
                ui.add(bar.text(RichText::new(stage).small()));
                if ui.button("Cancel").on_hover_text("Stops the measurement.").clicked() {
                    asked.push(Action::GiveUp);
                }
            }
            None => choose(ui, asked),
        }
        if let Some(chosen) = effort.chosen {
            ui.label(RichText::new(chosen).small());
        }
        if let Some((curve, is_of_this)) = effort.curve {
            plot(ui, &scene.accuracy, curve, asked);
            let [width, height] = curve.size;
            let of = if is_of_this {
                format!("measured for this view, {width}×{height} pixels")
            } else {
                format!("measured for another view, {width}×{height} pixels: measure again for this one")
            };
            ui.label(RichText::new(of).small().weak());
        }
    });
}

/// Choice of the rays per pixel.
fn rays(ui: &mut Ui, accuracy: &Accuracy, asked: &mut Vec<Action>) {
    /// Numbers of rays on the menu.
    const NUMBERS: [usize; 4] = [1, 4, 16, 64];
    ui.horizontal(|ui| {
        ui.label("Rays per pixel");
        let mut rays = accuracy.rays;
        let menu = ComboBox::from_id_salt("rays per pixel").width(50.0).selected_text(rays.to_string());
        let menu = menu.show_ui(ui, |ui| {
            for number in NUMBERS {
                ui.selectable_value(&mut rays, number, number.to_string());
            }
        });
        menu.response.widget_info(|| WidgetInfo::labeled(WidgetType::ComboBox, true, "rays per pixel"));
        menu.response.on_hover_text("A pixel is the mean of these rays: smoother edges, in as many times the time. One ray while the picture changes.");
        if rays != accuracy.rays {
            asked.push(Action::Edit(Edit::Accuracy(Accuracy { rays, ..accuracy.clone() })));
        }
    });
}

/// A number of the accuracy: its key, name, unit and decimals.
fn drag(ui: &mut Ui, scene: &Scene, row: (&str, &str, &str, i32), help: &str, asked: &mut Vec<Action>) {
    let (path, label, unit, decimals) = row;
    let Some(key) = key::of_scene(path) else { return };
    let Some(Value::Number(stated)) = key.get(scene) else { return };
    let mut shown = stated / key.unit(scene);
    ui.horizontal(|ui| {
        ui.label(label);
        let dragged = number(ui, &mut shown, decimals, |drag| drag.speed(0.02).range(key.offered()).suffix(unit));
        dragged.widget_info(|| WidgetInfo::slider(true, shown, label.to_lowercase()));
        if dragged.on_hover_text(help).changed() {
            let mut changed = scene.clone();
            // The field is limited to the range.
            key.set(&mut changed, Some(Value::Number(shown * key.unit(scene)))).ok();
            asked.push(Action::Edit(Edit::Accuracy(changed.accuracy)));
        }
    });
}

/// Switch between smooth and nearest labels.
fn labels(ui: &mut Ui, accuracy: &Accuracy, asked: &mut Vec<Action>) {
    let mut smooth = accuracy.labels == LabelInterpolation::Smooth;
    let switch = ui.checkbox(&mut smooth, "Smooth labels");
    let help =
        "Between voxels each label around has its share. Otherwise surfaces of labels have the steps of their voxels.";
    if switch.on_hover_text(help).changed() {
        let labels = if smooth { LabelInterpolation::Smooth } else { LabelInterpolation::Nearest };
        asked.push(Action::Edit(Edit::Accuracy(Accuracy { labels, ..accuracy.clone() })));
    }
}

/// Switches of segments, disabled if the plan has none, for the reason `impossible`, and of further samples, and that of the phases of rays.
fn integration(ui: &mut Ui, accuracy: &Accuracy, impossible: Option<&str>, asked: &mut Vec<Action>) {
    let mut change = |accuracy: Accuracy| asked.push(Action::Edit(Edit::Accuracy(accuracy)));
    ui.horizontal_wrapped(|ui| {
        let mut segments = accuracy.integration == Integration::Segments;
        let switch = ui.add_enabled(segments || impossible.is_none(), Checkbox::new(&mut segments, "Segments"));
        let help = "Each step takes the mean of the medium between its two ends, instead of the medium in its middle: better for narrow intervals of the transfer function; with wide ramps, shorter steps are faster.";
        let why = impossible.map(|why| format!("Not here: {why}."));
        if switch.on_hover_text(help).on_disabled_hover_text(why.as_deref().unwrap_or(help)).changed() {
            let integration = if segments { Integration::Segments } else { Integration::Samples };
            change(Accuracy { integration, ..accuracy.clone() });
        }
        let mut adaptive = accuracy.integration == Integration::Adaptive;
        let help = "Steps have further samples where the medium changes from one to the next: smooth surfaces without rings, for a third to half more time.";
        if ui.checkbox(&mut adaptive, "Adaptive").on_hover_text(help).changed() {
            let integration = if adaptive { Integration::Adaptive } else { Integration::Samples };
            change(Accuracy { integration, ..accuracy.clone() });
        }
        let mut jitter = accuracy.jitter;
        let help = "The steps of each ray begin at another part of a step: a fine grain in place of rings, at no cost.";
        if ui.checkbox(&mut jitter, "Jitter").on_hover_text(help).changed() {
            change(Accuracy { jitter, ..accuracy.clone() });
        }
    });
}

/// Colour errors of the colour model.
fn colours(ui: &mut Ui, planned: &Planned) {
    let Some(model) = &planned.model else {
        ui.label(RichText::new("Relighting is exact; only the steps of the march cause errors.").small()).on_hover_text(
            "A pixel stores material weights, which lose nothing of a spectrum. The errors below compare the march with one of \
             very short steps.",
        );
        return;
    };
    let text = format!("{} coefficients represent a spectrum. Colour errors, ΔE00:", planned.plan.components());
    ui.label(RichText::new(text).small()).on_hover_text(
        "Error of the colour model over possible spectra of this scene; ΔE00 1 is just visible side by side.",
    );
    Grid::new("model error").num_columns(4).spacing([10.0, 2.0]).show(ui, |ui| {
        for head in ["under", "mean", "p95", "most"] {
            ui.label(RichText::new(head).small().weak());
        }
        ui.end_row();
        for (name, _, matrix) in model.lights() {
            let error = matrix.worst();
            ui.label(RichText::new(name).small());
            for number in [error.mean, error.p95, error.max] {
                ui.label(RichText::new(format!("{number:.2}")).small().monospace());
            }
            ui.end_row();
        }
    });
}

/// Controls to choose a setting by its goal.
fn choose(ui: &mut Ui, asked: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        for (name, preset, help) in PRESETS {
            let help =
                format!("{help} Measures settings of this scene on this device, some seconds each, and applies the one that reaches the goal.");
            if ui.small_button(name).on_hover_text(help).clicked() {
                asked.push(Action::Measure(Some(preset.goal())));
            }
        }
    });
    let mut row = |ui: &mut Ui, label: &str, usual: f64, suffix: &str, help: &str, goal: fn(f64) -> Goal| {
        ui.horizontal(|ui| {
            ui.label(label).on_hover_text(help);
            let wanted = remembered(ui, (label, help), usual, 2, |drag| {
                drag.speed(0.01 * usual).range(0.01..=1e5).suffix(suffix)
            });
            let button = ui.add(Button::new("Choose").small());
            button.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, format!("choose by {label}")));
            if button.on_hover_text("Measures settings until one reaches the goal, and applies it.").clicked() {
                asked.push(Action::Measure(Some(goal(wanted))));
            }
        });
    };
    row(
        ui,
        "error at most",
        1.0,
        " ΔE",
        "The fastest setting within this ΔE00 of the truth in 95 % of the pixels.",
        Goal::MaxError,
    );
    row(
        ui,
        "frame within",
        50.0,
        " ms",
        "The most accurate setting with frames (march and relight) within this time.",
        Goal::Budget,
    );
    if ui
        .small_button("Measure the curve")
        .on_hover_text("Time and error of step lengths an octave apart on this device. Takes about a minute without a graphics card, and can be cancelled.")
        .clicked()
    {
        asked.push(Action::Measure(None));
    }
}

/// Plot of time against error, both on log scales. A click applies a setting.
fn plot(ui: &mut Ui, now: &Accuracy, curve: &Curve, asked: &mut Vec<Action>) {
    let (frame, whole) = ui.allocate_exact_size(vec2(ui.available_width(), 134.0), Sense::hover());
    whole.widget_info(|| WidgetInfo::labeled(WidgetType::Image, true, "time against error"));
    // Scrolls to a new plot only if the panel is in view, so that the user is not led away from another panel.
    let (id, new) = (ui.id().with("measured"), curve.settings.iter().map(|it| it.point.frame_ms).sum::<f64>());
    let known: Option<f64> = ui.data(|data| data.get_temp(id));
    if known != Some(new) {
        ui.data_mut(|data| data.insert_temp(id, new));
        if ui.is_rect_visible(ui.min_rect()) {
            whole.scroll_to_me(Some(egui::Align::BOTTOM));
        }
    }
    // Leaves room for the axis labels.
    let rect = egui::Rect::from_min_max(frame.min + vec2(34.0, 10.0), frame.max - vec2(12.0, 24.0));
    let visuals = ui.visuals().clone();
    ui.painter().rect_filled(frame, 2.0, visuals.extreme_bg_color);
    let of = |part: fn(&Measured) -> f64| {
        let numbers = || curve.settings.iter().map(|it| part(it).max(1e-4).log2()).filter(|number| number.is_finite());
        let (low, high) = (numbers().fold(f64::INFINITY, f64::min), numbers().fold(f64::NEG_INFINITY, f64::max));
        move |it: &Measured| {
            let span = if high > low { high - low } else { 1.0 };
            narrow(((part(it).max(1e-4).log2() - low) / span).clamp(0.0, 1.0))
        }
    };
    let (time, error) = (of(|it| it.point.frame_ms), of(|it| it.point.error.p95));
    let at = |it: &Measured| pos2(rect.left() + time(it) * rect.width(), rect.bottom() - error(it) * rect.height());
    let front: Vec<_> = curve.settings.iter().enumerate().filter(|(index, _)| curve.is_on_the_front(*index)).collect();
    let line = front.iter().map(|(_, it)| at(it)).collect();
    ui.painter().line(line, Stroke::new(1.0, visuals.weak_text_color()));
    // One setting may have been measured under two names.
    let here = curve.settings.iter().position(|it| it.accuracy == *now);
    for (index, it) in curve.settings.iter().enumerate() {
        let (place, is_now) = (at(it), here == Some(index));
        let on_front = front.iter().any(|(known, _)| *known == index);
        let touched = ui.interact(
            egui::Rect::from_center_size(place, vec2(12.0, 12.0)),
            ui.id().with(("setting", index)),
            Sense::click(),
        );
        touched.widget_info(|| WidgetInfo::labeled(WidgetType::Button, true, &it.name));
        let colour = if on_front { Color32::from_rgb(90, 160, 240) } else { visuals.weak_text_color() };
        ui.painter().circle_filled(place, if touched.hovered() { 5.0 } else { 3.5 }, colour);
        if is_now {
            ui.painter().circle_stroke(place, 6.5, Stroke::new(1.5, visuals.strong_text_color()));
        }
        let error = it.point.error;
        let help = format!(
            "{}: {:.1} ms per frame; ΔE00 {:.2} on average, within {:.2} in 95 % of the pixels, {:.2} at most.{} Click to apply it.",
            it.name,
            it.point.frame_ms,
            error.mean,
            error.p95,
            error.max,
            if on_front { "" } else { " Another setting is faster and as accurate." }
        );
        if touched.on_hover_text(help).clicked() {
            asked.push(Action::Edit(Edit::Accuracy(it.accuracy.clone())));
        }
    }
    let ends = |part: fn(&Measured) -> f64| {
        let numbers = || curve.settings.iter().map(part);
        (numbers().fold(f64::INFINITY, f64::min), numbers().fold(0.0, f64::max))
    };
    let ((fast, slow), (near, far)) = (ends(|it| it.point.frame_ms), ends(|it| it.point.error.p95));
    let say = |place: egui::Pos2, align: Align2, text: String| {
        ui.painter().text(place, align, text, FontId::proportional(9.0), visuals.weak_text_color());
    };
    say(rect.left_top() - vec2(8.0, 0.0), Align2::RIGHT_CENTER, format!("{far:.2}"));
    say(rect.left_bottom() - vec2(8.0, 0.0), Align2::RIGHT_CENTER, format!("{near:.2}"));
    say(rect.left_center() - vec2(8.0, 0.0), Align2::RIGHT_CENTER, "ΔE00".to_owned());
    say(rect.left_bottom() + vec2(0.0, 9.0), Align2::LEFT_TOP, format!("{fast:.1} ms"));
    say(rect.right_bottom() + vec2(0.0, 9.0), Align2::RIGHT_TOP, format!("{slow:.1} ms per frame"));
    ui.label(
        RichText::new("right: slower; up: larger error; ring: current setting; both scales are logarithmic")
            .small()
            .weak(),
    );
}
