//! `relume bench`: times of marching, relighting and reading.

mod against;
mod cases;
mod costs;
mod first;
mod frames;
mod load;

use std::path::PathBuf;
use std::time::Instant;

use clap::ValueEnum;
use serde_json::json;

use crate::model::ModelKind;
use crate::output::write_atomically;
use crate::progress::Progress;
use crate::render::Renderer;
use crate::vulkan::{Device, DeviceChoice, Validation};

use against::{Against, Earlier};
use cases::{Case, Keeping, Subject};
use frames::{Bench, Row};

use super::accuracy::AccuracyArgs;
use super::model::Learnt;
use super::scene::{DefineArgs, SelectionArgs, size};
use super::{CliError, Report, figures, files};

const EXAMPLES: &str = "\
Examples:
  relume bench                                        both workloads, shaded and not
  relume bench peer --volume frog.mhd --shading diffuse --frames 9 --json
  relume bench load --volume ct.nrrd                  reading a volume, compared with decoding its bytes
  relume bench first --volume ct.nrrd                 the first picture of a volume without a scene, by stages
  relume bench all -o costs.html --json > costs.json  every scene and size, the paper's table, cost against k, lights, …
  relume bench all --against costs.json               the same again; exits with 1 if any cost has grown

Times are medians over the frames: CPU time of all threads, and wall time; --json has {median, min, max} of each.
startup_ms is the time from the start of the program to its first picture. Only the first row has it (n = 1); the others
have null, because the device is already open. peak_mb is the peak memory of the process so far, earlier rows included.
Ctrl-C keeps the finished rows.";

/// Arguments of `relume bench`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// The workload to measure.
    #[arg(value_enum, default_values_t = [Workload::Peer, Workload::Default])]
    workloads: Vec<Workload>,
    /// Volume for the workloads `peer…` (the real frog, instead of its phantom), `load` and `first`.
    #[arg(long, value_name = "FILE")]
    volume: Option<PathBuf>,
    #[command(flatten)]
    selection: SelectionArgs,
    #[command(flatten)]
    accuracy: AccuracyArgs,
    /// Pixels across and down; by default 800x800, and for scenes, paper and scaling 400x400, 800x800 and 1920x1080.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[usize; 2]>,
    /// The largest volume of `scaling`, in voxels along a side: 64, 128, 256 or 512.
    /// [default: 512]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(64..))]
    largest: Option<u32>,
    /// Frames to measure, after two for warming up; number of runs of `load` and `first`.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    #[command(flatten)]
    define: DefineArgs,
    /// Measure only with this shading.
    #[arg(long, value_enum)]
    shading: Option<BenchShading>,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
    /// Compare with earlier output of `--json` on this device, and exit with 1 if a march or a relight takes longer, or
    /// anything takes more bytes. Times are medians: CPU time on software devices, wall time on others.
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Tolerated increase of costs in per cent; times may also differ by half a millisecond.
    #[arg(long, value_name = "P", default_value_t = 20.0, requires = "against", value_parser = percent)]
    budget_percent: f64,
    /// Report to write: a page (.html) with the paper's table, the curves and all rows.
    #[arg(short, long, value_name = "FILE.html")]
    output: Option<PathBuf>,
}

/// Parses a percentage from 0.
fn percent(text: &str) -> Result<f64, String> {
    let percent: Option<f64> = text.parse().ok().filter(|percent: &f64| percent.is_finite() && *percent >= 0.0);
    percent.ok_or_else(|| format!("{text:?} is not a percentage of at least 0"))
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Workload {
    /// The benchmark scene for comparisons with other renderers; its camera turns by 8° per frame.
    Peer,
    /// peer under four directional lights in four positions.
    PeerFourLights,
    /// peer with twice the number of materials: eight weights per pixel.
    PeerEightMaterials,
    /// peer in linear RGB, as in a renderer without spectra.
    PeerRgb,
    /// peer with a colour model of dimension 8.
    PeerK8,
    /// peer with dyed materials, in linear RGB.
    PeerColouredRgb,
    /// peer with dyed materials and a colour model of dimension 8.
    PeerColouredK8,
    /// The embedded default scene.
    Default,
    /// scenes, paper and scaling: all frame times, at each size.
    All,
    /// Every embedded scene, including the figures.
    Scenes,
    /// The paper's table: RGB, spectra and relighting, with the paper's ratios for comparison.
    Paper,
    /// Cost against k, light positions, pixels and voxels, grey and coloured.
    Scaling,
    /// Reading a volume, compared with only decoding its bytes: no device.
    Load,
    /// The first picture of the volume of --volume without a scene, by stages.
    First,
}

impl Workload {
    fn makes_frames(self) -> bool {
        !matches!(self, Self::Load | Self::First)
    }

    /// Name on the command line.
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
    }

    /// Whether the workload uses the volume of --volume.
    fn takes_volume(&self) -> bool {
        !matches!(self, Self::Default | Self::Scenes)
    }

    /// Whether the workload determines what pixels store, or makes no pictures.
    fn is_fixed(&self) -> bool {
        let fixed = matches!(self, Self::PeerRgb | Self::PeerK8 | Self::PeerColouredRgb | Self::PeerColouredK8);
        let whole = matches!(self, Self::All | Self::Paper | Self::Scaling);
        fixed || whole || !self.makes_frames()
    }

    /// Cases of the workload. peer… and default have an unshaded and a shaded case, or only `shading`; others have
    /// their own.
    fn cases(self, size: Option<[usize; 2]>, largest: u32, shading: Option<BenchShading>) -> Vec<Case> {
        let rgb = Keeping::Model(ModelKind::Rgb, 3);
        let k8 = Keeping::Model(ModelKind::Nodes, 8);
        let small = size.unwrap_or([800, 800]);
        let own = |subject| Case::of(&self.name(), subject, small);
        let peer = |keeping, dyed| Case { keeping, dyed, ..own(Subject::Peer) };
        let case = match self {
            Self::All => {
                let whole = [Self::Scenes, Self::Paper, Self::Scaling];
                return whole.into_iter().flat_map(|whole| whole.cases(size, largest, shading)).collect();
            }
            Self::Scenes | Self::Paper | Self::Scaling => {
                let mut cases = match self {
                    Self::Scenes => cases::scenes(size),
                    Self::Paper => cases::paper(size),
                    _ => cases::scaling(size, largest),
                };
                cases.iter_mut().for_each(|case| case.unshaded = shading == Some(BenchShading::None));
                return cases;
            }
            Self::Load | Self::First => return Vec::new(),
            Self::Peer => peer(Keeping::Stated, false),
            Self::PeerFourLights => Case { positions: Some(4), ..peer(Keeping::Stated, false) },
            Self::PeerEightMaterials => peer(Keeping::EightWeights, false),
            Self::PeerRgb => peer(rgb, false),
            Self::PeerK8 => peer(k8, false),
            Self::PeerColouredRgb => peer(rgb, true),
            Self::PeerColouredK8 => peer(k8, true),
            Self::Default => own(Subject::Default),
        };
        let shadings = [BenchShading::None, BenchShading::Diffuse].into_iter();
        let chosen = shadings.filter(|&one| shading.is_none_or(|only| only == one));
        chosen.map(|one| Case { unshaded: one == BenchShading::None, ..case.clone() }).collect()
    }
}

impl Args {
    /// Whether any workload makes frames; its rows are kept after a cancellation.
    pub(crate) fn makes_frames(&self) -> bool {
        self.workloads.iter().any(|workload| workload.makes_frames())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum BenchShading {
    None,
    Diffuse,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress, started: Instant) -> Result<Report, CliError> {
    if let (true, Some(flag)) = (args.workloads.iter().all(Workload::is_fixed), args.accuracy.given().first()) {
        return Err(CliError::Usage(format!(
            "{flag} has no effect: these workloads fix what pixels store, or have no pixels"
        )));
    }
    for flag in args.accuracy.given() {
        let fixed = args.workloads.iter().filter(|workload| workload.is_fixed()).map(|workload| workload.name());
        let fixed: Vec<String> = fixed.collect();
        if !fixed.is_empty() {
            tracing::warn!(
                "{flag} has no effect on {}: they fix what pixels store, or have no pixels",
                fixed.join(", ")
            );
        }
    }
    if !args.define.is_empty() && args.workloads.iter().all(|workload| !workload.makes_frames()) {
        return Err(CliError::Usage("-D has no effect: these workloads have no scene".to_owned()));
    }
    let mut of_volumes = std::iter::once(("--volume", args.volume.is_some())).chain(args.selection.choices());
    if let Some((flag, _)) = of_volumes.find(|(_, given)| *given)
        && !args.workloads.iter().any(Workload::takes_volume)
    {
        return Err(CliError::Usage(format!("{flag} has no effect: these workloads have volumes of their own")));
    }
    if let Some((flag, _)) = args.selection.choices().into_iter().find(|(_, given)| *given)
        && args.volume.is_none()
    {
        return Err(CliError::Usage(format!(
            "{flag} has no effect: it chooses in the volume of --volume, and none is given"
        )));
    }
    let scales = |workload: &Workload| matches!(workload, Workload::Scaling | Workload::All);
    if args.largest.is_some() && !args.workloads.iter().any(scales) {
        return Err(CliError::Usage(
            "--largest has no effect: only scaling and all vary the size of the volume".to_owned(),
        ));
    }
    let framed = args.makes_frames();
    let flags = [
        ("--shading", args.shading.is_some()),
        ("--device", args.device != DeviceChoice::Auto && !args.workloads.contains(&Workload::First)),
        ("--size", args.size.is_some() && !args.workloads.contains(&Workload::First)),
        ("--against", args.against.is_some()),
        ("--output", args.output.is_some()),
    ];
    for (flag, given) in flags {
        if given && !framed {
            return Err(CliError::Usage(format!("{flag} has no effect: these workloads make no frames")));
        }
    }
    if let Some(output) = &args.output {
        if !output.extension().is_some_and(|extension| extension == "html" || extension == "htm") {
            return Err(CliError::Usage(format!("{}: the report is HTML; end its name in .html", output.display())));
        }
        let inputs: Vec<_> = args.volume.iter().chain(&args.against).map(PathBuf::as_path).collect();
        files::check_outputs(&[output], &inputs)?;
    }
    if args.workloads.contains(&Workload::First) && args.volume.is_none() {
        return Err(CliError::Usage("first needs --volume FILE: a volume without a scene".to_owned()));
    }
    let mut reports = Vec::new();
    if framed {
        reports.push(run_frames(args, progress, started)?);
    }
    let whole = reports.iter().all(|report: &Report| report.json["interrupted"] != true);
    if whole && args.workloads.contains(&Workload::Load) {
        reports.push(load::run(args.volume.as_deref(), &args.selection.selection(), args.frames, progress)?);
    }
    if whole && args.workloads.contains(&Workload::First) {
        let picture = (args.size.unwrap_or([800, 800]), &args.device);
        if let Some(volume) = &args.volume {
            reports.push(first::run(volume, &args.selection.selection(), picture, args.frames, progress, started)?);
        }
    }
    let mut all = Report { text: String::new(), json: json!({}) };
    for report in reports {
        all.text.push_str(&report.text);
        if let (Some(all), serde_json::Value::Object(part)) = (all.json.as_object_mut(), report.json) {
            all.extend(part);
        }
    }
    Ok(all)
}

/// Measures the workloads that make frames.
fn run_frames(args: &Args, progress: &dyn Progress, started: Instant) -> Result<Report, CliError> {
    let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
    let info = renderer.device().info();
    // Rejects an incomparable file before measuring.
    let device = format!("{} ({})", info.name, info.driver);
    let earlier = args.against.as_deref().map(|path| Earlier::read(path, &device)).transpose()?;
    let cases =
        args.workloads.iter().flat_map(|workload| workload.cases(args.size, args.largest.unwrap_or(512), args.shading));
    let cases: Vec<Case> = cases.collect();
    let mut bench = Bench::new(args, &renderer, progress, cases.len());
    let (mut rows, mut interrupted): (Vec<Row>, bool) = (Vec::new(), false);
    let mut started = Some(started);
    for together in cases.chunk_by(Case::is_beside) {
        match bench.measure(together, started.take(), &mut rows) {
            Ok(()) => {}
            // Finished rows are kept.
            Err(_) if progress.cancelled() && !rows.is_empty() => {
                interrupted = true;
                break;
            }
            Err(error) => return Err(error),
        }
    }
    let found = costs::Costs::of(&rows, info, interrupted);
    if let Some(output) = &args.output {
        write_atomically(output, |sink| sink.write_all(found.html().as_bytes()))?;
    }
    let mut json = json!({
        "relume": env!("CARGO_PKG_VERSION"),
        "device": super::info::device_json(info),
        "rows": rows,
        "ratios": found.ratios(),
        "interrupted": interrupted,
    });
    let mut text = found.text();
    if let Some(earlier) = &earlier {
        let against = Against::new(earlier, &rows, args.budget_percent)?;
        text.push_str(&against.text());
        json["holds"] = against.holds().into();
        json["against"] = json!(against);
    }
    Ok(Report { text, json })
}
