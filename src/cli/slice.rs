//! `relume slice`: one slice of a volume as a picture, as the window shows it.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use serde_json::json;

use crate::annotate::{Edges, Entry, Frame, Overlay as Annotated, PixelLength, material_colours};
use crate::document::{SceneFile, State};
use crate::number::{brief, count, whole};
use crate::output::Picture;
use crate::progress::Progress;
use crate::scene::{LabelEntry, Mix, Scene, Tone};
use crate::spectrum::colour::decode_srgb;
use crate::view::slices::{Overlay, Painted, Plane, Slices, codes, planes, voxel, window_of, windows};
use crate::volume::HostMemory;

use super::files::{self, AnnotateArgs, Bits};
use super::scene::{SceneArgs, Wanted, size, width};
use super::{CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume slice head.nii.gz -o middle.png                                   the middle slice across z
  relume slice ct.nrrd --axis z --at 66 --window 400 --level 40 -o s.png
  relume slice ct.nrrd --labels organs.nrrd --axis coronal --annotate -o coronal.png
  relume slice scene.toml --over materials --annotate=scale,letters --size 1024x1024 -o s.png";

/// Longer side of a picture without `--size`, in pixels.
const LONGER: f64 = 800.0;

/// Arguments of `relume slice`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Axis of the grid across the slice. axial, coronal and sagittal are the closest ones of an anatomical volume.
    #[arg(long, value_enum, default_value = "z")]
    axis: Axis,
    /// Index of the slice along the axis, from 0. Default: the middle.
    #[arg(long, value_name = "N")]
    at: Option<usize>,
    /// Width of the range of values from black to white around --level. Default: the first window that the file asks for, that of
    /// soft tissue for a CT, or all values but half a percent at either end.
    #[arg(long, value_name = "WIDTH", value_parser = width, allow_negative_numbers = true, requires = "level")]
    window: Option<f64>,
    /// Centre of the range of --window.
    #[arg(long, value_name = "CENTRE", allow_negative_numbers = true, requires = "window")]
    level: Option<f64>,
    /// Lay the materials of the transfer function or the labels over the values, in their colours under the lights of the scene
    /// (commas separate both). --labels FILE lays its labels over the values by itself.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "materials|labels")]
    over: Vec<Over>,
    #[command(flatten)]
    annotate: AnnotateArgs,
    /// Width and height of the picture in pixels; the slice has its proportions, in the middle. Default: the slice alone, 800
    /// pixels along its longer side.
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[usize; 2]>,
    /// Picture to write: .png is sRGB for the screen, .exr linear float RGB.
    #[arg(short, long, value_name = "FILE", required = true)]
    output: PathBuf,
}

/// Axis across a slice.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Axis {
    X,
    Y,
    Z,
    Axial,
    Coronal,
    Sagittal,
}

/// What lies over the values.
#[derive(Clone, Copy, Debug, PartialEq, ValueEnum)]
enum Over {
    Materials,
    Labels,
}

impl Axis {
    /// The plane across this axis.
    fn plane(self, planes: [Plane; 3]) -> Result<Plane, CliError> {
        let named = |name: &'static str| move |plane: &Plane| plane.name == name;
        let across = |axis: usize| move |plane: &Plane| plane.normal == axis;
        let found = match self {
            Self::X => planes.into_iter().find(across(0)),
            Self::Y => planes.into_iter().find(across(1)),
            Self::Z => planes.into_iter().find(across(2)),
            Self::Axial => planes.into_iter().find(named("axial")),
            Self::Coronal => planes.into_iter().find(named("coronal")),
            Self::Sagittal => planes.into_iter().find(named("sagittal")),
        };
        found.ok_or_else(|| {
            CliError::Usage("the file does not state anatomical axes; use --axis x, --axis y or --axis z".to_owned())
        })
    }
}

impl Args {
    /// Whether the slice shows this over the values.
    fn shows(&self, over: Over) -> bool {
        self.over.contains(&over) || over == Over::Labels && self.scene.labels.is_some()
    }

    /// Refuses flags that have no effect on a slice.
    fn check_used(&self) -> Result<(), CliError> {
        let unused = |what: String| Err(CliError::Usage(what));
        if let Some(flag) = self.scene.accuracy.given().first() {
            return unused(format!("{flag} has no effect: a slice shows values, without a colour model"));
        }
        let shows_colours = [Over::Materials, Over::Labels].into_iter().any(|over| self.shows(over));
        // Materials over a slice follow the transfer function.
        let mut of_picture = self.scene.of_picture().filter(|(flag, _)| !(shows_colours && *flag == "--range"));
        if let Some((flag, _)) = of_picture.find(|(_, given)| *given) {
            return unused(format!("{flag} has no effect: a slice shows all voxels of its plane"));
        }
        let of_look = self.scene.define.definitions().find(|it| !it.text.trim_start().starts_with("volume."));
        if let (false, Some(definition)) = (shows_colours, of_look) {
            return unused(format!(
                "{} has no effect: a slice shows values alone; add --over materials or --over labels",
                definition.given
            ));
        }
        if files::is_shown(&self.output) {
            return self.annotate.check();
        }
        if self.annotate.is_given() {
            return unused("--annotate has no effect: it is for PNG files; end the name of -o in .png".to_owned());
        }
        Ok(())
    }
}

/// The index of the slice along an axis of `length` voxels; the middle without a choice.
fn index(at: Option<usize>, middle: usize, length: usize, axis: &str) -> Result<usize, CliError> {
    match at {
        None => Ok(middle),
        Some(at) if at < length => Ok(at),
        Some(at) => Err(CliError::Usage(format!(
            "--at {at}: the volume has {length} slices along {axis}, from 0 to {}",
            length - 1
        ))),
    }
}

/// The entries of a legend for what lies over the values.
fn legend(args: &Args, scene: &Scene, mix: &Mix, present: &[usize]) -> Vec<Entry> {
    let mut entries = Vec::new();
    if args.shows(Over::Labels)
        && let Some(labels) = &scene.labels
    {
        let colours = material_colours(scene, mix);
        let is_present = |entry: &&LabelEntry| usize::try_from(entry.label).is_ok_and(|label| present.contains(&label));
        for entry in labels.declared.iter().filter(is_present) {
            if let (Some(&colour), Some(material)) = (colours.get(entry.material), scene.materials.get(entry.material))
            {
                let spectrum = material.reflectance.spectrum().clone();
                entries.push(Entry { name: entry.name.clone(), colour, spectrum });
            }
        }
    }
    if args.shows(Over::Materials) {
        let used = scene.transfer.terms.iter().flat_map(|term| term.material.0.iter().map(|(_, material)| *material));
        let mut used: Vec<usize> = used.collect();
        used.sort_unstable();
        used.dedup();
        entries.extend(Entry::of_materials(scene, &used, mix));
    }
    entries
}

/// Letters at the edges of a slice: those of a patient, or the names of the axes.
fn edges(plane: &Plane) -> Edges {
    let name = |axis: usize| ["x", "y", "z"][axis].to_owned();
    plane.edges.clone().unwrap_or_else(|| {
        let ((right, _), (down, ascends)) = (plane.right, plane.down);
        let [top, bottom] = if ascends { [String::new(), name(down)] } else { [name(down), String::new()] };
        Edges { left: String::new(), right: name(right), top, bottom }
    })
}

/// Linear RGBA of the `slice` of a size in the middle of a black picture of `size`.
#[expect(clippy::cast_possible_truncation, reason = "pictures are stored in f32")]
fn centred(slice: &[[u8; 3]], [across, down]: [usize; 2], [width, height]: [usize; 2]) -> Vec<f32> {
    let linear: Vec<f32> = (0..=255_u8).map(|code| decode_srgb(f64::from(code) / 255.0) as f32).collect();
    let mut rgba = [0.0, 0.0, 0.0, 1.0].repeat(width * height);
    let (left, top) = ((width - across) / 2, (height - down) / 2);
    for (y, row) in slice.chunks(across.max(1)).enumerate() {
        let start = 4 * ((top + y) * width + left);
        for (pixel, colour) in rgba[start..].as_chunks_mut::<4>().0.iter_mut().zip(row) {
            for (channel, &code) in pixel.iter_mut().zip(colour) {
                *channel = linear[usize::from(code)];
            }
        }
    }
    rgba
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    args.scene.require_one("slice")?;
    args.check_used()?;
    files::picture_kind(&args.output)?;
    let inputs = [&args.scene.scene, &args.scene.volume, &args.scene.labels];
    let inputs: Vec<&Path> = inputs.into_iter().flatten().map(PathBuf::as_path).collect();
    files::check_outputs(&[&args.output], &inputs)?;
    let memory = HostMemory::Bounded { bytes: None };
    let (file, statistics) = args.scene.read(&Wanted::default(), memory, progress)?;
    files::check_outputs(&[&args.output], &file.inputs.iter().map(PathBuf::as_path).collect::<Vec<_>>())?;
    super::warn_of(crate::render::RenderWarning::of_values(&statistics));
    let state = State::new(&file);
    let SceneFile { scene, .. } = &file;
    let (volume, geometry) = (scene.volume(), &scene.frame.geometry);
    if let Some(other) = scene.fields.further().first() {
        let number = scene.fields.further().len() + 1;
        if other.volume.files == volume.files && !volume.files.is_empty() {
            tracing::warn!(
                "a slice shows one of the {number} fields, the first; --component N chooses another, such as {}",
                other.name
            );
        } else {
            tracing::warn!(
                "a slice shows one of the {number} fields, the first; relume slice {} shows {}",
                other.volume.source,
                other.name
            );
        }
    }
    if args.over.contains(&Over::Labels) && scene.labels.as_ref().is_none_or(|labels| labels.declared.is_empty()) {
        return Err(CliError::Usage(
            "--over labels: the scene declares no labels; give a label map with --labels FILE".to_owned(),
        ));
    }
    volume.prepare_coarse(progress)?;

    let plane = args.axis.plane(planes(volume))?;
    let axis = ["x", "y", "z"][plane.normal];
    let length = geometry.dims[plane.normal];
    let middle = voxel(Slices::default().crosshair(geometry))[plane.normal];
    let at = index(args.at, middle, length, axis)?;
    let window = match args.window.zip(args.level) {
        Some((width, centre)) => [centre - width / 2.0, centre + width / 2.0],
        None => window_of(&windows(volume, &statistics), &statistics),
    };
    // World units of a pixel, so that the slice fits into the picture.
    let extent = plane.size(geometry);
    let units = match args.size {
        Some([width, height]) => (extent.x / count(width)).max(extent.y / count(height)),
        None => extent.max_element() / LONGER,
    };
    let most = args.size.unwrap_or([usize::MAX; 2]);
    let side = |length: f64, most: usize| whole((length / units).round()).max(1).min(most);
    let slice_size = [side(extent.x, most[0]), side(extent.y, most[1])];
    let size = args.size.unwrap_or(slice_size);
    // Linear RGBA in f32, and the codes of the slice.
    files::check_memory(size, 19)?;

    let mix = state.mix_of_swatches();
    let colours = codes(&material_colours(scene, &mix));
    let overlay = args.shows(Over::Materials).then(|| Overlay::new(scene, &statistics, &colours));
    let labels = scene.labels.as_ref().filter(|_| args.shows(Over::Labels));
    let at_hand = volume.at_hand();
    let block = volume.block_of(at_hand);
    if block != [1; 3] {
        let [x, y, z] = block;
        tracing::warn!("the volume stays in its file of bricks, so the slice shows means of {x}×{y}×{z} voxels");
    }
    let painted = Painted {
        volume: at_hand,
        window,
        overlay: overlay.as_ref(),
        labels: labels.map(|labels| (labels, at, colours.as_slice())),
    };
    let pixels = painted.pixels(&plane, at / block[plane.normal], slice_size);
    let linear = centred(&pixels, slice_size, size);

    let present = labels.map_or_else(Vec::new, |labels| labels_of(&labels.volume, plane.normal, at));
    let annotated = args
        .annotate
        .overlay(false, || Annotated { materials: legend(args, scene, &mix, &present), ..Annotated::default() });
    let pixel = PixelLength { units, exact: true };
    let frame = Frame { pixel: Some(pixel), unit: volume.unit, edges: Some(edges(&plane)) };
    let frame = args.annotate.frame(frame);
    let shown =
        files::dressed((&linear, Tone::Linear), size, None, annotated.as_ref().map(|overlay| (overlay, &frame)))?;
    let picture = Picture::new(size[0], size[1], shown.as_deref().unwrap_or(&linear))?;
    files::write_linear(&args.output, &picture, Bits::Eight, files::alpha(None))?;

    let path = args.output.display().to_string();
    let [low, high] = window;
    let unit = volume.unit.map_or_else(|| "units".to_owned(), |unit| unit.to_string());
    Ok(Report {
        text: format!(
            "wrote {path}: {} slice {at} of 0 to {} along {axis}; values from {} (black) to {} (white); a pixel is {} {unit}\n",
            plane.name,
            length - 1,
            brief(low),
            brief(high),
            brief(units)
        ),
        json: json!({
            "outputs": [path],
            "size": size,
            "source": volume.source,
            "plane": plane.name,
            "axis": axis,
            "at": at,
            "slices": length,
            "window": window,
            "pixel": units,
            "unit": volume.unit.map(|unit| unit.to_string()),
            "over": {"materials": args.shows(Over::Materials), "labels": labels.is_some()},
        }),
    })
}

/// The labels in the slice `at` across the axis `normal` of their grid, each once.
fn labels_of(volume: &crate::volume::Volume, normal: usize, at: usize) -> Vec<usize> {
    let dims = volume.geometry.dims;
    let strides = [1, dims[0], dims[0] * dims[1]];
    let [one, two] = [[1, 2], [0, 2], [0, 1]][normal];
    let first = at.min(dims[normal].saturating_sub(1)) * strides[normal];
    let places = (0..dims[two]).flat_map(|b| (0..dims[one]).map(move |a| first + a * strides[one] + b * strides[two]));
    let mut labels: Vec<usize> = places.filter_map(|place| volume.voxels.value(place)).map(whole).collect();
    labels.sort_unstable();
    labels.dedup();
    labels
}
