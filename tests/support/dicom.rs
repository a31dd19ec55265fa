//! DICOM files of a few pixels, for tests.

use std::io::Write as _;

pub const IMPLICIT: &str = "1.2.840.10008.1.2";
pub const EXPLICIT: &str = "1.2.840.10008.1.2.1";
pub const DEFLATED: &str = "1.2.840.10008.1.2.1.99";
pub const BIG: &str = "1.2.840.10008.1.2.2";
pub const RLE: &str = "1.2.840.10008.1.2.5";

/// A value of an element.
#[derive(Clone, Debug)]
pub enum Value {
    Text(String),
    /// Whole numbers of two bytes.
    Short(Vec<u16>),
    Long(Vec<u32>),
    Double(Vec<f64>),
    Bytes(Vec<u8>),
    Items(Vec<Elements>),
    /// Fragments of pixel data, the table of offsets first.
    Fragments(Vec<Vec<u8>>),
}

/// Elements of a data set or an item, sorted by their tags.
#[derive(Clone, Debug, Default)]
pub struct Elements(Vec<(u32, [u8; 2], Value)>);

impl Elements {
    pub fn with(mut self, tag: u32, vr: &str, value: Value) -> Self {
        self.set(tag, vr, value);
        self
    }

    pub fn text(self, tag: u32, vr: &str, text: &str) -> Self {
        self.with(tag, vr, Value::Text(text.to_owned()))
    }

    pub fn short(self, tag: u32, numbers: &[u16]) -> Self {
        self.with(tag, "US", Value::Short(numbers.to_vec()))
    }

    pub fn items(self, tag: u32, items: Vec<Self>) -> Self {
        self.with(tag, "SQ", Value::Items(items))
    }

    pub fn set(&mut self, tag: u32, vr: &str, value: Value) {
        self.0.retain(|(found, ..)| *found != tag);
        self.0.push((tag, vr.as_bytes().try_into().unwrap(), value));
        self.0.sort_by_key(|(tag, ..)| *tag);
    }

    pub fn without(mut self, tag: u32) -> Self {
        self.0.retain(|(found, ..)| *found != tag);
        self
    }

    /// The elements, explicit or implicit, in either byte order.
    pub fn bytes(&self, is_implicit: bool, is_big: bool) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (tag, vr, value) in &self.0 {
            write(&mut bytes, *tag, vr, value, is_implicit, is_big);
        }
        bytes
    }
}

fn short(number: u16, is_big: bool) -> [u8; 2] {
    if is_big { number.to_be_bytes() } else { number.to_le_bytes() }
}

fn long(number: u32, is_big: bool) -> [u8; 4] {
    if is_big { number.to_be_bytes() } else { number.to_le_bytes() }
}

fn tagged(bytes: &mut Vec<u8>, tag: u32, is_big: bool) {
    for half in [tag >> 16, tag & 0xffff] {
        bytes.extend(short(u16::try_from(half).unwrap(), is_big));
    }
}

fn write(bytes: &mut Vec<u8>, tag: u32, vr: &[u8; 2], value: &Value, is_implicit: bool, is_big: bool) {
    let mut inside = Vec::new();
    let mut is_defined = true;
    match value {
        Value::Text(text) => inside.extend(text.as_bytes()),
        Value::Short(numbers) => numbers.iter().for_each(|&number| inside.extend(short(number, is_big))),
        Value::Long(numbers) => numbers.iter().for_each(|&number| inside.extend(long(number, is_big))),
        Value::Double(numbers) => numbers.iter().for_each(|number| {
            inside.extend(if is_big { number.to_be_bytes() } else { number.to_le_bytes() });
        }),
        Value::Bytes(other) => inside.extend(other),
        Value::Items(items) => {
            for item in items {
                let item = item.bytes(is_implicit, is_big);
                tagged(&mut inside, 0xfffe_e000, is_big);
                inside.extend(long(u32::try_from(item.len()).unwrap(), is_big));
                inside.extend(item);
            }
        }
        Value::Fragments(fragments) => {
            is_defined = false;
            for fragment in fragments {
                tagged(&mut inside, 0xfffe_e000, is_big);
                inside.extend(long(u32::try_from(fragment.len()).unwrap(), is_big));
                inside.extend(fragment);
            }
            tagged(&mut inside, 0xfffe_e0dd, is_big);
            inside.extend([0; 4]);
        }
    }
    if inside.len() % 2 == 1 {
        inside.push(if matches!(value, Value::Bytes(_)) || vr == b"UI" { 0 } else { b' ' });
    }
    tagged(bytes, tag, is_big);
    let length = if is_defined { u32::try_from(inside.len()).unwrap() } else { u32::MAX };
    if is_implicit {
        bytes.extend(long(length, is_big));
    } else {
        bytes.extend(vr);
        if [b"OB", b"OW", b"OF", b"OD", b"OV", b"SQ", b"UN", b"UT"].contains(&vr) {
            bytes.extend([0; 2]);
            bytes.extend(long(length, is_big));
        } else {
            bytes.extend(short(u16::try_from(length).unwrap(), is_big));
        }
    }
    bytes.extend(inside);
}

/// A slice of 4 × 3 pixels of 16 bits, numbered from `first` on, `z` mm up: spacing 0.25 mm along a row and 0.5 mm along
/// a column.
pub fn slice(z: f64, first: u16) -> Elements {
    Elements::default()
        .text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.4")
        .text(0x0008_0060, "CS", "MR")
        .text(0x0008_103e, "LO", "made")
        .text(0x0018_0050, "DS", "2")
        .text(0x0020_000e, "UI", "1.2.3")
        .text(0x0020_0011, "IS", "5")
        .text(0x0020_0032, "DS", &format!("1\\2\\{z}"))
        .text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0")
        .short(0x0028_0002, &[1])
        .text(0x0028_0004, "CS", "MONOCHROME2")
        .short(0x0028_0010, &[3])
        .short(0x0028_0011, &[4])
        .text(0x0028_0030, "DS", "0.5\\0.25")
        .short(0x0028_0100, &[16])
        .short(0x0028_0101, &[16])
        .short(0x0028_0102, &[15])
        .short(0x0028_0103, &[0])
        .with(0x7fe0_0010, "OW", Value::Short((first..first + 12).collect()))
}

/// A file of `elements` in the transfer syntax `syntax`.
pub fn file(elements: &Elements, syntax: &str) -> Vec<u8> {
    let meta = Elements::default().text(0x0002_0010, "UI", syntax).bytes(false, false);
    let mut bytes = [vec![0; 128], b"DICM".to_vec(), meta].concat();
    let data = elements.bytes(syntax == IMPLICIT, syntax == BIG);
    if syntax == DEFLATED {
        let mut deflated = flate2::write::DeflateEncoder::new(bytes, flate2::Compression::best());
        deflated.write_all(&data).unwrap();
        return deflated.finish().unwrap();
    }
    bytes.extend(data);
    bytes
}

/// RLE of one frame: a segment for each plane of bytes, without any run.
pub fn rle(planes: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = vec![0; 64];
    bytes[..4].copy_from_slice(&u32::try_from(planes.len()).unwrap().to_le_bytes());
    for (index, plane) in planes.iter().enumerate() {
        let start = u32::try_from(bytes.len()).unwrap();
        bytes[4 + 4 * index..][..4].copy_from_slice(&start.to_le_bytes());
        for part in plane.chunks(128) {
            bytes.push(u8::try_from(part.len() - 1).unwrap());
            bytes.extend(part);
        }
    }
    bytes
}

/// Functional groups of a frame at `z` mm.
pub fn place(z: f64) -> Elements {
    Elements::default()
        .items(0x0020_9113, vec![Elements::default().text(0x0020_0032, "DS", &format!("1\\2\\{z}"))])
        .items(0x0020_9116, vec![Elements::default().text(0x0020_0037, "DS", "1\\0\\0\\0\\1\\0")])
        .items(0x0028_9110, vec![Elements::default().text(0x0018_0050, "DS", "2").text(0x0028_0030, "DS", "0.5\\0.25")])
}

/// Segmentation of 3 × 3 pixels a frame, of frames with a segment, a height in mm and the set pixels.
pub fn segmentation(kind: &str, frames: &[(u16, f64, [u8; 9])]) -> Elements {
    let groups = frames
        .iter()
        .map(|&(segment, z, _)| place(z).items(0x0062_000a, vec![Elements::default().short(0x0062_000b, &[segment])]));
    let segment = |(number, name): (u16, &str)| {
        Elements::default()
            .short(0x0062_0004, &[number])
            .text(0x0062_0005, "LO", name)
            .short(0x0062_000d, &[65535, 32896, 32896])
    };
    let numbers: Vec<u8> = frames.iter().flat_map(|(.., pixels)| *pixels).collect();
    // One bit a pixel, the first one in the lowest bit, without padding between frames.
    let packed = numbers.chunks(8).map(|bits| (0..bits.len()).map(|bit| (bits[bit] & 1) << bit).sum()).collect();
    let is_binary = kind == "BINARY";
    let bits = if is_binary { 1 } else { 8 };
    Elements::default()
        .text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.66.4")
        .text(0x0008_0060, "CS", "SEG")
        .short(0x0028_0002, &[1])
        .text(0x0028_0004, "CS", "MONOCHROME2")
        .text(0x0028_0008, "IS", &frames.len().to_string())
        .short(0x0028_0010, &[3])
        .short(0x0028_0011, &[3])
        .short(0x0028_0100, &[bits])
        .short(0x0028_0101, &[bits])
        .short(0x0028_0102, &[bits - 1])
        .short(0x0028_0103, &[0])
        .text(0x0062_0001, "CS", kind)
        .items(0x0062_0002, vec![segment((1, "liver")), segment((2, "spleen"))])
        .short(0x0062_000e, &[200])
        .items(0x5200_9230, groups.collect())
        .with(0x7fe0_0010, "OB", Value::Bytes(if is_binary { packed } else { numbers }))
}
