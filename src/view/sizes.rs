//! Sizes of the docks, kept between runs in the user's cache folder.

use std::path::{Path, PathBuf};

use super::layout::{Dock, DockSizes};
use super::recent;
use crate::input;

/// Largest size of the file in bytes.
const LARGEST: u64 = 1 << 10;

/// File of the sizes; none in a scripted window.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct KeptSizes(Option<PathBuf>);

impl KeptSizes {
    /// The file in `folder`, and its sizes. Unreadable sizes count as unknown.
    #[must_use]
    pub fn read(folder: &Path) -> (Self, DockSizes) {
        let file = folder.join("docks.txt");
        let text = input::read(&file, LARGEST).ok().and_then(|bytes| String::from_utf8(bytes).ok()).unwrap_or_default();
        let size = |dock: Dock| {
            let size = text.lines().find_map(|line| line.strip_prefix(dock.name())?.trim().parse().ok());
            size.filter(|size: &f32| size.is_finite() && *size > 0.0)
        };
        (Self(Some(file)), Dock::ALL.map(size))
    }

    /// Writes `sizes`. A file that cannot be written stays as it is; only the log says so.
    pub fn write(&self, sizes: &DockSizes) {
        let Some(file) = &self.0 else { return };
        let lines =
            Dock::ALL.iter().zip(sizes).filter_map(|(dock, size)| Some(format!("{} {}\n", dock.name(), (*size)?)));
        recent::keep(file, &lines.collect::<String>());
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    #[test]
    fn sizes_of_docks_are_those_of_the_last_run_and_damaged_ones_unknown() {
        let folder = std::env::temp_dir().join(format!("relume-docks-{}", std::process::id()));
        let (kept, none) = KeptSizes::read(&folder);
        assert_eq!(none, [None; 3]);
        kept.write(&[Some(333.5), None, Some(250.0)]);
        assert_eq!(KeptSizes::read(&folder), (kept.clone(), [Some(333.5), None, Some(250.0)]));
        for text in ["left NaN\nright -3\nbottom x\n", "left inf\n\nnothing 300\n", "left", "\0\u{fffd}"] {
            std::fs::write(folder.join("docks.txt"), text).unwrap();
            assert_eq!(KeptSizes::read(&folder).1, [None; 3], "{text:?}");
        }
        std::fs::remove_dir_all(folder).unwrap();
        KeptSizes::default().write(&[Some(1.0); 3]);
    }
}
