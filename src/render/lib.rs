//! Renders frames on the GPU.
//!
//! [`Renderer::upload`] puts a volume on the device, [`Renderer::march`] makes a [`DeviceFilm`] of it, and
//! [`Renderer::relight_linear`] makes a picture of the film, as often as the light changes.
#![forbid(unsafe_code)]

mod job;
mod level;
mod march;
mod pipelines;
mod pool;
mod relight;
mod scene;
mod store;
mod upload;
mod warning;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

pub use job::{Job, Keeps, KeptVolume, OnCpu, PictureLevel, PlannedJob, Reference};
pub use level::finest_level;
pub use march::{
    BrickCounts, BrowserMarch, DeviceFilm, Dispatching, FieldNumbers, LightQuality, LightTexture, March, MarchUniform,
    Speed, TableMemory, Target, browser_shader,
};
pub use pool::Residence;
pub use relight::{Relight, RelightUniform};
pub use scene::SceneRenderer;
pub use upload::Uploaded;
pub use warning::RenderWarning;

use pipelines::Pipelines;
use relume_base::number::readable;
use relume_scene::plan::{PlanError, ScenePlan};
use relume_scene::tables::VolumeFormat;
use relume_volume::VolumeError;
use relume_vulkan::shader::{BrowserShader, Constants, Iterations, Shader, ShaderError, compile, for_browser};
use relume_vulkan::{ComputePipeline, Device, Format, Resource, ResourceSet, VulkanError};

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// An error of the device.
    #[error("the device could not render")]
    Vulkan(#[from] VulkanError),
    /// A shader does not compile.
    #[error("a shader does not compile")]
    Shader(#[from] ShaderError),
    /// The scene has no plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The volume's values are not usable.
    #[error(transparent)]
    Volume(VolumeError),
    /// The labels are not usable.
    #[error("the labels cannot be used")]
    Labels(#[source] VolumeError),
    /// The work was cancelled.
    #[error("cancelled")]
    Cancelled,
    /// A thread in the background ended without a result.
    #[error("a thread in the background panicked, which is a bug of Relume; its message is in the terminal")]
    Panicked,
    /// Browsers do not march the scene.
    #[error("a live page does not march {what}; {way}")]
    Browser {
        /// Feature that they do not march.
        what: &'static str,
        /// Way out.
        way: &'static str,
    },
    /// The transmittance of a colour model is a matrix.
    #[error("the model peercy multiplies matrices, which only the reference marches")]
    Matrix,
    /// The camera has no line of sight.
    #[error(
        "the camera has no line of sight: its target is its position, or its up direction is parallel to the line of sight"
    )]
    Camera,
    /// A ray has too many samples.
    #[error("a ray has more than 8388608 samples at a step of {}; use a longer accuracy.step", readable(*step_length))]
    TooManySamples {
        /// Step length in world units.
        step_length: f64,
    },
    /// The device has no room for a brick of the volume.
    #[error(
        "a brick of the volume needs {edge} texels along each axis and {needed_kb} kB; {device} has {budget_kb} kB for it, in textures of at most {limit:?}"
    )]
    Slot {
        /// Size of the brick with the voxels around it.
        needed_kb: u64,
        /// Its texels along an axis.
        edge: u32,
        /// Name of the device.
        device: String,
        /// Memory for bricks.
        budget_kb: u64,
        /// Largest texture.
        limit: [u32; 3],
    },
    /// The scene needs more of the volume on the device than its bricks.
    #[error("the device holds the volume in bricks, and was given no coarse level of it, which {what} need")]
    Bricked {
        /// The feature that needs it, in the plural.
        what: &'static str,
    },
    /// The device does not hold the fields of a scene whole.
    #[error(
        "the device has no room for all fields of the scene at once, and several are not marched in bricks; average blocks of voxels (`downsample`), show fewer, or take accuracy.gradients = \"central\" if a second volume is shaded"
    )]
    Fields,
    /// A sample reads more voxels around a brick than were uploaded with it.
    #[error("the march reads {needed} voxels around each brick, and the bricks were uploaded with {has}")]
    Apron {
        /// Voxels that the march reads.
        needed: u32,
        /// Voxels that the slots have.
        has: u32,
    },
    /// A picture has more pixels along a side, or more layers, than the device supports.
    #[error(
        "a picture of {}×{} pixels with {} vectors each is too large for {device}, whose limit is {}×{} with {}", asked[0], asked[1], asked[2], limit[0], limit[1], limit[2]
    )]
    PictureSize {
        /// Pixels across and down, and number of layers.
        asked: [usize; 3],
        /// Name of the device.
        device: String,
        /// Its limits.
        limit: [u32; 3],
    },
    /// A picture and its volume together do not fit into the device's memory.
    #[error(
        "a picture of {}×{} pixels needs {needed_mb} MB and its volume {volume_mb} MB, and {device} has {heap_mb} MB", size[0], size[1]
    )]
    PictureMemory {
        /// Pixels across and down.
        size: [usize; 2],
        /// Size of the accumulators and the relit picture.
        needed_mb: u64,
        /// Size of the volume.
        volume_mb: u64,
        /// Name of the device.
        device: String,
        /// Size of its memory.
        heap_mb: u64,
    },
    /// Shadows by rays are for the reference only.
    #[error("a device renders shadows by a light grid, not by rays; use shadows.method = \"grid\"")]
    LightRays,
    /// Paths of light are for the reference only.
    #[error("a device gathers scattered light at nodes, and follows no paths; use scattering.method = \"rows\"")]
    Paths,
    /// The device has no room for scattered light.
    #[error(
        "{device} has no room for scattered light at places {} voxels apart, {}×{}×{} texels; set a larger scattering.spacing", readable(*spacing), extent[0], extent[1], extent[2]
    )]
    ScatteredLight {
        /// Spacing of its nodes in voxels.
        spacing: f64,
        /// Texels of its texture.
        extent: [u32; 3],
        /// Name of the device.
        device: String,
    },
    /// Scattered light could not be gathered.
    #[error(transparent)]
    Scattering(relume_scene::reference::ReferenceError),
    /// The device does not filter the volume's format.
    #[error(
        "{device} cannot interpolate {format:?} textures, which this volume needs; use accuracy.interpolation = \"exact_linear\" or \"nearest\", or another device"
    )]
    Filter {
        /// Format of the texture.
        format: VolumeFormat,
        /// Name of the device.
        device: String,
    },
}

impl RenderError {
    /// Name for programs; it does not change between versions.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Vulkan(error) => error.code(),
            Self::Shader(_) => "shader-invalid",
            Self::Plan(error) => error.code(),
            Self::Volume(error) | Self::Labels(error) => error.code(),
            Self::Cancelled => "cancelled",
            Self::Panicked => "thread-panicked",
            Self::Browser { .. } => "live-unsupported",
            Self::Matrix => "matrix-on-a-device",
            Self::Camera => "camera-without-direction",
            Self::TooManySamples { .. } => "samples-too-many",
            Self::Slot { .. } => "volume-memory-exceeded",
            Self::Bricked { .. } => "bricks-unsupported",
            Self::Fields => "fields-too-large",
            Self::Apron { .. } => "bricks-too-narrow",
            Self::PictureSize { .. } => "picture-too-large",
            Self::PictureMemory { .. } => "picture-memory-exceeded",
            Self::LightRays => "shadow-rays-unsupported",
            Self::ScatteredLight { .. } => "scattered-light-too-large",
            Self::Paths => "scattering-paths-unsupported",
            Self::Scattering(error) => error.code(),
            Self::Filter { .. } => "interpolation-unsupported",
        }
    }
}

/// A device with its most recently used pipelines. Clones share them.
#[derive(Clone, Debug)]
pub struct Renderer {
    device: Device,
    dispatching: Dispatching,
    /// Largest number of bytes of a volume on the device, if it is not the device's own.
    memory_bytes: Option<u64>,
    /// Bytes of these that other volumes take.
    taken_bytes: u64,
    /// Bytes of other volumes that stay on the device beside the one that is marched.
    beside_bytes: u64,
    /// Largest number of texels along an axis of a volume's texture, if it is not the device's own.
    longest_axis: Option<u32>,
    /// Whether volumes that fit are in bricks, too.
    always_bricked: bool,
    /// Initial speed of a march of an unknown plan.
    speed: Speed,
    shared: Arc<Shared>,
}

/// State that the clones of a [`Renderer`] share.
#[derive(Debug, Default)]
struct Shared {
    /// Plan and speed of the last [`Renderer::march`].
    learnt: Mutex<Option<(ScenePlan, Speed)>>,
    pipelines: Mutex<Pipelines>,
    marches: AtomicU64,
    longest_dispatch: AtomicU64,
    light_fills: AtomicU64,
}

/// Source of a pipeline's shader. Plans with equal sources share a pipeline.
#[derive(Clone, Debug, PartialEq)]
struct Source {
    name: &'static str,
    constants: Constants,
    parts: Vec<Part>,
}

/// Name of a text, mostly that of its file, and the text.
type Part = (&'static str, std::borrow::Cow<'static, str>);

impl Source {
    fn compile(&self) -> Result<Shader, ShaderError> {
        compile(&self.texts(), &self.constants)
    }

    fn for_browser(&self) -> Result<BrowserShader, ShaderError> {
        for_browser(&self.texts(), &self.constants)
    }

    /// Names and texts.
    fn texts(&self) -> Vec<(&str, &str)> {
        self.parts.iter().map(|(name, text)| (*name, text.as_ref())).collect()
    }
}

/// A pipeline and the names of the resources that it binds, in order.
#[derive(Clone, Debug)]
struct Made {
    pipeline: ComputePipeline,
    resources: Vec<String>,
    iterations: Iterations,
}

impl Renderer {
    /// A renderer on `device`.
    #[must_use]
    pub fn new(device: Device) -> Self {
        let dispatching = Dispatching { tables: TableMemory::fastest(&device), ..Dispatching::default() };
        Self {
            device,
            dispatching,
            memory_bytes: None,
            taken_bytes: 0,
            beside_bytes: 0,
            longest_axis: None,
            always_bricked: false,
            speed: Speed::default(),
            shared: Arc::default(),
        }
    }

    /// Number of marches begun.
    #[must_use]
    pub fn marches(&self) -> u64 {
        self.shared.marches.load(Ordering::Relaxed)
    }

    /// Largest number of samples in a dispatch: pixels across, times rows, times samples along a ray.
    #[must_use]
    pub fn longest_dispatch(&self) -> u64 {
        self.shared.longest_dispatch.load(Ordering::Relaxed)
    }

    /// The same renderer for a device that other work waits for: dispatches of [`Self::march`] take about `dispatch`,
    /// and far less for an unknown plan.
    #[must_use]
    pub fn with_dispatches_of(self, dispatch: Duration) -> Self {
        let speed = Speed::unknown(dispatch, self.device.info().kind);
        Self { speed, ..self }
    }

    /// Plan and speed of the last [`Self::march`].
    fn learnt(&self) -> MutexGuard<'_, Option<(ScenePlan, Speed)>> {
        self.shared.learnt.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Initial speed of a march of an unknown plan.
    #[must_use]
    pub fn speed(&self) -> Speed {
        self.speed
    }

    /// The same renderer with another division of its marches. A slice out of range is clamped.
    #[must_use]
    pub fn with_dispatching(self, dispatching: Dispatching) -> Self {
        let slice = dispatching.slice.clamp(1, march::SLICE);
        Self { dispatching: Dispatching { slice, ..dispatching }, ..self }
    }

    /// The same renderer with at most `bytes` of a volume on the device. A larger volume is marched in bricks, and these
    /// are the bytes of its pool.
    #[must_use]
    pub fn with_memory(self, bytes: u64) -> Self {
        Self { memory_bytes: Some(bytes), ..self }
    }

    /// The same renderer as if the device had textures of at most `texels` along an axis.
    #[must_use]
    pub fn with_longest_axis(self, texels: u32) -> Self {
        Self { longest_axis: Some(texels), ..self }
    }

    /// The same renderer with every volume in bricks, for measurements. The picture is the same.
    #[must_use]
    pub fn always_in_bricks(self) -> Self {
        Self { always_bricked: true, ..self }
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Refuses a picture of `size` that the device cannot hold together with a volume of `volume_bytes`.
    /// [`Self::march`] checks this too; a check before [`Self::upload`] saves the upload.
    ///
    /// # Errors
    ///
    /// [`RenderError::PictureSize`], [`RenderError::PictureMemory`].
    pub fn check_picture(&self, plan: &ScenePlan, size: [usize; 2], volume_bytes: u64) -> Result<(), RenderError> {
        let (limits, device) = (self.device.limits(), &self.device.info().name);
        let format = Format::Rgba32Float;
        let [widest, highest] = limits.max_extent_2d(format);
        let limit = [widest, highest, limits.max_layers(format)];
        let asked = [size[0], size[1], plan.layers() * if plan.keeps_more() { 2 } else { 1 }];
        if asked.iter().zip(limit).any(|(&asked, limit)| asked as u64 > u64::from(limit)) {
            return Err(RenderError::PictureSize { asked, device: device.clone(), limit });
        }
        // The film on the device, and a relit picture in f32.
        let needed = (size[0] * size[1]) as u64 * (plan.marched_bytes() + 16);
        if needed + volume_bytes > limits.device_heap_bytes {
            return Err(RenderError::PictureMemory {
                size,
                needed_mb: needed.div_ceil(1 << 20),
                volume_mb: volume_bytes.div_ceil(1 << 20),
                device: device.clone(),
                heap_mb: limits.device_heap_bytes >> 20,
            });
        }
        Ok(())
    }

    /// Returns the pipeline of `source`, and the `named` resources that its shader uses, bound to it.
    fn bind<'a>(
        &self,
        source: Source,
        named: impl Fn(&str) -> Option<Resource<'a>>,
    ) -> Result<(ComputePipeline, ResourceSet), RenderError> {
        let name = source.name;
        self.bound(name, self.made(source)?, named)
    }

    /// [`Self::bind`], of a pipeline that is `made`.
    fn bound<'a>(
        &self,
        name: &str,
        made: Made,
        named: impl Fn(&str) -> Option<Resource<'a>>,
    ) -> Result<(ComputePipeline, ResourceSet), RenderError> {
        let bound = |resources: &[String]| -> Result<Vec<Resource<'a>>, RenderError> {
            resources
                .iter()
                .map(|resource| {
                    named(resource).ok_or_else(|| {
                        let mistake = format!("the shader uses {resource:?}, which its plan does not contain");
                        VulkanError::Misuse { object: name.to_owned(), mistake }.into()
                    })
                })
                .collect()
        };
        let set = ResourceSet::new(&self.device, name, &made.pipeline, &bound(&made.resources)?)?;
        Ok((made.pipeline, set))
    }

    /// Returns the pipeline of `source`. Makes it if it is not cached, without blocking threads that need another.
    fn made(&self, source: Source) -> Result<Made, RenderError> {
        let pipelines = || self.shared.pipelines.lock().unwrap_or_else(PoisonError::into_inner);
        let kept = pipelines().get(&source);
        if let Some(made) = kept {
            return Ok(made);
        }
        let shader = source.compile()?;
        let pipeline = ComputePipeline::new(&self.device, source.name, &shader)?;
        let (resources, iterations) = (shader.resources().to_vec(), shader.iterations());
        Ok(pipelines().keep(source, Made { pipeline, resources, iterations }))
    }
}

/// The shaders of `plan`, by stage: march, relight to the display, relight to linear values.
///
/// # Errors
///
/// [`ShaderError`] if a shader does not compile.
pub fn shaders_of(plan: &ScenePlan) -> Result<[(&'static str, Shader); 3], ShaderError> {
    Ok([
        ("march", march::source(plan, Dispatching::default()).compile()?),
        ("relight_display", relight::source(plan, relight::Target::Display { backdrop: false }).compile()?),
        ("relight_linear", relight::source(plan, relight::Target::Linear).compile()?),
    ])
}
