//! Copies of films and of single pixels on the host.

use std::ops::Range;

use bytemuck::Pod;
use half::f16;

use super::DeviceFilm;
use crate::{RenderError, Renderer};
use relume_base::number::unsigned;
use relume_scene::film::Film;
use relume_scene::plan::{LANE, Transmittance};
use relume_vulkan::{Buffer, Device, Format, HostUse, StorageImage};

impl Renderer {
    /// Copies a film to the host.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn read(&self, film: &DeviceFilm) -> Result<Film<f32>, RenderError> {
        self.read_rows(film, 0..film.size[1])
    }

    /// Copies some rows of a film to the host, as a film of these rows.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn read_rows(&self, film: &DeviceFilm, rows: Range<usize>) -> Result<Film<f32>, RenderError> {
        let plan = &film.planned.plan;
        let (size, components) = ([film.size[0], rows.len()], plan.components());
        let rows = unsigned(rows.start)..unsigned(rows.end);
        let mut accumulators = Vec::with_capacity(components * plan.light.accumulators() * size[0] * size[1]);
        for position in 0..plan.light.accumulators() {
            let first = position * plan.lanes();
            accumulators.extend(self.read_numbers(&film.accumulators, first, components, rows.clone())?);
        }
        let transmittance = match plan.transmittance {
            Transmittance::Grey => read_layer_rows(&self.device, &film.transmittance, 0, rows)?,
            Transmittance::Coloured | Transmittance::Mixed => {
                self.read_numbers(&film.transmittance, 0, plan.transmittance_numbers(), rows)?
            }
        };
        Ok(Film { size, components, accumulators, transmittance })
    }

    /// Copies pixel `[x, y]` (y down) of a film to the host, as a film of one pixel.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn read_pixel(&self, film: &DeviceFilm, pixel: [usize; 2]) -> Result<Film<f32>, RenderError> {
        let plan = &film.planned.plan;
        let images = [(&film.accumulators, plan.layers()), (&film.transmittance, plan.transmittance_lanes())];
        let texels =
            || images.iter().flat_map(|&(image, layers)| (0..unsigned(layers)).map(move |layer| (image, layer)));
        let bytes: u64 = texels().map(|(image, _)| u64::from(image.format().texel_bytes())).sum();
        let buffer = Buffer::host(&self.device, "a pixel", bytes, HostUse::ReadBack)?;
        self.device.run("a pixel", |recorder| {
            recorder.compute_to_transfer();
            let mut offset = 0;
            for (image, layer) in texels() {
                recorder.read_back_texel(image, layer, pixel.map(unsigned), &buffer, offset)?;
                offset += u64::from(image.format().texel_bytes());
            }
            recorder.transfer_to_host();
            Ok(())
        })?;
        let mut read = vec![0; usize::try_from(bytes).unwrap_or(usize::MAX)];
        buffer.read(0, &mut read)?;
        let accumulators = texels_of(&film.accumulators, plan.layers());
        let (accumulators, rest) = read.split_at(accumulators);
        let numbers = |image: &StorageImage, bytes: &[u8]| -> Vec<f32> {
            match image.format() {
                Format::Rgba16Float => bytemuck::pod_collect_to_vec::<u8, u16>(bytes)
                    .into_iter()
                    .map(|bits| f16::from_bits(bits).to_f32())
                    .collect(),
                _ => bytemuck::pod_collect_to_vec(bytes),
            }
        };
        let (components, lanes) = (plan.components(), plan.lanes().max(1) * LANE);
        let accumulators = numbers(&film.accumulators, accumulators);
        let accumulators =
            accumulators.chunks_exact(lanes).flat_map(|position| &position[..components]).copied().collect();
        let mut transmittance = numbers(&film.transmittance, rest);
        transmittance.truncate(plan.transmittance_numbers());
        Ok(Film { size: [1, 1], components, accumulators, transmittance })
    }

    /// Reads `count` numbers of every pixel in `rows`, plane by plane, starting at the layer `first`.
    fn read_numbers(
        &self,
        image: &StorageImage,
        first: usize,
        count: usize,
        rows: Range<u32>,
    ) -> Result<Vec<f32>, RenderError> {
        let mut numbers = Vec::new();
        for lane in 0..count.div_ceil(LANE) {
            let texels: Vec<[f32; LANE]> = match image.format() {
                Format::Rgba16Float => {
                    let halves: Vec<[u16; LANE]> =
                        read_layer_rows(&self.device, image, unsigned(first + lane), rows.clone())?;
                    halves.into_iter().map(|texel| texel.map(|bits| f16::from_bits(bits).to_f32())).collect()
                }
                _ => read_layer_rows(&self.device, image, unsigned(first + lane), rows.clone())?,
            };
            for part in 0..LANE.min(count - lane * LANE) {
                numbers.extend(texels.iter().map(|texel| texel[part]));
            }
        }
        Ok(numbers)
    }
}

/// Bytes of a pixel in `layers` layers of `image`.
fn texels_of(image: &StorageImage, layers: usize) -> usize {
    layers * image.format().texel_bytes() as usize
}

/// Reads the texels of a layer, rows from the top.
pub(crate) fn read_layer<T: Pod>(device: &Device, image: &StorageImage, layer: u32) -> Result<Vec<T>, RenderError> {
    read_layer_rows(device, image, layer, 0..image.extent()[1])
}

/// Reads the texels of some rows of a layer.
fn read_layer_rows<T: Pod>(
    device: &Device,
    image: &StorageImage,
    layer: u32,
    rows: Range<u32>,
) -> Result<Vec<T>, RenderError> {
    let bytes = image.layer_bytes() / u64::from(image.extent()[1]) * u64::from(rows.end - rows.start);
    let buffer = Buffer::host(device, "read-back", bytes, HostUse::ReadBack)?;
    device.run("read-back", |recorder| {
        recorder.compute_to_transfer();
        recorder.read_back_rows(image, layer, rows, &buffer, 0)?;
        recorder.transfer_to_host();
        Ok(())
    })?;
    let texels = usize::try_from(bytes).unwrap_or(usize::MAX) / size_of::<T>();
    let mut read = vec![T::zeroed(); texels];
    buffer.read(0, bytemuck::cast_slice_mut(&mut read))?;
    Ok(read)
}
