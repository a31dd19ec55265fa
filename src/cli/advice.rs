//! Flags that help against an error.

use std::error::Error;
use std::io;
use std::path::Path;

use crate::document::SceneError;
use crate::measure::{Goal, LadderError, MeasureError};
use crate::model::{ModelError, ModelKind};
use crate::number::edit_distance;
use crate::output::OutputError;
use crate::output::page::PageError;
use crate::render::RenderError;
use crate::volume::{self, Asked, ByteOrder, RawLayout, Several, VolumeError};

use super::CliError;

/// Returns the sentence of `error` alone, without its causes, with the flags that help.
pub(super) fn sentence(error: &(dyn Error + 'static)) -> String {
    if let Some(SceneError::LightRequest { .. }) = scene(error) {
        return format!("--light {error}");
    }
    format!("{error}{}", flags(error).unwrap_or_default())
}

/// The sentences of `error` and of its causes.
pub(super) fn sentences<'a>(error: &'a (dyn Error + 'static)) -> impl Iterator<Item = String> + 'a {
    let mut of_labels = false;
    std::iter::successors(Some(error), |&error| error.source()).map(move |error| {
        // The flags choose a volume, not labels.
        let told = if of_labels { error.to_string() } else { sentence(error) };
        of_labels |= matches!(scene(error), Some(SceneError::Labels { .. }));
        told
    })
}

/// The error of a scene in `error`.
fn scene<'a>(error: &'a (dyn Error + 'static)) -> Option<&'a SceneError> {
    match error.downcast_ref() {
        Some(CliError::Scene(error)) => Some(error),
        _ => error.downcast_ref(),
    }
}

/// Flags that help against `error`, as the end of its sentence. A transparent error passes on those of its cause.
fn flags(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(error) = error.downcast_ref() {
        return match error {
            CliError::Scene(error) => flags(error),
            CliError::Volume(error) => flags(error),
            CliError::Render(error) => flags(error),
            CliError::Plan(error) => flags(error),
            CliError::Output(error) => of_output(error),
            CliError::Page(error) => of_page(error),
            CliError::Measure(error) => flags(error),
            CliError::Check(error) => flags(error),
            _ => None,
        };
    }
    if let Some(error) = error.downcast_ref() {
        return match error {
            MeasureError::None { goal: Goal::MaxError(_), .. } => {
                Some("; allow a larger error, or use --reference".into())
            }
            MeasureError::None { goal: Goal::Budget(_), .. } => {
                Some("; allow more time, or fewer pixels with --size".into())
            }
            MeasureError::Plan(error) => flags(error),
            MeasureError::Ladder(error) => flags(error),
            MeasureError::Render(error) => flags(error),
            _ => None,
        };
    }
    if let Some(LadderError::Volume(error)) = error.downcast_ref() {
        return flags(error);
    }
    let of_scene = error.downcast_ref().and_then(of_scene);
    let of_volume = error.downcast_ref().and_then(of_volume);
    let of_render = error.downcast_ref().and_then(of_render);
    let of_model = error.downcast_ref().and_then(of_model);
    of_scene.or(of_volume).or(of_render).or(of_model)
}

/// Scenes and volumes of the folder of `path`, for the error that there is no such file.
fn instead_of(path: &Path, error: &io::Error) -> Option<String> {
    const LISTED: usize = 5;
    /// One letter more, less or other, or two swaps of neighbours.
    const SLIP: usize = 2;
    if error.kind() != io::ErrorKind::NotFound {
        return None;
    }
    if let Ok(target) = std::fs::read_link(path) {
        return Some(format!("; it is a link to {}, which does not exist", target.display()));
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let folder = std::path::absolute(folder).ok()?;
    let Ok(entries) = std::fs::read_dir(&folder) else {
        return Some(format!("; there is no folder {}", folder.display()));
    };
    let is_known = |name: &String| {
        let name = name.to_lowercase();
        volume::extensions().chain(["toml"]).any(|it| name.ends_with(&format!(".{it}")))
    };
    let mut names: Vec<String> = entries.flatten().map(|it| it.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let distance = |it: &String| edit_distance(&it.to_lowercase(), &name.to_lowercase());
    let nearest = names.iter().map(|it| (distance(it), it)).min();
    if let Some((_, meant)) = nearest.filter(|&(distance, _)| distance <= SLIP) {
        return Some(format!("; did you mean {}?", path.with_file_name(meant).display()));
    }
    names.retain(is_known);
    let more = if names.len() > LISTED { ", …" } else { "" };
    names.truncate(LISTED);
    let has = if names.is_empty() { "no scene and no volume".to_owned() } else { names.join(", ") };
    Some(format!("; {} has {has}{more}", folder.display()))
}

fn of_scene(error: &SceneError) -> Option<String> {
    match error {
        SceneError::Read { path, source } => instead_of(path, source),
        SceneError::IsVolume { path } => Some(format!(": use --volume {}", path.display())),
        SceneError::TooLong { .. } | SceneError::NoText { .. } => Some("; if it is a volume, use --volume".to_owned()),
        SceneError::NoVolume { .. } => Some(", or give one with --volume FILE".to_owned()),
        SceneError::NoScene(error) => of_volume(error),
        _ => None,
    }
}

/// Whether the extension of `path` is `extension`.
fn ends_in(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|it| it.eq_ignore_ascii_case(extension))
}

fn of_output(error: &OutputError) -> Option<String> {
    match error {
        OutputError::Parts { .. } => {
            Some("; relume render --block I/N --accumulators FILE.exr makes the parts".to_owned())
        }
        OutputError::Missing { missing, blocks, is_part, .. } => {
            let first = missing.first().map_or(1, |gap| gap[0]);
            let partial = if *is_part { ", or add --partial to composite these to a larger part" } else { "" };
            Some(format!(
                "; relume render --block {first}/{blocks} --accumulators FILE.exr makes the first of them{partial}"
            ))
        }
        OutputError::Damaged { path, .. } if ["png", "jpg", "jpeg"].iter().any(|it| ends_in(path, it)) => Some(
            "; a picture cannot be relit: relume render … --accumulators film.exr writes a film, and relume relight \
             film.exr reads it"
                .to_owned(),
        ),
        OutputError::Damaged { path, detail } if ends_in(path, "exr") && detail.contains("missing bytes") => {
            Some("; the file ends too early: it was cut off, or is still being written".to_owned())
        }
        OutputError::Damaged { path, .. } | OutputError::NotAccumulators { path, .. } if !ends_in(path, "exr") => {
            Some(format!(
                "; for a scene or a volume, use relume render {0} -o picture.png, which saves its film with --accumulators film.exr",
                path.display()
            ))
        }
        _ => None,
    }
}

fn of_volume(error: &VolumeError) -> Option<String> {
    match error {
        VolumeError::Open { path, source } => instead_of(path, source),
        VolumeError::UnknownFormat { path, .. } if ends_in(path, "exr") => {
            Some(format!("; for a film, use relume relight {} -o picture.png", path.display()))
        }
        VolumeError::UnknownFormat { is_known: false, .. } => {
            Some("; for headerless voxels, give --dims and --type".to_owned())
        }
        VolumeError::NoLayout { guesses, .. } => Some(match guesses.first() {
            Some(RawLayout { dims: [x, y, z], voxel_type, byte_order, header_bytes, .. }) => {
                let before = if *header_bytes > 0 { format!(" --header-bytes {header_bytes}") } else { String::new() };
                let order = if *byte_order == ByteOrder::Big { " --big-endian" } else { "" };
                let which = if guesses.len() > 1 { "; the first is" } else { ":" };
                format!("{which} --dims {x}x{y}x{z} --type {voxel_type}{order}{before}")
            }
            None => "; --dims and --type give them".to_owned(),
        }),
        VolumeError::HasHeader { .. } => Some(": omit --dims and --type".to_owned()),
        VolumeError::AxesUnknown { .. } => Some(" with --axes".to_owned()),
        VolumeError::Lean { .. } | VolumeError::Uneven { .. } => Some("; --resample does it".to_owned()),
        VolumeError::Choose { there, .. } => Some(match there {
            Several::Components { kind, .. } if kind.is_empty() => {
                " with --component N, or several with --channels A,B".to_owned()
            }
            Several::Components { .. } => " with --component N".to_owned(),
            Several::Times(_) | Several::Steps { .. } => " with --time N".to_owned(),
            Several::Series(_) => " with --series N".to_owned(),
            Several::Levels(_) => " with --pyramid-level N".to_owned(),
            _ => " with --array NAME".to_owned(),
        }),
        VolumeError::NoSuch { asked, .. } => Some(format!(" ({})", chosen(asked))),
        VolumeError::Exceeds { source_name, .. } if ends_in(Path::new(source_name), "bricks") => Some(
            "; relume render reads the bricks that a picture needs, and --pyramid-level N a coarser level".to_owned(),
        ),
        VolumeError::Exceeds { source_name, .. } => {
            let bricks = Path::new(source_name).with_extension("bricks");
            Some(format!(
                "; make bricks of it, relume bricks {source_name} -o {0} (with the same flags for the volume), and render {0}",
                bricks.display()
            ))
        }
        VolumeError::BrickMemory { .. } => {
            Some("; allow more with --memory, or read a coarser level with --pyramid-level N".to_owned())
        }
        VolumeError::InFile { .. } => Some("; allow more with --memory, or leave that out".to_owned()),
        VolumeError::NotStreamed { source_name, .. } => {
            let source = Path::new(source_name);
            let stem = source.file_stem().unwrap_or_default().to_string_lossy();
            // Not the name of the source, which may be an NRRD itself.
            let nrrd = source.with_file_name(format!("{stem}-whole.nrrd"));
            Some(format!("; write it as NRRD first: relume convert {source_name} {}", nrrd.display()))
        }
        VolumeError::Bricks { .. } => Some("; make the bricks again with relume bricks".to_owned()),
        _ => None,
    }
}

/// The flag of a choice, as given.
fn chosen(asked: &Asked) -> String {
    match asked {
        Asked::Component(index) => format!("--component {index}"),
        Asked::Time(index) => format!("--time {index}"),
        Asked::Array(name) => format!("--array {name}"),
        Asked::Series(key) => format!("--series {key}"),
        Asked::Level(level) => format!("--pyramid-level {level}"),
        Asked::Axes(axes) => format!("--axes {axes}"),
    }
}

fn of_render(error: &RenderError) -> Option<String> {
    match error {
        RenderError::Volume(error) => of_volume(error),
        RenderError::Matrix => Some(": take another model, or --reference".to_owned()),
        RenderError::Slot { .. } => {
            Some(": take a larger --device-memory, or --downsample to average blocks of voxels".to_owned())
        }
        RenderError::PictureSize { .. } => {
            Some(": take a smaller --size, fewer light positions, or --reference".to_owned())
        }
        RenderError::PictureMemory { .. } => {
            Some(": take a smaller --size, fewer light positions, or --downsample".to_owned())
        }
        _ => None,
    }
}

fn of_page(error: &PageError) -> Option<String> {
    match error {
        PageError::TooLarge { .. } => Some(
            "; take a larger --tolerance or --max-bytes, or for a scene a smaller --size or fewer --views".to_owned(),
        ),
        PageError::Memory { .. } => Some("; take a smaller --size or fewer --views".to_owned()),
        PageError::Tolerance { kept, .. } if kept.is_finite() => Some(format!(": --tolerance {:.3}", 1.001 * kept)),
        _ => None,
    }
}

fn of_model(error: &ModelError) -> Option<String> {
    let ModelError::Tolerance { kind, dimension, kept, .. } = error else { return None };
    let otherwise = match kind {
        ModelKind::Nodes => "--reference renders all bands, slowly but without this error",
        _ => "--model nodes may keep your tolerance",
    };
    Some(format!("; to accept it, add --k {dimension} or --tolerance {kept:.3}; {otherwise}"))
}
