//! Pictures of an animation: numbered files, or one animated PNG.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

use clap::Args;

use crate::output::{Animation, Picture, PictureKind, inputs_of, numbered, write_apng};
use crate::progress::Progress;

use super::CliError;
use super::files::{self, Backdrop, Bits};

/// Arguments of every command that writes an animation.
#[derive(Debug, Args)]
pub(crate) struct AnimationArgs {
    /// Pictures per second of an animated PNG (.apng), and of the ffmpeg command that Relume prints for numbered ones.
    /// [default: 25]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=240))]
    fps: Option<u16>,
    /// Write only part I of N of the numbered pictures: pictures I, I+N, I+2N … Parts may run at the same time, on any
    /// number of machines. Pictures that an earlier run wrote from the same inputs are kept; 1/1 resumes a whole run.
    #[arg(long, value_name = "I/N", value_parser = part)]
    part: Option<Part>,
}

/// A share of the pictures of an animation.
#[derive(Clone, Copy, Debug)]
struct Part {
    /// Its number, from 1.
    number: u16,
    /// Number of parts.
    of: u16,
}

/// `I/N`
fn part(text: &str) -> Result<Part, String> {
    let numbers = text.split_once('/').and_then(|(number, of)| Some((number.parse().ok()?, of.parse().ok()?)));
    match numbers {
        Some((number, of)) if (1..=of).contains(&number) => Ok(Part { number, of }),
        _ => Err("write I/N with I from 1 to N, such as 3/16".to_owned()),
    }
}

impl AnimationArgs {
    /// True if the run writes a part of the pictures.
    pub(crate) fn is_part(&self) -> bool {
        self.part.is_some()
    }
}

/// A picture: linear RGBA, and what PNG files show if that differs.
pub(crate) struct Frame {
    pub(crate) linear: Vec<f32>,
    pub(crate) shown: Option<Vec<f32>>,
}

/// Form of the pictures.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Form {
    /// Width and height.
    pub(crate) size: [usize; 2],
    pub(crate) bits: Bits,
    pub(crate) backdrop: Option<Backdrop>,
}

/// The output files of a command: one picture each, or the frames of an animation.
pub(crate) struct Frames<'a> {
    outputs: &'a [PathBuf],
    /// Number of frames; `None` for a still picture.
    count: Option<u16>,
    fps: u16,
    part: Option<Part>,
}

/// Digest of the inputs of a picture; another version of the program has another one.
pub(crate) fn digest(of_run: u64, of_picture: &str) -> u64 {
    let mut hasher = DefaultHasher::new();
    (env!("CARGO_PKG_VERSION"), of_run, of_picture).hash(&mut hasher);
    hasher.finish()
}

/// Pictures per second without `--fps`.
const USUAL_FPS: u16 = 25;

/// Says how many pictures an unfinished animation has written.
fn warn_of_files(done: &[(usize, Vec<PathBuf>)]) {
    if let Some(last) = done.last().and_then(|(_, paths)| paths.last()) {
        tracing::warn!("pictures up to {} are written; later ones are missing or older", last.display());
    }
}

/// Whether `path` is an animated PNG.
fn is_apng(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("apng"))
}

/// Whether `path` is a film of a kind that Relume does not write.
fn is_video(path: &Path) -> bool {
    const VIDEOS: [&str; 9] = ["mp4", "m4v", "mov", "mkv", "avi", "webm", "ogv", "gif", "webp"];
    path.extension().is_some_and(|extension| VIDEOS.iter().any(|video| extension.eq_ignore_ascii_case(video)))
}

/// The refusal of the film `path`: what to write, and the command that makes the film of it.
fn no_video(path: &Path, args: &AnimationArgs) -> String {
    let numbered = path.with_extension("png");
    format!(
        "{}: Relume writes no such film; a still picture is a .png or an .exr; for an animation, write an animated PNG (-o \
         {}), or numbered pictures (-o {}), of which ffmpeg makes the film: {}",
        path.display(),
        path.with_extension("apng").display(),
        numbered.display(),
        film_command(&numbered, path, args.fps.unwrap_or(USUAL_FPS))
    )
}

/// The command that makes the film `film` of the numbered pictures of `path`.
fn film_command(path: &Path, film: &Path, fps: u16) -> String {
    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    // ffmpeg counts by the pattern, and films need even sides.
    let (stem, ending) = (part(path.file_stem()).replace('%', "%%"), part(path.extension()));
    let pattern = path.with_file_name(format!("{stem}-%04d.{ending}"));
    let is_picture = ["gif", "webp"].iter().any(|it| film.extension().is_some_and(|of| of.eq_ignore_ascii_case(it)));
    let form = if is_picture { "" } else { " -vf \"pad=ceil(iw/2)*2:ceil(ih/2)*2\" -pix_fmt yuv420p" };
    format!("ffmpeg -framerate {fps} -i {pattern:?}{form} {film:?}")
}

/// Whether `path` is a PNG of one picture.
fn is_png(path: &Path) -> bool {
    PictureKind::of(path).is_ok_and(|kind| kind == PictureKind::Png)
}

impl<'a> Frames<'a> {
    /// Refuses outputs of unknown kinds, an animated PNG of a still picture, and one beside other outputs.
    pub(crate) fn new(outputs: &'a [PathBuf], count: Option<u16>, args: &AnimationArgs) -> Result<Self, CliError> {
        let given = [("--fps", args.fps.is_some()), ("--part", args.part.is_some())];
        if let (None, Some((flag, _))) = (count, given.iter().find(|(_, given)| *given)) {
            return Err(CliError::Usage(format!("{flag} is for an animation: --turntable, --sweep or --loop")));
        }
        if count.is_some() && outputs.is_empty() {
            return Err(CliError::Usage(
                "an animation is written as pictures: add -o FILE.png (FILE-0001.png and so on), or -o FILE.apng"
                    .to_owned(),
            ));
        }
        if args.fps.is_some() && !outputs.iter().any(|path| files::is_shown(path) || is_video(path)) {
            return Err(CliError::Usage(
                "--fps has no effect: numbered EXR files have no time; it is for .apng, and for films of .png files"
                    .to_owned(),
            ));
        }
        for path in outputs {
            if is_video(path) {
                return Err(CliError::Usage(no_video(path, args)));
            }
            match (is_apng(path), count) {
                (true, None) => {
                    let name = path.display();
                    return Err(CliError::Usage(format!("{name}: a still picture is a .png or an .exr")));
                }
                (true, Some(_)) if args.part.is_some() => {
                    let name = path.display();
                    return Err(CliError::Usage(format!(
                        "{name}: an animated PNG has no parts; write numbered pictures (.png or .exr), and make the film of them"
                    )));
                }
                (true, Some(_)) if outputs.len() > 1 => {
                    let name = path.display();
                    return Err(CliError::Usage(format!("{name}: an animated PNG must be the only output")));
                }
                (true, Some(_)) => {}
                (false, _) => drop(files::picture_kind(path)?),
            }
        }
        Ok(Self { outputs, count, fps: args.fps.unwrap_or(USUAL_FPS), part: args.part })
    }

    /// The animated PNG, if that is the output.
    fn apng(&self) -> Option<&'a Path> {
        self.outputs.first().map(PathBuf::as_path).filter(|path| is_apng(path))
    }

    /// Number of pictures.
    pub(crate) fn count(&self) -> u16 {
        self.count.unwrap_or(1)
    }

    /// Index and files of each frame of this part, in their order; an animated PNG is the file of all frames.
    pub(crate) fn names(&self) -> Vec<(usize, Vec<PathBuf>)> {
        let Part { number, of } = self.part.unwrap_or(Part { number: 1, of: 1 });
        let numbers = (1..=self.count()).filter(|n| (n - 1) % of == number - 1);
        let files = |n: u16| match self.count {
            Some(_) if self.apng().is_none() => self.outputs.iter().map(|path| numbered(path, n)).collect(),
            _ => self.outputs.to_vec(),
        };
        numbers.map(|n| (usize::from(n - 1), files(n))).collect()
    }

    /// All files, each once.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = self.names().into_iter().flat_map(|(_, paths)| paths).collect();
        files.dedup();
        files
    }

    /// Writes the pictures of this part, and returns their number. `frame` makes picture 0, 1, …, and `inputs` returns the
    /// digest of what it is made of. Pictures that have this digest already are kept, but only if the part was named.
    pub(crate) fn write(
        &self,
        form: Form,
        (stage, progress): (&str, &dyn Progress),
        inputs: impl Fn(usize) -> u64,
        mut frame: impl FnMut(usize) -> Result<Frame, CliError>,
    ) -> Result<usize, CliError> {
        let Form { size: [width, height], bits, backdrop } = form;
        let alpha = files::alpha(backdrop);
        let names = self.names();
        let mut reported = |done: usize, index: usize| {
            if progress.cancelled() {
                return Err(CliError::Cancelled);
            }
            progress.report(stage, done as u64, names.len() as u64);
            frame(index)
        };
        if let Some(path) = self.apng() {
            let animation = Animation { frames: self.count().into(), per_second: self.fps };
            let shown = |index| reported(index, index).map(|it| it.shown.unwrap_or(it.linear));
            write_apng(path, form.size, animation, bits.depth(), alpha, shown)?;
            return Ok(names.len());
        }
        let mut written = 0;
        for (done, (index, paths)) in names.iter().enumerate() {
            let digest = self.count.map(|_| digest(inputs(*index), &format!("{form:?}")));
            let is_kept = |path: &PathBuf| digest.is_some() && inputs_of(path, form.size) == digest;
            if self.part.is_some() && paths.iter().all(is_kept) {
                continue;
            }
            let Frame { linear, shown } = reported(done, *index).inspect_err(|_| warn_of_files(&names[..done]))?;
            for path in paths {
                let shown = shown.as_ref().filter(|_| is_png(path)).unwrap_or(&linear);
                let picture = Picture::new(width, height, shown)?;
                let picture = digest.map_or(picture, |digest| picture.made_of(digest));
                files::write_linear(path, &picture, bits, alpha)?;
            }
            written += 1;
        }
        self.warn_of_longer();
        Ok(written)
    }

    /// Says that pictures of a longer animation lie behind those of this one.
    fn warn_of_longer(&self) {
        let Some(next) = self.count.and_then(|count| count.checked_add(1)) else { return };
        for path in self.outputs.iter().map(|path| numbered(path, next)).filter(|path| path.exists()) {
            tracing::warn!(
                "{} is of another animation, which was longer, and ffmpeg takes it for this one too; delete it and those after \
                 it, or give each animation its own name",
                path.display()
            );
        }
    }

    /// The part of the animation, if one was named, and what was `written` of it and kept.
    pub(crate) fn json(&self, written: usize) -> serde_json::Value {
        let part = self.part.map(|Part { number, of }| [number, of]);
        serde_json::json!({"part": part, "written": written, "kept": self.names().len().saturating_sub(written)})
    }

    /// The command that makes a film of the numbered PNGs of `path`.
    fn film(&self, path: &Path) -> String {
        format!(
            "for a film{}: {}\n",
            if self.part.is_some() { " of all parts" } else { "" },
            film_command(path, &path.with_extension("mp4"), self.fps)
        )
    }

    /// The files in one line, `written` of them by this run, and for numbered PNGs the command that makes a film of them.
    pub(crate) fn told(&self, written: usize) -> String {
        let files = self.files();
        let listed = match (self.count, &files[..]) {
            (Some(_), [first, .., last]) => format!("{} to {}", first.display(), last.display()),
            (_, all) => all.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", "),
        };
        let films = || self.outputs.iter().filter(|path| is_png(path)).map(|path| self.film(path)).collect::<String>();
        match self.part {
            Some(_) if files.is_empty() => {
                format!("nothing to write: there are {} pictures, fewer than parts\n", self.count())
            }
            Some(Part { number, of }) => {
                let kept = self.names().len() - written;
                format!("part {number} of {of}: wrote {written} and kept {kept} of the pictures {listed}\n{}", films())
            }
            None if files.len() > 1 && self.count.is_some() => format!("wrote {listed}\n{}", films()),
            None => format!("wrote {listed}\n"),
        }
    }
}
