//! Volumes of which a reader reads some slices at a time.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::data::{Take, check_cancelled};
use super::stream::count;
use crate::{Part, Selection, Volume, VolumeError, Voxel, VoxelType, with_voxels};
use relume_base::progress::Progress;

/// Reads what a selection chooses of a file or folder.
pub(crate) type Open = fn(&Path, &Selection, &dyn Progress) -> Result<Volume, VolumeError>;

/// Bytes of slices that are read at once at most, if memory and chunks allow it. Readers look through their headers again
/// for each slab.
const MOST: u64 = 256 << 20;

/// The slices of a volume, slab by slab.
pub(crate) struct Slabs {
    path: PathBuf,
    selection: Selection,
    open: Open,
    /// The volume without voxels.
    header: Volume,
    part: Part,
}

impl Slabs {
    /// The slices of what `selection` chooses of the file or folder `path`, and their volume without voxels. `open` reads them;
    /// for the header, it reads `probe` slices.
    ///
    /// # Errors
    ///
    /// [`VolumeError::NotStreamed`] if the volume is resampled, or its reader reads it as a whole.
    pub(crate) fn of(
        path: &Path,
        selection: &Selection,
        (open, probe): (Open, usize),
        progress: &dyn Progress,
    ) -> Result<(Self, Volume), VolumeError> {
        let not_streamed = |reason| VolumeError::NotStreamed { source_name: path.display().to_string(), reason };
        if selection.resample {
            return Err(not_streamed("its slices are resampled together"));
        }
        let selection = Selection { slices: Some([0, probe]), ..selection.clone() };
        let mut header = open(path, &selection, progress)?;
        let part = header.part.take().ok_or_else(|| not_streamed("its reader reads it as a whole"))?;
        header.geometry.dims[2] = part.depth;
        header.voxels = header.voxels.voxel_type().no_voxels();
        Ok((Self { path: path.to_owned(), selection, open, header: header.clone(), part }, header))
    }

    pub(crate) fn voxel_type(&self) -> VoxelType {
        self.header.voxels.voxel_type()
    }

    /// Bytes of a slice.
    fn slice(&self) -> u64 {
        let [nx, ny, _] = self.header.geometry.dims;
        count(nx).saturating_mul(count(ny)).saturating_mul(count(self.voxel_type().bytes())).max(1)
    }

    /// Slices that are read at once with `budget` bytes of memory, and the bytes of their voxels.
    pub(crate) fn at_once(&self, budget: u64) -> (usize, u64) {
        let slices = at_once(self.part, self.slice(), budget);
        (slices, count(slices).saturating_mul(self.slice()))
    }

    /// Says that chunks are decoded more than once if `slices` slices are read at once.
    pub(crate) fn warning(&self, slices: usize) -> Option<String> {
        let Part { depth, together } = self.part;
        (!slices.is_multiple_of(together) && slices < depth).then(|| {
            let source = self.path.display();
            format!("{source}: its chunks have {together} slices, of which {slices} fit the memory; they are decoded more than once")
        })
    }

    /// Reads the voxels, `slices` slices at once, and hands them on in order.
    pub(crate) fn read_into<T: Voxel>(
        &self,
        slices: usize,
        progress: &dyn Progress,
        notes: &mut Vec<String>,
        take: Take<'_, T>,
    ) -> Result<(), VolumeError> {
        let mut known: HashSet<String> = notes.iter().cloned().collect();
        let bytes = count(self.part.depth).saturating_mul(self.slice());
        for first in (0..self.part.depth).step_by(slices) {
            let end = (first + slices).min(self.part.depth);
            check_cancelled(&self.path, progress)?;
            let selection = Selection { slices: Some([first, end]), ..self.selection.clone() };
            let shown = [first, end].map(|slice| count(slice).saturating_mul(self.slice()));
            let read = (self.open)(&self.path, &selection, &Share { progress, shown, bytes })?;
            self.check(&read, [first, end])?;
            notes.extend(read.notes.into_iter().filter(|note| known.insert(note.clone())));
            let [nx, ny, _] = self.header.geometry.dims;
            with_voxels!(&read.voxels, voxels => take(nx * ny * first, bytemuck::cast_slice(voxels)))?;
        }
        Ok(())
    }

    /// Whether the slices `read` are those that were asked for, and like those of the header: what it is made of may change
    /// from slab to slab.
    fn check(&self, read: &Volume, [first, end]: [usize; 2]) -> Result<(), VolumeError> {
        let of = |volume: &Volume| {
            let scale = [volume.slope.to_bits(), volume.intercept.to_bits()];
            (volume.voxels.voxel_type(), scale, volume.components, volume.has_labels)
        };
        let place = self.header.geometry.of_slices(&(first..end));
        if of(read) == of(&self.header) && read.part == Some(self.part) && read.geometry.lies_on(&place) {
            return Ok(());
        }
        let reason = "its slices differ in size, type, scale or place, or it changed while it was read";
        Err(VolumeError::NotStreamed { source_name: self.path.display().to_string(), reason })
    }
}

/// Slices of `slice` bytes that are read at once with `budget` bytes of memory: whole chunks where half of it is enough.
fn at_once(Part { depth, together }: Part, slice: u64, budget: u64) -> usize {
    let fit = |bytes: u64| usize::try_from(bytes / slice).unwrap_or(usize::MAX);
    let slices = match [fit(budget / 4), fit(budget / 2)] {
        [quarter, _] if together <= quarter => quarter.min(fit(MOST)).max(together) / together * together,
        [_, half] if together <= half => together,
        [_, half] => half.max(1),
    };
    slices.min(depth).max(1)
}

/// Progress of a slab among all `bytes`; it reads those `shown`, from the first to the last.
struct Share<'a> {
    progress: &'a dyn Progress,
    shown: [u64; 2],
    bytes: u64,
}

impl Progress for Share<'_> {
    fn report(&self, stage: &str, done: u64, total: u64) {
        let [first, end] = self.shown;
        let share = u128::from(end - first) * u128::from(done.min(total)) / u128::from(total.max(1));
        self.progress.report(stage, first + u64::try_from(share).unwrap_or(0), self.bytes);
    }

    fn cancelled(&self) -> bool {
        self.progress.cancelled()
    }
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
    use std::sync::Mutex;

    use super::*;
    use crate::{Geometry, Voxels};
    use relume_base::progress::Quiet;

    /// The slices that were asked for.
    static ASKED: Mutex<Vec<[usize; 2]>> = Mutex::new(Vec::new());

    /// 50 slices of 4×2 voxels of two bytes, in chunks of 7 slices.
    #[expect(clippy::unnecessary_wraps, reason = "as a reader")]
    fn open(_: &Path, selection: &Selection, _: &dyn Progress) -> Result<Volume, VolumeError> {
        let slices = selection.slices(50);
        ASKED.lock().unwrap().push([slices.start, slices.end]);
        let voxels = slices.clone().flat_map(|z| (0..8).map(move |at| u16::try_from(8 * z + at).unwrap()));
        let geometry = Geometry::unit("made", [4, 2, 50]).unwrap().of_slices(&slices);
        let mut volume = Volume::new("made", Voxels::U16(voxels.collect()), geometry).unwrap();
        volume.part = selection.part(50, 7);
        Ok(volume)
    }

    #[test]
    fn slabs_follow_each_other_within_the_memory_and_no_chunk_is_decoded_twice_where_it_fits() {
        // A slice has 16 bytes, a chunk 112.
        for (budget, slices, is_noted) in
            [(u64::MAX, 50, false), (1100, 14, false), (448, 7, false), (224, 7, false), (223, 6, true), (0, 1, true)]
        {
            let (slabs, header) = Slabs::of(Path::new("made"), &Selection::default(), (open, 0), &Quiet).unwrap();
            assert_eq!((header.geometry.dims, header.voxels.voxel_type()), ([4, 2, 50], VoxelType::U16));
            assert!(slabs.at_once(budget) == (slices, 16 * count(slices)), "{budget}: {:?}", slabs.at_once(budget));
            assert!(budget < 32 || slabs.at_once(budget).1 <= budget / 2, "{budget}");
            ASKED.lock().unwrap().clear();
            let (mut found, mut notes) = (Vec::new(), Vec::new());
            let mut take = |first: usize, part: &[u16]| {
                assert_eq!(first, found.len());
                found.extend_from_slice(part);
                Ok(())
            };
            slabs.read_into(slices, &Quiet, &mut notes, &mut take).unwrap();
            assert!(found.iter().copied().eq(0..400), "{budget}");
            let asked: Vec<[usize; 2]> = std::mem::take(&mut ASKED.lock().unwrap());
            let expected = (0..50).step_by(slices).map(|first| [first, (first + slices).min(50)]);
            assert!(asked.iter().copied().eq(expected), "{budget}: {asked:?}");
            assert_eq!((notes.len(), slabs.warning(slices).is_some()), (0, is_noted), "{budget}: {notes:?}");
        }
    }
}
