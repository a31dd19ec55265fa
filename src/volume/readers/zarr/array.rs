//! Description of an array: shape, type, chunks and their coding, as far as it is read.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::node::{Description, Node, V2, V3, wrong};
use crate::readers::lengths::printable;
use crate::readers::type_string::{self, Kind};
use crate::{ByteOrder, VolumeError, VoxelType};

/// Largest number of bytes of a chunk, decoded.
const LARGEST_CHUNK: usize = 1 << 30;
/// Largest number of bytes of the index of a shard.
const LARGEST_INDEX: usize = 64 << 20;
/// Most axes of an array.
const MOST_AXES: usize = 8;

/// An array.
#[derive(Clone, Debug)]
pub(super) struct Array {
    /// Its folder.
    pub(super) path: PathBuf,
    /// File of its description, for messages.
    pub(super) file: PathBuf,
    /// Lengths of the axes, slowest first.
    pub(super) shape: Vec<usize>,
    /// Lengths of a chunk, which is one file.
    pub(super) chunks: Vec<usize>,
    pub(super) voxel_type: VoxelType,
    pub(super) kind: Kind,
    /// Value of voxels in chunks that are not there, in the byte order of this machine.
    pub(super) fill: Vec<u8>,
    pub(super) keys: Keys,
    pub(super) coding: Coding,
    /// The chunks inside a chunk, if it is a shard.
    pub(super) shard: Option<Shard>,
    /// Names of the axes, as far as they are stated.
    pub(super) names: Vec<Option<String>>,
}

/// Names of the files of chunks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Keys {
    /// Whether the name begins with `c`.
    is_prefixed: bool,
    separator: char,
}

impl Keys {
    /// The same names with the other separator.
    pub(super) fn with_other_separator(self) -> Self {
        Self { separator: if self.separator == '/' { '.' } else { '/' }, ..self }
    }

    pub(super) fn separator(self) -> char {
        self.separator
    }

    /// Name of the file of the chunk with these indices.
    pub(super) fn name(self, indices: &[usize]) -> String {
        let separator = self.separator.to_string();
        let mut parts: Vec<String> = indices.iter().map(ToString::to_string).collect();
        if self.is_prefixed {
            parts.insert(0, "c".to_owned());
        } else if parts.is_empty() {
            parts.push("0".to_owned());
        }
        parts.join(&separator)
    }
}

/// Coding of the numbers of a chunk, from numbers to bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Coding {
    /// Orders of axes into which the numbers are transposed, one after the other.
    pub(super) transposed: Vec<Vec<usize>>,
    pub(super) byte_order: ByteOrder,
    /// Compressions and checksums, one after the other.
    pub(super) packed: Vec<Packing>,
}

/// Compression or checksum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Blosc,
    Crc32c,
    Gzip,
    Zlib,
    Zstd,
}

impl Packing {
    /// Names in version 3 and identifiers in version 2.
    fn named(name: &str) -> Option<Self> {
        Some(match name.strip_prefix("numcodecs.").unwrap_or(name) {
            "blosc" => Self::Blosc,
            "crc32c" => Self::Crc32c,
            "gzip" => Self::Gzip,
            "zlib" => Self::Zlib,
            "zstd" => Self::Zstd,
            _ => return None,
        })
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Blosc => "blosc",
            Self::Crc32c => "crc32c",
            Self::Gzip => "gzip",
            Self::Zlib => "zlib",
            Self::Zstd => "zstd",
        }
    }
}

/// Chunks inside a chunk.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Shard {
    /// Lengths of an inner chunk.
    pub(super) chunks: Vec<usize>,
    pub(super) coding: Coding,
    pub(super) index_order: ByteOrder,
    pub(super) index_has_checksum: bool,
    pub(super) index_is_first: bool,
}

impl Array {
    /// The array that `node` describes.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Field`] if the node is a group, or for every part of the description that is not read.
    pub(super) fn of(node: &Node) -> Result<Self, VolumeError> {
        match &node.array {
            Some(Description::V2(description)) => Self::of_v2(node, description),
            Some(Description::V3(description)) => Self::of_v3(node, description),
            None => Err(wrong(&node.file, "metadata", "this is a group, not an array".to_owned())),
        }
    }

    fn of_v2(
        node: &Node,
        V2 { shape, chunks, dtype, compressor, fill_value, order, filters, dimension_separator, .. }: &V2,
    ) -> Result<Self, VolumeError> {
        let wrong = |place: &str, problem: String| wrong(&node.file, place, problem);
        let Some(name) = dtype.as_str() else {
            return Err(wrong("dtype", format!("{} is a structure; Relume reads numbers and booleans", shown(dtype))));
        };
        let Some((voxel_type, byte_order, kind)) = type_string::of(name) else {
            return Err(wrong(
                "dtype",
                format!(
                    "{} is none of the types that Relume reads: booleans, whole numbers of 1 to 8 bytes, floats of 2, 4 and 8",
                    shown(dtype)
                ),
            ));
        };
        if let Some(filter) = filters.iter().flatten().next() {
            let id = shown(filter.get("id").unwrap_or(filter));
            return Err(wrong("filters", format!("the filter {id}; Relume reads arrays without filters")));
        }
        let packed = match compressor {
            Value::Null => Vec::new(),
            given => {
                let id = given.get("id").and_then(Value::as_str).unwrap_or_default();
                vec![Packing::named(id).ok_or_else(|| wrong("compressor", unread(id)))?]
            }
        };
        let transposed = match order.as_deref() {
            Some("F") if shape.len() > 1 => vec![(0..shape.len()).rev().collect()],
            Some("F" | "C") | None => Vec::new(),
            Some(other) => return Err(wrong("order", format!("{:?} is not \"C\" or \"F\"", printable(other)))),
        };
        let separator = match dimension_separator.as_deref() {
            None | Some(".") => '.',
            Some("/") => '/',
            Some(other) => {
                return Err(wrong("dimension_separator", format!("{:?} is not \".\" or \"/\"", printable(other))));
            }
        };
        let names = node.attributes.get("_ARRAY_DIMENSIONS").and_then(Value::as_array);
        let names = names.into_iter().flatten().map(|name| name.as_str().map(str::to_owned)).collect();
        let array = Self {
            path: node.path.clone(),
            file: node.file.clone(),
            shape: shape.clone(),
            chunks: chunks.clone(),
            voxel_type,
            kind,
            fill: filled(voxel_type, kind, fill_value).ok_or_else(|| wrong("fill_value", unfit(fill_value, name)))?,
            keys: Keys { is_prefixed: false, separator },
            coding: Coding { transposed, byte_order, packed },
            shard: None,
            names,
        };
        array.checked()
    }

    fn of_v3(node: &Node, description: &V3) -> Result<Self, VolumeError> {
        let V3 {
            shape,
            data_type,
            chunk_grid,
            chunk_key_encoding,
            fill_value,
            codecs,
            dimension_names,
            storage_transformers,
            ..
        } = description;
        let wrong = |place: &str, problem: String| wrong(&node.file, place, problem);
        let (voxel_type, kind) = match data_type.as_str().unwrap_or_default() {
            "bool" => (VoxelType::U8, Kind::Boolean),
            "uint8" => (VoxelType::U8, Kind::Number),
            "int8" => (VoxelType::I8, Kind::Number),
            "uint16" => (VoxelType::U16, Kind::Number),
            "int16" => (VoxelType::I16, Kind::Number),
            "uint32" => (VoxelType::U32, Kind::Number),
            "int32" => (VoxelType::I32, Kind::Number),
            "uint64" => (VoxelType::U64, Kind::Number),
            "int64" => (VoxelType::I64, Kind::Number),
            "float16" => (VoxelType::U16, Kind::Half),
            "float32" => (VoxelType::F32, Kind::Number),
            "float64" => (VoxelType::F64, Kind::Number),
            _ => {
                return Err(wrong(
                    "data_type",
                    format!(
                        "{} is none of the types that Relume reads: bool, int8 to int64, uint8 to uint64, float16 to float64",
                        shown(data_type)
                    ),
                ));
            }
        };
        let (name, configuration) = named(chunk_grid);
        if name != "regular" {
            return Err(wrong("chunk_grid", format!("{:?}; Relume reads regular grids", printable(name))));
        }
        let chunks = lengths(configuration.get("chunk_shape"))
            .ok_or_else(|| wrong("chunk_grid", "chunk_shape is not a list of whole numbers".to_owned()))?;
        let (name, configuration) = named(chunk_key_encoding);
        let separator = configuration.get("separator").and_then(Value::as_str);
        let keys = match (name, separator) {
            ("default", None | Some("/")) => Keys { is_prefixed: true, separator: '/' },
            ("default", Some(".")) => Keys { is_prefixed: true, separator: '.' },
            ("v2", None | Some(".")) => Keys { is_prefixed: false, separator: '.' },
            ("v2", Some("/")) => Keys { is_prefixed: false, separator: '/' },
            _ => {
                return Err(wrong(
                    "chunk_key_encoding",
                    format!("{}; Relume reads \"default\" and \"v2\" with \"/\" or \".\"", shown(chunk_key_encoding)),
                ));
            }
        };
        if let Some(transformer) = storage_transformers.first() {
            return Err(wrong(
                "storage_transformers",
                format!("{}; Relume reads arrays without them", shown(transformer)),
            ));
        }
        let mut reading = Codecs { file: &node.file, axes: shape.len(), bytes: voxel_type.bytes() };
        let (coding, shard) = match codecs.iter().find(|codec| named(codec).0 == "sharding_indexed") {
            None => (reading.coding(codecs)?, None),
            Some(codec) if codecs.len() == 1 => {
                let shard = reading.shard(named(codec).1)?;
                (shard.coding.clone(), Some(shard))
            }
            Some(_) => {
                return Err(wrong("codecs", "sharding_indexed beside other codecs; Relume reads it alone".to_owned()));
            }
        };
        let array = Self {
            path: node.path.clone(),
            file: node.file.clone(),
            shape: shape.clone(),
            chunks,
            voxel_type,
            kind,
            fill: filled(voxel_type, kind, fill_value)
                .ok_or_else(|| wrong("fill_value", unfit(fill_value, data_type.as_str().unwrap_or_default())))?,
            keys,
            coding,
            shard,
            names: dimension_names.clone().unwrap_or_default(),
        };
        array.checked()
    }

    /// The array, if its lengths can be those of a volume. Nothing has been allocated by them.
    fn checked(self) -> Result<Self, VolumeError> {
        let Self { file, shape, chunks, .. } = &self;
        let wrong = |place: &str, problem: String| Err(wrong(file, place, problem));
        if shape.is_empty() || shape.len() > MOST_AXES {
            return wrong("shape", format!("{} axes; Relume reads 1 to {MOST_AXES}", shape.len()));
        }
        if shape.contains(&0) {
            return wrong("shape", format!("{shape:?}; every axis needs at least one entry"));
        }
        if chunks.len() != shape.len() || chunks.contains(&0) {
            return wrong(
                "chunks",
                format!("{chunks:?}, but the shape is {shape:?}; every axis needs a length of at least 1"),
            );
        }
        let bytes = |lengths: &[usize]| {
            lengths.iter().try_fold(self.voxel_type.bytes(), |bytes, &length| bytes.checked_mul(length))
        };
        let unit = self.shard.as_ref().map_or(chunks, |shard| &shard.chunks);
        if unit.len() != shape.len()
            || unit.contains(&0)
            || chunks.iter().zip(unit).any(|(outer, inner)| outer % inner != 0)
        {
            return wrong("codecs", format!("chunks of {unit:?} in a shard of {chunks:?}; they do not fill it"));
        }
        match bytes(unit) {
            Some(bytes) if bytes <= LARGEST_CHUNK => {}
            found => {
                let found = found.map_or("more than 2⁶⁴".to_owned(), |bytes| bytes.to_string());
                return wrong(
                    "chunks",
                    format!("{unit:?} are {found} bytes a chunk; Relume reads chunks of up to {LARGEST_CHUNK}"),
                );
            }
        }
        if self.shard.is_some() {
            let entries =
                chunks.iter().zip(unit).try_fold(16_usize, |all, (outer, inner)| all.checked_mul(outer / inner));
            if entries.is_none_or(|bytes| bytes > LARGEST_INDEX) {
                return wrong(
                    "codecs",
                    format!(
                        "chunks of {unit:?} in a shard of {chunks:?}; its index has more than {LARGEST_INDEX} bytes"
                    ),
                );
            }
        }
        Ok(self)
    }
}

/// Codecs of an array of version 3.
struct Codecs<'a> {
    file: &'a Path,
    axes: usize,
    /// Bytes of a number.
    bytes: usize,
}

impl Codecs<'_> {
    fn wrong(&self, problem: String) -> VolumeError {
        wrong(self.file, "codecs", problem)
    }

    /// The coding of a chunk: transpositions, `bytes`, compressions.
    fn coding(&self, codecs: &[Value]) -> Result<Coding, VolumeError> {
        let (mut transposed, mut byte_order, mut packed) = (Vec::new(), None, Vec::new());
        for codec in codecs {
            let (name, configuration) = named(codec);
            match name {
                "transpose" if byte_order.is_none() => {
                    let order = lengths(configuration.get("order"));
                    let is_sound = |order: &Vec<usize>| {
                        let mut sorted = order.clone();
                        sorted.sort_unstable();
                        sorted.into_iter().eq(0..self.axes)
                    };
                    let order = order.filter(is_sound);
                    transposed.push(order.ok_or_else(|| {
                        let given = shown(configuration.get("order").unwrap_or(&Value::Null));
                        self.wrong(format!("the order {given} of transpose is no permutation of {} axes", self.axes))
                    })?);
                }
                "bytes" if byte_order.is_none() => {
                    let endian = configuration.get("endian").and_then(Value::as_str);
                    byte_order = Some(match endian {
                        Some("little") => ByteOrder::Little,
                        Some("big") => ByteOrder::Big,
                        None if self.bytes == 1 => ByteOrder::Little,
                        other => return Err(self.wrong(format!("the codec bytes has the byte order {other:?}"))),
                    });
                }
                "sharding_indexed" => return Err(self.wrong("shards inside shards; Relume reads one level".to_owned())),
                name => match Packing::named(name) {
                    Some(packing) if byte_order.is_some() => packed.push(packing),
                    Some(_) => return Err(self.wrong(format!("{name} before the codec bytes"))),
                    None => return Err(self.wrong(unread(name))),
                },
            }
        }
        let byte_order = byte_order.ok_or_else(|| self.wrong("the codec bytes is missing".to_owned()))?;
        Ok(Coding { transposed, byte_order, packed })
    }

    fn shard(&mut self, configuration: &Value) -> Result<Shard, VolumeError> {
        let chunks = lengths(configuration.get("chunk_shape"))
            .ok_or_else(|| self.wrong("chunk_shape of sharding_indexed is not a list of whole numbers".to_owned()))?;
        let list = |key: &str| configuration.get(key).and_then(Value::as_array).map_or(&[][..], |list| list);
        let coding = self.coding(list("codecs"))?;
        let index = Codecs { bytes: 8, axes: self.axes + 1, file: self.file }.coding(list("index_codecs"))?;
        let index_has_checksum = match index.packed[..] {
            [] => false,
            [Packing::Crc32c] => true,
            _ => {
                return Err(self.wrong("the index of a shard is compressed; Relume reads bytes with crc32c".to_owned()));
            }
        };
        if !index.transposed.is_empty() {
            return Err(self.wrong("the index of a shard is transposed".to_owned()));
        }
        let index_is_first = match configuration.get("index_location").and_then(Value::as_str) {
            None | Some("end") => false,
            Some("start") => true,
            Some(other) => {
                return Err(self.wrong(format!("index_location is {:?}, not \"start\" or \"end\"", printable(other))));
            }
        };
        Ok(Shard { chunks, coding, index_order: index.byte_order, index_has_checksum, index_is_first })
    }
}

/// Name and configuration of an extension: an object of both, or a name.
fn named(value: &Value) -> (&str, &Value) {
    match value.as_str() {
        Some(name) => (name, &Value::Null),
        None => (
            value.get("name").and_then(Value::as_str).unwrap_or_default(),
            value.get("configuration").unwrap_or(&Value::Null),
        ),
    }
}

/// A list of whole numbers.
fn lengths(value: Option<&Value>) -> Option<Vec<usize>> {
    let list = value?.as_array()?;
    if list.len() > 2 * MOST_AXES {
        return None;
    }
    list.iter().map(|length| usize::try_from(length.as_u64()?).ok()).collect()
}

/// A value of the metadata in a message.
fn shown(value: &Value) -> String {
    printable(&value.to_string())
}

/// The sentence for a codec without a decoder.
fn unread(name: &str) -> String {
    format!("the codec {:?}; Relume reads blosc, gzip, zlib, zstd and crc32c", printable(name))
}

/// The sentence for a fill value of another type.
fn unfit(value: &Value, name: &str) -> String {
    format!("{} is no value of type {}", shown(value), printable(name))
}

/// Bytes of the fill value `value`, in the byte order of this machine; nothing stated is 0. `None` if it is no value of
/// the type.
fn filled(voxel_type: VoxelType, kind: Kind, value: &Value) -> Option<Vec<u8>> {
    if value.is_null() {
        return Some(vec![0; voxel_type.bytes()]);
    }
    let whole = || match value {
        Value::Bool(value) => Some(i128::from(*value)),
        Value::Number(number) => {
            let whole = number.as_i64().map(i128::from).or(number.as_u64().map(i128::from));
            // Some writers put 0.0 for whole numbers, too.
            whole.or_else(|| number.as_f64().filter(|&float| float == 0.0).map(|_| 0))
        }
        _ => None,
    };
    let hex = |digits: usize| {
        let text = value.as_str()?.strip_prefix("0x")?;
        (text.len() == digits).then(|| u64::from_str_radix(text, 16).ok()).flatten()
    };
    let float = || match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => Some(match text.as_str() {
            "NaN" => f64::NAN,
            "Infinity" => f64::INFINITY,
            "-Infinity" => f64::NEG_INFINITY,
            _ => return None,
        }),
        _ => None,
    };
    macro_rules! bytes {
        ($type:ty) => {
            <$type>::try_from(whole()?).ok()?.to_ne_bytes().to_vec()
        };
    }
    Some(match (voxel_type, kind) {
        (VoxelType::U16, Kind::Half) => match hex(4) {
            Some(bits) => u16::try_from(bits).ok()?.to_ne_bytes().to_vec(),
            None => half::f16::from_f64(float()?).to_bits().to_ne_bytes().to_vec(),
        },
        (VoxelType::F32, _) => match hex(8) {
            Some(bits) => u32::try_from(bits).ok()?.to_ne_bytes().to_vec(),
            #[expect(clippy::cast_possible_truncation, reason = "rounds to the type of the array")]
            None => (float()? as f32).to_ne_bytes().to_vec(),
        },
        (VoxelType::F64, _) => match hex(16) {
            Some(bits) => bits.to_ne_bytes().to_vec(),
            None => float()?.to_ne_bytes().to_vec(),
        },
        (VoxelType::U8, _) => bytes!(u8),
        (VoxelType::I8, _) => bytes!(i8),
        (VoxelType::U16, _) => bytes!(u16),
        (VoxelType::I16, _) => bytes!(i16),
        (VoxelType::U32, _) => bytes!(u32),
        (VoxelType::I32, _) => bytes!(i32),
        (VoxelType::U64, _) => bytes!(u64),
        (VoxelType::I64, _) => bytes!(i64),
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn fill_values_are_those_of_the_type() {
        let filled = |voxel_type, value: Value| filled(voxel_type, Kind::Number, &value);
        assert_eq!(filled(VoxelType::U16, json!(513)), Some(513_u16.to_ne_bytes().to_vec()));
        assert_eq!(filled(VoxelType::U16, json!(-1)), None);
        assert_eq!(filled(VoxelType::I16, json!(-1)), Some(vec![255, 255]));
        assert_eq!(filled(VoxelType::U64, json!(u64::MAX)), Some(vec![255; 8]));
        assert_eq!(filled(VoxelType::I32, Value::Null), Some(vec![0; 4]));
        assert_eq!(filled(VoxelType::F32, json!("-Infinity")), Some(f32::NEG_INFINITY.to_ne_bytes().to_vec()));
        assert_eq!(filled(VoxelType::F32, json!("0x7fc00001")), Some(0x7fc0_0001_u32.to_ne_bytes().to_vec()));
        assert_eq!(filled(VoxelType::F64, json!("one")), None);
        let half = super::filled(VoxelType::U16, Kind::Half, &json!(1.5));
        assert_eq!(half, Some(0x3e00_u16.to_ne_bytes().to_vec()));
    }

    #[test]
    fn chunks_have_the_names_of_both_versions() {
        let name = |is_prefixed, separator| Keys { is_prefixed, separator }.name(&[1, 20, 3]);
        assert_eq!(name(true, '/'), "c/1/20/3");
        assert_eq!(name(false, '.'), "1.20.3");
    }
}
