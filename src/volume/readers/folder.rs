//! Folders as volumes: their files, and the choice of the reader by them.

use std::io;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::{dicom, foreign, slices, tiff, zarr};
use crate::stream::beginning;
use crate::{Selection, Volume, VolumeError};
use crate::{data, stream};
use relume_base::progress::Progress;

/// Largest number of files and folders in a folder, together with those in its folders.
const MOST: usize = 100_000;
/// Levels of folders that are searched; exports of scanners have four.
const DEEPEST: usize = 8;

/// A function that finds the files of a format in a folder.
type Find = fn(&Folder, &dyn Progress) -> Result<Vec<PathBuf>, VolumeError>;

/// A function that reads the volume of some files of a folder.
type Read = fn(&Folder, &[PathBuf], &Selection, &dyn Progress) -> Result<Volume, VolumeError>;

/// A format of folders with a reader.
struct FolderFormat {
    name: &'static str,
    /// The files of the format, in the order of [`Folder::files`]; empty if the folder has another format.
    find: Find,
    /// Reads the volume of these files.
    read: Read,
}

/// All formats of folders; the first that finds a file reads the folder. A new reader is a new entry.
const FORMATS: [FolderFormat; 3] = [
    FolderFormat {
        name: "DICOM",
        find: |folder, progress| folder.recognised(dicom::recognises, progress),
        read: |folder, files, selection, progress| dicom::read_folder(&folder.path, files, selection, progress),
    },
    FolderFormat {
        name: "planes that OME-XML describes (.companion.ome, .ome.tif)",
        find: |folder, _| {
            let mut files = tiff::described_together(&folder.files);
            files.sort_unstable();
            Ok(files)
        },
        read: |folder, _, selection, progress| planes(folder, selection, progress),
    },
    FolderFormat {
        name: "slices (.png, .jpg, .bmp, .pgm, .ppm, .tif)",
        find: |folder, _| Ok(slices::find(&folder.path, &folder.files)),
        read: |folder, _, selection, progress| slices::read(&folder.path, &folder.files, selection, progress),
    },
];

/// A folder and its files.
#[derive(Debug)]
pub(crate) struct Folder {
    pub(crate) path: PathBuf,
    /// Files in the folder and in its folders, sorted by their names; names that begin with a dot are left out.
    pub(crate) files: Vec<PathBuf>,
    /// Number of folders below [`DEEPEST`] levels, whose files are left out.
    deeper: usize,
    /// Folders inside that cannot be listed, with the reason; their files are left out.
    unlisted: Vec<String>,
}

impl Folder {
    /// Lists the folder `path`.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`] if a folder cannot be listed, [`VolumeError::FolderTooLarge`] if there are more than
    /// 100 000 names, [`VolumeError::Cancelled`].
    pub(crate) fn list(path: &Path, progress: &dyn Progress) -> Result<Self, VolumeError> {
        let mut folder = Self { path: path.to_owned(), files: Vec::new(), deeper: 0, unlisted: Vec::new() };
        let mut names = 0;
        let mut folders = vec![path.to_owned()];
        for _ in 0..DEEPEST {
            let mut inside = Vec::new();
            for inner in &folders {
                inside.extend(folder.list_one(inner, &mut names, progress)?);
            }
            folders = inside;
        }
        folder.deeper = folders.len();
        folder.files.sort_unstable();
        Ok(folder)
    }

    /// Appends the files of the folder `path`; returns its folders. `names` counts all of them.
    fn list_one(
        &mut self,
        path: &Path,
        names: &mut usize,
        progress: &dyn Progress,
    ) -> Result<Vec<PathBuf>, VolumeError> {
        let failed = |source: io::Error| stream::failed(path, source);
        let mut folders = Vec::new();
        let entries = match std::fs::read_dir(path) {
            Ok(entries) => entries,
            Err(source) if path != self.path => {
                self.unlisted.push(format!("{} ({source})", path.strip_prefix(&self.path).unwrap_or(path).display()));
                return Ok(folders);
            }
            Err(source) => return Err(failed(source)),
        };
        for entry in entries {
            data::check_cancelled(&self.path, progress)?;
            let entry = entry.map_err(failed)?;
            *names += 1;
            if *names > MOST {
                return Err(VolumeError::FolderTooLarge { path: self.path.clone(), limit: MOST });
            }
            if entry.file_name().as_encoded_bytes().starts_with(b".") {
                continue;
            }
            let (file, kind) = (entry.path(), entry.file_type().map_err(failed)?);
            // A link counts as the file or the folder that it leads to.
            let (is_file, is_dir) =
                if kind.is_symlink() { (file.is_file(), file.is_dir()) } else { (kind.is_file(), kind.is_dir()) };
            if is_file {
                self.files.push(file);
            } else if is_dir {
                folders.push(file);
            }
        }
        folders.sort_unstable();
        Ok(folders)
    }

    /// The files whose first 4 KiB are those of a format; files that cannot be read are of none.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Cancelled`].
    fn recognised(&self, recognises: fn(&[u8]) -> bool, progress: &dyn Progress) -> Result<Vec<PathBuf>, VolumeError> {
        let one = |file: &PathBuf| -> Result<Option<PathBuf>, VolumeError> {
            data::check_cancelled(&self.path, progress)?;
            Ok(beginning(file).is_ok_and(|beginning| recognises(&beginning)).then(|| file.clone()))
        };
        self.files.par_iter().filter_map(|file| one(file).transpose()).collect()
    }

    /// The files that are volumes themselves, the first ones by name; `None` if there are none.
    fn volumes(&self, is_volume: fn(&Path, &[u8]) -> bool) -> Option<String> {
        /// Most names in a message.
        const NAMED: usize = 3;
        let volumes: Vec<_> = self.files.iter().filter(|file| is_volume(file, &[])).collect();
        let names = volumes.iter().take(NAMED).map(|file| file.display().to_string());
        let named = names.collect::<Vec<_>>().join(", ");
        match volumes.len() {
            0 => None,
            1..=NAMED => Some(named),
            count => Some(format!("{named} and {} more", count - NAMED)),
        }
    }

    /// Sentences about what is left out if the files `read` are read.
    fn notes(&self, read: &[PathBuf]) -> Vec<String> {
        let source = self.path.display();
        let others: Vec<_> = self.files.iter().filter(|file| read.binary_search(file).is_err()).collect();
        let mut notes = Vec::new();
        let (unread, others): (Vec<_>, Vec<_>) = others.into_iter().partition(|file| stream::open(file).is_err());
        if let Some(first) = unread.first() {
            let first = first.strip_prefix(&self.path).unwrap_or(first).display();
            notes.push(match unread.len() {
                1 => format!("{source}: the file {first} cannot be read, and is skipped"),
                count => format!("{source}: {count} files cannot be read, and are skipped; the first is {first}"),
            });
        }
        if let Some(first) = self.unlisted.first() {
            notes.push(match self.unlisted.len() {
                1 => format!("{source}: the folder {first} cannot be listed, and is skipped"),
                count => format!("{source}: {count} folders cannot be listed, and are skipped; the first is {first}"),
            });
        }
        if let Some(first) = others.first() {
            let first = first.strip_prefix(&self.path).unwrap_or(first).display();
            notes.push(match others.len() {
                1 => format!("{source}: the file {first} is of another format, and is skipped"),
                count => {
                    format!("{source}: {count} files are of another format, and are skipped; the first is {first}")
                }
            });
        }
        if self.deeper > 0 {
            notes.push(format!(
                "{source}: {} folders are deeper than {DEEPEST} levels, and are skipped; open them by themselves",
                self.deeper
            ));
        }
        notes
    }
}

/// Reads the volume of the folder `path`. `is_volume` tells volumes by their paths, for the message about a folder of them.
///
/// # Errors
///
/// As [`open`](crate::open()).
pub(crate) fn read(
    path: &Path,
    selection: &Selection,
    progress: &dyn Progress,
    is_volume: fn(&Path, &[u8]) -> bool,
) -> Result<Volume, VolumeError> {
    // A store may have millions of files, which nobody lists.
    if zarr::is_node(path) {
        return zarr::read(path, selection, progress);
    }
    if let Some(what) = foreign::describe_folder(path) {
        return Err(unknown(path, what));
    }
    selection.no_axes(&path.display().to_string())?;
    let folder = Folder::list(path, progress)?;
    for format in &FORMATS {
        let files = (format.find)(&folder, progress)?;
        if !files.is_empty() {
            let mut volume = (format.read)(&folder, &files, selection, progress)?;
            volume.notes.extend(folder.notes(&files));
            return Ok(volume);
        }
    }
    let pictures = slices::find_named(&folder.path, &folder.files);
    let is_other = |file: &&PathBuf| is_volume(file, &[]) && !pictures.contains(file);
    let have_volumes = folder.files.iter().any(|file| is_other(&file));
    if !pictures.is_empty() && !have_volumes {
        if let Some(mut volume) = slices::read_named(&folder.path, &pictures, selection, progress)? {
            let mut read = pictures;
            read.sort_unstable();
            volume.notes.extend(folder.notes(&read));
            return Ok(volume);
        }
        let what = format!(
            "this is a folder with {} pictures that are no slices of one volume: slices have one size and type, and numbers in \
             their names that state their order",
            pictures.len()
        );
        return Err(unknown(path, what));
    }
    let count = folder.files.len();
    let s = if count == 1 { "" } else { "s" };
    let mut what = format!("this is a folder with {count} file{s}, none of which Relume reads as a part of a volume");
    if let Some(volumes) = folder.volumes(is_volume) {
        what = format!("this is a folder with volumes, not a volume; open one of them: {volumes}");
    }
    Err(unknown(path, what))
}

/// Reads the planes in the files of a folder that OME-XML describes together.
fn planes(folder: &Folder, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let files = tiff::described_together(&folder.files);
    let main = files.first().map_or(folder.path.as_path(), PathBuf::as_path);
    let mut volume = tiff::read(main, selection, progress)?;
    let others = files.iter().filter(|file| !volume.files.contains(file)).count();
    // A choice of channel, time or level needs some of the files alone.
    let is_alone = volume.components == 1 && selection.time.is_none() && selection.series.is_none();
    if others > 0 && is_alone {
        volume.notes.push(format!(
            "{}: {others} TIFF files have no plane of the volume that {} describes, and are skipped",
            folder.path.display(),
            main.file_name().unwrap_or_default().to_string_lossy()
        ));
    }
    volume.source = folder.path.display().to_string();
    Ok(volume)
}

/// The error for the folder `path`, which `what` describes.
fn unknown(path: &Path, what: String) -> VolumeError {
    let known = FORMATS.iter().map(|format| format.name).collect::<Vec<_>>().join(", ");
    let known = format!("folders of {known}, and Zarr stores");
    VolumeError::UnknownFormat { path: path.to_owned(), what, is_known: true, known }
}
