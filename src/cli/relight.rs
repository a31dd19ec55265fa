//! `relume relight`: saved accumulators under other lights.

use std::path::PathBuf;
use std::sync::Arc;

use serde_json::json;

use relume::measure::Stopwatch;
use relume::reference;
use relume::tables::{Components, RelightMatrices};

use super::accuracy::tolerance;
use super::files::{self, Bits};
use super::scene::LightArgs;
use super::{CliError, Report, model};

const EXAMPLES: &str = "\
Examples:
  relume render scene.toml -o day.png --accumulators acc.exr
  relume relight acc.exr --light A -o evening.png
  relume relight acc.exr --light FL11=0.7 --light \"blackbody 3000=0.3\" -o office.exr";

/// `relume relight`
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// What `relume render --accumulators` saved.
    accumulators: PathBuf,
    #[command(flatten)]
    lights: LightArgs,
    /// Warn where colours under a light that the file does not have may be off by more than this ΔE00, in place of what
    /// the file says.
    #[arg(long, value_name = "DE", value_parser = tolerance)]
    tolerance: Option<f64>,
    /// Picture to write (repeatable): .png is sRGB for the screen, .exr linear float RGB with opacity.
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Bits per channel of a PNG.
    #[arg(long, value_enum, default_value = "8")]
    bits: Bits,
}

pub(crate) fn run(args: &Args) -> Result<Report, CliError> {
    for path in &args.output {
        files::picture_kind(path)?;
    }
    let outputs: Vec<&PathBuf> = args.output.iter().collect();
    let lights = args.lights.files();
    let inputs = lights.iter().chain([&args.accumulators]).map(PathBuf::as_path);
    files::check_outputs(&outputs, &inputs.collect::<Vec<_>>())?;
    let clock = Stopwatch::start();
    let mut saved = files::from_file(&args.accumulators)?;
    let read = clock.read();
    let mix = args.lights.mix(saved.mix, &saved.positions)?;

    let clock = Stopwatch::start();
    let mut text = String::new();
    let mut model_json = json!(null);
    if let (Components::Surfaces(_), Some(_)) = (&saved.components, args.tolerance) {
        let file = args.accumulators.display();
        return Err(CliError::Usage(format!(
            "--tolerance does nothing here: {file} keeps weights of materials, which are exact for every light"
        )));
    }
    if let Components::Model(model, _) = &mut saved.components {
        let model = Arc::make_mut(model);
        let tolerance = args.tolerance.unwrap_or(saved.tolerance);
        let learnt = model::learn(model, &mix, || None, tolerance, "render again with this --light and --replan")?;
        (text, model_json) = (learnt.text(model), learnt.json(model));
    }
    let positions = saved.positions.len();
    let matrices = RelightMatrices::new(&saved.components, positions, saved.background.as_ref(), &mix, &saved.display);
    let colours = reference::relight(&saved.accumulation, &matrices);
    let opacity = reference::opacity(&saved.accumulation, &matrices);
    let rgba = files::rgba(colours.into_iter().zip(opacity));
    let relit = clock.read();

    let clock = Stopwatch::start();
    for path in &args.output {
        files::write_linear(path, saved.accumulation.size, &rgba, args.bits)?;
    }
    let written = clock.read();
    let listed: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    let lights: Vec<_> = mix
        .0
        .iter()
        .map(|light| json!({"name": light.name, "position": saved.positions[light.position], "weight": light.weight}))
        .collect();
    Ok(Report {
        text: format!("wrote {}\n{text}relight {:.0} ms\n", listed.join(", "), relit.wall_ms),
        json: json!({
            "outputs": listed,
            "size": saved.accumulation.size,
            "lights": lights,
            "model": model_json,
            "times": {"load": read, "relight": relit, "write": written},
        }),
    })
}
