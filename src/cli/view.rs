//! `relume view`: a scene in a window.

use std::path::PathBuf;

use crate::vulkan::DeviceChoice;

use super::render::memory_size;
use super::scene::{LookArgs, SceneArgs};
use super::{CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume view                                 the built-in scene
  relume view scene.toml
  relume view head.mhd                        a volume, with materials and lights made from its values
  relume view scan.bricks --memory 2GiB       a volume that exceeds the memory: coarse at once, refined at rest
  relume view --frames 100 --json             draws 100 frames and prints their times";

/// Arguments of `relume view`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    look: LookArgs,
    /// Width and height of the window in pixels.
    #[arg(long, value_name = "WxH", value_parser = super::scene::size)]
    size: Option<[usize; 2]>,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them. auto prefers a GPU to the CPU.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
    /// Memory of the device for a volume, such as 512MiB or 2GiB. Of a larger one, a coarse level is shown, and at rest the
    /// bricks that the picture needs (docs/SCALE.md). Default: all of it, and half of it for bricks.
    #[arg(long, value_name = "SIZE", value_parser = memory_size)]
    device_memory: Option<u64>,
    /// Memory of the host for the voxels. If those of a file of bricks (`relume bricks`) take more, they stay in the file
    /// (docs/SCALE.md); files of other formats are refused then. Default: half of the available memory.
    #[arg(long, value_name = "SIZE", value_parser = memory_size)]
    memory: Option<u64>,
    /// Draw this number of frames and end.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    frames: Option<u32>,
    /// Run the commands of this file, one per line, and end (commands: docs/VIEW.md).
    #[arg(long, value_name = "FILE", conflicts_with = "frames")]
    script: Option<PathBuf>,
    /// Enable the Vulkan validation layer. --json prints its messages.
    #[arg(long, hide = true)]
    validation: bool,
}

/// Opens the window, and returns when it is closed.
#[cfg(feature = "window")]
pub(crate) fn run(args: &Args) -> Result<Report, CliError> {
    use crate::view::{self, Options, Script};
    use crate::vulkan::Validation;

    let script = args.script.as_deref().map(Script::read).transpose()?;
    let source = args.scene.source(&args.look.wanted())?;
    let report = view::run(Options {
        source,
        size: args.size.map(|size| size.map(|side| u32::try_from(side).unwrap_or(u32::MAX))),
        device: args.device.clone(),
        memory: args.memory,
        device_memory: args.device_memory,
        validation: if args.validation { Validation::On } else { Validation::Off },
        frames: args.frames,
        script,
        display_gone: Some(super::terminal::end_without_display),
        cache: crate::measure::cache_folder(),
    })?;
    let [median, _, longest] = report.frame_ms;
    let mut text = format!(
        "{} frames, {} marches, {} relights; a frame took {median:.1} ms, the longest {longest:.0} ms\n",
        report.frames, report.counts.marches, report.counts.relights
    );
    if report.relit_ms[0] > 0.0 {
        text.push_str(&format!("frames in which only the light changed took {:.1} ms\n", report.relit_ms[0]));
    }
    let mut json = serde_json::to_value(&report).map_err(|error| CliError::Failed(error.to_string()))?;
    if args.script.is_some() || args.frames.is_some() {
        // Reports failures here, because no user has seen them in the window.
        report.failures.iter().for_each(|failure| tracing::error!("{failure}"));
        json["holds"] = report.failures.is_empty().into();
    }
    Ok(Report { text, json })
}

/// Fails, because this build has no window.
#[cfg(not(feature = "window"))]
pub(crate) fn run(args: &Args) -> Result<Report, CliError> {
    let Args { scene, look, size, device, memory, device_memory, frames, script, validation } = args;
    let asked = (scene, look, size, device, [memory, device_memory], frames, script, validation);
    tracing::debug!("asked for {asked:?}");
    Err(CliError::Failed(
        "this build of Relume has no window (the feature `window` is off); use `relume render` for pictures".to_owned(),
    ))
}
