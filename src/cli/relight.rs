//! `relume relight`: a saved film under other lights.

use std::cell::LazyCell;
use std::path::PathBuf;
use std::sync::Arc;

use serde_json::json;

use crate::annotate::Overlay;
use crate::document::Requested;
use crate::film::{Components, automatic_exposure};
use crate::measure::{Stopwatch, Timing};
use crate::number::brief;
use crate::progress::Progress;
use crate::scene::Tone;
use crate::scene::key::Named as _;
use crate::spectrum::Spectrum;
use crate::spectrum::observer::Observer;

use super::accuracy::tolerance;
use super::dial::DialArgs;
use super::files::{self, DressArgs};
use super::frames::{AnimationArgs, Form, Frame, Frames, digest};
use super::scene::{LightArgs, add_placed, told_of_placed};
use super::{CliError, Report, model};

const EXAMPLES: &str = "\
Examples:
  relume render scene.toml -o day.png --accumulators acc.exr
  relume relight acc.exr --light A -o evening.png
  relume relight acc.exr --light FL11=0.7 --light \"blackbody 3000=0.3\" -o office.exr
  relume relight cells.exr --light DAPI:#ff00ff --light GFP=0.5 -o two.png        channels in other colours
  relume relight acc.exr --dial 0.3,-0.2 -o between.png
  relume relight acc.exr --sweep day..lamp --frames 50 -o evening.png        evening-0001.png to evening-0050.png
  relume relight acc.exr --loop --frames 100 -o lights.apng                  an animated PNG";

/// Arguments of `relume relight`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    /// Film file from `relume render --accumulators`.
    accumulators: PathBuf,
    #[command(flatten)]
    lights: LightArgs,
    #[command(flatten)]
    dial: DialArgs,
    #[command(flatten)]
    animation: AnimationArgs,
    /// CIE standard observer, of 1931 (2°) or 1964 (10°), in place of the file's.
    #[arg(long, value_name = "YEAR", value_parser = observer)]
    observer: Option<Observer>,
    /// Tolerance in ΔE00, in place of that of the file: warn if the error under a light outside the file may exceed it.
    #[arg(long, value_name = "DE", value_parser = tolerance, allow_negative_numbers = true)]
    tolerance: Option<f64>,
    /// Flags of `render` for the colour model, accepted here only to explain why they cannot apply.
    #[command(flatten)]
    planned: Planned,
    /// Picture to write (repeatable): .png is sRGB for the screen, .exr linear float RGB with opacity. A sweep or loop
    /// may write one animated PNG (.apng).
    #[arg(short, long, value_name = "FILE", required = true)]
    output: Vec<PathBuf>,
    /// Factor on the linear picture, in place of that of the file (display.exposure of the scene); auto makes the brighter parts of
    /// the first picture almost white.
    #[arg(long, value_name = "FACTOR|auto", value_parser = exposure)]
    exposure: Option<Exposure>,
    /// Curve of PNG files, in place of that of the file (display.tone of the scene): linear clips colours above white, soft lets
    /// them approach it with their hue.
    #[arg(long, value_name = "linear|soft", value_parser = tone)]
    tone: Option<Tone>,
    #[command(flatten)]
    dress: DressArgs,
}

/// A requested exposure.
#[derive(Clone, Copy, Debug)]
enum Exposure {
    Factor(f64),
    Auto,
}

/// Parses a factor on the linear picture.
fn exposure(text: &str) -> Result<Exposure, String> {
    if text == "auto" {
        return Ok(Exposure::Auto);
    }
    let number = text.parse().ok().filter(|&number: &f64| number > 0.0 && number <= 1e9);
    let wrong = || "write a factor above 0 and at most 1e9, such as 1.5, or auto".to_owned();
    number.map(Exposure::Factor).ok_or_else(wrong)
}

/// Parses the name of a curve.
fn tone(text: &str) -> Result<Tone, String> {
    Tone::named(text, "the curves")
}

/// Parses the year of an observer.
fn observer(year: &str) -> Result<Observer, String> {
    Observer::named(year, "the observers")
}

/// Settings that are fixed since the file was rendered.
#[derive(Debug, clap::Args)]
struct Planned {
    #[arg(long, hide = true, allow_hyphen_values = true)]
    k: Option<String>,
    #[arg(long, hide = true)]
    model: Option<String>,
    #[arg(long, hide = true)]
    accumulate: Option<String>,
    #[arg(long, hide = true)]
    replan: bool,
}

impl Planned {
    /// Refuses flags that only `render` can apply.
    fn check(&self) -> Result<(), CliError> {
        let given = [
            ("--k", self.k.is_some()),
            ("--model", self.model.is_some()),
            ("--accumulate", self.accumulate.is_some()),
            ("--replan", self.replan),
        ];
        match given.iter().find(|(_, given)| *given) {
            Some((flag, _)) => Err(CliError::Usage(format!(
                "{flag} is for `relume render`: a film file fixes what pixels store; render again with {flag}"
            ))),
            None => Ok(()),
        }
    }
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    args.planned.check()?;
    args.dress.check(&args.output)?;
    let pictures = Frames::new(&args.output, args.dial.pictures(), &args.animation)?;
    let outputs = pictures.files();
    let lights = args.lights.files();
    let inputs = lights.iter().chain([&args.accumulators]).map(PathBuf::as_path);
    files::check_outputs(&outputs.iter().collect::<Vec<_>>(), &inputs.collect::<Vec<_>>())?;
    let clock = Stopwatch::start();
    let mut saved = files::from_file(&args.accumulators)?;
    let film = if args.dial.pictures().is_some() { files::digest_of(&args.accumulators)? } else { 0 };
    let read = clock.read();
    if let Some(observer) = args.observer {
        saved.means.see_by(observer)?;
    }
    saved.means.display.tone = args.tone.unwrap_or(saved.means.display.tone);
    if let Some(Exposure::Factor(factor)) = args.exposure {
        saved.means.display.exposure = Some(factor);
    }
    let frame = args.dress.annotate.frame(saved.frame.clone().unwrap_or_default());
    args.dress.annotate.warn(&saved);
    let surfaces: Vec<Spectrum> = saved.materials.iter().map(|material| material.1.clone()).collect();
    let Requested { mix: given, placed } = args.lights.mix(&saved.mix, &saved.shown, &saved.positions, &surfaces)?;
    let on_dial = args.dial.is_given();

    let mut text = String::new();
    let mut model_json = json!(null);
    if let (Components::Surfaces(_), Some(_)) = (&saved.means.components, args.tolerance) {
        let file = args.accumulators.display();
        return Err(CliError::Usage(format!(
            "--tolerance has no effect: {file} stores material weights, which are exact for every light"
        )));
    }
    let clock = Stopwatch::start();
    if let Components::Model(model, _) = &mut saved.means.components {
        // The dial mixes lights of the file.
        let mix = if on_dial { &saved.mix } else { &given };
        let model = Arc::make_mut(model);
        let tolerance = args.tolerance.unwrap_or(saved.tolerance);
        let learnt = model::learn(model, mix, tolerance, "render again with this --light and --replan")?;
        (text, model_json) = (learnt.text(model), learnt.json(model));
    }
    let visible = LazyCell::new(|| saved.visible());
    let hand = args.dial.hand(&saved.dial, &saved.mix, |mix| saved.means.relight(&visible, mix))?;
    let mixes = hand.as_ref().map_or_else(|| vec![given], |hand| hand.mixes(&saved.mix));
    if let (Some(Exposure::Auto), Some(mix)) = (args.exposure, mixes.first()) {
        saved.means.display.exposure = None;
        let exposure = automatic_exposure(&saved.relight(mix), mix, &saved.means.display);
        saved.means.display.exposure = Some(exposure);
        text += &format!("exposure {}\n", brief(exposure));
    }
    let mut relit = clock.read();
    let whole = Stopwatch::start();
    let mut relighting = Timing::default();
    let backdrop = args.dress.backdrop(saved.means.display.backdrop, saved.means.background.is_some());
    let form = Form { size: saved.film.size, bits: args.dress.bits(), backdrop };
    let inputs_of =
        |frame: usize| digest(film, &format!("{:?} {:?} {:?}", mixes[frame], saved.means.display, args.dress));
    let made = pictures.write(form, ("relighting", progress), inputs_of, |index| {
        let clock = Stopwatch::start();
        let linear = saved.relight(&mixes[index]);
        relighting += clock.read();
        let overlay = args.dress.overlay(|| {
            Overlay::of_surfaces(&saved.materials, saved.positions.len(), &mixes[index], &saved.means.display)
        });
        let overlay = overlay.as_ref().map(|overlay| (overlay, &frame));
        let shown = files::dressed((&linear, saved.means.display.tone), form.size, form.backdrop, overlay)?;
        Ok(Frame { linear, shown })
    })?;
    let written = whole.read() - relighting;
    relit += relighting;
    let mut frames = Vec::new();
    for (frame, paths) in pictures.names() {
        let mix = &mixes[frame];
        let lights = mix.0.iter().map(
            |light| json!({"name": light.name, "position": saved.positions[light.position], "weight": light.weight}),
        );
        frames.push(json!({
            "dial": hand.as_ref().and_then(|hand| hand.places.get(frame)).map(|place| place.to_array()),
            "lights": lights.collect::<Vec<_>>(),
            "outputs": paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>(),
        }));
    }
    let listed: Vec<String> = outputs.iter().map(|path| path.display().to_string()).collect();
    let mut json = json!({
        "outputs": listed,
        "size": saved.film.size,
        "frames": frames,
        "pictures": pictures.json(made),
        "exposure": saved.means.display.factor(),
        "model": model_json,
        "times": {"load": read, "relight": relit, "write": written},
    });
    add_placed(&mut json, &placed);
    let told = told_of_placed(&placed) + &text;
    Ok(Report { text: format!("{}{told}relight {:.0} ms\n", pictures.told(made), relit.wall_ms), json })
}
