//! Parser for the tags of a VTK XML file: its arrays, and the positions of their values.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use glam::{DMat3, DVec3};
use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::bytes::Compressor;
use super::grid::{Extent, Frame, Section};
use crate::layout::ByteOrder;
use crate::stream::{self, count};
use crate::{VolumeError, VoxelType};
use relume_base::progress::Progress;

/// Largest size of the tags in bytes, without the values between them. Nested tags take up to four times as much
/// memory.
const LONGEST_MARKUP: u64 = 12 << 20;

/// Largest number of pieces and arrays together; more are a mistake.
const MOST_ARRAYS: usize = 1 << 16;

/// Largest number of components per voxel; more are a mistake.
const MOST_COMPONENTS: usize = 1 << 16;

/// Position of an array's values, as an offset in the file unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    /// Numbers between tags.
    Text(u64),
    /// Base64 between tags.
    Base64(u64),
    /// Offset in the appended section, in characters.
    Appended(u64),
}

/// An array declared by a tag.
#[derive(Clone, Debug)]
pub(super) struct Array {
    pub(super) section: Section,
    pub(super) name: String,
    /// The type as named in the file.
    pub(super) type_name: String,
    pub(super) components: usize,
    /// Whether its section names it as the default scalars.
    pub(super) active: bool,
    /// Number of tuples, if stated, as in field data.
    pub(super) tuples: Option<usize>,
    pub(super) place: Place,
}

impl Array {
    /// Type of the values; `None` for strings and bits.
    pub(super) fn voxel_type(&self) -> Option<VoxelType> {
        self.type_name.parse().ok()
    }

    /// Whether `other` is the same array, of another piece or time step.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.section == other.section && self.name == other.name
    }
}

/// A part of the image.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub(super) extent: Extent,
    pub(super) arrays: Vec<Array>,
}

/// Position and encoding of the appended values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Appended {
    pub(super) base64: bool,
    pub(super) start: u64,
}

/// Content of the tags.
#[derive(Debug)]
pub(super) struct Header {
    pub(super) path: PathBuf,
    /// Size of the file in bytes.
    pub(super) length: u64,
    pub(super) byte_order: ByteOrder,
    /// Whether header words before values have eight bytes instead of four.
    pub(super) wide: bool,
    pub(super) compressor: Option<Compressor>,
    pub(super) frame: Frame,
    pub(super) fields: Vec<Array>,
    pub(super) pieces: Vec<Piece>,
    pub(super) appended: Option<Appended>,
}

impl Header {
    /// Reads the tags up to the appended section, and skips the values between them.
    pub(super) fn read(path: &Path, progress: &dyn Progress) -> Result<Self, VolumeError> {
        let wrong = |problem: String| VolumeError::Vti { path: path.to_owned(), problem };
        let failed = |source| stream::failed(path, source);
        let stream = stream::at(path, 0)?;
        let length = stream.get_ref().metadata().map_err(failed)?.len();
        let mut xml = Reader::from_reader(Markup { stream, at: 0, limit: LONGEST_MARKUP });
        let mut builder = Builder {
            path,
            depth: 0,
            file: None,
            frame: None,
            section: None,
            scalars: None,
            in_piece: false,
            fields: Vec::new(),
            pieces: Vec::new(),
            arrays: 0,
            base64: None,
        };
        let mut buffer = Vec::new();
        loop {
            // The XML reader never sees text, because it would hold all of it in memory.
            while xml.get_mut().skip_some_text().map_err(failed)? {
                if progress.cancelled() {
                    return Err(VolumeError::Cancelled { source_name: path.display().to_string() });
                }
            }
            buffer.clear();
            let event = xml.read_event_into(&mut buffer).map_err(|error| match error {
                quick_xml::Error::Io(error) => failed(io::Error::new(error.kind(), error.to_string())),
                error => wrong(format!("invalid XML: {error}")),
            })?;
            let at = xml.get_ref().at;
            match event {
                Event::Start(tag) => builder.open(&tag, at)?,
                Event::Empty(tag) => {
                    builder.open(&tag, at)?;
                    builder.close(tag.name().as_ref());
                }
                Event::End(tag) => builder.close(tag.name().as_ref()),
                Event::DocType(_) => return Err(wrong("a VTK file must not declare a document type".to_owned())),
                Event::Eof => return builder.finish(length, None),
                _ => {}
            }
            if let Some(base64) = builder.base64 {
                let start = xml.get_mut().past_underscore().map_err(failed)?;
                let start = start.ok_or_else(|| wrong("AppendedData does not begin with _".to_owned()))?;
                return builder.finish(length, Some(Appended { base64, start }));
            }
        }
    }

    pub(super) fn wrong(&self, problem: String) -> VolumeError {
        VolumeError::Vti { path: self.path.clone(), problem }
    }
}

/// Input of the XML reader: counts all bytes, and limits those that are not skipped.
struct Markup {
    stream: BufReader<File>,
    at: u64,
    limit: u64,
}

impl Markup {
    /// Skips text in the buffer; returns `false` at a tag or at the end.
    fn skip_some_text(&mut self) -> io::Result<bool> {
        let buffer = self.stream.fill_buf()?;
        let tag = memchr::memchr(b'<', buffer);
        let text = tag.unwrap_or(buffer.len());
        let more = tag.is_none() && text > 0;
        self.limit += count(text);
        self.consume(text);
        Ok(more)
    }

    /// Skips white space and an underscore; returns the offset after it, or `None` before any other byte.
    fn past_underscore(&mut self) -> io::Result<Option<u64>> {
        let mut byte = [0];
        while self.read(&mut byte)? == 1 {
            match byte[0] {
                b'_' => return Ok(Some(self.at)),
                blank if blank.is_ascii_whitespace() => {}
                _ => break,
            }
        }
        Ok(None)
    }
}

impl Read for Markup {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.fill_buf()?.read(bytes)?;
        self.consume(read);
        Ok(read)
    }
}

impl BufRead for Markup {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.at >= self.limit {
            return Err(io::Error::other(format!("the tags exceed the limit of {LONGEST_MARKUP} bytes")));
        }
        self.stream.fill_buf()
    }

    fn consume(&mut self, amount: usize) {
        self.at += count(amount);
        self.stream.consume(amount);
    }
}

/// State of the parser.
struct Builder<'a> {
    path: &'a Path,
    /// Number of open tags.
    depth: usize,
    file: Option<FileTag>,
    frame: Option<Frame>,
    section: Option<Section>,
    /// Default scalars named by the section.
    scalars: Option<String>,
    in_piece: bool,
    fields: Vec<Array>,
    pieces: Vec<Piece>,
    /// Number of arrays and pieces so far.
    arrays: usize,
    /// Whether appended values are base64; `None` before their tag.
    base64: Option<bool>,
}

struct FileTag {
    byte_order: ByteOrder,
    wide: bool,
    compressor: Option<Compressor>,
}

impl Builder<'_> {
    fn wrong(&self, problem: String) -> VolumeError {
        VolumeError::Vti { path: self.path.to_owned(), problem }
    }

    /// Handles an opening tag that ends at offset `at`.
    fn open(&mut self, tag: &BytesStart<'_>, at: u64) -> Result<(), VolumeError> {
        self.depth += 1;
        let name = tag.name();
        if self.file.is_none() && name.as_ref() != "VTKFile" {
            return Err(self.wrong(format!("the first tag is <{}>, not <VTKFile>", name.as_ref())));
        }
        match name.as_ref() {
            "VTKFile" => self.file = Some(self.file_tag(tag)?),
            "ImageData" => self.frame = Some(self.frame(tag)?),
            "Piece" => {
                let extent = self.attribute(tag, "Extent")?;
                let extent = extent.ok_or_else(|| self.wrong("a Piece has no Extent".to_owned()))?;
                let extent = self.parse(&extent, "Extent of a Piece", "six 32-bit whole numbers")?;
                self.pieces.push(Piece { extent, arrays: Vec::new() });
                self.in_piece = true;
                self.count()?;
            }
            "PointData" | "CellData" | "FieldData" => {
                self.section = Section::ALL.into_iter().find(|section| section.name() == name.as_ref());
                self.scalars = self.attribute(tag, "Scalars")?;
            }
            "DataArray" | "Array" => {
                let Some(section) = self.section else { return Ok(()) };
                let array = self.array(tag, section, at)?;
                match self.pieces.last_mut() {
                    Some(piece) if self.in_piece => piece.arrays.push(array),
                    _ if section == Section::Fields => self.fields.push(array),
                    _ => return Err(self.wrong(format!("the array {:?} is outside all Pieces", array.name))),
                }
                self.count()?;
            }
            "AppendedData" => {
                self.base64 = Some(match self.attribute(tag, "encoding")?.as_deref() {
                    Some("raw") => false,
                    // VTK's default.
                    Some("base64") | None => true,
                    Some(other) => {
                        return Err(
                            self.wrong(format!("the encoding of AppendedData must be raw or base64, not {other}"))
                        );
                    }
                });
            }
            _ => {}
        }
        Ok(())
    }

    fn close(&mut self, name: &str) {
        self.depth = self.depth.saturating_sub(1);
        match name {
            "Piece" => self.in_piece = false,
            "PointData" | "CellData" | "FieldData" => self.section = None,
            _ => {}
        }
    }

    fn count(&mut self) -> Result<(), VolumeError> {
        self.arrays += 1;
        if self.arrays > MOST_ARRAYS {
            return Err(self.wrong(format!("the pieces and arrays exceed the limit of {MOST_ARRAYS}")));
        }
        Ok(())
    }

    fn file_tag(&self, tag: &BytesStart<'_>) -> Result<FileTag, VolumeError> {
        match self.attribute(tag, "type")?.as_deref() {
            Some("ImageData") => {}
            Some("PImageData") => {
                return Err(self.wrong("PImageData is a list of other files; open one of them".to_owned()));
            }
            other => {
                return Err(self.wrong(format!(
                    "the type of VTKFile is {}; only ImageData is supported",
                    other.unwrap_or("missing")
                )));
            }
        }
        let byte_order = match self.attribute(tag, "byte_order")?.as_deref() {
            Some("LittleEndian") => ByteOrder::Little,
            Some("BigEndian") => ByteOrder::Big,
            // VTK's default.
            None => ByteOrder::NATIVE,
            Some(other) => {
                return Err(self.wrong(format!("byte_order must be LittleEndian or BigEndian, not {other}")));
            }
        };
        let wide = match self.attribute(tag, "header_type")?.as_deref() {
            Some("UInt32") | None => false,
            Some("UInt64") => true,
            Some(other) => return Err(self.wrong(format!("header_type must be UInt32 or UInt64, not {other}"))),
        };
        let compressor = match self.attribute(tag, "compressor")?.as_deref() {
            None | Some("") => None,
            Some(name) => Some(Compressor::named(name).ok_or_else(|| {
                self.wrong(format!(
                    "compressor {name} is not one of {}",
                    Compressor::ALL.map(Compressor::name).join(", ")
                ))
            })?),
        };
        Ok(FileTag { byte_order, wide, compressor })
    }

    fn frame(&self, tag: &BytesStart<'_>) -> Result<Frame, VolumeError> {
        let extent = self.attribute(tag, "WholeExtent")?;
        let extent = extent.ok_or_else(|| self.wrong("ImageData has no WholeExtent".to_owned()))?;
        let numbers = |name: &'static str, default: &str| -> Result<Vec<f64>, VolumeError> {
            let text = self.attribute(tag, name)?.unwrap_or_else(|| default.to_owned());
            let numbers = text.split_whitespace().map(f64::from_str).collect::<Result<Vec<_>, _>>();
            let wanted = default.split(' ').count();
            numbers
                .ok()
                .filter(|numbers| numbers.len() == wanted)
                .ok_or_else(|| self.wrong(format!("{name} {} should be {wanted} numbers", shortened(&text))))
        };
        // Row by row in the file; column i is axis i.
        let direction = numbers("Direction", "1 0 0 0 1 0 0 0 1")?;
        let direction = DMat3::from_cols_slice(&direction).transpose();
        Ok(Frame {
            extent: self.parse(&extent, "WholeExtent", "six 32-bit whole numbers")?,
            origin: DVec3::from_slice(&numbers("Origin", "0 0 0")?),
            spacing: DVec3::from_slice(&numbers("Spacing", "1 1 1")?),
            direction,
        })
    }

    fn array(&self, tag: &BytesStart<'_>, section: Section, at: u64) -> Result<Array, VolumeError> {
        let name = self.attribute(tag, "Name")?.unwrap_or_default();
        let type_name = self.attribute(tag, "type")?.unwrap_or_default();
        let whole = |key: &'static str| match self.attribute(tag, key)? {
            None => Ok(None),
            Some(text) => {
                self.parse::<usize>(&text, &format!("{key} of the array {name:?}"), "a whole number").map(Some)
            }
        };
        // VTK writes 0 for 1.
        let components = whole("NumberOfComponents")?.unwrap_or(1).max(1);
        if components > MOST_COMPONENTS {
            return Err(
                self.wrong(format!("the array {name:?} has {components} components; the limit is {MOST_COMPONENTS}"))
            );
        }
        let tuples = whole("NumberOfTuples")?;
        // VTK's rule: an array with an offset is appended, and any other format than binary is text.
        let format = self.attribute(tag, "format")?;
        let place = match (self.attribute(tag, "offset")?, format.as_deref()) {
            (Some(offset), _) => {
                Place::Appended(self.parse(&offset, &format!("offset of the array {name:?}"), "a whole number")?)
            }
            (None, Some("appended")) => return Err(self.wrong(format!("the appended array {name:?} has no offset"))),
            (None, Some("binary")) => Place::Base64(at),
            (None, Some("ascii") | None) => Place::Text(at),
            (None, Some(other)) => {
                return Err(self.wrong(format!(
                    "the format of the array {name:?} must be ascii, binary or appended, not {other}"
                )));
            }
        };
        let active = self.scalars.as_ref() == Some(&name);
        Ok(Array { section, name, type_name, components, active, tuples, place })
    }

    /// Returns an attribute of a tag. Of the XML entities, only the predefined ones are resolved.
    fn attribute(&self, tag: &BytesStart<'_>, name: &str) -> Result<Option<String>, VolumeError> {
        // The check for repeated names takes quadratic time.
        for attribute in tag.attributes().with_checks(false) {
            let attribute = attribute.map_err(|error| self.wrong(format!("invalid tag: {error}")))?;
            if attribute.key.as_ref() == name {
                let value = attribute.normalized_value(XmlVersion::Implicit1_0);
                let value = value.map_err(|error| self.wrong(format!("invalid attribute {name}: {error}")))?;
                // Names are printed, and must not move the cursor.
                return Ok(Some(value.replace(char::is_control, " ")));
            }
        }
        Ok(None)
    }

    fn parse<T: FromStr>(&self, text: &str, name: &str, what: &str) -> Result<T, VolumeError> {
        text.trim().parse().map_err(|_| self.wrong(format!("{name} {} should be {what}", shortened(text))))
    }

    fn finish(self, length: u64, appended: Option<Appended>) -> Result<Header, VolumeError> {
        if appended.is_none() && self.depth > 0 {
            return Err(self.wrong("the file ends before all tags are closed".to_owned()));
        }
        let Some(FileTag { byte_order, wide, compressor }) = self.file else {
            return Err(self.wrong("the file has no <VTKFile> tag".to_owned()));
        };
        let Some(frame) = self.frame else {
            return Err(self.wrong("the file has no <ImageData> tag".to_owned()));
        };
        let (path, fields, pieces) = (self.path.to_owned(), self.fields, self.pieces);
        Ok(Header { path, length, byte_order, wide, compressor, frame, fields, pieces, appended })
    }
}

/// Quotes the beginning of a text from the file, for a message.
fn shortened(text: &str) -> String {
    let start: String = text.chars().take(60).collect();
    format!("{start:?}")
}
