//! Error and cost of shadows in the frog of the peer scene: the light grid against rays, and times against the march
//! without shadows.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use relume::document::{SceneOptions, load_peer};
use relume::film::RelightMatrices;
use relume::measure::Stopwatch;
use relume::plan::plan;
use relume::progress::Quiet;
use relume::reference::{Exact, render_pixels};
use relume::render::{Renderer, SceneRenderer};
use relume::scene::{Mix, Placement, Scene, Shading, ShadowMethod};
use relume::spectrum::colour::{XYZ_FROM_LINEAR_SRGB, Xyz, ciede2000, d65_white, lab_from_xyz};
use relume::tables::Storage;

/// Side of the timed pictures.
const SIDE: usize = 400;
/// Distance of two compared pixels.
const STRIDE: usize = 8;
/// Timed marches.
const RUNS: usize = 5;

/// A measured number beside its limit.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ShadowRow {
    /// What was measured.
    pub(crate) name: String,
    /// The number.
    pub(crate) measured: f64,
    /// Its limit.
    pub(crate) limit: f64,
}

impl ShadowRow {
    /// Whether the number is within its limit.
    pub(crate) fn holds(&self) -> bool {
        self.measured <= self.limit
    }
}

/// The peer scene with its key light, and `more` others, all with or without `shadows`.
pub(crate) fn frog(peer: &Scene, shading: Shading, more: usize, shadows: bool) -> Scene {
    let mut scene = peer.clone();
    scene.shading = shading;
    scene.shadows.start = Some(0.0);
    let key = scene.lights[0].clone();
    let others = [[0.7, -0.5, -0.5], [0.1, 0.3, -0.9], [-0.9, 0.1, 0.4]];
    for (i, direction) in others.into_iter().enumerate().take(more) {
        let mut light = key.clone();
        light.name = format!("more {i}");
        light.placement = Placement::Directional(DVec3::from_array(direction).normalize());
        scene.lights.push(light);
    }
    scene.lights.iter_mut().for_each(|light| light.shadows = shadows);
    scene
}

/// Linear sRGB of every eighth pixel, in f64.
fn pixels(scene: &Scene, method: ShadowMethod, spacing: f64) -> Result<Vec<DVec3>, Box<dyn Error>> {
    let mut scene = scene.clone();
    (scene.shadows.method, scene.shadows.spacing) = (method, spacing);
    let planned = plan(&scene, &Quiet)?;
    let storage = Storage::new(&planned.plan, scene.volume(), &scene.volume().statistics()?);
    let exact = Exact::new(&scene, &planned, storage, None);
    let matrices = RelightMatrices::of_scene(&scene, &planned, &Mix::of_scene(&scene));
    let at: Vec<usize> = (STRIDE / 2..SIDE).step_by(STRIDE).collect();
    let wanted: Vec<[usize; 2]> = at.iter().flat_map(|&y| at.iter().map(move |&x| [x, y])).collect();
    let found = render_pixels(&scene, &planned, &exact, &matrices, [SIDE; 2], &wanted, &Quiet)?;
    // Pixels without volume are equal in every picture.
    Ok(found.into_iter().map(|(colour, opacity)| if opacity > 1e-12 { colour } else { DVec3::NAN }).collect())
}

/// The scene under an even sky.
fn under_sky(peer: &Scene, shadows: bool) -> Scene {
    let mut scene = frog(peer, Shading::None, 0, shadows);
    scene.lights[0].placement = Placement::Ambient;
    scene
}

/// Linear sRGB of some pixels under the sky: by the grid, and by rays in so many `directions` from each sample.
fn sky_pixels(peer: &Scene, directions: usize) -> Result<[Vec<DVec3>; 2], Box<dyn Error>> {
    /// Distance of two pixels.
    const SKY_STRIDE: usize = 20;
    let scene = under_sky(peer, true);
    let mut rays = scene.clone();
    (rays.shadows.method, rays.shadows.directions) = (ShadowMethod::Rays, directions);
    let planned = plan(&scene, &Quiet)?;
    let storage = Storage::new(&planned.plan, scene.volume(), &scene.volume().statistics()?);
    let exact = Exact::new(&scene, &planned, storage, None);
    let matrices = RelightMatrices::of_scene(&scene, &planned, &Mix::of_scene(&scene));
    let at: Vec<usize> = (SKY_STRIDE / 2..SIDE).step_by(SKY_STRIDE).collect();
    let wanted: Vec<[usize; 2]> = at.iter().flat_map(|&y| at.iter().map(move |&x| [x, y])).collect();
    let by_grid = render_pixels(&scene, &planned, &exact, &matrices, [SIDE; 2], &wanted, &Quiet)?;
    let shown = by_grid.iter().zip(&wanted).filter(|((_, opacity), _)| *opacity > 1e-12);
    let (by_grid, wanted): (Vec<DVec3>, Vec<[usize; 2]>) = shown.map(|((colour, _), &pixel)| (*colour, pixel)).unzip();
    let planned = plan(&rays, &Quiet)?;
    // One pixel at a time is marched with rays to the sky.
    let one = |pixel: &[usize; 2]| render_pixels(&rays, &planned, &exact, &matrices, [SIDE; 2], &[*pixel], &Quiet);
    let by_rays: Vec<_> = wanted.par_iter().map(one).collect::<Result<_, _>>()?;
    Ok([by_grid, by_rays.into_iter().flatten().map(|(colour, _)| colour).collect()])
}

/// Mean and 95th percentile of ΔE00, and the mean change of luminance, over pixels of the volume.
pub(crate) fn errors(found: &[DVec3], expected: &[DVec3]) -> [f64; 3] {
    let xyz = |colour: &DVec3| *XYZ_FROM_LINEAR_SRGB * *colour;
    let lab = |colour: &DVec3| lab_from_xyz(Xyz(xyz(colour).to_array()), d65_white());
    let pairs: Vec<_> = found.iter().zip(expected).filter(|(a, b)| a.is_finite() && b.is_finite()).collect();
    let mut differences: Vec<f64> = pairs.iter().map(|(a, b)| ciede2000(lab(a), lab(b))).collect();
    differences.sort_by(f64::total_cmp);
    let [found, expected] =
        [0, 1].map(|side| pairs.iter().map(|&(a, b)| xyz(if side == 0 { a } else { b }).y).sum::<f64>());
    let n = differences.len().max(1);
    let p95 = differences.get(n * 95 / 100).copied().unwrap_or(0.0);
    let mean = differences.iter().sum::<f64>() / f64::from(u32::try_from(n).unwrap_or(u32::MAX));
    [mean, p95, (found / expected - 1.0).abs()]
}

/// CPU times of filling the light grid and of the march of `scene`, in ms: the least of several.
pub(crate) fn times(renderer: &Renderer, scene: &Scene) -> Result<[f64; 2], Box<dyn Error>> {
    let on_device = SceneRenderer::new(renderer, scene.clone(), &Quiet)?;
    on_device.march([SIDE; 2], &Quiet)?;
    let mut least = [f64::INFINITY; 2];
    for _ in 0..RUNS {
        // Another upload has no light grid yet.
        let fresh = SceneRenderer::new(renderer, scene.clone(), &Quiet)?;
        let mut march = fresh.begin_march([SIDE; 2], renderer.speed())?;
        let watch = Stopwatch::start();
        while !march.fill_is_done() {
            march.step(renderer, fresh.uploaded())?;
        }
        least[0] = watch.read().cpu_ms.min(least[0]);
        drop(march);
        let watch = Stopwatch::start();
        fresh.march([SIDE; 2], &Quiet)?;
        least[1] = watch.read().cpu_ms.min(least[1]);
    }
    Ok(least)
}

/// All measurements on `renderer`, of the phantom frog or of the frog in `volume`.
pub(crate) fn shadow_rows(renderer: &Renderer, volume: Option<&Path>) -> Result<Vec<ShadowRow>, Box<dyn Error>> {
    let options = SceneOptions { volume: volume.map(Path::to_owned), ..SceneOptions::default() };
    let peer = &load_peer(&options, &Quiet)?.scene;
    let mut rows = Vec::new();
    let mut row = |name: String, measured: f64, limit: f64| rows.push(ShadowRow { name, measured, limit });
    for (shading, name, limits) in
        [(Shading::None, "unshaded", [0.35, 1.0]), (Shading::Gradient, "by gradients", [0.15, 0.45])]
    {
        let scene = frog(peer, shading, 0, true);
        let rays = pixels(&scene, ShadowMethod::Rays, 2.0)?;
        let [mean, p95, luminance] = errors(&pixels(&scene, ShadowMethod::Grid, 2.0)?, &rays);
        row(format!("{name}: grid of 2 voxels against rays, mean ΔE00"), mean, limits[0]);
        row(format!("{name}: the same, p95"), p95, limits[1]);
        row(format!("{name}: change of the mean luminance"), luminance, 0.01);
    }
    for (shading, name) in [(Shading::None, "unshaded"), (Shading::Gradient, "by gradients")] {
        let open = times(renderer, &frog(peer, shading, 0, false))?[1];
        for (spacing, limit) in [(2.0, 0.7), (4.0, 0.25), (8.0, 0.1)] {
            let mut scene = frog(peer, shading, 0, true);
            scene.shadows.spacing = spacing;
            let [fill, march] = times(renderer, &scene)?;
            row(
                format!("{name}: fill of a grid of {spacing} voxels over the march without shadows"),
                fill / open,
                limit,
            );
            if spacing <= 2.0 {
                row(format!("{name}: march with one shadow over that without"), march / open, 1.5);
            }
        }
        let eye = |shadows: bool| -> Result<f64, Box<dyn Error>> {
            let mut scene = frog(peer, shading, 0, shadows);
            scene.lights[0].placement = Placement::Headlight;
            Ok(times(renderer, &scene)?[1])
        };
        row(format!("{name}: headlight with its shadow over that without"), eye(true)? / eye(false)?, 1.05);
    }
    let four = |shadows| -> Result<f64, Box<dyn Error>> {
        Ok(times(renderer, &frog(peer, Shading::Gradient, 3, shadows))?[1])
    };
    let [by_grid, by_rays] = sky_pixels(peer, 512)?;
    let [mean, p95, _] = errors(&by_grid, &by_rays);
    row("sky of 64 directions at 4 voxels against 512 rays from each sample, mean ΔE00".to_owned(), mean, 0.4);
    row("the same, p95".to_owned(), p95, 0.8);
    let open = times(renderer, &under_sky(peer, false))?[1];
    let [fill, march] = times(renderer, &under_sky(peer, true))?;
    row("sky: fill over the march without shadows".to_owned(), fill / open, 16.0);
    row("sky: march with its shadow over that without".to_owned(), march / open, 1.5);
    row("by gradients: march with four shadows over four without".to_owned(), four(true)? / four(false)?, 1.5);
    Ok(rows)
}

/// The rows as a table.
pub(crate) fn text(rows: &[ShadowRow]) -> String {
    let lines = rows.iter().map(|row| {
        let told = if row.holds() { "holds" } else { "MISSED" };
        format!("| {} | {:.3} | {:.3} | {told} |\n", row.name, row.measured, row.limit)
    });
    format!("| number | measured | limit | |\n| --- | --- | --- | --- |\n{}", lines.collect::<String>())
}
