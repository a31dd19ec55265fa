//! Atomic file output: a file appears whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::OutputError;

/// Destination of a file's content: sequential writes, with seeking to fill in offsets.
pub trait Sink: Write + Seek {}

impl<T: Write + Seek> Sink for T {}

/// Longest chain of symbolic links followed, as in Linux.
const LONGEST_CHAIN: usize = 40;

/// All temporary files ever begun. Files that no longer exist do no harm: their names are never reused.
static BEGUN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes unfinished files before the process exits. Blocks every later write.
pub fn discard_unfinished() {
    let begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
    for path in &*begun {
        // Most are finished and renamed.
        fs::remove_file(path).ok();
    }
    // Never unlock: another thread must not begin a new file before the process ends.
    std::mem::forget(begun);
}

/// Writes a file so that `path` holds either the whole new content or, after any error, the previous content.
///
/// `fill` writes the content to a temporary file in the same folder, which is synced to the disk and renamed over
/// `path`. An existing file keeps its permissions; a read-only file is not replaced. For a symbolic link, the target is
/// replaced. A special file (`/dev/stdout`, a FIFO) cannot be renamed over: it receives the finished content at the
/// end.
///
/// # Errors
///
/// [`OutputError::NoFolder`], [`OutputError::IsFolder`], [`OutputError::DiskFull`], [`OutputError::FileLimit`],
/// [`OutputError::NoFile`] if the folder accepts no new file, and [`OutputError::Write`] for all other errors,
/// including those of `fill`. No temporary file is left behind.
pub fn write_atomically(path: &Path, fill: impl FnOnce(&mut dyn Sink) -> io::Result<()>) -> Result<(), OutputError> {
    write_file_atomically(path, |file, _| fill_file(file, fill))
}

/// As [`write_atomically`]; `fill` gets the empty file, which it may also read, and the folder in which it lies.
///
/// # Errors
///
/// Same as [`write_atomically`].
pub(super) fn write_file_atomically(
    path: &Path,
    fill: impl FnOnce(&File, &Path) -> io::Result<()>,
) -> Result<(), OutputError> {
    match look(path)? {
        (target, Some(metadata)) if !metadata.is_file() => write_special(path, &target, fill),
        (target, existing) => replace(path, &target, existing.map(|metadata| metadata.permissions()), fill),
    }
}

/// Refuses a path to which [`write_atomically`] could not begin to write, before any work is done for it. Writes
/// nothing.
///
/// # Errors
///
/// Same as [`write_atomically`].
pub fn check_writable(path: &Path) -> Result<(), OutputError> {
    match look(path)? {
        (_, Some(metadata)) if !metadata.is_file() => Ok(()),
        (target, existing) => beside(path, &target, existing.is_some()).map(drop),
    }
}

/// Resolves `path`, and returns the metadata of an existing target. Refuses folders.
fn look(path: &Path) -> Result<(PathBuf, Option<fs::Metadata>), OutputError> {
    let target = follow_links(path).map_err(|source| OutputError::Write { path: path.to_owned(), source })?;
    match fs::metadata(&target) {
        Ok(metadata) if metadata.is_dir() => Err(OutputError::IsFolder { path: path.to_owned() }),
        Ok(metadata) => Ok((target, Some(metadata))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok((target, None)),
        Err(source) => Err(OutputError::Write { path: path.to_owned(), source }),
    }
}

/// Writes a temporary file next to `target`, a regular file or none, and renames it.
fn replace(
    path: &Path,
    target: &Path,
    permissions: Option<fs::Permissions>,
    fill: impl FnOnce(&File, &Path) -> io::Result<()>,
) -> Result<(), OutputError> {
    let failed = |written, source| failure(path, written, source);
    let temporary = beside(path, target, permissions.is_some())?;
    let file = temporary.as_file();
    let filled = fill(file, folder_of(target))
        .and_then(|()| permissions.map_or(Ok(()), |permissions| file.set_permissions(permissions)))
        .and_then(|()| file.sync_all());
    filled.map_err(|source| failed(length(file), source))?;
    temporary.persist(target).map_err(|error| failed(0, error.error))?;
    Ok(())
}

/// The folder of the file `target`.
fn folder_of(target: &Path) -> &Path {
    target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Creates an empty temporary file next to `target`. If the target `exists`, it must be writable.
fn beside(path: &Path, target: &Path, exists: bool) -> Result<tempfile::NamedTempFile, OutputError> {
    let folder = folder_of(target);
    if !folder.is_dir() {
        return Err(OutputError::NoFolder { path: path.to_owned(), folder: folder.to_owned() });
    }
    if exists {
        // The rename does not check whether this file is writable.
        OpenOptions::new().write(true).open(target).map_err(|source| failure(path, 0, source))?;
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".relume-").suffix(".part");
    #[cfg(unix)]
    {
        // Default mode of a new file; the system applies the umask.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
    // Report only the kind: the system's message names the temporary file, which means nothing to the user.
    let refused = |source: io::Error| match failure(path, 0, source) {
        OutputError::Write { path, source } => {
            OutputError::NoFile { path, folder: folder.to_owned(), source: source.kind().into() }
        }
        failed => failed,
    };
    let temporary = builder.tempfile_in(folder).map_err(refused)?;
    begun.push(temporary.path().to_owned());
    Ok(temporary)
}

/// Writes to an unnamed file, since a pipe cannot seek, and copies it to `target`.
fn write_special(
    path: &Path,
    target: &Path,
    fill: impl FnOnce(&File, &Path) -> io::Result<()>,
) -> Result<(), OutputError> {
    let mut content = tempfile::tempfile().map_err(|source| failure(path, 0, source))?;
    fill(&content, &std::env::temp_dir()).map_err(|source| failure(path, length(&content), source))?;
    let opened = OpenOptions::new().write(true).open(target).map_err(|source| failure(path, 0, source))?;
    let mut sent = Counted { to: opened, bytes: 0 };
    let copied = content.rewind().and_then(|()| io::copy(&mut content, &mut sent)).and_then(|_| sent.flush());
    copied.map_err(|source| failure(path, sent.bytes, source))
}

/// Runs `fill` on a buffered `file`, and flushes the buffer.
fn fill_file(file: &File, fill: impl FnOnce(&mut dyn Sink) -> io::Result<()>) -> io::Result<()> {
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    fill(&mut buffered)?;
    buffered.flush()
}

/// Follows a chain of symbolic links; the last target may not exist yet.
fn follow_links(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_owned();
    for _ in 0..LONGEST_CHAIN {
        match fs::symlink_metadata(&target) {
            // The links in /proc/self/fd, to which /dev/stdout leads, may name targets without a path.
            Ok(metadata) if metadata.is_symlink() && !fs::metadata(&target).is_ok_and(|end| is_special(&end)) => {
                let next = fs::read_link(&target)?;
                target = target.parent().map_or_else(|| next.clone(), |folder| folder.join(&next));
            }
            _ => return Ok(target),
        }
    }
    Err(io::Error::other(format!("a chain of more than {LONGEST_CHAIN} symbolic links")))
}

/// Whether this is a device, pipe or socket: neither a file nor a folder.
fn is_special(metadata: &fs::Metadata) -> bool {
    !metadata.is_file() && !metadata.is_dir()
}

/// Number of bytes written to `file`.
fn length(file: &File) -> u64 {
    file.metadata().map_or(0, |metadata| metadata.len())
}

/// Converts `source`, which occurred after `written` bytes.
fn failure(path: &Path, written: u64, source: io::Error) -> OutputError {
    let path = path.to_owned();
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => OutputError::DiskFull { path, written, source },
        io::ErrorKind::FileTooLarge => OutputError::FileLimit { path, written, source },
        _ => OutputError::Write { path, source },
    }
}

/// Writer that counts the bytes a file accepted.
struct Counted {
    to: File,
    bytes: u64,
}

impl Write for Counted {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let taken = self.to.write(bytes)?;
        self.bytes += taken as u64;
        Ok(taken)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}
