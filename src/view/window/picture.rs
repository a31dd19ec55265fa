//! The picture in the window, and the pixel that is probed.

use std::time::{Duration, Instant};

use egui::Rect;
use glam::{DVec2, DVec3};

use super::Viewer;
use super::report::keep;
use crate::document::State;
use crate::number::{count, unsigned, whole};
use crate::scene::{Camera, View};
use crate::view::engine::{Engine, Reached};
use crate::view::layout::Arrange;
use crate::view::probe::Probe;
use crate::view::prober::Prober;

/// Time after the last change of the camera or scene at which finer pictures start.
pub(super) const REST: Duration = Duration::from_millis(150);

/// Place of the picture, and its probe.
pub(super) struct Picture {
    /// Rectangle of the picture in the window, in points.
    pub(super) place: Rect,
    /// Probe of the selected pixel.
    pub(super) prober: Prober,
    /// Whether the crosshair of the slices goes to the depth of the probe, once that is known.
    pub(super) seeks: bool,
    /// Whether the probe finds the depth of an end of the measuring line; it is not shown then.
    pub(super) measures: bool,
    /// World point kept under the probe while the picture's size changes, with its position in the picture and the
    /// camera.
    looked_at: Option<(DVec2, Camera, DVec3)>,
    /// Time of the last edit that needed a march.
    moved: Instant,
    /// Pictures of the current request that were shown.
    reached: Reached,
}

impl Picture {
    /// No picture yet.
    pub(super) fn new(begun: Instant) -> Self {
        Self {
            place: Rect::ZERO,
            prober: Prober::default(),
            seeks: false,
            measures: false,
            looked_at: None,
            moved: begun,
            reached: Reached::default(),
        }
    }
}

/// Position of a world point in the picture of `view`, as fractions from the top left; `None` outside the picture.
pub(super) fn place_inside(view: &View, point: DVec3) -> Option<DVec2> {
    view.place_of(point).filter(|place| place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all())
}

impl Viewer {
    /// Probes the pixel at `place`; the crosshair of the slices follows to the depth of most of its light.
    pub(super) fn look_at(&mut self, place: Option<DVec2>) {
        (self.picture.seeks, self.picture.measures) = (place.is_some(), false);
        self.picture.prober.look(place);
    }

    /// Probes the pixel at `place` for the depth of an end of the measuring line.
    pub(super) fn measure_at(&mut self, place: DVec2) {
        (self.picture.seeks, self.picture.measures) = (false, true);
        self.picture.prober.look(None);
        self.picture.prober.look(Some(place));
    }

    /// Takes the depth of a finished probe for the measuring line. Returns whether there was one.
    fn measured_depth(&mut self) -> bool {
        if !(self.picture.measures && self.picture.prober.is_done()) {
            return false;
        }
        let found = self.picture.prober.probe().and_then(Probe::brightest).map(|stretch| stretch.place);
        self.look_at(None);
        match (found, &self.opened.document) {
            (Some(index), Some(document)) => {
                let end = document.state().scene.frame.geometry.world_from_index(index);
                self.panels.layout.arrange(Arrange::RulerEnd(end));
            }
            _ => self.note("The measuring line has no end here: nothing is visible at this pixel.".to_owned()),
        }
        true
    }

    /// Puts the crosshair of the slices, or an end of the measuring line, at the depth of a new probe. Returns whether
    /// one moved.
    pub(super) fn follow_probe(&mut self) -> bool {
        if self.measured_depth() {
            return true;
        }
        if !(self.picture.seeks && self.picture.prober.is_done()) {
            return false;
        }
        self.picture.seeks = false;
        let found = self.picture.prober.probe().and_then(Probe::brightest).map(|stretch| stretch.place);
        found.into_iter().for_each(|place| self.panels.layout.arrange(Arrange::SliceAt(place)));
        found.is_some() && self.panels.layout.slices.shown
    }

    /// Updates the picture from the document.
    pub(super) fn show_again(&mut self) {
        self.request(Engine::update);
    }

    /// As [`Self::show_again`], for a change that a tour made.
    pub(super) fn show_tour(&mut self) {
        self.request(Engine::renew);
    }

    fn request(&mut self, of: impl Fn(&mut Engine, &State, [usize; 2]) -> bool) {
        let (Some(document), Some(engine)) = (&self.opened.document, &mut self.engine) else { return };
        if of(engine, document.state(), self.record.report.size) {
            (self.picture.moved, self.picture.reached) = (Instant::now(), Reached::default());
        }
    }

    /// Rectangle of the picture in window pixels: left, top, width, height.
    pub(super) fn pixels(&self, pixels_per_point: f32) -> [u32; 4] {
        let edge = |points: f32| unsigned(whole(f64::from(points * pixels_per_point).round().max(0.0)));
        let (low, high) = (self.picture.place.min, self.picture.place.max);
        let [left, top] = [edge(low.x), edge(low.y)];
        [left, top, edge(high.x).saturating_sub(left), edge(high.y).saturating_sub(top)]
    }

    /// Sets the picture's rectangle and requests a picture if it has changed.
    pub(super) fn fit(&mut self, place: Rect, pixels_per_point: f32) {
        if self.picture.place == place && self.record.report.size != [0; 2] {
            return;
        }
        self.picture.place = place;
        let [_, _, width, height] = self.pixels(pixels_per_point).map(|pixels| pixels.max(1));
        let before = std::mem::replace(&mut self.record.report.size, [width as usize, height as usize]);
        self.look_at_the_same(before);
        self.show_again();
    }

    /// Moves the probe to the same world point after a size change; removes it if the point has left the picture.
    pub(super) fn look_at_the_same(&mut self, before: [usize; 2]) {
        let (Some(place), Some(document)) = (self.picture.prober.place(), &self.opened.document) else { return };
        let (camera, geometry) = (&document.state().scene.camera, &document.state().scene.frame.geometry);
        let view = |[width, height]: [usize; 2]| camera.view(geometry, count(width.max(1)) / count(height.max(1)));
        let (Some(was), Some(is)) = (view(before), view(self.record.report.size)) else { return };
        let at = |index: DVec3| geometry.world_from_index(index);
        let middle = at((DVec3::from_array(geometry.dims.map(count)) - 1.0) / 2.0);
        // During successive size changes, intermediate pixels are not probed.
        let known = self.picture.looked_at.take().filter(|(there, by, _)| *there == place && by == camera);
        let point = match (known, self.picture.prober.probe().and_then(Probe::brightest)) {
            (Some((.., point)), _) => point,
            (None, Some(stretch)) => at(stretch.place),
            (None, None) => was.point_at(place, middle),
        };
        let there = place_inside(&is, point);
        self.picture.looked_at = there.map(|there| (there, camera.clone(), point));
        self.picture.prober.look(there);
    }

    pub(super) fn hand_rests(&self) -> bool {
        self.picture.moved.elapsed() > REST || self.is_scripted()
    }

    /// Records the times of the first and finest pictures shown.
    pub(super) fn note_reached(&mut self) {
        let Some(engine) = &self.engine else { return };
        if let (Some(exposure), Some(document)) = (engine.found_exposure(), &mut self.opened.document) {
            document.expose(exposure);
        }
        let (before, after) = (self.picture.reached, engine.reached());
        let took = 1000.0 * engine.since_change().as_secs_f64();
        if after.first && !before.first {
            keep(&mut self.record.report.coarse_ms, took);
            self.record.report.first_picture_ms.get_or_insert(1000.0 * self.begun.elapsed().as_secs_f64());
        }
        if after.finest && !before.finest {
            keep(&mut self.record.report.finest_ms, took);
            self.lost.times = 0;
        }
        self.picture.reached = after;
    }
}
