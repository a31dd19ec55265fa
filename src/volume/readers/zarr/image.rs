//! Images of OME-Zarr: axes, levels of resolution, places in space, channels, labels.
//!
//! Keys follow the OME-Zarr specification, versions 0.1 to 0.5 (<https://ngff.openmicroscopy.org>).

use serde_json::{Map, Value};

use super::array::Array;
use super::node::Node;
use crate::axes::{self, Arranged, Axis};
use crate::readers::lengths::{converted, printable, unit};
use crate::{LabelPreset, Unit, VolumeError, Window};

/// Most levels of resolution, channels or labels that are listed.
const MOST: usize = 1 << 16;

/// An image: levels of resolution with the same axes.
#[derive(Debug)]
pub(super) struct Image {
    /// Its name; may be empty.
    pub(super) name: String,
    /// Its levels, the finest first.
    pub(super) levels: Vec<Level>,
    pub(super) unit: Option<Unit>,
    /// Sentences about oddities, without the name of the store.
    pub(super) notes: Vec<String>,
}

/// A level of resolution.
#[derive(Debug)]
pub(super) struct Level {
    pub(super) array: Array,
    pub(super) arranged: Arranged,
    /// Distances of voxels along x, y and z in the unit of the image, as far as they are stated.
    pub(super) spacing: [Option<f64>; 3],
    /// Whether a distance follows from the numbers of voxels of two levels, and not from the metadata.
    pub(super) is_guessed: [bool; 3],
    /// Position of the centre of voxel (0, 0, 0).
    pub(super) origin: [f64; 3],
}

/// Scale and translation of every axis, slowest first.
#[derive(Clone, Debug, PartialEq)]
struct Placing {
    scale: Option<Vec<f64>>,
    translation: Vec<f64>,
}

/// Meaning and unit of an axis.
type Named = (Option<Axis>, Option<String>);

/// The images that `node` describes; empty if it describes none.
pub(super) fn multiscales(node: &Node) -> Result<Vec<Image>, VolumeError> {
    let list = node.attributes.get("multiscales").and_then(Value::as_array);
    let list = list.into_iter().flatten().take(MOST).enumerate();
    list.map(|(index, multiscale)| image(node, multiscale, &format!("multiscales {index}"))).collect()
}

/// Paths of the levels of each image that `node` describes.
pub(super) fn paths(node: &Node) -> Vec<Vec<String>> {
    let list = node.attributes.get("multiscales").and_then(Value::as_array).into_iter().flatten();
    let of = |multiscale: &Value| -> Vec<String> {
        let datasets = multiscale.get("datasets").and_then(Value::as_array).into_iter().flatten();
        datasets.filter_map(|dataset| Some(dataset.get("path")?.as_str()?.to_owned())).take(MOST).collect()
    };
    list.take(MOST).map(of).collect()
}

fn image(node: &Node, multiscale: &Value, place: &str) -> Result<Image, VolumeError> {
    let datasets = multiscale.get("datasets").and_then(Value::as_array).filter(|datasets| !datasets.is_empty());
    let datasets = datasets.ok_or_else(|| node.wrong(place, "there are no datasets".to_owned()))?;
    let mut image = Image {
        name: multiscale.get("name").and_then(Value::as_str).map(printable).unwrap_or_default(),
        levels: Vec::new(),
        unit: None,
        notes: Vec::new(),
    };
    for (index, dataset) in datasets.iter().take(MOST).enumerate() {
        let place = format!("{place}, dataset {index}");
        let path = dataset.get("path").and_then(Value::as_str);
        let path = path.ok_or_else(|| node.wrong(&place, "it has no path".to_owned()))?;
        let array = Array::of(&node.inside(path)?)?;
        let named = named_axes(node, multiscale, &array, &place)?;
        let rank = array.shape.len();
        let own = placing(dataset, rank).map_err(|problem| node.wrong(&place, problem))?;
        let all = placing(multiscale, rank).map_err(|problem| node.wrong(&place, problem))?;
        let placing = own.then(&all);
        let arranged = Arranged::new(&array.shape, named.iter().map(|(axis, _)| *axis).collect());
        let arranged = arranged.map_err(|problem| node.wrong(&place, problem))?;
        let mut level = Level { array, arranged, spacing: [None; 3], is_guessed: [false; 3], origin: [0.0; 3] };
        image.place(&mut level, &placing, &named);
        image.levels.push(level);
    }
    image.space_by_dims();
    Ok(image)
}

/// Meaning and unit of every axis of `array`, slowest first.
fn named_axes(node: &Node, multiscale: &Value, array: &Array, place: &str) -> Result<Vec<Named>, VolumeError> {
    let rank = array.shape.len();
    let Some(list) = multiscale.get("axes").and_then(Value::as_array) else {
        // Versions 0.1 and 0.2 have five axes of one order.
        let order = [Axis::Time, Axis::Channel, Axis::Z, Axis::Y, Axis::X];
        return match order.get(5_usize.saturating_sub(rank)..) {
            Some(axes) if rank == 5 => Ok(axes.iter().map(|&axis| (Some(axis), None)).collect()),
            _ => Err(node.wrong(place, format!("the image states no axes, and its array has {rank}, not 5"))),
        };
    };
    if list.len() != rank {
        return Err(node.wrong(place, format!("the image has {} axes, but the array has {rank}", list.len())));
    }
    let one = |axis: &Value| {
        let text = |key: &str| axis.get(key).and_then(Value::as_str);
        // Version 0.3 has names alone.
        let name = axis.as_str().or(text("name")).unwrap_or_default();
        let axis = match text("type") {
            Some("channel") => Some(Axis::Channel),
            Some("time") => Some(Axis::Time),
            _ => Axis::named(name),
        };
        (axis, text("unit").map(str::to_owned))
    };
    Ok(list.iter().map(one).collect())
}

/// The transformations of a dataset or an image. The error is a sentence.
fn placing(of: &Value, rank: usize) -> Result<Placing, String> {
    let mut placing = Placing { scale: None, translation: vec![0.0; rank] };
    let list = of.get("coordinateTransformations").and_then(Value::as_array);
    for transformation in list.into_iter().flatten() {
        let kind = transformation.get("type").and_then(Value::as_str).unwrap_or_default();
        let numbers = |key: &str| -> Result<Vec<f64>, String> {
            let list = transformation.get(key).and_then(Value::as_array);
            let numbers: Option<Vec<f64>> = list.and_then(|list| list.iter().map(Value::as_f64).collect());
            let numbers = numbers.filter(|numbers| numbers.len() == rank && numbers.iter().all(|it| it.is_finite()));
            numbers.ok_or_else(|| format!("the transformation {kind} is no list of {rank} numbers"))
        };
        let next = match kind {
            "identity" => continue,
            "scale" => Placing { scale: Some(numbers("scale")?), translation: vec![0.0; rank] },
            "translation" => Placing { scale: None, translation: numbers("translation")? },
            other => {
                let other = printable(other);
                return Err(format!("the transformation {other:?}; Relume reads identity, scale and translation"));
            }
        };
        placing = placing.then(&next);
    }
    Ok(placing)
}

impl Placing {
    /// This placing, followed by `next`.
    fn then(&self, next: &Self) -> Self {
        let by = |scale: &Option<Vec<f64>>, axis: usize| scale.as_ref().map_or(1.0, |scale| scale[axis]);
        let axes = 0..self.translation.len();
        let translation =
            axes.clone().map(|axis| self.translation[axis].mul_add(by(&next.scale, axis), next.translation[axis]));
        let is_scaled = self.scale.is_some() || next.scale.is_some();
        let scale = is_scaled.then(|| axes.map(|axis| by(&self.scale, axis) * by(&next.scale, axis)).collect());
        Self { scale, translation: translation.collect() }
    }
}

impl Image {
    /// Spacing and origin of a level, in the unit of x.
    fn place(&mut self, level: &mut Level, placing: &Placing, named: &[Named]) {
        let places = [Axis::X, Axis::Y, Axis::Z].map(|axis| level.arranged.place(axis));
        for (axis, place) in places.into_iter().enumerate() {
            let Some(place) = place else { continue };
            let name = named[place].1.as_deref();
            let stated = name.and_then(unit);
            let unknown = name.filter(|_| stated.is_none()).map(printable);
            let note =
                unknown.map(|name| format!("the unit {name} is no unit of length that Relume knows, and is ignored"));
            self.notes.extend(note.filter(|note| !self.notes.contains(note)));
            if let Some((unit, _)) = stated {
                self.unit.get_or_insert(unit);
            }
            let own = |length: f64| match (stated, self.unit) {
                (Some(stated), Some(unit)) => converted(length, stated, unit),
                _ => length,
            };
            level.spacing[axis] = placing.scale.as_ref().map(|scale| own(scale[place]));
            level.origin[axis] = own(placing.translation[place]);
        }
    }

    /// Without scales, the voxels of a coarse level are as many times larger as there are fewer of them.
    fn space_by_dims(&mut self) {
        let Some((fine, coarse)) = self.levels.split_first_mut() else { return };
        for level in coarse {
            let sides = fine.arranged.dims().into_iter().zip(level.arranged.dims());
            for (axis, (fine, own)) in sides.enumerate() {
                if level.spacing[axis].is_none() && fine != own {
                    let step = relume_base::number::count(fine) / relume_base::number::count(own);
                    (level.spacing[axis], level.is_guessed[axis]) = (Some(step), true);
                    // A coarse voxel lies at the centre of the fine ones.
                    level.origin[axis] = (step - 1.0) / 2.0;
                }
            }
        }
    }
}

/// The image of an array without OME metadata. `letters` are the axes that a user states.
pub(super) fn plain(array: Array, letters: Option<&str>) -> Result<Image, VolumeError> {
    let wrong = |problem: String| super::node::wrong(&array.file, "shape", problem);
    let names: Vec<&str> = array.names.iter().map(|name| name.as_deref().unwrap_or_default()).collect();
    let is_named = names.iter().any(|name| !name.is_empty());
    let named = if is_named { axes::named(&names, &array.shape) } else { None };
    let unknown = || VolumeError::AxesUnknown { path: array.path.clone(), shape: axes::by(&array.shape) };
    let axes = match (letters, named) {
        (Some(letters), _) => axes::stated(letters, &array.shape).map_err(wrong)?,
        (None, Some(named)) => named,
        (None, None) => axes::unnamed(&array.shape).ok_or_else(unknown)?,
    };
    let arranged = Arranged::new(&array.shape, axes).map_err(wrong)?;
    let level = Level { array, arranged, spacing: [None; 3], is_guessed: [false; 3], origin: [0.0; 3] };
    Ok(Image { name: String::new(), levels: vec![level], unit: None, notes: Vec::new() })
}

/// A channel.
#[derive(Debug, PartialEq)]
pub(super) struct Channel {
    pub(super) name: String,
    /// sRGB in hexadecimal digits.
    pub(super) colour: Option<String>,
    pub(super) window: Option<Window>,
}

/// The channels that the attributes `omero` list, at most `count`.
pub(super) fn channels(attributes: &Map<String, Value>, count: usize) -> Vec<Channel> {
    let list = attributes.get("omero").and_then(|omero| omero.get("channels")).and_then(Value::as_array);
    let one = |channel: &Value| {
        let text = |key: &str| channel.get(key).and_then(Value::as_str).map(printable);
        let name = text("label").unwrap_or_default();
        let number = |key: &str| channel.get("window")?.get(key)?.as_f64();
        let window = number("start").zip(number("end"));
        let title = if name.is_empty() { "omero" } else { &name };
        let window = window.and_then(|(low, high)| Window::new(title, low, high));
        let is_colour = |colour: &String| colour.len() == 6 && colour.chars().all(|digit| digit.is_ascii_hexdigit());
        let colour = text("color").map(|colour| colour.trim_start_matches('#').to_ascii_lowercase());
        Channel { colour: colour.filter(is_colour), window, name }
    };
    list.into_iter().flatten().take(count.min(MOST)).map(one).collect()
}

/// Names and colours of labels; `None` if the node is no label image.
pub(super) fn labels(attributes: &Map<String, Value>) -> Option<Vec<LabelPreset>> {
    let image = attributes.get("image-label")?;
    let list = |key: &str| image.get(key).and_then(Value::as_array).into_iter().flatten().take(MOST);
    let value = |entry: &Value| entry.get("label-value").and_then(Value::as_i64);
    let mut labels: Vec<LabelPreset> = Vec::new();
    for entry in list("colors") {
        let Some(value) = value(entry) else { continue };
        let parts = entry.get("rgba").and_then(Value::as_array).map(Vec::as_slice);
        let colour = match parts {
            Some([red, green, blue, ..]) => {
                let parts = [red, green, blue].map(|part| part.as_f64().filter(|part| (0.0..=255.0).contains(part)));
                parts.iter().all(Option::is_some).then(|| parts.map(|part| part.unwrap_or(0.0) / 255.0))
            }
            _ => None,
        };
        labels.push(LabelPreset { value, name: format!("label {value}"), colour });
    }
    for entry in list("properties") {
        let Some(value) = value(entry) else { continue };
        let text = |key: &str| entry.get(key).and_then(Value::as_str).map(printable);
        let Some(name) = ["name", "class", "label"].into_iter().find_map(text) else { continue };
        match labels.iter_mut().find(|label| label.value == value) {
            Some(label) => label.name = name,
            None => labels.push(LabelPreset { value, name, colour: None }),
        }
    }
    Some(labels)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_dataset_is_placed_before_its_image() {
        let of = |list: Value| placing(&json!({"coordinateTransformations": list}), 2);
        let own =
            of(json!([{"type": "scale", "scale": [2.0, 3.0]}, {"type": "translation", "translation": [10.0, 1.0]}]));
        let all =
            of(json!([{"type": "scale", "scale": [0.5, 4.0]}, {"type": "translation", "translation": [1.0, 0.0]}]));
        let placed = own.and_then(|own| Ok(own.then(&all?)));
        let expected = Placing { scale: Some(vec![1.0, 12.0]), translation: vec![6.0, 4.0] };
        assert_eq!(placed, Ok(expected));
        // A translation before a scale is scaled.
        let turned =
            of(json!([{"type": "translation", "translation": [1.0, 1.0]}, {"type": "scale", "scale": [2.0, 3.0]}]));
        assert_eq!(turned, Ok(Placing { scale: Some(vec![2.0, 3.0]), translation: vec![2.0, 3.0] }));
        assert!(of(json!([{"type": "affine"}])).is_err_and(|problem| problem.contains("affine")));
        assert!(of(json!([{"type": "scale", "scale": [2.0]}])).is_err_and(|problem| problem.contains("2 numbers")));
    }
}
