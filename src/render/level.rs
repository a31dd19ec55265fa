//! Coarse levels of volumes that are marched in bricks: what a device holds whole in their place.

use std::sync::Arc;

use super::RenderError;
use relume_base::progress::Progress;
use relume_scene::{Coarse, Scene};
use relume_volume::{Volume, VolumeError};

/// The finest level of the volume of `scene`, and of its labels, of so many voxels along each axis that it `fits`. Of voxels
/// that stay in a file, the file's coarse level is made first, if it is not.
///
/// # Errors
///
/// [`RenderError::Volume`], [`RenderError::Labels`], [`RenderError::Cancelled`].
pub fn finest_level(
    scene: &Scene,
    fits: impl Fn([usize; 3]) -> bool,
    progress: &dyn Progress,
) -> Result<Coarse, RenderError> {
    let field = scene.fields.first();
    field.volume.prepare_coarse(progress).map_err(RenderError::Volume)?;
    let (at_hand, at_hand_block) = field.at_hand();
    let dims = at_hand.geometry.dims;
    let sides = |side: usize| dims.map(|n| side.min(n.next_power_of_two()));
    let of_blocks = |side: usize| std::array::from_fn(|axis| dims[axis].div_ceil(sides(side)[axis]));
    let first = if field.bricks().is_some() { 1 } else { 2 };
    let mut all = std::iter::successors(Some(first), |side: &usize| side.checked_mul(2));
    // The level of a single voxel always fits.
    let side = all.find(|&side| of_blocks(side) == [1; 3] || fits(of_blocks(side)));
    let further = sides(side.unwrap_or(first));
    progress.report("averaging voxels", 0, 1);
    if progress.cancelled() {
        return Err(RenderError::Cancelled);
    }
    let block = std::array::from_fn(|axis| at_hand_block[axis] * further[axis]);
    let failed = |error: fn(VolumeError) -> RenderError| {
        move |cause| if progress.cancelled() { RenderError::Cancelled } else { error(cause) }
    };
    let made = match field.volume.coarse_in_file().filter(|_| further == [1; 3]) {
        Some(coarse) => Arc::clone(coarse),
        None => Arc::new(at_hand.coarse_level(further, progress).map_err(failed(RenderError::Volume))?),
    };
    // The scene may state another grid than the file.
    let geometry = made.grid_over(&field.volume, block).map_err(RenderError::Volume)?;
    let volume = if made.geometry == geometry { made } else { Arc::new(Volume { geometry, ..(*made).clone() }) };
    let labels = scene.labels.as_ref().map(|labels| labels.volume.coarse_level_of_labels(block, progress)).transpose();
    let labels = labels.map_err(failed(RenderError::Labels))?.map(Arc::new);
    progress.report("averaging voxels", 1, 1);
    Ok(Coarse::new(volume, labels, block))
}
