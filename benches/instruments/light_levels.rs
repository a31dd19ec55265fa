//! Error of shadows from a coarse level, as volumes in bricks have them, against those of the voxels.

use std::error::Error;
use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Serialize;

use relume::document::{SceneOptions, load};
use relume::progress::Quiet;
use relume::render::{Renderer, Residence, SceneRenderer};
use relume::scene::{Mix, Scene, Shading};
use relume::spectrum::colour::{Lab, XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::tables::{apron, slot_edge};

/// Side of the pictures.
const SIDE: usize = 300;
/// Darkest compared pixel, in L*.
const DARKEST: f64 = 0.5;
/// Sides of the blocks whose means cast shadows.
const BLOCKS: [usize; 2] = [2, 4];

/// A picture against the one with the shadows of the voxels.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct LightLevelRow {
    scene: String,
    shading: &'static str,
    /// Source of the shadows: the voxels, a level, or none.
    shadows: String,
    /// ΔE00: mean, 95th percentile and maximum.
    delta_e: [f64; 3],
    /// Mean difference of L*.
    lighter: f64,
}

/// The picture of `scene`, row by row.
fn picture(on_device: &SceneRenderer) -> Result<Vec<Lab>, Box<dyn Error>> {
    let film = on_device.march([SIDE; 2], &Quiet)?;
    let colours = on_device.renderer().read(&film)?.relight(&on_device.matrices(&Mix::of_scene(on_device.scene())));
    let lab = |colour: DVec3| lab_from_xyz(Xyz((*XYZ_FROM_LINEAR_SRGB * colour).to_array()), d65_white());
    Ok(colours.into_iter().map(lab).collect())
}

/// Mean, 95th percentile and maximum of ΔE00 in the pixels that are not dark, and the mean difference of L*.
fn difference(found: &[Lab], expected: &[Lab]) -> ([f64; 3], f64) {
    let pairs: Vec<_> = found.iter().zip(expected).filter(|(_, expected)| expected.0[0] > DARKEST).collect();
    let mut differences: Vec<f64> = pairs.iter().map(|&(a, b)| ciede2000(*a, *b)).collect();
    differences.sort_by(f64::total_cmp);
    let n = f64::from(u32::try_from(differences.len().max(1)).unwrap_or(u32::MAX));
    let mean = differences.iter().sum::<f64>() / n;
    let lighter = pairs.iter().map(|(found, expected)| found.0[0] - expected.0[0]).sum::<f64>() / n;
    let p95 = differences.get(differences.len() * 95 / 100).copied().unwrap_or(0.0);
    ([mean, p95, differences.last().copied().unwrap_or(0.0)], lighter)
}

/// Measures the scenes in `files`; all their lights cast shadows.
pub(crate) fn light_level_rows(renderer: &Renderer, files: &[PathBuf]) -> Result<Vec<LightLevelRow>, Box<dyn Error>> {
    let mut rows = Vec::new();
    for file in files {
        let mut scene = load(file, &SceneOptions::default(), &Quiet)?.scene;
        scene.lights.iter_mut().for_each(|light| light.shadows = true);
        for (shading, name) in [(Shading::Gradient, "gradients"), (Shading::None, "none")] {
            scene.shading = shading;
            rows.extend(of_scene(renderer, &scene, (file, name))?);
        }
    }
    Ok(rows)
}

fn of_scene(
    renderer: &Renderer,
    scene: &Scene,
    (file, shading): (&Path, &'static str),
) -> Result<Vec<LightLevelRow>, Box<dyn Error>> {
    let whole = SceneRenderer::new(renderer, scene.clone(), &Quiet)?;
    let expected = picture(&whole)?;
    let row = |shadows: String, found: &[Lab]| {
        let (delta_e, lighter) = difference(found, &expected);
        LightLevelRow { scene: file.display().to_string(), shading, shadows, delta_e, lighter }
    };
    let dims = scene.frame.geometry.dims;
    if whole.uploaded().residence() != Residence::Whole {
        return Err("the device must hold the volume whole: its shadows are those of the voxels".into());
    }
    let voxel_bytes = whole.uploaded().bytes() / dims.iter().product::<usize>() as u64;
    let slot_bytes = u64::from(slot_edge(apron(scene, &whole.planned().plan))).pow(3) * voxel_bytes;
    let mut rows = Vec::new();
    for side in BLOCKS {
        // The least memory for the level, which leaves as much for bricks, or one.
        let level_bytes = dims.map(|n| n.div_ceil(side) as u64).iter().product::<u64>() * voxel_bytes;
        let memory = level_bytes + level_bytes.max(slot_bytes);
        let bricked = renderer.clone().always_in_bricks().with_memory(memory);
        let bricked = SceneRenderer::new(&bricked, scene.clone(), &Quiet)?;
        let block = dims.map(|n| side.min(n.next_power_of_two()));
        if bricked.uploaded().light_block() != Some(block) {
            return Err(format!("{memory} bytes have shadows of {:?}", bricked.uploaded().light_block()).into());
        }
        rows.push(row(format!("means of {side}×{side}×{side}"), &picture(&bricked)?));
    }
    let mut open = scene.clone();
    open.lights.iter_mut().for_each(|light| light.shadows = false);
    rows.push(row("none".to_owned(), &picture(&SceneRenderer::new(renderer, open, &Quiet)?)?));
    Ok(rows)
}

/// The rows as a table.
pub(crate) fn text(rows: &[LightLevelRow]) -> String {
    let mut text = format!(
        "{SIDE}×{SIDE} pixels, those with L* above {DARKEST}: ΔE00 against shadows of the voxels\n\
         | scene | shading | shadows | mean | p95 | max | L* higher by |\n| --- | --- | --- | --- | --- | --- | --- |\n"
    );
    for LightLevelRow { scene, shading, shadows, delta_e: [mean, p95, max], lighter } in rows {
        text += &format!("| {scene} | {shading} | {shadows} | {mean:.2} | {p95:.2} | {max:.2} | {lighter:.2} |\n");
    }
    text
}
