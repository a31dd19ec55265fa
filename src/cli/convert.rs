//! `relume convert`: a volume of any format as NRRD, `MetaImage` or `NIfTI`.

use std::path::PathBuf;

use serde_json::json;

use crate::output::{OutputError, VolumeKind, write_volume};
use crate::progress::Progress;
use crate::volume;

use super::files::check_outputs;
use super::scene::{RawArgs, SelectionArgs, three};
use super::{CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume convert head.nii.gz head.nrrd
  relume convert map.mrc map.nii.gz --downsample 2x2x2
  relume convert beat.nrrd --time 3 beat-3.mha";

/// Arguments of `relume convert`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Volume in any format of docs/FORMATS.md.
    input: PathBuf,
    /// File to write: .nrrd (gzip), .mha, .nii or .nii.gz.
    output: PathBuf,
    /// Average blocks of A×B×C voxels after loading; a block of labels keeps its most frequent label.
    #[arg(long, value_name = "AxBxC", value_parser = three)]
    downsample: Option<[usize; 3]>,
    #[command(flatten)]
    selection: SelectionArgs,
    #[command(flatten)]
    raw: RawArgs,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    VolumeKind::of(&args.output).map_err(|error| CliError::Usage(error.to_string()))?;
    check_outputs(&[&args.output], &[&args.input])?;
    let selection = args.selection.selection();
    let volume = volume::open_by(&args.input, args.raw.layout().as_ref(), &selection, progress)?;
    let mut volume = args.raw.spaced(volume)?;
    // Data files of a header are inputs, too.
    check_outputs(&[&args.output], &volume.files.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    if let Some(blocks) = args.downsample {
        volume = volume.downsample(blocks)?;
    }
    for note in &volume.notes {
        tracing::warn!("{note}");
    }
    let written = write_volume(&args.output, &volume, progress).map_err(|error| match error {
        OutputError::Cancelled { .. } => CliError::Cancelled,
        error => error.into(),
    })?;
    for note in &written.notes {
        tracing::warn!("{}: {note}", args.output.display());
    }
    let [x, y, z] = volume.geometry.dims;
    let (path, type_name) = (args.output.display().to_string(), written.voxel_type.name());
    let json = json!({"source": volume.source, "output": path, "dims": [x, y, z], "type": type_name});
    Ok(Report { text: format!("{path}: {x}×{y}×{z} voxels of {type_name}\n"), json })
}
