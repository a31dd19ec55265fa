//! Selection of the reader for a volume file.

use std::fs::File;
use std::path::Path;

use super::{dicom, folder, foreign, hdf5, metaimage, mgh, mrc, nifti, nrrd, numpy, raw, tiff, vti, vtk, zarr};
use crate::slabs::Slabs;
use crate::stream::{beginning, count};
use crate::streamed::Streamed;
use crate::{BricksMade, HostMemory, MakeError, PackedBlocks, RawLayout, Selection, Volume, VolumeError, bricks};
use relume_base::progress::Progress;

/// Reads the header of a file.
type ReadHeader = fn(&Path, &Selection) -> Result<Streamed, VolumeError>;

/// A format with a reader.
struct Format {
    name: &'static str,
    /// File extensions, in lower case; `nii.gz` is one.
    extensions: &'static [&'static str],
    /// Whether the first bytes of a file identify the format; used if the extension does not.
    recognises: fn(&[u8]) -> bool,
    /// Whether a file with an extension of the format holds another one: some extensions are shared.
    is_another: fn(&Path) -> Result<bool, VolumeError>,
    /// Choices that files of the format offer beside component, time step and array.
    further: Further,
    read: fn(&Path, &Selection, &dyn Progress) -> Result<Volume, VolumeError>,
    access: Access,
}

/// Way of reading voxels without holding all of them.
enum Access {
    /// Not at all.
    Whole,
    /// In the order of the file, behind a header.
    Stream(ReadHeader),
    /// Some slices at a time; the header needs so many of them.
    Slabs(usize),
}

/// Choices beside component, time step and array.
#[derive(Clone, Copy)]
struct Further {
    series: bool,
    levels: bool,
    /// Axes of an array that does not name them.
    axes: bool,
}

/// A file has one series, one level of resolution and axes of its own.
const NOTHING: Further = Further { series: false, levels: false, axes: false };

/// For a format whose extensions no other has.
const ALONE: fn(&Path) -> Result<bool, VolumeError> = |_| Ok(false);

impl Format {
    /// Whether `path` has an extension of the format.
    fn names(&self, path: &Path) -> bool {
        let name = path.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let ends =
            |extension: &&str| name.strip_suffix(extension).is_some_and(|stem| stem.len() > 1 && stem.ends_with('.'));
        self.extensions.iter().any(ends)
    }

    /// Refuses choices that the format does not offer, for the file `source`.
    fn check(&self, source: &str, selection: &Selection) -> Result<(), VolumeError> {
        if !self.further.series {
            selection.no_series(source)?;
        }
        if !self.further.levels {
            selection.no_level(source)?;
        }
        if !self.further.axes {
            selection.no_axes(source)?;
        }
        Ok(())
    }

    /// Reads the file `path`, after the refusal of choices that the format does not offer.
    fn open(&self, path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
        self.check(&path.display().to_string(), selection)?;
        (self.read)(path, selection, progress)
    }
}

/// All formats; a new reader is a new line.
const FORMATS: [Format; 16] = [
    Format {
        name: "bricks",
        extensions: &["bricks"],
        recognises: bricks::recognises,
        is_another: ALONE,
        further: Further { levels: true, ..NOTHING },
        read: bricks::read,
        access: Access::Whole,
    },
    Format {
        name: "DICOM",
        extensions: &["dcm", "dicom", "ima"],
        recognises: dicom::recognises,
        is_another: ALONE,
        further: Further { series: true, ..NOTHING },
        read: dicom::read,
        access: Access::Slabs(1),
    },
    Format {
        name: "MetaImage",
        extensions: &["mhd", "mha"],
        recognises: metaimage::recognises,
        is_another: ALONE,
        further: NOTHING,
        read: metaimage::read,
        access: Access::Stream(metaimage::streamed),
    },
    Format {
        name: "NIfTI and Analyze",
        extensions: &["nii", "nii.gz", "hdr", "hdr.gz", "img", "img.gz"],
        recognises: nifti::recognises,
        is_another: nifti::is_another,
        further: NOTHING,
        read: nifti::read,
        access: Access::Stream(nifti::streamed),
    },
    Format {
        name: "NRRD",
        extensions: &["nrrd", "nhdr"],
        recognises: nrrd::recognises,
        is_another: ALONE,
        further: NOTHING,
        read: nrrd::read,
        access: Access::Stream(nrrd::streamed),
    },
    Format {
        name: "MGH",
        extensions: &["mgh", "mgz", "mgh.gz"],
        recognises: mgh::recognises,
        is_another: ALONE,
        further: NOTHING,
        read: mgh::read,
        access: Access::Stream(mgh::streamed),
    },
    Format {
        name: "MRC and CCP4",
        extensions: &["mrc", "mrc.gz", "ccp4", "ccp4.gz", "map", "map.gz", "rec"],
        recognises: mrc::recognises,
        is_another: mrc::is_another,
        further: NOTHING,
        read: mrc::read,
        access: Access::Stream(mrc::streamed),
    },
    Format {
        name: "NumPy array",
        extensions: &["npy"],
        recognises: numpy::recognises,
        is_another: ALONE,
        further: Further { axes: true, ..NOTHING },
        read: numpy::read,
        access: Access::Stream(numpy::streamed),
    },
    Format {
        name: "NumPy archive",
        extensions: &["npz"],
        recognises: numpy::recognises_archive,
        is_another: ALONE,
        further: Further { axes: true, ..NOTHING },
        read: numpy::read_archive,
        access: Access::Whole,
    },
    Format {
        name: "TIFF",
        extensions: &["tif", "tiff", "btf", "tf2", "tf8", "companion.ome"],
        recognises: |beginning| tiff::recognises(beginning) || tiff::recognises_companion(beginning),
        is_another: ALONE,
        further: Further { series: true, levels: true, ..NOTHING },
        read: tiff::read,
        access: Access::Slabs(1),
    },
    Format {
        name: "VTK legacy",
        extensions: &["vtk"],
        recognises: vtk::recognises,
        is_another: ALONE,
        further: NOTHING,
        read: vtk::read,
        access: Access::Whole,
    },
    Format {
        name: "VTK XML image data",
        extensions: &["vti"],
        recognises: vti::recognises,
        is_another: ALONE,
        further: NOTHING,
        read: vti::read,
        access: Access::Whole,
    },
    Format {
        name: "HDF5",
        extensions: &["h5", "hdf5", "he5", "ims", "mnc", "nc4", "emd", "nxs"],
        recognises: hdf5::recognises,
        is_another: ALONE,
        further: Further { levels: true, axes: true, ..NOTHING },
        read: hdf5::read,
        access: Access::Slabs(0),
    },
    Format {
        name: "NetCDF",
        extensions: &["nc", "cdf"],
        recognises: hdf5::recognises_netcdf,
        is_another: ALONE,
        further: Further { levels: true, axes: true, ..NOTHING },
        read: hdf5::read,
        access: Access::Slabs(0),
    },
    Format {
        name: "raw with a sidecar",
        extensions: &["raw", "dat", "bin"],
        recognises: |_| false,
        is_another: |path| Ok(raw::sidecar(path).is_none() && has_header(path)),
        further: NOTHING,
        read: raw::read_beside_sidecar,
        access: Access::Stream(raw::streamed_beside_sidecar),
    },
    Format {
        name: "sidecar of raw voxels",
        extensions: &["toml"],
        recognises: |_| false,
        is_another: ALONE,
        further: NOTHING,
        read: raw::read_sidecar,
        access: Access::Stream(raw::streamed_by_sidecar),
    },
];

/// Extensions of the files that [`open`] may read, in lower case; a `.toml` may also be a scene.
pub fn extensions() -> impl Iterator<Item = &'static str> {
    FORMATS.iter().flat_map(|format| format.extensions.iter().copied())
}

/// Reads the volume in a file or a folder. The extension of a file determines the format; for other extensions, the
/// first bytes do. For a folder, its files do.
///
/// `selection` chooses among several volumes in a file or folder. Memory is bounded by the chosen volume and a slab of 4 MiB; VTK
/// files need one block of their compressed values in addition. `progress` counts decoded bytes.
///
/// # Errors
///
/// [`VolumeError::UnknownFormat`] if no reader knows the file or folder, [`VolumeError::Choose`] if it holds several volumes and
/// `selection` does not choose one, [`VolumeError::NoSuch`] if the chosen volume does not exist,
/// [`VolumeError::Cancelled`] if `progress` requests it, and the error of the reader for a defective file.
pub fn open(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let volume = read(path, selection, progress)?;
    // The voxels have already taken their part of the available memory.
    if let HostMemory::Bounded { bytes: Some(_) } = selection.memory {
        let bytes = count(volume.voxels.len()).saturating_mul(count(volume.voxels.voxel_type().bytes()));
        selection.memory.check(&path.display().to_string(), bytes)?;
    }
    Ok(volume)
}

/// [`open`] without the limit of the memory, which formats that are read slice by slice check before they read.
fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    if path.is_dir() {
        return folder::read(path, selection, progress, is_volume);
    }
    if std::fs::metadata(path).is_ok_and(|it| it.is_file() && it.len() == 0) {
        return Err(VolumeError::Empty { path: path.to_owned() });
    }
    if let Some(what) = foreign::describe_address(path) {
        return Err(unknown(path, what, true));
    }
    if let Some(format) = format_of(path)? {
        return format.open(path, selection, progress);
    }
    match zarr::node_of(path) {
        Some(store) => zarr::read(&store, selection, progress),
        None => {
            let beginning = beginning(path)?;
            Err(unknown(path, foreign::describe(path, &beginning), foreign::is_known(&beginning)))
        }
    }
}

/// The format of the file `path`, by its extension or else by its first bytes.
fn format_of(path: &Path) -> Result<Option<&'static Format>, VolumeError> {
    if let Some(format) = FORMATS.iter().find(|format| format.names(path))
        && !(format.is_another)(path)?
    {
        return Ok(Some(format));
    }
    let beginning = beginning(path)?;
    Ok(FORMATS.iter().find(|format| (format.recognises)(&beginning)))
}

/// Makes a file of bricks of the volume in the file `source` and writes it to the empty `file`. `layout` is that of
/// headerless voxels.
///
/// The source is read once, slice by slice: as a stream, or some slices at a time, which take a half of `budget` at most. 64 slices of each level of resolution, together 4/3 of those of the volume, are
/// kept in memory, or in temporary files in `folder` as far as they take more than `budget` bytes. For voxels of more than
/// two bytes the bricks are read once more, for mean and histogram.
///
/// # Errors
///
/// [`MakeError`]; [`VolumeError::NotStreamed`] if the source is not read slice by slice.
pub fn make_bricks(
    (source, layout): (&Path, Option<&RawLayout>),
    selection: &Selection,
    (file, folder): (&File, &Path),
    budget: u64,
    progress: &dyn Progress,
) -> Result<BricksMade, MakeError> {
    let input = input(source, layout, selection, progress)?;
    bricks::make(source, input, selection, (file, folder), budget, progress)
}

/// The volume in the file or folder `path`, before its voxels are read; `layout` is that of headerless voxels.
fn input(
    path: &Path,
    layout: Option<&RawLayout>,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<bricks::Input, VolumeError> {
    if let Some(layout) = layout {
        if has_header(path) {
            return Err(VolumeError::HasHeader { path: path.to_owned() });
        }
        let file = Some(path.to_owned());
        let streamed = raw::streamed(&RawLayout { file, ..layout.clone() }, Path::new(""), selection)?;
        return Ok(bricks::Input::Stream(streamed));
    }
    let slabs = |probe| {
        let (slabs, volume) = Slabs::of(path, selection, (read, probe), progress)?;
        Ok(bricks::Input::Slabs(Box::new(slabs), Box::new(volume)))
    };
    if path.is_dir() {
        return slabs(usize::from(!zarr::is_node(path)));
    }
    let Some(format) = format_of(path)? else {
        // A part of a Zarr store, or the error of an unknown format.
        return slabs(0);
    };
    format.check(&path.display().to_string(), selection)?;
    match format.access {
        Access::Whole => {
            let reason = "its format is read as a whole";
            Err(VolumeError::NotStreamed { source_name: path.display().to_string(), reason })
        }
        Access::Stream(streamed) => Ok(bricks::Input::Stream(streamed(path, selection)?)),
        Access::Slabs(probe) => slabs(probe),
    }
}

/// Returns the compressed blocks of the values that [`open`] would read from `path`; `None` unless it is a VTK XML file
/// of compressed blocks. They take as much memory as in the file.
///
/// # Errors
///
/// As [`open`].
pub fn packed_blocks(
    path: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Option<PackedBlocks>, VolumeError> {
    if path.is_dir() {
        return Ok(None);
    }
    let beginning = beginning(path)?;
    if vti::recognises(&beginning) { vti::packed(path, selection, progress) } else { Ok(None) }
}

/// The error for `path`, which `what` describes; `is_known` if its format is known.
fn unknown(path: &Path, what: String, is_known: bool) -> VolumeError {
    let known = FORMATS.map(|format| format!("{} (.{})", format.name, format.extensions.join(", .")));
    VolumeError::UnknownFormat { path: path.to_owned(), what, is_known, known: known.join(", ") }
}

/// Whether the extension or the first bytes of a file identify a volume; the extension `.toml` does not count. A folder
/// can only be a volume.
pub fn is_volume(path: &Path, beginning: &[u8]) -> bool {
    let named = |format: &Format| !format.extensions.contains(&"toml") && format.names(path);
    let is_known = |format: &Format| named(format) || (format.recognises)(beginning);
    path.is_dir() || FORMATS.iter().any(is_known) || zarr::node_of(path).is_some()
}

/// The error of [`open`] for a file whose content identifies a format without a reader; otherwise `None`.
pub fn refusal(path: &Path) -> Option<VolumeError> {
    let beginning = beginning(path).ok().filter(|it| foreign::is_known(it) && zarr::node_of(path).is_none())?;
    Some(unknown(path, foreign::describe(path, &beginning), true))
}

/// Whether the file `path` has a header that describes its voxels.
pub fn has_header(path: &Path) -> bool {
    beginning(path).is_ok_and(|beginning| FORMATS.iter().any(|format| (format.recognises)(&beginning)))
}

/// Reads the volume in the file `path`: by `layout` if given (its `file` is ignored), otherwise as [`open`] does.
///
/// # Errors
///
/// As [`open_raw`].
pub fn open_by(
    path: &Path,
    layout: Option<&RawLayout>,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    match layout {
        Some(layout) => {
            let file = Some(path.to_owned());
            open_raw(&RawLayout { file, ..layout.clone() }, Path::new(""), selection, progress)
        }
        None => open(path, selection, progress),
    }
}

/// Reads headerless voxels; `layout.file` is relative to the folder `base`.
///
/// # Errors
///
/// As [`open`]; [`VolumeError::Layout`] if the layout contradicts itself, [`VolumeError::HasHeader`] if the file has a
/// header.
pub fn open_raw(
    layout: &RawLayout,
    base: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    if let Some(path) = layout.file.as_ref().map(|file| base.join(file)).filter(|path| has_header(path)) {
        return Err(VolumeError::HasHeader { path });
    }
    raw::read(layout, base, selection, progress)
}
