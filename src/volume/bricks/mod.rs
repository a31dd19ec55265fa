//! Caches of bricks (`.bricks`): volumes whose voxels stay in their file, and are decoded brick by brick.

mod cells;
mod format;
mod grid;
mod make;
mod slab;

use std::collections::{HashMap, HashSet};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

use rayon::prelude::*;

pub use cells::{CELL, cell_maxima, cell_ranges, macrocells};
pub use grid::BRICK;
pub use make::{BricksMade, MakeError};
pub(super) use make::{Input, make};

use super::resample::of_blocks;
use super::select::HostMemory;
use super::statistics::Measured;
use super::voxels::with_type;
use super::{
    Finest, Geometry, Selection, Several, Volume, VolumeError, Voxel, VoxelType, Voxels, allocate, with_voxels,
};
use crate::data::{check_cancelled, report};
use crate::stream::{self, count};
use cells::CellRanges;
use format::{Entry, FIXED, Fixed, LEVELS, Level, Text, damaged, digest};
use grid::BrickGrid;
use relume_base::memory;
use relume_base::progress::Progress;

/// Decoded bricks that a march needs at once: one and its neighbours.
const LEAST_HELD: usize = 27;
/// Bytes, for voxels of a byte, for a brick and its neighbours while they are decoded, the brick that is put together, its texels, and those that are on their way to the device.
const WORKING: u64 = 16 << 20;
/// Bricks that are decoded at once where all are.
const BATCH: usize = 32;
/// Part of the memory that the coarse level may take: one of so many.
const COARSE_PART: u64 = 8;
/// Most voxels of the coarse level: it is marched while a hand moves.
const MOST_COARSE: u64 = 1 << 24;

/// Whether the first bytes of a file identify a file of bricks.
pub(super) fn recognises(beginning: &[u8]) -> bool {
    beginning.starts_with(&format::MAGIC)
}

/// Bricks that a cache decoded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct CacheCounts {
    /// Decoded bricks that there is room for.
    pub held: usize,
    /// Bricks that were read and decoded, each time counted.
    pub loaded: usize,
    /// Bricks among them that had been read before.
    pub again: usize,
}

/// A level of resolution of a file of bricks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BrickLevel {
    /// Position of its voxels.
    pub geometry: Geometry,
    /// Bytes of its voxels in memory.
    pub bytes: u64,
}

/// The levels of resolution of the file of bricks `path`, the finest first. The `level` of a [`Selection`] chooses one of them.
///
/// # Errors
///
/// [`VolumeError::Open`], [`VolumeError::Read`], [`VolumeError::Bricks`].
pub fn brick_levels(path: &Path) -> Result<Vec<BrickLevel>, VolumeError> {
    Opened::new(path)?.levels()
}

/// A level of a file of bricks, and those of its bricks that are in memory.
#[derive(Debug)]
pub struct BrickCache {
    path: PathBuf,
    file: Mutex<File>,
    /// Digest of the text and the index of all levels.
    text_digest: u32,
    level: usize,
    levels: Vec<BrickLevel>,
    grid: BrickGrid,
    voxel_type: VoxelType,
    index: Vec<Entry>,
    /// Place and number of bytes of the macrocells, and their digest.
    cells: ([u64; 2], u32),
    measured: Measured,
    rounded: f64,
    /// Bytes for decoded bricks and what is kept beside them.
    limit: u64,
    held: Mutex<Held>,
    /// Coarse level of the volume, once it is made.
    coarse: OnceLock<Arc<Volume>>,
    /// Values of neighbouring voxels that plans compare, once they are read.
    neighbours: OnceLock<Vec<Option<[f64; 2]>>>,
}

/// Decoded bricks.
#[derive(Debug, Default)]
struct Held {
    /// Bricks with the time of their last use.
    bricks: HashMap<usize, (Arc<Voxels>, u64)>,
    time: u64,
    /// Whether a brick has been read.
    known: Vec<bool>,
    counts: CacheCounts,
}

/// Reads a file of bricks: its voxels, or only its description if `selection` leaves them in the file.
pub(super) fn read(path: &Path, selection: &Selection, progress: &dyn Progress) -> Result<Volume, VolumeError> {
    let source = path.display().to_string();
    Selection { level: None, ..selection.clone() }.only(&source)?;
    let (mut volume, mut cache) = BrickCache::open(path, selection)?;
    if selection.middle {
        let slices = selection.slices(cache.grid.dims[2]);
        volume.voxels = with_type!(cache.voxel_type, T => cache.slices::<T>(&slices, progress)?);
        volume.geometry = volume.geometry.of_slices(&slices);
        return Ok(volume);
    }
    let bytes = count(cache.grid.all_voxels()).saturating_mul(count(cache.voxel_type.bytes()));
    let available = memory::available_bytes();
    let limit = match selection.memory {
        HostMemory::Whole => available.unwrap_or(u64::MAX),
        HostMemory::Bounded { bytes: stated } => stated.or(available.map(|bytes| bytes / 2)).unwrap_or(u64::MAX),
        HostMemory::InFile => 0,
    };
    if bytes <= limit {
        volume.voxels = with_type!(cache.voxel_type, T => cache.slices::<T>(&(0..cache.grid.dims[2]), progress)?);
        return Ok(volume);
    }
    if selection.memory == HostMemory::Whole {
        return Err(VolumeError::Exceeds { source_name: source, bytes, limit });
    }
    memory::give_back_large_blocks();
    cache.bound(if selection.memory == HostMemory::InFile { u64::MAX } else { limit })?;
    volume.bricks = Some(Arc::new(cache));
    Ok(volume)
}

/// A file of bricks whose text and index were read.
struct Opened<'a> {
    path: &'a Path,
    file: File,
    fixed: Fixed,
    text: Text,
    levels: Vec<Level>,
}

impl<'a> Opened<'a> {
    /// Opens the cache `path`, and checks its index against its length before it takes memory.
    fn new(path: &'a Path) -> Result<Self, VolumeError> {
        let mut file = stream::open(path)?;
        let failed = |source| stream::failed(path, source);
        let length = file.metadata().map_err(failed)?.len();
        let mut beginning = vec![0; FIXED];
        let found = stream::read_fully(&mut file, &mut beginning).map_err(failed)?;
        let fixed = Fixed::of_bytes(path, &beginning[..found], length)?;
        let bytes = read_at(&mut file, fixed.text_and_index()).map_err(failed)?;
        let (text, levels) = fixed.parse(path, &bytes)?;
        Ok(Self { path, file, fixed, text, levels })
    }

    fn levels(&self) -> Result<Vec<BrickLevel>, VolumeError> {
        let bytes = count(self.text.voxel_type(self.path)?.bytes());
        let level = |level: usize| {
            let geometry = self.text.geometry(self.path, level)?;
            Ok(BrickLevel { geometry, bytes: count(geometry.voxels()).saturating_mul(bytes) })
        };
        (0..self.levels.len()).map(level).collect()
    }
}

impl BrickCache {
    /// Opens the level of the cache `path` that `selection` chooses.
    fn open(path: &Path, selection: &Selection) -> Result<(Volume, Self), VolumeError> {
        let mut opened = Opened::new(path)?;
        let source = path.display().to_string();
        let levels = opened.levels()?;
        let dims: Vec<[usize; 3]> = levels.iter().map(|level| level.geometry.dims).collect();
        if dims.len() == 1 {
            selection.no_level(&source)?;
        }
        let level = selection.level(&source, &dims)?;
        let (measured, rounded) = opened.text.measured(path, level)?;
        let mut volume = opened.text.volume(path, level)?;
        if dims.len() > 1 {
            volume.selection.level = Some(level);
            let told = [Several::Levels(dims).to_string(), level.to_string()];
            volume.metadata.extend(LEVELS.map(str::to_owned).into_iter().zip(told));
            let dims = levels[0].geometry.dims;
            volume.finest = (level > 0).then(|| Finest { dims, block: block_of(dims, level) });
        }
        let Level { grid, index, cells, cells_digest } = opened.levels.swap_remove(level);
        let cache = Self {
            path: path.to_owned(),
            file: Mutex::new(opened.file),
            text_digest: opened.fixed.digest(),
            level,
            levels,
            grid,
            voxel_type: volume.voxels.voxel_type(),
            limit: u64::MAX,
            held: Mutex::new(Held { known: vec![false; index.len()], ..Held::default() }),
            coarse: OnceLock::new(),
            neighbours: OnceLock::new(),
            index,
            cells: (cells, cells_digest),
            measured,
            rounded,
        };
        Ok((volume, cache))
    }

    /// The levels of resolution of the file, the finest first.
    #[must_use]
    pub fn levels(&self) -> &[BrickLevel] {
        &self.levels
    }

    /// The level of resolution whose bricks these are; 0 is the finest.
    #[must_use]
    pub fn level(&self) -> usize {
        self.level
    }

    /// Bounds the memory of decoded bricks and of what a march keeps beside them by `limit` bytes.
    fn bound(&mut self, limit: u64) -> Result<(), VolumeError> {
        self.limit = limit;
        self.leave_room(0)
    }

    /// Leaves room for `taken` bytes beside the decoded bricks.
    fn leave_room(&self, taken: u64) -> Result<(), VolumeError> {
        let brick = count(self.grid.largest() * self.voxel_type.bytes());
        // The index, the ranges of the macrocells while they are read, as f32, and their occupancy.
        let cells = count(macrocells(self.grid.dims).iter().product());
        let working = WORKING * count(self.voxel_type.bytes());
        let beside = working + count(self.index.len() * 48) + self.cells.0[1] + 9 * cells + taken;
        let room = self.limit.saturating_sub(beside) / brick;
        let held = usize::try_from(room).unwrap_or(usize::MAX).min(self.index.len());
        let needed = LEAST_HELD.min(self.index.len());
        if held < needed {
            let least = beside + count(needed) * brick;
            let source_name = self.path.display().to_string();
            return Err(VolumeError::BrickMemory { source_name, least, limit: self.limit });
        }
        self.held().counts.held = held;
        Ok(())
    }

    /// Values of neighbouring voxels: what `read` returned the first time.
    pub(super) fn neighbours(&self, read: impl FnOnce() -> Vec<Option<[f64; 2]>>) -> &[Option<[f64; 2]>] {
        self.neighbours.get_or_init(read)
    }

    /// Whether [`Self::neighbours`] have been read.
    pub(super) fn has_neighbours(&self) -> bool {
        self.neighbours.get().is_some()
    }

    /// The coarse level of the volume, once it is made.
    pub(super) fn coarse(&self) -> Option<&Arc<Volume>> {
        self.coarse.get()
    }

    /// Makes the coarse level of `volume`, whose voxels are in this file: the finest one that takes a small part of the memory.
    pub(super) fn make_coarse(&self, volume: &Volume, progress: &dyn Progress) -> Result<(), VolumeError> {
        if self.coarse.get().is_some() {
            return Ok(());
        }
        let coarser = self.coarser_levels();
        let block = self.coarse_block(coarser);
        let dims: [usize; 3] = std::array::from_fn(|axis| self.grid.dims[axis].div_ceil(block[axis]));
        self.leave_room(count(dims.iter().product::<usize>() * self.voxel_type.bytes()))?;
        let there = self.level + coarser;
        let voxels = if self.levels.get(there).is_some_and(|level| level.geometry.dims == dims) {
            let selection = Selection { level: Some(there), ..Selection::default() };
            read(&self.path, &selection, progress)?.voxels
        } else {
            // Files of the first version have no levels.
            with_type!(self.voxel_type, T => self.means::<T>(block, volume.has_labels, progress)?)
        };
        // Another thread may have made the same one.
        self.coarse.set(Arc::new(volume.of_coarse_voxels(voxels, block)?)).ok();
        Ok(())
    }

    /// Number of levels of the file that are coarser than this one.
    pub(super) fn further_levels(&self) -> usize {
        self.levels.len() - 1 - self.level
    }

    /// The level of the file that is coarser by so many halvings than `volume`, whose voxels are in this file: in memory if it
    /// fits there.
    pub(super) fn coarser(
        &self,
        volume: &Volume,
        halvings: usize,
        progress: &dyn Progress,
    ) -> Result<Volume, VolumeError> {
        let memory = HostMemory::Bounded { bytes: Some(self.limit) };
        let selection = Selection { level: Some(self.level + halvings), memory, ..Selection::default() };
        let Volume { voxels, bricks, .. } = read(&self.path, &selection, progress)?;
        Ok(Volume { bricks, ..volume.of_coarse_voxels(voxels, self.coarse_block(halvings))? })
    }

    /// Calls `with` for the voxels of each brick.
    pub(super) fn each_brick(&self, mut with: impl FnMut(&Voxels)) -> Result<(), VolumeError> {
        let bricks: Vec<usize> = (0..self.index.len()).collect();
        let batch = BATCH.min(self.held().counts.held).max(1);
        for bricks in bricks.chunks(batch) {
            self.decoded(bricks)?.iter().for_each(|voxels| with(voxels));
        }
        Ok(())
    }

    /// Sides of the blocks of the level that is coarser by so many halvings.
    fn coarse_block(&self, coarser: usize) -> [usize; 3] {
        block_of(self.grid.dims, coarser)
    }

    /// Number of halvings to the coarse level.
    fn coarser_levels(&self) -> usize {
        let is_small = |coarser: &usize| {
            let sides = self.coarse_block(*coarser);
            let voxels = count((0..3).map(|axis| self.grid.dims[axis].div_ceil(sides[axis])).product());
            voxels <= MOST_COARSE && voxels * count(self.voxel_type.bytes()) <= self.limit / COARSE_PART
        };
        // Blocks of voxels that are averaged here divide a brick.
        let most = (BRICK.ilog2() as usize).max(self.further_levels());
        (1..=most).find(is_small).unwrap_or(most)
    }

    /// The means of blocks of `block` voxels, or their most frequent numbers if these are `labels`, brick by brick.
    fn means<T: Voxel>(&self, block: [usize; 3], labels: bool, progress: &dyn Progress) -> Result<Voxels, VolumeError> {
        let [width, height, depth] = std::array::from_fn(|axis| self.grid.dims[axis].div_ceil(block[axis]));
        let mut means = allocate::zeroed::<T>(&self.path, width * height * depth)?;
        let bricks: Vec<usize> = (0..self.index.len()).collect();
        let batch = BATCH.min(self.held().counts.held).max(1);
        for bricks in bricks.chunks(batch) {
            for (&brick, voxels) in bricks.iter().zip(self.decoded(bricks)?) {
                let stored: &[T] = with_voxels!(&*voxels, stored => bytemuck::cast_slice(stored));
                let [low, high] = self.grid.span(brick);
                let dims = std::array::from_fn(|axis| high[axis] - low[axis]);
                let [x, y, z]: [usize; 3] = std::array::from_fn(|axis| low[axis] / block[axis]);
                let [across, down]: [usize; 2] = std::array::from_fn(|axis| dims[axis].div_ceil(block[axis]));
                for (row, part) in of_blocks(stored, dims, block, labels, progress).chunks_exact(across).enumerate() {
                    let first = x + width * (y + row % down + height * (z + row / down));
                    means[first..first + across].copy_from_slice(part);
                }
            }
            let done = bricks.last().map_or(0, |last| last + 1);
            report(&self.path, count(done), count(self.index.len()), progress)?;
        }
        check_cancelled(&self.path, progress)?;
        Ok(T::into_voxels(means))
    }

    fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Bricks read so far.
    #[must_use]
    pub fn counts(&self) -> CacheCounts {
        self.held().counts
    }

    /// Digests of all bricks and of the description of the volume, and of the macrocells of the level.
    #[must_use]
    pub fn digest(&self) -> [u32; 2] {
        [self.text_digest, self.cells.1]
    }

    /// Statistics of the stored values.
    pub(super) fn measured(&self) -> &Measured {
        &self.measured
    }

    /// Largest rounding error of the stored values as f64; 0 except for integers of 64 bits.
    #[must_use]
    pub fn rounded_off(&self) -> f64 {
        self.rounded
    }

    /// Calls `with` for each macrocell, x fastest: with the lowest and the highest stored value in it and around it, in the
    /// wrong order if all are NaN, and whether one is NaN.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`], [`VolumeError::Bricks`].
    pub fn each_cell(&self, with: impl FnMut([f64; 2], bool)) -> Result<(), VolumeError> {
        let (place, expected) = self.cells;
        let bytes = read_at(&mut *self.file(), place).map_err(|source| stream::failed(&self.path, source))?;
        self.check("the macrocells are", &bytes, expected)?;
        let cells = macrocells(self.grid.dims).iter().product();
        with_type!(self.voxel_type, T => CellRanges::<T>::each(cells, &bytes, with));
        Ok(())
    }

    /// The voxels of a box from `first` to before `end`, which lie in the grid, as a volume of their own with spacing 1.
    ///
    /// # Errors
    ///
    /// [`VolumeError::Read`], [`VolumeError::Bricks`].
    pub fn part(&self, first: [usize; 3], end: [usize; 3]) -> Result<Volume, VolumeError> {
        let voxels = with_type!(self.voxel_type, T => self.part_as::<T>(first, end)?);
        let source = self.path.display().to_string();
        let dims = std::array::from_fn(|axis| end[axis] - first[axis]);
        Volume::new(&source, voxels, Geometry::unit(&source, dims)?)
    }

    /// Number of the first `boxes`, each from its first voxel to before its end, that have their bricks in memory together.
    pub fn fitting(&self, boxes: impl Iterator<Item = [[usize; 3]; 2]>) -> usize {
        let (held, mut needed) = (self.counts().held, HashSet::new());
        let fits = |[first, end]: &[[usize; 3]; 2]| {
            needed.extend(self.grid.within(*first, *end));
            needed.len() <= held
        };
        boxes.take_while(fits).count()
    }

    /// Places of the bricks, as boxes from the first voxel to before the end.
    #[must_use]
    pub fn boxes(&self) -> Vec<[[usize; 3]; 2]> {
        (0..self.index.len()).map(|brick| self.grid.span(brick)).collect()
    }

    fn part_as<T: Voxel>(&self, first: [usize; 3], end: [usize; 3]) -> Result<Voxels, VolumeError> {
        let needed = self.grid.within(first, end);
        let [width, height, depth]: [usize; 3] = std::array::from_fn(|axis| end[axis] - first[axis]);
        let mut part = allocate::zeroed::<T>(&self.path, width * height * depth)?;
        for (brick, voxels) in needed.iter().zip(self.fetched(&needed)?) {
            let stored: &[T] = with_voxels!(&*voxels, stored => bytemuck::cast_slice(stored));
            let [low, high] = self.grid.span(*brick);
            let from: [usize; 3] = std::array::from_fn(|axis| low[axis].max(first[axis]));
            let to: [usize; 3] = std::array::from_fn(|axis| high[axis].min(end[axis]));
            for z in from[2]..to[2] {
                for y in from[1]..to[1] {
                    let row = |[x, y, z]: [usize; 3], [nx, ny]: [usize; 2]| x + nx * (y + ny * z);
                    let there = row([from[0] - low[0], y - low[1], z - low[2]], [high[0] - low[0], high[1] - low[1]]);
                    let here = row([from[0] - first[0], y - first[1], z - first[2]], [width, height]);
                    let length = to[0] - from[0];
                    part[here..here + length].copy_from_slice(&stored[there..there + length]);
                }
            }
        }
        Ok(T::into_voxels(part))
    }

    /// The decoded bricks `needed`.
    fn fetched(&self, needed: &[usize]) -> Result<Vec<Arc<Voxels>>, VolumeError> {
        let missing: Vec<usize> = {
            let held = self.held();
            needed.iter().copied().filter(|brick| !held.bricks.contains_key(brick)).collect()
        };
        // The lock is not held while other threads decode.
        let decoded = self.decoded(&missing)?;
        let mut held = self.held();
        for (brick, voxels) in missing.into_iter().zip(decoded) {
            held.keep(brick, voxels, needed);
        }
        held.time += 1;
        let time = held.time;
        let mut found = Vec::with_capacity(needed.len());
        for brick in needed {
            let voxels = match held.bricks.get_mut(brick) {
                Some((voxels, used)) => {
                    *used = time;
                    Arc::clone(voxels)
                }
                // Another thread needed its room.
                None => self.decoded(&[*brick])?.remove(0),
            };
            found.push(voxels);
        }
        Ok(found)
    }

    /// Reads and decodes `bricks`.
    fn decoded(&self, bricks: &[usize]) -> Result<Vec<Arc<Voxels>>, VolumeError> {
        let read = |&brick: &usize| {
            let Entry { offset, bytes, .. } = self.index[brick];
            let bytes = read_at(&mut *self.file(), [offset, bytes.into()]);
            Ok((brick, bytes.map_err(|source| stream::failed(&self.path, source))?))
        };
        let packed: Vec<(usize, Vec<u8>)> = bricks.iter().map(read).collect::<Result<_, VolumeError>>()?;
        packed
            .into_par_iter()
            .map(|(brick, bytes)| {
                Ok(Arc::new(with_type!(self.voxel_type, T => T::into_voxels(self.unpacked::<T>(brick, &bytes)?))))
            })
            .collect()
    }

    /// The voxels of `brick`, whose `bytes` were read.
    fn unpacked<T: Voxel>(&self, brick: usize, bytes: &[u8]) -> Result<Vec<T>, VolumeError> {
        let name = format::name(self.level, brick);
        self.check(&format!("{name} is"), bytes, self.index[brick].digest)?;
        unpacked(bytes, self.grid.voxels(brick)).map_err(|source| VolumeError::DamagedPart {
            path: self.path.clone(),
            place: name,
            encoding: "LZ4",
            source,
        })
    }

    /// The voxels of the `wanted` slices.
    fn slices<T: Voxel>(&self, wanted: &Range<usize>, progress: &dyn Progress) -> Result<Voxels, VolumeError> {
        let [nx, ny, _] = self.grid.dims;
        let mut all = allocate::zeroed::<T>(&self.path, nx * ny * wanted.len())?;
        let bricks = self.grid.within([0, 0, wanted.start], [nx, ny, wanted.end]);
        for (done, batch) in bricks.chunks(BATCH).enumerate() {
            report(&self.path, count(done * BATCH), count(bricks.len()), progress)?;
            for (&brick, voxels) in batch.iter().zip(self.decoded(batch)?) {
                let stored: &[T] = with_voxels!(&*voxels, stored => bytemuck::cast_slice(stored));
                let [low, high] = self.grid.span(brick);
                let rows = (low[2]..high[2]).flat_map(|z| (low[1]..high[1]).map(move |y| (y, z)));
                for ((y, z), voxels) in rows.zip(stored.chunks_exact(high[0] - low[0])) {
                    if wanted.contains(&z) {
                        let row = y + ny * (z - wanted.start);
                        all[nx * row + low[0]..nx * row + high[0]].copy_from_slice(voxels);
                    }
                }
            }
        }
        report(&self.path, count(bricks.len()), count(bricks.len()), progress)?;
        check_cancelled(&self.path, progress)?;
        Ok(T::into_voxels(all))
    }

    fn file(&self) -> MutexGuard<'_, File> {
        self.file.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Compares the digest of `bytes`; `what` they are, with "is" or "are".
    fn check(&self, what: &str, bytes: &[u8], expected: u32) -> Result<(), VolumeError> {
        let found = digest(bytes);
        if found == expected {
            return Ok(());
        }
        Err(damaged(&self.path, format!("{what} damaged: the digest is {found:08x}, but should be {expected:08x}")))
    }
}

/// Sides of the blocks of `dims` voxels after so many halvings.
fn block_of(dims: [usize; 3], halvings: usize) -> [usize; 3] {
    dims.map(|n| n.next_power_of_two().min(1 << halvings))
}

impl Held {
    /// Keeps `brick`, in place of the least recently used ones that are not `needed`.
    fn keep(&mut self, brick: usize, voxels: Arc<Voxels>, needed: &[usize]) {
        while self.bricks.len() >= self.counts.held {
            let others = self.bricks.iter().filter(|(brick, _)| !needed.contains(brick));
            let Some(oldest) = others.min_by_key(|(_, (_, used))| *used).map(|(&brick, _)| brick) else { break };
            self.bricks.remove(&oldest);
        }
        self.bricks.insert(brick, (voxels, self.time));
        self.counts.loaded += 1;
        self.counts.again += usize::from(std::mem::replace(&mut self.known[brick], true));
    }
}

/// Bytes of `file` from a place on.
fn read_at(file: &mut (impl Read + Seek), [first, bytes]: [u64; 2]) -> io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(first))?;
    let mut read = vec![0; usize::try_from(bytes).unwrap_or(usize::MAX)];
    file.read_exact(&mut read)?;
    Ok(read)
}

/// The `voxels` voxels of a brick in `bytes`: as they are, or LZ4 if these are fewer.
fn unpacked<T: Voxel>(bytes: &[u8], voxels: usize) -> io::Result<Vec<T>> {
    let mut stored = vec![T::zeroed(); voxels];
    let place: &mut [u8] = bytemuck::cast_slice_mut(&mut stored);
    if bytes.len() == place.len() {
        place.copy_from_slice(bytes);
    } else {
        let found = lz4_flex::block::decompress_into(bytes, place).map_err(io::Error::other)?;
        if found < place.len() {
            return Err(io::Error::other(format!("{found} bytes in place of {}", place.len())));
        }
    }
    if cfg!(target_endian = "big") {
        stored.iter_mut().for_each(|voxel| *voxel = voxel.with_bytes_swapped());
    }
    Ok(stored)
}
