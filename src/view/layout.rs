//! Layout of the window: docks beside the picture, and the tabs in them.

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
}

/// Layout of the window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    open: [bool; Dock::ALL.len()],
    /// Tab of the right dock.
    pub right: Tab,
    /// Tab of the bottom dock, where it has no room for both.
    pub bottom: Tab,
}

impl Default for Layout {
    /// All docks are open.
    fn default() -> Self {
        Self { open: [true; Dock::ALL.len()], right: Tab::Camera, bottom: Tab::Transfer }
    }
}

impl Layout {
    /// Whether a dock is open.
    #[must_use]
    pub fn is_open(&self, dock: Dock) -> bool {
        self.open[dock as usize]
    }

    /// Applies a change.
    pub fn arrange(&mut self, change: Arrange) {
        match change {
            Arrange::Dock(dock, open) => self.open[dock as usize] = open,
            Arrange::Tab(tab) if Tab::BOTTOM.contains(&tab) => {
                (self.bottom, self.open[Dock::Bottom as usize]) = (tab, true);
            }
            Arrange::Tab(tab) => (self.right, self.open[Dock::Right as usize]) = (tab, true),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
