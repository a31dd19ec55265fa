//! `relume render --time all`: pictures of every time step of a volume, with one look.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde_json::{Map, json};

use crate::annotate::{Frame, Overlay};
use crate::measure::{Stopwatch, Timing, peak_mb};
use crate::progress::{Progress, unreported};
use crate::render::{Job, RenderWarning, SceneRenderer};
use crate::scene::{Camera, Mix, positions};

use super::super::files;
use super::super::frames::{self, Form, Frames};
use super::super::level;
use super::super::model::warn_of_plan;
use super::super::scene::{add_placed, surfaces_of, told_of_placed};
use super::super::{CliError, Report, info, turntable, warn_of};
use super::{Args, Requested, free_name, learn, lit_by, renderer_for, save_scene};

/// A time step on the device.
struct Step {
    time: usize,
    on_device: SceneRenderer,
}

/// Refuses what belongs to one time step.
fn check(args: &Args) -> Result<(), CliError> {
    let refused = [
        ("--accumulators", args.accumulators.is_some()),
        ("--spectral", args.spectral.is_some()),
        ("--reference", args.reference),
        ("--block", args.block.is_some()),
        ("--mpi", args.mpi.is_some()),
        ("--part", args.animation.is_part()),
        ("a search for settings", args.goal.goal().is_some()),
    ];
    match refused.into_iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some((what, _)) => Err(CliError::Usage(format!(
            "--time all writes pictures of all time steps, without {what}; choose one time step, such as --time 0"
        ))),
    }
}

/// Writes a picture of each time step; with `--turntable`, the pictures of a turn during which the times pass once.
pub(super) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    check(args)?;
    let clock = Stopwatch::start();
    let source = args.scene.source_of_look(&args.look.wanted())?;
    let times = source.times(progress)?;
    if times < 2 {
        let stated = if source.bare_volume().is_some() { "" } else { ", or the scene states one (volume.time)" };
        return Err(CliError::Usage(format!("--time all: {} has one time step{stated}", source.name())));
    }
    let count = args.turntable.map_or(times, usize::from);
    let pictured = u16::try_from(count)
        .map_err(|_| CliError::Failed(format!("--time all: {count} time steps are more pictures than are numbered")))?;
    let default = source.bare_volume().filter(|_| args.output.is_empty()).and_then(free_name);
    let pictures: Vec<PathBuf> = args.output.iter().cloned().chain(default).collect();
    if pictures.is_empty() {
        return Err(CliError::Usage("no output: add -o FILE.png, -o FILE.exr or -o FILE.apng".into()));
    }
    args.dress.check(&pictures)?;
    args.check_used(true)?;
    let frames = Frames::new(&pictures, Some(pictured), &args.animation)?;
    let files = frames.files();
    let outputs: Vec<&PathBuf> = files.iter().chain(&args.save_scene).collect();
    let lights = args.lights.files();
    let series = source.series(times, progress)?;
    if let Some(guess) = series.guess() {
        tracing::info!("{guess}");
    }
    let (first, statistics) = series.at(0, progress)?;
    let inputs = first.inputs.iter().chain(&lights).chain(args.look.preset());
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
    files::check_outputs(&outputs, &inputs)?;
    for note in &first.scene.volume().notes {
        tracing::warn!("{note}");
    }
    warn_of(RenderWarning::of_values(&statistics));
    warn_of(RenderWarning::of_scene(&first.scene, &statistics, args.size));
    let names: Vec<String> = positions(&first.scene).into_iter().map(|position| position.name).collect();
    let Requested { mix, placed } =
        args.lights.mix(&Mix::of_scene(&first.scene), &first.opening_mix(), &names, &surfaces_of(&first.scene))?;
    let cameras: Vec<Camera> = match args.turntable {
        Some(frames) => {
            first.scene.volume().prepare_coarse(progress)?;
            turntable::cameras(&first.scene, args.size, frames)?
        }
        None => vec![first.scene.camera.clone(); count],
    };
    let renderer = renderer_for(args)?;
    let step = |time: usize, is_first: bool| -> Result<Step, CliError> {
        let (file, statistics) = series.at(time, progress)?;
        let job = Job::new(file.scene.clone(), statistics).of_pictures(args.size, cameras.clone());
        let mut job = Job { lights: args.replanned(&mix), ..job }.planned(progress)?;
        level::told(&job);
        if is_first {
            warn_of_plan(&job.planned);
            learn(&job.scene, &mut job.planned, &mix)?;
        } else if let Some(model) = job.planned.model.as_mut().map(Arc::make_mut) {
            // Warnings of the first step hold for all.
            model.learn_all(&mix.0.iter().map(|light| (&*light.name, &light.spectrum)).collect::<Vec<_>>())?;
        }
        renderer.check_picture(&job.planned.plan, args.size, 0)?;
        if is_first {
            warn_of(RenderWarning::of_nothing(&job.scene, &job.planned, &mix, None));
        }
        let on_device = job.uploaded(&renderer, &unreported(progress))?;
        Ok(Step { time, on_device })
    };
    let mut current = step(0, true)?;
    let loaded = clock.read();
    let clock = Stopwatch::start();
    let backdrop = args.dress.backdrop(first.scene.display.backdrop, first.scene.background.is_some());
    let form = Form { size: args.size, bits: args.dress.bits(), backdrop };
    let (tone, opening) = (first.scene.display.tone, first.opening_mix());
    let mut exposure = first.scene.display.exposure;
    let digest = frames::digest(first.scene.digest(), &format!("{mix:?}"));
    let inputs_of = |index: usize| frames::digest(digest, &format!("{index} of {count}"));
    let written = frames.write(form, ("marching", progress), inputs_of, |index| {
        let time = index * times / count;
        if current.time != time {
            current = step(time, false)?;
        }
        let Step { on_device, .. } = &mut current;
        if args.turntable.is_some() {
            on_device.camera_mut().clone_from(&cameras[index]);
        }
        let film = on_device.march(args.size, &unreported(progress))?;
        on_device.display_mut().exposure = exposure;
        on_device.expose(&film, &opening)?;
        exposure = on_device.scene().display.exposure;
        let matrices = on_device.matrices(&mix);
        let (scene, planned) = (on_device.scene(), on_device.planned());
        let overlay = args.dress.overlay(|| Overlay::of_scene(scene, planned, &mix));
        let relight = on_device.renderer().relight_linear(&film)?;
        relight.run(&matrices)?;
        let linear = relight.read::<f32>()?;
        let frame =
            args.dress.annotate.frame(Frame::of(&on_device.scene().camera, &on_device.scene().frame, args.size));
        let shown = files::dressed(
            (&linear, tone),
            args.size,
            form.backdrop,
            overlay.as_ref().map(|overlay| (overlay, &frame)),
        )?;
        Ok(frames::Frame { linear, shown })
    })?;
    if let Some(path) = &args.save_scene {
        let mut source = source.clone();
        source.options.selection.time = Some(0);
        save_scene(path, &source, &first, exposure)?;
    }
    let spent = [("load", loaded), ("pictures", clock.read())];
    let listed: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    let told = |(name, time): &(&str, Timing)| format!("{name} {:.0} ms", time.wall_ms);
    let text = format!(
        "{}{}{times} time steps, {}\n{}\n",
        frames.told(written),
        told_of_placed(&placed),
        lit_by(&mix),
        spent.iter().map(told).collect::<Vec<_>>().join(", ")
    );
    let mut json = json!({
        "outputs": listed,
        "size": args.size,
        "time_steps": times,
        "guess": series.guess(),
        "device": info::device_json(renderer.device().info()),
        "times": spent.into_iter().map(|(name, time)| (name.to_owned(), json!(time))).collect::<Map<_, _>>(),
        "pictures": frames.json(written),
        "peak_mb": peak_mb(),
    });
    add_placed(&mut json, &placed);
    Ok(Report { text, json })
}
