//! `relume render --turntable`: pictures of a volume that turns once.

use crate::annotate::{self, Overlay};
use crate::document::moves::turntable;
use crate::measure::{Stopwatch, Timing};
use crate::number::count;
use crate::progress::{Progress, unreported};
use crate::render::{BrickCounts, SceneRenderer};
use crate::scene::{Camera, Mix, Scene};

use super::files::{self, DressArgs};
use super::frames::{Form, Frame, Frames, digest};
use super::{CliError, light_grid};

/// Appearance of the pictures.
pub(crate) struct Look<'a> {
    pub(crate) mix: &'a Mix,
    pub(crate) size: [usize; 2],
    pub(crate) dress: &'a DressArgs,
    pub(crate) overlay: Option<Overlay<'a>>,
    /// Camera of each picture.
    pub(crate) cameras: &'a [Camera],
    /// Digest of the scene, the lights and the settings of the command.
    pub(crate) inputs: u64,
}

/// Cameras of a full turn of `scene` in `count` pictures of `size`.
pub(crate) fn cameras(scene: &Scene, [width, height]: [usize; 2], frames: u16) -> Result<Vec<Camera>, CliError> {
    let cameras = turntable(scene, &scene.camera, count(width) / count(height), frames);
    cameras.ok_or_else(|| CliError::Failed("the camera has no line of sight to turn about".into()))
}

/// Pictures that a turntable wrote.
pub(crate) struct Written {
    /// Their number; others were there.
    pub(crate) pictures: usize,
    /// Bricks of all marches, if the volume is in bricks.
    pub(crate) bricks: Option<BrickCounts>,
    /// Level of their shadows in words, and their light grid.
    pub(crate) shadows: String,
    pub(crate) light_grid: serde_json::Value,
    pub(crate) times: [(&'static str, Timing); 3],
}

/// Writes `frames` of a full turn of the scene on the device.
pub(crate) fn write(
    on_device: &mut SceneRenderer,
    look: &Look<'_>,
    frames: &Frames<'_>,
    progress: &dyn Progress,
) -> Result<Written, CliError> {
    let Look { mix, size: [width, height], dress, ref overlay, cameras, inputs } = *look;
    let scene = on_device.scene();
    let (bits, backdrop) = (dress.bits(), dress.backdrop(scene.display.backdrop, scene.background.is_some()));
    let (matrices, tone) = (on_device.matrices(mix), on_device.scene().display.tone);
    let (mut marching, mut relighting) = (Timing::default(), Timing::default());
    let mut bricks = None::<BrickCounts>;
    let (mut shadows, mut grid) = (String::new(), serde_json::Value::Null);
    let whole = Stopwatch::start();
    // Pictures with shadows from different levels do not belong together.
    let of_level = |block: [usize; 3]| digest(inputs, &format!("{block:?}"));
    let inputs = on_device.uploaded().light_block().map_or(inputs, of_level);
    let inputs_of = |index: usize| digest(inputs, &format!("{:?} {:?}", cameras[index], dress.annotate));
    let form = Form { size: [width, height], bits, backdrop };
    let pictures = frames.write(form, ("marching", progress), inputs_of, |index| {
        on_device.camera_mut().clone_from(&cameras[index]);
        let clock = Stopwatch::start();
        let film = on_device.march([width, height], &unreported(progress))?;
        marching += clock.read();
        bricks = bricks.into_iter().chain(film.bricks).reduce(BrickCounts::then);
        (shadows, grid) = (light_grid::told(&film), light_grid::json(&film));
        let clock = Stopwatch::start();
        let relight = on_device.renderer().relight_linear(&film)?;
        relight.run(&matrices)?;
        let linear = relight.read::<f32>()?;
        relighting += clock.read();
        let frame = annotate::Frame::of(&cameras[index], &on_device.scene().frame, [width, height]);
        let frame = dress.annotate.frame(frame);
        let shown = files::dressed(
            (&linear, tone),
            [width, height],
            backdrop,
            overlay.as_ref().map(|overlay| (overlay, &frame)),
        )?;
        Ok(Frame { linear, shown })
    })?;
    let writing = whole.read() - marching - relighting;
    Ok(Written {
        pictures,
        bricks,
        shadows,
        light_grid: grid,
        times: [("march", marching), ("relight", relighting), ("write", writing)],
    })
}
