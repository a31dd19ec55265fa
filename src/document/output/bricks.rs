//! Files of bricks, as [`write_atomically`](super::write_atomically) writes them.

use std::io;
use std::path::Path;

use super::OutputError;
use super::atomic::write_file_atomically;
use relume_base::progress::Progress;
use relume_volume::{BricksMade, MakeError, RawLayout, Selection, VolumeError, make_bricks};

/// Writes a file of bricks of the volume in the file `source` to `path`; `layout` is that of headerless voxels. `budget` is
/// the memory for a slab of 64 slices, in bytes; a larger slab is kept in a temporary file beside `path`.
///
/// # Errors
///
/// [`OutputError::Volume`] if the volume cannot be read, or not slice by slice, [`OutputError::Cancelled`], and those of
/// [`write_atomically`](super::write_atomically).
pub fn write_bricks(
    path: &Path,
    (source, layout): (&Path, Option<&RawLayout>),
    selection: &Selection,
    budget: u64,
    progress: &dyn Progress,
) -> Result<BricksMade, OutputError> {
    let mut made = None;
    let mut failed = None;
    let written = write_file_atomically(path, |file, folder| {
        match make_bricks((source, layout), selection, (file, folder), budget, progress) {
            Ok(bricks) => {
                made = Some(bricks);
                Ok(())
            }
            Err(MakeError::Write(error)) => Err(error),
            Err(MakeError::Volume(error)) => {
                failed = Some(error);
                Err(io::Error::other("the volume cannot be read"))
            }
        }
    });
    match (failed, made) {
        (Some(VolumeError::Cancelled { .. }), _) => Err(OutputError::Cancelled { path: path.to_owned() }),
        (Some(error), _) => Err(error.into()),
        (None, Some(made)) => written.map(|()| made),
        // Only an error of writing leaves neither.
        (None, None) => written.and_then(|()| {
            Err(OutputError::Write { path: path.to_owned(), source: io::Error::other("no bricks were made") })
        }),
    }
}
