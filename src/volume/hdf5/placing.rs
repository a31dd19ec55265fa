//! Placing of arrays in space, by the attributes of several conventions.

use std::path::Path;

use glam::{DMat3, DVec3};

use super::file::{Array, File, Kind};
use crate::number;
use crate::parallel;
use crate::volume::axes::{self, Arranged, Axis};
use crate::volume::geometry::Lattice;
use crate::volume::lengths::{assumed_spacing, converted, printable, unit};
use crate::volume::voxels::{with_type, with_voxels};
use crate::volume::{Geometry, Unit, VolumeError, Voxel, VoxelType, Voxels, Window, allocate};

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
    /// Position of voxel (0, 0, 0).
    origin: DVec3,
    pub(super) unit: Option<Unit>,
    pub(super) is_anatomical: bool,
    /// Slope and intercept of the values.
    pub(super) scale: (f64, f64),
    /// Slopes and intercepts of slices.
    pub(super) scales: Option<Scales>,
    /// Value of voxels without a value.
    pub(super) empty: Option<f64>,
    pub(super) metadata: Vec<(String, String)>,
    /// Sentences about oddities, without the name of the file.
    pub(super) notes: Vec<String>,
}

impl Default for Placed {
    fn default() -> Self {
        Self {
            axes: None,
            steps: [None; 3],
            origin: DVec3::ZERO,
            unit: None,
            is_anatomical: false,
            scale: (1.0, 0.0),
            scales: None,
            empty: None,
            metadata: Vec::new(),
            notes: Vec::new(),
        }
    }
}

impl Placed {
    /// The grid of an array with these axes.
    pub(super) fn geometry(&self, source: &str, arranged: &Arranged) -> Result<Geometry, VolumeError> {
        let unit = [DVec3::X, DVec3::Y, DVec3::Z];
        let [x, y, z] = [0, 1, 2].map(|axis| self.steps[axis].unwrap_or(unit[axis]));
        Lattice { dims: arranged.dims(), origin: self.origin, steps: DMat3::from_cols(x, y, z) }.geometry(source)
    }

    /// The sentence about axes without a step, if there are any.
    pub(super) fn assumed(&self) -> Option<String> {
        assumed_spacing("the file", self.steps.map(|step| step.is_none()), [1.0; 3])
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
    placed.empty = number("_FillValue").or(number("missing_value"));
    if let Some(empty) = placed.empty {
        placed.metadata.push(("fill value".to_owned(), number::readable(empty)));
    }
    for key in ["long_name", "units"] {
        if let Some(text) = array.attributes.text(key) {
            placed.metadata.push((key.to_owned(), printable(text)));
        }
    }
    Ok(placed)
}

/// The placing by coordinate variables of `NetCDF`: arrays with the names of the axes.
fn by_coordinates(file: &File, array: &Array, all: &[Array]) -> Placed {
    let names = axis_tags(array).unwrap_or_else(|| array.dimensions.clone());
    let mut placed = Placed { axes: axes::named(&names, &array.shape), ..Placed::default() };
    let Some(axes) = &placed.axes else { return placed };
    let group = array.name.rsplit_once('/').map_or("", |(group, _)| group);
    let mut lines: [Option<Line>; 3] = [None, None, None];
    for (at, axis) in axes.iter().enumerate() {
        let place = match axis {
            Some(Axis::X) => 0,
            Some(Axis::Y) => 1,
            Some(Axis::Z) => 2,
            _ => continue,
        };
        let Some(name) = array.dimensions.get(at) else { continue };
        let is_it = |other: &&Array| other.shape == [array.shape[at]] && other.name == format!("{group}/{name}");
        let Some(coordinates) = all.iter().find(is_it).filter(|found| found.shape[0] > 1) else { continue };
        match line(file, coordinates) {
            Some(line) => lines[place] = Some(line),
            None => placed.notes.push(format!("the coordinates {} are not even, and are not used", printable(name))),
        }
    }
    let unit = lines.iter().flatten().find_map(|line| line.unit).map(|(unit, _)| unit);
    // Degrees beside metres have no common unit.
    placed.unit = unit.filter(|_| lines.iter().flatten().all(|line| line.unit.is_some()));
    if unit.is_some() && placed.unit.is_none() {
        placed.notes.push("not all coordinates are lengths; the spacing has their numbers, and no unit".to_owned());
    }
    for (axis, line) in lines.iter().enumerate() {
        let Some(line) = line else { continue };
        let own = |length: f64| match (line.unit, placed.unit) {
            (Some(stated), Some(unit)) => converted(length, stated, unit),
            _ => length,
        };
        placed.steps[axis] = Some([DVec3::X, DVec3::Y, DVec3::Z][axis] * own(line.step));
        placed.origin[axis] = own(line.first);
    }
    placed
}

/// Names of the axes by the attribute of vigra and ilastik, slowest first.
fn axis_tags(array: &Array) -> Option<Vec<String>> {
    let tags: serde_json::Value = serde_json::from_str(array.attributes.text("axistags")?).ok()?;
    let key = |tag: &serde_json::Value| Some(tag.get("key")?.as_str()?.to_owned());
    tags.get("axes")?.as_array()?.iter().map(key).collect()
}

/// Even coordinates.
struct Line {
    first: f64,
    step: f64,
    unit: Option<(Unit, f64)>,
}

/// The coordinates of an array of one axis; `None` if they are not even.
fn line(file: &File, array: &Array) -> Option<Line> {
    let length = array.shape[0];
    // Halves and enumerations come as bits.
    if length > LONGEST || array.kind != Kind::Number {
        return None;
    }
    let bytes = file.block(array, &[0], &[length]).ok()?;
    let size = array.voxel_type.bytes();
    let values: Vec<f64> = with_type!(array.voxel_type, T => {
        bytes.chunks_exact(size).map(|bytes| Voxel::to_f64(bytemuck::pod_read_unaligned::<T>(bytes))).collect()
    });
    let (first, last) = (*values.first()?, *values.last()?);
    let step = (last - first) / number::count(length - 1);
    let is_even = values
        .iter()
        .enumerate()
        .all(|(index, value)| (value - number::count(index).mul_add(step, first)).abs() <= EVEN * step.abs());
    let unit = array.attributes.text("units").and_then(unit);
    (is_even && step != 0.0 && step.is_finite()).then_some(Line { first, step, unit })
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
