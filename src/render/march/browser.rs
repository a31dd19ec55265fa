//! A march for WebGPU: the shader of the plan as WGSL, and the numbers that it reads.

use std::ops::Range;

use super::LightQuality;
use super::dispatching::{Dispatching, TableMemory, Target};
use super::inputs::{Bytes, Inputs};
use super::source::source;
use crate::upload::Uploaded;
use crate::{RenderError, Renderer, ShaderError};
use relume_scene::plan::{Planned, ScenePlan};
use relume_scene::tables::{NumberStorage, PlacedField, Storage, read_in_crop, read_of_placed};
use relume_scene::{Field, Scene, ShadowMethod};
use relume_vulkan::shader::{BindingKind, BrowserShader};
use relume_vulkan::{Buffer, Format, HostUse, Image3d, Resource};

/// Pixels of a workgroup, across and down.
const GROUP: [u32; 2] = [8, 8];

/// A march for a browser: its shader, and everything that this reads.
#[derive(Debug)]
pub struct BrowserMarch {
    /// The shader.
    pub shader: BrowserShader,
    /// Pixels of a workgroup, across and down.
    pub group: [u32; 2],
    /// Bytes of its buffers by their names in the shader.
    pub buffers: Bytes,
    /// The voxels of the fields: those in the texels of the volume, then those on grids of their own.
    pub fields: Vec<FieldNumbers>,
    /// Voxels whose values are left out, because nothing of them is seen.
    pub blanked: usize,
    /// Texels of the label map, and bytes of each; none without labels.
    pub labels: Option<(Vec<u8>, usize)>,
    /// Textures of light: that of shadows, and light that has scattered before.
    pub grids: Vec<LightTexture>,
}

/// The voxels of a field as whole numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct FieldNumbers {
    /// How they are stored.
    pub storage: NumberStorage,
    /// The numbers, x fastest.
    pub numbers: Vec<u16>,
    /// Voxels along each axis.
    pub dims: [usize; 3],
    /// True if they lie on a grid of their own, in a texture with the others of that kind, one behind the other along z.
    pub is_placed: bool,
}

/// A texture of light, whose numbers are 16-bit floats.
#[derive(Clone, Debug, PartialEq)]
pub struct LightTexture {
    /// Name in the shader.
    pub name: &'static str,
    /// Texels along each axis.
    pub dims: [u32; 3],
    /// Numbers of a texel.
    pub numbers: usize,
    /// Bits of the numbers.
    pub texels: Vec<u16>,
}

/// The march shader of `plan` for a browser, whose devices all filter the texels of values or not.
///
/// # Errors
///
/// [`ShaderError`].
pub fn browser_shader(plan: &ScenePlan, filters: bool) -> Result<BrowserShader, ShaderError> {
    let target = Target::Browser { filters };
    let dispatching = Dispatching { group: GROUP, tables: TableMemory::Storage, target, ..Dispatching::default() };
    source(plan, dispatching).for_browser()
}

impl BrowserMarch {
    /// The march of a picture of `size` of the `uploaded` volume of `scene`, with the light that `renderer` finds for it.
    ///
    /// # Errors
    ///
    /// [`RenderError::Browser`] names what browsers do not march.
    pub fn new(
        renderer: &Renderer,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        size: [usize; 2],
    ) -> Result<Self, RenderError> {
        let refused = |what: &'static str, way: &'static str| Err(RenderError::Browser { what, way });
        let plan = &planned.plan;
        if uploaded.pool.is_some() {
            return refused("a volume in bricks", "crop it, or take a smaller level of it");
        }
        if plan.light.grid_lights() > 0 && plan.light.method == ShadowMethod::Rays {
            return Err(RenderError::LightRays);
        }
        let volumes = scene.fields.iter().map(|field| &field.volume);
        let storages: Vec<NumberStorage> = uploaded
            .storages()
            .into_iter()
            .zip(volumes)
            .map(|(storage, volume)| NumberStorage::new(storage, volume))
            .collect();
        // Floats of 32 bits are filtered by some devices alone.
        let shader = browser_shader(plan, storages.iter().all(|storage| storage.is_half))?;
        let of_fields: Vec<&Storage> = storages.iter().map(|storage| &storage.storage).collect();
        let Inputs { rays: _, occupancy: _, uniforms, storages: tables_of_storage, tables } =
            Inputs::new(scene, planned, (uploaded, &of_fields), size)?;
        let is_read = |name: &str| shader.resources.iter().any(|(known, _)| known == name);
        let all = uniforms.into_iter().chain(tables_of_storage).chain(tables);
        let mut buffers: Bytes = all.filter(|(name, _)| is_read(name)).collect();
        let (of_light, grids) = light(renderer, scene, planned, uploaded)?;
        buffers.extend(of_light);
        let dims = scene.frame.geometry.dims;
        let smooth = plan.smooth_labels;
        // A reader cannot widen the crop box, and nothing reads what is beyond it.
        let in_crop = read_in_crop(scene);
        let labels = uploaded.labels.as_ref().map(|map| {
            let (mut texels, bytes) = (map.texels(dims, 0..dims[2], smooth), map.texel_bytes(smooth));
            let [x, y, z] = in_crop.clone();
            keep_in(&[x.start * bytes..x.end * bytes, y, z], [dims[0] * bytes, dims[1], dims[2]], &mut texels);
            (texels, bytes)
        });
        let mut blanked = 0;
        let numbers = |((storage, field), place): ((NumberStorage, &Field), &Option<PlacedField>)| {
            let (mut numbers, dims) = (storage.numbers(&field.volume), field.volume.geometry.dims);
            blanked += storage.blank(scene, planned, &mut numbers);
            match place {
                None => keep_in(&in_crop, dims, &mut numbers),
                Some(place) => keep(&read_of_placed(scene, place), dims, &mut numbers),
            }
            FieldNumbers { storage, numbers, dims, is_placed: place.is_some() }
        };
        let places = std::iter::once(&None).chain(&uploaded.places);
        let fields = storages.into_iter().zip(scene.fields.iter()).zip(places).map(numbers).collect();
        Ok(Self { shader, group: GROUP, buffers, fields, blanked, labels, grids })
    }

    /// Names of the resources of the shader in the order of their bindings, and their kinds as WebGPU calls them.
    #[must_use]
    pub fn resources(&self) -> Vec<(&str, &'static str)> {
        let kind = |kind: &BindingKind| match kind {
            BindingKind::Uniform => "uniform",
            BindingKind::Texture => "texture",
            BindingKind::Sampler => "sampler",
            BindingKind::Storage | BindingKind::StorageImage => "storage",
        };
        self.shader.resources.iter().map(|(name, of)| (name.as_str(), kind(of))).collect()
    }
}

/// Sets what lies beyond these ranges along each axis to 0. Along x, `dims` counts the numbers of a row.
fn keep_in<T: Copy + Default>(ranges: &[Range<usize>; 3], [width, height, depth]: [usize; 3], numbers: &mut [T]) {
    for (row, numbers) in numbers.chunks_mut(width.max(1)).enumerate().take(height * depth) {
        if ranges[1].contains(&(row % height)) && ranges[2].contains(&(row / height)) {
            let [first, end] = [ranges[0].start, ranges[0].end].map(|at| at.min(numbers.len()));
            numbers[..first].fill(T::default());
            numbers[end..].fill(T::default());
        } else {
            numbers.fill(T::default());
        }
    }
}

/// Sets the numbers of voxels that are not to be kept to 0.
fn keep(is_kept: &impl Fn([usize; 3]) -> bool, [width, height, _]: [usize; 3], numbers: &mut [u16]) {
    for (i, number) in numbers.iter_mut().enumerate() {
        if !is_kept([i % width, i / width % height, i / (width * height)]) {
            *number = 0;
        }
    }
}

/// Uniforms and textures of the light of a march, complete.
fn light(
    renderer: &Renderer,
    scene: &Scene,
    planned: &Planned,
    uploaded: &Uploaded,
) -> Result<(Bytes, Vec<LightTexture>), RenderError> {
    let grid = renderer.light_grid(scene, planned, uploaded, false)?;
    while let Some(grid) = grid.as_ref().filter(|grid| !grid.is_complete()) {
        grid.advance(renderer, planned, uploaded)?;
    }
    let mut scattered = renderer.scattered(scene, planned, uploaded, LightQuality::Full)?;
    while let Some(scattered) = scattered.as_mut().filter(|scattered| !scattered.is_complete()) {
        scattered.advance(renderer, uploaded)?;
    }
    let resource = |name: &str| {
        let of_grid = grid.as_ref().and_then(|grid| grid.resource(name));
        of_grid.or_else(|| scattered.as_ref().and_then(|scattered| scattered.resource(name)))
    };
    let (mut uniforms, mut textures) = (Bytes::new(), Vec::new());
    for name in ["light_uniform", "light_grid", "gathered_uniform", "gathered_light"] {
        match resource(name) {
            Some(Resource::Uniform(buffer)) => {
                let mut bytes = vec![0; usize::try_from(buffer.bytes()).unwrap_or_default()];
                buffer.read(0, &mut bytes)?;
                uniforms.push((name, bytes));
            }
            Some(Resource::Texture(image)) => textures.push(read_back(renderer, name, image)?),
            _ => {}
        }
    }
    Ok((uniforms, textures))
}

/// The texels of a texture of light, whose numbers are 16-bit floats in any format.
fn read_back(renderer: &Renderer, name: &'static str, image: &Image3d) -> Result<LightTexture, RenderError> {
    let dims = image.extent();
    let texels: u64 = dims.iter().copied().map(u64::from).product();
    let bytes = texels * u64::from(image.format().texel_bytes());
    let buffer = Buffer::host(&renderer.device, name, bytes, HostUse::ReadBack)?;
    renderer.device.run(name, |recorder| {
        recorder.compute_to_transfer();
        recorder.read_back_volume(image, &buffer)?;
        recorder.transfer_to_host();
        Ok(())
    })?;
    let mut read = vec![0; usize::try_from(bytes).unwrap_or_default()];
    buffer.read(0, &mut read)?;
    let (numbers, texels) = match image.format() {
        Format::R32Float => {
            let half = |bytes: &[u8; 4]| half::f16::from_f32(f32::from_ne_bytes(*bytes)).to_bits();
            (1, read.as_chunks().0.iter().map(half).collect())
        }
        _ => (4, read.as_chunks().0.iter().map(|bytes| u16::from_ne_bytes(*bytes)).collect()),
    };
    Ok(LightTexture { name, dims, numbers, texels })
}
