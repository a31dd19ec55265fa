//! The mean of several rays of a pixel, on the device.

use super::source::formats;
use crate::{RenderError, Renderer, Source};
use relume_base::number::{count, rounded, unsigned};
use relume_scene::StoreAs;
use relume_scene::plan::ScenePlan;
use relume_vulkan::shader::Constants;
use relume_vulkan::{ComputePipeline, Format, Resource, ResourceSet, StorageImage};

/// Width of a workgroup: long rows, as for a relight.
const GROUP_WIDTH: u32 = 64;

/// Mean of the films of a pixel's rays so far.
#[derive(Debug)]
pub(super) struct Mean {
    pub(super) accumulators: StorageImage,
    pub(super) transmittance: StorageImage,
    adding: [(ComputePipeline, ResourceSet); 2],
    added: usize,
    rays: usize,
}

fn source(format: Format) -> Source {
    let format = if format == Format::R32Float { "r32float" } else { "rgba32float" };
    let constants = Constants::new()
        .u32("GROUP_WIDTH", GROUP_WIDTH)
        .alias("FilmImage", &format!("texture_storage_2d_array<{format}, read_write>"));
    let parts = vec![("shaders/mean.wgsl", include_str!("../../../shaders/mean.wgsl").into())];
    Source { name: "mean", constants, parts }
}

impl Mean {
    /// Creates the mean of `plan.rays` films in these images.
    pub(super) fn new(
        renderer: &Renderer,
        plan: &ScenePlan,
        [accumulators, transmittance]: [&StorageImage; 2],
    ) -> Result<Self, RenderError> {
        let [vectors, format] = formats(plan, StoreAs::Single);
        let image = |of: &StorageImage, format| {
            StorageImage::new(&renderer.device, of.name(), format, of.extent(), of.layers())
        };
        let means = [image(accumulators, vectors)?, image(transmittance, format)?];
        let adding = |one: &StorageImage, mean: &StorageImage, format| {
            renderer.bind(source(format), |name| match name {
                "one" => Some(Resource::StorageImage(one)),
                "mean" => Some(Resource::StorageImage(mean)),
                _ => None,
            })
        };
        let adding = [adding(accumulators, &means[0], vectors)?, adding(transmittance, &means[1], format)?];
        let [accumulators, transmittance] = means;
        Ok(Self { accumulators, transmittance, adding, added: 0, rays: plan.rays })
    }

    /// Whether it contains all rays.
    pub(super) fn has_all(&self) -> bool {
        self.added >= self.rays
    }

    /// Adds the film of the ray that has just been marched.
    pub(super) fn add(&mut self, renderer: &Renderer) -> Result<(), RenderError> {
        if self.has_all() {
            return Ok(());
        }
        self.added += 1;
        let share: f32 = rounded(1.0 / count(self.added));
        renderer.device.run("mean", |recorder| {
            recorder.compute_to_compute();
            for ((pipeline, set), image) in self.adding.iter().zip([&self.accumulators, &self.transmittance]) {
                let [width, height] = image.extent();
                let groups = [width.div_ceil(GROUP_WIDTH), height, unsigned(image.layers() as usize)];
                recorder.dispatch(pipeline, set, bytemuck::bytes_of(&share), groups)?;
            }
            Ok(())
        })?;
        Ok(())
    }
}
