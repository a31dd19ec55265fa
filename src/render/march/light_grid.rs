//! The light grid on the device: filled slice by slice, and kept with the volume until its medium changes.

use std::any::Any;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::dispatching::TableMemory;
use super::inputs::{clip_bytes, placed_bytes, shape_bytes};
use super::source::{Fill, Texel, light_grid_source, light_order_source, sky_source};
use crate::pool::is_one_allocation;
use crate::{RenderError, Renderer, Source, Uploaded};
use relume_base::number::{count, rounded, unsigned, whole};
use relume_scene::plan::{Planned, ScenePlan};
use relume_scene::tables::{
    CapTable, ExtinctionTable, FactorTable, GRID_LIGHTS, GridDepth, GridLight, LARGEST_RISE, LightGrid, PositionTable,
    Sweep, Within, sky_direction, sky_reach, sky_spacing,
};
use relume_scene::{Interpolation, Lookup, Scene};
use relume_vulkan::{Buffer, ComputePipeline, Filter, Format, HostUse, Image3d, Resource, ResourceSet, Sampler};

/// Pixels of a workgroup, across and down.
const GROUP: [u32; 2] = [8, 8];
/// Target duration of a submission.
const SUBMISSION: Duration = Duration::from_millis(10);
/// Samples of columns in the first submission.
const FIRST_SAMPLES: f64 = 1e5;
/// Columns of the largest dispatch.
const MOST_COLUMNS: usize = 1 << 18;
/// Spacing of the grid of a coarse picture, as a multiple of the spacing of others: a sixty-fourth of the nodes.
const COARSER: f64 = 4.0;
/// Part of the directions of a sky that a coarse picture has, and the fewest.
const FEWER_DIRECTIONS: usize = 4;
const LEAST_DIRECTIONS: usize = 8;
/// Part of the device's memory that a light grid may take.
const MEMORY_PART: f64 = 1.0 / 8.0;

/// Uniform of a sweep, in the layout of `shaders/light_medium.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct SweepUniform {
    corner: [f32; 3],
    behind: f32,
    per_slice: [f32; 3],
    length: f32,
    across: [f32; 3],
    step: f32,
    down: [f32; 3],
    samples: u32,
    low: [f32; 3],
    coordinate_scale: f32,
    high: [f32; 3],
    coordinate_offset: f32,
    gradient_scale: [f32; 3],
    coordinate_last: f32,
    shear: [f32; 2],
    first: [f32; 2],
    columns: [u32; 2],
    nodes: [u32; 2],
    axes: [u32; 3],
    part: u32,
    texels: u32,
    labels: u32,
    largest_rise: f32,
    direction: u32,
    strides: [u32; 3],
    path: f32,
    point: [f32; 3],
    start: f32,
    local_scale: [f32; 3],
    directions: u32,
}

/// Push constants of a dispatch, in the layout of `shaders/light_medium.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Slice {
    window: [u32; 4],
    before: [u32; 4],
    number: u32,
    index: u32,
    first_row: u32,
    reads: u32,
    writes: u32,
    unused: [u32; 3],
}

/// Push constants that give depths other numbers, in the layout of `shaders/light_order.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct Order {
    from: [u32; 4],
    nodes: [u32; 3],
    texel: u32,
}

impl Order {
    /// No depth is copied.
    const NONE: u32 = u32::MAX;
}

/// Push constants that set the depths of ambient light, in the layout of `shaders/sky.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
struct ToDepths {
    nodes: [u32; 3],
    texels: u32,
    summed: [u32; 3],
    part: u32,
}

/// Uniform of a sweep with a reach, in the layout of `shaders/columns_within.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
struct Reach {
    slices: u32,
    rest: f32,
    kept: u32,
    unused: u32,
}

/// Uniform of a march that reads the grid, in the layout of `shaders/light.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Place {
    scale: [f32; 4],
    offset: [f32; 4],
    nodes: [f32; 3],
    behind: f32,
}

/// Everything that the depths of a grid depend on, apart from the volume and the directions of its lights.
#[derive(Clone, Debug, PartialEq)]
struct Key {
    grid: LightGrid,
    /// Grid on which the light of the sky is summed.
    sky: LightGrid,
    start: f64,
    /// Of each depth of a light.
    extinctions: Vec<ExtinctionTable>,
    factors: FactorTable,
    lookup: Lookup,
    interpolation: Interpolation,
}

/// A light grid of an uploaded volume.
#[derive(Debug)]
pub(super) struct DeviceGrid {
    key: Key,
    /// Number of depths per node that it can hold.
    room: usize,
    image: Image3d,
    sampler: Sampler,
    place: Buffer,
    filling: Mutex<Filling>,
}

/// State of a fill. It may rest after every slice.
#[derive(Debug, Default)]
struct Filling {
    /// Each depth of the nodes, and whether it is complete.
    depths: Vec<(GridDepth, bool)>,
    /// The depth being filled.
    current: Option<Current>,
    /// Samples of columns that fit into a submission.
    budget: Option<f64>,
}

#[derive(Debug)]
struct Current {
    depth: usize,
    /// Sum over the sky; `None` for a light with one direction.
    summing: Option<Summing>,
    sweep: Sweep,
    pipeline: ComputePipeline,
    set: ResourceSet,
    slice: usize,
    row: usize,
}

/// Light of the sky, of which some directions have been summed.
#[derive(Debug)]
struct Summing {
    directions: usize,
    /// Distance beyond which nothing dims it.
    reach: Option<f64>,
    /// Number of the direction that is being added.
    direction: usize,
    sums: Buffer,
}

impl Renderer {
    /// Number of lights whose part of a light grid was filled, or begun.
    #[must_use]
    pub fn light_fills(&self) -> u64 {
        self.shared.light_fills.load(Ordering::Relaxed)
    }

    /// The least spacing of a light grid for `scene`, in voxels, that is at least the stated one and fits into an eighth
    /// of the device's memory, as the columns of a sky with a reach do; `None` if the plan reads no light grid. A grid that is
    /// filled from a coarse level of the `uploaded` volume has no more nodes than the level has voxels.
    #[must_use]
    pub fn light_spacing(&self, scene: &Scene, plan: &ScenePlan, uploaded: &Uploaded) -> Option<f64> {
        let limits = self.device.limits();
        let room = count(usize::try_from(limits.device_heap_bytes).unwrap_or(usize::MAX)) * MEMORY_PART;
        let room = room.min(count(usize::try_from(limits.max_allocation_bytes).unwrap_or(usize::MAX)));
        let storage = usize::try_from(limits.max_storage_buffer_bytes).unwrap_or(usize::MAX);
        let most_columns = room.min(count(storage));
        let format = self.texel_format(plan.light.grid_depths());
        let extent = limits.max_extent_3d(format);
        let (depths, reach) = (plan.light.grid_depths(), plan.light.sky().and_then(|_| sky_reach(scene)));
        let fits = |spacing: f64| {
            let grid = LightGrid::new(scene, spacing);
            let texels = depths.div_ceil(GRID_LIGHTS);
            let [width, height, depth] = grid.dims;
            let sides = [width, height, depth * texels];
            let of_sky = |reach| 4.0 * LightGrid::new(scene, sky_spacing(&plan.light) * spacing).kept_columns(reach);
            count(width * height * depth * texels) * f64::from(format.texel_bytes()) <= room
                && reach.map_or(0.0, of_sky) <= most_columns
                && sides.iter().zip(extent).all(|(&n, limit)| n <= limit as usize)
                && is_one_allocation(&self.device, format, sides.map(unsigned))
        };
        // A scene that was built in code may have any number.
        let of_level = uploaded.light_block().map_or(0.0, |block| block.into_iter().map(count).fold(0.0, f64::max));
        let mut spacing = scene.shadows.spacing.max(0.5).max(of_level);
        // A grid of two nodes along each axis always fits.
        while plan.light.reads_grid() && !fits(spacing) {
            spacing *= 1.02;
        }
        plan.light.reads_grid().then_some(spacing)
    }

    /// Format of the texels of a light grid with so many `depths` per node: one number for one depth, if the device filters
    /// it, and four otherwise. Both hold 16-bit floats.
    fn texel_format(&self, depths: usize) -> Format {
        let limits = self.device.limits();
        let has_one = limits.storage_image(Format::R32Float) && limits.linear_filter(Format::R32Float);
        if depths == 1 && has_one { Format::R32Float } else { Format::Rgba16Float }
    }

    /// The light grid of `scene`, which [`DeviceGrid::advance`] completes; `None` if the plan reads none. Keeps the grid
    /// with `uploaded`, and fills again only the lights whose depths have changed. A `coarse` one suffices for a coarse
    /// picture: then a complete grid serves as it is, and otherwise one with [`COARSER`] nodes that is kept beside it, so
    /// that the fill of a fine one goes on where it rests.
    pub(super) fn light_grid(
        &self,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        coarse: bool,
    ) -> Result<Option<Arc<DeviceGrid>>, RenderError> {
        let plan = &planned.plan;
        let Some(spacing) = self.light_spacing(scene, plan, uploaded) else { return Ok(None) };
        let mut depths = PositionTable::new(scene, planned).grid_depths(scene, planned);
        let grids =
            |spacing: f64| [spacing, sky_spacing(&plan.light) * spacing].map(|spacing| LightGrid::new(scene, spacing));
        let [grid, sky] = grids(spacing);
        let (medium, _) = uploaded.medium();
        let extinctions = ExtinctionTable::of_plan(scene, planned, &medium.domains());
        let mut key = Key {
            grid,
            sky,
            start: scene.shadow_start(),
            factors: FactorTable::new(
                scene,
                planned,
                &medium.storages(),
                extinctions.first().map_or(1, ExtinctionTable::entries),
            ),
            extinctions,
            lookup: plan.lookup,
            interpolation: plan.interpolation,
        };
        let (texels, format) = (depths.len().div_ceil(GRID_LIGHTS), self.texel_format(depths.len()));
        let mut kept = uploaded.kept.0.lock().unwrap_or_else(PoisonError::into_inner);
        let [fine, coarser] = &mut *kept;
        let known = |kept: &Option<Arc<dyn Any + Send + Sync>>| {
            let grid = kept.as_ref().map(|kept| Arc::clone(kept).downcast::<DeviceGrid>());
            grid.and_then(Result::ok)
        };
        let mut kept = fine;
        if coarse {
            let serves =
                |grid: &Arc<DeviceGrid>| grid.key == key && grid.is_complete() && grid.filling().is_of(&depths);
            if let Some(grid) = known(kept).filter(serves) {
                return Ok(Some(grid));
            }
            [key.grid, key.sky] = grids(COARSER * spacing);
            for depth in &mut depths {
                if let GridLight::Sky { directions, .. } = &mut depth.light {
                    *directions = (*directions / FEWER_DIRECTIONS).max(LEAST_DIRECTIONS);
                }
            }
            kept = coarser;
        }
        let mut before = known(kept).filter(|grid| grid.key == key);
        if let Some(grid) = before.take_if(|grid| {
            // A march in progress reads the grid as it is; this is the third reference without one.
            let is_shared = Arc::strong_count(grid) > 2;
            let filling = grid.filling();
            let stays = !is_shared && grid.room >= depths.len() && filling.stay(&depths);
            filling.is_of(&depths) || stays
        }) {
            grid.filling().aim_at(&depths);
            return Ok(Some(grid));
        }
        // Frees the old grid before the new one is made, if nothing else uses it.
        *kept = None;
        let [width, height, depth] = key.grid.dims.map(unsigned);
        let extent = [width, height, depth * unsigned(texels)];
        let grid = Arc::new(DeviceGrid {
            image: Image3d::written(&self.device, "light grid", format, extent)?,
            sampler: Sampler::new(&self.device, "light grid", Filter::Linear)?,
            place: self.place_of("light place", Place::new(&key.grid, texels))?,
            key,
            room: if format == Format::R32Float { 1 } else { GRID_LIGHTS * texels },
            filling: Mutex::default(),
        });
        grid.filling().aim_at(&depths);
        if let Some(before) = before {
            self.take_over(&before, &grid)?;
        }
        let keeping: Arc<dyn Any + Send + Sync> = Arc::<DeviceGrid>::clone(&grid);
        *kept = Some(keeping);
        Ok(Some(grid))
    }

    /// Copies the complete depths of `before` to `grid`, which has the same nodes, for the lights of equal direction.
    fn take_over(&self, before: &DeviceGrid, grid: &DeviceGrid) -> Result<(), RenderError> {
        let complete = before.filling().depths.clone();
        let mut filling = grid.filling();
        let known = |wanted: GridDepth| complete.iter().position(|&(depth, complete)| complete && depth == wanted);
        let numbers: Vec<Option<usize>> = filling.depths.iter().map(|depth| known(depth.0)).collect();
        if numbers.iter().all(Option::is_none) {
            return Ok(());
        }
        let nodes = grid.key.grid.dims.map(unsigned);
        let orders = numbers.chunks(GRID_LIGHTS).enumerate().map(|(texel, numbers)| {
            let number = |i: usize| numbers.get(i).copied().flatten().map_or(Order::NONE, unsigned);
            Order { from: std::array::from_fn(number), nodes, texel: unsigned(texel) }
        });
        let depths = ("depths", Resource::Texture(&before.image));
        grid.over_nodes(self, light_order_source(GROUP, grid.texel()), depths, &orders.collect::<Vec<_>>())?;
        for (depth, number) in filling.depths.iter_mut().zip(numbers) {
            depth.1 = number.is_some();
        }
        Ok(())
    }

    /// A uniform of a grid's place.
    pub(super) fn place_of(&self, name: &str, place: Place) -> Result<Buffer, RenderError> {
        let buffer = Buffer::host(&self.device, name, size_of::<Place>() as u64, HostUse::Uniform)?;
        buffer.write(0, bytemuck::bytes_of(&place))?;
        Ok(buffer)
    }
}

impl Place {
    /// The place of `grid`, behind which others of so many `texels` a node follow along z.
    pub(super) fn new(grid: &LightGrid, texels: usize) -> Self {
        let nodes = DVec3::from_array(grid.dims.map(count));
        // Node n is the middle of texel n; further grids follow along z.
        let of_first = DVec3::new(1.0, 1.0, 1.0 / count(texels.max(1))) / nodes;
        let vector = |vector: DVec3| vector.extend(0.0).to_array().map(rounded);
        Self {
            scale: vector(grid.scale * of_first),
            offset: vector((grid.offset + 0.5) * of_first),
            nodes: nodes.to_array().map(rounded),
            behind: rounded(1.0 / count(texels.max(1))),
        }
    }
}

impl Filling {
    /// True if it fills these depths, in this order.
    fn is_of(&self, depths: &[GridDepth]) -> bool {
        self.depths.iter().map(|depth| depth.0).eq(depths.iter().copied())
    }

    /// True if no complete depth of `depths` has another number.
    fn stay(&self, depths: &[GridDepth]) -> bool {
        let elsewhere = |(number, depth): (usize, &(GridDepth, bool))| {
            depth.1 && depths.get(number) != Some(&depth.0) && depths.contains(&depth.0)
        };
        !self.depths.iter().enumerate().any(elsewhere)
    }

    /// Marks the depths that change as incomplete.
    fn aim_at(&mut self, depths: &[GridDepth]) {
        let depths = depths.iter().enumerate().map(|(i, &depth)| {
            (depth, self.depths.get(i).is_some_and(|&(known, complete)| complete && known == depth))
        });
        let depths: Vec<_> = depths.collect();
        if self.current.as_ref().is_some_and(|current| {
            self.depths.get(current.depth).map(|depth| depth.0) != depths.get(current.depth).map(|depth| depth.0)
        }) {
            self.current = None;
        }
        self.depths = depths;
    }
}

impl DeviceGrid {
    fn filling(&self) -> MutexGuard<'_, Filling> {
        self.filling.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Depths in each of its texels.
    fn texel(&self) -> Texel {
        if self.room == 1 { Texel::One } else { Texel::Four }
    }

    /// True if its nodes are as far apart as those of a light grid of `scene` with this spacing.
    pub(super) fn is_as_fine(&self, scene: &Scene, spacing: f64) -> bool {
        self.key.grid == LightGrid::new(scene, spacing)
    }

    /// Whether all depths are complete.
    pub(super) fn is_complete(&self) -> bool {
        self.filling().depths.iter().all(|depth| depth.1)
    }

    /// The resource of this name in the march.
    pub(super) fn resource(&self, name: &str) -> Option<Resource<'_>> {
        match name {
            "light_uniform" => Some(Resource::Uniform(&self.place)),
            "light_grid" => Some(Resource::Texture(&self.image)),
            "light_sampler" => Some(Resource::Sampler(&self.sampler)),
            _ => None,
        }
    }

    /// Fills the next slices, as many as take about as long as a dispatch of a march.
    pub(super) fn advance(
        &self,
        renderer: &Renderer,
        planned: &Planned,
        uploaded: &Uploaded,
    ) -> Result<(), RenderError> {
        let mut filling = self.filling();
        let Filling { depths, current, budget } = &mut *filling;
        let Some(depth) = depths.iter().position(|depth| !depth.1) else { return Ok(()) };
        let now = match current {
            Some(now) if now.depth == depth => now,
            _ => {
                renderer.shared.light_fills.fetch_add(1, Ordering::Relaxed);
                let GridDepth { light, number } = depths[depth].0;
                let sets = (depth, number);
                let begun = match light {
                    GridLight::From(direction) => self.begin(
                        renderer,
                        planned,
                        uploaded,
                        sets,
                        self.key.grid.sweep(direction, self.key.start),
                        None,
                    ),
                    GridLight::At(point) => {
                        self.begin(renderer, planned, uploaded, sets, self.key.grid.rays(point, self.key.start), None)
                    }
                    GridLight::Sky { directions, reach } => {
                        let bytes = self.key.sky.dims.iter().product::<usize>() * size_of::<f32>();
                        let sums = Buffer::device(&renderer.device, "sky", bytes as u64)?;
                        self.begin_sky(
                            renderer,
                            planned,
                            uploaded,
                            depth,
                            Summing { directions, reach, direction: 0, sums },
                        )
                    }
                };
                current.insert(begun?)
            }
        };
        let begun = Instant::now();
        let stated = renderer.dispatching.samples;
        let (mut samples, most) = (0.0, stated.map_or(budget.unwrap_or(FIRST_SAMPLES), f64::from));
        let most_columns = stated.map_or(MOST_COLUMNS, |samples| samples as usize);
        let done = renderer.device.run("light grid", |recorder| {
            while now.slice < now.sweep.slices && samples < most {
                let (slice, rows, columns) = now.next(most_columns);
                let groups = [columns.div_ceil(GROUP[0]), rows.div_ceil(GROUP[1]), 1];
                recorder.compute_to_compute();
                recorder.dispatch(&now.pipeline, &now.set, bytemuck::bytes_of(&slice), groups)?;
                samples += f64::from(columns) * f64::from(rows) * count(now.sweep.work());
            }
            recorder.compute_to_compute();
            Ok(())
        });
        if let Err(error) = done {
            // Slices that were recorded may not have been filled: the depth begins again.
            *current = None;
            return Err(error.into());
        }
        let seconds = begun.elapsed().as_secs_f64().max(1e-5);
        *budget = Some((samples * SUBMISSION.as_secs_f64() / seconds).clamp(most / 4.0, most * 4.0).max(1.0));
        if now.slice < now.sweep.slices {
            return Ok(());
        }
        let summing = now.summing.take();
        *current = None;
        match summing {
            Some(Summing { directions, reach, direction, sums }) if direction + 1 < directions => {
                let next = Summing { directions, reach, direction: direction + 1, sums };
                *current = Some(self.begin_sky(renderer, planned, uploaded, depth, next)?);
                return Ok(());
            }
            Some(complete) => self.set_sky(renderer, depth, &complete)?,
            None => {}
        }
        depths[depth].1 = true;
        Ok(())
    }

    /// Sets up the sweep of the next direction of the sky, which is `depth`.
    fn begin_sky(
        &self,
        renderer: &Renderer,
        planned: &Planned,
        uploaded: &Uploaded,
        depth: usize,
        summing: Summing,
    ) -> Result<Current, RenderError> {
        let sweep = self.key.sky.sweep(sky_direction(summing.direction, summing.directions), self.key.start);
        let sweep = sweep.of_sky(summing.reach);
        self.begin(renderer, planned, uploaded, (depth, 0), sweep, Some(summing))
    }

    /// Sets `depth`, that of the sky, from its sums.
    fn set_sky(&self, renderer: &Renderer, depth: usize, complete: &Summing) -> Result<(), RenderError> {
        let constants = ToDepths {
            nodes: self.key.grid.dims.map(unsigned),
            texels: unsigned(depth / GRID_LIGHTS * self.key.grid.dims[2]),
            summed: self.key.sky.dims.map(unsigned),
            part: unsigned(depth % GRID_LIGHTS),
        };
        self.over_nodes(
            renderer,
            sky_source(GROUP, self.texel()),
            ("sky", Resource::Storage(&complete.sums)),
            &[constants],
        )
    }

    /// Runs a shader that writes every node, once for each of these push constants; it reads the `input` of this name.
    fn over_nodes<C: Pod>(
        &self,
        renderer: &Renderer,
        source: Source,
        (input, resource): (&str, Resource<'_>),
        constants: &[C],
    ) -> Result<(), RenderError> {
        let label = source.name;
        let (pipeline, set) = renderer.bind(source, |name| match name {
            "light_grid" => Some(Resource::StorageTexture(&self.image)),
            _ => (name == input).then_some(resource),
        })?;
        let nodes = self.key.grid.dims.map(unsigned);
        let groups = [nodes[0].div_ceil(GROUP[0]), nodes[1].div_ceil(GROUP[1]), nodes[2]];
        renderer.device.run(label, |recorder| {
            recorder.compute_to_compute();
            for constants in constants {
                recorder.dispatch(&pipeline, &set, bytemuck::bytes_of(constants), groups)?;
            }
            recorder.compute_to_compute();
            Ok(())
        })?;
        Ok(())
    }

    /// Sets up the sweep of `depth`, which is this number of its light, or that of one direction of the sky.
    fn begin(
        &self,
        renderer: &Renderer,
        planned: &Planned,
        uploaded: &Uploaded,
        (depth, number): (usize, usize),
        sweep: Sweep,
        summing: Option<Summing>,
    ) -> Result<Current, RenderError> {
        let (device, plan, Key { grid, sky, extinctions, factors, .. }) = (&renderer.device, &planned.plan, &self.key);
        let extinctions = &extinctions[number];
        let (grid, fill) = match (&summing, sweep.to) {
            (Some(_), _) => (sky, Fill::Sky { within: sweep.within.is_some() }),
            (None, Some(_)) => (grid, Fill::Point),
            (None, None) => (grid, Fill::Directional),
        };
        let uniform = |name: &str, bytes: &[u8]| -> Result<Buffer, RenderError> {
            let buffer = Buffer::host(device, name, bytes.len() as u64, HostUse::Uniform)?;
            buffer.write(0, bytes)?;
            Ok(buffer)
        };
        let vector = |vector: DVec3| vector.to_array().map(rounded);
        let (medium, to_medium) = uploaded.medium();
        let on_medium = |place: DVec3| vector(place * to_medium);
        let [corner, per_slice, across, down] = sweep.line.map(on_medium);
        let [low, high] = grid.room().map(on_medium);
        let [scale, offset] = extinctions.coordinate_from_texel(&medium.storage);
        let sweep_uniform = SweepUniform {
            corner,
            behind: rounded(sweep.behind),
            per_slice,
            length: rounded(sweep.path / count(sweep.samples)),
            across,
            step: rounded(1.0 / count(sweep.samples)),
            down,
            samples: unsigned(sweep.samples),
            low,
            coordinate_scale: rounded(scale),
            high,
            coordinate_offset: rounded(offset),
            gradient_scale: medium.storage.gradient_scale().map(rounded),
            coordinate_last: rounded(count(extinctions.entries() - 1)),
            shear: sweep.shear.map(rounded),
            first: sweep.first.map(rounded),
            columns: sweep.columns.map(unsigned),
            nodes: sweep.nodes.map(unsigned),
            axes: sweep.axes.map(unsigned),
            part: unsigned(depth % GRID_LIGHTS),
            texels: unsigned(depth / GRID_LIGHTS * grid.dims[2]),
            labels: unsigned(extinctions.values.len()),
            largest_rise: rounded(LARGEST_RISE),
            direction: unsigned(summing.as_ref().map_or(0, |summing| summing.direction)),
            strides: [1, grid.dims[0], grid.dims[0] * grid.dims[1]].map(unsigned),
            path: rounded(sweep.path),
            point: sweep.to.map_or([0.0; 3], |to| vector(to.point)),
            start: rounded(sweep.to.map_or(0.0, |to| to.start)),
            local_scale: sweep.to.map_or([1.0; 3], |to| vector(to.local_scale / to_medium)),
            directions: unsigned(summing.as_ref().map_or(1, |summing| summing.directions)),
        };
        let sweep_buffer = uniform("sweep", bytemuck::bytes_of(&sweep_uniform))?;
        let shape_bytes = shape_bytes(factors);
        let shapes = Buffer::host(device, "shapes", shape_bytes.len() as u64, HostUse::Storage)?;
        shapes.write(0, shape_bytes)?;
        let factors = uniform("factors", bytemuck::cast_slice(&factors.vectors))?;
        // Gradients of further fields shade no light.
        let placed_bytes = placed_bytes(&medium.places, &medium.storages(), 1.0);
        let placed = Buffer::host(device, "placed fields", placed_bytes.len() as u64, HostUse::Storage)?;
        placed.write(0, &placed_bytes)?;
        let clip_bytes = clip_bytes(&grid.clip, &CapTable::default(), to_medium);
        let clip = Buffer::host(device, "clip planes", clip_bytes.len() as u64, HostUse::Storage)?;
        clip.write(0, &clip_bytes)?;
        let words = extinctions.rows.words();
        let rows = Buffer::host(device, "label rows", (4 * words.len()) as u64, HostUse::Storage)?;
        rows.write(0, bytemuck::cast_slice(&words))?;
        let table: Vec<f32> = extinctions.values.iter().chain(&extinctions.labels).copied().collect();
        let (memory, table) = renderer.numbers("extinctions", bytemuck::cast_slice(&table))?;
        let planes = sweep.kept() * sweep.columns[0] * sweep.columns[1] * size_of::<f32>();
        let planes = Buffer::device(device, "columns", planes as u64)?;
        let within = sweep.within.unwrap_or(Within { slices: 0, rest: 0.0 });
        let reach = Reach {
            slices: unsigned(within.slices),
            rest: rounded(within.rest),
            kept: unsigned(sweep.kept()),
            unused: 0,
        };
        let reach = uniform("reach", bytemuck::bytes_of(&reach))?;
        if sweep.cubic || sweep.within.is_some() {
            // A column that has not entered has the depth 0 in every slice.
            device.run("columns", |recorder| {
                recorder.zero(&planes)?;
                recorder.transfer_to_compute();
                Ok(())
            })?;
        }
        let filter = if plan.interpolation.is_filtered() { Filter::Linear } else { Filter::Nearest };
        let sampler = Sampler::new(device, "volume", filter)?;
        let (pipeline, set) = renderer.bind(light_grid_source(plan, GROUP, memory, fill, self.texel()), |name| {
            Some(match name {
                "sweep_uniform" => Resource::Uniform(&sweep_buffer),
                "factor_table" => Resource::Uniform(&factors),
                "shapes" => Resource::Storage(&shapes),
                "clip_planes" => Resource::Storage(&clip),
                "placed_fields" => Resource::Storage(&placed),
                "placed_volumes" => Resource::Texture(medium.placed.as_ref()?),
                "volume" => Resource::Texture(&medium.volume),
                "volume_sampler" => Resource::Sampler(&sampler),
                "labels" => Resource::Texture(medium.label_image.as_ref()?),
                "label_rows" => Resource::Storage(&rows),
                "columns" => Resource::Storage(&planes),
                "reach" => Resource::Uniform(&reach),
                "sky" => Resource::Storage(&summing.as_ref()?.sums),
                "light_grid" => Resource::StorageTexture(&self.image),
                "extinctions" => match memory {
                    TableMemory::Storage => Resource::Storage(&table),
                    TableMemory::Uniform => Resource::Uniform(&table),
                },
                _ => return None,
            })
        })?;
        Ok(Current { depth, summing, sweep, pipeline, set, slice: 0, row: 0 })
    }
}

impl Current {
    /// Returns the next dispatch of about `most_columns` with its rows and columns, and moves on.
    fn next(&mut self, most_columns: usize) -> (Slice, u32, u32) {
        let sweep = &self.sweep;
        let bounds = |slice: usize| {
            let [across, down] = sweep.window(slice);
            [across.start, down.start, across.end, down.end].map(unsigned)
        };
        let window = bounds(self.slice);
        let before = self.slice.checked_sub(1).map_or([0; 4], bounds);
        let [columns, height] = [window[2] - window[0], window[3] - window[1]];
        let [columns, height] = [columns.max(unsigned(sweep.nodes[0])), height.max(unsigned(sweep.nodes[1]))];
        // The rays of a point light have more samples than a column has in a slice.
        let most_columns = most_columns * sweep.samples / sweep.work();
        let most = whole(count(most_columns) / f64::from(columns)).max(GROUP[1] as usize);
        let first_row = unsigned(self.row);
        let rows = (height - first_row).min(unsigned(most));
        let plane = sweep.columns[0] * sweep.columns[1];
        let [reads, writes] = [self.slice, self.slice + 1].map(|slice| unsigned(slice % sweep.kept() * plane));
        let slice = Slice {
            window,
            before,
            number: unsigned(self.slice),
            index: unsigned(sweep.index(self.slice)),
            first_row,
            reads,
            writes,
            unused: [0; 3],
        };
        self.row += rows as usize;
        if first_row + rows >= height {
            (self.slice, self.row) = (self.slice + 1, 0);
        }
        (slice, rows, columns)
    }
}
