//! `relume figures`: the figures of the paper, each from one march.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use serde_json::json;
use toml::Table;

use crate::document;
use crate::document::{Definition, SceneFile, SceneOptions};
use crate::measure::Stopwatch;
use crate::output::{write_atomically, write_ready_png};
use crate::progress::Progress;
use crate::render::{Renderer, SceneRenderer};
use crate::scene::Mix;
use crate::vulkan::{Device, DeviceChoice, Validation};

use super::scene::{DefineArgs, size};
use super::{CliError, Report, files};

const EXAMPLES: &str = "\
Examples:
  relume figures -o figures                           on phantoms
  relume figures -o figures --volume-frog frog.mhd --labels frogtissue.mhd --volume-engine engine.vti

Writes 1a.png to 7c.png, and figures.html with all pictures and captions.";

/// The figures: name, scene, and whether it shows the frog.
const FIGURES: [(&str, &str, bool); 4] = [
    ("fig1", include_str!("../../data/figures/fig1.toml"), true),
    ("fig5", include_str!("../../data/figures/fig5.toml"), true),
    ("fig6", include_str!("../../data/figures/fig6.toml"), false),
    ("fig7", include_str!("../../data/figures/fig7.toml"), false),
];

/// Changes of the scenes for the real volumes.
const REAL: &str = include_str!("../../data/figures/real.toml");

/// Arguments of `relume figures`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Folder for the pictures; created if missing.
    #[arg(short, long, value_name = "DIR")]
    output: PathBuf,
    /// The Whole Frog (frog.mhd, 500×470×136) in place of the frog phantom.
    #[arg(long, value_name = "FILE", requires = "labels")]
    volume_frog: Option<PathBuf>,
    /// Its tissue labels (frogtissue.mhd).
    #[arg(long, value_name = "FILE", requires = "volume_frog")]
    labels: Option<PathBuf>,
    /// The scanned engine block (engine.vti, 256×256×128) in place of the engine phantom.
    #[arg(long, value_name = "FILE")]
    volume_engine: Option<PathBuf>,
    /// Pixels across and down of each picture.
    #[arg(long, value_name = "WxH", default_value = "600x600", value_parser = size)]
    size: [usize; 2],
    #[command(flatten)]
    define: DefineArgs,
    /// Vulkan device: its number or a part of its name, as `relume info` lists them.
    #[arg(long, value_name = "NAME|INDEX", default_value = "auto")]
    device: DeviceChoice,
}

/// A picture of a figure.
struct Panel {
    name: String,
    caption: String,
    png: Vec<u8>,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    let renderer = Renderer::new(Device::open(&args.device, Validation::Off)?);
    // Loads all scenes before the first picture is written, so that an unreadable one leaves no incomplete set.
    let mut scenes = Vec::new();
    for (name, figure, is_frog) in FIGURES {
        let clock = Stopwatch::start();
        let scene = load(args, name, figure, is_frog, progress)?;
        scenes.push((name, scene, clock.read()));
    }
    std::fs::create_dir_all(&args.output)
        .map_err(|error| CliError::Failed(format!("cannot make the folder {}: {error}", args.output.display())))?;
    let (mut rows, mut panels, mut outputs) = (Vec::new(), Vec::new(), Vec::new());
    let mut text = String::new();
    for (name, file, loaded) in scenes {
        let SceneFile { scene, dial, inputs, .. } = file;
        let names = dial.presets.iter().map(|preset| args.output.join(format!("{}.png", preset.name)));
        let names: Vec<PathBuf> = names.collect();
        let inputs: Vec<&Path> = inputs.iter().map(PathBuf::as_path).collect();
        files::check_outputs(&names.iter().collect::<Vec<_>>(), &inputs)?;

        let on_device = SceneRenderer::new(&renderer, scene, progress)?;
        let scene = on_device.scene();
        let before = renderer.marches();
        let clock = Stopwatch::start();
        let accumulators = on_device.march(args.size, progress)?;
        let marched = clock.read();
        let relight = renderer.relight_display(&accumulators)?;
        let stated = Mix::of_scene(scene);
        for (preset, path) in dial.presets.iter().zip(&names) {
            let (of_preset, _) = dial.preset(&preset.name).map_err(CliError::Failed)?;
            let mix = of_preset.mix(preset.hand, &stated);
            let clock = Stopwatch::start();
            relight.run(&on_device.matrices(&mix))?;
            let relit = clock.read();
            let rgb: Vec<u8> =
                relight.read()?.chunks_exact(4).flat_map(|pixel| [pixel[0], pixel[1], pixel[2]]).collect();
            write_ready_png(path, args.size[0], args.size[1], &rgb)?;
            let read = |error| CliError::Failed(format!("cannot read {} back: {error}", path.display()));
            let png = std::fs::read(path).map_err(read)?;
            let _ = writeln!(text, "{:<4} {}  {}", preset.name, path.display(), preset.caption);
            let lights = mix.0.iter().map(|light| json!({"name": light.name, "weight": light.weight}));
            rows.push(json!({
                "figure": name,
                "name": preset.name,
                "caption": preset.caption,
                "output": path.display().to_string(),
                "lights": lights.collect::<Vec<_>>(),
                "relight": relit,
            }));
            panels.push(Panel { name: preset.name.clone(), caption: preset.caption.clone(), png });
        }
        let _ = writeln!(
            text,
            "     one march of {} in {:.0} ms for {} pictures",
            scene.volume().source,
            marched.wall_ms,
            names.len()
        );
        outputs.push(json!({"figure": name, "marches": renderer.marches() - before, "dispatches": accumulators.dispatches, "load": loaded, "march": marched}));
    }
    let sheet = args.output.join("figures.html");
    write_atomically(&sheet, |out| out.write_all(contact_sheet(&panels).as_bytes()))?;
    let _ = writeln!(text, "all pictures with captions: {}", sheet.display());
    Ok(Report {
        text,
        json: json!({
            "pictures": rows,
            "figures": outputs,
            "sheet": sheet.display().to_string(),
            "size": args.size,
            "device": super::info::device_json(renderer.device().info()),
        }),
    })
}

/// Names of the figures' scenes.
pub(super) fn names() -> impl Iterator<Item = &'static str> {
    FIGURES.into_iter().map(|(name, ..)| name)
}

/// Scene of the figure `name`, on a phantom.
pub(super) fn scene(name: &str, options: &SceneOptions, progress: &dyn Progress) -> Result<SceneFile, CliError> {
    let text = FIGURES.into_iter().find(|(known, ..)| *known == name).map_or("", |(_, text, _)| text);
    Ok(document::parse(name, text, Path::new(""), options, progress)?)
}

/// Scene of a figure, on the volume from the command line if given.
fn load(args: &Args, name: &str, figure: &str, is_frog: bool, progress: &dyn Progress) -> Result<SceneFile, CliError> {
    let volume = if is_frog { &args.volume_frog } else { &args.volume_engine };
    let mut options = SceneOptions { volume: volume.clone(), ..SceneOptions::default() };
    if volume.is_some() {
        options.labels = args.labels.clone().filter(|_| is_frog);
        options.downsample = is_frog.then_some([2, 2, 1]);
        let real: Table = REAL.parse().map_err(|error| CliError::Failed(format!("data/figures/real.toml: {error}")))?;
        if let Some(changes) = real.get(name).and_then(|changes| changes.as_table()) {
            options.definitions = changes.iter().flat_map(|(key, value)| definitions(key, value)).collect();
        }
    }
    options.definitions.extend(args.define.definitions());
    Ok(document::parse(name, figure, Path::new(""), &options, progress)?)
}

/// Returns `key=value` for a value; a table whose other keys stay gives one definition per key.
fn definitions(key: &str, value: &toml::Value) -> Vec<Definition> {
    match value {
        toml::Value::Table(table) if ["transfer", "camera"].contains(&key) => {
            table.iter().flat_map(|(part, value)| definitions(&format!("{key}.{part}"), value)).collect()
        }
        _ => vec![Definition::new(&format!("{key}={value}"))],
    }
}

/// Contact sheet: all pictures with their captions in one self-contained HTML file.
fn contact_sheet(panels: &[Panel]) -> String {
    let mut body = String::new();
    for panel in panels {
        let _ = writeln!(
            body,
            "<figure><img alt=\"{0}\" src=\"data:image/png;base64,{1}\"><figcaption><b>{0}</b> {2}</figcaption></figure>",
            panel.name,
            BASE64.encode(&panel.png),
            panel.caption
        );
    }
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>Figures</title>\n<style>\n\
         body {{ font: 14px sans-serif; background: #181818; color: #e8e8e8; display: grid; gap: 16px; margin: 16px;\n\
         grid-template-columns: repeat(auto-fill, minmax(280px, 1fr)) }}\n\
         figure {{ margin: 0 }} img {{ width: 100%; display: block }} figcaption {{ padding: 6px 0 }}\n\
         </style>\n{body}</html>\n"
    )
}
