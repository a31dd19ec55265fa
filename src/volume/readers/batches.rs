//! Parts of a volume decoded, each straight into its place; in parallel where that takes less time.

use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use crate::data::{self, SLAB_BYTES};
use crate::stream::count;
use crate::{VolumeError, Voxel, allocate};
use relume_base::parallel;
use relume_base::progress::Progress;

/// Bytes of voxels that are allocated before anything is decoded. Later, as many as have been decoded.
const BATCH: usize = 32 << 20;

/// How files keep voxels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    /// Compressed.
    Packed,
    /// Uncompressed; the lengths of the files prove that they hold the voxels.
    Plain,
    /// As they are in memory, in one file.
    AsTheyAre,
}

/// A part: adjacent voxels that one thread decodes.
pub(crate) struct Part<'a, P> {
    pub(crate) part: P,
    /// Number of its voxels.
    pub(crate) voxels: usize,
    /// Its file, for messages.
    pub(crate) path: &'a Path,
}

/// Decoder of parts.
pub(crate) trait Decode<P>: Sync {
    type Voxel: Voxel;
    /// State of a thread, kept from part to part.
    type Scratch: Send;

    fn scratch(&self) -> Self::Scratch;

    /// Decodes the voxels of `part` into `out`, which has as many.
    fn decode(&self, scratch: &mut Self::Scratch, part: &P, out: &mut [Self::Voxel]) -> Result<(), VolumeError>;

    /// Decodes the beginning of `part` without keeping it. Without an error, the file does hold the voxels.
    fn prove(&self, part: &P) -> Result<(), VolumeError>;
}

/// Decodes `parts`, which have `all` voxels, one behind the other.
///
/// Memory grows as parts are decoded, so that a header alone allocates little; for uncompressed voxels it is allocated at
/// once. Of several errors, the first part's is returned.
pub(crate) fn read<'a, P: Send, D: Decode<P>>(
    decode: &D,
    parts: impl Iterator<Item = Part<'a, P>>,
    all: usize,
    kept: Kept,
    progress: &dyn Progress,
) -> Result<Vec<D::Voxel>, VolumeError> {
    let size = size_of::<D::Voxel>();
    let are_there = kept != Kept::Packed;
    let done = Done { bytes: AtomicU64::new(0), all: count(all).saturating_mul(count(size)), progress };
    let mut voxels: Vec<D::Voxel> = Vec::new();
    let mut there = 0;
    let mut parts = parts.peekable();
    if are_there && let Some(first) = parts.peek() {
        // Memory that the system zeroes is not written twice.
        voxels = allocate::zeroed(first.path, all)?;
    }
    while let Some(first) = parts.next() {
        let budget = (BATCH / size).max(there);
        if first.voxels > budget && !are_there {
            data::check_cancelled(first.path, progress)?;
            decode.prove(&first.part)?;
        }
        let mut more = first.voxels;
        let path = first.path;
        let mut batch = vec![first];
        while let Some(part) = parts.next_if(|part| more + part.voxels <= budget) {
            more += part.voxels;
            batch.push(part);
        }
        if voxels.len() < there + more {
            allocate::reserve(&mut voxels, more, all, path)?;
            voxels.resize(there + more, bytemuck::Zeroable::zeroed());
        }
        let mut rest = &mut voxels[there..there + more];
        let mut places = Vec::with_capacity(batch.len());
        for part in batch {
            let place;
            (place, rest) = rest.split_at_mut(part.voxels);
            places.push((part, place));
        }
        let one = |scratch: &mut D::Scratch, (part, place): &mut (Part<'_, P>, &mut [D::Voxel])| {
            data::check_cancelled(part.path, progress)?;
            decode.decode(scratch, &part.part, place)?;
            done.add(part.path, size_of_val(*place))
        };
        if kept == Kept::AsTheyAre {
            // Several threads would share the bandwidth of the memory, and take more CPU time.
            let mut scratch = decode.scratch();
            places.iter_mut().try_for_each(|place| one(&mut scratch, place))?;
        } else {
            // Every thread has a scratch of its own, which may open a file.
            let places: Vec<Mutex<_>> = places.into_iter().map(Mutex::new).collect();
            let results = parallel::map_with(places.len(), &|| decode.scratch(), &|scratch, index| {
                one(scratch, &mut places[index].lock().unwrap_or_else(PoisonError::into_inner))
            });
            results.into_iter().collect::<Result<(), _>>()?;
        }
        there += more;
    }
    Ok(voxels)
}

/// Progress of all threads.
struct Done<'a> {
    bytes: AtomicU64,
    all: u64,
    progress: &'a dyn Progress,
}

impl Done<'_> {
    /// Adds `bytes`, and reports about once per [`SLAB_BYTES`].
    fn add(&self, path: &Path, bytes: usize) -> Result<(), VolumeError> {
        let before = self.bytes.fetch_add(count(bytes), Ordering::Relaxed);
        let after = before + count(bytes);
        let slab = count(SLAB_BYTES);
        if before / slab != after / slab || after >= self.all {
            return data::report(path, after.min(self.all), self.all, self.progress);
        }
        Ok(())
    }
}
