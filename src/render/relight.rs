//! Post-illumination on the device: converts accumulators to pictures.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3Swizzles as _};

use super::march::{common, images, read_layer};
use super::{DeviceFilm, RenderError, Renderer, Source};
use relume_base::number::{rounded, unsigned};
use relume_scene::film::{RelightMatrices, automatic_exposure};
use relume_scene::plan::{LANE, ScenePlan};
use relume_scene::{Backdrop, Display, Mix, Tone};
use relume_vulkan::{Buffer, Device, Format, HostUse, Resource, StorageImage};

/// Workgroup of a relight: long rows (docs/theory/device.md).
const GROUP: [u32; 2] = [64, 1];
/// Largest number of layers whose colours an invocation copies; more would take seconds to compile.
const FEW_LAYERS: usize = 16;
/// Rows of the picture per invocation.
const ROWS: u32 = 8;

/// Output of a relight.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Target {
    /// 8-bit sRGB, in front of a backdrop or of black.
    Display { backdrop: bool },
    /// Linear sRGB and opacity in f32.
    Linear,
}

/// Head of the relight's uniform, in the layout of `shaders/relight.wgsl`; the colours of transmittance and
/// accumulators follow.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
#[expect(missing_docs, reason = "named in the shader")]
pub struct RelightUniform {
    pub width: u32,
    pub height: u32,
    pub again: u32,
    pub soft: u32,
    /// Square roots of linear colours at the top and at the bottom.
    pub backdrop: [[f32; 4]; 2],
}

/// True if the relight reads the transmittance: for a background or a backdrop, or for the opacity of the picture.
fn reads_transmittance(plan: &ScenePlan, target: Target) -> bool {
    plan.background || target != Target::Display { backdrop: false }
}

/// Whether pictures for `target` are relit often; the first relight then records the pixels that show no material.
fn is_lit_again(target: Target) -> bool {
    target != Target::Linear
}

/// Source of the relight shader of `plan`.
pub(super) fn source(plan: &ScenePlan, target: Target) -> Source {
    let [accumulators, transmittance] = images(plan, plan.storage, "read");
    let constants = common(plan)
        .bool("BACKGROUND", plan.background)
        .bool("READS_TRANSMITTANCE", reads_transmittance(plan, target))
        .u32("TRANSMITTANCE_LANES", unsigned(plan.transmittance_lanes()))
        .alias("AccumulatorImage", &accumulators)
        .alias("TransmittanceImage", &transmittance)
        .bool("SKIP_EMPTY", is_lit_again(target))
        .bool("DISPLAY", target != Target::Linear)
        .bool("BACKDROP", target == Target::Display { backdrop: true })
        .bool("FEW_LAYERS", plan.layers() <= FEW_LAYERS)
        .f32("KNEE", rounded(Tone::KNEE))
        .f32("BRIGHTEST", rounded(Tone::BRIGHTEST))
        .u32("ROWS", ROWS)
        .u32("GROUP_WIDTH", GROUP[0])
        .u32("GROUP_HEIGHT", GROUP[1]);
    let parts = vec![("shaders/relight.wgsl", include_str!("../../shaders/relight.wgsl").into())];
    Source { name: "relight", constants, parts }
}

/// A prepared relight, to run as often as the light changes. It keeps the accumulators on the device.
#[derive(Debug)]
pub struct Relight {
    device: Device,
    components: usize,
    pipeline: relume_vulkan::ComputePipeline,
    set: relume_vulkan::ResourceSet,
    uniform: Buffer,
    picture: StorageImage,
    /// Whether every pixel of the picture was relit once.
    lit: AtomicBool,
    bytes: u64,
}

impl Renderer {
    /// Prepares a relight to 8-bit sRGB, RGBA, rows from the top.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn relight_display(&self, film: &DeviceFilm) -> Result<Relight, RenderError> {
        self.relight_display_over(film, Backdrop::None)
    }

    /// The same in front of a `backdrop`, if the scene has no background.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn relight_display_over(&self, film: &DeviceFilm, backdrop: Backdrop) -> Result<Relight, RenderError> {
        self.relight_over(film, backdrop, Format::Rgba8Unorm)
    }

    /// The same in BGRA, the format of windows.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn relight_window(&self, film: &DeviceFilm, backdrop: Backdrop) -> Result<Relight, RenderError> {
        self.relight_over(film, backdrop, Format::Bgra8Unorm)
    }

    fn relight_over(&self, film: &DeviceFilm, backdrop: Backdrop, format: Format) -> Result<Relight, RenderError> {
        let backdrop = backdrop != Backdrop::None && !film.planned.plan.background;
        self.relight(film, Target::Display { backdrop }, format)
    }

    /// Prepares a relight to linear sRGB and opacity (1 − transmittance) in f32, rows from the top.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn relight_linear(&self, film: &DeviceFilm) -> Result<Relight, RenderError> {
        self.relight(film, Target::Linear, Format::Rgba32Float)
    }

    /// The exposure that [`automatic_exposure`] finds for `film` under `mix`, of which `matrices` are those at exposure 1.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn automatic_exposure(
        &self,
        film: &DeviceFilm,
        matrices: &RelightMatrices,
        mix: &Mix,
        display: &Display,
    ) -> Result<f64, RenderError> {
        let relight = self.relight_linear(film)?;
        relight.run(matrices)?;
        Ok(automatic_exposure(&relight.read::<f32>()?, mix, display))
    }

    fn relight(&self, film: &DeviceFilm, target: Target, format: Format) -> Result<Relight, RenderError> {
        let plan = &film.planned.plan;
        let device = &self.device;
        let bytes = size_of::<RelightUniform>()
            + plan.transmittance_lanes() * size_of::<[[f32; LANE]; 4]>()
            + plan.layers().max(1) * size_of::<[[f32; LANE]; 3]>();
        let uniform = Buffer::host(device, "relight", bytes as u64, HostUse::Uniform)?;
        let name = match target {
            Target::Display { .. } => "display",
            Target::Linear => "linear",
        };
        let picture = StorageImage::new(device, name, format, film.size.map(unsigned), 1)?;
        let columns = [unsigned(film.size[0]), unsigned(film.size[1]).div_ceil(ROWS)];
        let nonzero = is_lit_again(target)
            .then(|| StorageImage::new(device, "nonzero", Format::R32Uint, columns, 1))
            .transpose()?;
        let (pipeline, set) = self.bind(source(plan, target), |name| {
            Some(match name {
                "relight" => Resource::Uniform(&uniform),
                "accumulators" => Resource::StorageImage(&film.accumulators),
                "transmittances" => Resource::StorageImage(&film.transmittance),
                "display" | "linear" => Resource::StorageImage(&picture),
                "nonzero" => Resource::StorageImage(nonzero.as_ref()?),
                _ => return None,
            })
        })?;
        let transmittance = if reads_transmittance(plan, target) { film.transmittance.bytes() } else { 0 };
        let accumulators = if plan.layers() == 0 { 0 } else { film.accumulators.bytes() };
        let bytes = uniform.bytes() + accumulators + transmittance + picture.bytes();
        let (device, lit) = (device.clone(), AtomicBool::new(false));
        Ok(Relight { device, components: plan.components(), pipeline, set, uniform, picture, lit, bytes })
    }
}

impl Relight {
    /// Relights the film by `matrices`, in one dispatch and without a march. Returns its duration by the device's
    /// clock, if it has one.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn run(&self, matrices: &RelightMatrices) -> Result<Option<Duration>, RenderError> {
        let size = self.picture.extent();
        let again = u32::from(self.lit.load(Ordering::Relaxed));
        let mut roots = matrices.backdrop.colours().map_or([DVec3::ZERO; 2], Backdrop::roots);
        if self.picture.format() == Format::Bgra8Unorm {
            roots = roots.map(|root| root.zyx());
        }
        let backdrop = roots.map(|root| root.extend(0.0).to_array().map(rounded));
        let head = RelightUniform {
            width: size[0],
            height: size[1],
            again,
            soft: u32::from(matrices.tone == Tone::Soft),
            backdrop,
        };
        self.uniform.write(0, bytemuck::bytes_of(&head))?;
        let (mut transmittance, mut lanes) = (matrices.transmittance_lanes(), matrices.lanes(self.components));
        if self.picture.format() == Format::Bgra8Unorm {
            transmittance.iter_mut().for_each(|channels| channels.swap(0, 2));
            lanes.iter_mut().for_each(|channels| channels.swap(0, 2));
        }
        self.uniform.write(size_of::<RelightUniform>() as u64, bytemuck::cast_slice(&transmittance))?;
        let colours_at = size_of::<RelightUniform>() + size_of_val(transmittance.as_slice());
        self.uniform.write(colours_at as u64, bytemuck::cast_slice(&lanes))?;
        let took = self.device.run_timed("relight", |recorder| {
            recorder.compute_to_compute();
            recorder.dispatch(
                &self.pipeline,
                &self.set,
                &[],
                [size[0].div_ceil(GROUP[0]), size[1].div_ceil(GROUP[1] * ROWS), 1],
            )
        })?;
        self.lit.store(true, Ordering::Relaxed);
        Ok(took)
    }

    /// Bytes on the device that a run reads and writes if every pixel shows something: accumulators, transmittance,
    /// matrices and picture, without the record of pixels that show no material.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The picture on the device, for display from there.
    #[must_use]
    pub fn picture(&self) -> &StorageImage {
        &self.picture
    }

    /// Reads the picture: `T` is `[u8; 4]` for a display relight (blue first for a window), `[f32; 4]` for a linear
    /// one.
    ///
    /// # Errors
    ///
    /// [`RenderError`].
    pub fn read<T: Pod>(&self) -> Result<Vec<T>, RenderError> {
        read_layer(&self.device, &self.picture, 0)
    }
}
