//! Identical, black, numerous and missing materials.

use glam::DVec3;

use super::left::{delta_e, worst};
use super::slab::{Picture, Slab};
use super::{Bound, Extreme, ExtremeError, Group};
use relume_base::number::count as number;
use relume_colour::spectrum::colour::xyz_of;
use relume_colour::spectrum::{Reflectance, Spectrum, standard};
use relume_scene::Scene;
use relume_scene::plan::Accumulate;

pub(super) fn extremes() -> Vec<Extreme> {
    vec![
        sharing("a material and its twin", 2, "weights", |_| 1.0),
        sharing("64 materials, as weights", 64, "weights", fraction),
        sharing("64 materials, as coefficients of a model", 64, "spectral", fraction),
        black(),
        none(),
    ]
}

/// Reflectance of material `m` of 64, as a fraction of orange.
fn fraction(m: usize) -> f64 {
    number(m + 1) / 64.0
}

/// `count` materials in equal parts. Material m reflects `share(m)` times orange. Each contributes an equal part of the
/// opacity, and the picture is orange times the mean share.
fn sharing(name: &'static str, count: usize, accumulate: &'static str, share: fn(usize) -> f64) -> Extreme {
    let slab = Slab { accuracy: format!("accumulate = \"{accumulate}\""), ..Slab::default() };
    let parts = number(count);
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = slab.scene()?;
        split(&mut scene, count, share)?;
        Ok(vec![Picture::of(scene)])
    };
    let bound = if accumulate == "weights" {
        // A relight adds one product per material.
        Bound::picture(8.0 + parts)
    } else {
        Bound::given(
            "tolerance",
            1.0,
            "the plan's limit on the ΔE00 of its colour model, relative to the closed form in 81 bands",
        )
    };
    Extreme::shown(Group::Materials, name, bound, scene, move |lefts| {
        let hides = 1.0 - 0.9_f64.powi(8).powf(parts);
        let mean = (0..count).map(share).sum::<f64>() / parts;
        worst(lefts.iter().map(|left| {
            let truth = hides * mean * orange();
            match left.planned().plan.accumulate {
                Accumulate::Spectral { .. } => delta_e(left.xyz(0), truth),
                Accumulate::Weights { materials } if materials == count => {
                    let each = (0..count).map(|c| (left.weight(c, 0) * parts / hides - 1.0).abs());
                    worst(each.chain([left.colour_error(truth)]))
                }
                Accumulate::Weights { .. } => f64::NAN,
            }
        }))
    })
}

fn orange() -> DVec3 {
    let reflectance = standard::reflectance("orange");
    let seen = reflectance.map(|orange| xyz_of(&(standard::d65().spectrum() * orange.spectrum())).0);
    seen.map_or(DVec3::NAN, DVec3::from_array)
}

/// Replaces the first material by `count` materials, each with its opacity.
fn split(scene: &mut Scene, count: usize, share: fn(usize) -> f64) -> Result<(), ExtremeError> {
    let (Some(material), Some(term)) = (scene.materials.first().cloned(), scene.transfer.terms.first().cloned()) else {
        return Ok(());
    };
    scene.materials.clear();
    scene.transfer.terms.clear();
    for m in 0..count {
        let (mut material, mut term) = (material.clone(), term.clone());
        material.name = format!("m{m:02}");
        material.reflectance = Reflectance::new(material.reflectance.spectrum().scaled(share(m)))?;
        term.material.0.iter_mut().for_each(|point| point.1 = m);
        scene.materials.push(material);
        scene.transfer.terms.push(term);
    }
    Ok(())
}

/// Occludes and reflects nothing.
fn black() -> Extreme {
    let slab = Slab { reflectance: "0.0", ..Slab::default() };
    let scene = move || Ok(vec![slab.picture()?]);
    Extreme::shown(Group::Materials, "a black material", Bound::EXACT, scene, |lefts| {
        worst(lefts.iter().map(|left| {
            let hides = left.transmittance(0, 0) < 0.5 && left.weight(0, 0) > 0.5;
            let shines = left.picture.first().map_or(DVec3::NAN, |colour| colour.abs()).max_element();
            if hides { shines } else { f64::NAN }
        }))
    })
}

/// In front of a background: the transmittance is 1.
fn none() -> Extreme {
    let scene = || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = Slab::default().scene()?;
        scene.materials.clear();
        scene.transfer.terms.clear();
        scene.background = Some(Reflectance::new(Spectrum::constant(0.5))?);
        Ok(vec![Picture::of(scene)])
    };
    Extreme::shown(Group::Materials, "no materials", Bound::picture(0.0), scene, |lefts| {
        worst(lefts.iter().map(|left| {
            let behind: DVec3 = left.matrices.background.iter().sum();
            let apart = left.picture.first().map_or(DVec3::NAN, |&colour| (colour - behind).abs() / behind);
            (1.0 - left.transmittance(0, 0)).abs().max(apart.max_element())
        }))
    })
}
