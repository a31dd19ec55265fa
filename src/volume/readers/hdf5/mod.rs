//! HDF5 and `NetCDF`, with the conventions of MINC-2 and Imaris.

mod file;
mod links;
mod placing;

use std::ops::Range;
use std::path::Path;

use super::lengths::printable;
use super::tiles::{self, Block, Grid};
use crate::axes::{self, Arranged, Axis};
use crate::data;
use crate::several::Several;
use crate::stream::{DEFLATE_LIMIT, count};
use crate::voxels::{bytes_of_floats, with_type, with_voxels};
use crate::{Selection, Volume, VolumeError, Voxel, VoxelType, Voxels, allocate};
use file::{Array, File, Kind, LARGEST_CHUNK};
use placing::Placed;
use relume_base::memory;
use relume_base::number;
use relume_base::parallel;
use relume_base::progress::Progress;

/// Bytes of decoded blocks that wait for their place in the volume.
const WAITING: usize = 16 << 20;
/// Bytes of a block of an array without chunks.
const SLAB: usize = 4 << 20;
/// Bytes of voxels that are allocated before a block has been decoded.
const UNPROVEN: u64 = 32 << 20;

/// Whether the first bytes of a file identify HDF5; a user block may precede it.
pub(crate) fn recognises(beginning: &[u8]) -> bool {
    let mark = b"\x89HDF\r\n\x1a\n";
    [0, 512, 1024, 2048].iter().any(|&at| beginning.get(at..).is_some_and(|rest| rest.starts_with(mark)))
}

/// Whether the first bytes of a file identify `NetCDF`-3.
pub(crate) fn recognises_netcdf(beginning: &[u8]) -> bool {
    matches!(beginning, [b'C', b'D', b'F', 1 | 2 | 5, ..])
}

/// Reads an array of the file `path`.
pub(crate) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let file = File::open(path)?;
    let reading = Reading { file: &file, source: path.display().to_string(), selection, progress };
    if let Some(volume) = reading.imaris()? {
        return Ok(volume);
    }
    selection.no_level(&reading.source)?;
    let all = file.arrays()?;
    let of_rank = |ranks: std::ops::RangeInclusive<usize>| -> Vec<usize> {
        (0..all.len()).filter(|&index| ranks.contains(&all[index].shape.len())).collect()
    };
    let candidates = Some(of_rank(3..=5)).filter(|found| !found.is_empty()).unwrap_or_else(|| of_rank(2..=2));
    if candidates.is_empty() {
        let link = file.broken_link().map_or_else(String::new, |broken| format!("; {broken}"));
        let problem = format!("{} arrays of numbers, none of which has 2 to 5 axes{link}", all.len());
        return Err(VolumeError::Field { path: path.to_owned(), place: "the file".to_owned(), problem });
    }
    let names: Vec<&str> = candidates.iter().map(|&index| all[index].name.as_str()).collect();
    let slashed = selection.array.as_ref().map(|name| format!("/{}", name.trim_start_matches('/')));
    // A link is a further name of an array.
    let linked = match &slashed {
        Some(name) if !names.contains(&name.as_str()) => reading.linked(name)?,
        _ => None,
    };
    let array = match &linked {
        Some(array) => array,
        None => &all[candidates[Selection { array: slashed, ..selection.clone() }.array(&reading.source, &names)?]],
    };
    let mut volume = reading.array(array, placing::of(&file, array, &all)?)?;
    volume.selection.array = (names.len() > 1).then(|| array.name.clone());
    Ok(volume)
}

/// The part of the file to read.
struct Reading<'a> {
    file: &'a File,
    source: String,
    selection: &'a Selection,
    progress: &'a dyn Progress,
}

impl Reading<'_> {
    fn wrong(&self, place: &str, problem: String) -> VolumeError {
        VolumeError::Field { path: self.file.path.clone(), place: place.to_owned(), problem }
    }

    /// The array that a link calls `name`; `None` if there is none. A link to a file that is not read is refused with its name.
    fn linked(&self, name: &str) -> Result<Option<Array>, VolumeError> {
        match self.file.array(name).filter(|array| (2..=5).contains(&array.shape.len())) {
            Some(array) => Ok(Some(array)),
            None => match self.file.broken_link() {
                Some(broken) => Err(self.wrong(&format!("array {}", printable(name)), broken)),
                None => Ok(None),
            },
        }
    }

    /// The volume of an array with this placing.
    fn array(&self, array: &Array, placed: Placed) -> Result<Volume, VolumeError> {
        let place = format!("array {}", printable(&array.name));
        if array.shape.contains(&0) {
            return Err(
                self.wrong(&place, format!("the shape is {}; every axis needs an entry", axes::by(&array.shape)))
            );
        }
        let axes = match (&self.selection.axes, placed.axes.clone()) {
            (Some(letters), _) => axes::stated(letters, &array.shape).map_err(|problem| self.wrong(&place, problem))?,
            (None, Some(axes)) => axes,
            (None, None) => axes::unnamed(&array.shape).ok_or_else(|| VolumeError::AxesUnknown {
                path: self.file.path.clone(),
                shape: axes::by(&array.shape),
            })?,
        };
        let arranged = Arranged::new(&array.shape, axes).map_err(|problem| self.wrong(&place, problem))?;
        let components = arranged.length(Axis::Channel);
        let component = self.selection.component(&self.source, components, "")?;
        let time = self.selection.time(&self.source, arranged.length(Axis::Time))?;
        let mut volume = self.placed(array, &arranged, [component, time], placed)?;
        volume.components = components;
        Ok(volume)
    }

    /// The volume of the channel and time `chosen` of an array.
    fn placed(
        &self,
        array: &Array,
        arranged: &Arranged,
        chosen: [usize; 2],
        placed: Placed,
    ) -> Result<Volume, VolumeError> {
        data::check_size(&self.source, &array.shape)?;
        let differ = placed.scales.as_ref().is_some_and(|scales| scales.one(arranged, chosen).is_none());
        if differ && self.selection.slices.is_some() {
            let reason = "its slices have scales of their own";
            return Err(VolumeError::NotStreamed { source_name: self.source.clone(), reason });
        }
        // Scales of slices are those of the whole volume.
        let whole = Selection::default();
        let slices = if differ { &whole } else { self.selection }.slices(arranged.length(Axis::Z));
        let geometry = placed.geometry(&self.source, arranged)?.of_slices(&slices);
        let mut voxels = self.voxels(array, arranged, chosen, &slices)?;
        let assumed = placed.assumed();
        let mut notes = placed.notes;
        notes.extend(assumed.clone());
        // The numbers of classes have none for no value.
        if !placed.empty.is_empty() && array.kind == Kind::Number {
            // Slabs must have one type, and do not know whether others have such voxels.
            let is_slab = self.selection.slices.is_some();
            let is_stated = array.attributes.has("_FillValue") || array.attributes.has("missing_value");
            let (all, cleared) = cleared(voxels, &placed.empty, is_slab && is_stated, &self.file.path)?;
            voxels = all;
            if cleared > 0 {
                // A slab does not know how many there are in all.
                let number = if is_slab { "some".to_owned() } else { cleared.to_string() };
                let values: Vec<String> = placed.empty.iter().map(|&value| number::readable(value)).collect();
                let (s, values) = (if values.len() == 1 { "" } else { "s" }, values.join(" or "));
                notes.push(format!("{number} voxels have the fill value{s} {values}, and are NaN"));
            }
        }
        let mut scale = placed.scale;
        if let Some(scales) = &placed.scales {
            match scales.one(arranged, chosen) {
                Some(one) => scale = one,
                None => {
                    voxels = scales.values(arranged, chosen, &voxels, &self.file.path)?;
                    notes
                        .push("the slices have different scales, so the voxels are values in 32-bit floats".to_owned());
                }
            }
        }
        let mut volume = Volume::new(&self.source, voxels, geometry)?;
        let together = array.chunks.as_ref().and_then(|chunks| chunks.get(arranged.place(Axis::Z)?).copied());
        volume.part = self.selection.part(arranged.length(Axis::Z), together.unwrap_or(1));
        (volume.slope, volume.intercept) = scale;
        volume.unit = placed.unit;
        volume.anatomical = placed.is_anatomical;
        volume.has_labels = array.kind == Kind::Named;
        volume.metadata = placed.metadata;
        volume.files = vec![self.file.path.clone()];
        volume.notes = notes.into_iter().map(|note| format!("{}: {note}", self.source)).collect();
        volume.assumed_spacing = assumed.map(|note| format!("{}: {note}", self.source));
        Ok(volume)
    }

    /// A channel, time and level of an Imaris file; `None` for other files.
    fn imaris(&self) -> Result<Option<Volume>, VolumeError> {
        if !self.file.has_group("DataSet/ResolutionLevel 0/TimePoint 0") || !self.file.has_group("DataSetInfo/Image") {
            return Ok(None);
        }
        self.selection.no_array(&self.source)?;
        self.selection.no_axes(&self.source)?;
        let imaris = placing::Imaris::of(self.file).map_err(|problem| self.wrong("Imaris", problem))?;
        let there = Several::Components { count: imaris.channels.len(), kind: String::new(), names: imaris.names() };
        let component = self.selection.component_of(&self.source, there)?;
        let time = self.selection.time(&self.source, imaris.times)?;
        let level = self.selection.level(&self.source, &imaris.levels)?;
        let name = format!("/DataSet/ResolutionLevel {level}/TimePoint {time}/Channel {component}/Data");
        let array = self.file.array(&name).filter(|array| array.shape.len() == 3);
        let array = array.ok_or_else(|| self.wrong(&name, "there is no array of 3 axes".to_owned()))?;
        // The array is padded to whole chunks.
        let dims = imaris.levels[level];
        let shape: Vec<usize> = dims.iter().rev().copied().collect();
        if shape.iter().zip(&array.shape).any(|(own, padded)| own > padded || *own == 0) {
            let problem = format!("the shape is {}, but the image has {}", axes::by(&array.shape), axes::by(&shape));
            return Err(self.wrong(&name, problem));
        }
        let axes = vec![Some(Axis::Z), Some(Axis::Y), Some(Axis::X)];
        let arranged = Arranged::new(&shape, axes).map_err(|problem| self.wrong(&name, problem))?;
        let mut volume = self.placed(&array, &arranged, [0, 0], imaris.placed(dims))?;
        volume.components = imaris.channels.len();
        volume.component_names = imaris.names();
        volume.presets.windows.extend(imaris.channels[component].window.clone());
        if let Some(colour) = &imaris.channels[component].colour {
            volume.presets.take_colour(colour);
        }
        if imaris.levels.len() > 1 {
            volume.selection.level = Some(level);
            volume.metadata.push(("pyramid".to_owned(), Several::Levels(imaris.levels).to_string()));
        }
        Ok(Some(volume))
    }

    /// The voxels of the channel and time `chosen`: block by block, some at a time.
    fn voxels(
        &self,
        array: &Array,
        arranged: &Arranged,
        chosen: [usize; 2],
        slices: &Range<usize>,
    ) -> Result<Voxels, VolumeError> {
        let voxel_type = if array.kind == Kind::Half { VoxelType::F32 } else { array.voxel_type };
        if slices.is_empty() {
            return Ok(voxel_type.no_voxels());
        }
        let region = tiles::region(arranged, chosen, slices);
        let unit = self.unit(array, &region)?;
        with_type!(voxel_type, T => Ok(T::into_voxels(self.blocks::<T>(array, arranged, &region, &unit)?)))
    }

    /// Lengths of the blocks that are decoded: those of chunks, or of a few slices.
    fn unit(&self, array: &Array, region: &[[usize; 2]]) -> Result<Vec<usize>, VolumeError> {
        let size = array.voxel_type.bytes();
        let Some(chunks) = &array.chunks else {
            // As many entries of the slowest axes as fit.
            let mut unit: Vec<usize> = vec![1; array.shape.len()];
            let mut bytes = size;
            for axis in (0..unit.len()).rev() {
                let [first, end] = region[axis];
                unit[axis] = (end - first).min((SLAB / bytes.max(1)).max(1));
                bytes = bytes.saturating_mul(unit[axis]);
                if unit[axis] < end - first {
                    break;
                }
            }
            return Ok(unit);
        };
        let bytes = chunks.iter().fold(size, |bytes, &side| bytes.saturating_mul(side));
        if bytes > LARGEST_CHUNK {
            let place = format!("array {}", printable(&array.name));
            let chunks = axes::by(chunks);
            let problem = format!("chunks of {chunks} are {bytes} bytes; Relume reads chunks of up to {LARGEST_CHUNK}");
            return Err(self.wrong(&place, problem));
        }
        // Several small chunks at once: the crate looks through the index of all chunks for every block.
        let (mut unit, mut bytes) = (chunks.clone(), bytes);
        for axis in (0..unit.len()).rev() {
            let [first, end] = region[axis];
            let wanted = end.div_ceil(unit[axis]) - first / unit[axis];
            let times = (SLAB / 4 / bytes).clamp(1, wanted.max(1));
            (unit[axis], bytes) = (unit[axis] * times, bytes * times);
            if times < wanted {
                break;
            }
        }
        Ok(unit)
    }

    fn blocks<T: Voxel>(
        &self,
        array: &Array,
        arranged: &Arranged,
        region: &[[usize; 2]],
        unit: &[usize],
    ) -> Result<Vec<T>, VolumeError> {
        let path = &self.file.path;
        let voxels: usize = tiles::dims(arranged, region).iter().product();
        let bytes = count(voxels).saturating_mul(count(array.voxel_type.bytes()));
        let (length, limit) = (self.file.length(), if array.chunks.is_some() { DEFLATE_LIMIT } else { 1 });
        if bytes > length.saturating_mul(limit).max(UNPROVEN) {
            let (path, encoding) = (path.clone(), "HDF5");
            return Err(VolumeError::Incredible { path, compressed: length, expected: bytes, encoding, limit });
        }
        if memory::available_bytes().is_some_and(|free| bytes > free) {
            return Err(VolumeError::Memory { source_name: self.source.clone(), bytes });
        }
        // A short file may hold less than it states: then all blocks are decoded before the allocation.
        if bytes > length.saturating_mul(16).max(UNPROVEN) {
            self.each(array, region, unit, |_| Ok(()))?;
        }
        let mut volume = allocate::zeroed::<T>(path, voxels)?;
        let mut done = 0;
        self.each(array, region, unit, |blocks| {
            tiles::lay(arranged, region, blocks, &mut volume);
            done += blocks.iter().map(|block| count(block.bytes.len())).sum::<u64>();
            data::report(path, done.min(bytes), bytes, self.progress)
        })?;
        Ok(volume)
    }

    /// Decodes the blocks of the region, some at a time, and hands them on.
    fn each(
        &self,
        array: &Array,
        region: &[[usize; 2]],
        unit: &[usize],
        mut take: impl FnMut(&[Block]) -> Result<(), VolumeError>,
    ) -> Result<(), VolumeError> {
        let grid = Grid::over(region, unit);
        let size = unit.iter().product::<usize>().saturating_mul(array.voxel_type.bytes()).max(1);
        let at_once = count(rayon::current_num_threads().max(WAITING / size));
        let mut next = 0;
        while next < grid.len() {
            let end = grid.len().min(next + at_once);
            let one = |number: u64| self.block(array, region, unit, &grid.indices(number));
            let blocks =
                parallel::map(usize::try_from(end - next).unwrap_or(usize::MAX), &|index| one(next + count(index)));
            take(&blocks.into_iter().collect::<Result<Vec<_>, _>>()?)?;
            next = end;
        }
        Ok(())
    }

    /// The block with these indices, as far as it is in the region.
    fn block(
        &self,
        array: &Array,
        region: &[[usize; 2]],
        unit: &[usize],
        indices: &[usize],
    ) -> Result<Block, VolumeError> {
        data::check_cancelled(&self.file.path, self.progress)?;
        let start: Vec<usize> = indices
            .iter()
            .zip(unit)
            .zip(region)
            .map(|((index, side), [first, _])| (index * side).max(*first))
            .collect();
        let end = indices.iter().zip(unit).zip(region).map(|((index, side), [_, end])| ((index + 1) * side).min(*end));
        let lengths: Vec<usize> = end.zip(&start).map(|(end, start)| end - start).collect();
        let read = self.file.block(array, &start, &lengths);
        let mut bytes = read.map_err(|source| {
            let place = format!("array {}, block from {start:?} (slowest axis first)", printable(&array.name));
            if source.kind() == std::io::ErrorKind::Unsupported {
                let known = "Relume reads deflate, shuffle, Fletcher-32, LZF, szip, n-bit and scale-offset";
                return self.wrong(&place, format!("{source}; {known}"));
            }
            VolumeError::DamagedPart { path: self.file.path.clone(), place, encoding: "HDF5", source }
        })?;
        if array.kind == Kind::Half {
            bytes = bytes_of_floats(&bytes);
        }
        Ok(Block { start, lengths, bytes })
    }
}

/// The voxels with NaN in place of the numbers `empty`, and how many these are. Whole numbers, which have none for no value, become
/// floats that hold them if there are such voxels, or if `is_float` says so.
fn cleared(mut voxels: Voxels, empty: &[f64], is_float: bool, path: &Path) -> Result<(Voxels, usize), VolumeError> {
    fn clear<T: Voxel>(voxels: &mut [T], empty: &[f64], not_a_number: T) -> usize {
        let empty: Vec<T> = empty.iter().map(|&empty| T::nearest(empty)).collect();
        let mut cleared = 0;
        for voxel in voxels.iter_mut().filter(|voxel| empty.contains(voxel)) {
            *voxel = not_a_number;
            cleared += 1;
        }
        cleared
    }
    /// The `stored` numbers as floats; `None` if all of them stay as they are.
    fn floats<T: Voxel, F: Voxel>(
        stored: &[T],
        empty: &[f64],
        (is_float, not_a_number): (bool, F),
        path: &Path,
    ) -> Result<Option<(Vec<F>, usize)>, VolumeError> {
        /// Voxels of a task.
        const AT_ONCE: usize = 1 << 16;
        // Numbers that the type does not hold are those of no voxel.
        let is_held = |empty: &f64| T::nearest(*empty).to_f64().total_cmp(empty).is_eq();
        let empty: Vec<T> = empty.iter().filter(|empty| is_held(empty)).map(|&empty| T::nearest(empty)).collect();
        let is_empty = |voxels: &&[T]| voxels.iter().filter(|voxel| empty.contains(voxel)).count();
        let parts: Vec<&[T]> = stored.chunks(AT_ONCE).collect();
        let cleared: usize = parallel::map(parts.len(), &|part| is_empty(&parts[part])).into_iter().sum();
        if cleared == 0 && !is_float {
            return Ok(None);
        }
        let mut floats = allocate::zeroed::<F>(path, stored.len())?;
        parallel::rows_mut(&mut floats, AT_ONCE, &|part, floats| {
            for (float, voxel) in floats.iter_mut().zip(parts[part]) {
                *float = if empty.contains(voxel) { not_a_number } else { F::nearest(voxel.to_f64()) };
            }
        });
        Ok(Some((floats, cleared)))
    }
    let cleared = match &mut voxels {
        Voxels::F32(voxels) => clear(voxels, empty, f32::NAN),
        Voxels::F64(voxels) => clear(voxels, empty, f64::NAN),
        whole => {
            let found = match whole.voxel_type().bytes() {
                // Floats of 32 bits hold numbers of 16.
                1 | 2 => with_voxels!(&*whole, stored => floats(stored, empty, (is_float, f32::NAN), path)?)
                    .map(|(floats, cleared)| (Voxels::F32(floats), cleared)),
                _ => with_voxels!(&*whole, stored => floats(stored, empty, (is_float, f64::NAN), path)?)
                    .map(|(floats, cleared)| (Voxels::F64(floats), cleared)),
            };
            return Ok(found.unwrap_or((voxels, 0)));
        }
    };
    Ok((voxels, cleared))
}
