//! Cost of coloured shadows, phase functions and thin films in the frog of the peer scene, beside the march without them.

use std::error::Error;
use std::path::Path;

use serde::Serialize;

use relume::document::{SceneOptions, load_peer};
use relume::plan::plan;
use relume::progress::Quiet;
use relume::render::Renderer;
use relume::scene::{AccumulateAs, Scene, Shading};
use relume::spectrum::{Absorption, Layers, Spectrum, ThinFilm, ThinFilmAngle};

use super::shadows::{frog, times};

/// The march of a scene without and with an effect.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct EffectRow {
    /// The effect.
    name: String,
    /// Numbers of a pixel without and with it.
    numbers: [usize; 2],
    /// CPU time of the march without and with it, in ms.
    march_ms: [f64; 2],
    /// CPU time of filling its light grid, in ms.
    fill_ms: f64,
}

/// The march of `open` beside that of `with`.
fn row(renderer: &Renderer, name: &str, open: &Scene, with: &Scene) -> Result<EffectRow, Box<dyn Error>> {
    let numbers = |scene: &Scene| -> Result<usize, Box<dyn Error>> {
        let plan = plan(scene, &Quiet)?.plan;
        Ok(plan.components() * plan.light.accumulators() + plan.transmittance_numbers())
    };
    let ([_, open_ms], [fill_ms, with_ms]) = (times(renderer, open)?, times(renderer, with)?);
    Ok(EffectRow {
        name: name.to_owned(),
        numbers: [numbers(open)?, numbers(with)?],
        march_ms: [open_ms, with_ms],
        fill_ms,
    })
}

/// `scene` with the same two coloured absorbers in all its layers.
fn stained(mut scene: Scene) -> Result<Scene, Box<dyn Error>> {
    for (material, centre) in scene.materials.iter_mut().zip([480.0, 620.0]) {
        material.absorption = Some(Absorption::new(Spectrum::gaussian(centre, 40.0, 1.0)?)?);
    }
    for term in &mut scene.transfer.terms {
        term.absorption = term.opacity.iter().map(|&(value, opacity)| (value, opacity / 2.0)).collect();
    }
    Ok(scene)
}

/// `scene` with a film on its first materials.
fn filmed(mut scene: Scene, films: usize, angle: ThinFilmAngle) -> Result<Scene, Box<dyn Error>> {
    for (i, material) in scene.materials.iter_mut().enumerate().take(films) {
        let thickness_nm = [400.0, 300.0, 200.0, 100.0][i % 4];
        material.film = Some(ThinFilm::new(Layers { index: 1.33, thickness_nm, above: 1.0, below: 1.0 }, angle)?);
        if angle == ThinFilmAngle::Lobe {
            material.specular = 0.5;
        }
    }
    Ok(scene)
}

/// All measurements on `renderer`, of the phantom frog or of the frog in `volume`.
pub(crate) fn effect_rows(renderer: &Renderer, volume: Option<&Path>) -> Result<Vec<EffectRow>, Box<dyn Error>> {
    let options = SceneOptions { volume: volume.map(Path::to_owned), ..SceneOptions::default() };
    let peer = &load_peer(&options, &Quiet)?.scene;
    let mut rows = Vec::new();
    let glass = |shadows| stained(frog(peer, Shading::Gradient, 0, shadows));
    rows.push(row(renderer, "coloured shadow of two absorbers", &glass(false)?, &glass(true)?)?);

    let even = frog(peer, Shading::None, 0, false);
    let mut phased = even.clone();
    phased.materials.iter_mut().zip([0.5, -0.3, 0.2, 0.6]).for_each(|(material, phase)| material.phase = phase);
    rows.push(row(renderer, "phase functions of four materials", &even, &phased)?);

    let shaded = frog(peer, Shading::Gradient, 0, false);
    for (accumulate, kind) in [(AccumulateAs::Weights, "weights"), (AccumulateAs::Spectral, "k coefficients")] {
        let mut open = shaded.clone();
        open.accuracy.accumulate = accumulate;
        for (films, angle, part) in [
            (1, ThinFilmAngle::Facing, "diffuse"),
            (1, ThinFilmAngle::Lobe, "highlight"),
            (4, ThinFilmAngle::Facing, "diffuse"),
        ] {
            let name = format!("films of materials: {films}, {part}, {kind}");
            rows.push(row(renderer, &name, &open, &filmed(open.clone(), films, angle)?)?);
        }
    }
    Ok(rows)
}

/// The rows as a table.
pub(crate) fn text(rows: &[EffectRow]) -> String {
    let lines = rows.iter().map(|row| {
        let EffectRow { name, numbers: [few, many], march_ms: [open, with], fill_ms } = row;
        format!("| {name} | {few} → {many} | {open:.0} | {with:.0} | {:.2} | {fill_ms:.0} |\n", with / open)
    });
    format!(
        "| effect | numbers of a pixel | march without, ms | with, ms | ratio | fill of the light grid, ms |\n\
         | --- | --- | --- | --- | --- | --- |\n{}",
        lines.collect::<String>()
    )
}
