//! Uploads volumes to the device.

use std::any::Any;
use std::sync::{Arc, Mutex};

use super::{RenderError, Renderer};
use crate::plan::Planned;
use crate::progress::Progress;
use crate::scene::{Interpolation, Scene};
use crate::tables::{Cells, LabelMap, Storage, VolumeFormat};
use crate::volume::Statistics;
use crate::vulkan::{Buffer, Format, HostUse, Image3d};

/// Bytes per upload; limits the host's copy.
const SLAB_BYTES: usize = 4 << 20;

/// A volume on the device, with its description on the host.
#[derive(Debug)]
pub struct Uploaded {
    /// Its storage.
    pub storage: Storage,
    /// Its macrocells with their value ranges.
    pub cells: Cells,
    /// Row of the label table for each voxel, if the plan has labels.
    pub labels: Option<LabelMap>,
    pub(super) volume: Image3d,
    pub(super) label_image: Option<Image3d>,
    pub(super) kept: Kept,
}

/// Results of marches of finished and of coarse pictures that are kept as long as the volume, of a type that the march
/// knows.
#[derive(Debug, Default)]
pub(super) struct Kept(pub(super) Mutex<[Option<Arc<dyn Any + Send + Sync>>; 2]>);

impl Uploaded {
    /// Bytes of its textures on the device.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let [width, height, depth] = self.volume.extent().map(u64::from);
        let texels = width * height * depth;
        let per_texel = [Some(&self.volume), self.label_image.as_ref()];
        per_texel.into_iter().flatten().map(|image| texels * u64::from(image.format().texel_bytes())).sum()
    }
}

impl From<VolumeFormat> for Format {
    fn from(format: VolumeFormat) -> Self {
        match format {
            VolumeFormat::R16Unorm => Self::R16Unorm,
            VolumeFormat::R32Float => Self::R32Float,
            VolumeFormat::Rgba16Snorm => Self::Rgba16Snorm,
            VolumeFormat::Rgba32Float => Self::Rgba32Float,
        }
    }
}

impl Renderer {
    /// Uploads the volume of `scene`, whose values have `statistics`, in the storage of `planned`, slab by slab.
    ///
    /// # Errors
    ///
    /// [`RenderError`]; limits of the device are checked before anything is allocated.
    pub fn upload(
        &self,
        scene: &Scene,
        planned: &Planned,
        statistics: &Statistics,
        progress: &dyn Progress,
    ) -> Result<Uploaded, RenderError> {
        let storage = Storage::new(&planned.plan, &scene.volume, statistics);
        let dims = scene.volume.geometry.dims;
        let format = Format::from(storage.format);
        self.check(planned, &storage, dims)?;
        let volume = self.fill("volume", format, dims, progress, |slices| storage.slab(&scene.volume, slices))?;
        let labels = match &scene.labels {
            Some(labels) if planned.plan.labels => Some(LabelMap::new(labels).map_err(RenderError::Labels)?),
            _ => None,
        };
        let smooth = planned.plan.smooth_labels;
        let label_image = labels
            .as_ref()
            .map(|map| {
                let format = if map.texel_bytes(smooth) == 1 { Format::R8Uint } else { Format::R16Uint };
                self.fill("labels", format, dims, progress, |slices| map.texels(dims, slices, smooth))
            })
            .transpose()?;
        let cells = Cells::new(&scene.volume, &storage, labels.as_ref());
        Ok(Uploaded { storage, cells, labels, volume, label_image, kept: Kept::default() })
    }

    /// Refuses a volume that the device cannot hold or filter.
    fn check(&self, planned: &Planned, storage: &Storage, dims: [usize; 3]) -> Result<(), RenderError> {
        let (limits, format) = (self.device.limits(), Format::from(storage.format));
        let device = self.device.info().name.clone();
        let limit = limits.max_extent_3d(format);
        if dims.iter().zip(limit).any(|(&n, limit)| n as u64 > u64::from(limit)) {
            return Err(RenderError::TooLarge { dims, device, limit });
        }
        if planned.plan.interpolation == Interpolation::Linear && !limits.linear_filter(format) {
            return Err(RenderError::Filter { format: storage.format, device });
        }
        let label_bytes = if planned.plan.labels { dims.iter().map(|&n| n as u64).product() } else { 0 };
        let needed = storage.bytes(dims).saturating_add(label_bytes);
        let heap = limits.device_heap_bytes.min(limits.max_allocation_bytes);
        if needed > heap {
            let (needed_mb, heap_mb) = (needed.div_ceil(1 << 20), heap >> 20);
            return Err(RenderError::Memory { needed_mb, format: storage.format, device, heap_mb });
        }
        Ok(())
    }

    /// Creates an image of `dims` texels; `bytes(slices)` are the texels of its slices.
    fn fill(
        &self,
        name: &str,
        format: Format,
        dims: [usize; 3],
        progress: &dyn Progress,
        bytes: impl Fn(std::ops::Range<usize>) -> Vec<u8>,
    ) -> Result<Image3d, RenderError> {
        let [width, height, depth] = dims.map(|n| u32::try_from(n).unwrap_or(u32::MAX));
        let image = Image3d::new(&self.device, name, format, [width, height, depth])?;
        let slice_bytes = dims[0] * dims[1] * format.texel_bytes() as usize;
        let slices = (SLAB_BYTES / slice_bytes).clamp(1, dims[2]);
        let staging_bytes = (slices * slice_bytes) as u64;
        let staging = Buffer::host(&self.device, "staging", staging_bytes.next_multiple_of(4), HostUse::Upload)?;
        for first in (0..dims[2]).step_by(slices) {
            if progress.cancelled() {
                return Err(RenderError::Cancelled);
            }
            let end = (first + slices).min(dims[2]);
            staging.write(0, &bytes(first..end))?;
            let range = u32::try_from(first).unwrap_or(u32::MAX)..u32::try_from(end).unwrap_or(u32::MAX);
            self.device.run("upload", |recorder| recorder.upload(&image, range, &staging, 0))?;
            progress.report("uploading the volume", end as u64, dims[2] as u64);
        }
        Ok(image)
    }
}
