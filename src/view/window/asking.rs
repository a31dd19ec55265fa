//! Actions of the panels and of scripts.

use super::Viewer;
use super::picture::place_inside;
use crate::document::{Document, Edit};
use crate::number::count;
use crate::view::action::{Action, Leaving, Losing};
use crate::view::engine::Engine;
use crate::view::layout::Arrange;
use crate::view::tour::Tour;

impl Viewer {
    pub(super) fn ask(&mut self, action: Action) {
        match action {
            Action::Edit(edit) => {
                if !edit.leaves_light() {
                    self.stop_tour();
                }
                // Neither changes the picture.
                let spares = matches!(edit, Edit::Design(_) | Edit::Rename(..));
                self.change(spares, |document| document.edit(&edit));
            }
            Action::Undo => {
                self.stop_tour();
                self.change(false, Document::undo);
            }
            Action::Redo => {
                self.stop_tour();
                self.change(false, Document::redo);
            }
            Action::Open(source) if self.losing().by(&Leaving::Open(source.clone())).anything() => {
                self.panels.chooser.leave(Leaving::Open(source));
            }
            Action::Open(source) | Action::Leave(Leaving::Open(source)) => self.open(*source),
            Action::Another => self.open_another(),
            Action::Close if self.losing().anything() => self.panels.chooser.leave(Leaving::Close),
            Action::Close | Action::Leave(Leaving::Close) => self.ending.now = true,
            Action::Choose(file) => self.choose(file),
            Action::SavePicture(path) => self.save_picture(path),
            Action::SaveAccumulators(path) => self.save_accumulators(path),
            Action::SavePage(path) => self.save_page(path),
            Action::GiveUpPage => self.saving.give_up_pages(),
            Action::SaveSession(path) => self.save_session(path),
            Action::SaveWindow(path) => self.saving.capture = Some(path),
            Action::Restart => {
                self.lost.times = 1;
                self.restore();
            }
            Action::Tour(seconds) => self.tour(seconds),
            Action::SaveTour(path, frames) => self.begin_tour(path, frames),
            Action::Panels(shown) => self.panels.shown = Some(shown),
            Action::RulerAt(place) => self.measure_at(place),
            Action::Arrange(change) => self.arrange(change),
            Action::Probe(place) => self.look_at(place),
            Action::Measure(goal) => self.measure(goal),
            Action::Palette(shown) => self.panels.editing = shown,
            Action::Offer => self.offer(),
            Action::Solve(step) => self.solve(step),
            Action::CompareSmoothness => self.compare_smoothness(),
            Action::GiveUp => (self.tasks.measuring, self.tasks.solving) = (None, None),
            Action::StopRefining => self.engine.iter_mut().for_each(Engine::stop),
            Action::Dismiss(index) => {
                if index < self.panels.notices.len() {
                    self.panels.notices.remove(index);
                }
            }
        }
    }

    /// Changes the layout. A probe follows the crosshair of the slices.
    fn arrange(&mut self, change: Arrange) {
        self.panels.layout.arrange(change);
        // The end of a measuring line stays where it was clicked.
        let follows = self.picture.prober.place().is_some() && !self.picture.measures;
        let (Arrange::SliceAt(_), true) = (change, follows) else { return };
        let Some(document) = &self.opened.document else { return };
        let scene = &document.state().scene;
        let (geometry, [width, height]) = (&scene.frame.geometry, self.record.report.size.map(count));
        let point = geometry.world_from_index(self.panels.layout.slices.crosshair(geometry));
        let view = scene.camera.view(geometry, width.max(1.0) / height.max(1.0));
        if let Some(place) = view.and_then(|view| place_inside(&view, point)) {
            self.picture.prober.look(Some(place));
            self.picture.seeks = false;
        }
    }

    /// Changes the document. Gives up a tour being saved, whose pictures must show one state, unless the change
    /// `spares` it.
    pub(super) fn change(&mut self, spares: bool, change: impl FnOnce(&mut Document) -> bool) {
        if !self.opened.document.as_mut().is_some_and(change) {
            return;
        }
        if !spares {
            self.give_up_tour("The scene or the light was changed");
        }
        self.show_again();
    }

    /// Unsaved work; none in a scripted run, which nobody can answer for.
    pub(super) fn losing(&self) -> Losing {
        if self.is_scripted() {
            return Losing::default();
        }
        Losing {
            changes: self.opened.document.as_ref().is_some_and(|document| !document.is_saved()),
            tour: matches!(self.tour, Some(Tour::Saving { .. })),
            picture: self.is_awaited(),
            page: self.saving.page().is_some(),
        }
    }
}
