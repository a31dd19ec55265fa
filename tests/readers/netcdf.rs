//! `NetCDF`-3 files with the attributes of several conventions, generated here.

use crate::support::volumes;

use glam::DVec3;
use relume::volume::{Selection, Unit, Volume, Voxels};

/// Value of an attribute.
#[derive(Clone)]
enum Value {
    Text(&'static str),
    Byte(i8),
    Short(i16),
    Float(f32),
    Double(f64),
}

use Value::{Byte, Double, Float, Short, Text};

/// A variable: name, dimensions, attributes, type, and its numbers.
struct Variable {
    name: &'static str,
    dimensions: Vec<usize>,
    attributes: Vec<(&'static str, Value)>,
    kind: u32,
    data: Vec<u8>,
}

const BYTE: u32 = 1;
const SHORT: u32 = 3;
const FLOAT: u32 = 5;
const DOUBLE: u32 = 6;

fn padded(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

fn number(number: usize) -> Vec<u8> {
    u32::try_from(number).unwrap().to_be_bytes().to_vec()
}

fn name(name: &str) -> Vec<u8> {
    [number(name.len()), padded(name.as_bytes().to_vec())].concat()
}

fn attributes(all: &[(&'static str, Value)]) -> Vec<u8> {
    if all.is_empty() {
        return vec![0; 8];
    }
    let one = |(key, value): &(&'static str, Value)| {
        let (kind, count, bytes) = match value {
            Text(text) => (2, text.len(), text.as_bytes().to_vec()),
            Byte(number) => (1, 1, number.to_be_bytes().to_vec()),
            Short(number) => (3, 1, number.to_be_bytes().to_vec()),
            Float(number) => (5, 1, number.to_be_bytes().to_vec()),
            Double(number) => (6, 1, number.to_be_bytes().to_vec()),
        };
        [name(key), number(kind), number(count), padded(bytes)].concat()
    };
    [number(0xc), number(all.len())].into_iter().chain(all.iter().map(one)).flatten().collect()
}

/// A file of the classic format.
fn file(dimensions: &[(&str, usize)], variables: &[Variable]) -> Vec<u8> {
    let mut bytes = [b"CDF\x01".to_vec(), number(0), number(0xa), number(dimensions.len())].concat();
    for (key, length) in dimensions {
        bytes.extend([name(key), number(*length)].concat());
    }
    bytes.extend([vec![0; 8], number(0xb), number(variables.len())].concat());
    let head = |variable: &Variable, begin: usize| {
        let ids: Vec<u8> = variable.dimensions.iter().flat_map(|&id| number(id)).collect();
        let size = number(variable.data.len().next_multiple_of(4));
        let kind = variable.kind.to_be_bytes().to_vec();
        let rank = number(variable.dimensions.len());
        [name(variable.name), rank, ids, attributes(&variable.attributes), kind, size, number(begin)].concat()
    };
    let length: usize = variables.iter().map(|variable| head(variable, 0).len()).sum();
    let mut begin = bytes.len() + length;
    for variable in variables {
        bytes.extend(head(variable, begin));
        begin += variable.data.len().next_multiple_of(4);
    }
    variables.iter().for_each(|variable| bytes.extend(padded(variable.data.clone())));
    bytes
}

/// The array of 4×3×5 voxels in the dimensions 0 to 2.
fn array(kind: u32, attributes: &[(&'static str, Value)], data: Vec<u8>) -> Variable {
    Variable { name: "v", dimensions: vec![0, 1, 2], attributes: attributes.to_vec(), kind, data }
}

/// Even coordinates of a dimension.
fn line(name: &'static str, id: usize, (first, step): (f64, f64), attributes: &[(&'static str, Value)]) -> Variable {
    let length = [5_u8, 3, 4][id];
    let data = (0..length).flat_map(|index| f64::from(index).mul_add(step, first).to_be_bytes()).collect();
    Variable { name, dimensions: vec![id], attributes: attributes.to_vec(), kind: DOUBLE, data }
}

fn opened(names: [&str; 3], variables: &[Variable]) -> Volume {
    let dimensions: Vec<(&str, usize)> = names.into_iter().zip([5, 3, 4]).collect();
    let bytes = file(&dimensions, variables);
    volumes::opened("v.nc", &bytes, &Selection::default()).unwrap()
}

const NAMES: [&str; 3] = ["z", "y", "x"];

#[test]
fn the_attribute_unsigned_changes_the_sign_of_whole_numbers() {
    let stored: Vec<u8> = (0..60).map(|n| n * 4 + 3).collect();
    let scale = [("scale_factor", Double(0.25)), ("add_offset", Float(-7.0))];
    let with = |words: &'static str, more: &[(&'static str, Value)]| {
        let attributes = [&[("_Unsigned", Text(words))][..], more, &scale].concat();
        opened(NAMES, &[array(BYTE, &attributes, stored.clone())])
    };
    let unsigned = with("true", &[]);
    assert!(unsigned.voxels == Voxels::U8(stored.clone()));
    assert_eq!(unsigned.value([3, 2, 4]), Some(0.25 * 239.0 - 7.0));
    // Dimensions without variables have no coordinates, even or not.
    assert!(!unsigned.notes.iter().any(|note| note.contains("even")), "{:?}", unsigned.notes);
    let signed = with("false", &[]);
    assert_eq!((signed.voxels.type_name(), signed.value([3, 2, 4])), ("int8", Some(0.25 * -17.0 - 7.0)));
    // The fill value has the sign of the declared type: −1 is 255, −17 is 239.
    let filled = with("true", &[("_FillValue", Byte(-17))]);
    assert!(filled.value([3, 2, 4]).unwrap().is_nan());
    assert_eq!(filled.value([2, 2, 4]), Some(0.25 * 235.0 - 7.0));
    // Two bytes, whose sign is that of the first.
    let wide: Vec<u8> = (0..60_u16).flat_map(|n| (n * 1000).to_be_bytes()).collect();
    let wide = opened(NAMES, &[array(SHORT, &[("_Unsigned", Text("True"))], wide)]);
    assert_eq!((wide.voxels.type_name(), wide.value([3, 2, 4])), ("uint16", Some(59_000.0)));
}

#[test]
fn voxels_with_a_fill_value_are_missing_in_every_type() {
    let shorts = |at: i16| -> Vec<u8> {
        (0..60).flat_map(|n: i16| if n % 7 == 2 { at } else { n * 11 }.to_be_bytes()).collect()
    };
    let packed = [("scale_factor", Float(0.5)), ("add_offset", Double(100.0))];
    for attributes in [
        vec![("_FillValue", Short(-9999))],
        vec![("missing_value", Short(-9999))],
        vec![("missing_value", Double(-9999.0)), ("_FillValue", Short(-32767))],
    ] {
        let volume = opened(NAMES, &[array(SHORT, &[&attributes[..], &packed].concat(), shorts(-9999))]);
        let missing = volume.statistics().unwrap().not_a_number;
        assert_eq!((missing, volume.voxels.type_name()), (9, "float32"));
        assert!(volume.value([2, 0, 0]).unwrap().is_nan());
        assert_eq!((volume.value([0, 0, 0]), volume.value([3, 2, 4])), (Some(100.0), Some(100.0 + 59.0 * 5.5)));
        let note = volume.notes.iter().find(|note| note.contains("fill value")).unwrap();
        assert!(note.contains("9 voxels") && note.contains("-9999"), "{note}");
    }
    // Numbers without such voxels stay whole.
    let whole = opened(NAMES, &[array(SHORT, &[("_FillValue", Short(-9999))], shorts(5))]);
    assert_eq!((whole.voxels.type_name(), whole.statistics().unwrap().not_a_number), ("int16", 0));
    // What the library writes where nothing was written, and a number that is stated.
    let floats = |empty: f32| -> Vec<u8> {
        (0..60_u8).flat_map(|n| if n < 3 { empty } else { f32::from(n) }.to_be_bytes()).collect()
    };
    for (attributes, empty) in [(vec![], 9.969_21e36), (vec![("missing_value", Float(-1e30))], -1e30)] {
        let volume = opened(NAMES, &[array(FLOAT, &attributes, floats(empty))]);
        let statistics = volume.statistics().unwrap();
        assert_eq!((statistics.not_a_number, statistics.min, statistics.max), (3, 3.0, 59.0), "{empty}");
    }
}

#[test]
fn depth_goes_down_and_axes_of_other_units_are_drawn_with_a_note() {
    let field = || array(FLOAT, &[], (0..60_u8).flat_map(|n| f32::from(n).to_be_bytes()).collect());
    let degrees = |name, id, first| line(name, id, (first, 0.5), &[("units", Text("degrees_north"))]);
    let of = |vertical: Variable, name| {
        opened([name, "lat", "lon"], &[vertical, degrees("lat", 1, -10.0), degrees("lon", 2, 140.0), field()])
    };
    let down = |units| [("units", Text(units)), ("positive", Text("down"))];
    let ocean = of(line("depth", 0, (100.0, 400.0), &down("m")), "depth");
    // As long as the steps of x, and voxel 0 at the top.
    assert_eq!(ocean.geometry.spacing, DVec3::splat(0.5));
    assert_eq!((ocean.geometry.direction.z_axis, ocean.unit), (DVec3::NEG_Z, None));
    assert_eq!(ocean.geometry.origin, DVec3::new(140.0, -10.0, -0.125));
    let note = ocean.notes.iter().find(|note| note.contains("different units")).unwrap();
    assert!(note.contains("400 m along z") && note.contains("0.5 degrees_north along x"), "{note}");
    let spaced = ocean.with_spacing(DVec3::new(0.5, 0.5, 0.01)).unwrap();
    assert!(!spaced.notes.iter().any(|note| note.contains("different units")), "{:?}", spaced.notes);
    // Pressure grows downwards, heights upwards.
    let air = of(line("plev", 0, (850.0, -150.0), &[("units", Text("hPa"))]), "plev");
    assert_eq!((air.geometry.direction.z_axis, air.geometry.spacing.z), (DVec3::Z, 0.5));
    let heights = of(line("height", 0, (2.0, 10.0), &[("units", Text("km")), ("positive", Text("up"))]), "height");
    assert_eq!(heights.geometry.direction.z_axis, DVec3::Z);
    // Uneven depths, as those of ocean models, and none at all: as long as the steps of x, and voxel 0 at the top.
    let mut uneven = line("depth", 0, (0.0, 1.0), &down("m"));
    uneven.data = [1.0, 4.0, 20.0, 90.0, 800.0_f64].iter().flat_map(|depth| depth.to_be_bytes()).collect();
    let uneven = of(uneven, "depth");
    assert_eq!((uneven.geometry.spacing, uneven.geometry.direction.z_axis), (DVec3::splat(0.5), DVec3::NEG_Z));
    for words in ["depth are not even", "no spacing along z; Relume uses 0.5"] {
        assert!(uneven.notes.iter().any(|note| note.contains(words)), "{:?}", uneven.notes);
    }
    let levels = opened(["level", "lat", "lon"], &[degrees("lat", 1, -10.0), degrees("lon", 2, 140.0), field()]);
    assert_eq!((levels.geometry.spacing, levels.geometry.direction.z_axis), (DVec3::splat(0.5), DVec3::Z));
    // Lengths have one unit, whatever they are multiples of, and depth goes down here, too.
    let metres = |name, id| line(name, id, (0.0, 2.0), &[("units", Text("m"))]);
    let flume = opened(
        ["depth", "y", "x"],
        &[line("depth", 0, (0.0, 5.0), &down("cm")), metres("y", 1), metres("x", 2), field()],
    );
    assert_eq!((flume.geometry.spacing, flume.unit), (DVec3::new(2000.0, 2000.0, 50.0), Some(Unit::Millimetre)));
    assert_eq!(flume.geometry.direction.z_axis, DVec3::NEG_Z);
    assert!(!flume.notes.iter().any(|note| note.contains("units")), "{:?}", flume.notes);
}
