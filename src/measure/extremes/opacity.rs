//! Opacities from 0 to 1 and optical depths from 0 to 1e6.

use glam::DVec3;

use super::bound::{OPACITY, TERMINATION_DELTA_E};
use super::left::{delta_e, relative, worst};
use super::slab::{GREEN, Picture, Slab, straight_on};
use super::{Bound, Extreme, ExtremeError, Group};
use relume_colour::spectrum::{Reflectance, Spectrum};
use relume_scene::tables::LARGEST_RISE;
use relume_scene::{Placement, Scene, ShadowMethod, Shadows};

pub(super) fn extremes() -> Vec<Extreme> {
    let few = Bound::march(8.0);
    let mut all: Vec<Extreme> =
        [("0", 0.0, Bound::EXACT), ("1e-8", 1e-8, few), ("1 - 1e-8", 1.0 - 1e-8, few), ("1", 1.0, Bound::EXACT)]
            .into_iter()
            .map(|(name, opacity, bound)| {
                homogeneous(format!("opacity {name}"), bound, Slab { opacity, ..Slab::default() })
            })
            .collect();
    for (colour, shape) in [("grey", "1.0"), ("coloured", GREEN)] {
        for depth in [0.0, 1e-8, 1e4, 1e6] {
            // Absorption alone, and together with scattering.
            for (what, opacity) in [("alone", 0.0), ("with scattering", 0.1)] {
                let coloured = if colour == "coloured" && depth > 0.0 { "k = 4" } else { "" };
                let slab = Slab { opacity, accuracy: coloured.to_owned(), ..Slab::default() };
                let slab = Slab { absorption: Some((shape, depth / slab.length())), ..slab };
                let name = format!("optical depth {depth:e}, {colour}, {what}");
                all.push(homogeneous(name, few, slab));
            }
        }
    }
    all.extend([1e-8, 1e-6, 1e-4, 0.01, 0.5, 0.99, 1.0 - 1e-6, 1.0 - 1e-8].map(one_sample));
    all.push(homogeneous(
        "opacity 1e-10 per length of 1e-9".to_owned(),
        few,
        Slab { opacity: 1e-10, opacity_length: 1e-9, ..Slab::default() },
    ));
    all.extend([false, true].map(behind_a_grid));
    all.push(thin_air());
    all.push(white_behind_black());
    all
}

fn homogeneous(name: String, bound: Bound, slab: Slab) -> Extreme {
    let asked = slab.clone();
    Extreme::shown(
        Group::Opacity,
        name,
        bound,
        move || Ok(vec![asked.picture()?]),
        move |lefts| worst(lefts.iter().map(|left| slab.error(left))),
    )
}

/// An almost opaque slab lit from the eye, whose shadows a light grid holds. The depth of its surface rises by at most
/// [`LARGEST_RISE`] from node to node, so the first step, a quarter of the spacing below, has 1/e of its light; with a start of
/// the spacing and a voxel, all of it (docs/theory/shadows.md, *Start*).
fn behind_a_grid(start: bool) -> Extreme {
    const SPACING: f64 = 2.0;
    let slab = Slab { opacity: 0.999_999_9, ..Slab::default() };
    let asked = slab.clone();
    let scene = move || -> Result<Vec<Picture>, ExtremeError> {
        let mut scene = asked.scene()?;
        for light in &mut scene.lights {
            (light.placement, light.shadows) = (Placement::Directional(DVec3::NEG_Z), true);
        }
        let start = Some(if start { SPACING + 1.0 } else { 0.0 });
        scene.shadows = Shadows { method: ShadowMethod::Grid, spacing: SPACING, start, ..Shadows::default() };
        Ok(vec![Picture::of(scene)])
    };
    let (what, kept) =
        if start { ("with a start", 1.0) } else { ("without a start: 1/e", (-LARGEST_RISE * 0.5 / SPACING).exp()) };
    let bound = Bound::march(8.0).and(
        1e-6,
        "march and second step",
        "the second step has 1e-7 of the light, of which the grid takes any part",
    );
    Extreme::shown(Group::Opacity, format!("light of opacity 0.9999999 by a grid {what}"), bound, scene, move |lefts| {
        worst(lefts.iter().map(|left| {
            let [weights, _] = slab.closed_form(left, slab.length());
            worst(weights.iter().enumerate().map(|(c, &weight)| relative(left.weight(c, 0), kept * weight)))
        }))
    })
}

/// One voxel with one step through it, at several lengths (docs/theory/acceptance.md C14).
fn one_sample(opacity: f64) -> Extreme {
    const LENGTHS: [f64; 5] = [1e-3, 0.03, 1.0, 7.0, 100.0];
    let scene = move |length: f64| -> Result<Picture, ExtremeError> {
        let mut scene = Slab { dims: [1, 1, 1], opacity, step: length, ..Slab::default() }.scene()?;
        set_spacing(&mut scene, length);
        Ok(Picture::of(scene))
    };
    let bound = Bound::given(
        "opacity",
        OPACITY,
        "opacity of a step, 1 − (1 − α)^r, computed in f64 and rounded once: docs/theory/acceptance.md C14, 33 roundings of f32",
    );
    let name = format!("opacity {opacity} in one step of 1e-3 to 100 lengths");
    Extreme::shown(
        Group::Opacity,
        name,
        bound,
        move || LENGTHS.into_iter().map(scene).collect(),
        move |lefts| {
            let slab = Slab { opacity, ..Slab::default() };
            worst(lefts.iter().zip(LENGTHS).map(|(left, length)| slab.error_at(left, 0, length)))
        },
    )
}

/// Enlarges a scene's voxels; the camera still looks at the middle, from outside.
fn set_spacing(scene: &mut Scene, spacing: f64) {
    let mut volume = (**scene.volume()).clone();
    volume.geometry.spacing = DVec3::splat(spacing);
    scene.camera = straight_on(&volume.geometry);
    scene.set_volume(std::sync::Arc::new(volume));
}

/// Transmittance far below the smallest normal f32.
fn thin_air() -> Extreme {
    let slab = Slab { dims: [5, 5, 201], opacity: 0.5, ..Slab::default() };
    homogeneous("transmittance 6e-61".to_owned(), Bound::march(200.0), slab)
}

/// Worst case of docs/theory/acceptance.md C17: white behind black, where a thousandth of the background makes ΔE00
/// 0.5.
fn white_behind_black() -> Extreme {
    let scene = |opacity| -> Result<Picture, ExtremeError> {
        let mut scene = Slab { dims: [3, 3, 1001], opacity, reflectance: "0.0", ..Slab::default() }.scene()?;
        scene.background = Some(Reflectance::new(Spectrum::constant(1.0))?);
        scene.accuracy.termination = USUAL_TERMINATION;
        Ok(Picture::of(scene))
    };
    let bound = Bound::given(
        "termination",
        TERMINATION_DELTA_E,
        "a ray ends at a transmittance of 1e-4, which is ΔE00 0.05 in front of white (docs/theory/acceptance.md C17 allows 0.1)",
    );
    Extreme::shown(
        Group::Opacity,
        "white behind black, early ray termination",
        bound,
        move || [0.01, 0.1, 0.5, 0.9].into_iter().map(scene).collect(),
        |lefts| {
            worst(lefts.iter().map(|left| {
                // Checks that the ray has ended early; otherwise nothing was tested.
                if left.transmittance(0, 0) > 1e-9 { delta_e(left.xyz(0), DVec3::ZERO) } else { f64::NAN }
            }))
        },
    )
}

/// Default termination threshold of a scene.
const USUAL_TERMINATION: f64 = 1e-4;
