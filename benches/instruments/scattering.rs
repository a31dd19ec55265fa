//! Error and time of light that scatters more than once: rows of transfer factors against paths, in the frog of the peer scene with a quarter
//! of its resolution.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use relume::document::{SceneOptions, load_peer};
use relume::film::RelightMatrices;
use relume::measure::Stopwatch;
use relume::plan::{Planned, plan};
use relume::progress::Quiet;
use relume::reference::{Exact, TransferRows, render};
use relume::scene::{Coarse, Mix, Orders, ScatteringMethod, Scene, Shading};
use relume::tables::Storage;

use crate::shadows::errors;

/// Pixels of a side.
const SIDE: usize = 48;

/// A measured setting.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ScatteringRow {
    /// The setting.
    pub(crate) name: String,
    /// Mean and 95th percentile of ΔE00 against paths.
    pub(crate) errors: [f64; 2],
    /// CPU time of the rays and of the solution in s.
    pub(crate) seconds: [f64; 2],
    /// Nodes and pairs of nodes.
    pub(crate) counts: [usize; 2],
}

/// The scene, its plan, and its volume as stored.
struct Case {
    scene: Scene,
    planned: Planned,
    storage: Storage,
}

impl Case {
    fn new(scene: Scene) -> Result<Self, Box<dyn Error>> {
        let planned = plan(&scene, &Quiet)?;
        let storage = Storage::new(&planned.plan, scene.volume(), &scene.volume().statistics()?);
        Ok(Self { scene, planned, storage })
    }

    /// Linear sRGB of each pixel; not a number beside the volume.
    fn pixels(&self) -> Result<Vec<DVec3>, Box<dyn Error>> {
        let exact = Exact::new(&self.scene, &self.planned, self.storage.clone(), None);
        let matrices = RelightMatrices::of_scene(&self.scene, &self.planned, &Mix::of_scene(&self.scene));
        let found = render(&self.scene, &self.planned, &exact, &matrices, [SIDE; 2], &Quiet)?;
        Ok(found.into_iter().map(|(colour, opacity)| if opacity > 1e-12 { colour } else { DVec3::NAN }).collect())
    }
}

/// All settings, against so many `paths` of a pixel.
pub(crate) fn scattering_rows(volume: Option<&Path>, paths: usize) -> Result<Vec<ScatteringRow>, Box<dyn Error>> {
    let options = SceneOptions { volume: volume.map(Path::to_owned), ..SceneOptions::default() };
    let peer = load_peer(&options, &Quiet)?.scene;
    // Voxels of a quarter of the edge for the frog, and the phantom as it is.
    let level = if volume.is_some() { 2 } else { 0 };
    let mut scene = if level > 0 { Coarse::of_level(&peer, level, &Quiet)?.scene_in(&peer, [SIDE; 2]) } else { peer };
    scene.shading = Shading::None;
    // As deep by voxels as the frog itself.
    scene.transfer.opacity_length *= f64::from(1_u32 << level);
    scene.shadows.spacing = 1.0;
    scene.accuracy.step_length = 0.5 * scene.frame.geometry.spacing.min_element();
    scene.accuracy.dimension = Some(8);
    scene.scattering.orders = Orders::Multiple;
    scene.scattering.paths = paths;
    let mut truth = scene.clone();
    truth.scattering.method = ScatteringMethod::Paths;
    let watch = Stopwatch::start();
    let expected = Case::new(truth)?.pixels()?;
    let mut rows = vec![ScatteringRow {
        name: format!("{paths} paths"),
        errors: [0.0; 2],
        seconds: [watch.read().cpu_ms / 1000.0, 0.0],
        counts: scene.frame.geometry.dims[..2].try_into()?,
    }];
    let mut row = |name: String, case: &Case, seconds: [f64; 2], counts: [usize; 2]| -> Result<(), Box<dyn Error>> {
        let [mean, p95, _] = errors(&case.pixels()?, &expected);
        rows.push(ScatteringRow { name, errors: [mean, p95], seconds, counts });
        Ok(())
    };
    let single = Case::new(Scene {
        scattering: relume::scene::Scattering { orders: Orders::Single, ..scene.scattering },
        ..scene.clone()
    })?;
    row("order 1 only".to_owned(), &single, [0.0; 2], [0; 2])?;
    for spacing in [2.0] {
        for directions in [8, 32] {
            scene.scattering.spacing = Some(spacing);
            scene.scattering.directions = Some(directions);
            let case = Case::new(scene.clone())?;
            let watch = Stopwatch::start();
            let made = TransferRows::new(&case.scene, &case.planned, &case.storage, None, &Quiet)?;
            let rays = watch.read().cpu_ms / 1000.0;
            let watch = Stopwatch::start();
            made.light(&case.scene, &case.planned, &Quiet)?;
            let solution = watch.read().cpu_ms / 1000.0;
            row(
                format!("nodes {spacing} voxels apart, {directions} directions"),
                &case,
                [rays, solution],
                made.counts(),
            )?;
        }
    }
    Ok(rows)
}

/// The rows as a table.
pub(crate) fn text(rows: &[ScatteringRow]) -> String {
    let lines = rows.iter().map(
        |ScatteringRow { name, errors: [mean, p95], seconds: [rays, solution], counts: [nodes, factors] }| {
            format!("| {name} | {mean:.2} | {p95:.2} | {rays:.2} | {solution:.3} | {nodes} | {factors} |\n")
        },
    );
    format!(
        "| setting | mean ΔE00 | p95 | rays, CPU s | solution, CPU s | nodes | factors |\n| --- | --- | --- | --- | --- | --- | --- |\n{}",
        lines.collect::<String>()
    )
}
