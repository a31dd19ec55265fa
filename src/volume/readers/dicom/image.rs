//! Header of one file: layout of its pixels, and places of its frames (DICOM PS3.3).

use std::path::{Path, PathBuf};

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use dicom_encoding::text::{SpecificCharacterSet, TextCodec as _};
use glam::DVec3;

use super::dataset::{self, DataSet, Item, Pixels, named};
use super::frame::{Frame, Layout};
use super::keys::{self, Mark};
use super::mosaic::{self, Sheet};
use super::syntax::{Coding, MOST_BYTES, Syntax};
use crate::stream::{DEFLATE_LIMIT, count};
use crate::{VolumeError, VoxelType, Window};
use relume_base::number::{brief, count as number_of, whole};

/// Largest number of frames of a file.
const MOST_FRAMES: f64 = 1e6;

/// One file.
#[derive(Debug)]
pub(super) struct Image {
    pub(super) path: PathBuf,
    pub(super) syntax: Syntax,
    pub(super) pixels: Pixels,
    pub(super) layout: Layout,
    /// Number of frames.
    pub(super) count: usize,
    /// The frames, if they have places of their own; otherwise one, for all of them.
    pub(super) frames: Vec<Frame>,
    /// Offsets of the frames from the first fragment, if the file has a table of them in its header.
    pub(super) offsets: Vec<f64>,
    /// Identifiers of the series and of the file.
    pub(super) series: String,
    pub(super) instance: String,
    pub(super) number: String,
    /// Description and modality.
    pub(super) description: String,
    pub(super) modality: String,
    pub(super) has_lut: bool,
    /// Stored number of pixels without a value, and the last one of their range.
    pub(super) padding: Option<[f64; 2]>,
    /// Attributes of all frames that may tell the image apart, and names of the dimensions of the file.
    pub(super) marks: Vec<Mark>,
    pub(super) dimensions: Vec<String>,
    /// `InstanceNumber`.
    pub(super) instance_number: Option<f64>,
    /// The whole image, if the frames are parts of a mosaic.
    pub(super) sheet: Option<Sheet>,
    /// Sentences about the file.
    pub(super) remarks: Vec<String>,
    /// Kind of the segmentation: BINARY, FRACTIONAL, LABELMAP; empty for other images.
    pub(super) segmentation: String,
}

impl Image {
    /// Colours of the decoded samples.
    pub(super) fn colours(&self) -> &str {
        let stated = &*self.layout.photometric;
        // The decoders turn the components of JPEG 2000 and of lossy JPEG into RGB.
        let is_lossless = ["1.2.840.10008.1.2.4.57", "1.2.840.10008.1.2.4.70"].contains(&&*self.syntax.uid);
        let is_converted = match self.syntax.coding {
            Coding::Jpeg2000 => ["YBR_RCT", "YBR_ICT"].contains(&stated),
            Coding::Jpeg => stated.starts_with("YBR") && !is_lossless,
            _ => false,
        };
        if is_converted { "RGB" } else { stated }
    }

    /// Reads the header of the file `path`; `None` if it is no image.
    ///
    /// # Errors
    ///
    /// As [`dataset::read`]; [`VolumeError::Field`] if an attribute of the pixels is missing or wrong,
    /// [`VolumeError::Short`] and [`VolumeError::Incredible`] if the file cannot hold all frames.
    pub(super) fn read(path: &Path) -> Result<Option<Self>, VolumeError> {
        let DataSet { syntax, remark, root, pixels, length } = dataset::read(path)?;
        let Some(pixels) = pixels else {
            // Files of other kinds have no rows either, except spectra; a file that is cut has.
            let is_spectrum =
                root.word(tags::SOP_CLASS_UID).is_some_and(|class| class == uids::MR_SPECTROSCOPY_STORAGE);
            return match root.number(tags::ROWS).filter(|_| !is_spectrum) {
                Some(rows) => {
                    let (path, place) = (path.to_owned(), named(tags::PIXEL_DATA));
                    let problem = format!("the file states {rows} rows, but has no pixels");
                    Err(VolumeError::Field { path, place, problem })
                }
                None => Ok(None),
            };
        };
        let reading = Reading { path, root: &root, shared: first(&root, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE) };
        let mut layout = reading.layout(pixels.tag)?;
        let stated = root.number(tags::NUMBER_OF_FRAMES).unwrap_or(1.0);
        let wrong =
            || reading.wrong(tags::NUMBER_OF_FRAMES, format!("{stated} frames; there must be 1 to {MOST_FRAMES}"));
        if !(1.0..=9e15).contains(&stated) || stated.fract() != 0.0 {
            return Err(wrong());
        }
        // Too many to count their bits.
        if layout.bits().checked_mul(count(whole(stated))).is_none() {
            return Err(wrong());
        }
        let count = whole(stated);
        reading.holds(&syntax, (pixels, length), &layout, count)?;
        if stated > MOST_FRAMES {
            return Err(wrong());
        }
        let mut remarks: Vec<String> = remark.into_iter().collect();
        let mut frames = reading.frames(count, &mut remarks)?;
        let mut sheet = None;
        if count == 1
            && mosaic::is_mosaic(&root)
            && let Some((whole, slice, slices)) = mosaic::taken_apart(path, &root, &layout, &frames[0])?
        {
            remarks.push(format!(
                "a mosaic of {} slices of {}×{} pixels, taken apart",
                slices.len(),
                slice.columns,
                slice.rows
            ));
            (sheet, layout, frames) = (Some(whole), slice, slices);
        }
        reading.remark(&frames[0], &mut remarks);
        let limit = root.number(tags::PIXEL_PADDING_RANGE_LIMIT);
        let padding = root.number(tags::PIXEL_PADDING_VALUE).map(|stated| [stated, limit.unwrap_or(stated)]);
        let padding = padding.map(|both| both.map(|stated| signed(stated, &layout)));
        let mut marks = reading.shared.map(keys::of_groups).unwrap_or_default();
        marks.extend(keys::of_file(&root));
        let keyword =
            |item: &Item| item.number(tags::DIMENSION_INDEX_POINTER).and_then(tag_of).and_then(dataset::keyword);
        Ok(Some(Self {
            path: path.to_owned(),
            syntax,
            pixels,
            layout,
            count,
            frames,
            offsets: root.numbers(tags::EXTENDED_OFFSET_TABLE).to_vec(),
            series: root.word(tags::SERIES_INSTANCE_UID).unwrap_or_default(),
            instance: root.word(tags::SOP_INSTANCE_UID).unwrap_or_default(),
            number: root
                .number(tags::SERIES_NUMBER)
                .filter(|number| number.is_finite())
                .map_or_else(String::new, |it| it.to_string()),
            description: text(&root, tags::SERIES_DESCRIPTION).unwrap_or_default(),
            modality: root.word(tags::MODALITY).unwrap_or_default(),
            has_lut: !root.items(tags::MODALITY_LUT_SEQUENCE).is_empty(),
            padding,
            marks,
            dimensions: root
                .items(tags::DIMENSION_INDEX_SEQUENCE)
                .iter()
                .take(keys::MOST_DIMENSIONS)
                .map(|item| keyword(item).unwrap_or_default().to_owned())
                .collect(),
            instance_number: root.number(tags::INSTANCE_NUMBER).filter(|number| number.is_finite()),
            sheet,
            remarks,
            segmentation: root.word(tags::SEGMENTATION_TYPE).unwrap_or_default(),
        }))
    }

    /// Whether the frames share one place, so that they are time steps.
    pub(super) fn has_times(&self) -> bool {
        self.count > 1 && self.frames.len() == 1
    }

    /// The frame of this index.
    pub(super) fn frame(&self, index: usize) -> &Frame {
        &self.frames[index.min(self.frames.len() - 1)]
    }

    /// An error about the element `tag` of the file.
    pub(super) fn wrong(&self, tag: Tag, problem: String) -> VolumeError {
        VolumeError::Field { path: self.path.clone(), place: named(tag), problem }
    }
}

/// The number `stated` of an element whose sign is that of the pixels.
fn signed(stated: f64, layout: &Layout) -> f64 {
    let limit = 2_f64.powi(16);
    if layout.is_signed && layout.allocated <= 16 && stated >= limit / 2.0 { stated - limit } else { stated }
}

/// The tag in a value of type AT.
fn tag_of(number: f64) -> Option<Tag> {
    let [group, element] = [whole(number / 65536.0), whole(number.rem_euclid(65536.0))];
    Some(Tag(u16::try_from(group).ok()?, u16::try_from(element).ok()?))
}

/// The first item of a sequence.
fn first(item: &Item, sequence: Tag) -> Option<&Item> {
    item.items(sequence).first()
}

/// A text in the character set of the file.
pub(super) fn text(root: &Item, tag: Tag) -> Option<String> {
    let bytes = root.bytes(tag)?;
    let code = root.word(tags::SPECIFIC_CHARACTER_SET).unwrap_or_default();
    // The first set of several is that of texts without escape sequences.
    let first = code.split('\\').next().unwrap_or_default();
    let decoded = SpecificCharacterSet::from_code(first).and_then(|set| set.decode(bytes).ok());
    let text = decoded.unwrap_or_else(|| String::from_utf8_lossy(bytes).into_owned());
    let clean: String = text.chars().filter(|letter| !letter.is_control()).collect();
    Some(clean.trim().to_owned()).filter(|text| !text.is_empty())
}

/// The header of a file.
struct Reading<'a> {
    path: &'a Path,
    root: &'a Item,
    /// Functional groups of all frames.
    shared: Option<&'a Item>,
}

impl Reading<'_> {
    fn wrong(&self, tag: Tag, problem: String) -> VolumeError {
        VolumeError::Field { path: self.path.to_owned(), place: named(tag), problem }
    }

    /// A whole number from `low` to `high`; `otherwise` if the file states none.
    fn whole(&self, tag: Tag, [low, high]: [u32; 2], otherwise: Option<u32>) -> Result<u32, VolumeError> {
        let stated = self.root.number(tag);
        let Some(stated) = stated.or(otherwise.map(f64::from)) else {
            return Err(self.wrong(tag, "the element is missing".to_owned()));
        };
        let fits = stated.fract() == 0.0 && (f64::from(low)..=f64::from(high)).contains(&stated);
        let number = u32::try_from(whole(stated.max(0.0))).ok().filter(|_| fits);
        number.ok_or_else(|| self.wrong(tag, format!("the number is {stated}; it must be from {low} to {high}")))
    }

    fn layout(&self, pixels: Tag) -> Result<Layout, VolumeError> {
        let side = |tag| self.whole(tag, [1, 65535], None).map(|side| whole(side.into()));
        let samples = self.whole(tags::SAMPLES_PER_PIXEL, [1, 4], Some(1))?;
        let photometric = self.root.word(tags::PHOTOMETRIC_INTERPRETATION).unwrap_or_default();
        let floats = match pixels {
            tags::FLOAT_PIXEL_DATA => Some((32, VoxelType::F32)),
            tags::DOUBLE_FLOAT_PIXEL_DATA => Some((64, VoxelType::F64)),
            _ => None,
        };
        let allocated = self.whole(tags::BITS_ALLOCATED, [1, 64], floats.map(|(bits, _)| bits))?;
        let is_signed = self.whole(tags::PIXEL_REPRESENTATION, [0, 1], Some(0))? == 1;
        let voxel_type = match (allocated, is_signed, floats) {
            (_, _, Some((bits, voxel_type))) if bits == allocated => voxel_type,
            (1 | 8, false, None) => VoxelType::U8,
            (8, true, None) => VoxelType::I8,
            (16, false, None) => VoxelType::U16,
            (16, true, None) => VoxelType::I16,
            (32, false, None) => VoxelType::U32,
            (32, true, None) => VoxelType::I32,
            _ => {
                let sign = if is_signed { "signed" } else { "unsigned" };
                let problem = format!("pixels of {allocated} bits ({sign}); Relume reads 1 (unsigned), 8, 16 and 32");
                return Err(self.wrong(tags::BITS_ALLOCATED, problem));
            }
        };
        let stored = self.whole(tags::BITS_STORED, [1, allocated], Some(allocated))?;
        let high = self.whole(tags::HIGH_BIT, [stored - 1, allocated - 1], Some(stored - 1))?;
        Ok(Layout {
            rows: side(tags::ROWS)?,
            columns: side(tags::COLUMNS)?,
            samples: whole(samples.into()),
            is_planar: samples > 1 && self.whole(tags::PLANAR_CONFIGURATION, [0, 1], Some(0))? == 1,
            photometric,
            allocated,
            stored,
            high,
            is_signed,
            voxel_type,
        })
    }

    /// Checks that the file of `length` bytes can hold `frames` frames, before anything is allocated for them.
    fn holds(
        &self,
        syntax: &Syntax,
        (pixels, length): (Pixels, u64),
        layout: &Layout,
        frames: usize,
    ) -> Result<(), VolumeError> {
        let path = || self.path.to_owned();
        let expected = layout.bits().saturating_mul(count(frames)).div_ceil(8);
        match (syntax.coding, pixels.length) {
            (Coding::Deflated, stated) => {
                let expected = expected.saturating_add(pixels.at);
                let found = stated.unwrap_or(u64::MAX);
                if length.saturating_mul(DEFLATE_LIMIT) < expected {
                    let (encoding, limit) = ("deflate", DEFLATE_LIMIT);
                    return Err(VolumeError::Incredible {
                        path: path(),
                        compressed: length,
                        expected,
                        encoding,
                        limit,
                    });
                }
                if found < expected - pixels.at {
                    return Err(VolumeError::Short { path: path(), found, expected: expected - pixels.at });
                }
                Ok(())
            }
            (Coding::Plain, Some(stated)) => {
                let found = stated.min(length.saturating_sub(pixels.at));
                if found < expected {
                    return Err(VolumeError::Short { path: path(), found, expected });
                }
                Ok(())
            }
            (Coding::Plain, None) if syntax.uid != uids::ENCAPSULATED_UNCOMPRESSED_EXPLICIT_VR_LITTLE_ENDIAN => {
                let stated = match &*syntax.uid {
                    "" => "the file states no transfer syntax".to_owned(),
                    uid => format!("the stated transfer syntax, {uid}, has no compression"),
                };
                let problem = format!("{stated}, but the pixels are in fragments, as compressed ones are");
                Err(self.wrong(tags::TRANSFER_SYNTAX_UID, problem))
            }
            (coding, None) => {
                if let Some(limit) = coding.packing(layout.allocated) {
                    let (one, compressed) = (layout.bytes(), length.saturating_sub(pixels.at));
                    if one > MOST_BYTES {
                        let problem = format!("a frame of {one} bytes; Relume decodes at most {}", MOST_BYTES);
                        return Err(self.wrong(tags::ROWS, problem));
                    }
                    if compressed.saturating_mul(limit) < expected {
                        let (path, encoding) = (path(), coding.name());
                        return Err(VolumeError::Incredible { path, compressed, expected, encoding, limit });
                    }
                }
                // A fragment has a header of 8 bytes.
                let most = length.saturating_sub(pixels.at) / 8;
                if count(frames) > most {
                    let problem = format!("{frames} frames, but the file has room for at most {most} fragments");
                    return Err(self.wrong(tags::NUMBER_OF_FRAMES, problem));
                }
                Ok(())
            }
            (Coding::Foreign(_), Some(_)) => Ok(()),
            (coding, Some(stated)) => {
                let problem = format!(
                    "{stated} bytes of compressed pixels are in one piece, and not in fragments as they must be; the stated transfer \
                     syntax, {} ({}), may be wrong",
                    coding.name(),
                    syntax.uid
                );
                Err(self.wrong(pixels.tag, problem))
            }
        }
    }

    /// The frames: one for all, unless they have places of their own.
    fn frames(&self, count: usize, remarks: &mut Vec<String>) -> Result<Vec<Frame>, VolumeError> {
        let own = self.root.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE);
        if !own.is_empty() {
            if own.len() != count {
                let problem = format!("{} items for {count} frames", own.len());
                return Err(self.wrong(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, problem));
            }
            return own.iter().map(|item| self.frame(Some(item))).collect();
        }
        let frame = self.frame(None)?;
        if count == 1 {
            return Ok(vec![frame]);
        }
        let offsets = self.root.numbers(tags::GRID_FRAME_OFFSET_VECTOR);
        if offsets.is_empty() {
            return self.slices(frame, count, remarks);
        }
        if offsets.len() != count {
            let problem = format!("{} offsets for {count} frames", offsets.len());
            return Err(self.wrong(tags::GRID_FRAME_OFFSET_VECTOR, problem));
        }
        let normal = frame.orientation.map_or(DVec3::Z, |[row, column]| row.cross(column));
        let place = |offset: f64| frame.position.map(|position| position + normal * (offset - offsets[0]));
        Ok(offsets.iter().map(|&offset| Frame { position: place(offset), ..frame.clone() }).collect())
    }

    /// The frames of an old multi-frame file: slices, if a vector of slices or a distance between slices says so, and nothing
    /// that they are times (DICOM PS3.3, C.7.6.6 and C.8.4.15); otherwise `frame` alone, for all of them.
    fn slices(&self, frame: Frame, count: usize, remarks: &mut Vec<String>) -> Result<Vec<Frame>, VolumeError> {
        let pointers: Vec<Tag> =
            self.root.numbers(tags::FRAME_INCREMENT_POINTER).iter().filter_map(|&it| tag_of(it)).collect();
        let places = match pointers.contains(&tags::SLICE_VECTOR) {
            true => self.root.numbers(tags::SLICE_VECTOR),
            false => &[],
        };
        if pointers.contains(&tags::SLICE_VECTOR) && places.len() != count {
            let problem = format!("{} slices for {count} frames", places.len());
            return Err(self.wrong(tags::SLICE_VECTOR, problem));
        }
        // Pointers to distances and places say nothing new; all others count times, views or windows.
        let of_places = [tags::SPACING_BETWEEN_SLICES, tags::SLICE_THICKNESS, tags::SLICE_LOCATION];
        let is_told = pointers.iter().all(|pointer| of_places.contains(pointer));
        let step = match (frame.between.filter(|&step| step != 0.0), frame.thickness) {
            (Some(step), _) if is_told || !places.is_empty() => step,
            (None, Some(thickness)) if !places.is_empty() => {
                remarks.push(format!(
                    "no SpacingBetweenSlices; Relume takes SliceThickness, {} mm, as the distance of the slices",
                    brief(thickness)
                ));
                thickness
            }
            (None, None) if !places.is_empty() => {
                remarks
                    .push("no SpacingBetweenSlices and no SliceThickness; Relume uses 1 mm between slices".to_owned());
                1.0
            }
            _ => return Ok(vec![frame]),
        };
        if places.is_empty() {
            remarks.push(format!(
                "the {count} frames are taken as slices, {} mm apart (SpacingBetweenSlices)",
                brief(step.abs())
            ));
        }
        let [row, column] = frame.orientation.unwrap_or([DVec3::X, DVec3::Y]);
        let (normal, first) = (row.cross(column).normalize(), frame.position.unwrap_or(DVec3::ZERO));
        if !frame.is_anatomical {
            remarks.push("the file states no place in the patient; the first voxel is at 0, 0, 0".to_owned());
        }
        // Slices are counted from 1.
        let slice = |index: usize| places.get(index).map_or_else(|| number_of(index), |place| place - 1.0);
        let at = |index: usize| Frame {
            position: Some(first + normal * (step * slice(index))),
            orientation: Some([row, column]),
            marks: keys::of_vectors(self.root, &pointers, index),
            ..frame.clone()
        };
        Ok((0..count).map(at).collect())
    }

    /// Says what stands in for a spacing, and what becomes of real-world values.
    fn remark(&self, frame: &Frame, remarks: &mut Vec<String>) {
        let of_frame = self.root.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE).first();
        if let Some((spacing, tag)) = self.stand_in().filter(|_| !self.has_spacing(of_frame)) {
            remarks.push(format!(
                "no PixelSpacing; Relume uses {}, {} mm between rows and {} mm between columns, which is that of the detector",
                named(tag),
                brief(spacing[0]),
                brief(spacing[1])
            ));
        }
        let mappings = mappings(self.root, self.shared, of_frame);
        let Some(first) = mappings.first() else { return };
        let is_used = self.own_scaling(of_frame) == [None; 2] && self.mapping(of_frame).is_some();
        // The stored numbers may be the values already.
        let is_told = !is_used || first.scaling != Some([1.0, 0.0]);
        let is_equal = mappings.len() == 1 && first.scaling == Some([frame.slope, frame.intercept]);
        let named: Vec<String> = mappings.iter().map(|mapping| mapping.words.clone()).collect();
        if is_used && is_told {
            remarks.push(format!("the values are those of RealWorldValueMappingSequence: {}", named.join("; ")));
        } else if is_told && !is_equal {
            remarks.push(format!(
                "RealWorldValueMappingSequence states further values, which Relume does not use: {}",
                named.join("; ")
            ));
        }
    }

    /// The first numbers of a spacing that takes the place of `PixelSpacing`, and its element.
    fn stand_in(&self) -> Option<([f64; 2], Tag)> {
        [tags::IMAGER_PIXEL_SPACING, tags::NOMINAL_SCANNED_PIXEL_SPACING].into_iter().find_map(|tag| {
            match *self.root.numbers(tag) {
                [rows, columns] if rows > 0.0 && columns > 0.0 && rows.is_finite() && columns.is_finite() => {
                    Some(([rows, columns], tag))
                }
                _ => None,
            }
        })
    }

    /// Whether a frame states `PixelSpacing`.
    fn has_spacing(&self, own: Option<&Item>) -> bool {
        !self.numbers(own, tags::PIXEL_MEASURES_SEQUENCE, tags::PIXEL_SPACING).is_empty()
    }

    /// The numbers of an element: the groups of a frame override those of all frames, and these the root.
    fn numbers<'a>(&'a self, own: Option<&'a Item>, sequence: Tag, tag: Tag) -> &'a [f64] {
        let groups = [own, self.shared].into_iter().flatten().filter_map(|groups| first(groups, sequence));
        let found = groups.map(|item| item.numbers(tag)).find(|numbers| !numbers.is_empty());
        found.unwrap_or_else(|| self.root.numbers(tag))
    }

    /// `RescaleSlope` and `RescaleIntercept`, as far as they are stated.
    fn own_scaling(&self, own: Option<&Item>) -> [Option<f64>; 2] {
        [tags::RESCALE_SLOPE, tags::RESCALE_INTERCEPT].map(|tag| {
            let numbers = self.numbers(own, tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE, tag);
            numbers.first().copied().filter(|number| number.is_finite())
        })
    }

    /// Slope and intercept of the only real-world mapping, if there is one, and no other scaling.
    fn mapping(&self, own: Option<&Item>) -> Option<[f64; 2]> {
        let has_other = self.root.number(tags::DOSE_GRID_SCALING).is_some()
            || !self.root.items(tags::MODALITY_LUT_SEQUENCE).is_empty();
        match &mappings(self.root, self.shared, own)[..] {
            [Mapping { scaling, .. }] if !has_other => *scaling,
            _ => None,
        }
    }

    /// The frame with the functional groups `own`.
    fn frame(&self, own: Option<&Item>) -> Result<Frame, VolumeError> {
        let of = |sequence: Tag, tag: Tag| self.numbers(own, sequence, tag);
        let checked = |tag: Tag, numbers: &[f64], length: usize| match numbers {
            [] => Ok(None),
            numbers if numbers.len() == length && numbers.iter().all(|number| number.is_finite()) => {
                Ok(Some(numbers.to_vec()))
            }
            numbers => Err(self.wrong(tag, format!("the numbers are {numbers:?}; they must be {length} finite ones"))),
        };
        let finite = |sequence: Tag, tag: Tag, length: usize| checked(tag, of(sequence, tag), length);
        let of_detector = |tag: Tag, length: usize| {
            let detector = first(self.root, tags::DETECTOR_INFORMATION_SEQUENCE);
            checked(tag, detector.map_or(&[], |item| item.numbers(tag)), length)
        };
        let (place, turn) = (tags::IMAGE_POSITION_PATIENT, tags::IMAGE_ORIENTATION_PATIENT);
        let mut position = finite(tags::PLANE_POSITION_SEQUENCE, place, 3)?;
        let mut orientation = finite(tags::PLANE_ORIENTATION_SEQUENCE, turn, 6)?;
        // Those of nuclear medicine.
        position = if position.is_none() { of_detector(place, 3)? } else { position };
        orientation = if orientation.is_none() { of_detector(turn, 6)? } else { orientation };
        let is_anatomical = position.is_some() && orientation.is_some();
        if position.is_none() && orientation.is_none() {
            // Those in an ultrasound volume.
            position = finite(tags::PLANE_POSITION_VOLUME_SEQUENCE, tags::IMAGE_POSITION_VOLUME, 3)?;
            orientation = finite(tags::PLANE_ORIENTATION_VOLUME_SEQUENCE, tags::IMAGE_ORIENTATION_VOLUME, 6)?;
        }
        let orientation = orientation.map(|six| [DVec3::from_slice(&six), DVec3::from_slice(&six[3..])]);
        if let Some([row, column]) = orientation {
            let is_unit = |axis: DVec3| (axis.length() - 1.0).abs() <= 0.01;
            if !is_unit(row) || !is_unit(column) || row.dot(column).abs() > 0.01 {
                let problem = format!("{row} and {column} are not two orthogonal unit vectors");
                return Err(self.wrong(tags::IMAGE_ORIENTATION_PATIENT, problem));
            }
        }
        let spacing = finite(tags::PIXEL_MEASURES_SEQUENCE, tags::PIXEL_SPACING, 2)?;
        let spacing = spacing.map(|both| [both[0], both[1]]);
        if let Some([rows, columns]) = spacing.filter(|both| both.iter().any(|&step| step <= 0.0)) {
            let problem = format!("the spacing is {rows} {columns}; both numbers must be positive");
            return Err(self.wrong(tags::PIXEL_SPACING, problem));
        }
        let single = |sequence: Tag, tag: Tag| of(sequence, tag).first().copied().filter(|number| number.is_finite());
        let dose = self.root.number(tags::DOSE_GRID_SCALING).filter(|scaling| scaling.is_finite());
        let stated = self.own_scaling(own);
        let mapped = self.mapping(own).filter(|_| stated == [None; 2]);
        let [slope, intercept] = match (dose, mapped, stated) {
            (Some(dose), ..) => [dose, 0.0],
            (None, Some(mapped), _) => mapped,
            (None, None, [slope, intercept]) => [slope.unwrap_or(1.0), intercept.unwrap_or(0.0)],
        };
        if slope == 0.0 {
            return Err(self.wrong(tags::RESCALE_SLOPE, "the slope is 0; all values would be equal".to_owned()));
        }
        let content = tags::FRAME_CONTENT_SEQUENCE;
        let measures = tags::PIXEL_MEASURES_SEQUENCE;
        let stack = own.and_then(|own| first(own, content)).and_then(|content| content.word(tags::STACK_ID));
        let segment = own.or(self.shared).and_then(|own| first(own, tags::SEGMENT_IDENTIFICATION_SEQUENCE));
        Ok(Frame {
            position: position.map(|three| DVec3::from_slice(&three)),
            orientation: orientation.map(|axes| axes.map(DVec3::normalize)),
            is_anatomical,
            spacing: spacing.or_else(|| self.stand_in().map(|(spacing, _)| spacing)),
            thickness: single(measures, tags::SLICE_THICKNESS).filter(|&it| it > 0.0),
            between: single(measures, tags::SPACING_BETWEEN_SLICES),
            slope,
            intercept,
            marks: own.map(keys::of_groups).unwrap_or_default(),
            stack: stack.unwrap_or_default(),
            segment: segment.and_then(|item| item.number(tags::REFERENCED_SEGMENT_NUMBER)).map(whole),
        })
    }
}

/// A mapping of stored numbers to real-world values.
struct Mapping {
    /// Slope and intercept; `None` for a table.
    scaling: Option<[f64; 2]>,
    words: String,
}

/// The real-world mappings of a frame, or else of all frames, or else of the file.
fn mappings(root: &Item, shared: Option<&Item>, own: Option<&Item>) -> Vec<Mapping> {
    let all = [own, shared, Some(root)].into_iter().flatten();
    let all = all.map(|item| item.items(tags::REAL_WORLD_VALUE_MAPPING_SEQUENCE)).find(|items| !items.is_empty());
    let mapping = |item: &Item| {
        let [slope, intercept] =
            [tags::REAL_WORLD_VALUE_SLOPE, tags::REAL_WORLD_VALUE_INTERCEPT].map(|tag| item.number(tag));
        let scaling = slope.map(|slope| [slope, intercept.unwrap_or(0.0)]);
        let scaling = scaling.filter(|both| both.iter().all(|it| it.is_finite()) && both[0] != 0.0);
        let unit = first(item, tags::MEASUREMENT_UNITS_CODE_SEQUENCE);
        let unit = unit.and_then(|unit| text(unit, tags::CODE_VALUE).or_else(|| text(unit, tags::CODE_MEANING)));
        let unit = unit.map_or_else(String::new, |unit| format!(" ({unit})"));
        let name = text(item, tags::LUT_LABEL).or_else(|| text(item, tags::LUT_EXPLANATION));
        let name = name.map_or_else(String::new, |name| format!("{name} = "));
        let words = match scaling {
            Some([slope, intercept]) => {
                let sign = if intercept < 0.0 { "−" } else { "+" };
                format!("{name}{} × stored {sign} {}{unit}", brief(slope), brief(intercept.abs()))
            }
            None => format!("{name}a table{unit}"),
        };
        Mapping { scaling, words }
    };
    all.unwrap_or_default().iter().map(mapping).collect()
}

/// Description of a series, without its places: read again from one of its files.
#[derive(Debug, Default)]
pub(super) struct About {
    pub(super) windows: Vec<Window>,
    pub(super) metadata: Vec<(String, String)>,
}

/// Elements that are metadata, with their names.
const METADATA: [(Tag, &str); 13] = [
    (tags::MODALITY, "modality"),
    (tags::SERIES_DESCRIPTION, "series"),
    (tags::STUDY_DESCRIPTION, "study"),
    (tags::STUDY_DATE, "study date"),
    (tags::BODY_PART_EXAMINED, "body part"),
    (tags::PATIENT_POSITION, "patient position"),
    (tags::MANUFACTURER, "manufacturer"),
    (tags::MANUFACTURER_MODEL_NAME, "model"),
    (tags::CONVOLUTION_KERNEL, "kernel"),
    (tags::IMAGE_TYPE, "image type"),
    (tags::RESCALE_TYPE, "values"),
    (tags::MODALITY_LUT_TYPE, "values"),
    (tags::PHOTOMETRIC_INTERPRETATION, "photometric interpretation"),
];

/// Numbers that are metadata, with their names.
const NUMBERS: [(Tag, &str); 4] = [
    (tags::SLICE_THICKNESS, "slice thickness"),
    (tags::KVP, "kVp"),
    (tags::REPETITION_TIME, "repetition time"),
    (tags::ECHO_TIME, "echo time"),
];

impl About {
    /// Reads the windows of the frame `index` and the metadata of the file `path`.
    pub(super) fn read(path: &Path, index: usize) -> Result<Self, VolumeError> {
        let DataSet { syntax, root, .. } = dataset::read(path)?;
        let own = root.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE).get(index);
        let shared = first(&root, tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE);
        let groups = [own, shared].into_iter().flatten().filter_map(|it| first(it, tags::FRAME_VOILUT_SEQUENCE));
        let of = groups.chain([&root]).find(|item| !item.numbers(tags::WINDOW_CENTER).is_empty());
        let mut metadata: Vec<(String, String)> = Vec::new();
        for (tag, name) in METADATA {
            metadata.extend(text(&root, tag).map(|text| (name.to_owned(), text.replace('\\', ", "))));
        }
        for (tag, name) in NUMBERS {
            metadata.extend(root.number(tag).map(|number| (name.to_owned(), number.to_string())));
        }
        let mapped: Vec<String> = mappings(&root, shared, own).into_iter().map(|mapping| mapping.words).collect();
        if !mapped.is_empty() {
            metadata.push(("real-world values".to_owned(), mapped.join("; ")));
        }
        metadata.push(("transfer syntax".to_owned(), syntax.uid));
        Ok(Self { windows: of.map_or_else(Vec::new, windows), metadata })
    }
}

/// The windows of an item, from centre − width / 2 to centre + width / 2.
fn windows(item: &Item) -> Vec<Window> {
    let names = item.word(tags::WINDOW_CENTER_WIDTH_EXPLANATION).unwrap_or_default();
    let mut names = names.split('\\');
    let both = item.numbers(tags::WINDOW_CENTER).iter().zip(item.numbers(tags::WINDOW_WIDTH));
    let window = |(&centre, &width): (&f64, &f64)| {
        let name = names.next().map(str::trim).filter(|name| !name.is_empty()).unwrap_or("window of the file");
        Window::new(name, centre - width / 2.0, centre + width / 2.0)
    };
    both.filter_map(window).collect()
}

/// The windows in which a CT without windows is shown: soft tissue, bone, lung, in Hounsfield units.
pub(super) fn windows_of_ct() -> Vec<Window> {
    let all = [("soft tissue", -160.0, 240.0), ("bone", 300.0, 1500.0), ("lung", -1350.0, 150.0)];
    all.iter().filter_map(|&(name, low, high)| Window::new(name, low, high)).collect()
}

/// A table from stored numbers to values.
#[derive(Clone, Debug)]
pub(super) struct Lut {
    /// Stored number of the first entry.
    first: i64,
    values: Vec<u16>,
}

impl Lut {
    /// Reads the modality LUT of the file `path`.
    pub(super) fn read(path: &Path, layout: &Layout) -> Result<Self, VolumeError> {
        let wrong = |tag, problem| VolumeError::Field { path: path.to_owned(), place: named(tag), problem };
        let DataSet { root, .. } = dataset::read(path)?;
        let item = first(&root, tags::MODALITY_LUT_SEQUENCE).cloned().unwrap_or_default();
        let &[entries, start, bits] = item.numbers(tags::LUT_DESCRIPTOR) else {
            let stated = item.numbers(tags::LUT_DESCRIPTOR).len();
            return Err(wrong(tags::LUT_DESCRIPTOR, format!("{stated} numbers; a table is described by 3")));
        };
        // 0 stands for 65536, which does not fit; the sign of the first number is that of the pixels.
        let entries = if entries == 0.0 { 65536 } else { whole(entries.rem_euclid(65536.0)) };
        let data = item.numbers(tags::LUT_DATA);
        // Tables of 8 bits may have two entries in a word, the first one in its low byte.
        let is_packed = bits <= 8.0 && data.len() < entries && 2 * data.len() >= entries;
        let word = |number: f64| u16::try_from(whole(number.rem_euclid(65536.0))).unwrap_or_default();
        let mut values: Vec<u16> = if is_packed {
            data.iter().flat_map(|&pair| word(pair).to_le_bytes().map(u16::from)).collect()
        } else {
            data.iter().map(|&number| word(number)).collect()
        };
        if values.len() < entries {
            let problem = format!("{} entries, but the descriptor states {entries}", values.len());
            return Err(wrong(tags::LUT_DATA, problem));
        }
        values.truncate(entries);
        #[expect(clippy::cast_possible_truncation, reason = "a number of 16 bits")]
        let first = signed(start, layout) as i64;
        Ok(Self { first, values })
    }

    /// The value of the number `stored`; numbers outside the table have the value of its nearer end.
    pub(super) fn value(&self, stored: i64) -> u16 {
        let last = self.values.len().saturating_sub(1);
        let index = usize::try_from(stored - self.first).unwrap_or(0).min(last);
        self.values.get(index).copied().unwrap_or_default()
    }
}
