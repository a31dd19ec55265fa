//! The march on the device, in bands of rows and slices of rays, so that every dispatch is short.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use bytemuck::{Pod, Zeroable};
use half::f16;

use super::{RenderError, Renderer, Source, Uploaded};
use crate::film::Film;
use crate::number::rounded;
use crate::number::{count, unsigned, whole};
use crate::plan::{Accumulate, LANE, Planned, ScenePlan, Shares, Transmittance};
use crate::progress::Progress;
use crate::scene::{Interpolation, Lookup, Scene, StoreAs};
use crate::shader::Constants;
use crate::tables::{PositionTable, RayTable, ShadingTable, TransferTable};
use crate::vulkan::{
    Buffer, ComputePipeline, Device, DeviceKind, Filter, Format, HostUse, Resource, ResourceSet, Sampler, StorageImage,
};

/// Target duration of a dispatch: short for responses to user input, and for the device's watchdog.
const DISPATCH: Duration = Duration::from_millis(50);
/// Samples in the first dispatch of a march of unknown speed.
const FIRST_SAMPLES: f64 = 2e7;
/// Fraction of a march's time that counts as its slow part; an occasional delay of a dispatch takes less.
const SLOW: f64 = 0.1;
/// Smallest fraction of the target duration at which a dispatch measures the device's speed.
const TELLING: f64 = 0.15;
/// Largest dispatch, as a multiple of the samples that fit into the target duration in the slow part of the march.
const BOLDNESS: f64 = 1.5;
/// The same after a march of a picture of another size.
const BOLDNESS_ELSEWHERE: f64 = 4.0;
/// Smallest number of samples along a ray per dispatch; with fewer, the start of a ray would take longer.
const SHORTEST_SLICE: u32 = 16;
/// Largest number of samples along a ray per dispatch.
pub(super) const SLICE: u32 = 16_384;
/// Dimension of the largest matrices that are marched; larger ones would not stay in registers.
pub(super) const LARGEST_MATRIX: usize = 8;
/// Bytes of a table in a uniform buffer, the limit of most devices.
const UNIFORM_BYTES: u32 = 65_536;
/// Bytes of a table's vector.
const VECTOR_BYTES: u32 = 16;
/// Largest number of iterations of all loops of an invocation; some devices stop it, silently, at 65,535.
const ITERATIONS: usize = 65_000;

/// Division of a march into workgroups and dispatches. It affects time only: accumulators are the same to the byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dispatching {
    /// Pixels of a workgroup, across and down.
    pub group: [u32; 2],
    /// Largest number of samples per dispatch, unless the smallest part of one row of workgroups has more; `None` aims
    /// at about 50 ms.
    pub samples: Option<u32>,
    /// Largest number of samples along a ray per dispatch, 1 to 16,384.
    pub slice: u32,
    /// Memory of the tables, if they fit there.
    pub tables: TableMemory,
}

/// Memory of the tables of the transfer function and of the labels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TableMemory {
    /// Storage buffers of any length. The lanes of a GPU read different entries at once.
    Storage,
    /// Uniform buffers of 64 KiB; longer tables stay in storage buffers. Lavapipe reads storage lane by lane with a
    /// branch for each, and uniforms without branches. A GPU would read the entries of its lanes one after the other.
    Uniform,
}

impl TableMemory {
    /// The memory with the fastest march on `device`.
    pub(super) fn fastest(device: &Device) -> Self {
        if device.info().kind == DeviceKind::Software { Self::Uniform } else { Self::Storage }
    }
}

impl Default for Dispatching {
    fn default() -> Self {
        // Lavapipe's lanes are eight neighbours in x.
        Self { group: [8, 8], samples: None, slice: SLICE, tables: TableMemory::Storage }
    }
}

/// Uniform of a frame, in the layout of `shaders/march.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
#[expect(missing_docs, reason = "named and explained in the shader and in `RayTable`")]
pub struct MarchUniform {
    pub base: [f32; 3],
    pub eye_distance: f32,
    pub base_u: [f32; 3],
    pub spread_u: f32,
    pub base_v: [f32; 3],
    pub spread_v: f32,
    pub direction: [f32; 3],
    pub step_length: f32,
    pub direction_u: [f32; 3],
    pub termination: f32,
    pub direction_v: [f32; 3],
    pub coordinate_scale: f32,
    pub low: [f32; 3],
    pub coordinate_offset: f32,
    pub high: [f32; 3],
    pub coordinate_last: f32,
    pub cell_scale: [f32; 3],
    pub pixel_width: f32,
    pub cell_offset: [f32; 3],
    pub pixel_height: f32,
    pub local_scale: [f32; 3],
    pub samples: u32,
    pub gradient_scale: [f32; 3],
    pub width: u32,
    pub cells: [u32; 3],
    pub height: u32,
    pub crop_low: [f32; 3],
    pub active_low: f32,
    pub crop_high: [f32; 3],
    pub active_high: f32,
}

/// Push constants of a dispatch, in the layout of `shaders/march.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Band {
    first_row: u32,
    first_sample: u32,
    end_sample: u32,
}

/// Buffers of tables by their names in the shader.
type Tables = [(&'static str, Buffer); 4];

/// A film on the device. Clones share its images.
#[derive(Clone, Debug)]
pub struct DeviceFilm {
    /// The plan of its march.
    pub planned: Planned,
    /// Width and height in pixels.
    pub size: [usize; 2],
    /// Number of dispatches of its march.
    pub dispatches: usize,
    /// Duration of these dispatches by the device's clock; `None` if it has none.
    pub device_time: Option<Duration>,
    /// Number of occupied macrocells, and of all macrocells.
    pub occupied: [usize; 2],
    pub(super) accumulators: StorageImage,
    pub(super) transmittance: StorageImage,
}

/// A march in progress. It pauses after every dispatch, and is cancelled by dropping it.
#[derive(Debug)]
pub struct March {
    pipeline: ComputePipeline,
    set: ResourceSet,
    schedule: Schedule,
    left: DeviceFilm,
}

/// Target duration of a dispatch, and how many samples fit into it, as far as is known.
#[derive(Clone, Copy, Debug)]
pub struct Speed {
    dispatch: Duration,
    /// Samples of the first dispatch, if known.
    first: Option<f64>,
    /// Largest number of samples of any dispatch: fast rows in empty space may precede slow rows in the volume.
    most: f64,
}

impl Speed {
    /// Speed of an unknown device of this kind, for dispatches of about `dispatch`.
    pub(super) fn unknown(dispatch: Duration, kind: DeviceKind) -> Self {
        // Few enough samples for a slow device.
        let first = FIRST_SAMPLES / 32.0;
        // The speed of a software device in empty space does not predict its speed elsewhere; other devices adapt.
        let most = if kind == DeviceKind::Software { first } else { f64::INFINITY };
        Self { dispatch, first: Some(first), most }
    }

    /// The speed to assume for pictures of another size.
    #[must_use]
    pub fn elsewhere(self) -> Self {
        Self { most: self.most * BOLDNESS_ELSEWHERE / BOLDNESS, ..self }
    }
}

impl Default for Speed {
    fn default() -> Self {
        Self { dispatch: DISPATCH, first: None, most: f64::INFINITY }
    }
}

/// Shader texts by name: source, transmittance, memory of tables, and the march.
fn parts(plan: &ScenePlan, tables: TableMemory) -> [(&'static str, &'static str); 4] {
    [
        match plan.accumulate {
            Accumulate::Weights { .. } => ("shaders/weights.wgsl", include_str!("../../shaders/weights.wgsl")),
            Accumulate::Spectral { .. } => ("shaders/spectral.wgsl", include_str!("../../shaders/spectral.wgsl")),
        },
        match plan.transmittance {
            Transmittance::Grey => ("shaders/grey.wgsl", include_str!("../../shaders/grey.wgsl")),
            Transmittance::Coloured => ("shaders/coloured.wgsl", include_str!("../../shaders/coloured.wgsl")),
            Transmittance::Mixed => ("shaders/mixed.wgsl", include_str!("../../shaders/mixed.wgsl")),
        },
        match tables {
            TableMemory::Storage => ("shaders/tables_storage.wgsl", include_str!("../../shaders/tables_storage.wgsl")),
            TableMemory::Uniform => ("shaders/tables_uniform.wgsl", include_str!("../../shaders/tables_uniform.wgsl")),
        },
        ("shaders/march.wgsl", include_str!("../../shaders/march.wgsl")),
    ]
}

/// Formats of accumulators and transmittance.
pub(super) fn formats(plan: &ScenePlan, storage: StoreAs) -> [Format; 2] {
    let vectors = match storage {
        StoreAs::Single => Format::Rgba32Float,
        StoreAs::Half => Format::Rgba16Float,
    };
    match plan.transmittance {
        Transmittance::Grey => [vectors, Format::R32Float],
        Transmittance::Coloured | Transmittance::Mixed => [vectors, vectors],
    }
}

/// WGSL types of the images of accumulators and transmittance.
pub(super) fn images(plan: &ScenePlan, storage: StoreAs, access: &str) -> [String; 2] {
    formats(plan, storage).map(|format| {
        let format = match format {
            Format::R32Float => "r32float",
            Format::Rgba16Float => "rgba16float",
            _ => "rgba32float",
        };
        format!("texture_storage_2d_array<{format}, {access}>")
    })
}

/// Constants of both the march and the relight shader.
pub(super) fn common(plan: &ScenePlan) -> Constants {
    Constants::new().u32("LAYERS", unsigned(plan.layers().max(1))).u32("LAYERS_USED", unsigned(plan.layers()))
}

/// Constants of the march shader for `plan`.
fn constants(plan: &ScenePlan, group: [u32; 2]) -> Constants {
    let (specular, parts) = (plan.specular(), plan.parts());
    let [_, transmittance] = images(plan, StoreAs::Single, "read_write");
    let one_exponent = specular.and_then(|specular| specular.one_exponent);
    let (materials, dimension, shares, exponents) = match plan.accumulate {
        Accumulate::Weights { materials } => (materials, 0, Shares::Own, 0),
        Accumulate::Spectral { dimension, shares, exponents } => (0, dimension, shares, exponents),
    };
    common(plan)
        .u32("LANES", unsigned(plan.lanes().max(1)))
        .u32("COMPONENTS", unsigned(dimension))
        .u32("TABLE_LANES", unsigned(parts.lanes.max(1)))
        .u32("SHADING_LANES", unsigned(plan.shading_lanes()))
        .u32("UNSHADED", unsigned(parts.unshaded))
        .u32("DIFFUSE", unsigned(parts.diffuse))
        .u32("HIGHLIGHTS", unsigned(parts.highlights))
        .u32("EXPONENTS", unsigned(exponents))
        .bool("EQUAL_SHARES", shares == Shares::Equal)
        .bool("COLOURED", plan.transmittance != Transmittance::Grey)
        .u32("TRANSMITTANCE_NUMBERS", unsigned(plan.transmittance_numbers()))
        .u32("TRANSMITTANCE_LANES", unsigned(plan.transmittance_lanes()))
        .alias("TransmittanceImage", &transmittance)
        .u32("POSITIONS", unsigned(plan.positions.total().max(1)))
        .u32("POSITIONS_USED", unsigned(if plan.layers() == 0 { 0 } else { plan.positions.total() }))
        .u32("AMBIENT", unsigned(plan.positions.ambient))
        .u32("HEADLIGHT", unsigned(plan.positions.headlight))
        .u32("DIRECTIONAL", unsigned(plan.positions.directional))
        .u32("POINT", unsigned(plan.positions.point))
        .bool("SHADED", plan.shading.is_some())
        .bool("GRADIENT", plan.gradient())
        .bool("STORED_GRADIENT", plan.stores_gradient())
        .bool("SPECULAR", specular.is_some())
        .bool("ONE_EXPONENT", one_exponent.is_some())
        .u32("ONE_EXPONENT_VALUE", one_exponent.unwrap_or(0))
        .u32("EXPONENT_BITS", specular.map_or(0, |specular| specular.exponent_bits))
        // Position of the weight of white after those of the materials, if there is one.
        .u32("WHITE_LANE", unsigned(specular.map_or(0, |_| materials / LANE)))
        .u32("WHITE_PART", unsigned(specular.map_or(0, |_| materials % LANE)))
        .bool("LABELS", plan.labels)
        .bool("EXACT_LINEAR", plan.interpolation == Interpolation::ExactLinear)
        .bool("CUBIC", plan.interpolation == Interpolation::Cubic)
        .bool("NEAREST_LOOKUP", plan.lookup == Lookup::Nearest)
        .bool("SKIPPING", plan.skipping)
        .bool("SEEKING", plan.seeks())
        .u32("GROUP_WIDTH", group[0])
        .u32("GROUP_HEIGHT", group[1])
        .u32("UNIFORM_VECTORS", UNIFORM_BYTES / VECTOR_BYTES)
}

/// Source of the march shader of `plan`.
pub(super) fn source(plan: &ScenePlan, dispatching: Dispatching) -> Source {
    let parts = parts(plan, dispatching.tables).to_vec();
    Source { name: "march", constants: constants(plan, dispatching.group), parts }
}

impl MarchUniform {
    fn new(scene: &Scene, uploaded: &Uploaded, rays: &RayTable, table: &TransferTable, size: [usize; 2]) -> Self {
        let vector = |vector: glam::DVec3| vector.to_array().map(rounded);
        let [scale, offset] = table.coordinate_from_texel(&uploaded.storage);
        let [active_low, active_high] = table.active();
        Self {
            base: vector(rays.base),
            eye_distance: rounded(rays.eye_distance),
            base_u: vector(rays.base_u),
            spread_u: rounded(rays.spread_u),
            base_v: vector(rays.base_v),
            spread_v: rounded(rays.spread_v),
            direction: vector(rays.direction),
            step_length: rounded(rays.step_length),
            direction_u: vector(rays.direction_u),
            termination: rounded(scene.accuracy.termination),
            direction_v: vector(rays.direction_v),
            coordinate_scale: rounded(scale),
            low: vector(rays.low),
            coordinate_offset: rounded(offset),
            high: vector(rays.high),
            coordinate_last: rounded(count(table.entries() - 1)),
            cell_scale: vector(rays.cell_scale),
            pixel_width: rounded(2.0 / count(size[0])),
            cell_offset: vector(rays.cell_offset),
            pixel_height: rounded(2.0 / count(size[1])),
            local_scale: vector(rays.local_scale),
            samples: rays.samples,
            gradient_scale: uploaded.storage.gradient_scale().map(rounded),
            width: unsigned(size[0]),
            cells: uploaded.cells.dims.map(unsigned),
            height: unsigned(size[1]),
            crop_low: vector(rays.crop_low),
            active_low: rounded(active_low),
            crop_high: vector(rays.crop_high),
            active_high: rounded(active_high),
        }
    }
}

impl Renderer {
    /// Marches a picture of `size` (width, height) of the `uploaded` volume of `scene`.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn march(
        &self,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        size: [usize; 2],
        progress: &dyn Progress,
    ) -> Result<DeviceFilm, RenderError> {
        let known =
            self.learnt().as_ref().filter(|(plan, _)| *plan == planned.plan).map(|(_, speed)| speed.elsewhere());
        let mut march = self.begin_march(scene, planned, uploaded, size, known.unwrap_or(self.speed))?;
        while !march.is_done() {
            if progress.cancelled() {
                return Err(RenderError::Cancelled);
            }
            march.step(self)?;
            progress.report("marching", march.rows_done().into(), size[1] as u64);
        }
        *self.learnt() = Some((planned.plan.clone(), march.speed()));
        march.finish(self)
    }

    /// Sets up the march of a picture of `size` (width, height) of the `uploaded` volume of `scene`, which proceeds by
    /// [`March::step`]. `speed`, from an earlier march, determines the size of the first dispatch.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn begin_march(
        &self,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        size: [usize; 2],
        speed: Speed,
    ) -> Result<March, RenderError> {
        let plan = &planned.plan;
        let device = &self.device;
        self.check_picture(plan, size, uploaded.bytes())?;
        if plan.transmittance == Transmittance::Mixed && plan.components() > LARGEST_MATRIX {
            return Err(RenderError::Matrix { dimension: plan.components(), largest: LARGEST_MATRIX });
        }
        self.shared.marches.fetch_add(1, Ordering::Relaxed);
        let aspect = count(size[0]) / count(size[1]);
        let view = scene.camera.view(&scene.volume.geometry, aspect).ok_or(RenderError::Camera)?;
        let step_length = scene.accuracy.step_length;
        let rays = RayTable::new(scene, &view).ok_or(RenderError::TooManySamples { step_length })?;
        let table = TransferTable::new(scene, planned, uploaded.storage.domain);
        let occupancy = uploaded.cells.occupancy(&table);
        let extent = size.map(unsigned);

        let storage = |name: &str, bytes: &[u8]| -> Result<Buffer, RenderError> {
            // Buffers are never empty; the shader does not read an array without entries.
            let bytes = if bytes.is_empty() { &[0; 16] } else { bytes };
            let buffer = Buffer::host(device, name, bytes.len() as u64, HostUse::Storage)?;
            buffer.write(0, bytes)?;
            Ok(buffer)
        };
        let uniform = |name: &str, bytes: &[u8]| -> Result<Buffer, RenderError> {
            let buffer = Buffer::host(device, name, bytes.len() as u64, HostUse::Uniform)?;
            buffer.write(0, bytes)?;
            Ok(buffer)
        };
        let march = uniform("march", bytemuck::bytes_of(&MarchUniform::new(scene, uploaded, &rays, &table, size)))?;
        let shading = uniform("shading", &shading_bytes(scene, planned))?;
        let occupied = storage("occupancy", bytemuck::cast_slice(&occupancy.words))?;
        let (tables, tabled) = self.tables(&table, &TransferTable::of_labels(scene, planned))?;
        let filter = match plan.interpolation {
            Interpolation::Linear => Filter::Linear,
            // These fetch texels themselves.
            Interpolation::Nearest | Interpolation::ExactLinear | Interpolation::Cubic => Filter::Nearest,
        };
        let sampler = Sampler::new(device, "volume", filter)?;
        let [vectors, format] = formats(plan, StoreAs::Single);
        let accumulators = StorageImage::new(device, "accumulators", vectors, extent, unsigned(plan.layers().max(1)))?;
        let transmittance =
            StorageImage::new(device, "transmittance", format, extent, unsigned(plan.transmittance_lanes().max(1)))?;

        let (pipeline, set) = self.bind(source(plan, Dispatching { tables, ..self.dispatching }), |name| {
            Some(match name {
                "march_uniform" => Resource::Uniform(&march),
                "shading_uniform" => Resource::Uniform(&shading),
                "volume" => Resource::Texture(&uploaded.volume),
                "volume_sampler" => Resource::Sampler(&sampler),
                "occupancy" => Resource::Storage(&occupied),
                "labels" => Resource::Texture(uploaded.label_image.as_ref()?),
                "accumulators" => Resource::StorageImage(&accumulators),
                "transmittances" => Resource::StorageImage(&transmittance),
                _ => {
                    let (_, buffer) = tabled.iter().find(|(table, _)| *table == name)?;
                    match tables {
                        TableMemory::Storage => Resource::Storage(buffer),
                        TableMemory::Uniform => Resource::Uniform(buffer),
                    }
                }
            })
        })?;

        let slice = self.dispatching.slice.min(longest_slice(plan));
        let dispatching = Dispatching { slice, ..self.dispatching };
        let schedule = Schedule::new(extent, rays.samples, dispatching, plan.layers(), speed);
        let occupied = [occupancy.occupied, occupancy.dims.iter().product()];
        let left = DeviceFilm {
            planned: planned.clone(),
            size,
            dispatches: 0,
            device_time: Some(Duration::ZERO),
            occupied,
            accumulators,
            transmittance,
        };
        Ok(March { pipeline, set, schedule, left })
    }

    /// Memory and buffers of the tables of values and labels, by their names in the shader.
    fn tables(&self, values: &TransferTable, labels: &TransferTable) -> Result<(TableMemory, Tables), RenderError> {
        let tables: [(&'static str, &[u8]); 4] = [
            ("table_source", bytemuck::cast_slice(&values.source)),
            ("table_opacity", bytemuck::cast_slice(&values.opacity)),
            ("label_source", bytemuck::cast_slice(&labels.source)),
            ("label_opacity", bytemuck::cast_slice(&labels.opacity)),
        ];
        let room = self.device.limits().max_uniform_buffer_bytes >= u64::from(UNIFORM_BYTES);
        let short = tables.iter().all(|(_, bytes)| bytes.len() as u64 <= u64::from(UNIFORM_BYTES));
        let memory = if room && short { self.dispatching.tables } else { TableMemory::Storage };
        let buffer = |(name, bytes): (&'static str, &[u8])| -> Result<_, RenderError> {
            let (size, host_use) = match memory {
                // Whole vectors, and at least one; the shader does not read a table without entries.
                TableMemory::Storage => {
                    (bytes.len().max(1).next_multiple_of(VECTOR_BYTES as usize) as u64, HostUse::Storage)
                }
                TableMemory::Uniform => (UNIFORM_BYTES.into(), HostUse::Uniform),
            };
            let buffer = Buffer::host(&self.device, name, size, host_use)?;
            buffer.write(0, bytes)?;
            Ok((name, buffer))
        };
        let [source, opacity, label_source, label_opacity] = tables.map(buffer);
        Ok((memory, [source?, opacity?, label_source?, label_opacity?]))
    }

    /// Copies a film to the host.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn read(&self, film: &DeviceFilm) -> Result<Film<f32>, RenderError> {
        let plan = &film.planned.plan;
        let (size, components) = (film.size, plan.components());
        let pixels = size[0] * size[1];
        let mut accumulators = Vec::with_capacity(components * plan.positions.total() * pixels);
        for position in 0..plan.positions.total() {
            accumulators.extend(self.read_numbers(&film.accumulators, position * plan.lanes(), components)?);
        }
        let transmittance = match plan.transmittance {
            Transmittance::Grey => read_layer(&self.device, &film.transmittance, 0)?,
            Transmittance::Coloured | Transmittance::Mixed => {
                self.read_numbers(&film.transmittance, 0, plan.transmittance_numbers())?
            }
        };
        Ok(Film { size, components, accumulators, transmittance })
    }

    /// Copies pixel `[x, y]` (y down) of a film to the host, as a film of one pixel.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn read_pixel(&self, film: &DeviceFilm, pixel: [usize; 2]) -> Result<Film<f32>, RenderError> {
        let plan = &film.planned.plan;
        let images = [(&film.accumulators, plan.layers()), (&film.transmittance, plan.transmittance_lanes())];
        let texels =
            || images.iter().flat_map(|&(image, layers)| (0..unsigned(layers)).map(move |layer| (image, layer)));
        let bytes: u64 = texels().map(|(image, _)| u64::from(image.format().texel_bytes())).sum();
        let buffer = Buffer::host(&self.device, "a pixel", bytes, HostUse::ReadBack)?;
        self.device.run("a pixel", |recorder| {
            recorder.compute_to_transfer();
            let mut offset = 0;
            for (image, layer) in texels() {
                recorder.read_back_texel(image, layer, pixel.map(unsigned), &buffer, offset)?;
                offset += u64::from(image.format().texel_bytes());
            }
            recorder.transfer_to_host();
            Ok(())
        })?;
        let mut read = vec![0; usize::try_from(bytes).unwrap_or(usize::MAX)];
        buffer.read(0, &mut read)?;
        let accumulators = texels_of(&film.accumulators, plan.layers());
        let (accumulators, rest) = read.split_at(accumulators);
        let numbers = |image: &StorageImage, bytes: &[u8]| -> Vec<f32> {
            match image.format() {
                Format::Rgba16Float => bytemuck::pod_collect_to_vec::<u8, u16>(bytes)
                    .into_iter()
                    .map(|bits| f16::from_bits(bits).to_f32())
                    .collect(),
                _ => bytemuck::pod_collect_to_vec(bytes),
            }
        };
        let (components, lanes) = (plan.components(), plan.lanes().max(1) * LANE);
        let accumulators = numbers(&film.accumulators, accumulators);
        let accumulators =
            accumulators.chunks_exact(lanes).flat_map(|position| &position[..components]).copied().collect();
        let mut transmittance = numbers(&film.transmittance, rest);
        transmittance.truncate(plan.transmittance_numbers());
        Ok(Film { size: [1, 1], components, accumulators, transmittance })
    }

    /// Reads `count` numbers of every pixel, plane by plane, starting at the layer `first`.
    fn read_numbers(&self, image: &StorageImage, first: usize, count: usize) -> Result<Vec<f32>, RenderError> {
        let mut numbers = Vec::new();
        for lane in 0..count.div_ceil(LANE) {
            let texels: Vec<[f32; LANE]> = match image.format() {
                Format::Rgba16Float => {
                    let halves: Vec<[u16; LANE]> = read_layer(&self.device, image, unsigned(first + lane))?;
                    halves.into_iter().map(|texel| texel.map(|bits| f16::from_bits(bits).to_f32())).collect()
                }
                _ => read_layer(&self.device, image, unsigned(first + lane))?,
            };
            for part in 0..LANE.min(count - lane * LANE) {
                numbers.extend(texels.iter().map(|texel| texel[part]));
            }
        }
        Ok(numbers)
    }
}

impl March {
    /// Whether only [`Self::finish`] remains.
    #[must_use]
    pub fn is_done(&self) -> bool {
        self.schedule.is_done()
    }

    /// Number of finished rows of the picture.
    #[must_use]
    pub fn rows_done(&self) -> u32 {
        self.schedule.row.min(self.schedule.size[1])
    }

    /// Width and height in pixels.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        self.left.size
    }

    /// Speed measured so far.
    #[must_use]
    pub fn speed(&self) -> Speed {
        self.schedule.speed()
    }

    /// Runs the next dispatch on `renderer`, which must be the one that began the march.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn step(&mut self, renderer: &Renderer) -> Result<(), RenderError> {
        let Some((band, rows)) = self.schedule.next() else { return Ok(()) };
        let begun = Instant::now();
        let took = renderer.device.run_timed("march", |recorder| {
            if band.first_sample > 0 {
                recorder.compute_to_compute();
            }
            let group = self.schedule.dispatching.group;
            let groups = [self.schedule.size[0].div_ceil(group[0]), rows.div_ceil(group[1]), 1];
            recorder.dispatch(&self.pipeline, &self.set, bytemuck::bytes_of(&band), groups)
        })?;
        renderer.shared.longest_dispatch.fetch_max(whole(self.schedule.taken) as u64, Ordering::Relaxed);
        self.schedule.took(begun.elapsed());
        self.left.device_time = self.left.device_time.zip(took).map(|(sum, took)| sum + took);
        self.left.dispatches += 1;
        Ok(())
    }

    /// Returns the film of a finished march, stored as its plan states.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn finish(self, renderer: &Renderer) -> Result<DeviceFilm, RenderError> {
        renderer.store(self.left)
    }
}

/// Bytes of a pixel in `layers` layers of `image`.
fn texels_of(image: &StorageImage, layers: usize) -> usize {
    layers * image.format().texel_bytes() as usize
}

/// Reads the texels of a layer, rows from the top.
pub(super) fn read_layer<T: Pod>(device: &Device, image: &StorageImage, layer: u32) -> Result<Vec<T>, RenderError> {
    let bytes = image.layer_bytes();
    let buffer = Buffer::host(device, "read-back", bytes, HostUse::ReadBack)?;
    device.run("read-back", |recorder| {
        recorder.compute_to_transfer();
        recorder.read_back(image, layer, &buffer, 0)?;
        recorder.transfer_to_host();
        Ok(())
    })?;
    let texels = usize::try_from(bytes).unwrap_or(usize::MAX) / size_of::<T>();
    let mut read = vec![T::zeroed(); texels];
    buffer.read(0, bytemuck::cast_slice_mut(&mut read))?;
    Ok(read)
}

/// Bytes of the shader's struct `Shading`: positions, then ambient, diffuse, specular and exponents of the materials.
fn shading_bytes(scene: &Scene, planned: &Planned) -> Vec<u8> {
    let positions = PositionTable::new(scene, planned).0;
    let mut lights: Vec<[f32; LANE]> =
        positions.iter().map(|light| [rounded(light.x), rounded(light.y), rounded(light.z), 0.0]).collect();
    lights.resize(lights.len().max(1), [0.0; LANE]);
    let mut table = ShadingTable::new(scene, planned);
    let lanes = table.ambient.len().max(1);
    let mut bytes = bytemuck::cast_slice(&lights).to_vec();
    for coefficients in [&mut table.ambient, &mut table.diffuse, &mut table.specular] {
        coefficients.resize(lanes, [0.0; LANE]);
        bytes.extend_from_slice(bytemuck::cast_slice(coefficients));
    }
    table.exponent.resize(lanes, [0; LANE]);
    bytes.extend_from_slice(bytemuck::cast_slice(&table.exponent));
    bytes
}

/// Largest number of samples along a ray per dispatch under `plan`, from the number of iterations without unrolled
/// loops. Per sample, counts the loops over macrocells, samples and visible samples, over the lanes of the tables (of
/// values and of labels), and over the positions with their lanes; per dispatch, the loops that load and store.
fn longest_slice(plan: &ScenePlan) -> u32 {
    let (lanes, parts) = (plan.lanes(), plan.parts().lanes);
    let (coloured, exponents) = match (plan.transmittance, plan.accumulate) {
        (Transmittance::Grey, Accumulate::Spectral { exponents, .. }) => (0, exponents),
        (Transmittance::Coloured, Accumulate::Spectral { exponents, .. }) => (4 * lanes, exponents),
        // Loops that read, test and multiply matrices.
        (Transmittance::Mixed, Accumulate::Spectral { dimension, exponents, .. }) => {
            (dimension.pow(3) + 4 * dimension.pow(2), exponents)
        }
        (_, Accumulate::Weights { .. }) => (0, 0),
    };
    let through = if plan.transmittance == Transmittance::Mixed { plan.transmittance_numbers() } else { 0 };
    let per_position = 1 + 2 * plan.shading_lanes().max(lanes) + lanes + exponents * (1 + lanes) + through;
    let per_sample = 4 + 2 * parts + coloured + plan.positions.total() * per_position;
    unsigned(ITERATIONS.saturating_sub(2 * plan.layers()) / per_sample).clamp(1, SLICE)
}

/// Divides a march into dispatches: rows of the picture, and slices of long rays. A dispatch has the samples that fit
/// into `dispatch` at the speed of the last one, but little more than fit in the slow part of the march, because fast
/// rows in empty space may precede slow rows in the volume.
#[derive(Debug)]
struct Schedule {
    dispatching: Dispatching,
    dispatch: Duration,
    size: [u32; 2],
    samples: u32,
    row: u32,
    rows: u32,
    sample: u32,
    slice: u32,
    /// Target number of samples of the next dispatch.
    budget: f64,
    /// Approximate largest number of samples of any dispatch, from an earlier march.
    most: f64,
    /// Samples of the current dispatch.
    taken: f64,
    /// For each dispatch that was long enough to measure: the samples that would have fitted, and its seconds; the
    /// smallest number of samples first. A shorter dispatch only measures the time to start one.
    timed: Vec<[f64; 2]>,
    /// Samples of the largest dispatch among the shorter ones.
    untimed: f64,
}

impl Schedule {
    fn new(size: [u32; 2], samples: u32, dispatching: Dispatching, layers: usize, speed: Speed) -> Self {
        let unknown = || speed.first.unwrap_or(FIRST_SAMPLES / count(layers.max(1)));
        let budget = dispatching.samples.map_or_else(unknown, f64::from);
        let Speed { dispatch, most, .. } = speed;
        Self {
            dispatching,
            dispatch,
            size,
            samples,
            row: 0,
            rows: 0,
            sample: 0,
            slice: 0,
            budget,
            most,
            taken: 0.0,
            timed: Vec::new(),
            untimed: 0.0,
        }
    }

    /// Number of samples that fit in the slow part of the march, if known. Ignores the slowest dispatch, whose delay
    /// may have another cause.
    fn slow(&self) -> Option<f64> {
        let most = 2.0 * self.dispatch.as_secs_f64();
        let timed = self.timed.get(1..)?;
        let mut left = SLOW * timed.iter().map(|[_, seconds]| seconds.min(most)).sum::<f64>();
        let slow = timed.iter().find(|[_, seconds]| {
            left -= seconds.min(most);
            left <= 0.0
        });
        slow.map(|[fitting, _]| *fitting)
    }

    /// Speed measured so far.
    fn speed(&self) -> Speed {
        let dispatch = self.dispatch;
        let most = match (self.slow(), self.timed.first()) {
            (Some(slow), _) => BOLDNESS * slow,
            // The only measurement.
            (None, Some([fitting, _])) => BOLDNESS * fitting,
            (None, None) => self.most.max(BOLDNESS_ELSEWHERE * self.untimed),
        };
        Speed { dispatch, first: Some(self.budget.min(most)), most }
    }

    fn is_done(&self) -> bool {
        self.row >= self.size[1]
    }

    /// Returns the next dispatch and its rows; `None` at the end of the march.
    fn next(&mut self) -> Option<(Band, u32)> {
        if self.is_done() {
            return None;
        }
        if self.sample == 0 {
            // Whole rays if a row of workgroups fits, otherwise equal parts of rays.
            let width = f64::from(self.size[0]);
            let Dispatching { group, slice: longest, .. } = self.dispatching;
            let groups = self.budget / (width * f64::from(group[1]) * f64::from(self.samples.min(longest)));
            // A stated number of samples is a limit; otherwise rounds to the nearest.
            let is_limit = self.dispatching.samples.is_some();
            let fewer = |number: f64| if is_limit { number.floor() } else { number.round() };
            let more = |number: f64| if is_limit { number.ceil() } else { number.round() };
            self.rows = group[1] * unsigned(whole(fewer(groups))).clamp(1, self.size[1]);
            let parts = width * f64::from(self.rows) * f64::from(self.samples) / self.budget;
            let parts = unsigned(whole(more(parts))).max(1);
            self.slice = self.samples.div_ceil(parts).clamp(longest.min(SHORTEST_SLICE), longest);
        }
        let end_sample = self.sample.saturating_add(self.slice);
        let band = Band { first_row: self.row, first_sample: self.sample, end_sample };
        let rows = self.rows.min(self.size[1] - self.row);
        self.taken = f64::from(self.size[0]) * f64::from(rows) * f64::from(self.slice.min(self.samples.max(1)));
        if end_sample >= self.samples {
            self.row += rows;
            self.sample = 0;
        } else {
            self.sample = end_sample;
        }
        Some((band, rows))
    }

    /// Records the duration of the last dispatch.
    fn took(&mut self, time: Duration) {
        if self.dispatching.samples.is_some() {
            return;
        }
        let (seconds, aim) = (time.as_secs_f64().max(1e-6), self.dispatch.as_secs_f64());
        let fitting = self.taken * aim / seconds;
        if seconds >= TELLING * aim {
            let place = self.timed.partition_point(|[known, _]| *known < fitting);
            self.timed.insert(place, [fitting, seconds]);
        } else {
            self.untimed = self.untimed.max(self.taken);
        }
        let most = self.most.min(self.slow().map_or(f64::INFINITY, |slow| BOLDNESS * slow));
        self.budget = fitting.clamp(self.budget / 8.0, self.budget * 8.0).min(most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{PositionCounts, ShadingTerms};
    use crate::scene::{Gradients, VolumeAs};

    fn plan_of(materials: usize) -> ScenePlan {
        ScenePlan {
            accumulate: Accumulate::Weights { materials },
            transmittance: Transmittance::Grey,
            positions: PositionCounts { directional: 1, ..PositionCounts::default() },
            shading: Some(ShadingTerms { diffuse: true, specular: None }),
            labels: false,
            background: false,
            lookup: Lookup::Nearest,
            interpolation: Interpolation::Linear,
            volume: VolumeAs::Auto,
            gradients: Gradients::Packed,
            skipping: true,
            storage: StoreAs::Single,
        }
    }

    #[test]
    fn march_uniform_lies_where_the_shader_reads_it() {
        macro_rules! lies {
            ($($field:ident),*) => {
                vec![$((stringify!($field).to_owned(), std::mem::offset_of!(MarchUniform, $field))),*]
            };
        }
        let ours = lies!(
            base,
            eye_distance,
            base_u,
            spread_u,
            base_v,
            spread_v,
            direction,
            step_length,
            direction_u,
            termination,
            direction_v,
            coordinate_scale,
            low,
            coordinate_offset,
            high,
            coordinate_last,
            cell_scale,
            pixel_width,
            cell_offset,
            pixel_height,
            local_scale,
            samples,
            gradient_scale,
            width,
            cells,
            height,
            crop_low,
            active_low,
            crop_high,
            active_high
        );
        let Source { constants, parts, .. } = source(&plan_of(4), Dispatching::default());
        let theirs = crate::shader::struct_layout(&parts, &constants, "March").ok();
        let fields = theirs.as_ref().map(|layout| {
            layout.fields.iter().map(|field| (field.name.clone(), field.offset as usize)).collect::<Vec<_>>()
        });
        assert_eq!(fields, Some(ours), "names and offsets");
        assert_eq!(theirs.map(|layout| layout.size as usize), Some(size_of::<MarchUniform>()), "size");
    }

    /// Dispatches of successive pictures whose middle takes twenty times as long as the rows above and below, starting
    /// on an unknown device. In each picture, the dispatch `held_up` is delayed by half a second, which the result does
    /// not contain.
    fn marched(pictures: usize, held_up: Option<usize>) -> Vec<Vec<Duration>> {
        let (size, samples, aim) = ([800_u32, 800], 300, Duration::from_millis(10));
        let seconds =
            |row: u32| 3.0e-9 * f64::from(size[0] * samples) * if (250..550).contains(&row) { 1.0 } else { 0.05 };
        let mut speed = Speed::unknown(aim, DeviceKind::Software);
        let picture = |_| {
            let mut schedule = Schedule::new(size, samples, Dispatching::default(), 1, speed);
            let mut dispatches = Vec::new();
            while let Some((band, rows)) = schedule.next() {
                let part = f64::from(band.end_sample.min(samples) - band.first_sample) / f64::from(samples);
                let took = part * (band.first_row..band.first_row + rows).map(seconds).sum::<f64>();
                let more = if held_up == Some(dispatches.len()) { 0.5 } else { 0.0 };
                schedule.took(Duration::from_secs_f64(took + more));
                dispatches.push(Duration::from_secs_f64(took));
            }
            speed = schedule.speed();
            dispatches
        };
        (0..pictures).map(picture).collect()
    }

    #[test]
    fn a_dispatch_that_enters_the_volume_takes_little_longer_than_it_may() {
        for (picture, dispatches) in marched(4, None).iter().enumerate() {
            let longest = dispatches.iter().max();
            assert!(longest < Some(&Duration::from_millis(18)), "picture {picture}: {longest:?}, not 10 ms");
            let count = dispatches.len();
            assert!(picture == 0 || count < 60, "{count} for 22 times 10 ms and what is empty");
        }
    }

    #[test]
    fn a_fast_gpu_is_known_within_its_first_march() {
        let speed = Speed::unknown(Duration::from_millis(8), DeviceKind::Discrete);
        let mut schedule = Schedule::new([1280, 800], 400, Dispatching::default(), 1, speed);
        let mut dispatches = 0;
        while schedule.next().is_some() {
            schedule.took(Duration::from_secs_f64(5.0e-5 + 1.0e-11 * schedule.taken));
            dispatches += 1;
        }
        assert!(dispatches < 12, "{dispatches} for 4 ms");
    }

    /// Dispatches of a few pixels are too short to measure a speed.
    #[test]
    fn a_picture_of_a_few_pixels_says_nothing_of_a_large_one() {
        let aim = Duration::from_millis(10);
        let dispatches = |size: [u32; 2], speed: Speed| {
            let mut schedule = Schedule::new(size, 300, Dispatching::default(), 1, speed);
            let mut dispatches = 0;
            while schedule.next().is_some() {
                schedule.took(Duration::from_secs_f64(4.0e-4 + 1.0e-9 * schedule.taken));
                dispatches += 1;
            }
            (dispatches, schedule.speed())
        };
        let mut speed = Speed::unknown(aim, DeviceKind::Software);
        for _ in 0..4 {
            speed = dispatches([20, 16], speed).1;
        }
        let ((small, _), (unknown, known)) =
            (dispatches([800, 800], speed), dispatches([800, 800], Speed::unknown(aim, DeviceKind::Software)));
        assert!(small <= unknown, "{small} dispatches, not {unknown}");
        let (_, known) = dispatches([800, 800], known);
        let (least, _) = dispatches([800, 800], known);
        assert!((18..30).contains(&least), "{least} dispatches of 10 ms for 192");
    }

    #[test]
    fn a_dispatch_that_was_held_up_does_not_cut_the_next_picture_into_crumbs() {
        let [calm, held] = [None, Some(20)].map(|held_up| marched(4, held_up).iter().map(Vec::len).collect::<Vec<_>>());
        assert!(calm.iter().all(|calm| *calm > 21), "{calm:?}: none is held up");
        assert!(held.iter().zip(&calm).skip(1).all(|(held, calm)| 4 * held <= 5 * calm), "{held:?}, not {calm:?}");
    }

    /// An RGB renderer accumulates three weights; a fourth is free, for any spectra.
    #[test]
    fn four_spectral_materials_march_with_the_shader_of_three_colours() {
        let words = |materials| {
            source(&plan_of(materials), Dispatching::default()).compile().map(|shader| shader.words().to_vec()).ok()
        };
        assert!(words(3).is_some(), "the shader compiles");
        assert_eq!(words(3), words(4), "the same words for three weights and four");
        assert_ne!(words(4), words(5), "a fifth needs another vector");
    }

    #[test]
    fn plans_share_the_pipelines_of_shaders_that_do_not_know_what_tells_them_apart() {
        let linear = plan_of(4);
        let cubic = ScenePlan { interpolation: Interpolation::Cubic, ..linear.clone() };
        let behind = ScenePlan { background: true, ..linear.clone() };
        let marched = |plan| source(plan, Dispatching::default());
        let relit = |plan| crate::render::relight::source(plan, crate::render::relight::Target::Display);
        assert!(marched(&linear) != marched(&cubic) && relit(&linear) == relit(&cubic), "values between voxels");
        assert!(marched(&linear) == marched(&behind) && relit(&linear) != relit(&behind), "what is behind the volume");
        // Another memory of tables needs other bindings.
        let of = |tables, group| source(&linear, Dispatching { tables, group, ..Dispatching::default() });
        let [storage, uniform] = [TableMemory::Storage, TableMemory::Uniform].map(|tables| of(tables, [8, 8]));
        assert!(storage != uniform && storage != of(TableMemory::Storage, [16, 4]) && storage == storage.clone());
    }
}
