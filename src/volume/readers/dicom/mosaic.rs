//! Mosaics of Siemens: the slices of a volume side by side in one image.

use std::path::Path;

use dicom_dictionary_std::tags;
use glam::DVec3;

use super::dataset::{CSA_IMAGE, Item, MOSAIC_IMAGES, named};
use super::frame::{Frame, Layout};
use crate::VolumeError;
use relume_base::number::{count, whole};

/// Largest number of slices of a mosaic.
const MOST: usize = 4096;

/// An image of several slices.
#[derive(Clone, Debug)]
pub(super) struct Sheet {
    /// Layout of the whole image.
    pub(super) layout: Layout,
    /// Slices in a row of slices.
    pub(super) across: usize,
}

/// Whether an image without functional groups says that it is a mosaic.
pub(super) fn is_mosaic(root: &Item) -> bool {
    let has_groups = !root.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE).is_empty();
    let kinds = root.word(tags::IMAGE_TYPE).unwrap_or_default();
    !has_groups && kinds.split('\\').any(|kind| kind.trim() == "MOSAIC")
}

/// Takes a mosaic apart: the sheet, the layout of a slice, and the places of all slices. `frame` is that of the image.
/// `None` for a mosaic of one slice.
///
/// # Errors
///
/// [`VolumeError::Field`] if the number of slices is not stated, or does not fit the image.
pub(super) fn taken_apart(
    path: &Path,
    root: &Item,
    layout: &Layout,
    frame: &Frame,
) -> Result<Option<(Sheet, Layout, Vec<Frame>)>, VolumeError> {
    let wrong = |problem: String| {
        let (path, place) = (path.to_owned(), named(tags::IMAGE_TYPE));
        Err(VolumeError::Field { path, place, problem })
    };
    let (rows, columns) = (layout.rows, layout.columns);
    let stated = |name: &str| CSA_IMAGE.iter().map(|&tag| csa(root.raw(tag), name)).find(|found| !found.is_empty());
    let private = MOSAIC_IMAGES.iter().find_map(|&tag| root.number(tag));
    let in_header = || stated("NumberOfImagesInMosaic").and_then(|numbers| numbers.first().copied());
    let Some(slices) = private.or_else(in_header).filter(|&slices| slices >= 1.0).map(whole) else {
        return wrong(format!(
            "MOSAIC: {columns}×{rows} pixels hold several slices, but neither NumberOfImagesInMosaic (0019,100A) nor the CSA \
             header (0029,1010) says how many, perhaps because they were removed with the name of the patient; open the original \
             files, or a NIfTI made of them"
        ));
    };
    if slices == 1 {
        return Ok(None);
    }
    // A square of slices, the last ones of which may be empty.
    let across = (1..=slices).find(|side| side * side >= slices).unwrap_or(slices);
    if slices > MOST || !columns.is_multiple_of(across) || !rows.is_multiple_of(across) {
        return wrong(format!(
            "MOSAIC: {columns}×{rows} pixels cannot hold {slices} slices in {across} rows and columns of equal size"
        ));
    }
    let [width, height] = [columns / across, rows / across];
    let [row, column] = frame.orientation.unwrap_or([DVec3::X, DVec3::Y]);
    let cross = row.cross(column).normalize();
    let normal = match stated("SliceNormalVector").as_deref() {
        Some(&[x, y, z]) if DVec3::new(x, y, z).is_finite() && DVec3::new(x, y, z).length() > 0.5 => {
            DVec3::new(x, y, z).normalize()
        }
        _ => cross,
    };
    let Some(step) = frame.between.map(f64::abs).or(frame.thickness) else {
        return wrong(
            "MOSAIC: neither SpacingBetweenSlices nor SliceThickness says how far its slices are apart".to_owned(),
        );
    };
    // The stated position is that of an image as large as the mosaic, with the first slice in its middle.
    let [down, right] = frame.spacing.unwrap_or([1.0, 1.0]);
    let middle = row * (right * count(columns - width) / 2.0) + column * (down * count(rows - height) / 2.0);
    let first = frame.position.unwrap_or(DVec3::ZERO) + middle;
    let at = |slice: usize| Frame {
        position: Some(first + normal * (step * count(slice))),
        orientation: Some([row, column]),
        ..frame.clone()
    };
    let of_slice = Layout { rows: height, columns: width, ..layout.clone() };
    Ok(Some((Sheet { layout: layout.clone(), across }, of_slice, (0..slices).map(at).collect())))
}

/// The numbers of the element `name` of a CSA header, which is not described by Siemens, but by nibabel
/// (<https://nipy.org/nibabel/dicom/siemens_csa.html>); empty without it.
fn csa(bytes: &[u8], name: &str) -> Vec<f64> {
    found(bytes, name).unwrap_or_default()
}

fn found(bytes: &[u8], wanted: &str) -> Option<Vec<f64>> {
    const MOST_ITEMS: u32 = 1000;
    let is_second = bytes.starts_with(b"SV10");
    let mut rest = if is_second { bytes.get(8..)? } else { bytes };
    let mut take = |length: usize| -> Option<&[u8]> {
        let (taken, left) = rest.split_at_checked(length)?;
        rest = left;
        Some(taken)
    };
    let word = |bytes: &[u8], index: usize| Some(u32::from_le_bytes(*bytes.get(4 * index..)?.first_chunk()?));
    let elements = word(take(8)?, 0)?;
    let mut first_items = None;
    for _ in 0..elements.min(MOST_ITEMS) {
        // A name, the number of values, a type, its number, the number of items, and a check.
        let header = take(84)?;
        let name = header.get(..64)?.split(|&byte| byte == 0).next()?;
        let (values, items) = (word(header, 16)?, word(header, 19)?);
        let offset = *first_items.get_or_insert(items);
        let mut numbers = Vec::new();
        for _ in 0..items.min(MOST_ITEMS) {
            let lengths = take(16)?;
            let length = if is_second { word(lengths, 1)? } else { word(lengths, 0)?.checked_sub(offset)? };
            let length = usize::try_from(length).ok()?;
            let text = take(length)?;
            take((4 - length % 4) % 4)?;
            let text = String::from_utf8_lossy(text.split(|&byte| byte == 0).next().unwrap_or_default());
            numbers.extend(text.trim().parse::<f64>().ok());
        }
        if name == wanted.as_bytes() {
            let values = usize::try_from(values).unwrap_or(0);
            numbers.truncate(if values > 0 { values } else { numbers.len() });
            return Some(numbers);
        }
    }
    None
}
