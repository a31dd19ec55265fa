//! Set-up of a march: its inputs and images, bound to its pipeline.

use std::sync::atomic::Ordering;
use std::time::Duration;

use super::dispatching::{Dispatching, TableMemory};
use super::inputs::{Bytes, Inputs};
use super::mean::Mean;
use super::rounds::Rounds;
use super::schedule::{RayPlace, Schedule, Speed, longest_slice};
use super::source::{UNIFORM_BYTES, VECTOR_BYTES, formats, source};
use super::{DeviceFilm, LightQuality, March};
use crate::upload::takes_level;
use crate::{RenderError, Renderer, Uploaded};
use relume_base::number::{rounded, unsigned};
use relume_scene::plan::{Planned, Transmittance};
use relume_scene::tables::{phase_of_ray, ray_places};
use relume_scene::{Scene, ShadowMethod, StoreAs};
use relume_vulkan::{Buffer, Filter, HostUse, Resource, Sampler, StorageImage};

/// Buffers by their names in the shader.
type Buffers = Vec<(&'static str, Buffer)>;

impl Renderer {
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
        self.begin(scene, planned, uploaded, size, speed, LightQuality::Full)
    }

    /// [`Self::begin_march`] with this light.
    pub(crate) fn begin(
        &self,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        size: [usize; 2],
        speed: Speed,
        lighting: LightQuality,
    ) -> Result<March, RenderError> {
        let plan = &planned.plan;
        let device = &self.device;
        self.check_picture(plan, size, uploaded.bytes() + self.beside_bytes)?;
        if plan.transmittance == Transmittance::Mixed {
            return Err(RenderError::Matrix);
        }
        if plan.light.grid_lights() > 0 && plan.light.method == ShadowMethod::Rays {
            return Err(RenderError::LightRays);
        }
        uploaded.check_march(scene, plan)?;
        self.shared.marches.fetch_add(1, Ordering::Relaxed);
        let Inputs { rays, occupancy, uniforms, storages, tables } =
            Inputs::new(scene, planned, (uploaded, &uploaded.storages()), size)?;
        let uniforms = self.buffers(uniforms, HostUse::Uniform)?;
        let storages = self.buffers(storages, HostUse::Storage)?;
        let (memory, tables) = self.tables(tables)?;
        let extent = size.map(unsigned);
        // Others fetch texels themselves.
        let filter = if plan.interpolation.is_filtered() { Filter::Linear } else { Filter::Nearest };
        let sampler = Sampler::new(device, "volume", filter)?;
        let [vectors, format] = formats(plan, StoreAs::Single);
        let image = |name, format, layers: usize| {
            // Behind the film lie the layers of what rounding took from it, or of extreme values.
            let layers = layers.max(1) * if plan.keeps_more() { 2 } else { 1 };
            StorageImage::new(device, name, format, extent, unsigned(layers))
        };
        let accumulators = image("accumulators", vectors, plan.layers())?;
        let transmittance = image("transmittance", format, plan.transmittance_lanes())?;

        if rays.block.is_some() {
            self.fill_with_light([&accumulators, &transmittance], plan)?;
        }

        let mean = if plan.rays > 1 { Some(Mean::new(self, plan, [&accumulators, &transmittance])?) } else { None };
        let place =
            |(index, place): (usize, [f64; 2])| RayPlace { place: place.map(rounded), phase: phase_of_ray(index) };
        let mut places: Vec<RayPlace> = ray_places(plan.rays).into_iter().enumerate().map(place).rev().collect();

        let scattered = self.scattered(scene, planned, uploaded, lighting)?;
        let grid = self.light_grid(scene, planned, uploaded, lighting != LightQuality::Full)?;

        let rounds = uploaded
            .pool
            .as_ref()
            .map(|pool| Rounds::new(self, pool, &rays, &occupancy, !plan.skipping, size))
            .transpose()?;

        let residence = uploaded.residence();
        let source =
            source(plan, Dispatching { tables: memory, block: rays.block.is_some(), residence, ..self.dispatching });
        let made = self.made(source)?;
        let iterations = made.iterations;
        let (pipeline, set) = self.bound("march", made, |name| {
            if let Some(resource) = grid.as_ref().and_then(|grid| grid.resource(name)) {
                return Some(resource);
            }
            if let Some(resource) = scattered.as_ref().and_then(|scattered| scattered.resource(name)) {
                return Some(resource);
            }
            Some(match name {
                "placed_volumes" => Resource::Texture(uploaded.placed.as_ref()?),
                "volume" => Resource::Texture(&uploaded.volume),
                "volume_sampler" => Resource::Sampler(&sampler),
                "labels" => Resource::Texture(uploaded.label_image.as_ref()?),
                "bricks_uniform" => Resource::Uniform(&uploaded.pool.as_ref()?.uniform),
                "pages" => Resource::Storage(&uploaded.pool.as_ref()?.pages),
                "next_samples" => Resource::Storage(&rounds.as_ref()?.next),
                "wanted" => Resource::Storage(&rounds.as_ref()?.wanted),
                "accumulators" => Resource::StorageImage(&accumulators),
                "transmittances" => Resource::StorageImage(&transmittance),
                _ => {
                    let named = |buffers| named(buffers, name);
                    if let Some(buffer) = named(&uniforms) {
                        return Some(Resource::Uniform(buffer));
                    }
                    match (named(&storages), memory) {
                        (Some(buffer), _) => Resource::Storage(buffer),
                        (None, TableMemory::Storage) => Resource::Storage(named(&tables)?),
                        (None, TableMemory::Uniform) => Resource::Uniform(named(&tables)?),
                    }
                }
            })
        })?;

        let slice = self.dispatching.slice.min(longest_slice(iterations, plan.integration));
        let dispatching = Dispatching { slice, ..self.dispatching };
        let mut schedule = Schedule::new(extent, rays.samples, dispatching, plan.layers(), speed);
        if let Some(place) = places.pop() {
            schedule.begin_rays(place);
        }
        let occupied = [occupancy.occupied, occupancy.dims.iter().product()];
        let left = DeviceFilm {
            planned: planned.clone(),
            size,
            dispatches: 0,
            device_time: Some(Duration::ZERO),
            occupied,
            light_spacing: self.light_spacing(scene, plan, uploaded),
            light_block: uploaded.light_block().filter(|_| takes_level(plan)),
            bricks: None,
            accumulators,
            transmittance,
        };
        let is_block = rays.block.is_some();
        let is_fine =
            grid.as_ref().zip(left.light_spacing).is_none_or(|(grid, spacing)| grid.is_as_fine(scene, spacing));
        let quality = scattered.as_ref().map(|scattered| match scattered.lighting() {
            LightQuality::Full if !is_fine => LightQuality::Rough,
            lighting => lighting,
        });
        Ok(March { quality, pipeline, set, schedule, left, grid, scattered, rounds, places, mean, is_block })
    }

    /// Buffers of these bytes.
    fn buffers(&self, named: Bytes, host_use: HostUse) -> Result<Buffers, RenderError> {
        let buffer = |(name, bytes): (&'static str, Vec<u8>)| -> Result<_, RenderError> {
            // Buffers are never empty; the shader does not read an array without entries.
            let bytes = if bytes.is_empty() { vec![0; 16] } else { bytes };
            let buffer = Buffer::host(&self.device, name, bytes.len() as u64, host_use)?;
            buffer.write(0, &bytes)?;
            Ok((name, buffer))
        };
        named.into_iter().map(buffer).collect()
    }

    /// Memory and buffers of tables.
    fn tables(&self, tables: Bytes) -> Result<(TableMemory, Buffers), RenderError> {
        let room = self.device.limits().max_uniform_buffer_bytes >= u64::from(UNIFORM_BYTES);
        let short = tables.iter().all(|(_, bytes)| bytes.len() as u64 <= u64::from(UNIFORM_BYTES));
        let memory = if room && short { self.dispatching.tables } else { TableMemory::Storage };
        let buffer = |(name, bytes): (&'static str, Vec<u8>)| -> Result<_, RenderError> {
            Ok((name, self.table_buffer(name, &bytes, memory)?))
        };
        Ok((memory, tables.into_iter().map(buffer).collect::<Result<_, _>>()?))
    }

    /// A buffer of a table in `memory`.
    fn table_buffer(&self, name: &str, bytes: &[u8], memory: TableMemory) -> Result<Buffer, RenderError> {
        let (size, host_use) = match memory {
            // Whole vectors, and at least one; the shader does not read a table without entries.
            TableMemory::Storage => {
                (bytes.len().max(1).next_multiple_of(VECTOR_BYTES as usize) as u64, HostUse::Storage)
            }
            TableMemory::Uniform => (UNIFORM_BYTES.into(), HostUse::Uniform),
        };
        let buffer = Buffer::host(&self.device, name, size, host_use)?;
        buffer.write(0, bytes)?;
        Ok(buffer)
    }

    /// Memory and buffer of a single table, in the fastest memory that holds it.
    pub(crate) fn numbers(&self, name: &str, bytes: &[u8]) -> Result<(TableMemory, Buffer), RenderError> {
        let room = self.device.limits().max_uniform_buffer_bytes >= u64::from(UNIFORM_BYTES);
        let short = bytes.len() as u64 <= u64::from(UNIFORM_BYTES);
        let memory = if room && short { self.dispatching.tables } else { TableMemory::Storage };
        Ok((memory, self.table_buffer(name, bytes, memory)?))
    }
}

/// The buffer of this name.
fn named<'a>(buffers: &'a [(&'static str, Buffer)], name: &str) -> Option<&'a Buffer> {
    buffers.iter().find(|(known, _)| *known == name).map(|(_, buffer)| buffer)
}
