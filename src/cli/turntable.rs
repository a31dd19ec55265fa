//! `relume render --turntable`: pictures of a volume that turns once.

use relume::document::moves::turntable;
use relume::internal::annotate::{self, Overlay};
use relume::internal::number::count;
use relume::measure::{Stopwatch, Timing};
use relume::progress::{Progress, unreported};
use relume::render::SceneRenderer;
use relume::scene::{Camera, Mix, Scene};

use super::CliError;
use super::files::{self, Backdrop, Bits};
use super::frames::{Form, Frame, Frames, digest};

/// Appearance of the pictures.
pub(crate) struct Look<'a> {
    pub(crate) mix: &'a Mix,
    pub(crate) size: [usize; 2],
    pub(crate) bits: Bits,
    pub(crate) backdrop: Option<Backdrop>,
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
    pub(crate) times: [(&'static str, Timing); 3],
}

/// Writes `frames` of a full turn of the scene on the device.
pub(crate) fn write(
    on_device: &mut SceneRenderer,
    look: &Look<'_>,
    frames: &Frames<'_>,
    progress: &dyn Progress,
) -> Result<Written, CliError> {
    let Look { mix, size: [width, height], bits, backdrop, ref overlay, cameras, inputs } = *look;
    let matrices = on_device.matrices(mix);
    let (mut marching, mut relighting) = (Timing::default(), Timing::default());
    let whole = Stopwatch::start();
    let inputs_of = |index: usize| digest(inputs, &format!("{:?} {}", cameras[index], overlay.is_some()));
    let form = Form { size: [width, height], bits, backdrop };
    let pictures = frames.write(form, ("marching", progress), inputs_of, |index| {
        on_device.camera_mut().clone_from(&cameras[index]);
        let clock = Stopwatch::start();
        let film = on_device.march([width, height], &unreported(progress))?;
        marching += clock.read();
        let clock = Stopwatch::start();
        let relight = on_device.renderer().relight_linear(&film)?;
        relight.run(&matrices)?;
        let linear = relight.read::<f32>()?;
        relighting += clock.read();
        let frame = annotate::Frame::of(&cameras[index], &on_device.scene().volume, [width, height]);
        let shown =
            files::dressed(&linear, [width, height], backdrop, overlay.as_ref().map(|overlay| (overlay, &frame)))?;
        Ok(Frame { linear, shown })
    })?;
    let writing = whole.read() - marching - relighting;
    Ok(Written { pictures, times: [("march", marching), ("relight", relighting), ("write", writing)] })
}
