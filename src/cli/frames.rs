//! Pictures of an animation: numbered files, or one animated PNG.

use std::path::{Path, PathBuf};

use clap::Args;

use relume::output::{Alpha, Animation, PictureKind, numbered, write_apng};

use super::CliError;
use super::files::{self, Bits};

/// Arguments of every command that writes an animation.
#[derive(Debug, Args)]
pub(crate) struct SpeedArgs {
    /// Pictures per second of an animated PNG (.apng), and of the ffmpeg command that Relume prints for numbered ones.
    /// [default: 25]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=240))]
    fps: Option<u16>,
}

/// A picture: linear RGBA, and what PNG files show if that differs.
pub(crate) struct Frame {
    pub(crate) linear: Vec<f32>,
    pub(crate) shown: Option<Vec<f32>>,
}

/// The output files of a command: one picture each, or the frames of an animation.
pub(crate) struct Frames<'a> {
    outputs: &'a [PathBuf],
    /// Number of frames; `None` for a still picture.
    count: Option<u16>,
    fps: u16,
}

/// Pictures per second without `--fps`.
const USUAL_FPS: u16 = 25;

/// Says how many pictures an unfinished animation has written.
fn warn_of_files(frames: usize, names: &[Vec<PathBuf>]) {
    if let Some(last) = names[..frames].last().and_then(|paths| paths.last()) {
        tracing::warn!("pictures up to {} are written; later ones are missing or older", last.display());
    }
}

/// Whether `path` is an animated PNG.
fn is_apng(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("apng"))
}

/// Whether `path` is a PNG of one picture.
fn is_png(path: &Path) -> bool {
    PictureKind::of(path).is_ok_and(|kind| kind == PictureKind::Png)
}

impl<'a> Frames<'a> {
    /// Refuses outputs of unknown kinds, an animated PNG of a still picture, and one beside other outputs.
    pub(crate) fn new(outputs: &'a [PathBuf], count: Option<u16>, speed: &SpeedArgs) -> Result<Self, CliError> {
        if count.is_none() && speed.fps.is_some() {
            return Err(CliError::Usage("--fps is for an animation: --turntable, --sweep or --loop".into()));
        }
        for path in outputs {
            match (is_apng(path), count) {
                (true, None) => {
                    let name = path.display();
                    return Err(CliError::Usage(format!("{name}: a still picture is a .png or an .exr")));
                }
                (true, Some(_)) if outputs.len() > 1 => {
                    let name = path.display();
                    return Err(CliError::Usage(format!("{name}: an animated PNG must be the only output")));
                }
                (true, Some(_)) => {}
                (false, _) => drop(files::picture_kind(path)?),
            }
        }
        Ok(Self { outputs, count, fps: speed.fps.unwrap_or(USUAL_FPS) })
    }

    /// The animated PNG, if that is the output.
    fn apng(&self) -> Option<&'a Path> {
        self.outputs.first().map(PathBuf::as_path).filter(|path| is_apng(path))
    }

    /// Number of pictures.
    pub(crate) fn count(&self) -> u16 {
        self.count.unwrap_or(1)
    }

    /// Files of each frame; an animated PNG is the file of all frames.
    pub(crate) fn names(&self) -> Vec<Vec<PathBuf>> {
        match self.count {
            Some(count) if self.apng().is_none() => {
                (1..=count).map(|n| self.outputs.iter().map(|path| numbered(path, n)).collect()).collect()
            }
            _ => vec![self.outputs.to_vec(); self.count().into()],
        }
    }

    /// All files, each once.
    pub(crate) fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = self.names().into_iter().flatten().collect();
        files.dedup();
        files
    }

    /// Writes all pictures; `frame` makes picture 0, 1, ….
    pub(crate) fn write(
        &self,
        size: [usize; 2],
        bits: Bits,
        alpha: Alpha,
        mut frame: impl FnMut(usize) -> Result<Frame, CliError>,
    ) -> Result<(), CliError> {
        if let Some(path) = self.apng() {
            let animation = Animation { frames: self.count().into(), per_second: self.fps };
            let shown = |index| frame(index).map(|it| it.shown.unwrap_or(it.linear));
            return write_apng(path, size, animation, bits.depth(), alpha, shown);
        }
        let names = self.names();
        for (index, paths) in names.iter().enumerate() {
            let Frame { linear, shown } = frame(index).inspect_err(|_| warn_of_files(index, &names))?;
            for path in paths {
                let shown = shown.as_ref().filter(|_| is_png(path));
                files::write_linear(path, size, shown.unwrap_or(&linear), bits, alpha)?;
            }
        }
        Ok(())
    }

    /// The written files in one line, and for numbered PNGs the command that makes a film of them.
    pub(crate) fn told(&self) -> String {
        let files = self.files();
        match (self.count, &files[..]) {
            (Some(_), [first, .., last]) => {
                let film = |path: &PathBuf| {
                    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
                    // ffmpeg counts by the pattern, and its film needs even sides.
                    let (stem, ending) = (part(path.file_stem()).replace('%', "%%"), part(path.extension()));
                    let pattern = path.with_file_name(format!("{stem}-%04d.{ending}"));
                    format!(
                        "for a film: ffmpeg -framerate {} -i {:?} -vf \"pad=ceil(iw/2)*2:ceil(ih/2)*2\" -pix_fmt yuv420p {:?}\n",
                        self.fps,
                        pattern,
                        path.with_extension("mp4")
                    )
                };
                let pngs = self.outputs.iter().filter(|path| is_png(path));
                format!("{} to {}\n{}", first.display(), last.display(), pngs.map(film).collect::<String>())
            }
            (_, all) => {
                let all: Vec<String> = all.iter().map(|path| path.display().to_string()).collect();
                format!("{}\n", all.join(", "))
            }
        }
    }
}
