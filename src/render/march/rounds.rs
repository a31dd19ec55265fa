//! Rounds of a march in bricks: rays go on until the next brick is missing, and the bricks that they want are loaded.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use crate::pool::{Held, Packed, Pool};
use crate::{RenderError, Renderer, Uploaded};
use relume_base::number::{count, whole};
use relume_scene::tables::{Occupancy, RayTable};
use relume_vulkan::{Buffer, HostUse};

/// Words before the bits of the wanted bricks, as in `shaders/rounds.wgsl`.
const WANTED_BITS: usize = 3;

/// Bricks of a march.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct BrickCounts {
    /// Bricks of the volume with a visible macrocell.
    pub visible: usize,
    /// Bricks that the device has room for.
    pub held: usize,
    /// Bricks that the march loaded, each time counted.
    pub loaded: usize,
    /// Bricks among them that had been loaded before, by this march or an earlier one of the same volume.
    pub again: usize,
    /// Rounds, for all rays of a pixel together.
    pub rounds: usize,
}

impl BrickCounts {
    /// Those of two marches of different parts of the volume.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self { visible: self.visible + other.visible, ..self.then(other) }
    }

    /// Those of two marches of the same volume.
    #[must_use]
    pub fn then(self, other: Self) -> Self {
        Self {
            visible: self.visible.max(other.visible),
            held: self.held.max(other.held),
            loaded: self.loaded + other.loaded,
            again: self.again + other.again,
            rounds: self.rounds + other.rounds,
        }
    }
}

/// The rounds of a march.
#[derive(Debug)]
pub(super) struct Rounds {
    /// Next sample of each pixel.
    pub(super) next: Buffer,
    /// Rows, sample and bricks that rays wait for.
    pub(super) wanted: Buffer,
    read_back: Buffer,
    /// A number for each brick that only grows along a ray; near bricks have near numbers.
    ranks: Vec<i64>,
    /// Bricks with a visible macrocell, in the order of their ranks.
    visible: Vec<usize>,
    /// Bricks to load before the next round.
    loading: VecDeque<usize>,
    /// Number of bricks that the next round waits for.
    of_round: usize,
    /// Bricks being read for it.
    fetch: Option<Fetch>,
    /// Bricks that the next round needs.
    kept: Vec<bool>,
    /// Lowest rank of a brick that rays wait for.
    lowest: i64,
    /// Whether all rays have ended.
    pub(super) done: bool,
    pub(super) counts: BrickCounts,
}

/// Bricks that a thread reads and packs. It uses no device.
#[derive(Debug)]
struct Fetch {
    cancelled: Arc<AtomicBool>,
    thread: JoinHandle<Result<Vec<Packed>, RenderError>>,
}

impl Fetch {
    /// Starts to read `bricks` of `pool`; `None` without bricks.
    fn start(pool: &Pool, bricks: Vec<usize>) -> Option<Self> {
        if bricks.is_empty() {
            return None;
        }
        let (packer, cancelled) = (Arc::clone(&pool.packer), Arc::new(AtomicBool::new(false)));
        let heard = Arc::clone(&cancelled);
        let thread = std::thread::spawn(move || {
            let wanted = bricks.into_iter().take_while(|_| !heard.load(Ordering::Relaxed));
            wanted.map(|brick| packer.pack(brick)).collect()
        });
        Some(Self { cancelled, thread })
    }

    fn is_over(&self) -> bool {
        self.thread.is_finished()
    }

    /// The bricks, in the order of the request.
    fn packed(self) -> Result<Vec<Packed>, RenderError> {
        // A panic of the thread has already been reported.
        self.thread.join().unwrap_or(Err(RenderError::Panicked))
    }
}

/// Rows and first sample of a round.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Round {
    /// First row with a waiting ray.
    pub(super) first_row: u32,
    /// End of the rows with a waiting ray.
    pub(super) end_row: u32,
    /// Smallest number of a sample that a ray waits at.
    pub(super) first_sample: u32,
}

/// Retains of the bricks that rays wait for, in the order of their ranks, those up to which a pool with room for `room` bricks has
/// room for all `visible` ones. So none is given up before all rays have left it, and none is loaded twice.
fn retain_within(wanted: &mut Vec<usize>, visible: &[usize], ranks: &[i64], room: usize) {
    let Some(&lowest) = wanted.first() else { return };
    let left = visible.partition_point(|&brick| ranks[brick] < ranks[lowest]);
    if let Some(&beyond) = visible.get(left + room) {
        wanted.retain(|&brick| ranks[brick] < ranks[beyond]);
    }
}

/// A number that is higher for bricks that are given up earlier: first those that all rays have left, whose ranks are below
/// `lowest`, then those that rays reach last.
fn spare(rank: i64, lowest: i64) -> i64 {
    if rank < lowest { i64::MAX - 1 } else { rank }
}

/// Bytes of `buffer`.
fn length(buffer: &Buffer) -> usize {
    usize::try_from(buffer.bytes()).unwrap_or(usize::MAX)
}

impl Drop for Rounds {
    fn drop(&mut self) {
        // The thread ends after the brick that it reads.
        self.fetch.iter().for_each(|fetch| fetch.cancelled.store(true, Ordering::Relaxed));
    }
}

impl Rounds {
    /// Rounds for a picture of `size` whose bricks are in `pool`. `all`: every macrocell is marched, occupied or not.
    pub(super) fn new(
        renderer: &Renderer,
        pool: &Pool,
        rays: &RayTable,
        occupancy: &Occupancy,
        all: bool,
        size: [usize; 2],
    ) -> Result<Self, RenderError> {
        let bricks = pool.grid.bricks();
        let words = WANTED_BITS + bricks.div_ceil(32);
        let bytes = 4 * words as u64;
        let device = &renderer.device;
        let ranks = pool.grid.ranks(rays);
        let mut visible = if all { (0..bricks).collect() } else { pool.grid.occupied(occupancy) };
        visible.retain(|&brick| pool.grid.is_of_block(brick, rays));
        visible.sort_by_key(|&brick| (ranks[brick], brick));
        // If all fit, all are loaded at once.
        let fit = visible.len() <= pool.capacity();
        let mut kept = vec![false; bricks];
        for &brick in visible.iter().filter(|_| fit) {
            kept[brick] = true;
        }
        let rounds = Self {
            next: Buffer::host(device, "next samples", 4 * (size[0] * size[1]) as u64, HostUse::Storage)?,
            wanted: Buffer::host(device, "wanted bricks", bytes, HostUse::Storage)?,
            read_back: Buffer::host(device, "wanted bricks, read back", bytes, HostUse::ReadBack)?,
            ranks,
            loading: if fit { visible.iter().copied().collect() } else { VecDeque::new() },
            of_round: if fit { visible.len() } else { 0 },
            fetch: None,
            kept,
            lowest: i64::MIN,
            done: false,
            counts: BrickCounts { visible: visible.len(), held: pool.capacity(), rounds: 1, ..BrickCounts::default() },
            visible,
        };
        rounds.begin()?;
        Ok(rounds)
    }

    fn begin(&self) -> Result<(), RenderError> {
        self.next.write(0, &vec![0; length(&self.next)])?;
        self.reset()
    }

    /// Begins with `rows` of a picture of `width` pixels across alone.
    pub(super) fn begin_rows(&mut self, rows: std::ops::Range<usize>, width: usize) -> Result<(), RenderError> {
        self.restart()?;
        self.next.write(0, &vec![u8::MAX; length(&self.next)])?;
        self.next.write(4 * (rows.start * width) as u64, &vec![0; 4 * rows.len() * width])?;
        Ok(())
    }

    fn reset(&self) -> Result<(), RenderError> {
        let mut words = vec![0_u32; length(&self.wanted) / 4];
        words[..WANTED_BITS].copy_from_slice(&[u32::MAX, 0, u32::MAX]);
        Ok(self.wanted.write(0, bytemuck::cast_slice(&words))?)
    }

    /// Begins the next ray of each pixel.
    pub(super) fn restart(&mut self) -> Result<(), RenderError> {
        self.done = false;
        self.lowest = i64::MIN;
        self.counts.rounds += 1;
        self.begin()
    }

    /// Whether bricks are to be loaded before the next dispatch.
    pub(super) fn is_loading(&self) -> bool {
        !self.loading.is_empty()
    }

    /// Loads some of the bricks of the next round.
    pub(super) fn load(&mut self, renderer: &Renderer, uploaded: &Uploaded, pool: &Pool) -> Result<(), RenderError> {
        let mut held = pool.held();
        self.loading.retain(|&brick| !held.has(brick));
        let bricks: Vec<usize> = self.loading.iter().copied().collect();
        let packed = bricks.iter().map(|&brick| pool.packer.pack(brick));
        self.put(renderer, uploaded, (pool, &mut held), packed)
    }

    /// Loads bricks that `packed` yields, the first ones of the next round.
    fn put(
        &mut self,
        renderer: &Renderer,
        uploaded: &Uploaded,
        (pool, held): (&Pool, &mut Held),
        packed: impl Iterator<Item = Result<Packed, RenderError>>,
    ) -> Result<(), RenderError> {
        let (kept, ranks, lowest) = (&self.kept, &self.ranks, self.lowest);
        let spare = |brick: usize| spare(ranks[brick], lowest);
        let loaded = pool.load(renderer, uploaded.filled(), held, packed, |brick| kept[brick], spare)?;
        self.counts.loaded += loaded.len();
        self.counts.again += loaded.iter().filter(|&&brick| held.is_known(brick)).count();
        held.know(&loaded);
        self.loading.retain(|brick| !loaded.contains(brick));
        if loaded.is_empty() {
            // Another march holds the slots; the rays will ask again.
            self.loading.clear();
        }
        Ok(())
    }

    /// As [`Self::load`], but never waits for bricks: a thread reads and packs them, those after the ones that are loaded too.
    /// Returns whether the device did any work.
    pub(super) fn load_ahead(
        &mut self,
        renderer: &Renderer,
        uploaded: &Uploaded,
        pool: &Pool,
    ) -> Result<bool, RenderError> {
        let mut held = pool.held();
        let Some(fetch) = self.fetch.take() else {
            self.loading.retain(|&brick| !held.has(brick));
            self.fetch = Fetch::start(pool, self.loading.iter().take(pool.batch()).copied().collect());
            return Ok(false);
        };
        if !fetch.is_over() {
            self.fetch = Some(fetch);
            return Ok(false);
        }
        let packed = fetch.packed()?;
        // Another march may have loaded some of them since.
        let packed: Vec<Packed> = packed.into_iter().filter(|packed| !held.has(packed.brick)).collect();
        self.loading.retain(|&brick| !held.has(brick));
        self.fetch = Fetch::start(pool, self.loading.iter().skip(packed.len()).take(pool.batch()).copied().collect());
        if !packed.is_empty() {
            self.put(renderer, uploaded, (pool, &mut held), packed.into_iter().map(Ok))?;
        }
        Ok(true)
    }

    /// Bricks of the present round that are loaded, and all that it waits for.
    pub(super) fn progress(&self) -> [usize; 2] {
        [self.of_round.saturating_sub(self.loading.len()), self.of_round]
    }

    /// Ends a round: returns the next one, whose bricks are to be loaded first; `None` if all rays have ended.
    pub(super) fn settle(&mut self, renderer: &Renderer, pool: &Pool) -> Result<Option<Round>, RenderError> {
        let bytes = self.wanted.bytes();
        renderer.device.run("wanted bricks", |recorder| {
            recorder.compute_to_transfer();
            recorder.copy(&self.wanted, 0, &self.read_back, 0, bytes)?;
            recorder.transfer_to_host();
            Ok(())
        })?;
        let mut words = vec![0_u32; length(&self.wanted) / 4];
        self.read_back.read(0, bytemuck::cast_slice_mut(&mut words))?;
        let (&[first_row, last_row, first_sample], bits) = words.split_first_chunk().unwrap_or((&[u32::MAX; 3], &[]));
        let mut wanted: Vec<usize> = (0..self.ranks.len())
            .filter(|brick| bits.get(brick / 32).is_some_and(|word| word >> (brick % 32) & 1 == 1))
            .collect();
        if first_row == u32::MAX || wanted.is_empty() {
            self.done = true;
            return Ok(None);
        }
        wanted.sort_by_key(|&brick| (self.ranks[brick], brick));
        self.lowest = wanted.first().map_or(i64::MIN, |&brick| self.ranks[brick]);
        retain_within(&mut wanted, &self.visible, &self.ranks, pool.capacity());
        // Bricks of a file are read once a round if there is room for them. But a round is worth an upload, and an eighth of the pool, so
        // that the waiting rays are not read and written for each brick of large voxels.
        let fit = pool.packer.fitting(&wanted).max(pool.batch()).max(pool.capacity().div_ceil(8));
        wanted.truncate(fit.min(pool.capacity()));
        self.kept.fill(false);
        for &brick in &wanted {
            self.kept[brick] = true;
        }
        self.of_round = wanted.len();
        self.loading = wanted.into();
        self.counts.rounds += 1;
        self.reset()?;
        Ok(Some(Round { first_row, end_row: last_row + 1, first_sample }))
    }

    /// Of `rows`, the share that corresponds to the bricks that all rays have left.
    pub(super) fn passed(&self, rows: usize) -> usize {
        let left = self.visible.partition_point(|&brick| self.ranks[brick] < self.lowest);
        whole(count(rows) * count(left) / count(self.visible.len().max(1))).min(rows)
    }

    /// Whether there is room for all bricks at once.
    pub(super) fn is_single(&self) -> bool {
        self.visible.len() <= self.counts.held
    }
}

#[cfg(test)]
#[expect(clippy::unwrap_used, reason = "a test fails by panicking")]
mod tests {
    use super::*;
    use glam::DVec3;
    use relume_scene::tables::BrickGrid;
    use relume_scene::{Aim, Projection, Scene};
    use relume_volume::{Geometry, Volume, Voxels};

    /// Along which parallel rays pass the bricks.
    const ALONG: [f64; 3] = [0.8, 0.5, -0.33];

    /// Parallel rays of a volume of a few voxels.
    fn parallel() -> RayTable {
        let geometry = Geometry::unit("test", [2; 3]).unwrap();
        let mut scene = Scene::new("test", Arc::new(Volume::new("test", Voxels::U8(vec![0; 8]), geometry).unwrap()));
        scene.camera.aim = Aim::LookAt { position: -DVec3::from_array(ALONG), target: DVec3::ZERO };
        scene.camera.projection = Projection::Orthographic { height: Some(1.0) };
        RayTable::new(&scene, &scene.camera.view(&geometry, 1.0).unwrap()).unwrap()
    }

    /// The bricks of `grid` that each of some rays [`ALONG`] passes, in their order.
    fn passed(grid: &BrickGrid) -> Vec<Vec<usize>> {
        let [width, height, _] = grid.counts;
        let ends = grid.counts.map(count);
        let starts = (0..3 * width * height).map(|i| [i % width, i / width % height, i / (width * height)]);
        let steps = |start: [usize; 3]| {
            // Three rays begin in each brick of the face that they come from, and in the faces beside it.
            let offset = (count(start[2]) + 0.5) / 3.0;
            let start = [count(start[0]) + offset - ends[0] / 2.0, count(start[1]) + offset - ends[1] / 2.0, ends[2]];
            (0..400).map(move |step| [0, 1, 2].map(|axis| start[axis] + 0.1 * count(step) * ALONG[axis]))
        };
        let brick = |place: [f64; 3]| {
            let is_inside = place.iter().zip(ends).all(|(&at, end)| (0.0..end).contains(&at));
            let [x, y, z] = place.map(whole);
            is_inside.then_some(x + width * (y + height * z))
        };
        let mut all: Vec<Vec<usize>> = starts.map(|start| steps(start).filter_map(brick).collect()).collect();
        all.iter_mut().for_each(Vec::dedup);
        all
    }

    #[test]
    fn rounds_load_each_brick_once_for_a_ray_of_each_pixel() {
        let grid = BrickGrid { counts: [12, 10, 9] };
        let ranks = grid.ranks(&parallel());
        let mut visible: Vec<usize> = (0..grid.bricks()).collect();
        visible.sort_by_key(|&brick| ranks[brick]);
        for room in [20, 60, 120] {
            let mut rays: Vec<VecDeque<usize>> = passed(&grid).into_iter().map(VecDeque::from).collect();
            let (mut held, mut loads) = (Vec::new(), vec![0; grid.bricks()]);
            loop {
                // Rays go on until a brick is missing.
                for ray in &mut rays {
                    while ray.front().is_some_and(|brick| held.contains(brick)) {
                        ray.pop_front();
                    }
                }
                let mut wanted: Vec<usize> = rays.iter().filter_map(|ray| ray.front().copied()).collect();
                wanted.sort_by_key(|&brick| ranks[brick]);
                wanted.dedup();
                let Some(&lowest) = wanted.first() else { break };
                retain_within(&mut wanted, &visible, &ranks, room);
                wanted.truncate(room);
                for &brick in &wanted {
                    loads[brick] += 1;
                    if held.len() == room {
                        let others = held.iter().enumerate().filter(|(_, brick)| !wanted.contains(brick));
                        let given_up = others.max_by_key(|(_, brick)| spare(ranks[**brick], ranks[lowest]));
                        let slot = given_up.unwrap().0;
                        held.swap_remove(slot);
                    }
                    held.push(brick);
                }
            }
            let [most, all] = [*loads.iter().max().unwrap(), loads.iter().sum::<usize>()];
            assert!(most == 1 && all > 4 * room, "room for {room} bricks: {all} loads, one brick {most} times");
        }
    }
}
