//! OME-XML, the description of OME-TIFF files: axes, units, names of channels, and which page is which plane.
//!
//! Elements and defaults follow the OME schema of June 2016, and the OME-TIFF specification
//! (<https://docs.openmicroscopy.org/ome-model/>).

use std::borrow::Cow;
use std::collections::HashMap;

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};

use super::directory::MOST_PAGES;
use super::stated::Stated;
use crate::presets::drawn_colour;
use crate::readers::lengths::{printable, unit};
use crate::several::Series;

/// Whether a description is OME-XML.
pub(super) fn recognises(description: &[u8]) -> bool {
    let start = description.trim_ascii_start();
    // A byte order mark may precede it.
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    start.starts_with(b"<") && start[..start.len().min(4096)].windows(4).any(|word| word == b"<OME" || word == b":OME")
}

/// Place of a run of planes. There may be a million, so that the numbers are small.
#[derive(Clone, Copy, Debug)]
struct Run {
    /// Index of the first page, or [`NONE`].
    page: u32,
    /// Place of the first plane: `z + SizeZ · (channel + SizeC · time)`.
    first: u32,
    /// Number of planes, or [`NONE`].
    planes: u32,
    /// Index among the named files, or [`NONE`].
    file: u32,
}

/// Largest depth of elements.
const DEEPEST: usize = 64;

/// A number that is not stated.
const NONE: u32 = u32::MAX;

/// The number, if it is stated.
fn stated(number: u32) -> Option<usize> {
    usize::try_from(number).ok().filter(|_| number != NONE)
}

/// File that a run of planes names.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Named {
    /// Name of the file; empty if it is not stated.
    pub(super) name: String,
    /// Its identifier.
    pub(super) uuid: String,
}

/// An image: one volume with channels and times.
#[derive(Clone, Debug, Default)]
pub(super) struct Image {
    pub(super) name: String,
    /// Voxels along x and y.
    pub(super) width: usize,
    pub(super) height: usize,
    /// Sizes along z, channel and time, samples of colours counted as channels; further properties.
    pub(super) stated: Stated,
    /// Axes of the planes, fastest first: 0 is z, 1 channel, 2 time.
    order: [usize; 3],
    runs: Vec<Run>,
}

/// The description of a file.
#[derive(Clone, Debug, Default)]
pub(super) struct Ome {
    pub(super) images: Vec<Image>,
    pub(super) files: Vec<Named>,
    /// Identifier of the file with the description.
    pub(super) uuid: String,
    /// The file with the description, if it is another one.
    metadata_file: Option<String>,
    /// Indices of the named files.
    indices: HashMap<String, u32>,
}

/// Page of a plane: index among the named files, or `None` for the file with the description; index of the page in it.
pub(super) type Plane = (Option<usize>, usize);

/// Name of the file that has the description of the planes, if the description `text` says that it is another one.
pub(super) fn metadata_file(text: &[u8]) -> Option<String> {
    // Descriptions of many planes are long.
    memchr::memmem::find(text, b"BinaryOnly")?;
    let mut ome = Ome::default();
    // The error is the mention of the file.
    ome.parse(text).err()?;
    ome.metadata_file.filter(|name| !name.is_empty())
}

impl Ome {
    /// Parses a description. The error is a sentence.
    pub(super) fn read(description: &[u8]) -> Result<Self, String> {
        let mut ome = Self::default();
        ome.parse(description)?;
        ome.images.retain(|image| image.width > 0);
        if ome.images.is_empty() { Err("it has no image".to_owned()) } else { Ok(ome) }
    }

    /// Whether planes are in other files than the one with the description.
    pub(super) fn names_files(&self) -> bool {
        self.files.iter().filter(|file| !file.name.is_empty()).count() > 1
    }

    fn parse(&mut self, description: &[u8]) -> Result<(), String> {
        let text: Cow<'_, str> = match std::str::from_utf8(description) {
            Ok(text) => text.into(),
            Err(_) => description.iter().map(|&byte| char::from(byte)).collect(),
        };
        let mut xml =
            Reader::from_str(text.trim_end_matches(['\0', ' ', '\n', '\r', '\t']).trim_start_matches('\u{feff}'));
        // Whether the text of a UUID element is next.
        let (mut uuid_of, mut depth) = (None, 0);
        loop {
            let event = xml.read_event().map_err(|error| format!("invalid XML: {error}"))?;
            match event {
                Event::Start(tag) => {
                    depth += 1;
                    if depth > DEEPEST {
                        return Err(format!("more than {DEEPEST} elements inside each other"));
                    }
                    uuid_of = self.open(&tag)?;
                }
                Event::Empty(tag) => drop(self.open(&tag)?),
                Event::End(_) => (uuid_of, depth) = (None, depth - 1),
                Event::Text(text) => {
                    let file = uuid_of.and_then(|file: u32| self.files.get_mut(usize::try_from(file).ok()?));
                    if let Some(file) = file {
                        text.trim().clone_into(&mut file.uuid);
                    }
                }
                Event::DocType(_) => return Err("it must not declare a document type".to_owned()),
                Event::Eof => return Ok(()),
                _ => {}
            }
        }
    }

    /// Interprets a tag. Returns the index of the file whose identifier is its content.
    fn open(&mut self, tag: &BytesStart<'_>) -> Result<Option<u32>, String> {
        match tag.local_name().as_ref() {
            "OME" => self.uuid = attribute(tag, "UUID")?.unwrap_or_default(),
            "BinaryOnly" => {
                let name = attribute(tag, "MetadataFile")?.unwrap_or_default();
                let file = printable(&name);
                self.metadata_file = Some(name);
                return Err(format!("the description of the planes is in the file {file:?}; open that file"));
            }
            "Image" => {
                let name = printable(&attribute(tag, "Name")?.unwrap_or_default());
                self.images.push(Image { name, ..Image::default() });
            }
            "Pixels" => {
                if let Some(image) = self.images.last_mut() {
                    image.pixels(tag)?;
                }
            }
            "Channel" => {
                let name = printable(&attribute(tag, "Name")?.unwrap_or_default());
                if let Some(image) = self.images.last_mut() {
                    image.channel(name, tag)?;
                }
            }
            "TiffData" => {
                if let Some(image) = self.images.last_mut() {
                    image.run(tag)?;
                }
            }
            "UUID" => {
                let name = attribute(tag, "FileName")?.unwrap_or_default();
                // Files without a name differ by their identifiers.
                let known = self.indices.get(&name).copied().filter(|_| !name.is_empty());
                let file = match known {
                    Some(file) => file,
                    None => {
                        let file = u32::try_from(self.files.len()).unwrap_or(u32::MAX);
                        self.indices.insert(name.clone(), file);
                        self.files.push(Named { name, uuid: String::new() });
                        file
                    }
                };
                if let Some(run) = self.images.last_mut().and_then(|image| image.runs.last_mut()) {
                    run.file = file;
                }
                return Ok(Some(file));
            }
            _ => {}
        }
        Ok(None)
    }
}

impl Image {
    fn pixels(&mut self, tag: &BytesStart<'_>) -> Result<(), String> {
        let size = |name: &str| match whole::<usize>(tag, name)? {
            Some(size) if size > 0 => Ok(size),
            Some(_) => Err(format!("{name} is 0")),
            None => Err(format!("{name} is missing")),
        };
        (self.width, self.height) = (size("SizeX")?, size("SizeY")?);
        self.stated.sizes = [size("SizeZ")?, size("SizeC")?, size("SizeT")?];
        let planes = self.stated.sizes.iter().try_fold(1_usize, |planes, &size| planes.checked_mul(size));
        if planes.is_none_or(|planes| planes > MOST_PAGES) {
            let [z, c, t] = self.stated.sizes;
            return Err(format!("{z} slices of {c} channels at {t} times are more than {MOST_PAGES} planes"));
        }
        let order = attribute(tag, "DimensionOrder")?.unwrap_or_else(|| "XYZCT".to_owned());
        self.order = match order.as_str() {
            "XYZCT" => [0, 1, 2],
            "XYZTC" => [0, 2, 1],
            "XYCZT" => [1, 0, 2],
            "XYCTZ" => [1, 2, 0],
            "XYTZC" => [2, 0, 1],
            "XYTCZ" => [2, 1, 0],
            other => return Err(format!("DimensionOrder is {:?}", printable(other))),
        };
        for (axis, letter) in ["X", "Y", "Z"].into_iter().enumerate() {
            let name = format!("PhysicalSize{letter}");
            let Some(length) = attribute(tag, &name)? else { continue };
            let Ok(length) = length.trim().parse::<f64>() else {
                return Err(format!("{name} is {:?}, not a number", printable(&length)));
            };
            let named = attribute(tag, &format!("{name}Unit"))?;
            self.stated.set_spacing(axis, length, unit(named.as_deref().unwrap_or("µm")));
        }
        Ok(())
    }

    fn channel(&mut self, name: String, tag: &BytesStart<'_>) -> Result<(), String> {
        let index = self.stated.names.len();
        if index < self.stated.sizes[1] {
            for (key, tag_name) in [("colour", "Color"), ("fluorophore", "Fluor"), ("emission", "EmissionWavelength")] {
                if let Some(value) = attribute(tag, tag_name)?
                    && index < 64
                {
                    let value = if key == "colour" { colour(&value) } else { Some(printable(&value)) };
                    if key == "colour" {
                        self.stated.colours.resize(index, None);
                        self.stated.colours.push(value.clone());
                    }
                    self.stated.metadata.extend(value.map(|value| (format!("{key} of channel {index}"), value)));
                }
            }
            // Without a colour, that of its emission.
            let stated = self.stated.colours.get(index).is_some_and(Option::is_some);
            let in_nm = attribute(tag, "EmissionWavelengthUnit")?.is_none_or(|unit| unit.trim() == "nm");
            if let Some(emission) = attribute(tag, "EmissionWavelength")?.filter(|_| in_nm && !stated && index < 64) {
                self.stated.colours.resize(index, None);
                self.stated.colours.push(emission.trim().parse().ok().and_then(drawn_colour));
            }
            // A colour is one channel with several samples.
            let samples = whole::<usize>(tag, "SamplesPerPixel")?.unwrap_or(1).clamp(1, self.stated.sizes[1] - index);
            self.stated.names.extend(std::iter::repeat_n(name, samples));
        }
        Ok(())
    }

    fn run(&mut self, tag: &BytesStart<'_>) -> Result<(), String> {
        let planes = self.stated.sizes.iter().product::<usize>();
        if self.runs.len() >= planes {
            return Err(format!("it has more elements TiffData than the {planes} planes of the image"));
        }
        let mut place = [0; 3];
        for (axis, name) in ["FirstZ", "FirstC", "FirstT"].into_iter().enumerate() {
            let (first, size) = (whole::<usize>(tag, name)?.unwrap_or(0), self.stated.sizes[axis]);
            if first >= size {
                return Err(format!("{name} of an element TiffData is {first}, but the size is {size}"));
            }
            place[axis] = first;
        }
        let [depth, channels, _] = self.stated.sizes;
        let first = u32::try_from(place[0] + depth * (place[1] + channels * place[2])).unwrap_or(NONE);
        let small = |name: &str| -> Result<u32, String> { Ok(whole(tag, name)?.unwrap_or(NONE)) };
        self.runs.push(Run { page: small("IFD")?, first, planes: small("PlaneCount")?, file: NONE });
        Ok(())
    }

    /// The image as one of several; `index` is its index.
    pub(super) fn series(&self, index: usize) -> Series {
        let [depth, channels, times] = self.stated.sizes;
        let colours = if channels > 1 { format!("({channels} channels)") } else { String::new() };
        let description = [self.name.as_str(), &colours].join(" ").trim().to_owned();
        Series { key: index.to_string(), description, dims: [self.width, self.height, depth], times }
    }

    /// The page of the first plane. The error is a sentence.
    pub(super) fn first(&self) -> Result<Plane, String> {
        match self.runs.iter().find(|run| run.first == 0) {
            Some(run) => Ok((stated(run.file), stated(run.page).unwrap_or(0))),
            None if self.runs.is_empty() => Ok((None, 0)),
            None => Err("no element TiffData has slice 0 of channel 0 at time 0".to_owned()),
        }
    }

    /// The pages of channel `channel` at time `time`, in order of z. A page has `samples` channels; `pages` is the number
    /// of pages of a file. The error is a sentence.
    pub(super) fn planes<E>(
        &self,
        [channel, time]: [usize; 2],
        samples: usize,
        mut pages: impl FnMut(Option<usize>) -> Result<usize, E>,
    ) -> Result<Result<Vec<Plane>, String>, E> {
        let [depth, channels, times] = self.stated.sizes;
        let sizes = [depth, channels / samples, times];
        let linear = |place: [usize; 3]| {
            let [a, b, c] = self.order;
            place[a] + sizes[a] * (place[b] + sizes[b] * place[c])
        };
        let wanted: Vec<usize> = (0..depth).map(|z| linear([z, channel, time])).collect();
        if self.runs.is_empty() {
            return Ok(Ok(wanted.into_iter().map(|place| (None, place)).collect()));
        }
        let name = |z: usize| format!("slice {z} of channel {channel} at time {time}");
        let mut found: Vec<[u32; 2]> = vec![[NONE; 2]; depth];
        for run in &self.runs {
            let first = stated(run.first).unwrap_or(0);
            let start = linear([first % depth, first / depth % channels / samples, first / depth / channels]);
            let there = match (stated(run.planes), stated(run.page)) {
                (Some(planes), _) => planes,
                (None, Some(_)) => 1,
                // All pages of the file.
                (None, None) if wanted.iter().any(|&place| place >= start) => pages(stated(run.file))?,
                (None, None) => 0,
            };
            let begin = wanted.partition_point(|&place| place < start);
            let end = wanted.partition_point(|&place| place < start.saturating_add(there));
            let page = stated(run.page).unwrap_or(0);
            for z in begin..end {
                let page = u32::try_from(page + wanted[z] - start).unwrap_or(NONE);
                let before = std::mem::replace(&mut found[z], [run.file, page]);
                if before[1] != NONE {
                    return Ok(Err(format!("two elements TiffData have {}", name(z))));
                }
            }
        }
        let planes: Option<Vec<Plane>> =
            found.iter().map(|&[file, page]| Some((stated(file), stated(page)?))).collect();
        Ok(planes.ok_or_else(|| {
            let z = found.iter().position(|plane| plane[1] == NONE).unwrap_or(0);
            format!("no element TiffData has {}", name(z))
        }))
    }
}

/// A colour as `#rrggbb`; the file has red, green, blue and alpha in a signed number.
fn colour(value: &str) -> Option<String> {
    let number = value.trim().parse::<i32>().ok()?;
    let [red, green, blue, _] = number.to_be_bytes();
    Some(format!("#{red:02x}{green:02x}{blue:02x}"))
}

/// An attribute of a tag. Of the XML entities, only the predefined ones are resolved.
fn attribute(tag: &BytesStart<'_>, name: &str) -> Result<Option<String>, String> {
    // The check for repeated names takes quadratic time.
    for attribute in tag.attributes().with_checks(false) {
        let attribute = attribute.map_err(|error| format!("invalid tag: {error}"))?;
        if attribute.key.as_ref() == name {
            let value = attribute.normalized_value(XmlVersion::Implicit1_0);
            return Ok(Some(value.map_err(|error| format!("invalid attribute {name}: {error}"))?.into_owned()));
        }
    }
    Ok(None)
}

fn whole<T: std::str::FromStr>(tag: &BytesStart<'_>, name: &str) -> Result<Option<T>, String> {
    let Some(value) = attribute(tag, name)? else { return Ok(None) };
    let number = value.trim().parse().map_err(|_| format!("{name} is {:?}, not a whole number", printable(&value)))?;
    Ok(Some(number))
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use super::*;

    fn image(order: &str, inside: &str) -> Image {
        let xml = format!(
            "<?xml version=\"1.0\"?><OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"2\" SizeC=\"3\" SizeT=\"4\" \
             DimensionOrder=\"{order}\">{inside}</Pixels></Image></OME>"
        );
        Ome::read(xml.as_bytes()).unwrap().images.remove(0)
    }

    fn planes(image: &Image, channel: usize, time: usize) -> Result<Vec<Plane>, String> {
        image.planes([channel, time], 1, |_| Ok::<_, ()>(24)).unwrap()
    }

    #[test]
    fn planes_follow_the_order_of_the_axes() {
        // z = 1, channel 2, time 3 of sizes 2, 3, 4: the place of z, of channel and of time in each order.
        for (order, place) in [
            ("XYZCT", 1 + 2 * 2 + 6 * 3),
            ("XYCZT", 2 + 3 + 6 * 3),
            ("XYTCZ", 3 + 4 * 2 + 12),
            ("XYCTZ", 2 + 3 * 3 + 12),
        ] {
            let found = planes(&image(order, ""), 2, 3).unwrap();
            assert_eq!(found[1], (None, place), "{order}");
            assert_eq!(planes(&image(order, "<TiffData/>"), 2, 3).unwrap(), found, "{order}: all pages in one element");
        }
    }

    #[test]
    fn planes_may_be_anywhere_but_must_be_named_once() {
        let runs = "<TiffData IFD=\"7\" FirstZ=\"1\" FirstC=\"1\"/><TiffData IFD=\"2\" FirstC=\"1\" PlaneCount=\"1\"/>";
        assert_eq!(planes(&image("XYZCT", runs), 1, 0).unwrap(), [(None, 2), (None, 7)]);
        let missing = planes(&image("XYZCT", runs), 2, 1).unwrap_err();
        assert!(missing.contains("no element TiffData has slice 0 of channel 2 at time 1"), "{missing}");
        let twice = planes(&image("XYZCT", "<TiffData IFD=\"0\"/><TiffData IFD=\"1\" PlaneCount=\"9\"/>"), 0, 0);
        assert!(twice.unwrap_err().contains("two elements"));
    }

    #[test]
    fn descriptions_that_declare_entities_or_too_much_are_refused() {
        for (xml, word) in [
            ("<!DOCTYPE OME [<!ENTITY a \"b\">]><OME/>", "document type"),
            (
                "<OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"2000000\" SizeC=\"1\" SizeT=\"1\"/></Image></OME>",
                "2000000 slices",
            ),
            (
                "<OME><Image><Pixels SizeX=\"4\" SizeY=\"0\" SizeZ=\"2\" SizeC=\"1\" SizeT=\"1\"/></Image></OME>",
                "SizeY is 0",
            ),
            ("<OME><Image><Pixels SizeX=\"a\"/></Image></OME>", "\"a\""),
            (
                "<OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"2\" SizeC=\"1\" SizeT=\"1\"><TiffData FirstZ=\"2\"/>",
                "FirstZ of an element TiffData is 2, but the size is 2",
            ),
            (
                "<OME><Image><Pixels SizeX=\"4\" SizeY=\"3\" SizeZ=\"1\" SizeC=\"1\" SizeT=\"1\"><TiffData/><TiffData/>",
                "more elements TiffData than the 1 planes",
            ),
            ("<OME></OME>", "no image"),
            ("<OME><BinaryOnly MetadataFile=\"a.companion.ome\"/></OME>", "a.companion.ome"),
            ("<OME><Image>", "no image"),
        ] {
            let error = Ome::read(xml.as_bytes()).unwrap_err();
            assert!(error.contains(word), "{error}");
        }
    }
}
