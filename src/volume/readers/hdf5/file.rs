//! Arrays of an HDF5 or `NetCDF` file with their attributes, through the crates `hdf5-reader` and `netcdf-reader`.

use std::collections::HashSet;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::links::{Links, Met};
use hdf5_reader::error::Error as Hdf5Error;
use hdf5_reader::group::Group;
use hdf5_reader::messages::filter_pipeline::FilterDescription;
use hdf5_reader::storage::DynStorage;
use hdf5_reader::{
    Attribute, ByteOrder as Hdf5Order, Dataset, Datatype, FileStorage, FilterRegistry, H5Type, Hdf5File, OpenOptions,
    SliceInfo, SliceInfoElem,
};
use netcdf_reader::{NcAttribute, NcFile, NcOpenOptions, NcReadable, NcSliceInfo, NcSliceInfoElem, NcType};

use crate::readers::guard::guarded;
use crate::readers::lengths::printable;
use crate::stream::{self, count};
use crate::voxels::with_type;
use crate::{VolumeError, Voxel, VoxelType};

/// Most arrays and groups that are listed.
const MOST: usize = 10_000;
/// Most groups inside each other.
const DEEPEST: usize = 32;
/// Largest number of bytes of a decoded chunk.
pub(super) const LARGEST_CHUNK: usize = 1 << 30;
/// Most numbers of an attribute.
const LONGEST: usize = 4096;
/// Number of the filter LZF of h5py.
const LZF: u16 = 32000;

/// An open file.
pub(super) struct File {
    pub(super) path: PathBuf,
    /// Its length in bytes.
    length: u64,
    contents: Contents,
    /// What its external links met.
    met: Arc<Met>,
}

enum Contents {
    /// The file with its external links, and without them.
    Hdf5(Hdf5File, Hdf5File),
    Classic(NcFile),
}

/// Kind of the numbers beside their type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Number,
    /// Floats of 16 bits, in `uint16`.
    Half,
    /// Numbers with names, such as booleans.
    Named,
}

/// An array of numbers.
pub(super) struct Array {
    /// Path from the root, with a slash at the beginning.
    pub(super) name: String,
    /// Lengths of the axes, slowest first.
    pub(super) shape: Vec<usize>,
    /// Type of the numbers; the attribute `_Unsigned` changes the sign of whole ones.
    pub(super) voxel_type: VoxelType,
    /// Type in which the file declares them, of the same size.
    declared: VoxelType,
    pub(super) kind: Kind,
    /// Lengths of a chunk; `None` if the numbers follow each other.
    pub(super) chunks: Option<Vec<usize>>,
    /// Names of the axes; empty if there are none.
    pub(super) dimensions: Vec<String>,
    pub(super) attributes: Attributes,
    /// `None` for a variable of `NetCDF`-3.
    dataset: Option<Dataset>,
}

/// Attributes of an array or a group.
#[derive(Clone, Debug, Default)]
pub(super) struct Attributes(Vec<(String, Value)>);

#[derive(Clone, Debug)]
enum Value {
    Numbers(Vec<f64>),
    Text(String),
}

impl Attributes {
    fn find(&self, name: &str) -> Option<&Value> {
        self.0.iter().find(|(key, _)| key == name).map(|(_, value)| value)
    }

    /// The numbers of an attribute; those in a text, too.
    pub(super) fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        match self.find(name)? {
            Value::Numbers(numbers) => Some(numbers.clone()),
            Value::Text(text) => text.split_whitespace().map(|word| word.parse().ok()).collect(),
        }
    }

    /// The finite number of an attribute.
    pub(super) fn number(&self, name: &str) -> Option<f64> {
        let numbers = self.numbers(name)?;
        numbers.first().copied().filter(|number| numbers.len() == 1 && number.is_finite())
    }

    pub(super) fn text(&self, name: &str) -> Option<&str> {
        match self.find(name)? {
            Value::Text(text) => Some(text),
            Value::Numbers(_) => None,
        }
    }

    pub(super) fn has(&self, name: &str) -> bool {
        self.find(name).is_some()
    }
}

/// Runs a function of the crates.
fn of_hdf5<T>(call: impl FnOnce() -> Result<T, Hdf5Error>) -> io::Result<T> {
    guarded(|| {
        call().map_err(|error| match error {
            Hdf5Error::UnsupportedFilter(_) => io::Error::new(io::ErrorKind::Unsupported, error.to_string()),
            error => io::Error::new(io::ErrorKind::InvalidData, printable(&error.to_string())),
        })
    })
}

fn of_netcdf<T>(call: impl FnOnce() -> Result<T, netcdf_reader::Error>) -> io::Result<T> {
    guarded(|| call().map_err(|error| io::Error::new(io::ErrorKind::InvalidData, printable(&error.to_string()))))
}

/// Filters of HDF5, with that of h5py.
fn filters() -> FilterRegistry {
    let mut filters = FilterRegistry::new();
    filters.register(
        LZF,
        Box::new(|filter: &FilterDescription, data: &[u8], _| {
            let most =
                filter.client_data.get(2).and_then(|&bytes| usize::try_from(bytes).ok()).unwrap_or(LARGEST_CHUNK);
            unpack_lzf(data, most.min(LARGEST_CHUNK))
                .ok_or_else(|| Hdf5Error::DecompressionError("damaged LZF data".to_owned()))
        }),
    );
    filters
}

/// Decodes LZF data (Lehmann, liblzf 3.6) of at most `most` bytes; `None` for damaged data.
fn unpack_lzf(mut data: &[u8], most: usize) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    while let Some((&head, rest)) = data.split_first() {
        data = rest;
        if head < 32 {
            let (literal, rest) = data.split_at_checked(usize::from(head) + 1)?;
            bytes.extend_from_slice(literal);
            data = rest;
        } else {
            let mut length = usize::from(head >> 5);
            if length == 7 {
                let (&more, rest) = data.split_first()?;
                (length, data) = (length + usize::from(more), rest);
            }
            let (&low, rest) = data.split_first()?;
            data = rest;
            let back = (usize::from(head & 0x1f) << 8 | usize::from(low)) + 1;
            let from = bytes.len().checked_sub(back)?;
            // The copy may reach into what it writes.
            for at in from..from + length + 2 {
                bytes.push(bytes[at]);
            }
        }
        if bytes.len() > most {
            return None;
        }
    }
    Some(bytes)
}

impl File {
    /// Opens the file `path`; its blocks are read on demand.
    pub(super) fn open(path: &Path) -> Result<Self, VolumeError> {
        let file = stream::open(path)?;
        let failed = |error: io::Error| VolumeError::Field {
            path: path.to_owned(),
            place: "header".to_owned(),
            problem: error.to_string(),
        };
        let length = file.metadata().map_err(|source| stream::failed(path, source))?.len();
        let storage: DynStorage = Arc::new(of_hdf5(|| FileStorage::from_file(file)).map_err(failed)?);
        let is_classic = of_hdf5(|| storage.read_range(0, 3)).is_ok_and(|magic| magic.as_ref() == b"CDF");
        let (links, met) = Links::of(path, options);
        let contents = if is_classic {
            Contents::Classic(
                of_netcdf(|| NcFile::from_storage_with_options(storage, options_of_netcdf())).map_err(failed)?,
            )
        } else {
            let open = |storage, options| of_hdf5(|| Hdf5File::from_storage_with_options(storage, options));
            let linked = open(Arc::clone(&storage), options().with_external_link_resolver(links)).map_err(failed)?;
            Contents::Hdf5(linked, open(storage, options()).map_err(failed)?)
        };
        Ok(Self { path: path.to_owned(), length, contents, met })
    }

    /// Bytes of the file, and of those that its external links led to.
    pub(super) fn length(&self) -> u64 {
        self.length.saturating_add(self.met.bytes())
    }

    /// The clause about the last external link whose file is not read, if there is one.
    pub(super) fn broken_link(&self) -> Option<String> {
        self.met.broken()
    }

    /// Whether the file is `NetCDF`-3.
    pub(super) fn is_classic(&self) -> bool {
        matches!(self.contents, Contents::Classic(_))
    }

    /// Attributes of a group; none if there is no such group.
    pub(super) fn group(&self, name: &str) -> Attributes {
        match &self.contents {
            Contents::Hdf5(file, _) => {
                let attributes = of_hdf5(|| file.group(name).and_then(|group| group.attributes()));
                attributes.map_or_else(|_| Attributes::default(), |attributes| of_attributes(&attributes))
            }
            Contents::Classic(_) => Attributes::default(),
        }
    }

    /// Whether the file has a group of this name.
    pub(super) fn has_group(&self, name: &str) -> bool {
        match &self.contents {
            Contents::Hdf5(file, _) => of_hdf5(|| file.group(name).map(drop)).is_ok(),
            Contents::Classic(_) => false,
        }
    }

    /// The array of this name, which may be that of a link.
    pub(super) fn array(&self, name: &str) -> Option<Array> {
        self.met.forget();
        match &self.contents {
            Contents::Hdf5(file, _) => of_dataset(name, of_hdf5(|| file.dataset(name)).ok()?),
            Contents::Classic(file) => {
                let name = name.trim_start_matches('/');
                of_netcdf(|| file.variable(name).map(of_variable)).ok()?
            }
        }
    }

    /// Attributes of the dataset of this name, which may be no array.
    pub(super) fn array_or_scalar(&self, name: &str) -> Option<Attributes> {
        let Contents::Hdf5(file, _) = &self.contents else { return None };
        of_hdf5(|| file.dataset(name).map(|dataset| of_attributes(&dataset.attributes()))).ok()
    }

    /// Shape and numbers of a dataset, which may be a scalar; `None` unless it has finite numbers, at most a million.
    pub(super) fn numbers_of(&self, name: &str) -> Option<(Vec<usize>, Vec<f64>)> {
        const MOST: usize = 1 << 20;
        let Contents::Hdf5(file, _) = &self.contents else { return None };
        let dataset = of_hdf5(|| file.dataset(name)).ok()?;
        let shape = lengths(dataset.shape())?;
        let (voxel_type, kind) = stored(dataset.dtype())?;
        let count = shape.iter().try_fold(1_usize, |count, &side| count.checked_mul(side))?;
        if kind != Kind::Number || count > MOST {
            return None;
        }
        let size = voxel_type.bytes();
        let values: Vec<f64> = with_type!(voxel_type, T => {
            let bytes = numbers::<T>(&dataset, &vec![0; shape.len()], &shape).ok()?;
            bytes.chunks_exact(size).map(|bytes| Voxel::to_f64(bytemuck::pod_read_unaligned::<T>(bytes))).collect()
        });
        (values.len() == count && values.iter().all(|value| value.is_finite())).then_some((shape, values))
    }

    /// All arrays of numbers, sorted by their names.
    pub(super) fn arrays(&self) -> Result<Vec<Array>, VolumeError> {
        let failed = |place: &str, error: io::Error| VolumeError::Field {
            path: self.path.clone(),
            place: place.to_owned(),
            problem: error.to_string(),
        };
        let mut arrays = match &self.contents {
            Contents::Classic(file) => {
                let variables = of_netcdf(|| Ok(file.variables()?.iter().take(MOST).filter_map(of_variable).collect()));
                variables.map_err(|error| failed("variables", error))?
            }
            Contents::Hdf5(file, plain) => {
                let root = of_hdf5(|| file.root_group()).map_err(|error| failed("group /", error))?;
                let listed = datasets(root, plain, &self.met);
                let mut arrays = listed.map_err(|(group, error)| failed(&format!("group {group}"), error))?;
                if arrays
                    .iter()
                    .any(|array| array.attributes.has("DIMENSION_LIST") || array.attributes.has("_Netcdf4Dimid"))
                {
                    self.name_dimensions(&mut arrays);
                }
                arrays
            }
        };
        arrays.sort_by(|one, other| one.name.cmp(&other.name));
        Ok(arrays)
    }

    /// Names the axes of the arrays of a `NetCDF`-4 file.
    fn name_dimensions(&self, arrays: &mut [Array]) {
        let Ok(file) = stream::open(&self.path) else { return };
        let opened = of_netcdf(|| {
            let storage: DynStorage = Arc::new(FileStorage::from_file(file).map_err(io::Error::other)?);
            NcFile::from_storage_with_options(storage, options_of_netcdf())
        });
        // A file that is not NetCDF has no names.
        let Ok(file) = opened else { return };
        for array in arrays {
            let name = array.name.trim_start_matches('/');
            let named = of_netcdf(|| {
                let dimensions = file.variable(name)?.dimensions();
                Ok(dimensions.iter().map(|dimension| dimension.name.clone()).collect::<Vec<_>>())
            });
            array.dimensions = named.ok().filter(|names| names.len() == array.shape.len()).unwrap_or_default();
        }
    }

    /// The numbers of a block of `array`, the last axis fastest, in the byte order of this machine. The block is inside the
    /// array.
    pub(super) fn block(&self, array: &Array, start: &[usize], lengths: &[usize]) -> io::Result<Vec<u8>> {
        let bytes = match (&array.dataset, array.kind) {
            (Some(dataset), Kind::Half | Kind::Named) => match array.voxel_type.bytes() {
                1 => numbers::<Bits<1>>(dataset, start, lengths),
                2 => numbers::<Bits<2>>(dataset, start, lengths),
                4 => numbers::<Bits<4>>(dataset, start, lengths),
                _ => numbers::<Bits<8>>(dataset, start, lengths),
            },
            _ => with_type!(array.declared, T => self.numbers::<T>(array, start, lengths)),
        }?;
        let expected = lengths.iter().product::<usize>().saturating_mul(array.voxel_type.bytes());
        if bytes.len() == expected {
            return Ok(bytes);
        }
        let problem = format!("{} bytes of numbers instead of {expected}", bytes.len());
        Err(io::Error::new(io::ErrorKind::InvalidData, problem))
    }

    fn numbers<T: Voxel + NcReadable>(&self, array: &Array, start: &[usize], lengths: &[usize]) -> io::Result<Vec<u8>> {
        match (&array.dataset, &self.contents) {
            (Some(dataset), _) => numbers::<T>(dataset, start, lengths),
            (None, Contents::Classic(file)) => {
                let one = |(&start, &length): (&usize, &usize)| {
                    let (start, end) = (count(start), count(start) + count(length));
                    NcSliceInfoElem::Slice { start, end, step: 1 }
                };
                let selection = NcSliceInfo { selections: start.iter().zip(lengths).map(one).collect() };
                let name = array.name.trim_start_matches('/');
                let read = of_netcdf(|| file.read_variable_slice::<T>(name, &selection))?;
                Ok(bytemuck::cast_slice(&read.iter().copied().collect::<Vec<T>>()).to_vec())
            }
            (None, Contents::Hdf5(..)) => Err(io::Error::other("the array is not in the file")),
        }
    }
}

/// The numbers of a block of a dataset.
fn numbers<T: H5Type + bytemuck::NoUninit>(
    dataset: &Dataset,
    start: &[usize],
    lengths: &[usize],
) -> io::Result<Vec<u8>> {
    let one = |(&start, &length): (&usize, &usize)| {
        let (start, end) = (count(start), count(start) + count(length));
        SliceInfoElem::Slice { start, end, step: 1 }
    };
    let selection = SliceInfo { selections: start.iter().zip(lengths).map(one).collect() };
    let read = of_hdf5(|| dataset.read_slice::<T>(&selection))?;
    match read.as_slice() {
        Some(numbers) => Ok(bytemuck::cast_slice(numbers).to_vec()),
        None => Err(io::Error::other("the numbers are not in order")),
    }
}

/// Limits of the crates: nothing is kept, and nothing larger than a chunk is allocated by a header.
fn options() -> OpenOptions {
    OpenOptions::default()
        .with_chunk_cache_bytes(0)
        .with_max_chunk_bytes(LARGEST_CHUNK)
        .with_max_read_bytes(LARGEST_CHUNK)
        .with_max_object_header_bytes(16 << 20)
        .with_filter_registry(filters())
}

fn options_of_netcdf() -> NcOpenOptions {
    NcOpenOptions {
        chunk_cache_bytes: 0,
        max_chunk_bytes: LARGEST_CHUNK,
        max_read_bytes: LARGEST_CHUNK,
        max_object_header_bytes: 16 << 20,
        ..NcOpenOptions::default()
    }
}

/// The arrays of numbers in a group and in its groups, among them those of external links, which `plain`, the same file, does
/// not follow. The error has the name of the group.
fn datasets(root: Group, plain: &Hdf5File, met: &Met) -> Result<Vec<Array>, (String, io::Error)> {
    // Addresses are those of a file.
    let file = |group: &Group| std::ptr::from_ref(group.storage()).cast::<()>().addr();
    let last = |name: &str| name.rsplit('/').next().unwrap_or_default().to_owned();
    let mut arrays = Vec::new();
    let mut seen = HashSet::from([(file(&root), root.address())]);
    let own = file(&root);
    let mut groups = vec![(root, String::new(), 0)];
    while let Some((group, name, depth)) = groups.pop() {
        let (is_own, before) = (file(&group) == own, met.links());
        let members = of_hdf5(|| group.members());
        let is_plain = members.is_ok() && met.links() == before;
        // What links lead to is in other files.
        let here = if is_own && !is_plain {
            let here = of_hdf5(|| if name.is_empty() { plain.root_group() } else { plain.group(&name) }?.members());
            Some(here.map_err(|error| (format!("{name}/"), error))?)
        } else {
            None
        };
        let names: Option<HashSet<String>> = here.as_ref().map(|(groups, datasets)| {
            groups.iter().map(|group| last(group.name())).chain(datasets.iter().map(|it| last(it.name()))).collect()
        });
        let (inner, datasets) = match (members, here) {
            (Ok(members), _) | (Err(_), Some(members)) => members,
            (Err(error), None) => return Err((format!("{name}/"), error)),
        };
        let is_linked = |own: &str| names.as_ref().is_some_and(|names| !names.contains(own));
        for dataset in datasets {
            let own = last(dataset.name());
            let is_new = is_linked(&own) || seen.insert((file(&group), dataset.address()));
            if arrays.len() < MOST && is_new {
                arrays.extend(of_dataset(&format!("{name}/{own}"), dataset));
            }
        }
        for group in inner {
            // Links may make circles.
            if depth < DEEPEST && seen.len() < MOST && seen.insert((file(&group), group.address())) {
                let name = format!("{name}/{}", last(group.name()));
                groups.push((group, name, depth + 1));
            }
        }
    }
    Ok(arrays)
}

/// The type of numbers declared as `declared` with these attributes: the convention of `NetCDF`-3, which has no unsigned
/// types, is the attribute `_Unsigned`.
fn signed_as(declared: VoxelType, attributes: &Attributes) -> VoxelType {
    let stated = attributes.text("_Unsigned").map(|text| text.trim().to_ascii_lowercase());
    match (stated.as_deref(), declared) {
        (Some("true"), VoxelType::I8) => VoxelType::U8,
        (Some("true"), VoxelType::I16) => VoxelType::U16,
        (Some("true"), VoxelType::I32) => VoxelType::U32,
        (Some("true"), VoxelType::I64) => VoxelType::U64,
        (Some("false"), VoxelType::U8) => VoxelType::I8,
        (Some("false"), VoxelType::U16) => VoxelType::I16,
        (Some("false"), VoxelType::U32) => VoxelType::I32,
        (Some("false"), VoxelType::U64) => VoxelType::I64,
        _ => declared,
    }
}

/// An array of a dataset; `None` unless it has numbers and at least one axis.
fn of_dataset(name: &str, dataset: Dataset) -> Option<Array> {
    let (voxel_type, kind) = stored(dataset.dtype())?;
    let shape: Vec<usize> = lengths(dataset.shape())?;
    let chunks = dataset.chunks().map(|chunks| chunks.into_iter().map(|side| side as usize).collect::<Vec<usize>>());
    let attributes =
        of_hdf5(|| Ok(dataset.attributes())).map(|attributes| of_attributes(&attributes)).unwrap_or_default();
    let declared = voxel_type;
    let voxel_type = if kind == Kind::Number { signed_as(declared, &attributes) } else { declared };
    (!shape.is_empty()).then(|| Array {
        name: format!("/{}", name.trim_start_matches('/')),
        declared,
        chunks: chunks.filter(|chunks| chunks.len() == shape.len() && !chunks.contains(&0)),
        shape,
        voxel_type,
        kind,
        dimensions: Vec::new(),
        attributes,
        dataset: Some(dataset),
    })
}

/// An array of a variable of `NetCDF`-3; `None` unless it has numbers and at least one axis.
fn of_variable(variable: &netcdf_reader::NcVariable) -> Option<Array> {
    let voxel_type = match variable.dtype() {
        NcType::Byte => VoxelType::I8,
        NcType::UByte => VoxelType::U8,
        NcType::Short => VoxelType::I16,
        NcType::UShort => VoxelType::U16,
        NcType::Int => VoxelType::I32,
        NcType::UInt => VoxelType::U32,
        NcType::Int64 => VoxelType::I64,
        NcType::UInt64 => VoxelType::U64,
        NcType::Float => VoxelType::F32,
        NcType::Double => VoxelType::F64,
        _ => return None,
    };
    let shape = lengths(&variable.shape())?;
    let one = |attribute: &NcAttribute| {
        let value = match (attribute.value.as_string(), attribute.value.as_f64_vec()) {
            (Some(text), _) => Value::Text(text),
            (None, Some(numbers)) if numbers.len() <= LONGEST => Value::Numbers(numbers),
            _ => return None,
        };
        Some((attribute.name.clone(), value))
    };
    let attributes = Attributes(variable.attributes().iter().filter_map(one).collect());
    let declared = voxel_type;
    let voxel_type = signed_as(declared, &attributes);
    (!shape.is_empty()).then(|| Array {
        name: format!("/{}", variable.name()),
        shape,
        voxel_type,
        declared,
        kind: Kind::Number,
        chunks: None,
        dimensions: variable.dimensions().iter().map(|dimension| dimension.name.clone()).collect(),
        attributes,
        dataset: None,
    })
}

fn lengths(shape: &[u64]) -> Option<Vec<usize>> {
    shape.iter().map(|&side| usize::try_from(side).ok()).collect()
}

/// Type of stored numbers; `None` for others.
fn stored(datatype: &Datatype) -> Option<(VoxelType, Kind)> {
    Some(match datatype {
        Datatype::FixedPoint { size, signed, .. } => {
            let voxel_type = match (size, signed) {
                (1, false) => VoxelType::U8,
                (1, true) => VoxelType::I8,
                (2, false) => VoxelType::U16,
                (2, true) => VoxelType::I16,
                (4, false) => VoxelType::U32,
                (4, true) => VoxelType::I32,
                (8, false) => VoxelType::U64,
                (8, true) => VoxelType::I64,
                _ => return None,
            };
            (voxel_type, Kind::Number)
        }
        Datatype::FloatingPoint { size: 2, .. } => (VoxelType::U16, Kind::Half),
        Datatype::FloatingPoint { size: 4, .. } => (VoxelType::F32, Kind::Number),
        Datatype::FloatingPoint { size: 8, .. } => (VoxelType::F64, Kind::Number),
        Datatype::Enum { base, members } => match stored(base)? {
            // Booleans of h5py are signed.
            (VoxelType::I8, Kind::Number) if members.iter().all(|member| matches!(member.value[..], [0 | 1])) => {
                (VoxelType::U8, Kind::Named)
            }
            (voxel_type, Kind::Number) => (voxel_type, Kind::Named),
            _ => return None,
        },
        _ => return None,
    })
}

/// The bits of a number whose type the crate does not convert.
#[derive(Clone, Copy, bytemuck::NoUninit)]
#[repr(transparent)]
struct Bits<const N: usize>([u8; N]);

impl<const N: usize> H5Type for Bits<N> {
    fn hdf5_type() -> Datatype {
        Datatype::Opaque { size: u32::try_from(N).unwrap_or(0), tag: String::new() }
    }

    fn from_bytes(bytes: &[u8], dtype: &Datatype) -> Result<Self, Hdf5Error> {
        let bits = bytes.get(..N).and_then(|bytes| <[u8; N]>::try_from(bytes).ok());
        let mut bits = bits.ok_or_else(|| Hdf5Error::InvalidData(format!("{} bytes for {N}", bytes.len())))?;
        let order = match dtype {
            Datatype::FloatingPoint { byte_order, .. } | Datatype::FixedPoint { byte_order, .. } => *byte_order,
            Datatype::Enum { base, .. } => match &**base {
                Datatype::FixedPoint { byte_order, .. } => *byte_order,
                _ => Hdf5Order::LittleEndian,
            },
            _ => Hdf5Order::LittleEndian,
        };
        if (order == Hdf5Order::BigEndian) != cfg!(target_endian = "big") {
            bits.reverse();
        }
        Ok(Self(bits))
    }

    fn element_size(_: &Datatype) -> usize {
        N
    }
}

/// Attributes with numbers and texts; others are left out.
fn of_attributes(attributes: &[Attribute]) -> Attributes {
    let one = |attribute: &Attribute| {
        let value =
            guarded(|| Ok(numbers_of(attribute).map(Value::Numbers).or_else(|| text_of(attribute).map(Value::Text))));
        Some((attribute.name.clone(), value.ok().flatten()?))
    };
    Attributes(attributes.iter().filter_map(one).collect())
}

fn numbers_of(attribute: &Attribute) -> Option<Vec<f64>> {
    if attribute.num_elements().ok()? > count(LONGEST) {
        return None;
    }
    let (voxel_type, kind) = stored(&attribute.datatype)?;
    if kind != Kind::Number {
        return None;
    }
    with_type!(voxel_type, T => Some(attribute.read_1d::<T>().ok()?.into_iter().map(Voxel::to_f64).collect()))
}

fn text_of(attribute: &Attribute) -> Option<String> {
    // Imaris stores every character by itself.
    let text = attribute.read_string().ok().filter(|_| attribute.num_elements().is_ok_and(|count| count == 1));
    let text = text.or_else(|| Some(attribute.read_strings().ok()?.concat()))?;
    (text.len() <= LONGEST).then(|| text.trim_end_matches(['\0', ' ']).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lzf_repeats_what_it_has_written() {
        // "abc", then 9 bytes from 3 back: the copy reaches into itself.
        assert_eq!(unpack_lzf(&[2, b'a', b'b', b'c', 0xe0, 0, 2], 12).as_deref(), Some(&b"abcabcabcabc"[..]));
        assert_eq!(unpack_lzf(&[2, b'a', b'b', b'c', 0xe0, 0, 2], 11), None, "too long");
        assert_eq!(unpack_lzf(&[2, b'a', b'b'], 12), None, "cut");
        assert_eq!(unpack_lzf(&[0, b'a', 0x20, 1], 12), None, "from before the beginning");
    }
}
