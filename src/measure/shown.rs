//! The device's picture, and its colours in sampled pixels.

use glam::DVec3;

use super::ladder::Ladder;
use relume_base::progress::Progress;
use relume_colour::spectrum::colour::XYZ_FROM_LINEAR_SRGB;
use relume_render::{RenderError, SceneRenderer};

/// Linear RGBA of every pixel, marched and relit on the device.
pub(super) fn picture(
    ladder: &Ladder<'_>,
    on_device: &SceneRenderer,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<Vec<[f32; 4]>, RenderError> {
    let accumulators = on_device.march(size, progress)?;
    let relight = on_device.renderer().relight_linear(&accumulators)?;
    relight.run(&ladder.shown(on_device.scene(), on_device.planned()))?;
    relight.read()
}

/// XYZ of `pixels` of a picture of `size`.
pub(super) fn looked_up(picture: &[[f32; 4]], size: [usize; 2], pixels: &[[usize; 2]]) -> Vec<DVec3> {
    let of_pixel = |[x, y]: &[usize; 2]| {
        let [red, green, blue, _] = picture.get(x + size[0] * y).copied().unwrap_or([f32::NAN; 4]);
        *XYZ_FROM_LINEAR_SRGB * DVec3::new(red.into(), green.into(), blue.into())
    };
    pixels.iter().map(of_pixel).collect()
}
