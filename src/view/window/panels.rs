//! State of the panels beside the document, and the notices that they show.

use egui::{Context, TexturesDelta};

use super::Viewer;
use super::report::keep;
use crate::view::advice;
use crate::view::layout::Layout;
use crate::view::recent::Recent;
use crate::view::sizes::KeptSizes;
use crate::view::ui::{self, Chooser, Notice};

/// Largest number of notices kept.
const MOST_NOTICES: usize = 4;

/// State of the panels.
#[derive(Default)]
pub(super) struct Panels {
    pub(super) context: Context,
    pub(super) textures: TexturesDelta,
    /// Whether the panels are shown, if that was asked for; by default where they have room.
    pub(super) shown: Option<bool>,
    /// Docks and tabs, slices, annotations and the measuring line.
    pub(super) layout: Layout,
    /// Files opened last.
    pub(super) recent: Recent,
    /// File of the sizes of the docks.
    pub(super) sizes: KeptSizes,
    /// Dialog for the paths of files.
    pub(super) chooser: Chooser,
    /// Whether the palette editor is open.
    pub(super) editing: bool,
    pub(super) notices: Vec<Notice>,
    /// Whether a notice was added after the last layout of the panels.
    pub(super) untold: bool,
}

impl Panels {
    /// Keeps the sizes of the docks after a drag, for the next run.
    pub(super) fn keep_sizes(&mut self) {
        // The window's own size also limits its docks, so only a dragged edge counts.
        if let Some((dock, size)) = ui::resized_dock(&self.context) {
            self.layout.sizes[dock as usize] = Some(size);
            self.sizes.write(&self.layout.sizes);
        }
    }
}

impl Viewer {
    pub(super) fn tell(&mut self, error: &(dyn std::error::Error + 'static)) {
        let text = advice::line(error);
        keep(&mut self.record.report.failures, text.clone());
        self.note(text);
    }

    /// Adds a notice of success, except in a scripted run, where nobody reads it.
    pub(super) fn tell_done(&mut self, text: String) {
        if !self.is_scripted() {
            self.add(Notice::done(text));
        }
    }

    pub(super) fn note(&mut self, text: String) {
        self.add(Notice::wrong(text));
    }

    pub(super) fn add(&mut self, notice: Notice) {
        self.panels.notices.retain(|known| known.text != notice.text);
        self.panels.notices.push(notice);
        self.panels.untold = true;
        if self.panels.notices.len() > MOST_NOTICES {
            self.panels.notices.remove(0);
        }
    }
}
