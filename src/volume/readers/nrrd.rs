//! NRRD, `.nrrd` and `.nhdr`: a header of `field: description` lines, with samples behind it or in other files.
//!
//! Fields and meanings follow the definition of the format (<http://teem.sourceforge.net/nrrd/format.html>), and ITK's
//! reader where the definition leaves a choice. No crate of the registry reads the format.
//!
//! The world is left-posterior-superior; volumes in the two other anatomical spaces are flipped to it. All other spaces
//! are kept unchanged, including left-handed ones. An origin is the centre of the first sample, whatever the centering.
//! Only `axis mins` and `axis maxs` are edges of samples: they lie half a spacing before the first and behind the last
//! centre, unless the centering is `node`.

use std::collections::HashMap;
use std::path::Path;

use glam::{DMat3, DVec3};

use super::fields::{Field, Fields, Lines};
use super::pattern::{self, Pattern};
use crate::data::{self, Data, DataFile};
use crate::layout::ByteOrder;
use crate::resample::Grid;
use crate::select::Pick;
use crate::stream::{Encoding, Skip, Start};
use crate::streamed::Streamed;
use crate::{LabelPreset, Selection, Unit, Volume, VolumeError, VoxelType};
use relume_base::number::count;
use relume_base::progress::Progress;

/// Whether the first bytes of a file identify an NRRD.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    beginning.starts_with(b"NRRD0")
}

/// Reads an NRRD.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    streamed(path, selection)?.read(&path.display().to_string(), selection, progress)
}

/// Reads the header of an NRRD.
pub(crate) fn streamed(path: &Path, selection: &Selection) -> Result<Streamed, VolumeError> {
    let header = Header::read(path)?;
    let source_name = path.display().to_string();
    let lengths = header.fields.axes(&key::DIMENSION, &key::SIZES)?;
    let axes = header.axes(&lengths)?;
    let grid = header.grid(&axes, selection.resample)?;
    data::check_size(&source_name, &lengths)?;
    selection.no_array(&source_name)?;
    // A missing axis has length 1, and an axis of length 1 needs no selection.
    let long = |role| (0..axes.len()).find(|&axis| axes[axis].role == role && axes[axis].length > 1);
    let length = |axis: Option<usize>| axis.map_or(1, |axis| lengths[axis]);
    let (component, time) = (long(Role::Component), long(Role::Time));
    let kind = component.map_or("", |axis| &axes[axis].kind);
    let chosen = [
        (component, selection.component(&source_name, length(component), kind)?),
        (time, selection.time(&source_name, length(time))?),
    ];
    let pick = |(axis, index): (Option<usize>, usize)| {
        let axis = axis?;
        Some(Pick { stride: lengths[..axis].iter().product(), length: lengths[axis], index })
    };
    let picks = chosen.into_iter().filter_map(pick).collect();
    let data = header.data(&lengths, picks)?;
    let mut files = data.paths();
    files.push(path.to_owned());
    let components = length(component);
    // A spatial axis without a direction is not anatomical.
    let directed = axes.iter().all(|axis| axis.role != Role::Space || axis.direction.is_some());
    let anatomical = directed && header.space()?.1.is_some();
    let unit = header.unit(&axes).0;
    let labels = segments(&header.pairs);
    let mut metadata = header.fields.uninterpreted(&key::ALL);
    metadata.extend(header.pairs);
    let repeated: Vec<String> = header.fields.repeated().collect();
    let dims = grid.dims();
    let finish = move |voxels, mut notes: Vec<String>| {
        let mut volume = grid.volume(&source_name, voxels, !labels.is_empty(), 1.0)?;
        (volume.files, volume.metadata) = (files, metadata);
        (volume.components, volume.anatomical, volume.unit) = (components, anatomical, unit);
        volume.presets.labels = labels;
        notes.extend(repeated);
        notes.append(&mut volume.notes);
        volume.notes = notes;
        Ok(volume)
    };
    Ok(Streamed { data, halves: false, dims, notes: Vec::new(), finish: Box::new(finish) })
}

/// The interpreted fields, in lower case and without white space, which readers ignore.
mod key {
    pub(crate) const DIMENSION: [&str; 1] = ["dimension"];
    pub(crate) const SIZES: [&str; 1] = ["sizes"];
    pub(crate) const TYPE: [&str; 1] = ["type"];
    pub(crate) const ENCODING: [&str; 1] = ["encoding"];
    pub(crate) const ENDIAN: [&str; 1] = ["endian"];
    pub(crate) const FILE: [&str; 1] = ["datafile"];
    pub(crate) const LINES: [&str; 1] = ["lineskip"];
    pub(crate) const BYTES: [&str; 1] = ["byteskip"];
    pub(crate) const SPACE: [&str; 1] = ["space"];
    pub(crate) const SPACE_DIMENSION: [&str; 1] = ["spacedimension"];
    pub(crate) const DIRECTIONS: [&str; 1] = ["spacedirections"];
    pub(crate) const ORIGIN: [&str; 1] = ["spaceorigin"];
    pub(crate) const SPACINGS: [&str; 1] = ["spacings"];
    pub(crate) const MINS: [&str; 1] = ["axismins"];
    pub(crate) const MAXS: [&str; 1] = ["axismaxs"];
    pub(crate) const CENTERINGS: [&str; 2] = ["centerings", "centers"];
    pub(crate) const KINDS: [&str; 1] = ["kinds"];

    pub(crate) const ALL: [&[&str]; 17] = [
        &DIMENSION,
        &SIZES,
        &TYPE,
        &ENCODING,
        &ENDIAN,
        &FILE,
        &LINES,
        &BYTES,
        &SPACE,
        &SPACE_DIMENSION,
        &DIRECTIONS,
        &ORIGIN,
        &SPACINGS,
        &MINS,
        &MAXS,
        &CENTERINGS,
        &KINDS,
    ];
}

/// Spaces: long name, short name, number of axes, and the signs that flip an anatomical space to
/// left-posterior-superior.
const SPACES: [(&str, &str, usize, Option<DVec3>); 12] = [
    ("right-anterior-superior", "ras", 3, Some(DVec3::new(-1.0, -1.0, 1.0))),
    ("left-anterior-superior", "las", 3, Some(DVec3::new(1.0, -1.0, 1.0))),
    ("left-posterior-superior", "lps", 3, Some(DVec3::ONE)),
    ("right-anterior-superior-time", "rast", 4, Some(DVec3::new(-1.0, -1.0, 1.0))),
    ("left-anterior-superior-time", "last", 4, Some(DVec3::new(1.0, -1.0, 1.0))),
    ("left-posterior-superior-time", "lpst", 4, Some(DVec3::ONE)),
    ("scanner-xyz", "scanner-xyz", 3, None),
    ("scanner-xyz-time", "scanner-xyz-time", 4, None),
    ("3d-right-handed", "3d-right-handed", 3, None),
    ("3d-right-handed-time", "3d-right-handed-time", 4, None),
    ("3d-left-handed", "3d-left-handed", 3, None),
    ("3d-left-handed-time", "3d-left-handed-time", 4, None),
];

/// Names of each sample type; `char` alone is excluded, because its signedness is unknown.
const TYPES: [(VoxelType, &[&str]); 10] = [
    (VoxelType::I8, &["signed char", "int8", "int8_t"]),
    (VoxelType::U8, &["uchar", "unsigned char", "uint8", "uint8_t"]),
    (VoxelType::I16, &["short", "short int", "signed short", "signed short int", "int16", "int16_t"]),
    (VoxelType::U16, &["ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"]),
    (VoxelType::I32, &["int", "signed int", "int32", "int32_t"]),
    (VoxelType::U32, &["uint", "unsigned int", "uint32", "uint32_t"]),
    (
        VoxelType::I64,
        &["longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"],
    ),
    (VoxelType::U64, &["ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"]),
    (VoxelType::F32, &["float"]),
    (VoxelType::F64, &["double"]),
];

/// The entries of a vector of the file; `None` for `none` and NaN.
type Vector = Option<Vec<f64>>;

/// Role of an axis of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Space,
    Time,
    Component,
}

struct Axis {
    length: usize,
    role: Role,
    kind: String,
    /// Vector from sample to sample in world units, if stated.
    direction: Vector,
}

struct Header<'a> {
    fields: Fields<'a>,
    /// Pairs `key:=value`, verbatim.
    pairs: Vec<(String, String)>,
    /// Lines after `data file: LIST`.
    list: Vec<String>,
    /// Bytes before the samples of an attached header.
    bytes: u64,
}

impl<'a> Header<'a> {
    /// Reads up to the blank line, the end of the file, or the end of the list of files.
    fn read(path: &'a Path) -> Result<Self, VolumeError> {
        let mut lines = Lines::of(path)?;
        let magic = lines.next()?.unwrap_or_default();
        if !matches!(magic.strip_prefix("NRRD000").and_then(|version| version.parse().ok()), Some(1..=9_u8)) {
            return Err(lines.wrong(&magic, "NRRD0001 or a later version"));
        }
        let mut header = Self {
            fields: Fields { path, sign: ": ", all: Vec::new() },
            pairs: Vec::new(),
            list: Vec::new(),
            bytes: 0,
        };
        while let Some(text) = lines.next()? {
            if text.is_empty() {
                break;
            }
            if text.starts_with('#') {
                continue;
            }
            let (key, value) = text.split_once(':').ok_or_else(|| lines.wrong(&text, "field: description"))?;
            if let Some(value) = value.strip_prefix('=') {
                header.pairs.push((key.to_owned(), value.to_owned()));
                continue;
            }
            let name: String = key.split_whitespace().collect::<String>().to_ascii_lowercase();
            // Fields that are not interpreted keep their spelling.
            let known = key::ALL.iter().any(|names| names.contains(&name.as_str()));
            let key = if known { name } else { key.trim().to_owned() };
            let field = Field { line: lines.number, key, value: value.trim().to_owned() };
            let list = field.key == key::FILE[0] && field.value.split_whitespace().next() == Some("LIST");
            header.fields.all.push(field);
            if list {
                header.list = lines.list()?;
                return Ok(header);
            }
        }
        header.bytes = lines.bytes();
        Ok(header)
    }

    fn source(&self) -> String {
        self.fields.path.display().to_string()
    }

    /// Returns one word per axis of an optional field, in lower case.
    fn words(&self, names: &[&str], axes: usize) -> Result<Option<Vec<String>>, VolumeError> {
        let Some(field) = self.fields.find(names) else { return Ok(None) };
        let words: Vec<String> = field.value.split_whitespace().map(str::to_ascii_lowercase).collect();
        if words.len() == axes {
            return Ok(Some(words));
        }
        Err(self.count(field, words.len(), axes))
    }

    /// Returns one number per axis; NaN and a missing field give `None`.
    fn numbers(&self, names: &[&str], axes: usize) -> Result<Vec<Option<f64>>, VolumeError> {
        let Some(field) = self.fields.find(names) else { return Ok(vec![None; axes]) };
        let numbers: Vec<f64> = self.fields.numbers(field, "numbers")?;
        if numbers.len() == axes {
            return Ok(numbers.into_iter().map(|number| (!number.is_nan()).then_some(number)).collect());
        }
        Err(self.count(field, numbers.len(), axes))
    }

    fn count(&self, field: &Field, there: usize, wanted: usize) -> VolumeError {
        self.fields.wrong(field, format!("{} has {there} entries, but {wanted} are required", field.key))
    }

    /// Returns the vectors of an optional field: each is `(x,y,z)`, all of one length, or `none`. A vector with NaN
    /// counts as `none`.
    fn vectors(&self, names: &[&str]) -> Result<Option<(&Field, Vec<Vector>)>, VolumeError> {
        let Some(field) = self.fields.find(names) else { return Ok(None) };
        let wrong = || self.fields.should_be(field, "vectors like (1,0,0), or none");
        let mut vectors = Vec::new();
        let mut rest = field.value.trim_start();
        while !rest.is_empty() {
            let after = if let Some(opened) = rest.strip_prefix('(') {
                let (inside, after) = opened.split_once(')').ok_or_else(wrong)?;
                let numbers: Result<Vec<f64>, _> = inside.split(',').map(|number| number.trim().parse()).collect();
                let numbers = numbers.map_err(|_| wrong())?;
                vectors.push((!numbers.iter().any(|number| number.is_nan())).then_some(numbers));
                after
            } else {
                let (word, after) = rest.split_at(rest.find(char::is_whitespace).unwrap_or(rest.len()));
                if !word.eq_ignore_ascii_case("none") {
                    return Err(wrong());
                }
                vectors.push(None);
                after
            };
            rest = after.trim_start();
        }
        let dimension = self.space()?.0;
        let wanted = dimension.or_else(|| vectors.iter().flatten().map(Vec::len).next());
        match vectors.iter().flatten().find(|vector| Some(vector.len()) != wanted || !(1..=4).contains(&vector.len())) {
            None => Ok(Some((field, vectors))),
            Some(vector) => Err(self.fields.wrong(
                field,
                format!("a vector has {} numbers, but the space has {} axes", vector.len(), wanted.unwrap_or_default()),
            )),
        }
    }

    /// Returns the number of axes of the space, if stated, and the signs that flip it to left-posterior-superior, if it
    /// is anatomical.
    fn space(&self) -> Result<(Option<usize>, Option<DVec3>), VolumeError> {
        let Some(field) = self.fields.find(&key::SPACE) else {
            return Ok((self.fields.number(&key::SPACE_DIMENSION, "a whole number")?, None));
        };
        let name = field.value.to_ascii_lowercase();
        match SPACES.iter().find(|(long, short, ..)| *long == name || *short == name) {
            Some(&(_, _, dimension, turn)) => Ok((Some(dimension), turn)),
            None => {
                let known = SPACES.map(|(long, ..)| long).join(", ");
                Err(self.fields.should_be(field, &format!("one of {known}")))
            }
        }
    }

    /// Returns all axes, fastest first: at most three spatial axes, and at most one time axis and one component axis
    /// longer than 1.
    fn axes(&self, lengths: &[usize]) -> Result<Vec<Axis>, VolumeError> {
        let count = lengths.len();
        let kinds = self.words(&key::KINDS, count)?.unwrap_or_else(|| vec![String::new(); count]);
        let directions = match self.vectors(&key::DIRECTIONS)? {
            Some((_, vectors)) if vectors.len() == count => Some(vectors),
            Some((field, vectors)) => return Err(self.count(field, vectors.len(), count)),
            None => None,
        };
        let no_space = self.no_space(count)?;
        let mut spatial = 0;
        let mut axes = Vec::new();
        for (index, (&length, kind)) in lengths.iter().zip(kinds).enumerate() {
            let direction = directions.as_ref().map(|vectors| vectors[index].clone());
            let unstated = matches!(kind.as_str(), "" | "???" | "none");
            let role = match (kind.as_str(), &direction) {
                ("time", _) => Role::Time,
                // The fourth axis of a four-dimensional space is time.
                (_, Some(Some(vector))) if vector.len() == 4 && vector[..3].iter().all(|&entry| entry == 0.0) => {
                    Role::Time
                }
                ("domain" | "space", Some(None)) => Role::Time,
                _ if unstated && direction == Some(None) => Role::Component,
                _ if unstated && no_space[index] => Role::Component,
                ("domain" | "space", _) => Role::Space,
                _ if unstated => Role::Space,
                _ => Role::Component,
            };
            let role = if role == Role::Space && spatial == 3 { Role::Time } else { role };
            spatial += usize::from(role == Role::Space);
            let kind = if unstated { String::new() } else { kind };
            axes.push(Axis { length, role, kind, direction: direction.flatten() });
        }
        let several = |role| axes.iter().filter(|axis| axis.role == role && axis.length > 1).count() > 1;
        if several(Role::Time) || several(Role::Component) {
            let dims: Vec<String> = lengths.iter().map(ToString::to_string).collect();
            return Err(VolumeError::TooManyAxes { source_name: self.source(), dims: dims.join("×") });
        }
        Ok(axes)
    }

    /// Whether each of more than three axes is no axis of space, because its spacing, or else its end, is NaN and that of an axis
    /// behind it is a number. An axis behind all numbers, and one of three, may be one whose spacing is unknown.
    fn no_space(&self, count: usize) -> Result<Vec<bool>, VolumeError> {
        let fields = [&key::SPACINGS, &key::MINS, &key::MAXS];
        let stated = fields.into_iter().find(|names| self.fields.find(*names).is_some());
        let numbers = stated.map_or_else(|| Ok(Vec::new()), |names| self.numbers(names, count))?;
        let last = numbers.iter().rposition(Option::is_some).unwrap_or(0);
        Ok((0..count).map(|axis| count > 3 && axis < last && numbers.get(axis).is_some_and(Option::is_none)).collect())
    }

    /// The unit of the world, and the factors of the spacings and ends of the spatial axes to it. Units of the world's axes are
    /// used if they are all the same, and those of the file's axes if all of them are lengths.
    fn unit(&self, axes: &[Axis]) -> (Option<Unit>, [f64; 3]) {
        let one = [1.0; 3];
        let words = |field: &Field| -> Vec<String> {
            let inside =
                field.value.split('"').skip(1).step_by(2).map(|word| word.trim().to_owned()).collect::<Vec<_>>();
            let bare = || field.value.split_whitespace().map(str::to_owned).collect();
            if field.value.contains('"') { inside } else { bare() }
        };
        if let Some(field) = self.fields.find(&["space units", "spaceunits"]) {
            let words = words(field);
            let mut units = words.iter().filter(|word| !word.is_empty()).map(|word| Unit::named(word));
            let first = units.next().flatten();
            return (first.filter(|first| units.all(|unit| unit == Some(*first))), one);
        }
        let Some(words) = self.fields.find(&["units"]).map(words).filter(|words| words.len() == axes.len()) else {
            return (None, one);
        };
        let spatial = (0..axes.len()).filter(|&axis| axes[axis].role == Role::Space);
        // Directions have the units of the world.
        let is_own = axes.iter().all(|axis| axis.direction.is_none());
        let units: Option<Vec<_>> = spatial.map(|axis| super::lengths::unit(&words[axis])).filter(|_| is_own).collect();
        match units.as_deref() {
            Some(units @ [(first, _), ..]) => {
                let factor =
                    |axis: usize| units.get(axis).map_or(1.0, |&unit| super::lengths::converted(1.0, unit, *first));
                (Some(*first), [0, 1, 2].map(factor))
            }
            _ => (None, one),
        }
    }

    fn grid(&self, axes: &[Axis], resample: bool) -> Result<Grid, VolumeError> {
        let spatial: Vec<usize> = (0..axes.len()).filter(|&axis| axes[axis].role == Role::Space).collect();
        let turn = self.space()?.1.unwrap_or(DVec3::ONE);
        let mut dims = [1; 3];
        let mut spacing = DVec3::ONE;
        let mut origin = DVec3::ZERO;
        let mut direction = DMat3::IDENTITY;
        let spacings = self.numbers(&key::SPACINGS, axes.len())?;
        let mins = self.numbers(&key::MINS, axes.len())?;
        let maxs = self.numbers(&key::MAXS, axes.len())?;
        let centerings = self.words(&key::CENTERINGS, axes.len())?;
        let is_node = |axis: usize| centerings.as_ref().is_some_and(|words| words[axis] == "node");
        let factors = self.unit(axes).1;
        // The step between samples: stated, or else by the ends of the axis, which may run backwards.
        let step = |axis: usize| {
            let by_ends = || {
                let steps = axes[axis].length.checked_sub(usize::from(is_node(axis))).filter(|&steps| steps > 0)?;
                let step = (maxs[axis]? - mins[axis]?) / count(steps);
                (step != 0.0 && step.is_finite()).then_some(step)
            };
            spacings[axis].or_else(by_ends)
        };
        let mut oriented = 0;
        for (i, &axis) in spatial.iter().enumerate() {
            dims[i] = axes[axis].length;
            if let Some(vector) = &axes[axis].direction {
                let world = three(vector) * turn;
                spacing[i] = world.length();
                *direction.col_mut(i) = world / spacing[i];
                oriented += 1;
            } else if let Some(step) = step(axis) {
                spacing[i] = step * factors[i];
                if spacings[axis].is_none() && step < 0.0 {
                    spacing[i] = -spacing[i];
                    *direction.col_mut(i) = -direction.col(i);
                }
            }
        }
        // A slice or a line may have any orientation; the missing axes are orthogonal to it.
        let first = spatial.first().and_then(|&axis| axes[axis].direction.as_ref());
        if first.is_some_and(|vector| vector.len() >= 3) && oriented == spatial.len() {
            let DMat3 { x_axis, y_axis, .. } = direction;
            if oriented == 1 {
                (direction.y_axis, direction.z_axis) = x_axis.any_orthonormal_pair();
            } else if oriented == 2 {
                direction.z_axis = x_axis.cross(y_axis).normalize();
            }
        }
        match self.vectors(&key::ORIGIN)? {
            Some((_, vectors)) if vectors.len() == 1 => {
                origin = vectors[0].as_deref().map_or(DVec3::ZERO, |vector| three(vector) * turn);
            }
            Some((field, vectors)) => return Err(self.count(field, vectors.len(), 1)),
            None => {
                let edges = |axis: usize| Some((mins[axis]?, step(axis)?));
                if spatial.iter().all(|&axis| edges(axis).is_some()) {
                    for (i, &axis) in spatial.iter().enumerate() {
                        let (min, step) = edges(axis).unwrap_or_default();
                        origin[i] = factors[i] * if is_node(axis) { min } else { min + step / 2.0 };
                    }
                }
            }
        }
        Grid::placed(&self.source(), (dims, spacing), (origin, direction), resample)
    }

    fn voxel_type(&self) -> Result<VoxelType, VolumeError> {
        let field = self.fields.require(&key::TYPE)?;
        let name = field.value.to_ascii_lowercase();
        let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
        if name == "block" {
            return Err(self
                .fields
                .wrong(field, "type: block is not a number type; the file does not state the meaning of its bytes"));
        }
        let found = TYPES.iter().find(|(_, names)| names.contains(&name.as_str()));
        found.map(|&(voxel_type, _)| voxel_type).ok_or_else(|| {
            let known = TYPES.map(|(_, names)| names.join(", ")).join(", ");
            self.fields.should_be(field, &format!("one of {known}"))
        })
    }

    fn data(&self, lengths: &[usize], picks: Vec<Pick>) -> Result<Data, VolumeError> {
        let voxel_type = self.voxel_type()?;
        let field = self.fields.require(&key::ENCODING)?;
        let encoding = match field.value.to_ascii_lowercase().as_str() {
            "raw" => Encoding::Raw,
            "gz" | "gzip" => Encoding::Gzip,
            "bz2" | "bzip2" => Encoding::Bzip2,
            "txt" | "text" | "ascii" => Encoding::Text,
            "hex" => Encoding::Hex,
            _ => return Err(self.fields.should_be(field, "one of raw, gzip, gz, bzip2, bz2, ascii, text, txt, hex")),
        };
        let byte_order = match self.fields.find(&key::ENDIAN) {
            Some(field) => match field.value.to_ascii_lowercase().as_str() {
                "little" => ByteOrder::Little,
                "big" => ByteOrder::Big,
                _ => return Err(self.fields.should_be(field, "little or big")),
            },
            None if voxel_type.bytes() == 1 || encoding == Encoding::Text => ByteOrder::NATIVE,
            None => return Err(VolumeError::MissingKey { path: self.fields.path.to_owned(), key: key::ENDIAN[0] }),
        };
        let lines = self.fields.number::<u64>(&key::LINES, "a whole number")?.unwrap_or(0);
        let skip = match (self.fields.number::<i64>(&key::BYTES, "a whole number")?, self.fields.find(&key::BYTES)) {
            (Some(-1), Some(field)) if matches!(encoding, Encoding::Text | Encoding::Hex) => {
                return Err(self.fields.wrong(field, "byte skip: -1 is not defined for samples written as text"));
            }
            (Some(-1), _) => Skip::Tail,
            (Some(bytes), Some(field)) => Skip::Bytes(u64::try_from(bytes).map_err(|_| {
                self.fields.should_be(field, "a number of bytes, or -1 if the samples are the end of the data")
            })?),
            _ => Skip::Bytes(0),
        };
        let files = match self.fields.find(&key::FILE) {
            None => vec![DataFile { path: self.fields.path.to_owned(), numbers: lengths.iter().product() }],
            Some(field) => self.files(field, lengths)?,
        };
        let start = Start { at: self.fields.find(&key::FILE).map_or(self.bytes, |_| 0), lines, skip };
        Ok(Data { files, start, encoding, voxel_type, byte_order, picks, alone: true })
    }

    /// Returns the files that `data file` names: one file, `LIST [axes]`, or `pattern first last step [axes]`.
    fn files(&self, field: &Field, lengths: &[usize]) -> Result<Vec<DataFile>, VolumeError> {
        let path = |name: &str| data::beside(self.fields.path, name);
        let words: Vec<&str> = field.value.split_whitespace().collect();
        let integer = |word: &&str| word.parse::<i64>().ok();
        if words.first() == Some(&"LIST") {
            let numbers = self.in_each(field, words.get(1).copied(), self.list.len(), lengths)?;
            return self.list.iter().map(|name| Ok(DataFile { path: path(name)?, numbers })).collect();
        }
        let trailing = words.iter().rev().map_while(integer).count();
        let name = words[..words.len() - trailing.min(4)].join(" ");
        if trailing < 3 || !name.contains('%') || data::existing(self.fields.path, &field.value).is_some() {
            return Ok(vec![DataFile { path: path(&field.value)?, numbers: lengths.iter().product() }]);
        }
        let given: Vec<i64> = words[words.len() - trailing.min(4)..].iter().filter_map(integer).collect();
        let range = [given[0], given[1], given[2]];
        let count = pattern::count(range);
        let axes = words.get(words.len() - trailing.min(4) + 3).copied();
        let numbers = self.in_each(field, axes, count, lengths)?;
        let pattern = Pattern::parse(&name).map_err(|problem| self.fields.wrong(field, pattern::no_file(&problem)))?;
        let names = pattern::numbers(range, count).map_err(|problem| self.fields.wrong(field, problem))?;
        names.map(|number| DataFile::found(path(&pattern.name(number))?, numbers)).collect()
    }

    /// Returns the count of numbers in each of `files` files, which hold `stated` axes each; default: all axes but the
    /// slowest.
    fn in_each(
        &self,
        field: &Field,
        stated: Option<&str>,
        files: usize,
        lengths: &[usize],
    ) -> Result<usize, VolumeError> {
        let all = lengths.len();
        let axes = match stated {
            None => all - 1,
            Some(word) => word.parse().ok().filter(|axes| (1..=all).contains(axes)).ok_or_else(|| {
                self.fields.wrong(field, format!("each file should have 1 to {all} axes, not {word}"))
            })?,
        };
        let slowest = lengths.last().copied().unwrap_or(1);
        // Files with all axes are slabs of equal thickness.
        let wanted = if axes < all { lengths[axes..].iter().product() } else { slowest };
        let fits = if axes < all { files == wanted } else { files > 0 && slowest.is_multiple_of(files) };
        if fits {
            return Ok(lengths.iter().product::<usize>() / files);
        }
        let should = if axes < all { format!("{wanted}") } else { format!("a divisor of {wanted}") };
        Err(self.fields.wrong(field, format!("{files} files, but sizes requires {should}")))
    }
}

/// Largest number of segments; more pairs are not looked for.
const MOST_SEGMENTS: usize = 1 << 12;

/// The segments of 3D Slicer's `.seg.nrrd`, which are pairs `SegmentN_LabelValue`, `SegmentN_Name` and
/// `SegmentN_Color`.
fn segments(pairs: &[(String, String)]) -> Vec<LabelPreset> {
    let pairs: HashMap<&str, &str> = pairs.iter().map(|(key, value)| (key.as_str(), value.trim())).collect();
    let segment = |index: usize| {
        let find = |name: &str| pairs.get(format!("Segment{index}_{name}").as_str());
        let value = find("LabelValue")?.parse().ok()?;
        let colour = find("Color").map(|text| text.split_whitespace().map(str::parse).collect::<Result<Vec<f64>, _>>());
        let colour = colour.and_then(|numbers| <[f64; 3]>::try_from(numbers.ok()?).ok());
        let colour = colour.filter(|colour| colour.iter().all(|code| (0.0..=1.0).contains(code)));
        Some(LabelPreset { value, name: find("Name").map_or_else(String::new, |name| unescaped(name)), colour })
    };
    (0..pairs.len().min(MOST_SEGMENTS)).map_while(segment).collect()
}

/// A value of a pair: the format writes a backslash as two, and the end of a line as a backslash and `n`.
fn unescaped(value: &str) -> String {
    let mut text = String::new();
    let mut letters = value.chars().peekable();
    while let Some(letter) = letters.next() {
        let real = match (letter, letters.peek()) {
            ('\\', Some('n')) => Some('\n'),
            ('\\', Some('\\')) => Some('\\'),
            _ => None,
        };
        if real.is_some() {
            letters.next();
        }
        text.push(real.unwrap_or(letter));
    }
    text
}

/// The first three entries of a vector, padded with 0.
fn three(vector: &[f64]) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|i| vector.get(i).copied().unwrap_or(0.0)))
}
