//! DICOM data sets: the elements that the reader wants, up to the pixel data (DICOM PS3.5 and PS3.10).
//!
//! A stack of open sequences replaces recursion. The length of an element is checked against the rest of its item before
//! anything is read, and only wanted values are kept.

use std::fs::File;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use dicom_core::header::{DataElementHeader, HasLength as _, Header as _};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::tags;
use dicom_encoding::decode::Decode as _;
use dicom_encoding::decode::explicit_be::ExplicitVRBigEndianDecoder;
use dicom_encoding::decode::explicit_le::ExplicitVRLittleEndianDecoder;
use dicom_encoding::decode::implicit_le::ImplicitVRLittleEndianDecoder;
use flate2::bufread::DeflateDecoder;

use super::syntax::{Coding, Syntax};
use crate::stream::{self, count, failed, read_fully};
use crate::{ByteOrder, VolumeError};

/// Largest number of bytes of a wanted value.
const LONGEST_VALUE: u32 = 1 << 20;
/// Largest number of nested sequences.
const DEEPEST: usize = 32;
/// Largest number of items of a sequence.
const MOST_ITEMS: usize = 1_000_000;
/// Largest number of wanted elements of a file, which take some 64 bytes each.
const MOST_ELEMENTS: usize = 1_000_000;
/// Largest number of bytes before the pixel data.
const LONGEST_HEADER: u64 = 64 << 20;

/// Private elements of Siemens in their first two blocks: the number of slices in a mosaic, and the header of an image.
pub(super) const MOSAIC_IMAGES: [Tag; 2] = [Tag(0x0019, 0x100a), Tag(0x0019, 0x110a)];
pub(super) const CSA_IMAGE: [Tag; 2] = [Tag(0x0029, 0x1010), Tag(0x0029, 0x1110)];

/// The wanted elements, sorted, with the types that they have where the file does not state them.
const WANTED: &[(Tag, VR)] = &[
    (tags::TRANSFER_SYNTAX_UID, VR::UI),
    (tags::SPECIFIC_CHARACTER_SET, VR::CS),
    (tags::IMAGE_TYPE, VR::CS),
    (tags::SOP_CLASS_UID, VR::UI),
    (tags::SOP_INSTANCE_UID, VR::UI),
    (tags::STUDY_DATE, VR::DA),
    (tags::ACQUISITION_DATE, VR::DA),
    (tags::ACQUISITION_DATE_TIME, VR::DT),
    (tags::ACQUISITION_TIME, VR::TM),
    (tags::MODALITY, VR::CS),
    (tags::MANUFACTURER, VR::LO),
    (tags::CODE_VALUE, VR::SH),
    (tags::CODE_MEANING, VR::LO),
    (tags::STUDY_DESCRIPTION, VR::LO),
    (tags::SERIES_DESCRIPTION, VR::LO),
    (tags::MANUFACTURER_MODEL_NAME, VR::LO),
    (tags::FRAME_TYPE, VR::CS),
    (tags::COMPLEX_IMAGE_COMPONENT, VR::CS),
    (tags::BODY_PART_EXAMINED, VR::CS),
    (tags::SEQUENCE_NAME, VR::SH),
    (tags::SLICE_THICKNESS, VR::DS),
    (tags::KVP, VR::DS),
    (tags::REPETITION_TIME, VR::DS),
    (tags::ECHO_TIME, VR::DS),
    (tags::INVERSION_TIME, VR::DS),
    (tags::ECHO_NUMBERS, VR::IS),
    (tags::SPACING_BETWEEN_SLICES, VR::DS),
    (tags::TRIGGER_TIME, VR::DS),
    (tags::IMAGER_PIXEL_SPACING, VR::DS),
    (tags::CONVOLUTION_KERNEL, VR::SH),
    (tags::RECEIVE_COIL_NAME, VR::SH),
    (tags::FLIP_ANGLE, VR::DS),
    (tags::NOMINAL_SCANNED_PIXEL_SPACING, VR::DS),
    (tags::PATIENT_POSITION, VR::CS),
    (tags::FRAME_ACQUISITION_DATE_TIME, VR::DT),
    (tags::DIFFUSION_DIRECTIONALITY, VR::CS),
    (tags::DIFFUSION_GRADIENT_DIRECTION_SEQUENCE, VR::SQ),
    (tags::INVERSION_TIMES, VR::FD),
    (tags::EFFECTIVE_ECHO_TIME, VR::FD),
    (tags::DIFFUSION_B_VALUE, VR::FD),
    (tags::DIFFUSION_GRADIENT_ORIENTATION, VR::FD),
    (tags::MR_TIMING_AND_RELATED_PARAMETERS_SEQUENCE, VR::SQ),
    (tags::MR_ECHO_SEQUENCE, VR::SQ),
    (tags::MR_MODIFIER_SEQUENCE, VR::SQ),
    (tags::MR_DIFFUSION_SEQUENCE, VR::SQ),
    (tags::CARDIAC_SYNCHRONIZATION_SEQUENCE, VR::SQ),
    (tags::FRAME_REFERENCE_DATE_TIME, VR::DT),
    (tags::MR_IMAGE_FRAME_TYPE_SEQUENCE, VR::SQ),
    (tags::CT_IMAGE_FRAME_TYPE_SEQUENCE, VR::SQ),
    (tags::PET_FRAME_TYPE_SEQUENCE, VR::SQ),
    (MOSAIC_IMAGES[0], VR::US),
    (MOSAIC_IMAGES[1], VR::US),
    (tags::SERIES_INSTANCE_UID, VR::UI),
    (tags::SERIES_NUMBER, VR::IS),
    (tags::ACQUISITION_NUMBER, VR::IS),
    (tags::INSTANCE_NUMBER, VR::IS),
    (tags::IMAGE_POSITION_PATIENT, VR::DS),
    (tags::IMAGE_ORIENTATION_PATIENT, VR::DS),
    (tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS),
    (tags::IMAGE_COMMENTS, VR::LT),
    (tags::STACK_ID, VR::SH),
    (tags::FRAME_CONTENT_SEQUENCE, VR::SQ),
    (tags::PLANE_POSITION_SEQUENCE, VR::SQ),
    (tags::PLANE_ORIENTATION_SEQUENCE, VR::SQ),
    (tags::TEMPORAL_POSITION_INDEX, VR::UL),
    (tags::NOMINAL_CARDIAC_TRIGGER_DELAY_TIME, VR::FD),
    (tags::FRAME_ACQUISITION_NUMBER, VR::US),
    (tags::DIMENSION_INDEX_VALUES, VR::UL),
    (tags::DIMENSION_INDEX_POINTER, VR::AT),
    (tags::DIMENSION_INDEX_SEQUENCE, VR::SQ),
    (tags::IMAGE_POSITION_VOLUME, VR::FD),
    (tags::IMAGE_ORIENTATION_VOLUME, VR::FD),
    (tags::PLANE_POSITION_VOLUME_SEQUENCE, VR::SQ),
    (tags::PLANE_ORIENTATION_VOLUME_SEQUENCE, VR::SQ),
    (tags::SAMPLES_PER_PIXEL, VR::US),
    (tags::PHOTOMETRIC_INTERPRETATION, VR::CS),
    (tags::PLANAR_CONFIGURATION, VR::US),
    (tags::NUMBER_OF_FRAMES, VR::IS),
    (tags::FRAME_INCREMENT_POINTER, VR::AT),
    (tags::ROWS, VR::US),
    (tags::COLUMNS, VR::US),
    (tags::PIXEL_SPACING, VR::DS),
    (tags::CORRECTED_IMAGE, VR::CS),
    (tags::BITS_ALLOCATED, VR::US),
    (tags::BITS_STORED, VR::US),
    (tags::HIGH_BIT, VR::US),
    (tags::PIXEL_REPRESENTATION, VR::US),
    (tags::PIXEL_PADDING_VALUE, VR::US),
    (tags::PIXEL_PADDING_RANGE_LIMIT, VR::US),
    (tags::WINDOW_CENTER, VR::DS),
    (tags::WINDOW_WIDTH, VR::DS),
    (tags::RESCALE_INTERCEPT, VR::DS),
    (tags::RESCALE_SLOPE, VR::DS),
    (tags::RESCALE_TYPE, VR::LO),
    (tags::WINDOW_CENTER_WIDTH_EXPLANATION, VR::LO),
    (tags::MODALITY_LUT_SEQUENCE, VR::SQ),
    (tags::LUT_DESCRIPTOR, VR::US),
    (tags::LUT_EXPLANATION, VR::LO),
    (tags::MODALITY_LUT_TYPE, VR::LO),
    (tags::LUT_DATA, VR::US),
    (tags::PIXEL_MEASURES_SEQUENCE, VR::SQ),
    (tags::FRAME_VOILUT_SEQUENCE, VR::SQ),
    (tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE, VR::SQ),
    (CSA_IMAGE[0], VR::OB),
    (CSA_IMAGE[1], VR::OB),
    (tags::MEASUREMENT_UNITS_CODE_SEQUENCE, VR::SQ),
    (tags::REAL_WORLD_VALUE_MAPPING_SEQUENCE, VR::SQ),
    (tags::LUT_LABEL, VR::SH),
    (tags::REAL_WORLD_VALUE_INTERCEPT, VR::FD),
    (tags::REAL_WORLD_VALUE_SLOPE, VR::FD),
    (tags::ENERGY_WINDOW_VECTOR, VR::US),
    (tags::DETECTOR_VECTOR, VR::US),
    (tags::DETECTOR_INFORMATION_SEQUENCE, VR::SQ),
    (tags::PHASE_VECTOR, VR::US),
    (tags::ROTATION_VECTOR, VR::US),
    (tags::RR_INTERVAL_VECTOR, VR::US),
    (tags::TIME_SLOT_VECTOR, VR::US),
    (tags::SLICE_VECTOR, VR::US),
    (tags::ANGULAR_VIEW_VECTOR, VR::US),
    (tags::TIME_SLICE_VECTOR, VR::US),
    (tags::UNITS, VR::CS),
    (tags::FRAME_REFERENCE_TIME, VR::DS),
    (tags::IMAGE_INDEX, VR::US),
    (tags::SEGMENTATION_TYPE, VR::CS),
    (tags::SEGMENT_SEQUENCE, VR::SQ),
    (tags::SEGMENT_NUMBER, VR::US),
    (tags::SEGMENT_LABEL, VR::LO),
    (tags::SEGMENT_IDENTIFICATION_SEQUENCE, VR::SQ),
    (tags::REFERENCED_SEGMENT_NUMBER, VR::US),
    (tags::RECOMMENDED_DISPLAY_CIE_LAB_VALUE, VR::US),
    (tags::MAXIMUM_FRACTIONAL_VALUE, VR::US),
    (tags::GRID_FRAME_OFFSET_VECTOR, VR::DS),
    (tags::DOSE_GRID_SCALING, VR::DS),
    (tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, VR::SQ),
    (tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, VR::SQ),
    (tags::EXTENDED_OFFSET_TABLE, VR::OV),
];

/// The type of a wanted element; `None` if it is not wanted.
fn wanted(tag: Tag) -> Option<VR> {
    WANTED.binary_search_by_key(&tag, |&(tag, _)| tag).ok().map(|index| WANTED[index].1)
}

/// Whether an element holds pixels.
fn is_pixels(tag: Tag) -> bool {
    [tags::PIXEL_DATA, tags::FLOAT_PIXEL_DATA, tags::DOUBLE_FLOAT_PIXEL_DATA].contains(&tag)
}

/// Names an element for messages: its keyword and its tag.
pub(super) fn named(tag: Tag) -> String {
    let Tag(group, element) = tag;
    format!("{} ({group:04X},{element:04X})", keyword(tag).unwrap_or("element"))
}

/// The keyword of an element of the standard.
pub(super) fn keyword(tag: Tag) -> Option<&'static str> {
    use dicom_core::dictionary::{DataDictionary as _, DataDictionaryEntry as _};
    dicom_dictionary_std::StandardDataDictionary.by_tag(tag).map(|entry| entry.alias())
}

/// A value of a wanted element.
#[derive(Clone, Debug)]
enum Value {
    /// Bytes of a text, in the character set of the file.
    Text(Vec<u8>),
    Numbers(Vec<f64>),
    /// Bytes of a private structure.
    Raw(Vec<u8>),
    Items(Vec<Item>),
}

/// The wanted elements of a data set, or of an item of a sequence.
#[derive(Clone, Debug, Default)]
pub(super) struct Item(Vec<(Tag, Value)>);

impl Item {
    fn value(&self, tag: Tag) -> Option<&Value> {
        // The last one counts if a file repeats an element.
        self.0.iter().rev().find(|(found, _)| *found == tag).map(|(_, value)| value)
    }

    /// The bytes of a text, without the padding at its end; `None` if there is none.
    pub(super) fn bytes(&self, tag: Tag) -> Option<&[u8]> {
        match self.value(tag) {
            Some(Value::Text(bytes)) => Some(bytes.trim_ascii()).filter(|bytes| !bytes.is_empty()),
            _ => None,
        }
    }

    /// A text of ASCII characters.
    pub(super) fn word(&self, tag: Tag) -> Option<String> {
        self.bytes(tag).map(|bytes| String::from_utf8_lossy(bytes).trim().to_owned())
    }

    /// All numbers of an element; empty without it.
    pub(super) fn numbers(&self, tag: Tag) -> &[f64] {
        match self.value(tag) {
            Some(Value::Numbers(numbers)) => numbers,
            _ => &[],
        }
    }

    /// The bytes of a private structure; empty without it.
    pub(super) fn raw(&self, tag: Tag) -> &[u8] {
        match self.value(tag) {
            Some(Value::Raw(bytes)) => bytes,
            _ => &[],
        }
    }

    /// The first number of an element.
    pub(super) fn number(&self, tag: Tag) -> Option<f64> {
        self.numbers(tag).first().copied()
    }

    /// The items of a sequence; empty without it.
    pub(super) fn items(&self, tag: Tag) -> &[Self] {
        match self.value(tag) {
            Some(Value::Items(items)) => items,
            _ => &[],
        }
    }
}

/// Place of the pixels in a data set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pixels {
    /// [`tags::PIXEL_DATA`], or one of the elements of floats.
    pub(super) tag: Tag,
    /// Offset of the first byte of the value: in the file, or in the inflated data set.
    pub(super) at: u64,
    /// Length as stated; `None` for fragments.
    pub(super) length: Option<u64>,
}

/// A data set up to its pixel data.
#[derive(Debug)]
pub(super) struct DataSet {
    pub(super) syntax: Syntax,
    /// Remark about a transfer syntax that the file states wrongly.
    pub(super) remark: Option<String>,
    pub(super) root: Item,
    /// `None` if the file has no pixels.
    pub(super) pixels: Option<Pixels>,
    /// Size of the file in bytes.
    pub(super) length: u64,
}

/// Bytes of a data set, inflated if need be.
pub(super) struct Stream {
    input: Input,
    /// Offset of the next byte: in the file, or in the inflated data set.
    at: u64,
    /// Length of the file; unknown for an inflated data set.
    length: Option<u64>,
}

enum Input {
    File(BufReader<File>),
    Deflated(Box<DeflateDecoder<BufReader<File>>>),
}

impl Read for Stream {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = match &mut self.input {
            Input::File(file) => file.read(bytes)?,
            Input::Deflated(inflated) => inflated.read(bytes)?,
        };
        self.at += count(read);
        Ok(read)
    }
}

impl Stream {
    /// The bytes of the file `path` from its beginning.
    pub(super) fn open(path: &Path) -> Result<Self, VolumeError> {
        let file = stream::open(path)?;
        let length = file.metadata().map_err(|source| failed(path, source))?.len();
        Ok(Self { input: Input::File(BufReader::with_capacity(1 << 14, file)), at: 0, length: Some(length) })
    }

    /// The rest of the file, inflated; it begins at offset 0.
    fn inflated(self) -> Self {
        match self.input {
            Input::File(file) => {
                Self { input: Input::Deflated(Box::new(DeflateDecoder::new(file))), at: 0, length: None }
            }
            input @ Input::Deflated(_) => Self { input, ..self },
        }
    }

    /// Discards `bytes`, which are there if the length is known.
    pub(super) fn skip(&mut self, bytes: u64) -> io::Result<()> {
        match (&mut self.input, i64::try_from(bytes)) {
            (Input::File(file), Ok(offset)) => {
                file.seek_relative(offset)?;
                self.at += bytes;
                Ok(())
            }
            _ => match io::copy(&mut self.by_ref().take(bytes), &mut io::sink())? {
                skipped if skipped == bytes => Ok(()),
                _ => Err(io::ErrorKind::UnexpectedEof.into()),
            },
        }
    }

    /// The next `N` bytes, which are read again; `None` if fewer are left.
    fn peek<const N: usize>(&mut self) -> io::Result<Option<[u8; N]>> {
        let mut bytes = [0; N];
        let there = read_fully(self, &mut bytes)?;
        // Only files are peeked into: an inflated data set has no meta group and a stated encoding.
        if let (Input::File(file), Ok(back)) = (&mut self.input, i64::try_from(there)) {
            file.seek_relative(-back)?;
            self.at -= count(there);
        }
        Ok((there == N).then_some(bytes))
    }

    /// Passes the preamble, if there is one.
    fn pass_preamble(&mut self) -> io::Result<()> {
        match self.peek::<132>()? {
            Some(bytes) if bytes.ends_with(b"DICM") => self.skip(132),
            _ => Ok(()),
        }
    }
}

/// An open sequence.
struct Open {
    tag: Tag,
    /// Whether its elements are kept.
    is_wanted: bool,
    /// End of the sequence, if it is stated.
    end: Option<u64>,
    /// State and end of its open item.
    item: Option<Option<u64>>,
    /// No item may go beyond.
    bound: u64,
    /// No element of the open item may go beyond.
    limit: u64,
    items: Vec<Item>,
    count: usize,
    encoding: Encoding,
}

/// Encoding of elements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Implicit,
    Explicit(ByteOrder),
}

/// Types of values in explicit encodings, and those of them whose length has four bytes behind two reserved ones.
const TYPES: &[u8] = b"AEASATCSDADSDTFDFLISLOLTOBODOFOLOVOWPNSHSLSQSSSTSVTMUCUIULUNURUSUTUV";
const LONG_TYPES: &[u8] = b"OBODOFOLOVOWSQSVUCUNURUTUV";

/// Whether two bytes are a type of `types`.
fn is_type(types: &[u8], bytes: [u8; 2]) -> bool {
    types.as_chunks::<2>().0.contains(&bytes)
}

impl Encoding {
    /// The encoding of a data set that begins with these bytes, a tag with a type or a length: the first group is a small number,
    /// so that one of its bytes is 0, and the first value is short. `None` if they begin none.
    fn of([a, b, _, _, v, r, high @ ..]: [u8; 8]) -> Option<Self> {
        match ([a, b], is_type(TYPES, [v, r]), high) {
            ([1..=0xff, 0], true, _) => Some(Self::Explicit(ByteOrder::Little)),
            ([0, 1..=0xff], true, _) => Some(Self::Explicit(ByteOrder::Big)),
            ([1..=0xff, 0], false, [0, 0]) => Some(Self::Implicit),
            _ => None,
        }
    }

    /// Whether the elements are implicit, and their byte order.
    fn as_syntax(self) -> (bool, ByteOrder) {
        match self {
            Self::Implicit => (true, ByteOrder::Little),
            Self::Explicit(byte_order) => (false, byte_order),
        }
    }
}

/// Whether these first bytes of a file are those of a data set without a preamble: elements in the order of their tags, the first
/// one of the groups 0002 or 0008, whose lengths lead from one to the next (DICOM PS3.5, §7.1).
pub(super) fn begins(beginning: &[u8]) -> bool {
    /// Elements that must be there; the four bytes of a tag and a length may occur by chance.
    const ENOUGH: usize = 3;
    let Some(encoding) = beginning.first_chunk().copied().and_then(Encoding::of) else { return false };
    let (is_implicit, byte_order) = encoding.as_syntax();
    let short = |at: usize| -> Option<u16> {
        let word = *beginning.get(at..)?.first_chunk()?;
        Some(if byte_order == ByteOrder::Big { u16::from_be_bytes(word) } else { u16::from_le_bytes(word) })
    };
    let long = |at: usize| -> Option<u32> {
        let [low, high] = [short(at)?, short(at + 2)?].map(u32::from);
        Some(if byte_order == ByteOrder::Big { low << 16 | high } else { high << 16 | low })
    };
    let (mut at, mut last, mut found) = (0, None, 0);
    while found < ENOUGH {
        let (Some(group), Some(element)) = (short(at), short(at + 2)) else { return false };
        let is_first = last.is_none();
        if (is_first && ![2, 8].contains(&group)) || last.is_some_and(|last| (group, element) <= last) {
            return false;
        }
        let (value, length) = match beginning.get(at + 4..).and_then(|rest| rest.first_chunk().copied()) {
            _ if is_implicit => (at + 8, long(at + 4)),
            Some(vr) if !is_type(TYPES, vr) => return false,
            Some(vr) if is_type(LONG_TYPES, vr) => (at + 12, long(at + 8)),
            _ => (at + 8, short(at + 6).map(u32::from)),
        };
        let Some(length) = length else { return false };
        found += 1;
        // The end of a sequence of unknown length is not looked for.
        if length == u32::MAX {
            return found >= 2;
        }
        (at, last) = (value.saturating_add(usize::try_from(length).unwrap_or(usize::MAX)), Some((group, element)));
        // An explicit element has a type beside its tag, so that fewer suffice where a long value follows.
        if at >= beginning.len() {
            return found >= if is_implicit { ENOUGH } else { 2 };
        }
    }
    true
}

/// A reader of elements.
struct Parser<'a> {
    path: &'a Path,
    stream: Stream,
    encoding: Encoding,
    elements: usize,
}

/// Reads the file `path` up to its pixel data. Files without a preamble, a meta group or a transfer syntax are read as
/// they appear to be encoded.
///
/// # Errors
///
/// [`VolumeError::Open`], [`VolumeError::Read`]; [`VolumeError::Field`] if the data set is damaged or exceeds a limit.
pub(super) fn read(path: &Path) -> Result<DataSet, VolumeError> {
    let mut stream = Stream::open(path)?;
    let length = stream.length.unwrap_or(0);
    stream.pass_preamble().map_err(|source| failed(path, source))?;
    let mut parser = Parser { path, stream, encoding: Encoding::Explicit(ByteOrder::Little), elements: 0 };
    let (meta, _) = parser.data_set(true)?;
    let stated = meta.word(tags::TRANSFER_SYNTAX_UID).map(|uid| uid.trim_end_matches('\0').trim().to_owned());
    let stated = stated.filter(|uid| !uid.is_empty()).map(|uid| Syntax::of(&uid));
    let beginning = parser.stream.peek::<8>().map_err(|source| failed(path, source))?;
    // A deflated data set shows nothing of its encoding, unless it is none.
    let is_deflated = stated.as_ref().is_some_and(|syntax| syntax.coding == Coding::Deflated);
    let beginning = beginning.filter(|bytes| !is_deflated || bytes.starts_with(&[8, 0]));
    let found = beginning.and_then(Encoding::of).map(Encoding::as_syntax);
    let (syntax, remark) = match stated {
        Some(stated) => stated.corrected(found),
        None => (Syntax::guessed(found), None),
    };
    parser.encoding = match syntax.byte_order {
        _ if syntax.is_implicit => Encoding::Implicit,
        byte_order => Encoding::Explicit(byte_order),
    };
    if syntax.coding == Coding::Deflated {
        parser.stream = parser.stream.inflated();
    }
    let (root, pixels) = parser.data_set(false).map_err(|error| match (syntax.coding, error) {
        (Coding::Foreign(name), VolumeError::Field { path, problem, .. }) => {
            let problem =
                format!("the file is coded as {name} ({}), which Relume does not decode ({problem})", syntax.uid);
            VolumeError::Field { path, place: named(tags::TRANSFER_SYNTAX_UID), problem }
        }
        (_, error) => error,
    })?;
    Ok(DataSet { syntax, remark, root, pixels, length })
}

/// A stream of the data set in the file `path` that begins at its offset `at`.
pub(super) fn stream_from(path: &Path, syntax: &Syntax, at: u64) -> Result<Stream, VolumeError> {
    let fail = |source| failed(path, source);
    let mut stream = Stream::open(path)?;
    if syntax.coding == Coding::Deflated {
        stream.pass_preamble().map_err(fail)?;
        let mut parser = Parser { path, stream, encoding: Encoding::Explicit(ByteOrder::Little), elements: 0 };
        parser.data_set(true)?;
        stream = parser.stream.inflated();
    }
    stream.skip(at).map_err(fail)?;
    Ok(stream)
}

impl Parser<'_> {
    fn wrong(&self, problem: String) -> VolumeError {
        let place = format!("byte {} of the data set", self.stream.at);
        VolumeError::Field { path: self.path.to_owned(), place, problem }
    }

    /// Reads elements up to the pixel data or the end; with `is_meta`, to the end of the group 0002.
    fn data_set(&mut self, is_meta: bool) -> Result<(Item, Option<Pixels>), VolumeError> {
        let mut root = Item::default();
        let mut open: Vec<Open> = Vec::new();
        let all = self.stream.length.unwrap_or(u64::MAX);
        loop {
            if let Some(innermost) = open.last_mut()
                && let Some(item) = innermost.item
                && item.is_some_and(|end| self.stream.at >= end)
            {
                innermost.item = None;
            }
            let at = self.stream.at;
            if at > LONGEST_HEADER {
                return Err(self.wrong(format!("more than {LONGEST_HEADER} bytes before the pixel data")));
            }
            // Between two items of the innermost sequence.
            if open.last().is_some_and(|innermost| innermost.item.is_none()) {
                if self.ends(open.last().and_then(|innermost| innermost.end))? || self.item(&mut open)? {
                    close(&mut open, &mut root);
                }
                continue;
            }
            if open.is_empty() {
                if is_meta && !self.is_in_meta()? {
                    return Ok((root, None));
                }
                if all == at {
                    return Ok((root, None));
                }
            }
            let encoding = open.last().map_or(self.encoding, |innermost| innermost.encoding);
            let limit = open.last().map_or(all, |innermost| innermost.limit);
            let header = match self.header(encoding) {
                Ok(Some(header)) => header,
                // An inflated data set ends where its stream ends.
                Ok(None) if open.is_empty() && self.stream.length.is_none() => return Ok((root, None)),
                Ok(None) => return Err(self.wrong("the file ends within an element".to_owned())),
                Err(source) => return Err(failed(self.path, source)),
            };
            let (tag, length) = (header.tag(), header.length());
            if tag == ITEM_END && !open.is_empty() {
                if let Some(innermost) = open.last_mut() {
                    innermost.item = None;
                }
                continue;
            }
            if tag.group() == DELIMITERS {
                return Err(self.wrong(format!("the delimiter {tag} stands where an element should be")));
            }
            if open.is_empty() && is_pixels(tag) {
                let length = length.get().map(u64::from);
                return Ok((root, Some(Pixels { tag, at: self.stream.at, length })));
            }
            let is_kept = open.last().is_none_or(|innermost| innermost.is_wanted);
            let kind = wanted(tag).filter(|_| is_kept);
            let Some(stated) = length.get() else {
                self.push(&mut open, (tag, kind == Some(VR::SQ)), None, limit, encoding, header.vr())?;
                continue;
            };
            let left = limit.saturating_sub(self.stream.at);
            if u64::from(stated) > left {
                let problem = format!("{} states {stated} bytes, but only {left} bytes are left", named(tag));
                return Err(self.wrong(problem));
            }
            // The length of an inflated stream is unknown, so that skipping may take as long as a header says.
            if self.stream.at.saturating_add(stated.into()) > LONGEST_HEADER {
                return Err(self.wrong(format!("more than {LONGEST_HEADER} bytes before the pixel data")));
            }
            // Only parts of private structures are read.
            let kind = kind.filter(|&kind| kind != VR::OB || stated <= LONGEST_VALUE);
            match kind {
                Some(VR::SQ) => {
                    let end = self.stream.at + u64::from(stated);
                    self.push(&mut open, (tag, true), Some(end), limit, encoding, header.vr())?;
                }
                Some(kind) => {
                    let value = self.value(tag, (header.vr(), kind), stated, encoding)?;
                    let item = match open.last_mut() {
                        Some(innermost) => innermost.items.last_mut(),
                        None => Some(&mut root),
                    };
                    if let Some(item) = item {
                        item.0.push((tag, value));
                    }
                }
                None => self.stream.skip(stated.into()).map_err(|source| failed(self.path, source))?,
            }
        }
    }

    /// Whether the next element belongs to the group 0002.
    fn is_in_meta(&mut self) -> Result<bool, VolumeError> {
        let next = self.stream.peek::<2>().map_err(|source| failed(self.path, source))?;
        Ok(next == Some([2, 0]))
    }

    /// Whether the position is `end`.
    fn ends(&self, end: Option<u64>) -> Result<bool, VolumeError> {
        match end {
            Some(end) if self.stream.at > end => {
                Err(self.wrong(format!("an item goes beyond the end of its sequence at byte {end}")))
            }
            end => Ok(end == Some(self.stream.at)),
        }
    }

    /// Reads the header of an element; `None` at the end of the bytes.
    fn header(&mut self, encoding: Encoding) -> io::Result<Option<DataElementHeader>> {
        let read = match encoding {
            Encoding::Implicit => ImplicitVRLittleEndianDecoder::default().decode_header(&mut self.stream),
            Encoding::Explicit(ByteOrder::Little) => {
                ExplicitVRLittleEndianDecoder::default().decode_header(&mut self.stream)
            }
            Encoding::Explicit(ByteOrder::Big) => ExplicitVRBigEndianDecoder::default().decode_header(&mut self.stream),
        };
        match read {
            Ok((header, _)) => Ok(Some(header)),
            Err(error) => {
                let source = std::error::Error::source(&error).and_then(|cause| cause.downcast_ref::<io::Error>());
                match source.map(io::Error::kind) {
                    Some(io::ErrorKind::UnexpectedEof) | None => Ok(None),
                    Some(kind) => Err(io::Error::new(kind, error.to_string())),
                }
            }
        }
    }

    /// Reads the header of an item into the innermost sequence; returns whether its end follows instead.
    fn item(&mut self, open: &mut [Open]) -> Result<bool, VolumeError> {
        let Some(innermost) = open.last_mut() else { return Ok(true) };
        let header = match self.header(innermost.encoding) {
            Ok(Some(header)) => header,
            Ok(None) => return Err(self.wrong(format!("the file ends within {}", named(innermost.tag)))),
            Err(source) => return Err(failed(self.path, source)),
        };
        match header.tag() {
            SEQUENCE_END => return Ok(true),
            ITEM => {}
            other => {
                let problem = format!("{other} stands where an item of {} should be", named(innermost.tag));
                return Err(self.wrong(problem));
            }
        }
        innermost.count += 1;
        if innermost.count > MOST_ITEMS {
            return Err(self.wrong(format!("{} has more than {MOST_ITEMS} items", named(innermost.tag))));
        }
        let bound = innermost.bound;
        let end = header.length().get().map(|length| self.stream.at + u64::from(length));
        if let Some(end) = end.filter(|&end| end > bound) {
            let problem = format!(
                "an item of {} ends at byte {end}, but its sequence ends at byte {bound}",
                named(innermost.tag)
            );
            return Err(self.wrong(problem));
        }
        innermost.item = Some(end);
        innermost.limit = end.unwrap_or(bound);
        if innermost.is_wanted {
            self.elements += 1;
            innermost.items.push(Item::default());
        }
        Ok(false)
    }

    /// Opens the sequence `tag` inside the innermost one.
    fn push(
        &self,
        open: &mut Vec<Open>,
        (tag, is_wanted): (Tag, bool),
        end: Option<u64>,
        limit: u64,
        encoding: Encoding,
        vr: VR,
    ) -> Result<(), VolumeError> {
        if open.len() == DEEPEST {
            return Err(self.wrong(format!("more than {DEEPEST} nested sequences")));
        }
        // PS3.5, §6.2.2, note 2: a sequence of unknown type is implicit, whatever the encoding around it.
        let encoding = if vr == VR::UN && encoding != Encoding::Implicit { Encoding::Implicit } else { encoding };
        let bound = end.unwrap_or(limit).min(limit);
        open.push(Open { tag, is_wanted, end, item: None, bound, limit: bound, items: Vec::new(), count: 0, encoding });
        Ok(())
    }

    /// Reads the value of a wanted element of `length` bytes; `kind` is its type where the file states none.
    fn value(
        &mut self,
        tag: Tag,
        (stated, kind): (VR, VR),
        length: u32,
        encoding: Encoding,
    ) -> Result<Value, VolumeError> {
        if length > LONGEST_VALUE {
            let problem = format!("{} has {length} bytes; Relume reads at most {LONGEST_VALUE}", named(tag));
            return Err(self.wrong(problem));
        }
        self.elements += 1;
        if self.elements > MOST_ELEMENTS {
            return Err(self.wrong(format!("more than {MOST_ELEMENTS} elements that Relume reads")));
        }
        let wanted = usize::try_from(length).unwrap_or(usize::MAX);
        let mut bytes = vec![0; wanted];
        let there = read_fully(&mut self.stream, &mut bytes).map_err(|source| failed(self.path, source))?;
        if there < wanted {
            return Err(self.wrong(format!("{} states {length} bytes, but the file ends", named(tag))));
        }
        let byte_order = match encoding {
            _ if stated == VR::UN => ByteOrder::Little,
            Encoding::Implicit => ByteOrder::Little,
            Encoding::Explicit(byte_order) => byte_order,
        };
        let vr = match encoding {
            Encoding::Implicit => kind,
            Encoding::Explicit(_) => agreed(stated, kind, &bytes),
        };
        Ok(valued(bytes, vr, byte_order))
    }
}

/// Whether a value of this type is a text that is no number.
fn is_text(vr: VR) -> bool {
    use VR::{AE, AS, CS, DA, DT, LO, LT, PN, SH, ST, TM, UC, UI, UR, UT};
    matches!(vr, AE | AS | CS | DA | DT | LO | LT | PN | SH | ST | TM | UC | UI | UR | UT)
}

/// The type of a value that a file states as `stated`, where it should be `kind`: some writers state another one, such as UT for
/// numbers in a text.
fn agreed(stated: VR, kind: VR, bytes: &[u8]) -> VR {
    let is_number_text = |bytes: &[u8]| {
        bytes.iter().all(|byte| matches!(byte, b'0'..=b'9' | b'+'..=b'.' | b'e' | b'E' | b'\\' | b' ' | 0))
    };
    let is_number = |vr: VR| matches!(vr, VR::DS | VR::IS);
    match (stated, kind) {
        // Private structures have many types.
        (_, VR::OB) | (VR::UN, _) => kind,
        // Numbers in a text that is stated as another text, or as bytes.
        (stated, kind) if is_number(kind) && is_text(stated) => kind,
        (VR::OB | VR::OW, kind) if is_number(kind) && is_number_text(bytes) => kind,
        (VR::OB, kind) if !is_text(kind) => kind,
        // Numbers that should be binary, and are a text.
        (stated, kind) if is_text(stated) && !is_text(kind) && is_number_text(bytes) => VR::DS,
        (stated, kind) if is_number(stated) && is_text(kind) => kind,
        (stated, _) => stated,
    }
}

/// Tags of items and of the ends of items and sequences, and their group.
const ITEM: Tag = Tag(0xfffe, 0xe000);
const ITEM_END: Tag = Tag(0xfffe, 0xe00d);
const SEQUENCE_END: Tag = Tag(0xfffe, 0xe0dd);
const DELIMITERS: u16 = 0xfffe;

/// Closes the innermost sequence, and puts it into the item around it.
fn close(open: &mut Vec<Open>, root: &mut Item) {
    let Some(closed) = open.pop() else { return };
    if !closed.is_wanted {
        return;
    }
    let item = match open.last_mut() {
        Some(outer) => outer.items.last_mut(),
        None => Some(root),
    };
    if let Some(item) = item {
        item.0.push((closed.tag, Value::Items(closed.items)));
    }
}

/// The value of `bytes` of type `vr`.
fn valued(bytes: Vec<u8>, vr: VR, byte_order: ByteOrder) -> Value {
    fn all<const N: usize>(bytes: &[u8], byte_order: ByteOrder, number: impl Fn([u8; N]) -> f64) -> Value {
        let (words, _) = bytes.as_chunks::<N>();
        let little = |&word: &[u8; N]| {
            let mut word = word;
            if byte_order == ByteOrder::Big {
                word.reverse();
            }
            number(word)
        };
        Value::Numbers(words.iter().map(little).collect())
    }
    #[expect(clippy::cast_precision_loss, reason = "offsets in files are far below 2⁵³")]
    match vr {
        VR::US | VR::OW => all(&bytes, byte_order, |word| u16::from_le_bytes(word).into()),
        VR::SS => all(&bytes, byte_order, |word| i16::from_le_bytes(word).into()),
        VR::UL | VR::OL => all(&bytes, byte_order, |word| u32::from_le_bytes(word).into()),
        VR::SL => all(&bytes, byte_order, |word| i32::from_le_bytes(word).into()),
        VR::UV | VR::OV => all(&bytes, byte_order, |word| u64::from_le_bytes(word) as f64),
        VR::SV => all(&bytes, byte_order, |word| i64::from_le_bytes(word) as f64),
        VR::FL | VR::OF => all(&bytes, byte_order, |word| f32::from_le_bytes(word).into()),
        VR::FD | VR::OD => all(&bytes, byte_order, f64::from_le_bytes),
        // Tags, of two words.
        VR::AT => {
            let word =
                |word| if byte_order == ByteOrder::Big { u16::from_be_bytes(word) } else { u16::from_le_bytes(word) };
            let both = |&[a, b, c, d]: &[u8; 4]| f64::from(u32::from(word([a, b])) << 16 | u32::from(word([c, d])));
            Value::Numbers(bytes.as_chunks::<4>().0.iter().map(both).collect())
        }
        VR::OB => Value::Raw(bytes),
        VR::DS | VR::IS => {
            let text = String::from_utf8_lossy(&bytes);
            let parsed =
                |part: &str| part.trim_matches(|letter: char| letter.is_whitespace() || letter == '\0').parse();
            // A part that is no number stands for one that is not known.
            Value::Numbers(if text.trim_matches(['\0', ' ']).is_empty() {
                Vec::new()
            } else {
                text.split('\\').map(|part| parsed(part).unwrap_or(f64::NAN)).collect()
            })
        }
        _ => Value::Text(bytes.into_iter().map(|byte| if byte == 0 { b' ' } else { byte }).collect()),
    }
}

/// A range of bytes of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Range {
    pub(super) at: u64,
    pub(super) length: u64,
}

/// Reads the ranges of the fragments of encapsulated pixel data that begin at byte `at` of the file `path`: the offset
/// table first.
///
/// # Errors
///
/// [`VolumeError::Field`] if a fragment goes beyond the end of the file, or if something else stands between fragments.
pub(super) fn fragments(path: &Path, at: u64) -> Result<Vec<Range>, VolumeError> {
    let mut stream = Stream::open(path)?;
    let length = stream.length.unwrap_or(0);
    stream.skip(at.min(length)).map_err(|source| failed(path, source))?;
    let wrong = |at: u64, problem: String| VolumeError::Field {
        path: PathBuf::from(path),
        place: format!("byte {at} of the pixel data's file"),
        problem,
    };
    let mut all = Vec::new();
    loop {
        let at = stream.at;
        let mut header = [0; 8];
        let there = read_fully(&mut stream, &mut header).map_err(|source| failed(path, source))?;
        if there < header.len() {
            // The end of the sequence is sometimes missing.
            if all.is_empty() {
                return Err(wrong(at, "the pixel data have no fragments".to_owned()));
            }
            return Ok(all);
        }
        let [a, b, c, d, sizes @ ..] = header;
        let size = u64::from(u32::from_le_bytes(sizes));
        match [a, b, c, d] {
            [0xfe, 0xff, 0x00, 0xe0] => {}
            [0xfe, 0xff, 0xdd, 0xe0] => return Ok(all),
            _ => return Err(wrong(at, format!("{a:02x}{b:02x}{c:02x}{d:02x} stands where a fragment should be"))),
        }
        let left = length - stream.at.min(length);
        if size > left {
            return Err(wrong(at, format!("a fragment states {size} bytes, but only {left} bytes are left")));
        }
        all.push(Range { at: stream.at, length: size });
        stream.skip(size).map_err(|source| failed(path, source))?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wanted_elements_are_sorted() {
        assert!(WANTED.is_sorted_by(|(one, _), (next, _)| one < next), "for the search");
    }
}
