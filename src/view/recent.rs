//! Files opened last, kept between runs in the user's cache folder.

use std::path::{Path, PathBuf};

use crate::input;
use crate::output::write_atomically;

/// Largest number of files kept.
const MOST: usize = 8;
/// Largest size of the list in bytes.
const LARGEST: u64 = 1 << 16;

/// Files opened last, the latest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recent {
    /// The list; `None` if it is not kept.
    list: Option<PathBuf>,
    paths: Vec<PathBuf>,
}

impl Recent {
    /// Reads the list in `folder`. A missing or unreadable list is empty.
    #[must_use]
    pub fn read(folder: &Path) -> Self {
        let list = folder.join("recent.txt");
        let text = input::read(&list, LARGEST).ok().and_then(|bytes| String::from_utf8(bytes).ok()).unwrap_or_default();
        let paths = text.lines().filter(|line| !line.is_empty()).map(PathBuf::from).take(MOST).collect();
        Self { list: Some(list), paths }
    }

    /// The files.
    #[must_use]
    pub fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Puts the absolute path of `path` first. A list that cannot be written stays as it is; only the log says so.
    pub fn add(&mut self, path: &Path) {
        let Ok(path) = std::path::absolute(path) else { return };
        self.paths.retain(|known| *known != path);
        self.paths.insert(0, path);
        self.paths.truncate(MOST);
        let Some(list) = &self.list else { return };
        // A line holds one path; others are known until the window closes.
        let lines = self.paths.iter().filter_map(|path| path.to_str()).filter(|path| !path.contains('\n'));
        let text: String = lines.flat_map(|line| [line, "\n"]).collect();
        keep(list, &text);
    }
}

/// Writes `text` to a file of the cache folder. A file that cannot be written stays as it is; only the log says so.
pub(super) fn keep(file: &Path, text: &str) {
    let written = file.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(|error| error.to_string());
    let written = written.and_then(|()| {
        write_atomically(file, |sink| sink.write_all(text.as_bytes())).map_err(|error| error.to_string())
    });
    if let Err(error) = written {
        tracing::debug!("{}: {error}", file.display());
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    #[test]
    fn the_latest_file_comes_first_and_once_also_in_the_next_run() {
        let folder = std::env::temp_dir().join(format!("relume-recent-{}", std::process::id()));
        let mut recent = Recent::read(&folder);
        assert!(recent.paths().is_empty(), "there is no list yet");
        let file = |index: usize| std::env::temp_dir().join(format!("{index}.nrrd"));
        for index in [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 7] {
            recent.add(&file(index));
        }
        let expected: Vec<_> = [7, 9, 8, 6, 5, 4, 3, 2].map(file).to_vec();
        assert_eq!(recent.paths(), expected);
        assert_eq!(Recent::read(&folder), recent);
        std::fs::remove_dir_all(folder).unwrap();
    }
}
