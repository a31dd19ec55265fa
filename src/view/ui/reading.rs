//! Questions about a file before it can be read: which volume to show, the layout of headerless voxels, or whether to
//! resample.

use egui::{Button, ComboBox, Context, Grid, Id, Key, Modal, Response, RichText, ScrollArea, Ui, WidgetInfo};

use super::controls::{number, toggle};
use super::previews::{Place, Previews};
use crate::document::Source;
use crate::document::{Question, Unknown};
use crate::volume::{ByteOrder, RawLayout, Selection, Series, Several, VoxelType};

/// Largest width in points.
const WIDTH: f32 = 420.0;

/// A question with the answer so far.
#[derive(Debug)]
pub(super) struct Reading {
    source: Box<Source>,
    question: Question,
    /// Index of the selected volume.
    chosen: usize,
    /// Layout of headerless voxels.
    layout: RawLayout,
    /// Middle slices of the volumes among which to choose.
    previews: Previews,
    /// Whether a field had the keyboard focus in the last frame, and thus took Enter and Escape.
    typed: bool,
}

/// Answer to a question.
pub(super) enum Answer {
    /// Open this source.
    Open(Box<Source>),
    /// Cancelled.
    GivenUp,
}

impl Reading {
    pub(super) fn new(source: Source, question: Question, shown: &Selection) -> Self {
        let chosen = match &question.unknown {
            Unknown::Layout { .. } | Unknown::Grid { .. } => None,
            Unknown::Which(Several::Components { count, .. }) => shown.component.filter(|index| index < count),
            Unknown::Which(Several::Times(count)) => shown.time.filter(|index| index < count),
            Unknown::Which(Several::Steps { values, .. }) => shown.time.filter(|index| *index < values.len()),
            Unknown::Which(Several::Arrays(names)) => names.iter().position(|name| Some(name) == shown.array.as_ref()),
            Unknown::Which(Several::Series(all)) => {
                let is_shown = |series: &Series| Some(&series.key) == shown.series.as_ref();
                all.iter().position(is_shown).or_else(|| largest(all))
            }
            Unknown::Which(Several::Levels(all)) => shown.level.filter(|level| *level < all.len()),
        };
        let guess = match &question.unknown {
            Unknown::Layout { guess, .. } => guess.as_deref().cloned(),
            Unknown::Which(_) | Unknown::Grid { .. } => None,
        };
        let layout = guess.unwrap_or_else(|| RawLayout::new([1; 3], VoxelType::U8));
        Self {
            source: Box::new(source),
            question,
            chosen: chosen.unwrap_or(0),
            layout,
            previews: Previews::default(),
            typed: false,
        }
    }

    /// Shows the question in the middle of the window and returns the answer, if any. A click outside is no answer.
    pub(super) fn show(&mut self, context: &Context) -> Option<Answer> {
        let room = (context.content_rect().height() - 130.0).max(40.0);
        let pressed = |key: Key| !self.typed && context.input(|input| input.key_pressed(key));
        let [enter, escape] = [Key::Enter, Key::Escape].map(pressed);
        let modal = Modal::new(Id::new("question")).show(context, |ui| {
            ui.set_max_width(WIDTH);
            let sound = self.ask(ui, room);
            ui.add_space(6.0);
            ui.horizontal(|ui| {
                let label = if matches!(self.question.unknown, Unknown::Grid { .. }) { "Resample" } else { "Open" };
                let open = ui.add_enabled(sound, Button::new(label));
                let open = open.on_disabled_hover_text("The file has too few bytes for this layout.").clicked();
                if open || sound && enter {
                    return Some(Answer::Open(self.answered()));
                }
                (ui.button("Cancel").clicked() || escape).then_some(Answer::GivenUp)
            })
            .inner
        });
        self.typed = context.memory(|memory| memory.focused().is_some());
        modal.inner
    }

    /// Shows the controls. Returns whether the current answer is valid.
    fn ask(&mut self, ui: &mut Ui, room: f32) -> bool {
        let file = self.question.file.file_name().unwrap_or_default().to_string_lossy();
        match &self.question.unknown {
            Unknown::Which(there) if names(there).is_some() => {
                let kind = match there {
                    Several::Arrays(_) => "arrays",
                    Several::Components { .. } => "channels",
                    Several::Series(_) => "series",
                    Several::Levels(_) => "levels of resolution",
                    Several::Times(_) => "time steps",
                    Several::Steps { .. } => "volumes",
                };
                ui.heading(format!("{file} holds several {kind}"));
                let names = names(there).unwrap_or_default();
                ScrollArea::vertical().max_height(room).show(ui, |ui| {
                    for (index, name) in names.into_iter().enumerate() {
                        ui.horizontal(|ui| {
                            let selection = selection(&self.question.unknown, &self.source, index);
                            let place = place(&self.question, &self.source, &selection);
                            let picture = self.previews.show(ui, index, place);
                            let radio = ui.radio(self.chosen == index, name);
                            if radio.clicked() || picture.clicked() {
                                self.chosen = index;
                            }
                        });
                    }
                });
                true
            }
            Unknown::Which(there) => {
                ui.heading(format!("{file} holds {there}"));
                ui.horizontal(|ui| {
                    let selection = selection(&self.question.unknown, &self.source, self.chosen);
                    self.previews.show(ui, self.chosen, place(&self.question, &self.source, &selection));
                    one_of(ui, there, &mut self.chosen);
                });
                true
            }
            Unknown::Grid { problem } => {
                ui.heading(format!("{file} has no straight grid"));
                ui.label(problem);
                ui.label("Resampling lays it into one, with linear interpolation.");
                true
            }
            Unknown::Layout { bytes, .. } => {
                ui.heading(format!("How are the voxels of {file} stored?"));
                let help = "The file has no header. Its name often states the layout; otherwise ask its author.";
                ScrollArea::vertical().max_height(room).show(ui, |ui| {
                    ui.label(RichText::new(help).small());
                    stored(ui, &mut self.layout);
                });
                fits(ui, &self.layout, *bytes)
            }
        }
    }

    fn answered(&self) -> Box<Source> {
        let mut source = self.source.clone();
        let options = &mut source.options;
        if matches!(self.question.unknown, Unknown::Layout { .. }) {
            options.raw = Some(self.layout.clone());
        }
        options.selection = selection(&self.question.unknown, &self.source, self.chosen);
        source
    }
}

/// The selection of `source` with the answer `index`.
fn selection(unknown: &Unknown, source: &Source, index: usize) -> Selection {
    let answer = match unknown {
        Unknown::Which(Several::Components { .. }) => Selection { component: Some(index), ..Selection::default() },
        Unknown::Which(Several::Times(_) | Several::Steps { .. }) => {
            Selection { time: Some(index), ..Selection::default() }
        }
        Unknown::Which(Several::Arrays(names)) => {
            Selection { array: names.get(index).cloned(), ..Selection::default() }
        }
        Unknown::Which(Several::Series(all)) => {
            let series = all.get(index).map(|series| series.key.clone());
            Selection { series, ..Selection::default() }
        }
        Unknown::Which(Several::Levels(_)) => Selection { level: Some(index), ..Selection::default() },
        Unknown::Grid { .. } => Selection { resample: true, ..Selection::default() },
        Unknown::Layout { .. } => Selection::default(),
    };
    answer.or(&source.options.selection)
}

/// The volume of `selection` in the file of the question.
fn place<'a>(question: &'a Question, source: &'a Source, selection: &'a Selection) -> Place<'a> {
    Place { path: &question.file, layout: source.options.raw.as_ref(), selection }
}

/// Names of the alternatives, if there is a line for each; otherwise they are chosen by their numbers.
fn names(there: &Several) -> Option<Vec<String>> {
    Some(match there {
        Several::Arrays(names) => names.clone(),
        Several::Components { names, .. } if names.iter().any(|name| !name.is_empty()) => {
            let name = |(index, name): (usize, &String)| match name.as_str() {
                "" => format!("channel {index}"),
                name => name.to_owned(),
            };
            names.iter().enumerate().map(name).collect()
        }
        Several::Series(all) => all.iter().map(ToString::to_string).collect(),
        Several::Levels(all) => {
            let name = |(level, [x, y, z]): (usize, &[usize; 3])| format!("level {level}, {x}×{y}×{z}");
            all.iter().enumerate().map(name).collect()
        }
        Several::Steps { axis, values } => values.iter().map(|value| format!("{axis} {value}")).collect(),
        Several::Components { .. } | Several::Times(_) => return None,
    })
}

/// Index of the series with most voxels, the first one among ties.
fn largest(all: &[Series]) -> Option<usize> {
    let voxels = |series: &Series| series.dims.iter().fold(1, |product: usize, &side| product.saturating_mul(side));
    (0..all.len()).rev().max_by_key(|&index| voxels(&all[index]))
}

/// Selects one of several by number.
fn one_of(ui: &mut Ui, there: &Several, chosen: &mut usize) {
    let (what, count) = match there {
        Several::Components { count, .. } => ("Component", *count),
        Several::Times(count) => ("Time step", *count),
        Several::Steps { values, .. } => ("Time step", values.len()),
        Several::Arrays(names) => ("Array", names.len()),
        Several::Series(all) => ("Series", all.len()),
        Several::Levels(all) => ("Level", all.len()),
    };
    let last = count.saturating_sub(1);
    ui.horizontal(|ui| {
        ui.label(what);
        name(&number(ui, chosen, 0, |drag| drag.range(0..=last).speed(0.1)), what);
        ui.label(format!("from 0 to {last}"));
    });
}

/// Controls for the layout of headerless voxels.
fn stored(ui: &mut Ui, layout: &mut RawLayout) {
    const AXES: [&str; 3] = ["x", "y", "z"];
    Grid::new("layout").num_columns(2).show(ui, |ui| {
        ui.label("Voxels").on_hover_text("Along x, y and z; x varies fastest in the file.");
        ui.horizontal(|ui| {
            for (side, axis) in layout.dims.iter_mut().zip(AXES) {
                let side = number(ui, side, 0, |drag| drag.range(1..=usize::MAX >> 16));
                name(&side, &format!("voxels along {axis}"));
                side.on_hover_text(format!("Voxels along {axis}. Drag, or type a number."));
            }
        });
        ui.end_row();
        ui.label("Type").on_hover_text("Number type of a voxel.");
        ui.horizontal(|ui| {
            ComboBox::from_id_salt("type").selected_text(layout.voxel_type.name()).width(80.0).show_ui(ui, |ui| {
                for known in VoxelType::ALL {
                    ui.selectable_value(&mut layout.voxel_type, known, known.name());
                }
            });
            let orders = [
                (ByteOrder::Little, "little-endian", "The least significant byte of a number comes first."),
                (ByteOrder::Big, "big-endian", "The most significant byte of a number comes first."),
            ];
            for (order, name, help) in orders.into_iter().filter(|_| layout.voxel_type.bytes() > 1) {
                if toggle(ui, layout.byte_order == order, name).on_hover_text(help).clicked() {
                    layout.byte_order = order;
                }
            }
        });
        ui.end_row();
        ui.label("Skip").on_hover_text("Bytes before the first voxel.");
        ui.horizontal(|ui| {
            name(&number(ui, &mut layout.header_bytes, 0, |drag| drag.range(0..=u64::MAX >> 16)), "bytes to skip");
            ui.label("bytes");
        });
        ui.end_row();
        ui.label("Spacing").on_hover_text("Distance between voxels along x, y and z, for example in mm.");
        ui.horizontal(|ui| {
            for (step, axis) in layout.spacing.iter_mut().zip(AXES) {
                let step = number(ui, step, 6, |drag| drag.range(1e-6..=1e6).speed(0.01));
                name(&step, &format!("spacing along {axis}"));
            }
        });
        ui.end_row();
    });
}

/// Names a number for screen readers and tests.
fn name(response: &Response, of: &str) {
    response.widget_info(|| WidgetInfo::labeled(egui::WidgetType::DragValue, true, of));
}

/// Shows how the bytes of `layout` compare with the file's. Returns whether the file has enough.
fn fits(ui: &mut Ui, layout: &RawLayout, there: u64) -> bool {
    let taken = layout.bytes();
    let text = match taken {
        Some(taken) if taken == there => format!("This layout has all {there} bytes of the file."),
        Some(taken) if taken < there => format!("This layout has {taken} of the {there} bytes of the file."),
        Some(taken) => format!("This layout needs {taken} bytes, and the file has {there}."),
        None => format!("This layout is too large, and the file has {there} bytes."),
    };
    ui.label(text);
    taken.is_some_and(|taken| taken <= there)
}
