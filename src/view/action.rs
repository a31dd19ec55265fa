//! Actions of the viewer, requested by the user or a script.

use std::path::PathBuf;

use glam::DVec2;

use super::layout::Arrange;
use crate::document::Edit;
use crate::document::Source;
use crate::document::design::Step;
use crate::measure::Goal;

/// Kind of file chosen in a dialog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum File {
    /// A scene or a volume to open.
    Opened,
    /// PNG picture to save.
    Picture,
    /// Linear OpenEXR picture to save.
    LinearPicture,
    /// Film file to save.
    Accumulators,
    /// Page to save.
    Page,
    /// Session to save.
    Session,
}

/// Reason to leave the current document.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Leaving {
    /// Another scene or volume is opened.
    Open(Box<Source>),
    /// The window closes.
    Close,
}

/// Unsaved work lost when the current document is left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losing {
    /// Unsaved changes.
    pub changes: bool,
    /// A tour with pictures still to be saved.
    pub tour: bool,
    /// A picture to be saved once the finest one is finished.
    pub picture: bool,
    /// A page being written. It is lost only if the window closes.
    pub page: bool,
}

impl Losing {
    /// Whether anything would be lost.
    #[must_use]
    pub fn anything(self) -> bool {
        self.changes || self.tour || self.picture || self.page
    }

    /// What of it `leaving` loses.
    #[must_use]
    pub fn by(self, leaving: &Leaving) -> Self {
        Self { page: self.page && *leaving == Leaving::Close, ..self }
    }
}

/// Action of the viewer.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Action {
    /// Edit of the document.
    Edit(Edit),
    /// Undo of one step.
    Undo,
    /// Redo of one step.
    Redo,
    /// Dialog for choosing the file.
    Choose(File),
    /// Opens another scene or volume; asks first if work would be lost.
    Open(Box<Source>),
    /// Asks for another volume of the current file and opens it with the same view.
    Another,
    /// Leaves the current document, saved or not.
    Leave(Leaving),
    /// Closes the window; asks first if work would be lost.
    Close,
    /// Saves the finest picture once it is finished: the same bytes as `relume render` writes to this name, which ends
    /// in
    /// .png or .exr. `None` takes a free numbered name in the current folder.
    SavePicture(Option<PathBuf>),
    /// Saves the film of the finest picture once it is finished: the file that `relume render --accumulators` writes to
    /// this name, which ends in .exr. `None` as above.
    SaveAccumulators(Option<PathBuf>),
    /// Saves the finest picture once it is finished as a page that relights in a browser; `None` as above.
    SavePage(Option<PathBuf>),
    /// Cancels the pages being written.
    GiveUpPage,
    /// Saves the document as a scene file; `None` as above.
    SaveSession(Option<PathBuf>),
    /// Saves all pixels of the window as PNG.
    SaveWindow(PathBuf),
    /// Selects the pixel to probe, as fractions of the picture from the top left; `None` for no pixel.
    Probe(Option<DVec2>),
    /// Adds an end of the measuring line at this pixel, given as fractions of the picture, at the depth of most of its
    /// light.
    RulerAt(DVec2),
    /// Shows or hides the panels next to the picture.
    Panels(bool),
    /// Changes the layout of the window.
    Arrange(Arrange),
    /// Plays a tour of the dial presets in this many seconds; `None` stops it at its current position.
    Tour(Option<f64>),
    /// Saves this many pictures of the tour as NAME-0001.png and so on; `None` takes a free name in the current folder.
    SaveTour(Option<PathBuf>, u16),
    /// Loads the scene onto the device again after repeated device loss.
    Restart,
    /// Measures accuracy settings: a curve of them, or those needed to find the one that meets the goal, which is then
    /// applied.
    Measure(Option<Goal>),
    /// Shows or hides the palette editor.
    Palette(bool),
    /// Offers a palette for the visible materials that can be realised: [`crate::document::design::offer`].
    Offer,
    /// Solves the open spectra of the palette and applies them. With a step, solves the palette after the step and
    /// applies
    /// both together.
    Solve(Option<Step>),
    /// Solves the palette with each preset of smoothness, to show what they cost. Changes no spectrum.
    CompareSmoothness,
    /// Stops the refinement of a coarse level of the volume until the next change.
    StopRefining,
    /// Cancels the measurement and the palette solver.
    GiveUp,
    /// Dismisses the notice with this index.
    Dismiss(usize),
}
