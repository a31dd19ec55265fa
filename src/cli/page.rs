//! `relume page`: a film or a scene as one HTML file that relights in a browser.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::annotate::pixel_length;
use crate::document::moves::around;
use crate::document::{Placed, Requested, SceneFile};
use crate::film::Film;
use crate::live::{self, ForReaders, LiveNote};
use crate::measure::{Stopwatch, Timing, peak_mb};
use crate::memory;
use crate::number::{count, whole};
use crate::output::FilmFile;
use crate::output::film::{self, Component};
use crate::output::page::{self, PackedLive, PackedPage, Page, PageError, Summary, escaped};
use crate::progress::Progress;
use crate::render::{Job, Keeps, PlannedJob, RenderWarning, Renderer, SceneRenderer};
use crate::scene::{Camera, Mix, Placement, Scene, positions};
use crate::spectrum::{Light, Reflectance, Spectrum};
use crate::volume::HostMemory;
use crate::vulkan::{Device, DeviceChoice, Validation};

use super::files;
use super::level;
use super::scene::{LightArgs, LookArgs, SceneArgs, add_placed, size, surfaces_of, told_of_placed};
use super::{CliError, Report, warn_of};

const EXAMPLES: &str = "\
Examples:
  relume page -o frog.html                                   the built-in scene
  relume page acc.exr -o frog.html --title \"A frog\"          a film from `relume render --accumulators`
  relume page scene.toml -o turntable.html --size 400x400 --views 24
  relume page acc.exr -o small.html --tolerance 1
  relume page scene.toml -o live.html --live           the reader turns and cuts the volume

Open the file in a browser: it needs no server, no network and no Relume. docs/PAGE.md describes it.";

/// Effect of the flag here: for a colour model it is also the tolerance of the scene.
const TOLERANCE_HELP: &str = "Largest ΔE00 that packing adds to any pixel under any light of the page (1 is just visible). \
For a scene with a colour model, also the tolerance of that model. [default: 0.5, and that of the scene]";

/// Arguments of `relume page`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
#[command(mut_arg("scene", |arg| arg.value_name("FILM.exr|SCENE").help("Film file from `relume render --accumulators`, a scene file, or a volume. Default: the built-in scene")))]
#[command(mut_arg("tolerance", |arg| arg.help(TOLERANCE_HELP).long_help(TOLERANCE_HELP).help_heading(None::<&str>)))]
pub(crate) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    look: LookArgs,
    #[command(flatten)]
    lights: LightArgs,
    /// Page to write.
    #[arg(short, long, value_name = "FILE.html", required = true)]
    output: PathBuf,
    /// Title of the page. The page names no file and no person; the title is all that it says of its origin.
    #[arg(long, value_name = "TEXT", default_value = page::TITLE)]
    title: String,
    /// Largest size of the page in bytes; many mail servers refuse more than 25 MB.
    #[arg(long, value_name = "BYTES", default_value_t = 25_000_000)]
    max_bytes: usize,
    /// Turn the volume once about the up direction of the camera in N views, which the page shows one at a time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=360))]
    views: Option<u16>,
    /// Rows of views at N elevations, 25° apart, around that of the camera.
    #[arg(long, value_name = "N", requires = "views", value_parser = clap::value_parser!(u16).range(1..=7))]
    elevations: Option<u16>,
    /// Let the reader turn, zoom and cut the volume: the page holds its voxels, and browsers with WebGPU march them. Others show
    /// the finished views.
    #[arg(long)]
    live: bool,
    /// Width and height of the picture in pixels. [default: 800x800]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[usize; 2]>,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them. auto prefers a GPU to the CPU.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
}

/// Films of all views, with the header of the first.
struct Films {
    header: FilmFile,
    views: Vec<Film<f32>>,
    columns: usize,
    /// The volume, for a reader who turns it.
    live: Option<PackedLive>,
    /// Requested lights that took the place of a mix.
    placed: Vec<Placed>,
    times: Vec<(&'static str, Timing)>,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    page::check_name(&args.output).map_err(|error| CliError::Usage(error.to_string()))?;
    let film =
        args.scene.scene.as_deref().filter(|path| path.extension().is_some_and(|it| it.eq_ignore_ascii_case("exr")));
    let lights = args.lights.files();
    let given =
        [&args.scene.scene, &args.scene.volume, &args.scene.labels, &args.scene.label_names].into_iter().flatten();
    let inputs: Vec<&Path> = given.chain(&lights).chain(args.look.preset()).map(PathBuf::as_path).collect();
    files::check_outputs(&[&args.output], &inputs)?;
    let Films { header, views, columns, live, placed, mut times } = match film {
        Some(path) => saved(args, path)?,
        None => rendered(args, progress)?,
    };
    let tolerance = args.scene.accuracy.tolerance().unwrap_or(page::TOLERANCE);
    let clock = Stopwatch::start();
    let page = Page { film: &header, views: &views, columns, title: &args.title, tolerance };
    let packed = page.with_live(live.as_ref(), progress)?;
    packed.check_size(args.max_bytes)?;
    times.push(("pack", clock.read()));
    let clock = Stopwatch::start();
    packed.write(&args.output)?;
    times.push(("write", clock.read()));
    let summary = &packed.summary;
    let spent: Vec<String> = times.iter().map(|(name, time)| format!("{name} {:.0} ms", time.wall_ms)).collect();
    let of_views = if views.len() > 1 { format!(", {} views", views.len()) } else { String::new() };
    let text = format!(
        "wrote {}: {:.2} MB{of_views}; packing adds at most ΔE00 {:.2} under any light of the page\n{}{}\n",
        args.output.display(),
        count(summary.bytes) / 1e6,
        summary.largest_error,
        told_of_placed(&placed),
        spent.join(", ")
    );
    let mut json = json!({
        "outputs": [args.output.display().to_string()],
        "size": views.first().map(|view| view.size),
        "page": summary,
        "times": times.into_iter().map(|(name, time)| (name.to_owned(), json!(time))).collect::<serde_json::Map<_, _>>(),
        "peak_mb": peak_mb(),
    });
    add_placed(&mut json, &placed);
    Ok(Report { text, json })
}

/// The film in the file `path`.
fn saved(args: &Args, path: &Path) -> Result<Films, CliError> {
    let unused = args.scene.given().or_else(|| {
        let flags = [
            ("--look", !args.look.wanted().is_none()),
            ("--views", args.views.is_some()),
            ("--size", args.size.is_some()),
            ("--live", args.live),
            ("--device", args.device != DeviceChoice::Auto),
        ];
        flags.into_iter().find(|(_, given)| *given).map(|(flag, _)| flag)
    });
    if let Some(flag) = unused {
        let file = path.display();
        return Err(CliError::Usage(format!("{flag} is for a scene: the film {file} is already rendered")));
    }
    let clock = Stopwatch::start();
    let mut header = FilmFile::read(path)?;
    files::warn_of_part(path, &header);
    if header.materials().is_empty() {
        tracing::warn!("the film stores a colour model and no materials, so the page names none; {}", files::KEEPS);
    }
    let film = header.take_film();
    let numbers = (film.accumulators.len() + film.transmittance.len()) / film.pixels().max(1);
    page::check_memory(1, film.size, numbers, true, memory::available_bytes())
        .map_err(|error| CliError::Failed(format!("{}: {error}; render a smaller film", path.display())))?;
    header.expose(&film)?;
    let placed = light(args, &mut header)?;
    Ok(Films { header, views: vec![film], columns: 1, live: None, placed, times: vec![("load", clock.read())] })
}

/// Opens the page with the lights of `--light`; returns those that took the place of a mix.
fn light(args: &Args, header: &mut FilmFile) -> Result<Vec<Placed>, CliError> {
    if args.lights.lights.is_empty() {
        return Ok(Vec::new());
    }
    let positions: Vec<String> = header.positions.iter().map(|position| position.name.clone()).collect();
    let surfaces: Vec<Spectrum> = header.materials().into_iter().map(|material| material.1).collect();
    let Requested { mix, placed } = args.lights.mix(&header.stated()?, &header.opening()?, &positions, &surfaces)?;
    header.open_with(&mix);
    if let Some(dial) = &mut header.dial {
        // Sliders mix these lights.
        dial.hand = None;
    }
    Ok(placed)
}

/// The film of each view of the scene.
fn rendered(args: &Args, progress: &dyn Progress) -> Result<Films, CliError> {
    let size = args.size.unwrap_or([800, 800]);
    let clock = Stopwatch::start();
    let (file, statistics) = args.scene.load_as(&args.look.wanted(), HostMemory::Whole, progress)?;
    let inputs: Vec<&Path> = file.inputs.iter().map(PathBuf::as_path).collect();
    files::check_outputs(&[&args.output], &inputs)?;
    warn_of(RenderWarning::of_values(&statistics));
    let (mut scene, mut block) = (file.scene.clone(), [1; 3]);
    if args.live {
        let for_readers = ForReaders::new(&scene, size, progress)?;
        tell(&for_readers.notes);
        (scene, block) = (for_readers.scene, for_readers.block);
    } else if scene.frame.anatomical {
        tracing::info!("a page of a head shows a face: send it only where the person agrees");
    }
    let names: Vec<String> = positions(&scene).into_iter().map(|position| position.name).collect();
    let stated = Mix::of_scene(&scene);
    let mix = match args.lights.lights[..] {
        [] => stated,
        _ => args.lights.mix(&stated, &file.opening_mix(), &names, &surfaces_of(&scene))?.mix,
    };
    let (cameras, columns) = cameras(args, &scene, size)?;
    let lights = mix.0.iter().map(|light| (light.name.clone(), light.spectrum.clone())).collect();
    let statistics = if block == [1; 3] { statistics } else { scene.volume().statistics()? };
    let job = Job::new(scene, statistics).of_pictures(size, cameras);
    let job = Job { lights, keeps: Keeps::Weights, ..job }.planned(progress)?;
    let (text, _) = level::told(&job);
    if !text.is_empty() {
        tracing::info!("{}", text.trim_end());
    }
    super::model::warn_of_plan(&job.planned);
    let PlannedJob { scene, planned, cameras, .. } = &job;
    let plan = &planned.plan;
    let numbers = plan.components() * plan.light.accumulators() + plan.transmittance_numbers();
    page::check_memory(cameras.len(), size, numbers, false, memory::available_bytes())?;
    let mut times = vec![("load", clock.read())];
    let clock = Stopwatch::start();
    let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
    let (views, on_device) = marched(&renderer, &job, size, progress)?;
    times.push(("march", clock.read()));
    let clock = Stopwatch::start();
    let mut live = None;
    if args.live {
        let (packed, notes) = live::packed(&renderer, (scene, planned), on_device.uploaded(), size, block)?;
        tell(&notes);
        live = Some(packed);
        times.push(("pack volume", clock.read()));
    }
    let empty = Film { size, components: 0, accumulators: Vec::new(), transmittance: Vec::new() };
    let dial = file.light.dial_of_film(&file.dial);
    let mut header = FilmFile::of_march(scene, planned, &file.opening_mix(), dial, empty)?;
    if let (Some(frame), [camera, _, ..]) = (&mut header.frame, &cameras[..]) {
        // Cameras of a turntable are equally far, and the letters turn.
        let pixel = pixel_length(camera, &scene.frame.geometry, size.map(count));
        (frame.pixel, frame.edges) = (pixel.map(|it| it.units), None);
    }
    header.expose(&views[0])?;
    let placed = light(args, &mut header)?;
    Ok(Films { header, views, columns, live, placed, times })
}

/// Tells how a live page differs.
fn tell(notes: &[LiveNote]) {
    for note in notes {
        if note.is_warning() { tracing::warn!("{note}") } else { tracing::info!("{note}") }
    }
}

/// Cameras of the views, row by row from the top, and the number of views in a row.
fn cameras(args: &Args, scene: &Scene, size: [usize; 2]) -> Result<(Vec<Camera>, usize), CliError> {
    let Some(columns) = args.views.filter(|&views| views > 1 || args.elevations.is_some()) else {
        return Ok((vec![scene.camera.clone()], 1));
    };
    let all = around(scene, count(size[0]) / count(size[1]), [columns, args.elevations.unwrap_or(1)]);
    let all = all.ok_or_else(|| CliError::Failed("the camera has no line of sight to turn about".into()))?;
    Ok((all, columns.into()))
}

/// Marches every view on the device.
fn marched(
    renderer: &Renderer,
    job: &PlannedJob,
    size: [usize; 2],
    progress: &dyn Progress,
) -> Result<(Vec<Film<f32>>, SceneRenderer), CliError> {
    renderer.check_picture(&job.planned.plan, size, 0)?;
    let mut on_device = job.uploaded(renderer, progress)?;
    if let Some([x, y, z]) = on_device.uploaded().light_block() {
        tracing::warn!("shadows of this volume in bricks come from means of {x}×{y}×{z} voxels (docs/SCALE.md)");
    }
    let films = job.films(&mut on_device, size, progress, |_, _| {})?;
    Ok((films, on_device))
}

/// Width and height of the page of a report, in pixels.
const SMALL: usize = 320;

/// Largest page of a report, in bytes.
const SMALL_BYTES: usize = 1_000_000;

/// The scene as a small page for a report.
pub(super) fn small_page(
    renderer: &Renderer,
    file: &SceneFile,
    progress: &dyn Progress,
) -> Result<PackedPage, CliError> {
    let (size, statistics) = ([SMALL; 2], file.scene.volume().statistics()?);
    let lights = Mix::of_scene(&file.scene).0.into_iter().map(|light| (light.name, light.spectrum)).collect();
    let job = Job { lights, keeps: Keeps::Weights, ..Job::new(file.scene.clone(), statistics) }.planned(progress)?;
    super::model::warn_of_plan(&job.planned);
    let (views, _) = marched(renderer, &job, size, progress)?;
    let empty = Film { size, components: 0, accumulators: Vec::new(), transmittance: Vec::new() };
    let dial = file.light.dial_of_film(&file.dial);
    let mut film =
        FilmFile::of_march(&job.scene, &job.planned, &file.opening_mix(), dial, empty).map_err(PageError::from)?;
    views.first().map_or(Ok(()), |view| film.expose(view)).map_err(PageError::from)?;
    packed_small(&film, &views, &file.scene.name, progress)
}

/// The reflectances of `materials` as squares, row by row, which the first of `lights` lights at first.
pub(super) fn patches_page(
    materials: &[(&str, &Reflectance)],
    lights: &[(&str, &Light)],
    progress: &dyn Progress,
) -> Result<PackedPage, CliError> {
    const GAP: usize = 6;
    let columns = whole(count(materials.len()).sqrt().ceil()).max(1);
    let rows = materials.len().div_ceil(columns).max(1);
    let pitch = (SMALL / columns).max(GAP + 2);
    let (width, height) = (columns * pitch + GAP, rows * pitch + GAP);
    let weight = |material: usize, x: usize, y: usize| {
        let is_gap = x % pitch < GAP || y % pitch < GAP;
        if !is_gap && y / pitch * columns + x / pitch == material { 1.0 } else { 0.0 }
    };
    let plane = |material: usize| (0..height).flat_map(move |y| (0..width).map(move |x| weight(material, x, y)));
    let film = Film {
        size: [width, height],
        components: materials.len(),
        accumulators: (0..materials.len()).flat_map(plane).collect(),
        transmittance: vec![1.0; width * height],
    };
    let component = |(name, surface): &(&str, &Reflectance)| Component {
        name: (*name).to_owned(),
        spectrum: *surface.spectrum().samples(),
    };
    let light = |(index, (name, light)): (usize, &(&str, &Light))| film::Light {
        name: (*name).to_owned(),
        position: 0,
        weight: 1.0,
        shown: Some(if index == 0 { 1.0 } else { 0.0 }),
        spectrum: *light.spectrum().samples(),
    };
    let header = FilmFile {
        positions: vec![film::Position { name: "light".to_owned(), placement: Placement::Ambient, shadows: false }],
        lights: lights.iter().enumerate().map(light).collect(),
        ..FilmFile::empty([width, height], film::Components::Surfaces(materials.iter().map(component).collect()))
    };
    packed_small(&header, &[film], "The materials of the palette", progress)
}

fn packed_small(
    film: &FilmFile,
    views: &[Film<f32>],
    title: &str,
    progress: &dyn Progress,
) -> Result<PackedPage, CliError> {
    let packed = Page { film, views, columns: 1, title, tolerance: page::TOLERANCE }.packed(progress)?;
    packed.check_size(SMALL_BYTES)?;
    Ok(packed)
}

/// HTML of a small page in a report, with its size.
pub(super) fn frame(page: &PackedPage, title: &str) -> String {
    const HEIGHT: usize = 760;
    let Summary { bytes, largest_error, .. } = page.summary;
    format!(
        "<figure>{}<figcaption>{}: {:.0} kB of this file. Rounding adds at most ΔE00 {largest_error:.2}. It needs no network.</figcaption></figure>\n",
        page.framed(title, HEIGHT),
        escaped(title),
        count(bytes) / 1e3,
    )
}
