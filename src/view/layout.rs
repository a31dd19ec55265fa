//! Layout of the window: docks beside the picture and their tabs, slices, annotations and the measuring line.

use glam::DVec3;

use super::slices::Slices;

/// A dock beside the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dock {
    /// Lights, dial and dial presets.
    Left,
    /// Tabs for camera, crop box, display and accuracy.
    Right,
    /// Transfer function and spectra.
    Bottom,
}

impl Dock {
    /// All docks.
    pub const ALL: [Self; 3] = [Self::Left, Self::Right, Self::Bottom];

    /// Name in scripts, and in the window with *dock* behind it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Bottom => "bottom",
        }
    }
}

/// Size of each dock in points, across for the docks at the sides; `None` before the first change.
pub type DockSizes = [Option<f32>; Dock::ALL.len()];

/// A tab of the right or the bottom dock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tab {
    /// Camera.
    Camera,
    /// Crop box.
    Crop,
    /// Display.
    Display,
    /// Accuracy.
    Accuracy,
    /// Transfer function.
    Transfer,
    /// Spectra of materials and lights.
    Spectra,
}

impl Tab {
    /// Tabs of the right dock.
    pub const RIGHT: [Self; 4] = [Self::Camera, Self::Crop, Self::Display, Self::Accuracy];
    /// Tabs of the bottom dock.
    pub const BOTTOM: [Self; 2] = [Self::Transfer, Self::Spectra];

    /// Name in the window; in lower case also in scripts.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Camera => "Camera",
            Self::Crop => "Crop",
            Self::Display => "Display",
            Self::Accuracy => "Accuracy",
            Self::Transfer => "Transfer",
            Self::Spectra => "Spectra",
        }
    }
}

/// A change of the layout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Arrange {
    /// Opens or closes a dock.
    Dock(Dock, bool),
    /// Shows a tab, and opens its dock.
    Tab(Tab),
    /// Shows or hides the slices.
    Slices(bool),
    /// Puts the crosshair of the slices at a voxel index.
    SliceAt(DVec3),
    /// Enlarges the slices by a factor, around a voxel index in their middle.
    SliceZoom(f64, DVec3),
    /// Values shown black and white in the slices.
    Window([f64; 2]),
    /// Shows or hides the materials over the slices.
    SliceMaterials(bool),
    /// Shows or hides the labels over the slices.
    SliceLabels(bool),
    /// Shows or hides an annotation of the picture.
    Note(Note, bool),
    /// Shows or hides the list of keys.
    Help(bool),
    /// Shows a step of the first minute; `None` ends it.
    Lesson(Option<usize>),
    /// Starts or ends measuring with the line. The start clears an older line.
    Ruler(bool),
    /// Adds an end of the measuring line, in world units. A third one starts a new line.
    RulerEnd(DVec3),
}

/// An annotation over the picture in the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Note {
    /// Scale bar.
    Scale,
    /// Anatomical letters at the edges.
    Letters,
    /// Names, colours and spectra of the visible materials and of the lights that are on.
    Legend,
    /// Name of the scene or volume.
    Title,
}

impl Note {
    /// All annotations.
    pub const ALL: [Self; 4] = [Self::Scale, Self::Letters, Self::Legend, Self::Title];

    /// Name in the window; in scripts in lower case, its first word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Scale => "Scale bar",
            Self::Letters => "Letters at the edges",
            Self::Legend => "Legend",
            Self::Title => "Title",
        }
    }
}

/// Measuring line.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ruler {
    /// Whether clicks set its ends.
    pub on: bool,
    /// Its ends in world units, as far as they are set; the first one first.
    pub ends: [Option<DVec3>; 2],
}

impl Ruler {
    /// Length in world units, if both ends are set.
    #[must_use]
    pub fn length(&self) -> Option<f64> {
        Some(self.ends[0]?.distance(self.ends[1]?))
    }
}

/// Largest factor by which slices are enlarged.
pub const MOST_ZOOM: f64 = 64.0;

/// Layout of the window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    open: [bool; Dock::ALL.len()],
    /// Sizes of the docks when they open.
    pub sizes: DockSizes,
    /// Tab of the right dock.
    pub right: Tab,
    /// Tab of the bottom dock, where it has no room for both.
    pub bottom: Tab,
    /// Slices beside the picture.
    pub slices: Slices,
    /// Measuring line.
    pub ruler: Ruler,
    /// Whether the list of keys is open.
    pub help: bool,
    /// Step of the first minute, from 0.
    pub lesson: Option<usize>,
    notes: [bool; Note::ALL.len()],
}

impl Default for Layout {
    /// All docks are open, the slices are hidden, and the picture has a scale bar and letters.
    fn default() -> Self {
        Self {
            open: [true; Dock::ALL.len()],
            sizes: [None; Dock::ALL.len()],
            right: Tab::Camera,
            bottom: Tab::Transfer,
            slices: Slices::default(),
            ruler: Ruler::default(),
            help: false,
            lesson: None,
            notes: [true, true, false, false],
        }
    }
}

impl Layout {
    /// Whether a dock is open.
    #[must_use]
    pub fn is_open(&self, dock: Dock) -> bool {
        self.open[dock as usize]
    }

    /// Whether an annotation is visible.
    #[must_use]
    pub fn has(&self, note: Note) -> bool {
        self.notes[note as usize]
    }

    /// Forgets the crosshair and the window of the slices and the measuring line, which belong to a volume.
    pub fn forget_volume(&mut self) {
        (self.slices.at, self.slices.window, self.ruler.ends) = (None, None, [None; 2]);
        self.slices.zoom = None;
    }

    /// Applies a change.
    pub fn arrange(&mut self, change: Arrange) {
        match change {
            Arrange::Dock(dock, open) => self.open[dock as usize] = open,
            Arrange::Tab(tab) if Tab::BOTTOM.contains(&tab) => {
                (self.bottom, self.open[Dock::Bottom as usize]) = (tab, true);
            }
            Arrange::Slices(shown) => self.slices.shown = shown,
            Arrange::SliceAt(at) => self.slices.at = Some(at),
            Arrange::SliceZoom(zoom, middle) => {
                self.slices.zoom = (zoom > 1.0).then_some((zoom.min(MOST_ZOOM), middle));
            }
            Arrange::Window(window) => self.slices.window = Some(window),
            Arrange::SliceMaterials(shown) => self.slices.materials = shown,
            Arrange::SliceLabels(shown) => self.slices.labels = shown,
            Arrange::Note(note, shown) => self.notes[note as usize] = shown,
            Arrange::Help(shown) => self.help = shown,
            Arrange::Lesson(step) => self.lesson = step,
            Arrange::Ruler(true) => self.ruler = Ruler { on: true, ends: [None; 2] },
            Arrange::Ruler(false) => self.ruler.on = false,
            Arrange::RulerEnd(end) => {
                self.ruler.ends = match self.ruler.ends {
                    [Some(first), None] => [Some(first), Some(end)],
                    _ => [Some(end), None],
                };
            }
            Arrange::Tab(tab) => (self.right, self.open[Dock::Right as usize]) = (tab, true),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_measuring_line_has_two_ends_and_a_third_starts_another() {
        let mut layout = Layout::default();
        layout.arrange(Arrange::Ruler(true));
        let mut lengths = Vec::new();
        for x in [1.0, 4.0, 6.0] {
            layout.arrange(Arrange::RulerEnd(DVec3::new(x, 4.0 * x / 3.0, 0.0)));
            lengths.push(layout.ruler.length());
        }
        assert_eq!(lengths, [None, Some(5.0), None]);
        layout.arrange(Arrange::Ruler(false));
        assert_eq!(layout.ruler.ends[0], Some(DVec3::new(6.0, 8.0, 0.0)), "it stays in sight");
        layout.arrange(Arrange::Ruler(true));
        assert_eq!(layout.ruler, Ruler { on: true, ends: [None; 2] });
    }

    #[test]
    fn a_tab_opens_its_dock() {
        let mut layout = Layout::default();
        for (dock, tabs) in [(Dock::Right, &Tab::RIGHT[..]), (Dock::Bottom, &Tab::BOTTOM)] {
            for &tab in tabs {
                layout.arrange(Arrange::Dock(dock, false));
                assert!(!layout.is_open(dock) && layout.is_open(Dock::Left));
                layout.arrange(Arrange::Tab(tab));
                assert!(layout.is_open(dock) && [layout.right, layout.bottom].contains(&tab), "{tab:?}");
            }
        }
    }
}
