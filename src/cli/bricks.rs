//! `relume bricks`: a file of bricks of a volume that exceeds the memory.

use std::path::PathBuf;

use serde_json::json;

use crate::measure::{Stopwatch, peak_mb};
use crate::memory;
use crate::output::{OutputError, write_bricks};
use crate::progress::Progress;

use super::files::check_outputs;
use super::render::memory_size;
use super::scene::{RawArgs, SelectionArgs};
use super::{CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume bricks scan.nrrd -o scan.bricks
  relume bricks brain.zarr --component 1 --pyramid-level 0 -o brain.bricks
  relume bricks scan.raw --dims 2048x2048x1536 --type uint8 -o scan.bricks --memory 768MiB
  relume render scene.toml --volume scan.bricks -o scan.png --memory 768MiB";

/// Arguments of `relume bricks`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Volume that is read slice by slice: .nrrd, .nhdr, .mhd, .mha, .nii, .mgz, .mrc, .npy, .tif, .h5, .nc, .mnc, .ims, .dcm, a Zarr
    /// store, a folder of DICOM files or of slices, raw voxels with a sidecar or with --dims and --type.
    input: PathBuf,
    /// File to write, which `render` reads in place of the volume.
    #[arg(short, long, value_name = "FILE.bricks")]
    output: PathBuf,
    /// Memory, such as 512MiB or 2GiB, for the slices that are read at once, and for 64 slices of each level of resolution: a
    /// third more than 64 slices of the volume. If these take more, some wait in temporary files beside the output. Default:
    /// half of the available memory.
    #[arg(long, value_name = "SIZE", value_parser = memory_size)]
    memory: Option<u64>,
    #[command(flatten)]
    selection: SelectionArgs,
    #[command(flatten)]
    raw: RawArgs,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    let is_named = args.output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bricks"));
    if !is_named {
        return Err(CliError::Usage(format!("-o {}: the name must end in .bricks", args.output.display())));
    }
    check_outputs(&[&args.output], &[&args.input])?;
    let mut layout = args.raw.layout();
    match (&mut layout, args.raw.spacing()) {
        (Some(layout), Some((_, unit))) => layout.unit = unit,
        (None, Some(_)) => {
            let message = "--spacing has no effect: the bricks keep the spacing of the file; give it to render";
            return Err(CliError::Usage(message.to_owned()));
        }
        _ => {}
    }
    let budget = args.memory.or_else(|| Some(memory::available_bytes()? / 2)).unwrap_or(u64::MAX);
    let clock = Stopwatch::start();
    let source = (&*args.input, layout.as_ref());
    let made = write_bricks(&args.output, source, &args.selection.selection(), budget, progress);
    let made = made.map_err(|error| match error {
        OutputError::Cancelled { .. } => CliError::Cancelled,
        OutputError::Volume(error) => error.into(),
        error => error.into(),
    })?;
    let time = clock.read();
    for note in &made.notes {
        tracing::warn!("{note}");
    }
    let [x, y, z] = made.dims;
    let path = args.output.display().to_string();
    let spilled = if made.spilled { "; 64 slices exceed the memory and waited in a temporary file" } else { "" };
    let coarser = match made.levels.len() - 1 {
        0 => String::new(),
        1 => " and a coarser level".to_owned(),
        levels => format!(" and {levels} coarser levels"),
    };
    Ok(Report {
        text: format!(
            "wrote {path}: {x}×{y}×{z} voxels of {} in {} bricks{coarser}, {} bytes{spilled}\nbricks {:.0} ms\n",
            made.voxel_type, made.bricks, made.bytes, time.wall_ms
        ),
        json: json!({
            "source": args.input.display().to_string(),
            "output": path,
            "dims": made.dims,
            "type": made.voxel_type.name(),
            "bricks": made.bricks,
            "levels": made.levels,
            "bytes": made.bytes,
            "spilled": made.spilled,
            "times": {"bricks": time},
            "peak_mb": peak_mb(),
        }),
    })
}
