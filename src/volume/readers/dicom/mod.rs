//! DICOM: single files, and folders of the files of series.
//!
//! The meaning of the elements is that of DICOM PS3.3 (<https://dicom.nema.org>), their encoding that of PS3.5 and PS3.10.
//! Positions are in millimetres, left-posterior-superior, as the world here.

mod codec;
mod dataset;
mod frame;
mod image;
mod keys;
mod mosaic;
mod pixels;
mod segments;
mod series;
mod steps;
mod syntax;

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::data::Listing;
use crate::geometry::Lattice;
use crate::resample::Grid;
use crate::stream::beginning;
use crate::unit::Unit;
use crate::{Selection, Volume, VolumeError, Voxel, Voxels, allocate, with_voxels};
use image::{About, Image};
use pixels::{Pixels, Slice, Values};
use relume_base::number::whole;
use relume_base::progress::Progress;
use series::{Series, Stack};
use steps::Steps;

/// The mark behind the preamble, or, without a preamble, first elements in the order of their tags, or one of the identifying
/// group (DICOM PS3.10, §7.1).
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    beginning.get(128..132) == Some(b"DICM")
        || matches!(beginning, [0x08, 0x00, 0x00 | 0x01 | 0x05 | 0x08 | 0x16, 0x00, v, r, ..] if v.is_ascii_uppercase() && r.is_ascii_uppercase())
        || dataset::begins(beginning)
}

/// True if these first bytes may be those of a DICOM file: without a preamble, the first group is 0002 or 0008.
fn may_be_dicom(beginning: &[u8]) -> bool {
    recognises(beginning) || matches!(beginning, [2 | 8, 0, ..] | [0, 2 | 8, ..])
}

/// Reads the file `path`.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let image = Image::read(path);
    if matches!(image, Ok(None) | Err(VolumeError::Field { .. })) && !may_be_dicom(&beginning(path)?) {
        let problem = "there is no DICM, and the file does not begin with a data set: it is no DICOM file".to_owned();
        return Err(VolumeError::Field { path: path.to_owned(), place: "byte 128".to_owned(), problem });
    }
    let Some(image) = image? else {
        let problem = "the file has no pixels; open the folder of the images that it refers to".to_owned();
        return Err(VolumeError::Field { path: path.to_owned(), place: "PixelData (7FE0,0010)".to_owned(), problem });
    };
    volume(&[image], Vec::new(), path, Vec::new(), selection, progress)
}

/// Reads the series of the `files` of the folder `source`.
pub(crate) fn read_folder(
    source: &Path,
    files: &[PathBuf],
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    selection.no_level(&source.display().to_string())?;
    let listing = Listing::of(source, files.len(), progress);
    let read: Vec<Result<Option<Image>, VolumeError>> = files
        .par_iter()
        .map(|file| {
            listing.next()?;
            Image::read(file)
        })
        .collect();
    let (mut images, mut without, mut damaged, mut notes) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (file, read) in files.iter().zip(read) {
        match read {
            Ok(Some(image)) => images.push(image),
            Ok(None) => without.push(file),
            Err(error @ VolumeError::Cancelled { .. }) => return Err(error),
            Err(error) => damaged.push(Damaged { file, error }),
        }
    }
    if let Some(first) = without.first() {
        let (count, name) = (without.len(), first.strip_prefix(source).unwrap_or(first).display().to_string());
        notes.push(match count {
            1 => format!("{}: the DICOM file {name} has no pixels, and is skipped", source.display()),
            _ => format!(
                "{}: {count} DICOM files have no pixels, and are skipped; the first is {name}",
                source.display()
            ),
        });
    }
    let (images, copies) = series::without_copies(images);
    if copies.removed > 0 {
        let (count, name) = (copies.removed, source.display());
        let are = if count == 1 { "file is a copy of another" } else { "files are copies of others" };
        notes.push(format!("{name}: {count} {are} (equal SOPInstanceUID); copies are skipped"));
    }
    if copies.kept > 0 {
        let (count, name) = (copies.kept, source.display());
        let have = if count == 1 { "file has" } else { "files have" };
        notes.push(format!(
            "{name}: {count} {have} the SOPInstanceUID of another file, but another place or other attributes; they are read as well"
        ));
    }
    if images.is_empty()
        && let Some(Damaged { error, .. }) = damaged.pop()
    {
        return Err(error);
    }
    if images.is_empty() {
        let (place, problem) =
            ("the folder".to_owned(), format!("{} DICOM files, none of which has pixels", files.len()));
        return Err(VolumeError::Field { path: source.to_owned(), place, problem });
    }
    volume(&images, damaged, source, notes, selection, progress)
}

/// A file that cannot be read.
struct Damaged<'a> {
    file: &'a Path,
    error: VolumeError,
}

impl Damaged<'_> {
    /// The index of the file's series among those with these identifiers, if its beginning tells it: `Some(None)` for
    /// another series.
    fn series(&self, identifiers: &[&str]) -> Option<Option<usize>> {
        const LONGEST: u64 = 1 << 20;
        let beginning = relume_base::input::read(self.file, LONGEST).ok()?;
        let has = |text: &[u8]| memchr::memmem::find(&beginning, text);
        let ends = |at: usize, text: &str| {
            beginning.get(at + text.len()).is_none_or(|&next| !matches!(next, b'0'..=b'9' | b'.'))
        };
        // Identifiers of instances often begin with that of the series, and come first.
        let is_of = |text: &&str| memchr::memmem::find_iter(&beginning, text.as_bytes()).any(|at| ends(at, text));
        if let Some(index) = identifiers.iter().position(|text| !text.is_empty() && is_of(text)) {
            return Some(Some(index));
        }
        // The tag of SeriesInstanceUID in both byte orders.
        let has_series = [&[0x20, 0, 0x0e, 0], &[0, 0x20, 0, 0x0e]].iter().any(|tag| has(&tag[..]).is_some());
        has_series.then_some(None)
    }
}

/// The volume of `images`, which are those of the file or folder `source`.
fn volume(
    images: &[Image],
    damaged: Vec<Damaged<'_>>,
    source: &Path,
    mut notes: Vec<String>,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let source_name = source.display().to_string();
    let all = series::grouped(images, source)?;
    let entries: Vec<_> = all.iter().map(|series| series.entry.clone()).collect();
    let identifiers: Vec<&str> = all.iter().map(|series| series.identifier.as_str()).collect();
    let chosen = selection.series(&source_name, &entries, &identifiers)?;
    let series = &all[chosen];
    let mut skipped = Vec::new();
    for damaged in damaged {
        // Its series may not be told; then it is the only one, if there is only one.
        let own = damaged.series(&identifiers).unwrap_or((all.len() == 1).then_some(chosen));
        // Images of one identifier may be several series here, such as of two sizes.
        if own.is_some_and(|own| identifiers[own] == identifiers[chosen]) {
            return Err(damaged.error);
        }
        skipped.push(damaged);
    }
    if let Some(Damaged { file, error }) = skipped.first() {
        let (are, name) = match skipped.len() {
            1 => ("1 damaged DICOM file is".to_owned(), "it is"),
            count => (format!("{count} damaged DICOM files are"), "the first is"),
        };
        let file = file.strip_prefix(source).unwrap_or(file).display();
        notes.push(format!("{}: {are} not of this series, and skipped; {name} {file} ({error})", source.display()));
    }
    let first = &images[series.slices[0].image];
    let mut volume = if first.segmentation.is_empty() {
        selection.no_array(&source_name)?;
        scalar(images, series, source, selection, progress)?
    } else if selection.slices.is_some() {
        let reason = "it is a segmentation";
        return Err(VolumeError::NotStreamed { source_name, reason });
    } else {
        segments::read(first, series, source, selection, progress)?
    };
    volume.unit = Some(Unit::Millimetre);
    if all.len() > 1 {
        volume.selection.series = Some(entries[chosen].key.clone());
    }
    notes.append(&mut volume.notes);
    volume.notes = notes;
    Ok(volume)
}

/// Most different remarks of files of one series that are passed on.
const MOST_REMARKS: usize = 8;

/// The volume of a series of images.
fn scalar(
    images: &[Image],
    series: &Series,
    source: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let source_name = source.display().to_string();
    let first = &images[series.slices[0].image];
    let Stack { steps, lattice, is_anatomical, uneven, mut notes } = series::stacked(images, series, source)?;
    let Steps { times, axis, values: names, .. } = steps;
    let components = first.layout.samples;
    let component = selection.component(&source_name, components, first.colours())?;
    let time = selection.step(&source_name, times.len(), &axis, &names)?;
    let range = selection.slices(times[time].len());
    let all = &times[time];
    let slices = &all[range.clone()];
    let uneven = uneven.filter(|_| !selection.middle);
    let lattice = match &uneven {
        Some((_, problem)) if !selection.resample => {
            return Err(VolumeError::Uneven { source_name, problem: problem.clone() });
        }
        Some((places, problem)) => {
            let last = places.last().copied().unwrap_or(0.0);
            notes.push(format!("{source_name}: {problem}; the slices are resampled to even steps"));
            Lattice { dims: [lattice.dims[0], lattice.dims[1], whole(last.round()) + 1], ..lattice }
        }
        None if selection.middle => lattice.of_slices(&range),
        None if selection.slices.is_some() => {
            // A slice alone does not lean.
            Grid::of(lattice, &source_name, selection.resample)?;
            lattice.of_slices(&range)
        }
        None => lattice,
    };
    let grid = Grid::of(lattice, &source_name, selection.resample)?;
    let frame = |slice: &Slice| images[slice.image].frame(slice.frame);
    // The values of some slices are those of the whole volume.
    let (slope, intercept) = (frame(&all[0]).slope, frame(&all[0]).intercept);
    let differ = all.iter().any(|slice| (frame(slice).slope, frame(slice).intercept) != (slope, intercept));
    let values = if all.iter().any(|slice| images[slice.image].has_lut) {
        Values::Looked
    } else if differ {
        notes.push(format!(
            "{source_name}: slope and intercept differ between slices; the voxels are values, as float32"
        ));
        Values::Scaled
    } else {
        Values::Stored
    };
    let padding = first.padding.filter(|_| values == Values::Stored);
    let mut voxels = Pixels { images, slices, component, values, source }.read(progress)?;
    if let Some((places, _)) = &uneven {
        voxels = even(&voxels, first.layout.pixels(), places, padding, (lattice.dims, source))?;
    }
    let scaling = if values == Values::Stored { (slope, intercept) } else { (1.0, 0.0) };
    let mut volume = grid.volume_around(&source_name, voxels, false, scaling.0, padding)?;
    (volume.slope, volume.intercept) = scaling;
    volume.components = components;
    volume.anatomical = is_anatomical;
    volume.part = selection.part(all.len(), 1);
    volume.files = files(images, all);
    let middle = all[all.len() / 2];
    let about = About::read(&images[middle.image].path, middle.frame)?;
    volume.presets.windows = about.windows;
    if volume.presets.windows.is_empty() && first.modality == "CT" {
        volume.presets.windows = image::windows_of_ct();
    }
    volume.metadata = about.metadata;
    let mut add = |name: &str, value: String| volume.metadata.push((name.to_owned(), value));
    if times.len() > 1 {
        add("time axis", format!("{axis} {}", names.join(", ")).trim().to_owned());
    }
    if let Some([padding, _]) = first.padding {
        add("padding", format!("{}", padding.mul_add(slope, intercept)));
    }
    let mut remarks: Vec<&String> = Vec::new();
    for remark in all.iter().flat_map(|slice| &images[slice.image].remarks) {
        if !remarks.contains(&remark) && remarks.len() < MOST_REMARKS {
            remarks.push(remark);
        }
    }
    notes.extend(remarks.iter().map(|remark| format!("{source_name}: {remark}")));
    if first.layout.photometric == "MONOCHROME1" {
        notes.push(format!(
            "{source_name}: MONOCHROME1: other programs show low values bright; the values stay as they are"
        ));
    }
    notes.append(&mut volume.notes);
    volume.notes = notes;
    Ok(volume)
}

/// Interpolates slices at `places`, in steps of a lattice, at its whole steps.
fn even(
    voxels: &Voxels,
    pixels: usize,
    places: &[f64],
    padding: Option<[f64; 2]>,
    (dims, source): ([usize; 3], &Path),
) -> Result<Voxels, VolumeError> {
    with_voxels!(voxels, stored => {
        let mut out = allocate::zeroed(source, pixels.saturating_mul(dims[2]))?;
        series::evened(stored, pixels, places, padding.map(sorted), &mut out);
        Ok(Voxel::into_voxels(out))
    })
}

/// A range from its lower to its higher end.
fn sorted([one, other]: [f64; 2]) -> [f64; 2] {
    [one.min(other), one.max(other)]
}

/// Paths of the files of `slices`, each once.
fn files(images: &[Image], slices: &[Slice]) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = slices.iter().map(|slice| images[slice.image].path.clone()).collect();
    files.dedup();
    files
}
