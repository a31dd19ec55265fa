//! Header of one file: layout of its pixels, and places of its frames (DICOM PS3.3).

use std::path::{Path, PathBuf};

use dicom_core::Tag;
use dicom_dictionary_std::{tags, uids};
use dicom_encoding::text::{SpecificCharacterSet, TextCodec as _};
use glam::DVec3;

use super::dataset::{self, DataSet, Item, Pixels, named};
use super::syntax::{Coding, MOST_BYTES, Syntax};
use crate::number::whole;
use crate::volume::stream::{DEFLATE_LIMIT, count};
use crate::volume::{VolumeError, VoxelType, Window};

/// Largest number of frames of a file.
const MOST_FRAMES: f64 = 1e6;

/// Layout of the stored numbers of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Layout {
    pub(super) rows: usize,
    pub(super) columns: usize,
    /// Numbers per pixel.
    pub(super) samples: usize,
    /// Whether the samples lie in planes, and not side by side.
    pub(super) is_planar: bool,
    pub(super) photometric: String,
    /// Bits between neighbouring numbers, used bits of each, and the highest used bit.
    pub(super) allocated: u32,
    pub(super) stored: u32,
    pub(super) high: u32,
    pub(super) is_signed: bool,
    pub(super) voxel_type: VoxelType,
}

impl Layout {
    /// Pixels of a frame.
    pub(super) fn pixels(&self) -> usize {
        self.rows * self.columns
    }

    /// Bits of a frame.
    pub(super) fn bits(&self) -> u64 {
        count(self.pixels()).saturating_mul(count(self.samples)).saturating_mul(self.allocated.into())
    }

    /// Bytes of a frame of whole bytes.
    pub(super) fn bytes(&self) -> u64 {
        self.bits().div_ceil(8)
    }
}

/// Attributes that tell apart slices at one position, with their names.
pub(super) const KEYS: [&str; 5] = ["temporal position", "acquisition", "b-value", "echo", "trigger time"];

/// Place and scaling of a frame.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// World position of the centre of the first pixel, in mm.
    pub(super) position: Option<DVec3>,
    /// Directions of growing column and row index.
    pub(super) orientation: Option<[DVec3; 2]>,
    /// Distances between rows and between columns, in mm.
    pub(super) spacing: Option<[f64; 2]>,
    pub(super) thickness: Option<f64>,
    pub(super) slope: f64,
    pub(super) intercept: f64,
    /// Values of [`KEYS`]; NaN where the file states none.
    pub(super) keys: [f64; KEYS.len()],
    /// Stack of the frame, if the file has several.
    pub(super) stack: String,
    /// Segment of a frame of a segmentation.
    pub(super) segment: Option<usize>,
}

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
    pub(super) padding: Option<f64>,
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
        let DataSet { syntax, root, pixels, length } = dataset::read(path)?;
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
        let layout = reading.layout(pixels.tag)?;
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
        let frames = reading.frames(count)?;
        let padding = root.number(tags::PIXEL_PADDING_VALUE).map(|stated| signed(stated, &layout));
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
            (_, Some(stated)) => {
                let problem = format!(
                    "{stated} bytes of compressed pixels are in one piece, and not in fragments as they must be"
                );
                Err(self.wrong(pixels.tag, problem))
            }
        }
    }

    /// The frames: one for all, unless they have places of their own.
    fn frames(&self, count: usize) -> Result<Vec<Frame>, VolumeError> {
        let own = self.root.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE);
        if !own.is_empty() {
            if own.len() != count {
                let problem = format!("{} items for {count} frames", own.len());
                return Err(self.wrong(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, problem));
            }
            return own.iter().map(|item| self.frame(Some(item))).collect();
        }
        let frame = self.frame(None)?;
        let offsets = self.root.numbers(tags::GRID_FRAME_OFFSET_VECTOR);
        if offsets.is_empty() || count == 1 {
            return Ok(vec![frame]);
        }
        if offsets.len() != count {
            let problem = format!("{} offsets for {count} frames", offsets.len());
            return Err(self.wrong(tags::GRID_FRAME_OFFSET_VECTOR, problem));
        }
        let normal = frame.orientation.map_or(DVec3::Z, |[row, column]| row.cross(column));
        let place = |offset: f64| frame.position.map(|position| position + normal * (offset - offsets[0]));
        Ok(offsets.iter().map(|&offset| Frame { position: place(offset), ..frame.clone() }).collect())
    }

    /// The frame with the functional groups `own`.
    fn frame(&self, own: Option<&Item>) -> Result<Frame, VolumeError> {
        // The groups of a frame override those of all frames, and these the root.
        let of = |sequence: Tag, tag: Tag| -> &[f64] {
            let groups = [own, self.shared].into_iter().flatten().filter_map(|groups| first(groups, sequence));
            let found = groups.map(|item| item.numbers(tag)).find(|numbers| !numbers.is_empty());
            found.unwrap_or_else(|| self.root.numbers(tag))
        };
        let finite = |sequence: Tag, tag: Tag, length: usize| match of(sequence, tag) {
            [] => Ok(None),
            numbers if numbers.len() == length && numbers.iter().all(|number| number.is_finite()) => Ok(Some(numbers)),
            numbers => Err(self.wrong(tag, format!("the numbers are {numbers:?}; they must be {length} finite ones"))),
        };
        let position = finite(tags::PLANE_POSITION_SEQUENCE, tags::IMAGE_POSITION_PATIENT, 3)?;
        let orientation = finite(tags::PLANE_ORIENTATION_SEQUENCE, tags::IMAGE_ORIENTATION_PATIENT, 6)?;
        let orientation = orientation.map(|six| [DVec3::from_slice(six), DVec3::from_slice(&six[3..])]);
        if let Some([row, column]) = orientation {
            let is_unit = |axis: DVec3| (axis.length() - 1.0).abs() <= 0.01;
            if !is_unit(row) || !is_unit(column) || row.dot(column).abs() > 0.01 {
                let problem = format!("{row} and {column} are not two orthogonal unit vectors");
                return Err(self.wrong(tags::IMAGE_ORIENTATION_PATIENT, problem));
            }
        }
        let spacing = finite(tags::PIXEL_MEASURES_SEQUENCE, tags::PIXEL_SPACING, 2)?;
        if let Some([rows, columns]) = spacing.filter(|both| both.iter().any(|&step| step <= 0.0)) {
            let problem = format!("the spacing is {rows} {columns}; both numbers must be positive");
            return Err(self.wrong(tags::PIXEL_SPACING, problem));
        }
        let single = |sequence: Tag, tag: Tag| of(sequence, tag).first().copied().filter(|number| number.is_finite());
        let scaling = tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE;
        let dose = self.root.number(tags::DOSE_GRID_SCALING).filter(|scaling| scaling.is_finite());
        let slope = dose.or_else(|| single(scaling, tags::RESCALE_SLOPE)).unwrap_or(1.0);
        if slope == 0.0 {
            return Err(self.wrong(tags::RESCALE_SLOPE, "the slope is 0; all values would be equal".to_owned()));
        }
        let content = tags::FRAME_CONTENT_SEQUENCE;
        let keys = [
            single(content, tags::TEMPORAL_POSITION_INDEX)
                .or_else(|| single(content, tags::TEMPORAL_POSITION_IDENTIFIER)),
            single(content, tags::ACQUISITION_NUMBER),
            single(tags::MR_DIFFUSION_SEQUENCE, tags::DIFFUSION_B_VALUE),
            single(content, tags::ECHO_NUMBERS),
            single(content, tags::TRIGGER_TIME),
        ];
        let stack = own.and_then(|own| first(own, content)).and_then(|content| content.word(tags::STACK_ID));
        let segment = own.or(self.shared).and_then(|own| first(own, tags::SEGMENT_IDENTIFICATION_SEQUENCE));
        Ok(Frame {
            position: position.map(DVec3::from_slice),
            orientation: orientation.map(|axes| axes.map(DVec3::normalize)),
            spacing: spacing.map(|both| [both[0], both[1]]),
            thickness: single(tags::PIXEL_MEASURES_SEQUENCE, tags::SLICE_THICKNESS).filter(|&it| it > 0.0),
            slope,
            intercept: if dose.is_some() { 0.0 } else { single(scaling, tags::RESCALE_INTERCEPT).unwrap_or(0.0) },
            keys: keys.map(|key| key.unwrap_or(f64::NAN)),
            stack: stack.unwrap_or_default(),
            segment: segment.and_then(|item| item.number(tags::REFERENCED_SEGMENT_NUMBER)).map(whole),
        })
    }
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
