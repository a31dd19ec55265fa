//! Files that are read, which are files.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Opens a regular file, or what a symbolic link to one leads to. All others are refused: a pipe would wait for ever, a
/// device would never end.
///
/// # Errors
///
/// What the system says, or what is there in place of a file.
pub fn open(path: &Path) -> io::Result<File> {
    // Before it is opened, because opening a pipe waits for somebody to write.
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a folder" } else { "a pipe, a socket or a device" };
        return Err(io::Error::other(format!("this is {what}, not a file")));
    }
    File::open(path)
}

/// The bytes of a regular file, `longest` at most; one more tells that there are more.
///
/// # Errors
///
/// As [`open`], and what the system says.
pub fn read(path: &Path, longest: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.take(longest.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok(bytes)
}
