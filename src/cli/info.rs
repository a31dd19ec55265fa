//! `relume info`: what a volume holds, what a scene needs, what devices there are.

use std::fmt::Write as _;
use std::path::PathBuf;

use serde_json::{Value, json};

use relume::plan::{Planned, plan};
use relume::progress::Progress;
use relume::scene::Scene;
use relume::volume::{self, Volume};
use relume::vulkan::{DeviceInfo, devices};

use super::scene::{SceneArgs, voxel};
use super::{CliError, Report};

/// `relume info`
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// FILE may also be a volume.
    #[command(flatten)]
    scene: SceneArgs,
    /// Also print the value of this voxel (repeatable).
    #[arg(long, value_name = "x,y,z", value_parser = voxel)]
    voxel: Vec<[usize; 3]>,
}

pub(crate) fn run(args: &Args, progress: &dyn Progress) -> Result<Report, CliError> {
    match (&args.scene.scene, &args.scene.volume) {
        (None, None) if args.scene.define.is_empty() => of_devices(),
        (Some(path), None) if !is_scene(path) => {
            let volume = match args.scene.raw.layout() {
                Some(layout) => {
                    let file = Some(path.to_string_lossy().into_owned());
                    volume::open_raw(&volume::RawLayout { file, ..layout }, std::path::Path::new(""), progress)?
                }
                None => volume::open(path, progress)?,
            };
            let volume = match args.scene.downsample {
                Some(blocks) => volume.downsample(blocks)?,
                None => volume,
            };
            of_volume(&volume, &args.voxel)
        }
        (None, Some(_)) => of_volume(&args.scene.load(progress)?.volume, &args.voxel),
        _ => {
            let scene = args.scene.load(progress)?;
            of_scene(&scene, &plan(&scene))
        }
    }
}

/// A scene file is TOML with a version; other TOML describes a volume.
fn is_scene(path: &PathBuf) -> bool {
    let toml = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    let says_version = |text: &str| text.lines().any(|line| line.trim_start().starts_with("version"));
    toml && std::fs::read_to_string(path).map_or(true, |text| says_version(&text))
}

fn of_devices() -> Result<Report, CliError> {
    let all = devices()?;
    let mut text = String::new();
    for device in &all {
        let [major, minor, patch] = device.api_version;
        let _ = writeln!(
            text,
            "{}: {} ({:?}, Vulkan {major}.{minor}.{patch}, {})",
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

fn of_volume(volume: &Volume, voxels: &[[usize; 3]]) -> Result<Report, CliError> {
    let statistics = volume.statistics()?;
    super::render::warn_of_odd_values(&statistics);
    for note in &volume.notes {
        tracing::warn!("{note}");
    }
    let geometry = &volume.geometry;
    let mut sampled = Vec::new();
    for &index in voxels {
        let value = volume.value(index).ok_or_else(|| {
            CliError::Usage(format!("--voxel {index:?} is outside the volume's {:?} voxels", geometry.dims))
        })?;
        sampled.push((index, value));
    }
    let direction = geometry.direction;
    let mut text = format!(
        "{}\n{} x {} x {} voxels of {}, {} component(s)\nspacing {:?}, origin {:?}\naxes {:?} {:?} {:?}\nvalues {} to {}, mean {}\n",
        volume.source,
        geometry.dims[0],
        geometry.dims[1],
        geometry.dims[2],
        volume.voxels.type_name(),
        volume.components,
        geometry.spacing.to_array(),
        geometry.origin.to_array(),
        direction.x_axis.to_array(),
        direction.y_axis.to_array(),
        direction.z_axis.to_array(),
        statistics.min,
        statistics.max,
        statistics.mean,
    );
    for (index, value) in &sampled {
        let _ = writeln!(text, "voxel {index:?} = {value}");
    }
    for (key, value) in &volume.metadata {
        let _ = writeln!(text, "{key} = {value}");
    }
    let metadata: serde_json::Map<String, Value> =
        volume.metadata.iter().map(|(key, value)| (key.clone(), json!(value))).collect();
    Ok(Report {
        text,
        json: json!({
            "source": volume.source,
            "dims": geometry.dims,
            "type": volume.voxels.type_name(),
            "spacing": geometry.spacing.to_array(),
            "origin": geometry.origin.to_array(),
            // Row by row, as ITK prints it: column i is axis i.
            "direction": direction.transpose().to_cols_array(),
            "components": volume.components,
            "min": statistics.min,
            "max": statistics.max,
            "mean": statistics.mean,
            "histogram": statistics.histogram.to_vec(),
            "voxels": sampled.iter().map(|(index, value)| json!({"index": index, "value": value})).collect::<Vec<_>>(),
            "not_a_number": statistics.not_a_number,
            "infinite": statistics.infinite,
            "metadata": metadata,
            "notes": volume.notes,
        }),
    })
}

fn of_scene(scene: &Scene, planned: &Planned) -> Result<Report, CliError> {
    let sentences = planned.explain(scene);
    let volume = &scene.volume;
    let text = format!(
        "{}\nvolume: {}, {:?} voxels\n{}\n",
        scene.source,
        volume.source,
        volume.geometry.dims,
        sentences.join("\n")
    );
    Ok(Report { text, json: json!({"scene": scene.source, "plan": plan_json(scene, planned)}) })
}

/// A plan for programs.
pub(crate) fn plan_json(scene: &Scene, planned: &Planned) -> Value {
    let plan = &planned.plan;
    let names: Vec<&str> =
        planned.materials.iter().filter_map(|&m| scene.materials.get(m)).map(|m| m.name.as_str()).collect();
    json!({
        "accumulate": "weights",
        "components": plan.components(),
        "lanes": plan.lanes(),
        "positions": planned.positions.iter().map(|position| position.name.clone()).collect::<Vec<_>>(),
        "materials": names,
        "diffuse": plan.shading.is_some_and(|terms| terms.diffuse),
        "specular": plan.specular().is_some(),
        "labels": plan.labels,
        "background": plan.background,
        "lookup": format!("{:?}", plan.lookup).to_lowercase(),
        "interpolation": format!("{:?}", plan.interpolation).to_lowercase(),
        "skipping": plan.skipping,
        "explanation": planned.explain(scene),
    })
}
