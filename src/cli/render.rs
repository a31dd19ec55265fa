//! `relume render`: marches a scene once and writes pictures, its film and spectra.

mod times;

use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use serde_json::{Map, json};

use crate::annotate::{Frame, Overlay};
use crate::document::{Placed, Requested, SceneFile, Source, State, is_no_scene, session};
use crate::film::{Film, RelightMatrices, Relightable, automatic_exposure};
use crate::measure::{Choice, Enlargement, Stopwatch, Timing, peak_mb};
use crate::number::{brief, count};
use crate::output::{FilmFile, OutputError, Picture, PictureKind, write_atomically, write_ready_png};
use crate::plan::{Planned, plan_full_spectrum};
use crate::progress::{Progress, Quiet};
use crate::render::{BrickCounts, Job, Keeps, PlannedJob, RenderWarning, Renderer, SceneRenderer};
use crate::scene::key::Named as _;
use crate::scene::{Block, Blocks, MOST_BLOCKS, Mix, Scene, positions};
use crate::spectrum::{BANDS, Light};
use crate::tables::Storage;
use crate::volume::{self, CacheCounts, HostMemory};
use crate::vulkan::{Device, DeviceChoice, Validation};

use super::files::{self, Bits, DressArgs, picture_kind};
use super::frames::{AnimationArgs, Frames, digest};
use super::goal::GoalArgs;
use super::level;
use super::model::Learnt;
use super::processes::{self, Asked, Processes, Sharing, sharing};
use super::scene::{LightArgs, LookArgs, SceneArgs, add_placed, size, surfaces_of, time_or_all, told_of_placed};
use super::{CliError, Report, light_grid, turntable, warn_of};

const EXAMPLES: &str = "\
Examples:
  relume render -o frog.png
  relume render scene.toml -o day.png -o day.exr --size 1024x768
  relume render scene.toml -o evening.png --light A --light D65@window=0.2 -D display.exposure=2
  relume render scene.toml -o ct.png --volume ct.raw --dims 512x512x200 --type int16
  relume render scene.toml --accumulators acc.exr        (then: relume relight acc.exr …)";

/// Help of `--time`, which may ask for all time steps here.
const TIME_HELP: &str = "Read this time step, counted from 0. all writes a picture of each: FILE-0001.png and so on, or one \
animated PNG (-o FILE.apng); a volume without a scene then has one look for all of them. With --turntable, the times pass \
once during the turn";

/// Arguments of `relume render`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("time", |arg| arg.value_parser(time_or_all).value_name("N|all").help(TIME_HELP)))]
pub(crate) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// Picture to write (repeatable): .png is sRGB for the screen, .exr linear float RGB with opacity. Default for
    /// a volume without a scene: the name of the volume with .png. If this file exists, Relume adds a number to the
    /// name.
    #[arg(short, long, value_name = "FILE")]
    output: Vec<PathBuf>,
    /// Turn the volume once about the up direction of the camera in N pictures: FILE-0001.png and so on, or one animated
    /// PNG (-o FILE.apng).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..))]
    #[arg(conflicts_with_all = ["accumulators", "spectral", "reference", "goal"])]
    turntable: Option<u16>,
    #[command(flatten)]
    animation: AnimationArgs,
    /// Fit the colour model (if the plan has one) to the lights of --light as well.
    #[arg(long)]
    replan: bool,
    /// Width and height of the picture in pixels.
    #[arg(long, value_name = "WxH", default_value = "800x800", value_parser = size)]
    size: [usize; 2],
    #[command(flatten)]
    dress: DressArgs,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them. auto prefers a GPU to the CPU.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
    /// Memory of the device for the volume, such as 512MiB or 2GiB. A larger volume is uploaded in bricks, those that the
    /// picture needs (docs/SCALE.md). Default: all of it, and half of it for bricks.
    #[arg(long, value_name = "SIZE", value_parser = memory_size, conflicts_with = "reference")]
    device_memory: Option<u64>,
    /// Memory of the host for the voxels, such as 512MiB or 2GiB. Of a file of bricks (`relume bricks`) that takes more, it
    /// holds the bricks that the picture needs (docs/SCALE.md). Default: half of the available memory for bricks.
    #[arg(long, value_name = "SIZE", value_parser = memory_size)]
    memory: Option<u64>,
    /// Render on the CPU with all 81 bands in f64: slow, but without errors of colour model, tables and rounding.
    #[arg(long, conflicts_with_all = ["device", "goal"])]
    reference: bool,
    #[command(flatten)]
    goal: GoalArgs,
    /// Save the film for `relume relight`; docs/FORMATS.md describes the file.
    #[arg(long, value_name = "FILE.exr")]
    accumulators: Option<PathBuf>,
    /// March block I of N of the volume only, and save its part of the film: for `relume composite` (docs/SCALE.md).
    #[arg(long, value_name = "I/N", value_parser = block, requires = "accumulators")]
    #[arg(conflicts_with_all = ["output", "spectral", "turntable", "goal"])]
    block: Option<Block>,
    /// Division of the picture among the processes that `mpirun` started: relay passes the film from block to block of the volume (the
    /// file of one process, to the byte); over marches all blocks at once and composites them (one file for any number of
    /// processes; N blocks, or a number that the volume determines); off renders in each process. Takes a build with MPI
    /// (docs/SCALE.md). Default: relay, or off with --part or --block.
    #[arg(long, value_name = "relay|over|over/N|off", value_parser = sharing)]
    mpi: Option<Sharing>,
    /// Save every pixel's spectrum under the lights, 380 to 780 nm, as spectral OpenEXR (Fichet et al. 2021).
    #[arg(long, value_name = "FILE.exr")]
    spectral: Option<PathBuf>,
    /// Save the scene of the picture as a scene file to edit. For a volume without a scene, this is the scene that Relume
    /// made. An existing file with another content is kept with .bak after its name.
    #[arg(long, value_name = "FILE.toml")]
    save_scene: Option<PathBuf>,
    /// Flags of `relight` for the dial, accepted here only to explain where they apply.
    #[command(flatten)]
    relit: Relit,
}

/// Ways of the hand of the dial, which need a film.
#[derive(Debug, clap::Args)]
struct Relit {
    #[arg(long, hide = true, allow_hyphen_values = true)]
    sweep: Option<String>,
    #[arg(long = "loop", hide = true)]
    closed: bool,
    #[arg(long, hide = true, allow_hyphen_values = true)]
    dial: Option<String>,
}

impl Relit {
    fn check(&self) -> Result<(), CliError> {
        let given = [
            (self.sweep.is_some(), "--sweep", format!(" {}", self.sweep.as_deref().unwrap_or_default())),
            (self.closed, "--loop", String::new()),
            (self.dial.is_some(), "--dial", format!(" {}", self.dial.as_deref().unwrap_or_default())),
        ];
        match given.into_iter().find(|(is_given, ..)| *is_given) {
            None => Ok(()),
            Some((_, flag, value)) => Err(CliError::Usage(format!(
                "{flag} is for `relume relight`, which renders nothing again: save the film here (--accumulators film.exr), then \
                 `relume relight film.exr {flag}{value} -o FILE`"
            ))),
        }
    }
}

impl Args {
    /// The processes of this run, if they share the picture.
    pub(crate) fn processes(&self) -> Result<Option<Processes>, CliError> {
        Processes::start(self.mpi, self.block.is_some() || self.animation.is_part())
    }

    /// Refuses flags that have no effect beside the others; `is_lit` if a picture or spectra are written.
    fn check_used(&self, is_lit: bool) -> Result<(), CliError> {
        let unused = |what: &str| Err(CliError::Usage(what.to_owned()));
        if self.goal.goal().is_some() && self.scene.accuracy.given().contains(&"--k") {
            return unused("--k has no effect: a search for settings chooses k; state --k, or a goal");
        }
        if self.replan && self.lights.lights.is_empty() && !self.reference {
            return unused("--replan has no effect: it is for the lights of --light, and none is given");
        }
        if !is_lit && !self.lights.lights.is_empty() && self.accumulators.is_none() {
            return unused("--light has no effect: no picture is written; add -o FILE.png");
        }
        Ok(())
    }

    /// The lights of `mix`, if the colour model is planned for them.
    fn replanned(&self, mix: &Mix) -> Vec<(String, Light)> {
        mix.0.iter().filter(|_| self.replan).map(|light| (light.name.clone(), light.spectrum.clone())).collect()
    }

    /// Refuses what several processes do not share.
    fn check_shared(&self) -> Result<(), CliError> {
        let refused = [
            (self.block.is_some(), "--block", "each process marches a block of its own with --mpi off"),
            (self.turntable.is_some(), "--turntable", "share out the pictures by --part"),
            (self.goal.goal().is_some(), "a search for settings", "search with one process and state what it finds"),
            (self.reference, "--reference", "start one process"),
        ];
        match refused.into_iter().find(|(is_given, ..)| *is_given) {
            None => Ok(()),
            Some((_, what, instead)) => Err(CliError::Usage(format!(
                "several processes share one march, and not {what}; {instead}, or add --mpi off if each renders by itself"
            ))),
        }
    }
}

/// The first of `scan.png`, `scan-2.png`, `scan-3.png` … in the working directory that does not exist, for `scan.nrrd`.
fn free_name(path: &Path) -> Option<PathBuf> {
    const MOST: usize = 10_000;
    // `.` has no name of its own.
    let path = &if path.file_name().is_some() { path.to_owned() } else { path.canonicalize().ok()? };
    let name = path.file_name()?.to_string_lossy().into_owned();
    // `scan.nii.gz` is called `scan`.
    let ending = volume::extensions().map(|it| format!(".{it}")).filter(|it| name.to_lowercase().ends_with(it));
    let ending = ending.map(|it| it.len()).max().unwrap_or(0);
    let stem = match name.get(..name.len() - ending) {
        Some(stem) if ending > 0 && !stem.is_empty() => stem.to_owned(),
        _ => path.file_stem()?.to_string_lossy().into_owned(),
    };
    let names = std::iter::once(format!("{stem}.png")).chain((2..MOST).map(|n| format!("{stem}-{n}.png")));
    // A link to nothing is a name in use.
    names.map(PathBuf::from).find(|name| name.symlink_metadata().is_err())
}

/// Reads `I/N`.
fn block(text: &str) -> Result<Block, String> {
    let numbers = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    match numbers {
        Some((number, count)) if (1..=count).contains(&number) => Ok(Block { index: number - 1, count }),
        _ => Err("write I/N with I from 1 to N, such as 3/16".to_owned()),
    }
}

/// Reads a number of bytes, or of KiB, MiB, GiB or TiB.
pub(crate) fn memory_size(text: &str) -> Result<u64, String> {
    let (number, shift) = [("KiB", 10), ("MiB", 20), ("GiB", 30), ("TiB", 40)]
        .into_iter()
        .find_map(|(unit, shift)| Some((text.strip_suffix(unit)?, shift)))
        .unwrap_or((text, 0));
    let bytes = number.trim().parse::<u64>().ok().and_then(|number| number.checked_mul(1 << shift));
    bytes
        .filter(|&bytes| bytes > 0)
        .ok_or_else(|| "write a whole number of bytes, KiB, MiB, GiB or TiB, such as 512MiB".to_owned())
}

/// States how many bricks a march held and loaded on the device, and on the host if they are in a file.
fn told_of(bricks: Option<BrickCounts>, cache: Option<CacheCounts>) -> String {
    let Some(BrickCounts { visible, held, loaded, again, rounds }) = bricks else { return String::new() };
    let twice = |again: usize| if again > 0 { format!(", {again} of them again") } else { String::new() };
    let again = twice(again);
    let why = match cache {
        Some(_) => "the volume stays in its file of bricks",
        None => "the volume is larger than the device's memory or textures",
    };
    let of_cache = cache.map_or_else(String::new, |CacheCounts { held, loaded, again }| {
        format!("; {loaded} read from the file{}, with room for {held} in memory", twice(again))
    });
    format!(
        "{why}: {loaded} bricks loaded{again} in {rounds} rounds, of {visible} that can be visible, with room for \
         {held}{of_cache}\n"
    )
}

/// Refuses blocks that the volume does not have, and scenes whose parts do not composite.
///
/// `flag` asks for them. In a `relay` each block begins with the film of those in front.
fn check_blocks(flag: &str, blocks: usize, is_relay: bool, scene: &Scene, planned: &Planned) -> Result<(), CliError> {
    let refused = |why: String| Err(CliError::Failed(format!("{flag}: {why}")));
    let rays = scene.accuracy.rays;
    if rays > 1 {
        return refused(format!(
            "the scene has {rays} rays a pixel, and means of rays do not composite; add -D accuracy.rays=1"
        ));
    }
    if planned.plan.blending.is_extreme() {
        return refused(format!(
            "blending = \"{}\": the film of a part of a ray does not hold its values; render the picture as a whole",
            planned.plan.blending.name()
        ));
    }
    if planned.plan.light.is_dimmed_along_rays() && !is_relay {
        return refused(
            "the headlight casts shadows, which come from the blocks in front; set shadows = false for it".to_owned(),
        );
    }
    if Blocks::new(&scene.frame.geometry, blocks).is_none() {
        let [x, y, z] = scene.frame.geometry.dims;
        return refused(format!(
            "a volume of {x}×{y}×{z} voxels has no {blocks} blocks; write at most {MOST_BLOCKS}, and fewer than it has voxels"
        ));
    }
    Ok(())
}

fn renderer_for(args: &Args) -> Result<Renderer, CliError> {
    let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
    Ok(match args.device_memory {
        Some(bytes) => renderer.with_memory(bytes),
        None => renderer,
    })
}

/// Results of a march on the CPU or a device.
struct Marched {
    accumulation: Option<Film<f32>>,
    /// All bands of each light position and of the transmittance, if the reference makes spectra.
    bands: Option<Film<f32>>,
    /// Linear RGBA, if an output needs it.
    linear: Option<Vec<f32>>,
    /// 8-bit sRGB RGBA.
    display: Option<Vec<u8>>,
    device: serde_json::Value,
    storage: Storage,
    times: Vec<(&'static str, Timing)>,
    details: serde_json::Value,
    /// Bricks of the march, if the volume is in bricks.
    bricks: Option<BrickCounts>,
    /// Level of the shadows in words.
    shadows: String,
    /// Exposure of the picture, where it is known.
    exposure: Option<f64>,
}

/// Results that the outputs need.
#[derive(Clone, Copy)]
struct Wanted {
    linear: bool,
    display: bool,
    accumulation: bool,
    bands: bool,
}

impl Marched {
    /// Enlarges the results of a march at reduced size.
    fn enlarge(&mut self, enlargement: &Enlargement) {
        let clock = Stopwatch::start();
        if let Some(linear) = &mut self.linear {
            *linear = enlargement.pixels(linear.as_chunks::<4>().0).concat();
        }
        if let Some(accumulation) = &mut self.accumulation {
            *accumulation = enlargement.accumulation(accumulation);
        }
        self.times.push(("enlarge", clock.read()));
    }
}

pub(crate) fn run(args: &Args, processes: Option<&Processes>, progress: &dyn Progress) -> Result<Report, CliError> {
    args.relit.check()?;
    if args.scene.is_of_all_times() {
        return times::run(args, progress);
    }
    if processes.is_some() {
        args.check_shared()?;
    }
    let source = args.scene.source(&args.look.wanted())?;
    let is_writing = !args.output.is_empty() || args.accumulators.is_some() || args.spectral.is_some();
    let default = source.bare_volume().filter(|_| !is_writing && args.save_scene.is_none()).and_then(free_name);
    let pictures: Vec<PathBuf> = args.output.iter().cloned().chain(default).collect();
    let frames = Frames::new(&pictures, args.turntable, &args.animation)?;
    for (flag, path) in [("--accumulators", &args.accumulators), ("--spectral", &args.spectral)] {
        if let Some(Err(error)) = path.as_deref().map(PictureKind::require_exr) {
            return Err(CliError::Usage(format!("{flag} {error}")));
        }
    }
    let pictured = frames.files();
    let mut outputs: Vec<&PathBuf> = pictured.iter().collect();
    outputs.extend(args.accumulators.iter().chain(&args.spectral).chain(&args.save_scene));
    // A part of an animation may have no picture.
    if pictures.is_empty() && outputs.is_empty() {
        // A volume would have had a default output: a missing file, and one that is no scene, are told to be that.
        if args.scene.scene.as_ref().is_some_and(|path| !path.exists() || is_no_scene(path)) {
            source.read(&Quiet)?;
        }
        return Err(CliError::Usage(
            "no output: add -o FILE.png or -o FILE.exr, --accumulators FILE.exr or --spectral FILE.exr".into(),
        ));
    }
    args.dress.check(&pictures)?;
    args.check_used(!pictures.is_empty() || args.spectral.is_some())?;
    let inputs = [&args.scene.scene, &args.scene.volume, &args.scene.labels, &args.scene.label_names];
    let inputs = inputs.into_iter().flatten().chain(args.look.preset());
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
    if processes.is_none_or(Processes::is_first) {
        files::check_outputs(&outputs, &inputs)?;
    }
    check_memory(args)?;
    if let Some(flag) = unused_by_the_reference(args) {
        return Err(CliError::Usage(format!(
            "{flag} has no effect: --reference computes all wavelengths, and uses a colour model for --accumulators only"
        )));
    }

    let work = Work::prepared(args, &source, (&pictures, &outputs), processes, progress)?;
    if args.turntable.is_some() { work.turned(&frames, progress) } else { work.pictured(processes, progress) }
}

/// A scene to render, with all that its pictures and reports need.
struct Work<'a> {
    args: &'a Args,
    source: &'a Source,
    pictures: &'a [PathBuf],
    /// Names of all files that are written.
    outputs: Vec<String>,
    file: SceneFile,
    /// Lights of the pictures.
    mix: Mix,
    /// Lights with which the scene opens.
    shown: Mix,
    /// True if `mix` has the lights of the scene in another mixture, with which a film then opens.
    is_mixed: bool,
    /// Requested lights that took the place of a mix.
    placed: Vec<Placed>,
    /// Settings that a search found.
    choice: Option<Choice>,
    /// The scene with these settings, on its own voxels.
    whole: Scene,
    job: PlannedJob,
    learnt: Option<Learnt>,
    /// The level in words and for programs.
    level: (String, serde_json::Value),
    loaded: Timing,
    searched: Timing,
}

/// Times of the stages in words.
fn spent(times: &[(&str, Timing)]) -> String {
    let spent: Vec<String> = times.iter().map(|(name, time)| format!("{name} {:.0} ms", time.wall_ms)).collect();
    spent.join(", ")
}

/// Times of the stages for programs.
fn times_json(times: Vec<(&str, Timing)>) -> Map<String, serde_json::Value> {
    times.into_iter().map(|(name, time)| (name.to_owned(), json!(time))).collect()
}

impl<'a> Work<'a> {
    /// Reads the scene, chooses its settings and plans it.
    fn prepared(
        args: &'a Args,
        source: &'a Source,
        (pictures, outputs): (&'a [PathBuf], &[&PathBuf]),
        processes: Option<&Processes>,
        progress: &dyn Progress,
    ) -> Result<Self, CliError> {
        if args.reference && args.accumulators.is_none() && args.scene.accuracy.tolerance().is_some() {
            tracing::warn!("--tolerance has no effect: --reference computes all wavelengths, without a colour model");
        }
        let clock = Stopwatch::start();
        let memory = HostMemory::Bounded { bytes: args.memory };
        let (file, statistics) = args.scene.load_as(&args.look.wanted(), memory, progress)?;
        let scene = file.scene.clone();
        for (given, what) in [(args.reference, "--reference"), (args.goal.goal().is_some(), "a search for settings")] {
            if given {
                scene.volume().require_voxels(what)?;
            }
        }
        let lights = args.lights.files();
        let inputs: Vec<&Path> = file.inputs.iter().chain(&lights).map(PathBuf::as_path).collect();
        if processes.is_none_or(Processes::is_first) {
            files::check_outputs(outputs, &inputs)?;
        }
        warn_of(RenderWarning::of_values(&statistics));
        warn_of(RenderWarning::of_scene(&scene, &statistics, args.size));
        let positions: Vec<String> = positions(&scene).into_iter().map(|position| position.name).collect();
        let (stated, shown) = (Mix::of_scene(&scene), file.opening_mix());
        let Requested { mix, placed } = args.lights.mix(&stated, &shown, &positions, &surfaces_of(&scene))?;
        let read = clock.read();
        let clock = Stopwatch::start();
        let choice = match args.goal.goal() {
            Some(goal) => Some(super::goal::chosen(&renderer_for(args)?, &scene, &mix, args.size, goal, progress)?),
            None => None,
        };
        let searched = clock.read();
        let clock = Stopwatch::start();
        if args.turntable.is_some() {
            // The cameras follow the visible voxels.
            scene.volume().prepare_coarse(progress)?;
        }
        let cameras = match args.turntable {
            Some(count) => turntable::cameras(&scene, args.size, count)?,
            None => vec![scene.camera.clone()],
        };
        // The error of a choice is that of the picture from the volume itself.
        let whole = choice.as_ref().map_or(scene.clone(), |choice| choice.setting.applied(&scene));
        // The reference computes all wavelengths and needs a model only for a film file.
        let keeps = if args.reference && args.accumulators.is_none() { Keeps::Bands } else { Keeps::Stated };
        let job = Job {
            lights: args.replanned(&mix),
            keeps,
            ..Job::new(whole.clone(), statistics).of_pictures(args.size, cameras)
        };
        let mut job = job.planned(progress)?;
        let level = level::told(&job);
        super::model::warn_of_plan(&job.planned);
        // The model of all bands is no model: it has no lights to be fitted to.
        let learnt = if keeps == Keeps::Bands { None } else { learn(&job.scene, &mut job.planned, &mix)? };
        if job.planned.model.is_none()
            && !args.lights.lights.is_empty()
            && pictures.is_empty()
            && args.spectral.is_none()
        {
            tracing::warn!(
                "--light has no effect on the film: it stores material weights, which are exact under every light; give it to \
             `relume relight`, or add -o FILE.png"
            );
        }
        job.scene.block = args.block;
        let PlannedJob { scene, planned, .. } = &job;
        if let Some(Block { index, count }) = args.block {
            check_blocks(&format!("--block {}/{count}", index + 1), count, false, scene, planned)?;
        }
        if let Some(processes) = processes {
            processes::check(processes, scene, planned)?;
            let is_relay = processes.sharing() == Sharing::Relay;
            check_blocks("several processes", processes.blocks(scene), is_relay, scene, planned)?;
        }
        if args.dress.annotate.has_scale() && scene.frame.unit.is_none() {
            // Of the file: --spacing is that of voxels before they are averaged.
            let averaged = DVec3::from_array(args.scene.downsample.unwrap_or([1; 3]).map(count));
            let [x, y, z] = (scene.frame.geometry.spacing / averaged).to_array().map(brief);
            let by_flag = match source.bare_volume() {
                Some(_) => format!("with --spacing, such as --spacing {x}x{y}x{z}mm, or "),
                None => String::new(),
            };
            tracing::warn!(
                "the scale bar has no unit, because the file states none; state it {by_flag}with unit = \"mm\" in the sidecar or in \
             [volume] of the scene"
            );
        }
        // A film has the lights of its scene alone.
        let is_mixed = !args.lights.lights.is_empty() && mix.is_of(&stated);
        let mut loaded = read;
        loaded += clock.read();
        let outputs = outputs.iter().map(|path| path.display().to_string()).collect();
        let work = Self {
            args,
            source,
            pictures,
            outputs,
            file,
            mix,
            shown,
            is_mixed,
            placed,
            choice,
            whole,
            job,
            learnt,
            level,
            loaded,
            searched,
        };
        work.check_film()?;
        Ok(work)
    }

    /// Lights with which the film of the scene opens.
    const fn opening(&self) -> &Mix {
        if self.is_mixed { &self.mix } else { &self.shown }
    }

    /// The film of the scene as a file.
    fn film_file(&self, film: Film<f32>) -> Result<FilmFile, OutputError> {
        let PlannedJob { scene, planned, .. } = &self.job;
        let mut dial = self.file.light.dial_of_film(&self.file.dial);
        if self.is_mixed {
            dial.hand = None;
        }
        FilmFile::of_march(scene, planned, self.opening(), dial, film)
    }

    /// Refuses a film that cannot be written, before it is marched.
    fn check_film(&self) -> Result<(), CliError> {
        let Some(path) = &self.args.accumulators else { return Ok(()) };
        let pixels = Film { size: self.args.size, components: 0, accumulators: Vec::new(), transmittance: Vec::new() };
        let refused = |why: String| CliError::Failed(format!("--accumulators {}: {why}", path.display()));
        let header = self.film_file(pixels).map_err(|error| refused(error.to_string()))?;
        header.check_header().map_err(|error| refused(format!("{error}; rename a light or a material")))?;
        if header.materials().is_empty() && self.job.planned.plan.labels {
            tracing::warn!(
                "the film stores a colour model and no materials, so it has no names of labels; {}",
                files::KEEPS
            );
        }
        Ok(())
    }

    fn overlay(&self) -> Option<Overlay<'_>> {
        self.args.dress.overlay(|| Overlay::of_scene(&self.job.scene, &self.job.planned, &self.mix))
    }

    /// Saves the scene with the exposure of its pictures.
    fn save_scene(&self, exposure: Option<f64>) -> Result<(), CliError> {
        let saved = |path: &PathBuf| save_scene(path, self.source, &self.file, exposure);
        self.args.save_scene.as_ref().map_or(Ok(()), saved)
    }

    /// Writes pictures of a full turn.
    fn turned(mut self, frames: &Frames<'_>, progress: &dyn Progress) -> Result<Report, CliError> {
        let Self { args, job, .. } = &self;
        let ready = ready_device(job, (args, args.size), progress)?;
        let mut times = vec![("load", self.loaded)];
        times.extend(ready.times);
        let inputs = digest(job.scene.digest(), &format!("{:?} {}", self.mix, args.replan));
        let mut on_device = ready.on_device;
        if job.scene.display.exposure.is_none() {
            // Exposure of the first picture, for all pictures.
            on_device.camera_mut().clone_from(&job.cameras[0]);
            let film = on_device.march(args.size, progress)?;
            on_device.expose(&film, &self.shown)?;
        }
        self.job.scene.display.exposure = on_device.scene().display.exposure;
        let Self { args, mix, job, .. } = &self;
        let look = turntable::Look {
            mix,
            size: args.size,
            dress: &args.dress,
            overlay: self.overlay(),
            cameras: &job.cameras,
            inputs,
        };
        let written = turntable::write(&mut on_device, &look, frames, progress)?;
        let read = job.scene.fields.first().reads();
        times.extend(written.times);
        self.save_scene(on_device.scene().display.exposure)?;
        let bricks = told_of(written.bricks, read) + &written.shadows;
        let lights = told_of_placed(&self.placed);
        let text = format!("{}{lights}{}{bricks}{}\n", frames.told(written.pictures), self.level.0, spent(&times));
        let mut json = json!({
            "outputs": self.outputs,
            "size": args.size,
            "device": super::info::device_json(on_device.renderer().device().info()),
            "plan": super::info::plan_json(&job.scene, &job.planned, &on_device.uploaded().storage, self.learnt),
            "times": times_json(times),
            "level": self.level.1,
            "marches": written.pictures,
            "march": {"bricks": written.bricks, "host_bricks": read, "light_grid": written.light_grid},
            "pictures": frames.json(written.pictures),
            "peak_mb": peak_mb(),
        });
        add_placed(&mut json, &self.placed);
        Ok(Report { text, json })
    }

    /// Marches the scene once and writes its pictures, film and spectra.
    fn pictured(mut self, processes: Option<&Processes>, progress: &dyn Progress) -> Result<Report, CliError> {
        let Self { args, mix, job, choice, pictures, .. } = &self;
        let marched_size = choice.as_ref().map_or(args.size, |choice| choice.setting.marched_size(args.size));
        let enlargement = Enlargement::new(marched_size, args.size);
        let frame = args.dress.annotate.frame(Frame::of(&job.scene.camera, &job.scene.frame, args.size));
        let kinds: Vec<PictureKind> = pictures.iter().map(|path| picture_kind(path)).collect::<Result<_, _>>()?;
        let encoded = args.dress.bits() == Bits::Eight && !args.reference && enlargement.is_none();
        let backdrop = args.dress.backdrop(job.scene.display.backdrop, job.scene.background.is_some());
        let encoded = encoded && args.dress.background.is_none() && !args.dress.annotate.is_given();
        let ready = |kind: &PictureKind| *kind == PictureKind::Png && encoded;
        let wanted = Wanted {
            linear: kinds.iter().any(|kind| !ready(kind)) || args.spectral.is_some() || choice.is_some(),
            display: kinds.iter().any(ready),
            accumulation: args.accumulators.is_some() || args.spectral.is_some() && !args.reference,
            bands: args.spectral.is_some() && args.reference,
        };
        let marched = if args.reference {
            Some(on_cpu(job, (mix, &self.shown), args.size, wanted, progress)?)
        } else {
            on_device(job, (mix, &self.shown), (args, marched_size, processes), wanted, progress)?
        };
        let Some(mut marched) = marched else {
            return Ok(Report { text: String::new(), json: json!({}) });
        };
        if !enlargement.is_none() {
            marched.enlarge(&enlargement);
        }

        let clock = Stopwatch::start();
        for display in [&mut self.job.scene.display, &mut self.whole.display] {
            display.exposure = display.exposure.or(marched.exposure);
        }
        let Self { args, mix, job, choice, pictures, .. } = &self;
        let PlannedJob { scene, planned, .. } = job;
        let overlay = self.overlay();
        let shown = match &marched.linear {
            Some(linear) => files::dressed(
                (linear, scene.display.tone),
                args.size,
                backdrop,
                overlay.as_ref().map(|overlay| (overlay, &frame)),
            )?,
            None => None,
        };
        let alpha = files::alpha(backdrop);
        for path in *pictures {
            let kind = picture_kind(path)?;
            match (&marched.display, &marched.linear) {
                (Some(display), _) if ready(&kind) => {
                    let rgb: Vec<u8> =
                        display.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
                    write_ready_png(path, args.size[0], args.size[1], &rgb)?;
                }
                (_, Some(linear)) => {
                    let shown = shown.as_ref().filter(|_| kind != PictureKind::Exr).unwrap_or(linear);
                    files::write_linear(
                        path,
                        &Picture::new(args.size[0], args.size[1], shown)?,
                        args.dress.bits(),
                        alpha,
                    )?;
                }
                _ => {}
            }
        }
        let mut reconstruction = None;
        let (of_spectra, kept) = match &marched.bands {
            Some(bands) => (&plan_full_spectrum(scene), Some(bands)),
            None => (planned, marched.accumulation.as_ref()),
        };
        if let (Some(path), Some(accumulation), Some(linear)) = (&args.spectral, kept, &marched.linear) {
            let means = Relightable::new(scene, of_spectra);
            reconstruction = files::write_spectra(path, &means, mix, accumulation, linear)?;
        }
        if let (Some(path), Some(accumulation)) = (&args.accumulators, marched.accumulation) {
            self.film_file(accumulation)?.write(path)?;
        }
        self.save_scene(scene.display.exposure)?;
        let written = clock.read();
        let checked = match (choice, &marched.linear) {
            (Some(choice), Some(linear)) => {
                Some(super::goal::checked(choice, &args.goal, &self.whole, mix, args.size, linear, progress)?)
            }
            _ => None,
        };

        let mut times = vec![("load", self.loaded)];
        times.extend(choice.as_ref().map(|_| ("search", self.searched)));
        times.extend(marched.times);
        times.push(("write", written));
        let new = match (&planned.model, self.learnt) {
            (Some(model), Some(learnt)) => learnt.text(model),
            _ => String::new(),
        };
        let kept = checked.as_ref().map_or("", |(text, _)| text);
        let bricks = told_of(marched.bricks, scene.fields.first().reads());
        let bricks = bricks + &marched.shadows;
        let lights = told_of_placed(&self.placed);
        let text = format!(
            "wrote {}; {}\n{lights}{new}{}{bricks}{}\n{kept}",
            self.outputs.join(", "),
            lit_by(mix),
            self.level.0,
            spent(&times)
        );
        let mut json = json!({
            "outputs": self.outputs,
            "size": args.size,
            "lights": mix.0.iter().map(|light| json!({ "name": light.name, "weight": light.weight })).collect::<Vec<_>>(),
            "device": marched.device,
            "plan": super::info::plan_json(scene, planned, &marched.storage, self.learnt),
            "times": times_json(times),
            "march": marched.details,
            "level": self.level.1,
            "block": args.block.map(|block| [block.index + 1, block.count]),
            "peak_mb": peak_mb(),
        });
        if let Some((_, choice)) = checked {
            json["choice"] = choice;
        }
        if args.spectral.is_some() {
            json["reconstruction"] = json!(reconstruction);
        }
        add_placed(&mut json, &self.placed);
        Ok(Report { text, json })
    }
}

/// Saves the scene as `path`. A scene that is there, and may have been edited, is kept as `path.bak`.
fn save_scene(path: &Path, source: &Source, file: &SceneFile, exposure: Option<f64>) -> Result<(), CliError> {
    let refused = |error: &dyn Error| CliError::Failed(format!("--save-scene {}: {error}", path.display()));
    let mut state = State::new(file);
    state.scene.display.exposure = exposure;
    let text = session::text(path, source, file, &state).map_err(|error| refused(&error))?;
    let write = |path: &Path, bytes: &[u8]| write_atomically(path, |out| out.write_all(bytes));
    if let Some(former) = std::fs::read(path).ok().filter(|former| former != text.as_bytes()) {
        let mut kept = path.as_os_str().to_owned();
        kept.push(".bak");
        let kept = PathBuf::from(kept);
        write(&kept, &former).map_err(|error| refused(&error))?;
        tracing::info!("{} had another content, which is now in {}", path.display(), kept.display());
    }
    write(path, text.as_bytes()).map_err(|error| refused(&error))
}

/// `lit by day, lamp × 0.5`.
fn lit_by(mix: &Mix) -> String {
    let mut lights: Vec<String> = Vec::new();
    for light in mix.0.iter().filter(|light| light.weight > 0.0) {
        // Nobody sees half a percent.
        let is_one = (light.weight - 1.0).abs() < 0.005;
        let told = if is_one { light.name.clone() } else { format!("{} × {}", light.name, brief(light.weight)) };
        if !lights.contains(&told) {
            lights.push(told);
        }
    }
    if lights.is_empty() { "no light is on".to_owned() } else { format!("lit by {}", lights.join(", ")) }
}

/// Fits the colour model, if there is one, to the lights of `mix` that were not in its plan.
fn learn(scene: &Scene, planned: &mut Planned, mix: &Mix) -> Result<Option<Learnt>, CliError> {
    let way_out = match scene.accuracy.dimension {
        None => "add --replan to plan the model for this light too",
        Some(_) => "add --replan to plan the model for this light too, or set a larger --k",
    };
    let Some(model) = planned.model.as_mut().map(Arc::make_mut) else { return Ok(None) };
    Ok(Some(super::model::learn(model, mix, scene.accuracy.tolerance, way_out)?))
}

/// First flag for the colour model that has no effect on the reference, which uses no model. `--tolerance` is exempt.
fn unused_by_the_reference(args: &Args) -> Option<&'static str> {
    let given = args.scene.accuracy.given().into_iter().filter(|flag| *flag != "--tolerance");
    let mut given = given.chain(args.replan.then_some("--replan"));
    given.next().filter(|_| args.reference && args.accumulators.is_none())
}

/// Refuses a picture that exceeds the free memory.
fn check_memory(args: &Args) -> Result<(), CliError> {
    // Linear RGBA in f32. The reference adds XYZ, colours and transmittance in f64, and for spectra all bands of at
    // least one light position in f64 and f32.
    let pixel_bytes = match (args.reference, &args.spectral) {
        (true, Some(_)) => 72 + 12 * BANDS,
        (true, None) => 72,
        (false, _) => 16,
    };
    files::check_memory(args.size, pixel_bytes)
}

/// A scene on the device, and the times of opening the device and of uploading.
struct Ready {
    on_device: SceneRenderer,
    times: [(&'static str, Timing); 2],
}

/// Uploads the scene to the device of `args`, and warns of what the upload loses.
fn ready_device(
    job: &PlannedJob,
    (args, size): (&Args, [usize; 2]),
    progress: &dyn Progress,
) -> Result<Ready, CliError> {
    let clock = Stopwatch::start();
    let renderer = renderer_for(args)?;
    renderer.check_picture(&job.planned.plan, size, 0)?;
    let opened = clock.read();
    let clock = Stopwatch::start();
    let on_device = job.uploaded(&renderer, progress)?;
    let uploaded = on_device.uploaded();
    warn_of(RenderWarning::of_storage(&job.scene, &uploaded.storage, uploaded.labels.as_deref()));
    Ok(Ready { on_device, times: [("device", opened), ("upload", clock.read())] })
}

fn on_device(
    job: &PlannedJob,
    (mix, opening): (&Mix, &Mix),
    (args, size, processes): (&Args, [usize; 2], Option<&Processes>),
    wanted: Wanted,
    progress: &dyn Progress,
) -> Result<Option<Marched>, CliError> {
    let Ready { on_device, times } = ready_device(job, (args, size), progress)?;
    let (renderer, uploaded) = (on_device.renderer(), on_device.uploaded());
    if let (Some(Block { index, count }), Some([x, y, z])) = (args.block, uploaded.light_block()) {
        return Err(CliError::Failed(format!(
            "--block {}/{count}: shadows and scattered light of this volume in bricks come from means of {x}×{y}×{z} voxels, which follow \
             from the memory, so those of other blocks may differ; give it more --device-memory to hold the volume whole, or set \
             shadows = false and scattering.orders = \"single\"",
            index + 1
        )));
    }
    let Wanted { linear, display, accumulation, .. } = wanted;
    let made = match processes {
        Some(processes) => {
            let asked = Asked { film: accumulation, linear, display };
            let cut = processes.agree(&job.scene, &job.planned, mix, (size, uploaded.light_block()), asked)?;
            let Some(made) = processes.render(&on_device, (mix, opening), (size, &cut), asked, progress)? else {
                return Ok(None);
            };
            made
        }
        None => one_march(&on_device, (mix, opening), size, wanted, progress)?,
    };
    let accumulators = &made.device;
    warn_of(RenderWarning::of_film(&on_device, accumulators, mix));
    let mut details = json!({
        "size": size,
        "dispatches": accumulators.dispatches,
        "cells": {"occupied": accumulators.occupied[0], "total": accumulators.occupied[1]},
        "volume_bytes": uploaded.bytes(),
        "pixel_bytes": job.planned.plan.pixel_bytes(),
        "light_grid": light_grid::json(accumulators),
        "bricks": accumulators.bricks,
        "host_bricks": job.scene.fields.first().reads(),
    });
    if processes.is_some() {
        details["processes"] = made.details;
    }
    Ok(Some(Marched {
        accumulation: made.film,
        exposure: made.exposure,
        bands: None,
        linear: made.linear,
        display: made.display,
        device: super::info::device_json(renderer.device().info()),
        storage: uploaded.storage.clone(),
        details,
        bricks: accumulators.bricks,
        shadows: light_grid::told(accumulators),
        times: [&times[..], &made.times].concat(),
    }))
}

/// Marches and relights in this process alone.
fn one_march(
    on_device: &SceneRenderer,
    (mix, opening): (&Mix, &Mix),
    size: [usize; 2],
    wanted: Wanted,
    progress: &dyn Progress,
) -> Result<processes::Picture, CliError> {
    let clock = Stopwatch::start();
    let device = on_device.march(size, progress)?;
    let march = clock.read();
    let clock = Stopwatch::start();
    let exposure = match on_device.scene() {
        // An automatic one is found in the whole film.
        scene if scene.block.is_some() => scene.display.exposure,
        _ => Some(on_device.exposure(&device, opening)?),
    };
    let renderer = on_device.renderer();
    let matrices = processes::at_exposure(on_device, mix, exposure);
    let (mut display, mut linear, mut film) = (None, None, None);
    if wanted.display {
        let relight = renderer.relight_display_over(&device, matrices.backdrop)?;
        relight.run(&matrices)?;
        display = Some(relight.read()?);
    }
    if wanted.linear {
        let relight = renderer.relight_linear(&device)?;
        relight.run(&matrices)?;
        linear = Some(relight.read()?);
    }
    if wanted.accumulation {
        film = Some(renderer.read(&device)?);
    }
    let times = vec![("march", march), ("relight", clock.read())];
    Ok(processes::Picture { film, linear, display, exposure, device, times, details: json!(null) })
}

/// Rounds a number to the f32 of a film file.
#[expect(clippy::cast_possible_truncation, reason = "film files hold f32")]
fn narrow(number: f64) -> f32 {
    number as f32
}

fn on_cpu(
    job: &PlannedJob,
    (mix, opening): (&Mix, &Mix),
    size: [usize; 2],
    wanted: Wanted,
    progress: &dyn Progress,
) -> Result<Marched, CliError> {
    let clock = Stopwatch::start();
    let reference = job.reference()?;
    warn_of(RenderWarning::of_labels(reference.labels.as_ref()));
    warn_of(RenderWarning::of_nothing(&job.scene, &job.planned, mix, None));
    let (mut linear, mut bands) = (None, None);
    if wanted.bands {
        let film = reference.bands(size, progress)?;
        let matrices = RelightMatrices::of_scene(&job.scene, &plan_full_spectrum(&job.scene), mix);
        linear = Some(film.rgba(&matrices));
        bands = Some(film.map(narrow));
    } else if wanted.linear {
        linear = Some(files::rgba(reference.picture(mix, size, progress)?.into_iter()));
    }
    let mut exposure = job.scene.display.exposure;
    if exposure.is_none() && job.scene.block.is_none() {
        // A picture of all bands under the opening lights, at exposure 1.
        let known = linear.as_ref().filter(|_| mix == opening).cloned();
        let picture = match known {
            Some(linear) => linear,
            None => files::rgba(reference.picture(opening, size, progress)?.into_iter()),
        };
        let found = automatic_exposure(&picture, opening, &job.scene.display);
        exposure = Some(found);
        for pixel in linear.iter_mut().flat_map(|linear| linear.as_chunks_mut::<4>().0) {
            pixel[..3].iter_mut().for_each(|part| *part = narrow(f64::from(*part) * found));
        }
    }
    let accumulation = wanted.accumulation.then(|| reference.film(size, progress)).transpose()?;
    Ok(Marched {
        exposure,
        accumulation: accumulation.map(|film| film.map(narrow)),
        bands,
        linear,
        display: None,
        device: json!({"name": "reference: CPU, 81 bands, f64"}),
        storage: reference.storage,
        times: vec![("reference", clock.read())],
        details: json!(null),
        bricks: None,
        shadows: String::new(),
    })
}
