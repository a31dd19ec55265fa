//! Makes a file of bricks in one pass over its source.

use std::fs::File;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::UNIX_EPOCH;

use super::cells::{BoxRanges, CellRanges, macrocells};
use super::format::{Entry, FIXED, Fixed, LevelMade, Origin, Text, digest};
use super::grid::{BRICK, BrickGrid};
use super::slab::{Halves, Rows};
use super::{BATCH, read_at, unpacked};
use crate::data::{Data, Take, check_cancelled, report};
use crate::resample::of_blocks;
use crate::slabs::Slabs;
use crate::statistics::{Extent, Measured, Sums, measure_counted, occurrences};
use crate::stream::count;
use crate::streamed::Streamed;
use crate::voxels::{float_of_half, with_type};
use crate::{Selection, Volume, VolumeError, Voxel, VoxelType};
use relume_base::progress::{Progress, Quiet};
use relume_base::{memory, parallel};

const EDGE: usize = BRICK as usize;

/// Why no cache was made.
#[derive(Debug, thiserror::Error)]
pub enum MakeError {
    /// The source cannot be read, or not slice by slice.
    #[error(transparent)]
    Volume(#[from] VolumeError),
    /// The cache cannot be written.
    #[error("the bricks cannot be written")]
    Write(#[from] io::Error),
}

/// A cache that was made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BricksMade {
    /// Voxels along each axis.
    pub dims: [usize; 3],
    /// Type of the voxels.
    pub voxel_type: VoxelType,
    /// Number of bricks of level 0.
    pub bricks: usize,
    /// Voxels along each axis of each level of resolution, the finest first.
    pub levels: Vec<[usize; 3]>,
    /// Bytes of the file.
    pub bytes: u64,
    /// Whether 64 slices of each level exceeded the memory, and some were kept in temporary files.
    pub spilled: bool,
    /// Sentences about oddities of the source.
    pub notes: Vec<String>,
}

/// A volume before its voxels are read.
pub(crate) enum Input {
    /// Voxels in the order of their file.
    Stream(Streamed),
    /// Slices, some at a time, and the volume without voxels.
    Slabs(Box<Slabs>, Box<Volume>),
}

/// The voxels of a volume.
enum Source {
    /// Numbers of a file, and whether they are floats of 16 bits.
    Stream(Data, bool),
    /// So many slices at a time.
    Slabs(Box<Slabs>, usize),
}

impl Source {
    /// Hands the voxels to `take`, in order.
    fn read_into<T: Voxel>(
        &self,
        progress: &dyn Progress,
        notes: &mut Vec<String>,
        take: Take<'_, T>,
    ) -> Result<(), VolumeError> {
        match self {
            Self::Stream(data, false) => data.read_into::<T>(progress, notes, take),
            Self::Stream(data, true) => {
                let mut floats = Vec::new();
                data.read_into::<u16>(progress, notes, &mut |first, halves| {
                    floats.clear();
                    floats.extend(halves.iter().map(|&bits| float_of_half(bits)));
                    take(first, bytemuck::cast_slice(&floats))
                })
            }
            Self::Slabs(slabs, slices) => slabs.read_into::<T>(*slices, progress, notes, take),
        }
    }
}

/// Makes a file of bricks of `input`, which `selection` chose of the file or folder `source`; as `volume::make_bricks`.
pub(crate) fn make(
    source: &Path,
    input: Input,
    selection: &Selection,
    out: (&File, &Path),
    budget: u64,
    progress: &dyn Progress,
) -> Result<BricksMade, MakeError> {
    let origin = origin(source, selection);
    let (volume, voxels, budget) = match input {
        Input::Stream(streamed) => {
            let not_streamed = |reason| VolumeError::NotStreamed { source_name: source.display().to_string(), reason };
            streamed.dims.map_err(not_streamed)?;
            // Before memory is taken by the numbers of a header.
            streamed.data.check_lengths()?;
            let none = streamed.voxel_type().no_voxels();
            let volume = (streamed.finish)(none, streamed.notes)?;
            (volume, Source::Stream(streamed.data, streamed.halves), budget)
        }
        Input::Slabs(slabs, volume) => {
            let (slices, bytes) = slabs.at_once(budget);
            (*volume, Source::Slabs(slabs, slices), budget.saturating_sub(bytes))
        }
    };
    with_type!(volume.voxels.voxel_type(), T => made::<T>((source, origin), (volume, &voxels), out, budget, progress))
}

/// Size, time and choices of the file `source`.
fn origin(source: &Path, selection: &Selection) -> Origin {
    let metadata = std::fs::metadata(source).ok();
    let modified = metadata.as_ref().and_then(|it| it.modified().ok()?.duration_since(UNIX_EPOCH).ok());
    let chosen = [("component", selection.component), ("time", selection.time), ("level", selection.level)];
    let chosen = chosen.into_iter().filter_map(|(name, number)| Some(format!(", {name} {}", number?)));
    Origin {
        path: source.display().to_string(),
        bytes: metadata.map_or(0, |it| it.len()),
        modified: modified.map_or(0, |time| time.as_secs()),
        chosen: chosen.collect(),
    }
}

fn made<T: Voxel>(
    (source, origin): (&Path, Origin),
    (mut volume, voxels): (Volume, &Source),
    (file, folder): (&File, &Path),
    budget: u64,
    progress: &dyn Progress,
) -> Result<BricksMade, MakeError> {
    let dims = volume.geometry.dims;
    let name = source.display().to_string();
    // A file whose coarsest spacing is no number could not be opened.
    (1..BrickGrid::levels(dims).len()).try_fold(volume.geometry, |finer, _| finer.halved(&name))?;
    // Twice: as ranges, and as the bytes of them.
    let cells =
        BrickGrid::levels(dims).iter().map(|grid| 2 * count(CellRanges::bytes(macrocells(grid.dims), T::TYPE))).sum();
    if memory::available_bytes().is_some_and(|free| cells > free) {
        return Err(VolumeError::Memory { source_name: source.display().to_string(), bytes: cells }.into());
    }
    let mut making = Making::<T>::new(BrickGrid::levels(dims), volume.has_labels, (file, folder), budget)?;
    let mut failed = None;
    let mut notes = std::mem::take(&mut volume.notes);
    let read = voxels.read_into::<T>(progress, &mut notes, &mut |_, part| {
        making.take(part).map_err(|error| {
            failed = Some(error);
            VolumeError::Cancelled { source_name: source.display().to_string() }
        })
    });
    if let Some(error) = failed {
        return Err(error.into());
    }
    read?;
    volume.notes = notes;
    let extent = making.levels[0].extent;
    if extent.finite == 0 {
        let Extent { not_a_number, infinite, .. } = extent;
        let source_name = source.display().to_string();
        return Err(VolumeError::NothingFinite { source_name, not_a_number, infinite }.into());
    }
    let (levels, cells) = making.measured(source, progress)?;
    let text = Text::of(&volume, &levels, origin).map_err(io::Error::other)?;
    let (bricks, spilled) = (making.levels[0].index.len(), making.is_spilled());
    let bytes = making.end(&text, &cells)?;
    let levels = levels.iter().map(|level| level.dims).collect();
    // A warning of this run is not one of the volume.
    let warning = match voxels {
        Source::Slabs(slabs, slices) => slabs.warning(*slices),
        Source::Stream(..) => None,
    };
    let notes = volume.notes.into_iter().chain(warning).collect();
    Ok(BricksMade { dims, voxel_type: T::TYPE, bricks, levels, bytes, spilled, notes })
}

/// A brick as it is written.
struct Packed<T> {
    bytes: Vec<u8>,
    digest: u32,
    extent: Extent,
    /// Number of voxels of each value, if these are few.
    occurrences: Option<Vec<(T, u64)>>,
    /// Ranges of the macrocells that it touches.
    cells: BoxRanges<T>,
    rounded: f64,
    /// Its voxels, halved along each axis, if there is a coarser level.
    halved: Vec<T>,
}

/// A cache that is being made.
struct Making<'a, T> {
    file: &'a File,
    written: BufWriter<&'a File>,
    /// Bytes written.
    at: u64,
    /// The slab of level 0.
    slab: Rows<T>,
    /// Voxels of an incomplete row.
    rest: Vec<T>,
    /// Complete rows so far.
    rows: usize,
    /// The levels of resolution, the finest first.
    levels: Vec<Level<T>>,
    labels: bool,
}

/// A level that is being made.
struct Level<T> {
    grid: BrickGrid,
    cells: CellRanges<T>,
    index: Vec<Entry>,
    extent: Extent,
    /// Number of voxels of each value of one or two bytes, by the lower 16 bits of the value.
    counts: Vec<u64>,
    rounded: f64,
    /// Halved bricks of this level, for the coarser one.
    halves: Option<Halves<T>>,
}

impl<'a, T: Voxel> Making<'a, T> {
    fn new(
        grids: Vec<BrickGrid>,
        labels: bool,
        (file, folder): (&'a File, &Path),
        budget: u64,
    ) -> Result<Self, MakeError> {
        let mut room = budget;
        let mut levels = Vec::with_capacity(grids.len());
        // The coarsest first: most slabs are small, and remain in memory.
        for (number, &grid) in grids.iter().enumerate().rev() {
            let coarser = grids.get(number + 1);
            levels.push(Level {
                grid,
                cells: CellRanges::new(grid.dims),
                index: Vec::new(),
                extent: Extent::EMPTY,
                counts: vec![0; if size_of::<T>() <= 2 { 1 << 16 } else { 0 }],
                rounded: 0.0,
                halves: coarser.map(|&coarser| Halves::new([grid, coarser], &mut room, folder)).transpose()?,
            });
        }
        levels.reverse();
        let slab = Rows::new(grids[0], &mut room, folder)?;
        let mut written = BufWriter::new(file);
        written.write_all(&[0; FIXED])?;
        Ok(Self { file, written, at: count(FIXED), slab, rest: Vec::new(), rows: 0, levels, labels })
    }

    fn is_spilled(&self) -> bool {
        let mut halves = self.levels.iter().filter_map(|level| level.halves.as_ref());
        self.slab.store.is_spilled() || halves.any(Halves::is_spilled)
    }

    /// Takes the next voxels.
    fn take(&mut self, mut part: &[T]) -> io::Result<()> {
        let nx = self.levels[0].grid.dims[0];
        if !self.rest.is_empty() {
            let (more, behind) = part.split_at(part.len().min(nx - self.rest.len()));
            self.rest.extend_from_slice(more);
            part = behind;
            if self.rest.len() < nx {
                return Ok(());
            }
            let row = std::mem::take(&mut self.rest);
            self.take_rows(&row)?;
        }
        let (rows, rest) = part.split_at(part.len() / nx * nx);
        self.rest.extend_from_slice(rest);
        self.take_rows(rows)
    }

    fn take_rows(&mut self, rows: &[T]) -> io::Result<()> {
        if rows.is_empty() {
            return Ok(());
        }
        let [nx, ny, nz] = self.levels[0].grid.dims;
        for row in rows.chunks_exact(nx) {
            let (y, z) = (self.rows % ny, self.rows / ny);
            self.slab.put(y, z, row)?;
            self.rows += 1;
            if y + 1 == ny && (z % EDGE + 1 == EDGE || z + 1 == nz) {
                self.write_slab(0, z / EDGE)?;
            }
        }
        Ok(())
    }

    /// Packs and writes the bricks of a slab of a level, and those of the coarser levels that are complete with it.
    fn write_slab(&mut self, level: usize, slab: usize) -> io::Result<()> {
        let grid = self.levels[level].grid;
        let bricks: Vec<usize> = grid.of_slab(slab).collect();
        let labels = (level + 1 < self.levels.len()).then_some(self.labels);
        let packed = |brick: usize, voxels: &[T]| pack(voxels, &grid, brick, labels);
        let mut first = 0;
        for batch in bricks.chunks(BATCH) {
            let batch_packed = if let Some(finer) = level.checked_sub(1) {
                let Some(halves) = &mut self.levels[finer].halves else { return Ok(()) };
                let gathered =
                    batch.iter().map(|&brick| halves.brick(&grid, brick)).collect::<io::Result<Vec<Vec<T>>>>()?;
                parallel::map(batch.len(), &|part| packed(batch[part], &gathered[part]))
            } else {
                let sizes = batch.iter().map(|&brick| grid.voxels(brick));
                let voxels = self.slab.store.get(first, sizes.clone().sum())?;
                first += voxels.len();
                let mut rest = &*voxels;
                let mut parts = Vec::with_capacity(batch.len());
                for size in sizes {
                    let (part, behind) = rest.split_at(size);
                    parts.push(part);
                    rest = behind;
                }
                parallel::map(batch.len(), &|part| packed(batch[part], parts[part]))
            };
            for packed in batch_packed {
                self.write(level, packed)?;
            }
        }
        if let Some(halves) = level.checked_sub(1).and_then(|finer| self.levels[finer].halves.as_mut()) {
            halves.clear();
        }
        if labels.is_some() && grid.ends_coarser(slab) { self.write_slab(level + 1, slab / 2) } else { Ok(()) }
    }

    fn write(&mut self, level: usize, packed: Packed<T>) -> io::Result<()> {
        let Packed { bytes, digest, extent, occurrences, cells, rounded, halved } = packed;
        self.written.write_all(&bytes)?;
        let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        let ends = if extent.finite > 0 { [extent.min, extent.max] } else { [f64::NAN; 2] };
        let of_level = &mut self.levels[level];
        of_level.index.push(Entry { offset: self.at, bytes: length, digest, ends });
        self.at += u64::from(length);
        of_level.extent = of_level.extent.join(&extent);
        for (value, number) in occurrences.into_iter().flatten() {
            of_level.counts[low_bits(value)] += number;
        }
        of_level.cells.join(&cells);
        of_level.rounded = of_level.rounded.max(rounded);
        match &mut of_level.halves {
            Some(halves) => halves.push(&halved),
            None => Ok(()),
        }
    }

    /// The levels and the bytes of their macrocells. Values of more than two bytes are read once more, since the bins of the
    /// histogram follow from all of them.
    fn measured(
        &mut self,
        source: &Path,
        progress: &dyn Progress,
    ) -> Result<(Vec<LevelMade>, Vec<Vec<u8>>), MakeError> {
        self.written.flush()?;
        let all = self.levels.iter().map(|level| count(level.index.len())).sum();
        let mut done = 0;
        let (mut levels, mut cells) = (Vec::new(), Vec::new());
        for level in &mut self.levels {
            let measured = level.measured(self.file, &mut |bricks| {
                done += count(bricks);
                report(source, done, all, progress)
            });
            cells.push(level.cells.to_bytes());
            levels.push(LevelMade {
                dims: level.grid.dims,
                measured: measured?,
                rounded: level.rounded,
                cells: digest(&cells[cells.len() - 1]),
            });
        }
        check_cancelled(source, progress)?;
        Ok((levels, cells))
    }

    /// Writes what follows the bricks, and the header; returns the bytes of the file.
    fn end(mut self, text: &str, cells: &[Vec<u8>]) -> io::Result<u64> {
        let index: Vec<Entry> = self.levels.iter().flat_map(|level| level.index.iter().copied()).collect();
        let (fixed, behind) = Fixed::made(self.at, text, &index, cells);
        self.written.seek(SeekFrom::Start(self.at))?;
        self.written.write_all(&behind)?;
        for cells in cells {
            self.written.write_all(cells)?;
        }
        self.written.seek(SeekFrom::Start(0))?;
        self.written.write_all(&fixed)?;
        self.written.flush()?;
        Ok(self.at + count(behind.len()) + cells.iter().map(|cells| count(cells.len())).sum::<u64>())
    }
}

impl<T: Voxel> Level<T> {
    /// Statistics of the stored values in the bricks of `file`; `read` is told the number of bricks that were read again.
    fn measured(
        &self,
        mut file: &File,
        read: &mut dyn FnMut(usize) -> Result<(), VolumeError>,
    ) -> Result<Measured, MakeError> {
        if size_of::<T>() <= 2 {
            let numbers = self.counts.iter().zip(0..=u16::MAX).filter(|(number, _)| **number > 0);
            let values: Vec<(T, u64)> = numbers.map(|(&number, bits)| (of_low_bits(bits), number)).collect();
            return Ok(Measured::of(measure_counted(&values)));
        }
        let mut sums = Sums::EMPTY;
        let mut first = 0;
        for batch in self.index.chunks(BATCH) {
            let bytes: Vec<Vec<u8>> = batch
                .iter()
                .map(|entry| read_at(&mut file, [entry.offset, entry.bytes.into()]))
                .collect::<io::Result<_>>()?;
            let of_brick = |brick: usize| -> io::Result<Sums> {
                let voxels = unpacked::<T>(&bytes[brick], self.grid.voxels(first + brick))?;
                Ok(Sums::of(voxels.into_iter().map(|voxel| (voxel, 1)), &self.extent))
            };
            let of_bricks = parallel::map(bytes.len(), &of_brick).into_iter().collect::<io::Result<Vec<_>>>()?;
            sums = of_bricks.iter().fold(sums, Sums::join);
            first += batch.len();
            read(batch.len())?;
        }
        Ok(Measured::of((self.extent, sums)))
    }
}

/// Packs the voxels of a brick of `grid`: LZ4, or as they are if that is not longer.
///
/// They are halved along each axis if there is a coarser level; then `labels` says whether they are labels.
fn pack<T: Voxel>(voxels: &[T], grid: &BrickGrid, brick: usize, labels: Option<bool>) -> Packed<T> {
    let (first, dims) = (grid.span(brick)[0], grid.dims_of(brick));
    let swapped: Vec<T> = if cfg!(target_endian = "big") {
        voxels.iter().map(|voxel| voxel.with_bytes_swapped()).collect()
    } else {
        Vec::new()
    };
    let raw: &[u8] = bytemuck::cast_slice(if swapped.is_empty() { voxels } else { &swapped });
    let mut bytes = lz4_flex::block::compress(raw);
    if bytes.len() >= raw.len() {
        bytes = raw.to_vec();
    }
    let off = |voxel: &T| voxel.to_whole().map_or(0.0, |exact| rounding(exact, voxel.to_f64()));
    let occurrences = occurrences(voxels);
    Packed {
        digest: digest(&bytes),
        bytes,
        extent: match &occurrences {
            Some(values) => Extent::of(values.iter().copied()),
            None => Extent::of(voxels.iter().map(|&voxel| (voxel, 1))),
        },
        occurrences,
        cells: BoxRanges::of(grid.dims, first, dims, voxels),
        rounded: if size_of::<T>() == 8 { voxels.iter().map(off).fold(0.0, f64::max) } else { 0.0 },
        halved: labels.map_or_else(Vec::new, |labels| of_blocks(voxels, dims, [2; 3], labels, &Quiet)),
    }
}

/// Difference of a whole number and the float to which it was rounded.
#[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "whole, and few digits are enough")]
pub(super) fn rounding(exact: i128, rounded: f64) -> f64 {
    exact.abs_diff(rounded as i128) as f64
}

/// The lower 16 bits of a whole number of at most 16 bits.
fn low_bits<T: Voxel>(value: T) -> usize {
    usize::try_from(value.to_whole().unwrap_or(0).rem_euclid(1 << 16)).unwrap_or(0)
}

/// The number of one or two bytes with these lower 16 bits.
fn of_low_bits<T: Voxel>(bits: u16) -> T {
    let positive = T::nearest(f64::from(bits));
    if low_bits(positive) == usize::from(bits) { positive } else { T::nearest(f64::from(bits) - 65536.0) }
}
