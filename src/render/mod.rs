//! Frames on the GPU.
//!
//! [`Renderer::upload`] puts a volume on the device, [`Renderer::march`] leaves [`Accumulators`] of it, and
//! [`Renderer::relight_linear`] turns those into pictures, as often as the light changes.

mod march;
mod relight;
mod upload;

use std::collections::HashMap;
use std::sync::Mutex;

pub use march::{Accumulators, Dispatching, MarchUniform};
pub use relight::{Relight, RelightUniform};
pub use upload::Uploaded;

use crate::plan::{Planned, ScenePlan};
use crate::scene::Scene;
use crate::shader::{Shader, ShaderError};
use crate::tables::VolumeFormat;
use crate::volume::VolumeError;
use crate::vulkan::{ComputePipeline, Device, Resource, ResourceSet, VulkanError};

/// Why a frame could not be rendered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// The device refused.
    #[error("the device could not render")]
    Vulkan(#[from] VulkanError),
    /// A shader does not compile.
    #[error("a shader does not compile")]
    Shader(#[from] ShaderError),
    /// Labels that cannot be used.
    #[error("the labels cannot be used")]
    Labels(#[from] VolumeError),
    /// Somebody asked it to stop.
    #[error("cancelled")]
    Cancelled,
    /// The camera looks nowhere.
    #[error("the camera looks nowhere: its target is its position, or its up direction is the one it looks in")]
    Camera,
    /// A ray has more samples than can be counted.
    #[error("a ray has more than 8388608 samples of length {step_length}; take a longer step")]
    TooManySamples {
        /// Δs in world units.
        step_length: f64,
    },
    /// The volume needs more texels along an axis than the device has.
    #[error(
        "the volume has {dims:?} voxels; {device} holds at most {limit:?}: take --downsample to average blocks of voxels"
    )]
    TooLarge {
        /// The volume.
        dims: [usize; 3],
        /// The device.
        device: String,
        /// What it holds.
        limit: [u32; 3],
    },
    /// The volume's texture does not fit into the device's memory.
    #[error(
        "the volume needs {needed_mb} MB as {format:?}; {device} has {heap_mb} MB: take --downsample, or shading = \"none\", which stores no gradients"
    )]
    Memory {
        /// Texture size.
        needed_mb: u64,
        /// Texture format.
        format: VolumeFormat,
        /// The device.
        device: String,
        /// Its memory.
        heap_mb: u64,
    },
    /// The device does not filter the volume's format.
    #[error(
        "{device} does not interpolate {format:?} textures, which these data need; take accuracy.interpolation = \"nearest\", or another device"
    )]
    Filter {
        /// Texture format.
        format: VolumeFormat,
        /// The device.
        device: String,
    },
}

/// A device and the pipelines made on it so far.
#[derive(Debug)]
pub struct Renderer {
    device: Device,
    dispatching: Dispatching,
    pipelines: Mutex<HashMap<Key, Made>>,
}

/// What tells pipelines apart.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Key {
    /// With the one exponent of all highlights, where there is one.
    March(ScenePlan, Option<u32>),
    Relight(ScenePlan, relight::Target),
}

/// A pipeline and the names of the resources it binds, in order.
#[derive(Clone, Debug)]
struct Made {
    pipeline: ComputePipeline,
    resources: Vec<String>,
}

impl Renderer {
    /// A renderer on `device`.
    #[must_use]
    pub fn new(device: Device) -> Self {
        Self { device, dispatching: Dispatching::default(), pipelines: Mutex::default() }
    }

    /// The same renderer with its marches cut otherwise. A slice out of range takes the nearest end.
    #[must_use]
    pub fn with_dispatching(self, dispatching: Dispatching) -> Self {
        let slice = dispatching.slice.clamp(1, march::SLICE);
        Self { dispatching: Dispatching { slice, ..dispatching }, pipelines: Mutex::default(), ..self }
    }

    /// The device.
    #[must_use]
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// The pipeline for `key`, and `named` resources bound to it. A pipeline is made once; what its plan does not use is
    /// not bound.
    fn bind<'a>(
        &self,
        key: &Key,
        compile: impl FnOnce() -> Result<Shader, ShaderError>,
        push_constant_bytes: u32,
        named: impl Fn(&str) -> Option<Resource<'a>>,
    ) -> Result<(ComputePipeline, ResourceSet), RenderError> {
        let mut pipelines = self.pipelines.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let name = match key {
            Key::March(..) => "march",
            Key::Relight(..) => "relight",
        };
        let bound = |resources: &[String]| -> Result<Vec<Resource<'a>>, RenderError> {
            resources
                .iter()
                .map(|resource| {
                    named(resource).ok_or_else(|| {
                        let mistake = format!("the shader uses {resource:?}, which its plan leaves out");
                        VulkanError::Misuse { object: name.to_owned(), mistake }.into()
                    })
                })
                .collect()
        };
        let made = match pipelines.get(key) {
            Some(made) => made.clone(),
            None => {
                let shader = compile()?;
                let kinds: Vec<_> = bound(&shader.resources)?.iter().map(Resource::kind).collect();
                let pipeline = ComputePipeline::new(&self.device, name, &shader.words, &kinds, push_constant_bytes)?;
                let made = Made { pipeline, resources: shader.resources };
                pipelines.insert(key.clone(), made.clone());
                made
            }
        };
        let set = ResourceSet::new(&self.device, name, &made.pipeline, &bound(&made.resources)?)?;
        Ok((made.pipeline, set))
    }
}

/// The shaders that render `scene` as planned, by stage: march, relight to the display, relight to linear values.
///
/// # Errors
///
/// [`ShaderError`] where one does not compile.
pub fn shaders_of(scene: &Scene, planned: &Planned) -> Result<[(&'static str, Shader); 3], ShaderError> {
    let plan = &planned.plan;
    let exponent = march::one_exponent(scene, planned).unwrap_or(0);
    Ok([
        ("march", march::shader(plan, exponent, Dispatching::default().group)?),
        ("relight_display", relight::shader(plan, relight::Target::Display)?),
        ("relight_linear", relight::shader(plan, relight::Target::Linear)?),
    ])
}
