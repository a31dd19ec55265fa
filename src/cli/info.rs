//! `relume info`: describes a volume, the plan of a scene, a film file or the Vulkan devices.

use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;
use serde_json::{Value, json};

use crate::document::first_look::{Values, guess};
use crate::document::{SceneFile, is_sidecar};
use crate::model::ColourModel;
use crate::number::{brief, brief_in, readable};
use crate::output::film::{Components, FilmFile, Light, Stored};
use crate::plan::{Accumulate, Planned, Transmittance, plan};
use crate::progress::Progress;
use crate::scene::Scene;
use crate::scene::key::Named as _;
use crate::tables::{LightGrid, Storage};
use crate::volume::{
    self, HostMemory, LabelPreset, Offered, RawLayout, Selection, Series, Several, Volume, VolumeError, Window,
};
use crate::vulkan::{DeviceInfo, devices};

use super::advice::sentence;
use super::model::{Learnt, warn_of_plan};
use super::scene::{OF_PICTURE, SceneArgs, Wanted, voxel};
use super::{CliError, Report};

const EXAMPLES: &str = "\
Examples:
  relume info                                   the Vulkan devices
  relume info head.mhd --voxel 10,20,30         the contents of a volume
  relume info ct.raw --dims 512x512x200 --type int16 --json
  relume info scans                             the series of a folder of DICOM files
  relume info scene.toml                        the contents of a scene, and the cost of a picture";

const ARGUMENT: &str = "A scene (.toml), a film file (.exr), or a volume (.dcm, .mhd, .mha, .nrrd, .nhdr, .nii, .mgz, .mrc, .npy, .h5, .nc, .tif, .vti, .vtk, .raw, \
                         a folder of DICOM files or of slices, a Zarr store). \
                        Without one, the Vulkan devices";

/// Arguments of `relume info`.
#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES, mut_arg("scene", |arg| arg.value_name("FILE").help(ARGUMENT).long_help(ARGUMENT)))]
pub(crate) struct Args {
    #[command(flatten)]
    scene: SceneArgs,
    /// Also print the value of this voxel of the volume; indices start at 0 (repeatable).
    #[arg(long, value_name = "x,y,z", value_parser = voxel)]
    voxel: Vec<[usize; 3]>,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    args.scene.require_one("info")?;
    match (&args.scene.scene, &args.scene.volume) {
        (None, None) if args.scene.define.is_empty() && args.scene.accuracy.given().is_empty() => {
            let all = [
                "--labels",
                "--label-names",
                "--downsample",
                "--component",
                "--time",
                "--array",
                "--series",
                "--pyramid-level",
                "--axes",
                "--resample",
                "--dims",
                "--spacing",
                "--voxel",
            ];
            args.refuse(&[&OF_PICTURE[..], &all].concat(), "it needs a scene or a volume")?;
            of_devices()
        }
        (Some(path), None) if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr")) => {
            let flags = ["-D", "--labels", "--label-names", "--downsample", "--dims", "--spacing", "--voxel"];
            let why = format!("{} is a film file; the flag is for scenes and volumes", path.display());
            args.refuse(
                &[&OF_PICTURE[..], &flags, &args.scene.selection.choices().map(|(flag, _)| flag)].concat(),
                &why,
            )?;
            args.refuse_accuracy(&why)?;
            Ok(of_accumulators(path, &FilmFile::read(path)?))
        }
        (Some(path), None) | (None, Some(path)) if args.scene.scene.is_none() || !is_scene(path) => {
            let why = format!("{} is a volume; the flag is for scenes", path.display());
            args.refuse(&[&OF_PICTURE[..], &["-D", "--labels"]].concat(), &why)?;
            args.refuse_accuracy(&why)?;
            // A file of bricks describes its voxels itself.
            let memory = if args.scene.downsample.is_none() { HostMemory::InFile } else { HostMemory::Whole };
            let selection = Selection { memory, ..args.scene.selection.selection() };
            let opened = volume::open_by(path, args.scene.raw.layout().as_ref(), &selection, progress);
            let volume = match opened {
                Err(VolumeError::Choose { source_name, there }) => {
                    let why = format!("it needs one volume; choose it with {}", choosing(&there));
                    args.refuse(&["--voxel", "--downsample", "--spacing"], &why)?;
                    let (layout, several) = (args.scene.raw.layout(), (&*source_name, &there));
                    return Ok(of_several(path, layout.as_ref(), &selection, several, progress));
                }
                opened => args.scene.raw.spaced(opened?)?,
            };
            let mut volume = match args.scene.downsample {
                Some(blocks) => volume.downsample(blocks)?,
                None => volume,
            };
            if let Some(names) = &args.scene.label_names {
                volume.name_labels(names)?;
            }
            of_volume(&volume, &args.voxel)
        }
        _ => {
            let memory = HostMemory::Bounded { bytes: None };
            let (file, _) = args.scene.load_as(&Wanted::default(), memory, progress)?;
            let planned = plan(&file.scene, progress)?;
            warn_of_plan(&planned);
            of_scene(&file, &planned, &args.voxel, progress)
        }
    }
}

impl Args {
    /// Refuses flags for colour accuracy.
    fn refuse_accuracy(&self, why: &str) -> Result<(), CliError> {
        match self.scene.accuracy.given().first() {
            Some(flag) => Err(CliError::Usage(format!("{flag} has no effect: {why}"))),
            None => Ok(()),
        }
    }

    /// Refuses any of `flags` that is given.
    fn refuse(&self, flags: &[&str], why: &str) -> Result<(), CliError> {
        let others = [
            ("-D", !self.scene.define.is_empty()),
            ("--labels", self.scene.labels.is_some()),
            ("--label-names", self.scene.label_names.is_some()),
            ("--downsample", self.scene.downsample.is_some()),
            ("--dims", self.scene.raw.layout().is_some()),
            ("--spacing", self.scene.raw.spacing().is_some()),
            ("--voxel", !self.voxel.is_empty()),
        ];
        let of_scene = self.scene.of_picture().chain(others);
        let mut given = self.scene.selection.choices().into_iter().chain(of_scene);
        match given.find(|(flag, given)| *given && flags.contains(flag)) {
            Some((flag, _)) => Err(CliError::Usage(format!("{flag} has no effect: {why}"))),
            None => Ok(()),
        }
    }
}

/// The flag that chooses one of several volumes.
fn choosing(there: &Several) -> &'static str {
    match there {
        Several::Components { .. } => "--component N",
        Several::Times(_) | Several::Steps { .. } => "--time N",
        Several::Series(_) => "--series N",
        Several::Levels(_) => "--pyramid-level N",
        _ => "--array NAME",
    }
}

/// How to choose: every flag with its range.
fn how_to_choose(choices: &[Several]) -> String {
    let each = |there: &Several| format!("{} with {}", there.range(), choosing(there));
    choices.iter().map(each).collect::<Vec<_>>().join(", and ")
}

/// Most series or arrays that are opened for a listing; others are named alone.
const MOST_OPENED: usize = 16;
/// Most components that are listed one by one.
const MOST_LISTED: usize = 32;

/// One of the volumes of a file or folder: its grid and type, and the choices that it leaves open.
struct OfOne {
    /// `4 × 3 × 2 of int16, spacing 1 × 1 × 2 mm`
    grid: String,
    choices: Vec<Several>,
    json: Value,
}

impl OfOne {
    fn new(offered: Offered) -> Self {
        let volume = &offered.first;
        let spacing = volume.geometry.spacing.to_array();
        let unit = volume.unit.map_or_else(String::new, |unit| format!(" {unit}"));
        let (dims, kind) = (offered.dims(), volume.voxels.type_name());
        let grid = format!("{} of {kind}, spacing {}{unit}", by(&dims), by(&spacing.map(brief)));
        let times = offered.choices.iter().find_map(|there| match there {
            Several::Times(count) => Some(*count),
            _ => None,
        });
        let json = json!({
            "dims": dims,
            "type": kind,
            "spacing": spacing,
            "unit": volume.unit.map(|unit| unit.to_string()),
            "components": volume.components,
            "component_names": volume.component_names,
            "times": times,
            "has_labels": volume.has_labels,
        });
        Self { grid, choices: offered.choices, json }
    }
}

/// The lines of the alternatives of `there`, and their part of the JSON.
fn alternatives(there: &Several) -> (Vec<String>, Value) {
    match there {
        Several::Components { count, names, .. } => {
            let name = |index: usize| {
                names.get(index).filter(|name| !name.is_empty()).map_or_else(String::new, |name| format!(" {name}"))
            };
            let listed = |index: usize| format!("{:<10} {index}{}", "component", name(index));
            let lines = match (0..*count).any(|index| !name(index).is_empty()) || *count <= MOST_LISTED {
                true => (0..*count).map(listed).collect(),
                false => vec![format!("{:<10} 0 to {}", "components", count.saturating_sub(1))],
            };
            (lines, json!({"components": count, "component_names": names}))
        }
        Several::Times(count) => {
            (vec![format!("{:<10} 0 to {}", "times", count.saturating_sub(1))], json!({"times": count}))
        }
        Several::Steps { axis, values } => {
            let line = |(index, value): (usize, &String)| format!("{:<10} {index} {axis} {value}", "time");
            let lines = values.iter().enumerate().map(line).collect();
            (lines, json!({"times": values.len(), "time_axis": axis, "time_values": values}))
        }
        Several::Arrays(names) => {
            (names.iter().map(|name| format!("{:<10} {name}", "array")).collect(), json!({"arrays": names}))
        }
        Several::Series(all) => {
            let of = |Series { key, description, dims, times }: &Series| json!({"series": key, "description": description, "dims": dims, "times": times});
            let lines = all.iter().map(|series| format!("{:<10} {series}", "series")).collect();
            (lines, json!({"series": all.iter().map(of).collect::<Vec<_>>()}))
        }
        Several::Levels(all) => {
            let lines = all.iter().enumerate().map(|(level, dims)| format!("{:<10} {level} {}", "level", by(dims)));
            (lines.collect(), json!({"levels": all}))
        }
    }
}

/// Describes the file or folder at `path`, which holds several volumes: `there`, and what each leaves open.
fn of_several(
    path: &Path,
    layout: Option<&RawLayout>,
    selection: &Selection,
    (source, there): (&str, &Several),
    progress: &dyn Progress,
) -> Report {
    let offered = |selection: &Selection| Offered::open(path, layout, selection, progress).map(OfOne::new);
    let (mut lines, mut json) = alternatives(there);
    let mut choices = vec![there.clone()];
    let each: Vec<Selection> = match there {
        Several::Arrays(names) => {
            names.iter().map(|name| Selection { array: Some(name.clone()), ..selection.clone() }).collect()
        }
        Several::Series(all) => {
            all.iter().map(|one| Selection { series: Some(one.key.clone()), ..selection.clone() }).collect()
        }
        _ => Vec::new(),
    };
    if each.is_empty() {
        match offered(selection) {
            Ok(one) => {
                let mut all = vec![format!("{:<10} {}", "voxels", one.grid)];
                choices.clone_from(&one.choices);
                for there in &choices {
                    let (more, part) = alternatives(there);
                    all.extend(more);
                    merge(&mut json, &part);
                }
                merge(&mut json, &one.json);
                lines = all;
            }
            Err(error) => tracing::warn!("the first of them cannot be read: {}", sentence(&error)),
        }
    } else {
        let mut volumes = Vec::new();
        for (selection, line) in each.iter().zip(&mut lines).take(MOST_OPENED) {
            if progress.cancelled() {
                break;
            }
            match offered(selection) {
                Ok(one) => {
                    let further: Vec<String> = one.choices.iter().map(|there| format!(", {there}")).collect();
                    line.push_str(&format!("\n  {:<10} {}{}", "", one.grid, further.concat()));
                    let key = json!({"array": selection.array, "series": selection.series});
                    let mut described = one.json;
                    merge(&mut described, &key);
                    volumes.push(described);
                    for there in one.choices {
                        let is_known =
                            |known: &Several| std::mem::discriminant(known) == std::mem::discriminant(&there);
                        if !choices.iter().any(is_known) {
                            choices.push(there);
                        }
                    }
                }
                Err(error) => line.push_str(&format!("\n  {:<10} cannot be read: {}", "", sentence(&error))),
            }
        }
        json["volumes"] = json!(volumes);
    }
    let heads: Vec<String> =
        choices.iter().take(1 + usize::from(each.is_empty()) * choices.len()).map(Several::to_string).collect();
    let head = if matches!(there, Several::Series(_) | Several::Arrays(_)) {
        String::new()
    } else {
        format!(": {}", heads.join("; "))
    };
    let mut text = format!("{source}{head}\n");
    for line in lines {
        let _ = writeln!(text, "  {line}");
    }
    // The ranges of later choices may differ between series or arrays, so flags alone are told.
    let how = match each.is_empty() {
        true => how_to_choose(&choices),
        false => format!(
            "{} with {}{}",
            there.range(),
            choosing(there),
            choices.iter().skip(1).map(|there| format!(", and further with {}", choosing(there))).collect::<String>()
        ),
    };
    let _ = writeln!(text, "  {:<10} choose {how}", "");
    json["choose"] = json!(choices.iter().map(choosing).collect::<Vec<_>>());
    json["source"] = json!(source);
    Report { text, json }
}

/// Adds the entries of `part` that `json` lacks.
fn merge(json: &mut Value, part: &Value) {
    if let (Some(all), Value::Object(part)) = (json.as_object_mut(), part) {
        for (key, value) in part {
            if !value.is_null() && all.get(key).is_none_or(Value::is_null) {
                all.insert(key.clone(), value.clone());
            }
        }
    }
}

/// Whether a file describes a scene: TOML does, unless it describes voxels.
fn is_scene(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml")) && !is_sidecar(path)
}

/// Whether the slider of a light is on when the scene opens.
fn is_on(file: &SceneFile, name: &str) -> bool {
    let mut lights = file.scene.lights.iter().zip(&file.light.sliders);
    lights.any(|(light, slider)| light.name == name && slider.on)
}

fn of_devices() -> Result<Report, CliError> {
    let all = devices()?;
    let mut text = String::new();
    for device in &all {
        let [major, minor, patch] = device.api_version;
        let _ = writeln!(
            text,
            "{}: {} ({}, Vulkan {major}.{minor}.{patch}, {})",
            device.index, device.name, device.kind, device.driver
        );
        for missing in &device.missing {
            let _ = writeln!(text, "   cannot be used: {missing}");
        }
    }
    Ok(Report { text, json: json!({"devices": all.iter().map(device_json).collect::<Vec<_>>()}) })
}

pub(crate) fn device_json(device: &DeviceInfo) -> Value {
    json!({
        "index": device.index,
        "name": device.name,
        "kind": format!("{:?}", device.kind).to_lowercase(),
        "driver": device.driver,
        "vulkan": device.api_version.map(|part| part.to_string()).join("."),
        "missing": device.missing,
    })
}

/// A requested voxel.
#[derive(Serialize)]
struct Sampled {
    index: [usize; 3],
    value: f64,
}

impl Sampled {
    fn text(&self) -> String {
        let [x, y, z] = self.index;
        format!("{x},{y},{z} is {}", readable(self.value))
    }
}

fn sampled(volume: &Volume, voxels: &[[usize; 3]]) -> Result<Vec<Sampled>, CliError> {
    let sample = |&index: &[usize; 3]| {
        let value = volume.read_value(index)?.ok_or_else(|| {
            CliError::Usage(format!("--voxel {index:?} is outside the volume's {:?} voxels", volume.geometry.dims))
        })?;
        Ok(Sampled { index, value })
    };
    voxels.iter().map(sample).collect()
}

/// Hexadecimal sRGB code of a label's colour.
fn hex(label: &LabelPreset) -> Option<String> {
    let code = |part: f64| format!("{:.0}", part * 255.0).parse::<u8>().map(|code| format!("{code:02x}"));
    let codes: Result<Vec<String>, _> = label.colour?.into_iter().map(code).collect();
    Some(format!("#{}", codes.ok()?.concat()))
}

fn of_volume(volume: &Volume, voxels: &[[usize; 3]]) -> Result<Report, CliError> {
    let statistics = volume.statistics()?;
    super::warn_of(crate::render::RenderWarning::of_values(&statistics));
    for note in &volume.notes {
        tracing::warn!("{note}");
    }
    let geometry = &volume.geometry;
    let sampled = sampled(volume, voxels)?;
    let direction = geometry.direction;
    let mut text = format!("{}\n", volume.source);
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "  {name:<10} {value}");
    };
    line("voxels", &format!("{} of {}", by(&geometry.dims), volume.voxels.type_name()));
    if volume.components > 1 {
        let names = volume.component_names.join(", ");
        let names = if names.is_empty() { names } else { format!(" ({names})") };
        line("components", &format!("{}{names}, one of which is read", volume.components));
    }
    let unit = volume.unit.map_or_else(String::new, |unit| format!(" {unit}"));
    line("spacing", &format!("{}{unit}", by(&geometry.spacing.to_array().map(brief))));
    line("origin", &list(geometry.origin));
    line("axes", &[direction.x_axis, direction.y_axis, direction.z_axis].map(list).join("  "));
    if volume.anatomical {
        line("world", "anatomical: x to the patient's left, y to the back, z to the head (LPS)");
    }
    let in_values = |value: f64| brief_in(value, statistics.max - statistics.min);
    line(
        "values",
        &format!("{} to {}, mean {}", readable(statistics.min), readable(statistics.max), in_values(statistics.mean)),
    );
    // Percentiles and suggestions examine voxels.
    let known = volume.bricks.is_none().then(|| Values::of(volume, &statistics));
    let percentiles = known
        .as_ref()
        .map(|known| [1, 5, 25, 50, 75, 95, 99].map(|part| (part, known.percentile(f64::from(part) / 100.0))));
    if let Some(percentiles) = &percentiles {
        let listed = percentiles.map(|(part, value)| format!("{part} %: {}", in_values(value))).join(", ");
        line("percentile", &listed);
    }
    let joint = volume.bricks.is_none().then(|| volume.joint_histogram([statistics.min, statistics.max])).flatten();
    let magnitudes =
        joint.as_ref().map(|joint| [50.0, 75.0, 95.0, 99.0].map(|part| (part, joint.magnitude(part / 100.0))));
    if let Some(magnitudes) = &magnitudes {
        let listed = magnitudes.map(|(part, magnitude)| format!("{part} %: {}", brief(magnitude))).join(", ");
        line("gradient", &format!("{listed} (magnitudes, per unit of length)"));
    }
    line("histogram", &format!("{}  (64 bins; heights are logarithmic)", bars(&statistics.histogram)));
    line("", &ends(statistics.min, statistics.max));
    for sentence in known.iter().flat_map(Values::sentences) {
        line("suggested", &sentence);
    }
    let guess = known.as_ref().map(|known| guess(volume, known, &statistics));
    if let Some(guess) = &guess {
        line("first look", guess);
    }
    for Window { name, low, high } in &volume.presets.windows {
        line("window", &format!("{} to {}: {name}", in_values(*low), in_values(*high)));
    }
    if volume.has_labels {
        line("labels", "the voxels are labels: numbers of classes");
    }
    for label in &volume.presets.labels {
        line(
            "label",
            &format!("{} {}{}", label.value, label.name, hex(label).map_or_else(String::new, |it| format!(" {it}"))),
        );
    }
    for voxel in &sampled {
        line("voxel", &voxel.text());
    }
    for (key, value) in &volume.metadata {
        line("header", &format!("{key} = {value}"));
    }
    let metadata: serde_json::Map<String, Value> =
        volume.metadata.iter().map(|(key, value)| (key.clone(), json!(value))).collect();
    let windows = volume.presets.windows.iter();
    let windows = windows.map(|Window { name, low, high }| json!({"name": name, "low": low, "high": high}));
    let labels = volume.presets.labels.iter();
    let labels = labels.map(|label| json!({"value": label.value, "name": label.name, "colour": hex(label)}));
    Ok(Report {
        text,
        json: json!({
            "source": volume.source,
            "dims": geometry.dims,
            "type": volume.voxels.type_name(),
            "spacing": geometry.spacing.to_array(),
            "origin": geometry.origin.to_array(),
            // Unit vectors of the axes x, y and z, in order, as in the key `direction` of a scene.
            "axes": direction.to_cols_array_2d(),
            // Row by row: column i is axis i. Former form of `axes`, for one release.
            "direction": direction.transpose().to_cols_array(),
            "anatomical": volume.anatomical,
            "unit": volume.unit.map(|unit| unit.to_string()),
            "has_labels": volume.has_labels,
            "windows": windows.collect::<Vec<_>>(),
            "labels": labels.collect::<Vec<_>>(),
            "components": volume.components,
            "component_names": volume.component_names,
            "min": statistics.min,
            "max": statistics.max,
            "mean": statistics.mean,
            "histogram": statistics.histogram.to_vec(),
            "percentiles": percentiles.map(|all| all.map(|(part, value)| json!({"percent": part, "value": value}))),
            "kind": known.as_ref().map(|known| known.kind.name()),
            "peaks": known.as_ref().map(|known| &known.peaks),
            "named": known.as_ref().map(Values::named),
            "first_look": guess,
            "voxels": sampled,
            "not_a_number": statistics.not_a_number,
            "infinite": statistics.infinite,
            "metadata": metadata,
            "notes": volume.notes,
        }),
    })
}

fn of_accumulators(path: &Path, file: &FilmFile) -> Report {
    let positions: Vec<&str> = file.positions.iter().map(|position| position.name.as_str()).collect();
    let at = |light: &Light| positions.get(light.position).copied().unwrap_or_default();
    let lights = file.lights.iter().map(|light| format!("{}@{}={}", light.name, at(light), readable(light.weight)));
    let (components, model) = match &file.components {
        Components::Surfaces(surfaces) => (surfaces.iter().map(|surface| surface.name.clone()).collect(), None),
        Components::Model(Stored { model, .. }) => (Vec::new(), Some(model)),
    };
    let mut text = format!("{}: a film file, for relume relight\n", path.display());
    let mut lines = vec![("size", format!("{} × {}", file.width, file.height))];
    if let Some(part) = &file.part {
        lines.push(("part", format!("{}; `relume composite` makes the whole film", part.named())));
    }
    match model {
        None => lines.push(("components", or_none(&components.join(", ")))),
        Some(model) => {
            let worst = model.worst();
            let transmittance = if file.is_coloured() { "transmittance is coloured" } else { "transmittance is grey" };
            lines.push(("model", format!("{}; {transmittance}", model.description())));
            let of = format!("{:.3} on average, p95 {:.3}, at most {:.3}", worst.mean, worst.p95, worst.max);
            lines.push(("ΔE00", format!("{of} under its lights")));
        }
    }
    lines.push(("positions", or_none(&positions.join(", "))));
    lines.push(("lights", or_none(&lights.collect::<Vec<_>>().join(", "))));
    let presets = file.dial.iter().flat_map(|dial| &dial.presets).map(|preset| preset.name.as_str());
    let presets: Vec<&str> = presets.collect();
    if !presets.is_empty() {
        lines.push(("presets", presets.join(", ")));
    }
    for (name, value) in lines {
        let _ = writeln!(text, "  {name:<10} {value}");
    }
    let lights = file.lights.iter();
    let lights: Vec<Value> =
        lights.map(|light| json!({"name": light.name, "position": at(light), "weight": light.weight})).collect();
    let json = json!({
        "accumulators": path.display().to_string(),
        "size": [file.width, file.height],
        "part": file.part.as_ref().map(|part| json!({"first": part.first, "last": part.last, "count": part.blocks})),
        "components": components,
        "model": model.map(|model| Learnt::nothing(model).json(model)),
        "positions": positions,
        "lights": lights,
        "presets": presets,
        // Former name of `presets`.
        "situations": presets,
    });
    Report { text, json }
}

fn of_scene(
    file: &SceneFile,
    planned: &Planned,
    voxels: &[[usize; 3]],
    progress: &dyn Progress,
) -> Result<Report, CliError> {
    let scene = &file.scene;
    let statistics = scene.volume().statistics()?;
    let storage = Storage::of(&planned.plan, scene.volume(), &statistics, progress)?;
    let sampled = sampled(scene.volume(), voxels)?;
    let (volume, geometry) = (scene.volume(), &scene.frame.geometry);
    let mut text = format!("{}\n", scene.name);
    let mut line = |name: &str, value: &str| {
        let _ = writeln!(text, "  {name:<10} {value}");
    };
    let spacing = by(&geometry.spacing.to_array().map(brief));
    line(
        "volume",
        &format!(
            "{}: {} voxels of {}, spacing {spacing}",
            volume.source,
            by(&geometry.dims),
            volume.voxels.type_name()
        ),
    );
    line("values", &format!("{} to {}", readable(statistics.min), readable(statistics.max)));
    for voxel in &sampled {
        line("voxel", &voxel.text());
    }
    if let Some(labels) = &scene.labels {
        const LISTED: usize = 200;
        let mut declared: Vec<String> =
            labels.declared.iter().take(LISTED).map(|entry| format!("{} {}", entry.label, entry.name)).collect();
        if let more @ 1.. = labels.declared.len().saturating_sub(LISTED) {
            declared.push(format!("and {more} more"));
        }
        line("labels", &format!("{}: {}", labels.volume.source, declared.join(", ")));
    }
    let materials: Vec<&str> = scene.materials.iter().map(|material| material.name.as_str()).collect();
    line("materials", &or_none(&materials.join(", ")));
    let lights: Vec<String> = scene
        .lights
        .iter()
        .map(|light| {
            let vector = light.placement.vector().map_or_else(String::new, |vector| format!(" {}", list(vector)));
            let place = light.placement.kind().origin().to_owned() + &vector;
            let off = if is_on(file, &light.name) { "" } else { ", off initially" };
            let shadows = if light.shadows { ", with shadows" } else { "" };
            format!("{} ({place}, intensity {}{shadows}{off})", light.name, light.intensity)
        })
        .collect();
    line("lights", &or_none(&lights.join(", ")));
    let presets: Vec<&str> = file.dial.presets.iter().map(|preset| preset.name.as_str()).collect();
    if !presets.is_empty() {
        line("presets", &presets.join(", "));
    }
    text.push_str("cost of a picture\n");
    for sentence in explanation(scene, planned, &storage) {
        let _ = writeln!(text, "  {sentence}");
    }
    let json = json!({
        "scene": scene.name,
        "volume": {
            "source": volume.source,
            "dims": geometry.dims,
            "type": volume.voxels.type_name(),
            "spacing": geometry.spacing.to_array(),
            "min": statistics.min,
            "max": statistics.max,
            "voxels": sampled,
        },
        "labels": scene.labels.as_ref().map(|labels| json!({
            "source": labels.volume.source,
            "declared": labels
                .declared
                .iter()
                .map(|entry| json!({"label": entry.label, "name": entry.name}))
                .collect::<Vec<_>>(),
        })),
        "materials": materials,
        "lights": scene
            .lights
            .iter()
            .map(|light| {
                let kind = light.placement.kind();
                let place = light.placement.vector().map(|place| place.to_array());
                let on = is_on(file, &light.name);
                json!({"name": light.name, "kind": kind, "place": place, "intensity": light.intensity, "on": on, "shadows": light.shadows})
            })
            .collect::<Vec<_>>(),
        "presets": presets,
        // Former name of `presets`.
        "situations": presets,
        "plan": plan_json(scene, planned, &storage, None),
    });
    Ok(Report { text, json })
}

/// Returns `text`, or "none" if it is empty.
fn or_none(text: &str) -> String {
    if text.is_empty() { "none".to_owned() } else { text.to_owned() }
}

/// Formats `a × b × c`.
fn by<T: ToString>(values: &[T; 3]) -> String {
    values.each_ref().map(ToString::to_string).join(" × ")
}

/// Formats `(a, b, c)` with up to six decimals.
fn list(vector: glam::DVec3) -> String {
    let short = |value: f64| {
        let rounded = format!("{value:.6}");
        let rounded = rounded.trim_end_matches('0').trim_end_matches('.');
        if rounded == "-0" { "0".to_owned() } else { rounded.to_owned() }
    };
    format!("({})", vector.to_array().map(short).join(", "))
}

/// The two ends of a histogram, under its first and its last bar.
fn ends(least: f64, most: f64) -> String {
    let [least, most] = [least, most].map(|end| brief_in(end, most - least));
    let width = volume::BINS.saturating_sub(least.chars().count());
    format!("{least}{most:>width$}")
}

/// Draws a bar per bin, as high as the logarithm of its count; a blank for an empty bin.
fn bars(bins: &[u64]) -> String {
    const BARS: [char; 8] = ['▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
    let height = |count: u64| u64::from(u64::BITS - count.leading_zeros());
    let highest = bins.iter().copied().map(height).max().unwrap_or(0).max(1);
    let bar = |&count: &u64| match height(count) {
        0 => ' ',
        bits => {
            usize::try_from((bits - 1) * 8 / highest).ok().and_then(|index| BARS.get(index).copied()).unwrap_or(' ')
        }
    };
    bins.iter().map(bar).collect()
}

/// Describes the plan and the storage of the volume in sentences.
fn explanation(scene: &Scene, planned: &Planned, storage: &Storage) -> Vec<String> {
    let mut sentences = planned.explain(scene);
    sentences.push(storage.explain(scene.frame.geometry.dims));
    if planned.plan.light.reads_grid() {
        let grid = LightGrid::new(scene, scene.shadows.spacing);
        sentences.push(grid.explain(planned.plan.light.grid_lights(), planned.plan.light.absorbers));
    }
    sentences
}

/// The plan as JSON; `learnt` tells which lights of its model were planned, if others were added.
pub(crate) fn plan_json(scene: &Scene, planned: &Planned, storage: &Storage, learnt: Option<Learnt>) -> Value {
    let plan = &planned.plan;
    let model = |model: &Arc<ColourModel>| learnt.unwrap_or_else(|| Learnt::nothing(model)).json(model);
    let names: Vec<&str> =
        planned.materials.iter().filter_map(|&m| scene.materials.get(m)).map(|m| m.name.as_str()).collect();
    json!({
        "accumulate": match plan.accumulate {
            Accumulate::Weights { .. } => "weights",
            Accumulate::Spectral { .. } => "spectral",
        },
        "transmittance": match plan.transmittance {
            Transmittance::Grey => "grey",
            Transmittance::Coloured => "coloured",
            Transmittance::Mixed => "mixed",
        },
        "warnings": planned.warnings.iter().map(|it| json!({"code": it.code(), "message": it.to_string()})).collect::<Vec<_>>(),
        "components": plan.components(),
        "lanes": plan.lanes(),
        "model": planned.model.as_ref().map(model),
        "positions": planned.positions.iter().map(|position| position.name.clone()).collect::<Vec<_>>(),
        "materials": names,
        "diffuse": plan.shading.is_some_and(|terms| terms.diffuse),
        "specular": plan.specular().is_some(),
        "phase_functions": plan.phases > 0,
        "thin_films": plan.thin_films.total(),
        "one_sided": plan.shading.is_some_and(|terms| terms.one_sided),
        "gradient_opacity": plan.groups.by_gradient(),
        "fields": plan.groups.further + 1,
        "labels": plan.labels,
        "smooth_labels": plan.smooth_labels,
        "background": plan.background,
        "lookup": plan.lookup.name(),
        "integration": plan.integration,
        "interpolation": plan.interpolation.name(),
        "skipping": plan.skipping,
        "rays": plan.rays,
        "storage": plan.storage.name(),
        "pixel_bytes": plan.pixel_bytes(),
        "texture": {
            "format": format!("{:?}", storage.format).to_lowercase(),
            "bytes": storage.bytes(scene.frame.geometry.dims),
            "domain": storage.domain,
            "loss": storage.loss,
        },
        "explanation": explanation(scene, planned, storage),
    })
}
