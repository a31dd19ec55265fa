//! Rows of a picture that a block marches on from the film that the blocks in front have left.

use std::ops::Range;

use super::rounds::Round;
use super::{DeviceFilm, March};
use crate::{RenderError, Renderer};
use relume_base::number::unsigned;
use relume_scene::film::Film;
use relume_scene::plan::{LANE, ScenePlan, Transmittance};
use relume_vulkan::{Buffer, HostUse, StorageImage};

/// The transmittance of no medium, lane by lane.
fn all_light(plan: &ScenePlan) -> Vec<[f32; LANE]> {
    let is_one = |n: usize| n < plan.transmittance_numbers();
    let lane = |lane: usize| std::array::from_fn(|part| if is_one(lane * LANE + part) { 1.0 } else { 0.0 });
    (0..plan.transmittance_lanes().max(1)).map(lane).collect()
}

impl Renderer {
    /// Rows of a workgroup. Tiles that a march resumes begin at a multiple of it.
    #[must_use]
    pub fn group_rows(&self) -> usize {
        self.dispatching.group[1] as usize
    }

    /// Makes `images`, accumulators and transmittance, the film of no medium.
    pub(super) fn fill_with_light(&self, images: [&StorageImage; 2], plan: &ScenePlan) -> Result<(), RenderError> {
        let [accumulators, transmittance] = images;
        self.device.run("all light", |recorder| {
            recorder.compute_to_transfer();
            recorder.clear(accumulators, [0.0; LANE])?;
            for (layer, value) in (0..).zip(all_light(plan)) {
                recorder.clear_layers(transmittance, layer..layer + 1, value)?;
            }
            recorder.transfer_to_compute();
            Ok(())
        })?;
        Ok(())
    }

    /// Writes `rows` to the images of a march.
    fn write_rows(&self, film: &DeviceFilm, rows: Range<usize>, state: &Film<f32>) -> Result<(), RenderError> {
        let plan = &film.planned.plan;
        let pixels = state.pixels();
        // Texels of lane `lane` of `numbers` planes that begin at `planes`.
        let texels = |planes: &[f32], numbers: usize, lane: usize| -> Vec<[f32; LANE]> {
            let plane = |part: usize| (lane * LANE + part < numbers).then_some((lane * LANE + part) * pixels);
            let parts: [Option<usize>; LANE] = std::array::from_fn(plane);
            (0..pixels).map(|pixel| parts.map(|at| at.map_or(0.0, |at| planes[at + pixel]))).collect()
        };
        let mut layers: Vec<(&StorageImage, u32, Vec<u8>)> = Vec::new();
        let components = plan.components();
        for position in 0..plan.light.accumulators() {
            let planes = &state.accumulators[position * components * pixels..];
            for lane in 0..plan.lanes() {
                let bytes = bytemuck::cast_slice(&texels(planes, components, lane)).to_vec();
                layers.push((&film.accumulators, unsigned(position * plan.lanes() + lane), bytes));
            }
        }
        match plan.transmittance {
            Transmittance::Grey => {
                layers.push((&film.transmittance, 0, bytemuck::cast_slice(&state.transmittance).to_vec()));
            }
            Transmittance::Coloured | Transmittance::Mixed => {
                for lane in 0..plan.transmittance_lanes() {
                    let texels = texels(&state.transmittance, plan.transmittance_numbers(), lane);
                    layers.push((&film.transmittance, unsigned(lane), bytemuck::cast_slice(&texels).to_vec()));
                }
            }
        }
        let rows = unsigned(rows.start)..unsigned(rows.end);
        for (image, layer, bytes) in layers {
            let buffer = Buffer::host(&self.device, "rows", bytes.len() as u64, HostUse::Upload)?;
            buffer.write(0, &bytes)?;
            self.device.run("rows", |recorder| {
                recorder.compute_to_transfer();
                recorder.write_rows(image, layer, rows.clone(), &buffer, 0)?;
                recorder.transfer_to_compute();
                Ok(())
            })?;
        }
        Ok(())
    }
}

impl March {
    /// Begins with `rows` of the picture alone, from `state` if blocks in front have left one. The march must be that of
    /// a block with one ray a pixel, and the rows whole workgroups ([`Renderer::group_rows`]) or the last of the picture.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn begin_rows(
        &mut self,
        renderer: &Renderer,
        rows: Range<usize>,
        state: Option<&Film<f32>>,
    ) -> Result<(), RenderError> {
        if let Some(state) = state {
            self.write_rows(renderer, rows.clone(), state)?;
        }
        if let Some(rounds) = &mut self.rounds {
            rounds.begin_rows(rows.clone(), self.left.size[0])?;
        }
        let rows = unsigned(rows.start)..unsigned(rows.end);
        self.schedule.begin_round(Round { first_row: rows.start, end_row: rows.end, first_sample: 0 });
        Ok(())
    }

    /// Replaces `rows` of the film.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn write_rows(&mut self, renderer: &Renderer, rows: Range<usize>, film: &Film<f32>) -> Result<(), RenderError> {
        renderer.write_rows(&self.left, rows, film)
    }

    /// Copies `rows` of the film as they are now to the host.
    ///
    /// # Errors
    ///
    /// [`RenderError::Vulkan`].
    pub fn read_rows(&self, renderer: &Renderer, rows: Range<usize>) -> Result<Film<f32>, RenderError> {
        renderer.read_rows(&self.left, rows)
    }
}
