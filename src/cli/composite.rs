//! `relume composite`: the film of parts that `relume render --block` saved.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::measure::Stopwatch;
use crate::memory;
use crate::output::OutputError;
use crate::output::PictureKind;
use crate::output::film::composite;
use crate::progress::Progress;

use super::files::check_outputs;
use super::{CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume render scene.toml --block 1/2 --accumulators part-1.exr
  relume render scene.toml --block 2/2 --accumulators part-2.exr
  relume composite part-*.exr -o film.exr             (then: relume relight film.exr …)";

/// Arguments of `relume composite`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Parts of one film, in any order: all blocks of the volume.
    #[arg(required = true, value_name = "PART.exr")]
    parts: Vec<PathBuf>,
    /// Composite to a larger part: all blocks below one cut of the volume, such as 1 to 4 of 8.
    #[arg(long)]
    partial: bool,
    /// Film file to write.
    #[arg(short, long, value_name = "FILE.exr")]
    output: PathBuf,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    PictureKind::require_exr(&args.output).map_err(|error| CliError::Usage(format!("-o {error}")))?;
    check_outputs(&[&args.output], &args.parts.iter().map(PathBuf::as_path).collect::<Vec<&Path>>())?;
    let clock = Stopwatch::start();
    let composited =
        composite(&args.parts, args.partial, memory::available_bytes(), progress).map_err(|error| match error {
            OutputError::Cancelled { .. } => CliError::Cancelled,
            error => error.into(),
        })?;
    let spent = clock.read();
    let clock = Stopwatch::start();
    composited.film.write(&args.output)?;
    let written = clock.read();
    let [first, last, blocks] = composited.blocks;
    let part = composited.film.part.as_ref();
    let path = args.output.display().to_string();
    if let Some(part) = part {
        tracing::warn!("{path} is a part: {}; composite it with the others for the whole film", part.named());
    }
    let (width, height) = (composited.film.width, composited.film.height);
    Ok(Report {
        text: format!("wrote {path}: blocks {first} to {last} of {blocks}\ncomposite {:.0} ms\n", spent.wall_ms),
        json: json!({
            "outputs": [path],
            "size": [width, height],
            "blocks": {"first": first, "last": last, "count": blocks},
            "whole": part.is_none(),
            "times": {"composite": spent, "write": written},
        }),
    })
}
