//! Stores finished accumulators in 16-bit floats on the device.

use super::{DeviceFilm, RenderError, Renderer, Source};
use relume_scene::StoreAs;
use relume_scene::plan::Transmittance;
use relume_vulkan::shader::Constants;
use relume_vulkan::{Format, Resource, StorageImage};

/// Width of a workgroup: long rows, as for a relight.
const GROUP_WIDTH: u32 = 64;

fn source() -> Source {
    let constants = Constants::new().u32("GROUP_WIDTH", GROUP_WIDTH);
    let parts = vec![("shaders/store.wgsl", include_str!("../../shaders/store.wgsl").into())];
    Source { name: "store", constants, parts }
}

impl Renderer {
    /// Stores a marched film as its plan states, and releases the images of the march that it replaces.
    pub(super) fn store(&self, marched: DeviceFilm) -> Result<DeviceFilm, RenderError> {
        let plan = &marched.planned.plan;
        if plan.storage == StoreAs::Single {
            return Ok(marched);
        }
        let accumulators = self.in_half(&marched.accumulators)?;
        let transmittance = match plan.transmittance {
            Transmittance::Grey => marched.transmittance,
            Transmittance::Coloured | Transmittance::Mixed => self.in_half(&marched.transmittance)?,
        };
        Ok(DeviceFilm { accumulators, transmittance, ..marched })
    }

    fn in_half(&self, finished: &StorageImage) -> Result<StorageImage, RenderError> {
        let ([width, height], layers) = (finished.extent(), finished.layers());
        let stored = StorageImage::new(&self.device, finished.name(), Format::Rgba16Float, [width, height], layers)?;
        let (pipeline, set) = self.bind(source(), |name| match name {
            "finished" => Some(Resource::StorageImage(finished)),
            "stored" => Some(Resource::StorageImage(&stored)),
            _ => None,
        })?;
        self.device.run("store", |recorder| {
            recorder.compute_to_compute();
            recorder.dispatch(&pipeline, &set, &[], [width.div_ceil(GROUP_WIDTH), height, layers])
        })?;
        Ok(stored)
    }
}
