//! The pool: bricks of a volume on a device that cannot hold it whole.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bytemuck::{Pod, Zeroable};

use super::{RenderError, Renderer};
use relume_base::number::{count, rounded, unsigned};
use relume_scene::tables::{BRICK, BrickGrid, LabelMap, Storage, read_for_box, slot_edge};
use relume_volume::Volume;
use relume_vulkan::{Buffer, Device, DeviceKind, Format, HostUse, Image3d};

/// Bytes of the bricks that one submission uploads, at least one brick.
const STAGING_BYTES: u64 = 8 << 20;
/// Largest number of slots along an axis: ten bits of a page.
const MOST_SLOTS: u64 = 1024;

/// Residence of the voxels of a volume during a march.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Residence {
    /// All on the device, in one texture.
    #[default]
    Whole,
    /// On the host, and on the device those bricks that rays need.
    Bricked {
        /// Voxels of a slot before the first of its brick; behind the last it has one more.
        apron: u32,
    },
}

/// Textures that a pool fills.
#[derive(Clone, Copy, Debug)]
pub(super) struct Filled<'a> {
    pub(super) volume: &'a Image3d,
    pub(super) label_image: Option<&'a Image3d>,
}

/// Makes the texels of bricks; needs no device.
#[derive(Debug)]
pub(super) struct Packer {
    source: Arc<Volume>,
    storage: Storage,
    labels: Option<Arc<LabelMap>>,
    smooth_labels: bool,
    grid: BrickGrid,
    apron: u32,
}

/// Texels of the slot of a brick.
#[derive(Debug)]
pub(super) struct Packed {
    pub(super) brick: usize,
    volume: Vec<u8>,
    labels: Option<Vec<u8>>,
}

impl Packed {
    /// Bytes that it takes in the buffer of an upload.
    fn bytes(&self) -> u64 {
        let all = [Some(&self.volume), self.labels.as_ref()];
        all.into_iter().flatten().map(|texels| (texels.len() as u64).next_multiple_of(16)).sum()
    }
}

impl Packer {
    /// Reads and packs `brick`.
    ///
    /// # Errors
    ///
    /// [`RenderError::Volume`] if its file cannot be read.
    pub(super) fn pack(&self, brick: usize) -> Result<Packed, RenderError> {
        let (first, edge) = self.slot_box(brick);
        let volume = self.storage.texels_of_box(&self.source, first, edge).map_err(RenderError::Volume)?;
        let labels = self
            .labels
            .as_ref()
            .map(|map| map.texels_of_box(self.source.geometry.dims, first, edge, self.smooth_labels));
        Ok(Packed { brick, volume, labels })
    }

    /// First voxel of the slot of `brick`, and its edge.
    fn slot_box(&self, brick: usize) -> ([i64; 3], usize) {
        let first = |at: usize| i64::try_from(at * BRICK as usize).unwrap_or(i64::MAX) - i64::from(self.apron);
        (self.grid.place(brick).map(first), slot_edge(self.apron) as usize)
    }

    /// Number of the first `bricks` that can be packed without reading a brick of their file twice: all if the voxels are in memory.
    pub(super) fn fitting(&self, bricks: &[usize]) -> usize {
        let Some(cache) = &self.source.bricks else { return bricks.len() };
        let dims = self.source.geometry.dims;
        cache.fitting(bricks.iter().map(|&brick| {
            let (first, edge) = self.slot_box(brick);
            read_for_box(dims, first, edge)
        }))
    }
}

/// Uniform of the pool, in the layout of `shaders/bricks.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
struct BrickUniform {
    dims: [f32; 3],
    unused: u32,
    counts: [u32; 3],
    unused_too: u32,
    texel: [f32; 3],
    unused_as_well: u32,
}

/// Slots for bricks, and the bricks that they hold.
#[derive(Debug)]
pub(super) struct Pool {
    /// The bricks of the volume.
    pub(super) grid: BrickGrid,
    /// Voxels of a slot in front of its brick.
    pub(super) apron: u32,
    /// Slots along each axis.
    slots: [u32; 3],
    pub(super) packer: Arc<Packer>,
    /// Page of each brick.
    pub(super) pages: Buffer,
    pub(super) uniform: Buffer,
    staging: Buffer,
    /// Bytes of a brick in `staging`.
    staged_bytes: u64,
    held: Mutex<Held>,
}

/// Bricks in slots.
#[derive(Debug)]
pub(super) struct Held {
    /// Slot of each brick.
    slot_of: Vec<Option<usize>>,
    /// Brick of each slot.
    brick_in: Vec<Option<usize>>,
    /// Whether each brick has been loaded before.
    known: Vec<bool>,
}

/// Sizes of a pool that a device can hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PoolSize {
    apron: u32,
    slots: [u32; 3],
}

/// Slots along each axis: as many as `most`, at most `limit` along each axis.
fn slots_within(most: u64, limit: [u64; 3]) -> [u64; 3] {
    let mut best = [0; 3];
    for x in 1..=limit[0].min(most) {
        for y in 1..=limit[1].min(most / x) {
            let slots = [x, y, limit[2].min(most / (x * y))];
            if slots.iter().product::<u64>() > best.iter().product() {
                best = slots;
            }
        }
    }
    best
}

/// Whether the device allocates as many bytes at once as it needs for a texture of `extent`. Those of its texels may be fewer.
pub(super) fn is_one_allocation(device: &Device, format: Format, extent: [u32; 3]) -> bool {
    Image3d::allocated_bytes(device, format, extent).is_ok_and(|bytes| bytes <= device.limits().max_allocation_bytes)
}

impl PoolSize {
    /// The pool for `grid` in textures of `format` within `budget` bytes, on a device with textures of at most `limit` texels along
    /// each axis.
    ///
    /// # Errors
    ///
    /// [`RenderError::Slot`] if there is no room for one brick.
    pub(super) fn new(
        device: &Device,
        grid: BrickGrid,
        apron: u32,
        (format, voxel_bytes): (Format, u64),
        budget: u64,
        limit: [u32; 3],
    ) -> Result<Self, RenderError> {
        let edge = u64::from(slot_edge(apron));
        let slot_bytes = edge.pow(3) * voxel_bytes;
        let along = limit.map(|limit| (u64::from(limit) / edge).min(MOST_SLOTS));
        let mut most = (budget / slot_bytes).min(grid.bricks() as u64);
        loop {
            let slots = slots_within(most, along);
            if slots.contains(&0) {
                return Err(RenderError::Slot {
                    needed_kb: slot_bytes.div_ceil(1000),
                    edge: slot_edge(apron),
                    device: device.info().name.clone(),
                    budget_kb: budget / 1000,
                    limit,
                });
            }
            let size = Self { apron, slots: slots.map(|slots| u32::try_from(slots).unwrap_or(u32::MAX)) };
            if is_one_allocation(device, format, size.extent()) {
                return Ok(size);
            }
            // The device adds some bytes to those of the texels.
            most -= most.div_ceil(16);
        }
    }

    /// Texels of the pool along each axis.
    pub(super) fn extent(self) -> [u32; 3] {
        self.slots.map(|slots| slots * slot_edge(self.apron))
    }
}

impl Pool {
    /// The pool of `volume` with `labels`; its slots are those of an image of [`PoolSize::extent`].
    pub(super) fn new(
        device: &Device,
        size: PoolSize,
        grid: BrickGrid,
        (volume, storage): (&Arc<Volume>, &Storage),
        (labels, smooth_labels): (Option<&Arc<LabelMap>>, bool),
    ) -> Result<Self, RenderError> {
        let voxel_bytes = voxel_bytes(storage, labels.map(|map| &**map), smooth_labels);
        let texel = size.extent().map(|texels| rounded(1.0 / f64::from(texels)));
        let uniform = BrickUniform {
            dims: volume.geometry.dims.map(|n| rounded(count(n))),
            counts: grid.counts.map(unsigned),
            texel,
            ..BrickUniform::default()
        };
        let buffer = Buffer::host(device, "bricks", size_of::<BrickUniform>() as u64, HostUse::Uniform)?;
        buffer.write(0, bytemuck::bytes_of(&uniform))?;
        let pages = Buffer::host(device, "pages", 4 * grid.bricks() as u64, HostUse::Storage)?;
        pages.write(0, &vec![0; 4 * grid.bricks()])?;
        let slot_bytes = u64::from(slot_edge(size.apron)).pow(3) * voxel_bytes;
        // Volume and labels begin at multiples of 16 bytes.
        let staged_bytes = slot_bytes + 32;
        let staged = STAGING_BYTES.max(staged_bytes);
        let staging = Buffer::host(device, "staging", staged.next_multiple_of(16), HostUse::Upload)?;
        let slots = size.slots.iter().map(|&n| n as usize).product();
        let bricks = grid.bricks();
        let held = Held { slot_of: vec![None; bricks], brick_in: vec![None; slots], known: vec![false; bricks] };
        let packer = Packer {
            source: Arc::clone(volume),
            storage: storage.clone(),
            labels: labels.cloned(),
            smooth_labels,
            grid,
            apron: size.apron,
        };
        Ok(Self {
            grid,
            apron: size.apron,
            slots: size.slots,
            packer: Arc::new(packer),
            pages,
            uniform: buffer,
            staging,
            staged_bytes,
            held: Mutex::new(held),
        })
    }

    /// Number of slots.
    pub(super) fn capacity(&self) -> usize {
        self.slots.iter().map(|&n| n as usize).product()
    }

    /// The bricks in slots, for one march at a time.
    pub(super) fn held(&self) -> MutexGuard<'_, Held> {
        self.held.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn place(&self, slot: usize) -> [u32; 3] {
        let [width, height, _] = self.slots.map(|n| n as usize);
        [slot % width, slot / width % height, slot / (width * height)].map(unsigned)
    }

    /// Number of bricks that one submission uploads.
    pub(super) fn batch(&self) -> usize {
        usize::try_from(self.staging.bytes() / self.staged_bytes).unwrap_or(usize::MAX).max(1)
    }

    /// Loads the first of `packed` that there are slots for in one submission, and returns them: at most [`Self::batch`]. A slot is free, or holds a brick that `is_kept` is false for; of those, the ones with the highest
    /// number `spare(brick)` are replaced first.
    pub(super) fn load(
        &self,
        renderer: &Renderer,
        textures: Filled<'_>,
        held: &mut Held,
        packed: impl Iterator<Item = Result<Packed, RenderError>>,
        is_kept: impl Fn(usize) -> bool,
        spare: impl Fn(usize) -> i64,
    ) -> Result<Vec<usize>, RenderError> {
        let mut room: Vec<usize> =
            (0..held.brick_in.len()).filter(|&slot| held.brick_in[slot].is_none_or(|brick| !is_kept(brick))).collect();
        room.sort_by_key(|&slot| held.brick_in[slot].map(&spare).unwrap_or(i64::MAX));
        // Texels of the bricks by image, with their places.
        let mut copies: Vec<(&Image3d, [u32; 3], u64)> = Vec::new();
        let (mut filled, mut loaded) = (0_u64, Vec::new());
        // A brick is packed only if there is a slot for it.
        let fit = room.len().min(self.batch());
        for packed in packed.take(fit) {
            let packed = packed?;
            if filled + packed.bytes() > self.staging.bytes() {
                break;
            }
            let Some(slot) = room.pop() else { break };
            if let Some(replaced) = held.brick_in[slot].take() {
                held.slot_of[replaced] = None;
                self.pages.write(4 * replaced as u64, &0_u32.to_ne_bytes())?;
            }
            let place = self.place(slot);
            let all = [Some((textures.volume, &packed.volume)), textures.label_image.zip(packed.labels.as_ref())];
            for (image, texels) in all.into_iter().flatten() {
                self.staging.write(filled, texels)?;
                copies.push((image, place.map(|at| at * slot_edge(self.apron)), filled));
                filled += (texels.len() as u64).next_multiple_of(16);
            }
            loaded.push((packed.brick, slot, place));
        }
        if loaded.is_empty() {
            return Ok(Vec::new());
        }
        renderer.device.run("bricks", |recorder| {
            for (image, first, offset) in &copies {
                recorder.upload_box(image, *first, [slot_edge(self.apron); 3], &self.staging, *offset)?;
            }
            Ok(())
        })?;
        for &(brick, slot, [x, y, z]) in &loaded {
            held.brick_in[slot] = Some(brick);
            held.slot_of[brick] = Some(slot);
            self.pages.write(4 * brick as u64, &(1 + (x | y << 10 | z << 20)).to_ne_bytes())?;
        }
        Ok(loaded.into_iter().map(|(brick, ..)| brick).collect())
    }
}

impl Held {
    /// Whether a slot holds `brick`.
    pub(super) fn has(&self, brick: usize) -> bool {
        self.slot_of[brick].is_some()
    }

    /// Whether `brick` has been loaded before.
    pub(super) fn is_known(&self, brick: usize) -> bool {
        self.known[brick]
    }

    /// Marks `bricks` as loaded before.
    pub(super) fn know(&mut self, bricks: &[usize]) {
        for &brick in bricks {
            self.known[brick] = true;
        }
    }
}

impl Renderer {
    /// Bytes for a volume that the device holds whole: its memory, or what the user allows, less what other volumes take of it.
    pub(super) fn volume_budget(&self) -> u64 {
        self.most_volume_bytes(self.taken_bytes)
    }

    /// [`Self::volume_budget`], where other volumes take `taken` bytes.
    pub(super) fn most_volume_bytes(&self, taken: u64) -> u64 {
        let limits = self.device.limits();
        let heap = limits.device_heap_bytes.min(limits.max_allocation_bytes);
        self.memory_bytes.map_or(heap, |bytes| heap.min(bytes.saturating_sub(taken)))
    }

    /// Bytes of a pool and of the level of its shadows: what the user allows, or half of the device's memory. Unlike the free memory, it
    /// stays the same from picture to picture.
    pub(super) fn bricked_bytes(&self) -> u64 {
        let limits = self.device.limits();
        self.memory_bytes.unwrap_or(limits.device_heap_bytes / 2).min(self.most_volume_bytes(0))
    }

    /// Bytes of a pool beside a level of `level_bytes` that is already there: what the user allows, less what other volumes take of it,
    /// or half of the device's memory; on a software device at most half of what is free.
    pub(super) fn pool_budget(&self, level_bytes: u64) -> u64 {
        let limits = self.device.limits();
        let free =
            (self.device.info().kind == DeviceKind::Software).then(relume_base::memory::available_bytes).flatten();
        let stated = self.memory_bytes.map(|bytes| bytes.saturating_sub(self.taken_bytes));
        pool_bytes(stated, [limits.device_heap_bytes, free.unwrap_or(u64::MAX)], level_bytes)
            .min(limits.max_allocation_bytes)
    }

    /// Largest extent of a texture of `format`.
    pub(super) fn largest_texture(&self, format: Format) -> [u32; 3] {
        let limit = self.device.limits().max_extent_3d(format);
        limit.map(|limit| self.longest_axis.map_or(limit, |longest| limit.min(longest)))
    }
}

/// Bytes of a pool beside a level of `level` bytes, which share what the user `stated`, or half of a device's `heap`. What is `free`
/// no longer includes the level.
fn pool_bytes(stated: Option<u64>, [heap, free]: [u64; 2], level: u64) -> u64 {
    stated.map_or((heap / 2).saturating_sub(level).min(free / 2), |bytes| bytes.saturating_sub(level))
}

/// Bytes of a voxel and its label.
fn voxel_bytes(storage: &Storage, labels: Option<&LabelMap>, smooth: bool) -> u64 {
    (storage.format.bytes() + labels.map_or(0, |map| map.texel_bytes(smooth))) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use relume_vulkan::shader::Constants;

    #[test]
    fn the_uniform_lies_where_the_shader_reads_it() {
        let (structure, _) = include_str!("../../shaders/bricks.wgsl").split_once("@group").unwrap_or_default();
        let layout = relume_vulkan::shader::struct_layout(&[("bricks", structure)], &Constants::new(), "Bricks").ok();
        let theirs = layout.as_ref().map(|layout| {
            layout.fields.iter().map(|field| (field.name.as_str(), field.offset as usize)).collect::<Vec<_>>()
        });
        let ours = vec![
            ("dims", std::mem::offset_of!(BrickUniform, dims)),
            ("counts", std::mem::offset_of!(BrickUniform, counts)),
            ("texel", std::mem::offset_of!(BrickUniform, texel)),
        ];
        assert_eq!(theirs, Some(ours));
        assert_eq!(layout.map(|layout| layout.size as usize), Some(size_of::<BrickUniform>()));
    }

    #[test]
    fn a_pool_and_the_level_of_its_shadows_share_half_of_a_device_or_the_stated_memory() {
        for (stated, free, together) in [(None, u64::MAX, 500), (Some(900), 600, 900)] {
            let bytes = [0, 120, 250].map(|level| pool_bytes(stated, [1000, free], level) + level);
            assert_eq!(bytes, [together; 3]);
        }
        // A level that is there is not free.
        assert_eq!([0, 120, 250].map(|level| pool_bytes(None, [1000, 600 - level], level)), [300, 240, 175]);
    }

    #[test]
    fn a_pool_has_nearly_as_many_slots_as_fit() {
        assert_eq!(slots_within(59, [30, 30, 30]).iter().product::<u64>(), 58);
        assert_eq!(slots_within(313, [30, 1, 1]), [30, 1, 1]);
        assert_eq!(slots_within(100_000, [3, 3, 3]), [3, 3, 3]);
        assert_eq!(slots_within(0, [3, 3, 3]), [0; 3]);
        assert_eq!(slots_within(5, [0, 3, 3]), [0; 3]);
    }
}
