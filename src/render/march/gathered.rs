//! Light that has scattered before, on the device: gathered by the host in a thread of its own, and kept with the volume until it changes.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::LightQuality;
use super::light_grid::Place;
use crate::{RenderError, Renderer, Uploaded};
use relume_base::number::unsigned;
use relume_base::progress::Progress;
use relume_scene::plan::{LANE, Planned, ScenePlan};
use relume_scene::reference::{GatheredLight, ReferenceError, TransferRows};
use relume_scene::tables::LightGrid;
use relume_scene::{ScatteringMethod, Scene};
use relume_vulkan::{Buffer, Filter, Format, HostUse, Image3d, Resource, Sampler, VulkanError};

/// Time between two looks at the thread.
const PAUSE: Duration = Duration::from_millis(2);

/// Gathered light in a texture.
#[derive(Debug)]
pub(super) struct DeviceLight {
    /// Rows and reflectances.
    key: String,
    /// Texels of each node.
    layers: usize,
    image: Image3d,
    sampler: Sampler,
    place: Buffer,
}

/// Gathered light of a march.
#[derive(Debug)]
pub(super) struct Scattered {
    light: Arc<DeviceLight>,
    lighting: LightQuality,
    /// The thread that gathers it; `None` if the texture is complete.
    gathering: Option<Gathering>,
}

#[derive(Debug)]
struct Gathering {
    thread: JoinHandle<Result<(Arc<TransferRows>, GatheredLight), ReferenceError>>,
    state: Arc<State>,
}

/// Progress of a thread.
#[derive(Debug, Default)]
struct State {
    cancelled: AtomicBool,
    done: AtomicUsize,
    all: AtomicUsize,
}

impl Progress for State {
    fn report(&self, _stage: &str, done: u64, total: u64) {
        let whole = |parts: u64| usize::try_from(parts).unwrap_or(usize::MAX);
        self.done.fetch_max(whole(done), Ordering::Relaxed);
        self.all.store(whole(total), Ordering::Relaxed);
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }
}

impl Drop for Scattered {
    fn drop(&mut self) {
        if let Some(gathering) = &self.gathering {
            gathering.state.cancelled.store(true, Ordering::Relaxed);
        }
    }
}

impl DeviceLight {
    /// Uploads the texels.
    fn fill(&self, renderer: &Renderer, texels: &[[u16; LANE]]) -> Result<(), RenderError> {
        let bytes: &[u8] = bytemuck::cast_slice(texels.as_flattened());
        let staging = Buffer::host(&renderer.device, "scattered light", bytes.len() as u64, HostUse::Upload)?;
        staging.write(0, bytes)?;
        let slices = 0..self.image.extent()[2];
        Ok(renderer.device.run("scattered light", |recorder| recorder.upload(&self.image, slices, &staging, 0))?)
    }
}

impl Renderer {
    /// The gathered light of `scene`, which a thread completes; `None` if light scatters once. With [`LightQuality::Last`] any light of as many
    /// numbers that is there, or none.
    pub(super) fn scattered(
        &self,
        scene: &Scene,
        planned: &Planned,
        uploaded: &Uploaded,
        lighting: LightQuality,
    ) -> Result<Option<Scattered>, RenderError> {
        let plan = &planned.plan;
        match plan.light.gathered {
            None => return Ok(None),
            Some(ScatteringMethod::Paths) => return Err(RenderError::Paths),
            Some(ScatteringMethod::Rows) => {}
        }
        let (medium, stored, factors) = uploaded.scattering_medium(scene);
        let scene = &*medium;
        scene.volume().require_voxels("scattered light").map_err(RenderError::Volume)?;
        let [rows, kept] = uploaded.scattering.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let rows = rows.and_then(|rows| rows.downcast::<TransferRows>().ok());
        let kept = kept.and_then(|light| light.downcast::<DeviceLight>().ok());
        let (key, layers) = (GatheredLight::key(scene, planned), plan.layers());
        if let Some(light) = kept.clone().filter(|light| light.key == key) {
            return Ok(Some(Scattered { light, lighting: LightQuality::Full, gathering: None }));
        }
        let rough = scene.with_rough_scattering();
        let rough_key = GatheredLight::key(&rough, planned);
        let serves = |light: &Arc<DeviceLight>| match lighting {
            LightQuality::Last => light.layers == layers,
            LightQuality::Rough => light.key == rough_key,
            LightQuality::Full => false,
        };
        if let Some(light) = kept.filter(serves) {
            let lighting = if light.key == rough_key { LightQuality::Rough } else { LightQuality::Last };
            return Ok(Some(Scattered { light, lighting, gathering: None }));
        }
        // From rows that are there, light takes as long as rough light from new ones.
        let has_rows = rows.as_ref().is_some_and(|rows| rows.are_of(scene, planned));
        let (scene, key, lighting) = match lighting {
            LightQuality::Rough if !has_rows => (&rough, rough_key, lighting),
            LightQuality::Rough | LightQuality::Full => (scene, key, LightQuality::Full),
            LightQuality::Last => (scene, String::new(), lighting),
        };
        let grid = LightGrid::of_middles(scene, scene.scattering_spacing());
        let extent = extent(&grid, plan);
        let mut in_volume = grid;
        in_volume.scale *= factors;
        // As an image that is written, it can be read back for a browser.
        let image = Image3d::written(&self.device, "scattered light", Format::Rgba16Float, extent);
        let image = image.map_err(|error| match error {
            VulkanError::TooLarge { .. } | VulkanError::OutOfMemory { .. } => RenderError::ScatteredLight {
                spacing: scene.scattering_spacing(),
                extent,
                device: self.device.info().name.clone(),
            },
            error => error.into(),
        })?;
        let light = Arc::new(DeviceLight {
            key,
            layers,
            image,
            sampler: Sampler::new(&self.device, "scattered light", Filter::Linear)?,
            place: self.place_of("place of scattered light", Place::new(&in_volume, layers))?,
        });
        if lighting == LightQuality::Last {
            // Light that scatters once is there at once.
            light.fill(self, &vec![[0; LANE]; extent.map(|texels| texels as usize).iter().product()])?;
            return Ok(Some(Scattered { light, lighting, gathering: None }));
        }
        let state = Arc::new(State::default());
        let (own, storage, labels) = (Arc::clone(&state), stored.storage.clone(), stored.labels.clone());
        let (scene, planned) = (scene.clone(), planned.clone());
        let thread = std::thread::spawn(move || {
            let rows = match rows.filter(|rows| rows.are_of(&scene, &planned)) {
                Some(rows) => rows,
                None => Arc::new(TransferRows::new(&scene, &planned, &storage, labels.as_deref(), &*own)?),
            };
            let light = rows.light(&scene, &planned, &*own)?;
            Ok((rows, light))
        });
        Ok(Some(Scattered { light, lighting, gathering: Some(Gathering { thread, state }) }))
    }
}

/// Texels of a texture of gathered light.
fn extent(grid: &LightGrid, plan: &ScenePlan) -> [u32; 3] {
    let [width, height, depth] = grid.dims.map(unsigned);
    [width, height, depth * unsigned(plan.layers().max(1))]
}

impl Scattered {
    /// The light that this is.
    pub(super) const fn lighting(&self) -> LightQuality {
        self.lighting
    }

    /// True if the texture is complete.
    pub(super) const fn is_complete(&self) -> bool {
        self.gathering.is_none()
    }

    /// Parts of the work that are done, and all; `None` if the texture is complete.
    pub(super) fn progress(&self) -> Option<[usize; 2]> {
        let state = &self.gathering.as_ref()?.state;
        Some([&state.done, &state.all].map(|number| number.load(Ordering::Relaxed)))
    }

    /// Waits a moment for the thread; uploads its light once it has ended.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub(super) fn advance(&mut self, renderer: &Renderer, uploaded: &Uploaded) -> Result<(), RenderError> {
        if self.gathering.as_ref().is_some_and(|gathering| !gathering.thread.is_finished()) {
            std::thread::sleep(PAUSE);
            return Ok(());
        }
        let Some(Gathering { thread, .. }) = self.gathering.take() else { return Ok(()) };
        let (rows, light) = thread.join().map_err(|_| RenderError::Panicked)?.map_err(|error| match error {
            ReferenceError::Cancelled => RenderError::Cancelled,
            error => RenderError::Scattering(error),
        })?;
        self.light.fill(renderer, &light.texels())?;
        let mut kept = uploaded.scattering.0.lock().unwrap_or_else(PoisonError::into_inner);
        *kept = [Some(rows), Some(Arc::<DeviceLight>::clone(&self.light))];
        Ok(())
    }

    /// A resource of the march by its name in the shader.
    pub(super) fn resource(&self, name: &str) -> Option<Resource<'_>> {
        Some(match name {
            "gathered_uniform" => Resource::Uniform(&self.light.place),
            "gathered_light" => Resource::Texture(&self.light.image),
            "gathered_sampler" => Resource::Sampler(&self.light.sampler),
            _ => return None,
        })
    }
}
