//! Makes a file of bricks in one pass over its source.

use std::fs::File;
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;
use std::time::UNIX_EPOCH;

use super::cells::CellRanges;
use super::format::{Entry, FIXED, Fixed, Origin, Text, digest};
use super::grid::{BRICK, BrickGrid};
use super::{BATCH, read_at, unpacked};
use crate::parallel;
use crate::progress::Progress;
use crate::volume::data::{check_cancelled, report};
use crate::volume::statistics::{Extent, Measured, Sums, measure_counted, occurrences};
use crate::volume::stream::count;
use crate::volume::streamed::Streamed;
use crate::volume::voxels::with_type;
use crate::volume::{Selection, VolumeError, Voxel, VoxelType};

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
    /// Number of bricks.
    pub bricks: usize,
    /// Bytes of the file.
    pub bytes: u64,
    /// Whether a slab of 64 slices exceeded the memory, and was kept in a temporary file.
    pub spilled: bool,
    /// Sentences about oddities of the source.
    pub notes: Vec<String>,
}

/// Makes a file of bricks of `streamed`, which `selection` chose of the file `source`; as `volume::make_bricks`.
pub(in crate::volume) fn make(
    source: &Path,
    streamed: Streamed,
    selection: &Selection,
    (file, folder): (&File, &Path),
    budget: u64,
    progress: &dyn Progress,
) -> Result<BricksMade, MakeError> {
    let origin = origin(source, selection);
    with_type!(streamed.data.voxel_type, T => made::<T>((source, origin), streamed, (file, folder), budget, progress))
}

/// Size, time and choices of the file `source`.
fn origin(source: &Path, selection: &Selection) -> Origin {
    let metadata = std::fs::metadata(source).ok();
    let modified = metadata.as_ref().and_then(|it| it.modified().ok()?.duration_since(UNIX_EPOCH).ok());
    let chosen = [("component", selection.component), ("time", selection.time)];
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
    mut streamed: Streamed,
    (file, folder): (&File, &Path),
    budget: u64,
    progress: &dyn Progress,
) -> Result<BricksMade, MakeError> {
    let not_streamed = |reason| VolumeError::NotStreamed { source_name: source.display().to_string(), reason };
    let dims = streamed.dims.map_err(not_streamed)?;
    // Before memory is taken by the numbers of a header.
    streamed.data.check_lengths()?;
    let mut making = Making::<T>::new(BrickGrid::new(dims), (file, folder), budget)?;
    let mut failed = None;
    let read = streamed.data.read_into::<T>(progress, &mut streamed.notes, &mut |_, part| {
        making.take(part).map_err(|error| {
            failed = Some(error);
            VolumeError::Cancelled { source_name: source.display().to_string() }
        })
    });
    if let Some(error) = failed {
        return Err(error.into());
    }
    read?;
    let volume = (streamed.finish)(T::into_voxels(Vec::new()), streamed.notes)?;
    let (measured, rounded) = making.measured(source, progress)?;
    if measured.extent.finite == 0 {
        let Extent { not_a_number, infinite, .. } = measured.extent;
        let source_name = source.display().to_string();
        return Err(VolumeError::NothingFinite { source_name, not_a_number, infinite }.into());
    }
    let text = Text::of(&volume, &measured, rounded, origin).map_err(io::Error::other)?;
    let (bricks, spilled) = (making.index.len(), making.slab.is_spilled());
    let bytes = making.end(&text)?;
    Ok(BricksMade { dims, voxel_type: T::TYPE, bricks, bytes, spilled, notes: volume.notes })
}

/// The voxels of up to 64 slices in the order of their bricks.
enum Slab<T> {
    InMemory(Vec<T>),
    /// In a file, except up to 64 rows of a slice.
    Spilled {
        file: File,
        strip: Vec<T>,
    },
}

impl<T: Voxel> Slab<T> {
    fn is_spilled(&self) -> bool {
        matches!(self, Self::Spilled { .. })
    }
}

/// A brick as it is written.
struct Packed<T> {
    bytes: Vec<u8>,
    digest: u32,
    extent: Extent,
    /// Number of voxels of each value, if these are few.
    occurrences: Option<Vec<(T, u64)>>,
    rounded: f64,
}

/// A cache that is being made.
struct Making<'a, T> {
    grid: BrickGrid,
    file: &'a File,
    written: BufWriter<&'a File>,
    /// Bytes written.
    at: u64,
    slab: Slab<T>,
    /// Voxels of an incomplete row.
    rest: Vec<T>,
    /// Complete rows so far.
    rows: usize,
    cells: CellRanges<T>,
    index: Vec<Entry>,
    extent: Extent,
    /// Number of voxels of each value of one or two bytes, by the lower 16 bits of the value.
    counts: Vec<u64>,
    rounded: f64,
}

impl<'a, T: Voxel> Making<'a, T> {
    fn new(grid: BrickGrid, (file, folder): (&'a File, &Path), budget: u64) -> io::Result<Self> {
        let [nx, ny, nz] = grid.dims;
        let slab = nx * ny * nz.min(EDGE);
        let slab = if count(slab * size_of::<T>()) <= budget {
            Slab::InMemory(vec![T::zeroed(); slab])
        } else {
            Slab::Spilled { file: tempfile::tempfile_in(folder)?, strip: vec![T::zeroed(); nx * ny.min(EDGE)] }
        };
        let mut written = BufWriter::new(file);
        written.write_all(&[0; FIXED])?;
        Ok(Self {
            grid,
            file,
            written,
            at: count(FIXED),
            slab,
            rest: Vec::new(),
            rows: 0,
            cells: CellRanges::new(grid.dims),
            index: Vec::new(),
            extent: Extent::EMPTY,
            counts: vec![0; 1 << 16],
            rounded: 0.0,
        })
    }

    /// Takes the next voxels.
    fn take(&mut self, mut part: &[T]) -> io::Result<()> {
        let nx = self.grid.dims[0];
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
        self.cells.add(self.rows, rows);
        let [nx, ny, nz] = self.grid.dims;
        for row in rows.chunks_exact(nx) {
            let (y, z) = (self.rows % ny, self.rows / ny);
            self.put(y, z, row)?;
            self.rows += 1;
            if y + 1 == ny && (z % EDGE + 1 == EDGE || z + 1 == nz) {
                self.write_slab(z / EDGE)?;
            }
        }
        Ok(())
    }

    /// Puts a row of voxels where the bricks of the slab have it.
    fn put(&mut self, y: usize, z: usize, row: &[T]) -> io::Result<()> {
        let [nx, ny, nz] = self.grid.dims;
        let (first_row, first_slice) = (y / EDGE * EDGE, z / EDGE * EDGE);
        let height = EDGE.min(ny - first_row);
        let depth = EDGE.min(nz - first_slice);
        for (brick, run) in row.chunks(EDGE).enumerate() {
            // Bricks before this one, in rows of bricks and in its own.
            let before = depth * (first_row * nx + brick * EDGE * height);
            match &mut self.slab {
                Slab::InMemory(voxels) => {
                    let at = before + run.len() * (y - first_row + height * (z - first_slice));
                    voxels[at..at + run.len()].copy_from_slice(run);
                }
                Slab::Spilled { file, strip } => {
                    let first = brick * EDGE * height;
                    let at = first + run.len() * (y - first_row);
                    strip[at..at + run.len()].copy_from_slice(run);
                    if y + 1 == first_row + height {
                        let place = before + run.len() * height * (z - first_slice);
                        file.seek(SeekFrom::Start(count(place * size_of::<T>())))?;
                        file.write_all(bytemuck::cast_slice(&strip[first..first + run.len() * height]))?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Packs and writes the bricks of a slab.
    fn write_slab(&mut self, slab: usize) -> io::Result<()> {
        let [width, height, _] = self.grid.counts;
        let bricks: Vec<usize> = (slab * width * height..(slab + 1) * width * height).collect();
        let mut first = 0;
        for batch in bricks.chunks(BATCH) {
            let sizes: Vec<usize> = batch.iter().map(|&brick| self.grid.voxels(brick)).collect();
            let length = sizes.iter().sum::<usize>();
            let mut spilled = Vec::new();
            let mut voxels: &[T] = match &mut self.slab {
                Slab::InMemory(voxels) => &voxels[first..first + length],
                Slab::Spilled { file, .. } => {
                    spilled.resize(length, T::zeroed());
                    file.seek(SeekFrom::Start(count(first * size_of::<T>())))?;
                    file.read_exact(bytemuck::cast_slice_mut(&mut spilled))?;
                    &spilled
                }
            };
            let mut parts = Vec::with_capacity(batch.len());
            for size in sizes {
                let (part, rest) = voxels.split_at(size);
                parts.push(part);
                voxels = rest;
            }
            let packed = parallel::map(parts.len(), &|part| pack(parts[part]));
            first += length;
            for brick in packed {
                self.write(brick)?;
            }
        }
        Ok(())
    }

    fn write(&mut self, brick: Packed<T>) -> io::Result<()> {
        let Packed { bytes, digest, extent, occurrences, rounded } = brick;
        self.written.write_all(&bytes)?;
        let length = u32::try_from(bytes.len()).map_err(io::Error::other)?;
        let ends = if extent.finite > 0 { [extent.min, extent.max] } else { [f64::NAN; 2] };
        self.index.push(Entry { offset: self.at, bytes: length, digest, ends });
        self.at += u64::from(length);
        self.extent = self.extent.join(&extent);
        for (value, number) in occurrences.into_iter().flatten() {
            self.counts[low_bits(value)] += number;
        }
        self.rounded = self.rounded.max(rounded);
        Ok(())
    }

    /// Statistics of the stored values, and their largest rounding error as f64. Values of more than two bytes are read once
    /// more, since the bins of the histogram follow from all of them.
    fn measured(&mut self, source: &Path, progress: &dyn Progress) -> Result<(Measured, f64), MakeError> {
        if size_of::<T>() <= 2 {
            let numbers = self.counts.iter().zip(0..=u16::MAX).filter(|(number, _)| **number > 0);
            let values: Vec<(T, u64)> = numbers.map(|(&number, bits)| (of_low_bits(bits), number)).collect();
            return Ok((Measured::of(measure_counted(&values)), self.rounded));
        }
        self.written.flush()?;
        let mut file = self.file;
        let mut sums = Sums::EMPTY;
        let mut first = 0;
        for batch in self.index.chunks(BATCH) {
            check_cancelled(source, progress)?;
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
            report(source, count(first), count(self.index.len()), progress)?;
        }
        Ok((Measured::of((self.extent, sums)), self.rounded))
    }

    /// Writes what follows the bricks, and the header; returns the bytes of the file.
    fn end(mut self, text: &str) -> io::Result<u64> {
        let cells = self.cells.to_bytes();
        let (fixed, behind) = Fixed::made(self.at, text, &self.index, &cells);
        self.written.seek(SeekFrom::Start(self.at))?;
        self.written.write_all(&behind)?;
        self.written.write_all(&cells)?;
        self.written.seek(SeekFrom::Start(0))?;
        self.written.write_all(&fixed)?;
        self.written.flush()?;
        Ok(self.at + count(behind.len()) + count(cells.len()))
    }
}

/// Packs the voxels of a brick: LZ4, or as they are if that is not longer.
fn pack<T: Voxel>(voxels: &[T]) -> Packed<T> {
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
    Packed {
        digest: digest(&bytes),
        bytes,
        extent: Extent::of(voxels.iter().map(|&voxel| (voxel, 1))),
        occurrences: occurrences(voxels),
        rounded: if size_of::<T>() == 8 { voxels.iter().map(off).fold(0.0, f64::max) } else { 0.0 },
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
