//! Placing of arrays in space, by the attributes of several conventions.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::file::{Array, File, Kind};
use crate::axes::{self, Arranged, Axis};
use crate::geometry::Lattice;
use crate::readers::lengths::{assumed_spacing, converted, printable, unit};
use crate::voxels::{with_type, with_voxels};
use crate::{Geometry, Unit, VolumeError, Voxel, VoxelType, Voxels, Window, allocate};
use relume_base::number;
use relume_base::parallel;

/// Longest list of coordinates.
const LONGEST: usize = 1 << 20;
/// Largest deviation of even coordinates, in steps: they may be rounded.
const EVEN: f64 = 0.01;

/// Axes and place of an array.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    /// Meaning of its axes, slowest first, if the file states it.
    pub(super) axes: Option<Vec<Option<Axis>>>,
    /// Steps along x, y and z, as vectors of the world; `None` where none is stated.
    steps: [Option<DVec3>; 3],
    /// Length of steps that are not stated, and whether each axis runs backwards then.
    otherwise: f64,
    backwards: [bool; 3],
    /// Position of voxel (0, 0, 0).
    origin: DVec3,
    pub(super) unit: Option<Unit>,
    pub(super) is_anatomical: bool,
    /// Slope and intercept of the values.
    pub(super) scale: (f64, f64),
    /// Slopes and intercepts of slices.
    pub(super) scales: Option<Scales>,
    /// Stored numbers of voxels without a value.
    pub(super) empty: Vec<f64>,
    /// The sentence about axes of different units.
    drawn: Option<String>,
    pub(super) metadata: Vec<(String, String)>,
    /// Sentences about oddities, without the name of the file.
    pub(super) notes: Vec<String>,
}

impl Default for Placed {
    fn default() -> Self {
        Self {
            axes: None,
            steps: [None; 3],
            otherwise: 1.0,
            backwards: [false; 3],
            origin: DVec3::ZERO,
            unit: None,
            is_anatomical: false,
            scale: (1.0, 0.0),
            scales: None,
            empty: Vec::new(),
            drawn: None,
            metadata: Vec::new(),
            notes: Vec::new(),
        }
    }
}

impl Placed {
    /// The grid of an array with these axes.
    pub(super) fn geometry(&self, source: &str, arranged: &Arranged) -> Result<Geometry, VolumeError> {
        let otherwise = |axis: usize| {
            [DVec3::X, DVec3::Y, DVec3::Z][axis] * if self.backwards[axis] { -self.otherwise } else { self.otherwise }
        };
        let [x, y, z] = [0, 1, 2].map(|axis| self.steps[axis].unwrap_or_else(|| otherwise(axis)));
        Lattice { dims: arranged.dims(), origin: self.origin, steps: DMat3::from_cols(x, y, z) }.geometry(source)
    }

    /// The sentence about axes without a step, or with steps of another unit, if there are any.
    pub(super) fn assumed(&self) -> Option<String> {
        let unknown = assumed_spacing("the file", self.steps.map(|step| step.is_none()), [self.otherwise; 3]);
        let sentences: Vec<String> = self.drawn.iter().cloned().chain(unknown).collect();
        (!sentences.is_empty()).then(|| sentences.join("; "))
    }
}

/// The placing of `array`, one of the arrays `all` of the file.
pub(super) fn of(file: &File, array: &Array, all: &[Array]) -> Result<Placed, VolumeError> {
    let mut placed = match minc(file, array) {
        Some(placed) => placed,
        None => by_coordinates(file, array, all),
    };
    if let Some([z, y, x]) =
        array.attributes.numbers("element_size_um").and_then(|sizes| <[f64; 3]>::try_from(sizes).ok())
    {
        placed.steps = [Some(DVec3::X * x), Some(DVec3::Y * y), Some(DVec3::Z * z)];
        placed.unit = Some(Unit::Micrometre);
    }
    let number = |name: &str| array.attributes.number(name);
    placed.scale = (number("scale_factor").unwrap_or(placed.scale.0), number("add_offset").unwrap_or(placed.scale.1));
    placed.empty = empty(array, file.is_classic() || !array.dimensions.is_empty());
    let is_stated = ["_FillValue", "missing_value"].into_iter().any(|name| array.attributes.has(name));
    for &empty in placed.empty.iter().filter(|_| is_stated) {
        placed.metadata.push(("fill value".to_owned(), number::readable(empty)));
    }
    for key in ["long_name", "units"] {
        if let Some(text) = array.attributes.text(key) {
            placed.metadata.push((key.to_owned(), printable(text)));
        }
    }
    Ok(placed)
}

/// Stored numbers of voxels without a value: `_FillValue` and `missing_value`, or else, for floats of a `NetCDF` file, what its
/// library writes where nothing was written.
fn empty(array: &Array, is_netcdf: bool) -> Vec<f64> {
    /// `NC_FILL_FLOAT` and `NC_FILL_DOUBLE`.
    const UNWRITTEN: f64 = 9.969_209_968_386_869e36;
    /// Most values.
    const MOST: usize = 8;
    let is_float = matches!(array.voxel_type, VoxelType::F32 | VoxelType::F64);
    let stated = ["_FillValue", "missing_value"].into_iter().filter_map(|name| array.attributes.numbers(name));
    let mut all: Vec<f64> = Vec::new();
    for value in stated.flatten().filter(|value| value.is_finite()).take(MOST) {
        // Attributes of whole numbers may have the sign of the declared type.
        let (least, most) = with_type!(array.voxel_type, T => {
            (T::nearest(f64::NEG_INFINITY).to_f64(), T::nearest(f64::INFINITY).to_f64())
        });
        let range = most - least + 1.0;
        let value = match value {
            value if is_float => value,
            value if value < least => value + range,
            value if value > most => value - range,
            value => value,
        };
        if !all.iter().any(|known| known.total_cmp(&value).is_eq()) {
            all.push(value);
        }
    }
    if all.is_empty() && is_float && is_netcdf {
        all.push(UNWRITTEN);
    }
    all
}

/// The placing by arrays of coordinates: variables of `NetCDF` with the names of the axes, and `dim1` to `dim3` of EMD.
fn by_coordinates(file: &File, array: &Array, all: &[Array]) -> Placed {
    let of_emd = emd(file, array, all);
    let is_emd = of_emd.is_some();
    let coordinates = of_emd.unwrap_or_else(|| of_netcdf(array, all));
    let names: Vec<String> = match axis_tags(array) {
        Some(names) => names,
        None if is_emd => coordinates.iter().map(|it| it.map(emd_name).unwrap_or_default()).collect(),
        None => array.dimensions.clone(),
    };
    let mut placed = Placed { axes: axes::named(&names, &array.shape), ..Placed::default() };
    let unnamed = if is_emd { axes::unnamed(&array.shape) } else { None };
    let Some(axes) = placed.axes.clone().or(unnamed) else { return placed };
    let mut lines: [Option<Line>; 3] = [None, None, None];
    for (at, axis) in axes.iter().enumerate() {
        let place = match axis {
            Some(Axis::X) => 0,
            Some(Axis::Y) => 1,
            Some(Axis::Z) => 2,
            _ => continue,
        };
        let Some(coordinates) = coordinates.get(at).copied().flatten() else { continue };
        let name =
            if is_emd { last_of(&coordinates.name) } else { array.dimensions.get(at).map_or("", String::as_str) };
        let found = line(file, coordinates, array.shape[at], place == 2);
        if found.as_ref().is_none_or(|line| !line.is_even) {
            placed.notes.push(format!("the coordinates {} are not even, and are not used", printable(name)));
        }
        lines[place] = found;
    }
    placed.draw(&lines);
    placed
}

impl Placed {
    /// Takes steps and origin of the coordinates along x, y and z. Axes whose units have nothing in common with those of x or y,
    /// such as metres beside degrees, get the steps of x, so that all of the volume is seen.
    fn draw(&mut self, all: &[Option<Line>; 3]) {
        self.backwards = all
            .each_ref()
            .map(|line| line.as_ref().is_some_and(|line| (line.step < 0.0) != (line.is_downward && line.is_vertical)));
        let lines = all.each_ref().map(|line| line.as_ref().filter(|line| line.is_even));
        let unit = lines.iter().flatten().find_map(|line| line.unit).map(|(unit, _)| unit);
        // Degrees beside metres have no common unit.
        self.unit = unit.filter(|_| lines.iter().flatten().all(|line| line.unit.is_some()));
        let first = lines.iter().flatten().next().copied();
        let differs = |line: &Line| first.is_some_and(|first| line.is_apart_from(first));
        let drawn: Vec<usize> = (0..3).filter(|&axis| lines[axis].is_some_and(differs)).collect();
        if unit.is_some() && self.unit.is_none() && drawn.is_empty() {
            self.notes.push("not all coordinates are lengths; the spacing has their numbers, and no unit".to_owned());
        }
        let own = |length: f64, line: &Line| match (line.unit, self.unit) {
            (Some(stated), Some(unit)) => converted(length, stated, unit),
            _ => length,
        };
        self.otherwise = first.map_or(1.0, |first| own(first.step, first).abs());
        for (axis, line) in lines.iter().enumerate() {
            let Some(line) = *line else { continue };
            let (mut step, mut start) = (own(line.step, line), own(line.first, line));
            if let (true, Some(first)) = (drawn.contains(&axis), first) {
                let scale = first.step.abs() / line.step.abs();
                (step, start) = (line.step * scale, line.first * scale);
            }
            // Below is below, whatever is counted.
            if line.is_vertical && line.is_downward {
                (step, start) = (-step, -start);
            }
            self.steps[axis] = Some([DVec3::X, DVec3::Y, DVec3::Z][axis] * step);
            self.origin[axis] = start;
        }
        if !drawn.is_empty() {
            let along = |axis: usize| {
                let line = lines[axis];
                let words = line.map_or("", |line| line.words.as_str());
                let step = line.map_or(1.0, |line| line.step.abs());
                let words = if words.is_empty() { "no unit".to_owned() } else { printable(words) };
                format!("{} along {}", number::brief(step) + " " + &words, ["x", "y", "z"][axis])
            };
            let all: Vec<String> = (0..3).filter(|&axis| lines[axis].is_some()).map(along).collect();
            let axes: Vec<&str> = drawn.iter().map(|&axis| ["x", "y", "z"][axis]).collect();
            let to = (0..3).find(|&axis| lines[axis].is_some()).map_or("x", |axis| ["x", "y", "z"][axis]);
            self.drawn = Some(format!(
                "the axes have different units: the steps are {}; those along {} are drawn as long as those along {to}, unless a \
                 spacing is stated",
                all.join(", "),
                axes.join(" and ")
            ));
        }
    }
}

/// The last part of the name of an array.
fn last_of(name: &str) -> &str {
    name.rsplit('/').next().unwrap_or_default()
}

/// The coordinate variables of the axes of a `NetCDF` array, in its group or in those around it.
fn of_netcdf<'a>(array: &Array, all: &'a [Array]) -> Vec<Option<&'a Array>> {
    /// Beginning of the attribute `NAME` of a dimension without coordinates, which a file of HDF5 has as an array.
    const NO_VARIABLE: &str = "This is a netCDF dimension but not a netCDF variable";
    let one = |(at, name): (usize, &String)| {
        let mut group = array.name.as_str();
        while let Some((around, _)) = group.rsplit_once('/') {
            let is_it = |other: &&Array| other.shape == [array.shape[at]] && other.name == format!("{around}/{name}");
            if let Some(found) = all.iter().find(is_it) {
                let is_variable = !found.attributes.text("NAME").is_some_and(|text| text.starts_with(NO_VARIABLE));
                return Some(found).filter(|found| is_variable && found.shape[0] > 1);
            }
            group = around;
        }
        None
    };
    array.dimensions.iter().enumerate().map(one).collect()
}

/// The coordinates of the axes of an array of an EMD file, `dim1` and so on beside it, slowest first; `None` for other arrays.
fn emd<'a>(file: &File, array: &Array, all: &'a [Array]) -> Option<Vec<Option<&'a Array>>> {
    let (group, _) = array.name.rsplit_once('/')?;
    let is_emd = !array.attributes.has("DIMENSION_LIST") && file.group(group).has("emd_group_type");
    // The first axis is dim1, or dim0 since version 1.
    let first = usize::from(!all.iter().any(|it| it.name == format!("{group}/dim0")));
    let one = |at: usize| {
        let name = format!("{group}/dim{}", at + first);
        // Of even steps, some writers store the first two.
        let fits = |it: &&Array| it.name == name && (it.shape == [array.shape[at]] || it.shape == [2]);
        all.iter().find(fits).filter(|found| found.shape[0] > 1)
    };
    is_emd.then(|| (0..array.shape.len()).map(one).collect())
}

/// The name of an axis of an EMD file.
fn emd_name(coordinates: &Array) -> String {
    coordinates.attributes.text("name").unwrap_or_default().trim().to_owned()
}

/// Names of the axes by the attribute of vigra and ilastik, slowest first.
fn axis_tags(array: &Array) -> Option<Vec<String>> {
    let tags: serde_json::Value = serde_json::from_str(array.attributes.text("axistags")?).ok()?;
    let key = |tag: &serde_json::Value| Some(tag.get("key")?.as_str()?.to_owned());
    tags.get("axes")?.as_array()?.iter().map(key).collect()
}

/// Coordinates along an axis.
struct Line {
    first: f64,
    /// The step, or the mean of uneven ones.
    step: f64,
    is_even: bool,
    /// Whether it is the axis z.
    is_vertical: bool,
    unit: Option<(Unit, f64)>,
    /// Name of the unit in the file.
    words: String,
    /// Whether larger coordinates are further down.
    is_downward: bool,
}

/// What a coordinate measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Measure {
    Length,
    Angle,
    Pressure,
    /// Nothing, or another quantity.
    Other,
}

impl Line {
    fn measure(&self) -> Measure {
        let words = self.words.to_ascii_lowercase();
        let is_angle = words.starts_with("degree") || matches!(words.as_str(), "deg" | "radian" | "radians" | "rad");
        if self.unit.is_some() {
            Measure::Length
        } else if is_angle {
            Measure::Angle
        } else if is_pressure(&words) {
            Measure::Pressure
        } else {
            Measure::Other
        }
    }

    /// Whether the steps of the two have no common unit. Numbers without a unit may be in that of a length.
    fn is_apart_from(&self, other: &Self) -> bool {
        let [one, two] = [self.measure(), other.measure()];
        let is_unknown = |line: &Self| line.words.is_empty();
        one != two && !(is_unknown(self) && two == Measure::Length || is_unknown(other) && one == Measure::Length)
    }
}

/// Whether a unit in lower case is one of pressure, which grows downwards.
fn is_pressure(words: &str) -> bool {
    matches!(
        words,
        "pa" | "hpa"
            | "kpa"
            | "bar"
            | "mbar"
            | "mb"
            | "millibar"
            | "millibars"
            | "decibar"
            | "decibars"
            | "dbar"
            | "atm"
            | "pascal"
            | "hectopascal"
    )
}

/// The coordinates of `length` entries in an array of one axis, which may have the first two of them; `None` if they are no
/// coordinates. `is_vertical` says that the axis is z.
fn line(file: &File, array: &Array, length: usize, is_vertical: bool) -> Option<Line> {
    let stored = array.shape[0];
    // Halves and enumerations come as bits.
    if stored > LONGEST || array.kind != Kind::Number || stored < length.min(2) {
        return None;
    }
    let bytes = file.block(array, &[0], &[stored]).ok()?;
    let size = array.voxel_type.bytes();
    let values: Vec<f64> = with_type!(array.voxel_type, T => {
        bytes.chunks_exact(size).map(|bytes| Voxel::to_f64(bytemuck::pod_read_unaligned::<T>(bytes))).collect()
    });
    let number = |name: &str, usual| array.attributes.number(name).unwrap_or(usual);
    let (slope, intercept) = (number("scale_factor", 1.0), number("add_offset", 0.0));
    let values: Vec<f64> = values.into_iter().map(|value| value.mul_add(slope, intercept)).collect();
    let (first, last) = (*values.first()?, *values.last()?);
    let step = (last - first) / number::count(stored - 1);
    let is_even = values
        .iter()
        .enumerate()
        .all(|(index, value)| (value - number::count(index).mul_add(step, first)).abs() <= EVEN * step.abs());
    // EMD writes [n_m] for nm.
    let words = array.attributes.text("units").unwrap_or_default().trim();
    let words = words
        .strip_prefix('[')
        .and_then(|words| words.strip_suffix(']'))
        .map_or_else(|| words.to_owned(), |inside| inside.replace('_', ""));
    let positive = array.attributes.text("positive").map(|text| text.trim().to_ascii_lowercase());
    let is_downward = match positive.as_deref() {
        Some("down") => true,
        Some("up") => false,
        _ => is_pressure(&words.to_ascii_lowercase()),
    };
    let unit = unit(&words);
    let line = Line { first, step, is_even, is_vertical, unit, words, is_downward };
    (step != 0.0 && step.is_finite()).then_some(line)
}

/// The placing of an image of MINC-2; `None` for other arrays.
fn minc(file: &File, array: &Array) -> Option<Placed> {
    let root = array.name.strip_suffix("/image")?.split_once("/image/")?.0;
    let order = array.attributes.text("dimorder")?;
    let names: Vec<String> = order.split(',').map(|name| name.trim().to_owned()).collect();
    let mut placed = Placed { axes: axes::named(&names, &array.shape), ..Placed::default() };
    let mut origin = DVec3::ZERO;
    for (axis, name) in ["xspace", "yspace", "zspace"].into_iter().enumerate() {
        let Some(dimension) = file.array_or_scalar(&format!("{root}/dimensions/{name}")) else { continue };
        let step = dimension.number("step").filter(|&step| step != 0.0);
        if step.is_none() {
            placed.notes.push(format!("{name} has no step; Relume uses 1 mm"));
        }
        let step = step.unwrap_or(1.0);
        let cosines = dimension.numbers("direction_cosines").and_then(|it| <[f64; 3]>::try_from(it).ok());
        let along = cosines.map_or([DVec3::X, DVec3::Y, DVec3::Z][axis], DVec3::from_array);
        let along = along.try_normalize().unwrap_or([DVec3::X, DVec3::Y, DVec3::Z][axis]);
        // The file's world is right-anterior-superior.
        let turn = DVec3::new(-1.0, -1.0, 1.0);
        placed.steps[axis] = Some(along * step * turn);
        origin += along * dimension.number("start").unwrap_or(0.0) * turn;
    }
    match Scales::of(file, array) {
        Ok(scales) => placed.scales = scales,
        Err(problem) => placed.notes.push(format!("{problem}; the voxels are the stored numbers")),
    }
    placed.origin = origin;
    placed.unit = Some(Unit::Millimetre);
    placed.is_anatomical = true;
    Some(placed)
}

/// Slopes and intercepts of the slices of a MINC image, by its slowest axes.
#[derive(Clone, Debug)]
pub(super) struct Scales {
    /// Lengths of the slowest axes of the image; none for one scale.
    shape: Vec<usize>,
    /// Slope and intercept, the last axis fastest.
    each: Vec<(f64, f64)>,
}

impl Scales {
    /// The scales of `array`, which turn the valid range of its numbers into image-min to image-max; `None` for floats, which
    /// are values, and without both datasets. The error is a clause.
    fn of(file: &File, array: &Array) -> Result<Option<Self>, String> {
        if matches!(array.voxel_type, VoxelType::F32 | VoxelType::F64) {
            return Ok(None);
        }
        let beside = |name: &str| {
            let path = format!("{}{name}", array.name.strip_suffix("image").unwrap_or_default());
            file.array_or_scalar(&path).map(|_| file.numbers_of(&path).ok_or(format!("{name} has no numbers")))
        };
        let (Some(low), Some(high)) = (beside("image-min"), beside("image-max")) else { return Ok(None) };
        let ((shape, low), (other, high)) = (low?, high?);
        if shape != other || !array.shape.starts_with(&shape) {
            let [image, shape, other] = [&array.shape, &shape, &other].map(|shape| axes::by(shape));
            return Err(format!(
                "the scales are not applied, because image-min has the shape {shape}, image-max {other} and the image {image}"
            ));
        }
        let number = |name: &str| array.attributes.number(name);
        let stated = array.attributes.numbers("valid_range").and_then(|range| <[f64; 2]>::try_from(range).ok());
        let stated = stated.or(number("valid_min").zip(number("valid_max")).map(|(first, last)| [first, last]));
        let [first, last] = stated.unwrap_or_else(|| {
            with_type!(array.voxel_type, T => [f64::NEG_INFINITY, f64::INFINITY].map(|end| T::nearest(end).to_f64()))
        });
        let (first, last) = (first.min(last), first.max(last));
        let one = |(&low, &high): (&f64, &f64)| {
            let slope = (high - low) / (last - first);
            (slope, low - first * slope)
        };
        let each: Vec<(f64, f64)> = low.iter().zip(&high).map(one).collect();
        if let Some(index) = each.iter().position(|(slope, intercept)| !slope.is_finite() || !intercept.is_finite()) {
            return Err(format!(
                "the scales are not applied, because slice {index} turns {first} to {last} into {} to {}",
                low[index], high[index]
            ));
        }
        Ok(Some(Self { shape, each }))
    }

    /// Index of the scale of the first voxel of the channel and time `chosen`, and its steps along x, y and z.
    fn steps(&self, arranged: &Arranged, chosen: [usize; 2]) -> (usize, [usize; 3]) {
        let stride = |place: usize| self.shape.get(place + 1..).map_or(0, |rest| rest.iter().product());
        let along = |axis: Axis| arranged.place(axis).filter(|&place| place < self.shape.len()).map_or(0, stride);
        let first = chosen[0] * along(Axis::Channel) + chosen[1] * along(Axis::Time);
        (first, [Axis::X, Axis::Y, Axis::Z].map(along))
    }

    /// The one slope and intercept of the channel and time `chosen`; `None` if its slices have different ones.
    pub(super) fn one(&self, arranged: &Arranged, chosen: [usize; 2]) -> Option<(f64, f64)> {
        let (first, steps) = self.steps(arranged, chosen);
        let ends: [usize; 3] = std::array::from_fn(|axis| if steps[axis] > 0 { arranged.dims()[axis] } else { 1 });
        let at = |[x, y, z]: [usize; 3]| self.each[first + x * steps[0] + y * steps[1] + z * steps[2]];
        let mut all = (0..ends[2]).flat_map(|z| (0..ends[1]).flat_map(move |y| (0..ends[0]).map(move |x| [x, y, z])));
        let one = at([0; 3]);
        all.all(|index| at(index) == one).then_some(one)
    }

    /// The values of `voxels`, x fastest, of the channel and time `chosen`.
    pub(super) fn values(
        &self,
        arranged: &Arranged,
        chosen: [usize; 2],
        voxels: &Voxels,
        path: &Path,
    ) -> Result<Voxels, VolumeError> {
        let (first, steps) = self.steps(arranged, chosen);
        let [nx, ny, _] = arranged.dims();
        let mut values = allocate::zeroed::<f32>(path, voxels.len())?;
        with_voxels!(voxels, stored => parallel::rows_mut(&mut values, nx, &|row, values| {
            let first = first + row % ny * steps[1] + row / ny * steps[2];
            for (x, (value, number)) in values.iter_mut().zip(&stored[row * nx..]).enumerate() {
                let (slope, intercept) = self.each[first + x * steps[0]];
                *value = f32::nearest(number.to_f64().mul_add(slope, intercept));
            }
        }));
        Ok(Voxels::F32(values))
    }
}

/// An Imaris file.
pub(super) struct Imaris {
    /// Voxels along x, y and z of each level of resolution.
    pub(super) levels: Vec<[usize; 3]>,
    pub(super) times: usize,
    pub(super) channels: Vec<Channel>,
    /// First and last corner of the image.
    corners: [DVec3; 2],
    unit: Option<Unit>,
}

/// A channel of an Imaris file.
pub(super) struct Channel {
    name: String,
    pub(super) colour: Option<String>,
    pub(super) window: Option<Window>,
}

impl Imaris {
    /// The description in `file`. The error is a sentence.
    pub(super) fn of(file: &File) -> Result<Self, String> {
        const MOST: usize = 10_000;
        let image = file.group("DataSetInfo/Image");
        let number = |key: &str| image.number(key).ok_or_else(|| format!("DataSetInfo/Image has no number {key}"));
        let corner = |end: &str| -> Result<DVec3, String> {
            let part = |axis: usize| number(&format!("{end}{axis}"));
            Ok(DVec3::new(part(0)?, part(1)?, part(2)?))
        };
        let corners = [corner("ExtMin")?, corner("ExtMax")?];
        let base = "DataSet/ResolutionLevel";
        let times = (0..MOST).take_while(|time| file.has_group(&format!("{base} 0/TimePoint {time}"))).count();
        let is_channel = |index: &usize| file.has_group(&format!("{base} 0/TimePoint 0/Channel {index}"));
        let channels: Vec<Channel> = (0..MOST).take_while(is_channel).map(|index| Channel::of(file, index)).collect();
        if channels.is_empty() {
            return Err("there is no channel".to_owned());
        }
        let levels = (0..64).take_while(|level| file.has_group(&format!("{base} {level}/TimePoint 0/Channel 0")));
        let dims = |level: usize| -> Result<[usize; 3], String> {
            let sizes = file.group(&format!("{base} {level}/TimePoint 0/Channel 0"));
            let side = |key: &str, of_image: &str| {
                let stated = sizes.number(key).or(image.number(of_image).filter(|_| level == 0));
                let side = stated.filter(|side| (1.0..=1e9).contains(side)).map(number::whole);
                side.ok_or_else(|| format!("level {level} has no size {key}"))
            };
            Ok([side("ImageSizeX", "X")?, side("ImageSizeY", "Y")?, side("ImageSizeZ", "Z")?])
        };
        let levels = levels.map(dims).collect::<Result<_, _>>()?;
        let unit =
            image.text("Unit").and_then(unit).filter(|(_, factor)| (factor - 1.0).abs() < 1e-9).map(|(unit, _)| unit);
        Ok(Self { levels, times, channels, corners, unit })
    }

    pub(super) fn names(&self) -> Vec<String> {
        let is_named = self.channels.len() > 1 && self.channels.iter().any(|channel| !channel.name.is_empty());
        if is_named { self.channels.iter().map(|channel| channel.name.clone()).collect() } else { Vec::new() }
    }

    /// The placing of a level: its voxels fill the box between the corners.
    pub(super) fn placed(&self, dims: [usize; 3]) -> Placed {
        let [low, high] = self.corners;
        let mut placed = Placed { unit: self.unit, ..Placed::default() };
        for axis in 0..3 {
            let step = (high[axis] - low[axis]) / number::count(dims[axis]);
            if step > 0.0 && step.is_finite() {
                placed.steps[axis] = Some([DVec3::X, DVec3::Y, DVec3::Z][axis] * step);
                placed.origin[axis] = low[axis] + step / 2.0;
            }
        }
        for (index, channel) in self.channels.iter().enumerate() {
            let colour = channel.colour.clone();
            placed.metadata.extend(colour.map(|colour| (format!("colour of channel {index}"), colour)));
        }
        placed
    }
}

impl Channel {
    fn of(file: &File, index: usize) -> Self {
        let about = file.group(&format!("DataSetInfo/Channel {index}"));
        let name = about.text("Name").map(printable).unwrap_or_default();
        let colour = about.numbers("Color").and_then(|parts| <[f64; 3]>::try_from(parts).ok());
        let colour = colour.filter(|parts| parts.iter().all(|part| (0.0..=1.0).contains(part)));
        let hex = |part: f64| format!("{:02x}", number::whole((part * 255.0).round()));
        let range = about.numbers("ColorRange").and_then(|ends| <[f64; 2]>::try_from(ends).ok());
        let title = if name.is_empty() { "Imaris" } else { &name };
        let window = range.and_then(|[low, high]| Window::new(title, low, high));
        Self { colour: colour.map(|parts| format!("#{}", parts.map(hex).concat())), window, name }
    }
}
