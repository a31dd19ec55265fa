//! The coarse level that stands for a volume in bricks: in the first picture, and while a hand moves.

use crate::progress::Progress;
use crate::render::{Level, RenderError, Renderer};
use crate::scene::{Coarse, Scene};

/// The finest level of the volume of `scene`, and of its labels, for which `renderer` has room beside bricks. Of voxels
/// that stay in a file, the file's coarse level is made first, if it is not.
///
/// # Errors
///
/// [`RenderError::Volume`], [`RenderError::Cancelled`].
pub(super) fn coarse(renderer: &Renderer, scene: &Scene, progress: &dyn Progress) -> Result<Coarse, RenderError> {
    let Level { volume, labels, block } = Level::finest(scene, |dims| renderer.has_room_for_coarse(dims), progress)?;
    Ok(Coarse::new(volume, labels, block))
}
