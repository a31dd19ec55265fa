//! Which slices are one volume, in which order, and on which grid.

use std::collections::{HashMap, HashSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::Path;

use dicom_dictionary_std::tags;
use glam::{DMat3, DVec3};

use super::frame::Frame;
use super::image::Image;
use super::pixels::Slice;
use super::steps::{self, Steps};
use crate::VolumeError;
use crate::geometry::Lattice;
use crate::several::Series as Entry;
use relume_base::number;
use relume_base::parallel;

/// Slices of one series, of one size, orientation and kind.
#[derive(Debug)]
pub(super) struct Series {
    pub(super) slices: Vec<Slice>,
    /// Description in the window and in messages.
    pub(super) entry: Entry,
    /// Identifier of the series.
    pub(super) identifier: String,
}

/// Whether two frames are slices of one volume.
fn are_alike((one, first): (&Image, &Frame), (other, second): (&Image, &Frame)) -> bool {
    let axes = match (first.orientation, second.orientation) {
        (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| a.abs_diff_eq(b, 1e-4)),
        (a, b) => a.is_none() && b.is_none(),
    };
    let spacing = match (first.spacing, second.spacing) {
        (Some(a), Some(b)) => a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-4 * b),
        (a, b) => a.is_none() && b.is_none(),
    };
    let (a, b) = (&one.layout, &other.layout);
    let layout = (a.rows, a.columns, a.samples, a.allocated, a.stored, a.is_signed, a.voxel_type)
        == (b.rows, b.columns, b.samples, b.allocated, b.stored, b.is_signed, b.voxel_type)
        && a.photometric == b.photometric;
    axes && spacing
        && layout
        && one.series == other.series
        && first.stack == second.stack
        // A segmentation is one file, with segments of its own.
        && (one.segmentation.is_empty() && other.segmentation.is_empty() || one.path == other.path)
        && !one.has_times()
        && !other.has_times()
}

/// Largest number of series in a folder.
const MOST_SERIES: usize = 1000;

/// Groups the frames of `images` into series, in the order of their numbers.
///
/// # Errors
///
/// [`VolumeError::Field`] if there are more than 1000.
pub(super) fn grouped(images: &[Image], source: &Path) -> Result<Vec<Series>, VolumeError> {
    let mut groups: Vec<Vec<Slice>> = Vec::new();
    let mut last = 0;
    for (index, image) in images.iter().enumerate() {
        for frame in 0..image.frames.len() {
            let slice = Slice { image: index, frame };
            let is_of = |group: &Vec<Slice>| {
                let Slice { image: one, frame: first } = group[0];
                are_alike((&images[one], images[one].frame(first)), (image, image.frame(frame)))
            };
            // Neighbouring files mostly belong together.
            let found = groups.get(last).filter(|group| is_of(group)).map(|_| last);
            match found.or_else(|| groups.iter().position(is_of)) {
                Some(group) => {
                    groups[group].push(slice);
                    last = group;
                }
                None if groups.len() == MOST_SERIES => {
                    let (path, place) = (source.to_owned(), "the series".to_owned());
                    let problem = format!("more than {MOST_SERIES} of different size, orientation or kind");
                    return Err(VolumeError::Field { path, place, problem });
                }
                None => {
                    last = groups.len();
                    groups.push(vec![slice]);
                }
            }
        }
    }
    let mut groups: Vec<(String, Vec<Slice>)> = groups.into_iter().flat_map(|slices| parted(images, slices)).collect();
    let number = |group: &[Slice]| images[group[0].image].number.parse().unwrap_or(f64::INFINITY);
    // The sort is stable: groups of one number stay in the order of their files.
    groups.sort_by(|(_, one), (_, other)| {
        let series = |group: &[Slice]| images[group[0].image].series.clone();
        number(one).total_cmp(&number(other)).then_with(|| series(one).cmp(&series(other)))
    });
    let keys: Vec<String> = groups.iter().map(|(_, group)| images[group[0].image].number.clone()).collect();
    let mut all = Vec::new();
    for (index, (part, slices)) in groups.into_iter().enumerate() {
        let image = &images[slices[0].image];
        let mates = keys.iter().filter(|key| **key == keys[index]).count();
        let place = keys[..index].iter().filter(|key| **key == keys[index]).count() + 1;
        let number = if keys[index].is_empty() { "0" } else { &keys[index] };
        let key = if mates > 1 { format!("{number}.{place}") } else { number.to_owned() };
        let named = if image.description.is_empty() { String::new() } else { format!("«{}» ", image.description) };
        let part = if part.is_empty() { String::new() } else { format!(" ({part})") };
        let depth = if image.segmentation.is_empty() { places(images, &slices) } else { positions(images, &slices) };
        let times = if image.has_times() {
            image.count
        } else if image.segmentation.is_empty() {
            slices.len() / depth.max(1)
        } else {
            1
        };
        let entry = Entry {
            key,
            description: format!("{named}{}{part}", image.modality).trim().to_owned(),
            dims: [image.layout.columns, image.layout.rows, depth],
            times,
        };
        all.push(Series { entry, identifier: image.series.clone(), slices });
    }
    Ok(all)
}

/// The volumes of a group whose positions have unequally many slices, if an attribute tells them apart; otherwise the group, without
/// a name.
fn parted(images: &[Image], slices: Vec<Slice>) -> Vec<(String, Vec<Slice>)> {
    let image = &images[slices[0].image];
    if slices.len() > 1
        && image.segmentation.is_empty()
        && !image.has_times()
        && let Some((ordered, _)) = ordered(images, &slices)
    {
        let cells = cells(&clusters(&ordered, tolerance(images, &slices)));
        if cells.iter().any(|cell| cell.len() != cells[0].len())
            && let Some(parts) = steps::parts(images, &cells)
        {
            return parts;
        }
    }
    vec![(String::new(), slices)]
}

/// The slices at each position.
fn cells(clusters: &[&[(f64, Slice)]]) -> Vec<Vec<Slice>> {
    clusters.iter().map(|cluster| cluster.iter().map(|&(_, slice)| slice).collect()).collect()
}

/// Number of different positions, if they are equally frequent; otherwise the number of slices.
fn places(images: &[Image], slices: &[Slice]) -> usize {
    match positions(images, slices) {
        found if found > 0 && slices.len().is_multiple_of(found) => found,
        _ => slices.len(),
    }
}

/// Number of different positions.
pub(super) fn positions(images: &[Image], slices: &[Slice]) -> usize {
    ordered(images, slices).map_or(1, |(ordered, _)| clusters(&ordered, tolerance(images, slices)).len())
}

/// Slices with their distance along the normal of the slices, in its order; the normal. `None` if a position or the
/// orientation is not known.
fn ordered(images: &[Image], slices: &[Slice]) -> Option<(Vec<(f64, Slice)>, DVec3)> {
    let frame = |slice: &Slice| images[slice.image].frame(slice.frame);
    let [row, column] = frame(slices.first()?).orientation?;
    let normal = row.cross(column).normalize();
    let with_distance = |slice: &Slice| Some((frame(slice).position?.dot(normal), *slice));
    let mut ordered: Vec<(f64, Slice)> = slices.iter().map(with_distance).collect::<Option<_>>()?;
    ordered.sort_by(|(one, _), (other, _)| one.total_cmp(other));
    Some((ordered, normal))
}

/// Largest distance between equal positions: a thousandth of a pixel.
fn tolerance(images: &[Image], slices: &[Slice]) -> f64 {
    let first = slices.first().and_then(|slice| images[slice.image].frame(slice.frame).spacing);
    1e-3 * first.map_or(1.0, |[rows, columns]| rows.min(columns))
}

/// Runs of slices at one position.
fn clusters(ordered: &[(f64, Slice)], tolerance: f64) -> Vec<&[(f64, Slice)]> {
    ordered.chunk_by(|(one, _), (next, _)| next - one <= tolerance).collect()
}

/// The slices of a volume.
#[derive(Debug)]
pub(super) struct Stack {
    pub(super) steps: Steps,
    /// Grid, if the steps are even; otherwise with the median step.
    pub(super) lattice: Lattice,
    /// Whether the world is that of the patient.
    pub(super) is_anatomical: bool,
    /// Places of the slices in steps of the lattice, if they are uneven, and what is uneven.
    pub(super) uneven: Option<(Vec<f64>, String)>,
    pub(super) notes: Vec<String>,
}

/// Puts the slices of a series in order.
///
/// # Errors
///
/// [`VolumeError::Field`] if some slices have no position, or if several slices at one position are not told apart by a
/// time, with the names of two of them.
pub(super) fn stacked(images: &[Image], series: &Series, source: &Path) -> Result<Stack, VolumeError> {
    let slices = &series.slices;
    let [columns, rows, _] = series.entry.dims;
    let first = &images[slices[0].image];
    let frame = first.frame(slices[0].frame);
    let mut notes = Vec::new();
    let spacing = frame.spacing.unwrap_or_else(|| {
        notes.push(format!("{}: the file states no PixelSpacing; Relume uses 1 mm", first.path.display()));
        [1.0, 1.0]
    });
    let [row, column] = frame.orientation.unwrap_or([DVec3::X, DVec3::Y]);
    let (across, normal) = ([row * spacing[1], column * spacing[0]], row.cross(column).normalize());
    let lattice = |depth, origin, step| Lattice {
        dims: [columns, rows, depth],
        origin,
        steps: DMat3::from_cols(across[0], across[1], step),
    };
    let thick = |notes: &mut Vec<String>| {
        let path = first.path.display();
        let step = frame.thickness.unwrap_or(1.0);
        notes.push(match frame.thickness {
            Some(_) => format!("{path}: one slice; its spacing across is SliceThickness, {step} mm"),
            None => format!("{path}: one slice without SliceThickness; Relume uses 1 mm across it"),
        });
        step
    };
    let is_anatomical = frame.is_anatomical;
    let origin = frame.position.filter(|_| frame.orientation.is_some()).unwrap_or(DVec3::ZERO);
    if first.has_times() || slices.len() == 1 {
        let step = normal * thick(&mut notes);
        let times = (0..if first.has_times() { first.count } else { 1 })
            .map(|time| vec![if first.has_times() { Slice { frame: time, ..slices[0] } } else { slices[0] }])
            .collect();
        let axis = if first.has_times() { "frame".to_owned() } else { String::new() };
        let steps = Steps { times, axis, ..Steps::default() };
        return Ok(Stack { steps, lattice: lattice(1, origin, step), is_anatomical, uneven: None, notes });
    }
    let Some((ordered, _)) = ordered(images, slices) else {
        let lacks = |slice: &&Slice| {
            let frame = images[slice.image].frame(slice.frame);
            frame.position.is_none() || frame.orientation.is_none()
        };
        let lacking: Vec<&Slice> = slices.iter().filter(lacks).collect();
        let problem = format!(
            "{} of {} slices state no position or no orientation, so that their order is not known",
            lacking.len(),
            slices.len()
        );
        return Err(images[lacking.first().map_or(0, |slice| slice.image)].wrong(tags::IMAGE_POSITION_PATIENT, problem));
    };
    let clusters = clusters(&ordered, tolerance(images, slices));
    let steps = timed(images, &clusters, source)?;
    if steps.is_by_order {
        notes.push(format!(
            "{}: {} slices at each position; only their order tells them apart ({}), so that the {} volumes may be others",
            source.display(),
            steps.times.len(),
            steps.axis,
            steps.times.len()
        ));
    }
    let chosen = &steps.times[0];
    let position = |index: usize| {
        let Slice { image, frame } = chosen[index];
        images[image].frame(frame).position.unwrap_or(DVec3::ZERO)
    };
    let (depth, origin) = (chosen.len(), position(0));
    if depth == 1 {
        let step = normal * thick(&mut notes);
        return Ok(Stack { steps, lattice: lattice(1, origin, step), is_anatomical, uneven: None, notes });
    }
    let distances: Vec<f64> = (0..depth).map(|index| (position(index) - origin).dot(normal)).collect();
    let distances_between: Vec<f64> = distances.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut sorted = distances_between.clone();
    sorted.sort_by(f64::total_cmp);
    // The lower one of two: gaps make steps longer, and nothing makes them shorter.
    let median = sorted[(sorted.len() - 1) / 2];
    let uneven = unevenness(images, chosen, &distances_between, median);
    let (least, most) = (sorted[0], sorted[sorted.len() - 1]);
    if uneven.is_none() && most - least > 1e-3 * median {
        notes.push(format!(
            "{}: the distances between slices are from {least:.4} to {most:.4} mm; Relume uses their median, {median:.4} mm",
            source.display()
        ));
    }
    // The drift of the last slice across the normal: that of a tilted gantry, or of rounded positions.
    let whole = position(depth - 1) - origin;
    let along = whole.dot(normal);
    let drift = whole - normal * along;
    let tilt = drift.length().atan2(along).to_degrees();
    let is_tilted = tilt > 0.2 && drift.length() > 0.5 * spacing[0].min(spacing[1]);
    let step = if is_tilted { whole * (median / along) } else { normal * median };
    let uneven = uneven.map(|problem| (distances.iter().map(|distance| distance / median).collect(), problem));
    Ok(Stack { steps, lattice: lattice(depth, origin, step), is_anatomical, uneven, notes })
}

/// Description of uneven distances between the slices; `None` if they are within 2 % or 0.1 mm of their median, as
/// rounded positions are.
fn unevenness(images: &[Image], slices: &[Slice], steps: &[f64], median: f64) -> Option<String> {
    // Fine steps are not rounded to 0.1 mm.
    let slack = (0.02 * median).max(0.1_f64.min(0.25 * median));
    let uneven: Vec<usize> = (0..steps.len()).filter(|&index| (steps[index] - median).abs() > slack).collect();
    let &first = uneven.first()?;
    let name = |slice: Slice| {
        let path = &images[slice.image].path;
        let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        if images[slice.image].count > 1 { format!("frame {} of {name}", slice.frame + 1) } else { name }
    };
    let between = format!("between {} and {}", name(slices[first]), name(slices[first + 1]));
    let missing = |&index: &usize| {
        let whole = (steps[index] / median).round();
        ((steps[index] - whole * median).abs() <= slack * whole && whole >= 2.0).then_some(whole - 1.0)
    };
    let missing: Option<f64> = uneven.iter().map(missing).sum();
    Some(match missing {
        Some(missing) => {
            let (s, are) = if missing > 1.0 { ("s", "are") } else { ("", "is") };
            format!(
                "{missing} slice{s} {are} missing: {:.4} mm {between}, where the median is {median:.4} mm",
                steps[first]
            )
        }
        None => format!(
            "the slices are unevenly spaced: {:.4} mm {between}, where the median is {median:.4} mm",
            steps[first]
        ),
    })
}

/// The volumes of slices at positions, several at each.
fn timed(images: &[Image], clusters: &[&[(f64, Slice)]], source: &Path) -> Result<Steps, VolumeError> {
    let depth = clusters.len();
    let all: usize = clusters.iter().map(|cluster| cluster.len()).sum();
    let cells = cells(clusters);
    if all == depth {
        return Ok(Steps { times: vec![cells.into_iter().flatten().collect()], ..Steps::default() });
    }
    let count = cells.first().map_or(0, Vec::len);
    if cells.iter().all(|cell| cell.len() == count)
        && let Some(steps) = steps::told_apart(images, &cells)
    {
        return Ok(steps);
    }
    let path = |slice: Slice| images[slice.image].path.clone();
    let (one, other) = cells
        .iter()
        .find(|cell| cell.len() > 1)
        .map_or_else(|| (source.to_owned(), source.to_owned()), |cell| (path(cell[0]), path(cell[1])));
    let differences = steps::differences(images, &cells);
    let told = if differences.is_empty() {
        "no temporal position, acquisition, echo, image type, instance number or other attribute tells them apart"
            .to_owned()
    } else {
        format!(
            "no attribute, as temporal position, makes whole volumes of them; what differs is {}",
            differences.join(", ")
        )
    };
    let problem =
        format!("{all} slices at {depth} positions, and {told}; {} is at the position of this file", other.display());
    Err(VolumeError::Field { path: one, place: super::dataset::named(tags::IMAGE_POSITION_PATIENT), problem })
}

/// Images that are copies of others, and others of one identifier.
#[derive(Debug, Default)]
pub(super) struct Copies {
    /// Number of images that were removed, because they are copies.
    pub(super) removed: usize,
    /// Number of images that have the identifier of another one, but another place or other attributes.
    pub(super) kept: usize,
}

/// Removes images that are copies of others: of one identifier, at one place, and with equal attributes.
pub(super) fn without_copies(images: Vec<Image>) -> (Vec<Image>, Copies) {
    let mut seen: HashMap<String, HashSet<u64>> = HashMap::new();
    let mut copies = Copies::default();
    let mut is_new = |image: &Image| {
        if image.instance.is_empty() {
            return true;
        }
        let known = seen.entry(image.instance.clone()).or_default();
        let is_first = known.is_empty();
        let (first, last) = (image.frames.first(), image.frames.last());
        let what = (&image.series, image.instance_number, &image.marks, &image.layout, image.count, first, last);
        let mut digest = DefaultHasher::new();
        format!("{what:?}").hash(&mut digest);
        let is_new = known.insert(digest.finish());
        copies.removed += usize::from(!is_new);
        copies.kept += usize::from(is_new && !is_first);
        is_new
    };
    let kept: Vec<Image> = images.into_iter().filter(|image| is_new(image)).collect();
    (kept, copies)
}

/// Interpolates the slices `voxels` of `pixels` voxels, which lie at `places` in steps of a lattice, linearly at its whole
/// steps. Beside a number of the range `padding`, which stands for no value, it takes the nearer slice.
pub(super) fn evened<T: crate::Voxel>(
    voxels: &[T],
    pixels: usize,
    places: &[f64],
    padding: Option<[f64; 2]>,
    out: &mut [T],
) {
    let is_padding = |number: f64| padding.is_some_and(|[low, high]| number >= low && number <= high);
    let last = places.len() - 1;
    parallel::rows_mut(out, pixels, &|z, out| {
        let place = number::count(z);
        let above = places.partition_point(|&at| at < place).clamp(1, last.max(1)).min(last);
        let below = above.saturating_sub(1);
        let width = places[above] - places[below];
        let part = if width > 0.0 { ((place - places[below]) / width).clamp(0.0, 1.0) } else { 0.0 };
        let slice = |index: usize| &voxels[index * pixels..(index + 1) * pixels];
        if part <= 0.0 || part >= 1.0 {
            out.copy_from_slice(slice(if part >= 0.5 { above } else { below }));
            return;
        }
        for ((voxel, &low), &high) in out.iter_mut().zip(slice(below)).zip(slice(above)) {
            let (below, above) = (low.to_f64(), high.to_f64());
            *voxel = if is_padding(below) || is_padding(above) {
                if part < 0.5 { low } else { high }
            } else {
                T::nearest((above - below).mul_add(part, below))
            };
        }
    });
}
