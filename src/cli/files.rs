//! Films and pictures in files.

use std::fs::File;
use std::hash::{DefaultHasher, Hasher};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use glam::DVec3;
use serde_json::Value;

use crate::annotate::{Frame, Overlay};
use crate::document::KeptFilm;
use crate::film::{Components, Film, Relightable};
use crate::memory;
use crate::output::{Alpha, Depth, FilmFile, Picture, PictureKind, check_writable, draw_over, write_exr, write_png};
use crate::scene::{self, Mix, Tone};
use crate::spectrum::colour::decode_srgb;
use crate::tables::Reflected;

use super::CliError;
use super::model::reconstruction_json;

/// Bits of a PNG's channels.
#[derive(Clone, Copy, Debug, PartialEq, Hash, ValueEnum)]
pub(crate) enum Bits {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

impl Bits {
    pub(crate) fn depth(self) -> Depth {
        if self == Self::Sixteen { Depth::Sixteen } else { Depth::Eight }
    }
}

/// Kind of the picture `path`, by its extension.
pub(crate) fn picture_kind(path: &Path) -> Result<PictureKind, CliError> {
    PictureKind::of(path).map_err(|error| CliError::Usage(error.to_string()))
}

/// Form, background and annotations of PNG files.
#[derive(Debug, Args)]
pub(crate) struct DressArgs {
    /// Bits per channel of a PNG. [default: 8]
    #[arg(long, value_enum)]
    bits: Option<Bits>,
    /// Put a colour behind the picture, or two with a gradient from top to bottom, or leave the background transparent (alpha
    /// in PNG; EXR files always keep opacity): transparent for programs that mix linear light, transparent-srgb for those that
    /// mix codes, as browsers and slides do.
    /// No light changes this colour. The lights do change `background` of a scene, which is a surface. Default: the backdrop of
    /// the scene (display.backdrop), or black.
    #[arg(long, value_name = "transparent|transparent-srgb|#RRGGBB[..#RRGGBB]", value_parser = backdrop)]
    pub(crate) background: Option<Backdrop>,
    #[command(flatten)]
    pub(crate) annotate: AnnotateArgs,
}

/// Annotations of a picture.
#[derive(Debug, Args)]
pub(crate) struct AnnotateArgs {
    /// Draw annotations into PNG files: all, or those of a list such as scale,legend. scale is a scale bar, letters are those of
    /// the orientation (for anatomical volumes), legend lists materials and lights, and title is that of --title.
    #[arg(long = "annotate", value_name = "LIST", num_args = 0..=1, require_equals = true, default_missing_value = "all")]
    #[arg(value_parser = annotations)]
    annotate: Option<Annotations>,
    /// Title of an annotated picture.
    #[arg(long, value_name = "TEXT", requires = "annotate")]
    title: Option<String>,
}

/// The annotations that `--annotate` lists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Annotations {
    scale: bool,
    letters: bool,
    legend: bool,
    title: bool,
    /// All of them, without a list: a title as well if there is one.
    all: bool,
}

/// Names of annotations on the command line.
pub(crate) const ANNOTATIONS: [&str; 4] = ["scale", "letters", "legend", "title"];

/// Parses a list of annotations, or `all`.
fn annotations(text: &str) -> Result<Annotations, String> {
    let all = text == "all";
    let listed: Vec<&str> = if all { ANNOTATIONS.to_vec() } else { text.split(',').map(str::trim).collect() };
    match listed.iter().find(|name| !ANNOTATIONS.contains(*name)) {
        Some(name) => Err(format!("there is no annotation {name:?}; there are {}", ANNOTATIONS.join(", "))),
        None => {
            let [scale, letters, legend, title] = ANNOTATIONS.map(|name| listed.contains(&name));
            Ok(Annotations { scale, letters, legend, title, all })
        }
    }
}

impl AnnotateArgs {
    /// Whether there are annotations.
    pub(crate) fn is_given(&self) -> bool {
        self.annotate.is_some()
    }

    /// Whether there is a scale bar.
    pub(crate) fn has_scale(&self) -> bool {
        self.annotate.is_some_and(|chosen| chosen.scale)
    }

    /// Refuses a title that is not listed, and a listed one that is not given.
    pub(crate) fn check(&self) -> Result<(), CliError> {
        match (self.annotate, &self.title) {
            (Some(Annotations { title: false, .. }), Some(title)) => {
                Err(CliError::Usage(format!("--title {title:?} has no effect: --annotate does not list title")))
            }
            (Some(Annotations { title: true, all: false, .. }), None) => {
                Err(CliError::Usage("--annotate lists title; add --title TEXT".to_owned()))
            }
            _ => Ok(()),
        }
    }

    /// What the chosen annotations show of `whole`, over a `bright` background or a dark one.
    pub(crate) fn overlay<'a>(&'a self, bright: bool, whole: impl FnOnce() -> Overlay<'a>) -> Option<Overlay<'a>> {
        let chosen = self.annotate?;
        let whole = if chosen.legend { whole() } else { Overlay::default() };
        Some(Overlay { title: self.title.as_deref(), bright, ..whole })
    }

    /// What the chosen annotations show of `frame`.
    pub(crate) fn frame(&self, frame: Frame) -> Frame {
        let chosen = self.annotate;
        Frame {
            pixel: frame.pixel.filter(|_| chosen.is_some_and(|it| it.scale)),
            unit: frame.unit,
            edges: frame.edges.filter(|_| chosen.is_some_and(|it| it.letters)),
        }
    }

    /// Says which annotations a film has no information for.
    pub(crate) fn warn(&self, saved: &KeptFilm) {
        let Some(Annotations { scale, letters, legend, .. }) = self.annotate else { return };
        if saved.frame.is_none() && (scale || letters) {
            tracing::warn!(
                "the film does not state the scale of its picture, so there are no scale bar and no letters; films of this \
                 version of `relume render` state it"
            );
        }
        if saved.materials.is_empty() && legend {
            tracing::warn!(
                "the film stores a colour model and no materials, so the legend lists lights alone; {KEEPS}"
            );
        }
    }
}

/// Hint for films without materials.
pub(crate) const KEEPS: &str = "render it with --accumulate weights to keep them";

impl DressArgs {
    /// Bits per channel of PNG files.
    pub(crate) fn bits(&self) -> Bits {
        self.bits.unwrap_or(Bits::Eight)
    }

    /// The backdrop of PNG files: the requested one, or else that which a scene states if it has no background.
    pub(crate) fn backdrop(&self, stated: scene::Backdrop, has_background: bool) -> Option<Backdrop> {
        let of_scene = stated.colours().filter(|_| !has_background).map(Backdrop::Colours);
        self.background.or(of_scene)
    }

    /// Refuses flags for PNG files if none of `pictures` is one.
    pub(crate) fn check(&self, pictures: &[PathBuf]) -> Result<(), CliError> {
        let flags = [
            ("--bits", self.bits.is_some()),
            ("--background", self.background.is_some()),
            ("--annotate", self.annotate.is_given()),
        ];
        match flags.into_iter().find(|(_, given)| *given).filter(|_| !pictures.iter().any(|path| is_shown(path))) {
            Some((flag, _)) => Err(CliError::Usage(format!(
                "{flag} has no effect: it is for PNG files, and none is written; add -o FILE.png"
            ))),
            None => self.annotate.check(),
        }
    }

    /// The overlay of the chosen annotations of `whole`, if any are chosen.
    pub(crate) fn overlay<'a>(&'a self, whole: impl FnOnce() -> Overlay<'a>) -> Option<Overlay<'a>> {
        self.annotate.overlay(self.background.is_some_and(Backdrop::is_bright), whole)
    }
}

/// Whether `path` is a PNG of one picture or of an animation, which show pictures as a screen does.
pub(crate) fn is_shown(path: &Path) -> bool {
    path.extension().is_some_and(|it| it.eq_ignore_ascii_case("png") || it.eq_ignore_ascii_case("apng"))
}

/// The background of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Backdrop {
    /// Nothing: PNG files get an alpha channel.
    Transparent,
    /// The same, for programs that mix codes of sRGB.
    TransparentForCodes,
    /// Colours of the screen at the top and at the bottom, as parts of the codes of sRGB, which no light changes, and others
    /// between them.
    Colours([[f64; 3]; 2]),
}

/// Parses `transparent`, `#rrggbb` or `#rrggbb..#rrggbb`.
pub(crate) fn backdrop(text: &str) -> Result<Backdrop, String> {
    let colour = |text: &str| {
        let digits = text.strip_prefix('#').filter(|digits| digits.len() == 6)?;
        let code = |at: usize| Some(f64::from(u8::from_str_radix(digits.get(at..at + 2)?, 16).ok()?) / 255.0);
        Some([code(0)?, code(2)?, code(4)?])
    };
    let (top, bottom) = text.split_once("..").unwrap_or((text, text));
    match (text, colour(top), colour(bottom)) {
        ("transparent", ..) => Ok(Backdrop::Transparent),
        ("transparent-srgb", ..) => Ok(Backdrop::TransparentForCodes),
        (_, Some(top), Some(bottom)) => Ok(Backdrop::Colours([top, bottom])),
        _ => Err("write transparent, transparent-srgb, a colour such as #ffffff, or two from top to bottom, such as \
                  #202838..#000000"
            .to_owned()),
    }
}

impl Backdrop {
    /// Whether dark letters are easier to read on it than bright ones.
    pub(crate) fn is_bright(self) -> bool {
        // Relative luminance of mid grey, L* = 50.
        let Self::Colours([top, bottom]) = self else { return false };
        let [red, green, blue] = [0, 1, 2].map(|channel| decode_srgb(f64::midpoint(top[channel], bottom[channel])));
        0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.18
    }

    /// The picture of linear RGBA, `width` pixels wide, over this backdrop.
    pub(crate) fn behind(self, rgba: &mut [f32], width: usize) {
        if let Self::Colours(colours) = self {
            scene::Backdrop::behind(colours, rgba, width);
        }
    }
}

/// Opacity of the PNG files of pictures over `backdrop`.
pub(crate) fn alpha(backdrop: Option<Backdrop>) -> Alpha {
    match backdrop {
        Some(Backdrop::Transparent) => Alpha::Kept,
        Some(Backdrop::TransparentForCodes) => Alpha::KeptForCodes,
        None | Some(Backdrop::Colours(_)) => Alpha::OverBlack,
    }
}

/// Linear RGBA of `size` as `tone` displays it, with the backdrop behind it, and the overlay of a picture of this frame over it;
/// `None` where that changes nothing.
pub(crate) fn dressed(
    (linear, tone): (&[f32], Tone),
    size: [usize; 2],
    backdrop: Option<Backdrop>,
    overlay: Option<(&Overlay<'_>, &Frame)>,
) -> Result<Option<Vec<f32>>, CliError> {
    if backdrop.is_none() && overlay.is_none() && tone == Tone::Linear {
        return Ok(None);
    }
    let mut rgba = linear.to_vec();
    tone.show(&mut rgba);
    if let Some(backdrop) = backdrop {
        backdrop.behind(&mut rgba, size[0]);
    }
    if let Some((overlay, frame)) = overlay
        && !draw_over(Path::new("annotations"), &overlay.svg(frame, size), size[0], &mut rgba)?
    {
        tracing::warn!("this system has no fonts, so the annotations have no text; install fonts-dejavu-core");
    }
    Ok(Some(rgba))
}

/// Refuses a picture of `size`, of so many bytes a pixel, that exceeds the free memory.
pub(crate) fn check_memory([width, height]: [usize; 2], pixel_bytes: usize) -> Result<(), CliError> {
    let bytes = width.saturating_mul(height).saturating_mul(pixel_bytes);
    match memory::available_bytes() {
        Some(available) if u64::try_from(bytes).is_ok_and(|bytes| bytes > available) => Err(CliError::Failed(format!(
            "a picture of {width}×{height} pixels needs {bytes} bytes of memory, and {available} are free; use a smaller --size"
        ))),
        _ => Ok(()),
    }
}

/// Writes `picture` to `path`; PNG files treat opacity by `alpha`.
pub(crate) fn write_linear(path: &Path, picture: &Picture<'_>, bits: Bits, alpha: Alpha) -> Result<(), CliError> {
    match picture_kind(path)? {
        PictureKind::Exr => write_exr(path, picture)?,
        PictureKind::Png => write_png(path, picture, bits.depth(), alpha)?,
    }
    Ok(())
}

/// Converts linear sRGB and opacity to RGBA in f32.
#[expect(clippy::cast_possible_truncation, reason = "pictures are stored in f32")]
pub(crate) fn rgba(pixels: impl Iterator<Item = (DVec3, f64)>) -> Vec<f32> {
    pixels.flat_map(|(c, opacity)| [c.x as f32, c.y as f32, c.z as f32, opacity as f32]).collect()
}

/// Digest of the bytes of a file that was read before.
pub(crate) fn digest_of(path: &Path) -> Result<u64, CliError> {
    let unreadable = |error: std::io::Error| CliError::Failed(format!("cannot read {}: {error}", path.display()));
    let mut file = BufReader::new(File::open(path).map_err(unreadable)?);
    let mut hasher = DefaultHasher::new();
    loop {
        let bytes = file.fill_buf().map_err(unreadable)?;
        if bytes.is_empty() {
            return Ok(hasher.finish());
        }
        hasher.write(bytes);
        let read = bytes.len();
        file.consume(read);
    }
}

/// Says that the `film` at `path` lacks blocks of the volume.
pub(crate) fn warn_of_part(path: &Path, film: &FilmFile) {
    if let Some(part) = &film.part {
        let (path, named) = (path.display(), part.named());
        tracing::warn!("{path} is a part of a film: {named}; `relume composite` makes the whole film");
    }
}

/// Reads the film file `path`.
pub(crate) fn from_file(path: &Path) -> Result<KeptFilm, CliError> {
    let file = FilmFile::read(path)?;
    warn_of_part(path, &file);
    Ok(KeptFilm::new(file)?)
}

/// Writes the spectrum of every pixel under `mix`; returns the errors of reconstructed spectra as JSON.
pub(crate) fn write_spectra(
    path: &Path,
    means: &Relightable,
    mix: &Mix,
    accumulation: &Film<f32>,
    preview: &[f32],
) -> Result<Option<Value>, CliError> {
    let reflected = Reflected::new(&means.components, means.background.as_ref());
    let under = reflected.under(mix, means.positions);
    let [width, height] = accumulation.size;
    let quality = match (&means.components, &reflected.reconstruction) {
        (Components::Model(model, _), Some(made)) => Some(reconstruction_json(model, made)),
        _ => None,
    };
    let note = quality.as_ref().map(Value::to_string);
    let notes: Vec<(&str, &str)> = note.iter().map(|text| ("relumeReconstruction", text.as_str())).collect();
    crate::output::write_spectral(path, width, height, &notes, |y, row| {
        Reflected::write(&under, accumulation, y * width, row.radiance.as_flattened_mut());
        for (x, colour) in row.preview.iter_mut().enumerate() {
            colour.copy_from_slice(&preview[(y * width + x) * 4..][..3]);
        }
    })?;
    Ok(quality)
}

/// Refuses outputs that cannot be written, or that would overwrite an input or each other, before any work is done.
pub(crate) fn check_outputs(outputs: &[&PathBuf], inputs: &[&Path]) -> Result<(), CliError> {
    let mut real = Vec::new();
    for output in outputs {
        let this = std::fs::canonicalize(output).ok().or_else(|| {
            // Output files may not exist yet, but their folders do.
            let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
            Some(std::fs::canonicalize(folder).ok()?.join(output.file_name()?))
        });
        if this.is_some() && inputs.iter().any(|input| std::fs::canonicalize(input).ok() == this) {
            return Err(CliError::Usage(format!("{} is an input; write the result elsewhere", output.display())));
        }
        if this.is_some() && real.contains(&this) {
            return Err(CliError::Usage(format!("{} is named twice as an output", output.display())));
        }
        check_writable(output)?;
        real.push(this);
    }
    Ok(())
}
