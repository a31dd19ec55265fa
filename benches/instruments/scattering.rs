//! Error and time of light that scatters more than once: rows of transfer factors against paths, in the frog of the peer scene with a quarter
//! of its resolution; time of rows with all of its voxels.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use serde::Serialize;

use relume::document::{SceneOptions, load_peer, parse};
use relume::film::RelightMatrices;
use relume::measure::{ScatteredError, Stopwatch, scattered_error};
use relume::model::random::Random;
use relume::plan::{Planned, plan};
use relume::progress::Quiet;
use relume::reference::{Exact, TransferRows, render};
use relume::scene::{Coarse, Mix, Orders, ScatteringMethod, Scene, Shading};
use relume::spectrum::{Reflectance, Spectrum};
use relume::tables::Storage;

use crate::goals::text;
use crate::shadows::errors;

/// Pixels of a side.
const SIDE: usize = 48;

/// A measured setting.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ScatteringRow {
    /// The setting.
    pub(crate) name: String,
    /// Mean and 95th percentile of ΔE00 against paths; none of the whole volume.
    pub(crate) errors: Option<[f64; 2]>,
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

    /// CPU time of the rows and of their solution in s, nodes and pairs.
    fn rows(&self) -> Result<([f64; 2], [usize; 2]), Box<dyn Error>> {
        let watch = Stopwatch::start();
        let made = TransferRows::new(&self.scene, &self.planned, &self.storage, None, &Quiet)?;
        let rays = watch.read().cpu_ms / 1000.0;
        let watch = Stopwatch::start();
        made.light(&self.scene, &self.planned, &Quiet)?;
        Ok(([rays, watch.read().cpu_ms / 1000.0], made.counts()))
    }

    /// Linear sRGB of each pixel; not a number beside the volume.
    fn pixels(&self, size: [usize; 2]) -> Result<Vec<DVec3>, Box<dyn Error>> {
        let exact = Exact::new(&self.scene, &self.planned, self.storage.clone(), None);
        let matrices = RelightMatrices::of_scene(&self.scene, &self.planned, &Mix::of_scene(&self.scene));
        let found = render(&self.scene, &self.planned, &exact, &matrices, size, &Quiet)?;
        Ok(found.into_iter().map(|(colour, opacity)| if opacity > 1e-12 { colour } else { DVec3::NAN }).collect())
    }
}

/// All settings, against so many `paths` of a pixel.
pub(crate) fn scattering_rows(volume: Option<&Path>, paths: usize) -> Result<Vec<ScatteringRow>, Box<dyn Error>> {
    let options = SceneOptions { volume: volume.map(Path::to_owned), ..SceneOptions::default() };
    let peer = load_peer(&options, &Quiet)?.scene;
    // Voxels of a quarter of the edge for the frog, and the phantom as it is.
    let level = if volume.is_some() { 2 } else { 0 };
    let mut whole = Scene { shading: Shading::None, ..peer.clone() };
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
    let expected = Case::new(truth)?.pixels([SIDE; 2])?;
    let mut rows = vec![ScatteringRow {
        name: format!("{paths} paths"),
        errors: Some([0.0; 2]),
        seconds: [watch.read().cpu_ms / 1000.0, 0.0],
        counts: scene.frame.geometry.dims[..2].try_into()?,
    }];
    let mut row = |name: String, case: &Case, seconds: [f64; 2], counts: [usize; 2]| -> Result<(), Box<dyn Error>> {
        let [mean, p95, _] = errors(&case.pixels([SIDE; 2])?, &expected);
        rows.push(ScatteringRow { name, errors: Some([mean, p95]), seconds, counts });
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
            let (seconds, counts) = case.rows()?;
            row(format!("nodes {spacing} voxels apart, {directions} directions"), &case, seconds, counts)?;
        }
    }
    if level > 0 {
        whole.accuracy.dimension = Some(8);
        whole.scattering.orders = Orders::Multiple;
        whole.scattering.directions = Some(8);
        let name = format!("all voxels of the peer scene, nodes {:.1} apart, 8 directions", whole.scattering_spacing());
        let (seconds, counts) = Case::new(whole)?.rows()?;
        rows.push(ScatteringRow { name, errors: None, seconds, counts });
    }
    Ok(rows)
}

/// Stated and true error of the scattered light of a seeded scene.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct StatedRow {
    /// Number of the scene.
    pub(crate) seed: u64,
    /// The stated error.
    pub(crate) stated: ScatteredError,
    /// p95 of ΔE00 against paths.
    pub(crate) of_paths: f64,
    /// p95 of ΔE00 by the noise of these paths.
    pub(crate) noise: f64,
    /// Mean luminance over that of the paths, less 1.
    pub(crate) luminance: f64,
}

impl StatedRow {
    /// True error over the stated one, with the noise of the paths taken off.
    pub(crate) fn ratio(&self) -> f64 {
        (self.of_paths.powi(2) - self.noise.powi(2)).max(0.0).sqrt() / self.stated.p95
    }
}

/// Pixels across and down of pictures of seeded scenes.
const SMALL: [usize; 2] = [15, 13];

/// Stated and true errors of scattered light in this many seeded scenes, against so many `paths` of a pixel.
/// Every third scene has materials that reflect 0.95, every second one coloured absorption.
pub(crate) fn stated_rows(scenes: u16, paths: usize) -> Result<Vec<StatedRow>, Box<dyn Error>> {
    let mut rows = Vec::new();
    for seed in 0..u64::from(scenes) {
        let text = text(&mut Random::new(5800 + seed), seed % 2 == 1) + "[scattering]\norders = \"multiple\"\n";
        let mut scene = parse(&format!("scene {seed}"), &text, Path::new(""), &SceneOptions::default(), &Quiet)?.scene;
        if seed % 3 == 0 {
            let white = Reflectance::new(Spectrum::constant(0.95))?;
            scene.materials.iter_mut().for_each(|material| material.reflectance = white.clone());
        }
        scene.accuracy.step_length *= 0.5;
        // The light of the first order is the same, and paths read it as rows do.
        scene.shadows.spacing = 0.5;
        let Some(stated) = scattered_error(&scene, &Mix::of_scene(&scene), SMALL, &Quiet)? else { continue };
        let found = Case::new(scene.clone())?.pixels(SMALL)?;
        scene.scattering.method = ScatteringMethod::Paths;
        let of = |paths: usize| -> Result<Vec<DVec3>, Box<dyn Error>> {
            let mut scene = scene.clone();
            scene.scattering.paths = paths;
            Case::new(scene)?.pixels(SMALL)
        };
        let [expected, half] = [of(paths)?, of(paths / 2)?];
        // The noise of half the paths and that of all differ by √3 times that of all.
        let ([_, apart, _], [_, of_paths, _]) = (errors(&half, &expected), errors(&found, &expected));
        let noise = apart / 3.0_f64.sqrt();
        let light = |pixels: &[DVec3]| pixels.iter().filter(|it| it.is_finite()).map(|it| it.y).sum::<f64>();
        rows.push(StatedRow { seed, stated, of_paths, noise, luminance: light(&found) / light(&expected) - 1.0 });
    }
    Ok(rows)
}

/// Fraction of scenes whose true error is within the stated one, and the largest ratio of both.
pub(crate) fn kept(rows: &[StatedRow]) -> [f64; 2] {
    let within = rows.iter().filter(|row| row.ratio() <= 1.0).count();
    let share = |count: usize| f64::from(u32::try_from(count).unwrap_or(u32::MAX));
    [share(within) / share(rows.len()), rows.iter().map(StatedRow::ratio).fold(0.0, f64::max)]
}

/// The stated errors as a table.
pub(crate) fn stated_text(rows: &[StatedRow]) -> String {
    let lines = rows.iter().map(|row| {
        let StatedRow { seed, stated: ScatteredError { nodes, directions, p95 }, of_paths, noise, luminance } = row;
        format!(
            "| {seed} | {nodes:.2} | {directions:.2} | {p95:.2} | {of_paths:.2} | {noise:.2} | {:.2} | {:+.1} % |\n",
            row.ratio(),
            100.0 * luminance
        )
    });
    let [within, largest] = kept(rows);
    format!(
        "| scene | nodes | directions | stated p95 | p95 against paths | noise of the paths | true/stated | luminance |\n| --- | --- | --- | --- | --- | --- | --- | --- |\n{}\nWithin the stated error: {:.0} % of {} scenes; the largest ratio is {largest:.2}.\n",
        lines.collect::<String>(),
        100.0 * within,
        rows.len()
    )
}

/// The rows as a table.
pub(crate) fn table(rows: &[ScatteringRow]) -> String {
    let lines =
        rows.iter().map(|ScatteringRow { name, errors, seconds: [rays, solution], counts: [nodes, factors] }| {
            let errors = errors.map_or_else(|| "– | –".to_owned(), |[mean, p95]| format!("{mean:.2} | {p95:.2}"));
            format!("| {name} | {errors} | {rays:.2} | {solution:.3} | {nodes} | {factors} |\n")
        });
    format!(
        "| setting | mean ΔE00 | p95 | rays, CPU s | solution, CPU s | nodes | factors |\n| --- | --- | --- | --- | --- | --- | --- |\n{}",
        lines.collect::<String>()
    )
}
