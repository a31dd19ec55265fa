//! What can be asked of the viewer, by a hand or by a script.

use std::path::PathBuf;

use glam::DVec2;

use crate::document::Edit;
use crate::document::Source;
use crate::document::design::Step;
use crate::measure::Goal;

/// A file that is chosen in a dialog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum File {
    /// A scene or a volume to open.
    Opened,
    /// A picture to save, as PNG.
    Picture,
    /// A picture to save, linear, as OpenEXR.
    LinearPicture,
    /// Accumulators to save.
    Accumulators,
    /// A session to save.
    Session,
}

/// For what somebody leaves what is looked at.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Leaving {
    /// For another scene or volume.
    Open(Box<Source>),
    /// For nothing: the window closes.
    Close,
}

/// What is lost with what is left.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Losing {
    /// Changes that are not saved.
    pub changes: bool,
    /// The pictures of a tour that are still to be saved.
    pub tour: bool,
    /// A picture that is saved once it is as fine as it gets.
    pub picture: bool,
}

impl Losing {
    /// Whether there is any of it.
    #[must_use]
    pub fn anything(self) -> bool {
        self.changes || self.tour || self.picture
    }
}

/// Something that is asked of the viewer.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Action {
    /// A change of what is looked at.
    Edit(Edit),
    /// A step back.
    Undo,
    /// A step forward.
    Redo,
    /// A dialog in which the file is chosen.
    Choose(File),
    /// Another scene or volume; where something would be lost, somebody is asked first.
    Open(Box<Source>),
    /// Another of the volumes in the file that is looked at: it is asked which, and looked at in the same way.
    Another,
    /// What is looked at is left, saved or not.
    Leave(Leaving),
    /// The window closes; where something would be lost, somebody is asked first.
    Close,
    /// The picture alone, once it is as fine as it gets: the bytes that `relume render` would write to this name, which ends
    /// in .png or .exr; `None` is a numbered name in this folder that is free.
    SavePicture(Option<PathBuf>),
    /// What the picture is made of, once it is as fine as it gets: the file that `relume render --accumulators` would write to
    /// this name, which ends in .exr; `None` as above.
    SaveAccumulators(Option<PathBuf>),
    /// What is looked at, as a scene file; `None` as above.
    SaveSession(Option<PathBuf>),
    /// All pixels of the window, as PNG.
    SaveWindow(PathBuf),
    /// A pixel to look at, in parts of the picture from the top left; or none.
    Probe(Option<DVec2>),
    /// The panels beside the picture, or the picture alone.
    Panels(bool),
    /// The hand from situation to situation in so many seconds; `None` stops it where it is.
    Tour(Option<f64>),
    /// So many pictures of that way, as NAME-0001.png and so on; `None` is a name in this folder that is free.
    SaveTour(Option<PathBuf>, u16),
    /// The scene on the device again, after that was lost more than once.
    Restart,
    /// Settings are measured: a curve of them, or those that it takes to find the one that does what is asked, which is then
    /// taken.
    Measure(Option<Goal>),
    /// The palette's editor, or none.
    Palette(bool),
    /// A palette for the materials that show, which can be had: [`crate::document::design::offer`].
    Offer,
    /// The open spectra of the palette are found, and take effect; with a step, those of the palette after it, which is taken
    /// together with them.
    Solve(Option<Step>),
    /// What is measured or solved is given up.
    GiveUp,
    /// A notice that was read, by its index.
    Dismiss(usize),
}
