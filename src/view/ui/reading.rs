//! What is asked about a file before it can be read: which of its volumes is meant, or how its voxels lie.

use std::path::Path;

use egui::{Button, ComboBox, Grid, RichText, Ui};

use super::controls::{number, toggle};
use crate::view::load::{Question, Source};
use crate::volume::{ByteOrder, RawLayout, Selection, Several, VoxelType};

/// The question, and the answer so far.
#[derive(Debug)]
pub(super) struct Reading {
    source: Box<Source>,
    question: Question,
    /// Which of several it is to be.
    chosen: usize,
    /// How headerless voxels lie.
    layout: RawLayout,
}

impl Reading {
    pub(super) fn new(source: Source, question: Question) -> Self {
        let guess = match &question {
            Question::Layout { guess, .. } => guess.as_deref().cloned(),
            Question::Which(_) => None,
        };
        let layout = guess.unwrap_or_else(|| RawLayout::new([1; 3], VoxelType::U8));
        Self { source: Box::new(source), question, chosen: 0, layout }
    }

    /// Shows it. What is to be opened, once that is said; nothing where it is given up.
    pub(super) fn show(&mut self, ui: &mut Ui) -> Option<Option<Box<Source>>> {
        ui.set_max_width(360.0);
        let file = self.source.path.as_deref().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
        let sound = match &self.question {
            Question::Which(there) => {
                ui.heading(format!("{file} holds {there}"));
                which(ui, there, &mut self.chosen);
                true
            }
            Question::Layout { bytes, .. } => {
                ui.heading(format!("How are the voxels of {file} stored?"));
                let help = "The file has no header that says so. Its name often does, else whoever made it knows.";
                ui.label(RichText::new(help).small());
                lies(ui, &mut self.layout);
                fits(ui, &self.layout, *bytes)
            }
        };
        ui.add_space(6.0);
        ui.horizontal(|ui| {
            let open = ui.add_enabled(sound, Button::new("Open"));
            if open.on_disabled_hover_text("The file has too few bytes for that.").clicked() {
                return Some(Some(self.answered()));
            }
            ui.button("Cancel").clicked().then_some(None)
        })
        .inner
    }

    fn answered(&self) -> Box<Source> {
        let mut source = self.source.clone();
        let options = &mut source.options;
        let selection = match &self.question {
            Question::Which(Several::Components { .. }) => {
                Selection { component: Some(self.chosen), ..Selection::default() }
            }
            Question::Which(Several::Times(_)) => Selection { time: Some(self.chosen), ..Selection::default() },
            Question::Which(Several::Arrays(names)) => {
                Selection { array: names.get(self.chosen).cloned(), ..Selection::default() }
            }
            Question::Layout { .. } => {
                options.raw = Some(self.layout.clone());
                Selection::default()
            }
        };
        options.selection = selection.or(&options.selection);
        source
    }
}

/// One of several, by name or by number.
fn which(ui: &mut Ui, there: &Several, chosen: &mut usize) {
    let (what, count) = match there {
        Several::Arrays(names) => {
            for (index, name) in names.iter().enumerate() {
                ui.radio_value(chosen, index, name);
            }
            return;
        }
        Several::Components { count, .. } => ("Component", *count),
        Several::Times(count) => ("Time step", *count),
    };
    let last = count.saturating_sub(1);
    ui.horizontal(|ui| {
        let label = ui.label(what);
        number(ui, chosen, 0, |drag| drag.range(0..=last).speed(0.1)).labelled_by(label.id);
        ui.label(format!("from 0 to {last}"));
    });
}

/// What there is to say of headerless voxels.
fn lies(ui: &mut Ui, layout: &mut RawLayout) {
    Grid::new("layout").num_columns(2).show(ui, |ui| {
        ui.label("Voxels").on_hover_text("Along x, y and z; x varies fastest in the file.");
        ui.horizontal(|ui| {
            for (side, axis) in layout.dims.iter_mut().zip(["x", "y", "z"]) {
                let side = number(ui, side, 0, |drag| drag.range(1..=usize::MAX >> 16));
                side.on_hover_text(format!("Voxels along {axis}. Drag, or type a number."));
            }
        });
        ui.end_row();
        ui.label("Type").on_hover_text("What number a voxel is.");
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
        ui.label("Skip").on_hover_text("Bytes before the first voxel that are none of it.");
        ui.horizontal(|ui| {
            number(ui, &mut layout.header_bytes, 0, |drag| drag.range(0..=u64::MAX >> 16));
            ui.label("bytes");
        });
        ui.end_row();
        ui.label("Spacing").on_hover_text("From voxel to voxel along x, y and z, as in millimetres.");
        ui.horizontal(|ui| {
            for step in &mut layout.spacing {
                number(ui, step, 4, |drag| drag.range(1e-6..=1e6).speed(0.01));
            }
        });
        ui.end_row();
    });
}

/// Says whether a file of so many bytes has the voxels of `layout`. Whether it has them all.
fn fits(ui: &mut Ui, layout: &RawLayout, there: u64) -> bool {
    let taken = layout.bytes();
    let text = match taken {
        Some(taken) if taken == there => format!("That is all {there} bytes of the file."),
        Some(taken) if taken < there => format!("That is {taken} of the file's {there} bytes."),
        Some(taken) => format!("That is {taken} bytes, and the file has {there}."),
        None => format!("That is more than can be counted, and the file has {there} bytes."),
    };
    ui.label(text);
    taken.is_some_and(|taken| taken <= there)
}
