//! Files that appear whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::OutputError;

/// What a file's content is written into: bytes in order, with a way back to fill in offsets.
pub trait Sink: Write + Seek {}

impl<T: Write + Seek> Sink for T {}

/// The longest chain of symbolic links that is followed, as in Linux.
const LONGEST_CHAIN: usize = 40;

/// Every temporary file that was begun. Those that are gone do no harm: their names are never used again.
static BEGUN: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes what is half written, in a program that ends at once: nothing can be written any more after this.
pub fn discard_unfinished() {
    let begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
    for path in &*begun {
        // Most are whole, and have another name now.
        fs::remove_file(path).ok();
    }
    // Kept for ever: another thread may not begin another one before the end.
    std::mem::forget(begun);
}

/// Writes a file so that `path` holds either all of the new content or, after any error, what it held before.
///
/// `fill` writes the content; it goes to a temporary file in the same folder, is synced to the disk and renamed over
/// `path`. An existing file keeps its permissions, and one that may not be written to is not replaced. Of a symbolic
/// link the target is replaced. What is not an ordinary file (`/dev/stdout`, a FIFO) cannot be renamed over: it
/// receives the finished content at the end.
///
/// # Errors
///
/// [`OutputError::NoFolder`], [`OutputError::IsFolder`], [`OutputError::DiskFull`], [`OutputError::FileLimit`],
/// [`OutputError::NoFile`] where the folder takes no other file, and [`OutputError::Write`] for all else, an error of `fill`
/// included. No temporary file is left behind.
pub fn write_atomically(path: &Path, fill: impl FnOnce(&mut dyn Sink) -> io::Result<()>) -> Result<(), OutputError> {
    match look(path)? {
        (target, Some(metadata)) if !metadata.is_file() => write_special(path, &target, fill),
        (target, existing) => replace(path, &target, existing.map(|metadata| metadata.permissions()), fill),
    }
}

/// Refuses a path that [`write_atomically`] could not even begin to write, before work is done for it. Writes nothing.
///
/// # Errors
///
/// Those of [`write_atomically`].
pub fn check_writable(path: &Path) -> Result<(), OutputError> {
    match look(path)? {
        (_, Some(metadata)) if !metadata.is_file() => Ok(()),
        (target, existing) => beside(path, &target, existing.is_some()).map(drop),
    }
}

/// Where `path` leads, and what is there: anything but a folder.
fn look(path: &Path) -> Result<(PathBuf, Option<fs::Metadata>), OutputError> {
    let target = follow_links(path).map_err(|source| OutputError::Write { path: path.to_owned(), source })?;
    match fs::metadata(&target) {
        Ok(metadata) if metadata.is_dir() => Err(OutputError::IsFolder { path: path.to_owned() }),
        Ok(metadata) => Ok((target, Some(metadata))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok((target, None)),
        Err(source) => Err(OutputError::Write { path: path.to_owned(), source }),
    }
}

/// Writes beside `target`, an ordinary file or none, and renames.
fn replace(
    path: &Path,
    target: &Path,
    permissions: Option<fs::Permissions>,
    fill: impl FnOnce(&mut dyn Sink) -> io::Result<()>,
) -> Result<(), OutputError> {
    let failed = |written, source| failure(path, written, source);
    let temporary = beside(path, target, permissions.is_some())?;
    let file = temporary.as_file();
    let filled = fill_file(file, fill)
        .and_then(|()| permissions.map_or(Ok(()), |permissions| file.set_permissions(permissions)))
        .and_then(|()| file.sync_all());
    filled.map_err(|source| failed(length(file), source))?;
    temporary.persist(target).map_err(|error| failed(0, error.error))?;
    Ok(())
}

/// An empty temporary file beside `target`, which may be replaced where it `exists`.
fn beside(path: &Path, target: &Path, exists: bool) -> Result<tempfile::NamedTempFile, OutputError> {
    let folder = match target.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(OutputError::NoFolder { path: path.to_owned(), folder: folder.to_owned() });
    }
    if exists {
        // The rename would not ask whether this file may be written to.
        OpenOptions::new().write(true).open(target).map_err(|source| failure(path, 0, source))?;
    }
    let mut builder = tempfile::Builder::new();
    builder.prefix(".relume-").suffix(".part");
    #[cfg(unix)]
    {
        // What any new file gets; the system takes the umask off.
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut begun = BEGUN.lock().unwrap_or_else(PoisonError::into_inner);
    // What the system says of a file that nobody has asked for is of no use.
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

/// Writes to an unnamed file, since a pipe cannot seek, and copies that to `target`.
fn write_special(
    path: &Path,
    target: &Path,
    fill: impl FnOnce(&mut dyn Sink) -> io::Result<()>,
) -> Result<(), OutputError> {
    let mut content = tempfile::tempfile().map_err(|source| failure(path, 0, source))?;
    fill_file(&content, fill).map_err(|source| failure(path, length(&content), source))?;
    let opened = OpenOptions::new().write(true).open(target).map_err(|source| failure(path, 0, source))?;
    let mut sent = Counted { to: opened, bytes: 0 };
    let copied = content.rewind().and_then(|()| io::copy(&mut content, &mut sent)).and_then(|_| sent.flush());
    copied.map_err(|source| failure(path, sent.bytes, source))
}

/// Runs `fill` on a buffer before `file`, and empties the buffer.
fn fill_file(file: &File, fill: impl FnOnce(&mut dyn Sink) -> io::Result<()>) -> io::Result<()> {
    let mut buffered = BufWriter::with_capacity(1 << 16, file);
    fill(&mut buffered)?;
    buffered.flush()
}

/// The path behind a chain of symbolic links; the last one may lead to a file that does not exist yet.
fn follow_links(path: &Path) -> io::Result<PathBuf> {
    let mut target = path.to_owned();
    for _ in 0..LONGEST_CHAIN {
        match fs::symlink_metadata(&target) {
            // The links under /proc/self/fd, where /dev/stdout leads, may name what no path reaches.
            Ok(metadata) if metadata.is_symlink() && !fs::metadata(&target).is_ok_and(|end| is_special(&end)) => {
                let next = fs::read_link(&target)?;
                target = target.parent().map_or_else(|| next.clone(), |folder| folder.join(&next));
            }
            _ => return Ok(target),
        }
    }
    Err(io::Error::other(format!("more than {LONGEST_CHAIN} symbolic links in a row")))
}

/// Whether this is neither a file nor a folder: a device, a pipe, a socket.
fn is_special(metadata: &fs::Metadata) -> bool {
    !metadata.is_file() && !metadata.is_dir()
}

/// How many bytes have reached `file`.
fn length(file: &File) -> u64 {
    file.metadata().map_or(0, |metadata| metadata.len())
}

/// The error for `source`, met after `written` bytes.
fn failure(path: &Path, written: u64, source: io::Error) -> OutputError {
    let path = path.to_owned();
    match source.kind() {
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded => OutputError::DiskFull { path, written, source },
        io::ErrorKind::FileTooLarge => OutputError::FileLimit { path, written, source },
        _ => OutputError::Write { path, source },
    }
}

/// Counts the bytes that an opened file took.
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
