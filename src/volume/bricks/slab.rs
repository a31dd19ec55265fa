//! Voxels of a slab of bricks while a file of bricks is made.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

use super::grid::{BRICK, BrickGrid};
use crate::Voxel;
use crate::stream::count;

const EDGE: usize = BRICK as usize;

/// Voxels in memory or in a temporary file.
#[derive(Debug)]
pub(super) enum Store<T> {
    InMemory(Vec<T>),
    Spilled(File),
}

impl<T: Voxel> Store<T> {
    /// Room for so many voxels: in memory, if there is as much `room`, or else in a file in `folder`.
    pub(super) fn new(voxels: usize, room: &mut u64, folder: &Path) -> io::Result<Self> {
        match room.checked_sub(count(voxels).saturating_mul(count(size_of::<T>()))) {
            Some(rest) => {
                *room = rest;
                Ok(Self::InMemory(zeroed(voxels)?))
            }
            None => Ok(Self::Spilled(tempfile::tempfile_in(folder)?)),
        }
    }

    pub(super) fn is_spilled(&self) -> bool {
        matches!(self, Self::Spilled(_))
    }

    /// Puts `voxels` at place `at`.
    pub(super) fn put(&mut self, at: usize, voxels: &[T]) -> io::Result<()> {
        match self {
            Self::InMemory(all) => all[at..at + voxels.len()].copy_from_slice(voxels),
            Self::Spilled(file) => {
                file.seek(SeekFrom::Start(count(at * size_of::<T>())))?;
                file.write_all(bytemuck::cast_slice(voxels))?;
            }
        }
        Ok(())
    }

    /// The `length` voxels from place `at` on.
    pub(super) fn get(&mut self, at: usize, length: usize) -> io::Result<Cow<'_, [T]>> {
        match self {
            Self::InMemory(all) => Ok(Cow::Borrowed(&all[at..at + length])),
            Self::Spilled(file) => {
                let mut voxels = vec![T::zeroed(); length];
                file.seek(SeekFrom::Start(count(at * size_of::<T>())))?;
                file.read_exact(bytemuck::cast_slice_mut(&mut voxels))?;
                Ok(Cow::Owned(voxels))
            }
        }
    }
}

/// So many zeros.
fn zeroed<T: Voxel>(voxels: usize) -> io::Result<Vec<T>> {
    bytemuck::try_zeroed_vec(voxels).map_err(|()| io::ErrorKind::OutOfMemory.into())
}

/// Rows of the volume, put in the order of the bricks of a slab.
#[derive(Debug)]
pub(super) struct Rows<T> {
    grid: BrickGrid,
    pub(super) store: Store<T>,
    /// Up to 64 rows of a slice, on their way to a file.
    strip: Vec<T>,
}

impl<T: Voxel> Rows<T> {
    pub(super) fn new(grid: BrickGrid, room: &mut u64, folder: &Path) -> io::Result<Self> {
        let [nx, ny, nz] = grid.dims;
        let store = Store::new(nx * ny * nz.min(EDGE), room, folder)?;
        let strip = if store.is_spilled() { zeroed(nx * ny.min(EDGE))? } else { Vec::new() };
        Ok(Self { grid, store, strip })
    }

    /// Puts a row of voxels where the bricks of the slab have it.
    pub(super) fn put(&mut self, y: usize, z: usize, row: &[T]) -> io::Result<()> {
        let [nx, ny, nz] = self.grid.dims;
        let (first_row, first_slice) = (y / EDGE * EDGE, z / EDGE * EDGE);
        let height = EDGE.min(ny - first_row);
        let depth = EDGE.min(nz - first_slice);
        for (brick, run) in row.chunks(EDGE).enumerate() {
            // Bricks before this one, in rows of bricks and in its own.
            let before = depth * (first_row * nx + brick * EDGE * height);
            if !self.store.is_spilled() {
                self.store.put(before + run.len() * (y - first_row + height * (z - first_slice)), run)?;
                continue;
            }
            let first = brick * EDGE * height;
            let at = first + run.len() * (y - first_row);
            self.strip[at..at + run.len()].copy_from_slice(run);
            if y + 1 == first_row + height {
                let place = before + run.len() * height * (z - first_slice);
                self.store.put(place, &self.strip[first..first + run.len() * height])?;
            }
        }
        Ok(())
    }
}

/// Bricks of a level, halved along each axis; up to eight of them are a brick of the coarser level.
#[derive(Debug)]
pub(super) struct Halves<T> {
    /// Bricks of the finer level.
    finer: BrickGrid,
    store: Store<T>,
    /// Place of each in the store, and the end.
    places: Vec<usize>,
}

/// Voxels along each axis of the halved brick of so many.
pub(super) fn halved_dims(dims: [usize; 3]) -> [usize; 3] {
    dims.map(|n| n.div_ceil(2))
}

impl<T: Voxel> Halves<T> {
    /// Room for those of a slab of `coarser`, the bricks over halved `finer` ones.
    pub(super) fn new([finer, coarser]: [BrickGrid; 2], room: &mut u64, folder: &Path) -> io::Result<Self> {
        let [nx, ny, nz] = coarser.dims;
        Ok(Self { finer, store: Store::new(nx * ny * nz.min(EDGE), room, folder)?, places: vec![0] })
    }

    pub(super) fn is_spilled(&self) -> bool {
        self.store.is_spilled()
    }

    /// Takes the next one.
    pub(super) fn push(&mut self, voxels: &[T]) -> io::Result<()> {
        let at = self.places.last().copied().unwrap_or(0);
        self.store.put(at, voxels)?;
        self.places.push(at + voxels.len());
        Ok(())
    }

    /// Forgets all of them: the next slab begins.
    pub(super) fn clear(&mut self) {
        self.places.truncate(1);
    }

    /// The voxels of a brick of the `coarser` level, whose slab is complete.
    pub(super) fn brick(&mut self, coarser: &BrickGrid, brick: usize) -> io::Result<Vec<T>> {
        let [first, end] = coarser.span(brick);
        let [width, height, depth] = coarser.dims_of(brick);
        let mut voxels = vec![T::zeroed(); width * height * depth];
        let [along_x, along_y, _] = self.finer.counts;
        // The store has the one or two slabs of finer bricks of this slab.
        let slab = first[2] / EDGE * 2;
        for finer in
            self.finer.within(first.map(|at| 2 * at), [0, 1, 2].map(|axis| (2 * end[axis]).min(self.finer.dims[axis])))
        {
            let low = self.finer.span(finer)[0];
            let number = finer - slab * along_x * along_y;
            let [from, to] = [self.places[number], self.places[number + 1]];
            let part = self.store.get(from, to - from)?;
            let dims = halved_dims(self.finer.dims_of(finer));
            let [x, y, z]: [usize; 3] = std::array::from_fn(|axis| low[axis] / 2 - first[axis]);
            for (row, run) in part.chunks_exact(dims[0]).enumerate() {
                let at = x + width * (y + row % dims[1] + height * (z + row / dims[1]));
                voxels[at..at + dims[0]].copy_from_slice(run);
            }
        }
        Ok(voxels)
    }
}
