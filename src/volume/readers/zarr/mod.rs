//! Zarr stores of versions 2 and 3, and images of OME-Zarr in them: folders of chunks, with metadata in JSON.
//!
//! Keys follow the Zarr specifications (<https://zarr-specs.readthedocs.io>). All metadata are read and checked here, before
//! the crate `zarrs` decodes a chunk.

#[cfg_attr(not(feature = "zarr"), expect(dead_code, reason = "only the feature zarr decodes chunks"))]
mod array;
mod image;
mod node;

#[cfg(feature = "zarr")]
mod chunks;
#[cfg(feature = "zarr")]
mod codecs;

use std::ops::Range;
use std::path::Path;

use glam::{DMat3, DVec3};
use serde_json::Value;

use super::lengths::assumed_spacing;
use super::type_string::Kind;
use crate::axes::Axis;
use crate::several::{Asked, Series, Several};
use crate::stream::count;
use crate::{Geometry, Selection, Volume, VolumeError, Voxels};
use array::Array;
use image::{Image, Level};
use node::Node;
pub(crate) use node::{is_node, node_of};
use relume_base::memory;
use relume_base::progress::Progress;

/// Most arrays or images of a group.
const MOST: usize = 1000;
/// Most names of a folder that are looked at.
const MOST_NAMES: usize = 100_000;

/// Reads the volume of the node in the folder `path`: an image, a level of one, an array, or a group with one of them.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let node = Node::read(path)?;
    let reading = Reading { path, selection, progress };
    if node.array.is_some() {
        return match image_of_level(&node)? {
            Some((owner, level)) => {
                let selection = selection.or(&Selection { level: Some(level), ..Selection::default() });
                Reading { selection: &selection, ..reading }.images(&owner)
            }
            None => {
                let image = image::plain(Array::of(&node)?, selection.axes.as_deref())?;
                reading.no_array()?;
                reading.image(&node, &image)
            }
        };
    }
    reading.group(&node)
}

/// The group that lists the array `node` as a level of its image, and the number of the level.
fn image_of_level(node: &Node) -> Result<Option<(Node, usize)>, VolumeError> {
    /// Folders between a level and its group.
    const DEEPEST: usize = 3;
    let Ok(real) = node.path.canonicalize() else { return Ok(None) };
    for folder in real.ancestors().skip(1).take(DEEPEST) {
        if !is_node(folder) {
            continue;
        }
        let group = Node::read(folder)?;
        let is_it = |path: &String| folder.join(path).canonicalize().is_ok_and(|path| path == real);
        if let Some(level) = image::paths(&group).iter().find_map(|levels| levels.iter().position(is_it)) {
            return Ok(Some((group, level)));
        }
    }
    Ok(None)
}

/// What was met in reading the chunks of an array.
#[derive(Clone, Copy, Debug, Default)]
struct Met {
    /// Chunks that are not there.
    missing: u64,
    /// The separator in the names of the chunks, if it is not the one of the metadata.
    separator: Option<char>,
}

/// The part of the file to read.
#[derive(Clone, Copy)]
struct Reading<'a> {
    /// The path that was asked for.
    path: &'a Path,
    selection: &'a Selection,
    #[cfg_attr(not(feature = "zarr"), expect(dead_code, reason = "only the feature zarr decodes chunks"))]
    progress: &'a dyn Progress,
}

impl Reading<'_> {
    fn source(&self) -> String {
        self.path.display().to_string()
    }

    fn no_array(&self) -> Result<(), VolumeError> {
        self.selection.no_array(&self.source())?;
        self.selection.no_series(&self.source())
    }

    /// The volume of a group: of its images, of one of its series, or of one of its arrays.
    fn group(&self, group: &Node) -> Result<Volume, VolumeError> {
        let attributes = &group.attributes;
        if attributes.contains_key("multiscales") {
            return self.images(group);
        }
        if let Some(plate) = attributes.get("plate") {
            let well = plate.pointer("/wells/0/path").and_then(Value::as_str).unwrap_or("A/1");
            let well = super::lengths::printable(well);
            return Err(
                group.wrong("plate", format!("this is a plate of many images; open one of them, such as {well}/0"))
            );
        }
        if attributes.contains_key("bioformats2raw.layout") {
            return self.series(group);
        }
        let names: Vec<String> = match ["labels", "well"].map(|key| attributes.get(key)) {
            [Some(Value::Array(labels)), _] => texts(labels.iter()),
            [_, Some(well)] => {
                let images = well.get("images").and_then(Value::as_array);
                texts(images.into_iter().flatten().filter_map(|image| image.get("path")))
            }
            _ => inside(group)?,
        };
        if names.is_empty() {
            return Err(group.wrong("metadata", "the group has no image and no array".to_owned()));
        }
        let source = self.source();
        let chosen = self.selection.array(&source, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
        let node = group.inside(&names[chosen])?;
        let own = Selection { array: None, ..self.selection.clone() };
        let inner = Reading { selection: &own, ..*self };
        let mut volume = if node.array.is_some() {
            inner.image(&node, &image::plain(Array::of(&node)?, own.axes.as_deref())?)?
        } else {
            inner.images(&node)?
        };
        volume.selection.array = (names.len() > 1).then(|| names[chosen].clone());
        Ok(volume)
    }

    /// The volume of a series of a converted file: groups called 0, 1 and so on.
    fn series(&self, group: &Node) -> Result<Volume, VolumeError> {
        let (mut nodes, mut entries) = (Vec::new(), Vec::new());
        for index in 0..MOST {
            if !is_node(&group.path.join(index.to_string())) {
                break;
            }
            let node = group.inside(&index.to_string())?;
            let images = image::multiscales(&node)?;
            let Some(finest) = images.first().and_then(|image| image.levels.first()) else {
                return Err(node.wrong("multiscales", "the series has no image".to_owned()));
            };
            entries.push(Series {
                key: index.to_string(),
                description: images[0].name.clone(),
                dims: finest.arranged.dims(),
                times: finest.arranged.length(Axis::Time),
            });
            nodes.push(node);
        }
        if nodes.is_empty() {
            return Err(group.wrong("bioformats2raw.layout", "the store has no series 0".to_owned()));
        }
        let chosen = self.selection.series(&self.source(), &entries, &[])?;
        let own = Selection { series: None, ..self.selection.clone() };
        let mut volume = Reading { selection: &own, ..*self }.images(&nodes[chosen])?;
        volume.selection.series = (nodes.len() > 1).then(|| entries[chosen].key.clone());
        Ok(volume)
    }

    /// The volume of one of the images that the attributes of `node` describe.
    fn images(&self, node: &Node) -> Result<Volume, VolumeError> {
        let images = image::multiscales(node)?;
        let source = self.source();
        self.selection.no_series(&source)?;
        self.selection.no_axes(&source)?;
        if let [image] = &images[..] {
            self.selection.no_array(&source)?;
            return self.image(node, image);
        }
        if images.is_empty() {
            return Err(node.wrong("multiscales", "the group has no image".to_owned()));
        }
        // Names tell the images apart, if all have one; otherwise, numbers do.
        let is_named =
            |image: &Image| !image.name.is_empty() && images.iter().filter(|it| it.name == image.name).count() == 1;
        let are_named = images.iter().all(is_named);
        let names: Vec<String> = images
            .iter()
            .enumerate()
            .map(|(index, image)| if are_named { image.name.clone() } else { index.to_string() })
            .collect();
        let chosen = self.selection.array(&source, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
        let own = Selection { array: None, ..self.selection.clone() };
        let mut volume = Reading { selection: &own, ..*self }.image(node, &images[chosen])?;
        volume.selection.array = Some(names[chosen].clone());
        Ok(volume)
    }

    /// The volume of an image that `node` describes.
    fn image(&self, node: &Node, image: &Image) -> Result<Volume, VolumeError> {
        let source = self.source();
        let mut notes = Vec::new();
        let number = self.level(image, &mut notes)?;
        let level = &image.levels[number];
        let channels = image::channels(&node.attributes, level.arranged.length(Axis::Channel));
        let components = level.arranged.length(Axis::Channel);
        let are_named = channels.len() == components && components > 1 && channels.iter().any(|it| !it.name.is_empty());
        let names: Vec<String> =
            if are_named { channels.iter().map(|channel| channel.name.clone()).collect() } else { Vec::new() };
        let there = Several::Components { count: components, kind: String::new(), names: names.clone() };
        let component = self.selection.component_of(&source, there)?;
        let time = self.selection.time(&source, level.arranged.length(Axis::Time))?;
        let dims = level.arranged.dims();
        let spacing = DVec3::from_array(level.spacing.map(|length| length.unwrap_or(1.0)));
        let slices = self.selection.slices(dims[2]);
        let geometry = Geometry::new(&source, dims, spacing, DVec3::from_array(level.origin), DMat3::IDENTITY)?;
        let geometry = geometry.of_slices(&slices);
        let (voxels, Met { missing, separator }) = self.voxels(level, [component, time], &slices)?;
        let mut volume = Volume::new(&source, voxels, geometry)?;
        volume.part = self.selection.part(dims[2], level.together());
        volume.unit = image.unit;
        volume.components = components;
        volume.component_names = names;
        volume.files = vec![node.file.clone(), node.attributes_file.clone(), level.array.file.clone()];
        volume.files.retain(|file| file.is_file());
        volume.files.dedup();
        if let Some(colour) = channels.get(component).and_then(|channel| channel.colour.as_ref()) {
            volume.presets.take_colour(colour);
        }
        volume.presets.windows.extend(channels.get(component).and_then(|channel| channel.window.clone()));
        if let Some(labels) = image::labels(&node.attributes) {
            volume.has_labels = true;
            volume.presets.labels = labels;
        }
        volume.has_labels |= level.array.kind == Kind::Boolean;
        for (index, channel) in channels.iter().enumerate() {
            let colour = channel.colour.as_ref().map(|colour| format!("#{colour}"));
            volume.metadata.extend(colour.map(|colour| (format!("colour of channel {index}"), colour)));
        }
        if image.levels.len() > 1 {
            let dims: Vec<_> = image.levels.iter().map(|level| level.arranged.dims()).collect();
            volume.metadata.push(("pyramid".to_owned(), Several::Levels(dims).to_string()));
            volume.metadata.push(("level".to_owned(), number.to_string()));
        }
        let labels = node.path.join("labels");
        if let Some(Value::Array(labels)) =
            Node::read(&labels).ok().and_then(|mut labels| labels.attributes.remove("labels"))
        {
            let labels = texts(labels.iter());
            volume.metadata.extend(labels.into_iter().map(|name| ("label image".to_owned(), format!("labels/{name}"))));
        }
        let is_stated: [bool; 3] = std::array::from_fn(|axis| level.spacing[axis].is_some() && !level.is_guessed[axis]);
        let unknown = std::array::from_fn(|axis| !is_stated[axis] && (dims[axis] > 1 || is_stated == [false; 3]));
        let assumed = assumed_spacing("the store", unknown, spacing.to_array());
        notes.extend(image.notes.iter().cloned());
        notes.extend(assumed.clone());
        if let Some(separator) = separator {
            let other = if separator == '/' { '.' } else { '/' };
            notes.push(format!(
                "the chunks have names with the separator {separator:?}, not {other:?} as by the metadata (dimension_separator); they \
                 are read"
            ));
        }
        if missing > 0 {
            // A slab does not know how many there are in all.
            let number = if self.selection.slices.is_some() { "some".to_owned() } else { missing.to_string() };
            let are = if missing == 1 && self.selection.slices.is_none() { "chunk is" } else { "chunks are" };
            notes.push(format!("{number} {are} not there; their voxels have the fill value"));
        }
        volume.notes = notes.into_iter().map(|note| format!("{source}: {note}")).collect();
        volume.assumed_spacing = assumed.map(|note| format!("{source}: {note}"));
        if image.levels.len() > 1 {
            volume.selection.level = Some(number);
        }
        Ok(volume)
    }

    /// The level that is read: the chosen one, or the finest whose voxels fit the free memory.
    fn level(&self, image: &Image, notes: &mut Vec<String>) -> Result<usize, VolumeError> {
        let source = self.source();
        let dims: Vec<[usize; 3]> = image.levels.iter().map(|level| level.arranged.dims()).collect();
        if image.levels.len() == 1 {
            self.selection.no_level(&source)?;
        }
        if let Some(level) = self.selection.level {
            return match level < dims.len() {
                true => Ok(level),
                false => {
                    let there = Several::Levels(dims).to_string();
                    Err(VolumeError::NoSuch { source_name: source, asked: Asked::Level(level), there })
                }
            };
        }
        // Slices are read of the finest level, whatever the memory.
        if self.selection.asks || self.selection.slices.is_some() {
            return self.selection.level(&source, &dims);
        }
        let bytes: Vec<u64> = image.levels.iter().map(Level::bytes).collect();
        let free = memory::available_bytes().unwrap_or(u64::MAX);
        let number = finest(&bytes, free);
        if number > 0 {
            notes.push(format!(
                "level {number} of the pyramid is read: the {} bytes of level 0 do not fit half of the {free} bytes of free memory",
                bytes[0]
            ));
        }
        Ok(number)
    }

    #[cfg(feature = "zarr")]
    fn voxels(&self, level: &Level, chosen: [usize; 2], slices: &Range<usize>) -> Result<(Voxels, Met), VolumeError> {
        if slices.is_empty() && level.arranged.place(Axis::Z).is_none() {
            // The header alone; the only slice has no axis along which it could be left out.
            let is_half = level.array.kind == Kind::Half;
            let voxel_type = if is_half { crate::VoxelType::F32 } else { level.array.voxel_type };
            return Ok((voxel_type.no_voxels(), Met::default()));
        }
        let free = memory::available_bytes().unwrap_or(u64::MAX);
        let depth = level.arranged.length(Axis::Z).max(1);
        let bytes = level.bytes() / count(depth) * count(slices.len());
        if bytes > free {
            return Err(VolumeError::Memory { source_name: self.source(), bytes });
        }
        chunks::read(&level.array, &level.arranged, (chosen, slices), self.path, self.progress)
    }

    #[cfg(not(feature = "zarr"))]
    fn voxels(&self, _: &Level, _: [usize; 2], _: &Range<usize>) -> Result<(Voxels, Met), VolumeError> {
        let (path, place) = (self.path.to_owned(), "Zarr store".to_owned());
        let problem = "this build of Relume reads no Zarr; build it with the cargo feature \"zarr\"".to_owned();
        Err(VolumeError::Field { path, place, problem })
    }
}

impl Level {
    /// Slices of a chunk.
    fn together(&self) -> usize {
        let unit = self.array.shard.as_ref().map_or(&self.array.chunks, |shard| &shard.chunks);
        self.arranged.place(Axis::Z).map_or(1, |place| unit[place])
    }

    /// Bytes of the voxels of one channel at one time.
    fn bytes(&self) -> u64 {
        let size = match self.array.kind {
            Kind::Half => 4,
            _ => self.array.voxel_type.bytes(),
        };
        self.arranged.dims().iter().fold(count(size), |bytes, &side| bytes.saturating_mul(count(side)))
    }
}

/// The first of these sizes of levels that fits half of the `free` memory, or else the last.
fn finest(bytes: &[u64], free: u64) -> usize {
    bytes.iter().position(|&bytes| bytes <= free / 2).unwrap_or(bytes.len().saturating_sub(1))
}

/// Those of the values that are texts.
fn texts<'a>(values: impl Iterator<Item = &'a Value>) -> Vec<String> {
    values.filter_map(|value| value.as_str().map(str::to_owned)).take(MOST).collect()
}

/// Names of the images and arrays in a group without OME metadata.
fn inside(group: &Node) -> Result<Vec<String>, VolumeError> {
    let failed = |source| crate::stream::failed(&group.path, source);
    let mut names = Vec::new();
    for entry in std::fs::read_dir(&group.path).map_err(failed)?.take(MOST_NAMES) {
        let entry = entry.map_err(failed)?;
        let Ok(name) = entry.file_name().into_string() else { continue };
        if names.len() < MOST && is_node(&entry.path()) {
            let node = Node::read(&entry.path())?;
            if node.attributes.contains_key("multiscales") || node.array.is_some() {
                names.push(name);
            }
        }
    }
    names.sort_unstable();
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_finest_level_that_fits_half_of_the_memory_is_read() {
        let bytes = [8000, 1000, 125];
        assert_eq!([16_000, 15_999, 2000, 300, 10].map(|free| finest(&bytes, free)), [0, 1, 1, 2, 2]);
    }
}
