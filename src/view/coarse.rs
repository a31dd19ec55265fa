//! The coarse level that stands for a volume in bricks: in the first picture, and while a hand moves.

use std::sync::Arc;

use crate::progress::Progress;
use crate::render::{Level, RenderError, Renderer};
use crate::scene::{Aim, Labels, Scene};
use crate::volume::{Volume, coarse_index};

/// A coarse level of the volume of a scene, which the device holds whole.
#[derive(Clone, Debug)]
pub struct Coarse {
    volume: Arc<Volume>,
    labels: Option<Arc<Volume>>,
    /// Voxels of the volume whose mean is one of the level, along each axis.
    block: [usize; 3],
}

impl Coarse {
    /// The finest level of the volume of `scene`, and of its labels, for which `renderer` has room beside bricks. Of voxels
    /// that stay in a file, the file's coarse level is made first, if it is not.
    ///
    /// # Errors
    ///
    /// [`RenderError::Volume`], [`RenderError::Cancelled`].
    pub fn of(renderer: &Renderer, scene: &Scene, progress: &dyn Progress) -> Result<Self, RenderError> {
        let Level { volume, labels, block } =
            Level::finest(scene, |dims| renderer.has_room_for_coarse(dims), progress)?;
        Ok(Self { volume, labels, block })
    }

    /// `scene` with this level in place of its volume: the same picture but for the voxels.
    #[must_use]
    pub fn scene(&self, scene: &Scene) -> Scene {
        let mut coarse = scene.clone();
        coarse.volume = Arc::clone(&self.volume);
        coarse.labels = scene
            .labels
            .as_ref()
            .zip(self.labels.as_ref())
            .map(|(labels, volume)| Labels { volume: Arc::clone(volume), declared: labels.declared.clone() });
        coarse.crop = scene.crop.map(|corners| corners.map(|index| coarse_index(index, self.block)));
        // Steps as long in voxels.
        let longer = self.volume.geometry.spacing.min_element() / scene.volume.geometry.spacing.min_element();
        coarse.accuracy.step_length *= longer;
        // A camera that fits the whole volume fits the box of the finest voxels, which incomplete blocks exceed.
        if let Aim::Orbit { around: around @ None, .. } = &mut coarse.camera.aim {
            *around = scene.volume.geometry.world_box();
        }
        coarse
    }

    /// Voxels of the volume whose mean is one of the level, along each axis.
    #[must_use]
    pub fn block(&self) -> [usize; 3] {
        self.block
    }

    /// Number of the level; 0 are the voxels themselves.
    #[must_use]
    pub fn level(&self) -> u32 {
        self.block.iter().max().map_or(0, |side| side.ilog2())
    }
}
