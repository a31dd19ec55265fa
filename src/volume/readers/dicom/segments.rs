//! Segmentations: label volumes, or one fractional segment (DICOM PS3.3, C.8.20).

use std::path::Path;

use dicom_dictionary_std::tags;
use glam::{DMat3, DVec3};

use super::dataset::{self, Item};
use super::image::{Image, text};
use super::pixels::{Pixels, Slice, Values};
use super::series::Series;
use crate::geometry::Lattice;
use crate::{LabelPreset, Selection, Volume, VolumeError, Voxel, Voxels, allocate, with_voxels};
use relume_base::number::whole;
use relume_base::progress::Progress;

/// Voxels between the frames of a file, whatever their number.
const MOST_EMPTY: usize = 64 << 20;

/// Frames decoded together.
const BATCH: usize = 64;

/// Places of the frames on a grid along the normal.
struct Places {
    lattice: Lattice,
    /// Index of the slice of each frame of the series.
    slices: Vec<usize>,
}

/// Reads a segmentation: the labels of its segments, or the fractions of one of them.
///
/// # Errors
///
/// [`VolumeError::Field`] if a frame has no place or no segment, or if the frames lie on no grid;
/// [`VolumeError::Choose`] among several fractional segments.
pub(super) fn read(
    image: &Image,
    series: &Series,
    source: &Path,
    selection: &Selection,
    progress: &dyn Progress,
) -> Result<Volume, VolumeError> {
    let source_name = source.display().to_string();
    let root = dataset::read(&image.path)?.root;
    selection.component(&source_name, 1, "")?;
    selection.time(&source_name, 1)?;
    if image.has_times() {
        let problem = format!("the {} frames state no places", image.count);
        return Err(image.wrong(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, problem));
    }
    let places = placed(image, series)?;
    let geometry = places.lattice.geometry(&source_name)?;
    let presets = presets(&root);
    let mut notes = Vec::new();
    let labels = |largest: usize, notes: &mut Vec<String>| {
        selection.no_array(&source_name)?;
        if largest <= usize::from(u8::MAX) {
            merged::<u8>(image, series, &places, source, notes, progress)
        } else {
            merged::<u16>(image, series, &places, source, notes, progress)
        }
    };
    let (voxels, slope, has_labels, array) = match image.segmentation.as_str() {
        "BINARY" => {
            let segment = |slice: &Slice| image.frame(slice.frame).segment;
            let Some(largest) = series.slices.iter().map(segment).collect::<Option<Vec<_>>>() else {
                let problem = "a frame states no segment".to_owned();
                return Err(image.wrong(tags::REFERENCED_SEGMENT_NUMBER, problem));
            };
            let largest = largest.into_iter().max().unwrap_or(0);
            if largest == 0 || largest > usize::from(u16::MAX) {
                let problem = format!("segment {largest}; segments are counted from 1 to 65535");
                return Err(image.wrong(tags::REFERENCED_SEGMENT_NUMBER, problem));
            }
            (labels(largest, &mut notes)?, 1.0, true, None)
        }
        "LABELMAP" => {
            let largest = if image.layout.allocated > 8 { usize::from(u16::MAX) } else { usize::from(u8::MAX) };
            (labels(largest, &mut notes)?, 1.0, true, None)
        }
        "FRACTIONAL" => {
            let numbers = segments(image, series);
            let names: Vec<String> = numbers.iter().map(|&number| name_of(&presets, number)).collect();
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let chosen = selection.array(&source_name, &names)?;
            let most = root.number(tags::MAXIMUM_FRACTIONAL_VALUE).filter(|&most| most > 0.0).unwrap_or(255.0);
            let slices = series.slices.iter().copied().zip(places.slices.iter().copied());
            let of_it = |(slice, _): &(Slice, usize)| image.frame(slice.frame).segment == numbers.get(chosen).copied();
            let (slices, at): (Vec<Slice>, Vec<usize>) = slices.filter(of_it).unzip();
            let chosen_series = Series { slices, entry: series.entry.clone(), identifier: String::new() };
            let places = Places { slices: at, lattice: places.lattice };
            let voxels = merged::<u8>(image, &chosen_series, &places, source, &mut notes, progress)?;
            let array = (names.len() > 1).then(|| names[chosen].to_owned());
            (voxels, 1.0 / most, false, array)
        }
        other => {
            let problem = format!("segmentations of type {other}; Relume reads BINARY, LABELMAP and FRACTIONAL");
            return Err(image.wrong(tags::SEGMENTATION_TYPE, problem));
        }
    };
    let mut volume = Volume { has_labels, slope, ..Volume::new(&source_name, voxels, geometry)? };
    volume.anatomical = true;
    volume.files = vec![image.path.clone()];
    volume.metadata.push(("segmentation".to_owned(), image.segmentation.clone()));
    if let Some(description) = text(&root, tags::SERIES_DESCRIPTION) {
        volume.metadata.push(("series".to_owned(), description));
    }
    if has_labels {
        volume.presets.labels = presets;
    }
    volume.selection.array = array;
    volume.notes = notes;
    Ok(volume)
}

/// Numbers of the segments of the frames, ascending.
fn segments(image: &Image, series: &Series) -> Vec<usize> {
    let mut numbers: Vec<usize> = series.slices.iter().filter_map(|slice| image.frame(slice.frame).segment).collect();
    numbers.sort_unstable();
    numbers.dedup();
    numbers
}

/// Name of the segment `number`.
fn name_of(presets: &[LabelPreset], number: usize) -> String {
    let named = presets.iter().find(|preset| usize::try_from(preset.value) == Ok(number));
    named.map_or_else(|| format!("segment {number}"), |preset| preset.name.clone())
}

/// The grid of the frames. Slices without any segment are absent, so the smallest distance between two frames is a step,
/// and all others are multiples of it.
fn placed(image: &Image, series: &Series) -> Result<Places, VolumeError> {
    let frame = |slice: &Slice| image.frame(slice.frame);
    let first = frame(&series.slices[0]);
    let Some([row, column]) = first.orientation else {
        return Err(image.wrong(tags::IMAGE_ORIENTATION_PATIENT, "the frames state no orientation".to_owned()));
    };
    let Some([rows, columns]) = first.spacing else {
        return Err(image.wrong(tags::PIXEL_SPACING, "the frames state no spacing".to_owned()));
    };
    let normal = row.cross(column).normalize();
    let Some(positions) = series.slices.iter().map(|slice| frame(slice).position).collect::<Option<Vec<_>>>() else {
        return Err(image.wrong(tags::IMAGE_POSITION_PATIENT, "a frame states no position".to_owned()));
    };
    let distances: Vec<f64> = positions.iter().map(|position| position.dot(normal)).collect();
    let mut sorted = distances.clone();
    sorted.sort_by(f64::total_cmp);
    let tolerance = 1e-3 * rows.min(columns);
    sorted.dedup_by(|next, one| *next - *one <= tolerance);
    let extent = sorted[sorted.len() - 1] - sorted[0];
    let smallest = sorted.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    let step = if smallest.is_finite() { extent / (extent / smallest).round() } else { first.thickness.unwrap_or(1.0) };
    let depth = whole((extent / step).round()) + 1;
    let first_one = (0..distances.len()).min_by(|&a, &b| distances[a].total_cmp(&distances[b])).unwrap_or(0);
    let (start, origin) = (distances[first_one], positions[first_one]);
    let mut slices = Vec::new();
    for (index, (&distance, &position)) in distances.iter().zip(&positions).enumerate() {
        let place = (distance - start) / step;
        let aside = position - origin - normal * (distance - start);
        // Rounded positions are within a hundredth of a step.
        if (place - place.round()).abs() > 0.01 || aside.length() > 0.01 * rows.min(columns) {
            let problem = format!(
                "frame {} lies {place:.3} steps of {step:.4} mm from the first slice and {:.4} mm aside, which is on no grid",
                series.slices[index].frame + 1,
                aside.length()
            );
            return Err(image.wrong(tags::IMAGE_POSITION_PATIENT, problem));
        }
        slices.push(whole(place.round()));
    }
    let lattice = Lattice {
        dims: [image.layout.columns, image.layout.rows, depth],
        origin,
        steps: DMat3::from_cols(row * columns, column * rows, normal * step),
    };
    Ok(Places { lattice, slices })
}

/// A voxel of labels.
trait Label: Voxel {
    fn of(label: usize) -> Self;
}

impl Label for u8 {
    fn of(label: usize) -> Self {
        Self::try_from(label).unwrap_or(Self::MAX)
    }
}

impl Label for u16 {
    fn of(label: usize) -> Self {
        Self::try_from(label).unwrap_or(Self::MAX)
    }
}

/// The frames in one volume, in the order of their segments, so that the later segment wins where two overlap.
fn merged<T: Label>(
    image: &Image,
    series: &Series,
    places: &Places,
    source: &Path,
    notes: &mut Vec<String>,
    progress: &dyn Progress,
) -> Result<Voxels, VolumeError> {
    let pixels = image.layout.pixels();
    let depth = places.lattice.dims[2];
    // Absent slices are not in the file: a few frames far apart must not take all memory.
    let most = (1024 * series.slices.len()).max(MOST_EMPTY / pixels.max(1));
    if depth > most {
        let problem = format!("{depth} slices between the first and the last of {} frames", series.slices.len());
        return Err(image.wrong(tags::IMAGE_POSITION_PATIENT, problem));
    }
    let mut voxels: Vec<T> = allocate::zeroed(source, pixels.saturating_mul(depth))?;
    let mut order: Vec<usize> = (0..series.slices.len()).collect();
    order.sort_by_key(|&index| (image.frame(series.slices[index].frame).segment, index));
    let is_binary = image.segmentation == "BINARY";
    let mut overlap = 0_usize;
    let images = std::slice::from_ref(image);
    let all = Pixels { images, slices: &series.slices, component: 0, values: Values::Stored, source };
    let shared = all.shared()?;
    for batch in order.chunks(BATCH) {
        let slices: Vec<Slice> = batch.iter().map(|&index| Slice { image: 0, ..series.slices[index] }).collect();
        let read = Pixels { slices: &slices, ..all }.read_with(&shared, progress)?;
        for (plane, &index) in batch.iter().enumerate() {
            let label = image.frame(series.slices[index].frame).segment.unwrap_or(0);
            let start = pixels * places.slices[index];
            let out = &mut voxels[start..start + pixels];
            with_voxels!(&read, stored => {
                let stored = &stored[plane * pixels..(plane + 1) * pixels];
                for (voxel, &number) in out.iter_mut().zip(stored) {
                    let number = number.to_whole().and_then(|number| usize::try_from(number).ok()).unwrap_or(0);
                    if number > 0 {
                        overlap += usize::from(*voxel != T::of(0));
                        *voxel = T::of(if is_binary { label } else { number });
                    }
                }
            });
        }
    }
    if overlap > 0 {
        notes.push(format!(
            "{}: segments overlap in {overlap} voxels, which get the label of the later segment",
            source.display()
        ));
    }
    Ok(T::into_voxels(voxels))
}

/// Names and colours of the segments.
fn presets(root: &Item) -> Vec<LabelPreset> {
    let preset = |item: &Item| {
        let number = item.number(tags::SEGMENT_NUMBER)?;
        #[expect(clippy::cast_possible_truncation, reason = "a number of 16 bits")]
        let value = number as i64;
        let name = text(item, tags::SEGMENT_LABEL).unwrap_or_else(|| format!("segment {value}"));
        let colour = match item.numbers(tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE) {
            &[l, a, b] => Some(srgb_from_lab([l, a, b])),
            _ => None,
        };
        Some(LabelPreset { value, name, colour })
    };
    root.items(tags::SEGMENT_SEQUENCE).iter().filter_map(preset).collect()
}

/// sRGB code values from 0 to 1 of a CIELAB colour under D50, coded in 16 bits a number as in PS3.3, C.10.7.1.1: L* from
/// 0 to 100, a* and b* from −128 to 127.
fn srgb_from_lab(coded: [f64; 3]) -> [f64; 3] {
    let [l, a, b] = coded.map(|number| number / 65535.0);
    let (l, a, b) = (100.0 * l, 255.0 * a - 128.0, 255.0 * b - 128.0);
    let fy = (l + 16.0) / 116.0;
    // CIE 15:2018, §8.2.1.1, solved for X, Y, Z.
    let part = |f: f64| if f > 6.0 / 29.0 { f * f * f } else { 3.0 * (6.0_f64 / 29.0).powi(2) * (f - 4.0 / 29.0) };
    // The white of ICC's connection space, D50.
    let xyz = DVec3::new(0.9642, 1.0, 0.8249) * DVec3::new(part(fy + a / 500.0), part(fy), part(fy - b / 200.0));
    // From XYZ under D50 to linear sRGB, with Bradford adaptation (ICC profile of sRGB).
    let linear = DMat3::from_cols(
        DVec3::new(3.133_856_1, -0.978_768_4, 0.071_945_3),
        DVec3::new(-1.616_866_7, 1.916_141_5, -0.228_991_4),
        DVec3::new(-0.490_614_6, 0.033_454_0, 1.405_242_7),
    ) * xyz;
    linear.to_array().map(|part| {
        let part = part.clamp(0.0, 1.0);
        if part <= 0.003_130_8 { 12.92 * part } else { 1.055 * part.powf(1.0 / 2.4) - 0.055 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_of_segments_are_those_of_their_cielab_codes() {
        // White, black, and the red of sRGB: L* 54.29, a* 80.82, b* 69.90 under D50.
        let code =
            |[l, a, b]: [f64; 3]| [l / 100.0, (a + 128.0) / 255.0, (b + 128.0) / 255.0].map(|part| 65535.0 * part);
        let close = |found: [f64; 3], wanted: [f64; 3]| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() <= 2e-3);
        for (lab, rgb) in
            [([100.0, 0.0, 0.0], [1.0; 3]), ([0.0, 0.0, 0.0], [0.0; 3]), ([54.29, 80.82, 69.9], [1.0, 0.0, 0.0])]
        {
            let found = srgb_from_lab(code(lab));
            assert!(close(found, rgb), "{lab:?} is {found:?}");
        }
    }
}
