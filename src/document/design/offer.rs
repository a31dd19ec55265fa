//! Palettes whose targets the visible materials of a scene can reach.

use glam::DVec3;

use relume_base::number::count;
use relume_base::progress::Progress;
use relume_colour::palette::{self, Cell, LAMP, LARGEST, Member, NATURAL, Palette, PaletteError, SMOOTHNESS, Target};
use relume_colour::spectrum::Spectrum;
use relume_colour::spectrum::colour::{Lab, Xyz, d65_white, lab_from_xyz, xyz};
use relume_scene::Scene;

/// Weight of a target that keeps a hue; a target to look alike has weight 1.
const APART: f64 = 0.2;
/// Fraction by which the target colours of an offer move from the achieved colours towards their mean. The margin keeps
/// spectra off their bounds.
const NEARER: f64 = 0.2;

/// Rounds to tenths; finer differences are not visible.
fn in_tenths(number: f64) -> f64 {
    (number * 10.0).round() / 10.0
}

/// Palette with achievable targets for the visible materials of `scene`: all look alike under its second light, and
/// keep as much of their hues as possible under its first.
///
/// # Errors
///
/// [`PaletteError`] for the scene's own spectra, or because `progress` was cancelled.
pub fn offer(scene: &Scene, progress: &dyn Progress) -> Result<Palette, PaletteError> {
    let mut palette = wished(scene);
    let found = palette::solve(&palette, progress)?;
    let colours: Vec<DVec3> =
        found.cells.iter().filter(|cell| cell.light == 0).map(|cell| DVec3::from_array(cell.xyz.0)).collect();
    let mean = colours.iter().sum::<DVec3>() / count(colours.len().max(1));
    for cell in &mut palette.cells {
        if let (Target::Lab(target), Some(had)) = (&mut cell.target, colours.get(cell.material)) {
            *target = Lab(lab_from_xyz(Xyz(had.lerp(mean, NEARER).to_array()), d65_white()).0.map(in_tenths));
        }
    }
    Ok(palette)
}

/// Palette with ideal targets: all visible materials look alike under the second light, and keep their hues at their
/// average lightness under the first.
#[must_use]
pub fn wished(scene: &Scene) -> Palette {
    let shown: Vec<_> = (0..scene.materials.len()).filter(|&index| scene.shows(index)).take(LARGEST).collect();
    let shown: Vec<_> = shown.into_iter().filter_map(|index| scene.materials.get(index)).collect();
    let mut lights: Vec<&relume_scene::SceneLight> = Vec::new();
    for light in &scene.lights {
        if lights.len() < 2 && lights.iter().all(|known| known.spectrum != light.spectrum) {
            lights.push(light);
        }
    }
    let member = |name: &str, spectrum: Option<Spectrum>, bounds: [f64; 2]| Member {
        name: name.to_owned(),
        spectrum,
        bounds,
        smoothness: SMOOTHNESS,
    };
    let mut cells = Vec::new();
    let colour = |light: &relume_scene::SceneLight, material: &relume_scene::Material| {
        lab_from_xyz(xyz(&light.spectrum, &material.reflectance), d65_white()).0.map(in_tenths)
    };
    let lightness = lights.first().map_or(0.0, |light| shown.iter().map(|it| colour(light, it)[0]).sum::<f64>())
        / count(shown.len().max(1));
    for (row, material) in shown.iter().enumerate() {
        for (column, light) in lights.iter().enumerate() {
            let [_, a, b] = colour(light, material);
            let (target, weight) = match (column, row) {
                (0, _) => (Target::Lab(Lab([in_tenths(lightness.clamp(30.0, 80.0)), a, b])), APART),
                // The first material is free under the second light.
                (_, 0) => continue,
                _ => (Target::Like { material: 0, light: column }, 1.0),
            };
            cells.push(Cell { material: row, light: column, target, weight });
        }
    }
    Palette {
        source: scene.name.clone(),
        inputs: Vec::new(),
        materials: shown.iter().map(|it| member(&it.name, None, NATURAL)).collect(),
        lights: lights.iter().map(|it| member(&it.name, Some(it.spectrum.spectrum().clone()), LAMP)).collect(),
        cells,
        model: None,
    }
}
