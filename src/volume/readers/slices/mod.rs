//! Folders of slices: one picture a slice, in PNG, JPEG, BMP, PNM or TIFF, in the order of the numbers in their names, or else of
//! their names.

mod picture;

use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::batches::{self, Decode, Kept, Part};
use super::tiff::{self, Picture, Sample, Stack};
use crate::data::Listing;
use crate::several::{Series, Several};
use crate::voxels::with_type;
use crate::{Geometry, Selection, Volume, VolumeError, Voxel, VoxelType, Voxels};
use relume_base::progress::Progress;

/// Extensions of slices, in lower case.
const EXTENSIONS: [&str; 10] = ["png", "jpg", "jpeg", "bmp", "pgm", "ppm", "pbm", "pnm", "tif", "tiff"];

/// Largest number of runs of slices that a message lists.
const MOST_RUNS: usize = 64;

/// The slices among the files `all` of the folder `path`, sorted by their names: pictures with numbers in their names, or
/// a picture that is the only file.
pub(crate) fn find(path: &Path, all: &[PathBuf]) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = runs(path, all).into_iter().flat_map(|run| run.files).collect();
    files.sort_unstable();
    files
}

/// Reads the volume of the slices among the files `all` of the folder `path`.
pub(crate) fn read(
    path: &Path,
    all: &[PathBuf],
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let source_name = path.display().to_string();
    selection.no_array(&source_name)?;
    selection.no_level(&source_name)?;
    selection.time(&source_name, 1)?;
    let mut runs = runs(path, all);
    if runs.len() > MOST_RUNS {
        let problem = format!("the names of the pictures form {} runs of slices; keep one run in a folder", runs.len());
        return Err(VolumeError::Layout { source_name, problem });
    }
    let index = if runs.len() == 1 && selection.series.is_none() {
        0
    } else {
        let series = runs.iter().enumerate().map(|(index, run)| run.series(index)).collect::<Result<Vec<_>, _>>()?;
        let names: Vec<&str> = runs.iter().map(|run| run.name.as_str()).collect();
        selection.series(&source_name, &series, &names)?
    };
    read_run(&source_name, runs.swap_remove(index), selection, progress)
}

/// The pictures among the files `all` of the folder `path`, sorted by their names, if they are the slices of none of its runs and
/// all have one extension and one folder; empty otherwise.
pub(crate) fn find_named(path: &Path, all: &[PathBuf]) -> Vec<PathBuf> {
    let mut pictures: Vec<PathBuf> = all.iter().filter(|file| extension(file).is_some()).cloned().collect();
    let kind = |file: &PathBuf| match extension(file) {
        Some("jpeg") => Some("jpg"),
        Some("tiff") => Some("tif"),
        other => other,
    };
    let of = |file: &PathBuf| (kind(file), file.parent().map(Path::to_owned));
    let are_alike = pictures.windows(2).all(|pair| of(&pair[0]) == of(&pair[1]));
    if pictures.len() < 2 || !are_alike || !runs(path, all).is_empty() {
        return Vec::new();
    }
    // Upper and lower case are one letter.
    pictures.sort_by_cached_key(|file| (file.to_string_lossy().to_lowercase(), file.clone()));
    pictures
}

/// Reads the volume of the `pictures` of [`find_named`] in the folder `path`; `None` if they differ in size or type.
pub(crate) fn read_named(
    path: &Path,
    pictures: &[PathBuf],
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Option<Volume>, VolumeError> {
    let source_name = path.display().to_string();
    let Ok(slices) = Slices::open(pictures, progress) else {
        crate::data::check_cancelled(path, progress)?;
        return Ok(None);
    };
    drop(slices);
    selection.no_array(&source_name)?;
    selection.no_level(&source_name)?;
    selection.no_series(&source_name)?;
    selection.time(&source_name, 1)?;
    let run = Run { name: String::new(), files: pictures.to_vec(), numbers: Vec::new() };
    let mut volume = read_run(&source_name, run, selection, progress)?;
    let name =
        |file: Option<&PathBuf>| file.and_then(|it| it.file_name()).unwrap_or_default().to_string_lossy().into_owned();
    volume.notes.push(format!(
        "{source_name}: the names of the pictures have no numbers, so the slices are in the order of the names, {} to {}",
        name(pictures.first()),
        name(pictures.last())
    ));
    Ok(Some(volume))
}

/// Reads the volume of the slices of `run`.
fn read_run(
    source_name: &str,
    run: Run,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let range = selection.slices(run.files.len());
    let files = &run.files[range.clone()];
    let slices = Slices::open(files, progress)?;
    let picture = slices.picture;
    let there = Several::Components { count: picture.samples, kind: picture.kind().to_owned(), names: Vec::new() };
    let component = selection.component_of(source_name, there)?;
    let geometry = Geometry::unit(source_name, [picture.width, picture.height, run.files.len()])?.of_slices(&range);
    let voxels = slices.voxels(component, progress)?;
    let mut volume = Volume::new(source_name, voxels, geometry)?;
    volume.part = selection.part(run.files.len(), 1);
    volume.components = picture.samples;
    volume.has_labels = picture.sample == Sample::Bits(1);
    let mut notes = vec!["slices state no spacing; Relume uses 1 1 1".to_owned()];
    notes.extend(run.gaps());
    if picture.photometric == 3 {
        notes.push("the voxels are indices into a colour map, which is not applied".to_owned());
    }
    volume.notes = notes.into_iter().map(|note| format!("{source_name}: {note}")).collect();
    volume.assumed_spacing = volume.notes.first().cloned();
    volume.files = run.files;
    Ok(volume)
}

/// Whether the data files of a header are pictures, by their extensions.
pub(crate) fn are_pictures(paths: &[PathBuf]) -> bool {
    !paths.is_empty() && paths.iter().all(|path| extension(path).is_some())
}

/// The extension of a picture in lower case; `None` for other files.
fn extension(path: &Path) -> Option<&'static str> {
    let own = path.extension()?;
    EXTENSIONS.into_iter().find(|extension| own.eq_ignore_ascii_case(extension))
}

/// Component `component` of the slices `paths` of the header `header`, which states `dims` voxels of `components` numbers of
/// this type.
pub(crate) fn of_header(
    header: &Path,
    paths: &[PathBuf],
    dims: &[usize],
    (components, voxel_type): (usize, VoxelType),
    component: usize,
    progress: &dyn Progress,
) -> Result<Voxels, VolumeError> {
    let slices = Slices::open(paths, progress)?;
    let Picture { width, height, samples, sample, .. } = slices.picture;
    let found = [width, height, paths.len()];
    let is_as_stated =
        dims.iter().copied().chain([1; 3]).take(3).eq(found) && dims.iter().skip(3).all(|&side| side == 1);
    if !is_as_stated || samples != components || sample.voxel_type() != voxel_type || sample == Sample::Half {
        let stated: Vec<String> = dims.iter().map(ToString::to_string).collect();
        let problem = format!(
            "it states {} voxels of {components} × {voxel_type}, but there are {} slices of {}",
            stated.join("×"),
            paths.len(),
            slices.picture
        );
        return Err(VolumeError::Field { path: header.to_owned(), place: "DimSize".to_owned(), problem });
    }
    slices.voxels(component, progress)
}

/// Slices whose names differ in one number only, in its order.
struct Run {
    /// The name with `#` for the number, below the folder.
    name: String,
    files: Vec<PathBuf>,
    numbers: Vec<Digits>,
}

/// A number of any length in a name: its digits without leading zeros. Ordered by value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Digits {
    length: usize,
    digits: String,
}

impl Digits {
    fn of(text: &str) -> Self {
        let digits = text.trim_start_matches('0').to_owned();
        Self { length: digits.len(), digits }
    }

    fn value(&self) -> Option<u64> {
        if self.digits.is_empty() { Some(0) } else { self.digits.parse().ok() }
    }
}

/// Folder of a file, and the texts between the numbers in its name.
type Texts = (PathBuf, Vec<String>);

/// A file, and the numbers in its name.
type Numbered = (PathBuf, Vec<String>);

/// The runs of slices among the files `all` of the folder `path`, sorted by their names. A single picture is one only if it
/// is the only file.
fn runs(path: &Path, all: &[PathBuf]) -> Vec<Run> {
    // Names with equal texts between their numbers.
    let mut alike: BTreeMap<Texts, Vec<Numbered>> = BTreeMap::new();
    for file in all {
        let Some(extension) = extension(file) else { continue };
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let (mut texts, numbers) = pieces(&stem);
        texts.push(extension.to_owned());
        let parent = file.parent().unwrap_or(Path::new("")).to_owned();
        alike.entry((parent, texts)).or_default().push((file.clone(), numbers));
    }
    let mut runs: Vec<Run> = Vec::new();
    for ((parent, texts), files) in alike {
        let first = &files[0].1;
        // The last number that is not the same in all names counts the slices.
        let place =
            (0..first.len()).rev().find(|&place| files.iter().any(|(_, numbers)| numbers[place] != first[place]));
        let place = place.unwrap_or(first.len().saturating_sub(1));
        let mut by_others: BTreeMap<Vec<String>, Vec<(Digits, PathBuf)>> = BTreeMap::new();
        for (file, mut numbers) in files {
            let own = Digits::of(numbers.get(place).map_or("", String::as_str));
            if let Some(number) = numbers.get_mut(place) {
                "#".clone_into(number);
            }
            by_others.entry(numbers).or_default().push((own, file));
        }
        for (numbers, mut slices) in by_others {
            slices.sort_unstable();
            let (stem, extension) = texts.split_at(texts.len() - 1);
            let name: String = stem
                .iter()
                .map(String::as_str)
                .zip(numbers.iter().map(String::as_str).chain([""]))
                .flat_map(|(text, number)| [text, number])
                .collect();
            let name = parent.join(format!("{name}.{}", extension[0]));
            let name = name.strip_prefix(path).unwrap_or(&name).display().to_string();
            let (numbers, files) = slices.into_iter().unzip();
            runs.push(Run { name, files, numbers });
        }
    }
    // A picture among other files shows or explains them.
    if all.len() > 1 {
        runs.retain(|run| run.files.len() > 1);
    }
    runs
}

/// Texts and numbers of a name in turn; it begins and ends with a text, which may be empty.
fn pieces(name: &str) -> (Vec<String>, Vec<String>) {
    let (mut texts, mut numbers) = (vec![String::new()], Vec::<String>::new());
    let mut in_number = false;
    for letter in name.chars() {
        if letter.is_ascii_digit() {
            if !in_number {
                numbers.push(String::new());
                texts.push(String::new());
            }
            numbers.last_mut().into_iter().for_each(|number| number.push(letter));
        } else {
            texts.last_mut().into_iter().for_each(|text| text.push(letter));
        }
        in_number = letter.is_ascii_digit();
    }
    (texts, numbers)
}

impl Run {
    /// The run as one of several; `index` is its index.
    fn series(&self, index: usize) -> Result<Series, VolumeError> {
        let Picture { width, height, .. } = one(&self.files[0])?;
        let dims = [width, height, self.files.len()];
        Ok(Series { key: index.to_string(), description: self.name.clone(), dims, times: 1 })
    }

    /// Sentences about numbers that are missing, or are there twice.
    fn gaps(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let name = |index: usize| self.files[index].file_name().unwrap_or_default().to_string_lossy().into_owned();
        let values: Option<Vec<u64>> = self.numbers.iter().map(Digits::value).collect();
        let Some(values) = values else { return notes };
        let steps: Vec<u64> = values.windows(2).map(|pair| pair[1] - pair[0]).collect();
        if let Some(index) = steps.iter().position(|&step| step == 0) {
            notes.push(format!("the slices {} and {} have the same number", name(index), name(index + 1)));
        }
        let Some(usual) = steps.iter().copied().filter(|&step| step > 0).min() else { return notes };
        let gaps: Vec<usize> = (0..steps.len()).filter(|&index| steps[index] > usual).collect();
        if let Some(&first) = gaps.first() {
            let missing: u64 = gaps.iter().map(|&index| steps[index].div_ceil(usual) - 1).fold(0, u64::saturating_add);
            let (between, s) =
                (format!("{} and {}", name(first), name(first + 1)), if missing == 1 { "" } else { "s" });
            let where_else =
                if gaps.len() > 1 { format!(", and in {} further places", gaps.len() - 1) } else { String::new() };
            notes.push(format!(
                "{missing} slice{s} may be missing between {between}{where_else}; the slices that are there are taken as neighbours"
            ));
        }
        notes
    }
}

/// Grey levels of a picture, from 0 for black to 1 for white, row by row from above, and the number of its columns.
///
/// # Errors
///
/// [`VolumeError`]: for a file that is no PNG, JPEG, BMP or PNM, and for colours.
pub fn grey_picture(path: &Path) -> Result<(usize, Vec<f32>), VolumeError> {
    let picture = picture::picture(path)?;
    let wrong =
        |problem: &str| VolumeError::Layout { source_name: path.display().to_string(), problem: problem.to_owned() };
    if picture.samples != 1 {
        return Err(wrong("a picture in colour; save it in grey"));
    }
    let white = match picture.sample {
        Sample::Bits(1) => 1.0,
        sample if sample.voxel_type() == VoxelType::U8 => f32::from(u8::MAX),
        sample if sample.voxel_type() == VoxelType::U16 => f32::from(u16::MAX),
        _ => return Err(wrong("a picture of numbers other than 8 or 16 bits")),
    };
    let numbers = picture::numbers(path)?;
    let levels: Vec<f32> = if white > f32::from(u8::MAX) {
        numbers.as_chunks::<2>().0.iter().map(|&number| f32::from(u16::from_ne_bytes(number)) / white).collect()
    } else {
        numbers.iter().map(|&number| f32::from(number) / white).collect()
    };
    if levels.len() == picture.width * picture.height {
        Ok((picture.width, levels))
    } else {
        Err(wrong("a picture that is cut off"))
    }
}

/// Size and type of one slice.
fn one(path: &Path) -> Result<Picture, VolumeError> {
    if is_tiff(path) { Ok(*tiff::slice(path, 0)?.picture()) } else { picture::picture(path) }
}

fn is_tiff(path: &Path) -> bool {
    matches!(extension(path), Some("tif" | "tiff"))
}

/// Slices of one size and type.
struct Slices<'a> {
    paths: &'a [PathBuf],
    picture: Picture,
    /// Pages of the slices in TIFF.
    pages: Vec<tiff::Page>,
}

impl<'a> Slices<'a> {
    /// Reads the headers of all slices; refuses the first one that differs.
    fn open(paths: &'a [PathBuf], progress: &dyn Progress) -> Result<Self, VolumeError> {
        let folder = paths.first().and_then(|path| path.parent()).unwrap_or(Path::new(""));
        let listing = Listing::of(folder, paths.len(), progress);
        let read = |(index, path): (usize, &PathBuf)| {
            listing.next()?;
            if is_tiff(path) {
                let page = tiff::slice(path, index)?;
                Ok((*page.picture(), Some(page)))
            } else {
                Ok((picture::picture(path)?, None))
            }
        };
        let read: Vec<Result<_, VolumeError>> = paths.par_iter().enumerate().map(read).collect();
        let read = read.into_iter().collect::<Result<Vec<_>, _>>()?;
        let picture = read[0].0;
        if let Some(index) = read.iter().position(|(other, _)| !other.is_like(&picture)) {
            let first = paths[0].file_name().unwrap_or_default().to_string_lossy();
            let problem = format!("{}, but {first} has {picture}", read[index].0);
            return Err(VolumeError::Field { path: paths[index].clone(), place: "slice".to_owned(), problem });
        }
        Ok(Self { paths, picture, pages: read.into_iter().filter_map(|(_, page)| page).collect() })
    }

    /// Decodes component `component` of the slices.
    fn voxels(self, component: usize, progress: &dyn Progress) -> Result<Voxels, VolumeError> {
        if !self.pages.is_empty() {
            let stack = Stack { paths: self.paths.to_vec(), pages: self.pages, sample: component };
            return stack.read(progress);
        }
        let voxel_type = self.picture.sample.voxel_type();
        with_type!(voxel_type, T => Ok(T::into_voxels(self.read_as::<T>(component, progress)?)))
    }

    fn read_as<T: Voxel>(&self, component: usize, progress: &dyn Progress) -> Result<Vec<T>, VolumeError> {
        let voxels = self.picture.width * self.picture.height;
        let parts = self.paths.iter().map(|path| Part { part: path.as_path(), voxels, path });
        let pictures = Pictures::<T> { picture: self.picture, component, voxel: PhantomData };
        batches::read(&pictures, parts, voxels * self.paths.len(), Kept::Packed, progress)
    }
}

/// Decoder of slices that are no TIFF.
struct Pictures<T> {
    picture: Picture,
    component: usize,
    voxel: PhantomData<fn() -> T>,
}

impl<T: Voxel> Pictures<T> {
    fn numbers(&self, path: &Path) -> Result<Vec<u8>, VolumeError> {
        let numbers = picture::numbers(path)?;
        let Picture { width, height, samples, .. } = self.picture;
        let expected = width * height * samples * size_of::<T>();
        if numbers.len() == expected {
            return Ok(numbers);
        }
        let problem = format!("{} bytes of voxels, but its size and type require {expected}", numbers.len());
        Err(VolumeError::Field { path: path.to_owned(), place: "slice".to_owned(), problem })
    }
}

impl<T: Voxel> Decode<&Path> for Pictures<T> {
    type Voxel = T;
    type Scratch = ();

    fn scratch(&self) {}

    fn decode(&self, (): &mut (), path: &&Path, out: &mut [T]) -> Result<(), VolumeError> {
        let numbers = self.numbers(path)?;
        let picked = numbers.chunks_exact(size_of::<T>()).skip(self.component).step_by(self.picture.samples);
        out.iter_mut().zip(picked).for_each(|(voxel, bytes)| *voxel = bytemuck::pod_read_unaligned(bytes));
        Ok(())
    }

    fn prove(&self, path: &&Path) -> Result<(), VolumeError> {
        self.numbers(path).map(drop)
    }
}
