//! Voxels of an array: its chunks, decoded in parallel, and laid into the volume.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::Met;
use super::array::{Array, Keys};
use super::codecs::{self, Decoder};
use super::node::wrong;
use crate::axes::Arranged;
use crate::data;
use crate::readers::tiles::{self, Block, Grid};
use crate::readers::type_string::Kind;
use crate::stream::{self, DEFLATE_LIMIT, count};
use crate::voxels::{bytes_of_floats, with_type};
use crate::{VolumeError, Voxel, VoxelType, Voxels, allocate};
use relume_base::parallel;
use relume_base::progress::Progress;

/// Bytes of decoded chunks that wait for their place in the volume.
const WAITING: usize = 16 << 20;
/// Bytes of voxels that are allocated before a chunk has been decoded.
const UNPROVEN: u64 = 32 << 20;
/// Chunks per file of a store, at most: a store with fewer files is incomplete.
const SPARSEST: u64 = 4096;
/// Chunks that are looked for under another name, at most.
const MOST_TRIED: u64 = 100_000;

/// Reads the voxels of the `slices` of the channel and time `chosen`.
pub(super) fn read(
    array: &Array,
    arranged: &Arranged,
    (chosen, slices): ([usize; 2], &Range<usize>),
    source: &Path,
    progress: &dyn Progress,
) -> Result<(Voxels, Met), VolumeError> {
    let region = tiles::region(arranged, chosen, slices);
    let (keys, separator) = keys(array, &region, source, progress)?;
    let renamed;
    let array = if separator.is_some() {
        renamed = Array { keys, ..array.clone() };
        &renamed
    } else {
        array
    };
    let unit = array.shard.as_ref().map_or(&array.chunks, |shard| &shard.chunks);
    let decoder = Decoder::new(&array.coding, unit, array.voxel_type)
        .map_err(|error| wrong(&array.file, "codecs", error.to_string()))?;
    let reading = Reading { array, arranged, region, unit, decoder, source, progress };
    with_type!(if array.kind == Kind::Half { VoxelType::F32 } else { array.voxel_type }, T => {
        let (voxels, missing) = reading.read::<T>()?;
        Ok((T::into_voxels(voxels), Met { missing, separator }))
    })
}

/// Names of the chunks in a region of `array`: those of the metadata, or else, if there are none, those with the other
/// separator, which is also returned.
///
/// # Errors
///
/// [`VolumeError::Field`] if the array has no chunk at all: an incomplete copy is no volume of zeros.
fn keys(
    array: &Array,
    region: &[[usize; 2]],
    source: &Path,
    progress: &dyn Progress,
) -> Result<(Keys, Option<char>), VolumeError> {
    let grid = Grid::over(region, &array.chunks);
    let any = |keys: Keys| -> Result<bool, VolumeError> {
        for number in 0..grid.len().min(MOST_TRIED) {
            if number.is_multiple_of(1024) {
                data::check_cancelled(source, progress)?;
            }
            if array.path.join(keys.name(&grid.indices(number))).exists() {
                return Ok(true);
            }
        }
        Ok(false)
    };
    if grid.len() == 0 || any(array.keys)? {
        return Ok((array.keys, None));
    }
    let other = array.keys.with_other_separator();
    if any(other)? {
        return Ok((other, Some(other.separator())));
    }
    if files_below(&array.path, &|name| !name.starts_with('.') && name != "zarr.json")? > 0 {
        return Ok((array.keys, None));
    }
    let first: Vec<usize> = vec![0; array.shape.len()];
    let chunks = array.shape.iter().zip(&array.chunks).map(|(side, chunk)| side.div_ceil(*chunk)).product::<usize>();
    let are = if chunks == 1 { "its chunk is" } else { "none of its chunks is" };
    let problem = format!(
        "{are} there ({chunks} by the metadata, the first one called {}), so that all voxels would have the fill value; the store \
         is incomplete, so copy it again",
        array.keys.name(&first)
    );
    Err(wrong(&array.path, "chunks", problem))
}

/// The numbers that are read of an array.
struct Reading<'a> {
    array: &'a Array,
    arranged: &'a Arranged,
    /// First and end index along each axis of the array.
    region: Vec<[usize; 2]>,
    /// Lengths of the chunks that are decoded: chunks, or those inside shards.
    unit: &'a [usize],
    decoder: Decoder,
    source: &'a Path,
    progress: &'a dyn Progress,
}

/// A coded chunk.
struct Coded {
    path: Arc<PathBuf>,
    /// Its part of the file, if it is in a shard.
    part: Option<(u64, u64)>,
    /// Index of its first number along each axis.
    start: Vec<usize>,
}

impl Coded {
    fn damaged(&self, encoding: &'static str, source: io::Error) -> VolumeError {
        let place = format!("chunk from voxel {:?} (slowest axis first)", self.start);
        VolumeError::DamagedPart { path: self.path.to_path_buf(), place, encoding, source }
    }
}

impl Reading<'_> {
    fn read<T: Voxel>(&self) -> Result<(Vec<T>, u64), VolumeError> {
        let grid = Grid::over(&self.region, &self.array.chunks);
        let there = self.there(&grid)?;
        let dims = tiles::dims(self.arranged, &self.region);
        let voxels: usize = dims.iter().product();
        let bytes = count(voxels).saturating_mul(count(size_of::<T>()));
        let solid = there.iter().fold(0_u64, |sum, (_, bytes)| sum.saturating_add(*bytes));
        // Few or very dense chunks may hold less than they state: then all of them are decoded before the allocation.
        if bytes > UNPROVEN.max(solid.saturating_mul(2)) {
            self.each(&grid, &there, |_| Ok(()))?;
        }
        let mut volume = allocate::zeroed::<T>(self.source, voxels)?;
        let halves = self.array.kind == Kind::Half;
        let fill = if halves { bytes_of_floats(&self.array.fill) } else { self.array.fill.clone() };
        let fill = bytemuck::pod_read_unaligned::<T>(&fill);
        if self.array.fill.iter().any(|&byte| byte != 0) {
            volume.fill(fill);
        }
        let done = AtomicU64::new(0);
        let missing = self.each(&grid, &there, |blocks| {
            tiles::lay(self.arranged, &self.region, blocks, &mut volume);
            let now = done.fetch_add(blocks.iter().map(|block| count(block.bytes.len())).sum(), Ordering::Relaxed);
            data::report(self.source, now.min(bytes), bytes, self.progress)
        })?;
        data::report(self.source, bytes, bytes, self.progress)?;
        Ok((volume, missing + (grid.len() - count(there.len()))))
    }

    fn chunk(&self, indices: &[usize]) -> PathBuf {
        self.array.path.join(self.array.keys.name(indices))
    }

    /// Numbers of the chunks that are there, in the order of `grid`, with the bytes of voxels they may hold.
    fn there(&self, grid: &Grid) -> Result<Vec<(u64, u64)>, VolumeError> {
        let all = grid.len();
        if all > SPARSEST {
            let files = count(files_below(&self.array.path, &|_| true)?);
            if all / SPARSEST > files {
                let problem =
                    format!("{files} files are there, but the array has {all} chunks; the store is incomplete");
                return Err(wrong(&self.array.path, "chunks", problem));
            }
        }
        let most = self
            .array
            .chunks
            .iter()
            .fold(count(self.array.voxel_type.bytes()), |bytes, &side| bytes.saturating_mul(count(side)));
        let one = |number: u64| {
            let check = || data::check_cancelled(self.source, self.progress);
            if let Err(error) = check() {
                return Some(Err(error));
            }
            let path = self.chunk(&grid.indices(number));
            let metadata = match std::fs::metadata(&path) {
                Ok(metadata) => metadata,
                Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
                Err(source) => return Some(Err(stream::failed(&path, source))),
            };
            let held =
                metadata.len().saturating_mul(if self.array.coding.packed.is_empty() { 1 } else { DEFLATE_LIMIT });
            Some(Ok((number, held.min(most))))
        };
        parallel::map(usize::try_from(all).unwrap_or(usize::MAX), &|number| one(count(number)))
            .into_iter()
            .flatten()
            .collect()
    }

    /// Decodes the chunks `there`, some at a time, and hands them on. Returns the number of chunks that are not in their
    /// shards.
    fn each(
        &self,
        grid: &Grid,
        there: &[(u64, u64)],
        mut take: impl FnMut(&[Block]) -> Result<(), VolumeError>,
    ) -> Result<u64, VolumeError> {
        let at_once = rayon::current_num_threads().max(WAITING / self.decoder.bytes().max(1)).max(1);
        let (mut waiting, mut missing) = (Vec::new(), 0);
        let mut decode = |waiting: &mut Vec<Coded>| {
            let blocks = parallel::map(waiting.len(), &|index| self.decoded(&waiting[index]));
            take(&blocks.into_iter().collect::<Result<Vec<_>, _>>()?)?;
            waiting.clear();
            data::check_cancelled(self.source, self.progress)
        };
        for &(number, _) in there {
            let indices = grid.indices(number);
            let path = Arc::new(self.chunk(&indices));
            let start: Vec<usize> =
                indices.iter().zip(&self.array.chunks).map(|(index, length)| index * length).collect();
            if self.array.shard.is_none() {
                waiting.push(Coded { path, part: None, start });
            } else {
                missing += self.parts(&path, &start, |coded| {
                    waiting.push(coded);
                    if waiting.len() >= at_once { decode(&mut waiting) } else { Ok(()) }
                })?;
            }
            if waiting.len() >= at_once {
                decode(&mut waiting)?;
            }
        }
        decode(&mut waiting)?;
        Ok(missing)
    }

    /// Hands on the chunks of the shard `path` that are read; returns the number of those that are not there.
    fn parts(
        &self,
        path: &Arc<PathBuf>,
        start: &[usize],
        mut take: impl FnMut(Coded) -> Result<(), VolumeError>,
    ) -> Result<u64, VolumeError> {
        let Some(shard) = &self.array.shard else { return Ok(0) };
        let sides: Vec<usize> = self.array.chunks.iter().zip(self.unit).map(|(outer, inner)| outer / inner).collect();
        let chunks = sides.iter().product();
        let damaged = |source| {
            let place = "index of the shard".to_owned();
            VolumeError::DamagedPart { path: path.to_path_buf(), place, encoding: "sharding_indexed", source }
        };
        let mut file = stream::open(path)?;
        let length = file.metadata().map_err(|source| stream::failed(path, source))?.len();
        let bytes = codecs::index_bytes(shard, chunks);
        let Some(at_end) = length.checked_sub(bytes) else {
            return Err(damaged(io::Error::other(format!("the file has {length} bytes, but its index has {bytes}"))));
        };
        let at = if shard.index_is_first { 0 } else { at_end };
        let coded = part(&mut file, (at, bytes)).map_err(|source| stream::failed(path, source))?;
        let entries = crate::readers::guard::guarded(|| codecs::index(shard, chunks, coded)).map_err(damaged)?;
        // The part of the shard that is read.
        let region: Vec<[usize; 2]> = self
            .region
            .iter()
            .zip(start)
            .zip(&self.array.chunks)
            .map(|((&[first, end], &start), &length)| [first.saturating_sub(start), (end - start.min(end)).min(length)])
            .collect();
        let (grid, mut missing) = (Grid::over(&region, self.unit), 0);
        for number in 0..grid.len() {
            let indices = grid.indices(number);
            let linear = indices.iter().zip(&sides).fold(0, |linear, (index, side)| linear * side + index);
            match entries[linear] {
                None => missing += 1,
                Some((offset, bytes)) if offset.checked_add(bytes).is_some_and(|end| end <= length) => {
                    let start = (0..start.len()).map(|axis| start[axis] + indices[axis] * self.unit[axis]).collect();
                    take(Coded { path: path.clone(), part: Some((offset, bytes)), start })?;
                }
                Some((offset, bytes)) => {
                    let problem = format!("{bytes} bytes from byte {offset} are beyond the {length} bytes of the file");
                    return Err(damaged(io::Error::other(problem)));
                }
            }
        }
        Ok(missing)
    }

    /// The numbers of a chunk.
    fn decoded(&self, coded: &Coded) -> Result<Block, VolumeError> {
        data::check_cancelled(self.source, self.progress)?;
        let mut file = stream::open(&coded.path)?;
        let failed = |source| stream::failed(&coded.path, source);
        let length = file.metadata().map_err(failed)?.len();
        let part_of = coded.part.unwrap_or((0, length));
        let (encoding, most) = (self.decoder.name(), self.decoder.most_coded());
        if part_of.1 > most {
            let problem = format!("{} coded bytes for the {} bytes of a chunk", part_of.1, self.decoder.bytes());
            return Err(coded.damaged(encoding, io::Error::other(problem)));
        }
        let bytes = part(&mut file, part_of).map_err(failed)?;
        let mut bytes = self.decoder.decode(bytes).map_err(|source| coded.damaged(encoding, source))?;
        if self.array.kind == Kind::Half {
            bytes = bytes_of_floats(&bytes);
        }
        Ok(Block { start: coded.start.clone(), lengths: self.unit.to_vec(), bytes })
    }
}

/// Reads `part` of a file: offset and length, which are within the file.
fn part(file: &mut File, (offset, length): (u64, u64)) -> io::Result<Vec<u8>> {
    file.seek(SeekFrom::Start(offset))?;
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(length).unwrap_or(usize::MAX))?;
    file.take(length).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Number of files with names that are `wanted` in a folder and in those below, at most as many as a folder may have.
fn files_below(path: &Path, is_wanted: &dyn Fn(&str) -> bool) -> Result<usize, VolumeError> {
    let (mut files, mut folders) = (0, vec![path.to_owned()]);
    while let Some(folder) = folders.pop() {
        let failed = |source| stream::failed(&folder, source);
        for entry in std::fs::read_dir(&folder).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            if entry.file_type().map_err(failed)?.is_dir() {
                folders.push(entry.path());
            } else {
                files += usize::from(is_wanted(&entry.file_name().to_string_lossy()));
            }
            // So many suffice for every array.
            if files > super::MOST_NAMES {
                return Ok(usize::MAX);
            }
        }
    }
    Ok(files)
}
