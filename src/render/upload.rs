//! Uploads volumes to the device.

use std::any::Any;
use std::borrow::Cow;
use std::sync::{Arc, Mutex};

use glam::DVec3;

use super::level::finest_level;
use super::pool::{Filled, Pool, PoolSize, Residence, is_one_allocation};
use super::{RenderError, Renderer};
use relume_base::number::{count, unsigned};
use relume_base::progress::Progress;
use relume_scene::plan::{Planned, ScenePlan};
use relume_scene::tables::{BrickGrid, Cells, LabelMap, PlacedField, Storage, VolumeFormat, apron, slot_edge};
use relume_scene::{Coarse, FIELDS, Scene};
use relume_volume::{Statistics, macrocells};
use relume_vulkan::{Buffer, Format, HostUse, Image3d};

/// Bytes per upload; limits the host's copy.
const SLAB_BYTES: usize = 4 << 20;
/// Most bytes of a voxel: four floats, and a label of 32 bits.
const MOST_VOXEL_BYTES: u64 = 16 + 4;
/// Part of the memory for a volume that its coarse level may take: one of so many.
const COARSE_PART: u64 = 4;
/// Part of the memory for bricks that the level of its shadows may take: one of so many.
const LIGHT_PART: u64 = 2;

/// A volume on the device, with its description on the host.
#[derive(Debug)]
pub struct Uploaded {
    /// Its storage.
    pub storage: Storage,
    /// Its macrocells with their value ranges.
    pub cells: Cells,
    /// Storages and macrocells of further fields.
    pub further: Vec<(Storage, Cells)>,
    /// The places of further fields; `None` of those whose values are in the same texels.
    pub places: Vec<Option<PlacedField>>,
    /// Row of the label table for each voxel, if the plan has labels.
    pub labels: Option<Arc<LabelMap>>,
    pub(super) volume: Image3d,
    pub(super) label_image: Option<Image3d>,
    /// Fields on grids of their own, one behind the other along z.
    pub(super) placed: Option<Image3d>,
    /// The bricks in these textures, if they are the slots of a pool.
    pub(super) pool: Option<Pool>,
    /// A coarse level of a volume in bricks, if its scene has shadows or scattered light.
    level: Option<LightLevel>,
    pub(super) kept: Kept,
    /// Rows of scattered light, and the last such light.
    pub(super) scattering: Kept,
}

/// A coarse level of a volume in bricks, of which light grids are filled and whose light scatters.
#[derive(Debug)]
struct LightLevel {
    coarse: Coarse,
    uploaded: Box<Uploaded>,
    /// Voxels of the volume whose mean is one of it, along each axis.
    block: [usize; 3],
    /// Factors from texture coordinates of the volume to those of the level: its last blocks may be incomplete.
    scale: DVec3,
}

/// True if light on its way to a sample passes voxels that the march may not have read.
pub(super) fn takes_level(plan: &ScenePlan) -> bool {
    plan.light.reads_grid() || plan.light.gathered.is_some()
}

/// Two results of marches that are kept as long as the volume, of types that the march knows: those of finished and of coarse
/// pictures, if no others are stated.
#[derive(Debug, Default)]
pub(super) struct Kept(pub(super) Mutex<[Option<Arc<dyn Any + Send + Sync>>; 2]>);

impl Uploaded {
    /// Bytes of its textures on the device.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let of_level = self.level.as_ref().map_or(0, |level| level.uploaded.bytes());
        let [width, height, depth] = self.volume.extent().map(u64::from);
        let texels = width * height * depth;
        let per_texel = [Some(&self.volume), self.label_image.as_ref()];
        let images = per_texel.into_iter().flatten();
        let of_placed = self.placed.as_ref().map_or(0, |image| {
            let texels: u64 = image.extent().map(u64::from).iter().product();
            texels * u64::from(image.format().texel_bytes())
        });
        of_level + of_placed + images.map(|image| texels * u64::from(image.format().texel_bytes())).sum::<u64>()
    }
}

impl Uploaded {
    /// Storages of all fields.
    #[must_use]
    pub fn storages(&self) -> Vec<&Storage> {
        std::iter::once(&self.storage).chain(self.further.iter().map(|field| &field.0)).collect()
    }

    /// Macrocells of all fields.
    #[must_use]
    pub fn all_cells(&self) -> Vec<&Cells> {
        std::iter::once(&self.cells).chain(self.further.iter().map(|field| &field.1)).collect()
    }

    /// Lowest and highest value of all fields.
    #[must_use]
    pub fn domains(&self) -> Vec<[f64; 2]> {
        self.storages().iter().map(|storage| storage.domain).collect()
    }

    /// The textures that a pool fills.
    pub(super) fn filled(&self) -> Filled<'_> {
        Filled { volume: &self.volume, label_image: self.label_image.as_ref() }
    }

    /// Residence of the volume.
    #[must_use]
    pub fn residence(&self) -> Residence {
        self.pool.as_ref().map_or(Residence::Whole, |pool| Residence::Bricked { apron: pool.apron })
    }

    /// Whether a march of `scene` under `plan` reads only voxels that the slots of a pool have around a brick, and shadows only
    /// where there is a level for them.
    #[must_use]
    pub fn reaches(&self, scene: &Scene, plan: &ScenePlan) -> bool {
        self.pool.as_ref().is_none_or(|pool| apron(scene, plan) <= pool.apron && self.has_light(plan))
    }

    fn has_light(&self, plan: &ScenePlan) -> bool {
        self.pool.is_none() || self.level.is_some() || !takes_level(plan)
    }

    /// The voxels of which light grids are filled, those of a coarse level of a volume in bricks, and the factors from texture
    /// coordinates of the volume to theirs.
    pub(super) fn medium(&self) -> (&Self, DVec3) {
        self.level.as_ref().map_or((self, DVec3::ONE), |level| (&*level.uploaded, level.scale))
    }

    /// `scene` with the voxels whose light scatters, how these are stored, and the factors from texture coordinates of the volume to
    /// theirs: those of a coarse level of a volume in bricks, with nodes as far apart.
    pub(super) fn scattering_medium<'a>(&'a self, scene: &'a Scene) -> (Cow<'a, Scene>, &'a Self, DVec3) {
        let Some(LightLevel { coarse, uploaded, block, scale }) = &self.level else {
            return (Cow::Borrowed(scene), self, DVec3::ONE);
        };
        let mut of_level = coarse.scene(scene);
        let across = block.iter().max().map_or(1.0, |&voxels| count(voxels));
        of_level.scattering.spacing = Some((scene.scattering_spacing() / across).max(0.5));
        (Cow::Owned(of_level), uploaded, *scale)
    }

    /// Voxels along each axis whose mean casts shadows, if these come from a coarse level, as those of a volume in bricks do.
    #[must_use]
    pub fn light_block(&self) -> Option<[usize; 3]> {
        self.level.as_ref().map(|level| level.block)
    }

    /// Refuses a march of a volume in bricks that needs more of it than a brick.
    pub(super) fn check_march(&self, scene: &Scene, plan: &ScenePlan) -> Result<(), RenderError> {
        let Some(pool) = &self.pool else { return Ok(()) };
        if !self.has_light(plan) {
            let what = if plan.light.gathered.is_some() { "scattered light" } else { "shadows" };
            return Err(RenderError::Bricked { what });
        }
        if !self.reaches(scene, plan) {
            let (needed, has) = (apron(scene, plan), pool.apron);
            return Err(RenderError::Apron { needed, has });
        }
        Ok(())
    }
}

/// Texture format of the volume of `scene`, whose values have `statistics`, as `planned` stores it, and bytes of a voxel and its
/// label.
fn stored_as(scene: &Scene, planned: &Planned, statistics: &Statistics) -> (Format, u64) {
    let format = texels(Storage::format_of(&planned.plan, &scene.fields.first().volume, statistics), &planned.plan);
    let declared = scene.labels.as_ref().filter(|_| planned.plan.labels).map(|labels| labels.declared.len());
    let label_bytes = declared.map_or(0, |declared| LabelMap::bytes_of(declared, planned.plan.smooth_labels));
    (format, u64::from(format.texel_bytes()) + label_bytes as u64)
}

/// Texture format of the texels of a volume, or of the values of all fields.
fn texels(format: VolumeFormat, plan: &ScenePlan) -> Format {
    match format {
        VolumeFormat::R16Unorm if plan.groups.sharing > 0 => Format::Rgba16Unorm,
        VolumeFormat::R32Float if plan.groups.sharing > 0 => Format::Rgba32Float,
        VolumeFormat::R16Unorm => Format::R16Unorm,
        VolumeFormat::R32Float => Format::R32Float,
        VolumeFormat::Rgba16Snorm => Format::Rgba16Snorm,
        VolumeFormat::Rgba32Float => Format::Rgba32Float,
    }
}

/// Texels of four numbers of so many `bytes` each, from the texels of each field; the rest of them is 0.
fn interleaved(fields: &[Vec<u8>], bytes: usize) -> Vec<u8> {
    let mut texels = vec![0; fields.first().map_or(0, Vec::len) * FIELDS];
    for (field, numbers) in fields.iter().enumerate() {
        let places = texels.chunks_exact_mut(FIELDS * bytes).zip(numbers.chunks_exact(bytes));
        places.for_each(|(texel, number)| texel[field * bytes..][..bytes].copy_from_slice(number));
    }
    texels
}

impl Renderer {
    /// Uploads the volume of `scene`, whose values have `statistics`, in the storage of `planned`, slab by slab. Of a volume
    /// that exceeds the device's textures or memory, marches upload the bricks that they need.
    ///
    /// # Errors
    ///
    /// [`RenderError`]; limits of the device are checked before anything is allocated.
    pub fn upload(
        &self,
        scene: &Scene,
        planned: &Planned,
        statistics: &Statistics,
        progress: &dyn Progress,
    ) -> Result<Uploaded, RenderError> {
        let field = scene.fields.first();
        // Before the bricks are read.
        if let Some(labels) = &scene.labels {
            labels.volume.require_voxels("a label map").map_err(RenderError::Labels)?;
        }
        let storage = Storage::of(&planned.plan, &field.volume, statistics, progress).map_err(RenderError::Volume)?;
        let dims = field.volume.geometry.dims;
        let format = texels(storage.format, &planned.plan);
        self.check_filter(planned, &storage)?;
        let labels = match &scene.labels {
            Some(labels) if planned.plan.labels => Some(Arc::new(LabelMap::new(labels).map_err(RenderError::Labels)?)),
            _ => None,
        };
        let smooth = planned.plan.smooth_labels;
        let label_format = labels.as_ref().map(|map| match map.texel_bytes(smooth) {
            1 => Format::R8Uint,
            2 => Format::R16Uint,
            _ => Format::R32Uint,
        });
        let label_bytes = labels.as_ref().map_or(0, |map| map.texel_bytes(smooth)) as u64;
        let voxel_bytes = u64::from(format.texel_bytes()) + label_bytes;
        let limit = self.largest_texture(format);
        if field.bricks().is_some()
            || self.always_bricked
            || !self.has_room(dims, format, voxel_bytes, self.volume_budget())
        {
            let cells = match field.bricks() {
                Some(cache) => {
                    Cells::of_cache(dims, cache, &storage, labels.as_deref()).map_err(RenderError::Volume)?
                }
                None => Cells::new(&field.volume, &storage, labels.as_deref()),
            };
            if progress.cancelled() {
                return Err(RenderError::Cancelled);
            }
            if planned.plan.groups.further > 0 {
                return Err(RenderError::Fields);
            }
            let (grid, apron) = (BrickGrid::new(cells.dims), apron(scene, &planned.plan));
            let pool_of = |budget: u64| PoolSize::new(&self.device, grid, apron, (format, voxel_bytes), budget, limit);
            // Before a level is made.
            pool_of(self.pool_budget(0))?;
            let stored = (format, voxel_bytes);
            let level =
                takes_level(&planned.plan).then(|| self.light_level(scene, planned, stored, progress)).transpose()?;
            let beside = level.as_ref().map_or(0, |level| level.uploaded.bytes());
            let size = pool_of(self.pool_budget(beside))?;
            let volume = Image3d::new(&self.device, "bricks", format, size.extent())?;
            let label_image = label_format
                .map(|format| Image3d::new(&self.device, "bricks of labels", format, size.extent()))
                .transpose()?;
            let (source, labelled) = ((&field.volume, &storage), (labels.as_ref(), smooth));
            let pool = Some(Pool::new(&self.device, size, grid, source, labelled)?);
            return Ok(Uploaded {
                storage,
                cells,
                further: Vec::new(),
                places: Vec::new(),
                labels,
                volume,
                label_image,
                placed: None,
                pool,
                level,
                kept: Kept::default(),
                scattering: Kept::default(),
            });
        }
        let storages = Storage::of_further(&planned.plan, scene);
        let volume = self.fill("volume", format, dims, progress, |slices| {
            let first = storage.slab(&field.volume, slices.clone());
            if scene.fields.sharing().is_empty() {
                return first;
            }
            let further = storages.iter().zip(scene.fields.sharing());
            let further = further.map(|(storage, field)| storage.slab(&field.volume, slices.clone()));
            interleaved(&std::iter::once(first).chain(further).collect::<Vec<_>>(), storage.format.bytes())
        })?;
        let label_image = labels
            .as_ref()
            .zip(label_format)
            .map(|(map, format)| self.fill("labels", format, dims, progress, |slices| map.texels(dims, slices, smooth)))
            .transpose()?;
        let placed = self.placed(scene, &storages, progress)?;
        let cells = Cells::new(&field.volume, &storage, labels.as_deref());
        let further = storages.into_iter().zip(scene.fields.further());
        let further = further.map(|(storage, field)| {
            let cells = Cells::new(&field.volume, &storage, None);
            (storage, cells)
        });
        let further = further.collect();
        Ok(Uploaded {
            storage,
            cells,
            further,
            places: PlacedField::of_further(scene),
            labels,
            volume,
            label_image,
            placed,
            pool: None,
            level: None,
            kept: Kept::default(),
            scattering: Kept::default(),
        })
    }

    /// Uploads the fields on grids of their own, stored as the last of `storages`.
    fn placed(
        &self,
        scene: &Scene,
        storages: &[Storage],
        progress: &dyn Progress,
    ) -> Result<Option<Image3d>, RenderError> {
        let fields = scene.fields.beside();
        let storages = &storages[scene.fields.sharing().len()..];
        let Some(format) = storages.first().map(|storage| storage.format) else { return Ok(None) };
        let dims = || fields.iter().map(|field| field.volume.geometry.dims);
        let [width, height] = [0, 1].map(|axis| dims().map(|dims| dims[axis]).max().unwrap_or(1));
        let all = [width, height, dims().map(|dims| dims[2]).sum()];
        let bytes = format.bytes();
        let format = match format {
            VolumeFormat::R16Unorm => Format::R16Unorm,
            VolumeFormat::R32Float => Format::R32Float,
            VolumeFormat::Rgba16Snorm => Format::Rgba16Snorm,
            VolumeFormat::Rgba32Float => Format::Rgba32Float,
        };
        if !self.has_room(all, format, bytes as u64, self.volume_budget()) {
            return Err(RenderError::Fields);
        }
        // Slices of all fields in turn: number of the field, and of its slice.
        let slices: Vec<(usize, usize)> =
            dims().enumerate().flat_map(|(field, dims)| (0..dims[2]).map(move |slice| (field, slice))).collect();
        let image = self.fill("placed volumes", format, all, progress, |range| {
            let of_slice = |&(field, slice): &(usize, usize)| {
                let own = storages[field].slab(&fields[field].volume, slice..slice + 1);
                let [across, down, _] = fields[field].volume.geometry.dims;
                let mut padded = vec![0; width * height * bytes];
                for (row, numbers) in own.chunks_exact(across * bytes).enumerate().take(down) {
                    padded[row * width * bytes..][..across * bytes].copy_from_slice(numbers);
                }
                padded
            };
            slices[range].iter().flat_map(of_slice).collect()
        })?;
        Ok(Some(image))
    }

    /// Uploads the finest coarse level of the volume of `scene` for which there is room beside its bricks.
    fn light_level(
        &self,
        scene: &Scene,
        planned: &Planned,
        (format, voxel_bytes): (Format, u64),
        progress: &dyn Progress,
    ) -> Result<LightLevel, RenderError> {
        // It leaves room for a brick.
        let slot_bytes = u64::from(slot_edge(apron(scene, &planned.plan))).pow(3) * voxel_bytes;
        let all = self.bricked_bytes();
        let budget = (all / LIGHT_PART).min(all.saturating_sub(slot_bytes));
        let fits = |dims: [usize; 3]| self.has_room(dims, format, voxel_bytes, budget);
        let coarse = finest_level(scene, fits, progress)?;
        let (block, level) = (coarse.block(), coarse.scene(scene));
        let statistics = level.volume().statistics().map_err(RenderError::Volume)?;
        let covered = |axis: usize| count(block[axis] * level.frame.geometry.dims[axis]);
        let scale = std::array::from_fn(|axis| count(scene.frame.geometry.dims[axis]) / covered(axis));
        let whole = Self { always_bricked: false, taken_bytes: 0, ..self.clone() };
        let uploaded = Box::new(whole.upload(&level, planned, &statistics, progress)?);
        Ok(LightLevel { coarse, uploaded, block, scale: DVec3::from_array(scale) })
    }

    /// Whether a texture of `dims` voxels, with labels `voxel_bytes` bytes each, takes at most `budget` bytes, and neither an axis nor
    /// its memory exceeds the device's textures of `format`.
    fn has_room(&self, dims: [usize; 3], format: Format, voxel_bytes: u64, budget: u64) -> bool {
        let voxels = dims.iter().fold(1_u64, |product, &n| product.saturating_mul(n as u64));
        let limit = self.largest_texture(format);
        dims.iter().zip(limit).all(|(&n, limit)| n as u64 <= u64::from(limit))
            && voxels.saturating_mul(voxel_bytes) <= budget
            && is_one_allocation(&self.device, format, dims.map(unsigned))
    }

    /// Whether the device holds the volume of `scene`, whose values have `statistics`, whole, as `planned` stores it.
    #[must_use]
    pub fn holds_whole(&self, scene: &Scene, planned: &Planned, statistics: &Statistics) -> bool {
        if scene.fields.first().bricks().is_some() || self.always_bricked {
            return false;
        }
        let (format, voxel_bytes) = stored_as(scene, planned, statistics);
        self.has_room(scene.frame.geometry.dims, format, voxel_bytes, self.volume_budget())
    }

    /// Refuses a volume that the device holds neither whole nor one brick of it, from the description of [`Self::holds_whole`].
    ///
    /// # Errors
    ///
    /// [`RenderError`], with the size and the limit.
    pub fn check_room(&self, scene: &Scene, planned: &Planned, statistics: &Statistics) -> Result<(), RenderError> {
        if self.holds_whole(scene, planned, statistics) {
            return Ok(());
        }
        let stored = stored_as(scene, planned, statistics);
        let grid = BrickGrid::new(macrocells(scene.frame.geometry.dims));
        let (apron, limit) = (apron(scene, &planned.plan), self.largest_texture(stored.0));
        PoolSize::new(&self.device, grid, apron, stored, self.pool_budget(0), limit).map(drop)
    }

    /// Whether there is room for a coarse level of `dims` voxels beside the bricks of its volume, however it is stored.
    #[must_use]
    pub fn has_room_for_coarse(&self, dims: [usize; 3]) -> bool {
        // The level is the same beside another one.
        let budget = self.most_volume_bytes(0) / COARSE_PART;
        let formats = [Format::R16Unorm, Format::R32Float, Format::Rgba16Snorm, Format::Rgba32Float];
        // A texture of a format that the device lacks is refused by name.
        let mut known = formats.into_iter().filter(|&format| self.largest_texture(format) != [0; 3]);
        known.all(|format| self.has_room(dims, format, MOST_VOXEL_BYTES, budget))
    }

    /// The same renderer beside another volume of `bytes`: with less memory for a volume, if the user has stated how much there
    /// is, and for pictures.
    #[must_use]
    pub fn beside(&self, bytes: u64) -> Self {
        // A renderer of a coarse level may count bricks beside it that are gone.
        Self { taken_bytes: self.taken_bytes + bytes, beside_bytes: bytes, ..self.clone() }
    }

    /// Refuses a volume that the device cannot filter.
    fn check_filter(&self, planned: &Planned, storage: &Storage) -> Result<(), RenderError> {
        let format = texels(storage.format, &planned.plan);
        if planned.plan.interpolation.is_filtered() && !self.device.limits().linear_filter(format) {
            let device = self.device.info().name.clone();
            return Err(RenderError::Filter { format: storage.format, device });
        }
        Ok(())
    }

    /// Creates an image of `dims` texels; `bytes(slices)` are the texels of its slices.
    fn fill(
        &self,
        name: &str,
        format: Format,
        dims: [usize; 3],
        progress: &dyn Progress,
        bytes: impl Fn(std::ops::Range<usize>) -> Vec<u8>,
    ) -> Result<Image3d, RenderError> {
        let [width, height, depth] = dims.map(|n| u32::try_from(n).unwrap_or(u32::MAX));
        let image = Image3d::new(&self.device, name, format, [width, height, depth])?;
        let slice_bytes = dims[0] * dims[1] * format.texel_bytes() as usize;
        let slices = (SLAB_BYTES / slice_bytes).clamp(1, dims[2]);
        let staging_bytes = (slices * slice_bytes) as u64;
        let staging = Buffer::host(&self.device, "staging", staging_bytes.next_multiple_of(4), HostUse::Upload)?;
        for first in (0..dims[2]).step_by(slices) {
            if progress.cancelled() {
                return Err(RenderError::Cancelled);
            }
            let end = (first + slices).min(dims[2]);
            staging.write(0, &bytes(first..end))?;
            let range = u32::try_from(first).unwrap_or(u32::MAX)..u32::try_from(end).unwrap_or(u32::MAX);
            self.device.run("upload", |recorder| recorder.upload(&image, range, &staging, 0))?;
            progress.report("uploading the volume", end as u64, dims[2] as u64);
        }
        Ok(image)
    }
}
