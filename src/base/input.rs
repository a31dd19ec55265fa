//! Access to regular files only.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Opens a regular file, following symbolic links. Refuses all other files: a pipe would block for ever, a device would
/// never end.
///
/// # Errors
///
/// The system's error, or a message with the type of the refused file.
pub fn open(path: &Path) -> io::Result<File> {
    // Checked before opening, because opening a pipe waits for a writer.
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a folder" } else { "a pipe, a socket or a device" };
        return Err(io::Error::other(format!("this is {what}, not a file")));
    }
    File::open(path)
}

/// Reads at most `longest` + 1 bytes of a regular file; the extra byte shows that the file is longer.
///
/// # Errors
///
/// Those of [`open`], and the system's errors.
pub fn read(path: &Path, longest: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.take(longest.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok(bytes)
}
